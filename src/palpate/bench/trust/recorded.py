"""Rows of recordings that begin with frames at rest, with defects of sensors that no elastic pad has.

Each case has 30 frames at rest for the zero, then frames up to the one that is judged. Raw readings have a separate
offset in every taxel, except in rows that need the ends of the range.

A result is right if its interval contains the true force. Special cases:
- all readings at the end of their range: right if the truth is above the lower end and the upper end is open, or if the frame is marked as unknown; a finite upper end counts as far outside;
- a press wider than the array: any force between that on the array and that of the whole press is right;
- a frozen patch, zeros after a press: the right result is that nothing touches any more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np

from palpate.bench.trust.presses import Load, plain_ball, random_load
from palpate.bench.trust.sensors import Sensor, random_sensor
from palpate.elastic.pad import Floats

__all__ = ["RATE", "REST", "Case", "Recorded"]

#: Number of frames at rest, and frames per second.
REST, RATE = 30, 30.0
#: Range of the standard deviation of the noise, as a fraction of the largest reading.
_NOISE = (1e-3, 0.03)
_EDGE = Path(__file__).with_name("pad_edge.npz")


@dataclass(frozen=True)
class Recorded:
    """Readings as they were recorded.

    Attributes
    ----------
    rest : array (frame, channel, *array)
        Nothing touches.
    steps : array (frame, channel, *array)
        The frames after those at rest; the last one is judged.
    times : array (frame,)
        The sensor's clock [s], of rest and steps.
    clean : array (frame, channel, *array)
        The same sensor pressed by a ball, without anything wrong.
    road : str
        "reconstruct": the last frame by itself; "track": one frame after another; "table": the same, out of a file.
    """

    rest: Floats
    steps: Floats
    times: Floats
    clean: Floats
    road: str


@dataclass
class Case:
    """A recording under construction, and the truth of its last frame."""

    rng: np.random.Generator
    sensor: Sensor
    load: Load
    readings: Floats
    words: list[str] = field(default_factory=list)
    friction: float | None = None
    typical: Load = field(init=False)
    least: Load | None = None
    limits: float | None = None
    open_above: bool = False
    recorded: Recorded = field(init=False)

    def __post_init__(self) -> None:
        self.typical = self.load
        self.peak = float(np.abs(self.readings).max())
        level = float(np.exp(self.rng.uniform(*np.log(_NOISE))))
        self.std = np.full((len(self.readings), *(1,) * len(self.sensor.shape)), level * self.peak)
        self.offset = np.zeros_like(self.readings)
        self.words.append(f"noise {level:.2g} of the largest reading")

    def raw(self) -> None:
        """Give every reading its own offset."""
        scale = self.peak * float(np.exp(self.rng.uniform(math.log(0.1), math.log(10.0))))
        self.offset = scale * self.rng.uniform(-1.0, 1.0, self.readings.shape)

    def frames(self, levels: Floats, readings: Floats | None = None) -> Floats:
        """Return raw frames at these fractions of the load."""
        full = self.readings if readings is None else readings
        clean = np.multiply.outer(levels, full)
        return clean + self.offset + self.std * self.rng.standard_normal(clean.shape)

    def record(self, rest: Floats, steps: Floats, road: str, times: Floats | None = None) -> Case:
        """Finish the recording, and add a clean press of the same sensor."""
        ball = plain_ball(self.sensor, float(np.abs(self.typical.traction).max()))
        readings = sensed(self.sensor, ball)
        if self.limits is not None:  # the clean frame must be within the range
            readings *= 0.7 * self.limits / float(np.abs(readings).max())
        clean = self.frames(_press(5, 5), readings)
        if times is None:
            times = np.arange(len(rest) + len(steps)) / RATE
        self.recorded = Recorded(rest, steps, times, clean, road)
        return self

    def nothing_touches(self) -> None:
        self.load = Load(self.load.grid, np.zeros_like(self.load.traction), "nothing touches any more")


def sensed(sensor: Sensor, load: Load) -> Floats:
    """Return readings (channel, *array) without noise."""
    return np.array(sensor.skin(surface=load.grid).sense(load.traction))


def _press(ramp: int, hold: int) -> Floats:
    """Return levels of a load that grows and then stays constant."""
    return np.r_[np.arange(1, ramp + 1) / ramp, np.ones(hold)]


def _pressed(rng: np.random.Generator, suits: Callable[[Sensor], bool]) -> Case:
    """Return a random sensor and a random contact on it."""
    sensor = random_sensor(rng, suits)
    mu = float(rng.uniform(0.2, 0.9))
    load = random_load(rng, sensor, friction=mu, axes=sensor.shears)
    case = Case(rng, sensor, load, sensed(sensor, load))
    if sensor.shears and rng.random() < 0.5:
        case.friction = mu
    return case


def _any_road(rng: np.random.Generator) -> str:
    return str(rng.choice(["reconstruct", "track"]))


def _held(case: Case, readings: Floats) -> Case:
    """Return the recording of a load: at rest, pressed and held."""
    case.raw()
    steps = case.frames(_press(int(case.rng.integers(3, 9)), 5), readings)
    return case.record(case.frames(np.zeros(REST)), steps, _any_road(case.rng))


def _small(sensor: Sensor) -> bool:
    return len(sensor.shape) == 2 and max(sensor.shape) <= 9


def _sees_depth(sensor: Sensor) -> bool:
    return len(sensor.shape) == 2 and sensor.channels == ("displacement_x", "displacement_y", "displacement_z")


def _stress(sensor: Sensor) -> bool:
    return sensor.sensing == "stress"


# -- readings that no elastic model fits ---------------------------------------------------------------------------------


def uneven_gains(rng: np.random.Generator) -> Case:
    case = _pressed(rng, lambda s: True)
    case.words.append("gains spread by 30 %")
    gains = np.clip(1.0 + 0.3 * rng.standard_normal(case.readings.shape), 0.1, None)
    return _held(case, gains * case.readings)


@cache
def _edge_table() -> tuple[Floats, Floats]:
    with np.load(_EDGE) as table:
        return table["contacts"].astype(np.float64), table["readings"].astype(np.float64)


def pad_edge(rng: np.random.Generator) -> Case:
    """A ball whose rim is half to one thickness away from the pad's side (`benchmarks/pad_edge.py`)."""
    contacts, table = _edge_table()
    thickness, modulus = float(rng.uniform(2e-3, 6e-3)), float(np.exp(rng.uniform(math.log(5e4), math.log(1e6))))
    channels: tuple[str, ...] = ("stress_xz", "stress_yz", "stress_zz")
    which = int(rng.integers(len(contacts)))
    center, radius = contacts[which, :2] * thickness, float(contacts[which, 2]) * thickness
    sheared = rng.random() < 0.6
    drag = float(rng.uniform(0.0, 0.6)) if sheared else 0.0
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    pull = np.array([drag * math.cos(angle), drag * math.sin(angle), 1.0])
    readings = np.einsum("d,dcyx->cyx", pull, table[which])
    # the side may be any of the four
    if rng.random() < 0.5:
        readings, center[0], pull[0] = readings[:, :, ::-1].copy(), -center[0], -pull[0]
        readings[0] *= -1.0
    if rng.random() < 0.5:
        readings, center, pull = (
            readings.transpose(0, 2, 1)[[1, 0, 2]].copy(),
            center[::-1].copy(),
            pull[[1, 0, 2]],
        )
    if not sheared:
        channels, readings = channels[2:], readings[2:]
    sensor = Sensor(
        "area", (5, 5), 0.75 * thickness, thickness, 0.0, channels, modulus, 0.48, layers=((thickness, 1.0),)
    )
    force = float(rng.uniform(0.01, 0.15)) * modulus * math.pi * radius**2 * 2.0 / 3.0
    grid = sensor.fine_grid(center - 1.05 * radius, center + 1.05 * radius, 12)
    y, x = (np.arange(-1, 2) / 3 * h + a[:, None] for a, h in zip(grid.axes, grid.spacings))
    inside = 1.0 - ((x.ravel()[None, :] - center[0]) ** 2 + (y.ravel()[:, None] - center[1]) ** 2) / radius**2
    shape = np.sqrt(np.clip(inside, 0.0, None)).reshape(grid.shape[0], 3, grid.shape[1], 3).mean(axis=(1, 3))
    traction = np.multiply.outer(pull, force * shape / (shape.sum() * grid.cell))
    case = Case(rng, sensor, Load(grid, traction, "ball near the pad's edge"), force / thickness**2 * readings)
    case.words.append("the pad ends half to one thickness from the contact")
    if sheared and rng.random() < 0.5:
        case.friction = max(0.3, 1.2 * drag)
    return _held(case, case.readings)


