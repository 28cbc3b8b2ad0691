"""Damaged files: refused with a sentence, never a traceback, a hang or numbers that were not written."""

from __future__ import annotations

import importlib.util
import json
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.recordings import read_recording, read_skin, read_table, read_touch, write_recording
from skin_files import skin_text

for library in ("mcap", "rosbags", "foxglove", "zarr"):
    pytest.importorskip(library)


def _load() -> Any:
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "fuzz.py"
    spec = importlib.util.spec_from_file_location("fuzz", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    return module


fuzz = _load()
DATA = pp.Recording(
    readings=np.random.default_rng(0).standard_normal((5, 2, 3, 4)),
    channels=("stress_xz", "stress_zz"),
    time=[0.0, 0.01, 0.05, 0.06, 0.09],
    meta={"sensor": "left finger"},
)

FOREIGN = "time (s),stress_zz[0] (Pa),stress_zz[1] (Pa)\n0,0.5,0.25\n1,0.75,0.0123"
SKIN = skin_text(4, 6, depth="1.5 mm")


@pytest.mark.parametrize("name", ["csv", "npz", "nc", "csv of others", "table csv", "skin.toml"])
def test_a_few_damaged_files_of_each_kind(name: str) -> None:
    report = fuzz.fuzz(fuzz.READERS[name], 16)
    assert not report.failures
    assert report.outcomes["refused"] > 0


@pytest.fixture(scope="module")
def child() -> Iterator[Any]:
    """The process that reads, which a crash or a hang ends instead of the tests."""
    one = fuzz.Child(patience=300.0)
    yield one
    one.close()


@pytest.mark.long
@pytest.mark.parametrize("name", list(fuzz.READERS))
def test_more_damaged_files(name: str, child: Any) -> None:
    """Thousands of files: ``python benchmarks/fuzz.py``."""
    report = fuzz.fuzz(fuzz.READERS[name], 24, child=child)
    assert sum(report.outcomes.values()) == 24
    assert not report.failures


@pytest.mark.parametrize("ending", [".nc", ".npz", ".csv", *long_runs(".zarr", ".mcap")])
def test_every_flipped_byte_of_the_numbers_is_found(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{ending}"
    write_recording(DATA, path)
    good = read_recording(path)
    parts = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    rng = np.random.default_rng(1)
    refused = 0
    for _ in range(60):
        part = parts[int(rng.integers(len(parts)))]
        whole = part.read_bytes()
        bad = bytearray(whole)
        bad[int(rng.integers(len(bad)))] ^= 1 << int(rng.integers(8))
        part.write_bytes(bad)
        try:
            found = read_recording(path)
        except pp.InvalidInput:
            refused += 1
        else:
            np.testing.assert_array_equal(found.readings, good.readings)
            np.testing.assert_array_equal(found.time, good.time)
            assert found.channels == good.channels
        part.write_bytes(whole)
    assert refused > 10


def test_a_csv_cut_inside_its_last_number(tmp_path: Path) -> None:
    write_recording(DATA, tmp_path / "own.csv")
    whole = (tmp_path / "own.csv").read_text()
    end = whole.index("# palpate_crc32")
    for text, words in (
        (whole[: end - 4], "truncated"),
        (whole[:end], "truncated"),
        (whole[:-3], "checksum"),
        (whole.replace("\n0.01,", "\n0.011,"), "checksum"),
    ):
        (tmp_path / "own.csv").write_text(text)
        with pytest.raises(pp.InvalidInput, match=words):
            read_recording(tmp_path / "own.csv")
    # what is whole can be had; and what was edited on purpose, without the checksum and the first line
    (tmp_path / "own.csv").write_text(whole[: end - 4])
    assert len(read_recording(tmp_path / "own.csv", salvage=True).time) == 4
    (tmp_path / "own.csv").write_text(whole[whole.index("\n") + 1 : end])
    np.testing.assert_array_equal(read_recording(tmp_path / "own.csv").readings, DATA.readings)


def test_line_ends_do_not_matter_to_the_checksum(tmp_path: Path) -> None:
    write_recording(DATA, tmp_path / "a.csv")
    (tmp_path / "a.csv").write_bytes((tmp_path / "a.csv").read_bytes().replace(b"\r\n", b"\n"))
    np.testing.assert_array_equal(read_recording(tmp_path / "a.csv").readings, DATA.readings)


def test_a_foreign_csv_whose_last_line_is_not_ended(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(FOREIGN)
    with pytest.warns(UserWarning, match=r"no line break.*'0\.0123'"):
        assert read_recording(path).readings[1, 0, 1] == 0.0123
    path.write_text(FOREIGN + "\n")
    assert read_recording(path).readings[1, 0, 1] == 0.0123
    path.write_text(FOREIGN[: FOREIGN.rindex(",")])
    with pytest.warns(UserWarning, match="no line break"), pytest.raises(pp.InvalidInput, match="2 values for 3"):
        read_recording(path)
    (tmp_path / "t.csv").write_text("x,y,u\n1,2,3\n4,5,6")
    with pytest.warns(UserWarning, match="no line break"):
        read_table(tmp_path / "t.csv", columns=["x", "y", "u"], channels=["displacement_x"])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0]", "[;]", "is not like"),
        ("[0]", "[9999999999999]", "is not like"),
        ("[0]", "[9999999]", "do not fill"),
        ("0.25", "1_0", "'1_0' is not a number"),
        ("0.25", "٣", "is not a number"),
        ("0.25", "inf", "'inf' is not a number"),
        ("0.25", "1e400", "larger"),
        ("0.25", "\x00", "cannot be read as csv"),
        ("0.25", "0" * 140_000, "checks out"),
        ("0.25", "x" * 140_000, "is not a number"),
        ("0.25", '"' + "x" * 140_000 + '"', "cannot be read as CSV"),
        ("time", "# positions (m): [[1, 2], [3]]\ntime", "line 1: positions must be a list"),
        ("time", '# positions (m): {"a": 1}\ntime', "line 1: positions must be a list"),
        ("time", "# positions (m): " + "[" * 1500 + "\ntime", "line 1: positions must be a list"),
        ("time", "# meta: " + "[" * 1500 + "\ntime", "meta cannot be read"),
        (",", ";", "is not like"),
    ],
)
def test_cells_and_comments_that_cannot_be_meant(old: str, new: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(FOREIGN.replace(old, new) + "\n", encoding="utf-8")
    if words == "checks out":
        assert read_recording(path).readings[0, 0, 1] == 0.0
        return
    with pytest.raises(pp.InvalidInput, match=words):
        read_recording(path)


def test_a_skin_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    """Windows' Notepad writes one; what is kept beside a result is without it, and the files that the skin names are known."""
    from palpate.cli.files import skin_files
    from palpate.cli.files import skin_text as kept
    from palpate.recordings import read_columns

    text = skin_text(9) + '[columns]\ntime = "t"\nstress_zz = "S{}"\nunit = "1 Pa"\n'
    plain, marked = tmp_path / "plain.toml", tmp_path / "marked.toml"
    plain.write_text(text, encoding="utf-8")
    marked.write_text(text, encoding="utf-8-sig", newline="\r\n")
    assert pp.Skin.from_file(marked).planes[0].shape == pp.Skin.from_file(plain).planes[0].shape == (9,)
    assert read_columns(marked) == read_columns(plain)
    assert kept(marked) == kept(plain) == text
    marked.write_text('[[plane]]\npositions_file = "places.nc"\n', encoding="utf-8-sig")
    assert skin_files(marked) == [marked, tmp_path / "places.nc"]


@pytest.mark.parametrize("command", ["reconstruct", "track", "simulate", "weigh", "live"])
def test_a_skin_file_in_another_encoding_is_refused_by_name(tmp_path: Path, command: str) -> None:
    pytest.importorskip("typer")
    from command_line import run

    (tmp_path / "skin.toml").write_bytes(skin_text(9).encode() + "# \N{MICRO SIGN}".encode("latin-1"))
    pp.recordings.write_recording(pp.Recording(readings=np.zeros((2, 1, 9)), channels=["stress_zz"]), tmp_path / "r.nc")
    (tmp_path / "v.mp4").write_bytes(b"not looked at")
    arguments = {
        "simulate": ["simulate", "--skin", "skin.toml", "--force", "1 N/m", "--size", "2 mm", "--out", "s.nc"],
        "weigh": ["weigh", "v.mp4", "--skin", "skin.toml", "--force", "1 N"],
        "live": ["live", "r.nc", "--skin", "skin.toml", "--record", "l.nc"],
    }.get(command, [command, "r.nc", "--skin", "skin.toml"])
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "error: skin.toml: cannot be read as text in UTF-8 (invalid start byte); save it in UTF-8.\n"


def test_text_in_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes((FOREIGN + "\n").encode("utf-8-sig"))
    assert read_recording(path).readings.shape == (2, 1, 2)
    path.write_bytes((FOREIGN + "\n").encode("utf-16"))
    with pytest.raises(pp.InvalidInput, match=r"UTF-8|cannot be read as csv"):
        read_recording(path)


def _bomb_npz(path: Path) -> None:
    write_recording(DATA, path)
    with zipfile.ZipFile(path) as archive:
        held = {n: archive.read(n) for n in archive.namelist()}
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 1, 1), }"
    held["readings.npy"] = b"\x93NUMPY\x01\x00" + (128 - 10).to_bytes(2, "little") + header.ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in held.items():
            archive.writestr(name, data)


