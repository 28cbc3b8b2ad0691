"""Compute traction and readings from contacts that a simulator reports as points and forces.

The geometry decides how a load is spread:

- two smooth bodies: Hertz's ellipse (`palpate.solutions.hertz_ellipse`); a cylinder or capsule along its line: Hertz's line contact;
- flat on flat: the convex hull of the simulator's points, or the disc of a cylinder's end, evenly;
- an edge, a corner or a shape that is not known: a small disc (`Surface.least`).

The centre of pressure is where the line of action of the force meets the surface, so that force and moment are those of the simulator: an ellipse is
centred there; on a flat the pressure is tilted. Shear on an ellipse is Cattaneo and Mindlin's for the tangential force (sliding at the friction
limit), elsewhere proportional to pressure; a torque about the normal adds a rotating shear, proportional to pressure and distance. The weights of
forces on cells preserve sum, mean and variance of their places.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats, isotropic_constants
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, Unsupported
from palpate.pressing.contacts import Contacts
from palpate.pressing.footprints import disc_points, ellipse_points, hull_points, strip_points, tilted
from palpate.sensing.curved import CurvedGrid
from palpate.sensing.grids import AreaGrid, block_means, refined
from palpate.skin import Skin
from palpate.solutions import hertz_ellipse
from palpate.units import is_number

__all__ = ["Pressed", "Surface"]

Index = npt.NDArray[np.intp]
#: Cells are at least FINER times finer than the depth of the taxels: a load on cells of depth/5 gives readings within
#: 0.5 % of exact ones (tests/pressing/test_pressing.py). They are at most FINEST times finer than the cells of the
#: skin.
FINER, FINEST = 5.0, 9
#: Forces that lean further from the normal than acos(LEANING) press from the side.
LEANING = 0.25
#: Points closer to a line than this fraction of its length lie on it.
STRAIGHT = 0.05
#: A contact slides if the friction force reaches this fraction of the limit.
SLIDES = 1.0 - 1e-9
#: Number of worlds whose forces are added to cells together, so that the sums stay in the processor's cache.
BLOCK = 64
#: Candidate numbers of points along a footprint. Each contact uses the smallest for which points lie closer than cells.
COUNTS = np.array([12, 18, 27, 40, 60])


@dataclass(frozen=True)
class _Points:
    """Forces (point, 3) [N] at places (point, 2) [m] in worlds (point,)."""

    world: Index
    place: Floats
    force: Floats


@dataclass(frozen=True)
class Pressed:
    """The loads on a pad in some worlds.

    Attributes
    ----------
    wrench : array (world, 6)
        Net force and moment about the middle of the surface [N, N m] according to the simulator.
    felt : array (world, 6)
        Net force and moment of the traction, which excludes contacts from the side, pulls, and loads beyond the skin's
        surface.
    missed : array (world,) of int
        Number of contacts from the side and of pulls, plus 1 if a part of the load lies beyond the skin's surface.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.pressing import Contacts, Surface
    >>> array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    >>> surface = Surface(pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array))
    >>> ball = Contacts(position=[[0, 0, 0]], force=[[0.2, 0, 1.0]], curvature=100.0 * np.eye(2)[None], friction=[0.6])
    >>> pressed = surface.press(ball)
    >>> pressed.felt[0, :3].round(9).tolist(), pressed.missed.tolist(), pressed.readings().shape
    ([0.2, 0.0, 1.0], [0], (1, 1, 8, 8))
    """

    wrench: Floats
    felt: Floats
    missed: npt.NDArray[np.intp]
    _traction: Floats
    _skin: Skin
    _fine: Skin

    def readings(self, *, rng: np.random.Generator | None = None) -> Any:
        """Return readings (world, channel, *array) as `palpate.Skin.sense` does; ``rng`` adds the noise of the arrays."""
        return self._fine.sense(self._traction, rng=rng)

    @property
    def traction(self) -> Floats:
        """Mean traction (world, component, y, x) [Pa] in the cells of the skin's surface."""
        ratio = self._fine.surface.shape[0] // self._skin.surface.shape[0]
        return block_means(self._traction, ratio, 2)


def _axes(grid: Any) -> list[tuple[Floats, float]]:
    return list(zip(grid.axes, grid.spacings))


