"""How well palpate measures wide contacts on arrays whose zero has drifted.

    python benchmarks/wide_contacts.py --seed 1 --frames 60 --jobs 4            two tables; with --write, in docs/_generated/wide_contacts.md
    python benchmarks/wide_contacts.py --seed 2 --frames 70 --hard --each       one line for each frame as well
    python benchmarks/wide_contacts.py --seed 1 --from 33 --frames 1 --each     one frame again; with --clean, without its fault

In: a seed. Frame k of seed s is drawn from these two numbers alone. Each frame has its own sensor: 8 to 40 taxels or marks a side, 0.5 to 3 pitches
deep in a half-space or in bonded layers, of stress, strain or displacement. Most contacts cover a third of the array or more; some reach beyond its
edge, and some slide. The noise is 0.3 to 5 % of the largest reading. The solver is given frames at rest (40 %), the standard deviation of the noise
(30 %) or neither. Two of three frames have a fault: an offset or a ramp of one channel or of all; one shaped like the contact's own readings (hidden);
another zero of rows or columns; a broken taxel; a gain 2 % off. ``--hard`` makes only small arrays and drift, half of it hidden. palpate computes the
readings, from closed forms or on a grid finer than that of the reconstruction: the tables test the inverse problem, not the model of the pad.

Out: a table by contact and one by fault. Definitions, all of the normal force:

* Error: relative to the true force. Inside: the 95 % interval holds the true force. An interval without either end holds nothing.
* Word: a status other than "solved" and "no contact", or a note. Notes that every frame of a sensor carries are no warning: that its channels do
  not separate shear or do not respond to a uniform load, and that the error bars are not calibrated for it.
* Wrong: the error is above 10 %, and the true force lies beyond the interval by more than 20 % of the interval's half-width. Without a word,
  "no contact" and a force that is not a number are wrong too.
* No number: the status is "undecided", or the force is not a number. The median leaves these out; their interval must hold the true force.
* Seconds: to reconstruct with an interval and to prepare the sensor. ``--timeout`` stops a frame; the time to make the frame counts there too.
* Failed: the program raised an error. The frame is listed below the tables and counts only in "frames", and the exit status is 1.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
import traceback
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.sensing.uncertainty import EXACT

Rng: TypeAlias = np.random.Generator
Array: TypeAlias = pp.AreaArray | pp.ScatteredArray
TABLE = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "wide_contacts.md"
COLUMNS = (
    "frames | error: median | force inside 95 % | wrong without a word | wrong with a word "
    "| no number / interval without the truth | warned | seconds: median, largest | timeouts"
)
KINDS = ("punch", "block", "sphere", "cylinder", "irregular", "two", "tilt", "beyond", "full")
FAULTS = ["none"] * 5 + ["offset"] * 2 + ["ramp"] * 2 + ["offset+ramp"] * 2 + ["hidden", "rowcol", "broken", "gain"]
HARD_KINDS = ("tilt", "block", "full", "sphere", "irregular")
HARD_FAULTS = ("hidden", "offset", "hidden", "ramp", "hidden", "offset+ramp", "hidden")
LAYOUTS = {
    "zz": "stress_zz",
    "three": "stress_xz stress_yz stress_zz",
    "strain": "strain_zz",
    "strain3": "strain_xz strain_yz strain_zz",
    "marks_xy": "displacement_x displacement_y",
    "marks_xyz": "displacement_x displacement_y displacement_z",
    "disp_grid": "displacement_x displacement_y displacement_z",
}
SHARES, HARD_SHARES = (0.26, 0.3, 0.1, 0.1, 0.08, 0.08, 0.08), (0.4, 0.36, 0.04, 0.06, 0.0, 0.04, 0.1)
#: Notes that every frame of a sensor carries begin so.
STANDING = ("these channels alone", "these channels do not respond to a uniform", "error bars are not calibrated")
LARGE_ERROR, LARGE_EXCESS = 0.1, 0.2
STOPPED = "stopped: out of time"


@dataclass(frozen=True)
class Sensor:
    """A pad and the array in it; pitch, depth and half-widths along x and y [m], Young's modulus of the top [Pa]."""

    layout: str
    shape: tuple[int, int]
    pitch: float
    depth: float
    modulus: float
    half: tuple[float, float]
    pad: pp.HalfSpace | pp.BondedLayers
    array: Array


