"""What is too large is refused at once: layouts beyond what methods serve, each with what is said, after how long, and how much memory it took.

    python benchmarks/refusals.py [--only TEXT ...] [--write]

Each case in a process of its own, with a limit of its address space and of its processor time (Linux, macOS). Seconds of processor time and memory count
from when palpate is imported; readings that a contact makes are made before (they cost no more than the frame). A case is refused (an exception
of palpate's), prepared (no frame is asked for), served, not in time, or a defect: anything else. ``--write`` writes docs/_generated/refusals.md.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scale

import palpate as pp
from palpate.errors import PalpateError

TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "refusals.md"
PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
LAYER = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
#: Bytes of address space, processor seconds, and characters of a message in the table.
MEMORY, SECONDS, WORDS = 12e9, 60, 400
#: A refusal later than this is a defect [s].
AT_ONCE = 5.0


def stress(*shape: int, **options: Any) -> pp.AreaArray:
    return pp.AreaArray(shape=shape, pitch=1e-3, depth=2e-3, channels=scale.STRESS, **options)


def beads(n: int, channels: list[str] = scale.SHIFT, depth: float = 0.0, **options: Any) -> pp.ScatteredArray:
    points = scale.beads(n).points[:, ::-1]
    return pp.ScatteredArray(positions=points, depth=depth, channels=channels, **options)


@dataclass(frozen=True)
class Case:
    """A layout and what is asked of it."""

    array: Callable[[], Any]
    options: dict[str, Any] = field(default_factory=dict)
    pad: Any = PAD
    skin: dict[str, Any] = field(default_factory=dict)
    #: "noise": readings of noise; "contact": balls that are dragged, "wide": one over most of the array; "bumps": those of `scale.pressed`.
    readings: str = "noise"
    #: What is done with the skin and its readings, if not one frame.
    run: str = "frame"
    memory: float = MEMORY
    seconds: int = SECONDS


def density(k: Any) -> Any:
    return np.ones_like(k)


#: What each method needs said.
SAID: dict[str, dict[str, Any]] = {
    "wiener": {"spectrum": density},
    "constant_friction": {"friction": 0.5},
    **{m: {"components": ["z"]} for m in ("nnls", "elastic_net", "tv", "maxent", "network")},
}


def each_method() -> dict[str, Case]:
    """Every method there is, at sizes of which most serve none."""
    out = {}
    for method in pp.methods():
        noise = {"noise": 1e-6} if method == "wiener" else {}
        layouts: dict[str, Callable[[], Any]] = {
            "128 x 128 x 3": lambda noise=noise: stress(128, 128, **noise),
            "480 x 640 x 2": lambda noise=noise: pp.AreaArray(
                shape=(480, 640), pitch=1e-3, depth=0.0, channels=scale.SHIFT, **noise
            ),
            "20,000 beads x 2": lambda noise=noise: beads(20_000, **noise),
            "line of 100,000 x 2": lambda noise=noise: pp.LineArray(
                count=100_000, pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_zz"], **noise
            ),
        }
        for name, array in layouts.items():
            out[f"{name}: {method}"] = Case(array, {"method": method, **SAID.get(method, {})}, run="prepare")
    return out


LINEAR = {"method": "tikhonov"}
SERVED: dict[str, Case] = {
    f"{name}: tikhonov": Case(array, LINEAR, readings="bumps", memory=8e9, seconds=300, **more)
    for name, array, more in (
        ("256 x 256 x 3", lambda: stress(256, 256), {}),
        ("480 x 640 x 2, bumps", lambda: scale.area(480, 640, channels=scale.SHIFT), {}),
        ("20,000 beads x 2, bumps", lambda: beads(20_000), {}),
        ("256 x 256 x 2, a layer", lambda: scale.area(256, 256, channels=scale.SHIFT), {"pad": LAYER}),
        ("480 x 640 x 2, a layer", lambda: scale.area(480, 640, channels=scale.SHIFT), {"pad": LAYER}),
    )
}
OTHERS: dict[str, Case] = {
    # larger than any is served
    "4096 x 4096 x 2: tikhonov": Case(lambda: scale.area(4096, 4096, channels=scale.SHIFT), LINEAR),
    "2048 x 2048 x 3: tikhonov": Case(lambda: stress(2048, 2048), LINEAR),
    "1024 x 1024 x 3: automatic": Case(lambda: stress(1024, 1024)),
    "200,000 beads x 2: tikhonov": Case(lambda: beads(200_000), LINEAR, run="prepare", memory=8e9),
    "line of 1,000,000 x 2: tikhonov": Case(lambda: scale.line(1_000_000), LINEAR, run="prepare"),
    "line of 10,000,000 x 2: tikhonov": Case(lambda: scale.line(10_000_000), LINEAR),
    # one dense thing among what is served
    "2601 beads x 2, correlated noise: tikhonov": Case(lambda: beads(2601, noise=1e-7, noise_correlation=2e-3), LINEAR),
    "128 x 128 x 3, correlated noise, one missing: tikhonov": Case(
        lambda: stress(128, 128, noise=5.0, noise_correlation=1e-3, mask=np.arange(128**2).reshape(128, 128) != 300),
        LINEAR,
    ),
    "128 x 128 x 3, correlated noise: automatic": Case(lambda: stress(128, 128, noise=5.0, noise_correlation=1e-3)),
    "20,000 beads x 2: tikhonov, order 2": Case(lambda: beads(20_000), {**LINEAR, "order": 2}),
    "128 x 128 x 3: tikhonov, L-curve": Case(lambda: stress(128, 128), {**LINEAR, "rule": "lcurve"}),
    # scattered positions
    "2000 beads x 3, stress: automatic": Case(lambda: beads(2000, scale.STRESS, 2e-3)),
    "5000 beads x 3, stress: automatic": Case(lambda: beads(5000, scale.STRESS, 2e-3)),
    "20,000 beads x 3, stress: automatic": Case(lambda: beads(20_000, scale.STRESS, 2e-3)),
    "20,000 beads x 3, displacement: automatic": Case(lambda: beads(20_000, scale.SHIFTS, 1e-3)),
    # layers
    "128 x 128 x 3, a layer: truncated": Case(lambda: stress(128, 128), {"method": "truncated"}, LAYER),
    "1024 x 1024 x 3, a layer: tikhonov": Case(lambda: stress(1024, 1024), LINEAR, LAYER, run="prepare"),
    "2601 beads x 2, a layer: tikhonov": Case(lambda: beads(2601), LINEAR, LAYER),
    "20,000 beads x 2, a layer: tikhonov": Case(lambda: beads(20_000), LINEAR, LAYER),
    "20,000 beads x 3, stress, a layer: automatic": Case(lambda: beads(20_000, scale.STRESS, 2e-3), {}, LAYER),
    # periodic
    "1024 x 1024 x 3, periodic: tikhonov": Case(lambda: stress(1024, 1024), LINEAR, skin={"boundary": "periodic"}),
    "4096 x 4096 x 3, periodic: tikhonov": Case(lambda: stress(4096, 4096), LINEAR, skin={"boundary": "periodic"}),
    "2601 beads x 2, periodic: tikhonov": Case(lambda: beads(2601), LINEAR, skin={"boundary": "periodic"}),
    "128 x 128 x 3, periodic: automatic, friction": Case(
        lambda: stress(128, 128), {"friction": 0.5}, skin={"boundary": "periodic"}
    ),
    "128 x 128 x 3, periodic: constrained": Case(
        lambda: stress(128, 128), {"method": "constrained"}, skin={"boundary": "periodic"}
    ),
    "64 x 64 x 3, periodic, one missing: tikhonov": Case(
        lambda: stress(64, 64, mask=np.arange(64**2).reshape(64, 64) != 300), LINEAR, skin={"boundary": "periodic"}
    ),
    # contact that is sought
    "128 x 128 x 3, contact: automatic, friction": Case(
        lambda: stress(128, 128), {"friction": 0.6}, readings="contact", seconds=120
    ),
    "128 x 128 x 3, wide contact: automatic, friction": Case(
        lambda: stress(128, 128), {"friction": 0.6}, readings="wide", seconds=120
    ),
    "256 x 256 x 3, wide contact: automatic, friction": Case(
        lambda: stress(256, 256), {"friction": 0.6}, readings="wide", seconds=240
    ),
    "480 x 640 x 3, wide contact: automatic": Case(lambda: stress(480, 640), {}, readings="wide", seconds=240),
    "128 x 128 x 3, wide contact: constrained": Case(
        lambda: stress(128, 128), {"method": "constrained"}, readings="wide", seconds=120
    ),
    # draws, maps of error bars, streams, batches, files
    "32 x 32 x 3, contact: automatic, 100,000 draws": Case(
        lambda: stress(32, 32), {"draws": 100_000}, readings="contact"
    ),
    "128 x 128 x 3, contact: automatic, 10,000 draws": Case(
        lambda: stress(128, 128), {"draws": 10_000}, readings="contact"
    ),
    "128 x 128 x 3, contact: automatic, 100 draws": Case(lambda: stress(128, 128), {"draws": 100}, readings="contact"),
    "256 x 256 x 2: tikhonov, error bars of every cell": Case(
        lambda: scale.area(256, 256, channels=scale.SHIFT), LINEAR, readings="bumps", run="bars", seconds=300
    ),
    "128 x 128 x 3: tracker": Case(lambda: stress(128, 128), run="track"),
    "480 x 640 x 3: tracker": Case(lambda: stress(480, 640), run="track"),
    "20,000 beads x 3, stress: tracker": Case(lambda: beads(20_000, scale.STRESS, 2e-3), run="track"),
    "32 x 32 x 3: tikhonov, a batch of 100,000 frames": Case(lambda: stress(32, 32), LINEAR, run="batch"),
    "128 x 128 x 3: save_prepared, nothing prepared": Case(lambda: stress(128, 128), run="save"),
    "128 x 128 x 3: tikhonov, save_prepared": Case(lambda: stress(128, 128), LINEAR, run="saved"),
    "480 x 640 x 2, a layer: tikhonov, save_prepared": Case(
        lambda: scale.area(480, 640, channels=scale.SHIFT), LINEAR, LAYER, run="saved", seconds=300
    ),
}


def cases() -> dict[str, Case]:
    return {**each_method(), **OTHERS, **SERVED}


def made(skin: pp.Skin, kind: str) -> Any:
    """Readings of the kind, with 2 % noise."""
    rng = np.random.default_rng(0)
    plane = skin.planes[0]
    if kind == "noise":
        return 1e-6 * rng.standard_normal((len(plane.channels), *plane.shape))
    if kind == "bumps":
        traction = scale.pressed(skin)
    elif kind == "contact":
        traction = scale.touched(skin, plane.shape[0])
    else:
        y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
        half = [1e-3 * 0.45 * n for n in plane.shape]
        pressure = 1e3 * np.sqrt(np.maximum(1.0 - (y / half[0]) ** 2 - (x / half[1]) ** 2, 0.0))
        traction = np.stack([0.3 * pressure, 0.0 * pressure, pressure])
    readings = skin.sense(traction)
    return readings + 0.02 * np.abs(readings).max() * rng.standard_normal(readings.shape)


def asked(case: Case, skin: pp.Skin, readings: Any) -> None:
    """What the case asks for."""
    if case.run == "prepare":
        skin.prepare(**case.options)
    elif case.run == "track":
        skin.track().step(readings)
    elif case.run == "batch":
        skin.reconstruct(np.broadcast_to(readings, (100_000, *readings.shape)), **case.options)
    elif case.run in ("save", "saved"):
        if case.run == "saved":
            skin.prepare(**case.options)
        with tempfile.TemporaryDirectory() as folder:
            skin.save_prepared(Path(folder) / "skin.prepared")
    else:
        touch = skin.reconstruct(readings, **case.options)
        if case.run == "bars":
            _ = touch.std()


def peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def one(name: str) -> dict[str, Any]:
    """What becomes of a case, in this process."""
    case = cases()[name]
    resource.setrlimit(resource.RLIMIT_AS, (int(case.memory), resource.RLIM_INFINITY))
    spent = int(time.process_time()) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (spent + case.seconds, resource.RLIM_INFINITY))
    before, start = peak(), time.process_time()
    made_in = 0.0
    try:
        skin = pp.Skin(case.pad, case.array(), **case.skin)
        begun = time.process_time()
        readings = made(skin, case.readings)
        made_in = time.process_time() - begun
        asked(case, skin, readings)
        outcome, said = ("prepared" if case.run == "prepare" else "served"), ""
    except PalpateError as error:
        outcome, said = "refused", " ".join(str(error).split())
    except (Exception, MemoryError) as error:
        outcome, said = "defect", f"{type(error).__name__}: {' '.join(str(error).split())}"
    seconds = time.process_time() - start - made_in
    if outcome == "refused" and seconds > AT_ONCE:
        outcome = "refused late"
    return {"name": name, "outcome": outcome, "said": said, "seconds": seconds, "memory": peak() - before}


def table(rows: list[dict[str, Any]]) -> str:
    lines = ["| layout and method | | after [s] | memory [GB] | message |", "|---|---|---|---|---|"]
    for r in rows:
        said = r["said"] if len(r["said"]) <= WORDS else r["said"][:WORDS].rsplit(" ", 1)[0] + " ..."
        said = said.replace("|", "\\|").replace("*", "\\*")
        lines.append(f"| {r['name']} | {r['outcome']} | {r['seconds']:.2f} | {r['memory']:.2f} | {said} |")
    refused = [r for r in rows if r["outcome"] == "refused"]
    lines.append("")
    if refused:
        late, most = max(r["seconds"] for r in refused), max(r["memory"] for r in refused)
        lines.append(
            f"{len(refused)} of {len(rows)} cases are refused, at the latest after {late:.2f} s and with {most:.2f} GB at most; "
            f"{sum(r['outcome'] == 'served' for r in rows)} are solved and {sum(r['outcome'] == 'prepared' for r in rows)} prepared."
        )
    return "\n".join(lines) + "\n"


HEADING = (
    "# Refusals\n\nWritten by `benchmarks/refusals.py`: each case in a separate process with 12 GB of address space (8 GB for tikhonov on "
    "several bumps); processor seconds and memory since palpate is imported, one thread.\n\n"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT", help="cases whose name has one of these in it")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one(given.one)))
        return
    rows = []
    for name, case in cases().items():
        if given.only and not any(t in name for t in given.only):
            continue
        done = subprocess.run(
            [sys.executable, __file__, "--one", name],
            capture_output=True,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        if done.returncode:
            late = -done.returncode == signal.SIGXCPU
            last = "" if late else (done.stderr.strip().splitlines() or [f"ended by signal {-done.returncode}"])[-1]
            rows.append(
                {
                    "name": name,
                    "outcome": "not in time" if late else "defect",
                    "said": last,
                    "seconds": case.seconds,
                    "memory": float("nan"),
                }
            )
        else:
            rows.append(json.loads(done.stdout.splitlines()[-1]))
        r = rows[-1]
        print(f"{r['outcome']:<13}{r['seconds']:>8.2f} s {r['memory']:>7.2f} GB  {name}: {r['said']}", flush=True)
    print(table(rows))
    if given.write:
        TABLE.write_text(HEADING + table(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
