"""How long before gross slip the monitor warns, and how often it cries wolf, against a plain threshold on Q/P.

python benchmarks/slip.py [--runs 50] [--jobs 1]

Each run: a ball of random size, force, place and direction of drag is pressed on a 16 x 16 array of shear and pressure taxels, held,
sheared to 0.4 of the friction limit, held there for a second (a firm hold: any alarm in it is false) and then dragged to gross slip
at a steady rate (Cattaneo-Mindlin). Noise as a part of the largest reading. The zero and the noise are learned from 20 frames.
"""

from __future__ import annotations

import argparse
import itertools
import math
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np

import palpate as pp
from palpate import simulation
from palpate.grasp import GraspMonitor

FRICTIONS = (0.25, 0.4, 0.55, 0.8, 1.1)
NOISES = (0.003, 0.01, 0.03)
THRESHOLDS = (0.2, 0.35, 0.5)
RATE, HOLD, RAMP = 100.0, 1.0, 1.0


def one(task: tuple[float, float, int]) -> dict[str, tuple[float, int]]:
    """(lead before gross slip [s], NaN if missed; false alarms) of each detector."""
    friction, noise, seed = task
    rng = np.random.default_rng([seed, int(1000 * friction), int(1e4 * noise)])
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.49)
    array = pp.AreaArray(shape=(16, 16), pitch=1.2e-3, depth=1.6e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pad, array)
    force, radius = float(rng.uniform(0.5, 2.0)), float(rng.uniform(8e-3, 25e-3))
    turn, place = float(rng.uniform(0, 2 * math.pi)), tuple(float(v) for v in rng.uniform(-2e-3, 2e-3, 2))
    stages = [
        simulation.Stage("rest", 0.3, 0.0),
        simulation.Stage("press", 0.3, force),
        simulation.Stage("hold", 0.2, force),
        simulation.Stage("load", 0.3, force, drag=0.4, direction=turn),
        simulation.Stage("firm", HOLD, force, drag=0.4, direction=turn),
        simulation.Stage("shear", RAMP, force, drag=0.999, direction=turn),
        simulation.Stage("slide", 0.3, force, drag=1.0, direction=turn),
    ]
    frames = list(simulation.stream(skin, stages, friction=friction, radius=radius, rate=RATE, start=place))  # type: ignore[arg-type]
    size = noise * max(float(np.abs(np.asarray(f.readings)).max()) for f in frames if f.stage == "hold")
    noisy = [np.asarray(f.readings) + size * rng.standard_normal(array.shape) for f in frames]
    gross = next(f.time for f in frames if f.sliding)
    firm = [f.stage in ("rest", "hold", "firm") for f in frames]
    out: dict[str, tuple[float, int]] = {}
    for name, mu in (("monitor", None), ("monitor, friction given", friction)):
        tracker = skin.track(baseline=20, friction=mu, rate=RATE)
        monitor = GraspMonitor(friction=mu)
        alarms, ratios = [], []
        for frame, reading in zip(frames, noisy):
            touch = tracker.step(reading, frame.time)
            monitor.update(touch)
            alarms.append("incipient slip" in monitor.going_on())
            ratios.append(float(np.hypot(*touch.force[:2]) / touch.force[2]) if touch.force[2] > 0 else 0.0)
        out[name] = _score(alarms, frames, firm, gross)
        if mu is None:
            for limit in THRESHOLDS:
                out[f"Q/P > {limit}"] = _score([r > limit for r in ratios], frames, firm, gross)
    return out


def _score(on: list[bool], frames: list[Any], firm: list[bool], gross: float) -> tuple[float, int]:
    """Lead of the alarm in the drag, and how many alarms touch a firm hold."""
    spells = itertools.groupby(zip(on, firm), key=lambda pair: pair[0])
    false = sum(any(f for _, f in spell) for alarm, spell in spells if alarm)
    begins = next(f.time for f in frames if f.stage == "shear")
    times = [f.time for a, f in zip(on, frames) if a and begins <= f.time < gross]
    return (gross - times[0], false) if times else (math.nan, false)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    tasks = list(itertools.product(FRICTIONS, NOISES, range(args.runs)))
    if args.jobs == 1:
        found = [one(t) for t in tasks]
    else:
        with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(one, tasks, chunksize=4))
    minutes = args.runs * (HOLD + 0.5) / 60.0
    print(f"{'detector':<26}{'friction':>9}{'noise':>8}{'median lead':>13}{'10 %':>8}{'missed':>8}{'false/min':>11}")
    for name in found[0]:
        for friction, noise in itertools.product(FRICTIONS, NOISES):
            some = [f[name] for t, f in zip(tasks, found) if t[0] == friction and t[1] == noise]
            leads = np.array([s[0] for s in some])
            missed = float(np.isnan(leads).mean())
            known = leads[~np.isnan(leads)]
            middle, low = (float(np.quantile(known, q)) if len(known) else math.nan for q in (0.5, 0.1))
            print(
                f"{name:<26}{friction:>9}{noise:>8}{middle:>11.2f} s{low:>8.2f}{100 * missed:>7.0f}%"
                f"{sum(s[1] for s in some) / minutes:>11.2f}"
            )
        leads = np.array([f[name][0] for f in found])
        print(
            f"{name:<26}{'all':>9}{'all':>8}{np.nanmedian(leads):>11.2f} s{np.nanquantile(leads, 0.1):>8.2f}"
            f"{100 * np.isnan(leads).mean():>7.0f}%{sum(f[name][1] for f in found) / (minutes * len(FRICTIONS) * len(NOISES)):>11.2f}"
        )


if __name__ == "__main__":
    main()
