"""Constants of a pad from balls of known force at unknown places: how often the truth lies inside the 95 % intervals; pad models told apart; force from weights alone.

    python benchmarks/constants.py --oracles FOLDER            # holds fem_layer_3d.npz
    python benchmarks/constants.py --oracles FOLDER --write    # docs/_generated/constants.md, pad_models.md and weights.md

The readings are closed forms of a half-space (`palpate.solutions`) or finite elements of a bonded layer (FOLDER): never the forward model that is fitted. Noise:
1 % of the largest reading. Radii of balls are told with an error of 2 %. Truths are drawn from the spread that the fit assumes before the presses.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import scipy.interpolate
import scipy.special

import palpate as pp
from palpate.calibrate.constants import CONSTANTS, REJECTED, fit_constants

sys.path.insert(0, str(Path(__file__).parent))
from calibrate import METHODS, Split, eflesh, melexis

GENERATED = Path(__file__).parents[1] / "docs" / "_generated"
NOISE, RADIUS, PITCH, SHAPE = 0.01, 0.02, 2e-3, (6, 6)
FORCES = (1.0, 2.0, 4.0)


def grid(shape: tuple[int, int] = SHAPE, pitch: float = PITCH) -> np.ndarray:
    return np.asarray(pp.AreaArray(shape=shape, pitch=pitch, depth=1e-3, channels=["stress_zz"]).points)[:, ::-1]


def noisy(readings: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    noise = NOISE * float(np.abs(readings).max())
    return readings + noise * rng.standard_normal(readings.shape), noise


Truth = dict[str, float]


def layer(
    oracles: Path,
    ball: str,
    channels: list[str],
    points: np.ndarray,
    thickness: float,
    modulus: float,
    force: float,
    depth: str,
) -> tuple[np.ndarray, float, float]:
    """Readings (channel, taxel) under a Hertz pressure on a bonded incompressible layer, by finite elements; contact radius, and radius of the ball that makes it.

    ``ball`` "h3" is a contact of a third of the thickness, "h1" of all of it; ``depth`` is "base" or "middle".
    """
    with np.load(oracles / "fem_layer_3d.npz") as file:
        held = {k.removeprefix(f"{ball}__nu0.5__hertz_p__"): file[k] for k in file.files if k.startswith(ball)}
    a = thickness / float(ball[1:])
    unit = force / (2.0 * np.pi / 3.0 * a**2)  # p0 of Hertz's pressure
    r, around = held[f"{ball}__r"], np.hypot(*points.T) / a
    out = []
    for channel in channels:
        name, direction = {"stress": ("S_", "rz"), "displacement": ("u_", "r")}[channel.partition("_")[0]]
        upright = channel.endswith("z") and not channel.endswith(("xz", "yz"))
        key = name + ({"S_": "zz", "u_": "z"}[name] if upright else direction)
        row = (
            -1 if depth == "base" else 2
        )  # z: 0.1, 0.25, 0.5, 0.75 and 1 of the thickness; displacements: 0, 0.25, 0.5, 0.75
        size = unit if name == "S_" else unit * a / modulus
        value = size * scipy.interpolate.CubicSpline(r, held[key][row])(np.minimum(around, r[-1]))
        axis = None if upright else 1 if "_y" in channel else 0
        out.append(value if axis is None else value * points[:, axis] / np.maximum(a * around, 1e-12))
    sunk = held["u_z"][0]
    drop = float(sunk[0] - sunk[np.flatnonzero(np.isclose(r, 1.0))[0]]) * a * unit / modulus
    return np.stack(out), a, a**2 / (2.0 * drop)


def gel(
    rng: np.random.Generator, presses: int, oracles: Path, newtons: np.ndarray | None = None
) -> tuple[pp.Skin, np.ndarray, np.ndarray, np.ndarray, float, Truth]:
    """A camera gel deep enough to be a half-space: in-plane displacement of markers, balls of 4, 6 and 9 mm radius; closed form."""
    modulus, depth, scale = np.exp(rng.standard_normal(3) * [0.4, 0.2, 0.2]) * [1e5, 2e-3, 1.0]
    pad = pp.HalfSpace(youngs_modulus=modulus, poissons_ratio=0.48)
    points, radius = grid() * scale, np.resize([4e-3, 6e-3, 9e-3], presses)
    force = np.resize(FORCES, presses) if newtons is None else newtons
    channels = ["displacement_x", "displacement_y"]
    out = []
    for r, f in zip(radius, force):
        x, y = rng.uniform(-3e-3, 3e-3, 2)
        ball = pp.solutions.hertz_point(
            force=f, contact_radius=pp.solutions.hertz_contact_radius(pad, radius=r, force=f)
        )
        out.append(ball.fields(pad, channels, points[:, 0] - x, points[:, 1] - y, depth) / scale)
    readings, noise = noisy(np.stack(out).reshape(presses, 2, *SHAPE), rng)
    array = pp.AreaArray(shape=SHAPE, pitch=PITCH, depth=2e-3, channels=channels)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)
    radius = radius * np.exp(RADIUS * rng.standard_normal(presses))
    return skin, readings, force, radius, noise, {"youngs_modulus": modulus, "depth": depth, "pixel_scale": scale}


def taxels(
    rng: np.random.Generator, presses: int, oracles: Path, newtons: np.ndarray | None = None
) -> tuple[pp.Skin, np.ndarray, np.ndarray, np.ndarray, float, Truth]:
    """Taxels at the base of a bonded pad, each with a gain of its own; contact radius a third and all of the thickness; finite elements."""
    thickness = 4e-3 * np.exp(0.2 * rng.standard_normal())
    modulus = 1e5 * np.exp(0.4 * rng.standard_normal())
    points = grid()
    gains = np.exp(0.05 * rng.standard_normal(len(points)))
    force = np.resize(FORCES, presses) if newtons is None else newtons
    out, radius = [], []
    for i, f in enumerate(force):
        at = rng.uniform(-3e-3, 3e-3, 2)
        made, _, ball = layer(oracles, ("h3", "h1")[i % 2], ["stress_zz"], points - at, thickness, modulus, f, "base")
        out.append(gains * made[0])
        radius.append(ball)
    readings, noise = noisy(np.stack(out).reshape(presses, 1, *SHAPE), rng)
    array = pp.AreaArray(shape=SHAPE, pitch=PITCH, depth="base", channels=["stress_zz"])
    skin = pp.Skin(pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.5)]), array)
    truth = {"youngs_modulus": modulus, "thickness": thickness, **{f"gain {i}": g for i, g in enumerate(gains)}}
    return (
        skin,
        readings,
        force,
        np.array(radius) * np.exp(RADIUS * rng.standard_normal(presses)),
        noise,
        truth,
    )


BENCHES = {
    "camera gel": (gel, ["youngs_modulus", "depth", "pixel_scale"]),
    "taxels": (taxels, ["youngs_modulus", "thickness", "gain"]),
}


def coverage(oracles: Path, seeds: range, only: str) -> list[str]:
    rows = [
        "| bench | presses | constant | inside 95 % | median standard deviation before | after | median error |",
        "|---|---|---|---|---|---|---|",
    ]
    for bench, (make, constants) in BENCHES.items():
        for presses in (3, 6, 20):
            if only not in f"{bench} | {presses} |":
                continue
            off: dict[str, list[tuple[float, float]]] = {}
            for seed in seeds:
                skin, readings, force, radius, noise, truth = make(
                    np.random.default_rng([seed, presses]), presses, oracles
                )
                found = fit_constants(skin, readings, force, constants=constants, noise=noise, ball_radius=radius)
                for name, value, std in zip(found.names, found.values, found.std):
                    key = "gain" if name.startswith("gain") else name
                    off.setdefault(key, []).append((abs(float(np.log(truth[name] / value))), float(std)))
            for key, values in off.items():
                error, std = np.array(values).T
                rows.append(
                    f"| {bench} | {presses} | {key} | {(error < 1.96 * std).mean():.2f} | {100 * CONSTANTS[key]:.0f} % | "
                    f"{100 * np.median(std):.1f} % | {100 * np.median(error):.1f} % |"
                )
                print(rows[-1], flush=True)
    return rows


MODELS = ("half-space", "bonded", "stack", "soft base")
DEPTH, THICK = 1.5e-3, 3e-3


def body(name: str) -> Any:
    layer = pp.Layer(thickness=THICK, youngs_modulus=1e5, poissons_ratio=0.5)
    thin = [pp.Layer(thickness=0.5 * THICK, youngs_modulus=e, poissons_ratio=0.5) for e in (1e5, 2e4)]
    return {
        "half-space": pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        "bonded": pp.BondedLayers([layer]),
        "stack": pp.BondedLayers(thin),
        "soft base": pp.BondedLayers([layer], base=pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=0.5)),
    }[name]


def ranked(oracles: Path, seeds: range, only: str) -> list[str]:
    """How often each pad is named from six presses of balls of unknown radius; under stress taxels a layer of 60 mm is one with a half-space.

    Readings of the half-space are closed forms and those of the bonded layer finite elements; stack and soft base have `Skin.sense` alone.
    """
    channels = {
        "displacement": ["displacement_x", "displacement_y", "displacement_z"],
        "stress": ["stress_xz", "stress_yz", "stress_zz"],
    }
    rows = ["| true pad | readings | named right | cannot tell | named wrong | rejected |", "|---|---|---|---|---|---|"]
    thick = pp.BondedLayers([pp.Layer(thickness=60e-3, youngs_modulus=1e5, poissons_ratio=0.5)])
    cases = [(m, body(m), kind, THICK) for kind in channels for m in MODELS]
    for truth, pad, kind, thickness in [*cases, ("bonded, 60 mm", thick, "stress", 60e-3)]:
        if only not in f"| {truth} | {kind} |":
            continue
        counts = np.zeros(4, dtype=int)
        array = pp.AreaArray(shape=SHAPE, pitch=PITCH, depth=DEPTH, channels=channels[kind])
        true, points = pp.Skin(pad, array), grid()
        guess = pp.BondedLayers([pp.Layer(thickness=thickness * 1.1, youngs_modulus=1.2e5, poissons_ratio=0.5)])
        skin = pp.Skin(guess, array)
        for seed in seeds:
            rng = np.random.default_rng([seed, 77])
            force, places = np.resize(FORCES, 6), rng.uniform(-3e-3, 3e-3, (6, 2))
            made = []
            for i, (f, at) in enumerate(zip(force, places)):
                ball = pp.solutions.hertz_point(force=f, contact_radius=(1.2e-3, 1.8e-3, 2.4e-3)[i % 3])
                if truth == "half-space":
                    one = ball.fields(pad, channels[kind], *(points - at).T, DEPTH)
                elif truth == "bonded":
                    one = layer(oracles, ("h3", "h1")[i % 2], channels[kind], points - at, THICK, 1e5, f, "middle")[0]
                else:
                    one = np.asarray(true.sense(ball.shifted(*at)))
                made.append(np.reshape(one, (len(channels[kind]), *SHAPE)))
            readings, noise = noisy(np.stack(made), rng)
            asked = ["youngs_modulus", "thickness", "depth"]
            found = fit_constants(skin, readings, force, constants=asked, noise=noise, models=MODELS)
            best = found.best_model
            counts[3 if found.misfit > REJECTED else 1 if best is None else 0 if best == truth else 2] += 1
        rows.append(f"| {truth} | {kind} | " + " | ".join(map(str, counts)) + " |")
        print(rows[-1], flush=True)
    return rows


REGRESSIONS = ("linear", "quadratic", "process")
#: Presses that the calibration has not seen, each with a force of its own.
ASKED = 40


def weighed(oracles: Path, seeds: range, only: str) -> list[str]:
    """Error of the force of presses at places of their own by `Skin.calibrate` and `Skin.reconstruct`, from known weights at unknown places and one frame at rest, beside regressions on the same frames.

    The sensor is that of the same day; "on the same day": without the part of the interval for gains of another day.
    """
    rows = [
        "| bench | weights | palpate: mean error / mean force | inside 95 % | interval width / mean force | on the same day: inside 95 % | width | error of linear regression | quadratic | Gaussian process |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for bench, (make, _) in BENCHES.items():
        for presses in (3, 6, 20):
            if only not in f"{bench} | {presses} |":
                continue
            off: dict[str, list[float]] = {m: [] for m in METHODS}
            held: list[list[float]] = []
            for seed in seeds:
                rng = np.random.default_rng([seed, presses, 5])
                newtons = np.concatenate([np.resize(FORCES, presses), rng.uniform(0.5, 4.5, ASKED)])
                skin, readings, force, *_ = make(rng, presses + ASKED, oracles, newtons)
                flat = np.vstack([np.zeros(readings[0].size), readings.reshape(len(readings), -1)])
                known, k = np.r_[0.0, force], presses + 1
                split = Split(bench, skin, 2, flat[:k], known[:k], None, flat[k:], known[k:])
                frames, usual = flat.reshape(len(flat), *readings.shape[1:]), float(known[k:].mean())
                calibrated = skin.calibrate(frames[:k], reference=known[:k])
                touch, found = calibrated.reconstruct(frames[k:]), calibrated.calibration
                assert found is not None
                assert touch.calibrated is not None
                value, std = np.asarray(touch.force)[:, 2], touch.calibrated.std[:, 2]
                student = scipy.special.stdtrit(found.freedom, 0.975)
                error, row = np.abs(value - known[k:]), []
                one = found.maps["fz"]
                for half in (student * std, student * np.sqrt(std**2 - (one.run_share * value) ** 2 - one.run_zero**2)):
                    row += [float((error <= half).mean()), 200.0 * float(half.mean()) / usual]
                held.append(row)
                off["palpate"].append(float(error.mean() / usual))
                for name in REGRESSIONS:
                    off[name].append(float(np.abs(METHODS[name](split, flat[k:])[0] - known[k:]).mean() / usual))
            mean = {m: 100.0 * float(np.mean(v)) for m, v in off.items()}
            inside, wide, same, narrow = np.mean(held, axis=0)
            rows.append(
                f"| {bench} | {presses} | {mean['palpate']:.2g} % | {inside:.2f} | {wide:.0f} % | {same:.2f} | {narrow:.0f} % | "
                + " | ".join(f"{mean[m]:.2g} %" for m in REGRESSIONS)
                + " |"
            )
            print(rows[-1], flush=True)
    return rows


def published(data: Path) -> list[str]:
    """What pad models say of two published sensors without elastic constants: twenty frames pressed with hardly any sideways force, unit and gains free, 3 % noise."""
    rng = np.random.default_rng(0)
    rows = [
        "| sensor | frames | residual over noise | pad model | best by evidence |",
        "|---|---|---|---|---|",
    ]
    splits = [next(eflesh(data / "eflesh", rng)), next(melexis(data / "melexis", rng))]
    for split in splits:
        force = split.force
        pressed = np.flatnonzero(force > 0.2 * force.max())
        at = pressed[np.linspace(0, len(pressed) - 1, 20).astype(int)]
        plane = split.skin.planes[0]
        readings = split.readings[at].reshape(len(at), len(plane.channels), *plane.shape)
        noise = 0.03 * float(np.abs(readings).max())
        asked = ["unit", "thickness", "gain"]
        found = fit_constants(split.skin, readings, force[at], constants=asked, noise=noise, models=MODELS)
        best = max(found.evidence, key=lambda m: found.evidence[m])
        said = "rejected" if found.misfit > REJECTED else found.best_model or "cannot tell"
        rows.append(f"| {split.name.split()[0]} | {len(at)} | {found.misfit:.1f} | {said} | {best} |")
        print(rows[-1], *found.said, sep="\n", flush=True)
    return rows


def summed(before: str, now: str) -> str:
    """A row whose numbers are the sums of those of two rows."""
    cells = zip(before.split("|"), now.split("|"))
    return "|".join(f" {int(a) + int(b)} " if a.strip().isdigit() else a for a, b in cells)


def write(path: Path, rows: list[str], *, add: bool) -> None:
    """Rows of other benches or pads that a run left out (``--only``) stay as they are; ``add``: the counts of a row are added to those of before."""

    def key(row: str) -> str:
        return "|".join(row.split("|")[: {"constants.md": 4, "pads_published.md": 2}.get(path.name, 3)])

    fresh = {key(r): r for r in rows[2:]}
    old = path.read_text(encoding="utf-8").splitlines()[2:] if path.exists() else []
    if add:
        fresh |= {key(r): summed(r, fresh[key(r)]) for r in old if key(r) in fresh}
    kept = [fresh.pop(key(r), r) for r in old if r]
    path.write_text("\n".join([*rows[:2], *kept, *fresh.values(), ""]), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--oracles", type=Path, required=True)
    parser.add_argument("--repetitions", type=int, default=100)
    parser.add_argument(
        "--first",
        type=int,
        default=0,
        help="first seed; from 1 on, counts of pad models are added to those of the table",
    )
    parser.add_argument("--data", type=Path, help="published recordings: eflesh/ and melexis/")
    parser.add_argument("--part", choices=("coverage", "models", "weights", "published"), help="only this table")
    parser.add_argument("--only", default="", help='rows that hold this text, such as "taxels | 6 |" or "| stack |"')
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.repetitions)
    tables = {
        "coverage": ("constants.md", lambda: coverage(given.oracles, seeds, given.only)),
        "models": ("pad_models.md", lambda: ranked(given.oracles, seeds, given.only)),
        "weights": ("weights.md", lambda: weighed(given.oracles, seeds, given.only)),
    }
    if given.data is not None:
        tables["published"] = ("pads_published.md", lambda: published(given.data))
    for part, (name, make) in tables.items():
        if given.part in (None, part):
            rows = make()
            if given.write:
                write(GENERATED / name, rows, add=part == "models" and given.first > 0)


if __name__ == "__main__":
    main()
