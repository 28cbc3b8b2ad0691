"""Recordings of any length from file to file: the same result in pieces, over workers, on a cluster, after kills; memory that stays."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest

import palpate as pp
from command_line import run
from long_runs import long_runs
from palpate.archives import worker_count
from palpate.recordings import open_recording, read_recording, read_touch, write_recording
from palpate.recordings.labelled import touch_of
from palpate.recordings.recording import Recording
from palpate.touch import joined
from skin_files import skin_text

CHANNELS = ("stress_xz", "stress_zz")
FRAMES, CHUNK = 20, 6
SKIN = skin_text(16, channels=CHANNELS, noise="5 Pa")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A skin and a recording in three formats: presses, and pulls from the twelfth frame on."""
    found = tmp_path_factory.mktemp("long")
    (found / "skin.toml").write_text(SKIN)
    skin = pp.Skin.from_file(found / "skin.toml")
    rng = np.random.default_rng(0)
    press = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=20.0))
    frames = [press * (1.0 + 0.1 * i) * (1 if i < 12 else -1) for i in range(FRAMES)]
    readings = np.stack(frames) + rng.normal(0.0, 5.0, (FRAMES, *press.shape))
    recording = Recording(readings=readings, channels=CHANNELS, time=np.arange(FRAMES) / 100, meta={"finger": "left"})
    for name in ("r.nc", "r.zarr", "r.csv"):
        write_recording(recording, found / name)
    return found


@pytest.fixture(scope="module")
def skin(folder: Path) -> pp.Skin:
    return pp.Skin.from_file(folder / "skin.toml")


@dataclass(frozen=True)
class Mixed(pp.Tikhonov):
    """Says of frames that pull that another method found them, and of these alone how they slide."""

    def prepare(self, problem: Any) -> Any:
        return _Mixed(super().prepare(problem))


class _Mixed:
    def __init__(self, inner: Any) -> None:
        self._inner, self.grid = inner, inner.grid

    def solve(self, readings: Any, rng: Any = None) -> Any:
        pulls = readings[0][:, 1].sum(axis=-1) < 0
        found = self._inner.solve(readings, rng)
        return replace(
            found,
            method=np.where(pulls, "truncated", "tikhonov"),
            sliding=np.where(pulls, 0.5, np.nan) if pulls.any() else None,
            outliers=np.outer(pulls, np.arange(32) == 5),
        )


@pytest.fixture(scope="module")
def whole(folder: Path, skin: pp.Skin) -> pp.Touch:
    """The same pieces joined in memory."""
    recording = read_recording(folder / "r.nc")
    parts = [
        skin.reconstruct(recording.readings[i : i + CHUNK], time=recording.time[i : i + CHUNK], method=Mixed())
        for i in range(0, FRAMES, CHUNK)
    ]
    return joined(parts)


def same(found: Any, expected: Any) -> None:
    """Two results that agree to the last bit, whatever the formats call their kinds of numbers."""
    assert set(found.variables) == set(expected.variables)
    for name in expected.variables:
        np.testing.assert_array_equal(found[name].values, expected[name].values, err_msg=name)
        assert found[name].dims == expected[name].dims
    provenance = {"command", "recording", "skin", "palpate", "versions"}
    assert {k: v for k, v in found.attrs.items() if k not in provenance} == {
        k: v for k, v in expected.attrs.items() if k not in provenance
    }


@pytest.fixture(scope="module")
def plain(folder: Path, skin: pp.Skin) -> Any:
    """What one process makes without a break."""
    pp.reconstruct_recording(skin, folder / "r.zarr", folder / "plain.zarr", method="dft", chunk=CHUNK)
    return read_touch(folder / "plain.zarr")


