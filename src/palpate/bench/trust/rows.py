"""The rows of the table: defects of the readings, of the description of the sensor, or of the load.

Every frame uses its own random numbers, seeded with (seed, row, index): frame 17 of a row is the same whatever else is
run.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate._threads import cached_property
from palpate.bench.trust import recorded
from palpate.bench.trust.presses import Load, plain_ball, random_load
from palpate.bench.trust.recorded import Case, Recorded, sensed
from palpate.bench.trust.sensors import Sensor, random_sensor
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.skin import Skin

__all__ = ["ROWS", "Frame", "Row", "make_frame"]

#: Ranges of the standard deviation of the noise, as a fraction of the largest reading: for clean frames, and for frames
#: with another defect.
CLEAN, USUAL = (1e-4, 0.2), (1e-3, 0.05)


@dataclass(frozen=True)
class Frame:
    """One frame, the description of its sensor, and the truth.

    Attributes
    ----------
    row : str
    index : int
    sensor, described : Sensor
        The true sensor, and its description for the library.
    uncertainty : mapping
        Stated relative standard deviations, as `palpate.Uncertainty` accepts them.
    friction : float or None
        Stated coefficient of friction.
    noise : tuple of float or None
        Stated standard deviation of each channel's noise.
    readings : array (channel, *array)
    load : Load
        The truth; all zero for empty frames.
    typical : Load
        The unit of errors: the load, or for empty frames the load that the noise would fit.
    reference : array (channel, *array)
        A clean frame of the sensor as described: a ball in the middle. Its notes do not count on this frame.
    words : str
        The defect, in figures.
    limits : float or None
        The stated largest reading of the sensor [unit of the channel].
    recorded : Recorded or None
        The recording whose last frame this is, with its frames at rest.
    least : Load or None
        The smallest load that also counts as right, if a part of the load is off the array.
    open_above : bool
        The load has no upper bound: a finite upper end of the force is wrong.
    """

    row: str
    index: int
    sensor: Sensor
    described: Sensor
    uncertainty: Mapping[str, float]
    friction: float | None
    noise: tuple[float, ...] | None
    readings: Floats
    load: Load
    typical: Load
    reference: Floats
    words: str
    limits: float | None = None
    recorded: Recorded | None = None
    least: Load | None = None
    open_above: bool = False

    @cached_property
    def skin(self) -> Skin:
        """The skin that a user would make."""
        return self.described.skin(self.noise, uncertainty=self.uncertainty, limits=self.limits)

    @property
    def empty(self) -> bool:
        """Whether there is no contact."""
        return not np.any(self.load.traction)

    def __str__(self) -> str:
        stated = [] if self.friction is None else [f"friction {self.friction:.2g} given"]
        stated.append("noise given" if self.noise is not None else "noise not given")
        return f"{self.row} {self.index}: {self.sensor}; {self.load.words}; {', '.join(stated)}; {self.words}"


@dataclass
class _Draft:
    """A frame under construction: readings without noise, and the noise, which is added last."""

    sensor: Sensor
    load: Load
    readings: Floats
    noise: Floats
    rng: np.random.Generator
    words: list[str] = field(default_factory=list)
    limits: float | None = None

    @property
    def peak(self) -> float:
        """Largest reading without noise."""
        return float(np.abs(self.readings).max())

    def say(self, text: str) -> None:
        self.words.append(text)

    def any_taxel(self) -> tuple[int, ...]:
        """Return the index of a random reading."""
        return tuple(int(self.rng.integers(n)) for n in self.readings.shape)

    def across(self) -> Floats:
        """Return a coordinate along a random direction, from -1 to 1 over the array."""
        axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in self.sensor.shape), indexing="ij")
        angle = float(self.rng.uniform(0, 2 * math.pi))
        if len(axes) == 1:
            return axes[0] * math.copysign(1.0, math.cos(angle))
        out = math.cos(angle) * axes[1] + math.sin(angle) * axes[0]
        return np.asarray(out / np.abs(out).max())


Change = Callable[[_Draft], object]


# -- defects of readings --------------------------------------------------------------------------------------------------


def _offset(draft: _Draft) -> None:
    part = float(draft.rng.uniform(0.1, 0.3) * draft.rng.choice([-1, 1]))
    draft.say(f"offset of {100 * part:.0f} % of the peak everywhere")
    draft.readings = draft.readings + part * draft.peak


def _channel_offsets(draft: _Draft) -> None:
    parts = draft.rng.uniform(0.05, 0.3, size=len(draft.readings)) * draft.rng.choice([-1, 1], size=len(draft.readings))
    draft.say("offsets of " + ", ".join(f"{100 * p:.0f}" for p in parts) + " % of the peak")
    draft.readings = draft.readings + draft.peak * parts.reshape(-1, *(1,) * len(draft.sensor.shape))


def _row_offset(draft: _Draft) -> None:
    part = float(draft.rng.uniform(0.1, 0.3) * draft.rng.choice([-1, 1]))
    axis = int(draft.rng.integers(2))
    k, channel = int(draft.rng.integers(draft.sensor.shape[axis])), int(draft.rng.integers(len(draft.readings)))
    all_channels = bool(draft.rng.random() < 0.5)
    channel_name = "all channels" if all_channels else draft.sensor.channels[channel]
    draft.say(f"{('row', 'column')[axis]} {k} of {channel_name} off by {100 * part:.0f} % of the peak")
    change = np.zeros(draft.readings.shape)
    change[(slice(None) if all_channels else channel, *((slice(None),) * axis), k)] = part * draft.peak
    draft.readings = draft.readings + change


def _ramp(draft: _Draft) -> None:
    peak = draft.peak
    for i in range(len(draft.readings)):
        part = float(draft.rng.uniform(0.05, 0.3))
        draft.say(f"ramp of {100 * part:.0f} % of the peak at either end")
        draft.readings[i] += part * peak * draft.across()


def _clipped(draft: _Draft) -> float:
    ceiling = 0.6 * draft.peak
    noisy = draft.readings + draft.noise
    draft.noise = np.clip(noisy, -ceiling, ceiling) - draft.readings
    draft.say(f"clipped at {ceiling:.3g}")
    return ceiling


def _clipped_named(draft: _Draft) -> None:
    draft.limits = _clipped(draft)
    draft.say("as the sensor says")


def _railed(draft: _Draft) -> None:
    place, sign = draft.any_taxel(), float(draft.rng.choice([-1, 1]))
    draft.say(f"reading {place} at {10 * sign:+.0f} peaks")
    draft.readings[place] = 10 * sign * draft.peak
    draft.noise[place] = 0.0


def _stuck(draft: _Draft) -> None:
    place, part = draft.any_taxel(), float(draft.rng.uniform(-1.0, 1.5))
    draft.say(f"reading {place} stuck at {part:.2f} of the peak")
    draft.readings[place] = part * draft.peak
    draft.noise[place] = 0.0


def _dead(draft: _Draft) -> None:
    place = np.unravel_index(int(np.abs(draft.readings).argmax()), draft.readings.shape)[1:]
    taxel = tuple(int(i) for i in place)
    draft.say(f"taxel {taxel} reads zero")
    for channel in range(len(draft.readings)):
        draft.readings[(channel, *taxel)] = draft.noise[(channel, *taxel)] = 0.0


def _gains(draft: _Draft) -> None:
    _uneven_gains(draft, float(draft.rng.uniform(0.05, 0.10)))


def _stated_gains(draft: _Draft) -> None:
    _uneven_gains(draft, GAIN)


def _uneven_gains(draft: _Draft, std: float) -> None:
    draft.say(f"gains spread by {100 * std:.0f} %")
    draft.readings = draft.readings * (1.0 + std * draft.rng.standard_normal(draft.readings.shape))


def _negated(draft: _Draft) -> None:
    if len(draft.readings) > 1 and draft.rng.random() < 0.5:
        channel = int(draft.rng.integers(len(draft.readings)))
        draft.say(f"wrong sign of {draft.sensor.channels[channel]}")
        draft.readings[channel] *= -1
    else:
        draft.say("wrong sign of all")
        draft.readings = -draft.readings


def _transposed(draft: _Draft) -> None:
    draft.say("rows and columns swapped")
    draft.readings = np.ascontiguousarray(np.swapaxes(draft.readings, 1, 2))


def _correlated(draft: _Draft) -> None:
    length = float(draft.rng.uniform(1.0, 3.0))
    draft.say(f"noise alike over {length:.1f} pitches")
    axes = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in draft.sensor.shape), indexing="ij")
    points = np.stack([a.ravel() for a in axes], axis=1)
    distance = np.abs(points[:, None] - points[None]).sum(axis=-1)
    mixed = draft.noise.reshape(len(draft.noise), -1) @ np.linalg.cholesky(np.exp(-distance / length)).T
    draft.noise = mixed.reshape(draft.noise.shape)


def _heavy_tails(draft: _Draft) -> None:
    freedom = float(draft.rng.uniform(2.0, 3.0))
    draft.say(f"noise of Student's distribution with {freedom:.1f} degrees of freedom")
    draft.noise = draft.noise / np.sqrt(draft.rng.chisquare(freedom, size=draft.noise.shape) / freedom)


def _rounded(draft: _Draft) -> None:
    scale = draft.peak * float(np.exp(draft.rng.uniform(0.0, math.log(8.0))))
    step = 2.0 * scale / 256
    draft.say(f"rounded to {step / draft.peak:.2%} of the peak")
    draft.noise = np.round((draft.readings + draft.noise) / step) * step - draft.readings


def _drift(draft: _Draft) -> None:
    peak, names = draft.peak, draft.sensor.channels
    axes = np.meshgrid(*(np.linspace(-1, 1, n) for n in draft.sensor.shape), indexing="ij")[::-1]
    turn = 0.0 if len(axes) == 1 or draft.rng.random() < 0.3 else float(draft.rng.uniform(-0.2, 0.2)) * peak
    for i, name in enumerate(names):
        shift = float(draft.rng.uniform(0.05, 0.3) * draft.rng.choice([-1, 1])) * peak
        draft.readings[i] += shift
        if name == "displacement_x" and len(axes) > 1:
            draft.readings[i] -= turn * axes[1]
        elif name == "displacement_y":
            draft.readings[i] += turn * axes[0] * draft.sensor.shape[1] / draft.sensor.shape[0]
    draft.say(f"the stage moved by 5 to 30 % of the peak and turned by {turn / peak:.0%} of it at the sides")


def _wrong_unit(draft: _Draft) -> None:
    if len(draft.readings) > 1 and draft.rng.random() < 0.5:
        channel = int(draft.rng.integers(len(draft.readings)))
        draft.say(f"{draft.sensor.channels[channel]} ten times too large")
        draft.readings[channel] *= 10
        draft.noise[channel] *= 10
    else:
        draft.say("all ten times too large")
        draft.readings, draft.noise = 10 * draft.readings, 10 * draft.noise


_MIXABLE: tuple[Change, ...] = (
    _gains,
    _offset,
    _channel_offsets,
    _ramp,
    _correlated,
    _heavy_tails,
    _stuck,
    _dead,
    _clipped,
    _rounded,
)


def _mixed(draft: _Draft) -> None:
    # apply defects in the order in which they arise: gains and offsets before noise, noise before the converter
    defects = sorted(draft.rng.choice(len(_MIXABLE), size=int(draft.rng.integers(2, 4)), replace=False))
    for i in defects:
        _MIXABLE[int(i)](draft)


# -- wrong descriptions -------------------------------------------------------------------------------------------------------


Factor = Callable[[np.random.Generator], float]
Described = Callable[[Sensor, np.random.Generator], Sensor]

#: Relative standard deviations that descriptions state.
MODULUS, THICKNESS, DEPTH, GAIN = 0.2, 0.2, 0.3, 0.075


def _off(low: float, high: float) -> Factor:
    """Return a random factor that is wrong by ``low`` to ``high``, up or down."""
    return lambda rng: float(1.0 + rng.uniform(low, high) * rng.choice([-1, 1]))


def _stated(std: float) -> Factor:
    """Return a random factor with the stated relative standard deviation ``std``, limited to two of them."""
    return lambda rng: float(1.0 / (1.0 + std * np.clip(rng.standard_normal(), -2.0, 2.0)))


def _modulus(factor_of: Factor) -> Described:
    return lambda sensor, rng: replace(sensor, modulus=sensor.modulus * factor_of(rng))


def _thickness(factor_of: Factor) -> Described:
    def described(sensor: Sensor, rng: np.random.Generator) -> Sensor:
        # the described pad must still contain the taxels
        factor = max(factor_of(rng), 1.001 * sensor.depth / sensor.thickness)
        return replace(sensor, layers=tuple((t * factor, part) for t, part in sensor.layers))

    return described


def _depth(factor_of: Factor) -> Described:
    return lambda sensor, rng: replace(sensor, depth=min(sensor.depth * factor_of(rng), 0.999 * sensor.thickness))


@dataclass(frozen=True)
class Row:
    """One row: its sensors, and the defect.

    Attributes
    ----------
    name : str
    says : str
        The defect, for the table's reader.
    suits : callable (Sensor) -> bool
        Whether it applies to a sensor.
    load : str
        "press", "nothing", "small", "pull", "adhesion" or "unseen shear".
    change : callable or None
        The change of the readings.
    described : callable (Sensor, rng) -> Sensor or None
        The description for the library in place of the truth.
    uncertainty : mapping
        Relative standard deviations that the description states.
    noise : (float, float)
        Range of the noise, in parts of the largest reading.
    misstated : bool
        The stated noise is three times too small or too large.
    recorded : callable (rng) -> Case or None
        Makes the frame: the last of a recording that begins at rest.
    """

    name: str
    says: str
    suits: Callable[[Sensor], bool] = lambda s: True
    load: str = "press"
    change: Change | None = None
    described: Described | None = None
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    noise: tuple[float, float] = USUAL
    misstated: bool = False
    recorded: Callable[[np.random.Generator], Case] | None = None


def _moves(sensor: Sensor) -> bool:
    return sensor.sensing == "displacement"


def _several(sensor: Sensor) -> bool:
    return len(sensor.channels) > 1


def _wired_in_rows(sensor: Sensor) -> bool:
    return len(sensor.shape) == 2 and sensor.sensing != "displacement"


def _square(sensor: Sensor) -> bool:
    return len(sensor.shape) == 2 and sensor.shape[0] == sensor.shape[1] and sensor.shears == "xy"


def _thick_in_doubt(sensor: Sensor) -> bool:
    return bool(sensor.layers) and sensor.depth < 0.8 * sensor.thickness


def _modulus_matters(sensor: Sensor) -> bool:
    return sensor.sensing != "stress"


def _buried(sensor: Sensor) -> bool:
    return sensor.depth > 0


_TABLE: Sequence[Row] = (
    Row("clean", "only noise, of 0.01 to 20 % of the largest reading", noise=CLEAN),
    Row("empty", "nothing touches", load="nothing"),
    Row("small", "contacts of 0.1 to 0.7 pitches in radius", load="small"),
    Row("pulling", "all of the load pulls", load="pull"),
    Row("adhesion", "a rim about each contact pulls with 20 to 60 % of the peak", load="adhesion"),
    Row("offset", "all readings off by 10 to 30 % of the largest", change=_offset),
    Row("channel offsets", "each channel off by 5 to 30 %", suits=_several, change=_channel_offsets),
    Row("row offset", "a row or column off by 10 to 30 %", suits=_wired_in_rows, change=_row_offset),
    Row("ramp", "a linear drift across the array, 5 to 30 % at either end", change=_ramp),
    Row("clipped", "readings end at 60 % of the largest", change=_clipped),
    Row("clipped named", "readings end at 60 % of the largest, and the array states it", change=_clipped_named),
    Row("railed", "one reading at ten times the largest", change=_railed),
    Row("stuck", "one reading stuck at a random level", change=_stuck),
    Row("dead", "the taxel under the contact reads zero", change=_dead),
    Row("gains", "gains of taxels spread by 5 to 10 %", change=_gains),
    Row(
        "gains named", "gains spread by 7.5 %, and the skin states it", change=_stated_gains, uncertainty={"gain": GAIN}
    ),
    Row(
        "modulus",
        "the pad 20 to 25 % stiffer or softer than stated",
        suits=_modulus_matters,
        described=_modulus(_off(0.2, 0.25)),
    ),
    Row(
        "modulus named",
        "the modulus has a random error, and its uncertainty of 20 % is stated",
        suits=_modulus_matters,
        described=_modulus(_stated(MODULUS)),
        uncertainty={"youngs_modulus": MODULUS},
    ),
    Row(
        "thickness",
        "the layer 15 to 25 % thicker or thinner than stated",
        suits=_thick_in_doubt,
        described=_thickness(_off(0.15, 0.25)),
    ),
    Row(
        "thickness named",
        "the thickness has a random error, and its uncertainty of 20 % is stated",
        suits=_thick_in_doubt,
        described=_thickness(_stated(THICKNESS)),
        uncertainty={"thickness": THICKNESS},
    ),
    Row(
        "depth",
        "stated depth of taxels 0.7 or 1.4 times the true one",
        suits=_buried,
        described=_depth(lambda rng: float(rng.choice([0.7, 1.4]))),
    ),
    Row(
        "depth named",
        "the depth has a random error, and its uncertainty of 30 % is stated",
        suits=_buried,
        described=_depth(_stated(DEPTH)),
        uncertainty={"depth": DEPTH},
    ),
    Row("transposed", "rows and columns swapped", suits=_square, change=_transposed),
    Row("wrong sign", "all readings, or those of a channel, negated", change=_negated),
    Row("correlated noise", "noise correlated over 1 to 3 pitches", change=_correlated, noise=(0.01, 0.1)),
    Row("heavy tails", "noise of Student's distribution, 2 to 3 degrees of freedom", change=_heavy_tails),
    Row(
        "8 bit",
        "readings rounded to 256 steps of a range 1 to 8 times as wide as they need",
        change=_rounded,
        noise=(1e-4, 1e-2),
    ),
    Row("stage drift", "displacement fields shifted and turned", suits=_moves, change=_drift),
    Row("wrong unit", "all readings, or those of a channel, ten times too large", change=_wrong_unit),
    Row("noise misstated", "noise three times as large or as small as stated", misstated=True),
    Row(
        "unseen shear",
        "contacts slide on sensors that measure normal stress alone",
        suits=lambda s: not s.shears,
        load="unseen shear",
    ),
    Row(
        "mixed",
        "two or three of: offset, channel offsets, ramp, stuck, dead, gains, correlated noise, heavy tails, clipped, 8 bit",
        change=_mixed,
    ),
    Row("gains of 30 %", "gains of taxels spread by 30 %; zero from a rest", recorded=recorded.uneven_gains),
    Row("edge", "the pad ends half to one thickness from the contact; zero from a rest", recorded=recorded.pad_edge),
    Row(
        "lattice",
        "a printed lattice carries 25 to 50 % more or less from place to place; zero from a rest",
        recorded=recorded.lattice,
    ),
    Row("all at their end", "all readings at the end that the sensor states", recorded=recorded.all_at_their_end),
    Row("even press", "an even press, wider than the array; zero just taken from a rest", recorded=recorded.even_press),
    Row(
        "frozen patch",
        "2 x 2 to 3 x 3 taxels stay at the values of a press that has gone, 0.1 to 0.5 s",
        load="nothing",
        recorded=recorded.frozen_patch,
    ),
    Row(
        "zeros after press",
        "exactly 0 for 0.2 to 2 s after a press; at rest 0, rounded or noise",
        load="nothing",
        recorded=recorded.zeros_after_press,
    ),
    Row(
        "restarted clock",
        "stamps restart, wrap, go wild, count whole seconds or are swapped, in a stream or a table",
        recorded=recorded.restarted_clock,
    ),
    Row(
        "drift after zero",
        "one channel or all shifted by 1 to 20 % of the largest reading after the zero was taken",
        recorded=recorded.drift_after_zero,
    ),
    Row("shallow taxels", "taxels 0.1 to 0.5 pitches deep; zero from a rest", recorded=recorded.shallow_taxels),
    Row("wide press", "a press of 0.6 to 1.2 times the array's width; zero from a rest", recorded=recorded.wide_press),
)

#: All rows by name, in the order of the table.
ROWS: Mapping[str, Row] = {row.name: row for row in _TABLE}


def make_frame(row: str, index: int, *, seed: int = 0) -> Frame:
    """Frame ``index`` of a row.

    Examples
    --------
    >>> from palpate.bench.trust import make_frame
    >>> frame = make_frame("offset", 3)
    >>> bool((frame.readings == make_frame("offset", 3).readings).all())
    True
    """
    if row not in ROWS:
        raise InvalidInput(f"row must be one of {', '.join(ROWS)}; got {row!r}.")
    kind = ROWS[row]
    rng = np.random.default_rng([seed, zlib.crc32(row.encode()), index])
    if kind.recorded is not None:
        return _last_frame(row, index, kind.recorded(rng))
    sensor = random_sensor(rng, kind.suits)
    axes = "xy"[: len(sensor.shape)] if kind.load == "unseen shear" else sensor.shears
    mu = float(rng.uniform(0.2, 0.9))
    adhesion = float(rng.uniform(0.2, 0.6)) if kind.load == "adhesion" else 0.0
    load = random_load(rng, sensor, friction=mu, axes=axes, adhesion=adhesion, small=kind.load == "small")
    if kind.load == "pull":
        load = load.times(-1.0)
    typical = load
    readings = sensed(sensor, load)
    peak = float(np.abs(readings).max())
    level = float(np.exp(rng.uniform(*np.log(kind.noise))))
    std = np.full(len(sensor.channels), level * peak)
    if len(std) > 1 and rng.random() < 0.25:
        std[int(rng.integers(len(std)))] *= 3.0
    column = std.reshape(-1, *(1,) * len(sensor.shape))
    draft = _Draft(sensor, load, readings, column * rng.standard_normal(readings.shape), rng)
    draft.say(f"noise {level:.2g} of the largest reading")
    if kind.load == "nothing":
        load = replace(load.times(0.0), words="nothing touches")
        draft.readings = np.zeros_like(readings)
    if kind.change is not None:
        kind.change(draft)
    described = sensor if kind.described is None else kind.described(sensor, rng)
    if kind.described is not None:
        draft.say(
            f"described depth {described.depth / sensor.depth if sensor.depth else 1:.2f}, modulus {described.modulus / sensor.modulus:.2f}, "
            f"thickness {described.thickness / sensor.thickness if sensor.layers else 1:.2f} times the true one"
        )
    noise_stated = rng.random() < 0.5 or kind.misstated
    stated_std = std * (float(rng.choice([1 / 3, 3.0])) if kind.misstated else 1.0)
    if kind.misstated:
        draft.say(f"noise said to be {stated_std[0] / std[0]:.2g} times what it is")
    # friction applies to pushing loads: no user would state it for a pull
    presses = kind.load not in ("pull", "adhesion")
    friction = mu * float(rng.choice([1.0, 1.0, 1.3])) if presses and sensor.shears and rng.random() < 0.5 else None
    if kind.load == "unseen shear":
        friction = None
    ball = plain_ball(described, float(np.abs(typical.traction).max()))
    clean = sensed(described, ball)
    clean = clean + column * rng.standard_normal(clean.shape)
    if draft.limits is not None:  # the clean frame must be within the range
        clean *= 0.9 * draft.limits / float(np.abs(clean).max())
    return Frame(
        row=row,
        index=index,
        sensor=sensor,
        described=described,
        uncertainty=kind.uncertainty,
        friction=friction,
        noise=tuple(float(v) for v in stated_std) if noise_stated else None,
        readings=draft.readings + draft.noise,
        load=load,
        typical=typical,
        reference=clean,
        words=", ".join(draft.words),
        limits=draft.limits,
    )


def _last_frame(row: str, index: int, case: Case) -> Frame:
    """Return the frame of a recording that is judged; its noise is not stated."""
    return Frame(
        row=row,
        index=index,
        sensor=case.sensor,
        described=case.sensor,
        uncertainty={},
        friction=case.friction,
        noise=None,
        readings=case.recorded.steps[-1],
        load=case.load,
        typical=case.typical,
        reference=case.recorded.clean[-1],
        words=", ".join([*case.words, case.recorded.road]),
        limits=case.limits,
        recorded=case.recorded,
        least=case.least,
        open_above=case.open_above,
    )
