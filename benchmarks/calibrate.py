"""Learning curves of `palpate.calibrate` beside plain regressions, on published sensors with a force sensor beside them.

    python benchmarks/calibrate.py --data FOLDER                 # holds tactileforce/, melexis/, eflesh/
    python benchmarks/calibrate.py --data FOLDER --draws 2 --only melexis
    python benchmarks/calibrate.py --data FOLDER --write         # docs/_generated/calibrate.md

Labelled frames are drawn at random from one run (or from half of the presses); the error is that on frames of another run (or of the other presses), never
on neighbours in time. All methods get the same labels. palpate is told besides what it is told on a bench: the zero where one was recorded (not that of tactileforce presses),
a guess of the pad, the times of the labels, and the normal force beside the labels of shear. The regressions have a constant, readings of variance 1, and: linear and quadratic ridge, its weight by leave-one-out; a Gaussian process with a linear and a
squared-exponential kernel, by marginal likelihood. Their 95 % intervals are the leave-one-out error times Student's quantile, and the process's own.

"Best" is the smallest error of the three regressions, each over all draws, which nobody could have picked without the held-out frames.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.special
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import minimize

import palpate as pp
from palpate.calibrate import ForceMap, likely_maps
from palpate.calibrate.forcemap import usual_scale
from palpate.calibrate.labels import press_numbers
from palpate.calibrate.prior import SHEAR_SHARE
from palpate.calibrate.process import Process

sys.path.insert(0, str(Path(__file__).parent))
from real import bonded, plus

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "calibrate.md"
SIZES = (3, 10, 30, 100, 300)
#: Held-out frames of a set, at most.
TESTED = 400
Array = np.ndarray


@dataclass(frozen=True)
class Split:
    """Readings (frame, reading) and one force (frame,) to learn from and to be tested on; times of the first where it is one stream; the normal force beside shear."""

    name: str
    skin: pp.Skin
    component: int
    readings: Array
    force: Array
    time: Array | None
    held_readings: Array
    held_force: Array
    zero_known: bool = True
    normal: Array | None = None


# -- sets ----------------------------------------------------------------------------------------------------------------


def tactileforce(folder: Path, rng: np.random.Generator) -> Iterator[Split]:
    skin = pp.Skin(bonded(8e-3, 1e5), pp.AreaArray(shape=(2, 2), pitch=12e-3, depth=8e-3, channels=["stress_zz"]))
    order = [0, 3, 1, 2]
    table = np.loadtxt(folder / "presses.csv", delimiter=",", skiprows=1)
    readings, force = table[:, 3:7][:, order], table[:, 2]
    shuffled = rng.permutation(len(table))
    a, b = shuffled[: len(table) // 2], shuffled[len(table) // 2 :]
    yield Split("tactileforce presses", skin, 2, readings[a], force[a], None, readings[b], force[b], False)
    places = np.unique(table[:, :2], axis=0)
    chosen = places[rng.permutation(len(places))[: len(places) // 2]]
    first = (table[:, None, :2] == chosen[None]).all(axis=2).any(axis=1)
    yield Split(
        "tactileforce places", skin, 2, readings[first], force[first], None, readings[~first], force[~first], False
    )
    streams = []
    for i in range(3):
        table = np.loadtxt(folder / f"stream-{i}.csv", delimiter=",", skiprows=1)
        zero = table[:30].mean(axis=0)
        streams.append((table[:, 1:5][:, order] - zero[1:5][order], table[:, 0] - zero[0], table[:, 5]))
    for i, j in ((0, 1), (2, 0)):
        yield Split(f"tactileforce stream {i} to {j}", skin, 2, *streams[i], *streams[j][:2])


def melexis(folder: Path, rng: np.random.Generator) -> Iterator[Split]:
    skin = pp.Skin(
        bonded(4e-3, 3e5), pp.AreaArray(shape=(2, 2), pitch=2e-3, depth=4e-3, channels=["stress_xz", "stress_zz"])
    )
    table = np.loadtxt(folder / "calib-first-1000.csv", delimiter=",", skiprows=1)
    free = np.flatnonzero((np.linalg.norm(table[:, 18:21], axis=1) < 0.03) & (table[:, 5] < 0.0))[:30]
    readings = table[:, 8:16][:, [0, 2, 4, 6, 1, 3, 5, 7]]
    readings = readings - readings[free].mean(axis=0)
    half = len(table) // 2
    for component, sign, name in ((2, -1.0, "Fz"), (0, 1.0, "Fx"), (1, 1.0, "Fy")):
        force = sign * table[:, 18 + component]
        yield Split(
            f"melexis {name}", skin, component, readings[:half], force[:half], None, readings[half:], force[half:],
            normal=None if name == "Fz" else table[:half, 20],
        )  # fmt: skip


def eflesh(folder: Path, rng: np.random.Generator) -> Iterator[Split]:
    runs = {}
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    for path in sorted(folder.glob("*_force_*_probe_states.csv")):
        states = np.loadtxt(path, delimiter=",")
        table = np.loadtxt(str(path).replace("_probe_states", "_probe_sensor_post_baselines"), delimiter=",")
        until = min(30, int(np.argmin(states[:, 3] > states[0, 3] - 0.4)))
        known = states[:, 4] != -1.0
        readings = (table[:, 1:] - table[:until, 1:].mean(axis=0))[known]
        readings = readings.reshape(len(readings), -1, 3).transpose(0, 2, 1).reshape(len(readings), -1)
        rest = np.flatnonzero(known[:until])
        runs[path.name.split("_")[3]] = (
            readings,
            9.81e-3 * (states[:, 4] - states[rest, 4].mean())[known],
            states[known, 0],
        )
    five = pp.ScatteredArray(positions=plus(7e-3), depth=8e-3, channels=channels)
    ten = pp.ScatteredArray(
        positions=np.concatenate([plus(7e-3, -12e-3), plus(7e-3, 12e-3)]), depth=8e-3, channels=channels
    )
    skin = pp.Skin(bonded(8e-3, 1e5, 0.3), five)
    for a, b, name in (("014340", "015037", "1 to 2"), ("015037", "014340", "2 to 1")):
        yield Split(f"eflesh run {name}", skin, 2, *runs[a], *runs[b][:2])
    readings, force, time = runs["200533"]
    half = len(force) // 2
    yield Split(
        "eflesh shear, halves", pp.Skin(bonded(8e-3, 1e5, 0.3), ten), 2, readings[:half], force[:half], time[:half], readings[half:], force[half:]
    )  # fmt: skip


SETS: dict[str, Callable[[Path, np.random.Generator], Iterator[Split]]] = {
    "tactileforce": tactileforce,
    "melexis": melexis,
    "eflesh": eflesh,
}


# -- methods -------------------------------------------------------------------------------------------------------------


def ridge(x: Array, y: Array, at: Array, *, quadratic: bool = False) -> tuple[Array, Array]:
    """Values, and half of the 95 % interval."""
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread[spread == 0.0] = 1.0
    x, at = (x - mean) / spread, (at - mean) / spread
    if quadratic:
        i, j = np.triu_indices(x.shape[1])
        x, at = np.c_[x, x[:, i] * x[:, j]], np.c_[at, at[:, i] * at[:, j]]
        mean, spread = x.mean(axis=0), x.std(axis=0)
        spread[spread < 1e-12] = 1.0
        x, at = (x - mean) / spread, (at - mean) / spread
    u, d, v = np.linalg.svd(x, full_matrices=False)
    along, n = u.T @ (y - y.mean()), len(y)
    best = (math.inf, along)
    for weight in np.logspace(-6, 4, 41):
        kept = d * d / (d * d + weight)
        left = (y - y.mean() - u @ (kept * along)) / np.maximum(1.0 - (u * u * kept).sum(axis=1) - 1.0 / n, 1e-6)
        if (left**2).mean() < best[0]:
            best = ((left**2).mean(), v.T @ (d / (d * d + weight) * along))
    half = math.sqrt(best[0]) * scipy.special.stdtrit(max(n - 1, 1), 0.975)
    return y.mean() + at @ best[1], np.full(len(at), half)


def process(x: Array, y: Array, at: Array) -> tuple[Array, Array]:
    """Gaussian process, linear plus squared-exponential, from two starts."""
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread[spread == 0.0] = 1.0
    x, at, n = (x - mean) / spread, (at - mean) / spread, len(y)
    level, size = y.mean(), y.std() or 1.0
    z, dot, far = (y - level) / size, x @ x.T, ((x[:, None] - x[None]) ** 2).sum(axis=-1)

    def objective(p: Array) -> tuple[float, Array]:
        a, b, length, c, noise = np.exp(p)
        close = b * np.exp(-far / (2 * length**2))
        try:
            factor = np.linalg.cholesky(a * dot + close + c + (noise + 1e-10) * np.eye(n))
        except np.linalg.LinAlgError:
            return 1e10, np.zeros(5)
        alpha = cho_solve((factor, True), z)
        w = cho_solve((factor, True), np.eye(n)) - np.outer(alpha, alpha)
        slope = [
            (w * a * dot).sum(),
            (w * close).sum(),
            (w * close * far).sum() / length**2,
            c * w.sum(),
            noise * np.trace(w),
        ]
        return 0.5 * z @ alpha + np.log(np.diag(factor)).sum(), 0.5 * np.array(slope)

    bounds = [(math.log(lo), math.log(hi)) for lo, hi in ((1e-5, 1e3), (1e-5, 1e3), (0.1, 100), (1e-5, 100), (1e-6, 1))]
    starts = (np.log([0.1, 1, 2, 1, 0.01]), np.log([1, 0.1, 5, 0.1, 0.1]))
    found = min(
        (minimize(objective, s, jac=True, method="L-BFGS-B", bounds=bounds) for s in starts), key=lambda r: r.fun
    )
    a, b, length, c, noise = np.exp(found.x)
    factor = np.linalg.cholesky(a * dot + b * np.exp(-far / (2 * length**2)) + c + (noise + 1e-10) * np.eye(n))
    across = a * at @ x.T + b * np.exp(-((at[:, None] - x[None]) ** 2).sum(axis=-1) / (2 * length**2)) + c
    reduced = solve_triangular(factor, across.T, lower=True)
    variance = a * (at**2).sum(axis=1) + b + c + noise - (reduced**2).sum(axis=0)
    return level + size * across @ cho_solve((factor, True), z), 1.96 * size * np.sqrt(np.maximum(variance, 1e-12))


_LIKELY: dict[str, Array | None] = {}


def fitted(split: Split) -> ForceMap:
    """What `Skin.calibrate` fits for this component, with the physics of a skin worked out once."""
    key = split.name.split()[0] + str(split.readings.shape[1])
    if key not in _LIKELY:
        _LIKELY[key] = likely_maps(split.skin.pad, split.skin.planes, split.skin.surface, np.random.default_rng(41))
    likely = _LIKELY[key]
    n = len(split.force)
    time = np.full(n, np.nan) if split.time is None else split.time
    press = press_numbers(time, split.force, np.zeros(n, dtype=np.int64))
    physics = None if likely is None else likely[split.component]
    scale = usual_scale(split.readings)
    expected = 0.0 if split.normal is None else SHEAR_SHARE * float(np.sqrt(np.mean(split.normal**2)))
    labels = Process(
        split.readings, split.force, np.zeros(n), scale, physics, press, split.time, zero_known=split.zero_known, expected=expected
    )  # fmt: skip
    return ForceMap.fit(labels)


def palpate(split: Split, at: Array) -> tuple[Array, Array]:
    made = fitted(split)
    value, std = made.predict(at)
    return value, std * float(scipy.special.stdtrit(made.freedom, 0.975))


METHODS: dict[str, Callable[[Split, Array], tuple[Array, Array]]] = {
    "palpate": palpate,
    "linear": lambda s, at: ridge(s.readings, s.force, at),
    "quadratic": lambda s, at: ridge(s.readings, s.force, at, quadratic=True),
    "process": lambda s, at: process(s.readings, s.force, at),
}


# -- measuring -----------------------------------------------------------------------------------------------------------


def measured(
    data: Path, only: str | None, draws: range, keep: Path | None
) -> dict[tuple[str, str, int], list[tuple[float, float, float, float, float]]]:
    """(set, method, labels) -> for each draw: mean error, R^2, coverage, width of the 95 % interval, seconds."""
    out: dict[tuple[str, str, int], list[tuple[float, float, float, float, float]]] = {}
    done: list[list[object]] = []
    if keep is not None and keep.exists():
        done, rows = json.loads(keep.read_text())
        out = {(a, b, int(c)): [tuple(r) for r in v] for a, b, c, v in rows}
    for draw, (name, maker) in itertools.product(draws, SETS.items()):
        if [draw, name] not in done and (only is None or name in only.split(",")):
            rng = np.random.default_rng([draw, *name.encode()])
            for split in maker(data / name, rng):
                tested = rng.permutation(len(split.held_force))[:TESTED]
                truth, at = split.held_force[tested], split.held_readings[tested]
                for size in SIZES:
                    k = rng.permutation(len(split.force))[:size]
                    part = Split(
                        split.name, split.skin, split.component, split.readings[k], split.force[k], None if split.time is None else split.time[k], at, truth, split.zero_known, None if split.normal is None else split.normal[k]
                    )  # fmt: skip
                    for method, function in METHODS.items():
                        begun = clock.process_time()
                        value, half = function(part, at)
                        seconds = clock.process_time() - begun
                        error = np.abs(value - truth)
                        r2 = 1.0 - (error**2).mean() / truth.var()
                        row = (error.mean(), r2, (error <= half).mean(), 2.0 * half.mean(), seconds)
                        out.setdefault((split.name, method, size), []).append(tuple(map(float, row)))  # type: ignore[arg-type]
            done.append([draw, name])
            if keep is not None:
                keep.write_text(json.dumps([done, [[*k, v] for k, v in out.items()]]))
            print(f"draw {draw}, {name}: done", file=sys.stderr, flush=True)
    return out


def report(
    found: dict[tuple[str, str, int], list[tuple[float, float, float, float, float]]], draws: range
) -> list[str]:
    names = list(dict.fromkeys(k[0] for k in found))
    mean = {k: np.mean(v, axis=0) for k, v in found.items()}
    lines = [
        "# Newtons from labelled frames",
        "",
        f"Made by `python benchmarks/calibrate.py --data FOLDER --first {draws.start} --draws {len(draws)}`: means over {len(draws)} draws of labels. For shear palpate is also given Fz of the labelled frames, which the regressions cannot use.",
        "",
    ]
    heads = " | ".join(f"{s} labels" for s in SIZES)
    lines += [
        "**Mean error of the force on held-out frames [N]**",
        "",
        f"| set | method | {heads} |",
        "|---" * (2 + len(SIZES)) + "|",
    ]
    lines += [
        f"| {n} | {m} | " + " | ".join(f"{mean[n, m, s][0]:.3g}" for s in SIZES) + " |" for n in names for m in METHODS
    ]
    lines += [
        "",
        "**palpate: error divided by that of the best of the three regressions; R²; coverage and width [N] of the 95 % intervals**",
        "",
        f"| set | | {heads} |",
        "|---" * (2 + len(SIZES)) + "|",
    ]
    ratio = {
        (n, s): mean[n, "palpate", s][0] / min(mean[n, m, s][0] for m in METHODS if m != "palpate")
        for n in names
        for s in SIZES
    }
    for n in names:
        lines.append(f"| {n} | error / best | " + " | ".join(f"{ratio[n, s]:.2f}" for s in SIZES) + " |")
        lines.append("| | R² | " + " | ".join(f"{mean[n, 'palpate', s][1]:.3f}" for s in SIZES) + " |")
        lines.append("| | coverage | " + " | ".join(f"{mean[n, 'palpate', s][2]:.2f}" for s in SIZES) + " |")
        lines.append("| | width | " + " | ".join(f"{mean[n, 'palpate', s][3]:.3g}" for s in SIZES) + " |")
    lines += [
        "",
        "**All sets: median of the error divided by that of the best regression, and mean coverage**",
        "",
        f"| method | | {heads} |",
        "|---" * (2 + len(SIZES)) + "|",
    ]
    for m in METHODS:
        best = {(n, s): min(mean[n, o, s][0] for o in METHODS if o != "palpate") for n in names for s in SIZES}
        lines.append(
            f"| {m} | error / best | "
            + " | ".join(f"{np.median([mean[n, m, s][0] / best[n, s] for n in names]):.2f}" for s in SIZES)
            + " |"
        )
        lines.append(
            "| | coverage | " + " | ".join(f"{np.mean([mean[n, m, s][2] for n in names]):.2f}" for s in SIZES) + " |"
        )
    best = {(n, s): min(mean[n, m, s][0] for m in METHODS if m != "palpate") for n in names for s in SIZES}
    gained = [np.median([best[n, b] / best[n, a] for n in names]) for a, b in itertools.pairwise(SIZES)]
    lines += [
        "",
        "Error of the best regression with more labels, divided by its error with fewer labels (median over sets): "
        + ", ".join(f"{a} to {b} labels {g:.2f}" for (a, b), g in zip(itertools.pairwise(SIZES), gained))
        + ".",
    ]
    lines += [
        "",
        "Seconds for one fit and 400 predictions: "
        + ", ".join(f"{s} labels {np.mean([mean[n, 'palpate', s][4] for n in names]):.2g}" for s in SIZES)
        + ".",
    ]
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with tactileforce/, melexis/ and eflesh/")
    parser.add_argument("--only", help="some of tactileforce, melexis, eflesh")
    parser.add_argument("--draws", type=int, default=6, help="draws of labels")
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument(
        "--keep", type=Path, help="file of what is measured so far: a run that is broken off goes on from it"
    )
    parser.add_argument("--write", action="store_true", help=f"write {GENERATED.name}")
    args = parser.parse_args()
    draws = range(args.first, args.first + args.draws)
    lines = report(measured(args.data, args.only, draws, args.keep), draws)
    print("\n".join(lines))
    if args.write:
        GENERATED.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
