"""Correct an approximation on whole lattices for missing readings.

Let v be the present readings and m the missing ones. The inverse of K = M + lambda over v is the Schur complement of
the inverse B over the whole lattice (F. Zhang, The Schur Complement and Its Applications, 2005, section 0.2):

    (K_vv)^{-1} = B_vv - B_vm (B_mm)^{-1} B_mv.

So an approximate B is as accurate for a lattice with gaps as for a whole one, because the eigenvalues interlace. B_mm
is as large as the number of missing readings. Without the correction each gap costs some iterations: twelve gaps among
a thousand vectors took four times as many.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats

__all__ = ["Gaps", "gaps_of"]

#: Largest number of missing readings for which the matrix is factorised (a third of a second per parameter); with more,
#: missing readings count as zero.
MAX_FACTORED_GAPS = 1500
#: Largest total count of numbers in cached factors.
CACHE_NUMBERS = 30_000_000
#: Added to the diagonal, as a fraction of its largest entry, in double and in single precision, against division by
#: rounding errors.
ROUNDING = {np.dtype(np.float64): 1e-13, np.dtype(np.float32): 1e-6}


class Gaps:
    """The missing entries of one lattice: ``index`` among the entries of a row."""

    def __init__(self, index: npt.NDArray[np.intp], blocks: Sequence[Floats], kind: Any) -> None:
        """Factorise the ``blocks`` B_mm of each parameter."""
        from scipy.linalg import cho_factor

        self.index = index
        self._factors = []
        for block in blocks:
            diagonal = np.diag_indices_from(block)
            block[diagonal] += ROUNDING[np.dtype(kind)] * float(block[diagonal].max())
            self._factors.append(cho_factor(block, lower=True, overwrite_a=True, check_finite=False))

    def weights(self, values: Any, place: npt.NDArray[np.intp]) -> Any:
        """(B_mm)^{-1} times the missing part (frame, missing) of rows; ``place`` is the index of each row's parameter."""
        from scipy.linalg import cho_solve

        out = np.empty(values.shape)
        for i in np.unique(place):
            some = place == i
            out[some] = cho_solve(self._factors[i], values[some].T.astype(np.float64), check_finite=False).T
        return out.astype(values.dtype)


def gaps_of(
    index: Sequence[npt.NDArray[np.intp]],
    block: Callable[[int, int, int], Floats],
    parameters: int,
    kind: Any,
) -> Gaps | None:
    """Correction for a lattice in which the entries ``index`` of each member are missing. ``block(parameter, member,
    member)`` returns B_mm between two members. None if nothing is missing, or too much.
    """
    size = sum(map(len, index))
    if not 0 < size <= MAX_FACTORED_GAPS or size**2 * parameters > CACHE_NUMBERS:
        return None
    members = range(len(index))
    blocks = [np.block([[block(p, i, j) for j in members] for i in members]) for p in range(parameters)]
    return Gaps(np.concatenate(index), blocks, kind)
