"""method="rectified": contact as the positive part of a Gaussian process."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import palpate as pp
from palpate.inverse.rectified.link import traction
from palpate.inverse.rectified.newton import Explanation, Noise, broken_gain, linearised, most_likely
from palpate.inverse.rectified.policy import Policy
from palpate.inverse.rectified.posterior import one_mode
from palpate.inverse.rectified.prepared import Kernel, Prepared
from palpate.inverse.rectified.search import explain
from palpate.sensing.uncertainty import EXACT

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
LINE = pp.LineArray(count=25, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0)
AREA = pp.AreaArray(shape=(7, 8), pitch=1e-3, depth=0.8e-3, channels=["stress_zz"])
THREE = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
HERTZ = pp.solutions.hertz_line(half_width=3e-3, force=10.0)
BALL = pp.solutions.hertz_point(contact_radius=2e-3, force=0.1)


def skin_of(array: pp.LineArray | pp.AreaArray) -> pp.Skin:
    return pp.Skin(PAD, array, uncertainty=EXACT)


def read(array: pp.LineArray | pp.AreaArray, contact: object, noise: float = 0.01, seed: int = 0) -> np.ndarray:
    exact = np.asarray(skin_of(array).sense(contact))
    return exact + noise * np.abs(exact).max() * np.random.default_rng(seed).standard_normal(exact.shape)


def test_kernel_blocks_and_products_agree_with_its_formula() -> None:
    kernel = Kernel((5, 7), (0.25, 0.5), 0.8)
    places = np.stack([x.ravel() for x in np.meshgrid(np.arange(5) * 0.25, np.arange(7) * 0.5, indexing="ij")], axis=1)
    a = np.sqrt(5.0) * np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=-1)) / 0.8
    whole = (1 + a + a**2 / 3) * np.exp(-a)
    field = np.random.default_rng(0).standard_normal((2, 35))
    np.testing.assert_allclose(kernel.block(np.arange(35)), whole, atol=1e-14)
    np.testing.assert_allclose(kernel.times(field), field @ whole, atol=1e-12)
    assert np.linalg.eigvalsh(whole).min() > 0


def test_shear_stays_inside_the_cone_and_derivatives_are_those_of_differences() -> None:
    rng = np.random.default_rng(1)
    f, h = rng.standard_normal(40), 3.0 * rng.standard_normal((2, 40))
    t, by_f, by_h = traction(f, h, 0.2, 0.6)
    assert (np.hypot(t[0], t[1]) <= 0.6 * t[2]).all()
    assert (t[2] >= 0).all()
    step = 1e-6
    np.testing.assert_allclose((traction(f + step, h, 0.2, 0.6)[0] - t) / step, by_f, atol=2e-5)
    for j in range(2):
        moved = h.copy()
        moved[j] += step
        np.testing.assert_allclose((traction(f, moved, 0.2, 0.6)[0] - t) / step, by_h[j], atol=2e-5)


def test_gain_of_a_broken_reading_is_the_change_of_the_evidence() -> None:
    rng = np.random.default_rng(3)
    root = rng.standard_normal((9, 9))
    s, y, size = root @ root.T + np.eye(9), rng.standard_normal(9), 3.0
    y[4] += 9.0

    def evidence(matrix: np.ndarray) -> float:
        return -0.5 * float(y @ np.linalg.solve(matrix, y)) - 0.5 * float(np.linalg.slogdet(matrix)[1])

    gain, reading = broken_gain(np.linalg.solve(s, y), np.diag(np.linalg.inv(s)), (), size)
    more = s.copy()
    more[reading, reading] += size**2
    assert gain == pytest.approx(evidence(more) - evidence(s), rel=1e-10)


def prepared(array: pp.LineArray | pp.AreaArray) -> Prepared:
    components = ["x", "y", "z"] if len(array.channels) == 3 else ["z"]
    return Prepared(skin_of(array).problem(components=components), Policy(), 0.6 if len(array.channels) == 3 else None)


@pytest.mark.parametrize("array", [LINE, AREA, THREE], ids=["line", "area", "three channels"])
def test_the_mode_solves_its_own_equations(array: pp.LineArray | pp.AreaArray) -> None:
    """A step from the mode stays there: f = m + K J' S^-1 (y - s A t + J (f - m)), where the gradient of the log posterior by f vanishes."""
    p = prepared(array)
    contact = HERTZ if array is LINE else BALL.sliding(0.3) if array is THREE else BALL
    found = explain(p, read(array, contact).reshape(-1))
    assert found is not None
    mode = max(found.modes, key=lambda m: m.odds)
    fine = replace(p.policy, steps=200, tolerance=1e-10)
    p.policy = fine
    y = read(array, contact).reshape(-1) / p.scale / found.unit
    solved = most_likely(p, y, replace(mode.explanation, patterns=False, broken=()), mode.start)
    assert solved is not None
    assert solved.converged
    weights = np.zeros(p.cells)
    weights[solved.line.active] = solved.line.blocks[-1].T @ solved.weights
    expected = p.mean + p.kernels[solved.explanation.length].times(weights)
    assert np.abs(expected - solved.f).max() < 0.01 * np.abs(solved.f).max()


