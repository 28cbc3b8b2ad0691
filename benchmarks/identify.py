"""Balls and flats identified from readings of closed forms: how near radius, modulus, force and place are, how often the intervals hold, and what is not told.

    python benchmarks/identify.py [--frames 40] [--seed 0]

The readings are sigma_zz below a ball (Huber 1904), below a flat punch (Sneddon 1946) and below a rectangle of even pressure (Love 1929), at the places of the taxels:
nothing of the library's own forward model. Writes docs/_generated/identify.md.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.sensing.uncertainty import EXACT

OUT = Path(__file__).parents[1] / "docs" / "_generated" / "identify.md"
#: Frames that were measured: those that are there are not measured again. Delete the file where identify changes.
DATA = Path(__file__).parent / "data" / "identify.json"
MODULUS, RATIO, DEPTH = 2e5, 0.48, 1.5e-3
#: What is not known of modulus and depth where nothing is stated, as parts.
UNKNOWN = 0.15, 0.10


def huber(x: Any, y: Any, z: float, *, radius: float, force: float) -> Any:
    """Pressure on planes along the surface at depth z below Hertz's contact of this radius."""
    square = x**2 + y**2 + z**2 - radius**2
    u = 0.5 * (square + np.sqrt(square**2 + 4.0 * radius**2 * z**2))
    return 1.5 * force / (np.pi * radius**2) * (z / np.sqrt(u)) ** 3 * radius**2 * u / (u**2 + radius**2 * z**2)


def sneddon(x: Any, y: Any, z: float, *, radius: float, force: float) -> Any:
    """The same below a rigid, frictionless, flat punch."""
    rho, zeta = np.hypot(x, y) / radius, z / radius
    size = np.sqrt((rho**2 + zeta**2 - 1.0) ** 2 + 4.0 * zeta**2)
    angle = np.arctan2(2.0 * zeta, rho**2 + zeta**2 - 1.0)
    first = np.sin(0.5 * angle) / np.sqrt(size)
    second = np.sqrt(1.0 + zeta**2) * np.sin(1.5 * angle - np.arctan2(1.0, zeta)) / size**1.5
    return force / (2.0 * np.pi * radius**2) * (first + zeta * second)


def love(x: Any, y: Any, z: float, *, half_widths: tuple[float, float], pressure: float) -> Any:
    """The same below a rectangle that is pressed evenly."""
    total = np.zeros(np.broadcast(x, y).shape)
    for sign_x in (1, -1):
        for sign_y in (1, -1):
            a, b = half_widths[0] + sign_x * x, half_widths[1] + sign_y * y
            r = np.sqrt(a**2 + b**2 + z**2)
            total += np.arctan(a * b / (z * r)) + a * b * z / r * (1.0 / (a**2 + z**2) + 1.0 / (b**2 + z**2))
    return pressure * total / (2.0 * np.pi)


SHAPES = {"ball": huber, "flat": sneddon}


def plane_strain(modulus: float) -> float:
    return modulus / (1.0 - RATIO**2)


def array(noise: float | None = None) -> pp.AreaArray:
    return pp.AreaArray(shape=(8, 8), pitch=1.5e-3, depth=DEPTH, channels=["stress_zz"], noise=noise)


X, Y = (g.reshape(8, 8) for g in np.meshgrid(*[1.5e-3 * (np.arange(8) - 3.5)] * 2))


def check_closed_forms() -> float:
    """Largest difference of the closed forms from each other where they must agree: small contacts are Boussinesq's point force, and loads add up."""
    far = 3.0 * DEPTH**3 / (2.0 * np.pi * (X**2 + Y**2 + DEPTH**2) ** 2.5)
    small = 1e-5
    forms = (
        huber(X, Y, DEPTH, radius=small, force=1.0),
        sneddon(X, Y, DEPTH, radius=small, force=1.0),
        love(X, Y, DEPTH, half_widths=(small, small), pressure=0.25 / small**2),
    )
    off = max(float(np.abs(f / far - 1.0).max()) for f in forms)
    x, y = np.meshgrid(*[2e-4 * (np.arange(3001) - 1500)] * 2)
    for form in SHAPES.values():
        off = max(off, abs(float(form(x, y, DEPTH, radius=3e-3, force=1.0).sum()) * 4e-8 - 1.0))
    return off


