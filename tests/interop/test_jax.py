"""Functions of JAX: the skin's own numbers, derivatives that differences agree with, and one compilation."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import palpate as pp
from differentiable import CASES, PARAMETER, frames, parameters, quotient, skin, weights
from long_runs import long_runs

jax = pytest.importorskip("jax")

import jax.numpy as jnp  # noqa: E402

from palpate.jax import Model, prepare, reconstruct, sense  # noqa: E402


@pytest.fixture(autouse=True, scope="module")
def double() -> Iterator[None]:
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.fixture(scope="module", params=["stress", "mixed"])
def of(request: Any) -> pp.Skin:
    return skin(request.param)


@lru_cache
def model_of(of: pp.Skin, **options: Any) -> Model:
    return prepare(of, **options)


@pytest.mark.long
def test_senses_as_the_skin_does(of: pp.Skin) -> None:
    traction = np.random.default_rng(0).standard_normal((5, 3, *of.surface.shape)) * 1e3
    expected = of.sense(traction)
    for dtype, tolerance in (("float64", 1e-12), ("float32", 1e-5)):
        found = sense(model_of(of), jnp.asarray(traction, dtype=dtype))
        assert found.dtype == dtype
        assert np.array_equal(np.isnan(found), np.isnan(expected))
        for c in range(3):
            np.testing.assert_allclose(found[:, c], expected[:, c], atol=tolerance * np.nanmax(np.abs(expected[:, c])))


@pytest.mark.long
def test_the_linear_inverse_is_tikhonovs(of: pp.Skin) -> None:
    readings = frames(of, 3)
    expected = of.reconstruct(readings, method=pp.Tikhonov(parameter=PARAMETER)).values
    model = prepare(of, parameter=PARAMETER, constrained=False)
    size = np.abs(expected).max()
    np.testing.assert_allclose(reconstruct(model, readings), expected, atol=1e-8 * size)
    noise = jnp.asarray(of.planes[0].noise_std)
    np.testing.assert_allclose(
        reconstruct(model, readings, {"noise": noise, "modulus": 1.0}), expected, atol=1e-7 * size
    )
    single = reconstruct(model, jnp.asarray(readings, dtype="float32"))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, expected, atol=1e-3 * size)


@pytest.mark.parametrize(
    ("of", "case"),
    [
        *(("stress", "linear"), ("stress", "pressing"), ("mixed", "within friction")),
        *long_runs(("mixed", "linear"), ("mixed", "pressing"), ("stress", "within friction")),
    ],
    indirect=["of"],
)
@pytest.mark.long
def test_gradients_of_the_inverse_agree_with_differences(of: pp.Skin, case: str) -> None:
    """Of readings, modulus, depth, gains and noise; all at once by jax.grad of a pytree, under jit."""
    constrained, friction = CASES[case]
    model = model_of(of, parameter=PARAMETER, constrained=constrained, friction=friction, depth_range=0.2)
    given = parameters(of)
    readings = np.nan_to_num(frames(of, 2))
    weight = weights((2, 3, *of.surface.shape)) * 1e-4

    def loss(readings: Any, given: Any) -> Any:
        return (reconstruct(model, readings, given) * weight).sum()

    of_readings, of_given = jax.jit(jax.grad(loss, argnums=(0, 1)))(readings, given)
    rng = np.random.default_rng(1)
    size = 1e-3 * abs(float(loss(readings, given)))
    forward = jax.jit(loss)
    for name, at, found in [("readings", readings, of_readings)] + [(n, given[n], of_given[n]) for n in given]:
        direction = rng.standard_normal(at.shape) * np.abs(at)

        def along(value: Any, name: str = name) -> Any:
            return forward(value, given) if name == "readings" else forward(readings, {**given, name: value})

        expected = quotient(along, at, direction, 1e-5)
        assert abs(float((found * direction).sum()) - expected) < 1e-6 * max(abs(expected), size), name
    # nothing varied: the other road to the same gradient
    plain = jax.grad(lambda r: (reconstruct(model, r) * weight).sum())(readings)
    usual = {"noise": jnp.asarray(of.planes[0].noise_std)}
    same = jax.grad(lambda r: (reconstruct(model, r, usual) * weight).sum())(readings)
    np.testing.assert_allclose(plain, same, atol=1e-6 * np.abs(np.asarray(same)).max())


@pytest.mark.long
def test_gradients_of_readings_agree_with_differences(of: pp.Skin) -> None:
    model = model_of(of, depth_range=0.2)
    given = parameters(of)
    traction = weights((2, 3, *of.surface.shape)) * 1e3
    scale = np.asarray(of.planes[0].noise_std)[:, None, None]
    weight, normal = weights((2, 3, 6, 7)) / scale, weights((2, 3, 6, 7))

    def loss(traction: Any, given: Any) -> Any:
        return jnp.nansum(sense(model, traction, given, normal=normal) * weight)

    of_traction, of_given = jax.grad(loss, argnums=(0, 1))(traction, given)
    rng = np.random.default_rng(1)
    size = 1e-3 * abs(float(loss(traction, given)))
    for name, at, found in [("traction", traction, of_traction)] + [(n, given[n], of_given[n]) for n in given]:
        direction = rng.standard_normal(at.shape) * np.abs(at)

        def along(value: Any, name: str = name) -> Any:
            return loss(value, given) if name == "traction" else loss(traction, {**given, name: value})

        expected = quotient(along, at, direction, 1e-4)
        assert abs(float((found * direction).sum()) - expected) < 1e-6 * max(abs(expected), size), name


@pytest.mark.long
def test_the_second_call_compiles_nothing_and_no_tracer_leaks() -> None:
    of = skin()
    readings = frames(of, 2)
    for options in ({"constrained": False}, {"friction": 0.5}):
        model = model_of(of, parameter=PARAMETER, depth_range=0.2, **options)
        function = jax.jit(lambda m, r, d: reconstruct(m, r, {"depth": d}))
        function(model, readings, 0.98)
        function(model, 1.1 * readings, 1.01)
        function(jax.tree_util.tree_map(lambda x: x, model), readings, 1.0)
        assert function._cache_size() == 1
        plain = jax.jit(reconstruct)
        plain(model, readings)
        count = plain._cache_size()
        plain(model, 0.9 * readings)
        assert plain._cache_size() == count
        with jax.checking_leaks():
            jax.jit(jax.grad(lambda r, m=model: reconstruct(m, r, {"depth": 0.97}).sum()))(readings)


@pytest.mark.long
def test_vmap_is_a_loop() -> None:
    of = skin()
    model = model_of(of, parameter=PARAMETER, friction=0.5, depth_range=0.2)
    readings = frames(of, 3)
    together = np.asarray(reconstruct(model, readings))
    size = np.abs(together).max()
    np.testing.assert_allclose(jax.vmap(lambda r: reconstruct(model, r))(readings), together, atol=1e-7 * size)
    depths = jnp.asarray([0.95, 1.0, 1.1])

    def normal_force(r: Any, d: Any) -> Any:
        return reconstruct(model, r, {"depth": d})[2].sum()

    # over readings, over depths, over both: with gradients
    for axes, r, d in (((0, None), readings, depths[0]), ((None, 0), readings[0], depths), ((0, 0), readings, depths)):
        found = jax.jit(jax.vmap(jax.grad(normal_force, argnums=1), in_axes=axes))(r, d)
        for i in range(3):
            one = jax.grad(normal_force, argnums=1)(r[i] if axes[0] == 0 else r, d[i] if axes[1] == 0 else d)
            assert abs(float(found[i]) / float(one) - 1) < 1e-6


@pytest.mark.long
def test_what_is_refused() -> None:
    of = skin()
    model = model_of(of, parameter=PARAMETER, friction=0.5, depth_range=0.2)
    readings = frames(of, 1)
    with pytest.raises(pp.InvalidInput, match="got youngs_modulus"):
        reconstruct(model, readings, {"youngs_modulus": 1.0})
    with pytest.raises(pp.Unsupported, match="pass parameter="):
        reconstruct(model_of(of), readings)
    with pytest.raises(pp.InvalidInput, match="readings must have the shape"):
        reconstruct(model, readings[:, :2])
    with pytest.raises(pp.InvalidInput, match="float32 or float64"):
        reconstruct(model, np.zeros((3, 6, 7), dtype=int))
    assert np.isnan(reconstruct(model, readings, {"depth": 1.3})).all()
    with jax.enable_x64(False), pytest.raises(pp.Unsupported, match="jax_enable_x64"):
        reconstruct(model, jnp.zeros((3, 6, 7)), {"modulus": 1.0})
