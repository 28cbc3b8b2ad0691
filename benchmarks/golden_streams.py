"""A golden record of streams: what a tracker answers to some thirty streams of known force, recorded from one commit and compared with another.

python benchmarks/golden_streams.py record FILE.npz [--only NAME,NAME]     answers of this checkout
python benchmarks/golden_streams.py compare FILE.npz [--only NAME] [--each]          answers of this checkout beside those of the file
python benchmarks/golden_streams.py times [--sizes 8,32] [--against OTHER/src]       p50, p99, p99.9 of a step, and steps a second

In: skins of 2 x 2 to 32 x 32 taxels, lines, with and without friction; presses, slides, a zero captured at the start, offsets that drift, dead taxels,
a restarted clock, a gap, saturation, pulls; with --data, two published recordings. Out: force, its interval, status, fit, events and notes of every frame,
and the force that acts. A frame differs where its status, its events or its notes do, or its force by more than the given part of its interval's half width.
The interval holds the truth or not: the summary counts this of both sides, so that a difference can be judged by the force that acts.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate import solutions
from palpate.errors import PalpateError
from palpate.grasp import GraspMonitor
from palpate.sensing.uncertainty import EXACT
from palpate.status import Status

THREE = ["stress_xz", "stress_yz", "stress_zz"]
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
REST = 10
RATE = 100.0


@dataclass
class Stream:
    """Readings frame by frame (frame, channel, *array), the normal force that acts (frame,) in N or N/m (NaN: unknown), and times [s]."""

    skin: pp.Skin
    readings: np.ndarray
    force: np.ndarray
    options: dict[str, Any] = field(default_factory=dict)
    times: np.ndarray | None = None


def bonded(thickness: float, modulus: float = 2e5) -> pp.BondedLayers:
    return pp.BondedLayers([pp.Layer(thickness=thickness, youngs_modulus=modulus, poissons_ratio=0.48)])


def area(n: int, *, depth: float = 1.5e-3, pad: Any = PAD, channels: Any = THREE, **more: Any) -> pp.Skin:
    array = pp.AreaArray(shape=(n, n), pitch=1e-3, depth=depth, channels=channels, **more)
    return pp.Skin(pad, array, uncertainty=EXACT)


def ball(skin: pp.Skin, radius: float = 2e-3, x: float = 0.0, y: float = 0.0, drag: float = 0.0) -> np.ndarray:
    """Readings of 1 N."""
    contact = solutions.hertz_point(contact_radius=radius, force=1.0).shifted(x, y)
    traction = np.asarray(skin.sample(contact))
    traction = traction / (traction[-1].sum() * skin.surface.cell)
    if len(traction) == 3:
        traction[0] = drag * traction[2]
    return np.asarray(skin.sense(traction))


def noisy(clean: np.ndarray, seed: int, part: float = 0.01) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return clean + part * np.abs(clean).max() * rng.standard_normal(clean.shape)


#: Force of the usual story [N]: rest, a press in four frames, held, let go, rest.
STORY = np.r_[np.zeros(REST + 4), np.linspace(0.25, 1.0, 4), np.ones(26), np.linspace(0.7, 0.0, 4), np.zeros(8)]


def press(
    skin: pp.Skin, seed: int, *, part: float = 0.01, options: dict[str, Any] | None = None, **more: Any
) -> Stream:
    return Stream(
        skin,
        noisy(STORY[:, None, None, None] * ball(skin, **more), seed, part),
        STORY.copy(),
        {"baseline": REST, **(options or {})},
    )


def slide(skin: pp.Skin, seed: int, friction: float | None) -> Stream:
    out = press(skin, seed, options={"friction": friction})
    clean = np.stack(
        [f * ball(skin, x=1.5e-3 * k / len(STORY), drag=min(0.4, 0.02 * max(k - 20, 0))) for k, f in enumerate(STORY)]
    )
    out.readings = noisy(clean, seed)
    return out


def changed(stream: Stream, change: Callable[[np.ndarray], None]) -> Stream:
    change(stream.readings)
    return stream


def drifting(n: int, seed: int) -> Stream:
    """The shear and normal offsets drift while a ball holds; then it goes."""
    out = press(area(n), seed)
    top = np.abs(out.readings).max()
    out.readings += (0.002 * top * np.arange(len(STORY)))[:, None, None, None] * np.array([1.0, -0.5, 0.7])[
        :, None, None
    ]
    return out


def jumped(seed: int) -> Stream:
    """The clock restarts in contact, and the zero has jumped with it."""
    out = press(area(8), seed)
    out.readings[30:] += 0.1 * np.abs(out.readings).max() * np.array([1.0, -1.0, 0.5])[:, None, None]
    out.times = np.r_[np.arange(30), np.arange(len(STORY) - 30)] / RATE
    return out


def gap(seed: int) -> Stream:
    out = press(area(8), seed)
    out.times = np.arange(len(STORY)) / RATE
    out.times[32:] += 3.0
    return out


def line(seed: int, count: int = 41, part: float = 0.01) -> Stream:
    array = pp.LineArray(count=count, pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_zz"])
    skin = pp.Skin(PAD, array, uncertainty=EXACT)
    clean = np.asarray(skin.sense(solutions.hertz_line(half_width=4e-3, force=1.0)))
    return Stream(skin, noisy(STORY[:, None, None] * clean, seed, part), STORY.copy(), {"baseline": REST})


def saturated(seed: int, end: float) -> Stream:
    skin = area(8)
    top = float(np.abs(ball(skin)).max())
    limited = area(8, limits=(-end * top, end * top))
    out = press(skin, seed)
    return Stream(limited, np.clip(out.readings, -end * top, end * top), out.force, out.options)


def stiff_edge(seed: int, more: float) -> Stream:
    """A pad of 5 x 5 taxels that is stiffer than its model at one side: the sensor's own pad is no half-space."""
    skin = area(5, pad=bonded(4e-3))
    out = press(skin, seed, radius=1.5e-3)
    x = np.linspace(-1.0, 1.0, 5)
    out.readings *= 1.0 + more * np.exp(-((x - 1.0) ** 2))[None, None, None, :]
    return out


