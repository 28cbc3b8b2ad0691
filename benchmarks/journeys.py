"""The journeys of the first hour: what each file of a new user needs from a clone to a number with its interval and a figure.

    python benchmarks/journeys.py [counts] [markers] [field] [video] [--write] [--keep FOLDER]

Makes the files that docs/howto/first-hour.md speaks of (palpate demo taxels, markers, field), takes commands from that page (and the one of cameras) as they stand
there, runs each in a process of its own, and holds what comes out beside the truth. ``--write`` puts the table into docs/_generated/journeys.md;
``--keep`` leaves files and pictures in a folder.
"""

from __future__ import annotations

import argparse
import re
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas

import palpate as pp
from palpate.cli import demofiles

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs" / "howto"


@dataclass(frozen=True)
class Step:
    """One command: how long it took [s], on the wall and of processor time with its children, and what its answer is beside the truth."""

    journey: str
    command: str
    wall: float
    cpu: float
    answer: str


def shown(page: str, command: str) -> str:
    """The command of a page that begins so, on one line."""
    text = (PAGES / page).read_text(encoding="utf-8").replace("\\\n", " ")
    found = re.search(rf"`({re.escape(command)}[^`]*)`", text)
    if found is None:
        raise SystemExit(f"{page} shows no {command}")
    return " ".join(found.group(1).split())


def commands(page: str) -> list[str]:
    """Commands that a page shows, in its order."""
    text = (PAGES / page).read_text(encoding="utf-8").replace("\\\n", " ")
    return [
        " ".join(c.split())
        for c in re.findall(r"^\s*(?:\d\. )?`?(palpate (?:track|reconstruct|tfm) [^`\n]*)", text, re.MULTILINE)
    ]


