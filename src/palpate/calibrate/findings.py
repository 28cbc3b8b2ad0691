"""Report what labelled presses show besides the map: silent taxels, hysteresis, ageing, and the next press to make."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._numbers import plain_number
from palpate.calibrate.forcemap import ForceMap
from palpate.calibrate.prior import draw_presses, reached
from palpate.calibrate.regressions import REGRESSIONS, cross_validation_errors
from palpate.calibrate.wiring import reading_names
from palpate.elastic.pad import Floats
from palpate.errors import PalpateError
from palpate.sensing.grids import AreaGrid

if TYPE_CHECKING:
    from palpate.calibrate.calibration import SkinCalibration
    from palpate.calibrate.labels import Labelled

__all__ = ["ageing", "best_press", "hysteresis", "loading_difference", "silent_readings", "table_of"]

#: Smallest number of presses for cross-validation.
MIN_PRESSES = 3
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


def silent_readings(skin: Any, data: Labelled) -> list[str]:
    """Return sentences on readings that hardly change while other readings do."""
    if len(data.flat) < ENOUGH or data.flat.shape[1] < 3:
        return []
    size = np.sqrt((data.flat**2).mean(axis=0))
    names = reading_names(skin)
    silent = np.flatnonzero(size < SILENT * np.median(size))
    if not len(silent):
        return []
    listed = ", ".join(names[i] for i in silent[:4]) + (f" and {len(silent) - 4} more" if len(silent) > 4 else "")
    return [
        f"{listed}: no more than {100 * SILENT:.0f} % of the usual reading. They are broken, or were never pressed: press above them once"
    ]


def loading_difference(one: ForceMap) -> tuple[float, float, float] | None:
    """Return the mean error of left-out presses while the load grows minus that while it falls, its standard error, and
    the root mean square of the labels [N]; None without times or with too few frames of either.
    """
    p = one.process
    if p.time is None or len(p.values) < 20:
        return None
    order = np.argsort(p.time)
    rise = np.gradient(p.values[order])
    error, size = one.left_out[order], float(np.sqrt((p.values**2).mean()))
    up, down = error[rise > 0.01 * size], error[rise < -0.01 * size]
    if min(len(up), len(down)) < 5:
        return None
    scatter = math.sqrt(up.var(ddof=1) / len(up) + down.var(ddof=1) / len(down))
    return float(up.mean() - down.mean()), scatter, size


def hysteresis(one: ForceMap) -> list[str]:
    """Return a sentence if errors differ between loading and unloading."""
    compared = loading_difference(one)
    if compared is None:
        return []
    apart, scatter, size = compared
    if abs(apart) < DIFFERS * scatter or abs(apart) < LAG * size:
        return []
    return [
        f"the pad has hysteresis: the same readings mean {plain_number(abs(apart), 2)} N {'more' if apart > 0 else 'less'} while the load grows than while it falls. The intervals include this"
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
            f"the sensor has aged: forces are now {plain_number(ratio, 3)} times those of the previous calibration (probability of chance {chance:.2g}). Old labels are kept with the same weight as new ones: calibrate without before= to drop them"
        ]
    return [
        f"no sign of ageing: forces are {plain_number(ratio, 3)} +- {plain_number(sure, 2)} times those of the previous calibration"
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
    words = f"the most informative next press: {where}, with a {'small' if small else 'large'} ball"
    return [words + (", while you push sideways" if sheared > 1.5 * usual else "")]
