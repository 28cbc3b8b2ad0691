"""Uncertainty of a pad and its sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.layers import BondedLayers
from palpate.elastic.pad import Floats, Pad
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import Array
from palpate.units import is_number

__all__ = ["EXACT", "GAIN", "GEOMETRY", "MODULUS", "SCALE", "Uncertainty", "scale_free", "step_of", "stretched"]

#: Relative change used to compute the effect of depth and thickness: a one-sided difference, wrong by a few per cent of
#: the effect.
STEP = 0.02
#: Default uncertainty of the modulus (a convention): moduli by hardness are off by 10 to 30 %, by a test of the batch by 5 to 10 %.
MODULUS = 0.15
#: Default uncertainty of depth and thickness (a convention): 0.2 to 0.4 mm for a cast pad of 2 to 4 mm. With depths
#: stated wrong by a factor of 0.7 or 1.4 (`palpate bench trust`), 0.96 of the intervals contain the force; without it
#: 0.90 (24 frames).
GEOMETRY = 0.1
#: Default uncertainty of the common scale of all readings (a convention): no interval of a force is then narrower than
#: 4 % to either side. With taxel gains that vary by 5 to 10 % (`palpate bench trust`), 0.92 of the intervals contain
#: the force; without it 0.80.
SCALE = 0.02
#: Default uncertainty of the gain of each reading (a convention): taxels of one array differ by some per cent. It
#: matters if the force rests on a few taxels.
GAIN = 0.05


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Relative standard deviations of the properties of a skin: 0.1 means 10 %.

    They widen every interval, of linear methods too, by the effect that each would have on the readings (the delta
    method: readings are linear in small changes).

    Parameters
    ----------
    youngs_modulus : float, optional
        Relative standard deviation of the modulus of the pad; all layers are wrong by the same factor. Every force from strain or
        displacement is proportional to it; stress does not depend on it. Default: 15 %; 0 means exact.
    thickness : float, optional
        Relative standard deviation of the thickness of bonded layers; all layers are wrong by the same factor. Default: 10 % in constrained
        methods, exact in linear ones.
    depth : float, optional
        Relative standard deviation of the depth of the sensing elements; all are wrong by the same factor. Default as for thickness.
    gain : float, optional
        Relative standard deviation of the gain of each reading, independent of the others. Default: 5 % in the net
        force of constrained methods; 0 means exact.
    scale : float
        Relative standard deviation of the calibration of all readings together. Every result is proportional to it.
        Default: 2 %; 0 means exact.

    Raises
    ------
    InvalidInput
        A number that is negative, not finite, or 1 or more.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["strain_zz"], noise=1e-4)
    >>> nothing = pp.Uncertainty(youngs_modulus=0.0, depth=0.0, scale=0.0)
    >>> exact = pp.Skin(pad, array, uncertainty=nothing)
    >>> usual = pp.Skin(pad, array)
    >>> readings = usual.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    >>> for skin in (exact, usual):
    ...     low, high = skin.reconstruct(readings).interval(0.95, "force")
    ...     print(bool(high[1] - low[1] > 2.0))  # N/m
    False
    True

    >>> stated = pp.Uncertainty(youngs_modulus=0.02, gain=0.03)
    >>> stated.modulus, stated.stated_gain, stated.assumed_gain, stated.any
    (0.02, 0.03, 0.0, True)

    >>> round(stated.common((array,)), 3), stated.of(pad) == stated  # every strain depends on the modulus
    (0.028, True)

    >>> stated.check(pad)  # nothing is stated that the pad lacks
    """

    youngs_modulus: float | None = None
    thickness: float | None = None
    depth: float | None = None
    gain: float | None = None
    scale: float = SCALE

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is None and f.default is None:
                continue
            good = is_number(value)
            if not good or not 0.0 <= value < 1.0:
                raise InvalidInput(
                    f"uncertainty: {f.name} must be a relative standard deviation from 0 to less than 1 (0.1 for ten per cent); got {value!r}."
                )

    @property
    def modulus(self) -> float:
        """The uncertainty of the modulus, stated or assumed."""
        return MODULUS if self.youngs_modulus is None else self.youngs_modulus

    @property
    def assumed_gain(self) -> float:
        """The assumed uncertainty of gains if none is stated, else 0."""
        return GAIN if self.gain is None else 0.0

    @property
    def stated_gain(self) -> float:
        """The stated uncertainty of gains, or 0."""
        return self.gain or 0.0

    def common(self, planes: tuple[Array, ...]) -> float:
        """Common relative error of all results of these arrays: the scale, and the modulus if every reading depends on it."""
        return math.hypot(self.scale, self.modulus if all(_follows(planes)) else 0.0)

    def beside(self, pad: Pad, planes: tuple[Array, ...], *, assumed: bool = True) -> Uncertainty:
        """The uncertainty without the common factor of all results (`common`). ``assumed``: include the defaults of
        depth and thickness.

        Examples
        --------
        >>> import palpate as pp
        >>> array = pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["strain_zz"])
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> pp.Uncertainty(depth=0.05).beside(pad, (array,))
        Uncertainty(youngs_modulus=0.0, thickness=0.0, depth=0.05, gain=0.0, scale=0.0)
        """
        follow = _follows(planes)
        mixed = self.modulus if any(follow) and not all(follow) else 0.0
        rest = GEOMETRY if assumed else 0.0
        layers = isinstance(pad, BondedLayers)
        # Markers on the surface or on a rigid base stay there.
        inside = any(a.depth > 0 and not _at_base(pad, a) for a in planes)
        return replace(
            self,
            youngs_modulus=mixed,
            gain=self.stated_gain,
            thickness=(rest if layers else 0.0) if self.thickness is None else self.thickness,
            depth=(rest if inside else 0.0) if self.depth is None else self.depth,
            scale=0.0,
        )

    @property
    def any(self) -> bool:
        """Whether any part is uncertain."""
        return self.modulus > 0 or any(getattr(self, f.name) != 0 for f in fields(self)[1:])

    def of(self, pad: Pad) -> Uncertainty:
        """The stated values, completed by those of the pad itself, if it has an ``uncertainty`` (a measured one)."""
        own = getattr(pad, "uncertainty", None)
        if not isinstance(own, Uncertainty):
            return self
        return replace(self, **{f.name: getattr(own, f.name) for f in fields(self) if getattr(self, f.name) is None})

    def check(self, pad: Pad) -> None:
        """Raise `Unsupported` if an uncertainty is stated for a property that the pad lacks."""
        own = getattr(pad, "uncertainty", None)
        if isinstance(own, Uncertainty):
            fixed = [n for n in ("youngs_modulus", "thickness", "depth") if getattr(own, n) is not None]
            stated = [n for n in fixed if getattr(self, n) != getattr(own, n)]
            if stated:
                raise Unsupported(
                    f"uncertainty: {', '.join(stated)} does not enter a {type(pad).__name__}, whose response is that of its table. State scale (how well the force "
                    "of its presses was known) or gain."
                )
        if self.thickness and not isinstance(pad, BondedLayers):
            raise Unsupported(
                f"uncertainty: thickness belongs to BondedLayers; this pad is a {type(pad).__name__}. Leave it out."
            )


