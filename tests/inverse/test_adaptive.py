"""The automatic method, its constraints and its error bars, and the methods to compare with."""

from __future__ import annotations

import csv
import functools
import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import clarabel
import numpy as np
import pytest

import palpate as pp
from command_line import run
from long_runs import long_runs
from palpate import bench, solutions
from palpate.inverse import Cone, minimise
from palpate.sensing.uncertainty import EXACT
from palpate.uncertainty import Case

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
BALL = solutions.hertz_point(contact_radius=2.5e-3, force=1.0)
#: Wide enough for readings to tell how its shear is spread.
WIDE_BALL = solutions.hertz_point(contact_radius=4e-3, force=1.0)


def area(
    channels: tuple[str, ...] = ("stress_zz",), shape: tuple[int, int] = (14, 14), noise: float | None = None
) -> pp.AreaArray:
    return pp.AreaArray(shape=shape, pitch=1e-3, depth=1.5e-3, channels=list(channels), noise=noise)


THREE = ("stress_xz", "stress_yz", "stress_zz")


@functools.cache
def skin_of(
    channels: tuple[str, ...] = ("stress_zz",), shape: tuple[int, int] | None = None, noise: float | None = None
) -> pp.Skin:
    """One skin per layout for all tests: what it prepares is prepared once. Frames with shear take ten times as long as pressure alone."""
    return pp.Skin(PAD, area(channels, shape or ((10, 10) if channels == THREE else (14, 14)), noise))


# -- the optimiser against a general conic solver ------------------------------------------------------------------------


def conic(matrix: Any, weight: Any, data: Any, components: int, friction: float | None) -> Any:
    """minimise 1/2 |A x - y|^2 + 1/2 x' W x by Clarabel; x is component-major, pressure last."""
    import scipy.sparse as sparse

    n = len(weight) // components
    order = np.array(
        [[(components - 1) * n + i, *(d * n + i for d in range(components - 1))] for i in range(n)]
    ).ravel()
    hessian = (matrix.T @ matrix + weight)[np.ix_(order, order)]
    linear = -(matrix.T @ data)[order]
    size = np.abs(linear).max()
    hessian, linear = hessian / size, linear / size
    if friction is None:
        rows = -sparse.csc_matrix(
            (np.ones(n), (np.arange(n), np.arange(0, components * n, components))), (n, components * n)
        )
        cones = [clarabel.NonnegativeConeT(n)]
    else:
        rows = -sparse.diags(np.tile([friction, *[1.0] * (components - 1)], n)).tocsc()
        cones = [clarabel.SecondOrderConeT(components)] * n
    upper = sparse.triu(sparse.csc_matrix(hessian)).tocsc()
    best, lowest = None, np.inf
    for tolerance in (1e-10, 1e-12, 1e-14):  # the tightest may stop early, where rounding lets it go no further
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        solution = clarabel.DefaultSolver(upper, linear, rows, np.zeros(rows.shape[0]), cones, settings).solve()
        x = np.array(solution.x)
        residual = max(solution.r_prim, solution.r_dual, abs(solution.obj_val - solution.obj_val_dual))
        if residual < lowest:
            best, lowest = x, residual
    assert best is not None
    found = np.empty(components * n)
    found[order] = best
    return found.reshape(components, n)


def small_problem(kind: str, rng: np.random.Generator) -> tuple[Any, Any, Any, int, float | None]:
    """Whitened operator, prior precision and readings of a small random problem of a real skin."""
    channels = ("stress_zz",) if kind == "pressure" else THREE
    if kind == "scattered":
        positions = rng.uniform(-3e-3, 3e-3, (40, 2))
        array: Any = pp.ScatteredArray(positions=positions, depth=1.5e-3, channels=list(channels))
    else:
        array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1.5e-3, channels=list(channels))
    if kind == "masked":
        array = array.masked(rng.random((6, 6)) > 0.2)
    surface = pp.AreaGrid(shape=(8, 8), spacing=1e-3)
    operator = pp.Skin(PAD, array, surface=surface).operator
    columns = [2] if kind == "pressure" else [0, 1, 2]
    cells = np.arange(64)
    matrix = operator.columns(columns, cells).reshape(-1, len(columns) * 64)
    truth = np.zeros((len(columns), 64))
    truth[-1, rng.choice(64, 12, replace=False)] = rng.random(12)
    truth[:-1] = 0.4 * truth[-1]
    clean = matrix @ truth.ravel()
    noise = 0.02 * np.abs(clean).max()
    data = clean + noise * rng.standard_normal(len(clean))
    weight = np.diag(rng.uniform(0.5, 2.0, matrix.shape[1]))
    friction = {"pressure": None, "masked": None, "cone": 0.5, "scattered": 0.3}[kind]
    return matrix / noise, weight, data / noise, len(columns), friction


@pytest.mark.parametrize(
    ("kind", "seed"), list(itertools.product(["pressure", "cone", "masked", "scattered"], range(3)))
)
@pytest.mark.long
def test_agrees_with_a_conic_solver(kind: str, seed: int) -> None:
    matrix, weight, data, components, friction = small_problem(kind, np.random.default_rng(seed))
    names = ("z",) if components == 1 else ("x", "y", "z")
    n = len(weight) // components
    found = minimise(matrix.T @ matrix + weight, (matrix.T @ data).reshape(components, n), Cone(names, friction))
    assert found.converged
    true = conic(matrix, weight, data, components, friction)
    assert np.abs(found.traction - true).max() < 1e-6 * np.abs(true).max()
    assert (found.traction[-1] >= 0).all()
    assert 0 < (found.traction[-1] > 0).sum() < n  # the constraint matters


