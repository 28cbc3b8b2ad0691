from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)


def area(**changes: Any) -> pp.AreaArray:
    options = {
        "shape": (8, 9),
        "pitch": 1e-3,
        "depth": 2e-3,
        "channels": ["stress_xz", "stress_yz", "stress_zz"],
    } | changes
    return pp.AreaArray(**options)


def test_default_surface_covers_and_reaches_past_the_array() -> None:
    skin = pp.Skin(PAD, area())
    assert skin.surface.x[0] <= -4e-3 - 4e-3 + 1e-12
    assert skin.surface.spacings == (1e-3, 1e-3)
    coarse = pp.Skin(PAD, area(pitch=3e-3, depth=1e-3))
    np.testing.assert_allclose(coarse.surface.spacings, 1e-3)
    at_surface = pp.Skin(PAD, area(depth=0.0, channels=["displacement_x", "displacement_y"]))
    assert at_surface.surface.spacings == (1e-3, 1e-3)
    # a cell is centred above each taxel
    assert np.abs(coarse.surface.x[:, None] - area(pitch=3e-3).grid.x).min(axis=0).max() < 1e-12


def test_planes_of_one_shape_are_joined_others_are_a_list() -> None:
    skin = pp.Skin(PAD, [area(channels=["stress_zz"]), area(channels=["strain_xy", "stress_zz"], depth=1e-3)])
    readings = skin.sense(np.zeros((4, 3, *skin.surface.shape)))
    assert readings.shape == (4, 3, 8, 9)
    mixed = pp.Skin(PAD, [area(channels=["stress_zz"]), area(channels=["stress_zz"], shape=(4, 5))])
    parts = mixed.sense(np.zeros((4, 3, *mixed.surface.shape)))
    assert [p.shape for p in parts] == [(4, 1, 8, 9), (4, 1, 4, 5)]
    assert mixed.reconstruct(parts, components=["z"]).values.shape == (4, 3, *mixed.surface.shape)


def test_noise_is_the_arrays_own() -> None:
    skin = pp.Skin(PAD, area(noise=[10.0, 20.0, 30.0]))
    readings = skin.sense(np.zeros((200, 3, *skin.surface.shape)), rng=np.random.default_rng(0))
    np.testing.assert_allclose(readings.std(axis=(0, 2, 3)), [10, 20, 30], rtol=0.03)
    with pytest.raises(pp.InvalidInput, match="no noise"):
        pp.Skin(PAD, area()).sense(np.zeros((3, *pp.Skin(PAD, area()).surface.shape)), rng=np.random.default_rng(0))


@pytest.mark.long
def test_dead_taxels_are_not_heard() -> None:
    mask = np.ones((8, 9), dtype=bool)
    mask[2, 3] = mask[7, 8] = False
    skin = pp.Skin(PAD, area(mask=mask, noise=300.0))
    contact = solutions.hertz_point(contact_radius=2e-3, force=0.5)
    readings = skin.sense(contact, rng=np.random.default_rng(0))
    assert np.isnan(readings[:, ~mask]).all()
    first = skin.reconstruct(readings).values
    readings[:, ~mask] = 1e30
    np.testing.assert_array_equal(skin.reconstruct(readings).values, first)
    assert pp.Skin(PAD, area().masked(mask)).planes[0].valid.sum() == 70


@pytest.mark.parametrize(
    ("readings", "word"),
    [
        (np.zeros((3, 9, 8)), "shape"),
        (np.zeros((2, 8, 9)), "shape"),
        (np.zeros((0, 3, 8, 9)), "empty"),
        (np.full((3, 8, 9), np.nan), "not finite"),
        (np.full((3, 8, 9), np.inf), "not finite"),
        (np.full((3, 8, 9), 1e8), "units"),
        (np.zeros((3, 8, 9), dtype=complex), "real"),
        (np.array([["a"]]), "real numbers|array"),
        ("readings", "array"),
        ([[1, 2], [3]], "rectangular"),
    ],
)
def test_bad_readings(readings: Any, word: str) -> None:
    with pytest.raises(pp.InvalidInput, match=word):
        pp.Skin(PAD, area()).reconstruct(readings)