# -- the same in pieces ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("source", "out"), [("r.zarr", "t.zarr"), *long_runs(("r.nc", "t.nc"), ("r.csv", "t.h5"))])
@pytest.mark.long
def test_pieces_are_the_whole(
    source: str, out: str, folder: Path, skin: pp.Skin, whole: pp.Touch, tmp_path: Path
) -> None:
    seen: list[tuple[int, int]] = []
    done = pp.reconstruct_recording(
        skin,
        folder / source,
        tmp_path / out,
        method=Mixed(),
        chunk=CHUNK,
        progress=lambda now, of: seen.append((now, of)),
        provenance={"operator": "me"},
    )
    assert seen == [(6, 20), (12, 20), (18, 20), (20, 20)]
    assert (done.frames, done.before) == (FRAMES, 0)
    dataset = read_touch(tmp_path / out)  # its checksum is confirmed
    found = touch_of(dataset)
    assert found.found_by is not None
    assert found.methods.tolist() == whole.methods.tolist()
    assert found.notes == whole.notes
    assert dataset.attrs["notes"] == dataset.traction.attrs["notes"] == "\n".join(whole.notes)
    assert dataset.attrs["operator"] == "me"
    np.testing.assert_array_equal(found.values, whole.values)
    np.testing.assert_array_equal(found.time, whole.time)
    np.testing.assert_array_equal(found.status, whole.status)
    np.testing.assert_array_equal(found.sliding, whole.sliding)
    (said,) = (n for n in found.notes if n.startswith("left out in "))
    assert said.endswith("as unexplained by any contact (dead, stuck or saturated?): stress_xz at taxel (5,)")
    np.testing.assert_array_equal(found._errors.posterior.force, whole._errors.posterior.force)  # type: ignore[union-attr]
    np.testing.assert_array_equal(found.std(), whole.std())
    np.testing.assert_array_equal(done.touch.values, whole[done.frame].values)
    assert os.listdir(tmp_path) == [out]


