"""Nuisance patterns at any size: as `palpate.inverse.linear.patterns`, with a few additional solutions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.rules import Corrected, Search
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.parameter import candidates
from palpate.inverse.linear.patterns import COARSE, Patterns, Removed, Weighed
from palpate.sensing.operator import Operator

__all__ = ["SolvedPatterns"]

#: Number of candidates on either side of the best one that are compared with it.
NEIGHBOURS = 1
#: Largest number of times that the best candidate may change.
MOVES = 12
#: Tolerance and largest number of steps of the patterns' solutions.
TOLERANCE, MOST = 1e-5, 300
#: Solve a frame again if the best candidate is farther than this from its nearest solution (in log lambda).
MAX_DISTANCE = 0.7
#: Prior size of a pattern, relative to the noise, when candidates are compared: practically any size.
LARGEST = 3000.0
#: Candidates whose solutions are cached.
CACHE_SIZE = 12


class SolvedPatterns(Patterns):
    """The patterns of a system; their solutions are reused for the next frame."""

    def __init__(
        self,
        system: System,
        operator: Operator,
        scales: Sequence[Floats],
        kinds: tuple[str, ...] | None,
        parameter: float | None = None,
    ) -> None:
        self.system = system
        self._expanded(operator, system.normal.rows, scales, kinds)
        whole = candidates(np.array([system.freedom.top]))
        self.grid = whole[::COARSE] if parameter is None else np.array([parameter])
        self._solved: dict[int, Floats] = {}

    def taken_out(self, rows: Floats, floor: Floats | None) -> tuple[Removed, Floats, Floats] | None:
        """The rows (frame, n) without the patterns, with start parameters and solutions for them; None without
        patterns.
        """
        if not self.members:
            return None
        each = [self._of_frame(row[None], None if floor is None else floor[i : i + 1]) for i, row in enumerate(rows)]
        removed = Removed(
            *(np.concatenate([getattr(part, name) for part, _, _ in each]) for name in Removed.__dataclass_fields__)
        )
        return removed, np.array([lam for _, lam, _ in each]), np.concatenate([near for _, _, near in each])

    def _of_frame(self, row: Floats, floor: Floats | None) -> tuple[Removed, float, Floats]:
        search = Search(self.system, "evidence", floor)
        curves = Corrected.of(self.system, row)
        place, near, there = 0, np.zeros_like(row), float(self.grid[0])
        if len(self.grid) > 1 and (row**2).sum() > 0:
            found = search.find(row)
            curves, near, there = found.curves, found.solutions, float(found.parameter[0])
            place = int(np.argmin(np.abs(np.log(self.grid / found.parameter[0]))))
        for _ in range(MOVES):
            some = np.arange(max(place - NEIGHBOURS, 0), min(place + NEIGHBOURS + 1, len(self.grid)))
            self.system.freedom.of(self.grid[some])
            if curves.nearest(self.grid[[place]])[0] > MAX_DISTANCE and (row**2).sum() > 0:
                near, there = search.solve(curves, row, self.grid[[place]], start=near), float(self.grid[place])
            tables = self._tables(row, curves, some)
            best = int(some[self._best(tables, floor)])
            if best == place:
                break
            place = best
        weighed, explained, logdet, inner = tables
        removed = self.weighed(row, curves.count, floor, weighed, explained, logdet, inner)
        # The solution is linear in the readings, and the parameter changes the solution of the patterns almost only in
        # size.
        sizes = removed.sizes[0] / np.where(self.units > 0, self.units, 1.0)
        return removed, there, near - (sizes @ self._at(place) / there)[None]

    def _tables(
        self, row: Floats, curves: Corrected, some: np.ndarray[tuple[int], np.dtype[np.intp]]
    ) -> tuple[list[Weighed], Floats, Floats, Floats]:
        """The sets of patterns, c^T D^{-1} c, log det D and B^T D^{-1} c at ``some`` candidates."""
        solved = np.stack([self._at(int(place)) for place in some])  # D^{-1} B (candidate, pattern, n)
        weighed = []
        for members in self.members:
            middle = np.einsum("gin,jn->gij", solved[:, list(members)], self.rows[list(members)])
            weighed.append(Weighed.of(members, 0.5 * (middle + np.swapaxes(middle, 1, 2))))
        log, at = np.log(curves.grid)[::-1], np.log(self.grid[some])
        explained = np.exp(np.interp(at, log, np.log(np.maximum(curves.explained[0], 1e-300))[::-1]))[None]
        logdet = np.interp(at, log, curves.logdet[::-1])
        return weighed, explained, logdet, np.einsum("gin,fn->fgi", solved, row)

    def _best(self, tables: tuple[list[Weighed], Floats, Floats, Floats], floor: Floats | None) -> int:
        """The candidate with the largest evidence, with patterns of any size."""
        weighed, explained, logdet, inner = tables
        score = logdet.copy()
        left = explained[0].copy()
        for each in weighed:
            along = np.einsum("gji,gj->gi", each.vectors, inner[0][:, list(each.members)])
            gain = 1.0 / (LARGEST**-2 + each.values)
            left -= (along**2 * gain).sum(axis=-1)
            score += np.log1p(LARGEST**2 * each.values).sum(axis=-1)
        if floor is None:
            return int(np.argmin(score + left))
        n = float(self.system.normal.count)
        variance = np.maximum(np.maximum(left / n, floor[0]), 1e-300)
        return int(np.argmin(score + n * np.log(variance) + left / variance))

    def _at(self, place: int) -> Floats:
        """lambda (M + lambda)^{-1} of the patterns."""
        if place not in self._solved:
            if len(self._solved) >= CACHE_SIZE:
                self._solved.pop(next(iter(self._solved)))
            lam = np.full(len(self.rows), self.grid[place])
            found = self.system.space.solve(self.rows, lam, tolerance=TOLERANCE, most=MOST)
            self._solved[place] = lam[:, None] * found.rows
        return self._solved[place]