@dataclass(frozen=True)
class Contact:
    """A pressure of about 1 Pa: a closed form, or the mean pressure of the cells of a grid."""

    shape: pp.solutions.AreaContact | tuple[pp.AreaGrid, Floats]

    def press(self, sensor: Sensor, skin: pp.Skin, peak: float, friction: float, turn: float) -> tuple[Floats, float]:
        """Readings without noise and normal force [N] of the pressure times ``peak``, sliding along ``turn``."""
        if not isinstance(self.shape, tuple):
            form = self.shape.sliding(friction, direction=turn) if friction else self.shape
            return np.asarray(skin.sense(form)) * peak, float(form.force[2] * peak)
        grid, p = self.shape
        traction = np.stack([friction * math.cos(turn) * p, friction * math.sin(turn) * p, p]) * peak
        fine = pp.Skin(sensor.pad, sensor.array, surface=grid, uncertainty=EXACT)
        return np.asarray(fine.sense(traction)), float(traction[2].sum() * grid.cell)


@dataclass(frozen=True)
class Frame:
    """Readings, what the solver is given with them, the true normal force [N], and the sensor and the fault in words."""

    skin: pp.Skin
    readings: Floats
    given: dict[str, Any]
    force: float
    words: str


@dataclass(frozen=True)
class Result:
    """What palpate made of a frame, or why it made nothing: error and interval relative to the true force, time [s]."""

    index: int
    kind: str
    fault: str
    failure: str = ""
    error: float = math.nan
    interval: tuple[float, float] = (math.nan, math.nan)
    inside: bool = False
    number: bool = False
    warned: bool = False
    wrong: bool = False
    seconds: float = math.nan
    words: str = ""


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_sensor(rng: Rng, hard: bool) -> Sensor:
    """A sensor; ``hard`` makes none above 14 x 14."""
    large = rng.random() < 0.35 and not hard
    layout = str(rng.choice(list(LAYOUTS), p=HARD_SHARES if hard else SHARES))
    channels = LAYOUTS[layout].split()
    pitch, ratio = 10 ** rng.uniform(-3.3, -2.4), log_uniform(rng, 0.5, 3.0)
    modulus = 10 ** rng.uniform(4, 6.7)
    pad, base = draw_pad(rng, layout, ratio * pitch, modulus)
    ends = (24, 41) if large else (8, 15 if hard else 21)
    ny, nx = int(rng.integers(*ends)), int(rng.integers(*ends))
    if layout.startswith("marks") or (len(channels) > 1 and ratio < 0.8):
        ny, nx = min(ny, 20), min(nx, 20)  # the operator of more would be large
    array: Array
    if layout.startswith("marks"):
        y, x = np.meshgrid(np.arange(ny) - (ny - 1) / 2, np.arange(nx) - (nx - 1) / 2, indexing="ij")
        places = np.stack([x, y], -1).reshape(-1, 2) + 0.15 * rng.uniform(-1, 1, (ny * nx, 2))
        array = pp.ScatteredArray(positions=places * pitch, depth=ratio * pitch, channels=channels)
    else:
        aperture = float(pitch * rng.choice([0.0, 0.8])) if layout in ("zz", "three") else 0.0
        depth = "base" if base else ratio * pitch
        array = pp.AreaArray(shape=(ny, nx), pitch=pitch, depth=depth, channels=channels, aperture=aperture)
    return Sensor(layout, (ny, nx), pitch, ratio * pitch, modulus, (nx * pitch / 2, ny * pitch / 2), pad, array)


def draw_pad(rng: Rng, layout: str, depth: float, modulus: float) -> tuple[pp.HalfSpace | pp.BondedLayers, bool]:
    """A pad, and whether the array lies at its base."""
    nu = rng.uniform(0.3, 0.495)
    mostly_layers = layout in ("marks_xy", "marks_xyz", "disp_grid")
    if not (rng.random() < 0.5 or (mostly_layers and rng.random() < 0.7)):
        return pp.HalfSpace(youngs_modulus=modulus, poissons_ratio=nu), False
    base = layout in ("zz", "three") and rng.random() < 0.5
    thickness = depth if base else depth * rng.uniform(1.1, 4.0)
    layers = [(thickness, modulus)]
    if rng.random() < 0.25 and not base:
        layers = [(thickness * 0.3, modulus), (thickness * 0.7 + depth * 0.3, modulus * rng.uniform(0.4, 2.5))]
    return pp.BondedLayers([pp.Layer(thickness=t, youngs_modulus=e, poissons_ratio=nu) for t, e in layers]), base


