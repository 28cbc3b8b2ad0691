"""Traction force microscopy from rendered pictures of beads, with known truth: errors and coverage of the numbers that papers report, and times.

Cells with six to twelve focal adhesions of 1 to 3 um (half axes) in balance on a gel of 8 kPa; beads of 1.2 pixels, photon noise, 0.1 um a pixel, a drift of the
stage of some pixels. `palpate` is `bead_displacements` and `cell_forces` as they come. "FTTC, smoothed" is Fourier transform traction cytometry without
regularisation (J. P. Butler et al., Am. J. Physiol. Cell Physiol. 282, 2002, C595) with a Gaussian of max(shape)/50 cells, as pyTFM makes it where no
filter is named, on the same displacements.

    python benchmarks/tfm_images.py                             # table of errors, some minutes
    python benchmarks/tfm_images.py --markdown tfm_images.md
    python benchmarks/tfm_images.py --times                     # 512, 1024, 2048 pixels
    python benchmarks/tfm_images.py --published FOLDER          # the sets of github.com/rg314/pytraction: matlab_data.csv, example_dataset.h5
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft
import scipy.ndimage

import palpate as pp
from palpate.microscopy import CellForces, Field, bead_displacements, cell_forces, read_field
from palpate.microscopy.fields import mended
from palpate.sensing.uncertainty import EXACT

PIXEL, FINE = 0.1e-6, 0.4e-6
GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
CHANNELS = ["displacement_x", "displacement_y"]
#: Beads per pixel, their width [px], and photons of the brightest.
DENSITY, WIDTH, PHOTONS = 0.02, 1.2, 500.0
NUMBERS = ("strain_energy", "contractile_moment", "contractility", "net_force_x", "net_force_y", "torque")


def cell(x: np.ndarray, y: np.ndarray, rng: np.random.Generator, pull: float) -> np.ndarray:
    """Traction (2, row, column) [Pa] of adhesions round a rim, about the middle, without net force."""
    out = np.zeros((2, *x.shape))
    count = int(rng.integers(6, 13))
    for angle in 2 * np.pi * (np.arange(count) + 0.6 * rng.random(count)) / count:
        radius = float(rng.uniform(10e-6, 16e-6))
        along = x * np.cos(angle) + y * np.sin(angle) - radius
        across = -x * np.sin(angle) + y * np.cos(angle)
        patch = (along / rng.uniform(1.2e-6, 3e-6)) ** 2 + (across / rng.uniform(1e-6, 1.6e-6)) ** 2 < 1
        size = pull * float(rng.uniform(0.2, 1.0))
        out[0] -= size * np.cos(angle) * patch
        out[1] -= size * np.sin(angle) * patch
    on = (out != 0).any(axis=0)
    for c in (0, 1):
        out[c][on] -= out[c].sum() / on.sum()
    return out


def picture(places: np.ndarray, light: np.ndarray, size: int, rng: np.random.Generator) -> np.ndarray:
    """Beads at ``places`` (n, 2) [px] as 16 bits, with the noise of their photons and of a camera."""
    edge = 8
    image = np.zeros((size + 2 * edge, size + 2 * edge))
    middle = np.rint(places).astype(int)
    reach = np.arange(-6, 7)
    near = ((middle >= -2) & (middle < size + 2)).all(axis=1)
    for start in range(0, len(places), 20_000):
        pick = np.flatnonzero(near)[start : start + 20_000]
        if not len(pick):
            break
        off = places[pick] - middle[pick]
        gx, gy = (np.exp(-((reach[None] - off[:, k : k + 1]) ** 2) / (2 * WIDTH**2)) for k in (0, 1))
        spots = light[pick, None, None] * gy[:, :, None] * gx[:, None, :]
        rows = middle[pick, 1][:, None, None] + reach[None, :, None] + edge
        columns = middle[pick, 0][:, None, None] + reach[None, None, :] + edge
        np.add.at(image, (np.broadcast_to(rows, spots.shape), np.broadcast_to(columns, spots.shape)), spots)
    photons = rng.poisson(60.0 + PHOTONS * image[edge:-edge, edge:-edge])
    return np.clip(np.rint(4.0 * photons + rng.normal(0.0, 12.0, photons.shape)), 0, 65535).astype(np.uint16)


def scene(size: int, seed: int, pull: float) -> dict[str, Any]:
    """Pictures of one cell, its traction, and the numbers that are true."""
    rng = np.random.default_rng((seed, 24))
    count = round(size * PIXEL / FINE)
    middle = 0.5 * (size - 1) * PIXEL
    grid = pp.AreaGrid(shape=(count, count), spacing=FINE, center=(middle, middle))
    x, y = np.meshgrid(grid.x, grid.y)
    traction = cell(x - middle, y - middle, rng, pull)
    array = pp.AreaArray(shape=grid.shape, pitch=FINE, depth=0.0, channels=CHANNELS, center=(middle, middle))
    u = np.asarray(pp.Skin(GEL, array, surface=grid).sense(np.concatenate([traction, np.zeros((1, *x.shape))])))
    beads = int(DENSITY * (size + 40) ** 2)
    places, light = rng.uniform(-20, size + 20, (beads, 2)), rng.uniform(0.3, 1.0, beads)
    at = (places[:, ::-1] * PIXEL - np.array([y[0, 0], x[0, 0]])) / FINE
    moved = np.stack([scipy.ndimage.map_coordinates(c, at.T, order=3, mode="nearest") for c in u], axis=1) / PIXEL
    drift = rng.uniform(-4, 4, 2)
    force = traction * FINE**2
    rest = u - u.mean(axis=(1, 2), keepdims=True)
    true = {
        "strain_energy": 0.5 * float((force * rest).sum()),
        "contractile_moment": -float((force[0] * (x - middle) + force[1] * (y - middle)).sum()),
        "contractility": float(np.hypot(*force).sum()),
        "net_force_x": 0.0,
        "net_force_y": 0.0,
        "torque": float((force[1] * (x - middle) - force[0] * (y - middle)).sum()),
    }
    pair = [picture(p, light, size, rng) for p in (places, places + moved + drift)]
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    outline = 0.5 * (size - 1) + 200.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return {
        "pair": pair,
        "traction": traction,
        "true": true,
        "outline": outline,
        "drift": drift,
        "grid": grid,
        "moved": u,
    }


def on_field(traction: np.ndarray, grid: Any, field: Field) -> np.ndarray:
    """Mean of the true traction over the squares of a field's vectors."""
    finer = 5
    rows, columns = field.shape
    axes = [
        (s + field.step * (np.arange(n * finer) - 0.5 * (finer - 1)) / finer) * field.pixel
        for s, n in zip(field.start[::-1], (rows, columns))
    ]
    at = np.meshgrid(*((a - g[0]) / FINE for a, g in zip(axes, grid.axes)), indexing="ij")
    fine = np.stack([scipy.ndimage.map_coordinates(c, at, order=0) for c in traction])
    return np.asarray(fine.reshape(2, rows, finer, columns, finer).mean(axis=(2, 4)))


