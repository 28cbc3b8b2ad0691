"""Pictures of colour gels whose shape and force are known in closed form, by lights that the colour model knows nothing of.

The gel is a thick half-space. Rigid bodies of revolution press it without friction (I. N. Sneddon, Int. J. Eng. Sci. 3, 1965, 47-57): with the Abel transform
g(t) of the body's profile, the load is 2 E* times the integral of g from 0 to a, and outside the contact u_z(r) = (2/pi) times that of g(t) / sqrt(r^2 - t^2).
Ball: g = d - (t/2) ln((R + t)/(R - t)), exact for a sphere, not its parabola. Flat punch: g = d. Loads are summed where several press.

Lights are small lamps beside the gel, each of a mixed colour: brightness falls with the square of the distance, the coat is partly glossy
(Lambert to a power), light that bounces about fills the dark, the lens darkens corners, the sensor mixes its channels and has a gamma, noise and JPEG.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Ball:
    """A ball of ``radius`` [m] that touches a circle of radius ``contact`` [m] about (x, y)."""

    radius: float
    contact: float
    x: float = 0.0
    y: float = 0.0

    @property
    def depth(self) -> float:
        r, a = self.radius, self.contact
        return 0.5 * a * math.log((r + a) / (r - a))

    def force(self, modulus: float) -> float:
        """Of a gel with the plane-strain modulus E* = E / (1 - nu^2)."""
        r, a = self.radius, self.contact
        return modulus * (0.5 * (a * a + r * r) * math.log((r + a) / (r - a)) - a * r)

    def _g(self, t: Floats) -> Floats:
        return self.depth - 0.5 * t * np.log((self.radius + t) / (self.radius - t))

    def inside(self, r: Floats) -> Floats:
        return self.depth - (self.radius - np.sqrt(self.radius**2 - r**2))


@dataclass(frozen=True)
class Flat:
    """A flat punch of radius ``contact`` [m], pressed in by ``depth`` [m]; its rim is ``rounded`` [m] by the coat that covers it."""

    contact: float
    depth: float
    x: float = 0.0
    y: float = 0.0

    def force(self, modulus: float) -> float:
        return 2.0 * modulus * self.contact * self.depth

    def _g(self, t: Floats) -> Floats:
        return np.full_like(t, self.depth)

    def inside(self, r: Floats) -> Floats:
        return np.full_like(r, self.depth)


def surface(bodies: Sequence[Any], x: Floats, y: Floats) -> Floats:
    """u_z [m] at places."""
    nodes, weights = np.polynomial.legendre.leggauss(48)
    total = np.zeros(np.broadcast(x, y).shape)
    for body in bodies:
        r = np.hypot(x - body.x, y - body.y)
        a = body.contact
        # t = r sin(angle) takes the root out of the integral: from 0 to asin(a / r)
        knots = np.concatenate([a * (1.0 + np.geomspace(1e-6, 40.0, 400))])
        top = np.arcsin(a / knots)
        angle = 0.5 * top[:, None] * (nodes + 1.0)
        values = (2.0 / math.pi) * 0.5 * top * (body._g(knots[:, None] * np.sin(angle)) @ weights)
        outside = np.interp(r, knots, values)
        total += np.where(r <= a, body.inside(np.minimum(r, a)), outside)
    return total


@dataclass(frozen=True)
class Lamps:
    """Lights and camera of a gel; drawn at random by `lamps`."""

    angles: tuple[float, ...] = (90.0, 210.0, 330.0)
    colours: tuple[tuple[float, float, float], ...] = ((1.0, 0.1, 0.06), (0.08, 1.0, 0.12), (0.05, 0.15, 1.0))
    height: float = 7e-3
    away: float = 14e-3
    gloss: float = 1.3
    fill: float = 0.45
    vignette: float = 0.25
    gamma: float = 1.0
    exposure: float = 0.6
    noise: float = 1.5
    jpeg: int | None = None
    blur: float = 0.8
    drift: float = 0.0


def lamps(rng: np.random.Generator) -> Lamps:
    """A gel of its own: three to four lamps, their colours, heights, gloss and camera drawn."""
    count = int(rng.integers(3, 5))
    angles = rng.uniform(0, 360) + 360.0 / count * np.arange(count) + rng.normal(0.0, 6.0, count)
    pure = [np.eye(3)[i % 3] for i in range(count)] if count == 3 else [*np.eye(3), np.array([0.6, 0.6, 0.6])]
    colours = tuple(tuple(float(v) for v in np.clip(p + rng.uniform(0.02, 0.2, 3), 0, 1.2)) for p in pure)
    return Lamps(
        angles=tuple(map(float, angles)),
        colours=colours,
        height=float(rng.uniform(4e-3, 9e-3)),
        away=float(rng.uniform(12e-3, 17e-3)),
        gloss=float(rng.uniform(1.0, 1.8)),
        fill=float(rng.uniform(0.3, 0.8)),
        vignette=float(rng.uniform(0.0, 0.4)),
        gamma=float(rng.uniform(0.75, 1.05)),
        exposure=float(rng.uniform(0.45, 0.65)),
        noise=float(rng.uniform(0.8, 2.5)),
        jpeg=None if rng.random() < 0.5 else int(rng.integers(80, 98)),
        blur=float(rng.uniform(0.5, 1.2)),
        drift=float(rng.uniform(0.0, 0.02)),
    )


@dataclass(frozen=True)
class Gel:
    """A camera of ``size`` (columns, rows) of ``scale`` [m] that looks at a coat through a thick gel."""

    lamps: Lamps = field(default_factory=Lamps)
    size: tuple[int, int] = (320, 240)
    scale: float = 0.06e-3
    dots: float | None = None  # pitch [m]
    seed: int = 0

    @property
    def places(self) -> tuple[Floats, Floats]:
        width, height = self.size
        x = (np.arange(width) - (width - 1) / 2.0) * self.scale
        y = ((height - 1) / 2.0 - np.arange(height)) * self.scale
        return np.meshgrid(x, y)

    def depth(self, bodies: Sequence[Any]) -> Floats:
        """Truth: u_z [m] of every pixel."""
        return surface(bodies, *self.places)

    def changed(self, **lamps: Any) -> Gel:
        return replace(self, lamps=replace(self.lamps, **lamps))

    def picture(
        self,
        bodies: Sequence[Any] = (),
        *,
        rng: np.random.Generator,
        dust: int = 0,
        shear: tuple[float, float] = (0.0, 0.0),
    ) -> npt.NDArray[np.uint8]:
        """Red, green, blue; ``dust``: dark specks that were not there at rest; ``shear`` [m]: the coat slides sideways, dots with it."""
        from scipy.ndimage import gaussian_filter

        lamp = self.lamps
        x, y = self.places
        u = self.depth(bodies) if len(bodies) else np.zeros(x.shape)
        # height towards the touching side is -u; lamps stand on the camera's side, where u grows
        uy, ux = np.gradient(u, self.scale)
        uy = -uy
        norm = np.sqrt(1.0 + ux**2 + uy**2)
        light = np.zeros((*x.shape, 3))
        for angle, colour in zip(lamp.angles, lamp.colours):
            at = np.array([lamp.away * math.cos(math.radians(angle)), lamp.away * math.sin(math.radians(angle))])
            lx, ly, lz = at[0] - x, at[1] - y, lamp.height - u
            far = np.sqrt(lx**2 + ly**2 + lz**2)
            # the coat's normal on the camera's side is (-ux, -uy, 1) / norm
            cosine = np.maximum((-ux * lx - uy * ly + lz) / (norm * far), 0.0)
            light += (cosine**lamp.gloss * (lamp.away / far) ** 2)[..., None] * np.asarray(colour)
        light = light + lamp.fill * 0.3 * (1.0 + 1.0 / norm)[..., None] * np.array([1.0, 0.9, 1.05])
        if self.dots is not None:
            px = np.mod(x - shear[0] + 0.5 * self.dots, self.dots) - 0.5 * self.dots
            py = np.mod(y - shear[1] + 0.5 * self.dots, self.dots) - 0.5 * self.dots
            light *= np.where(np.hypot(px, py) < 0.2 * self.dots, 0.1, 1.0)[..., None]
        fixed = np.random.default_rng(self.seed)
        grain = gaussian_filter(fixed.standard_normal(x.shape), 1.5)
        light *= (1.0 + 0.02 * grain / grain.std())[..., None]
        out = light
        half = np.hypot(*np.array(self.size)) / 2.0 * self.scale
        out = out * (1.0 - lamp.vignette * ((x**2 + y**2) / half**2))[..., None]
        if dust:
            for _ in range(dust):
                cx, cy = rng.uniform(x.min(), x.max()), rng.uniform(y.min(), y.max())
                out = (
                    out
                    * (1.0 - 0.8 * np.exp(-((((x - cx) ** 2 + (y - cy) ** 2) / (2.5 * self.scale) ** 2) ** 2)))[
                        ..., None
                    ]
                )
        mix = np.array([[0.9, 0.08, 0.02], [0.06, 0.86, 0.08], [0.02, 0.1, 0.88]])
        out = gaussian_filter(out @ mix.T, (lamp.blur, lamp.blur, 0))
        level = 1.0 + lamp.drift * rng.standard_normal()
        out = 255.0 * np.clip(lamp.exposure * 0.75 * level * out, 0.0, None) ** lamp.gamma
        out = out + lamp.noise * rng.standard_normal(out.shape)
        picture: npt.NDArray[np.uint8] = np.clip(np.round(out), 0, 255).astype(np.uint8)
        if lamp.jpeg is not None:
            import cv2

            _, code = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, lamp.jpeg])
            picture = np.ascontiguousarray(cv2.imdecode(code, cv2.IMREAD_COLOR)[..., ::-1])
        return picture


def presses(
    gel: Gel, radius: float, count: int, rng: np.random.Generator, *, contact: tuple[float, float] = (0.25, 0.45)
) -> list[Ball]:
    """Balls of one radius at random places, contact radii as parts of the ball's."""
    x, y = gel.places
    out = []
    for _ in range(count):
        a = radius * rng.uniform(*contact)
        out.append(
            Ball(
                radius,
                float(a),
                float(rng.uniform(x.min() + 1.3 * a, x.max() - 1.3 * a)),
                float(rng.uniform(y.min() + 1.3 * a, y.max() - 1.3 * a)),
            )
        )
    return out
