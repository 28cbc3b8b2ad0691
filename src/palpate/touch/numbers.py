"""Numbers computed from a traction map: force, moment, centre, contact, slip margin."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate._arrays import from_numpy, namespace, to_numpy
from palpate.errors import InvalidInput, NotObservable
from palpate.touch.fields import Fields, pulling
from palpate.units import is_number

__all__ = ["Numbers"]


class Numbers(Fields):
    """The numbers that `Touch` computes from its traction; arrays of the caller's kind, batch axes first."""

    def _require(self, *names: str) -> None:
        missing = [n for n in names if n not in self.components]
        if missing:
            raise NotObservable(
                f"the component{'s' if len(missing) > 1 else ''} {', '.join(missing)} of the traction was not sought: "
                f"only {', '.join(self.components)} {'was' if len(self.components) == 1 else 'were'}, and the rest taken as "
                "zero. Measure more channels or another plane, and ask for it with components=[...]."
            )

    def _component(self, name: str) -> Any:
        d = self.surface.dimensions
        return self.values[(..., self.surface.components.index(name), *(slice(None),) * d)]

    def _integral(self, x: Any) -> Any:
        return self.surface.integral(x)

    def _coordinate(self, name: str) -> Any:
        """x or y [m], shaped to multiply a component."""
        if name == "x":
            return from_numpy(self.surface.x, self.values)
        return from_numpy(self.surface.axes[0][:, None], self.values)

    @property
    def force(self) -> Any:
        """Net force (*batch, axis) [N], or [N/m] on a line; NaN for components in `unobservable_force`.

        It is the vector in the pad's axes: the sum over cells of their area times p n + q_x t_x + q_y t_y, with the normal and tangents of each; of a flat pad
        these are its axes.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.AreaGrid(shape=(10, 10), spacing=1e-3)  # 1 cm^2
        >>> values = np.zeros((3, 10, 10))
        >>> values[2] = 1000.0  # pressed by 1 kPa
        >>> pp.Touch(values, grid, ("x", "y", "z"), "tikhonov").force.round(6).tolist()  # [N]
        [0.0, 0.0, 0.1]
        """
        xp = namespace(self.values)
        total = self.surface.total_force(self.values)
        if self.unobservable_force:
            lost = np.array([math.nan if c in self.unobservable_force else 0.0 for c in self.surface.components])
            total = total + from_numpy(lost, self.values)
        if self.calibrated is not None:
            known = self.calibrated.force
            total = from_numpy(np.where(np.isfinite(known), known, to_numpy(total)), self.values)
        return xp.asarray(total)

    @property
    def moment(self) -> Any:
        """Moment about the origin of the surface coordinates.

        On an area (*batch, 3) [N m]: int r x f, on a flat pad (int y p, -int x p, int (x q_y - y q_x)). On a line (*batch, 1) [N]: about y, -int x p.
        NaN where it involves a component of `unobservable_force`.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.AreaGrid(shape=(10, 10), spacing=1e-3, center=(0.0, 5e-3))  # 1 cm^2, its middle at y = 5 mm
        >>> values = np.zeros((3, 10, 10))
        >>> values[2] = 1000.0  # pressed by 1 kPa: 0.1 N
        >>> (pp.Touch(values, grid, ("x", "y", "z"), "tikhonov").moment * 1e3).round(3)[0].item()  # about x [N mm]
        0.5
        """
        out = self.surface.total_moment(self.values)
        needs = ["z"] if self.surface.dimensions == 1 else ["z", "z", "xy"]
        lost = np.array([math.nan if any(c in self.unobservable_force for c in n) else 0.0 for n in needs])
        return out + from_numpy(lost, self.values)

    @property
    def center_of_pressure(self) -> Any:
        """Centre of pressure, (*batch, 2) as (x, y), or (*batch, 1) on a line [m]: int x p / int p over the `contact`,
        which pushes or pulls; NaN without contact.

        Only the contact counts: far from it the recovered pressure is noise around zero, which a long lever would amplify.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)  # cells at -1.5, -0.5, 0.5 and 1.5 mm
        >>> touch = pp.Touch(np.array([[0.0] * 4, [0.0, 500.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> (touch.center_of_pressure * 1e3).round(3).tolist()  # [mm]
        [0.167]
        """
        self._require("z")
        xp = namespace(self.values)
        p = xp.where(self.contact(), self._component("z"), xp.zeros_like(self._component("z")))
        total = self._integral(p)
        safe = xp.where(total != 0, total, xp.ones_like(total) * math.nan)
        names = ("x",) if self.surface.dimensions == 1 else ("x", "y")
        center = xp.stack([self._integral(self._coordinate(n) * p) / safe for n in names], axis=-1)
        if self.calibrated is not None and self.calibrated.center is not None:
            known = self.calibrated.center
            center = from_numpy(np.where(np.isfinite(known), known, to_numpy(center)), self.values)
        return center

    @property
    def peak_pressure(self) -> Any:
        """Largest pressure (*batch) [Pa]; for a frame that pulls as a whole, its largest pull, negative.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> touch = pp.Touch(np.array([[0.0] * 4, [0.0, 500.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> float(touch.peak_pressure)
        1000.0
        """
        self._require("z")
        p = self._component("z")
        largest, pulls = self._largest(p), self._pulls()
        return namespace(p).where(pulls, -self._largest(-p), largest) if pulls is not None else largest

    def _pulls(self) -> Any:
        """Frames (*batch) with a net pull, as an array of the caller's kind; None without any."""
        found = pulling(self)
        if not found.any():
            return None
        xp = namespace(self.values)
        return xp.astype(from_numpy(found.astype(np.float64), self.values), xp.bool)

    def _largest(self, x: Any) -> Any:
        return namespace(x).max(x, axis=tuple(range(-self.surface.dimensions, 0)))

    def contact(self, *, threshold: float = 0.1) -> Any:
        """Mask (*batch, *surface) of the cells whose pressure exceeds ``threshold`` times its peak.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> touch = pp.Touch(np.array([[0.0] * 4, [5.0, 500.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> touch.contact().tolist(), touch.contact(threshold=0.6).tolist()
        ([False, True, True, False], [False, False, True, False])
        """
        self._require("z")
        if not 0 < threshold < 1:
            raise InvalidInput(f"threshold must lie between 0 and 1; got {threshold!r}.")
        p = self._component("z")
        peak = self.peak_pressure[(..., *(None,) * self.surface.dimensions)]
        if self._pulls() is not None:
            xp = namespace(p)
            sign = xp.where(peak < 0, -xp.ones_like(peak), xp.ones_like(peak))
            return (sign * p > threshold * sign * peak) & (peak != 0)
        return (p > threshold * peak) & (peak > 0)

    def contact_area(self, *, threshold: float = 0.1) -> Any:
        """Area (*batch) [m^2] (a width [m] on a line) of the cells whose pressure exceeds ``threshold`` times its
        peak.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> touch = pp.Touch(np.array([[0.0] * 4, [5.0, 500.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> float(touch.contact_area())  # two cells of 1 mm
        0.002
        """
        xp = namespace(self.values)
        here = xp.astype(self.contact(threshold=threshold), self.values.dtype)
        # NaN for unknown traction
        return self._integral(xp.where(xp.isnan(self._component("z")), self._component("z"), here))

    def slip_margin(self, friction: float | None = None, *, threshold: float = 0.1) -> Any:
        """Grasp stability (*batch) [Pa]: the smallest friction * p - |q| over the contact.

        Positive: every point of the contact could bear more shear. Negative: some point is beyond the friction limit, so it
        slides, or the friction is higher than said. ``threshold`` delimits the contact as in `contact`, because at its
        edge both p and q vanish. NaN without contact. Default ``friction``: the one that the touch was found with.

        Raises
        ------
        InvalidInput
            A friction that is not positive, or a threshold outside 0 to 1.
        NotObservable
            Pressure or shear was not sought.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> shear, pressure = [0.0, 100.0, 200.0, 0.0], [0.0, 500.0, 1000.0, 0.0]
        >>> touch = pp.Touch(np.array([shear, pressure]), grid, ("x", "z"), "tikhonov")
        >>> float(touch.slip_margin(0.5))  # 0.5 * 500 Pa - 100 Pa
        150.0

        >>> float(touch.slip_margin(0.1))  # beyond the friction limit by 100 Pa
        -100.0
        """
        self._require(*self.surface.components)
        friction = self.friction if friction is None else friction
        if friction is None or not (is_number(friction) and friction > 0):
            raise InvalidInput(f"friction must be a positive number; got {friction!r}.")
        xp = namespace(self.values)
        smallest = -self._largest(-self._margins(friction, threshold))
        return xp.where(xp.isfinite(smallest), smallest, xp.ones_like(smallest) * math.nan)

    def _margins(self, friction: float, threshold: float = 0.1) -> Any:
        """friction * p - |q| (*batch, *surface) [Pa], infinite outside the contact."""
        margin = friction * self._component("z") - self._shear_size()
        xp = namespace(margin)
        return xp.where(self.contact(threshold=threshold), margin, xp.ones_like(margin) * math.inf)

    def _shear_size(self) -> Any:
        """|q| (*batch, *surface) [Pa]."""
        d = self.surface.dimensions
        shear = self.values[(..., slice(None, -1), *(slice(None),) * d)]
        xp = namespace(shear)
        return xp.sqrt(xp.sum(shear**2, axis=-1 - d))
