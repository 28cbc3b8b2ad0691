"""Holds palpate against closed forms, published tables and reference solutions, and prints every figure the docs quote.

    python benchmarks/validation.py [--shared ../shared] [--write] [section ...]

``--write`` puts what each section prints into docs/_generated/validation, from where the pages show it.

Sections: paper, line, area, contact, alva, beads, force, adjoint, layers, layers3d, inversion, alvalayers, creep, sweep, decibels, empty,
robust, edge, crossing, channels. The folder of published data and oracles is not part of the project; sections that need it say so where it is absent.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import itertools
import json
import re
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate import paper, solutions
from palpate.elastic import transfer
from palpate.recordings import read_table

SHARED = Path("../shared")
WRITTEN = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "validation"


def channel_of(field: str) -> str:
    kind, index = field.split("_")
    return {"S": "stress", "eps": "strain", "u": "displacement"}[kind] + "_" + index


def oracle(name: str) -> dict[str, Any]:
    return dict(np.load(SHARED / "oracles" / f"{name}.npz"))


def relative(found: Any, true: Any) -> float:
    return float(np.linalg.norm(np.asarray(found) - true) / np.linalg.norm(true))


def orders(errors: list[float]) -> str:
    return ", ".join(f"{np.log2(a / b):.2f}" for a, b in itertools.pairwise(errors))


def section_paper() -> None:
    """Mean absolute errors of the founding paper's cases."""
    for row in (*paper.error_table(), *paper.friction_table()):
        print("  " + "  ".join(f"{k} {v:.2e}" if isinstance(v, float) else str(v) for k, v in row.items()))


def section_line() -> None:
    """Line contact: Hertz pressure and shear, relative L2 over all oracle depths at 16, 32, 64 cells per half-width."""
    data = oracle("closed_form_2d")
    x = data["x"]
    worst = 0.0
    for nu in ("0.3", "0.5"):
        pad = pp.HalfSpace(youngs_modulus=1, poissons_ratio=float(nu))
        for case in ("hertz_p", "hertz_q"):
            for field in ("S_xx", "S_zz", "S_xz", "eps_xx", "eps_zz", "u_x", "u_z"):
                key = f"{case}__{field}" if field[0] == "S" else f"{case}__nu{nu}__{field}"
                depths = data["z_u"] if field[0] == "u" else data["z"]
                errors = []
                for cells in (16, 32, 64):
                    grid = pp.LineGrid(count=2 * cells + 8, spacing=1 / cells)
                    normal = solutions.hertz_line(half_width=1, force=np.pi / 2).averages(grid.edges)
                    traction = normal if case == "hertz_p" else normal[::-1]
                    found, true = [], []
                    for z, row in zip(depths, data[key]):
                        array = pp.ScatteredArray(positions=x, depth=float(z), channels=[channel_of(field)])
                        found.append(pp.Skin(pad, array, surface=grid).sense(traction)[0])
                        # a half-plane's displacement is defined up to a constant
                        true.append(row - row.mean() if field[0] == "u" else row)
                    errors.append(relative(found, np.array(true)))
                worst = max(worst, errors[1])
                print(
                    f"  nu {nu} {case} {field:<7} "
                    + "  ".join(f"{e:.1e}" for e in errors)
                    + f"   order {orders(errors)}"
                )
    print(f"  worst at 32 cells: {worst:.1e}")


def section_area() -> None:
    """Area contact: Hertz circle (8, 16, 32 cells per radius) and rectangle (exact cells), relative L2 over the lattice."""
    data = oracle("closed_form_3d")
    g = data["xy"]
    points = np.stack(np.meshgrid(g, g), axis=-1).reshape(-1, 2)
    worst = 0.0
    fields = ("S_xx", "S_yy", "S_zz", "S_xz", "S_yz", "S_xy", "eps_zz", "u_x", "u_y", "u_z")
    for nu in ("0.3", "0.5"):
        pad = pp.HalfSpace(youngs_modulus=1, poissons_ratio=float(nu))
        table: dict[tuple[str, str], list[float]] = {}
        for case, contact, sizes in (
            ("hertz_circle_p", solutions.hertz_point(contact_radius=1, force=2 * np.pi / 3), (8, 16, 32)),
            ("rect_p", solutions.patch(half_widths=(1, 0.75), traction=1), (4,)),
            ("rect_q", solutions.patch(half_widths=(1, 0.75), traction=1, component="x"), (4,)),
        ):
            for cells in sizes:
                grid = pp.AreaGrid(shape=(2 * cells + 4, 2 * cells + 4), spacing=1 / cells)
                traction = contact.averages(grid.x, grid.y)
                found: dict[str, list[Any]] = {f: [] for f in fields}
                for z in data["z"]:
                    array = pp.ScatteredArray(
                        positions=points, depth=float(z), channels=[channel_of(f) for f in fields]
                    )
                    for f, row in zip(fields, pp.Skin(pad, array, surface=grid).sense(traction)):
                        found[f].append(row.reshape(13, 13))
                for f in fields:
                    table.setdefault((case, f), []).append(relative(found[f], data[f"{case}__nu{nu}__{f}"]))
        for (case, f), errors in table.items():
            if case == "hertz_circle_p":
                worst = max(worst, errors[-1])
            tail = f"   order {orders(errors)}" if len(errors) > 1 else "   (exact: cells fill the rectangle)"
            print(f"  nu {nu} {case:<15} {f:<7} " + "  ".join(f"{e:.1e}" for e in errors) + tail)
    print(f"  worst of the circle at 32 cells: {worst:.1e}")


