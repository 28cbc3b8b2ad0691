"""Error bars of the linear methods: closed forms against dense algebra, coverage under their own model, and their way through a touch."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.linear.lumps import lumps
from palpate.inverse.linear.parameter import amplitude, candidates, tikhonov, truncate
from palpate.inverse.linear.posterior import LinearErrors, Uncertainty
from palpate.inverse.linear.priors import DifferencePrior, hilgers_prior
from palpate.inverse.linear.regularised import Decomposition, decompose
from palpate.sensing.operator import Operator

PAD = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=0.4)
Floats = np.ndarray


def layout(name: str) -> tuple[Operator, list[int]]:
    """An operator on a small surface, and the components sought."""
    if name == "line":
        array: Any = pp.LineArray(count=14, pitch=0.5, depth=0.6, channels=["stress_xz", "stress_zz"], noise=[0.2, 0.1])
        return Operator(PAD, [array], pp.LineGrid(count=18, spacing=0.5), "free"), [0, 1]
    if name == "correlated line":
        array = pp.LineArray(count=14, pitch=0.5, depth=0.6, channels=["stress_zz"], noise=0.1, noise_correlation=0.7)
        return Operator(PAD, [array], pp.LineGrid(count=18, spacing=0.5), "free"), [1]
    if name == "area":
        array = pp.AreaArray(shape=(6, 5), pitch=0.5, depth=0.6, channels=["stress_zz", "strain_xz"], noise=0.1)
        return Operator(PAD, [array], pp.AreaGrid(shape=(7, 8), spacing=0.5), "free"), [0, 2]
    if name == "masked":
        mask = np.random.default_rng(1).random((6, 5)) > 0.2
        array = pp.AreaArray(shape=(6, 5), pitch=0.5, depth=0.6, channels=["stress_zz"], noise=0.1, mask=mask)
        return Operator(PAD, [array], pp.AreaGrid(shape=(6, 7), spacing=0.5), "free"), [2]
    if name == "scattered":
        points = np.random.default_rng(2).uniform(-1.5, 1.5, (40, 2))
        array = pp.ScatteredArray(
            positions=points, depth=0.5, channels=["displacement_x", "displacement_y"], noise=[0.1, 0.2]
        )
        return Operator(PAD, [array], pp.AreaGrid(shape=(6, 7), spacing=0.5), "free"), [0, 1]
    channels, columns = (
        (["stress_xz", "stress_zz"], [0, 1]) if "line" in name else (["displacement_x", "displacement_y"], [0, 1])
    )
    if "line" in name:
        array = pp.LineArray(count=12, pitch=0.5, depth=0.6, channels=channels, noise=0.1)
    else:
        array = pp.AreaArray(shape=(6, 5), pitch=0.5, depth=0.4, channels=channels, noise=0.1)
    return Operator(PAD, [array], array.grid, "periodic"), columns


LAYOUTS = ["line", "correlated line", "area", "masked", "scattered", "periodic line", "periodic area"]


def dense(op: Operator, priors: list[Any], columns: list[int]) -> tuple[Floats, Floats, Floats]:
    """A, N and W as matrices, of the components sought."""
    grid = op.surface
    cells = int(np.prod(grid.shape))
    (array,) = op.planes_of
    keep = np.ravel(array.valid)
    full = op.planes[0].dense().reshape(len(array.channels), keep.size, len(grid.components), cells)
    a = full[:, keep][:, :, columns].reshape(-1, len(columns) * cells)
    noise = np.repeat(np.asarray(array.noise_std), keep.sum())
    n = np.diag(noise**2)
    if array.noise_correlation:
        gap = np.abs(array.points[:, None, :] - array.points[None, :, :]).sum(axis=-1)
        n = noise[:, None] * noise[None, :] * np.exp(-gap / array.noise_correlation)
    w = np.zeros((len(columns) * cells,) * 2)
    for i, prior in enumerate(priors):
        block = slice(i * cells, (i + 1) * cells)
        unit = np.eye(cells).reshape(cells, *grid.shape)
        if op.boundary == "free":
            w[block, block] = prior.covariance(unit).reshape(cells, cells)
        else:
            size, d = grid.shape, grid.dimensions
            k = np.sqrt(
                sum(
                    (
                        (2 * np.pi * (np.fft.rfftfreq(n_, dx) if ax == d - 1 else np.fft.fftfreq(n_, dx))).reshape(
                            [-1 if b == ax else 1 for b in range(d)]
                        )
                    )
                    ** 2
                    for ax, (n_, dx) in enumerate(zip(size, grid.spacings))
                )
            )
            axes = tuple(range(1, 1 + d))
            spectrum = prior.spectrum(k)
            if all("displacement" in c for c in array.channels):
                spectrum = spectrum.copy()
                spectrum[(0,) * d] = 0.0  # the mean that leaves no trace
            w[block, block] = np.fft.irfftn(np.fft.rfftn(unit, axes=axes) * spectrum, s=size, axes=axes).reshape(
                cells, cells
            )
    return a, n, w


def errors_of(
    decomposition: Decomposition, factors: Any, traction: Floats, parameter: float, noise: float, size: float
) -> LinearErrors:
    known = Uncertainty(np.asarray(parameter), np.asarray(noise), np.asarray(size))
    return LinearErrors.of(decomposition.variances, factors, traction, known)


@pytest.mark.parametrize("kind", ["posterior", "another amplitude", "truncated"])
@pytest.mark.parametrize("name", LAYOUTS)
def test_closed_forms_are_those_of_dense_algebra(name: str, kind: str, rng: np.random.Generator) -> None:
    op, columns = layout(name)
    grid = op.surface
    prior = hilgers_prior(grid, 0.8) if name in ("area", "periodic line") else DifferencePrior(grid, 1)
    priors = [prior] * len(columns)
    decomposition = decompose(op, priors, columns)
    a, n, w = dense(op, priors, columns)
    traction = np.zeros((len(grid.components), *grid.shape))
    traction[columns] = rng.standard_normal((len(columns), *grid.shape))
    values = decomposition.spectrum.eigenvalues
    parameter, noise = float(np.sqrt(values.max() * np.median(values[values > 0]))), 0.7
    if kind == "posterior":
        size, factors = noise / parameter, tikhonov
        gain = w @ a.T @ np.linalg.inv(a @ w @ a.T + parameter * n)
        expected = size * (w - gain @ a @ w)
    else:
        size, factors = 3.1, tikhonov if kind == "another amplitude" else truncate
        gain = w @ a.T @ np.linalg.inv(a @ w @ a.T + parameter * n)
        if kind == "truncated":
            half = np.linalg.inv(np.linalg.cholesky(n))
            rows = half @ a
            lam, u = np.linalg.eigh(rows @ w @ rows.T)
            kept = lam > parameter
            gain = w @ rows.T @ (u[:, kept] / lam[kept]) @ u[:, kept].T @ half
        left = np.eye(len(w)) - gain @ a
        expected = size * left @ w @ left.T + noise * gain @ n @ gain.T
    found = errors_of(decomposition, factors, traction, parameter, noise, size)
    cells = int(np.prod(grid.shape))
    std = np.sqrt(np.diag(expected)).reshape(len(columns), *grid.shape)
    np.testing.assert_allclose(found.traction[columns], std, rtol=1e-10)
    prior_std = np.sqrt(size * np.diag(w)).reshape(std.shape)
    np.testing.assert_allclose(found.variance_reduction[columns], 1 - (std / prior_std) ** 2, atol=1e-8)

    def of(rows: Floats) -> Floats:
        flat = rows.reshape(len(rows), -1)
        return np.sqrt(np.einsum("ri,ij,rj->r", flat, expected, flat))

    rows = np.zeros((len(columns), len(columns), cells))
    rows[np.arange(len(columns)), np.arange(len(columns))] = grid.cell
    totals = traction[columns].reshape(len(columns), -1).sum(axis=1) * grid.cell
    if name == "periodic area":
        assert np.isnan(found.force[columns]).all()
        assert np.isnan(found.moment[2])
    else:
        np.testing.assert_allclose(found.force[columns], np.hypot(of(rows), 5e-4 * totals), rtol=1e-10)
        places = np.stack([m.ravel() for m in np.meshgrid(*grid.axes, indexing="ij")[::-1]])
        if "z" in [grid.components[c] for c in columns]:
            lever = np.zeros((1, len(columns), cells))
            lever[0, -1] = -places[0] * grid.cell
            np.testing.assert_allclose(found.moment[0 if grid.dimensions == 1 else 1], of(lever)[0], rtol=1e-10)
            p = np.where(traction[-1] > 0.1 * traction[-1].max(), traction[-1], 0.0).ravel()
            center = (places * p).sum(axis=1) / p.sum()
            weights = np.zeros((len(places), len(columns), cells))
            weights[:, -1] = (p > 0) * (places - center[:, None]) / p.sum()
            np.testing.assert_allclose(found.center, of(weights), rtol=1e-10)
            assert float(found.peak) == pytest.approx(std[-1].ravel()[traction[-1].argmax()], rel=1e-10)
    absent = [c for c in range(len(grid.components)) if c not in columns]
    assert not found.traction[absent].any()
    assert not np.nan_to_num(found.force[absent]).any()


def test_symmetry_blocks_change_no_error_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks, modes that are not kept, and eigenvalues put together: the same to the accuracy of each."""
    array = pp.AreaArray(
        shape=(9, 8), pitch=0.5, depth=0.5, channels=["stress_xz", "stress_yz", "stress_zz"], noise=0.01
    )
    op = Operator(PAD, [array], pp.AreaGrid(shape=(11, 10), spacing=0.5), "free")
    priors = [DifferencePrior(op.surface, 1)] * 3
    traction = np.ones((3, 11, 10))

    def made() -> LinearErrors:
        found = decompose(op, priors, [0, 1, 2])
        return errors_of(found, tikhonov, traction, 1e-3 * found.spectrum.eigenvalues.max(), 1.0, 2.0)

    whole = made()
    for limit in ("LARGEST_SVD", "LARGEST_MODES"):
        monkeypatch.setattr(f"palpate.inverse.linear.spectrum.{limit}", 10)
        other = made()
        for name in ("traction", "force", "moment", "center", "peak", "variance_reduction"):
            np.testing.assert_allclose(getattr(other, name), getattr(whole, name), rtol=1e-6, err_msg=name)
    monkeypatch.setattr("palpate.inverse.linear.lumps.MAX_SINGLE_EIGENVALUES", 10)
    np.testing.assert_allclose(made().traction, whole.traction, rtol=2e-6)


