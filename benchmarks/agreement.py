"""Does a change of the code change any answer? Every reconstruction, saved before and compared after.

    python benchmarks/agreement.py --save FILE        run everything and keep the results (.npz)
    python benchmarks/agreement.py --compare FILE     run everything and print what differs

Every method with its rules and orders, on small arrays of the accuracy benchmark's kinds (line, area, three channels with and
without friction, displacement in a bonded gel, dead taxels, contacts across the edge, two planes, scattered, periodic) and on the published
displacement fields where ../shared holds them. Kept of each: traction, parameter, noise, residual, error bars and net force. A
difference is the largest absolute one over the largest value; those above 1e-9 are flagged.
"""

from __future__ import annotations

import argparse
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate import bench
from palpate.recordings import read_table

LIMIT = 1e-9
SHARED = Path(__file__).resolve().parents[2] / "shared"
NOISES = (1e-2, 5e-2)
RULES = ("evidence", "gcv", "lcurve")

Options = dict[str, Any]
Run = tuple[str, Callable[[], pp.Touch]]


def layouts() -> dict[str, bench.Layout]:
    """The accuracy benchmark's kinds of array, small."""
    soft, rubber = (pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=nu) for nu in (0.49, 0.5))
    gel = pp.BondedLayers([pp.Layer(thickness=3.0, youngs_modulus=1.0, poissons_ratio=0.48)])
    line = pp.LineArray(count=41, pitch=0.5, depth=1.0, channels=["stress_zz"])
    two = pp.LineArray(count=41, pitch=0.5, depth=1.0, channels=["stress_xz", "stress_zz"])
    area = pp.AreaArray(shape=(12, 13), pitch=1.0, depth=1.5, channels=["stress_zz"])
    three = pp.AreaArray(shape=(12, 11), pitch=1.0, depth=1.5, channels=["stress_xz", "stress_yz", "stress_zz"])
    markers = pp.AreaArray(
        shape=(9, 9), pitch=1.0, depth=1.5, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    dead = line.masked(np.random.default_rng(0).random(line.shape) > 0.1)
    pressed = {
        "cylinder": bench.line_contact(("cylinder", 0.4, 2.5, 1.0)),
        "two strips": bench.line_contact(("strip", -4.0, 1.0, 1.0), ("strip", 3.0, 1.5, 0.6)),
    }
    edge = {"edge": bench.line_contact(("cylinder", 9.0, 2.5, 1.0))}
    pull = {"pull": bench.line_contact(("cylinder", 0.4, 2.5, -1.0))}
    ball, block = bench.Patch("ball", (0.3, -0.2), (3, 3)), bench.Patch("block", (0.5, -0.5), (1.5, 2.5), angle=0.4)
    balls = {"ball": bench.area_contact(ball), "block": bench.area_contact(block)}
    sheared = {
        "sliding ball": bench.area_contact(ball, shear="slide", friction=0.5),
        "sticking block": bench.area_contact(block, shear="stick", friction=0.5),
    }
    both = ("x", "y", "z")
    return {
        "line": bench.Layout("line", rubber, line, pressed),
        "line, two channels": bench.Layout("line, two channels", rubber, two, pressed, ("x", "z"), 0.4),
        "dead taxels": bench.Layout("dead taxels", rubber, dead, pressed),
        "across the edge": bench.Layout("across the edge", rubber, line, edge),
        "pull": bench.Layout("pull", rubber, line, pull),
        "area": bench.Layout("area", soft, area, balls),
        "three channels": bench.Layout("three channels", soft, three, sheared, both, 0.5),
        "bonded displacement": bench.Layout("bonded displacement", gel, markers, sheared, both, 0.5),
    }


def choices(layout: bench.Layout, known: bool) -> dict[str, Options]:
    """Every method with the options that are compared; ``known``: the array's noise is given."""
    d, whole = layout.array.dimensions, layout.array.mask is None
    out: dict[str, Options] = {"default": {}}
    for rule in (*RULES, *(("discrepancy",) if known else ())):
        for order in (0, 1, 2) if rule == "evidence" else (1,):
            out[f"tikhonov {order} {rule}"] = {"method": "tikhonov", "order": order, "parameter": rule}
    out["tikhonov given"] = {"method": "tikhonov", "parameter": 1e-3}
    out["hilgers"] = {"method": "hilgers"}
    out["hilgers gcv"] = {"method": "hilgers", "length": 2.0, "parameter": "gcv"}
    out["truncated"] = {"method": "truncated"}
    out["truncated lcurve"] = {"method": "truncated", "parameter": "lcurve"}
    out["constrained"] = {"method": "constrained"}
    out["constrained given"] = {"method": "constrained", "parameter": 1e-3}
    if known:
        out["wiener"] = {"method": "wiener", "spectrum": lambda k: 0.01 / (1 + k**4)}
    if layout.friction is not None:
        out["adaptive friction"] = {"method": "adaptive", "friction": layout.friction}
        out["constrained friction"] = {"method": "constrained", "friction": layout.friction}
    if whole:
        out["dft"] = {"method": "dft"}
        out["linear"] = {"method": "linear"}
    if d == 1 and len(layout.array.channels) == 1:
        if whole:
            out["constant_friction"] = {"method": "constant_friction", "friction": 0.3}
            out["constant_friction gcv"] = {"method": "constant_friction", "friction": -0.2, "parameter": "gcv"}
        for name in ("elastic_net", "tv", "maxent", "network"):
            out[name] = {"method": name}
        out["tv given"] = {"method": "tv", "parameter": 1e-2}
    elif "displacement_x" not in layout.array.channels and layout.name != "three channels":
        out["elastic_net"] = {"method": "elastic_net"}
    out["nnls"] = {"method": "nnls"}
    return out


def synthetic() -> Iterator[Run]:
    for layout in layouts().values():
        for contact, traction in layout.contacts.items():
            readings, _ = layout.make(traction)
            largest = float(np.abs(readings).max())
            for noise in NOISES:
                rng = np.random.default_rng(zlib.crc32(f"{layout.name} {contact} {noise}".encode()))
                noisy = readings + noise * largest * rng.standard_normal(readings.shape)
                for known in (False, True):
                    if known and (noise != NOISES[0] or contact != next(iter(layout.contacts))):
                        continue
                    skin = layout.skin
                    if known:
                        array = type(layout.array)(**{**vars_of(layout.array), "noise": noise * largest})
                        skin = pp.Skin(layout.pad, array)
                    for name, options in choices(layout, known).items():
                        asked = {"components": list(layout.components), **options}
                        if options.get("method") == "constant_friction":
                            del asked["components"]
                        label = f"{layout.name} | {contact} | {noise:g}{' given' if known else ''} | {name}"
                        yield label, lambda s=skin, r=noisy, o=asked: s.reconstruct(r, **o)
            # one small batch of frames, for what only a batch could do
            rng = np.random.default_rng(7)
            frames = readings + NOISES[0] * largest * rng.standard_normal((3, *readings.shape))
            for name in ("adaptive", "tikhonov", "nnls"):
                if contact == next(iter(layout.contacts)):
                    yield (
                        f"{layout.name} | {contact} | batch of three | {name}",
                        lambda s=layout.skin, r=frames, n=name, c=layout.components: s.reconstruct(
                            r, method=n, components=list(c)
                        ),
                    )


def vars_of(array: Any) -> Options:
    return {f.name: getattr(array, f.name) for f in fields(array) if f.init}


def others() -> Iterator[Run]:
    """Two planes, scattered positions, a periodic surface, nothing but noise."""
    rng = np.random.default_rng(5)
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.4)
    contact = pp.solutions.hertz_point(contact_radius=2.0, force=1.0).sliding(0.3, direction=0.5)
    planes = [
        pp.AreaArray(shape=(9, 9), pitch=1.0, depth=d, channels=["stress_zz"], center=(0.0, 0.0)) for d in (1.0, 2.0)
    ]
    skins = {
        "two planes": pp.Skin(pad, planes),
        "scattered": pp.Skin(
            pad,
            pp.ScatteredArray(
                positions=rng.uniform(-5, 5, size=(90, 2)), depth=0.5, channels=["displacement_x", "displacement_y"]
            ),
        ),
        "periodic": pp.Skin(
            pad,
            pp.AreaArray(shape=(14, 15), pitch=0.8, depth=0.5, channels=["displacement_x", "displacement_y"]),
            boundary="periodic",
        ),
    }
    for name, skin in skins.items():
        clean = np.asarray(skin.sense(contact))
        for kind, readings in (
            ("contact", clean + 0.01 * np.abs(clean).max() * rng.standard_normal(clean.shape)),
            ("noise", rng.standard_normal(clean.shape)),
        ):
            if name != "two planes":
                readings = 0.01 * readings
            runs: dict[str, Options] = {"default": {}, "tikhonov 0": {"order": 0}, "gcv": {"parameter": "gcv"}}
            runs |= {"hilgers": {"method": "hilgers"}, "truncated": {"method": "truncated"}}
            if name == "two planes":
                runs["constrained"] = {"method": "constrained"}
            for method, options in runs.items():
                yield f"{name} | {kind} | {method}", lambda s=skin, r=readings, o=options: s.reconstruct(r, **o)


