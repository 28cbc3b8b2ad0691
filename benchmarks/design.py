"""What a design promises beside what the reconstruction does: bounds, Monte-Carlo errors, and designs a minute.

    python benchmarks/design.py                 the tables
    python benchmarks/design.py --write         writes docs/_generated/design.md
    python benchmarks/design.py --draws 20      fewer draws (default 16)
    python benchmarks/design.py --offsets       the comparison where every channel has an unknown offset (slow)

A ball presses and drags on 12 skins; pad and sensors are known exactly, the noise is given, and what else readings may hold is told: nothing (nuisance=()), or
an offset of each channel, drawn anew for each frame (a twentieth of its largest reading), that the reconstruction must find by itself. The error is the root mean square over draws of force and
centre, of frames that the reconstruction does not itself call rough, as `Skin.reconstruct` gives them with nothing tuned; the bound is that of `Skin.design` for a ball of unknown force, place and radius.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.design import Press, place, sweep

OUT = Path(__file__).parents[1] / "docs" / "_generated" / "design.md"
EXACT = pp.Uncertainty(youngs_modulus=0.0, thickness=0.0, depth=0.0, gain=0.0, scale=0.0)
SHEAR = ["stress_xz", "stress_yz", "stress_zz"]
MOVED = ["displacement_x", "displacement_y", "displacement_z"]
HALF = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.5)


def glued(thickness: float) -> pp.BondedLayers:
    return pp.BondedLayers([pp.Layer(thickness=thickness, youngs_modulus=3e5, poissons_ratio=0.48)])


def area(side: int, pitch: float, depth: object, channels: list[str], noise: float) -> pp.AreaArray:
    return pp.AreaArray(
        shape=(side, side), pitch=pitch, depth=depth, channels=channels, noise=noise, aperture=0.3 * pitch
    )


#: (name, pad, array, contact radius)
DESIGNS = [
    ("8 x 8, 2 mm apart, 1 mm deep, pressure", HALF, area(8, 2e-3, 1e-3, ["stress_zz"], 300.0), 3e-3),
    ("8 x 8, 2 mm apart, 2 mm deep, pressure", HALF, area(8, 2e-3, 2e-3, ["stress_zz"], 300.0), 3e-3),
    ("8 x 8, 2 mm apart, 4 mm deep, pressure", HALF, area(8, 2e-3, 4e-3, ["stress_zz"], 300.0), 3e-3),
    ("8 x 8, 2 mm apart, 2 mm deep, ten times the noise", HALF, area(8, 2e-3, 2e-3, ["stress_zz"], 3000.0), 3e-3),
    ("12 x 12, 1.3 mm apart, 2 mm deep, pressure", HALF, area(12, 1.3e-3, 2e-3, ["stress_zz"], 300.0), 3e-3),
    ("5 x 5, 4 mm apart, 2 mm deep, pressure", HALF, area(5, 4e-3, 2e-3, ["stress_zz"], 300.0), 3e-3),
    ("8 x 8, 2 mm apart, 2 mm deep, with shear", HALF, area(8, 2e-3, 2e-3, SHEAR, 300.0), 3e-3),
    ("8 x 8, at the base of 3 mm, pressure", glued(3e-3), area(8, 2e-3, "base", ["stress_zz"], 300.0), 3e-3),
    ("8 x 8, at the base of 3 mm, with shear", glued(3e-3), area(8, 2e-3, "base", SHEAR, 300.0), 3e-3),
    ("8 x 8, at the base of 3 mm, with shear, small contact", glued(3e-3), area(8, 2e-3, "base", SHEAR, 300.0), 1.5e-3),
    ("8 x 8, 1 mm deep in 4 mm, three displacements", glued(4e-3), area(8, 2e-3, 1e-3, MOVED, 3e-6), 3e-3),
    ("4 x 4, 4 mm apart, at the base of 4 mm, with shear", glued(4e-3), area(4, 4e-3, "base", SHEAR, 300.0), 3e-3),
]
FRICTION, SHARE, FORCE = 0.6, 0.3, 1.0
#: A force whose 95 % interval reaches farther than this part of the load is called rough, as notes of a touch do.
ROUGH = 0.3


def compared(
    pad: pp.HalfSpace, array: pp.AreaArray, radius: float, draws: int, *, offsets: bool
) -> tuple[dict[str, tuple[float, float]], int]:
    """Bound and error (root mean square) of each number, and how many frames the reconstruction calls rough."""
    skin = pp.Skin(pad, array, uncertainty=EXACT, nuisance="auto" if offsets else ())
    both = "x" in skin.components
    bound = skin.design(force=FORCE, contact_radius=radius, shear=SHARE if both else 0.0, friction=FRICTION).known
    ball = pp.solutions.hertz_point(contact_radius=radius, force=FORCE)
    exact = skin.sense(ball.sliding(SHARE) if both else ball)
    rng = np.random.default_rng(1)
    readings = exact + array.sample_noise(rng, (draws,))
    if offsets:
        largest = np.abs(exact).max(axis=(1, 2), keepdims=True)
        readings = readings + 0.05 * largest * rng.standard_normal((draws, len(exact), 1, 1))
    touch = skin.reconstruct(readings)
    force, center = np.asarray(touch.force), np.asarray(touch.center_of_pressure)
    low, high = (np.asarray(end)[:, 2] for end in touch.interval(0.95, of="force"))
    rough = ~(0.5 * (high - low) < ROUGH * FORCE)
    z = skin.components.index("z")

    def error(values: np.ndarray, truth: float) -> float:
        return float(np.sqrt(np.mean((values[~rough] - truth) ** 2)))

    column = {"x": 0, "y": 1, "z": 2}
    out = {
        "force": (float(bound.force[z]), error(force[:, column["z"]], FORCE)),
        "centre": (float(bound.center[0]), error(center[:, 0], 0.0)),
    }
    if both:
        out["shear"] = (float(bound.force[skin.components.index("x")]), error(force[:, column["x"]], SHARE * FORCE))
    return out, int(rough.sum())


def bounds(draws: int, *, offsets: bool) -> list[str]:
    lines = [
        f"{'Offsets of every channel unknown' if offsets else 'No offsets'}: bound and error of {draws} frames each.",
        "",
        "| design | rough frames | force bound [mN] | error | ratio | shear bound [mN] | error | ratio | centre bound [um] | error | ratio |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, pad, array, radius in DESIGNS:
        found, rough = compared(pad, array, radius, draws, offsets=offsets)
        cells = [str(rough)]
        for key, factor in (("force", 1e3), ("shear", 1e3), ("centre", 1e6)):
            if key in found:
                bound, error = found[key]
                cells += [f"{factor * bound:.3g}", f"{factor * error:.3g}", f"{error / bound:.2f}"]
            else:
                cells += ["", "", ""]
        lines.append(f"| {name} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
    return [*lines, ""]


def line_load() -> list[str]:
    """Localisation of a line load: 0.853 sqrt(pitch depth)/SNR."""
    lines = ["| pitch [mm] | depth [mm] | bound [um] | 0.853 sqrt(pitch depth)/SNR [um] |", "|---|---|---|---|"]
    for pitch, depth in ((0.25e-3, 1e-3), (0.5e-3, 1e-3), (0.5e-3, 2e-3), (1e-3, 2e-3), (1e-3, 4e-3)):
        array = pp.LineArray(count=401, pitch=pitch, depth=depth, channels=["stress_zz"], noise=100.0)
        force = 100.0
        found = pp.Skin(HALF, array).design(force=force, contact_radius=0.05 * depth).known.center[0]
        ratio = 2.0 * force / (np.pi * depth) / 100.0
        lines.append(
            f"| {1e3 * pitch:g} | {1e3 * depth:g} | {1e6 * found:.3f} | {1e6 * 0.853 * np.sqrt(pitch * depth) / ratio:.3f} |"
        )
    return lines


def pace(jobs: int) -> list[str]:
    """Designs a minute."""
    lines = [
        "| pad | array | designs | processor time a design [s] | designs a minute of processor time | on the clock |",
        "|---|---|---|---|---|---|",
    ]
    for name, pad in (("half-space", HALF), ("layer on a rigid base", glued(4e-3))):
        skin = pp.Skin(pad, area(8, 2e-3, 2e-3, ["stress_zz"], 300.0))
        values = {
            "depth": [1e-3, 1.5e-3, 2e-3, 3e-3],
            "pitch": [1.5e-3, 2e-3, 3e-3],
            "channels": [["stress_zz"], SHEAR],
        }
        sweep(skin, press=Press(force=1.0, contact_radius=3e-3), depth=[2e-3])
        began, clock = time.process_time(), time.perf_counter()
        found = sweep(skin, press=Press(force=1.0, contact_radius=3e-3), **values)
        took, passed = time.process_time() - began, time.perf_counter() - clock
        lines.append(
            f"| {name} | 8 x 8, 1 or 3 channels | {len(found)} | {took / len(found):.2f} | {60.0 * len(found) / took:.0f} | {60.0 * len(found) / passed:.0f} |"
        )
    return lines


def pictures() -> None:
    """Those of docs/howto/design.md."""
    pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
    how = {"aperture": 1e-3, "noise": 300.0}
    array = pp.AreaArray(shape=(8, 8), pitch=3e-3, depth=2e-3, channels=["stress_zz"], limits=(0.0, 60e3), **how)
    skin = pp.Skin(pad, array)
    press = Press(force=1.0, contact_radius=3e-3, shear=0.3, friction=0.6)
    channels = [["stress_zz"], SHEAR]
    found = sweep(
        skin, press=press, depth=[1e-3, 1.5e-3, 2e-3, 2.5e-3, 3e-3, 3.5e-3], channels=channels, goals={"pair": 3e-3}
    )
    few = pp.AreaArray(shape=(4, 5), pitch=4e-3, depth=3e-3, channels=["stress_zz"], **how)
    made = {
        "tradeoffs": found.plot("depth"),
        "seen": skin.design(force=1.0, contact_radius=3e-3).plot(),
        "places": place(pp.Skin(pad, few), count=20, extent=(20e-3, 16e-3)).plot(),
    }
    for name, figure in made.items():
        figure.savefig(OUT.parents[1] / "_static" / f"design-{name}.png", dpi=160)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--draws", type=int, default=16)
    parser.add_argument("--pace", action="store_true", help="only how fast it is")
    parser.add_argument("--offsets", action="store_true", help="only the comparison where offsets are unknown (slow)")
    parser.add_argument("--pictures", action="store_true", help="only the pictures of docs/howto/design.md")
    given = parser.parse_args()
    if given.offsets:
        print("\n".join(bounds(given.draws, offsets=True)))
        return
    if given.pictures:
        pictures()
        return
    if given.pace:
        print("\n".join(pace(1)))
        return
    text = "\n".join(
        [
            "<!-- python benchmarks/design.py --write -->",
            "",
            "**The bound, and the error of the reconstruction**",
            "",
            *bounds(given.draws, offsets=False),
            "**A line load**",
            "",
            *line_load(),
            "",
            "**Designs a minute, one process**",
            "",
            *pace(1),
            "",
        ]
    )
    print(text)
    if given.write:
        OUT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
