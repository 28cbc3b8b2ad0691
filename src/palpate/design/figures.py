"""Figures of designs: trade-offs, and the resolution of one design."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from palpate._extras import require
from palpate.design.columns import LENGTHS, NUMBERS, value_text
from palpate.design.detection import Noticed
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_design", "plot_sweep"]

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_MARKS = "os^Dv<"
_STYLES = ("-", "--", ":", "-.")


class ShownDesign(Protocol):
    """The part of a `palpate.design.Design` that figures use, so that they need not import that class."""

    @property
    def distance(self) -> Floats: ...
    @property
    def point_spread(self) -> Mapping[str, Floats]: ...
    @property
    def components(self) -> tuple[str, ...]: ...
    @property
    def noticed(self) -> Noticed: ...
    @property
    def dimensions(self) -> int: ...
    @property
    def noise_unit(self) -> str: ...
    def width(self, component: str) -> float: ...


class ShownSweep(Protocol):
    """The part of a `palpate.design.Sweep` that figures use."""

    @property
    def points(self) -> Sequence[Mapping[str, Any]]: ...
    @property
    def designs(self) -> Sequence[ShownDesign]: ...
    @property
    def goals(self) -> Mapping[str, float]: ...
    def numbers(self, name: str) -> Floats: ...
    def unit(self, name: str) -> str: ...


def plot_design(design: ShownDesign) -> Figure:
    """Plot the point-spread functions, and the smallest detectable force over the array."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    from palpate._plot.style import INK, PAGE, journal

    with journal():
        figure = Figure(figsize=(PAGE, 2.7), layout="constrained")
        left, right = figure.subplots(1, 2)
        shown = 1e3 * design.distance
        names = {"x": "shear x", "y": "shear y", "z": "pressure"}
        styles = {"x": "-", "y": "--", "z": "-"}
        for c, profile in design.point_spread.items():
            both = np.concatenate([-shown[::-1], shown])
            left.plot(both, np.concatenate([profile[::-1], profile]), styles[c], color=INK[c], label=names[c])
        edge = 1.5e3 * max(design.width(c) for c in design.components)
        left.set_xlim(-min(edge, shown[-1]), min(edge, shown[-1]))
        left.axhline(0.5, color="0.7", linewidth=0.5)
        left.set_xlabel("distance [mm]")
        left.set_ylabel("what is made of a point")
        left.legend(frameon=False)
        noticed = design.noticed
        unit = "N" if design.dimensions == 2 else "N/m"
        finite = np.where(np.isfinite(noticed.force), noticed.force, np.nan)
        if design.dimensions == 1:
            right.plot(1e3 * noticed.places[:, 0], 1e3 * finite, color=INK["z"])
            right.set_xlabel("x [mm]")
            right.set_ylabel(f"smallest noticed force [m{unit}]")
        else:
            y, x = (np.unique(noticed.places[:, i]) for i in range(2))
            grid = 1e3 * finite.reshape(len(y), len(x))
            image = right.pcolormesh(1e3 * x, 1e3 * y, grid, cmap="viridis", shading="nearest")
            right.set_aspect("equal")
            right.set_xlabel("x [mm]")
            right.set_ylabel("y [mm]")
            figure.colorbar(image, ax=right, label="smallest noticed force [mN]")
    return figure


