"""palpate ros: run as a node of ROS 2."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from palpate.cli.files import check_output, provenance, skin_files, skin_text
from palpate.cli.methods import TrackerCommand, tracker_options
from palpate.cli.options import zero_of_skin
from palpate.cli.pictures import skin_path
from palpate.cli.progress import busy
from palpate.errors import InvalidInput, Unsupported

_KEY = "palpate.ros"


class RosCommand(TrackerCommand):
    """A command that accepts ROS arguments: --ros-args ... up to -- or the end."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own: list[str] = []
        ros: list[str] = []
        inside = False
        for word in args:
            if word == "--ros-args":
                inside = True
            elif inside and word == "--":
                inside = False
            else:
                (ros if inside else own).append(word)
        ctx.meta[_KEY] = ros
        return super().parse_args(ctx, own)


def ros(
    ctx: typer.Context,
    skin_file: Annotated[
        Path,
        typer.Option(
            "--skin",
            help="skin.toml with the pad, its array, and a section [stream]; or [camera] for pictures of a gel with dots.",
        ),
    ],
    topic: Annotated[
        str | None, typer.Option(help="Topic of the readings or pictures, in place of that of [stream].")
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(
            "--type",
            help="Type of its messages, e.g. sensor_msgs/msg/Image; default: the type that its publishers state.",
        ),
    ] = None,
    baseline: Annotated[
        int,
        typer.Option(
            min=0,
            help="Number of frames at the start, without contact, whose mean is the zero. For pictures: number that show the gel at rest, in place of that in [camera].",
        ),
    ] = 0,
    max_pressure: Annotated[str | None, typer.Option(help='Event above this peak pressure, e.g. "40 kPa".')] = None,
    max_force: Annotated[str | None, typer.Option(help='Event above this normal force, e.g. "2 N".')] = None,
    budget: Annotated[
        float | None, typer.Option(help="Milliseconds a frame may take (default: 10; 20 for pictures).")
    ] = None,
    frame: Annotated[
        str, typer.Option(help="Frame of reference of the published messages; default: that of the received ones.")
    ] = "",
    record: Annotated[
        Path | None, typer.Option(help="Record from the start (.mcap, .nc, .h5, .zarr): readings, touches, events.")
    ] = None,
    page: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Show the live page on this port of this machine too.")
    ] = None,
) -> None:
    """Run as a node of ROS 2: readings, or pictures of a gel with dots, from a topic in; forces, traction, slip and events out.

    Publishes ~/wrench with its 95 % interval (~/wrench_low, ~/wrench_high), ~/center, ~/traction, ~/utilisation,
    ~/events and /diagnostics; takes ~/rezero. Arguments of ROS come last, e.g. --ros-args -r __ns:=/left -p friction:=0.6.
    """
    import os
    import tomllib

    from palpate.live.server import BUDGET as BUDGET_OF_PICTURES
    from palpate.live.session import recorded
    from palpate.recordings import TopicMapping, read_camera, read_stream, recorder
    from palpate.ros.client import message_class, ros_client
    from palpate.ros.node import BUDGET, Ros, TouchNode
    from palpate.ros.pictures import are_pictures
    from palpate.skin import Skin
    from palpate.units import parse_quantity

    ros_client()
    skin_file = skin_path(skin_file)
    camera = read_camera(skin_file)
    mapping = read_stream(skin_file)
    if topic is None and mapping is None:
        raise InvalidInput(
            f"{skin_file} does not say which topic its pictures come in: name it, e.g. --topic /gel/image_raw."
            if camera is not None
            else _no_stream(skin_file, "/finger")
        )
    name = topic if topic is not None else cast(TopicMapping, mapping).topic
    if budget is not None and not budget > 0:
        raise InvalidInput(f"--budget must be a positive number of milliseconds; got {budget:g}.")
    if kind is not None:
        message_class(kind)
    if record is not None:
        if os.path.lexists(record):
            raise InvalidInput(f"{record} exists; a recording is never overwritten. Give --record another name.")
        check_output(record, inputs=[*skin_files(skin_file)], force=False)
    options = tracker_options(ctx)
    connection = Ros(ctx.meta.get(_KEY, []))
    try:
        kind = kind or _kind(connection, name)
        skin: Any = skin_file
        read: TopicMapping | str = name
        rest, zero = None, None
        if camera is not None and are_pictures(kind):
            if "colour" in tomllib.loads(skin_text(skin_file)):
                raise Unsupported(
                    f"{skin_file} is of a gel that is read by its colours: a node needs a tracker, and there is none for colours, because each picture takes about a second. "
                    f"Record {name} (ros2 bag record -s mcap {name}), and give palpate track the recording."
                )
            typer.echo("waiting for pictures of the gel at rest, in which nothing touches it (Ctrl-C ends)", err=True)
        elif mapping is None:
            raise InvalidInput(
                f"{name} brings {kind}, and {skin_file} describes pictures: name a topic of sensor_msgs/msg/Image or CompressedImage."
                if camera is not None
                else _no_stream(skin_file, name)
            )
        else:
            read = replace(mapping, topic=name)
            skin, rest = _skin(connection, skin_file, read, kind)
            zero = zero_of_skin(skin, baseline)
        force = "force" if not isinstance(skin, Skin) or skin.surface.dimensions == 2 else "force per length"
        with busy("preparing the skin"):
            node = TouchNode(
                connection,
                skin,
                read,
                kind=kind,
                options=options,
                baseline=baseline,
                zero=zero,
                budget=1e-3 * budget
                if budget is not None
                else BUDGET
                if isinstance(skin, Skin)
                else BUDGET_OF_PICTURES,
                max_pressure=None
                if max_pressure is None
                else parse_quantity(max_pressure, "pressure", "--max-pressure"),
                max_force=None if max_force is None else parse_quantity(max_force, force, "--max-force"),
                rest=rest,
                frame=frame,
                pages=page is not None,
            )
        if record is not None:  # start the recording last, so that no file remains if another step fails
            node.session.add(recorder(record, **recorded(node.skin), meta=provenance(skin_text(skin_file), name)))
        for note in node.session.tracker.notes:
            typer.echo(f"note: {note}", err=True)
        own = connection.node.get_fully_qualified_name()
        typer.echo(
            f"{own}: {connection.node.resolve_topic_name(name)} ({kind}) to {own}/wrench and others    (Ctrl-C ends)"
        )
        _run(node, page)
        if node.session.lost:
            raise node.session.lost[0]
    finally:
        connection.close()


