"""How often a frame of a large array is wrong without a warning: faults on 24 x 24 to 128 x 128 taxels.

    python benchmarks/large_arrays.py [--seed 0] [--frames 10] [--sizes 24,32] [--rows clean,offset,...] [--limit 60] [--keep FILE] [--each]
    python benchmarks/large_arrays.py --table FILE ... [--write]

The readings do not come from palpate. Each contact is a lattice of point loads, no coarser than a third of the depth, and the readings are the
sums of the closed forms of Boussinesq and Cerruti (K. L. Johnson, Contact Mechanics, section 3.6) for a half-space. The true force is the sum of
the point loads (`large_frames.py`). The true pressure of a cell is the mean of the contact's profile at 64 points of the cell. This file was written without reading
how palpate solves a frame; it calls only the public interface.

Each frame has its own sensor: pitch 0.5 to 4 mm, depth 0.7 to 2.5 pitches, points or taxels of 0.6 of a pitch (up to 32 x 32), three components of
stress (seven in ten), normal stress alone, or displacement. In half of the frames the noise is given (0.2 to 5 % of the largest reading). Contacts:
balls, punches, blocks, several of these, wide ones; without shear, sliding, or with partial slip. Frame k of a row is the same whatever other
rows are run.

Wrong: the net force is off by more than 30 % of the load. Far outside: a component of the true force lies beyond its 95 % interval by more than half
of the interval's half-width. A word: a status other than "solved" and "no contact", a fit below 0.01, a force that is not a number, an interval of
the normal force wider than the load, or a note that warns. Notes that only report a nuisance that was removed, or readings that were left out, do
not count as a warning. Wrong without a warning: wrong or far outside, and no word; a frame with the note that the force is uncertain counts as well if it
is far outside. Gross: also off by more than 30 % and beyond the interval by more than its width. A needless warning: a word on a right frame. Without
contact, a frame is wrong if it is solved and the interval of the normal force does not reach 0. A frame that takes longer than ``--limit`` seconds
of processor time counts as not in time. Peaks of punches are not counted: their rims are narrower than the depth. The time includes the
preparation of the sensor and the intervals; the memory is the largest of the process.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from large_frames import ROWS, Floats, Frame, loads, make

import palpate as pp
from palpate import Status

TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "large_arrays.md"

#: Notes that begin so report what was found and removed.
REPORTS = ("offset of", "ramp of", "shift of", "rotation of", "left out as unexplained", "no contact:")
UNCERTAIN = "the net force is uncertain"


class TooLong(Exception):
    pass


def _stop(*_: object) -> None:
    raise TooLong


def solve(frame: Frame, limit: float) -> dict[str, Any]:
    """What palpate makes of a frame, beside the truth."""
    s = frame.sensor
    pad = pp.HalfSpace(youngs_modulus=s.modulus, poissons_ratio=s.nu)
    record: dict[str, Any] = {"true": frame.force.tolist()}
    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, limit)
    start = time.process_time()
    try:
        array = pp.AreaArray(
            shape=(s.n, s.n), pitch=s.pitch, depth=s.depth, channels=s.channels, aperture=s.aperture,
            noise=frame.given if frame.zero is None else None, limits=frame.limits,
        )  # fmt: skip
        # The pad is as described and the readings are calibrated: the intervals hold what the frame itself leaves open.
        skin = pp.Skin(pad, array, uncertainty=pp.Uncertainty(youngs_modulus=0.0, scale=0.01))
        touch = skin.reconstruct(frame.readings, **({} if frame.zero is None else {"zero": frame.zero}))
        low, high = touch.interval(0.95, of="force")
        peak_low, peak_high = touch.interval(0.95, of="peak_pressure")
        cell_low, cell_high = touch.interval(0.95)
    except TooLong:
        return record | {"late": True, "time": time.process_time() - start}
    except pp.PalpateError as error:
        return record | {"refused": str(error), "time": time.process_time() - start}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    record["time"] = time.process_time() - start
    components = list(touch.traction.component.values)
    at = ["xyz".index(c) for c in components]
    force = np.zeros(3)
    force[at] = np.asarray(touch.force)
    truth = pressure_of(frame, np.asarray(touch.pressure.x), np.asarray(touch.pressure.y))
    p, p_low, p_high = (np.asarray(v)[components.index("z")] for v in (touch.traction, cell_low, cell_high))
    loaded = truth > 0.05 * truth.max() if frame.contacts else np.zeros(truth.shape, bool)
    record |= {
        "status": Status(int(touch.status)).label, "fit": math.nan if touch.fit is None else float(touch.fit), "notes": [str(n) for n in touch.notes], "force": force.tolist(),
        "low": [float(v) for v in low], "high": [float(v) for v in high], "at": at,
        "load": load_of(frame), "peak": float(touch.peak_pressure), "peak_interval": [float(peak_low), float(peak_high)],
        "true_peak": true_peak(frame, truth),
        "cells": float(np.mean((p_low <= truth) & (truth <= p_high), where=loaded)) if loaded.any() else None,
        "error": float(np.linalg.norm(p - truth) / np.linalg.norm(truth)) if frame.contacts else None,
    }  # fmt: skip
    return record


def pressure_of(frame: Frame, x: Floats, y: Floats) -> Floats:
    """Mean true pressure of each cell."""
    dx, dy = x[1] - x[0], y[1] - y[0]
    total = np.zeros((y.size, x.size))
    t = (np.arange(8) + 0.5) / 8 - 0.5
    for contact in frame.contacts:
        for u in t:
            for v in t:
                total += contact.pressure(x[None, :] + u * dx, y[:, None] + v * dy) / 64
    return total


def true_peak(frame: Frame, cells: Floats) -> float | None:
    """Largest pressure of the profiles; None where a rim or an overlap makes it narrower than the depth."""
    if any(c.shape == "punch" for c in frame.contacts):
        return None
    best = 0.0
    for c in frame.contacts:
        t = np.linspace(-1, 1, 41) * c.reach()
        x, y = np.meshgrid(c.x + t, c.y + t)
        best = max(best, float(sum(other.pressure(x, y) for other in frame.contacts).max()))
    return best


def load_of(frame: Frame) -> float:
    """Integral of the traction's magnitude [N]."""
    return sum(float(np.linalg.norm(loads(c, frame.sensor.depth / 3)[2], axis=0).sum()) for c in frame.contacts)


