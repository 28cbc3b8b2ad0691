"""Gels without dots: colour to slope to depth to force, on rendered gels whose shape and force are known in closed form.

Each gel has lamps, gloss, camera, noise and compression of its own (tests/colour_scenes.py), none of which the colour model knows. It is calibrated with 3, 5 or 10 presses of a ball of 8 mm at
random places, and then shown other contacts. Modulus and Poisson's ratio are known, so that errors of force are those of the pictures. Coverage: part of the 95 % intervals of the
normal force that hold the truth; width: half of the interval over the force.

    python benchmarks/colour_gel.py                                             # some five minutes on one core
    python benchmarks/colour_gel.py --gels 3 --markdown docs/_generated/colour_gel.md
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.camera import SlopeModel, View, feel, learn_slopes

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from colour_scenes import Ball, Flat, Gel, lamps, presses

E, NU = 3e5, 0.48
PLANE = E / (1.0 - NU**2)
DIAMETER = 8e-3
#: Gels of this page are drawn from this seed on; thresholds and ridges of the library were chosen on others (1 to 200).
SEED = 9000


def skin() -> pp.Skin:
    """A thick gel that is known exactly."""
    pad = pp.HalfSpace(youngs_modulus=E, poissons_ratio=NU)
    array = pp.AreaArray(shape=(3, 3), pitch=1e-3, depth=0.0, channels=["displacement_z"])
    return pp.Skin(pad, array, uncertainty=pp.Uncertainty(youngs_modulus=0.0, scale=0.0))


def calibrated(gel: Gel, count: int, rng: np.random.Generator) -> SlopeModel:
    balls = presses(gel, DIAMETER / 2, count, rng)
    pictures = [gel.picture(rng=rng), *(gel.picture([b], rng=rng) for b in balls)]
    return learn_slopes(pictures, View.scaled(gel.scale, size=gel.size), ball_diameter=DIAMETER)


def contacts(gel: Gel, rng: np.random.Generator) -> dict[str, list[Any]]:
    """Contacts by name."""
    place = presses(gel, 4e-3, 4, rng, contact=(0.3, 0.31))
    a = float(rng.uniform(0.9e-3, 1.6e-3))
    two = (
        Ball(3e-3, 0.9e-3, -4e-3, float(rng.uniform(-3e-3, 3e-3))),
        Ball(3e-3, 0.9e-3, 3.5e-3, float(rng.uniform(-3e-3, 3e-3))),
    )
    return {
        "ball of 8 mm": [Ball(4e-3, a, place[0].x, place[0].y)],
        "ball of 5 mm": [Ball(2.5e-3, 0.6 * a, place[1].x, place[1].y)],
        "ball of 16 mm": [Ball(8e-3, 1.3 * a, place[2].x * 0.8, place[2].y * 0.8)],
        "flat punch of 2.4 mm": [Flat(1.2e-3, float(rng.uniform(1e-4, 2.5e-4)), place[3].x, place[3].y)],
        "two balls": list(two),
        "nothing": [],
    }


def solved(model: SlopeModel, images: Sequence[Any], pad: pp.Skin) -> list[tuple[Any, Any]]:
    out = []
    with feel(list(images), pad, model=model) as touches:
        for touch in touches:
            out.append((touches.last, touch))
    return out


def row_of(gel: Gel, bodies: list[Any], relief: Any, touch: Any) -> dict[str, float]:
    force = sum(b.force(PLANE) for b in bodies)
    low, high = (float(v[2]) for v in touch.interval(0.95, "force"))
    found = float(touch.force[2])
    out = {"force": force, "found": found, "held": float(low <= force <= high), "touching": float(relief.touching)}
    if force:
        out["width"] = 0.5 * (high - low) / force
        if relief.near.any():
            truth = gel.depth(bodies)
            off = (relief.depth - truth)[relief.near]
            out["depth"] = float(np.std(off))
            out["peak"] = float(np.ptp(truth[relief.near]))
    return out


def summary(rows: list[dict[str, float]]) -> str:
    """Cells of a table."""
    seen = [r for r in rows if "depth" in r]
    depth = 1e6 * np.median([r["depth"] for r in seen]) if seen else np.nan
    part = 100.0 * np.median([r["depth"] / r["peak"] for r in seen]) if seen else np.nan
    errors = np.array([r["found"] / r["force"] - 1.0 for r in rows])
    return f"{len(rows)} | {sum(r['touching'] for r in rows):.0f} | {depth:.0f} um ({part:.0f} %) | {100 * np.median(np.abs(errors)):.0f} % | {100 * np.median(errors):+.0f} % | {np.mean([r['held'] for r in rows]):.2f} | {100 * np.median([r['width'] for r in rows]):.0f} %"


HEAD = "| {} | pictures | contact detected | depth error, rms near the contact (of its range) | force: median error | median bias | coverage | median half width |\n|---|---|---|---|---|---|---|---|"


def population(gels: int) -> Iterator[list[str]]:
    """The tables, after one gel more each time: a run that is broken off leaves those of what was done."""
    pad = skin()
    by: dict[str, list[dict[str, float]]] = {}
    count: dict[int, list[dict[str, float]]] = {}
    dotted: list[dict[str, float]] = []
    quiet, taught, seconds = [], [], []
    for k in range(gels):
        rng = np.random.default_rng(SEED + k)
        presses_of = (3, 5, 10)[k % 3]
        gel = Gel(lamps(rng), seed=k)
        start = time.process_time()
        model = calibrated(gel, presses_of, rng)
        taught.append(time.process_time() - start)
        shown = contacts(gel, rng)
        images = [gel.picture(bodies, rng=rng) for bodies in shown.values()]
        start = time.process_time()
        answers = solved(model, images, pad)
        seconds.append((time.process_time() - start) / len(images))
        for (name, bodies), (relief, touch) in zip(shown.items(), answers):
            one = row_of(gel, bodies, relief, touch)
            if not bodies:
                quiet.append(one)
                continue
            by.setdefault(name, []).append(one)
            count.setdefault(presses_of, []).append(one)
        printed = replace(gel, dots=2e-3)
        model = calibrated(printed, presses_of, rng)
        some = list(shown.values())[:1]
        answers = solved(model, [printed.picture(b, rng=rng) for b in some], pad)
        dotted += [row_of(printed, b, r, t) for b, (r, t) in zip(some, answers)]
        yield _tables(by, count, dotted, quiet, taught, seconds)


def _tables(by: Any, count: Any, dotted: Any, quiet: Any, taught: Any, seconds: Any) -> list[str]:
    lines = [HEAD.format("contact")]
    lines += [f"| {name} | {summary(rows)} |" for name, rows in by.items()]
    lines += [f"| all | {summary([r for rows in by.values() for r in rows])} |", "", HEAD.format("calibrated with")]
    lines += [f"| {n} presses | {summary(rows)} |" for n, rows in sorted(count.items())]
    lines += [
        "",
        HEAD.format("the same gels with printed dots, read by colour"),
        f"| ball of 8 mm | {summary(dotted)} |",
        "",
    ]
    false = sum(r["touching"] for r in quiet)
    lines += [
        f"Nothing touches: {len(quiet)} pictures, {false:.0f} with contact reported; the largest reported force is {1e3 * max(abs(r['found']) for r in quiet):.1f} mN.",
        "",
        f"Processor time, one core: {np.median(taught):.1f} s for a calibration, the pictures of this page included, {np.median(seconds):.1f} s for a picture.",
        "",
    ]
    return lines


def hard() -> list[str]:
    """Pictures that should be refused or doubted, and what was said of them."""
    pad = skin()
    rng = np.random.default_rng(SEED + 500)
    gel = Gel(lamps(rng), seed=77)
    gel = gel.changed(exposure=0.5)
    model = calibrated(gel, 8, rng)
    other = Gel(lamps(np.random.default_rng(SEED + 501)), seed=78)
    ball = [Ball(4e-3, 1.3e-3, 1e-3, 0.5e-3)]
    printed = replace(gel, dots=2e-3)
    bright = gel.changed(exposure=1.6)
    cases = [
        ("ball, as calibrated", gel.picture(ball, rng=rng), ball),
        ("ball, ten specks of dust", gel.picture(ball, rng=rng, dust=10), ball),
        ("no contact, ten specks of dust", gel.picture(rng=rng, dust=10), []),
        ("ball, light 15 % brighter", gel.changed(exposure=0.575).picture(ball, rng=rng), ball),
        ("ball, exposed so that lights saturate (rest of the calibration)", bright.picture(ball, rng=rng), ball),
        ("ball on another gel", other.picture(ball, rng=rng), ball),
        ("no contact, another gel", other.picture(rng=rng), []),
        ("no contact, the coat slides by 0.3 mm", gel.picture(rng=rng, shear=(3e-4, 0.0)), []),
        ("dots slide by 0.3 mm, calibrated without dots", printed.picture(rng=rng, shear=(3e-4, 0.0)), []),
        (
            "deeper and steeper than the calibration ball",
            gel.picture([Ball(1.5e-3, 1.1e-3)], rng=rng),
            [Ball(1.5e-3, 1.1e-3)],
        ),
        (
            "at the edge of the picture",
            gel.picture([Ball(4e-3, 1.3e-3, 9.4e-3, 0.0)], rng=rng),
            [Ball(4e-3, 1.3e-3, 9.4e-3, 0.0)],
        ),
    ]
    lines = ["| picture | force [N] | found [N], 95 % | notes |", "|---|---|---|---|"]
    for (name, _, bodies), (relief, touch) in zip(cases, solved(model, [c[1] for c in cases], pad)):
        low, high = touch.interval(0.95, "force")
        force = sum(b.force(PLANE) for b in bodies)
        said = "; ".join(relief.said) if relief is not None and relief.said else ""
        if relief is None:
            said = "; ".join(touch.assumptions)
        lines.append(
            f"| {name} | {force:.3f} | {float(touch.force[2]):.3f} ({float(low[2]):.3f} to {float(high[2]):.3f}) | {said} |"
        )
    return lines


def pictures(folder: Path) -> None:
    """A picture of every step of the how-to."""
    from matplotlib.figure import Figure

    from palpate.camera import draw_colours, draw_relief, overlay

    rng = np.random.default_rng(SEED + 700)
    gel = Gel(lamps(np.random.default_rng(SEED + 701)), seed=5)
    at = [(x * 1e-3, y * 1e-3) for x, y in ((-6, 4), (0, 4.2), (6, 4), (-3, 0), (3, 0), (-6, -4), (0, -4.2), (6, -4))]
    shown = [gel.picture(rng=rng), *(gel.picture([Ball(4e-3, 1.5e-3, x, y)], rng=rng) for x, y in at)]
    sheet = Figure(figsize=(7.0, 1.9))
    for ax, image, name in zip(sheet.subplots(1, 4), shown, ("at rest", "press 1", "press 2", "press 3")):
        ax.imshow(image)
        ax.set_title(name, fontsize=8)
        ax.set_axis_off()
    sheet.subplots_adjust(left=0.01, right=0.99, top=0.9, bottom=0.01, wspace=0.03)
    sheet.savefig(folder / "colour-gel-presses.png", dpi=110)
    model = learn_slopes(shown, View.scaled(gel.scale, size=gel.size), ball_diameter=DIAMETER)
    draw_colours(model).savefig(folder / "colour-gel-calibration.png", dpi=130)
    image = gel.picture([Flat(1.2e-3, 2e-4, -4e-3, 1e-3), Ball(3e-3, 1.2e-3, 4e-3, -1e-3)], rng=rng)
    relief, touch = solved(model, [image], skin())[0]
    draw_relief(image, relief).savefig(folder / "colour-gel-relief.png", dpi=130)
    overlay(image, touch, show="pressure").savefig(folder / "colour-gel-pressure.png", dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gels", type=int, default=12)
    parser.add_argument("--markdown", type=Path)
    parser.add_argument("--pictures", type=Path, help="folder for the pictures of the how-to; nothing else is done")
    given = parser.parse_args()
    if given.pictures is not None:
        pictures(given.pictures)
        return
    doubtful = hard()
    for number, lines in enumerate(population(given.gels)):
        text = "\n".join([f"{number + 1} gels.", "", *lines, *doubtful]) + "\n"
        print(text, flush=True)
        if given.markdown is not None:
            given.markdown.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
