"""Contact under friction that deep taxels see: Newton's method on the constraints cycles there, and the interior-point method does not."""

from __future__ import annotations

from typing import Any
from unittest import mock

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.constrained import cone as cones
from palpate.inverse.constrained.cone import Cone, minimise
from palpate.inverse.constrained.interior import GAP, interior
from palpate.inverse.constrained.quadratic import Formed


def ill_posed(components: int, cells: int, readings: int, condition: float) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of a smoothing operator with a weak penalty, of readings that no traction in a cone explains."""
    n, rng = components * cells, np.random.default_rng([components, cells, readings])
    left, _ = np.linalg.qr(rng.standard_normal((readings, readings)))
    right, _ = np.linalg.qr(rng.standard_normal((n, readings)))
    matrix = (left * np.geomspace(1.0, condition**-0.5, readings)) @ right.T
    hessian = matrix.T @ matrix + np.eye(n) / condition
    return hessian, (matrix.T @ rng.standard_normal(readings)).reshape(components, cells)


def conditions(hessian: np.ndarray, linear: np.ndarray, cone: Cone, x: np.ndarray) -> tuple[float, float, float]:
    """How far traction and gradient leave their cones, and what is left of their product: of a minimum all are zero."""
    scale = cone.scales[:, None]
    u = x / scale
    s = ((hessian @ x.ravel()).reshape(x.shape) - linear) * scale
    size, slope = np.abs(u).max(), np.abs(linear * scale).max()
    polar = cone.project(s) if cone.coupled else np.concatenate([0.0 * s[:-1], np.maximum(s[-1:], 0.0)])
    left = np.abs((u * s).sum()) / max(abs(float((u * linear * scale).sum())), 1e-300)
    return float(np.abs(u - cone.project(u)).max() / size), float(np.abs(s - polar).max() / slope), float(left)


@pytest.mark.parametrize("names", [("z",), ("x", "z"), ("x", "y", "z")])
@pytest.mark.parametrize("friction", [None, 0.3, 1.5])
@pytest.mark.parametrize("condition", [1e3, 1e8])
def test_the_first_order_conditions_hold(names: tuple[str, ...], friction: float | None, condition: float) -> None:
    """Traction in its cone, gradient in the dual one, their products zero (S. Boyd, L. Vandenberghe, Convex Optimization, section 5.9)."""
    cone = Cone(names, friction)
    hessian, linear = ill_posed(len(names), 120, 60, condition)
    scale = cone.scales[:, None]
    x, there = interior(Formed(hessian).scaled(cone.scales), linear * scale, cone, np.zeros_like(linear))
    assert there
    outside, against, left = conditions(hessian, linear, cone, x * scale)
    assert outside < 1e-12
    assert against < 1e-7
    assert left < 1e-7


@pytest.mark.parametrize("names", [("z",), ("x", "z"), ("x", "y", "z")])
def test_the_end_is_where_newtons_method_ends(names: tuple[str, ...]) -> None:
    cone = Cone(names, 0.5)
    hessian, linear = ill_posed(len(names), 40, 40, 1e3)
    exact = minimise(hessian, linear, cone)
    assert exact.converged
    scale = cone.scales[:, None]
    x, there = interior(Formed(hessian).scaled(cone.scales), linear * scale, cone, np.zeros_like(linear))
    assert there
    # a part g of the objective that is left is an error of sqrt(2 g f / the smallest eigenvalue of H), at most
    rest = x * scale - exact.traction
    worth = abs(
        0.5 * float(exact.traction.ravel() @ hessian @ exact.traction.ravel()) - float((exact.traction * linear).sum())
    )
    assert np.linalg.norm(rest) < np.sqrt(2.0 * GAP * worth / np.linalg.eigvalsh(hessian)[0])
    assert np.linalg.norm(rest) < 1e-3 * np.linalg.norm(exact.traction)


def swapped(side: int = 8, *, depth: float = 2.1e-3, radius: float = 3e-3) -> tuple[pp.Skin, np.ndarray]:
    """A ball's displacements with x and y swapped, the noise known: shear that no friction of 0.3 explains."""
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    how = {"shape": (side, side), "pitch": 1.4e-3, "depth": depth}
    channels = ["displacement_x", "displacement_y", "displacement_z"]
    ball = pp.solutions.hertz_point(contact_radius=radius, force=2.0)
    clean = np.asarray(pp.Skin(pad, pp.AreaArray(**how, channels=channels)).sense(ball))
    noise = 0.002 * float(np.abs(clean).max())
    skin = pp.Skin(pad, pp.AreaArray(**how, channels=channels, noise=noise))
    return skin, clean[[1, 0, 2]] + noise * np.random.default_rng(3).standard_normal(clean.shape)


@pytest.mark.long
def test_every_fit_of_a_frame_ends_although_newtons_method_cycles() -> None:
    """Such fits stopped short: of what a hypothesis was worth, twice the force and more was made of."""
    skin, frame = swapped()
    found: list[cones.Solution] = []
    asked: list[bool] = []

    def watched(*args: Any, **how: Any) -> cones.Solution:
        found.append(minimise(*args, **how))
        return found[-1]

    def counted(*args: Any, **how: Any) -> tuple[np.ndarray, bool]:
        x, there = interior(*args, **how)
        asked.append(there)
        return x, there

    with (
        mock.patch("palpate.inverse.contact.prepared.minimise", watched),
        mock.patch.object(cones, "interior", counted),
    ):
        skin.reconstruct(frame, friction=0.3)
    assert len(asked) > 3
    assert all(asked)
    assert all(s.converged for s in found)


@pytest.mark.long
@pytest.mark.parametrize("side", [20, 24])
def test_swapped_axes_of_many_taxels_end_in_an_answer(side: int) -> None:
    """Of 20 taxels squared they ended in an exception of linear algebra; of 24, a ball of 2 N was read as 63 kN."""
    skin, frame = swapped(side, depth=2.8e-3, radius=side * 1.4e-3 / 5)
    touch = skin.reconstruct(frame, friction=0.3)
    assert float(touch.force[-1]) == pytest.approx(2.0, abs=1.0)
    assert float(touch.fit) < 0.01
