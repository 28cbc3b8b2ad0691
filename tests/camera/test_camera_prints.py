"""What is a print and what is not, and where in a picture the gel is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from camera_scenes import gel_file
from long_runs import long_runs

cv2 = pytest.importorskip("cv2")
pytest.importorskip("av")

from palpate.camera import (  # noqa: E402
    Displacements,
    Dots,
    Flow,
    Looks,
    Region,
    Scene,
    Texture,
    dot_grid,
    find_dots,
    follow,
)

GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
SIZE = (320, 240)
BASE = Scene(pad=GEL, depth=0.5e-3, print=Dots(dot_grid((7, 10), 2e-3), 0.7e-3), size=SIZE, scale=0.0634e-3)
VIEW = BASE.view


def smooth(*, dust: int = 0, rim: bool = False, bright: bool = False, seed: int = 0, size: float = 1.6) -> np.ndarray:
    """A gel without dots: light that falls off, dust of many sizes at random, the dark rim of its housing."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    light = 150 + 40 * (x / SIZE[0] - 0.5) - 30 * (y / SIZE[1] - 0.5)
    for _ in range(dust):
        wide = size * np.exp(0.5 * rng.standard_normal())
        spot = np.exp(-((x - rng.uniform(0, SIZE[0])) ** 2 + (y - rng.uniform(0, SIZE[1])) ** 2) / (2 * wide**2))
        light *= 1 - (-0.6 if bright else 1.0) * rng.uniform(0.1, 0.6) * spot
    if rim:
        light = housed(light)
    return np.clip(light + 2 * rng.standard_normal(light.shape), 0, 255).astype(np.uint8)


def housed(picture: np.ndarray) -> np.ndarray:
    """The middle of a picture in a black housing: an oblong of 84 % of its width and 80 % of its height."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    gel = ((x - 159.5) / (0.42 * SIZE[0])) ** 8 + ((y - 119.5) / (0.4 * SIZE[1])) ** 8 < 1
    dark = 12 + 2 * np.random.default_rng(1).standard_normal(picture.shape)
    return np.where(gel if picture.ndim == 2 else gel[..., None], picture, dark)


@pytest.mark.parametrize("rim", [False, True])
@pytest.mark.parametrize("bright", [False, True])
@pytest.mark.parametrize("dust", [10, 80])
@pytest.mark.long
def test_dust_and_the_rim_of_a_gel_are_no_print(dust: int, bright: bool, rim: bool) -> None:
    """Spots of many sizes at random, edges in rows: a smooth gel was read as dots, and 25 N as 0.3."""
    picture = smooth(dust=dust, bright=bright, rim=rim)
    for region in {None, Region.found(picture)}:
        with pytest.raises(pp.InvalidInput, match="no dots found"):
            find_dots(picture, region=region)


def test_a_gel_without_dots_is_refused_with_what_to_do() -> None:
    pictures = [smooth(dust=60, rim=True, seed=1)] * 6
    with pytest.raises(pp.InvalidInput, match=r"as dust, scratches and edges do. A gel needs printed dots, or a tex"):
        Displacements(pictures, VIEW, rate=30.0)


@pytest.mark.parametrize("seed", [0, *long_runs(1)])
def test_dots_at_random_that_keep_a_distance_are_a_print(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places: list[np.ndarray] = []
    while len(places) < 50:
        one = rng.uniform([-9e-3, -6.8e-3], [9e-3, 6.8e-3])
        if all(np.hypot(*(one - other)) > 1.1e-3 for other in places):
            places.append(one)
    found = find_dots(BASE.changed(print=Dots(np.array(places), 0.6e-3)).picture())
    assert len(found.positions) == 50


def test_a_print_between_dust_is_one() -> None:
    dirty = BASE.picture().astype(float) * smooth(dust=40, seed=5) / 150
    found = find_dots(np.clip(dirty, 0, 255).astype(np.uint8))
    assert int(found.whole.sum()) >= 68


@pytest.mark.long
def test_the_rim_of_the_gel_is_found_and_no_dots_beyond_it() -> None:
    picture = np.clip(housed(BASE.picture()), 0, 255).astype(np.uint8)
    region = Region.found(picture)
    assert region is not None
    assert 0.55 < region.share < 0.68  # of 0.66
    found = find_dots(picture, region=region)
    truth = BASE.truth().rest
    far = np.hypot(*(found.positions[:, None] - truth[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(found.positions) == 40  # 5 x 8 of 7 x 10
    assert far.max() < 0.5
    with Displacements([picture] * 5, VIEW, rate=30.0) as readings:
        assert readings.region is not None
        assert readings.positions.shape == (40, 2)


@pytest.mark.parametrize("looks", [{}, {"gradient": (0.6, -0.5)}, {"colour": 1.0}, {"glare": [(100, 80, 20)]}])
@pytest.mark.long
def test_a_picture_that_the_gel_fills_has_no_rim(looks: dict[str, Any]) -> None:
    """Light that falls off towards the corners, glare and dots that touch the picture's edge are none."""
    assert Region.found(BASE.changed(looks=Looks(**looks)).picture()) is None
    speckled = BASE.changed(print=Texture(0.2e-3), looks=Looks(**looks)).picture()
    assert Region.found(speckled) is None


