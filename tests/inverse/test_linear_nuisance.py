"""Patterns that are no contact in linear methods: closed forms, drift against net force, offsets that a user speaks of."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.inverse.linear.posterior import PATTERN

PAD = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=0.4)


def density(k: Any) -> Any:
    return 0.3 * np.exp(-((0.6 * k) ** 2))


@pytest.mark.parametrize("kinds", [["offset"], ["offset", "ramp"]])
def test_patterns_are_marginalised_as_dense_algebra_does(kinds: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings A t + B a + noise with a of known variance: mean, standard deviations, sizes."""
    g = 2.0
    monkeypatch.setattr("palpate.inverse.linear.patterns.SIZES", (g,))
    rng = np.random.default_rng(5)
    array = pp.LineArray(count=20, pitch=0.5, depth=0.6, channels=["stress_xz", "stress_zz"], noise=[0.05, 0.1])
    skin = pp.Skin(PAD, array, nuisance=kinds)
    grid = skin.surface
    a = skin.operator.dense().reshape(40, -1)
    noise = np.repeat([0.05, 0.1], 20)
    n = 2 * grid.count
    k = 2 * np.pi * np.fft.fftfreq(n, 0.5)
    lag = np.arange(grid.count)[:, None] - np.arange(grid.count)[None, :]
    block = (density(np.abs(k)) * np.cos(k * lag[..., None] * 0.5)).sum(-1) / (n * 0.5)
    w = np.kron(np.eye(2), block)
    x = array.grid.x - array.grid.x.mean()
    each = [np.ones(20)] + ([x] if "ramp" in kinds else [])
    rows = [np.concatenate([v if c == channel else 0 * v for c in range(2)]) for channel in range(2) for v in each]
    scale = [1.0 / np.sqrt(np.mean((r / noise) ** 2)) for r in rows]
    b = np.stack([r * s for r, s in zip(rows, scale)], axis=1)  # root mean square of one, in units of the noise
    y = rng.standard_normal(40) * 0.3
    sigma = a @ w @ a.T + np.diag(noise**2) + g**2 * b @ b.T
    inverse = np.linalg.inv(sigma)
    mean = w @ a.T @ inverse @ y
    covariance = w - w @ a.T @ inverse @ a @ w
    touch = skin.reconstruct(y.reshape(2, 20), method="wiener", spectrum=density)
    np.testing.assert_allclose(np.ravel(touch.values), mean, atol=1e-9)
    assert touch._errors is not None
    np.testing.assert_allclose(np.ravel(touch._errors.posterior.traction), np.sqrt(np.diag(covariance)), rtol=1e-8)
    force = np.kron(np.eye(2), np.full(grid.count, grid.cell))
    bare = w - w @ a.T @ np.linalg.solve(a @ w @ a.T + np.diag(noise**2), a @ w)
    total = bare + PATTERN**2 * (covariance - bare)
    expected = np.sqrt(np.einsum("ri,ij,rj->r", force, total, force) + (5e-4 * force @ mean) ** 2)
    np.testing.assert_allclose(touch._errors.posterior.force, expected, rtol=1e-8)


def cell(count: int = 20) -> tuple[pp.AreaArray, np.ndarray]:
    """A dipole of two adhesions on a gel, and its in-plane displacements on the surface."""
    array = pp.AreaArray(shape=(count, count), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    skin = pp.Skin(GEL, array)
    grid = skin.surface
    truth = np.zeros((3, *grid.shape))
    for x, y, q in ((5e-6, 2e-6, -500.0), (-5e-6, -2e-6, 500.0)):
        truth[0] += q * (np.hypot(grid.x[None, :] - x, grid.axes[0][:, None] - y) < 1.5e-6)
    return array, np.asarray(skin.sense(truth))


GEL = pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=0.5)


