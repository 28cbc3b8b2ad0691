"""What was left of several rooms: layers that are weighed, contacts that are too large, pages of others, messages of ROS."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest

import palpate as pp
from palpate.live.camera import _opened
from palpate.microscopy import read_pair
from palpate.paper.algorithm import half_width
from palpate.recordings import TopicMapping
from palpate.ros.intake import Intake, readings_of
from palpate.sensing.zero import zero_of
from palpate.uncertainty.calibration import constants
from remedies import camera
from remedies._remedy import command, laid, value
from remedies.skins import NORMAL, PRESS, RUBBER, SKIN, area, line

LAYERS = camera.GEL_TOML.replace(
    "[[plane]]", '[[pad.layer]]\nthickness = "1 mm"\nyoungs_modulus = "{}"\npoissons_ratio = 0.48\n[[plane]]'
)
SOFT = {"youngs_modulus": 1e5, "poissons_ratio": 0.5}
PRESSURES = np.array([0.0, 1.0, 2.0, 1.0, 0.0])


@dataclass(frozen=True)
class Mine(pp.HalfSpace):
    """A pad of one's own."""


def saved(pad: Any) -> Any:
    skin = pp.Skin(pad, line())
    skin.prepare(method="tikhonov")
    skin.save_prepared("own.prepared")
    return skin.load_prepared("own.prepared")


def weigh_layers(lower: str) -> Any:
    laid(two_toml=LAYERS.format("200 kPa").replace('"200 kPa"', lower, 1))
    return camera.weigh(camera.PULLED, "two.toml", 1.0)


def turned(channels: Any) -> Any:
    """Rotation at the base of rubber tells nothing of what acts on it."""
    rubber = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=1e5, poissons_ratio=0.5)])
    return pp.Skin(rubber, area(depth="base", channels=channels)).components


def folders() -> None:
    """Two pictures of beads, and the same with one that was cut off."""
    camera.png(a=camera.picture(), b=camera.picture(1.5))
    whole = Path("b.png").read_bytes()
    for name, held in (("good", whole), ("bad", whole[:60])):
        Path(name).mkdir()
        (Path(name) / "a.png").write_bytes(Path("a.png").read_bytes())
        (Path(name) / "b.png").write_bytes(held)


def sound(name: str) -> None:
    """A film of nothing but a tone."""
    av = pytest.importorskip("av")
    with av.open(name, "w") as out:
        stream = out.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), dtype=np.int16), format="s16", layout="mono")
        frame.sample_rate = 8000
        for packet in stream.encode(frame):
            out.mux(packet)


def page(**how: Any) -> Any:
    pytest.importorskip("starlette")
    from palpate.live import Live
    from palpate.live.session import Session

    return Live(Session(SKIN, lambda: iter(()), SKIN.track(), pp.GraspMonitor()), **how)


def served(token: str) -> bool:
    """What would run until it is interrupted."""
    uvicorn = pytest.importorskip("uvicorn")
    from palpate.live.server import serve

    with mock.patch.object(uvicorn.Server, "run", return_value=None):
        serve(page(token=token), host="0.0.0.0", port=0)
    return True


def begun(after: float) -> Any:
    """Ten recordings at once, and one more so many seconds later."""
    from palpate.live import server

    live, now = page(folder="."), itertools.chain([0.0] * server.RECORDINGS, [after] * 20)
    with mock.patch.object(server.time, "monotonic", side_effect=now):
        return [live._path() for _ in range(server.RECORDINGS + 1)][-1]


def skin_of(path: Path) -> Any:
    from palpate.camera import gel_skin

    return gel_skin(path, 1e-4 * (camera.GRID - 80.0))


def published(value: str | None) -> Any:
    """A sensor whose gel nobody has published, and its file with what was measured written in."""
    from palpate.cli.pictures import skin_path

    if value is None:
        return skin_path(Path("digit"))
    command("sensors digit --out gel.toml")()
    text = Path("gel.toml").read_text()
    for key, said in {"thickness": "4 mm", "youngs_modulus": value, "depth": "0.5 mm", "pitch": "2 mm"}.items():
        text = text.replace(f'{key} = "unknown"', f'{key} = "{said}"')
    Path("gel.toml").write_text(text)
    return skin_of(skin_path(Path("gel.toml")))


