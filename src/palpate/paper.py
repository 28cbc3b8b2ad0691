"""The founding paper end to end: its cases, error table, figures, and three studies that it only mentions.

R. Yang's and P. S. Krishnaprasad's group, University of Maryland, late 1980s: line contact on a half-space, the traction
found from normal stress or strain at depth by dividing Fourier transforms. Depth 1.5, sampling 0.5, E = 1, nu = 0.5,
121 sensors; the data are made by the discrete *linear* convolution and inverted by the *circular* transform.

The paper states neither the half-width a, nor the load P, nor the amount eps that it adds to a for the punch. The values
here (a = 3.5, P = 0.774, eps = 0.1) are our choice: they give both printed strain errors to three digits. The friction
coefficient (0.5) is our choice too. What each of its figures 2 to 22 draws is known to us only in outline (kernels, data and
recovered tractions of each case, truncation), so their captions are ours.
"""

from __future__ import annotations

import base64
import csv
import html
import io
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import rfftn
from palpate._plot import INK
from palpate.elastic.half_space import Floats, HalfSpace
from palpate.errors import InvalidInput
from palpate.inverse import ConstantFriction, DifferencePrior, Division, LinearSolve, Regularised, hilgers_prior
from palpate.inverse.parameter import tikhonov
from palpate.recordings.formats import atomically
from palpate.sensing.arrays import LineArray
from palpate.sensing.grids import LineGrid
from palpate.sensing.operator import sampled_kernel
from palpate.skin import Skin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "CASES",
    "PAPER_ERRORS",
    "PaperFigure",
    "error_table",
    "figures",
    "noise_study",
    "report",
    "speed_study",
    "truncation_study",
]

PAD = HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
DEPTH, PITCH, SENSORS = 1.5, 0.5, 121
HALF_WIDTH, LOAD, EPS, FRICTION = 3.5, 0.774, 0.1, 0.5

#: Mean absolute errors that the paper prints: (case, channel) -> text.
PAPER_ERRORS = {
    ("cylinder", "stress_zz"): "3.93e-6",
    ("cylinder", "strain_zz"): "4.04e-5",
    ("punch", "stress_zz"): "4.44e-6",
    ("punch", "strain_zz"): "1.06e-4",
    ("punch with friction, one component", "stress_zz"): "6.21e-?",
    ("punch with friction, one component", "strain_zz"): "1.15e-3",
    ("punch with friction, other component", "stress_zz"): "2.95e-?",
    ("punch with friction, other component", "strain_zz"): "1.45e-3",
}


def cylinder(x: Floats) -> Floats:
    """Traction (q_x, p): Hertz pressure of the cylinder."""
    p = 2 * LOAD / (math.pi * HALF_WIDTH) * np.sqrt(np.maximum(1 - (x / HALF_WIDTH) ** 2, 0.0))
    return np.stack([np.zeros_like(x), p])


def punch(x: Floats) -> Floats:
    """Traction (q_x, p): flat punch, with eps added to a in the formula to keep the sampled edge finite."""
    inside = np.abs(x) <= HALF_WIDTH + 1e-9
    root = np.sqrt(np.maximum((HALF_WIDTH + EPS) ** 2 - x**2, 1e-300))
    return np.stack([np.zeros_like(x), np.where(inside, LOAD / (math.pi * root), 0.0)])


def sliding_punch(x: Floats) -> Floats:
    """Traction (q_x, p): the punch with a constant shear mu P/(2a) under it."""
    inside = np.abs(x) <= HALF_WIDTH + 1e-9
    out = punch(x)
    total = out[1].sum() * PITCH
    out[0] = np.where(inside, FRICTION * total / (inside.sum() * PITCH), 0.0)
    return out


CASES: dict[str, Callable[[Floats], Floats]] = {
    "cylinder": cylinder,
    "punch": punch,
    "punch with friction": sliding_punch,
}


def array(channels: Sequence[str], count: int = SENSORS) -> LineArray:
    """The paper's array with ``count`` sensors."""
    return LineArray(count=count, pitch=PITCH, depth=DEPTH, channels=list(channels))


