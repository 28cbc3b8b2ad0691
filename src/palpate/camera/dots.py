"""Find printed dots in one picture: position, size, and how much of each is visible. No grid is assumed.

A dot of radius r is an extremum of the scale-normalised Laplacian s^2 (Laplacian of the picture blurred by s) in place
and scale, at s = r / sqrt(2) (Lindeberg 1998). The size of most strong extrema is that of the print; scratches are
smaller, variations of light are larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.camera.region import Region
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.view import grey, opencv

__all__ = ["Found", "Print", "fault_of", "find_dots", "levelled"]

#: Smallest blur for the search of dots [pixels], ratio of successive blurs, and largest blur as a fraction of the
#: picture.
FINEST, FACTOR, COARSEST = 1.0, 1.2, 1.0 / 14.0
#: Response of a dot relative to the typical one: below WHOLE it is partly hidden, below SOME it is not a dot.
WHOLE, SOME = 0.62, 0.3
#: Smallest contrast of a dot, relative to the light around it, and relative to the noise.
FAINTEST, NOISES = 0.04, 6.0
#: Number of strongest extrema to examine.
MAX_EXTREMA = 5000
#: Largest factor by which a picture is shrunk to search for dots of a known print, and the smallest blur that must
#: remain [pixels of the small picture].
SMALLER, BLURRY = 4, 3.0
#: Fewest dots of a print, and fewest that identify a print by their even spacing alone.
FEWEST, GRID = 5, 9
#: A print is accepted if this fraction of the salient spots has one size; or, if there is dirt between the dots, if the
#: distance to neighbours is this many times that of random places.
ALIKE, EVEN = 0.8, 1.6
#: Largest ratio of standard deviation to mean of the distances to neighbours; for random prints with a minimum
#: distance, and for speckle, it is up to 0.31.
UNEVEN = 0.38
#: Largest distance between neighbouring dots, in radii.
SPARSE = 25.0
#: Smallest distance of a dot from the edge of the picture, or of the gel's region, in radii.
INSIDE = 0.8


@dataclass(frozen=True)
class Print:
    """Common properties of the dots of a print: the blur that fits them [pixels], dark (1) or bright (-1), and their
    typical response.
    """

    blur: float
    sign: int
    response: float

    @property
    def radius(self) -> float:
        """Radius of a dot [pixels]."""
        return math.sqrt(2.0) * self.blur


@dataclass(frozen=True, eq=False)
class Found:
    """Dots of one picture.

    Attributes
    ----------
    positions : array (n, 2)
        (column, row) [pixels].
    strength : array (n,)
        Response relative to that of the typical dot: 1 for a whole one.
    print : Print
    """

    positions: Floats
    strength: Floats
    print: Print

    @property
    def whole(self) -> npt.NDArray[np.bool_]:
        """Mask of the dots that are completely visible."""
        return self.strength >= WHOLE


def fault_of(image: npt.NDArray[Any]) -> str:
    """The reason why a grey picture is unusable, or "".

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera import fault_of
    >>> fault_of(np.zeros((20, 20), dtype=np.uint8))
    'the picture is black'
    """
    full = {"uint8": 255.0, "uint16": 65535.0}.get(image.dtype.name)
    values = image[:: max(1, image.shape[0] // 80), :: max(1, image.shape[1] // 80)].astype(np.float64)
    if not np.isfinite(values).all():
        return "the picture holds values that are not finite"
    low, middle, high = np.quantile(values, [0.01, 0.5, 0.99])
    if full is not None:
        if high < 0.04 * full and image.dtype == np.uint8:
            return "the picture is black"
        if np.mean(values >= 0.99 * full) > 0.5:
            return "the picture is saturated: most of it is white"
    if high <= 0:
        return "the picture is black"
    if high - low < 0.01 * abs(middle):
        return "the picture is empty: it has one grey level"
    return ""


def levelled(image: npt.NDArray[Any], width: float, region: Region | None = None) -> npt.NDArray[np.float32]:
    """The picture divided by its light, about 1 between dots. The light is the mean over about ``width`` pixels on
    every side. 1 outside a ``region``.
    """
    cv2 = opencv()
    plain = image.astype(np.float32)
    side = max(3, 2 * int(width) + 1)

    def mean(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        for _ in range(2):  # two boxes: smooth, at a cost that does not grow with the width
            values = cv2.blur(values, (side, side), borderType=cv2.BORDER_REFLECT)
        return values

    light = mean(plain) if region is None else mean(plain * region.weight) / np.maximum(mean(region.weight), 1e-3)
    least = 0.02 * float(light.max())
    flat = np.asarray(cv2.divide(plain, cv2.max(light, max(least, 1e-6))), dtype=np.float32)
    return flat if region is None else np.where(region.mask, flat, np.float32(1.0))


def _response(flat: npt.NDArray[np.float32], blur: float) -> npt.NDArray[np.float32]:
    """Scale-normalised Laplacian, positive on dark dots; 1 corresponds to a black dot on white."""
    cv2 = opencv()
    soft = cv2.GaussianBlur(flat, (0, 0), blur, borderType=cv2.BORDER_REFLECT)
    return np.asarray(blur * blur * cv2.Laplacian(soft, cv2.CV_32F, ksize=1, borderType=cv2.BORDER_REFLECT))


def _peaks(
    response: npt.NDArray[np.float32], least: float, apart: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows and columns of maxima above ``least`` that are ``apart``."""
    cv2 = opencv()
    side = 2 * max(1, round(apart)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    # First test the nearest pixels for all candidates, then the whole neighbourhood of the remaining few.
    near = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    rows, columns = np.nonzero((response >= cv2.dilate(response, near)) & (response > least))
    down, across = (axis - side // 2 for axis in np.nonzero(kernel))
    height, width = response.shape
    around = response[np.clip(rows[:, None] + down, 0, height - 1), np.clip(columns[:, None] + across, 0, width - 1)]
    most = response[rows, columns] >= around.max(axis=1, initial=-np.inf)
    return rows[most], columns[most]


def _subpixel(response: npt.NDArray[np.float32], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> Floats:
    """(column, row) of each peak by a parabola along each axis."""
    out = []
    height, width = response.shape
    for axis, at, size in ((1, columns, width), (0, rows, height)):
        inner = np.clip(at, 1, size - 2)
        around = [response[rows, inner + d] if axis == 1 else response[inner + d, columns] for d in (-1, 0, 1)]
        before, here, after = (a.astype(np.float64) for a in around)
        curve = before - 2.0 * here + after
        move = np.where(curve < 0, 0.5 * (before - after) / np.where(curve < 0, curve, -1.0), 0.0)
        out.append(inner + np.clip(move, -1.0, 1.0))
    return np.stack(out, axis=-1)


def find_dots(
    image: npt.ArrayLike,
    print: Print | None = None,
    *,
    level: npt.NDArray[np.float32] | None = None,
    region: Region | None = None,
) -> Found:
    """Dots in a picture, dark or bright, of the size that most of them share.

    Parameters
    ----------
    image : array (row, column) or (row, column, 3)
    print : Print, optional
        Print found in an earlier picture of the same gel (`Found.print`): its size and brightness are reused, which is
        faster and finds the visible part of a print that is partly hidden.
    level : array (row, column), optional
        The picture over its light, if computed already.
    region : Region, optional
        The part of the picture that shows the gel.

    Returns
    -------
    Found

    Raises
    ------
    InvalidInput
        A black, white or empty picture, or one without dots: spots of many sizes, or that lie at random, are no print.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Scene, dot_grid, find_dots
    >>> gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    >>> scene = Scene(pad=gel, depth=0.5e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> found = find_dots(scene.picture())
    >>> len(found.positions), found.positions.min(axis=0).round().tolist()  # the upper left dot
    (35, [19.0, 20.0])
    """
    plain = grey(image)
    fault = fault_of(plain)
    if fault:
        raise InvalidInput(f"{fault}; no dots can be found in it. Check light, exposure and lens cap.")
    known = print
    if print is None:
        print = _print_of(plain, region)
    if level is None:
        level = levelled(plain, 4.0 * print.blur, region)
    if known is None or (step := _shrink_factor(level.shape, known.blur)) == 1:
        found = _match_print(level, print)
    else:
        # Large dots remain visible in a smaller picture.
        size = (level.shape[1] // step, level.shape[0] // step)
        small = np.asarray(opencv().resize(level, size, interpolation=opencv().INTER_AREA))
        found = _match_print(small, Print(print.blur / step, print.sign, print.response))
        found = Found(step * (found.positions + 0.5) - 0.5, found.strength, print)
    if region is not None:
        there = region.holds(found.positions, INSIDE * print.radius)
        found = Found(found.positions[there], found.strength[there], print)
    if known is None:
        _check_print(found)
    return found


def _check_print(found: Found) -> None:
    """Raise an error for spots that are not a print: dust, scratches and edges of light differ in size, and are random
    or in rows.

    The mean distance to the nearest neighbour is 0.5 / sqrt(density) for random places, with a standard deviation of
    0.52 / sqrt(n) of it (Clark and Evans 1954); for dots, which keep a distance, it is larger, in a square grid twice
    that.
    """
    from scipy.spatial import ConvexHull, QhullError, cKDTree

    dots = found.positions[found.whole]
    count, share = len(dots), float(np.mean(found.whole)) if len(found.whole) else 0.0
    apart, chance, far = 0.0, 1.0, False
    if count >= FEWEST:
        distance = cKDTree(dots).query(dots, k=2)[0][:, 1]
        try:
            hull = ConvexHull(dots)
        except QhullError:  # all on one line
            area = float(np.hypot(*np.ptp(dots, axis=0))) * float(distance.mean())
        else:
            # Half of the surroundings of each dot on the rim lies outside.
            area = hull.volume + 0.5 * hull.area * float(distance.mean())
        apart = float(distance.mean()) / (0.5 * math.sqrt(area / count))
        chance = 1.0 + 3.0 * 0.52 / math.sqrt(count)
        far = float(np.median(distance)) > SPARSE * found.print.radius
        # The distances of random places vary by 0.52 of their mean.
        even = float(distance.std()) < UNEVEN * float(distance.mean())
        if not far and even and apart > chance and (share > ALIKE or (count >= GRID and apart > EVEN)):
            return
    spots = len(found.positions)
    why = (
        f"differ in size (only {count} have that of the others)"
        if share <= ALIKE or count < FEWEST
        else "are too few and too far from each other"
        if count and far
        else "lie at random or in rows"
    )
    raise InvalidInput(
        f"no dots found: {spots} spots that stand out from the picture {why}, as dust, scratches and edges do. A gel needs printed dots, or a texture and "
        'texture = "1 mm" in [camera]; where the picture shows more than the gel, write roi = [[left, top], [right, bottom]] there, in pixels.'
    )


def _shrink_factor(shape: tuple[int, ...], blur: float) -> int:
    """The factor by which a picture may shrink in a search for dots of this blur."""
    return max(n for n in range(1, SMALLER + 1) if n == 1 or (blur >= n * BLURRY and not any(s % n for s in shape)))


def _match_print(level: npt.NDArray[np.float32], print: Print) -> Found:
    """Dots of a known print in a levelled picture."""
    response = print.sign * _response(level, print.blur)
    rows, columns = _peaks(response, SOME * print.response, 0.9 * print.blur)
    positions = _subpixel(response, rows, columns)
    strength = response[rows, columns] / print.response
    # The middle of a dot that touches the edge cannot be measured.
    height, width = level.shape
    reach = INSIDE * print.radius
    inside = (
        (positions[:, 0] >= reach)
        & (positions[:, 0] <= width - 1 - reach)
        & (positions[:, 1] >= reach)
        & (positions[:, 1] <= height - 1 - reach)
    )
    kept = inside & _compact(response, positions, print)
    kept &= _first(np.stack([columns, rows], axis=1), print.blur)
    return Found(positions[kept], strength[kept].astype(np.float64), print)


def _first(peaks: npt.NDArray[np.intp], apart: float) -> npt.NDArray[np.bool_]:
    """Keep one of several adjacent peaks: two pixels with exactly equal response."""
    from scipy.spatial import cKDTree

    kept = np.ones(len(peaks), dtype=bool)
    if len(peaks) > 1:
        for _, later in sorted(cKDTree(peaks).query_pairs(0.9 * apart)):
            kept[later] = False
    return kept


def _compact(response: npt.NDArray[np.float32], positions: Floats, print: Print) -> npt.NDArray[np.bool_]:
    """Mask of peaks whose response decreases in all directions: a line or an edge of light has a ridge instead."""
    cv2 = opencv()
    if not len(positions):
        return np.zeros(0, dtype=bool)
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = positions[:, None, :] + 1.5 * print.radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    at = ring.astype(np.float32)
    around = cv2.remap(response, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    middle = cv2.remap(
        response, positions[:, None, 0].astype(np.float32), positions[:, None, 1].astype(np.float32), cv2.INTER_LINEAR
    )
    # A neighbour that touches covers two of twelve directions.
    return np.asarray(np.quantile(around, 0.75, axis=1) < 0.5 * middle[:, 0])


def _isolated(places: Floats, radii: Floats, strength: npt.NDArray[Any]) -> npt.NDArray[np.intp]:
    """Extrema not covered by a stronger one: a sharp dot has further extrema along its rim."""
    from scipy.spatial import cKDTree

    order = np.argsort(-strength, kind="stable")[:MAX_EXTREMA]
    tree = cKDTree(places[order])
    free = np.ones(len(order), dtype=bool)
    for i in range(len(order)):
        if free[i]:
            near = [j for j in tree.query_ball_point(places[order[i]], 1.3 * float(radii[order[i]])) if j > i]
            free[near] = False
    return order[free]


def _print_of(plain: npt.NDArray[Any], region: Region | None = None) -> Print:
    """Size, sign and strength of the dots that most strong extrema agree on."""
    coarsest = COARSEST * min(plain.shape)
    count = int(math.log(max(coarsest / FINEST, 1.0)) / math.log(FACTOR)) + 1
    blurs = FINEST * FACTOR ** np.arange(count)
    cv2 = opencv()
    kernel = np.ones((3, 3), np.uint8)
    best: tuple[float, Print] | None = None
    # White noise of 1 has a Laplacian of sqrt(20), and its response at s is smaller by sqrt(2 pi) s.
    rough = cv2.Laplacian(plain.astype(np.float32), cv2.CV_32F, ksize=1)
    noise = float(np.median(np.abs(rough))) / 0.6745 / math.sqrt(20.0) / max(float(plain.mean()), 1e-9)
    stack = np.stack([_response(levelled(plain, 4.0 * b, region), b) for b in blurs])
    if region is not None:
        stack *= np.stack([region.within(math.sqrt(2.0) * b) for b in blurs])
    for sign in (1, -1):
        signed = sign * stack
        local = np.stack([cv2.dilate(r, kernel) for r in signed])
        around = local.copy()
        around[1:] = np.maximum(around[1:], local[:-1])
        around[:-1] = np.maximum(around[:-1], local[1:])
        level, rows, columns = np.nonzero((signed >= around) & (signed > FAINTEST))
        if len(level) < FEWEST:
            continue
        strength = signed[level, rows, columns]
        own = _isolated(np.stack([columns, rows], axis=1).astype(np.float64), math.sqrt(2.0) * blurs[level], strength)
        level, strength = level[own], strength[own]
        if len(level) < FEWEST:
            continue
        # Choose the size whose extrema have the largest sum of squared responses; squares, so that many weak ones are
        # not a print.
        weight = np.bincount(level, strength.astype(np.float64) ** 2, minlength=count)
        joined = np.convolve(weight, [0.5, 1.0, 0.5], mode="same")
        at = int(np.argmax(joined))
        near = np.abs(level - at) <= 1
        if np.count_nonzero(near) < FEWEST:
            continue
        typical = float(np.median(strength[near & (strength > 0.5 * np.quantile(strength[near], 0.9))]))
        blur = float(np.exp(np.average(np.log(blurs[level[near]]), weights=strength[near] ** 2)))
        if typical < max(NOISES * noise / (2.5 * blur), 2.0 * FAINTEST):
            continue
        score = typical * joined[at]
        if best is None or score > best[0]:
            best = (score, Print(blur, sign, typical))
    if best is None:
        raise InvalidInput(
            "no dots found: no spots of one size stand out from the picture. Focus, light evenly, and see that five dots or more are in it. "
            'A gel with a texture and no dots needs texture = "1 mm" in [camera]: the distance between readings.'
        )
    return best[1]
