"""Count the outcomes of frames, so that parts of a recording can be added up."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate.inverse.fit import DISCREPANCY, POOR_FIT, PROVEN
from palpate.inverse.words import ASSUMED
from palpate.status import Status
from palpate.touch.fields import pulling
from palpate.touch.intervals import interval
from palpate.touch.numbers import Numbers

__all__ = ["ROUGH", "ROUGHLY", "Nuisance", "Outcome", "assumed", "notes_with"]

#: The net force is reported as uncertain if the longer side of its 95 % interval exceeds this fraction of the load:
#: errors of this size count as wrong (`palpate.bench.trust.judge.WRONG`).
ROUGH = 0.3
#: Smallest discrepancy (fraction of the readings) that is reported.
MISFIT_NOTE = 0.05
#: Largest strain for which linear elasticity is trusted (a convention for rubber: the stress of a neo-Hookean bar is
#: then off by a third).
LARGE_STRAIN = 0.3
#: Beginning of the note on an uncertain force.
ROUGHLY = "the net force is uncertain"


@dataclass(frozen=True)
class Nuisance:
    """Counts for one offset, ramp or rotation: frames that contain it and the largest size; frames whose contact may hide it
    and the largest deviation.
    """

    label: str
    unit: str
    found: int = 0
    size: float = 0.0
    std: float = 0.0
    hidden: int = 0
    hidden_std: float = 0.0

    def __add__(self, other: Nuisance) -> Nuisance:
        largest = self if abs(self.size) >= abs(other.size) else other
        return Nuisance(
            self.label,
            self.unit,
            self.found + other.found,
            largest.size,
            largest.std,
            self.hidden + other.hidden,
            max(self.hidden_std, other.hidden_std),
        )


@dataclass(frozen=True)
class Outcome:
    """Counts over ``frames`` frames. ``batch``: False for a single frame, whose notes have no counts. Outcomes can be
    added.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.touch.outcome import Outcome
    >>> touch = pp.Touch(np.zeros((3, 2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("z",), "tikhonov", fit=np.array([0.5, 0.001, 0.2]))
    >>> parts = Outcome.of(touch[:1]) + Outcome.of(touch[1:])
    >>> parts.poor, parts == Outcome.of(touch), parts.words() == list(touch.notes)
    (1, True, True)
    """

    frames: int
    batch: bool
    status: Mapping[int, int] = field(default_factory=dict)
    pulls: int = 0
    linear: int = 0
    unexplained: int = 0
    rims: int = 0
    left_out: Mapping[int, str] = field(default_factory=dict)
    at_limit: int = 0
    most_at_limit: int = 0
    nuisances: tuple[Nuisance, ...] = ()
    poor: int = 0
    worst_fit: float = 1.0
    rough: int = 0
    roughest: float = 0.0
    discrepant: int = 0
    discrepancy: float = 0.0
    unlike_noise: int = 0
    strained: int = 0
    strain: float = 0.0
    above_modulus: int = 0
    with_left_out: int = 0

    @classmethod
    def of(cls, touch: Numbers) -> Outcome:
        """The outcome of one touch."""
        status: dict[int, int] = {}
        if touch.status is not None:
            codes, counts = np.unique(touch.status, return_counts=True)
            status = {int(c): int(n) for c, n in zip(codes, counts)}
        pulls = pulling(touch)
        answered = _in(touch, Status.UNEXPLAINED, Status.UNDECIDED, Status.OVERLOAD)
        linear = unexplained = rims = 0
        if touch.pushing is not None:
            by_line = (touch.methods != "adaptive") & (touch.methods != "constrained") & ~touch.pushing
            linear = int(np.count_nonzero(by_line))
            neither = ~touch.pushing & ~by_line & ~pulls & ~answered
            both = neither & (False if touch.status is None else touch.status == int(Status.SOLVED))
            rims, unexplained = int(np.count_nonzero(both)), int(np.count_nonzero(neither & ~both))
        left_out: dict[int, str] = {}
        with_left_out = 0
        if touch.outliers is not None:
            flags = touch.outliers.reshape(-1, touch.outliers.shape[-1])
            rows, with_left_out = np.flatnonzero(flags.any(axis=0)), int(np.count_nonzero(flags.any(axis=1)))
            left_out = {int(r): touch.reading_names.get(int(r), f"reading {r}") for r in rows}
        at_limit = most = 0
        if touch.at_limit is not None and touch.at_limit.size:
            ends = touch.at_limit.reshape(-1, touch.at_limit.shape[-1])
            at_limit, most = int(np.count_nonzero(ends.any(axis=1))), int(ends.sum(axis=1).max())
        poor, worst = 0, 1.0
        if touch.fit is not None:
            nothing = _in(touch, Status.NO_CONTACT)
            here = (np.asarray(touch.fit) < POOR_FIT) & ~answered & ~nothing
            poor = int(np.count_nonzero(here))
            worst = float(np.min(np.asarray(touch.fit)[here])) if poor else 1.0
        parts = _uncertainty(touch)
        strained, strain, above_modulus = _strain(touch)
        return cls(
            int(np.prod(touch.batch, dtype=int)),
            bool(touch.batch),
            status,
            int(np.count_nonzero(pulls)),
            linear,
            unexplained,
            rims,
            left_out,
            at_limit,
            most,
            _nuisances(touch),
            poor,
            worst,
            int(np.count_nonzero(parts > ROUGH)),
            float(np.max(parts, initial=0.0)),
            *_discrepancy(touch),
            0 if touch.fit is None else int(np.count_nonzero((np.asarray(touch.fit) < PROVEN) & nothing)),
            strained,
            strain,
            above_modulus,
            with_left_out,
        )

    def __add__(self, other: Outcome) -> Outcome:
        codes = sorted({*self.status, *other.status})
        nuisances: dict[tuple[str, str], Nuisance] = {}
        for n in (*self.nuisances, *other.nuisances):
            nuisances[n.label, n.unit] = nuisances[n.label, n.unit] + n if (n.label, n.unit) in nuisances else n
        return Outcome(
            self.frames + other.frames,
            True,
            {c: self.status.get(c, 0) + other.status.get(c, 0) for c in codes},
            self.pulls + other.pulls,
            self.linear + other.linear,
            self.unexplained + other.unexplained,
            self.rims + other.rims,
            dict(sorted({**self.left_out, **other.left_out}.items())),
            self.at_limit + other.at_limit,
            max(self.most_at_limit, other.most_at_limit),
            tuple(nuisances.values()),
            self.poor + other.poor,
            min(self.worst_fit, other.worst_fit),
            self.rough + other.rough,
            max(self.roughest, other.roughest),
            self.discrepant + other.discrepant,
            max(self.discrepancy, other.discrepancy),
            self.unlike_noise + other.unlike_noise,
            self.strained + other.strained,
            max(self.strain, other.strain),
            self.above_modulus + other.above_modulus,
            self.with_left_out + other.with_left_out,
        )

    def plain(self) -> dict[str, Any]:
        """Convert to JSON types; `restored` is the inverse."""
        return asdict(self)

    @classmethod
    def restored(cls, plain: Mapping[str, Any]) -> Outcome:
        """Restore from `plain`, also after JSON, which turns integer keys into text."""
        return cls(
            **{
                **plain,
                "status": {int(k): v for k, v in plain["status"].items()},
                "left_out": {int(k): v for k, v in plain["left_out"].items()},
                "nuisances": tuple(Nuisance(**n) for n in plain["nuisances"]),
            }
        )

    def words(self) -> list[str]:
        """Notes, one sentence for each kind of outcome."""
        said = []

        def some(count: int) -> str:
            """ " in 3 of 70 frames", or "" for a single frame."""
            return f" in {count} of {self.frames} frames" if self.batch else ""

        for code, count in self.status.items():
            status = Status.coded(code)
            if status in (Status.SOLVED, Status.NOT_PUSHING):
                continue
            if status is Status.NO_CONTACT:
                count -= self.unlike_noise
                if not count:
                    continue
            # Notes on convergence contain their own remedy, which differs for a tracker, a rule and a constrained
            # method.
            own = status is Status.NOT_CONVERGED
            remedy = f"; {status.remedy}" if status.remedy and not own else ""
            said.append(f"{status.label}{some(count)}: {status.meaning}{remedy}")
        if self.unlike_noise:
            said.append(
                f"no contact found{some(self.unlike_noise)}, but noise rarely gives such readings: the interval includes a contact"
            )
        if self.pulls:
            said.append(f"the contact pulls as a whole{some(self.pulls)}: adhesion, or readings of the wrong sign?")
        for count, what in (
            (self.linear, "; the linear method was used"),
            (self.rims, "; a pull around it was included"),
            (self.unexplained, f"; {Status.NOT_PUSHING.remedy}"),
        ):
            if count:
                said.append(
                    f"a contact that only pushes does not explain the readings{some(count)} (adhesion, cells that pull, a wrong pad or "
                    f"unit?){what}"
                )
        if self.left_out:
            names = ", ".join(list(self.left_out.values())[:4])
            more = f" and {len(self.left_out) - 4} more" if len(self.left_out) > 4 else ""
            where = some(self.with_left_out) if self.with_left_out else ""
            said.append(f"left out{where} as unexplained by any contact (dead, stuck or saturated?): {names}{more}")
        if self.at_limit:
            up_to = "up to " if self.batch else ""
            said.append(
                f"{up_to}{self.most_at_limit} readings at the end of their range{some(self.at_limit)}: the true values may lie beyond it"
            )
        for n in self.nuisances:
            if n.found and self.batch:
                said.append(f"{n.label}{some(n.found)}: up to {plain_number(abs(n.size), 3)} {n.unit}")
            elif n.found:
                said.append(
                    f"{n.label}: {plain_number(n.size, 3)} {n.unit} (standard deviation {plain_number(n.std, 2)})"
                )
            if n.hidden and self.rough:  # a reason for wide intervals only
                said.append(
                    f"contact may hide an offset{some(n.hidden)}: the {n.label} cannot be separated from contact; the error bars allow for "
                    f"{plain_number(n.hidden_std, 2)} {n.unit} of it. If it does not drift, pass Skin(..., nuisance=[])"
                )
        if self.above_modulus:
            said.append(
                f"the peak pressure is above Young's modulus of the pad{some(self.above_modulus)}: check the unit of the readings and the modulus"
            )
        elif self.strained:
            up_to = "up to " if self.batch else ""
            said.append(
                f"strain of {up_to}{self.strain:.2f}{some(self.strained)}: beyond linear elasticity, which holds to about {LARGE_STRAIN:g}"
            )
        up_to = "up to " if self.batch else ""
        if self.discrepant and not self.poor:
            begins = (
                f"{ASSUMED}the pad's model may leave"
                if self.discrepancy <= DISCREPANCY + 0.005
                else "the pad's model leaves"
            )
            said.append(
                f"{begins} {up_to}{self.discrepancy:.0%} of these readings unexplained{some(self.discrepant)}; intervals allow for it"
            )
        if self.rough:
            # The widest of many intervals is not typical: it belongs to a frame with almost no contact.
            wide = f"more than +- {ROUGH:.0%} of the load" if self.batch else f"+- {_of_load(self.roughest)}"
            said.append(f"{ROUGHLY}{some(self.rough)}: {wide} (95 %)")
        if self.poor:
            how = "" if self.batch else f" (fit {self.worst_fit:.1g})"
            share = f"; it leaves {up_to}{self.discrepancy:.0%} of them unexplained, and intervals allow for it"
            share = share if self.discrepant else ""
            said.append(
                f"the model does not explain the readings{some(self.poor)}{how}: pad, depth, units, axes and signs of the channels may be "
                f"wrong, or taxels broken{share}"
            )
        return said


#: Beginning of the note on a small contact, which is a reason for an uncertain force and for nothing else.
_SMALL = ("small contact:", "small contact in ")


def notes_with(said: Iterable[str], outcome: Outcome | None) -> tuple[str, ...]:
    """The notes of remarks and outcomes, without assumptions, and without the reason for a wide interval if none is wide."""
    words = () if outcome is None else outcome.words()
    narrow = outcome is not None and not outcome.rough
    return tuple(
        dict.fromkeys(n for n in (*said, *words) if not n.startswith(ASSUMED) and not (narrow and n.startswith(_SMALL)))
    )


def assumed(said: Iterable[str], outcome: Outcome | None) -> tuple[str, ...]:
    """The assumptions among the remarks and outcomes of frames."""
    words = () if outcome is None else outcome.words()
    return tuple(dict.fromkeys(n.removeprefix(ASSUMED) for n in (*said, *words) if n.startswith(ASSUMED)))


def _in(touch: Numbers, *statuses: Status) -> npt.NDArray[np.bool_]:
    """Mask of frames (*batch) with one of these statuses."""
    if touch.status is None:
        return np.zeros(touch.batch, dtype=bool)
    return np.isin(np.asarray(touch.status), [int(s) for s in statuses])


def _strain(touch: Numbers) -> tuple[int, float, int]:
    """Number of frames whose strain is too large for linear elasticity, the largest strain, and number of frames whose
    pressure exceeds the modulus.
    """
    if touch.strain is None:
        return 0, 0.0, 0
    strain = np.nan_to_num(np.asarray(touch.strain, dtype=np.float64))
    return (
        int(np.count_nonzero(strain > LARGE_STRAIN)),
        float(np.max(strain, initial=0.0)),
        int(np.count_nonzero(strain > 1.0)),
    )


def _discrepancy(touch: Numbers) -> tuple[int, float]:
    """Number of frames with contact and a notable discrepancy, and the largest discrepancy."""
    if touch.discrepancy is None:
        return 0, 0.0
    share = np.nan_to_num(np.asarray(touch.discrepancy, dtype=np.float64))
    return int(np.count_nonzero(share >= MISFIT_NOTE)), float(np.max(share, initial=0.0))


def _uncertainty(touch: Numbers) -> npt.NDArray[np.float64]:
    """Longer side of the 95 % interval of the net force, for the worst component, as a fraction of the load (frame,);
    zero without contact or interval.
    """
    if not touch.has_intervals:
        return np.zeros(0)
    surface = touch.surface
    low, high = (to_numpy(side) for side in interval(touch, 0.95, "force", None))
    size = np.sqrt((to_numpy(touch.values).astype(np.float64) ** 2).sum(axis=-1 - surface.dimensions))
    load = surface.integral(size)
    force = to_numpy(touch.force)
    with np.errstate(invalid="ignore"):
        side = np.maximum(high - force, force - low)
    half = np.nan_to_num(side, nan=0.0, posinf=0.0).max(axis=-1)
    solved = load > 0 if touch.status is None else (load > 0) & (np.asarray(touch.status) == int(Status.SOLVED))
    return np.ravel(np.divide(half, load, out=np.zeros_like(half, dtype=np.float64), where=solved))


def _nuisances(touch: Numbers) -> tuple[Nuisance, ...]:
    """The nuisances of readings, with units."""
    if touch.nuisance is None or touch.nuisance_std is None:
        return ()
    counted = []
    for i, (label, unit) in enumerate(touch.nuisance_names):
        size, std = np.ravel(touch.nuisance[..., i]), np.ravel(touch.nuisance_std[..., i])
        found = np.isfinite(size) & (size != 0)  # frames without an answer have no size
        hidden = (size == 0) & (std > 0)
        largest = int(np.argmax(np.where(found, np.abs(size), 0.0))) if len(size) else 0
        counted.append(
            Nuisance(
                label,
                unit,
                int(np.count_nonzero(found)),
                float(size[largest]) if found.any() else 0.0,
                float(std[largest]) if found.any() else 0.0,
                int(np.count_nonzero(hidden)),
                float(np.max(std[hidden], initial=0.0)),
            )
        )
    return tuple(counted)


def _of_load(share: float) -> str:
    """A fraction of the load in per cent; if larger than the load, as a multiple."""
    if not math.isfinite(share):
        return "an unknown part of the load"
    return f"{share:.0%} of the load" if share <= 1.0 else f"{plain_number(share, 2)} times the load"
