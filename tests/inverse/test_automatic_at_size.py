"""The automatic method where matrices do not serve: the same answers as with them, and everything else that it says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.constrained import circulant, factors, iterative, products
from palpate.inverse.constrained.cone import Cone, minimise
from palpate.inverse.constrained.faces import Face, straight
from palpate.inverse.constrained.iterative import Iterative
from palpate.inverse.constrained.model import Level
from palpate.inverse.constrained.products import Applied, Products
from palpate.inverse.constrained.quadratic import Penalty
from palpate.inverse.contact import summary
from palpate.inverse.contact.adaptive import AdaptiveEstimator
from palpate.inverse.contact.explanation import Explanation, Rough
from palpate.inverse.contact.methods import cone_of
from palpate.inverse.contact.policy import Errors, Parts, Policy
from palpate.inverse.contact.score import hopeless_signs, likelier_signs
from palpate.inverse.contact.search import search
from palpate.inverse.linear.matrix_free import path
from palpate.inverse.linear.whitening import Readings

STRESS = ["stress_xz", "stress_yz", "stress_zz"]
PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)


def skin_of(n: int, **options: Any) -> pp.Skin:
    options = {"shape": (n, n), "pitch": 1e-3, "depth": 2e-3, "channels": STRESS, **options}
    return pp.Skin(PAD, pp.AreaArray(**options))


def ball(skin: pp.Skin, radius: float, x: float = 0.0, y: float = 0.0, shear: float = 0.3) -> Any:
    """Hertz's pressure (1 kPa at its peak) and shear in proportion."""
    grid = skin.surface
    places = np.meshgrid(*grid.axes, indexing="ij")
    pressure = 1e3 * np.sqrt(np.maximum(1.0 - ((places[1] - x) ** 2 + (places[0] - y) ** 2) / radius**2, 0.0))
    traction = np.zeros((3, *grid.shape))
    traction[0], traction[2] = shear * pressure, pressure
    return traction


def noisy(skin: pp.Skin, traction: Any, part: float = 0.02, seed: int = 0) -> tuple[Any, float]:
    """Readings with noise of that part of the largest, and the noise."""
    readings = skin.sense(traction)
    noise = part * float(np.abs(readings).max())
    return readings + noise * np.random.default_rng(seed).standard_normal(readings.shape), noise


