"""Measured responses: tables of presses made from Boussinesq's solution, and presses elsewhere read with them and with the true pad beside.

    python benchmarks/measured.py [--write]

A half-space (Poisson's ratio 0.5) with 7 x 7 taxels of stress_zz 2.5 mm apart. A ball (contact radius 1 mm) presses with 1 N on a square grid of places over 16 x 16 mm; the
readings have noise of 2 % of the largest. Then 50 presses of other sizes (contact radius 1 to 2.5 mm, 0.3 to 3 N), in the middle 10 x 10 mm, with noise of 1 %
of their largest reading. `--write` writes docs/_generated/measured_responses.md.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.sensing import Operator

PAGE = Path(__file__).parents[1] / "docs" / "_generated" / "measured_responses.md"
GEL = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
RADIUS, NOISE, FRAMES = 1e-3, 0.02, 50


def table(array: pp.AreaArray, count: int, radius: float = RADIUS) -> pp.Measured:
    """What a robot would measure; ``radius`` is what it takes its indenter for."""
    skin = pp.Skin(GEL, array)
    line = np.linspace(-8e-3, 8e-3, count)
    places = [(x, y) for y in line for x in line]
    ball = pp.solutions.hertz_point(contact_radius=RADIUS, force=1.0)
    readings = np.stack([skin.sense(ball.shifted(*p)) for p in places])
    readings += NOISE * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    return pp.Measured.of(array, places=places, force=np.ones(len(places)), readings=readings, radius=radius)


def presses(real: pp.Skin, skin: pp.Skin) -> list[float]:
    """Root mean square of the force's error, its mean, the centre's error [mm], shares of intervals that hold both, half the force's interval."""
    rng, found = np.random.default_rng(3), []
    for _ in range(FRAMES):
        (x, y), load, radius = rng.uniform(-5e-3, 5e-3, 2), rng.uniform(0.3, 3.0), rng.uniform(1e-3, 2.5e-3)
        readings = real.sense(pp.solutions.hertz_point(contact_radius=radius, force=load).shifted(x, y))
        readings = readings + 0.01 * np.abs(readings).max() * rng.standard_normal(readings.shape)
        touch = skin.reconstruct(readings, components=["z"])
        (low, high), (left, right) = touch.interval(0.95, "force"), touch.interval(0.95, "center_of_pressure")
        off = np.asarray(touch.center_of_pressure) - [x, y]
        held = bool((left[0] <= x <= right[0]) and (left[1] <= y <= right[1]))
        found.append(
            (
                float(touch.force[2]) / load - 1.0,
                np.hypot(*off),
                low[2] <= load <= high[2],
                held,
                0.5 * (high[2] - low[2]) / load,
            )
        )
    force, center, inside, around, half = (np.array(c, dtype=float) for c in zip(*found))
    return [
        float(np.sqrt(np.mean(force**2))), float(force.mean()), 1e3 * float(np.sqrt(np.mean(center**2))), float(inside.mean()),
        float(around.mean()), float(np.median(half)),
    ]  # fmt: skip


def row(depth: float, count: int | None, radius: float = RADIUS) -> str:
    array = pp.AreaArray(shape=(7, 7), pitch=2.5e-3, depth=depth, channels=["stress_zz"])
    real = pp.Skin(GEL, array)
    if count is None:
        name, error, said, seconds, skin = "the true pad", 0.0, 0.0, 0.0, real
    else:
        pad = table(array, count, radius)
        start = time.perf_counter()
        skin = pp.Skin(pad, pad.array)
        seconds = time.perf_counter() - start
        grid = pp.AreaGrid(shape=(24, 24), spacing=0.6e-3)
        got = pad.response(array, grid).dense()[0, :, :, 2]
        true = Operator(GEL, [array], grid).planes[0].dense()[0, :, :, 2]
        error, said = float(np.sqrt(((got - true) ** 2).mean() / (true**2).mean())), float(pad.fit.error[0])
        name = f"{count} x {count} presses" + ("" if radius else ", the ball taken for a point")
    force, mean, center, inside, around, half = presses(real, skin)
    parts = [
        f"{1e3 * depth:g} mm", name, f"{100 * error:.1f} %", f"{100 * said:.1f} %", f"{100 * force:.1f} %", f"{100 * mean:+.1f} %", f"{inside:.2f}",
        f"+-{100 * half:.0f} %", f"{center:.2f} mm", f"{around:.2f}", f"{seconds:.1f} s",
    ]  # fmt: skip
    line = "| " + " | ".join(parts) + " |"
    print(line, flush=True)
    return line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    lines = [
        "Made by `python benchmarks/measured.py --write`.",
        "",
        "| depth of taxels | pad known from | error of the response to a point load | stated error | force error, root mean square | force error, mean | force inside 95 % | half-width of the "
        "interval | centre error | centre inside 95 % | preparation |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for depth in (2e-3, 3e-3):
        lines += [row(depth, 7), row(depth, 9), row(depth, None)]
    lines.append(row(2e-3, 9, 0.0))
    if options.write:
        PAGE.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
