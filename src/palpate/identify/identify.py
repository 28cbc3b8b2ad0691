"""Find which round contacts explain the readings, and derive the properties of the object.

Inputs are a skin, readings, and the touch computed from them, which gives starting places of the contacts and the size
of the noise. The properties of contacts come from the readings: the penalty blurs a map, and the moments of the map
would be blurred too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import scipy.ndimage
import scipy.special

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats, Pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, Unsupported
from palpate.identify.findings import Finding, Identified, IdentifiedPress, Patch
from palpate.identify.fitting import Data, Fit, fit, fit_of, profile
from palpate.identify.frame import Body, Frame
from palpate.identify.objects import identified
from palpate.identify.press import combine_frames, joint_shape
from palpate.identify.shapes import BALL, FLAT, Shapes, by_reading, flat_readings
from palpate.identify.texture import texture
from palpate.sensing.arrays import Array
from palpate.sensing.grids import AreaGrid
from palpate.sensing.nuisance import NUISANCES, groups, nuisances
from palpate.sensing.readings import checked_planes
from palpate.sensing.uncertainty import Uncertainty, step_of, stretched
from palpate.touch import Touch

__all__ = ["Skinlike", "identify"]

#: If the probability of the misfit is below this, contacts do not explain the frame.
REFUSED = 0.01
#: A ball or a flat is reported at log odds of at least this: 100 to 1.
ODDS = math.log(100.0)
#: Largest number of patches, and smallest pressure of a further patch relative to the largest.
MOST, SHARE = 4, 0.15
#: Level of all intervals.
LEVEL = 0.95
#: Number of rounds in which contact and wave are fitted alternately.
ROUNDS = 6
#: Error of the modelled readings relative to the largest one (tests/identify/test_identify.py): noise is taken as at
#: least this.
MODEL = 3e-4
#: Reason for unknown properties in a frame without contact.
NOTHING = "nothing touches"
#: The reason given for one that pulls.
PULLS = "the contact pulls: Hertz's relations are for one that pushes"


class Skinlike(Protocol):
    """The members of `palpate.Skin` that `identify` uses."""

    @property
    def pad(self) -> Pad:
        """The elastic body."""
        ...

    @property
    def planes(self) -> tuple[Array, ...]:
        """The arrays."""
        ...

    @property
    def uncertainty(self) -> Uncertainty:
        """The uncertainty of pad and sensors."""
        ...


def identify(
    skin: Skinlike,
    touch: Touch,
    readings: Any,
    *,
    indentation: npt.ArrayLike | None = None,
    shape: str | None = None,
) -> Identified | IdentifiedPress:
    """Identify what presses the pad, from readings and their touch; see `palpate.Skin.identify`.

    Raises
    ------
    InvalidInput
        Readings of other frames than the touch's, or an indentation that is not one positive number for each frame.
    Unsupported
        Line contact; a pad that creeps; a contact that takes too many cells.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.identify import identify
    >>> array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), array)
    >>> readings = skin.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=2.0))
    >>> found = identify(skin, skin.reconstruct(readings, method="tikhonov"), readings)
    >>> len(found.patches), found.patches[0].force[2].low < 2.0 < found.patches[0].force[2].high
    (1, True)
    """
    if not isinstance(touch.surface, AreaGrid):
        raise Unsupported(
            "identify needs area contact: in line contact there is no ball and no round flat. touch.contact_area() gives the width of the contact."
        )
    if isinstance(skin.pad, Viscoelastic):
        raise Unsupported(
            "identify cannot use pads that creep: remove the creep from the readings first, and use skin.without_creep()."
        )
    if shape not in (None, BALL, FLAT):
        raise InvalidInput(f'shape must be "{BALL}" or "{FLAT}", or None to find out; got {shape!r}.')
    if len(touch.batch) > 1:
        raise InvalidInput(f"identify takes one frame or a recording; this touch has the batch axes {touch.batch}.")
    parts = [to_numpy(part) for part in checked_planes(readings, skin.planes)]
    lead = parts[0].shape[: parts[0].ndim - 1 - len(skin.planes[0].shape)]
    if lead != touch.batch:
        raise InvalidInput(
            f"readings have the batch axes {lead}, the touch {touch.batch}: pass the readings that the touch was computed from."
        )
    depths = _depths(indentation, touch.batch)
    body = Body(skin.pad, tuple(skin.planes), skin.uncertainty)
    if not touch.batch:
        return identified(_frame(body, touch, parts, float(depths), shape))
    frames = [_frame(body, touch[i], [p[i] for p in parts], float(depths[i]), shape) for i in range(len(touch))]
    joint = shape or joint_shape(frames, ODDS)
    for i, frame in enumerate(frames):
        if joint and frame.best is not None and len(frame.best.radii) == 1 and frame.shape != joint:
            frames[i] = _frame(body, touch[i], [p[i] for p in parts], float(depths[i]), joint)
    return combine_frames(frames, depths, joint)


def _depths(indentation: npt.ArrayLike | None, batch: tuple[int, ...]) -> Floats:
    if indentation is None:
        return np.full(batch, math.nan)
    try:
        depths = np.broadcast_to(np.asarray(indentation, dtype=np.float64), batch)
    except (ValueError, TypeError):
        raise InvalidInput(
            f"indentation must be one number [m] for each frame ({batch}); got the shape {np.shape(indentation)}."
        ) from None
    if (depths[np.isfinite(depths)] < 0).any():
        raise InvalidInput(
            f"indentation must not be negative: how far the object has moved into the pad since it touched [m]; got {float(np.nanmin(depths)):g}."
        )
    return depths


def _frame(body: Body, touch: Touch, parts: Sequence[Floats], depth: float, wanted: str | None) -> Frame:
    """Fit one frame. ``wanted`` is the shape of a single contact, if known."""
    components = touch.components
    if "z" not in components:
        return Frame(body, "pressure was not estimated")
    pressure = np.nan_to_num(to_numpy(touch.values)[-1])
    touching = touch.touching is None or bool(touch.touching)
    if not touching or not pressure.any():
        return Frame(body, NOTHING)
    if not pressure.max() > 0:
        return Frame(body, PULLS)
    data = _data(body, touch, parts)
    if data is None:
        return Frame(
            body, "the noise of the readings is not known: give the array noise=..., or frames at rest (zero=)"
        )
    shapes = _shapes(body, components, touch, pressure)
    best, other, waves = _explained(shapes, data, _starts(touch, pressure), wanted)
    guesses = tuple(_guess(touch, pressure, region) for region in _regions(pressure))
    if best.forces[:, -1].min() <= 0:
        return Frame(body, PULLS, misfit=best.misfit)
    if best.misfit < REFUSED:
        reason = f"round contacts do not explain the readings (misfit probability {best.misfit:.2g})"
        return Frame(body, reason, guesses=guesses, misfit=best.misfit, components=components)
    freedom = max(best.freedom, 1)
    scale = max(1.0, best.squares / freedom)
    rise = float(scipy.special.stdtrit(freedom, 0.5 * (1.0 + LEVEL))) ** 2 * scale
    shape, why = best.shape, ""
    if other is not None and wanted is None:
        gain = 0.5 * (other.squares - best.squares) / scale
        if gain < ODDS:
            shape, why = (
                "",
                f"a ball and a flat fit the readings equally well (odds {math.exp(gain):.2g} to 1 for a {best.shape})",
            )
    alone = len(best.radii) == 1
    return Frame(
        body,
        best=best,
        other=other,
        shape=shape,
        shape_reason=why,
        rise=rise,
        profiles=tuple(profile(shapes, waves or data, best, i, rise) for i in range(len(best.radii))),
        shifts=tuple(_shifted(body, shapes, waves or data, best)),
        texture=texture(shapes, data, fit_of(shapes, data, best), rise) if alone else None,
        depth=depth,
        guesses=guesses,
        misfit=best.misfit,
        components=components,
    )


def _data(skin: Body, touch: Touch, parts: Sequence[Floats]) -> Data | None:
    """Return readings divided by their noise; excluded and saturated ones are zero."""
    values = flat_readings(skin.planes, parts)
    noise = touch.noise_std
    if noise is None or not np.all(np.isfinite(noise)) or not np.all(np.asarray(noise) > 0):
        stated = [p.noise_std for p in skin.planes]
        if any(s is None for s in stated):
            return None
        noise = np.concatenate([np.atleast_1d(np.asarray(s)) for s in stated])
    deviation = by_reading(skin.planes, np.asarray(noise, dtype=np.float64))
    gain = skin.uncertainty.assumed_gain or skin.uncertainty.stated_gain
    good = np.isfinite(values)
    for left_out in (touch.outliers, touch.at_limit):
        if left_out is not None and np.size(left_out) == len(values):
            good &= ~np.asarray(left_out, dtype=bool).ravel()
    values = np.nan_to_num(values)
    spread = np.sqrt(deviation**2 + (gain * values) ** 2 + (MODEL * np.abs(values).max()) ** 2)
    weights = np.where(good, 1.0 / spread, 0.0)
    return Data(values * weights, weights, _others(skin, touch, len(values)))


def _others(skin: Body, touch: Touch, count: int) -> Floats:
    """Return the nuisances (n, reading) that the touch found, and the offsets of all channels beside any."""
    if touch.nuisance is None:
        return np.zeros((0, count))
    sizes = np.nan_to_num(np.asarray(touch.nuisance, dtype=np.float64))
    found = {label for (label, _), size in zip(touch.nuisance_names, sizes) if size != 0.0}
    every = [*nuisances(skin.planes, NUISANCES), *groups(skin.planes)]
    rows = [n.rows for n in every if found and (n.kind == "offset" or n.label in found)]
    return np.stack(rows) if rows else np.zeros((0, count))


def _regions(pressure: Floats) -> list[npt.NDArray[np.bool_]]:
    """Return the connected parts of the contact, largest force first. Parts with less than a tenth of the largest
    force are left out as noise of the map.
    """
    labels, count = scipy.ndimage.label(pressure > 0.1 * pressure.max(), structure=np.ones((3, 3)))
    parts = [labels == i for i in range(1, count + 1)]
    parts.sort(key=lambda r: -float(pressure[r].sum()))
    return [r for r in parts if pressure[r].sum() > 0.1 * pressure[parts[0]].sum()]


def _guess(touch: Touch, pressure: Floats, region: npt.NDArray[np.bool_]) -> Patch:
    """Return a part of the map as a patch without intervals."""
    grid = touch.surface
    values = to_numpy(touch.values)[:, region] * grid.cell
    why = "round contacts do not explain the readings: taken from the pressure map"
    yx = np.meshgrid(*grid.axes, indexing="ij")
    share = pressure[region] / pressure[region].sum()
    place = [Finding(float((share * axis[region]).sum()), unit="m", reason=why) for axis in yx[::-1]]
    forces = [
        Finding(float(v.sum()), unit="N", reason=why)
        if name in touch.components
        else Finding.unknown("N", f"force along {name} was not estimated")
        for name, v in zip(("x", "y", "z"), values)
    ]
    return Patch(
        (forces[0], forces[1], forces[2]),
        (place[0], place[1]),
        Finding(float(region.sum()) * grid.cell, unit="m^2", reason=why),
        Finding.unknown("m", why),
    )


def _starts(touch: Touch, pressure: Floats) -> list[tuple[Floats, float]]:
    """Return middles (x, y) and radii of the peaks of the map, highest first."""
    grid = touch.surface
    peaks = (pressure == scipy.ndimage.maximum_filter(pressure, size=3)) & (pressure > SHARE * pressure.max())
    rows = np.argwhere(peaks)
    rows = rows[np.argsort(-pressure[tuple(rows.T)])]
    out: list[tuple[Floats, float]] = []
    radius = math.sqrt(float((pressure > 0.1 * pressure.max()).sum()) * grid.cell / math.pi)
    for row in rows:
        place = np.array([grid.axes[1][row[1]], grid.axes[0][row[0]]])
        if all(np.hypot(*(place - other)) > 2.0 * max(grid.spacings) for other, _ in out):
            out.append((place, radius))
    return out[:MOST]


def _shapes(body: Body, components: Sequence[str], touch: Touch, pressure: Floats) -> Shapes:
    """Return shapes on cells around the contact in the map."""
    there = np.argwhere(pressure > 0.05 * pressure.max())
    axes, spacing = touch.surface.axes, max(touch.surface.spacings)
    low = np.array([axes[1][there[:, 1].min()], axes[0][there[:, 0].min()]]) - spacing
    high = np.array([axes[1][there[:, 1].max()], axes[0][there[:, 0].max()]]) + spacing
    return Shapes(body.pad, body.planes, components, low, high, 0.75 * float(np.max(high - low)))


def _explained(
    shapes: Shapes, data: Data, starts: list[tuple[Floats, float]], wanted: str | None
) -> tuple[Fit, Fit | None, Data | None]:
    """Return the smallest number of contacts that explain a frame. For a single contact, also return the fit of the
    other shape, and the frame with its texture if one is needed to explain it.
    """
    place, radius = starts[0]
    if len(starts) > 1:
        middle = np.mean([p for p, _ in starts], axis=0)
        single = min(
            (_single(shapes, data, p, radius, wanted) for p in (place, middle)), key=lambda two: two[0].squares
        )
    else:
        single = _single(shapes, data, place, radius, wanted)
    best, other = single
    count = max(data.count, 2)
    chosen: tuple[Fit, Fit | None, Data | None] = (best, other, None)
    if best.misfit < REFUSED:
        waves = _with_wave(shapes, data, best)
        if waves is not None:
            return waves[0], None, waves[1]
    for k in range(2, MOST + 1):
        if len(starts) < k and (k > 2 or best.misfit >= REFUSED):
            break
        places = np.array([p for p, _ in starts[:k]]) if len(starts) >= k else _split(best)
        more = fit(shapes, data, BALL, places, np.full(k, radius / math.sqrt(k)))
        # Schwarz's criterion: half the log of the number of readings for each further parameter
        worth = (more.parameters - chosen[0].parameters) * math.log(count)
        if more.forces[:, -1].min() > 0 and chosen[0].squares - more.squares > worth:
            chosen = (more, None, None)
        elif chosen[0].misfit >= REFUSED:
            break
    return chosen


def _with_wave(shapes: Shapes, data: Data, best: Fit) -> tuple[Fit, Data] | None:
    """Return the contact with a wave in its pressure, if both together explain the frame."""
    now = best
    for _ in range(ROUNDS):
        # the wave that explains most of the residual of the contact alone
        wave = texture(shapes, data, fit_of(shapes, data, now), 1.0)
        if wave.columns is None:
            return None
        more = Data(data.values, data.weights, np.concatenate([data.others, wave.columns]))
        now = fit(shapes, more, best.shape, now.centers, now.radii)
        if now.misfit >= REFUSED:
            return now, more
    return None


def _single(shapes: Shapes, data: Data, place: Floats, radius: float, wanted: str | None) -> tuple[Fit, Fit | None]:
    """Return the better fit of ball and flat, and the other one; if a shape is ``wanted``, only that."""
    found = []
    for shape, part in ((BALL, 1.0), (FLAT, 0.8)):
        if wanted in (None, shape):
            tried = [fit(shapes, data, shape, place[None], np.array([radius * part * f])) for f in (1.0, 0.4)]
            found.append(min(tried, key=lambda f: f.squares))
    found.sort(key=lambda f: f.squares)
    return found[0], found[1] if len(found) > 1 else None


def _split(best: Fit) -> Floats:
    """Return two places within one contact, as a start for two contacts."""
    move = np.array([0.6 * float(best.radii[0]), 0.0])
    return np.stack([best.centers[0] - move, best.centers[0] + move])


def _shifted(skin: Body, shapes: Shapes, data: Data, best: Fit) -> list[tuple[Fit, float]]:
    """Return the fit for each variation of the pad's description, with the standard deviation of the variation divided
    by the change made.
    """
    beside = skin.uncertainty.beside(skin.pad, skin.planes)
    out = []
    for name, size in (("depth", beside.depth or 0.0), ("thickness", beside.thickness or 0.0)):
        if size > 0:
            step = step_of(skin.pad, skin.planes, name)
            pad, planes = stretched(skin.pad, skin.planes, **{name: 1.0 + step})
            low, high = shapes.bounds
            other = Shapes(pad, planes, shapes.components, low, high, shapes.largest)
            out.append((fit(other, data, best.shape, best.centers, best.radii), size / step))
    return out