def whole(field: Field) -> np.ndarray:
    """Displacements without their mean; vectors that are missing are the median of their neighbours."""
    u = mended(field.displacement / field.pixel)[0] * field.pixel if not field.valid.all() else field.displacement
    return np.asarray(u - u.mean(axis=(1, 2), keepdims=True))


def smoothed_fttc(field: Field, gel: pp.HalfSpace = GEL, *, part: float = 50.0) -> np.ndarray:
    """Fourier transform traction cytometry on a half-space without regularisation, then a Gaussian of max(shape)/part cells (0: none)."""
    u = whole(field)
    side = max(u.shape[1:]) + max(u.shape[1:]) % 2
    spectrum = scipy.fft.fft2(u, (side, side))
    k = 2 * np.pi * scipy.fft.fftfreq(side, field.pitch)
    kx, ky = k[None, :], k[:, None]
    size = np.hypot(kx, ky)
    safe = np.where(size > 0, size, 1.0)
    young, ratio = gel.youngs_modulus, gel.poissons_ratio
    scale = young / (2 * (1 - ratio**2)) / safe
    cross = ratio * kx * ky * scale
    cross = np.where((np.abs(kx) == np.abs(k).max()) | (np.abs(ky) == np.abs(k).max()), 0.0, cross)
    tx = ((1 - ratio) * size**2 + ratio * kx**2) * scale * spectrum[0] + cross * spectrum[1]
    ty = cross * spectrum[0] + ((1 - ratio) * size**2 + ratio * ky**2) * scale * spectrum[1]
    t = np.real(scipy.fft.ifft2(np.stack([tx, ty])))[:, : u.shape[1], : u.shape[2]]
    if part:
        t = np.stack([scipy.ndimage.gaussian_filter(c, max(u.shape[1:]) / part) for c in t])
    return np.asarray(t)


