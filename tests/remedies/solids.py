"""Pads with sides, and pads that make their maps themselves."""

from __future__ import annotations

from typing import Any

import numpy as np

import palpate as pp
from remedies._remedy import Remedy, value

__all__ = ["REMEDIES"]


def box(**changed: Any) -> pp.SolidPad:
    given: dict[str, Any] = {"youngs_modulus": 2e5, "poissons_ratio": 0.48, "element": 1e-3, **changed}
    return pp.SolidPad.box(6e-3, 6e-3, 2e-3, **given)


def skin(array: Any = None, **given: Any) -> pp.Skin:
    if array is None:
        array = pp.AreaArray(shape=(3, 3), pitch=1e-3, depth="base", channels=["stress_zz"])
    return pp.Skin(box(), array, **given)


def wide(pitch: float) -> pp.Skin:
    return skin(pp.AreaArray(shape=(3, 3), pitch=pitch, depth="base", channels=["stress_zz"]))


REMEDIES = [
    value("poissons_ratio of a solid pad must be", lambda nu: box(poissons_ratio=nu), 0.5, 0.499),
    value("elements has about {} unknowns", lambda e: box(element=e), 2e-5, 1e-3),
    value("sensing elements lie beside the pad", wide, 5e-3, 2e-3),
    Remedy(
        "is not alike everywhere, so that no influence of one cell serves them all",
        lambda: skin().reconstruct(np.zeros((1, 3, 3)), method="dft"),
        lambda: skin().reconstruct(np.ones((1, 3, 3)), method="tikhonov"),
    ),
    Remedy(
        "ends where it ends",
        lambda: skin(boundary="periodic").sense(np.zeros((3, 3, 3))),
        lambda: skin(boundary="free").sense(np.zeros((3, 6, 6))),
    ),
]