def test_eigenvalues_put_together_give_the_same_sums(rng: np.random.Generator) -> None:
    values = 10.0 ** rng.uniform(-12, 3, 3000)
    values[:7] = 0.0
    nodes, weights = lumps(values)
    assert len(nodes) < 400
    x = rng.random(3000)
    x[:7] = 0.0
    for parameter in 10.0 ** np.linspace(-13, 4, 18):
        expected = (x / (1 + values / parameter)).sum()
        assert ((weights @ x) / (1 + nodes / parameter)).sum() == pytest.approx(expected, rel=3e-6)


@pytest.mark.parametrize("name", ["line", "area", "periodic line"])
def test_coverage_is_exact_on_tractions_from_the_prior(name: str, rng: np.random.Generator) -> None:
    """Gaussian tractions drawn from the prior: errors over standard deviations are standard normal, cell by cell and for the force."""
    op, columns = layout(name)
    prior = hilgers_prior(op.surface, 0.8)
    decomposition = decompose(op, [prior] * len(columns), columns)
    a, n, w = dense(op, [prior] * len(columns), columns)
    size, count = 0.4, 2000
    values, vectors = np.linalg.eigh(w)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    true = np.sqrt(size) * rng.standard_normal((count, len(w))) @ root.T
    y = true @ a.T + rng.standard_normal((count, len(n))) @ np.linalg.cholesky(n).T
    parameter = 1.0 / size
    estimate = y @ np.linalg.solve(a @ w @ a.T + parameter * n, a @ w)
    traction = np.zeros((count, len(op.surface.components), *op.surface.shape))
    traction[:, columns] = estimate.reshape(count, len(columns), *op.surface.shape)
    ones = np.ones(count)
    known = Uncertainty(parameter * ones, ones, size * ones)
    found = LinearErrors.of(decomposition.variances, tikhonov, traction, known)
    z = (true - estimate).reshape(count, -1) / found.traction[:, columns].reshape(count, -1)
    assert np.abs((z**2).mean(axis=0) - 1).max() < 0.18  # 5 standard errors of 2000 frames
    assert np.abs((np.abs(z) < 1.959964).mean(axis=0) - 0.95).max() < 0.025
    miss = (true - estimate).reshape(count, len(columns), -1).sum(axis=-1) * op.surface.cell
    z = miss / found.force[:, columns]
    assert np.abs((z**2).mean(axis=0) - 1).max() < 0.18


