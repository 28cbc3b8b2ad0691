"""Damaged files against every reader: never a traceback, a crash, a hang, much memory, or numbers that are wrong without a word.

    python benchmarks/fuzz.py --count 400          # files per reader
    python benchmarks/fuzz.py --reader npz --reader csv --count 2000 --keep bad

Each file is a good one with one damage (bytes flipped, cut, a block doubled, zeroed or filled at random, two files spliced; in text numbers
mangled, columns left out, other delimiters and line ends, NULs). Readers run in a child process with a time-out and a memory limit, so that a
crash or a hang is counted, not suffered. Repeatable: seeds follow from the reader's name.

Outcomes: refused (an error of palpate's own), same (the damage changed nothing that is read), first frames (salvage: a beginning of the
recording), CHANGED (other numbers without a word), traceback, crash, hang, memory. What may say CHANGED has no checksum: the files of others.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.recordings import (
    TopicMapping,
    read_recording,
    read_skin,
    read_stream,
    read_table,
    read_touch,
    recorder,
    write_recording,
    write_touch,
)

#: Seconds after which a reader hangs, bytes that it may take, and bytes that it may take for one small file.
PATIENCE, ADDRESSES, GREED = 60.0, 12 * 2**30, 512 * 2**20
SHEAR = ("stress_xz", "stress_yz", "stress_zz")
TABLE = {"columns": ["x", "y", "u", "v"], "channels": ["displacement_x", "displacement_y"], "position_factor": 1e-6}
TIP = TopicMapping(topic="/tip", channels=("stress_zz",), path="data", shape=(3, 4))
GRID = TopicMapping(
    topic="/palpate/touch", channels=SHEAR, fields=("shear_x", "shear_y", "pressure"), stamp="timestamp"
)


# -- good files --------------------------------------------------------------------------------------------------------


def _recording(seed: int, *, scattered: bool = False) -> pp.Recording:
    rng = np.random.default_rng(seed)
    readings = 100.0 * rng.standard_normal((40, 2, 12) if scattered else (40, 3, 3, 4))
    readings[3, 1, 2] = np.nan
    return pp.Recording(
        readings=readings.astype(np.float32),
        channels=SHEAR[1:] if scattered else SHEAR,
        time=np.round(np.cumsum(rng.uniform(0.01, 0.02, 40)), 9),
        positions=rng.uniform(0, 1e-2, (12, 2)) if scattered else None,
        meta={"sensor": f"finger {seed}"},
    )


def _whole(path: Path, seed: int) -> None:
    write_recording(_recording(seed, scattered=seed % 2 == 1), path)


def _streamed(path: Path, seed: int) -> None:
    data = _recording(seed, scattered=seed % 2 == 1)
    with recorder(path, data.channels, positions=data.positions, meta=data.meta) as out:
        for time, values in zip(data.time, data.readings):
            out.readings(float(time), values)


def _touches(path: Path, seed: int) -> None:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
        pp.AreaArray(shape=(4, 5), pitch=1e-3, depth=1e-3, channels=["stress_zz"]),
    )
    readings = np.random.default_rng(seed).standard_normal((4, 1, 4, 5))
    touch = skin.reconstruct(readings, method="tikhonov", components=["z"])
    if path.suffix == ".mcap":
        skin = pp.Skin(skin.pad, pp.AreaArray(shape=(4, 5), pitch=1e-3, depth=1e-3, channels=list(SHEAR)))
        touch = skin.reconstruct(np.random.default_rng(seed).standard_normal((4, 3, 4, 5)), method="tikhonov")
    write_touch(touch, path)


def _foreign_csv(path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = ["time (ms)," + ",".join(f"stress_zz[{i}] (kPa)" for i in range(6))]
    rows += [f"{10 * i}," + ",".join(f"{v:.5g}" for v in rng.standard_normal(6)) for i in range(20)]
    path.write_text("\n".join(rows) + "\n")


def _table_csv(path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = ["x,y,u,v", *(",".join(f"{v:.6g}" for v in rng.uniform(0, 100, 4)) for _ in range(25))]
    path.write_text("\n".join(rows) + "\n")


def _table_h5(path: Path, seed: int) -> None:
    import h5py

    rng = np.random.default_rng(seed)
    with h5py.File(path, "w") as file:
        file["pos"], file["vec"] = rng.uniform(0, 100, (2, 25)), rng.standard_normal((2, 25))


def _ros1(path: Path, seed: int) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        _messages(writer, types, types.serialize_ros1, seed)


def _ros2(path: Path, seed: int, plugin: str) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        _messages(writer, types, types.serialize_cdr, seed)


def _messages(writer: Any, types: Any, serialise: Any, seed: int) -> None:
    name = "std_msgs/msg/Float32MultiArray"
    array, layout = types.types[name], types.types["std_msgs/msg/MultiArrayLayout"]
    rng = np.random.default_rng(seed)
    connection = writer.add_connection("/tip", name, typestore=types)
    for i in range(20):
        message = array(layout=layout(dim=[], data_offset=0), data=rng.standard_normal(12).astype(np.float32))
        writer.write(connection, 10**8 * i, serialise(message, name))


def _skin_file(path: Path, seed: int) -> None:
    pads = (
        '[pad]\nkind = "half_space"\nyoungs_modulus = "200 kPa"\npoissons_ratio = 0.48\nprony = [[0.2, "100 ms"]]\n',
        '[pad]\nkind = "bonded_layers"\n[[pad.layer]]\nthickness = "2 mm"\nyoungs_modulus = "200 kPa"\npoissons_ratio = 0.48\n'
        '[pad.base]\nyoungs_modulus = "2 GPa"\npoissons_ratio = 0.3\n',
    )
    path.write_text(
        pads[seed % 2] + '\n[[plane]]\nkind = "area"\nshape = [4, 6]\npitch = ["1 mm", "1.2 mm"]\ndepth = "1.5 mm"\n'
        'channels = ["stress_xz", "stress_yz", "stress_zz"]\naperture = "0.8 mm"\nnoise = ["50 Pa", "50 Pa", "80 Pa"]\n'
        'noise_correlation = "0.5 mm"\ncenter = ["1 mm", "0 mm"]\n\n[surface]\nshape = [9, 9]\nspacing = "1 mm"\n\n'
        '[stream]\ntopic = "/xServTopic"\npath = "sensors[0].taxels"\nfields = ["x", "y", "z"]\nunit = ["25 Pa", "25 Pa", "-0.03 kPa"]\n'
    )


# -- readers -----------------------------------------------------------------------------------------------------------


def _skin_words(path: Path) -> str:
    """What a skin.toml says, as text: dataclasses show their fields."""
    return repr((read_skin(path), read_stream(path)))


@dataclass(frozen=True)
class Reader:
    """A reader, a maker of good files for it, and what may be asked of it."""

    name: str
    ending: str
    make: Callable[[Path, int], None]
    read: Callable[[Path], Any]
    #: the file has no checksum that covers all of it: other numbers cannot always be told
    trusting: bool = False
    text: bool = False
    #: a beginning of the recording is what is asked for
    salvage: bool = False


READERS = {
    r.name: r
    for r in (
        Reader("csv", ".csv", _whole, read_recording, text=True),
        Reader("csv salvage", ".csv", _whole, lambda p: read_recording(p, salvage=True), text=True, trusting=True),
        Reader("csv of others", ".csv", _foreign_csv, read_recording, text=True, trusting=True),
        Reader("table csv", ".csv", _table_csv, lambda p: read_table(p, **TABLE), text=True, trusting=True),  # type: ignore[arg-type]
        Reader(
            "table h5",
            ".h5",
            _table_h5,
            lambda p: read_table(p, columns=["pos", "vec"], channels=TABLE["channels"]),
            trusting=True,
        ),  # type: ignore[arg-type]
        Reader("npz", ".npz", _whole, read_recording),
        Reader("nc", ".nc", _whole, read_recording),
        Reader("h5 streamed", ".h5", _streamed, read_recording),
        Reader("h5 salvage", ".h5", _streamed, lambda p: read_recording(p, salvage=True), salvage=True, trusting=True),
        Reader("zarr", ".zarr", _whole, read_recording),
        Reader("mcap", ".mcap", _whole, read_recording),
        Reader("mcap salvage", ".mcap", _whole, lambda p: read_recording(p, salvage=True), salvage=True),
        Reader("mcap grid", ".mcap", _touches, lambda p: read_recording(p, mapping=GRID)),
        Reader("bag ros1", ".bag", _ros1, lambda p: read_recording(p, mapping=TIP), trusting=True),
        Reader(
            "bag db3", "", lambda p, s: _ros2(p, s, "SQLITE3"), lambda p: read_recording(p, mapping=TIP), trusting=True
        ),
        Reader(
            "bag mcap", "", lambda p, s: _ros2(p, s, "MCAP"), lambda p: read_recording(p, mapping=TIP), trusting=True
        ),
        Reader("skin.toml", ".toml", _skin_file, _skin_words, text=True, trusting=True),
        Reader("touch nc", ".nc", _touches, read_touch),
        Reader("touch zarr", ".zarr", _touches, read_touch),
    )
}


# -- damage ------------------------------------------------------------------------------------------------------------

Rng = np.random.Generator


def _span(data: bytes, rng: Rng) -> tuple[int, int]:
    start = int(rng.integers(0, len(data)))
    return start, min(len(data), start + int(rng.integers(1, max(2, min(len(data), 512)))))


def _flip(data: bytes, other: bytes, rng: Rng) -> bytes:
    out = bytearray(data)
    out[int(rng.integers(0, len(out)))] ^= int(rng.integers(1, 256))
    return bytes(out)


def _bit(data: bytes, other: bytes, rng: Rng) -> bytes:
    out = bytearray(data)
    out[int(rng.integers(0, len(out)))] ^= 1 << int(rng.integers(0, 8))
    return bytes(out)


def _flips(data: bytes, other: bytes, rng: Rng) -> bytes:
    for _ in range(8):
        data = _flip(data, other, rng)
    return data


def _cut(data: bytes, other: bytes, rng: Rng) -> bytes:
    return data[: int(rng.integers(1, len(data)))]


def _cut_late(data: bytes, other: bytes, rng: Rng) -> bytes:
    return data[: -int(rng.integers(1, min(len(data), 64)))]


def _double(data: bytes, other: bytes, rng: Rng) -> bytes:
    start, stop = _span(data, rng)
    return data[:stop] + data[start:]


def _drop(data: bytes, other: bytes, rng: Rng) -> bytes:
    start, stop = _span(data, rng)
    return data[:start] + data[stop:]


def _zero(data: bytes, other: bytes, rng: Rng) -> bytes:
    start, stop = _span(data, rng)
    return data[:start] + bytes(stop - start) + data[stop:]


def _noise(data: bytes, other: bytes, rng: Rng) -> bytes:
    start, stop = _span(data, rng)
    return data[:start] + rng.bytes(stop - start) + data[stop:]


def _splice(data: bytes, other: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(1, len(data)))
    return data[:at] + other[min(at, len(other)) :]


def _huge(data: bytes, other: bytes, rng: Rng) -> bytes:
    """A count of elements that nobody has: eight bytes of a header."""
    start = int(rng.integers(0, min(len(data), 4096)))
    return data[:start] + int(10 ** rng.integers(9, 19)).to_bytes(8, "little") + data[start + 8 :]


BYTES = (_flip, _bit, _flips, _cut, _cut_late, _double, _drop, _zero, _noise, _splice, _huge)
NUMBERS = ("nan", "inf", "-inf", "1e400", "1e-320", "9" * 400, "-1", "0", "", "1_5", "٣٤", "0x1f", "1,5", "--1", "1e", "'", "[", "{}")  # fmt: skip
LINES = ("\r\n", "\r", "\n\n", "\u2028", "\x0b", "\n#", "\n\x00")


def _number(data: bytes, other: bytes, rng: Rng) -> bytes:
    found = list(re.finditer(rb"[-+]?\d[\d.]*(?:e[-+]?\d+)?", data))
    if not found:
        return _flip(data, other, rng)
    one = found[int(rng.integers(len(found)))]
    return data[: one.start()] + str(rng.choice(NUMBERS)).encode() + data[one.end() :]


def _line_ends(data: bytes, other: bytes, rng: Rng) -> bytes:
    end = str(rng.choice(LINES)).encode()
    if rng.uniform() < 0.5:
        return data.replace(b"\r\n", b"\n").replace(b"\n", end)
    found = [m.start() for m in re.finditer(b"\n", data)]
    at = int(rng.choice(found)) if found else 0
    return data[:at] + end + data[at + 1 :]


def _delimiters(data: bytes, other: bytes, rng: Rng) -> bytes:
    return data.replace(b",", str(rng.choice([";", "\t", " ", "|", ",,", ""])).encode())


def _words(data: bytes, other: bytes, rng: Rng) -> bytes:
    """A cell, a column or a line that is not there, is there twice, or is something else."""
    lines = data.split(b"\n")
    if rng.uniform() < 0.4:
        column = int(rng.integers(0, 6))
        return b"\n".join(b",".join(c for i, c in enumerate(li.split(b",")) if i != column) for li in lines)
    at = int(rng.integers(0, len(lines)))
    odd = [
        b"",
        lines[at] + lines[at],
        b'"' + lines[at],
        b"\x00",
        b"[" * 1500,
        b"#" + lines[at],
        lines[0],
        b"x" * 140_000,
    ]
    lines[at] = odd[int(rng.integers(len(odd)))]
    return b"\n".join(lines)


def _mark(data: bytes, other: bytes, rng: Rng) -> bytes:
    return [b"\xef\xbb\xbf" + data, data.decode().encode("utf-16"), b"\x00" + data, data + b"\x00", data + b"\x1a"][
        int(rng.integers(5))
    ]


TEXT = (_number, _line_ends, _delimiters, _words, _mark)


@dataclass(frozen=True)
class Case:
    """One damaged file."""

    reader: Reader
    path: Path
    damage: str
    #: of the good files that it was made of
    sources: tuple[Path, ...]


def cases(reader: Reader, folder: Path, count: int) -> Iterator[Case]:
    """Good files once, then ``count`` damaged ones, one at a time under one name."""
    sources = tuple(folder / f"good {i}{reader.ending}" for i in range(2))
    for i, source in enumerate(sources):
        reader.make(source, i)
    damages = BYTES + TEXT * reader.text
    seed = zlib.crc32(reader.name.encode())
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        damage = damages[i % len(damages)]
        one, two = sources if rng.uniform() < 0.5 else sources[::-1]
        path = folder / f"bad{reader.ending}"
        if one.is_dir():
            shutil.rmtree(path, ignore_errors=True)
            shutil.copytree(one, path)
            parts = sorted(p for p in path.rglob("*") if p.is_file())
            part = parts[int(rng.integers(len(parts)))]
            twin = two / part.relative_to(path)
            if rng.uniform() < 0.04:
                part.unlink()
                yield Case(reader, path, "missing part", sources)
                continue
            part.write_bytes(damage(part.read_bytes() or b"\0", twin.read_bytes() if twin.is_file() else b"", rng))
        else:
            path.write_bytes(damage(one.read_bytes(), two.read_bytes(), rng))
        yield Case(reader, path, damage.__name__.strip("_").replace("_", " "), sources)


# -- the child that reads ----------------------------------------------------------------------------------------------


def _parts(found: Any) -> dict[str, Any]:
    """What a result holds, to be compared."""
    if isinstance(found, str):
        return {"text": found}
    if isinstance(found, pp.Recording):
        held = {k: getattr(found, k) for k in ("readings", "time", "positions", "channels")}
        return {**held, "meta": {k: v for k, v in found.meta.items() if k != "source"}}  # the source is the file's name
    return {**{str(k): v.values for k, v in found.variables.items()}, "attributes": {**found.attrs}}


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))
    return str(a) == str(b)


def same(found: Any, good: Any) -> bool:
    """Whether two results say the same, to the bit."""
    a, b = _parts(found), _parts(good)
    return a.keys() == b.keys() and all(_equal(a[k], b[k]) for k in a)


def beginning(found: Any, good: Any) -> bool:
    """Whether a recording is the first frames of another."""
    a, b, n = _parts(found), _parts(good), len(found.time)
    return all(_equal(a[k], b[k][:n] if k in ("readings", "time") else b[k]) for k in a)


def judge(reader: Reader, path: Path, goods: list[Any]) -> tuple[str, str]:
    """The outcome of one file, and why."""
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = reader.read(path)
    except pp.PalpateError as error:
        return "refused", str(error)
    except Exception as error:  # the very thing that is looked for
        frames = error.__traceback__
        while frames is not None and frames.tb_next is not None:
            frames = frames.tb_next
        where = f"{Path(frames.tb_frame.f_code.co_filename).name}:{frames.tb_lineno}" if frames else ""
        return "traceback", f"{type(error).__name__} at {where}: {error}"[:300]
    word = getattr(found, "meta", {}).get("salvaged", "") if reader.salvage else ""
    if word:  # what it says of what was lost is no part of what was recorded
        found = replace(found, meta={k: v for k, v in found.meta.items() if k != "salvaged"})
    if any(same(found, good) for good in goods):
        return "same", ""
    if reader.salvage and any(beginning(found, good) for good in goods):
        return "first frames", ""
    if said or word:
        return "warned", word or str(said[0].message)
    changed = [k for k, v in _parts(found).items() if not _equal(v, _parts(goods[0]).get(k))]
    return "CHANGED", ", ".join(changed)


def _work() -> None:
    """Read names of files from standard input, one JSON list a line; answer with an outcome each."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    goods: dict[str, Any] = {}
    print("ready", flush=True)  # what it takes to begin is no hang
    for line in sys.stdin:
        name, path, *sources = json.loads(line)
        reader = READERS[name]
        for source in sources:
            if source not in goods:
                goods[source] = reader.read(Path(source))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        outcome, why = judge(reader, Path(path), [goods[s] for s in sources])
        dilated = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        if dilated > GREED:
            outcome, why = "memory", f"{dilated / 2**20:.0f} MB; {outcome} {why}"
        print("\x1e" + json.dumps([outcome, why]), flush=True)