def without_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything without matrices."""
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 10)
    for name in ("MIN_ITERATIVE_UNKNOWNS", "FEWEST_SLIDING"):
        monkeypatch.setattr(products, name, 10)
    for name in ("PRODUCTS", "PRODUCTS_DISPLACEMENT", "PRODUCTS_SLIDING", "FEW_READINGS"):
        monkeypatch.setattr(products, name, 0)


@pytest.mark.parametrize("ratio", [1, 2])
def test_products_are_those_of_the_matrix(ratio: int) -> None:
    skin = skin_of(9, mask=np.arange(81).reshape(9, 9) != 12)
    operator = skin.problem().wide.finer(ratio)
    readings = Readings(operator, [np.array([1.0, 2.0, 3.0])])
    level = Level(operator, ratio, (0, 2), readings)
    rng = np.random.default_rng(0)
    cells = np.sort(rng.choice(level.grid.shape[0] * level.grid.shape[1], 40, replace=False))
    noise, observed = readings.std * rng.uniform(0.5, 1.0, len(readings.std)), rng.random(len(readings.std)) < 0.9
    matrix = level.matrix(cells, noise, observed)
    applied = Applied(level.boxes, readings, level.grid.shape, cells, noise, observed)
    x, rows = rng.standard_normal(matrix.shape[1]), rng.standard_normal((3, matrix.shape[0]))
    assert np.abs(applied @ x - matrix @ x).max() < 1e-11 * np.abs(matrix @ x).max()
    assert np.abs(rows @ applied - rows @ matrix).max() < 1e-11 * np.abs(rows @ matrix).max()
    squares = (matrix**2).sum(axis=0)
    assert np.abs(applied.squares - squares).max() < 1e-8 * squares.max()
    part = applied.part(np.arange(5, 20))
    picks = np.concatenate([np.arange(5, 20), 40 + np.arange(5, 20)])
    assert np.abs(rows @ part - rows @ matrix[:, picks]).max() < 1e-11 * np.abs(rows @ matrix).max()
    ray = np.array([0.3, 1.0])
    along = 0.3 * matrix[:, :40] + matrix[:, 40:]
    assert np.abs(rows @ applied.along(ray) - rows @ along).max() < 1e-11 * np.abs(rows @ along).max()


@pytest.mark.parametrize("transposed", [False, True])
def test_a_triangular_factor_solves_many_columns_in_pieces(transposed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    lower, right = np.tril(rng.standard_normal((6, 6))) + 6.0 * np.eye(6), rng.standard_normal((6, 9))
    monkeypatch.setattr(factors, "PIECE", 12)  # two columns
    found = factors._triangle(np.asfortranarray(lower), right, transposed=transposed)
    assert np.allclose((lower.T if transposed else lower) @ found, right, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("friction", [None, 0.5])
def test_slow_solutions_go_on_with_an_exact_factor(friction: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where conjugate gradients take too many steps and the readings are few: the same minimum, to more digits."""
    skin = skin_of(6)
    level = Level(skin.problem().wide, 1, (0, 1, 2), readings := Readings(skin.problem().wide, [np.ones(3)]))
    everything = np.ones(len(readings.std), dtype=bool)
    cells = np.arange(level.grid.shape[0] * level.grid.shape[1])
    applied = Applied(level.boxes, readings, level.grid.shape, cells, readings.std, everything)
    each = [q[cells][:, cells] for q in level.differences.even(1, [1e-4] * 3)]
    hessian = Products(applied, Penalty(cells, each, level.grid.shape))
    y, _ = noisy(skin, ball(skin, 3e-3))
    linear = (y.ravel() @ applied).reshape(3, -1)
    cone = Cone(("x", "y", "z"), friction)
    exact = minimise(hessian.exactly(), linear, cone, keep_face=True)
    monkeypatch.setattr(iterative, "SLOW", 5)
    found = minimise(hessian, linear, cone, keep_face=True)
    assert applied.slow
    assert found.converged
    assert not isinstance(found.factor, Iterative)
    assert np.abs(found.traction - exact.traction).max() < 1e-7 * np.abs(exact.traction).max()
    assert not isinstance(minimise(hessian, linear, cone, keep_face=True).factor, Iterative)
    # too many readings for it
    applied.slow = False
    monkeypatch.setattr(products, "MATRIX", 0)
    assert isinstance(minimise(hessian, linear, cone, tolerance=1e-3, keep_face=True).factor, Iterative)
    assert not applied.slow


