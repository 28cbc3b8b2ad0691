"""From pictures to displacement and force, against rendered pictures whose truth is known.

A gel of 3.5 mm (300 kPa, Poisson's ratio 0.48) on a window, 7 x 9 dots 2 mm apart and 0.5 mm deep, pictures of 320 x 240 pixels of 0.06 mm. Displacement: error and
coverage of its standard deviation over size of the dots, noise, compression, blur, shading and move. Force: balls, edges, slides and twists, each picture by itself and
with the tracker, by the dots alone and with a map of the surface's depth where something presses. Rate: processor time of each stage, one thread. Source: the live view on
a camera of 30 and 60 pictures a second, which a stand-in of OpenCV's capture plays (camera_source.py), on one core with nothing else to do.

    python benchmarks/camera.py                              # tables, some ten minutes
    python benchmarks/camera.py displacement --seeds 8
    python benchmarks/camera.py force --frames 3 --markdown docs/_generated/camera.md
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import camera_source
import numpy as np

import palpate as pp
from palpate.camera import (
    DepthMap,
    Dots,
    Flow,
    Looks,
    Markers,
    Scene,
    Texture,
    dot_grid,
    follow,
    open_pictures,
    write_video,
)
from palpate.camera.touches import gel_skin
from palpate.sensing.uncertainty import EXACT

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from camera_scenes import GEL, gel_file

PITCH, DIAMETER, SCALE, SIZE, DEPTH = 2e-3, 0.8e-3, 0.06e-3, (320, 240), 0.5e-3
FRICTION, DEPTH_NOISE = 0.4, 5e-6
CHANNELS = ["displacement_x", "displacement_y"]

#: label: (force of the ball [N], looks, diameter [m], stage)
CASES: dict[str, tuple[float, dict[str, Any], float, dict[str, Any]]] = {
    "at rest": (0.0, {}, DIAMETER, {}),
    "pressed, 0.3 N": (0.3, {}, DIAMETER, {}),
    "pressed, 1 N": (1.0, {}, DIAMETER, {}),
    "pressed, 3 N": (3.0, {}, DIAMETER, {}),
    "pressed, 6 N": (6.0, {}, DIAMETER, {}),
    "shifted by two pitches, in steps": (1.0, {}, DIAMETER, {"shift": (4e-3, 0.5e-3)}),
    "dots of 0.3 mm": (1.0, {}, 0.3e-3, {}),
    "dots of 0.5 mm": (1.0, {}, 0.5e-3, {}),
    "dots of 1.3 mm": (1.0, {}, 1.3e-3, {}),
    "noise 0.5": (1.0, {"noise": 0.5}, DIAMETER, {}),
    "noise 5": (1.0, {"noise": 5.0}, DIAMETER, {}),
    "noise 10": (1.0, {"noise": 10.0}, DIAMETER, {}),
    "JPEG 90": (1.0, {"compression": 90}, DIAMETER, {}),
    "JPEG 60": (1.0, {"compression": 60}, DIAMETER, {}),
    "JPEG 25": (1.0, {"compression": 25}, DIAMETER, {}),
    "blur 1.5 pixels": (1.0, {"blur": 1.5}, DIAMETER, {}),
    "coloured light, shading": (1.0, {"colour": 1.0, "shading": 0.5}, DIAMETER, {}),
    "ten half-lost": (3.0, {"halved": 10}, DIAMETER, {}),
    "four touching": (3.0, {"touching": 4}, DIAMETER, {}),
    "glare on two dots": (1.0, {"glare": ((90.0, 80.0, 9.0), (200.0, 150.0, 9.0))}, DIAMETER, {}),
}
#: label: (force of the ball [N], looks, grain [m], between places [m]); of a texture
TEXTURES: dict[str, tuple[float, dict[str, Any], float, float]] = {
    "at rest": (0.0, {}, 0.15e-3, 1e-3),
    "pressed, 1 N": (1.0, {}, 0.15e-3, 1e-3),
    "pressed, 3 N": (3.0, {}, 0.15e-3, 1e-3),
    "pressed, 6 N": (6.0, {}, 0.15e-3, 1e-3),
    "every 0.6 mm": (1.0, {}, 0.15e-3, 0.6e-3),
    "every 2 mm": (1.0, {}, 0.15e-3, 2e-3),
    "spots of 0.08 mm": (1.0, {}, 0.08e-3, 1e-3),
    "spots of 0.3 mm": (1.0, {}, 0.3e-3, 1e-3),
    "noise 10": (1.0, {"noise": 10.0}, 0.15e-3, 1e-3),
    "JPEG 25": (1.0, {"compression": 25}, 0.15e-3, 1e-3),
    "contrast 0.1": (1.0, {"contrast": 0.1}, 0.15e-3, 1e-3),
    "glare": (1.0, {"glare": ((90.0, 80.0, 9.0), (200.0, 150.0, 9.0))}, 0.15e-3, 1e-3),
}
KINDS = ("ball", "sliding ball", "twisted ball", "edge", "sliding edge")


def scene(base: Scene, seed: int, diameter: float = DIAMETER, looks: dict[str, Any] | None = None) -> Scene:
    rng = np.random.default_rng((1, seed))
    grid = dot_grid((7, 9), PITCH, jitter=2e-5, rng=rng) + rng.uniform(-1e-4, 1e-4, 2)
    given = dict(looks or {})
    halved = rng.choice(len(grid), given.pop("halved", 0), replace=False)
    for dot in rng.choice(np.flatnonzero(np.arange(len(grid)) % 9 != 8), given.pop("touching", 0), replace=False):
        grid[dot] = grid[dot + 1] - [1.02 * diameter, 0.0]
    return base.changed(print=Dots(grid, diameter, tuple(int(i) for i in halved)), looks=Looks(**given))


def texture(base: Scene, seeds: int) -> Iterator[str]:
    """Of speckles, at the places that are read: the truth there."""
    yield "| pictures | places | largest move [pixels] | error, median | error, root mean square | error, largest | stated std, root mean square | within 1 std | within 1.96 std | lost |"
    yield "|---" * 10 + "|"
    for label, (force, looks, grain, apart) in TEXTURES.items():
        error, std, lost, count, most = [], [], 0, 0, 0.0
        for seed in range(seeds):
            one, rng = (
                base.changed(print=Texture(grain, seed=seed), looks=Looks(**looks)),
                np.random.default_rng((4, seed)),
            )
            contact = None
            if force:
                ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=force).shifted(
                    *rng.uniform(-2e-3, 2e-3, 2)
                )
                contact = one.skin.sample(ball.sliding(0.3, direction=float(rng.uniform(0.0, 6.28))))
            flow = Flow(one.picture(rng=rng), spacing=apart / SCALE)
            moved = flow.follow(one.picture(contact, rng=rng))
            places = one.view.places(flow.positions)
            move = np.zeros_like(places)
            if contact is not None:
                move = one.view.pixels(places + one.displacement(contact, places)[:, :2]) - flow.positions
            kept = ~moved.lost
            error.append((moved.displacement - move)[kept])
            std.append(moved.std[kept])
            lost, count, most = lost + int((~kept).sum()), count + len(kept), max(most, float(np.abs(move).max()))
        e, s = np.abs(np.concatenate(error)), np.concatenate(std)
        yield (
            f"| {label} | {count} | {most:.1f} | {np.median(e):.3f} | {np.sqrt((e**2).mean()):.3f} | {e.max():.2f} | {np.sqrt((s**2).mean()):.3f} | "
            f"{np.mean(e < s):.2f} | {np.mean(e < 1.96 * s):.2f} | {100 * lost / count:.1f} % |"
        )


def displacement(base: Scene, seeds: int) -> Iterator[str]:
    yield "| pictures | dots | largest move [pixels] | error, median | error, root mean square | error, largest | stated std, root mean square | within 1 std | within 1.96 std | lost | taken for another dot |"
    yield "|---" * 11 + "|"
    for label, (force, looks, diameter, stage) in CASES.items():
        error, std, lost, count, wrong, most = [], [], 0, 0, 0, 0.0
        for seed in range(seeds):
            one, rng = scene(base, seed, diameter, looks), np.random.default_rng((2, seed))
            place, turn = rng.uniform(-2e-3, 2e-3, 2), float(rng.uniform(0.0, 6.28))
            contact = None
            if force:
                ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=force)
                contact = one.skin.sample(ball.shifted(*place).sliding(0.3, direction=turn))
            markers = Markers(one.picture(rng=rng))
            steps = np.linspace(0.2, 1.0, 5) if stage else [1.0]
            for part in steps:
                now = {k: tuple(part * v for v in values) for k, values in stage.items()}
                moved = markers.follow(one.picture(contact, rng=rng, **now))
            truth = one.truth(contact, **now)
            far = np.hypot(*(markers.positions[:, None] - truth.rest[None]).transpose(2, 0, 1))
            which = far.argmin(axis=1)
            kept = ~moved.lost
            off = (moved.displacement - (truth.pixels - truth.rest)[which])[kept]
            error.append(off)
            std.append(moved.std[kept])
            seen = truth.visible[which]
            lost += int((~kept & seen).sum())
            count += int(seen.sum())
            wrong += int((np.hypot(*off.T) > 5.0).sum())
            most = max(most, float(np.abs((truth.pixels - truth.rest)[which]).max()))
        e, s = np.abs(np.concatenate(error)), np.concatenate(std)
        yield (
            f"| {label} | {count} | {most:.1f} | {np.median(e):.3f} | {np.sqrt((e**2).mean()):.3f} | {e.max():.2f} | {np.sqrt((s**2).mean()):.3f} | "
            f"{np.mean(e < s):.2f} | {np.mean(e < 1.96 * s):.2f} | {100 * lost / count:.1f} % | {wrong} |"
        )


def traction(one: Scene, kind: str, rng: np.random.Generator) -> np.ndarray:
    """(component, y, x) [Pa] of what presses: Hertz with q = mu p or Lubkin's torsion cut off at mu p; an edge: a wedge-like strip, parabolic across."""
    grid = one.surface
    x, y = (grid.x[None, :], grid.axes[0][:, None])
    x, y = x - float(rng.uniform(-2e-3, 2e-3)), y - float(rng.uniform(-1.5e-3, 1.5e-3))
    force, turn = float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.0, 2.0 * np.pi))
    if "edge" in kind:
        along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        p = np.clip(1.0 - (across / 1.2e-3) ** 2, 0.0, None) * np.clip(1.0 - (along / 3.5e-3) ** 4, 0.0, None)
        p *= force / (p.sum() * grid.cell)
    else:
        a = float(rng.uniform(2e-3, 3e-3))
        r = np.hypot(x, y)
        p = 1.5 * force / (np.pi * a**2) * np.sqrt(np.clip(1.0 - (r / a) ** 2, 0.0, None))
    q = np.zeros((2, *p.shape))
    if "sliding" in kind:
        q[:] = FRICTION * p * np.array([np.cos(2 * turn), np.sin(2 * turn)])[:, None, None]
    elif "twisted" in kind:
        rising = 0.3 * FRICTION * p.max() * (r / a) / np.sqrt(np.clip(1.0 - (r / a) ** 2, 1e-6, None))
        size = np.where(r < a, np.minimum(FRICTION * p, rising), 0.0)
        q[:] = size * np.stack([-y * np.ones_like(r), x * np.ones_like(r)]) / np.maximum(r, 1e-12)
    return np.stack([*q, p])


