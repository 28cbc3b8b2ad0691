"""Simulate a finger that presses, rolls, twists, slides and lifts: streams with known traction, for demonstrations and
tests.

Contact is that of a rigid ball (a cylinder on a line) on an elastic half-space of the pad's modulus at its surface: Hertz, with
Cattaneo-Mindlin partial slip under a tangential load and full slip at the friction limit (`palpate.solutions`). Twist is
rotation about the ball's axis; only its sliding limit is in closed form, and an incomplete twist takes a part of it. On layers the traction is that
on a half-space: a known traction, though not quite that of a ball.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Floats, isotropic_constants
from palpate.errors import InvalidInput
from palpate.sensing import AreaArray
from palpate.sensing.grids import LineGrid
from palpate.skin import Skin
from palpate.solutions import hertz_line, hertz_point
from palpate.units import is_number

__all__ = ["Frame", "Stage", "demonstration", "handling", "stream"]


@dataclass(frozen=True)
class Stage:
    """A stage of a simulated stream. It states the force and motion at its end; they change linearly in time from the previous stage.

    Parameters
    ----------
    name : str
    duration : float
        [s]
    force : float
        Normal force at the end [N], or [N/m] on a line.
    drag : float
        Tangential force at the end over friction times normal force, 0 to 1; at 1 the contact slides from the stage's start.
    twist : float
        Twist at the end of the stage as a fraction of the twist at which the contact slides, -1 to 1.
    move : (float, float)
        Distance that the contact moves in this stage, x and y [m].
    direction : float
        Direction of the drag [rad from +x].
    """

    name: str
    duration: float
    force: float
    drag: float = 0.0
    twist: float = 0.0
    move: tuple[float, float] = (0.0, 0.0)
    direction: float = 0.0

    def __post_init__(self) -> None:
        if not (self.duration > 0 and self.force >= 0 and 0 <= self.drag <= 1 and -1 <= self.twist <= 1):
            raise InvalidInput(
                f"stage {self.name!r}: duration must be positive, force not negative, drag within 0 and 1, twist within -1 and 1."
            )


@dataclass(frozen=True)
class Frame:
    """One frame of a simulated stream, with the true traction.

    ``readings`` (channel, *array), or a list with one per plane; ``traction`` (component, *surface) [Pa]; ``stick``:
    radius of the part that sticks over that of the contact (1: all, 0: it slides); NaN without contact.
    """

    time: float
    readings: object
    traction: Floats
    stage: str
    stick: float

    @property
    def sliding(self) -> bool:
        """Whether the whole contact slides."""
        return self.stick == 0.0


def handling(force: float, reach: float = 2e-3) -> list[Stage]:
    """Return the stages rest, press, roll, twist, shear until it slides, and lift: a sequence of about 6 s.

    ``force`` is the largest normal force [N or N/m]; ``reach`` [m] is the distance that the contact rolls and slides.
    """
    return [
        Stage("rest", 0.5, 0.0),
        Stage("press", 0.6, force),
        Stage("hold", 0.4, force),
        Stage("roll", 0.8, force, move=(reach, 0.5 * reach)),
        Stage("twist", 0.5, 0.8 * force, twist=0.7),
        Stage("untwist", 0.5, 0.8 * force),
        Stage("shear", 1.2, 0.8 * force, drag=0.98, direction=math.pi),
        Stage("slip", 0.6, 0.8 * force, drag=1.0, move=(-1.5 * reach, 0.0), direction=math.pi),
        Stage("lift", 0.5, 0.0, drag=1.0, direction=math.pi),
        Stage("rest", 0.5, 0.0),
    ]


#: Coefficient of friction of the fingertip in the demonstration.
DEMONSTRATED = 0.6


def demonstration() -> tuple[Skin, Callable[[], Iterator[tuple[float, Floats]]]]:
    """Return the skin of a robot's fingertip, and a source of (time [s], readings) that repeats the demonstration.

    16 x 16 taxels of shear and normal stress, 1.2 mm apart, 2 mm under silicone; 1 % noise; friction `DEMONSTRATED`. Each source plays the stages of `handling` once, with different noise.
    """
    pad = HalfSpace(youngs_modulus=2.0e5, poissons_ratio=0.48)
    array = AreaArray(shape=(16, 16), pitch=1.2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = Skin(pad, array)
    story = list(
        stream(skin, handling(1.2, 2.5e-3), friction=DEMONSTRATED, radius=15e-3, rate=60.0, start=(-2e-3, 0.0))
    )
    size = 0.01 * max(float(np.abs(np.asarray(f.readings)).max()) for f in story)
    rng = np.random.default_rng(0)

    def source() -> Iterator[tuple[float, Floats]]:
        for frame in story:
            yield frame.time, np.asarray(frame.readings) + size * rng.standard_normal((3, 16, 16))

    return skin, source


def stream(
    skin: Skin,
    stages: Sequence[Stage],
    *,
    friction: float,
    radius: float,
    rate: float = 100.0,
    start: tuple[float, float] = (0.0, 0.0),
    rng: np.random.Generator | None = None,
) -> Iterator[Frame]:
    """Yield the frames of consecutive stages.

    Parameters
    ----------
    skin : Skin
    stages : sequence of Stage
    friction : float
        Coefficient mu.
    radius : float
        Radius of the ball or cylinder [m].
    rate : float
        Frames a second.
    start : (float, float)
        Position x and y of the contact at the start [m].
    rng : numpy Generator, optional
        Adds the arrays' own noise.
    """
    for name, value in (("friction", friction), ("radius", radius), ("rate", rate)):
        if not (is_number(value) and value > 0):
            raise InvalidInput(f"{name} must be a positive number; got {value!r}.")
    x, y = start
    force = drag = twist = 0.0
    index = 0
    begun = 0.0
    for stage in stages:
        while index / rate < begun + stage.duration:
            s = (index / rate - begun) / stage.duration
            now = Stage(
                stage.name,
                stage.duration,
                force + s * (stage.force - force),
                1.0 if stage.drag == 1.0 else drag + s * (stage.drag - drag),
                twist + s * (stage.twist - twist),
                direction=stage.direction,
            )
            place = (x + s * stage.move[0], y + s * stage.move[1])
            traction, stick = _traction(skin, now, place, friction, radius)
            yield Frame(index / rate, skin.sense(traction, rng=rng), traction, stage.name, stick)
            index += 1
        begun += stage.duration
        x, y, force, drag, twist = x + stage.move[0], y + stage.move[1], stage.force, stage.drag, stage.twist


def _traction(
    skin: Skin, now: Stage, place: tuple[float, float], friction: float, radius: float
) -> tuple[Floats, float]:
    grid = skin.surface
    traction: Floats = np.zeros((len(grid.components), *grid.shape))
    if now.force <= 0:
        return traction, math.nan
    modulus, nu = isotropic_constants(skin.operator.pad, 0.0)
    modulus = modulus / (1.0 - nu**2)
    line = isinstance(grid, LineGrid)
    slides = now.drag == 1.0
    if line:
        half = 2.0 * math.sqrt(now.force * radius / (math.pi * modulus))
        contact = hertz_line(half_width=half, force=now.force)
        push = friction * now.drag * now.force * (1.0 if math.cos(now.direction) >= 0 else -1.0)
        if slides:
            contact = contact.sliding(math.copysign(friction, push))
        elif push:
            contact = contact.partial_slip(friction, push)
        stick = math.sqrt(max(1.0 - now.drag, 0.0))
        return skin.sample(contact.shifted(place[0])), 0.0 if slides else stick
    a = (0.75 * now.force * radius / modulus) ** (1.0 / 3.0)
    ball = hertz_point(contact_radius=a, force=now.force)
    if slides:
        ball = ball.sliding(friction, direction=now.direction)
    elif now.drag:
        ball = ball.partial_slip(friction, friction * now.drag * now.force, direction=now.direction)
    traction = skin.sample(ball.shifted(*place))
    if now.twist:
        yy, xx = np.meshgrid(*grid.axes, indexing="ij")
        dx, dy = xx - place[0], yy - place[1]
        size = friction * traction[2] * now.twist / np.maximum(np.hypot(dx, dy), 1e-12)
        traction[0] -= size * dy
        traction[1] += size * dx
        limit = friction * traction[2]
        excess = np.maximum(np.hypot(traction[0], traction[1]) / np.maximum(limit, 1e-300), 1.0)
        traction[:2] /= excess
    stick = 0.0 if slides or abs(now.twist) >= 1.0 else (1.0 - now.drag) ** (1.0 / 3.0)
    return traction, stick
