"""A gel with a texture and no dots: displacement on a regular grid by optical flow, against rendered pictures."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage

import palpate as pp
from camera_scenes import GEL, gel_file
from palpate.camera import Displacements, Flow, Looks, Scene, Texture, View, follow

pytest.importorskip("cv2")

SCENE = Scene(pad=GEL, depth=0.5e-3, print=Texture(grain=0.15e-3), size=(160, 120), scale=0.1e-3, spacing=0.5e-3)
TEXTURE = 'texture = "1.5 mm"\nreference = 2'
BALL = pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0).shifted(1e-3, -0.7e-3).sliding(0.3, direction=2.0)


@pytest.mark.parametrize("looks", [{}, {"noise": 8.0, "compression": 60}])
def test_displacement_of_a_texture_has_a_standard_deviation_that_holds(looks: dict[str, float]) -> None:
    scene = SCENE.changed(looks=Looks(**looks))  # type: ignore[arg-type]
    rng = np.random.default_rng(3)
    contact = scene.skin.sample(BALL)
    flow = Flow(scene.picture(rng=rng), spacing=8.0)
    moved = flow.follow(scene.picture(contact, rng=rng))
    places = scene.view.places(flow.positions)
    true = scene.view.pixels(places + scene.displacement(contact, places)[:, :2]) - flow.positions
    kept = ~moved.lost
    assert kept.mean() > 0.95
    off, std = (moved.displacement - true)[kept], moved.std[kept]
    assert np.abs(true).max() > 3.5
    assert np.sqrt(np.mean(off**2)) < (0.1 if looks else 0.04)
    assert np.mean(np.abs(off) < 1.96 * std) > 0.92
    assert np.sqrt(np.mean(std**2)) < 2.0 * np.sqrt(np.mean(off**2))


def test_a_large_picture_is_compared_at_half_its_size_and_answers_in_its_own_pixels() -> None:
    rng = np.random.default_rng(0)
    spots = rng.random((60, 80)).repeat(8, axis=0).repeat(8, axis=1) * 200
    picture = np.round(spots).astype(np.uint8)
    flow = Flow(picture, spacing=40.0)
    moved = flow.follow(np.roll(picture, (4, -6), axis=(0, 1)))
    inner = ~moved.lost
    assert inner.mean() > 0.8
    assert np.allclose(moved.displacement[inner], [-6.0, 4.0], atol=0.02)
    assert np.diff(np.unique(flow.positions[:, 0])).round(6).tolist() == [40.0] * (
        len(np.unique(flow.positions[:, 0])) - 1
    )


@pytest.mark.long
def test_force_from_a_skin_file_that_says_texture(tmp_path: Path) -> None:
    path = tmp_path / "gel.toml"
    path.write_text(gel_file('scale = "0.1 mm"\n' + TEXTURE))
    rng = np.random.default_rng(1)
    contact = SCENE.skin.sample(BALL)
    load = contact.sum(axis=(1, 2)) * SCENE.surface.cell
    pictures = [SCENE.picture(part, rng=rng) for part in (None, None, 0.5 * contact, contact)]
    pictures.insert(3, np.zeros_like(pictures[0]))  # a black one
    with follow(pictures, path, rate=30.0, track=True) as touches:
        found = list(touches)
        assert isinstance(touches.readings.markers, Flow)
        assert list(touches.readings.faults.values()) == ["the picture is black"]
    low, high = found[-1].interval(0.95, "force")
    assert np.all((np.asarray(low) <= load) & (load <= np.asarray(high)))
    assert np.allclose(np.asarray(found[-1].force)[:2], load[:2], atol=0.03 * load[2])


def test_what_cannot_be_read_is_refused_with_what_to_do(tmp_path: Path) -> None:
    picture = SCENE.picture(rng=np.random.default_rng(0))
    with pytest.raises(pp.InvalidInput, match="at least 6 pixels apart in pictures 160 pixels wide; got 3"):
        Flow(picture, spacing=3.0)
    with pytest.raises(pp.InvalidInput, match="texture was found at 0 of 0 places; at least 9 are needed"):
        Flow(picture, spacing=100.0)
    with pytest.raises(pp.InvalidInput, match=r"texture was found at 0 of .* Read it more densely, film nearer"):
        Flow(np.full((120, 160), 120, dtype=np.uint8) + np.arange(160, dtype=np.uint8) // 16, spacing=10.0)
    view = View.scaled(1e-4, size=(160, 120))
    with pytest.raises(pp.InvalidInput, match="texture must be a positive distance between readings"):
        Displacements([picture] * 2, view, reference=1, rate=30.0, texture=-1e-3)
    path = tmp_path / "gel.toml"
    path.write_text(gel_file('pitch = "2 mm"\n' + TEXTURE))
    with pytest.raises(pp.InvalidInput, match="pitch is that of dots, and texture says that there are none"):
        follow([picture] * 3, path, rate=30.0)
    path.write_text(gel_file('scale = "0.1 mm"\n' + TEXTURE).replace('"1.5 mm"', '"-1 mm"'))
    with pytest.raises(pp.InvalidInput, match="texture must be"):
        follow([picture] * 3, path, rate=30.0)


def test_pictures_that_tell_nothing_say_why_and_the_next_goes_on() -> None:
    rng = np.random.default_rng(0)
    picture = SCENE.picture(rng=rng)
    flow = Flow(picture, spacing=10.0)
    other = SCENE.changed(print=Texture(grain=0.15e-3, seed=5)).picture(rng=rng)
    blurred = np.full_like(picture, 150)
    blurred[:] = picture.mean(axis=0, keepdims=True)
    for image, why in (
        (None, "there is no picture"),
        (picture[:60], "the picture is 160 x 60, the reference 160 x 120"),
        (np.zeros_like(picture), "the picture is black"),
        (other, "look as they did in the reference"),
        (blurred, "(look as they did in the reference|the picture is blurred)"),
    ):
        moved = flow.follow(image)
        assert moved.lost.all()

        assert re.search(why, moved.fault), moved.fault
    assert not flow.follow(SCENE.picture(rng=rng)).lost.any()


@pytest.mark.long
def test_thousands_of_places_are_read() -> None:
    """OpenCV takes no more than 32767 rows in one call."""
    rng = np.random.default_rng(0)
    picture = np.round(rng.random((900, 320)).repeat(2, axis=0)[:900] * 200).astype(np.uint8)
    flow = Flow(picture, spacing=6.0)
    assert len(flow.positions) > 32767 / 9
    assert np.nanmax(np.abs(flow.follow(picture).displacement)) < 0.01


def test_windows_between_pixels_are_the_same_with_any_opencv() -> None:
    """OpenCV 4 rounds places to 1/32 of a pixel; there NumPy interpolates."""
    from palpate.camera.windows import _between, windows_of

    rng = np.random.default_rng(0)
    level = rng.integers(0, 255, (50, 60)).astype(np.uint8)
    centres, slopes = rng.uniform(-3.0, 62.0, (30, 2)), rng.uniform(-0.1, 0.1, (30, 2, 2))
    found = windows_of(level, centres, 4, slopes)
    arms = np.stack(np.meshgrid(np.arange(-4.0, 5.0), np.arange(-4.0, 5.0)))
    at = centres[:, :, None, None] + arms + np.einsum("nij,jyx->niyx", slopes, arms)
    plain = _between(level, at[:, 0].astype(np.float32), at[:, 1].astype(np.float32))
    assert np.allclose(found, plain, atol=0.6)  # 255 levels; those of OpenCV are rounded
    flat = np.tile(np.arange(60.0), (50, 1)).astype(np.uint8)
    assert np.allclose(
        _between(flat, np.full((1, 1, 1), 7.37, np.float32), np.full((1, 1, 1), 3.2, np.float32)), 7.37, atol=1e-5
    )


def test_places_that_come_near_any_edge_of_a_wide_picture_are_lost() -> None:
    """Wide pictures are compared at half their size: the right and the lower edge are where that ends."""
    rng = np.random.default_rng(0)
    grain = scipy.ndimage.gaussian_filter(rng.standard_normal((480, 640)), 3.0, mode="wrap")
    picture = np.clip(128.0 + 35.0 * grain / grain.std(), 0.0, 255.0).astype(np.uint8)
    flow = Flow(picture, spacing=24.0)
    reach = 2 * flow._reach
    for shift in ((18, 18), (-18, -18)):
        now = np.roll(picture, shift, axis=(1, 0))
        moved = flow.follow(now)
        flow.reset()
        places = flow.positions + np.asarray(shift)
        inside = ((places >= reach + 2) & (places <= np.array([640, 480]) - 3 - reach)).all(axis=1)
        outside = ((places < reach - 2) | (places > np.array([640, 480]) + 1 - reach)).any(axis=1)
        assert outside.sum() > 10
        assert moved.lost[outside].all()
        assert moved.lost[inside].mean() < 0.05
        np.testing.assert_allclose(np.nanmedian(moved.displacement, axis=0), shift, atol=0.05)


def test_what_is_white_at_rest_is_no_new_glare() -> None:
    """Of the mean of several pictures it was forgotten, and half of the places of a bright texture were lost in each."""
    bright = SCENE.picture(rng=np.random.default_rng(0)).astype(float) * 1.5
    shown = [np.clip(bright, 0, 255).astype(np.uint8)] * 5
    assert (shown[0] >= 253).mean() > 0.2
    flow = Flow(shown, spacing=10.0)
    assert flow.follow(shown[0]).lost.mean() < 0.05
