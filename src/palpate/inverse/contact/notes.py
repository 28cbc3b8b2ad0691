"""Notes on frames, and the quantities they depend on: small contacts, single taxels, contact at and beyond the edge,
loads that rest on one reading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.contact.compact import DISC
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.policy import Policy
from palpate.sensing.arrays import Array
from palpate.sensing.grids import Grid

__all__ = ["notes_of", "notes_of_contact", "single_taxel_share", "smallness"]


def smallness(members: Sequence[ContactModel], planes: Sequence[Array], run: Solved, policy: Policy) -> int:
    """Return 0 if the contact is not small, 1 if it may be small, and 2 if in addition only one taxel reads more than
    noise, so that a small contact cannot be distinguished from a broken taxel.
    """
    if not any(m.kind == DISC for m in members):
        return 0
    first = np.cumsum([0] + [int(a.valid.sum()) for a in planes])
    taxel = np.concatenate([np.tile(np.arange(s, e), len(a.channels)) for a, s, e in zip(planes, first, first[1:])])
    squares = np.where(run.observed, (run.data / np.where(run.noise > 0, run.noise, 1.0)) ** 2, 0.0)
    rest = run.observed & (taxel != taxel[int(np.argmax(squares))])
    count = int(rest.sum())
    level = count + policy.errors.stands_out * math.sqrt(2.0 * count)
    return 2 if count and squares[rest].max() < policy.errors.stands_out**2 and squares[rest].sum() < level else 1


def single_taxel_share(planes: Sequence[Array], run: Solved, pressure: Floats, grid: Grid, policy: Policy) -> float:
    """Largest fraction of the load (``pressure`` on the surface cells) that rests on one taxel whose neighbours read
    no contact.
    """
    import scipy.spatial

    readings, load = run.observed & (np.abs(run.data) > policy.errors.stands_out * run.noise), float(pressure.sum())
    if not readings.any() or not load > 0.0:
        return 0.0
    places, loud, start = [], [], 0
    for array in planes:
        places.append(array.points[array.valid.ravel()])
        size = len(places[-1]) * len(array.channels)
        loud.append(readings[start : start + size].reshape(len(array.channels), -1).any(axis=0))
        start += size
    others = scipy.spatial.cKDTree(np.concatenate([p[q] for p, q in zip(places, loud)]))
    cells, found = None, 0.0
    for points, heard in zip(places, loud):
        if len(points) < 2 or not heard.any():
            continue
        near = scipy.spatial.cKDTree(points).query(points[heard], k=2)[0][:, 1]
        # The nearest taxel found is the taxel itself.
        alone = others.query(points[heard], k=2)[0][:, 1] > policy.errors.beside * near
        for point, reach in zip(points[heard][alone], near[alone]):
            if cells is None:
                cells = np.stack([x.ravel() for x in np.meshgrid(*grid.axes, indexing="ij")[::-1]], axis=1)
            here = ((cells - point) ** 2).sum(axis=1) < reach**2
            found = max(found, float(pressure.ravel()[here].sum()) / load)
    return found


def notes_of(frames: Sequence[Frame], batch: tuple[int, ...], policy: Policy) -> tuple[str, ...]:
    """Notes about what the readings of these frames, of a ``batch`` of this shape, cannot determine."""
    said = list(notes_of_contact(frames, batch, policy))
    refused = [f.refused for f in frames if f.refused]
    if refused:
        said.append(f"not solved{_where(len(refused), batch)}: {refused[0]}")
    pressed = sum(f.unproven == 2 for f in frames)
    short = sum(not f.converged for f in frames)
    if short:
        said.append(
            f"the iteration did not reach its tolerance{_where(short, batch)}: the best traction found is given, and the error bars may be too narrow; "
            'method="tikhonov" has no such iteration'
        )
    if pressed:
        said.append(
            f"nothing was found{_where(pressed, batch)}, but an even contact over all of these few taxels explains the readings as well as noise does, and the interval includes it: "
            "noise= of the array, if it is known, decides"
        )
    return tuple(said)


def _where(count: int, batch: tuple[int, ...]) -> str:
    return f" in {count} of {math.prod(batch)} frames" if batch else ""


def notes_of_contact(frames: Sequence[Frame], batch: tuple[int, ...], policy: Policy) -> tuple[str, ...]:
    """Those that hold as long as the contact stays where it is."""

    def where(count: int) -> str:
        return _where(count, batch)

    small, alone = sum(f.small > 0 for f in frames), sum(f.small > 1 for f in frames)
    said = []
    if small:
        said.append(
            f"small contact{where(small)}: few taxels respond to it, so that its size, its place between them and its force are as "
            "uncertain as the intervals say"
        )
    if alone:
        said.append(
            f"small contact or a broken taxel{where(alone)}: one taxel alone responds, and the others read as if nothing touches"
        )
    lonely = sum(f.alone > policy.errors.much and f.small < 2 for f in frames)
    if lonely:
        said.append(
            f"a broken taxel or a small contact beside others{where(lonely)}: one taxel alone shows a part of the load, and its neighbours read as if "
            "nothing touches"
        )
    across = sum(f.beyond[0] > policy.errors.much or f.beyond[1] > policy.extent.goes_on for f in frames)
    if across:
        said.append(
            f"contact across the edge{where(across)}: more than {100.0 * policy.errors.much:.0f} % of the load, or {100.0 * policy.extent.goes_on:.0f} % of the largest traction, was found outside the outermost "
            "taxels, where nothing is measured"
        )
    brink = sum(
        f.beyond[0] <= policy.errors.much
        and f.beyond[1] <= policy.extent.goes_on
        and f.beyond[2] > policy.extent.at_edge
        for f in frames
    )
    if brink:
        said.append(
            f"contact at the edge{where(brink)}: at the outermost taxels traction is {100.0 * policy.extent.at_edge:.0f} % of the largest or more, and how far it continues "
            "beyond them is not measured: the intervals allow for as far as it reaches inwards"
        )
    hanging = [f.hangs for f in frames if f.hangs > policy.errors.hangs]
    if hanging:
        said.append(
            f"one reading alone determines {100.0 * max(hanging):.0f} % of the normal force{where(len(hanging))}: no other shows whether it is right, or "
            "at the end of its range (limits= of the array states that end)"
        )
    drifting = sum(f.adrift for f in frames)
    if drifting:
        said.append(
            f"drift{where(drifting)}: the readings do not separate a shift or a tilt of the displacements from contact, so that it may be part of the force: "
            "the intervals allow for one of a tenth of the largest reading (standard deviation). If nothing drifts, pass Skin(..., nuisance=[])"
        )
    return tuple(said)
