"""Commands that are stopped, and disks that do not take a result: what is left, what is said, and the exit code."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.cli import main
from palpate.recordings import files, read_recording, write_recording
from palpate.recordings.recording import Recording
from skin_files import skin_text

SKIN = skin_text(16, noise="5 Pa")
COMMANDS = {
    "simulate": ["simulate", "--skin", "skin.toml", "--force", "20 N/m", "--overwrite", "--out"],
    "reconstruct": ["reconstruct", "r.nc", "--skin", "skin.toml", "--force", "--method", "tikhonov", "--out"],
    "track": ["track", "r.nc", "--skin", "skin.toml", "--force", "--out"],
    "convert": ["convert", "r.nc", "--force"],
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The working directory: a skin, a recording, and a result from before. The signals are ours again afterwards."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "skin.toml").write_text(SKIN)
    skin = pp.Skin.from_file("skin.toml")
    readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=20.0), rng=np.random.default_rng(0))
    write_recording(Recording(readings=np.stack([readings] * 3), channels=("stress_zz",)), "r.nc")
    for name in ("old.nc", "old.npz", "old.csv"):
        (tmp_path / name).write_text("old")
    before = signal.getsignal(signal.SIGTERM)
    yield tmp_path
    signal.signal(signal.SIGTERM, before)


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["palpate", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), *long_runs((signal.SIGTERM, 143))])
@pytest.mark.parametrize("command", list(COMMANDS))
@pytest.mark.long
def test_stopped_while_writing(
    command: str,
    number: int,
    code: int,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The signal comes when all is written and nothing is in place yet."""
    settle = files._settle

    def stopped(path: Path) -> None:
        settle(path)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(files, "_settle", stopped)
    before = sorted(os.listdir(folder))
    for name in ("old.nc", "old.npz") if command == "track" else ("old.nc",):
        assert run(*COMMANDS[command], name, monkeypatch=monkeypatch) == code
        said = capsys.readouterr().err
        assert said.startswith("error: stopped")
        assert len(said.strip().splitlines()) == 1
        assert (folder / name).read_text() == "old"
    assert sorted(os.listdir(folder)) == before


@pytest.mark.parametrize("command", list(COMMANDS))
@pytest.mark.parametrize("reason", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
@pytest.mark.long
def test_a_disk_that_does_not_take_it(
    command: str,
    reason: int,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def full(_: int) -> None:
        raise OSError(reason, os.strerror(reason))

    before = sorted(os.listdir(folder))
    monkeypatch.setattr(os, "fsync", full)
    assert run(*COMMANDS[command], "old.npz", monkeypatch=monkeypatch) == 1
    said = capsys.readouterr().err
    assert os.strerror(reason) in said
    assert "old.npz: writing failed" in said
    assert "what was there is kept" in said
    assert len(said.strip().splitlines()) == 1
    assert (folder / "old.npz").read_text() == "old"
    assert sorted(os.listdir(folder)) == before


@pytest.mark.long
def test_killed_while_writing(folder: Path) -> None:
    """Nothing can tidy up then, but what was there is whole, and so is the recording."""
    code = (
        "import os, sys\n"
        "from palpate.cli import main\n"
        "from palpate.recordings import files\n"
        "files._settle = lambda path: os.kill(os.getpid(), 9)\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *COMMANDS["convert"], "old.csv"], check=False, timeout=120)
    assert done.returncode == -signal.SIGKILL
    assert (folder / "old.csv").read_text() == "old"
    assert len(read_recording("r.nc").readings) == 3
    assert len([p for p in folder.glob(".palpate-*") if p.suffix != ".lock"]) == 1


@pytest.mark.long
def test_rows_of_a_table_are_kept_where_a_run_is_stopped(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside a result that was to be replaced, which stays."""
    from palpate.tracking.tracker import Tracker

    step, taken = Tracker.step, [0]

    def stopped(self: Tracker, *args: object, **options: object) -> pp.Touch:
        taken[0] += 1
        if taken[0] % 3 == 0:
            raise KeyboardInterrupt
        return step(self, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Tracker, "step", stopped)
    for name, kept in {"new.csv": "new.csv", "old.csv": "old.part.csv"}.items():
        assert run("track", "r.nc", "--skin", "skin.toml", "--force", "--out", name, monkeypatch=monkeypatch) == 130
        said = capsys.readouterr().err
        assert f"{kept} holds the 2 frames before." in said
        assert said.strip().endswith("error: stopped")
        assert len((folder / kept).read_text().splitlines()) == 1 + 2
    assert (folder / "old.csv").read_text() == "old"


def test_rows_so_far_are_written_while_frames_come(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a killed process leaves."""
    from palpate.cli import files as written
    from palpate.touch import Forces

    monkeypatch.setattr(written, "KEPT_EVERY", 0.0)
    monkeypatch.setattr(written, "KEPT_PART", float("inf"))
    touch = pp.Touch(np.ones((2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov")
    for name, kept in {"new.csv": "new.csv", "old.csv": "old.part.csv"}.items():
        forces = Forces()
        with written.rows_in_part_file(forces, folder / name) as keep:
            for frame in range(3):
                forces.add(touch)
                keep()
                assert len((folder / kept).read_text().splitlines()) == 1 + frame + 1
        assert len((folder / name).read_text().splitlines()) == 1 + 3
        assert not (folder / "old.part.csv").exists()  # the whole table came in its place


@pytest.mark.parametrize("name", ["new.csv", "new.nc", "new.npz", "old.csv"])
@pytest.mark.long
def test_frames_that_were_solved_are_kept(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in the third piece: the forces of the first two are in a table that reads, and what was there before stays."""
    import pandas

    from palpate.archives.numbers import Numbers

    add = Numbers.add

    def stopped(self: Numbers, start: int, numbers: dict[str, object]) -> None:
        if start == 2:
            os.kill(os.getpid(), signal.SIGINT)
        add(self, start, numbers)

    monkeypatch.setattr(Numbers, "add", stopped)
    before = (folder / name).read_text() if (folder / name).exists() else None
    command = ["reconstruct", "r.nc", "--skin", "skin.toml", "--force", "--method", "tikhonov", "--chunk", "1"]
    assert run(*command, "--out", name, monkeypatch=monkeypatch) == 130
    said = capsys.readouterr().err
    kept = f"{name[:3]}.part.csv"
    assert f"{kept} holds the forces of the first 2 of 3 frames." in said
    assert f"--out {name[:3]}.zarr --resume" in said
    table = pandas.read_csv(kept)
    assert len(table) == 2
    assert table["force_z (N/m)"].to_numpy() == pytest.approx(20.0, rel=0.05)
    assert ((folder / name).read_text() if (folder / name).exists() else None) == before
