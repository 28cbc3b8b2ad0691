"""Check the settings of a tracker."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.contact.policy import Policy
from palpate.sensing.arrays import Array

__all__ = ["MISREAD", "check_settings", "check_sought", "chosen_channels", "on_coarser_cells"]


def check_settings(**settings: float | None) -> None:
    """Raise `InvalidInput` for settings that are not positive numbers; None is allowed for ``budget`` and ``rezero``."""
    for name, value in settings.items():
        if value is None and name in ("budget", "rezero"):
            continue
        if isinstance(value, bool) or not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
            raise InvalidInput(f"{name} must be a positive number; got {value!r}.")


def chosen_channels(channels: Sequence[str] | None, arrays: Sequence[Array]) -> npt.NDArray[np.bool_]:
    """Mask of the channels of all arrays (channel,) that are named; all of them for None. `InvalidInput` if one is unknown."""
    every = [c for a in arrays for c in a.channels]
    chosen = every if channels is None else [channels] if isinstance(channels, str) else list(channels)
    for name in chosen:
        if name not in every:
            raise InvalidInput(f"no channel {name!r} to take a zero of; there are {', '.join(dict.fromkeys(every))}.")
    return np.isin(np.array(every), chosen)


def check_sought(components: Sequence[str], boundary: str) -> None:
    """Raise `Unsupported` for problems that no tracker can solve, and name the method that can."""
    frames = 'Skin.reconstruct(readings, method="tikhonov") (palpate reconstruct --method tikhonov)'
    if boundary == "periodic":
        raise Unsupported(
            f'a tracker needs boundary="free". On a periodic surface take frames by themselves, {frames}.'
        )
    if "z" not in components:
        raise Unsupported(
            f"a tracker keeps pressure from pulling, so it needs the pressure: seek z too, with channels that measure it, or take frames by themselves, {frames}."
        )


def on_coarser_cells(skin: Any) -> tuple[Any, tuple[str, ...]]:
    """The skin on the coarser cells that `Skin.reconstruct` solves on if its surface has many thousands of cells
    (`Problem.coarser`), with a note; otherwise itself, without one.
    """
    coarser = skin._problem.coarser(Policy().work.unknowns)
    if coarser is skin._problem:
        return skin, ()
    given, used = (" x ".join(map(str, p.surface.shape)) for p in (skin._problem, coarser))
    said = f"tracked on {used} cells: the readings do not resolve the {given} of the surface that was given"
    return skin._with(skin.pad, skin.planes, coarser.surface), (said,)


#: Note for channels that cannot separate pressure from shear. Balls that press, slide and twist were read 1 to 35 % too
#: small from markers 0.5 mm deep in a gel of 3.5 to 4 mm, 4 to 20 % too large 1 mm deep, and 60 % too small on its
#: surface; shear forces were within their intervals.
MISREAD = (
    "a tracker misreads the normal force from markers that only move sideways, by up to a third where they lie in the gel and more on its surface, and its intervals need not know; "
    "shear is as good as that of frames by themselves (Skin.reconstruct, palpate reconstruct, and of pictures palpate track without --fast)"
)