def without_zero(seed: int) -> Stream:
    out = press(area(8), seed)
    out.readings, out.force = out.readings[REST:], out.force[REST:]
    out.options = {}
    return out


def with_noise(n: int, seed: int, friction: float | None) -> Stream:
    one = ball(area(n))
    skin = area(n, noise=0.01 * float(np.abs(one).max()))
    out = press(skin, seed, options={"friction": friction})
    out.readings, out.force = out.readings[REST:], out.force[REST:]
    out.options = {"friction": friction}
    return out


def real(data: Path, name: str) -> Stream:
    sys.path.insert(0, str(Path(__file__).parent))
    import real as recorded

    if name == "real four barometers":
        found = next(recorded.four_barometers(data / "tactileforce", 40))
    else:
        found = next(recorded.five_magnetometers(data / "eflesh", 40))
    readings = np.concatenate([found.rest, found.frames])
    force = np.r_[np.zeros(len(found.rest)), found.force]
    return Stream(found.skin, readings, force, {"baseline": len(found.rest), "rate": found.rate})


def wipe(frames: slice, value: float, *place: Any) -> Callable[[np.ndarray], None]:
    def change(readings: np.ndarray) -> None:
        readings[(frames, *place)] = value

    return change


def negative(readings: np.ndarray) -> None:
    readings *= -1.0


STREAMS: dict[str, Callable[[], Stream]] = {
    "press 2 x 2 x 1": lambda: press(area(2, channels=["stress_zz"]), 1),
    "press 3 x 3 x 3": lambda: press(area(3), 2),
    "press 4 x 4 x 3": lambda: press(area(4), 3),
    "press 4 x 4 x 3 friction": lambda: press(area(4), 4, options={"friction": 0.6}),
    "press 5 x 5 x 3 bonded": lambda: press(area(5, pad=bonded(4e-3)), 5),
    "press 6 x 6 x 1": lambda: press(area(6, channels=["stress_zz"]), 6),
    "press 8 x 8 x 3": lambda: press(area(8), 7),
    "press 8 x 8 x 3 friction": lambda: press(area(8), 8, options={"friction": 0.6}),
    "press 8 x 8 x 3 off the middle": lambda: press(area(8), 9, x=3e-3, y=-2e-3),
    "press 8 x 8 x 3 quiet": lambda: press(area(8), 10, part=0.001),
    "press 8 x 8 x 3 loud": lambda: press(area(8), 11, part=0.05),
    "press 16 x 16 x 3": lambda: press(area(16), 12, radius=3e-3),
    "press 24 x 24 x 3 friction": lambda: press(area(24, depth=2e-3), 13, radius=4e-3, options={"friction": 0.6}),
    "press 32 x 32 x 3": lambda: press(area(32, depth=2e-3), 14, radius=4e-3),
    "small contact 8 x 8 x 3": lambda: press(area(8, depth=1e-3), 15, radius=0.7e-3),
    "noise given 8 x 8 x 3": lambda: with_noise(8, 16, None),
    "noise given 8 x 8 x 3 friction": lambda: with_noise(8, 17, 0.6),
    "no zero taken": lambda: without_zero(18),
    "slide 8 x 8 x 3": lambda: slide(area(8), 19, None),
    "slide 8 x 8 x 3 friction": lambda: slide(area(8), 20, 0.5),
    "drift 8 x 8 x 3": lambda: drifting(8, 21),
    "drift 10 x 10 x 3": lambda: drifting(10, 22),
    "dead taxel": lambda: changed(press(area(8), 23), wipe(slice(14, None), 0.0, slice(None), 4, 4)),
    "dead patch, NaN": lambda: changed(
        press(area(10), 24), wipe(slice(28, None), math.nan, slice(None), slice(4, 7), slice(4, 7))
    ),
    "garbage for three frames": lambda: changed(
        press(area(8), 25), wipe(slice(30, 33), 1e6, slice(None), slice(0, 8, 2))
    ),
    "restart, zero jumped": lambda: jumped(26),
    "gap": lambda: gap(27),
    "few at their end": lambda: saturated(28, 0.85),
    "all at their end": lambda: saturated(29, 0.05),
    "pull": lambda: changed(press(area(8), 30), negative),
    "line 41": lambda: line(31),
    "stiff edge 5 x 5 x 3": lambda: stiff_edge(32, 0.4),
    "stiff edge 5 x 5 x 3, softer": lambda: stiff_edge(33, 0.16),
    "rezero by budget": lambda: press(area(8), 34, options={"rezero": None}),
}
REAL = ("real four barometers", "real five magnetometers")


