"""The scene that tests of cameras share: 5 x 7 dots, 2 mm apart, 0.5 mm deep, filmed with 160 x 120 pixels."""

from __future__ import annotations

from typing import Any

import palpate as pp


def small_scene(pad: pp.BondedLayers, **other: Any) -> Any:
    """On this gel; ``other`` says what else is known of the scene, such as looks."""
    from palpate.camera import Dots, Scene, dot_grid

    return Scene(
        pad=pad, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3, **other
    )
