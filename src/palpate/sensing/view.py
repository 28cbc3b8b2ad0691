"""Position of a picture: pixels to metres and back.

A pixel is (column, row), counted from the middle of the first one in the upper left corner, as in OpenCV. Places on
the gel are (x, y) in metres: x to the right of the picture and y UP, so that every plot looks like the picture. With z
into the pad, towards a camera behind it, the axes are right-handed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._extras import missing
from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["Lens", "View", "eight_bit", "grey", "opencv"]


def opencv() -> Any:
    """The module cv2; a missing one names the extra to install."""
    try:
        import cv2
    except ImportError as error:
        raise missing("pictures", error) from error
    return cv2


def grey(image: npt.ArrayLike) -> npt.NDArray[Any]:
    """A picture as grey levels (row, column): the luminance of a colour picture. The type is kept, but
    that float64 becomes float32.

    Raises
    ------
    InvalidInput
        An array that is no picture.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera import grey
    >>> grey(np.full((2, 3, 3), 7, dtype=np.uint8)).tolist()
    [[7, 7, 7], [7, 7, 7]]
    """
    values = np.asarray(image)
    if values.dtype == np.float64:
        values = values.astype(np.float32)
    if values.dtype not in (np.uint8, np.uint16, np.float32) or 0 in values.shape:
        raise InvalidInput(
            f"a picture must hold uint8, uint16, float32 or float64, and have pixels; got {values.dtype} of shape {values.shape}."
        )
    if values.ndim == 2:
        return np.ascontiguousarray(values)
    if values.ndim == 3 and values.shape[-1] in (1, 3, 4):
        if values.shape[-1] == 1:
            return np.ascontiguousarray(values[..., 0])
        cv2 = opencv()
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(values[..., :3]), cv2.COLOR_RGB2GRAY))
    raise InvalidInput(
        f"a picture must have shape (rows, columns) or (rows, columns, 3) with red, green, blue; got {values.shape}."
    )


def eight_bit(image: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """A picture in eight bits; pictures of 16 bits and floats are scaled by their brightest pixel.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.view import eight_bit
    >>> eight_bit(np.array([[0.0, 0.5, 1.0]], dtype=np.float32)).tolist()
    [[0, 128, 255]]
    """
    if image.dtype == np.uint8:
        return image
    values = np.nan_to_num(image.astype(np.float64), posinf=0.0, neginf=0.0)
    return np.asarray(np.clip(np.rint(values * (255.0 / max(values.max(initial=0.0), 1e-300))), 0, 255), dtype=np.uint8)


def _pairs(values: npt.ArrayLike, name: str) -> Floats:
    pairs = np.asarray(values, dtype=np.float64)
    if pairs.ndim < 1 or pairs.shape[-1] != 2 or not np.isfinite(pairs).all():
        raise InvalidInput(f"{name} must be finite pairs of shape (..., 2); got shape {pairs.shape}.")
    return pairs


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera's matrix and distortion, as OpenCV's calibration gives them.

    Parameters
    ----------
    matrix : array (3, 3)
        [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
    distortion : sequence of float
        k1, k2, p1, p2[, k3, ...]: 4, 5, 8, 12 or 14 numbers.
    error : float, optional
        Root mean square of the residuals of the calibration [pixels].

    Examples
    --------
    >>> from palpate.camera import Lens
    >>> lens = Lens([[500.0, 0.0, 160.0], [0.0, 500.0, 120.0], [0.0, 0.0, 1.0]], [-0.2, 0.0, 0.0, 0.0])
    >>> lens.distorted(lens.undistorted([[300.0, 200.0]])).round(3).tolist()
    [[300.0, 200.0]]
    """

    matrix: Any
    distortion: Any
    error: float = 0.0

    def __post_init__(self) -> None:
        matrix = np.asarray(self.matrix, dtype=np.float64)
        distortion = np.asarray(self.distortion, dtype=np.float64).ravel()
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise InvalidInput(
                "a lens needs its camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, with fx and fy above 0."
            )
        if len(distortion) not in (4, 5, 8, 12, 14) or not np.isfinite(distortion).all():
            raise InvalidInput(
                f"distortion must be OpenCV's 4, 5, 8, 12 or 14 numbers (k1, k2, p1, p2, ...); got {len(distortion)}."
            )
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", distortion)

    def described(self) -> dict[str, Any]:
        """The arguments that recreate it, as files store them."""
        return {"matrix": self.matrix.tolist(), "distortion": self.distortion.tolist(), "error": self.error}

    def undistorted(self, pixels: npt.ArrayLike) -> Floats:
        """Positions of the same points without distortion."""
        pairs = _pairs(pixels, "pixels")
        flat = np.ascontiguousarray(pairs.reshape(-1, 1, 2))
        if not flat.size:
            return pairs
        cv2 = opencv()
        # The default of five steps leaves hundredths of a pixel in the corners.
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-12)
        # OpenCV 4 has another function for this.
        undistorted = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
        args = (None, None) if undistorted is not cv2.undistortPoints else (None, None, None)
        points = np.asarray(undistorted(flat, self.matrix, self.distortion, *args, criteria))
        points = points.reshape(-1, 2) @ self.matrix[:2, :2].T + self.matrix[:2, 2]
        return np.asarray(points).reshape(pairs.shape)

    def distorted(self, pixels: npt.ArrayLike) -> Floats:
        """Return the pixels to which the lens projects undistorted points."""
        pairs = _pairs(pixels, "pixels")
        flat = pairs.reshape(-1, 2)
        if not flat.size:
            return pairs
        rays = np.linalg.solve(self.matrix, np.column_stack([flat, np.ones(len(flat))]).T).T
        points, _ = opencv().projectPoints(
            np.ascontiguousarray(rays.reshape(-1, 1, 3)), np.zeros(3), np.zeros(3), self.matrix, self.distortion
        )
        return np.asarray(points).reshape(pairs.shape)

    @classmethod
    def from_chessboard(
        cls, pictures: Sequence[npt.NDArray[Any]], *, corners: tuple[int, int], square: float = 1.0
    ) -> Lens:
        """Calibrate with pictures of a flat chessboard held at different angles (OpenCV's ``calibrateCamera``).

        Parameters
        ----------
        pictures : sequence of array
            Grey or colour, of one size, from the camera as it is used: the same focus.
        corners : (int, int)
            Inner corners along a row and a column.
        square : float
            Side of a field [m]; only views from poses use it.

        Raises
        ------
        InvalidInput
            Fewer than three pictures in which the whole board is found.
        """
        cv2 = opencv()
        if min(corners) < 3:
            raise InvalidInput(
                f"a board has at least 3 x 3 inner corners; got corners={corners!r}. Count where four fields meet, along a row and a column."
            )
        board = np.zeros((corners[0] * corners[1], 3), dtype=np.float32)
        board[:, :2] = np.mgrid[: corners[0], : corners[1]].T.reshape(-1, 2) * square
        boards = []
        sizes = set()
        for picture in pictures:
            image = eight_bit(grey(picture))
            sizes.add(image.shape)
            complete, points = False, None
            if min(image.shape) >= 8 * min(corners):  # smaller ones show no board
                complete, points = cv2.findChessboardCorners(image, corners)
            if complete:
                criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4)
                boards.append(cv2.cornerSubPix(image, points, (5, 5), (-1, -1), criteria))
        if len(sizes) > 1:
            raise InvalidInput("the calibration pictures differ in size; use those of one camera mode.")
        if len(boards) < 3:
            raise InvalidInput(
                f"the whole board of {corners[0]} x {corners[1]} inner corners was found in {len(boards)} of {len(pictures)} pictures; at "
                "least 3 are needed. Count inner corners, not fields; show the whole board, flat, sharp and with a white rim."
            )
        height, width = sizes.pop()
        try:
            error, matrix, distortion, _, _ = cv2.calibrateCamera(
                [board] * len(boards), boards, (width, height), None, None
            )
        except cv2.error as facing:  # boards that all face the camera
            raise InvalidInput(
                "the pictures of the board do not determine the lens: tilt the board, another way in each picture."
            ) from facing
        return cls(matrix, np.ravel(distortion), float(error))


