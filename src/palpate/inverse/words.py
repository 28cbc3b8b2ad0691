"""Notes on assumptions of a method and on what the readings cannot determine."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.inverse.method import Method
from palpate.inverse.observability import presses, without_mean
from palpate.inverse.problem import Problem
from palpate.sensing.uncertainty import MODULUS, scale_free

__all__ = ["ASSUMED", "notes", "surface_strain"]

#: Prefix of sentences about assumptions; a summary joins them in one line, and they are not notes.
ASSUMED = "assumed: "

_SPOKEN = {"x": "shear along x", "y": "shear along y", "z": "pressure"}


def notes(problem: Problem, default: tuple[str, ...], method: Method, prepared: Any) -> tuple[str, ...]:
    """Notes for every result of a problem; ``default`` are the components sought by default."""
    sought, found = problem.components, []
    zero = [c for c in problem.surface.components if c not in sought]
    if zero:
        forced = set(sought) == set(default)
        why = " (the channels cannot tell all components apart)" if forced else " as asked"
        if set(zero).isdisjoint(getattr(problem.pad, "components", zero)):
            why = " (no press of the table acts that way)"
        found.append(f"{ASSUMED}{_spoken(zero)} taken as zero{why}")
        if forced and zero == ["z"] and problem.boundary == "free" and presses(problem.pad, problem.planes, sought):
            found.append(
                "pressure changes these readings too, and would be taken for shear: where something presses, seek it as well "
                f"(components {', '.join(problem.surface.components)})"
            )
    if problem.ambiguous and method.narrows:
        found.append(
            "these channels alone do not separate pressure from shear: the method assumes that pressure pushes and that both act in the contact "
            "only, so that a pull, or an image that grows or shrinks, would be taken for contact (for cells, which pull along the "
            "surface, seek shear alone)"
        )
    found.extend(f"{ASSUMED}{one}" for one in method.assumptions())
    if without_mean(problem.pad, problem.planes, problem.boundary):
        found.append(
            "net force cannot be known from displacements of a periodic half-space: the mean traction is set to zero"
        )
    elif prepared.grid is problem.surface:
        blind = problem.blind
        if blind:
            found.append(
                f"these channels do not respond to a uniform load: the net force of {_spoken(blind)} follows from the finite width of the "
                "contact alone"
            )
    if problem.uncertainty.youngs_modulus is None and scale_free(problem.planes).any():
        found.append(
            f'{ASSUMED}Young\'s modulus known to {100.0 * MODULUS:g} % (to change this: "200 kPa +- 5 %" in skin.toml, or uncertainty=)'
        )
    found.extend(getattr(problem.pad, "notes", ()))
    found.extend(getattr(prepared, "notes", ()))
    return tuple(found)


def surface_strain(problem: Problem, traction: Any) -> Any:
    """Approximate largest strain at the surface (*batch): the peak of ``traction`` (*batch, component, *surface)
    divided by the pad's Young's modulus there.
    """
    size = np.sqrt((to_numpy(traction).astype(np.float64) ** 2).sum(axis=-1 - problem.surface.dimensions))
    peak = size.max(axis=tuple(range(-problem.surface.dimensions, 0)))
    return np.asarray(peak * problem.pad.compliance(0.0)[2, 2])


def _spoken(components: Iterable[str]) -> str:
    return " and ".join(_SPOKEN[c] for c in components)
