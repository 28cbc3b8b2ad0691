"""Cells of known truth, made by a closed-form model that is not this project's: a small field and the large one around it, 3 % outliers, and a pair of pictures.

python benchmarks/cells_cases.py FOLDER --markdown docs/_generated/cells_cases.md     # FOLDER holds e_u24.npy, outlier_u.npy, fov_rest_512.tif, ...
"""

from __future__ import annotations

import argparse
import ast
import re
import time
import warnings
from pathlib import Path

import palpate as pp
from palpate.microscopy import Field, bead_displacements, cell_forces, read_field, read_pair
from palpate.sensing.uncertainty import EXACT

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
PIXEL, STEP = 0.1e-6, 16
KEYS = ("strain_energy", "contractile_moment", "contractility", "traction_peak")
NAMES = ("energy", "moment", "contractility", "peak")


def truth(path: Path) -> dict[str, float]:
    """The numbers of a file that holds them as Python writes a dict."""
    found = re.search(r"\{.*\}", path.read_text())
    if found is None:
        raise SystemExit(f"{path} holds no numbers")
    return ast.literal_eval(found[0])


def cases(folder: Path) -> list[tuple[str, Field, Path, dict[str, float]]]:
    """Name, field, mask and truth of each."""
    out = []
    for name, stem, count, window in (("24 x 24", "e", "24", None), ("the same, 64 x 64", "e", "64", None), ("3 % outliers", "outlier", "", 32)):  # fmt: skip
        parts = [folder / f"{stem}_{c}{count}.npy" for c in "uv"]
        field = read_field(parts, pixel=PIXEL, unit="px", step=STEP, window=window)
        out.append(
            (name, field.without_drift(), folder / f"{stem}_mask{count}.csv", truth(folder / f"{stem}_truth.txt"))
        )
    rest, pulled = read_pair([folder / "fov_rest_512.tif", folder / "fov_pulled_512.tif"])
    for window in (16, 32):
        field = bead_displacements(rest, pulled, pixel=PIXEL, window=window)
        out.append(
            (f"pictures, windows of {window} px", field, folder / "fov_mask_512.csv", truth(folder / "fov_truth.txt"))
        )
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    lines = [
        "Made by `python benchmarks/cells_cases.py FOLDER`. Values relative to the truth, with 95 % intervals; bold if the interval does not contain the truth.",
        "",
    ]
    lines += [f"| field | vectors | {' | '.join(NAMES)} | time [s] |", "|---" * (3 + len(NAMES)) + "|"]
    for name, field, mask, known in cases(args.folder):
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            found = cell_forces(
                field, GEL, mask=mask, size=None if "pict" not in name else (512, 512), uncertainty=EXACT
            )
        seconds = time.process_time() - start
        cells = []
        for key in KEYS:
            value, low, high = (v / known[key] for v in (found[key].value, *found[key].interval))
            said = f"{value:.2f} ({low:.2f} to {high:.2f})"
            cells.append(said if low <= 1 <= high else f"**{said}**")
        lines.append(f"| {name} | {field.shape[1]} x {field.shape[0]} | {' | '.join(cells)} | {seconds:.1f} |")
        print(lines[-1], flush=True)
    if args.markdown:
        args.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
