"""palpate identify: find the object that presses, from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import Columns, check_matching, mapping_for
from palpate.cli.progress import busy
from palpate.errors import InvalidInput

#: Number of frames from which on the run takes minutes.
LONG_RUN_FRAMES = 40


def identify(
    recording_file: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="Recording (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag), or a table of another program (--map).",
        ),
    ],
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    columns: Columns = None,
    baseline: Annotated[
        int,
        typer.Option(
            min=0, help="Number of frames at the start, without contact, whose mean is the zero. Needed for raw counts."
        ),
    ] = 0,
    frame: Annotated[
        list[int] | None,
        typer.Option(
            help="Frame to look at; 0 is the first. May be given again: several frames of one press determine more. Default: the one with the largest readings."
        ),
    ] = None,
    indentation: Annotated[
        list[str] | None,
        typer.Option(
            help='How far the object has moved into the pad, e.g. "1.2 mm": once for each frame. It determines the modulus of the object.'
        ),
    ] = None,
    shape: Annotated[str | None, typer.Option(help="ball or flat, if known.")] = None,
) -> None:
    """Identify what presses: patches, radius of a ball or flat, modulus, stiffness, texture; or why not."""
    import numpy as np

    from palpate.recordings import read_recording
    from palpate.sensing.zero import Rest, rest_frames
    from palpate.skin import Skin
    from palpate.units import parse_quantity

    recording = read_recording(recording_file, mapping=mapping_for(recording_file, skin_file, columns))
    skin = Skin.from_file(skin_file, recording=recording)
    check_matching(recording, skin)
    readings = np.asarray(recording.readings, dtype=np.float64)
    if baseline:
        if baseline >= len(readings):
            raise InvalidInput(f"--baseline {baseline} leaves no frame of the {len(readings)}: give fewer.")
        rest = Rest.of(rest_frames(readings[:baseline], skin.planes))
        skin, readings = skin.at_rest(rest), readings - rest.zero
    if frame is None:
        size = np.nanmax(np.abs(readings), axis=tuple(range(1, readings.ndim)))
        frame = [int(np.nanargmax(size))]
    if len(frame) > LONG_RUN_FRAMES:
        raise InvalidInput(f"--frame is given {len(frame)} times: at most {LONG_RUN_FRAMES}, since each takes seconds.")
    outside = [f for f in frame if not -len(readings) <= f < len(readings)]
    if outside:
        raise InvalidInput(f"--frame {outside[0]}: the recording has the frames 0 to {len(readings) - 1}.")
    depths = None
    if indentation is not None:
        depths = np.array([parse_quantity(text, "length", "indentation") for text in indentation])
        if len(depths) != len(frame):
            raise InvalidInput(
                f"--indentation is given {len(depths)} times for {len(frame)} frame{'s' if len(frame) > 1 else ''}: once for each --frame."
            )
    chosen = readings[frame]
    with busy("solving"):
        touch = skin.reconstruct(chosen)
        if len(frame) == 1:
            found = skin.identify(chosen[0], touch[0], indentation=None if depths is None else depths[0], shape=shape)
        else:
            found = skin.identify(chosen, touch, indentation=depths, shape=shape)
    typer.echo(f"frame{'s' if len(frame) > 1 else ''}           {', '.join(map(str, frame))} of {len(readings)}"[:79])
    typer.echo(str(found))
