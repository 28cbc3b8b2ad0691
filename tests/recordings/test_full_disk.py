"""Recorders on a full disk, killed and interrupted: what is said, and what is left."""

from __future__ import annotations

import contextlib
import errno
import gc
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.errors import InvalidInput
from palpate.recordings import read_recording, recorder
from palpate.recordings.files import in_place
from palpate.recordings.heldfile import PAGE, HeldFile
from palpate.recordings.stores import BLOCK

for library in ("mcap", "rosbags", "zarr"):
    pytest.importorskip(library)

FILES = (".mcap", ".nc", ".h5", ".zarr")


@contextlib.contextmanager
def room(limit: int) -> Iterator[None]:
    """No file may grow beyond ``limit`` bytes: writes fail half-way, as on a full disk (EFBIG in place of ENOSPC)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    bytecode, sys.dont_write_bytecode = (
        sys.dont_write_bytecode,
        True,
    )  # Python would keep a torn .pyc of what it imports
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        sys.dont_write_bytecode = bytecode


def frame(i: int) -> Any:
    """Noise, which no codec makes smaller, that tells its frame."""
    values = np.random.default_rng(i).standard_normal((1, 8, 8)).astype(np.float32)
    values[0, 0, 0] = i
    return values


def check(saved: pp.Recording) -> None:
    """Every frame is the one of its time."""
    np.testing.assert_allclose(saved.time, 0.005 * np.arange(len(saved.time)), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(saved.readings, [frame(i) for i in range(len(saved.time))])


@pytest.mark.parametrize("more", [0, 700])
@pytest.mark.parametrize("begin", [0, 31, 100])
@pytest.mark.parametrize("suffix", FILES)
@pytest.mark.long
def test_full(tmp_path: Path, suffix: str, begin: int, more: int) -> None:
    """Full from a frame on, at the first block, in the middle, at the end: one sentence, and as many frames to be read as it says."""
    path = tmp_path / f"full{suffix}"
    out = recorder(path, ["stress_zz"])
    for i in range(begin):
        out.readings(0.005 * i, frame(i))
    limit = more if suffix == ".zarr" else path.stat().st_size + more
    i = begin
    said = ""
    while not said:
        try:
            with room(limit):
                out.readings(0.005 * i, frame(i))
        except pp.InvalidInput as error:
            said = str(error)
        i += 1
    assert "writing failed (File too large)" in said
    words = re.search(r"; (?:the (\d+) frames before are (?:kept|readable)|no frame was kept)", said)
    assert words is not None
    kept = int(words[1] or 0)
    assert begin - kept <= (230 if suffix == ".mcap" else BLOCK)  # a chunk of MCAP holds 64 kB
    out.close()  # has been said
    with pytest.raises(pp.InvalidInput, match="closed"):
        out.readings(9.0, frame(0))
    if kept:
        saved = read_recording(path, salvage=suffix == ".mcap")
        assert len(saved.readings) == kept
        check(saved)
    else:
        with pytest.raises(pp.InvalidInput):
            read_recording(path, salvage=True)


@pytest.mark.parametrize("suffix", FILES)
def test_full_at_once_and_at_the_end(tmp_path: Path, suffix: str) -> None:
    """At open nothing is left behind; in close() what was written before is there."""
    with room(100), pytest.raises(pp.InvalidInput, match="writing failed"):
        recorder(tmp_path / f"a{suffix}", ["stress_zz"])
    assert not list(tmp_path.iterdir())
    path = tmp_path / f"b{suffix}"
    out = recorder(path, ["stress_zz"])
    for i in range(BLOCK + 5):
        out.readings(0.005 * i, frame(i))
    with room(50 if suffix == ".zarr" else path.stat().st_size), pytest.raises(pp.InvalidInput, match="writing failed"):
        out.close()
    out.close()
    if suffix != ".mcap":  # of which nothing was written yet
        saved = read_recording(path)
        assert len(saved.readings) == BLOCK
        check(saved)


@pytest.mark.long
def test_killed_between_any_two_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a kill leaves is what lies on the disk between two writes: all blocks before are there, and nothing else."""
    moments: list[tuple[int, Path]] = []
    done = 0
    put = HeldFile._put

    def watched(self: HeldFile, at: int, data: bytes) -> None:
        put(self, at, data)
        copy = tmp_path / f"{len(moments)}.nc"
        shutil.copy(path, copy)
        moments.append((done, copy))

    path = tmp_path / "torn.nc"
    monkeypatch.setattr(HeldFile, "_put", watched)
    with recorder(path, ["stress_zz"]) as out:
        for i in range(3 * BLOCK + 7):
            out.readings(0.005 * i, frame(i))
            done = i + 1
    monkeypatch.undo()
    assert len(moments) > 5
    most = 0
    for count, copy in moments:
        if count >= BLOCK:
            saved = read_recording(copy, salvage=True)
            check(saved)
            assert -1 <= count - len(saved.readings) < BLOCK
            most = max(most, len(saved.readings))
    check(read_recording(path))
    assert most >= 3 * BLOCK


