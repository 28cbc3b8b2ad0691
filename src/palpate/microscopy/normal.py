"""Estimate the normal traction of a cell from displacements out of the plane (2.5-D traction force microscopy; H.
Delanoë-Ayari et al., Phys. Rev. Lett. 105, 2010, 248103).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats, Pad
from palpate.inverse.linear.posterior import LinearErrors
from palpate.microscopy.fields import Field, mended
from palpate.microscopy.inversion import Iterated
from palpate.microscopy.noise import shared_variance
from palpate.microscopy.vectors import noise_of
from palpate.sensing.arrays import AreaArray
from palpate.sensing.uncertainty import Uncertainty
from palpate.skin import Skin

__all__ = ["Normal", "normal_of", "without_sideways"]

CHANNELS = ("displacement_x", "displacement_y", "displacement_z")


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal traction [Pa], positive where it pulls the gel up: ``traction`` (row, column) and ``draws`` (draw, row,
    column). ``work`` and ``work_of_draws`` [J] are the energies that it adds to those of the tangential traction on
    each vector's square. ``sideways`` (2, row, column) [m] is the displacement along the surface that it causes in the
    field, at the depth of the beads.
    """

    NUMBERS: ClassVar[tuple[str, ...]] = ("net_force_z", "force_normal", "normal_peak", "strain_energy_normal")

    traction: Floats
    draws: Floats
    work: Floats
    work_of_draws: Floats
    sideways: Floats

    def quantities(
        self, inside: npt.NDArray[np.bool_], cell: float
    ) -> dict[str, tuple[str, str, Floats, float | None, bool, str]]:
        """Return the quantities of a cell in the form that `cell_forces` collects: label, unit, values of the estimate
        and of the draws, expected value, whether noise adds to them, and the reason.
        """
        each = np.stack([self.traction, *self.draws])[:, inside]
        work = np.stack([self.work, *self.work_of_draws])[:, inside]
        at = int(np.abs(each[0]).argmax())
        return {
            "net_force_z": ("net force out of the gel", "N", each.sum(axis=1) * cell, 0.0, False, "a cell that is wholly in view pulls itself along nothing"),
            "force_normal": ("sum of sizes of normal force", "N", np.abs(each).sum(axis=1) * cell, None, True, "of every vector, noise included"),
            "normal_peak": ("largest normal traction", "Pa", each[:, at], None, False, "at the vector where its estimate is largest, positive out of the gel"),
            "strain_energy_normal": ("strain energy by normal traction", "J", work.sum(axis=1), None, True, "to be added to that of the traction along the surface"),
        }  # fmt: skip


def normal_of(
    field: Field,
    pad: Pad,
    *,
    depth: float,
    noise: float | None,
    drift: bool,
    uncertainty: Uncertainty | None,
    draws: int,
    seed: int,
) -> Normal:
    """Estimate the normal traction of a field that has displacements out of the plane, by Tikhonov's method on all
    three components.

    The noise of each component is estimated from differences between its neighbouring vectors, because depth is
    measured less accurately than position in a picture.
    """
    # z points into the gel
    u = np.concatenate([field.displacement, -field.normal[None]])
    there = np.isfinite(u).all(axis=0) & ~field.unlike & ~mended(np.stack([u[2], u[2]]) / field.pixel)[1]
    known = (field.noise if noise is None else noise, field.noise if noise is None else noise, noise)
    each = [n or _noise(c, field) for n, c in zip(known, u)]
    common: Any = {"shape": field.shape, "pitch": field.pitch, "center": field.center}
    array = AreaArray(
        **common,
        depth=depth,
        channels=CHANNELS,
        noise=each,
        mask=None if there.all() else there,
        aperture=field.aperture,
    )
    skin = Skin(pad, array, nuisance="auto" if drift else (), uncertainty=uncertainty)
    touch = skin.reconstruct(np.nan_to_num(u), method=Iterated(order=1, rule="evidence"), components=("x", "y", "z"))
    errors = None if touch._errors is None else touch._errors.posterior
    if not isinstance(errors, LinearErrors):
        raise RuntimeError("the linear method has errors of its own")
    samples = errors.draws(draws, np.random.default_rng(seed))[0]
    grid: Any = skin.surface
    everywhere: Any = {"shape": grid.shape, "pitch": grid.spacings[0], "channels": CHANNELS, "center": grid.center}
    whole = Skin(pad, AreaArray(**everywhere, depth=0.0), surface=grid)
    beads = Skin(pad, AreaArray(**everywhere, depth=depth, aperture=field.aperture), surface=grid)
    view: Any = (slice(None), *(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, field.shape)))
    cell = field.pitch**2
    estimate = np.asarray(touch.values)
    pushes = np.zeros_like(estimate)
    pushes[2] = estimate[2]
    sideways = np.asarray(beads.sense(pushes))[view][:2]
    tractions, works = [], []
    for t in (estimate, *samples):
        alone = np.zeros_like(t)
        alone[2] = t[2]
        moved = np.asarray(whole.sense(alone))[view]
        moved = moved - moved.mean(axis=(1, 2), keepdims=True)
        mine = t[view]
        tractions.append(-mine[2])
        # half of its own work, plus the work of the shear on the displacement it causes: the two energies do not simply add
        works.append(cell * (0.5 * mine[2] * moved[2] + mine[0] * moved[0] + mine[1] * moved[1]))
    # without drift, the mean of the displacement is measured too
    sideways = sideways - (sideways.mean(axis=(1, 2), keepdims=True) if drift else 0.0)
    return Normal(tractions[0], np.stack(tractions[1:]), works[0], np.stack(works[1:]), sideways)


def without_sideways(field: Field, normal: Normal) -> Field:
    """Subtract from the field the displacement along the surface that normal traction causes."""
    return replace(field, displacement=field.displacement - normal.sideways)


def _noise(u: Floats, field: Field) -> float:
    """Return the standard deviation [m] of the noise of one component. Overlapping windows share noise, so that second
    differences contain less of it; the result is corrected for this.
    """
    filter_ = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0]).ravel()
    at = field.pitch * np.stack(np.meshgrid(np.arange(3), np.arange(3)), axis=-1).reshape(-1, 2)
    apart = at[:, None] - at[None]
    shared = shared_variance(apart[..., 0], apart[..., 1], field.aperture if field.aperture > field.pitch else 0.0)
    shown = float(filter_ @ shared @ filter_ / (filter_ @ filter_))
    return max(noise_of(u[None]) / np.sqrt(max(shown, 0.1)), 1e-300)
