"""The table of channels: everything that the rest of the code needs to know about a quantity that a sensor measures.

A channel states how it follows from the fields of an elastic body (`Fields`), its unit, its signs under mirrors and
its change in time. Fields come from one wavevector (`palpate.elastic.quantities`) or from a closed form in space
(`palpate.elastic.closed_form`, `palpate.elastic.closed_form_line`); a channel does not depend on which. To add a
channel, add an entry to `CHANNELS`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

from palpate._numbers import plain_number
from palpate.errors import InvalidInput

__all__ = [
    "AREA_CHANNELS",
    "CHANNELS",
    "LINE_CHANNELS",
    "Channel",
    "Fields",
    "Kind",
    "channel_unit",
    "check_channels",
    "find_channel",
    "is_channel",
    "mirror_parity",
]


class Fields(Protocol):
    """Elastic fields at one depth, per unit surface traction: arrays, or spectra that are combined linearly."""

    def displacement(self, i: str) -> Any:
        """u_i [m/Pa], i in "xyz"."""
        ...

    def gradient(self, i: str, j: str) -> Any:
        """du_i/dx_j [1/Pa]."""
        ...

    def strain(self, ij: str) -> Any:
        """Strain [1/Pa], compression positive."""
        ...

    def stress(self, ij: str) -> Any:
        """Stress [Pa/Pa], compression positive."""
        ...


@dataclass(frozen=True)
class Kind:
    """Properties that all channels of one kind share.

    Attributes
    ----------
    name : str
        "stress", "strain", ...; channels of one kind have equal weight without a stated noise.
    unit : str
        SI unit.
    creeps : bool
        Follows the modulus in time (Boltzmann superposition) under a given traction; stress does not.
    absolute : bool
        Follows displacement itself, not its gradient: without a finite mean on a half-space, relative to the array's mean in
        line contact, felt far away.
    scale : callable (modulus [Pa], wavenumber [rad/m]) -> float or array
        Size of a reading per unit of stress.
    limit : callable (Young's modulus [Pa], array's width [m]) -> (float, str)
        Largest plausible reading, and that limit in words.
    """

    name: str
    unit: str
    creeps: bool
    absolute: bool
    scale: Callable[[float, Any], Any]
    limit: Callable[[float, float], tuple[float, str]]


@dataclass(frozen=True)
class Channel:
    """One quantity that a sensor measures.

    Attributes
    ----------
    name : str
        As in ``channels=[...]``, files and column titles.
    kind : Kind
    indices : str
        Axes of the component: "zz", "x".
    odd : str
        Axes of "xy" whose mirror turns its sign.
    line : bool
        Whether line contact (plane strain) has it.
    read : callable (Fields) -> array
        Computes the channel from the fields; linear.

    Examples
    --------
    >>> from palpate.elastic import CHANNELS
    >>> shear = CHANNELS["stress_xz"]
    >>> shear.kind.name, shear.indices, shear.unit, shear.odd, shear.line
    ('stress', 'xz', 'Pa', 'x', True)
    """

    name: str
    kind: Kind
    indices: str
    odd: str
    line: bool
    read: Callable[[Fields], Any]

    @property
    def unit(self) -> str:
        """SI unit."""
        return self.kind.unit


#: Stress beyond this many Young's moduli means a mistaken unit: it is far beyond linear elasticity, and rubber would
#: break.
_STRESS_LIMIT = 30.0
#: The same limit for strains and rotations.
_STRAIN_LIMIT = 3.0

DISPLACEMENT = Kind(
    "displacement",
    unit="m",
    creeps=True,
    absolute=True,
    scale=lambda modulus, k: 1.0 / (modulus * k),
    limit=lambda modulus, width: (width, f"the width of the array ({width:g} m)"),
)
STRESS = Kind(
    "stress",
    unit="Pa",
    creeps=False,
    absolute=False,
    scale=lambda modulus, k: 1.0 + 0.0 * k,
    limit=lambda modulus, width: (
        _STRESS_LIMIT * modulus,
        f"{_STRESS_LIMIT:g} times the pad's Young's modulus ({plain_number(modulus)} Pa)",
    ),
)
STRAIN = Kind(
    "strain",
    unit="1",
    creeps=True,
    absolute=False,
    scale=lambda modulus, k: 1.0 / modulus + 0.0 * k,
    limit=lambda modulus, width: (_STRAIN_LIMIT, f"{_STRAIN_LIMIT:g} ({100 * _STRAIN_LIMIT:g} %)"),
)
ROTATION = Kind(
    "rotation",
    unit="rad",
    creeps=True,
    absolute=False,
    scale=lambda modulus, k: 1.0 / modulus + 0.0 * k,
    limit=lambda modulus, width: (_STRAIN_LIMIT, f"{_STRAIN_LIMIT:g} rad"),
)

_TENSOR = ("xx", "yy", "zz", "xz", "yz", "xy")
_IN_LINE = {"displacement": ("x", "z"), "stress": ("xx", "yy", "zz", "xz"), "strain": ("xx", "zz", "xz")}


def _component(kind: Kind, indices: str) -> Channel:
    """Return the channel of a component of a vector or tensor. It is odd in every axis that its indices name an odd
    number of times.
    """

    def read(fields: Fields) -> Any:
        return getattr(fields, kind.name)(indices)

    odd = "".join(axis for axis in "xy" if indices.count(axis) % 2)
    return Channel(f"{kind.name}_{indices}", kind, indices, odd, indices in _IN_LINE[kind.name], read)


_ALL = (
    *(_component(DISPLACEMENT, i) for i in "xyz"),
    *(_component(kind, ij) for kind, ij in itertools.product((STRESS, STRAIN), _TENSOR)),
    Channel(  # rotation of the material about the pad's normal, as markers or a twist sensor measure it
        "rotation_z", ROTATION, "z", "xy", False, lambda f: 0.5 * (f.gradient("y", "x") - f.gradient("x", "y"))
    ),
)

#: Every channel by name.
CHANNELS: Mapping[str, Channel] = MappingProxyType({c.name: c for c in _ALL})

#: Every channel of area contact (three dimensions).
AREA_CHANNELS: tuple[str, ...] = tuple(CHANNELS)

#: The channels that do not vanish identically in line contact (plane strain).
LINE_CHANNELS: tuple[str, ...] = tuple(c.name for c in _ALL if c.line)


def find_channel(name: str) -> Channel:
    """The channel of this name, or `InvalidInput` with the accepted names.

    Examples
    --------
    >>> from palpate.elastic import find_channel
    >>> find_channel("strain_zz").kind.creeps  # under a load that is kept, in a pad that creeps
    True
    """
    if name not in CHANNELS:
        raise InvalidInput(f"channel {name!r} is not known; accepted: {', '.join(CHANNELS)}.")
    return CHANNELS[name]


def is_channel(name: str) -> bool:
    """Whether there is a channel of this name."""
    return name in CHANNELS


def channel_unit(channel: str) -> str:
    """SI unit of a channel: "m" for displacement, "Pa" for stress, "1" for strain, "rad" for rotation.

    Raises
    ------
    InvalidInput
        No channel of this name.

    Examples
    --------
    >>> from palpate.elastic import channel_unit
    >>> channel_unit("displacement_x"), channel_unit("stress_zz")
    ('m', 'Pa')
    """
    return find_channel(channel).unit


def check_channels(channels: Sequence[str], dimensions: int) -> tuple[str, ...]:
    """The channels as a tuple, or `InvalidInput` naming the bad one and what is accepted."""
    if isinstance(channels, str):
        raise InvalidInput(f'channels must be a list of names; got the string {channels!r}. Write ["{channels}"].')
    accepted = [c.name for c in CHANNELS.values() if c.line or dimensions == 2]
    found = tuple(channels)
    if not found:
        raise InvalidInput(f"channels is empty: name at least one of {', '.join(accepted)}.")
    for name in found:
        if name not in accepted:
            why = "vanishes identically in line contact (plane strain)" if name in CHANNELS else "is not a channel"
            raise InvalidInput(f"channel {name!r} {why}; accepted: {', '.join(accepted)}.")
    if len(set(found)) != len(found):
        raise InvalidInput(f"channels names one channel twice: {', '.join(found)}.")
    return found


def mirror_parity(name: str, axis: str) -> int:
    """+1 or -1: the sign of a channel, or of a traction component ("x", "y", "z"), when coordinate ``axis`` is mirrored."""
    odd = CHANNELS[name].odd if name in CHANNELS else name
    return -1 if axis in odd else 1