def section_contact() -> None:
    """CONTACT, subsurf: largest deviation of each channel at z >= 0.1 (unit square pressed and sheared)."""
    rows = []
    for line in (SHARED / "data" / "contact" / "subsurf.ref_subs").read_text().splitlines():
        values = line.split()
        if len(values) == 14 and not line.startswith("%") and values[3:] != ["0.000"] * 11:
            rows.append([float(v) for v in values])
    table = np.array(rows)
    table = table[table[:, 2] >= 0.1]
    pad = pp.HalfSpace(youngs_modulus=2 * 1.28, poissons_ratio=0.28)
    surface = pp.AreaGrid(shape=(2, 2), spacing=1.0, center=(0.5 + 1e-4, 0.5 + 2e-4))
    traction = np.zeros((3, 2, 2))
    traction[0, 0, 0], traction[2, 0, 0] = 0.999, 1.0
    columns = {"displacement_x": 3, "displacement_y": 4, "displacement_z": 5, "stress_xx": 8, "stress_yy": 11}
    columns |= {"stress_zz": 13, "stress_xz": 10, "stress_yz": 12, "stress_xy": 9}
    for channel, column in columns.items():
        found = np.empty(len(table))
        for z in np.unique(table[:, 2]):
            at = table[:, 2] == z
            points, where = np.unique(table[at, :2], axis=0, return_inverse=True)
            array = pp.ScatteredArray(positions=points, depth=float(z), channels=[channel])
            found[at] = pp.Skin(pad, array, surface=surface).sense(traction)[0][where.ravel()]
        true = table[:, column] * (1 if channel.startswith("displacement") else -1)
        print(
            f"  {channel:<15} {np.abs(found - true).max():.1e}  (largest value {np.abs(true).max():.3f}, {len(table)} points)"
        )


def section_alva() -> None:
    """ELLEA1, homogeneous half-space, 1.1 MPa on a disc of radius 150 mm: largest deviation per column (4 decimals printed)."""
    n = 304
    grid = pp.AreaGrid(shape=(n, n), spacing=1.0)
    sub = (np.arange(10) + 0.5) / 10 - 0.5
    fine = (grid.x[:, None] + sub).ravel()
    traction = np.zeros((3, n, n))
    traction[2] = 1.1 * (fine**2 + fine[:, None] ** 2 <= 150.0**2).reshape(n, 10, n, 10).mean(axis=(1, 3))
    pad = pp.HalfSpace(youngs_modulus=200.0, poissons_ratio=0.35)
    names = {
        f"stress_{i}": f"sig_{j}_MPa"
        for i, j in (("xx", "x"), ("yy", "y"), ("zz", "z"), ("yz", "yz"), ("xz", "xz"), ("xy", "xy"))
    }
    names |= {f"displacement_{i}": f"u{i}_mm" for i in "xyz"}
    for file, x, y in (("ELLEA1_halfspace", 0.0, 0.0), ("ELLEA1_halfspace_shear", 10.0, 20.0)):
        with (SHARED / "data" / "alva" / f"{file}.csv").open() as handle:
            rows = [{k: float(v) for k, v in r.items()} for r in csv.DictReader(handle)]
        worst = dict.fromkeys(names, 0.0)
        for row in rows:
            if row["pos_mm"] == 0:
                continue
            array = pp.ScatteredArray(positions=[[x, y], [x + 77, y + 55]], depth=row["pos_mm"], channels=list(names))
            for (channel, column), value in zip(names.items(), pp.Skin(pad, array, surface=grid).sense(traction)[:, 0]):
                worst[channel] = max(worst[channel], abs(value - row[column]))
        print(f"  {file}: " + ", ".join(f"{names[c]} {v:.1e}" for c, v in worst.items()))


def section_beads() -> None:
    """Published traction force microscopy: correlation at the published parameter, and the automatic parameters."""
    import h5py

    folder = SHARED / "data" / "pytraction"
    with h5py.File(folder / "example_dataset.h5") as file:
        published, own = file["force_field/0"][()], float(file["L/0"][()])
    names = ["displacement_x", "displacement_y"]
    sets: list[tuple[str, Any, float, float, float, float]] = []
    px = 1e-6 / 1.3
    sets.append(("beads", (folder / "example_dataset.h5", ["pos/0", "vec/0"]), px, 100.0, 0.5, own))
    sets.append(("synthetic", (folder / "matlab_data.csv", ["x", "y", "u", "v"]), 1e-6, 1e4, 0.3, 145.837))
    for name, (path, columns), pixel, modulus, nu, parameter in sets:
        raw = read_table(
            path, columns=columns, channels=names, position_factor=pixel, reading_factor=pixel, follow=True
        )
        gridded = raw.gridded(10 * pixel)
        unit = (pixel / modulus) ** 2 / (10 * pixel) ** 2
        array = pp.AreaArray(shape=gridded.readings.shape[2:], pitch=10 * pixel, depth=0.0, channels=names)
        pad = pp.HalfSpace(youngs_modulus=modulus, poissons_ratio=nu)
        skin = pp.Skin(pad, array, boundary="periodic")
        found = skin.reconstruct(gridded.readings[0], order=0, parameter=parameter * unit).values
        if name == "beads":
            for i in (0, 1):
                print(
                    f"  beads, component {'xy'[i]}: correlation {np.corrcoef(found[i].ravel(), published[:, :, i].T.ravel())[0, 1]:.11f}"
                )
        else:
            whole = np.loadtxt(folder / "expected_traction_magnitude_int_Pa.csv", delimiter=",")[::-1]
            print(
                f"  synthetic, magnitude: correlation {np.corrcoef(np.hypot(*found[:2]).ravel(), whole.ravel())[0, 1]:.5f}"
            )
            theirs = np.hypot(found[0] + 0.686, found[1] + 0.617)
            print(
                f"  synthetic, with their uniform traction added: {np.corrcoef(theirs.ravel(), whole.ravel())[0, 1]:.6f}, "
                f"largest difference of the integers {int(np.abs(np.floor(theirs) - whole).max())}"
            )
        line = [f"  {name}: their parameter {parameter:.1f}; ours, order 0:"]
        for rule in ("evidence", "gcv", "lcurve"):
            start = time.perf_counter()
            value = float(skin.reconstruct(gridded.readings[0], order=0, parameter=rule).parameter) / unit
            line.append(f"{rule} {value:.1f} ({1e3 * (time.perf_counter() - start):.0f} ms)")
        if name == "synthetic":
            noise = read_table(
                path, columns=["x", "y", "un", "vn"], channels=names, position_factor=pixel, reading_factor=pixel
            )
            std = float(noise.readings.std())
            known = pp.Skin(
                pad,
                pp.AreaArray(shape=array.shape, pitch=10 * pixel, depth=0.0, channels=names, noise=std),
                boundary="periodic",
            )
            for rule in ("evidence", "discrepancy"):
                value = float(known.reconstruct(gridded.readings[0], order=0, parameter=rule).parameter) * std**2 / unit
                line.append(f"{rule} with the noise given {value:.1f}")
        print(" ".join(line))
        start = time.perf_counter()
        scattered = pp.ScatteredArray(positions=raw.positions, depth=0.0, channels=names)
        if len(raw.positions) < 2000:
            touch = pp.Skin(pad, scattered).reconstruct(raw.readings)
            print(
                f"  {name}, as scattered, free boundary, automatic: net force {touch.force[0][:2]} N, largest shear "
                f"{np.hypot(*touch.values[0][:2]).max():.2f} Pa, noise {touch.noise_std[0][0] / pixel:.3f} px, "
                f"{time.perf_counter() - start:.1f} s with preparation"
            )


