"""A skin as a few matrices and formulas that PyTorch and JAX can differentiate.

readings = gains * A(modulus, depth) traction + noise. The traction sought is the minimum of

    |(gains * A t - readings)/noise|^2 + parameter * sum_c int |grad t_c|^2 / v_c

with the traction t, its components c, the integral over the surface, and v_c the prior variance of a component relative to pressure (1; for shear within
friction mu^2/2); over all t, or over pressure that only pushes and shear within friction, as `palpate.Tikhonov` and `palpate.Constrained` have it. The formulas are
written once, for any array namespace; modulus and depth are relative to those of the skin. In depth A is a polynomial through Chebyshev's points, which
converges as rho^-count with rho = x + sqrt(x^2 - 1), x = 1/depth_range: to 1e-9 for a range of 20 %.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._memory import require
from palpate.elastic.pad import Floats
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.constrained.differences import Differences
from palpate.inverse.contact.methods import cone_of
from palpate.inverse.contact.policy import Policy
from palpate.inverse.problem import Problem
from palpate.sensing.operator import Operator
from palpate.sensing.uncertainty import scale_free, stretched
from palpate.units import is_number

__all__ = [
    "NAMES",
    "Matrices",
    "constrained_terms",
    "flat_readings",
    "linear_traction",
    "matrices",
    "sensed",
    "whole_traction",
]

#: Quantities with gradients, besides readings and traction.
NAMES = ("modulus", "depth", "gains", "noise")
#: Number of depths at which the map is computed for a range of depths.
DEPTHS = 12
#: Widest relative range of depths: beyond it the polynomial of twelve points has errors above 1e-5.
WIDEST = 0.5
#: Largest product of readings and unknowns: a map of 400 MB.
LARGEST = 50_000_000


@dataclass(frozen=True)
class Matrices:
    """A skin as matrices, in double precision.

    ``here`` (reading, unknown) is the map of the components sought; ``coefficients`` (degree, reading, unknown) that of its depths, with ``depth_range``;
    ``follows`` (reading,) is 1 for readings proportional to 1/modulus; ``valid`` (reading,) 0 at masked taxels; ``channel`` (reading, channel) is 1
    for the channel of a reading;
    ``noise`` (reading,); ``penalty`` (unknown, unknown), times the parameter, and its inverse ``prior``; ``inverse`` (unknown, reading) the linear estimate;
    ``hessian`` that of the constrained problem if the model is fixed.
    """

    here: Floats
    coefficients: Floats
    depth_range: float
    follows: Floats
    valid: Floats
    channel: Floats
    noise: Floats | None
    penalty: Floats | None
    prior: Floats | None
    inverse: Floats | None
    hessian: Floats | None
    cone: Cone | None
    shape: tuple[int, ...]  # (channel, *array)
    surface: tuple[int, ...]  # (component, *surface), all components
    columns: tuple[int, ...]  # those sought
    readings: int
    unknowns: int
    degrees: int  # of the polynomials in depth
    whole: bool  # no taxel is masked


def matrices(
    problem: Problem,
    pad: Any,
    *,
    parameter: float | Floats | None = None,
    friction: float | None = None,
    constrained: bool = False,
    depth_range: float = 0.0,
) -> Matrices:
    """Compute all matrices that depend only on the skin.

    Raises
    ------
    InvalidInput
        A parameter that is not positive, a range of depths that is not within 0 and 0.5.
    Unsupported
        A pad that creeps, planes of different shapes, noise that is not given, a map that is too large.
    """
    parameter = _checked(problem, pad, parameter, depth_range)
    planes, surface = problem.planes, problem.surface
    valid = np.concatenate([np.tile(a.valid.ravel(), len(a.channels)) for a in planes]).astype(float)
    names = [c for a in planes for c in a.channels]
    channel = np.repeat(np.eye(len(names)), math.prod(planes[0].shape), axis=0)
    here = _dense(problem, problem.operator, valid)
    coefficients = _of_depths(problem, pad, valid, depth_range) if depth_range else here[None]
    follows = np.zeros(len(valid))
    follows[valid > 0] = scale_free(planes)
    noise = None
    if all(a.noise_std is not None for a in planes):
        noise = channel @ np.concatenate([np.asarray(a.noise_std) for a in planes])
    penalty = prior = inverse = hessian = cone = None
    if parameter is not None:
        if noise is None:
            raise Unsupported("the differentiable inverse weighs readings by their noise: give the array noise=....")
        cone = cone_of(problem.components, friction) if constrained else None
        penalty, prior = _penalty(problem, parameter, cone)
        white = here * (valid / noise)[:, None]
        spread = prior @ white.T
        inverse = np.linalg.solve(np.eye(len(white)) + white @ spread, spread.T).T * (valid / noise)
        hessian = white.T @ white + penalty if cone is not None else None
    return Matrices(
        here, coefficients, float(depth_range), follows, valid, channel, noise, penalty, prior, inverse, hessian, cone,
        (len(names), *planes[0].shape), (len(surface.components), *surface.shape), problem.columns, len(valid),
        here.shape[1], len(coefficients), bool(valid.all()),
    )  # fmt: skip


def _checked(problem: Problem, pad: Any, parameter: Any, depth_range: float) -> float | None:
    """The parameter as a number; an error if it or another argument of `matrices` will not do."""
    planes, surface = problem.planes, problem.surface
    if isinstance(pad, Viscoelastic):
        raise Unsupported("the differentiable layers know no history, and this pad creeps: use skin.without_creep().")
    if len({a.shape for a in planes}) != 1:
        raise Unsupported("the differentiable layers need planes of one shape: make one skin for each of them.")
    if not (is_number(depth_range) and 0.0 <= depth_range <= WIDEST):
        raise InvalidInput(
            f"depth_range must be a part of the depth from 0 (depth is not varied) to {WIDEST:g}; got {depth_range!r}."
        )
    if isinstance(parameter, np.ndarray) and parameter.ndim == 0:  # as a touch of one frame holds it
        parameter = float(parameter)
    if parameter is not None and not (is_number(parameter) and parameter > 0):
        raise InvalidInput(
            f"parameter must be one positive number, such as skin.reconstruct(readings, method='tikhonov').parameter of one frame; got {parameter!r}."
        )
    unknowns = math.prod(surface.shape) * len(problem.columns)
    readings = sum(len(a.channels) * math.prod(a.shape) for a in planes)
    if unknowns * max(readings, unknowns if parameter else 0) > LARGEST:
        raise Unsupported(
            f"{readings} readings and {unknowns} unknowns make matrices of more than {8 * LARGEST / 1e6:.0f} MB. Give the skin a coarser surface=, seek fewer "
            "components, or describe the array in parts."
        )
    require(
        8.0 * unknowns * (readings * (3 + (DEPTHS if depth_range else 0)) + 4 * unknowns),
        "a differentiable skin",
        "Give the skin a coarser surface.",
    )
    return None if parameter is None else float(parameter)


def _dense(problem: Problem, operator: Operator, valid: Floats) -> Floats:
    """The map (reading, unknown) of the components sought, with rows of 0 for masked taxels."""
    whole = np.zeros((len(valid), len(problem.surface.components) * math.prod(problem.surface.shape)))
    whole[valid > 0] = operator.dense()
    parts = whole.reshape(len(valid), len(problem.surface.components), -1)[:, list(problem.columns)]
    return np.ascontiguousarray(parts.reshape(len(valid), -1))


def _of_depths(problem: Problem, pad: Any, valid: Floats, depth_range: float) -> Floats:
    """Chebyshev coefficients (degree, reading, unknown) of the map over relative depths 1 +- ``depth_range``."""
    nodes = np.cos(np.pi * (np.arange(DEPTHS) + 0.5) / DEPTHS)
    sampled = []
    for x in nodes:
        moved_pad, moved = stretched(pad, problem.planes, depth=1.0 + depth_range * float(x))
        sampled.append(_dense(problem, Operator(moved_pad, moved, problem.surface, problem.boundary), valid))
    weights = 2.0 / DEPTHS * np.cos(np.outer(np.arange(DEPTHS), np.arccos(nodes)))
    weights[0] *= 0.5
    return np.asarray(np.tensordot(weights, np.stack(sampled), axes=1))


def _penalty(problem: Problem, parameter: float, cone: Cone | None) -> tuple[Floats, Floats]:
    """The penalty (unknown, unknown) times the parameter, and its inverse."""
    surface = problem.surface
    shear = 1.0 if cone is None else 0.5 * (cone.friction or Policy().prior.shear) ** 2
    laplacian = Differences(surface).laplacian.toarray() * surface.cell
    inside = np.linalg.inv(laplacian)
    variances = [1.0 if surface.components[c] == "z" else shear for c in problem.columns]
    return _diagonal([parameter / v * laplacian for v in variances]), _diagonal(
        [v / parameter * inside for v in variances]
    )


def _diagonal(blocks: list[Floats]) -> Floats:
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))


# -- formulas, for any namespace. ``a`` holds the arrays of `Matrices` by name --------------------------------------------


def _map(xp: Any, m: Matrices, a: Mapping[str, Any], p: Mapping[str, Any]) -> Any:
    """A (reading, unknown) for a given modulus, depth and gains; NaN if the depth leaves its range."""
    out = a["here"]
    depth = p.get("depth")
    if depth is not None:
        if not m.depth_range:
            raise Unsupported(
                "depth was passed to a skin that was prepared for none: pass depth_range=0.2 where it is made."
            )
        x = (depth - 1.0) / m.depth_range
        terms = [xp.ones_like(x), x]
        while len(terms) < m.degrees:
            terms.append(2.0 * x * terms[-1] - terms[-2])
        out = xp.tensordot(xp.stack(terms), a["coefficients"], 1)
        nothing = xp.ones_like(x) * math.nan
        out = out * xp.where(abs(x) <= 1.0 + 1e-9, xp.ones_like(x), nothing)
    if p.get("modulus") is not None:
        out = out * (1.0 + a["follows"] * (1.0 / p["modulus"] - 1.0))[:, None]
    if p.get("gains") is not None:
        out = out * _each(m, a, p["gains"], "gains")[:, None]
    return out


def _each(m: Matrices, a: Mapping[str, Any], value: Any, name: str) -> Any:
    """Expand one number per channel to one per reading; numbers per reading are only flattened."""
    if tuple(value.shape) == m.shape:
        return value.reshape(-1)
    if tuple(value.shape) == m.shape[:1]:
        return a["channel"] @ value
    raise InvalidInput(
        f"{name} must have the shape {m.shape} of a frame, or one number for each of {m.shape[0]} channels; got {tuple(value.shape)}. For numbers of "
        "their own for each frame use vmap."
    )


def _noise(m: Matrices, a: Mapping[str, Any], p: Mapping[str, Any]) -> Any:
    return a["noise"] if p.get("noise") is None else _each(m, a, p["noise"], "noise")


def _batch(value: Any, shape: tuple[int, ...], what: str) -> tuple[int, ...]:
    found = tuple(value.shape)
    if found[len(found) - len(shape) :] != shape or len(found) < len(shape):
        raise InvalidInput(f"{what} must have the shape (*batch, {', '.join(map(str, shape))}); got {found}.")
    return found[: len(found) - len(shape)]


def sensed(xp: Any, m: Matrices, a: Mapping[str, Any], traction: Any, p: Mapping[str, Any], normal: Any = None) -> Any:
    """Readings (*batch, channel, *array) of a traction (*batch, component, *surface); ``normal``: standard normal numbers, of the readings' shape."""
    batch = _batch(traction, m.surface, "traction")
    tail = len(m.surface) - 1
    parts = [traction[(..., c, *(slice(None),) * tail)] for c in m.columns]
    flat = xp.stack(parts, -1 - tail).reshape((-1, m.unknowns))
    out = flat @ xp.swapaxes(_map(xp, m, a, p), 0, 1)
    if normal is not None:
        if p.get("noise") is None and "noise" not in a:
            raise Unsupported("normal numbers were given, and the array has no noise: give the array noise=....")
        out = out + normal.reshape((-1, m.readings)) * _noise(m, a, p)
    if not m.whole:
        out = xp.where(a["valid"] > 0, out, math.nan * xp.ones_like(out))
    return out.reshape((*batch, *m.shape))