def test_a_dead_taxel_is_named() -> None:
    readings = np.zeros((3, 8, 9))
    readings[1, 4, 5] = np.nan
    with pytest.raises(pp.InvalidInput, match=r"1 of 72 taxels \(first at index \(4, 5\)\).*masked"):
        pp.Skin(PAD, area()).reconstruct(readings)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: area(shape=(8,)), "shape"),
        (lambda: area(shape=(1, 1)), "shape"),
        (lambda: area(shape=(8.0, 9)), "whole"),
        (lambda: area(pitch=0.0), "pitch"),
        (lambda: area(pitch=(1e-3, -1e-3)), "pitch"),
        (lambda: area(depth=-1e-3), "depth"),
        (lambda: area(depth="2 mm"), "depth"),
        (lambda: area(channels="stress_zz"), "list"),
        (lambda: area(channels=[]), "empty"),
        (lambda: area(channels=["stress_zz", "stress_zz"]), "twice"),
        (lambda: area(channels=["pressure"]), "not a channel"),
        (lambda: area(noise=0.0), "noise"),
        (lambda: area(noise=[1.0, 2.0]), "one per channel"),
        (lambda: area(aperture=-1.0), "aperture"),
        (lambda: area(mask=np.zeros((8, 9), dtype=bool)), "no working"),
        (lambda: area(mask=np.ones((9, 8), dtype=bool)), "mask"),
        (lambda: pp.LineArray(count=5, pitch=1.0, depth=1.0, channels=["displacement_y"]), "vanishes"),
        (lambda: pp.LineArray(count=True, pitch=1.0, depth=1.0, channels=["stress_zz"]), "count"),
        (lambda: pp.ScatteredArray(positions=[[0, 0]], depth=1.0, channels=["stress_zz"]), "positions"),
        (lambda: pp.ScatteredArray(positions=[[0, 0], [0, 0]], depth=1.0, channels=["stress_zz"]), "twice"),
        (lambda: pp.ScatteredArray(positions=[[0, 0], [0, np.nan]], depth=1.0, channels=["stress_zz"]), "finite"),
        (lambda: pp.Skin("gel", area()), "pad"),  # type: ignore[arg-type]
        (lambda: pp.Skin(PAD, []), "array"),
        (lambda: pp.Skin(PAD, area(), boundary="open"), "boundary"),  # type: ignore[arg-type]
        (lambda: pp.Skin(PAD, area(), surface=pp.LineGrid(count=5, spacing=1.0)).operator, "AreaGrid"),
        (
            lambda: pp.Skin(PAD, area(), surface=pp.AreaGrid(shape=(9, 9), spacing=1e-3), boundary="periodic").operator,
            "own grid",
        ),
        (lambda: pp.Skin(PAD, area()).reconstruct(np.zeros((3, 8, 9)), components=["w"]), "components"),
        (lambda: pp.Skin(PAD, area()).sense(np.zeros((3, 2, 2))), "traction must have shape"),
        (lambda: pp.Skin(PAD, area()).sense(solutions.strip(half_width=1, traction=1)), "line contact"),
    ],
)
def test_bad_descriptions(make: Any, word: str) -> None:
    with pytest.raises(pp.PalpateError, match=word):
        make()


@pytest.mark.long
def test_a_batch_is_its_frames() -> None:
    skin = pp.Skin(PAD, area(noise=300.0))
    contact = solutions.hertz_point(contact_radius=2e-3, force=0.5).sliding(0.2)
    frames = np.stack([skin.sense(contact, rng=np.random.default_rng(i)) for i in range(2)]).reshape(2, 1, 3, 8, 9)
    batch = skin.reconstruct(frames)
    assert batch.values.shape == (2, 1, 3, *skin.surface.shape)
    one = skin.reconstruct(frames[1, 0])
    np.testing.assert_allclose(batch.values[1, 0], one.values, atol=1e-9 * np.abs(one.values).max())
    assert batch.parameter is not None
    assert batch.parameter.shape == (2, 1)


@pytest.mark.long
def test_noise_and_zero_are_given_with_the_readings() -> None:
    def made(noise: float | None) -> pp.Skin:
        pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        channels = ["stress_xz", "stress_zz"]
        return pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=channels, noise=noise))

    rng = np.random.default_rng(0)
    plain, known = made(None), made(40.0)
    press = known.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0), rng=rng)
    offset = 300.0 + 20.0 * rng.standard_normal((2, 15))
    rest = offset + 40.0 * rng.standard_normal((40, 2, 15))
    expected = known.reconstruct(press)
    for noise in (40.0, [40.0, 40.0], np.array([40.0, 40.0])):
        touch = plain.reconstruct(press, noise=noise)
        np.testing.assert_array_equal(touch.values, expected.values)
        np.testing.assert_array_equal(touch.noise_std, expected.noise_std)
    np.testing.assert_allclose(plain.reconstruct(press + offset, zero=rest).noise_std, 40.0, rtol=0.15)
    # a given noise counts for more than that of the frames at rest
    np.testing.assert_allclose(plain.reconstruct(press + offset, zero=rest, noise=70.0).noise_std, 70.0, rtol=0.05)

    with plain.track(noise=40.0) as tracker, known.track() as same:
        np.testing.assert_array_equal(tracker.step(press).values, same.step(press).values)
    with plain.track(zero=rest) as tracker:
        touch = tracker.step(press + offset)
        np.testing.assert_allclose(touch.noise_std, 40.0, rtol=0.15)
        assert touch.force[1] == pytest.approx(10.0, rel=0.05)
    with pytest.raises(pp.InvalidInput, match="leave one out"):
        plain.track(zero=rest, baseline=5)
    with pytest.raises(pp.InvalidInput, match=r"one per channel \(2: stress_xz, stress_zz\)"):
        plain.reconstruct(press, noise=[1.0, 2.0, 3.0])