def test_covariance_of_the_cells_is_that_of_the_linear_model() -> None:
    p = prepared(AREA)
    found = explain(p, read(AREA, BALL).reshape(-1))
    assert found is not None
    mode = max(found.modes, key=lambda m: m.odds)
    got = one_mode(p, mode)
    line = mode.line
    slope = traction(mode.f, mode.h, p.policy.rounding, p.friction)[1][-1]
    averages = np.zeros((got.mean.size, len(line.active)))
    for i, cell in enumerate(line.active):
        unit = np.zeros(p.cells)
        unit[cell] = mode.amplitude * slope[cell]
        averages[:, i] = p.means(unit).ravel()
    # the same in the space of the cells: (K^-1 + J' (N + B B')^-1 J)^-1
    noise = np.linalg.inv(mode.inverse) - line.signal
    precision = np.linalg.inv(line.kernel + 1e-9 * np.eye(len(line.active)))
    precision += line.blocks[-1].T @ scipy.linalg.solve(noise, line.blocks[-1])
    want = averages @ np.linalg.inv(precision) @ averages.T
    np.testing.assert_allclose(got.covariance, want, atol=2e-4 * want.max())
    assert (np.diag(got.covariance) >= -1e-12 * want.max()).all()


def test_a_known_contact_is_found_with_its_force_in_the_interval() -> None:
    skin = skin_of(LINE)
    touch = skin.reconstruct(np.stack([read(LINE, HERTZ, seed=k) for k in range(12)]), method="rectified")
    low, high = touch.interval(0.95, "force")
    # ten or more of twelve: fewer come of intervals that hold 95 % once in fifty times
    assert ((low[:, 1] < 10.0) & (high[:, 1] > 10.0)).sum() >= 10
    np.testing.assert_allclose(touch.force[:, 1], 10.0, rtol=0.03)
    np.testing.assert_allclose(touch.peak_pressure, 2 * 10.0 / (np.pi * 3e-3), rtol=0.12)
    assert (np.asarray(touch.status) == int(pp.Status.SOLVED)).all()
    assert float(touch.pressure.min()) == 0.0


def test_mirrored_and_scaled_readings_give_mirrored_and_scaled_traction() -> None:
    skin, readings = skin_of(AREA), read(AREA, BALL.shifted(0.6e-3, -0.4e-3))
    plain = np.asarray(skin.reconstruct(readings, method="rectified").values)
    mirrored = np.asarray(skin.reconstruct(readings[..., ::-1], method="rectified").values)
    large = np.asarray(skin.reconstruct(10.0 * readings, method="rectified").values)
    np.testing.assert_allclose(mirrored[-1][:, ::-1], plain[-1], atol=0.02 * plain.max())
    np.testing.assert_allclose(large, 10.0 * plain, atol=0.02 * plain.max())