def test_optimality_without_any_solver(rng: np.random.Generator) -> None:
    """Stationary along the cone: the negative gradient lies in the polar cone and is orthogonal to the solution."""
    root = rng.standard_normal((30, 60))
    hessian, linear = root.T @ root + 0.1 * np.eye(60), rng.standard_normal((3, 20))
    cone = Cone(("x", "y", "z"), 0.7)
    x = minimise(hessian, linear, cone).traction
    pull = linear - (hessian @ x.ravel()).reshape(3, 20)
    assert abs((pull * x).sum()) < 1e-8
    # polar of |q| <= mu p: mu |pull_q| + pull_p <= 0
    assert (0.7 * np.hypot(pull[0], pull[1]) + pull[2] < 1e-8).all()
    assert (np.hypot(x[0], x[1]) <= 0.7 * x[2] + 1e-12).all()


# -- physics -------------------------------------------------------------------------------------------------------------


def pressed(skin: pp.Skin, contact: Any, noise: float, seed: int = 0) -> tuple[Any, Any]:
    truth = skin.sample(contact)
    readings = skin.sense(truth)
    rng = np.random.default_rng(seed)
    size = noise * np.nanmax(np.abs(readings))
    return readings + size * rng.standard_normal(readings.shape), truth


@pytest.mark.long
def test_default_never_pulls_and_keeps_friction() -> None:
    skin = skin_of(THREE)
    readings, truth = pressed(skin, BALL.partial_slip(0.5, 0.3), 0.02)
    touch = skin.reconstruct(readings, friction=0.5)
    assert touch.method == "adaptive"
    assert (touch.values[2] >= 0).all()
    assert (np.hypot(*touch.values[:2]) <= 0.5 * touch.values[2] * (1 + 1e-9)).all()
    np.testing.assert_allclose(touch.force, [0.3, 0, 1.0], atol=0.05)
    assert touch.converged
    linear = skin.reconstruct(readings, method="tikhonov")
    assert np.linalg.norm(touch.values - truth) < 0.7 * np.linalg.norm(linear.values - truth)


@pytest.mark.long
def test_no_shear_outside_contact_without_friction_given() -> None:
    skin = skin_of(THREE)
    readings, _ = pressed(skin, BALL.sliding(0.4), 0.02)
    touch = skin.reconstruct(readings)
    import scipy.ndimage

    near = scipy.ndimage.binary_dilation(touch.values[2] > 0, np.ones((3, 3)), iterations=2)
    assert np.abs(touch.values[:2][:, ~near]).max() == 0


@pytest.mark.long
def test_mirror_images_give_mirror_images() -> None:
    skin = skin_of(THREE)
    readings, _ = pressed(skin, BALL.sliding(0.4).shifted(2e-3, 1e-3), 0.02)
    one = skin.reconstruct(readings, friction=0.5).values
    flipped = readings[:, :, ::-1] * np.array([-1.0, 1.0, 1.0])[:, None, None]
    two = skin.reconstruct(flipped, friction=0.5).values
    back = two[:, :, ::-1] * np.array([-1.0, 1.0, 1.0])[:, None, None]
    np.testing.assert_allclose(back, one, atol=2e-5 * np.abs(one).max())


def test_units_do_not_matter() -> None:
    """Stiffer pads and larger loads of stress give the same picture in other units."""
    skin = skin_of()
    readings, _ = pressed(skin, BALL, 0.02)
    one = skin.reconstruct(readings).values
    np.testing.assert_allclose(skin.reconstruct(1e-3 * readings).values * 1e3, one, atol=1e-6 * one.max())


@pytest.mark.long
def test_batches_are_frames() -> None:
    """With the error bars."""
    skin = skin_of()
    frames = np.stack([pressed(skin, BALL.shifted(1e-3 * i, 0), 0.02, seed=i)[0] for i in range(3)])
    batch = skin.reconstruct(frames)
    for i in range(3):
        single = skin.reconstruct(frames[i]).values
        np.testing.assert_allclose(batch.values[i], single, atol=1e-8 * single.max())
        assert batch.frame(i)._errors is not None
        np.testing.assert_array_equal(batch.frame(i).std(), batch.std()[i])


def test_single_precision_is_kept() -> None:
    skin = skin_of()
    readings, _ = pressed(skin, BALL, 0.02)
    touch = skin.reconstruct(readings.astype(np.float32))
    assert touch.values.dtype == np.float32
    np.testing.assert_allclose(touch.values, skin.reconstruct(readings).values, atol=2e-4 * touch.values.max())


@pytest.mark.parametrize("noise", [None, *long_runs(30.0)])
@pytest.mark.long
def test_nothing_touches(noise: float | None) -> None:
    """Pure noise, and no reading at all: no contact is made up, and the force's interval holds zero."""
    skin = skin_of(noise=noise)
    rng = np.random.default_rng(3)
    frames = np.concatenate([np.zeros((1, 1, 14, 14)), 30.0 * rng.standard_normal((39, 1, 14, 14))])
    touch = skin.reconstruct(frames)
    assert touch.touching is not None
    assert (~touch.touching).mean() >= 0.95
    low, high = touch.interval(0.95, "force")
    assert ((low <= 0) & (high >= 0))[:, 2].mean() >= 0.95
    if not touch.touching.all():
        assert any("no contact" in n for n in touch.notes)


