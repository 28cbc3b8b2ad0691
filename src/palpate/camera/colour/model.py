"""The learned model of a colour gel, and the relief that it computes from a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.camera.colour.change import (
    change_of,
    changed_places,
    dark_spots,
    reduced,
    saturated_or_black,
    step_of,
)
from palpate.camera.colour.integration import integrate
from palpate.camera.colour.response import STEPS, Response, bases, solve_slopes
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.view import View

__all__ = ["Relief", "SlopeModel", "grid_of"]

#: Chi-squared (one degree of freedom) above which a pixel does not fit the model: dust, glare, a dot. 25 is five
#: standard deviations.
OUTLYING = 25.0
#: Standard deviations of the picture's own depth noise by which a contact must stand out.
CLEAR = 6.0
#: Fraction of the contact above which a note is added: colours of another gel, slopes steeper than learned, hidden
#: pixels.
FOREIGN, STEEP, HIDDEN = 0.25, 0.1, 0.2
#: If the colour of the median pixel changes by more, the picture does not show this gel in this light: overall drift of
#: the light is subtracted first, and a contact leaves half of the picture unchanged.
MAX_COLOUR_CHANGE = 0.1
#: Relative weight of pixels without information in the integration: small enough to follow their neighbours, large
#: enough for a well-conditioned equation.
MIN_WEIGHT = 0.05


def grid_of(view: View, size: tuple[int, int], step: int) -> tuple[Floats, Floats]:
    """Places (2, row, column) [m] of the blocks of a picture of ``size`` (columns, rows), and the same scaled to -1 to
    1.
    """
    columns, rows = size[0] // step, size[1] // step
    at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    places = view.places((at + 0.5) * step - 0.5)
    scaled = (at + 0.5) / np.array([columns, rows]) * 2.0 - 1.0
    return np.moveaxis(places, -1, 0).copy(), np.moveaxis(scaled, -1, 0).copy()


@dataclass(frozen=True, eq=False)
class Relief:
    """The shape of a gel's surface in one picture.

    Attributes
    ----------
    depth, std : array (row, column)
        Indentation of the surface [m], positive into the gel, zero at the edge of the picture; and its standard deviation.
    slopes : array (2, row, column)
        du_z/dx and du_z/dy, x right and y up.
    places : array (2, row, column)
        (x, y) of each [m].
    known : array (row, column) of bool
        False for pixels without information (saturated, dust, a dot, another coat); their depth is interpolated.
    contact, near : array (row, column) of bool
        Where colours changed by more than noise and drift; and this area plus the surroundings in which slopes are
        used.
    noise : float
        Standard deviation of the depth where nothing touches [m], from this picture.
    errors : array (cause, row, column)
        Common error of the depth [m], one standard deviation each: due to each press of the calibration, to the gain of all slopes, and to slopes that
        are hidden or steeper than the learnt ones. One cause of zero if no colour changed.
    touching : bool
        Whether anything exceeds the noise.
    said : tuple of str
        Notes on this picture.
    """

    depth: Floats
    std: Floats
    slopes: Floats
    places: Floats
    known: npt.NDArray[np.bool_]
    contact: npt.NDArray[np.bool_]
    near: npt.NDArray[np.bool_]
    noise: float
    errors: Floats
    touching: bool
    said: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SlopeModel:
    """Colour to slope of one gel and camera, learnt by `learn_slopes`.

    Attributes
    ----------
    response : Response
        The polynomial from slope and place to colour.
    left_out : array (press, ...)
        Its coefficients without each press: their spread is the standard error (the jackknife).
    covariance : array (channel, channel)
        Covariance of the colour residuals of the model, in cross-validation.
    rest : array (row, column, 3)
        The gel at rest, from 0 to 1, in blocks.
    size : (int, int)
        Columns and rows of its pictures.
    view : View
        Pixels to metres.
    ball_diameter : float
        [m]
    gain_std : float
        Relative standard deviation of all slopes together, from presses that were left out.
    slope_error, depth_error : float
        Root mean square error inside the contact of presses that were left out: of the slope, and of depth [m].
    table : tuple
        For each press: its name, contact radius [m], gain, error of slope and of depth [m], by the model learnt without it.
    said : tuple of str
        Notes.
    """

    response: Response
    left_out: Floats
    covariance: Floats
    rest: Floats
    size: tuple[int, int]
    view: View
    ball_diameter: float
    gain_std: float
    slope_error: float
    depth_error: float
    table: tuple[tuple[str, float, float, float, float], ...] = ()
    said: tuple[str, ...] = ()
    _grids: dict[str, Any] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        lines = [
            f"{len(self.table)} presses of a ball of {1e3 * self.ball_diameter:.4g} mm; slopes up to {self.response.steepest:.2g}",
            f"presses that were left out: slope off by {self.slope_error:.2g}, depth by {1e6 * self.depth_error:.2g} um, all slopes together by {100 * self.gain_std:.2g} % (standard deviations)",
            *self.said,
        ]
        return "\n".join(lines)

    @property
    def step(self) -> int:
        """Pixels along the side of a block."""
        return step_of(self.size)

    @property
    def typical_depth(self) -> float:
        """Median over the presses of the learning of the depth of the contact's middle below its edge [m]."""
        r = 0.5 * self.ball_diameter
        return float(np.median([r - math.sqrt(max(r * r - row[1] ** 2, 0.0)) for row in self.table]))

    def _grid(self) -> tuple[Floats, Floats]:
        if "grid" not in self._grids:
            places, scaled = grid_of(self.view, self.size, self.step)
            base = bases(scaled, self.rest)
            self._grids["grid"] = places, base.reshape(-1, base.shape[-1])
        found: tuple[Floats, Floats] = self._grids["grid"]
        return found

    @property
    def bases(self) -> Floats:
        """The terms of the response at each block (row * columns + column, term)."""
        return self._grid()[1]

    def prepared(self, image: npt.ArrayLike, name: str = "picture") -> tuple[Floats, npt.NDArray[np.bool_]]:
        """A picture in blocks and its saturated or black pixels; `InvalidInput` for another size."""
        shape = np.shape(image)
        if len(shape) == 3 and (shape[1], shape[0]) != self.size:
            raise InvalidInput(
                f"{name}: the picture is {shape[1]} x {shape[0]}, and the gel was calibrated with {self.size[0]} x {self.size[1]}: use the camera mode of the calibration, or calibrate again."
            )
        return reduced(image, self.step, name)

    def relief(self, image: npt.ArrayLike, *, rest: Floats | None = None, name: str = "picture") -> Relief:
        """The shape of the surface in a picture.

        Parameters
        ----------
        image : array (row, column, 3)
            Red, green, blue, of the calibration's size.
        rest : array (row, column, 3), optional
            Picture of the gel at rest in the same session, in blocks (`prepared`); default: that of the calibration.
            Lights and coats change from day to day.
        name : str
            Name of the picture, for messages.

        Raises
        ------
        InvalidInput
            A grey picture, one of another size, of another gel or light, or one of which nothing is to be seen; ``rest``
            that is no picture in blocks.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> from palpate.camera import learn_slopes
        >>> # model = learn_slopes("presses/", view, ball_diameter=8e-3)
        >>> # relief = model.relief(picture)
        """
        still = self.rest if rest is None else self._still(rest)
        values, lost = self.prepared(image, name)
        places, base = self._grid()
        lost = lost | dark_spots(values) | dark_spots(still) | saturated_or_black(still)
        if lost.mean() > 0.9:
            raise InvalidInput(
                f"{name}: {100 * float(lost.mean()):.0f} % of the picture is saturated, black or covered: lower exposure or light until the brightest channel stays below 250 of 255."
            )
        change = change_of(values, still)
        different = float(np.median(np.abs(change).max(axis=2)[~lost]))
        if different > MAX_COLOUR_CHANGE:
            raise InvalidInput(
                f"{name}: half of the picture differs from the gel at rest by {100 * different:.0f} % and more in colour: another gel, other lights, or a camera that moved. Give pictures at rest of today (--baseline, or rest=), or calibrate this gel."
            )
        shape = lost.shape
        contact = changed_places(change, still, lost)
        window = _window(contact)
        flat, inside = change.reshape(-1, 3), window.ravel() > 0
        slopes, spread, misfit, by = (np.empty((len(flat), *rest)) for rest in ((2,), (2, 2), (), (3, 2)))
        for chosen, steps in ((inside, STEPS), (~inside, 1)):
            parts = solve_slopes(self.response, flat[chosen], base[chosen], self.covariance, steps=steps)
            for whole, part in zip((slopes, spread, misfit, by), parts):
                whole[chosen] = part
        outlying = (misfit > OUTLYING).reshape(shape)
        known = ~(lost | outlying)
        variance = np.einsum("nii->n", spread).reshape(shape)
        weight = np.clip(float(np.median(variance)) / variance, MIN_WEIGHT, 1.0) * np.where(known, 1.0, MIN_WEIGHT)
        field_of = _filled(np.moveaxis(slopes.reshape(*shape, 2), -1, 0), known)
        pixel = float(np.sqrt(np.abs(np.linalg.det(self.view.jacobian((np.array(self.size) - 1) / 2.0)))) * self.step)
        # White noise of slopes integrates to about one step of it; drift of the light to the variation seen in the rest
        # of the picture.
        white = (
            pixel
            * float(np.sqrt(np.median(variance) / 2.0))
            * _quiet_scale(flat[~inside & known.ravel()], self.covariance)
        )
        noise = max(white, _wander(integrate(field_of, weight, places), window, places))
        if not contact.any():
            zero = np.zeros(shape)
            quiet = (
                "no contact: no change of colour stands out from noise and drift of the light. A body that presses all of the view evenly would show none",
            )
            return Relief(
                zero,
                zero + noise,
                field_of,
                places,
                known,
                contact,
                window > 0,
                noise,
                np.zeros((1, *shape)),
                False,
                quiet,
            )
        used = field_of * window
        depth = integrate(used, weight, places)
        errors = self._errors(slopes, spread, by, base, known, weight, places, depth, used, window)
        levelled = _levelled(np.concatenate([depth[None], errors]), window, places)
        depth, errors = levelled[0], levelled[1:]
        std = np.sqrt(noise**2 + (errors**2).sum(axis=0))
        said = self._notes_of(contact, known, outlying & ~lost, slopes, depth)
        touching = bool(depth[contact].max() > CLEAR * noise)
        if not touching:
            said.insert(
                0,
                f"no contact: colours changed, and no depth above {1e6 * CLEAR * noise:.1f} um stands out: dirt, or a light that moved",
            )
        return Relief(depth, std, used, places, known, contact, window >= 1.0, noise, errors, touching, tuple(said))

    def _still(self, rest: npt.ArrayLike) -> Floats:
        """A picture at rest in blocks; `InvalidInput` for anything else, such as the picture itself."""
        still = np.asarray(rest)
        if still.shape != self.rest.shape or still.dtype.kind != "f" or not (still.min() >= 0.0 and still.max() <= 1.0):
            raise InvalidInput(
                f"rest must be a picture in blocks, {self.rest.shape} from 0 to 1; got {still.dtype} of shape {still.shape}. Give rest=model.prepared(picture)[0]."
            )
        return still

    def _notes_of(
        self,
        contact: npt.NDArray[np.bool_],
        known: npt.NDArray[np.bool_],
        outlying: npt.NDArray[np.bool_],
        slopes: Floats,
        depth: Floats,
    ) -> list[str]:
        said = []
        foreign = float(outlying[contact].mean())
        if foreign > FOREIGN:
            said.append(
                f"{100 * foreign:.0f} % of the pixels that changed have colours that this gel does not show: another gel, other lights, or a dark body under a coat that lets light through. Depth is not to be trusted; calibrate this gel"
            )
        steep = (
            float((np.hypot(*slopes.T).reshape(contact.shape) > self.response.steepest)[contact & known].mean())
            if (contact & known).any()
            else 0.0
        )
        if steep > STEEP:
            said.append(
                f"{100 * steep:.0f} % of the contact is steeper than the ball that taught the slopes (up to {self.response.steepest:.2g}): depth may be larger. Calibrate with a smaller ball, pressed deeper"
            )
        hidden = float((~known)[contact].mean())
        if hidden > HIDDEN and foreign <= FOREIGN:
            said.append(
                f"{100 * hidden:.0f} % of the contact is hidden (saturated, covered, or of foreign colour): slopes are carried across there"
            )
        if -depth.min() > depth.max():
            said.append(
                "the surface stands out more than it is pressed in: the picture at rest shows a contact, or the gel is another"
            )
        return said

    def _errors(
        self,
        slopes: Floats,
        spread: Floats,
        by: Floats,
        base: Floats,
        known: npt.NDArray[np.bool_],
        weight: Floats,
        places: Floats,
        depth: Floats,
        used: Floats,
        window: Floats,
    ) -> Floats:
        """Depth errors (cause, row, column), each common to all pixels."""
        shape = known.shape
        inverse = np.linalg.inv(self.covariance)
        value = self.response.change(slopes, base)
        causes = []
        count = len(self.left_out)
        for coefficients in self.left_out:
            other = replace(self.response, coefficients=coefficients)
            # Slopes change so that the other polynomial gives the same colours.
            moved = -np.einsum("nij,nkj,kl,nl->ni", spread, by, inverse, other.change(slopes, base) - value)
            moved *= math.sqrt((count - 1) / count)
            limit = 0.5 * self.response.steepest
            causes.append(np.clip(moved, -limit, limit).T.reshape(2, *shape) * known * window)
        # Common error of the slopes, from cross-validation.
        causes.append(self.gain_std * used)
        # Hidden slopes, and those at the learned limit: an error of half of the steepest slope, downhill.
        steep = np.hypot(*slopes.T).reshape(shape) > self.response.steepest
        doubtful = (~known | steep) & (depth > 0.1 * max(float(depth.max()), 1e-12))
        way = used / np.maximum(np.hypot(*used), 1e-6)
        causes.append(0.5 * self.response.steepest * way * doubtful)
        field_of = np.stack(causes)
        out = integrate(field_of[:-1], weight, places)
        # Hidden pixels have a small weight, but cause this error.
        return np.concatenate([out, integrate(field_of[-1:], np.ones(shape), places)])


