"""A long spectrum on bins chooses what the whole one does."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.inverse.linear import parameter
from palpate.inverse.linear.parameter import Binned, SpectrumCurves, Tried, candidates, choose, tikhonov, tried_on


def spectrum(n: int, decades: float, zeros: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(int(decades))
    values = 10.0 ** -rng.uniform(0.0, decades, n)
    values[:zeros] = 0.0
    power = rng.chisquare(1, (3, n)) * (1e-3 + 10.0 * values / values.max())
    return values, rng.choice([1.0, 2.0], n), power


@pytest.mark.parametrize(("decades", "zeros"), [(8.0, 0), (14.0, 5), (22.0, 3)])
def test_curves_and_parameters_are_those_of_the_whole_spectrum(decades: float, zeros: int) -> None:
    values, counts, power = spectrum(6000, decades, zeros)
    whole, binned = Tried(tikhonov, candidates(values), values, counts), Binned(candidates(values), values, counts)
    a, b = (SpectrumCurves(each, counts * power) for each in (whole, binned))
    for name in ("residual", "explained", "penalty", "free"):
        x, y = getattr(a, name), getattr(b, name)
        assert np.abs(x - y).max() < 1e-5 * np.abs(x).max(), name
    assert np.array_equal(a.inside, b.inside)
    for rule in ("evidence", "gcv", "lcurve", "discrepancy"):
        known = rule == "discrepancy"
        found = [choose(rule, tikhonov, values, counts, power, noise_known=known, tried=t) for t in (whole, binned)]
        assert np.allclose(found[0].parameter, found[1].parameter, rtol=1e-5), rule
        assert np.allclose(found[0].noise_variance, found[1].noise_variance, rtol=1e-5), rule


def test_short_spectra_are_taken_whole() -> None:
    values, counts, _ = spectrum(parameter.LONG - 1, 8.0, 0)
    assert not isinstance(tried_on(values, counts), Binned)
    values, counts, _ = spectrum(parameter.LONG, 8.0, 0)
    assert isinstance(tried_on(values, counts), Binned)
