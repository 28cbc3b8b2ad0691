"""Methods for those who compare: each through the same call, each with its parameter chosen by itself.

- nnls: least squares with p >= 0 and nothing else (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974);
- elastic_net: lambda times the first norm of t and lambda times its square (H. Zou, T. Hastie, J. R. Stat. Soc. B 67, 2005,
  301-320), p >= 0;
- tv: lambda times the integral of the size of grad t (L. Rudin, S. Osher, E. Fatemi, Physica D 60, 1992, 259-268), p >= 0;
- maxent: lambda sum p ln(p/m) - p + m, m the mean (J. Skilling, R. K. Bryan, Mon. Not. R. Astron. Soc. 211, 1984, 111-124);
- network: the analog network: units with saturating outputs V = g(u) whose potentials u run down the regularised misfit,
  du/dt = -dE/dV (J. J. Hopfield, PNAS 81, 1984, 3088-3092), until they settle.

The parameter of all but nnls is the largest whose misfit still equals the noise (V. A. Morozov's discrepancy principle, 1966), the
noise being the array's own or, where not given, the one that makes the linear model most likely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._arrays import from_numpy, to_numpy
from palpate._memory import require
from palpate.elastic.half_space import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.cone import Cone, minimise
from palpate.inverse.parameter import tikhonov
from palpate.inverse.priors import DifferencePrior
from palpate.inverse.regularised import Estimate, Regularised, check_spectrum
from palpate.inverse.stencil import Stencil
from palpate.inverse.whitening import Readings
from palpate.sensing.operator import Operator

__all__ = ["FAMILY", "Family"]

FAMILY = ("nnls", "elastic_net", "tv", "maxent", "network")

#: Largest number of unknowns; these methods keep the whole map.
LARGEST = 6000
#: Non-negative least squares: cells are tried from this part of the first guess's peak on; all others pull by less than the second
#: part of the largest pull in the end; rounds.
TRIED, OPTIMAL, ROUNDS_OF_CELLS = 0.02, 1e-10, 60
#: Misfit is brought this near to the noise (relative).
DISCREPANCY = 0.01
#: Reweighted least squares for total variation: smallest gradient, as a part of the largest, and rounds.
SMALLEST_GRADIENT, ROUNDS = 1e-4, 30
#: The network has settled when its outputs are this near to their equilibrium; it is run for this long at most [RC].
SETTLED, HORIZON = 0.02, 1e8


@dataclass
class _Problem:
    """One frame, whitened, in units in which the largest unregularised traction is of order one."""

    matrix: Floats
    data: Floats
    gram: Floats
    linear: Floats
    shape: tuple[int, int]


class Family:
    """One of `FAMILY`, prepared once for an operator and the components sought."""

    def __init__(self, operator: Operator, columns: Sequence[int], method: str, parameter: float | str | None) -> None:
        if parameter is not None and isinstance(parameter, str) and parameter != "discrepancy":
            raise Unsupported(f'method="{method}" takes a number or parameter="discrepancy"; got {parameter!r}.')
        if (
            parameter is not None
            and not isinstance(parameter, str)
            and not (math.isfinite(parameter) and parameter > 0)
        ):
            raise InvalidInput(f"parameter must be a positive number or a rule; got {parameter!r}.")
        check_spectrum(operator.pad, operator.planes_of, operator.surface, len(columns))
        unknowns = len(columns) * math.prod(operator.surface.shape)
        readings = sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)
        if unknowns > LARGEST:
            raise Unsupported(
                f'method="{method}" keeps the whole map, and {unknowns} unknowns are too many (limit {LARGEST}). Give a '
                'coarser surface (Skin(..., surface=...)), or use method="adaptive" or "tikhonov".'
            )
        # the whole map twice, what is sought of it scaled and whitened, and a handful of normal matrices
        require(
            8.0
            * readings
            * (2.0 * len(operator.surface.components) * math.prod(operator.surface.shape) + 2.0 * unknowns)
            + 48.0 * unknowns**2,
            f'method="{method}": {readings} readings and {unknowns} unknowns',
            'Use method="adaptive" or "tikhonov".',
        )
        names = tuple(operator.surface.components[c] for c in columns)
        if "z" not in names:
            raise Unsupported(f'method="{method}" keeps pressure from pulling: seek component z as well.')
        if method == "maxent" and names != ("z",):
            raise Unsupported('method="maxent" is for pressure alone, which is positive: components=["z"].')
        self.operator, self.columns, self.method = operator, list(columns), method
        self.parameter = None if isinstance(parameter, str) else parameter
        self.cone = Cone(names)
        grid = operator.surface
        self.linear = Regularised(operator, [DifferencePrior(grid, 1)] * len(columns), columns, tikhonov, "evidence")
        self.scales, self.noise_known = self.linear.scales, self.linear.noise_known
        self.stencil = Stencil(grid)
        dense = operator.dense().reshape(-1, len(grid.components), math.prod(grid.shape))
        self.readings = Readings(operator, self.scales)
        self._all = np.ones(len(dense), dtype=bool)
        scaled = dense[:, self.columns].reshape(len(dense), -1) / self.readings.std[:, None]
        self._matrix = self.readings.white(scaled, self._all)
        self._gram = self._matrix.T @ self._matrix

    def solve(self, readings: Sequence[Any]) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane."""
        like, grid = readings[0], self.operator.surface
        planes = self.operator.planes_of
        batch = tuple(like.shape[: -1 - len(planes[0].shape)])
        arrays = [
            to_numpy(r).astype(np.float64).reshape(-1, len(a.channels), *a.shape) for r, a in zip(readings, planes)
        ]
        count = math.prod(batch)
        values = np.zeros((count, len(grid.components), *grid.shape))
        parameters, noises, residuals, settling = (np.zeros(count) for _ in range(4))
        converged = np.ones(count, dtype=bool)
        for i in range(count):
            rows = self.operator.heard([a[i] for a in arrays])
            start = self.linear.solve(rows)
            noise = float(np.asarray(start.noise_scale).ravel()[0])
            first = np.asarray(start.traction)[self.columns].reshape(len(self.columns), -1)
            y = self.readings.white(self.readings.flat(rows) / self.readings.std, self._all)
            shape = (len(self.columns), math.prod(grid.shape))
            problem = _Problem(self._matrix, y, self._gram, (self._matrix.T @ y).reshape(shape), shape)
            if not y.any():
                x: Floats = np.zeros(shape)
            else:
                x, parameters[i], converged[i], settling[i] = self._frame(problem, self.cone.nearest(first), noise)
            values[i][self.columns] = x.reshape(len(self.columns), *grid.shape)
            noises[i] = noise
            misfit = float(np.sqrt(np.mean((self._matrix @ x.ravel() - y) ** 2)))
            residuals[i] = misfit / (1.0 if self.noise_known else max(noise, 1e-300))
        values = values.reshape((*batch, *values.shape[1:]))
        return Estimate(
            from_numpy(values, like),
            None if self.method == "nnls" else parameters.reshape(batch),
            noises.reshape(batch),
            residuals.reshape(batch),
            converged=converged.reshape(batch),
            settling=settling.reshape(batch) if self.method == "network" else None,
        )

    # -- one frame -----------------------------------------------------------------------------------------------------

    def _frame(self, p: _Problem, start: Floats, noise: float) -> tuple[Floats, float, bool, float]:
        """Traction (component, cell), parameter, whether it converged, settling time."""
        if self.method == "nnls":
            x, converged = self._non_negative(p, start)
            return x, 0.0, converged, 0.0
        steps: dict[str, Callable[[_Problem, float, Floats], tuple[Floats, bool]]] = {
            "elastic_net": self._elastic_net,
            "tv": self._total_variation,
            "maxent": self._maximum_entropy,
            "network": self._equilibrium,
        }
        solve = steps[self.method]
        if self.parameter is not None:
            chosen = self.parameter
            x, converged = solve(p, chosen, start)
        else:
            chosen, x, converged = self._discrepancy(p, solve, start, noise)
        settling = 0.0
        if self.method == "network":
            x, settling, settled = self._flow(p, chosen)
            converged = converged and settled
        return x, chosen, converged, settling

    def _non_negative(self, p: _Problem, start: Floats) -> tuple[Floats, bool]:
        """Least squares with p >= 0: the library's active-set solver on some columns, until no other would lower the misfit.

        The solver asks for x >= 0 alone; shear is free of sign as the difference of two.
        """
        import scipy.optimize

        column = np.concatenate([np.arange(p.linear.size), np.arange(p.linear[:-1].size)])
        sign = np.where(np.arange(len(column)) < p.linear.size, 1.0, -1.0)
        guess = sign * start.ravel()[column]
        if not guess.max() > 0:
            guess = sign * p.linear.ravel()[column]
        tried = np.flatnonzero(guess > TRIED * max(float(guess.max()), 0.0))
        x: Floats = np.zeros(p.linear.size)
        least = OPTIMAL * float(np.abs(p.linear).max())
        for _ in range(ROUNDS_OF_CELLS):
            if not len(tried):  # nothing pushes (and the library's solver does not survive an empty problem)
                return x.reshape(p.shape), True
            c, s = column[tried], sign[tried]
            # as many rows as columns are enough
            whole = np.concatenate([p.matrix[:, c] * s, p.data[:, None]], axis=1)
            triangle = np.asarray(np.linalg.qr(whole, mode="r"))
            try:
                found = scipy.optimize.nnls(triangle[:, :-1], triangle[:, -1], maxiter=30 * len(column))[0]
            except RuntimeError:  # it has run out of steps
                return x.reshape(p.shape), False
            x = np.zeros(p.linear.size)
            np.add.at(x, c, s * found)
            pull = sign * (p.matrix.T @ (p.data - p.matrix @ x))[column]
            pull[tried] = 0.0
            missing = np.flatnonzero(pull > least)
            if not len(missing):
                return x.reshape(p.shape), True
            most = missing[np.argsort(-pull[missing])][: max(200, len(tried) // 2)]
            tried = np.union1d(tried[found > 0], most)
        return x.reshape(p.shape), False

    def _discrepancy(
        self, p: _Problem, solve: Callable[[_Problem, float, Floats], tuple[Floats, bool]], start: Floats, noise: float
    ) -> tuple[float, Floats, bool]:
        """The parameter whose root mean square misfit is the noise, by bisection of its logarithm."""
        size = float(np.abs(p.linear).max())
        unit = size if self.method != "network" else float(np.diagonal(p.gram).mean())
        low, high = math.log(1e-9 * unit), math.log(10.0 * unit)
        x, converged, middle = start, True, high
        for _ in range(24):
            middle = 0.5 * (low + high)
            x, converged = solve(p, math.exp(middle), x)
            misfit = float(np.sqrt(np.mean((p.matrix @ x.ravel() - p.data) ** 2)))
            if abs(misfit - noise) < DISCREPANCY * noise or high - low < 0.02:
                break
            if misfit > noise:
                high = middle
            else:
                low = middle
        return math.exp(middle), x, converged

    def _elastic_net(self, p: _Problem, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """1/2 |A t - y|^2 + lambda |t|_1 + lambda |t|^2/(2 t0), with t0 the size of the traction, so that both count alike.

        With shear sought the first norm of a cell is p + |q|, by reweighting of |q|.
        """
        size = max(float(np.abs(start).max()), 1e-300)
        ridge = parameter / size
        x = start
        converged = True
        rounds = 1 if p.shape[0] == 1 else 8
        for _ in range(rounds):
            diagonal = np.full(p.shape, ridge)
            linear = p.linear.copy()
            linear[-1] -= parameter
            if p.shape[0] > 1:
                shear = np.sqrt((x[:-1] ** 2).sum(axis=0))
                diagonal[:-1] += parameter / np.maximum(shear, 1e-4 * size)
            solution = minimise(p.gram + np.diag(diagonal.ravel()), linear, self.cone, x)
            x, converged = solution.traction, solution.converged
        return x, converged

    def _total_variation(self, p: _Problem, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """Iteratively reweighted least squares with the constraints solved exactly in each round."""
        grid, n = self.operator.surface, p.shape[1]
        x = start
        converged = False
        solution = None
        for _ in range(ROUNDS):
            hessian = p.gram.copy()
            for i in range(p.shape[0]):
                energy = self.stencil.energy([(d @ x[i]) ** 2 for d in self.stencil.differences])
                size = np.sqrt(grid.dimensions * energy)
                size = np.maximum(size, SMALLEST_GRADIENT * max(float(size.max()), 1e-300))
                hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += (
                    parameter * grid.spacings[-1] * self.stencil.local(size)
                ).toarray()
            solution = minimise(hessian, p.linear, self.cone, x, tolerance=1e-6)
            change = float(np.abs(solution.traction - x).max()) / max(float(np.abs(x).max()), 1e-300)
            x = solution.traction
            if change < 1e-3:
                converged = solution.converged
                break
        return x, converged

    def _maximum_entropy(self, p: _Problem, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """Bounded quasi-Newton (L-BFGS-B) in the logarithm of pressure, which is positive by itself."""
        import scipy.optimize

        model = max(float(np.mean(start)), 1e-6 * float(np.abs(start).max()))
        scale = 1.0 / max(float(np.abs(p.linear).max()) * model, 1e-300)

        def objective(u: Floats) -> tuple[float, Floats]:
            t = model * np.exp(u)
            gradient = p.gram @ t - p.linear.ravel()
            value = 0.5 * float(t @ (gradient - p.linear.ravel())) + parameter * float((t * (u - 1.0) + model).sum())
            return scale * value, scale * t * (gradient + parameter * u)

        guess = np.log(np.maximum(start.ravel(), 1e-3 * model) / model)
        found = scipy.optimize.minimize(
            objective,
            guess,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-30.0, 30.0)] * len(guess),
            options={"maxiter": 3000},
        )
        return model * np.exp(found.x).reshape(p.shape), bool(found.success)

    # -- the analog network --------------------------------------------------------------------------------------------

    def _equilibrium(self, p: _Problem, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """Where the network settles: the regularised solution with every output inside its range."""
        solution = minimise(self._network_hessian(p, parameter), p.linear, self.cone, start)
        return solution.traction, solution.converged

    def _network_hessian(self, p: _Problem, parameter: float) -> Floats:
        hessian = p.gram.copy()
        n = p.shape[1]
        laplacian = self.stencil.laplacian.toarray() * float(np.mean(np.square(self.operator.surface.spacings)))
        for i in range(p.shape[0]):
            hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += parameter * laplacian
        return hessian

    def _flow(self, p: _Problem, parameter: float) -> tuple[Floats, float, bool]:
        """Run the network from rest until its outputs are within `SETTLED` of where they end.

        Time is in units of RC = 1/(largest conductance). Outputs saturate: pressure in (0, top) by a diode and a limiter,
        shear in (-top, top) by a limiter.
        """
        import scipy.integrate

        hessian, linear = self._network_hessian(p, parameter), p.linear.ravel()
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
