"""The analog network: units with saturating outputs whose potentials minimise the regularised misfit over time.

Outputs V = g(u) of potentials u, du/dt = -dE/dV (J. J. Hopfield, PNAS 81, 1984, 3088-3092).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.comparison.whole_map import Comparison, Found, Frame, WholeMap
from palpate.inverse.constrained.cone import minimise
from palpate.inverse.method import number
from palpate.inverse.problem import Problem

__all__ = ["AnalogNetwork"]

#: The network has settled when its outputs are this close (relative) to their equilibrium; it runs for at most HORIZON
#: [RC].
SETTLED, HORIZON = 0.02, 1e8


@dataclass(frozen=True, kw_only=True)
class AnalogNetwork(Comparison):
    """A network of units with saturating outputs; its couplings are the pad's response and a smoothness of weight lambda
    (J. J. Hopfield, PNAS 81, 1984, 3088-3092).

    Examples
    --------
    >>> import palpate as pp
    >>> pp.comparison.AnalogNetwork().chosen  # lambda follows from the noise, given or estimated
    'discrepancy'
    """

    name: ClassVar[str] = "network"
    summary: ClassVar[str] = "for comparison: where an analog network settles"
    rules: ClassVar[tuple[str, ...]] = ("discrepancy",)

    parameter: float | None = number(
        help="weight of the smoothness (default: the largest that explains the readings to the noise)"
    )

    def prepare(self, problem: Problem) -> _AnalogNetwork:
        """Matrix and linear model of the whole map."""
        self.check(problem)
        return _AnalogNetwork(problem, self.name, self.parameter)


class _AnalogNetwork(WholeMap):
    settles = True

    def unit(self, p: Frame) -> float:
        """Unit of the conductance."""
        return float(np.diagonal(p.gram).mean())

    def frame(self, p: Frame, start: Floats, noise: float) -> Found:
        """The final state of the network and the time to reach it."""
        found = super().frame(p, start, noise)
        x, settling, settled = self._flow(p, found.parameter)
        return replace(found, traction=x, converged=found.converged and settled, settling=settling)

    def minimised(self, p: Frame, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """The final state of the network: the regularised solution with every output inside its range."""
        solution = minimise(self._hessian(p, parameter), p.linear, self.cone, start)
        return solution.traction, solution.converged

    def _hessian(self, p: Frame, parameter: float) -> Floats:
        hessian = p.gram.copy()
        n = p.shape[1]
        laplacian = self.differences.laplacian.toarray() * float(np.mean(np.square(self.grid.spacings)))
        for i in range(p.shape[0]):
            hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += parameter * laplacian
        return hessian

    def _flow(self, p: Frame, parameter: float) -> tuple[Floats, float, bool]:
        """Run the network from rest until its outputs are within `SETTLED` of their final values.

        Time is in units of RC = 1/(largest conductance). Outputs saturate: pressure in (0, top) by a diode and a limiter,
        shear in (-top, top) by a limiter.
        """
        import scipy.integrate

        hessian, linear = self._hessian(p, parameter), p.linear.ravel()
        target = minimise(hessian, p.linear, self.cone).traction.ravel()
        size = max(float(np.abs(target).max()), 1e-300)
        top, knee = 4.0 * size, 1e-3 * size
        rate = 1.0 / float(np.diagonal(hessian).max())
        pressure = np.zeros(p.shape, dtype=bool)
        pressure[-1] = True
        flat = pressure.ravel()

        def output(u: Floats) -> Floats:
            opened = np.where(flat, knee * np.logaddexp(0.0, u / knee), u)
            return np.asarray(top * np.tanh(opened / top))

        def slope(u: Floats) -> Floats:
            open_slope = np.where(flat, 1.0 / (1.0 + np.exp(np.clip(-u / knee, -500.0, 500.0))), 1.0)
            return np.asarray(open_slope * (1.0 - (output(u) / top) ** 2))

        def flow(_: float, u: Floats) -> Floats:
            return np.asarray(rate * (linear - hessian @ output(u)))

        def jacobian(_: float, u: Floats) -> Floats:
            return np.asarray(-rate * hessian * slope(u)[None, :])

        def settled(_: float, u: Floats) -> float:
            return float(np.linalg.norm(output(u) - target)) - SETTLED * float(np.linalg.norm(target))

        settled.terminal = True  # type: ignore[attr-defined]
        run = scipy.integrate.solve_ivp(
            flow,
            (0.0, HORIZON),
            np.zeros(p.gram.shape[0]),
            method="BDF",
            jac=jacobian,
            events=settled,
            rtol=1e-3,
            atol=1e-3 * size,
        )
        ended = bool(len(run.t_events[0]))
        final = run.y_events[0][-1] if ended else run.y[:, -1]
        return output(final).reshape(p.shape), float(run.t_events[0][-1] if ended else HORIZON), ended
