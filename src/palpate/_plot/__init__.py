"""Pictures of touches, streams and measurements.

In: a touch, a table of forces or rows of numbers, as described in `shown`.
Out: figures of Matplotlib, made without pyplot: no window opens and no state is kept.
Open first: `maps.py`.
"""

from palpate._plot.arrows import arrow_cells
from palpate._plot.forces import draw_forces, plot_forces
from palpate._plot.maps import plot_touch
from palpate._plot.over import plot_over
from palpate._plot.style import INK, column_size, journal, level_words, nice, scaled
from palpate._plot.tables import plot_accuracy, plot_trust

__all__ = [
    "INK",
    "arrow_cells",
    "column_size",
    "draw_forces",
    "journal",
    "level_words",
    "nice",
    "plot_accuracy",
    "plot_forces",
    "plot_over",
    "plot_touch",
    "plot_trust",
    "scaled",
]