class Child:
    """The process that reads; started anew where it ends."""

    def __init__(self, patience: float = PATIENCE) -> None:
        self.patience = patience
        self._process: subprocess.Popen[str] | None = None

    def _start(self) -> subprocess.Popen[str]:
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--worker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self._answers: queue.Queue[str] = queue.Queue()

        def listen(stream: Any, answers: queue.Queue[str]) -> None:
            for line in stream:
                answers.put(line)
            answers.put("")

        self._listener = threading.Thread(target=listen, args=(self._process.stdout, self._answers), daemon=True)
        self._listener.start()
        self._answers.get()
        return self._process

    def outcome(self, case: Case) -> tuple[str, str]:
        """What came of one file."""
        process = self._process if self._process and self._process.poll() is None else self._start()
        with contextlib.suppress(OSError):
            process.stdin.write(json.dumps([case.reader.name, str(case.path), *map(str, case.sources)]) + "\n")  # type: ignore[union-attr]
            process.stdin.flush()  # type: ignore[union-attr]
        while True:
            try:
                line = self._answers.get(timeout=self.patience)
            except queue.Empty:
                self.close()
                return "hang", f"over {self.patience:g} s"
            if not line:
                signal = -process.wait()
                self.close()
                return "crash", f"signal {signal}"
            if line.startswith("\x1e"):
                outcome, why = json.loads(line[1:])
                return outcome, why

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._listener.join()
            with contextlib.suppress(BrokenPipeError):  # of what it did not take any more
                self._process.stdin.close()  # type: ignore[union-attr]
            self._process.stdout.close()  # type: ignore[union-attr]
            self._process = None