def draw_contact(rng: Rng, kind: str, sensor: Sensor) -> Contact:
    """A contact; one without a closed form is averaged over 3 x 3 points of each cell."""
    if kind in ("cylinder", "irregular", "two", "tilt"):
        # at most 0.3 of the depth, but no less than a seventh of the pitch
        cell = sensor.pitch / next(n for n in (3, 5, 7) if n == 7 or sensor.pitch / n <= 0.3 * sensor.depth)
        counts = [2 * math.ceil((1.6 if kind == "cylinder" else 1.15) * half / cell) + 3 for half in sensor.half[::-1]]
        ny, nx = (count + (count - taxels) % 2 for count, taxels in zip(counts, sensor.shape))
        grid = pp.AreaGrid(shape=(ny, nx), spacing=cell)
        points = pp.AreaGrid(shape=(3 * ny, 3 * nx), spacing=grid.spacings[0] / 3)
        p = draw_pressure(rng, kind, points, sensor.half).reshape(ny, 3, nx, 3).mean((1, 3))
        return Contact((grid, p / max(p.max(), 1e-12)))
    width, height = sensor.half
    full = kind == "full"  # covers the array
    share = rng.uniform(0.85, 1.8) if full else rng.uniform(0.3, 1.1)
    a = math.hypot(width, height) * share if full else math.sqrt(share * 4 * width * height / math.pi)
    place = [rng.uniform(-0.2, 0.2) * width, rng.uniform(-0.2, 0.2) * height]
    if kind == "beyond":  # its middle lies near an edge of the array
        side, out = int(rng.integers(4)), rng.uniform(0.6, 1.3)
        place[side // 2] = (1 if side % 2 else -1) * out * sensor.half[side // 2]
    form = str(rng.choice(["sphere", "block", "punch"])) if kind in ("beyond", "full") else kind
    if form == "punch":
        contact = pp.solutions.flat_punch(radius=a, force=2 * math.pi * a**2)
    elif form == "sphere":
        contact = pp.solutions.hertz_point(contact_radius=a, force=2 / 3 * math.pi * a**2)
    else:
        ratio, small = rng.uniform(0.8, 1.25), min(width, height)
        sides = (a * 0.886 * ratio, a * 0.886 / ratio)
        if full:
            sides = (width * a / small * ratio * 0.85, height * a / small / ratio * 0.85)
        contact = pp.solutions.patch(half_widths=sides, traction=1.0)
    return Contact(contact.shifted(float(place[0]), float(place[1])))


def smooth_field(rng: Rng, grid: pp.AreaGrid, length: float) -> Floats:
    """White noise smoothed over ``length`` [m], with mean 0 and standard deviation 1."""
    fy, fx = (np.fft.fftfreq(n, spacing) for n, spacing in zip(grid.shape, grid.spacings))
    decay = np.exp(-2 * np.pi**2 * length**2 * (fy[:, None] ** 2 + fx**2))
    field = np.fft.ifft2(np.fft.fft2(rng.standard_normal(grid.shape)) * decay).real
    return (field - field.mean()) / field.std()


def draw_pressure(rng: Rng, kind: str, grid: pp.AreaGrid, half: tuple[float, float]) -> Floats:
    """Pressure at the points of a grid."""
    y, x = np.meshgrid(*grid.axes, indexing="ij")
    width, height = half
    if kind == "cylinder":
        turn = rng.choice([0.0, math.pi / 2, rng.uniform(0, math.pi)])
        across = x * math.cos(turn) + y * math.sin(turn) - rng.uniform(-0.2, 0.2) * min(half)
        along = -x * math.sin(turn) + y * math.cos(turn)
        across_half, along_half = half if abs(math.cos(turn)) > 0.7 else half[::-1]
        dome = np.sqrt(np.maximum(1 - (across / (rng.uniform(0.3, 1.0) * across_half)) ** 2, 0))
        return dome * (np.abs(along) < rng.uniform(0.7, 1.5) * along_half)
    if kind == "irregular":  # islands of a random field
        field = smooth_field(rng, grid, rng.uniform(0.15, 0.4) * min(half))
        on_array = (np.abs(x) < width) & (np.abs(y) < height)
        field = field - np.quantile(field[on_array], 1 - rng.uniform(0.35, 0.95))
        waves = smooth_field(rng, grid, rng.uniform(0.2, 0.6) * min(half))
        rim = np.minimum(np.maximum(field, 0) / 0.3, 1.0)
        return (field > 0) * np.exp(0.4 * waves) * rim ** rng.choice([0.0, 0.5, 1.0])
    if kind == "tilt":  # a plate about as wide as the array, pressed harder towards one side
        turn = rng.choice([0, 1, 2, 3]) * math.pi / 2 if rng.random() < 0.6 else rng.uniform(0, 2 * math.pi)
        low, end = rng.uniform(-0.3, 0.6), rng.uniform(0.85, 1.12)  # low: pressure of one side over the other
        u = x / width * math.cos(turn) + y / height * math.sin(turn)
        plate = np.maximum(low + (1 - low) * (u + 1) / 2, 0)
        return plate * (np.abs(x) < end * width) * (np.abs(y) < end * height)
    pressure, cut = np.zeros_like(x), rng.uniform(-0.2, 0.2)  # two blocks or domes
    u, v = (x / width, y / height) if rng.random() < 0.5 else (y / height, x / width)
    gap = rng.uniform(0.08, 0.25)
    for sign in (-1, 1):
        middle = cut / 2 + sign * (0.5 + gap / 2)
        size, tall = rng.uniform(0.35, 0.5), rng.uniform(0.6, 1.0)
        dome = np.sqrt(np.maximum(1 - (((u - middle) / size) ** 2 + (v / tall) ** 2), 0))
        block = (np.abs(u - middle) < size) & (np.abs(v) < tall)
        pressure += rng.uniform(0.4, 1.0) * (block if rng.random() < 0.5 else dome)
    return pressure


def draw_fault(rng: Rng, name: str, readings: Floats, array: Array, noise: float) -> Floats:
    """Change of the readings by a fault, from 0.2 of the noise to the largest reading."""
    points, count, change = array.points, len(readings), np.zeros_like(readings)
    middle, half = (points.max(0) + points.min(0)) / 2, (points.max(0) - points.min(0)) / 2
    places = ((points - middle) / half)[:, ::-1].T.reshape(2, *readings.shape[1:])  # x and y from -1 to 1
    top = np.abs(readings).max()
    size = log_uniform(rng, 0.2 * noise, top)
    if name == "hidden":
        return draw_hidden(rng, readings, places, noise)
    if name == "broken":
        at = tuple(int(rng.integers(n)) for n in readings.shape[1:])
        how = str(rng.choice(["dead", "stuck", "wild", "low"]))
        for c in range(count) if rng.random() < 0.6 else [int(rng.integers(count))]:
            values = {"dead": 0.0, "stuck": 1.3 * top, "wild": rng.normal() * top, "low": 0.5 * readings[c][at]}
            change[c][at] = values[how] - readings[c][at]
    if name == "gain":
        channel = int(rng.integers(count))
        change[channel] = rng.choice([-0.02, 0.02]) * readings[channel]
    if name in ("none", "gain", "broken"):
        return change
    channels = [int(rng.integers(count))] if rng.random() < 0.5 else list(range(count))
    if name == "rowcol":
        axis = int(rng.integers(2))
        lines = np.round((places[1 - axis] + 1) / 2 * (round(math.sqrt(places[0].size)) - 1))
        for _ in range(int(rng.integers(1, 4))):
            line = rng.choice(np.unique(lines))
            for c in channels:
                change[c][lines == line] += size * rng.choice([-1, 1])
        return change
    for c in channels:
        weight = 1.0 if len(channels) == 1 else rng.uniform(0.3, 1)
        if "offset" in name:
            change[c] += size * weight * rng.choice([-1, 1])
        if "ramp" in name:
            turn = rng.uniform(0, 2 * np.pi) if rng.random() < 0.5 else rng.integers(4) * np.pi / 2
            change[c] += size * rng.uniform(0.5, 1) * weight * (np.cos(turn) * places[0] + np.sin(turn) * places[1])
    return change


def draw_hidden(rng: Rng, readings: Floats, places: Floats, noise: float) -> Floats:
    """An offset, a ramp or both, fitted to each channel of the contact's own readings and added or subtracted."""
    shape = str(rng.choice(["offset", "ramp", "both"]))
    top = np.abs(readings).max()
    size, sign = log_uniform(rng, noise, top), rng.choice([1, 1, -1])
    terms = np.stack([np.ones(places[0].size), places[0].ravel(), places[1].ravel()], 1)
    change = np.zeros_like(readings)
    for c, channel in enumerate(readings):
        fitted = np.linalg.lstsq(terms, channel.ravel(), rcond=None)[0]
        if shape != "both":
            fitted[slice(1, None) if shape == "offset" else 0] = 0
        change[c] = (terms @ fitted).reshape(channel.shape)
    if np.abs(change).max() < 1e-3 * top:
        change[-1] = 1.0
    change *= sign * size / np.abs(change).max()
    return change


def kind_and_fault(seed: int, index: int, hard: bool) -> tuple[str, str]:
    if hard:
        return HARD_KINDS[index % len(HARD_KINDS)], HARD_FAULTS[index % len(HARD_FAULTS)]
    order = np.random.default_rng([seed, 99, index // len(FAULTS)]).permutation(FAULTS)
    return KINDS[index % len(KINDS)], str(order[index % len(FAULTS)])


def make(seed: int, index: int, hard: bool = False, clean: bool = False) -> Frame:
    """Frame ``index`` of a seed; ``clean`` leaves its fault out."""
    rng = np.random.default_rng([seed, index])
    kind, fault = kind_and_fault(seed, index, hard)
    sensor = draw_sensor(rng, hard)
    contact = draw_contact(rng, kind, sensor)
    friction = float(rng.uniform(0.1, 0.5)) if sensor.layout not in ("zz", "strain") and rng.random() < 0.5 else 0.0
    turn = float(rng.uniform(0, 2 * math.pi))
    peak = sensor.modulus * log_uniform(rng, 0.005, 0.2)
    skin = pp.Skin(sensor.pad, sensor.array, uncertainty=EXACT)
    exact, force = contact.press(sensor, skin, peak, friction, turn)
    noise = log_uniform(rng, 0.003, 0.05) * np.abs(exact).max()
    change = draw_fault(rng, fault, exact, sensor.array, noise) * (0 if clean else 1)
    known = str(rng.choice(["zero", "noise", "nothing"], p=[0.4, 0.3, 0.3]))
    given: dict[str, Any] = {}
    if friction and rng.random() >= 0.5:
        given["friction"] = friction * float(rng.choice([1.0, 1.3]))
    rest = noise * rng.standard_normal((30, *exact.shape))
    readings = exact + noise * rng.standard_normal(exact.shape) + change
    if known != "nothing":
        given[known] = rest if known == "zero" else noise
    words = f"{sensor.layout} {sensor.shape}, {known} given, fault {np.abs(change).max() / noise:.2g} times the noise"
    return Frame(skin, readings, given, force, words)


def solve(seed: int, index: int, hard: bool, clean: bool) -> Result:
    """Make a frame, reconstruct it, and compare the normal force with the true one."""
    frame = make(seed, index, hard, clean)
    start = time.perf_counter()
    touch = frame.skin.reconstruct(frame.readings, **frame.given)
    found = (touch.force, *touch.interval(0.95, "force"))
    seconds = time.perf_counter() - start
    force, low, high = (float(np.ravel(np.asarray(v))[-1]) / frame.force for v in found)  # z is the last component
    status = pp.Status.SOLVED if touch.status is None else pp.Status.coded(int(touch.status))
    fit = "none" if touch.fit is None else f"{float(touch.fit):.3f}"  # the linear method does not test it
    warned = str(status) not in ("solved", "no contact") or any(not n.startswith(STANDING) for n in touch.notes)
    wrong = abs(force - 1) > LARGE_ERROR and max(1 - high, low - 1) > LARGE_EXCESS * 0.5 * (high - low)
    wrong = wrong or (not warned and (not math.isfinite(force) or status is pp.Status.NO_CONTACT))
    inside = low <= 1 <= high and (math.isfinite(low) or math.isfinite(high))
    number = math.isfinite(force) and status is not pp.Status.UNDECIDED
    words = f"{frame.words}; {status.label}, fit {fit}: {' | '.join(touch.notes) or 'no note'}"
    what = kind_and_fault(seed, index, hard)
    return Result(index, *what, "", force - 1, (low - 1, high - 1), inside, number, warned, wrong, seconds, words)


def child(pipe: Any, *task: Any) -> None:
    """Send the result of a frame, or the traceback if the program fails."""
    warnings.simplefilter("ignore")
    try:
        pipe.send(solve(*task))
    except Exception:
        pipe.send(traceback.format_exc())


def attempt(index: int, options: argparse.Namespace) -> Result:
    """Solve a frame in a process of its own, and stop it when its time is up."""
    context = get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=child, args=(there, options.seed, index, options.hard, options.clean))
    process.start()
    there.close()
    try:
        found = here.recv() if here.poll(options.timeout) else STOPPED
    except EOFError:
        process.join()
        found = f"the process ended with code {process.exitcode}"
    process.kill()
    process.join()
    failed = Result(index, *kind_and_fault(options.seed, index, options.hard), failure=str(found))
    return found if isinstance(found, Result) else failed


def describe(r: Result) -> str:
    start, (low, high) = f"{r.index:4d} {r.kind:9s} {r.fault:11s} ", r.interval
    if r.failure:
        return start + r.failure.splitlines()[-1]
    mark = ("wrong" if r.warned else "WRONG") if r.wrong else "in" if r.inside else "out"
    return f"{start}{r.seconds:6.1f} s, error {r.error:+.3f} [{low:+.2f} {high:+.2f}] {mark:5s} {r.words}"


def row(name: str, results: list[Result]) -> str:
    done = [r for r in results if not r.failure]
    without = [r for r in done if not r.number]
    error = np.median([abs(r.error) for r in done if r.number] or [math.nan])
    seconds = [r.seconds for r in done] or [math.nan]
    warned = sum(r.warned for r in done) / max(len(done), 1)
    silent, known = (sum(r.wrong and r.warned is said for r in done) for said in (False, True))
    return (
        f"| {name} | {len(results)} | {error:.3f} | {sum(r.inside for r in done)} of {len(done)} | {silent} | {known} "
        f"| {len(without)} / {sum(not r.inside for r in without)} | {warned:.0%} "
        f"| {np.median(seconds):.1f}, {max(seconds):.1f} | {sum(r.failure == STOPPED for r in results)} |"
    )


def page(results: list[Result], command: str) -> str:
    """Both tables, and the frames on which the program failed."""
    lines = [f"Made by `{command}`."]
    for key, names in (("kind", KINDS), ("fault", dict.fromkeys(FAULTS))):
        groups = {name: [r for r in results if getattr(r, key) == name] for name in names} | {"all": results}
        lines += ["", f"| {key} | {COLUMNS} |", "|---" * 10 + "|"]
        lines += [row(name, group) for name, group in groups.items() if group]
    failed = [f"* Failed: {describe(r)}" for r in results if r.failure not in ("", STOPPED)]
    return "\n".join([*lines, "", *failed]).rstrip() + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--from", dest="first", type=int, default=0, help="the first frame")
    parser.add_argument("--hard", action="store_true", help="only small arrays and drift")
    parser.add_argument("--clean", action="store_true", help="leave the faults out")
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds after which a frame is stopped")
    parser.add_argument("--jobs", type=int, default=1, help="frames in parallel")
    parser.add_argument("--each", action="store_true", help="one line for each frame")
    parser.add_argument("--write", action="store_true", help=f"write {TABLE.name}")
    options = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the frames' processes
    results = []
    with ThreadPoolExecutor(options.jobs) as pool:
        for result in pool.map(lambda k: attempt(options.first + k, options), range(options.frames)):
            results.append(result)
            if options.each:
                print(describe(result), flush=True)
    text = page(results, " ".join(["python benchmarks/wide_contacts.py", *sys.argv[1:]]))
    if options.write:
        TABLE.write_text(text, encoding="utf-8")
    print(text)
    sys.exit("\n".join(r.failure for r in results if r.failure not in ("", STOPPED)) or 0)


if __name__ == "__main__":
    main()
