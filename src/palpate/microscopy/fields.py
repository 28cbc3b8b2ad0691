"""A displacement field in a microscope's picture: on a regular grid, in metres, in the picture's own axes (x right, y down)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import as_double
from palpate._numbers import plain_number
from palpate.errors import InvalidInput
from palpate.recordings import Recording
from palpate.sensing.arrays import AreaArray
from palpate.units import is_number

__all__ = ["Field", "mended"]

#: A field is refused as having the wrong unit if displacements exceed LARGEST of the field of view, or if gradients
#: exceed STEEPEST.
LARGEST, STEEPEST = 0.25, 1.0
#: That test leaves out the most extreme vectors, which may be outliers, and uses this fraction.
COMMON = 0.95
#: Steps between vectors may differ by this fraction of a step, because coordinates are often rounded.
EVEN = 0.02
#: Median test of neighbours: the largest allowed deviation in units of the spread of the neighbours, and a spread that
#: is always added [px].
OFF, SPREAD = 3.0, 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
class Field:
    """Displacements of a gel's surface on a regular grid, with the axes of the picture: x to the right, y down, row 0
    at the top.

    Parameters
    ----------
    displacement : array (2, row, column)
        Along x and along y [m]; NaN for missing vectors.
    start : (float, float)
        Pixel (column, row) of the first vector.
    step : float
        Pixels between vectors.
    pixel : float
        Metres in a pixel.
    std : array (2, row, column), optional
        Standard deviation of each [m]; NaN if unknown, and where the vector is missing.
    drift : (float, float), optional
        Subtracted shift along x and y [m].
    aperture : float
        Side [m] of the square over which each vector is a mean, such as a window; 0: a point.
    notes : tuple of str
        Assumptions that were made.
    normal : array (row, column), optional
        Displacement of the surface out of the gel [m], towards the cell; NaN where there is none.
    left_out : int
        Number of vectors that were excluded (now NaN); ``notes`` say why.

    Raises
    ------
    InvalidInput
        Another shape, infinite values, no vector, displacements that cannot be in the unit that was given.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.microscopy import Field
    >>> u = np.full((2, 30, 40), 0.1e-6)  # the picture has moved
    >>> u[0, 3, 4] = 0.5e-6  # an outlier
    >>> field = Field(displacement=u, start=(3.5, 3.5), step=8.0, pixel=0.1e-6, std=0 * u + 2e-9)
    >>> field.shape, field.pitch, field.size  # vectors, metres between them, pixels that they cover (columns, rows)
    ((30, 40), 8e-07, (320, 240))

    >>> [round(c, 9) for c in field.center], field.noise  # [m]
    ([1.595e-05, 1.195e-05], 2e-09)

    >>> np.argwhere(field.unlike).tolist(), int((~field.without_outliers().valid).sum())
    ([[3, 4]], 1)

    >>> field.without_drift().drift
    (1e-07, 1e-07)

    >>> field.array().channels, field.recording().readings.shape  # for `Skin` and for other programs
    (('displacement_x', 'displacement_y'), (1, 2, 30, 40))
    """

    displacement: Any
    start: tuple[float, float]
    step: float
    pixel: float
    std: Any = None
    drift: tuple[float, float] | None = None
    aperture: float = 0.0
    notes: tuple[str, ...] = field(default=())
    left_out: int = 0
    normal: Any = None

    def __post_init__(self) -> None:
        u = as_double(self.displacement)
        if u.ndim != 3 or u.shape[0] != 2 or min(u.shape[1:]) < 4:
            raise InvalidInput(
                f"a displacement field has the shape (2, row, column), with at least 4 x 4 vectors; got {u.shape}."
            )
        for name in ("step", "pixel"):
            value = getattr(self, name)
            if not (is_number(value) and value > 0):
                raise InvalidInput(f"{name} must be a positive number; got {value!r}.")
        if not (is_number(self.aperture) and self.aperture >= 0):
            raise InvalidInput(f"aperture must be a length [m], or 0; got {self.aperture!r}.")
        if np.isinf(u).any():
            raise InvalidInput("the displacements hold infinite values; mark vectors that are missing as NaN.")
        u[:, np.isnan(u).any(axis=0)] = np.nan
        there = ~np.isnan(u[0])
        if there.sum() < 16:
            raise InvalidInput(
                f"the field holds {int(there.sum())} vectors, the rest is NaN: at least 16 are needed. Look at what marks its vectors as bad."
            )
        object.__setattr__(self, "displacement", u)
        if self.std is not None:
            std = as_double(self.std)
            if std.shape != u.shape or (std[:, there] < 0).any() or np.isinf(std[:, there]).any():
                raise InvalidInput(
                    f"std must have the shape of the displacements, {u.shape}, and no negative or infinite values; got {std.shape}."
                )
            none = there & (std == 0).any(axis=0)
            if none.any():
                object.__setattr__(
                    self,
                    "notes",
                    (
                        *self.notes,
                        f"{int(none.sum())} of {int(there.sum())} vectors state an error of zero: it is taken as not known",
                    ),
                )
            # programs write any number where a vector is missing
            object.__setattr__(self, "std", np.where(none | ~there, np.nan, std))
        if self.normal is not None:
            w = as_double(self.normal)
            if w.shape != u.shape[1:] or np.isinf(w).any():
                raise InvalidInput(
                    f"normal must have a number for each vector, {u.shape[1:]}, and NaN where there is none; got {w.shape}."
                )
            object.__setattr__(self, "normal", w)
        self._sensible()

    def _sensible(self) -> None:
        """Raise an error for values that only a wrong unit explains."""
        u = self.displacement - np.nanmedian(self.displacement, axis=(1, 2), keepdims=True)
        # single outliers do not mean a wrong unit
        largest = float(np.nanquantile(np.hypot(*u), COMMON))
        width = self.pitch * max(self.shape)
        said = (
            f"(the largest is {plain_number(largest / self.pixel, 3)} px or {plain_number(largest * 1e6, 3)} µm, with pixels of {self.pixel * 1e6:.3g} µm and "
            f"{self.pitch * 1e6:.3g} µm between vectors)"
        )
        if largest > LARGEST * width:
            raise InvalidInput(
                f"displacements of more than a quarter of the field of view {said}: check the size of a pixel, the step between vectors, and "
                'whether displacements are in pixels (unit="px") or in metres ("m", "um").'
            )
        slopes = [
            np.nanquantile(np.abs(np.diff(u, axis=a)), COMMON) / self.pitch
            for a in (1, 2)
            if not np.isnan(np.diff(u, axis=a)).all()
        ]
        if slopes and np.median(slopes) > STEEPEST:
            raise InvalidInput(
                f"neighbouring vectors differ by more than their distance {said}: check the size of a pixel, the step between vectors, whether "
                "displacements are in pixels or metres, and for outliers."
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns of vectors."""
        return self.displacement.shape[1:]

    @property
    def pitch(self) -> float:
        """Distance between vectors [m]."""
        return float(self.step * self.pixel)

    @property
    def size(self) -> tuple[int, int]:
        """Size (columns, rows) [px] of the smallest picture, starting at (0, 0), that covers the field to its far
        edge.
        """
        rows, columns = self.shape
        far = [s + (n - 0.5) * self.step + 0.5 for s, n in zip(self.start, (columns, rows))]
        return round(far[0]), round(far[1])

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """True for existing vectors (row, column)."""
        return np.asarray(np.isfinite(self.displacement[0]))

    @property
    def center(self) -> tuple[float, float]:
        """Position (x, y) [m] of the middle of the grid, from the middle of the picture's first pixel."""
        rows, columns = self.shape
        x, y = ((s + 0.5 * (n - 1) * self.step) * self.pixel for s, n in zip(self.start, (columns, rows)))
        return float(x), float(y)

    @property
    def unlike(self) -> npt.NDArray[np.bool_]:
        """Vectors (row, column) that differ from all their neighbours, like those a PIV program marks as bad. It uses
        the normalised median test with 0.1 px added to the spread (J. Westerweel, F. Scarano, Exp. Fluids 39, 2005,
        1096-1100).
        """
        return mended(self.displacement / self.pixel)[1]

    def without_outliers(self) -> Field:
        """Return the field without the vectors marked by `unlike`; ``notes`` say how many were removed."""
        bad = self.unlike
        if not bad.any():
            return self
        said = f"{int(bad.sum())} of {bad.size} vectors are left out: they differ from all about them"
        return replace(
            self,
            displacement=np.where(bad, np.nan, self.displacement),
            notes=(*self.notes, said),
            left_out=self.left_out + int((bad & self.valid).sum()),
        )

    def without_drift(self) -> Field:
        """Subtract the shift of the whole picture: the median of the vectors along the border, where a cell moves the
        gel least. ``drift`` says how much was subtracted.

        This also removes displacement that the cell causes at the border. The inversion therefore fits a shift as
        well, and its error bars include it.
        """
        rows, columns = self.shape
        edge = np.ones(self.shape, dtype=bool)
        r, c = max(1, rows // 10), max(1, columns // 10)
        edge[r:-r, c:-c] = False
        edge &= self.valid
        if not edge.any():
            edge = self.valid
        shift = np.median(self.displacement[:, edge], axis=1)
        level = 0.0 if self.normal is None else np.nanmedian(np.where(edge, self.normal, np.nan))
        before = self.drift or (0.0, 0.0)
        return replace(
            self,
            displacement=self.displacement - shift[:, None, None],
            normal=None if self.normal is None else self.normal - np.nan_to_num(level),
            drift=(float(before[0] + shift[0]), float(before[1] + shift[1])),
        )

    @property
    def noise(self) -> float | None:
        """Standard deviation of a typical vector [m]: the root mean square of ``std``; None if unknown.

        ``method="tikhonov"`` uses this value for all vectors and treats their noise as independent: with an even
        penalty, a model of noise that neighbouring windows share makes traction finer but noisier (error of 0.39
        instead of 0.34). ``method="adhesions"`` uses ``std`` of each vector and the noise that windows share
        (`palpate.microscopy.noise`).
        """
        if self.std is None or not np.isfinite(self.std).any():
            return None
        noise = float(np.sqrt(np.nanmean(self.std**2)))
        return noise if noise > 0 else None

    def array(self, *, depth: float = 0.0, noise: float | None = None) -> AreaArray:
        """Return the array of this field for the inversion: displacements along x and y, ``depth`` metres below the
        surface. Missing vectors are masked.
        """
        return AreaArray(
            shape=self.shape,
            pitch=self.pitch,
            depth=depth,
            channels=["displacement_x", "displacement_y"],
            noise=noise,
            center=self.center,
            mask=None if self.valid.all() else self.valid,
            aperture=self.aperture,
        )

    def recording(self) -> Recording:
        """Return the field as a recording of one frame, for `palpate reconstruct` and other programs. ``meta`` states
        the position of the first vector and the pitch [m].
        """
        x, y = (s * self.pixel for s in self.start)
        return Recording(
            readings=self.displacement[None],
            channels=("displacement_x", "displacement_y"),
            meta={"x0": repr(float(x)), "y0": repr(float(y)), "pitch": repr(self.pitch)},
        )


def mended(u: Any) -> tuple[Any, npt.NDArray[np.bool_]]:
    """Replace vectors that are missing, or that differ from their neighbours, by the median of the neighbours. Return
    the displacements (2, row, column) [px] and a mask of the vectors that differ.
    """
    padded = np.pad(u, ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    rows, columns = u.shape[1:]
    around = np.stack(
        [padded[:, r : r + rows, c : c + columns] for r in range(3) for c in range(3) if (r, c) != (1, 1)]
    )
    none = np.isnan(around).all(axis=0)
    around = np.where(none, 0.0, around)
    middle = np.nanmedian(around, axis=0)
    spread = np.nanmedian(np.abs(around - middle), axis=0) + SPREAD
    with np.errstate(invalid="ignore"):
        off = (np.hypot(*((u - middle) / spread)) > OFF * np.sqrt(2.0)) & ~none.any(axis=0)
    missing = np.isnan(u).any(axis=0)
    out = np.where(off | missing, middle, u)
    alone = none.any(axis=0) & missing
    if alone.any():  # missing vectors without any neighbour
        known = np.nanmedian(np.where(alone, np.nan, out), axis=(1, 2))
        out = np.where(alone, np.nan_to_num(known)[:, None, None], out)
    return out, off