def _cases(name: str) -> dict[str, dict[str, str]]:
    index = json.loads((SHARED / "oracles" / "index.json").read_text())
    return next(f["cases"] for f in index["files"] if f["file"] == f"{name}.npz")


def _layers(case: str, meta: dict[str, str]) -> pp.BondedLayers:
    """The pad of an oracle's case, from its words."""
    if "h1=" in meta["geometry"]:
        h = re.findall(r"h\d=([\d.]+)", meta["geometry"])
        e, nu = re.findall(r"E\d=([\d.]+)", meta["material"]), re.findall(r"nu\d=([\d.]+)", meta["material"])
    else:
        h, e = [case.split("__")[0][1:]], ["1"]
        nu = [case.split("__")[1][2:]]
    return pp.BondedLayers(
        [pp.Layer(thickness=float(a), youngs_modulus=float(b), poissons_ratio=float(c)) for a, b, c in zip(h, e, nu)]
    )


def _depths(values: Any) -> list[float]:
    """Interfaces are recorded twice, from above and then from below."""
    return [float(z) * (1 + 1e-7) if i and z == values[i - 1] else float(z) for i, z in enumerate(values)]


def section_layers() -> None:
    """Bonded layers and stacks, plane strain: worst relative L2 per recorded line at 64, 128, 256 cells per half-width."""
    for name in ("mfs_layer_2d", "mfs_stack_2d", "fem_layer_2d", "fem_stack_2d"):
        data = oracle(name)
        print(f"  {name}" + (" (256 cells only)" if name.startswith("fem") else ""))
        for case, meta in _cases(name).items():
            group, pad = case.split("__")[0], _layers(case, meta)
            x = data[f"{group}__x"]
            pitch = float(np.diff(x).min())
            whole = pp.LineArray(
                count=round(float(x[-1] - x[0]) / pitch) + 1, pitch=pitch, depth=0.0, channels=["stress_zz"]
            ).grid.x
            pick = np.abs(whole[:, None] - x).argmin(axis=0)
            contact = (
                solutions.strip(half_width=1, traction=1)
                if "strip" in case
                else solutions.hertz_line(half_width=1, force=np.pi / 2)
            )
            line = []
            for cells in (64, 128, 256) if name.startswith("mfs") else (256,):
                grid = pp.LineGrid(count=2 * cells, spacing=1 / cells)
                traction = contact.averages(grid.edges)
                traction = traction[::-1] if case.endswith("q") else traction
                worst = (0.0, "", 0.0)
                for kind in ("z", "z_u"):
                    fields = [
                        f
                        for f in ("S_zz", "S_xx", "S_xz", "eps_zz", "eps_xx", "u_x", "u_z")
                        if (f[0] == "u") == (kind == "z_u")
                    ]
                    for i, z in enumerate(_depths(data[f"{group}__{kind}"])):
                        array = pp.LineArray(
                            count=whole.size, pitch=pitch, depth=z, channels=[channel_of(f) for f in fields]
                        )
                        for f, row in zip(fields, pp.Skin(pad, array, surface=grid).sense(traction)):
                            worst = max(worst, (_line_error(row[pick], data[f"{case}__{f}"], i), f, float(z)))
                line.append(f"{worst[0]:.1e} ({worst[1]} at {worst[2]:.3g})")
            print(f"  {case:<42} " + "  ".join(line), flush=True)


