"""Dense and matrix-free, side by side: the same readings solved both ways, wherever a dense solution is still affordable.

    python benchmarks/engines.py [--only TEXT ...] [--write]

Size alone decides which way a frame goes; here it is forced. The linear method on areas, lines, beads, with taxels missing, on a layer and with
correlated noise, by every rule that chooses the parameter; the automatic method, once with matrices alone and once with products alone. Each
layout in a process of its own (set OMP_NUM_THREADS=1); ``--write`` writes docs/_generated/engines.md.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scale

import palpate as pp
from palpate.inverse.constrained import products
from palpate.inverse.contact import answer, methods
from palpate.inverse.contact.adaptive import AdaptiveEstimator
from palpate.inverse.contact.policy import Policy, changed
from palpate.inverse.linear.matrix_free import path
from palpate.sensing import operator as operators
from palpate.sensing.uncertainty import EXACT

TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "engines.md"
PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
LAYER = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
#: Part of each channel's largest reading that the noise is.
NOISE = 0.02
#: Frames of each layout; the table says the largest difference among them.
FRAMES = 3
#: More readings than any layout here has.
ENDLESS = 10**9
RULES = {"evidence": "evidence", "gcv": "GCV", "discrepancy": "discrepancy", "lcurve": "L-curve"}


def gaps(n: int) -> Any:
    """Taxels that work: a hole and some at random are missing."""
    working = np.random.default_rng(3).random((n, n)) > 0.03
    working[n // 4 : n // 4 + 3, n // 2 : n // 2 + 4] = False
    return working


def stress(n: int, **options: Any) -> pp.AreaArray:
    return pp.AreaArray(shape=(n, n), pitch=1e-3, depth=2e-3, channels=scale.STRESS, **options)


def shift(n: int) -> pp.AreaArray:
    return scale.area(n, n, channels=scale.SHIFT)


#: Pad, array and rules of each layout of the linear method.
LINEAR: dict[str, tuple[Any, Callable[[], Any], tuple[str, ...]]] = {
    "8 x 8 x 3": (PAD, lambda: stress(8), ("evidence",)),
    "16 x 16 x 3": (PAD, lambda: stress(16), tuple(RULES)),
    "32 x 32 x 3": (PAD, lambda: stress(32), tuple(RULES)),
    "16 x 16 x 2, displacement": (PAD, lambda: shift(16), ("evidence",)),
    "32 x 32 x 2, displacement": (PAD, lambda: shift(32), tuple(RULES)),
    "64 x 64 x 2, displacement": (PAD, lambda: shift(64), ("evidence",)),
    "20 x 20 x 3, taxels missing": (PAD, lambda: stress(20, mask=gaps(20)), ("evidence", "gcv")),
    "16 x 16 x 3, correlated noise": (PAD, lambda: stress(16, noise_correlation=1e-3), ("evidence",)),
    "16 x 16 x 3, a layer": (LAYER, lambda: stress(16), ("evidence",)),
    "32 x 32 x 3, a layer": (LAYER, lambda: stress(32), ("evidence",)),
    "32 x 32 x 2, displacement, a layer": (LAYER, lambda: shift(32), ("evidence",)),
    "line of 121 x 2": (PAD, lambda: scale.line(121), tuple(RULES)),
    "line of 1000 x 2": (PAD, lambda: scale.line(1000), ("evidence",)),
    "500 beads x 2": (PAD, lambda: scale.beads(500), ("evidence", "gcv")),
    "500 beads x 2, no shift": (PAD, lambda: scale.beads(500), ("evidence", "gcv", "lcurve")),
    "1500 beads x 2": (PAD, lambda: scale.beads(1500), ("evidence",)),
}
#: Taxels along a side and friction, of the automatic method.
AUTOMATIC: dict[str, tuple[int, float | None]] = {
    f"{n} x {n} x 3{'' if friction is None else ', friction'}": (n, friction)
    for n in (12, 16, 24, 32)
    for friction in (None, 0.6)
}


def dense_only() -> None:
    """Matrices whatever the size."""
    path.LARGEST_DENSE_BLOCK = path.LARGEST_MATRIX = operators.LARGEST_MATRIX = ENDLESS
    products.MIN_ITERATIVE_UNKNOWNS = products.FEWEST_SLIDING = products.FEWEST_OF_MANY = ENDLESS


def products_only() -> None:
    """No matrix, however small."""
    path.LARGEST_DENSE_BLOCK = path.LARGEST_MATRIX = operators.LARGEST_MATRIX = 0
    products.MIN_ITERATIVE_UNKNOWNS, products.PRODUCTS, products.PRODUCTS_ONCE, products.MANY = 10, 0.0, 0.0, 0
    products.FEWEST_SLIDING, products.PRODUCTS_SLIDING, products.FEW_READINGS = 10, 0.0, 0
    products.PRODUCTS_DISPLACEMENT = 0.0
    # the least error of a large contact's force is a bound, not what products leave
    methods.Policy = lambda: changed(Policy(), "errors.force_at_size", Policy().errors.force)  # type: ignore[misc,assignment]


def with_noise(array: Any, noise: tuple[float, ...]) -> Any:
    """The same array with its noise stated."""
    fields = {f: getattr(array, f) for f in array.__dataclass_fields__}
    return type(array)(**{**fields, "noise": noise})


def largest(a: Any, b: Any) -> float:
    """The largest relative difference of positive numbers."""
    return float(np.max(np.abs(np.asarray(a) / np.asarray(b) - 1.0)))


def difference(a: Any, b: Any) -> float:
    """Of fields or vectors (frame, ...): the norm of the difference over that of ``b``, the largest of all frames."""
    one, other = (np.asarray(x).reshape(len(x), -1) for x in (a, b))
    return float(np.max(np.linalg.norm(one - other, axis=1) / np.linalg.norm(other, axis=1)))


def noisy(skin: pp.Skin) -> tuple[Any, tuple[float, ...]]:
    """Frames of the bumps of `scale.pressed`, and the noise of each channel."""
    readings = np.asarray(skin.sense(scale.pressed(skin)))
    noise = NOISE * np.nanmax(np.abs(readings.reshape(len(readings), -1)), axis=1)
    spread = noise.reshape(-1, *[1] * (readings.ndim - 1))
    many = readings + spread * np.random.default_rng(1).standard_normal((FRAMES, *readings.shape))
    return many, tuple(noise.tolist())


def cells(touch: pp.Touch, sought: list[int]) -> Any:
    """Standard deviations of the cells of one frame."""
    return np.asarray(touch._errors.posterior.traction)[sought].ravel()  # type: ignore[union-attr]


def linear(name: str, rule: str) -> dict[str, Any]:
    """The linear method on one layout by one rule."""
    pad, make, _ = LINEAR[name]
    array, found, spent = make(), [], []
    readings, noise = noisy(pp.Skin(pad, array))
    if rule == "discrepancy":
        array = with_noise(array, noise)
    for force in (dense_only, products_only):
        force()
        skin = pp.Skin(pad, array, nuisance=() if name.endswith("no shift") else "auto")
        start = time.process_time()
        touch = skin.reconstruct(readings, method="tikhonov", rule=rule)
        spent.append(time.process_time() - start)
        found.append((skin, touch))
    (_, dense), (free_skin, free) = found
    parameters = np.asarray(dense.parameter)
    same = free_skin.reconstruct(readings[:1], method="tikhonov", parameter=float(parameters[0]))
    sought = [dense.surface.components.index(c) for c in dense.components]
    ratio = cells(free[0], sought) / cells(dense[0], sought)
    return {
        "name": name,
        "rule": rule,
        "readings": int(np.isfinite(readings[0]).sum()),
        "same": difference(same.values[:, sought], dense.values[:1, sought]),
        "traction": difference(free.values[:, sought], dense.values[:, sought]),
        "parameter": largest(free.parameter, parameters),
        "noise": 0.0 if rule == "discrepancy" else largest(free.noise_std, dense.noise_std),
        "median": float(np.median(ratio)),
        "spread": float(np.std(ratio)),
        "force": float(
            np.max(
                np.abs(np.asarray(free.force) - np.asarray(dense.force))[:, sought]
                / np.asarray(dense._errors.posterior.force)[:, sought]  # type: ignore[union-attr]
            )
        ),
        "force_std": largest(
            np.asarray(free._errors.posterior.force)[:, sought],  # type: ignore[union-attr]
            np.asarray(dense._errors.posterior.force)[:, sought],  # type: ignore[union-attr]
        ),
        "times": spent,
        "solved": bool((np.asarray(free.status) == 0).all()),
    }


DRIFT, EXPLAINS = answer.drift_probability, AdaptiveEstimator._explains


def alike(*, alone: bool) -> None:
    """Only what both ways do, or everything: the test of drift takes matrices, and without them no model is refused for what it leaves."""
    answer.drift_probability = (lambda *_: math.nan) if alone else DRIFT  # type: ignore[assignment]
    AdaptiveEstimator._explains = (lambda *_: True) if alone else EXPLAINS  # type: ignore[method-assign,assignment]


def automatic(name: str) -> dict[str, Any]:
    """The automatic method as size decides (here: matrices) and with products alone; whole, and only by what both do, without offsets."""
    n, friction = AUTOMATIC[name]

    def frames(nuisance: str | tuple[str, ...]) -> list[pp.Touch]:
        skin = pp.Skin(PAD, stress(n), uncertainty=EXACT, nuisance=nuisance)
        readings = skin.sense(scale.touched(skin, n))
        rng = np.random.default_rng(1)
        many = readings + NOISE * np.abs(readings).max() * rng.standard_normal((FRAMES, *readings.shape))
        start = time.process_time()
        found = [skin.reconstruct(frame, friction=friction) for frame in many]
        spent.append(time.process_time() - start)
        return found

    spent: list[float] = []
    dense = frames("auto")
    alike(alone=True)
    first = frames(())
    products_only()
    second = frames(())
    alike(alone=False)
    free = frames("auto")
    apart = [difference(b.values[None], a.values[None]) for a, b in zip(dense, free)]
    inside, ratios = [], []
    for a, b in zip(dense, free):
        std = np.asarray(a._errors.posterior.traction)
        there = std[2] > 0.3 * std[2].max()
        inside.append(float(np.sqrt(np.mean(((b.values - a.values)[:, there] / std[:, there]) ** 2))))
        ratios.append(np.asarray(b._errors.posterior.traction)[2][there] / std[2][there])
    ratio = np.concatenate(ratios)
    of = [(np.asarray(a._errors.posterior.force), np.asarray(b._errors.posterior.force)) for a, b in zip(dense, free)]
    return {
        "name": name,
        "rule": "automatic",
        "readings": 3 * n * n,
        "traction": max(apart),
        "alike": max(difference(b.values[None], a.values[None]) for a, b in zip(first, second)),
        "std": max(inside),
        "noise": max(largest(b.noise_std, a.noise_std) for a, b in zip(dense, free)),
        "median": float(np.median(ratio)),
        "spread": float(np.std(ratio)),
        "force": max(
            float(np.max(np.abs(np.asarray(b.force) - np.asarray(a.force)) / s[0])) for a, b, s in zip(dense, free, of)
        ),
        "force_std": max(largest(s[1], s[0]) for s in of),
        "times": [spent[0], spent[3]],
        "solved": all(int(t.status) == 0 for t in (*dense, *free)),
    }


def small(x: float) -> str:
    return f"{x:.1e}" if x < 1e-3 else f"{x:.3f}"


def tables(rows: list[dict[str, Any]]) -> str:
    """The linear rows and the automatic ones, each as a table."""
    first = [
        "| layout | readings | rule | traction, same lambda | traction | lambda | noise | std of cells, ratio | of force | force in its standard deviations | dense, matrix-free [s] |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    second = [
        "| layout | readings | traction, same models | traction | in its standard deviations | noise | std of cells, ratio | of force | force in its standard deviations | matrices, products [s] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        ratio, times = f"{r['median']:.3f} ± {r['spread']:.3f}", ", ".join(f"{t:.2f}" for t in r["times"])
        name = r["name"] + ("" if r["solved"] else " (not solved)")
        if r["rule"] == "automatic":
            second.append(
                f"| {name} | {r['readings']} | {small(r['alike'])} | {small(r['traction'])} | {small(r['std'])} | {small(r['noise'])} | {ratio} | {small(r['force_std'])} | "
                f"{small(r['force'])} | {times} |"
            )
        else:
            noise = "given" if r["rule"] == "discrepancy" else small(r["noise"])
            first.append(
                f"| {name} | {r['readings']} | {RULES[r['rule']]} | {small(r['same'])} | {small(r['traction'])} | {small(r['parameter'])} | {noise} | {ratio} | "
                f"{small(r['force_std'])} | {small(r['force'])} | {times} |"
            )
    return "\n".join(
        [
            "The linear method:",
            "",
            *first,
            "",
            "The automatic method, with matrices and without (products):",
            "",
            *second,
            "",
        ]
    )


HEADING = (
    "# Dense and matrix-free\n\nWritten by `benchmarks/engines.py`: the same readings solved with matrices and without, 2 % noise of each channel; the largest "
    f"difference of {FRAMES} frames. Traction: norm of the difference divided by that of the dense result; lambda, noise and standard "
    "deviation of the force: relative difference; standard deviations of cells: ratio of matrix-free to dense, median ± spread over the cells. "
    "For large frames the automatic method leaves out some steps: very small offsets, the test of drift, and the rejection of models with a "
    'larger residual than the first. "Same models" compares both ways without these steps. '
    "Seconds of processor time with preparation, one thread.\n\n"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="TEXT", help="layouts whose name has one of these in it"
    )
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        name, rule = given.one
        print(json.dumps(automatic(name) if rule == "automatic" else linear(name, rule)))
        return
    cases = [(n, r) for n, (_, _, rules) in LINEAR.items() for r in rules] + [(n, "automatic") for n in AUTOMATIC]
    rows = []
    for name, rule in cases:
        if given.only and not any(t in f"{name}, {rule}" for t in given.only):
            continue
        command = [sys.executable, __file__, "--one", name, rule]
        done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        if done.returncode:
            raise SystemExit(f"{name}, {rule}: {done.stderr.strip()}")
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        print(json.dumps(rows[-1]), flush=True)
    print(tables(rows))
    if given.write:
        TABLE.write_text(HEADING + tables(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
