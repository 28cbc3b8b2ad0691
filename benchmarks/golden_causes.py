"""The commits that changed the answers of `golden.py`, found by halving the history for each frame.

    python benchmarks/golden_causes.py before.npz after.npz --since 98c88178 --cache FOLDER --above 0.1    writes benchmarks/data/golden_causes.json
    python benchmarks/golden_causes.py before.npz after.npz --since 98c88178 --cache FOLDER --minutes 20   stops after so long; begun again, it goes on

Both files are records of `golden.py record`. The history is the line of commits of the main branch that changed code, not only words, of the rooms that make or
solve a frame. For each frame, the history is halved until one commit is left: before it, the answer is nearer to the old one, after it, to the new one. If a large
change is left on either side, that side is halved too. If the commit is a merge, its branch is halved in the same way. If the time ends before, the cause is a range
of commits; `--marks` gives commits to try first, which then end these ranges. The words of the causes are written by hand.
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from golden import CAUSES, INTERVALS, NUMBERS, PARTS, answer, answers_in, frames

ROOT = Path(__file__).resolve().parents[1]
#: Rooms whose code makes or solves a frame.
ROOMS = [f"src/palpate/{r}" for r in ("inverse", "sensing", "touch", "elastic", "uncertainty", "bench", "solutions")]
#: Another commit is sought if what is left of the change exceeds this part of it, at most so many for a frame.
LEFT, MOST = 0.2, 3
#: Distances of two answers that differ in their status, in the ends of an interval that are known, or in whether there is an answer.
STATUS, ENDS, SHAPE = 2.0, 3.0, 10.0

Answer = dict[str, Any]


def git(*words: str) -> str:
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True).stdout


def is_ancestor(one: str, other: str) -> bool:
    return subprocess.run(["git", "-C", str(ROOT), "merge-base", "--is-ancestor", one, other]).returncode == 0


class _Code(ast.NodeTransformer):
    """Code without its words."""

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return ast.Constant("") if isinstance(node.value, str) else node

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        words = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if words else self.generic_visit(node)


def _code(commit: str, file: str) -> str:
    shown = subprocess.run(["git", "-C", str(ROOT), "show", f"{commit}:{file}"], capture_output=True, text=True)
    return "" if shown.returncode else ast.dump(_Code().visit(ast.parse(shown.stdout)))


def changes_code(before: str, after: str) -> bool:
    """Whether two commits differ in the code of `ROOMS`."""
    files = git("diff", "--name-only", before, after, "--", *ROOMS).split()
    return any(not f.endswith(".py") or _code(before, f) != _code(after, f) for f in files)


def line(since: str, until: str) -> list[str]:
    """Commits from one to another, each a parent of the next: along the main branch where possible."""
    if since == until:
        return [since]
    after = git("rev-list", "--first-parent", "--reverse", f"{since}..{until}").split()
    after = [c for c in after if is_ancestor(since, c)]
    parents = git("log", "-1", "--format=%P", after[0]).split()
    return line(since, next(p for p in parents if is_ancestor(since, p))) + after


def steps(commits: Sequence[str]) -> list[str]:
    """The commits that changed code, after the first one."""
    out = [commits[0]]
    for commit in commits[1:]:
        if changes_code(out[-1], commit):
            out.append(commit)
    return out


def distance(one: Answer | None, other: Answer | None) -> float:
    """Largest difference of two answers: forces in parts of the load, tractions and peaks in parts of the largest."""
    if one is None or other is None or "broken" in one or "broken" in other:
        return math.nan
    if (set(one) & set(NUMBERS)) != (set(other) & set(NUMBERS)):
        return SHAPE
    out = 0.0
    for quantity in ("traction", "force", *(f"interval of {of}" for of in INTERVALS)):
        if quantity not in one:
            continue
        a, b = one[quantity], other[quantity]
        if a.shape != b.shape:
            return SHAPE
        known = np.isfinite(a) & np.isfinite(b)
        if not np.array_equal(np.isfinite(a), np.isfinite(b)):
            out = max(out, ENDS)
        size = (
            float(one["unit"])
            if quantity.endswith("force")
            else float(np.abs(np.stack([a, b])[:, known]).max(initial=0.0))
        )
        if size > 0:
            out = max(out, float(np.abs(a[known] - b[known]).max(initial=0.0)) / size)
    return max(out, STATUS) if "status" in one and one["status"] != other["status"] else out


def _child(file: str, names: set[str]) -> None:
    """Answers of these frames by the source on the path; a frame that this source cannot make is kept as broken."""
    out: dict[str, Any] = {}
    for name, make in frames(list(PARTS), 1):
        if name in names:
            try:
                out[name] = answer(make)
            except Exception as error:
                out[name] = {"broken": repr(error)}
    Path(file).write_bytes(pickle.dumps(out))


@dataclass
class Answers:
    """Answers of commits, kept in a folder."""

    folder: Path

    def of(self, commit: str, names: set[str]) -> dict[str, Answer | None]:
        file = self.folder / f"{commit}.pkl"
        kept: dict[str, Answer | None] = pickle.loads(file.read_bytes()) if file.exists() else {}
        missing = sorted(names - set(kept))
        if missing:
            source, found = self.folder / commit, self.folder / "found.pkl"
            source.mkdir(exist_ok=True)
            archive = subprocess.run(
                ["git", "-C", str(ROOT), "archive", commit, "src"], capture_output=True, check=True
            )
            subprocess.run(["tar", "x", "-C", str(source)], input=archive.stdout, check=True)
            ran = subprocess.run(
                [sys.executable, __file__, "--child", str(found), *missing],
                env={**os.environ, "PYTHONPATH": str(source / "src")},
                capture_output=True,
                text=True,
            )
            subprocess.run(["rm", "-r", str(source)], check=True)
            if ran.returncode:
                print(f"{commit[:8]} does not run: {ran.stderr.strip().splitlines()[-1]}")
            kept |= dict.fromkeys(missing) if ran.returncode else pickle.loads(found.read_bytes())
            file.write_bytes(pickle.dumps(kept))
        return kept


@dataclass
class Job:
    """The search for the largest change of one frame between two places of a line of commits, ``first`` and ``last``."""

    name: str
    first: int
    last: int
    old: Answer
    new: Answer

    def __post_init__(self) -> None:
        self.low, self.high, self.below, self.above = self.first, self.last, self.old, self.new

    @property
    def size(self) -> float:
        """Size of the change that was found."""
        return distance(self.below, self.above)

    def rest(self) -> list[Job]:
        """Searches on both sides of the change."""
        left = Job(self.name, self.first, self.low, self.old, self.below)
        right = Job(self.name, self.high, self.last, self.above, self.new)
        return [job for job in (left, right) if job.last > job.first and distance(job.old, job.new) > 0]


def halve(
    commits: Sequence[str], jobs: Sequence[Job], answers: Answers, until: float, marks: Sequence[int] = ()
) -> None:
    """Halve all jobs until each is left with one step; at ``marks`` first."""
    while time.time() < until:
        at: dict[int, list[Job]] = {}
        for job in jobs:
            if job.high - job.low > 1:
                inside = [m for m in marks if job.low < m < job.high]
                middle = inside[len(inside) // 2] if inside else (job.low + job.high) // 2
                at.setdefault(middle, []).append(job)
        if not at:
            return
        for middle, them in sorted(at.items()):
            if time.time() > until:
                return
            found = answers.of(commits[middle], {job.name for job in them})
            for job in them:
                now = found[job.name]
                to_old, to_new = distance(job.old, now), distance(now, job.new)
                if now is None or not math.isfinite(to_old + to_new):
                    job.low = middle  # not to be run here: taken together with the commits before it
                elif to_old <= to_new:
                    job.low, job.below = middle, now
                else:
                    job.high, job.above = middle, now
        print(f"{sum(j.high - j.low > 1 for j in jobs)} of {len(jobs)} searches are open", flush=True)


def all_steps(
    commits: Sequence[str], jobs: list[Job], answers: Answers, until: float, marks: Sequence[int] = ()
) -> dict[str, list[Job]]:
    """The changes of each frame, the largest first; without time, between two marks."""
    out: dict[str, list[Job]] = {}
    while jobs:
        halve(commits, jobs, answers, until, marks)
        later: list[Job] = []
        for job in jobs:
            found = out.setdefault(job.name, [])
            found.append(job)
            largest = max(j.size for j in found)
            if len(found) < MOST and job.high - job.low == 1:
                later += [j for j in job.rest() if distance(j.old, j.new) > LEFT * largest]
        jobs = later if time.time() < until else []
    return {name: sorted(found, key=lambda j: -j.size) for name, found in out.items()}


def inside_merges(
    commits: Sequence[str], found: dict[str, list[Job]], answers: Answers, until: float
) -> dict[str, str]:
    """The commit of the largest change of each frame; in a merge, that of its branch."""
    out: dict[str, str] = {}
    merges: dict[str, list[Job]] = {}
    for name, (job, *_) in found.items():
        commit = commits[job.high]
        out[name] = commit[:8]
        if job.high - job.low > 1:
            out[name] = f"{commits[job.low][:8]}..{commit[:8]}"
            continue
        if " " in git("log", "-1", "--format=%P", commit).strip():
            merges.setdefault(commit, []).append(job)
    for commit, jobs in merges.items():
        one, other = git("log", "-1", "--format=%P", commit).split()
        base = git("merge-base", one, other).strip()
        branch = steps(line(base, other)) if base != other else []
        if len(branch) < 2:
            continue
        inner = [Job(job.name, 0, len(branch) - 1, job.below, job.above) for job in jobs]
        halve(branch, inner, answers, until)
        for job in inner:
            if job.high - job.low == 1:
                out[job.name] = branch[job.high][:8]
    return out


def main() -> int:
    if sys.argv[1:2] == ["--child"]:
        _child(sys.argv[2], set(sys.argv[3:]))
        return 0
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--since", required=True, help="commit of the first record")
    parser.add_argument("--until", default="HEAD", help="commit of the second record")
    parser.add_argument("--cache", type=Path, required=True, help="folder for answers of commits between")
    parser.add_argument("--above", type=float, default=0.0, help="smallest change to search, in parts of the load")
    parser.add_argument("--marks", default="", help="commits to try first, with commas")
    parser.add_argument("--minutes", type=float, default=math.inf)
    given = parser.parse_args()
    given.cache.mkdir(exist_ok=True)
    until = time.time() + 60 * given.minutes
    file = given.cache / "line.json"
    if not file.exists():
        ends = (git("rev-parse", given.since).strip(), git("rev-parse", given.until).strip())
        file.write_text(json.dumps(steps(line(*ends))))
    commits = json.loads(file.read_text())
    print(f"{len(commits)} commits changed code")
    before, after = answers_in(given.before), answers_in(given.after)
    names = [n for n in before if n in after and distance(before[n], after[n]) > given.above]
    jobs = [Job(n, 0, len(commits) - 1, before[n], after[n]) for n in names]
    tried = [m for m in given.marks.split(",") if m]
    marks = [i for i, c in enumerate(commits) if any(c.startswith(m) for m in tried)]
    answers = Answers(given.cache)
    found = all_steps(commits, jobs, answers, until, marks)
    causes = inside_merges(commits, found, answers, until)
    words = json.loads(CAUSES.read_text(encoding="utf-8"))["causes"] if CAUSES.exists() else {}
    for commit in set(causes.values()):
        words.setdefault(commit, git("log", "-1", "--format=%s", commit.partition("..")[2] or commit).strip())
    kept = {"causes": dict(sorted(words.items())), "frames": dict(sorted(causes.items()))}
    kept["others"] = {n: [commits[j.high][:8] for j in js[1:]] for n, js in sorted(found.items()) if js[1:]}
    CAUSES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(f"causes of {len(causes)} frames")
    return 0


if __name__ == "__main__":
    sys.exit(main())
