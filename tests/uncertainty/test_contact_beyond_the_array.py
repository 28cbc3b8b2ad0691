"""What no reading says: how far contact goes on beyond the outermost taxels, and whether a few taxels that are all pressed read noise."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.recordings.labelled import touch_dataset, touch_of
from palpate.uncertainty.calibration import Calibration

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.45)


def _half_off(side: int, shear: float, seed: int) -> tuple[pp.Skin, Floats, Floats]:
    """A flat punch whose middle lies over the last taxel of a shallow line; the force per length."""
    array = pp.LineArray(count=22, pitch=1.5e-3, depth=0.8e-3, channels=["stress_xz", "stress_zz"])
    end = side * 15.75e-3
    fine = pp.LineGrid(count=400, spacing=1e-4, center=end)
    pressure = 1e4 * (np.abs(fine.axes[0] - end) < 8e-3)
    clean = np.asarray(pp.Skin(PAD, array, surface=fine).sense(np.stack([shear * pressure, pressure])))
    noise = 0.01 * np.abs(clean).max() * np.random.default_rng(seed).standard_normal(clean.shape)
    return pp.Skin(PAD, array), clean + noise, np.array([shear, 1.0]) * float(pressure.sum()) * 1e-4


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("shear", [0.0, -0.4])
@pytest.mark.long
def test_the_interval_of_a_punch_half_off_a_line_reaches_to_all_of_it(side: int, shear: float) -> None:
    skin, readings, true = _half_off(side, shear, seed=2)
    touch = skin.reconstruct(readings)
    force, (low, high) = np.asarray(touch.force), touch.interval(0.95, "force")
    assert force[1] < 0.8 * true[1]  # half of it is not measured
    quarter = 0.25 * (high[1] - low[1])
    assert low[1] < true[1] < high[1] + quarter
    # nothing beyond takes from what was measured
    assert force[1] - low[1] < 0.5 * (high[1] - force[1])
    assert any("at the edge" in note or "across the edge" in note for note in touch.notes)
    assert touch._errors is not None
    assert touch._errors.posterior.beyond_force[1] > 0.3 * force[1]
    if shear:
        assert low[0] < true[0] + 0.1 * true[1]
        assert force[0] - low[0] > high[0] - force[0]
    # the moment knows of it too
    inner = skin.reconstruct(np.roll(readings, -7 * side, axis=1))
    assert inner._errors is not None
    assert touch._errors.posterior.moment[0] > 2.0 * inner._errors.posterior.moment[0]


def test_a_contact_that_ends_before_the_outermost_taxels_has_nothing_beyond() -> None:
    skin, readings, _ = _half_off(1, 0.0, seed=2)
    ball = np.asarray(skin.sense(pp.solutions.hertz_line(half_width=4e-3, force=50.0)))
    touch = skin.reconstruct(ball + 0.01 * ball.max() * np.random.default_rng(0).standard_normal(ball.shape))
    assert touch._errors is not None
    # only what a little more load between its taxels could be
    assert touch._errors.posterior.beyond_force[1] < 0.02 * touch.force[1]
    assert not any("the edge" in note for note in touch.notes)
    assert readings.shape == ball.shape


def test_what_may_lie_beyond_moves_one_end_and_the_odds_on_its_side() -> None:
    table, zero, one = Calibration(), np.zeros(2), np.ones(2)
    value = np.array([10.0, -10.0])
    low, high = table.bounds(0.95, value, one, zero, np.full(2, -np.inf), beyond=4.0)
    np.testing.assert_allclose((value - low)[0], 1.96, rtol=1e-3)
    np.testing.assert_allclose((high - value)[1], 1.96, rtol=1e-3)
    np.testing.assert_allclose([(high - value)[0], (value - low)[1]], np.hypot(1.96, 4.0), rtol=1e-3)
    # the probability that a limit is exceeded is that of the interval that ends there
    limit = float(high[0])
    assert table.above(limit, value[0], one[0], zero[0], 0.0, 4.0) == pytest.approx(0.025, rel=1e-3)
    assert table.above(float(low[0]), value[0], one[0], zero[0], 0.0, 4.0) == pytest.approx(0.975, rel=1e-3)


# a line of 14 taxels of xz and zz strain under three rubbing contacts of 89 N/m, noise of 0.6 % of the largest reading
_THREE = [
    [-0.822, 0.315, -0.206, -0.912, 0.453, -0.209, -0.841, -0.43, -0.326, -0.024, 0.045, 0.172, -0.002, -0.013],
    [-0.057, 0.867, -0.321, 0.649, 0.114, -0.316, 0.042, 1.0, 0.304, 0.942, 0.638, 0.05, 0.049, 0.066],
]


@pytest.mark.long
def test_contact_over_all_of_a_short_line_may_be_what_reads_as_noise() -> None:
    pad = pp.HalfSpace(youngs_modulus=138682.0, poissons_ratio=0.39856)
    readings = 0.034463 * np.array(_THREE)
    how = {"count": 14, "pitch": 1.894e-3, "depth": 1.2931e-3, "channels": ["strain_xz", "strain_zz"]}
    touch = pp.Skin(pad, pp.LineArray(**how)).reconstruct(readings, friction=0.267)
    assert touch.status == pp.Status.UNDECIDED  # nobody gave the noise of 28 readings
    assert touch.interval(0.95, "force")[1][1] > 89.0  # 33 before
    assert any("even contact over all of these few taxels" in note for note in touch.notes)
    # what the note asks for tells
    told = pp.Skin(pad, pp.LineArray(**how, noise=2e-4)).reconstruct(readings, friction=0.267)
    assert told.status == pp.Status.SOLVED
    assert float(told.force[1]) == pytest.approx(89.0, rel=0.25)


def test_a_narrow_contact_on_a_short_line_is_no_disc() -> None:
    """Cells that every model leaves out made the field look worse than it is: a clean frame was taken for a disc, with a fit of 6e-11."""
    pad = pp.BondedLayers([pp.Layer(thickness=8.7627e-3, youngs_modulus=1352570.0, poissons_ratio=0.35983)])
    array = pp.LineArray(count=12, pitch=4.1299e-3, depth=2.92687e-3, channels=["stress_zz"], noise=2391.9)
    readings = 73334.2 * np.array(
        [[0.003, -0.015, -0.002, 0.016, -0.039, 0.388, 0.892, 1.0, 0.486, 0.069, 0.015, 0.036]]
    )
    touch = pp.Skin(pad, array).reconstruct(readings)
    assert float(touch.fit) > 0.1
    assert float(touch.force[1]) == pytest.approx(853.0, rel=0.05)


def test_a_touch_that_was_written_before_this_error_was_kept_is_read_without_it() -> None:
    skin, readings, _ = _half_off(1, 0.0, seed=2)
    touch = skin.reconstruct(readings)
    older = touch_of(touch_dataset(touch).drop_vars("errors_beyond_force"))
    assert touch._errors is not None
    assert older._errors is not None
    assert touch._errors.posterior.beyond_force.any()
    assert not older._errors.posterior.beyond_force.any()
    np.testing.assert_array_equal(older._errors.posterior.force, touch._errors.posterior.force)


def test_the_part_of_the_force_that_one_reading_tells_is_how_the_force_follows_it() -> None:
    """By a change of one per cent of that reading; the contact's cells, taken as they are, follow too."""
    array = pp.LineArray(count=24, pitch=2e-3, depth=1.1e-3, channels=["stress_zz"], noise=30.0)
    skin = pp.Skin(PAD, array)
    readings = np.asarray(skin.sense(pp.solutions.hertz_line(half_width=1.6e-3, force=40.0)))
    said = next(n for n in skin.reconstruct(readings).notes if n.startswith("one reading alone determines"))
    part = float(said.split("determines ")[1].split(" %")[0]) / 100.0
    more = readings.copy()
    more[0, int(np.argmax(readings[0]))] *= 1.01
    change = float(skin.reconstruct(more).force[1]) / float(skin.reconstruct(readings).force[1]) - 1.0
    assert change / 0.01 == pytest.approx(part, rel=0.4)
