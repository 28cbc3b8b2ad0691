"""What each rule of the contact method buys: error, frames wrong without a warning, coverage and words, on frames that tuned nothing.

    python benchmarks/rules.py run found.jsonl --frames 4 --seconds 420     measure, for so long; begun again it goes on where it stopped
    python benchmarks/rules.py run found.jsonl --only "short line,loud"      some rules
    python benchmarks/rules.py run part0.jsonl --share 0/4                    every fourth frame, for runs side by side
    python benchmarks/rules.py table found.jsonl [--write]                   the table, into docs/_generated/rules.md

A rule is left out by other numbers of `palpate.inverse.contact.policy`. Frames are those of `palpate.bench.trust` of a seed of their own, judged as there, and every
frame is solved with all rules and without each. A rule that buys less than 1 % of the error and neither trust nor coverage is one to delete.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
import warnings
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bench.ablation import Ablated
from palpate.bench.trust import ROWS, make_frame
from palpate.bench.trust.judge import Verdict, verdict
from palpate.bench.trust.rows import Frame
from palpate.errors import PalpateError
from palpate.inverse.contact.policy import Policy, changed
from palpate.touch import Touch

#: A seed that no test, table or constant was made with.
SEED = 80_527_341
#: Frames of more readings are left out: every frame is solved some thirty times.
READINGS = 200
TABLE = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "rules.md"
#: Rules by name: what replaces their numbers.
RULES: Mapping[str, Mapping[str, Any]] = {
    "rival weighed where doubted": {"fit.doubted": 0.0},
    "short line may be all contact": {"detection.short_line": 0},
    "part of the residual in proportion": {"fit.shows": math.inf},
    "unexplained part of the signal": {"detection.unexplained_signal": 0.0},
    "rims where noise may be learned from them": {"rims.sought": 0.05},
    "drift of displacements hidden": {"errors.hidden_drift": 0.0},
    "reading alone among all": {"screening.alone": math.inf},
    "unknowns for each reading": {"grid.unknowns_per_reading": math.inf},
    "larger scales": {"prior.larger": (1.0,)},
    "load beyond the outermost taxels": {"errors.beyond": 0.0},
    "even press for offsets": {"errors.even_press": 0.0},
    "local weights explain the readings": {"parts.explains": False},
    "common shear": {"parts.common_shear": False},
    "finer cells of sliding contact": {"parts.finer_sliding": False},
    "uneven noise is no contact": {"parts.uneven_evidence": False},
    "second derivative": {"parts.second_derivative": False},
    "discs": {"discs.least": 2.0},
    "contact in a few cells": {"parts.few_cells": False},
    "pull about a contact": {"parts.rims": False},
    "cancelling rims": {"rims.cancel": math.inf},
    "sliding as a whole": {"parts.sliding": False},
    "sliding in turn with pressure": {"prior.jointly": 1},
    "trimming": {"parts.trim": False},
    "noise of each channel": {"parts.channel_noise": False},
    "noise learned again": {"parts.noise_again": False},
    "screening": {"parts.screening": False},
    "outliers": {"parts.outliers": False},
    "patches that noise explains": {"detection.patch": 0.0},
    "contact that leaves most": {"detection.most_left": 2.0},
    "doubt": {"explanations.doubt": 0.0},
    "loaded edge asks for offsets": {"explanations.edge": 2.0},
    "largest nuisance": {"explanations.largest_nuisance": math.inf},
    "push and pull at once": {"explanations.structured": 2.0},
    "push and pull by chance": {"explanations.structured_chance": 2.0},
    "pressure everywhere": {"explanations.everywhere": 2.0},
    "large arrays": {"explanations.many_taxels": 10**9},
    "alike rivals": {"explanations.least_weight": 0.0},
    "told drift": {"fit.told": 0.0},
    "prior of the discrepancy": {"fit.prior_weight": 0.0},
    "one discrepancy": {"fit.shares": (0.1,)},
    "faint discrepancy": {"fit.faint": 0.0},
    "gross": {"screening.gross": 0.0},
    "outermost broken": {"screening.outermost": 0.0},
    "load instead of broken": {"screening.nearly": 0.0},
    "neighbours are contact": {"screening.neighbours": 10**9},
    "dead": {"screening.dead": math.inf},
    "shallow taxels": {"screening.shallow": 0.0},
    "open end": {"screening.open_end": 0.0},
    "excess at an end": {"screening.excess": 0.0},
    "ends that a frame shows": {"screening.at_end": 10**9, "screening.at_end_rounded": 10**9},
    "rounding": {"noise.step": math.inf},
    "noise followed": {"noise.followed": 0.0},
    "offsets found again": {"noise.offset_rounds": 0},
    "turns of channels": {"noise.turns": 1},
    "turns of all": {"noise.turns_of_all": 1},
    "even penalty's share": {"prior.even": 0.0},
    "improbable models": {"prior.improbable": 0.0},
    "left more": {"prior.left_more": math.inf},
    "rounds of local weights": {"prior.rounds": 2},
    "margin": {"extent.margin": 0},
    "quieter cells": {"extent.noisy": 0.0},
    "goes on": {"extent.goes_on": 10.0},
    "at the edge": {"extent.at_edge": 10.0},
    "ambiguous force": {"errors.ambiguous_force": 0.0, "errors.ambiguous_coupled": 0.0},
    "ambiguous peak": {"errors.ambiguous_peak": 0.0},
    "ambiguous shear": {"errors.ambiguous_shear": 0.0},
    "likely cells": {"work.likely": 0.0},
    "cells of few readings": {"detection.few_readings": 0},
    "wide local weights": {"parts.wide_weights": False},
    "surface beyond the edge": {"parts.wide_surface": False},
    "contact that pulls": {"parts.pulls": False},
    "whole edge": {"explanations.whole_edge": 2.0},
    "first round of nuisances": {"explanations.first_change": 0.0},
    "offsets of groups": {"explanations.groups": 0},
    "price of a nuisance": {"explanations.per_nuisance": 0.0},
    "smallest nuisance": {"explanations.smallest_nuisance": 0.0},
    "hopeless signs": {"explanations.hopeless": 0.0},
    "bends": {"explanations.bends": 0.0},
    "contact proves": {"fit.proves": 0.0},
    "margin of discrepancies": {"fit.margin": 0.0},
    "channels at their end": {"screening.moved": math.inf},
    "residuals examined early": {"screening.examined": 1.0},
    "equal readings near zero": {"screening.near_zero": 0.0},
    "explained by a load": {"screening.explained": 0.0},
    "broken beyond log n": {"screening.broken": 0.0},
    "limit of friction in half of the models": {"prior.most_friction": math.inf},
    "ends at the edge": {"prior.ends": 0.0},
    "improbable slides": {"prior.slides": 0.0},
    "finest cells with shear": {"grid.fine_spacing": 1.75},
    "quiet cells": {"extent.quiet": 0.0},
    "load between shallow taxels": {"errors.felt": 0.0},
    "hidden offset": {"errors.hidden_lowest": 0.0},
    "hangs on one reading": {"errors.hangs": math.inf},
    "most ambiguous": {"errors.most_ambiguous": math.inf},
    "ambiguous cells": {"errors.ambiguous_cells": 1.0},
    "few cells beside heavy tails": {"detection.in_few_cells": 0.0},
    "stands out": {"detection.stands_out": 0.0},
    "most weight of discs": {"discs.most": 1.0},
    "drift after the zero": {"explanations.drift": 0.0},
}


def policy_without(rule: str) -> Policy:
    policy = Policy()
    for name, value in RULES[rule].items():
        policy = changed(policy, name, value)
    return policy


def judged(frame: Frame, policy: Policy, clean: Touch | None = None) -> tuple[Verdict, Touch] | None:
    """The verdict on a frame, and the touch of the clean frame of its sensor, which is ``clean`` where that is known; None where it is refused."""
    method = Ablated(friction=frame.friction, policy=policy)
    start = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if frame.recorded is not None:
                touch = frame.skin.reconstruct(frame.recorded.steps[-1], zero=frame.recorded.rest, method=method)
                seconds = time.process_time() - start
                clean = clean or frame.skin.reconstruct(
                    frame.recorded.clean[-1], zero=frame.recorded.rest, method=method
                )
            else:
                touch = frame.skin.reconstruct(frame.readings, method=method)
                seconds = time.process_time() - start
                clean = clean or frame.skin.reconstruct(frame.reference, method=method)
    except PalpateError:
        return None
    return verdict(frame, touch, clean, seconds), clean


def summary(v: Verdict) -> dict[str, Any]:
    whole = asdict(v)
    return {
        "error": whole["field_error"],
        "betrays": v.betrays,
        "silent": v.silent,
        "force": v.inside["force"],
        "peak": v.inside["peak"],
        "cells": v.inside["cells"],
        "found": list(v.found),
        "low": list(v.low),
        "high": list(v.high),
        "fit": v.fit,
        "words": list(v.words),
        "seconds": v.seconds,
    }


def run(file: Path, frames: int, seconds: float, only: list[str], share: str = "0/1", readings: int = READINGS) -> None:
    part, parts = map(int, share.split("/"))
    done = set()
    if file.exists():
        done = {(r["row"], r["index"], r["rule"]) for r in map(json.loads, file.read_text().splitlines())}
    started = time.monotonic()
    with file.open("a") as out:
        for index in range(frames):
            for place, row in enumerate(ROWS):
                if (index * len(ROWS) + place) % parts != part:
                    continue
                wanted = [r for r in ["whole", *only] if (row, index, r) not in done]
                if not wanted:
                    continue
                if time.monotonic() - started > seconds:
                    return
                frame = make_frame(row, index, seed=SEED)
                if frame.readings.size > readings:
                    continue
                clean: Touch | None = None
                for rule in wanted:
                    found = judged(frame, Policy() if rule == "whole" else policy_without(rule), clean)
                    clean = found[1] if found else clean
                    line = {"row": row, "index": index, "rule": rule, "verdict": found and summary(found[0])}
                    out.write(json.dumps(line) + "\n")
                out.flush()


def same(a: dict[str, Any], b: dict[str, Any]) -> bool:
    keys = ("error", "found", "low", "high", "fit", "words")
    return all(
        np.array_equal(a[k], b[k]) if k == "words" else np.allclose(a[k], b[k], rtol=1e-9, equal_nan=True) for k in keys
    )


def table(file: Path) -> str:
    records = [json.loads(line) for line in file.read_text().splitlines()]
    by = {(r["row"], r["index"], r["rule"]): r["verdict"] for r in records if r["verdict"]}
    lines = [
        "# The effect of each rule of the contact method",
        "",
        "Made by `python benchmarks/rules.py`: frames of every row of `palpate bench trust`, with a seed not used for tuning. Columns: frames whose result "
        "changes without the rule; error of the traction without the rule divided by that with it (geometric mean over all frames); frames wrong without a warning, "
        "and frames without a warning, each with the rule / without it; change of the coverage of 95 % intervals without the rule. Rules in the table that are not in "
        "the code were deleted because of it.",
        "",
        "| rule left out | frames | changed | error ratio | wrong without a warning | without a warning | coverage of force | of peak | of cells |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for rule in dict.fromkeys(r["rule"] for r in records if r["rule"] != "whole"):
        pairs = [(by[(r, i, "whole")], v) for (r, i, k), v in by.items() if k == rule and (r, i, "whole") in by]
        if not pairs:
            continue
        ratios = [math.log(b["error"] / a["error"]) for a, b in pairs if a["error"] > 0 and b["error"] > 0]

        def inside(name: str, pairs: list[Any] = pairs) -> str:
            known = [(a[name], b[name]) for a, b in pairs if np.isfinite(a[name]) and np.isfinite(b[name])]
            return f"{np.mean([b - a for a, b in known]):+.3f}" if known else "-"

        moved = sum(not same(a, b) for a, b in pairs)
        wrong = f"{sum(a['betrays'] for a, _ in pairs)} / {sum(b['betrays'] for _, b in pairs)}"
        silent = f"{sum(a['silent'] for a, _ in pairs)} / {sum(b['silent'] for _, b in pairs)}"
        lines.append(
            f"| {rule} | {len(pairs)} | {moved} | {math.exp(np.mean(ratios)):.4f} | {wrong} | {silent} | "
            f"{inside('force')} | {inside('peak')} | {inside('cells')} |"
        )
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["run", "table"])
    parser.add_argument("file", type=Path)
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=420.0)
    parser.add_argument(
        "--share", default="0/1", help="every so many-th frame, of several runs side by side: 0/4, 1/4 ..."
    )
    parser.add_argument("--readings", type=int, default=READINGS, help="frames of more are left out")
    parser.add_argument("--only", default=",".join(RULES))
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    if given.what == "run":
        run(
            given.file,
            given.frames,
            given.seconds,
            [r.strip() for r in given.only.split(",")],
            given.share,
            given.readings,
        )
        return 0
    text = table(given.file)
    print(text)
    if given.write:
        TABLE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