class Surface:
    """The surface of a skin that a simulator presses.

    Bodies are rigid, and the pad has the modulus of its surface. The size of a contact is that on a half-space, which
    is too large if a layer is thinner than the contact is wide.

    Parameters
    ----------
    skin : Skin
        A skin for area contact with a free boundary and without creep.
    least : float, optional
        Radius [m] over which edges, corners and shapes that are not known press. Default: half a cell of the surface.

    Raises
    ------
    Unsupported
        A line's skin, a periodic surface, or a pad that creeps.

    Notes
    -----
    Bodies are rigid and the pad has its surface's modulus: the size of a contact is that on a half-space, which is too large on a layer thinner than the
    contact is wide.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.pressing import Contacts, Surface
    >>> array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    >>> surface = Surface(pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array))
    >>> round(surface.modulus)  # E/(1 - nu^2) [Pa]
    259875
    """

    def __init__(self, skin: Skin, *, least: float | None = None) -> None:
        grid = skin.surface
        if not isinstance(grid, AreaGrid):
            raise Unsupported(
                "contacts of a simulator press on an area: give the skin an AreaArray or a ScatteredArray."
            )
        if isinstance(grid, CurvedGrid):
            raise Unsupported(
                "contacts of a simulator press on flat pads, and the surface of this one is curved. Use the pad's flat layer: skin of pad.endless."
            )
        if skin.boundary != "free":
            raise Unsupported('contacts of a simulator need boundary="free": leave boundary out.')
        if isinstance(skin.pad, Viscoelastic):
            raise Unsupported(
                "contacts of a simulator come without a history, and this pad creeps: use skin.without_creep()."
            )
        if least is not None and not (is_number(least) and least > 0):
            raise InvalidInput(f"least must be a positive number of metres; got {least!r}.")
        self.skin = skin
        spacing = max(grid.spacings)
        self.least = 0.5 * spacing if least is None else float(least)
        depth = min(float(a.depth) for a in skin.planes)
        wanted = math.ceil(spacing * FINER / depth * (1 - 1e-9)) if depth > 0 else 3
        self._fine = Skin(skin.pad, skin.planes, surface=refined(grid, min(max(wanted, 1), FINEST)))
        youngs_modulus, ratio = isotropic_constants(skin.pad, 0.0)
        #: Plane-strain modulus E/(1 - nu^2) of the pad's surface [Pa].
        self.modulus = youngs_modulus / (1.0 - ratio**2)

    def press(self, contacts: Contacts, *, worlds: int = 1) -> Pressed:
        """Return the traction of contacts in ``worlds`` worlds.

        Raises
        ------
        InvalidInput
            A contact of a world that there is not.
        """
        world = np.asarray(contacts.world)
        if len(world) and not (int(world.min()) >= 0 and int(world.max()) < worlds):
            raise InvalidInput(
                f"contacts.world goes from {int(world.min())} to {int(world.max())}, and there are {worlds} worlds: pass worlds={int(world.max()) + 1}."
            )
        force = np.asarray(contacts.force)
        pressing = force[:, 2] > LEANING * np.linalg.norm(force, axis=1)
        nothing = (force == 0).all(axis=1)
        points = self._points(contacts.some(pressing))
        traction, outside = self._deposit(points, worlds)
        fine = self._fine.surface
        felt = _felt(traction, fine)
        missed = np.bincount(world[~pressing & ~nothing], minlength=worlds)
        missed = missed + (outside > 1e-9 * np.maximum(np.abs(felt[:, 2]), 1e-300))
        return Pressed(contacts.wrench(worlds), felt, missed, traction, self.skin, self._fine)

    # -- footprints ----------------------------------------------------------------------------------------------------

    def _points(self, contacts: Contacts) -> _Points:
        """Distribute all contact forces over points."""
        if not len(contacts):
            return _Points(np.zeros(0, dtype=np.intp), np.zeros((0, 2)), np.zeros((0, 3)))
        group = _groups(contacts)
        count = int(group.max()) + 1
        g = _Pairs.of(contacts, group, count)
        done = np.zeros(count, dtype=bool)
        parts = []
        smooth = g.known & ~g.sharp & (g.principal[:, 0] > 0)
        a, b = hertz_ellipse(np.where(smooth[:, None], g.principal, 1.0), g.force[:, 2], self.modulus)
        g = replace(g, ellipse=np.stack([a, b], axis=-1))
        kinds: list[tuple[npt.NDArray[np.bool_], Floats, Callable[[_Pairs, int], _Points]]] = [
            ((g.disc[:, 2] > 0) & (~g.sharp | (g.number >= 3)), g.disc[:, 2], self._on_disc),
            (g.wide, g.extent, self._on_hull),
            (g.straight, 0.5 * g.extent, self._on_strip),
            (smooth, a, self._on_ellipse),
            (np.ones(count, dtype=bool), np.full(count, self.least), self._on_little),
        ]
        for these, size, how in kinds:
            # choose the number of points for each contact independently
            many = np.searchsorted(COUNTS[:-1], 1.5 * size / self._cell)
            for step, points in enumerate(COUNTS):
                chosen = np.flatnonzero(these & ~done & (many == step))
                if len(chosen):
                    parts.append(how(g.some(chosen), points))
            done |= these
        return _Points(
            np.concatenate([p.world for p in parts]),
            np.concatenate([p.place for p in parts]),
            np.concatenate([p.force for p in parts]),
        )

    @property
    def _cell(self) -> float:
        return float(min(self._fine.surface.spacings))

    def _on_ellipse(self, g: _Pairs, count: int) -> _Points:
        unit, weights = ellipse_points(count)
        axes = np.maximum(g.ellipse, 0.25 * self._cell)
        away = axes[:, None] * unit
        away = np.einsum("nki,npi->npk", g.axes, away)
        return g.forces(away, np.broadcast_to(weights, away.shape[:2]), slips=True)

    def _on_little(self, g: _Pairs, count: int) -> _Points:
        unit, weights = disc_points(count)
        away = np.broadcast_to(self.least * unit, (len(g.number), *unit.shape))
        return g.forces(away, np.broadcast_to(weights, away.shape[:2]))

    def _on_strip(self, g: _Pairs, count: int) -> _Points:
        half = 0.5 * np.maximum(g.extent, 0.5 * self._cell)
        across = np.einsum("ni,nij,nj->n", g.across, g.curvature, g.across)
        smooth = g.known & ~g.sharp & (across > 0)
        width = np.sqrt(4.0 * g.force[:, 2] / (np.pi * self.modulus * 2.0 * half * np.where(smooth, across, 1.0)))
        # a contact wider than long is not a line
        width = np.where(smooth, np.clip(width, 0.25 * self._cell, half), np.minimum(self.least, half))
        unit, weights = strip_points(count)
        along = np.stack([-g.across[:, 1], g.across[:, 0]], axis=-1)
        points = g.middle[:, None] + (half[:, None] * unit[:, 0])[..., None] * along[:, None]
        points = points + (width[:, None] * unit[:, 1])[..., None] * g.across[:, None]
        return g.on(*tilted(points, np.broadcast_to(weights, points.shape[:2]), g.center))

    def _on_disc(self, g: _Pairs, count: int) -> _Points:
        unit, weights = disc_points(count)
        points = g.disc[:, None, :2] + g.disc[:, 2, None, None] * unit
        return g.on(*tilted(points, np.broadcast_to(weights, points.shape[:2]), g.center))

    def _on_hull(self, g: _Pairs, count: int) -> _Points:
        points, weights = hull_points(g.vertices, min(count, 27))
        return g.on(*tilted(points, weights, g.center))

    # -- cells ---------------------------------------------------------------------------------------------------------

    def _deposit(self, points: _Points, worlds: int) -> tuple[Floats, Floats]:
        """Return the traction (world, component, *fine surface), and the normal force of each world that lies beyond
        the surface.
        """
        grid = self._fine.surface
        cells = math.prod(grid.shape)
        out = np.empty((worlds, 3, cells))
        outside = np.zeros(worlds)
        order = np.argsort(points.world, kind="stable")
        ends = np.searchsorted(points.world, np.arange(0, worlds + BLOCK, BLOCK), sorter=order)
        for block, first in enumerate(range(0, worlds, BLOCK)):
            some = order[ends[block] : ends[block + 1]]
            count = min(BLOCK, worlds - first)
            world, place, force = points.world[some] - first, points.place[some], points.force[some]
            near, weights, inside = [], [], np.ones(len(some), dtype=bool)
            for axis, (x, dx) in enumerate(_axes(grid)):
                s = (place[:, 1 - axis] - x[0]) / dx
                index = np.round(s)
                t = s - index
                inside &= (index >= 1) & (index < len(x) - 1)
                near.append(index)
                # weights have the sum 1, the mean t, and (including the width of a cell, 1/12) the mean square t^2
                spread = t * t - 1.0 / 12.0
                weights.append((0.5 * (spread - t), 1.0 - spread, 0.5 * (spread + t)))
            if not inside.all():
                outside[first : first + count] = np.bincount(world[~inside], force[~inside, 2], minlength=count)
                world, force = world[inside], force[inside]
                near, weights = [n[inside] for n in near], [tuple(v[inside] for v in w) for w in weights]
            corner = world * cells + (near[0].astype(np.intp) - 1) * grid.shape[1] + near[1].astype(np.intp) - 1
            total = np.zeros((3, count * cells))
            for j in range(3):
                for i in range(3):
                    index, weight = corner + (j * grid.shape[1] + i), weights[0][j] * weights[1][i]
                    for component in range(3):
                        total[component] += np.bincount(index, weight * force[:, component], minlength=count * cells)
            out[first : first + count] = total.reshape(3, count, cells).swapaxes(0, 1)
        out /= grid.cell
        return out.reshape(worlds, 3, *grid.shape), outside