@pytest.mark.long
def test_formats_that_say_less(folder: Path, skin: pp.Skin, tmp_path: Path) -> None:
    """MCAP grows too; NPZ is written at the end. They hold the same traction, and CSV the forces."""
    for name in ("t.csv", "t.mcap", "t.npz", "t.nc"):
        pp.reconstruct_recording(skin, folder / "r.nc", tmp_path / name, method="dft", chunk=CHUNK)
    truth = read_touch(tmp_path / "t.nc").traction.values
    with np.load(tmp_path / "t.npz") as file:
        np.testing.assert_array_equal(file["traction"], truth)
        assert json.loads(file["record"].item())["method"] == "dft"
    table = pandas.read_csv(tmp_path / "t.csv")
    force = read_touch(tmp_path / "t.nc").force.sel(component="z").values
    np.testing.assert_allclose(table["force_z (N/m)"], force, rtol=1e-5)
    from mcap.reader import make_reader

    with (tmp_path / "t.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    counts = {summary.channels[c].topic: n for c, n in summary.statistics.channel_message_counts.items()}  # type: ignore[union-attr]
    assert set(counts.values()) == {FRAMES}


@pytest.mark.long
def test_creep_goes_through_all_pieces(tmp_path: Path) -> None:
    gel = pp.Viscoelastic(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), prony=[(0.3, 0.05)])
    array = pp.LineArray(count=12, pitch=1e-3, depth=1e-3, channels=["strain_zz"], noise=1e-5)
    skin, time = pp.Skin(gel, array), np.arange(12) / 100
    press = skin.sample(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    readings = skin.sense(np.stack([press] * 12), time=time)
    recording = Recording(readings=readings, channels=["strain_zz"], time=time)
    expected = skin.reconstruct(readings, time=time, method="tikhonov").values

    def stop(now: int, of: int) -> None:
        if now == 10:
            raise KeyboardInterrupt

    options: dict[str, Any] = {"method": "tikhonov", "chunk": 5, "resume": True}
    with pytest.raises(KeyboardInterrupt):
        pp.reconstruct_recording(skin, recording, tmp_path / "t.zarr", progress=stop, **options)
    pp.reconstruct_recording(skin, recording, tmp_path / "t.zarr", **options)
    found = read_touch(tmp_path / "t.zarr").traction.values
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.long
def test_memory_does_not_grow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is allocated at the peak is a part of what is written, and would be several times that."""
    for limit in ("netcdfstream.BLOCK", "checked.BLOCK", "opened.BLOCK"):  # as small as the recording is
        monkeypatch.setattr(f"palpate.recordings.{limit}", 100_000)
    array = pp.LineArray(count=600, pitch=1e-3, depth=1e-3, channels=CHANNELS, noise=5.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    press = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=20.0))
    write_recording(Recording(readings=np.stack([press] * 600), channels=CHANNELS), tmp_path / "r.nc")
    skin.prepare(method="dft")
    tracemalloc.start()
    pp.reconstruct_recording(skin, tmp_path / "r.nc", tmp_path / "t.nc", method="dft", chunk=10)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.5 * read_touch(tmp_path / "t.nc").nbytes


# -- over workers ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fatal(pp.paper.Division):
    """Takes its worker down, once for each line that is left in a file."""

    left: str = ""

    def prepare(self, problem: Any) -> Any:
        if multiprocessing.parent_process() is not None:
            lives = Path(self.left).read_text().splitlines()
            if lives:
                fresh = Path(f"{self.left}.{os.getpid()}")  # another worker never reads half of it
                fresh.write_text("".join(f"{line}\n" for line in lives[1:]))
                fresh.replace(self.left)
                os.kill(os.getpid(), signal.SIGKILL)
        return super().prepare(problem)


@pytest.mark.long
def test_a_worker_that_is_killed_changes_nothing(folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path) -> None:
    (tmp_path / "left").write_text("one\n")
    pp.reconstruct_recording(
        skin,
        folder / "r.zarr",
        tmp_path / "t.zarr",
        method=Fatal(left=str(tmp_path / "left")),
        chunk=CHUNK,
        scheduler="processes",
    )
    same(read_touch(tmp_path / "t.zarr"), plain)
    assert (tmp_path / "left").read_text() == ""


@pytest.mark.long
def test_workers_that_are_killed_again_and_again_are_said(folder: Path, skin: pp.Skin, tmp_path: Path) -> None:
    (tmp_path / "left").write_text("one more\n" * 99)
    with pytest.raises(pp.Unsupported, match=r"stopped by the system 4 times at frames 0 to 5.*fewer workers"):
        pp.reconstruct_recording(
            skin, folder / "r.nc", tmp_path / "t.nc", method=Fatal(left=str(tmp_path / "left")), chunk=CHUNK, workers=2
        )
    assert os.listdir(tmp_path) == ["left"]


@pytest.mark.long
def test_threads(folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path) -> None:
    options: dict[str, Any] = {"method": "dft", "chunk": CHUNK, "workers": 3, "scheduler": "threads"}
    pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / "t.zarr", **options)
    same(read_touch(tmp_path / "t.zarr"), plain)


@pytest.mark.parametrize("disk", ["the same", "another"])
@pytest.mark.long
def test_workers_write_what_they_make(
    disk: str, folder: Path, skin: pp.Skin, whole: pp.Touch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All pieces but those that begin a store, or bring what it does not have; over the network where a worker does not see the disk."""
    from palpate.archives import pools
    from palpate.recordings.touchstream import Written
    from palpate.recordings.zarrstream import ZarrStream

    seen: list[bool] = []
    add = ZarrStream.add

    def counted(self: ZarrStream, start: int, piece: Any) -> None:
        seen.append(isinstance(piece, Written))
        add(self, start, piece)
        if disk == "another":
            (self.path.parent / "here").write_text("of another run")

    monkeypatch.setattr(ZarrStream, "add", counted)
    monkeypatch.setattr(pools._Threads, "elsewhere", True)
    options: dict[str, Any] = {"chunk": 2, "workers": 1, "scheduler": "threads"}
    pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / "t.zarr", method=Mixed(), **options)
    found = touch_of(
        read_touch(tmp_path / "t.zarr")
    )  # its checksum, put together from those of the pieces, is confirmed
    assert any(seen) == (disk == "the same")
    assert found.methods.tolist() == whole.methods.tolist()
    assert found.notes == whole.notes
    np.testing.assert_array_equal(found.sliding, whole.sliding)
    np.testing.assert_allclose(found.values, whole.values, rtol=1e-9, atol=1e-9 * np.abs(whole.values).max())
    assert os.listdir(tmp_path) == ["t.zarr"]


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_command_that_is_stopped_goes_on(number: int, folder: Path, plain: Any, tmp_path: Path) -> None:
    """Ctrl-C and kill -9 among many pieces: no worker stays, what is done stays, and the result is the same."""
    command = ["reconstruct", str(folder / "r.zarr"), "--skin", str(folder / "skin.toml"), "--out", "t.zarr"]
    command += ["--method", "dft", "--workers", "2", "--chunk", str(CHUNK)]
    # as at a terminal: the signal reaches all processes of the command
    slow = (
        "import sys, time\n"
        "from palpate.recordings.zarrstream import ZarrStream\n"
        "add = ZarrStream.add\n"
        "ZarrStream.add = lambda self, start, piece: (add(self, start, piece), time.sleep(1.0))\n"
        "from palpate.cli import main\n"
        "if __name__ == '__main__':\n"
        "    main()\n"
    )
    (tmp_path / "slow.py").write_text(slow)
    started = subprocess.Popen(
        [sys.executable, "slow.py", *command], cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    pieces = tmp_path / "t.zarr.partial" / "pieces.jsonl"
    until = time.monotonic() + 120
    while (not pieces.exists() or len(pieces.read_text().splitlines()) < 3) and time.monotonic() < until:
        time.sleep(0.05)
    if number == signal.SIGINT:
        os.killpg(started.pid, number)
    else:
        os.kill(started.pid, number)
    said = started.communicate(timeout=60)[1]
    if number == signal.SIGINT:
        assert started.returncode == 130
        assert said.splitlines()[-1] == "error: stopped"
        assert "t.zarr.partial keeps the finished frames: --resume continues from there." in said
    for _ in range(100):  # the workers see that the first process is gone
        try:
            os.killpg(started.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.1)
    else:
        raise AssertionError("workers outlive their command")
    out = run(*command, "--resume", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    assert "frames were done before" in out.stdout
    same(read_touch(tmp_path / "t.zarr"), plain)
    assert sorted(os.listdir(tmp_path)) == ["slow.py", "t.zarr"]


# -- broken off, and on again ------------------------------------------------------------------------------------------


class Power(BaseException):
    """Goes."""


def broken_off(skin: pp.Skin, folder: Path, out: Path, *, pieces: int, **options: Any) -> list[int]:
    """A run that ends after so many pieces; the numbers of frames that were done."""
    seen: list[int] = []

    def go(now: int, _: int) -> None:
        seen.append(now)
        if len(seen) == pieces:
            raise Power

    with pytest.raises(Power):
        pp.reconstruct_recording(skin, folder / "r.zarr", out, chunk=CHUNK, progress=go, **options)
    return seen


@pytest.mark.parametrize(
    "harm", ["none", "torn line", "no line", "torn block", "lost block", "piece that is not in the list"]
)
@pytest.mark.long
def test_a_run_goes_on_where_it_was_broken_off(
    harm: str, folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path
) -> None:
    out = tmp_path / "t.zarr"
    broken_off(skin, folder, out, pieces=2, method="dft")
    assert not out.exists()
    listed = tmp_path / "t.zarr.partial" / "pieces.jsonl"
    lines = listed.read_text().splitlines(keepends=True)
    assert len(lines) == 3
    block = tmp_path / "t.zarr.partial" / "t.zarr" / "traction" / "c" / "1" / "0" / "0"
    before = 12
    if harm == "torn line":
        listed.write_text("".join(lines)[:-40])
        before = 6
    elif harm == "no line":
        listed.write_text("")
        before = 0
    elif harm == "torn block":
        block.write_bytes(block.read_bytes()[:-9])
        before = 6
    elif harm == "lost block":
        block.unlink()
        before = 6
    elif harm == "piece that is not in the list":
        listed.write_text("".join(lines[:2]))
        before = 6
    solved: list[int] = []
    solve = pp.Skin.reconstruct

    def counted(self: pp.Skin, readings: Any, **options: Any) -> pp.Touch:
        solved.append(len(readings))
        return solve(self, readings, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pp.Skin, "reconstruct", counted)
        done = pp.reconstruct_recording(skin, folder / "r.zarr", out, method="dft", chunk=CHUNK, resume=True)
    assert done.before == before
    assert sum(solved) == FRAMES - before
    same(read_touch(out), plain)
    np.testing.assert_array_equal(done.touch.values, plain.traction.values[done.frame])
    np.testing.assert_allclose(done.table["force_z (N/m)"], plain.force.sel(component="z").values)
    assert os.listdir(tmp_path) == ["t.zarr"]


@pytest.mark.long
def test_a_field_that_appears_late_is_filled_up(folder: Path, skin: pp.Skin, whole: pp.Touch, tmp_path: Path) -> None:
    """Broken off after the first frame that another method finds."""
    out = tmp_path / "t.zarr"
    broken_off(skin, folder, out, pieces=3, method=Mixed())
    pp.reconstruct_recording(skin, folder / "r.zarr", out, method=Mixed(), chunk=CHUNK, resume=True)
    found = touch_of(read_touch(out))
    assert found.methods.tolist() == whole.methods.tolist()
    assert found.notes == whole.notes
    np.testing.assert_array_equal(found.sliding, whole.sliding)


@pytest.mark.long
def test_another_run_does_not_go_on(folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path) -> None:
    out = tmp_path / "t.zarr"
    broken_off(skin, folder, out, pieces=1, method="dft")
    softer = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), skin.planes)
    other = replace(read_recording(folder / "r.nc"), time=np.arange(FRAMES) / 50)
    write_recording(other, tmp_path / "other.nc")
    good: dict[str, Any] = {"method": "dft", "chunk": CHUNK, "resume": True}
    for change, what in (
        ({"chunk": 5}, r"chunk \(was 6, is 5\)"),
        ({"method": pp.Tikhonov(order=2)}, r"method \(was dft, is tikhonov\(order=2\)\)"),
        ({"method": pp.Tikhonov(), "components": ["z"]}, "options"),
    ):
        with pytest.raises(pp.InvalidInput, match=what):
            pp.reconstruct_recording(skin, folder / "r.zarr", out, **{**good, **change})
    with pytest.raises(pp.InvalidInput, match=r"was another one: skin"):
        pp.reconstruct_recording(softer, folder / "r.zarr", out, **good)
    with pytest.raises(pp.InvalidInput, match=r"was another one: recording"):
        pp.reconstruct_recording(skin, tmp_path / "other.nc", out, **good)
    with pytest.raises(pp.InvalidInput, match=r"t.zarr.partial holds an interrupted run.*--resume"):
        pp.reconstruct_recording(skin, folder / "r.zarr", out, method="dft", chunk=CHUNK)
    pp.reconstruct_recording(skin, folder / "r.zarr", out, method="dft", chunk=CHUNK, overwrite=True)
    same(read_touch(out), plain)