def data(case: str, channels: Sequence[str], count: int = SENSORS, wide: int = SENSORS) -> tuple[Floats, Floats]:
    """(traction, readings) on the array, made by the linear convolution on a grid of ``wide`` points and then cut."""
    full = array(channels, wide)
    traction = CASES[case](full.grid.x)
    readings = np.asarray(sampled_kernel(PAD, full).forward(traction)[0])
    cut = slice((wide - count) // 2, (wide - count) // 2 + count)
    return traction[:, cut], readings[:, cut]


def mean_error(found: Floats, true: Floats) -> float:
    """The paper's equation 26: mean absolute error over the sensors."""
    return float(np.abs(np.asarray(found, dtype=np.float64) - true).mean())


# -- error table -------------------------------------------------------------------------------------------------------


def error_table() -> list[dict[str, Any]]:
    """One row per case and channel: the paper's error and ours.

    Ours by division ("dft") in double precision, with readings and transforms in single precision, and with the readings
    rounded to seven decimals; and by the linear system. With friction: pressure and shear from the one channel, contact
    half-width unknown.
    """
    rows = []
    for case in ("cylinder", "punch"):
        for channel in ("stress_zz", "strain_zz"):
            true, readings = data(case, [channel])
            skin = Skin(PAD, array([channel]))

            def error(values: Any, method: Any, skin: Skin = skin, true: Floats = true) -> float:
                return mean_error(skin.reconstruct(values, method=method, components=["z"]).values[1], true[1])

            rows.append(
                {
                    "case": case,
                    "channel": channel,
                    "paper": PAPER_ERRORS[case, channel],
                    "dft": error(readings, "dft"),
                    "dft, float32": error(readings.astype(np.float32), "dft"),
                    "dft, 7 decimals": error(np.round(readings, 7), "dft"),
                    "linear": error(readings, "linear"),
                }
            )
    for channel in ("stress_zz", "strain_zz"):
        by = {method: friction_case(channel, method) for method in ("dft", "linear")}
        rounded = friction_case(channel, "dft", decimals=7)
        single = friction_case(channel, "dft", kind=np.float32)
        for label, key in (("one component", "pressure error"), ("other component", "shear error")):
            case = f"punch with friction, {label}"
            rows.append(
                {
                    "case": f"{case} ({key.split()[0]})",
                    "channel": channel,
                    "paper": PAPER_ERRORS[case, channel],
                    "dft": by["dft"][key],
                    "dft, float32": single[key],
                    "dft, 7 decimals": rounded[key],
                    "linear": by["linear"][key],
                }
            )
    return rows


def friction_case(channel: str, method: str, *, decimals: int | None = None, kind: Any = np.float64) -> dict[str, Any]:
    """The paper's friction case from one channel: pressure and shear found with the contact's half-width unknown.

    ``method`` ("dft" or "linear") inverts for the pressure once the shear's reading is taken out.
    """
    true, readings = data("punch with friction", [channel])
    if decimals is not None:
        readings = np.round(readings, decimals)
    planes = (array([channel]),)
    inner = (Division if method == "dft" else LinearSolve)(PAD, planes, [1])
    solver = ConstantFriction(PAD, planes, inner, FRICTION)
    found = np.asarray(solver.solve([readings.astype(kind)]).traction)
    return {
        "channel": channel,
        "true": true,
        "readings": readings,
        "found": found,
        "half-width": 0.5 * float(PITCH * found[0].sum() / found[0].max()),
        "pressure error": mean_error(found[1], true[1]),
        "shear error": mean_error(found[0], true[0]),
    }


# -- studies -----------------------------------------------------------------------------------------------------------


def noise_study(
    levels: Sequence[float] = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1), draws: int = 20, seed: int = 0
) -> list[dict[str, Any]]:
    """Relative error of the pressure against noise (standard deviation over peak reading): median of ``draws``.

    All three methods invert the very model that made the data (concentrated loads on the sensors' grid), so that they differ
    in nothing but regularisation; the regularised ones choose their parameter by evidence, the noise level unknown.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for case in ("cylinder", "punch"):
        for channel in ("stress_zz", "strain_zz"):
            true, readings = data(case, [channel])
            plane = array([channel])
            model = sampled_kernel(PAD, plane)
            solvers: dict[str, Any] = {
                "dft": Division(PAD, [plane], [1]),
                "hilgers": Regularised(model, [hilgers_prior(plane.grid, DEPTH)], [1], tikhonov, "evidence"),
                "tikhonov": Regularised(model, [DifferencePrior(plane.grid, 1)], [1], tikhonov, "evidence"),
            }
            for level in levels:
                noise = level * np.abs(readings).max() * rng.standard_normal((draws, *readings.shape))
                row: dict[str, Any] = {"case": case, "channel": channel, "noise": level}
                for name, solver in solvers.items():
                    found = solver.solve([readings + noise]).traction[:, 1]
                    row[name] = float(np.median(np.linalg.norm(found - true[1], axis=1) / np.linalg.norm(true[1])))
                rows.append(row)
    return rows


def truncation_study(counts: Sequence[int] = (121, 81, 41, 21)) -> list[dict[str, Any]]:
    """Mean absolute error against the number of sensors, data from the full-width contact, noise-free."""
    rows = []
    for case in ("cylinder", "punch"):
        for channel in ("stress_zz", "strain_zz"):
            for count in counts:
                true, readings = data(case, [channel], count)
                skin = Skin(PAD, array([channel], count))
                row: dict[str, Any] = {"case": case, "channel": channel, "sensors": count}
                for method in ("dft", "linear"):
                    found = skin.reconstruct(readings, method=method, components=["z"])
                    row[method] = mean_error(found.values[1], true[1])
                rows.append(row)
    return rows


def speed_study(counts: Sequence[int] = (121, 241, 481), repeats: int = 200) -> list[dict[str, Any]]:
    """Time per frame [s] (best of ``repeats``) and time to prepare, by division and by Hilgers' regularisation."""
    rows = []
    for count in counts:
        _, readings = data("cylinder", ["stress_zz"], count, count)
        row: dict[str, Any] = {"sensors": count}
        for method in ("dft", "hilgers"):
            skin = Skin(PAD, array(["stress_zz"], count), surface=LineGrid(count=count, spacing=PITCH))
            start = time.perf_counter()
            skin.reconstruct(readings, method=method, components=["z"])
            row[f"{method}, first"] = time.perf_counter() - start
            best = math.inf
            for _ in range(repeats):
                start = time.perf_counter()
                skin.reconstruct(readings, method=method, components=["z"])
                best = min(best, time.perf_counter() - start)
            row[f"{method}, frame"] = best
        row["ratio"] = row["hilgers, frame"] / row["dft, frame"]
        rows.append(row)
    return rows