def run(journey: str, command: str, folder: Path, answer: Callable[[], str], said: list[str] | None = None) -> Step:
    """One command in a folder, by the interpreter that runs this; what it prints goes to ``said``."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", *shlex.split(command)], cwd=folder, capture_output=True, text=True, check=False
    )
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{command}\n{done.stdout}{done.stderr}")
    if said is not None:
        said.append(done.stdout)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Step(journey, command, wall, cpu, answer())


def beside(table: Path, frame: int, true: float) -> str:
    """The normal force of one frame beside the truth, and how many frames hold it."""
    rows = pandas.read_csv(table)
    row = rows.iloc[frame]
    low, found, high = (float(row[f"force_z{end} (N)"]) for end in ("_low", "", "_high"))
    return f"{found:.2f} N ({low:.2f} to {high:.2f}) for {true:.2f}"


def counts(folder: Path) -> Iterator[Step]:
    """300 frames of 48 raw counts: a finger presses, slides and leaves."""
    load = demofiles.demo_taxels(folder, 0, lambda _: None)
    track, one = (c for c in commands("first-hour.md") if "taxels.csv" in c)
    yield run("counts", track, folder, lambda: beside(folder / "forces.csv", 150, float(load[150])))

    yield run("counts", one + " --out one.csv", folder, lambda: beside(folder / "one.csv", 0, float(load[150])))
    whole = one.replace(" --frame 150", "").replace("touch.png", "all.png") + " --out all.csv"
    yield run("counts", whole, folder, lambda: beside(folder / "all.csv", 150, float(load[150])))


def markers(folder: Path) -> Iterator[Step]:
    """100 frames of 80 markers in pixels."""
    load = demofiles.demo_markers(folder, 0, lambda _: None)
    track, one = (c for c in commands("first-hour.md") if "markers.csv" in c)
    yield run("markers", track, folder, lambda: beside(folder / "gel-forces.csv", 60, float(load[60])))
    out = one + " --out one.csv"
    yield run("markers", out, folder, lambda: beside(folder / "one.csv", 0, float(load[60])))


def field(folder: Path) -> Iterator[Step]:
    """128 x 128 vectors of a cell that pulls at its ends, in pixels."""
    energy = demofiles.demo_field(folder, 0, lambda _: None)
    (command,) = (c for c in commands("first-hour.md") if "u.npy" in c)

    def answer() -> str:
        table = next(folder.glob("**/*.csv"))
        rows = pandas.read_csv(table)
        row = rows[rows.iloc[:, 0].astype(str).str.contains("strain")].iloc[0]
        found, low, high = (1e15 * float(row[name]) for name in ("value", "low_95", "high_95"))
        return f"strain energy {found:.1f} fJ ({low:.1f} to {high:.1f}) for {1e15 * energy:.1f}"

    yield run("field", command, folder, answer)


def video(folder: Path) -> Iterator[Step]:
    """Two films of a phone, 640 x 480 at 30 a second: a weight of 200 g on a gel of 260 kPa, and a finger that presses and slides."""
    from palpate.camera import Dots, Looks, Scene, dot_grid, write_video

    def scene(seed: int) -> Any:
        gel = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=2.6e5, poissons_ratio=0.48)])
        rng = np.random.default_rng(seed)
        places = dot_grid((8, 11), 2e-3) + 5e-5 * np.random.default_rng(5).standard_normal((88, 2))
        looks = Looks(noise=3.0, colour=0.5, shading=0.3, glare=[(120.0 + 5 * rng.random(), 90.0, 14.0)])
        return Scene(
            pad=gel,
            depth=0.5e-3,
            print=Dots(places, 0.8e-3),
            size=(640, 480),
            scale=3.75e-5,
            distance=25e-3,
            looks=looks,
        )

    weight = pp.solutions.hertz_point(contact_radius=4e-3, force=1.96)
    write_video(folder / "weight.mp4", scene(1).pictures([None] * 15 + [weight] * 15), rate=30.0)
    load = np.interp(np.arange(90), [15, 40, 75, 88], [0.0, 1.5, 1.5, 0.0])
    slide = np.interp(np.arange(90), [40, 60], [0.0, 0.3])
    finger = [
        pp.solutions.hertz_point(contact_radius=3e-3 * (f / 1.5) ** (1 / 3), force=f).sliding(q) if f > 0.02 else None
        for f, q in zip(load, slide)
    ]
    write_video(folder / "press.mp4", scene(2).pictures(finger), rate=30.0)
    skin = folder / "gel.toml"

    def measured() -> str:
        """What the user of the page measures."""
        text = skin.read_text(encoding="utf-8").replace('# distance = "25 mm"', 'distance = "25 mm"')
        skin.write_text(text.replace('depth = "0.5 mm +- 20 %"', 'depth = "0.5 mm +- 10 %"'), encoding="utf-8")
        return "lines marked <- measured"

    yield run("video", shown("camera.md", "palpate sensors own_gel"), folder, measured)
    said: list[str] = []

    def modulus() -> str:
        found = re.search(r"([\d.]+) kPa \+- ([\d.]+ ?%?)", said[-1])
        if found is None:
            raise SystemExit(said[-1])
        text = skin.read_text(encoding="utf-8").replace('"300 kPa +- 30 %"', f'"{found.group(0)}"')
        skin.write_text(text, encoding="utf-8")
        return f"{found.group(0)} for 260"

    yield run("video", shown("camera.md", "palpate weigh weight.mp4"), folder, modulus, said)
    track = shown("camera.md", "palpate track press.mp4")
    yield run(
        "video",
        track.replace("touch.nc", "every10.csv"),
        folder,
        lambda: beside(folder / "every10.csv", 6, float(load[60])),
    )
    fast = "palpate track press.mp4 --skin gel.toml --fast --friction 0.6 --out forces.csv --plot-forces forces.png"
    yield run("video", fast, folder, lambda: beside(folder / "forces.csv", 60, float(load[60])))


JOURNEYS = {"counts": counts, "markers": markers, "field": field, "video": video}


def main() -> None:
    """Run the journeys that are asked for and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("journeys", nargs="*", metavar="journey", help=", ".join(JOURNEYS))
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    lines = ["| case | command | seconds | seconds of processor time | result |", "|---|---|---|---|---|"]
    print("\n".join(lines), flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        for name in asked.journeys or JOURNEYS:
            folder = (asked.keep or Path(temporary)) / name
            folder.mkdir(parents=True, exist_ok=True)
            for step in JOURNEYS[name](folder):
                lines.append(
                    f"| {step.journey} | `{step.command}` | {step.wall:.0f} | {step.cpu:.0f} | {step.answer} |"
                )
                print(lines[-1], flush=True)
    if asked.write:
        head = "Written by `python benchmarks/journeys.py --write`: the commands of the first hour, on files made from known contacts."
        (ROOT / "docs" / "_generated" / "journeys.md").write_text("\n".join([head, "", *lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
