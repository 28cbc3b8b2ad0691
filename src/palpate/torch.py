"""A skin as layers of PyTorch: readings of a traction and traction of readings, with gradients.

Both are `torch.nn.Module`, batched, for float32 and float64, under `torch.func.vmap` and `torch.compile`. Other
parameters (modulus, depth, gains, noise) are passed to each call and have gradients too. Numbers and formulas are
those of `palpate.inverse.differentiable`; the constrained minimum is that of `palpate.inverse.constrained`, and its
gradients follow from the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate._extras import require
from palpate.errors import InvalidInput, Unsupported
from palpate.skin import Skin

require("layers of PyTorch", "torch")

import numpy as np  # noqa: E402
import torch  # noqa: E402

from palpate.inverse import differentiable  # noqa: E402
from palpate.inverse.constrained.cone import Cone  # noqa: E402
from palpate.inverse.constrained.implicit import MANY, minima, pulled_back, together  # noqa: E402

__all__ = ["Reconstruct", "Sense"]

Tensor = Any


def _cone(components: str, friction: float) -> Cone:
    return Cone(tuple(components), friction if friction > 0 else None)


def _back(found: Any, like: Tensor) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(found)).to(dtype=like.dtype, device=like.device)


def _numpy(x: Tensor) -> Any:
    return x.detach().cpu().double().numpy()


@torch.library.custom_op("palpate::minimum", mutates_args=())
def _minimum(hessian: torch.Tensor, linear: torch.Tensor, components: str, friction: float) -> torch.Tensor:
    cone = _cone(components, friction)
    if hessian.ndim == linear.ndim == 2 and len(linear) >= MANY:
        # solve on the tensors' device; frames that remain unsolved go to the processor
        found, solved = together(hessian.double(), linear.double(), cone)
        if not bool(solved.all()):
            found[~solved] = _back(minima(_numpy(hessian), _numpy(linear[~solved]), cone), found)
        return found.to(linear.dtype)
    return _back(minima(_numpy(hessian), _numpy(linear), cone), linear)


@torch.library.custom_op("palpate::minimum_pulled_back", mutates_args=())
def _pulled(
    hessian: torch.Tensor,
    linear: torch.Tensor,
    solution: torch.Tensor,
    gradient: torch.Tensor,
    components: str,
    friction: float,
) -> torch.Tensor:
    found = pulled_back(
        _numpy(hessian), _numpy(linear), _numpy(solution), _numpy(gradient), _cone(components, friction)
    )
    return _back(found, linear)


@_minimum.register_fake
def _(hessian: Tensor, linear: Tensor, components: str, friction: float) -> Tensor:
    return torch.empty_like(linear)


@_pulled.register_fake
def _(hessian: Tensor, linear: Tensor, solution: Tensor, gradient: Tensor, components: str, friction: float) -> Tensor:
    return torch.empty_like(linear)


class _Minimum(torch.autograd.Function):
    """The constrained minimum with a backward pass: first derivatives."""

    @staticmethod
    def forward(hessian: Tensor, linear: Tensor, components: str, friction: float) -> Tensor:
        return _minimum(hessian, linear, components, friction)

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Tensor) -> None:
        hessian, linear, ctx.components, ctx.friction = inputs
        ctx.save_for_backward(hessian, linear, output)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        hessian, linear, solution = ctx.saved_tensors
        g = _Pulled.apply(hessian, linear, solution, gradient, ctx.components, ctx.friction)
        of_hessian = None
        if ctx.needs_input_grad[0]:
            if hessian.ndim == 2:
                outer = g.reshape(-1, g.shape[-1]).T @ solution.reshape(-1, g.shape[-1])
            else:  # called within a vmap: (*vmap, 1, n, n)
                outer = torch.einsum("...bi,...bj->...ij", g, solution).unsqueeze(-3)
            of_hessian = -0.5 * (outer + outer.transpose(-1, -2))
        return of_hessian, g, None, None

    @staticmethod
    def vmap(info: Any, places: Any, hessian: Tensor, linear: Tensor, components: str, friction: float) -> Any:
        h = _first(linear, places[1], info.batch_size)
        if places[0] is not None:
            hessian = hessian.movedim(places[0], 0)
            if hessian.ndim == 3:
                hessian = hessian.unsqueeze(1)
        return _Minimum.apply(hessian, h, components, friction), 0


def _first(x: Tensor, place: int | None, size: int) -> Tensor:
    return x.expand(size, *x.shape) if place is None else x.movedim(place, 0)


class _Pulled(torch.autograd.Function):
    """The backward pass, which itself has no derivative."""

    @staticmethod
    def forward(
        hessian: Tensor, linear: Tensor, solution: Tensor, gradient: Tensor, components: str, friction: float
    ) -> Tensor:
        return _pulled(hessian, linear, solution, gradient, components, friction)

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Tensor) -> None:
        pass

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        raise Unsupported(
            "the constrained inverse has only first derivatives: use constrained=False if you need second ones."
        )

    @staticmethod
    def vmap(
        info: Any,
        places: Any,
        hessian: Tensor,
        linear: Tensor,
        solution: Tensor,
        gradient: Tensor,
        components: str,
        friction: float,
    ) -> Any:
        frames = (linear, solution, gradient)
        h, x, g = (_first(v, at, info.batch_size).contiguous() for v, at in zip(frames, places[1:4]))
        if places[0] is not None:
            hessian = hessian.movedim(places[0], 0)
            if hessian.ndim == 3:
                hessian = hessian.unsqueeze(1)
        return _Pulled.apply(hessian, h, x, g, components, friction), 0


class _Layer(torch.nn.Module):
    """Base of both layers: the matrices of a skin are buffers, which move with the module. They are kept in double
    precision, and converted to that of the input when used.
    """

    def __init__(self, matrices: differentiable.Matrices) -> None:
        super().__init__()
        self._matrices = matrices
        names = (
            "here",
            "coefficients",
            "follows",
            "valid",
            "channel",
            "noise",
            "penalty",
            "prior",
            "inverse",
            "hessian",
        )
        self._names = []
        for name in names:
            value = getattr(matrices, name)
            if value is not None and (name != "coefficients" or matrices.depth_range):
                self._names.append(name)
                self.register_buffer(f"_{name}", torch.from_numpy(np.array(value, dtype=np.float64)), persistent=False)

    def _apply(self, fn: Any, recurse: bool = True) -> Any:
        """Move to a device, but stay in double precision: precision that an inverse loses in single precision cannot
        be recovered.
        """
        kept = {name: getattr(self, f"_{name}") for name in self._names}
        out = super()._apply(fn, recurse)
        for name, value in kept.items():
            setattr(self, f"_{name}", value.to(device=getattr(self, f"_{name}").device))
        return out

    def _arrays(self, dtype: Any) -> dict[str, Tensor]:
        return {name: getattr(self, f"_{name}").to(dtype) for name in self._names}

    def _parameters_of(self, given: dict[str, Any], like: Tensor) -> dict[str, Tensor]:
        return {
            name: torch.as_tensor(value, dtype=torch.float64, device=like.device)
            for name, value in given.items()
            if value is not None
        }


def _checked(x: Any, what: str) -> None:
    if not isinstance(x, torch.Tensor) or x.dtype not in (torch.float32, torch.float64):
        kind = f"a tensor of {x.dtype}" if isinstance(x, torch.Tensor) else type(x).__name__
        raise InvalidInput(
            f"{what} must be a tensor of float32 or float64; got {kind}: pass torch.as_tensor(x, dtype=torch.float64)."
        )


class Sense(_Layer):
    """Readings of a traction, as `palpate.Skin.sense` gives them.

    Parameters
    ----------
    skin : Skin
        Its planes have one shape, and its pad does not creep.
    depth_range : float
        Largest difference of ``depth`` from 1, at most 0.5; 0 (default) if it is not varied.

    Examples
    --------
    >>> import torch
    >>> import palpate as pp
    >>> from palpate.torch import Sense
    >>> array = pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=["strain_zz"])
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    >>> sense = Sense(skin)
    >>> traction = torch.zeros(32, 3, *skin.surface.shape, requires_grad=True)
    >>> readings = sense(traction)
    >>> readings.shape, readings.dtype
    (torch.Size([32, 1, 4, 4]), torch.float32)
    """

    def __init__(self, skin: Skin, *, depth_range: float = 0.0) -> None:
        names = skin.surface.components
        super().__init__(_prepared(skin, names, depth_range=depth_range))

    def forward(
        self,
        traction: Tensor,
        *,
        modulus: Any = None,
        depth: Any = None,
        gains: Any = None,
        noise: Any = None,
        normal: Tensor | None = None,
    ) -> Tensor:
        """Readings (*batch, channel, *array) of a traction (*batch, component, *surface) [Pa].

        ``modulus`` and ``depth`` are numbers relative to the skin's (1 is as described), ``gains`` and ``noise`` one
        for each reading (channel, *array) or channel; ``normal`` standard normal numbers of the readings' shape, times
        the noise. For a different value in each frame: `torch.func.vmap`.
        """
        _checked(traction, "traction")
        given = self._parameters_of({"modulus": modulus, "depth": depth, "gains": gains, "noise": noise}, traction)
        if given:  # compute in double precision, as the parameters are given
            wide = None if normal is None else normal.double()
            out = differentiable.sensed(
                torch, self._matrices, self._arrays(torch.float64), traction.double(), given, wide
            )
            return out.to(traction.dtype)
        return differentiable.sensed(torch, self._matrices, self._arrays(traction.dtype), traction, {}, normal)


def _prepared(skin: Skin, components: Sequence[str], **options: Any) -> differentiable.Matrices:
    return differentiable.matrices(skin.problem(components=components), skin.pad, **options)


class Reconstruct(_Layer):
    """Traction of readings, with one given weight of the penalty.

    Parameters
    ----------
    skin : Skin
        Planes of one shape with noise, no creep.
    parameter : float
        Weight of the penalty, as in `palpate.Tikhonov`; ``skin.reconstruct(readings, method="tikhonov").parameter``
        gives a good value.
    friction : float, optional
        |shear| <= friction * pressure in every cell.
    constrained : bool
        Whether pressure can only push (default).
    components : sequence of str, optional
        Components to estimate. Default: `palpate.Skin.components`.
    depth_range : float
        Largest difference of ``depth`` from 1, at most 0.5; 0 (default) if it is not varied.

    Notes
    -----
    The constrained minimum is found on the processor, frame by frame, to 1e-9; a frame that does not reach this is
    NaN. Gradients hold on the face of the cone on which the minimum lies. There are no second derivatives.

    Examples
    --------
    >>> import numpy as np, torch
    >>> import palpate as pp
    >>> from palpate.torch import Reconstruct
    >>> array = pp.AreaArray(shape=(5, 5), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0)
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    >>> readings = torch.tensor(skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.2)), requires_grad=True)
    >>> traction = Reconstruct(skin, parameter=1e-4)(readings)
    >>> force = traction[2].sum() * skin.surface.cell
    >>> force.backward()
    >>> round(force.item(), 2), readings.grad.shape
    (0.21, torch.Size([1, 5, 5]))
    """

    def __init__(
        self,
        skin: Skin,
        *,
        parameter: float,
        friction: float | None = None,
        constrained: bool = True,
        components: Sequence[str] | None = None,
        depth_range: float = 0.0,
    ) -> None:
        if friction is not None and not constrained:
            raise InvalidInput("friction belongs to the constrained problem: leave constrained=False out, or friction.")
        super().__init__(
            _prepared(
                skin,
                skin.components if components is None else components,
                parameter=parameter,
                friction=friction,
                constrained=constrained,
                depth_range=depth_range,
            )
        )

    def forward(
        self, readings: Tensor, *, modulus: Any = None, depth: Any = None, gains: Any = None, noise: Any = None
    ) -> Tensor:
        """Traction (*batch, component, *surface) [Pa] of readings (*batch, channel, *array); the rest as in `Sense`."""
        _checked(readings, "readings")
        given = self._parameters_of({"modulus": modulus, "depth": depth, "gains": gains, "noise": noise}, readings)
        m = self._matrices
        dtype = torch.float64 if given or m.cone is not None else readings.dtype
        arrays = self._arrays(dtype)
        flat, batch = differentiable.flat_readings(torch, m, arrays, readings.to(dtype))
        if m.cone is None:
            found = differentiable.linear_traction(torch, m, arrays, flat, given)
        else:
            hessian, linear = differentiable.constrained_terms(torch, m, arrays, flat, given)
            found = _Minimum.apply(hessian, linear, "".join(m.cone.components), float(m.cone.friction or 0.0))
        return differentiable.whole_traction(torch, m, found, batch).to(readings.dtype)
