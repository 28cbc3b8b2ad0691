"""Notes that nobody needs, and errors that no note tells: frames of `palpate.bench.trust`, clean and spoiled, of a seed of their own.

    python benchmarks/needless.py run clean.jsonl --frames 200                 every frame of the row "clean"
    python benchmarks/needless.py run spoiled.jsonl --frames 200 --spoiled     all other rows in turn
    python benchmarks/needless.py table clean.jsonl spoiled.jsonl [--before clean0.jsonl spoiled0.jsonl] [--write]

A note is **needless** on a clean frame whose force is right: off by less than 30 % of the load, the truth not far outside its 95 % interval, and the interval no
wider to either side than 30 % of the load (a wider one is a note's reason). An error is **missed** on a spoiled frame where the force is off by more than 30 %, or
the truth far outside, and nothing is said: no note, a status of success, a fit above 0.01, an interval that is narrower than the load. What is said of clean frames
too counts as said: a user has no clean frame beside theirs. A run that was stopped goes on where it ended.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.bench.trust import ROWS, make_frame
from palpate.bench.trust.judge import MISFIT, _answered, verdict
from palpate.bench.trust.rows import Frame
from palpate.errors import PalpateError, Unsupported
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.counted import numberless

#: A seed that no test, table or constant was made with.
SEED = 61_085_040
TABLE = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "needless.md"


def _touch(frame: Frame) -> tuple[Touch, tuple[str, ...]]:
    """The answer as a user has it, and what the reader of a table warns of."""
    options: dict[str, Any] = {} if frame.friction is None else {"friction": frame.friction}
    for given in (options, {}):
        try:
            if frame.recorded is not None:
                return _answered(frame, frame.recorded, given)
            return frame.skin.reconstruct(frame.readings, **given), ()
        except Unsupported:
            if not given:
                raise
    raise AssertionError


def measured(row: str, index: int) -> dict[str, Any]:
    """One frame: its notes, and whether its force is right, narrow and told of."""
    frame = make_frame(row, index, seed=SEED)
    try:
        touch, said = _touch(frame)
    except PalpateError as error:
        return {"row": row, "index": index, "refused": str(error)}
    found = verdict(frame, touch, touch, 0.0)
    half = 0.0
    for value, low, high in zip(found.found, found.low, found.high):
        half = max(half, *(abs(side - value) for side in (low, high) if np.isfinite(side)), 0.0)
    load = float(np.linalg.norm(to_numpy(touch.force)))
    status = Status.SOLVED if touch.status is None else Status.coded(int(np.asarray(touch.status)))
    return {
        "row": row,
        "index": index,
        "notes": [*touch.notes, *said],
        "right": not found.wrong and not found.far,
        "wide": half > 0.3 * load,
        "betrays": found.wrong or found.far,
        "error": found.force_error,
        "told": status not in (Status.SOLVED, Status.NO_CONTACT)
        or found.fit < MISFIT
        or "interval wider than the load" in found.words,
        "sensor": found.sensor,
    }


def run(path: Path, frames: int, *, spoiled: bool) -> None:
    """Frames 0 to ``frames`` - 1 of the clean row, or of the others in turn, into a file of one line each."""
    rows = [r for r in ROWS if r != "clean"] if spoiled else ["clean"]
    done = len(path.read_text(encoding="utf-8").splitlines()) if path.exists() else 0
    with path.open("a", encoding="utf-8") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for n in range(done, frames):
            file.write(json.dumps(measured(rows[n % len(rows)], n // len(rows))) + "\n")
            file.flush()


def read(path: Path) -> list[dict[str, Any]]:
    """The frames of a run that were answered."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [one for one in lines if "refused" not in one]


def needless(frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Clean frames that are right and narrow, and carry a note."""
    return [f for f in frames if f["right"] and not f["wide"] and f["notes"]]


def missed(frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Spoiled frames that are wrong, and say nothing."""
    return [f for f in frames if f["betrays"] and not f["told"] and not f["notes"]]


def table(clean: Path, spoiled: Path, before: list[Path] | None) -> str:
    """The page."""
    columns = [(read(before[0]), read(before[1]))] if before else []
    columns.append((read(clean), read(spoiled)))
    heads = ["before", "now"][-len(columns) :]
    rows = [
        ("clean frames answered", [len(c) for c, _ in columns]),
        ("of these with a note, the interval wide or narrow", [sum(bool(f["notes"]) for f in c) for c, _ in columns]),
        ("notes a clean frame", [f"{sum(len(f['notes']) for f in c) / len(c):.2f}" for c, _ in columns]),
        ("with a needless note", [f"{len(needless(c))} ({len(needless(c)) / len(c):.0%})" for c, _ in columns]),
        ("spoiled frames answered", [len(s) for _, s in columns]),
        ("of these wrong or far outside", [sum(f["betrays"] for f in s) for _, s in columns]),
        ("of these missed", [len(missed(s)) for _, s in columns]),
    ]
    lines = [
        "# Needless and missed notes",
        "",
        "Made by `python benchmarks/needless.py table CLEAN SPOILED --write`.",
        "",
        f"| | {' | '.join(heads)} |",
    ]
    lines += ["|---|" + "---|" * len(heads)]
    lines += [f"|{name} | {' | '.join(map(str, values))} |" for name, values in rows]
    lines += ["", "Notes of clean frames:", "", "|note | frames | needless |", "|---|---|---|"]
    now = columns[-1][0]
    short = lambda note: numberless(note)[:110]  # noqa: E731
    bad = Counter(short(n) for f in needless(now) for n in f["notes"])
    lines += [f"|{n} | {c} | {bad[n]} |" for n, c in Counter(short(n) for f in now for n in f["notes"]).most_common()]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    tasks = parser.add_subparsers(dest="task", required=True)
    one = tasks.add_parser("run")
    one.add_argument("path", type=Path)
    one.add_argument("--frames", type=int, default=200)
    one.add_argument("--spoiled", action="store_true")
    two = tasks.add_parser("table")
    two.add_argument("paths", type=Path, nargs=2)
    two.add_argument("--before", type=Path, nargs=2)
    two.add_argument("--write", action="store_true")
    given = parser.parse_args()
    if given.task == "run":
        run(given.path, given.frames, spoiled=given.spoiled)
        return
    page = table(*given.paths, given.before)
    if given.write:
        TABLE.write_text(page, encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
