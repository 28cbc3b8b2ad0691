"""Influence of one uniformly loaded surface cell on a sensing element: the kernel of the non-periodic operator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats, Pad, offered
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.layered import Correction, Surface
from palpate.sensing.maps import body_of
from palpate.sensing.quadrature import as_stack

__all__ = ["aperture_rule", "influence"]


def aperture_rule(width: float, depth: float, spacing: float, offset: float | None) -> tuple[Floats, Floats]:
    """Nodes [m] and weights (sum 1) that average over an aperture of ``width``.

    At depths comparable with the width the field is smooth, and a few Gauss-Legendre nodes suffice. Near the surface
    it has kinks above the cell edges, so the aperture is cut there. ``offset`` is taxel minus cell centre; None if it
    differs between taxels: the aperture is then cut into narrow panels instead.
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
    if body_of(pad) is not None:
        raise Unsupported(
            f"a {type(pad).__name__} differs from place to place, and this method needs a pad that is the same everywhere. Use "
            'method="tikhonov", or leave method out.'
        )
    if concentrated and depth == 0.0:
        raise Unsupported(
            "a concentrated load has no finite response at depth 0, so methods that sample the kernel at points "
            '(method="dft" and "linear") need depth > 0. Use method="tikhonov".'
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        if offered(pad, "influence"):
            kernel = _closed_form(pad, offsets, spacings, depth, channels, rules, concentrated)
        elif offered(pad, "surface", "surface_thickness"):
            layers: Any = pad
            correction = Correction(pad, layers.surface, layers.surface_thickness, depth, channels)
            kernel = _layered(correction, offsets, spacings, depth, channels, rules, concentrated)
        else:
            kernel = _any_pad(pad, offsets, spacings, depth, channels, rules, concentrated)
    if not np.isfinite(kernel).all():
        raise InvalidInput(
            f"the response of {', '.join(channels)} at depth {depth:g} m is infinite at the edge of a surface cell, and "
            "a taxel sits on one. Give the taxels an aperture, a small depth, or a surface whose cells are centred on them."
        )
    return kernel


def _any_pad(
    pad: Pad,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    concentrated: bool,
) -> Floats:
    """Influence computed only from the pad's states."""
    reach = max(float(np.abs(o).max()) for o in offsets) + max(spacings)
    stack = as_stack(pad, reach, depth)
    surface = stack.surface
    if math.isinf(stack.surface_thickness):
        return _closed_form(surface, offsets, spacings, depth, channels, rules, concentrated)
    correction = Correction(
        pad, surface, stack.surface_thickness, depth, channels, orders=surface.orders, decay=min(1.0, surface.roots[0])
    )
    return _layered(correction, offsets, spacings, depth, channels, rules, concentrated)


def _closed_form(
    pad: Any,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    concentrated: bool,
    damping: float = 0.0,
) -> Floats:
    """The pad's own influence, averaged over the aperture."""
    body: Surface = pad
    total: Any = 0.0
    for points in itertools.product(*(zip(*rule) for rule in rules)):
        moved = [offset + node for offset, (node, _) in zip(offsets, points)]
        part = body.influence(moved, spacings, depth, channels, concentrated=concentrated, damping=damping)
        total = total + math.prod(weight for _, weight in points) * part
    return np.asarray(total)


def _layered(
    correction: Correction,
    offsets: Sequence[Floats],
    spacings: Sequence[float],
    depth: float,
    channels: Sequence[str],
    rules: Sequence[tuple[Floats, Floats]],
    concentrated: bool,
) -> Floats:
    if len(offsets) == 1:
        out = np.zeros((len(channels), 2, *offsets[0].shape))
        for node, weight in zip(*rules[0]):
            # A concentrated load is a cell of vanishing width with the force of a whole one.
            width = 1e-9 * spacings[0] if concentrated else spacings[0]
            out += weight * spacings[0] / width * correction.line(offsets[0] + node, width, 0.0)
    else:
        out = correction.area(offsets, spacings, rules, concentrated=concentrated)
    if correction.half_space is not None:
        for sign, damping in ((1.0, 0.0), (-1.0, correction.damping)):
            out += sign * _closed_form(
                correction.half_space, offsets, spacings, depth, channels, rules, concentrated, damping
            )
    return out
