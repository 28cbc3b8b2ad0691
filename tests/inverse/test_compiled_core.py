"""The compiled core gives the numbers of the Python code beside it, for every kind of cone and matrix."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import palpate as pp
from palpate._threads import beside
from palpate.inverse.constrained import compiled
from palpate.inverse.constrained.cone import PATIENCE, Cone, Solution, minimise
from palpate.inverse.constrained.differences import Differences
from palpate.inverse.constrained.faces import FREE
from palpate.inverse.constrained.factors import Dense, FewReadings
from palpate.inverse.constrained.quadratic import Formed, Penalty, Quadratic, Unformed
from palpate.inverse.constrained.rows import Rows

Floats = npt.NDArray[np.float64]

CONES = {
    "tension": Cone(("x", "y", "z"), tension=True),
    "pressure": Cone(("z",)),
    "pressure and free shear": Cone(("x", "y", "z")),
    "shear alone": Cone(("x", "y")),
    "friction": Cone(("x", "y", "z"), 0.4),
    "friction with one shear": Cone(("x", "z"), 0.7),
}


@pytest.fixture(params=compiled.LIBRARIES)
def library(request: pytest.FixtureRequest) -> str:
    """Each library that was built and that this processor can run."""
    plain = compiled.load(compiled.LIBRARIES[0])
    if plain is None:
        pytest.skip("palpate was installed without its compiled core")
    if request.param != compiled.LIBRARIES[0] and not plain.library.second_library_runs():
        pytest.skip("the processor lacks AVX2")
    assert compiled.load(request.param) is not None
    return str(request.param)


@contextmanager
def using(name: str | None) -> Iterator[None]:
    """Solve with a library, or with Python."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "core", lambda: None if name is None else compiled.load(name))
        yield


def problem(
    c: int, *, kind: str = "in proportion", seed: int = 0, readings: int = 22, shape: tuple[int, int] = (13, 8)
) -> tuple[Unformed, Floats, Differences, npt.NDArray[np.intp]]:
    """A problem of few readings on some cells of a grid; ``kind`` tells how the penalties of the components differ."""
    rng = np.random.default_rng(seed)
    differences = Differences(pp.AreaGrid(shape=shape, spacing=0.5))
    cells = np.flatnonzero(rng.random(shape).ravel() < 0.85)
    tau = np.exp(2.0 * rng.standard_normal((c, *shape)))
    if kind == "second differences":
        each = differences.even(2, [0.1 * (i + 1) for i in range(c)])
    else:
        each = differences.local(np.stack([(i + 1.0) * tau[0] for i in range(c)]) if kind == "in proportion" else tau)
    columns = 30.0 * rng.standard_normal((c * len(cells), readings)) / np.sqrt(readings)
    linear = (columns @ rng.standard_normal(readings)).reshape(c, -1) + 1.0
    return Unformed(columns, Penalty(cells, each, shape)), linear, differences, cells


def both(name: str, hessian: Callable[[], Quadratic], linear: Floats, cone: Cone, **options: Any) -> list[Solution]:
    """The solution of a library and that of Python, of a matrix that caches nothing."""
    found = []
    for each in (name, None):
        with using(each):
            found.append(minimise(hessian(), linear, cone, **options))
    return found


def assert_same(found: Any, expected: Any) -> None:
    expected = np.asarray(expected)
    assert np.shape(found) == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max(initial=1e-300))


def assert_same_factors(found: Solution, expected: Solution, rows: Rows) -> None:
    """Faces, and all that a factor is asked for."""
    assert found.face is not None
    assert expected.face is not None
    np.testing.assert_array_equal(found.face.index, expected.face.index)
    assert_same(found.face.basis, expected.face.basis)
    assert_same(found.face.kept, expected.face.kept)
    a, b = found.factor, expected.factor
    few = isinstance(b, FewReadings)
    assert isinstance(a, FewReadings if few else Dense)
    assert isinstance(b, FewReadings if few else Dense)
    right = np.random.default_rng(1).standard_normal((len(expected.face.index), 5))
    assert_same(a.solve(right[:, 0]), b.solve(right[:, 0]))
    assert_same(a.inverse(right), b.inverse(right))
    assert_same(a.squares(right.T), b.squares(right.T))
    half = [f.half(right) for f in (a, b)]
    assert_same(half[0].T @ half[0], half[1].T @ half[1])
    assert_same(a.variances(found.face.rows(rows)), b.variances(expected.face.rows(rows)))
    if isinstance(a, FewReadings) and isinstance(b, FewReadings):
        assert_same(a.taken(), b.taken())
        assert_same(a.log_evidence(right[:, 0]), b.log_evidence(right[:, 0]))
        assert_same(a.back(right), b.back(right))
    elif isinstance(a, Dense) and isinstance(b, Dense):
        assert_same(a.trace(np.eye(len(right))), b.trace(np.eye(len(right))))


