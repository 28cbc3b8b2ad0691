"""Corrects an approximation on whole lattices for missing readings.

Of readings v that are there and m that are missing, the inverse of K = M + lambda over v alone is the Schur complement of the inverse B over the whole
lattice (F. Zhang, The Schur Complement and Its Applications, 2005, section 0.2):

    (K_vv)^{-1} = B_vv - B_vm (B_mm)^{-1} B_mv

so that an approximate B serves a lattice with gaps as well as a whole one: eigenvalues of the two interlace. B_mm is as large as what is missing.
Without it, each gap costs the iteration some steps: twelve among a thousand vectors took four times as many.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats

__all__ = ["Gaps", "gaps_of"]

#: Factor the matrix of up to this many missing readings of a lattice (a third of a second for each parameter); more gaps count as readings of zero.
MAX_FACTORED_GAPS = 1500
#: Largest total count of numbers in cached factors.
CACHE_NUMBERS = 30_000_000
#: What is added to the diagonal, as a part of its largest, in double and in single precision: rounding there is taken up, and not divided by.
ROUNDING = {np.dtype(np.float64): 1e-13, np.dtype(np.float32): 1e-6}


class Gaps:
    """What is missing on one lattice: ``index`` among the entries of a row."""

    def __init__(self, index: npt.NDArray[np.intp], blocks: Sequence[Floats], kind: Any) -> None:
        """``blocks`` are B_mm of each parameter."""
        from scipy.linalg import cho_factor

        self.index = index
        self._factors = []
        for block in blocks:
            diagonal = np.diag_indices_from(block)
            block[diagonal] += ROUNDING[np.dtype(kind)] * float(block[diagonal].max())
            self._factors.append(cho_factor(block, lower=True, overwrite_a=True, check_finite=False))

    def weights(self, values: Any, place: npt.NDArray[np.intp]) -> Any:
        """(B_mm)^{-1} of what an inverse makes of rows (frame, missing), each with the parameter at its ``place``."""
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
    """Correction for a lattice whose members miss the entries ``index`` of a row; ``block(parameter, member, member)`` gives B_mm between two
    members. None if nothing or too much is missing.
    """
    size = sum(map(len, index))
    if not 0 < size <= MAX_FACTORED_GAPS or size**2 * parameters > CACHE_NUMBERS:
        return None
    members = range(len(index))
    blocks = [np.block([[block(p, i, j) for j in members] for i in members]) for p in range(parameters)]
    return Gaps(np.concatenate(index), blocks, kind)
