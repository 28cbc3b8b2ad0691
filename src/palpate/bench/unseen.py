"""A population that was not used for tuning: indenters, arrays and faults that differ from those of `LAYOUTS` and
`palpate.bench.population`.

Indenters: two-lobed, asymmetric, Gaussian, heel (a ramp with a round end), L, cross, triangle, crescent. Arrays: few
coarse and many fine taxels, shallow and deep, half-spaces and bonded layers, stress, strain and displacement. Some
frames have taxels that are missing, stuck or saturated without being marked, channels of different noise, contact
across the edge, adhesion, or no contact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.bench.calibration import CHANNELS
from palpate.bench.contacts import Traction
from palpate.bench.layouts import Layout
from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.pad import Floats, Pad
from palpate.sensing import AreaArray, LineArray
from palpate.sensing.grids import Grid

__all__ = ["CONTACT_KINDS", "Sample", "unseen"]

#: Kinds of contact.
CONTACT_KINDS = ("line", "area", "area with shear")


@dataclass(frozen=True)
class Sample:
    """One frame and its truth."""

    kind: str
    layout: Layout
    readings: Floats
    truth: Floats
    friction: float | None
    empty: bool


def _lines() -> dict[str, Callable[[Floats], Floats]]:
    """Return pressure as a function of position in half-widths."""
    return {
        "two-lobed": lambda u: np.where(np.abs(u) < 1, np.sin(np.pi * u) ** 2 * (1.0 + 0.4 * u), 0.0),
        "lopsided": lambda u: np.where(
            np.abs(u) < 1, np.where(u < 0.6, (1 + u) / 1.6, np.sqrt(np.clip((1 - u) / 0.4, 0, 1))), 0.0
        ),
        "gaussian": lambda u: np.exp(-0.5 * (2.5 * u) ** 2),
        "trapezoid": lambda u: np.clip(3.0 * (1 - np.abs(u)), 0.0, 1.0),
        "stairs": lambda u: np.where(np.abs(u) < 1, np.where(u < 0, 1.0, 0.45), 0.0),
    }


def _areas() -> dict[str, Callable[[Floats, Floats], Floats]]:
    """Return pressure as a function of position in half-widths along the indenter's own axes."""

    def disc(u: Floats, v: Floats) -> Floats:
        return np.clip(1.0 - u**2 - v**2, 0.0, None)

    def square(u: Floats, v: Floats) -> Floats:
        return np.where((np.abs(u) < 1) & (np.abs(v) < 1), 1.0, 0.0)

    return {
        "two-lobed": lambda u, v: disc(2 * (u - 0.5), 1.6 * v) + 0.7 * disc(2 * (u + 0.5), 1.6 * v),
        "lopsided": lambda u, v: np.sqrt(disc(u, v)) * (1.0 + 0.9 * u) / 1.9,
        "gaussian": lambda u, v: np.exp(-3.0 * (u**2 + v**2)),
        "heel": lambda u, v: np.where((u**2 + v**2 < 1) & (u > -0.5), 0.3 + 0.7 * (u + 0.5) / 1.5, 0.0),
        "L": lambda u, v: square(u, v) * np.where((u > 0.0) & (v > -0.2), 0.0, 1.0),
        "cross": lambda u, v: square(u, v) * np.where((np.abs(u) < 0.35) | (np.abs(v) < 0.35), 1.0, 0.0),
        "triangle": lambda u, v: np.where((v > -0.8) & (v < 1 - 1.8 * np.abs(u)), 1.0, 0.0),
        "crescent": lambda u, v: np.where((u**2 + v**2 < 1) & ((u - 0.5) ** 2 + v**2 > 0.6), 1.0, 0.0),
    }


def unseen(rng: np.random.Generator, kind: str) -> Sample:
    """Return a random frame of the population, of one of `CONTACT_KINDS`."""
    line = kind == "line"
    shear = kind == "area with shear" or (line and rng.random() < 0.25)
    sensing = str(rng.choice(["stress", "strain", "displacement"], p=[0.6, 0.2, 0.2]))
    depth = float(np.exp(rng.uniform(math.log(0.4), math.log(2.5 if line else 1.1))))  # in pitches
    if line:
        along = {"stress": "stress_xz", "strain": "strain_xz", "displacement": "displacement_x"}[sensing]
        channels = [along, *CHANNELS[sensing][0]] if shear else CHANNELS[sensing][0]
        shape: tuple[int, ...] = (int(rng.integers(14, 45)),)
    else:
        channels = CHANNELS[sensing][int(shear)]
        low, high = (5, 8) if shear else (6, 10)
        shape = (int(rng.integers(low, high)), int(rng.integers(low, high)))
    mask = rng.random(shape) > rng.uniform(0.03, 0.12) if rng.random() < 0.15 else None
    array: LineArray | AreaArray
    if len(shape) == 1:
        array = LineArray(count=shape[0], pitch=1.0, depth=depth, channels=channels, mask=mask)
    else:
        array = AreaArray(shape=(shape[0], shape[1]), pitch=1.0, depth=depth, channels=channels, mask=mask)
    mu = float(rng.uniform(0.15, 1.0)) if shear else 0.0
    known = mu if shear and rng.random() < 0.7 else None
    adhesive = known is None and rng.random() < 0.07
    components = (("x", "z") if line else ("x", "y", "z")) if shear else ("z",)
    traction = _contact(rng, shape, depth, mu, adhesive=adhesive)
    layout = Layout(kind, _pad(rng, depth), array, {}, components, known)
    readings, truth = layout.make(traction)
    level = np.full(len(channels), float(np.exp(rng.uniform(math.log(5e-4), math.log(6e-2)))))
    if len(channels) > 1 and rng.random() < 0.25:
        level[int(rng.integers(len(channels)))] *= float(rng.uniform(3.0, 10.0))
    largest = float(np.abs(readings).max())
    noise = level.reshape(-1, *(1,) * len(shape)) * rng.standard_normal(readings.shape)
    empty = bool(rng.random() < 0.12)
    if empty:
        readings, truth = np.zeros_like(readings), np.zeros_like(truth)
    readings = readings + largest * noise
    if not empty and rng.random() < 0.2:
        # an unmarked broken taxel: stuck at zero, or far off
        for _ in range(int(rng.integers(1, 3))):
            place = tuple(int(rng.integers(n)) for n in readings.shape)
            readings[place] = float(rng.choice([0.0, 1.3, -0.8])) * largest
    return Sample(kind, layout, readings, truth, known, empty)


