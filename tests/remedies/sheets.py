"""Sheets of cells and micropillars: what a refusal says that they must be."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.microscopy import Field, Pillar, cell_forces, pillar_forces, read_pillars, sheet_tension
from remedies._remedy import Remedy, command, laid, value

pytest.importorskip("skfem")
pytest.importorskip("contourpy")

__all__ = ["REMEDIES"]

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
Y, X = np.meshgrid(np.arange(16.0), np.arange(16.0), indexing="ij")
R = np.exp(-((X - 7.5) ** 2 + (Y - 7.5) ** 2) / 18)
MOVED = -np.stack([(X - 7.5) * R, (Y - 7.5) * R]) * 0.5


@lru_cache
def forces(low: int = 16, high: int = 112) -> Any:
    field = Field(displacement=0.1e-6 * MOVED, start=(4, 4), step=8.0, pixel=0.1e-6, aperture=0.8e-6)
    mask = np.zeros((128, 128), dtype=bool)
    mask[low:high, low:high] = True
    return cell_forces(field, GEL, mask=mask, method="tikhonov", draws=8)


def sheet(**options: Any) -> Any:
    return sheet_tension(forces(), draws=options.pop("draws", 8), **options)


def saved() -> None:
    np.save("u.npy", MOVED)


POST: dict[str, Any] = {"diameter": 2e-6, "height": 6e-6, "youngs_modulus": 2e6}
AT, GONE = np.zeros((2, 2)), np.full((2, 2), 1e-7)
PLAIN = "x,y,dx,dy\n0,0,1,0\n40,0,0,1\n"
SAID = "x [px],y [px],dx [px],dy [px]\n0,0,1,0\n40,0,0,1\n"


def posts() -> None:
    laid(plain_csv=PLAIN, px_csv=SAID)


RUN = (
    "tfm u.npy --pixel 0.1um --unit px --step 8 --youngs-modulus 8kPa --poissons-ratio 0.48 --method tikhonov --draws 8"
)
PILLARS = 'pillars px.csv --pixel 0.1um --height 6um --modulus "2 MPa"'

REMEDIES = [
    value("poissons_ratio of a sheet is from 0 to 0.99", lambda v: sheet(poissons_ratio=v), 1.5, 0.5),
    value("own is a part of the sheet's tension", lambda v: sheet(own=v), -1.0, 0.5),
    value("a sheet takes at least 8 draws", lambda v: sheet(draws=v), 4, 8),
    value("own picture.", lambda v: sheet(labels=v), {"1": np.ones((40, 60), dtype=bool)}, {"1": np.ones((128, 128), dtype=bool)}),
    value("give a larger mask, or vectors that lie closer", lambda v: sheet_tension(forces(*v), draws=8), (48, 64), (16, 112)),
    value("a sheet has no", lambda v: sheet()[v], "tension", "average_tension"),
    Remedy("--sheet-poissons-ratio belongs to --monolayer", command(f"{RUN} --sheet-poissons-ratio 0.5"), command(f"{RUN} --sheet-poissons-ratio 0.5 --monolayer"), given=saved),
    value("of a pillar must be a positive number", lambda v: Pillar(**{**POST, "diameter": v}), 0.0, 2e-6),
    value("poissons_ratio of a pillar is from 0 to 0.5", lambda v: Pillar(**POST, poissons_ratio=v), 0.7, 0.5),
    value("is a part of the value, from 0 to 1", lambda v: Pillar(**POST, modulus_error=v), 10.0, 0.1),
    value("positions and deflections have the shape (n, 2)", lambda v: pillar_forces(AT, v, Pillar(**POST)), GONE.T[0], GONE),
    value("deflections finite or NaN where a post was not seen", lambda v: pillar_forces(AT, v, Pillar(**POST)), GONE + np.inf, GONE),
    value("no post has a deflection", lambda v: pillar_forces(AT, v, Pillar(**POST)), GONE + np.nan, GONE),
    value("is longer than the post", lambda v: pillar_forces(AT, v, Pillar(**POST)), GONE * 1e3, GONE),
    value("noise must be a standard deviation", lambda v: pillar_forces(AT, GONE, Pillar(**POST), noise=v), -1.0, 1e-8),
    value("pillars have no", lambda v: pillar_forces(AT, GONE, Pillar(**POST))[v], "force", "mean_force"),
    Remedy("does not say the unit of the", lambda: read_pillars("plain.csv"), lambda: read_pillars("plain.csv", unit="um"), given=posts),
    Remedy("are in pixels: say the size of one", lambda: read_pillars("px.csv"), lambda: read_pillars("px.csv", pixel=1e-7), given=posts),
    Remedy("leave the unit out.", lambda: read_pillars("px.csv", unit="um", pixel=1e-7), lambda: read_pillars("px.csv", pixel=1e-7), given=posts),
    value("is no unit of the", lambda v: read_pillars("plain.csv", unit=v), "inch", "um", given=posts),
    Remedy("must not be zero; got", command(f'{PILLARS} --diameter "0 um +- 1 nm"'), command(f'{PILLARS} --diameter "2 um +- 1 nm"'), given=posts),
]  # fmt: skip
