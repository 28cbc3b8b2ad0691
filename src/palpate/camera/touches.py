"""The complete path from pictures to touches."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate.camera.depthmap import DepthMap
from palpate.camera.displacements import Displacements, Reading
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.recordings import Recording
from palpate.recordings.camerasection import CameraSettings
from palpate.sensing import Array, ScatteredArray
from palpate.sensing.lattice import typical_distance
from palpate.sensing.view import View
from palpate.skin import Skin
from palpate.status import Status
from palpate.touch import Touch
from palpate.tracking import Tracker

__all__ = ["CHANNELS", "Touches", "follow", "gel_skin"]

CHANNELS = ("displacement_x", "displacement_y")
#: Largest fraction of lost dots in a frame solved alone.
MAX_LOST_FRACTION = 0.5
#: The noise stated for dots is rounded up to powers of this, so that prepared skins can be reused; and number of skins
#: kept.
NOISE_STEP, KEPT = 1.3, 6
#: Radius (in dot distances) that a dot covers; and smallest fraction of the traction around lost dots that is noted.
BLIND, FEW_LOST = 1.0, 0.05
LOST = "dots are lost where this presses, hidden or moved too far: the intervals allow for as much again as was found there"
#: Largest number of perspective corrections in a frame solved alone; and the change, relative to the readings' standard
#: deviation, below which they stop.
PASSES, MATTERS = 3, 0.5


def gel_skin(skin: Skin | str | Path, positions: Floats) -> Skin:
    """A skin whose only plane has its dots at these ``positions`` (n, 2) [m].

    ``skin``: a skin.toml with one plane of kind = "scattered", or a Skin; its pad, depth and noise are kept.

    Raises
    ------
    InvalidInput
        Several planes, or other channels than displacement_x and displacement_y.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import dot_grid, gel_skin
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> array = pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
    >>> gel_skin(pp.Skin(gel, array), dot_grid((3, 4), 2e-3)).planes[0].shape
    (12,)
    """
    if not isinstance(skin, Skin):
        empty = np.zeros((1, len(CHANNELS), len(positions)))
        found = Skin.from_file(skin, recording=Recording(readings=empty, channels=CHANNELS, positions=positions))
        _check(found)
        if found.planes[0].shape != (len(positions),):
            raise InvalidInput(
                f'{skin}: positions come from the pictures: the plane must have kind = "scattered" and no positions_file.'
            )
        return found
    _check(skin)
    plane = skin.planes[0]
    array = ScatteredArray(
        positions=positions,
        depth=plane.depth,
        channels=CHANNELS,
        aperture=plane.aperture,
        noise=plane.noise,
        noise_correlation=plane.noise_correlation,
        limits=plane.limits,
    )
    return _of_dots(skin, array)


def _of_dots(skin: Skin, *planes: Array) -> Skin:
    """The skin with these arrays, on the given surface if there is one."""
    problem = skin.problem()
    return Skin(
        skin.pad,
        planes,
        surface=skin.surface if problem.fixed else None,
        boundary=problem.boundary,
        nuisance="auto" if problem.nuisance is None else problem.nuisance,
        uncertainty=skin.uncertainty,
    )


def _check(skin: Skin) -> None:
    if len(skin.planes) != 1 or tuple(skin.planes[0].channels) != CHANNELS:
        raise InvalidInput(
            f"dots in pictures give {' and '.join(CHANNELS)} at one depth: the skin needs one plane with these channels, in this order; it has "
            f"{'; '.join(', '.join(p.channels) for p in skin.planes)}."
        )


def camera_of(skin: Skin | str | Path, view: View | None) -> CameraSettings | None:
    """The section [camera] of a skin.toml; `InvalidInput` if neither it nor ``view`` states how pixels become metres."""
    from palpate.recordings import read_camera

    settings = None if isinstance(skin, Skin) else read_camera(skin)
    if view is None and settings is None:
        raise InvalidInput(
            'nothing says how pixels become metres: give view=..., or a skin.toml with a section [camera] such as scale = "0.06 mm" (per pixel) or '
            'pitch = "2 mm" (of the dots).'
        )
    return settings


class Touches:
    """Touches of the pictures; iterate over it once. Created by `follow`.

    Attributes
    ----------
    skin : Skin
        With taxels at the dots.
    readings : Displacements
        The source of the readings: `Displacements.view`, `Displacements.faults`.
    tracker : Tracker or None
        The tracker, or None if each frame is solved alone.
    """

    def __init__(
        self,
        readings: Displacements,
        skin: Skin,
        *,
        distance: float | None,
        track: bool,
        every: int,
        options: Mapping[str, Any],
        depth_map: DepthMap | None = None,
    ) -> None:
        self.readings, self.skin, self.distance, self.every, self.depth_map = readings, skin, distance, every, depth_map
        self._options = dict(options)
        if depth_map is not None and self._options.get("components") is None:
            # Also in pictures without a depth: all frames of a recording use the same components.
            self._options["components"] = skin.surface.components
        self.tracker: Tracker | None = None
        if track:
            self.tracker = skin.track(baseline=readings.reference, **self._options)
        self._perspective = None if distance is None else _Perspective(skin, readings, distance)
        self._known: list[tuple[Any, float, Skin]] = []
        self._cells: Floats = np.stack(np.meshgrid(*skin.surface.axes[::-1]), axis=-1).reshape(-1, 2)
        self.last: Reading | None = None

    def __iter__(self) -> Iterator[Touch]:
        for reading in self.readings:
            if self.tracker is None and reading.index % self.every:
                continue
            self.last = reading
            touch = (
                self.alone(reading)
                if self.tracker is None
                else self.step(reading.values, reading.time, std=reading.std)
            )
            if reading.fault:
                touch = replace(touch, assumptions=(*touch.assumptions, f"no touch in a picture: {reading.fault}"))
            yield touch

    def step(self, values: Floats, time: float, *, std: Floats | None = None) -> Touch:
        """The touch of displacements (2, n) with their standard deviations at a time [s], by the tracker;
        `Unsupported` if frames are not tracked.
        """
        if self.tracker is None:
            raise Unsupported("frames are solved by themselves here; give track=True to follow them.")
        if self._perspective is not None:
            # Scale the correction of the previous picture by the change of the dots' motion: the contact changes little
            # between pictures.
            values = self._perspective.taken_out(values, self._perspective.growth(values))
        touch = self.tracker.step(values, time, std=std)
        if self._perspective is not None:
            self._perspective.learn(touch)
        return replace(self._censored(touch, values), view=self.readings.view)

    def alone(self, reading: Reading) -> Touch:
        """The touch of a single reading, solved without a tracker."""
        return replace(self._censored(self._alone(reading), reading.values), view=self.readings.view)

    def _censored(self, touch: Touch, values: Floats) -> Touch:
        """Widen the intervals for loads where dots are lost: the lost dots may be those that moved most."""
        lost = np.isnan(values).any(axis=0)
        if not lost.any() or touch._errors is None or not bool(np.all(touch.touching)):
            return touch
        size = np.sqrt((to_numpy(touch.values) ** 2).sum(axis=0)).ravel()
        reach = BLIND * typical_distance(self.readings.positions)
        every, left = (
            _within_reach(self._cells, self.readings.positions[which], reach) for which in (slice(None), ~lost)
        )
        share = float(size[every & ~left].sum() / max(float(size.sum()), 1e-300))
        if not share > FEW_LOST:
            return touch
        force = np.nan_to_num(to_numpy(touch.force))
        peak = float(size.max())
        found = {
            "traction": np.full(np.shape(touch.values), peak),
            "force": np.append(np.full(len(force) - 1, np.hypot.reduce(force[:-1])), abs(force[-1])),
            "moment": np.abs(np.nan_to_num(to_numpy(touch.moment))),
            "center": np.full(2, reach),
            "peak": np.asarray(peak),
        }
        wider = touch._errors.adding({name: share * value for name, value in found.items()})
        return replace(touch, _errors=wider, assumptions=(*touch.assumptions, LOST))

    def _alone(self, reading: Reading) -> Touch:
        lost = np.isnan(reading.values).any(axis=0)
        if lost.mean() > MAX_LOST_FRACTION:
            return _missing(self.skin, self._options.get("components"), reading.time)
        skin = self._at(lost, reading.std)
        values = np.where(lost, 0.0, reading.values)
        beside: list[Floats] = []
        if self.depth_map is not None:
            known = self.depth_map.plane(reading.index, self.readings.positions, self.skin.surface)
            if known is not None:
                skin, beside = _of_dots(skin, skin.planes[0], known[0]), [known[1][None]]

        def solved(values: Floats) -> Touch:
            parts: Any = [values[None], *beside] if beside else values[None]
            return skin.reconstruct(parts, time=[reading.time], **self._options)[0]

        touch = solved(values)
        if self._perspective is None:
            return touch
        last, least = values, MATTERS * float(np.nanmedian(reading.std))
        for _ in range(PASSES - 1):
            self._perspective.learn(touch)
            better = self._perspective.taken_out(values)
            if float(np.sqrt(np.mean((better - last)[:, ~lost] ** 2))) < least:
                break
            last = better
            touch = solved(better)
        return touch

    def _at(self, lost: Any, std: Floats) -> Skin:
        """A skin without the lost dots, with the stated noise; reuse a prepared one that excludes only a few more."""
        plane = self.skin.planes[0]
        level = 0.0  # as the skin says
        if plane.noise is None and np.isfinite(std).any():
            level = NOISE_STEP ** math.ceil(math.log(float(np.nanmedian(std)), NOISE_STEP))
        for known, noise, skin in self._known:
            if noise == level and not (lost & ~known).any() and (known & ~lost).sum() <= 0.05 * len(lost):
                return skin
        skin = self.skin
        if level:
            skin = _of_dots(skin, replace(plane, noise=level))
        if lost.any():
            skin = skin.masked(~lost)
        self._known = [(lost, level, skin), *self._known[: KEPT - 1]]
        return skin

    def close(self) -> None:
        """Close source and tracker."""
        self.readings.close()
        if self.tracker is not None:
            self.tracker.close()

    def __enter__(self) -> Touches:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Perspective:
    """Perspective correction: a dot at q from the optical axis that moves u_z towards the camera at distance D appears
    at q D / (D - u_z).
    """

    def __init__(self, skin: Skin, readings: Displacements, distance: float) -> None:
        view = readings.view
        lens = view.lens
        middle = (np.array(readings.size) - 1) / 2.0 if lens is None else lens.matrix[:2, 2]
        self._axis = view.places(middle)
        self._positions, self._distance = readings.positions, distance
        array = ScatteredArray(positions=self._positions, depth=skin.planes[0].depth, channels=["displacement_z"])
        self._towards = Skin(skin.pad, array, surface=skin.surface)
        self._part = np.zeros(len(self._positions))
        self._before: Floats | None = None

    def growth(self, values: Floats) -> float:
        """Ratio of displacements (2, n) to those of the last call: their projection on these."""
        before, self._before = self._before, values
        if before is None:
            return 1.0
        both = np.isfinite(before) & np.isfinite(values)
        size = float((before[both] ** 2).sum())
        return float(np.clip((before[both] * values[both]).sum() / size, 0.0, 2.0)) if size > 0 else 1.0

    def learn(self, touch: Touch) -> None:
        """Update u_z from the solution; missing values stay."""
        values = np.asarray(touch.values)
        if np.isfinite(values).all():
            self._part = np.asarray(self._towards.operator.forward(values)[0]).ravel() / self._distance

    def taken_out(self, values: Floats, growth: float = 1.0) -> Floats:
        """Displacements (2, n) corrected to a camera at infinite distance."""
        seen = self._positions + values.T - self._axis
        return np.asarray((values.T - growth * seen * self._part[:, None]).T)


def _missing(skin: Skin, components: Sequence[str] | None, time: float) -> Touch:
    shape = (len(skin.surface.components), *skin.surface.shape)
    return Touch(
        np.full(shape, np.nan),
        skin.surface,
        skin.problem(components=components).components,
        "automatic",
        time=np.asarray(time),
        status=np.asarray(int(Status.MISSING), dtype=np.int8),
        assumptions=(
            "more than half of the dots are lost: they are hidden, or moved too far from one picture to the next",
        ),
    )


def _within_reach(cells: Floats, dots: Floats, reach: float) -> npt.NDArray[np.bool_]:
    """Mask of cells (n, 2) within ``reach`` of a dot."""
    from scipy.spatial import cKDTree

    if not len(dots):
        return np.zeros(len(cells), dtype=bool)
    return np.asarray(cKDTree(dots).query(cells)[0] <= reach)


def follow(
    source: Any,
    skin: Skin | str | Path,
    *,
    view: View | None = None,
    reference: int | None = None,
    rate: float | None = None,
    stage: bool | None = None,
    distance: float | None = None,
    track: bool | None = None,
    every: int = 1,
    depth_map: DepthMap | None = None,
    texture: float | None = None,
    roi: npt.ArrayLike | None = None,
    **options: Any,
) -> Touches:
    """Reconstruct what touches a gel, from pictures of the dots in it.

    Parameters
    ----------
    source : str, Path, int, arrays or Pictures
        A video, folder, TIFF stack, camera or arrays (`open_pictures`); the first ``reference`` pictures show the gel at rest.
    skin : path of a skin.toml, or Skin
        Pad, depth of the dots, channels displacement_x and displacement_y. Positions come from the pictures.
    view : View, optional
        How pixels become metres; by default from the section [camera] of the skin.toml.
    reference, rate, stage : optional
        As for `Displacements`.
    distance : float, optional
        From the camera's centre to the dots [m] (default: that of [camera]). Without one, perspective is ignored: right for a camera far away.
    track : bool, optional
        True: follow frame by frame with `Skin.track`, at the rate of a camera; its normal force has errors of up to a third if the dots only move
        sideways, and its touches say so. False: `Skin.reconstruct` for each frame alone, seconds each. Default: False if the channels alone do not
        separate pressure from shear.
    every : int
        With track=False, solve one in this many frames.
    depth_map : DepthMap, optional
        Indentation of the surface from another source: it separates pressure from shear, and the normal force becomes several times better. With
        track=False.
    texture : float, optional
        For a gel with a texture and no dots: distance between the places of the readings [m]; default: that of [camera], else a search for dots.
    roi : array (n, 2), optional
        Corners (column, row) of the gel in the pictures [pixels], as for `Displacements`; default: those of [camera], if it also gives the view, or
        the gel's rim.
    **options
        Those of `Skin.track` (friction, ...) or `Skin.reconstruct` (friction, method, ...).

    Returns
    -------
    Touches
        Iterate over it for one `Touch` per picture. x goes to the right of the picture, y up; `View.pixels` says where a place lies in the picture.

    Raises
    ------
    InvalidInput
        Pictures without dots, a gel that moves in the reference, a skin of other channels, no way from pixels to metres.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Scene, dot_grid, follow
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.0).sliding(0.3)
    >>> pictures = list(scene.pictures([None] * 5 + [ball] * 3))
    >>> array = pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
    >>> with follow(pictures, pp.Skin(gel, array), view=scene.view, rate=30.0, track=True) as touches:
    ...     forces = [touch.force for touch in touches]
    >>> len(forces), bool(abs(forces[-1][0] - 0.3) < 0.02)  # sideways [N]
    (8, True)
    """
    if isinstance(every, bool) or not (isinstance(every, int) and every >= 1):
        raise InvalidInput(f"every must be a whole number of at least 1; got {every!r}.")
    settings = camera_of(skin, view)
    if distance is None and settings is not None:
        distance = settings.distance
    if stage is None and settings is not None:
        stage = settings.stage
    if reference is None and settings is not None:
        reference = settings.reference
    if texture is None and settings is not None:
        texture = settings.texture
    lies: Any = settings if view is None else view
    readings = Displacements(source, lies, reference=reference, rate=rate, stage=stage, texture=texture, roi=roi)
    try:
        full = gel_skin(skin, readings.positions)
        if track is None:
            track = every == 1 and depth_map is None and not full.problem().ambiguous
        elif track and depth_map is not None:
            raise Unsupported("a tracker takes the dots alone: leave out depth_map, or give track=False.")
        elif track and every != 1:
            raise Unsupported("a tracker takes every frame: leave out every, or give track=False.")
        return Touches(
            readings, full, distance=distance, track=track, every=every, options=options, depth_map=depth_map
        )
    except BaseException:
        readings.close()
        raise
