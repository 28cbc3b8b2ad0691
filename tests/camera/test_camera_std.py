"""Displacement of each dot with a standard deviation of its own, against rendered pictures."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.camera import Dots, Looks, Markers, Scene, dot_grid

pytest.importorskip("cv2")

GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
SCENE = Scene(
    pad=GEL, depth=0.5e-3, print=Dots(dot_grid((7, 9), 2e-3), 0.8e-3), size=(320, 240), scale=0.06e-3, spacing=0.45e-3
)


def errors(force: float, diameter: float, *, prints: int = 1, **looks: object) -> tuple[np.ndarray, np.ndarray]:
    """Error and standard deviation [pixels] of the dots that are kept; some are halved, two touch."""
    off, std = [], []
    for seed in range(prints):
        rng = np.random.default_rng((41, seed))
        grid = dot_grid((7, 9), 2e-3, jitter=2e-5, rng=rng)
        grid[12] = grid[13] - [1.02 * diameter, 0.0]
        halved = tuple(int(i) for i in rng.choice([2, 20, 24, 40, 44, 60], 3, replace=False))
        scene = SCENE.changed(print=Dots(grid, diameter, halved=halved), looks=Looks(**looks))  # type: ignore[arg-type]
        ball = (
            pp.solutions.hertz_point(contact_radius=2.5e-3, force=force)
            .shifted(*rng.uniform(-2e-3, 2e-3, 2))
            .sliding(0.3)
        )
        contact = scene.skin.sample(ball)
        markers = Markers(scene.picture(rng=rng))
        moved = markers.follow(scene.picture(contact, rng=rng))
        places = scene.view.places(markers.positions)
        true = scene.view.pixels(places + scene.displacement(contact, places)[:, :2]) - markers.positions
        kept = ~moved.lost
        assert kept.mean() > 0.9
        off.append((moved.displacement - true)[kept])
        std.append(moved.std[kept])
    return np.concatenate(off), np.concatenate(std)


@pytest.mark.parametrize(
    ("force", "diameter", "most", "looks"),
    [
        (0.5, 0.8e-3, 0.04, {"noise": 8.0}),
        *long_runs((3.0, 1.3e-3, 0.055, {}), (1.0, 0.4e-3, 0.04, {"compression": 60})),
    ],
)
def test_each_dot_has_a_standard_deviation_of_its_own_that_holds(
    force: float, diameter: float, most: float, looks: dict[str, float]
) -> None:
    """Some halved, two touching; beside a contact the print is stretched by a tenth, and large dots move as their rims do."""
    off, std = errors(force, diameter, **looks)
    size = np.abs(off) / std
    assert np.mean(size < 1.96) > 0.93
    assert size.max() < 5.0
    # nor is it so wide that it says nothing
    assert np.sqrt(np.mean(std**2)) < 3.8 * np.sqrt(np.mean(off**2))
    assert np.sqrt(np.mean(off**2)) < most