def test_a_folder_of_somebody_else_is_left_alone(folder: Path, skin: pp.Skin, tmp_path: Path) -> None:
    (tmp_path / "t.zarr.partial").mkdir()
    (tmp_path / "t.zarr.partial" / "thesis.txt").write_text("years")
    with pytest.raises(pp.InvalidInput, match="holds something else"):
        pp.reconstruct_recording(skin, folder / "r.nc", tmp_path / "t.zarr", method="dft", overwrite=True)
    assert (tmp_path / "t.zarr.partial" / "thesis.txt").read_text() == "years"


@pytest.mark.parametrize("name", ["t.nc", "t.csv", "t.npz", "t.mcap"])
@pytest.mark.long
def test_other_files_are_there_when_they_are_whole(name: str, folder: Path, skin: pp.Skin, tmp_path: Path) -> None:
    (tmp_path / name).write_text("old")
    broken_off(skin, folder, tmp_path / name, pieces=2, method="dft", overwrite=True)
    assert (tmp_path / name).read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == sorted([name, "t.part.csv"])  # the forces of the frames before


@pytest.mark.parametrize("name", ["t.nc", "t.zarr"])
@pytest.mark.long
def test_a_disk_that_is_full_is_said_at_once(
    name: str, folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.recordings.heldfile import HeldFile
    from palpate.recordings.zarrstream import ZarrStream

    seen: list[int] = []
    for of, write in ((HeldFile, "_put"), (ZarrStream, "_put")):
        before = getattr(of, write)

        def put(self: Any, *arguments: Any, before: Any = before) -> None:
            if len(seen) == 2:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            before(self, *arguments)

        monkeypatch.setattr(of, write, put)
    options: dict[str, Any] = {"method": "dft", "chunk": CHUNK, "progress": lambda now, _: seen.append(now)}
    with pytest.raises(pp.InvalidInput, match=r"writing failed \(No space left on device\)"):
        pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / name, **options)
    assert seen == [6, 12]
    assert os.listdir(tmp_path) == ["t.zarr.partial" if name == "t.zarr" else "t.part.csv"]
    if name == "t.zarr":
        seen.append(0)  # there is room again
        assert pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / name, resume=True, **options).before == 12
        same(read_touch(tmp_path / name), plain)


