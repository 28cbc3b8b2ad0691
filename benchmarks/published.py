"""Run the commands of docs/howto/published.md on the published recordings, and make its figures and tables.

    python benchmarks/published.py --data FOLDER --out WORK             # holds eflesh/, tactileforce/, melexis/
    python benchmarks/published.py --data FOLDER --out WORK --figures   # figures and tables alone
    python benchmarks/published.py --data FOLDER --out WORK --write     # docs/_static/published-*.png, docs/_generated/published.md

Skin files and commands are read from the page. A command whose result lies in WORK already does not run again. Without --write figures and tables go to WORK.
Learning curves and their coverage are drawn from docs/_generated/calibrate.md.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from palpate._plot.style import INK, PAGE, journal
from palpate.calibrate import SkinCalibration, read_calibration
from palpate.calibrate.findings import DIFFERS, LAG, loading_difference
from palpate.calibrate.labels import find_delay
from palpate.sensing.times import interpolated

DOCS = Path(__file__).parents[1] / "docs"
RUNS = ("20250401_014340", "20250401_015037")
#: Calibrations of the page, and how the tables name them.
CALIBRATIONS = {
    "lattice-1": "lattice, run 1",
    "lattice-second": "lattice, run 2",
    "barometers-0": "barometers, stream 0",
    "barometers-1": "barometers, stream 1",
    "barometers-2": "barometers, stream 2",
    "magnet-1": "magnet",
}
INKS = {"palpate": INK["z"], "linear": INK["x"], "quadratic": INK["y"], "process": "0.45"}
#: Rows of stream 0 in today.csv.
TODAY = 899
REST = 30
GRAM = 9.81e-3
Array = np.ndarray


# -- commands of the page ------------------------------------------------------------------------------------------------


def run_page(data: Path, work: Path) -> None:
    """Write the skin files of the page into ``work``, and run its commands there."""
    page = (DOCS / "howto" / "published.md").read_text(encoding="utf-8")
    link = work / "data"
    if not link.exists():
        link.symlink_to(data.resolve(), target_is_directory=True)
    for name, text in re.findall(r"```toml\n# (\S+)\n(.*?)```", page, re.DOTALL):
        (work / name).write_text(text, encoding="utf-8")
    for block in re.findall(r"```text\n(.*?)```", page, re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line)
            if words[0] == "palpate":
                if (work / words[words.index("--out") + 1]).exists():
                    continue
                line = f"{shlex.quote(sys.executable)} -m {line}"
            elif words[0] != "head":
                continue
            print(line, file=sys.stderr, flush=True)
            subprocess.run(line, shell=True, cwd=work, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def tracked(path: Path) -> tuple[Array, Array, Array, Array]:
    """Time, normal force and the ends of its interval; NaN where the tracker gave none."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = ("time (s)", "force_z (N)", "force_z_low (N)", "force_z_high (N)")
    time, force, low, high = (np.array([float(r[n] or "nan") for r in rows]) for n in names)
    return time, np.where(np.isfinite(low), force, np.nan), low, high


def lattice(data: Path, run: str) -> tuple[Array, Array, Array]:
    """Readings (frame, 1 + 15) with their time, clock of the load cell, and its force [N], NaN where it had none."""
    start = data / "eflesh" / f"normal_force_{run}_probe"
    table = np.loadtxt(f"{start}_sensor_post_baselines.csv", delimiter=",")
    states = np.loadtxt(f"{start}_states.csv", delimiter=",")
    return table, states[:, 0], np.where(states[:, 4] == -1.0, np.nan, GRAM * states[:, 4])


def stream(data: Path, number: int) -> Array:
    """Known force of each frame of a stream of the barometers, without its zero."""
    table = np.loadtxt(data / "tactileforce" / f"stream-{number}.csv", delimiter=",", skiprows=1)
    return np.asarray(table[:, 0] - table[:REST, 0].mean())


def errors(value: Array, low: Array, high: Array, known: Array) -> tuple[float, float, float]:
    """Mean error, coverage and mean width of the 95 % interval on frames with both."""
    good = np.isfinite(value) & np.isfinite(known)
    inside = (low[good] <= known[good]) & (known[good] <= high[good])
    return (
        float(np.abs(value - known)[good].mean()),
        float(inside.mean()),
        float((high - low)[good].mean()),
    )


# -- tables --------------------------------------------------------------------------------------------------------------


def verdict(found: SkinCalibration) -> str:
    said = next(s for s in found.said if s.startswith("the elastic model"))
    return re.split(r"[:(]", said.removeprefix("the elastic model "))[0].strip()


