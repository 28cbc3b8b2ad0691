"""A file format of another package: one class in one file, and one entry point."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate.cli import app
from palpate.recordings import Format, TopicMapping, read_recording, recorder, write_recording
from palpate.recordings.formats import endings, file_format, formats


class Words(Format):
    """A recording as one JSON object."""

    name = "words"
    extensions = (".words",)

    def recognises(self, path: Path) -> bool:
        return path.read_bytes().startswith(b'{"readings"')

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> pp.Recording:
        held = json.loads(path.read_text())
        return pp.Recording(readings=np.array(held["readings"]), channels=held["channels"], time=held["time"])

    def write(self, recording: pp.Recording, path: Path) -> None:
        held = {
            "readings": recording.readings.tolist(),
            "channels": recording.channels,
            "time": recording.time.tolist(),
        }
        path.write_text(json.dumps(held))


DATA = pp.Recording(readings=np.arange(12.0).reshape(2, 1, 6), channels=("stress_zz",), time=[0.0, 0.5])


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, target: str) -> None:
    """What pip leaves of a package with an entry point."""
    info = folder / "words-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: words\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[palpate.formats]\nwords = {target}\n")
    monkeypatch.syspath_prepend(str(folder))


@pytest.mark.long
def test_a_format_of_another_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.words"
    with pytest.raises(pp.InvalidInput, match=r"'\.words' is not known; accepted: \.nc, .*\.csv\b"):
        write_recording(DATA, path)
    install(tmp_path, monkeypatch, "test_formats_plug_in:Words")
    assert file_format(path) == "words"
    write_recording(DATA, path)
    np.testing.assert_array_equal(read_recording(path).readings, DATA.readings)
    # the command line, and the errors, know it too
    result = CliRunner().invoke(app, ["convert", str(path), str(tmp_path / "b.npz")])
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(read_recording(tmp_path / "b.npz").readings, DATA.readings)
    with pytest.raises(pp.InvalidInput, match=r"accepted: .*\.words"):
        read_recording(tmp_path / "c.what")
    with pytest.raises(
        pp.InvalidInput, match=r"a stream is recorded as \.nc, \.h5, \.hdf5, \.mcap, \.zarr; got '\.words'"
    ):
        recorder(tmp_path / "d.words", DATA.channels)
    path.rename(tmp_path / "a.json")
    with pytest.raises(pp.InvalidInput, match=r"looks like words: rename it to a\.words"):
        read_recording(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("target", "words"),
    [("no_such_module:Words", "cannot be loaded"), ("pathlib:Path", "does not derive from Format")],
)
def test_a_broken_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, target: str, words: str) -> None:
    install(tmp_path, monkeypatch, target)
    with pytest.raises(pp.InvalidInput, match=f"words.*{words}"):
        read_recording(tmp_path / "a.words")
    write_recording(DATA, tmp_path / "a.npz")  # and harms nobody else
    assert len(read_recording(tmp_path / "a.npz").time) == 2


def test_each_ending_belongs_to_one_format() -> None:
    assert len(set(endings())) == len(endings())
    assert {f.name for f in formats()} >= {"netcdf", "npz", "csv", "mcap", "zarr", "bag"}
    assert endings("recorder") == (".nc", ".h5", ".hdf5", ".mcap", ".zarr")
