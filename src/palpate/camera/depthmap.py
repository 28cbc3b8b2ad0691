"""Depth of the gel's surface from another source (photometric stereo, structured light, range camera), in addition to
its dots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import as_double
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing import Array, Grid, ScatteredArray
from palpate.units import is_number

__all__ = ["DepthMap"]

#: Smallest number of valid places.
MIN_PLACES = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class DepthMap:
    """Depth of the gel's surface in every picture, where available: the displacement_z that dots in a plane cannot
    measure.

    It separates pressure and shear, which makes the interval of the normal force several times narrower.

    Parameters
    ----------
    positions : array (n, 2)
        Places (x, y) [m], in the axes of the `View` (x right, y up).
    depth : callable or array (picture, n)
        Indentation of the surface at each place [m] by number of the picture, positive into the gel; NaN if unknown, as many sensors give it outside
        the contact.
    std : float
        Standard deviation of each [m].

    Raises
    ------
    InvalidInput
        Places of another shape, fewer than three of them, or a std that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera import DepthMap
    >>> places = np.stack(np.meshgrid([-1e-3, 0.0, 1e-3], [-1e-3, 0.0, 1e-3]), axis=-1).reshape(-1, 2)
    >>> pressed = np.where(np.hypot(*places.T) < 1.2e-3, 0.2e-3, np.nan)
    >>> float(DepthMap(positions=places, depth=pressed[None], std=5e-6).of(0)[4])
    0.0002
    """

    positions: npt.ArrayLike
    depth: Callable[[int], npt.ArrayLike] | npt.ArrayLike
    std: float

    def __post_init__(self) -> None:
        places = as_double(self.positions)
        if places.ndim != 2 or places.shape[1] != 2 or len(places) < MIN_PLACES or not np.isfinite(places).all():
            raise InvalidInput(
                f"positions of a depth map must be finite and have the shape (n, 2), with n of at least {MIN_PLACES}; got {places.shape}."
            )
        if not (is_number(self.std) and self.std > 0):
            raise InvalidInput(f"std of a depth map must be a positive number of metres; got {self.std!r}.")
        if not callable(self.depth):
            maps = as_double(self.depth)
            if maps.ndim != 2 or maps.shape[1] != len(places):
                raise InvalidInput(
                    f"depth must be a function of a picture's number, or have the shape (picture, {len(places)}), one depth for each place; got {maps.shape}."
                )
            maps.setflags(write=False)
            object.__setattr__(self, "depth", maps)
        places.setflags(write=False)
        object.__setattr__(self, "positions", places)

    def of(self, index: int) -> Floats:
        """Depths (n,) [m] in a picture, NaN if unknown; `InvalidInput` if the picture is missing or has no depths."""
        places: Any = self.positions
        if callable(self.depth):
            found = as_double(self.depth(index))
        else:
            maps: Any = self.depth
            if not 0 <= index < len(maps):
                raise InvalidInput(f"the depth map holds {len(maps)} pictures, and picture {index} is asked for.")
            found = maps[index]
        if found.shape != (len(places),):
            raise InvalidInput(
                f"picture {index}: a depth for each of {len(places)} places is needed; got the shape {found.shape}."
            )
        if np.isinf(found).any():
            raise InvalidInput(f"picture {index}: depths are infinite; mark those that are not known as NaN.")
        return found

    def plane(self, index: int, dots: Floats, surface: Grid) -> tuple[Array, Floats] | None:
        """The map of a picture as an array of displacement_z, and its readings (1, n): for each cell of the surface
        the place nearest to its middle, within the extent of the ``dots`` (n, 2). None with too few known depths.
        """
        places: Any = self.positions
        depth = self.of(index)
        low, high = dots.min(axis=0), dots.max(axis=0)
        known = np.flatnonzero(np.isfinite(depth) & np.all((places >= low) & (places <= high), axis=1))
        cells = []
        for x, dx, place in zip(surface.axes, surface.spacings, places[known].T[::-1]):
            cells.append((place - x[0]) / dx)
        nearest = [np.round(c).astype(int) for c in cells]
        away = sum((c - n) ** 2 for c, n in zip(cells, nearest))
        flat = nearest[0] * surface.shape[1] + nearest[1]
        order = np.lexsort((away, flat))
        _, first = np.unique(flat[order], return_index=True)
        chosen = np.sort(known[order[first]])
        if len(chosen) < MIN_PLACES or np.any(np.ptp(places[chosen], axis=0) == 0):
            return None
        array = ScatteredArray(positions=places[chosen], depth=0.0, channels=["displacement_z"], noise=self.std)
        return array, depth[None, chosen]
