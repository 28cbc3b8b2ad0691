"""Plot the pressure on a curved surface in three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._plot.shown import Shown
from palpate._plot.style import INK, scaled
from palpate.elastic.pad import Floats
from palpate.sensing.arrays import Array

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

__all__ = ["draw_in_space", "draw_taxels"]

#: Cells with less than this fraction of their area on the surface are left out.
PARTLY = 0.25
#: Length of the arrow of the net force, as a fraction of the surface's width. Lines not at right angles to the view
#: look shorter.
ARROW = 0.45
#: Direction of view [degrees]: from outside, below the x-y plane, and beside a load on a side, so that the load is
#: visible.
ELEVATION, AZIMUTH, BESIDE = -35.0, 120.0, 35.0
#: A load is on a side if its normal leans this far from z.
LEANS = 0.2


def draw_in_space(axes: Axes3D, touch: Shown, values: Floats, force: Any, top: float, taxels: Sequence[Array]) -> None:
    """Draw pressure in colour on the surface in space, with z downwards, the net ``force`` [N], and dots above taxels
    where the surface faces the viewer.
    """
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    surface: Any = touch.surface
    edges = [np.append(a - 0.5 * s, a[-1] + 0.5 * s) for a, s in zip(surface.axes, surface.spacings)]
    y, x = np.meshgrid(*edges, indexing="ij")
    corners = surface.chart.frames(x, y).positions
    quads = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=2)
    on = surface.areas > PARTLY * surface.cell
    width, unit = scaled(float(np.ptp(surface.positions.reshape(-1, 3), axis=0).max()), "m")
    low, colours = min(float(np.nanmin(values[2], initial=0.0)), 0.0), colormaps["viridis"]
    if low < -0.02 * top:
        low, colours = -top, colormaps["RdBu_r"]
    else:
        low = 0.0
    shade = colours(np.clip((values[2][on] - low) / (top - low), 0.0, 1.0))
    axes.add_collection3d(
        Poly3DCollection(quads[on] * width, facecolors=shade, edgecolors="0.5", linewidths=0.1, zorder=1)
    )
    places = surface.positions[on] * width
    force = np.asarray(to_numpy(force), dtype=np.float64)
    size = np.sqrt((np.nan_to_num(values) ** 2).sum(axis=0)) * surface.areas
    out = -np.tensordot(size, surface.frames.axes[..., 2, :], 2) / (float(size.sum()) or 1.0)
    azimuth = AZIMUTH if np.hypot(*out[:2]) < LEANS else float(np.degrees(np.arctan2(out[1], out[0]))) + BESIDE
    up, across = np.radians(ELEVATION), np.radians(azimuth)
    view = np.array([np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up)])
    for array in taxels:
        frames = surface.chart.frames(*array.points.T[::-1])
        seen = -frames.axes[:, 2] @ view > 0.0
        axes.scatter(*(frames.positions[seen] * width).T, color="white", s=1.5, depthshade=False, zorder=2)
    if np.isfinite(force).all() and size.any() and np.linalg.norm(force) > 0.0:
        where = np.tensordot(size, surface.positions, 2) / size.sum() * width
        arrow = ARROW * float(np.ptp(places, axis=0).max()) * force / np.linalg.norm(force)
        axes.quiver(*(where - arrow), *arrow, color=INK["shear"], linewidth=1.6, arrow_length_ratio=0.25, zorder=3)
        places = np.concatenate([places, [where - arrow]])
        axes.set_title(f"net force {np.linalg.norm(force):.3g} N, in space", loc="left")
    middle, half = 0.5 * (places.min(axis=0) + places.max(axis=0)), 0.5 * float(np.ptp(places, axis=0).max())
    for name, m in zip("xyz", middle):
        getattr(axes, f"set_{name}lim")(m - half, m + half)
        getattr(axes, f"set_{name}label")(f"{name} [{unit}]", labelpad=-6)
    axes.tick_params(labelsize=6, pad=-3)
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.95)
    # view from outside the pad with z downwards by a roll, which keeps x, y, z right-handed (an inverted axis would not)
    axes.view_init(elev=ELEVATION, azim=azimuth, roll=180.0)


def draw_taxels(axes: Any, taxels: Sequence[Array], width: float) -> None:
    """Draw dots at the taxels, in the coordinates of the surface."""
    for array in taxels:
        y, x = array.points.T
        axes.plot(x * width, y * width, ls="none", marker="o", ms=1.6, mfc="white", mec="0.2", mew=0.4, label="_taxels")