def _no_stream(skin_file: Path, topic: str) -> str:
    return (
        f"{skin_file} has no section [stream]: write one with the topic, where the taxels are in its messages, and the unit of their numbers, e.g. "
        f'[stream] topic = "{topic}", path = "data", unit = "Pa".'
    )


def _kind(connection: Any, topic: str) -> str:
    """Return the type of the topic, once it has a publisher."""
    found: str | None = connection.type_of(topic, wait=1.0)
    if found is None:
        full = connection.node.resolve_topic_name(topic)
        typer.echo(f"waiting for a publisher of {full} (Ctrl-C ends; --type spares the wait)", err=True)
        while found is None:
            found = connection.type_of(topic, wait=1.0)
    return found


def _skin(connection: Any, skin_file: Path, mapping: Any, kind: str) -> tuple[Any, Any]:
    """Return the skin, and the rest positions of its markers from the first message."""
    import numpy as np

    from palpate.recordings import Recording
    from palpate.skin import Skin

    if not mapping.markers:
        return Skin.from_file(skin_file), None
    message = connection.first(mapping.topic, kind, wait=1.0)
    if message is None:
        typer.echo("waiting for the first message: where the markers are at rest", err=True)
        while message is None:
            message = connection.first(mapping.topic, kind, wait=5.0)
    rest = mapping.readings(message)
    rest = rest[:, 0] if rest.ndim == 3 and rest.shape[1] == 1 else rest
    places = Recording(
        readings=np.zeros((1, *rest.shape), dtype=np.float32),
        channels=mapping.channels,
        time=np.zeros(1),
        positions=rest[:2].T,
    )
    return Skin.from_file(skin_file, recording=places), rest


def _run(node: Any, page: int | None) -> None:
    """Run until Ctrl-C, or until the stream fails."""
    import time

    try:
        if page is not None:
            from palpate.live import Live, address, serve

            view = Live(node.session)  # the live view starts and stops the session
            typer.echo(f"open {address(view, '127.0.0.1', page)}")
            serve(view, port=page)
            return
        node.start()
        while not node.session.ended:
            time.sleep(0.2)
        raise InvalidInput(f"the stream has ended: {node.session.failure or 'nothing more comes'}.")
    finally:
        node.close()
