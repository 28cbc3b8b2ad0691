"""Contacts, closed forms and faults of `streams.py`: streams of frames whose readings do not come from palpate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from large_frames import displacements, stresses
from scipy import interpolate, special

Floats = np.ndarray
Rng = np.random.Generator

SIZES = (3, 4, 4, 5, 6, 6, 8, 8, 10, 12, 16, 24)

# ---------------------------------------------------------------------------------------------------------------- contacts


@dataclass(frozen=True)
class Place:
    """Where a contact is, and the shape of its pressure."""

    shape: str
    x: float
    y: float
    a: float
    b: float
    angle: float = 0.0

    @property
    def area(self) -> float:
        return (4.0 if self.shape == "block" else math.pi) * self.a * self.b

    def points(self, spacing: float) -> tuple[Floats, Floats, Floats]:
        """x, y and share of the force of each point load of a lattice."""
        counts = [int(np.clip(math.ceil(2 * half / spacing), 8, 16)) for half in (self.a, self.b)]
        u, v = (g.ravel() for g in np.meshgrid(*((np.arange(c) + 0.5) / c * 2 - 1 for c in counts)))
        r2 = u * u + v * v
        weight = np.ones_like(r2)
        if self.shape == "ball":
            weight = np.sqrt(np.clip(1 - r2, 0, None))
        if self.shape == "punch":
            weight = np.where(r2 < 1, 1 / np.sqrt(np.clip(1 - 0.9 * r2, 0.1, None)), 0.0)
        on = weight > 0
        u, v, weight = u[on] * self.a, v[on] * self.b, weight[on] / weight[on].sum()
        c, s = math.cos(self.angle), math.sin(self.angle)
        return self.x + c * u - s * v, self.y + s * u + c * v, weight


@dataclass
class Load:
    """A contact in one frame: its place and its force (F_x, F_y, F_z) on the pad [N]."""

    place: Place
    force: Floats


@dataclass(frozen=True)
class Sensor:
    n: int
    pitch: float
    depth: float
    aperture: float
    channels: tuple[str, ...]
    modulus: float
    nu: float
    bonded: bool

    @property
    def side(self) -> float:
        return self.n * self.pitch

    @property
    def shear(self) -> bool:
        return len(self.channels) == 3 and not self.bonded

    def unit(self, place: Place) -> Floats:
        """Readings of a unit force along x, y and z: (force, channel, y, x)."""
        px, py, weight = place.points(self.depth / 2)
        t = (np.arange(self.n) - (self.n - 1) / 2) * self.pitch
        nodes = [-0.5 / math.sqrt(3) * self.aperture, 0.5 / math.sqrt(3) * self.aperture] if self.aperture else [0.0]
        found = np.zeros((3, 3, self.n, self.n))
        for dy in nodes:
            for dx in nodes:
                x, y = np.broadcast_arrays((t + dx)[None, :, None] - px, (t + dy)[:, None, None] - py)
                for axis in range(3):
                    force = np.zeros((3, weight.size))
                    force[axis] = weight
                    found[axis] += self._field(x, y, force) / len(nodes) ** 2
        return found[:, [2]] if len(self.channels) == 1 else found

    def _field(self, x: Floats, y: Floats, force: Floats) -> Floats:
        if self.bonded:
            return at_base(x, y, self.depth, force[2])
        if self.channels[0].startswith("displacement"):
            return displacements(x, y, self.depth, force, self.modulus / (2 * (1 + self.nu)), self.nu)
        return stresses(x, y, self.depth, force)


@cache
def _base() -> tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]:
    """Normal and shear stress at the base of an incompressible bonded layer of thickness 1, by the distance from a unit normal force."""
    r = np.concatenate([np.linspace(0, 8, 801), np.linspace(8.1, 100, 400)])
    q = np.linspace(0, 30, 12001)
    cosh, sinh = np.cosh(q), np.sinh(q)
    normal = (cosh + q * sinh) / (cosh**2 + q**2)
    shear = q * cosh / (cosh**2 + q**2)
    zz = np.array([np.trapezoid(q * normal * special.j0(q * s), q) for s in r]) / (2 * math.pi)
    rz = np.array([np.trapezoid(q * shear * special.j1(q * s), q) for s in r]) / (2 * math.pi)
    zz[r > 15], rz[r > 15] = 0.0, 0.0
    return interpolate.CubicSpline(r, zz), interpolate.CubicSpline(r, rz)


def at_base(x: Floats, y: Floats, h: float, force: Floats) -> Floats:
    """(s_xz, s_yz, s_zz) at the base of a bonded incompressible layer of thickness h, summed over the last axis."""
    zz, rz = _base()
    r = np.hypot(x, y) / h
    across = rz(r) / np.maximum(r, 1e-9) / h**3 * force
    return np.array([(across * x).sum(-1), (across * y).sum(-1), (zz(r) * force).sum(-1) / h**2])


# ---------------------------------------------------------------------------------------------------------------- motions


@dataclass
class Scene:
    """What a motion needs to know."""

    sensor: Sensor
    frames: int
    first: int
    last: int
    strength: float

    def course(self, rng: Rng, first: int | None = None, last: int | None = None) -> Floats:
        """Force in parts of the largest: up in 2 to 8 frames, held with small changes, down in 2 to 6."""
        first, last = self.first if first is None else first, self.last if last is None else last
        k = np.arange(self.frames)
        up, down = rng.integers(2, 9), rng.integers(2, 7)
        rise = np.clip((k - first + 1) / up, 0, 1) if first > 0 else np.ones(self.frames)
        share = np.minimum(rise, np.clip((last - k) / down, 0, 1))
        wave = 1 - 0.1 * (1 - np.cos(2 * math.pi * (k - first) / rng.uniform(15, 40)))
        return np.sin(0.5 * math.pi * share) ** 2 * wave

    def place(self, rng: Rng, shape: str | None = None, size: tuple[float, float] = (0.1, 0.25)) -> Place:
        shape = shape or str(rng.choice(["ball", "ball", "punch", "block"]))
        a = self.sensor.side * math.exp(rng.uniform(*np.log(size)))
        room = max(0.45 * self.sensor.side - a, 0.0)
        x, y = rng.uniform(-room, room, 2)
        return Place(shape, x, y, a, a * rng.uniform(0.6, 1.0), rng.uniform(0, math.pi))

    def load(self, place: Place) -> float:
        return 0.6 * self.strength * place.area

    def drag(self, rng: Rng) -> Floats:
        """Shear force in parts of the normal force."""
        if not self.sensor.shear or rng.random() < 0.3:
            return np.zeros(2)
        angle = rng.uniform(0, 2 * math.pi)
        return rng.uniform(0.1, 0.6) * np.array([math.cos(angle), math.sin(angle)])


Motion = Callable[[Rng, Scene], list[list[Load]]]


def held(place: Place, force: Floats, drag: Floats, shear: Floats) -> list[list[Load]]:
    return [[Load(place, np.array([*(drag * s * f), f]))] if f else [] for f, s in zip(force, shear, strict=True)]


def press(rng: Rng, scene: Scene) -> list[list[Load]]:
    place = scene.place(rng)
    force = scene.load(place) * scene.course(rng)
    shear = np.clip((np.arange(scene.frames) - scene.first - 6) / 10, 0, 1)
    return held(place, force, scene.drag(rng), shear)


def moved(rng: Rng, scene: Scene, place: Place, turn: float, far: float, drag: Floats) -> list[list[Load]]:
    share = np.clip((np.arange(scene.frames) - scene.first - 8) / max(scene.last - scene.first - 16, 1), 0, 1)
    angle = rng.uniform(0, 2 * math.pi) if not drag.any() else math.atan2(drag[1], drag[0])
    step = far * scene.sensor.side * np.array([math.cos(angle), math.sin(angle)])
    force = scene.load(place) * scene.course(rng)
    found: list[list[Load]] = []
    for f, s in zip(force, share, strict=True):
        x, y = place.x + (s - 0.5) * step[0], place.y + (s - 0.5) * step[1]
        at = Place(place.shape, x, y, place.a, place.b, place.angle + turn * s)
        found.append([Load(at, np.array([*(drag * f * min(1.0, 8 * s)), f]))] if f else [])
    return found


def slide(rng: Rng, scene: Scene) -> list[list[Load]]:
    place = scene.place(rng, size=(0.1, 0.18))
    place = Place(place.shape, 0.3 * place.x, 0.3 * place.y, place.a, place.b, place.angle)
    return moved(rng, scene, place, 0.0, rng.uniform(0.2, 0.4), scene.drag(rng))


def rotate(rng: Rng, scene: Scene) -> list[list[Load]]:
    place = scene.place(rng, shape=str(rng.choice(["ball", "block"])), size=(0.2, 0.3))
    place = Place(place.shape, place.x, place.y, place.a, 0.4 * place.a, place.angle)
    return moved(rng, scene, place, rng.uniform(0.5, 3.0), 0.0, np.zeros(2))


def roll(rng: Rng, scene: Scene) -> list[list[Load]]:
    place = scene.place(rng, shape="ball", size=(0.12, 0.2))
    place = Place("ball", 0.2 * place.x, 0.2 * place.y, place.a, place.b, place.angle)
    return moved(rng, scene, place, 0.0, rng.uniform(0.3, 0.5), np.zeros(2))


def two(rng: Rng, scene: Scene) -> list[list[Load]]:
    found: list[list[Load]] = [[] for _ in range(scene.frames)]
    angle, far = rng.uniform(0, 2 * math.pi), 0.25 * scene.sensor.side
    for sign, late in ((1, 0), (-1, int(rng.integers(4, 15)))):
        place = scene.place(rng, size=(0.1, 0.15))
        place = Place(place.shape, sign * far * math.cos(angle), sign * far * math.sin(angle), place.a, place.b)
        force = scene.load(place) * rng.uniform(0.4, 1.0) * scene.course(rng, scene.first + late)
        drag = scene.drag(rng)
        for frame, f in zip(found, force, strict=True):
            frame += [Load(place, np.array([*(drag * f), f]))] if f else []
    return found


def slowly(rng: Rng, scene: Scene) -> list[list[Load]]:
    place = scene.place(rng)
    k = np.arange(scene.frames)
    share = np.clip((k - scene.first) / (scene.last - 8 - scene.first), 0, 1) * (k < scene.last)
    return held(place, scene.load(place) * share, scene.drag(rng), np.ones(scene.frames))


def taps(rng: Rng, scene: Scene) -> list[list[Load]]:
    found: list[list[Load]] = [[] for _ in range(scene.frames)]
    for start in np.arange(scene.first, scene.last - 3, 9):
        place, drag = scene.place(rng), scene.drag(rng)
        f = scene.load(place) * rng.uniform(0.5, 1.0)
        for k in range(start, start + int(rng.integers(1, 3))):
            found[k] = [Load(place, np.array([*(drag * f), f]))]
    return found


def beyond(rng: Rng, scene: Scene) -> list[list[Load]]:
    place = scene.place(rng, size=(0.12, 0.3))
    x = float(rng.choice([-1, 1])) * scene.sensor.side * 0.5 - rng.uniform(-0.3, 0.5) * place.b
    place = Place(place.shape, x, place.y, place.a, place.b, place.angle)
    return held(place, scene.load(place) * scene.course(rng), scene.drag(rng), np.ones(scene.frames))


def adhesion(rng: Rng, scene: Scene) -> list[list[Load]]:
    found = press(rng, scene)
    place = next(frame[0].place for frame in found if frame)
    core = Place(place.shape, place.x, place.y, 0.7 * place.a, 0.7 * place.b, place.angle)
    pull = rng.uniform(0.1, 0.35) * scene.load(place)
    for k in range(scene.last - 1, min(scene.last + 4, scene.frames)):
        found[k] = [Load(core, np.array([0.0, 0.0, -pull]))]
    return found


def rest(rng: Rng, scene: Scene) -> list[list[Load]]:
    return [[] for _ in range(scene.frames)]


def some(rng: Rng, scene: Scene) -> list[list[Load]]:
    return [press, press, slide, two, rotate][int(rng.integers(5))](rng, scene)


# ---------------------------------------------------------------------------------------------------------------- faults


@dataclass
class Stream:
    """What the tracker is given, and what is true."""

    sensor: Sensor
    rate: float
    readings: Floats
    clean: Floats
    force: Floats
    rest: Floats
    noise: float
    given: float | None
    largest: float
    zero: int
    first: int
    last: int
    times: Floats
    limits: tuple[float, float] | None = None
    dropped: list[int] = field(default_factory=list)

    def during(self, rng: Rng) -> int:
        """A frame in contact."""
        return int(rng.integers(self.first + 8, self.last - 10))

    def taxel(self, rng: Rng) -> tuple[int, int, int]:
        """A reading: three times in four a large one."""
        size = np.abs(self.clean).max(0)
        if rng.random() < 0.75 and size.any():
            c, y, x = np.unravel_index(int(rng.choice(np.argsort(size, axis=None)[-3:])), size.shape)
        else:
            c, y, x = (rng.integers(s) for s in size.shape)
        return int(c), int(y), int(x)

    def channel(self, rng: Rng) -> int:
        return int(rng.integers(len(self.sensor.channels)))

    def amount(self, rng: Rng, low: float = 0.05, high: float = 0.3) -> float:
        return float(rng.choice([-1, 1]) * rng.uniform(low, high) * self.largest)

    @property
    def since(self) -> Floats:
        """Seconds since the zero (or since the start) for each frame, shaped like the readings."""
        return (np.maximum(np.arange(len(self.readings)) - self.zero, 0) / self.rate)[:, None, None, None]


Fault = Callable[[Stream, Rng], None]


def nothing(s: Stream, rng: Rng) -> None:
    """Nothing but noise is wrong."""


def offset_channels(s: Stream, rng: Rng) -> None:
    """Each channel is off by 5 to 30 % of the largest reading from the start."""
    for c in range(len(s.sensor.channels)):
        s.readings[:, c] += s.amount(rng)


def offset_taxel(s: Stream, rng: Rng) -> None:
    """One reading is off by 10 to 50 % of the largest from the start."""
    s.readings[(slice(None), *s.taxel(rng))] += s.amount(rng, 0.1, 0.5)


def offset_row(s: Stream, rng: Rng) -> None:
    """One row of one channel is off by 10 to 40 % of the largest reading from the start."""
    s.readings[:, s.channel(rng), int(rng.integers(s.sensor.n))] += s.amount(rng, 0.1, 0.4)


def step_contact(s: Stream, rng: Rng) -> None:
    """One channel, or all, jumps by 5 to 30 % of the largest reading in contact."""
    k, size = s.during(rng), s.amount(rng)
    if rng.random() < 0.5:
        s.readings[k:] += size
    else:
        s.readings[k:, s.channel(rng)] += size


def step_rest(s: Stream, rng: Rng) -> None:
    """One channel, or all, jumps by 5 to 30 % of the largest reading some frames before contact."""
    k, size = s.first - int(rng.integers(3, 6)), s.amount(rng)
    if rng.random() < 0.5:
        s.readings[k:] += size
    else:
        s.readings[k:, s.channel(rng)] += size


def step_taxel(s: Stream, rng: Rng) -> None:
    """One reading jumps by 10 to 60 % of the largest in contact."""
    s.readings[(slice(s.during(rng), None), *s.taxel(rng))] += s.amount(rng, 0.1, 0.6)


def _speed(s: Stream, rng: Rng) -> float:
    return float(rng.choice([-1, 1]) * rng.choice([0.005, 0.02, 0.05]) * s.largest)


def drift_all(s: Stream, rng: Rng) -> None:
    """All readings drift by 0.5, 2 or 5 % of the largest a second."""
    s.readings += _speed(s, rng) * s.since


def drift_channel(s: Stream, rng: Rng) -> None:
    """One channel drifts by 0.5, 2 or 5 % of the largest reading a second."""
    s.readings[:, [s.channel(rng)]] += _speed(s, rng) * s.since


def drift_each(s: Stream, rng: Rng) -> None:
    """Each taxel drifts at its own rate, with a standard deviation of 0.5, 2 or 5 % of the largest reading a second."""
    s.readings += _speed(s, rng) * s.since * rng.standard_normal(s.rest.shape)


def temperature(s: Stream, rng: Rng) -> None:
    """The sensor warms up: all readings approach an offset of 5 to 20 % of the largest within a second or two; taxels differ by 10 % of this."""
    spread = 1 + 0.1 * rng.standard_normal(s.rest.shape)
    s.readings += s.amount(rng, 0.05, 0.2) * (1 - np.exp(-s.since / rng.uniform(0.5, 2.0))) * spread


def dies(s: Stream, rng: Rng) -> None:
    """One taxel reads 0 from a frame in contact on; in half of the streams all channels of this taxel."""
    c, y, x = s.taxel(rng)
    s.readings[s.during(rng) :, slice(None) if rng.random() < 0.5 else c, y, x] = 0.0


def sticks(s: Stream, rng: Rng) -> None:
    """One taxel repeats its value from a frame on, in contact or at rest."""
    c, y, x = s.taxel(rng)
    k = s.during(rng) if rng.random() < 0.5 else s.first - 2
    s.readings[k:, c, y, x] = s.readings[k, c, y, x]


def comes_back(s: Stream, rng: Rng) -> None:
    """One taxel reads 0 for 8 to 20 frames of the contact, then is right again."""
    _, y, x = s.taxel(rng)
    k = s.first + int(rng.integers(4, 10))
    s.readings[k : k + int(rng.integers(8, 20)), :, y, x] = 0.0


def saturated(s: Stream, rng: Rng) -> None:
    """Readings end at 60 to 90 % of the largest, offsets included; in half of the streams the array says so."""
    level = rng.uniform(0.6, 0.9) * s.largest
    s.readings = np.clip(s.readings, -level, level)
    s.limits = (-level, level) if rng.random() < 0.5 else None


def saturated_all(s: Stream, rng: Rng) -> None:
    """All readings are at the end of the range for 8 to 15 frames of the contact."""
    k, level = s.first + 6, 1.5 * float(np.abs(s.readings).max())
    s.readings[k : k + int(rng.integers(8, 16))] = level
    s.limits = (-level, level) if rng.random() < 0.5 else None


def gain_channel(s: Stream, rng: Rng) -> None:
    """The gain of one channel is wrong by 10 or 30 %."""
    c = s.channel(rng)
    s.readings[:, c] += float(rng.choice([-0.3, -0.1, 0.1, 0.3])) * s.clean[:, c]


def gain_taxels(s: Stream, rng: Rng) -> None:
    """The gain of each reading is wrong, with a standard deviation of 10 or 30 %."""
    s.readings += float(rng.choice([0.1, 0.3])) * np.clip(rng.standard_normal(s.rest.shape), -2, 2) * s.clean


def gain_all(s: Stream, rng: Rng) -> None:
    """The gain of all readings is wrong by 30 %."""
    s.readings += float(rng.choice([-0.3, 0.3])) * s.clean


def unit(s: Stream, rng: Rng) -> None:
    """The readings come in thousandths of their unit (kPa for Pa: 1000 times too large)."""
    s.readings *= 1000.0
    s.given = None if s.given is None else 1000 * s.given


def noise_grows(s: Stream, rng: Rng) -> None:
    """The noise is five times as large from a frame in contact on."""
    k = s.during(rng)
    s.readings[k:] += math.sqrt(24) * s.noise * rng.standard_normal(s.readings[k:].shape)


def noise_misstated(s: Stream, rng: Rng) -> None:
    """The noise is given half or twice as large as it is."""
    s.given = s.noise * float(rng.choice([0.5, 2.0]))


def dropped(s: Stream, rng: Rng) -> None:
    """A third of the frames after the zero do not arrive."""
    s.dropped = [k for k in range(s.zero, len(s.readings)) if rng.random() < 1 / 3]


def time_jumps(s: Stream, rng: Rng) -> None:
    """The clock jumps ahead by 1 to 1000 s in contact."""
    s.times[s.during(rng) :] += 10 ** rng.uniform(0, 3)


def time_repeats(s: Stream, rng: Rng) -> None:
    """Six times are those of the frame before."""
    for k in rng.choice(np.arange(s.first, s.last), 6, replace=False):
        s.times[k] = s.times[k - 1]


def time_back(s: Stream, rng: Rng) -> None:
    """The clock goes back to 0 in contact; the readings go on as before."""
    k = s.during(rng)
    s.times[k:] -= s.times[k]


def missing(s: Stream, rng: Rng) -> None:
    """Three bursts of 1 to 4 frames: a channel, or 20 to 100 % of the readings, are NaN."""
    for k in rng.choice(np.arange(s.first, s.last), 3, replace=False):
        burst = s.readings[k : k + int(rng.integers(1, 5))]
        if rng.random() < 0.3:
            burst[:, s.channel(rng)] = np.nan
        else:
            burst[rng.random(burst.shape) < rng.uniform(0.2, 1.0)] = np.nan


def restart(s: Stream, rng: Rng) -> None:
    """The sensor restarts, in contact or at rest, with another zero; in half of the streams its clock goes back to 0."""
    k = s.during(rng) if rng.random() < 0.5 else s.first - 4
    each = rng.standard_normal(s.rest.shape) if rng.random() < 0.5 else rng.standard_normal((s.rest.shape[0], 1, 1))
    s.readings[k:] += s.amount(rng, 0.05, 0.2) * each
    if rng.random() < 0.5:
        s.times[k:] -= s.times[k]


def _lag(values: Floats, seconds: float, rate: float) -> Floats:
    found, state = np.zeros_like(values), np.zeros_like(values[0])
    for k, value in enumerate(values):
        state = state + (value - state) * (1 - math.exp(-1 / (rate * seconds)))
        found[k] = state
    return found


def creep(s: Stream, rng: Rng) -> None:
    """Readings of a held force change slowly by 5 to 20 %."""
    s.readings += float(rng.choice([-1, 1])) * rng.uniform(0.05, 0.2) * _lag(s.clean, rng.uniform(0.2, 1.0), s.rate)


def hysteresis(s: Stream, rng: Rng) -> None:
    """5 to 15 % of each reading follow with play: they rest until the reading has changed by 20 % of its largest."""
    share, play = rng.uniform(0.05, 0.15), 0.2 * np.abs(s.clean).max(0)
    state = np.zeros_like(s.clean[0])
    for k, value in enumerate(s.clean):
        state = np.clip(state, value - play, value + play)
        s.readings[k] += share * (state - value)


# ---------------------------------------------------------------------------------------------------------------- rows


@dataclass
class Row:
    """``zero``: whether the stream begins with frames at rest that are given as the zero; None: in two streams of three. ``knowable``: False if
    nothing in the readings shows the fault."""

    what: str
    motion: Motion
    fault: Fault = nothing
    zero: bool | None = None
    frames: int = 60
    rate: float | None = None
    knowable: bool = True
    from_start: bool = False
    zero_in_contact: bool = False

    @property
    def clean(self) -> bool:
        return self.fault is nothing and not self.zero_in_contact


ROWS = {
    "press": Row("a press and its release, after a zero", press, zero=True),
    "slide": Row("press, slide and release", slide, zero=True),
    "rotate": Row("an elongated contact turns", rotate, zero=True),
    "two": Row("a second contact begins later", two, zero=True),
    "roll": Row("a contact moves without shear", roll, zero=True),
    "slow": Row("the force grows over three seconds", slowly, zero=True, frames=90, rate=25.0),
    "taps": Row("taps of one or two frames", taps, zero=True),
    "edge": Row("the centre of the contact lies near the border of the array", beyond, zero=True),
    "adhesion": Row("the finger pulls for five frames at the release", adhesion, zero=True),
    "rest": Row("nothing touches", rest),
    "no zero": Row("frames at rest, press and release; no zero is given", some, zero=False),
    "loaded": Row("contact from the first frame on; no zero is given", some, zero=False, from_start=True),
    "loaded edge": Row("as loaded, near the border", beyond, zero=False, from_start=True),
    "zero in contact": Row("the zero is taken in contact", press, zero=True, from_start=True, zero_in_contact=True, knowable=False),
    "offset channels": Row("", some, offset_channels, zero=False),
    "offset loaded": Row("as offset channels, in contact from the first frame on", some, offset_channels, zero=False, from_start=True),
    "offset rest": Row("as offset channels; nothing touches", rest, offset_channels, zero=False),
    "offset taxel": Row("", some, offset_taxel, zero=False),
    "offset row": Row("", some, offset_row, zero=False),
    "step contact": Row("", some, step_contact),
    "step rest": Row("", some, step_rest),
    "step taxel": Row("", some, step_taxel),
    "drift all": Row("", some, drift_all, frames=120, rate=40.0),
    "drift channel": Row("", some, drift_channel, frames=120, rate=40.0),
    "drift each": Row("", some, drift_each, frames=120, rate=40.0),
    "drift rest": Row("as drift all; nothing touches", rest, drift_all, frames=120, rate=40.0),
    "temperature": Row("", some, temperature, frames=120, rate=40.0),
    "dies": Row("", some, dies),
    "sticks": Row("", some, sticks),
    "comes back": Row("", some, comes_back),
    "saturated": Row("", some, saturated),
    "saturated all": Row("", some, saturated_all),
    "gain channel": Row("", some, gain_channel),
    "gain taxels": Row("", some, gain_taxels),
    "gain all": Row("", some, gain_all, knowable=False),
    "unit": Row("", some, unit),
    "noise grows": Row("", some, noise_grows),
    "noise misstated": Row("", some, noise_misstated),
    "dropped": Row("", some, dropped),
    "time jumps": Row("", some, time_jumps),
    "time repeats": Row("", some, time_repeats),
    "time back": Row("", some, time_back),
    "missing": Row("", some, missing),
    "restart": Row("", some, restart),
    "creep": Row("", some, creep),
    "hysteresis": Row("", some, hysteresis),
}  # fmt: skip


def any_sensor(rng: Rng) -> Sensor:
    n = int(rng.choice(SIZES))
    kind = str(
        rng.choice(["stress", "normal", "displacement", "bonded", "bonded normal"], p=[0.5, 0.25, 0.1, 0.08, 0.07])
    )
    names = (
        ["displacement_x", "displacement_y", "displacement_z"]
        if kind == "displacement"
        else ["stress_xz", "stress_yz", "stress_zz"]
    )
    channels = ("stress_zz",) if "normal" in kind else tuple(names)
    pitch = 1e-3 * math.exp(rng.uniform(math.log(0.5), math.log(4.0)))
    bonded = kind.startswith("bonded")
    aperture = 0.6 * pitch if rng.random() < 0.4 and kind != "displacement" else 0.0
    nu = 0.5 if bonded else float(rng.choice([0.5, 0.48, 0.4]))
    return Sensor(n, pitch, pitch * rng.uniform(0.7, 2.0), aperture, channels, 10 ** rng.uniform(4.5, 6.0), nu, bonded)  # fmt: skip


def start(name: str, seed: int, k: int) -> Rng:
    return np.random.default_rng([seed, list(ROWS).index(name), k])


def size_of(name: str, seed: int, k: int) -> int:
    """Taxels along a side of the array of stream k."""
    return any_sensor(start(name, seed, k)).n


def make(name: str, seed: int, k: int) -> Stream:
    """Stream k of a row."""
    row = ROWS[name]
    rng = start(name, seed, k)
    sensor = any_sensor(rng)
    zeroed = bool(rng.random() < 2 / 3) if row.zero is None else row.zero
    zero = int(rng.integers(8, 16)) if zeroed else 0
    first = 0 if row.from_start else 15 + int(rng.integers(4, 7))
    last = row.frames - int(rng.integers(7, 10))
    scene = Scene(sensor, row.frames, first, last, sensor.modulus * rng.uniform(0.02, 0.08))
    story = row.motion(rng, scene)
    known: dict[Place, Floats] = {}
    clean = np.zeros((row.frames, len(sensor.channels), sensor.n, sensor.n))
    force = np.zeros((row.frames, 3))
    for t, loads in enumerate(story):
        for load in loads:
            if load.place not in known:
                known[load.place] = sensor.unit(load.place)
            clean[t] += np.tensordot(load.force, known[load.place], 1)
            force[t] += load.force
    largest = float(np.abs(clean).max())
    if not largest:
        largest = 0.02 * (sensor.pitch if sensor.channels[0].startswith("d") else sensor.modulus)
    noise = largest * math.exp(rng.uniform(math.log(0.005), math.log(0.05)))
    offsets = largest * rng.uniform(-0.5, 0.5, clean.shape[1:]) if zeroed else np.zeros(clean.shape[1:])
    readings = clean + offsets + noise * rng.standard_normal(clean.shape)
    rate = row.rate or float(rng.choice([50.0, 100.0]))
    given = noise if rng.random() < 0.5 else None
    stream = Stream(sensor, rate, readings, clean, force, offsets, noise, given, largest, zero, first, last, np.arange(row.frames) / rate)  # fmt: skip
    row.fault(stream, rng)
    return stream
