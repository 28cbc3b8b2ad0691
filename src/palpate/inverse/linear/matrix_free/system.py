"""A prepared system: the part that does not depend on parameter, rule or readings."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.freedom import Freedom
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.spaces import space
from palpate.inverse.linear.posterior import Variances
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.spectrum import noise_scales, recall_key
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
        #: Error bars of estimates, once `MatrixFree` has made them.
        self.variances: Variances | None = None
        self.key = recall_key("freedom", operator, columns, priors, self.scales)
        if operator.recall is not None and self.key is not None:
            self.freedom.take(operator.recall.entries.get(self.key))

    def worked_out(self) -> dict[str, tuple[Floats, ...]]:
        """Computed degrees of freedom, for `Recall`."""
        return {} if self.key is None else {self.key: (self.freedom.table(),)}

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        held = self.space.nbytes + self.freedom.nbytes
        return held if self.variances is None else held + self.variances.nbytes
