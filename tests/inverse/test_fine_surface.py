"""Surfaces with far more cells than the readings resolve: contact is sought on coarser cells, the answer is on the given ones."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.contact import prepared
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.policy import Policy, changed
from palpate.inverse.contact.proposals.state import Search
from palpate.sensing.grids import block_means, divided, refined, resampled, unresolved

PAD = pp.SolidPad.box(12e-3, 10e-3, 3e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
ARRAY = pp.AreaArray(
    shape=(8, 8),
    pitch=1e-3,
    depth=0.0,
    channels=["displacement_x", "displacement_y", "displacement_z"],
    noise=1e-6,
)
BALL = pp.solutions.hertz_point(contact_radius=2e-3, force=0.5)


def test_a_field_on_other_cells_has_the_same_sums_and_no_new_extremes() -> None:
    field = np.random.default_rng(1).random((2, 5, 7)) * (np.arange(7) > 2)
    for counts in ((5, 7), (11, 29), (3, 4), (15, 21)):
        other = resampled(field, counts)
        assert np.allclose(other.mean(axis=(1, 2)), field.mean(axis=(1, 2)))
        assert other.min() >= 0.0
        assert (other.max(axis=(1, 2)) <= 1.5 * field.max(axis=(1, 2))).all()
    assert np.allclose(block_means(resampled(field, (15, 21)), 3, 2), field)
    slope = np.add.outer(np.arange(10.0), 2.0 * np.arange(12.0))
    assert np.allclose(resampled(slope, (20, 24))[2:-2, 2:-2], refined_slope()[2:-2, 2:-2])


def refined_slope() -> np.ndarray:
    return np.add.outer(0.5 * np.arange(20) - 0.25, np.arange(24) - 0.5)


def test_errors_allow_for_what_cells_do_not_resolve() -> None:
    line = np.linspace(0.0, 1.0, 6)
    assert np.allclose(unresolved(line, (12,))[2:-2], 0.0)
    edge = np.array([0.0, 0.0, 1.0, 1.0])
    assert np.allclose(unresolved(edge, (8,)), np.repeat([0.0, 1.0, 1.0, 0.0], 2) / np.sqrt(12.0))


def test_what_is_missing_stays_missing() -> None:
    field = np.array([1.0, np.nan, 3.0, 3.0])
    assert np.isnan(resampled(field, (8,))).tolist() == [False] * 2 + [True] * 2 + [False] * 4


@pytest.mark.parametrize("grid", [pp.LineGrid(count=12, spacing=1e-3), pp.AreaGrid(shape=(6, 9), spacing=1e-3)])
def test_other_cells_cover_the_same_surface(grid: pp.LineGrid | pp.AreaGrid) -> None:
    other = divided(grid, [4] * grid.dimensions)
    for a, b, dx, ex in zip(grid.axes, other.axes, grid.spacings, other.spacings):
        assert np.allclose([a[0] - dx / 2, a[-1] + dx / 2], [b[0] - ex / 2, b[-1] + ex / 2])


def test_a_surface_of_many_cells_has_the_answer_of_few() -> None:
    usual = pp.Skin(PAD, ARRAY)
    fine = pp.Skin(PAD, ARRAY, surface=PAD.grid(shape=(60, 63), spacing=(10e-3 / 60, 12e-3 / 63)))
    readings = usual.sense(BALL, rng=np.random.default_rng(0))
    touch, coarse = fine.reconstruct(readings), usual.reconstruct(readings)
    assert touch.status == pp.Status.SOLVED
    assert touch.traction.shape == (3, 60, 63)
    assert touch.std().shape == touch.values.shape
    assert np.allclose(touch.force, coarse.force, atol=0.02 * 0.5)
    low, high = touch.interval(0.95, "force")
    assert low[2] <= 0.5 <= high[2]


def test_few_cells_are_those_of_the_user() -> None:
    most = Policy().work.unknowns
    few = pp.Skin(PAD, ARRAY, surface=PAD.grid(shape=(20, 24), spacing=0.5e-3)).problem()
    assert few.coarser(most) is few
    usual = pp.Skin(PAD, ARRAY).problem()
    assert usual.coarser(10) is usual
    wide = pp.Skin(PAD, ARRAY, surface=PAD.grid(shape=(12, 12), spacing=0.9e-3)).problem()
    assert wide.coarser(10) is wide  # they are not finer than needed
    fine = pp.Skin(PAD, ARRAY, surface=refined(usual.surface, 3)).problem()
    assert fine.coarser(most).surface.shape == usual.surface.shape


def test_the_finest_cells_are_for_small_contacts_or_pressure_alone() -> None:
    estimator = pp.Adaptive().prepare(pp.Skin(PAD, ARRAY).problem())
    few = estimator.policy.grid.few_unknowns
    finest, fine, _ = estimator.policy.grid.area
    inside, wide = few // finest**2, few // finest**2 + 1
    assert estimator._ratio(100.0, 100.0, inside, joined=True) == finest
    assert estimator._ratio(100.0, 100.0, wide, joined=True) == fine
    assert estimator._ratio(100.0, 50.0, inside, joined=True) == fine  # the readings do not determine as many
    alone = copy.copy(estimator)
    alone.columns = estimator.columns[-1:]
    assert alone._ratio(100.0, 100.0, wide, joined=True) == finest
    assert alone._ratio(100.0, 50.0, wide, joined=True) == fine
    assert alone._ratio(100.0, 50.0, wide, joined=False) == finest  # the place of an edge is worth its cost


def test_an_alternative_that_is_too_large_is_skipped() -> None:
    estimator = pp.Adaptive().prepare(pp.Skin(PAD, ARRAY).problem())
    data = np.ones(len(estimator.readings.std))
    search = Search(estimator, data, data > 0, 1.0, None)

    def too_large(*found: Explanation) -> Iterator[Explanation]:
        yield from found
        estimator.check_size(10**6)

    with pytest.raises(pp.Unsupported, match="too many"):
        search.add(too_large())
    push = search.plain(1)
    search.add(too_large(push))
    search.add(too_large())
    assert search.tried == [push]


def test_a_stream_is_tracked_on_coarser_cells() -> None:
    """It raised at the first frame with contact."""
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0)
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, array, surface=pp.AreaGrid(shape=(100, 100), spacing=0.1e-3))
    usual = pp.Skin(pad, array)
    ball = np.asarray(usual.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0)))
    with skin.track() as tracker:
        touch = tracker.step(ball + 20.0 * np.random.default_rng(0).standard_normal(ball.shape))
    assert float(touch.force[2]) == pytest.approx(1.0, abs=0.05)
    assert touch.surface.shape == (10, 10)
    assert any("tracked on 10 x 10 cells" in note for note in touch.notes)


def test_a_frame_that_is_too_large_does_not_stop_the_others() -> None:
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=10.0)
    skin = pp.Skin(pad, array)
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0)))
    readings = np.stack([np.zeros_like(press), press])
    with mock.patch.object(prepared, "Policy", return_value=changed(Policy(), "work.unknowns", 3)):
        touch = skin.reconstruct(readings, method="constrained")
    assert list(touch.status) == [pp.Status.NO_CONTACT, pp.Status.UNEXPLAINED]
    assert any("not solved in 1 of 2 frames: the contact covers" in note for note in touch.notes)
    low, high = touch.interval(0.95, of="force")
    assert low[1][-1] < 1.0 < high[1][-1]
