"""The tracker of a calibrated skin: the same zero and the same stream, with the net force of the calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.grids import Grid
from palpate.status import Status
from palpate.touch import Touch
from palpate.tracking.tracker import Tracker

__all__ = ["CalibratedTracker"]


class CalibrationLike(Protocol):
    """What a tracker asks of a calibration."""

    @property
    def unit(self) -> float: ...
    @property
    def scale(self) -> float: ...
    @property
    def readings(self) -> int: ...
    @property
    def elastic(self) -> bool: ...
    @property
    def rest(self) -> Floats | None: ...
    def attach(self, touch: Touch, flat: Floats) -> Touch: ...
    def alone(self, flat: Floats, surface: Grid, like: Any, *, time: Any = None) -> Touch: ...


class CalibratedTracker(Tracker):
    """`Tracker` whose touches hold the net force of a calibration, with its intervals.

    Where the elastic model holds, it is asked in the unit that the calibration found. Where it was rejected, it serves the zero alone, and traction is NaN. The
    noise is that of the calibration's frames at rest: without it a stream that begins without a zero would take presses for drift of it.

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

    def __init__(self, *args: Any, calibration: CalibrationLike, **options: Any) -> None:
        self.calibration = calibration
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

    @property
    def _unit(self) -> float:
        """What readings are multiplied by for the elastic model."""
        return self.calibration.unit if self.calibration.elastic else self.calibration.scale

    def _flat(self, reading: Any) -> tuple[Floats, Any]:
        flat, like = super()._flat(reading)
        return self._unit * flat, like

    def _answer(self, status: Status, now: float, converged: bool, like: Any, note: str | None) -> Touch:
        touch = super()._answer(status, now, converged, like, note)
        actual = self._actual
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
        before = self._zero.baseline
        self._actual = None if before is None else flat - before * self._std
        return super()._step(flat, elapsed, started, self._noise_at_rest if known is None else known)

    def reset(self) -> None:
        """Forget contact, drift and zero, as `Tracker.reset`.

        Examples
        --------
        >>> from palpate.tracking.calibrated import CalibratedTracker
        >>> CalibratedTracker.reset.__name__
        'reset'
        """
        self._actual = None
        super().reset()