def answers(stream: Stream) -> dict[str, np.ndarray]:
    """What the tracker says, frame by frame."""
    rows: list[tuple[float, ...]] = []
    notes, events, seconds = [], [], []
    monitor = GraspMonitor(friction=stream.options.get("friction"))
    with stream.skin.track(**{"rate": RATE, **stream.options}) as tracker:
        for k, frame in enumerate(stream.readings):
            try:
                touch = tracker.step(frame, None if stream.times is None else float(stream.times[k]))
            except PalpateError as error:
                rows.append((math.nan,) * 6)
                notes.append([f"{type(error).__name__}: {error}"])
                events.append([])
                seconds.append(math.nan)
                continue
            low = high = math.nan
            if touch.has_intervals:
                low, high = (float(np.asarray(end)[-1]) for end in touch.interval(0.95, "force"))
            code = -1 if touch.status is None else int(touch.status)
            share = math.nan if touch.discrepancy is None else float(touch.discrepancy)
            rows.append((float(touch.force[-1]), low, high, float(code), float(touch.fit), share))  # type: ignore[arg-type]
            notes.append(list(touch.notes))
            events.append([e.kind for e in monitor.update(touch)])
            seconds.append(tracker.seconds)
    table = np.array(rows)
    names = ("force", "low", "high", "status", "fit", "share")
    out = {name: table[:, i] for i, name in enumerate(names)}
    out["truth"], out["seconds"] = stream.force, np.array(seconds)
    out["notes"], out["events"] = np.array(json.dumps(notes)), np.array(json.dumps(events))
    return out


def chosen(args: argparse.Namespace) -> Iterator[tuple[str, Stream]]:
    for name, make in STREAMS.items():
        if not args.only or any(o in name for o in args.only.split(",")):
            yield name, make()
    for name in REAL if args.data else ():
        if not args.only or any(o in name for o in args.only.split(",")):
            yield name, real(args.data, name)


def held(found: dict[str, Any]) -> tuple[int, int, float]:
    """Frames in contact whose interval holds the truth, frames in contact, and the median error of the force relative to the largest."""
    truth = found["truth"]
    pressed = np.isfinite(truth) & (np.abs(truth) > 0.2 * np.nanmax(np.abs(truth)))
    sign = -1.0 if np.nanmedian(found["force"][pressed]) < 0 else 1.0
    force, low, high = (found[k][pressed] for k in ("force", "low", "high"))
    inside = (np.minimum(sign * low, sign * high) <= truth[pressed]) & (
        truth[pressed] <= np.maximum(sign * low, sign * high)
    )
    error = np.abs(sign * force - truth[pressed]) / np.nanmax(np.abs(truth))
    return int(inside.sum()), int(pressed.sum()), float(np.nanmedian(error)) if np.isfinite(error).any() else math.nan


def record(args: argparse.Namespace) -> None:
    out: dict[str, np.ndarray] = {}
    for name, stream in chosen(args):
        begun = time.process_time()
        found = answers(stream)
        good, count, error = held(found)
        print(
            f"{name:<34} {len(stream.readings):>4} frames {time.process_time() - begun:6.1f} s  held {good}/{count}  error {error:.3f}",
            flush=True,
        )
        out |= {f"{name}|{key}": value for key, value in found.items()}
    np.savez_compressed(args.file, **out)  # type: ignore[arg-type]