def lattice(rng: np.random.Generator) -> Case:
    """Simulate a printed lattice: its struts carry more than the gaps between them, and lean."""
    case = _pressed(rng, lambda s: _stress(s) and len(s.shape) == 2)
    sensor = case.sensor
    depth, period = float(rng.uniform(0.25, 0.5)), sensor.pitch * float(rng.uniform(1.3, 3.0))
    case.words.append(f"a lattice of {period / sensor.pitch:.1f} pitches carries {100 * depth:.0f} % more or less")
    y, x = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * sensor.pitch for n in sensor.shape), indexing="ij")
    a, b = (2.0 * math.pi * v / period + float(rng.uniform(0.0, 2.0 * math.pi)) for v in (x, y))
    lean = {"stress_xz": np.sin(a) * np.cos(b), "stress_yz": np.cos(a) * np.sin(b)}
    normal = case.readings[sensor.channels.index("stress_zz")]
    readings = case.readings * (1.0 + depth * np.cos(a) * np.cos(b))
    for i, name in enumerate(sensor.channels):
        if name in lean:
            readings[i] += 0.2 * depth * normal * lean[name]
    return _held(case, readings)


# -- loads that readings do not determine --------------------------------------------------------------------------------


def _wide(
    rng: np.random.Generator, suits: Callable[[Sensor], bool], low: float, high: float
) -> tuple[Sensor, Load, Load]:
    """A sensor, a press whose half-width is ``low`` to ``high`` of the array's, and its part on the array."""
    sensor = random_sensor(rng, suits)
    half = 0.5 * sensor.pitch * np.array(sensor.shape[::-1], dtype=np.float64)
    block = rng.random() < 0.5
    wider = float(np.exp(rng.uniform(math.log(low), math.log(high))))
    # choose the ball so that it covers the corners too
    reach = wider * (half if block else np.full(len(half), float(np.hypot.reduce(half))))
    grid = sensor.fine_grid(-reach, reach, 3)
    axes = np.meshgrid(*grid.axes, indexing="ij")[::-1]
    pressure = np.ones(grid.shape)
    if not block:
        pressure = np.sqrt(np.clip(1.0 - sum((a / r) ** 2 for a, r in zip(axes, reach)), 0.0, None))
    pressure *= sensor.modulus * float(np.exp(rng.uniform(math.log(0.01), math.log(0.15))))
    traction = np.zeros((len(half) + 1, *grid.shape))
    traction[-1] = pressure
    over = np.all([np.abs(a) <= h for a, h in zip(axes, half)], axis=0)
    words = f"{'block' if block else 'ball'}, {reach.max() / half.max():.1f} times as wide as the array"
    return sensor, Load(grid, traction, words), Load(grid, traction * over, words)