@pytest.mark.long
def test_the_force_that_would_go_unnoticed_is_about_the_interval() -> None:
    """A contact a few times heavier than the empty frame's interval allows is found."""
    skin = skin_of(noise=30.0)
    empty = skin.reconstruct(30.0 * np.random.default_rng(0).standard_normal((1, 14, 14)))
    limit = float(empty.interval(0.95, "force")[1][2])
    assert 0 < limit < 0.2
    heavier = solutions.hertz_point(contact_radius=1.5e-3, force=5 * limit)
    readings = skin.sense(heavier, rng=np.random.default_rng(1))
    assert skin.reconstruct(readings).touching


def test_saturated_and_dead_taxels_are_noticed() -> None:
    skin = skin_of()
    readings, truth = pressed(skin, BALL, 0.01)
    clean = np.linalg.norm(skin.reconstruct(readings).values - truth)
    broken = readings.copy()
    peak = np.abs(readings).max()
    broken[0, 2, 2], broken[0, 7, 7], broken[0, 11, 4] = peak, 0.0, -peak
    touch = skin.reconstruct(broken)
    assert touch.outliers is not None
    assert {7 * 14 + 7, 2 * 14 + 2, 11 * 14 + 4} <= set(np.flatnonzero(touch.outliers))
    assert touch.outliers.sum() <= 6
    assert np.linalg.norm(touch.values - truth) < 1.6 * clean
    assert any("taxel (2, 2)" in n for n in touch.notes)


@pytest.mark.long
def test_masked_taxels_cost_little() -> None:
    rng = np.random.default_rng(5)
    errors = []
    for mask in (None, rng.random((14, 14)) > 0.1):
        array = area() if mask is None else area().masked(mask)
        skin = pp.Skin(PAD, array)
        errors.append(
            np.mean([
                np.linalg.norm(skin.reconstruct(r).values - t)
                for r, t in (pressed(skin, BALL, 0.02, seed=s) for s in range(6))
            ])
        )  # fmt: skip
    assert errors[1] < 1.15 * errors[0]


SEEDS = [0, *(pytest.param(i, marks=pytest.mark.long) for i in (1, 2))]


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("noise", [pytest.param(0.005, marks=pytest.mark.long), 0.03])
def test_sliding_is_recognised(noise: float, seed: int) -> None:
    """A contact that slides: shear in one proportion to pressure, at the friction given, or at less where what is given is too high."""
    skin = skin_of(THREE)
    direction = 0.7
    clean = skin.sense(skin.sample(BALL.sliding(0.5, direction=direction)))
    for given in (0.5, 0.6):
        size = noise * float(np.abs(clean).max())
        noisy = clean + size * np.random.default_rng(seed).standard_normal(clean.shape)
        touch = skin.reconstruct(noisy, friction=given)
        shear, pressure = touch.force[:2], touch.force[2]
        assert float(np.hypot(*shear) / pressure) == pytest.approx(0.5, abs=noise)
        assert float(np.arctan2(*shear[::-1])) == pytest.approx(direction, abs=2 * noise)
        low, high = touch.interval(0.99, "force")
        true = np.array([0.5 * np.cos(direction), 0.5 * np.sin(direction), 1.0])
        assert ((low < true) & (true < high)).all(), (given, seed, low, high)
        assert (low < high).all()
        assert float(touch.sliding) > 0.95
        assert "in one proportion to pressure" in touch.summary()


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_sliding_is_not_seen_where_nothing_slides(seed: int) -> None:
    """A firm grip stays one, and neither its shear nor its margin is that of a slide."""
    skin = skin_of(THREE)
    clean = skin.sense(skin.sample(WIDE_BALL.partial_slip(0.6, 0.24)))
    noisy = clean + 0.01 * np.abs(clean).max() * np.random.default_rng(seed).standard_normal(clean.shape)
    touch = skin.reconstruct(noisy, friction=0.6)
    assert float(np.hypot(*touch.force[:2]) / touch.force[2]) == pytest.approx(0.24, abs=0.03)
    assert float(touch.sliding) < 0.05
    # the rim carries more of the shear than of the pressure
    q, p = np.asarray(touch.values)[0], np.asarray(touch.values)[2]
    rim, middle = (p > 0.3 * p.max()) & (p < 0.5 * p.max()), p > 0.9 * p.max()
    assert (q[rim] / p[rim]).mean() > 1.3 * (q[middle] / p[middle]).mean()


@pytest.mark.long
def test_draws_of_a_slide() -> None:
    """Samples slide too, within friction, and their forces spread like the closed form."""
    skin = skin_of(THREE, (14, 14))
    clean = skin.sense(skin.sample(BALL.sliding(0.5, direction=0.7)))
    noisy = clean + 0.02 * np.abs(clean).max() * np.random.default_rng(0).standard_normal(clean.shape)
    for given in (0.5, 0.6):
        touch = skin.reconstruct(noisy, friction=given, draws=60)
        draws = np.asarray(touch.draws)
        size = np.hypot(draws[:, 0], draws[:, 1])
        assert (size <= given * draws[:, 2] + 1e-9 * draws.max()).all()
        forces = draws.sum(axis=(2, 3)) * skin.surface.cell
        turn = np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
        _, across = (forces[:, :2] @ turn.T).std(axis=0)
        assert across == pytest.approx(0.01, rel=0.5)  # Q times the error of the angle
        assert touch._errors is not None
        closed = np.asarray(touch._errors.posterior.force)
        np.testing.assert_allclose(forces[:, :2].std(axis=0), closed[:2], rtol=0.3)


