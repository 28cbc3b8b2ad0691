"""`SolidPad`: a pad with sides, from a mesh; its maps are worked out by the adjoint and kept."""

from __future__ import annotations

import itertools
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from palpate._extras import require as require_library
from palpate._memory import require
from palpate._recall import Recall, digest, read, write
from palpate._threads import cached_property
from palpate.elastic.channels import find_channel
from palpate.elastic.layers import BondedLayers, Layer
from palpate.elastic.pad import Complexes, Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import AreaArray, Array, ScatteredArray
from palpate.sensing.grids import AreaGrid, Grid, check_length
from palpate.sensing.kernels import aperture_rule
from palpate.sensing.maps import LinearMap, MatrixMap
from palpate.sensing.surface import default_surface

if TYPE_CHECKING:
    from palpate.solid.elasticity import Solid

__all__ = ["SolidPad"]

Index = npt.NDArray[np.intp]

#: Largest Poisson's ratio: the matrix's condition grows as 1/(1 - 2 nu), and incompressible gels differ from this one by 0.06 % of their stiffness.
LARGEST_RATIO = 0.4999
#: Elements through the thickness where nothing is said: the base's stress under a ball of 1.5 thicknesses is then within 2 % of a layer's
#: (benchmarks/solid.py).
THROUGH = 4
#: Unknowns from which a mesh is refused: the factor of 400,000 takes 10 GB.
LARGEST = 400_000
#: A surface flatter than this part of the pad's width is a plane.
FLAT = 1e-6
#: What is kept of fields at the surface [bytes].
KEPT = 2_000_000_000
#: Cells along an axis, at most, that are chosen for a patch.
CELLS = 48


