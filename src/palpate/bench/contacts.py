"""Contacts with known traction: in line contact as exact cell means, in area contact as patches."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing import LineGrid
from palpate.sensing.grids import Grid

__all__ = [
    "AREA_PATCHES",
    "CROSSING",
    "FRICTION",
    "LINE_CONTACTS",
    "SHEARED",
    "Patch",
    "Traction",
    "area_contact",
    "line_contact",
]

Traction = Callable[[Grid], Floats]


def line_contact(*parts: tuple[str, float, float, float]) -> Traction:
    """Return the sum of (kind, centre, half-width, size) in line contact, as exact cell means."""

    def cells(grid: Grid) -> Floats:
        if not isinstance(grid, LineGrid):
            raise InvalidInput(f"a line contact needs a LineGrid; got {type(grid).__name__}.")
        out = np.zeros((2, grid.count))
        for kind, center, half_width, size in parts:
            u = np.clip((grid.edges - center) / half_width, -1, 1)
            integral = {
                "cylinder": 0.5 * (u * np.sqrt(1 - u**2) + np.arcsin(u)),
                "punch": np.arcsin(u),
                "strip": u,
                "wedge": np.where(u < 0, u + u**2 / 2, u - u**2 / 2),
                "tilted": u + u**2 / 2,
                "bump": u - u**3 / 3,
            }[kind]
            out[1] += size * half_width * np.diff(integral) / grid.spacing
        return out

    return cells


@dataclass(frozen=True)
class Patch:
    """One contact patch in area contact."""

    kind: str
    center: tuple[float, float]
    size: tuple[float, float]
    peak: float = 1.0
    angle: float = 0.0

    def __call__(self, x: Floats, y: Floats) -> Floats:
        c, s = math.cos(self.angle), math.sin(self.angle)
        u = ((x - self.center[0]) * c + (y - self.center[1]) * s) / self.size[0]
        v = (-(x - self.center[0]) * s + (y - self.center[1]) * c) / self.size[1]
        r2 = u**2 + v**2
        shapes: dict[str, Callable[[], Floats]] = {
            "ball": lambda: np.sqrt(np.clip(1 - r2, 0, None)),
            "punch": lambda: np.where(r2 < 1, 0.5 / np.sqrt(np.clip(1 - r2, 0.02, None)), 0.0),
            "block": lambda: np.where((np.abs(u) < 1) & (np.abs(v) < 1), 1.0, 0.0),
            "ring": lambda: np.where((r2 < 1) & (r2 > 0.44), 1.0, 0.0),
            "cone": lambda: np.clip(1 - np.sqrt(r2), 0, None),
            "tilted": lambda: np.where((np.abs(u) < 1) & (np.abs(v) < 1), 0.5 + 0.5 * u, 0.0),
        }
        return self.peak * shapes[self.kind]()


def area_contact(*patches: Patch, shear: str = "", friction: float = 0.0) -> Traction:
    """Patches in area contact with shear inside the friction cone: "slide", "stick" (growing outwards) or "twist"."""

    def cells(grid: Grid) -> Floats:
        y, x = np.meshgrid(*grid.axes, indexing="ij")
        p = sum((patch(x, y) for patch in patches), np.zeros(grid.shape))
        out = np.zeros((3, *grid.shape))
        out[2] = p
        if shear == "slide":
            out[0], out[1] = 0.8 * friction * p, 0.6 * friction * p
        elif shear == "stick":
            r2 = ((x - patches[0].center[0]) / patches[0].size[0]) ** 2 + (
                (y - patches[0].center[1]) / patches[0].size[1]
            ) ** 2
            out[0] = friction * p * np.clip(r2, 0.15, 1.0)
        elif shear == "twist":
            dx, dy = x - patches[0].center[0], y - patches[0].center[1]
            reach = max(patches[0].size)
            out[0], out[1] = -friction * p * dy / reach, friction * p * dx / reach
            excess = np.maximum(np.hypot(dx, dy) / reach, 1.0)
            out[:2] /= excess
        return out

    return cells


LINE_CONTACTS: dict[str, Traction] = {
    "cylinder": line_contact(("cylinder", 0, 3.5, 1)),
    "punch": line_contact(("punch", 0, 3.5, 1)),
    "small cylinder": line_contact(("cylinder", 4.3, 1.2, 1)),
    "large cylinder": line_contact(("cylinder", -3.1, 9, 1)),
    "strip": line_contact(("strip", 1.17, 2, 1)),
    "wide punch": line_contact(("punch", 2.2, 8.1, 1)),
    "two cylinders": line_contact(("cylinder", -6, 3, 1), ("cylinder", 5, 4, 0.6)),
    "two punches": line_contact(("punch", -4, 1.5, 1), ("punch", 4.2, 1.5, 1)),
    "wedge": line_contact(("wedge", 0.4, 5, 1)),
    "tilted": line_contact(("tilted", 0, 4, 1)),
    "three": line_contact(("strip", -8, 1, 1), ("strip", 0, 1, 0.5), ("cylinder", 8, 2, 1)),
    "narrow": line_contact(("strip", 0.3, 0.6, 1)),
    "bump on cylinder": line_contact(("cylinder", -2, 6, 1), ("strip", 1.5, 1, 1)),
}

AREA_PATCHES: dict[str, tuple[Patch, ...]] = {
    "ball": (Patch("ball", (0.3, -0.2), (5, 5)),),
    "small ball": (Patch("ball", (-3.1, 2.3), (2.5, 2.5)),),
    "large ball": (Patch("ball", (0, 0.5), (7.5, 7.5)),),
    "punch": (Patch("punch", (0.2, 0.4), (4, 4)),),
    "block": (Patch("block", (1, -2), (3, 5), angle=0.4),),
    "ellipse": (Patch("ball", (0, 0), (7, 3), angle=0.6),),
    "ring": (Patch("ring", (0, 0), (6, 6)),),
    "two balls": (Patch("ball", (-4, -2), (3, 3)), Patch("ball", (4, 3), (4, 4), 0.6)),
    "cone": (Patch("cone", (0.5, 0), (6, 6)),),
    "dots": (
        Patch("block", (-5, -5), (1, 1)),
        Patch("block", (4, -4), (1.5, 1.5)),
        Patch("ball", (0, 5), (2.5, 2.5), 0.5),
    ),
    "bar": (Patch("block", (0, 0), (7.5, 1.2), angle=0.3),),
}
#: Contacts whose middle is two units inside the edge of the line array (at 30), and the same contacts in its middle.
CROSSING: dict[str, tuple[str, float, float]] = {
    "cylinder": ("cylinder", 28, 3.5),
    "strip": ("strip", 28, 3.5),
    "punch": ("punch", 28, 3.5),
    "wedge": ("wedge", 28, 4.5),
}
#: Coefficient of friction of the contacts that slide or slip partly.
FRICTION = 0.5
SHEARED: dict[str, tuple[str, str]] = {
    "sliding ball": ("ball", "slide"),
    "sticking ball": ("ball", "stick"),
    "twisted ball": ("ball", "twist"),
    "sliding block": ("block", "slide"),
    "sticking ellipse": ("ellipse", "stick"),
    "sliding punch": ("punch", "slide"),
    "pressed cone": ("cone", ""),
    "sliding small ball": ("small ball", "slide"),
}
