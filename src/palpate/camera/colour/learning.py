"""Learn the relation of colours and slopes of a gel from presses of one ball."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.camera.colour.balls import MIN_CONTACT_RADIUS, Circle, find_circle
from palpate.camera.colour.change import change_of, dark_spots, reduced, step_of
from palpate.camera.colour.integration import integrate
from palpate.camera.colour.model import SlopeModel, grid_of
from palpate.camera.colour.response import Response, bases, ranks, solve_slopes
from palpate.camera.displacements import view_of
from palpate.camera.pictures import open_pictures
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.camerasection import CameraSettings
from palpate.sensing.view import View
from palpate.units import is_number

__all__ = ["learn_slopes"]

#: Smallest number of presses for cross-validation.
MIN_PRESSES = 3
#: Use pixels within this fraction of the radius of the ring of strongest colour: blur moves that ring two to three
#: blocks inside the edge of the contact, and inside it the slope is that of the ball.
RING_FRACTION = 1.0
#: Degrees in slope to try; ridges to try, relative to the mean square of a feature; factor of the ridge per rank; and
#: factor for rank 0. Of fifteen polynomials of place and light, four ridges and four ways to normalise colour, on eight
#: gels with 3 to 10 presses, this choice had the smallest error of slopes at other places.
DEGREES, RIDGES, EACH_RANK, RANK_0 = (2, 3), (1e-5, 1e-4, 1e-3), 4.0, 0.01
#: Rounds of alternating fits of centres and the polynomial.
ROUNDS = 4
#: Largest ratio of contact radius to ball radius: a ball pressed deeper is probably another ball.
MAX_CONTACT_RATIO = 0.9

#: Contacts wider than this fraction of the ball have flanks of 45 degrees, which no gel follows.
WIDE = 0.7


@dataclass(frozen=True, eq=False)
class _Press:
    name: str
    change: Floats
    lost: npt.NDArray[np.bool_]
    circle: Circle


def learn_slopes(
    source: Any,
    view: View | CameraSettings,
    *,
    ball_diameter: float,
    rest: Any = None,
    baseline: int | None = None,
) -> SlopeModel:
    """Learn how colours depend on slopes, from pictures of a ball of known size pressed into the gel.

    Within the contact the surface has the shape of the ball: the slope at distance r from the centre is r / sqrt(R^2 -
    r^2), for any gel. Three presses suffice; ten over the whole picture are better. The centre of each is found, the
    polynomial from slope and place to colour is fitted by least squares, and each press is left out once to measure
    the error.

    Parameters
    ----------
    source : str, Path, or iterable of arrays
        Pictures in colour, of which the first shows the gel at rest (`palpate.camera.open_pictures`).
    view : View or CameraSettings
        How pixels become metres: by scale or points, since there are no dots.
    ball_diameter : float
        [m], as a caliper reads it.
    rest : array (row, column, 3), optional
        The gel at rest, if the pictures do not begin with it.
    baseline : int, optional
        Pictures at the start that show the gel at rest. Default: the first, and others without contact.

    Raises
    ------
    InvalidInput
        Pictures without colour, fewer than three in which a ball is found, a view by dots, a ball that cannot be of this size.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Looks, Scene, learn_slopes
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> # see the how-to "Colour gels without dots" for a scene
    """
    if not (is_number(ball_diameter) and 0 < ball_diameter < 1.0):
        raise InvalidInput(f"ball_diameter must be a positive number of metres, such as 8e-3; got {ball_diameter!r}.")
    if isinstance(view, CameraSettings) and view.pitch is not None:
        raise InvalidInput(
            'a gel without dots has no pitch to set its scale: give scale = "0.06 mm" (per pixel), or points and places, in [camera].'
        )
    if baseline is not None and (isinstance(baseline, bool) or not isinstance(baseline, int) or baseline < 1):
        raise InvalidInput(f"baseline must be a number of pictures of at least 1; got {baseline!r}.")
    images, names = [], []
    with open_pictures(source) as pictures:
        size, title = pictures.size, pictures.name
        step = step_of(size)
        for picture in pictures:
            if picture.image is None:
                raise InvalidInput(
                    f"{title}, picture {picture.index}: {picture.fault}. Take it out, or record it again."
                )
            names.append(f"picture {picture.index}")
            images.append(reduced(picture.image, step, f"{title}, picture {picture.index}"))
    if rest is None and len(images) < MIN_PRESSES + 1:
        raise InvalidInput(
            f"{title}: {MIN_PRESSES} presses and before them a picture of the gel at rest are needed; there are {len(images)} pictures. Take ten presses all over the gel."
        )
    seen = view if isinstance(view, View) else view_of(view, size, np.zeros((0, 2)))
    if rest is not None:
        still, still_lost = reduced(rest, step, "the picture at rest")
        if still.shape != images[0][0].shape:
            raise InvalidInput(
                f"the picture at rest has another size than those of {title}: take both with one camera mode."
            )
        first = 0
    else:
        first = baseline or 1
        if first >= len(images):
            raise InvalidInput(f"baseline {first} leaves no press of {len(images)} pictures: give a smaller one.")
        still = np.mean([v for v, _ in images[:first]], axis=0)
        still_lost = np.any([m for _, m in images[:first]], axis=0)
    learner = _Learner(seen, size, step, 0.5 * ball_diameter, still)
    said: list[str] = []
    presses: list[_Press] = []
    quiet = []
    for name, (values, lost) in zip(names[first:], images[first:]):
        change = change_of(values, still)
        noise = _noise_of(change)
        masked = lost | still_lost | dark_spots(values) | dark_spots(still)
        circle = find_circle(np.where(masked[..., None], 0.0, change), noise)
        if circle is None:
            quiet.append(name)
            continue
        presses.append(_Press(name, change, masked, circle))
    if quiet:
        said.append(
            f"nothing round is seen in {', '.join(quiet[:6])}{' and others' if len(quiet) > 6 else ''}: not used"
        )
    if len(presses) < MIN_PRESSES:
        raise InvalidInput(
            f"{title}: a ball is found in {len(presses)} of {len(images) - first} pictures after that at rest, and {MIN_PRESSES} are needed. The first picture must show the gel at rest; press a ball of 4 to 20 mm, "
            f"and see that its contact is at least {int(2 * MIN_CONTACT_RADIUS * step)} pixels wide."
        )
    return learner.learn(presses, still, said)


def _noise_of(change: Floats) -> float:
    """Standard deviation of a channel's pixel noise, from differences of pixels four apart."""
    fine = change[:, 4:] - change[:, :-4]
    return float(1.4826 * np.median(np.abs(fine)) / math.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Means over the pixels of a press of products of features with features, features with colours, and colours with
    colours.
    """

    normal: Floats
    right: Floats
    colours: Floats

    def left(self, response: Response) -> float:
        """Mean squared residual of the colours from a polynomial, over all channels."""
        c = response.coefficients.reshape(3, -1).T
        return float(np.trace(self.colours - 2.0 * c.T @ self.right + c.T @ self.normal @ c))


class _Learner:
    """The fit, on the blocks of one picture."""

    def __init__(self, view: View, size: tuple[int, int], step: int, radius: float, still: Floats) -> None:
        self.view, self.size, self.step, self.radius = view, size, step, radius
        self.places, scaled = grid_of(view, size, step)
        self.base = bases(scaled, still)

    def _middle(self, circle: Circle) -> tuple[Floats, float]:
        """Centre [m] and metres per block there."""
        at = (np.array([circle.column, circle.row]) + 0.5) * self.step - 0.5
        scale = math.sqrt(abs(float(np.linalg.det(self.view.jacobian(at))))) * self.step
        return np.asarray(self.view.places(at)), scale

    def inside(self, press: _Press, within: float) -> tuple[npt.NDArray[np.bool_], Floats]:
        """Mask of the pixels of the contact (row, column), and the ball's slopes there (n, 2)."""
        middle, scale = self._middle(press.circle)
        dx, dy = self.places[0] - middle[0], self.places[1] - middle[1]
        r = np.hypot(dx, dy)
        reach = min(within * press.circle.radius * scale, MAX_CONTACT_RATIO * self.radius)
        chosen = (r < reach) & ~press.lost
        down = -1.0 / np.sqrt(self.radius**2 - r[chosen] ** 2)
        return chosen, np.stack([dx[chosen] * down, dy[chosen] * down], axis=-1)

    def _fit(self, sums: list[_Sums], degree: int, ridge: float, steepest: float) -> Response:
        """The least-squares polynomial in which all presses have equal weight."""
        above, place = ranks(degree)
        held = ridge * (np.where(place == 0, RANK_0, 1.0) * EACH_RANK ** (above + place)).ravel()
        normal = np.mean([s.normal for s in sums], axis=0) + np.diag(held)
        solved = np.linalg.solve(normal, np.mean([s.right for s in sums], axis=0))
        return Response(np.ascontiguousarray(solved.T).reshape(3, *place.shape), degree, steepest)

    def _sums(self, press: _Press, degree: int, steepest: float) -> _Sums:
        chosen, slopes = self.inside(press, RING_FRACTION)
        shape = ranks(degree)[0].shape
        rows = Response(np.zeros((3, *shape)), degree, steepest).features(slopes, self.base[chosen])
        colours = press.change[chosen]
        n = len(rows)
        return _Sums(rows.T @ rows / n, rows.T @ colours / n, colours.T @ colours / n)

    def _centred(self, press: _Press, response: Response) -> _Press:
        """The press with its centre moved to the best fit of the polynomial: one Gauss-Newton step."""
        chosen, slopes = self.inside(press, RING_FRACTION)
        if chosen.sum() < 20:
            return press
        value, by = response.derivative(slopes, response.local(self.base[chosen]))
        residual = press.change[chosen] - value
        # Moving the centre by d changes slopes by about d / R.
        _, scale = self._middle(press.circle)
        steps = by.reshape(-1, 2) / self.radius
        move = np.linalg.lstsq(steps, residual.ravel(), rcond=None)[0]
        size = float(np.hypot(*move))
        move = move * min(1.0, 3.0 * scale / max(size, 1e-300))
        pixel = self.view.pixels(self._middle(press.circle)[0] + move)
        c = (np.asarray(pixel) + 0.5) / self.step - 0.5
        return replace(press, circle=Circle(float(c[0]), float(c[1]), press.circle.radius))

    def learn(self, presses: list[_Press], still: Floats, said: list[str]) -> SlopeModel:
        for press in presses:
            _, scale = self._middle(press.circle)
            if press.circle.radius * scale > 1.05 * self.radius:
                raise InvalidInput(
                    f"{press.name}: the contact is {2e3 * press.circle.radius * scale:.1f} mm wide, more than a ball of {2e3 * self.radius:.1f} mm diameter can be: check --ball-diameter and the scale in [camera]."
                )
        noise = max(float(np.median([_noise_of(p.change) for p in presses])), 1e-4)
        for number in range(ROUNDS):
            steepest = self._steepest(presses)
            degree = min(number + 1, 2)
            response = self._fit([self._sums(p, degree, steepest) for p in presses], degree, RIDGES[-1], steepest)
            presses = [self._centred(p, response) for p in presses]
        steepest = self._steepest(presses)
        best = (math.inf, 0, 0.0)
        for degree in DEGREES:
            sums = [self._sums(p, degree, steepest) for p in presses]
            for ridge in RIDGES:
                error = sum(
                    s.left(self._fit(sums[:i] + sums[i + 1 :], degree, ridge, steepest)) for i, s in enumerate(sums)
                )
                best = min(best, (error, degree, ridge))
        _, degree, ridge = best
        sums = [self._sums(p, degree, steepest) for p in presses]
        response = self._fit(sums, degree, ridge, steepest)
        without = [self._fit(sums[:i] + sums[i + 1 :], degree, ridge, steepest) for i in range(len(sums))]
        covariance = self._covariance(presses, without, noise)
        table = tuple(self._cross_validate(p, other, covariance) for p, other in zip(presses, without))
        gains = np.array([row[2] for row in table])
        # A new contact has the scatter of single presses; a deviation of their mean from 1 is a bias of the same kind.
        gain_std = float(np.sqrt(np.mean((gains - 1.0) ** 2)))
        slope_error = float(np.sqrt(np.mean([row[3] ** 2 for row in table])))
        depth_error = float(np.sqrt(np.mean([row[4] ** 2 for row in table])))
        said += self._words(presses, table)
        return SlopeModel(
            response,
            np.stack([w.coefficients for w in without]),
            covariance,
            still.astype(np.float32).astype(np.float64),
            self.size,
            self.view,
            2.0 * self.radius,
            gain_std,
            slope_error,
            depth_error,
            table,
            tuple(said),
        )

    def _steepest(self, presses: list[_Press]) -> float:
        return max(float(np.hypot(*self.inside(p, RING_FRACTION)[1].T).max(initial=0.0)) for p in presses)

    def _covariance(self, presses: list[_Press], without: list[Response], noise: float) -> Floats:
        """Covariance of the colour residuals in cross-validation; at least the noise of pixels."""
        parts = []
        for press, other in zip(presses, without):
            chosen, slopes = self.inside(press, RING_FRACTION)
            left = press.change[chosen] - other.change(slopes, self.base[chosen])
            parts.append(left.T @ left / len(left))
        return np.asarray(np.mean(parts, axis=0) + 0.25 * noise**2 * np.eye(3))

    def _cross_validate(
        self, press: _Press, other: Response, covariance: Floats
    ) -> tuple[str, float, float, float, float]:
        """Name, contact radius [m], gain, error of slope and error of depth [m] of a press, by the model fitted
        without it.
        """
        chosen, ball = self.inside(press, RING_FRACTION)
        _, scale = self._middle(press.circle)
        box = tuple(slice(int(v.min()), int(v.max()) + 1) for v in np.nonzero(chosen))
        base = self.base[box]
        flat = press.change[box].reshape(-1, 3)
        slopes, _, _, _ = solve_slopes(other, flat, base.reshape(len(flat), -1), covariance)
        within = chosen[box]
        field = np.moveaxis(slopes.reshape(*within.shape, 2), -1, 0)
        found = field[:, within].T
        gain = float((found * ball).sum() / (ball**2).sum())
        error = float(np.sqrt(np.mean((found - ball) ** 2)))
        depth = integrate(field, within + 1e-6, self.places[:, box[0], box[1]])[within]
        middle, _ = self._middle(press.circle)
        r = np.hypot(*(self.places[:, chosen] - middle[:, None]))
        truth = np.sqrt(self.radius**2 - r**2)
        off = (depth - depth.mean()) - (truth - truth.mean())
        return press.name, press.circle.radius * scale, gain, error, float(np.sqrt(np.mean(off**2)))

    def _words(self, presses: list[_Press], table: Any) -> list[str]:
        said = []
        centres = np.array([[p.circle.column, p.circle.row] for p in presses])
        size = np.array([self.size[0], self.size[1]]) / self.step
        spread = np.ptp(centres, axis=0) / size
        if spread.min() < 0.35:
            said.append(
                f"the presses cover {100 * spread[0]:.0f} % of the picture's width and {100 * spread[1]:.0f} % of its height: elsewhere colours are extrapolated. Press near the corners too"
            )
        wide = max(row[1] for row in table)
        if wide > WIDE * self.radius:
            said.append(
                f"a contact is {2e3 * wide:.1f} mm wide, nearly as wide as the ball of {2e3 * self.radius:.1f} mm: check --ball-diameter and the scale in [camera], or take a larger ball"
            )
        gains = np.array([row[2] for row in table])
        odd = [row[0] for row in table if abs(row[2] - np.median(gains)) > 0.25]
        if odd:
            said.append(
                f"{', '.join(odd)}: slopes differ from what the other presses say by more than 25 %: the only press in its corner, another ball, or one that slid? Press near by once more, or take it out"
            )
        return said
