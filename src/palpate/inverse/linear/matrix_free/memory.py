"""What a matrix-free system takes, known before any work."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate._memory import available, require
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Pad
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.operator import commensurate

__all__ = ["AT_A_TIME", "LONGEST", "TOGETHER", "check_system", "servable", "system_memory"]

#: Numbers held at a time while several frames are multiplied (64 MB), and in the rows of frames that are solved together (8 MB, some ten times).
AT_A_TIME, TOGETHER = 8_000_000, 1_000_000
#: Cosines along each axis of a channel (of an area, of a line) that are solved exactly: 16 on an area halve the iterations, and 64 cost more than
#: they save.
LONGEST = {2: 4, 1: 16}
ORDINAL = {2: "nd", 3: "rd"}


def servable(planes: Sequence[Array], surface: Grid) -> bool:
    """Whether readings are a convolution of the traction, and their noise can be whitened."""
    return all(
        not isinstance(a, ScatteredArray)
        and commensurate(a, surface) is not None
        and not (a.noise_correlation and a.mask is not None)
        for a in planes
    )


def system_memory(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> float:
    """Most bytes at a time while a `System` is prepared and solved.

    The influence of a cell with what its formulas hold, per lag; the symbol with its factors; the longest waves and their products; the frames
    in work with some ten copies of their rows, and what their transforms take.
    """
    lags, symbol, rows = 0.0, 0.0, 0.0
    components = len(surface.components)
    for a in planes:
        channels, taxels = len(a.channels), math.prod(a.shape)
        ratio = (
            1.0
            if isinstance(a, ScatteredArray)
            else math.prod(max(1.0, p / s) for p, s in zip(a.grid.spacings, surface.spacings))
        )
        here = math.prod(
            n + m * r for n, m, r in zip(surface.shape, a.shape, [ratio ** (1 / a.dimensions)] * a.dimensions)
        )
        held = (10 + 8 * channels) if isinstance(pad, HalfSpace) else (60 + 80 * channels)
        lags = max(lags, held * here) + (channels * components * 2 + 2 * channels) * here
        symbol += 2**a.dimensions * taxels * ratio * 2 * (channels * sought + 2 * channels**2)
        rows += channels * taxels
    longest = LONGEST[surface.dimensions] ** surface.dimensions * sum(len(a.channels) for a in planes)
    work = 14 * max(rows, TOGETHER) + AT_A_TIME + 6 * components * math.prod(surface.shape)
    return 8.0 * (lags + symbol + 3 * longest * rows + work)


def check_system(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> None:
    """Refuse what memory does not hold."""
    readings = sum(int(a.valid.sum()) * len(a.channels) for a in planes)
    peak, free = system_memory(pad, planes, surface, sought), available()
    step = 2 if free is None else max(2, math.ceil((peak / max(0.5 * free, 1.0)) ** (1 / surface.dimensions)))
    slices = ", ".join([f"::{step}"] * surface.dimensions)
    require(
        peak,
        f"{readings} readings on a surface of {' x '.join(map(str, surface.shape))} cells",
        f"Describe the array in parts that overlap by a few depths, or take every {step}{ORDINAL.get(step, 'th')} taxel (readings[..., {slices}], "
        f"a pitch {step} times as large).",
    )
