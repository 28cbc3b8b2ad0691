"""The gel that tests and benchmarks of cameras share: 5 x 7 dots, 2 mm apart, 0.5 mm deep, filmed with 160 x 120 pixels."""

from __future__ import annotations

from typing import Any

import palpate as pp

GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
BALL = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.5).sliding(0.3)


def gel_file(camera: str, *, surface: str = "", thickness: str = "3.5 mm", modulus: str = "300 kPa") -> str:
    """The text of a skin.toml of `GEL` and its dots, with these lines of the sections [camera] and [surface]."""
    return f"""\
[pad]
kind = "bonded_layers"

[[pad.layer]]
thickness = "{thickness}"
youngs_modulus = "{modulus}"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"
depth = "0.5 mm"
channels = ["displacement_x", "displacement_y"]
""" + "".join(f"\n[{name}]\n{lines}\n" for name, lines in (("surface", surface), ("camera", camera)) if lines)


def small_scene(pad: pp.BondedLayers = GEL, *, columns: int = 160, rows: int = 120, **other: Any) -> Any:
    """16 mm of this gel in a picture of so many pixels; ``other`` are further arguments of `Scene`, such as looks."""
    from palpate.camera import Dots, Scene, dot_grid

    dots = Dots(dot_grid((5, 7), 2e-3), 0.8e-3)
    return Scene(pad=pad, depth=0.5e-3, print=dots, size=(columns, rows), scale=16e-3 / columns, **other)