@dataclass(frozen=True, eq=False)
class View:
    """Pixels to metres on the plane of the markers.

    Parameters
    ----------
    homography : array (3, 3)
        (column, row, 1) without distortion to (x, y, 1) [m], up to a factor.
    lens : Lens, optional
        Taken out of the pixels first.

    Notes
    -----
    x goes to the right of the picture and y up, unless four points say otherwise. `scaled`, `from_pitch` and `from_points` make one.

    Examples
    --------
    >>> from palpate.camera import View
    >>> view = View.scaled(0.05e-3, size=(320, 240))  # 0.05 mm per pixel; the origin is the middle of the picture
    >>> view.places([[0.0, 0.0], [160.0, 119.5]]).round(6).tolist()  # up is positive
    [[-0.007975, 0.005975], [2.5e-05, 0.0]]
    """

    homography: Any
    lens: Lens | None = None

    def __post_init__(self) -> None:
        h = np.asarray(self.homography, dtype=np.float64)
        if (
            h.shape != (3, 3)
            or not np.isfinite(h).all()
            or np.linalg.matrix_rank(h / np.abs(h).max(initial=1e-300)) < 3
        ):
            raise InvalidInput(f"homography must be a finite, invertible array (3, 3); got shape {h.shape}.")
        object.__setattr__(self, "homography", h)

    @classmethod
    def scaled(
        cls,
        scale: float | tuple[float, float],
        *,
        size: tuple[int, int],
        origin: tuple[float, float] | None = None,
        lens: Lens | None = None,
    ) -> View:
        """A view from a scale in metres per pixel, one or (along x, along y).

        ``size``: (columns, rows) of the picture; ``origin``: the pixel at (0, 0), default the middle of the picture.

        Examples
        --------
        >>> from palpate.camera import View
        >>> View.scaled((1e-4, 2e-4), size=(3, 3)).places([2.0, 0.0]).tolist()
        [0.0001, 0.0002]
        """
        across, up = scale if isinstance(scale, tuple | list) else (scale, scale)
        for value in (across, up):
            if isinstance(value, bool) or not (math.isfinite(value) and 0 < value < 1.0):
                raise InvalidInput(f"scale must be metres per pixel, one or (x, y), such as 0.05e-3; got {scale!r}.")
        column, row = origin if origin is not None else ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        return cls([[across, 0.0, -across * column], [0.0, -up, up * row], [0.0, 0.0, 1.0]], lens)

    @classmethod
    def from_points(cls, pixels: npt.ArrayLike, places: npt.ArrayLike, *, lens: Lens | None = None) -> View:
        """A view from four or more points whose places (x, y) [m] are known; also for a tilted camera.

        Raises
        ------
        InvalidInput
            Fewer than four, three of four on a line, or points that no plane explains.

        Examples
        --------
        >>> from palpate.camera import View
        >>> corners = [[10, 10], [310, 20], [300, 230], [15, 225]]
        >>> view = View.from_points(corners, [[-8e-3, 6e-3], [8e-3, 6e-3], [8e-3, -6e-3], [-8e-3, -6e-3]])
        >>> view.places([10, 10]).round(6).tolist()
        [-0.008, 0.006]
        """
        image_points, plane_points = _pairs(pixels, "pixels").reshape(-1, 2), _pairs(places, "places").reshape(-1, 2)
        if len(image_points) != len(plane_points) or len(image_points) < 4:
            raise InvalidInput(
                f"a view needs four points or more, each with its place; got {len(image_points)} pixels and {len(plane_points)} places."
            )
        flat = image_points if lens is None else lens.undistorted(image_points)
        cv2 = opencv()
        # Use units near one, so that metres and pixels have equal weight.
        unit = float(np.ptp(plane_points, axis=0).max())
        if not unit > 0:
            raise InvalidInput("the four points have one place; give four corners of a rectangle or the like.")
        h, _ = cv2.findHomography(flat, plane_points / unit)
        if h is None or np.linalg.cond(h @ np.diag([np.ptp(flat[:, 0]) + 1.0, np.ptp(flat[:, 1]) + 1.0, 1.0])) > 1e6:
            raise InvalidInput("the points do not span a plane: no three of four may lie on a line.")
        view = cls(np.diag([unit, unit, 1.0]) @ h, lens)
        error = np.abs(view.places(image_points) - plane_points).max()
        if error > 0.05 * unit:
            raise InvalidInput(
                f"pixels and places do not fit together: a point is off by {plain_number(1e3 * error, 3)} mm. Are they in the same order?"
            )
        return view

    @classmethod
    def from_pitch(
        cls, dots: npt.ArrayLike, pitch: float | tuple[float, float], *, size: tuple[int, int], lens: Lens | None = None
    ) -> View:
        """From the pitch [m] of a regular grid of dots, one or (along x, along y), and the pixels (n, 2) where they lie at rest.

        Rows of the grid may be tilted by up to 30 degrees, some dots may be missing. x and y get scales of their own, so that pixels need not be
        square.

        Raises
        ------
        InvalidInput
            Fewer than nine dots, or dots that form no grid.

        Examples
        --------
        >>> import numpy as np
        >>> from palpate.camera import View
        >>> dots = np.stack(np.meshgrid(np.arange(20, 310, 40), np.arange(15, 230, 40)), -1).reshape(-1, 2)
        >>> view = View.from_pitch(dots, 2e-3, size=(320, 240))
        >>> np.ptp(view.places([[0, 0], [40, 40]]), axis=0).round(6).tolist()
        [0.002, 0.002]
        """
        from palpate.sensing.lattice import lattice

        across, up = pitch if isinstance(pitch, tuple | list) else (pitch, pitch)
        for value in (across, up):
            if isinstance(value, bool) or not (math.isfinite(value) and 0 < value < 1.0):
                raise InvalidInput(f"pitch must be metres, one or (x, y), such as 2e-3; got {pitch!r}.")
        image_points = _pairs(dots, "dots").reshape(-1, 2)
        flat = image_points if lens is None else lens.undistorted(image_points)
        columns, rows = lattice(flat)
        # pixels per pitch along both directions of the grid -> metres per pixel along x and y
        both = np.column_stack([columns, rows])
        # |S column| = across, |S row| = up with S diagonal: two linear equations in sx^2, sy^2
        squares = np.linalg.solve(both.T**2, np.array([across**2, up**2]))
        if (squares <= 0).any():
            raise InvalidInput("the dots form no rectangular grid of this pitch: give four points instead.")
        scale = np.sqrt(squares)
        return cls.scaled((float(scale[0]), float(scale[1])), size=size, lens=lens)

    def described(self) -> dict[str, Any]:
        """The arguments that recreate it, as files of results store them: attribute ``view`` of the traction, in JSON.

        Examples
        --------
        >>> from palpate.camera import View
        >>> view = View.scaled(0.1e-3, size=(160, 120))
        >>> again = View.restored(view.described())
        >>> again.pixels([1e-3, 2e-3]).round(6).tolist()
        [89.5, 39.5]
        """
        return {"homography": self.homography.tolist(), "lens": None if self.lens is None else self.lens.described()}

    @classmethod
    def restored(cls, described: Mapping[str, Any]) -> View:
        """Restore from `View.described`; `InvalidInput` for anything else."""
        try:
            lens = described["lens"]
            return cls(described["homography"], None if lens is None else Lens(**lens))
        except (TypeError, KeyError, ValueError) as error:
            raise InvalidInput(
                f"a view is described by its homography (3, 3) and its lens (or none); got {str(described)[:80]}."
            ) from error

    def places(self, pixels: npt.ArrayLike) -> Floats:
        """(x, y) [m] of pixels (..., 2)."""
        pairs = _pairs(pixels, "pixels")
        flat = pairs if self.lens is None else self.lens.undistorted(pairs)
        return _mapped(self.homography, flat)

    def pixels(self, places: npt.ArrayLike) -> Floats:
        """Pixels of places (x, y) [m] (..., 2): to lay a result over its picture."""
        flat = _mapped(np.linalg.inv(self.homography), _pairs(places, "places"))
        return flat if self.lens is None else self.lens.distorted(flat)

    def jacobian(self, pixels: npt.ArrayLike) -> Floats:
        """Metres per pixel (..., 2, 2) at pixels (..., 2): rows x and y, columns along the picture's columns and rows."""
        pairs = _pairs(pixels, "pixels")
        step = 0.5
        parts = [
            self.places(pairs + move) - self.places(pairs - move)
            for move in (np.array([step, 0.0]), np.array([0.0, step]))
        ]
        return np.stack(parts, axis=-1) / (2.0 * step)


def _mapped(h: Floats, points: Floats) -> Floats:
    out = points @ h[:, :2].T + h[:, 2]
    return np.asarray(out[..., :2] / out[..., 2:])
