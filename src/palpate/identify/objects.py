"""Compute properties of the object from a fitted contact, with intervals: patches, radius, modulus and stiffness."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.identify.findings import Finding, Identified, Patch
from palpate.identify.fitting import Fit
from palpate.identify.frame import Body, Frame
from palpate.identify.hertz import WIDEST, layer_terms, plane_strain_modulus, stiffness, surface_thickness
from palpate.identify.shapes import BALL, FLAT

__all__ = ["NORMAL", "Contact", "contact", "contact_findings", "identified", "modulus_std"]

#: Half-width of a 95 % interval in standard deviations, for the uncertainty of pad and sensors.
NORMAL = 1.96
#: The reason given for a quantity that needs the indentation.
NO_DEPTH = "pressure alone cannot distinguish a soft object from a hard one of another radius: give indentation=, the distance that it has moved into the pad"
RIGID = "the object is taken to be much stiffer than the pad"


def identified(frame: Frame) -> Identified:
    """Return the properties of the object (`Identified`) from the fit of a frame."""
    best = frame.best
    if best is None:
        out = Identified.nothing(frame.reason)
        if not frame.guesses:
            return out
        count = Finding(float(len(frame.guesses)), unit="1", reason=frame.reason)
        unknown = (out.radius, out.modulus, out.effective_modulus, out.stiffness, out.texture, out.texture_wavelength)
        return Identified("", frame.reason, frame.guesses, count, *unknown, frame.misfit)
    order = np.argsort(-best.forces[:, -1])
    patches = tuple(_patch(frame, int(i)) for i in order)
    count = Finding(float(len(patches)), unit="1")
    if len(patches) > 1:
        many = f"{len(patches)} patches touch the pad: this number is defined for a single patch"
        none = [Finding.unknown(u, many) for u in ("m", "Pa", "Pa", "N/m", "1", "m")]
        return Identified("", many, patches, count, none[0], none[1], none[2], none[3], none[4], none[5], frame.misfit)
    waves = (Finding.unknown("1", "no wave was sought"), Finding.unknown("m", "no wave was sought"))
    if frame.texture is not None:
        waves = (frame.texture.power, frame.texture.wavelength)
    told = contact_findings(contact(frame))
    if not frame.shape:
        as_if = "" if not told[0].known else f"; as a {best.shape} it would be {told[0]}"
        radius, modulus, effective = (
            Finding.unknown(f.unit, f"{frame.shape_reason}{more}") for f, more in zip(told[:3], (as_if, "", ""))
        )
        told = (radius, modulus, effective, told[3])
    return Identified(frame.shape, frame.shape_reason, patches, count, *told, *waves, frame.misfit)


# -- patches ---------------------------------------------------------------------------------------------------------------


def _patch(frame: Frame, i: int) -> Patch:
    best = _best(frame)
    forces = []
    for name in ("x", "y", "z"):
        if name not in frame.components:
            forces.append(Finding.unknown("N", f"force along {name} was not estimated"))
            continue
        c = frame.components.index(name)
        value = float(best.forces[i, c])
        shifted = sum((s * (float(f.forces[i, c]) - value)) ** 2 for f, s in frame.shifts)
        more = shifted + (frame.body.uncertainty.common(frame.body.planes) * value) ** 2
        half = math.hypot(frame.quantile * best.std("force", i, c), NORMAL * math.sqrt(more))
        forces.append(Finding(value, value - half, value + half, "N"))
    places = []
    for axis in range(2):
        value = float(best.centers[i, axis])
        more = sum((s * (float(f.centers[i, axis]) - value)) ** 2 for f, s in frame.shifts)
        half = math.hypot(frame.quantile * best.std("center", i, axis), NORMAL * math.sqrt(more))
        places.append(Finding(value, value - half, value + half, "m"))
    radius = _contact_radius(frame, i)
    area = Finding(math.pi * radius.value**2, math.pi * radius.low**2, math.pi * radius.high**2, "m^2", radius.reason)
    return Patch((forces[0], forces[1], forces[2]), (places[0], places[1]), area, radius)


def _contact_radius(frame: Frame, i: int) -> Finding:
    best, (low, high, _) = _best(frame), frame.profiles[i]
    value = float(best.radii[i])
    more = NORMAL * math.sqrt(sum((s * math.log(float(f.radii[i]) / value)) ** 2 for f, s in frame.shifts))
    low = value * math.exp(-math.hypot(math.log(value / low), more)) if low > 0 else 0.0
    high = value * math.exp(math.hypot(math.log(high / value), more)) if math.isfinite(high) else math.inf
    if low == 0.0:
        return Finding.unknown(
            "m", f"contacts of up to {1e3 * high:.2g} mm in radius give the same readings", low=low, high=high
        )
    if math.isinf(high):
        return Finding.unknown(
            "m", f"it is at least {1e3 * low:.2g} mm, and reaches beyond what is measured", low=low, high=high
        )
    return Finding(value, low, high, "m")


def _best(frame: Frame) -> Fit:
    if frame.best is None:
        raise ValueError("nothing was fitted")
    return frame.best


# -- the object ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Contact:
    """One round contact with its uncertainty.

    ``radius`` [m], ``force`` [N]. ``ends`` are pairs of both at the ends of the interval (None if an end does not
    exist). ``shifts`` are pairs of both with a varied description of the pad, and the standard deviation of the
    variation divided by the change made. ``std`` are standard deviations of log radius and log force due to noise
    alone, ``quantile`` the factor for an interval.
    """

    body: Body
    shape: str
    radius: float
    force: float
    ends: tuple[tuple[float, float] | None, tuple[float, float] | None]
    shifts: tuple[tuple[float, float, float], ...]
    std: tuple[float, float]
    quantile: float
    depth: float


def contact(frame: Frame) -> Contact:
    """Return the first and only contact of a frame."""
    best, (low, high, fits) = _best(frame), frame.profiles[0]
    ends: list[tuple[float, float] | None] = []
    for end in (low, high):
        if end == 0.0 or math.isinf(end) or not fits:
            ends.append(None)
            continue
        near = min(fits, key=lambda f: abs(math.log(float(f.radii[0]) / end)))
        ends.append((end, float(near.forces[0, -1])))
    shifts = tuple((float(f.radii[0]), float(f.forces[0, -1]), s) for f, s in frame.shifts)
    force = float(best.forces[0, -1])
    std = (best.std("radius", 0), best.std("force", 0, len(frame.components) - 1) / force)
    return Contact(
        frame.body,
        best.shape,
        float(best.radii[0]),
        force,
        (ends[0], ends[1]),
        shifts,
        std,
        frame.quantile,
        frame.depth,
    )


def contact_findings(found: Contact) -> tuple[Finding, Finding, Finding, Finding]:
    """Return radius, modulus of the object, effective modulus and stiffness."""
    why = _unrelated(found)
    if why:
        radius = _sized(found, lambda a, f: a) if found.shape == FLAT else Finding.unknown("m", why)
        none = [Finding.unknown(u, why) for u in ("Pa", "Pa", "N/m")]
        return radius, none[0], none[1], none[2]
    effective, modulus = _moduli(found)
    return _radius(found), modulus, effective, _stiffness(found)


def _unrelated(found: Contact) -> str:
    """Return why Hertz's relations do not hold for a contact on this pad; "" if they do."""
    pad = found.body.pad
    if not getattr(pad, "modelled", True):
        return f"it follows from the modulus and thickness of the pad, and a {type(pad).__name__} states neither"
    first = surface_thickness(pad)
    if first is None or found.radius <= WIDEST * first:
        return ""
    of = "thickness" if first == pad.thickness else "uppermost material's thickness"
    return f"the contact is {found.radius / first:.2g} of the pad's {of} in radius, and Hertz's relations hold up to {WIDEST:g}: press less"


