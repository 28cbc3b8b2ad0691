"""Deflection of micropillars by finite elements against the formula of `Pillar`.

A post on a block of the same material, 8 diameters wide and 4 deep, held at its sides and bottom; quadratic tetrahedra, a force spread over the head. The round section is a polygon of twenty sides; the formula takes
the diameter of its area. Finite elements are too stiff, and less so the finer they are: the formula lies above them, and one without tilt below.

    python benchmarks/pillars.py --markdown docs/_generated/pillars.md       # two minutes
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import scipy.spatial
from skfem import Basis, ElementTetP2, ElementVector, FacetBasis, LinearForm, MeshTet, asm
from skfem.models.elasticity import lame_parameters, linear_elasticity

from palpate.microscopy import Pillar

RADIUS, WIDE, DEEP, SIDES = 0.5, 4.0, 4.0, 20


def ring(radius: float, count: int, turn: float = 0.0) -> np.ndarray:
    angle = 2 * np.pi * (np.arange(count) + turn) / count
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def mesh_of(height: float, *, fine: bool) -> MeshTet:
    """Prisms over Delaunay's triangles of rings, each cut into three tetrahedra."""
    inner = ((0.35, 7), (0.7, 14), (1.0, SIDES), (1.2, SIDES)) if fine else ((0.5, 7), (1.0, SIDES))
    rings = [np.zeros((1, 2)), *(ring(part * RADIUS, count) for part, count in inner)]
    radius = 1.5 * RADIUS
    while radius < WIDE:
        rings.append(ring(radius, SIDES, 0.5 * len(rings)))
        radius *= 1.5
    plane = np.concatenate([*rings, ring(WIDE, SIDES)])
    triangles = np.sort(scipy.spatial.Delaunay(plane).simplices, axis=1)
    in_post = np.hypot(*plane[triangles].mean(axis=1).T) < RADIUS
    base = (
        [0, 0.05, 0.12, 0.22, 0.37, 0.6, 0.95, 1.5, 2.4, DEEP] if fine else [0, 0.12, 0.27, 0.5, 0.85, 1.4, 2.3, DEEP]
    )
    post = (
        [0.05, 0.12, *np.linspace(0.25, height, int(4 * height))]
        if fine
        else list(np.linspace(0, height, int(4 * height) + 1)[1:])
    )
    layers = np.array([*(-z for z in reversed(base)), *post])
    number, points, tetrahedra = {}, [], []
    for k, z in enumerate(layers):
        for n in range(len(plane)) if z <= 0 else np.unique(triangles[in_post]):
            number[int(n), k] = len(points)
            points.append([*plane[n], z])
    for k in range(len(layers) - 1):
        for a, b, c in triangles if layers[k + 1] <= 0 else triangles[in_post]:
            low, high = ([number[int(n), j] for n in (a, b, c)] for j in (k, k + 1))
            tetrahedra += [[*low, high[2]], [low[0], low[1], high[1], high[2]], [low[0], *high]]
    return MeshTet(np.array(points).T.copy(), np.array(tetrahedra).T.copy())


def compliance(height: float, ratio: float, *, fine: bool) -> tuple[float, float]:
    """Mean deflection of the head for a force and a modulus of one, and the area of the section."""
    mesh = mesh_of(height, fine=fine)
    element = ElementVector(ElementTetP2())
    basis = Basis(mesh, element, intorder=2)
    stiffness = asm(linear_elasticity(*lame_parameters(1.0, ratio)), basis)
    head = FacetBasis(mesh, element, facets=mesh.facets_satisfying(lambda x: np.isclose(x[2], height)), intorder=3)
    area = float(head.dx.sum())
    load = asm(LinearForm(lambda v, w: v[0]), head) / area
    held = basis.get_dofs(lambda x: np.isclose(x[2], -DEEP) | (np.hypot(x[0], x[1]) > 0.99 * WIDE)).all()
    free = np.setdiff1d(np.arange(stiffness.shape[0]), held)
    part = stiffness[free][:, free]
    scale = scipy.sparse.diags_array(1.0 / part.diagonal())
    moved, failed = scipy.sparse.linalg.cg(part, load[free], rtol=1e-6, maxiter=6000, M=scale)
    if failed:
        raise RuntimeError("the finite elements did not converge")
    return float(load[free] @ moved), area


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--markdown", type=Path)
    given = parser.parse_args()
    lines = [
        "| height [diameters] | Poisson's ratio | coarse elements | fine elements | formula without tilt |",
        "|---|---|---|---|---|",
    ]
    for height, ratio in ((2.0, 0.3), (2.0, 0.4), (3.0, 0.4)):
        cells = []
        for fine in (False, True):
            found, area = compliance(height, ratio, fine=fine)
            post = Pillar(
                diameter=2 * math.sqrt(area / math.pi), height=height, youngs_modulus=1.0, poissons_ratio=ratio
            )
            parts = post.compliances
            total = sum(parts.values())
            cells.append(f"{found / total:.3f}")
        lines.append(f"| {height:g} | {ratio:g} | {' | '.join(cells)} | {1 - parts['tilt'] / total:.3f} |")
        print(lines[-1], flush=True)
    if given.markdown is not None:
        given.markdown.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
