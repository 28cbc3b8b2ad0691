from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate import solutions
from palpate.elastic import CreepFilter

PRONY = [(0.2, 0.3), (0.15, 5.0)]


def run(step: Any, values: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.array([step(v, t) for v, t in zip(values, time)])


def test_relaxation_after_a_step_is_exact() -> None:
    """A displacement held from t = 0: the elastic reading (the force) relaxes as g(t), on uneven time steps."""
    pad = pp.Viscoelastic(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.4), PRONY)
    time = np.cumsum([0.0, 0.01, 0.3, 0.05, 2.0, 10.0])
    found = run(CreepFilter(pad.prony).remove, np.ones(6), time)
    np.testing.assert_allclose(found, pad.relaxation(time), rtol=1e-13)
    assert pad.relaxation(np.array(1e9)) == pytest.approx(0.65)


def test_relaxation_under_a_ramp_is_exact() -> None:
    """u = t: e = int_0^t g = t g_inf + sum g_i tau_i (1 - exp(-t/tau_i))."""
    time = np.cumsum([0.0, 0.02, 0.5, 0.1, 3.0])
    expected = time * 0.65 + sum(g * tau * (1 - np.exp(-time / tau)) for g, tau in PRONY)
    np.testing.assert_allclose(run(CreepFilter(PRONY).remove, time, time), expected, rtol=1e-13)


def test_creep_under_a_constant_load() -> None:
    """One term (standard linear solid): j(t) = 1 + g/(1-g) (1 - exp(-(1-g) t/tau)); second order in the time step."""
    g, tau, errors = 0.3, 1.0, []
    for n in (200, 400):
        time = np.linspace(0, 5, n + 1)
        found = run(CreepFilter([(g, tau)]).add, np.ones(n + 1), time)
        errors.append(np.abs(found - (1 + g / (1 - g) * (1 - np.exp(-(1 - g) * time / tau)))).max())
    assert errors[0] < 1e-5
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.05)


def test_removing_undoes_adding(rng: np.random.Generator) -> None:
    values, time = rng.standard_normal((50, 3, 4)), np.cumsum(rng.uniform(0.01, 1, 50))
    there = run(CreepFilter(PRONY).add, values, time)
    np.testing.assert_allclose(run(CreepFilter(PRONY).remove, there, time), values, atol=1e-12)


@pytest.mark.parametrize("layered", [False, *long_runs(True)])
@pytest.mark.long
def test_net_force_through_creep(layered: bool) -> None:
    """A press held: displacement creeps, the force recovered does not; stress channels are left alone."""
    elastic: Any = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)
    if layered:
        elastic = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=1e5, poissons_ratio=0.45)])
    pad = pp.Viscoelastic(elastic, PRONY)
    channels = ["displacement_x", "displacement_z", "stress_zz"]
    array = pp.LineArray(
        count=40, pitch=1e-3, depth=0.0 if not layered else 1e-3, channels=channels, noise=[1e-8, 1e-8, 1.0]
    )
    skin, plain = pp.Skin(pad, array), pp.Skin(elastic, array)
    contact = solutions.hertz_line(half_width=5e-3, force=50.0).sliding(0.2)
    time = np.array([0.0, 0.1, 0.5, 2.0, 30.0])
    traction = np.broadcast_to(skin.sample(contact), (5, 2, skin.surface.shape[0]))
    readings = skin.sense(traction, time=time)
    np.testing.assert_allclose(readings[:, 2], readings[0, 2] + np.zeros((5, 1)), atol=1e-9)
    assert np.abs(readings[-1, 1]).max() > 1.3 * np.abs(readings[0, 1]).max()
    touch = skin.reconstruct(readings, time=time)
    np.testing.assert_allclose(touch.force, np.broadcast_to(touch.force[0], (5, 2)), rtol=1e-8)
    np.testing.assert_allclose(touch.time, time)
    np.testing.assert_allclose(touch.values[0], plain.reconstruct(readings[0]).values, rtol=1e-9, atol=1e-6)


def test_refusals() -> None:
    half = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)
    pad = pp.Viscoelastic(half, PRONY)
    array = pp.LineArray(count=10, pitch=1e-3, depth=1e-3, channels=["strain_zz"])
    skin = pp.Skin(pad, array)
    with pytest.raises(pp.InvalidInput, match="creeps"):
        skin.reconstruct(np.zeros((3, 1, 10)))
    with pytest.raises(pp.InvalidInput, match="increase"):
        skin.reconstruct(np.zeros((3, 1, 10)), time=[0.0, 1.0, 1.0])
    with pytest.raises(pp.InvalidInput, match="one entry"):
        skin.reconstruct(np.zeros((1, 10)), time=[0.0])
    with pytest.raises(pp.Unsupported, match="creeps"):
        pp.Skin(half, array).sense(np.zeros((1, 2, 14)), time=[0.0])
    with pytest.raises(pp.Unsupported, match="creeps differently"):
        pp.Viscoelastic(pp.BondedLayers([pp.Layer(thickness=1.0, youngs_modulus=1.0, poissons_ratio=0.3)], half), PRONY)
    with pytest.raises(pp.InvalidInput, match="elastic must be"):
        pp.Viscoelastic(pp.HalfSpace, PRONY)  # type: ignore[arg-type]
    for bad in ([], [(0.5, 1.0), (0.5, 2.0)], [(-0.1, 1.0)], [(0.1, 0.0)], [0.1, 0.2], "gel"):
        with pytest.raises(pp.InvalidInput, match=r"prony|Prony"):
            pp.Viscoelastic(half, bad)  # type: ignore[arg-type]
    with pytest.raises(pp.InvalidInput, match="increase"):
        run(CreepFilter(PRONY).remove, np.ones(2), np.zeros(2))