def _filled(slopes: Floats, known: npt.NDArray[np.bool_]) -> Floats:
    """Fill in slopes of pixels without information from their neighbours."""
    from scipy.ndimage import gaussian_filter

    if known.all():
        return slopes
    weight = gaussian_filter(known.astype(np.float64), 3.0)
    around = np.stack([gaussian_filter(s * known, 3.0) for s in slopes]) / np.maximum(weight, 1e-3)
    return np.asarray(np.where(known, slopes, around))


def _quiet_scale(flat: Floats, covariance: Floats) -> float:
    """Scatter of the quieter half of the pixels relative to the model, at least 1."""
    size = np.einsum("nk,kl,nl->n", flat, np.linalg.inv(covariance), flat)
    # the median of chi-squared of three degrees of freedom is 2.366
    return max(1.0, math.sqrt(float(np.median(size)) / 2.366)) if len(size) else 1.0


def _window(contact: npt.NDArray[np.bool_]) -> Floats:
    """Weight of each pixel: 1 at the contact and up to its own width away, decreasing to 0 over half of that. Farther
    away, slopes show only drift of the light.
    """
    from scipy.ndimage import distance_transform_edt

    if not contact.any():
        return np.zeros(contact.shape)
    reach = max(2.0 * float(distance_transform_edt(contact).max()), 10.0)
    away = distance_transform_edt(~contact)
    return np.asarray(np.clip(1.0 - (away - reach) / (0.5 * reach), 0.0, 1.0))


