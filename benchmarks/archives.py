"""Long recordings through the command line: frames a second, memory while it runs, and what a killed worker and a killed run change.

    python benchmarks/archives.py [--frames 100000] [--size 32] [--methods tikhonov automatic] [--workers 1 2] [--write]
    python benchmarks/archives.py --cluster [--frames 1000000] [--size 16] [--without-worker] [--write]

The first makes a Zarr recording of presses with noise and runs ``palpate reconstruct`` on it, each method on each number of workers; methods that take
more than a hundredth of a second a frame get their own, shorter recording (``--slow`` frames). The second starts a Dask scheduler and two workers of this
machine and runs it three times: undisturbed, with a worker killed half-way (another one takes its place), and killed itself (SIGKILL) half-way and resumed.
(``--without-worker`` leaves out the second.) Results are compared array by array, by digests. ``--write`` writes docs/_generated/archives.md and archives_cluster.md.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.recordings import recorder

TABLES = Path(__file__).parent.parent / "docs" / "_generated"
CHANNELS = ["stress_xz", "stress_yz", "stress_zz"]
SKIN = """[pad]
kind = "half_space"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [{n}, {n}]
pitch = "1 mm"
depth = "2 mm"
channels = ["stress_xz", "stress_yz", "stress_zz"]
"""
#: Milliseconds between two looks at the memory.
LOOK = 200


def make(folder: Path, n: int, frames: int) -> Path:
    """A recording of ``frames`` frames: sixteen balls that come and go, 1 % noise."""
    (folder / f"skin{n}.toml").write_text(SKIN.format(n=n), encoding="utf-8")
    skin = pp.Skin.from_file(folder / f"skin{n}.toml")
    rng = np.random.default_rng(0)
    presses = []
    for _ in range(16):
        ball = pp.solutions.hertz_point(
            contact_radius=rng.uniform(0.1, 0.2) * n * 1e-3, force=float(rng.uniform(0.5, 2.0))
        )
        x, y = rng.uniform(-0.2, 0.2, 2) * n * 1e-3
        presses.append(skin.sense(ball.sliding(float(rng.uniform(0.0, 0.4))).shifted(x, y)).astype(np.float32))
    noise = 0.01 * max(float(np.abs(p).max()) for p in presses)
    some = (noise * rng.standard_normal((64, *presses[0].shape))).astype(np.float32)
    path = folder / f"{n}-{frames}.zarr"
    with recorder(path, CHANNELS) as out:
        for i in range(frames):
            load = 0.5 * (1.0 - np.cos(2.0 * np.pi * (i % 200) / 200.0))
            # the same few frames of noise, each time with other signs and rows: made in no time, and never twice the same
            out.readings(0.005 * i, load * presses[(i // 200) % 16] + np.roll(some[i % 64], i // 64 % n, axis=1))
    return path


def memory_of(root: int) -> float:
    """Bytes of a process and all that it started, shared pages counted once each (MB)."""
    total, waiting = 0, [root]
    while waiting:
        pid = waiting.pop()
        try:
            waiting += [
                int(c) for t in Path(f"/proc/{pid}/task").iterdir() for c in (t / "children").read_text().split()
            ]
            pss = next(
                line for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines() if line.startswith("Pss:")
            )
            total += int(pss.split()[1])
        except (OSError, StopIteration):
            continue
    return total / 1e3


def processor_of(pid: int) -> float:
    """Seconds of processor time of one process, without those that it started."""
    try:
        spent = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:
        return 0.0
    return sum(map(int, spent)) / os.sysconf("SC_CLK_TCK")


@dataclass
class Ran:
    """One run: wall seconds, processor seconds of the command itself and of all that it started, memory over time (MB), exit code."""

    seconds: float = 0.0
    own: float = 0.0
    processor: float = 0.0
    memory: list[float] = field(default_factory=list)
    code: int = 0

    def memory_at(self, part: float) -> float:
        """Largest memory in a twentieth of the run about ``part``."""
        n = len(self.memory)
        low, high = int((part - 0.05) * n), int((part + 0.05) * n) + 1
        return max(self.memory[max(0, low) : max(high, 1)])


def run(*arguments: str, watch: Callable[[float], bool] | None = None) -> Ran:
    """``palpate`` with these arguments. ``watch`` is called now and then with the seconds since the start; where it says True, the run is killed."""
    out, begun, spent = Ran(), time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "palpate", *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            out.memory.append(memory_of(process.pid))
            out.own = max(out.own, processor_of(process.pid))
            if watch is not None and watch(time.perf_counter() - begun):
                process.send_signal(signal.SIGKILL)
            time.sleep(LOOK / 1e3)
        out.seconds, out.code = time.perf_counter() - begun, process.returncode
        now = resource.getrusage(resource.RUSAGE_CHILDREN)
        out.processor = now.ru_utime + now.ru_stime - spent.ru_utime - spent.ru_stime
        if out.code > 0:
            raise RuntimeError(f"{' '.join(arguments)}: {process.stderr.read() if process.stderr else ''}")
    return out


def digests(store: Path) -> dict[str, str]:
    """What tells the arrays of a store, each read block by block: two stores that tell the same hold the same, bit for bit."""
    import zarr

    out = {}
    for name, array in zarr.open_group(str(store), mode="r").arrays():
        told = hashlib.sha256(f"{array.shape} {array.dtype}".encode())
        step = max(1, int(3e7 // max(1, array.dtype.itemsize * int(np.prod(array.shape[1:])))))
        for i in range(0, array.shape[0] if array.ndim else 1, step):
            told.update(np.ascontiguousarray(array[(slice(i, i + step),) if array.ndim else ()]).tobytes())
        out[name] = told.hexdigest()
    return out


def local(folder: Path, given: argparse.Namespace) -> str:
    """Methods by numbers of workers on this machine."""
    rows = [
        "| method | frames | workers | wall [s] | frames a second | processor [s]: the command, its workers | memory [MB] at a quarter, a half, the end | same result |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for method in given.methods:
        frames = given.frames if method in ("tikhonov", "dft", "linear", "truncated", "hilgers") else given.slow
        path, first = make(folder, given.size, frames), None
        for workers in given.workers:
            out = folder / f"{method}-{workers}.zarr"
            done = run(
                *("reconstruct", str(path), "--skin", str(folder / f"skin{given.size}.toml"), "--method", method),
                *("--workers", str(workers), "--out", str(out), "--force"),
            )
            found = digests(out)
            alike = "-" if first is None else ("yes" if found == first else "NO")
            memory = ", ".join(f"{done.memory_at(p):.0f}" for p in (0.25, 0.5, 1.0))
            rows.append(
                f"| {method} | {frames} | {workers} | {done.seconds:.0f} | {frames / done.seconds:.1f} "
                f"| {done.own:.0f}, {max(done.processor - done.own, 0.0):.0f} | {memory} | {alike} |"
            )
            print(rows[-1], flush=True)
            first = first or found
            shutil.rmtree(out)
        shutil.rmtree(path)
    return "\n".join(rows) + "\n"


class Cluster:
    """A Dask scheduler and two workers in processes of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = (folder / "cluster.log").open("w")
        where = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(where)
        )
        while not where.is_file() or not where.read_text().strip():
            time.sleep(0.2)
        import json

        self.address = str(json.loads(where.read_text())["address"])
        self.workers = [self._worker(), self._worker()]

    def _start(self, what: str, *arguments: str) -> subprocess.Popen[bytes]:
        # Dask's profile of each worker, an hour of samples, takes hundreds of MB
        quiet = {**os.environ, "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
        return subprocess.Popen(
            [sys.executable, "-m", "dask", what, *arguments],
            stdout=self.log,
            stderr=self.log,
            start_new_session=True,
            env=quiet,
        )

    def _worker(self) -> subprocess.Popen[bytes]:
        return self._start(
            *(
                "worker",
                self.address,
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--local-directory",
                str(self.folder),
            )
        )

    def kill_one(self) -> None:
        """A worker dies (SIGKILL), another one comes."""
        os.killpg(self.workers[0].pid, signal.SIGKILL)
        self.workers[0].wait()
        self.workers[0] = self._worker()

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()
        self.log.close()


def cluster(folder: Path, given: argparse.Namespace) -> str:
    """The same run three times on a Dask cluster of this machine."""
    frames, path = given.frames, make(folder, given.size, given.frames)
    skin = str(folder / f"skin{given.size}.toml")
    rows = [
        "| run | wall [s] | frames a second | memory of the command [MB] at a quarter, a half, the end | same result |",
        "|---|---|---|---|---|",
    ]

    def told(name: str, done: list[Ran], alike: str) -> None:
        seconds = sum(d.seconds for d in done)
        memory = ", ".join(f"{done[-1].memory_at(p):.0f}" for p in (0.25, 0.5, 1.0))
        rows.append(f"| {name} | {seconds:.0f} | {frames / seconds:.0f} | {memory} | {alike} |")
        print(rows[-1], flush=True)

    dask = Cluster(folder)
    try:
        whole = folder / "whole.zarr"

        def command(out: Path) -> list[str]:
            asked = ["reconstruct", str(path), "--skin", skin, "--method", "tikhonov", "--out", str(out)]
            return [*asked, "--scheduler", dask.address, "--resume"]

        first = run(*command(whole))
        told("undisturbed", [first], "-")
        said = digests(whole)
        shutil.rmtree(whole)  # a million frames take 40 GB
        again = folder / "again.zarr"
        if given.worker:
            killed: list[float] = []

            def lose(seconds: float) -> bool:
                if not killed and seconds > 0.5 * first.seconds:
                    killed.append(seconds)
                    dask.kill_one()
                return False

            done = run(*command(again), watch=lose)
            told(f"a worker killed after {killed[0]:.0f} s", [done], "yes" if digests(again) == said else "NO")
            shutil.rmtree(again)
        broken = run(*command(again), watch=lambda seconds: seconds > 0.5 * first.seconds)
        assert broken.code == -signal.SIGKILL
        assert not again.exists()
        rest = run(*command(again))
        alike = "yes" if digests(again) == said else "NO"
        told(f"killed itself after {broken.seconds:.0f} s, resumed: {rest.seconds:.0f} s more", [broken, rest], alike)
    finally:
        dask.close()
    return "\n".join(rows) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--slow", type=int, default=200, help="frames for methods that solve one after another")
    parser.add_argument("--size", type=int)
    parser.add_argument("--methods", nargs="+", default=["tikhonov", "automatic"])
    parser.add_argument("--workers", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--cluster", action="store_true")
    parser.add_argument("--without-worker", dest="worker", action="store_false", help="no run that loses a worker")
    parser.add_argument("--folder", type=Path, help="where the files go while it runs (tens of GB)")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    given.frames = given.frames or (1_000_000 if given.cluster else 100_000)
    given.size = given.size or (16 if given.cluster else 32)
    with tempfile.TemporaryDirectory(dir=given.folder) as held:
        said = (cluster if given.cluster else local)(Path(held), given)
    print(said)
    if given.write:
        name = "archives_cluster.md" if given.cluster else "archives.md"
        which = (
            f" --cluster{'' if given.worker else ' --without-worker'}"
            if given.cluster
            else f" --methods {' '.join(given.methods)}"
        )
        asked = f"`python benchmarks/archives.py{which} --frames {given.frames} --size {given.size}`"
        what = f"{given.size} x {given.size} taxels of three stresses, Zarr to Zarr, two cores (load average at the end: {os.getloadavg()[1]:.1f})"
        (TABLES / name).write_text(f"Made by {asked}: {what}.\n\n{said}", encoding="utf-8")


if __name__ == "__main__":
    main()
