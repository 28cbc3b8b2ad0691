"""Taxels for MuJoCo: compute the readings of any skin from the contacts of a simulated geom.

MuJoCo's own tactile sensors measure depth and speed. Here a skin, which may describe a real sensor, is attached to a
geom. Its readings are those that the solver's contact forces would cause: pressure distributed according to geometry
and modulus, shear according to friction, through the pad to the taxels (`palpate.pressing`). Force and moment are
those of the simulator's contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate._extras import require
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.pressing import Contacts, Local, Pressed, Surface, local_shape
from palpate.skin import Skin

__all__ = ["Taxels"]

#: MuJoCo's kinds of geom, and their names in `palpate.pressing.SHAPES`.
KINDS = {"mjGEOM_PLANE", "mjGEOM_SPHERE", "mjGEOM_CAPSULE", "mjGEOM_CYLINDER", "mjGEOM_ELLIPSOID", "mjGEOM_BOX"}


class Taxels:
    """A skin attached to a geom.

    Parameters
    ----------
    model : mujoco.MjModel
    skin : Skin
        A skin for area contact, e.g. from the skin.toml of the real sensor.
    geom : str or sequence of str
        The geom, or geoms, that the skin lies on: all of their contacts press it.
    site : str
        A site in the middle of the pad's surface: x and y along the skin's, z INTO the pad.
    least : float, optional
        Radius [m] over which edges, corners and meshes press; see `palpate.pressing.Surface`.

    Raises
    ------
    InvalidInput
        A geom or a site that the model does not have.
    Unsupported
        MuJoCo is not installed; a skin in line contact, a periodic surface, or a pad that creeps.

    Examples
    --------
    >>> import mujoco
    >>> import palpate as pp
    >>> from palpate.mujoco import Taxels
    >>> model = mujoco.MjModel.from_xml_string('''
    ... <mujoco>
    ...   <worldbody>
    ...     <geom name="pad" type="box" size="0.01 0.01 0.002" pos="0 0 -0.002"/>
    ...     <site name="skin" quat="0 1 0 0"/>
    ...     <body pos="0 0 0.0101"><freejoint/><geom type="sphere" size="0.01" mass="0.1"/></body>
    ...   </worldbody>
    ... </mujoco>''')
    >>> data = mujoco.MjData(model)
    >>> array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    >>> taxels = Taxels(model, skin, geom="pad", site="skin")
    >>> for _ in range(1000):
    ...     mujoco.mj_step(model, data)
    >>> pressed = taxels.press(data)
    >>> round(float(pressed.felt[0, 2]), 2)  # the weight of 0.1 kg [N]
    0.98
    >>> taxels.read(data).shape
    (3, 8, 8)
    """

    def __init__(
        self, model: Any, skin: Skin, *, geom: str | Sequence[str], site: str, least: float | None = None
    ) -> None:
        require("taxels for MuJoCo", "mujoco")
        import mujoco

        self._mujoco, self.model = mujoco, model
        self.surface = Surface(skin, least=least)
        names = (geom,) if isinstance(geom, str) else tuple(geom)
        self._geoms = [self._named(mujoco.mjtObj.mjOBJ_GEOM, "geom", name) for name in names]
        self._site = self._named(mujoco.mjtObj.mjOBJ_SITE, "site", site)
        if not names:
            raise InvalidInput("geom is empty: pass the name of the geom that the skin lies on.")

    def _named(self, kind: Any, word: str, name: str) -> int:
        found = int(self._mujoco.mj_name2id(self.model, kind, name))
        if found < 0:
            count = getattr(self.model, f"n{word}")
            there = [self._mujoco.mj_id2name(self.model, kind, i) for i in range(count)]
            known = ", ".join(repr(n) for n in there if n) or f"none that has a name, of {count}"
            raise InvalidInput(f"the model has no {word} {name!r}. It has {known}. Pass one of these.")
        return found

    def read(self, data: Any, *, rng: np.random.Generator | None = None) -> Any:
        """Return the readings that the skin's sensor would give.

        Parameters
        ----------
        data : mujoco.MjData, or a sequence of them; or mujoco.mjx.Data, of one world or batched
            After mj_step or mj_forward, ``mjx.step`` or ``mjx.forward``.
        rng : numpy Generator, optional
            Adds the arrays' own noise.

        Returns
        -------
        array (channel, *array), or (world, channel, *array) of a sequence
            A list with one per plane where planes have different shapes.
        """
        worlds = self._worlds(data)
        several = isinstance(worlds, list)
        found = self.press(worlds).readings(rng=rng)
        if several:
            return found
        return [part[0] for part in found] if isinstance(found, list) else found[0]

    def press(self, data: Any) -> Pressed:
        """Return traction, wrench and readings of one world, or of each in a sequence: `palpate.pressing.Pressed`."""
        known = self._worlds(data)
        worlds = known if isinstance(known, list) else [known]
        return self.surface.press(self.contacts(worlds), worlds=len(worlds))

    def _worlds(self, data: Any) -> Any:
        """Return MjData, or a list of them; those of MJX are copied from the device on which they were computed."""
        if isinstance(data, list | tuple):
            return [self._worlds(d) for d in data]
        if not type(data).__module__.startswith("mujoco.mjx"):
            return data
        from mujoco import mjx

        return mjx.get_data(self.model, data)

    def contacts(self, worlds: Sequence[Any]) -> Contacts:
        """Return the contacts of the geoms in some worlds, in the axes of the site."""
        found: dict[str, list[Any]] = {
            name: []
            for name in ("position", "force", "torque", "friction", "curvature", "world", "body", "known", "sharp")
        }
        found |= {"disc": [], "length": []}
        result = np.zeros(6)
        for number, data in enumerate(worlds):
            pairs = data.contact.geom
            if not len(pairs):
                continue
            first = np.isin(pairs[:, 0], self._geoms)
            second = np.isin(pairs[:, 1], self._geoms)
            turn = data.site_xmat[self._site].reshape(3, 3)
            origin = data.site_xpos[self._site]
            # a contact between two geoms of the pad is not a load from outside
            for i in np.flatnonzero(first != second):
                pad, other = pairs[i] if first[i] else pairs[i][::-1]
                frame = data.contact.frame[i].reshape(3, 3)
                self._mujoco.mj_contactForce(self.model, data, int(i), result)
                # in MuJoCo, the contact force acts on the second geom
                sign = -1.0 if first[i] else 1.0
                place = data.contact.pos[i]
                bodies = [self._local(data, int(g), place) for g in (pad, other)]
                curved = sum(
                    turn.T @ self._turned(data, int(g), b.curvature) @ turn for g, b in zip((pad, other), bodies)
                )
                theirs = bodies[1]
                center = turn.T @ (self._turn(data, int(other)) @ theirs.center + data.geom_xpos[other] - origin)
                found["position"].append(turn.T @ (place - origin))
                found["force"].append(sign * (turn.T @ (frame.T @ result[:3])))
                found["torque"].append(sign * (turn.T @ (frame.T @ result[3:])))
                found["friction"].append(data.contact.friction[i][0])
                found["curvature"].append(np.asarray(curved)[:2, :2])
                found["world"].append(number)
                found["body"].append(int(pad) * self.model.ngeom + int(other))
                found["known"].append(bodies[0].known and theirs.known)
                # ignore the pad's own edges: it is soft
                found["sharp"].append(theirs.sharp)
                found["disc"].append([center[0], center[1], theirs.disc])
                found["length"].append(theirs.length)
        n = len(found["world"])
        shapes = {"position": 3, "force": 3, "torque": 3, "disc": 3}
        arrays = {
            k: np.asarray(v).reshape(n, 2, 2)
            if k == "curvature"
            else np.asarray(v).reshape(n, *([shapes[k]] if k in shapes else []))
            for k, v in found.items()
        }
        return Contacts(**arrays)

    def _turn(self, data: Any, geom: int) -> Floats:
        return np.asarray(data.geom_xmat[geom]).reshape(3, 3)

    def _turned(self, data: Any, geom: int, tensor: Floats) -> Floats:
        turn = self._turn(data, geom)
        return np.asarray(turn @ tensor @ turn.T)

    def _local(self, data: Any, geom: int, place: Floats) -> Local:
        kind = self._mujoco.mjtGeom(int(self.model.geom_type[geom])).name
        name = kind.removeprefix("mjGEOM_").lower() if kind in KINDS else "mesh"
        at = self._turn(data, geom).T @ (place - data.geom_xpos[geom])
        return local_shape(name, self.model.geom_size[geom], at)