def _levelled(depth: Floats, window: Floats, places: Floats) -> Floats:
    """Depth (*more, row, column) minus the plane through its rim, where the window ends, because unequal slope errors
    of the flanks cause a ramp that no contact makes. 0 outside.
    """
    rim = (window > 0) & (window < 1)
    if rim.sum() < 20:
        return depth
    size = float(np.abs(places).max())
    rows = np.stack([np.ones_like(places[0]), places[0] / size, places[1] / size], axis=-1)
    flat = depth.reshape(-1, *window.shape)
    found = np.linalg.lstsq(rows[rim], flat[:, rim].T, rcond=None)[0]
    plane = np.moveaxis(rows @ found, -1, 0)
    return np.asarray(np.where(window > 0, flat - plane, 0.0)).reshape(depth.shape)


def _wander(depth: Floats, window: Floats, places: Floats) -> float:
    """Standard deviation of the depth outside the contact after subtracting a plane; 0 if nothing is outside."""
    beyond = (window == 0)[::2, ::2]
    if beyond.mean() < 0.1:
        return 0.0
    values = depth[::2, ::2][beyond]
    x, y = places[:, ::2, ::2][:, beyond] / np.abs(places).max()
    rows = np.stack([np.ones_like(x), x, y], axis=-1)
    left = values - rows @ np.linalg.lstsq(rows, values, rcond=None)[0]
    return float(1.4826 * np.median(np.abs(left)))
