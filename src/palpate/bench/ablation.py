"""Measure the contribution of each part of the automatic method, and the sensitivity of the result to its numbers.

Every frame of a population that was not used for tuning (`palpate.bench.unseen`) is solved by the whole method,
without each part, and with each number halved and doubled (`palpate.inverse.contact.policy`). Errors are relative to
those of the whole method in the same frame.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.bench.accuracy import spread_over
from palpate.bench.unseen import CONTACT_KINDS, Sample, unseen
from palpate.elastic.pad import Floats
from palpate.inverse.contact.methods import Automatic, AutomaticEstimator
from palpate.inverse.contact.policy import Policy, changed, numbers
from palpate.inverse.problem import Problem
from palpate.touch import Touch
from palpate.uncertainty import Calibration

__all__ = ["Ablated", "Outcome", "Row", "ablation", "as_markdown", "summary", "variants"]

#: Number of bootstrap samples.
RESAMPLED = 2000


@dataclass(frozen=True, kw_only=True)
class Ablated(Automatic):
    """The automatic method without some of its parts or with other numbers, for problems that estimate pressure."""

    policy: Policy = field(default_factory=Policy)

    def prepare(self, problem: Problem) -> AutomaticEstimator:
        """Prepare as `Automatic` does."""
        return self._prepared_by(problem, self.policy)


#: Parts that can replace each other are also removed together. Rims are compared for a pull without a search for rims.
JOINT_PARTS: dict[str, tuple[str, ...]] = {
    "local weights, both": ("parts.wide_weights", "parts.narrow_weights"),
    "outliers and broken readings": ("parts.screening", "parts.outliers"),
    "contact that pulls, and rims": ("parts.pulls", "parts.rims"),
}


def variants(*, thresholds: bool = True) -> dict[str, Policy]:
    """Rows of the table: the method without each part; with ``thresholds``, underived numbers halved and doubled."""
    whole = Policy()
    out: dict[str, Policy] = {}
    for one in numbers():
        if one.part:
            out[f"without: {one.why}"] = changed(whole, one.name, False)
    for name, off in JOINT_PARTS.items():
        policy = whole
        for part in off:
            policy = changed(policy, part, False)
        out[f"without: {name}"] = policy
    for one in numbers():
        if one.part or not thresholds or not one.tried or isinstance(one.value, tuple):
            continue
        for factor, word in ((0.5, "x 0.5"), (2.0, "x 2")):
            value = type(one.value)(one.value * factor)
            if value != one.value:
                out[f"{one.name} {one.value:.3g} {word}"] = changed(whole, one.name, value)
    return out


@dataclass(frozen=True)
class Outcome:
    """Result of one frame by one variant: relative error (NaN without contact or without an answer), whether the 95 %
    intervals of normal force contain the truth (calibrated, and 1.96 of the model's own standard deviations; None: no
    error bars), whether contact was found (None: no answer, as for undecided frames), processor time [s].
    """

    error: float
    covered: bool | None
    plain: bool | None
    touching: bool | None
    seconds: float


def _outcome(sample: Sample, method: Ablated) -> Outcome:
    skin, names = sample.layout.skin, list(sample.layout.components)
    method.prepare(skin.problem(components=names))  # cached preparation is not part of the time
    started = time.process_time()
    touch = skin.reconstruct(sample.readings, method=method, components=names)
    seconds = time.process_time() - started
    columns = [skin.surface.components.index(c) for c in names]
    size = float(np.linalg.norm(sample.truth[columns]))
    difference = float(np.linalg.norm((np.asarray(touch.values) - sample.truth)[columns]))
    true = float(np.asarray(Touch(sample.truth, skin.surface, touch.components, "truth").force)[-1])
    touching = bool(np.asarray(touch.values).any()) if math.isfinite(difference) else None
    error = difference / size if size > 0 else math.nan
    if touch._errors is None or touching is None:
        return Outcome(error, None, None, touching, seconds)
    low, high = (np.asarray(v)[..., -1] for v in touch.interval(0.95, of="force"))
    posterior = touch._errors.posterior
    std = np.hypot(posterior.force[-1], posterior.outside_force[-1])
    bounds = Calibration().bounds(0.95, np.asarray(touch.force)[-1], std, np.zeros(()), np.asarray(-math.inf))
    return Outcome(
        error,
        bool(low <= true <= high),
        bool(bounds[0] <= true <= bounds[1]),
        touching,
        seconds,
    )


def acts(sample: Sample, policy: Policy) -> bool:
    """Return whether a variant can change the result of this frame."""
    has = {
        "": True,
        "friction": sample.friction is not None,
        "shear": len(sample.layout.components) > 1,
        "channels": len(sample.layout.array.channels) > 1,
    }
    return any(has[one.needs] for one, plain in zip(numbers(policy), numbers()) if one.value != plain.value)


def _one_frame(task: tuple[int, int, str, bool]) -> tuple[str, bool, dict[str, Outcome]]:
    seed, index, kind, thresholds = task
    sample = unseen(np.random.default_rng((seed, index)), kind)
    whole = Ablated(friction=sample.friction)
    _outcome(sample, whole)  # finer grids are made when they are first needed
    out = {"whole": _outcome(sample, whole)}
    for name, policy in variants(thresholds=thresholds).items():
        other = Ablated(friction=sample.friction, policy=policy)
        out[name] = _outcome(sample, other) if acts(sample, policy) else out["whole"]
    return sample.kind, sample.empty, out


def ablation(
    frames: int = 60,
    *,
    numbers: int = 20,
    kinds: Sequence[str] = tuple(CONTACT_KINDS),
    seed: int = 2024,
    seconds: float | None = None,
    jobs: int = 1,
    report: Callable[[int], None] | None = None,
) -> list[tuple[str, bool, dict[str, Outcome]]]:
    """Return for each frame its kind, whether nothing touches, and the outcome of every variant ("whole" first).

    ``kinds``: those of `palpate.bench.unseen.CONTACT_KINDS` to use, in turn. ``numbers``: on how many of the frames
    halved and doubled numbers are tried.
    ``seconds``: no frame is started after this much wall-clock time, and only the finished frames are returned.
    """
    tasks = [(seed, i, kinds[i % len(kinds)], i < numbers) for i in range(frames)]
    found: list[tuple[str, bool, dict[str, Outcome]]] = []
    started = time.monotonic()
    while len(found) < frames and (seconds is None or not found or time.monotonic() - started < seconds):
        # with a time limit, work in turns and check the time between them
        turn = tasks[len(found) :] if seconds is None else tasks[len(found) : len(found) + jobs]
        for one in spread_over(_one_frame, turn, jobs):
            found.append(one)
            if report is not None:
                report(len(found))
    return found


@dataclass(frozen=True)
class Row:
    """A variant compared with the whole method.

    ``mean`` is the geometric mean of the ratios of errors, over contacts that both answer; ``low`` and ``high`` are its
    95 % interval (bootstrap over frames). ``kinds`` is the same mean for each kind with its relative standard error
    (NaN for a single frame) and the number of frames. ``worst`` is the largest ratio, ``largest`` the largest error,
    ``changed`` the fraction of contacts with another result. ``missed``, ``alarms`` and ``unanswered`` are the numbers
    of contacts that were not found, of empty frames taken for contact and of all frames without an answer. ``coverage`` and ``plain`` are those of `Outcome`, ``time`` is the processor time relative to
    that of the whole method.
    """

    name: str
    frames: int
    mean: float
    low: float
    high: float
    kinds: dict[str, tuple[float, float, int]]
    worst: float
    largest: float
    changed: float
    missed: int
    alarms: int
    unanswered: int
    coverage: float
    plain: float
    time: float


def summary(found: Sequence[tuple[str, bool, dict[str, Outcome]]], seed: int = 0) -> list[Row]:
    """Return the table: one row for the whole method, and one for each variant."""
    rng = np.random.default_rng(seed)
    rows = []
    for name in dict.fromkeys(name for _, _, by in found for name in by):
        touched = [(kind, by) for kind, empty, by in found if not empty and name in by]
        empties = [by for _, empty, by in found if empty and name in by]
        if not touched:
            continue
        outcomes = [by[name] for _, by in touched]
        both = [(kind, by) for kind, by in touched if math.isfinite(by[name].error + by["whole"].error)]
        if not both:
            continue
        kinds = np.array([kind for kind, _ in both])
        picks = rng.integers(len(both), size=(RESAMPLED, len(both)))
        logs = np.log([by[name].error / by["whole"].error for _, by in both])
        appeared = sum(math.isfinite(by[name].error) != math.isfinite(by["whole"].error) for _, by in touched)
        low, high = np.exp(np.quantile(logs[picks].mean(axis=1), [0.025, 0.975]))
        covered = [o.covered for o in outcomes if o.covered is not None]
        plain = [o.plain for o in outcomes if o.plain is not None]
        rows.append(
            Row(
                name,
                len(touched),
                float(np.exp(logs.mean())),
                float(low),
                float(high),
                {k: _mean(logs[kinds == k]) for k in CONTACT_KINDS if (kinds == k).any()},
                float(np.exp(logs.max())),
                max(by[name].error for _, by in both),
                (int((logs != 0.0).sum()) + appeared) / len(touched),
                sum(o.touching is False for o in outcomes),
                sum(by[name].touching is True for by in empties),
                sum(o.touching is None for o in [*outcomes, *(by[name] for by in empties)]),
                float(np.mean(covered)) if covered else math.nan,
                float(np.mean(plain)) if plain else math.nan,
                float(np.sum([o.seconds for o in outcomes]) / np.sum([by["whole"].seconds for _, by in touched])),
            )
        )
    return rows


def _mean(logs: Floats) -> tuple[float, float, int]:
    """Return the geometric mean, its relative standard error, and the number of values."""
    count = len(logs)
    return float(np.exp(logs.mean())), float(logs.std(ddof=1) / math.sqrt(count)) if count > 1 else math.nan, count


def as_markdown(rows: Sequence[Row], *, command: str, empty: int) -> str:
    """Return the table as a section of a page; ``empty`` is the number of empty frames."""
    whole = rows[0]
    counts = ", ".join(f"{count} of {kind}" for kind, (_, _, count) in whole.kinds.items())
    lines = [
        f"Made by `{command}`: {whole.frames} contacts (with an answer: {counts}) and {empty} empty frame{'' if empty == 1 else 's'} not used for tuning (`palpate.bench.unseen`). Columns: error divided by that "
        "of the whole method (geometric mean over frames, 95 % interval; then for each kind, with its standard error), largest ratio, largest error, share of "
        "contacts with another result, number of contacts, contacts missed, false alarms, frames without an answer (undecided; not in the columns of errors), share of true normal forces inside the 95 % interval, processor time "
        "divided by that of the whole method.",
        "",
        f"| | error | {' | '.join(whole.kinds)} | largest ratio | largest error | frames changed | contacts | contacts missed | false alarms | no answer | force inside 95 % | time ratio |",
        f"|---|---|{'---|' * len(whole.kinds)}---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        each = " | ".join(_with_error(*r.kinds[k]) if k in r.kinds else "" for k in whole.kinds)
        lines.append(
            f"| {r.name} | {r.mean:.3f} ({r.low:.3f} to {r.high:.3f}) | {each} | {r.worst:.2f} | {r.largest:.2f} | {100 * r.changed:.0f} % | "
            f"{r.frames} | {r.missed} | {r.alarms} | {r.unanswered} | {r.coverage:.3f} | {r.time:.2f} |"
        )
    lines.append(
        f"| without: calibration of the error bars | 1 (1 to 1) | {' | '.join('1' for _ in whole.kinds)} | 1 | {whole.largest:.2f} | 0 % | "
        f"{whole.frames} | {whole.missed} | {whole.alarms} | {whole.unanswered} | {whole.plain:.3f} | 1 |"
    )
    return "\n".join(lines) + "\n"


def _with_error(mean: float, error: float, count: int) -> str:
    return f"{mean:.3f} (one frame)" if count == 1 else f"{mean:.3f} ± {mean * error:.3f}"