@pytest.mark.parametrize("suffix", FILES)
@pytest.mark.long
def test_interrupted_anywhere(tmp_path: Path, suffix: str) -> None:
    """Ctrl-C at a hundred moments, also in the middle of a block: no frame is torn, shifted or doubled."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    path = tmp_path / f"a{suffix}"
    out = recorder(path, ["stress_zz"])
    before = signal.signal(signal.SIGALRM, interrupt)
    stopped = 0
    gc.disable()  # the interrupt is for the recorder, not for a test library's hook on garbage collection
    try:
        for i in range(20 * BLOCK):
            try:
                signal.setitimer(signal.ITIMER_REAL, 1e-5 * (1 + i % 40))
                out.readings(0.005 * i, frame(i))
                signal.setitimer(signal.ITIMER_REAL, 0)
            except KeyboardInterrupt:
                stopped += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        gc.enable()
    for i in range(20 * BLOCK, 21 * BLOCK):
        out.readings(0.005 * i, frame(i))
    out.close()
    saved = read_recording(path)
    assert stopped > 0
    # a frame whose call was broken off may be there or not
    assert len(saved.readings) >= 21 * BLOCK - stopped
    which = saved.readings[:, 0, 0, 0].astype(int)
    np.testing.assert_allclose(saved.time, 0.005 * which, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(saved.readings, [frame(i) for i in which])


# -- the file underneath -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_held_file_is_a_file(tmp_path: Path, seed: int) -> None:
    """Random reads and writes against bytes in memory; commits that fail at any write leave the disk as it was."""
    rng = np.random.default_rng(seed)
    file = HeldFile(tmp_path / "a")
    model, disk = bytearray(), b""
    for _ in range(60):
        at, count = int(rng.integers(0, len(model) + 3000)), int(rng.integers(0, 3 * PAGE))
        what = rng.integers(6)
        if what < 3:
            data = rng.bytes(count)
            file.seek(at)
            file.write(data)
            if count:
                model.extend(bytes(max(0, at - len(model))))
                model[at : at + count] = data
        elif what == 3:
            file.seek(at)
            assert file.read(count) == bytes(model[at : at + count])
        elif what == 4 and rng.random() < 0.5:
            size = max(len(disk), at)
            file.truncate(size)
            del model[size:]
            model.extend(bytes(size - len(model)))
        else:
            file.commit()
            disk = bytes(model)
        assert file.seek(0, os.SEEK_END) == len(model)
        assert (tmp_path / "a").read_bytes() == disk
    file.seek(0)
    file.write(rng.bytes(2 * PAGE))
    file.seek(len(model))
    file.write(rng.bytes(100))
    calls = 0

    def failing(self: HeldFile, at: int, data: bytes) -> None:
        nonlocal calls
        calls += 1
        if calls == 1 + seed % 3:
            put(self, at, data[: len(data) // 2])
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        put(self, at, data)

    put = HeldFile._put
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(HeldFile, "_put", failing)
        with pytest.raises(OSError, match="Input/output"):
            file.commit()
    assert (tmp_path / "a").read_bytes() == disk
    with pytest.raises(OSError, match="Input/output"):
        file.commit()
    file.close()
    file.close()


@pytest.mark.long
def test_left_open_at_the_end_of_the_process(tmp_path: Path) -> None:
    """Nobody closes it: no crash, and the blocks are there."""
    code = (
        "import sys, numpy as np\n"
        "from palpate.recordings import recorder\n"
        "out = recorder(sys.argv[1], ['stress_zz'])\n"
        "for i in range(70):\n"
        "    out.readings(0.005 * i, np.full((1, 4), float(i)))\n"
    )
    path = tmp_path / "a.h5"
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(read_recording(path).readings) == 64


def test_a_recorder_in_place_speaks_of_the_name_that_was_asked_for(tmp_path: Path) -> None:
    """Nothing is left of a hidden folder, so nothing of it is promised."""
    path = tmp_path / "a.zarr"

    def full() -> None:
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise InvalidInput("hidden: writing failed; the 96 frames before are kept and can be read.") from error

    with (
        pytest.raises(
            InvalidInput, match=r"a\.zarr: writing failed \(No space left on device\); nothing was written\."
        ) as found,
        in_place(path),
    ):
        full()
    assert isinstance(found.value.__cause__, OSError)
    assert list(tmp_path.iterdir()) == []
