"""Missing readings in linear methods without matrices: the preconditioner knows them, so that they cost no steps."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.inverse.linear.matrix_free import gaps
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.priors import DifferencePrior

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
CHANNELS = {
    "displacements": ["displacement_x", "displacement_y"],
    "stresses": ["stress_xz", "stress_yz", "stress_zz"],
}


def system(channels: list[str], mask: np.ndarray | None, *, components: tuple[str, ...] = ("x", "y")) -> System:
    shape = (24, 26) if mask is None else mask.shape
    array = pp.AreaArray(
        shape=shape,
        pitch=1.6e-6,
        depth=0.5e-6,
        channels=channels,
        mask=mask,
        noise=1e-2 if "stress" in channels[0] else 2e-9,
    )
    skin = pp.Skin(GEL, array)
    problem = skin.problem(components=components)
    return System(problem.operator, [DifferencePrior(skin.surface, 1)] * len(components), problem.columns)


def holes(shape: tuple[int, int], count: int, seed: int = 0) -> np.ndarray:
    mask = np.ones(shape, dtype=bool)
    mask.ravel()[np.random.default_rng(seed).choice(mask.size, count, replace=False)] = False
    return mask


@pytest.mark.parametrize("kind", list(CHANNELS))
def test_the_preconditioner_over_what_is_there_is_the_schur_complement(kind: str) -> None:
    mask = holes((7, 9), 6)
    masked, whole = system(CHANNELS[kind], mask), system(CHANNELS[kind], np.ones((7, 9), dtype=bool))
    known, n = masked.normal.valid, masked.normal.total
    approximate = [s.space.approximate for s in (masked, whole)]
    parameter = np.array([1e-4, 1e-2]) * approximate[0].eigenvalues.max()
    for place in (0, 1):
        inverse, plain = (a.at(parameter)(np.eye(n), np.full(n, place)) for a in approximate)
        expected = np.linalg.inv(np.linalg.inv(plain)[np.ix_(known, known)])
        np.testing.assert_allclose(inverse[np.ix_(known, known)], expected, rtol=0, atol=1e-10 * np.abs(expected).max())
        assert not inverse[:, ~known].any()


@pytest.mark.parametrize("missing", ["few", *long_runs("a patch")])
@pytest.mark.long
def test_missing_vectors_cost_hardly_a_step(missing: str) -> None:
    mask = holes((24, 26), 12)
    if missing == "a patch":
        mask = np.hypot(*(np.indices((24, 26)) - np.array([8.0, 15.0])[:, None, None])) > 4.0
    steps = {}
    for label, given in (("whole", None), ("gaps", mask)):
        one = system(CHANNELS["displacements"], given)
        rows = np.random.default_rng(1).standard_normal((2, one.normal.total))
        if one.normal.valid is not None:
            rows = rows * one.normal.valid
        found = one.space.solve(rows, np.full(2, 1e-6 * one.space.largest), tolerance=1e-6, most=2000)
        assert (found.residual <= 1e-6).all()
        left = rows - one.normal.apply(found.rows) - 1e-6 * one.space.largest * found.rows
        assert np.linalg.norm(left) < 1e-5 * np.linalg.norm(rows)
        steps[label] = found.products
    assert steps["gaps"] < 1.4 * steps["whole"]


@pytest.mark.long
def test_more_missing_than_a_factor_serves_is_solved_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    mask = holes((24, 26), 30)
    answers = []
    for most in (gaps.MAX_FACTORED_GAPS, 10):
        monkeypatch.setattr(gaps, "MAX_FACTORED_GAPS", most)
        one = system(CHANNELS["displacements"], mask)
        rows = np.random.default_rng(1).standard_normal((1, one.normal.total)) * one.normal.valid
        answers.append(one.space.solve(rows, np.array([1e-4 * one.space.largest]), tolerance=1e-8, most=4000).rows)
    np.testing.assert_allclose(answers[0], answers[1], rtol=0, atol=1e-6 * np.abs(answers[1]).max())