@pytest.mark.parametrize("formed", [False, True])
@pytest.mark.parametrize("kind", ["in proportion", "each its own", "second differences"])
@pytest.mark.parametrize("cone", CONES.values(), ids=list(CONES))
def test_minima_and_factors_are_those_of_python(library: str, cone: Cone, kind: str, formed: bool) -> None:
    c = len(cone.components)
    hessian, linear, differences, cells = problem(c, kind=kind)
    matrix = hessian.dense()

    def made() -> Quadratic:
        return Formed(matrix) if formed else Unformed(hessian.columns, hessian.penalty.scaled(np.ones(c)))

    found, expected = both(library, made, linear, cone, keep_face=True)
    assert found.converged
    assert expected.converged
    assert not expected.hard
    assert found.steps == expected.steps
    assert_same(found.traction, expected.traction)
    assert_same_factors(found, expected, differences.touching(cells)[1].each(c, len(cells)))
    # rows of cells that are far from each other, and a row of nothing
    far = Rows(np.array([0, 0, 2]), np.array([0, len(cells) - 1, c * len(cells) - 1]), np.array([1.0, -0.5, 2.0]), 3)
    assert found.face is not None
    assert found.factor is not None
    assert expected.factor is not None
    assert_same(found.factor.variances(found.face.rows(far)), expected.factor.variances(found.face.rows(far)))
    if cone.coupled:
        assert found.face.oblique.any(), "some cells should slide"


def test_a_good_start_changes_nothing(library: str) -> None:
    cone = CONES["friction"]
    hessian, linear, *_ = problem(3)
    found, expected = both(library, lambda: hessian, linear, cone)
    start = expected.traction * np.random.default_rng(2).uniform(0.9, 1.1, expected.traction.shape)
    for solution in both(library, lambda: hessian, linear, cone, start=start):
        assert_same(solution.traction, expected.traction)
    assert found.face is None
    assert found.factor is None


@pytest.mark.parametrize("cone", [CONES["pressure"], CONES["friction"], CONES["pressure and free shear"]])
@pytest.mark.parametrize("formed", [False, True])
def test_nothing_may_press(library: str, cone: Cone, formed: bool) -> None:
    c = len(cone.components)
    hessian, linear, differences, cells = problem(c)
    linear = np.zeros_like(linear)
    linear[-1] = -1.0
    matrix = hessian.dense()
    found, expected = both(library, lambda: Formed(matrix) if formed else hessian, linear, cone, keep_face=True)
    assert_same(found.traction, expected.traction)
    if c > 1 and not cone.coupled:
        assert_same_factors(found, expected, differences.touching(cells)[1].each(c, len(cells)))
    else:
        assert found.face is not None
        assert not len(found.face.index)


