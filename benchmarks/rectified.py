"""method="rectified" beside the automatic method: errors, coverage, widths, times, and the three gates that it was set.

    python benchmarks/rectified.py [--frames 40] [--seed 2026] [--kind area] [--population other] [--keep DIR] [--write]

Two populations: `palpate.bench.unseen`, and `other` below, which nothing was tuned on: rings, punches, two balls, tilted flats, wide contacts,
sliding and sticking shear, offsets and taxels whose gains differ by 10 %. ``--keep`` stores each frame's row in a folder, so that a run goes on where it
ended; ``--write`` writes docs/_generated/rectified.md.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.bench.layouts import Layout
from palpate.bench.unseen import KINDS, Sample, unseen
from palpate.touch import Touch

METHODS = ("automatic", "rectified")
TIMED = 4
#: Gates: error over the automatic method's on areas and on lines, coverage of the peak at 95 %, milliseconds of an 8 x 8 x 3 frame.
GATES = {"area": 0.9, "line": 1.0, "peak": 0.93, "time": 20.0}

Shape = Callable[..., np.ndarray]

LINES: dict[str, Shape] = {
    "ball": lambda u: np.sqrt(np.clip(1 - u**2, 0, None)),
    "punch": lambda u: np.where(np.abs(u) < 1, 1 / np.sqrt(np.clip(1 - u**2, 0.03, None)), 0.0),
    "tilted flat": lambda u: np.where(np.abs(u) < 1, 0.3 + 0.35 * (1 + u), 0.0),
    "groove": lambda u: np.where((np.abs(u) < 1) & (np.abs(u) > 0.45), 1.0, 0.0),
    "plateau": lambda u: np.where(np.abs(u) < 1, 1 - 0.2 * u**4, 0.0),
}
AREAS: dict[str, Shape] = {
    "ball": lambda u, v: np.sqrt(np.clip(1 - u**2 - v**2, 0, None)),
    "punch": lambda u, v: np.where(u**2 + v**2 < 1, 1 / np.sqrt(np.clip(1 - u**2 - v**2, 0.05, None)), 0.0),
    "tilted flat": lambda u, v: np.where((np.abs(u) < 0.9) & (np.abs(v) < 0.9), 0.25 + 0.4 * (1 + u), 0.0),
    "ring": lambda u, v: np.where((u**2 + v**2 < 1) & (u**2 + v**2 > 0.35), 1.0, 0.0),
    "block": lambda u, v: np.where((np.abs(u) < 0.85) & (np.abs(v) < 0.85), 1.0, 0.0),
}
FAULTS = ("none", "none", "none", "offset", "gains")


def other(rng: np.random.Generator, kind: str) -> tuple[Sample, str]:
    """A frame of a population for measuring alone, and what is wrong with it."""
    line, shear = kind == "line", kind == "area with shear"
    sensing = str(rng.choice(["stress", "strain", "displacement"], p=[0.7, 0.15, 0.15]))
    names = ["xz", "yz", "zz"] if sensing != "displacement" else ["x", "y", "z"]
    channels = [f"{sensing}_{n}" for n in (names if shear else names[-1:])]
    depth = float(rng.uniform(0.5, 2.0 if line else 1.2))
    ratio = float(rng.uniform(0.4, 0.5))
    pad: Any = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=ratio)
    if rng.random() < 0.3:
        thickness = depth * float(rng.uniform(1.2, 3.0))
        pad = pp.BondedLayers([pp.Layer(thickness=thickness, youngs_modulus=1.0, poissons_ratio=ratio)])
    n = int(rng.integers(16, 41)) if line else int(rng.integers(6, 9 if shear else 11))
    shape: tuple[int, ...] = (n,) if line else (n, n + int(rng.integers(-1, 2)))
    array: Any = (
        pp.LineArray(count=n, pitch=1.0, depth=depth, channels=channels)
        if line
        else pp.AreaArray(shape=(shape[0], shape[1]), pitch=1.0, depth=depth, channels=channels)
    )
    mu = float(rng.uniform(0.2, 0.9)) if shear else 0.0
    known = mu if shear and rng.random() < 0.5 else None
    half = 0.5 * np.asarray(shape[::-1], dtype=np.float64)
    parts = []
    pair = not shear and rng.random() < 0.3
    for _ in range(1 + pair):
        wide = not pair and rng.random() < 0.15
        limit = float(half.min()) * (0.9 if wide else 0.35 if pair else 0.6)
        size = rng.uniform(max(1.0, 0.8 * limit) if wide else 1.0, max(limit, 1.2))
        center = rng.uniform(-1, 1, len(half)) * np.clip(half - size - 0.5, 0.1, None)
        name = "ball" if pair else str(rng.choice(list(LINES if line else AREAS)))
        parts.append((name, center, size, float(rng.uniform(0.5, 1.0)), float(rng.uniform(0, 2 * math.pi))))
    sticks, way = bool(rng.random() < 0.5), float(rng.uniform(0, 2 * math.pi))

    def traction(grid: Any) -> np.ndarray:
        axes = np.meshgrid(*grid.axes, indexing="ij")[::-1]
        out = np.zeros((len(grid.components), *grid.shape))
        for name, center, size, peak, angle in parts:
            away = [(a - c) / size for a, c in zip(axes, center)]
            if line:
                out[-1] += peak * LINES[name](away[0] * (1 if angle < math.pi else -1))
                continue
            c, s = math.cos(angle), math.sin(angle)
            out[-1] += peak * AREAS[name](c * away[0] + s * away[1], c * away[1] - s * away[0])
            if shear:
                held = np.clip(np.hypot(*away), 0.0, 1.0) if sticks else 1.0
                out[0], out[1] = (f * mu * held * out[-1] for f in (math.cos(way), math.sin(way)))
        return out

    components = ("x", "y", "z") if shear else ("z",)
    layout = Layout(kind, pad, array, {}, components, known)
    readings, truth = layout.make(traction)
    largest = float(np.abs(readings).max())
    fault = str(rng.choice(FAULTS))
    if fault == "gains":
        readings = readings * (1 + 0.1 * rng.standard_normal(readings.shape))
    if fault == "offset":
        readings = readings + largest * rng.uniform(-0.2, 0.2, (len(channels), *(1,) * len(shape)))
    noise = float(np.exp(rng.uniform(math.log(1e-3), math.log(5e-2))))
    readings = readings + largest * noise * rng.standard_normal(readings.shape)
    return Sample(kind, layout, readings, truth, known, False), fault


def row(sample: Sample, method: str, *, timed: bool) -> dict[str, Any]:
    """One frame by one method."""
    skin, components = sample.layout.skin, list(sample.layout.components)
    options: dict[str, Any] = {} if sample.friction is None else {"friction": sample.friction}
    columns = [skin.surface.components.index(c) for c in components]
    touch = skin.reconstruct(sample.readings, method=method, components=components, **options)
    seconds = math.nan
    if timed:
        start = time.process_time()
        skin.reconstruct(sample.readings, method=method, components=components, **options)
        seconds = time.process_time() - start
    true = Touch(sample.truth, touch.surface, touch.components, "truth")
    size = float(np.linalg.norm(sample.truth[columns]))
    values = np.asarray(touch.values)
    out: dict[str, Any] = {"status": int(np.asarray(touch.status)), "empty": sample.empty, "seconds": seconds}
    out["error"] = float(np.linalg.norm((values - sample.truth)[columns])) / size if size else math.nan
    low, high = touch.interval(0.95, "force")
    load = float(true.force[-1])
    out["force"] = bool(low[-1] <= load <= high[-1])
    out["force width"] = float(high[-1] - low[-1]) / load if load > 0 else math.nan
    if size and np.isfinite(values).all():
        low, high = touch.interval(0.95, "peak_pressure")
        peak = float(true.peak_pressure)
        out["peak"], out["peak width"] = bool(low <= peak <= high), float(high - low) / peak
        low, high = (np.asarray(end) for end in touch.interval(0.95, "traction"))
        cells = (sample.truth[-1] > 0) | (values[-1] > 0)
        if len(low) != len(sample.truth):  # components sought alone
            low, high = (
                np.stack([end[components.index(c)] if c in components else 0 * end[0] for c in skin.surface.components])
                for end in (low, high)
            )
        held = ((low <= sample.truth) & (sample.truth <= high))[columns]
        out["cells"] = float(held[:, cells].mean())
        out["cell width"] = float((high - low)[-1][cells].mean()) / peak
    return out


def rows(
    population: str, kind: str, frames: int, seed: int, keep: Path | None, deadline: float
) -> list[dict[str, Any]]:
    """Rows {method: row, fault: ...} of a population, from the folder where they are there already; fewer where time runs out."""
    out = []
    for i in range(frames):
        file = None if keep is None else keep / f"{population}-{kind}-{seed}-{i}.json".replace(" ", "_")
        found = json.loads(file.read_text()) if file is not None and file.exists() else {}
        if any(m not in found for m in METHODS):
            if time.monotonic() > deadline:
                break
            rng = np.random.default_rng((seed, i, KINDS.index(kind)))
            sample, fault = (unseen(rng, kind), "") if population == "unseen" else other(rng, kind)
            found["fault"] = fault
            for m in METHODS:
                if m not in found:
                    found[m] = row(sample, m, timed=i % TIMED == 0)
            if file is not None:
                file.write_text(json.dumps(found))
        out.append(found)
    return out


def mean(values: list[Any]) -> float:
    finite = [float(v) for v in values if v is not None and math.isfinite(v)]
    return float(np.mean(finite)) if finite else math.nan


def table(title: str, found: list[dict[str, Any]]) -> tuple[list[str], dict[str, float]]:
    """Lines of one population and kind, and the numbers of the gates."""
    pressed = [f for f in found if not f["automatic"]["empty"]]
    both = [f for f in pressed if all(math.isfinite(f[m]["error"]) for m in METHODS)]
    error = {m: np.array([f[m]["error"] for f in both]) for m in METHODS}
    ratio = np.log(error["rectified"] / error["automatic"])
    away = 1.96 * float(ratio.std(ddof=1)) / math.sqrt(len(ratio)) if len(ratio) > 1 else math.nan
    lines = [
        f"| {title} ({len(found)}) | median error | error > 1 | force | peak | cells | width of force | of peak | of cells | median time [ms] | no answer | solved as contact when empty |",
        "|---|" + "---|" * 11,
    ]
    for m in METHODS:
        some = [f[m] for f in pressed]
        answered = [f[m] for f in both]
        seconds = [f[m]["seconds"] for f in found if math.isfinite(f[m]["seconds"])]
        empty = [f[m]["status"] not in (1, 9) for f in found if f[m]["empty"]]
        widths = [
            float(np.median([r[w] for r in answered if w in r])) for w in ("force width", "peak width", "cell width")
        ]
        lines.append(
            f"| {m} | {np.median(error[m]):.3f} | {int((error[m] > 1).sum())} | {mean([r['force'] for r in some]):.3f} | "
            f"{mean([r.get('peak') for r in some]):.3f} | {mean([r.get('cells') for r in some]):.3f} | "
            + " | ".join(f"{w:.2f}" for w in widths)
            + f" | {1e3 * float(np.median(seconds)):.0f} | {sum('peak' not in r for r in some)} | {sum(empty)} of {len(empty)} |"
        )
    middle = float(np.exp(ratio.mean()))
    lines += [
        "",
        f"Error over the automatic method's, geometric mean of {len(both)} frames: {middle:.3f} (95 %: {math.exp(ratio.mean() - away):.3f} to {math.exp(ratio.mean() + away):.3f}); "
        f"smaller in {100 * float((ratio < 0).mean()):.0f} % of frames.",
    ]
    faults = sorted({f["fault"] for f in both} - {""})
    if faults:
        parts = []
        for fault in faults:
            part = [r for r, f in zip(ratio, both) if f["fault"] == fault]
            parts.append(f"{fault} {math.exp(float(np.mean(part))):.2f} ({len(part)})")
        lines.append(f"By fault: {', '.join(parts)}.")
    numbers = {"ratio": middle, "peak": mean([f["rectified"].get("peak") for f in pressed]), "frames": len(found)}
    return [*lines, ""], numbers


def one_frame() -> dict[str, float]:
    """Milliseconds of a warm 8 x 8 x 3 frame with friction, 1 % noise, by each method, and of the rectified one's matrix products alone."""
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), array)
    ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=0.1).sliding(0.3)
    readings = np.asarray(skin.sense(ball))
    readings = readings + 0.01 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    out = {}
    for m in METHODS:
        skin.reconstruct(readings, method=m, friction=0.6)
        spent = []
        for _ in range(5):
            start = time.process_time()
            skin.reconstruct(readings, method=m, friction=0.6)
            spent.append(time.process_time() - start)
        out[m] = 1e3 * min(spent)
    import palpate.inverse.rectified.newton as newton

    made, spent_in = newton.linearised, [0.0]

    def watched(*arguments: Any) -> Any:
        start = time.process_time()
        found = made(*arguments)
        spent_in[0] += time.process_time() - start
        return found

    newton.linearised = watched  # type: ignore[assignment]
    try:
        skin.reconstruct(readings, method="rectified", friction=0.6)
    finally:
        newton.linearised = made
    out["products"] = 1e3 * spent_in[0]
    return out


