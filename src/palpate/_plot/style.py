"""Colours, sizes and units of figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas

__all__ = ["COLUMN", "INK", "PAGE", "column_size", "journal", "level_words", "nice", "scaled"]

#: Colours that remain distinct in print and for colour-blind readers (M. Okabe and K. Ito, 2008).
INK = {
    "pressure": "#0b5394",
    "shear": "#c55a11",
    "truth": "#444444",
    "error": "#8e1b3a",
    "other": "#2a7f62",
    "x": "#d55e00",
    "y": "#009e73",
    "z": "#0072b2",
}
#: Widths of one column and of both columns of a journal's page [inch].
COLUMN, PAGE = 3.5, 7.2


def journal() -> Any:
    """Return a context with the style of a journal's figure: 8 points, thin lines, text stored as text in PDF and SVG."""
    import matplotlib

    return matplotlib.rc_context(
        {
            "font.size": 8,
            "axes.titlesize": 8,
            "axes.labelsize": 8,
            "legend.fontsize": 7,
            "xtick.labelsize": 7,
            "ytick.labelsize": 7,
            "figure.titlesize": 8,
            "axes.linewidth": 0.6,
            "lines.linewidth": 1.1,
            "hatch.linewidth": 0.4,
            "pdf.fonttype": 42,
            "svg.fonttype": "none",
        }
    )


def nice(size: float) -> float:
    """Return the largest number of the form 1, 2 or 5 times a power of ten that is at most ``size``, for scale arrows.

    Examples
    --------
    >>> from palpate._plot import nice
    >>> nice(0.37), nice(7.0), nice(1000.0)
    (0.2, 5.0, 1000.0)
    """
    if not (math.isfinite(size) and size > 0):
        return 1.0
    power = 10.0 ** math.floor(math.log10(size) + 1e-9)
    return max(m for m in (1.0, 2.0, 5.0) if m * power <= size * (1 + 1e-9)) * power


def scaled(largest: float, unit: str) -> tuple[float, str]:
    """Return factor and unit label that bring ``largest`` (SI) to a readable size: (1e-3, "kPa")."""
    if unit == "1":
        return 1.0, ""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n")):
        if largest >= factor or factor == 1e-9:
            return 1.0 / factor, prefix + unit
    return 1.0, unit


def column_size(table: pandas.DataFrame, title: str) -> float:
    """Return the size from which the unit of a column is chosen: its largest number or, if that is small compared with
    its interval, a tenth of the largest bound.
    """
    name, unit = title.split(" (")
    ends = (title, *(f"{name}_{side} ({unit}" for side in ("low", "high")))
    number, *bounds = (
        float(np.nanmax(np.abs(v[np.isfinite(v)]), initial=0.0))
        for v in (np.asarray(table[t], dtype=np.float64) for t in ends)
    )
    return max(number, 0.1 * max(bounds))


def level_words(table: pandas.DataFrame) -> str:
    """Return the level of a table's intervals in words, "95 %" unless the table says otherwise."""
    return f"{100.0 * table.attrs.get('level', 0.95):.4g} %"
