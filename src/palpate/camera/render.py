"""Render pictures of a known contact: a camera behind a gel with printed dots or texture.

Material points X of the plane at ``depth`` move by the pad's displacement u(X); the camera is at ``distance`` behind
that plane:

    pixel = lens(view^-1(q)),    q = [R (X + u_xy) + s] D / (D - u_z)

with the stage's rotation R and shift s. Each picture inverts this map on a coarse grid, evaluates the print at X with
an exact edge, three times finer than the pixels, and adds the effects of a camera. The truth of every picture is known
exactly.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats, Pad
from palpate.errors import InvalidInput
from palpate.sensing import AreaArray, AreaGrid
from palpate.sensing.view import Lens, View, opencv
from palpate.skin import Skin
from palpate.solutions import AreaContact

__all__ = ["Dots", "Looks", "Scene", "Texture", "Truth", "dot_grid"]

Picture = npt.NDArray[np.uint8]

#: Samples per pixel along each axis.
FINE = 3
#: Pixels between points of the inverse map.
COARSE = 4


@dataclass(frozen=True, eq=False)
class Dots:
    """Printed dots.

    Parameters
    ----------
    positions : array (n, 2)
        (x, y) [m] at rest.
    diameter : float
        [m]
    halved : sequence of int
        Dots with one half missing.
    """

    positions: Any
    diameter: float
    halved: Sequence[int] = ()

    def ink(self, x: Floats, y: Floats, soft: float) -> Floats:
        """Part that is printed, 0 to 1, at samples (row, column) of places [m]; edges are ``soft`` [m] wide."""
        from scipy.spatial import cKDTree

        centres = np.asarray(self.positions, dtype=np.float64)
        # The nearest dot of a pixel is also that of its samples.
        near = FINE // 2
        _, which = cKDTree(centres).query(np.stack([x[near::FINE, near::FINE], y[near::FINE, near::FINE]], axis=-1))
        which = np.repeat(np.repeat(which, FINE, axis=0), FINE, axis=1)
        distance = np.hypot(x - centres[which, 0], y - centres[which, 1])
        inside = 0.5 * self.diameter - distance
        if len(self.halved):
            cut = np.isin(which, np.asarray(self.halved))
            # Along a line through the middle, at a different angle for each dot.
            angle = 2.4 * which
            side = (x - centres[which, 0]) * np.cos(angle) + (y - centres[which, 1]) * np.sin(angle)
            inside = np.where(cut, np.minimum(inside, side), inside)
        return np.clip(0.5 + inside / soft, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Texture:
    """A speckled print: spots of ``grain`` [m] (standard deviation of a Gaussian) at random, ``density`` of them per grain squared."""

    grain: float
    density: float = 0.08
    reach: tuple[float, float] = (0.03, 0.03)
    seed: int = 0

    @cached_property
    def _map(self) -> tuple[Floats, float]:
        from scipy.ndimage import gaussian_filter

        step = self.grain / 2.0
        shape = (math.ceil(self.reach[1] / step), math.ceil(self.reach[0] / step))
        rng = np.random.default_rng(self.seed)
        spots = rng.poisson(self.density / 4.0, shape).astype(np.float64)
        return np.tanh(gaussian_filter(spots, 2.0) * 2.0 * math.pi * 4.0), step

    def ink(self, x: Floats, y: Floats, soft: float) -> Floats:
        """Printed fraction, 0 to 1, at places [m]."""
        from scipy.ndimage import map_coordinates

        values, step = self._map
        middle = np.asarray(values.shape)[:, None] / 2.0
        at = np.stack([y.ravel(), x.ravel()]) / step + middle
        return np.asarray(map_coordinates(values, at, order=3, mode="nearest")).reshape(x.shape).clip(0.0, 1.0)


def dot_grid(
    shape: tuple[int, int], pitch: float, *, jitter: float = 0.0, rng: np.random.Generator | None = None
) -> Floats:
    """Positions (n, 2) [m] of (rows, columns) dots about the origin, with random offsets of standard deviation
    ``jitter`` [m].

    Examples
    --------
    >>> from palpate.camera import dot_grid
    >>> dot_grid((1, 3), 2e-3).tolist()
    [[-0.002, 0.0], [0.0, 0.0], [0.002, 0.0]]
    """
    rows, columns = shape
    x = (np.arange(columns) - (columns - 1) / 2.0) * pitch
    y = (np.arange(rows) - (rows - 1) / 2.0) * pitch
    out = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    if jitter:
        out = out + jitter * (rng or np.random.default_rng(0)).standard_normal(out.shape)
    return out


@dataclass(frozen=True, kw_only=True)
class Looks:
    """Effects of camera and light on the picture of a print.

    Parameters
    ----------
    ground, contrast : float
        Grey level of the gel (of 255), and the part of it that ink takes away.
    gradient : (float, float)
        Change of the light across the picture's width and height, as a part of it.
    colour : float
        0: grey light. 1: red, green and blue come from three sides, as in gels that are read by photometric stereo.
    shading : float
        Change of brightness per slope of the pressed surface.
    blur : float
        Standard deviation of the optics' blur [pixels].
    noise : float
        Standard deviation of the sensor's noise [grey levels of 255].
    compression : int, optional
        Quality of JPEG, 1 to 100; None: not compressed.
    glare : sequence of (column, row, radius)
        Bright spots [pixels], fixed in the picture.
    """

    ground: float = 190.0
    contrast: float = 0.75
    gradient: tuple[float, float] = (0.2, -0.15)
    colour: float = 0.0
    shading: float = 0.0
    blur: float = 0.7
    noise: float = 2.0
    compression: int | None = None
    glare: Sequence[tuple[float, float, float]] = ()


@dataclass(frozen=True, eq=False)
class Truth:
    """Positions of the dots in a picture, and their displacements.

    Attributes
    ----------
    positions, displacement : array (n, 2), (n, 3)
        At rest, and by the pad [m]; without the stage's motion.
    rest, pixels : array (n, 2)
        Pixels at rest and in this picture, the stage's motion included.
    visible : array (n,)
        Whether the whole dot is in both pictures.
    """

    positions: Floats
    displacement: Floats
    rest: Floats
    pixels: Floats
    visible: npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A camera that looks at a printed plane in a pad.

    Parameters
    ----------
    pad : Pad
    depth : float
        Depth of the print below the touched surface [m].
    print : Dots or Texture
    size : (int, int)
        Columns and rows of the picture.
    scale : float or (float, float)
        Metres per pixel at rest, along x and y.
    distance : float, optional
        Distance of the camera's centre from the print at rest [m]; None: infinite, without perspective.
    distortion : sequence of float
        Distortion of the lens in the order of OpenCV (k1, k2, p1, p2).
    looks : Looks
    spacing : float, optional
        Spacing of the grid on which displacement is computed [m]; by default a sixtieth of the picture's width.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Scene, dot_grid
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0)
    >>> picture = scene.picture(ball, rng=np.random.default_rng(0))
    >>> picture.shape, picture.dtype.name
    ((120, 160), 'uint8')
    >>> bool(np.abs(scene.truth(ball).displacement).max() > 0.1e-3)
    True
    """

    pad: Pad
    depth: float
    print: Dots | Texture
    size: tuple[int, int]
    scale: float | tuple[float, float]
    distance: float | None = None
    distortion: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    looks: Looks = field(default_factory=Looks)
    spacing: float | None = None

    @cached_property
    def view(self) -> View:
        """Pixels to metres of the print at rest, exactly."""
        plain = View.scaled(self.scale, size=self.size)
        if not any(self.distortion):
            return plain
        across, up = self._scales
        # A pinhole; a camera so far away that motion has no effect has the field of view of a usual lens.
        distance = self.distance or across * self.size[0]
        middle = (self.size[0] - 1) / 2.0, (self.size[1] - 1) / 2.0
        matrix = [[distance / across, 0.0, middle[0]], [0.0, distance / up, middle[1]], [0.0, 0.0, 1.0]]
        return View(plain.homography, Lens(matrix, self.distortion))

    @property
    def _scales(self) -> tuple[float, float]:
        return (self.scale[0], self.scale[1]) if isinstance(self.scale, tuple | list) else (self.scale, self.scale)

    @cached_property
    def skin(self) -> Skin:
        """The pad with a fine grid of displacements at the print and of slopes at the surface."""
        across, up = self._scales
        width, height = across * self.size[0], up * self.size[1]
        step = self.spacing or width / 60.0
        # Dots beyond the picture's edge may move into it, and loads may lie there.
        shape = tuple(math.ceil(1.3 * side / step) + 4 for side in (height, width))
        grid = AreaGrid(shape=(shape[0], shape[1]), spacing=step)
        names = ["displacement_x", "displacement_y", "displacement_z"]
        planes = [
            AreaArray(shape=grid.shape, pitch=step, depth=d, channels=names) for d in dict.fromkeys((self.depth, 0.0))
        ]
        return Skin(self.pad, planes, surface=grid)

    def changed(self, **what: Any) -> Scene:
        """Return the scene with another print, look or camera; it shares the prepared pad if possible."""
        other = replace(self, **what)
        if not {"pad", "depth", "size", "scale", "spacing"} & set(what):
            other.__dict__["skin"] = self.skin
        return other

    @property
    def surface(self) -> AreaGrid:
        """The surface of the traction: a grid that extends past the picture."""
        grid = self.skin.surface
        if not isinstance(grid, AreaGrid):
            raise InvalidInput("a scene has an area for its surface.")
        return grid

    def _fields(self, contact: Any) -> tuple[Floats, Floats]:
        """Displacement of the print (3, y, x) and u_z of the surface (y, x) [m], as spline coefficients."""
        from scipy.ndimage import spline_filter

        if contact is None:
            zero = np.zeros((3, *self.surface.shape))
            return zero, zero[2]
        if isinstance(contact, AreaContact):
            contact = self.skin.sample(contact)
        out = np.asarray(self.skin.sense(contact)).reshape(-1, 3, *self.surface.shape)
        return np.stack([spline_filter(part) for part in out[0]]), np.asarray(spline_filter(out[-1][2]))

    def _at(self, coefficients: Floats, points: Floats) -> Floats:
        """Values (..., n) of fields at points (n, 2) as (x, y) [m]."""
        from scipy.ndimage import map_coordinates

        grid = self.surface
        at = np.stack(
            [(points[:, 1] - grid.axes[0][0]) / grid.spacings[0], (points[:, 0] - grid.x[0]) / grid.spacings[1]]
        )
        parts = [
            map_coordinates(c, at, order=3, mode="nearest", prefilter=False) for c in np.atleast_3d(coefficients.T).T
        ]
        return np.stack(parts)

    def _seen(self, points: Floats, u: Floats, shift: tuple[float, float], rotation: float) -> Floats:
        """Pixels of material points (n, 2) with displacement (3, n)."""
        c, s = math.cos(rotation), math.sin(rotation)
        moved = (points + u[:2].T) @ np.array([[c, s], [-s, c]]) + np.asarray(shift)
        if self.distance is not None:
            moved = moved * (self.distance / (self.distance - u[2]))[:, None]
        return self.view.pixels(moved)

    def truth(self, contact: Any = None, *, shift: tuple[float, float] = (0.0, 0.0), rotation: float = 0.0) -> Truth:
        """The positions of the dots: ``contact`` as for `picture`."""
        if not isinstance(self.print, Dots):
            raise InvalidInput("only dots have places of their own; ask displacement() for a texture.")
        points = np.asarray(self.print.positions, dtype=np.float64)
        u = self._at(self._fields(contact)[0], points)
        rest, pixels = self._seen(points, 0.0 * u, (0.0, 0.0), 0.0), self._seen(points, u, shift, rotation)
        reach = 0.5 * self.print.diameter / min(self._scales) + 1.0
        width, height = self.size
        inside = [
            (p[:, 0] >= reach) & (p[:, 0] <= width - 1 - reach) & (p[:, 1] >= reach) & (p[:, 1] <= height - 1 - reach)
            for p in (rest, pixels)
        ]
        return Truth(points, u.T.copy(), rest, pixels, inside[0] & inside[1])

    def displacement(self, contact: Any, places: npt.ArrayLike) -> Floats:
        """Displacement (n, 3) [m] of the print at material places (n, 2)."""
        points = np.asarray(places, dtype=np.float64).reshape(-1, 2)
        return self._at(self._fields(contact)[0], points).T.copy()

    def picture(
        self,
        contact: Any = None,
        *,
        shift: tuple[float, float] = (0.0, 0.0),
        rotation: float = 0.0,
        rng: np.random.Generator | None = None,
    ) -> Picture:
        """One picture, (rows, columns) or with colour (rows, columns, 3) as red, green, blue.

        Parameters
        ----------
        contact : AreaContact or array (component, *surface), optional
            A closed-form contact, or traction on `surface` [Pa]; None: nothing touches.
        shift, rotation : (float, float), float
            Shift and rotation of the gel in front of the camera [m, rad].
        rng : numpy Generator, optional
            Random numbers for the noise; None: the same noise in every picture, unlike any camera.

        Raises
        ------
        InvalidInput
            A contact that folds the print.
        """
        print_field, surface_field = self._fields(contact)
        width, height = self.size
        columns = np.arange(-COARSE, width + 2 * COARSE, COARSE, dtype=np.float64)
        rows = np.arange(-COARSE, height + 2 * COARSE, COARSE, dtype=np.float64)
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        seen = self.view.places(pixels)
        c, s = math.cos(rotation), math.sin(rotation)
        turn = np.array([[c, -s], [s, c]])
        points = (seen - np.asarray(shift)) @ turn
        for _ in range(60):
            u = self._at(print_field, points)
            flat = seen if self.distance is None else seen * (1.0 - u[2] / self.distance)[:, None]
            fresh = (flat - np.asarray(shift)) @ turn - u[:2].T
            change = float(np.abs(fresh - points).max())
            points = fresh
            if change < 1e-4 * min(self._scales):
                break
        else:
            raise InvalidInput("this contact folds the print over: no picture of it exists. Press less.")
        fine = (np.arange(FINE) + 0.5) / FINE - 0.5
        at_columns = (np.arange(width)[:, None] + fine).ravel()
        at_rows = (np.arange(height)[:, None] + fine).ravel()
        x, y = (self._between(part.reshape(len(rows), -1), rows, columns, at_rows, at_columns) for part in points.T)
        ink = self.print.ink(x, y, min(self._scales) / FINE)
        shade: Floats = np.zeros((3, height, width))
        if self.looks.shading and contact is not None:
            shade = self._shade(surface_field, points, rows, columns)
        return self._exposed(ink, shade, rng or np.random.default_rng(0))

    @staticmethod
    def _between(values: Floats, rows: Floats, columns: Floats, at_rows: Floats, at_columns: Floats) -> Floats:
        from scipy.interpolate import RectBivariateSpline

        return np.asarray(RectBivariateSpline(rows, columns, values)(at_rows, at_columns))

    def _shade(self, field: Floats, points: Floats, rows: Floats, columns: Floats) -> Floats:
        """Change of brightness (colour, row, column) with the slope of the surface, seen by lights from three sides."""
        width, height = self.size
        step = self.surface.spacings[0]
        at = (np.arange(height, dtype=np.float64), np.arange(width, dtype=np.float64))
        along = [self._at(field[None], points + d)[0] - self._at(field[None], points - d)[0] for d in step * np.eye(2)]
        slopes = [self._between(part.reshape(len(rows), -1) / (2 * step), rows, columns, *at) for part in along]
        angles = np.deg2rad([90.0, 210.0, 330.0])
        light = [slopes[0] * math.cos(a) + slopes[1] * math.sin(a) for a in angles]
        return self.looks.shading * np.stack(light)

    def _exposed(self, ink: Floats, shade: Floats, rng: np.random.Generator) -> Picture:
        from scipy.ndimage import gaussian_filter

        looks = self.looks
        width, height = self.size
        if looks.blur:
            ink = gaussian_filter(ink, looks.blur * FINE, mode="nearest")
        ink = ink.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
        across, down = np.linspace(-0.5, 0.5, width), np.linspace(-0.5, 0.5, height)[:, None]
        light = 1.0 + looks.gradient[0] * across + looks.gradient[1] * down
        if looks.colour:
            sides = [
                light + looks.colour * 0.5 * (across * math.cos(a) - down * math.sin(a))
                for a in np.deg2rad([90.0, 210.0, 330.0])
            ]
            channels = [looks.ground * g * (1.0 + s) * (1.0 - looks.contrast * ink) for g, s in zip(sides, shade)]
        else:
            channels = [looks.ground * light * (1.0 + shade.mean(axis=0)) * (1.0 - looks.contrast * ink)]
        out: npt.NDArray[Any] = np.stack(channels, axis=-1)
        for column, row, radius in looks.glare:
            far = np.hypot(np.arange(width) - column, np.arange(height)[:, None] - row)
            out = out + 255.0 * np.exp(-(np.clip(far / radius, 0.0, 20.0) ** 4))[..., None]
        out = out + looks.noise * rng.standard_normal(out.shape)
        picture: Picture = np.clip(np.round(out), 0, 255).astype(np.uint8)
        if looks.compression is not None:
            cv2 = opencv()
            _, code = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, int(looks.compression)])
            picture = np.asarray(cv2.imdecode(code, cv2.IMREAD_UNCHANGED)).reshape(height, width, -1)[..., ::-1]
        return np.ascontiguousarray(picture[..., 0] if picture.shape[-1] == 1 else picture)

    def pictures(self, contacts: Iterable[Any], *, seed: int = 0) -> Iterable[Picture]:
        """Pictures of one contact after another, with fresh noise in each."""
        rng = np.random.default_rng(seed)
        return (self.picture(contact, rng=rng) for contact in contacts)

    def film(self, path: str | Path, contacts: Iterable[Any], *, rate: float = 30.0, seed: int = 0) -> None:
        """Write a video (.mp4, .avi, .mkv) of one contact after another, ``rate`` a second."""
        from palpate.camera.pictures import write_video

        write_video(path, self.pictures(contacts, seed=seed), rate=rate)
