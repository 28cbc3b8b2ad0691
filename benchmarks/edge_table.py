"""How far wrong the endless layer is near the side of a gel: the table that `palpate pad` reads, by finite elements.

    pip install "palpate[solid]" && python benchmarks/edge_table.py [--write]

A box of 6.5 x 7 thicknesses, glued below and free at its sides, and a ball of radius 0.5 thicknesses (Hertz's pressure) that presses with 1, or drags with 1 along the
normal of the side, with its middle at some distance from it. Lengths are in thicknesses; stress does not depend on the modulus, and displacement is in
proportion to its inverse, for the box and for the layer alike. `--write` writes src/palpate/solid/edges.json and docs/_generated/edges.md.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from skfem import MeshHex

import palpate as pp
from palpate.sensing import Operator
from palpate.sensing.contacts import sampled

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "src" / "palpate" / "solid" / "edges.json"
PAGE = ROOT / "docs" / "_generated" / "edges.md"
RATIOS = (0.3, 0.45, 0.48, 0.499)
DISTANCES = (0.5, 0.65, 0.8, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0)
RADIUS = 0.5
#: The unit of length [m], and a modulus [Pa]: neither matters.
H, MODULUS = 1e-3, 1e5
KINDS = {"stress": ("stress_xz", "stress_yz", "stress_zz"), "displacement": ("displacement_x", "displacement_y")}


def gel(ratio: float) -> pp.SolidPad:
    """The box, its side at x = 0, with small elements near it."""
    x = np.r_[np.linspace(-6.5, -4.0, 4)[:-1], np.linspace(-4.0, 0.0, 20)]
    y = np.r_[np.linspace(-3.5, -1.0, 4)[:-1], np.linspace(-1.0, 1.0, 11), np.linspace(1.0, 3.5, 4)[1:]]
    # thin elements below the surface, where what moves sideways under a ball changes quickly
    mesh = MeshHex.init_tensor(x * H, y * H, np.array([0.0, 0.08, 0.22, 0.45, 0.72, 1.0]) * H)
    tiny = 1e-6 * H
    return pp.SolidPad(
        vertices=np.ascontiguousarray(mesh.p.T),
        elements=np.ascontiguousarray(mesh.t.T),
        base=mesh.facets[:, mesh.facets_satisfying(lambda p: p[2] > H - tiny, boundaries_only=True)].T,
        contact=mesh.facets[:, mesh.facets_satisfying(lambda p: p[2] < tiny, boundaries_only=True)].T,
        youngs_modulus=MODULUS,
        poissons_ratio=ratio,
    )


def array(kind: str) -> pp.AreaArray:
    """Taxels at the base, or markers on the surface, up to half a pitch from the side: nearer, stress at the glued rim grows without end."""
    return pp.AreaArray(
        shape=(7, 10),
        pitch=0.5 * H,
        depth=H if kind == "stress" else 0.0,
        channels=KINDS[kind],
        center=(-2.5 * H, 0.0),
    )


def rows(ratio: float) -> list[dict[str, float | str]]:
    """What a ball does to the box, beside the layer."""
    pad, out = gel(ratio), []
    for kind in KINDS:
        plane = array(kind)
        grid = pp.AreaGrid(shape=(48, 80), spacing=H / 16, center=(-2.5 * H, 0.0))
        box, layer = Operator(pad, [plane], grid), Operator(pad.endless, [plane], grid)
        skin = pp.Skin(pad.endless, plane)
        for distance in DISTANCES:
            ball = pp.solutions.hertz_point(contact_radius=RADIUS * H, force=1.0).shifted(-distance * H, 0.0)
            traction = sampled(ball, grid)
            row: dict[str, float | str] = {"kind": kind, "ratio": ratio, "distance": distance}
            for name, load in (("press", traction), ("drag", traction[[2, 1, 0]])):
                (true,), (wrong,) = box.forward(load), layer.forward(load)
                row[name] = float(np.linalg.norm(true - wrong) / np.linalg.norm(true))
                if name == "press" and kind == "stress":
                    row["force"] = float(skin.reconstruct(true, components=["x", "y", "z"]).force[2])
            out.append(row)
            print(row, flush=True)
    return out


def page(table: list[dict[str, float | str]]) -> str:
    lines = [
        "Made by `python benchmarks/edge_table.py --write`.",
        "",
        f"A ball of radius {RADIUS:g} thicknesses near a free side of a glued gel. Readings: error of the model of an infinite layer, divided by the root mean "
        "square of the readings. Force: result of `reconstruct` with the infinite layer, for a true force of 1 N.",
        "",
        "| Poisson's ratio | middle of the ball from the side, thicknesses | stress at the base, press | drag | force | markers on the surface, press | drag |",
        "|---|---|---|---|---|---|---|",
    ]
    for ratio in RATIOS:
        for d in DISTANCES:
            here = {r["kind"]: r for r in table if r["ratio"] == ratio and r["distance"] == d}
            a, b = here["stress"], here["displacement"]
            lines.append(
                f"| {ratio:g} | {d:g} | {100 * a['press']:.0f} % | {100 * a['drag']:.0f} % | {a['force']:.2f} N | {100 * b['press']:.0f} % | {100 * b['drag']:.0f} % |"
            )
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    start, table = time.perf_counter(), []
    for ratio in RATIOS:
        table += rows(ratio)
    print(page(table))
    print(f"{time.perf_counter() - start:.0f} s")
    if options.write:
        rounded = [{k: v if isinstance(v, str) else round(v, 4) for k, v in r.items()} for r in table]
        about = {"made_by": "benchmarks/edge_table.py", "radius": RADIUS, "rows": rounded}
        TABLE.write_text(json.dumps(about, indent=None).replace("}, {", "},\n  {") + "\n")
        PAGE.write_text(page(table))


if __name__ == "__main__":
    main()
