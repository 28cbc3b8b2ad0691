"""Nuisances of the readings: offsets, ramps, rigid motion of an image.

readings = A t + B c + noise. Each column of B is one `Nuisance`: a known pattern of the readings with an unknown size c. Methods solve for t with c
marginalised: readings that a nuisance could explain do not become contact, and widen the error bars.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.arrays import AreaArray, Array

__all__ = ["AT_EDGE", "DRIFTS", "LATER", "NUISANCES", "USUAL", "Nuisance", "check_nuisance", "groups", "nuisances"]

#: Kinds of nuisance by their short names. A kind that is neither in `USUAL` nor in `LATER` is sought only if the user names it.
NUISANCES: tuple[str, ...] = ("offset", "ramp", "rotation")
#: Kinds that the contact method seeks in every frame if the user names none, with contact and with noise alone.
USUAL = ("offset", "rotation")
#: Kinds that it seeks beside contact only; `inverse/contact/proposals` decides when (`ramps.py`: if the outermost taxels show one).
LATER = ("ramp",)
#: Kinds of one channel each whose sizes the outermost taxels tell, where contact is faint: their first sizes are fitted there. Others start from 0.
AT_EDGE = ("offset", "ramp")
#: Kinds for which the residual of every frame is tested, also of frames for which the user named others.
DRIFTS = ("offset", "ramp")

_SHIFT = {"displacement_x": "shift along x", "displacement_y": "shift along y", "displacement_z": "shift along z"}


@dataclass(frozen=True, eq=False)
class Nuisance:
    """One nuisance pattern of the readings.

    Attributes
    ----------
    kind : str
        How it is sought: one of `NUISANCES`, or "group" (`groups`).
    label : str
        Such as "offset of stress_zz".
    unit : str
        Unit of its size c: that of the channel for an offset; per metre for a ramp; rad for a rotation.
    rows : array (reading,)
        Readings for a size of 1, in the order of the operator's rows (plane, channel, working taxel).
    group : str
        Nuisances that may have one cause have the same, such as the channels of a row on one cable. They are also tried together, each with its own size. Empty: none.
    """

    kind: str
    label: str
    unit: str
    rows: Floats
    group: str = ""

    @property
    def of_image(self) -> bool:
        """Whether it moves a picture: a zero does not tell that the camera stayed where it was."""
        return self.kind == "rotation" or self.unit.startswith("m")


def check_nuisance(kinds: Sequence[str] | str | None) -> tuple[str, ...] | None:
    """The kinds in order, or None if the readings decide; raises `InvalidInput` for unknown kinds."""
    if kinds is None or kinds == "auto":
        return None
    if isinstance(kinds, str) or any(k not in NUISANCES for k in kinds):
        raise InvalidInput(
            f'nuisance must be "auto" (the readings decide) or a list of {", ".join(NUISANCES)} (an empty one for none); got {kinds!r}.'
        )
    return tuple(k for k in NUISANCES if k in kinds)


def nuisances(planes: Sequence[Array], kinds: Sequence[str]) -> list[Nuisance]:
    """Every nuisance of these kinds that the planes can have.

    "offset": one for each channel of each plane (of displacement: a shift of the image). "ramp": a linear change along x (and y) of each
    channel. "rotation": a small rotation about the normal of a plane that measures displacement_x and displacement_y.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.sensing.nuisance import nuisances
    >>> array = pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])
    >>> [(n.label, n.rows.tolist()) for n in nuisances([array], ["offset"])][1]
    ('offset of stress_zz', [0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    """
    sizes = [int(a.valid.sum()) * len(a.channels) for a in planes]
    total, start = sum(sizes), 0
    found = []
    for number, array in enumerate(planes):
        where = f" in plane {number}" if len(planes) > 1 else ""
        points = array.points[array.valid.ravel()]
        middle = (points - points.mean(axis=0))[:, ::-1]  # x, then y
        n = len(points)

        def column(parts: dict[int, Floats], start: int = start, n: int = n) -> Floats:
            rows = np.zeros(total)
            for channel, values in parts.items():
                rows[start + channel * n : start + (channel + 1) * n] = values
            return rows

        for i, channel in enumerate(array.channels):
            unit = find_channel(channel).kind.unit
            if "offset" in kinds:
                label = _SHIFT.get(channel, f"offset of {channel}")
                found.append(Nuisance("offset", label + where, unit, column({i: np.ones(n)})))
            if "ramp" in kinds:
                for axis in range(array.dimensions):
                    label = f"ramp of {channel} along {'xy'[axis]}"
                    found.append(Nuisance("ramp", label + where, f"{unit}/m", column({i: middle[:, axis]})))
        names = list(array.channels)
        if "rotation" in kinds and array.dimensions == 2 and {"displacement_x", "displacement_y"} <= set(names):
            parts = {names.index("displacement_x"): -middle[:, 1], names.index("displacement_y"): middle[:, 0]}
            found.append(Nuisance("rotation", "rotation about z" + where, "rad", column(parts)))
        start += sizes[number]
    return found


def groups(planes: Sequence[Array]) -> list[Nuisance]:
    """Offset of each row, column, half and quarter of every channel of stress or strain, which share a cable or a
    converter.

    None for a channel of displacement, whose readings come from an image, and for arrays without rows.
    """
    sizes = [int(a.valid.sum()) * len(a.channels) for a in planes]
    total, start = sum(sizes), 0
    found = []
    for number, array in enumerate(planes):
        where = f" in plane {number}" if len(planes) > 1 else ""
        n = int(array.valid.sum())
        if isinstance(array, AreaArray) and min(array.shape) > 1:
            masks = _groups_of(array)
            for i, channel in enumerate(array.channels):
                kind = find_channel(channel).kind
                if kind.absolute:
                    continue
                for at, here in masks.items():
                    rows = np.zeros(total)
                    rows[start + i * n : start + (i + 1) * n] = here
                    found.append(Nuisance("group", f"offset of {channel} in {at}{where}", kind.unit, rows, at + where))
        start += sizes[number]
    return found


def _groups_of(array: AreaArray) -> dict[str, npt.NDArray[np.bool_]]:
    """Masks (taxel,) of taxels that may share a cable or a converter: rows, columns, halves and quarters."""
    places = np.nonzero(array.valid)
    found = {f"{name} {k}": p == k for name, p in zip(("row", "column"), places) for k in np.unique(p)}
    low, left = (p < n // 2 for p, n in zip(places, array.shape))
    halves = {"lower": low, "upper": ~low, "left": left, "right": ~left}
    found |= {f"the {name} half": here for name, here in halves.items()}
    for a, b in itertools.product(("lower", "upper"), ("left", "right")):
        found[f"the {a} {b} quarter"] = halves[a] & halves[b]
    return found