def _contact(rng: np.random.Generator, shape: tuple[int, ...], depth: float, mu: float, *, adhesive: bool) -> Traction:
    """One or two indenters, from twice what the depth resolves to a third of the array; one in seven across an edge."""
    half = 0.5 * np.asarray(shape[::-1], dtype=np.float64)  # x, then y
    smallest, largest = max(1.0, 0.8 * depth), max(1.3, 0.8 * depth + 0.3, 0.6 * float(half.min()))
    edge = rng.random() < 0.15
    parts = []
    for _ in range(1 if edge or mu > 0 or min(shape) < 9 else int(rng.choice([1, 1, 2]))):
        size = np.exp(rng.uniform(math.log(smallest), math.log(largest), size=len(half)))
        center = rng.uniform(-1, 1, size=len(half)) * np.clip(half - size - depth, 0.1, None)
        if edge:
            axis = int(rng.integers(len(half)))
            center[axis] = float(rng.choice([-1, 1])) * (half[axis] - float(rng.uniform(-0.3, 0.9)) * size[axis])
        name = str(rng.choice(list(_lines() if len(half) == 1 else _areas())))
        parts.append((name, center, size, float(rng.uniform(0.4, 1.0)), float(rng.uniform(0, 2 * math.pi))))
    how = str(rng.choice(["slide", "stick", "twist", "none"])) if mu > 0 else "none"
    share, direction = float(rng.choice([1.0, 1.0, 0.7])), float(rng.uniform(0, 2 * math.pi))
    rim = float(rng.uniform(0.2, 0.6)) if adhesive else 0.0

    def cells(grid: Grid) -> Floats:
        axes = np.meshgrid(*grid.axes, indexing="ij")[::-1]  # x, then y
        p = np.zeros(grid.shape)
        for name, center, size, peak, angle in parts:
            if len(axes) == 1:
                u = (axes[0] - center[0]) / size[0] * (1 if angle < math.pi else -1)
                p += peak * (_lines()[name](u) - rim * np.where(np.abs(np.abs(u) - 1.15) < 0.15, 1.0, 0.0))
            else:
                c, s = math.cos(angle), math.sin(angle)
                x, y = axes[0] - center[0], axes[1] - center[1]
                u, v = (c * x + s * y) / size[0], (-s * x + c * y) / size[1]
                ring = np.where(np.abs(np.hypot(u, v) - 1.5) < 0.2, 1.0, 0.0)
                p += peak * (_areas()[name](u, v) - rim * ring)
        out = np.zeros((len(grid.components), *grid.shape))
        out[-1] = p
        if how == "none":
            return out
        middle, reach = parts[0][1], float(np.max(parts[0][2]))
        away = [(a - m) / reach for a, m in zip(axes, middle)]
        limit = share * mu * np.clip(p, 0.0, None)
        if len(axes) == 1:
            out[0] = limit * (
                np.sign(math.cos(direction)) * (1.0 if how == "slide" else np.clip(np.abs(away[0]), 0.1, 1))
            )
            return out
        r = np.hypot(*away)
        if how == "twist":
            out[0], out[1] = -limit * away[1] / np.maximum(r, 1.0), limit * away[0] / np.maximum(r, 1.0)
        else:
            sheared = limit if how == "slide" else limit * np.clip(r, 0.1, 1.0)
            out[0], out[1] = math.cos(direction) * sheared, math.sin(direction) * sheared
        return out

    return cells


def _pad(rng: np.random.Generator, depth: float) -> Pad:
    """Return a half-space or, in some frames, a layer on a rigid base or a skin on a softer layer."""
    ratio = float(rng.uniform(0.25, 0.495))
    which = rng.random()
    if which < 0.7:
        return HalfSpace(youngs_modulus=1.0, poissons_ratio=ratio)
    below = depth * float(rng.uniform(0.1, 2.0))
    if which < 0.9:
        return BondedLayers([Layer(thickness=depth + below, youngs_modulus=1.0, poissons_ratio=ratio)])
    top = Layer(thickness=0.6 * depth, youngs_modulus=3.0, poissons_ratio=ratio)
    return BondedLayers([top, Layer(thickness=0.4 * depth + below, youngs_modulus=1.0, poissons_ratio=0.45)])
