"""The paper's figures 1 to 22: its numbering and axis ranges, captions in our words, curves as data.

y is our x. If the text lost a label of an axis, its range follows from the step of the other labels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import require
from palpate._plot import INK
from palpate.elastic.pad import Floats
from palpate.paper import sketches
from palpate.paper.algorithm import discrete_kernel, divide, sliding, transform
from palpate.paper.cases import DEPTH, FRICTION, PITCH, SENSORS, array, data
from palpate.paper.formulas import kernel_transforms, kernels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["STYLE", "Panel", "PaperFigure", "figures"]

#: Sizes of a figure as wide as a column of print.
STYLE = {
    "font.size": 8.0,
    "font.family": "DejaVu Sans",
    "axes.linewidth": 0.6,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
}
#: Width of a column [inch].
COLUMN = 3.4

#: A curve's style follows from its first words: designed curves are wide and pale, reconstructed ones lie on them.
_LOOKS = (
    ("designed vertical", {"color": "#9db9d6", "lw": 3.2}),
    ("designed tangential", {"color": "#e3bd9c", "lw": 3.2}),
    ("designed", {"color": "#9db9d6", "lw": 3.2}),
    ("reconstructed tangential", {"color": INK["shear"], "lw": 0.8, "marker": "o", "ms": 1.5}),
    ("reconstructed", {"color": INK["pressure"], "lw": 0.8, "marker": "o", "ms": 1.5}),
    ("stress", {"color": INK["other"], "lw": 1.2, "ls": "--"}),
    ("strain", {"color": INK["other"], "lw": 1.2, "ls": "--"}),
    ("division, strain", {"color": INK["pressure"], "lw": 0.9, "ls": "--"}),
    ("linear system, stress", {"color": INK["other"], "lw": 0.9}),
    ("linear system, strain", {"color": INK["other"], "lw": 0.9, "ls": "--"}),
    ("division, stress", {"color": INK["pressure"], "lw": 0.9}),
    ("division", {"color": INK["pressure"], "lw": 1.0, "marker": "o", "ms": 2.5}),
    ("linear system", {"color": INK["other"], "lw": 1.0, "marker": "s", "ms": 2.5}),
    ("Hilgers", {"color": INK["shear"], "lw": 1.0, "marker": "^", "ms": 2.5}),
    ("Tikhonov", {"color": INK["other"], "lw": 1.0, "marker": "s", "ms": 2.5}),
    ("z = 2", {"color": INK["shear"], "lw": 1.2, "ls": "--"}),
)
_LINE_STYLE = {"color": INK["pressure"], "lw": 1.2}


@dataclass(frozen=True)
class Panel:
    """Curves over one axis."""

    x: Floats
    curves: dict[str, Floats]
    x_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    y_label: str = ""
    title: str = ""
    log: bool = False
    log_x: bool = False
    x_step: float | None = None
    y_step: float | None = None


@dataclass(frozen=True)
class PaperFigure:
    """One figure: panels with their data, or a sketch without any."""

    number: int | str
    caption: str
    panels: tuple[Panel, ...] = ()
    sketch: Callable[[], Figure] | None = None
    height: float = 1.8

    @property
    def name(self) -> str:
        """Stem of its files: "figure-09", or "ours-1"."""
        return f"figure-{self.number:02d}" if isinstance(self.number, int) else f"ours-{self.number}"

    @property
    def label(self) -> str:
        """ "Figure 9" or "Figure A"."""
        return f"Figure {self.number}"

    def draw(self) -> Figure:
        """The figure as a picture as wide as a column."""
        require("figures", "matplotlib")
        import matplotlib as mpl

        with mpl.rc_context(STYLE):
            return self.sketch() if self.sketch is not None else self._plot()

    def _plot(self) -> Figure:
        from matplotlib.figure import Figure

        columns = min(len(self.panels), 2)
        rows = -(-len(self.panels) // columns)
        curves = len(self.panels[0].curves)
        above = len(self.panels) > 1 or curves > 2  # one legend for all panels, over them
        entries = min(curves, 3 if sum(map(len, self.panels[0].curves)) < 36 else 2)
        legend = 0.15 * -(-curves // entries) + 0.03 if above else 0.0
        high = rows * self.height + legend
        figure = Figure(figsize=(COLUMN, high))
        figure.subplots_adjust(
            left=0.165,
            right=0.98,
            bottom=0.35 / high,
            top=1.0 - (0.06 + legend) / high,
            wspace=0.42 if self.panels[0].log else 0.34,
            hspace=0.42,
        )
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, panel in zip(grid.ravel(), self.panels):
            for i, (name, values) in enumerate(panel.curves.items(), start=1):
                look = next((look for word, look in _LOOKS if name.startswith(word)), _LINE_STYLE)
                numbered = len(panel.curves) > 1 and not panel.log
                axes.plot(panel.x, values, label=f"{i}  {name}" if numbered else name, **look)
            _dress(axes, panel)
        lines, labels = axes.get_legend_handles_labels()
        look = {"handlelength": 1.6, "labelspacing": 0.25, "handletextpad": 0.5, "borderaxespad": 0.2}
        if above:
            figure.legend(lines, labels, loc="upper center", ncols=entries, columnspacing=1.5, **look)
        elif curves > 1:
            axes.legend(lines, labels, loc="upper right", **look)
        return figure

    def table(self) -> str:
        """The figure's data as CSV text: panels side by side, each with its own first column."""
        columns: list[tuple[str, Floats]] = []
        for i, panel in enumerate(self.panels):
            same = i > 0 and np.array_equal(panel.x, self.panels[0].x) and panel.x_label == self.panels[0].x_label
            if not same:
                columns.append((panel.x_label, panel.x))
            prefix = f"{panel.title}: " if len(self.panels) > 1 and panel.title else ""
            columns += [(prefix + name, values) for name, values in panel.curves.items()]
        longest = max(len(values) for _, values in columns)
        lines = [",".join(f'"{name}"' for name, _ in columns)]
        for row in range(longest):
            lines.append(",".join(repr(float(v[row])) if row < len(v) else "" for _, v in columns))
        return "\n".join(lines) + "\n"


