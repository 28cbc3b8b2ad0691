"""palpate live: show the contact in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.files import check_output, provenance, skin_files, skin_text
from palpate.cli.methods import tracker_options
from palpate.cli.options import Columns, check_matching, grasp_monitor, mapping_for, zero_of_skin
from palpate.cli.progress import busy
from palpate.errors import InvalidInput


def live(
    ctx: typer.Context,
    recording_file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[RECORDING]",
            help="Recording to replay (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag), or a table of another program (--map).",
        ),
    ] = None,
    skin_file: Annotated[Path | None, typer.Option("--skin", help="skin.toml with the pad and its array.")] = None,
    columns: Columns = None,
    udp: Annotated[int | None, typer.Option(min=1, max=65535, help="Listen for frames on this UDP port.")] = None,
    tcp: Annotated[int | None, typer.Option(min=1, max=65535, help="Listen for frames on this TCP port.")] = None,
    ws: Annotated[int | None, typer.Option(min=1, max=65535, help="Take frames by WebSocket on this port.")] = None,
    zenoh: Annotated[
        str | None,
        typer.Option(
            metavar="KEY",
            help="Take frames from KEY/readings by zenoh, and publish touches on KEY/touch. On this machine (tcp/127.0.0.1:7447) unless ZENOH_CONFIG names a configuration.",
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            help="Watch a gel with dots: the number of a camera (0), /dev/video0, or a video, which is played at its rate. "
            "Nothing may touch the gel in the first pictures."
        ),
    ] = None,
    demo: Annotated[
        bool, typer.Option("--demo", help="Show a simulated finger, without any other option or file.")
    ] = False,
    baseline: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Number of frames at the start, without contact, whose mean is the zero (default 0; 20 with --demo).",
        ),
    ] = None,
    max_pressure: Annotated[str | None, typer.Option(help='Alarm above this peak pressure, e.g. "40 kPa".')] = None,
    max_force: Annotated[str | None, typer.Option(help='Alarm above this normal force, e.g. "2 N".')] = None,
    speed: Annotated[float, typer.Option(help="Speed of the replay; 2 is twice as fast.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    record: Annotated[
        Path | None, typer.Option(help="Record from the start (.mcap, .nc, .h5, .zarr): readings, touches, events.")
    ] = None,
    foxglove: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Serve Foxglove on this port too (ws://127.0.0.1:PORT).")
    ] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Show it in Rerun's viewer too.")] = False,
    record_to: Annotated[Path | None, typer.Option(help="Folder for recordings started from the page.")] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; addresses other than this machine need a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port.")] = 8765,
    token: Annotated[
        str | None,
        typer.Option(help='Token that opens the page; default: a random one. "" for none, on this machine only.'),
    ] = None,
) -> None:
    """Show in a browser what touches the pad, live."""
    import os
    from collections.abc import Iterator

    import numpy as np

    from palpate.live import FoxgloveServer, Live, RerunSink, Session, address, publish_touches, serve
    from palpate.live.server import BUDGET, LOCAL
    from palpate.live.session import recorded
    from palpate.recordings import Sink, recorder
    from palpate.skin import Skin

    listening = {k: v for k, v in (("udp", udp), ("tcp", tcp), ("ws", ws)) if v is not None}
    if sum((demo, recording_file is not None, camera is not None, zenoh is not None, len(listening))) != 1:
        raise InvalidInput("give either a RECORDING, --camera, --udp, --tcp, --ws or --zenoh with a --skin, or --demo.")
    if (skin_file is None) != demo:
        raise InvalidInput(
            "--demo has its own skin: leave out --skin." if demo else "the live view needs a skin: --skin skin.toml."
        )
    if not (np.isfinite(speed) and speed > 0):
        raise InvalidInput(f"--speed must be a positive number; got {speed:g}.")
    if recording_file is None and speed != 1.0:
        raise InvalidInput("--speed is for replaying a RECORDING; a live sensor has its own pace: leave out --speed.")
    if recording_file is None and columns is not None:
        raise InvalidInput("--map describes a RECORDING that is a table: leave it out.")
    if (listening or zenoh is not None or camera is not None) and loop:
        raise InvalidInput("--loop repeats a RECORDING, not frames from the network or a camera: leave out --loop.")
    if record_to is not None and not record_to.is_dir():
        raise InvalidInput(f"--record-to {record_to}: no such folder.")
    if record is not None:
        if os.path.lexists(record):
            raise InvalidInput(f"{record} exists; a recording is never overwritten. Give --record another name.")
        watched = None if camera is None else Path(camera)
        check_output(record, inputs=[recording_file, watched, *skin_files(skin_file)], force=False)
    if host not in LOCAL and token == "":
        raise InvalidInput(
            f"--host {host} opens the page to other machines, which requires a token: leave --token out to get a random one."
        )
    options = tracker_options(ctx)
    pace, end, seen, connection = True, None, None, None
    if camera is not None and skin_file is not None:
        from palpate.cli.pictures import skin_path
        from palpate.live.camera import CameraSource

        skin_file = skin_path(skin_file)
        with busy("looking for the dots, and preparing the skin"):
            seen = CameraSource(camera, skin_file, reference=baseline or None, options={**options, "budget": BUDGET})
        skin, name, pace, end = seen.touches.skin, seen.name, False, seen.close
        source: Any = seen
    elif demo:
        from palpate.simulation import DEMONSTRATED, demonstration

        skin, frames = demonstration()
        options = {"friction": DEMONSTRATED, **options}
        baseline = 20 if baseline is None else baseline
        loop, name = True, "simulated finger"

        source = frames
    elif recording_file is None:
        from palpate.network import FrameListener, ZenohListener, zenoh_key, zenoh_session
        from palpate.network.waiting import FrameSource

        skin = Skin.from_file(skin_file)  # type: ignore[arg-type]
        shapes = {p.shape for p in skin.planes}
        if len(shapes) != 1:
            raise InvalidInput("frames from the network hold planes of one shape; this skin has several.")
        shape = (sum(len(p.channels) for p in skin.planes), *shapes.pop())
        listener: FrameSource
        if zenoh is not None:
            zenoh_key(zenoh)
            connection = zenoh_session()
            listener, name = ZenohListener(connection, shape, key=f"{zenoh}/readings"), f"zenoh {zenoh}"
        else:
            kind, where = listening.popitem()
            wired = FrameListener(shape, kind=kind, port=where, host=host)
            listener, name = wired, f"{kind} port {wired.port}"
        pace, end = False, listener.close

        def source() -> FrameSource:
            return listener
    else:
        from palpate.recordings import read_recording

        recording = read_recording(recording_file, mapping=mapping_for(recording_file, skin_file, columns))
        skin = Skin.from_file(skin_file, recording=recording)  # type: ignore[arg-type]
        check_matching(recording, skin)
        name = str(recording_file)

        def source() -> Iterator[tuple[float, Any]]:
            yield from zip(recording.time.tolist(), recording.readings)

    monitor = grasp_monitor(skin, options.get("friction"), max_pressure, max_force)
    if seen is not None and seen.touches.tracker is not None:
        tracker = seen.touches.tracker
    else:
        with busy("preparing the skin"):
            zero = zero_of_skin(skin, baseline or 0)
            tracker = skin.track(**options, baseline=baseline or 0, zero=zero, budget=BUDGET)
    sinks: list[Sink] = []
    if foxglove is not None:
        sinks.append(FoxgloveServer(recorded(skin)["channels"], port=foxglove))
        typer.echo(f"Foxglove: open a connection to ws://127.0.0.1:{foxglove}")
    if rerun:
        sinks.append(RerunSink())
    if record is not None:  # start the recording last, so that no file remains if another step fails
        sinks.append(recorder(record, **recorded(skin), meta=provenance(skin_text(skin_file), name)))
    session = Session(
        skin,
        source,
        tracker,
        monitor,
        name=name,
        pace=pace,
        loop=loop,
        speed=speed,
        end=end,
        sinks=sinks,
        report=lambda words: typer.echo(f"warning: {words}", err=True),
        step=None if seen is None else seen.step,
    )
    if seen is not None:
        seen.report, seen.skip = session.note, session.skip
    if connection is not None:
        publish_touches(session, connection, key=f"{zenoh}/touch")
    view = Live(session, token=token, folder=record_to)
    typer.echo(f"open {address(view, host, port)}    (Ctrl-C ends)")
    try:
        serve(view, host=host, port=port)
    finally:
        if connection is not None:
            connection.close()
    if session.lost:
        raise session.lost[0]
