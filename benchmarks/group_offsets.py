"""Forces of balls where a quarter, half or block of the taxels has an offset of 30 % of the largest reading.

    python benchmarks/group_offsets.py                     12 frames of each kind
    python benchmarks/group_offsets.py --frames 40 --kinds quarter clean

"block" is as large as a quarter and anywhere; "clean" has no offset. The offset is in one channel or in all, and nobody gives the noise. It prints, for 8 x 8
taxels of one channel and 5 x 5 of three, the frames whose 95 % interval of the force holds, those wrong by more than 30 %, the mean error of the force, and
seconds of processor time. Seeds from 100 on tuned nothing.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings

import numpy as np

import palpate as pp
from palpate.elastic.pad import Floats

KINDS = ("quarter", "half", "block", "clean")
ARRAYS = ((8, ("stress_zz",)), (5, ("stress_xz", "stress_yz", "stress_zz")))
PITCH, OFFSET = 2e-3, 0.3


def frame(seed: int, kind: str, side: int, channels: tuple[str, ...]) -> tuple[pp.Skin, Floats, float]:
    """A skin, its readings [Pa] and the true force [N]."""
    rng = np.random.default_rng([seed, side, int(len(channels) > 1), 991])
    pad = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.48)
    depth = float(rng.uniform(0.6, 1.5)) * PITCH
    skin = pp.Skin(pad, pp.AreaArray(shape=(side, side), pitch=PITCH, depth=depth, channels=list(channels)))
    force, width = float(rng.uniform(0.5, 4.0)), side * PITCH
    ball = pp.solutions.hertz_point(contact_radius=float(rng.uniform(1.0, 2.0)) * PITCH, force=force)
    clean = np.asarray(skin.sense(ball.shifted(*rng.uniform(-0.2 * width, 0.2 * width, 2))))
    largest = float(np.abs(clean).max())
    readings = clean + 10.0 ** float(rng.uniform(-2.5, -1.5)) * largest * rng.standard_normal(clean.shape)
    channel: int | slice = int(rng.integers(len(channels)))
    if rng.random() < 0.5:
        channel = slice(None)
    size, h = OFFSET * largest * float(rng.choice([-1, 1])), side // 2
    rows, columns = (slice(0, h) if rng.random() < 0.5 else slice(h, None) for _ in range(2))
    if kind == "half":
        columns = slice(None)
    elif kind == "block":
        y, x = rng.integers(0, side - h + 1, 2)
        rows, columns = slice(y, y + h), slice(x, x + h)
    if kind != "clean":
        readings[channel, rows, columns] += size
    return skin, readings, force


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| offset | taxels | held | wrong | mean error | seconds |\n|---|---|---|---|---|---|")
    for kind in given.kinds:
        for side, channels in ARRAYS:
            errors, held, started = [], 0, time.process_time()
            for seed in range(given.first, given.first + given.frames):
                skin, readings, force = frame(seed, kind, side, channels)
                touch = skin.reconstruct(readings)
                low, high = (float(np.asarray(end)[2]) for end in touch.interval(0.95, "force"))
                held += low <= force <= high
                errors.append(abs(float(touch.force[2]) / force - 1.0))
            print(
                f"| {kind} | {side} x {side} x {len(channels)} | {held} of {given.frames} | {sum(e > 0.3 for e in errors)} | "
                f"{np.nanmean(errors):.3f} | {time.process_time() - started:.1f} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