@pytest.mark.long
@pytest.mark.parametrize("contact", ["pressed cone", "sliding block"])
def test_sliding_contact_is_solved_on_a_finer_grid(contact: str) -> None:
    """Pressure alone is seen in more detail than pressure and shear; on the grid of both, these were 1.3 and 0.7."""
    layout = bench.LAYOUTS["bonded displacement"]
    rng = np.random.default_rng(1)
    found = [bench.run(layout, contact, layout.contacts[contact], 1e-2, rng, ["adaptive"])[0].ratio for _ in range(2)]
    assert np.mean(found) < {"pressed cone": 1.0, "sliding block": 0.55}[contact]


@pytest.mark.long
def test_sliding_on_a_line() -> None:
    array = pp.LineArray(count=60, pitch=0.5e-3, depth=1.5e-3, channels=["stress_xz", "stress_zz"])
    skin = pp.Skin(PAD, array)
    clean = skin.sense(skin.sample(solutions.hertz_line(half_width=5e-3, force=500.0).sliding(-0.4)))
    noisy = clean + 0.02 * np.abs(clean).max() * np.random.default_rng(0).standard_normal(clean.shape)
    touch = skin.reconstruct(noisy, friction=0.4)
    assert float(touch.force[0] / touch.force[1]) == pytest.approx(-0.4, abs=0.004)
    draws = np.asarray(skin.reconstruct(noisy, friction=0.4, draws=5).draws)
    assert (np.abs(draws[:, 0]) <= 0.4 * draws[:, 1] + 1e-9 * draws.max()).all()


def test_pulling_is_said_not_hidden() -> None:
    """What pulls as a whole is found as a push of the other sign, with its error bars, and said."""
    skin = skin_of(noise=30.0)
    up = -skin.sample(BALL)
    touch = skin.reconstruct(skin.sense(up, rng=np.random.default_rng(0)))
    assert touch.method == "adaptive"
    assert not touch.pushing
    assert any("pulls as a whole" in n for n in touch.notes)
    np.testing.assert_allclose(touch.force[2], -1.0, atol=0.03)
    low, high = touch.interval(0.95, "force")
    assert low[2] < -1.0 < high[2] < 0.0


@pytest.mark.long
def test_push_and_pull_together_go_to_the_linear_method() -> None:
    """A ball that sticks: pressure in the middle, adhesion round it."""
    skin = skin_of(noise=30.0)
    ring = solutions.hertz_point(contact_radius=4.5e-3, force=1.2)
    both = skin.sample(solutions.hertz_point(contact_radius=2.5e-3, force=1.0)) - skin.sample(ring)
    touch = skin.reconstruct(skin.sense(both, rng=np.random.default_rng(0)))
    assert touch.method == "tikhonov"
    assert not touch.pushing
    np.testing.assert_allclose(touch.force[2], -0.2, atol=0.1)


@pytest.mark.long
def test_periodic_and_shear_only_stay_linear() -> None:
    array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=0.0, channels=["displacement_x", "displacement_y"])
    readings = 1e-6 * np.random.default_rng(0).standard_normal((2, 6, 6))
    assert pp.Skin(PAD, array).reconstruct(readings).method == "tikhonov"
    periodic = pp.Skin(PAD, area(shape=(8, 8)), boundary="periodic")
    assert periodic.reconstruct(np.ones((1, 8, 8))).method == "tikhonov"
    with pytest.raises(pp.Unsupported, match='boundary="free"'):
        periodic.reconstruct(np.ones((1, 8, 8)), method="adaptive")
    with pytest.raises(pp.Unsupported, match="seek component z"):
        pp.Skin(PAD, array).reconstruct(readings, method="adaptive")
    with pytest.raises(pp.Unsupported, match="friction ties"):
        skin_of().reconstruct(np.ones((1, 14, 14)), friction=0.5)


# -- how good, how sure --------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_better_than_the_clairvoyant_filter() -> None:
    records = bench.accuracy(["line"], draws=3, comparisons=False)
    ratios = np.array(list(bench.ratios(records).values()))
    assert len(ratios) == 39
    assert np.exp(np.log(ratios).mean()) < 0.6
    assert ratios.max() < 1.1


def test_clairvoyant_filter_by_simulation() -> None:
    """The closed form against the filter applied to readings, on one contact at random places."""
    layout = bench.LAYOUTS["line"]
    traction = layout.contacts["cylinder"]
    readings, _ = layout.make(traction)
    noise = 0.01 * np.abs(readings).max()
    expected = layout.clairvoyant(traction, noise)
    assert 0.05 < expected < 0.1
    # an oracle Tikhonov filter on the same array is linear and shift-invariant but for its edges
    noisy, truth = readings + noise * np.random.default_rng(0).standard_normal(readings.shape), layout.make(traction)[1]
    best = min(
        np.linalg.norm(layout.skin.reconstruct(noisy, method="tikhonov", parameter=p).values - truth)
        for p in np.geomspace(1e-8, 1e2, 60)
    ) / np.linalg.norm(truth)
    assert expected < 1.15 * best