def test_one_cell_and_one_reading(library: str) -> None:
    differences, cells = Differences(pp.AreaGrid(shape=(2, 2), spacing=0.5)), np.array([2])
    hessian = Unformed(np.array([[0.5], [2.0], [3.0]]), Penalty(cells, differences.even(1, [1.0, 1.0, 2.0]), (2, 2)))
    linear = np.array([[0.1], [0.7], [0.5]])
    for cone in (CONES["friction"], CONES["pressure and free shear"]):
        found, expected = both(library, lambda: hessian, linear, cone, keep_face=True)
        assert_same(found.traction, expected.traction)
        assert_same_factors(found, expected, differences.touching(cells)[1].each(3, 1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_bad_numbers_are_left_to_python(library: str, bad: float) -> None:
    hessian, linear, *_ = problem(3)
    linear[2, 3] = bad
    limits = compiled.Limits(1e-9, 0.999, 3e-3, 0.1, FREE, 60, 5)
    with using(library), np.errstate(all="ignore"):
        options: dict[str, Any] = {"free": False, "coupled": True, "limits": limits, "keep_face": True}
        found = compiled.newton(hessian, linear, np.zeros_like(linear), **options)
    assert found is None or (bad == 1e300 and np.isfinite(found.x).all())


def test_a_matrix_that_is_not_positive_definite_is_left_to_python(library: str) -> None:
    limits = compiled.Limits(1e-9, 0.999, 3e-3, 0.1, FREE, 60, 5)
    options: dict[str, Any] = {"free": True, "coupled": False, "limits": limits, "keep_face": True}
    with using(library):
        matrix = Formed(np.array([[1.0, 2.0], [2.0, 1.0]]))
        assert compiled.newton(matrix, np.ones((1, 2)), np.zeros((1, 2)), **options) is None
        assert compiled.newton(matrix, np.ones((1, 0)), np.zeros((1, 0)), **options) is None


def test_python_continues_where_the_method_cycles(library: str) -> None:
    hessian, linear, *_ = problem(3)
    options: dict[str, Any] = {"free": False, "coupled": True, "keep_face": False}
    limits = compiled.Limits(1e-30, 0.999, 3e-3, 0.1, FREE, 60, PATIENCE)
    with using(library):
        assert compiled.newton(hessian, linear, np.zeros_like(linear), limits=limits, **options) is None
        assert minimise(hessian, linear, CONES["friction"], tolerance=1e-30).hard


def test_it_gives_way_before_every_step(library: str) -> None:
    hessian, linear, *_ = problem(3)
    calls: list[None] = []
    beside(lambda: calls.append(None))
    try:
        with using(library):
            found = minimise(hessian, linear, CONES["friction"])
    finally:
        beside(lambda: None)
    assert len(calls) == found.steps + 1


def test_threads_do_not_disturb_each_other(library: str) -> None:
    problems = [problem(3, seed=seed) for seed in range(4)]
    expected = [both(library, lambda p=p: p[0], p[1], CONES["friction"])[1].traction for p in problems]  # type: ignore[misc]
    found: list[list[Floats]] = [[] for _ in problems]

    def run(k: int) -> None:
        for _ in range(5):
            hessian, linear, *_ = problems[k]
            found[k].append(minimise(hessian, linear, CONES["friction"]).traction)

    with using(library):
        threads = [threading.Thread(target=run, args=(k,)) for k in range(len(problems))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    for k, each in enumerate(found):
        assert len(each) == 5
        for traction in each:
            assert_same(traction, expected[k])


def test_the_environment_can_switch_it_off(monkeypatch: pytest.MonkeyPatch) -> None:
    hessian, linear, *_ = problem(3)
    monkeypatch.setenv("PALPATE_PURE", "1")
    assert compiled.core() is None
    assert type(minimise(hessian, linear, CONES["friction"], keep_face=True).factor) is FewReadings
    monkeypatch.delenv("PALPATE_PURE")
    if compiled.core() is not None:
        assert type(minimise(hessian, linear, CONES["friction"], keep_face=True).factor) is compiled.BandedReadings


def test_a_missing_library_is_no_error() -> None:
    assert compiled.load("absent.compiled") is None


@pytest.mark.long
@pytest.mark.parametrize("friction", [None, 0.5])
def test_frames_have_the_same_forces(library: str, friction: float | None) -> None:
    array = pp.AreaArray(shape=(4, 4), pitch=4.7e-3, depth=3e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    clean = skin.sense(pp.solutions.hertz_point(contact_radius=6e-3, force=1.0).sliding(0.3))
    readings = clean + 0.01 * np.abs(clean).max() * np.random.default_rng(0).standard_normal(clean.shape)
    touches = []
    for name in (library, None):
        with using(name):
            touches.append(skin.reconstruct(readings, friction=friction))
    assert_same(touches[0].force, touches[1].force)
    for of in ("traction", "force"):  # errors of nothing differ by the root of what rounding leaves of a variance
        found, expected = (np.asarray(touch.interval(0.95, of)) for touch in touches)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())
    assert_same(touches[0].traction, touches[1].traction)
