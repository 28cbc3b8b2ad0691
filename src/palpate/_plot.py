"""Pictures. Figures are made without pyplot, so nothing opens a window or keeps state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._extras import require
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate.touch import Touch

__all__ = ["INK", "plot_accuracy", "plot_touch", "scaled"]

#: Colours that stay apart in print and for colour-blind readers.
INK = {"pressure": "#0b5394", "shear": "#c55a11", "truth": "#444444", "error": "#8e1b3a", "other": "#2a7f62"}


def scaled(largest: float, unit: str) -> tuple[float, str]:
    """Factor and label that bring ``largest`` (SI) to a readable size: (1e-3, "kPa")."""
    if unit == "1":
        return 1.0, ""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n")):
        if largest >= factor or factor == 1e-9:
            return 1.0 / factor, prefix + unit
    return 1.0, unit


def plot_touch(touch: Touch, *, frame: int = 0, truth: Any = None, title: str | None = None) -> Figure:
    """A figure of one frame; see `Touch.plot`."""
    require("figures", "matplotlib")
    one = touch.frame(frame)
    values = to_numpy(one.values).astype(np.float64)
    true = None if truth is None else to_numpy(truth).astype(np.float64)
    if true is not None and true.shape != values.shape:
        raise InvalidInput(f"truth must have shape {values.shape} like one frame of the touch; got {true.shape}.")
    return (_plot_line if one.surface.dimensions == 1 else _plot_area)(one, values, true, title)


def _plot_line(touch: Touch, values: Floats, true: Floats | None, title: str | None) -> Figure:
    from matplotlib.figure import Figure

    factor, unit = scaled(float(np.abs(values).max()), "Pa")
    width, width_unit = scaled(float(np.ptp(touch.surface.x)), "m")
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    x = touch.surface.x * width
    for name, row in (("pressure", 1), ("shear", 0)):
        if touch.surface.components[row] not in touch.components:
            continue
        if true is not None:
            axes.plot(x, true[row] * factor, color=INK["truth"], lw=1, ls="--", label=f"{name}, true")
        axes.plot(
            x, values[row] * factor, color=INK[name], lw=1.6, label=f"{name}, recovered" if true is not None else name
        )
    axes.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    axes.set_xlabel(f"x [{width_unit}]")
    axes.set_ylabel(f"traction [{unit}]")
    axes.legend(frameon=False)
    if title:
        axes.set_title(title)
    return figure


def _plot_area(touch: Touch, values: Floats, true: Floats | None, title: str | None) -> Figure:
    from matplotlib.figure import Figure

    rows = [("recovered" if true is not None else "", values)]
    if true is not None:
        rows.append(("true", true))
    fields = []
    if "z" in touch.components:
        fields.append("pressure")
    if {"x", "y"} & set(touch.components):
        fields.append("shear")
    width, width_unit = scaled(max(float(np.ptp(a)) for a in touch.surface.axes), "m")
    x, y = touch.surface.x * width, touch.surface.axes[0] * width
    dy, dx = (s * width for s in touch.surface.spacings)
    extent = (x[0] - dx / 2, x[-1] + dx / 2, y[0] - dy / 2, y[-1] + dy / 2)
    shape = min(max((extent[3] - extent[2]) / (extent[1] - extent[0]), 0.3), 2.0)
    figure = Figure(figsize=(4.6 * len(fields), (3.2 * shape + 0.8) * len(rows)), layout="constrained")
    grid = figure.subplots(len(rows), len(fields), squeeze=False)
    for column, name in enumerate(fields):
        images = [v[2] if name == "pressure" else np.hypot(v[0], v[1]) for _, v in rows]
        largest = max(float(i.max()) for i in images) or 1.0
        factor, unit = scaled(largest, "Pa")
        low = min(0.0, *(float(i.min()) for i in images)) * factor if name == "pressure" else 0.0
        for row, (label, v) in enumerate(rows):
            axes = grid[row, column]
            image = axes.imshow(
                images[row] * factor,
                extent=extent,
                origin="lower",
                cmap="viridis" if name == "pressure" else "cividis",
                vmin=low,
                vmax=largest * factor,
                interpolation="nearest",
            )
            if name == "shear":
                step = max(1, max(v.shape[1:]) // 16)
                size = np.hypot(v[0], v[1])
                strong = size[::step, ::step] > 0.2 * largest
                xx, yy = np.meshgrid(x[::step], y[::step])
                axes.quiver(
                    xx[strong],
                    yy[strong],
                    v[0, ::step, ::step][strong],
                    v[1, ::step, ::step][strong],
                    color="white",
                    scale=largest * 14,
                    width=0.006,
                    pivot="mid",
                )
            axes.set_title(f"{name}{', ' + label if label else ''}", fontsize=10)
            axes.set_xlabel(f"x [{width_unit}]")
            axes.set_ylabel(f"y [{width_unit}]")
            figure.colorbar(image, ax=axes, label=f"{name} [{unit}]")
    if title:
        figure.suptitle(title)
    return figure


def plot_accuracy(records: Sequence[Any]) -> Figure:
    """Error over the clairvoyant filter's, one panel per layout, one dot per contact, method and noise."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    layouts = list(dict.fromkeys(r.layout for r in records))
    figure = Figure(figsize=(10, 1.0 + 1.8 * len(layouts)), layout="constrained")
    axes = figure.subplots(len(layouts), 1, squeeze=False, sharey=True)[:, 0]
    noises = sorted({r.noise for r in records})
    for ax, layout in zip(axes, layouts):
        methods = list(dict.fromkeys(r.method for r in records if r.layout == layout))
        for i, method in enumerate(methods):
            for j, noise in enumerate(noises):
                ratios = [r.ratio for r in records if (r.layout, r.method, r.noise) == (layout, method, noise)]
                place = i + 0.22 * (j - 0.5 * (len(noises) - 1))
                ax.plot([place] * len(ratios), ratios, ".", color=f"C{j}", alpha=0.5, markersize=4)
                mean = float(np.exp(np.mean(np.log(ratios))))
                label = f"noise {noise:g}" if i == 0 else None
                ax.plot([place - 0.08, place + 0.08], [mean, mean], color=f"C{j}", linewidth=2.5, label=label)
        ax.axhline(1.0, color="0.5", linewidth=0.8)
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter("{x:g}")
        ax.set_xticks(range(len(methods)), methods)
        ax.set_title(layout, loc="left", fontsize=10)
        ax.set_ylabel("error / clairvoyant")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper right", fontsize=8, ncols=3, title="bar: geometric mean", title_fontsize=8
    )
    return figure


def plot_trust(lines: Sequence[Any]) -> Figure:
    """Frames of each row that are wrong: without a word, and with one."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.5, 1.2 + 0.26 * len(lines)), layout="constrained")
    ax = figure.subplots()
    rows = range(len(lines))
    silent = [100.0 * line.betrays / line.frames for line in lines]
    warned = [100.0 * line.warned / line.frames for line in lines]
    ax.barh(rows, silent, color="C3", label="without a word")
    ax.barh(rows, warned, left=silent, color="0.8", label="with a word")
    ax.axvline(1.0, color="0.3", linewidth=0.8, linestyle="--")
    ax.set_yticks(rows, [line.row for line in lines])
    ax.set_ylim(len(lines) - 0.4, -0.6)
    ax.set_xlim(0, 100)
    ax.set_xlabel("frames whose force is off by more than 30 % of the load, or far outside its 95 % interval [%]")
    ax.legend(frameon=False, loc="lower right")
    return figure