def tables(data: Path, work: Path, calibrations: dict[str, SkinCalibration]) -> list[str]:
    lines = [
        "Made by `python benchmarks/published.py --data FOLDER --out WORK --write`.",
        "",
        "<!-- calibrations -->",
        "",
        "| calibrated on | labels | palpate: mean error [N] | R² | inside 95 % | linear [N] | quadratic [N] | process [N] | elastic model: error | map: error | it says |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, found in calibrations.items():
        own, *others = found.table
        mapped = relative_error(found)
        lines.append(
            f"| {CALIBRATIONS[name]} | {len(found.maps['fz'].process.values)} | {own[1]:.3g} | {own[2]:.3f} | {own[3]:.2f} | "
            + " | ".join(f"{row[1]:.3g}" for row in others)
            + f" | {100 * found.elastic_error:.0f} % | {100 * mapped:.0f} % | {verdict(found)} |"
        )
    lines += [
        "",
        "The errors of elastic model and map are root mean squares, relative to that of the labels.",
        "",
        "<!-- runs -->",
        "",
        "| calibrated on | asked about | mean error [N] | inside 95 % | width [N] | mean of known less found, above half of the largest force [N] |",
        "|---|---|---|---|---|---|",
    ]
    for label, asked, value, low, high, known in held_out(data, work):
        error, inside, width = errors(value, low, high, known)
        strong = known > 0.5 * np.nanmax(known)
        lines.append(
            f"| {label} | {asked} | {error:.3g} | {inside:.2f} | {width:.3g} | {np.nanmean((known - value)[strong]):+.3f} |"
        )
    today = read_calibration(work / "today.toml")
    if today is None:
        raise SystemExit("today.toml has no calibration")
    own_gain = today.unit / calibrations["barometers-2"].unit
    lines += [
        "",
        f'It says of stream 0 "{today.said[0].split(". ")[0]}"; the factor on the force of the elastic model is {own_gain:.2f}.',
        "",
        "<!-- lag -->",
        "",
        "| calibrated on | mean error while loading less that while unloading [N] | of the force | standard errors | it says |",
        "|---|---|---|---|---|",
    ]
    for name, found in calibrations.items():
        compared = loading_difference(found.maps["fz"])
        said = next((s for s in found.said if s.startswith("the pad lags")), "nothing")
        if compared is None:
            lines.append(f"| {CALIBRATIONS[name]} | too few frames of either | | | nothing |")
            continue
        apart, scatter, size = compared
        lines.append(
            f"| {CALIBRATIONS[name]} | {apart:+.3f} | {100 * abs(apart) / size:.1f} % | {abs(apart) / scatter:.1f} | {said.split(':')[0]} |"
        )
    return [*lines, "", f"It says that the pad lags from {DIFFERS:g} standard errors and {100 * LAG:g} % on."]


def relative_error(found: SkinCalibration) -> float:
    """Root mean square error of the map on presses left out, relative to that of the labels."""
    one = found.maps["fz"]
    return float(np.sqrt((one.left_out**2).mean() / (one.process.values**2).mean()))


def held_out(data: Path, work: Path) -> list[tuple[str, str, Array, Array, Array, Array]]:
    """What was calibrated, what was asked, and force, ends of the interval and known force of each frame."""
    time, force, low, high = tracked(work / "lattice-2.csv")
    out = [("lattice, run 1", "run 2", force, low, high, second_run(data, time))]
    known = stream(data, 0)
    known[: TODAY + 1] = np.nan
    for name, label in (("before", "stream 2"), ("after", "stream 2, first presses of stream 0")):
        _, force, low, high = tracked(work / f"{name}.csv")
        out.append((f"barometers, {label}", "the rest of stream 0", force, low, high, known))
    return out


def second_run(data: Path, time: Array) -> Array:
    """Force of the load cell in the second run at the times of the frames, less its value at rest and the delay that
    `palpate calibrate` finds between the clocks; NaN where it had none.
    """
    table, clock, force = lattice(data, RUNS[1])
    seen = np.isfinite(force)
    readings = table[:, 1:] - table[:REST, 1:].mean(axis=0)
    delay = find_delay(table[:, 0], readings, clock[seen], force[seen])
    known = interpolated(time, clock + delay, force)
    return np.asarray(known - np.nanmean(known[:REST]))


# -- figures -------------------------------------------------------------------------------------------------------------


def draw_raw(data: Path) -> Figure:
    table, clock, force = lattice(data, RUNS[0])
    figure = Figure(figsize=(PAGE, 3.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    start, shown = table[0, 0], table[:, 0] < table[0, 0] + 150.0
    for i, name in enumerate("xyz"):
        upper.plot(table[shown, 0] - start, table[shown, 1 + i], color=INK[name], label=name)
    upper.set_ylabel("reading [count]")
    upper.legend(loc="lower right", ncols=3, frameon=False)
    shown = clock < start + 150.0
    lower.plot(clock[shown] - start, force[shown], ".", markersize=2.0, color=INK["truth"])
    lower.set_ylabel("load cell [N]")
    lower.set_xlabel("time [s]")
    return figure


def draw_track(data: Path, work: Path) -> Figure:
    time, force, low, high = tracked(work / "lattice-2.csv")
    known = second_run(data, time)
    figure = Figure(figsize=(PAGE, 3.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    shown = time < time[0] + 150.0
    t = time[shown] - time[0]
    upper.fill_between(t, low[shown], high[shown], color=INK["z"], alpha=0.25, linewidth=0.0, label="95 %")
    upper.plot(t, force[shown], color=INK["z"], label="palpate")
    upper.plot(t, known[shown], ".", markersize=2.0, color=INK["truth"], label="load cell")
    upper.set_ylabel("normal force [N]")
    upper.legend(loc="upper right", frameon=False)
    half = 0.5 * (high - low)[shown]
    lower.fill_between(t, -half, half, color=INK["z"], alpha=0.25, linewidth=0.0)
    lower.plot(t, (force - known)[shown], ".", markersize=2.0, color=INK["error"])
    lower.set_ylabel("found less\nknown [N]")
    lower.set_xlabel("time [s]")
    return figure


def curves() -> tuple[list[int], dict[str, dict[str, list[float]]], dict[str, list[float]], dict[str, list[float]]]:
    """Numbers of labels; error of each set and method; coverage of palpate for each set; mean coverage of each method."""
    text = (DOCS / "_generated" / "calibrate.md").read_text(encoding="utf-8")
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| ")]
    sizes = [int(c.split()[0]) for c in rows[0][2:]]
    error: dict[str, dict[str, list[float]]] = {}
    inside: dict[str, list[float]] = {}
    mean: dict[str, list[float]] = {}
    name = ""
    for row in rows:
        name = row[0] or name
        if row[1] in INKS:
            error.setdefault(name, {})[row[1]] = [float(c) for c in row[2:]]
        elif row[1] == "coverage":
            (mean if name in INKS else inside)[name] = [float(c) for c in row[2:]]
    return sizes, error, inside, mean


def draw_curves() -> Figure:
    sizes, error, _, _ = curves()
    figure = Figure(figsize=(PAGE, 4.6), layout="constrained")
    panels = figure.subplots(3, 4, sharex=True).ravel()
    for panel, (name, methods) in zip(panels, error.items()):
        for method, values in methods.items():
            wide = 1.6 if method == "palpate" else 0.9
            panel.loglog(sizes, values, "o-", markersize=2.5, color=INKS[method], linewidth=wide, label=method)
        panel.set_title(name)
        best = min(min(v) for v in methods.values())
        panel.set_ylim(0.7 * best, 1.5 * max(methods["palpate"][0], methods["linear"][0]))
        panel.set_xticks(sizes, [str(n) for n in sizes])
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.minorticks_off()
    for panel in panels[len(error) - 4 : len(error)]:  # nothing is drawn below them
        panel.tick_params(labelbottom=True)
    for panel in panels[len(error) :]:
        panel.axis("off")
    handles, labels = panels[0].get_legend_handles_labels()
    panels[-1].legend(handles, labels, loc="center", frameon=False)
    figure.supxlabel("labelled frames")
    figure.supylabel("mean error [N]")
    return figure


def draw_coverage() -> Figure:
    sizes, _, inside, mean = curves()
    figure = Figure(figsize=(0.6 * PAGE, 2.8), layout="constrained")
    panel = figure.subplots()
    for values in inside.values():
        panel.plot(sizes, values, ".", color=INK["z"], markersize=3.0, alpha=0.5)
    for method, values in mean.items():
        wide = 1.8 if method == "palpate" else 1.0
        panel.semilogx(sizes, values, "o-", markersize=3.0, color=INKS[method], linewidth=wide, label=method)
    panel.axhline(0.95, color="0.7", linewidth=0.8, linestyle="--")
    panel.set_xticks(sizes, [str(n) for n in sizes])
    panel.minorticks_off()
    panel.set_xlabel("labelled frames")
    panel.set_ylabel("inside the 95 % interval")
    panel.set_ylim(0.0, 1.03)
    panel.legend(frameon=False, loc="lower right")
    return figure


def draw_elastic(calibrations: dict[str, SkinCalibration]) -> Figure:
    figure = Figure(figsize=(PAGE, 2.4), layout="constrained")
    panel = figure.subplots()
    at = np.arange(len(calibrations))[::-1]
    elastic = [100.0 * c.elastic_error for c in calibrations.values()]
    mapped = [100.0 * relative_error(c) for c in calibrations.values()]
    panel.barh(at + 0.2, elastic, 0.38, color=INK["shear"], label="elastic model, one factor")
    panel.barh(at - 0.2, mapped, 0.38, color=INK["z"], label="map from readings to force")
    for y, value, found in zip(at, elastic, calibrations.values()):
        panel.text(value + 0.4, y + 0.2, verdict(found), va="center", fontsize=7)
    panel.set_yticks(at, [CALIBRATIONS[n] for n in calibrations])
    panel.set_xlim(0.0, 1.5 * max(elastic))
    panel.set_xlabel("root mean square error of the normal force [% of that of the labels]")
    panel.legend(frameon=False, loc="lower right")
    return figure


def draw_this_run(data: Path, work: Path) -> Figure:
    figure = Figure(figsize=(PAGE, 2.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    words = ("calibrated on stream 2", "with the first presses of stream 0")
    for panel, title, (_, _, value, low, high, known) in zip(panels, words, held_out(data, work)[1:]):
        edges = np.linspace(0.05, np.nanmax(known), 9)
        middle, off, spread, half = [], [], [], []
        for a, b in itertools.pairwise(edges):
            at = (known >= a) & (known < b) & np.isfinite(value)
            middle.append(0.5 * (a + b))
            off.append(float((value - known)[at].mean()))
            spread.append(float((value - known)[at].std()))
            half.append(float(0.5 * (high - low)[at].mean()))
        m, h = np.array(middle), np.array(half)
        panel.fill_between(m, -h, h, color=INK["z"], alpha=0.25, linewidth=0.0, label="half of the 95 % interval")
        panel.errorbar(
            m, off, yerr=spread, fmt="o", markersize=3.0, linewidth=0.8, color=INK["error"], label="found less known"
        )
        panel.axhline(0.0, color="0.6", linewidth=0.6)
        panel.set_title(title)
        panel.set_xlabel("known force [N]")
    panels[0].set_ylabel("[N]")
    panels[0].legend(frameon=False, loc="lower left")
    return figure


def draw_lag(data: Path, calibrations: dict[str, SkinCalibration]) -> Figure:
    table, _, force = lattice(data, RUNS[0])
    table, force = table[: len(force)], force[: len(table)]
    reading = table[:REST, 3].mean() - table[:, 3]
    seen = np.flatnonzero(np.isfinite(force))
    rise = np.gradient(force[seen], table[seen, 0])
    figure = Figure(figsize=(PAGE, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    for at, label, ink in ((rise > 0.5, "load grows", INK["x"]), (rise < -0.5, "load falls", INK["z"])):
        left.plot(force[seen][at], reading[seen][at], ".", markersize=2.0, color=ink, label=label)
    left.set_xlabel("load cell, lattice, run 1 [N]")
    left.set_ylabel("middle magnetometer, -z [count]")
    left.legend(frameon=False)
    rows = {n: loading_difference(c.maps["fz"]) for n, c in calibrations.items()}
    known = {n: r for n, r in rows.items() if r is not None}
    at = np.arange(len(known))[::-1]
    apart = np.array([100.0 * r[0] / r[2] for r in known.values()])
    error = np.array([100.0 * DIFFERS * r[1] / r[2] for r in known.values()])
    right.errorbar(apart, at, xerr=error, fmt="o", markersize=3.0, linewidth=0.8, color=INK["error"])
    right.axvspan(-100.0 * LAG, 100.0 * LAG, color="0.9")
    right.set_yticks(at, [CALIBRATIONS[n] for n in known])
    right.set_xlabel("error loading less unloading, +- 3 standard errors\n[% of the force]")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with eflesh/, tactileforce/ and melexis/")
    parser.add_argument("--out", type=Path, required=True, help="folder for what the commands write")
    parser.add_argument("--figures", action="store_true", help="run no command of the page")
    parser.add_argument("--write", action="store_true", help="into docs/ instead of --out")
    given = parser.parse_args()
    work: Path = given.out
    work.mkdir(parents=True, exist_ok=True)
    if not given.figures:
        run_page(given.data, work)
    calibrations: dict[str, Any] = {n: read_calibration(work / f"{n}.toml") for n in CALIBRATIONS}
    drawn: dict[str, Callable[[], Figure]] = {
        "raw": lambda: draw_raw(given.data),
        "track": lambda: draw_track(given.data, work),
        "curves": draw_curves,
        "coverage": draw_coverage,
        "elastic": lambda: draw_elastic(calibrations),
        "this-run": lambda: draw_this_run(given.data, work),
        "lag": lambda: draw_lag(given.data, calibrations),
    }
    pictures = DOCS / "_static" if given.write else work
    for name, draw in drawn.items():
        with journal():
            draw().savefig(pictures / f"published-{name}.png", dpi=130)
    shutil.copyfile(work / "lattice-1.png", pictures / "published-report.png")
    text = "\n".join(tables(given.data, work, calibrations)) + "\n"
    (DOCS / "_generated" / "published.md" if given.write else work / "published.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
