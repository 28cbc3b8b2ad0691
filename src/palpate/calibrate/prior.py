"""Simulate presses on pads with uncertain constants, to find which maps from readings to force are physically likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.elastic.pad import Floats, Pad
from palpate.errors import PalpateError
from palpate.sensing.arrays import Array
from palpate.sensing.grids import AreaGrid, Grid
from palpate.sensing.operator import Operator
from palpate.sensing.uncertainty import stretched

__all__ = ["SHEAR_SHARE", "Presses", "draw_presses", "likely_maps"]

#: Number of random skins, and of presses on each. From 24 skins on, the moment for a 15-channel sensor changes by less
#: than a tenth.
SKINS, PRESSES = 24, 80
#: Standard deviations for sensors that were not measured (conventions): of the log of depth and thickness, of each
#: gain, and of crosstalk.
GEOMETRY, GAIN, CROSSTALK = 0.3, 0.3, 0.05
#: Noise of simulated readings as a fraction of their root mean square; it keeps the best map from using finer details.
NOISE = 0.03
#: Largest ratio of shear to normal force, and the fraction of presses that have shear.
SHEAR, SHEARED = 0.5, 0.6
#: Root mean square of one component of the shear force over that of the normal force, for such presses.
SHEAR_SHARE = (SHEARED * SHEAR**2 / 6.0) ** 0.5


@dataclass(frozen=True, eq=False)
class Presses:
    """Simulated presses: readings (press, reading), force (press, 3) [N], centre (press, 2) [m], contact radius
    (press,) [m].
    """

    readings: Floats
    force: Floats
    center: Floats
    radius: Floats


def draw_presses(
    pad: Pad, planes: Sequence[Array], surface: AreaGrid, rng: np.random.Generator, count: int, *, extent: Floats
) -> Presses:
    """Simulate presses of spheres and flat punches on one skin, with readings in the order of the rows of
    `Operator.dense`.
    """
    x, y = np.meshgrid(surface.x, surface.y)
    low, high = extent
    wide, deep = float(np.linalg.norm(high - low)), max(p.depth for p in planes) or float(min(surface.spacings))
    traction = np.zeros((count, 3, *surface.shape))
    force, center, radius = np.zeros((count, 3)), np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        center[k] = rng.uniform(low, high)
        radius[k] = np.exp(rng.uniform(np.log(0.3 * deep), np.log(0.4 * max(wide, deep))))
        size = max(radius[k], 0.75 * max(surface.spacings))
        ring = ((x - center[k, 0]) ** 2 + (y - center[k, 1]) ** 2) / size**2
        round_end = rng.random() < 0.7
        pressure = np.where(ring < 1.0, np.sqrt(np.maximum(1.0 - ring, 0.0)) if round_end else 1.0, 0.0)
        if not pressure.any():
            pressure = (ring == ring.min()).astype(np.float64)
        normal, turn = np.exp(rng.normal(0.0, 0.8)), rng.uniform(0.0, 2.0 * np.pi)
        ratio = rng.uniform(0.0, SHEAR) * (rng.random() < SHEARED)
        force[k] = normal * np.array([ratio * np.cos(turn), ratio * np.sin(turn), 1.0])
        traction[k] = force[k][:, None, None] * pressure / (pressure.sum() * surface.cell)
    parts = Operator(pad, planes, surface).forward(traction)
    rows = [np.asarray(part)[..., plane.valid].reshape(count, -1) for part, plane in zip(parts, planes)]
    return Presses(np.concatenate(rows, axis=1), force, center, radius)


def reached(planes: Sequence[Array]) -> Floats:
    """Return the lower and upper corner of the area of presses: the taxels plus a margin of half their depth."""
    points = np.concatenate([p.points for p in planes])
    beyond = 0.5 * max(p.depth for p in planes)
    return np.stack([points.min(axis=0) - beyond, points.max(axis=0) + beyond])


def likely_maps(pad: Pad, planes: Sequence[Array], surface: Grid, rng: np.random.Generator) -> Floats | None:
    """Return the second moment (quantity, reading, reading) of the best linear map from readings to Fx, Fy, Fz and the
    moments Fz x, Fz y.

    For each random skin the map is the least-squares fit to its presses; depth, thickness, gains and crosstalk vary
    between skins. The labels determine the scale. None if this pad cannot be varied (line contact; pads of other
    packages that cannot be scaled).
    """
    if not isinstance(surface, AreaGrid):
        return None
    total: Floats = np.zeros(())
    for _ in range(SKINS):
        depth, thickness = np.exp(GEOMETRY * rng.normal(size=2))
        try:
            body, moved = stretched(pad, tuple(planes), depth=float(depth), thickness=float(thickness))
            if body.thickness is not None:
                most = body.thickness
                moved = tuple(replace(p, depth=min(p.depth, most)) for p in moved)
            drawn = draw_presses(body, moved, surface, rng, PRESSES, extent=reached(planes))
        except PalpateError:
            return None
        values = drawn.readings * (1.0 + GAIN * rng.normal(size=drawn.readings.shape[1]))
        count = values.shape[1]
        values = values + CROSSTALK * values @ rng.normal(size=(count, count)) / np.sqrt(count)
        wanted = np.concatenate([drawn.force, drawn.force[:, 2:] * drawn.center], axis=1)
        covariance = values.T @ values / len(values) + NOISE**2 * np.mean(values**2) * np.eye(count)
        maps = np.linalg.solve(covariance, values.T @ wanted / len(values)).T
        total = total + maps[:, :, None] * maps[:, None, :] / SKINS
    return np.asarray(total)
