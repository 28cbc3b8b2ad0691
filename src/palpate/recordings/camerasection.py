"""The section [camera] of a skin.toml: pixels to metres, and properties of the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from palpate.errors import InvalidInput

__all__ = ["CameraSettings"]


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """The section [camera] of a skin.toml.

    Attributes
    ----------
    scale : float or (float, float), optional
        Metres per pixel, one or (along x, along y).
    size : (int, int), optional
        Columns and rows of the pictures that scale, points, roi and matrix are for; pictures of another size and the same shape are converted.
    pitch : float or (float, float), optional
        Pitch of the grid of dots [m], instead of a scale.
    points, places : sequence of pairs, optional
        Pixels (column, row) of four points or more and their places (x, y) [m], in place of a scale.
    matrix, distortion : sequences, optional
        Matrix and distortion of the lens, as OpenCV's calibration gives them.
    texture : float, optional
        For a gel with a texture and no dots: distance between the places of the readings [m]; by default a search for dots.
    roi : sequence of pairs, optional
        Corners (column, row) of the gel in the pictures, two of a rectangle or more of a polygon: the search stays inside. By default the inside of
        the gel's rim, if one shows against a dark housing.
    distance : float, optional
        From the camera's centre to the dots [m]; None: infinite, without perspective.
    reference : int
        Pictures at the start without contact.
    stage : bool
        Whether the gel as a whole may move in front of the camera.

    Examples
    --------
    >>> from palpate.recordings.camerasection import CameraSettings
    >>> CameraSettings(scale=0.06e-3).reference
    5
    """

    scale: Any = None
    size: tuple[int, int] | None = None
    pitch: Any = None
    points: Any = None
    places: Any = None
    matrix: Any = None
    distortion: Any = None
    texture: float | None = None
    roi: Any = None
    distance: float | None = None
    reference: int = 5
    stage: bool = False

    def __post_init__(self) -> None:
        ways = [name for name in ("scale", "pitch", "points") if getattr(self, name) is not None]
        if len(ways) != 1:
            raise InvalidInput(
                "scale, pitch or points must say how pixels become metres: one of them; got "
                + (f"{', '.join(ways)}." if ways else "none.")
            )
        if self.texture is not None and not self.texture > 0:
            raise InvalidInput(
                f'texture must be a positive distance between readings, such as "1 mm"; got {self.texture:g} m.'
            )
        if self.texture is not None and self.pitch is not None:
            raise InvalidInput(
                "pitch is that of dots, and texture says that there are none: give scale or points in place of pitch."
            )
        if self.roi is not None and len(self.roi) < 2:
            raise InvalidInput(
                f"roi needs corners [column, row] of the gel in the pictures, two of a rectangle or more of a polygon; got {len(self.roi)}."
            )
        if (self.points is None) != (self.places is None):
            raise InvalidInput(
                "points and places belong together: where four points are in the picture and on the gel."
            )
        if (self.matrix is None) != (self.distortion is None):
            raise InvalidInput("matrix and distortion belong together: both come from one calibration of the lens.")
        if self.distance is not None and not self.distance > 0:
            raise InvalidInput(f"distance must be positive; got {self.distance:g} m.")
        if self.reference < 1:
            raise InvalidInput(
                f"reference must be at least one picture in which nothing touches; got {self.reference}."
            )
