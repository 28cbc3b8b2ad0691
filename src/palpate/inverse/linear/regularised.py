"""Linear methods by spectral decomposition: a filter, and a parameter or a rule that chooses it for each frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, namespace, to_numpy
from palpate._threads import cached_property, few_threads
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.estimate import Estimate, in_frames
from palpate.inverse.linear.fourier import FourierSpectrum
from palpate.inverse.linear.memory import check_spectrum, check_waves
from palpate.inverse.linear.parameter import (
    MODEL_ERROR,
    TINY,
    Filter,
    check_parameter,
    choose,
    filtered_inverse,
    tikhonov,
)
from palpate.inverse.linear.patterns import Patterns
from palpate.inverse.linear.posterior import UNEXPLAINED, LinearErrors, SpectrumVariances, Uncertainty, unexplained
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.spectrum import DataSpectrum, Shared, Spectrum, noise_scales
from palpate.sensing.operator import Operator

__all__ = ["BLIND", "Decomposition", "Regularised", "decompose"]

#: Beginning of the note of `Regularised.solve` on noise that cannot be estimated.
BLIND = "noise cannot be separated from traction"


@dataclass(frozen=True)
class Decomposition:
    """Spectral decomposition of the operator, weighted by the prior. It is computed once and used for any filter,
    parameter and readings.

    ``scales`` are the standard deviations by which the readings were divided (channel, per plane); ``noise_known``:
    whether they are the true noise.
    """

    operator: Operator
    columns: tuple[int, ...]
    scales: list[Floats]
    noise_known: bool
    spectrum: Spectrum

    @cached_property
    def variances(self) -> SpectrumVariances:
        """Error bars of estimates."""
        return SpectrumVariances(self.spectrum, self.columns)

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return self.spectrum.nbytes + self.variances.nbytes


def decompose(
    operator: Operator, priors: Sequence[Prior], columns: Sequence[int], shared: Shared | None = None
) -> Decomposition:
    """The decomposition of ``operator`` for the components ``columns``, with one prior each; ``shared`` caches
    products that priors of other strengths share.
    """
    if operator.boundary == "free":
        check_spectrum(operator.pad, operator.planes_of, operator.surface, len(columns))
    else:
        check_waves(operator.planes_of, operator.surface)
    scales, known = noise_scales(operator, columns)
    spectrum: Spectrum
    with few_threads(sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)):
        if operator.boundary == "periodic":
            spectrum = FourierSpectrum(operator, priors, columns, scales)
        else:
            spectrum = DataSpectrum(operator, priors, columns, scales, shared)
    return Decomposition(operator, tuple(columns), scales, known, spectrum)


class Regularised:
    """A regularised inversion: a decomposition, a filter phi(s^2, lambda), and lambda or the rule that chooses it for
    each frame.

    ``absolute``: prior and noise are known absolutely, not only up to a factor; ``nuisance``: the nuisances of the
    readings (`palpate.inverse.problem.Problem`).
    """

    def __init__(
        self,
        decomposition: Decomposition,
        filter_factors: Filter,
        parameter: float | str,
        *,
        absolute: bool = False,
        nuisance: tuple[str, ...] | None = (),
    ) -> None:
        check_parameter(parameter)
        self.decomposition, self.filter, self.parameter = decomposition, filter_factors, parameter
        self.operator, self.spectrum = decomposition.operator, decomposition.spectrum
        self.scales, self.noise_known = decomposition.scales, decomposition.noise_known
        self.grid, self.absolute = self.operator.surface, absolute
        self.patterns: Patterns | None = None
        if self.operator.boundary == "free" and nuisance != ():
            known = float(parameter) if absolute else None
            self.patterns = Patterns(self.operator, self.spectrum, self.scales, nuisance, known)
        elif nuisance and not (
            nuisance == ("offset",) and isinstance(self.spectrum, FourierSpectrum) and not self.spectrum.mean_seen.any()
        ):
            raise Unsupported(
                f'nuisance={list(nuisance)} needs boundary="free" (a periodic surface has no edges that a ramp or a rotation could '
                "have); leave nuisance out."
            )

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array per plane."""
        xp = namespace(readings[0])
        coefficients = self.spectrum.project(readings)
        batch = coefficients.shape[:-1]
        values, counts = self.spectrum.eigenvalues, self.spectrum.multiplicity
        floor = self._floor(readings, math.prod(batch))
        said: list[str] = []
        removed = None
        if self.patterns is not None:
            flat = to_numpy(coefficients).reshape(-1, len(values))
            removed = self.patterns.removed(flat, None if self.noise_known else floor)
        if self.patterns is not None and removed is not None:
            said += self.patterns.words(removed, batch)
            coefficients = from_numpy(removed.coefficients.reshape(coefficients.shape), coefficients)
        power = _squares(to_numpy(coefficients)).reshape(-1, len(values))
        if isinstance(self.parameter, str):
            choice = choose(
                self.parameter,
                self.filter,
                values,
                counts,
                power,
                noise_known=self.noise_known,
                floor=floor,
                tried=self.spectrum.tried if self.filter is tikhonov else None,
            )
            chosen, variance = choice.parameter, choice.noise_variance
            if choice.fell_back.any():
                said.append(
                    f'rule="{self.parameter}": the curve has no corner{in_frames(choice.fell_back, batch)}, so "{choice.fallback}" chose the '
                    "parameter there"
                )
        else:
            chosen = np.full(len(power), float(self.parameter))
            phi = self.filter(values[None, :], chosen[:1, None])[0]
            free = max(float(counts @ (1.0 - phi)), 1.0)
            variance = np.ones(len(power))
            if not self.noise_known:
                variance = np.maximum((power * counts * (1.0 - phi) ** 2).sum(axis=1) / free, floor)
        phi = self.filter(values[None, :], chosen[:, None])
        if isinstance(self.parameter, str) and not self.noise_known:
            blind = unexplained(self.filter, self.spectrum, chosen) < UNEXPLAINED
            if blind.any():
                said.append(
                    f"noise cannot be separated from traction{in_frames(blind, batch)}, which explains the readings at every wavelength: fine detail "
                    "of the map may be noise. Give the array its noise=..., and noise_correlation=... if neighbours share it, as windows that overlap do"
                )
        gain = filtered_inverse(self.filter, values, chosen).reshape(*batch, -1)
        residual = np.sqrt((power * counts * (1.0 - phi) ** 2).sum(axis=1) / counts.sum())
        real = xp.real(coefficients) if xp.isdtype(coefficients.dtype, "complex floating") else coefficients
        traction = self.spectrum.solve(coefficients * from_numpy(gain, real))
        scale = np.sqrt(variance).reshape(batch)
        patterns = None
        if removed is not None:
            patterns = removed.directions.reshape(*batch, *removed.directions.shape[1:])
        if self.absolute:
            known = Uncertainty(chosen.reshape(batch), np.ones(batch), np.ones(batch), patterns=patterns)
        else:
            least = None if self.noise_known else floor.reshape(batch)
            known = Uncertainty(chosen.reshape(batch), data=power.reshape(*batch, -1), floor=least, patterns=patterns)
        return Estimate(
            traction,
            chosen.reshape(batch),
            scale,
            residual.reshape(batch) / np.maximum(scale, TINY),
            errors=LinearErrors.of(self.decomposition.variances, self.filter, traction, known),
            noise_std=scale[..., None] * np.concatenate(self.scales),
            said=tuple(said),
        )

    def again(self, readings: Sequence[Floats], parameter: Floats) -> Floats:
        """Traction (frame, component, *surface) of readings (frame, channel, *array) per plane with given parameters (frame,), without subtracting
        nuisances.
        """
        coefficients, values = self.spectrum.project(readings), self.spectrum.eigenvalues
        return np.asarray(self.spectrum.solve(coefficients * filtered_inverse(self.filter, values, parameter)))

    def _floor(self, readings: Sequence[Any], frames: int) -> Floats:
        """Lower bound of the noise variance of each frame (frame,), relative to the whitening."""
        largest: Any = np.zeros(frames)
        for array, scale, values in zip(self.operator.planes_of, self.scales, readings):
            rows = to_numpy(values).reshape(frames, len(scale), -1)
            if array.mask is not None:
                rows = rows[..., array.valid.ravel()]
            ends = np.maximum(rows.max(axis=-1), -rows.min(axis=-1))
            largest = np.maximum(largest, (ends / scale).max(axis=-1))
        return np.asarray((MODEL_ERROR * largest) ** 2)


def _squares(coefficients: npt.NDArray[Any]) -> Floats:
    """|c|^2 in double precision."""
    parts = [coefficients.real, coefficients.imag] if np.iscomplexobj(coefficients) else [coefficients]
    total: Any = 0.0
    for part in parts:
        part = part.astype(np.float64)
        part *= part
        total = total + part
    return np.asarray(total)