def numbers_of(t: np.ndarray, field: Field, inside: np.ndarray) -> dict[str, float]:
    """The same numbers from a traction without errors, with the displacements as they were measured."""
    u = whole(field)
    rows, columns = field.shape
    x, y = np.meshgrid(field.pitch * np.arange(columns), field.pitch * np.arange(rows))
    x, y = x - x[inside].mean(), y - y[inside].mean()
    f = t * field.pitch**2 * inside
    return {
        "strain_energy": 0.5 * float((f * u).sum()),
        "contractile_moment": -float((f[0] * x + f[1] * y).sum()),
        "contractility": -float(((f[0] * x + f[1] * y) / np.maximum(np.hypot(x, y), 1e-12)).sum()),
    }


def fit(t: np.ndarray, true: np.ndarray, inside: np.ndarray) -> dict[str, float]:
    on = np.hypot(*true) > 0.05 * np.hypot(*true).max()
    strong = np.hypot(*true) > 0.5 * np.hypot(*true).max()
    return {
        "error": float(np.linalg.norm(t - true) / np.linalg.norm(true)),
        "background": float(np.sqrt((t[:, ~inside] ** 2).mean() / (true[:, on] ** 2).mean())),
        "magnitude": float(np.hypot(*t)[strong].mean() / np.hypot(*true)[strong].mean()),
    }