def depth_map(one: Scene, true: np.ndarray, rng: np.random.Generator) -> DepthMap:
    """Depth of the surface every half millimetre where something presses in the last picture, known to 5 um; nowhere in the others."""
    y, x = (np.arange(-n, n + 1) * 0.5e-3 for n in (12, 16))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = one.surface
    row, column = (np.abs(axis[:, None] - places[:, 1 - i]).argmin(axis=0) for i, axis in enumerate(grid.axes))
    known = true[2][row, column] > 0
    array = pp.ScatteredArray(positions=places[known], depth=0.0, channels=["displacement_z"])
    pressed = np.asarray(pp.Skin(GEL, array, surface=grid).sense(true)).ravel()
    found = np.full(len(places), np.nan)
    found[known] = pressed + DEPTH_NOISE * rng.standard_normal(pressed.shape)
    return DepthMap(
        positions=places, depth=lambda index: found if index == 5 else np.full(len(places), np.nan), std=DEPTH_NOISE
    )


def on_grid(field: np.ndarray, fine: pp.AreaGrid, grid: pp.AreaGrid) -> np.ndarray:
    """Means of a field over the cells of a coarser grid, whose cells are not whole numbers of the finer one's."""
    out = field
    for axis in (0, 1):
        edges = [
            np.append(g.axes[axis] - 0.5 * g.spacings[axis], g.axes[axis][-1] + 0.5 * g.spacings[axis])
            for g in (fine, grid)
        ]
        whole = np.insert(np.cumsum(np.moveaxis(out, axis, 0), axis=0), 0, 0.0, axis=0) * fine.spacings[axis]
        at = np.stack([np.interp(edges[1], edges[0], column) for column in whole.T], axis=1)
        out = np.moveaxis(np.diff(at, axis=0) / grid.spacings[axis], 0, axis)
    return out


