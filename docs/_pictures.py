"""Pictures of the gallery: figures of pyplot, and those that palpate returns, which pyplot does not know."""

from __future__ import annotations

from typing import Any

from matplotlib import pyplot
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst


def figures(block: Any, variables: dict[str, Any], configuration: dict[str, Any]) -> str:
    """Save each figure that a block of an example made, once, and say where it is."""
    made = [pyplot.figure(number) for number in pyplot.get_fignums()]
    made += [v for v in variables["example_globals"].values() if isinstance(v, Figure) and v not in made]
    paths = []
    for figure in made:
        if getattr(figure, "_shown", False):
            continue
        figure._shown = True  # type: ignore[attr-defined]
        path = next(variables["image_path_iterator"])
        figure.savefig(path, dpi=110)
        paths.append(path)
    pyplot.close("all")
    return figure_rst(paths, configuration["src_dir"])
