"""Forces in regions that a user outlined (adhesions or cells), given as a label picture or as ImageJ's regions of
interest.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._extras import missing
from palpate._files import ordinary
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.masks import OUTLINES, array_or_masks, inside_outline, read_outlines
from palpate.microscopy.spread import read
from palpate.recordings.files import atomically

if TYPE_CHECKING:
    from palpate.microscopy.cell import CellForces

__all__ = ["LabelForce", "forces_of_labels", "read_labels", "write_labels_table"]

#: Each vector's square is divided into this many parts along each side to measure how much of it a label covers.
SUBDIVISIONS = 4
#: Vectors within NEAR pitches of an outline determine its force. A load of UNSEEN standard deviations goes undetected
#: in half of the cases.
NEAR, UNSEEN = 3.0, 2.0
#: A picture with more labels than this is taken for a photograph and refused.
MAX_LABELS = 20_000
REGIONS = (".roi", ".zip")


@dataclass(frozen=True)
class LabelForce:
    """The force within one outline.

    Attributes
    ----------
    label : str
        Its value in the picture, or the name of the region.
    area : float
        In view [m^2].
    center : (float, float)
        Pixel (column, row) of its middle.
    force, std : (float, float)
        Sum of the traction along x and y [N], and its standard deviation.
    size, size_interval
        Size of that force [N], with its 95 % interval.
    mean_traction : float
        Size of the force over the area [Pa].
    """

    label: str
    area: float
    center: tuple[float, float]
    force: tuple[float, float]
    std: tuple[float, float]
    size: float
    size_interval: tuple[float, float]

    @property
    def mean_traction(self) -> float:
        """Magnitude of the force divided by the area [Pa].

        Examples
        --------
        >>> from palpate.microscopy import LabelForce
        >>> LabelForce("1", 2e-12, (0.0, 0.0), (1e-9, 0.0), (1e-10, 1e-10), 1e-9, (0.8e-9, 1.2e-9)).mean_traction.__round__()
        500
        """
        return self.size / self.area


def read_labels(
    source: str | Path | npt.ArrayLike, *, size: tuple[int, int] | None = None, pixel: float | None = None
) -> dict[str, npt.NDArray[np.bool_]]:
    """Read masks (row, column) by label. The source is a picture of whole numbers (0: no label; TIFF, PNG, .npy,
    _seg.npy of Cellpose), ImageJ's regions (.roi, RoiSet.zip), or outlines as `read_mask` reads them (.csv, .txt,
    .json), which are numbered from 1.

    ``size``: columns and rows of the picture that regions and outlines belong to; ``pixel``: size of a pixel [m], for
    outlines in units of length.

    Raises
    ------
    InvalidInput
        A file that is not there or damaged, a picture that is no label picture or empty, regions without ``size``, or that are lines or points.
    Unsupported
        Regions where the package roifile is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.microscopy import read_labels
    >>> picture = np.zeros((40, 60), dtype=np.uint8)
    >>> picture[5:10, 5:20], picture[20:30, 40:50] = 1, 7
    >>> {label: int(mask.sum()) for label, mask in read_labels(picture).items()}
    {'1': 75, '7': 100}
    """
    if not isinstance(source, str | Path):
        return _of_picture(np.asarray(source), "the labels")
    path = ordinary(source)
    ending = path.suffix.lower()
    if ending in REGIONS:
        return _of_regions(path, size)
    if ending in OUTLINES:
        return _of_outlines(path, size, pixel)
    if ending == ".npy":
        return _of_picture(array_or_masks(path)[0], str(path))
    from palpate.microscopy.pictures import read_picture

    return _of_picture(read_picture(path), str(path))


def _of_picture(values: npt.NDArray[Any], name: str) -> dict[str, npt.NDArray[np.bool_]]:
    if values.ndim != 2 or values.dtype.kind not in "biuf":
        raise InvalidInput(
            f"{name}: a label picture has one channel of whole numbers, 0 for none; got {values.dtype} of shape {values.shape}. Save one channel as whole numbers."
        )
    if values.dtype.kind == "f" and not np.array_equal(values, np.round(values)):
        raise InvalidInput(
            f"{name}: holds numbers that are not whole, such as {values[values != np.round(values)][0]:g}. Save labels as whole numbers, 0 where there is none."
        )
    found = np.unique(values)
    found = found[found != 0]
    if not len(found):
        raise InvalidInput(
            f"{name}: every pixel is zero, so it holds no label. Give each area a whole number from 1 on."
        )
    if len(found) > MAX_LABELS or (
        values.dtype.kind in "iuf"
        and len(found) > 16
        and (np.diff(values.astype(np.float64), axis=1) == 0).mean() < 0.8
    ):
        raise InvalidInput(
            f"{name}: holds {len(found)} values and changes from pixel to pixel: it looks like a photograph, and labels are areas of one whole number."
        )
    return {f"{int(v)}": np.asarray(values == v) for v in found}


def _of_outlines(path: Path, size: tuple[int, int] | None, pixel: float | None) -> dict[str, npt.NDArray[np.bool_]]:
    """Return the masks of outlines given as corners."""
    if size is None:
        raise InvalidInput(
            f"{path}: outlines do not tell the size of their picture: give a label picture of its size (TIFF, PNG), or the size: --image of tfm, size= in Python."
        )
    x, y = np.arange(size[0], dtype=np.float64), np.arange(size[1], dtype=np.float64)
    corners = read_outlines(path, pixel=pixel)
    return {f"{number}": inside_outline(one, x, y) for number, one in enumerate(corners, start=1)}


def _of_regions(path: Path, size: tuple[int, int] | None) -> dict[str, npt.NDArray[np.bool_]]:
    """Return the masks of ImageJ's regions of interest."""
    try:
        import roifile
    except ImportError as error:
        raise missing("ImageJ's regions", error) from error
    if size is None:
        raise InvalidInput(
            f"{path}: regions do not tell the size of their picture: give a label picture of its size (TIFF, PNG), or the size: --image of tfm, size= in Python."
        )
    try:
        held = roifile.roiread(path)
    except Exception as error:  # a damaged file may raise any kind of error
        raise InvalidInput(
            f"{path}: cannot be read as ImageJ's regions ({type(error).__name__}: {str(error)[:80]})."
        ) from error
    out: dict[str, npt.NDArray[np.bool_]] = {}
    for number, region in enumerate(held if isinstance(held, list) else [held], start=1):
        name = region.name or f"{number}"
        corners = region.coordinates()
        if corners is None or len(corners) < 3:
            raise InvalidInput(
                f"{path}: region {name} is a line or points, which hold no area. Delete it, or draw an area."
            )
        x, y = np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5  # ImageJ counts from pixels' corners
        out[name if name not in out else f"{name}-{number}"] = inside_outline(
            np.asarray(corners, dtype=np.float64), x, y
        )
    return out


