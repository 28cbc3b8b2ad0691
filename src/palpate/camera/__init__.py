"""From pictures of a gel to touch. Needs palpate[camera] (OpenCV, PyAV, tifffile).

In: a video, a folder, a stack or a camera; a gel with dots, with a texture, or lit in colours.
Out: displacements (or slopes) with standard deviations, and touches.
Open first: `touches.py`.
"""

from palpate.camera.colour import (
    ColourTouches,
    Relief,
    SlopeModel,
    draw_colours,
    draw_relief,
    feel,
    learn_slopes,
    read_slopes,
    surface_skin,
    write_slopes,
)
from palpate.camera.depthmap import DepthMap
from palpate.camera.displacements import Displacements, Reading, Stage
from palpate.camera.dots import Found, Print, fault_of, find_dots
from palpate.camera.flow import Flow
from palpate.camera.markers import Markers
from palpate.camera.overlay import overlay
from palpate.camera.pictures import Picture, Pictures, is_pictures, open_pictures, write_video
from palpate.camera.region import Region
from palpate.camera.render import Dots, Looks, Scene, Texture, Truth, dot_grid
from palpate.camera.touches import Touches, follow, gel_skin
from palpate.camera.traces import ForceTrace, read_force_trace
from palpate.camera.weighing import Weighed, weigh
from palpate.camera.windows import Moved
from palpate.sensing.view import Lens, View, grey

__all__ = [
    "ColourTouches",
    "DepthMap",
    "Displacements",
    "Dots",
    "Flow",
    "ForceTrace",
    "Found",
    "Lens",
    "Looks",
    "Markers",
    "Moved",
    "Picture",
    "Pictures",
    "Print",
    "Reading",
    "Region",
    "Relief",
    "Scene",
    "SlopeModel",
    "Stage",
    "Texture",
    "Touches",
    "Truth",
    "View",
    "Weighed",
    "dot_grid",
    "draw_colours",
    "draw_relief",
    "fault_of",
    "feel",
    "find_dots",
    "follow",
    "gel_skin",
    "grey",
    "is_pictures",
    "learn_slopes",
    "open_pictures",
    "overlay",
    "read_force_trace",
    "read_slopes",
    "surface_skin",
    "weigh",
    "write_slopes",
    "write_video",
]