def _dress(axes: Any, panel: Panel) -> None:
    axes.set_xlim(panel.x_range)
    axes.set_ylim(panel.y_range)
    for axis, limits, step in ((axes.xaxis, panel.x_range, panel.x_step), (axes.yaxis, panel.y_range, panel.y_step)):
        if step is not None:
            axis.set_ticks(np.arange(int((limits[1] - limits[0]) / step + 1e-6) + 1) * step + limits[0])
    if panel.log_x:
        axes.set_xscale("log")
    if panel.log:
        axes.set_yscale("log")
    else:
        axes.axhline(0.0, color="0.8", lw=0.5, zorder=0)
    axes.set_xlabel(panel.x_label, labelpad=1.5)
    axes.set_ylabel(panel.y_label, labelpad=2.0)
    if panel.title:
        axes.text(0.04, 0.95, panel.title, transform=axes.transAxes, va="top", ha="left", fontsize=7.0)


def figures() -> list[PaperFigure]:
    """Figures 1 to 22."""
    out = [
        PaperFigure(
            1,
            "A line force on the edge of an elastic half-plane, and the stresses at a point below",
            sketch=sketches.line_force,
        ),
        _kernels(2, "stress", "stress_zz", (0.0, 0.8), (-0.3, 0.5)),
        _kernels(3, "strain", "strain_zz", (-0.1, 0.7), (-0.2, 0.2)),
    ]
    for number, (what, channel, top) in enumerate(
        (("stress", "stress_zz", 1.0), ("strain", "strain_zz", 0.6)), start=4
    ):
        omega = np.linspace(-5.0, 5.0, 401)
        transformed = kernel_transforms(channel, DEPTH, omega)[0].real
        panel = Panel(
            omega, {f"K1 of {what}": transformed}, "ω", (-5.0, 5.0), (0.0, top), "K1(ω)", x_step=1.0, y_step=0.2
        )
        out.append(PaperFigure(number, f"Fourier transform of K1 of {what} at z = {DEPTH}", (panel,)))
    for number, (what, channel, top) in enumerate(
        (("stress", "stress_zz", 1.0), ("strain", "strain_zz", 0.6)), start=6
    ):
        half = np.abs(transform(discrete_kernel(channel, SENSORS)))
        k = np.arange(-(SENSORS // 2), SENSORS // 2 + 1)
        panel = Panel(
            k.astype(float),
            {f"DFT of K1 of {what}": np.concatenate([half[:0:-1], half])},
            "k",
            (-60.0, 60.0),
            (0.0, top),
            "K1(k)",
            x_step=30.0,
            y_step=0.2,
        )
        extra = "; unlike figure 5 it is not 0 at k = 0, so division is possible" if what == "strain" else ""
        out.append(PaperFigure(number, f"Discrete Fourier transform of K1 of {what} at z = {DEPTH}{extra}", (panel,)))
    out.append(
        PaperFigure(8, "A cylinder and a rectangle, both rigid, indent the elastic material", sketch=sketches.indenters)
    )
    ranges = {
        "cylinder": {9: (0.0, 0.15), 10: (-0.01, 0.14), 11: (-0.02, 0.13), 12: (-0.01, 0.14)},
        "punch": {13: (0.0, 0.4), 14: (-0.1, 0.4), 15: (-0.1, 0.4), 16: (-0.1, 0.4)},
    }
    for case, y_ranges in ranges.items():
        name = {"cylinder": "Cylinder", "punch": "Rectangle"}[case]
        for i, (number, y_range) in enumerate(y_ranges.items()):
            what, channel = (("stress", "stress_zz"), ("strain", "strain_zz"))[i // 2]
            true, readings = data(case, channel)
            if i % 2 == 0:
                curves = {"designed": true[1], f"{what} at z = {DEPTH}": readings[0]}
                caption = f"{name}: 1 designed surface stress; 2 {what} at z = {DEPTH}"
            else:
                curves = {"designed": true[1], "reconstructed": divide(readings[0], channel)}
                caption = f"{name}: 1 designed surface stress; 2 reconstructed from the {what} of figure {number - 1}"
            out.append(PaperFigure(number, caption, (_surface(curves, y_range, 0.03 if case == "cylinder" else 0.1),)))
    for number, (what, channel) in ((17, ("stress", "stress_zz")), (19, ("strain", "strain_zz"))):
        true, readings = data("punch with friction", channel)
        found = sliding(readings[0], channel, FRICTION)
        curves = {"designed vertical": true[1], "designed tangential": true[0], f"{what} at z = {DEPTH}": readings[0]}
        caption = f"Rectangle with constant friction: 1 designed vertical, 2 designed tangential surface stress; 3 {what} at z = {DEPTH}"
        out.append(PaperFigure(number, caption, (_surface(curves, (-0.1, 0.4), 0.1),)))
        curves = {
            "designed vertical": true[1],
            "reconstructed vertical": found.traction[1],
            "designed tangential": true[0],
            "reconstructed tangential": found.traction[0],
        }
        caption = (
            f"Rectangle with constant friction: 1 designed, 2 reconstructed vertical; 3 designed, 4 reconstructed tangential "
            f"surface stress, from the {what} of figure {number}"
        )
        out.append(PaperFigure(number + 1, caption, (_surface(curves, (-0.1, 0.4), 0.1),)))
    for number, (what, channel) in ((21, ("stress", "stress_zz")), (22, ("strain", "strain_zz"))):
        true, readings = data("cylinder", channel, 41)
        curves = {"designed": true[1], "reconstructed": divide(readings[0], channel)}
        caption = f"Cylinder under 41 sensors: 1 designed surface stress; 2 reconstructed from {what} at z = {DEPTH}"
        out.append(PaperFigure(number, caption, (_surface(curves, (-0.01, 0.14), 0.03, 41),)))
    return out


def _kernels(
    number: int, what: str, channel: str, first: tuple[float, float], second: tuple[float, float]
) -> PaperFigure:
    y = np.linspace(-8.0, 8.0, 401)
    values = {z: kernels(channel, z, y) for z in (1.0, 2.0)}
    panels = tuple(
        Panel(
            y,
            {f"z = {z:g}": v[i] for z, v in values.items()},
            "y",
            (-8.0, 8.0),
            y_range,
            title=f"K{i + 1}",
            x_step=8.0,
            y_step=(y_range[1] - y_range[0]) / 4,
        )
        for i, y_range in enumerate((first, second))
    )
    return PaperFigure(number, f"K1 and K2 of {what} at z = 1 and z = 2", panels, height=1.55)


def _surface(curves: dict[str, Floats], y_range: tuple[float, float], step: float, count: int = SENSORS) -> Panel:
    end = (count // 2) * PITCH
    label = "stress, strain" if any(name.startswith("strain") for name in curves) else "stress"
    x = array(["stress_zz"], count).grid.x
    return Panel(x, curves, "y", (-end, end), y_range, label, x_step=end / 3 if count == SENSORS else 4.0, y_step=step)
