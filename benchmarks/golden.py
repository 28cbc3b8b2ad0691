"""Answers of the contact methods on fixed frames, to hold a change of the code against the code before it.

    python benchmarks/golden.py record before.npz              every frame, into a file outside the tree
    python benchmarks/golden.py compare before.npz after.npz   two such files
    python benchmarks/golden.py compare before.npz             the same frames by the code as it is now; exit status 1 where one differs by more than 1e-9
    python benchmarks/golden.py compare before.npz --every 8   every eighth frame of each part, for a quick look
    python benchmarks/golden.py compare before.npz --part few  one part
    python benchmarks/golden.py compare before.npz --unreached reached.txt   also the lines of inverse/contact that no frame reached; a file that is there adds its own

Frames come from seeds that nothing else uses: every row of `palpate.bench.trust` (recordings by their zero, without a tracker), the kinds of
`palpate.bench.unseen`, arrays of 3 x 3 to 64 x 64 taxels, and few readings with a zero. Each answer is traction, force, their intervals, that of the peak,
fit, status and notes. A difference is the largest one over the largest value of the quantity in that frame. It prints no times: other work on the machine
would be in them.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import palpate as pp
from palpate.bench.trust import ROWS, make_frame
from palpate.bench.unseen import CONTACT_KINDS, unseen
from palpate.errors import PalpateError
from palpate.touch import Touch

#: A seed that no test, table or constant of the project was made with, and the frames of each row and kind.
SEED, OF_A_ROW, OF_A_KIND = 39_411_873, 6, 24
#: Largest relative difference of two answers that count as the same.
SAME = 1e-9
#: Sides of square arrays, with the number of frames of each.
SIDES = {3: 5, 4: 5, 5: 4, 6: 4, 8: 4, 10: 4, 12: 3, 16: 3, 24: 2, 32: 2, 48: 1, 64: 1}
#: Quantities whose 95 % intervals are kept.
INTERVALS = ("force", "peak_pressure", "traction")

Solve = Callable[[], Touch]


def trust_frames() -> Iterator[tuple[str, Solve]]:
    """Frames of every row of the table of trust."""
    for row in ROWS:
        for i in range(OF_A_ROW):
            yield f"trust {row} {i}", lambda row=row, i=i: _of_trust(row, i)


def _of_trust(row: str, index: int) -> Touch:
    frame = make_frame(row, index, seed=SEED)
    options = {} if frame.friction is None else {"friction": frame.friction}
    if frame.recorded is None:
        return frame.skin.reconstruct(frame.readings, **options)
    return frame.skin.reconstruct(frame.recorded.steps[-1], zero=frame.recorded.rest, **options)


def unseen_frames() -> Iterator[tuple[str, Solve]]:
    """Frames of the population that tuned nothing; every fourth by the method of one penalty, every fifth with draws."""
    for k, kind in enumerate(CONTACT_KINDS):
        for i in range(OF_A_KIND):
            yield f"unseen {kind} {i}", lambda k=k, i=i, kind=kind: _of_unseen(k, i, kind)


def _of_unseen(number: int, index: int, kind: str) -> Touch:
    sample = unseen(np.random.default_rng((SEED, number, index)), kind)
    options: dict[str, Any] = {} if sample.friction is None else {"friction": sample.friction}
    if index % 4 == 3:
        options["method"] = "constrained"
    elif index % 5 == 4:
        options["draws"] = 3
    return sample.layout.skin.reconstruct(sample.readings, components=list(sample.layout.components), **options)


def size_frames() -> Iterator[tuple[str, Solve]]:
    """Balls and punches on square arrays; in turn plain, with offsets, with friction, with noise that is given, of displacements."""
    for side, count in SIDES.items():
        for i in range(count):
            yield f"size {side} {i}", lambda side=side, i=i: _of_size(side, i)


def _of_size(side: int, index: int) -> Touch:
    rng = np.random.default_rng((SEED, side, index))
    pad: Any = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    channels, kinds = ["stress_xz", "stress_yz", "stress_zz"], "stress"
    if index % 5 == 4 or (side >= 24 and index == 1):
        pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
        channels, kinds = ["displacement_x", "displacement_y"], "displacement"
    array = pp.AreaArray(shape=(side, side), pitch=1e-3, depth=float(rng.uniform(0.5, 1.2)) * 1e-3, channels=channels)
    half = 0.5e-3 * side
    radius = float(rng.uniform(0.25, 0.6)) * half
    center = tuple(float(v) for v in rng.uniform(-0.25, 0.25, 2) * half)
    ball = pp.solutions.hertz_point(contact_radius=radius, force=2.0).shifted(*center)
    if index % 2:
        ball = ball.sliding(0.3, direction=0.4)
    clean = np.asarray(pp.Skin(pad, array).sense(ball))
    top = float(np.abs(clean).max())
    level = float(np.exp(rng.uniform(math.log(1e-3), math.log(5e-2))))
    readings = clean + level * top * rng.standard_normal(clean.shape)
    if index % 4 == 2:
        readings = readings + 0.2 * top * rng.uniform(-1, 1, (len(channels), 1, 1))
    if index % 3 == 1:
        array = pp.AreaArray(
            shape=(side, side), pitch=1e-3, depth=array.depth, channels=channels, noise=[level * top] * len(channels)
        )
    friction = 0.5 if index % 2 and kinds == "stress" else None
    return pp.Skin(pad, array).reconstruct(readings, **({} if friction is None else {"friction": friction}))


def few_frames() -> Iterator[tuple[str, Solve]]:
    """Four to forty readings with frames at rest: pressed, not pressed, uneven gains, one reading at its end."""
    for i in range(32):
        yield f"few {i}", lambda i=i: _of_few(i)


def _of_few(index: int) -> Touch:
    rng = np.random.default_rng((SEED, 7, index))
    pad = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    channels = [["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"], ["strain_zz"]][index % 3]
    shape = [(2, 2), (1, 4), (2, 3), (3, 3), (3, 4)][index % 5]
    limits = None
    array = pp.AreaArray(shape=shape, pitch=2e-3, depth=1e-3, channels=channels)
    ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=float(rng.uniform(0.2, 3.0)))
    ball = ball.shifted(float(rng.uniform(-1, 1)) * 1e-3, 0.0)
    clean = np.asarray(pp.Skin(pad, array).sense(ball))
    top = float(np.abs(clean).max())
    std = float(np.exp(rng.uniform(math.log(3e-4), math.log(3e-2)))) * top
    offset = top * rng.uniform(-1, 1, clean.shape)
    pressed = clean * (index % 4 != 3) * (1.0 + 0.1 * (index % 2) * rng.standard_normal(clean.shape))
    rest = offset + std * rng.standard_normal((20, *clean.shape))
    frame = offset + pressed + std * rng.standard_normal(clean.shape)
    if index % 7 == 6:
        high = float(frame.max()) - 0.1 * top
        limits = [(float(frame.min()) - top, high)] * len(channels)
        frame = np.minimum(frame, high)
        array = pp.AreaArray(shape=shape, pitch=2e-3, depth=1e-3, channels=channels, limits=limits)
    return pp.Skin(pad, array).reconstruct(frame, zero=rest)


PARTS: dict[str, Callable[[], Iterator[tuple[str, Solve]]]] = {
    "trust": trust_frames,
    "unseen": unseen_frames,
    "size": size_frames,
    "few": few_frames,
}


def answer(solve: Solve) -> dict[str, npt.NDArray[Any]]:
    """What is kept of one answer; a refusal is kept by its words."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            touch = solve()
    except PalpateError as error:
        return {"refused": np.array(f"{type(error).__name__}: {error}")}
    out = {"traction": np.asarray(touch.values), "force": np.asarray(touch.force)}
    for of in INTERVALS:
        with contextlib.suppress(PalpateError):
            out[f"interval of {of}"] = np.stack([np.asarray(v) for v in touch.interval(0.95, of=of)])
    out["fit"] = np.asarray(math.nan if touch.fit is None else touch.fit)
    out["status"] = np.asarray(touch.status)
    out["notes"] = np.array("\n".join(touch.notes))
    if touch.draws is not None:
        out["draws"] = np.asarray(touch.draws)
    return {k: np.asarray(v) for k, v in out.items()}


