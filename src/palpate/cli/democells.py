"""palpate demo cells: write pictures of beads below two cells, a film, outlines, and a PIVlab series, all with known
forces.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import typer

from palpate.elastic.pad import Floats

__all__ = ["FILES", "demo_cells"]

#: Names of the files that the demo writes.
FILES = ("rest.tif", "pulled.tif", "film.tif", "cells.tif", "adhesions.tif", "PIVlab.mat")
#: Size of a pixel [m], side of a picture [px], and side of the squares on which traction is uniform [px].
PIXEL, SIZE, FINE = 1e-7, 384, 4
#: Number of beads per pixel, and their width [px].
DENSITY, WIDTH = 0.02, 1.2
#: Middles of the cells [px] and their radius [px], and the relative strength of their pull in each frame.
CELLS, RADIUS, PULLS = ((120.0, 190.0), (270.0, 200.0)), 62.0, (0.4, 1.0, 0.7)
#: Side of the PIV program's windows [px], their distance [px], and the noise [px].
WINDOW, STEP, NOISE = 24, 12, 0.03


def demo_cells(folder: Path, seed: int, own: Callable[[str], None]) -> Floats:
    """Write the files for two cells that pull at six adhesions each. Return both strain energies [J] by frame."""
    import scipy.io
    import scipy.ndimage

    from palpate._extras import missing
    from palpate.elastic import HalfSpace
    from palpate.sensing import AreaArray, AreaGrid
    from palpate.skin import Skin

    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF pictures", error) from error

    rng = np.random.default_rng(seed + 5)
    count, side = SIZE // FINE, FINE * PIXEL
    grid = AreaGrid(shape=(count, count), spacing=side)
    skin = Skin(
        HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48),
        AreaArray(shape=grid.shape, pitch=side, depth=0.0, channels=["displacement_x", "displacement_y"]),
        surface=grid,
    )
    at = FINE * np.arange(count) + 0.5 * (FINE - 1)
    x, y = np.meshgrid(at, at)
    px, py = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    cells, adhesions = np.zeros((2, SIZE, SIZE), dtype=np.uint8)
    traction = np.zeros((2, 2, count, count))  # of each cell, rows downwards
    for k, (cx, cy) in enumerate(CELLS):
        cells[np.hypot(px - cx, py - cy) < RADIUS + 10] = k + 1
        for number, angle in enumerate(np.radians(60 * np.arange(6) + rng.uniform(0, 60))):
            far, size = RADIUS * rng.uniform(0.75, 0.95), rng.uniform(300.0, 700.0)
            ax, ay = cx + far * np.cos(angle), cy + far * np.sin(angle)
            patch = np.hypot(x - ax, y - ay) < 9
            traction[k, 0][patch], traction[k, 1][patch] = -size * np.cos(angle), -size * np.sin(angle)
            adhesions[np.hypot(px - ax, py - ay) < 14] = 6 * k + number + 1
        on = (traction[k] != 0).any(axis=0)
        traction[k][:, on] -= traction[k][:, on].mean(axis=1, keepdims=True)
    whole = traction.sum(axis=0)
    up = np.concatenate([whole[:, ::-1] * np.array([1.0, -1.0])[:, None, None], np.zeros((1, count, count))])
    moved = np.asarray(skin.sense(up))[:, ::-1] * np.array([1.0, -1.0])[:, None, None]
    energies = np.array([0.5 * float((t * moved).sum()) * side**2 for t in traction])
    places = rng.uniform(-10, SIZE + 10, (round(DENSITY * (SIZE + 20) ** 2), 2))
    light = rng.uniform(0.3, 1.0, len(places))
    steps = [
        scipy.ndimage.map_coordinates(u / PIXEL, (places[:, ::-1].T - at[0]) / FINE, order=3, mode="nearest")
        for u in moved
    ]
    beads = [_picture(places, light, rng)]
    beads += [_picture(places + pull * np.stack(steps, axis=1) + rng.uniform(-2, 2, 2), light, rng) for pull in PULLS]
    micrometres = {"resolution": (1e-6 / PIXEL, 1e-6 / PIXEL), "imagej": True, "metadata": {"unit": "um", "axes": "YX"}}
    film = {**micrometres, "metadata": {"unit": "um", "axes": "TYX"}}
    tifffile.imwrite(folder / "rest.tif", beads[0], **micrometres)
    tifffile.imwrite(folder / "pulled.tif", beads[2], **micrometres)
    tifffile.imwrite(folder / "film.tif", np.stack(beads[1:]), **film)
    tifffile.imwrite(folder / "cells.tif", cells)
    tifffile.imwrite(folder / "adhesions.tif", adhesions)
    scipy.io.savemat(folder / "PIVlab.mat", _series(moved / PIXEL, rng))
    for name in FILES:
        own(name)
    told = np.outer(np.square(PULLS), energies) * 1e15
    typer.echo(
        "Two cells pull at six places each on a gel of 8 kPa; 384 x 384 pixels of 0.1 um. Their strain energies:"
    )
    for number, (pull, (one, two)) in enumerate(zip(PULLS, told)):
        typer.echo(f"  frame {number} of film.tif and PIVlab.mat, {pull:.0%} of the pull: {one:.2f} and {two:.2f} fJ")
    typer.echo("  pulled.tif is frame 1")
    typer.echo(f"pictures        {folder / 'rest.tif'} {folder / 'pulled.tif'} {folder / 'film.tif'}")
    typer.echo(f"labels          {folder / 'cells.tif'} {folder / 'adhesions.tif'}")
    typer.echo(f"PIVlab          {folder / 'PIVlab.mat'}")
    return told * 1e-15


def _picture(places: Floats, light: Floats, rng: np.random.Generator) -> Floats:
    """Render beads at ``places`` (n, 2) [px] with photon noise and camera noise, at 16 bits."""
    reach = 5
    image = np.zeros((SIZE + 4 * reach, SIZE + 4 * reach))
    step = np.arange(-reach, reach + 1)
    inside = ((places > -reach) & (places < SIZE - 1 + reach)).all(axis=1)
    for (x, y), shine in zip(places[inside], light[inside]):
        column, row = round(x), round(y)
        spot = shine * np.exp(-((row + step - y)[:, None] ** 2 + (column + step - x) ** 2) / (2 * WIDTH**2))
        image[row + reach : row + 3 * reach + 1, column + reach : column + 3 * reach + 1] += spot
    photons = rng.poisson(60.0 + 500.0 * image[2 * reach : -2 * reach, 2 * reach : -2 * reach])
    return np.asarray(np.clip(np.rint(4.0 * photons), 0, 65535).astype(np.uint16))


def _series(moved: Floats, rng: np.random.Generator) -> dict[str, object]:
    """Return the displacements that a PIV program would measure in the film, means over windows with noise, in the
    variables of PIVlab's .mat files.
    """
    import scipy.ndimage

    first = 0.5 * (WINDOW - 1)
    at = np.arange(first, SIZE - first, STEP)
    x, y = np.meshgrid(at, at)
    fine = scipy.ndimage.uniform_filter(moved, (0, WINDOW // FINE, WINDOW // FINE), mode="nearest")
    where = (
        np.stack([y, x]) + 0.5 * FINE - 0.5 * (FINE - 1)
    ) / FINE  # a filter of even width is shifted by half a square
    seen = np.stack([scipy.ndimage.map_coordinates(c, where, order=1, mode="nearest") for c in fine])
    held: dict[str, list[object]] = {n: [] for n in ("x", "y", "u_original", "v_original", "typevector_original")}
    for pull in PULLS:
        u, v = pull * seen + NOISE * rng.standard_normal(seen.shape)
        for name, part in zip(held, (x, y, u, v, np.ones_like(x))):
            held[name].append(part)
    out: dict[str, object] = {"units": "[px] respectively [px/frame]"}
    for name, parts in held.items():
        cells = np.empty((len(PULLS), 1), dtype=object)
        for k, part in enumerate(parts):
            cells[k, 0] = part
        out[name] = cells
    return out
