"""Normal force from markers that only move sideways: balls on a bonded gel, with two displacements and with all three.

A gel of 3.5 mm (200 kPa, Poisson's ratio 0.48) on a rigid base, 8 x 8 markers or more over 16 x 16 mm; balls of random force, width and place that press
without friction, slide, stick in the middle, or twist; 1 % noise. Readings are made on cells four times finer than those of the result.

    python benchmarks/in_plane.py                                  # table, a few minutes
    python benchmarks/in_plane.py --frames 20 --markdown in_plane.md
    python benchmarks/in_plane.py --counts 24 32 --frames 3 --displacements "in the plane"
    python benchmarks/in_plane.py --image still shifted turned --depths 0.5 --displacements "in the plane"

A "shifted" or "turned" image moves all markers, or those at the ends of the axes, by a fifth of the largest displacement. Frames without a number
are counted, and are in no mean.
"""

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.sensing.grids import block_means, refined
from palpate.sensing.uncertainty import EXACT

GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=200e3, poissons_ratio=0.48)])
WIDTH, FINER, NOISE, FRICTION = 16e-3, 4, 0.01, 0.4
CHANNELS = {
    "in the plane": ["displacement_x", "displacement_y"],
    "all three": ["displacement_x", "displacement_y", "displacement_z"],
}
IMAGES = ("still", "shifted", "turned")
MOVED = 0.2
KINDS = ("frictionless", "sliding", "sticking", "twisted")
QUANTITIES = (
    "force error",
    "pressure error",
    "shear error",
    "force covered",
    "shear force covered",
    "peak covered",
    "cells covered",
    "seconds",
)