# -- figures -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PaperFigure:
    """One figure as data: curves over a common x axis."""

    number: int
    caption: str
    x: Floats
    curves: dict[str, Floats]
    x_label: str = "x"
    y_label: str = "traction"
    log: bool = False
    styles: dict[str, str] = field(default_factory=dict)

    def draw(self) -> Figure:
        """The figure as a picture."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(5.2, 3.2), layout="constrained")
        axes = figure.subplots()
        colours = [INK["pressure"], INK["shear"], INK["other"], INK["error"]]
        for i, (name, y) in enumerate(self.curves.items()):
            truth = name.startswith("true")
            axes.plot(
                self.x,
                np.abs(y) if self.log else y,
                label=name,
                color=INK["truth"] if truth else colours[i % 4],
                ls="--" if truth else "-",
                lw=1.0 if truth else 1.5,
                zorder=3 if truth else 2,
            )
        if self.log:
            axes.set_yscale("log")
        axes.set_xlabel(self.x_label)
        axes.set_ylabel(self.y_label)
        axes.legend(frameon=False, fontsize=8)
        return figure

    def table(self) -> str:
        """The figure as CSV text."""
        lines = [",".join([self.x_label, *(f'"{n}"' for n in self.curves)])]
        lines += [",".join(repr(float(v)) for v in row) for row in zip(self.x, *self.curves.values())]
        return "\n".join(lines) + "\n"


def figures() -> list[PaperFigure]:
    """Figures 2 to 22: kernels, the three cases from stress and from strain, truncation."""
    out: list[PaperFigure] = []
    x = array(["stress_zz"]).grid.x
    kernel = {c: _kernel(c) for c in ("stress_zz", "strain_zz")}
    for channel in ("stress_zz", "strain_zz"):
        what = channel.split("_")[0]
        for column, name, word in ((1, "K1", "pressure"), (0, "K2", "shear")):
            out.append(
                PaperFigure(
                    len(out) + 2,
                    f"Kernel {name}: normal {what} at depth per unit {word}",
                    x,
                    {name: kernel[channel][column]},
                    y_label=f"normal {what}",
                )
            )
    k = 2 * np.pi * np.fft.rfftfreq(SENSORS, PITCH)
    spectra = {
        f"{name}, {c.split('_')[0]}": np.abs(rfftn(np.roll(kernel[c][column], -(SENSORS // 2)), (SENSORS,))) * PITCH
        for c in kernel
        for column, name in ((1, "K1"), (0, "K2"))
    }
    out.append(
        PaperFigure(
            6,
            "Size of the kernels' transforms: what division divides by",
            k,
            {n: np.maximum(v, 1e-12) for n, v in spectra.items()},
            "wavenumber k",
            "|K(k)|",
            log=True,
        )
    )

    def add(caption: str, curves: dict[str, Floats], y_label: str = "traction", *, log: bool = False) -> None:
        out.append(PaperFigure(len(out) + 2, caption, x, curves, y_label=y_label, log=log))

    for case in ("cylinder", "punch"):
        for channel in ("stress_zz", "strain_zz"):
            what = channel.split("_")[0]
            true, readings = data(case, [channel])
            skin = Skin(PAD, array([channel]))
            found = {m: skin.reconstruct(readings, method=m, components=["z"]).values[1] for m in ("dft", "linear")}
            add(
                f"{case.capitalize()}, no friction: normal {what} at the sensors",
                {f"normal {what}": readings[0]},
                f"normal {what}",
            )
            add(
                f"{case.capitalize()}, no friction: pressure found from {what}",
                {"true": true[1], "division of transforms": found["dft"]},
                "pressure",
            )
            if case == "cylinder":
                add(
                    f"Cylinder, no friction: error of the pressure found from {what}. Wrap-around of the circular transform, gone in the linear system",
                    {
                        "division of transforms": np.maximum(np.abs(found["dft"] - true[1]), 1e-18),
                        "linear system": np.maximum(np.abs(found["linear"] - true[1]), 1e-18),
                    },
                    "error of the pressure",
                    log=True,
                )
    errors = {}
    for channel in ("stress_zz", "strain_zz"):
        true, readings = data("punch", [channel])
        touch = Skin(PAD, array([channel])).reconstruct(readings, method="dft", components=["z"])
        errors[f"from {channel.split('_')[0]}, division"] = np.maximum(np.abs(touch.values[1] - true[1]), 1e-18)
    add("Punch, no friction: error of the pressure", errors, "error of the pressure", log=True)
    for channel in ("stress_zz", "strain_zz"):
        what = channel.split("_")[0]
        friction = friction_case(channel, "dft")
        add(
            f"Punch with friction: normal {what} at the sensors, pressure and shear mixed",
            {f"normal {what}": friction["readings"][0]},
            f"normal {what}",
        )
        values, true = friction["found"], friction["true"]
        add(
            f"Punch with friction, pressure and shear found from {what} alone; half-width found {friction['half-width']:.3f}, cells loaded out to {HALF_WIDTH + PITCH / 2}",
            {"true pressure": true[1], "pressure": values[1], "true shear": true[0], "shear": values[0]},
        )
    curves = {}
    for count in (121, 41):
        true, readings = data("punch", ["strain_zz"], count)
        found_ = Skin(PAD, array(["strain_zz"], count)).reconstruct(readings, method="dft", components=["z"]).values[1]
        padded = np.full(SENSORS, np.nan)
        start = (SENSORS - count) // 2
        padded[start : start + count] = found_
        curves[f"{count} sensors"] = padded
    add(
        "Truncation: pressure of the punch found from strain by division",
        {"true": data("punch", ["strain_zz"])[0][1], **curves},
        "pressure",
    )
    return out


def _kernel(channel: str) -> Floats:
    plane = sampled_kernel(PAD, array([channel])).planes[0]
    lags = plane.kernel[0] / PITCH  # type: ignore[attr-defined]
    middle = lags.shape[-1] // 2
    return np.asarray(lags[:, middle - SENSORS // 2 : middle + SENSORS // 2 + 1])


# -- report ------------------------------------------------------------------------------------------------------------


def report(folder: str | Path, *, progress: Callable[[str], None] | None = None) -> Path:
    """Write ``report.html`` (self-contained), every figure as PNG and CSV, and the tables as CSV; returns the report's path."""
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise InvalidInput(f"{target} is a file; give a folder.")
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"{target}: cannot make the folder ({error.strerror}).") from error
    say = progress or (lambda _: None)
    parts = [_HEAD]

    say("error table")
    errors = error_table()
    parts.append("<h2>Mean absolute errors (the paper's equation 26)</h2>" + _html_table(errors))
    parts.append(_ERRORS_TEXT)
    _write_csv(target / "errors.csv", errors)

    say("noise")
    noise = noise_study()
    _write_csv(target / "noise.csv", noise)
    parts.append(
        "<h2>Study: noise</h2><p>Relative error of the pressure (L2, median of 20 draws); noise over peak reading.</p>"
    )
    parts.append(_embed(_noise_figure(noise), target / "noise.png") + _html_table(noise))
    say("truncation")
    truncation = truncation_study()
    _write_csv(target / "truncation.csv", truncation)
    parts.append(
        "<h2>Study: truncation</h2><p>Mean absolute error against the number of sensors. A contact of half-width 3.5 fits inside "
        "21 sensors (&plusmn;5), so the linear system stays exact; division suffers because the data do not repeat.</p>"
    )
    parts.append(_embed(_truncation_figure(truncation), target / "truncation.png") + _html_table(truncation))
    say("speed")
    speed = speed_study()
    _write_csv(target / "speed.csv", speed)
    parts.append(
        "<h2>Study: speed</h2><p>Seconds on this machine; first call (with preparation) and best repeated frame. Hilgers' method "
        "chooses its parameter on every frame.</p>" + _html_table(speed)
    )
    parts.append(
        "<h2>Figures 2 to 22</h2><p>Captions are ours; the paper's list of figures is not available to us.</p>"
    )
    for figure in figures():
        say(f"figure {figure.number}")
        atomically(target / f"figure-{figure.number:02d}.csv", lambda name, f=figure: _write_text(name, f.table()))  # type: ignore[misc]
        picture = _embed(figure.draw(), target / f"figure-{figure.number:02d}.png")
        parts.append(
            f"<figure>{picture}<figcaption><b>Figure {figure.number}.</b> {html.escape(figure.caption)}.</figcaption></figure>"
        )
    parts.append("</main></body></html>")
    path = target / "report.html"
    atomically(path, lambda name: _write_text(name, "\n".join(parts)))
    return path


