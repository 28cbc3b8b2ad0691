"""A skin as functions of JAX: readings of a traction and traction of readings, with gradients.

`prepare` makes a pytree of a skin; `sense` and `reconstruct` are pure functions of it, batched, under ``jit``,
``vmap`` and ``grad``. Other parameters are passed as a mapping of "modulus", "depth", "gains" and "noise", and have gradients too. Numbers and formulas are those of `palpate.inverse.differentiable`; the
constrained minimum is that of `palpate.inverse.constrained`, found on the processor by a callback, and its gradients
follow from the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from palpate._extras import require
from palpate.errors import InvalidInput, Unsupported
from palpate.skin import Skin

require("functions of JAX", "jax")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from palpate.inverse import differentiable  # noqa: E402
from palpate.inverse.constrained.cone import Cone  # noqa: E402
from palpate.inverse.constrained.implicit import minima, pulled_back  # noqa: E402

__all__ = ["Model", "prepare", "reconstruct", "sense"]

_NAMES = ("here", "coefficients", "follows", "valid", "channel", "noise", "penalty", "prior", "inverse", "hessian")


@jax.tree_util.register_pytree_node_class
class Model:
    """A skin as a pytree: its matrices are leaves, their description is static. `prepare` makes one.

    Examples
    --------
    >>> import jax
    >>> import palpate as pp
    >>> from palpate.jax import prepare
    >>> array = pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    >>> model = prepare(pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array))
    >>> len(jax.tree_util.tree_leaves(model))
    4
    """

    def __init__(self, about: _About, arrays: Mapping[str, Any]) -> None:
        self.about, self.arrays = about, dict(arrays)

    def tree_flatten(self) -> tuple[list[Any], Any]:
        """Leaves and static parts."""
        names = sorted(self.arrays)
        return [self.arrays[n] for n in names], (self.about, tuple(names))

    @classmethod
    def tree_unflatten(cls, static: Any, leaves: Sequence[Any]) -> Model:
        """Rebuild the model from leaves and static parts."""
        return cls(static[0], dict(zip(static[1], leaves)))


class _About:
    """The static part of a `Model`: its prepared matrices. JAX compares static parts; these are equal only if they are
    the same object, so that a function is compiled once per skin, and not again at every call.
    """

    def __init__(self, matrices: differentiable.Matrices) -> None:
        self.matrices = matrices


def prepare(
    skin: Skin,
    *,
    parameter: float | None = None,
    friction: float | None = None,
    constrained: bool = True,
    components: Sequence[str] | None = None,
    depth_range: float = 0.0,
) -> Model:
    """Return a skin as a pytree for `sense` and, if a ``parameter`` is given, for `reconstruct`.

    Parameters
    ----------
    skin : Skin
        Its planes have one shape, and its pad does not creep.
    parameter : float, optional
        Weight of the penalty, as in `palpate.Tikhonov`; ``skin.reconstruct(readings, method="tikhonov").parameter`` gives a good one. Without one
        there is no inverse, and `sense` accepts all components.
    friction : float, optional
        |shear| <= friction * pressure in every cell.
    constrained : bool
        Whether pressure may only push.
    components : sequence of str, optional
        The components sought; the others are zero in `sense`. Default: `palpate.Skin.components` with a parameter, else all.
    depth_range : float
        Largest deviation of "depth" from 1, at most 0.5; 0 (default) keeps it fixed.

    Raises
    ------
    InvalidInput
        A parameter or range out of bounds; friction without constraint.
    Unsupported
        JAX is not installed; a pad that creeps, planes of different shapes, noise that is not given, a map that is too large.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.jax import prepare, sense
    >>> array = pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0)
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    >>> model = prepare(skin, parameter=1e-4)
    >>> sense(model, skin.sample(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.2))).shape
    (1, 4, 4)
    """
    if friction is not None and (not constrained or parameter is None):
        raise InvalidInput(
            "friction belongs to the constrained problem: give a parameter, and leave constrained=False out."
        )
    if components is None:
        components = skin.surface.components if parameter is None else skin.components
    found = differentiable.matrices(
        skin.problem(components=components),
        skin.pad,
        parameter=parameter,
        friction=friction,
        constrained=constrained and parameter is not None,
        depth_range=depth_range,
    )
    arrays = {name: getattr(found, name) for name in _NAMES if getattr(found, name) is not None}
    if not depth_range:
        del arrays["coefficients"]
    return Model(_About(found), {name: jnp.asarray(value) for name, value in arrays.items()})


def _given(model: Model, x: Any, parameters: Mapping[str, Any] | None) -> tuple[Any, dict[str, Any], Any]:
    """Arrays and parameters in the precision of the computation, which is that of the input if no parameter varies."""
    given = {name: value for name, value in (parameters or {}).items() if value is not None}
    unknown = sorted(set(given) - set(differentiable.NAMES))
    if unknown:
        raise InvalidInput(f"parameters must be named {', '.join(differentiable.NAMES)}; got {', '.join(unknown)}.")
    dtype = x.dtype
    if given:
        if not jax.config.jax_enable_x64:
            raise Unsupported(
                "modulus, depth, gains and noise need double precision inside: jax.config.update('jax_enable_x64', True). The input and the result may stay float32."
            )
        dtype = jnp.dtype("float64")
    arrays = {name: value.astype(dtype) for name, value in model.arrays.items()}
    return arrays, {name: jnp.asarray(value, dtype=dtype) for name, value in given.items()}, dtype


def _floating(x: Any, what: str) -> Any:
    found = jnp.asarray(x)
    if found.dtype not in (jnp.dtype("float32"), jnp.dtype("float64")):
        raise InvalidInput(f"{what} must be float32 or float64; got {found.dtype}: pass jnp.asarray(x, dtype=float).")
    return found


def sense(model: Model, traction: Any, parameters: Mapping[str, Any] | None = None, *, normal: Any = None) -> jax.Array:
    """Readings (*batch, channel, *array) of a traction (*batch, component, *surface) [Pa].

    Parameters
    ----------
    model : Model
    traction : array
    parameters : mapping, optional
        "modulus" and "depth": numbers relative to the skin's (1 is as described; NaN comes back where depth leaves its range); "gains" and "noise": one for each
        reading (channel, *array) or channel. For a different value in each frame: ``jax.vmap``.
    normal : array, optional
        Standard normal numbers of the readings' shape, times the noise.

    Raises
    ------
    InvalidInput
        An array of the wrong shape or type, or an unknown parameter.
    Unsupported
        Parameters while JAX computes in single precision; a depth for a model without a range.

    Examples
    --------
    >>> import jax, jax.numpy as jnp
    >>> import palpate as pp
    >>> from palpate.jax import prepare, sense
    >>> array = pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    >>> model = prepare(skin)
    >>> jax.jit(sense)(model, jnp.ones((32, 3, *skin.surface.shape))).shape
    (32, 1, 4, 4)
    """
    t = _floating(traction, "traction")
    arrays, given, dtype = _given(model, t, parameters)
    wide = None if normal is None else _floating(normal, "normal").astype(dtype)
    return differentiable.sensed(jnp, model.about.matrices, arrays, t.astype(dtype), given, wide).astype(t.dtype)


def reconstruct(model: Model, readings: Any, parameters: Mapping[str, Any] | None = None) -> jax.Array:
    """Traction (*batch, component, *surface) [Pa] of readings (*batch, channel, *array).

    The rest as for `sense`. The constrained minimum is exact to 1e-9 in double precision; a frame that does not reach this is NaN.

    Raises
    ------
    Unsupported
        A model that was prepared without a parameter; parameters while JAX computes in single precision.

    Examples
    --------
    >>> import jax
    >>> import palpate as pp
    >>> from palpate.jax import prepare, reconstruct
    >>> array = pp.AreaArray(shape=(5, 5), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0)
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    >>> readings = skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.2))
    >>> model = prepare(skin, parameter=1e-4)
    >>> force = lambda r: reconstruct(model, r)[2].sum() * skin.surface.cell
    >>> round(float(force(readings)), 2), jax.grad(force)(jax.numpy.asarray(readings)).shape
    (0.21, (1, 5, 5))
    """
    m = model.about.matrices
    if m.inverse is None:
        raise Unsupported("the model was prepared for sense alone: pass parameter=... to prepare.")
    y = _floating(readings, "readings")
    arrays, given, dtype = _given(model, y, parameters)
    flat, batch = differentiable.flat_readings(jnp, m, arrays, y.astype(dtype))
    if m.cone is None:
        found = differentiable.linear_traction(jnp, m, arrays, flat, given)
    elif given:
        found = _minimum(m.cone, *differentiable.constrained_terms(jnp, m, arrays, flat, given))
    else:
        found = _of_readings(model.about, flat)
    return differentiable.whole_traction(jnp, m, found, batch).astype(y.dtype)


def _called(function: Any, like: Any, *arrays: Any) -> Any:
    """Call a NumPy function of arrays with leading batch axes; its result has the shape and type of ``like``."""

    shape, dtype = jax.ShapeDtypeStruct(like.shape, like.dtype), np.dtype(like.dtype)

    def computed(*given: Any) -> Any:  # the callback must not hold a tracer
        return np.asarray(function(*(np.asarray(v, dtype=np.float64) for v in given)), dtype=dtype)

    return jax.pure_callback(computed, shape, *arrays, vmap_method="expand_dims")


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _minimum(cone: Cone, hessian: Any, linear: Any) -> Any:
    return _called(partial(_minima, cone), linear, hessian, linear)


def _minima(cone: Cone, hessian: Any, linear: Any) -> Any:
    hessian, linear = _together(hessian, linear)
    return minima(hessian, linear, cone)


def _together(hessian: Any, *frames: Any) -> list[Any]:
    """Broadcast arrays of frames (*vmap, frame, n) to all axes of the vmap, and insert an axis for the frames into the
    Hessians (*vmap, n, n).
    """
    lead = np.broadcast_shapes(hessian.shape[:-2], *(v.shape[:-2] for v in frames))
    return [hessian[..., None, :, :], *(np.broadcast_to(v, (*lead, *v.shape[-2:])) for v in frames)]


def _minimum_forward(cone: Cone, hessian: Any, linear: Any) -> Any:
    found = _minimum(cone, hessian, linear)
    return found, (hessian, linear, found)


def _minimum_backward(cone: Cone, kept: Any, gradient: Any) -> Any:
    hessian, linear, found = kept

    def pull(h: Any, b: Any, x: Any, g: Any) -> Any:
        h, b, x, g = _together(h, b, x, g)
        return pulled_back(h, b, x, g, cone)

    g = _called(pull, linear, hessian, linear, found, gradient)
    outer = jnp.einsum("bi,bj->ij", g, found)
    return -0.5 * (outer + outer.T), g


_minimum.defvjp(_minimum_forward, _minimum_backward)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _of_readings(about: _About, flat: Any) -> Any:
    """Minimum if no parameter varies; then everything except the readings is on the processor, in double precision."""
    m = about.matrices
    like = jax.ShapeDtypeStruct((*flat.shape[:-1], m.unknowns), flat.dtype)
    return _called(lambda y: minima(m.hessian, _linear(m, y), m.cone), like, flat)  # type: ignore[arg-type]


def _linear(m: differentiable.Matrices, flat: Any) -> Any:
    weight = m.valid / np.asarray(m.noise)
    return (flat * weight) @ (m.here * weight[:, None])


def _of_readings_forward(about: _About, flat: Any) -> Any:
    found = _of_readings(about, flat)
    return found, (flat, found)


def _of_readings_backward(about: _About, kept: Any, gradient: Any) -> Any:
    m, (flat, found) = about.matrices, kept
    weight = m.valid / np.asarray(m.noise)

    def pull(y: Any, x: Any, g: Any) -> Any:
        back = pulled_back(m.hessian, _linear(m, y), x, g, m.cone)  # type: ignore[arg-type]
        return (back @ (m.here * weight[:, None]).T) * weight

    return (_called(pull, flat, flat, found, gradient),)


_of_readings.defvjp(_of_readings_forward, _of_readings_backward)