def unknown(weigh: bool) -> Any:
    laid(gel_toml=camera.GEL_TOML.replace('"200 kPa"', '"unknown"'))
    if weigh:
        found = camera.weigh(camera.PULLED, "gel.toml", 1.0)
        laid(gel_toml=camera.GEL_TOML.replace('"200 kPa"', f'"{found.youngs_modulus:.0f} Pa"'))
    return skin_of(Path("gel.toml"))


TOPIC = TopicMapping(topic="/skin", channels=["stress_zz"], path="data")


def message(*values: Any) -> Any:
    return SimpleNamespace(data=list(values))


def stamped(time: float) -> Any:
    mapping = TopicMapping(topic="/skin", channels=["stress_zz"], path="data", stamp="taken")
    return Intake(mapping, (1, 2), now=lambda: 0)._times(SimpleNamespace(data=[1.0, 2.0], taken=time), 0)


REMEDIES = [
    # cameras
    value(
        "holds no pictures, only {} other streams",
        camera.opened,
        "sound.mkv",
        "gel.mkv",
        given=lambda: (sound("sound.mkv"), camera.film("gel.mkv")),
    ),
    value("Give a guess of the unknown one", weigh_layers, '"unknown"', '"100 kPa"', slow=True),
    value(
        "--camera takes the number of a camera (0), /dev/video0, or a video",
        lambda name: _opened(name)[0].close(),
        "gel.png",
        "gel.mkv",
        given=lambda: (camera.png(gel=camera.picture()), camera.film("gel.mkv")),
    ),
    value(
        "picture {} cannot be used",
        lambda name: read_pair([name], frames=(0, 1)),
        "bad",
        "good",
        given=folders,
    ),
    value("too little of {} is published", published, None, "200 kPa"),
    value("is unknown, and forces are proportional to it", unknown, False, True, slow=True),
    # methods
    value("do not fix any set of traction components. Measure stress_zz", turned, ["rotation_z"], ["stress_zz"]),
    value(
        'method="linear" meets a singular system',
        lambda method: pp.Skin(RUBBER, line(channels=["stress_xz"])).reconstruct(
            PRESS[:1], method=method, components=["z"]
        ),
        "linear",
        "tikhonov",
    ),
    value("only pads that come with palpate are", saved, Mine(**SOFT), pp.HalfSpace(**SOFT)),
    value(
        "gives no error bars for {} contact; methods that do",
        lambda method: constants(method, SKIN.case(("x", "z"))),
        "maxent",
        "tikhonov",
    ),
    value(
        "this touch was made or read back without its error bars; take the one that Skin.reconstruct returns",
        lambda touch: touch.std(),
        pp.Touch(np.ones((2, 9)), pp.LineGrid(count=9, spacing=1e-3), ("x", "z"), "tikhonov"),
        SKIN.reconstruct(PRESS, method="tikhonov"),
    ),
    value("no sample of the pressure is positive", half_width, -PRESSURES, PRESSURES, right=lambda width: width == 1),
    # zero
    value("the zero is the mean of some frames", zero_of, PRESS[None][:0], PRESS[None]),
    value(
        "has no zero for one of",
        lambda other: SKIN.track().take_zero(other.track(baseline=0)),
        NORMAL,
        SKIN,
        right=bool,
    ),
    # the page
    value("give a token, which they must send", served, "", "secret"),
    value("start with --record-to FOLDER", lambda how: page(**how)._path(), {}, {"folder": "."}),
    value("recordings were begun in the last minute; wait a little", begun, 1.0, 61.0),
    # messages of ROS
    value(
        "a message holds {} numbers, the skin describes {}",
        lambda sent: readings_of(TOPIC, (1, 2), sent),
        message(1.0, 2.0, 3.0),
        message(1.0, 2.0),
        right=lambda got: got.shape == (1, 2),
    ),
    value(
        "a message does not hold numbers where they should be",
        lambda sent: readings_of(TOPIC, (1, 2), sent),
        SimpleNamespace(data=SimpleNamespace(encoding="32FC1", height=None, width=2, step=8, data=b"")),
        message(1.0, 2.0),
    ),
    value(", which is no time", stamped, float("nan"), 1.5, right=lambda got: got[0] == 1.5),
]
