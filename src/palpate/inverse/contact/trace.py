"""Log which explanations were tried for a frame, and the numbers behind each decision.

    logging.basicConfig()
    logging.getLogger("palpate.contact").setLevel("DEBUG")

prints a line for each decision of `palpate.inverse.contact.search`. Without a listener, nothing is computed.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.score import worth_of
from palpate.sensing.nuisance import Nuisance

__all__ = ["chosen", "decided", "explanations", "named"]

_log = logging.getLogger("palpate.contact")


def named(h: Explanation, terms: Sequence[Nuisance]) -> str:
    """An explanation in words: "push, offset of stress_zz 267 Pa"."""
    kinds = ("push and pull (linear model)", "push", "pull")  # of signs 0, 1 and -1
    parts = [f"{t.label} {s:.4g} {t.unit}" for t, s, here in zip(terms, h.sizes, h.present) if here]
    return ", ".join([kinds[h.sign], *parts])


def explanations(proposal: str, found: Iterable[Explanation], terms: Sequence[Nuisance], policy: Policy) -> None:
    """Log the explanations that a proposal found."""
    if not _log.isEnabledFor(logging.DEBUG):
        return
    every = list(found)
    for h in every:
        _log.debug(
            "%s: %s: worth %.1f, noise left %.4g, edge loaded %.2f",
            proposal, named(h, terms), worth_of(h, policy), h.rough.left, h.rough.ring,
        )  # fmt: skip
    if not every:
        _log.debug("%s: nothing", proposal)


def chosen(what: str, h: Explanation, terms: Sequence[Nuisance]) -> None:
    """Log the explanation that was chosen."""
    if _log.isEnabledFor(logging.DEBUG):
        _log.debug("%s: %s", what, named(h, terms))


def decided(what: str, value: float, limit: float) -> None:
    """Log a number and the limit that it was compared with."""
    _log.debug("%s: %.4g, limit %.4g", what, value, limit)
