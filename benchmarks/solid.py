"""Solid pads by finite elements, measured: closed forms, the endless layer far from the sides, and a ball near a side.

    pip install "palpate[solid]" && python benchmarks/solid.py [--write]

`--write` writes the parts that were run into docs/_generated/solid.md. Where pypardiso is installed, its solver is used.
"""

from __future__ import annotations

import argparse
import importlib.util
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from skfem import MeshHex

import palpate as pp
from palpate.solid.elasticity import Solid

PAGE = Path(__file__).parents[1] / "docs" / "_generated" / "solid.md"
MODULUS = 2e5
#: What is pressed to time frames.
BALL = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0)


def shell(count: int, through: int, inner: float, outer: float) -> MeshHex:
    """A hollow sphere of six blocks."""
    angle = np.tan(np.linspace(-np.pi / 4, np.pi / 4, count + 1))
    out = None
    for axis in range(3):
        for sign in (1.0, -1.0):
            block = MeshHex.init_tensor(angle, angle, np.linspace(inner, outer, through + 1))
            u, v, r = block.p
            way = np.roll(np.stack([u, v, np.ones_like(u)]) / np.sqrt(1.0 + u**2 + v**2), axis, axis=0)
            block = MeshHex(sign * way * r, block.t)
            out = block if out is None else out + block
    return out


def squeezed_shell(count: int, through: int, ratio: float) -> tuple[float, float]:
    """Radial displacement of the outside and radial stress in the middle of a shell on a rigid core under pressure, over Lame's."""
    a, b = 0.5, 1.0
    mesh = shell(count, through, a, b)
    facets = mesh.boundary_facets()
    away = np.linalg.norm(mesh.p[:, mesh.facets[:, facets]].mean(axis=1), axis=0)
    solid = Solid(mesh, 1.0, ratio, facets[away < 0.7])
    u = solid.solve(solid.surface_load(facets[away > 0.7], 1.0)[:, None])[:, 0].reshape(-1, 3)
    bulk, shear = 1.0 / 3.0 / (1.0 - 2.0 * ratio), 0.5 / (1.0 + ratio)
    # u_r = A r + B / r^2, with u_r(a) = 0 and sigma_rr(b) = -1
    slope, core = np.linalg.solve([[a, a**-2], [3.0 * bulk, -4.0 * shear / b**3]], [0.0, -1.0])
    places = np.asarray(solid.basis.doflocs)
    r = np.linalg.norm(places, axis=0)
    on = np.abs(r - b) < 1e-6
    moved = float(((u.T * places).sum(axis=0)[on] / r[on]).mean()) / (slope * b + core / b**2)
    way = np.array([0.75, 0.02, 0.03])
    way *= 0.75 / np.linalg.norm(way)
    nodes, fields = solid.at(way[:, None])
    stress = float((fields.stress("xx")[0] * u[nodes[:, 0]]).sum())
    return moved, stress / -(3.0 * bulk * slope - 4.0 * shear * core / 0.75**3)


def graded(half: float, flat: float, element: float) -> np.ndarray:
    """Lines of a mesh from -half to half: equal elements up to +-flat, each one beyond them 1.3 times the last."""
    wanted = [*np.arange(0.0, flat + 1e-9, element)]
    while wanted[-1] < half:
        wanted.append(wanted[-1] + 1.3 * (wanted[-1] - wanted[-2]))
    x = np.array(wanted)
    beyond = x > flat + 1e-9
    x[beyond] = flat + (x[beyond] - flat) * (half - flat) / (x[-1] - flat)
    return np.concatenate([-x[:0:-1], x])


