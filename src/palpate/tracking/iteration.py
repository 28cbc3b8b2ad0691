"""The traction on a region's cells, by the alternating direction method of multipliers.

    x = (H + rho)^-1 (h + rho (z - u)),   z = P_K(x + u),   u = u + x - z,   rho = sqrt(lambda_min lambda_max),

where P_K projects on the friction cone (S. Boyd et al., Foundations and Trends in Machine Learning 3, 2011, 1-122). Solution z and
multipliers u are carried from frame to frame.
"""

from __future__ import annotations

import time as clock

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.contact.policy import Policy
from palpate.tracking.health import Flags, Float32, Index
from palpate.tracking.region import Region

__all__ = ["Iteration", "pressing"]

#: Same value as in the contact method.
FAINT = Policy().extent.faint
#: Largest number of iterations in one frame.
ITERATIONS = 300
#: Over-relaxation: Boyd et al., section 3.4.3, recommend 1.5 to 1.8.
RELAXATION = 1.6


def pressing(pressure: Floats | Float32) -> Flags:
    """Mask of the cells in contact. Elsewhere non-negative pressure fits noise."""
    return np.asarray(pressure > FAINT * float(pressure.max(initial=0.0)))


class Iteration:
    """Solution and multipliers on the cells of a region, (component, cell) in the units of `Cone.scales`."""

    def __init__(self, cone: Cone, components: int, cells: int) -> None:
        self._cone, self._components, self._cells = cone, components, cells
        self.clear()

    def clear(self) -> None:
        """Forget region and contact."""
        self.region: Region | None = None
        self.z: Float32 = np.zeros((self._components, 0), dtype=np.float32)
        self.u = self.z.copy()
        self.unconverged_change: Floats | None = (
            None  # remaining change of traction [Pa] (component, cell), if the iteration did not converge
        )
        self.exhausted = False  # whether the last frame ended by its number of steps, not by its time
        self.product = 0.0  # t'A'y of the last frame
        self._traction: tuple[Float32, Floats] | None = None  # of this z

    def shared(self) -> Floats:
        """B'A t: contribution of the solution to the sums of each channel."""
        if self.region is None:
            raise RuntimeError("there is no contact")
        return np.asarray(self.region.shared @ self.z.ravel().astype(np.float64))

    def move(self, region: Region) -> None:
        """Move solution and multipliers to another region."""
        whole = np.zeros((2, self._components, self._cells), dtype=np.float32)
        if self.region is not None:
            whole[0][:, self.region.cells], whole[1][:, self.region.cells] = self.z, self.u
        self.region = region
        self.z, self.u = whole[0][:, region.cells], whole[1][:, region.cells]
        self.unconverged_change = None

    @property
    def pressure(self) -> Float32:
        return self.z[-1]

    @property
    def cells(self) -> Index | None:
        """The region's cells; None without one."""
        return None if self.region is None else self.region.cells

    @property
    def pressing(self) -> Flags:
        """Mask of the region's cells that are in contact."""
        return pressing(self.pressure)

    @property
    def parameter(self) -> float:
        """The penalty; 0 without a region."""
        return 0.0 if self.region is None else self.region.parameter

    @property
    def contact(self) -> tuple[Index, Floats] | None:
        """The cells in contact, and their traction (component, cell) [Pa]; None without a region."""
        if self.region is None:
            return None
        pressing = self.pressing
        return self.region.cells[pressing], self.traction[:, pressing]

    @property
    def traction(self) -> Floats:
        """Traction [Pa], (component, cell)."""
        if self._traction is None or self._traction[0] is not self.z:
            self._traction = self.z, np.asarray(self.z * self._cone.scales[:, None], dtype=np.float64)
        return self._traction[1]

    def solve(self, slope: Floats, gain: Floats | None = None, *, tolerance: float, deadline: float) -> bool:
        """Update the solution to a frame with A'y = ``slope``; False if time or number of iterations ran out.

        With ``gain`` (K of `palpate.tracking.offsets`), ``slope`` is that of readings minus marginalised offsets. It
        stops when traction changes by less than ``tolerance`` of its peak, or at the time ``deadline`` of
        `time.perf_counter`.
        """
        region, cone = self.region, self._cone
        if region is None:
            return False
        rho, inverse = np.float32(region.rho), region.inverse
        h = (slope[:, region.cells] * cone.scales[:, None]).astype(np.float32)
        z, u = self.z, self.u
        shape = z.shape
        converged = False
        left, right = (None, None) if gain is None else region.correction(gain)

        def solved(b: Float32) -> Float32:
            x = inverse @ b.ravel()
            if left is not None and right is not None:
                x = x + left @ (right @ b.ravel())
            return np.asarray(x.reshape(shape))

        self.exhausted = False
        x, before, pushed = z, z, u
        for _ in range(ITERATIONS):
            before, pushed = z, u
            x = solved(h + rho * (z - u))
            relaxed = np.float32(RELAXATION) * x - np.float32(RELAXATION - 1.0) * z
            new = cone.project(relaxed + u).astype(np.float32, copy=False)
            u = u + relaxed - new
            size = max(float(new[-1].max(initial=0.0)), 1e-30)
            change = max(float(np.abs(new - z).max(initial=0.0)), 0.5 * float(np.abs(x - new).max(initial=0.0)))
            z = new
            if change < tolerance * size:
                converged = True
                break
            if clock.perf_counter() > deadline:
                break
        else:
            self.exhausted = True
        self.z, self.u, self.unconverged_change = z, u, None
        if not converged:
            # -(H + rho)^-1 (H z - h + rho u), with (H + rho) x = h + rho (z - u) of the step before
            left_over = x - z - rho * solved(before - z + u - pushed)
            self.unconverged_change = np.asarray(left_over * cone.scales[:, None], dtype=np.float64)
        self.product = float((z * h).sum(dtype=np.float64))
        if not np.isfinite(z).all():
            raise np.linalg.LinAlgError("the iteration has no finite result")
        return converged
