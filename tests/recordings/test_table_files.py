"""Tables of other programs as they are: Parquet, NumPy's files, titles of several lines, an index, lines that belong to no marker."""

from __future__ import annotations

import io
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.errors import UncheckedInput
from palpate.recordings import TableMapping, read_recording

TIME = np.arange(5) / 50.0
COUNTS = np.arange(5 * 12, dtype=np.float64).reshape(5, 12)
XYZ = {f"stress_{axis}z": f"tactile[{i}::3]" for i, axis in enumerate("xyz")}


def frame(**more: Any) -> Any:
    pandas = pytest.importorskip("pandas")
    return pandas.DataFrame({"timestamp": TIME, "tactile": list(COUNTS), **more})


def parquet(table: Any, path: Path) -> Path:
    pytest.importorskip("pyarrow")
    table.to_parquet(path)
    return path


def test_every_third_number_of_a_parquet_list_is_a_channel(tmp_path: Path) -> None:
    path = parquet(frame(), tmp_path / "episode.parquet")
    mapping = TableMapping(time="timestamp", channels=XYZ, scale=-25.0, shape=(2, 2))
    read = read_recording(path, mapping=mapping)
    assert read.channels == ("stress_xz", "stress_yz", "stress_zz")
    np.testing.assert_array_equal(read.readings, -25.0 * np.moveaxis(COUNTS.reshape(5, 2, 2, 3), 3, 1))
    np.testing.assert_array_equal(read.time, TIME)


def test_one_episode_of_several_is_read_and_all_of_them_are_refused(tmp_path: Path) -> None:
    path = parquet(frame(episode_index=[0, 0, 1, 1, 1]), tmp_path / "episodes.parquet")
    channels = {"stress_zz": "tactile[:]"}
    with pytest.raises(pp.InvalidInput, match=r"holds 2 values, 0 to 1.*only=episode_index=0"):
        read_recording(path, mapping=TableMapping(time="timestamp", channels=channels, scale=1.0))
    read = read_recording(
        path, mapping=TableMapping(time="timestamp", channels=channels, scale=1.0, only="episode_index=1")
    )
    np.testing.assert_array_equal(read.readings[:, 0], COUNTS[2:])
    with pytest.raises(pp.InvalidInput, match=r"no line has episode_index=7; episode_index is 0, 1"):
        read_recording(
            path, mapping=TableMapping(time="timestamp", channels=channels, scale=1.0, only="episode_index=7")
        )


def test_the_command_line_reads_an_episode(tmp_path: Path) -> None:
    parquet(frame(episode_index=[0, 0, 1, 1, 1]), tmp_path / "e.parquet")
    mapping = "time=timestamp,stress_zz=tactile[:],unit=25Pa,only=episode_index=1"
    done = run("convert", "e.parquet", "e.nc", "--map", mapping, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(read_recording(tmp_path / "e.nc").readings[:, 0], 25.0 * COUNTS[2:])


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("tactile", r"tactile holds 12 numbers a line: name all of them as tactile\[:\]"),
        ("name[:]", r"no column is among name\[:\]"),
        ("ragged[:]", "ragged hold 1 to 2 numbers"),
        ("tactile[12:]", "no column is among"),
        ("tactile[::0]", "step of a slice"),
    ],
)
def test_columns_of_parquet_that_cannot_be_meant(tmp_path: Path, column: str, words: str) -> None:
    ragged = [np.ones(1 + (i > 2)) for i in range(5)]
    path = parquet(frame(name=list("abcde"), ragged=ragged), tmp_path / "t.parquet")
    with pytest.raises(pp.InvalidInput, match=words):
        read_recording(path, mapping=TableMapping(channels={"stress_zz": column}, scale=1.0, frame=None, rate=5.0))


def test_a_damaged_parquet_file_is_refused(tmp_path: Path) -> None:
    path = parquet(frame(), tmp_path / "t.parquet")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(pp.InvalidInput, match="cannot be read as Parquet"):
        read_recording(path, mapping=TableMapping(channels={"stress_zz": "tactile[:]"}, scale=1.0))
    with pytest.raises(pp.InvalidInput, match="say what these are with --map"):
        read_recording(parquet(frame(), tmp_path / "u.parquet"))


ARRAYS = {
    "frames x taxels": (COUNTS, {"stress_zz": "{}"}, None, COUNTS[:, None]),
    "time first": (np.column_stack([TIME, COUNTS]), {"stress_zz": "[1:]"}, "1", COUNTS[:, None]),
    "frames x taxels x axes": (
        COUNTS.reshape(5, 4, 3),
        {c: f"[{i}::3]" for i, c in enumerate(XYZ)},
        None,
        np.moveaxis(COUNTS.reshape(5, 4, 3), 2, 1),
    ),
}