def single(seed: int, exact: bool, i: int) -> dict[str, Any]:
    """One frame: a ball or a flat of a soft material whose indentation is measured. Each finding as [value or None, low, high, truth, scale]."""
    rng = np.random.default_rng([seed, int(exact), i])
    shape = ("ball", "flat")[i % 2]
    modulus, depth = (v if exact else v * (1.0 + p * rng.standard_normal()) for v, p in zip((MODULUS, DEPTH), UNKNOWN))
    own = float(np.exp(rng.uniform(np.log(5e4), np.log(2e6))))  # E/(1 - nu^2) of the object
    both = 1.0 / (1.0 / plane_strain(modulus) + 1.0 / own)
    force = float(np.exp(rng.uniform(np.log(0.3), np.log(4.0))))
    contact = float(rng.uniform(0.8e-3, 4e-3))
    radius = 4.0 * both * contact**3 / (3.0 * force) if shape == "ball" else contact
    moved = contact**2 / radius if shape == "ball" else force / (2.0 * both * contact)
    place = rng.uniform(-1.5e-3, 1.5e-3, 2)
    clean = SHAPES[shape](X - place[0], Y - place[1], depth, radius=contact, force=force)
    noise = float(clean.max() * np.exp(rng.uniform(np.log(3e-3), np.log(3e-2))))
    readings = (clean + noise * rng.standard_normal(clean.shape))[None]
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=RATIO), array(noise), uncertainty=EXACT if exact else None
    )
    touch = skin.reconstruct(readings)
    found = touch.identify(skin, readings, indentation=moved)
    row: dict[str, Any] = {"exact": exact, "i": i, "shape": shape, "found": found.shape, "patches": len(found.patches)}
    if found.shape != shape:
        found = touch.identify(skin, readings, indentation=moved, shape=shape)
    if len(found.patches) == 1:
        patch = found.patches[0]
        for name, one, truth, scale in (
            ("radius", found.radius, radius, radius),
            ("modulus", found.modulus, own, own),
            ("stiffness", found.stiffness, 2.0 * both * contact, 2.0 * both * contact),
            ("force", patch.force[2], force, force),
            ("contact", patch.contact_radius, contact, contact),
            ("x", patch.center[0], place[0], contact),
            ("y", patch.center[1], place[1], contact),
        ):
            numbers = (one.value if one.known else np.nan, one.low, one.high, truth, scale)
            row[name] = [float(f"{v:.5g}") if np.isfinite(v) else str(v) for v in map(float, numbers)]
    return row


def cell(rows: list[dict[str, Any]], *names: str) -> str:
    """Median error and half width of what was told, and how many intervals hold the truth."""
    found = np.array([[float(v) for v in row[n]] for row in rows for n in names if n in row])
    value, low, high, truth, scale = found.T
    claimed = ~np.isnan(low) & ~np.isnan(high)
    known = np.isfinite(value) & claimed
    held = int(((low <= truth) & (truth <= high)).sum())
    bounds, untold = int((claimed & ~known).sum()), int((~claimed).sum())
    said = (f", {bounds} of them bounds" if bounds else "") + (f"; {untold} not told" if untold else "")
    off, width = (100 * np.median(v[known]) for v in (np.abs(value - truth) / scale, 0.5 * (high - low) / scale))
    return f"{off:.2g} %, +-{width:.2g} %; {held} of {int(claimed.sum())}{said}"


def untold(seed: int, count: int = 4) -> list[list[Any]]:
    """[case, what must be said, how often it was, of how many]."""
    pad = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=RATIO)
    cases: dict[tuple[str, str], Any] = {
        ("nothing touches", "no patch, no radius"): (
            lambda x, y: np.zeros(x.shape),
            lambda f: f.count.value == 0 and not f.radius.known,
        ),
        ("a bar of 8 x 2 mm, evenly pressed", "neither ball nor flat, no radius"): (
            lambda x, y: love(x, y, DEPTH, half_widths=(4e-3, 1e-3), pressure=3e4),
            lambda f: f.shape == "" and not f.radius.known,
        ),
        ("two balls 6 mm apart", "two patches, each with its force, no radius"): (
            lambda x, y: (
                huber(x - 3e-3, y, DEPTH, radius=1.5e-3, force=1.0)
                + huber(x + 3e-3, y, DEPTH, radius=1.5e-3, force=0.5)
            ),
            lambda f: (
                f.count.value == 2
                and not f.radius.known
                and sorted(round(p.force[2].value, 1) for p in f.patches) == [0.5, 1.0]
            ),
        ),
        ("a contact of 0.2 mm, seven times less than the depth", "its size has an upper bound alone"): (
            lambda x, y: huber(x, y, DEPTH, radius=0.2e-3, force=1.0),
            lambda f: (
                all(p.contact_radius.low == 0.0 and p.contact_radius.high > 0.2e-3 for p in f.patches)
                and not f.radius.known
            ),
        ),
        ("a ball without its indentation", "no modulus"): (
            lambda x, y: huber(x, y, DEPTH, radius=2.5e-3, force=2.0),
            lambda f: not f.modulus.known and "indentation" in f.modulus.reason,
        ),
    }
    out = []
    for (case, said), (clean_of, good) in cases.items():
        told = 0
        for i in range(count):
            rng = np.random.default_rng([seed, 7, i])
            shift = rng.uniform(-0.5e-3, 0.5e-3, 2)
            clean = clean_of(X - shift[0], Y - shift[1])
            noise = 0.02 * float(clean.max()) if clean.any() else 100.0
            readings = (clean + noise * rng.standard_normal(clean.shape))[None]
            skin = pp.Skin(pad, array(noise), uncertainty=EXACT)
            touch = skin.reconstruct(readings)
            found = touch.identify(skin, readings, **({"shape": "ball"} if "0.2 mm" in case else {}))
            told += bool(good(found))
            if not good(found):
                print(case, i, found, flush=True)
        out.append([case, said, told, count])
        print(out[-1], flush=True)
    return out