@dataclass
class Report:
    """Outcomes of one reader."""

    reader: Reader
    outcomes: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)
    damages: dict[str, Counter[str]] = field(default_factory=dict)

    def bad(self, outcome: str) -> bool:
        return outcome in ("traceback", "crash", "hang", "memory") or (
            outcome == "CHANGED" and not self.reader.trusting
        )


def fuzz(reader: Reader, count: int, *, keep: Path | None = None, child: Child | None = None) -> Report:
    """Damage ``count`` files of a reader; without a ``child`` they are read in this process."""
    report = Report(reader)
    with tempfile.TemporaryDirectory() as folder:
        goods: list[Any] = []
        for number, case in enumerate(cases(reader, Path(folder), count)):
            if child is None:
                goods = goods or [reader.read(s) for s in case.sources]
                outcome, why = judge(reader, case.path, goods)
            else:
                outcome, why = child.outcome(case)
            report.outcomes[outcome] += 1
            report.damages.setdefault(case.damage, Counter())[outcome] += 1
            if report.bad(outcome):
                report.failures[f"{outcome}: {why.replace(folder, '')}"] += 1
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    target = keep / f"{reader.name.replace(' ', '-')}-{number}{reader.ending}"
                    copy = shutil.copytree if case.path.is_dir() else shutil.copy
                    if not target.exists():
                        copy(case.path, target)
    return report


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="files per reader")
    parser.add_argument("--reader", action="append", choices=list(READERS), help="only these")
    parser.add_argument("--keep", type=Path, help="folder for the files that fail")
    parser.add_argument("--damages", action="store_true", help="also one line per damage")
    parser.add_argument("--patience", type=float, default=PATIENCE, help="seconds after which a reader hangs")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        _work()
        return
    columns = ("refused", "same", "first frames", "warned", "CHANGED", "traceback", "crash", "hang", "memory")
    print("| reader | files | " + " | ".join(columns) + " |\n|---|" + "---:|" * (len(columns) + 1))
    child, failed, total = Child(options.patience), 0, 0
    reports = []
    try:
        for name in options.reader or READERS:
            report = fuzz(READERS[name], options.count, keep=options.keep, child=child)
            reports.append(report)
            total += report.outcomes.total()
            failed += sum(report.failures.values())
            print(
                f"| {name} | {report.outcomes.total()} | "
                + " | ".join(str(report.outcomes[c] or "") for c in columns)
                + " |",
                flush=True,
            )
    finally:
        child.close()
    print(f"\n{total} files, {failed} failures")
    for report in reports:
        for why, times in report.failures.most_common(12):
            print(f"{report.reader.name}: {times} x {why}")
        if options.damages:
            for damage, outcomes in report.damages.items():
                print(f"{report.reader.name}, {damage}: {dict(outcomes)}")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
