"""palpate calibrate: force in newtons from labelled presses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.files import Force, check_outputs, skin_files
from palpate.cli.options import Columns, check_matching, check_picture, mapping_for
from palpate.cli.progress import busy
from palpate.errors import InvalidInput


def calibrate(
    presses: Annotated[
        list[Path],
        typer.Argument(
            metavar="PRESSES...",
            help="Recordings (.nc, .npz, .csv, .mcap and so on), or tables of others (--map); each is a run. With --ball-diameter: pictures of a colour gel, a folder or a video.",
        ),
    ],
    skin_file: Annotated[
        Path, typer.Option("--skin", help="skin.toml; its numbers may be guesses. With --again a calibrated one.")
    ],
    out: Annotated[
        Path, typer.Option(help="Calibrated skin.toml to write; NAME.calibration.npz goes beside it.")
    ] = Path("calibrated.toml"),
    reference: Annotated[
        str | None,
        typer.Option(
            help='Columns of the force sensor [N] and of the place [m], e.g. "fz=Fz,fx=Fx" or "fz=-0.00981*grams,x=0.001*X": a factor turns them into newtons and metres.'
        ),
    ] = None,
    reference_file: Annotated[
        Path | None,
        typer.Option(
            help='Table with those columns on a clock of its own, "time=..." among them; the delay between the clocks is estimated. Default: the columns are in PRESSES.'
        ),
    ] = None,
    weight: Annotated[
        list[str] | None,
        typer.Option(
            help='Weight on the pad and its times, e.g. "200 g, 12 s to 20 s"; "0 g, ..." for none. May be given again.'
        ),
    ] = None,
    columns: Columns = None,
    baseline: Annotated[
        int | None,
        typer.Option(min=0, help="Frames at the start at which nothing touches. Default: those with no force."),
    ] = None,
    labels: Annotated[int, typer.Option(min=1, max=500, help="Largest number of frames to use.")] = 300,
    again: Annotated[
        bool, typer.Option("--again", help="Start from the calibration in --skin, and say whether the sensor has aged.")
    ] = False,
    this_run: Annotated[
        bool,
        typer.Option(
            "--this-run",
            help="Correct the calibration in --skin for the run that these presses belong to: one weight determines most of its gain. For another day, start from the calibration again.",
        ),
    ] = False,
    constants: Annotated[
        str | None,
        typer.Option(
            help='Constants of the pad to find from balls pressed straight in, such as "youngs_modulus,depth"; with their radii [m], if known: --reference "fz=Fz,ball_radius=R".'
        ),
    ] = None,
    pad_models: Annotated[
        str | None,
        typer.Option(help='With --constants: pad models to compare, such as "half-space,bonded,stack,soft base".'),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Picture to write (.png, .pdf or .svg): force found against known force, and the readings that determine it."
        ),
    ] = None,
    ball_diameter: Annotated[
        str | None,
        typer.Option(
            help='For a colour gel without dots: diameter of the ball that was pressed into it, e.g. "8 mm". The first picture shows the gel at rest.'
        ),
    ] = None,
    rest: Annotated[
        Path | None,
        typer.Option(help="Picture of the gel at rest, if PRESSES do not begin with it (--ball-diameter)."),
    ] = None,
    force: Force = False,
) -> None:
    """Learn the net force of a sensor from a few weights or a force sensor. With few labels the result follows the elastic model, with many labels a regression."""
    from palpate.calibrate import write_calibrated
    from palpate.camera import is_pictures
    from palpate.recordings import read_recording
    from palpate.skin import Skin

    if ball_diameter is not None:
        from palpate.cli.colour import calibrate_colours

        if (
            reference is not None
            or reference_file is not None
            or weight
            or columns is not None
            or again
            or this_run
            or constants
            or pad_models
        ):
            raise InvalidInput(
                "--ball-diameter learns what colours mean, from the ball alone: leave out --reference, --reference-file, --weight, --map, --again, --this-run, --constants and --pad-models."
            )
        calibrate_colours(
            presses,
            skin_file,
            out=out,
            diameter=ball_diameter,
            rest=rest,
            baseline=baseline,
            report=report,
            force=force,
        )
        return
    if rest is not None:
        raise InvalidInput('--rest belongs to --ball-diameter "8 mm", for pictures of a colour gel: leave it out.')
    if reference is None and not weight:
        raise InvalidInput(
            'say what is known: --reference "fz=Fz" (a force sensor), or --weight "200 g, 12 s to 20 s"; of a colour gel without dots --ball-diameter "8 mm".'
        )
    if reference_file is not None and reference is None:
        raise InvalidInput('--reference-file needs --reference, such as "time=t,fz=Fz".')
    if weight and len(presses) > 1:
        raise InvalidInput(
            "the times in --weight belong to the clock of one recording: give one recording, and add each other one in a later run with --again."
        )
    numbers = out.with_name(f"{out.stem}.calibration.npz")
    inputs = [*presses, *skin_files(skin_file), reference_file]
    check_outputs({"--out": out, "--report": report, "the file beside --out": numbers}, inputs=inputs, force=force)
    if report is not None:
        check_picture(report)
    for press in presses:
        if not press.exists():
            raise InvalidInput(f"{press}: no such file. Give the path of a recording that exists.")
        if is_pictures(press):
            raise InvalidInput(
                f'{press}: calibrate takes recordings and tables, not pictures of dots. For a gel without dots give --ball-diameter "8 mm"; for one with dots use palpate weigh {press} --skin {skin_file} --force "2 N", which finds the modulus.'
            )
    recordings = [read_recording(press, mapping=mapping_for(press, skin_file, columns)) for press in presses]
    skin = Skin.from_file(skin_file, recording=recordings[0])
    if (again or this_run) and skin.calibration is None:
        option = "--again" if again else "--this-run"
        raise InvalidInput(f"{option} starts from a calibration, and {skin_file} has none: leave it out.")
    for recording in recordings:
        check_matching(recording, skin)
    options: dict[str, Any] = {"baseline": baseline, "labels": labels, "weights": weight or (), "again": again}
    options["this_run"] = this_run
    options["constants"] = [c.strip() for c in (constants or "").split(",") if c.strip()]
    options["pad_models"] = None if pad_models is None else [m.strip() for m in pad_models.split(",") if m.strip()]
    if reference is not None:
        wanted = _wanted(reference)
        tables = [_read(p, wanted) for p in ([reference_file] if reference_file is not None else presses)]
        if reference_file is not None:
            if len(recordings) > 1:
                raise InvalidInput(
                    "--reference-file is on the clock of one recording: give one, and add others with --again."
                )
            if "time" not in wanted:
                raise InvalidInput(f'--reference must name the times of {reference_file}, such as "time=t,fz=Fz".')
            options["reference_time"] = tables[0].pop("time")
        options["reference"] = tables[0] if len(tables) == 1 else tables
    with busy("calibrating"):
        found = skin.calibrate(recordings if len(recordings) > 1 else recordings[0], **options)
    calibration = found.calibration
    if calibration is None:  # for the type checker: Skin.calibrate always sets it
        raise InvalidInput("nothing was calibrated.")
    typer.echo(str(calibration))
    paths: tuple[Path, ...] = write_calibrated(out, skin_file, calibration)
    if report is not None:
        from palpate.calibrate.report import draw_report
        from palpate.cli.files import save_figure

        save_figure(draw_report(calibration), report)
        paths = (*paths, report)
    typer.echo(f"wrote           {', '.join(map(str, paths))}")


def _wanted(text: str) -> dict[str, tuple[str, float]]:
    """Parse "fz=-0.00981*grams" to {"fz": ("grams", -0.00981)}."""
    out = {}
    for part in text.split(","):
        key, sign, column = part.partition("=")
        name, factor = column.strip(), 1.0
        if "*" in name:
            number, _, name = name.partition("*")
            try:
                factor = float(number)
            except ValueError as error:
                raise InvalidInput(
                    f'--reference: {number.strip()!r} is not a number; write it as in "fz=-0.00981*grams".'
                ) from error
        elif name.startswith("-"):
            factor, name = -1.0, name[1:]
        if (
            not sign
            or key.strip().lower() not in ("fx", "fy", "fz", "x", "y", "ball_radius", "time")
            or not name.strip()
        ):
            raise InvalidInput(
                f'--reference must name columns such as "fz=Fz,fx=Fx" (fx, fy, fz, x, y, ball_radius, time); got {part.strip()!r}.'
            )
        out[key.strip().lower()] = (name.strip(), factor)
    return out


def _read(path: Path, wanted: dict[str, tuple[str, float]]) -> dict[str, Any]:
    """Return the columns of a table, multiplied by their factors."""
    from palpate.recordings.formats import endings
    from palpate.recordings.tabletext import Titles, read_table_text

    if not path.is_file() or path.suffix.lower() not in endings("read_mapped"):
        raise InvalidInput(f"{path}: --reference takes the columns of a table; give one with --reference-file.")

    def places(titles: Titles) -> list[int]:
        found = []
        for name, _ in wanted.values():
            if name not in titles.names:
                raise InvalidInput(
                    f"{path}: no column {name!r}. There are {titles.listed()}. Name one of these in --reference."
                )
            found.append(titles.names.index(name))
        return found

    values = read_table_text(path, places).values
    return {key: factor * values[:, i] for i, (key, (_, factor)) in enumerate(wanted.items())}
