"""Gels that are read by their colours: presses of a ball, and the pictures that follow."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from colour_scenes import Ball, Gel, Lamps
from palpate.camera import SlopeModel, View, feel, learn_slopes, write_slopes
from remedies._remedy import Remedy, command, laid, value

__all__ = ["REMEDIES"]

PAD = """[pad]
kind = "half_space"
youngs_modulus = "300 kPa +- 1 %"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"
depth = "0 mm"
channels = ["displacement_z"]
"""
CAMERA = """
[camera]
scale = "0.12 mm"
size = [160, 120]
"""
PLACES = ((-5e-3, 3e-3), (5e-3, 3e-3), (0.0, 0.0), (-5e-3, -3e-3), (5e-3, -3e-3), (0.0, 3.5e-3))


@lru_cache
def pictures() -> tuple[Any, ...]:
    """The gel at rest, and a ball in six places."""
    gel, rng = Gel(Lamps(), size=(160, 120), scale=0.12e-3), np.random.default_rng(4)
    return (gel.picture(rng=rng), *(gel.picture([Ball(4e-3, 1.6e-3, x, y)], rng=rng) for x, y in PLACES))


def view() -> View:
    return View.scaled(0.12e-3, size=(160, 120))


def learnt(taken: Any = None, **how: Any) -> SlopeModel:
    return learn_slopes(list(pictures() if taken is None else taken), view(), **{"ball_diameter": 8e-3, **how})


@lru_cache
def model() -> SlopeModel:
    return learnt()


def saved() -> None:
    """Skin files with a camera and without, and the pictures as files of a folder and one by one."""
    from PIL import Image

    laid(gel_toml=PAD + CAMERA, plain_toml=PAD)
    Path("presses").mkdir()
    for i, image in enumerate(pictures()):
        Image.fromarray(image).save(Path("presses") / f"{i}.png")


def calibrated() -> None:
    laid(gel_toml=PAD + CAMERA)
    write_slopes("calibrated.toml", "gel.toml", model())


def skin() -> pp.Skin:
    array = pp.AreaArray(shape=(3, 3), pitch=1e-3, depth=0.0, channels=["displacement_z"])
    return pp.Skin(pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.48), array)


def felt(source: Any = None, **how: Any) -> Any:
    found = list(pictures()[:2]) if source is None else source
    return next(iter(feel(found, skin(), **{"model": model(), "baseline": 1, **how})))


def told(words: str, wrong: str, mended: str, *, room: str = "") -> Remedy:
    return Remedy(words, command(wrong), command(mended), room=room, given=saved)


BALL = 'presses --ball-diameter "8 mm"'

REMEDIES = [
    value(
        "every must be a whole number of at least 1",
        lambda n: felt(every=n),
        0,
        1,
        room="camera.colour.touching",
    ),
    value("baseline must be a number of pictures from 0", lambda n: felt(baseline=n), -1, 1),
    value("a Skin does not hold what colours mean", lambda m: felt(model=m()), lambda: None, model),
    value("ball_diameter must be a positive number of metres", lambda d: learnt(ball_diameter=d), -8e-3, 8e-3),
    value("baseline must be a number of pictures of at least 1", lambda n: learnt(baseline=n), 0, 1),
    value("leaves no press of {} pictures", lambda n: learnt(baseline=n), 7, 1),
    value(
        "all channels are equal: a grey picture has no colours to measure slopes by",
        lambda taken: learnt(taken()),
        lambda: [np.repeat(p[..., :1], 3, axis=-1) for p in pictures()],
        pictures,
    ),
    value(
        "slopes are measured by colour, and the picture has shape",
        lambda taken: learnt(taken()),
        lambda: [p[..., 0] for p in pictures()],
        pictures,
    ),
    value(
        "the picture is {} x {}, and the gel was calibrated with",
        lambda rows: model().relief(pictures()[1][:rows]),
        60,
        120,
        room="camera.colour.model",
    ),
    value(
        "Give rest=model.prepared(picture)[0]",
        lambda rest: model().relief(pictures()[1], rest=rest()),
        lambda: pictures()[0],
        lambda: model().prepared(pictures()[0])[0],
    ),
    told(
        "the size of a pixel is unknown",
        f"calibrate {BALL} --skin plain.toml --out c.toml",
        f"calibrate {BALL} --skin gel.toml --out c.toml",
        room="cli.colour",
    ),
    told(
        "--baseline 0: the first picture shows the gel at rest",
        f"calibrate {BALL} --skin gel.toml --out c.toml --baseline 0",
        f"calibrate {BALL} --skin gel.toml --out c.toml",
    ),
    told(
        "calibrate takes recordings and tables, not pictures of dots",
        'calibrate presses --weight "200 g, 1 s to 2 s" --skin gel.toml --out c.toml',
        f"calibrate {BALL} --skin gel.toml --out c.toml",
        room="cli.calibrate",
    ),
]
