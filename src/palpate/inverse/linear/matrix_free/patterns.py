"""Nuisance patterns at any size: as `palpate.inverse.linear.patterns`, with a few additional solutions."""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.rules import Corrected, Search
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.parameter import candidates
from palpate.inverse.linear.patterns import COARSE, SIZES, Patterns, Removed
from palpate.inverse.linear.solution import joined

__all__ = ["SolvedPatterns"]

#: Number of candidates on either side of the best one that are compared with it.
NEIGHBOURS = 1
#: Largest number of times that the best candidate may change.
MOVES = 12
#: Tolerance and largest number of steps of the patterns' solutions.
TOLERANCE, MOST = 1e-5, 300
#: Solve a frame again if the best candidate is farther than this from its nearest solution (in log lambda).
MAX_DISTANCE = 0.7
#: Candidates whose solutions are cached.
CACHE_SIZE = 12


class SolvedPatterns(Patterns):
    """The patterns of a system; their solutions are reused for the next frame."""

    def __init__(self, system: System, kinds: tuple[str, ...] | None, parameter: float | None = None) -> None:
        whole = candidates(np.array([system.freedom.top]))[::COARSE]
        grid = whole if parameter is None else np.array([parameter])
        super().__init__(system.operator, system.normal.rows, system.scales, kinds, grid)
        self.system = system
        self._solved: dict[int, Floats] = {}

    def removed(self, rows: Floats, floor: Floats | None) -> Removed:
        return self.removed_near(rows, floor)[0]

    def removed_near(self, rows: Floats, floor: Floats | None) -> tuple[Removed, Floats, Floats]:
        """``rows`` (frame, n) without the patterns, with start parameters and solutions for them."""
        each = [self._of_frame(row[None], None if floor is None else floor[i : i + 1]) for i, row in enumerate(rows)]
        removed, parameter, near = zip(*each)
        return joined(removed), np.array(parameter), np.concatenate(near)

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
            solved = np.stack([self._at(int(candidate)) for candidate in some])  # D^{-1} B (candidate, pattern, n)
            middle = np.einsum("gin,jn->gij", solved, self.rows)
            middle = 0.5 * (middle + np.swapaxes(middle, 1, 2))
            inner = np.einsum("gin,fn->fgi", solved, row)
            explained, _, logdet, _ = curves.at(self.grid[some])
            # Candidates are compared with patterns of practically any size.
            wide = middle + np.eye(len(self.all)) / SIZES[-1] ** 2
            left = explained - np.einsum("fgi,gi->fg", inner, np.linalg.solve(wide, inner[0, ..., None])[..., 0])
            scores, _ = self.score(left, logdet + np.linalg.slogdet(wide)[1], floor)
            best = int(some[np.argmin(scores[0])])
            if best == place:
                break
            place = best
        removed = self.weighed(row, floor, middle, explained, logdet, inner)
        # The solution is linear in the readings, and the parameter changes the solution of the patterns almost only in
        # size.
        return removed, there, near - ((removed.sizes[0] / self.units) @ self._at(place) / there)[None]

    def _at(self, place: int) -> Floats:
        """lambda (M + lambda)^{-1} of the patterns."""
        if place not in self._solved:
            if len(self._solved) >= CACHE_SIZE:
                self._solved.pop(next(iter(self._solved)))
            lam = np.full(len(self.rows), self.grid[place])
            found = self.system.space.solve(self.rows, lam, tolerance=TOLERANCE, most=MOST)
            self._solved[place] = lam[:, None] * found.rows
        return self._solved[place]
