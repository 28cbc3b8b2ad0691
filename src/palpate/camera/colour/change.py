"""Relative changes of colour from the gel at rest, and masks of pixels without information."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["change_of", "changed_places", "dark_spots", "reduced", "saturated_or_black", "step_of"]

#: Number of columns to which pictures are reduced by averaging blocks: slopes of contacts of a millimetre need no more,
#: and averaging reduces noise.
COLUMNS = 320
#: Levels (of 1) above which a pixel is saturated and below which it is black; and the floor added to the light at rest,
#: so that dark channels do not diverge.
BRIGHT, BLACK, FLOOR = 0.985, 0.008, 0.03
#: Standard deviation of the blur that is applied to pictures [reduced pixels].
BLUR = 1.0
#: Blur over which a change is judged [blocks]; standard deviations by which it must stand out (a million pixels of
#: noise contain none of six); and fewest blocks of such a place, since a speck of dust is smaller.
JUDGED, CLEAR, FEWEST = 2.5, 6.0, 60
#: A spot is dark if every channel is below this fraction of its surroundings, whose width is AROUND of the picture's: a
#: slope darkens some colours and brightens others.
DARK, AROUND = 0.7, 0.1


def step_of(size: tuple[int, int]) -> int:
    """Pixels along each side of a block."""
    return max(1, round(size[0] / COLUMNS))


def reduced(image: npt.ArrayLike, step: int, name: str = "picture") -> tuple[Floats, npt.NDArray[np.bool_]]:
    """A colour picture from 0 to 1 in blocks (row, column, 3), and the mask of its saturated or black blocks.

    Raises
    ------
    InvalidInput
        A missing or grey picture.
    """
    values = np.asarray(image)
    if values.ndim != 3 or values.shape[2] not in (3, 4):
        raise InvalidInput(
            f"{name}: slopes are measured by colour, and the picture has shape {values.shape}: record (rows, columns, 3) with red, green, blue."
        )
    top = 255.0 if values.dtype == np.uint8 else 65535.0 if values.dtype == np.uint16 else 1.0
    if values.dtype not in (np.uint8, np.uint16, np.float32, np.float64):
        raise InvalidInput(f"{name}: a picture holds 8 or 16 bit levels, or floats from 0 to 1; got {values.dtype}.")
    part = values[..., :3].astype(np.float64) / top
    if not np.isfinite(part).all() or part.min() < 0.0 or part.max() > 1.0 + 1e-6:
        raise InvalidInput(f"{name}: levels must be finite, floats from 0 to 1; got {part.min():g} to {part.max():g}.")
    if part.max(initial=0.0) > BLACK and float(np.ptp(part, axis=2).max()) == 0.0:
        raise InvalidInput(
            f"{name}: all channels are equal: a grey picture has no colours to measure slopes by. Record it in colour."
        )
    rows, columns = (n // step * step for n in part.shape[:2])
    blocks = part[:rows, :columns].reshape(rows // step, step, columns // step, step, 3)
    lost = np.asarray(saturated_or_black(blocks).any(axis=(1, 3)))
    return np.asarray(blocks.mean(axis=(1, 3))), lost


def saturated_or_black(image: Floats) -> npt.NDArray[np.bool_]:
    """Mask (*place,) of pixels or blocks (*place, 3) from 0 to 1 in which a colour is saturated or black."""
    return np.asarray(((image > BRIGHT) | (image < BLACK)).any(axis=-1))


def change_of(image: Floats, rest: Floats) -> Floats:
    """Relative change of colour (row, column, 3), blurred, after the overall brightness of each channel is removed."""
    from scipy.ndimage import gaussian_filter

    blurred, still = (gaussian_filter(v, (BLUR, BLUR, 0)) for v in (image, rest))
    level = np.median((blurred + FLOOR) / (still + FLOOR), axis=(0, 1))
    return np.asarray((blurred + FLOOR) / (still + FLOOR) / level - 1.0)


def dark_spots(image: Floats) -> npt.NDArray[np.bool_]:
    """Printed dots or dirt that hide the coat: darker than the surroundings in every colour, widened by a pixel."""
    from scipy.ndimage import binary_dilation, grey_closing

    side = 2 * math.ceil(0.5 * AROUND * image.shape[1]) + 1
    part: Any = np.stack(
        [(v + FLOOR) / (grey_closing(v, size=(side, side)) + FLOOR) for v in np.moveaxis(image, -1, 0)]
    )
    return np.asarray(binary_dilation(part.max(axis=0) < DARK, iterations=3))


def changed_places(change: Floats, rest: Floats, lost: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Mask of blocks (row, column) whose colours change by more than noise and drift of the light."""
    from scipy.ndimage import binary_fill_holes, gaussian_filter, label

    weight = gaussian_filter((~lost).astype(np.float64), JUDGED)
    total = np.zeros(lost.shape)
    for part, still in zip(np.moveaxis(change, -1, 0), np.moveaxis(rest, -1, 0)):
        # Noise and drift have equal sizes in levels of the camera, not relative to the light at rest.
        level = np.where(lost, 0.0, part * (still + FLOOR))
        smooth = gaussian_filter(level, JUDGED) / np.maximum(weight, 0.1)
        seen = smooth[~lost]
        middle = float(np.median(seen))
        scatter = max(1.4826 * float(np.median(np.abs(seen - middle))), 1e-5)
        total += ((smooth - middle) / scatter) ** 2
    spots, count = label((total > CLEAR**2 * change.shape[2]) & (weight > 0.1))
    sizes = np.bincount(spots.ravel(), minlength=count + 1)
    kept = sizes >= FEWEST
    kept[0] = False
    return np.asarray(binary_fill_holes(kept[spots]))