@pytest.mark.long
def test_a_disk_without_room_for_the_numbers_is_said_and_the_run_goes_on_later(
    folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.archives import numbers

    monkeypatch.setattr(numbers, "MAX_FRAMES_IN_MEMORY", 1)
    add = numbers.Numbers.add

    def full(self: Any, start: int, found: dict[str, Any]) -> None:
        if start:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        add(self, start, found)

    options: dict[str, Any] = {"method": "dft", "chunk": CHUNK, "resume": True}
    with monkeypatch.context() as patch:
        patch.setattr(numbers.Numbers, "add", full)
        with pytest.raises(
            pp.InvalidInput,
            match=r"writing the numbers of the frames beside it failed \(No space left on device\). Free space there",
        ):
            pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / "t.zarr", **options)
    assert os.listdir(tmp_path) == ["t.zarr.partial"]
    assert pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / "t.zarr", **options).before > 0
    same(read_touch(tmp_path / "t.zarr"), plain)


# -- what is refused ---------------------------------------------------------------------------------------------------


def test_what_cannot_be_is_refused(folder: Path, skin: pp.Skin, tmp_path: Path) -> None:
    for options, what in (
        ({"workers": 0}, "workers must be a whole number from 1"),
        ({"workers": 1.5}, "workers must be a whole number from 1"),
        ({"scheduler": "slurm"}, r'scheduler must be "threads", "processes" or the address'),
        ({"scheduler": "tcp://127.0.0.1:1", "workers": 2}, "knows its own workers"),
        ({"chunk": 0}, "chunk must be a whole number of frames"),
        ({"resume": True}, "only a run into a Zarr store"),
        ({"frame": 20}, "frame 20 is not among the 20 frames"),
    ):
        with pytest.raises(pp.InvalidInput, match=what):
            pp.reconstruct_recording(skin, folder / "r.nc", tmp_path / "t.nc", method="dft", **options)
    (tmp_path / "there.nc").write_text("old")
    with pytest.raises(pp.InvalidInput, match="exists"):
        pp.reconstruct_recording(skin, folder / "r.nc", tmp_path / "there.nc")
    with pytest.raises(pp.Unsupported, match="length"):
        pp.reconstruct_recording(skin, folder / "r.nc", tmp_path / "t.nc", method="dft", length=1.0)
    assert os.listdir(tmp_path) == ["there.nc"]


