"""Judge all rows, and count the results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.bench.accuracy import spread_over
from palpate.bench.trust.judge import Verdict, judge
from palpate.bench.trust.rows import ROWS, make_frame

__all__ = ["HEADER", "Line", "by_sensor", "cases", "cells", "lines", "markdown", "sentence", "trust"]


def trust(
    frames: int = 200,
    *,
    rows: Sequence[str] = tuple(ROWS),
    seed: int = 0,
    first: int = 0,
    limit: float | None = None,
    jobs: int = 1,
) -> Iterable[Verdict]:
    """Judge ``frames`` frames of each row, from number ``first`` on.

    A frame that takes more than ``limit`` seconds of processor time counts as without a result.
    """
    tasks = [(row, i, seed, limit) for row in rows for i in range(first, first + frames)]
    yield from spread_over(_judged, tasks, jobs)


def _judged(task: tuple[str, int, int, float | None]) -> Verdict:
    row, index, seed, limit = task
    return judge(make_frame(row, index, seed=seed), limit=limit)


@dataclass(frozen=True)
class Line:
    """One row of the table.

    Attributes
    ----------
    row : str
    frames : int
    wrong, wrong_silent : int
        Number of frames whose net force is wrong by more than 30 % of the load, and of those among them without a note.
    far, far_silent, peak_far, peak_far_silent : int
        Number of frames whose true net force, or peak pressure, lies far outside its 95 % interval, and of those among
        them without a note.
    betrays : int
        Frames that are wrong without a note, by the force's error or its interval.
    warned : int
        Frames that are as wrong and have a note.
    words, though_right : int
        Number of frames with a note, and of those among them whose force is neither wrong nor far outside.
    coverage : dict
        Part of the true values inside the 95 % interval, each frame counting once; NaN if no frame has an interval.
    without : int
        Frames answered without an interval of the force.
    refused, late, broken : int
        Frames without an answer: refused with a reason, not done in time, or failed.
    field_error : float
        Median error of the traction over its norm.
    half, most : float
        Processor seconds a frame, median and 99th percentile; frames not done in time count with the time that they had.
    """

    row: str
    frames: int
    wrong: int
    wrong_silent: int
    far: int
    far_silent: int
    peak_far: int
    peak_far_silent: int
    betrays: int
    warned: int
    words: int
    though_right: int
    coverage: dict[str, float]
    without: int
    refused: int
    late: int
    broken: int
    field_error: float
    half: float
    most: float


def _mean(values: Iterable[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.mean(known)) if known else float("nan")


def _percentile(values: Iterable[float], part: float) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.percentile(known, part)) if known else float("nan")


def lines(found: Sequence[Verdict]) -> list[Line]:
    """Return the counts of each row."""
    out = []
    for row in dict.fromkeys(v.row for v in found):
        some = [v for v in found if v.row == row]
        answered = [v for v in some if v.answered]
        out.append(
            Line(
                row=row,
                frames=len(some),
                wrong=sum(v.wrong for v in some),
                wrong_silent=sum(v.wrong and v.silent for v in some),
                far=sum(v.far for v in some),
                far_silent=sum(v.far and v.silent for v in some),
                peak_far=sum(v.peak_far for v in some),
                peak_far_silent=sum(v.peak_far and v.silent for v in some),
                betrays=sum(v.betrays for v in some),
                warned=sum((v.wrong or v.far) and not v.silent for v in some),
                words=sum(not v.silent for v in some),
                though_right=sum(not v.silent and not v.wrong and not v.far for v in answered),
                coverage={q: _mean(v.inside[q] for v in some) for q in ("force", "peak", "cells")},
                without=sum(not np.isfinite(v.inside["force"]) for v in answered),
                refused=sum(not v.answered and not v.broken and not v.late for v in some),
                late=sum(v.late for v in some),
                broken=sum(v.broken for v in some),
                field_error=_percentile((v.field_error for v in some), 50),
                half=_percentile((v.seconds for v in some), 50),
                most=_percentile((v.seconds for v in some), 99),
            )
        )
    return out


#: Column titles of `cells`.
HEADER = (
    "row",
    "frames",
    "wrong by > 30 % / without a warning",
    "force far outside 95 % / without a warning",
    "peak far outside / without a warning",
    "wrong without a warning",
    "coverage at 95 %: force, peak, cells",
    "with a warning / of these right",
    "traction error",
    "time p50, p99 [s]",
)


def cells(line: Line) -> tuple[str, ...]:
    """Return the entries of a line."""

    def share(value: float) -> str:
        return "-" if np.isnan(value) else f"{value:.2f}"

    unanswered = ((line.refused, "refused"), (line.late, "not in time"), (line.broken, "broken"))
    remarks = [f"{n} {what}" for n, what in unanswered if n]
    covered = ", ".join(share(line.coverage[q]) for q in ("force", "peak", "cells"))
    return (
        line.row,
        str(line.frames) + (f" ({', '.join(remarks)})" if remarks else ""),
        f"{line.wrong} / {line.wrong_silent}",
        f"{line.far} / {line.far_silent}",
        f"{line.peak_far} / {line.peak_far_silent}",
        f"{100 * line.betrays / line.frames:.1f} %",
        covered + (f" ({line.without} without)" if line.without else ""),
        f"{line.words} / {line.though_right}",
        share(line.field_error),
        f"{line.half:.2f}, {line.most:.2f}",
    )


def by_sensor(found: Sequence[Verdict]) -> list[tuple[str, int, int]]:
    """Return (kind and channels, number of frames wrong without a note, number of frames), the worst first."""
    kinds = dict.fromkeys(v.sensor for v in found)
    counts = [
        (kind, sum(v.betrays for v in found if v.sensor == kind), sum(v.sensor == kind for v in found))
        for kind in kinds
    ]
    return sorted(counts, key=lambda c: -c[1] / c[2])


def sentence(v: Verdict) -> str:
    """Return a sentence on a frame and its verdict."""
    if not v.answered:
        return f"{v.frame}: {v.status}"
    names = ("x", "z") if len(v.true) == 2 else ("x", "y", "z")
    force = ", ".join(
        f"{c} {f:.3g} ({a:.3g} to {b:.3g}), true {t:.3g}"
        for c, f, a, b, t in zip(names, v.found, v.low, v.high, v.true)
    )
    off = f"off by {100 * v.force_error:.0f} % of the load"
    where = " and far outside its interval" if v.far else ""
    said = "; ".join(v.words) or "not a word"
    return f"{v.frame}: {v.status}, force {off}{where}: {force}; says: {said}"


def markdown(found: Sequence[Line], *, command: str) -> str:
    """Return the table as a page."""
    text = [f"Made by `{command}`.", ""]
    text += ["| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
    text += ["| " + " | ".join(cells(line)) + " |" for line in found]
    text += ["", "| row | what is wrong |", "|---|---|"]
    text += [f"| {line.row} | {ROWS[line.row].says} |" for line in found]
    return "\n".join(text) + "\n"


def cases(found: Sequence[Verdict]) -> tuple[tuple[str, ...], list[tuple[str | float, ...]]]:
    """Return every frame for a table: titles and rows."""
    titles = (
        "row",
        "index",
        "sensor",
        "wrong without a warning",
        "force error",
        "traction error",
        "far",
        "peak far",
        "force inside",
        "peak inside",
        "cells inside",
        "status",
        "fit",
        "seconds",
        "found",
        "low",
        "high",
        "true",
        "words",
        "frame",
    )

    def numbers(values: Iterable[float]) -> str:
        return " ".join(f"{v:.4g}" for v in values)

    table: list[tuple[str | float, ...]] = [
        (
            v.row,
            v.index,
            v.sensor,
            int(v.betrays),
            round(v.force_error, 4),
            round(v.field_error, 4),
            int(v.far),
            int(v.peak_far),
            *(round(v.inside[q], 3) for q in ("force", "peak", "cells")),
            v.status,
            v.fit,
            round(v.seconds, 4),
            numbers(v.found),
            numbers(v.low),
            numbers(v.high),
            numbers(v.true),
            "; ".join(v.words),
            v.frame,
        )
        for v in found
    ]
    return titles, table
