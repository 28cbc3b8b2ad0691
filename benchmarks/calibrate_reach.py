"""How far any learner comes on the sets of `calibrate.py`: the smallest error of a family of learners whose settings are picked with the held-out frames.

    python benchmarks/calibrate_reach.py --data FOLDER [--first 12 --draws 2]
    python benchmarks/calibrate_reach.py --data FOLDER --write      # docs/_generated/calibrate_reach.md

Nobody can pick settings this way, because the held-out forces are not known. So the result is a lower bound for the family: ridge regressions on all
products of up to three readings, or of their first principal components, and kernel regressions (squared exponential, Matern 1/2, 3/2, 5/2, each alone or
with a linear kernel), over grids of penalties, lengths and weights. palpate and the three regressions of `calibrate.py` belong to the family too. Settings
are picked for each set and number of labels, by the mean error over the draws.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from calibrate import METHODS, SETS, TESTED, Array

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "calibrate_reach.md"
SIZES = (10, 30, 300)
PENALTIES = np.logspace(-6, 3, 19)
LENGTHS = (0.3, 1.0, 2.0, 4.0, 8.0, 16.0)
LINEAR = (0.0, 0.1, 1.0, 10.0)


def scaled(x: Array, at: Array) -> tuple[Array, Array]:
    mean, spread = x.mean(axis=0), x.std(axis=0)
    spread[spread < 1e-12] = 1.0
    return (x - mean) / spread, (at - mean) / spread


def products(x: Array, degree: int) -> Array:
    """All products of up to ``degree`` columns."""
    parts = [
        x[:, list(c)].prod(axis=1)
        for d in range(1, degree + 1)
        for c in itertools.combinations_with_replacement(range(x.shape[1]), d)
    ]
    return np.stack(parts, axis=1)


def ridges(x: Array, y: Array, at: Array) -> Iterator[tuple[str, Array]]:
    x, at = scaled(x, at)
    axes = np.linalg.svd(x, full_matrices=False)[2]
    for count in sorted({x.shape[1], *(c for c in (1, 2, 3, 5, 8) if c < min(x.shape))}):
        whole = count == x.shape[1]
        a, b = (x, at) if whole else (x @ axes[:count].T, at @ axes[:count].T)
        for degree in (1, 2, 3):
            if a.shape[1] > 8 and degree > 2:
                continue
            f, g = scaled(products(a, degree), products(b, degree))
            u, d, v = np.linalg.svd(f, full_matrices=False)
            along, across = u.T @ (y - y.mean()), g @ v.T
            for weight in PENALTIES:
                name = f"ridge, degree {degree}" + ("" if whole else f", {count} components")
                yield f"{name}|{weight:.3g}", y.mean() + across @ (d / (d * d + weight * len(y)) * along)


def kernels(x: Array, y: Array, at: Array) -> Iterator[tuple[str, Array]]:
    x, at = scaled(x, at)
    level, n = y.mean(), len(y)
    near, far = (np.sqrt(np.maximum(((a[:, None] - x[None]) ** 2).sum(axis=-1), 0.0)) for a in (x, at))
    shapes = {
        "squared exponential": lambda r: np.exp(-0.5 * r * r),
        "Matern 1/2": lambda r: np.exp(-r),
        "Matern 3/2": lambda r: (1.0 + 3**0.5 * r) * np.exp(-(3**0.5) * r),
        "Matern 5/2": lambda r: (1.0 + 5**0.5 * r + 5.0 / 3.0 * r * r) * np.exp(-(5**0.5) * r),
    }
    for (name, shape), length, linear in itertools.product(shapes.items(), LENGTHS, LINEAR):
        k = shape(near / length) + linear * x @ x.T
        values, vectors = np.linalg.eigh(k)
        along, across = vectors.T @ (y - level), (shape(far / length) + linear * at @ x.T) @ vectors
        for weight in PENALTIES[:14]:
            said = f"{name}{' and linear' if linear else ''}"
            yield (
                f"{said}|{length:g} {linear:g} {weight:.3g}",
                level + across @ (along / (np.maximum(values, 0.0) + weight * n**0.5)),
            )


def measured(data: Path, draws: range) -> dict[tuple[str, int], dict[str, float]]:
    """(set, labels) -> mean held-out error of every learner with every setting."""
    out: dict[tuple[str, int], dict[str, list[float]]] = {}
    for draw, (name, maker) in itertools.product(draws, SETS.items()):
        rng = np.random.default_rng([draw, *name.encode()])
        for split in maker(data / name, rng):
            tested = rng.permutation(len(split.held_force))[:TESTED]
            truth, at = split.held_force[tested], split.held_readings[tested]
            for size in SIZES:
                k = rng.permutation(len(split.force))[:size]
                part = replace(
                    split,
                    readings=split.readings[k],
                    force=split.force[k],
                    time=None if split.time is None else split.time[k],
                    normal=None if split.normal is None else split.normal[k],
                )
                errors = out.setdefault((split.name, size), {})
                found = itertools.chain(
                    ((method, function(part, at)[0]) for method, function in METHODS.items()),
                    ridges(part.readings, part.force, at),
                    kernels(part.readings, part.force, at),
                )
                for learner, value in found:
                    errors.setdefault(learner, []).append(float(np.abs(value - truth).mean()))
        print(f"draw {draw}, {name}: done", file=sys.stderr, flush=True)
    return {key: {m: float(np.mean(v)) for m, v in e.items() if len(v) == len(draws)} for key, e in out.items()}


def report(found: dict[tuple[str, int], dict[str, float]], draws: range) -> list[str]:
    names = list(dict.fromkeys(name for name, _ in found))
    heads = " | ".join(f"{s} labels: palpate | any | by" for s in SIZES)
    lines = [
        f'Made by `python benchmarks/calibrate_reach.py --data FOLDER --first {draws.start} --draws {len(draws)}`. Errors are divided by that of the best of three regressions (linear, quadratic, Gaussian process). "Any" is the smallest error of {len(next(iter(found.values())))} learners with their settings, picked with the held-out frames, which nobody can do.',
        "",
        f"| set | {heads} |",
        "|---" * (1 + 3 * len(SIZES)) + "|",
    ]
    ratios: dict[tuple[str, int], list[float]] = {}
    for name in names:
        row = [name]
        for size in SIZES:
            errors = found[name, size]
            best = min(errors[m] for m in METHODS if m != "palpate")
            learner = min(errors, key=lambda m: errors[m])
            pair = (errors["palpate"] / best, errors[learner] / best)
            for key, value in zip(("palpate", "any"), pair):
                ratios.setdefault((key, size), []).append(value)
            row += [f"{pair[0]:.2f}", f"{pair[1]:.2f}", learner.split("|")[0]]
        lines.append("| " + " | ".join(row) + " |")
    medians = [f"{np.median(ratios[k, s]):.2f}" if k else "" for s in SIZES for k in ("palpate", "any", "")]
    return [*lines, "| **median** | " + " | ".join(medians) + " |"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with tactileforce/, melexis/ and eflesh/")
    parser.add_argument("--draws", type=int, default=2, help="draws of labels")
    parser.add_argument("--first", type=int, default=12, help="number of the first draw")
    parser.add_argument("--write", action="store_true", help=f"write {GENERATED.name}")
    given = parser.parse_args()
    draws = range(given.first, given.first + given.draws)
    lines = report(measured(given.data, draws), draws)
    print("\n".join(lines))
    if given.write:
        GENERATED.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
