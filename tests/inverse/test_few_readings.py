"""A normal matrix that is kept as few readings and a penalty: the same answers as one that is formed."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest

import palpate as pp
from palpate.inverse.constrained.circulant import times
from palpate.inverse.constrained.cone import Cone, minimise
from palpate.inverse.constrained.differences import Differences
from palpate.inverse.constrained.faces import Face, Ray
from palpate.inverse.constrained.factors import Bordered, Chain, Dense, Factor, FewReadings, cholesky
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.constrained.quadratic import Formed, Penalty, Unformed, formed_or_not, prior_factor
from palpate.inverse.constrained.responses import Responses
from palpate.inverse.constrained.rows import Rows
from palpate.inverse.constrained.variances import log_determinant, told_of, with_matrix
from palpate.inverse.contact.adaptive import AdaptiveEstimator
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.linear.spectrum import DataSpectrum

Floats = npt.NDArray[np.float64]


def problem(
    c: int = 3, shape: tuple[int, ...] = (14, 9), readings: int = 20, order: int = 1, seed: int = 0, scale: float = 30.0
) -> tuple[Formed, Unformed, Penalty, Floats, Differences, npt.NDArray[np.intp]]:
    rng = np.random.default_rng(seed)
    grid = (
        pp.AreaGrid(shape=(shape[0], shape[1]), spacing=0.5)
        if len(shape) == 2
        else pp.LineGrid(count=shape[0], spacing=0.5)
    )
    d = Differences(grid)
    cells = np.flatnonzero(rng.random(grid.shape).ravel() < 0.8)
    if order == 1:
        tau = np.exp(3.0 * rng.standard_normal(grid.shape))
        each = d.local(np.stack([0.3 * tau] * (c - 1) + [tau]))
    else:
        each = d.even(2, [0.1 * (i + 1) for i in range(c)])
    penalty = Penalty(cells, each, grid.shape)
    columns = scale * rng.standard_normal((c * len(cells), readings)) / np.sqrt(readings)
    formed = Formed(penalty.added(columns @ columns.T))
    linear = (columns @ rng.standard_normal(readings)).reshape(c, -1) + 1.0
    return formed, Unformed(columns, penalty), penalty, linear, d, cells


def test_local_weights_are_those_of_differences_over_their_scale() -> None:
    d = Differences(pp.AreaGrid(shape=(4, 5), spacing=(0.5, 0.25)))
    tau = np.exp(np.random.default_rng(0).standard_normal((4, 5)))
    along = [a.toarray() for a in d.along]
    expected = sum(m.T @ np.diag(1.0 / e.ravel()) @ m for m, e in zip(along, d.on_edges(tau[None])))
    np.testing.assert_allclose(d.local(tau[None])[0].toarray(), expected, rtol=1e-12, atol=1e-12)

    fields = np.random.default_rng(1).standard_normal((3, 20))
    for one, across in zip(along, d.across(fields)):
        np.testing.assert_allclose(across, fields @ one.T, rtol=1e-12, atol=1e-12)


def test_a_factor_of_no_unknowns() -> None:
    """A contact whose every cell is fixed has one; it was a ValueError."""
    none = np.zeros(0, dtype=np.intp)
    chain = Chain(0, none, none, np.zeros(0))
    assert chain.forward(np.zeros((3, 0))).shape == (3, 0)
    assert chain.backward(np.zeros((3, 0))).shape == (3, 0)


def test_a_chain_is_a_cholesky_factor() -> None:
    rng = np.random.default_rng(1)
    n, reach = 230, 30
    full = np.tril(np.triu(rng.standard_normal((n, n)), -reach))
    full = full @ full.T * (np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= reach)
    full += (reach + 1) * np.diag(np.abs(full).sum(axis=1)) / reach
    i, j = np.nonzero(np.tril(full))
    chain = Chain(n, i, j, full[i, j])
    assert len(chain.slices) > 2
    right = rng.standard_normal((3, n))
    half = chain.forward(right.copy())
    np.testing.assert_allclose(half @ half.T, right @ np.linalg.solve(full, right.T), rtol=1e-10)
    np.testing.assert_allclose(chain.backward(half.copy()), np.linalg.solve(full, right.T).T, rtol=1e-9)
    inverse = np.linalg.inv(full)
    np.testing.assert_allclose(chain.entries(i, j), inverse[i, j], rtol=1e-8, atol=1e-12)
    assert np.isnan(chain.entries(np.array([n - 1]), np.array([0]))).all()


def test_a_shape_with_a_factor_that_varies() -> None:
    """The matrix is zero but for its last part for the shape itself, and on the shape's cells alone."""
    d = Differences(pp.AreaGrid(shape=(4, 5), spacing=(0.5, 0.25)))
    shape = np.zeros((4, 5))
    shape[1:3, 1:4] = np.random.default_rng(0).uniform(0.2, 1.0, (2, 3))
    flat, inside = shape.ravel(), shape.ravel() > 0.0
    rough, both = (q.toarray() for q in d.about(flat, [(1.0, 0.0), (3.0, 0.5)]))
    np.testing.assert_allclose(rough @ flat, 0.0, atol=1e-12)
    assert not rough[~inside].any()
    assert not rough[:, ~inside].any()
    factor = np.zeros((4, 5))
    factor[1:3, 1:4] = np.random.default_rng(1).standard_normal((2, 3))
    t, part = (factor * shape).ravel(), factor[1:3, 1:4]
    steps = float(sum((np.diff(part, axis=axis) ** 2).sum() for axis in (0, 1)))
    assert t @ rough @ t == pytest.approx(steps)
    assert t @ both @ t == pytest.approx(3.0 * steps + 0.5 * float((part**2).sum()))


