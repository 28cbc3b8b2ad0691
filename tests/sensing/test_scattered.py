"""Many scattered positions: the map by a lattice, interpolation and exact near cells, and the inversion on it."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.linear.matrix_free import freedom, path
from palpate.inverse.linear.matrix_free.spaces import OnSurface
from palpate.sensing import operator as operators
from palpate.sensing.scattered import Lattice

HALF_SPACE = pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=0.48)


def beads(n: int, dimensions: int = 2, **options):
    positions = np.random.default_rng(0).uniform(0.0, np.sqrt(n) * 1e-6, (n, 2))
    if dimensions == 1:
        positions = np.sort(np.random.default_rng(0).uniform(0.0, n * 1e-6, n))
    options = {"depth": 0.0, "channels": ["displacement_x", "displacement_y"], **options}
    return pp.ScatteredArray(positions=positions, **options)


@pytest.mark.parametrize(
    ("array", "near"),
    [
        (beads(150), 2e-5),
        (beads(150, depth=2e-6, channels=["displacement_x", "displacement_z"]), 2e-5),
        (beads(100, depth=1e-6, channels=["stress_xz", "stress_zz"], aperture=0.5e-6), 1e-4),
        (beads(80, 1, depth=1e-6, channels=["stress_xz", "stress_zz"]), 2e-4),
    ],
    ids=["displacements", "below the surface", "apertures", "a line"],
)
def test_the_lattice_reads_like_the_matrix(array, near):
    skin = pp.Skin(HALF_SPACE, array)
    exact = skin.operator.planes[0]
    lattice = Lattice(HALF_SPACE, array, skin.surface, operators.Convolution)
    rng = np.random.default_rng(0)
    traction = rng.standard_normal((2, len(skin.surface.components), *skin.surface.shape))
    expected = exact.forward(traction)
    found = lattice.forward(traction)
    np.testing.assert_allclose(found, expected, atol=near * np.abs(expected).max())
    readings = rng.standard_normal(expected.shape)
    assert np.vdot(found, readings) == pytest.approx(np.vdot(traction, lattice.adjoint(readings)), rel=1e-10)
    some = lattice.forward(traction[:, [0]], [0])
    traction[:, 1:] = 0.0
    np.testing.assert_allclose(some, lattice.forward(traction), atol=1e-12 * np.abs(some).max())
    np.testing.assert_allclose(lattice.adjoint(readings, [1]), lattice.adjoint(readings)[:, [1]])
    single = lattice.forward(traction.astype(np.float32))
    assert single.dtype == np.float32
    cells = np.array([0, 7])
    np.testing.assert_allclose(
        lattice.columns(0, cells), exact.columns(0, cells), atol=20 * near * np.abs(exact.columns(0, cells)).max()
    )


def test_solutions_over_beads_are_as_exact_as_evidence_needs(monkeypatch):
    # nothing corrects their forms: residuals of 3e-3, which serve regular arrays, moved the parameter of 2601 beads by 21 %
    monkeypatch.setattr(operators, "LARGEST_MATRIX", 0)
    monkeypatch.setattr(path, "LARGEST_MATRIX", 0)
    skin = pp.Skin(HALF_SPACE, beads(60), nuisance=[])
    asked = []
    solve = OnSurface.solve

    def spied(self, rows, parameter, **options):
        if options["tolerance"] != freedom.TOLERANCE:  # a trace is known to less
            asked.append(float(np.max(options["tolerance"])))
        return solve(self, rows, parameter, **options)

    monkeypatch.setattr(OnSurface, "solve", spied)
    readings = np.random.default_rng(1).standard_normal((2, 60)) * 1e-8
    skin.reconstruct(readings, method="tikhonov")
    assert asked
    assert max(asked) <= 1e-4


@pytest.mark.long
def test_beads_are_solved_alike(monkeypatch):
    array = beads(180)
    found = []
    for most in (10**9, 0):
        monkeypatch.setattr(operators, "LARGEST_MATRIX", most)
        monkeypatch.setattr(path, "LARGEST_MATRIX", most)
        skin = pp.Skin(HALF_SPACE, array, nuisance=[])
        if not found:
            places = np.meshgrid(*skin.surface.axes, indexing="ij")
            bump = np.exp(-sum((p - 8e-6) ** 2 for p in places) / (4e-6) ** 2)
            readings = skin.sense(np.stack([300.0 * bump, -200.0 * bump, 0.0 * bump]))
            readings = readings + 0.02 * np.abs(readings).max() * np.random.default_rng(1).standard_normal(
                readings.shape
            )
        found.append([skin.reconstruct(readings, method="tikhonov", **o) for o in ({"parameter": 4e-21}, {})])
    (dense, chosen), (free, by_rule) = found
    assert np.abs(np.asarray(free.traction - dense.traction)).max() < 1e-4 * float(np.abs(dense.traction).max())
    np.testing.assert_allclose(free._errors.posterior.force[:2], dense._errors.posterior.force[:2], rtol=0.05)
    np.testing.assert_allclose(np.log(by_rule.parameter), np.log(chosen.parameter), atol=0.06)
    np.testing.assert_allclose(by_rule.noise_std, chosen.noise_std, rtol=0.02)


@pytest.mark.long
def test_cross_validation_over_beads_does_not_run_off(monkeypatch):
    # a surface has more waves than there are beads: the approximation promised a score of nothing where lambda is 1e-8 of the right one
    found = []
    for most in (10**9, 0):
        monkeypatch.setattr(operators, "LARGEST_MATRIX", most)
        monkeypatch.setattr(path, "LARGEST_MATRIX", most)
        skin = pp.Skin(HALF_SPACE, beads(100), nuisance=[])
        if not found:
            places = np.meshgrid(*skin.surface.axes, indexing="ij")
            bump = np.exp(-sum((p - 6e-6) ** 2 for p in places) / (3e-6) ** 2)
            readings = skin.sense(np.stack([300.0 * bump, -200.0 * bump, 0.0 * bump]))
            noise = 0.05 * np.abs(readings).max()
            readings = readings + noise * np.random.default_rng(1).standard_normal((2, *readings.shape))
        found.append(skin.reconstruct(readings, method="tikhonov", rule="gcv"))
    dense, free = found
    assert (np.asarray(free.status) == pp.Status.SOLVED).all()
    np.testing.assert_allclose(np.log(free.parameter), np.log(dense.parameter), atol=0.12)
    np.testing.assert_allclose(free.noise_std, dense.noise_std, rtol=0.02)


@pytest.mark.long
def test_standard_deviations_of_cells_over_beads(monkeypatch):
    found = []
    for most in (10**9, 0):
        monkeypatch.setattr(operators, "LARGEST_MATRIX", most)
        monkeypatch.setattr(path, "LARGEST_MATRIX", most)
        skin = pp.Skin(HALF_SPACE, beads(250, noise=1e-9), nuisance=[])
        if not found:
            places = np.meshgrid(*skin.surface.axes, indexing="ij")
            bump = np.exp(-sum((p - 8e-6) ** 2 for p in places) / (4e-6) ** 2)
            readings = skin.sense(np.stack([300.0 * bump, -200.0 * bump, 0.0 * bump]), rng=np.random.default_rng(1))
        found.append(skin.reconstruct(readings, method="tikhonov")._errors.posterior.traction[:2])
    ratio = found[1] / found[0]
    assert abs(float(ratio.mean()) - 1.0) < 0.06
    assert float(ratio.std()) < 0.2


def test_thousands_of_beads_are_served_and_correlated_noise_is_refused():
    many = pp.Skin(HALF_SPACE, beads(2601))
    priors = [pp.inverse.DifferencePrior(many.surface, 1)] * 2
    assert path.matrix_free(many.problem(), pp.inverse.linear.parameter.tikhonov, priors)
    correlated = pp.Skin(HALF_SPACE, beads(2601, noise=1e-9, noise_correlation=1e-6))
    with pytest.raises(pp.Unsupported, match="Grid the recording"):
        pp.Tikhonov().prepare(correlated.problem())