@pytest.mark.parametrize("case", ARRAYS)
def test_an_array_of_numpy_is_a_table(tmp_path: Path, case: str) -> None:
    values, channels, time, expected = ARRAYS[case]
    np.save(tmp_path / "a.npy", values)
    mapping = TableMapping(channels=channels, time=time, scale=1.0, rate=None if time else 50.0)
    read = read_recording(tmp_path / "a.npy", mapping=mapping)
    np.testing.assert_array_equal(read.readings, expected)
    np.testing.assert_allclose(read.time, TIME)


def test_fields_and_archives_of_numpy_are_named_columns(tmp_path: Path) -> None:
    fields = np.zeros(5, dtype=[("t", "datetime64[ms]"), ("s", "i4", (12,))])
    fields["t"], fields["s"] = np.datetime64("2026-01-02T03:04:05") + np.arange(5) * np.timedelta64(20, "ms"), COUNTS
    np.save(tmp_path / "a.npy", fields)
    np.savez(tmp_path / "a.npz", t=TIME, s=COUNTS, note="a word", matrix=np.eye(3))
    for name in ("a.npy", "a.npz"):
        read = read_recording(
            tmp_path / name, mapping=TableMapping(time="t", channels={"stress_zz": "s[:]"}, scale=1.0)
        )
        np.testing.assert_array_equal(read.readings[:, 0], COUNTS)
        np.testing.assert_allclose(read.time - read.time[0], TIME, atol=1e-6)


class Harmful:
    def __reduce__(self) -> Any:
        return (exec, ("raise SystemExit('a pickle ran')",))


