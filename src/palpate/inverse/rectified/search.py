"""The explanations of a frame: proposed, solved and weighed, all by one score, the log evidence with prior odds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.rectified.newton import (
    Explanation,
    Mode,
    Noise,
    Start,
    broken_gain,
    columns_of,
    linear,
    most_likely,
    silence,
)
from palpate.inverse.rectified.prepared import Prepared

__all__ = ["Found", "Silence", "explain"]


@dataclass(frozen=True)
class Silence:
    """No contact, with some patterns and broken readings."""

    explanation: Explanation
    odds: float
    sigma: Floats
    residual: Floats
    variance: Floats


@dataclass(frozen=True)
class Found:
    """What explains a frame: modes with their weights, no contact with its own, and the unit of the readings."""

    modes: list[Mode]
    weights: Floats
    none: list[Silence]
    none_weights: Floats
    unit: float
    steps: int

    @property
    def nothing(self) -> float:
        """Probability that nothing touches."""
        return float(self.none_weights.sum())


def covariance(p: Prepared, length: int) -> Floats:
    """Of the readings under the plain Gaussian process of one length, shear at a third of the pressure's variance; made once."""

    def made() -> Floats:
        kernel = p.kernels[length]
        parts = [
            (1.0 if i == p.components - 1 else 0.3) * (kernel.times(rows) @ rows.T)
            for i, rows in enumerate(p.responses)
        ]
        return np.asarray(sum(parts))

    return p.problem.kept.get(("rectified covariance", p.problem.columns, p.ratio, length), made)


def explain(p: Prepared, readings: Floats) -> Found | None:
    """Every explanation of readings (reading,) worth keeping; None where all readings are zero."""
    q, coarse = p.policy, p.coarser
    if coarse is None:
        return tried(p, readings)
    found = tried(coarse, readings)
    if found is None or found.nothing > q.nothing:
        return None if found is None else replace(found, modes=[], weights=np.zeros(0), none_weights=np.ones(1))
    y = readings / p.scale / found.unit
    modes = []
    for mode, weight in sorted(zip(found.modes, found.weights), key=lambda pair: -pair[1])[: q.heads]:
        if weight > q.worth * found.weights.max():
            begin = mode.start
            begin = replace(begin, f=p.from_coarser(begin.f), h=p.from_coarser(begin.h))
            fine = most_likely(p, y, mode.explanation, begin)
            if fine is not None:
                modes.append(fine)
    return weighed(p, modes, found.none, found.unit)


def weighed(p: Prepared, modes: list[Mode], none: list[Silence], unit: float) -> Found:
    """Explanations with their weights, those far below the best one dropped."""
    q = p.policy
    total = np.array([m.odds for m in modes] + [n.odds for n in none])
    weights = np.exp(total - total.max())
    weights[total < total.max() - q.dropped] = 0.0
    weights /= weights.sum()
    keep = weights[: len(modes)] > 1e-3
    kept = [m for m, k in zip(modes, keep) if k]
    return Found(kept, weights[: len(modes)][keep], none, weights[len(modes) :], unit, sum(m.steps for m in modes))


def tried(p: Prepared, readings: Floats) -> Found | None:
    """The same on the cells of ``p`` alone."""
    q = p.policy
    y = readings / p.scale
    unit = float(np.sort(np.abs(y))[-max(2, 1 + p.n // 40)])
    if not unit > 0:
        unit = float(np.abs(y).max())
    if not unit > 0:
        return None
    y = y / unit
    noise = Noise(None if p.noise is None else np.maximum(p.noise / unit, 1e-7))
    first = q.first_length
    with_patterns = p.columns.shape[1] > 0
    choices = ([True] if p.patterns_certain else [False, True]) if with_patterns else [False]

    # readings that no contact of either sign explains
    broken: list[int] = []
    rough = covariance(p, first)
    plain = Explanation(1, first, with_patterns, (), Noise(None))
    while True:
        u, diagonal, s, sigma, _ = linear(
            p, y, first, columns_of(p, replace(plain, broken=tuple(broken))), plain.noise, rough
        )
        gain, reading = broken_gain(u, diagonal, broken, q.broken)
        if gain + q.odds_broken < q.proposed or len(broken) >= 2 + p.n // 20:
            break
        broken.append(reading)

    modes: list[Mode] = []

    def solved(e: Explanation, start: Start) -> Mode | None:
        if e.noise.discrepancy:
            start = replace(start, sigma=np.full(p.count, q.discrepancy))
        mode = most_likely(p, y, e, start)
        if mode is not None:
            modes.append(mode)
        return mode

    rough_field = s * p.kernels[first].times(u @ p.responses[-1])
    pull = float(rough_field.sum()) < 0
    for sign in (-1, 1) if pull else (1,):
        field = sign * rough_field
        begin = Start(
            (field - q.cut * float(field.max())) / q.louder, np.zeros((p.components - 1, p.cells)), q.louder * s, sigma
        )
        for some in choices:
            for out in {(), tuple(broken)}:
                solved(Explanation(sign, first, some, tuple(out), noise), begin)
    best = max((m.odds for m in modes), default=-np.inf)
    heads = sorted((m for m in modes if m.odds > best - q.below), key=lambda m: -m.odds)[: q.heads]
    count = len(p.kernels)
    for head in heads:
        for lengths, step in ((range(first + 1, count), q.longer), (range(first - 1, -1, -1), 1.0 / q.shorter)):
            mode = head
            for length in lengths:
                next_one = solved(replace(head.explanation, length=length), mode.start.louder(step))
                if next_one is None or next_one.odds < max(m.odds for m in modes) - q.below:
                    break
                mode = next_one
    top = max(modes, key=lambda m: m.odds, default=None)
    # readings that only contact shows to be broken
    while top is not None and len(top.explanation.broken) < 2 + p.n // 20:
        gain, reading = broken_gain(top.weights, np.diag(top.inverse), top.explanation.broken, q.broken)
        if gain + q.odds_broken < q.shown:
            break
        now = replace(top.explanation, broken=(*top.explanation.broken, reading))
        near = [k for k in (now.length - 1, now.length, now.length + 1) if 0 <= k < count]
        tried = [m for m in (solved(replace(now, length=k), top.start) for k in near) if m is not None]
        better = max(tried, key=lambda m: m.odds, default=None)
        if better is None or better.odds <= top.odds:
            break
        top = better
    if top is not None and noise.given is not None:
        doubt = replace(top.explanation, noise=replace(noise, discrepancy=True))
        for k in (top.explanation.length - 1, top.explanation.length, top.explanation.length + 1):
            if 0 <= k < count:
                solved(replace(doubt, length=k), top.start)
    none = []
    # one place among the lengths: what touches may have any of them
    share = float(np.log(count))
    outs = {()} | {m.explanation.broken for m in modes}
    for some in choices:
        for out in outs:
            for kind in (noise, replace(noise, discrepancy=True)) if noise.given is not None else (noise,):
                e = Explanation(1, first, some, out, kind)
                odds, level, left, variance = silence(p, y, e)
                none.append(Silence(e, odds + share, level, left, variance))
    return weighed(p, modes, none, unit)
