"""PyTorch's layers; what a refusal says that they must be."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

import palpate as pp
from palpate.torch import Reconstruct, Sense
from remedies._remedy import value

__all__ = ["REMEDIES"]

SKIN = pp.Skin(
    pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
    pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=20.0),
)
READINGS = np.asarray(SKIN.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.2)))


def curvature(constrained: bool) -> Any:
    """The second derivative of a sum of squares along the readings."""
    layer = Reconstruct(SKIN, parameter=1e-4, constrained=constrained)
    readings = torch.as_tensor(READINGS, dtype=torch.float64).requires_grad_()
    (first,) = torch.autograd.grad((layer(readings) ** 2).sum(), readings, create_graph=True)
    return torch.autograd.grad(first.sum(), readings)


REMEDIES = [
    value("the constrained inverse has only first derivatives", curvature, True, False),
    value(
        "must be a tensor of float32 or float64",
        lambda v: Sense(SKIN)(v),
        np.zeros((3, *SKIN.surface.shape)),
        torch.as_tensor(np.zeros((3, *SKIN.surface.shape)), dtype=torch.float64),
    ),
    value(
        "friction belongs to the constrained problem: leave",
        lambda v: Reconstruct(SKIN, parameter=1e-4, **v),
        {"friction": 0.5, "constrained": False},
        {"friction": 0.5},
    ),
]
