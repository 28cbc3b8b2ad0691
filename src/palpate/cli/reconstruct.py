"""palpate reconstruct: pressure and shear from a recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.files import Force, check_outputs, provenance, save_figure, skin_files, skin_text
from palpate.cli.methods import chosen_method
from palpate.cli.options import Columns, check_matching, check_picture, mapping_for, zero_of_skin
from palpate.cli.progress import Frames
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from palpate.inverse.method import Method
    from palpate.recordings import Recording
    from palpate.recordings.opened import OpenRecording
    from palpate.skin import Skin


def reconstruct(
    ctx: typer.Context,
    recording_file: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="Recording (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag), a table of another program (--map), or pictures of a colour gel that was calibrated with a ball.",
        ),
    ],
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    columns: Columns = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Result to write: maps and numbers of every frame (.nc, .h5, .zarr, .npz, .mcap), or a table of forces with one row a frame (.csv). Default: RECORDING-touch.nc."
        ),
    ] = None,
    baseline: Annotated[
        int,
        typer.Option(
            min=0, help="Number of frames at the start, without contact, whose mean is the zero. Needed for raw counts."
        ),
    ] = 0,
    frame: Annotated[
        int | None, typer.Option(help="Solve this frame alone; 0 is the first, -1 the last. Default: all frames.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Picture to write (.png, .pdf or .svg) of pressure and shear in the frame with the largest traction, or in that of --frame."
        ),
    ] = None,
    plot_forces: Annotated[
        Path | None, typer.Option(help="Picture to write (.png, .pdf or .svg) of the forces over time.")
    ] = None,
    components: Annotated[
        str | None,
        typer.Option(help="Components to compute, e.g. z or x,z; default: those that the channels separate."),
    ] = None,
    drop_missing: Annotated[
        bool, typer.Option("--drop-missing", help="Leave out taxels with missing readings instead of refusing them.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes that share the work; default: one for each core if that is faster. The result is the same for any number.",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Where the work is done: processes, threads, or the address of a Dask scheduler (tcp://...); default: processes."
        ),
    ] = None,
    chunk: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Frames that are read, solved and written together; default: up to 256, depending on their size.",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an interrupted run into the same .zarr, or begin it.")
    ] = False,
    prepared: Annotated[
        Path | None,
        typer.Option(
            help="File of prepared arrays of this skin: read if it exists, otherwise written, so that the next run begins at once."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Recover pressure and shear from a recording of any length, each frame alone. Nothing to tune."""
    from palpate.cli.colour import feel_pictures, has_colours

    if has_colours(recording_file, skin_file):
        unused = {
            "--map": columns,
            "--frame": frame,
            "--components": components,
            "--workers": workers,
            "--scheduler": scheduler,
            "--chunk": chunk,
            "--prepared": prepared,
            "--drop-missing": drop_missing or None,
            "--resume": resume or None,
        }
        if given := [name for name, value in unused.items() if value is not None]:
            raise InvalidInput(
                f"{', '.join(given)} {'is' if len(given) == 1 else 'are'} for recordings: leave out for pictures."
            )
        feel_pictures(
            recording_file,
            skin_file,
            out=out if out is not None else recording_file.with_name(recording_file.stem + "-touch.nc"),
            baseline=baseline,
            every=1,
            rate=None,
            picture=plot,
            plot_forces=plot_forces,
            method=chosen_method(ctx),
            force=force,
        )
        return
    from palpate.archives import reconstruct_recording, worker_count
    from palpate.recordings import open_recording
    from palpate.recordings.formats import file_format
    from palpate.skin import Skin
    from palpate.touch.table import table_words

    target = out if out is not None else recording_file.with_name(recording_file.stem + "-touch.nc")
    file_format(target, task="write_touch")
    inputs = [recording_file, *skin_files(skin_file)]
    check_outputs(
        {"--out": target, "--plot": plot, "--plot-forces": plot_forces}, inputs=[*inputs, prepared], force=force
    )
    for picture in (plot, plot_forces):
        if picture is not None:
            check_picture(picture)
    if plot_forces is not None and frame is not None:
        raise InvalidInput(f"--plot-forces draws forces over time, and --frame {frame} is one frame: leave out either.")
    method = chosen_method(ctx)
    with (
        open_recording(recording_file, mapping=mapping_for(recording_file, skin_file, columns)) as recording,
        _explain_interruption(target),
    ):
        skin = Skin.from_file(skin_file, recording=recording.head)
        check_matching(recording.head, skin)
        if drop_missing:
            skin = _without_missing(skin, recording)
        names = None if components is None else [c.strip() for c in components.split(",")]
        if prepared is not None:
            _prepare(skin, prepared, method, names)
        zero = zero_of_skin(skin, baseline)
        frames = len(recording) if frame is None else 1
        if workers is None:
            elsewhere = scheduler is not None and "://" in scheduler
            workers = 1 if elsewhere else worker_count(skin, method, frames)
        hint = " (palpate track is much faster for such recordings)"
        with Frames("solving frames", frames, hint=hint) as bar:
            done = reconstruct_recording(
                skin,
                recording,
                target,
                method=method,
                components=names,
                workers=workers,
                scheduler=scheduler,
                chunk=chunk,
                resume=resume,
                overwrite=force,
                frame=frame,
                baseline=baseline,
                zero=zero,
                provenance=provenance(skin_text(skin_file), str(recording_file)),
                progress=lambda finished, _: bar(finished),
            )
        total = len(recording)
    touch, written = done.touch, [str(target)]
    if plot is not None:
        from palpate.pads import caption

        when = "" if touch.time is None else f", {float(touch.time):.3f} s"
        save_figure(
            touch.plot(
                title=f"frame {done.frame}{when}: {caption(skin)}", taxels=skin.planes if skin.surface.bends else ()
            ),
            plot,
        )
        written.append(str(plot))
    if plot_forces is not None:
        from palpate._plot import plot_forces as drawn

        save_figure(drawn(done.table), plot_forces)
        written.append(str(plot_forces))
    if done.frames > 1:
        typer.echo(table_words(done.table))
        typer.echo(f"largest traction: frame {done.frame} of {total}")
    else:
        typer.echo(f"frame {done.frame} of {total}")
    # the notes of all frames together state counts; do not repeat those of single frames
    said = touch.summary().splitlines()
    typer.echo("\n".join(line for line in said if done.frames == 1 or not line.startswith("note: ")))
    for note in done.notes if done.frames > 1 else ():
        typer.echo(f"note: {note}")
    if touch.parameter is not None:
        typer.echo(f"parameter       {float(touch.parameter):.4g}")
    if done.before:
        typer.echo(f"resumed         {done.before} frames were done before")
    for remark in done.remarks:
        typer.echo(f"warning: {remark}.", err=True)
    typer.echo(f"wrote           {', '.join(written)}")
    if target.suffix.lower() == ".csv" and frame is None:
        typer.echo("maps            are not in a .csv: --out touch.nc keeps them")


