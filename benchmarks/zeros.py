"""Force from sensors that read exactly zero beside a load: thresholds, rounding, dead taxels.

Balls of 1 N on 4 x 4 to 11 x 11 taxels, with and without shear; the noise is not given. Rows: a threshold (readings below 3 to 20 % of the
largest are zero), rounding to 5 to 8 bits over shallow taxels, rounding to 3 to 6 bits over deeper ones, and these three with 6 % dead taxels.

    python benchmarks/zeros.py --frames 80 --jobs 2
    PYTHONPATH=OTHER/src python benchmarks/zeros.py     # another copy of the library
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import numpy as np

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=1.5e5, poissons_ratio=0.48)
THREE, PITCH, FINER = ["stress_xz", "stress_yz", "stress_zz"], 2e-3, 8
Made = tuple[pp.Skin, np.ndarray]


def ball(rng: np.random.Generator, most: int, depths: tuple[float, float], radii: tuple[float, float]) -> Made:
    """A skin and its readings, made on cells of an eighth of a pitch, of a ball of 1 N; depths and radii in pitches."""
    n, channels = int(rng.integers(4, most)), THREE if rng.random() < 0.4 else THREE[2:]
    array = pp.AreaArray(shape=(n, n), pitch=PITCH, depth=PITCH * rng.uniform(*depths), channels=channels)
    fine = pp.Skin(PAD, array, surface=pp.AreaGrid(shape=(FINER * n, FINER * n), spacing=PITCH / FINER))
    contact = pp.solutions.hertz_point(contact_radius=PITCH * rng.uniform(*radii), force=1.0)
    contact = contact.sliding(rng.uniform(0.0, 0.4)).shifted(*rng.uniform(-0.3, 0.3, 2) * n * PITCH)
    return pp.Skin(PAD, array), np.asarray(fine.sense(contact))


def threshold(rng: np.random.Generator) -> Made:
    skin, y = ball(rng, 12, (0.5, 1.8), (0.4, 2.5))
    top = np.abs(y).max()
    y = y + rng.choice([0.003, 0.01, 0.03]) * top * rng.standard_normal(y.shape)
    return skin, np.where(np.abs(y) < rng.choice([0.03, 0.08, 0.2]) * top, 0.0, y)


def rounded(rng: np.random.Generator, depths: tuple[float, float], steps: list[int]) -> Made:
    skin, y = ball(rng, 9, depths, (0.4, 2.0))
    step = np.abs(y).max() / rng.choice(steps)
    return skin, np.round((y + 0.2 * step * rng.standard_normal(y.shape)) / step) * step


def shallow(rng: np.random.Generator) -> Made:
    return rounded(rng, (0.25, 0.6), [32, 64, 255])


def deep(rng: np.random.Generator) -> Made:
    return rounded(rng, (0.6, 1.6), [8, 16, 32, 64])


def dead(rng: np.random.Generator) -> Made:
    skin, y = (threshold, shallow, deep)[int(rng.integers(3))](rng)
    flat = y.reshape(len(y), -1)
    load = np.abs(flat[-1])
    chance = load / load.sum() if rng.random() < 0.5 else None
    count = min(max(1, round(0.06 * flat.shape[1])), int(np.count_nonzero(load)))
    flat[:, rng.choice(flat.shape[1], count, replace=False, p=chance)] = 0.0
    return skin, y


KINDS: tuple[Callable[[np.random.Generator], Made], ...] = (threshold, shallow, deep, dead)


def solved(task: tuple[int, int, int]) -> tuple[float, float, float, float]:
    """Error of the force, whether its interval holds it, the interval's width, and whether there is a note."""
    seed, kind, index = task
    warnings.simplefilter("ignore")
    skin, y = KINDS[kind](np.random.default_rng((seed, kind, index)))
    touch = skin.reconstruct(y)
    low, high = (float(np.asarray(end)[-1]) for end in touch.interval(0.95, of="force"))
    return abs(float(touch.force[-1]) - 1.0), float(low <= 1.0 <= high), high - low, float(bool(touch.notes))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=80, help="frames of each row")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    print("| readings | mean error | median | above 30 % | inside | width | outside without a note | no answer |")
    print("|---" * 8 + "|")
    for kind, made in enumerate(KINDS):
        tasks = [(args.seed, kind, index) for index in range(args.frames)]
        with ProcessPoolExecutor(args.jobs) as pool:
            error, inside, width, noted = np.array(list(pool.map(solved, tasks))).T
        numbers = f"{np.nanmean(error):.3f} | {np.nanmedian(error):.3f} | {(error > 0.3).sum()} | {inside.mean():.2f}"
        silent = int(((inside == 0) & (noted == 0)).sum())
        print(
            f"| {made.__name__} | {numbers} | {np.nanmedian(width):.2f} | {silent} | {np.isnan(error).sum()} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
