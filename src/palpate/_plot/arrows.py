"""Select the cells of a map that get an arrow."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats

__all__ = ["arrow_cells"]


def arrow_cells(
    size: Floats, apart: tuple[float, float], least: Floats | float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return rows and columns of the cells that get an arrow, strongest first. No two are closer than ``apart`` cells,
    and none is weaker than ``least``.

    A fixed grid of arrows would miss anything smaller than its step; this selection always includes the strongest cell
    of a small adhesion.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate._plot import arrow_cells
    >>> size = np.zeros((40, 40))
    >>> size[7, 13] = 2.0  # a single cell
    >>> size[20:30, 20:30] = 1.0
    >>> rows, columns = arrow_cells(size, (5.0, 5.0), 0.1)
    >>> (int(rows[0]), int(columns[0])), len(rows)
    ((7, 13), 7)
    """
    rows, columns = np.nonzero(size > least)
    order = np.argsort(-size[rows, columns], kind="stable")
    free = np.ones(size.shape, dtype=bool)
    picked = []
    reach = [max(int(np.ceil(a)), 1) for a in apart]
    for i, j in zip(rows[order], columns[order]):
        if not free[i, j]:
            continue
        picked.append((i, j))
        top, left = max(i - reach[0] + 1, 0), max(j - reach[1] + 1, 0)
        here = free[top : i + reach[0], left : j + reach[1]]
        ii, jj = np.ogrid[top - i : top - i + here.shape[0], left - j : left - j + here.shape[1]]
        here &= (ii / apart[0]) ** 2 + (jj / apart[1]) ** 2 >= 1.0
        free[i, j] = False
    found = np.array(picked, dtype=np.intp).reshape(-1, 2)
    return found[:, 0], found[:, 1]