def forces_of_labels(forces: CellForces, labels: Any, *, size: tuple[int, int] | None = None) -> list[LabelForce]:
    """Return the force in each label's area, with its error: the sum of the traction over the area. Areas may overlap.

    Parameters
    ----------
    forces : CellForces
    labels : dict of masks, array or path
        As `read_labels` takes or returns them.
    size : (int, int), optional
        Columns and rows of the picture that labels belong to; default: what the field covers.

    Raises
    ------
    InvalidInput
        Labels of another picture, and those of `read_labels`.

    Examples
    --------
    >>> forces_of_labels(forces, "adhesions.tif")  # doctest: +SKIP
    """
    field = forces.field
    size = (
        size
        or (None if forces.picture is None else (int(np.shape(forces.picture)[1]), int(np.shape(forces.picture)[0])))
        or field.size
    )
    masks = labels if isinstance(labels, dict) else read_labels(labels, size=size)
    one = next(iter(masks.values()))
    if any(abs(a - b) > 2 * field.step + 0.05 * b for a, b in zip(one.shape[::-1], size)):
        raise InvalidInput(
            f"the labels have {one.shape[1]} x {one.shape[0]} pixels, and the picture {size[0]} x {size[1]}: give labels of this picture."
        )
    rows, columns = field.shape
    x, y = _parts(columns), _parts(rows)
    at = [np.rint(s + field.step * p).astype(int) for s, p in zip(field.start, (x, y))]
    inside = [(p >= 0) & (p < n) for p, n in zip(at, one.shape[::-1])]
    parts = []  # of each label, the indices of its parts of squares: regions may overlap
    for mask in masks.values():
        there = mask[np.clip(at[1], 0, mask.shape[0] - 1)[:, None], np.clip(at[0], 0, mask.shape[1] - 1)[None, :]]
        parts.append(np.flatnonzero(there & inside[1][:, None] & inside[0][None, :]))
    side = field.pitch / SUBDIVISIONS
    sums = np.stack([_sums(t, parts) for t in _tractions(forces, field.pitch * x, field.pitch * y, side)]) * side**2
    out = []
    for i, (label, mask) in enumerate(masks.items()):
        area = len(parts[i]) * side**2
        if not area:
            continue
        each = sums[:, :, i]
        hidden = _hidden(forces, mask, area, each)
        (fx, sx, _), (fy, sy, _) = (read("force", each[:, c], forces.touch._scale_std) for c in (0, 1))
        along = np.array([fx, fy]) / max(math.hypot(fx, fy), 1e-300)
        length = math.hypot(fx, fy)
        sx, sy = math.hypot(sx, hidden), math.hypot(sy, hidden)
        std = math.hypot(read("force", each @ along, forces.touch._scale_std)[1], hidden)
        middle = tuple(float(np.mean(m)) for m in np.nonzero(mask)[::-1])
        out.append(
            LabelForce(
                label,
                area,
                (middle[0], middle[1]),
                (fx, fy),
                (sx, sy),
                length,
                (max(length - 1.96 * std, 0.0), length + 1.96 * std),
            )
        )
    if not out:
        raise InvalidInput(
            "no label lies where there are vectors. Give labels of this picture, or outline areas between the outermost vectors."
        )
    return out