@dataclass
class Verdict:
    off: float
    beyond: float
    word: bool
    uncertain: bool

    @property
    def wrong(self) -> bool:
        return self.off > 0.3 or self.far

    @property
    def far(self) -> bool:
        return self.beyond > 0.5

    @property
    def silent(self) -> bool:
        return not self.word and (self.far or (self.off > 0.3 and not self.uncertain))


def judge(record: dict[str, Any]) -> Verdict:
    """How far off, how far beyond the interval [half-widths], and whether a word was said."""
    at = record["at"]
    truth, force = np.array(record["true"]), np.array(record["force"])
    low, high = np.array(record["low"]), np.array(record["high"])
    load = record["load"]
    with np.errstate(invalid="ignore", divide="ignore"):
        half = 0.5 * (high - low)
        past = np.maximum(low - truth[at], truth[at] - high)
        beyond = np.where(past <= 0, 0.0, past / half)
    beyond = float(np.nanmax(beyond, initial=0.0))
    off = float(np.linalg.norm((force - truth)[at]) / load) if load else 0.0
    warned = [n for n in record["notes"] if not n.startswith(REPORTS) and not n.lower().startswith(UNCERTAIN)]
    uncertain = any(n.lower().startswith(UNCERTAIN) for n in record["notes"])
    word = (
        record["status"] not in ("solved", "no contact")
        or record["fit"] < 0.01
        or bool(warned)
        or not np.isfinite(force).all()
    )
    width = float(high[-1] - low[-1])
    word = word or (load > 0 and not width <= load)
    return Verdict(off if math.isfinite(off) else math.inf, beyond, word, uncertain)


# ---------------------------------------------------------------------------------------------------------------- tables