def _radius(found: Contact) -> Finding:
    if found.shape == FLAT:
        return _sized(found, lambda a, f: a)
    if math.isfinite(found.depth):
        return _sized(found, lambda a, f: 1.0 / _curvature(found, a, f))
    # force from stress does not need the modulus; force from strain and displacement is proportional to it, so that
    # force/modulus does not depend on it
    shared = modulus_std(found)
    out = _sized(found, lambda a, f: 1.0 / max(_curvature(found, a, f), 1e-12), more=shared)
    return Finding(out.value, out.low, out.high, out.unit, out.reason or RIGID)


def modulus_std(found: Contact) -> float:
    """Return the standard deviation of log(E*/F) due to the errors of modulus and scale."""
    uncertainty, planes = found.body.uncertainty, found.body.planes
    follows = uncertainty.common(planes) > uncertainty.scale
    return math.hypot(uncertainty.scale, 0.0 if follows else uncertainty.modulus)


def _curvature(found: Contact, radius: float, force: float) -> float:
    """Return the curvature 1/R [1/m] of a ball."""
    pad = found.body.pad
    c_0, c_2 = layer_terms(pad, force, radius, BALL)
    if math.isfinite(found.depth):
        return max(found.depth - c_0, 1e-12) / radius**2 + c_2
    return 3.0 * force / (4.0 * plane_strain_modulus(pad) * radius**3) + c_2


