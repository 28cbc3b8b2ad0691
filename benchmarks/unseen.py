"""Two versions of the code on the same contacts of `palpate.bench.unseen`, which tuned neither.

    python benchmarks/unseen.py --against SRC --frames 600 --seed 880011 --jobs 2

SRC is the folder that holds the other "palpate". Ratios are those of each frame's error, this code's over the other's: geometric mean with its
standard error, for all contacts and each kind. Then for both codes: the mean error of traction, of the normal force over its true value, the share of
true forces inside the 95 % interval, the median width of that interval over the force, frames without an answer, contacts missed, false alarms and
processor time. --set changes numbers of this code's policy ("discs.most=0.9").
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.bench.ablation import Ablated
from palpate.bench.accuracy import spread_over
from palpate.bench.unseen import CONTACT_KINDS, unseen
from palpate.inverse.contact.policy import Policy, changed
from palpate.touch import Touch


def solved(task: tuple[int, int, list[str]]) -> dict[str, Any]:
    """One frame: its truth, and what the automatic method says of it."""
    seed, index, settings = task
    sample = unseen(np.random.default_rng((seed, index)), CONTACT_KINDS[index % len(CONTACT_KINDS)])
    skin, names = sample.layout.skin, list(sample.layout.components)
    policy = Policy()
    for entry in settings:
        name, _, value = entry.partition("=")
        number = json.loads(value)
        policy = changed(policy, name, tuple(number) if isinstance(number, list) else number)
    method = Ablated(friction=sample.friction, policy=policy)
    method.prepare(skin.problem(components=names))
    started = time.process_time()
    touch = skin.reconstruct(sample.readings, method=method, components=names)
    seconds = time.process_time() - started
    columns = [skin.surface.components.index(c) for c in names]
    true = float(np.asarray(Touch(sample.truth, skin.surface, touch.components, "truth").force)[-1])
    size = float(np.linalg.norm(sample.truth[columns]))
    error = float(np.linalg.norm((np.asarray(touch.values) - sample.truth)[columns]))
    answered = math.isfinite(error)
    low, high = (float(np.asarray(v)[..., -1]) for v in touch.interval(0.95, of="force")) if answered else (0.0, 0.0)
    return {
        "kind": "nothing" if sample.empty else sample.kind,
        "answered": answered,
        "error": error / size if answered and size > 0.0 else None,
        "force": abs(float(np.asarray(touch.force)[-1]) - true) / abs(true) if answered and true else None,
        "inside": low <= true <= high,
        "width": (high - low) / abs(true) if true else None,
        "touching": answered and bool(np.asarray(touch.values).any()),
        "seconds": seconds,
    }


def told(frames: list[dict[str, Any]]) -> str:
    """What one code does on all frames."""
    contacts = [f for f in frames if f["kind"] != "nothing"]
    good = [f for f in contacts if f["answered"]]
    return (
        f"error {np.mean([f['error'] for f in good]):.3f}, of the force {np.mean([f['force'] for f in good]):.3f}, "
        f"inside 95 % {np.mean([f['inside'] for f in good]):.3f}, width {np.median([f['width'] for f in good]):.3f}, "
        f"no answer {sum(not f['answered'] for f in frames)}, missed {sum(f['answered'] and not f['touching'] for f in contacts)}, "
        f"false alarms {sum(f['touching'] for f in frames if f['kind'] == 'nothing')}, {sum(f['seconds'] for f in frames):.0f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="SRC", help="the other copy of the library (default: this one)")
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--seed", type=int, default=880011)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="SECTION.NUMBER=VALUE", help="numbers of this code's policy"
    )
    parser.add_argument("--raw", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    tasks = [(given.seed, i, given.set) for i in range(given.frames)]
    now = list(spread_over(solved, tasks, given.jobs))
    if given.raw:
        print(json.dumps(now))
        return
    source = given.against or str(Path(pp.__file__).parents[1])
    command = [sys.executable, __file__, "--raw", *(f"--{n}={getattr(given, n)}" for n in ("frames", "seed", "jobs"))]
    other = subprocess.run(command, env={**os.environ, "PYTHONPATH": source}, stdout=subprocess.PIPE, check=True)
    before = json.loads(other.stdout)
    both = [(a, b) for a, b in zip(before, now) if a["kind"] != "nothing" and a["answered"] and b["answered"]]
    for kind in ("all", *CONTACT_KINDS):
        logs = np.log([b["error"] / a["error"] for a, b in both if kind in ("all", a["kind"])])
        if len(logs) < 2:
            continue
        ratio = math.exp(logs.mean())
        print(
            f"{kind}: {len(logs)} contacts, error {ratio:.3f} +- {ratio * logs.std(ddof=1) / math.sqrt(len(logs)):.3f} times the other's "
            f"({math.exp(logs.min()):.2f} to {math.exp(logs.max()):.2f}), {100 * np.mean(np.abs(logs) > 1e-9):.0f} % changed"
        )
    print("other:", told(before))
    print("this: ", told(now))


if __name__ == "__main__":
    main()
