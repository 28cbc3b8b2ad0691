"""`SolidPad`: a finite pad from a mesh; its maps are computed by the adjoint and cached."""

from __future__ import annotations

import itertools
import math
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from palpate._extras import require as require_library
from palpate._memory import require
from palpate._threads import cached_property
from palpate.elastic.layers import BondedLayers, Layer
from palpate.elastic.pad import Complexes, Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import AreaArray, Array, ScatteredArray
from palpate.sensing.curved import Chart, CurvedGrid
from palpate.sensing.grids import AreaGrid, Grid, check_length
from palpate.sensing.maps import LinearMap, MatrixMap
from palpate.sensing.surface import default_surface
from palpate.sensing.uncertainty import Uncertainty
from palpate.solid import accuracy, adjoint, files, making
from palpate.solid.charts import PlaneChart, depths
from palpate.solid.making import FLAT, LARGEST
from palpate.solid.maps import ThroughNodes, mirrored_in

if TYPE_CHECKING:
    from palpate.solid.elasticity import Solid

__all__ = ["SolidPad"]

Index = npt.NDArray[np.intp]

#: Largest Poisson's ratio: the condition number grows as 1/(1 - 2 nu). Incompressible gels differ by 0.06 % of their stiffness.
LARGEST_RATIO = 0.4999
#: A sensing element outside the mesh by more than this part of an element is beside the pad: flat facets miss curved surfaces by 0.02.
OUTSIDE = 0.1
#: Pads that are wider or deeper [m] are meshes in millimetres without scale=1e-3: one of 2 mm would be 2 m deep.
WIDEST, DEEPEST = 10.0, 0.5
#: Cells along an axis, at most, that are chosen for a patch; and up to which an endless pad's cells are halved: these are refined by convolution where a
#: contact is small, and the error of cells as wide as a contact would be explained by pressure at the sides (a ball that reads 1.6 N of 1 N then reads 1.0 N).
CELLS, HALVED = 48, 24
#: From this many cells to a node of the surface the adjoint of a map is computed by its factors.
MANY_CELLS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class SolidPad:
    """A pad that ends or bends: an isotropic solid, glued to a rigid base, with a surface that can be touched.

    Make it with `box`, `dome`, `bend` or `from_mesh`. It replaces `HalfSpace` or `BondedLayers`. Finite elements compute its maps, with one solve of
    the adjoint problem for each reading (the effect of a unit load at the sensor on the surface), and the maps are cached. `save` and `load` store
    them for another run. It needs the extra ``palpate[solid]``; if pypardiso is installed, its solver is used.

    Coordinates are those of every pad: z grows into the pad, and the top of the surface that is touched lies at z = 0. On a curved surface the coordinates x and
    y of cells and sensors are those of its chart, which lays it out flat; a sensor's depth is measured along the normal there. Traction has its
    components along two tangents ("x", "y": those of the top, carried along) and along the normal ("z", the pressure). Net force and moment are vectors in
    the pad's own axes.

    Attributes
    ----------
    vertices : array (vertex, 3) [m]
    elements : array (element, 4 or 8)
        Corners of tetrahedra or hexahedra.
    base, contact : array (facet, 3 or 4)
        Corners of the facets that are glued to a rigid base, and of those that can be touched.
    youngs_modulus : float
        [Pa].
    poissons_ratio : float
        0 to 0.4999.
    chart : Chart, optional
        A flat map of a curved contact surface (`palpate.sensing.Chart`); None for a rectangle in the plane z = 0.
    curved : bool
        Whether vertices hold the quadratic nodes of curved elements, in scikit-fem's order (MeshHex2, MeshTet2).
    readings_along : "surface" or "pad"
        Axes of the channels: on a curved pad ``displacement_x`` is along the tangent there, or with "pad" along the pad's own x axis, as a camera sees it.
    accuracy : float, optional
        Relative error of the readings due to the mesh (`compared_with`): the gain's uncertainty of skins that state none.

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
    (8, 8)

    >>> ball = pp.solutions.hertz_point(contact_radius=1e-3, force=0.2).shifted(3e-3, 0.0)  # a millimetre from the side
    >>> float(skin.reconstruct(skin.sense(ball)).force[2]).__round__(1)
    0.2

    Its members as a `Pad` are those of the `endless` layer; the side, the surface and the map are its own.

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
    chart: Chart | None = None
    curved: bool = False
    readings_along: Literal["surface", "pad"] = "surface"
    accuracy: float | None = None

    def __post_init__(self) -> None:
        Uncertainty(gain=self.accuracy)
        require_library("solid pads", "skfem")
        if self.readings_along not in ("surface", "pad"):
            raise InvalidInput(f'readings_along must be "surface" or "pad"; got {self.readings_along!r}.')
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
        deep = float(np.ptp(points[:, 2]))
        if width > WIDEST or deep > DEEPEST:
            raise InvalidInput(
                f"the pad is {width:g} m wide and {deep:g} m deep. Lengths are in metres: of a mesh in millimetres give scale=1e-3."
            )
        if self.chart is not None:
            return
        top = points[np.unique(self.contact), 2]
        if np.abs(top).max() > FLAT * width:
            raise InvalidInput(
                f"without a chart= the surface that is touched must be the plane z = 0; it reaches from z = {top.min():g} to {top.max():g} m. Make pads with "
                "curved surfaces by SolidPad.dome, SolidPad.bend or SolidPad.from_mesh."
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
        """Build a block, centred at x = y = 0.

        Parameters
        ----------
        length, width, thickness : float
            Along x, y and z [m].
        base : "bonded"
            The lower side is glued to what is rigid.
        sides : "free" or "bonded"
            Whether the four sides are free or fixed.
        element : float, optional
            Size of an element [m]; by default a quarter of the thickness.

        Examples
        --------
        >>> import palpate as pp
        >>> gel = pp.SolidPad.box(25.25e-3, 20.75e-3, 4e-3, youngs_modulus=2e5, poissons_ratio=0.48)
        >>> gel.elements.shape, gel.thickness
        ((2100, 8), 0.004)
        """
        made = making.box(length, width, thickness, base=base, sides=sides, element=element)
        return cls(**made, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio)

    @classmethod
    def dome(
        cls,
        radius: float,
        thickness: float,
        *,
        youngs_modulus: float,
        poissons_ratio: float,
        height: float | None = None,
        base: Literal["bonded"] = "bonded",
        sides: Literal["free", "bonded"] = "free",
        element: float | None = None,
        readings_along: Literal["surface", "pad"] = "surface",
    ) -> SolidPad:
        """A fingertip: a shell of one thickness on a rigid round core, whose top lies at x = y = z = 0.

        Coordinates of cells and sensors are those of `palpate.sensing.SphereChart`: the cap laid out flat with its areas kept.

        Parameters
        ----------
        radius, thickness : float
            Radius of the outer surface, and thickness of the shell [m].
        height : float, optional
            From the rim to the top of the outer surface [m]; by default the radius: a half sphere.
        base : "bonded"
            The inner surface is glued to what is rigid.
        sides : "free" or "bonded"
            Whether the rim is free or fixed.
        element : float, optional
            Size of an element [m]; by default a third of the thickness.
        readings_along : "surface" or "pad"
            See the class.

        Examples
        --------
        >>> import palpate as pp
        >>> tip = pp.SolidPad.dome(8e-3, 3e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=3e-3)
        >>> tip.elements.shape, tip.thickness.__round__(6)
        ((65, 8), 0.003)
        """
        made = making.dome(radius, thickness, height=height, base=base, sides=sides, element=element)
        return cls(**made, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio, readings_along=readings_along)

    @classmethod
    def bend(
        cls,
        radius: float,
        length: float,
        width: float,
        thickness: float,
        *,
        youngs_modulus: float,
        poissons_ratio: float,
        base: Literal["bonded"] = "bonded",
        sides: Literal["free", "bonded"] = "free",
        element: float | None = None,
        readings_along: Literal["surface", "pad"] = "surface",
    ) -> SolidPad:
        """Build a sheet bent about an axis along y, on a rigid core.

        Coordinates of cells and sensors are those of `palpate.sensing.CylinderChart`: the sheet unrolled.

        Parameters
        ----------
        radius : float
            Radius of the surface that is touched [m]; positive outside of a bend (a finger), negative inside it (a crook).
        length, width, thickness : float
            Along the arc, along y and through [m].
        base, sides, element, readings_along
            See `dome`.

        Examples
        --------
        >>> import palpate as pp
        >>> crook = pp.SolidPad.bend(-15e-3, 20e-3, 10e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=2e-3)
        >>> crook.elements.shape, crook.thickness.__round__(6)
        ((50, 8), 0.002)
        """
        made = making.bend(radius, length, width, thickness, base=base, sides=sides, element=element)
        return cls(**made, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio, readings_along=readings_along)

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
        readings_along: Literal["surface", "pad"] = "surface",
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
        readings_along : "surface" or "pad"
            See the class.

        The mesh is moved along z until the uppermost point of the contact surface lies at z = 0. A contact surface that is a cap of a sphere around the z axis
        is laid out as `dome` does; any other one by x and y, as it is seen from above.

        Raises
        ------
        InvalidInput
            A file that cannot be read, or has no such surface; a contact surface so steep that it cannot be seen from above.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.from_mesh(  # doctest: +SKIP
        ...     "gel.msh", base="glued", contact="skin", youngs_modulus=2e5, poissons_ratio=0.48, scale=1e-3
        ... )
        """
        made = making.from_file(path, base=base, contact=contact, scale=scale, turned=turned)
        return cls(**made, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio, readings_along=readings_along)

    # -- as every pad --------------------------------------------------------------------------------------------------

    @property
    def thickness(self) -> float:
        """Depth [m] of the deepest point of the rigid base below the surface that is touched."""
        return self._thickness

    @cached_property
    def _thickness(self) -> float:
        base, top = self.vertices[np.unique(self.base)], self.vertices[np.unique(self.contact)]
        return float(depths(self.chart, base, top).max())

    @cached_property
    def endless(self) -> BondedLayers:
        """A layer of the same material and thickness, of infinite extent.

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
        """Fields of one wavevector in the `endless` layer; they decide which loads can be observed."""
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
        """Lowest and highest x, and lowest and highest y, of the surface that can be touched, in its chart [m]."""
        if self.chart is not None:
            return self.chart.outline
        top = self.vertices[np.unique(self.contact)]
        (x0, y0), (x1, y1) = top[:, :2].min(axis=0), top[:, :2].max(axis=0)
        return (float(x0), float(x1)), (float(y0), float(y1))

    def patch(self, planes: Sequence[Array]) -> Grid:
        """The whole surface that can be touched, in cells half as wide as an endless pad would have under these arrays, or as wide where they are many."""
        self._check(planes)
        usual = default_surface(planes, thickness=self.thickness)
        counts, widths, middles = [], [], []
        for (low, high), spacing in zip(reversed(self.outline), usual.spacings):
            count = max(2, round((high - low) / spacing))
            count = min(2 * count if 2 * count <= HALVED else count, CELLS)
            counts.append(count)
            widths.append((high - low) / count)
            middles.append(0.5 * (low + high))
        return self.grid(shape=(counts[0], counts[1]), spacing=(widths[0], widths[1]), center=(middles[1], middles[0]))

    def grid(
        self, *, shape: tuple[int, int], spacing: float | tuple[float, float], center: tuple[float, float] = (0.0, 0.0)
    ) -> AreaGrid:
        """Cells of your own on the surface that can be touched, for ``surface=`` of a skin: a `palpate.AreaGrid`, on a curved one with its chart.

        Examples
        --------
        >>> import palpate as pp
        >>> tip = pp.SolidPad.dome(8e-3, 3e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=3e-3)
        >>> type(tip.grid(shape=(12, 12), spacing=1e-3)).__name__
        'CurvedGrid'
        """
        if self.chart is None:
            return AreaGrid(shape=shape, spacing=spacing, center=center)
        return CurvedGrid(shape=shape, spacing=spacing, center=center, chart=self.chart)

    @cached_property
    def _surface(self) -> Chart:
        return PlaneChart(outline=self.outline) if self.chart is None else self.chart

    def response(self, array: Array, surface: Grid) -> LinearMap:
        """Return the map of an array from traction on the cells of a surface. `InvalidInput` for taxels beside the pad or
        below its base that the array does not mask.
        """
        self._check([array])
        if getattr(surface, "chart", None) != self.chart:
            raise InvalidInput(
                "the surface is not that of this pad, whose contact surface is curved. Leave surface out, or make one of your own cells with pad.grid(shape=, "
                "spacing=)."
            )
        cells, points = math.prod(surface.shape), len(array.points)
        readings = points * len(array.channels)
        top = self._top
        require(
            8.0 * (3.0 * readings * (cells + len(top)) + 6.0 * self.solid.basis.N * min(readings, 128)),
            f"{readings} readings in a solid pad and {cells} surface cells",
            "Give a coarser surface, or fewer positions.",
        )
        fields = adjoint.fields(self, array)
        out = np.zeros((readings, 3, cells))
        loads = list(self._cell_loads(surface))
        for component, axis, load in loads:
            out[:, component] += (load @ fields[:, axis].T).T
        found = out.reshape(points, len(array.channels), 3, *surface.shape).swapaxes(0, 1)
        matrix = np.ascontiguousarray(found)
        if cells < MANY_CELLS * len(top):
            return MatrixMap(matrix, array.shape)
        return ThroughNodes(self, array, surface, matrix, fields, loads)

    def mirrored_in(self, planes: Sequence[Array], surface: Grid) -> bool:
        """Whether the pad is its own mirror image in x = 0 and in y = 0, and so are these arrays and cells.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> cells = pad.grid(shape=(8, 8), spacing=1e-3)
        >>> array = pp.AreaArray(shape=(3, 3), pitch=2e-3, depth="base", channels=["stress_zz"])
        >>> (plane,) = pp.Skin(pad, array).planes
        >>> pad.mirrored_in([plane], cells), pad.mirrored_in([plane], pad.grid(shape=(8, 8), spacing=1e-3, center=(1e-3, 0.0)))
        (True, False)
        """
        return mirrored_in(self, planes, surface)

    def mesh_error(self, other: SolidPad, array: Array, *, radius: float | None = None) -> float:
        """Error of readings by the mesh, for ``Uncertainty(gain=...)``: rms difference to another mesh of the pad, over the rms of the readings.

        Presses of Hertz's pressure and shears like it, of ``radius`` [m] (by default half the thickness), lie over every sensing element.
        `InvalidInput` if the other pad is not of the same shape and material, or has the same mesh.

        Examples
        --------
        >>> import palpate as pp
        >>> pad, finer = (pp.SolidPad.box(6e-3, 6e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=e) for e in (0.7e-3, 0.6e-3))
        >>> array = pp.AreaArray(shape=(2, 2), pitch=2e-3, depth="base", channels=["stress_zz"], noise=20.0)
        >>> 0.0 < pad.mesh_error(finer, array) < 0.1
        True
        """
        return accuracy.mesh_error(self, other, array, radius)

    def compared_with(self, other: SolidPad, array: Array, *, radius: float | None = None) -> SolidPad:
        """This pad with the `accuracy` that `mesh_error` finds, for intervals that hold it; maps that are worked out are kept.

        Examples
        --------
        >>> import palpate as pp
        >>> pad, coarser = (pp.SolidPad.box(6e-3, 6e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=e) for e in (0.7e-3, 1e-3))
        >>> array = pp.AreaArray(shape=(2, 2), pitch=2e-3, depth="base", channels=["stress_zz"], noise=20.0)
        >>> pad = pad.compared_with(coarser, array)
        >>> pad.uncertainty.gain == pad.accuracy > 0.0
        True
        """
        known: SolidPad = files.known_to(self, self.mesh_error(other, array, radius=radius))
        return known

    @property
    def uncertainty(self) -> Uncertainty:
        """The `accuracy`, used if a skin states no uncertainty; if it is not known and the mesh is coarse (`notes`), an
        assumed one.

        Examples
        --------
        >>> import palpate as pp
        >>> fine, coarse = (pp.SolidPad.box(6e-3, 6e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=e) for e in (0.5e-3, 1e-3))
        >>> fine.uncertainty.gain, round(coarse.uncertainty.gain, 2)
        (None, 0.1)
        """
        return Uncertainty(gain=self._assumed if self.accuracy is None else self.accuracy)

    @property
    def notes(self) -> tuple[str, ...]:
        """What results on this pad note: a mesh that is coarse, and whose `accuracy` is not known.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(6e-3, 6e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> pad.notes[0][:44]
        'the mesh has 2 elements through the thicknes'
        """
        if self.accuracy is not None or self._assumed is None:
            return ()
        return (
            f"the mesh has {accuracy.through(self):.2g} elements through the thickness: its readings may be {100 * self._assumed:.0f} % off, stress inside more. "
            "Make the pad of smaller ones (element=), or have its error measured (SolidPad.compared_with)",
        )

    @cached_property
    def _assumed(self) -> float | None:
        return accuracy.assumed(self)

    def save(self, path: str | Path) -> None:
        """Save the maps computed so far for sensors in this pad, and its `accuracy`, for `load` in another run.

        Examples
        --------
        >>> import tempfile
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     pad.save(f"{folder}/gel.npz")
        ...     pad = pad.load(f"{folder}/gel.npz")
        """
        files.save(self, path)

    def load(self, path: str | Path) -> SolidPad:
        """Take what `save` wrote for this very pad; returns the pad with the `accuracy` of the file, if it states none itself.

        `InvalidInput` where the file is of another pad, or damaged.

        Examples
        --------
        >>> import tempfile
        >>> from dataclasses import replace
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     replace(pad, accuracy=0.02).save(f"{folder}/gel.npz")
        ...     pad.load(f"{folder}/gel.npz").accuracy
        0.02
        """
        loaded: SolidPad = files.load(self, path)
        return loaded

    # -- how -----------------------------------------------------------------------------------------------------------

    def _check(self, planes: Sequence[Array]) -> None:
        for array in planes:
            if not isinstance(array, AreaArray | ScatteredArray) or array.dimensions != 2:
                raise Unsupported(
                    f"a solid pad needs taxels spread over an area, and a {type(array).__name__} is a line of taxels. Use AreaArray or ScatteredArray; or keep the line and use a BondedLayers pad."
                )
            (x0, x1), (y0, y1) = self.outline
            slack = 1.0 - 1e-6  # a taxel on the rim
            points = array.points[array.valid.ravel()]
            y, x = ((p - m) * slack + m for p, m in zip(points.T, (0.5 * (y0 + y1), 0.5 * (x0 + x1))))
            beside = ~(self._surface.frames(x, y).stretch > 0.0)
            if beside.any():
                raise InvalidInput(
                    f"{int(beside.sum())} of {len(x)} sensing elements lie beside the pad, whose surface reaches from x = {x0:g} to {x1:g} m and from "
                    f"y = {y0:g} to {y1:g} m. Move the array (center=), or leave them out."
                )
            outside = self.solid.places.find(self._at(x, y, array.depth)[0].T)[2] > OUTSIDE
            if outside.any():
                raise InvalidInput(
                    f"{int(outside.sum())} of {len(x)} sensing elements lie outside the pad: it is not {array.depth:g} m deep below them. Give them in arrays "
                    "of their own depths, or leave them out."
                )

    def _at(self, x: Floats, y: Floats, depth: Any) -> tuple[Floats, Floats]:
        """Positions (*places, 3) below the surface along its normals, and the axes (*places, component, 3) of readings there."""
        frames = self._surface.frames(x, y)
        positions = frames.positions + np.asarray(depth)[..., None] * frames.axes[..., 2, :]
        return positions, frames.axes if self.readings_along == "surface" else np.broadcast_to(
            np.eye(3), frames.axes.shape
        )

    @cached_property
    def solid(self) -> Solid:
        """The finite-element model.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.SolidPad.box(8e-3, 8e-3, 2e-3, youngs_modulus=2e5, poissons_ratio=0.48, element=1e-3)
        >>> int(pad.solid.basis.N)  # nodes
        1445
        """
        from skfem import MeshHex, MeshHex2, MeshTet, MeshTet2

        from palpate.solid.elasticity import Solid

        kinds = (MeshHex2, MeshTet2) if self.curved else (MeshHex, MeshTet)
        kind = kinds[0] if self.elements.shape[1] == 8 else kinds[1]
        mesh = kind(np.ascontiguousarray(self.vertices.T), np.ascontiguousarray(self.elements.T.astype(np.int64)))
        making.check_mesh(mesh, self.base)
        return Solid(mesh, self.youngs_modulus, self.poissons_ratio, self._facets(mesh, self.base))

    @staticmethod
    def _facets(mesh: Any, wanted: Index) -> Index:
        """Return the indices of facets among those of a mesh."""
        known = {tuple(f): i for i, f in enumerate(np.sort(mesh.facets, axis=0).T.tolist())}
        return np.array([known[tuple(sorted(f))] for f in np.asarray(wanted).tolist()], dtype=np.intp)

    @cached_property
    def _top(self) -> Index:
        """Nodes of the surface that can be touched."""
        facets = self._facets(self.solid.mesh, self.contact)
        return np.unique(self.solid.basis.get_dofs(facets).flatten())

    @cached_property
    def _mirrors(self) -> tuple[Index | None, Index | None]:
        """Order in which the nodes of `_top` are their mirror images in x = 0 and in y = 0; None if the solid is not
        symmetric there.
        """
        return adjoint.mirrors(self)

    @cached_property
    def _kept(self) -> OrderedDict[tuple[Any, ...], Floats]:
        """Cached displacements (axis, node of the surface) for a unit of each reading, by its position, channel and aperture."""
        return OrderedDict()

    @cached_property
    def _element(self) -> float:
        """Approximate width of an element [m]."""
        return math.sqrt(np.ptp(self.outline[0]) * np.ptp(self.outline[1]) / len(self.contact))

    @cached_property
    def _flush(self) -> bool:
        return making.is_flush(self)

    def _cell_loads(self, surface: Grid) -> Iterator[tuple[int, int, Any]]:
        """Yield component of traction, axis of the pad, and sparse forces on nodes for unit traction in a cell (cell, node of the surface) [m^2]."""
        import scipy.sparse

        element = self._element
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
        frames = self._surface.frames(x, y)
        weight = weight * frames.stretch
        on = np.flatnonzero(weight > 0.0)
        if not len(on):
            return
        weight, cell, turn = weight[on], cell[on], frames.axes[on]
        count = math.prod(surface.shape)
        if self.chart is not None:  # on the rim, the weights of net forces
            held_there = np.bincount(cell, weight, count)
            weight = weight * (surface.areas.ravel() / np.where(held_there > 0.0, held_there, 1.0))[cell]
        place = np.full(self.solid.basis.N, -1, dtype=np.intp)
        place[self._top] = np.arange(len(self._top))
        held, fields = self.solid.at(frames.positions[on].T)
        nodes, values = place[held.T], fields.displacement("x")[..., 0]  # (point, local)
        rows, there = np.broadcast_to(cell[:, None], nodes.shape), nodes >= 0
        made: dict[bytes, Any] = {}
        for component, axis in itertools.product(range(3), range(3)):
            part = weight * turn[:, component, axis]
            if not part.any():
                continue
            key = part.tobytes()
            if key not in made:
                load = values * part[:, None]
                entries = (load[there], (rows[there], nodes[there]))
                made[key] = scipy.sparse.coo_array(entries, (count, len(self._top))).tocsr()
            yield component, axis, made[key]
