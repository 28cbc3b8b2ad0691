"""Memory of a matrix-free system, estimated before any work."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate._memory import available, require
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Pad
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.operator import commensurate
from palpate.sensing.scattered import near_memory

__all__ = ["AT_A_TIME", "LONGEST", "TOGETHER", "check_system", "on_lattice", "servable", "system_memory"]

#: Numbers held at a time while several frames are multiplied (64 MB), and in the rows of frames that are solved
#: together (8 MB, about ten copies).
AT_A_TIME, TOGETHER = 8_000_000, 1_000_000
#: Number of the longest cosines along each axis of a channel (in area and line contact) that are solved exactly: 16 in
#: area contact halve the iterations, and 64 cost more than they save.
LONGEST = {2: 4, 1: 16}
ORDINAL = {2: "nd", 3: "rd"}


def on_lattice(planes: Sequence[Array], surface: Grid) -> bool:
    """Whether readings are samples of a convolution."""
    return all(commensurate(a, surface) is not None for a in planes)


def servable(planes: Sequence[Array]) -> bool:
    """Whether the noise can be whitened without a matrix of all taxels: independent noise, or a complete regular
    array.
    """
    return all(not a.noise_correlation or (not isinstance(a, ScatteredArray) and a.mask is None) for a in planes)


def system_memory(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> float:
    """Peak memory in bytes while a `System` is prepared and solved.

    Includes the influence of a cell with intermediate results, per lag (for scattered positions, their near cells);
    the symbol with its factors; the longest waves and their products; and about ten copies of the rows of the frames
    being solved, with their transforms.
    """
    prepared, kept, rows = 0.0, 0.0, 0.0
    components, d = len(surface.components), surface.dimensions
    cells = math.prod(surface.shape)
    regular = on_lattice(planes, surface)
    longest = LONGEST[d] ** d * sum(len(a.channels) for a in planes) if regular else 0
    for a in planes:
        channels, taxels = len(a.channels), math.prod(a.shape)
        rows += channels * taxels
        layout = commensurate(a, surface)
        if layout is None:
            prepared = max(prepared, near_memory(a, surface))
            kept += near_memory(a, surface) / 2
            continue
        lags = math.prod(n + m * r for n, m, r in zip(surface.shape, a.shape, layout[0]))
        held = (10 + 8 * channels) if isinstance(pad, HalfSpace) else (60 + 80 * channels)
        prepared = max(prepared, 8.0 * held * lags)
        kept += 8.0 * channels * components * 4 * lags
        if regular:
            symbol = 2**d * taxels * math.prod(layout[0]) * 2 * channels * (sought + 2 * channels)
            prepared = max(prepared, 8.0 * symbol)
            kept += 8.0 * 2**d * taxels * 2 * channels**2
    work = 14 * max(rows, TOGETHER) + AT_A_TIME + 10 * components * cells
    return kept + max(prepared, 8.0 * (longest * rows + work))


def check_system(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> None:
    """Raise an error if the system does not fit into memory."""
    readings = sum(int(a.valid.sum()) * len(a.channels) for a in planes)
    peak, free = system_memory(pad, planes, surface, sought), available()
    step = 2 if free is None else max(2, math.ceil((peak / max(0.5 * free, 1.0)) ** (1 / surface.dimensions)))
    slices = ", ".join([f"::{step}"] * surface.dimensions)
    remedy = (
        f"Describe the array in parts that overlap by a few depths, or take every {step}{ORDINAL.get(step, 'th')} taxel (readings[..., {slices}], "
        f"a pitch {step} times as large)."
    )
    if any(isinstance(a, ScatteredArray) for a in planes):
        remedy = "Give a coarser surface, or grid the recording (Recording.gridded, palpate convert --grid)."
    require(peak, f"{readings} readings on a surface of {' x '.join(map(str, surface.shape))} cells", remedy)
