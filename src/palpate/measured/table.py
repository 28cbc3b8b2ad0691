"""A table of presses (places, forces, readings), checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import check_channels
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.measured.response import SHAPES, spacing

__all__ = ["Table"]

#: Smallest number of places for a response: a square of 4 x 4 places has four inside.
MIN_PLACES = 16
#: Largest number of presses: computing time grows as the cube.
MAX_PRESSES = 3000
#: Positions larger than this [m] are not in metres.
LARGEST = 2.0
#: A component counts as loaded if its largest force is at least this fraction of the largest of all.
LOADED = 1e-6
#: A reading is dead if it changes by less than this fraction of the others' change.
DEAD = 1e-6
#: A frame is at rest if its force is below this fraction of the largest.
REST_FRACTION = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Readings of presses at known places.

    Attributes
    ----------
    places : array (press, 2)
        (x, y) of each press [m].
    force : array (press,) or (press, 3)
        Normal force, or (x, y, z) [N], positive into the pad. Presses without force are the zero of the readings.
    readings : array (press, channel, taxel)
        A taxel that reads NaN throughout is dead.
    positions : array (taxel, 2)
        (x, y) of each taxel or marker [m].
    channels : sequence of str
        Channels of each taxel.
    radius : float or array (press,)
        Radius of the disc that the indenter touched [m]; 0 for a point.
    indenter : str
        How its pressure is spread over that disc: "hertz" (a ball), "disc" (evenly), "punch" (a rigid flat end).
    components : tuple of str
        Components of the force that some press has; found.
    working : array (taxel,)
        Whether a taxel reads anything; found.

    Raises
    ------
    InvalidInput
        Shapes that do not fit, numbers that are not finite, too few places, places that lie beside the taxels.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.measured import Table
    >>> xy = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), -1).reshape(-1, 2) * 1e-3
    >>> table = Table(places=xy, force=np.ones(16), readings=np.random.default_rng(0).random((16, 1, 2)),
    ...     positions=[(0.0, 0.0), (3e-3, 3e-3)], channels=["stress_zz"], radius=0.5e-3)
    >>> table.components, table.working.tolist()
    (('z',), [True, True])
    """

    places: Any
    force: Any
    readings: Any
    positions: Any
    channels: Sequence[str]
    radius: Any
    indenter: str = "hertz"
    components: tuple[str, ...] = field(init=False)
    working: npt.NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        places, positions = _places("places", self.places), _places("positions", self.positions)
        n = len(places)
        force = _numbers("force", self.force)
        if force.ndim == 1:
            force = np.stack([np.zeros_like(force), np.zeros_like(force), force], axis=-1)
        channels = check_channels(self.channels, 2)
        readings = _numbers("readings", self.readings)
        if force.shape != (n, 3) or readings.shape != (n, len(channels), len(positions)):
            raise InvalidInput(
                f"{n} places, {len(channels)} channels and {len(positions)} taxels need force ({n},) or ({n}, 3) and readings "
                f"({n}, {len(channels)}, {len(positions)}); got {force.shape} and {readings.shape}."
            )
        _check_force(force)
        rest = np.abs(force).max(axis=1) <= REST_FRACTION * np.abs(force).max()
        if self.indenter not in SHAPES:
            raise InvalidInput(f"indenter must be {', '.join(SHAPES)}; got {self.indenter!r}.")
        radius = _numbers("radius", self.radius)
        if radius.shape not in ((), (n,)) or not np.isfinite(radius).all() or (radius < 0).any():
            raise InvalidInput(
                f"radius must be one length or one for each of {n} presses, 0 or larger [m]; got {self.radius!r}."
            )
        radius = np.broadcast_to(radius, (n,))
        dead = np.isnan(readings).all(axis=(0, 1))
        odd = ~np.isfinite(readings[:, :, ~dead])
        if odd.any():
            press, _, taxel = (int(i) for i in np.argwhere(odd)[0])
            raise InvalidInput(
                f"{int(odd.sum())} readings are not finite, the first at press {press}, taxel {int(np.flatnonzero(~dead)[taxel])}. Leave such presses out; "
                "a dead taxel reads NaN in all of them."
            )
        if rest.any():
            readings = readings - readings[rest].mean(axis=0)
        change = np.ptp(np.where(dead, 0.0, readings), axis=0).max(axis=0)
        dead |= change <= DEAD * change.max()
        if dead.all():
            raise InvalidInput(
                "no reading changes with the presses: the table holds no response. Record the readings under load."
            )
        keep = ~rest
        for name, value in (
            ("places", places[keep]), ("force", force[keep]), ("radius", np.ascontiguousarray(radius[keep])),
            ("readings", np.where(dead, 0.0, readings)[keep]), ("positions", positions), ("working", ~dead),
        ):  # fmt: skip
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "channels", channels)
        loaded = np.abs(self.force).max(axis=0)
        object.__setattr__(self, "components", tuple(c for c, f in zip("xyz", loaded) if f > LOADED * loaded.max()))
        self._check_places()

    def _check_places(self) -> None:
        distinct = np.unique(self.places, axis=0)
        if len(distinct) < MIN_PLACES or np.ptp(distinct, axis=0).min() <= 0.0:
            raise InvalidInput(
                f"the table has presses at {len(distinct)} places, and at least {MIN_PLACES} are needed, spread over an area. Press at more places, about as "
                "far apart as the sensors are deep."
            )
        if len(self.places) > MAX_PRESSES:
            raise InvalidInput(
                f"the table has {len(self.places)} presses, and at most {MAX_PRESSES} are served. Take a part of them, or average those at one place."
            )
        widest = float(np.ptp(distinct, axis=0).max())
        beside = (self.positions.max(axis=0) < distinct.min(axis=0)) | (
            self.positions.min(axis=0) > distinct.max(axis=0)
        )
        across = float(np.ptp(self.positions, axis=0).max())
        if beside.any() or not 1e-2 < across / widest < 1e2:
            raise InvalidInput(
                f"the presses reach over {widest:g} m about x, y = {_middle(distinct)} m, the taxels over {across:g} m about {_middle(self.positions)} m. Give "
                "both in metres, in the same coordinates."
            )
        if float(self.radius.max()) > 0.5 * widest:
            raise InvalidInput(
                f"radius = {float(self.radius.max()):g} m is more than half of the {widest:g} m that was pressed. Give the radius of the contact, in metres."
            )

    @property
    def spacing(self) -> float:
        """Mean distance of neighbouring presses [m]."""
        return spacing(self.places)


