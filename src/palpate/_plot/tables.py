"""Figures of benchmark results: errors by `palpate bench accuracy`, and wrong frames by `palpate bench trust`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import require

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_accuracy", "plot_trust"]


def plot_accuracy(records: Sequence[Any]) -> Figure:
    """Plot the error relative to that of the clairvoyant filter: one panel per layout, one dot per contact, method and
    noise.
    """
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
    """Plot the fraction of frames in each row that are wrong, without and with a note."""
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