def _prepare(skin: Skin, file: Path, method: Method | None, components: list[str] | None) -> None:
    """Load the prepared method from an earlier run, or prepare and save it."""
    if file.exists():
        skin.load_prepared(file)
    else:
        skin.prepare(method=method, components=components)
        skin.save_prepared(file)


@contextmanager
def _explain_interruption(target: Path) -> Iterator[None]:
    """If a run is interrupted, say which files remain and how to resume."""
    from palpate.recordings.zarrstream import unfinished_path

    before = unfinished_path(target).exists()
    try:
        yield
    except BaseException as error:
        for said in getattr(error, "__notes__", ()):
            typer.echo(said, err=True)
        if unfinished_path(target).exists() and not before:
            typer.echo(f"{unfinished_path(target)} keeps the finished frames: --resume continues from there.", err=True)
        raise


def _without_missing(skin: Skin, recording: OpenRecording) -> Skin:
    """The skin without the taxels that have a missing reading in any frame."""
    import numpy as np

    missing = np.zeros(recording.head.readings.shape[2:], dtype=bool)

    def look(part: Recording) -> None:
        np.logical_or(missing, part.missing, out=missing)

    recording.survey(look)
    if not missing.any():
        return skin
    if missing.mean() > 0.5:
        raise InvalidInput(
            f"--drop-missing would leave out {int(missing.sum())} of {missing.size} taxels, because each lacks a reading in some frame. palpate track uses the readings that each frame has."
        )
    if len(skin.planes) != 1:
        raise InvalidInput(
            "--drop-missing works only for skins with one plane of taxels. Use palpate track, which uses the readings that each frame has."
        )
    typer.echo(f"left out {int(missing.sum())} of {missing.size} taxels with missing readings", err=True)
    return skin.masked(~missing)