@pytest.mark.parametrize("drift", [*long_runs(0.0, 0.1), 0.5])
@pytest.mark.long
def test_a_drifting_stage_makes_no_net_force(drift: float) -> None:
    """Traction force microscopy on a free half-space: a shift of the image and a net force look alike, and the interval says so."""
    array, clean = cell()
    rng = np.random.default_rng(3)
    top = np.abs(clean).max()
    readings = clean + 0.02 * top * rng.standard_normal(clean.shape)
    readings[0] += drift * top
    free = pp.Skin(GEL, array)
    touch = free.reconstruct(readings, components=["x", "y"], method="tikhonov")
    low, high = touch.interval(0.95, "force")
    assert (low[:2] < 0).all()
    assert (high[:2] > 0).all()
    assert any("shift along x" in n for n in touch.notes)
    still = pp.Skin(GEL, array, nuisance=[]).reconstruct(readings, components=["x", "y"], method="tikhonov")
    assert not any("shift" in n for n in still.notes)
    assert (high - low)[0] > 2 * np.diff(np.stack(still.interval(0.95, "force")), axis=0)[0, 0]
    if drift:  # 500 Pa on 7 square micrometres pulls with 3.5 nN; the drift looks like much more
        assert abs(touch.force[0]) < 0.4 * abs(still.force[0])
    else:  # where there is none, the map is hardly touched
        error = np.linalg.norm(touch.values - still.values) / np.linalg.norm(still.values)
        assert error < 0.1


def test_a_frame_of_a_batch_has_the_patterns_that_it_has_alone() -> None:
    array, clean = cell(12)
    rng = np.random.default_rng(4)
    top = np.abs(clean).max()
    batch = clean + 0.02 * top * rng.standard_normal((3, *clean.shape)) + top * np.array([0, 1, 2])[:, None, None, None]
    skin = pp.Skin(GEL, array)
    given: Any = {"components": ["x", "y"], "method": "tikhonov"}
    whole = skin.reconstruct(batch, **given)
    for i in range(3):
        alone = skin.reconstruct(batch[i], **given)
        scale = np.abs(alone.values).max()
        np.testing.assert_allclose(whole.values[i], alone.values, atol=1e-8 * scale)
        np.testing.assert_allclose(np.asarray(whole[i].std()), np.asarray(alone.std()), rtol=1e-6, atol=1e-9 * scale)
    assert any("2 of 3 frames" in n or "3 of 3 frames" in n for n in whole.notes)


def test_an_offset_that_the_user_speaks_of_is_taken_out() -> None:
    """Stress on a half-space: an offset looks like pressure all over, so that only the user can know."""
    rng = np.random.default_rng(6)
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    array = pp.LineArray(count=61, pitch=1e-3, depth=2e-3, channels=["stress_zz"])
    plain, told = pp.Skin(pad, array), pp.Skin(pad, array, nuisance=["offset"])
    clean = np.asarray(plain.sense(pp.solutions.hertz_line(half_width=5e-3, force=10.0)))
    readings = clean + 0.01 * clean.max() * rng.standard_normal(clean.shape) + 0.2 * clean.max()
    wrong, right = (s.reconstruct(readings, method="tikhonov") for s in (plain, told))
    assert wrong.force[1] > 15.0
    low, high = right.interval(0.95, "force")
    assert low[1] < 10.0 < high[1]


def test_patterns_that_a_periodic_surface_cannot_have_are_refused() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    with pytest.raises(pp.Unsupported, match='boundary="free"'):
        pp.Skin(GEL, array, boundary="periodic", nuisance=["ramp"]).reconstruct(
            1e-7 * np.ones((2, 8, 8)), method="tikhonov"
        )
    # an offset leaves no trace there: nothing to take out
    skin = pp.Skin(GEL, array, boundary="periodic", nuisance=["offset"])
    assert np.isfinite(skin.reconstruct(1e-7 * np.eye(8) * np.ones((2, 1, 1)), method="tikhonov").values).all()