@pytest.mark.long
def test_paper_at_40_decibels() -> None:
    """Cylinder and punch at 1 % noise: better than any linear filter or plain non-negativity (0.084, 0.45; 0.71, 0.37)."""
    layout = bench.LAYOUTS["line"]
    for name, limit in (("cylinder", 0.085), ("punch", 0.33)):
        records = [
            bench.run(layout, name, layout.contacts[name], 1e-2, np.random.default_rng(s), ("adaptive",))[0].error
            for s in range(10)
        ]
        assert np.mean(records) < limit


@pytest.mark.long
def test_intervals_hold_what_they_say() -> None:
    records = bench.accuracy(["line"], draws=6, seed=1, comparisons=False)
    for level, low, high in ((0.95, 0.9, 1.0), (0.5, 0.4, 0.65)):
        found = bench.coverage(records, level)
        for quantity in ("traction", "force", "peak_pressure"):
            assert low <= found[quantity] <= high, (level, quantity, found[quantity])


@pytest.mark.long
def test_intervals_respect_the_constraints() -> None:
    skin = skin_of(THREE)
    readings, _ = pressed(skin, BALL.sliding(0.4), 0.02)
    touch = skin.reconstruct(readings, friction=0.5)
    low, high = touch.interval(0.95)
    assert low.shape == touch.values.shape
    assert (low[2] >= 0).all()
    assert (high >= low).all()
    for of in ("force", "moment", "center_of_pressure", "peak_pressure"):
        a, b = touch.interval(0.95, of)
        c, d = touch.interval(0.5, of)
        assert (a <= c).all()
        assert (d <= b).all()
    a, b = touch.interval(0.95, "slip_margin", friction=0.5)
    assert a <= touch.slip_margin(0.5) <= b
    with pytest.raises(pp.InvalidInput, match="level"):
        touch.interval(1.5)
    with pytest.raises(pp.InvalidInput, match="of must be"):
        touch.interval(0.5, "mass")
    given = touch.interval(0.95, "slip_margin")  # the friction it was found with
    np.testing.assert_array_equal(given, (a, b))
    with pytest.raises(pp.InvalidInput, match="friction"):
        replace(touch, friction=None).interval(0.5, "slip_margin")
    with pytest.raises(pp.Unsupported, match="no error bars"):
        skin.reconstruct(readings, method="nnls").std()


def test_draws_lie_in_the_cone_and_spread_like_the_closed_form() -> None:
    skin = skin_of()
    readings, _ = pressed(skin, BALL, 0.02)
    touch = skin.reconstruct(readings, draws=60, rng=np.random.default_rng(0))
    assert touch.draws is not None
    assert touch._errors is not None
    assert touch.draws.shape == (60, *touch.values.shape)
    assert (touch.draws[:, 2] >= 0).all()
    force = touch.draws[:, 2].sum(axis=(1, 2)) * skin.surface.cell
    assert 0.4 < force.std() / touch._errors.posterior.force[2] < 2.5
    inside = touch.values[2] > 0.3 * touch.values[2].max()
    ratio = touch.draws[:, 2].std(axis=0)[inside] / touch._errors.posterior.traction[2][inside]
    assert 0.5 < np.median(ratio) < 1.5
    with pytest.raises(pp.InvalidInput, match="draws"):
        skin.reconstruct(readings, draws=-1)


@pytest.mark.long
def test_what_lies_beyond_the_array_is_in_the_error() -> None:
    """Contacts across the edge, of which a quarter or more is guessed: the intervals hold them all the same."""
    held, wide = [], []
    for i in range(60):
        rng = np.random.default_rng((31, i))
        layout, traction, noise = bench.crossing(rng)
        if layout.array.dimensions == 2:
            continue
        readings, truth = layout.make(traction)
        noisy = readings + noise * np.abs(readings).max() * rng.standard_normal(readings.shape)
        touch = layout.skin.reconstruct(noisy, components=["z"])
        low, high = touch.interval(0.95, "force")
        held.append(low[-1] <= truth[-1].sum() * layout.skin.surface.cell <= high[-1])
        wide.append((high[-1] - low[-1]) / touch.force[-1])
    assert len(held) > 20
    assert np.mean(held) > 0.85
    assert np.median(wide) < 1.0


@pytest.mark.long
def test_a_contact_across_the_edge_is_said() -> None:
    skin = skin_of()
    inner = skin.reconstruct(pressed(skin, BALL, 0.01)[0])
    assert np.abs(inner._errors.posterior.outside_force).max() < 1e-3 * inner.force[2]
    assert "outside array" not in inner.summary()
    outer = skin.reconstruct(pressed(skin, BALL.shifted(6.5e-3, 0.0), 0.01)[0])
    assert "outside array" in outer.summary()
    batch = skin.reconstruct(np.stack([pressed(skin, BALL.shifted(x, 0.0), 0.01)[0] for x in (0.0, 6.5e-3)]))
    assert np.allclose(batch._errors.posterior.outside_force[1], outer._errors.posterior.outside_force, rtol=0.2)
    assert batch.frame(0)._errors.posterior.outside_traction.shape == inner.values.shape


