"""How often a tracker is wrong without a warning: a stream with every fault injected at random.

python benchmarks/tracker_trust.py [--minutes 10] [--seed 0] [--rate 50] [--friction 0.6] [--faults pull,dead,...] [--each] [--markdown FILE]

A ball presses an array of shear and normal stress taxels again and again, at random places, with random forces and drags (1 % noise).
Faults begin and end at random, in contact or not. A frame is wrong by its force where the normal force is off by more than 30 % of the
load (of 0.3 N where the load is less), and outside where the truth is outside the 95 % interval of the normal force. A word is a status
other than solved and no contact, a note that a clean stream does not have, or an event of the monitor that is neither contact nor slip
and goes on. Frames in which the sensor repeats what it read before contact, or is told to capture its zero, count as all others do.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate import solutions
from palpate.grasp import GraspMonitor
from palpate.status import Status

FAULTS = ("pull", "dead", "cluster", "drift", "clock", "missing", "garbage", "restart", "clipped")
#: Forces of less than this [N] are judged as if they were this.
LEAST = 0.3


@dataclass
class Scene:
    """What is real: contact, and what the sensor does to it."""

    skin: pp.Skin
    rng: np.random.Generator
    rate: float
    faults: tuple[str, ...]
    every: float = 4.0
    noise: float = 0.01
    now: float = 0.0
    clock: float = 0.0
    on: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.shape = np.asarray(self.skin.sense(solutions.hertz_point(contact_radius=2e-3, force=1.0))).shape
        self.loud = float(
            np.abs(np.asarray(self.skin.sense(solutions.hertz_point(contact_radius=2.5e-3, force=1.0)))).max()
        )
        self.offset = 0.05 * self.loud * self.rng.standard_normal(self.shape)
        self.drift = np.zeros(self.shape[0])
        self.slope = np.zeros(self.shape[0])
        self.last = self.offset.copy()
        self._contact()
        self._next = self.every

    def _contact(self) -> None:
        """The next contact: when it begins, and what it reads at its full force."""
        rng = self.rng
        self.begins = self.now + float(rng.uniform(0.5, 2.0))
        self.held, self.ramp = float(rng.uniform(1.0, 5.0)), float(rng.uniform(0.05, 0.4))
        self.force = float(rng.uniform(0.3, 1.5))
        place = rng.uniform(-2e-3, 2e-3, 2)
        ball = solutions.hertz_point(contact_radius=float(rng.uniform(1.5e-3, 3e-3)), force=1.0).shifted(
            *map(float, place)
        )
        traction = np.asarray(self.skin.sample(ball))
        angle, drag = float(rng.uniform(0.0, 2.0 * math.pi)), float(rng.uniform(0.0, 0.3))
        traction[0], traction[1] = (drag * f(angle) * traction[2] for f in (math.cos, math.sin))
        self.response = np.asarray(self.skin.sense(traction))
        self.sign = 1.0
        if "pull" in self.faults and rng.random() < 0.15:
            self.sign, self.response = -1.0, -self.response
            self.force = min(self.force, 1.0)

    def _begin(self) -> None:
        """Another fault."""
        rng, n = self.rng, self.shape
        kinds = [f for f in self.faults if f != "pull"]
        if not kinds:
            return
        kind = str(rng.choice(kinds))
        until = self.now + float(rng.uniform(1.0, 8.0))
        if kind == "dead":
            which = np.zeros(n, dtype=bool)
            for _ in range(int(rng.integers(1, 4))):
                which[:, int(rng.integers(n[1])), int(rng.integers(n[2]))] = rng.random(n[0]) < 0.6
            self.on[kind] = (until, which, float(rng.choice([0.0, math.nan, math.inf])), self.last.copy())
        elif kind == "cluster":
            which = np.zeros(n, dtype=bool)
            size = int(rng.integers(2, 4))
            # under the contact where there is one
            peak = np.unravel_index(int(np.argmax(np.abs(self.response[-1]))), n[1:])
            row, column = (max(0, min(int(p) - size // 2, m - size)) for p, m in zip(peak, n[1:]))
            which[:, row : row + size, column : column + size] = True
            self.on[kind] = (until, which, float(rng.choice([0.0, math.nan, math.inf])), self.last.copy())
        elif kind == "drift":
            self.on[kind] = (until,)
            self.slope = 0.01 * self.loud * rng.choice([-1.0, 1.0]) * np.array([0.3, 0.3, 1.0])[-n[0] :]
        elif kind == "clock":
            self.clock = 0.0
        elif kind == "missing":
            self.on[kind] = (self.now + float(rng.uniform(0.02, 1.0)), float(rng.choice([0.3, 1.0])))
        elif kind == "garbage":
            self.on[kind] = (self.now + float(rng.uniform(0.02, 0.4)), float(rng.uniform(0.1, 3.0)))
        elif kind == "restart":
            self.clock = 0.0
            jump = rng.uniform(-0.1, 0.1, (n[0], 1, 1)) if rng.random() < 0.5 else 0.03 * rng.standard_normal(n)
            self.offset = self.offset + self.loud * jump
        elif kind == "clipped":
            self.on[kind] = (self.now + float(rng.uniform(0.5, 2.0)),)

    def step(self) -> tuple[float, Any, float]:
        """(time of the sensor's clock [s], readings, true normal force [N])."""
        rng, dt = self.rng, 1.0 / self.rate
        self.now += dt
        self.clock += dt
        if self.now > self._next:
            self._next = self.now + float(rng.exponential(self.every))
            self._begin()
        since = self.now - self.begins
        level = min(since / self.ramp, 1.0) * min((2 * self.ramp + self.held - since) / self.ramp, 1.0)
        force = self.force * max(level, 0.0)
        if since > 2 * self.ramp + self.held:
            self._contact()
            force = 0.0
        self.on = {k: v for k, v in self.on.items() if v[0] > self.now}
        if "drift" in self.on:
            self.drift = self.drift + self.slope * dt
        clean = force * self.response
        self.last = self.offset + self.drift[:, None, None]
        out = self.last + clean + self.noise * self.loud * rng.standard_normal(self.shape)
        if "clipped" in self.on:
            top = 0.6 * float(np.abs(self.force * self.response).max())
            out = np.clip(out, -top, top)
        for kind in ("dead", "cluster"):
            if kind in self.on:
                _, which, value, old = self.on[kind]
                out[which] = old[which] if math.isinf(value) else value
        if "missing" in self.on:
            part = self.on["missing"][1]
            out[rng.random(self.shape) < part] = math.nan
        if "garbage" in self.on:
            out = out + self.on["garbage"][1] * self.loud * rng.standard_normal(self.shape)
        return self.clock, out, self.sign * force


def measured(
    minutes: float, seed: int, *, rate: float = 50.0, friction: float | None = 0.6, faults: tuple[str, ...] = FAULTS
) -> dict[str, float]:
    """Seconds of a stream: all, known, wrong and outside, each with and without a warning; and what went wrong with the code."""
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    skin = pp.Skin(pad, pp.AreaArray(shape=(12, 12), pitch=1e-3, depth=1.5e-3, channels=channels))
    scene = Scene(skin, np.random.default_rng(seed), rate, faults)
    tracker, monitor = skin.track(friction=friction, baseline=20, rate=rate), GraspMonitor(friction=friction or 0.6)
    scene.begins = max(scene.begins, 30 / rate)
    found: dict[str, float] = dict.fromkeys(
        ["frames", "answered", "worded", "wrong", "wrong without a warning", "outside", "outside without a warning"], 0
    )
    begun = time.perf_counter()
    for _ in range(round(60.0 * minutes * rate)):
        now, reading, truth = scene.step()
        touch = tracker.step(reading, now)
        monitor.update(touch)
        found["frames"] += 1
        status = Status.coded(int(touch.status))  # type: ignore[arg-type]
        if not status.known:
            continue
        found["answered"] += 1
        events = set(monitor.going_on()) - {"contact", "slip", "incipient slip"}
        notes = [n for n in touch.notes if "not calibrated" not in n]
        word = status not in (Status.SOLVED, Status.NO_CONTACT) or bool(notes) or bool(events)
        found["worded"] += word
        force = float(touch.force[2])
        wrong = abs(force - truth) > 0.3 * max(abs(truth), LEAST)
        outside = False
        if touch.has_intervals:
            low, high = touch.interval(0.95, "force")
            outside = not low[2] <= truth <= high[2]
        found["wrong"] += wrong
        found["wrong without a warning"] += wrong and not word
        found["outside"] += outside
        found["outside without a warning"] += outside and not word
    found["milliseconds a frame"] = 1e3 * (time.perf_counter() - begun) / max(found["frames"], 1)
    for key in list(found):
        if "milliseconds" not in key:
            found[key] /= rate
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--friction", type=float, default=0.6, help="0: not known to the tracker")
    parser.add_argument("--faults", default=",".join(FAULTS), help=f"some of {', '.join(FAULTS)}; - for none")
    parser.add_argument("--each", action="store_true", help="a stream for each fault alone, too, a fifth as long")
    parser.add_argument("--markdown", type=Path, help="file for the table")
    args = parser.parse_args()
    every = tuple(f for f in args.faults.split(",") if f in FAULTS)
    rows = [every, *([(), *((f,) for f in every)] if args.each else [])]
    names = ("answered", "worded", "wrong", "wrong without a warning", "outside", "outside without a warning")
    lines = [
        f"Made by `python benchmarks/tracker_trust.py --minutes {args.minutes:g} --rate {args.rate:g} --seed {args.seed}{' --each' if args.each else ''}`.",
        "",
        "| faults | seconds | answered | with a warning | wrong by > 30 % | of these without a warning | truth outside 95 % | of these without a warning |",
        "|---|---|---|---|---|---|---|---|",
    ]
    print(f"{'faults':<12}{'seconds':>9}" + "".join(f"{n:>24}" for n in names) + f"{'ms a frame':>12}")
    for faults in rows:
        minutes = args.minutes if faults == every else args.minutes / 5.0
        found = measured(minutes, args.seed, rate=args.rate, friction=args.friction or None, faults=faults)
        label = "all" if faults == every else ", ".join(faults) or "none"
        print(
            f"{label:<12}{found['frames']:>9.1f}"
            + "".join(f"{found[n]:>24.2f}" for n in names)
            + f"{found['milliseconds a frame']:>12.2f}",
            flush=True,
        )
        lines.append(f"| {label} | {found['frames']:.0f} | " + " | ".join(f"{found[n]:.1f}" for n in names) + " |")
        if args.markdown is not None:
            args.markdown.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
