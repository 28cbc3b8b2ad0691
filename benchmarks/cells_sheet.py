"""Monolayers whose tension is known: chosen, not computed by finite elements. Error and coverage of `sheet_tension`.

A sheet is a smooth star; its tension is N = b S + Airy(b^2 chi): S a random smooth tensor field, b a bell that vanishes at the edge with its slope, and a stress function, whose part
leaves no traction at all. T = div N by differences on squares of 1 um; the gel moves by Cerruti's solution in closed form (`cells_population.displacement_of`), and 20 nm of noise are added.

    python benchmarks/cells_sheet.py --markdown docs/_generated/cells_sheet.md       # fresh sheets, minutes
    python benchmarks/cells_sheet.py --first 0 --sheets 10
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.ndimage

sys.path.insert(0, str(Path(__file__).parent))
from cells_population import displacement_of

import palpate as pp
from palpate.microscopy import Field, cell_forces, sheet_tension
from palpate.sensing.uncertainty import EXACT

#: Side of a square [m], squares of a field, squares between vectors, noise [m], gel, and typical tension [N/m].
SQUARE, SIDE, STEP, NOISE = 1e-6, 200, 5, 20e-9
MODULUS, RATIO, TENSION = 5e3, 0.48, 2e-3


def smooth(rng: np.random.Generator, size: int, length: float) -> np.ndarray:
    """A random field of unit variance, smooth over a length [squares]."""
    field = scipy.ndimage.gaussian_filter(rng.standard_normal((size, size)), length, mode="wrap")
    return (field - field.mean()) / field.std()


def sheet_of(seed: int, *, cut: bool = False) -> dict[str, Any]:
    """Tension (3: xx, yy, xy; row, column), traction, mask, cells and displacement of one sheet; with ``cut`` the view holds its right half alone."""
    rng = np.random.default_rng((seed, 4304))
    axis = np.arange(SIDE) - 0.5 * (SIDE - 1)
    x, y = np.meshgrid(axis, axis)
    angle = np.arctan2(y, x)
    radius = rng.uniform(55, 75) * (
        1 + 0.1 * rng.standard_normal() * np.cos(2 * angle + rng.uniform(0, 6)) + 0.06 * rng.standard_normal() * np.cos(3 * angle + rng.uniform(0, 6))
    )  # fmt: skip
    rho = np.hypot(x, y) / radius
    mask = rho < 1
    bell = np.clip(1 - rho**4, 0, None) ** 2
    length = rng.uniform(12, 25)
    # as uneven as nobody knows: parts of the mean tension
    uneven, directed, unseen = rng.uniform(0.05, 0.35), rng.uniform(0.05, 0.3), rng.uniform(0.0, 0.3)
    isotropic = 1.0 + uneven * smooth(rng, SIDE, length)
    along, across = directed * smooth(rng, SIDE, length), directed * smooth(rng, SIDE, length)
    chi = bell**2 * smooth(rng, SIDE, length)
    gy, gx = np.gradient(chi)
    airy = np.stack([np.gradient(gy)[0], np.gradient(gx)[1], -np.gradient(gy)[1]])
    airy *= unseen / airy[:, mask].std()
    tension = TENSION * (bell * np.stack([isotropic + along, isotropic - along, across]) + airy)
    traction = np.stack([
        np.gradient(tension[0], axis=1) + np.gradient(tension[2], axis=0),
        np.gradient(tension[2], axis=1) + np.gradient(tension[1], axis=0),
    ]) / SQUARE  # fmt: skip
    u = displacement_of(traction, MODULUS, RATIO, SQUARE)
    seeds = rng.uniform(-80, 80, (60, 2))
    near = np.hypot(x[..., None] - seeds[:, 0], y[..., None] - seeds[:, 1]).argmin(axis=-1)
    cells = np.where(mask, near + 1, 0)
    at = STEP // 2 + STEP * np.arange(SIDE // STEP)
    seen = scipy.ndimage.uniform_filter(u, (0, STEP, STEP))[:, at[:, None], at]
    seen = seen + NOISE * rng.standard_normal(seen.shape)
    left = SIDE // 2 if cut else 0
    first = left // STEP
    field = Field(displacement=seen[:, :, first:], start=(float(STEP // 2), float(STEP // 2)), step=float(STEP), pixel=SQUARE, aperture=STEP * SQUARE)  # fmt: skip
    return {
        "tension": tension[:, :, left:],
        "traction": traction[:, :, left:],
        "mask": mask[:, left:],
        "cells": cells[:, left:],
        "field": field,
    }


def judged(seed: int, *, cut: bool = False, **options: Any) -> dict[str, Any]:
    """Errors, and whether intervals hold the truth, of one sheet."""
    scene = sheet_of(seed, cut=cut)
    field, mask = scene["field"], scene["mask"]
    start = time.process_time()
    size = mask.shape[::-1]
    gel = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=RATIO)
    forces = cell_forces(field, gel, mask=mask, size=size, method="tikhonov", uncertainty=EXACT)
    # cells that are almost all out of view tell nothing
    labels = {str(k): scene["cells"] == k for k in np.unique(scene["cells"]) if k and (scene["cells"] == k).sum() > 60}
    sheet = sheet_tension(forces, labels=labels, size=size, **options)
    seconds = time.process_time() - start
    rows, columns = field.shape
    n = scene["tension"]
    blocks = n.reshape(3, rows, STEP, columns, STEP).mean(axis=(2, 4))
    share = mask.reshape(rows, STEP, columns, STEP).mean(axis=(1, 3))
    on = (share > 0.99) & sheet.inside
    true_average = 0.5 * (blocks[0] + blocks[1])
    std = np.sqrt(0.25 * (sheet.draws[:, 0] + sheet.draws[:, 1]).var(axis=0, ddof=1))
    off = sheet.average - true_average
    out: dict[str, Any] = {
        "error": float(np.sqrt((off[on] ** 2).mean() / (true_average[on] ** 2).mean())),
        "covered": float((np.abs(off) < 1.96 * std)[on].mean()),
    }
    mean = 0.5 * float((n[0] + n[1])[mask].mean())
    q = sheet["average_tension"]
    out["mean"] = (q.value, *q.interval, mean)
    largest = 0.5 * (blocks[0] + blocks[1]) + np.hypot(0.5 * (blocks[0] - blocks[1]), blocks[2])
    q = sheet["largest_tension"]
    out["largest"] = (q.value, *q.interval, float(largest[share > 0].max()))
    out["cells"] = [
        (q.value, *q.interval, truth)
        for cell in sheet.cells
        for q, truth in zip((cell.average, cell.largest), _of_cell(n, labels[cell.label]))
    ]
    out["seconds"] = seconds
    return out


def _of_cell(n: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    xx, yy, xy = n[:, mask].mean(axis=1)
    return 0.5 * (xx + yy), 0.5 * (xx + yy) + float(np.hypot(0.5 * (xx - yy), xy))


def row(label: str, found: list[dict[str, Any]]) -> str:
    cells = [f"{np.median([f['error'] for f in found]):.2f}", f"{np.mean([f['covered'] for f in found]):.2f}"]
    for key in ("mean", "largest"):
        v = np.array([f[key] for f in found])
        low, middle, high = np.quantile(v[:, 0] / v[:, 3], (0.1, 0.5, 0.9))
        cells.append(
            f"{middle:.2f} ({low:.2f} to {high:.2f}), {np.mean((v[:, 1] <= v[:, 3]) & (v[:, 3] <= v[:, 2])):.2f}"
        )
    for part in (0, 1):
        v = np.array([c for f in found for c in f["cells"][part::2]])
        error = float(np.sqrt(((v[:, 0] - v[:, 3]) ** 2).mean() / (v[:, 3] ** 2).mean()))
        cells.append(f"{error:.2f}, {np.mean((v[:, 1] <= v[:, 3]) & (v[:, 3] <= v[:, 2])):.2f}")
    cells.append(f"{np.median([f['seconds'] for f in found]):.1f}")
    return f"| {label} | {len(found)} | " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--sheets", type=int, default=20)
    parser.add_argument("--markdown", type=Path)
    given = parser.parse_args()
    lines = [
        "| sheet | count | map: error | map: covered | mean of the sheet | largest | cells' average: error, covered | cells' largest: error, covered | time [s] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, cut in (("whole in view", False), ("right half in view", True)):
        found = [judged(seed, cut=cut) for seed in range(given.first, given.first + given.sheets)]
        lines.append(row(label, found))
        print(lines[-1], flush=True)
    if given.markdown is not None:
        given.markdown.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
