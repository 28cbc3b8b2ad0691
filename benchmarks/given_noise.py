"""Forces of balls on 8 x 8 taxels where the noise that is given is wrong by a factor, with and without an offset.

    python benchmarks/given_noise.py                        half of the noise given, 12 frames of each kind
    python benchmarks/given_noise.py --factor 1 --first 200 --frames 10

It prints, for a half-space and a layer, with an offset and without: the frames whose 95 % interval of the force holds, the mean and the median error of
the force, and the median width of the interval, all over the true force. Seeds from 100 on tuned nothing.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import warnings

import numpy as np

import palpate as pp
from palpate.elastic.pad import Floats

SIDE, PITCH = 8, 2e-3


def frame(seed: int, factor: float, *, offset: bool, layer: bool) -> tuple[pp.Skin, Floats, float]:
    """A skin, its readings [Pa] and the true force [N]."""
    rng = np.random.default_rng([seed, SIDE, 0, int(layer)])
    elastic = {"youngs_modulus": 3e5, "poissons_ratio": 0.48}
    pad = pp.BondedLayers([pp.Layer(thickness=3.5e-3, **elastic)]) if layer else pp.HalfSpace(**elastic)
    depth = float(rng.uniform(0.6, 1.5)) * PITCH
    how = {"shape": (SIDE, SIDE), "pitch": PITCH, "depth": depth, "channels": ["stress_zz"]}
    force = float(rng.uniform(0.5, 4.0))
    ball = pp.solutions.hertz_point(contact_radius=float(rng.uniform(1.0, 2.5)) * PITCH, force=force)
    ball = ball.shifted(*rng.uniform(-0.2 * SIDE * PITCH, 0.2 * SIDE * PITCH, 2))
    clean = np.asarray(pp.Skin(pad, pp.AreaArray(**how)).sense(ball))
    largest = float(np.abs(clean).max())
    noise = 10.0 ** float(rng.uniform(-2.3, -1.3)) * largest
    readings = clean + noise * rng.standard_normal(clean.shape)
    if offset:
        readings = readings + rng.uniform(-0.3, 0.3, (1, 1, 1)) * largest
    return pp.Skin(pad, pp.AreaArray(**how, noise=noise * factor)), readings, force


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--factor", type=float, default=0.5, help="given noise over the true one")
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--frames", type=int, default=12)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| pad | offset | held | mean error | median error | width |\n|---|---|---|---|---|---|")
    for layer, offset in itertools.product((False, True), (True, False)):
        errors, widths, held = [], [], 0
        for seed in range(given.first, given.first + given.frames):
            skin, readings, force = frame(seed, given.factor, offset=offset, layer=layer)
            touch = skin.reconstruct(readings)
            low, high = (float(np.asarray(side)[2]) for side in touch.interval(0.95, "force"))
            held += low <= force <= high
            errors.append(abs(float(touch.force[2]) / force - 1.0))
            widths.append((high - low) / force)
        print(
            f"| {'layer' if layer else 'half-space'} | {'yes' if offset else 'no'} | {held} of {given.frames} | {np.mean(errors):.3f} | "
            f"{np.median(errors):.3f} | {np.median(widths):.3f} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
