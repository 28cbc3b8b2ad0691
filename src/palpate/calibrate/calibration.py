"""A calibration of a skin: maps from readings to net force and centre, the data they derive from, and their
predictions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from palpate._arrays import from_numpy
from palpate._numbers import plain_number
from palpate.calibrate.constants import PadConstants
from palpate.calibrate.elastic import JOINED_FREEDOM, joined, normal_force
from palpate.calibrate.forcemap import ForceMap
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, NotObservable
from palpate.inverse.estimate import Errors
from palpate.sensing.grids import Grid
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.fields import CalibratedForce, ErrorParts

__all__ = ["FORCE_ONLY_NOTE", "SkinCalibration"]

#: Note of a touch whose pad model was rejected or not checked.
FORCE_ONLY_NOTE = (
    "net force by calibration, without a pressure map, because the calibration presses do not fit the elastic model"
)
#: Components of the force and coordinates of the centre, with the names that reference files use.
FORCES, PLACES = ("fx", "fy", "fz"), ("x", "y")
#: Note for readings from which the zero of the calibration was subtracted.
OPEN = "the zero of the calibration is used: the intervals include its scatter and the drift during the calibration, but no later drift. Take a new zero without contact (baseline=, --baseline)"
#: Note for readings beyond those at rest whose force may be zero.
TOO_WIDE = "readings differ from those at rest, but by this calibration the force may be zero: calibrate with more presses, among them some like these"
#: Frames whose readings have less than this root mean square, in standard deviations of a frame at rest, may be at rest.
AT_REST = 3.0
#: Note for a new zero, if the calibration has none.
NO_ZERO = "the readings at rest are far from 0, but the calibration had no frames at rest and took these offsets for load, so that every force is wrong. Calibrate again with frames at rest: baseline=, or a weight of 0 g"
#: A note says that a new zero differs from that of the calibration if the difference exceeds this fraction of the
#: largest labelled value (a convention) and two of its standard deviations.
STANDING = 0.1
#: A note is given if the part of the force's error that comes from unlabelled kinds of frames exceeds this fraction of
#: the force.
UNLIKE = 0.3


@dataclass(frozen=True, eq=False)
class SkinCalibration:
    """A calibration from labelled presses.

    Attributes
    ----------
    maps : mapping of str to ForceMap
        "fx", "fy", "fz" [N]; "x", "y" are maps of the moments Fz x and Fz y [N m], from which the centre follows.
    readings : int
        Number of readings in a frame.
    unit : float
        Factor on readings for the elastic model; NaN if it was rejected.
    unit_std : float
        Relative standard deviation of ``unit``.
    elastic_error : float
        Root mean square error of the elastic model's normal force with one fitted factor, relative to the root mean
        square of the labels; NaN if the model gave no result.
    elastic_weight, elastic_inflation : float
        Weight of its normal force joined with the map's, from presses that were left out, and the factor on the
        standard deviation of the joined force.
    said : tuple of str
        Findings, one sentence each.
    table : tuple of rows
        Name, error, R^2 and coverage (or NaN) of the normal force in cross-validation, this map first.
    constants : PadConstants or None
        Posterior of the pad's constants, if requested.
    gains : array (reading,) or None
        Gain by which each reading is divided before the elastic model uses it; None if gains were not requested.
    rest : array (frame, channel, *array) or None
        Readings at rest without their zero: their scatter is the noise for the elastic model.
    scale : float
        Factor that makes the labelled readings small for the pad, if the elastic model was rejected: a tracker watches the zero in this unit.
    zero : array (channel, *array) or None
        Readings at rest of the last recording, in the sensor's own unit; None without frames at rest.
    zero_std : array (channel, *array) or None
        Standard deviation of one frame at rest about it, of the zeros of several recordings from each other, and the
        drift from the start to the end of each.
    open_zero : bool
        Whether ``zero`` was taken from the readings, instead of a zero of their own day: its error is then in every interval.
    """

    maps: Mapping[str, ForceMap]
    readings: int
    unit: float = math.nan
    unit_std: float = math.nan
    elastic_error: float = math.nan
    elastic_weight: float = 0.0
    elastic_inflation: float = 1.0
    said: tuple[str, ...] = ()
    table: tuple[tuple[str, float, float, float], ...] = field(default=())
    rest: Floats | None = None
    scale: float = 1.0
    zero: Floats | None = None
    zero_std: Floats | None = None
    open_zero: bool = False
    constants: PadConstants | None = None
    gains: Floats | None = None

    @property
    def elastic(self) -> bool:
        """Whether the elastic model fits the presses, so that a pressure map is available."""
        return math.isfinite(self.unit)

    @property
    def factors(self) -> Floats:
        """Return the factors (reading,) that scale readings for the elastic model. If that was rejected, a tracker
        uses them to watch the zero.
        """
        gains = np.ones(self.readings) if self.gains is None else self.gains
        return (self.unit if self.elastic else self.scale) / gains

    def force(self, readings: Any) -> tuple[Floats, Floats]:
        """Return the net force (frame, 3) [N] and its standard deviation for readings (frame, reading) minus their
        zero; NaN for components without labels.
        """
        flat = np.atleast_2d(np.asarray(readings, dtype=np.float64))
        self.check_readings(flat.shape[-1])
        value, std = np.full((len(flat), 3), math.nan), np.full((len(flat), 3), math.nan)
        good = np.isfinite(flat).all(axis=1)
        for i, name in enumerate(FORCES):
            if name in self.maps and good.any():
                value[good, i], own = self.maps[name].predict(flat[good])
                std[good, i] = np.hypot(own, self._zero_error.get(name, 0.0))
        return value, std

    def is_zero(self, baseline: Any) -> bool:
        """Return whether a baseline equals the zero of this calibration."""
        return self.zero is not None and np.array_equal(np.asarray(baseline), self.zero, equal_nan=True)

    def standing(self, zero: Any) -> str | None:
        """Return a note if a new zero, (channel, *array) or (reading,), differs from that of the calibration by as
        much as a press would change it; otherwise None. A calibration without frames at rest took 0 for its zero.

        Nothing else distinguishes a constant press during the zeroing from rest.
        """
        fresh = np.asarray(zero, dtype=np.float64).ravel()
        if self.zero is None:
            far = np.linalg.norm(np.nan_to_num(fresh)) > STANDING * np.linalg.norm(self.largest)
            return NO_ZERO if far else None
        kept = self.zero.ravel()
        known = np.isfinite(kept)
        fresh = fresh[known] if fresh.size == kept.size else fresh
        if fresh.size != self.readings or not np.isfinite(fresh).all():
            return None
        off, std = self.opened().force(fresh - kept[known])
        largest = [float(np.abs(self.maps[n].process.values).max()) if n in self.maps else math.nan for n in FORCES]
        with np.errstate(invalid="ignore"):
            seen = np.flatnonzero((np.abs(off[0]) > STANDING * np.array(largest)) & (np.abs(off[0]) > 2.0 * std[0]))
        if not len(seen):
            return None
        what = " and ".join(f"{FORCES[i]} = {plain_number(float(off[0, i]), 2)} N" for i in seen)
        return f"the zero differs from that of the calibration as much as a press of {what} changes it: it has drifted, or something lay on the pad while the zero was taken. Take a new zero with nothing on the pad, or leave baseline (--baseline) out to use that of the calibration"

    def opened(self) -> SkinCalibration:
        """Return the calibration for readings minus its own zero; the intervals then include the error of that zero."""
        return replace(self, open_zero=True)

    @property
    def largest(self) -> Floats:
        """Return the largest labelled magnitude of each reading, in the sensor's own unit and minus the zero."""
        return np.asarray(np.max([np.abs(m.process.readings).max(axis=0) for m in self.maps.values()], axis=0))

    @cached_property
    def _zero_error(self) -> dict[str, float]:
        """Return the standard deviation of each quantity due to the error of the zero of each reading."""
        if not self.open_zero or self.zero_std is None:
            return {}
        off = self.zero_std[np.isfinite(self.zero_std)]
        return {n: float(np.sqrt((m.predict(np.diag(off))[0] ** 2).sum())) for n, m in self.maps.items()}

    def center(self, readings: Any, force: Floats, force_std: Floats) -> tuple[Floats, Floats] | None:
        """Return the centre (frame, 2) [m] and its standard deviation by the delta method; None without labelled
        positions.
        """
        if not set(PLACES) & set(self.maps):
            return None
        flat = np.atleast_2d(np.asarray(readings, dtype=np.float64))
        value, std = np.full((len(flat), 2), math.nan), np.full((len(flat), 2), math.nan)
        good = np.isfinite(flat).all(axis=1) & (np.abs(force[:, 2]) > 2.0 * force_std[:, 2])
        for i, name in enumerate(PLACES):
            if name in self.maps and good.any():
                moment, own = self.maps[name].predict(flat[good])
                moment_std = np.hypot(own, self._zero_error.get(name, 0.0))
                value[good, i] = moment / force[good, 2]
                std[good, i] = np.hypot(moment_std, value[good, i] * force_std[good, 2]) / np.abs(force[good, 2])
        return value, std

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the intervals: those of the component with the fewest labels."""
        return min(m.freedom for m in self.maps.values())

    def attach(self, touch: Touch, flat: Floats) -> Touch:
        """Return the touch with the force (and centre) of the calibration; ``flat`` are its readings (*batch, reading)
        minus their zero.
        """
        batch = touch.batch
        self.check_readings(np.shape(flat)[-1])
        rows = np.asarray(flat, dtype=np.float64).reshape(-1, self.readings)
        value, std = self.force(rows)
        freedom = {name: np.full(len(rows), m.freedom) for name, m in self.maps.items()}
        if self.elastic_weight > 0.0 and "fz" in self.maps:
            value[:, 2], std[:, 2], freedom["fz"] = self._with_elastic(touch, value[:, 2], std[:, 2])
        place = self.center(rows, value, std)
        notes: tuple[str, ...] = (() if self.elastic else (FORCE_ONLY_NOTE,)) + ((OPEN,) if self.open_zero else ())
        if max(m.unlike(rows) for m in self.maps.values()) > UNLIKE:
            notes += (
                "readings differ from those of all labelled presses (larger, or at another place): the force is extrapolated and its interval is wide; calibrate with such presses",
            )
        center, center_std = (None, None) if place is None else (v.reshape(*batch, 2) for v in place)
        force, std = value.reshape(*batch, 3), std.reshape(*batch, 3)
        least = np.min(list(freedom.values()), axis=0).reshape(batch)
        calibrated = CalibratedForce(force, std, least, center, center_std)
        return replace(touch, calibrated=calibrated, assumptions=(*touch.assumptions, *notes))

    def _with_elastic(self, touch: Touch, value: Floats, std: Floats) -> tuple[Floats, Floats, Floats]:
        """Return normal force, its standard deviation and degrees of freedom: an average of the map alone and the map
        joined with the elastic model of ``touch``. The map alone where that did not solve the frame.

        The degrees of freedom are those of a sum of variances (Satterthwaite, 1946).
        """
        force, own = (part.reshape(-1) for part in normal_force(touch))
        solved = np.isfinite(force) & np.isfinite(own) & np.isfinite(value)
        w = np.where(solved, self.elastic_weight, 0.0)
        both, off = joined(np.where(solved, force, value), np.where(solved, own, std), value, std)
        off = np.hypot(self.elastic_inflation * off, self.maps["fz"].gain_std * both)
        joint, alone = w * off**2, (1.0 - w) * (std**2 + w * (both - value) ** 2)
        freedom = (joint + alone) ** 2 / (joint**2 / JOINED_FREEDOM + alone**2 / self.maps["fz"].freedom)
        return w * both + (1.0 - w) * value, np.sqrt(joint + alone), freedom

    def components(self, surface: Grid) -> tuple[str, ...]:
        """Return the components of the force that were labelled."""
        return tuple(c for c in surface.components if f"f{c}" in self.maps)

    def alone(self, flat: Floats, surface: Grid, like: Any, *, time: Any = None) -> Touch:
        """Return a touch with only force and centre, whose traction is NaN. ``flat`` are its readings (*batch,
        reading) minus their zero.
        """
        batch = flat.shape[:-1]
        shape = (*batch, len(surface.components), *surface.shape)
        nan = np.full(shape, math.nan)
        sizes = (shape, (*batch, 3), (*batch, 3), (*batch, 2), batch)
        traction, force, moment, center, number = (np.full(s, math.nan) for s in sizes)
        none = Errors(traction, force, moment, center, number, traction, traction, force, moment, center, number, force)
        missing = ~np.isfinite(flat).all(axis=-1)
        status = np.where(missing, int(Status.MISSING), int(Status.SOLVED)).astype(np.int8)
        sought = self.components(surface)
        touch = self.attach(
            Touch(
                from_numpy(nan, like), surface, sought, "calibrated", _errors=ErrorParts(none), status=status, time=time
            ),
            flat,
        )
        known = touch.calibrated
        loud: Any = False
        if known is not None:  # for the type checker: `attach` always sets it
            with np.errstate(invalid="ignore"):
                loud = (np.abs(known.force) > 2.0 * known.std).any(axis=-1)
        quiet = ~missing & ~loud
        status = np.where(quiet, int(Status.NO_CONTACT), status)
        unknown = quiet & ~self._at_rest(flat)  # a wide interval does not show that nothing touches
        said = touch.assumptions + ((TOO_WIDE,) if unknown.any() else ())
        status = np.where(unknown, int(Status.UNDECIDED), status).astype(np.int8)
        return replace(touch, status=status, touching=~quiet & ~missing, assumptions=said)

    def _at_rest(self, flat: Floats) -> Any:
        """Return whether readings (*batch, reading) minus their zero are as near to it as frames at rest; True if none are known."""
        if self.zero_std is None:
            return np.ones(flat.shape[:-1], dtype=bool)
        std = self.zero_std[np.isfinite(self.zero_std)]
        std = np.maximum(std, np.median(std))  # coarse counts may not vary at all
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.where(flat == 0.0, 0.0, np.abs(flat) / std)
        return np.sqrt(np.mean(size**2, axis=-1)) < AT_REST

    def check_readings(self, count: int) -> None:
        """Raise an error for frames with another number of readings."""
        if count != self.readings:
            raise InvalidInput(
                f"this calibration is for {self.readings} readings a frame; got {count}. Calibrate the skin with the taxels that it has now."
            )

    def check_options(self, given: Mapping[str, Any]) -> None:
        """Raise an error for options of the elastic model if that was rejected."""
        # a run over a recording passes method and components even if they are the defaults
        named = [k for k, v in given.items() if v is not None and k not in ("method", "components", "rng")]
        if getattr(given.get("method"), "friction_given", None) is not None:
            named.append("friction")
        if named and not self.elastic:
            raise NotObservable(
                f"{', '.join(named)} is an option of the elastic model, which does not fit the calibration presses: there is no pressure map. Leave it out."
            )

    def __str__(self) -> str:
        lines = []
        for name, one in self.maps.items():
            what = {"x": "centre x", "y": "centre y"}.get(name, name.upper())
            lines.append(
                f"{what:<16}from {len(one.process.values)} labelled frames in {len(np.unique(one.process.press))} groups, of which each is left out once"
            )
        if self.table:
            lines.append(
                "normal force on presses that were left out: mean error, R^2, share of true values inside the 95 % intervals"
            )
            for name, error, r2, coverage in self.table:
                share = "" if math.isnan(coverage) else f", {coverage:.2f}"
                lines.append(f"  {name:<18}{plain_number(error, 3)} N, {r2:.3f}{share}")
        lines += [f"- {s}" for s in self.said]
        return "\n".join(lines if self.constants is None else [*lines, str(self.constants)])
