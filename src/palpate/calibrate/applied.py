"""Apply a calibration to a skin: modulus, thickness, depth, places, and the standard deviations of forces and gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.calibrate.constants import REJECTED, PadConstants, model_of
from palpate.calibrate.labels import SCALE_STD
from palpate.elastic import BondedLayers
from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Floats
from palpate.sensing.arrays import AreaArray
from palpate.sensing.grids import pair
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["reading_gains", "with_constants", "with_force_scale"]

#: Relative standard deviations are limited to this value: `palpate.Uncertainty` needs less than 1.
LARGEST_STD = 0.99


def with_constants(skin: Any, found: PadConstants | None) -> Any:
    """Return the skin with the fitted modulus, thickness, depth and pixel scale, and with their standard deviations as
    its `palpate.Uncertainty`.

    Force from a displacement is proportional to modulus times pixel scale squared (half-space: F ~ E u L), so that the
    modulus gets the standard deviation of this product, correlation included. Gains are not applied here
    (`reading_gains` divides readings by them); only their standard deviation is stated.

    If the presses favour another pad model than the skin's, or if the model was rejected, the skin is returned
    unchanged.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.calibrate import PadConstants, with_constants
    >>> found = PadConstants("half-space", ("depth",), np.array([2.2e-3]), np.array([[4e-4]]), np.array([0.2]), {"half-space": 0.0}, 1.0)
    >>> array = pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=2e-3, channels=["stress_zz"])
    >>> skin = with_constants(pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array), found)
    >>> skin.planes[0].depth, skin.uncertainty.depth
    (0.0022, 0.02)
    """
    if found is None or not fits(skin, found):
        return skin
    told = {n: (float(v), min(float(s), LARGEST_STD)) for n, v, s in zip(found.names, found.values, found.std)}
    pad, plane = skin.pad, skin.planes[0]
    top = pad.layers[0] if isinstance(pad, BondedLayers) else pad
    stretch = told["thickness"][0] / pad.thickness if "thickness" in told and pad.thickness else 1.0
    stiffer = told["youngs_modulus"][0] / top.youngs_modulus if "youngs_modulus" in told else 1.0
    depth = told["depth"][0] if "depth" in told else float(plane.depth)
    if isinstance(pad, BondedLayers):
        if math.isclose(float(plane.depth), pad.thickness):
            depth = pad.thickness * stretch
        layers = [replace(one, thickness=one.thickness * stretch, youngs_modulus=one.youngs_modulus * stiffer) for one in pad.layers]  # fmt: skip
        base = pad.base and replace(pad.base, youngs_modulus=pad.base.youngs_modulus * stiffer)
        pad = BondedLayers(layers, base=base)
        depth = min(depth, pad.thickness)
    else:
        pad = replace(pad, youngs_modulus=pad.youngs_modulus * stiffer)
    known: dict[str, float] = {n: told[n][1] for n in ("youngs_modulus", "thickness", "depth") if n in told}
    if "pixel_scale" in told:
        of_force = np.array([{"youngs_modulus": 1.0, "pixel_scale": 2.0}.get(n, 0.0) for n in found.names])
        known["youngs_modulus"] = min(math.sqrt(float(of_force @ found.covariance @ of_force)), LARGEST_STD)
    gains = [s for n, s in zip(found.names, found.std) if n.startswith("gain")]
    if gains:
        known["gain"] = min(float(np.sqrt(np.mean(np.square(gains)))), LARGEST_STD)
    factor = (
        found.pixel_scale * found.span / float(np.ptp(plane.points, axis=0).max()) if "pixel_scale" in told else 1.0
    )
    return _restated(skin, pad, [replace(_scaled(plane, factor), depth=depth)], known, same_places=factor == 1.0)


def with_force_scale(skin: Any, relative: float) -> Any:
    """State how accurately the factor is known that turns readings into pascals (or displacements into newtons) and
    that was fitted to known forces.

    ``relative`` is the standard deviation of a single press about that factor, combined with that of the factor. The
    factor also corrects a wrong modulus, so that the modulus gets a standard deviation of 0.
    """
    known = {"scale": min(math.hypot(relative, SCALE_STD), LARGEST_STD)}
    own = getattr(skin.pad, "uncertainty", None)  # a measured pad has no modulus and thus no uncertainty of its own
    if not isinstance(own, Uncertainty) and any(channel_unit(c) != "Pa" for p in skin.planes for c in p.channels):
        known["youngs_modulus"] = 0.0
    return _restated(skin, skin.pad, skin.planes, known, same_places=True)


def reading_gains(skin: Any, found: PadConstants | None) -> Floats | None:
    """Return the fitted gain of each reading (reading,); None if gains were not fitted, or if the pad model was
    rejected.
    """
    if found is None or not fits(skin, found):
        return None
    at = [i for i, n in enumerate(found.names) if n.startswith("gain")]
    return found.values[at] if at else None


def fits(skin: Any, found: PadConstants) -> bool:
    """Return whether the constants belong to this skin's pad model, and the presses do not reject that model."""
    return found.misfit <= REJECTED and found.model == model_of(skin.pad)


def _scaled(plane: Any, factor: float) -> Any:
    """Return the plane with all its positions multiplied by a factor."""
    if factor == 1.0:
        return plane
    if isinstance(plane, AreaArray):
        (a, b), (y, x) = pair("pitch", plane.pitch), plane.center
        return replace(plane, pitch=(factor * a, factor * b), center=(factor * y, factor * x))
    return replace(plane, positions=factor * np.asarray(plane.positions))


def _restated(skin: Any, pad: Any, planes: Sequence[Any], known: dict[str, float], *, same_places: bool) -> Any:
    """Return the skin with another pad, other planes and another uncertainty. The surface is kept, unless the
    positions changed and the surface was chosen automatically.
    """
    problem, keep = skin._problem, same_places or skin._given
    out = type(skin)(
        pad, planes, surface=skin.surface if keep else None, boundary=skin._boundary,
        nuisance="auto" if problem.nuisance is None else problem.nuisance, uncertainty=replace(problem.uncertainty, **known),
    )  # fmt: skip
    out._given = out._problem.fixed = skin._given
    out._problem.zeroed = problem.zeroed
    # the array at the positions of all taxels, missing ones included, and at the fitted depth
    out._whole = (
        [replace(w, depth=p.depth) for w, p in zip(skin._whole, planes, strict=True)] if same_places else out._planes
    )
    return out