def plot_sweep(sweep: ShownSweep, x: str | None, columns: Sequence[str]) -> Figure:
    """Plot each number against one axis; colours and line styles distinguish the other axes."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

    from palpate._plot.style import PAGE, journal

    axes_of = list(dict.fromkeys(key for p in sweep.points for key in p))
    numeric = [a for a in axes_of if all(isinstance(p.get(a), float | int) for p in sweep.points)]
    most = max(numeric, key=lambda a: len({p[a] for p in sweep.points}), default=None)
    chosen = x if x is not None else most
    if chosen is None or chosen not in numeric:
        raise InvalidInput(
            f"{x!r} is not an axis of numbers of this sweep; accepted: {', '.join(numeric) or 'none, since nothing but names was varied'}."
        )
    shown = [c for c in columns if c in NUMBERS and np.isfinite(sweep.numbers(c)).any()]
    unknown = [c for c in columns if c not in NUMBERS]
    if unknown:
        raise InvalidInput(f"{unknown[0]!r} is not a number of a design; accepted: {', '.join(NUMBERS)}.")
    others = [a for a in axes_of if a != chosen]
    keys = [tuple(value_text(a, p.get(a)) for a in others) for p in sweep.points]
    groups = list(dict.fromkeys(keys))
    firsts = list(dict.fromkeys(k[0] for k in groups)) if others else [""]
    rests = list(dict.fromkeys(k[1:] for k in groups))
    factor, unit = (1e-3, "kPa") if chosen == "youngs_modulus" else (1e3, "mm") if chosen in LENGTHS else (1.0, "")
    if chosen == "noise":
        unit = sweep.designs[0].noise_unit
    with journal():
        rows = math.ceil(len(shown) / 2)
        figure = Figure(figsize=(PAGE, 2.4 * rows + 0.4), layout="constrained")
        panels = figure.subplots(rows, 2, squeeze=False).ravel()
        for axes, column in zip(panels, shown):
            what, scale, _ = NUMBERS[column]
            values = scale * sweep.numbers(column)
            for key in groups:
                members = sorted((i for i, k in enumerate(keys) if k == key), key=lambda i: sweep.points[i][chosen])
                place = factor * np.array([sweep.points[i][chosen] for i in members])
                height = np.array([values[i] for i in members])
                number, style = (firsts.index(key[0]) if others else 0), rests.index(key[1:])
                axes.plot(
                    place,
                    np.where(np.isfinite(height), height, np.nan),
                    _STYLES[style % len(_STYLES)],
                    marker=_MARKS[number % len(_MARKS)],
                    markersize=3,
                    color=_COLOURS[number % len(_COLOURS)],
                    label=", ".join(key) if key else None,
                )
            if column in sweep.goals:
                axes.axhline(scale * sweep.goals[column], color="0.5", linewidth=0.6, linestyle=(0, (6, 2)))
            finite = values[np.isfinite(values) & (values > 0)]
            if len(finite) and finite.max() > 5.0 * finite.min():
                axes.set_yscale("log")
                axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
                axes.yaxis.set_minor_formatter(FuncFormatter(lambda v, _: f"{v:g}" if f"{v:e}"[0] in "25" else ""))
            else:
                axes.set_ylim(bottom=0.0)
            axes.set_title(what)
            axes.set_ylabel(f"[{sweep.unit(column)}]")
            axes.set_xlabel(f"{chosen.replace('_', ' ')}{f' [{unit}]' if unit else ''}")
        for axes in panels[len(shown) :]:
            axes.set_visible(False)
        if others and len(groups) <= 12:
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(groups)), frameon=False)
    return figure


def plot_places(placed: Any) -> Figure:
    """Plot the placed taxels over the error that remains at each place."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    from palpate._plot.style import COLUMN, INK, journal

    with journal():
        figure = Figure(figsize=(COLUMN, 3.0), layout="constrained")
        axes = figure.subplots()
        y, x = (np.unique(placed.places[:, i]) for i in range(2))
        image = axes.pcolormesh(
            1e3 * x, 1e3 * y, 1e3 * placed.force_std.reshape(len(y), len(x)), cmap="viridis", shading="nearest"
        )
        figure.colorbar(image, ax=axes, label="standard deviation of the force [mN]")
        positions = np.asarray(placed.array.positions)
        axes.plot(
            1e3 * positions[:, 0], 1e3 * positions[:, 1], "o", color="white", markeredgecolor=INK["truth"], markersize=4
        )
        axes.set_aspect("equal")
        axes.set_xlabel("x [mm]")
        axes.set_ylabel("y [mm]")
    return figure