@pytest.mark.long
@pytest.mark.parametrize("loud", [(1.0, 1.0, 8.0), (8.0, 8.0, 1.0)])
def test_each_channel_has_its_own_noise(loud: tuple[float, float, float]) -> None:
    """Learned from the readings, it makes nearly as good a use of them as noise that is given; of one frame and of some."""
    # pressure takes up much of a quiet channel of its own
    skin = skin_of(THREE, (14, 14) if loud[0] > loud[2] else None)
    truth = skin.sample(BALL.sliding(0.3))
    clean = skin.sense(truth)
    std = 0.005 * float(np.abs(clean).max()) * np.array(loud)
    frames = clean + std[:, None, None] * np.random.default_rng(3).standard_normal((2, *clean.shape))
    given = pp.Skin(PAD, replace(skin.planes[0], noise=tuple(std)))

    def error(touch: Any) -> float:
        return float(np.linalg.norm(touch.values - truth) / np.linalg.norm(truth))

    learned, best = skin.reconstruct(frames, friction=0.5), given.reconstruct(frames[:1], friction=0.5)
    assert error(learned.frame(0)) < 1.3 * error(best)
    assert learned.noise_std.shape == (2, 3)
    np.testing.assert_allclose(learned.noise_std, np.broadcast_to(std, (2, 3)), rtol=0.25)
    np.testing.assert_allclose(skin.reconstruct(frames[1], friction=0.5).noise_std, learned.noise_std[1], rtol=1e-9)
    rng = np.random.default_rng(0)
    assert not skin.reconstruct(std[:, None, None] * rng.standard_normal((10, *clean.shape))).touching.any()


@pytest.mark.long
def test_a_broken_channel_is_left_out() -> None:
    skin = skin_of(THREE)
    readings, truth = pressed(skin, BALL.sliding(0.3), 0.01)
    whole = skin.reconstruct(readings, friction=0.5)
    readings[1] = 0.0
    readings[2, 5, 5] *= -1.0
    touch = skin.reconstruct(readings, friction=0.5)
    assert touch.outliers.sum() == 10 * 10 + 1
    assert any("left out" in n for n in touch.notes)
    error, before = (float(np.linalg.norm(t.values - truth)) for t in (touch, whole))
    assert error < 2.0 * before


@pytest.mark.long
def test_equal_channels_share_their_noise() -> None:
    skin = skin_of(THREE)
    touch = skin.reconstruct(pressed(skin, BALL.sliding(0.3), 0.02)[0], friction=0.5)
    assert np.ptp(touch.noise_std) == 0


# -- methods for comparison ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["nnls", "elastic_net", "tv", "maxent", "network"])
def test_comparison_methods(method: Any) -> None:
    layout = bench.LAYOUTS["line"]
    record = bench.run(
        layout, "two cylinders", layout.contacts["two cylinders"], 1e-2, np.random.default_rng(0), [method]
    )[0]
    assert record.method == method
    assert record.error < (1.2 if method == "nnls" else 0.3)
    readings, _ = layout.make(layout.contacts["strip"])
    noisy = readings + 0.01 * readings.max() * np.random.default_rng(0).standard_normal(readings.shape)
    touch = layout.skin.reconstruct(noisy, method=method)
    assert (touch.values[1] >= 0).all()
    if method != "nnls":
        assert touch.parameter is not None
        assert touch.noise_std is not None
        noise = float(np.ravel(touch.noise_std)[0])
        misfit = float(np.sqrt(np.mean((layout.skin.sense(touch.values) - noisy) ** 2)))
        assert misfit == pytest.approx(noise, rel=0.08)
    if method == "network":
        assert any("settled in" in n for n in touch.notes)
    assert not layout.skin.reconstruct(np.zeros_like(readings), method=method).values.any()


@pytest.mark.parametrize("components", [["z"], ["x", "y", "z"]])
def test_nnls_is_the_minimum(components: list[str]) -> None:
    """Solved on some columns at a time, it is what the library finds on all of them."""
    import scipy.optimize

    array = pp.AreaArray(shape=(9, 9), pitch=1e-3, depth=2e-3, channels=list(THREE))
    skin = pp.Skin(PAD, array, surface=pp.AreaGrid(shape=(7, 7), spacing=1e-3))
    readings, _ = pressed(skin, BALL.sliding(0.3), 0.01)
    columns = [skin.surface.components.index(c) for c in components]
    matrix = skin.operator.dense().reshape(readings.size, 3, -1)[:, columns].reshape(readings.size, -1)
    signed = np.concatenate([matrix, -matrix[:, : -skin.surface.shape[0] * skin.surface.shape[1]]], axis=1)
    whole, misfit = scipy.optimize.nnls(signed, readings.ravel())
    whole = whole[: matrix.shape[1]] - np.pad(whole[matrix.shape[1] :], (0, 49))
    touch = skin.reconstruct(readings, components=components, method="nnls")
    assert touch.converged
    assert np.linalg.norm(skin.sense(touch.values) - readings) == pytest.approx(misfit, rel=1e-9)
    np.testing.assert_allclose(touch.values[columns].ravel(), whole, atol=1e-6 * np.abs(whole).max())


def test_nnls_of_readings_that_only_pull_is_zero() -> None:
    skin = skin_of(shape=(8, 8))
    for readings in (-skin.sense(BALL), np.abs(skin.sense(BALL))):
        touch = skin.reconstruct(readings, method="nnls")
        assert touch.converged
        assert (touch.values >= 0).all()
        best = np.linalg.norm(skin.sense(touch.values) - readings)
        assert best <= np.linalg.norm(readings) * (1 + 1e-12)


def test_family_says_what_it_cannot_do() -> None:
    skin = skin_of(THREE)
    with pytest.raises(pp.Unsupported, match="pressure alone"):
        skin.reconstruct(np.ones((3, 10, 10)), method="maxent")
    with pytest.raises(pp.Unsupported, match="discrepancy"):
        skin.reconstruct(np.ones((3, 10, 10)), method="tv", parameter="gcv")
    big = pp.Skin(PAD, pp.AreaArray(shape=(70, 70), pitch=1e-3, depth=2e-3, channels=["stress_zz"]))
    with pytest.raises(pp.Unsupported, match="too many"):
        big.reconstruct(np.ones((1, 70, 70)), method="nnls")