def _felt(traction: Floats, grid: Any) -> Floats:
    """Return the net force and moment (world, 6) of a traction."""
    y, x = (axis for axis, _ in _axes(grid))
    force = traction.sum(axis=(-2, -1)) * grid.cell
    along_x, along_y = (
        (traction * x).sum(axis=(-2, -1)) * grid.cell,
        (traction * y[:, None]).sum(axis=(-2, -1)) * grid.cell,
    )
    moment = np.stack([along_y[:, 2], -along_x[:, 2], along_x[:, 1] - along_y[:, 0]], axis=-1)
    return np.concatenate([force, moment], axis=1)


def _groups(contacts: Contacts) -> Index:
    """Return the index of the pair of bodies of each contact. Each smooth contact that is curved in both directions is
    a pair of its own.
    """
    curvature = np.asarray(contacts.curvature)
    least = np.linalg.eigvalsh(curvature)[:, 0]
    alone = np.asarray(contacts.known) & ~np.asarray(contacts.sharp) & (least > 0)
    own = np.where(alone, np.arange(len(contacts)), -1)
    key = np.stack([np.asarray(contacts.world), np.asarray(contacts.body), own], axis=-1)
    return np.unique(key, axis=0, return_inverse=True)[1].ravel()


@dataclass(frozen=True)
class _Pairs:
    """Contacts of pairs of bodies: the wrench of each pair, and the geometry of its points."""

    world: Index
    number: Index
    force: Floats
    center: Floats  # of pressure
    torsion: Floats  # about it
    friction: Floats
    curvature: Floats
    principal: Floats  # curvatures, the lesser first
    axes: Floats  # (pair, axis, principal direction)
    known: npt.NDArray[np.bool_]
    sharp: npt.NDArray[np.bool_]
    disc: Floats
    wide: npt.NDArray[np.bool_]  # the points span an area
    straight: npt.NDArray[np.bool_]  # the points span a line
    middle: Floats
    extent: Floats  # along it
    across: Floats  # unit vector across it
    vertices: Floats
    ellipse: Floats  # semi-axes of a smooth contact

    @classmethod
    def of(cls, contacts: Contacts, group: Index, count: int) -> _Pairs:
        """Sums and extents over the contacts of each pair."""

        def total(values: npt.NDArray[Any]) -> Floats:
            out = np.zeros((count, *values.shape[1:]))
            np.add.at(out, group, values)
            return out

        number = np.bincount(group, minlength=count)
        force = np.asarray(contacts.force)
        place = np.asarray(contacts.position)
        wrench_force = total(force)
        moment = total(np.cross(place, force) + np.asarray(contacts.torque))
        pressure = wrench_force[:, 2]
        center = np.stack([-moment[:, 1], moment[:, 0]], axis=-1) / pressure[:, None]
        torsion = moment[:, 2] - (center[:, 0] * wrench_force[:, 1] - center[:, 1] * wrench_force[:, 0])
        share = 1.0 / number
        curvature = total(np.asarray(contacts.curvature)) * share[:, None, None]
        principal, axes = np.linalg.eigh(curvature)
        principal = np.where(principal > 1e-9 * np.maximum(principal[:, 1:], 1e-300), principal, 0.0)
        known = total(np.asarray(contacts.known).astype(float)) == number
        sharp = total(np.asarray(contacts.sharp).astype(float)) > 0
        length = np.zeros(count)
        np.maximum.at(length, group, np.asarray(contacts.length))
        first = np.zeros(count, dtype=np.intp)
        first[group[::-1]] = np.arange(len(group))[::-1]
        middle = total(place[:, :2]) * share[:, None]
        away = place[:, :2] - middle[group]
        scatter = total(away[:, :, None] * away[:, None, :])
        _, directions = np.linalg.eigh(scatter)
        along, across = directions[:, :, 1], directions[:, :, 0]
        low, high, side = np.full(count, np.inf), np.full(count, -np.inf), np.zeros(count)
        on_line = (away * along[group]).sum(axis=1)
        np.minimum.at(low, group, on_line)
        np.maximum.at(high, group, on_line)
        np.maximum.at(side, group, np.abs((away * across[group]).sum(axis=1)))
        extent = np.maximum(high - low, 0.0)
        wide = (number >= 3) & (2.0 * side > STRAIGHT * extent) & (extent > 0)
        straight = ~wide & (number >= 2) & (extent > 0)
        middle = np.where(straight[:, None], middle + (0.5 * (low + high))[:, None] * along, middle)
        # a single point on a straight line: use the whole line, centred where the force acts
        lying = (number == 1) & known & ~sharp & (length > 0) & (principal[:, 0] == 0) & (principal[:, 1] > 0)
        extent = np.where(lying, length, extent)
        across = np.where(lying[:, None], axes[:, :, 1], across)
        most = int(number[wide].max(initial=1))
        vertices = np.repeat(place[first][:, None, :2], most, axis=1)
        if wide.any():
            rank = np.zeros(len(group), dtype=np.intp)
            order = np.argsort(group, kind="stable")
            rank[order] = np.arange(len(group)) - np.repeat(np.cumsum(number) - number, number)
            kept = rank < most
            vertices[group[kept], rank[kept]] = place[kept, :2]
        return cls(
            world=np.asarray(contacts.world)[first],
            number=number,
            force=wrench_force,
            center=center,
            torsion=torsion,
            friction=total(np.asarray(contacts.friction)) * share,
            curvature=curvature,
            principal=principal,
            axes=axes,
            known=known,
            sharp=sharp,
            disc=np.asarray(contacts.disc)[first],
            wide=wide,
            straight=straight | lying,
            middle=middle,
            extent=extent,
            across=across,
            vertices=vertices,
            ellipse=np.zeros((count, 2)),
        )

    def some(self, chosen: Index) -> _Pairs:
        return _Pairs(**{name: value[chosen] for name, value in vars(self).items()})

    def forces(self, away: Floats, weights: Floats, *, slips: bool = False) -> _Points:
        """Return the forces of a footprint whose points are ``away`` (pair, point, 2) from the centre of pressure."""
        return self.on(self.center[:, None] + away, weights, slips=slips)

    def on(self, points: Floats, weights: Floats, *, slips: bool = False) -> _Points:
        """Return forces at points (pair, point, 2): pressure in proportion to the weights, shear as described in the
        module.
        """
        n, k = weights.shape
        away = points - self.center[:, None]
        pressure = self.force[:, 2]
        shear = self.force[:, :2]
        size = np.linalg.norm(shear, axis=1)
        arm = (weights * (away**2).sum(axis=-1)).sum(axis=1)
        turn = self.torsion / np.maximum(arm, 1e-300)
        turned = np.stack([-away[..., 1], away[..., 0]], axis=-1) * (turn[:, None] * weights)[..., None]
        stick = np.zeros(n)
        if slips:
            limit = self.friction * pressure
            part = size / np.where(limit > 0, limit, 1.0)
            some = (limit > 0) & (part < SLIDES)
            # Mindlin: the shear of sliding, minus that of the stick zone, which has the same shape
            stick = np.where(some, np.cbrt(1.0 - np.minimum(part, 1.0)), 0.0)
        outer = 1.0 / np.maximum(1.0 - stick**3, 1e-12)
        force = np.concatenate(
            [shear[:, None] * (outer[:, None] * weights)[..., None] + turned, (pressure[:, None] * weights)[..., None]],
            axis=-1,
        )
        world, place = np.repeat(self.world, k), points
        stuck = np.flatnonzero((stick > 0) & (size > 0))
        whole = [(world, place.reshape(-1, 2), force.reshape(-1, 3))]
        if len(stuck):
            inner = self.center[stuck, None] + stick[stuck, None, None] * away[stuck]
            less = shear[stuck, None] * ((1.0 - outer[stuck])[:, None] * weights[stuck])[..., None]
            none = np.zeros((len(stuck), k, 1))
            taken = np.concatenate([less, none], axis=-1)
            whole.append((np.repeat(self.world[stuck], k), inner.reshape(-1, 2), taken.reshape(-1, 3)))
        return _Points(*(np.concatenate([part[i] for part in whole]) for i in range(3)))
