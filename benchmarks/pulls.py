"""Pull beside or around a push, with and without an offset: the net force, its interval, and what is said.

    python benchmarks/pulls.py --frames 120 --seed 5                      one table
    python benchmarks/pulls.py --frames 300 --seed 41 --write             into docs/_generated/pulls.md
    python benchmarks/pulls.py --frames 120 --seed 5 --each               one line for each frame that is 25 % off, or whose interval excludes the truth

Arrays of 5 to 15 taxels a side, 0.6 to 2 mm under a half-space (85 %) or a glued layer, of three stresses (80 %) or three displacements of the surface.
A ball pushes. Beside it a smaller ball pulls (**beside**), or a flat punch of its size pulls at its rim, as adhesion does (K. L. Johnson, K. Kendall,
A. D. Roberts, Proc. R. Soc. A 324, 1971, 301-313): with 30 to 70 % of the push (**rim**) or 5 to 20 % (**weak rim**). Or the ball pulls (**pull**). Noise is
0.3 to 5 % of the largest reading, and given in 70 %. With **offset**, one channel of stress has an offset of 5 to 30 % of the largest reading.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.errors import PalpateError

TABLE = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "pulls.md"
KINDS = ("beside", "rim", "weak rim", "pull")
MODULUS, RATIO, PITCH = 2e5, 0.48, 1e-3
STRESSES = ("stress_xz", "stress_yz", "stress_zz")
MOVES = ("displacement_x", "displacement_y", "displacement_z")


@dataclass(frozen=True)
class Made:
    """One frame: the skin, its readings, the net normal force and the force of the push [N]."""

    kind: str
    side: int
    skin: pp.Skin
    readings: Floats
    force: float
    push: float


@dataclass(frozen=True)
class Judged:
    """What was found: error and width of the interval in parts of the push, whether it holds the truth, and whether there is a note."""

    error: float
    width: float
    inside: bool
    said: bool


def made(rng: np.random.Generator) -> Made:
    """One frame."""
    side, kind = int(rng.choice([5, 6, 8, 10, 12, 15])), str(rng.choice(KINDS))
    layer = [pp.Layer(thickness=4e-3, youngs_modulus=MODULUS, poissons_ratio=RATIO)]
    half_space = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=RATIO)
    pad = half_space if rng.random() < 0.85 else pp.BondedLayers(layer)
    depth, channels = float(rng.uniform(0.6, 2.0)) * PITCH, STRESSES
    if rng.random() > 0.8:
        depth, channels = 0.0, MOVES
    size, push = side * PITCH, float(rng.uniform(0.2, 2.0))
    radius, middle = float(rng.uniform(0.12, 0.25)) * size, rng.uniform(-0.15, 0.15, 2) * size
    plain = pp.Skin(pad, pp.AreaArray(shape=(side, side), pitch=PITCH, depth=depth, channels=list(channels)))
    readings = np.asarray(plain.sense(pp.solutions.hertz_point(contact_radius=radius, force=push).shifted(*middle)))
    pull = 0.0
    if kind == "beside":
        pull, angle = float(rng.uniform(0.1, 0.6)) * push, rng.uniform(0.0, 2.0 * np.pi)
        place = middle + (1.3 * radius + PITCH) * np.array([np.cos(angle), np.sin(angle)])
        other = pp.solutions.hertz_point(contact_radius=float(rng.uniform(1.0, 3.0)) * PITCH, force=pull)
        readings = readings - np.asarray(plain.sense(other.shifted(*place)))
    elif kind in ("rim", "weak rim"):
        pull = float(rng.uniform(0.3, 0.7) if kind == "rim" else rng.uniform(0.05, 0.2)) * push
        readings = readings - np.asarray(
            plain.sense(pp.solutions.flat_punch(radius=radius, force=pull).shifted(*middle))
        )
    else:
        readings, pull = -readings, 2.0 * push
    largest = float(np.abs(readings).max())
    noise = largest * 10.0 ** rng.uniform(-2.5, -1.3)
    readings = readings + noise * rng.standard_normal(readings.shape)
    if channels is STRESSES and rng.random() < 0.4:
        readings[rng.integers(3)] += largest * rng.uniform(0.05, 0.3) * rng.choice([-1.0, 1.0])
        kind += ", offset"
    given = noise if rng.random() < 0.7 else None
    array = pp.AreaArray(shape=(side, side), pitch=PITCH, depth=depth, channels=list(channels), noise=given)
    return Made(kind, side, pp.Skin(pad, array), readings, push - pull, push)


def judged(one: Made) -> tuple[Judged, str]:
    """What `palpate` finds, and a line about it."""
    touch = one.skin.reconstruct(one.readings)
    low, high = (float(end[2]) for end in touch.interval(0.95, "force"))
    found = float(touch.force[2])
    error = abs(found - one.force) / one.push if np.isfinite(found) else 1.0
    width = (high - low) / one.push
    verdict = Judged(error, width if np.isfinite(width) else np.inf, low <= one.force <= high, bool(touch.notes))
    line = f"{one.side} x {one.side}, {one.kind}: {found:.3g} ({low:.3g} to {high:.3g}) for {one.force:.3g} N"
    return verdict, line + ("" if verdict.inside else ", outside") + ("" if verdict.said else ", nothing said")


def table(frames: dict[str, list[Judged]], refused: int, command: str) -> str:
    """The page."""
    lines = [
        "# Pull beside or around a push",
        "",
        f"Made by `{command}`.",
        "",
        (__doc__ or "").split("\n\n")[-1].strip(),
    ]
    lines += ["Errors and widths are in parts of the force that pushes; of the pull alone, of its own."]
    lines += [f"Frames that were refused: {refused}.", ""]
    lines += [
        "| kind | frames | error: mean, median | within 95 % interval | width: median | outside and nothing said |"
    ]
    lines += ["|---|---|---|---|---|---|"]
    every = {**dict(sorted(frames.items())), "all": [j for js in frames.values() for j in js]}
    for kind, found in every.items():
        errors = [j.error for j in found]
        silent = sum(not j.inside and not j.said for j in found)
        lines.append(
            f"| {kind} | {len(found)} | {np.mean(errors):.3f}, {np.median(errors):.3f} | {np.mean([j.inside for j in found]):.0%} "
            f"| {np.median([j.width for j in found]):.2f} | {silent} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--each", action="store_true", help="one line for each frame that is off")
    parser.add_argument("--write", action="store_true", help="write pulls.md")
    given = parser.parse_args()
    rng, frames, refused = np.random.default_rng(given.seed), dict[str, list[Judged]](), 0
    warnings.simplefilter("ignore")
    for _ in range(given.frames):
        one = made(rng)
        try:
            found, line = judged(one)
        except PalpateError:
            refused += 1
            continue
        frames.setdefault(one.kind, []).append(found)
        if given.each and (found.error > 0.25 or not found.inside):
            print(line, flush=True)
    page = table(frames, refused, f"python benchmarks/pulls.py --frames {given.frames} --seed {given.seed} --write")
    if given.write:
        TABLE.write_text(page, encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
