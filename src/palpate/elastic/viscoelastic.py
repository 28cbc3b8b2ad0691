"""Creep and relaxation of a pad by a Prony series.

If Poisson's ratio is constant and every part of the pad relaxes by the same factor g(t) = E(t)/E(0), time separates from
space: stress under given tractions is that of the elastic pad at every instant, while strain and displacement creep. With
e(t) the elastic reading (at the instantaneous modulus) and u(t) the measured one,

    e(t) = int g(t - s) du(s),      g(t) = 1 - sum_i g_i (1 - exp(-t/tau_i))

(Boltzmann superposition and the correspondence principle; J. D. Ferry, Viscoelastic Properties of Polymers, 1980). One
internal variable per term, h_i(t) = int exp(-(t - s)/tau_i) du(s), carries the whole past.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._numbers import plain_time
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Complexes, Floats, Pad
from palpate.errors import InvalidInput, Unsupported

__all__ = ["CreepFilter", "Viscoelastic"]


@dataclass(frozen=True)
class Viscoelastic:
    """A pad that creeps.

    Parameters
    ----------
    elastic : HalfSpace, BondedLayers or another elastic Pad
        The pad at the first instant of a load: its moduli are the instantaneous ones. Layers may differ in modulus but relax
        by one common series; a stack whose layers (or base) relax differently does not separate and is refused.
    prony : sequence of (float, float)
        Pairs (g_i, tau_i): the part of the modulus that relaxes, 0 < g_i with sum < 1, and its time constant [s].

    Raises
    ------
    InvalidInput
        An elastic part that is no pad or creeps itself, a series that is not of pairs of positive numbers, or parts g that sum to 1 or more.
    Unsupported
        Layers on a half-space: time and space do not separate there.

    Examples
    --------
    >>> import palpate as pp
    >>> gel = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> pad = pp.Viscoelastic(gel, prony=[(0.3, 1.0)])  # 30 % of the modulus relaxes in about 1 s
    >>> pad.relaxation([0.0, 1.0, 1e3]).round(3).tolist()
    [1.0, 0.81, 0.7]

    >>> pad.thickness is gel.thickness, pad.mean_compliance(0.0) is None
    (True, True)

    >>> import numpy as np
    >>> wave = np.array([1000.0]), np.array([[1.0, 0.0]]), 1e-3
    >>> np.array_equal(pad.states(*wave), gel.states(*wave))  # at the first instant
    True

    >>> np.array_equal(pad.compliance(0.0), gel.compliance(0.0))
    True
    """

    elastic: Pad
    prony: Sequence[tuple[float, float]]

    def __post_init__(self) -> None:
        if isinstance(self.elastic, Viscoelastic | type) or not isinstance(self.elastic, Pad):
            raise InvalidInput(
                f"elastic must be a HalfSpace, BondedLayers or another elastic Pad; got {type(self.elastic).__name__}."
            )
        if isinstance(self.elastic, BondedLayers) and self.elastic.base is not None:
            raise Unsupported(
                "layers that creep on a half-space that creeps differently, or not at all, are not supported. Use a "
                "rigid base, or a HalfSpace."
            )
        try:
            terms = tuple((float(g), float(tau)) for g, tau in self.prony)
        except (TypeError, ValueError) as error:
            raise InvalidInput(f"prony must be a list of pairs (g, tau); got {self.prony!r}.") from error
        if not terms or not all(math.isfinite(v) and v > 0 for term in terms for v in term):
            raise InvalidInput(f"prony needs at least one pair (g, tau) of positive numbers; got {self.prony!r}.")
        if sum(g for g, _ in terms) >= 1:
            raise InvalidInput(
                f"the parts g of a Prony series must sum to less than 1; got {sum(g for g, _ in terms):g}."
            )
        object.__setattr__(self, "prony", terms)

    @property
    def thickness(self) -> float | None:
        """Depth of the base [m], or None without a base."""
        return self.elastic.thickness

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Return the states of the instantaneous pad."""
        return self.elastic.states(wavenumber, direction, depth)

    def compliance(self, depth: float) -> Floats:
        """Return the compliance of the instantaneous pad."""
        return self.elastic.compliance(depth)

    def mean_compliance(self, depth: float) -> Floats | None:
        """Return the mean compliance of the instantaneous pad."""
        return self.elastic.mean_compliance(depth)

    def relaxation(self, time: Floats) -> Floats:
        """g(t) = E(t)/E(0)."""
        t = np.asarray(time, dtype=np.float64)
        out: Floats = np.ones_like(t)
        for g, tau in self.prony:
            out = out + g * np.expm1(-t / tau)
        return out


class CreepFilter:
    """Adds creep to readings or removes it, frame by frame, with one stored number per taxel and term.

    Between frames the *measured* reading is taken as linear in time, so that `remove` is exact for steps at frames and
    for ramps, and `add` is its exact inverse. Before the first frame the pad is at rest; the first frame is a step.
    Time steps may be uneven.

    Raises
    ------
    InvalidInput
        From ``add`` and ``remove``: a time that does not follow the one before.

    Examples
    --------
    >>> from palpate.elastic import CreepFilter
    >>> creep, back = CreepFilter([(0.3, 1.0)]), CreepFilter([(0.3, 1.0)])
    >>> measured = [creep.add(1.0, time) for time in (0.0, 100.0)]  # a load put on and kept
    >>> [round(float(m), 2) for m in measured]  # at last 1 / (1 - 0.3)
    [1.0, 1.43]

    >>> [round(float(back.remove(m, time)), 3) for m, time in zip(measured, (0.0, 100.0))]
    [1.0, 1.0]
    """

    def __init__(self, prony: Sequence[tuple[float, float]]) -> None:
        self._terms = tuple(prony)
        self._rest = 1.0 - sum(g for g, _ in self._terms)
        self._memory: list[Any] | None = None
        self._last: Any = None
        self._time = math.nan

    def remove(self, reading: Any, time: float) -> Any:
        """Elastic reading e(t) from the measured one u(t) at ``time`` [s]."""
        if self._memory is None:
            self._start(reading, time)
            return reading
        decay, mean = self._factors(time)
        self._memory = [d * h + m * (reading - self._last) for d, m, h in zip(decay, mean, self._memory)]
        self._last, self._time = reading, time
        return self._rest * reading + sum(g * h for (g, _), h in zip(self._terms, self._memory))

    def add(self, elastic: Any, time: float) -> Any:
        """Measured reading u(t) from the elastic one e(t) at ``time`` [s]."""
        if self._memory is None:
            self._start(elastic, time)
            return elastic
        decay, mean = self._factors(time)
        past = sum(g * (d * h - m * self._last) for (g, _), d, m, h in zip(self._terms, decay, mean, self._memory))
        reading = (elastic - past) / (self._rest + sum(g * m for (g, _), m in zip(self._terms, mean)))
        self._memory = [d * h + m * (reading - self._last) for d, m, h in zip(decay, mean, self._memory)]
        self._last, self._time = reading, time
        return reading

    def _start(self, reading: Any, time: float) -> None:
        self._memory = [reading for _ in self._terms]
        self._last, self._time = reading, time

    def _factors(self, time: float) -> tuple[list[float], list[float]]:
        step = time - self._time
        if not step > 0:
            raise InvalidInput(
                f"time must increase from frame to frame; got {plain_time(time)} s after {plain_time(self._time)} s."
            )
        decay = [math.exp(-step / tau) for _, tau in self._terms]
        mean = [-math.expm1(-step / tau) * tau / step for _, tau in self._terms]
        return decay, mean
