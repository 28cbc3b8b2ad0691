"""Frames from the network and from ROS, the live page, sensors that are known, methods of others; and what is left of arguments."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import palpate as pp
from palpate.inverse import registry
from palpate.network import FrameListener, Limits, frame_bytes, frame_from_bytes, zenoh_key, zero_bytes
from palpate.recordings import TopicMapping
from palpate.sensors import preset
from remedies._remedy import Remedy, command, laid, value
from remedies.skins import BOTH, FAST, GRID, NORMAL, ONE, PAD, PRESS, PUNCH, SKIN, TRACTION, WORKING, line, method

FRAME = np.arange(18.0).reshape(2, 9)
TWO = pp.Skin(PAD, [line(), line(depth=2e-3)])
DEEPER = pp.Skin(PAD, [line(channels=["stress_zz"]), line(channels=["stress_zz"], depth=2e-3)])
WIDE = pp.Skin(PAD, [line(), line(count=7, depth=2e-3)])


def listening(**how: Any) -> Any:
    with FrameListener(how.pop("shape", (2, 9)), **how) as listener:
        return listener.port


def holds(got: Any) -> bool:
    return bool(np.array_equal(got[2].reshape(FRAME.shape), FRAME))


MAPPING = TopicMapping(topic="/skin", channels=["stress_zz"])


def image(encoding: str = "32FC1", rows: int = 2, held: int | None = None) -> Any:
    """sensor_msgs/Image with two columns."""
    data = np.arange(2.0 * rows, dtype="<f4").tobytes()
    return SimpleNamespace(encoding=encoding, height=rows, width=2, step=8, is_bigendian=0, data=data[:held])


def grid(field: str = "p", held: int | None = None, offset: int = 0) -> Any:
    """foxglove.Grid of two columns."""
    data = np.arange(4.0, dtype="<f4").tobytes()
    return SimpleNamespace(
        fields=[SimpleNamespace(name=field, type=7, offset=offset)],
        column_count=2,
        row_stride=8,
        cell_stride=4,
        data=data[:held],
    )


def message(words: str, wrong: Any, mended: Any, **how: Any) -> Remedy:
    mapping = TopicMapping(**{"topic": "/skin", "channels": ["stress_zz"], **how})
    return value(
        words, mapping.readings, wrong, mended, room="recordings.mapping", right=lambda v: v.ravel()[-1] == 3.0
    )


@dataclass(frozen=True)
class Own(pp.Tikhonov):
    """A method of another package."""

    name: ClassVar[str] = "own"


@dataclass(frozen=True)
class Named(pp.Tikhonov):
    """One whose name is taken."""

    name: ClassVar[str] = "tikhonov"


def filled(numbers: dict[str, Any]) -> Any:
    return preset("gelsight_mini").changed(**numbers)


def registered(made: Any) -> Any:
    try:
        return registry.register(made)
    finally:
        registry.unregister("own")


REMEDIES = [
    # frames
    value(
        "a frame must have shape (channel, taxel) or (channel, y, x); got",
        lambda f: frame_from_bytes(frame_bytes(0, 0.0, f)),
        FRAME[0],
        FRAME,
        room="network.frames",
        right=holds,
    ),
    value(
        "a frame holds single precision, which ends at 3.4e38",
        lambda f: frame_from_bytes(frame_bytes(0, 0.0, f)),
        1e300 * np.ones_like(FRAME),
        FRAME,
        right=holds,
    ),
    value(
        "a frame has at most 65535 channels",
        lambda f: frame_from_bytes(frame_bytes(0, 0.0, f)),
        np.zeros((1, 70000)),
        FRAME,
        right=holds,
    ),
    value(
        "not a palpate frame: it does not begin with PLPF",
        frame_from_bytes,
        b"PLP1" + frame_bytes(0, 0.0, FRAME)[4:],
        frame_bytes(0, 0.0, FRAME),
        right=holds,
    ),
    value(
        "floats has {} bytes; got",
        frame_from_bytes,
        frame_bytes(0, 0.0, FRAME)[:-4],
        frame_bytes(0, 0.0, FRAME),
        right=holds,
    ),
    value("frames must be a whole number from 1 to", zero_bytes, 0, 10),
    value("connections must be a whole number from 2 on", lambda n: Limits(connections=n), 1, 2),
    value("{} must be a positive number; got", lambda q: Limits(silence=q), 0.0, 1.0, room="network.admission"),
    value("a key of zenoh is words between single /", zenoh_key, "/finger/*", "left/finger"),
    value('kind must be "udp", "tcp" or "ws"', lambda k: listening(kind=k), "http", "udp"),
    value(
        "shape must be (channel, taxel) or (channel, y, x); got",
        lambda s: listening(shape=s),
        (9,),
        (2, 9),
        room="network.admission",
    ),
    # messages of robots
    message("images must be 32FC1, 32FC3, 64FC1, ... (floats)", image("rgb8"), image()),
    message("floats has {} bytes; it is truncated", image(held=9), image()),
    message("the Grid has no field", grid("pressure"), grid("p"), fields=["p"]),
    message("bytes a cell and {} a row has", grid(held=9), grid()),
    message("does not lie in its cells of", grid(offset=4), grid()),
    Remedy(
        "give the shape that they state, or leave it out",
        lambda: TopicMapping(topic="/skin", channels=["stress_zz"], shape=(4, 1)).readings(image()),
        lambda: MAPPING.readings(image()),
        right=lambda v: v.shape == (1, 2, 2),
    ),
    # sensors
    Remedy(
        "and may hold what was measured; give another name",
        lambda: preset("gelsight_mini").write("s.toml"),
        lambda: preset("gelsight_mini").write("new.toml"),
        given=lambda: laid(s_toml="mine"),
        room="sensors.__init__",
    ),
    value("has no number {}; it has", filled, {"hardness": "1"}, {"thickness": "3 mm"}),
    # methods of others
    value("a method must be a subclass of palpate.inverse.Method", registered, dict, Own),
    value("the name {} is that of {}; choose another", registered, Named, Own),
    value(
        "method must be a {} with its options",
        lambda m: SKIN.reconstruct(PRESS, method=m),
        pp.Tikhonov,
        pp.Tikhonov(parameter=1e-4),
    ),
    method(
        'method="{}" needs {}=..., {}',
        {"method": "wiener"},
        {"method": "wiener", "spectrum": lambda k: 1e6 + 0 * k},
        skin=pp.Skin(PAD, line(noise=10.0)),
    ),
    value(
        "which only Python can say (Skin.reconstruct)",
        lambda f: f(),
        command("reconstruct r.nc --skin skin.toml --method wiener"),
        lambda: pp.Skin(PAD, line(noise=10.0)).reconstruct(PRESS, method="wiener", spectrum=lambda k: 1e6 + 0 * k),
        given=lambda: recorded(),
    ),
    value(
        'boundary="periodic" cannot leave out taxels',
        lambda b: pp.Skin(PAD, line().masked(WORKING), boundary=b).reconstruct(PRESS, **FAST),
        "periodic",
        "free",
    ),
    method(
        'needs all planes on one grid; use method="tikhonov"',
        {"method": "dft"},
        FAST,
        skin=WIDE,
        readings=WIDE.sense(PUNCH),
    ),
    Remedy(
        'Use method="tikhonov".',
        lambda: pp.Skin(PAD, line(depth=0.0)).reconstruct(PRESS, method="dft"),
        lambda: pp.Skin(PAD, line(depth=0.0)).reconstruct(PRESS, **FAST),
        room="sensing.kernels",
    ),
    Remedy(
        "cannot be told apart from",
        lambda: NORMAL.reconstruct(ONE, components=["x", "z"], **FAST),
        lambda: DEEPER.reconstruct(DEEPER.sense(PUNCH), components=["x", "z"], **FAST),
        right=lambda t: abs(float(t.force[-1]) - 50.0) < 25.0,
    ),
    # touches
    value(
        "values must have shape (*batch, component, *surface)",
        lambda v: pp.Touch(v, GRID, ("x", "z"), "own"),
        TRACTION[:1],
        TRACTION,
    ),
    value("no channel {} to take a zero of; there are", lambda c: SKIN.track().rezero(c), ["stress_yy"], ["stress_zz"]),
    # ROS
    value("is not the name of a message type", lambda n: message_type(n), "Image", "sensor_msgs/msg/Image"),
    value("the package {} has no message", lambda n: message_type(n), "sensor_msgs/msg/Imag", "sensor_msgs/msg/Image"),
]


def message_type(name: str) -> Any:
    pytest.importorskip("sensor_msgs")
    from palpate.ros.client import message_class

    return message_class(name)


def recorded() -> None:
    from palpate.recordings import write_recording
    from skin_files import skin_text

    laid(skin_toml=skin_text(9, channels=BOTH))
    write_recording(pp.Recording(readings=PRESS[None], channels=BOTH), "r.nc")
