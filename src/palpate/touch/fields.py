"""The fields of a result, and values derived from them.

In: the output of a method or a tracker. Out: `Fields`, from which numbers (`numbers`), intervals, words and tables follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._batches import freeze, per_frame, per_frame_fields
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse.estimate import Errors, Stated
from palpate.sensing.grids import Grid
from palpate.sensing.view import View
from palpate.status import Status
from palpate.uncertainty import Case, contact_kind

__all__ = ["CalibratedForce", "ErrorParts", "Fields", "pulling"]


@dataclass(frozen=True)
class ErrorParts:
    """What the intervals of a touch are made of, before calibration: `Touch.interval` and `Touch.std` put it together.

    ``posterior`` holds the standard deviations by noise and prior, ``pad`` those by the uncertainty of pad and sensors (`palpate.Uncertainty`), and
    ``scale`` the relative standard deviation of the factor common to all results: the scale of the readings, and the modulus if all depends on it.
    """

    posterior: Errors = field(metadata=per_frame())
    pad: Stated | None = field(default=None, metadata=per_frame())
    scale: float = 0.0

    @classmethod
    def of(cls, posterior: Errors | None, pad: Stated | None, scale: float) -> ErrorParts | None:
        """The parts, or None from a method without error bars."""
        return None if posterior is None else cls(posterior, pad, scale)

    def adding(self, more: Mapping[str, Any]) -> ErrorParts:
        """Return the errors with the pad's standard deviations added in quadrature."""
        return replace(self, pad=Stated.added(self.pad, more))


