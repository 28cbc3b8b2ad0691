"""Cells rendered as pictures of beads, with closed-form truth (`cells_population.displacement_of`): numbers of `palpate tfm` as parts of the truth, and how often its intervals hold it.

Pictures are 256 pixels square, 0.1 um a pixel: 4 to 8 elliptic adhesions of 1.2 to 4 um, beads of 1.2 pixels, photon noise, a drift of some pixels. Each pair is followed with windows of
16, 24 and 32 pixels, every half window.

    python benchmarks/cells_pictures.py --markdown docs/_generated/cells_pictures.md      # minutes
    python benchmarks/cells_pictures.py --cells 4 --windows 32
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.ndimage

sys.path.insert(0, str(Path(__file__).parent))
from cells_population import SQUARE, displacement_of
from tfm_images import DENSITY, picture

import palpate as pp
from palpate.microscopy import Field, bead_displacements, cell_forces
from palpate.sensing.uncertainty import EXACT

SIDE = 256
MODULUS, RATIO = 8e3, 0.48
KEYS = ("strain_energy", "contractile_moment", "contractility", "traction_peak", "net_force_x", "net_force_y")
NAMES = ("energy", "moment", "contractility", "peak", "net force x", "net force y")


def traction_of(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Traction (2, row, column) [Pa] on the pixels, in balance, and the cell's mask."""
    axis = SQUARE * (np.arange(SIDE) - 0.5 * (SIDE - 1))
    x, y = axis[None, :], axis[:, None]
    out, on = np.zeros((2, SIDE, SIDE)), np.zeros((SIDE, SIDE), dtype=bool)
    count, pull = int(rng.integers(4, 9)), float(np.exp(rng.uniform(math.log(400.0), math.log(2000.0))))
    for angle in 2 * np.pi * (np.arange(count) + 0.5 * rng.random(count)) / count:
        along = x * np.cos(angle) + y * np.sin(angle) - rng.uniform(4.5e-6, 7.5e-6)
        across = -x * np.sin(angle) + y * np.cos(angle)
        inside = (along / rng.uniform(0.6e-6, 2e-6)) ** 2 + (across / rng.uniform(0.6e-6, 1.4e-6)) ** 2
        profile = (inside < 1).astype(float) if rng.random() < 0.5 else np.sqrt(np.clip(1.0 - inside, 0.0, None))
        size = pull * float(rng.uniform(0.3, 1.0))
        out -= size * profile * np.array([np.cos(angle), np.sin(angle)])[:, None, None]
        on |= inside < 1
    for c in (0, 1):
        out[c][on] -= out[c].sum() / on.sum()
    return out, np.hypot(x, y) < 10e-6


def pair_of(seed: int) -> dict[str, Any]:
    """Pictures at rest and pulled, traction, mask and displacement of one cell."""
    rng = np.random.default_rng((seed, 77))
    traction, mask = traction_of(rng)
    u = displacement_of(traction, MODULUS, RATIO)
    beads = int(DENSITY * (SIDE + 40) ** 2)
    places, light = rng.uniform(-20, SIDE + 20, (beads, 2)), rng.uniform(0.3, 1.0, beads)
    moved = np.stack([scipy.ndimage.map_coordinates(c, places[:, ::-1].T, order=3, mode="nearest") for c in u], axis=1)
    drift = rng.uniform(-3, 3, 2)
    pair = [picture(p, light, SIDE, rng) for p in (places, places + moved / SQUARE + drift)]
    return {"pair": pair, "traction": traction, "mask": mask, "moved": u}