def compare(args: argparse.Namespace) -> None:
    before = np.load(args.file)
    print(
        f"{'stream':<34} {'largest difference':>18} {'of half width':>13} {'statuses':>8} {'events':>6} {'notes':>5}   held before, after; error before, after"
    )
    worst = 0.0
    for name, stream in chosen(args):
        if f"{name}|force" not in before:
            continue
        old = {key: before[f"{name}|{key}"] for key in ("force", "low", "high", "status", "fit", "truth")}
        new = answers(stream)
        scale = max(float(np.nanmax(np.abs(old["force"]), initial=0.0)), 1e-300)
        both = np.isfinite(old["force"]) & np.isfinite(new["force"])
        gap_ = np.where(both, np.abs(np.where(both, old["force"], 0.0) - np.where(both, new["force"], 0.0)), 0.0)
        width = np.where(np.isfinite(old["high"] - old["low"]), 0.5 * (old["high"] - old["low"]), math.inf)
        part = float((gap_ / np.maximum(width, 1e-9 * scale)).max(initial=0.0))
        differ = [json.loads(str(new[k])) != json.loads(str(before[f"{name}|{k}"])) for k in ("events", "notes")]
        count = {
            k: sum(a != b for a, b in zip(json.loads(str(new[k])), json.loads(str(before[f"{name}|{k}"])))) if d else 0
            for k, d in zip(("events", "notes"), differ)
        }
        statuses = int((old["status"] != new["status"]).sum())
        (a, n, e), (b, _, f) = held(old), held(new)
        print(
            f"{name:<34} {gap_.max(initial=0.0) / scale:>18.2e} {part:>13.2g} {statuses:>8} {count['events']:>6} {count['notes']:>5}   "
            f"{a}, {b} of {n}; {e:.3f}, {f:.3f}",
            flush=True,
        )
        worst = max(worst, float(gap_.max(initial=0.0) / scale))
        if args.each:
            for k in range(len(new["force"])):
                if old["status"][k] != new["status"][k] or gap_[k] > 1e-6 * scale:
                    sides = " | ".join(
                        f"{s['force'][k]:.3f} ({s['low'][k]:.3f} to {s['high'][k]:.3f}) {_label(s['status'][k])} fit {s['fit'][k]:.2g}"
                        for s in (old, new)
                    )
                    print(f"    {k:>4}: acts {old['truth'][k]:.2f}; {sides}")
    print(f"largest difference of a force, of the stream's largest: {worst:.2e}")


def _label(code: float) -> str:
    return "none" if code < 0 else Status.coded(int(code)).label


def times(args: argparse.Namespace) -> None:
    """Step times without and with friction; with --against, of that checkout too, in turns."""
    if args.against:
        for turn in range(2):
            for source in (args.against, Path(pp.__file__).parents[1]):
                print(f"-- {source}, turn {turn + 1}", flush=True)
                command = [sys.executable, __file__, "times", "--sizes", args.sizes, "--frames", str(args.frames)]
                subprocess.run(command, env={**os.environ, "PYTHONPATH": str(source)}, check=True)
        return
    for size in map(int, args.sizes.split(",")):
        for friction in (None, 0.6):
            skin = area(size, depth=1.5e-3 if size < 16 else 2e-3)
            one = [ball(skin, radius=2e-3 if size < 16 else 4e-3, x=1e-3 * math.sin(0.1 * k)) for k in range(63)]
            rng, part = np.random.default_rng(0), 0.01 * float(np.abs(one[0]).max())
            ms = []
            with skin.track(baseline=REST, friction=friction, rate=200.0) as tracker:
                for k in range(args.frames + REST + 20):
                    load = 0.0 if k < REST + 4 else 1.0 + 0.3 * math.sin(0.05 * k)
                    tracker.step(load * one[k % 63] + part * rng.standard_normal(one[0].shape))
                    ms.append(1e3 * tracker.seconds)
            each = np.array(ms[REST + 20 :])
            a, b, c = np.percentile(each, [50, 99, 99.9])
            print(
                f"{size} x {size} x 3 friction {friction}: p50 {a:.2f}, p99 {b:.2f}, p99.9 {c:.1f} ms; {1e3 / each.mean():.0f} steps/s; first contact {max(ms[REST : REST + 20]):.0f} ms",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("record", "compare", "times"))
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--each", action="store_true")
    parser.add_argument(
        "--data", type=Path, help="folder with tactileforce/ and eflesh/: adds two published recordings"
    )
    parser.add_argument("--sizes", default="8,32")
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--against", type=Path)
    args = parser.parse_args()
    if args.what != "times" and args.file is None:
        parser.error("give the file of the record")
    {"record": record, "compare": compare, "times": times}[args.what](args)


if __name__ == "__main__":
    main()
