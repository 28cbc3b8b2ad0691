"""Does the elastic model give the labelled forces, with one factor on the readings? If so, it is one more model of the
average that gives the normal force.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate.calibrate.forcemap import PRIOR_PRESSES, ForceMap, inflation, relative_weights
from palpate.calibrate.labels import Labelled
from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Floats
from palpate.errors import PalpateError
from palpate.sensing.readings import plausible
from palpate.status import Status
from palpate.touch import Touch

__all__ = ["JOINED_FREEDOM", "ElasticCheck", "elastic_check", "joined", "normal_force", "run_gain", "small_unit"]

#: Number of frames that the elastic model is asked to reconstruct, and number that it must reconstruct.
ASKED, ANSWERED = 6, 3
#: Labels below this fraction of the largest force are not asked.
STRONG = 0.15
#: The elastic model is rejected if the error of its force exceeds this fraction of the root mean square of the labels,
#: and this many times the error of the map,
ELASTIC_ERROR, ELASTIC_RATIO = 0.1, 1.5
#: unless at least this fraction of its intervals contain the labelled force.
MIN_ELASTIC_COVERAGE = 0.8
#: The elastic model is always rejected if its relative error is larger than this.
MAX_ELASTIC_ERROR = 0.3
#: Readings are scaled to this fraction of what the pad can bear before the elastic model solves them.
PROBE_FRACTION = 0.01
#: Half of a 95 % interval in standard deviations of the normal distribution.
HALF_WIDTH = 1.96
#: Degrees of freedom of the joined force: its inflation is known from at least ANSWERED presses and the prior.
JOINED_FREEDOM = PRIOR_PRESSES + ANSWERED
#: Smallest standard deviation [N], against division by zero.
TINY = 1e-12


@dataclass(frozen=True)
class ElasticCheck:
    """What labelled presses say of the elastic model; all numbers are NaN or 0 if it is rejected.

    Attributes
    ----------
    unit, unit_std : float
        Factor on the readings for which the model gives the labelled forces, and its relative standard deviation.
    error : float
        Root mean square error of its normal force with this factor, relative to the root mean square of the labels.
    weight : float
        Weight of its normal force joined with the map's, beside the map alone.
    inflation : float
        Factor on the standard deviation of the joined force, from presses that were left out.
    said : tuple of str
        Findings, one sentence each.
    """

    unit: float = math.nan
    unit_std: float = math.nan
    error: float = math.nan
    weight: float = 0.0
    inflation: float = 1.0
    said: tuple[str, ...] = ()


def normal_force(touch: Touch) -> tuple[Floats, Floats]:
    """Return normal force (*batch,) of the elastic model and its standard deviation, a quarter of the 95 % interval;
    NaN if it did not solve the frame, or if the interval has no end.
    """
    force = np.asarray(to_numpy(touch.force)[..., -1], dtype=np.float64)
    solved = np.ones(force.shape, dtype=bool)
    if touch.status is not None:
        solved = np.asarray(touch.status) == int(Status.SOLVED)
    try:
        low, high = (np.asarray(to_numpy(end)[..., -1], dtype=np.float64) for end in touch.interval(0.95, "force"))
    except PalpateError:  # the touch has no error bars
        return np.full(force.shape, math.nan), np.full(force.shape, math.nan)
    std = (high - low) / (2.0 * HALF_WIDTH)
    good = solved & np.isfinite(force) & np.isfinite(std)
    return np.where(good, force, math.nan), np.where(good, std, math.nan)


def elastic_check(skin: Any, data: Labelled, main: ForceMap) -> ElasticCheck:
    """Compare the normal force of the elastic model with labelled presses, and with the map ``main``."""
    if "fz" not in data.known or "z" not in skin.components:
        return ElasticCheck(
            said=("the elastic model was not asked: no normal force is known, or these channels do not tell it",)
        )
    fz = data.known["fz"]
    at = _strong(fz)
    if len(at) < ANSWERED:
        return ElasticCheck(
            said=(
                f"whether the elastic model holds is open: {ANSWERED} labelled presses tell it, and there are {len(at)}",
            )
        )
    at = _spread(at)
    factor = small_unit(skin, data)
    found, wrong, tested, ends, deviations = [], 0, False, [], []
    quiet = skin.at_rest(factor * data.rest)
    for i in at:
        try:
            touch = quiet.reconstruct(factor * data.planes[i])
        except PalpateError:
            found.append(math.nan)
            ends.append([math.nan, math.nan])
            deviations.append(math.nan)
            continue
        status = Status.SOLVED if touch.status is None else Status.coded(int(np.asarray(touch.status)))
        fit = math.nan if touch.fit is None else float(np.asarray(touch.fit))
        wrong += status is Status.UNEXPLAINED or fit < 0.01
        tested = tested or math.isfinite(fit)
        found.append(float(to_numpy(touch.force)[-1]))
        deviations.append(float(normal_force(touch)[1]))
        try:
            ends.append([float(to_numpy(end)[-1]) for end in touch.interval(0.95, "force")])
        except PalpateError:  # the touch has no error bars
            ends.append([math.nan, math.nan])
    force = np.array(found)
    good = np.isfinite(force) & (force != 0.0)
    if good.sum() < ANSWERED:
        return ElasticCheck(
            said=(
                "the elastic model gives no answer for these presses and is rejected: no pressure map follows, the map from readings to force does",
            )
        )
    scale = float(force[good] @ fz[at][good] / (force[good] @ force[good]))
    error = fz[at][good] - scale * force[good]
    size = float(np.sqrt((fz[at][good] ** 2).mean()))
    relative = float(np.sqrt((error**2).mean())) / size
    mapped = float(np.sqrt((main.left_out**2).mean())) / (float(np.sqrt((main.process.values**2).mean())) or 1.0)
    low, high = scale * np.array(ends)[good].T
    held = float(((low <= fz[at][good]) & (fz[at][good] <= high)).mean())
    close = relative <= max(ELASTIC_ERROR, ELASTIC_RATIO * mapped) or held >= MIN_ELASTIC_COVERAGE
    if scale <= 0.0 or relative > MAX_ELASTIC_ERROR or not close or wrong > len(at) // 2:
        why = (
            f"its normal force is off by {100 * relative:.0f} % with the best factor, the map's by {100 * mapped:.0f} %"
        )
        return ElasticCheck(
            error=relative,
            said=(f"the elastic model is rejected ({why}): no pressure map follows, only the net force",),
        )
    unit, std = factor * scale, relative / math.sqrt(max(int(good.sum()) - 1, 1))
    units = {channel_unit(c) for plane in skin.planes for c in plane.channels}
    off = f"its normal force is off by {100 * relative:.0f} % with one factor"
    doubt = "Use a pressure map for places only: its pascals, and components without labels, are not calibrated"
    if relative > max(ELASTIC_ERROR, ELASTIC_RATIO * mapped):
        words = [f"the elastic model holds roughly: {off}, the map's by {100 * mapped:.0f} %. {doubt}"]
    elif not tested:
        words = [
            f"the elastic model holds for the force alone: {off}. These readings are too few to test more. {doubt}"
        ]
    else:
        words = [f"the elastic model holds: {off}"]
    if units == {"Pa"}:
        words.append(
            f"readings become pascals by a factor of {plain_number(unit, 3)} +- {100 * std:.0f} % on the unit that they were read in. Forces and stress do not tell the modulus: press with a ball of known radius and a known depth to learn it"
        )
    else:
        words.append(
            f"modulus times unit of the readings is {plain_number(unit, 3)} times what the skin says, +- {100 * std:.0f} %. Presses do not tell the two apart: measure the pixel scale, or the modulus, once"
        )
    weight, wider = _beside_the_map(
        force[good], np.array(deviations)[good], relative, at[good], data, main, known=np.flatnonzero(np.isfinite(fz))
    )
    return ElasticCheck(unit, std, relative, weight, wider, tuple(words))


def run_gain(skin: Any, data: Labelled, unit: float, error: float, share: float) -> tuple[float, float] | None:
    """Return the factor on the elastic model's force in the run of these labels, and its standard deviation; None if the
    model solves none of them.

    ``unit`` is the factor on readings of the calibration, ``error`` its relative error in one press, and ``share`` the
    standard deviation of the factor before the labels; the labels widen it if they show a larger one.
    """
    at = _spread(_strong(data.known["fz"]))
    quiet, found = skin.at_rest(unit * data.rest), np.full(len(at), math.nan)
    for k, i in enumerate(at):
        with contextlib.suppress(PalpateError):
            found[k] = float(normal_force(quiet.reconstruct(unit * data.planes[i]))[0])
    good = np.isfinite(found)
    square = float(found[good] @ found[good])
    if square == 0.0:
        return None
    ratio = float(found[good] @ data.known["fz"][at][good]) / square
    variance = error**2 / len(np.unique(data.press[at][good]))
    before = max(share**2, (ratio - 1.0) ** 2 - variance)
    known = before / (before + variance)
    return 1.0 + known * (ratio - 1.0), math.sqrt(before * (1.0 - known))


def _strong(fz: Floats) -> Any:
    """Return the labels with enough force to ask the elastic model."""
    return np.flatnonzero(np.isfinite(fz) & (np.abs(fz) > STRONG * np.nanmax(np.abs(fz))))


def _spread(at: Any) -> Any:
    """Return at most ASKED of the labels, evenly."""
    return at[np.linspace(0, len(at) - 1, min(ASKED, len(at))).round().astype(int)]


def _beside_the_map(
    force: Floats, std: Floats, relative: float, at: Any, data: Labelled, main: ForceMap, *, known: Any
) -> tuple[float, float]:
    """Return the weight of the elastic model joined with the map, beside the map alone, and the inflation of its standard
    deviation.

    Both are compared on the same presses, each left out: for the elastic model the factor is that of the other presses.
    ``force`` is its normal force for the labels ``at`` before any factor; ``known`` are the labels of the map.
    """
    fz, press = data.known["fz"][at], data.press[at]
    value, deviation = np.full(len(at), math.nan), np.full(len(at), math.nan)
    for i in range(len(at)):
        other = press != press[i]
        square = float(force[other] @ force[other])
        if square > 0.0:
            factor = float(force[other] @ fz[other]) / square
            value[i], deviation[i] = factor * force[i], math.hypot(factor * std[i], relative * factor * force[i])
    good = np.isfinite(value) & np.isfinite(deviation)
    if not good.any():
        return 0.0, 1.0
    # labels of an earlier calibration come first in the map
    labels = len(main.process.values) - len(known) + np.searchsorted(known, at[good])
    mapped = fz[good] - main.left_out[labels]
    both, off = joined(value[good], deviation[good], mapped, main.left_out_std[labels])
    # odds of the joined force over the map alone; if they are even, the map alone needs no elastic model
    squares = np.array([((fz[good] - both) ** 2).mean(), ((fz[good] - mapped) ** 2).mean()])
    chance, other = relative_weights(squares, main.process)
    return max(1.0 - float(other / max(chance, TINY)), 0.0), inflation(((fz[good] - both) / off) ** 2, press[good])


def joined(a: Floats, a_std: Floats, b: Floats, b_std: Floats) -> tuple[Floats, Floats]:
    """Return mean and standard deviation of a quantity that two independent sources give."""
    precise, other = np.maximum(a_std, TINY) ** -2, np.maximum(b_std, TINY) ** -2
    return (a * precise + b * other) / (precise + other), (precise + other) ** -0.5


def small_unit(skin: Any, data: Labelled) -> float:
    """Return a factor that makes the largest labelled reading small compared with the limits of the pad."""
    factor, start = math.inf, 0
    for plane in skin.planes:
        for c, (limit, _) in enumerate(plausible(skin.pad, plane)):
            most = float(np.nanmax(np.abs(data.planes[:, start + c]), initial=0.0))
            factor = min(factor, PROBE_FRACTION * limit / most) if most > 0.0 else factor
        start += len(plane.channels)
    return factor