@pytest.mark.parametrize("friction", [None, 0.4])
def test_the_log_determinant_of_the_readings(friction: float | None) -> None:
    formed, unformed, penalty, linear, _, cells = problem(3, (14, 9))
    found, without_data = [], cast(Any, None)
    for hessian in (unformed, formed):
        solution = minimise(hessian, linear, Cone(("x", "y", "z"), friction), keep_face=True)
        found.append(log_determinant(ContactModel(without_data, hessian, penalty, solution)))
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    if not isinstance(solution.factor, Dense) or solution.face is None:
        raise AssertionError("a formed matrix has a dense factor")
    whole, seen = solution.factor.lower @ solution.factor.lower.T, solution.face.columns(unformed.columns.T)
    expected = np.linalg.slogdet(whole)[1] - np.linalg.slogdet(whole - seen.T @ seen)[1]
    assert found[0] == pytest.approx(float(expected), rel=1e-6)
    if friction is not None:
        return
    free = np.flatnonzero(np.concatenate([np.ones(2 * len(cells), dtype=bool), solution.traction[-1] > 0.0]))
    columns, prior = unformed.columns[free], penalty.dense()[np.ix_(free, free)]
    covariance = np.eye(columns.shape[1]) + columns.T @ np.linalg.solve(prior, columns)
    assert found[0] == pytest.approx(float(np.linalg.slogdet(covariance)[1]), rel=1e-6)


