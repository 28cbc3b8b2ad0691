"""Linear methods at sizes that no dense decomposition serves: the same answers, by products alone."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.linear.matrix_free import path
from palpate.inverse.linear.matrix_free.freedom import Freedom
from palpate.inverse.linear.matrix_free.iteration import solve
from palpate.inverse.linear.matrix_free.lattice import Cosines, Padded
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.matrix_free.spaces import OnArray
from palpate.inverse.linear.parameter import tikhonov, truncate
from palpate.inverse.linear.priors import DifferencePrior, hilgers_prior
from palpate.inverse.linear.regularised import decompose

STRESS = ["stress_xz", "stress_yz", "stress_zz"]
SHIFT = ["displacement_x", "displacement_y"]
HALF_SPACE = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
LAYER = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])


def area(shape=(9, 10), depth=1e-3, channels=STRESS, pitch=1e-3, **options):
    return pp.AreaArray(shape=shape, pitch=pitch, depth=depth, channels=channels, **options)


def pressed(skin, components=None):
    """A smooth traction off the middle, in the components sought."""
    grid = skin.surface
    places = np.meshgrid(*grid.axes, indexing="ij")
    width = np.ptp(grid.axes[0])
    bump = np.exp(-sum((p - 0.1 * width) ** 2 for p in places) / (0.15 * width) ** 2)
    sizes = {"x": 300.0, "y": -200.0, "z": 1000.0}
    sought = skin.components if components is None else components
    return np.stack([(sizes[c] if c in sought else 0.0) * bump for c in grid.components])


def measured(array, noise=10.0):
    """The same array with its noise."""
    return type(array)(**{**{f: getattr(array, f) for f in array.__dataclass_fields__}, "noise": noise})


def noisy(skin, traction, part=0.02, frames=()):
    rng = np.random.default_rng(0)
    readings = skin.sense(traction)
    planes = readings if isinstance(readings, list) else [readings]
    out = [
        p
        + part
        * np.nanmax(np.abs(p), axis=tuple(range(1, p.ndim)), keepdims=True)
        * rng.standard_normal((*frames, *p.shape))
        for p in planes
    ]
    return out if isinstance(readings, list) else out[0]


@pytest.fixture
def either(monkeypatch):
    """Reconstruct densely and matrix-free."""

    def run(pad, array, readings, skin_options=None, **options):
        found = []
        for most in (10**9, 0):
            monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", most)
            skin = pp.Skin(pad, array, **(skin_options or {}))
            found.append(skin.reconstruct(readings, method="tikhonov", **options))
        return found

    return run


def same_traction(dense, free, part):
    a, b = np.asarray(dense.traction), np.asarray(free.traction)
    assert np.abs(a - b).max() < part * np.abs(a).max()


GAPS = np.ones((9, 10), dtype=bool)
GAPS[2:4, 3:7] = False
GAPS[7, 8] = False

LAYOUTS = {
    "three stresses": (HALF_SPACE, area(), {}),
    "displacements, first derivative": (HALF_SPACE, area(depth=0.0, channels=SHIFT), {}),
    "displacements, second derivative": (HALF_SPACE, area(depth=0.0, channels=SHIFT), {"order": 2}),
    "one stress, no derivative": (HALF_SPACE, area(channels=["stress_zz"]), {"order": 0}),
    "some components": (HALF_SPACE, area(channels=["strain_xx", "strain_yy", "stress_zz"]), {"components": ["z"]}),
    "missing taxels": (HALF_SPACE, area(mask=GAPS), {}),
    "taxels wider than cells": (HALF_SPACE, area(pitch=2e-3, depth=0.8e-3, aperture=1e-3), {}),
    "correlated noise": (HALF_SPACE, area(noise=10.0, noise_correlation=1e-3), {}),
    "two planes": (HALF_SPACE, [area(), area(shape=(7, 8), depth=2e-3, channels=["stress_zz"])], {}),
    "a layer": (LAYER, area(shape=(6, 7), depth=2e-3), {}),
    "a line": (HALF_SPACE, pp.LineArray(count=120, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]), {}),
    "a line of displacements": (
        HALF_SPACE,
        pp.LineArray(count=120, pitch=1e-3, depth=1e-3, channels=["displacement_x", "displacement_z"]),
        {},
    ),
}

WITH_ERRORS = {"displacements, second derivative", "a layer", "a line of displacements"}


LONG = {
    "taxels wider than cells",
    "three stresses",
    "displacements, second derivative",
    "displacements, first derivative",
    "some components",
    "two planes",
    "a line",
}


@pytest.mark.parametrize("layout", [pytest.param(k, marks=pytest.mark.long) if k in LONG else k for k in LAYOUTS])
def test_same_traction_for_the_same_parameter(layout, either):
    pad, array, options = LAYOUTS[layout]
    if layout not in WITH_ERRORS:  # where noise is known, nothing but the traction is worked out
        array = [measured(a) for a in array] if isinstance(array, list) else measured(array)
    skin = pp.Skin(pad, array)
    readings = noisy(skin, pressed(skin, options.get("components")))
    columns = [skin.surface.components.index(c) for c in options.get("components", skin.components)]
    priors = [DifferencePrior(skin.surface, options.get("order", 1))] * len(columns)
    parameter = 1e-3 * float(decompose(skin.operator, priors, columns).spectrum.eigenvalues.max())
    dense, free = either(pad, array, readings, {"nuisance": []}, parameter=parameter, **options)
    same_traction(dense, free, 1e-6)
    left = [touch.residual * np.asarray(touch.noise_std) for touch in (free, dense)]  # in the unit of each channel
    np.testing.assert_allclose(*left, rtol=1e-6)
    assert free.status == pp.Status.SOLVED
    if layout not in WITH_ERRORS:
        return
    np.testing.assert_allclose(free._errors.posterior.force, dense._errors.posterior.force, rtol=0.05)
    np.testing.assert_allclose(free._errors.posterior.moment, dense._errors.posterior.moment, rtol=0.05)
    np.testing.assert_allclose(free._errors.posterior.peak, dense._errors.posterior.peak, rtol=0.05)
    np.testing.assert_allclose(free._errors.posterior.center, dense._errors.posterior.center, rtol=0.05)
    np.testing.assert_allclose(free._errors.posterior.outside_force, dense._errors.posterior.outside_force, rtol=1e-5)


@pytest.mark.parametrize(
    ("layout", "rule", "near"),
    [
        ("three stresses", "evidence", 0.06),
        ("displacements, first derivative", "evidence", 0.06),
        pytest.param("missing taxels", "evidence", 0.06, marks=pytest.mark.long),
        ("a line", "evidence", 0.06),
        pytest.param("three stresses", "gcv", 0.12, marks=pytest.mark.long),
        ("displacements, first derivative", "gcv", 0.12),
        pytest.param("three stresses", "discrepancy", 0.03, marks=pytest.mark.long),
        ("missing taxels", "discrepancy", 0.03),
    ],
)
def test_same_parameter(layout, rule, near, either):
    pad, array, options = LAYOUTS[layout]
    if layout.startswith("displacements"):
        array = area(shape=(14, 12), depth=0.0, channels=SHIFT)
    skin = pp.Skin(pad, array)
    readings = noisy(skin, pressed(skin), 0.05, frames=(2,))
    if rule == "discrepancy":
        largest = np.nanmax(np.abs(skin.sense(pressed(skin))), axis=(1, 2))
        array = measured(array, tuple(0.05 * largest))
    dense, free = either(pad, array, readings, {"nuisance": []}, rule=rule, **options)
    np.testing.assert_allclose(np.log(free.parameter), np.log(dense.parameter), atol=near)
    np.testing.assert_allclose(free.noise_std, dense.noise_std, rtol=0.02)
    np.testing.assert_allclose(free.force, dense.force, rtol=0.02, atol=1e-3 * np.abs(dense.force).max())
    np.testing.assert_allclose(free._errors.posterior.force, dense._errors.posterior.force, rtol=0.05)


@pytest.mark.long
def test_a_shift_of_the_image_is_taken_out_alike(either):
    array = area(shape=(16, 16), depth=0.0, channels=SHIFT)
    skin = pp.Skin(HALF_SPACE, array)
    traction = pressed(skin)
    readings = noisy(skin, traction) + np.array([3e-5, -2e-5])[:, None, None]
    dense, free = either(HALF_SPACE, array, readings)
    np.testing.assert_allclose(np.log(free.parameter), np.log(dense.parameter), atol=0.06)
    same_traction(dense, free, 0.02)
    np.testing.assert_allclose(free._errors.posterior.force[:2], dense._errors.posterior.force[:2], rtol=0.05)
    assert [n.split(":")[0] for n in free.notes] == [n.split(":")[0] for n in dense.notes]


@pytest.mark.long
def test_a_named_offset_is_taken_out_alike(either):
    array = area(shape=(10, 10), noise=20.0)
    skin = pp.Skin(HALF_SPACE, array)
    readings = noisy(skin, pressed(skin)) + np.array([0.0, 0.0, 2000.0])[:, None, None]
    dense, free = either(HALF_SPACE, array, readings, {"nuisance": ["offset"]})
    same_traction(dense, free, 0.02)
    said = [[n for n in t.notes if n.startswith("offset of stress_zz")] for t in (dense, free)]
    sizes = [float(n[0].split(":")[1].split("+-")[0]) for n in said]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.02)


@pytest.mark.parametrize("layout", ["three stresses", pytest.param("missing taxels", marks=pytest.mark.long)])
def test_standard_deviations_of_cells(layout, either):
    pad, array, _ = LAYOUTS[layout]
    skin = pp.Skin(pad, array)
    dense, free = either(pad, array, noisy(skin, pressed(skin)))
    ratio = free._errors.posterior.traction / dense._errors.posterior.traction
    assert abs(float(ratio.mean()) - 1.0) < 0.03
    assert float(ratio.std()) < 0.15  # 32 draws know a standard deviation to 13 %, with mirror images to 6 %
    again = np.array(free._errors.posterior.traction)
    np.testing.assert_array_equal(again, either(pad, array, noisy(skin, pressed(skin)))[1]._errors.posterior.traction)


@pytest.mark.long
def test_frames_of_a_batch_are_those_alone(monkeypatch):
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 0)
    skin = pp.Skin(HALF_SPACE, area())
    readings = noisy(skin, pressed(skin) * np.array([0.1, 1.0, 3.0])[:, None, None, None])
    readings = np.stack([*readings, np.zeros_like(readings[0])])
    batch = skin.reconstruct(readings, method="tikhonov")
    assert list(batch.status) == [pp.Status.SOLVED] * 4
    for i in (0, 2):
        alone = pp.Skin(HALF_SPACE, area()).reconstruct(readings[i], method="tikhonov")
        np.testing.assert_allclose(batch.traction[i], alone.traction, atol=1e-6 * float(np.abs(alone.traction).max()))
        np.testing.assert_allclose(batch._errors.posterior.force[i], alone._errors.posterior.force, rtol=1e-3)
        np.testing.assert_allclose(batch[i]._errors.posterior.traction, alone._errors.posterior.traction, rtol=1e-4)
    assert not np.asarray(batch.traction[3]).any()
    single = skin.reconstruct(readings[1].astype(np.float32), method="tikhonov")
    assert single.traction.dtype == np.float32
    np.testing.assert_allclose(single.traction, batch.traction[1], atol=1e-3 * float(np.abs(batch.traction[1]).max()))


@pytest.mark.long
def test_an_iteration_that_does_not_converge_says_so(monkeypatch):
    from palpate.inverse.linear.matrix_free import solver

    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 0)
    monkeypatch.setattr(solver, "MAX_STEPS", 3)
    skin = pp.Skin(HALF_SPACE, area())
    readings = noisy(skin, pressed(skin), frames=(2,))
    touch = skin.reconstruct(readings, method="tikhonov", parameter=1e-6)
    assert list(touch.status) == [pp.Status.NOT_CONVERGED] * 2
    assert any("did not reach its tolerance in 2 of 2 frames" in note for note in touch.notes)


def test_iteration_solves_each_frame_for_its_own_parameter():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((30, 30))
    matrix = root @ root.T
    right, parameter = rng.standard_normal((3, 30)), np.array([1e-3, 1.0, 100.0])
    right[1] = 0.0
    found = solve(lambda u: u @ matrix, lambda r, _: r / np.diag(matrix), right, parameter, tolerance=1e-10, most=200)
    for i in range(3):
        np.testing.assert_allclose(
            found.rows[i], np.linalg.solve(matrix + parameter[i] * np.eye(30), right[i]), rtol=1e-6, atol=1e-12
        )
    assert (found.residual <= 1e-10).all()
    short = solve(lambda u: u @ matrix, lambda r, _: r, right, parameter, tolerance=1e-12, most=2)
    assert (short.residual > 1e-12).any()  # what is not solved is said


@pytest.mark.parametrize("layout", ["three stresses", "missing taxels", "two planes", "correlated noise", "a line"])
@pytest.mark.parametrize("kind", [Cosines, Padded])
def test_approximations_are_positive_definite_and_count_the_readings(layout, kind):
    pad, array, _ = LAYOUTS[layout]
    operator = pp.Skin(pad, array).operator
    columns = range(len(operator.surface.components))
    scales = [np.full(len(a.channels), 2.0) for a in operator.planes_of]
    normal = Normal(operator, [DifferencePrior(operator.surface, 1)] * len(columns), columns, scales)
    approximate = kind(normal)
    assert approximate.counts.sum() == pytest.approx(normal.count)
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((2, normal.total))
    if normal.valid is not None:
        rows *= normal.valid
    np.testing.assert_allclose(approximate.powers(rows).sum(axis=1), (rows**2).sum(axis=1))
    inverse = approximate.at(np.full(2, 1e-3 * approximate.eigenvalues.max()))
    out = inverse(rows, np.arange(2))
    assert rows[0] @ out[1] == pytest.approx(rows[1] @ out[0], rel=1e-9, abs=1e-9 * np.abs(out).max())
    assert (np.einsum("fn,fn->f", rows, out) > 0).all()
    assert rows[0] @ normal.apply(rows)[1] == pytest.approx(rows[1] @ normal.apply(rows)[0])


def prepared_space(layout):
    pad, array, _ = LAYOUTS[layout]
    operator = pp.Skin(pad, array).operator
    columns = range(len(operator.surface.components))
    scales = [np.full(len(a.channels), 2.0) for a in ([array] if not isinstance(array, list) else array)]
    normal = Normal(operator, [DifferencePrior(operator.surface, 1)] * len(columns), columns, scales)
    return normal, OnArray(normal)


@pytest.mark.parametrize("layout", ["three stresses", "missing taxels", "a line"])
def test_longest_waves_are_solved_once_and_stay_solved(layout):
    normal, space = prepared_space(layout)
    parameter = np.array([1e-3, 1e-2]) * space.largest
    inverse, frames = space._balanced.at(parameter), np.arange(2)
    rows = np.random.default_rng(0).standard_normal((2, normal.total))
    rows = rows if normal.valid is None else rows * normal.valid
    whole = inverse(rows, frames)
    assert rows[0] @ inverse(rows[::-1], frames)[0] == pytest.approx(rows[1] @ inverse(rows, frames)[0], rel=1e-6)
    solution, left = inverse.begin(rows, frames)
    longest = space._balanced.longest
    size = np.linalg.norm(rows)
    assert np.abs(longest.of(left)).max() < 1e-5 * size
    exact = rows - normal.apply(solution) - parameter[:, None] * solution
    np.testing.assert_allclose(left, exact, atol=1e-5 * size)
    np.testing.assert_allclose(solution + inverse.within(left, frames), whole, atol=1e-4 * np.abs(whole).max())


@pytest.mark.parametrize("layout", ["three stresses", "displacements, first derivative"])
def test_what_a_solution_is_off_by_is_taken_out_of_its_forms(layout):
    normal, space = prepared_space(layout)
    parameter = np.array([1e-3 * space.largest])
    rng = np.random.default_rng(0)
    rows = normal.apply(rng.standard_normal((1, normal.total))) + 1e-2 * rng.standard_normal((1, normal.total))
    exact = space.solve(rows, parameter, tolerance=1e-12, most=500, start=None, checked=True)
    off = 1.0 + 1e-2 * rng.standard_normal(exact.rows.shape) + 0.02
    near = exact.rows * off
    rest = rows - normal.apply(near) - parameter[:, None] * near
    plain, found, true = (
        np.concatenate(space.forms(rows, parameter, exact._replace(rows=u, rest=r)))
        for u, r in ((near, None), (near, rest), (exact.rows, None))
    )
    # first order: 2 % of the first form, 4 % of the second
    assert (np.abs(plain / true - 1) > 0.015).all()
    assert (np.abs(found / true - 1) < 0.15 * np.abs(plain / true - 1)).all()


@pytest.mark.long
def test_degrees_of_freedom_are_those_of_the_spectrum():
    skin = pp.Skin(HALF_SPACE, area(shape=(16, 16)))
    operator, columns = skin.operator, (0, 1, 2)
    priors = [hilgers_prior(operator.surface, 1e-3)] * 3
    dense = decompose(operator, priors, columns)
    normal = Normal(operator, priors, columns, dense.scales)
    freedom = Freedom(normal, OnArray(normal))
    values = dense.spectrum.eigenvalues
    assert freedom.top == pytest.approx(values.max(), rel=0.1)
    for part in (1e-2, 1e-4):
        parameter = np.array([part * values.max()])
        expected = (values / (values + parameter)).sum()
        assert float(freedom.of(parameter)[0]) == pytest.approx(expected, rel=0.03)


def test_sizes_that_no_dense_decomposition_serves_take_the_other_way():
    small = pp.Skin(HALF_SPACE, area(shape=(16, 16))).problem()
    large = pp.Skin(HALF_SPACE, area(shape=(96, 96))).problem()
    priors = [DifferencePrior(large.surface, 1)] * 3
    assert not path.matrix_free(small, tikhonov, priors)
    assert path.matrix_free(large, tikhonov, priors)
    assert not path.matrix_free(large, truncate, priors)


@pytest.mark.long
def test_a_ball_on_a_large_array():
    array = area(shape=(128, 128), depth=2e-3, noise=20.0)
    skin = pp.Skin(HALF_SPACE, array)
    assert isinstance(pp.Tikhonov().prepare(skin.problem()), MatrixFree)
    ball = pp.solutions.hertz_point(contact_radius=25e-3, force=15.0).sliding(0.3)
    readings = skin.sense(ball, rng=np.random.default_rng(0))
    touch = skin.reconstruct(readings, method="tikhonov")
    low, high = touch.interval(0.95, of="force")
    np.testing.assert_allclose(touch.force, [4.5, 0.0, 15.0], atol=0.1)
    assert (low < [4.5, 0.0, 15.0]).all()
    assert (high > [4.5, 0.0, 15.0]).all()
    truth = skin.sample(ball)
    assert np.sqrt(((touch.traction - truth) ** 2).sum() / (truth**2).sum()) < 0.15
