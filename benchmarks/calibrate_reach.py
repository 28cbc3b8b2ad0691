"""How far any learner comes on the sets of `calibrate.py`: the smallest error of a family of learners whose settings are picked with the held-out frames.

    python benchmarks/calibrate_reach.py --data FOLDER                # holds tactileforce/, melexis/, eflesh/
    python benchmarks/calibrate_reach.py --data FOLDER --write        # docs/_generated/calibrate_reach.md

Nobody can pick settings this way, because the held-out forces are not known: the result is a lower bound for this family, on these labels and frames. It has

- ridge on products of up to three readings, of their first principal components, or on powers of each reading by itself; partial least squares;
- kernels (squared exponential, Matern 1/2, 3/2, 5/2, each alone or with a linear kernel), also of the direction of the readings, times their size;
- nearest neighbours; palpate, the three regressions of `calibrate.py`, and the mean of palpate and any other learner.

The readings enter as they are, as logarithms or as roots, with a constant or without (a map that is zero where they are). Settings are picked for each set and
number of labels. "Any" is picked and tested on the same draws, so that some of it is luck among thousands; "any, other draws" is picked on all draws but one
and tested on that one. Labels and held-out frames are those of `calibrate.py`.
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
from calibrate import METHODS, SETS, SIZES, TESTED, Array, Split

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "calibrate_reach.md"
REACHED = (10, 30, 300)
#: The two sets where palpate is worse than the best regression at 300 labels.
WORSE = ("tactileforce stream 0 to 1", "tactileforce stream 2 to 0")
LENGTHS = {"": (0.3, 1.0, 2.0, 4.0, 8.0, 16.0), "direction, ": (0.03, 0.1, 0.3, 1.0)}
LINEAR, PENALTIES = (0.0, 0.1, 1.0, 10.0), np.logspace(-6, 3, 19)
SHAPES = {
    "squared exponential": lambda r: np.exp(-0.5 * r * r),
    "Matern 1/2": lambda r: np.exp(-r),
    "Matern 3/2": lambda r: (1.0 + 3**0.5 * r) * np.exp(-(3**0.5) * r),
    "Matern 5/2": lambda r: (1.0 + 5**0.5 * r + 5.0 / 3.0 * r * r) * np.exp(-(5**0.5) * r),
}
#: Name and setting, and the forces (frame,) that it gives.
Learned = Iterator[tuple[str, Array]]


def scaled(x: Array, at: Array, constant: bool) -> tuple[Array, Array]:
    """With mean 0 and variance 1, or without a constant with mean square 1."""
    middle = x.mean(axis=0) if constant else np.zeros(x.shape[1])
    size = np.sqrt(((x - middle) ** 2).mean(axis=0))
    size[size < 1e-12] = 1.0
    return (x - middle) / size, (at - middle) / size


def products(x: Array, degree: int) -> Array:
    """All products of up to ``degree`` columns."""
    chosen = (itertools.combinations_with_replacement(range(x.shape[1]), d) for d in range(1, degree + 1))
    return np.stack([x[:, list(c)].prod(axis=1) for c in itertools.chain(*chosen)], axis=1)


def powers(x: Array, degree: int) -> Array:
    return np.concatenate([x**d for d in range(1, degree + 1)], axis=1)


def ridges(x: Array, y: Array, at: Array, constant: bool) -> Learned:
    axes = np.linalg.svd(x, full_matrices=False)[2]
    level = y.mean() if constant else 0.0
    for count in (0, *(c for c in (1, 2, 3, 5, 8) if c < min(x.shape))):
        a, b = (x @ axes[:count].T, at @ axes[:count].T) if count else (x, at)
        for degree, make in itertools.product((1, 2, 3), (products, powers)):
            if (a.shape[1] > 8 and degree > 2 and make is products) or (degree == 1 and make is powers):
                continue
            f, g = scaled(make(a, degree), make(b, degree), constant)
            u, d, v = np.linalg.svd(f, full_matrices=False)
            along, across = u.T @ (y - level), g @ v.T
            of = f", {count} components" if count else ""
            for weight in PENALTIES:
                said = f"ridge, {'degree' if make is products else 'powers'} {degree}{of}|{weight:.3g}"
                yield said, level + across @ (d / (d * d + weight * len(y)) * along)


def partial_least_squares(x: Array, y: Array, at: Array, constant: bool) -> Learned:
    level = y.mean() if constant else 0.0
    for degree in (1, 2):
        f, g = scaled(products(x, degree), products(at, degree), constant)
        value, left = np.full(len(at), level), y - level
        for count in range(1, min(10, *f.shape)):
            w = f.T @ left / (np.linalg.norm(f.T @ left) or 1.0)
            t, s = f @ w, g @ w
            if t @ t < 1e-12:
                break
            load, slope = f.T @ t / (t @ t), left @ t / (t @ t)
            f, g, left, value = f - np.outer(t, load), g - np.outer(s, load), left - slope * t, value + slope * s
            yield f"partial least squares, degree {degree}|{count}", value


def distances(a: Array, b: Array) -> Array:
    return np.sqrt(np.maximum((a**2).sum(axis=1)[:, None] - 2.0 * a @ b.T + (b**2).sum(axis=1), 0.0))


def kernels(x: Array, y: Array, at: Array, constant: bool) -> Learned:
    level, n = y.mean() if constant else 0.0, len(y)
    for of, lengths in list(LENGTHS.items())[: 1 if constant else 2]:
        s, t = [np.maximum(np.linalg.norm(a, axis=1), 1e-12) if of else np.ones(len(a)) for a in (x, at)]
        u, w, by, towards = x / s[:, None], at / t[:, None], np.outer(s, s), np.outer(t, s)
        near, far = distances(u, u), distances(w, u)
        for (name, shape), length, linear in itertools.product(SHAPES.items(), lengths, LINEAR):
            values, vectors = np.linalg.eigh(by * shape(near / length) + linear * x @ x.T)
            along, across = vectors.T @ (y - level), (towards * shape(far / length) + linear * at @ x.T) @ vectors
            said = f"{of}{name}{' and linear' if linear else ''}|{length:g} {linear:g}"
            for weight in PENALTIES[:14]:
                yield f"{said} {weight:.3g}", level + across @ (along / (np.maximum(values, 0.0) + weight * n**0.5))


def neighbours(x: Array, y: Array, at: Array) -> Learned:
    far = distances(at, x)
    order = far.argsort(axis=1)
    far, force = np.take_along_axis(far, order, axis=1), y[order]
    for count, power in itertools.product((1, 2, 3, 5, 8, 12, 20), (0.0, 1.0, 2.0)):
        if count <= len(y):
            weight = (far[:, :count] + 1e-6) ** -power
            yield f"nearest neighbours|{count} {power:g}", (weight * force[:, :count]).sum(axis=1) / weight.sum(axis=1)


def family(x: Array, y: Array, at: Array) -> Learned:
    """All learners but palpate and the three regressions."""
    unit = np.median(np.abs(x), axis=0)
    unit[unit < 1e-12] = 1.0
    views = {
        "": lambda r: r,
        ", logarithms": lambda r: np.sign(r) * np.log1p(np.abs(r) / unit),
        ", roots": lambda r: np.sign(r) * np.sqrt(np.abs(r) / unit),
    }
    for (view, change), constant in itertools.product(views.items(), (True, False)):
        a, b = scaled(change(x), change(at), constant)
        found = (make(a, y, b, constant) for make in (ridges, partial_least_squares, kernels))
        for name, value in itertools.chain(*found, neighbours(a, y, b) if constant else ()):
            said, setting = name.split("|")
            yield f"{said}{view}{'' if constant else ', no constant'}|{setting}", value


def factored(value: Array, truth: Array) -> float:
    """Mean error after the one factor on all forces that makes it smallest."""
    used = np.abs(value) > 1e-9
    factor, weight = truth[used] / value[used], np.abs(value[used])
    order = np.argsort(factor)
    until = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
    return float(np.abs(factor[order][until] * value - truth).mean())


#: (set, labels, after one factor) -> mean held-out error in each draw, of every learner with every setting.
Errors = dict[tuple[str, int, bool], dict[str, list[float]]]


def learned(part: Split, at: Array) -> Learned:
    plain = {m: function(part, at)[0] for m, function in METHODS.items()}
    yield from plain.items()
    others = ((m, v) for m, v in plain.items() if m != "palpate")
    for learner, value in itertools.chain(others, family(part.readings, part.force, at)):
        if learner not in plain:
            yield learner, value
        yield f"palpate and {learner}", 0.5 * (plain["palpate"] + value)


def measured(data: Path, draws: range) -> Errors:
    out: Errors = {}
    for draw, (name, maker) in itertools.product(draws, SETS.items()):
        rng = np.random.default_rng([draw, *name.encode()])
        for split in maker(data / name, rng):
            tested = rng.permutation(len(split.held_force))[:TESTED]
            truth, at = split.held_force[tested], split.held_readings[tested]
            # drawn for every size, so that the labels are those of calibrate.py
            drawn = {size: rng.permutation(len(split.force))[:size] for size in SIZES}
            for size, k in ((size, drawn[size]) for size in REACHED):
                time, normal = (None if v is None else v[k] for v in (split.time, split.normal))
                part = replace(split, readings=split.readings[k], force=split.force[k], time=time, normal=normal)
                for learner, value in learned(part, at):
                    error = float(np.abs(value - truth).mean())
                    out.setdefault((split.name, size, False), {}).setdefault(learner, []).append(error)
                    if split.name in WORSE:
                        error = factored(value, truth)
                        out.setdefault((split.name, size, True), {}).setdefault(learner, []).append(error)
        print(f"draw {draw}, {name}: done", file=sys.stderr, flush=True)
    return {key: {m: v for m, v in e.items() if len(v) == len(draws)} for key, e in out.items()}


def report(found: Errors, draws: range) -> list[str]:
    names = list(dict.fromkeys(name for name, _, _ in found))
    mean = {key: {m: float(np.mean(v)) for m, v in e.items()} for key, e in found.items()}
    best = {key: min(e[m] for m in METHODS if m != "palpate") for key, e in mean.items()}
    any_of = {key: min(e, key=e.__getitem__) for key, e in mean.items()}
    left_out = {}
    for key, errors in found.items():
        table = np.array(list(errors.values()))  # (learner, draw)
        picked = (table.sum(axis=1, keepdims=True) - table).argmin(axis=0)
        left_out[key] = float(table[picked, np.arange(len(draws))].mean()) if len(draws) > 1 else np.nan
    lines = [
        "# How far any learner comes with few labels\n",
        f'Made by `python benchmarks/calibrate_reach.py --data FOLDER --first {draws.start} --draws {len(draws)}`: means over {len(draws)} draws of labels. Errors are divided by that of the best of three regressions (linear, quadratic, Gaussian process). "Any" is the smallest error of {min(map(len, found.values()))} learners with their settings, picked with the held-out frames, which nobody can do. "Any, other draws" is picked with the held-out frames of the other draws.',
        "",
        "| set | labels | best of three [N] | palpate | any | by | any, other draws |\n" + "|---" * 7 + "|",
    ]
    ratios = {}
    for name, size in itertools.product(names, REACHED):
        key = (name, size, False)
        ratios[key] = [e / best[key] for e in (mean[key]["palpate"], mean[key][any_of[key]], left_out[key])]
        (a, b, c), by = ratios[key], any_of[key].split("|")[0]
        lines.append(f"| {name} | {size} | {best[key]:.2f} | {a:.2f} | {b:.2f} | {by} | {c:.2f} |")
    for size in REACHED:
        a, b, c = np.median([ratios[n, size, False] for n in names], axis=0)
        lines.append(f"| **median** | {size} | | {a:.2f} | {b:.2f} | | {c:.2f} |")
    for said, measure in (("median", np.median), ("error on its worst set", np.max)):
        lines += ["", f"One learner with one setting for all sets, picked for the smallest {said}: "]
        for size in REACHED:
            keys = [(n, size, False) for n in names]
            common = [m for m in mean[keys[0]] if all(m in mean[key] for key in keys)]
            over = {m: float(measure([mean[key][m] / best[key] for key in keys])) for m in common}
            one = min(over, key=over.__getitem__)
            lines[-1] += f"{size} labels {over[one]:.2f} ({one.split('|')[0]}){'; ' if size != REACHED[-1] else '.'}"
    lines += [
        "",
        'Two streams, with all forces of a learner multiplied by the factor that suits the held-out frames best; the best of three and "any" are picked after this. Errors are divided by that of the best of three before it.',
        "",
        "| set | labels | palpate | best of three | any |\n" + "|---" * 5 + "|",
    ]
    for name, size in itertools.product(WORSE, REACHED):
        whole, after = best[name, size, False], mean[name, size, True]
        three = (after["palpate"], best[name, size, True], min(after.values()))
        lines.append(f"| {name} | {size} | " + " | ".join(f"{e / whole:.2f}" for e in three) + " |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with tactileforce/, melexis/ and eflesh/")
    parser.add_argument("--draws", type=int, default=3, help="draws of labels")
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