def _write_text(name: str, text: str) -> None:
    with open(name, "w", encoding="utf-8") as file:
        file.write(text)


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    atomically(path, lambda name: _write_text(name, buffer.getvalue()))


def _embed(figure: Figure, path: Path) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=110, format="png")

    def write(name: str) -> None:
        with open(name, "wb") as file:
            file.write(buffer.getvalue())

    atomically(path, write)
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}">'


def _html_table(rows: Sequence[dict[str, Any]]) -> str:
    def cell(value: Any) -> str:
        if isinstance(value, float):
            return f"<td class=n>{value:.3g}</td>"
        return f"<td{' class=n' if isinstance(value, int) else ''}>{html.escape(str(value))}</td>"

    head = "".join(f"<th>{html.escape(k)}</th>" for k in rows[0])
    body = "".join("<tr>" + "".join(cell(v) for v in row.values()) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _panels(rows: Sequence[dict[str, Any]], key: str, names: Sequence[str], x_label: str, y_label: str) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.6), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True)
    for axes, (case, channel) in zip(
        grid.ravel(), ((c, ch) for c in ("cylinder", "punch") for ch in ("stress_zz", "strain_zz"))
    ):
        part = [r for r in rows if r["case"] == case and r["channel"] == channel]
        for name, colour in zip(names, (INK["error"], INK["other"], INK["pressure"])):
            axes.plot(
                [r[key] for r in part], [max(r[name], 1e-18) for r in part], "o-", ms=3.5, label=name, color=colour
            )
        axes.set_title(f"{case}, {channel.split('_')[0]}", fontsize=10)
        axes.set_yscale("log")
        axes.set_ylabel(y_label)
    for axes in grid[-1]:
        axes.set_xlabel(x_label)
    grid[0, 0].legend(frameon=False, fontsize=8)
    return figure


