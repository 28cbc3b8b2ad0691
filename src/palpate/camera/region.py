"""The part of a picture that shows the gel: given, or detected by the gel's rim against a dark housing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput
from palpate.sensing.view import eight_bit, grey, opencv

__all__ = ["Region"]

#: Columns of the reduced picture in which the rim is sought; fraction of them over which dots are closed; and fraction
#: excluded along the rim.
COLUMNS, CLOSED, RIM = 160, 1.0 / 12.0, 0.012
#: Smallest fraction of the picture that the gel fills, and largest if its surroundings are visible.
LEAST, MOST = 0.15, 0.96
#: Ratio of the brightness inside to that outside, overall and along the rim, and fraction of the rim that must have it.
CONTRAST, SHARE = 2.0, 0.8


@dataclass(frozen=True, eq=False)
class Region:
    """The part of a picture that shows the gel.

    Parameters
    ----------
    mask : array (row, column) of bool
        True on the gel.

    Examples
    --------
    >>> from palpate.camera import Region
    >>> region = Region.of([[10, 10], [89, 59]], (100, 80))  # two corners of a rectangle
    >>> region.share, region.holds([[50.0, 30.0], [12.0, 30.0]], 5.0).tolist()
    (0.5, [True, False])
    """

    mask: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, points: npt.ArrayLike, size: tuple[int, int]) -> Region:
        """The region within a polygon with these corners (column, row) [pixels], or a rectangle with two opposite
        corners, in a picture of ``size`` (columns, rows).

        Raises
        ------
        InvalidInput
            Fewer than two corners, or nothing of the picture between them.
        """
        corners = np.asarray(points, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 2 or not np.isfinite(corners).all():
            raise InvalidInput(
                f"roi must be corners [column, row] of pixels: two of a rectangle, or three and more of a polygon; got {np.asarray(points).tolist()}."
            )
        if len(corners) == 2:
            (left, top), (right, bottom) = corners
            corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
        drawn = np.zeros((size[1], size[0]), np.uint8)
        far = 1e4
        opencv().fillPoly(drawn, [np.rint(np.clip(corners, -far, far)).astype(np.int32)], 1)
        if drawn.mean() < 0.01:
            raise InvalidInput(
                f"roi holds {100 * float(drawn.mean()):.2g} % of the pictures, which are {size[0]} x {size[1]}: give corners [column, row] of the gel in them."
            )
        return cls(drawn.astype(bool))

    @classmethod
    def found(cls, image: npt.ArrayLike) -> Region | None:
        """The lit gel, if its edge lies within the picture and it is dark outside; None otherwise."""
        cv2 = opencv()
        values = np.asarray(image)
        plain = values.max(axis=2) if values.ndim == 3 and values.shape[2] == 3 else grey(image)
        whole = eight_bit(plain)
        rows, columns = whole.shape
        if min(rows, columns) < 24:
            return None
        part = min(1.0, COLUMNS / columns)
        small = cv2.resize(whole, (round(columns * part), round(rows * part)), interpolation=cv2.INTER_AREA)
        _, bright = cv2.threshold(small, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(bright, connectivity=4)
        if count < 2:
            return None
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        gel = _filled((labels == largest).astype(np.uint8))
        if not LEAST < gel.mean() < MOST:
            return None
        inside, outside = (float(np.median(small[gel == one])) for one in (1, 0))
        if inside < CONTRAST * outside or not _rimmed(small, gel):
            return None
        margin = 2 * max(1, round(RIM * small.shape[1])) + 1
        gel = cv2.erode(gel, np.ones((margin, margin), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=1)
        return cls(cv2.resize(gel, (columns, rows), interpolation=cv2.INTER_NEAREST).astype(bool))

    @property
    def share(self) -> float:
        """Fraction of the picture."""
        return float(self.mask.mean())

    @cached_property
    def weight(self) -> npt.NDArray[np.float32]:
        """1 on the gel, 0 elsewhere."""
        return np.asarray(self.mask, dtype=np.float32)

    @cached_property
    def _inwards(self) -> npt.NDArray[np.float32]:
        """Distance [pixels] to the region's edge; the edge of the picture does not count."""
        padded = np.pad(self.mask, 1, mode="edge").astype(np.uint8)
        far = opencv().distanceTransform(padded, opencv().DIST_L2, 5)
        return np.asarray(far[1:-1, 1:-1], dtype=np.float32)

    def within(self, reach: float) -> npt.NDArray[np.bool_]:
        """Mask of pixels (row, column) more than ``reach`` inside the region's edge."""
        return self._inwards > reach

    def holds(self, positions: npt.ArrayLike, reach: float) -> npt.NDArray[np.bool_]:
        """Whether places (n, 2) [pixels] lie more than ``reach`` inside its edge."""
        at = np.rint(np.asarray(positions, dtype=np.float64).reshape(-1, 2)).astype(np.intp)
        column, row = np.clip(at, 0, np.array(self.mask.shape[::-1]) - 1).T
        return np.asarray(self.within(reach)[row, column])

    def reduced(self, step: int) -> Region:
        """The region for pictures reduced by the factor ``step``."""
        rows, columns = (n // step * step for n in self.mask.shape)
        parts = self.mask[:rows, :columns].reshape(rows // step, step, columns // step, step)
        return Region(np.asarray(parts.all(axis=(1, 3))))


def _filled(gel: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Close holes, and notches along the edge: dots are dark, but not part of the rim."""
    cv2 = opencv()
    side = 2 * round(0.5 * CLOSED * gel.shape[1]) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    padded = cv2.copyMakeBorder(gel, side, side, side, side, cv2.BORDER_REPLICATE)
    gel = np.ascontiguousarray(cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)[side:-side, side:-side])
    outlines, _ = cv2.findContours(gel, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros_like(gel), outlines, -1, 1, cv2.FILLED), dtype=np.uint8)


def _rimmed(light: npt.NDArray[Any], gel: npt.NDArray[np.uint8]) -> bool:
    """Whether the light drops sharply along the edge of the gel, unlike light that falls off towards the corners of a
    picture.
    """
    cv2 = opencv()
    reach = 2 * max(2, round(3 * RIM * light.shape[1])) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    inner = cv2.dilate(np.where(gel > 0, light, 0).astype(np.uint8), kernel)
    outer = cv2.erode(np.where(gel > 0, 255, light).astype(np.uint8), kernel)
    edge = (cv2.dilate(gel, np.ones((3, 3), np.uint8)) > 0) & (gel == 0)
    if not edge.any():
        return False
    drop = inner[edge].astype(np.float64) / np.maximum(outer[edge].astype(np.float64), 1.0)
    return bool(np.mean(drop > CONTRAST) > SHARE)
