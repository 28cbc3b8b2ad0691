"""Change a pad and its array to make a candidate of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Pad
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.uncertainty import stretched

__all__ = ["VARIED", "varied"]

#: Variables of a design.
VARIED = ("depth", "thickness", "youngs_modulus", "pitch", "shape", "aperture", "channels", "noise")


def varied(
    pad: Pad, planes: Sequence[Array], changes: Mapping[str, Any], *, keep: str
) -> tuple[Pad, tuple[Array, ...]]:
    """Return pad and planes with ``changes`` made, in the order of `VARIED`. If the pitch changes, ``keep`` ("taxels"
    or "area") says what stays constant.

    Raises
    ------
    InvalidInput
        An unknown change, or an implausible value.
    Unsupported
        A change that is impossible for this pad or array.
    """
    unknown = [name for name in changes if name not in VARIED]
    if unknown:
        raise InvalidInput(f"a sweep cannot vary {unknown[0]}; it can vary {', '.join(VARIED)}.")
    if len(planes) > 1 and set(changes) - {"thickness", "youngs_modulus"}:
        raise Unsupported(
            f"this skin has {len(planes)} planes, and a sweep varies the array of one. Vary thickness or youngs_modulus, or write one file for each design and rank them together."
        )
    planes = tuple(planes)
    if "thickness" in changes:
        if not isinstance(pad, BondedLayers):
            raise Unsupported(
                f'thickness belongs to bonded layers, and this pad is a {type(pad).__name__}. Leave thickness out, or take a pad of kind "bonded_layers".'
            )
        pad, planes = stretched(pad, planes, thickness=changes["thickness"] / float(pad.thickness or 1.0))
    if "youngs_modulus" in changes:
        pad = _stiffer(pad, changes["youngs_modulus"])
    array = planes[0]
    if "depth" in changes:
        array = replace(array, depth=changes["depth"]).at_base(pad.thickness)
    if "shape" in changes:
        array = _of_shape(array, changes["shape"])
    if "pitch" in changes:
        array = _of_pitch(array, changes["pitch"], keep)
    if "aperture" in changes:
        array = replace(array, aperture=changes["aperture"])
    if "channels" in changes:
        array = _measuring(array, changes["channels"])
    if "noise" in changes:
        array = _with_noise(array, changes["noise"])
    planes = (array, *planes[1:])
    for plane in planes:
        pad.compliance(plane.depth)  # raises an error for a depth below a rigid base
    return pad, planes


def _stiffer(pad: Pad, modulus: float) -> Pad:
    if isinstance(pad, HalfSpace):
        return replace(pad, youngs_modulus=modulus)
    if isinstance(pad, BondedLayers):
        ratio = modulus / pad.layers[0].youngs_modulus
        return BondedLayers(
            [replace(layer, youngs_modulus=layer.youngs_modulus * ratio) for layer in pad.layers], pad.base
        )
    raise Unsupported(f"youngs_modulus of a {type(pad).__name__} cannot be varied. Leave it out of the sweep.")


def _of_shape(array: Array, shape: Any) -> Array:
    if isinstance(array, LineArray):
        return replace(array, count=shape, mask=None)
    if isinstance(array, AreaArray):
        return replace(array, shape=shape, mask=None)
    raise Unsupported("shape belongs to a line or area array, and this one is scattered. Leave shape out of the sweep.")


def _of_pitch(array: Array, pitch: Any, keep: str) -> Array:
    """Return the array with another pitch, and with the same number of taxels or the same area."""
    if isinstance(array, ScatteredArray):
        raise Unsupported(
            "pitch belongs to a line or area array, and this one is scattered. Leave pitch out of the sweep."
        )
    new = replace(array, pitch=pitch)
    if keep == "taxels":
        return new
    counts = [
        n if n == 1 else max(2, round(n * old / now))
        for n, old, now in zip(array.shape, array.grid.spacings, new.grid.spacings)
    ]
    return _of_shape(new, counts[0] if isinstance(array, LineArray) else tuple(counts))


def _measuring(array: Array, channels: Sequence[str]) -> Array:
    kinds = {find_channel(c).kind.name for c in channels}
    if array.noise is not None and kinds != {find_channel(c).kind.name for c in array.channels}:
        raise Unsupported(
            f"the noise of {', '.join(array.channels)} is not one of {', '.join(channels)}: they have other units. Write one file for each kind of channel, "
            "and rank them together: palpate design a.toml b.toml."
        )
    noise = array.noise
    if noise is not None and len(set(array.noise_std or ())) > 1:
        known = dict(zip(array.channels, array.noise_std or ()))
        lacking = [c for c in channels if c not in known]
        if lacking:
            raise Unsupported(
                f"the noise of {lacking[0]} is not given: the array says one for each of {', '.join(array.channels)}. Give one noise for all channels, or list {lacking[0]} too."
            )
        noise = [known[c] for c in channels]
    elif noise is not None:
        noise = (array.noise_std or (0.0,))[0]
    return replace(array, channels=list(channels), noise=noise, limits=_shared_limits(array))


def _with_noise(array: Array, noise: Any) -> Array:
    kinds = {find_channel(c).kind.name for c in array.channels}
    if np.ndim(noise) == 0 and len(kinds) > 1:
        raise Unsupported(
            f"one noise cannot be that of {', '.join(array.channels)}: they have different units. Give a list with the noise of each channel, or write one file for each design "
            "and rank them together: palpate design a.toml b.toml."
        )
    return replace(array, noise=noise)


def _shared_limits(array: Array) -> Any:
    """Return the limits if all channels have the same. Otherwise they cannot be transferred to other channels."""
    if array.limits is None:
        return None
    found = array.limits
    if found.ndim == 2 and (found == found[:1]).all():
        return tuple(float(v) for v in found[0])
    raise Unsupported(
        "limits differ between channels, so that they cannot be kept for other channels. Give one pair for all, or none."
    )
