"""Contacts of simulators, and MuJoCo's geoms and sites; what a refusal says that they must be."""

from __future__ import annotations

from typing import Any

import numpy as np

import palpate as pp
from palpate.pressing import Contacts, Surface, local_shape
from remedies._remedy import Remedy, value

__all__ = ["REMEDIES"]

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
AREA = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
LINE = pp.LineArray(count=6, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
CREEPS = pp.Viscoelastic(PAD, prony=[(0.2, 1.0)])
SKIN = pp.Skin(PAD, AREA)
CURVED = 200.0 * np.stack([np.eye(2)] * 2)
SCENE = """
<mujoco>
  <worldbody>
    <geom name="pad" type="box" size="0.01 0.01 0.002" pos="0 0 -0.002"/>
    <site name="skin" quat="0 1 0 0"/>
  </worldbody>
</mujoco>"""


def contacts(**changed: Any) -> Contacts:
    given: dict[str, Any] = {
        "position": [[0.0, 0.0, 0.0]],
        "force": [[0.0, 0.0, 1.0]],
        "curvature": 200.0 * np.eye(2)[None],
        "friction": [0.6],
        **changed,
    }
    return Contacts(**given)


def taxels(geom: Any = "pad", site: str = "skin") -> Any:
    import mujoco

    from palpate.mujoco import Taxels

    return Taxels(mujoco.MjModel.from_xml_string(SCENE), SKIN, geom=geom, site=site)


REMEDIES = [
    value(
        "must hold numbers of shape {}, one entry for each of {} positions",
        lambda v: contacts(force=v),
        [[0.0, 1.0]],
        [[0.0, 0.0, 1.0]],
    ),
    Remedy(
        "must be finite; entry",
        lambda: Contacts(np.zeros((2, 3)), [[0.0, 0.0, 1.0], [0.0, 0.0, np.nan]], CURVED, [0.6, 0.6]),
        lambda: Contacts(np.zeros((1, 3)), [[0.0, 0.0, 1.0]], CURVED[:1], [0.6]),
        room="pressing.contacts",
    ),
    value(
        "point must be three finite numbers",
        lambda v: local_shape("sphere", [1e-3], v),
        [0.0, 1e-3],
        [0.0, 0.0, 1e-3],
    ),
    value("contacts of a simulator press on an area", lambda a: Surface(pp.Skin(PAD, a)), LINE, AREA),
    value(
        'contacts of a simulator need boundary="free"',
        lambda v: Surface(pp.Skin(PAD, AREA, **v)),
        {"boundary": "periodic"},
        {},
    ),
    Remedy(
        "contacts of a simulator come without a history",
        lambda: Surface(pp.Skin(CREEPS, AREA)),
        lambda: Surface(pp.Skin(CREEPS, AREA).without_creep()),
    ),
    value("least must be a positive number of metres", lambda v: Surface(SKIN, least=v), -1e-3, 1e-3),
    value("contacts.world goes from", lambda n: Surface(SKIN).press(contacts(world=[2]), worlds=n), 1, 3),
    value("the model has no {} {}. It has", taxels, "gel", "pad"),
    value("geom is empty", taxels, [], ["pad"]),
]
