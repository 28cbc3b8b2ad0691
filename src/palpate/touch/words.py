"""A touch in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.status import Status

if TYPE_CHECKING:
    from palpate.touch.result import Touch

__all__ = ["outcome", "summary"]

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
    if touch.pushing is not None and not touch.pushing.all():
        linear = (touch.methods != "adaptive") & (touch.methods != "constrained") & ~touch.pushing
        for here, what in (
            (linear, "; the linear method was used"),
            (~touch.pushing & ~linear, '; method="tikhonov" assumes nothing of the kind'),
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
    return said


def summary(one: Touch, friction: float | None) -> str:
    """Force, peak pressure, centre of pressure, contact and slip margin of one frame, one to a line, then the notes."""
    line = one.surface.dimensions == 1
    force = to_numpy(one.force)
    unit = "N/m" if line else "N"
    components = one.surface.components
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
