"""One file has one writer: who comes second is refused, and deletes nothing that he did not make."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.recordings import Recording, read_recording, read_touch, recorder, write_recording
from palpate.recordings.files import in_place
from palpate.recordings.locks import sole_writer
from palpate.recordings.zarrstream import unfinished_path

for library in ("mcap", "rosbags", "zarr"):
    pytest.importorskip(library)

FRAME = np.ones((1, 2, 2))
PRESS = Recording(readings=np.stack([FRAME] * 3), channels=["stress_zz"])


@contextlib.contextmanager
def elsewhere(code: str, *arguments: str) -> Any:
    """Another process that runs ``code``, says "ready", and is then waited on by standard input."""
    child = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    try:
        assert child.stdout.readline() == "ready\n"
        yield child
    finally:
        child.kill()
        child.communicate()


RECORDING = """
import sys, numpy as np
from palpate.recordings import recorder
with recorder(sys.argv[1], ["stress_zz"]) as out:
    out.readings(0.0, np.ones((1, 2, 2)))
    print("ready", flush=True)
    sys.stdin.readline()
    out.readings(1.0, np.ones((1, 2, 2)))
"""
HOLDING = """
import sys
from palpate.recordings.locks import claim
claim(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
"""


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".mcap"])
@pytest.mark.long
def test_a_recording_under_way_is_not_taken_from_its_writer(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"r{suffix}"
    with elsewhere(RECORDING, str(path)) as child:
        with pytest.raises(pp.InvalidInput, match=r"exists|being written by another process"):
            recorder(path, ["stress_zz"])
        with pytest.raises(pp.InvalidInput, match=rf"being written by another process \({child.pid}\)|exists"):
            write_recording(PRESS, path)
        child.communicate("\n")
        assert child.returncode == 0
    assert read_recording(path).time.tolist() == [0.0, 1.0]
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".mcap"])
def test_who_loses_the_race_for_a_name_deletes_nothing(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both find the name free; the file appears before the second makes its own."""
    path = tmp_path / f"r{suffix}"
    write_recording(PRESS, path)
    monkeypatch.setattr(Path, "exists", lambda _: False)
    with pytest.raises(pp.InvalidInput, match="exists; a recording is not overwritten"):
        recorder(path, ["stress_zz"])
    monkeypatch.undo()
    np.testing.assert_array_equal(read_recording(path).readings, PRESS.readings)


@pytest.mark.long
def test_a_killed_writer_leaves_no_lock(tmp_path: Path) -> None:
    path = tmp_path / "r.nc"
    with elsewhere(HOLDING, str(path)) as child:
        with pytest.raises(pp.InvalidInput, match=rf"another process \({child.pid}\)"), sole_writer(path):
            pass
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    write_recording(PRESS, path)
    assert [p.name for p in tmp_path.iterdir()] == ["r.nc"]


@pytest.mark.long
def test_a_link_and_another_path_are_the_same_file(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "link.nc").symlink_to(tmp_path / "r.nc")
    with elsewhere(HOLDING, str(tmp_path / "r.nc")):
        for name in ("link.nc", "sub/../r.nc"):
            with pytest.raises(pp.InvalidInput, match="another process"):
                write_recording(PRESS, tmp_path / name)


@pytest.mark.long
def test_a_name_as_long_as_the_disk_takes_has_a_lock(tmp_path: Path) -> None:
    path = tmp_path / f"{'n' * 252}.nc"
    with elsewhere(HOLDING, str(path)), pytest.raises(pp.InvalidInput, match="another process"), sole_writer(path):
        pass


def _child(answer: Any, path: str) -> None:
    try:
        with sole_writer(path):
            answer.put("taken")
    except pp.InvalidInput as error:
        answer.put(str(error))


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_a_forked_child_has_none_of_its_parents_locks(tmp_path: Path) -> None:
    path = str(tmp_path / "r.nc")
    context = multiprocessing.get_context("fork")
    answer = context.Queue()
    with sole_writer(path):
        child = context.Process(target=_child, args=(answer, path))
        child.start()
        assert "another process" in answer.get(timeout=60)
        child.join()
        with in_place(path) as fresh:  # still this one's
            fresh.write_text("all")
    child = context.Process(target=_child, args=(answer, path))
    child.start()
    assert answer.get(timeout=60) == "taken"
    child.join()


def archive(folder: Path) -> tuple[pp.Skin, Path, Path]:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"]),
    )
    readings = np.linspace(0.1, 1.0, 8)[:, None, None] * skin.sense(
        pp.solutions.hertz_line(half_width=3e-3, force=10.0)
    )
    write_recording(Recording(readings=readings, channels=["stress_zz"]), folder / "r.nc")
    return skin, folder / "r.nc", folder / "touch.zarr"


@pytest.mark.parametrize("options", [{"resume": True}, {"overwrite": True}])
@pytest.mark.long
def test_a_run_that_is_under_way_is_not_gone_on_with(tmp_path: Path, options: dict[str, bool]) -> None:
    """Another process, and another thread of this one; the first run's store is whole in the end."""
    skin, recording, target = archive(tmp_path)
    said: list[str] = []

    def second(done: int, _: int) -> None:
        if done == 2:
            thread = threading.Thread(target=attempt)
            thread.start()
            thread.join()

    def attempt() -> None:
        try:
            pp.reconstruct_recording(skin, recording, target, method="tikhonov", chunk=2, **options)
        except pp.InvalidInput as error:
            said.append(str(error))

    pp.reconstruct_recording(skin, recording, target, method="tikhonov", chunk=2, progress=second, **options)
    assert len(said) == 1
    assert "is being written in this process already" in said[0]
    assert read_touch(target).force.shape == (8, 2)
    assert not unfinished_path(target).exists()
    with elsewhere(HOLDING, str(target)), pytest.raises(pp.InvalidInput, match="another process"):
        pp.reconstruct_recording(skin, recording, target, method="tikhonov", chunk=2, overwrite=True)
    assert read_touch(target).force.shape == (8, 2)


@pytest.mark.long
def test_a_command_is_refused_before_any_work_what_another_writes(tmp_path: Path) -> None:
    pytest.importorskip("typer")
    from command_line import run

    _, recording, target = archive(tmp_path)
    with elsewhere(HOLDING, str(target)) as child:
        done = run("convert", recording.name, target.name, "--force", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        f"error: touch.zarr is being written by another process ({child.pid}). Wait until that has ended, or give another name.\n"
    )
    assert run("convert", recording.name, target.name, cwd=tmp_path).returncode == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.nc", "touch.zarr"]
