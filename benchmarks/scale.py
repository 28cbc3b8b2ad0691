"""Preparation, a frame, a batch and memory of the linear method from 8 x 8 taxels to a camera's image, and how they grow; the same of the
automatic method, and of every method there is on small and middling arrays.

    python benchmarks/scale.py [--automatic | --methods] [--large] [--only NAME ...] [--write]

Processor seconds of one thread (set OMP_NUM_THREADS=1), each layout in a process of its own, so that its peak of memory is its own. The first frame
includes what is prepared when it is first needed. ``--large`` adds 480 x 640; ``--write`` writes docs/_generated/scale.md, with ``--automatic``
docs/_generated/scale_automatic.md, with ``--methods`` docs/_generated/scale_methods.md.
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
import speed

import palpate as pp
from palpate.sensing.uncertainty import EXACT

STRESS, SHIFT = ["stress_xz", "stress_yz", "stress_zz"], ["displacement_x", "displacement_y"]
TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "scale.md"
AUTOMATIC, METHODS = TABLE.with_name("scale_automatic.md"), TABLE.with_name("scale_methods.md")
PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
#: One layer on a rigid base, for the layouts that say so.
LAYER = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
BONDED = ", a layer"
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
    **{f"{n} x {n} x 3": (lambda n=n: area(n, n, channels=STRESS)) for n in (8, 16, 32, 64, 128, 256)},
    **{f"{n} x {n} x 2": (lambda n=n: area(n, n, channels=SHIFT)) for n in (32, 64, 128, 256)},
    **{f"{n} x {n} x 3{BONDED}": (lambda n=n: area(n, n, channels=STRESS)) for n in (32, 64, 128)},
    **{f"{n} x {n} x 2{BONDED}": (lambda n=n: area(n, n, channels=SHIFT)) for n in (32, 64, 128, 256)},
    **{f"line of {n} x 2": (lambda n=n: line(n)) for n in (121, 1000, 3000, 10_000)},
    **{f"{n} beads x 2": (lambda n=n: beads(n)) for n in (500, 1000, 2601, 5000, 10_000, 20_000)},
}
LARGE = {
    "480 x 640 x 2": lambda: area(480, 640, channels=SHIFT),
    f"480 x 640 x 2{BONDED}": lambda: area(480, 640, channels=SHIFT),
}
#: Layouts that one exponent is fitted to, by their readings.
FAMILIES = {
    "stress, 32 to 256": [f"{n} x {n} x 3" for n in (32, 64, 128, 256)],
    "displacement, 32 to 256": [f"{n} x {n} x 2" for n in (32, 64, 128, 256)],
    "stress on a layer, 32 to 128": [f"{n} x {n} x 3{BONDED}" for n in (32, 64, 128)],
    "displacement on a layer, 32 to 256": [f"{n} x {n} x 2{BONDED}" for n in (32, 64, 128, 256)],
    "lines, 121 to 10,000": [f"line of {n} x 2" for n in (121, 1000, 3000, 10_000)],
    "beads, 2601 to 20,000": [f"{n} beads x 2" for n in (2601, 5000, 10_000, 20_000)],
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
    skin = pp.Skin(LAYER if name.endswith(BONDED) else PAD, {**LAYOUTS, **LARGE}[name]())
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
    second = time.process_time()
    skin.reconstruct(many[2], method="tikhonov")
    warm = time.process_time()
    frame = min(second - first, warm - second)
    count = max(1, min(BATCH, int(LONGEST / max(frame, 1e-4))))
    batch = skin.reconstruct(many[:count], method="tikhonov")
    each = (time.process_time() - warm) / count
    _ = touch._errors.posterior.force  # type: ignore[union-attr]
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


SHIFTS = ["displacement_x", "displacement_y", "displacement_z"]
#: Layouts of the automatic method: a ball over 15 % of the array's side and a smaller one beside it, both dragged, 2 % noise.
TOUCHED: dict[str, Any] = {
    **{f"{n} x {n} x 3": (lambda n=n: area(n, n, channels=STRESS)) for n in (8, 16, 32, 64, 128)},
    **{
        f"{n} x {n} x 3, displacement": (
            lambda n=n: pp.AreaArray(shape=(n, n), pitch=1e-3, depth=1e-3, channels=SHIFTS)
        )
        for n in (64,)
    },
}


def touched(skin: pp.Skin, n: int) -> Any:
    """Two balls, with shear in proportion."""
    grid = skin.surface
    y, x = np.meshgrid(*grid.axes, indexing="ij")
    out = np.zeros((3, *grid.shape))
    for radius, x0, y0, shear in ((0.15, 0.12, 0.05, 0.3), (0.08, -0.22, -0.15, -0.2)):
        r2 = ((x - 1e-3 * n * x0) ** 2 + (y - 1e-3 * n * y0) ** 2) / (1e-3 * n * radius) ** 2
        pressure = 1000.0 * np.sqrt(np.maximum(1.0 - r2, 0.0))
        out[0] += shear * pressure
        out[2] += pressure
    return out


def measure_automatic(name: str) -> dict[str, Any]:
    """Times, memory and errors of the automatic method on one layout."""
    skin = pp.Skin(PAD, TOUCHED[name](), uncertainty=EXACT)
    traction = touched(skin, skin.planes[0].shape[0])
    readings = skin.sense(traction)
    noise = 0.02 * np.abs(readings).max()
    many = readings + noise * np.random.default_rng(0).standard_normal((3, *readings.shape))
    begun = time.process_time()
    pp.Automatic().prepare(skin.problem())
    prepared = time.process_time()
    skin.reconstruct(many[0])
    first = time.process_time()
    touch = skin.reconstruct(many[1])
    warm = time.process_time()
    last = skin.reconstruct(many[2])
    again = time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    other = skin.reconstruct(many[1], method="tikhonov")
    size = np.linalg.norm(traction)
    force = traction.reshape(3, -1).sum(axis=1) * skin.surface.cell
    _bars(last)  # what the first one of all loads
    asked = time.process_time()
    _bars(touch)
    bars = time.process_time()
    low, high = touch.interval(0.95, "force")
    return {
        "name": name,
        "readings": int(readings.size),
        "prepare": prepared - begun,
        "first": first - prepared,
        "frame": min(warm - first, again - warm),
        "bars": bars - asked,
        "memory": memory,
        "error": float(np.linalg.norm(np.asarray(touch.traction) - traction) / size),
        "linear": float(np.linalg.norm(np.asarray(other.traction) - traction) / size),
        "noise": float(np.mean(np.asarray(touch.noise_std)) / noise),
        "inside": int(((low <= force) & (force <= high)).sum()),
        "solved": bool(np.asarray(touch.status) == 0),
    }


def _bars(touch: Any) -> Any:
    """Error bars of cells and numbers."""
    return touch.std(), [touch.interval(0.95, of) for of in ("force", "moment", "center_of_pressure")]


def table_automatic(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| layout | readings | prepare [s] | first frame [s] | frame [s] | error bars, if asked for [s] | memory [GB] | error | of tikhonov | estimated noise / true | forces within 95 % |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        lines.append(
            f"| {r['name']} | {r['readings']} | {r['prepare']:.2f} | {r['first']:.2f} | {r['frame']:.2f} | {r['bars']:.2f} | {r['memory']:.2f} | {r['error']:.3f} | "
            f"{r['linear']:.3f} | {r['noise']:.3f} | {r['inside']} of 3{'' if r['solved'] else ' (not solved)'} |"
        )
    known = {r["name"]: r for r in rows}
    some = [known[n] for n in ("32 x 32 x 3", "64 x 64 x 3", "128 x 128 x 3") if n in known]
    if len(some) > 1:
        slope = np.polyfit(np.log([r["readings"] for r in some]), np.log([r["frame"] for r in some]), 1)[0]
        ends = f"{some[0]['name']} to {some[-1]['name']}"
        lines += [
            "",
            f"Frame time of stress, {ends}, is proportional to the number of readings to the power {slope:.2f}.",
        ]
    return "\n".join(lines) + "\n"


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| layout | readings | prepare [s] | first frame [s] | frame [s] | in a batch [s] | force and its error [s] | memory [GB] | error | estimated noise / true |",
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
            lines.append(f"Frame time of {family} is proportional to the number of readings to the power {slope:.2f}.")
    return "\n".join(lines) + "\n"


#: Sides of the arrays of every method.
SIDES = (8, 16, 32, 64)


def measure_method(name: str) -> dict[str, Any]:
    """Times and memory of one method on one array, or that it is refused."""
    n, method = int(name.split(" x ")[0]), name.split(": ", 1)[1]
    skin, frames = speed.pressed(n, BATCH, noise=method == "wiener")
    options = speed.METHODS[method]
    try:
        start = time.process_time()
        skin.prepare(**options)
        prepared = time.process_time()
        skin.reconstruct(frames[0], **options)
        first = time.process_time()
        each, frame = 0.0, first - prepared
        if frame < LONGEST:
            skin.reconstruct(frames[1], **options)
            frame = time.process_time() - first
        count = max(1, min(BATCH, int(LONGEST / max(frame, 1e-4))))
        begun = time.process_time()
        touch = skin.reconstruct(frames[:count], **options)
        each = (time.process_time() - begun) / count
    except pp.Unsupported as error:
        return {"name": name, "n": n, "method": method, "refused": str(error)}
    return {
        "name": name,
        "n": n,
        "method": method,
        "prepare": prepared - start,
        "frame": frame,
        "batch": each,
        "count": count,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        # the paper's methods say nothing of their frames
        "solved": count if touch.status is None else int((np.asarray(touch.status) == 0).sum()),
    }


def table_methods(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| array | method | prepare [s] | frame [s] | in a batch [s] | of frames | memory [GB] | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        start = f"| {r['n']} x {r['n']} x 3 | {r['method']} |"
        if "refused" in r:
            lines.append(f"{start} | | | | | refused: {r['refused'].split('. ')[0]} |")
            continue
        short = "" if r["solved"] == r["count"] else f"solved: {r['solved']}"
        lines.append(
            f"{start} {r['prepare']:.2f} | {r['frame']:.4f} | {r['batch']:.4f} | {r['count']} | {r['memory']:.2f} | {short} |"
        )
    known = {(r["method"], r["n"]): r for r in rows if "refused" not in r}
    grows = []
    for method in speed.METHODS:
        some = [known[method, n] for n in SIDES[1:] if (method, n) in known]
        if len(some) > 1:
            slope = np.polyfit(np.log([3 * r["n"] ** 2 for r in some]), np.log([r["frame"] for r in some]), 1)[0]
            grows.append(f"{method} {slope:.2f} (to {some[-1]['n']})")
    if grows:
        lines += [
            "",
            f"The time of a frame is proportional to a power of the number of readings, from {SIDES[1]} x {SIDES[1]} on: {'; '.join(grows)}.",
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--automatic", action="store_true", help="the automatic method rather than the linear one")
    parser.add_argument("--methods", action="store_true", help="every method on areas of 8 to 64")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    mode, said, measured, names = [], table, measure, [*LAYOUTS, *(LARGE if given.large else {})]
    if given.automatic:
        mode, said, measured, names = ["--automatic"], table_automatic, measure_automatic, list(TOUCHED)
    elif given.methods:
        names = [f"{n} x {n} x 3: {m}" for n in SIDES for m in speed.METHODS]
        mode, said, measured = ["--methods"], table_methods, measure_method
    if given.one:
        print(json.dumps(measured(given.one)))
        return
    rows = []
    for name in given.only or names:
        done = subprocess.run([sys.executable, __file__, *mode, "--one", name], capture_output=True, text=True)
        if done.returncode:
            print(f"{name}: {done.stderr.strip().splitlines()[-1]}", flush=True)
            continue
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        print(said(rows).splitlines()[1 + len(rows)], flush=True)
    print(said(rows))
    if given.write and given.automatic:
        AUTOMATIC.write_text(
            "Written by `benchmarks/scale.py --automatic`: processor seconds of one thread, the default method, two balls that are dragged, "
            "2 % noise.\n\n" + said(rows),
            encoding="utf-8",
        )
    elif given.write and given.methods:
        METHODS.write_text(
            "Written by `benchmarks/scale.py --methods`: processor seconds of one thread, a ball of 4 mm and 0.5 N that slides, 1 % noise.\n\n"
            + said(rows),
            encoding="utf-8",
        )
    elif given.write:
        heading = '# Size\n\nWritten by `benchmarks/scale.py`: processor seconds of one thread, `method="tikhonov"`, evidence.\n\n'
        TABLE.write_text(heading + table(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
