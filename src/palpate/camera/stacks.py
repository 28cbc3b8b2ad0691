"""What a microscope's TIFF stack says of its pages: channels, planes, times."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from palpate.errors import InvalidInput
from palpate.units import UNITS

__all__ = ["check_axes", "pages_claimed", "rate_of"]


def check_axes(file: Any, path: Path) -> None:
    """Refuse pages that are not pictures of one thing one after another, where the file says so: channels side by side, planes of several times.

    Planes alone pass: ImageJ calls the pictures of a sequence slices.
    """
    series = file.series[0]
    sizes = {axis: int(size) for axis, size in zip(series.axes, series.shape) if size > 1}
    if "C" in sizes:
        raise InvalidInput(
            f"{path}: holds {sizes['C']} channels (its axes are {series.axes}): save the one that shows beads or dots by itself (ImageJ: Image > Color > Split Channels)."
        )
    if "Z" in sizes and "T" in sizes:
        raise InvalidInput(
            f"{path}: holds {sizes['Z']} planes of {sizes['T']} times (its axes are {series.axes}): save one plane by itself (ImageJ: Image > Duplicate, one slice)."
        )


def pages_claimed(file: Any) -> int:
    """Pictures that the head of a file claims, of a stack whose end is missing."""
    shaped = [int(m["shape"][0]) for m in file.shaped_metadata or () if len(m.get("shape", ())) > 2]
    return max([0, int((file.imagej_metadata or {}).get("images", 0)), *shaped])


def rate_of(file: Any) -> float | None:
    """Pictures a second by ImageJ's frame interval or OME's time increment; None where neither is there."""
    interval = float((file.imagej_metadata or {}).get("finterval") or 0.0)
    if not interval and file.ome_metadata:
        try:
            pixels = next(
                e for e in ElementTree.fromstring(file.ome_metadata).iter() if re.fullmatch(r"(\{.*\})?Pixels", e.tag)
            )
        except (ElementTree.ParseError, StopIteration):
            return None
        unit = UNITS["time"].get(pixels.get("TimeIncrementUnit", "s"), 0.0)
        interval = unit * float(pixels.get("TimeIncrement") or 0.0)
    return 1.0 / interval if interval > 0 else None
