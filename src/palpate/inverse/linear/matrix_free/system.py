"""A prepared system: the part that does not depend on parameter, rule or readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate._recall import digest
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.freedom import Freedom
from palpate.inverse.linear.matrix_free.iteration import Solved
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.posterior import SampledVariances
from palpate.inverse.linear.matrix_free.spaces import space
from palpate.inverse.linear.posterior import FINEST
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.spectrum import noise_scales
from palpate.sensing.operator import Operator

__all__ = ["System"]


class System:
    """An operator with a prior, ready to be solved for any parameter.

    ``scales`` are the standard deviations by which the readings were divided (channel, per plane); ``noise_known``:
    whether they are the true noise.
    """

    def __init__(self, operator: Operator, priors: Sequence[Prior], columns: Sequence[int]) -> None:
        self.operator, self.columns = operator, tuple(columns)
        self.scales, self.noise_known = noise_scales(operator, columns)
        self.normal = Normal(operator, priors, columns, self.scales)
        self.space = space(self.normal)
        self.freedom = Freedom(self.normal, self.space)
        self.key = digest(
            "freedom",
            operator.pad,
            operator.planes_of,
            operator.surface,
            self.columns,
            [(type(p).__qualname__, p.key) for p in priors],
            list(self.scales),
        )
        if operator.recall is not None and self.key is not None:
            self.freedom.take(operator.recall.entries.get(self.key))

    def worked_out(self) -> dict[str, tuple[Floats, ...]]:
        """Computed degrees of freedom, for `Recall`."""
        return {} if self.key is None else {self.key: (self.freedom.table(),)}

    def solve(
        self,
        rows: Floats,
        parameter: Floats,
        *,
        tolerance: float | Floats,
        most: int,
        start: Floats | None = None,
        checked: bool = True,
    ) -> Solved:
        """(M + lambda)^{-1} rows (frame, n), see `palpate.inverse.linear.matrix_free.iteration.solve`."""
        return self.space.solve(rows, parameter, tolerance=tolerance, most=most, start=start, checked=checked)

    def estimate(
        self, rows: Floats, parameter: Floats, *, tolerance: float | Floats, most: int, start: Floats | None
    ) -> tuple[Solved, Floats]:
        """(M + lambda)^{-1} rows, checked, and their traction (frame, component sought, *surface)."""
        return self.space.estimate(rows, parameter, tolerance=tolerance, most=most, start=start)

    def traction(self, solved: Solved) -> Floats:
        """W H^T u: (frame, component sought, *surface)."""
        return self.space.traction(solved)

    @cached_property
    def variances(self) -> SampledVariances:
        """Error bars of estimates."""
        return SampledVariances(self)

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        held = self.space.nbytes + self.freedom.nbytes
        return held + (self.variances.nbytes if "variances" in self.__dict__ else 0)

    def finest(self, row: Floats) -> float:
        """Mean power of the components of a row to which traction contributes least: an upper bound of white noise."""
        approximate = self.space
        order = np.argsort(approximate.eigenvalues, kind="stable")
        counts = approximate.counts[order]
        least = np.cumsum(counts) <= max(FINEST * counts.sum(), counts[0])
        return float(approximate.powers(row[None])[0, order[least]].sum() / counts[least].sum())