def difference(one: npt.NDArray[Any], other: npt.NDArray[Any]) -> float:
    """The largest difference over the largest value; infinite where shapes, words or gaps differ."""
    if one.shape != other.shape:
        return math.inf
    if one.dtype.kind not in "fc":
        return 0.0 if np.array_equal(one, other) else math.inf
    known = np.isfinite(one)
    if not np.array_equal(known, np.isfinite(other)) or not np.array_equal(one[~known], other[~known], equal_nan=True):
        return math.inf
    size = float(np.abs(one[known]).max(initial=0.0))
    off = float(np.abs(one[known] - other[known]).max(initial=0.0))
    return off / size if size > 0 else (0.0 if off == 0 else math.inf)


CONTACT = Path(pp.__file__).parent / "inverse" / "contact"


class Reached:
    """Lines of inverse/contact that were run."""

    def __init__(self) -> None:
        self.lines: set[tuple[str, int]] = set()
        self._names: dict[str, str | None] = {}
        sys.settrace(self._call)

    def _call(self, frame: Any, event: str, value: Any) -> Any:
        file = frame.f_code.co_filename
        if file not in self._names:
            inside = file.startswith(str(CONTACT))
            self._names[file] = str(Path(file).relative_to(CONTACT)) if inside else None
        return None if self._names[file] is None else self._line

    def _line(self, frame: Any, event: str, value: Any) -> Any:
        self.lines.add((self._names[frame.f_code.co_filename] or "", frame.f_lineno))
        return self._line

    def report(self, file: Path) -> None:
        """Add to the file what was reached, and print the lines that were not, by file."""
        if file.exists():
            self.lines |= {(a, int(b)) for a, b in (line.rsplit(":", 1) for line in file.read_text().splitlines())}
        file.write_text("".join(f"{a}:{b}\n" for a, b in sorted(self.lines)))
        for path in sorted(CONTACT.rglob("*.py")):
            name = str(path.relative_to(CONTACT))
            body = [
                n for f in ast.walk(ast.parse(path.read_text())) if isinstance(f, ast.FunctionDef) for n in ast.walk(f)
            ]
            starts = {n.lineno for n in body if isinstance(n, ast.stmt) and not isinstance(n, ast.FunctionDef)}
            docs = {n.lineno for n in body if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)}
            missing = sorted(starts - docs - {b for a, b in self.lines if a == name})
            if missing:
                print(f"  {name}: {', '.join(map(str, missing))}")


