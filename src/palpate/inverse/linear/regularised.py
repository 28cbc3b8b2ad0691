"""Linear methods by spectral decomposition: a filter, and a parameter or a rule that chooses it for each frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._arrays import from_numpy, namespace, to_numpy
from palpate._threads import cached_property, few_threads
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.estimate import Estimate
from palpate.inverse.linear.fourier import FourierSpectrum
from palpate.inverse.linear.memory import check_spectrum, check_waves
from palpate.inverse.linear.parameter import Filter, choose, filtered_inverse, tikhonov
from palpate.inverse.linear.patterns import SpectrumPatterns
from palpate.inverse.linear.posterior import SpectrumVariances
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.solution import LinearMethod, Solution
from palpate.inverse.linear.spectrum import DataSpectrum, Shared, Spectrum, noise_scales
from palpate.sensing.operator import Operator

__all__ = ["Decomposition", "Regularised", "decompose"]


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


class Regularised(LinearMethod):
    """A regularised inversion: a decomposition, a filter phi(s^2, lambda), and lambda or the rule that chooses it for
    each frame.

    ``absolute`` as in `LinearMethod`; ``nuisance``: the nuisances of the readings
    (`palpate.inverse.problem.Problem`).
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
        operator, spectrum, scales = decomposition.operator, decomposition.spectrum, decomposition.scales
        count = float(spectrum.multiplicity.sum())
        super().__init__(operator, scales, decomposition.noise_known, filter_factors, parameter, absolute, count)
        self.decomposition, self.spectrum = decomposition, spectrum
        if operator.boundary == "free" and nuisance != ():
            patterns = SpectrumPatterns(spectrum, scales, nuisance, float(parameter) if absolute else None)
            self.patterns = patterns if patterns.all else None
        elif nuisance and not (nuisance == ("offset",) and not spectrum.mean_seen.any()):
            raise Unsupported(
                f'nuisance={list(nuisance)} needs boundary="free" (a periodic surface has no edges that a ramp or a rotation could '
                "have); leave nuisance out."
            )

    @property
    def variances(self) -> SpectrumVariances:
        return self.decomposition.variances

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        xp = namespace(readings[0])
        coefficients = self.spectrum.project(readings)
        batch = coefficients.shape[:-1]
        values, counts = self.spectrum.eigenvalues, self.spectrum.multiplicity
        floor = self.noise_floor(readings, math.prod(batch))
        removed = None
        if self.patterns is not None:
            removed = self.patterns.removed(to_numpy(coefficients).reshape(-1, len(values)), floor)
            coefficients = from_numpy(removed.coefficients.reshape(coefficients.shape), coefficients)
        plain = to_numpy(coefficients).reshape(-1, len(values))
        power = np.square(plain.real, dtype=np.float64)
        if np.iscomplexobj(plain):
            power += np.square(plain.imag, dtype=np.float64)
        choice = choose(
            self.parameter,
            self.filter,
            values,
            counts,
            power,
            noise_known=self.noise_known,
            floor=floor,
            tried=self.spectrum.tried if self.filter is tikhonov and isinstance(self.parameter, str) else None,
        )
        gain = filtered_inverse(self.filter, values, choice.parameter).reshape(*batch, -1)
        real = xp.real(coefficients) if xp.isdtype(coefficients.dtype, "complex floating") else coefficients
        found = Solution(
            traction=self.spectrum.solve(coefficients * from_numpy(gain, real)),
            choice=choice,
            data=power,
            floor=floor,
            removed=removed,
        )
        return self.estimate(found, batch)

    def again(self, readings: Sequence[Floats], parameter: Floats) -> Floats:
        gain = filtered_inverse(self.filter, self.spectrum.eigenvalues, parameter)
        return np.asarray(self.spectrum.solve(self.spectrum.project(readings) * gain))