@pytest.mark.parametrize("friction", [None, 0.4])
@pytest.mark.parametrize(("shape", "order"), [((14, 9), 1), ((9, 15), 2), ((140,), 2)])
def test_it_leads_to_the_same_optimum(friction: float | None, shape: tuple[int, ...], order: int) -> None:
    components = ("x", "y", "z") if len(shape) == 2 else ("x", "z")
    formed, unformed, penalty, linear, d, cells = problem(len(components), shape, order=order)
    cone = Cone(components, friction)
    expected = minimise(formed, linear, cone, keep_face=True)
    found = minimise(unformed, linear, cone, keep_face=True)
    assert expected.converged
    assert found.converged
    assert 0 < np.count_nonzero(found.traction[-1]) < len(cells), "the constraint should bind somewhere"
    np.testing.assert_allclose(found.traction, expected.traction, atol=1e-7 * np.abs(expected.traction).max())
    if found.face is None or found.factor is None or expected.factor is None:
        raise AssertionError("the face was asked for")
    # variances of differences, and of sums over all cells
    rows = d.touching(cells)[1].each(len(components), len(cells))
    variances = [f.variances(found.face.rows(rows)) for f in (found.factor, expected.factor)]
    np.testing.assert_allclose(variances[0], variances[1], rtol=1e-6, atol=1e-9 * variances[1].max())
    sums = found.face.columns(np.random.default_rng(3).standard_normal((4, linear.size))).T
    if not isinstance(found.factor, FewReadings) or not isinstance(expected.factor, Dense):
        raise AssertionError("each kind of matrix has a factor of its own")
    z = [f.half(sums) for f in (found.factor, expected.factor)]
    np.testing.assert_allclose(z[0].T @ z[0], z[1].T @ z[1], rtol=1e-6, atol=1e-9 * (z[1] ** 2).sum())
    back = [f.inverse(sums) for f in (found.factor, expected.factor)]
    np.testing.assert_allclose(back[0], back[1], rtol=1e-5, atol=1e-8)
    gram = unformed.scaled(found.face.scales).columns
    taken = expected.factor.trace(found.face.restrict(gram @ gram.T))
    assert found.factor.taken().sum() == pytest.approx(taken, rel=1e-7)
    prior = sums.T @ prior_factor(penalty, found.face).inverse(sums)
    reduced = found.face.restrict(penalty.scaled(found.face.scales).added(np.zeros((linear.size,) * 2)))
    np.testing.assert_allclose(prior, sums.T @ np.linalg.solve(reduced, sums), rtol=1e-7, atol=1e-9)


def test_a_few_more_unknowns_border_a_factor() -> None:
    rng = np.random.default_rng(5)
    full = rng.standard_normal((12, 12))
    full = full @ full.T + 12 * np.eye(12)
    inner: Factor = Dense(cholesky(full[:10, :10].copy()))
    factor = Bordered.of(inner, full[:10, 10:], full[10:, 10:])
    rows = rng.standard_normal((4, 12))
    found = rows @ factor.inverse(rows.T)
    expected = rows @ np.linalg.solve(full, rows.T)
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    np.testing.assert_allclose(factor.inverse(rows.T), np.linalg.solve(full, rows.T), rtol=1e-10)
    np.testing.assert_allclose(factor.solve(rows[0]), np.linalg.solve(full, rows[0]), rtol=1e-10)
    i, j = np.nonzero(np.ones((4, 10)))
    sparse = Rows(i, j, rows[:, :10].ravel(), 4, rows[:, 10:])
    np.testing.assert_allclose(factor.variances(sparse), np.diag(expected), rtol=1e-10)


def test_tension_without_shear_projects_to_nothing() -> None:
    cone = Cone(("x", "y", "z"), 0.5)
    x = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 4.0], [-1.0, 2.0, 0.0]])
    np.testing.assert_allclose(cone.project(x), [[0.0, 0.0, 1.5], [0.0, 0.0, 2.0], [0.0, 2.0, 2.5]])


def test_rows_on_a_face() -> None:
    """Rows, sparse or full, are the same on every kind of face."""
    rng = np.random.default_rng(6)
    cone = Cone(("x", "y", "z"), 0.5)
    v = rng.standard_normal((3, 15))
    face = Face(*cone.directions(v), cone.coupled)
    face.scales = cone.scales
    assert face.oblique.any()
    assert not face.free.all()
    full = rng.standard_normal((6, 45)) * (rng.random((6, 45)) < 0.2)
    i, j = np.nonzero(full)
    rows = Rows(i, j, full[i, j], 6)
    for one in (face, Ray(np.array([0.3, 0.1, 1.0]), rng.random(15) < 0.7, rng.standard_normal((1, 45)))):
        expected = one.columns(full)
        np.testing.assert_allclose(one.rows(rows).times(np.eye(expected.shape[1])), expected, atol=1e-12)


