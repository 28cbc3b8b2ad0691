"""What linear elasticity costs where strain is large: a rigid ball pressed into a bonded neo-Hookean layer, inverted by palpate.

    python benchmarks/hyperelastic.py                            # palpate on the table of the finite-element solution; no such library is needed
    python benchmarks/hyperelastic.py --solve                    # solves it anew and writes the table (needs: pip install felupe, 11 or later)
    python benchmarks/hyperelastic.py --markdown FILE

Axisymmetric, frictionless, the layer bonded to a rigid base, nearly incompressible (nu = 0.48 at small strain); lengths in units of its thickness,
stress in units of Young's modulus. Displacements of markers at a seventh of the thickness, stress on the base.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.sensing.uncertainty import EXACT

TABLE = Path(__file__).parent.parent / "tests" / "data" / "hyperelastic.csv"
POISSON, DEPTH = 0.48, 0.15
RADII, INDENTATIONS = (1.5, 4.0), (0.02, 0.05, 0.08, 0.12, 0.16, 0.20)
PLACES = np.arange(0.0, 3.01, 0.1)
#: Thickness [m] and modulus [Pa] of the layer that is inverted; part of the largest reading that is noise.
THICKNESS, MODULUS, NOISE = 4e-3, 2e5, 0.005


# -- the finite-element solution ------------------------------------------------------------------------------------


def solved(radius: float, indentations: tuple[float, ...], width: float = 4.5) -> list[dict[str, Any]]:
    """Force, contact and fields at each indentation; contact by a penalty on the gaps of the surface's nodes."""
    import felupe as fe
    import scipy.interpolate
    import scipy.sparse
    import scipy.sparse.linalg

    # cells fine under the ball and at the surface
    r = np.concatenate([np.linspace(0.0, 1.4, 50), 1.4 + (width - 1.4) * np.linspace(0.0, 1.0, 17)[1:] ** 1.5])
    z = -1.0 + (1.0 - (1.0 - np.linspace(0.0, 1.0, 17)) ** 1.5)  # the base at -1, the surface at 0; felupe's axis is x
    axial, radial = np.meshgrid(z, r, indexing="ij")
    points = np.stack([axial.ravel(), radial.ravel()], axis=1)
    n, m = len(z), len(r)
    index = np.arange(n * m).reshape(n, m)
    cells = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = fe.Mesh(points, cells, "quad")
    mesh = fe.mesh.convert(mesh, order=2, calc_points=True, calc_midfaces=True)
    region = fe.RegionBiQuadraticQuad(mesh)
    field = fe.FieldContainer([fe.FieldAxisymmetric(region, dim=2)])
    shear = 1.0 / (2.0 * (1.0 + POISSON))
    bulk = 1.0 / (3.0 * (1.0 - 2.0 * POISSON))
    body = fe.SolidBody(fe.NeoHooke(mu=shear, bulk=bulk), field)
    x = mesh.points
    count = len(x)
    fixed = np.zeros((count, 2), dtype=bool)
    fixed[np.abs(x[:, 0] + 1.0) < 1e-9] = True
    fixed[np.abs(x[:, 1]) < 1e-9, 1] = True
    free = np.flatnonzero(~fixed.ravel())
    top = np.flatnonzero(np.abs(x[:, 0]) < 1e-9)
    top = top[np.argsort(x[top, 1])]
    area = _areas(x[top, 1])
    area[0] = 0.1 * area[1]  # that of a quadratic cell is nothing on the axis
    stiff = 500.0 * area
    out = []
    levels = [
        v
        for stop, start in zip(indentations, (0.0, *indentations))
        for v in np.linspace(start, stop, 1 + round((stop - start) / 0.01))[1:]
    ]
    for level in levels:
        for turn in range(120):
            u = field[0].values
            force = np.asarray(body.assemble.vector(field).toarray()).ravel()
            rows, columns, values = [], [], []
            place = x[top] + u[top]
            away = place - np.array([radius - level, 0.0])
            distance = np.linalg.norm(away, axis=1)
            gap = distance - radius
            normal = away / distance[:, None]
            press = np.where(gap < 0, stiff * gap, 0.0)
            residual = force.copy()
            for i, node in enumerate(top):
                if gap[i] >= 0:
                    continue
                pair = [2 * node, 2 * node + 1]
                residual[pair] += press[i] * normal[i]
                outer = np.outer(normal[i], normal[i])
                tangent = stiff[i] * outer + press[i] / distance[i] * (np.eye(2) - outer)
                rows += np.repeat(pair, 2).tolist()
                columns += pair * 2
                values += tangent.ravel().tolist()
            size = np.abs(residual[free]).max()
            if size < 1e-8:
                break
            matrix = scipy.sparse.csr_matrix(body.assemble.matrix(field))
            matrix = matrix + scipy.sparse.csr_matrix((values, (rows, columns)), shape=matrix.shape)
            step = scipy.sparse.linalg.spsolve(
                matrix[free][:, free].tocsc(), -residual[free], permc_spec="MMD_AT_PLUS_A"
            )
            whole = np.zeros(2 * count)
            # nodes at the edge of the contact come and go: half steps end that
            whole[free] = step * (1.0 if turn < 8 else 0.5) * min(1.0, 0.004 / max(float(np.abs(step).max()), 1e-12))
            field[0].values[:] += whole.reshape(-1, 2)
        else:
            raise RuntimeError(f"no equilibrium at an indentation of {level:g}: {size:g} is left")
        if not any(abs(level - v) < 1e-9 for v in indentations):
            continue
        touching = gap < 0
        found = {
            "radius": radius,
            "indentation": level,
            "force": float((press * normal[:, 0]).sum()),
            "peak": float((-press / area).max()),
            "contact": float(place[touching, 1].max(initial=0.0)),
        }
        u = field[0].values
        near = np.abs(x[:, 0] + DEPTH) < 0.2
        inside = [
            scipy.interpolate.CloughTocher2DInterpolator(x[near], u[near, i])(np.full(len(PLACES), -DEPTH), PLACES)
            for i in (1, 0)
        ]
        base = np.flatnonzero(np.abs(x[:, 0] + 1.0) < 1e-9)
        base = base[np.argsort(x[base, 1])]
        area_there, reaction = _areas(x[base, 1]), force.reshape(-1, 2)[base]
        known = x[base, 1] > 1e-9
        places = x[base, 1][known]
        stress = [reaction[known, i] / area_there[known] * sign for i, sign in ((1, -1.0), (0, 1.0))]
        # even and odd in r, so that they are smooth across the axis
        mirrored = np.concatenate([-places[::-1], places])
        at_base = [
            scipy.interpolate.make_smoothing_spline(mirrored, np.concatenate([parity * v[::-1], v]), lam=1e-7)(PLACES)
            for v, parity in zip(stress, (-1.0, 1.0))
        ]
        for k, place_of in enumerate(PLACES):
            out.append(
                found
                | {
                    "place": float(place_of),
                    "u_r": float(inside[0][k]),
                    "u_z": -float(inside[1][k]),  # into the layer
                    "s_rz": float(at_base[0][k]),
                    "s_zz": float(at_base[1][k]),
                }
            )
    return out


