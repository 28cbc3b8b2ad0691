"""Follow dots from a reference picture: displacement of each, its standard deviation, and which are lost.

Each picture is compared with the reference, not with the one before, so that errors do not accumulate. Dots are found
again in it and matched (`palpate.camera.matching`); windows around them (`palpate.camera.windows`) then give the
displacement to a fraction of a pixel.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.camera.dots import Found, find_dots, levelled
from palpate.camera.matching import Neighbours, matched, predicted, strained
from palpate.camera.region import Region
from palpate.camera.windows import (
    BLURRED,
    Followed,
    Moved,
    as_bytes,
    mean_picture,
    pictures_of,
    white_of,
)
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.view import grey, opencv

__all__ = ["Markers"]

#: Half the width of a window in radii of a dot, plus a margin in pixels.
WINDOW, AROUND = 1.5, 2.0
#: Least squares on the few pixels of a dot's rim underestimates the residual by a factor 1 - SMALL_DOT_FACTOR / (radius
#: in pixels). Measured on dots at rest of 3.3 and 6.7 pixels with noise, compression and blur, other prints than those
#: of `benchmarks/camera.py`.
SMALL_DOT_FACTOR = 1.4


def _distinct(positions: npt.ArrayLike) -> Floats:
    """Validate given places (n, 2) [pixels]."""
    try:
        places = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"positions of dots must be pairs (column, row) of pixels ({error}).") from error
    if not np.isfinite(places).all() or len(np.unique(places, axis=0)) < len(places):
        raise InvalidInput("positions of dots must be finite, and no two the same: leave out those that are not known.")
    return places


#: Repeat a match if its strain exceeds that of the previous picture's match by this factor.
MAX_STRAIN_GROWTH = 1.1


class Markers(Followed):
    """The dots of a print, followed from picture to picture.

    Parameters
    ----------
    reference : array (row, column) or (row, column, 3), or sequence of these
        The gel at rest: one picture, or several, whose mean has less noise.
    positions : array (n, 2), optional
        Positions of the dots in the reference picture [pixels]; by default they are detected.
    region : Region, optional
        The part of the picture that shows the gel.

    Raises
    ------
    InvalidInput
        No dots, or an unusable picture.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Markers, Scene, dot_grid
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> rng = np.random.default_rng(0)
    >>> markers = Markers(scene.picture(rng=rng))
    >>> moved = markers.follow(scene.picture(pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0), rng=rng))
    >>> len(markers.positions), int(moved.lost.sum()), bool(np.abs(moved.displacement).max() > 1.0)
    (35, 0, True)
    """

    def __init__(self, reference: Any, *, positions: npt.ArrayLike | None = None, region: Region | None = None) -> None:
        plain = mean_picture(reference)
        self.region = region
        found = find_dots(plain, region=region)
        self.print = found.print
        places: Floats = found.positions[found.whole] if positions is None else _distinct(positions)
        if len(places) < 3:
            raise InvalidInput(
                f"{len(places)} whole dots found; at least three are needed. Show more of the print, or focus."
            )
        near, radius = Neighbours(places), self.print.radius
        half = min(WINDOW * radius + AROUND, max(0.5 * near.pitch, radius + 1.0))
        super().__init__(
            plain,
            as_bytes(levelled(plain, 4.0 * self.print.blur, region)),
            places,
            half=max(3, round(half)),
            near=near,
            reach=radius,
            rest=[grey(image) for image in pictures_of(reference)],
            # The rim of a dot determines its motion.
            spread=(radius / near.pitch) ** 2,
            known=max(1.0 - SMALL_DOT_FACTOR / radius, 0.3),
        )
        self.reset()

    def reset(self) -> None:
        """Forget the positions of the dots in the last picture."""
        self._last = np.zeros_like(self.positions)
        self._strained = 0.0

    def follow(self, image: npt.ArrayLike | None) -> Moved:
        """Displacement of every dot in a picture.

        For an unusable picture (None, black, saturated, blurred, of another size) the result has a reason instead of
        displacements; the next picture continues.

        Parameters
        ----------
        image : array (row, column) or (row, column, 3), or None

        Returns
        -------
        Moved
        """
        plain, fault = self._seen(image)
        if plain is None:
            return self._nothing(fault)
        flat = levelled(plain, 4.0 * self.print.blur, self.region)
        found = find_dots(plain, self.print, level=flat, region=self.region)
        level = as_bytes(flat)
        start = self._started(level, found)
        known = np.isfinite(start).all(axis=1)
        if known.sum() < 3:
            return self._nothing(
                f"of {len(self.positions)} dots {len(found.positions)} are visible, and none can be matched"
            )
        if len(found.positions) and self._blurred(level, found.positions):
            return self._nothing(BLURRED)
        moved = self._refined(level, start, white_of(plain))
        self._last = np.where(np.isfinite(moved.displacement), moved.displacement, start)
        return moved

    def _started(self, level: npt.NDArray[np.uint8], found: Found) -> Floats:
        """Displacement of each dot to within a pixel, from found and matched dots; for other dots, from their
        neighbours.
        """
        best = self._matched(found, np.where(np.isfinite(self._last), self._last, 0.0))
        if np.isnan(best[:, 0]).mean() > 0.5:
            # The stage jumped: the whole picture gives the distance.
            cv2 = opencv()
            (column, row), _ = cv2.phaseCorrelate(self._level.astype(np.float32), level.astype(np.float32))
            other = self._matched(found, np.zeros_like(best) + np.array([column, row]))
            if np.isnan(other[:, 0]).sum() < np.isnan(best[:, 0]).sum():
                best = other
        self._strained = strained(self._near, best)
        gaps = np.isnan(best[:, 0])
        if gaps.any() and not gaps.all():
            best[gaps] = predicted(self._near, best, np.flatnonzero(gaps))
        return best

    def _matched(self, found: Found, expected: Floats) -> Floats:
        index = matched(self._near, expected, found.positions, usual=MAX_STRAIN_GROWTH * self._strained)
        out = np.full_like(self.positions, np.nan)
        out[index >= 0] = found.positions[index[index >= 0]] - self.positions[index >= 0]
        return out