def stretched(
    pad: Pad, planes: tuple[Array, ...], *, depth: float = 1.0, thickness: float = 1.0
) -> tuple[Pad, tuple[Array, ...]]:
    """Pad and planes with depths and thicknesses multiplied; planes at a rigid base stay there."""
    before = pad
    if thickness != 1.0 and isinstance(pad, BondedLayers):
        pad = BondedLayers([replace(layer, thickness=layer.thickness * thickness) for layer in pad.layers], pad.base)
    moved = []
    for plane in planes:
        moved.append(replace(plane, depth=plane.depth * (thickness if _at_base(before, plane) else depth)))
    return pad, tuple(moved)


def step_of(pad: Pad, planes: tuple[Array, ...], name: str) -> float:
    """Relative change of the "depth" or "thickness" with which `stretched` tells its effect: `STEP`, or as much less if
    taxels would lie below the base.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.sensing.uncertainty import step_of
    >>> pad = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=3e5, poissons_ratio=0.5)])
    >>> array = pp.LineArray(count=5, pitch=1e-3, depth=1.99e-3, channels=["stress_zz"])
    >>> step_of(pad, (array,), "depth"), step_of(pad, (array,), "thickness")
    (-0.02, 0.02)
    """
    total = pad.thickness
    deepest = max((a.depth for a in planes if not _at_base(pad, a)), default=0.0)
    return -STEP if name == "depth" and total is not None and (1.0 + STEP) * deepest > total else STEP


def _at_base(pad: Pad, plane: Array) -> bool:
    total = pad.thickness
    return total is not None and abs(plane.depth - total) < 1e-9 * total


def _follows(planes: tuple[Array, ...]) -> list[bool]:
    """Whether the readings of each channel scale with the modulus, as in `scale_free`, which is per reading."""
    return [find_channel(c).kind.creeps for array in planes for c in array.channels]


def scale_free(planes: tuple[Array, ...]) -> Floats:
    """1 for readings (row of the operator) that scale with 1/modulus at a given traction, such as strain; else 0."""
    parts = []
    for array in planes:
        flags = [float(find_channel(c).kind.creeps) for c in array.channels]
        parts.append(np.repeat(flags, int(array.valid.sum())))
    return np.concatenate(parts)


#: A pad and sensors that are known exactly, as simulated ones are.
EXACT = Uncertainty(youngs_modulus=0.0, thickness=0.0, depth=0.0, gain=0.0, scale=0.0)
