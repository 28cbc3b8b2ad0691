"""A touch in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate._arrays import to_numpy
from palpate.touch.outcome import Outcome

if TYPE_CHECKING:
    from palpate.touch.result import Touch

__all__ = ["outcome", "summary"]

#: Part of the normal force that lies outside the outermost taxels from which on a summary says so.
OUTSIDE = 0.05


def outcome(touch: Touch) -> list[str]:
    """What became of the frames of a touch, one sentence for each thing that happened."""
    return Outcome.of(touch).words()


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