def truth_of(scene: dict[str, Any], field: Field) -> dict[str, float]:
    """The numbers of the cell; the largest traction is that of means over the vectors' squares, as `cell_forces` says it."""
    t, u = scene["traction"], scene["moved"]
    area = SQUARE**2
    axis = np.arange(SIDE) * SQUARE
    x, y = np.meshgrid(axis, axis)
    table = np.pad(np.cumsum(np.cumsum(t, axis=1), axis=2), ((0, 0), (1, 0), (1, 0)))
    half = 0.5 * field.step
    rows, columns = (
        np.rint(np.array([s + field.step * np.arange(n) - half, s + field.step * np.arange(n) + half]) + 0.5).astype(
            int
        )
        for s, n in zip(field.start[::-1], field.shape)
    )
    (top, low), (left, right) = rows, columns
    blocks = (
        table[:, low[:, None], right]
        - table[:, top[:, None], right]
        - table[:, low[:, None], left]
        + table[:, top[:, None], left]
    ) / field.step**2
    # the point nearest to the lines of force, weighted by the squares of the forces on the vectors' squares
    bx, by = field.pitch * np.arange(field.shape[1]), field.pitch * np.arange(field.shape[0])
    gx, gy = np.meshgrid(bx + field.start[0] * SQUARE, by + field.start[1] * SQUARE)
    lever = blocks[0] * gy - blocks[1] * gx
    cross = -(blocks[0] * blocks[1]).sum()
    matrix = np.array([[(blocks[1] ** 2).sum(), cross], [cross, (blocks[0] ** 2).sum()]])
    center = np.linalg.solve(matrix, [-(blocks[1] * lever).sum(), (blocks[0] * lever).sum()])
    far = np.hypot(x - center[0], y - center[1]) + 1e-30
    whole = u - u.mean(axis=(1, 2), keepdims=True)
    return {
        "strain_energy": 0.5 * float((t * whole).sum()) * area,
        "contractile_moment": -float((t[0] * x + t[1] * y).sum()) * area,
        "contractility": -float(((t[0] * (x - center[0]) + t[1] * (y - center[1])) / far).sum()) * area,
        "traction_peak": float(np.hypot(*blocks).max()),
        "net_force_x": float(t[0].sum()) * area,
        "net_force_y": float(t[1].sum()) * area,
    }


def judged(seed: int, window: int) -> dict[str, Any]:
    """Value, ends and truth of each number."""
    scene = pair_of(seed)
    field = bead_displacements(*scene["pair"], pixel=SQUARE, window=window)
    start = time.process_time()
    pad = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=RATIO)
    forces = cell_forces(field, pad, mask=scene["mask"], size=(SIDE, SIDE), uncertainty=EXACT)
    true = truth_of(scene, field)
    out: dict[str, Any] = {k: (forces[k].value, *forces[k].interval, true[k]) for k in KEYS}
    out["seconds"] = time.process_time() - start
    out["notes"] = forces.notes
    return out


def row(label: str, found: list[dict[str, Any]]) -> str:
    """Median ratio with its tenth and ninetieth centile, and coverage."""
    cells = []
    for key in KEYS:
        values = np.array([f[key] for f in found])
        held = float(np.mean((values[:, 1] <= values[:, 3]) & (values[:, 3] <= values[:, 2])))
        if key.startswith("net"):
            cells.append(f"{held:.2f}")
            continue
        low, middle, high = np.quantile(values[:, 0] / values[:, 3], (0.1, 0.5, 0.9))
        cells.append(f"{middle:.2f} ({low:.2f} to {high:.2f}), {held:.2f}")
    seconds = float(np.median([f["seconds"] for f in found]))
    return f"| {label} | {len(found)} | " + " | ".join(cells) + f" | {seconds:.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--cells", type=int, default=10)
    parser.add_argument("--windows", type=int, nargs="+", default=[16, 24, 32])
    parser.add_argument("--markdown", type=Path)
    given = parser.parse_args()
    lines = [
        "| window | cells | " + " | ".join(NAMES) + " | time [s] |",
        "|---|---|" + "---|" * len(NAMES) + "---|",
    ]
    for window in given.windows:
        found = []
        for seed in range(given.first, given.first + given.cells):
            found.append(judged(seed, window))
            ratios = {k: [round(v / found[-1][k][3], 2) for v in found[-1][k][:3]] for k in KEYS[:4]}
            print(window, seed, ratios, flush=True)
        lines.append(row(f"{window} px", found))
        print(lines[-1], flush=True)
    if given.markdown is not None:
        given.markdown.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
