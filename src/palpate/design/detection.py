"""Smallest detectable load, blind spots, and the largest load of a sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from palpate.design.bounds import PressModel
from palpate.design.responses import weights_of
from palpate.elastic.pad import Floats, Pad, isotropic_constants
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid, LineGrid
from palpate.sensing.limits import of_readings
from palpate.sensing.nuisance import nuisances
from palpate.sensing.operator import Operator
from palpate.sensing.surface import default_surface

__all__ = ["Noticed", "noticed_forces", "range_of"]

#: Rate of false alarms at rest, and fraction of contacts of the reported force that are
#: detected.
FALSE_ALARM, POWER = 0.01, 0.95
#: A place is a blind spot if its smallest detectable force is this many times that of the median place.
BLIND = 3.0
#: Number of matrix entries of the cells that are computed at a time.
BLOCK = 4_000_000
#: Peak traction above this fraction of Young's modulus is beyond linear elasticity, as in the notes of a touch.
STRAIN = 0.3


@dataclass(frozen=True)
class Noticed:
    """Smallest normal force [N] that is detected at each place on the array.

    Attributes
    ----------
    places : array (n, axis) [m]
        In the order of the array axes.
    force : array (n,) [N]
        Infinite where the readings do not detect it.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.design import Noticed
    >>> noticed = Noticed(np.zeros((3, 1)), np.array([1.0, 1.0, 9.0]))
    >>> noticed.median, round(noticed.blind, 2)
    (1.0, 0.33)
    """

    places: Floats
    force: Floats

    @property
    def median(self) -> float:
        """Smallest detectable force at the median place [N]."""
        return float(np.median(self.force))

    @property
    def blind(self) -> float:
        """Fraction of the places with a smallest detectable force of more than three times the median."""
        median = self.median
        return 1.0 if math.isinf(median) else float((self.force > BLIND * median).mean())


def noticed_forces(pad: Pad, planes: Sequence[Array], kinds: Sequence[str] | None) -> Noticed:
    """Return the smallest detectable force of an indenter as wide as a surface cell, at an unknown place on the array.

    The matched-filter output for a force F is F |P g| in units of the noise, where g are the whitened readings of unit
    force and P projects offsets out. Its threshold is exceeded in 1 % of frames at rest by the largest of as many
    independent places as there are readings; the reported force exceeds it in 95 % of contacts.
    """
    surface = default_surface(planes, thickness=pad.thickness)
    surface = _finer(planes, surface)
    operator = Operator(pad, planes, surface)
    axes = surface.axes
    points = np.concatenate([p.points[p.valid.ravel()] for p in planes])
    inside = [
        (a >= points[:, i].min() - 1e-9) & (a <= points[:, i].max() + 1e-9)
        if np.ptp(points[:, i]) > 0
        else _nearest(a, points[0, i])
        for i, a in enumerate(axes)
    ]
    cells = np.flatnonzero(inside[0] if len(axes) == 1 else np.outer(inside[0], inside[1]))
    weights = weights_of(planes)
    found = nuisances(planes, ("offset",) if kinds is None else kinds)
    basis = np.linalg.qr(np.stack([n.rows for n in found], axis=1) * weights[:, None])[0] if found else None
    area = float(np.prod(surface.spacings))
    size = np.empty(len(cells))
    step = max(1, BLOCK // len(weights))
    component = len(surface.components) - 1
    for start in range(0, len(cells), step):
        rows = operator.columns([component], cells[start : start + step])[:, 0] * (weights[:, None] / area)
        squares = (rows**2).sum(axis=0)
        if basis is not None:
            squares = squares - ((basis.T @ rows) ** 2).sum(axis=0)
        size[start : start + step] = np.sqrt(np.maximum(squares, 0.0))
    places = np.stack([np.asarray(a).ravel()[cells] for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    with np.errstate(divide="ignore"):
        return Noticed(places, threshold(len(weights)) / size)


def threshold(readings: int) -> float:
    """Return the threshold of the matched filter in units of the noise; see `noticed_forces`."""
    return float(ndtri(1.0 - 0.5 * FALSE_ALARM / readings) + ndtri(POWER))


def _nearest(axis: Floats, place: float) -> Floats:
    found = np.zeros(len(axis), dtype=bool)
    found[int(np.abs(axis - place).argmin())] = True
    return found


def _finer(planes: Sequence[Array], surface: Grid) -> Grid:
    """Return a finer surface for a regular array, so that places between taxels count: four cells per pitch if taxels
    are less than a pitch deep, otherwise two.
    """
    first = planes[0]
    if isinstance(first, ScatteredArray):
        return surface
    pitch = first.grid.spacings[-1]
    now = round(pitch / surface.spacings[-1])
    times = math.ceil((4 if first.depth < pitch else 2) / now)
    counts = [times * (n - 1) + 1 for n in surface.shape]
    if isinstance(surface, LineGrid):
        return LineGrid(count=counts[0], spacing=surface.spacing / times, center=surface.center)
    dy, dx = surface.spacings
    return replace(surface, shape=(counts[0], counts[1]), spacing=(dy / times, dx / times))


def range_of(model: PressModel) -> tuple[float, float]:
    """Return the normal force [N] at which the first reading reaches an end of its range (infinite without limits),
    and the one at which linear elasticity ends.

    The force is that of the press, on its contact radius and with its share of shear.
    """
    planes, force = model.responses.planes, model.press.force
    start, end = 0, math.inf
    for array in planes:
        size = len(array.channels) * int(array.valid.sum())
        part = model.readings[start : start + size]
        start += size
        ends = of_readings(array)
        if ends is None:
            continue
        kept = array.valid.ravel()
        low, high = (np.asarray(e).reshape(len(array.channels), -1)[:, kept].ravel() for e in ends)
        with np.errstate(divide="ignore", invalid="ignore"):
            # a range that begins at 0 does not limit the load there
            up = np.where((part > 0) & np.isfinite(high), high / part, math.inf)
            down = np.where((part < 0) & np.isfinite(low) & (low < 0), low / part, math.inf)
        end = min(end, float(up.min()), float(down.min()))
    modulus, _ = isotropic_constants(model.responses.pad, 0.0)
    d = model.responses.dimensions
    peak = (1.5 if d == 2 else 4.0 / math.pi) * model.press.mean_pressure(d)
    return force * end, force * STRAIN * modulus / peak
