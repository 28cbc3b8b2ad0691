"""Layers of PyTorch: the skin's own numbers, and derivatives that differences agree with."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import palpate as pp
from differentiable import CASES, PARAMETER, frames, parameters, quotient, skin, weights

torch = pytest.importorskip("torch", reason="PyTorch (palpate[torch]) is not installed: its layers were not tested")

from palpate.torch import Reconstruct, Sense  # noqa: E402


@pytest.fixture(scope="module", params=["stress", "mixed"])
def of(request: Any) -> pp.Skin:
    return skin(request.param)


@lru_cache
def layer_of(of: pp.Skin, **options: Any) -> Any:
    return Reconstruct(of, parameter=PARAMETER, **options) if "constrained" in options else Sense(of, **options)


def test_senses_as_the_skin_does(of: pp.Skin) -> None:
    traction = np.random.default_rng(0).standard_normal((5, 3, *of.surface.shape)) * 1e3
    expected = of.sense(traction)
    for dtype, tolerance in ((torch.float64, 1e-12), (torch.float32, 1e-5)):
        found = Sense(of)(torch.tensor(traction, dtype=dtype))
        assert found.dtype == dtype
        assert np.array_equal(np.isnan(found.numpy()), np.isnan(expected))
        for c in range(3):
            np.testing.assert_allclose(found[:, c], expected[:, c], atol=tolerance * np.nanmax(np.abs(expected[:, c])))


@pytest.mark.parametrize("depth", [0.85, 1.0, 1.13])
def test_depth_and_modulus_are_those_of_another_skin(of: pp.Skin, depth: float) -> None:
    """A pad 1.3 times as stiff with taxels at another depth, made anew, reads the same."""
    from dataclasses import replace

    pad = pp.HalfSpace(youngs_modulus=1.3 * of.pad.youngs_modulus, poissons_ratio=of.pad.poissons_ratio)
    other = pp.Skin(pad, replace(of.planes[0], depth=depth * of.planes[0].depth), surface=of.surface)
    traction = np.random.default_rng(0).standard_normal((2, 3, *of.surface.shape)) * 1e3
    expected = other.sense(traction)
    found = Sense(of, depth_range=0.2)(torch.tensor(traction), depth=depth, modulus=1.3)
    for c in range(3):
        np.testing.assert_allclose(found[:, c], expected[:, c], atol=1e-8 * np.nanmax(np.abs(expected[:, c])))


def test_a_depth_beyond_its_range_is_no_number(of: pp.Skin) -> None:
    traction = torch.ones((3, *of.surface.shape), dtype=torch.float64)
    assert torch.isnan(Sense(of, depth_range=0.1)(traction, depth=1.2)).all()
    with pytest.raises(pp.Unsupported, match="depth_range"):
        Sense(of)(traction, depth=1.05)


def test_the_linear_inverse_is_tikhonovs(of: pp.Skin) -> None:
    readings = frames(of, 3)
    expected = of.reconstruct(readings, method=pp.Tikhonov(parameter=PARAMETER)).values
    layer = Reconstruct(of, parameter=PARAMETER, constrained=False)
    size = np.abs(expected).max()
    np.testing.assert_allclose(layer(torch.tensor(readings)), expected, atol=1e-8 * size)
    single = layer(torch.tensor(readings, dtype=torch.float32))
    assert single.dtype == torch.float32
    np.testing.assert_allclose(single, expected, atol=1e-3 * size)
    # what is passed and is as the skin says changes nothing
    noise = torch.tensor(of.planes[0].noise_std, dtype=torch.float64)
    again = layer(torch.tensor(readings), modulus=1.0, gains=torch.ones(3, dtype=torch.float64), noise=noise)
    np.testing.assert_allclose(again, expected, atol=1e-7 * size)


def test_the_constrained_inverse_is_the_minimum(of: pp.Skin) -> None:
    """Against a conic solver's minimum."""
    clarabel = pytest.importorskip("clarabel")
    import scipy.sparse as sparse

    readings = frames(of, 1)
    layer = Reconstruct(of, parameter=PARAMETER, friction=0.5)
    found = layer(torch.tensor(readings))[0].numpy()
    m = layer._matrices
    weight = m.valid / m.noise
    linear = (np.nan_to_num(readings.reshape(-1)) * weight) @ (m.here * weight[:, None])
    n = m.hessian.shape[0] // 3
    scale = m.hessian.diagonal().max() ** -0.5
    rows = []
    for i in range(n):  # (mu p, q_x, q_y) in the second-order cone
        for column, value in ((2 * n + i, -0.5), (i, -1.0), (n + i, -1.0)):
            rows.append(sparse.csr_array(([value], ([0], [column])), shape=(1, 3 * n)))
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.tol_gap_rel, settings.tol_gap_abs, settings.tol_feas = False, 1e-12, 1e-12, 1e-12
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(m.hessian * scale**2),
        -linear * scale,
        sparse.csc_matrix(sparse.vstack(rows)),
        np.zeros(3 * n),
        [clarabel.SecondOrderConeT(3)] * n,
        settings,
    )
    expected = np.asarray(solver.solve().x).reshape(3, *of.surface.shape) * scale
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_many_frames_are_what_each_is_by_itself() -> None:
    """Together by products of matrices, one by one by Newton's method; a frame that has no answer has none among others."""
    of = skin()
    layer = Reconstruct(of, parameter=PARAMETER, friction=0.5)
    readings = np.concatenate([frames(of, 4) * size for size in (1.0, 1e-3, -1.0, 30.0, 0.0)])
    readings[7] = np.inf
    together = layer(torch.tensor(readings)).numpy()
    for i, one in enumerate(readings):
        alone = layer(torch.tensor(one)).numpy()
        np.testing.assert_allclose(together[i], alone, rtol=0, atol=1e-8 * max(np.abs(alone).max(), 1e-30))
    assert np.isnan(together[7]).all()


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize("name", ["readings", "modulus", "depth", "gains", "noise"])
def test_gradients_of_the_inverse_agree_with_differences(of: pp.Skin, case: str, name: str) -> None:
    constrained, friction = CASES[case]
    layer = layer_of(of, constrained=constrained, friction=friction, depth_range=0.2)
    given: dict[str, Any] = {"readings": np.nan_to_num(frames(of, 2)), **parameters(of)}
    tensors = {k: torch.tensor(v, dtype=torch.float64) for k, v in given.items()}
    weight = torch.tensor(weights((2, 3, *of.surface.shape))) * 1e-4

    def loss(value: Any) -> Any:
        use = {**tensors, name: torch.as_tensor(value, dtype=torch.float64)}
        return (layer(use.pop("readings"), **use) * weight).sum()

    at = tensors[name].clone().requires_grad_()
    loss(at).backward()
    direction = np.random.default_rng(1).standard_normal(given[name].shape) * np.abs(given[name])
    expected = quotient(loss, given[name], direction, 1e-5)
    assert abs(float((at.grad * torch.tensor(direction)).sum()) - expected) < 1e-6 * max(
        abs(expected), 1e-3 * abs(float(loss(at.detach())))
    )


