"""Influence of one uniformly loaded surface cell on a sensing element: the kernel of the non-periodic operator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from palpate.elastic.half_space import Floats, HalfSpace, Pad
from palpate.elastic.layers import BondedLayers
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.layered import Correction
from palpate.solutions.line import line_fields, potentials
from palpate.solutions.potential import PointTable, Table, area_fields, lattice_table

__all__ = ["aperture_rule", "influence"]


def aperture_rule(width: float, depth: float, spacing: float, offset: float | None) -> tuple[Floats, Floats]:
    """Nodes [m] and weights (sum 1) that average over an aperture of ``width``.

    At depths comparable with the width the field is smooth and a few Gauss-Legendre nodes do; near the surface it has
    kinks above the cell edges, so the aperture is cut there (``offset``: taxel minus cell centre; None if it differs
    from taxel to taxel, when it is cut into narrow panels instead).
    """
    if width <= 1e-9 * spacing:  # a point
        return np.zeros(1), np.ones(1)
    half = width / 2
    if depth >= 0.5 * width:
        cuts, count = np.array([-half, half]), 3 + math.ceil(2.0 * width / depth)
    elif offset is None:
        cuts, count = np.linspace(-half, half, 1 + max(2, math.ceil(2 * width / spacing))), 4
    else:
        first = math.ceil((-half + offset) / spacing - 0.5)
        last = math.floor((half + offset) / spacing - 0.5)
        kinks = (np.arange(first, last + 1) + 0.5) * spacing - offset
        cuts, count = np.unique(np.round(np.concatenate([[-half], kinks, [half]]), 15)), 4
        cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-9 * width])]
    t, w = np.polynomial.legendre.leggauss(count)
    low, high = cuts[:-1, None], cuts[1:, None]
    nodes = (low + high) / 2 + (high - low) / 2 * t
    weights = (high - low) / 2 * w / width
    return nodes.ravel(), weights.ravel()


def influence(
    pad: Pad,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    *,
    concentrated: bool = False,
) -> Floats:
    """Channels per unit traction of one cell, seen from points at uniform offsets from it.

    Parameters
    ----------
    offsets : one array (..., n) per axis, in the order of the array axes
        Point minus cell centre [m]. In area contact the last axes combine to (..., ny, nx).
    spacings : one per axis
        Cell widths [m].
    rules : one (nodes, weights) per axis
        Average over the aperture.
    concentrated : bool
        Treat the cell's traction as a concentrated load at its centre (the founding paper's sampling) instead of
        uniform over the cell.

    Returns
    -------
    array (channel, component, ..., n) or (channel, component, ..., ny, nx)
    """
    if concentrated and depth == 0.0:
        raise Unsupported(
            "a concentrated load has no finite response at depth 0, so methods that sample the kernel at points "
            '(method="dft" and "linear") need depth > 0. Use method="tikhonov".'
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(pad, HalfSpace):
            kernel = _half_space(pad, offsets, spacings, depth, channels, rules, concentrated, 0.0)
        elif isinstance(pad, BondedLayers):
            kernel = _layered(pad, offsets, spacings, depth, channels, rules, concentrated)
        else:
            raise Unsupported(f"no influence is known for a {type(pad).__name__}; use HalfSpace or BondedLayers.")
    if not np.isfinite(kernel).all():
        raise InvalidInput(
            f"the response of {', '.join(channels)} at depth {depth:g} m is infinite at the edge of a surface cell, and "
            "a taxel sits on one. Give the taxels an aperture, a small depth, or a surface whose cells are centred on them."
        )
    return kernel


def _layered(
    pad: BondedLayers,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    concentrated: bool,
) -> Floats:
    correction = Correction(pad, depth, channels)
    if len(offsets) == 1:
        out = np.zeros((len(channels), 2, *offsets[0].shape))
        for node, weight in zip(*rules[0]):
            # a concentrated load is a cell of vanishing width with the force of a whole one
            width = 1e-9 * spacings[0] if concentrated else spacings[0]
            out += weight * spacings[0] / width * correction.line(offsets[0] + node, width, 0.0)
    else:
        out = correction.area(offsets, spacings, rules, concentrated=concentrated)
    if correction.half_space is not None:
        for sign, lower in ((1.0, 0.0), (-1.0, correction.damping)):
            out += sign * _half_space(
                correction.half_space, offsets, spacings, depth, channels, rules, concentrated, lower
            )
    return out


def _half_space(
    pad: HalfSpace,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    concentrated: bool,
    lower: float,
) -> Floats:
    """Closed form; with ``lower`` > 0 the response is damped by exp(-k lower): its potentials lie that much deeper."""
    if len(offsets) == 1:
        return _line(pad, offsets[0], spacings[0], depth, channels, rules[0], concentrated, lower)
    return _area(pad, offsets, spacings, depth, channels, rules, concentrated, lower)


def _line(
    pad: HalfSpace,
    x: Floats,
    spacing: float,
    depth: float,
    channels: Sequence[str],
    rule: tuple[Floats, Floats],
    concentrated: bool,
    lower: float,
) -> Floats:
    out = np.zeros((len(channels), 2, *x.shape))
    for node, weight in zip(*rule):
        zeta = (x + node) + 1j * (depth + lower)
        parts = potentials("load" if concentrated else "strip", spacing / 2, zeta)
        for column, component in enumerate("xz"):
            out[:, column] += weight * spacing * line_fields(*parts, depth, component, pad, channels)
    return out


def _area(
    pad: HalfSpace,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    concentrated: bool,
    lower: float,
) -> Floats:
    y, x = offsets
    dy, dx = spacings
    y_edges, x_edges = _edges(y, dy), _edges(x, dx)
    out = np.zeros((len(channels), 3, *y.shape, x.shape[-1]))
    for (node_y, weight_y), (node_x, weight_x) in itertools.product(zip(*rules[0]), zip(*rules[1])):
        table: Table
        if concentrated:
            table = PointTable((x + node_x)[..., None, :], (y + node_y)[..., :, None], depth + lower)
            scale = weight_y * weight_x * dx * dy
        else:
            table = lattice_table(x_edges + node_x, y_edges + node_y, depth + lower)
            scale = weight_y * weight_x
        for column, component in enumerate("xyz"):
            for row, field in enumerate(area_fields(table, depth, component, pad, channels)):
                out[row, column] += scale * field
    return out


def _edges(centres: Floats, spacing: float) -> Floats:
    step = np.sign(centres[..., 1:2] - centres[..., :1]) * spacing / 2
    return np.concatenate([centres[..., :1] - step, centres + step], axis=-1)
