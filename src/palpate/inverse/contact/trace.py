"""Which explanations of a frame were tried, their scores, and the numbers behind each decision.

`traced` collects them; the logger "palpate.contact" at the level DEBUG prints the same lines. While nobody listens,
nothing is computed. The line of an explanation

    offsets: push, offset of stress_zz 267 Pa: worth 61.2 = 24.3 log(13.6 / 0.966) - 3, edge loaded 0.00

says: the proposal, the explanation, its worth (`score.worth_of`) = degrees of freedom that it leaves, times the
logarithm of the root mean square of the readings over what it leaves per degree of freedom (in units of the noise if
that was given), less the price of its nuisances, of a sign other than push and of `Explanation.choice`; and the part of
the cells above the outermost taxels that it loads.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.score import simplest_of, worth_of
from palpate.sensing.nuisance import Nuisance

__all__ = ["Trace", "Tried", "best", "chosen", "decided", "explanations", "named", "step", "traced"]

_log = logging.getLogger("palpate.contact")


@dataclass(frozen=True)
class Tried:
    """One explanation that was tried.

    Attributes
    ----------
    proposal : str
        What proposed it: "push", "pull", "offsets", "groups", "ramps" or "both".
    explanation : str
        Such as "push, offset of stress_zz 267 Pa".
    worth : float
        Its score: gain less price. The explanation worth most is the best, if it leads by enough.
    gain : float
        free log(total/left).
    price : float
        Of its nuisances, of a sign other than push, and of `Explanation.choice`.
    free : float
        Degrees of freedom that it leaves.
    total, left : float
        Root mean square of the readings, and what the explanation leaves of them per degree of freedom; in units of the noise if that was given.
    edge : float
        Part of the cells above the outermost taxels that it loads.
    """

    proposal: str
    explanation: str
    worth: float
    gain: float
    price: float
    free: float
    total: float
    left: float
    edge: float

    def __str__(self) -> str:
        price = f" - {self.price:.3g}" if self.price else ""
        return (
            f"{self.proposal}: {self.explanation}: worth {self.worth:.1f} = {self.free:.1f} log({self.total:.4g} / {self.left:.3g})"
            f"{price}, edge loaded {self.edge:.2f}"
        )


@dataclass
class Trace:
    """Records the explanations tried for the frames solved inside `traced`, and every decision in order; printing it shows ``lines``.

    Attributes
    ----------
    lines : list of str
        One for each explanation and decision.
    tried : list of Tried
        The explanations with their scores.

    Examples
    --------
    >>> from palpate.inverse import Trace
    >>> Trace().tried  # of no frame
    []
    """

    lines: list[str] = field(default_factory=list)
    tried: list[Tried] = field(default_factory=list)

    def __str__(self) -> str:
        return "\n".join(self.lines)


_traces: ContextVar[tuple[Trace, ...]] = ContextVar("traces", default=())


@contextmanager
def traced() -> Iterator[Trace]:
    """Collect which explanations the default method tries for the frames solved inside, and why one wins.

    A frame with many saturated readings, or one that fits only with a model error, is solved more than once, and each
    time is in the trace.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.inverse import traced
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=20.0)
    >>> skin = pp.Skin(pad, array)
    >>> readings = skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.3))
    >>> with traced() as trace:
    ...     touch = skin.reconstruct(readings + 1000.0)
    >>> best = max(trace.tried, key=lambda tried: tried.worth)
    >>> best.proposal, best.explanation.split()[:4], best.price
    ('offsets', ['push,', 'offset', 'of', 'stress_zz'], 3.0)
    """
    trace = Trace()
    token = _traces.set((*_traces.get(), trace))
    try:
        yield trace
    finally:
        _traces.reset(token)


def _heard() -> bool:
    return bool(_traces.get()) or _log.isEnabledFor(logging.DEBUG)


def step(line: str) -> None:
    """Tell a step that was taken."""
    _log.debug("%s", line)
    for trace in _traces.get():
        trace.lines.append(line)


def named(h: Explanation, terms: Sequence[Nuisance], *, contact: bool = True) -> str:
    """An explanation in words: "push, offset of stress_zz 267 Pa"."""
    kinds = ("push and pull (linear model)", "push", "pull")  # of signs 0, 1 and -1
    parts = [f"{t.label} {s:.4g} {t.unit}" for t, s, here in zip(terms, h.sizes, h.present) if here]
    return ", ".join([kinds[h.sign] if contact else "no contact", *parts])


def explanations(
    proposal: str, found: Iterable[Explanation], terms: Sequence[Nuisance], total: float, policy: Policy
) -> None:
    """Record the explanations that a proposal found for readings with the root mean square ``total``."""
    if not _heard():
        return
    every = list(found)
    for h in every:
        rough, worth = h.rough, worth_of(h, policy)
        left = total * math.exp(-rough.gain / rough.free)  # that counts: not less than the accuracy of the model
        price = rough.gain - worth
        tried = Tried(proposal, named(h, terms), worth, rough.gain, price, rough.free, total, left, rough.edge)
        step(str(tried))
        for trace in _traces.get():
            trace.tried.append(tried)
    if not every:
        step(f"{proposal}: nothing")


def best(h: Explanation, tried: Sequence[Explanation], terms: Sequence[Nuisance], policy: Policy) -> None:
    """Record the best of the explanations tried, and its lead over the simplest one and over the next."""
    if not _heard():
        return
    simple, needed = simplest_of(tried, policy), policy.detection.evidence
    lead = worth_of(h, policy) - worth_of(simple, policy)
    why = f"worth {lead:.1f} more than contact alone, needed {needed:g}" if lead else _why_simple(tried, terms, policy)
    others = [o for o in tried if o is not h and o is not simple]
    if lead and others:
        next_one = max(others, key=lambda o: worth_of(o, policy))
        why += f"; {worth_of(h, policy) - worth_of(next_one, policy):.1f} more than {named(next_one, terms)}"
    step(f"best of these: {named(h, terms)} ({why})")


def _why_simple(tried: Sequence[Explanation], terms: Sequence[Nuisance], policy: Policy) -> str:
    """Why contact alone is the best of the explanations tried."""
    simple, needed = simplest_of(tried, policy), policy.detection.evidence
    others = [h for h in tried if h.present.any() or h.sign == 0]
    if not others:
        return "no other was left"
    first = max(others, key=lambda h: worth_of(h, policy))
    more = worth_of(first, policy) - worth_of(simple, policy)
    if not more > needed:
        return f"no other is worth {needed:g} more"
    return f"{named(first, terms)} is worth {more:.1f} more, but not {needed:g} more than every explanation without nuisances"


def models(members: Sequence[ContactModel]) -> None:
    """Tell the models of a solved explanation, with the weight that each has in the result."""
    if not _heard():
        return
    each: dict[str, float] = {}
    for m in members:
        what = m.kind or "one penalty"
        what += " of a contact that slides as a whole" if m.ray is not None else ""
        what += f" on {len(m.cells)} cells of 1/{m.level.ratio} of a surface cell's side"
        each[what] = each.get(what, 0.0) + m.weight
    step("models: " + "; ".join(f"{what}, weight {weight:.3g}" for what, weight in each.items()))


def chosen(what: str, h: Explanation, terms: Sequence[Nuisance], *, contact: bool = True) -> None:
    """Tell an explanation that was chosen."""
    if _heard():
        step(f"{what}: {named(h, terms, contact=contact)}")


def decided(what: str, value: float, limit: float) -> None:
    """Tell a number and the limit that it was compared with."""
    if _heard():
        step(f"{what}: {value:.4g}, limit {limit:.4g}")
