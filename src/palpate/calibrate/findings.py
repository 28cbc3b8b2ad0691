"""Findings from labelled presses in addition to the map: pad model, silent taxels, hysteresis, ageing, and the next
press to make.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate.calibrate.forcemap import ForceMap
from palpate.calibrate.prior import draw_presses, reached
from palpate.calibrate.regressions import REGRESSIONS, cross_validation_errors
from palpate.calibrate.wiring import reading_names
from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Floats
from palpate.errors import PalpateError
from palpate.sensing.grids import AreaGrid
from palpate.sensing.readings import plausible
from palpate.status import Status

if TYPE_CHECKING:
    from palpate.calibrate.calibration import SkinCalibration
    from palpate.calibrate.labels import Labelled

__all__ = ["ageing", "best_press", "elastic_check", "hysteresis", "silent_readings", "small_unit", "table_of"]

#: Number of frames that the elastic model is asked to reconstruct, and number that it must reconstruct.
ASKED, ANSWERED = 6, 3
#: The elastic model is rejected if the error of its force exceeds this fraction of the root mean square of the labels,
#: and this many times the error of the map,
ELASTIC_ERROR, ELASTIC_RATIO = 0.1, 1.5
#: unless at least this fraction of its intervals contain the labelled force.
MIN_ELASTIC_COVERAGE = 0.8
#: The elastic model is always rejected if its relative error is larger than this.
MAX_ELASTIC_ERROR = 0.3
#: Smallest number of presses for cross-validation.
MIN_PRESSES = 3
#: Readings are scaled to this fraction of what the pad can bear before the elastic model solves them.
PROBE_FRACTION = 0.01
#: A reading is silent if its magnitude is below this fraction of the median one; this is tested with at least ENOUGH
#: labels.
SILENT, ENOUGH = 0.01, 3
#: Loading and unloading differ if their mean errors differ by DIFFERS standard errors and by LAG of the force.
DIFFERS, LAG = 3.0, 0.03
#: Probability below which the sensor is said to have aged: the new labels do not fit the old calibration.
AGED = 0.01
#: Number of candidates for the next press.
CANDIDATES = 200


def table_of(one: ForceMap) -> tuple[tuple[str, float, float, float], ...]:
    """Return name, mean error, R^2 and coverage on presses left out of the fit: of this map, then of the regressions."""
    import scipy.special

    p = one.process
    if len(np.unique(p.press)) < MIN_PRESSES:
        return ()
    spread = float(((p.values - p.values.mean()) ** 2).mean())

    def row(name: str, error: Floats, coverage: float) -> tuple[str, float, float, float]:
        good = np.isfinite(error)
        if not good.any():
            return name, math.nan, math.nan, coverage
        r2 = 1.0 - float((error[good] ** 2).mean()) / spread if spread > 0.0 else math.nan
        return name, float(np.abs(error[good]).mean()), r2, coverage

    half = float(scipy.special.stdtrit(one.freedom, 0.975)) * one.left_out_std
    rows = [row("palpate", one.left_out, float((np.abs(one.left_out) <= half).mean()))]
    for name, regression in REGRESSIONS.items():
        rows.append(row(name, cross_validation_errors(regression, p.readings, p.values, p.press), math.nan))
    return tuple(rows)


def elastic_check(skin: Any, data: Labelled, main: ForceMap) -> tuple[float, float, float, list[str]]:
    """Return the factor on the readings for which the elastic model gives the labelled forces (NaN: the model is
    rejected), its relative error, its coverage, and sentences.
    """
    if "fz" not in data.known or "z" not in skin.components:
        return (
            math.nan,
            math.nan,
            math.nan,
            ["the elastic model was not asked: no normal force is known, or these channels do not tell it"],
        )
    fz = data.known["fz"]
    at = np.flatnonzero(np.isfinite(fz) & (np.abs(fz) > 0.15 * np.nanmax(np.abs(fz))))
    if len(at) < ANSWERED:
        return (
            math.nan,
            math.nan,
            math.nan,
            [f"whether the elastic model holds is open: {ANSWERED} labelled presses tell it, and there are {len(at)}"],
        )
    at = at[np.linspace(0, len(at) - 1, min(ASKED, len(at))).round().astype(int)]
    factor = small_unit(skin, data)
    found, wrong, tested, ends = [], 0, False, []
    quiet = skin.at_rest(factor * data.rest)
    for i in at:
        try:
            touch = quiet.reconstruct(factor * data.planes[i])
        except PalpateError:
            found.append(math.nan)
            ends.append([math.nan, math.nan])
            continue
        status = Status.SOLVED if touch.status is None else Status.coded(int(np.asarray(touch.status)))
        fit = math.nan if touch.fit is None else float(np.asarray(touch.fit))
        wrong += status is Status.UNEXPLAINED or fit < 0.01
        tested = tested or math.isfinite(fit)
        found.append(float(to_numpy(touch.force)[-1]))
        try:
            ends.append([float(to_numpy(end)[-1]) for end in touch.interval(0.95, "force")])
        except PalpateError:  # the touch has no error bars
            ends.append([math.nan, math.nan])
    force = np.array(found)
    good = np.isfinite(force) & (force != 0.0)
    if good.sum() < ANSWERED:
        return (
            math.nan,
            math.nan,
            math.nan,
            [
                "the elastic model gives no answer for these presses and is rejected: no pressure map follows, the map from readings to force does"
            ],
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
        return (
            math.nan,
            math.nan,
            relative,
            [f"the elastic model is rejected ({why}): no pressure map follows, only the net force"],
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
    return unit, std, relative, words


def small_unit(skin: Any, data: Labelled) -> float:
    """Return a factor that makes the largest labelled reading small compared with the limits of the pad."""
    factor, start = math.inf, 0
    for plane in skin.planes:
        for c, (limit, _) in enumerate(plausible(skin.pad, plane)):
            most = float(np.nanmax(np.abs(data.planes[:, start + c]), initial=0.0))
            factor = min(factor, PROBE_FRACTION * limit / most) if most > 0.0 else factor
        start += len(plane.channels)
    return factor


def silent_readings(skin: Any, data: Labelled) -> list[str]:
    """Return sentences on readings that hardly change while others do."""
    if len(data.flat) < ENOUGH or data.flat.shape[1] < 3:
        return []
    size = np.sqrt((data.flat**2).mean(axis=0))
    names = reading_names(skin)
    silent = np.flatnonzero(size < SILENT * np.median(size))
    if not len(silent):
        return []
    listed = ", ".join(names[i] for i in silent[:4]) + (f" and {len(silent) - 4} more" if len(silent) > 4 else "")
    return [
        f"{listed}: no more than {100 * SILENT:.0f} % of the usual reading. Broken, or never pressed: press there once"
    ]


def hysteresis(one: ForceMap) -> list[str]:
    """Return a sentence if errors differ between loading and unloading."""
    p = one.process
    if p.time is None or len(p.values) < 20:
        return []
    order = np.argsort(p.time)
    rise = np.gradient(p.values[order])
    error, size = one.left_out[order], float(np.sqrt((p.values**2).mean()))
    up, down = error[rise > 0.01 * size], error[rise < -0.01 * size]
    if min(len(up), len(down)) < 5:
        return []
    apart = float(up.mean() - down.mean())
    scatter = math.sqrt(up.var(ddof=1) / len(up) + down.var(ddof=1) / len(down))
    if abs(apart) < DIFFERS * scatter or abs(apart) < LAG * size:
        return []
    return [
        f"the pad lags: the same readings mean {plain_number(abs(apart), 2)} N {'more' if apart > 0 else 'less'} while the load grows than while it falls. Intervals hold it"
    ]


def ageing(before: SkinCalibration, data: Labelled) -> list[str]:
    """Return a sentence on whether the new labels fit the previous calibration."""
    import scipy.stats

    name = (
        "fz" if "fz" in before.maps and "fz" in data.known else next((n for n in before.maps if n in data.known), None)
    )
    if name is None or before.readings != data.flat.shape[1]:
        return []
    value = data.known[name]
    at = np.isfinite(value) & (np.abs(value) > 0.05 * np.nanmax(np.abs(value), initial=0.0))
    if not at.any():
        return []
    mean, std = before.maps[name].predict(data.flat[at])
    # fit one number, the factor between readings then and now; frames of the same press count once
    presses = len(np.unique(data.press[at]))
    ratio = float(value[at] @ mean / (mean @ mean)) if (mean @ mean) > 0.0 else math.nan
    one = float(np.sqrt((std**2).sum() / (mean @ mean)))
    sure = math.hypot(one * math.sqrt(len(mean)) / math.sqrt(len(mean) * max(presses, 1)), 0.02)
    chance = float(2.0 * scipy.stats.t.sf(abs(ratio - 1.0) / sure, before.maps[name].freedom))
    if chance < AGED:
        return [
            f"the sensor has aged: forces are now {plain_number(ratio, 3)} times what the calibration before says (probability of chance {chance:.2g}). Old labels are kept and weighed like new ones: calibrate without before= to drop them"
        ]
    return [
        f"no ageing is seen: forces are {plain_number(ratio, 3)} +- {plain_number(sure, 2)} times what the calibration before says"
    ]


def best_press(skin: Any, one: ForceMap) -> list[str]:
    """Return a sentence that names, of the presses the pad may meet, the one for which the map is least certain."""
    if not isinstance(skin.surface, AreaGrid):
        return []
    extent = reached(skin.planes)
    try:
        drawn = draw_presses(skin.pad, skin.planes, skin.surface, np.random.default_rng(7), CANDIDATES, extent=extent)
    except PalpateError:
        return []
    p = one.process
    if drawn.readings.shape[1] != p.readings.shape[1]:
        return []
    # convert to the sensor's own unit: as large per newton as the labelled readings
    ours = float(np.sqrt((drawn.readings**2).mean() / (drawn.force[:, 2] ** 2).mean()))
    theirs = float(np.sqrt((p.readings**2).mean() / (p.values**2).mean()))
    readings = drawn.readings * theirs / ours / drawn.force[:, 2:] * np.sqrt((p.values**2).mean())
    mean, std = one.predict(readings)
    # average over the ten least certain presses
    worst = np.argsort(std / np.maximum(np.abs(mean), 0.1 * np.abs(mean).max()))[-10:]
    half = 0.5 * (extent[1] - extent[0])
    away = np.abs((drawn.center - extent.mean(axis=0)) / half).max(axis=1)
    small = float(np.median(drawn.radius[worst])) < float(np.median(drawn.radius))
    sheared = float(np.hypot(*drawn.force[worst, :2].T).mean() / drawn.force[worst, 2].mean())
    usual = float(np.hypot(*drawn.force[:, :2].T).mean() / drawn.force[:, 2].mean())
    where = "near the edge" if float(np.median(away[worst])) > 0.6 else "near the middle"
    words = f"the press that would tell most: {where}, with a {'small' if small else 'large'} ball"
    return [words + (", while you push sideways" if sheared > 1.5 * usual else "")]