def page(kept: dict[str, Any]) -> str:
    off = check_closed_forms()
    rows = []
    for exact, name in ((True, "exactly"), (False, "to 15 %, depth to 10 %")):
        for shape in SHAPES:
            some = [r for r in kept["rows"] if (r["exact"], r["shape"]) == (exact, shape)]
            right = sum(r["found"] == shape for r in some)
            wrong = sum(r["found"] not in ("", shape) for r in some)
            cells = (cell(some, k) for k in ("radius", "modulus", "stiffness", "force", "contact"))
            one = sum(r["patches"] == 1 for r in some)
            rows.append(
                f"| {shape} | {name} | {len(some)} | {right}, {len(some) - right - wrong}, {wrong} | {one} | {' | '.join(cells)} | {cell(some, 'x', 'y')} |"
            )
    lines = [
        f"Written by `benchmarks/identify.py`: 8 x 8 taxels of normal stress, 1.5 mm apart and 1.5 mm deep in a half-space of 200 kPa; contacts of 0.8 to 4 mm, "
        "forces of 0.3 to 4 N, noise of 0.3 to 3 % of the largest reading, objects of 50 kPa to 2 MPa whose indentation is given. The readings are closed forms of Huber, Sneddon and Love "
        f"(they agree with Boussinesq's point force, and add up to the force, to {100 * off:.1g} %), not computed by palpate.",
        "",
        "Each entry gives the median error, the median half-width of the 95 % interval, and how many of the intervals contain the truth; a single bound (such as 'at least 1 MPa') counts as an interval. If `identify` could not tell the shape, the shape was passed to it. "
        "The error of the centre is divided by the radius of the contact.",
        "",
        "| object | modulus of the pad known | frames | shape right, unknown, wrong | one patch | radius | modulus of the object | stiffness | force | contact radius | centre |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *rows,
        "",
        "Cases in which `identify` must give no number (noise of 2 % of the largest reading):",
        "",
        "| object | right answer | how often given |",
        "|---|---|---|",
        *(f"| {case} | {said} | {told} of {count} |" for case, said, told, count in kept["untold"]),
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=40, help="with the pad known, and as many with it not known well")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    kept: dict[str, Any] = {"seed": given.seed, "rows": [], "untold": []}
    if DATA.exists() and (old := json.loads(DATA.read_text(encoding="utf-8")))["seed"] == given.seed:
        kept = old
    there = {(r["exact"], r["i"]) for r in kept["rows"]}
    for i in range(given.frames):
        for exact in (True, False):
            if (exact, i) not in there:
                kept["rows"].append(single(given.seed, exact, i))
                print(kept["rows"][-1], flush=True)
                DATA.write_text(stored(kept), encoding="utf-8")
    kept["untold"] = kept["untold"] or untold(given.seed)
    DATA.write_text(stored(kept), encoding="utf-8")
    OUT.write_text(page(kept), encoding="utf-8")


def stored(kept: dict[str, Any]) -> str:
    """As text, one frame a line."""
    rows = ",\n".join(map(json.dumps, kept["rows"]))
    return f'{{"seed": {kept["seed"]}, "untold": {json.dumps(kept["untold"])}, "rows": [\n{rows}\n]}}\n'


if __name__ == "__main__":
    main()