def measured(found: CellForces, known: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Of both ways: error, background, magnitude, and numbers over the truth; of palpate's whether they are within 95 % too."""
    true = on_field(known["traction"], known["grid"], found.field)
    one = fit(found.traction, true, found.inside)
    for name in NUMBERS:
        q, value = found[name], known["true"][name]
        if name in ("strain_energy", "contractile_moment", "contractility"):
            one[name] = q.value / value
            one[name + " std"] = q.std / value
        low, high = q.interval
        one[name + " covered"] = float(low <= value <= high)
    inner = np.abs(found.traction - true) < 1.96 * found.std
    on = np.hypot(*true) > 0.05 * np.hypot(*true).max()
    one["adhesions covered"], one["elsewhere covered"] = float(inner[:, on].mean()), float(inner[:, ~on].mean())
    out = {"palpate": one}
    for label, part in (("FTTC, smoothed", 50.0), ("FTTC, as it is", 0.0)):
        t = smoothed_fttc(found.field, part=part)
        each = fit(t, true, found.inside)
        for name, value in numbers_of(t, found.field, found.inside).items():
            each[name] = value / known["true"][name]
        out[label] = each
    return out


def times() -> list[str]:
    """Seconds of processor time for pictures of several sizes, with every vector there (a few are missing in adhesions: filled here)."""
    lines = ["| pictures | vectors | displacements [s] | traction and errors [s] |", "|---|---|---|---|"]
    for size in (512, 1024, 2048):
        known = scene(size, 0, 1500.0)
        start = time.process_time()
        field = bead_displacements(*known["pair"], pixel=PIXEL)
        middle = time.process_time()
        field = replace(field, displacement=mended(field.displacement / PIXEL)[0] * PIXEL)
        cell_forces(field, GEL, mask=known["outline"])
        end = time.process_time()
        lines.append(
            f"| {size} x {size} | {field.shape[1]} x {field.shape[0]} | {middle - start:.1f} | {end - middle:.1f} |"
        )
        print(lines[-1], flush=True)
    return lines


def published(folder: Path) -> list[str]:
    """Numbers of published displacement fields by each way, over the whole field of view."""
    table = np.genfromtxt(folder / "matlab_data.csv", delimiter=",", names=True, encoding="utf-8-sig")
    sets = {
        "synthetic": (
            read_field(folder / "matlab_data.csv", pixel=1e-6),
            pp.HalfSpace(youngs_modulus=10e3, poissons_ratio=0.3),
            1e-6 * float(np.sqrt(0.5 * (table["un"] ** 2 + table["vn"] ** 2).mean())),  # its own sample of the noise
        ),
        "axon, 819 beads": (
            read_field(folder / "example_dataset.h5", pixel=1e-6 / 1.3, follow=True),
            pp.HalfSpace(youngs_modulus=100.0, poissons_ratio=0.5),
            None,
        ),
    }
    names = ("strain energy [J]", "net contractile moment [N m]", "contractility [N]")
    lines = [f"| set | method | {' | '.join(names)} | largest traction [Pa] | median [Pa] |", "|---" * 7 + "|"]
    for name, (field, gel, noise) in sets.items():
        field = field.without_drift()
        inside = np.ones(field.shape, dtype=bool)
        rows = {}
        for method in ("adhesions", "tikhonov"):
            found = cell_forces(field, gel, noise=noise, method=method)
            rows[method] = (found.traction, {k: (found[k].value, found[k].std) for k in NUMBERS[:3]})
        for label, part in (("FTTC, smoothed", 50.0), ("FTTC, as it is", 0.0)):
            t = smoothed_fttc(field, gel, part=part)
            rows[label] = (t, {k: (v, 0.0) for k, v in numbers_of(t, field, inside).items()})
        for label, (t, each) in rows.items():
            size = np.hypot(*t)
            told = " | ".join(f"{v:.3g}" + (f" +- {s:.2g}" if s else "") for v, s in each.values())
            lines.append(
                f"| {name}, {field.shape[1]} x {field.shape[0]} | {label} | {told} | {size.max():.3g} | {np.median(size):.3g} |"
            )
            print(lines[-1], flush=True)
        print(*found.notes, sep="\n  ")
    import h5py

    with h5py.File(folder / "example_dataset.h5") as file:
        axon = np.hypot(*np.moveaxis(file["force_field/0"][()], -1, 0))
    known = {
        "synthetic": np.loadtxt(folder / "expected_traction_magnitude_int_Pa.csv", delimiter=","),
        "axon, 819 beads": axon,
    }
    for name, size in known.items():
        lines.append(
            f"| {name}, {size.shape[-1]} x {size.shape[-2]} | as published (regularised) | | | | {size.max():.3g} | {np.median(size):.3g} |"
        )
    return sorted(
        lines, key=lambda line: (not line.startswith(("| set", "|--")), line.split("|")[1][:9], "published" in line)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--windows", type=int, nargs="*", default=[24, 32])
    parser.add_argument("--pull", type=float, nargs="*", default=[1500.0, 300.0], help="largest traction [Pa]")
    parser.add_argument("--times", action="store_true")
    parser.add_argument("--published", type=Path, help="folder of published sets")
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    if args.times or args.published is not None:
        lines = times() if args.times else published(args.published)
        if args.markdown is not None:
            made = "--times" if args.times else "--published FOLDER"
            args.markdown.write_text(
                "\n".join([f"Made by `python benchmarks/tfm_images.py {made}`.", "", *lines]) + "\n"
            )
        return
    rows: list[tuple[str, dict[str, float]]] = []
    for pull in args.pull:
        for window in args.windows:
            found: dict[str, list[dict[str, float]]] = {}
            for index in range(args.cells):
                known = scene(512, args.seed + index, pull)
                field = bead_displacements(*known["pair"], pixel=PIXEL, window=window)
                forces = cell_forces(field, GEL, mask=known["outline"], uncertainty=EXACT)
                for label, each in measured(forces, known).items():
                    found.setdefault(label, []).append(each)
            for label, parts in found.items():
                name = f"{pull:g} Pa, windows of {window} px | {label}"
                rows.append((name, {k: float(np.mean([p[k] for p in parts])) for k in parts[0]}))
                print(name, "|", ", ".join(f"{k} {v:.3g}" for k, v in rows[-1][1].items()), flush=True)
    if args.markdown is not None:
        keys = list(dict.fromkeys(k for _, row in rows for k in row))
        lines = [
            f"Made by `python benchmarks/tfm_images.py --cells {args.cells}`.",
            "",
            f"| pull, windows | method | {' | '.join(keys)} |",
        ]
        lines.append("|---" * (len(keys) + 2) + "|")
        lines += [f"| {name} | {' | '.join(f'{row[k]:.3g}' if k in row else '' for k in keys)} |" for name, row in rows]
        args.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
