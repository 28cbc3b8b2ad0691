"""Convert a round contact to the object that makes it: relations of Hertz and Boussinesq, corrected for the rigid base
under a layer.

A ball of radius R and effective modulus E* makes a contact of radius a with F = 4 E* a^3/(3 R) and the indentation
a^2/R; a flat punch of radius a sinks by F/(2 E* a) (K. L. Johnson, Contact Mechanics, 1985, chapters 3 and 4). A pad
on a base sinks less, by the difference of its response from a half-space's. With s(k) = k u_z per pressure, and W the
transform of the pressure over F,

    c_0 = F/(2 pi) int (s - 2/E*) W(k a) dk,      c_2 = F/(4 pi) int (s - 2/E*) W(k a) k^2 dk

are the value of that difference and its curvature in the middle of the contact, so that 1/R = 3 F/(4 E* a^3) + c_2,
and the indentation is that of the half-space plus c_0. The profile of the pressure is assumed to be that on a
half-space; `WIDEST` limits the width of a contact for this.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats, Pad, isotropic_constants

__all__ = ["WIDEST", "layer_terms", "plane_strain_modulus"]

#: Largest ratio of contact radius to thickness for which the pressure has nearly the same shape as on a half-space:
#: radii are then within 3 % (tests/identify/test_identify.py).
WIDEST = 0.5
#: Number of wavenumbers of the integrals, and the largest one times the thickness: what lies beyond is below exp(-2
#: LAST).
COUNT, LAST = 400, 12.0


def plane_strain_modulus(pad: Pad) -> float:
    """Return E/(1 - nu^2) [Pa] of the material at the surface."""
    modulus, ratio = isotropic_constants(pad, 0.0)
    return modulus / (1.0 - ratio**2)


def _lacking(pad: Pad, length: float) -> tuple[Floats, Floats, Floats]:
    """Return wavenumbers, weights, and s(k) - 2/E* [1/Pa]."""
    x, weight = np.polynomial.legendre.leggauss(COUNT)
    # nodes are denser at small k
    k, weight = LAST / length * (0.5 * (x + 1.0)) ** 2, weight * LAST / length * 0.5 * (x + 1.0)
    along = np.broadcast_to(np.array([1.0, 0.0]), (COUNT, 2))
    return k, weight, pad.states(k, along, 0.0)[:, 2, 2].real - 2.0 / plane_strain_modulus(pad)


def layer_terms(pad: Pad, force: float, radius: float, shape: str) -> tuple[float, float]:
    """Return c_0 [m] and c_2 [1/m] of a contact of this ``radius`` [m] under a ``force`` [N]; 0 on a half-space."""
    if pad.thickness is None:
        return 0.0, 0.0
    k, weight, lacking = _lacking(pad, pad.thickness)
    x = np.maximum(k * radius, 1e-3)
    transform = np.sin(x) / x if shape == "flat" else 3.0 * (np.sin(x) - x * np.cos(x)) / x**3
    part = weight * lacking * transform
    return force / (2.0 * math.pi) * float(part.sum()), force / (4.0 * math.pi) * float((part * k**2).sum())
