"""Pads with sides, meshes from files, and pads that make their maps themselves."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.sensing import MatrixMap, SphereChart
from remedies._remedy import Remedy, value

__all__ = ["REMEDIES"]

MATERIAL: dict[str, Any] = {"youngs_modulus": 2e5, "poissons_ratio": 0.48}


def box(**changed: Any) -> pp.SolidPad:
    given: dict[str, Any] = {**MATERIAL, "element": 1e-3, **changed}
    return pp.SolidPad.box(6e-3, 6e-3, 2e-3, **given)


def dome(**changed: Any) -> pp.SolidPad:
    given: dict[str, Any] = {"radius": 5e-3, "thickness": 2e-3, "element": 2e-3, **MATERIAL, **changed}
    return pp.SolidPad.dome(**given)


def bend(**changed: Any) -> pp.SolidPad:
    sizes = {"radius": 6e-3, "length": 8e-3, "width": 6e-3, "thickness": 2e-3, "element": 2e-3}
    return pp.SolidPad.bend(**{**sizes, **MATERIAL, **changed})


def skin(array: Any = None, **given: Any) -> pp.Skin:
    if array is None:
        array = pp.AreaArray(shape=(3, 3), pitch=1e-3, depth="base", channels=["stress_zz"])
    return pp.Skin(box(), array, **given)


def compared(**changed: Any) -> float:
    """The error of the mesh of `box`, by another one."""
    return box().mesh_error(box(**changed), AREA)


def untouched(**given: Any) -> Any:
    """Readings of a skin with no traction on its surface."""
    found = skin(**given)
    return found.sense(np.zeros((3, *found.surface.shape)))


def wide(pitch: float) -> pp.Skin:
    return skin(pp.AreaArray(shape=(3, 3), pitch=pitch, depth="base", channels=["stress_zz"]))


@lru_cache
def cubes() -> pp.SolidPad:
    return box()


def of(**changed: Any) -> pp.SolidPad:
    """The box by its own vertices and facets, with others of them."""
    return dataclasses.replace(cubes(), **changed)


def spoilt() -> Any:
    out = cubes().vertices.copy()
    out[3, 1] = np.nan
    return out


def written(name: str, *, unit: float = 1.0, turned: bool = False, named: str = "glue") -> None:
    """A file of Gmsh with named surfaces, in tetrahedra."""
    import meshio
    from skfem import MeshTet

    mesh = MeshTet.init_tensor(*([np.linspace(-3e-3, 3e-3, 5)] * 2), np.linspace(0.0, 2e-3, 3))
    sign = np.array([1.0, -1.0, -1.0]) if turned else np.ones(3)
    top = mesh.facets[:, mesh.facets_satisfying(lambda x: x[2] < 1e-9, boundaries_only=True)].T
    low = mesh.facets[:, mesh.facets_satisfying(lambda x: x[2] > 2e-3 - 1e-9, boundaries_only=True)].T
    tags = [np.concatenate([np.full(len(top), 1), np.full(len(low), 2)]), np.full(len(mesh.t.T), 3)]
    out = meshio.Mesh(
        mesh.p.T * sign / unit,
        [("triangle", np.concatenate([top, low])), ("tetra", mesh.t.T)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"skin": np.array([1, 2]), named: np.array([2, 2]), "gel": np.array([3, 3])},
    )
    meshio.write(name, out, file_format="gmsh22", binary=False)


def meshes() -> None:
    written("gel.msh")
    written("mm.msh", unit=1e-6)
    written("up.msh", turned=True)
    written("bottom.msh", named="bottom")
    Path("gel.txt").write_text("a gel of 6 x 6 x 2 mm\n", encoding="utf-8")


def tip(reach: float = 1.0) -> None:
    """A fingertip in millimetres, whose z points out of it."""
    from skfem import MeshHex

    from palpate.solid.shapes import disc, laid_on

    chart = SphereChart(radius=10.0, reach=reach)
    rim = chart.outline[0][1]
    flat = disc(rim, 4.0, 2.0, 2)
    curved, places = laid_on(flat, chart, rim=rim)
    corners = curved.doflocs[:, : flat.nvertices] * np.array([[1.0], [-1.0], [-1.0]])
    found = MeshHex(corners, flat.t)
    outside = found.boundary_facets()
    depth = places[: flat.nvertices, 2][found.facets[:, outside]]
    named = {"skin": outside[(depth < 1e-9).all(axis=0)], "core": outside[(depth > 4.0 - 1e-9).all(axis=0)]}
    MeshHex(corners, flat.t, _boundaries=named).save("tip.msh")


def mesh(name: str, **changed: Any) -> pp.SolidPad:
    return pp.SolidPad.from_mesh(name, **{"base": "glue", "contact": "skin", **MATERIAL, **changed})


def solid(**changed: Any) -> Any:
    """The finite elements of the box, with other vertices or elements."""
    return of(**changed).solid


def twice(shift: float) -> dict[str, Any]:
    """The box and a second one beside it, or at its place, that shares no node with it."""
    pad = cubes()
    points = np.concatenate([pad.vertices, pad.vertices + np.array([shift, 0.0, 0.0])])
    return {"vertices": points, "elements": np.concatenate([pad.elements, pad.elements + len(pad.vertices)])}


def both_glued() -> Any:
    given = twice(8e-3)
    return solid(**given, base=np.concatenate([cubes().base, cubes().base + len(cubes().vertices)]))


def kept() -> None:
    """What was worked out for the box."""
    pad = box()
    pp.Skin(pad, pp.AreaArray(shape=(1, 2), pitch=1e-3, depth="base", channels=["stress_zz"])).operator.dense()
    pad.save("gel.npz")


def worked_out_again() -> None:
    pad = box(youngs_modulus=3e5)
    pad.save("gel.npz")
    box(youngs_modulus=3e5).load("gel.npz")


LINE = pp.LineArray(count=3, pitch=1e-3, depth="base", channels=["stress_zz"])
AREA = pp.AreaArray(shape=(3, 3), pitch=1e-3, depth="base", channels=["stress_zz"])
MATRIX = np.arange(24.0).reshape(1, 2, 3, 2, 2)

REMEDIES = [
    value("poissons_ratio of a solid pad must be", lambda nu: box(poissons_ratio=nu), 0.5, 0.499),
    value("a larger element= (here", lambda e: box(element=e), 2e-5, 1e-3),
    value("sensing elements lie beside the pad", wide, 5e-3, 2e-3),
    value("vertices must be a finite array (vertex, 3)", lambda v: of(vertices=v), spoilt(), cubes().vertices),
    value(
        "elements must be tetrahedra (n, 4) or hexahedra (n, 8)",
        lambda v: of(elements=v),
        cubes().elements[:, :6],
        cubes().elements,
    ),
    value(
        "elements of the mesh are inverted or overlap",
        lambda order: solid(elements=cubes().elements[:, order]),
        [0, 1, 4, 2, 3, 5, 7, 6],
        list(range(8)),
    ),
    Remedy("vertices of the mesh lie where another one does", lambda: solid(**twice(0.0)), lambda: solid()),
    Remedy("would float. Leave them out, or name", lambda: solid(**twice(8e-3)), both_glued),
    value("has no facets; name a surface", lambda v: of(base=v), cubes().base[:0], cubes().base),
    value("Give a coarser mesh (element=", lambda n: of(elements=np.tile(cubes().elements, (n, 1))), 300, 1),
    value("of a mesh in millimetres give scale=", lambda s: mesh("mm.msh", scale=s), 1e-2, 1e-6, given=meshes),
    value(
        "the surface that is touched must be the plane z = 0",
        lambda way: of(vertices=cubes().vertices + way),
        [0.0, 0.0, 1e-3],
        [1e-3, 0.0, 0.0],
    ),
    value(
        "Of a mesh whose z points out of it",
        lambda t: mesh("up.msh", turned=t),
        False,
        True,
        given=meshes,
        room="solid.pad",
    ),
    value(
        "Of a mesh whose z points out of it",
        lambda t: mesh("tip.msh", base="core", scale=1e-3, turned=t),
        False,
        True,
        given=tip,
        room="solid.making",
    ),
    value(
        "is too steep to be seen from above",
        lambda t: mesh("tip.msh", base="core", scale=1e-3, turned=t),
        False,
        True,
        given=lambda: tip(np.pi / 2),
    ),
    value("readings_along must be", lambda v: of(readings_along=v), "skin", "surface"),
    value("thickness must be less than the radius", lambda t: dome(thickness=t), 6e-3, 2e-3),
    value("radius must be more than the thickness of", lambda r: bend(radius=r), 1e-3, 6e-3),
    value("does not fit on a cylinder of radius", lambda n: bend(length=n), 40e-3, 8e-3),
    value("reach must be an angle between 0 and pi", lambda a: SphereChart(radius=5e-3, reach=a), 90.0, np.pi / 2),
    value('base must be "bonded" and sides', lambda v: box(sides=v), "glued", "bonded"),
    value("there is no such file", mesh, "none.msh", "gel.msh", given=meshes, room="solid.making"),
    value("is no mesh that meshio reads", mesh, "gel.txt", "gel.msh", given=meshes),
    value("has no surface named", mesh, "bottom.msh", "gel.msh", given=meshes),
    Remedy(
        "was worked out for another solid pad",
        lambda: box(youngs_modulus=3e5).load("gel.npz"),
        worked_out_again,
        given=kept,
    ),
    value(
        "the other pad has another shape", lambda given: compared(**given), {"poissons_ratio": 0.3}, {"element": 0.7e-3}
    ),
    value("both pads have the same mesh", lambda e: compared(element=e), 1e-3, 0.7e-3),
    value("a solid pad needs taxels spread over an area", skin, LINE, AREA),
    value("a matrix (channel, taxel, component, *surface) of", lambda m: MatrixMap(m, (2,)), MATRIX[:, :1], MATRIX),
    value("the matrix of a map must be finite", lambda m: MatrixMap(m, (2,)), np.nan * MATRIX, MATRIX),
    Remedy(
        "differs from place to place, and this method needs a pad that is the same everywhere",
        lambda: skin().reconstruct(np.zeros((1, 3, 3)), method="dft"),
        lambda: skin().reconstruct(np.ones((1, 3, 3)), method="tikhonov"),
    ),
    Remedy(
        "has sides: boundary",
        lambda: untouched(boundary="periodic"),
        lambda: untouched(boundary="free"),
        right=lambda readings: not np.any(np.asarray(readings)),
    ),
]
