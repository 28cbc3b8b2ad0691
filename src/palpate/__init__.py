"""palpate recovers what touches an elastic pad from what is measured inside or under it.

Pressure and shear on the surface, net force and slip margin, from stress, strain or displacement at depth.
SI units throughout; compression positive; z grows into the pad.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

#: Public name -> module that holds it. Loaded on first use, so that importing palpate stays light.
_PUBLIC = {
    "AREA_CHANNELS": "elastic",
    "AreaArray": "sensing",
    "AreaGrid": "sensing",
    "BondedLayers": "elastic",
    "HalfSpace": "elastic",
    "InvalidInput": "errors",
    "LINE_CHANNELS": "elastic",
    "Layer": "elastic",
    "LineArray": "sensing",
    "LineGrid": "sensing",
    "Adaptive": "inverse",
    "AnalogNetwork": "inverse",
    "Automatic": "inverse",
    "ConstantFriction": "inverse",
    "Constrained": "inverse",
    "Division": "inverse",
    "ElasticNet": "inverse",
    "Hilgers": "inverse",
    "LinearSystem": "inverse",
    "Local": "inverse",
    "MaximumEntropy": "inverse",
    "Measured": "measured",
    "Method": "inverse",
    "NonNegative": "inverse",
    "Tikhonov": "inverse",
    "TotalVariation": "inverse",
    "Truncated": "inverse",
    "Wiener": "inverse",
    "methods": "inverse",
    "register": "inverse",
    "reconstruct_recording": "archives",
    "NotObservable": "errors",
    "PalpateError": "errors",
    "Recording": "recordings",
    "ScatteredArray": "sensing",
    "Uncertainty": "sensing",
    "GraspMonitor": "grasp",
    "Skin": "skin",
    "SolidPad": "solid",
    "Status": "status",
    "Touch": "touch",
    "Tracker": "tracking",
    "Unsupported": "errors",
    "Viscoelastic": "elastic",
    "stress_from_strains": "elastic",
}

if TYPE_CHECKING:
    from palpate import solutions
    from palpate.archives import reconstruct_recording
    from palpate.elastic import (
        AREA_CHANNELS,
        LINE_CHANNELS,
        BondedLayers,
        HalfSpace,
        Layer,
        Viscoelastic,
        stress_from_strains,
    )
    from palpate.errors import InvalidInput, NotObservable, PalpateError, Unsupported
    from palpate.grasp import GraspMonitor
    from palpate.inverse import (
        Adaptive,
        AnalogNetwork,
        Automatic,
        ConstantFriction,
        Constrained,
        Division,
        ElasticNet,
        Hilgers,
        LinearSystem,
        Local,
        MaximumEntropy,
        Method,
        NonNegative,
        Tikhonov,
        TotalVariation,
        Truncated,
        Wiener,
        methods,
        register,
    )
    from palpate.measured import Measured
    from palpate.recordings import Recording
    from palpate.sensing import AreaArray, AreaGrid, LineArray, LineGrid, ScatteredArray
    from palpate.skin import Skin
    from palpate.solid import SolidPad
    from palpate.status import Status
    from palpate.touch import Touch
    from palpate.tracking import Tracker

__all__ = [
    "AREA_CHANNELS",
    "LINE_CHANNELS",
    "Adaptive",
    "AnalogNetwork",
    "AreaArray",
    "AreaGrid",
    "Automatic",
    "BondedLayers",
    "ConstantFriction",
    "Constrained",
    "Division",
    "ElasticNet",
    "GraspMonitor",
    "HalfSpace",
    "Hilgers",
    "InvalidInput",
    "Layer",
    "LineArray",
    "LineGrid",
    "LinearSystem",
    "Local",
    "MaximumEntropy",
    "Measured",
    "Method",
    "NonNegative",
    "NotObservable",
    "PalpateError",
    "Recording",
    "ScatteredArray",
    "Skin",
    "SolidPad",
    "Status",
    "Tikhonov",
    "TotalVariation",
    "Touch",
    "Tracker",
    "Truncated",
    "Uncertainty",
    "Unsupported",
    "Viscoelastic",
    "Wiener",
    "__version__",
    "methods",
    "reconstruct_recording",
    "register",
    "solutions",
    "stress_from_strains",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        value = getattr(importlib.import_module(f"palpate.{_PUBLIC[name]}"), name)
        globals()[name] = value
        return value
    if name == "solutions":
        return importlib.import_module("palpate.solutions")
    raise AttributeError(f"module 'palpate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