def _noise_figure(rows: Sequence[dict[str, Any]]) -> Figure:
    figure = _panels(rows, "noise", ("dft", "hilgers", "tikhonov"), "noise / peak reading", "relative error")
    for axes in figure.axes:
        axes.set_xscale("log")
    return figure


def _truncation_figure(rows: Sequence[dict[str, Any]]) -> Figure:
    return _panels(rows, "sensors", ("dft", "linear"), "sensors", "mean absolute error")


_HEAD = f"""<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>palpate: the founding paper, end to end</title><style>
:root {{ color-scheme: light dark; }}
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 0; }} main {{ max-width: 60rem; margin: auto; padding: 1.5rem; }}
table {{ border-collapse: collapse; margin: 1rem 0; display: block; overflow-x: auto; }}
th, td {{ padding: .2rem .7rem; border-bottom: 1px solid #8884; text-align: left; }} td.n {{ text-align: right; font-variant-numeric: tabular-nums; }}
img {{ max-width: 100%; background: white; }} figure {{ display: inline-block; width: 27rem; max-width: 100%; margin: .5rem; vertical-align: top; }}
figcaption {{ font-size: .9rem; }}
</style></head><body><main><h1>The founding paper, end to end</h1>
<p>Line contact on a half-space; the surface traction found from normal stress or strain at depth (University of Maryland, late
1980s). Depth {DEPTH}, sampling {PITCH}, {SENSORS} sensors, E = 1, &nu; = 0.5. The paper does not state the half-width a, the load
P, the amount &epsilon; added to a for the punch, or the friction coefficient: a = {HALF_WIDTH}, P = {LOAD}, &epsilon; = {EPS} and
&mu; = {FRICTION} are our choice; the first three give both printed strain errors to three digits.</p>"""

_ERRORS_TEXT = f"""<p>Exponents marked ? are illegible in the surviving copy. <b>The strain errors are wrap-around</b>: the data are a
linear convolution, the division a circular one; solving the linear system that made the data removes them. The paper's
<b>stress errors</b> are 50 times above wrap-around. Single precision alone does not explain them (column &ldquo;dft,
float32&rdquo;: ten times too small); readings kept to seven decimals do, in size (&ldquo;dft, 7 decimals&rdquo;).</p>
<p><b>With friction</b> one channel mixes pressure and shear; the contact is taken as symmetric and the shear as constant, and
the half-width is found from the data (the true shear is constant on the samples with |x| &le; {HALF_WIDTH}, which stand for
cells out to {HALF_WIDTH + PITCH / 2}). Which of the paper's two components is which is not known, nor how it found the half-width.</p>"""
