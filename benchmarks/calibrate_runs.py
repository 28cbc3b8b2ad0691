"""Calibrated on one or two runs of a published sensor, asked about another run: error, coverage and width of the 95 % intervals.

    python benchmarks/calibrate_runs.py --data FOLDER            # holds tactileforce/ and eflesh/
    python benchmarks/calibrate_runs.py --data FOLDER --write    # docs/_generated/calibrate_runs.md

A hundred labels, half spread over time and half over force; four hundred frames of the other run. The regressions learn from the same labels. "Pressed": frames above a twentieth of its largest force.

"Gain of the run": the factor on the forces that fits the other run best. The errors beside it are those that remain after this factor, and after a factor on each reading
(found by least squares, with a prior of 1 +- 0.3): what a calibration could gain at most that knew them.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.optimize
import scipy.special

import palpate as pp
from palpate.calibrate import ForceMap, likely_maps
from palpate.calibrate.forcemap import usual_scale
from palpate.calibrate.labels import press_numbers, spread_over
from palpate.calibrate.process import Process
from palpate.calibrate.run import RunLabels

sys.path.insert(0, str(Path(__file__).parent))
from real import bonded

from calibrate import METHODS, Array, Split, eflesh, ridge

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "calibrate_runs.md"
LABELS, ASKED = 100, 400
PRIOR_GAIN = 0.3
Run = tuple[Array, Array, Array | None]  # readings (frame, reading) without their zero, force (frame,), time (frame,)


def streams(folder: Path) -> list[Run]:
    out: list[Run] = []
    for i in range(3):
        table = np.loadtxt(folder / f"stream-{i}.csv", delimiter=",", skiprows=1)
        zero = table[:30].mean(axis=0)
        out.append((table[:, 1:5][:, [0, 3, 1, 2]] - zero[1:5][[0, 3, 1, 2]], table[:, 0] - zero[0], table[:, 5]))
    return out


def cases(data: Path) -> Iterator[tuple[str, pp.Skin, int, list[Run], Run]]:
    """Name, skin, component of the force, runs that are labelled, the run that is asked."""
    skin = pp.Skin(bonded(8e-3, 1e5), pp.AreaArray(shape=(2, 2), pitch=12e-3, depth=8e-3, channels=["stress_zz"]))
    runs = streams(data / "tactileforce")
    for i, j in itertools.permutations(range(3), 2):
        yield f"tactileforce, stream {i} to {j}", skin, 2, [runs[i]], runs[j]
    for i, (readings, force, time) in enumerate(runs):
        half = len(force) // 2
        first = readings[:half], force[:half], None if time is None else time[:half]
        yield (
            f"tactileforce, first half of stream {i} to its second",
            skin,
            2,
            [first],
            (readings[half:], force[half:], None),
        )
    for i in range(3):
        a, b = (j for j in range(3) if j != i)
        yield f"tactileforce, streams {a} and {b} to {i}", skin, 2, [runs[a], runs[b]], runs[i]
    for split in eflesh(data / "eflesh", np.random.default_rng(0)):
        run = split.readings, split.force, split.time
        yield split.name, split.skin, split.component, [run], (split.held_readings, split.held_force, None)


def fitted(skin: pp.Skin, component: int, runs: list[Run]) -> ForceMap:
    """The map that `palpate.calibrate` makes of these runs; its labels are in `ForceMap.process`."""
    chosen = [(run, spread_over(run[1], LABELS // len(runs))) for run in runs]
    readings, force = (np.concatenate([run[i][at] for run, at in chosen]) for i in (0, 1))  # type: ignore[index]
    number = np.concatenate([np.full(len(at), i) for i, (_, at) in enumerate(chosen)])
    timed = all(run[2] is not None for run in runs)
    time = np.concatenate([run[2][at] + 1e6 * i for i, (run, at) in enumerate(chosen)]) if timed else None  # type: ignore[index]
    likely = likely_maps(skin.pad, skin.planes, skin.surface, np.random.default_rng(41))
    press = press_numbers(time, force, number)
    return ForceMap.fit(
        Process(
            readings,
            force,
            np.zeros(len(force)),
            usual_scale(readings),
            None if likely is None else likely[component],
            press,
            time,
            number,
        )
    )


def gained(found: ForceMap, readings: Array, force: Array) -> tuple[float, float, float]:
    """Gain of the run, and mean error [N] that remains after it, and after a gain for each reading."""
    value = found.predict(readings)[0]
    gain = float(value @ force / (value @ value))
    error = np.abs(gain * value - force)
    # the prior weighs as much as one frame of the usual error for each standard deviation
    usual = float(np.sqrt((error**2).mean()))

    def left(gains: Array) -> Array:
        return np.r_[found.predict(readings * gains)[0] - force, usual * (gains - 1.0) / PRIOR_GAIN]

    fitted_gains = scipy.optimize.least_squares(left, np.ones(readings.shape[1]), max_nfev=5).fun[: len(force)]
    return gain, float(error.mean()), float(np.abs(fitted_gains).mean())


def rows(data: Path) -> list[str]:
    lines = [
        "Made by `python benchmarks/calibrate_runs.py --data FOLDER`.",
        "",
        "| calibrated on, tested on | mean error [N] | inside the 95 % interval | pressed frames inside | width over force, median | linear [N] | quadratic [N] | process [N] | gain of the run | error after removing this gain [N] | error after a gain for each reading [N] |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, skin, component, runs, (readings, force, _) in cases(data):
        found = fitted(skin, component, runs)
        at = np.linspace(0, len(force) - 1, ASKED).astype(int)
        value, std = found.predict(readings[at])
        half = float(scipy.special.stdtrit(found.freedom, 0.975)) * std
        held, pressed = np.abs(value - force[at]) <= half, np.abs(force[at]) > 0.05 * np.abs(force).max()
        width = float(np.median(2.0 * half[pressed] / np.abs(force[at][pressed])))
        labels = found.process
        split = Split(name, skin, component, labels.readings, labels.values, labels.time, readings[at], force[at])
        plain = [
            np.abs(METHODS[m](split, readings[at])[0] - force[at]).mean() for m in ("linear", "quadratic", "process")
        ]
        lines.append(
            f"| {name} | {np.abs(value - force[at]).mean():.3f} | {held.mean():.2f} | {held[pressed].mean():.2f} | {width:.2f} | "
            + " | ".join(f"{error:.3f}" for error in (*plain, *gained(found, readings[at], force[at])))
            + " |"
        )
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def run_presses(run: Run) -> list[Array]:
    """Frames near the largest force of each press of a run; a run without releases is cut into pieces."""
    _readings, force, time = run
    piece = press_numbers(time, force, np.zeros(len(force), dtype=np.int64))
    found = [np.flatnonzero(piece == p) for p in np.unique(piece)]
    found = [at[force[at] > 0.9 * force[at].max()] for at in found]
    return [at for at in found if force[at].max() > 0.3 * force.max()]


def labelled_rows(data: Path, seeds: range) -> list[str]:
    """Error and coverage on a run of which some presses have one labelled frame each."""
    lines = [
        "",
        f"Error with one labelled frame in each of some presses of the test run (`this_run=True`): means over {len(seeds)} draws of these presses; the error is on frames of the other presses. The regression has the labels of both runs; the last column is the regression of the first run, times the factor that fits the labels of the second.",
        "",
        "| calibrated on, tested on | labels of the new run | mean error [N] | inside the 95 % interval | linear [N] | linear times factor [N] |",
        "|---|---|---|---|---|---|",
    ]
    runs = streams(data / "tactileforce")
    skin = pp.Skin(bonded(8e-3, 1e5), pp.AreaArray(shape=(2, 2), pitch=12e-3, depth=8e-3, channels=["stress_zz"]))
    pairs = [
        (f"tactileforce, stream {i} to {j}", skin, 2, runs[i], runs[j]) for i, j in itertools.permutations(range(3), 2)
    ]
    for split in itertools.islice(eflesh(data / "eflesh", np.random.default_rng(0)), 2):
        first = split.readings, split.force, split.time
        pairs.append((split.name, split.skin, split.component, first, (split.held_readings, split.held_force, None)))
    for name, skin, component, first, (readings, force, time) in pairs:
        base = fitted(skin, component, [first])
        old = base.process
        where = run_presses((readings, force, np.arange(len(force)) / 30.0 if time is None else time))
        found: dict[int, list[list[float]]] = {0: [], 1: [], 3: []}
        for seed in seeds:
            rng = np.random.default_rng([seed, *name.encode()])
            chosen = [int(rng.choice(where[k])) for k in rng.permutation(len(where))[:3]]
            close = np.concatenate([at for at in where if np.isin(chosen, at).any()])
            asked = np.setdiff1d(np.arange(len(force)), close)
            asked = asked[np.linspace(0, len(asked) - 1, ASKED).astype(int)]
            for count, held in found.items():
                at = np.array(chosen[:count], dtype=int)
                told = RunLabels(readings[at], force[at], np.zeros(count), np.arange(count))
                value, std = (replace(base, this_run=told) if count else base).predict(readings[asked])
                half = float(scipy.special.stdtrit(base.freedom, 0.975)) * std
                x, y = np.concatenate([old.readings, readings[at]]), np.concatenate([old.values, force[at]])
                plain, known = (ridge(old.readings, old.values, r)[0] for r in (readings[asked], readings[at]))
                factor = float(known @ force[at] / (known @ known)) if count else 1.0
                both = ridge(x, y, readings[asked])[0]
                off = [np.abs(v - force[asked]) for v in (value, both, factor * plain)]
                held.append([off[0].mean(), (off[0] <= half).mean(), off[1].mean(), off[2].mean()])
        for count, held in found.items():
            error, inside, both, scaled = np.mean(held, axis=0)
            lines.append(f"| {name} | {count} | {error:.3f} | {inside:.2f} | {both:.3f} | {scaled:.3f} |")
            print(lines[-1], file=sys.stderr, flush=True)
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with tactileforce/ and eflesh/")
    parser.add_argument(
        "--first", type=int, default=100, help="first seed of the presses that are labelled in the new run"
    )
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--write", action="store_true", help=f"write {GENERATED.name}")
    args = parser.parse_args()
    text = "\n".join([*rows(args.data), *labelled_rows(args.data, range(args.first, args.first + args.draws))]) + "\n"
    print(text)
    if args.write:
        GENERATED.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
