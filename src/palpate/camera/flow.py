"""Follow texture from a reference picture: displacement on a regular grid, by dense optical flow, with its standard
deviation.

DIS optical flow (T. Kroeger, R. Timofte, D. Dai, L. Van Gool, ECCV 2016; OpenCV) of the picture, at most 160 pixels
wide, locates each window to about a pixel. Windows of the picture itself (`palpate.camera.windows`) then give the
displacement, forward and backward, and its standard deviation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._numbers import plain_number
from palpate.camera.dots import levelled
from palpate.camera.matching import Neighbours
from palpate.camera.region import Region
from palpate.camera.windows import (
    BLURRED,
    LEVEL,
    Followed,
    Moved,
    as_bytes,
    gradients_of,
    mean_picture,
    pictures_of,
    white_of,
    windows_of,
)
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.view import grey, opencv

__all__ = ["Flow"]

#: Largest width in pixels of the pictures for optical flow, and for the comparison of windows.
DENSE, COMPARED = 160, 320
#: Half the width of a window over the distance between places: neighbours then share few pixels.
WINDOW_FRACTION = 0.6
#: Smallest distance between places [pixels of the compared pictures].
CLOSEST = 6.0
#: A place is excluded if its texture (the weaker direction of its gradients) is below this fraction of the typical one.
POOR = 0.05
#: Least squares on few pixels underestimates the residual by a factor 1 - SMALL_WINDOW_FACTOR / (half a window in
#: pixels). Measured on windows of 13 to 41 pixels.
SMALL_WINDOW_FACTOR = 3.0
#: Fewest places, and fraction of all places that must have texture.
FEWEST, TEXTURED = 9, 0.5
#: Smallest contrast, at scales finer than a window, that counts as texture: light on a smooth gel, which does not move
#: with it, has between a third of this and all of it.
FAINT = 0.0135
#: A window moves by its mean: half**2 / 6 of the Laplacian, a third of which (by the distance squared) is the
#: difference between a place and the plane through its eight neighbours.
WINDOW_MEAN = 0.5


class Flow(Followed):
    """Texture of a gel without dots, followed from picture to picture on a regular grid.

    Parameters
    ----------
    reference : array (row, column) or (row, column, 3), or sequence of these
        The gel at rest: one picture, or several, whose mean has less noise.
    spacing : float
        Between places [pixels]. A window is a little wider, and averages finer detail.
    region : Region, optional
        The part of the picture that shows the gel.
    positions : array (n, 2), optional
        Places [pixels] in place of a whole grid.

    Attributes
    ----------
    positions : array (n, 2)
        Places at rest [pixels], without those lacking texture.

    Raises
    ------
    InvalidInput
        Places too near each other, a picture with too little texture.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Flow, Scene, Texture
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Texture(grain=0.15e-3), size=(160, 120), scale=0.1e-3)
    >>> rng = np.random.default_rng(0)
    >>> flow = Flow(scene.picture(rng=rng), spacing=10.0)
    >>> moved = flow.follow(scene.picture(pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0), rng=rng))
    >>> len(flow.positions) > 150, bool(moved.lost.mean() < 0.1), bool(np.nanmax(np.abs(moved.displacement)) > 1.0)
    (True, True, True)
    """

    def __init__(
        self,
        reference: Any,
        *,
        spacing: float,
        region: Region | None = None,
        positions: npt.ArrayLike | None = None,
    ) -> None:
        whole = mean_picture(reference)
        self._whole = (int(whole.shape[1]), int(whole.shape[0]))
        self._step = max(1, round(self._whole[0] / COMPARED))
        plain = self._reduced(whole)
        self.region = region if region is None or self._step == 1 else region.reduced(self._step)
        if not (np.isfinite(spacing) and spacing / self._step >= CLOSEST):
            raise InvalidInput(
                f"places of a texture must be at least {CLOSEST * self._step:g} pixels apart in pictures {self._whole[0]} pixels wide; got {plain_number(spacing, 3)}. "
                "Read it less densely, or film nearer."
            )
        apart = spacing / self._step
        half = max(3, round(WINDOW_FRACTION * apart))
        self._width = apart
        level = as_bytes(levelled(plain, 2.0 * apart, self.region))
        if positions is None:
            places = _grid((plain.shape[1], plain.shape[0]), apart, half + 1)
        else:
            places = (np.asarray(positions, dtype=np.float64).reshape(-1, 2) + 0.5) / self._step - 0.5
        if self.region is not None:
            places = places[self.region.holds(places, half)]
        slopes = gradients_of(windows_of(level, places, half + 1))
        normal = np.einsum("niyx,njyx->nij", slopes, slopes)
        weaker = np.linalg.eigvalsh(normal)[:, 0] if len(places) else np.zeros(0)
        good = weaker > max(POOR * float(np.median(weaker)) if len(places) else 0.0, 1e-6)
        good &= self._contrast(reference, level, places, half) > FAINT
        if good.sum() < max(FEWEST, TEXTURED * len(places)):
            raise InvalidInput(
                f"texture was found at {int(good.sum())} of {len(places)} places; at least {FEWEST} are needed, and half of all (light and shade are none). "
                "Read it more densely, film nearer, or focus; a smooth gel needs spots."
            )
        chosen = places[good]
        super().__init__(
            plain,
            level,
            chosen,
            half=half,
            near=Neighbours(chosen),
            reach=0.5 * half,
            spread=WINDOW_MEAN * (half / apart) ** 2,
            rest=[self._reduced(grey(image)) for image in pictures_of(reference)],
            known=max(1.0 - SMALL_WINDOW_FACTOR / half, 0.3),
        )
        cv2 = opencv()
        part = min(1.0, DENSE / plain.shape[1])
        self._small = (max(16, round(plain.shape[1] * part)), max(16, round(plain.shape[0] * part)))
        self._dense = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        self._first = self._shrunk(level)
        self.positions = self._step * (self._places + 0.5) - 0.5
        self.positions.setflags(write=False)
        self.size = self._whole
        self.reset()

    def _contrast(self, reference: Any, level: npt.NDArray[np.uint8], places: Floats, half: int) -> Floats:
        """Standard deviation (n,) of detail finer than a window, relative to the background, without the noise between
        pictures of one gel at rest.
        """
        cv2 = opencv()

        def fine(flat: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
            values = flat.astype(np.float32)
            return windows_of(values - cv2.GaussianBlur(values, (0, 0), 0.5 * half), places, half)

        mean = fine(level)
        power = mean.var(axis=(1, 2))
        several = pictures_of(reference)
        for image in several if len(several) > 1 else ():
            other = fine(as_bytes(levelled(self._reduced(grey(image)), 2.0 * self._width, self.region)))
            power = power - (other - mean).var(axis=(1, 2)) / (len(several) * (len(several) - 1))
        return np.sqrt(np.maximum(power, 0.0)) / LEVEL

    def reset(self) -> None:
        """Forget the positions of the texture in the last picture."""
        self._last: npt.NDArray[np.float32] | None = None

    def follow(self, image: npt.ArrayLike | None) -> Moved:
        """Displacement of every place in a picture.

        For an unusable picture (None, black, saturated, blurred, of another size) the result has a reason instead of
        displacements; the next picture continues.

        Parameters
        ----------
        image : array (row, column) or (row, column, 3), or None

        Returns
        -------
        Moved
        """
        given, fault = self._seen(image)
        if given is None:
            return self._nothing(fault)
        plain = self._reduced(given)
        level = as_bytes(levelled(plain, 2.0 * self._width, self.region))
        dense, start = self._started(level)
        now = np.clip(self._places + start, 0.0, np.array(level.shape[::-1]) - 1.0)
        if self._blurred(level, now):
            return self._nothing(BLURRED)
        moved = self._refined(level, start, white_of(plain))
        if np.mean(~moved.lost) < 0.1 or (~moved.lost).sum() < 3:
            self._last = None
            return self._nothing(
                f"of {len(self.positions)} places {int((~moved.lost).sum())} look as they did in the reference"
            )
        self._last = dense
        return Moved(self._step * moved.displacement, self._step * moved.std, moved.alike)

    def _started(self, level: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.float32], Floats]:
        """Optical flow of the whole picture at each place."""
        cv2 = opencv()
        begun = None if self._last is None else self._last.copy()
        dense = np.asarray(self._dense.calc(self._first, self._shrunk(level), begun), dtype=np.float32)
        part = np.array([self._small[0] / level.shape[1], self._small[1] / level.shape[0]])
        at = ((self._places + 0.5) * part - 0.5).astype(np.float32)
        found = cv2.remap(dense, at[None, :, 0], at[None, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return dense, np.asarray(found[0], dtype=np.float64) / part

    def _shrunk(self, level: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        if level.shape[::-1] == self._small:
            return level
        return np.asarray(opencv().resize(level, self._small, interpolation=opencv().INTER_AREA))

    def _reduced(self, plain: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A large picture, averaged over blocks of pixels."""
        if self._step == 1:
            return plain
        rows, columns = (n // self._step * self._step for n in plain.shape)
        size = (columns // self._step, rows // self._step)
        return np.asarray(opencv().resize(plain[:rows, :columns], size, interpolation=opencv().INTER_AREA))


def _grid(size: tuple[int, int], apart: float, margin: float) -> Floats:
    """Places (n, 2) in a picture, row by row, centred."""
    axes = []
    for length in size:
        count = max(0, int((length - 1 - 2 * margin) // apart) + 1)
        axes.append((length - 1) / 2.0 + apart * (np.arange(count) - (count - 1) / 2.0))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
