"""Tables of other programs: frames x markers, whatever they look like; what may be meant in two ways is refused."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.errors import UncheckedInput
from palpate.recordings import TableMapping, read_columns, read_recording
from palpate.recordings.columns import columns_of, columns_of_text

PLACES = np.array([(40.0 * c, 30.0 * r) for r in range(3) for c in range(4)]) + 17.0  # pixels
PIXEL = 0.05e-3
U = np.random.default_rng(3).uniform(-6.0, 6.0, (5, len(PLACES), 2)).round(3)
U[0] = 0.0
CHANNELS = {"displacement_x": "dx", "displacement_y": "dy"}
LONG = TableMapping(
    frame="frame", marker="id", x="x", y="y", channels=CHANNELS, scale=PIXEL, position_scale=PIXEL, rate=50.0
)


def rows(*, places: str = "rest", start: int = 0) -> list[list[float]]:
    """(frame, id, x, y, dx, dy) of each marker in each frame."""
    at = np.broadcast_to(PLACES, U.shape) + (U if places == "now" else 0.0)
    return [
        [start + t, m + 1, *at[t, m].round(3).tolist(), *U[t, m].tolist()]
        for t in range(len(U))
        for m in range(len(PLACES))
    ]


def text(
    lines: list[list[Any]], *, titles: str = "frame,id,x,y,dx,dy", separator: str = ",", comma: bool = False
) -> str:
    def cell(v: Any) -> str:
        shown = v if isinstance(v, str) else f"{v:.10g}"
        return shown.replace(".", ",") if comma else shown

    body = [separator.join(map(cell, line)) for line in lines]
    return "\n".join([titles.replace(",", separator), *body] if titles else body) + "\n"


def read(
    folder: Path, content: str, mapping: TableMapping = LONG, name: str = "t.csv", encoding: str = "utf-8"
) -> pp.Recording:
    (folder / name).write_text(content, encoding=encoding)
    return read_recording(folder / name, mapping=mapping)


def check(recording: pp.Recording, *, first: float = 0.0) -> None:
    assert recording.channels == ("displacement_x", "displacement_y")
    np.testing.assert_allclose(recording.readings, PIXEL * U.transpose(0, 2, 1), atol=1e-12)
    np.testing.assert_allclose(recording.positions, PIXEL * PLACES, atol=1e-9)
    np.testing.assert_allclose(recording.time, first + np.arange(len(U)) / 50.0, atol=1e-12)


SHUFFLED = [rows(start=120)[i] for i in np.random.default_rng(1).permutation(len(rows()))]
NOW = TableMapping(frame="frame", marker="id", x="x", y="y", position_scale=PIXEL, rate=50.0)
SAME: dict[str, tuple[str, TableMapping, str, float]] = {
    "plain": (text(rows()), LONG, "t.csv", 0.0),
    "tabs": (text(rows(), separator="\t"), LONG, "t.tsv", 0.0),
    "semicolons and decimal commas": (text(rows(), separator=";", comma=True), LONG, "t.csv", 0.0),
    "a spreadsheet's first line": ("sep=;\n" + text(rows(), separator=";"), LONG, "t.csv", 0.0),
    "blanks": (text(rows(), separator="   "), LONG, "t.txt", 0.0),
    "separators at the end of lines": (text(rows()).replace("\n", ",\n"), LONG, "t.csv", 0.0),
    "not in order, frames from 120": (text(SHUFFLED), LONG, "t.csv", 2.4),
    "positions now": (text(rows(places="now")), LONG, "t.csv", 0.0),
    "positions alone": (text(rows(places="now")), NOW, "t.csv", 0.0),
    "comment with titles": ("# " + text(rows(), separator=" "), LONG, "t.dat", 0.0),
    "no titles": (
        text(rows(), titles="", separator=" "),
        TableMapping(
            frame="1",
            marker="2",
            x="3",
            y="4",
            channels={"displacement_x": "5", "displacement_y": "6"},
            scale=PIXEL,
            position_scale=PIXEL,
            rate=50.0,
        ),
        "t.txt",
        0.0,
    ),
    **{
        name: (
            text(
                [[*r[:2], r[2] * 0.05, r[3] * 0.05, r[4] * 50.0, r[5] * 50.0] for r in rows()],
                titles=f"frame,id,x (mm),y [mm],dx ({one}m),dy ({other}m)",
            ),
            TableMapping(frame="frame", marker="id", x="x", y="y", channels=CHANNELS, rate=50.0),
            "t.csv",
            0.0,
        )
        for name, one, other in (
            ("units in the titles", "u", "u"),
            ("both letters for micro in the titles", "\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"),
        )
    },
    "no numbers of markers": (
        text(rows()),
        TableMapping(frame="frame", x="x", y="y", channels=CHANNELS, scale=PIXEL, position_scale=PIXEL, rate=50.0),
        "t.csv",
        0.0,
    ),
    "times": (
        text([[20.0 * r[0], *r[1:]] for r in rows()]),
        TableMapping(
            time="frame",
            time_scale=1e-3,
            marker="id",
            x="x",
            y="y",
            channels=CHANNELS,
            scale=PIXEL,
            position_scale=PIXEL,
        ),
        "t.csv",
        0.0,
    ),
    "wide": (
        text(
            [[t, *PLACES.ravel(), *U[t].ravel()] for t in range(len(U))],
            titles=",".join(
                ["frame", *(f"{a}{m}" for m in range(12) for a in "xy"), *(f"d{a}{m}" for m in range(12) for a in "xy")]
            ),
        ),
        TableMapping(
            frame="frame",
            x="x{}",
            y="y{}",
            channels={"displacement_x": "dx{}", "displacement_y": "dy{}"},
            scale=PIXEL,
            position_scale=PIXEL,
            rate=50.0,
        ),
        "t.csv",
        0.0,
    ),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_recording(tmp_path: Path, case: str) -> None:
    content, mapping, name, first = SAME[case]
    check(read(tmp_path, content, mapping, name), first=first)


def without(lines: list[list[Any]], frame: int, marker: int) -> list[list[Any]]:
    return [r for r in lines if (r[0], r[1]) != (frame, marker)]


def test_markers_that_are_lost_in_a_frame_are_missing_there(tmp_path: Path) -> None:
    lines = without(without(rows(places="now"), 2, 5), 3, 1)
    lines[3][2:] = ["nan", "", "NA", "NaN"]  # frame 0, marker 4
    recording = read(tmp_path, text(lines))
    gone = np.isnan(recording.readings).any(axis=1)
    assert [tuple(map(int, at)) for at in np.argwhere(gone)] == [(0, 3), (2, 4), (3, 0)]
    assert "3 of 60 missing" in recording.meta["table"]
    np.testing.assert_allclose(recording.positions, PIXEL * PLACES, atol=1e-9)
    with pytest.warns(UncheckedInput, match="1 of 12 markers have no position .* left out: 4"):
        assert read(tmp_path, text(lines), NOW).readings.shape == (5, 2, 11)
    empty = [r for r in rows() if r[0] != 2]  # a frame that was dropped
    np.testing.assert_allclose(read(tmp_path, text(empty)).time, [0.0, 0.02, 0.06, 0.08])


def test_wide_tables_of_any_titles(tmp_path: Path) -> None:
    content = "t (ms);cell_1;cell_2;cell_10;note\n0;0;10;0;a\n20;-4;12,5;;b\n"
    recording = read(
        tmp_path, content, TableMapping(time="t", channels={"stress_zz": ["cell_2", "cell_1"]}, scale=25.0)
    )
    assert recording.readings.tolist() == [[[250.0, 0.0]], [[312.5, -100.0]]]
    assert recording.time.tolist() == [0.0, 0.02]
    with pytest.raises(pp.InvalidInput, match="marker 3 is missing between 1 and 10"):
        read(tmp_path, content, TableMapping(time="t", channels={"stress_zz": "cell_{}"}, scale=25.0))
    grid = text([[0, *range(6)]], titles="n,a5,a4,a3,a2,a1,a0")
    area = read(tmp_path, grid, TableMapping(frame="n", channels={"stress_zz": "a{}"}, scale=1.0, shape=(2, 3)))
    assert area.readings[0, 0].tolist() == [[5, 4, 3], [2, 1, 0]]


def test_taxels_of_an_area_by_their_places(tmp_path: Path) -> None:
    lines = [[t, x, y, 100 * t + 10 * y + x] for t in (0, 1) for y in (1, 0) for x in (2, 0, 1)]
    mapping = TableMapping(
        frame="n", x="x", y="y", channels={"stress_zz": "p"}, scale=1.0, position_scale=1e-3, shape=(2, 3)
    )
    area = read(tmp_path, text(lines, titles="n,x,y,p"), mapping)
    assert area.positions is None
    assert area.readings[1, 0].tolist() == [[100, 101, 102], [110, 111, 112]]
    bent = [[t, x + 0.3 * y * (x > 0), y, p] for t, x, y, p in lines]
    with pytest.raises(pp.InvalidInput, match="are no grid of 2 x 3"):
        read(tmp_path, text(bent, titles="n,x,y,p"), mapping)


def twice(lines: list[list[Any]]) -> list[list[Any]]:
    return [*lines, lines[20]]


def renumbered(lines: list[list[Any]]) -> list[list[Any]]:
    return [[r[0], r[1] if r[0] < 3 else 13 - r[1], *r[2:]] for r in lines]


def anew(lines: list[list[Any]]) -> list[list[Any]]:
    return [[r[0], i, *r[2:]] for i, r in enumerate(lines)]


def moved_onto(lines: list[list[Any]]) -> list[list[Any]]:
    return [[*r[:2], *((57.0, 17.0) if r[1] == 1 else r[2:4]), *r[4:]] for r in lines]


def steps(lines: list[list[Any]]) -> list[list[Any]]:
    before = np.diff(U, axis=0, prepend=0.0)
    return [[*r[:4], *before[r[0], r[1] - 1].tolist()] for r in lines]


ONE = TableMapping(x="x", y="y", channels=CHANNELS, scale=PIXEL, position_scale=PIXEL)
NAMELESS = TableMapping(frame="frame", x="x", y="y", channels=CHANNELS, scale=PIXEL, position_scale=PIXEL)
REFUSED: dict[str, tuple[str, TableMapping, str]] = {
    "several frames as one": (text(rows()), ONE, "column 'frame' holds 5 different values.*frame=frame"),
    "several frames as one, unnamed": (
        text([r[1:] for r in rows()], titles="id,x,y,dx,dy"),
        ONE,
        "lines 2 and 14: one place is there twice.*frame column",
    ),
    "a line twice": (text(twice(rows())), LONG, "lines 22 and 62: marker 9 is twice in frame 1"),
    "two markers in one place": (text(moved_onto(rows())), LONG, "markers 1 and 2 are at the same place"),
    "renumbered from frame 3 on": (text(renumbered(rows())), LONG, "renumbered from some frame on"),
    "renumbered, positions alone": (text(renumbered(rows(places="now"))), NOW, "have passed their neighbours"),
    "numbered anew in every frame": (text(anew(rows())), LONG, "60 markers in 5 frames of at most 12"),
    "moving without numbers": (text(rows(places="now")), NAMELESS, "markers move, and no column numbers them"),
    "displacements from frame to frame": (text(steps(rows(places="now"))), LONG, "counted from frame to frame"),
    "no unit": (text(rows()), TableMapping(frame="frame", marker="id", x="x", y="y", channels=CHANNELS), "pixel = "),
    "two units": (
        text(rows(), titles="frame,id,x,y,dx (mm),dy"),
        LONG,
        "title 'dx \\(mm\\)' says mm, but a 1 is said to be 5e-05 m",
    ),
    "decimal commas between commas": (text(rows(), comma=True), LONG, "line 14: 8 values for 6 columns.*commas stand for the decimal point too"),
    "thousands": ("a;b\n0;1,234\n1;2,345\n", TableMapping(frame="a", channels={"stress_zz": ["b"]}, scale=1.0), "decimal or a thousand"),
    "points and commas": ("a;b\n0;1,23\n1;2.3\n", TableMapping(frame="a", channels={"stress_zz": ["b"]}, scale=1.0), "the decimal separator is not clear"),
    "a torn line": (text(rows()) + "5,1,17\n", LONG, "line 62: 3 values for 6 columns"),
    "words": (text(rows()) + "5,1,17,17,none,0\n", LONG, "line 62: 'none' is not a number"),
    "a frame that is no number": (text(rows()) + ",1,17,17,0,0\n", LONG, "line 62: frame must be a whole number"),
    "seconds as frames": (text([[0.02 * r[0], *r[1:]] for r in rows()]), LONG, "A column of seconds is named time"),
    "titles alone": ("frame,id,x,y,dx,dy\n", LONG, "no lines of numbers"),
    "no such column": (text(rows(), titles="frame,id,X,y,dx,dy"), LONG, "no column x; it has frame, id, X"),
    "a column twice": (text(rows(), titles="frame,id,x,x,y,dx"), LONG, "column x is there 2 times"),
    "UTF-16": (text(rows()), LONG, "save it as CSV in UTF-8"),
    "nothing whole": (text([[*r[:2], "", *r[3:]] for r in rows()]), LONG, "no marker has a whole reading"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused(tmp_path: Path, case: str) -> None:
    content, mapping, words = REFUSED[case]
    with pytest.raises(pp.InvalidInput, match=f"(?s){words}"):
        read(tmp_path, content, mapping, encoding="utf-16" if case == "UTF-16" else "utf-8")


def test_what_the_refusal_of_steps_advises_works(tmp_path: Path) -> None:
    check(read(tmp_path, text(steps(rows(places="now"))), NOW))


def test_a_marker_that_is_mistaken_in_one_frame_is_said(tmp_path: Path) -> None:
    lines = [[*r[:2], r[2] + 90.0 * ((r[0], r[1]) == (3, 6)), *r[3:]] for r in rows(places="now")]
    with pytest.warns(UncheckedInput, match="first: marker 6 in frame 3"):
        read(tmp_path, text(lines), NOW)


@pytest.mark.long
def test_every_text_is_read_or_refused(tmp_path: Path) -> None:
    """Whatever a byte becomes: a recording or InvalidInput."""
    whole, rng = text(rows(places="now")), np.random.default_rng(7)
    for _ in range(60):
        at = int(rng.integers(len(whole)))
        new = "0123456789,;.\n\t -+eE\"'#%xn\x00"[int(rng.integers(27))] if rng.random() < 0.8 else ""
        broken = whole[:at] + new + whole[at + 1 :]
        for mapping in (LONG, NOW):
            with warnings.catch_warnings(), contextlib.suppress(pp.InvalidInput):
                warnings.simplefilter("ignore", UncheckedInput)
                assert read(tmp_path, broken, mapping).readings.shape[1] == 2


def test_a_table_without_a_mapping_says_how(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(text(rows(), titles="frame,particle,x,y,dx,dy"))
    (tmp_path / "t.txt").write_text(text(rows(), titles=""))
    with pytest.raises(pp.InvalidInput, match='--map "frame=frame,marker=particle,x=x,y=y,displacement_x=dx') as error:
        read_recording(tmp_path / "t.csv")
    advised = str(error.value).split('"')[3]  # and what it advises is read
    assert read_recording(tmp_path / "t.csv", mapping=columns_of(columns_of_text(advised))).readings.shape == (5, 2, 12)
    with pytest.raises(pp.InvalidInput, match="6 columns without titles: name them by their numbers 1, 2"):
        read_recording(tmp_path / "t.txt")


WRONG: dict[str, Callable[[], Any]] = {
    "not known": lambda: TableMapping(channels={"stress_ww": "a"}),
    "no such channel": lambda: TableMapping(x="x"),
    "no column of readings": lambda: TableMapping(frame="a"),
    "y is named without x": lambda: TableMapping(y="y", channels=CHANNELS),
    "either one line per frame": lambda: TableMapping(x="x", y="y{}", channels=CHANNELS),
    "marker belongs to": lambda: TableMapping(marker="m", channels={"stress_zz": "a{}"}),
    "scale must be": lambda: TableMapping(channels=CHANNELS, scale=[1.0, 0.0]),
    "rate must be a positive": lambda: TableMapping(channels=CHANNELS, rate=0.0),
    "rate and time both": lambda: TableMapping(channels=CHANNELS, rate=2.0, time="t"),
    "reference is for tables of positions": lambda: TableMapping(channels=CHANNELS, reference=3),
    "neither a channel nor a key": lambda: columns_of({"dx": "dx"}),
    "leave out unit": lambda: columns_of({"displacement_x": "a", "pixel": "1 mm", "unit": "mm"}),
    "pixel is for displacement": lambda: columns_of({"stress_zz": "a", "pixel": "1 mm"}),
    "accepted for a pressure": lambda: columns_of({"stress_zz": "a", "unit": "1 mm"}),
    "twice": lambda: columns_of_text("x=a,x=b"),
    "must be like frame=frame": lambda: columns_of_text("x"),
    "rate must be a number": lambda: columns_of_text("x=a,rate=fast"),
}


@pytest.mark.parametrize("words", WRONG)
def test_a_mapping_that_cannot_be_meant(words: str) -> None:
    expected = (
        "no such channel" if words == "not known" else "no column of readings" if words == "no such channel" else words
    )
    with pytest.raises(pp.InvalidInput, match=expected):
        WRONG[words]()


def test_the_words_of_the_command_line() -> None:
    mapping = columns_of(
        columns_of_text("x=X,y=Y,frame=n,pixel=0.06mm,0.05mm,displacement_y=dy,displacement_x=dx,rate=30")
    )
    assert mapping.position_scale == pytest.approx((0.06e-3, 0.05e-3))
    assert dict(zip(mapping.channels, mapping.scale)) == pytest.approx(  # type: ignore[arg-type]
        {"displacement_x": 0.06e-3, "displacement_y": 0.05e-3}
    )
    wide = columns_of(columns_of_text("time=t,stress_zz=A,B,C,unit=-25 Pa,shape=1x3,time_unit=ms"))
    assert (wide.channels, wide.scale, wide.shape, wide.time_scale) == (
        {"stress_zz": ["A", "B", "C"]},
        (-25.0,),
        (1, 3),
        1e-3,
    )


SKIN = """
[pad]
kind = "bonded_layers"

