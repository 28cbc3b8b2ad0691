"""What each part of the automatic method buys, and whether the answer hangs on its numbers.

Every frame of a population that tuned nothing (`palpate.bench.unseen`) is solved by the whole method, without each part, and with each number
halved and doubled (`palpate.inverse.contact.parts`). Errors are over those of the whole method in the same frame.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from palpate.bench.accuracy import spread_over
from palpate.bench.unseen import KINDS, Sample, unseen
from palpate.elastic.pad import Floats
from palpate.inverse.contact.adaptive import AdaptiveEstimator
from palpate.inverse.contact.methods import Automatic, AutomaticEstimator, cone_of
from palpate.inverse.contact.parts import Parts, Thresholds
from palpate.inverse.linear.methods import Tikhonov
from palpate.inverse.problem import Problem
from palpate.touch import Touch
from palpate.uncertainty import Calibration

__all__ = ["Ablated", "Outcome", "Row", "ablation", "as_markdown", "summary", "variants"]

#: Samples of the bootstrap.
RESAMPLED = 2000


@dataclass(frozen=True, kw_only=True)
class Ablated(Automatic):
    """The automatic method without some of its parts, or with other numbers."""

    parts: Parts = field(default_factory=Parts)
    thresholds: Thresholds = field(default_factory=Thresholds)

    def prepare(self, problem: Problem) -> AutomaticEstimator:
        """As `Automatic` does."""
        cone = cone_of(problem.components, self.friction)
        pushing = AdaptiveEstimator(problem, cone, parts=self.parts, thresholds=self.thresholds)
        linear = self.parts.pulls and self.friction is None
        return AutomaticEstimator(pushing, (lambda: Tikhonov().prepare(problem)) if linear else None)


#: What each part is called in the table, and what is left out.
PARTS: dict[str, tuple[str, ...]] = {
    "pressure never pulls, shear within friction": ("constraint",),
    "model of an even penalty": ("even_model",),
    "model of the second derivative": ("second_derivative",),
    "local weights, wide": ("wide_weights",),
    "local weights, narrow": ("narrow_weights",),
    "local weights, both": ("wide_weights", "narrow_weights"),
    "local weights explain the readings": ("explains",),
    "posterior variance in local weights": ("posterior_variance",),
    "no shear outside contact": ("shear_in_contact",),
    "finer grid": ("finer_grid",),
    "finer grid of sliding contact": ("finer_sliding",),
    "surface beyond the edge": ("wide_surface",),
    "models that end on the surface": ("ends_on_surface",),
    "sliding as a whole": ("sliding",),
    "trimming of faint cells": ("trim",),
    "noise of each channel": ("channel_noise",),
    "noise learned again": ("noise_again",),
    "uneven noise is no contact": ("uneven_evidence",),
    "broken readings left out before contact is sought": ("screening",),
    "outliers left out": ("outliers",),
    "outliers and broken readings": ("screening", "outliers"),
    "offsets of the readings": ("nuisances",),
    "contact that pulls": ("pulls", "rims"),
    "pull about a contact": ("rims",),
    "shear in proportion to the pressure": ("common_shear",),
    "faint cells left out early": ("narrowed",),
    "contact smaller than a pitch, seen in a few cells": ("sharp",),
    "discs of any place and radius": ("compact",),
    "no local weights for the improbable (saves time)": ("skipped",),
}


#: Numbers whose halving and doubling is tried: those that no derivation gives.
NUMBERS = (
    "contact",
    "outlier",
    "gross",
    "unequal",
    "quieter",
    "shear",
    "even",
    "reach",
    "floor",
    "rounds",
    "spacing",
    "trim",
    "quiet",
    "noisy",
    "ends",
    "slides",
    "jointly",
)
#: What parts and numbers need to make any difference: friction that is known, shear that is sought, more than one channel.
NEEDS = {
    **dict.fromkeys(("sliding", "finer_sliding", "skipped", "slides", "jointly"), "friction"),
    **dict.fromkeys(("shear_in_contact", "common_shear", "shear"), "shear"),
    **dict.fromkeys(("channel_noise", "uneven_evidence", "unequal"), "channels"),
}


def variants(*, thresholds: bool = True) -> dict[str, tuple[Parts, Thresholds]]:
    """Every row of the table: without each part, and, if wanted, with each number of `Thresholds` halved and doubled."""
    whole, numbers = Parts(), Thresholds()
    out = {f"without: {name}": (replace(whole, **dict.fromkeys(off, False)), numbers) for name, off in PARTS.items()}
    if thresholds:
        for name in NUMBERS:
            value = getattr(numbers, name)
            for factor, word in ((0.5, "x 0.5"), (2.0, "x 2")):
                changed = replace(numbers, **{name: type(value)(value * factor)})
                out[f"{name} {value:.3g} {word}"] = (whole, changed)
    return out


@dataclass(frozen=True)
class Outcome:
    """One frame by one variant: relative error, whether the 95 % intervals of normal force hold the truth (calibrated, and 1.96 of the
    model's own standard deviations; None: no error bars), whether contact was found, processor seconds."""

    error: float
    covered: bool | None
    plain: bool | None
    touching: bool
    seconds: float


Outcomes = dict[str, tuple[str, bool, list[Outcome]]]


def _outcome(sample: Sample, method: Ablated) -> Outcome:
    skin, names = sample.layout.skin, list(sample.layout.components)
    method.prepare(skin.problem(components=names))  # what is prepared is kept, and no part of the time
    started = time.process_time()
    touch = skin.reconstruct(sample.readings, method=method, components=names)
    seconds = time.process_time() - started
    columns = [skin.surface.components.index(c) for c in names]
    size = float(np.linalg.norm(sample.truth[columns]))
    difference = float(np.linalg.norm((np.asarray(touch.values) - sample.truth)[columns]))
    true = float(np.asarray(Touch(sample.truth, skin.surface, touch.components, "truth").force)[-1])
    touching = bool(np.asarray(touch.values).any())
    if touch.errors is None:
        return Outcome(difference / size if size > 0 else math.nan, None, None, touching, seconds)
    low, high = (np.asarray(v)[..., -1] for v in touch.interval(0.95, of="force"))
    std = np.hypot(touch.errors.force[-1], touch.errors.outside_force[-1])
    bounds = Calibration().bounds(0.95, np.asarray(touch.force)[-1], std, np.zeros(()), np.asarray(-math.inf))
    return Outcome(
        difference / size if size > 0 else math.nan,
        bool(low <= true <= high),
        bool(bounds[0] <= true <= bounds[1]),
        touching,
        seconds,
    )


def acts(sample: Sample, parts: Parts, thresholds: Thresholds) -> bool:
    """Whether a variant can change the answer of this frame at all."""
    has = {
        "friction": sample.friction is not None,
        "shear": len(sample.layout.components) > 1,
        "channels": len(sample.layout.array.channels) > 1,
    }
    changed = [
        f.name
        for given, plain in ((parts, Parts()), (thresholds, Thresholds()))
        for f in fields(plain)
        if getattr(given, f.name) != getattr(plain, f.name)
    ]
    return any(has[NEEDS[name]] if name in NEEDS else True for name in changed)


def _one_frame(task: tuple[int, int, str, bool, tuple[str, ...] | None]) -> tuple[str, bool, dict[str, Outcome]]:
    seed, index, kind, thresholds, chosen = task
    sample = unseen(np.random.default_rng((seed, index)), kind)
    whole = Ablated(friction=sample.friction)
    _outcome(sample, whole)  # finer grids are made when they are first needed
    out = {"whole": _outcome(sample, whole)}
    for name, (parts, numbers) in variants(thresholds=thresholds).items():
        if chosen is None or name in chosen:
            other = Ablated(friction=sample.friction, parts=parts, thresholds=numbers)
            out[name] = _outcome(sample, other) if acts(sample, parts, numbers) else out["whole"]
    return sample.kind, sample.empty, out


def ablation(
    frames: int = 60,
    *,
    numbers: int = 20,
    kinds: Sequence[str] = tuple(KINDS),
    seed: int = 2024,
    only: Sequence[str] | None = None,
    seconds: float | None = None,
    jobs: int = 1,
    report: Callable[[int], None] | None = None,
) -> list[tuple[str, bool, dict[str, Outcome]]]:
    """Kind, whether nothing touches, and the outcome of every variant ("whole" first), of each frame.

    ``kinds``: of which `palpate.bench.unseen.KINDS`, in turn; ``numbers``: how many of the frames halved and doubled numbers are tried on; ``only``: the variants wanted (names of `variants`;
    default: all); ``seconds``: no frame is begun after so long (by the wall clock), so that the first of ``frames`` are returned.
    """
    tasks = [
        (seed, i, kinds[i % len(kinds)], i < numbers, None if only is None else tuple(only)) for i in range(frames)
    ]
    found: list[tuple[str, bool, dict[str, Outcome]]] = []
    started = time.monotonic()
    while len(found) < frames and (seconds is None or not found or time.monotonic() - started < seconds):
        # in turns where the time is limited, so that it is looked at between them
        turn = tasks[len(found) :] if seconds is None else tasks[len(found) : len(found) + jobs]
        for one in spread_over(_one_frame, turn, jobs):
            found.append(one)
            if report is not None:
                report(len(found))
    return found


@dataclass(frozen=True)
class Row:
    """A variant against the whole method.

    ``mean`` is the geometric mean of the errors' ratios, ``low`` and ``high`` its 95 % interval (bootstrap over frames), ``kinds`` the
    same mean of each kind with its relative standard error (NaN of a single frame) and the number of frames, ``worst`` the largest ratio, ``largest`` the largest error, ``changed`` the part of frames with another
    answer, ``missed`` and ``alarms`` the contacts not found and the empty frames taken for contact, ``coverage`` and ``plain`` those of
    `Outcome`, ``time`` the processor time over that of the whole method.
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
    coverage: float
    plain: float
    time: float


def summary(found: Sequence[tuple[str, bool, dict[str, Outcome]]], seed: int = 0) -> list[Row]:
    """The table: one row for the whole method, one for each variant."""
    rng = np.random.default_rng(seed)
    rows = []
    for name in dict.fromkeys(name for _, _, by in found for name in by):
        touched = [(kind, by) for kind, empty, by in found if not empty and name in by]
        empties = [by for _, empty, by in found if empty and name in by]
        if not touched:
            continue
        kinds = np.array([kind for kind, _ in touched])
        picks = rng.integers(len(touched), size=(RESAMPLED, len(touched)))
        outcomes = [by[name] for _, by in touched]
        logs = np.log([by[name].error / by["whole"].error for _, by in touched])
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
                {k: _mean(logs[kinds == k]) for k in KINDS if (kinds == k).any()},
                float(np.exp(logs.max())),
                max(o.error for o in outcomes),
                float(np.mean(logs != 0.0)),
                sum(not o.touching for o in outcomes),
                sum(by[name].touching for by in empties),
                float(np.mean(covered)) if covered else math.nan,
                float(np.mean(plain)) if plain else math.nan,
                float(np.sum([o.seconds for o in outcomes]) / np.sum([by["whole"].seconds for _, by in touched])),
            )
        )
    return rows


def _mean(logs: Floats) -> tuple[float, float, int]:
    """Geometric mean, its relative standard error, and of how many."""
    count = len(logs)
    return float(np.exp(logs.mean())), float(logs.std(ddof=1) / math.sqrt(count)) if count > 1 else math.nan, count


def as_markdown(rows: Sequence[Row], *, command: str, empty: int) -> str:
    """The table as a page's section; ``empty``: how many empty frames there were."""
    whole = rows[0]
    counts = ", ".join(f"{count} of {kind}" for kind, (_, _, count) in whole.kinds.items())
    lines = [
        f"Made by `{command}`: {whole.frames} contacts ({counts}) and {empty} empty frame{'' if empty == 1 else 's'} that tuned nothing (`palpate.bench.unseen`). Error over that of the "
        f"whole method (geometric mean over frames, 95 % interval; and of each kind with its standard error), largest ratio, largest error, part of "
        "frames with another answer, number of contacts, contacts missed, false alarms, part of true normal forces inside the 95 % interval, processor time "
        "over that of the whole method.",
        "",
        f"| | error | {' | '.join(whole.kinds)} | worst ratio | worst error | changed | contacts | missed | alarms | coverage | time |",
        f"|---|---|{'---|' * len(whole.kinds)}---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        each = " | ".join(_with_error(*r.kinds[k]) if k in r.kinds else "" for k in whole.kinds)
        lines.append(
            f"| {r.name} | {r.mean:.3f} ({r.low:.3f} to {r.high:.3f}) | {each} | {r.worst:.2f} | {r.largest:.2f} | {100 * r.changed:.0f} % | "
            f"{r.frames} | {r.missed} | {r.alarms} | {r.coverage:.3f} | {r.time:.2f} |"
        )
    lines.append(
        f"| without: calibration of the error bars | 1 (1 to 1) | {' | '.join('1' for _ in whole.kinds)} | 1 | {whole.largest:.2f} | 0 % | "
        f"{whole.frames} | {whole.missed} | {whole.alarms} | {whole.plain:.3f} | 1 |"
    )
    return "\n".join(lines) + "\n"


def _with_error(mean: float, error: float, count: int) -> str:
    return f"{mean:.3f} (one frame)" if count == 1 else f"{mean:.3f} ± {mean * error:.3f}"
