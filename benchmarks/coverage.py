"""Do the intervals hold the truth as often as they say, in every case that has constants of its own? On contacts that fixed none of them.

    python benchmarks/coverage.py [--frames 60] [--contact line] [--seed 999] [--method tikhonov]
    python benchmarks/coverage.py --size 128 [--frames 20] [--seed 999] [--write]

For each case: the share of true values inside the intervals of 50 and 95 %, and beside them the shares with the constants of stress taxels
on a half-space, which a case without its own uses.

``--size`` asks it of N x N taxels of three stresses instead, where nothing is formed (`at_size`); ``--write`` writes docs/_generated/coverage_at_size.md.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

import numpy as np

import palpate as pp
from palpate import bench
from palpate.sensing.uncertainty import EXACT
from palpate.uncertainty import Calibration, Case, constants

SENSING, BODIES = ("stress", "strain", "displacement"), ("half-space", "layers")


def shares(known: Calibration, z: list[np.ndarray]) -> tuple[float, float]:
    """Mean over frames of the part of standardised errors inside the intervals of 50 and 95 %."""
    zero, one, none = np.zeros(()), np.ones(()), np.asarray(-np.inf)
    ends = [known.bounds(level, zero, one, zero, none) for level in (0.5, 0.95)]
    half, most = (float(np.mean([np.mean((v >= low) & (v <= high)) for v in z])) for low, high in ends)
    return half, most


def at_size(n: int, frames: int, seed: int) -> str:
    """Parts of true values inside the intervals, and times: one to three balls and punches that slide or not on n x n taxels, 0.5 to 5 % noise."""
    array = pp.AreaArray(shape=(n, n), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array, uncertainty=EXACT)
    grid, side = skin.surface, 1e-3 * n
    found: dict[str, dict[float, list[float]]] = {}
    errors, seconds = [], []
    for k in range(frames):
        rng = np.random.default_rng((seed, k))
        truth, readings, force = np.zeros((3, *grid.shape)), np.zeros((3, n, n)), np.zeros(3)
        for _ in range(rng.integers(1, 4)):
            size = side * rng.uniform(0.04, 0.16)
            load = float(rng.uniform(0.3, 3.0))
            contact = (
                pp.solutions.hertz_point(contact_radius=size, force=load)
                if rng.random() < 0.7
                else pp.solutions.flat_punch(radius=size, force=load)
            )
            friction, way = float(rng.choice([0.0, rng.uniform(0.1, 0.8)])), 0.0
            if friction:
                way = float(rng.uniform(0.0, 2.0 * math.pi))
                contact = contact.sliding(friction, direction=way)
            contact = contact.shifted(*(rng.uniform(-0.3, 0.3, 2) * side))
            truth += contact.averages(*grid.axes[::-1])
            readings += np.asarray(skin.sense(contact))
            force += load * np.array([friction * math.cos(way), friction * math.sin(way), 1.0])
        noise = float(rng.uniform(0.005, 0.05)) * float(np.abs(readings).max())
        start = time.process_time()
        touch = skin.reconstruct(readings + noise * rng.standard_normal(readings.shape))
        seconds.append(time.process_time() - start)
        errors.append(float(np.linalg.norm(np.asarray(touch.values) - truth) / np.linalg.norm(truth)))
        touched = (np.abs(truth).sum(axis=0) > 0) | (np.abs(np.asarray(touch.values)).sum(axis=0) > 0)
        y, x = np.meshgrid(*grid.axes, indexing="ij")
        p = truth[2]
        center = np.array([(x * p).sum(), (y * p).sum()]) / p.sum()
        for level in (0.5, 0.95):
            for of, true in (
                ("force", force),
                ("center_of_pressure", center),
                ("peak_pressure", np.asarray(p.max())),
                ("traction", truth),
            ):
                low, high = (np.asarray(end) for end in touch.interval(level, of))
                inside = (low <= true) & (true <= high)
                part = float(inside[:, touched].mean() if of == "traction" else inside.mean())
                found.setdefault(of, {}).setdefault(level, []).append(part)
    lines = ["| quantity | inside 50 % | inside 95 % |", "|---|---|---|"]
    lines += [f"| {of} | {np.mean(found[of][0.5]):.2f} | {np.mean(found[of][0.95]):.2f} |" for of in found]
    lines += [
        "",
        f"{frames} frames; error of the traction {np.median(errors):.3f} (median); {np.median(seconds):.1f} s a frame, one thread.",
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--contact", choices=("line", "area", "area with shear"), default="line")
    parser.add_argument("--seed", type=int, default=999)
    parser.add_argument("--method", default="adaptive")
    parser.add_argument("--size", type=int, help="N x N taxels of three stresses instead")
    parser.add_argument("--write", action="store_true", help="with --size: docs/_generated/coverage_at_size.md")
    arguments = parser.parse_args()
    if arguments.size:
        table = at_size(arguments.size, arguments.frames, arguments.seed)
        how = (
            f"python benchmarks/coverage.py --size {arguments.size} --frames {arguments.frames} --seed {arguments.seed}"
        )
        print(table)
        if arguments.write:
            where = Path(__file__).parent.parent / "docs" / "_generated" / "coverage_at_size.md"
            where.write_text(
                f"Made by `{how}`: {arguments.size} x {arguments.size} taxels of three stresses on a half-space, default method, one to three balls "
                f"and punches that slide or not, noise of 0.5 to 5 %.\n\n{table}",
                encoding="utf-8",
            )
        return 0
    method = arguments.method
    said = f"--frames {arguments.frames} --contact '{arguments.contact}' --seed {arguments.seed} --method {method}"
    print(f"Made by `python benchmarks/coverage.py {said}`.\n")
    print("| case | quantity | 50 % | 95 % | 50 %, 95 % with the constants of stress |\n|---|---|---|---|---|")
    for sensing in SENSING:
        for body in BODIES:
            case = Case(arguments.contact, sensing, body)
            found: dict[str, list[np.ndarray]] = {}
            for i in range(arguments.frames):
                rng = np.random.default_rng((arguments.seed, i))
                layout, traction, noise = bench.population(rng, contact=arguments.contact, sensing=sensing, body=body)
                record = bench.run(layout, "random", traction, noise, rng, (method,), yardstick=False)[0]
                for quantity, z in record.z.items():
                    found.setdefault(quantity, []).append(z)
            own, plain = constants(method, case), constants(method, Case(arguments.contact))
            for quantity, z in found.items():
                half, most = shares(own.quantities[quantity], z)
                other = shares(plain.quantities[quantity], z)
                mark = "" if own.case == case else " (none of its own)"
                print(
                    f"| {case}{mark} | {quantity} | {half:.2f} | {most:.2f} | {other[0]:.2f}, {other[1]:.2f} |",
                    flush=True,
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