def flat_readings(xp: Any, m: Matrices, a: Mapping[str, Any], readings: Any) -> tuple[Any, tuple[int, ...]]:
    """Readings as (frame, reading), with 0 for masked taxels; and the batch axes."""
    batch = _batch(readings, m.shape, "readings")
    flat = readings.reshape((-1, m.readings))
    if not m.whole:
        flat = xp.where(a["valid"] > 0, flat, xp.zeros_like(flat))
    return flat, batch


def linear_traction(xp: Any, m: Matrices, a: Mapping[str, Any], flat: Any, p: Mapping[str, Any]) -> Any:
    """Traction (frame, unknown): C B' (1 + B C B')^-1 y/noise, where B = A/noise and C is the prior; or by the
    prepared matrix if nothing varies.
    """
    if not any(p.get(name) is not None for name in NAMES):
        return flat @ xp.swapaxes(a["inverse"], 0, 1)
    weight = a["valid"] / _noise(m, a, p)
    white = _map(xp, m, a, p) * weight[:, None]
    spread = a["prior"] @ xp.swapaxes(white, 0, 1)
    inner = white @ spread + xp.eye(m.readings, dtype=white.dtype, device=getattr(white, "device", None))
    return xp.swapaxes(spread @ xp.linalg.solve(inner, xp.swapaxes(flat * weight, 0, 1)), 0, 1)


def constrained_terms(xp: Any, m: Matrices, a: Mapping[str, Any], flat: Any, p: Mapping[str, Any]) -> tuple[Any, Any]:
    """H (unknown, unknown) and h (frame, unknown) of the constrained problem."""
    weight = a["valid"] / _noise(m, a, p)
    white = _map(xp, m, a, p) * weight[:, None]
    varied = any(p.get(name) is not None for name in NAMES)
    hessian = xp.swapaxes(white, 0, 1) @ white + a["penalty"] if varied else a["hessian"]
    return hessian, (flat * weight) @ white


def whole_traction(xp: Any, m: Matrices, found: Any, batch: tuple[int, ...]) -> Any:
    """Traction (*batch, component, *surface), with 0 in components that were not sought."""
    found = found.reshape((*batch, len(m.columns), *m.surface[1:]))
    tail = (slice(None),) * (len(m.surface) - 1)
    place = {c: i for i, c in enumerate(m.columns)}
    zero = xp.zeros_like(found[(..., 0, *tail)])
    parts = [found[(..., place[c], *tail)] if c in place else zero for c in range(m.surface[0])]
    return xp.stack(parts, -len(m.surface))