@pytest.mark.long
def test_dots_are_sought_within_a_region_that_is_given(tmp_path: Path) -> None:
    """Two corners of a rectangle, or a polygon, in pixels of the size that the section names."""
    text = gel_file('scale = "0.1268 mm"\nsize = [160, 120]\nreference = 2\nroi = ROI', thickness="4 mm")
    pictures = [BASE.picture(rng=np.random.default_rng(i)) for i in range(3)]
    inside = BASE.truth().rest
    for roi, count in (
        ("[[0, 0], [80, 119]]", int((inside[:, 0] < 160).sum())),
        ("[[0, 0], [159, 0], [159, 60], [0, 60]]", int((inside[:, 1] < 110).sum())),
    ):
        path = tmp_path / "gel.toml"
        path.write_text(text.replace("ROI", roi))
        with follow(pictures, path, rate=30.0, track=True) as touches:
            assert len(touches.readings.positions) == count
    path.write_text(text.replace("ROI", "[[300, 200], [310, 210]]"))
    with pytest.raises(pp.InvalidInput, match="roi holds 0 % of the pictures, which are 320 x 240"):
        follow(pictures, path, rate=30.0)
    path.write_text(text.replace("ROI", "[[300, 200]]"))
    with pytest.raises(pp.InvalidInput, match="two of a rectangle"):
        follow(pictures, path, rate=30.0)


@pytest.mark.long
def test_light_on_a_smooth_gel_is_no_texture() -> None:
    """It is as sharp in every picture of a gel at rest, and does not move with the gel."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    shade = 150 + 20 * np.sin(x / 25) * np.cos(y / 20)
    lit = [np.clip(shade + 2 * rng.standard_normal(shade.shape), 0, 255).astype(np.uint8) for _ in range(5)]
    with pytest.raises(pp.InvalidInput, match=r"texture was found at \d+ of 266 places; .*a smooth gel needs spots"):
        Flow(lit, spacing=16.0)
    printed = BASE.changed(print=Texture(0.2e-3), looks=Looks(contrast=0.2)).pictures([None] * 5)
    assert len(Flow(list(printed), spacing=16.0).positions) > 240


@pytest.mark.long
def test_texture_is_read_where_it_stays_at_rest() -> None:
    """A part of the picture that changes while nothing touches (a belt behind the gel) is left out; where most of it does, it is refused."""
    rng = np.random.default_rng(0)
    still = BASE.changed(print=Texture(0.2e-3)).picture()
    moving = [BASE.changed(print=Texture(0.2e-3, seed=s)).picture(rng=rng) for s in range(1, 6)]
    for edge, good in ((230, True), (60, False)):
        pictures = [np.where(np.arange(SIZE[0]) < edge, still, other) for other in moving]
        if good:
            with Displacements(pictures, VIEW, rate=30.0, texture=1e-3) as readings:
                assert readings.markers.positions[:, 0].max() < edge + 16
                assert len(readings.positions) > 150
        else:
            with pytest.raises(pp.InvalidInput, match="are still there in the other pictures of the gel at rest"):
                Displacements(pictures, VIEW, rate=30.0, texture=1e-3)