def frames(parts: list[str], every: int) -> Iterator[tuple[str, Solve]]:
    for part in parts:
        yield from list(PARTS[part]())[::every]


def answers_in(file: Path) -> dict[str, dict[str, npt.NDArray[Any]]]:
    """Answers that were recorded, by frame."""
    out: dict[str, dict[str, npt.NDArray[Any]]] = {}
    with np.load(file) as kept:
        for key in kept.files:
            name, quantity = key.rsplit("/", 1)
            out.setdefault(name, {})[quantity] = kept[key]
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("file", type=Path)
    parser.add_argument(
        "after", type=Path, nargs="?", help="answers to compare with (default: by the code as it is now)"
    )
    parser.add_argument("--every", type=int, default=1, help="only every so many frames of each part")
    parser.add_argument("--part", choices=list(PARTS), action="append", help="only this part (may be repeated)")
    parser.add_argument("--unreached", type=Path, help="keep lines that are reached in this file, and print the others")
    given = parser.parse_args()
    reached = Reached() if given.unreached else None
    parts = given.part or list(PARTS)
    if given.what == "record":
        kept = {}
        if given.file.exists():
            kept = dict(np.load(given.file))
        for name, solve in frames(parts, given.every):
            kept |= {f"{name}/{k}": v for k, v in answer(solve).items()}
        np.savez_compressed(given.file, **kept)
        if reached is not None:
            reached.report(given.unreached)
        print(f"{len({k.rsplit('/', 1)[0] for k in kept})} frames in {given.file}")
        return 0
    before = answers_in(given.file)
    after = None if given.after is None else answers_in(given.after)
    largest: dict[str, float] = {}
    worst: list[tuple[float, str, str]] = []
    count = 0
    for name, solve in frames(parts, given.every):
        if name not in before or (after is not None and name not in after):
            continue
        count += 1
        now, then = answer(solve) if after is None else after[name], before[name]
        for quantity in sorted(then):
            off = difference(then[quantity], now[quantity]) if quantity in now else math.inf
            largest[quantity] = max(largest.get(quantity, 0.0), off)
            if off > SAME:
                worst.append((off, name, quantity))
    print(f"{count} frames, largest relative difference:")
    for quantity, off in sorted(largest.items()):
        print(f"  {quantity:22} {off:.2g}")
    changed = dict.fromkeys(name for _, name, _ in worst)
    for name in changed:
        print(f"  {name}: " + ", ".join(f"{q} {off:.2g}" for off, n, q in worst if n == name))
    print(f"{len(changed)} of {count} frames differ by more than {SAME:g}")
    if reached is not None:
        reached.report(given.unreached)
    return int(bool(worst))


if __name__ == "__main__":
    sys.exit(main())