@dataclass(frozen=True, eq=False)
class CalibratedForce:
    """Net force by the calibration of a skin (`palpate.Skin.calibrate`), and the centre where labelled places determine it.

    Attributes
    ----------
    force, std : array (*batch, component)
        Net force [N] and its standard deviation; NaN for components that no label determines.
    freedom : array (*batch)
        Degrees of freedom of the intervals, which are Student's.
    center, center_std : array (*batch, 2) or None
        Centre (x, y) [m] and its standard deviation.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.touch import CalibratedForce
    >>> known = CalibratedForce(np.array([0.0, 0.0, 2.0]), np.array([0.1, 0.1, 0.1]), np.array(10.0))
    >>> low, high = known.interval(0.95)
    >>> low[2].round(2).item(), high[2].round(2).item()
    (1.78, 2.22)
    """

    force: Floats = field(metadata=per_frame("component"))
    std: Floats = field(metadata=per_frame("component"))
    freedom: Floats = field(metadata=per_frame())
    center: Floats | None = field(default=None, metadata=per_frame("along"))
    center_std: Floats | None = field(default=None, metadata=per_frame("along"))

    def __post_init__(self) -> None:
        freeze(self)

    @property
    def known(self) -> bool:
        """Whether any component of the force is known in any frame."""
        return bool(np.isfinite(self.force).any())

    def interval(self, level: float, of: str = "force") -> tuple[Floats, Floats] | None:
        """Value -+ Student's quantile times standard deviation of "force" or "center_of_pressure"; None where the calibration has no such value."""
        from scipy.special import stdtrit

        parts = {"force": (self.force, self.std), "center_of_pressure": (self.center, self.center_std)}
        value, std = parts.get(of, (None, None))
        if value is None or std is None:
            return None
        half = stdtrit(np.asarray(self.freedom), 0.5 * (1.0 + level))[..., None] * std
        return np.asarray(value - half), np.asarray(value + half)

    def chance_above(self, limit: float) -> Floats:
        """Probability (*batch) that the normal force exceeds a limit [N]."""
        from scipy.special import stdtr

        gap = (np.asarray(self.force)[..., -1] - limit) / np.asarray(self.std)[..., -1]
        return np.asarray(stdtr(np.asarray(self.freedom), gap), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Fields:
    """The fields of one frame or of a batch; `palpate.Touch` documents each."""

    values: Any = field(metadata=per_frame("component", "*"))
    surface: Grid
    components: tuple[str, ...]
    method: str
    assumptions: tuple[str, ...] = ()
    parameter: Floats | None = field(default=None, metadata=per_frame())
    noise_std: Floats | None = field(default=None, metadata=per_frame("channel"))
    residual: Floats | None = field(default=None, metadata=per_frame())
    unobservable_force: tuple[str, ...] = ()
    time: Floats | None = field(default=None, metadata=per_frame())
    meta: dict[str, Any] = field(default_factory=dict)
    _errors: ErrorParts | None = field(default=None, metadata=per_frame())
    converged: npt.NDArray[np.bool_] | None = field(default=None, metadata=per_frame(missing=True))
    touching: npt.NDArray[np.bool_] | None = field(default=None, metadata=per_frame(missing=True))
    outliers: npt.NDArray[np.bool_] | None = field(default=None, metadata=per_frame("reading", missing=False))
    draws: Floats | None = field(default=None, metadata=per_frame("draw", "component", "*"))
    resolution: Floats | None = field(default=None, metadata=per_frame())
    sliding: Floats | None = field(default=None, metadata=per_frame())
    drag: Floats | None = field(default=None, metadata=per_frame("along"))
    drag_std: Floats | None = field(default=None, metadata=per_frame())
    sticking: Floats | None = field(default=None, metadata=per_frame("candidate"))
    found_by: npt.NDArray[np.str_] | None = field(default=None, metadata=per_frame(missing=""))
    status: npt.NDArray[np.int8] | None = field(default=None, metadata=per_frame(missing=int(Status.SOLVED)))
    pushing: npt.NDArray[np.bool_] | None = field(default=None, metadata=per_frame(missing=True))
    fit: Floats | None = field(default=None, metadata=per_frame())
    nuisance: Floats | None = field(default=None, metadata=per_frame("nuisance"))
    nuisance_std: Floats | None = field(default=None, metadata=per_frame("nuisance"))
    nuisance_names: tuple[tuple[str, str], ...] = ()
    at_limit: npt.NDArray[np.bool_] | None = field(default=None, metadata=per_frame("reading", missing=False))
    reading_names: Mapping[int, str] = field(default_factory=dict)
    case: Case | None = None
    friction: float | None = None
    view: View | None = None
    discrepancy: Floats | None = field(default=None, metadata=per_frame(missing=0.0))
    force_bounds: Floats | None = field(default=None, metadata=per_frame("component", "bound"))
    strain: Floats | None = field(default=None, metadata=per_frame())
    calibrated: CalibratedForce | None = field(default=None, metadata=per_frame())

    def __post_init__(self) -> None:
        expected = (len(self.surface.components), *self.surface.shape)
        shape = tuple(np.shape(self.values))
        if shape[-len(expected) :] != expected:
            raise InvalidInput(
                f"values must have shape (*batch, component, *surface) = (..., {', '.join(map(str, expected))}); got {shape}."
            )
        batch = self.batch
        for name, value in per_frame_fields(self) if batch else ():
            if tuple(np.shape(value))[: len(batch)] != batch:
                raise InvalidInput(
                    f"{name} must have the batch axes {batch} of values first; it has the shape {tuple(np.shape(value))}."
                )
        freeze(self)

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch axes; () for one frame.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> pp.Touch(np.zeros((3, 2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov").batch
        (3,)
        """
        return tuple(np.shape(self.values))[: -1 - self.surface.dimensions]

    @property
    def has_intervals(self) -> bool:
        """Whether the method gave error bars: `Touch.interval`, `Touch.std` and `Touch.exceeds` raise `Unsupported` otherwise.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> pp.Touch(np.zeros((2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov").has_intervals
        False
        """
        return self._errors is not None

    @property
    def _scale_std(self) -> float:
        """Relative standard deviation of the factor common to all results."""
        return 0.0 if self._errors is None else self._errors.scale

    @property
    def methods(self) -> npt.NDArray[np.str_]:
        """The method that found each frame (*batch).

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> pp.Touch(np.zeros((3, 2, 4)), grid, ("x", "z"), "tikhonov").methods.tolist()
        ['tikhonov', 'tikhonov', 'tikhonov']
        """
        return np.full(self.batch, self.method) if self.found_by is None else self.found_by

    @property
    def calibration_case(self) -> Case:
        """The case whose constants scale the error bars.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> str(skin.reconstruct(readings, method="adaptive").calibration_case)
        'line, stress, half-space'
        """
        return self.case or Case(contact_kind(self.surface.dimensions, self.components))


def pulling(touch: Fields) -> npt.NDArray[np.bool_]:
    """Mask of frames (*batch) that pull as a whole."""
    if touch.pushing is None:
        return np.zeros(touch.batch, dtype=bool)
    d = touch.surface.dimensions
    pressure = np.take(to_numpy(touch.values), -1, axis=-1 - d)
    axes = tuple(range(-d, 0))
    known = (touch.methods == "adaptive") | (touch.methods == "constrained")
    return np.asarray(~touch.pushing & known & (pressure.sum(axis=axes) < 0) & (pressure.max(axis=axes) <= 0))
