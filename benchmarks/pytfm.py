"""The cells of tfm_images.py through pyTFM itself, on the same displacements and from the same pictures.

pyTFM (GPL) is no part of this project and is not installed with it: it runs by a Python of its own, which gets pictures and fields as files.

    python -m venv ../pytfm && ../pytfm/bin/pip install "numpy<2" "scipy<1.13" "matplotlib<3.9" natsort tqdm imageio "scikit-image<0.23" "setuptools<70"
    ../pytfm/bin/pip install --no-deps pyTFM==1.3.5 openpiv==0.23.6
    python benchmarks/pytfm.py ../pytfm/bin/python --cells 16 --pull 1500 300 --markdown docs/_generated/pytfm.md
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from tfm_images import GEL, PIXEL, fit, on_field, scene, smoothed_fttc, whole

from palpate.microscopy import Field, bead_displacements, cell_forces

#: Runs where pyTFM is: displacements and pictures in, traction and its own numbers out. Lengths in um.
INSIDE = """
import sys
import warnings

warnings.simplefilter("ignore")
import numpy as np
from pyTFM.TFM_functions import TFM_tractions, calculate_deformation, contractillity, ffttc_traction, strain_energy_points

given = np.load(sys.argv[1])
pixel, young, ratio = float(given["pixel"]), float(given["young"]), float(given["ratio"])
out = {}


def numbers(name, u, v, tx, ty, step, mask):
    energy = strain_energy_points(u, v, tx, ty, pixel, pixel * step)
    out[name + " traction"] = np.stack([tx, ty])
    out[name + " energy"] = energy[mask].sum()
    out[name + " contractility"] = contractillity(tx, ty, pixel * step, mask)[0]


u, v = given["u"]
step, mask = float(given["step"]), given["mask"]
for name, filter in (("default", None), ("3 um", 3.0)):
    numbers(name, u, v, *TFM_tractions(u, v, pixel, pixel * step, "infinite", young, sigma=ratio, fs=filter), step, mask)
numbers("none", u, v, *ffttc_traction(u, v, pixel, pixel * step, young, sigma=ratio, spatial_filter=None), step, mask)
window, step = int(given["window"]), int(given["own_step"])
u, v, _, _ = calculate_deformation(
    given["rest"].astype("int32"), given["pulled"].astype("int32"), window_size=window, overlap=window - step
)
# v of this OpenPIV has the other sign than that of 0.22, which pyTFM was written for
u, v = u - np.nanmean(u), np.nanmean(v) - v
out["own u"] = np.stack([u, v])
rows, columns = np.indices(u.shape)
middle = 0.5 * (given["rest"].shape[0] - 1)
start = 0.5 * (window - 1)
mask = np.hypot(start + step * rows - middle, start + step * columns - middle) < float(given["radius"])
out["own mask"] = mask
numbers("own", u, v, *TFM_tractions(u, v, pixel, pixel * step, "infinite", young, sigma=ratio, fs=3.0), step, mask)
np.savez(sys.argv[2], **out)
"""
#: Windows of the displacements [px], and what pyTFM's own take and how far apart.
WINDOW, OWN_WINDOW, OWN_STEP, RADIUS = 24, 32, 4, 200.0


def through(python: str, known: dict[str, Any], field: Field, inside: np.ndarray) -> dict[str, np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "given.npz", Path(folder) / "out.npz"
        np.savez(
            given,
            u=whole(field) / field.pixel,
            step=field.step,
            mask=inside,
            pixel=1e6 * PIXEL,
            young=GEL.youngs_modulus,
            ratio=GEL.poissons_ratio,
            window=OWN_WINDOW,
            own_step=OWN_STEP,
            radius=RADIUS,
            rest=known["pair"][0],
            pulled=known["pair"][1],
        )
        subprocess.run([python, "-c", INSIDE, str(given), str(out)], check=True)
        with np.load(out) as file:
            return dict(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python", help="where pyTFM is installed")
    parser.add_argument("--cells", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pull", type=float, nargs="*", default=[1500.0, 300.0], help="largest traction [Pa]")
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    lines = [
        f"Made by `python benchmarks/pytfm.py PYTHON --cells {args.cells} --pull {' '.join(f'{p:g}' for p in args.pull)}`, with pyTFM 1.3.5.",
        "",
        "| pull | displacements | traction | error | background | magnitude in adhesions | strain energy | contractility |",
        "|---" * 8 + "|",
    ]
    apart = 0.0
    for pull in args.pull:
        found: dict[tuple[str, str], list[list[float]]] = {}
        for index in range(args.cells):
            known = scene(512, args.seed + index, pull)
            field = bead_displacements(*known["pair"], pixel=PIXEL, window=WINDOW)
            forces = cell_forces(field, GEL, mask=known["outline"])
            theirs = through(args.python, known, field, forces.inside)
            own = Field(
                displacement=np.zeros_like(theirs["own u"]),  # where its vectors are; they fold on some cells
                start=(0.5 * (OWN_WINDOW - 1), 0.5 * (OWN_WINDOW - 1)),
                step=float(OWN_STEP),
                pixel=PIXEL,
            )
            same = smoothed_fttc(field, part=0.0)
            apart = max(
                apart, float(np.linalg.norm(theirs["none traction"] - same) / np.linalg.norm(theirs["none traction"]))
            )
            energy, contractility = (known["true"][k] for k in ("strain_energy", "contractility"))
            here = f"palpate, {WINDOW} px every {WINDOW // 2}"
            rows: dict[tuple[str, str], tuple[np.ndarray, Field, np.ndarray, float, float]] = {
                (here, "palpate"): (
                    forces.traction,
                    field,
                    forces.inside,
                    forces["strain_energy"].value,
                    forces["contractility"].value,
                )
            }
            for name, label in (
                ("default", "pyTFM, Gaussian of max(shape)/50"),
                ("3 um", "pyTFM, Gaussian of 3 um"),
                ("none", "pyTFM, no filter"),
            ):
                rows[here, label] = (
                    theirs[name + " traction"],
                    field,
                    forces.inside,
                    float(theirs[name + " energy"]),
                    float(theirs[name + " contractility"]),
                )
            rows[f"pyTFM, {OWN_WINDOW} px every {OWN_STEP}", "pyTFM, Gaussian of 3 um"] = (
                theirs["own traction"],
                own,
                theirs["own mask"],
                float(theirs["own energy"]),
                float(theirs["own contractility"]),
            )
            for key, (traction, of, inside, one, other) in rows.items():
                off = fit(traction, on_field(known["traction"], known["grid"], of), inside)
                found.setdefault(key, []).append([*off.values(), one / energy, other / contractility])
        for (displacements, label), parts in found.items():
            told = " | ".join(f"{v:.2f}" for v in np.mean(parts, axis=0))
            lines.append(f"| {pull:g} Pa | {displacements} | {label} | {told} |")
            print(lines[-1], flush=True)
    lines += [
        "",
        f"The formula of tfm_images.py and pyTFM's own without a filter differ by at most {apart:.1g} of the traction's norm.",
    ]
    print(lines[-1])
    if args.markdown is not None:
        args.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