def _sized(found: Contact, of: Callable[[float, float], float], *, more: float = 0.0) -> Finding:
    """Length that is a function ``of`` (contact radius, force), with its interval from the ends of the profile."""
    value = of(found.radius, found.force)
    shifted = sum((s * math.log(of(a, f) / value)) ** 2 for a, f, s in found.shifts)
    extra = NORMAL * math.sqrt(shifted + more**2)
    sides = []
    for end, open_end in zip(found.ends, (0.0, math.inf)):
        if end is None:
            sides.append(open_end)
            continue
        there = math.log(of(*end) / value)
        sides.append(value * math.exp(math.copysign(math.hypot(there, extra), there)))
    low, high = min(sides), max(sides)
    if low == 0.0:
        return Finding.unknown(
            "m",
            f"the contact is too small for these taxels: a radius of up to {1e3 * high:.2g} mm gives the same readings",
            low=low,
            high=high,
        )
    if math.isinf(high):
        return Finding.unknown(
            "m", f"at least {1e3 * low:.2g} mm: the contact reaches beyond what is measured", low=low, high=high
        )
    return Finding(value, low, high, "m")


def _moduli(found: Contact) -> tuple[Finding, Finding]:
    """Return the effective modulus, and the modulus of the object."""
    if not math.isfinite(found.depth):
        return Finding.unknown("Pa", NO_DEPTH), Finding.unknown("Pa", NO_DEPTH)
    if not found.depth > 0:
        none = Finding.unknown("Pa", "the indentation is 0")
        return none, none
    pad, uncertainty = found.body.pad, found.body.uncertainty
    factor = 0.75 if found.shape == BALL else 0.5

    def effective(a: float, f: float) -> float:
        return factor * f / (a * max(found.depth - layer_terms(pad, f, a, found.shape)[0], 1e-12))

    value = effective(found.radius, found.force)
    shifted = sum((s * math.log(effective(a, f) / value)) ** 2 for a, f, s in found.shifts)
    # errors of radius and force due to noise are assumed independent
    noise = (found.quantile / NORMAL) ** 2 * (found.std[0] ** 2 + found.std[1] ** 2)
    std = math.sqrt(shifted + noise + uncertainty.common(found.body.planes) ** 2)
    low, high = value * math.exp(-NORMAL * std), value * math.exp(NORMAL * std)
    both = Finding(value, low, high, "Pa")
    pads = plane_strain_modulus(pad)
    softness = 1.0 / value - 1.0 / pads
    # force from strain or displacement is proportional to the pad's modulus, and so is the effective modulus
    follows = uncertainty.common(found.body.planes) > uncertainty.scale
    apart = math.hypot(
        math.sqrt(shifted + noise + uncertainty.scale**2) / value, 0.0 if follows else uncertainty.modulus / pads
    )
    if follows:
        apart = math.hypot(apart, uncertainty.modulus * abs(softness))
    least, most = softness - NORMAL * apart, softness + NORMAL * apart
    if least <= 0:
        bound = 1.0 / most if most > 0 else math.nan
        reason = (
            f"the object may be rigid: its modulus is at least {1e-3 * bound:.3g} kPa"
            if most > 0
            else "the indentation is smaller than the pad alone would give: check indentation, modulus and units"
        )
        return both, Finding.unknown("Pa", reason, low=bound, high=math.inf)
    return both, Finding(1.0 / softness, 1.0 / most, 1.0 / least, "Pa")


def _stiffness(found: Contact) -> Finding:
    """Return dF/d(indentation), 2 E* a on a half-space (G. M. Pharr, W. C. Oliver, F. R. Brotzen, J. Mater. Res. 7,
    1992, 613), corrected for a base.
    """
    pad = found.body.pad
    known = math.isfinite(found.depth)
    modulus = _moduli(found)[0].value if known else plane_strain_modulus(pad)
    uncertainty = found.body.uncertainty

    def rises(a: float, f: float) -> float:
        return stiffness(pad, modulus, f, a, found.shape)

    value = rises(found.radius, found.force)
    shifted = sum((s * math.log(rises(a, f) / value)) ** 2 for a, f, s in found.shifts)
    extra = NORMAL * math.sqrt(shifted + uncertainty.modulus**2)
    if found.ends[0] is None or found.ends[1] is None:
        return Finding.unknown("N/m", "the readings do not determine the size of the contact")
    low, high = (math.hypot(math.log(rises(*end) / value), extra) for end in (found.ends[0], found.ends[1]))
    return Finding(value, value * math.exp(-low), value * math.exp(high), "N/m", "" if known else RIGID)
