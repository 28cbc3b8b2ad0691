"""Processor time of a calibration, one thread.

    python benchmarks/calibrate_times.py            # prints a table
    python benchmarks/calibrate_times.py --write    # docs/_generated/calibrate_times.md

Marker readings are closed forms of a half-space, those of the taxels come from `Skin.sense`; noise is 1 %. Designs a minute: benchmarks/design.py --pace.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "calibrate_times.md"
REST = 10


def noisy(readings: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Frames at rest, then the presses."""
    frames = np.concatenate([np.zeros((REST, *readings.shape[1:])), readings])
    return np.asarray(frames + 0.01 * np.abs(readings).max() * rng.standard_normal(frames.shape))


def markers(presses: int) -> tuple[pp.Skin, np.ndarray, dict[str, np.ndarray]]:
    """20 x 20 markers that move sideways, 1 mm apart, 2 mm deep."""
    rng = np.random.default_rng(0)
    channels = ["displacement_x", "displacement_y"]
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, pp.AreaArray(shape=(20, 20), pitch=1e-3, depth=2e-3, channels=channels))
    y, x = skin.planes[0].points.T
    force, radius = rng.uniform(0.5, 4.0, presses), np.resize([4e-3, 6e-3, 9e-3], presses)
    made = []
    for f, r in zip(force, radius):
        a, b = rng.uniform(-6e-3, 6e-3, 2)
        contact = pp.solutions.hertz_contact_radius(pad, radius=r, force=f)
        made.append(
            pp.solutions.hertz_point(force=f, contact_radius=contact).fields(pad, channels, x - a, y - b, 2.2e-3)
        )
    frames = noisy(np.stack(made).reshape(presses, 2, 20, 20), rng)
    return skin, frames, {"fz": np.r_[np.zeros(REST), force], "ball_radius": np.r_[np.full(REST, np.nan), radius]}


def taxels(presses: int) -> tuple[pp.Skin, np.ndarray, dict[str, np.ndarray]]:
    """4 x 4 pressures at the base of a bonded pad."""
    rng = np.random.default_rng(0)
    pad = pp.BondedLayers([pp.Layer(thickness=6e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    skin = pp.Skin(pad, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth="base", channels=["stress_zz"]))
    unit = np.asarray(
        skin.sense(
            np.stack(
                [
                    skin.sample(
                        pp.solutions.hertz_point(force=1.0, contact_radius=2e-3).shifted(*rng.uniform(-6e-3, 6e-3, 2))
                    )
                    for _ in range(20)
                ]
            )
        )
    )
    force = rng.uniform(0.5, 4.0, presses)
    frames = noisy(force[:, None, None, None] * unit[rng.integers(20, size=presses)], rng)
    return skin, frames, {"fz": np.r_[np.zeros(REST), force]}


def timed(skin: pp.Skin, frames: np.ndarray, known: dict[str, np.ndarray], **options: Any) -> tuple[float, float]:
    clock, processor = time.perf_counter(), time.process_time()
    skin.calibrate(frames, reference=known, **options)
    return time.process_time() - processor, time.perf_counter() - clock


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write {GENERATED.name}")
    given = parser.parse_args()
    cases: list[tuple[str, tuple[Any, Any, Any], dict[str, Any]]] = [
        ("20 presses, 20 x 20 markers: force", markers(20), {}),
        ("the same, with modulus and depth", markers(20), {"constants": ["youngs_modulus", "depth"]}),
        ("the same, four pads ranked", markers(20), {"constants": ["youngs_modulus", "depth"], "pad_models": ["half-space", "bonded", "stack", "soft base"]}),
        ("300 frames of 16 channels", taxels(290), {}),
    ]  # fmt: skip
    rows = ["| calibration | processor time [s] | on the clock of a shared machine [s] |", "|---|---|---|"]
    for name, case, options in cases:
        processor, clock = timed(*case, **options)
        rows.append(f"| {name} | {processor:.1f} | {clock:.1f} |")
        print(rows[-1], flush=True)
    if given.write:
        GENERATED.write_text("\n".join([*rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
