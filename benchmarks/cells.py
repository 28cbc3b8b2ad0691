"""Cells whose truth is known by closed forms (`cells_population`): numbers of `cell_forces` as parts of the truth, and how often its intervals hold it.

Constants of `palpate.microscopy.spread` come from cells 0 to 23, figures from 1000 on. Contractility and adhesions were changed after a look at 1000 to 1017: cells from 2000 on are theirs.

    python benchmarks/cells.py --markdown docs/_generated/cells.md      # half an hour
    python benchmarks/cells.py --cells 12 --first 0 --rows population
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from cells_population import SQUARE, Cell, cell_of

import palpate as pp
from palpate.microscopy import Field, cell_forces, forces_of_labels
from palpate.sensing.uncertainty import EXACT

KEYS = ("strain_energy", "contractile_moment", "contractility", "traction_peak", "net_force_x", "net_force_y")
NAMES = ("energy", "moment", "contractility", "peak", "net force x", "net force y", "adhesions, x and y")


def field_of(cell: Cell) -> Field:
    return Field(
        displacement=cell.displacement,
        start=cell.start,
        step=float(cell.step),
        pixel=SQUARE,
        aperture=cell.window * SQUARE,
    )


def judged(cell: Cell, method: str) -> dict[str, Any]:
    """Value, ends and truth of each number."""
    pad = pp.HalfSpace(youngs_modulus=cell.modulus, poissons_ratio=cell.ratio)
    field = field_of(cell)
    if method == "tikhonov":  # as the command was: outliers stay unless somebody leaves them out
        field = field.without_drift()
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        forces = cell_forces(field, pad, mask=cell.mask, size=cell.mask.shape[::-1], method=method, uncertainty=EXACT)
    seconds = time.process_time() - start
    out: dict[str, Any] = {"seconds": seconds, "seed": cell.seed, "edge": cell.edge, "noise": cell.noise}
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


def population(first: int, count: int, methods: list[str], held: Path | None) -> list[str]:
    """Rows of the main table: all, and parts of it."""
    lines = []
    for method in methods:
        path = None if held is None else held.with_name(f"{held.stem}-{method}.json")
        found = json.loads(path.read_text()) if path is not None and path.exists() else []
        for seed in range(first, first + count):
            if any(f["seed"] == seed for f in found):
                continue
            found.append(judged(cell_of(seed), method))
            if path is not None:  # a long run may be stopped, and goes on where it was
                path.write_text(json.dumps(found))
            print(
                method,
                seed,
                {k: f"{found[-1][k][0] / found[-1][k][3]:.2f}" for k in KEYS[:4]},
                file=sys.stderr,
                flush=True,
            )
        found = [f for f in found if first <= f["seed"] < first + count]
        lines.append(f"| all | {method} | {len(found)} | {' | '.join(summary(found))} |")
        for name, part in (
            ("noise above 10 %", [f for f in found if f["noise"] > 0.1]),
            ("at the edge", [f for f in found if f["edge"]]),
        ):
            if part:
                lines.append(f"| {name} | {method} | {len(part)} | {' | '.join(summary(part))} |")
    return lines


def special(first: int, count: int, methods: list[str]) -> list[str]:
    """Outliers, and weak cells, on the same cells."""
    lines = []
    for name, options in (
        ("noise of 5 %, no outliers", {"noise": 0.05, "outliers": False, "edge": False}),
        ("noise of 5 %, 3 % outliers", {"noise": 0.05, "outliers": True, "edge": False}),
        ("noise of 20 %", {"noise": 0.2, "outliers": False, "edge": False}),
    ):
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


def times(sides: list[int]) -> list[str]:
    """Processor time and memory by size."""
    lines = []
    for side in sides:
        step = max(2, 16 * 20 // side * 2)
        cell = cell_of(1000, step=min(step, 8), count=side, noise=0.05, outliers=False, edge=False, window=0)
        row = judged(cell, "adhesions")
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        lines.append(f"| {side} x {side} | {row['seconds']:.1f} | {memory:.2f} |")
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=60)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--methods", nargs="+", default=["tikhonov", "adhesions"])
    parser.add_argument("--rows", nargs="+", default=["population", "special", "crop", "times"])
    parser.add_argument("--special", type=int, default=12, help="cells of the rows of one kind")
    parser.add_argument("--sides", type=int, nargs="+", default=[64, 128, 256])
    parser.add_argument(
        "--keep",
        type=Path,
        help="where the numbers of each cell are written as they come (.json): a run that was stopped goes on",
    )
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    head = f"| cells | method | count | {' | '.join(NAMES)} | seconds |"
    rule = "|---" * (4 + len(NAMES)) + "|"
    said = f"--first {args.first} --cells {args.cells} --methods {' '.join(args.methods)} --rows {' '.join(args.rows)}"
    lines = [f"Made by `python benchmarks/cells.py {said}`.", ""]
    if "population" in args.rows or "special" in args.rows:
        lines += [head, rule]
    if "population" in args.rows:
        lines += population(args.first, args.cells, args.methods, args.keep)
    if "special" in args.rows:
        lines += special(args.first, args.special, args.methods)
    if "crop" in args.rows:
        lines += ["", "| method | cells | energy, whole field | energy, its middle | agree |", "|---|---|---|---|---|"]
        lines += crop(args.first, args.special, args.methods)
    if "times" in args.rows:
        lines += ["", "| vectors | processor time [s] | memory at most [GB] |", "|---|---|---|", *times(args.sides)]
    print("\n".join(lines))
    if args.markdown is not None:
        args.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