def beside_layer(through: int, ratio: float) -> tuple[int, list[float]]:
    """Elements, and largest difference to the endless layer in the middle of a box eight thicknesses wide, over the
    largest reading: base stress, displacement on the surface, stress inside; at 24 places up to 0.6 thicknesses from
    the middle.

    Beyond one thickness from the middle the elements grow towards the sides: a box six thicknesses wide differs from
    the endless layer by 1 % for its sides alone.
    """
    h = 2e-3
    lines = graded(4 * h, h, h / through)
    block = MeshHex.init_tensor(lines, lines, np.linspace(0.0, h, through + 1))
    outside = block.facets[:, block.boundary_facets()]
    depth = block.p[2, outside]
    pad = pp.SolidPad(
        vertices=np.ascontiguousarray(block.p.T),
        elements=np.ascontiguousarray(block.t.T),
        base=outside[:, (depth > 0.999 * h).all(axis=0)].T,
        contact=outside[:, (depth < 0.001 * h).all(axis=0)].T,
        youngs_modulus=MODULUS,
        poissons_ratio=ratio,
    )
    ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0).sliding(0.3)
    places = np.random.default_rng(5).uniform(-0.6 * h, 0.6 * h, (24, 2))
    stress = ["stress_xz", "stress_yz", "stress_zz"]
    arrays = [
        pp.ScatteredArray(positions=places, depth="base", channels=stress),
        pp.ScatteredArray(positions=places, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]),
        pp.ScatteredArray(positions=places, depth=0.5 * h, channels=stress),
    ]
    surface = pad.grid(shape=(40, 40), spacing=0.15e-3)
    out = []
    for array in arrays:
        found, usual = pp.Skin(pad, array, surface=surface).sense(ball), pp.Skin(pad.endless, array).sense(ball)
        out.append(float(np.abs(found - usual).max() / np.abs(usual).max()))
    return len(pad.elements), out


def near_a_side() -> list[str]:
    """A ball that presses and drags at distances from the side x = 6 mm of a gel 12 x 12 x 3 mm; readings are those of a finer mesh."""
    size, h, ratio = 12e-3, 3e-3, 0.48
    make = {"youngs_modulus": MODULUS, "poissons_ratio": ratio}
    truth, model = (pp.SolidPad.box(size, size, h, element=e, **make) for e in (0.75e-3, 1e-3))
    array = pp.AreaArray(
        shape=(5, 5), pitch=2e-3, depth="base", channels=["stress_xz", "stress_yz", "stress_zz"], noise=60.0
    )
    other = pp.SolidPad.box(size, size, h, element=0.85e-3, **make)
    sure = pp.Uncertainty(depth=0.0, gain=model.mesh_error(other, array))
    skins = {
        f"solid, mesh error {100 * sure.stated_gain:.1f} %": pp.Skin(model, array, uncertainty=sure),
        "endless": pp.Skin(model.endless, array, uncertainty=pp.Uncertainty(depth=0.0, thickness=0.0)),
    }
    true = pp.Skin(truth, array)
    lines = [
        "| middle of the ball from the side, thicknesses | model | normal force (1 N) | 95 % interval | shear force (0.2 N) | centre x off [mm] |",
        "|---|---|---|---|---|---|",
    ]
    rng = np.random.default_rng(3)
    for away in (2.0, 1.0, 0.67, 0.5):
        x = 0.5 * size - away * h
        ball = pp.solutions.hertz_point(contact_radius=1.2e-3, force=1.0).sliding(0.2).shifted(x, 0.0)
        readings = true.sense(ball, rng=rng)
        for name, skin in skins.items():
            touch = skin.reconstruct(readings)
            low, high = touch.interval(0.95, "force")
            off = 1e3 * (float(touch.center_of_pressure[0]) - x)
            lines.append(
                f"| {away:g} | {name} | {float(touch.force[2]):.3f} | {low[2]:.3f} to {high[2]:.3f} | {float(touch.force[0]):.3f} | {off:+.2f} |"
            )
    return lines


def on_a_dome() -> list[str]:
    """A ball that presses and drags on a half sphere of radius 10 mm, 4 mm thick on its core; readings are those of a finer mesh."""
    make = {"youngs_modulus": MODULUS, "poissons_ratio": 0.48}
    radius, h = 10e-3, 4e-3
    truth, model, other = (pp.SolidPad.dome(radius, h, element=e, **make) for e in (1.0e-3, 4e-3 / 3, 1.5e-3))
    return _curved(
        truth, model, other, {f"{a} degrees": 2.0 * radius * math.sin(math.radians(a) / 2) for a in (0, 25, 45)}
    )


def in_a_crook() -> list[str]:
    """The same in a bend of radius 15 mm, from inside; 18 x 16 x 3 mm."""
    make = {"youngs_modulus": MODULUS, "poissons_ratio": 0.48}
    truth, model, other = (
        pp.SolidPad.bend(-15e-3, 18e-3, 16e-3, 3e-3, element=e, **make) for e in (0.8e-3, 1.0e-3, 1.2e-3)
    )
    return _curved(truth, model, other, {"middle": 0.0, "6 mm along the arc": 6e-3})