def _bomb_nc(path: Path) -> None:
    import h5py

    write_recording(DATA, path)
    with h5py.File(path, "r+") as file:
        del file["readings"]
        file.create_dataset("readings", shape=(5, 10**6, 10**6), dtype="f8", chunks=(1, 1000, 1000))


def _bomb_zarr(path: Path) -> None:
    write_recording(DATA, path)
    about = json.loads((path / "readings" / "zarr.json").read_text())
    about["shape"] = [5, 10**6, 10**6, 4]
    (path / "readings" / "zarr.json").write_text(json.dumps(about))


@pytest.mark.parametrize(("ending", "make"), [(".npz", _bomb_npz), (".nc", _bomb_nc), (".zarr", _bomb_zarr)])
def test_headers_that_claim_what_nobody_has(ending: str, make: Any, tmp_path: Path) -> None:
    make(tmp_path / f"a{ending}")
    with pytest.raises(pp.InvalidInput, match="claim"):
        read_recording(tmp_path / f"a{ending}")


def test_a_missing_block_is_not_zero(tmp_path: Path) -> None:
    write_recording(DATA, tmp_path / "a.zarr")
    block = next(p for p in (tmp_path / "a.zarr" / "readings").rglob("*") if p.is_file() and p.name != "zarr.json")
    block.unlink()
    with pytest.raises(pp.InvalidInput, match=r"a\.zarr"):
        read_recording(tmp_path / "a.zarr")


