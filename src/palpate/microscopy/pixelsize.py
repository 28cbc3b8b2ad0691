"""Read the size of a pixel from the file of a picture: OME, ImageJ, Zeiss LSM, MetaMorph, Micro-Manager, and the
resolution of plain TIFF.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.recordings.damage import DAMAGE

__all__ = ["PixelSize", "differing", "pixel_size", "pixel_size_of_all"]

#: Units in metres, by names that programs use.
LENGTHS = {
    "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "\\u00b5m": 1e-6, "micron": 1e-6, "microns": 1e-6, "micrometer": 1e-6, "micrometre": 1e-6, "nm": 1e-9,
    "nanometer": 1e-9, "å": 1e-10, "pm": 1e-12, "inch": 0.0254, "in": 0.0254,
}  # fmt: skip
#: Sizes that differ by less than this fraction count as equal.
SAME = 0.02
#: A plain TIFF whose resolution means pixels larger than this [m] states the resolution of a printer or a screen (72 to
#: 600 dpi), not of a microscope.
PRINTED = 20e-6


@dataclass(frozen=True)
class PixelSize:
    """Width and height of a pixel [m], and where the numbers come from."""

    x: float
    y: float
    said: str

    def __str__(self) -> str:
        square = math.isclose(self.x, self.y, rel_tol=SAME)
        return f"{1e6 * self.x:.4g} um" if square else f"{1e6 * self.x:.4g} x {1e6 * self.y:.4g} um"


def pixel_size(path: str | Path) -> PixelSize | None:
    """The size of a pixel stated in the file, or None without a plausible one.

    Examples
    --------
    >>> from palpate.microscopy import pixel_size
    >>> print(pixel_size("beads.tif"))  # doctest: +SKIP
    0.1083 um
    """
    if Path(path).suffix.lower() not in (".tif", ".tiff"):
        return None
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF pictures", error) from error
    try:
        with tifffile.TiffFile(path) as file:
            for said, read in SOURCES:
                found = read(file)
                if found is not None and all(math.isfinite(v) and 1e-10 < v < 1e-2 for v in found):
                    return PixelSize(found[0], found[1], f"{Path(path).name} ({said})")
    except (tifffile.TiffFileError, ZeroDivisionError, *DAMAGE):
        return None  # the error is reported when the picture is read
    return None


def pixel_size_of_all(paths: Iterable[str | Path]) -> PixelSize | None:
    """Return the size of a pixel that the pictures of one field of view state.

    Raises
    ------
    InvalidInput
        Two that state different sizes, or pixels that are not square.
    """
    found: PixelSize | None = None
    for path in paths:
        one = pixel_size(path)
        if one is None:
            continue
        if not math.isclose(one.x, one.y, rel_tol=SAME):
            raise InvalidInput(
                f"{one.said}: pixels of {one}, which are not square. Resample the picture to square pixels (ImageJ: Image > Scale), or give their size (--pixel)."
            )
        if found is not None and not math.isclose(one.x, found.x, rel_tol=SAME):
            raise InvalidInput(
                f"{found.said} says that a pixel is {found}, and {one.said} {one}: are they pictures of one field of view? Give the size that holds (--pixel)."
            )
        found = found or one
    return found


def differing(path: str | Path, pixel: float, said: PixelSize | None = None) -> str:
    """Return a sentence if the file of a picture states another size of a pixel than ``pixel`` [m], else ""."""
    stated = said or pixel_size(path)
    if stated is None or all(math.isclose(v, pixel, rel_tol=SAME) for v in (stated.x, stated.y)):
        return ""
    return (
        f"{stated.said} says that a pixel is {stated}, and {1e6 * pixel:.4g} um was given and is used: lengths go with it, the strain energy with its cube "
        f"({(pixel / stated.x) ** 3:.3g} times that of the file's). Check which holds"
    )


def _number(value: Any) -> float:
    return float(value[0]) / float(value[1]) if isinstance(value, tuple) else float(value)


def _ome(file: Any) -> tuple[float, float] | None:
    if not file.ome_metadata:
        return None
    try:
        pixels = next(
            e for e in ElementTree.fromstring(file.ome_metadata).iter() if e.tag.rpartition("}")[2] == "Pixels"
        )
    except (ElementTree.ParseError, StopIteration):
        return None
    sizes = [
        _number(pixels.get(f"PhysicalSize{a}", "nan")) * _metres(pixels.get(f"PhysicalSize{a}Unit", "µm")) for a in "XY"
    ]
    return sizes[0], sizes[1] if math.isfinite(sizes[1]) else sizes[0]


def _metres(unit: str) -> float:
    return LENGTHS.get(unit.strip().replace("\\u00B5", "µ").replace("μ", "µ").lower(), math.nan)


def _resolution(file: Any, unit: float) -> tuple[float, float] | None:
    tags = file.pages[0].tags
    values = [tags[name].value if name in tags else None for name in ("XResolution", "YResolution")]
    if any(v is None or not _number(v) > 0 for v in values):
        return None
    return unit / _number(values[0]), unit / _number(values[1])


def _imagej(file: Any) -> tuple[float, float] | None:
    unit = (file.imagej_metadata or {}).get("unit")
    return _resolution(file, _metres(unit)) if isinstance(unit, str) else None


def _lsm(file: Any) -> tuple[float, float] | None:
    held = file.lsm_metadata if file.is_lsm else None
    return (float(held["VoxelSizeX"]), float(held["VoxelSizeY"])) if held else None


def _metamorph(file: Any) -> tuple[float, float] | None:
    held = file.stk_metadata if file.is_stk else None
    if not held or not held.get("XCalibration"):
        return None
    unit = _metres(str(held.get("CalibrationUnits", "um")))
    return _number(held["XCalibration"]) * unit, _number(held.get("YCalibration") or held["XCalibration"]) * unit


def _micromanager(file: Any) -> tuple[float, float] | None:
    tag = file.pages[0].tags.get("MicroManagerMetadata")
    size = tag.value.get("PixelSizeUm") if tag is not None and isinstance(tag.value, dict) else None
    return (float(size) * 1e-6, float(size) * 1e-6) if size else None


def _plain(file: Any) -> tuple[float, float] | None:
    tag = file.pages[0].tags.get("ResolutionUnit")
    unit = {2: 0.0254, 3: 0.01}.get(int(tag.value) if tag is not None else 2)
    found = None if unit is None or file.imagej_metadata else _resolution(file, unit)
    return found if found is not None and max(found) < PRINTED else None


SOURCES = (
    ("OME", _ome),
    ("Zeiss LSM", _lsm),
    ("MetaMorph", _metamorph),
    ("Micro-Manager", _micromanager),
    ("ImageJ", _imagej),
    ("TIFF resolution", _plain),
)
