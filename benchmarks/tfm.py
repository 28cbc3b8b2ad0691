"""Traction force microscopy with known truth: error, background and coverage of methods on synthetic cells.

Cells with focal adhesions of 1 to 3 um, as in Sabass, Gardel, Waterman and Schwarz (Biophys. J. 94, 2008, 207-220): elliptic patches of even
traction towards the cell's middle, in balance. Data are made on cells three times finer than the reconstruction's; displacements have
2 % noise, a drift of the stage, or noise that overlapping windows share.

    python benchmarks/tfm.py                                # table, some minutes
    python benchmarks/tfm.py --cells 20 --markdown tfm.md
    python benchmarks/tfm.py --methods tikhonov automatic   # any methods that take components x and y
"""

from __future__ import annotations

import argparse
import functools
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.ndimage

import palpate as pp
from palpate.sensing.grids import block_means, refined
from palpate.sensing.uncertainty import EXACT

PITCH, COUNT, FINER = 0.6e-6, 40, 3
GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
CHANNELS = ["displacement_x", "displacement_y"]
#: What is wrong with the readings: drift [of the largest displacement], windows that share noise [pitches].
CONDITIONS = {"2 % noise": (0.0, 0.0), "drift of 20 %": (0.2, 0.0), "overlapping windows": (0.0, 1.5)}
NOISE = 0.02


def array(noise: float | None = None) -> pp.AreaArray:
    return pp.AreaArray(shape=(COUNT, COUNT), pitch=PITCH, depth=0.0, channels=CHANNELS, noise=noise)


def cell(grid: pp.AreaGrid, rng: np.random.Generator) -> np.ndarray:
    """Traction (component, *surface) [Pa] of six to twelve adhesions round a cell's rim, in balance."""
    x, y = grid.x[None, :], grid.axes[0][:, None]
    out = np.zeros((3, *grid.shape))
    count = int(rng.integers(6, 13))
    for angle in 2 * np.pi * (np.arange(count) + 0.6 * rng.random(count)) / count:
        radius = float(rng.uniform(5e-6, 8.5e-6))
        u, v = x - radius * np.cos(angle), y - radius * np.sin(angle)
        along = u * np.cos(angle) + v * np.sin(angle)
        across = -u * np.sin(angle) + v * np.cos(angle)
        length, width = rng.uniform(0.5e-6, 1.5e-6), rng.uniform(0.5e-6, 0.8e-6)
        patch = (along / length) ** 2 + (across / width) ** 2 < 1
        size = float(rng.uniform(200.0, 1000.0))
        out[0] -= size * np.cos(angle) * patch
        out[1] -= size * np.sin(angle) * patch
    on = (out[:2] != 0).any(axis=0)
    for c in (0, 1):  # a cell pulls itself along nothing
        out[c][on] -= out[c].sum() / on.sum()
    return out


def shared(shape: tuple[int, ...], length: float, rng: np.random.Generator) -> np.ndarray:
    """Noise of unit variance, averaged over windows ``length`` pitches wide."""
    white = rng.standard_normal(shape)
    if not length:
        return white
    out = scipy.ndimage.gaussian_filter(white, (0, length / 2, length / 2), mode="wrap")
    return np.asarray(out / out.std())


def published(readings: np.ndarray, noise: float) -> Any:
    """Bayesian Fourier transform traction cytometry: order 0, periodic, evidence with the noise given (Y. Huang et al., Sci. Rep. 9, 2019, 539)."""
    skin = pp.Skin(GEL, array(noise), boundary="periodic", uncertainty=EXACT)  # the noise is another for each cell
    return skin.reconstruct(readings, method=pp.Tikhonov(order=0, rule="evidence"), components=["x", "y"])


@functools.cache
def prepared(nuisance: tuple[str, ...] | None) -> pp.Skin:
    """One skin for all methods, which share what it keeps."""
    return pp.Skin(GEL, array(), nuisance=nuisance, uncertainty=EXACT)


def free(method: Any, nuisance: tuple[str, ...] | None = None) -> Callable[[np.ndarray, float], Any]:
    """A method on the free boundary, noise not told."""
    return lambda readings, _: prepared(nuisance).reconstruct(readings, method=method, components=["x", "y"])


METHODS: dict[str, Callable[[np.ndarray, float], Any]] = {
    "automatic": free("automatic"),
    "tikhonov, evidence": free("tikhonov"),
    "tikhonov, no drift thought of": free("tikhonov", ()),
    "tikhonov, GCV": free(pp.Tikhonov(rule="gcv")),
    "tikhonov, L-curve": free(pp.Tikhonov(rule="lcurve")),
    "order 0, evidence": free(pp.Tikhonov(order=0)),
    "published Bayesian": published,
}


