"""Markers in a gel that are followed in the plane: error, coverage and time, frame by frame and tracked, with the surface that is used when none is given.

A gel of 4 mm (300 kPa, Poisson's ratio 0.48) on a window, 6 x 8 markers some 2 mm apart (their places are off a grid by 0.1 mm) and 0.5 mm deep, displacement_x and
displacement_y with noise of 2 um that is stated. Balls press (and stick a little), slide, and slide at the array's corner. Truth is made on cells of a quarter millimetre.

    python benchmarks/markers.py                                    # table, some minutes
    python benchmarks/markers.py --frames 21 --seed 7 --markdown docs/_generated/markers.md
    python benchmarks/markers.py --alone --kinds corner --cells 2 3  # surfaces of two and three cells a distance of markers
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.sensing.uncertainty import EXACT

GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
SHAPE, PITCH, JITTER, NOISE, FRICTION = (6, 8), 2e-3, 1e-4, 2e-6, 0.5
CHANNELS = ["displacement_x", "displacement_y"]
KINDS = ("pressed", "sliding", "corner")
HEAD = (
    "contact",
    "solved",
    "frames",
    "force error",
    "largest",
    "shear error (of the force)",
    "largest",
    "force covered",
    "shear covered",
    "width of the force's interval",
    "not answered",
    "seconds, median",
    "largest",
)


def markers(seed: int) -> np.ndarray:
    """Positions (n, 2) [m] that are nearly a grid."""
    rng = np.random.default_rng((4, seed))
    y, x = (PITCH * (np.arange(n) - 0.5 * (n - 1)) for n in SHAPE)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + JITTER * rng.standard_normal((len(x) * len(y), 2))


def contact(kind: str, grid: pp.AreaGrid, rng: np.random.Generator) -> np.ndarray:
    """Traction (component, y, x) [Pa] of a ball: Hertz with q = mu p where it slides, else Cattaneo's and Mindlin's."""
    half = 0.5 * PITCH * (np.array(SHAPE[::-1]) - 1.0)
    if kind == "corner":
        middle = (half + rng.uniform(-2e-3, 1e-3, 2)) * rng.choice([-1.0, 1.0], 2)
    else:
        middle = rng.uniform(-0.6, 0.6, 2) * half
    force, a = float(rng.uniform(0.5, 2.0)), float(rng.uniform(1.5e-3, 3e-3))
    turn = float(rng.uniform(0.0, 2.0 * np.pi))
    r = np.hypot(grid.x[None, :] - middle[0], grid.axes[0][:, None] - middle[1])
    peak = 1.5 * force / (np.pi * a**2)
    p = peak * np.sqrt(np.clip(1.0 - (r / a) ** 2, 0.0, None))
    c = a * float(rng.uniform(0.5, 1.0)) if kind == "pressed" else 0.0
    stuck = peak * c / a * np.sqrt(np.clip(1.0 - (r / max(c, 1e-12)) ** 2, 0.0, None))
    mu = float(rng.uniform(0.2, FRICTION))
    return np.stack([mu * np.cos(turn) * (p - stuck), mu * np.sin(turn) * (p - stuck), p])


def skin_of(seed: int, depth: float, cells: float | None, *, stated: bool = True) -> pp.Skin:
    noise = NOISE if stated else None
    array = pp.ScatteredArray(positions=markers(seed), depth=depth, channels=CHANNELS, noise=noise)
    skin = pp.Skin(GEL, array, uncertainty=EXACT)
    if cells is None:
        return skin
    grid, step = skin.surface, PITCH / cells
    shape = tuple(int(np.ceil(n * s / step)) for n, s in zip(grid.shape, grid.spacings))
    return pp.Skin(GEL, array, surface=pp.AreaGrid(shape=shape, spacing=step, center=grid.center))


def rows(
    kinds: list[str], *, frames: int, seed: int, depth: float, cells: float | None, alone: bool, tracked: bool
) -> Iterator[str]:
    yield "| " + " | ".join(HEAD) + " |"
    yield "|---" * len(HEAD) + "|"
    half = 0.5 * PITCH * max(SHAPE) + 6e-3
    fine = pp.AreaGrid(shape=(2 * int(half / 0.25e-3),) * 2, spacing=0.25e-3)
    skin = skin_of(seed, depth, cells)
    maker = pp.Skin(GEL, skin.planes[0], surface=fine)
    for kind in kinds:
        for way in [*(["by itself"] if alone else []), *(["tracked"] if tracked else [])]:
            found, spent, missing = [], [], 0
            for index in range(frames):
                rng = np.random.default_rng((seed, index, KINDS.index(kind)))
                true = contact(kind, fine, rng)
                load = true.sum(axis=(1, 2)) * fine.cell
                clean = np.asarray(maker.sense(true))

                def reading(part: float, clean: np.ndarray = clean, rng: np.random.Generator = rng) -> np.ndarray:
                    return part * clean + NOISE * rng.standard_normal(clean.shape)

                if way == "tracked":
                    with skin.track(baseline=5) as tracker:
                        for part in (0, 0, 0, 0, 0, 0.2, 0.5, 0.8, 1.0, 1.0, 1.0):
                            start = time.process_time()
                            touch = tracker.step(reading(part))
                            spent.append(time.process_time() - start)
                else:
                    start = time.process_time()
                    touch = skin.reconstruct(reading(1.0))
                    spent.append(time.process_time() - start)
                force = np.asarray(touch.force)
                if not np.isfinite(force).all():
                    missing += 1
                    continue
                low, high = (np.asarray(v) for v in touch.interval(0.95, "force"))
                held = (low <= load) & (load <= high)
                off = force - load
                found.append(
                    [
                        abs(off[2]) / load[2],
                        np.hypot(*off[:2]) / load[2],
                        held[2],
                        held[:2].mean(),
                        (high[2] - low[2]) / load[2],
                    ]
                )
            f = np.array(found, dtype=float).reshape(-1, 5)
            values = [
                f[:, 0].mean(),
                f[:, 0].max(),
                f[:, 1].mean(),
                f[:, 1].max(),
                f[:, 2].mean(),
                f[:, 3].mean(),
                f[:, 4].mean(),
            ]
            numbers = " | ".join(f"{v:.3f}" for v in values)
            yield f"| {kind} | {way} | {frames} | {numbers} | {missing} | {np.median(spent):.3f} | {max(spent):.3f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=6, help="contacts of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--depth", type=float, default=0.5, help="of the markers [mm]")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument(
        "--cells", type=float, nargs="*", help="cells a distance of markers (default: the surface as it is)"
    )
    parser.add_argument("--alone", action="store_true", help="frames by themselves only")
    parser.add_argument("--tracked", action="store_true", help="tracked only")
    parser.add_argument("--markdown", type=Path, help="file for the table")
    args = parser.parse_args()
    lines: list[str] = []
    for cells in args.cells or [None]:
        skin = skin_of(args.seed, 1e-3 * args.depth, cells)
        lines += [
            f"\nSurface of {skin.surface.shape[0]} x {skin.surface.shape[1]} cells of {1e3 * max(skin.surface.spacings):.2f} mm\n"
        ]
        print(lines[-1], flush=True)
        for line in rows(
            args.kinds,
            frames=args.frames,
            seed=args.seed,
            depth=1e-3 * args.depth,
            cells=cells,
            alone=not args.tracked,
            tracked=not args.alone,
        ):
            print(line, flush=True)
            lines.append(line)
    if args.markdown is not None:
        made = f"Made by `python benchmarks/markers.py --frames {args.frames} --seed {args.seed}`.\n"
        args.markdown.write_text("# Markers that are followed in the plane\n\n" + made + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
