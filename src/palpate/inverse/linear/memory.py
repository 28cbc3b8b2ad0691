"""Estimate the memory of a spectral decomposition before it starts. Errors name what would fit: another method, periodic
ends, a coarser grid or fewer taxels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate._memory import SHARE, SMALL, available, gigabytes, require
from palpate.elastic.pad import Pad
from palpate.errors import Unsupported
from palpate.inverse.linear.matrix_free.memory import ORDINAL, on_lattice, servable, system_memory
from palpate.inverse.linear.spectrum import LARGEST_BLOCK, LARGEST_MODES, LARGEST_SVD, MODES_AT_A_TIME, in_blocks
from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.operator import LARGEST_MATRIX
from palpate.sensing.surface import WIDE, surface_of

__all__ = ["block_size", "check_spectrum", "check_waves", "spectrum_fits", "spectrum_memory"]

#: Recommend only alternatives that take at most this fraction of the free memory, so that they still fit a little
#: later.
RECOMMENDED = 0.5
#: Coarser layouts to try for a recommendation: pitches that grow by a tenth up to a factor of 1.1^200 (more than any
#: recording spans), and every second to hundredth taxel.
COARSER, PITCHES, THINNEST = 1.1, 200, 100


def block_size(pad: Pad, planes: Sequence[Array], surface: Grid) -> int:
    """Readings in the largest symmetry block."""
    if in_blocks(pad, planes, surface):
        return sum(len(a.channels) * math.prod((n + 1) // 2 for n in a.shape) for a in planes)
    return sum(int(a.valid.sum()) * len(a.channels) for a in planes)


def spectrum_memory(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> float:
    """Peak memory in bytes while the decomposition for ``sought`` components is prepared (`DataSpectrum`).

    The matrix of each plane is built from one cell's influence and copied once into order: twice its size. In blocks,
    all planes stay while a quarter of them (half on a line) is weighted; otherwise the components sought are whitened,
    weighted and joined, and an SVD needs two more. The eigenproblem of n readings holds five matrices of n^2.
    """
    cells, components = math.prod(surface.shape), len(surface.components)
    count = sum(math.prod(a.shape) * len(a.channels) for a in planes)
    largest = max(math.prod(a.shape) * len(a.channels) for a in planes)
    n = block_size(pad, planes, surface)
    row = 8.0 * cells * components
    part = sought / components
    if in_blocks(pad, planes, surface):
        blocks = 2**surface.dimensions
        matrices = row * count + max(row * largest, row * count * (2.0 * part + 1.0) / blocks)
        kept = 8.0 * n * n * blocks
    else:
        matrices = row * count * max(2.0, 1.0 + part, (5.0 if n <= LARGEST_SVD else 3.0) * part)
        kept = 8.0 * n * n
    total = matrices + 5.0 * 8.0 * n * n + kept
    modes = 0.0
    if count * sought * cells <= LARGEST_MODES:
        modes = kept + 16.0 * count * sought * cells + 8.0 * part * row * min(count, MODES_AT_A_TIME)
    return max(total, modes)


def spectrum_fits(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int, share: float = SHARE) -> bool:
    """Whether the dense decomposition fits into a ``share`` of the free memory."""
    peak, free = spectrum_memory(pad, planes, surface, sought), available()
    return free is None or peak <= share * free or peak < SMALL


def check_spectrum(pad: Pad, planes: Sequence[Array], surface: Grid, sought: int) -> None:
    """Raise an error for a problem too large for the dense decomposition, and name an alternative for the same taxels."""
    size, peak, free = block_size(pad, planes, surface), spectrum_memory(pad, planes, surface, sought), available()
    if size <= LARGEST_BLOCK and spectrum_fits(pad, planes, surface, sought):
        return
    where = " x ".join(map(str, surface.shape))
    readings = sum(int(a.valid.sum()) * len(a.channels) for a in planes)
    need = f"{readings} readings on a surface of {where} cells need about {gigabytes(peak)} of memory"
    if free is not None:
        need += f" ({gigabytes(free)} are free)"
    if size > LARGEST_BLOCK:
        need += f" and an eigenproblem of {size} readings (limit {LARGEST_BLOCK})"
    remedy = _remedy(pad, planes, sought)
    # Tikhonov's method also gets here if the map of scattered readings is a matrix.
    iterated = servable(planes) and (on_lattice(planes, surface) or size > LARGEST_MATRIX)
    if iterated and (free is None or system_memory(pad, planes, surface, sought) <= SHARE * free):
        remedy = f'method="tikhonov" serves it. Or: {remedy}'
    raise Unsupported(f"{need}. {remedy}")


def check_waves(planes: Sequence[Array], surface: Grid) -> None:
    """Raise an error if a periodic surface has more wavevectors than fit into memory."""
    waves = math.prod(surface.shape) // surface.shape[-1] * (surface.shape[-1] // 2 + 1)
    rows = sum(len(a.channels) for a in planes)
    # Complex matrices of all wavevectors, their whitened copy, and the factors of the decomposition.
    require(
        16.0 * waves * (4.0 * rows * len(surface.components) + 2.0 * rows * rows + 4.0 * rows),
        f"{waves} wavevectors of {rows} channels",
        "Cut the readings into parts that overlap by a few depths.",
    )


def _served(pad: Pad, planes: Sequence[Array], sought: int) -> bool:
    surface = surface_of(pad, planes, depths=WIDE)
    return block_size(pad, planes, surface) <= LARGEST_BLOCK and spectrum_fits(
        pad, planes, surface, sought, RECOMMENDED
    )


def _remedy(pad: Pad, planes: Sequence[Array], sought: int) -> str:
    """The nearest problem that fits, checked by the same estimates."""
    first = planes[0]
    if isinstance(first, ScatteredArray):
        extent = np.ptp(first.points, axis=0)
        wide = extent[extent > 0]
        pitch = float((np.prod(wide) / len(first.points)) ** (1.0 / len(wide)))
        for _ in range(PITCHES):
            pitch = float(f"{COARSER * pitch:.2g}")
            counts = np.maximum(2, np.floor(extent / pitch + 1e-9).astype(int))
            channels = first.channels
            if first.dimensions == 2:
                thin: list[Array] = [
                    AreaArray(shape=(counts[1], counts[0]), pitch=pitch, depth=a.depth, channels=channels)
                    for a in planes
                ]
                if _served(pad, thin, sought):
                    return (
                        f'Grid the recording with a pitch of {pitch:g} m or more (Recording.gridded({pitch:g}), palpate convert --grid "{1e3 * pitch:g} mm") '
                        "and describe it as an area plane."
                    )
            else:
                break
        return "Give fewer positions."
    words = []
    if all(a.mask is None and not a.noise_correlation and a.grid == first.grid for a in planes):  # type: ignore[union-attr]
        words.append(
            'Skin(..., boundary="periodic") with method="tikhonov" does (boundary = "periodic" in skin.toml, without a surface)'
        )
    for step in range(2, THINNEST + 1):
        thinner = [_thinned(a, step) for a in planes]
        if _served(pad, thinner, sought):
            slices = ", ".join([f"::{step}"] * first.dimensions)
            words.append(
                f"every {step}{ORDINAL.get(step, 'th')} taxel does (readings[..., {slices}], a pitch {step} times as large)"
            )
            break
    text = " or ".join(words) or "give fewer taxels"
    return f"{text[0].upper()}{text[1:]}."


def _thinned(array: Array, step: int) -> Array:
    """Every ``step``-th taxel of a regular array."""
    counts = [(n + step - 1) // step for n in array.shape]
    if isinstance(array, LineArray):
        return LineArray(count=max(counts[0], 2), pitch=step * array.pitch, depth=array.depth, channels=array.channels)
    pitch = (step * array.grid.spacings[0], step * array.grid.spacings[1])  # type: ignore[union-attr]
    return AreaArray(
        shape=(max(counts[0], 2), max(counts[1], 2)), pitch=pitch, depth=array.depth, channels=array.channels
    )
