"""palpate reconstruct: pressure and shear from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.files import Force, check_output, provenance, save_figure, skin_files, written
from palpate.cli.methods import chosen_method
from palpate.cli.options import check_matching, check_picture
from palpate.cli.progress import busy, progress
from palpate.errors import InvalidInput


def reconstruct(
    ctx: typer.Context,
    recording_file: Annotated[
        Path,
        typer.Argument(metavar="RECORDING", help="Recording (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag)."),
    ],
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Result to write (.nc, .h5, .npz, .csv, .zarr or .mcap); default: RECORDING-touch.nc."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of one frame to write (.png, .pdf or .svg).")] = None,
    frame: Annotated[int, typer.Option(help="Frame to draw and to print; -1 is the last.")] = -1,
    components: Annotated[
        str | None, typer.Option(help="What is sought, e.g. z or x,z; default: what the channels can tell apart.")
    ] = None,
    drop_missing: Annotated[
        bool, typer.Option("--drop-missing", help="Leave out taxels with missing readings instead of refusing them.")
    ] = False,
    force: Force = False,
) -> None:
    """Recover pressure and shear from a recording. Nothing to tune."""
    from dataclasses import replace

    from palpate._memory import require
    from palpate.elastic import Viscoelastic
    from palpate.recordings import read_recording, read_stream, write_touch
    from palpate.recordings.formats import file_format
    from palpate.sensing.readings import Layout
    from palpate.skin import Skin
    from palpate.touch import joined

    target = out if out is not None else recording_file.with_name(recording_file.stem + "-touch.nc")
    file_format(target)
    inputs = [recording_file, *skin_files(skin_file)]
    check_output(target, inputs=inputs, force=force)
    if plot is not None:
        check_picture(plot)
        check_output(plot, inputs=inputs, force=force)
    method = chosen_method(ctx)
    recording = read_recording(recording_file, mapping=read_stream(skin_file))
    skin = Skin.from_file(skin_file, recording=recording)
    check_matching(recording, skin)
    if drop_missing and recording.missing.any():
        if len(skin.planes) != 1:
            raise InvalidInput("--drop-missing serves skins of one plane.")
        skin = skin.masked(~recording.missing)
        typer.echo(
            f"left out {int(recording.missing.sum())} of {recording.missing.size} taxels with missing readings",
            err=True,
        )
    options: dict[str, Any] = {
        "method": method,
        "components": None if components is None else [c.strip() for c in components.split(",")],
    }
    count = len(recording.readings)
    if not -count <= frame < count:
        raise InvalidInput(f"frame {frame} is not among the {count} frames of {recording_file}.")
    # what is wrong with the last frame is said before the first is solved
    creeps = isinstance(skin.pad, Viscoelastic)
    Layout(skin.planes, skin.pad.elastic if isinstance(skin.pad, Viscoelastic) else skin.pad).checked(
        recording.readings
    )
    step = count if creeps else 64  # creep remembers, so its frames stay together
    with busy("preparing the skin"):
        first = skin.reconstruct(recording.readings[:1], time=recording.time[:1], **options)
    # the touches one by one, joined, and as they are written, each with its error bars
    require(
        (8 if first.errors is not None else 4) * count * first.values.nbytes,
        f"the touches of {count:,} frames",
        "Use palpate track --out, which writes each frame as it comes, or split the recording.",
    )
    # every frame is decided alone, so the first is done; only creep needs it again, with those that follow
    done = [] if count > 1 and creeps else [first]
    parts = done + [
        skin.reconstruct(recording.readings[i : i + step], time=recording.time[i : i + step], **options)
        for i in progress(range(len(done), count, step), "reconstructing")
    ]
    touch = replace(joined(parts), time=recording.time)
    figure = touch.plot(frame=frame) if plot is not None else None
    record = provenance(skin_file.read_text(encoding="utf-8"), str(recording_file))
    written(target, lambda name: write_touch(touch, name, provenance=record))
    if figure is not None and plot is not None:
        save_figure(figure, plot)
    both = set(touch.components) == set(touch.surface.components)
    friction = getattr(method, "friction", None)
    slip = abs(friction) if friction is not None and both else None
    typer.echo(f"frame {frame % count} of {count}")
    typer.echo(touch.summary(friction=slip, frame=frame))
    if touch.parameter is not None:
        typer.echo(f"parameter       {float(touch.parameter[frame]):.4g}")
    typer.echo(f"wrote           {target}" + (f", {plot}" if plot else ""))
