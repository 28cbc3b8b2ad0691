"""Readings from contacts that MJX computed; left out, aloud, where MJX is not installed."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

mujoco = pytest.importorskip("mujoco")
jax = pytest.importorskip("jax")
mjx = pytest.importorskip("mujoco.mjx", reason="MJX is not installed (pip install mujoco-mjx)", exc_type=ImportError)

SCENE = """
<mujoco>
  <option timestep="0.001" cone="pyramidal" tolerance="1e-12" iterations="100"/>
  <worldbody>
    <geom name="pad" type="box" size="0.01 0.01 0.002" pos="0 0 -0.002"/>
    <site name="skin" quat="0 1 0 0"/>
    <body pos="0 0 0.00999"><freejoint/><geom type="sphere" size="0.01" mass="0.1"/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.long
def test_readings_of_mjx_are_those_of_mujoco() -> None:
    from palpate.mujoco import Taxels

    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.qvel[0] = 0.05  # it is dragged too
    mujoco.mj_forward(model, data)
    taxels = Taxels(model, skin, geom="pad", site="skin")
    expected = taxels.read(data)
    assert np.abs(expected[2]).max() > 1e3
    with jax.enable_x64(True):
        there = mjx.put_model(model)
        state = mjx.put_data(model, data)
        one = jax.jit(mjx.forward)(there, state)
        found = taxels.read(one)
        batch = jax.tree.map(lambda x: jax.numpy.stack([x, x]), one)
        both = taxels.read(batch)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
    assert both.shape == (2, *expected.shape)
    assert np.array_equal(both[0], found)
