"""Convert a relief to touch: depth is a reading of displacement_z at depth 0, which the elastic inversion solves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate.camera.colour.files import read_slopes
from palpate.camera.colour.model import Relief, SlopeModel
from palpate.camera.pictures import Picture, Pictures, open_pictures
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings import Recording
from palpate.recordings.skinfile import skin_text, validated
from palpate.sensing import AreaArray, AreaGrid
from palpate.skin import Skin
from palpate.status import Status
from palpate.touch import Touch

__all__ = ["CHANNEL", "ColourTouches", "feel", "surface_skin"]

CHANNEL = "displacement_z"
#: Readings along the longer side of a picture: half a millimetre on a gel of 20 mm, and about a second per frame.
READINGS = 36
#: Correlation length of depth errors, in readings: slope errors extend over the flank of a contact.
DEPTH_ERROR_LENGTH = 1.5
#: Smallest fraction of valid pixels of a reading.
MIN_VALID_FRACTION = 0.3
#: The noise of empty pictures is rounded up to powers of this.
NOISE_STEP = 1.3
#: While the zero of depth is fitted, the load lies on readings with at least this fraction of the largest depth.
LOADED = 0.1
#: For the errors of depth, cells with less than this fraction of the largest traction are not in contact.
CARRIES = 0.02
SHEAR = (
    "depth alone does not measure shear: only pressure is sought, and depth that friction causes is counted as pressure"
)


def surface_skin(skin: Skin | str | Path, model: SlopeModel) -> Skin:
    """A skin with the same pad and readings of depth over the whole picture, as `ColourTouches` solves.

    Raises
    ------
    InvalidInput
        A view whose pixels are not square to the axes: depth is read on a grid along x and y.

    Examples
    --------
    >>> from palpate.camera import surface_skin
    >>> # surface_skin("calibrated.toml", read_slopes("calibrated.toml"))
    """
    given = skin if isinstance(skin, Skin) else _pad_of(skin)
    corners = model.view.places([[0.0, 0.0], [model.size[0] - 1.0, model.size[1] - 1.0]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    pitch = max(float((high - low).max()) / READINGS, 2.0 * float((high - low)[0]) / (model.size[0] / model.step))
    shape = tuple(int((high - low)[axis] / pitch) for axis in (1, 0))
    if min(shape) < 3:
        raise InvalidInput(
            f"the picture shows {1e3 * (high - low)[0]:.3g} x {1e3 * (high - low)[1]:.3g} mm by its scale: too narrow a strip. Check scale in [camera]."
        )
    array = AreaArray(
        shape=(shape[0], shape[1]),
        pitch=pitch,
        depth=0.0,
        channels=[CHANNEL],
        aperture=pitch,
        center=tuple(0.5 * (low + high)),
        noise=1e-6,
    )
    return Skin(given.pad, array, nuisance=["offset", "ramp"], uncertainty=given.uncertainty)


def _pad_of(path: str | Path) -> Skin:
    """The skin in a file whose taxel positions come from pictures."""
    found = validated(skin_text(Path(path)), str(path))
    if len(found.plane) != 1 or found.plane[0].kind != "scattered":
        raise InvalidInput(
            f'{path}: a gel that is read by its colours has one plane, of kind = "scattered" with channels = ["{CHANNEL}"] and depth = "0 mm": its places come from the pictures.'
        )
    channels = tuple(found.plane[0].channels)
    places = np.array([[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3]])
    empty = Recording(readings=np.zeros((1, len(channels), 3)), channels=channels, positions=places)
    return Skin.from_file(path, recording=empty)


class ColourTouches:
    """Touches of the pictures of a gel without dots; iterate over it once. Created by `feel`.

    Attributes
    ----------
    skin : Skin
        With readings of depth.
    model : SlopeModel
        The learnt model of the gel.
    pictures : Pictures
        The source.
    last : Relief or None
        Relief of the last picture.
    picture : Picture or None
        That picture.
    faults : dict of int to str
        Unusable pictures so far, and why.
    """

    def __init__(
        self,
        pictures: Pictures,
        skin: Skin,
        model: SlopeModel,
        *,
        rest: Floats | None,
        every: int,
        ahead: list[Picture],
        options: Mapping[str, Any],
    ) -> None:
        self.pictures, self.skin, self.model, self.every = pictures, skin, model, every
        self.last: Relief | None = None
        self.picture: Picture | None = None
        self.faults: dict[int, str] = {}
        self._quiet: dict[float, Skin] = {}
        self._rest, self._ahead, self._options = rest, ahead, dict(options)
        plane: Any = skin.planes[0]
        self._axes = [np.asarray(a) for a in _axes(plane)]
        self._pitch = float(self._axes[1][1] - self._axes[1][0])

    def __iter__(self) -> Iterator[Touch]:
        from itertools import chain

        for picture in chain(self._ahead, self.pictures):
            if picture.index % self.every:
                continue
            self.picture = picture
            yield self.touch(picture)

    def touch(self, picture: Picture) -> Touch:
        """The touch of one picture."""
        if picture.image is None:
            self.last = None
            self.faults[picture.index] = picture.fault
            return self._missing(picture.time, picture.fault)
        try:
            relief = self.model.relief(picture.image, rest=self._rest, name=f"picture {picture.index}")
        except InvalidInput as error:
            self.last = None
            self.faults[picture.index] = str(error)
            return self._missing(picture.time, str(error))
        self.last = relief
        return self.of(relief, picture.time)

    def of(self, relief: Relief, time: float = 0.0) -> Touch:
        """The touch of a relief."""
        if not relief.touching:
            quiet = np.zeros((1, 1, *self.skin.planes[0].shape))
            # Round up, so that prepared skins can be reused.
            level = NOISE_STEP ** math.ceil(math.log(max(relief.noise, 1e-9), NOISE_STEP))
            skin = self._quiet.setdefault(level, self._with_noise(level))
            touch = skin.reconstruct(quiet, time=[time], **self._options)[0]
            return replace(touch, view=self.model.view, assumptions=(*touch.assumptions, *relief.said))
        depth, near = self._binned(relief)
        errors = np.stack([self._binned(replace(relief, depth=e))[0] for e in relief.errors])
        local = np.sqrt((errors[:-2][:, near] ** 2).sum(axis=0).mean()) if len(errors) > 2 else 0.0
        # Cross-validation error of the shape of the depth, proportional to depth.
        shape = self.model.depth_error * min(1.0, float(depth[near].max()) / self.model.typical_depth)
        noise = float(np.sqrt(relief.noise**2 + local**2 + shape**2))
        skin = self._with_noise(noise).masked(near)
        loaded = self._cells(relief)
        response = self._columns(skin, loaded)[near.ravel()]
        y, x = (g[near] / self._pitch for g in np.meshgrid(*self._axes, indexing="ij"))
        plane = np.zeros_like(depth)
        plane[near] = _zero(response, np.stack([np.ones_like(x), x - x.mean(), y - y.mean()], axis=-1), depth[near])
        values = np.where(near, depth - plane, 0.0)
        touch = skin.reconstruct(values[None, None], time=[time], **self._options)[0]
        touch = self._with_errors(touch, skin, errors[:, near], near, noise)
        return replace(touch, view=self.model.view, assumptions=(*touch.assumptions, SHEAR, *relief.said))

    def _with_noise(self, noise: float) -> Skin:
        skin = self.skin
        plane = replace(skin.planes[0], noise=noise, noise_correlation=DEPTH_ERROR_LENGTH * self._pitch)
        return Skin(skin.pad, plane, surface=skin.surface, nuisance=["offset", "ramp"], uncertainty=skin.uncertainty)

    def _binned(self, relief: Relief) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Mean depth in each reading's square, and whether enough of it is known and near the contact."""
        shape = tuple(len(a) for a in self._axes)
        row = np.floor((relief.places[1] - self._axes[0][0]) / self._pitch + 0.5).astype(int)
        column = np.floor((relief.places[0] - self._axes[1][0]) / self._pitch + 0.5).astype(int)
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        flat = (row * shape[1] + column)[inside]
        count = np.bincount(flat, minlength=shape[0] * shape[1]).astype(np.float64)
        good = (relief.near & relief.known)[inside].astype(np.float64)
        seen = np.bincount(flat, good, minlength=len(count))
        total = np.bincount(flat, good * relief.depth[inside], minlength=len(count))
        depth = (total / np.maximum(seen, 1.0)).reshape(shape)
        return depth, (seen > MIN_VALID_FRACTION * np.maximum(count, 1.0)).reshape(shape)

    def _cells(self, relief: Relief) -> npt.NDArray[np.intp]:
        """Cells of the surface under the contact."""
        from scipy.ndimage import map_coordinates

        surface: Any = self.skin.surface
        x, y = np.meshgrid(surface.axes[1], surface.axes[0])
        pixels = (self.model.view.pixels(np.stack([x, y], axis=-1)) + 0.5) / self.model.step - 0.5
        pressed = relief.contact & (relief.depth > LOADED * float(relief.depth.max()))
        at = map_coordinates(pressed.astype(np.float64), [pixels[..., 1], pixels[..., 0]], order=1, mode="nearest")
        return np.flatnonzero((at > 0.5).ravel())

    @staticmethod
    def _columns(skin: Skin, cells: npt.NDArray[np.intp]) -> Floats:
        """Readings (place of the array, cell) under unit pressure in cells."""
        shape = skin.surface.shape
        unit = np.zeros((len(cells), len(skin.surface.components), *shape))
        unit.reshape(len(cells), unit.shape[1], -1)[np.arange(len(cells)), -1, cells] = 1.0
        return np.asarray(skin.operator.forward(unit)[0]).reshape(len(cells), -1).T

    def _with_errors(
        self, touch: Touch, skin: Skin, errors: Floats, near: npt.NDArray[np.bool_], noise: float
    ) -> Touch:
        """Widen the intervals of ``touch`` by depth errors common to all pixels: ``errors`` (cause, reading) [m].

        Each is converted to pressure on the loaded cells by least squares, together with a plane for offset and tilt
        of the depth, and regularised by ``noise`` [m]. ``near`` (row, column) marks the readings in use.
        """
        values = to_numpy(touch.values)
        pressure = values[-1]
        peak = float(np.abs(pressure).max(initial=0.0))
        if touch._errors is None or not bool(np.all(touch.touching)) or not peak > 0:
            return touch
        cells = np.flatnonzero(np.abs(pressure).ravel() > CARRIES * peak)
        response = self._columns(skin, cells)[near.ravel()]
        py, px = (g[near] / np.abs(g).max() for g in np.meshgrid(*self._axes, indexing="ij"))
        plane = float(np.abs(errors).max(initial=1e-9)) * np.stack([np.ones_like(px), px, py], axis=-1)
        rows = np.column_stack([response * peak, plane])
        held = np.diag(np.append(np.full(len(cells), noise**2), np.full(3, 1e-9 * noise**2)))
        found = np.linalg.solve(rows.T @ rows + held, rows.T @ errors.T)[:-3].T * peak
        surface: Any = skin.surface
        area = surface.spacings[0] * surface.spacings[1]
        x, y = (g.ravel()[cells] for g in np.meshgrid(surface.axes[1], surface.axes[0]))
        force = found.sum(axis=1) * area
        load = max(abs(float(to_numpy(touch.force)[-1])), 1e-300)
        cx, cy = (float(v) for v in to_numpy(touch.center_of_pressure))
        off = np.stack([(found * (x - cx)).sum(axis=1), (found * (y - cy)).sum(axis=1)], axis=-1) * area
        traction = np.zeros_like(values)
        traction[-1].ravel()[cells] = np.sqrt((found**2).sum(axis=0))
        top = np.argmax(np.abs(pressure).ravel()[cells])
        moment = np.zeros(3)
        moment[:2] = np.sqrt(((np.stack([found @ y, -(found @ x)], axis=-1) * area) ** 2).sum(axis=0))
        new = {
            "traction": traction,
            "force": np.array([0.0, 0.0, float(np.sqrt((force**2).sum()))]),
            "moment": moment,
            "center": np.sqrt((off**2).sum(axis=0)) / load,
            "peak": np.asarray(float(np.sqrt((found[:, top] ** 2).sum()))),
        }
        return replace(touch, _errors=touch._errors.adding(new))

    def _missing(self, time: float, why: str) -> Touch:
        shape = (len(self.skin.surface.components), *self.skin.surface.shape)
        return Touch(
            np.full(shape, np.nan),
            self.skin.surface,
            self.skin.problem(components=self._options.get("components")).components,
            "automatic",
            time=np.asarray(time),
            status=np.asarray(int(Status.MISSING), dtype=np.int8),
            assumptions=(f"no touch in a picture: {why}",),
        )

    def close(self) -> None:
        """Close the source."""
        self.pictures.close()

    def __enter__(self) -> ColourTouches:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _axes(plane: Any) -> tuple[Floats, Floats]:
    """y of the rows and x of the columns of an area array [m]."""
    grid = AreaGrid(shape=plane.shape, spacing=plane.pitch, center=plane.center)
    return np.asarray(grid.axes[0]), np.asarray(grid.axes[1])


