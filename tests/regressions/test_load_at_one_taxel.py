"""A load that only one taxel responds to, or that lies where nothing is measured, is said."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.bench.trust.rows import make_frame

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
ALONE, ACROSS = "one taxel alone shows a part of the load", "outside the outermost taxels"


def said(touch: pp.Touch, words: str) -> bool:
    return any(words in note for note in touch.notes)


@pytest.mark.long
def test_a_taxel_stuck_far_from_the_contact_is_questioned() -> None:
    """A shallow line on a thin layer: its neighbours need not feel what presses on it, and 56 N/m were found of 37."""
    frame = make_frame("stuck", 7, seed=2203)
    touch = frame.skin.reconstruct(frame.readings)
    assert said(touch, ALONE)
    low, high = touch.interval(0.95, "force")
    assert low[1] < frame.load.force[1] < high[1]  # with and without what presses there
    healthy = np.array(frame.readings)
    healthy[0, 1] = 0.0
    touch = frame.skin.reconstruct(healthy)
    assert not said(touch, ALONE)
    assert abs(touch.force[1] / frame.load.force[1] - 1.0) < 0.05


@pytest.mark.long
def test_no_contact_that_given_noise_explains_ill_has_a_wide_zero() -> None:
    """Two of 252 readings felt a ball that slid: noise alone explains them with a chance of 0.012, and 0.46 N lay outside +- 0.25 N."""
    frame = make_frame("clean", 25, seed=7741)
    touch = frame.skin.reconstruct(frame.readings, friction=frame.friction)
    assert touch.status == pp.Status.NO_CONTACT
    assert 0.01 < touch.fit < 0.1
    low, high = touch.interval(0.95, "force")
    assert (low < frame.load.force).all()
    assert (frame.load.force < high).all()


@pytest.mark.long
def test_a_ball_across_the_edge_is_said_to_be() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=50.0)
    skin = pp.Skin(PAD, array)
    for away, beyond in ((0.0, False), (7.5e-3, True)):
        ball = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0).shifted(away, 0.0)
        touch = skin.reconstruct(skin.sense(ball))
        assert said(touch, ACROSS) == beyond
        assert said(touch, "1 of") is False


def test_frames_of_a_batch_across_the_edge_are_counted() -> None:
    array = pp.LineArray(count=15, pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=50.0)
    skin = pp.Skin(PAD, array)
    frames = np.stack(
        [skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=50.0).shifted(x)) for x in (0.0, 14e-3)]
    )
    assert any(ACROSS in note and "1 of 2 frames" in note for note in skin.reconstruct(frames).notes)


@pytest.mark.parametrize("shape", [(4, 4), (8, 8)])
@pytest.mark.parametrize(("kind", "level"), [("at its end", 3000.0), ("stuck", 200.0), ("dead", 0.0)])
@pytest.mark.filterwarnings("error")
@pytest.mark.long
def test_nothing_touches_and_one_reading_is_broken(shape: tuple[int, int], kind: str, level: float) -> None:
    """Of noise that nobody gave, where nothing touches: the reading was left out, the noise taken for nothing, and 1e5 N found in the rest."""
    array = pp.AreaArray(shape=shape, pitch=2e-3, depth=3e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(PAD, array)
    for seed in (1, 2, 4):
        rng = np.random.default_rng(seed)
        readings = 10.0 * rng.standard_normal((3, *shape))
        readings[tuple(rng.integers(n) for n in readings.shape)] = level
        touch = skin.reconstruct(readings)
        # 48 readings do not prove that their noise is all there is
        assert touch.status == (pp.Status.NO_CONTACT if shape == (8, 8) else pp.Status.UNDECIDED)
        assert np.abs(touch.interval(0.95, "force")).max() < 5e-3


def test_noise_with_a_few_that_stand_out_may_hide_contact() -> None:
    """A thin incompressible layer under displacement_z on a line: a linear model sees noise in the spikes at the ends of two contacts of 62 N/m."""
    frame = make_frame("modulus named", 63, seed=2203)
    touch = frame.skin.reconstruct(frame.readings)
    high = touch.interval(0.95, "force")[1][1]
    assert high > 0.5 * frame.load.force[1]
    plain = frame.described.skin([float(np.std(frame.readings))], uncertainty=frame.uncertainty)
    assert plain.reconstruct(frame.readings).interval(0.95, "force")[1][1] < 0.4 * frame.load.force[1]


def test_a_contact_that_is_pressed_hard_at_the_edge_is_said_to_go_on_there() -> None:
    """A cone of 444 N/m, a third of it outside a line: 323 N/m were found, a tenth of them outside, and nothing was said."""
    frame = make_frame("noise misstated", 123, seed=2203)
    assert said(frame.skin.reconstruct(frame.readings), ACROSS)


def test_what_noise_explains_ill_may_be_contact() -> None:
    """A contact of 12 N/m across the edge of a thin layer that reads as noise does one time in twelve."""
    frame = make_frame("clean", 55, seed=2203)
    touch = frame.skin.reconstruct(frame.readings, friction=frame.friction)
    assert touch.status == pp.Status.UNDECIDED
    assert 0.01 < float(touch.fit) < 0.1
    assert np.abs(touch.interval(0.95, "force")[1][1]) > 0.8 * frame.load.force[1]


@pytest.mark.filterwarnings("error")
@pytest.mark.long
def test_a_disc_of_shear_alone_overflows_nothing() -> None:
    """Noise with heavy tails over nothing: a disc without pressure had a penalty of 1e306, and its traction was not a number.

    Whatever is answered, the interval has numbers, and no note prints what is none.
    """
    array = pp.AreaArray(
        shape=(4, 4), pitch=5.06e-3, depth=2.8e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=44.0
    )
    readings = 44.0 * np.array(TAILS).reshape(3, 4, 4)
    touch = pp.Skin(pp.HalfSpace(youngs_modulus=6.4e4, poissons_ratio=0.48), array).reconstruct(readings)
    assert np.isfinite(np.asarray(touch.values)).all() or touch.status == pp.Status.UNEXPLAINED
    assert np.isfinite(touch.interval(0.95, "force")).all()
    assert not [note for note in touch.notes if "nan" in note]


TAILS = [
    *(-1.2, -0.1, 0.9, -0.6, 1.0, -1.1, 0.1, 2.8, 0.7, -0.7, 2.6, -0.6, -0.2, -0.2, -1.1, 0.2),
    *(2.6, 341.0, 0.6, 2.4, -1.3, 0.1, -1.9, 0.8, 0.7, -0.8, -0.9, 2.0, -9.2, 4.2, -0.3, 1.7),
    *(0.3, 0.9, -0.5, -1.2, 2.5, -3.5, 0.4, -0.6, 0.4, -1.2, 0.5, -1.7, -0.5, -7.5, 7.3, -2.4),
]
