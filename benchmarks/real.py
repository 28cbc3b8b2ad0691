"""Published recordings of real skins, with a force sensor beside them, through `Skin.reconstruct` and `Skin.track` as documented.

    python benchmarks/real.py --data FOLDER                          # holds tactileforce/, melexis/, eflesh/
    python benchmarks/real.py --data FOLDER --cases FOLDER           # no-contact/, xela/, gelslim/ too; default: the folder cases beside data
    python benchmarks/real.py --data FOLDER --only melexis --each    # one set, one line a frame
    python benchmarks/real.py --data FOLDER --against OTHER/src      # the same by another checkout first
    python benchmarks/real.py --data FOLDER --write                  # docs/_generated/real.md

Nothing is given but what the publishers state. They state neither pad nor unit: each set lists its guesses, and one factor, fitted to the force sensor by
least squares, turns the found forces and their intervals into newtons. Both roads get the same rest frames and the same frames, and nobody gives the noise.

**Pressed**: the force sensor reads more than ten standard deviations of its rest and more than 3 % of its largest force. **At rest**: less than three
standard deviations, or 0.5 %. **Coverage**: share of pressed frames whose 95 % interval, times the factor, holds the force sensor's reading; an open end
counts as infinity, and frames without an interval count as "no interval". **Linear**: a regression from readings to force, learned from every other frame
and tested on the rest, twice; the factor is fitted to all frames. **Contradict**: the intervals of the two roads have no common point. **Notes clash**: one
frame says that noise explains its readings and that nothing explains them, or "no contact" beside an interval without 0.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import inspect
import math
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.errors import PalpateError
from palpate.status import Status

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "real.md"
#: Says that noise is all there is; says that nothing explains the readings.
NOISE = re.compile(r"noise alone explains|no contact:", re.IGNORECASE)
UNEXPLAINED = re.compile(
    r"explains the readings ill|not look like noise|does not explain|do not explain|no contact explains|nothing explains",
    re.IGNORECASE,
)
MISFIT = 0.01


@dataclass(frozen=True)
class Recording:
    """Frames of one sensor with the force beside them.

    ``rest`` and ``frames`` are readings (frame, channel, *array), ``force`` (frame,) in N or NaN where no sensor measured it, ``direction`` the
    index of the component that the force sensor measures.
    """

    name: str
    source: str
    guesses: str
    skin: pp.Skin
    rest: np.ndarray
    rest_force: np.ndarray
    frames: np.ndarray
    force: np.ndarray
    rate: float
    direction: int = 2
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer:
    """What one road says of one frame."""

    status: str
    known: bool
    force: float
    low: float
    high: float
    fit: float
    notes: tuple[str, ...]

    @property
    def has_interval(self) -> bool:
        return not (math.isnan(self.low) or math.isnan(self.high))

    @property
    def clashes(self) -> bool:
        noise = self.status == Status.NO_CONTACT.label or any(NOISE.search(n) for n in self.notes)
        unexplained = self.fit < MISFIT or any(UNEXPLAINED.search(n) for n in self.notes)
        without_zero = self.status == Status.NO_CONTACT.label and self.has_interval and not self.low <= 0.0 <= self.high
        return (noise and unexplained) or without_zero


def bonded(thickness: float, modulus: float, ratio: float = 0.48) -> pp.BondedLayers:
    return pp.BondedLayers([pp.Layer(thickness=thickness, youngs_modulus=modulus, poissons_ratio=ratio)])


def spread(indices: np.ndarray, count: int) -> np.ndarray:
    """About ``count`` of the indices, evenly."""
    return indices[:: max(1, len(indices) // count)]


# -- the sets ------------------------------------------------------------------------------------------------------------


def four_barometers(streams: Path, count: int) -> Iterator[Recording]:
    guesses = "pad of 8 mm, 100 kPa, on a rigid base; taxels 12 mm apart at the base, in the order s0 s3 / s1 s2; 1 kPa a unit"
    skin = pp.Skin(bonded(8e-3, 1e5), pp.AreaArray(shape=(2, 2), pitch=12e-3, depth=8e-3, channels=["stress_zz"]))

    def readings(table: np.ndarray, first: int) -> np.ndarray:
        return 1e3 * table[:, first + np.array([0, 3, 1, 2])].reshape(-1, 1, 2, 2)

    rest = rest_force = None
    for number in range(3):
        table = np.loadtxt(streams / f"stream-{number}.csv", delimiter=",", skiprows=1)
        all_readings = readings(table, 1)
        if rest is None:
            rest, rest_force = all_readings[:30], table[:30, 0]
        chosen = spread(np.arange(30, len(table)), count)
        yield Recording(
            f"tactileforce stream-{number}", "vistormu/tactileforce", guesses, skin, all_readings[:30], table[:30, 0], all_readings[chosen],
            table[chosen, 0] - table[:30, 0].mean(), 1.0 / float(np.diff(table[chosen, 5]).mean()),
        )  # fmt: skip
    table = np.loadtxt(streams / "presses.csv", delimiter=",", skiprows=1)
    chosen = spread(np.arange(len(table)), 2 * count)
    assert rest is not None
    assert rest_force is not None
    guesses += "; at rest as at the start of stream-0, because the table has no rest"
    yield Recording(
        "tactileforce presses",
        "vistormu/tactileforce",
        guesses,
        skin,
        rest,
        rest_force,
        readings(table, 3)[chosen],
        table[chosen, 2],
        1.0,
    )


def four_hall_cells(folder: Path, count: int) -> Iterator[Recording]:
    table = np.loadtxt(folder / "calib-first-1000.csv", delimiter=",", skiprows=1)
    field_of_cells = 1e3 * table[:, 8:16].reshape(-1, 2, 2, 2).transpose(0, 3, 1, 2)  # (frame, Bx and Bz, row, column)
    force = -table[:, 20]
    free = np.flatnonzero((np.linalg.norm(table[:, 18:21], axis=1) < 0.03) & (table[:, 5] < 0.0))
    chosen = spread(np.setdiff1d(np.arange(len(table)), free[:30]), count)
    array = pp.AreaArray(shape=(2, 2), pitch=2e-3, depth=4e-3, channels=["stress_xz", "stress_zz"])
    yield Recording(
        "melexis", "TheEngineRoom-UniGe/Melexis_Tactile_Sensor", "pad of 4 mm, 300 kPa, on a rigid base; cells 2 mm apart at the base; Bx is shear, Bz pressure, 1 kPa a unit",
        pp.Skin(bonded(4e-3, 3e5), array), field_of_cells[free[:30]], force[free[:30]], field_of_cells[chosen], force[chosen] - force[free[:30]].mean(), 1.0,
    )  # fmt: skip


def plus(arm: float, at: float = 0.0) -> np.ndarray:
    return np.array([(at, 0.0), (at, arm), (at + arm, 0.0), (at, -arm), (at - arm, 0.0)])


def five_magnetometers(folder: Path, count: int) -> Iterator[Recording]:
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    for path in sorted(folder.glob("*_force_*_probe_states.csv")):
        states = np.loadtxt(path, delimiter=",")
        table = np.loadtxt(str(path).replace("_probe_states", "_probe_sensor_post_baselines"), delimiter=",")
        taxels = (table.shape[1] - 1) // 3
        readings = 50.0 * table[:, 1:].reshape(-1, taxels, 3).transpose(0, 2, 1)
        grams = states[:, 4]
        # the probe begins at its upper end and touches some millimetres lower
        until = min(30, int(np.argmin(states[:, 3] > states[0, 3] - 0.4)))
        rest = np.arange(until)
        chosen = spread(np.flatnonzero((grams != -1.0) & (np.arange(len(grams)) >= until)), count)
        known = rest[grams[rest] != -1.0]
        newtons = 9.81e-3 * grams
        places = plus(7e-3) if taxels == 5 else np.concatenate([plus(7e-3, -12e-3), plus(7e-3, 12e-3)])
        array = pp.ScatteredArray(positions=places, depth=8e-3, channels=channels)
        shear = path.name.startswith("shear")
        yield Recording(
            f"eflesh {'shear' if shear else 'normal'} {path.name.split('_')[3]}", "notvenky/eFlesh",
            "pad of 8 mm, 100 kPa, Poisson's ratio 0.3, on a rigid base; "
            + ("five magnetometers, the outer ones 7 mm from the middle; " if taxels == 5 else "ten magnetometers as two such crosses 24 mm apart; ")
            + "x, y, z are s_xz, s_yz, s_zz, 50 Pa a count; the load cell counts grams" + ("; it measures along the axis that fits it best" if shear else ""),
            pp.Skin(bonded(8e-3, 1e5, 0.3), array), readings[rest], newtons[known], readings[chosen], newtons[chosen] - newtons[known].mean(),
            1.0 / float(np.diff(states[chosen, 0]).mean()), -1 if shear else 2,
        )  # fmt: skip


def crop_of_four(folder: Path, count: int) -> Iterator[Recording]:
    table = np.loadtxt(folder / "crop.csv", delimiter=",", skiprows=1)
    readings = 1e3 * table[:, [1, 4, 2, 3]].reshape(-1, 1, 2, 2)
    chosen = spread(np.arange(30, len(table)), count)
    yield Recording(
        "case four_taxels", "vistormu/tactileforce", "its skin.toml: pad of 8 mm, 100 kPa, 12 mm apart, 1 kPa a unit", pp.Skin.from_file(folder / "skin.toml"),
        readings[:30], table[:30, 0], readings[chosen], table[chosen, 0] - table[:30, 0].mean(), 1.0 / float(np.diff(table[chosen, 5]).mean()),
    )  # fmt: skip


def crop_of_five(folder: Path, count: int) -> Iterator[Recording]:
    table, grams = (np.loadtxt(folder / name, delimiter=",") for name in ("sub.csv", "sub_states.csv"))
    readings = 50.0 * table[:, 1:].reshape(-1, 5, 3).transpose(0, 2, 1)
    newtons = 9.81e-3 * grams[:, 4]
    known = grams[:, 4] != -1.0
    chosen = spread(np.flatnonzero(known & (np.arange(len(known)) >= 30)), count)
    free = newtons[:30][known[:30]]
    yield Recording(
        "case eflesh", "notvenky/eFlesh", "its skin.toml: pad of 8 mm, 100 kPa, 50 Pa a count", pp.Skin(bonded(8e-3, 1e5, 0.3), pp.ScatteredArray(
            positions=plus(7e-3), depth=8e-3, channels=["stress_xz", "stress_yz", "stress_zz"])),
        readings[:30], free, readings[chosen], newtons[chosen] - free.mean(), 1.0,
    )  # fmt: skip


def grasp(folder: Path, count: int) -> Iterator[Recording]:
    table = np.loadtxt(folder / "taxels.csv", delimiter=",", skiprows=1)
    readings = 8.0 * table[:, 1:].reshape(-1, 3, 4, 4)
    chosen = spread(np.arange(30, len(table)), count)
    yield Recording(
        "case xela", "yinzhaodong/tactile_prediction", "its skin.toml: pad of 4 mm, 300 kPa; 4.7 mm apart at the base; 8 Pa a count; no force sensor",
        pp.Skin.from_file(folder / "skin.toml"), readings[:30], np.full(30, np.nan), readings[chosen], np.full(len(chosen), np.nan),
        1e3 / float(np.diff(table[chosen, 0]).mean()),
    )  # fmt: skip


def rounded_markers(count: int) -> Iterator[Recording]:
    """Like a depth camera that writes 0 where nothing moves: a press known to us, displacement rounded to a micrometre, at rest exactly 0."""
    channels = ["displacement_x", "displacement_y", "displacement_z"]
    skin = pp.Skin(bonded(5e-3, 2e5), pp.AreaArray(shape=(10, 10), pitch=1.3e-3, depth=0.0, channels=channels))
    ball = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    rng = np.random.default_rng(38)
    load = np.r_[np.zeros(60), np.linspace(0.0, 2.0, 15), np.full(25, 2.0), np.linspace(2.0, 0.0, 10), np.zeros(60)]
    clean = load[:, None, None, None] * ball
    read = np.round(clean + (load > 0)[:, None, None, None] * 2e-6 * rng.standard_normal(clean.shape), 6)
    chosen = spread(np.arange(30, len(load)), count)
    yield Recording(
        "zeros after a press", "made here: a ball of 2 N, exact zeros before and after", "none: pad and unit are right", skin, read[:30], np.zeros(30), read[chosen],
        load[chosen], 30.0 * len(chosen) / (len(load) - 30),
    )  # fmt: skip


# -- the roads -----------------------------------------------------------------------------------------------------------


def answer(touch: Any, direction: int | None) -> list[Answer]:
    """The answer along each component (``direction`` None), or along one."""
    status = Status.SOLVED if touch.status is None else Status.coded(int(np.asarray(touch.status)))
    force = np.asarray(touch.force, dtype=float)
    low = high = np.full(force.shape, np.nan)
    if touch.has_intervals:
        with contextlib.suppress(PalpateError):  # no error bars for this frame
            low, high = (np.asarray(side, dtype=float) for side in touch.interval(0.95, "force"))
    fit = float("nan") if getattr(touch, "fit", None) is None else float(np.min(np.asarray(touch.fit, dtype=float)))
    if not status.known:
        low = high = np.full(force.shape, np.nan)
    notes = tuple(touch.notes)
    each = range(len(force)) if direction is None else [direction]
    return [
        Answer(status.label, status.known, float(force[i]), float(low[i]), float(high[i]), fit, notes) for i in each
    ]


def refused(error: Exception) -> list[Answer]:
    nan = float("nan")
    return [Answer(f"refused: {type(error).__name__}", False, nan, nan, nan, nan, (str(error),))] * 3


def by_reconstruct(recording: Recording) -> tuple[list[list[Answer]], float]:
    """Answers (frame, component) and seconds a frame; all frames at once, and one by one where that is refused."""
    skin, options, frames = recording.skin, dict(recording.options), recording.frames
    if "zero" in inspect.signature(pp.Skin.reconstruct).parameters:
        options["zero"] = recording.rest
    else:
        frames = frames - recording.rest.mean(axis=0)
    begun = time.process_time()
    try:
        touch = skin.reconstruct(frames, **options)
        found = [answer(touch[i], None) for i in range(len(frames))]
    except PalpateError:
        found = []
        for frame in frames:
            try:
                found.append(answer(skin.reconstruct(frame, **options), None))
            except PalpateError as error:
                found.append(refused(error))
    return found, (time.process_time() - begun) / len(frames)


def by_track(recording: Recording) -> tuple[list[list[Answer]], float]:
    skin, found = recording.skin, []
    with skin.track(baseline=len(recording.rest), rate=recording.rate, **recording.options) as tracker:
        for k, frame in enumerate(recording.rest):
            tracker.step(frame, k / recording.rate)
        begun = time.process_time()
        for k, frame in enumerate(recording.frames, len(recording.rest)):
            try:
                found.append(answer(tracker.step(frame, k / recording.rate), None))
            except PalpateError as error:
                found.append(refused(error))
        seconds = time.process_time() - begun
    return found, seconds / len(recording.frames)


def linear(recording: Recording) -> np.ndarray:
    """Force by linear regression on the readings, learned from every other frame and tested on the rest, twice."""
    readings = (recording.frames - recording.rest.mean(axis=0)).reshape(len(recording.frames), -1)
    readings = np.c_[readings / np.abs(readings).max(), np.ones(len(readings))]
    told = np.empty(len(readings))
    for part in (0, 1):
        learn, test = (np.arange(len(readings)) % 2 == p for p in (part, 1 - part))
        told[test] = readings[test] @ np.linalg.lstsq(readings[learn], recording.force[learn], rcond=None)[0]
    return told


# -- the tables ----------------------------------------------------------------------------------------------------------

HEADER = (
    "| method | frames | pressed | of these 'no contact' | at rest | of these contact (interval without 0) | status: frames | fitted factor | force inside the 95 % interval | no interval | "
    "no upper end | interval's width over the force, median | R^2, mean error [N] | linear: R^2, mean error [N] | with a misfit probability | contradictory notes | seconds a frame |"
)
SHORT = (
    "| set | pressed frames | reconstruct: pressed and called 'no contact' | force inside the 95 % interval | contradictory notes | track: pressed and called 'no contact' | "
    "force inside the 95 % interval | contradictory notes | disjoint intervals | 'no contact' from one, an interval without 0 from the other |"
)


def accuracy(told: np.ndarray, force: np.ndarray) -> str:
    good = np.isfinite(told) & np.isfinite(force)
    if good.sum() < 3:
        return "-"
    left = force[good] - told[good]
    return f"{1.0 - (left**2).sum() / ((force[good] - force[good].mean()) ** 2).sum():.3f}, {np.abs(left).mean():.2f}"


def table(recording: Recording, *, each: bool = False) -> tuple[list[str], str]:
    """Lines of markdown, one row for each road; and the line of the summary."""
    told_in_short: list[str] = []
    roads: dict[str, tuple[list[list[Answer]], float]] = {
        "reconstruct": by_reconstruct(recording),
        "track": by_track(recording),
    }
    force, noise = (
        recording.force,
        float(np.nanstd(recording.rest_force)) if np.isfinite(recording.rest_force).any() else math.nan,
    )
    largest = float(np.nanmax(np.abs(force))) if np.isfinite(force).any() else math.nan
    pressed = np.abs(force) > max(10.0 * noise, 0.03 * largest) if largest > 0 else np.zeros(len(force), bool)
    free = np.abs(force) < max(3.0 * noise, 0.005 * largest) if largest > 0 else np.zeros(len(force), bool)
    by_itself = np.zeros(len(force), bool)
    if not np.isfinite(force).any():
        # no force sensor: pressed is what reads far above the rest
        zero, std = recording.rest.mean(axis=0), recording.rest.std(axis=0)
        loud = (np.abs(recording.frames - zero) / np.maximum(std, 1e-12)).reshape(len(force), -1).max(axis=1)
        pressed, free, by_itself = loud > 30.0, loud < 3.0, np.ones(len(force), bool)
    told = linear(recording) if np.isfinite(force).all() else np.full(len(force), np.nan)
    out = [f"Source: {recording.source}. Guesses: {recording.guesses}. {len(recording.rest)} rest frames.", ""]
    if by_itself.any():
        out[0] += " A frame counts as pressed if a reading exceeds 30 standard deviations of the frames at rest."
    out += [HEADER, "|---" * (HEADER.count("|") - 1) + "|"]
    along = recording.direction if recording.direction >= 0 else best_axis([a for a, _ in roads.values()], force)
    for road, (answers, seconds) in roads.items():
        mine = [a[along] for a in answers]
        found = np.array([a.force for a in mine])
        low, high = np.array([a.low for a in mine]), np.array([a.high for a in mine])
        good = np.isfinite(found) & np.isfinite(force) & pressed
        factor = (
            float((found[good] * force[good]).sum() / max((found[good] ** 2).sum(), 1e-300))
            if (found[good] != 0).any()
            else math.nan
        )
        ends = np.sort(np.stack([factor * low, factor * high]), axis=0)
        has = np.array([a.has_interval for a in mine]) & pressed
        held = (ends[0] <= force) & (force <= ends[1]) & has
        open_above = np.isinf(high) & has
        width = np.full(len(force), np.nan)
        measured = has & ~open_above & (force != 0.0)
        width[measured] = ((ends[1] - ends[0])[measured]) / np.abs(force[measured])
        is_none = np.array([a.status == Status.NO_CONTACT.label for a in mine])
        claims = np.array([a.has_interval and not a.low <= 0.0 <= a.high for a in mine])
        statuses = ", ".join(f"{s} {n}" for s, n in Counter(a.status for a in mine).most_common())
        known_width = np.isfinite(width) & has
        axis = "" if recording.direction >= 0 else f" ({'xyz'[along]})"
        out.append(
            f"| {road}{axis} | {len(mine)} | {pressed.sum()} | {(is_none & pressed).sum()} | {free.sum()} | {(claims & free).sum()} | {statuses} | {factor:.3g} | "
            + (
                f"{held.sum()} of {has.sum()}: {held.sum() / max(has.sum(), 1):.2f}"
                if math.isfinite(factor)
                else f"- of {has.sum()}"
            )
            + f" | {(pressed & ~has).sum()} | {open_above.sum()} | "
            + (f"{np.median(width[known_width]):.2f}" if known_width.any() else "-")
            + f" | {accuracy(factor * found, force)} | {accuracy(told, force)} | {sum(not math.isnan(a.fit) for a in mine)} | "
            f"{sum(a.clashes for a in mine)} | {seconds:.3f} |"
        )
        coverage = f"{held.sum()} of {has.sum()}" if math.isfinite(factor) else f"- of {has.sum()}"
        told_in_short += [f"{(is_none & pressed).sum()}", coverage, f"{sum(a.clashes for a in mine)}"]
        if each:
            for k, a in enumerate(mine):
                out.append(
                    f"    {road} {k}: sensor {force[k]:.3f} N{' pressed' if pressed[k] else ''}, {a.status}, {a.force:.4g} ({a.low:.4g} to {a.high:.4g}), fit {a.fit:.2g}; "
                    + "; ".join(a.notes)
                )
    apart, none, both = contradictions(roads["reconstruct"][0], roads["track"][0])
    out += [
        "",
        f"Frames for which `reconstruct` and `track` give disjoint intervals: {apart} of {both}; 'no contact' from one, and an interval without 0 from the other: {none}.",
    ]
    line = f"| {recording.name} | {pressed.sum()} | " + " | ".join(told_in_short) + f" | {apart} of {both} | {none} |"
    return out, line


def contradictions(one: list[list[Answer]], other: list[list[Answer]]) -> tuple[int, int, int]:
    """Frames whose intervals have no common point in a component; 'no contact' beside an interval without 0; frames with two intervals."""
    apart = none = both = 0
    for first, second in zip(one, other, strict=False):
        pairs = [(a, b) for a, b in zip(first, second, strict=True) if a.has_interval and b.has_interval]
        if not pairs:
            continue
        both += 1
        apart += any(a.low > b.high or b.low > a.high for a, b in pairs)
        for said, beside in ((first, second), (second, first)):
            nothing = said[0].status == Status.NO_CONTACT.label
            none += nothing and any(b.has_interval and not b.low <= 0.0 <= b.high for b in beside)
    return apart, none, both


def best_axis(roads: list[list[list[Answer]]], force: np.ndarray) -> int:
    """The component that follows the force best with one factor for each road."""
    told = np.zeros(len(roads[0][0]))
    for answers in roads:
        for i in range(len(told)):
            found = np.array([a[i].force for a in answers])
            good = np.isfinite(found) & np.isfinite(force)
            square = float((found[good] ** 2).sum())
            told[i] += float((found[good] * force[good]).sum()) ** 2 / square if square > 0 else 0.0
    return int(np.argmax(told))


def pictures(folder: Path, count: int) -> Iterator[tuple[str, list[str]]]:
    """Films of gels, tracked, and each picture by itself: nobody measured a force there."""
    if importlib.util.find_spec("cv2") is None:
        return
    from palpate.camera import follow, open_pictures

    for film, skin in (("mini_example.avi", "gelsight_mini.toml"), ("gelslim_bolt.avi", "gelslim.toml")):
        with open_pictures(folder / film) as opened:
            images = [p.image for p in opened]
        rest = images[:10]
        chosen = rest + images[10 :: max(1, (len(images) - 10) // count)]
        answers: dict[str, list[Answer]] = {}
        lines = [f"{len(chosen)} pictures of {film}, the first 10 at rest; {skin}; no force sensor.", ""]
        lines += [
            "| method | pictures | status: pictures | normal force, smallest to largest [N] | of the first ten, interval without 0 | with a misfit probability | contradictory notes | seconds a picture |",
            "|---" * 8 + "|",
        ]
        for road, tracked in (("reconstruct", False), ("track", True)):
            mine = answers[road] = []
            begun = time.process_time()
            try:
                with follow(chosen, folder / skin, track=tracked, rate=5.0) as touches:
                    mine += [answer(t, 2)[0] for t in touches]
            except PalpateError as error:
                lines.append(f"| {road} | {len(mine)} | refused: {error} |" + " |" * 5)
            seconds = (time.process_time() - begun) / max(len(mine), 1)
            if not mine:
                continue
            found = [a.force for a in mine if math.isfinite(a.force)] or [math.nan]
            statuses = ", ".join(f"{s} {n}" for s, n in Counter(a.status for a in mine).most_common())
            claims = sum(a.has_interval and not a.low <= 0.0 <= a.high for a in mine[:10])
            lines.append(
                f"| {road} | {len(mine)} | {statuses} | {min(found):.3g} to {max(found):.3g} | {claims} | {sum(not math.isnan(a.fit) for a in mine)} | "
                f"{sum(a.clashes for a in mine)} | {seconds:.2f} |"
            )
        apart, none, both = contradictions(*([[a] for a in mine] for mine in answers.values()))
        lines += [
            "",
            f"Pictures for which `reconstruct` and `track` give disjoint intervals: {apart} of {both}; 'no contact' from one, and an interval without 0 from the other: {none}.",
        ]
        yield f"film {film}", lines


def sets(data: Path, cases: Path, count: int) -> dict[str, Callable[[], Iterator[Recording]]]:
    return {
        "tactileforce": lambda: four_barometers(data / "tactileforce", count // 2),
        "melexis": lambda: four_hall_cells(data / "melexis", count),
        "eflesh": lambda: five_magnetometers(data / "eflesh", count),
        "four_taxels": lambda: crop_of_four(cases / "no-contact" / "four_taxels", count),
        "case-eflesh": lambda: crop_of_five(cases / "no-contact" / "eflesh", count),
        "xela": lambda: grasp(cases / "xela", count),
        "zeros": lambda: rounded_markers(count),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with tactileforce/, melexis/ and eflesh/")
    parser.add_argument(
        "--cases", type=Path, help="folder with no-contact/, xela/ and gelslim/; default: cases beside --data"
    )
    parser.add_argument(
        "--only", help="some of tactileforce, melexis, eflesh, four_taxels, case-eflesh, xela, zeros, films"
    )
    parser.add_argument("--frames", type=int, default=100, help="about so many frames of each set")
    parser.add_argument("--each", action="store_true", help="one line a frame, too")
    parser.add_argument("--against", type=Path, help="src folder of another checkout: its tables come first")
    parser.add_argument("--write", action="store_true", help=f"write {GENERATED.name}")
    args = parser.parse_args()
    args.data = args.data.resolve()
    cases = (args.cases or args.data.parent / "cases").resolve()
    if args.against is not None:
        again = [
            sys.executable,
            __file__,
            "--data",
            str(args.data),
            "--cases",
            str(cases),
            "--frames",
            str(args.frames),
        ]
        again += ["--only", args.only] if args.only else []
        print(f"# By {args.against}\n", flush=True)
        subprocess.run(again, check=True, env={**os.environ, "PYTHONPATH": str(args.against.resolve())})
        print("\n# By this checkout\n", flush=True)
    every = sets(args.data, cases, args.frames)
    wanted = args.only.split(",") if args.only else [*every, "films"]
    unknown = set(wanted) - {*every, "films"}
    if unknown:
        parser.error(f"no such set: {', '.join(sorted(unknown))}")
    lines = [f"Made by `python benchmarks/real.py --data FOLDER --frames {args.frames}`."]

    summary: list[str] = []

    def add(title: str, found: list[str]) -> None:
        for line in ["", f"**{title}**", "", *found]:
            print(line, flush=True)
            lines.append(line)

    for name in wanted:
        try:
            if name == "films":
                for title, found in pictures(cases / "gelslim", 20):
                    add(title, found)
            else:
                for recording in every[name]():
                    found, short = table(recording, each=args.each)
                    add(recording.name, found)
                    summary.append(short)
        except FileNotFoundError as error:
            add(name, [f"Left out: {error.filename} is not there."])
    if summary:
        add("In short", [SHORT, "|---" * (SHORT.count("|") - 1) + "|", *summary])
    if args.write:
        GENERATED.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
