"""Elastic layers bonded to each other, on a rigid base or on an elastic half-space."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.elastic.half_space import HalfSpace, check_material, decaying_states, from_radial
from palpate.elastic.pad import Complexes, Floats, isotropic_compliance
from palpate.errors import InvalidInput
from palpate.units import is_number

__all__ = ["BondedLayers", "Layer"]

#: A layer with k h below this [rad] is stepped by its propagator, a thicker one by decaying waves from both faces.
THIN = 1.0

#: Mirror z -> -z of the in-plane states (k U, k u_z, S, N).
_MIRROR = np.array([1.0, -1.0, -1.0, 1.0])[:, None]


@dataclass(frozen=True, kw_only=True)
class Layer:
    """One homogeneous, isotropic layer.

    Parameters
    ----------
    thickness : float
        Thickness h [m].
    youngs_modulus : float
        Young's modulus E [Pa].
    poissons_ratio : float
        Poisson's ratio nu, 0 <= nu <= 0.5 (0.5 included).

    Raises
    ------
    InvalidInput
        A thickness or modulus that is not positive and finite, or a Poisson's ratio outside 0 to 0.5.

    Examples
    --------
    >>> import palpate as pp
    >>> layer = pp.Layer(thickness=2e-3, youngs_modulus=3e5, poissons_ratio=0.5)
    >>> round(layer.shear_modulus)  # E / 3
    100000
    """

    thickness: float
    youngs_modulus: float
    poissons_ratio: float

    def __post_init__(self) -> None:
        check_material(self.youngs_modulus, self.poissons_ratio)
        h = self.thickness
        if not (is_number(h) and h > 0):
            raise InvalidInput(f"thickness must be a positive, finite number of metres; got {h!r}.")

    @property
    def shear_modulus(self) -> float:
        """mu = E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))