def _curved(truth: pp.SolidPad, model: pp.SolidPad, other: pp.SolidPad, places: dict[str, float]) -> list[str]:
    array = pp.AreaArray(
        shape=(6, 6), pitch=2.4e-3, depth="base", channels=["stress_xz", "stress_yz", "stress_zz"], noise=60.0
    )
    sure = pp.Uncertainty(depth=0.0, gain=model.mesh_error(other, array))
    skins = {
        f"solid, mesh error {100 * sure.stated_gain:.1f} %": pp.Skin(model, array, uncertainty=sure),
        "endless, flat": pp.Skin(model.endless, array, uncertainty=pp.Uncertainty(depth=0.0, thickness=0.0)),
    }
    lines = [
        "| place | model | force x, z [N] | true | 95 % interval of x | of z | centre off [mm] |",
        "|---|---|---|---|---|---|---|",
    ]
    rng = np.random.default_rng(3)
    for name, x in places.items():
        ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0).sliding(0.2).shifted(x, 0.0)
        fine = truth.grid(shape=(24, 24), spacing=3.2e-3 / 24, center=(x, 0.0))
        true = pp.Skin(truth, array, surface=fine)
        traction = true.sample(ball)
        force, readings = fine.total_force(traction), true.sense(traction, rng=rng)
        for model_name, skin in skins.items():
            touch = skin.reconstruct(readings)
            low, high = touch.interval(0.95, "force")
            off = 1e3 * (float(touch.center_of_pressure[0]) - x)
            lines.append(
                f"| {name} | {model_name} | {float(touch.force[0]):.3f}, {float(touch.force[2]):.3f} | {force[0]:.3f}, {force[2]:.3f} | "
                f"{low[0]:.3f} to {high[0]:.3f} | {low[2]:.3f} to {high[2]:.3f} | {off:+.2f} |"
            )
    return lines


def _frame_time(solve: Callable[[Any], object], readings: list[Any]) -> float:
    """Median processor time of a frame [ms], after the first."""
    found = []
    for frame in [readings[0], *readings]:
        start = time.process_time()
        solve(frame)
        found.append(1e3 * (time.process_time() - start))
    return float(np.median(found[1:]))


