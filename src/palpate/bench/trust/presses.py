"""Random loads on the random sensors: balls, punches, cylinders and more, one or several, at rest, sliding, sticking
or twisting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.bench.trust.sensors import Sensor
from palpate.elastic.pad import Floats
from palpate.sensing.grids import Grid

__all__ = ["Load", "cell_means", "plain_ball", "random_load"]


@dataclass(frozen=True)
class Load:
    """Traction (component, *grid) [Pa], constant in each cell of a fine ``grid``."""

    grid: Grid
    traction: Floats
    words: str

    @property
    def force(self) -> Floats:
        """Net force (component,) [N], in line contact [N/m]."""
        d = self.grid.dimensions
        return np.asarray(self.traction.sum(axis=tuple(range(-d, 0))) * self.grid.cell)

    @property
    def size(self) -> float:
        """Integral of the magnitude of the traction: the force of a plain push, more than it where pulls are beside."""
        return float(np.sqrt((self.traction**2).sum(axis=0)).sum() * self.grid.cell)

    def times(self, factor: float) -> Load:
        """Return the same load, ``factor`` times as strong."""
        return replace(self, traction=self.traction * factor)


def cell_means(load: Load, grid: Grid) -> Floats:
    """Return the exact mean traction (component, *grid) in each cell of another ``grid``."""
    out = load.traction
    for axis, (fine, coarse) in enumerate(zip(load.grid.axes, grid.axes)):
        a, b = load.grid.spacings[axis], grid.spacings[axis]
        low = np.maximum(coarse[:, None] - b / 2, fine[None, :] - a / 2)
        high = np.minimum(coarse[:, None] + b / 2, fine[None, :] + a / 2)
        share = np.clip(high - low, 0.0, None) / b
        out = np.moveaxis(np.tensordot(share, out, axes=(1, axis + 1)), 0, axis + 1)
    return out


@dataclass(frozen=True)
class _Patch:
    kind: str
    center: Floats
    size: Floats
    peak: float
    angle: float

    def pressure(self, points: Floats) -> Floats:
        """Return the pressure at points (axis, ...), with a peak of about 1."""
        away = points - self.center.reshape(-1, *(1,) * (points.ndim - 1))
        if len(away) == 1:
            u, v = away[0] / self.size[0], np.zeros_like(away[0])
            if self.angle > math.pi:
                u = -u
        else:
            c, s = math.cos(self.angle), math.sin(self.angle)
            u, v = (c * away[0] + s * away[1]) / self.size[0], (-s * away[0] + c * away[1]) / self.size[1]
        r2 = u**2 + v**2
        if self.kind == "ball":
            return self.peak * np.sqrt(np.clip(1 - r2, 0, None))
        if self.kind == "punch":
            return self.peak * np.where(r2 < 1, 0.4 / np.sqrt(np.clip(1 - r2, 0.04, None)), 0.0)
        if self.kind == "cylinder":  # in area contact a cylinder lies on its side
            return self.peak * np.where(np.abs(v) < 1, np.sqrt(np.clip(1 - u**2, 0, None)), 0.0)
        if self.kind == "block":
            return self.peak * np.where((np.abs(u) < 1) & (np.abs(v) < 1), 0.8, 0.0)
        if self.kind == "tilted":
            return self.peak * np.where((np.abs(u) < 1) & (np.abs(v) < 1), 0.55 + 0.45 * u, 0.0)
        return self.peak * np.clip(1 - np.sqrt(r2), 0, None)  # cone

    def rim(self, points: Floats) -> Floats:
        """Return 1 on a ring around the patch, 0 elsewhere."""
        away = points - self.center.reshape(-1, *(1,) * (points.ndim - 1))
        r = np.sqrt(((away / self.size.reshape(-1, *(1,) * (points.ndim - 1))) ** 2).sum(axis=0))
        return np.where((r > 1.0) & (r < 1.35), 1.0, 0.0)


INDENTERS = ("ball", "ball", "ball", "punch", "cylinder", "block", "cone", "tilted")


def random_load(
    rng: np.random.Generator,
    sensor: Sensor,
    *,
    friction: float,
    axes: str,
    adhesion: float = 0.0,
    small: bool = False,
) -> Load:
    """Return one or several contacts with a peak pressure of 1 to 15 % of the modulus.

    ``friction`` limits the shear along the ``axes`` ("", "x", "y" or "xy"). ``adhesion`` is the pull of a rim around
    each contact, as a fraction of the peak. One in ten loads crosses the edge of the array, with at most half of a
    contact outside. With ``small``, contacts have a radius of 0.1 to 0.7 pitches.
    """
    d = len(sensor.shape)
    half = 0.5 * sensor.pitch * np.array(sensor.shape[::-1], dtype=np.float64)  # x, then y
    smallest = 0.7 * sensor.pitch
    largest = max(1.2 * smallest, 0.7 * float(half.min()))
    if small:
        smallest, largest = 0.1 * sensor.pitch, 0.7 * sensor.pitch
    across = rng.random() < 0.1
    count = 1 if across or sensor.kind == "tiny" or adhesion > 0 else int(rng.choice([1, 2, 3], p=[0.75, 0.17, 0.08]))
    parts: list[_Patch] = []
    for _ in range(count):
        kind = str(rng.choice(INDENTERS))
        size = np.exp(rng.uniform(math.log(smallest), math.log(largest / count**0.5 + 0.1 * smallest), size=d))
        if kind in ("ball", "cone"):
            size[:] = size[0]
        center = rng.uniform(-1, 1, size=d) * np.clip(half - size, 0.15 * half, None)
        if across:
            axis = int(rng.integers(d))
            center[axis] = float(rng.choice([-1, 1])) * (half[axis] - float(rng.uniform(0.0, 0.8)) * size[axis])
        peak = 1.0 if not parts else float(rng.uniform(0.3, 1.0))
        parts.append(_Patch(kind, center, size, peak, float(rng.uniform(0, 2 * math.pi))))
    how = "rests"
    if axes and friction > 0:
        ways = ["rests", "slides", "slides", "sticks"] + (["twists"] if axes == "xy" else [])
        how = str(rng.choice(ways))
    direction = float(rng.uniform(0, 2 * math.pi))
    share = float(rng.choice([1.0, 0.6]))
    grid, points = _around(sensor, parts, 1.45 if adhesion > 0 else 1.05)
    p = sum((part.pressure(points) for part in parts), np.zeros(points.shape[1:]))
    traction = np.zeros((d + 1, *points.shape[1:]))
    traction[-1] = p - adhesion * sum((part.peak * part.rim(points) for part in parts), np.zeros_like(p))
    reach = float(parts[0].size.max())
    away = [a - c for a, c in zip(points, parts[0].center)]
    r = np.sqrt(sum((a**2 for a in away), np.zeros_like(p))) / reach
    limit = friction * p
    heading = {"x": (math.copysign(1.0, math.cos(direction)), 0.0), "y": (0.0, math.copysign(1.0, math.sin(direction)))}
    c, s = heading.get(axes, (math.cos(direction), math.sin(direction)))
    if d == 1:
        c, s = math.copysign(1.0, c), 0.0
    if how in ("slides", "sticks"):
        grown = share * limit * (1.0 if how == "slides" else np.clip(r, 0.1, 1.0))
        traction[0] = c * grown
        if d == 2:
            traction[1] = s * grown
    elif how == "twists":
        traction[0] = -share * limit * away[1] / reach / np.maximum(r, 1.0)
        traction[1] = share * limit * away[0] / reach / np.maximum(r, 1.0)
    # average over 3 x 3 points of each fine cell; from here on these cells are the truth
    traction = traction.reshape(d + 1, *(k for n in grid.shape for k in (n, 3))).mean(
        axis=tuple(range(2, 2 + 2 * d, 2))
    )
    pressure = sensor.modulus * float(np.exp(rng.uniform(math.log(0.01), math.log(0.15))))
    words = " and ".join(part.kind for part in parts)
    words += (", across the edge" if across else "") + (f", {how}" if how != "rests" else "")
    words += ", pulling at its rim" if adhesion > 0 else ""
    return Load(grid, traction * pressure / float(traction[-1].max()), words)


def plain_ball(sensor: Sensor, pressure: float) -> Load:
    """Return a ball that presses on the middle of the array."""
    half = 0.5 * sensor.pitch * np.array(sensor.shape[::-1], dtype=np.float64)
    size = np.full(len(half), max(1.2 * sensor.pitch, 0.35 * float(half.min())))
    ball = _Patch("ball", np.full(len(half), 0.1 * sensor.pitch), size, 1.0, 0.0)
    grid, points = _around(sensor, [ball], 1.05)
    d = len(half)
    p = ball.pressure(points).reshape(*(k for n in grid.shape for k in (n, 3))).mean(axis=tuple(range(1, 2 * d, 2)))
    traction = np.zeros((d + 1, *grid.shape))
    traction[-1] = pressure * p / float(p.max())
    return Load(grid, traction, "ball in the middle")


def _around(sensor: Sensor, parts: list[_Patch], wider: float) -> tuple[Grid, Floats]:
    """Fine grid around the patches, and the points (axis, *3 points a cell) in it, with axes in the order x, y."""
    # a patch may be rotated: its corners reach further
    reach = [wider * (part.size if len(part.size) == 1 else np.full(2, float(np.hypot(*part.size)))) for part in parts]
    low = np.min([part.center - r for part, r in zip(parts, reach)], axis=0)
    high = np.max([part.center + r for part, r in zip(parts, reach)], axis=0)
    finer = 20 if len(low) == 1 else 8 if sensor.depth < sensor.pitch else 5
    grid = sensor.fine_grid(low, high, finer)
    axes = [(a[:, None] + b * np.array([-1, 0, 1]) / 3).ravel() for a, b in zip(grid.axes, grid.spacings)]
    return grid, np.stack(np.meshgrid(*axes, indexing="ij")[::-1])
