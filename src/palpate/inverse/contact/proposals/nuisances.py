"""Contact of one sign together with nuisances, solved alternately."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact import drift, trace
from palpate.inverse.contact.explanation import Explanation, Rough
from palpate.inverse.contact.proposals.levels import largest_part
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.rough import rough, wide_and_wrong
from palpate.inverse.contact.score import least_to_beat

__all__ = ["with_nuisances"]

Flags = npt.NDArray[np.bool_]


def with_nuisances(search: Search, sign: int, start: Floats, sought: Flags) -> Explanation | None:
    """Contact of one sign with those of the nuisances ``sought`` that are significant. None if there are none, or if
    the result cannot beat earlier explanations.
    """
    estimator = search.estimator
    solved = _in_turn(search, sought, sign, start[sought], least_to_beat(search.tried, estimator.policy))
    if solved is None:
        return None
    found, sizes = solved
    if not sizes.any() or _too_large(search, sought, sizes):
        return None
    every = search.none
    every[sought] = sizes
    return Explanation(sign, found, every, choice=drift.cost(estimator, every, search.data))


def _in_turn(search: Search, sought: Flags, sign: int, start: Floats, beat: float) -> tuple[Rough, Floats] | None:
    """The rough solution with those of the nuisances ``sought`` that are significant, and the sizes of all sought. None
    if its gain will almost certainly stay below ``beat``, even if each remaining round improves as much as the best so far, or if the sizes grow too large.

    Contact and sizes are solved alternately; each step of the sizes lets the contact move on its face.
    """
    estimator, data, observed = search.estimator, search.data, search.observed
    rules = estimator.policy.explanations
    columns, lengths = estimator.shifts[:, sought], search.lengths[sought]
    few = observed.sum() <= estimator.policy.detection.few_readings
    sizes, present = start.copy(), np.ones(len(start), dtype=bool)
    best: Rough | None = None
    near: Floats | None = None
    noise, step = search.first_noise, 0.0
    plain = search.alone(sign)
    if noise is None and plain is not None and wide_and_wrong(estimator, plain.rough.traction, plain.rough.left):
        near, noise = plain.rough.traction, plain.rough.left
    for turn in range(rules.nuisance_rounds):
        clean = sign * (data - columns @ sizes)
        found = rough(estimator, clean, observed, search.total, columns[:, present], noise, near, beat)
        near, noise = found.traction, found.left
        if best is not None:
            # The first sizes are guesses from the outermost taxels: fitted sizes may gain slightly less, so allow for that.
            if found.gain < best.gain - (0.0 if few or turn > 1 else estimator.policy.detection.evidence):
                break
            step = max(step, found.gain - best.gain)
            most = found.gain + (rules.nuisance_rounds - 1 - turn) * step
            if most < beat:
                trace.decided("most that contact with nuisances can gain", most, beat)
                return None
        best, kept = found, sizes.copy()
        # Beside a contact that is known. With `found.deviation`, beside one that moves on its face, fewer would be sure.
        deviation = max(found.left, estimator.least_noise(data)) / np.maximum(lengths, 1e-300)
        change = np.zeros(len(start))
        change[present] = sign * found.change
        sizes = sizes + change
        # The first joint step starts far from the solution. It shows whether there are nuisances, but not yet which.
        first = turn == 0 and not few
        sure = found.deviation if first else deviation
        significant = np.abs(sizes) > rules.nuisance * sure
        if not significant.any():
            most = float((np.abs(sizes) / np.maximum(sure, 1e-300)).max())
            trace.decided("largest nuisance, in standard deviations", most, rules.nuisance)
            return None
        if not first:
            present, sizes = significant, np.where(significant, sizes, 0.0)
        if (np.abs(change) < rules.settled * deviation).all():
            break
        if turn > 0 and _too_large(search, sought, sizes):
            return None
    if best is None:
        raise RuntimeError("no round of nuisances was made")
    present = np.abs(kept) > rules.nuisance * deviation
    return best, np.where(present, kept, 0.0)


def _too_large(search: Search, sought: Flags, sizes: Floats) -> bool:
    """Whether nuisances exceed what a zeroed sensor may have (`levels.largest_part`)."""
    estimator = search.estimator
    largest = largest_part(estimator, estimator.shifts[:, sought], sizes, search.data)
    limit = estimator.policy.explanations.largest_nuisance
    if not largest > limit:
        return False
    trace.decided("too large a nuisance, as a part of the largest reading without it", largest, limit)
    return True