def times() -> list[str]:
    """Processor time of preparation and of frames of markers on a gel, one thread."""
    lines = [
        "| gel, elements | unknowns | markers x channels | preparation [s] | file [MB] | a frame, tikhonov [ms] | tracked [ms] | automatic, by itself [ms] | the same, endless layer [ms] |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for element, side in ((2e-3, 7), (1.5e-3, 10)):
        pad = pp.SolidPad.box(25.25e-3, 20.75e-3, 4e-3, youngs_modulus=MODULUS, poissons_ratio=0.48, element=element)
        xy = np.stack(np.meshgrid(np.linspace(-9e-3, 9e-3, side), np.linspace(-7e-3, 7e-3, side)), axis=-1).reshape(
            -1, 2
        )
        array = pp.ScatteredArray(
            positions=xy, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"], noise=2e-6
        )
        skin = pp.Skin(pad, array)
        start = time.process_time()
        readings = [skin.sense(BALL.shifted(x, 0.0), rng=np.random.default_rng(1)) for x in (0.0, 1e-3, 2e-3, 3e-3)]
        made = time.process_time() - start
        with tempfile.TemporaryDirectory() as folder:
            pad.save(f"{folder}/gel.npz")
            size = Path(f"{folder}/gel.npz").stat().st_size / 1e6
        flat = pp.Skin(pad.endless, array, surface=skin.surface)
        of_frame = [
            _frame_time(partial(skin.reconstruct, method="tikhonov"), readings),
            _frame_time(skin.track().step, readings),
            _frame_time(skin.reconstruct, readings),
            _frame_time(flat.reconstruct, readings),
        ]
        lines.append(
            f"| 25.25 x 20.75 x 4 mm, {len(pad.elements)} | {3 * pad.solid.basis.N} | {len(xy)} x 3 | {made:.0f} | {size:.1f} | "
            + " | ".join(f"{t:.0f}" for t in of_frame)
            + " |"
        )
    return lines


def large() -> list[str]:
    """Preparation and frames of 20 x 20 markers and 20,000 surface cells; run this part by itself, its memory is that
    of the whole process.
    """
    pad = pp.SolidPad.box(25.25e-3, 20.75e-3, 4e-3, youngs_modulus=MODULUS, poissons_ratio=0.48)
    channels = ["displacement_x", "displacement_y", "displacement_z"]
    array = pp.AreaArray(shape=(20, 20), pitch=(0.95e-3, 1.15e-3), depth=0.0, channels=channels, noise=2e-6)
    surface = pad.grid(shape=(128, 157), spacing=(20.75e-3 / 128, 25.25e-3 / 157))
    clock, processor = time.perf_counter(), time.process_time()
    skin = pp.Skin(pad, array, surface=surface)
    readings = skin.sense(np.zeros((3, *surface.shape)))
    spent = time.perf_counter() - clock, time.process_time() - processor
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    places = [(0.0, 0.0), (1e-3, 0.0), (2e-3, 0.0), (-3e-3, 0.0), (4e-3, 0.0), (-5e-3, 0.0), (3e-3, 3e-3)]
    readings = [skin.sense(BALL.shifted(*p), rng=np.random.default_rng(i)) for i, p in enumerate(places)]
    clock = time.perf_counter()
    solve = partial(skin.reconstruct, method="tikhonov")
    solve(readings[0])
    first = time.perf_counter() - clock
    skin.reconstruct(readings[0])
    each = [_frame_time(skin.reconstruct, [r]) for r in readings]
    others = [
        pp.solutions.hertz_point(contact_radius=1.2e-3, force=0.3),
        pp.solutions.hertz_point(contact_radius=4.5e-3, force=4.0),
        pp.solutions.flat_punch(radius=2e-3, force=1.0),
    ]
    small, wide, punch = (
        _frame_time(skin.reconstruct, [skin.sense(o.shifted(1e-3, -2e-3), rng=np.random.default_rng(9))])
        for o in others
    )
    return [
        f"{len(pad.elements)} elements, {3 * pad.solid.basis.N} unknowns, {math.prod(surface.shape)} cells of the surface, "
        f"{len(array.points)} x 3 markers, {os.environ.get('OMP_NUM_THREADS', 'all')} threads: prepared in {spent[0]:.0f} s "
        f"({spent[1]:.0f} s of processor time), {memory:.1f} GB at most. The first frame by Tikhonov's method takes another "
        f"{first:.0f} s, later ones {_frame_time(solve, readings):.0f} ms of processor time. By the automatic method a ball of 3 mm radius "
        f"takes {np.median(each):.0f} ms after the first frame (slowest of {len(each)} places: {max(each):.0f}), a ball of 1.2 mm {small:.0f} ms, "
        f"one of 4.5 mm {wide:.0f} ms, a punch of 2 mm {punch:.0f} ms; tracked {_frame_time(skin.track().step, readings):.0f} ms."
    ]


MESH_SKIN = """
[pad]
kind = "solid_mesh"
file = "gel.msh"
base = "glue"
contact = "skin"
scale = 1e-3
turned = true
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [5, 5]
pitch = "1.2 mm"
depth = "base"
channels = ["stress_xz", "stress_yz", "stress_zz"]
noise = "60 Pa"
"""


def journey() -> list[str]:
    """Processor time from a mesh file of 128 hexahedra to newtons: in Python, and by one command, with its start and imports."""
    block = MeshHex.init_tensor(np.linspace(-4, 4, 9), np.linspace(-4, 4, 9), np.linspace(0, 2, 3))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        surfaces = {"glue": lambda x: x[2] < 1e-6, "skin": lambda x: x[2] > 2 - 1e-6}
        block.with_boundaries(surfaces).save(str(folder / "gel.msh"))
        (folder / "skin.toml").write_text(MESH_SKIN)
        ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0)
        readings = pp.Skin.from_file(folder / "skin.toml").sense(ball, rng=np.random.default_rng(0))
        start = time.process_time()
        skin = pp.Skin.from_file(folder / "skin.toml")
        touch = skin.reconstruct(readings)
        python = time.process_time() - start
        names = [f"{c}[{i};{j}] (Pa)" for c in skin.planes[0].channels for i in range(5) for j in range(5)]
        row = ",".join(f"{v!r}" for v in np.ravel(readings).tolist())
        (folder / "press.csv").write_text(",".join(["time (s)", *names]) + "\n0.0," + row + "\n")
        before = os.times()
        command = [sys.executable, "-m", "palpate", "reconstruct", "press.csv", "--skin", "skin.toml"]
        said = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout
        after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    found = next(line for line in said.splitlines() if "z" in line.split() or "force z" in line)
    return [
        f"Python: {float(touch.force[2]):.3f} N of 1 N after {python:.1f} s. `palpate reconstruct press.csv --skin skin.toml`: "
        f"`{' '.join(found.split())}` after {spent:.1f} s."
    ]


