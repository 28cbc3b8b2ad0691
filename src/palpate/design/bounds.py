"""Cramer-Rao bounds: the smallest possible errors of force, place and radius of a press.

readings = r(force, place, radius) + B nuisances + noise. With J the derivatives of the readings with respect to all
unknowns, and W the inverse covariance of the noise, no unbiased estimator has a covariance below (J^T W J + P)^-1 (H.
Cramer 1946, C. R. Rao 1945; with P the inverse prior variances, H. L. Van Trees 1968). The press is assumed to be a
ball: an estimator that does not assume a shape has larger errors. If a bound is wide, an estimator that excludes
negative pressure may have smaller errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.design.press import Press
from palpate.design.responses import Responses, weights_of
from palpate.elastic.pad import Floats
from palpate.sensing.nuisance import nuisances
from palpate.sensing.operator import Operator
from palpate.sensing.uncertainty import Uncertainty, scale_free, step_of, stretched

__all__ = ["Bound", "PressModel", "covariance"]

#: A combination of parameters whose eigenvalue of the information matrix (in natural units) is below this fraction of
#: the largest counts as not observed.
SINGULAR = 1e-13


@dataclass(frozen=True)
class Bound:
    """Standard deviations for a press, in SI units; infinite if the readings do not determine them.

    Attributes
    ----------
    force : array (component,)
        Standard deviation of each estimated component of the force [N].
    center : array (axis,)
        Standard deviation of the position (x, y), or (x,) [m].
    radius : float
        Standard deviation of the contact radius [m].
    friction_reserve : float
        Standard deviation of the reserve before the whole contact slips, mu F_z - |F_t| [N]; NaN unless shear and
        pressure are both estimated.
    """

    force: Floats
    center: Floats
    radius: float
    friction_reserve: float


def nuisance_columns(responses: Responses, kinds: Sequence[str] | None) -> Floats:
    """Return patterns (reading, nuisance) with unknown amplitudes; the default (None) is an offset of each channel."""
    found = nuisances(responses.planes, ("offset",) if kinds is None else kinds)
    return np.stack([n.rows for n in found], axis=1) if found else np.zeros((len(weights_of(responses.planes)), 0))


def covariance(jacobian: Floats, weights: Floats, count: int, prior: Floats | None = None) -> Floats:
    """Return the covariance (count, count) of the first ``count`` parameters if the others are unknown too.

    ``jacobian`` (reading, parameter), ``weights`` 1/noise of each reading, ``prior`` 1/(standard deviation) of each
    parameter, 0 without prior knowledge.
    """
    rows = jacobian * weights[:, None]
    if prior is not None:
        rows = np.concatenate([rows, np.diag(prior)[prior > 0]])
    scale = np.sqrt((rows**2).sum(axis=0))
    felt = scale > 0
    out = np.full((count, count), 0.0)
    used = np.flatnonzero(felt)
    _, s, vt = np.linalg.svd(rows[:, used] / scale[used], full_matrices=False)
    if len(s) < len(used):  # fewer readings than unknowns
        vt = np.linalg.svd(rows[:, used] / scale[used], full_matrices=True)[2]
        s = np.concatenate([s, np.zeros(len(used) - len(s))])
    observed = s > math.sqrt(SINGULAR) * s.max(initial=0.0)
    asked = used < count
    half = vt[observed].T / s[observed] / scale[used, None]
    index = used[asked]
    out[np.ix_(index, index)] = half[asked] @ half[asked].T
    lost = np.zeros(count, dtype=bool)
    lost[np.flatnonzero(~felt[:count])] = True
    lost[index] |= (np.abs(vt[~observed][:, asked]) > 1e-6).any(axis=0)
    out[np.diag_indices(count)] = np.where(lost, math.inf, np.diag(out))
    return out


class PressModel:
    """Readings of a press and their derivatives with respect to force, place and radius."""

    def __init__(self, responses: Responses, press: Press, components: tuple[str, ...]) -> None:
        self.responses, self.press, self.components = responses, press, components
        surface = responses.grid.components
        self._columns = [surface.index(c) for c in components]
        self.forces = np.zeros(len(surface))
        for c, f in press.components(components).items():
            self.forces[surface.index(c)] = f
        shapes = np.stack(responses.derivatives(responses.middle, press.contact_radius))
        units = self.units = np.eye(len(surface))[self._columns]
        d = responses.dimensions
        by_force = responses.read(np.repeat(shapes[:1], len(units), axis=0), units)
        by_shape = responses.read(shapes[1:], np.repeat(self.forces[None], d + 1, axis=0))
        # place as (x, y)
        by_place = by_shape[:d][::-1]
        self.readings = self.forces[self._columns] @ by_force
        self.jacobian = np.concatenate([by_force, by_place, by_shape[d:]]).T
        self.shape = shapes[0]

    def systematic(self, uncertainty: Uncertainty) -> tuple[Floats, Floats]:
        """Return the changes of the readings for one standard deviation of scale, modulus, depth and thickness
        (reading, cause), and of each gain (reading,).
        """
        r = self.responses
        columns = [uncertainty.scale * self.readings, uncertainty.modulus * self.readings * scale_free(r.planes)]
        known = uncertainty.beside(r.pad, r.planes)
        causes = [name for name in ("depth", "thickness") if getattr(known, name)]
        if causes:
            coarse = r.coarse(self.press.contact_radius)
            shape, forces = coarse.contact(r.middle, self.press.contact_radius)[None], self.forces[None]
            before = coarse.read(shape, forces)[0]
        for name in causes:
            step = step_of(r.pad, r.planes, name)
            moved = Operator(*stretched(r.pad, r.planes, **{name: 1.0 + step}), coarse.grid)
            columns.append(getattr(known, name) * (coarse.read(shape, forces, moved)[0] - before) / step)
        gain = uncertainty.assumed_gain or uncertainty.stated_gain
        return np.stack(columns, axis=1), gain * np.abs(self.readings)

    def bound(self, kinds: Sequence[str] | None, uncertainty: Uncertainty | None = None) -> Bound:
        """Bound with unknown offsets and other nuisances, and with the ``uncertainty`` of the skin if given."""
        weights, others, prior = self.unknowns(kinds, uncertainty)
        own = self.jacobian.shape[1]
        prior = np.concatenate([np.zeros(own), prior])
        return self._read(covariance(np.concatenate([self.jacobian, others], axis=1), weights, own, prior))

    def unknowns(self, kinds: Sequence[str] | None, uncertainty: Uncertainty | None) -> tuple[Floats, Floats, Floats]:
        """Return 1/noise of each reading (gain errors included), the nuisances (reading, nuisance), and 1/(prior
        standard deviation) of each.
        """
        weights, others = weights_of(self.responses.planes), nuisance_columns(self.responses, kinds)
        prior = np.zeros(others.shape[1])
        if uncertainty is None:
            return weights, others, prior
        causes, gains = self.systematic(uncertainty)
        others = np.concatenate([others, causes], axis=1)
        return 1.0 / np.hypot(1.0 / weights, gains), others, np.concatenate([prior, np.ones(causes.shape[1])])

    def _read(self, found: Floats) -> Bound:
        n, d = len(self.components), self.responses.dimensions
        deviation = np.sqrt(np.diag(found))
        margin = math.nan
        if "z" in self.components and n > 1:
            slope = np.array([-1.0 if c == "x" else self.press.friction if c == "z" else 0.0 for c in self.components])
            part = found[:n, :n]
            margin = math.sqrt(slope @ part @ slope) if np.isfinite(np.diag(part)[slope != 0]).all() else math.inf
        return Bound(deviation[:n], deviation[n : n + d], float(deviation[n + d]), margin)