def all_at_their_end(rng: np.random.Generator) -> Case:
    """Put every reading at the end of its range, which the sensor states."""
    sensor, load, least = _wide(rng, lambda s: s.channels == ("stress_zz",), 1.0, 2.0)
    case = Case(rng, sensor, load, sensed(sensor, load))
    smallest = float(case.readings.min())
    case.limits = float(rng.uniform(0.1, 0.8)) * (smallest if smallest > 0 else 0.1 * case.peak)
    case.std = np.minimum(case.std, 0.02 * case.limits)
    case.readings = np.maximum(case.readings, 1.2 * case.limits)
    case.words.append(f"all readings at their end, {case.limits / case.peak:.2g} of the largest load")
    case.least, case.open_above = least, True
    steps = np.minimum(case.frames(_press(int(rng.integers(3, 9)), 5)), case.limits)
    return case.record(case.frames(np.zeros(REST)), steps, _any_road(rng))


def even_press(rng: np.random.Generator) -> Case:
    """Simulate an even press that goes on beyond the array; without the zero it would look like an offset."""
    sensor, load, least = _wide(rng, lambda s: _stress(s) and "stress_zz" in s.channels, 1.2, 5.0)
    case = Case(rng, sensor, load, sensed(sensor, load))
    case.words.append("pressed evenly and beyond the array")
    case.least = least
    return _held(case, case.readings)


def wide_press(rng: np.random.Generator) -> Case:
    """Simulate a press about as wide as the array, on a zeroed skin."""
    sensor, load, least = _wide(rng, lambda s: _stress(s) and "stress_zz" in s.channels, 0.6, 1.2)
    case = Case(rng, sensor, load, sensed(sensor, load))
    case.least = least
    return _held(case, case.readings)


def shallow_taxels(rng: np.random.Generator) -> Case:
    """Press taxels that lie 0.1 to 0.5 pitches deep: nothing measures the pressure between them."""
    sensor = random_sensor(rng, _stress)
    sensor = replace(sensor, depth=sensor.pitch * float(rng.uniform(0.1, 0.5)), aperture=0.0)
    load = random_load(rng, sensor, friction=0.5, axes=sensor.shears, small=True)
    case = Case(rng, sensor, load, sensed(sensor, load))
    return _held(case, case.readings)


# -- changes over time ---------------------------------------------------------------------------------------------------


