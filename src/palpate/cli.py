"""The command line. A thin shell: it reads, calls the library, and writes."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import palpate
from palpate.errors import InvalidInput, PalpateError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from palpate.grasp import GraspMonitor
    from palpate.skin import Skin

__all__ = ["app", "main"]

app = typer.Typer(
    name="palpate",
    help="What touches an elastic pad: surface pressure and shear from stress, strain or displacement measured inside it.",
    epilog="Start with: palpate demo. Then: palpate reconstruct RECORDING --skin skin.toml.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


class Contact(StrEnum):
    """Contacts that simulate can press."""

    hertz = "hertz"
    punch = "punch"
    patch = "patch"


def _version(value: bool) -> None:
    if value:
        typer.echo(f"palpate {palpate.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


_DEMO_SKIN = """\
# A soft pad with a 32 x 32 array of three-axis stress taxels, as written by palpate demo.
[pad]
kind = "half_space"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [32, 32]
pitch = "1 mm"
depth = "2 mm"
channels = ["stress_xz", "stress_yz", "stress_zz"]
aperture = "0.8 mm"
noise = "50 Pa"
"""


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the picture, the skin, the recording and the result.")] = Path(
        "palpate-demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
) -> None:
    """Press and drag a ball on a simulated sensor, and recover what touched it. Needs no other file."""
    import numpy as np

    from palpate import solutions
    from palpate.recordings import Recording, write_recording, write_touch
    from palpate.skin import Skin
    from palpate.touch import Touch

    folder = _folder(out)
    skin_path = folder / "skin.toml"
    _write_text(skin_path, _DEMO_SKIN)
    skin = Skin.from_file(skin_path)
    friction = 0.6
    ball = solutions.hertz_point(radius=5e-3, force=1.0).shifted(2e-3, -1e-3)
    contact = ball.sliding(0.35, direction=0.5)
    truth = skin.sample(contact)
    readings = skin.sense(truth, rng=np.random.default_rng(seed))
    names = skin.planes[0].channels
    recording = Recording(
        readings=readings[None], channels=tuple(names), meta={"made by": f"palpate demo --seed {seed}"}
    )
    write_recording(recording, folder / "recording.nc")
    touch = skin.reconstruct(readings, friction=friction)
    write_touch(touch, folder / "touch.nc", provenance=_provenance(_DEMO_SKIN))
    figure = touch.plot(
        truth=truth, title="A ball pressed and dragged: recovered from noisy stress 2 mm below the surface"
    )
    _save(figure, folder / "touch.png")
    known = Touch(truth, skin.surface, skin.surface.components, "known")
    typer.echo("A ball presses with 1 N and drags with 0.35 N; 3 x 1024 readings, 2 mm below the surface, noise 50 Pa.")
    for name, one in (("recovered", touch), ("true", known)):
        typer.echo(f"{name}:")
        typer.echo("\n".join(f"  {line}" for line in one.summary(friction=friction).splitlines()))
    typer.echo(f"picture         {folder / 'touch.png'}")
    typer.echo(f"try next        palpate reconstruct {folder / 'recording.nc'} --skin {skin_path}")


@app.command()
def simulate(
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    out: Annotated[Path, typer.Option(help="Recording to write (.nc, .h5, .npz or .csv).")],
    contact: Annotated[Contact, typer.Option(help="What presses.")] = Contact.hertz,
    force: Annotated[str, typer.Option(help='Normal force, e.g. "1 N" (area) or "200 N/m" (line).')] = "1 N",
    size: Annotated[str, typer.Option(help="Contact radius or half-width.")] = "4 mm",
    x: Annotated[str, typer.Option(help="Middle of the contact along x.")] = "0 mm",
    y: Annotated[str, typer.Option(help="Middle of the contact along y (area only).")] = "0 mm",
    friction: Annotated[float, typer.Option(help="Coefficient of friction; 0 is frictionless.")] = 0.0,
    drag: Annotated[float, typer.Option(help="Tangential force as a part of friction * force; 1 slides.")] = 1.0,
    direction: Annotated[float, typer.Option(help="Direction of the drag [degrees from +x] (area only).")] = 0.0,
    frames: Annotated[int, typer.Option(help="Frames; the force grows evenly over them.")] = 1,
    rate: Annotated[float, typer.Option(help="Frames per second.")] = 100.0,
    seed: Annotated[int, typer.Option(help="Seed of the noise; none is added where the skin names no noise.")] = 0,
) -> None:
    """Make a recording of a known contact on a skin."""
    import numpy as np

    from palpate.elastic import Viscoelastic
    from palpate.recordings import Recording, write_recording
    from palpate.recordings.formats import file_format
    from palpate.skin import Skin

    file_format(out)
    skin = Skin.from_file(skin_file)
    if len({p.shape for p in skin.planes}) != 1:
        raise InvalidInput("simulate writes one recording: the skin's planes must have one shape.")
    if frames < 1 or not 0 < rate < 1e9:
        raise InvalidInput(f"frames must be at least 1 and rate positive; got {frames} and {rate:g}.")
    body = _contact(skin, contact, force, size, x, y, friction, drag, direction)
    full = skin.sample(body)
    noisy = all(p.noise_std is not None for p in skin.planes)
    rng = np.random.default_rng(seed) if noisy else None
    scale = (np.arange(frames) + 1.0) / frames
    stamps = np.arange(frames) / rate
    if isinstance(skin.pad, Viscoelastic):
        tractions = scale.reshape(-1, *(1,) * full.ndim) * full
        readings = np.asarray(skin.sense(tractions, rng=rng, time=stamps))
    else:
        readings = np.stack([skin.sense(s * full, rng=rng) for s in _progress(scale, "simulating")])
    if readings.ndim == 3 and skin.surface.dimensions == 2:
        positions: Any = skin.planes[0].points[:, ::-1]
    else:
        positions = skin.planes[0].points[:, 0] if skin.surface.dimensions == 1 else None
    meta = {
        "made by": _command(),
        "skin": skin_file.read_text(encoding="utf-8"),
        "force": ", ".join(repr(float(f)) for f in body.force),
    }
    channels = tuple(c for p in skin.planes for c in p.channels)
    recording = Recording(readings=readings, channels=channels, time=stamps, positions=positions, meta=meta)
    write_recording(recording, out)
    typer.echo(
        f"wrote {out}: {frames} frame{'s' if frames > 1 else ''} of {', '.join(channels)}, {'x'.join(map(str, readings.shape[2:]))} taxels"
    )


@app.command()
def reconstruct(
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
    method: Annotated[
        str | None,
        typer.Option(
            help="adaptive (default where pressure is sought), tikhonov, hilgers, truncated, dft, linear, constant_friction, "
            "nnls, elastic_net, tv, maxent or network."
        ),
    ] = None,
    components: Annotated[
        str | None, typer.Option(help="What is sought, e.g. z or x,z; default: what the channels can tell apart.")
    ] = None,
    order: Annotated[int | None, typer.Option(help="Order of Tikhonov's penalty: 0, 1 or 2.")] = None,
    parameter: Annotated[
        str | None, typer.Option(help="Regularisation parameter, or evidence, gcv, lcurve, discrepancy.")
    ] = None,
    friction: Annotated[
        float | None,
        typer.Option(help="Coefficient of friction: bounds the shear (adaptive), and gives the slip margin."),
    ] = None,
    drop_missing: Annotated[
        bool, typer.Option("--drop-missing", help="Leave out taxels with missing readings instead of refusing them.")
    ] = False,
) -> None:
    """Recover pressure and shear from a recording. Nothing to tune."""
    from dataclasses import replace

    import numpy as np

    from palpate.elastic import Viscoelastic
    from palpate.recordings import read_recording, read_stream, write_touch
    from palpate.recordings.formats import file_format
    from palpate.skin import METHODS, Skin
    from palpate.touch import joined

    target = out if out is not None else recording_file.with_name(recording_file.stem + "-touch.nc")
    file_format(target)
    if plot is not None:
        _check_picture(plot)
    if method is not None and (method not in METHODS or method == "wiener"):
        raise InvalidInput(f"method must be one of {', '.join(m for m in METHODS if m != 'wiener')}; got {method!r}.")
    if friction is not None and not (np.isfinite(friction) and friction != 0):
        raise InvalidInput(f"friction must be a finite number other than 0; got {friction:g}.")
    recording = read_recording(recording_file, mapping=read_stream(skin_file))
    skin = Skin.from_file(skin_file, recording=recording)
    _matching(recording, skin)
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
        "order": order,
        "components": components.split(",") if components else None,
    }
    if parameter is not None:
        options["parameter"] = _number_or_rule(parameter)
    takes_friction = method == "constant_friction" or (
        method in (None, "adaptive") and order is None and parameter is None and skin.boundary == "free"
    )
    if takes_friction and friction is not None:
        sought = skin.components if components is None else components.split(",")
        if method == "constant_friction" or ("z" in sought and len(sought) > 1):
            options["friction"] = friction
    count = len(recording.readings)
    if not -count <= frame < count:
        raise InvalidInput(f"frame {frame} is not among the {count} frames of {recording_file}.")
    step = count if isinstance(skin.pad, Viscoelastic) else 64  # creep remembers, so its frames stay together
    with _busy("preparing the skin"):
        skin.reconstruct(recording.readings[:1], time=recording.time[:1], **options)
    parts = [
        skin.reconstruct(recording.readings[i : i + step], time=recording.time[i : i + step], **options)
        for i in _progress(range(0, count, step), "reconstructing")
    ]
    touch = replace(joined(parts), time=recording.time)
    figure = touch.plot(frame=frame) if plot is not None else None
    write_touch(touch, target, provenance=_provenance(skin_file.read_text(encoding="utf-8"), str(recording_file)))
    if figure is not None and plot is not None:
        _save(figure, plot)
    both = set(touch.components) == set(touch.surface.components)
    slip = abs(friction) if friction is not None and both else None
    typer.echo(f"frame {frame % count} of {count}")
    typer.echo(touch.summary(friction=slip, frame=frame))
    if touch.parameter is not None:
        typer.echo(f"parameter       {float(touch.parameter[frame]):.4g}")
    typer.echo(f"wrote           {target}" + (f", {plot}" if plot else ""))


@app.command()
def track(
    recording_file: Annotated[
        Path,
        typer.Argument(metavar="RECORDING", help="Recording (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag)."),
    ],
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    out: Annotated[
        Path | None,
        typer.Option(
            help="Readings, touches and events to write, frame by frame (.mcap, .nc, .h5, .zarr), or the touches alone (.npz, .csv)."
        ),
    ] = None,
    friction: Annotated[float | None, typer.Option(help="Coefficient of friction, where it is known.")] = None,
    baseline: Annotated[int, typer.Option(min=0, help="Frames at the start that are the zero: nothing touches.")] = 0,
    budget: Annotated[float | None, typer.Option(help="Milliseconds a frame may take.")] = None,
    max_pressure: Annotated[str | None, typer.Option(help='Alarm above this peak pressure, e.g. "40 kPa".')] = None,
    max_force: Annotated[str | None, typer.Option(help='Alarm above this normal force, e.g. "2 N".')] = None,
) -> None:
    """Follow a recording frame by frame: contact, slip before it happens, excess, failing taxels."""
    import contextlib

    import numpy as np

    from palpate.recordings import read_recording, read_stream, recorder, write_touch
    from palpate.recordings.formats import file_format
    from palpate.skin import Skin
    from palpate.touch import joined

    kind = None if out is None else file_format(out)
    recording = read_recording(recording_file, mapping=read_stream(skin_file))
    skin = Skin.from_file(skin_file, recording=recording)
    _matching(recording, skin)
    if not baseline < len(recording.readings):
        raise InvalidInput(f"--baseline {baseline} leaves nothing of {len(recording.readings)} frames.")
    monitor = _monitor(skin, friction, max_pressure, max_force, lambda event: typer.echo(str(event)))
    bound = friction if {"z"} < set(skin.components) else None
    touches, seconds = [], []
    with _busy("preparing the skin"):
        tracker = skin.track(friction=bound, baseline=baseline, budget=None if budget is None else 1e-3 * budget)
    sink = None
    if out is not None and kind in ("mcap", "netcdf", "zarr"):
        meta = _provenance(skin_file.read_text(encoding="utf-8"), str(recording_file))
        sink = recorder(out, recording.channels, positions=recording.positions, meta=meta)
    with tracker, sink or contextlib.nullcontext():
        for time, values in zip(recording.time, recording.readings):
            touch = tracker.step(values, float(time))
            seconds.append(tracker.seconds)
            events = monitor.update(touch) if "z" in touch.components else []
            if sink is not None:
                sink.readings(float(time), values)
                sink.touch(touch)
                for event in events:
                    sink.event(event)
            elif out is not None:
                touches.append(touch)
    if sink is None and out is not None:
        write_touch(
            joined(touches), out, provenance=_provenance(skin_file.read_text(encoding="utf-8"), str(recording_file))
        )
    typer.echo(str(tracker.health))
    ms = 1e3 * np.array(seconds)
    typer.echo(f"a frame took    {np.median(ms):.2f} ms (median), {np.percentile(ms, 99):.2f} ms (99 %)")
    if out is not None:
        typer.echo(f"wrote           {out}")


@app.command()
def live(
    recording_file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[RECORDING]", help="Recording to replay (.nc, .h5, .npz, .csv, .zarr, .mcap or a ROS bag)."
        ),
    ] = None,
    skin_file: Annotated[Path | None, typer.Option("--skin", help="skin.toml with the pad and its array.")] = None,
    udp: Annotated[int | None, typer.Option(min=1, max=65535, help="Listen for frames on this UDP port.")] = None,
    tcp: Annotated[int | None, typer.Option(min=1, max=65535, help="Listen for frames on this TCP port.")] = None,
    ws: Annotated[int | None, typer.Option(min=1, max=65535, help="Take frames by WebSocket on this port.")] = None,
    demo: Annotated[bool, typer.Option("--demo", help="A simulated finger: needs nothing else.")] = False,
    friction: Annotated[float | None, typer.Option(help="Coefficient of friction, where it is known.")] = None,
    baseline: Annotated[int, typer.Option(min=0, help="Frames at the start that are the zero: nothing touches.")] = 0,
    max_pressure: Annotated[str | None, typer.Option(help='Alarm above this peak pressure, e.g. "40 kPa".')] = None,
    max_force: Annotated[str | None, typer.Option(help='Alarm above this normal force, e.g. "2 N".')] = None,
    speed: Annotated[float, typer.Option(help="Replay so many times faster.")] = 1.0,
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
        str, typer.Option(help="Address to listen on; anything but this machine needs a token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port.")] = 8765,
    token: Annotated[str | None, typer.Option(help="What the page must bring (made up where one is needed).")] = None,
) -> None:
    """Show in a browser what touches the pad, while it happens."""
    import secrets
    from collections.abc import Iterator

    import numpy as np

    from palpate.live import FoxgloveServer, Live, RerunSink, Session, serve
    from palpate.live.server import BUDGET, LOCAL
    from palpate.live.session import recorded
    from palpate.recordings import Sink, recorder
    from palpate.skin import Skin

    listening = {k: v for k, v in (("udp", udp), ("tcp", tcp), ("ws", ws)) if v is not None}
    if sum((demo, recording_file is not None, len(listening))) != 1:
        raise InvalidInput("give either a RECORDING, --udp, --tcp or --ws with a --skin, or --demo.")
    if (skin_file is None) != demo:
        raise InvalidInput("--demo brings its own skin." if demo else "what is shown needs its skin: --skin skin.toml.")
    if not (np.isfinite(speed) and speed > 0):
        raise InvalidInput(f"--speed must be a positive number; got {speed:g}.")
    if record_to is not None and not record_to.is_dir():
        raise InvalidInput(f"--record-to {record_to}: no such folder.")
    pace, end, counts = True, None, None
    if host not in LOCAL and token is None:
        token = secrets.token_urlsafe(16)
    if demo:
        from palpate.simulation import demonstration

        skin, frames = demonstration()
        friction, baseline, loop, name = friction or 0.6, baseline or 20, True, "simulated finger"

        source: Any = frames
    elif recording_file is None:
        from palpate.network import FrameListener

        skin = Skin.from_file(skin_file)  # type: ignore[arg-type]
        shapes = {p.shape for p in skin.planes}
        if len(shapes) != 1:
            raise InvalidInput("frames from the network hold planes of one shape; this skin has several.")
        channels = sum(len(p.channels) for p in skin.planes)
        kind, where = listening.popitem()
        listener = FrameListener((channels, *shapes.pop()), kind=kind, port=where, host=host)
        name, pace, end, counts = f"{kind} port {listener.port}", False, listener.close, listener.counts

        def source() -> FrameListener:
            return listener
    else:
        from palpate.recordings import read_recording, read_stream

        recording = read_recording(recording_file, mapping=read_stream(skin_file))  # type: ignore[arg-type]
        skin = Skin.from_file(skin_file, recording=recording)  # type: ignore[arg-type]
        _matching(recording, skin)
        name = str(recording_file)

        def source() -> Iterator[tuple[float, Any]]:
            yield from zip((recording.time / speed).tolist(), recording.readings)

    monitor = _monitor(skin, friction, max_pressure, max_force)
    with _busy("preparing the skin"):
        bound = friction if {"z"} < set(skin.components) else None
        tracker = skin.track(friction=bound, baseline=baseline, budget=BUDGET)
    sinks: list[Sink] = []
    if foxglove is not None:
        sinks.append(FoxgloveServer(recorded(skin)["channels"], port=foxglove))
        typer.echo(f"Foxglove: open a connection to ws://127.0.0.1:{foxglove}")
    if rerun:
        sinks.append(RerunSink())
    if record is not None:  # last, so that nothing is left where the others fail
        sinks.append(recorder(record, **recorded(skin), meta=_provenance(_source(skin_file), name)))
    session = Session(
        skin, source, tracker, monitor, name=name, pace=pace, loop=loop, end=end, sinks=sinks, counts=counts
    )
    view = Live(session, token=token, folder=record_to)
    query = "" if token is None else f"?token={token}"
    typer.echo(f"open http://{host if ':' not in host else f'[{host}]'}:{port}/{query}    (Ctrl-C ends)")
    serve(view, host=host, port=port)


@app.command()
def convert(
    source: Annotated[
        Path,
        typer.Argument(
            help="Recording, or a table of others: a CSV with a header, or HDF5 with positions and vectors."
        ),
    ],
    target: Annotated[Path, typer.Argument(help="Recording to write (.nc, .h5, .npz, .csv, .zarr or .mcap).")],
    columns: Annotated[
        str | None,
        typer.Option(help="Columns x, y and channels of a foreign CSV (x,y,u,v), or data sets pos,vec of HDF5."),
    ] = None,
    channels: Annotated[str, typer.Option(help="What the columns measure.")] = "displacement_x,displacement_y",
    pixel: Annotated[
        str | None,
        typer.Option(help='Size of a pixel, e.g. "0.77 um", where positions and displacements are in pixels.'),
    ] = None,
    position_unit: Annotated[str | None, typer.Option(help="Unit of the positions (mm, um, ...).")] = None,
    reading_unit: Annotated[str | None, typer.Option(help="Unit of the readings (um, kPa, ...).")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Move each marker by its own displacement first.")] = False,
    grid: Annotated[
        str | None, typer.Option(help='Interpolate scattered readings to a grid of this pitch, e.g. "8 um".')
    ] = None,
    skin_file: Annotated[
        Path | None,
        typer.Option(
            "--skin", help="skin.toml whose section [stream] says where the readings are in a robot's messages."
        ),
    ] = None,
    topic: Annotated[str | None, typer.Option(help="Topic of the readings in a robot's MCAP file or bag.")] = None,
    path: Annotated[str, typer.Option(help="Where the taxels are in its messages, e.g. sensors[0].taxels.")] = "",
    fields: Annotated[str | None, typer.Option(help="What to take of each taxel, e.g. x,y,z.")] = None,
    scale: Annotated[
        str, typer.Option(help="Multiplies the numbers to SI units: one number, or one per channel with commas.")
    ] = "1",
    shape: Annotated[str | None, typer.Option(help="Rows and columns of the taxels, e.g. 4x6.")] = None,
    markers: Annotated[
        bool, typer.Option("--markers", help="The numbers are positions of markers: read their displacement.")
    ] = False,
    salvage: Annotated[
        bool, typer.Option("--salvage", help="Read a torn MCAP file, or HDF5 that was not closed, as far as it goes.")
    ] = False,
) -> None:
    """Change the format of a recording, or read a table, an MCAP file or a ROS bag made elsewhere into one."""
    from palpate.elastic.quantities import channel_unit
    from palpate.recordings import TopicMapping, read_recording, read_stream, read_table, write_recording
    from palpate.recordings.formats import file_format
    from palpate.recordings.robots import is_bag
    from palpate.recordings.units import convert_factor, parse_quantity

    file_format(target)
    described = bool(path or fields or scale != "1" or shape or markers)
    if topic is not None or described or salvage or skin_file is not None:
        if columns is not None:
            raise InvalidInput("--columns describes a table; --topic, --skin and --salvage what a robot recorded.")
        if described and topic is None:
            raise InvalidInput(
                "--path, --fields, --scale, --shape and --markers describe the messages of a --topic: name it."
            )
        if topic is not None and skin_file is not None:
            raise InvalidInput("give either --topic or a --skin with a section [stream].")
        mapping = None if skin_file is None else read_stream(skin_file)
        if skin_file is not None and mapping is None:
            raise InvalidInput(f"{skin_file} has no section [stream] that says where the readings are.")
        if topic is not None:
            mapping = TopicMapping(
                topic=topic,
                channels=channels.split(","),
                path=path,
                fields=fields.split(",") if fields else (),
                scale=_numbers(scale, "--scale"),
                shape=_shape(shape),
                markers=markers,
            )
            if not (is_bag(source) or source.suffix.lower() == ".mcap"):
                raise InvalidInput(f"--topic describes an .mcap file or a bag; got {source}.")
        recording = read_recording(source, mapping=mapping, salvage=salvage)
    elif columns is None:
        if pixel or position_unit or reading_unit or follow:
            raise InvalidInput(
                "--pixel, --position-unit, --reading-unit and --follow describe a foreign table: name its --columns too."
            )
        recording = read_recording(source)
    else:
        names = channels.split(",")
        units = {channel_unit(c) for c in _known(names)}
        if pixel is not None:
            if position_unit or reading_unit:
                raise InvalidInput(
                    "--pixel already gives the unit of positions and displacements; leave out --position-unit and --reading-unit."
                )
            if units != {"m"}:
                raise InvalidInput(
                    "--pixel gives displacements their unit; these channels are not displacements. Use --position-unit and --reading-unit."
                )
            place = reading = parse_quantity(pixel, "length", "pixel")
        else:
            if position_unit is None or reading_unit is None:
                raise InvalidInput("a foreign table has no units: give --pixel, or --position-unit and --reading-unit.")
            if len(units) != 1:
                raise InvalidInput("the channels of one table must share a unit.")
            place = convert_factor(position_unit, "m", "--position-unit")
            reading = convert_factor(reading_unit, units.pop(), "--reading-unit")
        recording = read_table(
            source,
            columns=columns.split(","),
            channels=names,
            position_factor=place,
            reading_factor=reading,
            follow=follow,
        )
    if grid is not None:
        recording = recording.gridded(parse_quantity(grid, "length", "grid"))
    write_recording(recording, target)
    shape = "x".join(map(str, recording.readings.shape[2:]))
    typer.echo(f"wrote {target}: {len(recording.readings)} frames of {', '.join(recording.channels)}, {shape} taxels")


@app.command()
def pad(
    skin_file: Annotated[Path, typer.Argument(metavar="SKIN", help="skin.toml with the pad and its array.")],
    plot: Annotated[
        Path, typer.Option(help="Picture of the response per wavelength to write (.png, .pdf or .svg).")
    ] = Path("palpate-pad.png"),
) -> None:
    """Show what a pad does to a touch at each wavelength, and how far a half-space would be off."""
    from palpate.pads import half_space_error, plot_response
    from palpate.skin import Skin

    _check_picture(plot)
    skin = Skin.from_file(skin_file)
    figure = plot_response(skin.pad, skin.planes)
    with _busy("a typical contact"):
        found = half_space_error(skin)
    _save(figure, plot)
    typer.echo(
        f"a Hertz contact of radius {1e3 * found.radius:.3g} mm in the middle, 1 % noise, components {', '.join(skin.components)}"
    )
    typer.echo(
        f"error of the traction      this pad {100 * found.layered:.0f} %   taken for a half-space {100 * found.relative:.0f} %"
    )
    if "z" in skin.components:
        typer.echo(f"taken for a half-space     peak pressure x {found.peak:.2f}   net force x {found.force:.2f}")
    typer.echo(f"picture                    {plot}")


bench_app = typer.Typer(
    help="Measure the inversion on simulated contacts.", no_args_is_help=True, rich_markup_mode=None
)
app.add_typer(bench_app, name="bench")


@bench_app.command("accuracy")
def bench_accuracy(
    layouts: Annotated[str | None, typer.Option(help="Layouts, separated by commas; default: all.")] = None,
    draws: Annotated[int, typer.Option(min=1, help="Noise draws of each contact.")] = 2,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    family: Annotated[bool, typer.Option(help="Also the methods for comparison.")] = True,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the table of every case (accuracy.csv) and the picture (accuracy.png)."),
    ] = None,
) -> None:
    """Error of every method against the clairvoyant Wiener filter, and coverage of the error bars."""
    import csv

    from palpate import bench

    names = tuple(bench.LAYOUTS) if layouts is None else tuple(n.strip() for n in layouts.split(","))
    unknown = [n for n in names if n not in bench.LAYOUTS]
    if unknown:
        raise InvalidInput(f"layouts must be among {', '.join(bench.LAYOUTS)}; got {', '.join(unknown)}.")
    folder = _folder(out) if out is not None else None
    total = sum(
        len(bench.LAYOUTS[n].contacts)
        * len(bench.NOISES)
        * draws
        * (1 + (len(bench.LAYOUTS[n].methods) if family else 0))
        for n in names
    )
    with _bar("contacts", total) as step:
        records = bench.accuracy(
            names, draws=draws, seed=seed, family=family, jobs=jobs, report=lambda record: step(record.contact)
        )
    typer.echo("error over that of the clairvoyant Wiener filter, which knows the contact's spectrum and the noise")
    typer.echo(f"{'layout':<21}{'method':<13}{'noise':>7}{'geometric mean':>16}{'worst':>8}{'contacts':>10}")
    for layout, method, noise, mean, worst, count in bench.table(records):
        level = "all" if noise != noise else f"{noise:g}"
        typer.echo(f"{layout:<21}{method:<13}{level:>7}{mean:>16.3f}{worst:>8.3f}{count:>10}")
    typer.echo("part of true values inside the intervals (adaptive)")
    half, most = bench.coverage(records, 0.5), bench.coverage(records, 0.95)
    for quantity, value in half.items():
        typer.echo(f"{quantity:<21}50 %: {value:.3f}   95 %: {most[quantity]:.3f}")
    if folder is not None:
        with open(folder / "accuracy.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["layout", "contact", "noise", "method", "error", "clairvoyant"])
            writer.writerows([r.layout, r.contact, r.noise, r.method, r.error, r.clairvoyant] for r in records)
        from palpate._plot import plot_accuracy

        _save(plot_accuracy(records), folder / "accuracy.png")
        typer.echo(f"wrote           {folder / 'accuracy.csv'}, {folder / 'accuracy.png'}")


@bench_app.command("calibration")
def bench_calibration(
    frames: Annotated[int, typer.Option(min=20, help="Random contacts.")] = 500,
    method: Annotated[str, typer.Option(help="adaptive or constrained.")] = "adaptive",
    seed: Annotated[int, typer.Option(help="Seed of the contacts and the noise.")] = 12345,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
) -> None:
    """The constants of the error bars, from a random population of contacts."""
    from palpate import bench

    if method not in ("adaptive", "constrained"):
        raise InvalidInput(f"method must be adaptive or constrained; got {method!r}.")
    with _bar("contacts", frames) as step:
        found = bench.calibration(frames, method=method, seed=seed, jobs=jobs, report=lambda i: step(f"{i}"))
    typer.echo(f"{'contact':<17}{'quantity':<21}{'shift':>8}{'scale':>8}{'freedom':>9}")
    for (case, quantity), (shift, scale, freedom) in found.items():
        typer.echo(f"{case:<17}{quantity:<21}{shift:>8.3f}{scale:>8.3f}{freedom:>9.2f}")


@app.command()
def paper(
    out: Annotated[Path, typer.Option(help="Folder for the report, the figures and the tables.")] = Path(
        "palpate-paper"
    ),
) -> None:
    """Reproduce the paper that founded the field: figures 2 to 22, its error table, and three studies."""
    from palpate import paper as module

    with _bar("the founding paper", 26) as step:
        path = module.report(out, progress=step)
    typer.echo(f"{'case':<46}{'channel':<11}{'paper':>9}{'dft':>10}{'linear':>10}")
    import csv

    with open(out / "errors.csv", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            typer.echo(
                f"{row['case']:<46}{row['channel']:<11}{row['paper']:>9}{float(row['dft']):>10.2e}{float(row['linear']):>10.1e}"
            )
    typer.echo(f"report          {path}")


# -- help for the commands ---------------------------------------------------------------------------------------------


def _monitor(
    skin: Skin, friction: float | None, pressure: str | None, force: str | None, callback: Any = None
) -> GraspMonitor:
    from palpate.grasp import GraspMonitor
    from palpate.recordings.units import parse_quantity

    kind = "force per length" if skin.surface.dimensions == 1 else "force"
    return GraspMonitor(
        friction=friction,
        max_pressure=None if pressure is None else parse_quantity(pressure, "pressure", "--max-pressure"),
        max_force=None if force is None else parse_quantity(force, kind, "--max-force"),
        callback=callback,
    )


def _source(skin_file: Path | None) -> str:
    return "" if skin_file is None else skin_file.read_text(encoding="utf-8")


def _numbers(text: str, option: str) -> list[float]:
    try:
        return [float(v) for v in text.split(",")]
    except ValueError as error:
        raise InvalidInput(f"{option} must be one number or several with commas; got {text!r}.") from error


def _shape(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        rows, columns = (int(v) for v in text.lower().split("x"))
    except ValueError as error:
        raise InvalidInput(f"--shape must be rows x columns such as 4x6; got {text!r}.") from error
    return rows, columns


def _check_picture(path: Path) -> None:
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InvalidInput(f"{path}: pictures end in .png, .pdf or .svg.")


def _known(names: list[str]) -> list[str]:
    from palpate.elastic.quantities import check_channels

    return list(check_channels(names, 2))


def _number_or_rule(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _contact(
    skin: Skin, kind: Contact, force: str, size: str, x: str, y: str, friction: float, drag: float, direction: float
) -> Any:
    import math

    from palpate import solutions
    from palpate.recordings.units import parse_quantity

    line = skin.surface.dimensions == 1
    load = parse_quantity(force, "force per length" if line else "force", "force")
    a = parse_quantity(size, "length", "size")
    place = parse_quantity(x, "length", "x")
    if not (math.isfinite(drag) and 0 <= drag <= 1 and math.isfinite(friction) and friction >= 0):
        raise InvalidInput(
            f"friction must not be negative and drag must lie between 0 and 1; got {friction:g} and {drag:g}."
        )
    if load <= 0 or a <= 0:
        raise InvalidInput(f"force and size must be positive; got {force} and {size}.")
    if line:
        if parse_quantity(y, "length", "y") != 0 or direction:
            raise InvalidInput("y and direction have no meaning on a line.")
        body: Any = {
            "hertz": lambda: solutions.hertz_line(half_width=a, force=load),
            "punch": lambda: solutions.flat_punch_line(half_width=a, force=load),
            "patch": lambda: solutions.strip(half_width=a, traction=load / (2 * a)),
        }[kind.value]()
        body = body.shifted(place)
        turn: dict[str, float] = {}
    else:
        body = {
            "hertz": lambda: solutions.hertz_point(radius=a, force=load),
            "punch": lambda: solutions.flat_punch(radius=a, force=load),
            "patch": lambda: solutions.patch(half_widths=(a, a), traction=load / (4 * a * a)),
        }[kind.value]()
        body = body.shifted(place, parse_quantity(y, "length", "y"))
        turn = {"direction": math.radians(direction)}
    if friction == 0 or drag == 0:
        return body
    if drag == 1:
        return body.sliding(friction, **turn)
    if kind is not Contact.hertz:
        raise InvalidInput("a drag below 1 (partial slip) is known in closed form for --contact hertz only.")
    return body.partial_slip(friction, drag * friction * load, **turn)


def _matching(recording: Any, skin: Skin) -> None:
    channels = tuple(c for p in skin.planes for c in p.channels)
    if recording.channels != channels:
        raise InvalidInput(
            f"the recording holds {', '.join(recording.channels)} but the skin describes {', '.join(channels)}: list the same channels in the same order."
        )
    shapes = {p.shape for p in skin.planes}
    if shapes != {recording.readings.shape[2:]}:
        raise InvalidInput(
            f"the recording has {'x'.join(map(str, recording.readings.shape[2:]))} taxels but the skin describes {' and '.join('x'.join(map(str, s)) for s in shapes)}."
        )


def _provenance(skin: str, recording: str = "") -> dict[str, str]:
    import platform

    import numpy
    import scipy

    record = {
        "palpate": palpate.__version__,
        "command": _command(),
        "skin": skin,
        "versions": f"python {platform.python_version()}, numpy {numpy.__version__}, scipy {scipy.__version__}",
    }
    if recording:
        record["recording"] = recording
    return record


def _command() -> str:
    import shlex

    return shlex.join(["palpate", *sys.argv[1:]])


def _folder(path: Path) -> Path:
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path} is a file; give a folder.")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot make the folder ({error.strerror}).") from error
    return path


def _write_text(path: Path, text: str) -> None:
    from palpate.recordings.formats import atomically

    atomically(path, lambda name: _fill(name, text))


def _fill(name: str, text: str) -> None:
    Path(name).write_text(text, encoding="utf-8")


def _save(figure: Any, path: Path) -> None:
    from palpate.recordings.formats import atomically

    atomically(path, lambda name: figure.savefig(name, dpi=130))


def _progress(items: Iterable[Any], label: str) -> Iterable[Any]:
    """The items, with a bar on a terminal while the work is long."""
    from rich.console import Console
    from rich.progress import track

    listed = list(items)
    console = Console(stderr=True)
    if len(listed) < 3 or not console.is_terminal:
        return listed
    return track(listed, description=label, console=console, transient=True)


def _busy(label: str) -> Any:
    """A spinner on a terminal."""
    from rich.console import Console

    return Console(stderr=True).status(label)


class _bar:
    """A progress bar that is fed by a callback."""

    def __init__(self, label: str, total: int) -> None:
        from rich.console import Console
        from rich.progress import Progress

        console = Console(stderr=True)
        self._progress = Progress(console=console, transient=True, disable=not console.is_terminal)
        self._label, self._total = label, total

    def __enter__(self) -> Any:
        self._progress.start()
        task = self._progress.add_task(self._label, total=self._total)
        return lambda what: self._progress.update(task, advance=1, description=what)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()


def main() -> None:
    """Entry point: errors are one line on stderr and exit code 2."""
    # typer carries its own copy of click; its usage errors have this base in every version
    usage_error: Any = next(c for c in typer.BadParameter.__mro__ if c.__name__ == "ClickException")
    try:
        code = app(standalone_mode=False)
    except typer.Abort:
        _fail("stopped", 130)
    except usage_error as error:
        _fail(f"{error.format_message()} (palpate --help)", 2)
    except PalpateError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt:
        _fail("stopped", 130)
    except MemoryError:
        _fail("not enough memory for this many taxels and surface cells; give a coarser surface.", 2)
    except OSError as error:
        _fail(f"{error.filename or 'file'}: {error.strerror or error}", 2)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, code: int) -> None:
    sys.stderr.write(f"error: {' '.join(message.split())}\n")
    sys.exit(code)