def rows_of(records: list[dict[str, Any]]) -> Iterator[str]:
    yield (
        "| row | frames | wrong by > 30 % / without a warning | force far outside 95 % / without a warning | wrong without a warning / gross | coverage at 95 %: force, peak, "
        "cells | needless warnings | force error p50, p90 | traction error | time p50, max [s] |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for name in [r for r in ROWS if any(x["row"] == r for x in records)]:
        yield _row(name, [r for r in records if r["row"] == name])
    yield _row("all", records)


def _row(name: str, records: list[dict[str, Any]]) -> str:
    done = [r for r in records if "status" in r]
    verdicts = [judge(r) for r in done]
    wrong, far = [v for v in verdicts if v.off > 0.3], [v for v in verdicts if v.far]
    silent = [v for v in verdicts if v.silent]
    gross = [v for v in silent if v.off > 0.3 and v.beyond > 2.0]
    inside = [v.beyond == 0 for r, v in zip(done, verdicts, strict=True)]
    peaks = [
        r["peak_interval"][0] <= r["true_peak"] <= r["peak_interval"][1]
        for r in done
        if r["true_peak"] and math.isfinite(r["peak"])
    ]
    cells = [r["cells"] for r in done if r["cells"] is not None]
    needless = sum(v.word and not v.wrong for v in verdicts)
    errors = [v.off for r, v in zip(done, verdicts, strict=True) if r["load"]]
    fields = [r["error"] for r in done if r["error"] is not None]
    times = [r["time"] for r in records]
    notes = [
        f"{count} {word}"
        for count, word in (
            (sum("late" in r for r in records), "not in time"),
            (sum("refused" in r for r in records), "refused"),
        )
        if count
    ]
    quiet = lambda found: f"{len(found)} / {sum(v.silent for v in found)}"  # noqa: E731
    mean = lambda values: f"{np.mean(values):.2f}" if values else "-"  # noqa: E731
    spread = f"{np.median(errors):.3f}, {np.quantile(errors, 0.9):.3f}" if errors else "-"
    return (
        f"| {name} | {len(records)}{' (' + ', '.join(notes) + ')' if notes else ''} | {quiet(wrong)} | {quiet(far)} | {len(silent)} / {len(gross)} | "
        f"{mean(inside)}, {mean(peaks)}, {mean(cells)} | {needless} | {spread} | {f'{np.median(fields):.2f}' if fields else '-'} | "
        f"{np.median(times):.1f}, {np.max(times):.1f} |"
    )


def sizes_of(records: list[dict[str, Any]]) -> Iterator[str]:
    yield "| size | frames | wrong without a warning | time p50, p90, max [s] | not in time | memory of all in one process [MiB] |"
    yield "|---|---|---|---|---|---|"
    for n in sorted({r["n"] for r in records}):
        mine = [r for r in records if r["n"] == n]
        times = [r["time"] for r in mine]
        silent = sum(judge(r).silent for r in mine if "status" in r)
        p50, p90 = np.quantile(times, [0.5, 0.9])
        memory = max(r["memory"] for r in mine if "memory" in r)
        yield f"| {n} x {n} | {len(mine)} | {silent} | {p50:.1f}, {p90:.1f}, {max(times):.1f} | {sum('late' in r for r in mine)} | {memory:.0f} |"


def meanings() -> Iterator[str]:
    yield "| row | what is wrong |"
    yield "|---|---|"
    for name, row in ROWS.items():
        yield f"| {name} | {(row.what or str(row.fault.__doc__)).strip().rstrip('.')} |"


def table(records: list[dict[str, Any]]) -> str:
    seeds = ", ".join(str(s) for s in sorted({r["seed"] for r in records}))
    counts = "; ".join(f"{sum(r['n'] == n for r in records)} of {n} x {n}" for n in sorted({r["n"] for r in records}))
    head = f"Made by `python benchmarks/large_arrays.py`, seed {seeds}: {counts}."
    return "\n".join([head, "", *rows_of(records), "", *sizes_of(records), "", *meanings()]) + "\n"


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--seed", type=int, default=0)
    ask.add_argument("--frames", type=int, default=10, help="frames of each row and size")
    ask.add_argument("--first", type=int, default=0)
    ask.add_argument("--sizes", default="24,32")
    ask.add_argument(
        "--rows",
        default=",".join(r.replace(", ", "_") for r in ROWS),
        help="rows, separated by commas; 'empty_offset' is 'empty, offset'",
    )
    ask.add_argument("--limit", type=float, default=60.0, help="processor seconds of a frame")
    ask.add_argument("--keep", type=Path, help="append each frame to this file, a line of JSON each")
    ask.add_argument("--each", action="store_true", help="print each frame")
    ask.add_argument("--table", type=Path, nargs="+", help="make the table of these files instead")
    ask.add_argument("--write", action="store_true", help=f"write it to {TABLE.name}")
    options = ask.parse_args()
    records: list[dict[str, Any]] = []
    if options.table:
        records = [json.loads(line) for path in options.table for line in path.read_text().splitlines()]
    else:
        names = [name.replace("_", ", ") for name in options.rows.split(",")]
        for n in map(int, options.sizes.split(",")):
            for k in range(options.first, options.first + options.frames):
                for name in names:
                    frame = make(name, n, options.seed, k)
                    record = {"row": name, "n": n, "seed": options.seed, "k": k} | solve(frame, options.limit)
                    record["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                    records.append(record)
                    if options.keep:
                        with options.keep.open("a") as file:
                            file.write(json.dumps(record) + "\n")
                    if options.each:
                        print(_line(record), flush=True)
    text = table(records)
    print(text)
    if options.write:
        TABLE.write_text(text)


def _line(record: dict[str, Any]) -> str:
    start = f"{record['row']:16s} {record['n']:3d} {record['k']:3d} {record['time']:6.1f} s "
    if "status" not in record:
        return start + ("not in time" if "late" in record else record["refused"])
    v = judge(record)
    mark = "SILENT" if v.silent else "wrong" if v.wrong else ""
    return (
        start
        + f"{record['status']:11s} fit {record['fit']:.3f} off {v.off:.3f} beyond {v.beyond:.2f} {mark:6s} {record['notes']}"
    )


if __name__ == "__main__":
    main()
