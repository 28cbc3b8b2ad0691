"""What presses, and pictures of what robots recorded."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

import palpate as pp
from palpate.recordings import write_recording
from remedies._remedy import Remedy, command, laid, value
from skin_files import skin_text

__all__ = ["REMEDIES"]

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
SKIN_TEXT = skin_text(6, 6, pitch="2 mm", depth="2 mm", noise="300 Pa")
SKIN = pp.Skin(PAD, pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=300.0))
BALL = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0)
READINGS = SKIN.sense(BALL)
LINE = pp.Skin(PAD, pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=10.0))
PRESSED = LINE.sense(pp.solutions.hertz_line(half_width=2e-3, force=5.0))


def identified(readings: Any = READINGS, *, frames: int = 0, **options: Any) -> Any:
    found = np.stack([READINGS] * frames) if frames else READINGS
    return SKIN.identify(readings, SKIN.reconstruct(found, method="tikhonov"), **{"shape": "ball", **options})


def message(**changed: Any) -> Any:
    given = {"height": 2, "width": 2, "encoding": "rgb8", "step": 6, "is_bigendian": 0, "data": bytes(12)}
    return SimpleNamespace(**{**given, **changed})


def decoded(made: Any) -> Any:
    from palpate.camera.messages import decoded

    return decoded(made)


def fingers() -> None:
    """A skin file, and two frames at rest before one of a ball."""
    laid(skin_toml=SKIN_TEXT)
    noise = [SKIN.planes[0].sample_noise(np.random.default_rng(i), ()) for i in range(2)]
    write_recording(pp.Recording(readings=np.stack([*noise, READINGS]), channels=("stress_zz",)), "r.nc")


def told(words: str, wrong: str, mended: str, *, room: str = "cli.identify") -> Remedy:
    how = "identify r.nc --skin skin.toml --shape ball"
    return Remedy(words, command(f"{how} {wrong}"), command(f"{how} {mended}"), room=room, given=fingers)


def creeping(out: bool) -> Any:
    """A press on a pad that creeps; whether its creep is taken out first."""
    times = np.array([0.0, 0.5, 1.0])
    creeps = pp.Skin(pp.Viscoelastic(PAD, prony=[(0.2, 1.0)]), SKIN.planes[0])
    skin = creeps.without_creep() if out else creeps
    touch = SKIN.reconstruct(np.stack([READINGS] * 3), method="tikhonov")
    return skin.identify(np.stack([READINGS] * len(times)), touch, shape="ball")


REMEDIES = [
    told("leaves no frame of the", "--baseline 3", "--baseline 2"),
    told("the recording has the frames 0 to", "--frame 9", "--frame 2"),
    told("times: at most {}, since each takes seconds", "--frame 2 " * 41, "--frame 2"),
    told("once for each --frame", "--indentation 1mm --indentation 1mm --frame 2", "--indentation 1mm --frame 2"),
    value("identify cannot use pads that creep", creeping, False, True),
    value("indentation must be one number [m] for each frame", lambda v: identified(indentation=v), [1e-3, 2e-3], 1e-3),
    value("indentation must not be negative", lambda v: identified(indentation=v), -1e-3, 1e-3),
    value('shape must be "{}" or "{}", or None', lambda v: identified(shape=v), "cube", None),
    Remedy(
        "pass the readings that the touch was computed from",
        lambda: identified(np.stack([READINGS] * 2)),
        lambda: identified(READINGS),
    ),
    Remedy(
        "identify needs area contact",
        lambda: LINE.identify(PRESSED, LINE.reconstruct(PRESSED)),
        lambda: LINE.reconstruct(PRESSED).contact_area(),
        right=lambda width: 3e-3 <= float(width) <= 5e-3,
    ),
    Remedy(
        "two or more cells of equal width",
        lambda: BALL.averages([0.0, 1e-3, 3e-3], [0.0, 1e-3]),
        lambda: BALL.averages(*(pp.AreaGrid(shape=(8, 8), spacing=1e-3).x,) * 2),
        right=lambda found: np.isclose(found[2].sum() * 1e-6, BALL.force[2]),
    ),
    value("as z grows into the pad; got", lambda z: BALL.fields(PAD, ["stress_zz"], 0.0, 0.0, z), -1e-3, 1e-3),
    value("are not read; accepted are", lambda v: decoded(message(encoding=v)), "yuv422", "rgb8"),
    value("bytes a row; the message has", lambda v: decoded(message(data=v)), bytes(3), bytes(12)),
]