def _zero(response: Floats, terms: Floats, depth: Floats) -> Floats:
    """Return the plane (n,) that is an error of the depth map, fitted together with the pressure under the contact (non-negative least squares).

    Slopes determine depth only up to a constant, unequal slope errors of the flanks add a ramp, and displacement far
    away affects both.
    """
    from scipy.optimize import nnls

    scale = float(np.abs(depth).max(initial=0.0))
    size = float(np.abs(response).max(initial=0.0))
    if not scale > 0 or not size > 0:
        return np.zeros_like(depth)
    unit = terms / np.abs(terms).max(axis=0)
    count = response.shape[1]
    found, _ = nnls(np.hstack([response / size, unit, -unit]), depth / scale, maxiter=20 * (count + 6))
    k = unit.shape[1]
    return np.asarray(unit @ (found[count : count + k] - found[count + k :]) * scale)


def feel(
    source: Any,
    skin: Skin | str | Path,
    *,
    model: SlopeModel | None = None,
    baseline: int = 0,
    rate: float | None = None,
    every: int = 1,
    **options: Any,
) -> ColourTouches:
    """Reconstruct what touches a colour gel without dots, from its pictures.

    Parameters
    ----------
    source : str, Path, int, arrays or Pictures
        A picture, video, folder, TIFF stack, camera or arrays (`palpate.camera.open_pictures`).
    skin : path of a calibrated.toml, or Skin
        Its pad and how well that is known; its array is replaced by depth all over the picture.
    model : SlopeModel, optional
        Model of the colours; default: the one that the section [colour] of the file names.
    baseline : int
        Number of pictures at the start that show the gel at rest, which replace that of the calibration: better,
        because lights change from day to day.
    rate : float, optional
        Pictures a second, for sources without times.
    every : int
        Solve one in this many pictures.
    **options
        Options of `Skin.reconstruct`, such as method.

    Raises
    ------
    InvalidInput
        No model, pictures of another size than those of the calibration, a baseline that uses up all pictures.

    Examples
    --------
    >>> from palpate.camera import feel
    >>> # with feel("press.mp4", "calibrated.toml", baseline=5) as touches:
    >>> #     forces = [touch.force for touch in touches]
    """
    if isinstance(every, bool) or not (isinstance(every, int) and every >= 1):
        raise InvalidInput(f"every must be a whole number of at least 1; got {every!r}.")
    if isinstance(baseline, bool) or not (isinstance(baseline, int) and baseline >= 0):
        raise InvalidInput(f"baseline must be a number of pictures from 0; got {baseline!r}.")
    if model is None:
        if isinstance(skin, Skin):
            raise InvalidInput(
                "a Skin does not hold what colours mean: give model=learn_slopes(...), or the path of a calibrated.toml."
            )
        model = read_slopes(skin)
        if model is None:
            raise InvalidInput(
                f'{skin} has no section [colour]: learn what its colours mean with palpate calibrate PRESSES --skin {skin} --ball-diameter "8 mm".'
            )
    full = surface_skin(skin, model)
    pictures = source if isinstance(source, Pictures) else open_pictures(source, rate=rate)
    try:
        if pictures.size != model.size:
            raise InvalidInput(
                f"{pictures.name}: the pictures are {pictures.size[0]} x {pictures.size[1]}, and the gel was calibrated with {model.size[0]} x {model.size[1]}: use the camera mode of the calibration, or calibrate again."
            )
        rest, ahead = None, []
        if baseline:
            stream = iter(pictures)
            for picture in stream:
                ahead.append(picture)
                if len(ahead) == baseline:
                    break
            good = [model.prepared(p.image, f"picture {p.index}")[0] for p in ahead if p.image is not None]
            if len(ahead) < baseline or not good:
                raise InvalidInput(
                    f"{pictures.name}: baseline {baseline} pictures at rest are needed at the start, and {len(good)} can be read: give fewer, or 0 for that of the calibration."
                )
            rest = np.mean(good, axis=0)
            pictures = _Rest(pictures, stream)
        return ColourTouches(pictures, full, model, rest=rest, every=every, ahead=ahead, options=options)
    except BaseException:
        pictures.close()
        raise


class _Rest(Pictures):
    """The remaining pictures of a source."""

    def __init__(self, source: Pictures, stream: Iterator[Picture]) -> None:
        self.name, self.count, self.timed, self.notes, self.size = (
            source.name,
            source.count,
            source.timed,
            source.notes,
            source.size,
        )
        self._source, self._stream = source, stream

    def __iter__(self) -> Iterator[Picture]:
        return self._stream

    def close(self) -> None:
        self._source.close()