def _hidden(forces: CellForces, mask: npt.NDArray[np.bool_], area: float, sums: Floats) -> float:
    """Return the standard deviation [N] of a force that may be present but undetected, for the fraction of samples
    without a blob in the outline. It is added because a user would not outline an adhesion by chance.

    If only the vectors near it, relative to their mean, determine a force, its standard deviation is noise/|response|;
    the samples contain a blob for forces from about four of these on.
    """
    if forces.samples is None or forces.response is None or forces.touch.noise_std is None:
        return 0.0
    field = forces.field
    middle = [float(np.mean(m)) for m in np.nonzero(mask)[::-1]]
    x, y = (
        field.pixel * (s + field.step * np.arange(n) - m) for s, n, m in zip(field.start, field.shape[::-1], middle)
    )
    gx, gy = np.meshgrid(x, y)
    near = (np.hypot(gx, gy) < NEAR * field.pitch + math.sqrt(area)) & field.valid
    if near.sum() < 3:
        return 0.0
    # users draw outlines wider than the adhesion
    variance = area / 36 + field.aperture**2 / 12
    seen = forces.response.tensor(gx[near], gy[near], variance)[0]
    known = float(np.mean(forces.touch.noise_std)) / max(float(np.linalg.norm(seen - seen.mean())), 1e-300)
    return UNSEEN * known * math.sqrt(float(np.mean(np.hypot(*sums.T) < known)))


def _parts(count: int) -> Floats:
    """Return the middles of the parts of ``count`` squares, in steps from the first vector."""
    return (np.arange(count * SUBDIVISIONS) + 0.5) / SUBDIVISIONS - 0.5


def _tractions(forces: CellForces, x: Floats, y: Floats, side: float) -> Any:
    """Iterate over the draws of the traction (2, y, x)."""
    if forces.samples is not None:
        for sample in forces.samples:
            yield sample.on(x, y, side)
    else:
        for draw in forces.draws:
            yield np.repeat(np.repeat(draw, SUBDIVISIONS, axis=1), SUBDIVISIONS, axis=2)


def _sums(traction: Floats, parts: list[npt.NDArray[np.intp]]) -> Floats:
    """Sums (2, label) of a traction (2, y, x) over the flat indices of each label."""
    return np.stack([[float(t.ravel()[part].sum()) for part in parts] for t in traction])


def write_labels_table(rows: list[dict[str, Any]], path: str | Path) -> None:
    """Write rows as CSV; the names in the first row give the columns.

    Examples
    --------
    >>> write_labels_table([{"file": "a.npy", "frame": 0, "label": "1"}], "forces.csv")  # doctest: +SKIP
    """
    held = io.StringIO()
    writer = csv.DictWriter(held, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)

    def write(at: str) -> None:
        Path(at).write_text(held.getvalue(), encoding="utf-8")

    atomically(path, write)


def rows_of(labelled: list[LabelForce], *, file: str, frame: int) -> list[dict[str, Any]]:
    """Return rows of a table: the file, the frame and the force of each label."""
    return [
        {
            "file": file,
            "frame": frame,
            "label": f.label,
            "x_px": f"{f.center[0]:.6g}",
            "y_px": f"{f.center[1]:.6g}",
            "area_m2": f"{f.area:.6g}",
            "force_x_N": f"{f.force[0]:.6g}",
            "force_y_N": f"{f.force[1]:.6g}",
            "std_x_N": f"{f.std[0]:.3g}",
            "std_y_N": f"{f.std[1]:.3g}",
            "force_N": f"{f.size:.6g}",
            "low_95_N": f"{f.size_interval[0]:.6g}",
            "high_95_N": f"{f.size_interval[1]:.6g}",
            "mean_traction_Pa": f"{f.mean_traction:.6g}",
        }
        for f in labelled
    ]
