"""Gels without dots: colour to slope, slope to depth, depth to touch."""

from palpate.camera.colour.files import read_slopes, write_slopes
from palpate.camera.colour.learning import learn_slopes
from palpate.camera.colour.model import Relief, SlopeModel
from palpate.camera.colour.picture import draw_colours, draw_relief
from palpate.camera.colour.touching import ColourTouches, feel, surface_skin

__all__ = [
    "ColourTouches",
    "Relief",
    "SlopeModel",
    "draw_colours",
    "draw_relief",
    "feel",
    "learn_slopes",
    "read_slopes",
    "surface_skin",
    "write_slopes",
]