def force(base: Scene, frames: int) -> Iterator[str]:
    yield "| object | method | force error | shear error (of the force) | pressure error | force inside 95 % | shear inside 95 % | peak inside 95 % | seconds |"
    yield "|---" * 9 + "|"
    array = pp.AreaArray(shape=(7, 9), pitch=PITCH, depth=DEPTH, channels=CHANNELS)
    skin = pp.Skin(GEL, array, uncertainty=EXACT)
    for kind in KINDS:
        rows: dict[str, list[list[float]]] = {
            "single picture": [],
            f"single picture, friction {FRICTION:g}": [],
            "single picture, with depth": [],
            "tracked": [],
        }
        for index in range(frames):
            one, rng = scene(base, index), np.random.default_rng((3, index, KINDS.index(kind)))
            true = traction(one, kind, rng)
            load = true.sum(axis=(1, 2)) * one.surface.cell
            story = [None] * 5 + [p * true for p in (0.25, 0.5, 0.75)] + [true] * 4
            pictures = [one.picture(part, rng=rng) for part in story]
            deep = depth_map(one, true, rng)
            for label in rows:
                options: dict[str, Any] = {"friction": FRICTION} if "friction" in label else {}
                if "depth" in label:
                    options["depth_map"] = deep
                start = time.process_time()
                alone = label != "tracked"
                shown = pictures[:5] + pictures[-1:] if alone else pictures
                with follow(
                    shown,
                    skin,
                    view=one.view,
                    rate=None if alone else 30.0,
                    track=not alone,
                    every=5 if alone else 1,
                    **options,
                ) as touches:
                    touch = list(touches)[-1]
                spent = time.process_time() - start
                low, high = (np.asarray(end) for end in touch.interval(0.95, "force"))
                held = (low <= load) & (load <= high)
                off = np.asarray(touch.force) - load
                pressure = on_grid(true[2], one.surface, touch.surface)
                error = float(np.linalg.norm(np.asarray(touch.values)[2] - pressure) / np.linalg.norm(pressure))
                ends = [float(end) for end in touch.interval(0.95, "peak_pressure")]
                rows[label].append(
                    [
                        abs(off[2]) / load[2],
                        float(np.hypot(*off[:2])) / load[2],
                        error,
                        float(held[2]),
                        float(held[:2].mean()),
                        float(ends[0] <= float(pressure.max()) <= ends[1]),
                        spent / (1 if alone else len(shown)),
                    ]
                )
        for label, found in rows.items():
            yield f"| {kind} | {label} | " + " | ".join(f"{v:.2f}" for v in np.mean(found, axis=0)) + " |"


