"""Contacts that MuJoCo tells, as readings: the wrench is the simulator's, in presses, drags, rolls and on every kind of geom."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp

mujoco = pytest.importorskip("mujoco")

from palpate.mujoco import Taxels  # noqa: E402

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
SCENE = """
<mujoco>
  <option timestep="0.001" cone="elliptic" impratio="10"/>
  <default><geom friction="0.6 0.02 0.005" condim="{condim}"/></default>
  <worldbody>
    <geom name="pad" type="box" size="0.015 0.015 0.004" pos="0.01 0.02 0.03" quat="{turn}"/>
    <site name="skin" pos="{place}" quat="{site}"/>
    <body name="tool" pos="{above}" quat="{turn}">
      <freejoint/>
      <geom name="tool" {geom} mass="0.05"/>
    </body>
  </worldbody>
</mujoco>"""
#: Kinds of tools, their geoms and how far their middle lies from the surface.
TOOLS = {
    "ball": ('type="sphere" size="0.008"', 0.008),
    "egg": ('type="ellipsoid" size="0.01 0.006 0.008"', 0.008),
    "rod": ('type="capsule" size="0.003 0.006" quat="0.7071 0 0.7071 0"', 0.003),
    "rod on end": ('type="capsule" size="0.004 0.006"', 0.010),
    "roller": ('type="cylinder" size="0.004 0.006" quat="0.7071 0.7071 0 0"', 0.004),
    "stamp": ('type="cylinder" size="0.004 0.006"', 0.006),
    "brick": ('type="box" size="0.005 0.004 0.004"', 0.004),
}


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    array = pp.AreaArray(
        shape=(16, 16), pitch=1.5e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=50.0
    )
    return pp.Skin(PAD, array)


def scene(tool: str, *, condim: int = 3, tilt: float = 0.0) -> tuple[Any, Any]:
    """A pad, leaning by ``tilt`` [rad], and a tool on it; the site's z goes into the pad."""
    geom, height = TOOLS[tool]
    turn = np.array([np.cos(tilt / 2), 0.0, np.sin(tilt / 2), 0.0])
    over = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about x: z into the pad
    site, rotation = np.zeros(4), np.zeros(9)
    mujoco.mju_mulQuat(site, turn, over)
    mujoco.mju_quat2Mat(rotation, turn)
    up = rotation.reshape(3, 3)[:, 2]
    middle = np.array([0.01, 0.02, 0.03])

    def words(v: np.ndarray) -> str:
        return " ".join(map(str, v))

    xml = SCENE.format(
        condim=condim,
        turn=words(turn),
        site=words(site),
        place=words(middle + 0.004 * up),
        above=words(middle + (0.004 + height + 1e-5) * up),
        geom=geom,
    )
    model = mujoco.MjModel.from_xml_string(xml)
    return model, mujoco.MjData(model)


def pushed(model: Any, data: Any, force: Any, steps: int, torque: Any = (0.0, 0.0, 0.0)) -> None:
    data.xfrc_applied[1, :3], data.xfrc_applied[1, 3:] = force, torque
    for _ in range(steps):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)


def simulators_own(model: Any, data: Any) -> np.ndarray:
    """Net force and moment on the pad, in the axes of the site, summed contact by contact from MuJoCo's own numbers."""
    total, turn = np.zeros(6), data.site_xmat[0].reshape(3, 3)
    for i in range(data.ncon):
        contact, found = data.contact[i], np.zeros(6)
        mujoco.mj_contactForce(model, data, i, found)
        frame = np.asarray(contact.frame).reshape(3, 3)
        sign = 1.0 if contact.geom[1] == 0 else -1.0
        force, torque = sign * frame.T @ found[:3], sign * frame.T @ found[3:]
        total[:3] += turn.T @ force
        total[3:] += turn.T @ (torque + np.cross(contact.pos - data.site_xpos[0], force))
    return total


