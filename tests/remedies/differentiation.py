"""Functions of JAX and the preparation that PyTorch's layers share; what a refusal says that they must be."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import palpate as pp
from palpate.jax import prepare, reconstruct, sense
from remedies._remedy import Remedy, value

__all__ = ["REMEDIES"]

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


def skin(**changed: Any) -> pp.Skin:
    given: dict[str, Any] = {"shape": (4, 4), "pitch": 1e-3, "depth": 1e-3, "channels": ["stress_zz"], "noise": 20.0}
    return pp.Skin(PAD, pp.AreaArray(**(given | changed)))


SKIN, SILENT = skin(), skin(noise=None)
SHEAR = skin(channels=["stress_xz", "stress_yz", "stress_zz"])
HUGE = skin(shape=(80, 80))
CREEPS = pp.Skin(pp.Viscoelastic(PAD, prony=[(0.2, 1.0)]), SKIN.planes[0])
TWO = pp.Skin(PAD, [skin().planes[0], skin(shape=(3, 3), depth=2e-3).planes[0]])
READINGS = np.asarray(SKIN.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.2)))
PARAMETER = 1e-4
TRACTION = np.ones((3, *SKIN.surface.shape))
COARSE = pp.AreaGrid(shape=(10, 10), spacing=8e-3)


def found(model: Any, readings: Any = READINGS, given: Any = None, *, double: bool = True) -> Any:
    """A reconstruction in double precision, which is put back afterwards."""
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", double)
    try:
        return reconstruct(model, readings, given)
    finally:
        jax.config.update("jax_enable_x64", before)


def linear(of: pp.Skin = SKIN, **options: Any) -> Any:
    return prepare(of, parameter=PARAMETER, constrained=False, **options)


REMEDIES = [
    value(
        "friction belongs to the constrained problem: give a parameter",
        lambda v: prepare(SHEAR, friction=0.5, parameter=PARAMETER, **v),
        {"constrained": False},
        {},
    ),
    value("parameters must be named", lambda v: found(linear(), given={v: 1.1}), "stiffness", "modulus"),
    value(
        "must be float32 or float64; got {}: pass jnp",
        lambda v: found(linear(), v),
        np.ones((1, 4, 4), dtype=int),
        jnp.asarray(np.ones((1, 4, 4), dtype=int), dtype=float),
    ),
    value(
        "the model was prepared for sense alone",
        lambda v: found(prepare(SKIN, **v)),
        {},
        {"parameter": PARAMETER},
    ),
    Remedy(
        "need double precision inside",
        lambda: found(linear(), given={"modulus": 1.1}, double=False),
        lambda: found(linear(), given={"modulus": 1.1}),
    ),
    value(
        "must have the shape {} of a frame, or one number for each of {} channels",
        lambda v: found(linear(), given={"noise": v}),
        np.ones(3),
        np.full(1, 20.0),
    ),
    value("the differentiable layers know no history", prepare, CREEPS, CREEPS.without_creep()),
    value("the differentiable layers need planes of one shape", prepare, TWO, pp.Skin(TWO.pad, TWO.planes[0])),
    value("depth_range must be a part of the depth", lambda v: prepare(SKIN, depth_range=v), 2.0, 0.2),
    value(
        "parameter must be one positive number, such as skin.reconstruct",
        lambda v: prepare(SKIN, parameter=v),
        -1.0,
        SKIN.reconstruct(READINGS, method="tikhonov").parameter,
    ),
    value("must have the shape (*batch, {})", lambda v: found(linear(), v), READINGS[0, :3], READINGS),
    value("make matrices of more than {} MB", prepare, HUGE, pp.Skin(PAD, HUGE.planes[0], surface=COARSE)),
    Remedy(
        "normal numbers were given, and the array has no noise",
        lambda: sense(prepare(SILENT), TRACTION, normal=np.ones((1, 4, 4))),
        lambda: sense(prepare(SKIN), TRACTION, normal=np.ones((1, 4, 4))),
    ),
    value("the differentiable inverse weighs readings by their noise", linear, SILENT, SKIN),
    value(
        "depth was passed to a skin that was prepared for none",
        lambda v: found(linear(**v), given={"depth": 1.05}),
        {},
        {"depth_range": 0.2},
    ),
]
