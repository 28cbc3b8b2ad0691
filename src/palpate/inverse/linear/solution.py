"""What the decomposition (`palpate.inverse.linear.regularised`) and the iteration (`palpate.inverse.linear.matrix_free`)
have in common: noise, notes and error bars of the frames that they solved.
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.estimate import Estimate, in_frames
from palpate.inverse.linear.parameter import MODEL_ERROR, TINY, Choice, Filter, check_parameter
from palpate.inverse.linear.patterns import Patterns, Removed
from palpate.inverse.linear.posterior import UNEXPLAINED, LinearErrors, Uncertainty, Variances
from palpate.sensing.operator import Operator

__all__ = ["BLIND", "LinearMethod", "Solution", "joined"]

#: Beginning of the note on noise that cannot be estimated.
BLIND = "noise cannot be separated from traction"

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")


@dataclass(frozen=True, kw_only=True)
class Solution:
    """Some frames (frame, ...), solved by a linear method.

    ``data`` and ``floor`` are those of `Uncertainty`; ``unsettled``: the rule did not settle on a parameter.
    """

    traction: Any
    choice: Choice
    data: Floats
    floor: Floats | None
    removed: Removed | None
    unsettled: npt.NDArray[np.bool_] | None = None


class LinearMethod(abc.ABC):
    """A linear method prepared for an operator, with a parameter lambda or the rule that chooses it for each frame.

    ``scales`` are the standard deviations by which the readings were divided (channel, per plane); ``noise_known``:
    whether they are the true noise; ``absolute``: prior and noise are known absolutely, not only up to a factor; ``count``: data.
    """

    #: The nuisances of the readings; None: none.
    patterns: Patterns | None = None

    def __init__(
        self,
        operator: Operator,
        scales: Sequence[Floats],
        noise_known: bool,
        filter_factors: Filter,
        parameter: float | str,
        absolute: bool,
        count: float,
    ) -> None:
        check_parameter(parameter)
        self.operator, self.grid = operator, operator.surface
        self.scales, self.noise_known = scales, noise_known
        self.filter, self.parameter, self.absolute = filter_factors, parameter, absolute
        self.count = count

    @property
    @abc.abstractmethod
    def variances(self) -> Variances:
        """Error bars of estimates."""

    @abc.abstractmethod
    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array per plane."""

    @abc.abstractmethod
    def again(self, readings: Sequence[Floats], parameter: Floats) -> Floats:
        """Traction (frame, component, *surface) of readings (frame, channel, *array) per plane with given parameters
        (frame,), without subtracting nuisances.
        """

    def noise_floor(self, readings: Sequence[Any], frames: int) -> Floats | None:
        """Lower bound of the noise variance of each frame (frame,), relative to the whitening; None if the noise is
        known.
        """
        if self.noise_known:
            return None
        largest: Any = np.zeros(frames)
        for array, scale, values in zip(self.operator.planes_of, self.scales, readings):
            rows = to_numpy(values).reshape(frames, len(scale), -1)
            if array.mask is not None:
                rows = rows[..., array.valid.ravel()]
            ends = np.maximum(rows.max(axis=-1), -rows.min(axis=-1))
            largest = np.maximum(largest, (ends / scale).max(axis=-1))
        return np.asarray((MODEL_ERROR * largest) ** 2)

    def estimate(self, found: Solution, batch: tuple[int, ...]) -> Estimate:
        """The estimate of a batch; its traction has the batch axes."""
        choice = found.choice
        parameter, scale = choice.parameter.reshape(batch), np.sqrt(choice.noise_variance).reshape(batch)
        ones = np.ones(batch) if self.absolute else None
        known = Uncertainty(
            parameter,
            ones,
            ones,
            data=None if self.absolute else found.data.reshape(*batch, -1),
            floor=None if found.floor is None else found.floor.reshape(batch),
            patterns=None
            if found.removed is None
            else found.removed.directions.reshape(*batch, *found.removed.directions.shape[1:]),
        )
        return Estimate(
            found.traction,
            parameter,
            scale,
            np.sqrt(choice.residual / self.count).reshape(batch) / np.maximum(scale, TINY),
            errors=LinearErrors.of(self.variances, self.filter, found.traction, known),
            noise_std=scale[..., None] * np.concatenate(self.scales),
            said=self._notes(found, batch),
        )

    def _notes(self, found: Solution, batch: tuple[int, ...]) -> tuple[str, ...]:
        said: list[str] = []
        choice = found.choice
        if self.patterns is not None and found.removed is not None:
            said += self.patterns.words(found.removed, batch)
        if choice.fell_back.any():
            said.append(
                f'rule="{self.parameter}": the curve has no corner{in_frames(choice.fell_back, batch)}, so "{choice.fallback}" chose the parameter there'
            )
        if found.unsettled is not None and found.unsettled.any():
            said.append(
                f'rule="{self.parameter}" did not settle on a parameter{in_frames(found.unsettled, batch)}: the last one tried is used. Give '
                "parameter=..., or the array its noise=..."
            )
        blind = choice.free / self.count < UNEXPLAINED
        if isinstance(self.parameter, str) and not self.noise_known and blind.any():
            said.append(
                f"noise cannot be separated from traction{in_frames(blind, batch)}, which explains the readings at every wavelength: fine detail "
                "of the map may be noise. Give the array its noise=..., and noise_correlation=... if neighbours share it, as windows that overlap do"
            )
        return tuple(said)


def joined(parts: Sequence[Record]) -> Record:
    """Records of arrays (frame, ...), joined end to end."""
    values: dict[str, Any] = {}
    for f in fields(parts[0]):
        each: list[Any] = [getattr(p, f.name) for p in parts]
        if is_dataclass(each[0]):
            values[f.name] = joined(each)
        else:
            values[f.name] = np.concatenate(each) if isinstance(each[0], np.ndarray) else each[0]
    return type(parts[0])(**values)