def drift_after_zero(rng: np.random.Generator) -> Case:
    """Shift one channel, or all, by 1 to 20 % of the largest reading after the zero was taken."""
    case = _pressed(rng, lambda s: True)
    case.raw()
    rest, before = case.frames(np.zeros(REST)), case.offset
    part = float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(math.log(0.01), math.log(0.2))))
    which = int(rng.integers(len(case.readings) + 1))
    channels = slice(None) if which == len(case.readings) else slice(which, which + 1)
    case.offset = before.copy()
    case.offset[channels] += part * case.peak
    name = "all channels" if which == len(case.readings) else case.sensor.channels[which]
    case.words.append(f"{name} shifted by {100 * part:.2g} % of the largest reading after the zero")
    steps = case.frames(_press(int(rng.integers(3, 9)), 5))
    case.offset = before
    return case.record(rest, steps, _any_road(rng))


def frozen_patch(rng: np.random.Generator) -> Case:
    """Keep a patch of taxels at the exact values of its press after the press has ended."""
    case = _pressed(rng, lambda s: _small(s) and min(s.shape) >= 6 and s.sensing != "displacement")
    case.raw()
    rest = case.frames(np.zeros(REST))
    ramp, release = (int(n) for n in rng.integers(3, 7, size=2))
    gone = int(rng.integers(3, 10))
    levels = np.r_[_press(ramp, 8), np.arange(release - 1, 0, -1) / release, np.zeros(gone)]
    steps = case.frames(levels)
    size = rng.integers(2, 4, size=2)
    top = np.unravel_index(int(np.abs(case.readings[-1]).argmax()), case.sensor.shape)
    low = [int(np.clip(t - rng.integers(n), 0, whole - n)) for t, n, whole in zip(top, size, case.sensor.shape)]
    patch = (slice(None), *(slice(a, a + int(n)) for a, n in zip(low, size)))
    full = ramp + 7
    for k in range(full + 1, len(steps)):
        steps[k][patch] = steps[full][patch]
    case.words.append(f"{size[0]} x {size[1]} taxels frozen for {(len(steps) - 1 - full) / RATE:.1f} s after a press")
    case.nothing_touches()
    return case.record(rest, steps, "track")


def zeros_after_press(rng: np.random.Generator) -> Case:
    """Simulate a sensor that writes exactly 0 without contact, up to two seconds late; at rest rounding or noise."""
    # depth cameras do so
    case = _pressed(rng, _sees_depth if rng.random() < 0.5 else _small)
    after, ramp = int(rng.integers(5, 61)), int(rng.integers(2, 7))
    levels = np.r_[_press(int(rng.integers(3, 13)), int(rng.integers(5, 61))), np.arange(ramp - 1, 0, -1) / ramp]
    pressed = case.frames(levels)
    noise = case.std * rng.standard_normal((REST, *case.readings.shape))
    at_rest = str(rng.choice(["exactly 0", "rounded", "noise"]))
    step = 3.0 * case.std  # with this step a few readings at rest differ from 0
    rest = {"exactly 0": np.zeros_like(noise), "rounded": np.round(noise / step) * step, "noise": noise}[at_rest]
    if at_rest == "rounded":
        pressed = np.round(pressed / step) * step
    steps = np.concatenate([pressed, np.zeros((after, *case.readings.shape))])
    case.words.append(f"{at_rest} at rest, exactly 0 for {after / RATE:.1f} s after a press")
    case.nothing_touches()
    return case.record(rest, steps, str(rng.choice(["track", "track", "reconstruct"])))


def restarted_clock(rng: np.random.Generator) -> Case:
    """Make time stamps restart, wrap, jump, be whole seconds or swap, in a stream or table of right readings."""
    case = _pressed(rng, _small)
    case.raw()
    rest, steps = case.frames(np.zeros(REST)), case.frames(_press(int(rng.integers(5, 12)), int(rng.integers(8, 20))))
    count = len(rest) + len(steps)
    times = np.arange(count) / RATE
    at = int(rng.integers(REST + 1, count - 2))
    kind = str(rng.choice(["restarts", "wraps", "goes wild once", "counts whole seconds", "swaps two frames"]))
    if kind == "restarts":
        times[at:] -= times[at]
    elif kind == "wraps":  # a 16-bit counter of milliseconds
        times = np.mod(65.536 - times[at] + times, 65.536)
    elif kind == "goes wild once":
        times[at] = float(rng.choice([1e9, -1e9, 0.0]))
    elif kind == "counts whole seconds":
        times = np.floor(times)
    else:
        times[[at, at + 1]] = times[[at + 1, at]]
    case.words.append(f"the clock {kind} at frame {at}")
    return case.record(rest, steps, str(rng.choice(["track", "table", "table"])), times)