@pytest.mark.long
def test_few_readings_are_not_formed() -> None:
    """Neither are many where cells are fewer."""
    formed, unformed, penalty, *_ = problem(shape=(30, 30))
    assert isinstance(
        formed_or_not(lambda: unformed.columns, unformed.columns.shape[1], lambda: formed.matrix, penalty), Unformed
    )
    wide = np.zeros((len(unformed.columns), 2 * len(unformed.columns)))
    assert isinstance(formed_or_not(lambda: wide, wide.shape[1], lambda: formed.matrix, penalty), Formed)
    np.testing.assert_allclose(unformed.dense(), formed.dense(), atol=1e-9)


def test_readings_of_half_as_many_as_unknowns_are_not_formed() -> None:
    """The inverse of a matrix costs more than its factor: 1200 readings of 2200 unknowns took 1.5 times as long."""
    formed, unformed, penalty, linear, d, cells = problem(readings=150)
    size = penalty.values.shape[0] * len(cells)
    assert 150 < size < 350

    def chosen(readings: int) -> object:
        columns = unformed.columns[:, :readings]
        return formed_or_not(lambda: columns, readings, lambda: columns @ columns.T, penalty)

    assert isinstance(chosen(150), Unformed)
    assert isinstance(chosen(20), Unformed)

    cone = Cone(("x", "y", "z"))
    one, other = (minimise(h, linear, cone, keep_face=True) for h in (formed, unformed))
    np.testing.assert_allclose(other.traction, one.traction, atol=1e-9 * np.abs(one.traction).max())
    rows = d.touching(cells)[1].each(3, len(cells))
    variances = []
    for found in (one, other):
        assert found.face is not None
        assert found.factor is not None
        variances.append(found.factor.variances(found.face.rows(rows)))
    np.testing.assert_allclose(variances[1], variances[0], rtol=1e-7, atol=1e-9 * variances[0].max())


def test_each_component_has_its_own_scale() -> None:
    formed, _, _, _, _, cells = problem()
    scales = np.array([1.0, 3.0, 0.5])
    rows = np.repeat(scales, len(cells))
    before = formed.matrix.copy()
    np.testing.assert_allclose(formed.scaled(scales).matrix, rows[:, None] * formed.matrix * rows, rtol=1e-15)
    np.testing.assert_array_equal(formed.matrix, before)


