"""The tracker: time a frame, distance from the batch reconstruction and from the truth, memory over long streams.

python benchmarks/tracking.py [--frames 12000] [--size 32]
python benchmarks/tracking.py --long 720000        an hour at 200 Hz, as fast as it goes, through tracker, monitor and live packets

A simulated finger presses, rolls, twists, is dragged until it slides, and lifts, over and over (`palpate.simulation.handling`), on an
array of shear and pressure taxels with 1 % noise, friction known. One thread for arithmetic: set OPENBLAS_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate import simulation
from palpate.sensing.uncertainty import EXACT

FRICTION = 0.6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=12_000)
    parser.add_argument("--size", type=int, default=32)
    parser.add_argument("--rate", type=float, default=200.0)
    parser.add_argument(
        "--long", type=int, default=0, help="frames of a long stream, in 12 parts, instead of the comparison"
    )
    args = parser.parse_args()
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(
        shape=(args.size, args.size), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"]
    )
    skin = pp.Skin(pad, array, uncertainty=EXACT)
    story = list(
        simulation.stream(
            skin, simulation.handling(1.0, 0.05e-3 * args.size), friction=FRICTION, radius=20e-3, rate=args.rate
        )
    )
    clean = np.stack([np.asarray(f.readings) for f in story]).astype(np.float32)
    size = float(0.01 * np.abs(clean).max())
    print(f"{len(story)} frames of a story at {args.rate:g} Hz, {args.size} x {args.size} x 3, noise {size:.3g} Pa")
    if args.long:
        _long(skin, clean, size, args.long, args.rate)
        return
    for budget in (None, 0.8 / args.rate):
        start = time.perf_counter()
        tracker = skin.track(friction=FRICTION, baseline=20, rate=args.rate, budget=budget)
        prepared = time.perf_counter() - start
        rng = np.random.default_rng(0)
        seconds, halves, contact = [], [], []
        worst: list[tuple[float, ...]] = []
        alone = 0
        for i in range(args.frames):
            frame = story[i % len(story)]
            reading = clean[i % len(story)] + size * rng.standard_normal(clean[0].shape).astype(np.float32)
            touch = tracker.step(reading, i / args.rate)
            seconds.append(tracker.seconds)
            contact.append(bool(touch.touching))
            if budget is not None and tracker.seconds < 1.0 / args.rate:
                time.sleep(1.0 / args.rate - tracker.seconds)
            if i in (args.frames // 2, args.frames - 1):
                halves.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
            if budget is None and i < len(story) and i % 25 == 0 and touch.touching:
                compared = _compare(skin, reading, touch, frame)
                if compared is None:
                    alone += 1
                else:
                    worst.append(compared)
        ms = 1e3 * np.array(seconds)[20:]
        busy = ms[np.array(contact)[20:]]
        label = "no budget" if budget is None else f"budget {1e3 * budget:g} ms, paced"
        quantiles = np.percentile(ms, [50, 99, 99.9, 100])
        print(
            f"{label:<22} prepared {prepared:.1f} s; a frame: p50 {quantiles[0]:.2f}, p99 {quantiles[1]:.2f}, p99.9 {quantiles[2]:.1f}, "
            f"most {quantiles[3]:.1f} ms; in contact p50 {np.median(busy):.2f}, mean {busy.mean():.2f} ms; later than the next frame "
            f"{100 * (ms > 1e3 / args.rate).mean():.2f} %; {tracker.health}"
        )
        tenth = len(ms) // 10
        print(
            f"{'':<22} p50 of the first and last tenth {np.median(ms[:tenth]):.2f}, {np.median(ms[-tenth:]):.2f} ms; memory at "
            f"half and at the end {halves[0]:.0f}, {halves[-1]:.0f} MB"
        )
        if alone:
            print(f"{'':<22} in {alone} of {alone + len(worst)} frames compared the batch finds nothing")
        if any(row[0] > 0.3 for row in worst):
            table = np.array(worst)
            loaded = table[table[:, 0] > 0.3]
            for whose, held in (("its own model", 0.0), ("models of a single solve", 1.0)):
                some = loaded[loaded[:, 8] == held]
                if len(some):
                    print(
                        f"{'':<22} {whose} against the batch, {len(some)} loads above 0.3 N: relative L2 difference largest "
                        f"{some[:, 1].max():.3f}, median {np.median(some[:, 1]):.3f}; net force largest {some[:, 2].max():.3f}"
                    )
            print(
                f"{'':<22} error against the truth, median: tracker {np.median(loaded[:, 3]):.3f}, constrained "
                f"{np.median(loaded[:, 4]):.3f}, adaptive {np.median(loaded[:, 5]):.3f}; true normal force in its 95 % interval "
                f"{np.mean(loaded[:, 6]):.2f}, in its 50 % interval {np.mean(loaded[:, 7]):.2f}; "
                f"model error allowed for, median {np.median(loaded[:, 9]):.3f} of the load"
            )
        tracker.close()


def _long(skin: pp.Skin, clean: Any, size: float, count: int, rate: float) -> None:
    """Latency and memory over a long stream, part by part."""
    from palpate.live import Session

    tracker = skin.track(friction=FRICTION, baseline=20, rate=rate)
    part = count // 12
    seconds: list[float] = []

    def frames() -> Iterator[tuple[float, Any]]:
        rng = np.random.default_rng(0)
        begun = time.perf_counter()
        for i in range(count):
            noise = rng.standard_normal(clean[0].shape, dtype=np.float32)
            yield i / rate, clean[i % len(clean)] + size * noise
            seconds.append(tracker.seconds)
            if len(seconds) == part:
                ms = np.percentile(1e3 * np.array(seconds), [50, 99, 99.9])
                resident = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20
                now = time.perf_counter()
                print(
                    f"  frames to {i + 1:>7}: p50 {ms[0]:.3f}, p99 {ms[1]:.2f}, p99.9 {ms[2]:.1f} ms; {part / (now - begun):.0f} frames/s; "
                    f"resident {resident:.1f} MB",
                    flush=True,
                )
                seconds.clear()
                begun = now

    session = Session(skin, frames, tracker, pp.GraspMonitor(friction=FRICTION), pace=False)
    session.run()
    print(f"  {tracker.health}")
    session.stop()


def _compare(skin: pp.Skin, reading: Any, touch: pp.Touch, frame: simulation.Frame) -> tuple[float, ...] | None:
    """A frame against the batch and the truth; None where the batch finds no contact to compare with."""
    same = skin.reconstruct(reading, method="constrained", friction=FRICTION, parameter=float(touch.parameter))  # type: ignore[arg-type]
    best = skin.reconstruct(reading, friction=FRICTION)
    size = float(np.linalg.norm(same.values))
    if size == 0.0 or not same.force[2] > 0.0:
        return None
    truth = float(np.linalg.norm(frame.traction))
    errors = [float(np.linalg.norm(np.asarray(t.values) - frame.traction)) / truth for t in (touch, same, best)]
    load = float(frame.traction[2].sum()) * skin.surface.cell
    inside = []
    for level in (0.95, 0.5):
        low, high = touch.interval(level, "force")
        inside.append(float(low[2] <= load <= high[2]))
    return (
        load,
        float(np.linalg.norm(touch.values - same.values)) / size,
        float(np.abs(touch.force - same.force).max() / same.force[2]),
        *errors,
        *inside,
        float(touch.method != "constrained"),
        float(touch.discrepancy),  # type: ignore[arg-type]
    )


if __name__ == "__main__":
    main()