@pytest.mark.long
def test_nothing_in_a_pickle_is_run_and_the_remedy_works(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    mapping = TableMapping(time="t", channels={"stress_zz": "S{}"}, scale=1.0)
    with (tmp_path / "bad.pkl").open("wb") as file:
        pickle.dump(Harmful(), file)
    with pytest.raises(pp.InvalidInput, match="can run any program"):
        read_recording(tmp_path / "bad.pkl", mapping=mapping)
    np.save(tmp_path / "bad.npy", np.array([Harmful()], dtype=object), allow_pickle=True)
    with pytest.raises(pp.InvalidInput, match="can run any program"):
        read_recording(tmp_path / "bad.npy", mapping=mapping)
    np.savez(tmp_path / "bad.npz", s=np.array([Harmful()], dtype=object))
    with pytest.raises(pp.InvalidInput, match="can run any program"):
        read_recording(tmp_path / "bad.npz", mapping=mapping)

    pandas.DataFrame({"t": TIME, "S0": COUNTS[:, 0]}).to_pickle(tmp_path / "good.pkl")
    with pytest.raises(pp.InvalidInput) as refused:
        read_recording(tmp_path / "good.pkl", mapping=mapping)
    code = str(refused.value).split('python -c "')[1].rstrip('"')
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
    made = next(p for p in tmp_path.iterdir() if p.stem == "good" and p.suffix != ".pkl")
    np.testing.assert_array_equal(read_recording(made, mapping=mapping).readings[:, 0, 0], COUNTS[:, 0])


# -- titles ------------------------------------------------------------------------------------------------------------

S = {"stress_zz": "S{}"}
BODY = "0,1,2\n0.02,3,4\n"
TITLES: dict[str, tuple[str, dict[str, Any], list[list[float]]]] = {
    "units in a line of their own": ("t,S0,S1\nms,kPa,kPa\n0,1,2\n20,3,4\n", {}, [[1e3, 2e3], [3e3, 4e3]]),
    "units in brackets": ("t,S0,S1\n(s),(Pa),(Pa)\n" + BODY, {}, [[1, 2], [3, 4]]),
    "short and long names": ("t,S0,S1\nTime,Sensor,Sensor\n" + BODY, {"scale": 1.0}, [[1, 2], [3, 4]]),
    "text above": ("Recorder 2.1\nMay 3; upper hand\nt,S0,S1\n" + BODY, {"scale": 1.0}, [[1, 2], [3, 4]]),
    "text above tabs": ("Recorder 2.1\nt\tS0\tS1\n" + BODY.replace(",", "\t"), {"scale": 1.0}, [[1, 2], [3, 4]]),
    "merged cells": (
        "t,Finger 1,,\n,S0,S1,note\n0,1,2,a\n0.02,3,4,b\n",
        {"channels": {"stress_zz": "Finger 1_S{}"}, "scale": 1.0},
        [[1, 2], [3, 4]],
    ),
    "an index without a title": (",t,S0,S1\n0,0,1,2\n1,0.02,3,4\n", {"scale": 1.0}, [[1, 2], [3, 4]]),
    "an index of times": (",S0,S1\n" + BODY, {"time": "index", "scale": 1.0}, [[1, 2], [3, 4]]),
    "columns without names": (",0,1,2\n0,0,1,2\n1,.02,3,4\n", {"time": "0", "channels": {"stress_zz": "[2:]"}, "scale": 1.0}, [[1, 2], [3, 4]]),
    "a printed data frame": ("      t  S0  S1\n0  0.00   1   2\n1  0.02   3   4\n", {"scale": 1.0}, [[1, 2], [3, 4]]),
    "a first frame that is missing": ("t,S0,S1\n0,,nan\n0.02,3,4\n", {"scale": 1.0}, [[np.nan, np.nan], [3, 4]]),
}  # fmt: skip


@pytest.mark.parametrize("case", TITLES)
def test_titles_as_programs_write_them(tmp_path: Path, case: str) -> None:
    text, more, expected = TITLES[case]
    (tmp_path / "t.csv").write_text(text)
    read = read_recording(tmp_path / "t.csv", mapping=TableMapping(**{"time": "t", "channels": S, **more}))
    np.testing.assert_array_equal(read.readings[:, 0], expected)
    np.testing.assert_allclose(read.time, [0.0, 0.02])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,S0,S1\n0,1,2\n0.02,3\n0.04,5,6\n", "line 3: 2 values for 3 columns"),
        ("n,t,S0\na,0,1\nb,0.02\nc,0.04,3\n", "line 3: 2 values for 3 columns"),
        ("t S0\n0 1 2\n5 3 4\n", "3 values for 2 columns"),
    ],
)
def test_torn_lines_are_no_titles(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(pp.InvalidInput, match=words):
        read_recording(tmp_path / "t.csv", mapping=TableMapping(time="t", channels=S, scale=1.0))


# -- markers -----------------------------------------------------------------------------------------------------------

SPOTS = """LABEL,ID,TRACK_ID,POSITION_X,POSITION_Y,FRAME,VISIBILITY
Label,Spot ID,Track ID,X,Y,Frame,Visibility
,,,(pixel),(pixel),,
"""


def spots(ids: dict[tuple[int, int], str]) -> str:
    out = io.StringIO()
    out.write(SPOTS)
    for t in range(3):
        for k in range(4):
            x, y = 10.0 * (k % 2) + 0.5 * t, 10.0 * (k // 2)
            out.write(f"ID{t}{k},{t}{k},{ids.get((t, k), str(7 + k))},{x},{y},{t},1\n")
    return out.getvalue()


@pytest.mark.parametrize("loose", ["", "-1"])
def test_spots_that_no_track_holds_are_left_out_with_a_word(tmp_path: Path, loose: str) -> None:
    mapping = TableMapping(frame="FRAME", marker="TRACK_ID", x="POSITION_X", y="POSITION_Y", position_scale=1e-4)
    (tmp_path / "all.csv").write_text(spots({}))
    whole = read_recording(tmp_path / "all.csv", mapping=mapping)
    np.testing.assert_allclose(whole.readings[:, 0], 5e-5 * np.arange(3)[:, None] * np.ones(4), atol=1e-12)
    (tmp_path / "some.csv").write_text(spots({(1, 0): loose, (1, 2): loose}))
    with pytest.warns(UncheckedInput, match="2 of 12 lines belong to no marker"):
        some = read_recording(tmp_path / "some.csv", mapping=mapping)
    expected = whole.readings.copy()
    expected[1][:, [0, 2]] = np.nan
    np.testing.assert_allclose(some.readings, expected, atol=1e-12)


def test_a_row_and_a_column_name_a_marker(tmp_path: Path) -> None:
    lines = [
        f"{t},{r},{c},{100 * t + 10 * r + c}"
        for t in range(2)
        for c in (3, 2, 1)
        for r in (0, 1)
        if (t, r, c) != (1, 1, 2)
    ]
    (tmp_path / "t.csv").write_text("frame,row,col,F (Pa)\n" + "\n".join(lines) + "\n")
    mapping = TableMapping(frame="frame", marker=["row", "col"], channels={"stress_zz": "F"}, shape=(2, 3))
    read = read_recording(tmp_path / "t.csv", mapping=mapping)
    np.testing.assert_array_equal(
        read.readings[:, 0], [[[1, 2, 3], [11, 12, 13]], [[101, 102, 103], [111, np.nan, 113]]]
    )
    some = [line for line in lines if not line.startswith(("0,1,2", "1,1,2"))]
    (tmp_path / "t.csv").write_text("frame,row,col,F (Pa)\n" + "\n".join(some) + "\n")
    with pytest.raises(pp.InvalidInput, match="5 markers do not fill the 2 x 3 places of row and col"):
        read_recording(tmp_path / "t.csv", mapping=mapping)


def test_an_archive_with_the_keys_that_are_documented_is_a_recording(tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", readings=COUNTS.reshape(5, 1, 3, 4), channel=["stress_zz"], time=TIME)
    read = read_recording(tmp_path / "r.npz")
    assert read.channels == ("stress_zz",)
    np.testing.assert_array_equal(read.readings, COUNTS.reshape(5, 1, 3, 4))
    done = run("convert", "r.npz", "r.nc", "--map", "stress_zz=readings[:],unit=1Pa", cwd=tmp_path)
    assert "names its columns itself" in done.stderr
    np.savez(tmp_path / "r.npz", frames=COUNTS, t=TIME)
    with pytest.raises(pp.InvalidInput, match=r"lacks readings, channel, time \(it holds frames \(5, 12\), t \(5,\)\)"):
        read_recording(tmp_path / "r.npz")
