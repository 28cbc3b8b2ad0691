"""Do the intervals hold the truth as often as they say, in every case that has constants of its own? On contacts that fixed none of them.

    python benchmarks/coverage.py [--frames 60] [--contact line] [--seed 999] [--method tikhonov]

For each case: the share of true values inside the intervals of 50 and 95 %, and beside them the shares with the constants of stress taxels
on a half-space, which a case without its own uses.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from palpate import bench
from palpate.uncertainty import Calibration, Case, constants

SENSING, BODIES = ("stress", "strain", "displacement"), ("half-space", "layers")


def shares(known: Calibration, z: list[np.ndarray]) -> tuple[float, float]:
    """Mean over frames of the part of standardised errors inside the intervals of 50 and 95 %."""
    zero, one, none = np.zeros(()), np.ones(()), np.asarray(-np.inf)
    ends = [known.bounds(level, zero, one, zero, none) for level in (0.5, 0.95)]
    half, most = (float(np.mean([np.mean((v >= low) & (v <= high)) for v in z])) for low, high in ends)
    return half, most


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--contact", choices=("line", "area", "area with shear"), default="line")
    parser.add_argument("--seed", type=int, default=999)
    parser.add_argument("--method", default="adaptive")
    arguments = parser.parse_args()
    method = arguments.method
    said = f"--frames {arguments.frames} --contact '{arguments.contact}' --seed {arguments.seed} --method {method}"
    print(f"Made by `python benchmarks/coverage.py {said}`.\n")
    print("| case | quantity | 50 % | 95 % | 50 %, 95 % without constants of its own |\n|---|---|---|---|---|")
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