@pytest.mark.parametrize(("where", "local"), [("inside", False), ("inside", True), ("across the edge", False)])
@pytest.mark.long
def test_circulants_make_it_short_and_change_nothing(where: str, local: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Conjugate gradients that begin with the circulant of the matrix come to the same in half the steps or less."""
    skin = skin_of(24)
    operator = skin.problem().wide
    readings = Readings(operator, [np.ones(3)])
    level = Level(operator, 1, (0, 1, 2), readings)
    y, x = np.meshgrid(*level.grid.axes, indexing="ij")
    from_middle = 0.0 if where == "inside" else 12e-3
    cells = np.flatnonzero(((x - from_middle) ** 2 + y**2 < 8e-3**2).ravel())
    rng = np.random.default_rng(0)
    noise = readings.std * 1e-2
    applied = Applied(level.boxes, readings, level.grid.shape, cells, noise, np.ones(len(noise), dtype=bool))
    weights = 1e-3 * rng.uniform(0.1, 1.0, (3, *level.grid.shape))
    each = level.differences.local(weights) if local else level.differences.even(1, [3e8, 3e8, 1e8])
    hessian = Products(applied, Penalty(cells, each, level.grid.shape))
    pressing = rng.random(len(cells)) < 0.9
    face = Face(
        straight(len(cells), 3), np.stack([np.ones(len(cells)), np.ones(len(cells)), 1.0 * pressing]), mixed=False
    )
    right = rng.standard_normal((len(face.index), 2))
    steps = []
    original = Iterative._apply

    def counted(self: Iterative, v: Any) -> Any:
        steps.append(len(v))
        return original(self, v)

    monkeypatch.setattr(Iterative, "_apply", counted)
    found = Iterative(hessian, face, np.zeros(len(face.index))).inverse(right)
    taken = len(steps)
    expected = np.linalg.solve(hessian.dense()[np.ix_(face.index, face.index)], right)
    energy = np.abs(((found - expected) * right).sum(axis=0) / (expected * right).sum(axis=0))
    assert energy.max() < 1e-4
    assert np.linalg.norm(found - expected) < 0.02 * np.linalg.norm(expected)
    monkeypatch.setattr(Iterative, "_near", lambda self, r: self._small**2 * r)
    steps.clear()
    Iterative(hessian, face, np.zeros(len(face.index))).inverse(right)
    assert 2 * taken <= len(steps), (taken, len(steps))
    assert len(hessian.circulants) == (1 if where == "inside" else 2)


@pytest.mark.parametrize("components", [1, 2, 3])
def test_inverses_of_small_hermitian_matrices(components: int) -> None:
    rng = np.random.default_rng(0)
    half = rng.standard_normal((components, components, 4, 5)) + 1j * rng.standard_normal(
        (components, components, 4, 5)
    )
    symbol = np.einsum("ik...,jk...->ij...", half, np.conj(half)) + 0.1 * np.eye(components)[..., None, None]
    expected = np.moveaxis(np.linalg.inv(np.moveaxis(symbol, (0, 1), (-2, -1))), (-2, -1), (0, 1))
    np.testing.assert_allclose(circulant._inverse(symbol), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.long
def test_an_offset_under_a_ball_that_covers_the_array_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was read as 3 to 4 % of the force, which was said to be known to 0.7 %."""
    without_matrices(monkeypatch)
    skin = skin_of(24)
    clean, _ = noisy(skin, ball(skin, 9e-3, 1e-3), seed=4)
    fit = float(skin.reconstruct(clean).fit)
    assert fit > 0.05
    shifted = clean.copy()
    shifted[2] += 0.015 * np.abs(clean).max()
    touch = skin.reconstruct(shifted)
    assert float(touch.fit) > 0.05
    true = 1e3 * 2.0 / 3.0 * np.pi * 9e-3**2
    low, high = touch.interval(0.95, "force")
    assert low[2] <= true <= high[2]
    assert any("offset of stress_zz" in n for n in touch.notes)


@pytest.mark.parametrize(
    ("ring", "gains", "left_out"),
    [(0.1, (100.0, 40.0), [-1]), (0.1, (100.0, 60.0), []), (0.5, (100.0, 40.0), []), (0.1, (-1.0, -3.0), [])],
)
def test_signs_that_no_offset_saves(ring: float, gains: tuple[float, float], left_out: list[int]) -> None:
    """Neither where the edge is loaded all round, as an offset would be, nor where nothing explains the readings."""
    nothing = np.zeros(0)
    tried = [
        Explanation(sign, Rough(gain, 1.0, 1.0, nothing, nothing, ring), nothing) for sign, gain in zip((1, -1), gains)
    ]
    assert hopeless_signs(tried, Policy()) == left_out
    assert likelier_signs(tried, left_out) == [s for s in (1, -1) if s not in left_out]


def test_a_sign_that_fits_most_readings_freely_may_be_saved() -> None:
    """Its gain says nothing. With shifts such a push was read as 2.5 N of 1.8 N; without it, a pull won and 25 N (-29 to 79) was read."""
    readings, nothing = np.zeros(50), np.zeros(0)
    gains, free = (100.0, 7.0), (45.0, 1.0)
    tried = [
        Explanation(sign, Rough(gain, 1.0, f, nothing, readings, 0.0), nothing)
        for sign, gain, f in zip((-1, 1), gains, free)
    ]
    assert hopeless_signs(tried, Policy()) == []


@pytest.mark.long
def test_a_pull_with_an_offset_on_a_large_array() -> None:
    skin = skin_of(20)
    pulled = -ball(skin, 4e-3, 1e-3)
    readings, _ = noisy(skin, pulled, seed=2)
    readings[2] += 0.2 * np.abs(readings).max()
    touch = skin.reconstruct(readings)
    true = float(pulled[2].sum()) * skin.surface.cell
    assert float(touch.force[2]) == pytest.approx(true, rel=0.1)
    assert any("offset of stress_zz" in n for n in touch.notes)


def framed(skin: pp.Skin, readings: Any, friction: float | None) -> Any:
    """A frame on cells of the surface alone: no array too large for matrices is worth finer ones."""
    problem = skin.problem()
    # the least error of a large contact's force is a bound, not what products leave
    policy = Policy(
        parts=Parts(finer_grid=False, finer_sliding=False, second_derivative=False),
        errors=Errors(force_at_size=Errors().force, sums_at_size=1.0),
    )
    return search(AdaptiveEstimator(problem, cone_of(problem.components, friction), policy=policy), [readings])


@pytest.mark.long
@pytest.mark.parametrize("friction", [None, 0.6])
def test_same_answer_without_matrices(friction: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    skin = skin_of(12)
    readings, _ = noisy(skin, ball(skin, 3e-3, 1e-3))
    exact = framed(skin, readings, friction)
    without_matrices(monkeypatch)
    found = framed(skin_of(12), readings, friction)
    assert isinstance(found.errors, summary.Summary)
    assert not isinstance(exact.errors, summary.Summary)
    std = exact.known.traction
    there = std[2] > 0.3 * std[2].max()
    # what is left between them is the noise, which is learned from random rows there
    assert np.sqrt(np.mean(((found.traction - exact.traction)[:, there] / std[:, there]) ** 2)) < 0.1
    assert found.noise == pytest.approx(exact.noise, rel=0.01)
    assert found.fit == pytest.approx(exact.fit, abs=0.02)
    if friction is not None:
        assert found.sliding == pytest.approx(exact.sliding, abs=0.05)
    for name in ("force", "moment", "center"):
        assert getattr(found.known, name) == pytest.approx(getattr(exact.known, name), rel=0.05)
    ratio = found.known.traction[2][there] / std[2][there]
    assert abs(np.mean(ratio) - 1.0) < 0.15
    assert np.std(ratio) < 0.3


@pytest.mark.long
def test_broken_readings_are_left_out_at_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large arrays have no linear screening: the rough contact shows a dead taxel under the ball, and a railed one."""
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 10)
    skin = skin_of(16)
    readings, _ = noisy(skin, ball(skin, 4e-3, 1e-3))
    plain = skin.reconstruct(readings)
    broken = readings.copy()
    broken[2, 8, 7], broken[0, 4, 12] = 0.0, 3.0 * np.abs(readings).max()
    touch = skin.reconstruct(broken)
    assert touch.outliers is not None
    assert {tuple(map(int, at)) for at in np.argwhere(touch.outliers.reshape(3, 16, 16))} == {(2, 8, 7), (0, 4, 12)}
    assert touch.force[2] == pytest.approx(plain.force[2], rel=0.02)


@pytest.mark.long
def steps_of(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the steps of conjugate gradients."""
    steps, apply = [0], Iterative._apply

    def counted(self: Iterative, *args: Any, **options: Any) -> Any:
        steps[0] += 1
        return apply(self, *args, **options)

    monkeypatch.setattr(Iterative, "_apply", counted)
    return steps


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.long
def test_scattered_outliers_are_removed_together(given: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two per cent of the readings are wrong, a third of them at the edge, where a load beyond it would reach neighbours too."""
    skin = skin_of(24, depth=1.8e-3)
    readings, noise = noisy(skin, ball(skin, 3e-3), 0.005)
    rng = np.random.default_rng(0)
    largest = float(np.abs(readings).max())
    bad = rng.random(readings.shape) < 0.02
    readings = np.where(bad, rng.uniform(-1.5, 1.5, readings.shape) * largest, readings)
    obvious = bad & (np.abs(readings - skin.sense(ball(skin, 3e-3))) > 0.3 * largest)
    skin = skin_of(24, depth=1.8e-3, noise=noise if given else None)
    steps = steps_of(monkeypatch)
    touch = skin.reconstruct(readings)
    assert touch.outliers is not None
    assert touch.outliers[obvious.ravel()].all()
    assert (touch.outliers & ~bad.ravel()).sum() < 0.2 * bad.sum()  # neighbours of those at the edge
    assert touch.fit > 0.01
    assert float(touch.force[2]) == pytest.approx(
        float(np.prod(skin.surface.spacings) * ball(skin, 3e-3)[2].sum()), rel=0.03
    )
    assert steps[0] < 2000  # 32 000 where those at the edge stay in


@pytest.mark.long
def test_noise_given_far_too_small_takes_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wide contacts that slide, deep below a given noise of a fifth of the true one."""
    skin = skin_of(24, depth=1.8e-3)
    readings, noise = noisy(skin, ball(skin, 9e-3), 0.005)
    steps = steps_of(monkeypatch)
    touch = skin_of(24, depth=1.8e-3, noise=0.2 * noise).reconstruct(readings)
    assert touch.fit < 0.01
    assert float(touch.force[2]) == pytest.approx(
        float(np.prod(skin.surface.spacings) * ball(skin, 9e-3)[2].sum()), rel=0.03
    )
    assert steps[0] < 3000


@pytest.mark.long
def test_a_clean_frame_of_displacement_takes_few_products(monkeypatch: pytest.MonkeyPatch) -> None:
    """15,465 products with H before: offsets of pulls that could not win were solved from noise far below the residual."""
    taken: list[int] = []
    apply = Iterative._apply

    def counted(self: Iterative, v: Any) -> Any:
        taken.append(len(v))
        return apply(self, v)

    monkeypatch.setattr(Iterative, "_apply", counted)
    channels = ["displacement_x", "displacement_y", "displacement_z"]
    skin = skin_of(24, channels=channels, noise=4e-7)
    load = pp.solutions.hertz_point(contact_radius=5e-3, force=1.0).sliding(0.3)
    touch = skin.reconstruct(skin.sense(load, rng=np.random.default_rng(0)))
    assert touch.force == pytest.approx([0.3, 0.0, 1.0], abs=5e-3)
    assert sum(taken) < 1500


@pytest.mark.long
def test_nothing_and_pulls_at_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 10)
    skin = skin_of(10)
    rng = np.random.default_rng(0)
    nothing = skin.reconstruct(rng.standard_normal((3, 10, 10)))
    assert nothing.status == pp.Status.NO_CONTACT
    readings, _ = noisy(skin, ball(skin, 3e-3))
    pushed, pulled = skin.reconstruct(readings), skin.reconstruct(-readings)
    assert pulled.method == pushed.method == "adaptive"
    # the linear model's degrees of freedom are worked out where they are first asked for
    np.testing.assert_allclose(pulled.values, -pushed.values, atol=5e-3 * np.abs(pushed.values).max())
    assert any("pull" in note for note in pulled.notes)


@pytest.mark.long
def test_a_hertzian_ball_on_128_x_128_taxels() -> None:
    """Closed form: p = p0 sqrt(1 - r^2/a^2), p0 = 3 P/(2 pi a^2)."""
    skin, radius, force = skin_of(128), 30e-3, 2.0
    contact = pp.solutions.hertz_point(contact_radius=radius, force=force)
    readings = skin.sense(contact)
    readings = readings + 0.02 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    touch = skin.reconstruct(readings)
    assert touch.status == pp.Status.SOLVED
    grid = skin.surface
    y, x = np.meshgrid(*grid.axes, indexing="ij")
    truth = 1.5 * force / (np.pi * radius**2) * np.sqrt(np.maximum(1.0 - (x**2 + y**2) / radius**2, 0.0))
    error = np.linalg.norm(touch.pressure.values - truth) / np.linalg.norm(truth)
    assert error < 0.05
    other = skin.reconstruct(readings, method="tikhonov")
    assert error < 0.5 * np.linalg.norm(other.pressure.values - truth) / np.linalg.norm(truth)
    for of, true in (("force", force), ("peak_pressure", truth.max())):
        low, high = (np.ravel(v)[-1] for v in touch.interval(0.95, of))
        assert low <= true <= high
    assert float(touch.force[2]) == pytest.approx(force, rel=2e-3)
    area = float(touch.contact_area())
    assert np.sqrt(area / np.pi) == pytest.approx(radius, rel=0.03)
