"""The interface of an elastic body.

A pad is any object with the members of `Pad`. They suffice for both boundaries, by quadrature if the pad has no closed form. A closed form is used
only if it surely belongs to the same body: a class that overrides ``states`` or ``compliance`` does not inherit the closed forms of its parent
(`offered`).
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput

__all__ = [
    "Complexes",
    "Floats",
    "Pad",
    "check_below",
    "check_pad",
    "isotropic_compliance",
    "isotropic_constants",
    "mirror_symmetric",
    "offered",
    "shear_modulus",
]

Floats = npt.NDArray[np.floating[Any]]
Complexes = npt.NDArray[np.complexfloating[Any, Any]]


@runtime_checkable
class Pad(Protocol):
    """An elastic body under a plane surface z = 0, uniform in x and y.

    A pad may offer more, and is then faster and more exact:

    ``influence(offsets, widths, depth, channels, *, concentrated=False, damping=0.0)``
        Channels per unit traction of a uniformly loaded surface cell in closed form, as `palpate.HalfSpace` does.
    ``surface`` and ``surface_thickness``
        A `palpate.HalfSpace` of the uppermost material, and how deep that material goes [m]: for isotropic layers.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.elastic import Pad
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> isinstance(pad, Pad)  # it has thickness, states, compliance and mean_compliance
    True

    >>> pad.thickness, pad.compliance(0.0).shape, pad.mean_compliance(0.0)
    (None, (6, 6), None)

    >>> import numpy as np
    >>> pad.states(np.ones(5), np.tile([1.0, 0.0], (5, 1)), 1e-3).shape
    (5, 6, 3)
    """

    @property
    def thickness(self) -> float | None:
        """Depth of the rigid base [m], or None without a base."""
        ...

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Fields of one wavevector at ``depth`` [m], fully coupled.

        Parameters
        ----------
        wavenumber : array (...)
            k >= 0 [rad/m]; at 0 the limit in that direction.
        direction : array (..., 2)
            Unit vector (cos, sin) of the wavevector in (x, y).

        Returns
        -------
        array (..., 6, 3), complex
            Rows k u_x, k u_y, k u_z [1/Pa], s_xz, s_yz, s_zz, compression positive; columns per unit surface traction (q_x, q_y, p)
            exp(i k.x).
        """
        ...

    def compliance(self, depth: float) -> Floats:
        """Compliance [1/Pa] of the material at ``depth`` [m], 6 x 6: strain per stress in the order xx, yy, zz, yz, xz, xy,
        shear strains doubled. `InvalidInput` below a rigid base."""
        ...

    def mean_compliance(self, depth: float) -> Floats | None:
        """Displacement at ``depth`` per unit mean traction, 3 x 3 [m/Pa]; None if it is not finite."""
        ...


_MEMBERS = ("thickness", "states", "compliance", "mean_compliance")


def check_pad(pad: object) -> None:
    """Raise `InvalidInput` with the missing members unless ``pad`` is a `Pad`."""
    if isinstance(pad, type) or not isinstance(pad, Pad):
        missing = [m for m in _MEMBERS if not hasattr(pad, m)]
        why = f"it lacks {', '.join(missing)}" if missing else "it is a class, not one of its objects"
        raise InvalidInput(
            f"pad must be an elastic body, HalfSpace(...) or BondedLayers([...]), or one of your own with the members of "
            f"palpate.elastic.Pad; got {type(pad).__name__}: {why}."
        )


def check_below(depth: npt.ArrayLike) -> None:
    """Raise `InvalidInput` for a depth above the surface."""
    least = np.min(np.asarray(depth, dtype=np.float64), initial=0.0)
    if least < 0.0:
        raise InvalidInput(f"depth must be 0 or more [m], as z grows into the pad; got {least:g}. Turn its sign.")


def offered(pad: object, *names: str) -> bool:
    """Return whether ``pad`` offers the optional members ``names``, and no subclass has since changed the body that
    they describe.
    """
    order = type(pad).__mro__

    def defined(name: str) -> int:
        return next((i for i, c in enumerate(order) if name in vars(c)), len(order))

    last = max(defined(n) for n in names)
    return last < len(order) and last <= min(defined("states"), defined("compliance"))


def isotropic_compliance(modulus: float, ratio: float) -> Floats:
    """Compliance (6, 6) of an isotropic solid of Young's modulus ``modulus`` [Pa] and Poisson's ratio ``ratio``."""
    out = np.zeros((6, 6))
    out[:3, :3] = -ratio
    out[[0, 1, 2], [0, 1, 2]] = 1.0
    out[[3, 4, 5], [3, 4, 5]] = 2.0 * (1.0 + ratio)
    return out / modulus


def isotropic_constants(pad: Pad, depth: float) -> tuple[float, float]:
    """Return Young's modulus [Pa] and Poisson's ratio for pressing along z at ``depth``: those of the isotropic solid
    that behaves most alike.
    """
    compliance = pad.compliance(depth)
    ratio = -0.5 * float(compliance[0, 2] + compliance[1, 2]) / float(compliance[2, 2])
    return 1.0 / float(compliance[2, 2]), min(max(ratio, 0.0), 0.5)


def mirror_symmetric(pad: Pad, depth: float, length: float) -> bool:
    """Whether mirrors in x and in y leave the response at ``depth`` unchanged, tested at wavelengths near ``length`` [m]."""
    k = np.array([0.3, 3.0, 30.0])[:, None] / length * np.ones(2)
    angle = np.array([0.3, 1.1])
    compliance = pad.compliance(depth)
    for cos, sin, vector, odd in ((-1.0, 1.0, (-1.0, 1.0, 1.0), (4, 5)), (1.0, -1.0, (1.0, -1.0, 1.0), (3, 5))):
        here, there = (
            pad.states(k, np.broadcast_to(np.stack([c * np.cos(angle), s * np.sin(angle)], -1), (3, 2, 2)), depth)
            for c, s in ((1.0, 1.0), (cos, sin))
        )
        sign = np.array(vector)
        image = np.tile(sign, 2)[:, None] * there * sign
        even = [i for i in range(6) if i not in odd]
        for block in (slice(0, 3), slice(3, 6)):
            if np.abs((image - here)[..., block, :]).max() > 1e-9 * np.abs(here[..., block, :]).max():
                return False
        if np.abs(compliance[np.ix_(odd, even)]).max() > 1e-9 * np.abs(compliance).max():
            return False
    return True


def shear_modulus(pad: Pad, depth: float) -> float:
    """Mean shear modulus of the planes xz and yz at ``depth`` [Pa]."""
    compliance = pad.compliance(depth)
    return float(2.0 / (compliance[3, 3] + compliance[4, 4]))