def test_every_frame_is_looked_at_before_anything_is_done(folder: Path, skin: pp.Skin, tmp_path: Path) -> None:
    recording = read_recording(folder / "r.nc")
    for value, what in ((np.nan, "not finite"), (1e15, "units")):
        readings = recording.readings.copy()
        readings[-1, 0, 3] = value
        with pytest.raises(pp.InvalidInput, match=what):
            pp.reconstruct_recording(skin, replace(recording, readings=readings), tmp_path / "t.zarr", chunk=CHUNK)
    damaged = tmp_path / "r.nc"
    write_recording(recording, damaged)
    import h5py

    with h5py.File(damaged, "r+") as file:
        file["readings"][-1] *= 1.01
    with pytest.raises(pp.InvalidInput, match="does not agree with its checksum"):
        pp.reconstruct_recording(skin, damaged, tmp_path / "t.zarr", chunk=CHUNK)
    assert os.listdir(tmp_path) == ["r.nc"]


def test_an_opened_recording_is_the_recording(folder: Path) -> None:
    whole = read_recording(folder / "r.nc")
    seen: list[Any] = []
    for name in ("r.nc", "r.zarr", "r.csv"):
        seen.clear()
        with open_recording(folder / name) as opened:
            assert (len(opened), opened.head.channels, opened.head.meta) == (FRAMES, CHANNELS, {"finger": "left"})
            np.testing.assert_array_equal(opened.time, whole.time)
            np.testing.assert_array_equal(opened.frames(3, 9).readings, whole.readings[3:9])
            crc = opened.survey(lambda part: seen.append(part.readings))
            np.testing.assert_array_equal(np.concatenate(seen), whole.readings)
            if opened.expected is not None:
                assert crc == int(np.asarray(opened.expected).item())