def _areas(r: np.ndarray) -> np.ndarray:
    """Integrals of the shape functions of quadratic cells with nodes at ``r``, round the axis."""
    out = np.zeros(len(r))
    points, weights = np.polynomial.legendre.leggauss(4)
    shapes = np.stack([0.5 * points * (points - 1.0), 1.0 - points**2, 0.5 * points * (points + 1.0)])
    for a in range(0, len(r) - 2, 2):
        half = 0.5 * (r[a + 2] - r[a])
        here = r[a + 1] + half * points
        out[a : a + 3] += shapes @ (weights * 2.0 * np.pi * here) * half
    return out


# -- what palpate makes of it ---------------------------------------------------------------------------------------


def table() -> list[dict[str, float]]:
    """Rows of the finite-element solution, as kept."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        lines = [line for line in file if not line.startswith("#")]
    return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]


def cases(rows: list[dict[str, float]]) -> dict[tuple[float, float], list[dict[str, float]]]:
    """Rows of each ball and indentation."""
    out: dict[tuple[float, float], list[dict[str, float]]] = {}
    for row in rows:
        out.setdefault((row["radius"], row["indentation"]), []).append(row)
    return out


def skin(kind: str) -> pp.Skin:
    """Markers near the surface, or taxels on the base."""
    gel = pp.BondedLayers([pp.Layer(thickness=THICKNESS, youngs_modulus=MODULUS, poissons_ratio=POISSON)])
    if kind == "markers":
        channels, depth = ["displacement_x", "displacement_y", "displacement_z"], DEPTH * THICKNESS
    else:
        channels, depth = ["stress_xz", "stress_yz", "stress_zz"], THICKNESS
    array = pp.AreaArray(shape=(12, 12), pitch=0.35 * THICKNESS, depth=depth, channels=channels)
    return pp.Skin(gel, array, uncertainty=EXACT)


def readings(some: list[dict[str, float]], kind: str, where: pp.Skin) -> np.ndarray:
    """What the sensor reads of one case, without noise."""
    import scipy.interpolate

    array = where.planes[0]
    y, x = np.meshgrid(*[np.unique(array.points[:, i]) for i in (1, 0)], indexing="ij")
    r = np.hypot(x, y)
    names, unit = (("u_r", "u_z"), THICKNESS) if kind == "markers" else (("s_rz", "s_zz"), MODULUS)
    places = np.array([row["place"] for row in some]) * THICKNESS
    along, down = (
        unit * scipy.interpolate.CubicSpline(places, [row[n] for row in some])(np.minimum(r, places[-1])) for n in names
    )
    along, down = (np.where(r > places[-1], 0.0, v) for v in (along, down))
    return np.stack([along * x / np.maximum(r, 1e-12), along * y / np.maximum(r, 1e-12), down])


def recovered(kind: str, method: str = "constrained", seed: int = 0) -> Iterator[dict[str, float]]:
    """Of each case: strain as recovered, and errors of force and peak pressure as parts of the truth."""
    where = skin(kind)
    rng = np.random.default_rng(seed)
    for (radius, level), some in cases(table()).items():
        clean = readings(some, kind, where)
        touch = where.reconstruct(clean + NOISE * np.abs(clean).max() * rng.standard_normal(clean.shape), method=method)
        force, peak = some[0]["force"] * MODULUS * THICKNESS**2, some[0]["peak"] * MODULUS
        low, high = touch.interval(0.95, "force")
        below, above = touch.interval(0.95, "peak_pressure")
        yield {
            "radius": radius,
            "indentation": level,
            "strain": float(touch.peak_pressure) * (1.0 - POISSON**2) / MODULUS,
            "force": float(touch.force[2]) / force - 1.0,
            "peak": float(touch.peak_pressure) / peak - 1.0,
            "force held": float(low[2] <= force <= high[2]),
            "peak held": float(below <= peak <= above),
            "fit": float(touch.fit) if touch.fit is not None else float("nan"),
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--solve", action="store_true", help="solve with felupe and write the table")
    parser.add_argument("--readings", nargs="+", choices=("markers", "taxels"), default=["markers", "taxels"])
    parser.add_argument("--markdown", type=Path, help="file for the table of errors")
    args = parser.parse_args()
    if args.solve:
        rows = [row for radius in RADII for row in solved(radius, INDENTATIONS)]
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            file.write(
                "# rigid ball on a bonded neo-Hookean layer, nu 0.48; lengths over the thickness, stress over E; benchmarks/hyperelastic.py --solve\n"
            )
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows({k: f"{v:.6g}" for k, v in row.items()} for row in rows)
    lines = [
        "| readings | ball radius / thickness | indentation / thickness | recovered strain p (1 - nu^2)/E | force error | peak error | force, peak in 95 % | fit |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in args.readings:
        for row in recovered(kind):
            held = ", ".join("yes" if row[k] else "no" for k in ("force held", "peak held"))
            lines.append(
                f"| {kind} | {row['radius']:g} | {row['indentation']:g} | {row['strain']:.3f} | {row['force']:+.3f} | {row['peak']:+.3f} | {held} | {row['fit']:.2g} |"
            )
            print(lines[-1], flush=True)
            if args.markdown is not None:
                made = "Made by `python benchmarks/hyperelastic.py` (method constrained).\n\n"
                args.markdown.write_text(made + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