def published() -> Iterator[Run]:
    """Displacement fields that others have published, as they inverted them."""
    folder = SHARED / "data" / "pytraction"
    if not folder.is_dir():
        return
    names = ["displacement_x", "displacement_y"]
    tables = {
        "synthetic": ("matlab_data.csv", ["x", "y", "u", "v"], 0.3),
        "beads": ("example_dataset.h5", ["pos/0", "vec/0"], 0.5),
    }
    for name, (file, columns, ratio) in tables.items():
        data = read_table(folder / file, columns=columns, channels=names, follow=True).gridded(10.0)
        array = pp.AreaArray(shape=data.readings.shape[2:], pitch=10.0, depth=0.0, channels=names)
        skin = pp.Skin(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=ratio), array, boundary="periodic")
        for order in (0, 1, 2):
            for rule in (1e-3, *RULES):
                label = f"published {name} | tikhonov {order} {rule}"
                yield (
                    label,
                    lambda s=skin, r=data.readings[0], o=order, p=rule: s.reconstruct(r, order=o, parameter=p),
                )


def results(report: Callable[[str], None], only: str = "") -> dict[str, np.ndarray]:
    """Every answer (of runs whose name holds ``only``), as arrays named "run | quantity"."""
    out: dict[str, np.ndarray] = {}
    for source in (synthetic, others, published):
        for label, run in source():
            if only not in label:
                continue
            started = time.perf_counter()
            try:
                touch = run()
            except pp.PalpateError as error:
                out[f"{label} | refused"] = np.array(type(error).__name__)
                continue
            parts = {"traction": touch.values, "force": touch.force, "parameter": touch.parameter}
            parts |= {"noise": touch.noise_std, "residual": touch.residual}
            if touch._errors is not None:
                posterior = touch._errors.posterior
                parts |= {f"std of {f.name}": getattr(posterior, f.name) for f in fields(posterior)}
            for name, value in parts.items():
                if value is not None:
                    out[f"{label} | {name}"] = np.asarray(value, dtype=np.float64)
            report(f"{time.perf_counter() - started:7.3f} s  {label}")
    return out


