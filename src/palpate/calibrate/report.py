"""A picture of a calibration: estimated against true force, with the errors of plain regressions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate.calibrate.calibration import SkinCalibration
    from palpate.calibrate.forcemap import ForceMap

__all__ = ["draw_report"]

#: Characters in a line of the findings.
WIDE = 110
#: Height of a line [inch].
LINE = 0.115


def draw_report(found: SkinCalibration) -> Figure:
    """Draw the cross-validated force of each labelled frame with its 95 % interval against the true force, the errors
    beside those of regressions, and the findings.

    Raises
    ------
    InvalidInput
        A calibration without a force.

    Examples
    --------
    >>> from palpate.calibrate.report import draw_report
    >>> # draw_report(skin.calibration).savefig("calibration.png")
    """
    one = found.maps.get("fz") or next((m for n, m in found.maps.items() if n.startswith("f")), None)
    if one is None:
        raise InvalidInput("this calibration has no map of a force to draw.")
    from palpate._plot.style import INK, PAGE, journal

    with journal():
        return _drawn(found, one, INK, PAGE)


def _drawn(found: SkinCalibration, one: ForceMap, ink: dict[str, str], wide: float) -> Figure:
    import textwrap

    from palpate._extras import missing

    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise missing("pictures", error) from error
    figure = Figure(figsize=(wide, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    known = one.process.values
    half = 2.0 * one.left_out_std
    left.errorbar(
        known, known - one.left_out, yerr=half, fmt="o", markersize=2.5, linewidth=0.6, color=ink["z"], ecolor="0.75"
    )
    ends = [min(known.min(), 0.0), known.max()]
    left.plot(ends, ends, color="0.4", linewidth=0.8)
    left.set_xlabel("force known [N]")
    left.set_ylabel("force found, its press left out [N]")
    rows = [r for r in found.table if np.isfinite(r[1])]
    right.barh([r[0] for r in rows][::-1], [r[1] for r in rows][::-1], color=["0.75"] * (len(rows) - 1) + [ink["z"]])
    right.set_xlabel("mean error of left-out presses [N]")
    said = [f"- {s}" for s in found.said]
    if found.constants is not None:
        said += str(found.constants).splitlines()
    lines = [line for s in said for line in textwrap.wrap(s, WIDE, subsequent_indent="  ", drop_whitespace=False)]
    words = "\n".join(lines)
    height = 4.4 + LINE * max(0, len(lines) - 8)
    figure.set_figheight(height)
    figure.subplots_adjust(left=0.1, right=0.98, top=1.0 - 0.13 / height, bottom=1.0 - 2.55 / height, wspace=0.6)
    figure.text(0.03, 1.0 - 3.17 / height, words, fontsize=6.5, va="top")
    return figure