def rate(base: Scene) -> Iterator[str]:
    import cv2

    cv2.setNumThreads(1)
    yield "| pictures | dots or places | decode [ms] | find and follow [ms] | track [ms] | pictures a second |"
    yield "|---" * 6 + "|"
    dots, speckles = Dots(dot_grid((7, 9), PITCH), DIAMETER), Texture(0.15e-3)
    shown: list[tuple[tuple[int, int], float, Dots | Texture]] = [
        (SIZE, SCALE, dots),
        ((640, 480), SCALE / 2.0, dots),
        ((160, 120), 2.0 * SCALE, speckles),
        (SIZE, SCALE, speckles),
    ]
    for size, scale, print_ in shown:
        one = Scene(pad=GEL, depth=DEPTH, print=print_, size=size, scale=scale)
        rng = np.random.default_rng(0)
        ball = one.skin.sample(pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.0).sliding(0.3))
        with tempfile.TemporaryDirectory() as folder:
            write_video(
                f"{folder}/a.mp4",
                [one.picture(p * ball if p else None, rng=rng) for p in [0.0] * 6 + [0.5, 0.8, 1.0, 1.0, 1.0, 1.0]],
            )
            started = time.process_time()
            with open_pictures(f"{folder}/a.mp4") as source:
                images = [p.image for p in source]
            decode = (time.process_time() - started) / len(images)
        markers = Markers(images[:5]) if print_ is dots else Flow(images[:5], spacing=1.5e-3 / scale)
        skin = gel_skin(
            pp.Skin(GEL, pp.AreaArray(shape=(7, 9), pitch=PITCH, depth=DEPTH, channels=CHANNELS)),
            one.view.places(markers.positions),
        )
        spent: dict[str, list[float]] = {"follow": [], "track": []}
        with skin.track(baseline=5) as tracker:
            for repeat in range(3):
                for image in images[5 * (repeat > 0) :]:
                    started = time.process_time()
                    moved = markers.follow(image)
                    spent["follow"].append(time.process_time() - started)
                    values = (
                        one.view.places(markers.positions + moved.displacement) - one.view.places(markers.positions)
                    ).T
                    started = time.process_time()
                    tracker.step(values)
                    spent["track"].append(time.process_time() - started)
        each = [1e3 * decode, *(1e3 * float(np.median(v)) for v in spent.values())]
        yield (
            f"| {size[0]} x {size[1]}, {'dots' if print_ is dots else 'texture every 1.5 mm'} | {len(markers.positions)} | "
            + " | ".join(f"{v:.1f}" for v in each)
            + f" | {1e3 / sum(each):.0f} |"
        )