def moved(image: str, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Displacements (2, *shape) of the markers by the camera, of size 1."""
    if image == "still":
        return np.zeros((2, *shape))
    if image == "shifted":
        angle = float(rng.uniform(0.0, 2.0 * np.pi))
        return np.broadcast_to(np.array([np.cos(angle), np.sin(angle)])[:, None, None], (2, *shape))
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    return float(rng.choice([-1.0, 1.0])) * np.stack([-y, x])


def ball(kind: str, grid: pp.AreaGrid, rng: np.random.Generator) -> np.ndarray:
    """Traction (component, *grid) [Pa] of a Hertz contact: q = mu p, Cattaneo's and Mindlin's q, or Lubkin's torsion cut off at mu p."""
    force, a = float(rng.uniform(0.5, 3.0)), float(rng.uniform(2e-3, 4e-3))
    x = grid.x[None, :] - float(rng.uniform(-2e-3, 2e-3))
    y = grid.axes[0][:, None] - float(rng.uniform(-2e-3, 2e-3))
    r = np.hypot(x, y)
    peak = 1.5 * force / (np.pi * a**2)
    p = peak * np.sqrt(np.clip(1.0 - (r / a) ** 2, 0.0, None))
    q = np.zeros((2, *p.shape))
    angle = float(rng.uniform(0.0, 2.0 * np.pi))
    if kind in ("sliding", "sticking"):
        c = 0.0 if kind == "sliding" else a * float(rng.uniform(0.4, 0.8))
        stuck = peak * c / a * np.sqrt(np.clip(1.0 - (r / max(c, 1e-12)) ** 2, 0.0, None))
        q[:] = FRICTION * (p - stuck) * np.array([np.cos(angle), np.sin(angle)])[:, None, None]
    elif kind == "twisted":
        rising = 0.3 * FRICTION * peak * (r / a) / np.sqrt(np.clip(1.0 - (r / a) ** 2, 1e-6, None))
        size = np.where(r < a, np.minimum(FRICTION * p, rising), 0.0)
        q[:] = size * np.stack([-y * np.ones_like(r), x * np.ones_like(r)]) / np.maximum(r, 1e-12)
    return np.stack([*q, p])


def held(touch: pp.Touch, of: str, true: np.ndarray) -> np.ndarray:
    low, high = (np.asarray(v) for v in touch.interval(0.95, of))
    return (low <= true) & (true <= high)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=8, help="balls of each row")
    parser.add_argument("--counts", type=int, nargs="*", default=[8], help="markers along a side")
    parser.add_argument("--depths", type=float, nargs="*", default=[0.5, 0.0], help="of the markers [mm]")
    parser.add_argument("--displacements", nargs="*", choices=list(CHANNELS), default=list(CHANNELS))
    parser.add_argument("--image", nargs="*", choices=IMAGES, default=["still"], help="motion of the camera")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--markdown", type=Path, help="file for the table")
    args = parser.parse_args()
    lines = [
        f"| markers | displacements | image | ball | friction | without a number | {' | '.join(QUANTITIES)} |",
        "|---" * 14 + "|",
    ]
    for count, depth, image in itertools.product(args.counts, [1e-3 * d for d in args.depths], args.image):
        for label in args.displacements:
            channels = CHANNELS[label]
            array = pp.AreaArray(shape=(count, count), pitch=WIDTH / count, depth=depth, channels=channels)
            skin = pp.Skin(GEL, array, uncertainty=EXACT)
            maker = pp.Skin(GEL, array, surface=refined(skin.surface, FINER, 0))
            for kind in KINDS:
                for friction in (None, FRICTION):
                    found = []
                    for index in range(args.frames):
                        rng = np.random.default_rng((args.seed, index, KINDS.index(kind)))
                        fine = ball(kind, maker.surface, rng)
                        truth = pp.Touch(block_means(fine, FINER, 2), skin.surface, ("x", "y", "z"), "truth")
                        clean = np.asarray(maker.sense(fine))
                        top = float(np.abs(clean).max())
                        readings = clean + NOISE * top * rng.standard_normal(clean.shape)
                        readings[:2] += MOVED * top * moved(image, array.shape, rng)
                        start = time.process_time()
                        touch = skin.reconstruct(readings, **({} if friction is None else {"friction": friction}))
                        seconds = time.process_time() - start
                        if not np.isfinite(touch.force).all():
                            continue
                        error = np.asarray(touch.values) - np.asarray(truth.values)
                        size = float(np.linalg.norm(truth.values[2]))
                        forces = held(touch, "force", np.asarray(truth.force))
                        on = np.asarray(truth.values[2]) > 0
                        found.append(
                            [
                                abs(float(touch.force[2] / truth.force[2]) - 1.0),
                                float(np.linalg.norm(error[2])) / size,
                                float(np.linalg.norm(error[:2])) / size,
                                float(forces[2]),
                                float(forces[:2].mean()),
                                float(held(touch, "peak_pressure", np.asarray(truth.peak_pressure))),
                                float(held(touch, "traction", np.asarray(truth.values))[2][on].mean()),
                                seconds,
                            ]
                        )
                    mean = np.mean(found, axis=0) if found else np.full(len(QUANTITIES), np.nan)
                    told = "not known" if friction is None else f"{friction:g}"
                    numbers = " | ".join(f"{v:.2f}" for v in mean)
                    lines.append(
                        f"| {count} x {count}, {1e3 * depth:g} mm deep | {label} | {image} | {kind} | {told} | {args.frames - len(found)} | {numbers} |"
                    )
                    print(lines[-1], flush=True)
    if args.markdown is not None:
        counts = " ".join(map(str, args.counts))
        depths = " ".join(f"{d:g}" for d in args.depths)
        which = "" if args.displacements == list(CHANNELS) else f' --displacements "{args.displacements[0]}"'
        which += "" if args.image == ["still"] else f" --image {' '.join(args.image)}"
        made = f"Made by `python benchmarks/in_plane.py --counts {counts} --depths {depths} --frames {args.frames}{which}`.\n"
        args.markdown.write_text("\n".join([made, *lines]) + "\n")


if __name__ == "__main__":
    main()