def layer(ratios: Sequence[float]) -> list[str]:
    """Table of `beside_layer`."""
    lines = [
        "| Poisson's ratio | elements through | elements | base stress | displacement on the surface | stress in the middle |",
        "|---|---|---|---|---|---|",
    ]
    for ratio in ratios:
        for through in (2, 3, 4, 6):
            count, found = beside_layer(through, ratio)
            lines.append(f"| {ratio} | {through} | {count} | " + " | ".join(f"{100 * e:.1f} %" for e in found) + " |")
    return lines


def spheres() -> list[str]:
    """Table of `squeezed_shell`."""
    lines = [
        "| Poisson's ratio | elements | displacement of the outside | radial stress in the middle |",
        "|---|---|---|---|",
    ]
    for ratio in (0.3, 0.49, 0.499):
        for count, through in ((3, 2), (6, 4)):
            moved, stress = squeezed_shell(count, through, ratio)
            lines.append(f"| {ratio} | {6 * count**2 * through} | {moved:.4f} | {stress:.4f} |")
    return lines


STATED = (
    " Mesh errors are those of `SolidPad.mesh_error` with a third mesh, not used for readings; the solid models state "
    "them as `Uncertainty(gain=)`."
)
#: What a part measures, and what makes its table.
PARTS: dict[str, tuple[str, Callable[[], list[str]]]] = {
    "shell": (
        "A hollow sphere on a rigid core under pressure, divided by Lame's solution (1 is exact). The "
        "remaining error comes from the facets of the surface.",
        spheres,
    ),
    "layer": (
        "The middle of a box eight thicknesses wide, compared with an infinite layer: largest difference divided by the "
        "largest reading at 24 places, a ball of 1.5 thicknesses across. Elements are cubes within one thickness of the "
        "middle, and grow towards the sides.",
        partial(layer, (0.3, 0.49, 0.499)),
    ),
    "side": (
        "A ball of radius 1.2 mm that presses with 1 N and drags with 0.2 N along x, near a free side of a gel "
        "12 x 12 x 3 mm (Poisson's ratio 0.48) with 5 x 5 x 3 taxels under it. The readings are those of a mesh of "
        "0.75 mm, the solid model has one of 1 mm." + STATED,
        near_a_side,
    ),
    "dome": (
        "A ball of radius 1.5 mm that presses with 1 N and drags with 0.2 N towards the rim, on a half sphere of "
        "radius 10 mm with 4 mm of gel on its core (Poisson's ratio 0.48) and 6 x 6 x 3 taxels on the core; places are "
        "angles from the top. Readings are those of a mesh of 1 mm, the model has one of 1.33 mm. For comparison, "
        'the same readings are solved with a flat infinite layer ("endless").' + STATED,
        on_a_dome,
    ),
    "crook": (
        "The same ball inside a bend of radius 15 mm, gel 18 x 16 x 3 mm. Meshes of 0.8 and 1 mm." + STATED,
        in_a_crook,
    ),
    "times": ("Displacement of markers on a gel, processor time of one thread.", times),
    "large": ("Many markers and cells.", large),
    "journey": ("From a mesh file to newtons, processor time of one thread.", journey),
}


def sections(text: str) -> dict[str, str]:
    """Parts of the page by name."""
    parts = f"\n{text}".split("\n**")[1:]
    return {part.split("**", 1)[0]: part.split("\n", 1)[1].strip() for part in parts}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--write", action="store_true", help="put the parts into the page, beside those that it has")
    parser.add_argument("--part", choices=list(PARTS), nargs="*")
    chosen = parser.parse_args()
    solver = "MKL PARDISO" if importlib.util.find_spec("pypardiso") else "SuperLU"
    found = {}
    for name in chosen.part or PARTS:
        what, make = PARTS[name]
        made = f"Made by `python benchmarks/solid.py --part {name} --write` (solver: {solver})."
        found[name] = "\n".join([f"{what} {made}".strip(), "", *make()])
        print(f"**{name}**\n\n{found[name]}\n", flush=True)
        if chosen.write:
            page = sections(PAGE.read_text()) | found
            PAGE.write_text("\n".join(f"\n**{n}**\n\n{page[n]}" for n in PARTS if n in page).strip() + "\n")


if __name__ == "__main__":
    main()
