"""Preparation, a frame, a batch and memory of the linear method from 8 x 8 taxels to a camera's image, and how they grow.

    python benchmarks/scale.py [--large] [--only NAME ...] [--write]

Processor seconds of one thread (set OMP_NUM_THREADS=1), each layout in a process of its own, so that its peak of memory is its own. The first frame
includes what is prepared when it is first needed. ``--large`` adds 480 x 640; ``--write`` writes docs/_generated/scale.md.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp

STRESS, SHIFT = ["stress_xz", "stress_yz", "stress_zz"], ["displacement_x", "displacement_y"]
TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "scale.md"
#: Frames of a batch, and the processor seconds that a batch may take: larger frames come in fewer.
BATCH, LONGEST = 50, 8.0


def area(*shape: int, channels: list[str]) -> pp.AreaArray:
    stress = channels is STRESS
    return pp.AreaArray(shape=shape, pitch=1e-3, depth=2e-3 if stress else 0.0, channels=channels)


def line(n: int) -> pp.LineArray:
    return pp.LineArray(count=n, pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_zz"])


def beads(n: int) -> pp.ScatteredArray:
    positions = np.random.default_rng(0).uniform(0.0, 1e-3 * math.sqrt(n), (n, 2))
    return pp.ScatteredArray(positions=positions, depth=0.0, channels=SHIFT)


LAYOUTS: dict[str, Any] = {
    **{f"{n} x {n} x 3": (lambda n=n: area(n, n, channels=STRESS)) for n in (8, 16, 32, 64, 128)},
    **{f"{n} x {n} x 2": (lambda n=n: area(n, n, channels=SHIFT)) for n in (32, 64, 128, 256)},
    **{f"line of {n} x 2": (lambda n=n: line(n)) for n in (121, 1000, 10_000)},
    **{f"{n} beads x 2": (lambda n=n: beads(n)) for n in (500, 2601, 20_000)},
}
LARGE = {"480 x 640 x 2": lambda: area(480, 640, channels=SHIFT)}
#: Layouts that one exponent is fitted to, by their readings.
FAMILIES = {
    "stress, 32 to 128": ["32 x 32 x 3", "64 x 64 x 3", "128 x 128 x 3"],
    "displacement, 64 to 256": ["64 x 64 x 2", "128 x 128 x 2", "256 x 256 x 2"],
    "beads, 2601 to 20,000": ["2601 beads x 2", "20000 beads x 2"],
}


def pressed(skin: pp.Skin) -> Any:
    """Some bumps of traction in the components sought."""
    grid, rng = skin.surface, np.random.default_rng(0)
    places = np.meshgrid(*grid.axes, indexing="ij")
    reach = [float(np.ptp(x)) for x in grid.axes]
    middle = [float(x.mean()) for x in grid.axes]
    traction = np.zeros((len(grid.components), *grid.shape))
    for _ in range(5):
        at = [m + 0.3 * r * rng.uniform(-1, 1) for m, r in zip(middle, reach)]
        bump = np.exp(-sum(((p - a) / (0.06 * max(reach))) ** 2 for p, a in zip(places, at)))
        for c in skin.components:
            traction[grid.components.index(c)] += rng.normal(1000.0 if c == "z" else 0.0, 200.0) * bump
    return traction


def measure(name: str) -> dict[str, Any]:
    """Times and memory of one layout."""
    start = time.process_time()
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), {**LAYOUTS, **LARGE}[name]())
    traction = pressed(skin)
    readings = skin.sense(traction)
    noise = 0.02 * np.abs(readings).max()
    many = readings + noise * np.random.default_rng(0).standard_normal((BATCH, *readings.shape))
    begun = time.process_time()
    pp.Tikhonov().prepare(skin.problem())
    prepared = time.process_time()
    touch = skin.reconstruct(many[0], method="tikhonov")
    first = time.process_time()
    skin.reconstruct(many[1], method="tikhonov")
    warm = time.process_time()
    frame = warm - first
    count = max(1, min(BATCH, int(LONGEST / max(frame, 1e-4))))
    batch = skin.reconstruct(many[:count], method="tikhonov")
    each = (time.process_time() - warm) / count
    _ = touch.errors.force  # type: ignore[union-attr]
    numbers = time.process_time()
    error = np.linalg.norm(np.asarray(touch.traction) - traction) / np.linalg.norm(traction)
    return {
        "name": name,
        "readings": int(readings.size),
        "cells": int(math.prod(skin.surface.shape)),
        "map": begun - start,
        "prepare": prepared - begun,
        "first": first - prepared,
        "frame": frame,
        "batch": each,
        "numbers": numbers - warm - each * count,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "error": float(error),
        "noise": float(np.mean(np.asarray(touch.noise_std)) / noise),
        "solved": bool((np.asarray(batch.status) == 0).all()),
    }


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| layout | readings | prepare [s] | first frame [s] | frame [s] | in a batch [s] | force and its error [s] | memory [GB] | error | noise found |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        lines.append(
            f"| {r['name']} | {r['readings']} | {r['prepare']:.2f} | {r['first']:.2f} | {r['frame']:.3f} | {r['batch']:.3f} | "
            f"{r['numbers']:.2f} | {r['memory']:.2f} | {r['error']:.3f} | {r['noise']:.3f}{'' if r['solved'] else ' (not solved)'} |"
        )
    lines.append("")
    known = {r["name"]: r for r in rows}
    for family, names in FAMILIES.items():
        some = [known[n] for n in names if n in known]
        if len(some) > 1:
            slope = np.polyfit(np.log([r["readings"] for r in some]), np.log([r["frame"] for r in some]), 1)[0]
            lines.append(f"Frame time of {family} grows with the readings to the power {slope:.2f}.")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(given.one)))
        return
    names = given.only or [*LAYOUTS, *(LARGE if given.large else {})]
    rows = []
    for name in names:
        done = subprocess.run([sys.executable, __file__, "--one", name], capture_output=True, text=True)
        if done.returncode:
            print(f"{name}: {done.stderr.strip().splitlines()[-1]}", flush=True)
            continue
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        print(table(rows).splitlines()[1 + len(rows)], flush=True)
    print(table(rows))
    if given.write:
        heading = '# Size\n\nWritten by `benchmarks/scale.py`: processor seconds of one thread, `method="tikhonov"`, evidence.\n\n'
        TABLE.write_text(heading + table(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
