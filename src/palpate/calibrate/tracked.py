"""Tracker of a calibrated skin: as `Tracker`, with the net force of the calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.calibrate.calibration import SkinCalibration
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.zero import MOVED
from palpate.status import Status
from palpate.touch import Touch
from palpate.tracking.rest import Rest
from palpate.tracking.tracker import Tracker
from palpate.tracking.zero import Zero

__all__ = ["CalibratedTracker"]

#: Note if the readings moved while the zero was taken.
NO_ZERO = "the readings moved while the zero was taken, by more than their noise: the zero of the calibration serves instead. Give fewer frames (baseline=, --baseline), or take the zero anew while nothing touches (Z on the page, Tracker.rezero)"


class CalibratedTracker(Tracker):
    """`Tracker` whose touches have the net force of a calibration, with its intervals.

    If the calibration accepted the elastic model, the model runs on readings scaled by the calibration. If it rejected
    the model, only its zero is used, and traction is NaN. The noise comes from the calibration's frames at rest;
    without it, a stream that begins without a zero would take presses for drift.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> pad = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    >>> skin = pp.Skin(pad, pp.AreaArray(shape=(2, 2), pitch=12e-3, depth="base", channels=["stress_zz"]))
    >>> counts = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=2.0))) / 37.0
    >>> tracker = skin.calibrate(np.stack([0.0 * counts, 0.5 * counts, counts]), reference=[0.0, 1.0, 2.0]).track(baseline=1)
    >>> zero = tracker.step(5.0 + 0.0 * counts)
    >>> round(float(tracker.step(5.0 + counts).force[2]), 1)  # [N]
    2.0
    """

    def __init__(self, *args: Any, calibration: SkinCalibration, **options: Any) -> None:
        self._calibrated = calibration
        self.calibration = calibration.opened() if calibration.is_zero(options.get("baseline", 0)) else calibration
        self._no_zero = False  # whether the readings moved while the zero was taken
        self._zero_note: str | None = None  # note if the zero differs from the calibration's
        self._actual: Floats | None = None
        super().__init__(*args, **options)
        if len(self._std) != calibration.readings:
            raise InvalidInput(
                f"this calibration is for {calibration.readings} readings a frame; the skin has {len(self._std)}. Calibrate the skin with the taxels that it has now."
            )

        rest = () if calibration.rest is None else calibration.rest
        flat = np.array([self._flat(frame)[0] for frame in rest])
        scatter = float(np.median(flat.std(axis=0) / self._std)) if len(flat) > 1 else 0.0
        self._noise_at_rest = scatter if scatter > 0.0 else None
        self._ranged = any(p.limits is not None for p in self.estimator.operator.planes_of)

    @property
    def _unit(self) -> Floats:
        """Factor of each reading for the elastic model."""
        return self.calibration.factors

    @property
    def zero(self) -> list[Floats]:
        """The zero in use, as `Tracker.zero`, in the unit of the sensor."""
        return [z / np.where(u != 0, u, 1.0) for z, u in zip(super().zero, self.estimator.readings.planes(self._unit))]

    def _flat(self, reading: Any) -> tuple[Floats, Any]:
        flat, like = super()._flat(reading)
        return self._unit * flat, like

    def _answer(self, status: Status, converged: bool, *, now: float, like: Any, note: str | None) -> Touch:
        touch = super()._answer(status, converged, now=now, like=like, note=note)
        actual = self._actual
        if not self.calibration.elastic:
            touch = replace(touch, components=self.calibration.components(touch.surface))
        if status is Status.CAPTURING_ZERO or actual is None:
            return touch
        actual = actual / self._unit
        if self.calibration.elastic:
            return self.calibration.attach(touch, actual)
        found = self.calibration.alone(actual, touch.surface, like, time=touch.time)
        said = tuple(n for n in self._said if n not in found.assumptions)
        frozen = status is Status.FROZEN
        return replace(
            found,
            assumptions=(*found.assumptions, *(() if note is None else (note,)), *said),
            status=np.asarray(int(Status.FROZEN), dtype=np.int8) if frozen else found.status,
        )

    def _step(self, flat: Floats, elapsed: float, started: float, known: float | None) -> tuple[Status, bool]:
        before, capturing = self._zero.baseline, self._zero.capturing
        self._actual = None if before is None else flat - before * self._std
        found = super()._step(flat, elapsed, started, self._noise_at_rest if known is None else known)
        if capturing and not self._zero.capturing:
            self.calibration, self._no_zero = self._calibrated, self._zero.moved and self._calibrated.zero is not None
            fresh = self._zero.baseline
            self._zero_note = None if fresh is None else self._calibrated.standing(fresh * self._std / self._unit)
            if self._no_zero:
                self._go_back_to_zero()
        if self._zero_note is not None and not self._no_zero:
            self._said.append(self._zero_note)
        if self._no_zero:
            self._said = [s for s in self._said if s != MOVED] + [NO_ZERO]
        return found

    def _go_back_to_zero(self) -> None:
        """Use the zero of the calibration, if it has one, because the readings moved."""
        zero = self._flat(self._calibrated.zero)[0] / self._std
        self._zero = Zero(zero, 0, self.drift_time, self._offsets.index)
        self._rest, self.calibration = Rest(), self._calibrated.opened()

    def _say(self, elapsed: float) -> None:
        check = self._check
        actual = np.abs(self._actual) / self._unit if self._actual is not None else None
        # Labelled presses gave larger readings, so equal values here are chance, as in coarse counts, not saturation.
        if actual is not None and not self._ranged and not (check.clipped & (actual >= self.calibration.largest)).any():
            check.overload = False
            check.clipped = np.zeros_like(check.clipped)
        super()._say(elapsed)

    def reset(self) -> None:
        """Forget contact, drift and zero, as `Tracker.reset`.

        Examples
        --------
        >>> from palpate.calibrate.tracked import CalibratedTracker
        >>> CalibratedTracker.reset.__name__
        'reset'
        """
        self._actual, self._no_zero, self._zero_note = None, False, None
        super().reset()
