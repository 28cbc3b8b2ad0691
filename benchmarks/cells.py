"""Cells whose truth is known by closed forms (`cells_population`): numbers of `cell_forces` as parts of the truth, and how often its intervals hold it.

Constants of `palpate.microscopy.spread` come from cells 0 to 47 (`--rows constants`); figures come from cells that were drawn after all constants were set.

    python benchmarks/cells.py --cells 0:48 --rows constants            # three minutes, as the next
    python benchmarks/cells.py --cells 3000:3060 --methods adhesions --markdown docs/_generated/cells.md
    python benchmarks/cells.py --cells 0:10 --rows population --keep cells.json  # in pieces: the next run adds to these
    python benchmarks/cells.py --rows times film --markdown docs/_generated/cells_times.md
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import resource
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import scipy.optimize
import scipy.stats

sys.path.insert(0, str(Path(__file__).parent))
from cells_population import SQUARE, Cell, cell_of

import palpate as pp
from palpate.microscopy import Field, Film, cell_forces, forces_of_labels, labels, spread
from palpate.sensing.uncertainty import EXACT

KEYS = ("strain_energy", "contractile_moment", "contractility", "traction_peak", "net_force_x", "net_force_y")
NAMES = ("energy", "moment", "contractility", "peak", "net force x", "net force y", "adhesions, x and y")


def field_of(cell: Cell, window: float = 1.0) -> Field:
    """The field as it is said to be: with so many times its window."""
    return Field(
        displacement=cell.displacement,
        start=cell.start,
        step=float(cell.step),
        pixel=SQUARE,
        aperture=window * cell.window * SQUARE,
    )


def judged(cell: Cell, method: str, window: float = 1.0) -> dict[str, Any]:
    """Value, ends and truth of each number."""
    pad = pp.HalfSpace(youngs_modulus=cell.modulus, poissons_ratio=cell.ratio)
    field = field_of(cell, window)
    if method == "tikhonov":  # as the command was: outliers stay unless somebody leaves them out
        field = field.without_drift()
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        forces = cell_forces(field, pad, mask=cell.mask, size=cell.mask.shape[::-1], method=method, uncertainty=EXACT)
    seconds = time.process_time() - start
    out: dict[str, Any] = {"seconds": seconds, "seed": cell.seed, "edge": cell.edge, "noise": cell.noise}
    out |= {"window": cell.window, "outliers": bool(cell.outliers.any())}
    for key in KEYS:
        q = forces[key]
        out[key] = (q.value, *q.interval, cell.truth[key])
    masks = {str(i): cell.labels == i for i, force in cell.forces.items() if math.hypot(*force) > 0}
    out["adhesions"] = [
        (f.force[c], f.force[c] - 1.96 * f.std[c], f.force[c] + 1.96 * f.std[c], cell.forces[int(f.label)][c])
        for f in forces_of_labels(forces, masks, size=cell.mask.shape[::-1])
        for c in (0, 1)
    ]
    out["left_out"] = [n for n in forces.notes if "left out as outliers" in n]
    out["window_note"] = [n for n in forces.notes if "window" in n and "energy" in n]
    return out


def summary(found: list[dict[str, Any]]) -> list[str]:
    """Median ratio with its tenth and ninetieth centile, and coverage, of each number."""
    cells = []
    for key in (*KEYS, "adhesions"):
        rows = np.array([r for f in found for r in (f[key] if key == "adhesions" else [f[key]])])
        held = float(np.mean((rows[:, 1] <= rows[:, 3]) & (rows[:, 3] <= rows[:, 2])))
        if key.startswith("net"):
            cells.append(f"{held:.2f}")
            continue
        if key == "adhesions":
            size = np.hypot(rows[::2, 3], rows[1::2, 3])
            ratio = (rows[::2, 0] * rows[::2, 3] + rows[1::2, 0] * rows[1::2, 3]) / np.maximum(size, 1e-300) ** 2
        else:
            ratio = rows[:, 0] / rows[:, 3]
        low, middle, high = np.quantile(ratio, (0.1, 0.5, 0.9))
        cells.append(f"{middle:.2f} ({low:.2f} to {high:.2f}), {held:.2f}")
    cells.append(f"{np.median([f['seconds'] for f in found]):.1f}")
    return cells


def judged_pieces(cells: range, method: str, held: Path | None) -> list[dict[str, Any]]:
    """The numbers of some cells; those that ``held`` has are not made again, and those of other runs there are kept."""
    path = None if held is None else held.with_name(f"{held.stem}-{method}.json")
    found = json.loads(path.read_text()) if path is not None and path.exists() else []
    for seed in cells:
        if any(f["seed"] == seed for f in found):
            continue
        found.append(judged(cell_of(seed), method))
        if path is not None:  # a long run may be stopped, and goes on where it was
            path.write_text(json.dumps(found))
        ratios = {k: f"{found[-1][k][0] / found[-1][k][3]:.2f}" for k in KEYS[:4]}
        print(method, seed, ratios, file=sys.stderr, flush=True)
    return [f for f in found if f["seed"] in cells]


def population(cells: range, methods: list[str], held: Path | None) -> list[str]:
    """Rows of the main table: all, and parts of it."""
    lines = []
    for method in methods:
        found = judged_pieces(cells, method, held)
        for name, part in (
            ("all", found),
            ("noise above 10 %", [f for f in found if f["noise"] > 0.1]),
            ("3 % outliers", [f for f in found if f["outliers"]]),
            ("window", [f for f in found if f["window"]]),
            ("at the edge", [f for f in found if f["edge"]]),
            ("not at the edge", [f for f in found if not f["edge"]]),
        ):
            if part:
                lines.append(f"| {name} | {method} | {len(part)} | {' | '.join(summary(part))} |")
    return lines


@contextlib.contextmanager
def plain_samples() -> Iterator[None]:
    """Numbers as the samples have them, not widened."""
    before = dict(spread.WIDER), spread.OTHER_SPREAD, dict(spread.SHIFT)
    hidden = labels._hidden
    spread.WIDER.clear()
    spread.SHIFT.clear()
    spread.OTHER_SPREAD = (1.0, 0.0)
    labels._hidden = lambda *_: 0.0
    try:
        yield
    finally:
        spread.WIDER.update(before[0])
        spread.OTHER_SPREAD = before[1]
        spread.SHIFT.update(before[2])
        labels._hidden = hidden


def constants(cells: range, held: Path | None) -> list[str]:
    """What the samples leave out: shift, factor and part of `palpate.microscopy.spread`, of the likeliest errors (Student's of five degrees of freedom, so that single cells do
    not set the widths), then widened until 95 % intervals hold 95 %; and how often intervals of the samples alone hold.
    """
    with plain_samples():
        found = judged_pieces(cells, "adhesions", held)
    lines = [
        "| quantity | count | shift [std] | factor of the std | part of the value | inside 95 % of the samples alone |",
        "|---|---|---|---|---|---|",
    ]
    for key in ("strain_energy", "traction_peak", "contractile_moment", "contractility"):
        rows = np.array([f[key] for f in found if not f["edge"]])
        lines.append(f"| {key} | {len(rows)} | {fitted(rows, key in spread.LOGARITHMIC)} |")
    rows = np.array([r for f in found for r in f["adhesions"]])
    lines.append(f"| adhesions, without what stays unseen | {len(rows)} | {fitted(rows, False)} |")
    return lines


def fitted(rows: Any, logarithmic: bool) -> str:
    """Shift, factor and part of value, ends and truth."""
    value, low, high, truth = rows.T
    if logarithmic:
        mean, std, off = np.log(value), (np.log(high) - np.log(low)) / 3.92, np.log(truth)
        size = np.ones_like(mean)
    else:
        mean, std, off, size = value, (high - low) / 3.92, truth, np.abs(value)
        # all in parts of the number's own error
        scale = np.maximum(std, 1e-3 * size)
        mean, std, off, size = mean / scale, std / scale, off / scale, size / scale
    error = off - mean

    def parts(p: Any) -> tuple[Any, Any]:
        shift = np.minimum(p[0] * std, spread.MAX_MISSING) if logarithmic else 0.0
        return error - shift, np.sqrt((np.exp(p[1]) * std) ** 2 + (np.exp(p[2]) * size) ** 2)

    def worth(p: Any) -> float:
        rest, wide = parts(p)
        return -float(np.sum(scipy.stats.t.logpdf(rest / wide, 5) - np.log(wide)))

    best = min(
        (
            scipy.optimize.minimize(worth, (0.0, math.log(f), math.log(q)), method="Nelder-Mead")
            for f in (1.0, 2.0)
            for q in (0.01, 0.1)
        ),
        key=lambda r: float(r.fun),
    ).x
    rest, wide = parts(best)
    # as much wider as makes 95 % intervals hold 95 %
    more = max(1.0, float(np.quantile(np.abs(rest / wide), 0.95)) / 1.96)
    plain = float(np.mean(np.abs(error) < 1.96 * std))
    shift, factor, part = (best[0] if logarithmic else 0.0), more * math.exp(best[1]), more * math.exp(best[2])
    return f"{shift:.2f} | {factor:.2f} | {part:.3f} | {plain:.2f}"


def windows(first: int, count: int) -> list[str]:
    """The window said as it was, too small and too large: energy as part of the truth, how often it is held, and whether a note names the energy of another window."""
    lines = []
    for said in (0.0, 1.0, 2.0):
        found = [
            judged(cell_of(s, noise=0.05, outliers=False, edge=False, window=12, step=6), "adhesions", window=said)
            for s in range(first, first + count)
        ]
        rows = np.array([f["strain_energy"] for f in found])
        held = int(np.sum((rows[:, 1] <= rows[:, 3]) & (rows[:, 3] <= rows[:, 2])))
        noted = sum(bool(f["window_note"]) for f in found)
        lines.append(
            f"| {said:g} times the true one | {count} | {np.median(rows[:, 0] / rows[:, 3]):.2f} | {held} of {count} | {noted} of {count} |"
        )
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


#: Rows of one kind, by the word of ``--kinds``.
KINDS: dict[str, tuple[str, dict[str, Any]]] = {
    "plain": ("noise of 5 %, no outliers", {"noise": 0.05, "outliers": False, "edge": False}),
    "outliers": ("noise of 5 %, 3 % outliers", {"noise": 0.05, "outliers": True, "edge": False}),
    "weak": ("noise of 20 %", {"noise": 0.2, "outliers": False, "edge": False}),
    "round": ("noise of 5 %, round adhesions", {"noise": 0.05, "outliers": False, "edge": False, "aspect": (1.0, 1.0)}),
    "long": (
        "noise of 5 %, adhesions four times as long as wide",
        {"noise": 0.05, "outliers": False, "edge": False, "aspect": (4.0, 4.0)},
    ),
}


def special(first: int, count: int, methods: list[str], kinds: list[str]) -> list[str]:
    """Outliers, weak cells and shapes of adhesions, on the same cells."""
    lines = []
    for name, options in (KINDS[kind] for kind in kinds):
        for method in methods:
            found = [judged(cell_of(seed, **options), method) for seed in range(first, first + count)]
            lines.append(f"| {name} | {method} | {len(found)} | {' | '.join(summary(found))} |")
            print(lines[-1], file=sys.stderr, flush=True)
    return lines


def crop(first: int, count: int, methods: list[str]) -> list[str]:
    """The middle of a field beside the whole: energy as part of the truth, and how far apart."""
    lines = []
    for method in methods:
        ratios, agree = [], []
        for seed in range(first, first + count):
            # the cell fills 0.84 of the field's width at most: this is the field with room, and without
            wide = cell_of(seed, noise=0.05, outliers=False, edge=False, margin=2.6)
            n, side = wide.displacement.shape[1], wide.step
            k = int(0.15 * n)
            part = Cell(
                **{
                    **wide.__dict__,
                    "displacement": wide.displacement[:, k:-k, k:-k],
                    "mask": wide.mask[k * side : (n - k) * side, k * side : (n - k) * side],
                    "labels": wide.labels[k * side : (n - k) * side, k * side : (n - k) * side],
                }
            )
            a, b = judged(wide, method)["strain_energy"], judged(part, method)["strain_energy"]
            ratios.append((a[0] / a[3], b[0] / a[3]))
            agree.append(abs(math.log(b[0] / a[0])) < math.hypot(math.log(a[2] / a[0]), math.log(b[2] / b[0])))
        middle = np.median(ratios, axis=0)
        lines.append(f"| {method} | {count} | {middle[0]:.2f} | {middle[1]:.2f} | {sum(agree)} of {count} |")
    return lines


def times(sides: list[str]) -> list[str]:
    """Processor time and memory by size (columns x rows): each in a process of its own, so that memory is that of one."""
    lines = []
    for side in sides:
        columns, rows = (int(n) for n in (side.split("x") if "x" in side else (side, side)))
        count = max(rows, columns)
        cell = cell_of(
            1000, step=min(max(2, 320 // count * 2), 8), count=count, noise=0.05, outliers=False, edge=False, window=0
        )
        squares = (slice(rows * cell.step), slice(columns * cell.step))
        cell.displacement = cell.displacement[:, :rows, :columns]
        cell.mask, cell.labels = cell.mask[squares], cell.labels[squares]
        with get_context("spawn").Pool(1) as pool:
            seconds, memory = pool.apply(_timed, (cell,))
        lines.append(f"| {columns} x {rows} | {seconds:.1f} | {memory:.2f} |")
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def film(frames: int, side: int, processes: int) -> list[str]:
    """A film of ``frames`` fields, by so many processes: seconds by the clock and of all processors, and memory of one process."""
    cell = cell_of(1000, step=5, count=side, noise=0.05, outliers=False, edge=False, window=0)
    rng = np.random.default_rng(0)
    noise = 0.05 * float(np.nanmax(np.abs(cell.displacement)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.npy"
        np.save(
            path,
            np.stack([cell.displacement + noise * rng.standard_normal(cell.displacement.shape) for _ in range(frames)]),
        )
        made = Film(
            frames=[path], pad=pp.HalfSpace(youngs_modulus=cell.modulus, poissons_ratio=cell.ratio), pixel=SQUARE, unit="m", step=float(cell.step), start=cell.start
        )  # fmt: skip
        start = time.perf_counter()
        rows, _ = made.run(Path(folder) / "part.jsonl", processes=processes)
        wall = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    solved = sum("strain_energy_J" in row for row in rows)
    line = f"| {frames} | {side} x {side} | {processes} | {solved} | {wall:.0f} | {used.ru_utime + used.ru_stime:.0f} | {used.ru_maxrss / 1e6:.2f} |"
    return [
        "| frames | vectors | processes | solved | by the clock [s] | of all processors [s] | memory of a process at most [GB] |",
        "|---" * 7 + "|",
        line,
    ]


def _timed(cell: Cell) -> tuple[float, float]:
    row = judged(cell, "adhesions")
    return row["seconds"], resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--cells", default="3000:3060", help="first and last, such as 0:10: a population may be run in pieces"
    )
    parser.add_argument("--methods", nargs="+", default=["tikhonov", "adhesions"])
    parser.add_argument("--rows", nargs="+", default=["population", "special", "crop", "windows", "times", "film"])
    parser.add_argument("--frames", type=int, default=100, help="of the film of the row film")
    parser.add_argument("--special", type=int, default=12, help="cells of the rows of one kind")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of the row special")
    parser.add_argument("--sides", nargs="+", default=["64", "128", "256", "387x379", "512"])
    parser.add_argument(
        "--keep",
        type=Path,
        help="where the numbers of each cell are written as they come (.json): a run that was stopped goes on",
    )
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    first, last = (int(n) for n in args.cells.split(":"))
    cells = range(first, last)
    head = f"| cells | method | count | {' | '.join(NAMES)} | seconds |"
    rule = "|---" * (4 + len(NAMES)) + "|"
    said = f"--cells {args.cells} --methods {' '.join(args.methods)} --rows {' '.join(args.rows)}"
    said += f" --special {args.special}" if {"special", "crop", "windows"} & set(args.rows) else ""
    said += f" --kinds {' '.join(args.kinds)}" if "special" in args.rows and args.kinds != list(KINDS) else ""
    lines = [f"Made by `python benchmarks/cells.py {said}`.", ""]
    if "constants" in args.rows:
        lines += constants(cells, args.keep)
    if "population" in args.rows or "special" in args.rows:
        lines += [head, rule]
    if "population" in args.rows:
        lines += population(cells, args.methods, args.keep)
    if "special" in args.rows:
        lines += special(first, args.special, args.methods, args.kinds)
    if "crop" in args.rows:
        lines += ["", "| method | cells | energy, whole field | energy, its middle | agree |", "|---|---|---|---|---|"]
        lines += crop(first, args.special, args.methods)
    if "windows" in args.rows:
        lines += [
            "",
            "| stated window | cells | energy | truth inside the interval | note given |",
            "|---|---|---|---|---|",
        ]
        lines += windows(first, args.special)
    if "times" in args.rows:
        lines += ["", "| vectors | processor time [s] | memory at most [GB] |", "|---|---|---|", *times(args.sides)]
    if "film" in args.rows:
        lines += ["", *film(args.frames, 24, 2)]
    print("\n".join(lines))
    if args.markdown is not None:
        args.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
