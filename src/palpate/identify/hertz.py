"""From a round contact to the object that makes it: Hertz's and Boussinesq's relations, with the rigid base under a layer.

A ball of radius R and effective modulus E* makes a contact of radius a with F = 4 E* a^3/(3 R) and the indentation a^2/R; a flat punch of radius a
sinks by F/(2 E* a) (K. L. Johnson, Contact Mechanics, 1985, chapters 3 and 4). A pad on a base sinks less, by what its response lacks of a
half-space's. With s(k) = k u_z per pressure, and W the transform of the pressure over F,

    c_0 = F/(2 pi) int (s - 2/E*) W(k a) dk,      c_2 = F/(4 pi) int (s - 2/E*) W(k a) k^2 dk

are that part's value and its curvature in the middle of the contact, so that 1/R = 3 F/(4 E* a^3) + c_2 and the indentation is that of the half-space
plus c_0. The profile of the pressure is taken to be that on a half-space: `WIDEST` bounds how wide a contact may be for it.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats, Pad, isotropic_constants

__all__ = ["WIDEST", "layer_terms", "plane_strain_modulus"]

#: Contact radius over thickness up to which the pressure has nearly the shape that it has on a half-space: radii are then within 3 % (tests/identify/test_identify.py).
WIDEST = 0.5
#: Wavenumbers of the integrals, up to so many over the thickness: the rest is below exp(-2 LAST).
COUNT, LAST = 400, 12.0


def plane_strain_modulus(pad: Pad) -> float:
    """E/(1 - nu^2) of the material at the surface [Pa]."""
    modulus, ratio = isotropic_constants(pad, 0.0)
    return modulus / (1.0 - ratio**2)


def _lacking(pad: Pad, length: float) -> tuple[Floats, Floats, Floats]:
    """Wavenumbers, weights, and s(k) - 2/E* [1/Pa]."""
    x, weight = np.polynomial.legendre.leggauss(COUNT)
    # closer at small k
    k, weight = LAST / length * (0.5 * (x + 1.0)) ** 2, weight * LAST / length * 0.5 * (x + 1.0)
    along = np.broadcast_to(np.array([1.0, 0.0]), (COUNT, 2))
    return k, weight, pad.states(k, along, 0.0)[:, 2, 2].real - 2.0 / plane_strain_modulus(pad)


def layer_terms(pad: Pad, force: float, radius: float, shape: str) -> tuple[float, float]:
    """c_0 [m] and c_2 [1/m] of a contact of this ``radius`` [m] under a ``force`` [N]; 0 on a half-space."""
    if pad.thickness is None:
        return 0.0, 0.0
    k, weight, lacking = _lacking(pad, pad.thickness)
    x = np.maximum(k * radius, 1e-3)
    transform = np.sin(x) / x if shape == "flat" else 3.0 * (np.sin(x) - x * np.cos(x)) / x**3
    part = weight * lacking * transform
    return force / (2.0 * math.pi) * float(part.sum()), force / (4.0 * math.pi) * float((part * k**2).sum())