def test_amplitude_is_the_mean_over_its_marginal_likelihood(rng: np.random.Generator) -> None:
    """Many modes: that which made them. Nothing but noise: what would not have shown, not nothing."""
    values = 10.0 ** rng.uniform(-3, 3, 4000)
    ones = np.ones(4000)
    power = (0.2 * values + 1.0) * rng.standard_normal(4000) ** 2
    for floor, scale in ((None, 1.0), (np.zeros(1), 9.0)):
        size, noise = amplitude(values, ones, scale * power[None], floor)
        assert size[0] == pytest.approx(0.2 * scale, rel=0.1)
        assert noise[0] == pytest.approx(scale, rel=0.1)
    size, _ = amplitude(values, ones, rng.standard_normal((50, 4000)) ** 2, None)
    # 4000 data tell a variance to a few per cent: sum (size s^2)^2/2 of order 1
    visible = np.sqrt(2.0 / (values**2).sum())
    assert (size > 0.05 * visible).all()
    assert (size < 20 * visible).all()
    assert len(candidates(values)) == 217


def skin(noise: float | None = None) -> pp.Skin:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    return pp.Skin(
        pad, pp.LineArray(count=41, pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_zz"], noise=noise)
    )


def frames(of: pp.Skin, count: int, rng: np.random.Generator) -> Floats:
    y = np.asarray(of.sense(pp.solutions.hertz_line(half_width=6e-3, force=10.0).sliding(0.3)))
    return y + 0.01 * np.abs(y).max() * rng.standard_normal((count, *y.shape))


@pytest.mark.parametrize("method", ["tikhonov", "hilgers", "truncated", "wiener"])
def test_linear_methods_have_intervals(method: str, rng: np.random.Generator) -> None:
    of = skin(noise=6.0 if method == "wiener" else None)
    options = {"spectrum": lambda k: 3e3 / (1 + (3e-3 * k) ** 2)} if method == "wiener" else {}
    touch = of.reconstruct(frames(of, 5, rng), method=method, **options)
    low, high = touch.interval(0.95, "force")
    assert ((low < [3.0, 10.0]) & (high > [3.0, 10.0])).mean() >= 0.8  # of ten intervals of 95 %
    assert (high - low < 5.0).all()
    assert (np.asarray(touch.std()) > 0).all()
    low, high = touch.interval(0.95)
    assert (np.asarray(low) < 0).any()  # traction may pull: nothing stops at zero
    assert np.isfinite(touch.interval(0.9, "peak_pressure")).all()
    assert np.isfinite(touch.interval(0.9, "center_of_pressure")).all()
    assert np.isfinite(touch.interval(0.9, "slip_margin", friction=0.6)).all()
    assert 0.9 < float(touch[0].exceeds(5.0, "force")) <= 1.0
    assert "95 %" in touch[0].summary()


def test_frames_of_a_batch_have_the_error_bars_that_they_have_alone(rng: np.random.Generator) -> None:
    of = skin()
    y = frames(of, 3, rng) * np.array([1.0, 0.1, 3.0])[:, None, None]
    touch = of.reconstruct(y, method="tikhonov")
    for i in range(3):
        alone, picked = of.reconstruct(y[i], method="tikhonov")._errors.posterior, touch[i]._errors.posterior
        assert alone is not None
        assert picked is not None
        for name in ("traction", "force", "moment", "center", "peak", "outside_force", "variance_reduction"):
            np.testing.assert_allclose(getattr(picked, name), getattr(alone, name), rtol=1e-9, err_msg=name)
    copy = pickle.loads(pickle.dumps(touch))
    np.testing.assert_array_equal(copy._errors.posterior.force, touch._errors.posterior.force)  # type: ignore[union-attr]
    single = of.reconstruct(y.astype(np.float32), method="tikhonov")
    assert single.values.dtype == np.float32
    np.testing.assert_allclose(single._errors.posterior.force, touch._errors.posterior.force, rtol=0.02)  # type: ignore[union-attr]


def test_pulling_frames_of_an_automatic_batch_have_error_bars(rng: np.random.Generator) -> None:
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    of = pp.Skin(pad, pp.LineArray(count=31, pitch=0.5, depth=1.5, channels=["stress_zz"]))
    push = np.asarray(of.sense(pp.solutions.hertz_line(half_width=2.0, force=1.0)))
    touch = of.reconstruct(np.stack([push, -push]) + 0.01 * push.max() * rng.standard_normal((2, *push.shape)))
    low, high = touch.interval(0.95, "force")
    assert low[0, 1] < 1.0 < high[0, 1]
    assert low[1, 1] < -1.0 < high[1, 1]


def test_components_that_only_linear_methods_serve_have_error_bars(rng: np.random.Generator) -> None:
    """No refusal points in a circle: what is left to the linear method has an interval."""
    of = skin()
    touch = of.reconstruct(frames(of, 1, rng)[0], components=["x"])
    assert touch.method == "tikhonov"
    assert np.isfinite(touch.interval(0.95, "force")).all()


def test_a_frame_where_nothing_shows_has_the_error_of_what_would_not_show(rng: np.random.Generator) -> None:
    of = skin()
    noise = rng.standard_normal((20, 2, 41))
    touch = of.reconstruct(noise, method="tikhonov")
    # a force spread over a depth would be seen above 1/sqrt(taxels there) of the noise: the interval is at least of that order
    low, high = touch.interval(0.95, "force")
    assert ((high - low)[:, 1] > 2e-4).all()
    assert touch._errors is not None
    assert (np.abs(touch.force) < 1.96 * touch._errors.posterior.force).mean() > 0.9


def test_readings_that_are_zero_throughout_have_no_error_bars() -> None:
    touch = skin().reconstruct(np.zeros((2, 41)), method="tikhonov")
    assert np.isnan(touch.interval(0.95, "force")).all()


def test_an_unobservable_mean_has_no_interval(rng: np.random.Generator) -> None:
    pad = pp.HalfSpace(youngs_modulus=1e3, poissons_ratio=0.5)
    array = pp.AreaArray(shape=(12, 12), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    of = pp.Skin(pad, array, boundary="periodic")
    touch = of.reconstruct(1e-7 * rng.standard_normal((2, 12, 12)), components=["x", "y"])
    assert np.isnan(touch.interval(0.95, "force")[0][:2]).all()
    assert np.isfinite(np.asarray(touch.std())).all()


def test_a_periodic_offset_is_not_noise(rng: np.random.Generator) -> None:
    """What k = 0 of a half-space's displacement says is neither traction nor noise: an offset changes nothing."""
    pad = pp.HalfSpace(youngs_modulus=1e3, poissons_ratio=0.5)
    array = pp.AreaArray(shape=(16, 16), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    of = pp.Skin(pad, array, boundary="periodic")
    t = np.zeros((3, 16, 16))
    t[0, 5:7, 5:7], t[0, 10:12, 10:12] = 300.0, -300.0
    y = np.asarray(of.sense(t))
    y = y + 0.02 * np.abs(y).max() * rng.standard_normal(y.shape)
    plain = of.reconstruct(y, components=["x", "y"])
    moved = of.reconstruct(y + 5 * np.abs(y).max(), components=["x", "y"])
    np.testing.assert_allclose(moved.values, plain.values, atol=1e-6 * np.abs(plain.values).max())
    np.testing.assert_allclose(moved.noise_std, plain.noise_std, rtol=1e-6)