def section_layers3d() -> None:
    """Bonded layers, area contact (normal and shear on a disc): worst relative L2 per line, and the same at half the resolution.

    Cells per radius: 64 at depths from 0.25, 128 from 0.1 and on the surface, 256 above.
    """
    on_x = {"S_zz": "stress_zz", "S_rr": "stress_xx", "S_tt": "stress_yy", "S_rz": "stress_xz", "eps_zz": "strain_zz"}
    on_x |= {"u_r": "displacement_x", "u_z": "displacement_z"}
    on_y = {"S_tz": "stress_xz", "S_rt": "stress_xy", "u_t": "displacement_x"}  # of the sine amplitudes, sign reversed
    for name in ("mfs_layer_3d", "fem_layer_3d", "fem_layer_3d_shear"):
        data = oracle(name)
        print(f"  {name}")
        for case, meta in _cases(name).items():
            group, pad = case.split("__")[0], _layers(case, meta)
            r = data[f"{group}__r"]
            pitch = float(r[1] - r[0])
            worst = [(0.0, "", 0.0), (0.0, "", 0.0)]
            for kind in ("z", "z_u"):
                fields = [f for f in on_x if (f[0] == "u") == (kind == "z_u") and f"{case}__{f}" in data]
                for i, z in enumerate(data[f"{group}__{kind}"]):
                    finest = 64 if z >= 0.25 else 256 if 0 < z < 0.09 else 128
                    for level, cells in enumerate((finest // 2, finest)):
                        grid = pp.AreaGrid(shape=(2 * cells, 2 * cells), spacing=1 / cells)
                        array = pp.AreaArray(
                            shape=(2, r.size),
                            pitch=pitch,
                            depth=float(z),
                            channels=[on_x[f] for f in fields],
                            center=(float(r[-1]) / 2, pitch / 2),
                        )
                        traction = np.zeros((3, *grid.shape))
                        traction[0 if "shear" in name else 2] = _disc(grid.x, "hertz" in case)
                        for f, rows in zip(fields, pp.Skin(pad, array, surface=grid).sense(traction)):
                            error = _line_error(rows[0], data[f"{case}__{f}"], i)
                            worst[level] = max(worst[level], (error, f, float(z)))
                        across = [f for f in on_y if (f[0] == "u") == (kind == "z_u") and f"{case}__{f}" in data]
                        if not across:
                            continue
                        array = pp.AreaArray(
                            shape=(r.size, 2),
                            pitch=pitch,
                            depth=float(z),
                            channels=[on_y[f] for f in across],
                            center=(pitch / 2, float(r[-1]) / 2),
                        )
                        for f, rows in zip(across, pp.Skin(pad, array, surface=grid).sense(traction)):
                            error = _line_error(-rows[:, 0], data[f"{case}__{f}"], i)
                            worst[level] = max(worst[level], (error, f, float(z)))
            print(f"  {case:<26} " + "  ".join(f"{e:.1e} ({f} at {z:.3g})" for e, f, z in worst), flush=True)


def _disc(x: Any, hertz: bool) -> Any:
    """Cell averages of a unit disc load: uniform, or Hertz of peak 1."""
    n = max(8, 4096 // x.size)  # points per cell and axis: the disc's edge must not be coarser than the cells' error
    sub = ((np.arange(n) + 0.5) / n - 0.5) * (x[1] - x[0])
    square = (x[:, None] + sub).ravel() ** 2
    inside = 1 - square - square[:, None]
    load = np.sqrt(np.maximum(inside, 0)) if hertz else (inside > 0) * 1.0
    return load.reshape(x.size, n, x.size, n).mean(axis=(1, 3))


def _line_error(found: Any, true: Any, i: int) -> float:
    """Relative L2; rows below a thousandth of the largest (zero by symmetry or at the base) relative to that, as the oracle does."""
    largest = max(np.linalg.norm(row) for row in true)
    size = np.linalg.norm(true[i])
    return float(np.linalg.norm(found - true[i]) / (size if size > 1e-3 * largest else largest))


def section_inversion() -> None:
    """Hertz pressure from the base stresses of finite elements with 1 % noise: layered against half-space inversion, 20 draws."""
    data = oracle("fem_layer_2d")
    rng = np.random.default_rng(0)
    for case in ("h1__nu0.5__hertz_p", "h1__nu0.45__hertz_p", "h0.5__nu0.5__hertz_p", "h0.5__nu0.3__hertz_p"):
        pad = _layers(case, {"geometry": ""})
        x = data[f"{case.split('__')[0]}__x"]
        near = np.abs(x) <= 6.0
        clean = np.stack([data[f"{case}__{f}"][-1][near] for f in ("S_xz", "S_zz")])
        noisy = clean + 0.01 * np.abs(clean).max() * rng.standard_normal((20, *clean.shape))
        pitch = float(x[1] - x[0])
        line = []
        for word, body in (("layered", pad), ("half-space", pad.surface)):
            array = pp.LineArray(
                count=int(near.sum()), pitch=pitch, depth=pad.thickness, channels=["stress_xz", "stress_zz"]
            )
            skin = pp.Skin(body, array)
            touch = skin.reconstruct(noisy, method="tikhonov")
            truth = skin.sample(solutions.hertz_line(half_width=1, force=np.pi / 2))
            errors = [relative(v, truth) for v in touch.values]
            peak = touch.peak_pressure.mean()
            line.append(
                f"{word}: error {np.mean(errors):.3f}, force {touch.force[:, 1].mean() / (np.pi / 2):.3f}, peak {peak:.3f}"
            )
        print(f"  {case:<22} " + "   ".join(line))


def section_alvalayers() -> None:
    """ELLEA1, three bonded layers on a soft base: largest deviation per column (4 decimals printed)."""
    steps = [(150.0, 3000.0, 0.30), (600.0, 200.0, 0.35)]
    pad = pp.BondedLayers(
        [pp.Layer(thickness=h, youngs_modulus=e, poissons_ratio=nu) for h, e, nu in steps],
        pp.HalfSpace(youngs_modulus=40.0, poissons_ratio=0.40),
    )
    names = {
        f"stress_{i}": f"sig_{j}_MPa"
        for i, j in (("xx", "x"), ("yy", "y"), ("zz", "z"), ("yz", "yz"), ("xz", "xz"), ("xy", "xy"))
    }
    names |= {f"displacement_{i}": f"u{i}_mm" for i in "xyz"}
    n, dx = 121, 2.5  # odd: a cell is centred on the axis
    axis = (np.arange(n) - (n - 1) / 2) * dx
    sub = ((np.arange(16) + 0.5) / 16 - 0.5) * dx
    square = (axis[:, None] + sub).ravel() ** 2
    disc = 1.1 * (square + square[:, None] <= 150.0**2).reshape(n, 16, n, 16).mean(axis=(1, 3))
    for file, centres, along_x in (
        ("ELLEA1_singledepth", [0.0], False),
        ("ELLEA1_dualdepth", [-150.0, 150.0], False),
        ("ELLEA1_duallength", [-150.0, 150.0], True),
    ):
        with (SHARED / "data" / "alva" / f"{file}.csv").open() as handle:
            rows = [{k: float(v) for k, v in r.items()} for r in csv.DictReader(handle)]
        worst = dict.fromkeys(names, (0.0, 0.0))
        for row in rows:
            x, z = (row["pos_mm"], 0.0) if along_x else (0.0, row["pos_mm"])
            # the table does not say which side of an interface it prints: the nearer of both counts
            for side in (1.0,) if z not in (150.0, 750.0) else (1.0, 1.0 + 1e-7):
                total = np.zeros(len(names))
                for centre in centres:
                    grid = pp.AreaGrid(shape=(n, n), spacing=dx, center=(0.0, centre))
                    array = pp.ScatteredArray(
                        positions=[[x, 0.0], [x + 7.3, 5.1]], depth=z * side, channels=list(names)
                    )
                    traction = np.zeros((3, n, n))
                    traction[2] = disc
                    total += pp.Skin(pad, array, surface=grid).sense(traction)[:, 0]
                row.setdefault("best", {})  # type: ignore[arg-type]
                for (channel, column), value in zip(names.items(), total):
                    best = row["best"]  # type: ignore[index]
                    best[channel] = min(best.get(channel, np.inf), abs(value - row[column]))
            for channel in names:
                worst[channel] = max(worst[channel], (row["best"][channel], row["pos_mm"]))  # type: ignore[index]
        print(f"  {file}: " + ", ".join(f"{names[c]} {v:.1e} (at {p:g})" for c, (v, p) in worst.items()), flush=True)


def section_sweep() -> None:
    """Surface compliance of 300 random stacks (1 to 20 layers, moduli 1e-4 to 1e4, nu 0 to 0.5), k h from 1e-8 to 1e4."""
    rng = np.random.default_rng(0)
    asymmetry, smallest = 0.0, np.inf
    for _ in range(300):
        layers = [
            pp.Layer(
                thickness=10 ** rng.uniform(-4, 0),
                youngs_modulus=10 ** rng.uniform(-4, 4),
                poissons_ratio=float(rng.choice([0.0, 0.3, 0.45, 0.5])),
            )
            for _ in range(rng.integers(1, 21))
        ]
        base = pp.HalfSpace(youngs_modulus=10 ** rng.uniform(-4, 4), poissons_ratio=0.4) if rng.random() < 0.5 else None
        pad = pp.BondedLayers(layers, base)
        k = np.geomspace(1e-8, 1e4, 60) / pad.thickness
        with np.errstate(all="raise", under="ignore"):
            compliance = transfer(pad, 0.6 * k, 0.8 * k, 0.0, ["displacement_x", "displacement_y", "displacement_z"])
            everything = transfer(pad, k, 0.0, pad.thickness, pp.AREA_CHANNELS)
        if not (np.isfinite(compliance).all() and np.isfinite(everything).all()):
            print("  NOT FINITE:", pad)
        scale = 1 / np.sqrt(np.abs(np.einsum("kii->ki", compliance)))
        balanced = compliance * scale[:, :, None] * scale[:, None, :]
        asymmetry = max(asymmetry, float(np.abs(balanced - balanced.conj().swapaxes(1, 2)).max()))
        smallest = min(smallest, float(np.linalg.eigvalsh(balanced).min()))
    print(
        f"  all finite, no overflow or invalid operation; largest asymmetry {asymmetry:.1e}; smallest balanced eigenvalue {smallest:.1e}"
    )


def section_creep() -> None:
    """Net force from surface displacement of a pad that creeps (standard linear solid in closed form: g = 0.3, tau = 2 s).

    A 60 s hold and a 1 Hz press cycle of 20 s, 100 frames per second, 1 % noise: largest and root mean square error over time.
    """
    g, tau, omega = 0.3, 2.0, 2 * np.pi
    a, b = g / tau, (1 - g) / tau  # creep rate j'(t) = a exp(-b t)
    elastic = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)
    array = pp.AreaArray(
        shape=(16, 16), pitch=1e-3, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    block = solutions.patch(half_widths=(3e-3, 2e-3), traction=5e3).shifted(1e-3, -1e-3)
    instant = block.fields(elastic, array.channels, array.grid.x, array.grid.y[:, None], 0.0)
    hold, cycle = np.arange(0, 60, 0.01), np.arange(0, 20, 0.01)
    crept = (
        0.5
        * a
        * (
            -np.expm1(-b * cycle) / b
            - (b * np.cos(omega * cycle) + omega * np.sin(omega * cycle) - b * np.exp(-b * cycle)) / (b**2 + omega**2)
        )
    )
    cases = (
        ("60 s hold", hold, np.ones_like(hold), 1 - a / b * np.expm1(-b * hold)),
        ("1 Hz cycle", cycle, 0.5 * (1 - np.cos(omega * cycle)), 0.5 * (1 - np.cos(omega * cycle)) + crept),
    )
    rng = np.random.default_rng(0)
    skins = {
        "creep removed": pp.Skin(pp.Viscoelastic(elastic, [(g, tau)]), array),
        "uncorrected": pp.Skin(elastic, array),
    }
    for name, stamps, force, response in cases:
        readings = response[:, None, None, None] * instant
        readings = readings + 0.01 * np.abs(instant).max() * rng.standard_normal(readings.shape)
        line = []
        for word, skin in skins.items():
            found = skin.reconstruct(readings, time=stamps, method="tikhonov").force[:, 2] / block.force[2]
            error = found - force
            line.append(
                f"{word}: largest {100 * np.abs(error).max():.1f} %, rms {100 * np.sqrt((error**2).mean()):.2f} %"
            )
        print(f"  {name:<11} " + "   ".join(line))


def section_force() -> None:
    """Net force of one off-centre sheared patch from displacement at the surface (closed form, not our operator)."""
    rng = np.random.default_rng(0)
    for nu in (0.3, 0.5):
        pad = pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=nu)
        block = solutions.patch(half_widths=(4.5e-4, 3.5e-4), traction=500.0, component="x").shifted(5e-4, -4e-4)
        for names in (["displacement_x", "displacement_y"], ["displacement_x", "displacement_y", "displacement_z"]):
            array = pp.AreaArray(shape=(32, 32), pitch=1e-4, depth=0.0, channels=names)
            skin = pp.Skin(pad, array)
            clean = block.fields(pad, names, array.grid.x, array.grid.y[:, None], 0.0)
            for level in (0.0, 1e-3, 1e-2):
                noisy = clean + level * np.abs(clean).max() * rng.standard_normal((20, *clean.shape))
                error = skin.reconstruct(noisy, method="tikhonov").force / block.force[0] - [1, 0, 0]
                rms = np.sqrt((error**2).mean(axis=0))
                print(
                    f"  nu {nu}, {len(names)} channels, noise {level:g}: rms error of (x, y, z) "
                    + ", ".join(f"{100 * e:.2f} %" for e in rms)
                )


def section_adjoint() -> None:
    """Largest |<A t, r> - <t, A' r>| / (eps |A t| |r|) over the layouts of tests/sensing/test_operator.py (limit 50)."""
    tests = Path(__file__).resolve().parents[1] / "tests"
    sys.path[:0] = [str(tests), str(tests / "sensing")]
    from test_operator import CASES, LAYOUTS, PADS, dot_test, operator

    rng = np.random.default_rng(0)
    for dtype in (np.float64, np.float32):
        worst = max(
            (dot_test(operator(LAYOUTS[layout], boundary, pad), dtype, rng), f"{layout}, {boundary}, {pad}")
            for layout, boundary in CASES
            for pad in PADS
            for _ in range(5)
        )
        print(
            f"  {np.dtype(dtype).name}: {worst[0]:.2f} eps ({worst[1]}), {len(CASES)} layouts, {len(PADS)} pads, 5 draws"
        )


def section_decibels() -> None:
    """The founding paper's geometry at 40 dB: error of the automatic method, mean of 40 noise draws."""
    from palpate import bench

    layout = bench.LAYOUTS["line"]
    for name in ("cylinder", "punch"):
        errors = [
            bench.run(layout, name, layout.contacts[name], 1e-2, np.random.default_rng(s), ("adaptive",))[0].error
            for s in range(40)
        ]
        print(f"  {name:<10} {np.mean(errors):.3f} (worst draw {max(errors):.3f})")


def section_empty() -> None:
    """Nothing touches: 200 frames of noise and one without; force within its 95 % interval of zero, contact reported."""
    for noise in (None, 1.0):
        for name, array in (
            ("line", pp.LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"], noise=noise)),
            ("area", pp.AreaArray(shape=(20, 20), pitch=1.0, depth=2.0, channels=["stress_zz"], noise=noise)),
        ):
            skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e3, poissons_ratio=0.5), array)
            frames = np.random.default_rng(0).standard_normal((200, 1, *array.shape))
            frames = np.concatenate([frames, np.zeros((1, *frames.shape[1:]))])
            touch = skin.reconstruct(frames, components=["z"])
            low, high = (side[:, -1] for side in touch.interval(0.95, "force"))
            consistent = np.mean((low <= 0) & (high >= 0))
            print(
                f"  {name}, noise {'learned' if noise is None else 'given'}: zero in the force's interval {consistent:.3f}, "
                f"no contact reported {np.mean(~touch.touching):.3f}"
            )


def section_robust() -> None:
    """10 % dead taxels, and a contact across the array's edge: growth of the error, mean of 10 noise draws at 1 %."""
    from palpate import bench

    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    line = pp.LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"])
    area = pp.AreaArray(shape=(20, 20), pitch=1.0, depth=2.0, channels=["stress_zz"])
    contacts = {"line": bench.LAYOUTS["line"].contacts, "area": bench.LAYOUTS["area"].contacts}
    rng = np.random.default_rng(0)
    for name, array in (("line", line), ("area", area)):
        dilated = []
        whole = bench.Layout(name, pad, array, {})
        dead = [bench.Layout(name, pad, array.masked(rng.random(array.shape) > 0.1), {}) for _ in range(10)]
        for contact, traction in contacts[name].items():
            readings, truth = whole.make(traction)
            errors = []
            for layouts in ([whole] * 10, dead):
                found = []
                for draw, layout in enumerate(layouts):
                    noise = 0.01 * np.abs(readings).max() * np.random.default_rng(draw).standard_normal(readings.shape)
                    touch = layout.skin.reconstruct(readings + noise, components=["z"])
                    found.append(relative(touch.values[-1], truth[-1]))
                errors.append(float(np.mean(found)))
            dilated.append(errors[1] / errors[0])
            print(
                f"  {name:<5} {contact:<18} {errors[0]:.3f} whole, {errors[1]:.3f} with 10 % dead: x {dilated[-1]:.2f}"
            )
        print(f"  {name:<5} geometric mean x {np.exp(np.mean(np.log(dilated))):.3f}")
    for kind, width in itertools.product(("cylinder", "strip", "punch", "wedge"), (3.5, 5.0, 7.0, 10.0)):
        errors = []
        for center in (0.0, 30.0):
            layout = bench.Layout("line", pad, line, {})
            readings, truth = layout.make(bench.line_contact((kind, center, width, 1.0)))
            inside = np.abs(layout.skin.surface.x) <= 30.0
            found = []
            for draw in range(10):
                noise = 0.01 * np.abs(readings).max() * np.random.default_rng(draw).standard_normal(readings.shape)
                touch = layout.skin.reconstruct(readings + noise, components=["z"])
                found.append(np.linalg.norm((touch.values - truth)[-1][inside]) / np.linalg.norm(truth[-1][inside]))
            errors.append(float(np.mean(found)))
        print(
            f"  {kind} of half-width {width:g}: {errors[0]:.3f} in the middle, {errors[1]:.3f} inside the array when half of it "
            f"lies beyond the edge: x {errors[1] / errors[0]:.2f}"
        )
    for kind, radius in (("ball", 4.0), ("block", 3.0), ("punch", 4.0), ("ball", 6.0)):
        errors = []
        for center in (0.3, 9.3):
            layout = bench.Layout("area", pad, area, {})
            readings, truth = layout.make(bench.area_contact(bench.Patch(kind, (center, -0.2), (radius, radius))))
            inside = np.abs(layout.skin.surface.x) <= 9.5
            found = []
            for draw in range(10):
                noise = 0.01 * np.abs(readings).max() * np.random.default_rng(draw).standard_normal(readings.shape)
                touch = layout.skin.reconstruct(readings + noise, components=["z"])
                miss, true = (touch.values - truth)[-1][:, inside], truth[-1][:, inside]
                found.append(np.linalg.norm(miss) / np.linalg.norm(true))
            errors.append(float(np.mean(found)))
        print(
            f"  area {kind} of radius {radius:g}: {errors[0]:.3f} in the middle, {errors[1]:.3f} inside the array when half of "
            f"it lies beyond the edge: x {errors[1] / errors[0]:.2f}"
        )


def section_edge() -> None:
    """What an edge costs the best linear estimator: told the noise and the contact's spectrum, with the array that there is.

    The mean of the Gaussian process whose covariance is that of the true contact at a random place, 1 % noise, 10 draws.
    Its data are made on the cells that it seeks, which favours it.
    """
    from palpate import bench

    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    line = pp.LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"])
    skin = pp.Skin(pad, line, surface=pp.LineGrid(count=241, spacing=0.5))
    x, fine = skin.surface.x, pp.LineGrid(count=2410, spacing=0.05)
    unit = np.zeros((len(x), 2, len(x)))
    unit[:, 1] = np.eye(len(x))
    response = skin.sense(unit)[:, 0].T
    inside = np.abs(x) <= 30.0
    for kind, width in itertools.product(("cylinder", "strip", "punch", "wedge"), (3.5, 5.0, 7.0, 10.0)):

        def pressed(place: float, kind: str = kind, width: float = width) -> Any:
            return bench.line_contact((kind, place, width, 1.0))(fine)[-1].reshape(-1, 10).mean(axis=1)

        anywhere = np.stack([pressed(float(place)) for place in np.arange(-58.0, 58.1, 0.5)])
        covariance = anywhere.T @ anywhere / len(anywhere)
        errors = []
        for center in (0.0, 30.0):
            truth = pressed(center)
            readings = response @ truth
            size = 0.01 * np.abs(readings).max()
            spread = response @ covariance @ response.T + size**2 * np.eye(len(readings))
            estimator = covariance @ response.T @ np.linalg.inv(spread)
            found = []
            for draw in range(10):
                noisy = readings + size * np.random.default_rng(draw).standard_normal(readings.shape)
                found.append(relative((estimator @ noisy)[inside], truth[inside]))
            errors.append(float(np.mean(found)))
        print(
            f"  {kind} of half-width {width:g}: {errors[0]:.3f}, {errors[1]:.3f} at the edge: x {errors[1] / errors[0]:.2f}"
        )
    _told_where_it_ends(pad, line)
    _random_edges()


def _told_where_it_ends(pad: pp.HalfSpace, line: pp.LineArray) -> None:
    """Our estimator, told where a contact across the edge begins and ends, which no reading says."""
    from unittest.mock import patch

    from palpate import bench
    from palpate.inverse.contact.adaptive import AdaptiveEstimator

    layout = bench.Layout("line", pad, line, {})
    x = layout.skin.surface.x
    inside = np.abs(x) <= 30.0
    for kind, width in itertools.product(("wedge", "cylinder"), (3.5, 5.0)):

        def told(self: Any, *frame: Any, width: float = width) -> Any:
            return self._ensemble(np.abs(self.operator.surface.x - 30.0) < width + 0.25, *frame)

        errors = []
        for center, models in ((0.0, AdaptiveEstimator.models), (30.0, AdaptiveEstimator.models), (30.0, told)):
            readings, truth = layout.make(bench.line_contact((kind, center, width, 1.0)))
            found = []
            for draw in range(10):
                noise = 0.01 * np.abs(readings).max() * np.random.default_rng(draw).standard_normal(readings.shape)
                with patch.object(AdaptiveEstimator, "models", models):
                    touch = layout.skin.reconstruct(readings + noise, components=["z"])
                found.append(relative(touch.values[-1][inside], truth[-1][inside]))
            errors.append(float(np.mean(found)))
        print(
            f"  adaptive, {kind} of half-width {width:g}: {errors[0]:.3f} in the middle, {errors[1]:.3f} at the edge (x {errors[1] / errors[0]:.2f}), "
            f"told where it ends {errors[2]:.3f} (x {errors[2] / errors[0]:.2f})"
        )


def _random_edges() -> None:
    """Random contacts, half-widths from two depths on, across the edge and in the middle: error inside the array, four draws each."""
    from palpate import bench

    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    dilated = []
    for i in range(150):
        rng = np.random.default_rng((555, i))
        noise = float(np.exp(rng.uniform(np.log(5e-4), np.log(7e-2))))
        count, depth = int(rng.integers(80, 140)), float(rng.uniform(0.5, 2.5))
        line = pp.LineArray(count=count, pitch=0.5, depth=depth, channels=["stress_zz"])
        kind = str(rng.choice(["cylinder", "punch", "strip", "wedge", "tilted", "bump"]))
        width = float(np.exp(rng.uniform(np.log(2.0 * depth), np.log(max(9.0, 2.5 * depth)))))
        layout = bench.Layout("line", pad, line, {})
        inside = np.abs(layout.skin.surface.x) <= 0.25 * count
        errors = []
        for center in (0.0, 0.25 * count + width * float(rng.uniform(-0.8, 0.3))):
            readings, truth = layout.make(bench.line_contact((kind, center, width, 1.0)))
            found = []
            for draw in range(4):
                std = noise * np.abs(readings).max()
                noisy = readings + std * np.random.default_rng((i, draw)).standard_normal(readings.shape)
                touch = layout.skin.reconstruct(noisy, components=["z"])
                found.append(relative(touch.values[-1][inside], truth[-1][inside]))
            errors.append(float(np.mean(found)))
        dilated.append(errors[1] / errors[0])
    middle = float(np.exp(np.mean(np.log(dilated))))
    share = 100 * np.mean(np.array(dilated) <= 1.3)
    print(
        f"  150 random contacts across the edge: x {middle:.2f} (geometric mean), {share:.0f} % of them at most x 1.3"
    )


def section_crossing() -> None:
    """Coverage of the 50 and 95 % intervals where a contact crosses the array's edge, 600 random ones (line, area, area with shear)."""
    from palpate import bench
    from palpate.uncertainty import Case, calibrated

    inside: dict[tuple[Case, str], list[tuple[float, float]]] = {}
    frames: dict[Case, int] = {}
    none = np.asarray(-np.inf)
    for i in range(600):
        rng = np.random.default_rng((987, i))
        layout, traction, noise = bench.crossing(rng)
        if not layout.make(traction)[1].any():
            continue
        case = layout.case
        frames[case] = frames.get(case, 0) + 1
        for quantity, z in bench.run(layout, "random", traction, noise, rng, ("adaptive",))[0].z.items():
            known = calibrated("adaptive", case, quantity)
            ends = [known.bounds(level, np.zeros(()), np.ones(()), np.zeros(()), none) for level in (0.5, 0.95)]
            half, most = (float(np.mean((z >= low) & (z <= high))) for low, high in ends)
            inside.setdefault((case, quantity), []).append((half, most))
    for (case, quantity), parts in sorted(inside.items(), key=str):
        half, most = np.mean(parts, axis=0)
        print(f"  {case.contact:<16} {quantity:<20} {half:.2f}, {most:.2f}  ({frames[case]} frames)")


def section_channels() -> None:
    """Noise that differs between channels: error with it learned and with it given, and empty frames; parts of the largest reading."""
    from dataclasses import replace

    from palpate import bench

    layout = bench.LAYOUTS["three channels"]
    for levels in ((0.005, 0.005, 0.05), (0.05, 0.05, 0.005), (0.01, 0.01, 0.02), (0.01, 0.01, 0.01)):
        learned, told = [], []
        for name in ("sliding ball", "sticking ball", "pressed cone", "sliding block"):
            readings, truth = layout.make(layout.contacts[name])
            std = np.array(levels) * np.abs(readings).max()
            given = pp.Skin(layout.pad, replace(layout.array, noise=tuple(std)))
            for draw in range(2):
                noisy = readings + std[:, None, None] * np.random.default_rng(draw).standard_normal(readings.shape)
                touch = layout.skin.reconstruct(noisy, friction=bench.FRICTION)
                learned.append(relative(touch.values, truth))
                told.append(relative(given.reconstruct(noisy, friction=bench.FRICTION).values, truth))
        one, other = (float(np.exp(np.mean(np.log(e)))) for e in (learned, told))
        noise = np.random.default_rng(0).standard_normal((20, 3, 32, 32)) * np.array(levels)[:, None, None]
        contacts = sum(bool(layout.skin.reconstruct(f, friction=bench.FRICTION).touching) for f in noise)
        found = ", ".join(f"{100 * v:.2f}" for v in np.ravel(touch.noise_std) / np.abs(readings).max())
        print(
            f"  noise {', '.join(f'{100 * v:g}' for v in levels)} %: error {one:.3f}, with the noise given {other:.3f} (x {one / other:.2f}); "
            f"found in the last {found} %; contact reported in {contacts} of 20 empty frames"
        )


SECTIONS: dict[str, Callable[[], None]] = {
    "paper": section_paper,
    "line": section_line,
    "area": section_area,
    "contact": section_contact,
    "alva": section_alva,
    "beads": section_beads,
    "force": section_force,
    "adjoint": section_adjoint,
    "layers": section_layers,
    "layers3d": section_layers3d,
    "inversion": section_inversion,
    "alvalayers": section_alvalayers,
    "creep": section_creep,
    "sweep": section_sweep,
    "decibels": section_decibels,
    "empty": section_empty,
    "robust": section_robust,
    "edge": section_edge,
    "crossing": section_crossing,
    "channels": section_channels,
}


class Printed(io.StringIO):
    """What is printed, kept and shown at once."""

    def write(self, text: str) -> int:
        sys.__stdout__.write(text)
        sys.__stdout__.flush()
        return super().write(text)


def main() -> int:
    global SHARED
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, default=SHARED)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("sections", nargs="*", metavar="section", help=", ".join(SECTIONS))
    arguments = parser.parse_args()
    SHARED = arguments.shared
    unknown = [s for s in arguments.sections if s not in SECTIONS]
    if unknown:
        parser.error(f"no section {unknown[0]}; there are {', '.join(SECTIONS)}")
    for name in arguments.sections or SECTIONS:
        print(f"{name}: {SECTIONS[name].__doc__}")
        if (
            name not in ("paper", "force", "adjoint", "creep", "sweep", "decibels", "empty", "robust")
            and not SHARED.is_dir()
        ):
            print(f"  skipped: {SHARED} is not here")
            continue
        printed = Printed()
        with contextlib.redirect_stdout(printed):
            SECTIONS[name]()
        if arguments.write:
            WRITTEN.mkdir(exist_ok=True)
            (WRITTEN / f"{name}.txt").write_text(textwrap.dedent(printed.getvalue()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
