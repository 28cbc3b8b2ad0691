"""Build the parts of a `SolidPad`: blocks, domes, bends, and meshes from files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from palpate._extras import require as require_library
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.curved import Chart, CylinderChart, SphereChart
from palpate.sensing.grids import check_length
from palpate.solid.charts import depths, fitted_chart
from palpate.solid.shapes import disc, laid_on, rectangle

__all__ = ["FLAT", "LARGEST", "THROUGH", "bend", "box", "check_mesh", "dome", "from_file", "is_flush"]

Index = npt.NDArray[np.intp]
Made = dict[str, Any]

#: Default number of elements through the thickness: with this number the stress at the base under a ball of 1.5
#: thicknesses is within 2 % of that of a layer (benchmarks/solid.py).
THROUGH = 4
#: Default number for curved pads, whose surfaces have more elements.
THROUGH_CURVED = 3
#: Meshes with more unknowns are refused: a factorisation with 400,000 takes 10 GB.
LARGEST = 400_000
#: A surface that is flat to this fraction of the pad's width counts as a plane.
FLAT = 1e-6
#: Vertices closer than this fraction of the pad's width lie at the same place; elements are at least 1e-4 wide.
COINCIDENT = 1e-7


def box(length: float, width: float, thickness: float, *, base: str, sides: str, element: float | None) -> Made:
    """See `SolidPad.box`."""
    sizes = [check_length(n, v) for n, v in (("length", length), ("width", width), ("thickness", thickness))]
    step = check_length("element", element) if element is not None else sizes[2] / THROUGH
    _check_supports(base, sides)
    counts = [max(1, round(s / step)) for s in sizes]
    _check_size(math.prod(counts), step, f"a box of {' x '.join(map(str, counts))} elements")
    require_library("solid pads", "skfem")
    flat = rectangle(sizes[0], sizes[1], sizes[2], step, counts[2])
    base_facets, contact = _facets(flat, sizes[2], sides)
    return {
        "vertices": np.ascontiguousarray(flat.p.T),
        "elements": np.ascontiguousarray(flat.t.T),
        "base": base_facets,
        "contact": contact,
    }


def dome(
    radius: float, thickness: float, *, height: float | None, base: str, sides: str, element: float | None
) -> Made:
    """See `SolidPad.dome`."""
    r, t = check_length("radius", radius), check_length("thickness", thickness)
    tall = r if height is None else check_length("height", height)
    step = check_length("element", element) if element is not None else t / THROUGH_CURVED
    _check_supports(base, sides)
    if not t < r or not tall < 1.95 * r:
        raise InvalidInput(
            f"thickness must be less than the radius, and height less than 1.95 radii; got radius={r:g}, thickness={t:g}, height={tall:g} m."
        )
    chart = SphereChart(radius=r, reach=math.acos(1.0 - tall / r))
    rim, through = chart.outline[0][1], max(1, round(t / step))
    _check_size(math.pi * (rim / step) ** 2 * through, step, "a dome")
    require_library("solid pads", "skfem")
    return _curved(disc(rim, t, step, through), chart, t, sides, rim)


def bend(
    radius: float, length: float, width: float, thickness: float, *, base: str, sides: str, element: float | None
) -> Made:
    """See `SolidPad.bend`."""
    long, wide, t = (check_length(n, v) for n, v in (("length", length), ("width", width), ("thickness", thickness)))
    r = check_length("radius", radius, sign=True)
    step = check_length("element", element) if element is not None else t / THROUGH_CURVED
    _check_supports(base, sides)
    if r == 0.0 or 0.0 < r <= t:
        raise InvalidInput(
            f"radius must be more than the thickness of {t:g} m outside of a bend, or negative inside of one; got {r:g} m."
        )
    chart = CylinderChart(radius=r, length=long, width=wide)
    through = max(1, round(t / step))
    _check_size(long / step * wide / step * through, step, "a bend")
    require_library("solid pads", "skfem")
    return _curved(rectangle(long, wide, t, step, through), chart, t, sides, None)


def from_file(path: str | Path, *, base: str, contact: str, scale: float, turned: bool) -> Made:
    """See `SolidPad.from_mesh`."""
    require_library("solid pads", "skfem")
    require_library("mesh files", "meshio")
    from skfem import Mesh

    path = Path(path)
    if not path.is_file():
        raise InvalidInput(f"{path}: there is no such file.")
    try:
        mesh = Mesh.load(str(path))
    except Exception as error:  # meshio's readers raise many kinds of exceptions
        raise InvalidInput(f"{path} is no mesh that meshio reads ({error}). Export it as Gmsh's .msh.") from error
    names = dict(mesh.boundaries or {})
    for key, name in (("base", base), ("contact", contact)):
        if name not in names:
            known = ", ".join(sorted(names)) or "none"
            raise InvalidInput(
                f"{path} has no surface named {name!r} ({key}); it has {known}. Name surfaces in the mesher (physical groups of Gmsh)."
            )
    points = check_length("scale", scale) * np.asarray(mesh.doflocs, dtype=np.float64).T
    if turned:
        points = points * np.array([1.0, -1.0, -1.0])
    facets = {n: np.asarray(mesh.facets)[:, np.asarray(names[n], dtype=int)].T for n in (base, contact)}
    points[:, 2] -= float(points[np.unique(facets[contact]), 2].min())
    corners, curved = np.asarray(mesh.t).T, type(mesh).__name__.endswith("2")
    if not curved:  # meshers also write points that belong to no element
        used, corners = np.unique(corners, return_inverse=True)
        corners = corners.reshape(np.asarray(mesh.t).T.shape)
        points, facets = points[used], {n: np.searchsorted(used, f) for n, f in facets.items()}
    chart = fitted_chart(points, facets[contact], FLAT)
    if chart is not None:
        _check_inwards(points, corners, facets[contact], chart)
    return {
        "vertices": points,
        "elements": corners,
        "base": facets[base],
        "contact": facets[contact],
        "chart": chart,
        "curved": curved,
    }


def _curved(flat: Any, chart: Chart, thickness: float, sides: str, rim: float | None) -> Made:
    mesh, _ = laid_on(flat, chart, rim=rim)
    base, contact = _facets(flat, thickness, sides)
    return {
        "vertices": np.ascontiguousarray(mesh.doflocs.T),
        "elements": np.ascontiguousarray(mesh.t.T),
        "base": base,
        "contact": contact,
        "chart": chart,
        "curved": True,
    }


def _facets(flat: Any, thickness: float, sides: str) -> tuple[Index, Index]:
    """Return the corners of the fixed facets, and of those that can be touched, of a mesh in (x, y, depth)."""
    outside = flat.boundary_facets()
    depth = np.asarray(flat.p)[2][np.asarray(flat.facets)[:, outside]]
    upper, lower = (depth < 1e-6 * thickness).all(axis=0), (depth > (1.0 - 1e-6) * thickness).all(axis=0)
    held = lower if sides == "free" else ~upper
    return flat.facets[:, outside[held]].T, flat.facets[:, outside[upper]].T


def _check_supports(base: str, sides: str) -> None:
    if base != "bonded" or sides not in ("free", "bonded"):
        raise InvalidInput(f'base must be "bonded" and sides "free" or "bonded"; got base={base!r}, sides={sides!r}.')


def _check_size(elements: float, step: float, what: str) -> None:
    if 24.0 * elements > LARGEST:
        raise Unsupported(
            f"{what} has about {24.0 * elements:.0f} unknowns, and at most {LARGEST} are served. Give a larger element= (here {step:g} m)."
        )


def _check_inwards(vertices: Floats, elements: Index, contact: Index, chart: Chart) -> None:
    """Raise an error if the mesh lies on the other side of its contact surface."""
    top = contact[np.argmin(vertices[contact, 2].mean(axis=1))]
    middle = vertices[top].mean(axis=0)
    bodies = vertices[elements].mean(axis=1)
    inwards = chart.frames(middle[:1], middle[1:2]).axes[0, 2]
    if float((bodies[cKDTree(bodies).query(middle)[1]] - middle) @ inwards) < 0.0:
        raise InvalidInput(
            "the pad must lie below the surface that is touched, where z > 0: z grows into the pad. Of a mesh whose z points out of it give turned=True."
        )


def check_mesh(mesh: Any, base: Index) -> None:
    """Raise an error if elements of a mesh of scikit-fem overlap or are inverted, share places without sharing nodes,
    or form a body that is not fixed.
    """
    corners, points = np.asarray(mesh.t), np.asarray(mesh.doflocs)[:, : int(np.asarray(mesh.t).max()) + 1].T
    found, apart = np.unique(np.asarray(mesh.t)), float(np.ptp(points, axis=0).max())
    near = cKDTree(points[found]).query_pairs(COINCIDENT * apart, output_type="ndarray")
    if len(near):
        x, y, z = points[found[near[0, 0]]]
        raise InvalidInput(
            f"{len(near)} vertices of the mesh lie where another one does, first at ({x:g}, {y:g}, {z:g}) m: there the pad is cut. Merge the nodes in the mesher "
            "(Gmsh: Coherence Mesh, or RemoveDuplicateNodes)."
        )
    places = np.random.default_rng(0).uniform(0.02, 0.98, (3, 27))
    if len(corners) == 4:  # in the tetrahedron
        places = places[:, places.sum(axis=0) < 1.0]
    volumes = np.asarray(mesh.mapping().detDF(places))
    folded = np.ptp(np.sign(volumes), axis=1) > 0.0
    both = np.asarray(mesh.f2t)
    inner = np.flatnonzero(both[1] >= 0)
    middles = points[corners].mean(axis=0)
    facets = points[np.asarray(mesh.facets)[:, inner]]
    normal = np.cross(facets[1] - facets[0], facets[2] - facets[0])
    sides = [np.einsum("fa,fa->f", middles[both[i, inner]] - facets.mean(axis=0), normal) for i in (0, 1)]
    folded[both[0, inner[np.sign(sides[0]) == np.sign(sides[1])]]] = True
    if folded.any():
        x, y, z = middles[folded.argmax()]
        raise InvalidInput(
            f"{int(folded.sum())} elements of the mesh are inverted or overlap others, first at ({x:g}, {y:g}, {z:g}) m. Mesh the pad again; of elements= of your "
            "own, check the order of their corners (scikit-fem's)."
        )
    pairs = (np.ones(len(inner)), (both[0, inner], both[1, inner]))
    bodies, body = connected_components(coo_array(pairs, shape=(corners.shape[1],) * 2), directed=False)
    fixed = np.isin(corners, np.unique(base)).any(axis=0)
    if len(np.unique(body[fixed])) < bodies:
        raise InvalidInput(
            f"the mesh has {bodies} separate bodies, and {bodies - len(np.unique(body[fixed]))} of them are not on the base: they would float. Leave them out, or name their "
            "glued surfaces as base= too."
        )


def is_flush(pad: Any) -> bool:
    """Return whether all fixed nodes lie one thickness below the surface, along its normals; pressure and shear on
    them then have the axes of the surface.
    """
    if pad.chart is not None and pad.readings_along == "pad":
        return False
    base, top = (pad.vertices[np.unique(facets)] for facets in (pad.base, pad.contact))
    return bool(np.abs(depths(pad.chart, base, top) - pad.thickness).max() < 1e-3 * pad.thickness)
