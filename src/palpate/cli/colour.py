"""Gels that are read by colour, without dots: a calibration from presses of a ball, and touches from pictures."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from palpate._numbers import plain_number
from palpate.cli.files import check_outputs, provenance, rows_in_part_file, save_figure, skin_files, skin_text
from palpate.cli.options import check_picture
from palpate.cli.pictures import skin_path
from palpate.cli.progress import busy
from palpate.errors import InvalidInput
from palpate.units import parse_quantity

if TYPE_CHECKING:
    from palpate.inverse.method import Method

__all__ = ["calibrate_colours", "feel_pictures", "has_colours"]


def has_colours(source: Path, skin_file: Path) -> bool:
    """Return whether ``source`` consists of pictures and the skin.toml has a section [colour]."""
    import tomllib

    if source.suffix.lower() in (".nc", ".h5", ".npz", ".csv", ".zarr", ".mcap") or not skin_file.is_file():
        return False
    with contextlib.suppress(ValueError, InvalidInput):
        if "colour" in tomllib.loads(skin_text(skin_file)):
            from palpate.camera import is_pictures

            return source.exists() and is_pictures(source)
    return False


def calibrate_colours(
    presses: list[Path],
    skin_file: Path,
    *,
    out: Path,
    diameter: str,
    rest: Path | None,
    baseline: int | None,
    report: Path | None,
    force: bool,
) -> None:
    """Learn the slope that each colour means: `palpate calibrate PRESSES --ball-diameter "8 mm"`."""
    from palpate.camera import draw_colours, learn_slopes, write_slopes
    from palpate.recordings import read_camera

    skin_file = skin_path(skin_file)
    size = parse_quantity(diameter, "length", "--ball-diameter")
    numbers = out.with_name(f"{out.stem}.colour.npz")
    inputs = [*presses, *skin_files(skin_file), rest]
    check_outputs({"--out": out, "--report": report, "the file beside --out": numbers}, inputs=inputs, force=force)
    if report is not None:
        check_picture(report)
    settings = read_camera(skin_file)
    if settings is None:
        raise InvalidInput(
            f'{skin_file} has no section [camera]: the size of a pixel is unknown. Write one, with scale = "0.06 mm" (per pixel).'
        )
    source: Any = presses[0] if len(presses) == 1 else _images(presses)
    still = None if rest is None else _images([rest])[0]
    if baseline == 0:
        raise InvalidInput(
            "--baseline 0: the first picture shows the gel at rest, or --rest gives it. Leave it out, or give 1 or more."
        )
    with busy("learning colours"):
        model = learn_slopes(source, settings, ball_diameter=size, rest=still, baseline=baseline)
    typer.echo(f"ball            {1e3 * size:.4g} mm across, {len(model.table)} presses")
    for name, radius, gain, slope, depth in model.table:
        typer.echo(
            f"{name:15s} contact {2e3 * radius:.2f} mm across; cross-validation: its slopes are off by {100 * (gain - 1):+.0f} % together and {slope:.2g} each, depth by {1e6 * depth:.0f} um"
        )
    typer.echo(str(model))
    paths: tuple[Path, ...] = write_slopes(out, skin_file, model)
    if report is not None:
        save_figure(draw_colours(model), report)
        paths = (*paths, report)
    typer.echo(f"wrote           {', '.join(map(str, paths))}")


def _images(paths: list[Path]) -> list[Any]:
    """Return all pictures of several files, in order."""
    from palpate.camera import open_pictures

    found = []
    for path in paths:
        with open_pictures(path) as pictures:
            for picture in pictures:
                if picture.image is None:
                    raise InvalidInput(f"{path}: {picture.fault}. Take it out, or record it again.")
                found.append(picture.image)
    return found


def feel_pictures(
    source: Path,
    skin_file: Path,
    *,
    out: Path | None,
    baseline: int,
    every: int,
    rate: float | None,
    picture: Path | None,
    plot_forces: Path | None,
    method: Method | None,
    force: bool,
) -> None:
    """Compute touches from pictures of a gel read by colour: `palpate reconstruct PICTURE`, `palpate track VIDEO`."""
    from palpate._plot import plot_forces as drawn
    from palpate.camera import draw_relief, feel
    from palpate.recordings import write_touch
    from palpate.recordings.formats import file_format
    from palpate.touch import Forces, joined
    from palpate.touch.table import table_words

    kind = None if out is None else file_format(out, task="write_touch")
    inputs = [source, *skin_files(skin_file)]
    check_outputs({"--out": out, "--plot": picture, "--plot-forces": plot_forces}, inputs=inputs, force=force)
    for path in (picture, plot_forces):
        if path is not None:
            check_picture(path)
    options: dict[str, Any] = {} if method is None else {"method": method}
    record = provenance(skin_text(skin_file), str(source))
    forces, touches, strongest = Forces(), [], None
    with contextlib.ExitStack() as stack:
        stream = stack.enter_context(feel(source, skin_file, baseline=baseline, rate=rate, every=every, **options))
        keep = stack.enter_context(rows_in_part_file(forces, out if kind == "csv" else None))
        for touch in stream:
            forces.add(touch, [])
            touches.append(touch)
            load = float(np.nan_to_num(np.asarray(touch.force, dtype=np.float64))[-1])
            if stream.last is not None and stream.picture is not None and (strongest is None or load > strongest[0]):
                strongest = (load, stream.picture, stream.last, touch)
            keep()
        faults, notes = dict(stream.faults), list(stream.pictures.notes)
    if out is not None and kind != "csv":
        write_touch(joined(touches), out, provenance=record)
    if len(touches) > 1:
        typer.echo(table_words(forces.table()))
    if strongest is not None:
        _, shown, relief, touch = strongest
        typer.echo(
            f"picture {shown.index}: deepest {plain_number(1e6 * float(relief.depth.max()), 3)} um"
            + ("" if relief.touching else ", no contact")
        )
        typer.echo(touch.summary())
        if picture is not None and shown.image is not None:
            save_figure(draw_relief(shown.image, relief), picture)
    if plot_forces is not None:
        save_figure(drawn(forces.table()), plot_forces)
    for index, fault in faults.items():
        typer.echo(f"warning: picture {index}: {fault}", err=True)
    for note in notes:
        typer.echo(f"warning: {note}", err=True)
    for path in (out, picture if strongest is not None else None, plot_forces):
        if path is not None:
            typer.echo(f"wrote           {path}")
