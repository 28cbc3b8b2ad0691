"""palpate film: evaluate cells from frame to frame, with one row for each frame and cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.files import Force, check_output
from palpate.cli.progress import Frames
from palpate.errors import InvalidInput


def film(
    frames: Annotated[
        list[Path],
        typer.Argument(
            metavar="FRAME...",
            help="Pictures of beads while the cells pull (stacks, folders, single pictures), or displacement fields: files of one frame, or of several (PIVlab's .mat, a table with a column frame).",
        ),
    ],
    youngs_modulus: Annotated[str, typer.Option(help='Modulus of the gel, e.g. "8 kPa", or "8 kPa +- 10 %".')],
    poissons_ratio: Annotated[float, typer.Option(help="Poisson's ratio of the gel, e.g. 0.48.")],
    pixel: Annotated[
        str | None, typer.Option(help='Size of a pixel, e.g. "0.1 um"; default: that stated in the pictures.')
    ] = None,
    rest: Annotated[
        Path | None,
        typer.Option(help="Picture of the beads at rest; needed for pictures, not for displacement fields."),
    ] = None,
    thickness: Annotated[str | None, typer.Option(help='Thickness of a gel on glass, e.g. "40 um".')] = None,
    depth: Annotated[str, typer.Option(help="Depth of the beads below the surface.")] = "0 um",
    cells: Annotated[
        Path | None,
        typer.Option(
            help="Label picture of the cells (one for all frames, or a page for each), or ImageJ's RoiSet.zip, or outlines (.csv of x,y in pixels, .json). The table has a row for each cell."
        ),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(help="Label picture of adhesions, or ImageJ's RoiSet.zip: the table has the force of each."),
    ] = None,
    window: Annotated[int | None, typer.Option(help="As for palpate tfm.")] = None,
    step: Annotated[float | None, typer.Option(help="As for palpate tfm.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of displacement fields: px, um, m.")] = None,
    start: Annotated[str | None, typer.Option(help="As for palpate tfm.")] = None,
    up: Annotated[bool, typer.Option("--up", help="y and v of fields grow upwards.")] = False,
    v_up: Annotated[bool, typer.Option("--v-up", help="v of fields grows upwards, and y downwards.")] = False,
    name: Annotated[
        str | None, typer.Option(help='Film to read from files that contain several, e.g. "u_original, v_original".')
    ] = None,
    channel: Annotated[int | None, typer.Option(min=1, help="As for palpate tfm.")] = None,
    noise: Annotated[str | None, typer.Option(help="Standard deviation of the displacements, e.g. 5 nm.")] = None,
    method: Annotated[str | None, typer.Option(help="adhesions or tikhonov, as for palpate tfm.")] = None,
    normal: Annotated[str | None, typer.Option(help="As for palpate tfm.")] = None,
    monolayer: Annotated[
        bool,
        typer.Option(
            "--monolayer",
            help="The cells are one sheet: a row for the sheet and one for each cell, with their tensions.",
        ),
    ] = False,
    still: Annotated[
        bool, typer.Option("--still", help="The pictures have not moved as a whole: no shift is removed.")
    ] = False,
    processes: Annotated[int | None, typer.Option(min=1, help="Default: one for each core.")] = None,
    out: Annotated[
        Path, typer.Option(help="Table of frames and cells; forces of labels go beside it as NAME-labels.csv.")
    ] = Path("film.csv"),
    force: Force = False,
) -> None:
    """Evaluate films and many cells on all cores: write one row for each frame and cell. An interrupted run continues where it stopped."""
    from palpate.cli.options import numbers
    from palpate.cli.tfm import _modulus_of, _pixel
    from palpate.elastic import BondedLayers, HalfSpace, Layer
    from palpate.microscopy import Film, is_field
    from palpate.microscopy.labels import write_labels_table
    from palpate.microscopy.pixelsize import pixel_size_of_all
    from palpate.units import parse_quantity

    beside = out.with_name(f"{out.stem}-labels{out.suffix}")
    partial = out.with_name(f"{out.stem}.partial.jsonl")
    inputs = [*frames, rest, cells, labels]
    check_output(out, inputs=inputs, force=force)
    if labels is not None:
        check_output(beside, inputs=inputs, force=force)
    for file in inputs:
        if file is not None and not file.exists():
            raise InvalidInput(f"{file}: no such file. Give the path of a file that exists.")
    whole = [f for f in frames if f.is_file()]
    pictures = [] if whole and is_field(whole[:1]) else [*([] if rest is None else [rest]), *whole]
    stated = pixel_size_of_all(pictures) if pixel is None else None
    if pixel is None and stated is None:
        raise InvalidInput('no file states the size of a pixel: give it, such as --pixel "0.1 um".')
    notes, size_of_pixel = _pixel(pixel, stated, pictures)
    first = None if start is None else numbers(start, "--start")
    if first is not None and len(first) != 2:
        raise InvalidInput(f"--start takes column,row of the first vector in pixels, such as 16,16; got {start!r}.")
    value, uncertainty = _modulus_of("--youngs-modulus", youngs_modulus)
    if thickness is None:
        pad: HalfSpace | BondedLayers = HalfSpace(youngs_modulus=value, poissons_ratio=poissons_ratio)
    else:
        layer = Layer(
            thickness=parse_quantity(thickness, "length", "--thickness"),
            youngs_modulus=value,
            poissons_ratio=poissons_ratio,
        )
        pad = BondedLayers([layer])
    made = Film(
        frames=[*frames], rest=rest, pad=pad, pixel=size_of_pixel, window=window, step=step, unit=unit,
        depth=parse_quantity(depth, "length", "--depth"), noise=None if noise is None else parse_quantity(noise, "length", "--noise"),
        method=method, uncertainty=uncertainty, drift=not still, cells=cells, labels=labels, up=up, v_up=v_up,
        start=None if first is None else (first[0], first[1]), name=name, channel=channel, normal=normal or "up", monolayer=monolayer,
    )  # fmt: skip
    count = len(made.jobs())
    try:
        with Frames("frames", count, hint="; --processes sets how many run at once") as shown:
            rows, labelled = made.run(partial, processes=processes, shown=shown)
    except KeyboardInterrupt:
        typer.echo(f"{partial} holds the solved frames: run the same command again to continue", err=True)
        raise
    failed = [r for r in rows if len(r) < 6]
    if len(failed) == len(rows):
        partial.unlink(missing_ok=True)
        raise InvalidInput(f"no frame was solved. Frame {rows[0]['frame']} ({rows[0]['file']}): {rows[0]['notes']}")
    names = max(rows, key=len)
    write_labels_table([{k: r.get(k, "") for k in names} for r in rows], out)
    written = [out]
    if labelled:
        write_labels_table(labelled, beside)
        written.append(beside)
    partial.unlink(missing_ok=True)
    for note in dict.fromkeys(notes):
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"{count} frames, {len(rows) - len(failed)} rows")
    for row in failed:
        typer.echo(f"frame {row['frame']} ({row['file']}): {row['notes']}", err=True)
    typer.echo(f"wrote {', '.join(map(str, written))}")
