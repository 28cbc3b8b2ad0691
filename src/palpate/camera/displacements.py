"""Convert pictures to readings: displacement of every dot in metres, with its standard deviation, picture by picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._numbers import plain_number
from palpate.camera.dots import fault_of
from palpate.camera.flow import Flow
from palpate.camera.markers import Markers
from palpate.camera.pictures import Picture, Pictures, open_pictures
from palpate.camera.region import Region
from palpate.camera.windows import Moved
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings import Recording
from palpate.recordings.camerasection import CameraSettings
from palpate.sensing.lattice import typical_distance
from palpate.sensing.view import Lens, View, grey

__all__ = ["Displacements", "Reading", "Stage", "view_of"]

#: Number of unusable pictures at the start before the source is given up.
PATIENCE = 30
#: Standard deviation [pixels] of dot motion between pictures that does not appear in a picture's own residuals: video
#: compression that reuses earlier pictures (0.2 um where 0.06 um were estimated, at 40 um a pixel), changing light, a
#: warming camera.
DRIFT = 0.01
#: Fraction of the reference pictures in which a dot may be lost, and fraction of the dots that must be found again in
#: these pictures.
UNSTEADY, STEADY = 0.2, 0.5
#: Fraction of the dots that must agree on a motion of the whole gel, and tolerance as a fraction of their distance.
AGREE, ALIKE = 0.34, 0.01


@dataclass(frozen=True)
class Stage:
    """Motion of the whole gel in front of the camera: shift (x, y) [m] of the middle of the dots, and rotation [rad, counter-clockwise]."""

    shift: tuple[float, float]
    rotation: float


@dataclass(frozen=True, eq=False)
class Reading:
    """Displacements of one picture.

    Attributes
    ----------
    index, time : int, float
        Number and time [s] of the picture.
    values, std : array (2, n)
        displacement_x and displacement_y of every dot, and their standard deviations [m]; NaN where a dot is lost.
    fault : str
        Why the whole picture is unusable, else "".
    image : array or None
        The picture.
    stage : Stage or None
        The subtracted motion, if requested.
    """

    index: int
    time: float
    values: Floats
    std: Floats
    fault: str = ""
    image: npt.NDArray[Any] | None = None
    stage: Stage | None = None


def view_of(settings: CameraSettings, size: tuple[int, int], dots: Floats) -> View:
    """The view that a section [camera] describes, for pictures of ``size`` with these ``dots`` at rest [pixels]."""
    part = _part(settings, size)
    lens = None
    if settings.matrix is not None:
        # Pixels are counted from the middle of the first.
        matrix = np.asarray(settings.matrix, dtype=np.float64) * np.array([[part], [part], [1.0]])
        matrix[:2, 2] += 0.5 * part - 0.5
        lens = Lens(matrix, settings.distortion)
    if settings.points is not None:
        points = _at_size(np.asarray(settings.points, dtype=np.float64), part)
        return View.from_points(points, settings.places, lens=lens)
    if settings.pitch is not None:
        return View.from_pitch(dots, settings.pitch, size=size, lens=lens)
    scale = np.asarray(settings.scale, dtype=np.float64) / part
    return View.scaled((float(scale.flat[0]), float(scale.flat[-1])), size=size, lens=lens)


def _at_size(pixels: Floats, part: float) -> Floats:
    """Convert pixels to pictures larger by the factor ``part``."""
    return np.asarray((pixels + 0.5) * part - 0.5)


def _part(settings: CameraSettings, size: tuple[int, int]) -> float:
    """Factor by which pictures are larger than those of a section [camera]; `InvalidInput` if they have another shape."""
    part = 1.0
    if settings.size is not None:
        part = size[0] / settings.size[0]
        if abs(size[1] / settings.size[1] / part - 1.0) > 0.02:
            said = f"the pictures are {size[0]} x {size[1]}, and the section [camera] is for {settings.size[0]} x {settings.size[1]}"
            if abs(size[0] / settings.size[1] * settings.size[0] / size[1] - 1.0) <= 0.02:
                raise InvalidInput(
                    f"{said}: they were taken with the camera on its side. Write size = [{settings.size[1]}, {settings.size[0]}] in [camera], and exchange what it "
                    "gives for x and y."
                )
            raise InvalidInput(
                f"{said}: of another shape. Give the scale and size of these pictures, or the pitch of the dots."
            )
    return part


class Displacements:
    """Displacements of printed dots, from pictures.

    The first ``reference`` usable pictures show the gel at rest: their mean is the reference for all pictures, and
    they are also the first readings, so that a tracker can estimate the noise from them.

    Parameters
    ----------
    source : str, Path, int, arrays or Pictures
        As for `open_pictures`.
    view : View or CameraSettings
        Mapping of pixels to metres.
    reference : int, optional
        Pictures at the start in which nothing touches (default: that of the settings, or 5).
    rate : float, optional
        Pictures a second, for sources without times.
    stage : bool, optional
        Subtract motion of the whole gel, measured by dots far from the contact, and report it (default: that of the settings, or no).
    texture : float, optional
        For a gel with a texture and no dots: distance between the places of the readings [m] (default: that of the settings; without either, a search
        for dots).
    roi : array (n, 2), optional
        Corners (column, row) [pixels] of the gel in the pictures, two of a rectangle or more of a polygon (default: that of the settings, or the
        inside of the gel's rim, if one shows against a dark housing).

    Attributes
    ----------
    positions : array (n, 2)
        (x, y) of the dots, or places of a texture, at rest [m].
    view, markers, size
        `Markers` of the reference, or `Flow` of a texture.
    region : Region or None
        The part of the pictures that shows the gel; None: all of it.
    faults : dict of int to str
        Unusable pictures so far, and why.

    Raises
    ------
    InvalidInput
        Pictures without dots, or dots that do not stay at rest in the reference.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Displacements, Dots, Scene, dot_grid
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0)
    >>> pictures = list(scene.pictures([None, None, ball]))
    >>> with Displacements(pictures, scene.view, reference=2, rate=30.0) as readings:
    ...     recording = readings.recording()
    >>> recording.readings.shape, recording.channels
    ((3, 2, 35), ('displacement_x', 'displacement_y'))
    """

    def __init__(
        self,
        source: Any,
        view: View | CameraSettings,
        *,
        reference: int | None = None,
        rate: float | None = None,
        stage: bool | None = None,
        texture: float | None = None,
        roi: npt.ArrayLike | None = None,
    ) -> None:
        settings = view if isinstance(view, CameraSettings) else None
        count = reference if reference is not None else settings.reference if settings else 5
        if isinstance(count, bool) or not (isinstance(count, int) and count >= 1):
            raise InvalidInput(f"reference must be a number of pictures of at least 1; got {count!r}.")
        if texture is None and settings is not None:
            texture = settings.texture
        if texture is not None and not (np.isfinite(texture) and texture > 0):
            raise InvalidInput(
                f"texture must be a positive distance between readings [m], such as 1e-3; got {texture!r}."
            )
        self.texture = texture
        self.stage = stage if stage is not None else bool(settings and settings.stage)
        self.pictures = source if isinstance(source, Pictures) else open_pictures(source, rate=rate)
        self.faults: dict[int, str] = {}
        self.reference = count
        self._rest = iter(self.pictures)
        try:
            self._begin(count, view, roi)
            self.positions: Floats = self.view.places(self.markers.positions)
        except BaseException:
            self.close()
            raise
        self.positions.setflags(write=False)

    def _begin(self, count: int, view: View | CameraSettings, roi: npt.ArrayLike | None) -> None:
        """Find the dots in the reference pictures."""
        good: list[Picture] = []
        first: list[Picture] = []
        for picture in islice(self._rest, count + PATIENCE):
            first.append(picture)
            if not _fault(picture):
                good.append(picture)
            if len(good) == count:
                break
        if len(good) < count:
            why = "; ".join(dict.fromkeys(_fault(p) or "good" for p in first if p not in good))
            raise InvalidInput(
                f"{self.pictures.name}: {count} pictures of the gel at rest are needed at the start, {len(good)} of the first {len(first)} show something"
                + (f" ({why}). " if why else ". ")
                + "".join(f"{note} " for note in self.pictures.notes)
                + f"Give a smaller reference (here up to {len(good)}), or begin with the gel untouched."
                if good
                else f"{self.pictures.name}: none of the first {len(first)} pictures shows anything ({why}). Check light, exposure and lens cap."
            )
        self.size = self.pictures.size
        images = [p.image for p in good]
        if roi is None and isinstance(view, CameraSettings) and view.roi is not None:
            roi = _at_size(np.asarray(view.roi, dtype=np.float64), _part(view, self.size))
        self.region = Region.found(np.asarray(images[0])) if roi is None else Region.of(roi, self.size)
        self.markers: Markers | Flow
        if self.texture is None:
            self.markers = Markers(images, region=self.region)
            self.view = view if isinstance(view, View) else view_of(view, self.size, self.markers.positions)
        else:
            self.view = view if isinstance(view, View) else view_of(view, self.size, np.zeros((0, 2)))
            middle = self.view.jacobian((np.array(self.size) - 1.0) / 2.0)
            spacing = self.texture / math.sqrt(abs(float(np.linalg.det(middle))))
            self.markers = Flow(images, spacing=spacing, region=self.region)
        moved = [self.markers.follow(p.image) for p in good]
        steady = np.mean([one.lost for one in moved], axis=0) <= UNSTEADY
        if not steady.all() and not any(one.fault for one in moved):
            places = self.markers.positions
            if steady.sum() < max(STEADY * len(steady), 3):
                raise InvalidInput(
                    f"{self.pictures.name}: of {len(steady)} {'dots' if self.texture is None else 'places of the texture'} that were found {int(steady.sum())} are still there in the "
                    f"other pictures of the gel at rest: the rest is noise. Film sharper, with more light, and with the gel untouched in the first {count} pictures."
                )
            kept = places[steady]
            self.markers = (
                Markers(images, positions=kept, region=self.region)
                if self.texture is None
                else Flow(images, spacing=spacing, region=self.region, positions=kept)
            )
            moved = [self.markers.follow(p.image) for p in good]
        for picture, one in zip(good, moved):
            off = np.abs(one.displacement) / np.maximum(one.std, 0.01)
            if one.fault or (count > 1 and np.nanquantile(off, 0.75) > 6.0):
                raise InvalidInput(
                    f"{self.pictures.name}: picture {picture.index} differs from the other pictures of the reference"
                    + (
                        f" ({one.fault})"
                        if one.fault
                        else f": {'dots' if self.texture is None else 'places'} move by {plain_number(np.nanmax(np.abs(one.displacement)), 2)} pixels"
                    )
                    + f". Nothing may touch the gel in the first {count} pictures: begin earlier, or give a smaller reference."
                )
        self.markers.reset()
        self._rest = chain(first, self._rest)

    def __iter__(self) -> Iterator[Reading]:
        for picture in self._rest:
            yield self.reading(picture)

    def reading(self, picture: Picture) -> Reading:
        """The displacements in one picture."""
        moved = self.markers.follow(picture.image)
        fault = picture.fault or moved.fault
        if fault:
            self.faults[picture.index] = fault
        values, std = self._metres(moved)
        stage = None
        if self.stage and not fault:
            values, stage = _without_stage(self.positions, values, std)
            if stage is None:
                fault = self.faults[picture.index] = (
                    "the motion of the whole gel is unknown: too few dots move together. Show more of the gel around the contact"
                )
                values = np.full_like(values, np.nan)
                std = values
        return Reading(picture.index, picture.time, values.T, std.T, fault, picture.image, stage)

    def _metres(self, moved: Moved) -> tuple[Floats, Floats]:
        pixels = self.markers.positions
        good = ~moved.lost
        values = np.full(pixels.shape, np.nan)
        std = values.copy()
        if good.any():
            values[good] = self.view.places(pixels[good] + moved.displacement[good]) - self.positions[good]
            scale = self.view.jacobian(pixels[good])
            std[good] = np.sqrt(np.einsum("nij,nj->ni", scale**2, moved.std[good] ** 2 + DRIFT**2))
        return values, std

    def recording(self) -> Recording:
        """All remaining pictures as a recording; lost dots read NaN.

        Raises
        ------
        InvalidInput
            No usable picture.
        """
        found = list(self)
        if not found:
            raise InvalidInput(f"{self.pictures.name}: all pictures have been read; open the source again.")
        return Recording(
            readings=np.stack([r.values for r in found]),
            channels=("displacement_x", "displacement_y"),
            time=[r.time for r in found],
            positions=self.positions,
            meta={"pictures": self.pictures.name},
        )

    def close(self) -> None:
        """Close the source."""
        self.pictures.close()

    def __enter__(self) -> Displacements:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _fault(picture: Picture) -> str:
    """Why a picture is unusable; "" if it is usable."""
    return picture.fault if picture.image is None else fault_of(grey(picture.image))


def _without_stage(positions: Floats, values: Floats, std: Floats) -> tuple[Floats, Stage | None]:
    """Displacements without motion of the whole gel, which is estimated by a robust fit of shift and rotation: Tukey's
    biweight, starting from the median.

    A large rotation is not treated as shear: q = R X + s exactly.
    """
    good = np.isfinite(values).all(axis=1)
    if good.sum() < 4:
        return values, None
    at, now, noise = positions[good], (positions + values)[good], np.hypot(*std[good].T)
    middle = positions.mean(axis=0)
    arm = at - middle
    shift, angle = np.median(now - at, axis=0), 0.0
    size = float(np.median(np.hypot(*((now - at - shift).T)))) * 1.5
    floor = float(np.median(noise))
    most = ALIKE * typical_distance(positions)
    for _ in range(80):
        c, s = np.cos(angle), np.sin(angle)
        left = np.hypot(*(now - middle - shift - arm @ np.array([[c, s], [-s, c]])).T)
        reach = 4.685 * np.sqrt(noise**2 + size**2)
        weight = np.where(left < reach, (1.0 - (left / reach) ** 2) ** 2, 0.0)
        if np.mean(weight > 0.1) < AGREE:
            # A contact affects a large area: use the motion of the dots that agree best, if these are enough.
            if size > most:
                return values, None
            break
        mean_arm, mean_now = np.average(arm, axis=0, weights=weight), np.average(now - middle, axis=0, weights=weight)
        a, b = arm - mean_arm, now - middle - mean_now
        turn = np.arctan2(
            (weight * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])).sum(), (weight * (a * b).sum(axis=1)).sum()
        )
        c, s = np.cos(turn), np.sin(turn)
        fresh = mean_now - mean_arm @ np.array([[c, s], [-s, c]])
        done = abs(turn - angle) * float(np.abs(arm).max()) + float(np.abs(fresh - shift).max()) < 0.01 * floor
        shift, angle = fresh, float(turn)
        # From the spread of all readings down to that of noise.
        shrunk = max(0.85 * size, floor)
        if done and shrunk >= size:
            break
        size = shrunk
    c, s = np.cos(angle), np.sin(angle)
    # Rotate back into the gel's own axes: X + u = R' (q - s).
    back = (positions + values - middle - shift) @ np.array([[c, -s], [s, c]])
    return back - (positions - middle), Stage((float(shift[0]), float(shift[1])), angle)