def source(base: Scene, seconds: float, wall: bool) -> Iterator[str]:
    """`palpate live --camera` on a stand-in, whose pictures come by a clock of their own."""
    shown: list[tuple[str, tuple[int, int], float, Dots | Texture]] = [
        ("320 x 240, 63 dots", SIZE, SCALE, base.print),
        ("640 x 480, 63 dots", (640, 480), SCALE / 2.0, base.print),
        ("160 x 120, texture every 1.5 mm", (160, 120), 2.0 * SCALE, Texture(0.15e-3)),
    ]
    scenes = []
    for label, size, scale, print_ in shown:
        where = f'scale = "{1e3 * scale:g} mm"\n' + ("" if print_ is base.print else 'texture = "1.5 mm"\n')
        scenes.append((label, Scene(pad=GEL, depth=DEPTH, print=print_, size=size, scale=scale), gel_file(where)))
    yield from camera_source.rates(scenes, seconds, wall=wall)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "tables", nargs="*", choices=["displacement", "texture", "force", "rate", "source", []], help="default: all"
    )
    parser.add_argument("--seeds", type=int, default=5, help="prints and contacts of each row of displacement")
    parser.add_argument("--frames", type=int, default=4, help="contacts of each kind")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each camera of source")
    parser.add_argument("--wall", action="store_true", help="source by the clock, beside whatever else runs")
    parser.add_argument("--markdown", type=Path, help="file for the tables; those that are not made stay as they are")
    args = parser.parse_args()
    base = Scene(pad=GEL, depth=DEPTH, print=Dots(dot_grid((7, 9), PITCH), DIAMETER), size=SIZE, scale=SCALE)
    makers = {
        "displacement": lambda: displacement(base, args.seeds),
        "texture": lambda: texture(base, max(1, args.seeds // 2)),
        "force": lambda: force(base, args.frames),
        "rate": lambda: rate(base),
        "source": lambda: source(base, args.seconds, args.wall),
    }
    lines: list[str] = []
    before = args.markdown.read_text() if args.markdown is not None and args.markdown.exists() else ""
    for name, maker in makers.items():
        if args.tables and name not in args.tables:
            # what is not made again is kept
            found = re.search(rf"\n## {name.capitalize()}\n.*?(?=\n## |\Z)", before, re.S)
            lines += [found[0].rstrip("\n")] if found else []
            continue
        asked = {
            "force": f" --frames {args.frames}",
            "rate": "",
            "source": f" --seconds {args.seconds:g}" + " --wall" * args.wall,
        }.get(name, f" --seeds {args.seeds}")
        lines += [f"\n## {name.capitalize()}\n", f"Made by `python benchmarks/camera.py {name}{asked}`.\n"]
        for line in maker():
            print(line, flush=True)
            lines.append(line)
    if args.markdown is not None:
        args.markdown.write_text("# From pictures to force\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