def measured(touch: Any, truth: np.ndarray, skin: pp.Skin) -> dict[str, float]:
    """Numbers of one reconstruction, over the array (``truth`` on the free surface)."""
    grid = skin.surface
    values = np.asarray(touch.values)[:2]
    trim = tuple((a - b) // 2 for a, b in zip(grid.shape, touch.surface.shape))
    inside = tuple(slice(t, t + n) for t, n in zip(trim, touch.surface.shape))
    true = truth[(slice(0, 2), *inside)]
    on = (true != 0).any(axis=0)
    size = np.linalg.norm(true)
    std = np.asarray(touch.std())[:2]
    low, high = (np.asarray(v)[:2] for v in touch.interval(0.95))
    covered = (low <= true) & (true <= high)
    force_low, force_high = (np.asarray(v)[:2] for v in touch.interval(0.95, "force"))
    return {
        "error": float(np.linalg.norm(values - true) / size),
        "background": float(np.sqrt((values[:, ~on] ** 2).mean() / (true[:, on] ** 2).mean())),
        "magnitude": float(np.hypot(*values)[on].mean() / np.hypot(*true)[on].mean()),
        "net force": float(np.abs(np.asarray(touch.force)[:2]).max() / (np.hypot(*true).sum() * grid.cell)),
        "inside 95 %, on adhesions": float(covered[:, on].mean()),
        "inside 95 %, elsewhere": float(covered[:, ~on].mean()),
        "force inside 95 %": float(
            np.nanmean(np.where(np.isfinite(force_low), (force_low <= 0) & (force_high >= 0), np.nan))
        )
        if np.isfinite(force_low).any()
        else float("nan"),
        "energy": _energy(skin, np.pad(values, ((0, 1), *((t, t) for t in trim)))) / _energy(skin, truth),
        "note on drift": float(any("shift" in note for note in touch.notes)),
        "std": float(np.sqrt((std**2).mean() / (true[:, on] ** 2).mean())),
    }


def _energy(skin: pp.Skin, traction: np.ndarray) -> float:
    """Strain energy, half the work of traction (component, *surface) on the displacements under the array, without a net force's."""
    shift = tuple((a - b) // 2 for a, b in zip(traction.shape[1:], (COUNT, COUNT)))
    middle = tuple(slice(t, t + COUNT) for t in shift)
    moved = np.asarray(skin.sense(traction))
    moved = moved - moved.mean(axis=(1, 2), keepdims=True)
    return float(0.5 * (moved * traction[(slice(0, 2), *middle)]).sum() * skin.surface.cell)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=6, help="synthetic cells of each condition")
    parser.add_argument("--methods", nargs="*", help="short names of methods instead of the table's")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--markdown", type=Path, help="file for the table")
    args = parser.parse_args()
    methods = METHODS if not args.methods else {name: free(name) for name in args.methods}
    skin = pp.Skin(GEL, array(), uncertainty=EXACT)
    maker = pp.Skin(GEL, array(), surface=refined(skin.surface, FINER, 0))
    rows = []
    for condition, (drift, windows) in CONDITIONS.items():
        found: dict[str, list[dict[str, float]]] = {name: [] for name in methods}
        for index in range(args.cells):
            rng = np.random.default_rng((args.seed, index))
            fine = cell(maker.surface, rng)
            truth = block_means(fine, FINER, 2)
            clean = np.asarray(maker.sense(fine))
            top = float(np.abs(clean).max())
            readings = clean + NOISE * top * shared(clean.shape, windows, rng)
            readings = readings + drift * top * np.array([0.8, -0.6])[:, None, None]
            for name, method in methods.items():
                start = time.perf_counter()
                touch = method(readings, NOISE * top)
                seconds = time.perf_counter() - start
                found[name].append(measured(touch, truth, skin) | {"ms": 1e3 * seconds})
        for name, parts in found.items():
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # the mean of no number: an unobservable force
                mean = {key: float(np.nanmean([p[key] for p in parts])) for key in parts[0]}
            mean["ms"] = float(np.median([p["ms"] for p in parts]))
            rows.append((condition, name, mean))
            print(" | ".join([condition, name, *(f"{k} {v:.3g}" for k, v in mean.items())]), flush=True)
    if args.markdown is not None:
        keys = list(rows[0][2])
        lines = [f"| condition | method | {' | '.join(keys)} |", "|---" * (len(keys) + 2) + "|"]
        lines += [f"| {c} | {m} | {' | '.join(f'{v[k]:.3g}' for k in keys)} |" for c, m, v in rows]
        made = f"Made by `python benchmarks/tfm.py --cells {args.cells}`.\n"
        args.markdown.write_text("\n".join([made, *lines]) + "\n")


if __name__ == "__main__":
    main()