@dataclass(frozen=True)
class BondedLayers:
    """Layers perfectly bonded to each other, from the surface down.

    Parameters
    ----------
    layers : sequence of Layer
        The first is at the surface.
    base : HalfSpace, optional
        Half-space to which the last layer is bonded; by default a rigid base.

    Raises
    ------
    InvalidInput
        No layers, or a base that is neither None nor a `HalfSpace`; a depth below the rigid base.

    Notes
    -----
    Surface compliance (displacement per traction, a 2 x 2 matrix in plane and a number out of plane) is carried up from the
    base, layer by layer, then the fields down from the surface. A layer thin against the wavelength (k h < 1) is
    stepped by the exact exponential of the plane-strain equations, whose small terms are kept to full relative precision;
    a thicker one by waves that decay from its two faces. Nothing grows, so nothing overflows.

    At an interface, channels that jump (s_xx, e_zz, ...) are those of the *upper* layer; for the lower one give a depth
    greater by a millionth of the layer.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> soft = pp.Layer(thickness=2e-3, youngs_modulus=3e5, poissons_ratio=0.5)
    >>> skin = pp.Layer(thickness=0.5e-3, youngs_modulus=3e6, poissons_ratio=0.5)
    >>> pad = pp.BondedLayers([skin, soft])  # glued to a rigid base
    >>> pad.thickness, pad.surface_thickness, pad.surface.youngs_modulus
    (0.0025, 0.0005, 3000000.0)

    >>> round(1 / pad.compliance(1e-3)[0, 0])  # E [Pa] at a depth of 1 mm
    300000

    >>> glued = pp.BondedLayers([soft])
    >>> states = glued.states(np.array([500.0]), np.array([[1.0, 0.0]]), 2e-3)  # k h = 1
    >>> states[0, 5, 2].real.round(3).item()  # s_zz at the base for a unit pressure; 0.736 in a half-space
    0.804

    >>> (glued.mean_compliance(0.0)[0, 0] * 1e9).round(3).item()  # h / mu [m/GPa] for a mean shear
    20.0
    """

    layers: Sequence[Layer]
    base: HalfSpace | None = None

    def __post_init__(self) -> None:
        found = tuple(self.layers) if isinstance(self.layers, Sequence) else ()
        if not found or not all(isinstance(layer, Layer) for layer in found):
            raise InvalidInput(f"layers must be a list of at least one Layer; got {self.layers!r}.")
        if self.base is not None and not isinstance(self.base, HalfSpace):
            raise InvalidInput(f"base must be a HalfSpace, or None for a rigid base; got {type(self.base).__name__}.")
        object.__setattr__(self, "layers", found)

    @property
    def thickness(self) -> float:
        """Depth of the base [m]."""
        return sum(layer.thickness for layer in self.layers)

    @property
    def surface_thickness(self) -> float:
        """Thickness [m] of the uppermost material: that of the first layers of equal constants."""
        first = (self.layers[0].youngs_modulus, self.layers[0].poissons_ratio)
        alike = itertools.takewhile(lambda layer: (layer.youngs_modulus, layer.poissons_ratio) == first, self.layers)
        return sum(layer.thickness for layer in alike)

    @property
    def surface(self) -> HalfSpace:
        """A half-space of the uppermost material."""
        first = self.layers[0]
        return HalfSpace(youngs_modulus=first.youngs_modulus, poissons_ratio=first.poissons_ratio)

    def _find(self, depth: float) -> tuple[int, float]:
        """Layer that holds ``depth`` and the depth below its top; index len(layers) is the base."""
        top = 0.0
        for i, layer in enumerate(self.layers):
            if depth <= top + layer.thickness * (1 + 1e-9):
                return i, min(max(depth - top, 0.0), layer.thickness)
            top += layer.thickness
        if self.base is None:
            raise InvalidInput(
                f"depth {depth:g} m lies below the rigid base of the pad at {self.thickness:g} m; nothing can be measured there. "
                'Use depth="base" for taxels at the base.'
            )
        return len(self.layers), depth - top

    def compliance(self, depth: float) -> Floats:
        """Compliance (6, 6) [1/Pa] at ``depth`` [m] (of the upper layer at an interface)."""
        i, _ = self._find(depth)
        part = self.base if i == len(self.layers) else self.layers[i]
        found = part if part is not None else self.layers[-1]
        return isotropic_compliance(found.youngs_modulus, found.poissons_ratio)

    def mean_compliance(self, depth: float) -> Floats | None:
        """Displacement at ``depth`` per unit mean traction (3, 3) [m/Pa]; None on a half-space."""
        if self.base is not None:
            return None
        i, local = self._find(depth)
        parts = [(self.layers[i].thickness - local, self.layers[i])]
        parts += [(layer.thickness, layer) for layer in self.layers[i + 1 :]]
        shear = sum(h / layer.shear_modulus for h, layer in parts)
        normal = sum(
            h * (1 - 2 * layer.poissons_ratio) / (2 * layer.shear_modulus * (1 - layer.poissons_ratio))
            for h, layer in parts
        )
        return np.diag([shear, shear, normal])

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Fields of one wavevector at ``depth`` [m], see `palpate.elastic.Pad.states`."""
        shape = np.shape(wavenumber)
        k, back = np.unique(np.asarray(wavenumber, dtype=np.float64), return_inverse=True)
        in_plane, antiplane = self._in_plane(k, depth), self._antiplane(k, depth)
        back = back.reshape(shape)
        return from_radial(np.moveaxis(in_plane, 0, -1)[..., back], antiplane[..., back], direction)

    def _in_plane(self, k: Floats, depth: float) -> Floats:
        """(k, 4, 2): rows k U, k u_z, S, N; columns per unit S0 and N0."""
        target, local = self._find(depth)
        compliance = np.zeros((k.size, 2, 2))
        if self.base is not None:
            base = decaying_states(self.base.shear_modulus, self.base.poissons_ratio, np.zeros(1))
            compliance[:] = base[:2, :, 0]
        steps = []
        for layer in reversed(self.layers):
            step = _Step(layer, k, compliance)
            compliance = step.compliance
            steps.append(step)
        steps.reverse()
        traction: Floats = np.broadcast_to(np.eye(2), (k.size, 2, 2))
        for i, step in enumerate(steps):
            if i == target:
                return step.state(traction, local)
            traction = step.state(traction, step.layer.thickness)[:, 2:]
        base_body = self.base if self.base is not None else self.surface
        under = decaying_states(base_body.shear_modulus, base_body.poissons_ratio, k * local)
        return np.moveaxis(under, -1, 0) @ traction

    def _antiplane(self, k: Floats, depth: float) -> Floats:
        """(2, k): k u_t and T per unit T0."""
        target, local = self._find(depth)
        below: Floats = np.zeros(k.size) if self.base is None else np.full(k.size, 1.0 / self.base.shear_modulus)
        compliances: list[Floats] = [below]
        for layer in reversed(self.layers):
            tanh = np.tanh(k * layer.thickness)
            mu = layer.shear_modulus
            above: Floats = (compliances[0] + tanh / mu) / (1.0 + compliances[0] * mu * tanh)
            compliances.insert(0, above)
        through = np.ones(k.size)
        for i, layer in enumerate(self.layers):
            at = local if i == target else layer.thickness
            g, mu = compliances[i + 1], layer.shear_modulus
            rest, whole = k * (layer.thickness - at), k * layer.thickness
            e_rest, e_whole = np.exp(-2 * rest), np.exp(-2 * whole)
            scale = np.exp(-k * at) / ((1 + e_whole) + mu * g * (1 - e_whole))
            stress = through * scale * ((1 + e_rest) + mu * g * (1 - e_rest))
            if i == target:
                displacement = through * scale * (g * (1 + e_rest) + (1 - e_rest) / mu)
                return np.stack([displacement, stress])
            through = stress
        stress = through * np.exp(-k * local)
        return np.stack([below * stress, stress])


class _Step:
    """One layer at every wavenumber: computes the compliance of its top from that of its bottom, and the fields
    inside.
    """

    def __init__(self, layer: Layer, k: Floats, below: Floats) -> None:
        self.layer, self.k = layer, k
        self.thin = k * layer.thickness < THIN
        self.compliance = np.empty((k.size, 2, 2))
        mu, nu, h = layer.shear_modulus, layer.poissons_ratio, layer.thickness
        if self.thin.any():
            p = _propagator(mu, nu, k[self.thin] * h)
            f = below[self.thin]
            self.compliance[self.thin] = np.linalg.solve(
                p[:, :2, :2] - f @ p[:, 2:, :2], f @ p[:, 2:, 2:] - p[:, :2, 2:]
            )
        thick = ~self.thin
        if thick.any():
            near = np.moveaxis(decaying_states(mu, nu, np.zeros(1)), -1, 0)
            far = np.moveaxis(decaying_states(mu, nu, k[thick] * h), -1, 0)
            f = below[thick]
            up_near, up_far = _MIRROR * near, _MIRROR * far
            # b = -reflect a makes u = F t at the bottom; then the top's traction is top_t a, its displacement top_u a
            self._reflect = np.linalg.solve(up_near[:, :2] - f @ up_near[:, 2:], far[:, :2] - f @ far[:, 2:])
            self._top = np.eye(2) - up_far[:, 2:] @ self._reflect
            displacement = near[:, :2] - up_far[:, :2] @ self._reflect
            self.compliance[thick] = np.swapaxes(
                np.linalg.solve(np.swapaxes(self._top, 1, 2), np.swapaxes(displacement, 1, 2)), 1, 2
            )

    def state(self, traction: Floats, depth: float) -> Floats:
        """(k, 4, 2) at ``depth`` below the top of the layer, for a traction (k, 2, 2) on its top."""
        mu, nu, h = self.layer.shear_modulus, self.layer.poissons_ratio, self.layer.thickness
        out = np.empty((self.k.size, 4, 2))
        thin, thick = self.thin, ~self.thin
        if thin.any():
            t = traction[thin]
            top = np.concatenate([self.compliance[thin] @ t, t], axis=1)
            out[thin] = _propagator(mu, nu, self.k[thin] * depth) @ top
        if thick.any():
            a = np.linalg.solve(self._top, traction[thick])
            down = np.moveaxis(decaying_states(mu, nu, self.k[thick] * depth), -1, 0)
            up = _MIRROR * np.moveaxis(decaying_states(mu, nu, self.k[thick] * (h - depth)), -1, 0)
            out[thick] = down @ a - up @ (self._reflect @ a)
        return out


def _propagator(mu: float, nu: float, zeta: Floats) -> Floats:
    """exp(A zeta) (n, 4, 4) of d/d(kz) (k U, k u_z, S, N) = A (...), for zeta up to about 1.

    A has the double eigenvalues +1 and -1, so exp(A zeta) is a cubic in A whose coefficients match value and slope there:
    alpha_0 + alpha_2 = cosh, alpha_1 + alpha_3 = sinh, alpha_1 + 3 alpha_3 = zeta cosh, 2 alpha_2 = zeta sinh.
    """
    b, c = nu / (1 - nu), (1 - 2 * nu) / (2 * mu * (1 - nu))
    a = np.array([[0, -1, -1 / mu, 0], [b, 0, 0, -c], [-2 * mu / (1 - nu), 0, 0, -b], [0, 0, 1, 0]])
    # (zeta cosh - sinh)/2 = sum n zeta^(2n+1)/(2n+1)!, without cancellation
    third = np.zeros_like(zeta)
    for n in range(12, 0, -1):
        third = third + n * zeta ** (2 * n + 1) / math.factorial(2 * n + 1)
    second = 0.5 * zeta * np.sinh(zeta)
    first = np.sinh(zeta) - third
    zeroth = np.cosh(zeta) - second
    powers = [np.eye(4), a, a @ a, a @ a @ a]
    return sum(x[:, None, None] * p for x, p in zip((zeroth, first, second, third), powers))