@pytest.mark.parametrize("name", ["traction", "modulus", "depth", "gains", "noise"])
def test_gradients_of_readings_agree_with_differences(of: pp.Skin, name: str) -> None:
    layer = layer_of(of, depth_range=0.2)
    given: dict[str, Any] = {"traction": weights((2, 3, *of.surface.shape)) * 1e3, **parameters(of)}
    tensors = {k: torch.tensor(v, dtype=torch.float64) for k, v in given.items()}
    scale = torch.tensor(of.planes[0].noise_std).reshape(3, 1, 1)
    weight, normal = torch.tensor(weights((2, 3, 6, 7))) / scale, torch.tensor(weights((2, 3, 6, 7)))

    def loss(value: Any) -> Any:
        use = {**tensors, name: torch.as_tensor(value, dtype=torch.float64)}
        return torch.nansum(layer(use.pop("traction"), normal=normal, **use) * weight)

    at = tensors[name].clone().requires_grad_()
    loss(at).backward()
    direction = np.random.default_rng(1).standard_normal(given[name].shape) * np.abs(given[name])
    expected = quotient(loss, given[name], direction, 1e-4)
    size = 1e-3 * abs(float(loss(at.detach())))  # stress does not follow the modulus: 0
    assert abs(float((at.grad * torch.tensor(direction)).sum()) - expected) < 1e-6 * max(abs(expected), size)