def _middle(places: Floats) -> str:
    low, high = places.min(axis=0), places.max(axis=0)
    return ", ".join(f"{0.5 * (a + b):.3g}" for a, b in zip(low, high))


def _numbers(name: str, value: Any) -> Floats:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{name} must be numbers; got {type(value).__name__} ({error}).") from error


def _places(name: str, value: Any) -> Floats:
    found = _numbers(name, value)
    if found.ndim != 2 or found.shape[1] != 2 or len(found) < 2 or not np.isfinite(found).all():
        raise InvalidInput(f"{name} must be a finite array (n, 2) of (x, y) [m]; got shape {found.shape}.")
    if np.abs(found).max() > LARGEST:
        raise InvalidInput(
            f"{name} reach to {np.abs(found).max():g} m. Lengths are in metres: multiply millimetres by 1e-3."
        )
    return found


def _check_force(force: Floats) -> None:
    if not np.isfinite(force).all():
        raise InvalidInput(
            f"{int((~np.isfinite(force)).any(axis=1).sum())} presses have a force that is not finite. Leave them out."
        )
    largest = np.abs(force).max()
    if not largest > 0.0:
        raise InvalidInput("no press has a force. Give what pressed, in newtons; 1 for responses to unit loads.")
    if (force[:, 2] < -LOADED * largest).any():
        raise InvalidInput(
            f"{int((force[:, 2] < -LOADED * largest).sum())} presses have a normal force below zero. Forces that press are positive: turn their sign, and "
            "leave pulls out."
        )
    if not (force[:, 2] > LOADED * largest).any():
        raise InvalidInput(
            "no press has a normal force: a response to what presses is needed. Press at the places too."
        )