@pytest.mark.parametrize("tool", list(TOOLS))
def test_force_and_moment_are_the_simulators(tool: str, skin: pp.Skin) -> None:
    """Pressed, dragged and rolled: the traction has the contacts' wrench."""
    model, data = scene(tool, condim=6)
    taxels = Taxels(model, skin, geom="pad", site="skin")
    for force, torque in (
        ((0.0, 0.0, -1.0), (0.0, 0.0, 0.0)),
        ((0.25, -0.1, -1.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.1, -1.5), (0.0, 0.0, 1e-3)),
        ((0.1, 0.0, -1.0), (1e-3, 5e-4, 0.0)),
    ):
        pushed(model, data, force, 60, torque)
        pressed = taxels.press(data)
        own = simulators_own(model, data)
        assert own[2] > 0.5
        assert pressed.missed.tolist() == [0]
        np.testing.assert_allclose(pressed.wrench[0], own, atol=1e-12)
        np.testing.assert_allclose(pressed.felt[0, :3], own[:3], atol=1e-9 * own[2])
        np.testing.assert_allclose(pressed.felt[0, 3:], own[3:], atol=1e-9 * own[2] * 0.01)
        # what the taxels read tells the same load, over the area that they cover
        if tool == "ball":
            readings = taxels.read(data)
            assert abs(readings[2].sum() * 1.5e-3**2 / own[2] - 1.0) < 0.05


def test_a_pad_that_leans_feels_weight_as_shear(skin: pp.Skin) -> None:
    model, data = scene("brick", tilt=0.3)
    taxels = Taxels(model, skin, geom="pad", site="skin")
    pushed(model, data, (0.0, 0.0, 0.0), 400)
    felt = taxels.press(data).felt[0]
    weight = 0.05 * 9.81
    assert abs(felt[2] / (weight * np.cos(0.3)) - 1.0) < 0.01
    assert abs(felt[0] / (weight * np.sin(0.3)) - 1.0) < 0.01
    assert abs(felt[1]) < 1e-3


def test_a_ball_reads_what_hertz_says(skin: pp.Skin) -> None:
    """Against the closed form of palpate.solutions, at the place and with the load that MuJoCo tells."""
    model, data = scene("ball")
    taxels = Taxels(model, skin, geom="pad", site="skin")
    pushed(model, data, (0.3, 0.0, -1.0), 30)
    pressed = taxels.press(data)
    force = pressed.wrench[0]
    radius = pp.solutions.hertz_contact_radius(PAD, radius=8e-3, force=force[2])
    ball = pp.solutions.hertz_point(contact_radius=radius, force=force[2])
    shear = float(np.hypot(force[0], force[1]))
    ball = ball.partial_slip(0.6, shear, direction=float(np.arctan2(force[1], force[0])))
    expected = skin.sense(ball.shifted(-force[4] / force[2], force[3] / force[2]))
    assert np.abs(taxels.read(data) - expected).max() < 5e-3 * np.abs(expected).max()


def test_nothing_touches(skin: pp.Skin) -> None:
    model, data = scene("ball")
    mujoco.mj_forward(model, data)
    pressed = Taxels(model, skin, geom="pad", site="skin").press(data)
    assert not pressed.felt.any()
    assert not np.any(pressed.readings())
    assert pressed.missed.tolist() == [0]


def test_worlds_are_independent_and_keep_their_order(skin: pp.Skin) -> None:
    model, _ = scene("ball")
    worlds = []
    for load in (0.3, 0.0, 2.0):
        data = mujoco.MjData(model)
        if load:
            pushed(model, data, (0.0, 0.0, -load), 100)
        worlds.append(data)
    taxels = Taxels(model, skin, geom="pad", site="skin")
    together = taxels.read(worlds)
    assert together.shape == (3, 3, 16, 16)
    for one, data in zip(together, worlds):
        np.testing.assert_allclose(one, taxels.read(data), atol=1e-9 * np.abs(together).max())
    assert not together[1].any()
    noisy = taxels.read(worlds, rng=np.random.default_rng(0)) - together
    assert 45.0 < noisy.std() < 55.0


def test_what_presses_from_the_side_is_counted(skin: pp.Skin) -> None:
    model, data = scene("ball")
    data.qpos[:3] = [0.01 + 0.015 + 0.00795, 0.02, 0.03]
    mujoco.mj_forward(model, data)
    pressed = Taxels(model, skin, geom="pad", site="skin").press(data)
    assert np.linalg.norm(pressed.wrench[0, :3]) > 0
    assert not pressed.felt.any()
    assert pressed.missed.tolist() == [1]


def test_names_that_are_not_there(skin: pp.Skin) -> None:
    model, _ = scene("ball")
    with pytest.raises(pp.InvalidInput, match=r"no geom 'paad'\. It has 'pad', 'tool'"):
        Taxels(model, skin, geom="paad", site="skin")
    with pytest.raises(pp.InvalidInput, match=r"no site 'skn'\. It has 'skin'"):
        Taxels(model, skin, geom="pad", site="skn")
