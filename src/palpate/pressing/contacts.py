"""Contacts as a simulator reports them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["Contacts"]


@dataclass(frozen=True)
class Contacts:
    """Contacts of bodies with a pad, one entry for each, in the axes of the pad: x and y on its surface, z into it.

    Attributes
    ----------
    position : array (contact, 3)
        [m], from the middle of the surface.
    force : array (contact, 3)
        On the pad [N]: z positive presses.
    torque : array (contact, 3)
        On the pad, about `position` [N m].
    friction : array (contact,)
        Coefficient of friction.
    curvature : array (contact, 2, 2)
        Sum of both bodies' curvatures [1/m] in x and y; 0 for a flat, and along a cylinder.
    world : array (contact,) of int
        The world of the contact.
    body : array (contact,) of int
        Contacts of one world with the same number are of one pair of bodies, and are spread together.
    known : array (contact,) of bool
        False if the curvature is unknown.
    sharp : array (contact,) of bool
        An edge or a corner.
    disc : array (contact, 3)
        x, y of the middle and the radius [m] of a flat disc that presses; radius 0 without a disc.
    length : array (contact,)
        Length of the straight line along which a cylinder or a capsule presses [m], or 0.

    Raises
    ------
    InvalidInput
        Numbers that are not finite, or shapes that do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.pressing import Contacts
    >>> ball = Contacts(position=[[0.0, 0.0, 0.0]], force=[[0.1, 0.0, 1.0]], curvature=200.0 * np.eye(2)[None], friction=[0.6])
    >>> len(ball), ball.wrench(1).tolist()  # force and moment about the middle
    (1, [[0.1, 0.0, 1.0, 0.0, 0.0, 0.0]])
    """

    position: npt.ArrayLike
    force: npt.ArrayLike
    curvature: npt.ArrayLike
    friction: npt.ArrayLike
    torque: npt.ArrayLike | None = None
    world: npt.ArrayLike | None = None
    body: npt.ArrayLike | None = None
    known: npt.ArrayLike | None = None
    sharp: npt.ArrayLike | None = None
    disc: npt.ArrayLike | None = None
    length: npt.ArrayLike | None = None
    _count: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        n = len(np.asarray(self.position))
        # defaults: no torque, one world, and each contact belongs to a body of its own
        given: dict[str, tuple[tuple[int, ...], type, object]] = {
            "position": ((3,), float, None),
            "force": ((3,), float, None),
            "curvature": ((2, 2), float, None),
            "friction": ((), float, None),
            "torque": ((3,), float, 0.0),
            "world": ((), int, 0),
            "body": ((), int, np.arange(n)),
            "known": ((), bool, True),
            "sharp": ((), bool, False),
            "disc": ((3,), float, 0.0),
            "length": ((), float, 0.0),
        }
        for name, (shape, kind, default) in given.items():
            value = getattr(self, name)
            try:
                found: npt.NDArray[Any] = np.asarray(default if value is None else value, dtype=kind)
                found = np.array(np.broadcast_to(found, (n, *shape))) if value is None else found.reshape(n, *shape)
            except (TypeError, ValueError) as error:
                raise InvalidInput(
                    f"{name} must hold numbers of shape {(n, *shape)}, one entry for each of {n} positions; got shape {np.shape(value)}."
                ) from error
            if kind is float and not np.isfinite(found).all():
                raise InvalidInput(
                    f"{name} must be finite; entry {(at := int(np.argwhere(~np.isfinite(found))[0][0]))} is {found[at]}. Leave that contact out."
                )
            object.__setattr__(self, name, found)
        object.__setattr__(self, "_count", n)

    def __len__(self) -> int:
        return self._count

    def wrench(self, worlds: int) -> Floats:
        """Net force and moment about the middle of the surface (world, 6) [N, N m] of all contacts in each world."""
        out = np.zeros((worlds, 6))
        position, force = np.asarray(self.position), np.asarray(self.force)
        moment = np.cross(position, force) + np.asarray(self.torque)
        np.add.at(out, np.asarray(self.world), np.concatenate([force, moment], axis=1))
        return out

    def some(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> Contacts:
        """Return a selection of the contacts."""
        return Contacts(**{f.name: np.asarray(getattr(self, f.name))[which] for f in fields(self) if f.init})
