"""Answers of the contact methods on fixed frames, to hold a change of the code against the code before it.

    python benchmarks/golden.py record before.npz              every frame, into a file outside the tree
    python benchmarks/golden.py compare before.npz after.npz   two such files
    python benchmarks/golden.py compare before.npz             the same frames by the code as it is now; exit status 1 where one differs by more than 1e-9
    python benchmarks/golden.py compare before.npz --every 8   every eighth frame of each part, for a quick look
    python benchmarks/golden.py compare before.npz --part few  one part
    python benchmarks/golden.py compare before.npz --only "few 3"  one frame
    python benchmarks/golden.py explain before.npz after.npz [--write]   both answers of each frame beside its truth, into docs/_generated/golden.md
    python benchmarks/golden.py compare before.npz --unreached reached.txt   also the lines of inverse/contact that no frame reached; a file that is there adds its own

Frames come from seeds that nothing else uses: every row of `palpate.bench.trust` (recordings by their zero, without a tracker), the kinds of
`palpate.bench.unseen`, arrays of 3 x 3 to 64 x 64 taxels, and few readings with a zero. Each answer is traction, force, their intervals, that of the peak,
fit, status and notes; the readings and the true traction and force are kept with it. A difference is the largest one over the largest value of the quantity in that frame. It prints no times: other work on the machine
would be in them.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import palpate as pp
from palpate.bench.trust import ROWS, make_frame
from palpate.bench.trust.presses import cell_means
from palpate.bench.unseen import unseen
from palpate.errors import PalpateError
from palpate.status import Status
from palpate.touch import Touch

#: A seed that no test, table or constant of the project was made with, and the frames of each row and kind.
SEED, OF_A_ROW, OF_A_KIND = 39_411_873, 6, 24
#: Largest relative difference of two answers that count as the same.
SAME = 1e-9
#: Kinds of `palpate.bench.unseen`, in the order of their random numbers.
CONTACT_KINDS = ("line", "area", "area with shear")
#: Sides of square arrays, with the number of frames of each.
SIDES = {3: 5, 4: 5, 5: 4, 6: 4, 8: 4, 10: 4, 12: 3, 16: 3, 24: 2, 32: 2, 48: 1, 64: 1}
#: Quantities whose 95 % intervals are kept, with the names that they had.
INTERVALS = {"force": ("force",), "peak_pressure": ("peak_pressure", "peak"), "traction": ("traction",)}

Array = npt.NDArray[Any]
Make = Callable[[], "Case"]


@dataclass(frozen=True)
class Case:
    """One frame, how it is solved, and its truth.

    Attributes
    ----------
    readings : array
        The readings of the frame.
    solve : callable () -> Touch
    traction : callable (Grid) -> array (component, *surface)
        True mean traction in each cell of a surface.
    force : array (component,)
        True net force.
    unit : float
        Unit of errors of the force: the integral of the magnitude of the true traction; of a frame without contact the load that its noise was scaled with.
    least : array (component,) or None
        Smallest force that is right too, if a part of the load is off the array.
    open_above : bool
        The readings do not bound the load from above.
    """

    readings: Array
    solve: Callable[[], Touch]
    traction: Callable[[Any], Array]
    force: Array
    unit: float
    least: Array | None = None
    open_above: bool = False


def trust_frames() -> Iterator[tuple[str, Make]]:
    """Frames of every row of the table of trust."""
    for row in ROWS:
        for i in range(OF_A_ROW):
            yield f"trust {row} {i}", partial(_of_trust, row, i)


def _of_trust(row: str, index: int) -> Case:
    frame = make_frame(row, index, seed=SEED)
    options: dict[str, Any] = {} if frame.friction is None else {"friction": frame.friction}
    readings = frame.readings if frame.recorded is None else frame.recorded.steps[-1]
    if frame.recorded is not None:
        options["zero"] = frame.recorded.rest
    return Case(
        readings,
        lambda: frame.skin.reconstruct(readings, **options),
        lambda surface: cell_means(frame.load, surface),
        frame.load.force,
        frame.typical.size,
        None if frame.least is None else frame.least.force,
        frame.open_above,
    )


def unseen_frames() -> Iterator[tuple[str, Make]]:
    """Frames of the population that tuned nothing; every fourth by the method of one penalty, every fifth with draws."""
    for k, kind in enumerate(CONTACT_KINDS):
        for i in range(OF_A_KIND):
            yield f"unseen {kind} {i}", partial(_of_unseen, k, i, kind)


def _of_unseen(number: int, index: int, kind: str) -> Case:
    sample = unseen(np.random.default_rng((SEED, number, index)), kind)
    options: dict[str, Any] = {} if sample.friction is None else {"friction": sample.friction}
    if index % 4 == 3:
        options["method"] = "constrained"
    elif index % 5 == 4:
        options["draws"] = 3
    surface = sample.layout.skin.surface
    force, size = _sums(sample.truth, surface)
    return Case(
        sample.readings,
        lambda: sample.layout.skin.reconstruct(sample.readings, components=list(sample.layout.components), **options),
        lambda grid: sample.truth,
        force,
        1.0 if sample.empty else size,
    )


def _sums(traction: Array, grid: Any) -> tuple[Array, float]:
    """Net force of a traction, and the integral of its magnitude."""
    axes = tuple(range(1, traction.ndim))
    return traction.sum(axis=axes) * grid.cell, float(np.sqrt((traction**2).sum(axis=0)).sum() * grid.cell)


def size_frames() -> Iterator[tuple[str, Make]]:
    """Balls and punches on square arrays; in turn plain, with offsets, with friction, with noise that is given, of displacements."""
    for side, count in SIDES.items():
        for i in range(count):
            yield f"size {side} {i}", partial(_of_size, side, i)


def _of_size(side: int, index: int) -> Case:
    rng = np.random.default_rng((SEED, side, index))
    pad: Any = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    channels, kinds = ["stress_xz", "stress_yz", "stress_zz"], "stress"
    if index % 5 == 4 or (side >= 24 and index == 1):
        pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
        channels, kinds = ["displacement_x", "displacement_y"], "displacement"
    array = pp.AreaArray(shape=(side, side), pitch=1e-3, depth=float(rng.uniform(0.5, 1.2)) * 1e-3, channels=channels)
    half = 0.5e-3 * side
    radius = float(rng.uniform(0.25, 0.6)) * half
    center = tuple(float(v) for v in rng.uniform(-0.25, 0.25, 2) * half)
    ball = pp.solutions.hertz_point(contact_radius=radius, force=2.0).shifted(*center)
    if index % 2:
        ball = ball.sliding(0.3, direction=0.4)
    clean = np.asarray(pp.Skin(pad, array).sense(ball))
    top = float(np.abs(clean).max())
    level = float(np.exp(rng.uniform(math.log(1e-3), math.log(5e-2))))
    readings = clean + level * top * rng.standard_normal(clean.shape)
    if index % 4 == 2:
        readings = readings + 0.2 * top * rng.uniform(-1, 1, (len(channels), 1, 1))
    if index % 3 == 1:
        array = pp.AreaArray(
            shape=(side, side), pitch=1e-3, depth=array.depth, channels=channels, noise=[level * top] * len(channels)
        )
    options: dict[str, Any] = {"friction": 0.5} if index % 2 and kinds == "stress" else {}
    return _of_ball(ball, readings, lambda: pp.Skin(pad, array).reconstruct(readings, **options))


def _of_ball(ball: Any, readings: Array, solve: Callable[[], Touch], pressed: float = 1.0) -> Case:
    """A case of a closed form; ``pressed`` is 0 if it does not touch."""
    return Case(
        readings,
        solve,
        lambda surface: pressed * ball.averages(*surface.axes[::-1]),
        pressed * ball.force,
        float(np.linalg.norm(ball.force)),
    )


def few_frames() -> Iterator[tuple[str, Make]]:
    """Four to forty readings with frames at rest: pressed, not pressed, uneven gains, one reading at its end."""
    for i in range(32):
        yield f"few {i}", partial(_of_few, i)


def _of_few(index: int) -> Case:
    rng = np.random.default_rng((SEED, 7, index))
    pad = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    channels = [["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"], ["strain_zz"]][index % 3]
    shape = [(2, 2), (1, 4), (2, 3), (3, 3), (3, 4)][index % 5]
    limits = None
    array = pp.AreaArray(shape=shape, pitch=2e-3, depth=1e-3, channels=channels)
    ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=float(rng.uniform(0.2, 3.0)))
    ball = ball.shifted(float(rng.uniform(-1, 1)) * 1e-3, 0.0)
    clean = np.asarray(pp.Skin(pad, array).sense(ball))
    top = float(np.abs(clean).max())
    std = float(np.exp(rng.uniform(math.log(3e-4), math.log(3e-2)))) * top
    offset = top * rng.uniform(-1, 1, clean.shape)
    touches = float(index % 4 != 3)
    pressed = clean * touches * (1.0 + 0.1 * (index % 2) * rng.standard_normal(clean.shape))
    rest = offset + std * rng.standard_normal((20, *clean.shape))
    frame = offset + pressed + std * rng.standard_normal(clean.shape)
    if index % 7 == 6:
        high = float(frame.max()) - 0.1 * top
        limits = [(float(frame.min()) - top, high)] * len(channels)
        frame = np.minimum(frame, high)
        array = pp.AreaArray(shape=shape, pitch=2e-3, depth=1e-3, channels=channels, limits=limits)
    return _of_ball(ball, frame, lambda: pp.Skin(pad, array).reconstruct(frame, zero=rest), touches)


PARTS: dict[str, Callable[[], Iterator[tuple[str, Make]]]] = {
    "trust": trust_frames,
    "unseen": unseen_frames,
    "size": size_frames,
    "few": few_frames,
}
#: Quantities of a record that are no answer of the method.
TRUTHS = ("true force", "true traction", "unit", "least", "open above", "readings")


def answer(make: Make) -> dict[str, Array]:
    """What is kept of one answer, with the truth; a refusal is kept by its words."""
    out: dict[str, Any] = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            case = make()
            out |= {"readings": case.readings, "true force": case.force, "unit": case.unit}
            out["open above"] = case.open_above
            if case.least is not None:
                out["least"] = case.least
            touch = case.solve()
    except PalpateError as error:
        return {k: np.asarray(v) for k, v in out.items()} | {"refused": np.array(f"{type(error).__name__}: {error}")}
    out |= {"traction": np.asarray(touch.values), "force": np.asarray(touch.force)}
    out |= {"true traction": case.traction(touch.surface), "components": "".join(touch.components)}
    for of, names in INTERVALS.items():
        for name in names:
            with contextlib.suppress(PalpateError):
                out[f"interval of {of}"] = np.stack([np.asarray(v) for v in touch.interval(0.95, of=name)])
                break
    out["fit"] = math.nan if touch.fit is None else touch.fit
    out["status"] = touch.status
    out["notes"] = "\n".join(touch.notes)
    if touch.draws is not None:
        out["draws"] = touch.draws
    return {k: np.asarray(v) for k, v in out.items()}


def difference(one: Array, other: Array) -> float:
    """The largest difference over the largest value; infinite where shapes, words or gaps differ."""
    if one.shape != other.shape:
        return math.inf
    if one.dtype.kind not in "fc":
        return 0.0 if np.array_equal(one, other) else math.inf
    known = np.isfinite(one)
    if not np.array_equal(known, np.isfinite(other)) or not np.array_equal(one[~known], other[~known], equal_nan=True):
        return math.inf
    size = float(np.abs(one[known]).max(initial=0.0))
    off = float(np.abs(one[known] - other[known]).max(initial=0.0))
    return off / size if size > 0 else (0.0 if off == 0 else math.inf)


CONTACT = Path(pp.__file__).parent / "inverse" / "contact"


class Reached:
    """Lines of inverse/contact that were run."""

    def __init__(self) -> None:
        self.lines: set[tuple[str, int]] = set()
        self._names: dict[str, str | None] = {}
        sys.settrace(self._call)

    def _call(self, frame: Any, event: str, value: Any) -> Any:
        file = frame.f_code.co_filename
        if file not in self._names:
            inside = file.startswith(str(CONTACT))
            self._names[file] = str(Path(file).relative_to(CONTACT)) if inside else None
        return None if self._names[file] is None else self._line

    def _line(self, frame: Any, event: str, value: Any) -> Any:
        self.lines.add((self._names[frame.f_code.co_filename] or "", frame.f_lineno))
        return self._line

    def report(self, file: Path) -> None:
        """Add to the file what was reached, and print the lines that were not, by file."""
        if file.exists():
            self.lines |= {(a, int(b)) for a, b in (line.rsplit(":", 1) for line in file.read_text().splitlines())}
        file.write_text("".join(f"{a}:{b}\n" for a, b in sorted(self.lines)))
        for path in sorted(CONTACT.rglob("*.py")):
            name = str(path.relative_to(CONTACT))
            body = [
                n for f in ast.walk(ast.parse(path.read_text())) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)
            ]
            starts = {n.lineno for n in body if isinstance(n, ast.stmt) and not isinstance(n, ast.FunctionDef)}
            docs = {n.lineno for n in body if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
            missing = sorted(starts - docs - {b for a, b in self.lines if a == name})
            if missing:
                print(f"  {name}: {', '.join(map(str, missing))}")


def frames(parts: list[str], every: int, only: list[str] | None = None) -> Iterator[tuple[str, Make]]:
    for part in parts:
        yield from ((n, make) for n, make in list(PARTS[part]())[::every] if only is None or n in only)


def answers_in(file: Path) -> dict[str, dict[str, Array]]:
    """Answers that were recorded, by frame."""
    out: dict[str, dict[str, Array]] = {}
    with np.load(file) as kept:
        for key in kept.files:
            name, quantity = key.rsplit("/", 1)
            out.setdefault(name, {})[quantity] = kept[key]
    return out


# -- changes against the truth -------------------------------------------------------------------------------------------------

TABLE = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "golden.md"
#: Causes in words, and the cause of each frame that changed: `benchmarks/golden_causes.py` finds the commits.
CAUSES = Path(__file__).with_name("data") / "golden_causes.json"
#: An error is worse if it is larger by this factor, and larger than one standard deviation of the interval.
LARGER = 1.1
#: Numbers of an answer; notes and the misfit probability are compared apart.
NUMBERS = ("traction", "force", *(f"interval of {of}" for of in INTERVALS), "status", "refused")
#: Differences below this part of the load are rounding errors.
EXACT = 1e-6


@dataclass(frozen=True)
class Judged:
    """One answer beside the truth; errors of the force in parts of the load, of traction and peak in parts of their truth."""

    status: str
    notes: tuple[str, ...]
    force: float
    traction: float
    peak: float
    held: bool | None
    peak_held: bool | None
    stated: tuple[float, float, float]
    contact: bool

    @property
    def errors(self) -> tuple[float, float, float]:
        """Errors of force, traction and peak."""
        return self.force, self.traction, self.peak


def _size(values: Array) -> float:
    return float(np.linalg.norm(np.nan_to_num(values, posinf=1e100, neginf=-1e100)))


def _within(low: Array, high: Array, smallest: Array, largest: Array, slack: float, open_above: bool) -> bool | None:
    """Whether an interval contains the truth; None without an interval."""
    if np.isnan(low).all():
        return None
    if open_above and np.isfinite(np.ravel(high)[-1]):
        return False
    return bool(np.all((low <= largest + slack) & (high >= smallest - slack)))


def judged(kept: dict[str, Array]) -> Judged:
    """Compare an answer with the truth; quantities that are not estimated are left out."""
    true, unit = kept["true force"], float(kept["unit"])
    contact = bool(np.any(true))
    none = (math.nan,) * 3
    if "refused" in kept:
        return Judged(str(kept["refused"]).partition(":")[0], (), *none, None, None, none, contact)
    names = ("x", "z") if len(true) == 2 else ("x", "y", "z")
    part = [i for i, c in enumerate(names) if c in str(kept["components"])]
    least = kept.get("least", true)
    smallest, largest = np.minimum(least, true)[part], np.maximum(least, true)[part]
    force, values, truth = kept["force"][part], kept["traction"][part], kept["true traction"][part]
    error = math.nan if np.isnan(force).any() else _size(force - np.clip(force, smallest, largest)) / unit
    norm, top = _size(truth), float(np.abs(truth[-1]).max())
    peak = float(truth[-1].max() if (truth[-1] > 0).any() else truth[-1].min())
    found = float(values[-1].max())
    both = np.full((2, len(true)), math.nan)
    low, high = kept.get("interval of force", both)[:, part]
    peak_low, peak_high = kept.get("interval of peak_pressure", np.full(2, math.nan))
    cells = kept.get("interval of traction")
    open_above = bool(kept["open above"])
    stated = (
        _size(high - low) / 3.92 / unit,
        math.nan if cells is None or norm == 0 else _size(cells[1][part] - cells[0][part]) / 3.92 / norm,
        float(peak_high - peak_low) / 3.92 / top if top > 0 else math.nan,
    )
    lost = math.nan if norm == 0 or np.isnan(values).any() else _size(values - truth) / norm
    at_peak = math.nan if top == 0 else abs(found - peak) / top
    return Judged(
        Status.coded(int(kept["status"])).label,
        tuple(n for n in str(kept["notes"]).split("\n") if n),
        error,
        lost,
        at_peak,
        _within(low, high, smallest, largest, EXACT * unit, open_above),
        _within(peak_low, peak_high, np.asarray(peak), np.asarray(peak), EXACT * top, False),
        stated,
        contact,
    )


#: Statuses without an answer.
UNKNOWN = ("unexplained", "undecided", "failed", "missing")


def worse(before: Judged, after: Judged) -> list[str]:
    """In which ways an answer became worse."""
    out = []
    if before.status != after.status:
        if after.status in UNKNOWN or after.status not in ("solved", "no contact"):
            lost = before.status == "solved" and before.held is not False and after.status in UNKNOWN
            out += [f"{before.status} -> {after.status}"] if lost else []
        elif (after.status == "solved") != after.contact:
            out.append(f"{before.status} -> {after.status}")
    for what, then, now, std in zip(("force", "traction", "peak"), before.errors, after.errors, after.stated):
        if now > LARGER * then + EXACT and not now <= std:
            out.append(f"error of {what} {then:.2g} -> {now:.2g}")
    if before.held and not after.held:
        out.append("interval lost the force" if after.held is False else "no interval of the force any more")
    if before.peak_held and not after.peak_held:
        out.append("interval lost the peak" if after.peak_held is False else "no interval of the peak any more")
    return out


def larger(before: Judged, after: Judged) -> bool:
    """Whether the error of the traction grew by more than 10 %; of the force, where there is no contact or no traction."""
    then, now = before.traction, after.traction
    if not math.isfinite(then + now):
        then, now = before.force, after.force
    return now > LARGER * then + EXACT


def _median(values: list[float]) -> str:
    known = [v for v in values if math.isfinite(v)]
    return f"{float(np.median(known)):.2g}" if known else ""


def _pair(sides: list[tuple[Judged, Judged]], number: Callable[[Judged], float]) -> str:
    """Median before and after, of frames where both are known."""
    both = [(number(a), number(b)) for a, b in sides]
    both = [(a, b) for a, b in both if math.isfinite(a) and math.isfinite(b)]
    return f"{_median([a for a, _ in both])} -> {_median([b for _, b in both])}" if both else ""


def _held(sides: list[tuple[Judged, Judged]], of: Callable[[Judged], bool | None]) -> str:
    return " -> ".join(
        f"{sum(bool(v) for v in one)} of {sum(v is not None for v in one)}"
        for one in ([of(a) for a, _ in sides], [of(b) for _, b in sides])
    )


def _row(*entries: object) -> str:
    return "| " + " | ".join(str(e).replace("|", "/").replace("\n", " ") for e in entries) + " |"


def _head(*names: str) -> list[str]:
    return [_row(*names), "|" + "---|" * len(names)]


def page(before: dict[str, dict[str, Array]], after: dict[str, dict[str, Array]]) -> str:
    """The page that compares both answers of every frame with its truth."""
    known = json.loads(CAUSES.read_text(encoding="utf-8")) if CAUSES.exists() else {"causes": {}, "frames": {}}
    causes, cause_of = known["causes"], known["frames"]
    names = [n for n in before if n in after]
    off = {
        n: max((difference(before[n][q], after[n].get(q, np.array("")))) for q in NUMBERS if q in before[n])
        if set(before[n]) & set(NUMBERS) == set(after[n]) & set(NUMBERS)
        else math.inf
        for n in names
    }
    moved = [n for n in names if difference(before[n]["readings"], after[n]["readings"]) > SAME]
    changed = [n for n in names if off[n] > SAME]
    sides = {n: (judged(before[n]), judged(after[n])) for n in names}
    ways = {n: worse(*sides[n]) for n in changed}
    bad = [n for n in changed if ways[n]]
    less, more = (sum(larger(*sides[n][::k]) for n in changed) for k in (-1, 1))
    out = [
        "# Answers before and after the rework of the contact method",
        "",
        "Made by `python benchmarks/golden.py explain BEFORE AFTER --write`, where `golden.py record` made both files: BEFORE with the source of commit 98c88178, AFTER with the source of this one. "
        "Errors: of the force in parts of the load; of the traction, the norm of its error in parts of the norm of the truth; of the peak in parts of the true peak. "
        "Medians are over the changed frames with a number on both sides. Held: frames whose 95 % interval contains the truth, of those with an interval.",
        "",
        f"{len(names)} frames: {len(names) - len(changed)} are equal to {SAME:g}, {len(changed)} changed ({sum(off[n] <= 1e-3 for n in changed)} of these by at most 0.1 %). "
        f"The error of the traction became smaller by more than 10 % in {less} frames, and larger in {more}; {len(bad)} frames became worse as defined below. "
        f"The readings of {len(moved)} frames differ between the two records.",
        "",
        "## By kind of frame",
        "",
        *_head("kind", "equal", "changed", "error of force", "of traction", "of peak", "force held", "peak held", "status changed", "smaller error", "larger error", "worse"),
    ]  # fmt: skip
    by_kind: dict[str, list[str]] = {}
    for n in names:
        by_kind.setdefault(n.rsplit(" ", 1)[0], []).append(n)
    for kind, members in [*by_kind.items(), ("all", names)]:
        them = [n for n in members if n in ways]
        out.append(
            _summary(kind, [len(members) - len(them), len(them)], [sides[n] for n in them], [ways[n] for n in them])
        )
    out += [
        "",
        "## By cause",
        "",
        "The cause of a frame is the commit with the largest change of its answer (`benchmarks/golden_causes.py`). The rules that c70a0995 deleted were left out one by one in the code before it: the cause is the rule that changes the frame most.",
        "",
        *_head("cause", "commit", "changed", "error of force", "of traction", "of peak", "force held", "peak held", "status changed", "smaller error", "larger error", "worse"),
    ]  # fmt: skip
    by_cause: dict[str, list[str]] = {}
    for n in changed:
        by_cause.setdefault(cause_of.get(n, ""), []).append(n)
    for commit, them in sorted(by_cause.items(), key=lambda item: -len(item[1])):
        words = causes.get(commit, "not known")
        out.append(_summary(words, [commit, len(them)], [sides[n] for n in them], [ways[n] for n in them]))
    out += ["", "## Frames whose status changed", "", *_head("frame", "truth", "before", "after", "commit")]
    for n in changed:
        a, b = sides[n]
        if a.status != b.status:
            out.append(_row(n, "contact" if a.contact else "no contact", a.status, b.status, cause_of.get(n, "")))
    out += [
        "",
        "## Frames that became worse",
        "",
        f"An error counts as worse if it grew by more than {100 * (LARGER - 1):.0f} % and exceeds one standard deviation of the new interval. A status counts as worse if a solved frame, whose interval did not exclude the truth, is not answered any more, or if contact is found where there is none. Notes: what the new answer says.",
        "",
        *_head("frame", "what", "cause", "notes after"),
    ]
    out += [_row(n, "; ".join(ways[n]), causes.get(cause_of.get(n, ""), ""), _short(sides[n][1].notes)) for n in bad]
    out += [
        "",
        "## Every frame that changed",
        "",
        *_head(
            "frame", "change", "error of force", "of traction", "of peak", "force held", "peak held", "notes", "commit"
        ),
    ]
    for n in changed:
        a, b = sides[n]
        numbers = [f"{x:.2g} -> {y:.2g}" for x, y in zip(a.errors, b.errors)]
        held = [f"{WORDS[x]} -> {WORDS[y]}" for x, y in ((a.held, b.held), (a.peak_held, b.peak_held))]
        notes = f"{len(a.notes)} -> {len(b.notes)}"
        out.append(_row(n, f"{off[n]:.1g}", *numbers, *held, notes, cause_of.get(n, "")))
    return "\n".join(out) + "\n"


WORDS = {True: "yes", False: "no", None: "none"}


def _summary(title: str, counts: list[Any], sides: list[tuple[Judged, Judged]], ways: list[list[str]]) -> str:
    return _row(
        title,
        *counts,
        *(_pair(sides, attrgetter(k)) for k in ("force", "traction", "peak")),
        _held(sides, lambda j: j.held),
        _held(sides, lambda j: j.peak_held),
        sum(a.status != b.status for a, b in sides),
        sum(larger(b, a) for a, b in sides),
        sum(larger(a, b) for a, b in sides),
        sum(map(bool, ways)),
    )


def _short(notes: tuple[str, ...]) -> str:
    return "; ".join(n if len(n) <= 60 else n[:57] + "..." for n in notes) or "none"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "compare", "explain"])
    parser.add_argument("file", type=Path)
    parser.add_argument(
        "after", type=Path, nargs="?", help="answers to compare with (default: by the code as it is now)"
    )
    parser.add_argument("--every", type=int, default=1, help="only every so many frames of each part")
    parser.add_argument("--part", choices=list(PARTS), action="append", help="only this part (may be repeated)")
    parser.add_argument("--unreached", type=Path, help="keep lines that are reached in this file, and print the others")
    parser.add_argument("--write", action="store_true", help="write the page of `explain` into docs/_generated")
    parser.add_argument("--only", action="append", help="only this frame (may be repeated)")
    given = parser.parse_args()
    if given.what == "explain":
        if given.after is None:
            parser.error("explain needs two files: python benchmarks/golden.py explain before.npz after.npz")
        text = page(answers_in(given.file), answers_in(given.after))
        if given.write:
            TABLE.write_text(text, encoding="utf-8")
        print(text)
        return 0
    reached = Reached() if given.unreached else None
    parts = given.part or list(PARTS)
    if given.what == "record":
        kept = {}
        if given.file.exists():
            kept = dict(np.load(given.file))
        for name, make in frames(parts, given.every, given.only):
            kept |= {f"{name}/{k}": v for k, v in answer(make).items()}
        np.savez_compressed(given.file, **kept)
        if reached is not None:
            reached.report(given.unreached)
        print(f"{len({k.rsplit('/', 1)[0] for k in kept})} frames in {given.file}")
        return 0
    before = answers_in(given.file)
    after = None if given.after is None else answers_in(given.after)
    largest: dict[str, float] = {}
    worst: list[tuple[float, str, str]] = []
    count = 0
    for name, make in frames(parts, given.every, given.only):
        if name not in before or (after is not None and name not in after):
            continue
        count += 1
        now, then = answer(make) if after is None else after[name], before[name]
        for quantity in sorted(then):
            off = difference(then[quantity], now[quantity]) if quantity in now else math.inf
            largest[quantity] = max(largest.get(quantity, 0.0), off)
            if off > SAME:
                worst.append((off, name, quantity))
    print(f"{count} frames, largest relative difference:")
    for quantity, off in sorted(largest.items()):
        print(f"  {quantity:22} {off:.2g}")
    changed = dict.fromkeys(name for _, name, _ in worst)
    for name in changed:
        print(f"  {name}: " + ", ".join(f"{q} {off:.2g}" for off, n, q in worst if n == name))
    print(f"{len(changed)} of {count} frames differ by more than {SAME:g}")
    if reached is not None:
        reached.report(given.unreached)
    return int(bool(worst))


if __name__ == "__main__":
    sys.exit(main())
