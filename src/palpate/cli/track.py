"""palpate track: follow a recording frame by frame."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate._numbers import plain_time
from palpate.cli.files import (
    Force,
    check_outputs,
    finish_stream,
    provenance,
    rows_in_part_file,
    skin_files,
    skin_text,
    write_frame,
)
from palpate.cli.methods import tracker_options
from palpate.cli.options import Columns, check_matching, check_picture, grasp_monitor, mapping_for, zero_of_skin
from palpate.cli.progress import Bar, busy
from palpate.errors import InvalidInput

#: File formats of robots, for readings or pictures.
ROBOTS = (".mcap", ".bag")


def track(
    ctx: typer.Context,
    recording_file: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="Recording (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag), a table of another program (--map), or pictures of a gel with dots: a video, a folder, a .tif stack, a topic of images in an .mcap or bag.",
        ),
    ],
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    columns: Columns = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Readings, touches and events to write, frame by frame (.mcap, .nc, .h5, .zarr), the touches alone (.npz), or a table of forces and events with one row a frame (.csv)."
        ),
    ] = None,
    baseline: Annotated[
        int,
        typer.Option(
            min=0,
            help="Number of frames at the start, without contact, whose mean is the zero. For pictures: that of the skin.toml, otherwise 5.",
        ),
    ] = 0,
    zero_at: Annotated[
        list[float] | None,
        typer.Option(
            help="Time in the recording [s] from which a new zero is taken, from ten frames: nothing may touch then. May be given again."
        ),
    ] = None,
    plot_forces: Annotated[
        Path | None, typer.Option(help="Picture to write (.png, .pdf or .svg) of the forces and events over time.")
    ] = None,
    budget: Annotated[float | None, typer.Option(help="Milliseconds a frame may take.")] = None,
    max_pressure: Annotated[str | None, typer.Option(help='Alarm above this peak pressure, e.g. "40 kPa".')] = None,
    max_force: Annotated[str | None, typer.Option(help='Alarm above this normal force, e.g. "2 N".')] = None,
    every: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="For pictures: solve one picture in this many, each independently (seconds each).",
        ),
    ] = None,
    fast: Annotated[
        bool,
        typer.Option(
            "--fast",
            help="For pictures: process every picture with a tracker, as fast as a camera takes them. Shear is as accurate; the normal force may be wrong by a third.",
        ),
    ] = False,
    rate: Annotated[float | None, typer.Option(help="Pictures a second, for a folder or stack without times.")] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the strongest frame over its picture (.png, .pdf, .svg).")
    ] = None,
    force: Force = False,
) -> None:
    """Follow a recording frame by frame: contact, slip before it happens, excess, failing taxels."""
    import contextlib

    import numpy as np

    from palpate.recordings import read_recording, recorder
    from palpate.recordings.files import in_place
    from palpate.recordings.formats import endings, file_format
    from palpate.sensing.zero import OFFSETS, Levels
    from palpate.skin import Skin
    from palpate.touch import Forces

    if force and out is None and picture is None and plot_forces is None:
        raise InvalidInput("--force replaces a result: give --out too, or leave it out.")
    if not recording_file.exists():
        raise InvalidInput(f"{recording_file}: no such file.")
    ending = recording_file.suffix.lower()
    if recording_file.is_dir() or ending in ROBOTS or ending not in (*endings("read"), ".db3"):
        from palpate.camera import is_pictures
        from palpate.cli.colour import feel_pictures, has_colours
        from palpate.cli.pictures import track_pictures

        if has_colours(recording_file, skin_file):
            unused: dict[str, Any] = {
                "--budget": budget,
                "--zero-at": zero_at or None,
                "--map": columns,
                "--max-pressure": max_pressure,
            }
            unused |= {
                "--max-force": max_force,
                "--fast": fast or None,
                "a tracker's options": tracker_options(ctx) or None,
            }
            if given := [name for name, value in unused.items() if value is not None]:
                raise InvalidInput(
                    f"{', '.join(given)} cannot be used with a gel that is read by its colours: leave out."
                )
            feel_pictures(
                recording_file,
                skin_file,
                out=out,
                baseline=baseline,
                every=every or 1,
                rate=rate,
                picture=picture,
                plot_forces=plot_forces,
                method=None,
                force=force,
            )
            return
        if is_pictures(recording_file):
            if budget is not None or zero_at or columns is not None:
                raise InvalidInput("--budget, --zero-at and --map are for recordings: leave them out for pictures.")
            track_pictures(
                recording_file,
                skin_file,
                out=out,
                baseline=baseline,
                every=every,
                fast=fast,
                rate=rate,
                picture=picture,
                plot_forces=plot_forces,
                options=tracker_options(ctx),
                limits=(max_pressure, max_force),
                force=force,
            )
            return
    if every is not None or rate is not None or picture is not None or fast:
        raise InvalidInput(
            f"--every, --fast, --rate and --picture are for pictures (a video, a folder, a .tif stack); {recording_file} is a recording."
        )
    kind = None if out is None else file_format(out, task="write_touch")
    if plot_forces is not None:
        check_picture(plot_forces)
    inputs = [recording_file, *skin_files(skin_file)]
    check_outputs({"--out": out, "--plot-forces": plot_forces}, inputs=inputs, force=force)
    options = tracker_options(ctx)
    recording = read_recording(recording_file, mapping=mapping_for(recording_file, skin_file, columns))
    skin = Skin.from_file(skin_file, recording=recording)
    check_matching(recording, skin)
    if not baseline < len(recording.readings):
        raise InvalidInput(
            f"--baseline {baseline} leaves no frame of the {len(recording.readings)} in the recording: give a smaller number."
        )
    zeros = _zeros(zero_at or [], recording.time)
    monitor = grasp_monitor(
        skin, options.get("friction"), max_pressure, max_force, lambda event: typer.echo(str(event))
    )
    touches, seconds, marks = [], [], []
    forces, levels = Forces(), Levels()
    levels.look(recording.readings)
    zero = zero_of_skin(skin, baseline)
    if zero is None and not baseline and levels.standing():
        typer.echo(f"warning: {OFFSETS}.", err=True)
    with busy("preparing the skin"):
        tracker = skin.track(**options, baseline=baseline, zero=zero, budget=None if budget is None else 1e-3 * budget)
    record = provenance(skin_text(skin_file), str(recording_file))
    with contextlib.ExitStack() as stack:
        stack.enter_context(tracker)
        sink = None
        if out is not None and kind in ("mcap", "netcdf", "zarr"):
            # if a result exists, write beside it and replace it at the end; otherwise write to the final name, block by block
            name = stack.enter_context(in_place(out)) if out.exists() else out
            sink = stack.enter_context(recorder(name, recording.channels, positions=recording.positions, meta=record))
        keep = stack.enter_context(rows_in_part_file(forces, out if kind == "csv" else None))
        step = stack.enter_context(Bar("frames", len(recording.readings)))
        for time, values in zip(recording.time, recording.readings):
            if zeros and time >= zeros[0]:
                tracker.rezero()
                typer.echo(f"{zeros.pop(0):.3f} s  a new zero is taken from the next frames")
            touch = tracker.step(values, float(time))
            seconds.append(tracker.seconds)
            events = monitor.update(touch) if "z" in touch.components else []
            marks += events
            forces.add(touch, events)
            keep()
            step()
            if sink is not None:
                write_frame(sink, float(time), values, touch, events)
            elif kind not in (None, "csv"):
                touches.append(touch)
    finish_stream(touches, forces, marks, out=out, plot_forces=plot_forces, record=record)
    typer.echo(str(tracker.health))
    ms = 1e3 * np.array(seconds)
    typer.echo(f"a frame took    {np.median(ms):.2f} ms (median), {np.percentile(ms, 99):.2f} ms (99 %)")
    for path in (out, plot_forces):
        if path is not None:
            typer.echo(f"wrote           {path}")


def _zeros(wanted: list[float], time: Any) -> list[float]:
    """Return the times of new zeros in order. Raise an error if one lies outside the recording."""
    first, last = float(time[0]), float(time[-1])
    for at in wanted:
        if not first <= at <= last:
            raise InvalidInput(
                f"--zero-at {plain_time(at)} is not in the recording, which goes from {plain_time(first)} to {plain_time(last)} s."
            )
    return sorted(wanted)
