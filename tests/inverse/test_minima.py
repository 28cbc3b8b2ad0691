"""Many minima over the friction cone at once: those of Newton's method one by one."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.inverse.constrained import implicit
from palpate.inverse.constrained.cone import Cone, minimise
from palpate.inverse.constrained.faces import Face
from palpate.inverse.constrained.factors import Factor
from palpate.inverse.constrained.quadratic import Formed
from palpate.inverse.constrained.variances import face_of

CONES = {
    "pressing": Cone(("x", "y", "z")),
    "friction": Cone(("x", "y", "z"), 0.6),
    "line": Cone(("x", "z"), 1.7),
    "pressure": Cone(("z",)),
}


def problems(cone: Cone, condition: float, count: int = 20, cells: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A Hessian with this condition, and linear terms of many sizes whose minima lie on every kind of face."""
    rng = np.random.default_rng(0)
    n = len(cone.components) * cells
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    hessian = (turn * np.geomspace(1e-7, 1e-7 * condition, n)) @ turn.T
    return hessian, rng.standard_normal((count, n)) * np.geomspace(1e-3, 1e5, count)[:, None]


@pytest.mark.parametrize("name", list(CONES))
def test_together_they_are_what_they_are_one_by_one(name: str) -> None:
    cone = CONES[name]
    hessian, linear = problems(cone, 50.0)
    found, solved = implicit.together(hessian, linear, cone)
    assert solved.all()
    c = len(cone.components)
    for one, h in zip(found, linear):
        newton = minimise(Formed(hessian), h.reshape(c, -1), cone)
        assert newton.converged
        np.testing.assert_allclose(one, newton.traction.ravel(), rtol=0, atol=1e-8 * np.abs(one).max())


def test_what_is_too_ill_conditioned_is_left_to_newtons_method() -> None:
    cone = CONES["friction"]
    hessian, linear = problems(cone, 1e7)
    _, solved = implicit.together(hessian, linear, cone)
    assert not solved.all()
    linear[3, 4] = np.nan
    found = implicit.minima(hessian, linear, cone)
    for i, (one, h) in enumerate(zip(found, linear)):
        if i == 3:
            assert np.isnan(one).all()
            continue
        newton = minimise(Formed(hessian), h.reshape(3, -1), cone)
        np.testing.assert_allclose(
            one, newton.traction.ravel() if newton.converged else np.nan, rtol=0, atol=1e-6 * np.abs(one).max()
        )


def test_no_readings_are_no_traction() -> None:
    hessian, linear = problems(CONES["friction"], 50.0)
    np.testing.assert_array_equal(implicit.minima(hessian, 0.0 * linear, CONES["friction"]), 0.0)


def test_errors_of_a_sliding_contact_are_those_of_a_new_factor() -> None:
    """Newton's method uses a factor again once the free directions hardly turn, and the errors follow from it."""
    cone = CONES["friction"]
    hessian, linear = problems(cone, 50.0)
    made: list[int] = []

    class Counted(Formed):
        def factor(self, face: Face, more: np.ndarray) -> Factor:
            made.append(len(face.index))
            return super().factor(face, more)

        def scaled(self, scales: np.ndarray) -> Formed:
            return Counted(super().scaled(scales).matrix)

    steps = 0
    for h in linear:
        h = h.reshape(3, -1)
        found = minimise(Counted(hessian), h, cone, keep_face=True)
        assert found.converged
        steps += found.steps + 1
        # a start at the solution makes a factor there
        again = minimise(Formed(hessian), h, cone, found.traction, keep_face=True)
        rows = np.repeat(np.eye(3), 12, axis=1)
        mine, fresh = (factor.squares(face.columns(rows)) for face, factor in map(face_of, (found, again)))
        np.testing.assert_allclose(mine, fresh, rtol=0.01)
    assert len(made) < 0.8 * steps