@pytest.mark.parametrize("components", [(1, 1), (2, 3), (3, 3)])
def test_a_symbol_multiplies_every_vector(components: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    symbol, waves = (
        rng.standard_normal((n, components[1], 4, 5)) + 1j * rng.standard_normal((n, components[1], 4, 5))
        for n in (components[0], 7)
    )
    np.testing.assert_allclose(times(symbol, waves), np.einsum("tfij,nfij->ntij", symbol, waves), rtol=1e-12)


def test_a_tensile_cell_without_shear_is_projected_on_nothing() -> None:
    """0/0 was a warning, and a frame in a thousand a traceback."""
    cone = Cone(("x", "y", "z"), 0.5)
    np.testing.assert_array_equal(
        cone.project(np.array([[0.0, 3.0], [0.0, 0.0], [-1.0, 4.0]])), [[0, 3], [0, 0], [0, 4]]
    )


@pytest.mark.long
def test_another_friction_shares_what_does_not_depend_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The products of the readings are made once; what follows from them is as if they were made anew."""
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    array = pp.AreaArray(shape=(20, 18), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_zz"])
    surface = pp.AreaGrid(shape=(10, 8), spacing=2e-3)
    made = []
    real = DataSpectrum._symmetric_rows

    def rows(self: DataSpectrum) -> object:
        made.append(len(self.eigenvalues) if hasattr(self, "eigenvalues") else 0)
        return real(self)

    monkeypatch.setattr(DataSpectrum, "_symmetric_rows", rows)
    skin, fresh = (pp.Skin(pad, array, surface=surface) for _ in range(2))
    spectra = []
    for one, strengths in ((skin, (0.2, 1.0)), (skin, (0.05, 1.0)), (fresh, (0.05, 1.0))):
        problem = one.problem(components=["x", "z"])
        spectra.append(problem.decomposition([DifferencePrior(one.surface, 1, s) for s in strengths]).spectrum)
    skin.problem(components=["x", "z"]).decomposition([DifferencePrior(skin.surface, 1, s) for s in (0.3, 2.0)])
    assert made.count(0) == 2, "once for each skin"
    np.testing.assert_allclose(spectra[1].eigenvalues, spectra[2].eigenvalues, rtol=1e-8, atol=1e-12)
    assert np.abs(spectra[0].eigenvalues - spectra[1].eigenvalues).max() > 1e-3 * spectra[0].eigenvalues.max()


def test_shear_that_nothing_holds_is_eliminated_once() -> None:
    """The second factor of a matrix on which pressure alone is held keeps what the first left of shear; it is the whole matrix's own factor."""
    formed, _, _, linear, _, _ = problem()
    c, n = linear.shape
    cone = Cone(("x", "y", "z"))
    rng = np.random.default_rng(5)
    for _ in range(3):
        face = Face(*cone.directions(rng.standard_normal((c, n))), False)
        factor = formed.factor(face, np.zeros(len(face.index)))
        expected = np.linalg.cholesky(formed.matrix[np.ix_(face.index, face.index)])
        np.testing.assert_allclose(factor.lower, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_small_operator_kept_as_a_matrix_is_the_operator_and_its_adjoint() -> None:
    array = pp.AreaArray(shape=(3, 4), pitch=2e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.4), array)
    estimator = AdaptiveEstimator(skin.problem(), Cone(("x", "y", "z")))
    small = estimator._responses
    large = Responses(small.operator, small.columns, small.readings)
    large.__dict__["_matrix"] = None
    rng = np.random.default_rng(2)
    traction = rng.standard_normal((3, math.prod(small.operator.surface.shape)))
    data = rng.standard_normal(36)
    np.testing.assert_allclose(small.of(traction), large.of(traction), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(small.back(data), large.back(data), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("friction", [None, pytest.param(0.5, marks=pytest.mark.long)])
def test_what_nuisances_tell_is_the_same_by_products_and_from_a_matrix(friction: float | None) -> None:
    array = pp.AreaArray(shape=(14, 14), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    clean = skin.sense(pp.solutions.hertz_point(contact_radius=6e-3, force=2.0).sliding(0.3))
    estimator = AdaptiveEstimator(skin.problem(), Cone(("x", "y", "z"), friction))
    readings = estimator.readings.flat([clean])
    noise = np.full(len(readings), 0.01 * float(np.abs(readings).max()))
    level, seen = estimator.level(1), np.ones(len(readings), dtype=bool)
    cells = np.arange(600)  # as many as need products, and no more than fit a matrix
    data = level.normal(cells, readings / noise, noise, seen, products=True, once=True)
    assert data.at_size
    start = np.zeros((3, len(cells)))
    model = estimator.model(data, estimator.precisions(level, 1, 1e-6), start, keep_face=True)
    assert with_matrix(model, 9) is model  # products take less time for so few
    exact = with_matrix(model, 100)
    assert exact is not model
    rows = np.random.default_rng(0).standard_normal((len(readings), 4))
    told = told_of(exact, rows)
    np.testing.assert_allclose(told_of(model, rows), told, rtol=0, atol=1e-3 * np.abs(told).max())