[[pad.layer]]
thickness = "4 mm"
youngs_modulus = "300 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"
depth = "1 mm"
channels = ["displacement_x", "displacement_y", "displacement_z"]
noise = "2 um"

[surface]
shape = [7, 8]
spacing = "1 mm"
"""
COLUMNS = """
[columns]
frame = "frame"
marker = "id"
displacement_z = "dz"
displacement_x = "dx"
displacement_y = "dy"
x = "x"
y = "y"
unit = "1 um"
position_unit = "mm"
rate = 20
"""


def pressed(folder: Path) -> np.ndarray[Any, Any]:
    """A table of a press, markers in any order; the readings (frame, channel, marker)."""
    at = np.array([(1.5 * c, 1.5 * r) for r in range(-2, 2) for c in range(-2, 3)]) * 1e-3
    (folder / "gel.toml").write_text(SKIN)
    skin = pp.Skin.from_file(
        folder / "gel.toml",
        recording=pp.Recording(
            readings=np.zeros((1, 3, len(at))),
            channels=("displacement_x", "displacement_y", "displacement_z"),
            positions=at,
        ),
    )
    ball = skin.sample(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.2))
    rng = np.random.default_rng(5)
    readings = np.stack([skin.sense(k * ball, rng=rng) for k in (0.0, 0.6, 1.0)]).round(9)
    lines = [
        [100 + t, 7 + m, *(1e3 * at[m]).tolist(), *(1e6 * readings[t, :, m]).tolist()]
        for t in range(3)
        for m in range(len(at))
    ]
    rng.shuffle(lines)
    (folder / "table.csv").write_text(text(lines, titles="frame,id,x,y,dx,dy,dz"))
    return readings


SAID = "frame=frame,marker=id,x=x,y=y,displacement_x=dx,displacement_y=dy,displacement_z=dz,unit=um,position_unit=mm,rate=20"


def succeed(folder: Path, *arguments: str) -> None:
    done = run(*arguments, cwd=folder)
    assert done.returncode == 0, done.stderr


def test_convert_reads_a_table_by_columns_and_by_map(tmp_path: Path) -> None:
    readings = pressed(tmp_path)
    (tmp_path / "mapped.toml").write_text(SKIN + COLUMNS)
    succeed(tmp_path, "convert", "table.csv", "a.npz", "--map", SAID)
    succeed(tmp_path, "convert", "table.csv", "b.npz", "--skin", "mapped.toml")
    one, two = (read_recording(tmp_path / f"{n}.npz") for n in "ab")
    np.testing.assert_allclose(one.readings, readings, atol=1e-12)
    np.testing.assert_array_equal(one.readings, two.readings)
    assert one.time.tolist() == two.time.tolist() == [5.0, 5.05, 5.1]
    mapping = read_columns(tmp_path / "mapped.toml")
    assert mapping is not None
    assert list(mapping.channels) == ["displacement_x", "displacement_y", "displacement_z"]


@pytest.mark.long
def test_from_the_table_to_newtons(tmp_path: Path) -> None:
    """reconstruct and track read the table as if it were a recording."""
    pressed(tmp_path)
    (tmp_path / "mapped.toml").write_text(SKIN + COLUMNS)
    succeed(tmp_path, "reconstruct", "table.csv", "--skin", "gel.toml", "--map", SAID, "--out", "t.npz")
    succeed(tmp_path, "track", "table.csv", "--skin", "mapped.toml", "--out", "v.npz")
    for name, within in (("t", 0.1), ("v", 0.15)):
        assert abs(np.load(tmp_path / f"{name}.npz")["force"][2, 2] - 1.0) < within


@pytest.mark.long
def test_what_the_command_line_refuses(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text(text([[*r, 0.0] for r in rows()], titles="frame,id,x,y,dx,dy,dz"))
    (tmp_path / "gel.toml").write_text(SKIN)
    said = (
        "frame=frame,marker=id,x=x,y=y,displacement_x=dx,displacement_y=dy,displacement_z=dz,unit=um,position_unit=mm"
    )
    assert run("convert", "table.csv", "own.csv", "--map", said, cwd=tmp_path).returncode == 0
    assert run("convert", "table.csv", "places.nc", "--map", said, cwd=tmp_path).returncode == 0
    shifted = text([[*r[:2], r[2] + 3.0, *r[3:], 0.0] for r in rows()], titles="frame,id,x,y,dx,dy,dz")
    (tmp_path / "shifted.csv").write_text(shifted)
    fixed = SKIN.replace('kind = "scattered"', 'kind = "scattered"\npositions_file = "places.nc"')
    (tmp_path / "fixed.toml").write_text(fixed)
    for arguments, words in {
        ("track", "own.csv", "--skin", "gel.toml", "--map", said): "names its columns itself",
        ("track", "places.nc", "--skin", "gel.toml", "--map", said): "names the columns of a table (.npz, .csv, .txt",
        ("track", "table.csv", "--skin", "gel.toml"): "--map",
        ("track", "table.csv", "--skin", "gel.toml", "--map", "dx=dx"): "neither a channel nor a key",
        (
            "reconstruct",
            "shifted.csv",
            "--skin",
            "fixed.toml",
            "--map",
            said,
        ): "lies 3 mm from where the positions_file",
        ("convert", "table.csv", "new.nc", "--map", said, "--pixel", "1 mm"): "only --grid and --force can be given",
        ("convert", "table.csv", "new.nc", "--skin", "gel.toml"): "no section [columns]",
        ("track", "table.csv", "--skin", "gel.toml", "--map", said, "--out", "t.txt"): "a result is written as .nc",
        ("live", "--demo", "--map", said): "--map describes a RECORDING",
    }.items():
        done = run(*arguments, cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert words in done.stderr
    lost = [[*r, 0.0] for r in rows() if (r[0], r[1]) not in {(t, 3 * t + k) for t in range(5) for k in (1, 2, 3)}]
    (tmp_path / "lost.csv").write_text(text(lost, titles="frame,id,x,y,dx,dy,dz"))
    refused = run("reconstruct", "lost.csv", "--skin", "gel.toml", "--map", said, "--drop-missing", cwd=tmp_path)
    assert "palpate track uses the readings that each frame has" in refused.stderr