def test_an_offset_a_pull_and_a_broken_reading_are_told() -> None:
    skin, readings = skin_of(LINE), read(LINE, HERTZ)
    plain = skin.reconstruct(readings, method="rectified")
    offset = skin.reconstruct(readings + 150.0, method="rectified")
    assert float(offset.force[1]) == pytest.approx(10.0, rel=0.05)
    assert float(offset.nuisance[0]) == pytest.approx(150.0, abs=4.0 * float(offset.nuisance_std[0]))
    pull = skin.reconstruct(-readings, method="rectified")
    np.testing.assert_allclose(np.asarray(pull.values), -np.asarray(plain.values), atol=0.02 * plain.values.max())
    broken = readings.copy()
    broken[0, 13] = -1500.0
    touch = skin.reconstruct(broken, method="rectified")
    assert touch.outliers is not None
    assert np.flatnonzero(touch.outliers).tolist() == [13]
    assert float(touch.force[1]) == pytest.approx(10.0, rel=0.05)


def test_noise_alone_is_no_contact_and_few_readings_of_unknown_noise_are_undecided() -> None:
    rng = np.random.default_rng(5)
    quiet = skin_of(LINE).reconstruct(20.0 * rng.standard_normal((1, 25)), method="rectified")
    assert pp.Status(int(quiet.status)) is pp.Status.NO_CONTACT
    low, high = quiet.interval(0.95, "force")
    assert low[1] < 0 < high[1]
    unknown = skin_of(replace(LINE, noise=None)).reconstruct(rng.standard_normal((1, 25)), method="rectified")
    assert pp.Status(int(unknown.status)) is pp.Status.UNDECIDED


def test_a_discrepancy_beside_given_noise_widens_the_force() -> None:
    """Gains that differ by 10 % from taxel to taxel, which a deep array's contact cannot follow."""
    gains = 1 + 0.1 * np.random.default_rng(6).standard_normal(25)
    deep = replace(LINE, depth=3e-3, noise=1.0)
    skin = skin_of(deep)
    clean, off = (
        skin.reconstruct(r, method="rectified") for r in (read(deep, HERTZ, 1e-3), read(deep, HERTZ, 1e-3) * gains)
    )
    assert clean.discrepancy is not None
    assert off.discrepancy is not None
    assert float(clean.discrepancy) < 0.01
    assert 0.02 < float(off.discrepancy) < 0.3
    widths = [float(np.ptp([end[1] for end in t.interval(0.95, "force")])) for t in (clean, off)]
    assert widths[1] > 3.0 * widths[0]
    low, high = off.interval(0.95, "force")
    assert low[1] < 10.0 < high[1]


def test_shear_of_a_sliding_ball_stays_within_friction() -> None:
    touch = skin_of(THREE).reconstruct(read(THREE, BALL.sliding(0.4)), method="rectified", friction=0.5)
    values = np.asarray(touch.values)
    assert (np.hypot(values[0], values[1]) <= 0.5 * values[2] * (1 + 1e-9)).all()
    assert float(touch.force[2]) == pytest.approx(0.1, rel=0.1)
    assert float(touch.force[0]) == pytest.approx(0.04, rel=0.15)


def test_batches_are_frames_one_by_one() -> None:
    skin = skin_of(LINE)
    frames = np.stack([read(LINE, HERTZ, seed=k) for k in range(2)])
    both = skin.reconstruct(frames, method="rectified")
    for one, readings in zip(np.asarray(both.values), frames):
        np.testing.assert_array_equal(one, np.asarray(skin.reconstruct(readings, method="rectified").values))


def test_what_it_cannot_serve_is_refused_with_a_remedy() -> None:
    large = skin_of(pp.AreaArray(shape=(40, 40), pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    with pytest.raises(pp.Unsupported, match=r'serves up to .* readings.*Use method="adaptive"'):
        large.reconstruct(np.ones((1, 40, 40)), method="rectified")
    alike = skin_of(replace(LINE, noise_correlation=2e-3))
    with pytest.raises(pp.Unsupported, match="leave out noise_correlation"):
        alike.reconstruct(np.ones((1, 25)), method="rectified")


def test_linear_model_is_none_where_no_cell_touches() -> None:
    p = prepared(LINE)
    from palpate.inverse.rectified.newton import Fields

    x = np.full((1, p.cells), -5.0)
    t, by_f, by_h = traction(x[-1], x[:-1], 0.2, 1.0)
    assert linearised(p, Fields(p, p.kernels[0]), x, 1.0, t, by_f, by_h) is None
    assert Explanation(1, 0, False, (), Noise(None)).noise.learned
