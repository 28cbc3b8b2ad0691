"""The paper's two sketches, figures 1 and 8."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["indenters", "line_force"]

_PAD, _STEEL, _INK = "#e8eef4", "#c9c9c9", "#222222"


def _blank(width: float, height: float, x: tuple[float, float], z: tuple[float, float]) -> tuple[Figure, Any]:
    """Axes without ticks, equal scales, z down."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.set_xlim(*x)
    axes.set_ylim(z[1], z[0])
    axes.set_aspect("equal")
    axes.set_axis_off()
    return figure, axes


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], **look: Any) -> None:
    style = {"arrowstyle": "-|>", "color": _INK, "lw": 0.9, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7, **look}
    axes.annotate("", xy=end, xytext=start, arrowprops=style)


def line_force() -> Figure:
    """Figure 1: a line force F, inclined by alpha, and the stresses at (r, theta) below it."""
    figure, axes = _blank(3.4, 2.3, (-3.3, 3.3), (-1.75, 2.75))
    axes.fill_between([-3.2, 3.2], 0.0, 2.65, color=_PAD, lw=0)
    axes.plot([-3.2, 3.2], [0, 0], color=_INK, lw=1.0)
    alpha, theta, r = np.radians(28.0), np.radians(40.0), 2.1
    _arrow(axes, (-1.6 * np.sin(alpha), -1.6 * np.cos(alpha)), (0.0, 0.0), lw=1.5, mutation_scale=10)
    axes.plot([0, 0], [-1.5, 0], color=_INK, lw=0.6, ls=(0, (4, 3)))
    arc = np.linspace(0.0, alpha, 30)
    axes.plot(-0.95 * np.sin(arc), -0.95 * np.cos(arc), color=_INK, lw=0.7)
    axes.text(-0.31, -1.02, "α", ha="center", va="bottom")
    axes.text(-1.6 * np.sin(alpha) - 0.12, -1.45, "F", ha="right", va="center", style="italic")
    _arrow(axes, (0, 0), (0, 2.5))
    _arrow(axes, (0, 0), (3.1, 0))
    axes.text(0.1, 2.5, "z", va="center", style="italic")
    axes.text(3.05, -0.14, "y", ha="right", va="bottom", style="italic")
    px, pz = r * np.sin(theta), r * np.cos(theta)
    axes.plot([0, px], [0, pz], color=_INK, lw=0.9)
    arc = np.linspace(0.0, theta, 30)
    axes.plot(0.75 * np.sin(arc), 0.75 * np.cos(arc), color=_INK, lw=0.7)
    axes.text(0.33, 0.98, "θ", ha="center", va="center")
    axes.text(0.56 * px + 0.1, 0.56 * pz - 0.12, "r", ha="left", va="bottom", style="italic")
    out, across = np.array([np.sin(theta), np.cos(theta)]), np.array([np.cos(theta), -np.sin(theta)])
    s, middle = 0.3, np.array([px, pz]) + 0.3 * np.array([np.sin(theta), np.cos(theta)])
    corners = np.array([middle + s * (i * out + j * across) for i, j in ((-1, -1), (-1, 1), (1, 1), (1, -1), (-1, -1))])
    axes.fill(*corners.T, facecolor="white", edgecolor=_INK, lw=0.8)
    _arrow(axes, tuple(middle + 0.8 * out), tuple(middle + s * out))
    axes.text(*(middle + 0.95 * out), "σ$_r$", ha="left", va="center")
    _arrow(axes, tuple(middle + 0.8 * across), tuple(middle + s * across))
    axes.text(*(middle + 0.95 * across), "σ$_θ$", ha="left", va="center")
    corner = middle - (s + 0.1) * out
    _arrow(axes, tuple(corner + 0.3 * across), tuple(corner - 0.3 * across), lw=0.7, mutation_scale=5)
    axes.text(*(corner - 0.42 * across + 0.02 * out), "τ$_{rθ}$", ha="right", va="top")
    axes.text(-3.05, 2.45, "elastic material", ha="left", va="bottom", fontsize=7.5)
    return figure


def indenters() -> Figure:
    """Figure 8: the two rigid indenters, loaded by P, and the half-width a of their contacts."""
    figure, axes = _blank(3.4, 1.85, (-4.6, 4.6), (-2.75, 2.0))
    a, radius, sunk = 0.62, 1.3, 0.42
    for centre, shape in ((-2.3, "cylinder"), (2.3, "rectangle")):
        y = np.linspace(centre - 2.1, centre + 2.1, 801)
        beyond = np.maximum(np.abs(y - centre) - a, 0.0)
        if shape == "cylinder":
            # the surface follows the circle within the contact and leaves it with the same slope
            rise = np.sqrt(radius**2 - a**2)
            edge, slope = sunk - radius + rise, a / rise
            under = sunk - radius + np.sqrt(np.maximum(radius**2 - (y - centre) ** 2, 0.0))
            surface = np.where(beyond > 0, edge * np.exp(-beyond * slope / edge), under)
        else:
            surface = 0.3 * np.exp(-1.7 * np.sqrt(beyond))
        axes.fill_between(y, surface, 1.6, color=_PAD, lw=0)
        axes.plot(y, surface, color=_INK, lw=1.0)
        bottom = float(surface.max())
        if shape == "cylinder":
            angle = np.linspace(0, 2 * np.pi, 200)
            axes.fill(
                centre + radius * np.cos(angle),
                bottom - radius + radius * np.sin(angle),
                facecolor=_STEEL,
                edgecolor=_INK,
                lw=0.9,
            )
        else:
            top = bottom - 1.3
            axes.fill(
                [centre - a, centre + a, centre + a, centre - a],
                [bottom, bottom, top, top],
                facecolor=_STEEL,
                edgecolor=_INK,
                lw=0.9,
            )
        tip = bottom - radius + 0.3 if shape == "cylinder" else bottom - 1.3
        _arrow(axes, (centre, tip - 0.95), (centre, tip), lw=1.3, mutation_scale=9)
        axes.text(centre + 0.15, tip - 0.7, "P", ha="left", va="center", style="italic")
        _arrow(axes, (centre - a, 0.62), (centre + a, 0.62), lw=0.7, arrowstyle="<|-|>", mutation_scale=5)
        for side in (-a, a):
            axes.plot([centre + side] * 2, [bottom + 0.02, 0.72], color=_INK, lw=0.5)
        axes.text(centre, 0.72, "2a", ha="center", va="top", style="italic")
        axes.text(centre, 1.55, "elastic material", ha="center", va="bottom", fontsize=7.0)
        axes.text(centre, 1.68, shape, ha="center", va="top", fontsize=7.5)
    return figure