def difference(before: np.ndarray, after: np.ndarray) -> float:
    """Largest absolute difference over the largest value; infinite where shapes or NaNs differ."""
    if before.dtype.kind == "U" or after.dtype.kind == "U":
        return 0.0 if str(before) == str(after) else float("inf")
    if before.shape != after.shape or (np.isnan(before) != np.isnan(after)).any():
        return float("inf")
    known = np.isfinite(before) & np.isfinite(after)
    if not known.any():
        return 0.0
    return float(np.abs(after - before)[known].max() / max(float(np.abs(before[known]).max()), 1e-300))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--save", type=Path, metavar="FILE")
    what.add_argument("--compare", type=Path, metavar="FILE")
    parser.add_argument("--all", action="store_true", help="print every difference, not only those above 1e-9")
    parser.add_argument("--only", default="", metavar="TEXT", help="only runs whose name holds this text")
    parser.add_argument("--verbose", action="store_true", help="print each run with its time")
    chosen = parser.parse_args()
    started = time.perf_counter()
    found = results(lambda line: print(line, file=sys.stderr) if chosen.verbose else None, chosen.only)
    print(f"{len(found)} answers in {time.perf_counter() - started:.0f} s")
    if chosen.save is not None:
        np.savez_compressed(chosen.save, **found)  # type: ignore[arg-type]
        return 0
    with np.load(chosen.compare) as file:
        reference = {name: file[name] for name in file.files if chosen.only in name.rpartition(" | ")[0]}
    lost, new = sorted(reference.keys() - found.keys()), sorted(found.keys() - reference.keys())
    for title, names in (("only before", lost), ("only now", new)):
        for name in names:
            print(f"{title}: {name}")
    differences = {n: difference(reference[n], found[n]) for n in reference if n in found}
    flagged = {n: d for n, d in differences.items() if not d <= LIMIT}
    for name, value in sorted(differences.items() if chosen.all else flagged.items(), key=lambda item: -item[1]):
        print(f"{value:10.2e}  {name}{'  <-- above 1e-9' if chosen.all and name in flagged else ''}")
    same = [d for d in differences.values() if d <= LIMIT]
    print(
        f"{len(same)} of {len(differences)} within {LIMIT:g} (largest of them {max(same, default=0.0):.1e}), {len(flagged)} beyond"
    )
    return 1 if flagged or lost else 0


if __name__ == "__main__":
    raise SystemExit(main())
