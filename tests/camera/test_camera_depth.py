"""A map of the surface's depth beside dots in the plane: what was ambiguous is told."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.sensing.uncertainty import EXACT

pytest.importorskip("cv2")

from palpate.camera import DepthMap, Dots, Scene, dot_grid, follow

GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
ARRAY = pp.AreaArray(shape=(6, 8), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
SCENE = Scene(pad=GEL, depth=0.5e-3, print=Dots(dot_grid((6, 8), 2e-3), 0.8e-3), size=(200, 150), scale=0.09e-3)
BALL = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.2).shifted(0.4e-3, -0.2e-3).sliding(0.3, direction=0.7)
TRUE = 1.2 * np.array([0.3 * np.cos(0.7), 0.3 * np.sin(0.7), 1.0])
PLACES = np.stack(np.meshgrid(np.arange(-6, 9) * 0.5e-3, np.arange(-7, 7) * 0.5e-3), axis=-1).reshape(-1, 2)
STD = 5e-6


def pressed() -> np.ndarray:
    """u_z of the surface [m] where the ball touches, with noise; NaN elsewhere."""
    array = pp.ScatteredArray(positions=PLACES, depth=0.0, channels=["displacement_z"])
    true = np.asarray(pp.Skin(GEL, array, surface=SCENE.surface).sense(SCENE.skin.sample(BALL)))[0]
    noisy = true + STD * np.random.default_rng(0).standard_normal(true.shape)
    return np.where(np.hypot(PLACES[:, 0] - 0.4e-3, PLACES[:, 1] + 0.2e-3) < 2.5e-3, noisy, np.nan)


@pytest.mark.long
def test_depth_narrows_the_normal_force_and_holds_it() -> None:
    pictures = list(SCENE.pictures([None] * 3 + [BALL]))
    deep = pressed()

    def depth(index: int) -> np.ndarray:
        return deep if index == 3 else np.full(len(PLACES), np.nan)

    found, known = {}, pp.Skin(GEL, ARRAY, uncertainty=EXACT)
    for label, given in (("alone", None), ("with depth", DepthMap(positions=PLACES, depth=depth, std=STD))):
        with follow(pictures, known, view=SCENE.view, rate=30.0, reference=3, every=3, depth_map=given) as touches:
            first, last = list(touches)
        assert not bool(first.touching)
        assert first.surface == last.surface
        found[label] = [np.asarray(end) for end in last.interval(0.95, of="force")]
        low, high = found[label]
        assert ((low < TRUE) & (high > TRUE)).all()
        if given is not None:
            assert not any("do not separate pressure from shear" in note for note in last.notes)
            assert float(last.force[2]) == pytest.approx(1.2, rel=0.06)
    alone, beside = ((high - low)[2] for low, high in found.values())
    assert beside < 0.6 * alone


def test_one_place_of_each_cell_is_taken_and_none_past_the_dots() -> None:
    dots = np.array([[-2e-3, -2e-3], [2e-3, 2e-3]])
    surface = pp.AreaGrid(shape=(20, 20), spacing=1e-3)
    got = DepthMap(positions=PLACES, depth=np.full((1, len(PLACES)), 1e-4), std=STD).plane(0, dots, surface)
    assert got is not None
    array, readings = got
    assert readings.shape == (1, len(array.points))
    assert 12 < len(array.points) < 30  # of 4 x 4 mm
    assert (np.abs(array.points) <= 2e-3 + 1e-12).all()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"positions": PLACES[:, :1]}, "shape"),
        ({"std": 0.0}, "positive"),
        ({"depth": np.zeros((2, 3))}, "one depth for each place"),
    ],
)
def test_maps_that_cannot_be_meant_are_refused(given: dict[str, object], says: str) -> None:
    whole = {"positions": PLACES, "depth": np.zeros((2, len(PLACES))), "std": STD} | given
    with pytest.raises(pp.InvalidInput, match=says):
        DepthMap(**whole)  # type: ignore[arg-type]


@pytest.mark.long
def test_a_picture_without_a_map_and_a_tracker_are_refused() -> None:
    given = DepthMap(positions=PLACES, depth=np.full((2, len(PLACES)), np.nan), std=STD)
    with pytest.raises(pp.InvalidInput, match="2 pictures"):
        given.of(2)
    with pytest.raises(pp.Unsupported, match="leave out depth_map"):
        follow(
            list(SCENE.pictures([None] * 3)),
            pp.Skin(GEL, ARRAY),
            view=SCENE.view,
            reference=3,
            track=True,
            depth_map=given,
        )