@pytest.mark.long
def test_detail_says_what_is_prior() -> None:
    """Deep taxels fix less of each cell than shallow ones; outside contact there is nothing to fix."""
    shares = []
    for depth in (1e-3, 4e-3):
        array = pp.AreaArray(shape=(14, 14), pitch=1e-3, depth=depth, channels=["stress_zz"])
        skin = pp.Skin(PAD, array)
        touch = skin.reconstruct(pressed(skin, BALL, 0.01)[0])
        pressure = touch.pressure.values
        detail = touch.variance_reduction.sel(component="z").values
        assert np.isnan(detail[0, 0])
        core = detail[pressure > 0.5 * pressure.max()]
        assert ((core > 0) & (core < 1)).all()
        shares.append(float(np.median(core)))
    assert shares[1] < shares[0]


@pytest.mark.long
def test_bench_from_the_shell(tmp_path: Path) -> None:
    command = ["bench", "accuracy", "--no-comparisons", "--draws", "1"]
    done = run(*command, "--layouts", "across the edge", "--out", str(tmp_path), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "clairvoyant" in done.stdout
    assert "peak_pressure" in done.stdout
    with open(tmp_path / "accuracy.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert all(0 < float(r["error"]) < 1 for r in rows)
    assert (tmp_path / "accuracy.png").stat().st_size > 10_000
    page = (tmp_path / "accuracy.md").read_text(encoding="utf-8")
    assert "| across the edge | adaptive |" in page
    assert "| normal force |" in page
    wrong = run(*command, "--layouts", "sphere", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "layouts must be among" in wrong.stderr


@pytest.mark.long
def test_calibration_is_reproducible_and_sane() -> None:
    found = bench.calibration(24, seed=3)
    assert found == bench.calibration(24, seed=3)
    for contact, quantity in itertools.product(("line", "area"), ("traction", "force", "peak_pressure")):
        _, scale, freedom = found[Case(contact)][quantity]
        assert 0.2 < scale < 4
        assert freedom > 0.65  # the fit's lower bound is 0.6


# -- noise, and contacts that are not whole ---------------------------------------------------------------


@pytest.mark.long
def test_each_frame_tells_its_own_noise() -> None:
    """One frame tells its noise to a tenth, whatever the frames beside it are."""
    layout = bench.LAYOUTS["line"]
    clean, _ = layout.make(layout.contacts["small cylinder"])
    std = 0.02 * float(np.abs(clean).max())
    rng = np.random.default_rng(0)
    frames = clean + std * rng.standard_normal((6, *clean.shape))
    together = layout.skin.reconstruct(frames).noise_std / std
    assert np.abs(together - 1.0).max() < 0.2
    frames[5, 0, ::3] = 0.4 * np.abs(clean).max()
    spoiled = layout.skin.reconstruct(frames).noise_std / std
    np.testing.assert_array_equal(spoiled[:5], together[:5])


def test_correlated_noise_in_mirror_blocks_and_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whitening commutes with the mirror symmetry: both ways to the spectrum agree, and on scattered positions too."""
    from palpate.inverse.linear import spectrum

    array = pp.AreaArray(
        shape=(15, 15), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=30.0, noise_correlation=2e-3
    )
    rng = np.random.default_rng(0)
    readings = pp.Skin(PAD, array).sense(BALL, rng=rng)
    monkeypatch.setattr(spectrum, "in_blocks", spectrum.mirrored)
    assert len(pp.Tikhonov().prepare(pp.Skin(PAD, array).problem()).spectrum.blocks) == 4
    blocks = pp.Skin(PAD, array).reconstruct(readings, method="tikhonov")
    monkeypatch.setattr(spectrum, "in_blocks", lambda *_: False)
    whole = pp.Skin(PAD, array).reconstruct(readings, method="tikhonov")
    np.testing.assert_allclose(whole.values, blocks.values, atol=1e-6 * blocks.values.max())
    scattered = pp.ScatteredArray(
        positions=array.points[:, ::-1], depth=1.5e-3, channels=["stress_zz"], noise=30.0, noise_correlation=2e-3
    )
    skin = pp.Skin(PAD, scattered, surface=pp.Skin(PAD, array).surface)
    alike = skin.reconstruct(readings.reshape(1, -1), method="tikhonov")
    np.testing.assert_allclose(alike.values, blocks.values, atol=1e-6 * blocks.values.max())


def test_noise_has_the_correlation_it_is_said_to_have() -> None:
    array = pp.LineArray(
        count=30, pitch=1.0, depth=1.0, channels=["stress_zz", "stress_xz"], noise=[2.0, 3.0], noise_correlation=2.0
    )
    sample = array.sample_noise(np.random.default_rng(0), (20000,))
    np.testing.assert_allclose(sample.std(axis=(0, 2)), [2.0, 3.0], rtol=0.01)
    for lag in (1, 2, 5):
        alike = (sample[..., lag:] * sample[..., :-lag]).mean(axis=(0, 2)) / [4.0, 9.0]
        np.testing.assert_allclose(alike, np.exp(-lag / 2.0), atol=0.01)
    assert abs((sample[:, 0] * sample[:, 1]).mean()) < 0.05


def held_by_intervals(array: Any, contact: Any, frames: int) -> list[int]:
    """How often the force's interval holds the truth and the frame is not refuted: where noise is said to be correlated, and where it is said to be independent."""
    both = array, replace(array, noise_correlation=0.0)
    skins = [pp.Skin(PAD, each, uncertainty=EXACT) for each in both]
    readings, rng = skins[0].sense(contact), np.random.default_rng(0)
    truth = skins[0].sample(contact)[-1].sum() * skins[0].surface.cell
    held = [0, 0]
    for _ in range(frames):
        noisy = readings + array.sample_noise(rng)
        for i, skin in enumerate(skins):
            touch = skin.reconstruct(noisy)
            low, high = touch.interval(0.95, "force")
            # what is refuted has room for drift, and says so
            held[i] += bool(low[-1] <= truth <= high[-1]) and not touch.fit < 0.01
    return held


@pytest.mark.long
def test_error_bars_know_of_correlated_noise() -> None:
    """Taking correlated noise as independent makes the force's interval miss; saying so makes it hold."""
    array = pp.LineArray(
        count=41, pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=250.0, noise_correlation=4e-3
    )
    known, naive = held_by_intervals(array, solutions.hertz_line(half_width=5e-3, force=200.0), 24)
    assert known >= 21
    assert naive <= 17
    with pytest.raises(pp.Unsupported, match="independent"):
        pp.Skin(PAD, array, boundary="periodic").reconstruct(np.zeros((1, 41)))


@pytest.mark.long
def test_error_bars_of_an_area_know_of_correlated_noise() -> None:
    array = replace(area(shape=(18, 18), noise=250.0), noise_correlation=4e-3)
    known, naive = held_by_intervals(array, WIDE_BALL, 20)
    assert known >= 18
    assert naive <= 16


LONG_ACROSS = [pytest.param(*case, marks=pytest.mark.long) for case in (("cylinder", 5.0), ("punch", 7.0))]


@pytest.mark.parametrize(("kind", "width"), [("strip", 3.5), *LONG_ACROSS])
@pytest.mark.long
def test_contact_across_the_edge(kind: str, width: float) -> None:
    """A wide contact, half of it beyond the array, comes out inside the array as well as it does in the middle."""
    layout = bench.LAYOUTS["line"]
    errors = []
    for center in (0.0, 30.0):
        readings, truth = layout.make(bench.line_contact((kind, center, width, 1.0)))
        inside = np.abs(layout.skin.surface.x) <= 30.0
        found = []
        for draw in range(4):
            noise = 0.01 * np.abs(readings).max() * np.random.default_rng(draw).standard_normal(readings.shape)
            touch = layout.skin.reconstruct(readings + noise, components=["z"])
            assert touch.values.shape == (2, *layout.skin.surface.shape)
            found.append(np.linalg.norm((touch.values - truth)[-1][inside]) / np.linalg.norm(truth[-1][inside]))
        errors.append(float(np.mean(found)))
    assert errors[1] < 1.3 * errors[0]


def test_masked_skin_keeps_its_surface() -> None:
    skin = skin_of()
    working = np.ones((14, 14), dtype=bool)
    working[3, 4:6] = False
    fewer = skin.masked(working)
    assert fewer.surface == skin.surface
    assert not fewer.planes[0].valid[3, 4]
    with pytest.raises(pp.InvalidInput, match="mask"):
        skin.masked(np.ones((3, 3), dtype=bool))


def test_exceeding_a_limit_agrees_with_the_interval() -> None:
    skin = skin_of()
    readings, _ = pressed(skin, BALL, 0.02)
    touch = skin.reconstruct(readings)
    for of, low, high in (
        ("force", *(v[-1] for v in touch.interval(0.9, "force"))),
        ("peak_pressure", *touch.interval(0.9, "peak_pressure")),
    ):
        assert float(touch.exceeds(float(low), of)) == pytest.approx(0.95, abs=1e-6)
        assert float(touch.exceeds(float(high), of)) == pytest.approx(0.05, abs=1e-6)
    with pytest.raises(pp.InvalidInput, match="peak_pressure"):
        touch.exceeds(1.0, "moment")


def test_no_interval_without_error_bars() -> None:
    touch = skin_of().reconstruct(pressed(skin_of(), BALL, 0.02)[0], method="dft")
    for ask in (
        lambda: touch.interval(0.95),
        lambda: touch.interval(0.95, "force"),
        lambda: touch.exceeds(1.0),
        lambda: touch.std(),
    ):
        with pytest.raises(pp.Unsupported, match="gives no error bars"):
            ask()


@pytest.mark.long
def test_a_railed_reading_beside_the_edge_is_left_out_alone() -> None:
    """The second taxel from the edge: seven good readings were left out with it; on 16 x 16 taxels 3.2 N were read after 150 s."""
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(
        shape=(12, 12), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=50.0
    )
    skin = pp.Skin(pad, array)
    ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.5)
    readings = np.asarray(skin.sense(ball, rng=np.random.default_rng(0)))
    readings[2, 1, 2] = 2.0 * np.abs(readings).max()
    touch = skin.reconstruct(readings)
    assert np.asarray(touch.force)[2] == pytest.approx(0.5, rel=0.01)
    left_out = [note for note in touch.notes if note.startswith("left out")]
    assert left_out == ["left out as unexplained by any contact (dead, stuck or saturated?): stress_zz at taxel (1, 2)"]