def test_a_batch_is_its_frames_and_vmap_its_loop() -> None:
    of = skin()
    layer = Reconstruct(of, parameter=PARAMETER, friction=0.5, depth_range=0.2)
    readings = torch.tensor(frames(of, 4))
    together = layer(readings.reshape(2, 2, *readings.shape[1:])).reshape(4, 3, *of.surface.shape)
    size = float(together.abs().max())
    for one, frame in zip(together, readings):
        np.testing.assert_allclose(layer(frame), one, atol=1e-7 * size)
    np.testing.assert_allclose(torch.func.vmap(layer)(readings), together, atol=1e-7 * size)
    depths = torch.tensor([0.95, 1.0, 1.02, 1.1], dtype=torch.float64)
    mapped = torch.func.vmap(lambda r, d: layer(r, depth=d))(readings, depths)
    for one, frame, depth in zip(mapped, readings, depths):
        np.testing.assert_allclose(layer(frame, depth=depth), one, atol=1e-7 * size)
    each = torch.func.vmap(torch.func.grad(lambda r, d: layer(r, depth=d)[2].sum(), argnums=1))(readings, depths)
    for g, frame, depth in zip(each, readings, depths):
        at = depth.clone().requires_grad_()
        layer(frame, depth=at)[2].sum().backward()
        assert abs(float(g) / float(at.grad) - 1) < 1e-6


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # of torch's own compiler
def test_compiled_layers_give_the_same_and_compile_once() -> None:
    from torch._dynamo.testing import CompileCounter

    of = skin()
    readings = torch.tensor(frames(of, 2))
    for layer in (
        Reconstruct(of, parameter=PARAMETER, constrained=False),
        Reconstruct(of, parameter=PARAMETER, friction=0.5),
    ):
        torch._dynamo.reset()
        counts = CompileCounter()
        compiled = torch.compile(layer, backend=counts, fullgraph=True)
        for scale in (1.0, 1.1, 0.9):
            np.testing.assert_allclose(compiled(scale * readings), layer(scale * readings), rtol=1e-9, atol=1e-6)
        assert counts.frame_count == 1


def test_modules_move_as_modules_do() -> None:
    of = skin()
    layer = Reconstruct(of, parameter=PARAMETER, constrained=False).float()
    readings = frames(of, 1)
    expected = of.reconstruct(readings, method=pp.Tikhonov(parameter=PARAMETER)).values
    # the module keeps double precision inside
    np.testing.assert_allclose(layer(torch.tensor(readings)), expected, atol=1e-8 * np.abs(expected).max())
    assert not list(layer.parameters())
    assert not layer.state_dict()


def test_what_is_refused() -> None:
    of = skin()
    layer = Reconstruct(of, parameter=PARAMETER)
    with pytest.raises(pp.InvalidInput, match="float32 or float64"):
        layer(frames(of, 1))
    with pytest.raises(pp.InvalidInput, match=r"\(\*batch, 3, 6, 7\)"):
        layer(torch.zeros((3, 7, 6)))
    with pytest.raises(pp.InvalidInput, match="gains must have the shape"):
        layer(torch.zeros((3, 6, 7)), gains=torch.ones(5))
    with pytest.raises(pp.InvalidInput, match="parameter must be one positive number"):
        Reconstruct(of, parameter=0.0)
    with pytest.raises(pp.InvalidInput, match="friction belongs to the constrained problem"):
        Reconstruct(of, parameter=1.0, friction=0.5, constrained=False)
    with pytest.raises(pp.Unsupported, match="give the array noise"):
        Reconstruct(
            pp.Skin(of.pad, pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=["stress_zz"])), parameter=1.0
        )
    at = torch.tensor(frames(of, 1), requires_grad=True)
    (once,) = torch.autograd.grad((layer(at) ** 2).sum(), at, create_graph=True)
    with pytest.raises(pp.Unsupported, match="only first derivatives"):
        once.sum().backward()
    assert torch.isnan(layer(torch.full((3, 6, 7), float("nan")))).all()
