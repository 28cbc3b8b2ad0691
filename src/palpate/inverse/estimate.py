"""The result of an inversion."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._batches import freeze, per_frame
from palpate.elastic.pad import Floats
from palpate.sensing.operator import Operator
from palpate.status import Status

__all__ = ["Errors", "Estimate", "Stated", "batch_of", "frames_of"]


#: Fields of `Errors` and `Stated` that do not grow with the readings.
_FIXED = ("center", "outside_center", "variance_reduction")


def _times(errors: Errors | Stated, factor: float) -> dict[str, Any]:
    """Each field times ``factor``, if it grows with the readings."""
    each = {f.name: getattr(errors, f.name) for f in fields(errors)}
    return {name: value if name in _FIXED else value * factor for name, value in each.items()}


@dataclass(frozen=True)
class Errors:
    """Standard deviations, in closed form, before calibration (`palpate.touch`).

    ``traction`` (*batch, component, *surface) [Pa]; ``force`` (*batch, component) [N or N/m]; ``moment`` (*batch, 3 or
    1); ``center`` (*batch, 2 or 1) [m]; ``peak`` (*batch) [Pa]. ``variance_reduction`` is shaped like ``traction``: 1
    - posterior over prior variance of each cell in contact, NaN elsewhere.

    Fields named ``outside_...`` are not standard deviations but the part of each quantity that comes from outside the
    outermost taxels, where nothing is measured; its relative error is a calibrated constant. ``beyond_force`` (*batch,
    component) is the force that a contact may have where no reading shows it, away from zero: beyond the outermost
    taxels if it reaches them, and between taxels much shallower than the pitch; the 95 % interval includes it.
    """

    traction: Floats = field(metadata=per_frame("component", "*"))
    force: Floats = field(metadata=per_frame("component"))
    moment: Floats = field(metadata=per_frame("about"))
    center: Floats = field(metadata=per_frame("along"))
    peak: Floats = field(metadata=per_frame())
    variance_reduction: Floats = field(metadata=per_frame("component", "*"))
    outside_traction: Floats = field(metadata=per_frame("component", "*"))
    outside_force: Floats = field(metadata=per_frame("component"))
    outside_moment: Floats = field(metadata=per_frame("about"))
    outside_center: Floats = field(metadata=per_frame("along"))
    outside_peak: Floats = field(metadata=per_frame())
    beyond_force: Floats = field(metadata=per_frame("component"))

    def __post_init__(self) -> None:
        freeze(self)

    def work_out(self) -> None:
        """Compute all lazy fields; they share intermediate results."""

    def times(self, factor: float) -> Errors:
        """The errors of a load and a noise that are ``factor`` times as large."""
        return Errors(**_times(self, factor))

    @classmethod
    def gathered(cls, parts: Sequence[Errors | None], gather: Callable[[list[Any]], Any]) -> Errors:
        """Concatenate the arrays of the parts (None if a part is None)."""
        names = [f.name for f in fields(cls)]
        return cls(**{n: gather([None if p is None else getattr(p, n) for p in parts]) for n in names})


@dataclass(frozen=True)
class Stated:
    """Standard deviations due to the uncertainty of pad and sensors (`palpate.Uncertainty`).

    Shapes and units as in `Errors`; 0 in frames without contact. No constant of the method scales them.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["strain_zz"], noise=1e-4)
    >>> skin = pp.Skin(pad, array, uncertainty=pp.Uncertainty(gain=0.1))
    >>> touch = skin.reconstruct(skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0)), method="tikhonov")
    >>> bool(0.1 < touch._errors.pad.force[1] / touch.force[1] < 0.2)
    True
    """

    traction: Floats = field(metadata=per_frame("component", "*", missing=0.0))
    force: Floats = field(metadata=per_frame("component", missing=0.0))
    moment: Floats = field(metadata=per_frame("about", missing=0.0))
    center: Floats = field(metadata=per_frame("along", missing=0.0))
    peak: Floats = field(metadata=per_frame(missing=0.0))

    def __post_init__(self) -> None:
        freeze(self)

    def times(self, factor: float) -> Stated:
        """The errors of a load and a noise that are ``factor`` times as large."""
        return Stated(**_times(self, factor))

    @classmethod
    def gathered(cls, parts: Sequence[Stated | None], gather: Callable[[list[Any]], Any]) -> Stated | None:
        """Concatenate the arrays of the parts; zero where a part is None, None if all are."""
        known = next((p for p in parts if p is not None), None)
        if known is None:
            return None
        none = cls(**{f.name: np.zeros_like(getattr(known, f.name)) for f in fields(cls)})
        return cls(**{f.name: gather([getattr(p or none, f.name) for p in parts]) for f in fields(cls)})

    @classmethod
    def added(cls, one: Stated | None, more: Mapping[str, Any]) -> Stated:
        """The standard deviations ``one`` (0 if None) with others by the same names, in quadrature."""
        return cls(**{name: np.hypot(0.0 if one is None else getattr(one, name), v) for name, v in more.items()})


@dataclass(frozen=True)
class Estimate:
    """The result of an inversion: the traction and how the method found it. A field is None if the method does not
    compute it.

    These have the shape of the batch, for constrained methods (*batch, channel) where noise is concerned:
    ``parameter``; ``noise_scale``, the noise in units of the whitening (1 if the noise was given); ``residual``, the
    root mean square misfit in units of that noise; ``noise_std`` (*batch, channel) in the unit of each channel. ``errors``
    are `Errors`, ``stated`` is `Stated`. ``converged``; ``contact`` (False: noise alone explains the frame);
    ``outliers`` (*batch, reading); ``draws`` (*batch, draw, component, *surface); ``settling``, the time an analog
    network takes in units of its RC; ``pushed`` (False: a contact with positive pressure does not explain the frame);
    ``resolution`` [m]; ``sliding``, the probability that the contact slides as a whole (NaN if nothing touches).
    ``method`` (*batch) is the short name of the method that solved each frame, if not the same for all. ``said`` are
    notes on the batch. ``sign`` (*batch) is 1 for a push, -1 for a pull, 2 for a push surrounded by pull, 0 for any
    mixture. ``fit`` (*batch) is the misfit probability (`palpate.inverse.fit`); ``nuisance`` and ``nuisance_std``
    (*batch, term) are the sizes of offsets and other patterns in the readings, ``nuisance_names`` the label and unit
    of each; ``at_limit`` (*batch, reading) marks readings at an end of their range. ``discrepancy`` (*batch) is the
    fraction of the readings that the model of the pad leaves unexplained. The following are flags (*batch):
    ``unexplained``, no contact explains the readings; ``undecided``, noise or an offset explains them, and so may a
    contact; ``overload``, readings at the end of their range leave the load without an upper limit. ``force_bounds`` (*batch, component, 2) are further net
    forces that the readings do not exclude, NaN if there are none.
    """

    traction: Any
    parameter: Floats | None
    noise_scale: Floats | None
    residual: Floats | None
    errors: Errors | None = None
    converged: npt.NDArray[np.bool_] | None = None
    contact: npt.NDArray[np.bool_] | None = None
    outliers: npt.NDArray[np.bool_] | None = None
    draws: Floats | None = None
    settling: Floats | None = None
    pushed: npt.NDArray[np.bool_] | None = None
    resolution: Floats | None = None
    sliding: Floats | None = None
    noise_std: Floats | None = None
    method: npt.NDArray[np.str_] | None = None
    said: tuple[str, ...] = ()
    sign: npt.NDArray[np.int_] | None = None
    fit: Floats | None = None
    nuisance: Floats | None = None
    nuisance_std: Floats | None = None
    nuisance_names: tuple[tuple[str, str], ...] = ()
    at_limit: npt.NDArray[np.bool_] | None = None
    stated: Stated | None = None
    discrepancy: Floats | None = None
    unexplained: npt.NDArray[np.bool_] | None = None
    undecided: npt.NDArray[np.bool_] | None = None
    overload: npt.NDArray[np.bool_] | None = None
    force_bounds: Floats | None = None

    def status(self) -> npt.NDArray[np.int8] | None:
        """Outcome of each frame (*batch) as codes of `palpate.Status`, or None without batch information."""
        known = next((a for a in (self.residual, self.parameter, self.converged, self.contact) if a is not None), None)
        if known is None:
            return None
        code = np.full(np.shape(known), Status.SOLVED, dtype=np.int8)
        if self.converged is not None:
            code[~self.converged] = Status.NOT_CONVERGED
        if self.contact is not None:
            code[~self.contact] = Status.NO_CONTACT
        if self.pushed is not None:
            # A frame solved by another method counts as solved.
            other = (
                np.zeros(np.shape(code), dtype=bool)
                if self.method is None
                else ~np.isin(self.method, ("adaptive", "constrained"))
            )
            pulls = np.zeros(np.shape(code), dtype=bool) if self.sign is None else (self.sign < 0) | (self.sign > 1)
            code[~self.pushed & ~other & ~pulls] = Status.NOT_PUSHING
        for flags, status in (
            (self.unexplained, Status.UNEXPLAINED),
            (self.undecided, Status.UNDECIDED),
            (self.overload, Status.OVERLOAD),
        ):
            if flags is not None:
                code[flags] = status
        return code

    def left_out(self) -> list[int]:
        """Readings excluded in any frame."""
        if self.outliers is None:
            return []
        return [int(r) for r in np.flatnonzero(self.outliers.reshape(-1, self.outliers.shape[-1]).any(axis=0))]

    def remarks(self) -> tuple[str, ...]:
        """The method's remarks on how it solved the frame."""
        if self.settling is None:
            return self.said
        settling = float(np.median(np.atleast_1d(self.settling)))
        return (
            *self.said,
            f"the network settled in {settling:.3g} RC (its units' time constant)",
        )


def batch_of(readings: Sequence[Any], operator: Operator) -> tuple[int, ...]:
    """Batch shape of readings (*batch, channel, *array), one array per plane."""
    return tuple(readings[0].shape[: -1 - len(operator.planes_of[0].shape)])


def frames_of(readings: Sequence[Any], operator: Operator) -> Iterator[list[Floats]]:
    """Each frame in turn, (channel, *array) per plane, in double precision."""
    planes = operator.planes_of
    arrays = [to_numpy(r).astype(np.float64).reshape(-1, len(a.channels), *a.shape) for r, a in zip(readings, planes)]
    for i in range(math.prod(batch_of(readings, operator))):
        yield [a[i] for a in arrays]


def in_frames(flags: npt.NDArray[np.bool_], batch: tuple[int, ...]) -> str:
    """Text " in 3 of 70 frames", or "" for a single frame."""
    return f" in {int(np.count_nonzero(flags))} of {flags.size} frames" if batch else ""


def among_frames(note: str, count: int) -> str:
    """A note on some frames of a batch, whose number is replaced by that of a larger batch, ``count``."""
    return re.sub(r"(?<= in )(\d+) of \d+ frames\b", rf"\g<1> of {count} frames", note)