def test_a_long_table_is_read_line_by_line(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.recordings.csvfile.LONG", 0)
    whole, text = read_recording(folder / "r.csv"), (folder / "r.csv").read_text()
    for lines in (text, text.replace("\n", "\r\n"), "\ufeff" + text):
        (tmp_path / "r.csv").write_bytes(lines.encode())
        with open_recording(tmp_path / "r.csv") as opened:
            assert (opened.head.meta, opened.head.channels) == (whole.meta, whole.channels)
            np.testing.assert_array_equal(opened.time, whole.time)
            np.testing.assert_array_equal(opened.frames(3, FRAMES).readings, whole.readings[3:])
            opened.survey()
    own = text.splitlines(keepends=True)
    for harmed, what in (
        ("".join(own[:-1]), "is truncated: its last line, the checksum"),
        (text.replace("e", "x", 40), "first column must be"),
        ("".join(own[:3]), "no frames"),
        (text + "\0", "NUL"),
    ):
        (tmp_path / "r.csv").write_text(harmed)
        with pytest.raises(pp.InvalidInput, match=what), open_recording(tmp_path / "r.csv"):
            pass
    changed = own.copy()
    changed[5] = changed[5].replace(changed[5].split(",")[2], "1.5")
    for lines in ("".join(changed), text.replace("0.01,", "0.02,", 1)):
        (tmp_path / "r.csv").write_text(lines)
        with open_recording(tmp_path / "r.csv") as opened, pytest.raises(pp.InvalidInput, match="delete its last line"):
            opened.survey()
    (tmp_path / "r.csv").write_text("".join(own[2:-1])[:-1])  # another program's, perhaps cut
    with pytest.warns(pp.errors.UncheckedInput, match="no line break"), open_recording(tmp_path / "r.csv") as opened:
        assert len(opened) == FRAMES


@pytest.mark.long
def test_the_command_takes_it_all(folder: Path, plain: Any, tmp_path: Path) -> None:
    command = ["reconstruct", str(folder / "r.zarr"), "--skin", str(folder / "skin.toml"), "--method", "dft"]
    options = ["--workers", "2", "--scheduler", "threads", "--chunk", str(CHUNK), "--resume"]
    out = run(*command, "--out", "t.zarr", *options, cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    assert "wrote           t.zarr" in out.stdout
    same(read_touch(tmp_path / "t.zarr"), plain)


# -- on a cluster ------------------------------------------------------------------------------------------------------


@pytest.fixture
def cluster() -> Iterator[str]:
    """A Dask scheduler with a worker of two threads in this process."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address="127.0.0.1:0", silence_logs=50
    ) as found:
        yield found.scheduler_address


@pytest.mark.long
def test_a_dask_scheduler(cluster: str, folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path) -> None:
    done = pp.reconstruct_recording(
        skin, folder / "r.zarr", tmp_path / "t.zarr", method="dft", chunk=CHUNK, scheduler=cluster
    )
    assert done.frames == FRAMES
    same(read_touch(tmp_path / "t.zarr"), plain)


def test_without_dask_its_extra_is_named(
    folder: Path, skin: pp.Skin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(pp.Unsupported, match=r'need the package distributed: pip install "palpate\[dask\]"'):
        pp.reconstruct_recording(skin, folder / "r.nc", tmp_path / "t.nc", scheduler="tcp://127.0.0.1:8786")


@pytest.mark.long
def test_a_cluster_that_loses_workers_and_its_client(folder: Path, skin: pp.Skin, plain: Any, tmp_path: Path) -> None:
    """A worker is killed at its first piece; then the client is, by kill -9, and another one goes on."""
    distributed = pytest.importorskip("distributed")
    (tmp_path / "left").write_text("one\n")
    client = (
        "import sys, time\n"
        "import palpate as pp\n"
        "from test_streaming_recordings import Fatal\n"
        "folder, address, left, out = sys.argv[1:]\n"
        "pp.reconstruct_recording(\n"
        "    pp.Skin.from_file(f'{folder}/skin.toml'), f'{folder}/r.zarr', out, method=Fatal(left=left), chunk=6,\n"
        "    scheduler=address, resume=True, progress=lambda now, of: (print(now, flush=True), time.sleep(60 * (now == 12))),\n"
        ")\n"
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", silence_logs=50
    ) as cluster:
        address = cluster.scheduler_address
        arguments = [str(folder), address, str(tmp_path / "left"), str(tmp_path / "t.zarr")]
        started = subprocess.Popen(
            [sys.executable, "-c", client, *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.PIPE,
            text=True,
        )
        assert started.stdout is not None
        assert [started.stdout.readline() for _ in range(2)] == ["6\n", "12\n"]
        started.kill()
        started.communicate()
        assert (tmp_path / "left").read_text() == ""
        method = Fatal(left=str(tmp_path / "left"))
        options: dict[str, Any] = {"method": method, "chunk": CHUNK, "scheduler": address, "resume": True}
        done = pp.reconstruct_recording(skin, folder / "r.zarr", tmp_path / "t.zarr", **options)
    assert done.before == 12
    same(read_touch(tmp_path / "t.zarr"), plain)


def test_small_sensors_take_all_cores_unasked_where_it_pays(skin: pp.Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.archives.run.cores", lambda: 3)
    counted = [worker_count(skin, None, n) for n in (1, 99, 100, 10_000)]
    assert counted == [1, 1, 2, 3]
    assert worker_count(skin, pp.Tikhonov(), 10_000) == 1
    large = pp.Skin(skin.pad, pp.AreaArray(shape=(64, 64), pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    assert worker_count(large, None, 10_000) == 1
