"""Violations of `palpate bench trust` on pads that end and bend: two boxes and a dome.

    pip install "palpate[solid]" && python benchmarks/solid_trust.py [--frames 5] [--seeds 0 1] [--write]

Presses, faults and the judge are those of `palpate bench trust` (`palpate.bench.trust`), in rows that need no other sensor. Readings are those of a finer mesh than the
model's, whose error is worked out with a third one and stated. Nobody states the noise. `--write` writes
docs/_generated/solid_trust.md.
"""

from __future__ import annotations

import argparse
import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.bench.trust.judge import Verdict, _unanswered, verdict
from palpate.bench.trust.presses import Load
from palpate.bench.trust.rows import ROWS, USUAL, Frame, _Draft
from palpate.bench.trust.sensors import Sensor
from palpate.errors import PalpateError

PAGE = Path(__file__).parents[1] / "docs" / "_generated" / "solid_trust.md"
#: All rows but those of other descriptions of the pad, of recordings, of square arrays and of other channels.
CHOSEN = [
    name
    for name, row in ROWS.items()
    if row.described is None and row.recorded is None and name not in ("transposed", "stage drift", "unseen shear")
]
MODULUS, RATIO = 2e5, 0.48
MATERIAL = {"youngs_modulus": MODULUS, "poissons_ratio": RATIO}
CHANNELS = ("stress_xz", "stress_yz", "stress_zz")
#: Cells of the readings along the shorter side.
FINE = 56
#: Makers by name: of the readings, of the model, and what it is compared with.
PADS = {
    "box 16 x 16 x 4 mm": [(pp.SolidPad.box, (16e-3, 16e-3, 4e-3), e) for e in (1.0e-3, 4e-3 / 3, 1.2e-3)],
    "box 20 x 12 x 3 mm": [(pp.SolidPad.box, (20e-3, 12e-3, 3e-3), e) for e in (0.75e-3, 1.0e-3, 0.9e-3)],
    "dome, radius 10 mm, 4 mm thick": [(pp.SolidPad.dome, (10e-3, 4e-3), e) for e in (1.15e-3, 4e-3 / 3, 1.5e-3)],
}


class OnSolid(Load):
    """A load on cells of a solid pad; its force is along the pad's axes."""

    @property
    def force(self) -> np.ndarray:
        return np.asarray(self.grid.total_force(self.traction))


class Bench:
    """One pad: what makes readings, and what a user has."""

    def __init__(self, name: str) -> None:
        truth, model, other = (make(*sizes, element=e, **MATERIAL) for make, sizes, e in PADS[name])
        (x0, x1), (y0, y1) = truth.outline
        #: Part of the pad under taxels: of the dome what a flat sensor sees of it.
        part = 0.55 if truth.chart is not None else 0.8
        shape = (4, 5)
        pitch = (part * (y1 - y0) / shape[0], part * (x1 - x0) / shape[1])
        array = pp.AreaArray(shape=shape, pitch=pitch, depth="base", channels=CHANNELS)
        self.error = model.mesh_error(other, array)
        self.model, self.array = model, array
        self.skin = pp.Skin(model, array, uncertainty=pp.Uncertainty(gain=self.error))
        step = min(x1 - x0, y1 - y0) / FINE
        shape_of_cells = (round((y1 - y0) / step), round((x1 - x0) / step))
        self.fine = truth.grid(shape=shape_of_cells, spacing=step)
        self.maker = pp.Skin(truth, array, surface=self.fine)
        self.reach = (0.5 * part * (x1 - x0), 0.5 * part * (y1 - y0))
        self.sensor = Sensor("area", shape, min(pitch), truth.thickness, 0.0, CHANNELS, MODULUS, RATIO)

    def load(self, rng: np.random.Generator, kind: str = "press") -> OnSolid:
        """A ball or two anywhere over the taxels, sliding or not; small ones of 0.2 to 0.7 pitches, and with adhesion one
        whose rim pulls with 20 to 60 % of the peak.
        """
        total, words = np.zeros((3, *self.fine.shape)), []
        for _ in range(1 if rng.random() < 0.7 or kind == "adhesion" else 2):
            small, rim = kind == "small", ""
            radius = float(rng.uniform(0.2, 0.7) * self.sensor.pitch if small else rng.uniform(1.2e-3, 2.5e-3))
            x, y = (float(rng.uniform(-r, r)) for r in self.reach)
            force, friction, way = (
                float(rng.uniform(0.3, 2.0)),
                float(rng.uniform(0.0, 0.6)),
                float(rng.uniform(0, 6.28)),
            )
            ball = pp.solutions.hertz_point(contact_radius=radius, force=force)
            pressure = np.asarray(self.maker.sample(ball.shifted(x, y)))[2]
            if kind == "adhesion":
                part = float(rng.uniform(0.2, 0.6))
                away = np.hypot(*(a - b for a, b in zip(np.meshgrid(self.fine.x, self.fine.axes[0]), (x, y))))
                pressure = pressure - part * pressure.max() * ((away > radius) & (away < 1.35 * radius))
                rim = f", whose rim pulls with {part:.0%} of the peak"
            total += pressure * np.array([friction * np.cos(way), friction * np.sin(way), 1.0])[:, None, None]
            words.append(f"{force:.2f} N, radius {1e3 * radius:.1f} mm at ({1e3 * x:.1f}, {1e3 * y:.1f}) mm{rim}")
        # what lies beside the pad presses nothing
        return OnSolid(self.fine, total * (self.fine.areas > 0.0), " and ".join(words))

    def frame(self, row: str, index: int, seed: int) -> Frame:
        this = ROWS[row]
        rng = np.random.default_rng([seed, zlib.crc32(row.encode()), index])
        typical = load = self.load(rng, this.load)
        if this.load == "pull":
            typical = load = replace(load, traction=-load.traction)
        readings = np.array(self.maker.sense(load.traction))
        level = float(np.exp(rng.uniform(*np.log(this.noise if row != "clean" else USUAL))))
        std = level * float(np.abs(readings).max())
        noise = std * rng.standard_normal(readings.shape)
        if this.load == "nothing":
            load, readings = replace(load, traction=0.0 * load.traction, words="nothing touches"), 0.0 * readings
        draft = _Draft(self.sensor, load, readings, noise, rng)
        draft.say(f"noise {level:.2g} of the largest reading")
        if this.change is not None:
            this.change(draft)
        said = None
        if this.misstated:
            said = std * float(rng.choice([1 / 3, 3.0]))
            draft.say(f"noise said to be {said / std:.2g} times what it is")
        ball = pp.solutions.hertz_point(contact_radius=1.8e-3, force=1.0)
        clean = np.array(self.maker.sense(self.maker.sample(ball)))
        clean = clean + level * float(np.abs(clean).max()) * rng.standard_normal(clean.shape)
        if draft.limits is not None:  # the clean frame must be within the range
            clean *= 0.9 * draft.limits / float(np.abs(clean).max())
        return Frame(
            row=row,
            index=index,
            sensor=self.sensor,
            described=self.sensor,
            uncertainty=this.uncertainty,
            friction=None,
            noise=None if said is None else (said,) * len(CHANNELS),
            readings=draft.readings + draft.noise,
            load=load,
            typical=typical,
            reference=clean,
            words=", ".join(draft.words),
            limits=draft.limits,
        )

    def skin_for(self, frame: Frame) -> pp.Skin:
        """The skin that a user would make: one for all frames, but where a frame states noise, gains or limits."""
        if frame.noise is None and frame.limits is None and not frame.uncertainty:
            return self.skin
        array = replace(self.array, noise=None if frame.noise is None else frame.noise[0], limits=frame.limits)
        gain = float(np.hypot(self.error, frame.uncertainty.get("gain", 0.0)))
        return pp.Skin(self.model, array, uncertainty=pp.Uncertainty(gain=gain))

    def judged(self, frame: Frame) -> Verdict:
        """The verdict; the clean frame, whose notes do not count, is solved only where the force is wrong or far outside."""
        start = time.process_time()
        try:
            skin = self.skin_for(frame)
            touch = skin.reconstruct(frame.readings)
            found = verdict(frame, touch, touch, time.process_time() - start)
            if found.wrong or found.far:
                found = verdict(frame, touch, skin.reconstruct(frame.reference), found.seconds)
        except PalpateError as error:
            return _unanswered(frame, f"refused: {error}", words=(f"refused: {error}",))
        return found