@dataclass(frozen=True, kw_only=True, eq=False)
class SolidPad:
    """A pad that ends: an isotropic solid, glued to a rigid base, whose plane upper surface can be touched.

    Make it with `box` or `from_mesh`. It goes where `HalfSpace` and `BondedLayers` go; what reads in it is worked out by finite elements, by one
    solve for each reading (of the adjoint problem: what a unit load at the sensor does to the surface), and kept. `save` and `load` keep it for
    another run. It needs the extra ``palpate[solid]``; where pypardiso is installed, its solver is used.

    Coordinates are those of every pad: z = 0 is the surface that is touched and z grows into the pad, x and y as the array has them.

    Attributes
    ----------
    vertices : array (vertex, 3) [m]
    elements : array (element, 4 or 8)
        Corners of tetrahedra or hexahedra.
    base, contact : array (facet, 3 or 4)
        Corners of the facets that are glued to what is rigid, and of those that can be touched.
    youngs_modulus : float
        [Pa].
    poissons_ratio : float
        0 to 0.4999.

    Raises
    ------
    InvalidInput
        A number out of range; a contact surface that is not plane, not at z = 0, or above which the solid lies.
    Unsupported
        scikit-fem is not installed, or the mesh has too many unknowns.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
    >>> array = pp.AreaArray(shape=(3, 3), pitch=2e-3, depth="base", channels=["stress_zz"], noise=20.0)
    >>> skin = pp.Skin(pad, array)
    >>> skin.surface.shape  # the whole upper side, and no more
    (4, 4)

    >>> ball = pp.solutions.hertz_point(contact_radius=1e-3, force=0.2).shifted(3e-3, 0.0)  # a millimetre from the side
    >>> float(skin.reconstruct(skin.sense(ball)).force[2]).__round__(1)
    0.2

    What it tells as every pad does is of the `endless` layer; its own are the side, the surface and the map.

    >>> pad.thickness, pad.outline
    (0.002, ((-0.004, 0.004), (-0.004, 0.004)))
    >>> pad.mean_compliance(0.0).shape, pad.compliance(0.0).shape
    ((3, 3), (6, 6))
    >>> import numpy as np
    >>> pad.states(np.array([100.0]), np.array([[1.0, 0.0]]), 2e-3).shape == pad.endless.states(np.array([100.0]), np.array([[1.0, 0.0]]), 2e-3).shape
    True
    >>> (plane,) = skin.planes  # depth="base" is a number there
    >>> surface = pad.patch([plane])
    >>> map = pad.response(plane, surface)
    >>> map.forward(np.ones((3, *surface.shape))).shape  # (channel, *array)
    (1, 3, 3)
    """

    vertices: Floats
    elements: Index
    base: Index
    contact: Index
    youngs_modulus: float
    poissons_ratio: float

    def __post_init__(self) -> None:
        require_library("solid pads", "skfem")
        check_length("youngs_modulus", self.youngs_modulus)
        nu = self.poissons_ratio
        if isinstance(nu, bool) or not isinstance(nu, int | float) or not 0.0 <= nu <= LARGEST_RATIO:
            raise InvalidInput(
                f"poissons_ratio of a solid pad must be 0 to {LARGEST_RATIO}; got {nu!r}. For an incompressible gel give 0.499."
            )
        points = np.asarray(self.vertices, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise InvalidInput(f"vertices must be a finite array (vertex, 3) [m]; got shape {points.shape}.")
        corners = np.asarray(self.elements)
        if corners.ndim != 2 or corners.shape[1] not in (4, 8) or not len(corners):
            raise InvalidInput(f"elements must be tetrahedra (n, 4) or hexahedra (n, 8); got shape {corners.shape}.")
        for name in ("base", "contact"):
            if not len(getattr(self, name)):
                raise InvalidInput(f"{name} has no facets; name a surface of the mesh that has some.")
        unknowns = 3 * len(corners) * (8 if corners.shape[1] == 8 else 1.5)  # about: quadratic nodes
        if unknowns > LARGEST:
            raise Unsupported(
                f"{len(corners)} elements have about {unknowns:.0f} unknowns, and at most {LARGEST} are served. Give a coarser mesh (element= of "
                "SolidPad.box)."
            )
        width = float(np.ptp(points, axis=0).max())
        if width > 10.0:
            raise InvalidInput(
                f"the pad is {width:g} m wide. Lengths are in metres: of a mesh in millimetres give scale=1e-3."
            )
        top = points[np.unique(self.contact), 2]
        if np.abs(top).max() > FLAT * width:
            raise InvalidInput(
                f"the surface that is touched must be the plane z = 0; it reaches from z = {top.min():g} to {top.max():g} m. Curved surfaces are not "
                "served; of a plane one move the mesh (SolidPad.from_mesh does so)."
            )
        if float(points[:, 2].max()) <= 0.0 or float(points[:, 2].min()) < -FLAT * width:
            raise InvalidInput(
                "the pad must lie below the surface that is touched, where z > 0: z grows into the pad. Of a mesh whose z points out of it give turned=True."
            )

    # -- ways to make it -----------------------------------------------------------------------------------------------

    @classmethod
    def box(
        cls,
        length: float,
        width: float,
        thickness: float,
        *,
        youngs_modulus: float,
        poissons_ratio: float,
        base: Literal["bonded"] = "bonded",
        sides: Literal["free", "bonded"] = "free",
        element: float | None = None,
    ) -> SolidPad:
        """A block, centred at x = y = 0.

        Parameters
        ----------
        length, width, thickness : float
            Along x, y and z [m].
        base : "bonded"
            The lower side is glued to what is rigid.
        sides : "free" or "bonded"
            What holds the four sides.
        element : float, optional
            Size of an element [m]; by default a quarter of the thickness.

        Examples
        --------
        >>> import palpate as pp
        >>> gel = pp.SolidPad.box(25.25e-3, 20.75e-3, 4e-3, youngs_modulus=2e5, poissons_ratio=0.48)
        >>> gel.elements.shape, gel.thickness
        ((2100, 8), 0.004)
        """
        sizes = [check_length(n, v) for n, v in (("length", length), ("width", width), ("thickness", thickness))]
        step = check_length("element", element) if element is not None else sizes[2] / THROUGH
        if base != "bonded" or sides not in ("free", "bonded"):
            raise InvalidInput(
                f'base must be "bonded" and sides "free" or "bonded"; got base={base!r}, sides={sides!r}.'
            )
        counts = [max(1, round(s / step)) for s in sizes]
        if 24.0 * math.prod(counts) > LARGEST:
            raise Unsupported(
                f"a box of {' x '.join(map(str, counts))} elements has about {24 * math.prod(counts)} unknowns, and at most {LARGEST} are served. Give "
                f"a larger element= (here {step:g} m)."
            )
        require_library("solid pads", "skfem")
        from skfem import MeshHex

        axes = [np.linspace(-0.5 * s, 0.5 * s, n + 1) for s, n in zip(sizes[:2], counts)]
        mesh = MeshHex.init_tensor(*axes, np.linspace(0.0, sizes[2], counts[2] + 1))
        tiny = 1e-6 * sizes[2] / counts[2]

        def held(x: Floats) -> npt.NDArray[np.bool_]:
            bottom = x[2] > sizes[2] - tiny
            if sides == "free":
                return bottom
            return bottom | (np.abs(x[0]) > 0.5 * sizes[0] - tiny) | (np.abs(x[1]) > 0.5 * sizes[1] - tiny)

        return cls(
            vertices=np.ascontiguousarray(mesh.p.T),
            elements=np.ascontiguousarray(mesh.t.T),
            base=mesh.facets[:, mesh.facets_satisfying(held, boundaries_only=True)].T,
            contact=mesh.facets[:, mesh.facets_satisfying(lambda x: x[2] < tiny, boundaries_only=True)].T,
            youngs_modulus=youngs_modulus,
            poissons_ratio=poissons_ratio,
        )

    @classmethod
    def from_mesh(
        cls,
        path: str | Path,
        *,
        base: str,
        contact: str,
        youngs_modulus: float,
        poissons_ratio: float,
        scale: float = 1.0,
        turned: bool = False,
    ) -> SolidPad:
        """A mesh of tetrahedra or hexahedra from a file that meshio reads (Gmsh's .msh, Abaqus' .inp, VTK and others).

        Parameters
        ----------
        base, contact : str
            Names of surfaces in the file (physical groups of Gmsh): what is glued to something rigid, and what can be touched.
        scale : float
            Metres to a unit of the file: 1e-3 for millimetres.
        turned : bool
            Turn the mesh by 180 degrees about its x axis: for files whose z points out of the pad.

        Raises
        ------
        InvalidInput
            A file that cannot be read, or has no such surface; a contact surface that is not plane.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.from_mesh(  # doctest: +SKIP
        ...     "gel.msh", base="glued", contact="skin", youngs_modulus=2e5, poissons_ratio=0.48, scale=1e-3
        ... )
        """
        require_library("solid pads", "skfem")
        require_library("mesh files", "meshio")
        from skfem import Mesh

        path = Path(path)
        if not path.is_file():
            raise InvalidInput(f"{path}: there is no such file.")
        try:
            mesh = Mesh.load(str(path))
        except Exception as error:  # meshio's readers raise what they like
            raise InvalidInput(f"{path} is no mesh that meshio reads ({error}). Export it as Gmsh's .msh.") from error
        names = dict(mesh.boundaries or {})
        for key, name in (("base", base), ("contact", contact)):
            if name not in names:
                known = ", ".join(sorted(names)) or "none"
                raise InvalidInput(
                    f"{path} has no surface named {name!r} ({key}); it has {known}. Name surfaces in the mesher (physical groups of Gmsh)."
                )
        points = check_length("scale", scale) * np.asarray(mesh.p, dtype=np.float64).T
        if turned:
            points = points * np.array([1.0, -1.0, -1.0])
        facets = {n: np.asarray(mesh.facets)[:, np.asarray(names[n], dtype=int)].T for n in (base, contact)}
        points[:, 2] -= float(points[np.unique(facets[contact]), 2].mean())
        corners = np.asarray(mesh.t).T
        return cls(
            vertices=points,
            elements=corners,
            base=facets[base],
            contact=facets[contact],
            youngs_modulus=youngs_modulus,
            poissons_ratio=poissons_ratio,
        )

    # -- as every pad --------------------------------------------------------------------------------------------------

    @property
    def thickness(self) -> float:
        """Depth of the deepest point of what is rigid [m]."""
        return float(self.vertices[np.unique(self.base), 2].max())

    @cached_property
    def endless(self) -> BondedLayers:
        """The layer of the same material and thickness that goes on for ever.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> pad.endless.thickness
        0.002
        """
        layer = Layer(thickness=self.thickness, youngs_modulus=self.youngs_modulus, poissons_ratio=self.poissons_ratio)
        return BondedLayers([layer])

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Fields of one wavevector in the `endless` layer, which tell what can be observed."""
        return self.endless.states(wavenumber, direction, depth)

    def compliance(self, depth: float) -> Floats:
        """Compliance of the material (6, 6) [1/Pa]; `InvalidInput` below the base."""
        return self.endless.compliance(depth)

    def mean_compliance(self, depth: float) -> Floats | None:
        """Displacement per mean traction of the `endless` layer (3, 3) [m/Pa]."""
        return self.endless.mean_compliance(depth)

    # -- as a pad that makes its maps ----------------------------------------------------------------------------------

    @property
    def outline(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest x, and lowest and highest y, of the surface that can be touched [m]."""
        top = self.vertices[np.unique(self.contact)]
        (x0, y0), (x1, y1) = top[:, :2].min(axis=0), top[:, :2].max(axis=0)
        return (float(x0), float(x1)), (float(y0), float(y1))

    def patch(self, planes: Sequence[Array]) -> Grid:
        """The whole surface that can be touched, in cells about as wide as an endless pad would have under these arrays."""
        self._check(planes)
        usual = default_surface(planes, thickness=self.thickness)
        counts, widths, middles = [], [], []
        for (low, high), spacing in zip(reversed(self.outline), usual.spacings):
            count = min(max(2, round((high - low) / spacing)), CELLS)
            counts.append(count)
            widths.append((high - low) / count)
            middles.append(0.5 * (low + high))
        return AreaGrid(shape=(counts[0], counts[1]), spacing=(widths[0], widths[1]), center=(middles[1], middles[0]))

    def response(self, array: Array, surface: Grid) -> LinearMap:
        """The map of an array, from traction on the cells of a surface; what lies beside the pad reads nothing."""
        self._check([array])
        cells, points = math.prod(surface.shape), len(array.points)
        readings = points * len(array.channels)
        top = self._top
        require(
            8.0 * (3.0 * readings * (cells + len(top)) + 6.0 * self.solid.basis.N * min(readings, 128)),
            f"{readings} readings in a solid pad and {cells} surface cells",
            "Give a coarser surface, or fewer positions.",
        )
        fields = self._fields(array)
        cell_loads = self._cell_loads(surface)
        out = np.empty((readings, 3, cells))
        for component in range(3):
            out[:, component] = (cell_loads @ fields[:, component].T).T
        found = out.reshape(points, len(array.channels), 3, *surface.shape).swapaxes(0, 1)
        return MatrixMap(np.ascontiguousarray(found), array.shape)

    def save(self, path: str | Path) -> None:
        """Write what is worked out by now for sensors in this pad, for `load` in another run.

        Examples
        --------
        >>> import tempfile
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     pad.save(f"{folder}/gel.npz")
        ...     pad.load(f"{folder}/gel.npz")
        """
        keys = list(self._kept)
        places = np.array([k[:3] for k in keys]).reshape(-1, 3)
        widths = np.array([k[4:] for k in keys]).reshape(-1, 2)
        names = np.array([k[3].encode() for k in keys], dtype="S64")
        fields = np.array(list(self._kept.values())).reshape(len(keys), 3, len(self._top))
        write(str(path), {"fields": (places, names, widths, fields)}, {"pad": self._digest})

    def load(self, path: str | Path) -> None:
        """Take what `save` wrote for this very pad; `InvalidInput` where it is of another, or damaged.

        Examples
        --------
        >>> import tempfile
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     pad.save(f"{folder}/gel.npz")
        ...     pad.load(f"{folder}/gel.npz")
        """

        def check(about: Any) -> None:
            if about.get("pad") != self._digest:
                raise InvalidInput(
                    f"{path} was worked out for another solid pad: its shape, mesh or material differs. Work it out again (SolidPad.save)."
                )

        found: Recall = read(path, check)
        places, names, widths, fields = found.entries["fields"]
        for place, name, width, field in zip(places, names, widths, fields):
            self._kept[(*map(float, place), bytes(name).decode(), *map(float, width))] = np.asarray(field)

    # -- how -----------------------------------------------------------------------------------------------------------

    def _check(self, planes: Sequence[Array]) -> None:
        for array in planes:
            if not isinstance(array, AreaArray | ScatteredArray) or array.dimensions != 2:
                raise Unsupported(
                    f"a solid pad is touched on an area, and a {type(array).__name__} is in line contact. Use AreaArray or ScatteredArray, or BondedLayers."
                )
            (x0, x1), (y0, y1) = self.outline
            points = array.points  # (y, x)
            slack = 1e-6 * (x1 - x0)
            beside = (points[:, 1] < x0 - slack) | (points[:, 1] > x1 + slack)
            beside |= (points[:, 0] < y0 - slack) | (points[:, 0] > y1 + slack)
            if beside.any():
                raise InvalidInput(
                    f"{int(beside.sum())} of {len(points)} sensing elements lie beside the pad, which reaches from x = {x0:g} to {x1:g} m and from "
                    f"y = {y0:g} to {y1:g} m. Move the array (center=), or leave them out."
                )

    @cached_property
    def _digest(self) -> str:
        return digest(self) or ""

    @cached_property
    def solid(self) -> Solid:
        """The finite elements.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> pad.solid.basis.N  # nodes
        1445
        """
        from skfem import MeshHex, MeshTet

        from palpate.solid.elasticity import Solid

        kind = MeshHex if self.elements.shape[1] == 8 else MeshTet
        mesh = kind(np.ascontiguousarray(self.vertices.T), np.ascontiguousarray(self.elements.T.astype(np.int64)))
        return Solid(mesh, self.youngs_modulus, self.poissons_ratio, self._facets(mesh, self.base))

    @staticmethod
    def _facets(mesh: Any, wanted: Index) -> Index:
        """Places of facets among those of a mesh."""
        known = {tuple(f): i for i, f in enumerate(np.sort(mesh.facets, axis=0).T.tolist())}
        return np.array([known[tuple(sorted(f))] for f in np.asarray(wanted).tolist()], dtype=np.intp)

    @cached_property
    def _top(self) -> Index:
        """Nodes of the surface that can be touched."""
        facets = self._facets(self.solid.mesh, self.contact)
        return np.unique(self.solid.basis.get_dofs(facets).flatten())

    @cached_property
    def _kept(self) -> OrderedDict[tuple[Any, ...], Floats]:
        """Displacement (axis, node of the surface) for a unit of each reading, by where it is, its channel and its aperture."""
        return OrderedDict()

    @cached_property
    def _beside(self) -> float:
        """How far beside a point its neighbours are looked up [m]: stress jumps where elements meet, and the mean of these is closer than each."""
        return 1e-6 * float(self.thickness) / THROUGH

    def _inside(self, points: Floats) -> Floats:
        """Points (axis, n), where they lie on the rim a little inside it: an element is to be found for each."""
        (x0, x1), (y0, y1) = self.outline
        tiny = 1e-9 * (x1 - x0)
        low = np.array([x0 + tiny, y0 + tiny, tiny])[:, None]
        high = np.array([x1 - tiny, y1 - tiny, float(self.vertices[:, 2].max()) - tiny])[:, None]
        return np.clip(points, low, high)

    def _fields(self, array: Array) -> Floats:
        """(reading, axis, node of the surface): taxel by taxel, channel by channel."""
        spacing = float(np.sqrt(np.ptp(self.outline[0]) * np.ptp(self.outline[1]))) / 100.0
        rules = [aperture_rule(w, array.depth, spacing, None) for w in array.apertures]
        widths = tuple(float(w) for w in array.apertures)
        keys = [(float(x), float(y), float(array.depth), c, *widths) for y, x in array.points for c in array.channels]
        missing = list(dict.fromkeys(k for k in keys if k not in self._kept))
        step = 128
        for start in range(0, len(missing), step):
            some = missing[start : start + step]
            loads = np.zeros((3 * self.solid.basis.N, len(some)))
            around = [(d * self._beside, 0.5) for d in (-1.0, 1.0)]
            nodes = list(itertools.product(zip(*rules[0]), zip(*rules[1]), around, around, around))
            weights = np.array([math.prod(w for _, w in node) for node in nodes])
            moved = np.array([[b + e, a + d, f] for (a, _), (b, _), (d, _), (e, _), (f, _) in nodes])
            for name in dict.fromkeys(str(k[3]) for k in some):
                columns = np.array([i for i, k in enumerate(some) if k[3] == name])
                middles = np.array([some[i][:3] for i in columns])
                held, fields = self.solid.at(self._inside((middles[:, None] + moved).reshape(-1, 3).T))
                rows = np.asarray(find_channel(name).read(fields)) * np.tile(weights, len(columns))[:, None, None]
                unknowns = 3 * held.T[:, :, None] + np.arange(3)
                np.add.at(loads, (unknowns, np.repeat(columns, len(weights))[:, None, None]), rows)
            found = self.solid.solve(loads).reshape(-1, 3, len(some))[self._top]
            for column, key in enumerate(some):
                self._kept[key] = np.ascontiguousarray(found[:, :, column].T)
        out = np.stack([self._kept[k] for k in keys])
        while len(self._kept) > 1 and len(self._kept) * out[0].nbytes > KEPT:
            self._kept.popitem(last=False)
        return out

    def _cell_loads(self, surface: Grid) -> Any:
        """Sparse (cell, node of the surface): force on each node of unit traction in a cell [m^2]."""
        import scipy.sparse

        element = math.sqrt(np.ptp(self.outline[0]) * np.ptp(self.outline[1]) / len(self.contact))
        axes, parts = [], []
        for x, dx in zip(surface.axes, surface.spacings):
            pieces = math.ceil(dx / element - 1e-9)
            # cells much smaller than an element, of contacts in closed form, are many, and the field is even in them
            t, w = np.polynomial.legendre.leggauss(1 if dx < element / 3 else 2 if dx < element else 3)
            pieces += pieces > 1  # edges of elements lie in them
            offsets = ((np.arange(pieces)[:, None] + 0.5 + 0.5 * t) / pieces - 0.5).ravel() * dx
            axes.append((x[:, None] + offsets).ravel())
            parts.append(np.tile(np.tile(0.5 * w / pieces, pieces) * dx, len(x)))
        y, x = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
        weight = np.outer(parts[0], parts[1]).ravel()
        per = [len(a) // n for a, n in zip(axes, surface.shape)]
        row, column = (np.repeat(np.arange(n), p) for n, p in zip(surface.shape, per))
        cell = (row[:, None] * surface.shape[1] + column).ravel()
        (x0, x1), (y0, y1) = self.outline
        on = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        shape = (math.prod(surface.shape), len(self._top))
        if not on.any():
            return scipy.sparse.csr_array(shape)
        place = np.full(self.solid.basis.N, -1, dtype=np.intp)
        place[self._top] = np.arange(len(self._top))
        held, fields = self.solid.at(self._inside(np.stack([x[on], y[on], np.zeros(int(on.sum()))])))
        values = fields.displacement("x")[..., 0] * weight[on][:, None]  # (point, local)
        nodes = place[held.T]
        rows = np.broadcast_to(cell[on][:, None], nodes.shape)
        there = nodes >= 0
        return scipy.sparse.coo_array((values[there], (rows[there], nodes[there])), shape).tocsr()