def report(found: dict[tuple[str, str], list[dict[str, Any]]], times: dict[str, float], seed: int) -> str:
    """The page."""
    lines = [
        f'Written by `python benchmarks/rectified.py --seed {seed} --write`. `method="rectified"` beside the automatic method. Error is that of `palpate bench accuracy` (|found - true| / |true| over '
        "all cells); force, peak and cells are parts of true values inside the intervals of 95 %; widths are medians, in parts of the true load or peak. The constants of its intervals come from "
        "`palpate.bench.population`, neither of the populations here.",
        "",
    ]
    gates: list[str] = []
    for population in ("unseen", "other"):
        words = "`palpate.bench.unseen`" if population == "unseen" else "contacts and faults that nothing was tuned on"
        lines += [f"**{words.capitalize() if population == 'other' else words}**", ""]
        for kind in KINDS:
            if not found.get((population, kind)):
                continue
            text, numbers = table(kind, found[population, kind])
            lines += text
            limit = GATES["line" if kind == "line" else "area"]
            for name, value, good in (
                (f"error on {kind}, {population}", numbers["ratio"], numbers["ratio"] <= limit),
                (f"coverage of the peak, {kind}, {population}", numbers["peak"], numbers["peak"] >= GATES["peak"]),
            ):
                bound = f"<= {limit}" if name.startswith("error") else f">= {GATES['peak']}"
                gates.append(
                    f"| {name} | {bound} | {value:.3f} | {int(numbers['frames'])} | {'yes' if good else 'no'} |"
                )
    passed = "yes" if times["rectified"] <= GATES["time"] else "no"
    gates.append(f"| 8 x 8 x 3 frame [ms] | <= {GATES['time']:g} | {times['rectified']:.0f} | 1 | {passed} |")
    lines += ["**Gates**", "", "| gate | bound | found | frames | passed |", "|---|---|---|---|---|", *gates, ""]
    lines += [
        f"A warm 8 x 8 x 3 frame takes {times['rectified']:.0f} ms ({times['automatic']:.0f} by the automatic method), {times['products']:.0f} of them in products of matrices and look-ups of the kernel, "
        "which a compiled core would not make much shorter.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--population", choices=("unseen", "other"))
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--minutes", type=float, default=math.inf)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    deadline = time.monotonic() + 60.0 * given.minutes
    if given.keep is not None:
        given.keep.mkdir(parents=True, exist_ok=True)
    found = {
        (population, kind): rows(population, kind, given.frames, given.seed, given.keep, deadline)
        for population in ("unseen", "other")
        if given.population in (None, population)
        for kind in KINDS
        if given.kind in (None, kind)
    }
    text = report(found, one_frame(), given.seed)
    sys.stdout.write(text)
    if given.write:
        (Path(__file__).parents[1] / "docs" / "_generated" / "rectified.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
