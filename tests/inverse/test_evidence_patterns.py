"""Patterns that are marginalised in the evidence of the contact methods, against restricted likelihood by dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.inverse.linear import evidence


@pytest.mark.parametrize("singles", [3, 60], ids=["few", "many"])
@pytest.mark.parametrize("parameter", [1e-2, 1e2])
def test_patterns_are_those_of_restricted_likelihood(singles: int, parameter: float) -> None:
    """What lies along the patterns is left out; one that others make up (the offset of a dead channel) counts once."""
    n = 120
    rng = np.random.default_rng(singles)
    basis, _ = np.linalg.qr(rng.standard_normal((n, n)))
    values = 10.0 ** rng.uniform(-4.0, 4.0, n)
    values[:10] = 0.0
    c = rng.standard_normal(n) * np.sqrt(1.0 + values / parameter)
    own = np.concatenate([basis[:singles], rng.standard_normal((2, n))])
    patterns = np.concatenate([own, own[:singles].sum(axis=0)[None]])
    patterns /= np.linalg.norm(patterns, axis=1, keepdims=True)
    found = evidence.Marginal(values, c, patterns)
    covariance = np.diag(1.0 + values / parameter)
    left_out, _ = np.linalg.qr(patterns.T[:, :-1])
    rest = np.linalg.svd(np.eye(n) - left_out @ left_out.T)[0][:, : n - len(own)]
    inner = rest.T @ covariance @ rest
    sizes = np.linalg.svd(patterns, compute_uv=False)[: len(own)]
    (everything, alone), (left, there) = found.alone, found.at(parameter)
    assert left == pytest.approx(rest.T @ c @ np.linalg.solve(inner, rest.T @ c), rel=1e-9)
    assert everything == pytest.approx(((rest.T @ c) ** 2).sum(), rel=1e-9)
    assert there == pytest.approx(np.linalg.slogdet(inner)[1] + 2.0 * np.log(sizes).sum(), rel=1e-9)
    assert alone == pytest.approx(2.0 * np.log(sizes).sum(), rel=1e-9)


def test_one_frame_serves_noise_of_every_size() -> None:
    """Noise of another size is readings of another size."""
    n = 120
    rng = np.random.default_rng(2)
    values = 10.0 ** rng.uniform(-4.0, 4.0, n)
    c = rng.standard_normal(n) * np.sqrt(1.0 + values / 0.1)
    for count in (3, 30):
        patterns = rng.standard_normal((count, n))
        frame = evidence.Marginal(values, c, patterns)
        for noise in (0.1, 3.0):
            assert frame.best(True, noise) == pytest.approx(evidence.Marginal(values, c / noise, patterns).best(True))


def test_patterns_that_weights_no_longer_tell_apart_count_as_one() -> None:
    """By eigenvalues and by factors alike, to what rounding of a normal matrix leaves."""
    n = 90
    rng = np.random.default_rng(1)
    values = 10.0 ** rng.uniform(-6.0, 6.0, n)
    patterns = np.eye(n)[:40] + 1e-3 * rng.standard_normal((40, n))
    c = rng.standard_normal(n)
    weights = 1e-9 / (1e-9 + values)[None]
    many = evidence._restricted(weights, c, patterns)
    one = evidence._by_eigenvalues((patterns * weights) @ patterns.T, patterns @ (weights[0] * c))
    assert many[0][0] == pytest.approx(weights[0] @ c**2 - one[0], rel=1e-6)
    assert many[1][0] == pytest.approx(-np.log(weights).sum() + one[1], rel=1e-9)