def table(frames: int, seeds: Sequence[int], rows: Sequence[str], pads: Sequence[str]) -> list[str]:
    lines = [
        "| pad (error of its mesh) | row | frames | wrong | wrong without a warning | outside of the interval | components inside |",
        "|---|---|---|---|---|---|---|",
    ]
    every: list[Verdict] = []
    cases = []
    for name in pads:
        bench = Bench(name)
        here: list[Verdict] = []
        for row in rows:
            found = [bench.judged(bench.frame(row, i, seed)) for seed in seeds for i in range(frames)]
            here += found
            lines.append(_line(f"{name} ({100 * bench.error:.1f} %)", row, found))
            print(lines[-1], flush=True)
        cases += [f"- {name}: {v.frame}. Found {_numbers(v.found)} N, true {_numbers(v.true)}, interval {_numbers(v.low)} to {_numbers(v.high)}." for v in here if v.betrays]  # fmt: skip
        lines.append(_line(f"{name} ({100 * bench.error:.1f} %)", "**all**", here))
        every += here
    lines.append(_line("all pads", "**all**", every))
    return [*lines, "", "Wrong without a warning, each:", "", *(cases or ["none"])]


def _line(pad: str, row: str, found: Sequence[Verdict]) -> str:
    inside = np.nanmean([v.inside["force"] for v in found])
    return (
        f"| {pad} | {row} | {len(found)} | {sum(v.wrong for v in found)} | {sum(v.betrays for v in found)} | {sum(v.far for v in found)} | "
        f"{inside:.2f} |"
    )


def _numbers(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{v:.2f}" for v in values) + ")"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--rows", nargs="*", default=CHOSEN, choices=list(ROWS))
    parser.add_argument("--pads", nargs="*", default=list(PADS), choices=list(PADS))
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args()
    out = [
        f"Made by `python benchmarks/solid_trust.py --frames {chosen.frames} --seeds {' '.join(map(str, chosen.seeds))} --write`.",
        "",
        "One or two balls press anywhere over 4 x 5 x 3 taxels on the base, with contact radii of 1.2 to 2.5 mm (small ones: 0.2 to 0.7 pitches), 0.3 to 2 N, and shear up to 0.6 of that. "
        "The readings come from a finer mesh. The error of the model's mesh, from a third mesh, is stated; the noise is not, except where it is misstated. The rows of wrong pad "
        "descriptions, recordings, square arrays and displacements are left out. Faults, and what counts as wrong, as a warning and as far outside, are those of "
        "`palpate bench trust` (net force off by more than 30 % of the load; outside its 95 % interval by more than half its half-width).",
        "",
        *table(chosen.frames, chosen.seeds, chosen.rows, chosen.pads),
        "",
    ]
    text = "\n".join(out)
    if chosen.write:
        PAGE.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