def test_a_name_that_does_not_fit_what_is_inside(tmp_path: Path) -> None:
    write_recording(DATA, tmp_path / "a.npz")
    (tmp_path / "b.nc").write_bytes((tmp_path / "a.npz").read_bytes())
    with pytest.raises(pp.InvalidInput, match=r"looks like npz: rename it to b\.npz"):
        read_recording(tmp_path / "b.nc")
    (tmp_path / "b.data").write_bytes((tmp_path / "a.npz").read_bytes())
    with pytest.raises(pp.InvalidInput, match=r"'\.data' is not known; accepted: \.nc.*rename it to b\.npz"):
        read_recording(tmp_path / "b.data")
    with pytest.raises(pp.InvalidInput, match=r"read back as \.nc"):
        read_touch(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "change",
    [
        ("shape = [4, 6]", "shape = [4, [6]]"),
        ("shape = [4, 6]", "shape = {a = 1}"),
        ('pitch = "1 mm"', 'pitch = ["1 mm", ["2 mm"]]'),
        ('pitch = "1 mm"', 'pitch = {x = "1 mm"}'),
        ('pitch = "1 mm"', 'pitch = "1e-300 m"'),
        ('depth = "1.5 mm"', 'depth = [["1 mm"]]'),
        ('"stress_zz"', '["stress_zz"]'),
        ("[[plane]]", 'center = [["1 mm"]]\n[[plane]]'),
        ("channels", 'center = [["1 mm"], "2 mm"]\nchannels'),
        ("channels", 'center = {x = "1 mm"}\nchannels'),
        ("channels", "noise = [[1]]\nchannels"),
        ("shape = [4, 6]", "shape = " + "[" * 1500),
        ("0.48", "9" * 5000),
        ("[4, 6]", "[" + "9" * 400 + ", 6]"),
        ('"area"', '"scattered"\npositions_file = "."'),
    ],
    ids=range(15),
)
def test_skin_files_that_cannot_be_meant(change: tuple[str, str], tmp_path: Path) -> None:
    (tmp_path / "skin.toml").write_text(SKIN.replace(*change, 1))
    with pytest.raises(pp.PalpateError):
        read_skin(tmp_path / "skin.toml")
