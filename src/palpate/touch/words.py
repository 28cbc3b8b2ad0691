"""A touch in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate.status import Status

if TYPE_CHECKING:
    from palpate.touch.result import Touch

__all__ = ["POOR_FIT", "outcome", "pulling", "summary"]

#: Below this misfit probability a frame says that the model does not explain it: one good frame in a hundred does.
POOR_FIT = 0.01

#: Part of the normal force that lies outside the outermost taxels from which on a summary says so.
OUTSIDE = 0.05


def outcome(touch: Touch) -> list[str]:
    """What became of the frames of a touch, one sentence for each thing that happened."""
    count = int(np.prod(touch.batch, dtype=int))
    said = []

    def some(flags: Any, all_of_one: str = "") -> str:
        """ " in 3 of 70 frames", or nothing for a single frame."""
        return f" in {int(np.count_nonzero(flags))} of {count} frames" if touch.batch else all_of_one

    if touch.status is not None:
        for code in np.unique(touch.status):
            status, here = Status.coded(int(code)), touch.status == code
            if status in (Status.SOLVED, Status.NOT_PUSHING):
                continue
            remedy = f"; {status.remedy}" if status.remedy and not touch.batch else ""
            said.append(f"{status.label}{some(here)}: {status.meaning}{remedy}")
    pulls = pulling(touch)
    if pulls.any():
        said.append(f"the readings pull as a whole{some(pulls)}: adhesion, or a wrong sign of the readings?")
    if touch.pushing is not None and not touch.pushing.all():
        linear = (touch.methods != "adaptive") & (touch.methods != "constrained") & ~touch.pushing
        for here, what in (
            (linear, "; the linear method was used"),
            (~touch.pushing & ~linear & ~pulls, '; method="tikhonov" assumes nothing of the kind'),
        ):
            if here.any():
                said.append(
                    f"contact that only pushes does not explain the readings{some(here)} (adhesion, cells that pull, a wrong pad or "
                    f"unit?){what}"
                )
    if touch.outliers is not None and touch.outliers.any():
        rows = np.flatnonzero(touch.outliers.reshape(-1, touch.outliers.shape[-1]).any(axis=0))
        names = ", ".join(touch.reading_names.get(int(r), f"reading {r}") for r in rows[:4])
        more = f" and {len(rows) - 4} more" if len(rows) > 4 else ""
        said.append(f"left out as unexplained by any contact (dead, stuck or saturated?): {names}{more}")
    if touch.at_limit is not None and touch.at_limit.any():
        most = int(touch.at_limit.reshape(-1, touch.at_limit.shape[-1]).sum(axis=1).max())
        here = touch.at_limit.any(axis=-1)
        said.append(
            f"up to {most} readings at the end of their range{some(here)}: they count as at least that"
            if touch.batch
            else f"{most} readings at the end of their range: they count as at least that"
        )
    said.extend(_nuisances(touch, some))
    if touch.fit is not None:
        poor = np.asarray(touch.fit) < POOR_FIT
        if poor.any():
            how = f" (fit {float(np.asarray(touch.fit)):.1g})" if not touch.batch else ""
            said.append(
                f"the model does not explain the readings{some(poor)}{how}: pad, depth, units, axes and signs of the channels may be wrong, or "
                "taxels broken; the error bars do not know of this"
            )
    return said


def pulling(touch: Touch) -> npt.NDArray[np.bool_]:
    """Frames (*batch) that were found to pull as a whole."""
    if touch.pushing is None:
        return np.zeros(touch.batch, dtype=bool)
    d = touch.surface.dimensions
    total = np.take(to_numpy(touch.values), -1, axis=-1 - d).sum(axis=tuple(range(-d, 0)))
    known = (touch.methods == "adaptive") | (touch.methods == "constrained")
    return np.asarray(~touch.pushing & known & (total < 0))


def _nuisances(touch: Touch, some: Callable[..., str]) -> list[str]:
    """What readings hold besides contact, in their units."""
    if touch.nuisance is None or touch.nuisance_std is None:
        return []
    said = []
    for i, (label, unit) in enumerate(touch.nuisance_names):
        size, std = touch.nuisance[..., i], touch.nuisance_std[..., i]
        found = size != 0
        if found.any():
            if touch.batch:
                said.append(f"{label}{some(found)}: up to {np.abs(size).max():.3g} {unit}")
            else:
                said.append(f"{label}: {float(size):.3g} {unit} (+- {float(std):.2g})")
        hidden = ~found & (std > 0)
        if hidden.any():
            said.append(
                f"the whole edge of the array is loaded{some(hidden)}: the {label} cannot be told from contact; up to "
                f"{float(np.max(np.where(hidden, std, 0.0))):.2g} {unit} of it is in the error bars"
            )
    return said


def summary(one: Touch, friction: float | None) -> str:
    """Force, peak pressure, centre of pressure, contact and slip margin of one frame, one to a line, then the notes."""
    line = one.surface.dimensions == 1
    force = to_numpy(one.force)
    unit = "N/m" if line else "N"
    components = one.surface.components
    if not np.isfinite(force).any():
        return "\n".join(["net force       not known", *(f"note: {n}" for n in one.notes)])
    lines = ["net force       " + ", ".join(f"{c} {v:.4g} {unit}" for c, v in zip(components, force))]
    # some frames have none: found by a method without error bars, or before a stream has made them
    known = one.errors is not None and bool(np.isfinite(one.errors.force).all())
    if one.errors is not None and not known:
        lines.append(f"  95 %          not known for this frame (method {one.methods.item()})")
    elif one.errors is not None:
        low, high = (to_numpy(v) for v in one.interval(0.95, "force"))
        sought = [(c, a, b) for c, a, b in zip(components, low, high) if c in one.components]
        lines.append("  95 %          " + ", ".join(f"{c} {a:.3g} to {b:.3g}" for c, a, b in sought) + f" {unit}")
    if "z" in one.components:
        lines.append(f"peak pressure   {float(one.peak_pressure):.4g} Pa")
        if known:
            low, high = one.interval(0.95, "peak_pressure")
            lines.append(f"  95 %          {float(low):.3g} to {float(high):.3g} Pa")
        centre = to_numpy(one.center_of_pressure)
        lines.append("centre          " + ", ".join(f"{1e3 * float(v):.4g} mm" for v in centre))
        if one.errors is not None and float(one.errors.outside_force[-1]) > OUTSIDE * abs(float(force[-1])):
            outside = float(one.errors.outside_force[-1])
            lines.append(f"outside array   {outside:.3g} {unit} of the normal force, where nothing is measured")
        size = float(one.contact_area())
        lines.append(f"contact         {1e3 * size:.4g} mm" if line else f"contact area    {1e6 * size:.4g} mm^2")
    if friction is not None and set(one.components) == set(components):
        lines.append(f"slip margin     {float(one.slip_margin(friction)):.4g} Pa at friction {friction:g}")
    if one.sliding is not None and float(one.sliding) > 0.5:
        sure = 100 * float(one.sliding)
        lines.append(f"shear           in one proportion to pressure, as where all of it slides: sure to {sure:.0f} %")
    return "\n".join([*lines, *(f"note: {n}" for n in one.notes)])
