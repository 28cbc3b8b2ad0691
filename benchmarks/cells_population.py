"""Cells whose truth is known by closed forms: a model of its own, which shares no code with the inversion.

Adhesions are ellipses of 0.4 to 3 um, even or parabolic, drawn on squares of 0.1 um. A square under even shear moves the surface of a half-space by
Cerruti's solution, integrated in closed form (K. L. Johnson, Contact Mechanics, 1985, section 3.6); sums over squares are made by a zero-padded FFT, which adds
nothing of its own. Windows are means over whole squares.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.ndimage

__all__ = ["SQUARE", "Cell", "cell_of", "displacement_of", "influence"]

#: Side of a square [m], and of a pixel of the picture.
SQUARE = 0.1e-6


def influence(rows: int, columns: int, modulus: float, ratio: float, side: float = SQUARE) -> np.ndarray:
    """Displacement (component, traction, 2 rows - 1, 2 columns - 1) of the surface per unit shear of a square, by its offset.

    u_i = (1 + nu)/(pi E) int [(1 - nu) delta_ij/r + nu x_i x_j/r^3] q_j dA.
    """
    x = side * (np.arange(-(columns - 1), columns + 1) - 0.5)[None, :]
    y = side * (np.arange(-(rows - 1), rows + 1) - 0.5)[:, None]

    def between(f: np.ndarray) -> np.ndarray:
        return f[1:, 1:] - f[1:, :-1] - f[:-1, 1:] + f[:-1, :-1]

    xx = between(y * np.arcsinh(x / np.abs(y)))  # of x^2/r^3
    yy = between(x * np.arcsinh(y / np.abs(x)))  # of y^2/r^3
    xy = between(-np.hypot(x, y))  # of x y/r^3
    even = (1.0 - ratio) * (xx + yy)  # of (1 - nu)/r
    return (
        (1.0 + ratio)
        / (math.pi * modulus)
        * np.array([[even + ratio * xx, ratio * xy], [ratio * xy, even + ratio * yy]])
    )


def displacement_of(traction: np.ndarray, modulus: float, ratio: float, side: float = SQUARE) -> np.ndarray:
    """Displacement (2, row, column) at the middle of each square of a traction (2, row, column)."""
    _, rows, columns = traction.shape
    kernel = influence(rows, columns, modulus, ratio, side)
    size = [scipy.fft.next_fast_len(3 * n - 2, real=True) for n in (rows, columns)]
    spectrum = scipy.fft.rfft2(kernel, size)
    product = np.einsum("ijyx,jyx->iyx", spectrum, scipy.fft.rfft2(traction, size))
    return scipy.fft.irfft2(product, size)[:, rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1]


@dataclass
class Cell:
    """One cell, what was seen of it, and its truth."""

    seed: int
    displacement: np.ndarray  # (2, row, column) [m], NaN where there is none
    step: int  # squares between vectors
    start: tuple[float, float]  # pixel (column, row) of the first vector
    window: int  # squares; 0: points
    modulus: float
    ratio: float
    noise: float  # of the largest displacement
    outliers: np.ndarray  # (row, column)
    gaps: bool
    edge: bool
    mask: np.ndarray  # (row, column) of squares: the cell, in view
    labels: np.ndarray  # (row, column) of squares: an outline about each adhesion
    truth: dict[str, float]
    forces: dict[int, tuple[float, float]]  # of each label [N]


def cell_of(
    seed: int, *, noise: float | None = None, outliers: bool | None = None, edge: bool | None = None, step: int | None = None, count: int | None = None, window: int | None = None, margin: float | None = None, aspect: tuple[float, float] = (1.0, 4.0),
) -> Cell:  # fmt: skip
    """One cell of the population; what is said is not drawn, and everything else stays as it is. Length over width of adhesions is between the two of ``aspect``."""
    rng = np.random.default_rng([4300, seed])
    largest = float(np.exp(rng.uniform(math.log(0.08e-6), math.log(0.6e-6))))
    ratio = float(rng.uniform(0.3, 0.5))
    radius = rng.uniform(7e-6, 13e-6)
    wide = float(rng.uniform(1.5, 2.2))
    drawn_step = int(rng.choice([5, 6, 8, 10, 12, 16]))
    drawn_window = int(rng.choice([0, 1, 2])) * drawn_step
    drawn_noise = float(np.exp(rng.uniform(math.log(0.02), math.log(0.2))))
    drawn_outliers, gaps, drawn_edge = rng.random(3) < (0.33, 0.33, 0.2)
    step = drawn_step if step is None else step
    window = drawn_window if window is None else window
    noise = drawn_noise if noise is None else noise
    outliers = bool(drawn_outliers) if outliers is None else outliers
    edge = bool(drawn_edge) if edge is None else edge
    wide = wide if margin is None else margin
    n = int(np.clip(2 * radius * wide / (step * SQUARE), 20, 64)) if count is None else count
    squares = n * step
    traction, outlines, mask = _adhesions(rng, squares, radius, edge, aspect)
    u = displacement_of(traction, 1e3, ratio)
    # as stiff as makes displacements those of experiments
    modulus = 1e3 * float(np.hypot(*u).max()) / largest
    u *= 1e3 / modulus
    seen = u
    if window:  # before the picture is cut out: no window of a correlation sees beyond it, nor repeats its last row
        seen = scipy.ndimage.uniform_filter(u, (0, window, window), mode="nearest")
        if window % 2 == 0:  # scipy's even windows lie half a square off: put their middle between two squares
            seen = 0.5 * (seen + np.roll(seen, (-1, -1), (1, 2)))
    # the picture: what lies in view. A cell at the edge was drawn on a field twice as wide
    first = (traction.shape[1] - squares) // 2
    view = slice(first, first + squares)
    t, u, seen = traction[:, view, view], u[:, view, view], seen[:, view, view]
    mask, outlines = mask[view, view], outlines[view, view]
    at = step // 2 + step * np.arange(n)
    values = seen[:, at[:, None], at[None, :]]
    top = float(np.hypot(*values).max())
    values = values + noise * top * rng.standard_normal(values.shape)
    bad = np.zeros((n, n), dtype=bool)
    if outliers:
        bad = rng.random((n, n)) < 0.03
        values[:, bad] = top * rng.uniform(-3.0, 3.0, (2, int(bad.sum())))
    values = values + SQUARE * rng.uniform(-1.0, 1.0, (2, 1, 1))
    if gaps:
        values[:, rng.random((n, n)) < 0.04] = np.nan
        r, c = rng.integers(0, n - 3, 2)
        values[:, r : r + 3, c : c + 3] = np.nan
    truth, forces = _truth(t, u, mask, outlines, n, step)
    truth["noise"] = noise * top
    return Cell(
        seed, values, step, (float(at[0]), float(at[0])), window, modulus, ratio, noise, bad, bool(gaps), edge, mask, outlines, truth, forces,
    )  # fmt: skip


def _adhesions(
    rng: np.random.Generator, squares: int, radius: float, edge: bool, aspect: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Traction (2, row, column), outlines and the cell's mask, on a field that is wider than the view where the cell is at its edge."""
    whole = 2 * squares if edge else squares
    axis = SQUARE * (np.arange(whole) - 0.5 * (whole - 1))
    x, y = axis[None, :], axis[:, None]
    half = 0.5 * squares * SQUARE
    radius = min(radius, 0.42 * squares * SQUARE)
    stretch = float(rng.uniform(1.0, 1.6))
    turn = float(rng.uniform(0, np.pi))
    a, b = radius, radius / stretch
    middle = np.zeros(2)
    if edge:
        middle[int(rng.integers(2))] = rng.choice([-1, 1]) * (half - 0.4 * radius)

    def turned(px: np.ndarray, py: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
        return px * np.cos(angle) + py * np.sin(angle), -px * np.sin(angle) + py * np.cos(angle)

    u, v = turned(x - middle[0], y - middle[1], turn)
    mask = (u / (a + 0.6e-6)) ** 2 + (v / (b + 0.6e-6)) ** 2 < 1
    out, outlines = np.zeros((2, whole, whole)), np.zeros((whole, whole), dtype=bool)
    on_any = np.zeros((whole, whole), dtype=bool)
    for _ in range(int(rng.integers(8, 21))):
        angle, far = (
            rng.uniform(0, 2 * np.pi),
            rng.uniform(0.55, 0.95) if rng.random() < 0.75 else rng.uniform(0.1, 0.6),
        )
        pu, pv = a * far * np.cos(angle), b * far * np.sin(angle)
        px, py = turned(np.asarray(pu), np.asarray(pv), -turn)
        px, py = px + middle[0], py + middle[1]
        pull = np.arctan2(middle[1] - py, middle[0] - px) + np.radians(20) * rng.standard_normal()
        length = rng.uniform(0.4e-6, 3.0e-6)
        width = max(length / rng.uniform(*aspect), 0.3e-6)
        long, across = turned(x - px, y - py, pull)
        inside = (2 * long / length) ** 2 + (2 * across / width) ** 2
        profile = (inside < 1).astype(float) if rng.random() < 0.5 else np.sqrt(np.clip(1 - inside, 0, None))
        size = float(np.exp(rng.normal(math.log(600.0), 0.6)))
        out[0] += size * np.cos(pull) * profile
        out[1] += size * np.sin(pull) * profile
        on_any |= inside < 1
        outlines |= (long**2 / (0.5 * length + 0.8e-6) ** 2 + across**2 / (0.5 * width + 0.8e-6) ** 2) < 1
    for c in (0, 1):  # a cell pulls itself along nothing
        out[c][on_any] -= out[c].sum() / on_any.sum()
    labels, _ = scipy.ndimage.label(outlines)
    return out, labels, mask


def _truth(
    t: np.ndarray, u: np.ndarray, mask: np.ndarray, labels: np.ndarray, n: int, step: int
) -> tuple[dict[str, float], dict[int, tuple[float, float]]]:
    """The numbers of the cell as far as it is in view."""
    area = SQUARE**2
    axis = SQUARE * np.arange(len(mask))
    x, y = np.meshgrid(axis, axis)
    u = u - u.mean(axis=(1, 2), keepdims=True)
    tx, ty = t[0] * mask, t[1] * mask
    middle = x[mask].mean(), y[mask].mean()
    x, y = x - middle[0], y - middle[1]
    blocks = t.reshape(2, n, step, n, step).mean(axis=(2, 4))
    # the point nearest to the lines of force, weighted by the squares of the forces
    # by means over vectors' squares, which is how the field knows them
    bx, by = (tx.reshape(n, step, n, step).mean(axis=(1, 3)), ty.reshape(n, step, n, step).mean(axis=(1, 3)))
    gx, gy = (a.reshape(n, step, n, step).mean(axis=(1, 3)) for a in (x, y))
    lever = bx * gy - by * gx
    matrix = np.array([[(by**2).sum(), -(bx * by).sum()], [-(bx * by).sum(), (bx**2).sum()]])
    center = np.linalg.solve(matrix, np.array([-(by * lever).sum(), (bx * lever).sum()]))
    if not (x[mask].min() <= center[0] <= x[mask].max() and y[mask].min() <= center[1] <= y[mask].max()):
        center = np.zeros(2)
    far = np.hypot(x - center[0], y - center[1]) + 1e-30
    truth = {
        "strain_energy": 0.5 * float((tx * u[0] + ty * u[1]).sum()) * area,
        "contractile_moment": -float((tx * x + ty * y).sum()) * area,
        "contractility": -float(((tx * (x - center[0]) + ty * (y - center[1])) / far).sum()) * area,
        "force_inside": float(np.hypot(tx, ty).sum()) * area,
        "traction_peak": float(np.hypot(*blocks).max()),
        "net_force_x": float(tx.sum()) * area,
        "net_force_y": float(ty.sum()) * area,
        "torque": float((x * ty - y * tx).sum()) * area,
    }
    forces = {
        int(i): (float(t[0][labels == i].sum()) * area, float(t[1][labels == i].sum()) * area)
        for i in np.unique(labels)
        if i
    }
    return truth, forces
