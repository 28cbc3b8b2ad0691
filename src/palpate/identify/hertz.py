"""Convert a round contact to the object that makes it: relations of Hertz and Boussinesq, corrected for the rigid base
under a layer.

A ball of radius R and effective modulus E* makes a contact of radius a with F = 4 E* a^3/(3 R) and the indentation
a^2/R; a flat punch of radius a sinks by F/(2 E* a) (K. L. Johnson, Contact Mechanics, 1985, chapters 3 and 4). A pad
on a base sinks less, by the difference of its response from a half-space's. With s(k) = k u_z per pressure, and W the
transform of the pressure over F,

    c_0 = F/(2 pi) int (s - 2/E*) W(k a) dk,      c_2 = F/(4 pi) int (s - 2/E*) W(k a) k^2 dk

are the value of that difference and its curvature in the middle of the contact, so that 1/R = 3 F/(4 E* a^3) + c_2,
and the indentation is that of the half-space plus c_0. The profile of the pressure is assumed to be that on a
half-space; `WIDEST` limits the width of a contact for this. The stiffness dF/d(indentation) of a ball is the ratio of
the derivatives of both along a growing contact.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats, Pad, isotropic_constants

__all__ = ["WIDEST", "layer_terms", "plane_strain_modulus", "stiffness", "surface_thickness"]

#: Largest ratio of contact radius to the thickness of the uppermost material for which the pressure has nearly the same
#: shape as on a half-space: radii are then within 3 % (tests/identify/test_identify.py).
WIDEST = 0.5
#: Largest wavenumber of the integrals times the thickness of the uppermost material: what lies beyond is below exp(-2
#: LAST). Smallest edge of their panels times the thickness of the pad, ratio of edges, and nodes per panel.
LAST, LEAST, GROWTH, NODES = 12.0, 0.1, 1.5, 24
#: Step of the log of a contact radius for derivatives.
STEP = 1e-3


def plane_strain_modulus(pad: Pad) -> float:
    """Return E/(1 - nu^2) [Pa] of the material at the surface."""
    modulus, ratio = isotropic_constants(pad, 0.0)
    return modulus / (1.0 - ratio**2)


def surface_thickness(pad: Pad) -> float | None:
    """Return the thickness [m] of the uppermost material; None for a half-space."""
    found = getattr(pad, "surface_thickness", pad.thickness)
    return None if found is None else float(found)


def _lacking(pad: Pad, first: float, whole: float) -> tuple[Floats, Floats, Floats]:
    """Return wavenumbers, weights, and s(k) - 2/E* [1/Pa], for an uppermost material ``first`` thick on a pad ``whole``
    thick.
    """
    least, last = LEAST / whole, LAST / first
    edges = np.geomspace(least, last, 1 + math.ceil(math.log(last / least) / math.log(GROWTH)))
    low, high = np.append(0.0, edges[:-1])[:, None], edges[:, None]
    x, weight = np.polynomial.legendre.leggauss(NODES)
    k, weight = (0.5 * (low + high) + 0.5 * (high - low) * x).ravel(), (0.5 * (high - low) * weight).ravel()
    along = np.broadcast_to(np.array([1.0, 0.0]), (len(k), 2))
    return k, weight, pad.states(k, along, 0.0)[:, 2, 2].real - 2.0 / plane_strain_modulus(pad)


def layer_terms(pad: Pad, force: float, radius: float, shape: str) -> tuple[float, float]:
    """Return c_0 [m] and c_2 [1/m] of a contact of this ``radius`` [m] under a ``force`` [N]; 0 on a half-space."""
    first = surface_thickness(pad)
    if first is None or pad.thickness is None:
        return 0.0, 0.0
    k, weight, lacking = _lacking(pad, first, pad.thickness)
    x = np.maximum(k * radius, 1e-3)
    transform = np.sin(x) / x if shape == "flat" else 3.0 * (np.sin(x) - x * np.cos(x)) / x**3
    part = weight * lacking * transform
    return force / (2.0 * math.pi) * float(part.sum()), force / (4.0 * math.pi) * float((part * k**2).sum())


def stiffness(pad: Pad, modulus: float, force: float, radius: float, shape: str) -> float:
    """Return dF/d(indentation) [N/m] of a contact: 2 E* a on a half-space, E* being ``modulus`` [Pa]."""
    if shape == "flat":
        return 1.0 / (1.0 / (2.0 * modulus * radius) + layer_terms(pad, force, radius, shape)[0] / force)
    pressed = []
    for a in (radius * math.exp(-STEP), radius * math.exp(STEP)):
        c_0, c_2 = (c / force for c in layer_terms(pad, force, a, shape))
        # the force is 1/R over the first, the indentation the force times the second
        pressed.append((3.0 / (4.0 * modulus * a**3) + c_2, 3.0 / (4.0 * modulus * a) + c_0))
    less, more = (np.array([1.0, sinks]) / bends for bends, sinks in pressed)
    return float((more[0] - less[0]) / (more[1] - less[1]))
