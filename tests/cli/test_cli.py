from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from command_line import process, run, smaller_demo
from palpate.recordings import read_recording, read_touch, write_recording
from palpate.recordings.recording import Recording
from palpate.skin import Skin
from skin_files import SHEAR, skin_text

SKIN = skin_text(7, 8, channels=SHEAR, pitch="1.8 mm", noise="100 Pa")
LINE_SKIN = (
    SKIN.replace('kind = "area"', 'kind = "line"')
    .replace("shape = [7, 8]", "count = 20")
    .replace("1.8 mm", "1.4 mm")
    .replace('["stress_xz", "stress_yz", "stress_zz"]', '["stress_zz"]')
    .replace('"100 Pa"', '"5 Pa"')
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two skins and a recording of each."""
    path = tmp_path_factory.mktemp("cli")
    (path / "skin.toml").write_text(SKIN)
    (path / "line.toml").write_text(LINE_SKIN)
    for skin, force, frames in (("skin", "0.4 N", "2"), ("line", "20 N/m", "1")):
        out = run(
            "simulate",
            "--skin",
            f"{skin}.toml",
            "--out",
            f"{skin}.nc",
            "--force",
            force,
            "--size",
            "2 mm",
            "--friction",
            "0.3",
            "--frames",
            frames,
            cwd=path,
        )
        assert out.returncode == 0, out.stderr
    (path / "out").mkdir()
    (path / "folder.nc").mkdir()
    (path / "cut.nc").write_bytes((path / "skin.nc").read_bytes()[:3000])
    (path / "empty.csv").write_text("")
    (path / "table.csv").write_text("x,y,u,v\n1,2,0.1,0.1\n3,5,0.1,0.1\n")
    (path / "words.csv").write_text("x,y,u,v\n1,2,0.1,0.1\n3,5,much,0.1\n")
    recording = read_recording(path / "skin.nc")
    write_recording(Recording(readings=recording.readings * 1e9, channels=recording.channels), path / "huge.nc")
    write_recording(Recording(readings=recording.readings + np.nan, channels=recording.channels), path / "nan.nc")
    return path


def test_help_teaches(tmp_path: Path) -> None:
    out = run("--help", cwd=tmp_path)
    assert out.returncode == 0
    for command in ("demo", "simulate", "reconstruct", "convert", "pad", "paper"):
        assert command in out.stdout
        one = run(command, "--help", cwd=tmp_path)
        assert one.returncode == 0
        assert "Usage" in one.stdout
    assert run("--version", cwd=tmp_path).stdout.startswith("palpate ")


@pytest.mark.long
def test_a_process_of_its_own(folder: Path, tmp_path: Path) -> None:
    """What the other tests call inside their own process, started as a user starts it: a result, an error."""
    arguments = ("reconstruct", str(folder / "line.nc"), "--skin", str(folder / "line.toml"), "--parameter", "1e-4")
    done, failed = (process(*arguments, "--out", name, cwd=tmp_path) for name in ("t.nc", "t.xyz"))
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    assert done.stdout.replace("t.nc", "") == run(*arguments, "--out", "u.nc", cwd=tmp_path).stdout.replace("u.nc", "")
    np.testing.assert_array_equal(read_touch(tmp_path / "t.nc")["force"], read_touch(tmp_path / "u.nc")["force"])
    assert failed.returncode == 2
    assert failed.stderr == run(*arguments, "--out", "t.xyz", cwd=tmp_path).stderr


@pytest.mark.long
def test_simulate_and_reconstruct(folder: Path, tmp_path: Path) -> None:
    out = run(
        "reconstruct",
        "skin.nc",
        "--skin",
        "skin.toml",
        "--out",
        str(tmp_path / "touch.nc"),
        "--plot",
        str(tmp_path / "a.png"),
        "--friction",
        "0.6",
        cwd=folder,
    )
    assert out.returncode == 0, out.stderr
    assert "slip margin" in out.stdout
    data = read_touch(tmp_path / "touch.nc")
    np.testing.assert_allclose(data["force"].values[:, 2], [0.2, 0.4], rtol=0.05)
    np.testing.assert_allclose(data["force"].values[:, 0], [0.06, 0.12], atol=0.005)
    assert data.attrs["skin"] == SKIN
    assert "reconstruct" in data.attrs["command"]
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    "options",
    [
        ["--method", "hilgers"],
        ["--method", "truncated"],
        ["--method", "dft"],
        ["--method", "linear"],
        ["--order", "2", "--parameter", "gcv"],
        ["--parameter", "1e-8", "--components", "x,z"],
    ],
)
@pytest.mark.long
def test_methods(options: list[str], folder: Path, tmp_path: Path) -> None:
    out = run("reconstruct", "skin.nc", "--skin", "skin.toml", "--out", str(tmp_path / "t.npz"), *options, cwd=folder)
    assert out.returncode == 0, out.stderr


@pytest.mark.parametrize("recording", ["skin", "line"])
def test_every_frame_is_solved_once(recording: str, folder: Path, tmp_path: Path) -> None:
    solved = []

    def reconstruct(self: Skin, readings: Any, **options: Any) -> Any:
        solved.append(len(readings))
        return whole(self, readings, **options)

    whole = Skin.reconstruct
    with mock.patch.object(Skin, "reconstruct", reconstruct):
        arguments = (f"{recording}.nc", "--skin", f"{recording}.toml", "--out", str(tmp_path / "t.npz"))
        assert run("reconstruct", *arguments, "--method", "dft", cwd=folder).returncode == 0
    assert sum(solved) == len(read_recording(folder / f"{recording}.nc").readings)


@pytest.mark.long
def test_constant_friction(folder: Path, tmp_path: Path) -> None:
    out = run(
        "reconstruct",
        "line.nc",
        "--skin",
        "line.toml",
        "--method",
        "constant_friction",
        "--friction",
        "0.3",
        "--out",
        str(tmp_path / "t.csv"),
        cwd=folder,
    )
    assert out.returncode == 0, out.stderr


def test_a_run_can_be_made_again(folder: Path, tmp_path: Path) -> None:
    """The result holds the skin and the command; the same seed gives the same recording."""
    again = tmp_path / "again.nc"
    out = run(
        "simulate",
        "--skin",
        "skin.toml",
        "--out",
        str(again),
        "--force",
        "0.4 N",
        "--size",
        "2 mm",
        "--friction",
        "0.3",
        "--frames",
        "2",
        cwd=folder,
    )
    assert out.returncode == 0
    np.testing.assert_array_equal(read_recording(again).readings, read_recording(folder / "skin.nc").readings)


@pytest.mark.long
def test_convert(folder: Path, tmp_path: Path) -> None:
    for name in ("a.csv", "b.npz", "c.h5"):
        assert run("convert", "skin.nc", str(tmp_path / name), cwd=folder).returncode == 0
        np.testing.assert_array_equal(
            read_recording(tmp_path / name).readings, read_recording(folder / "skin.nc").readings
        )


@pytest.mark.long
def test_missing_readings(folder: Path, tmp_path: Path) -> None:
    recording = read_recording(folder / "skin.nc")
    readings = recording.readings.copy()
    readings[1, 0, 3, 4] = np.nan
    write_recording(Recording(readings=readings, channels=recording.channels), tmp_path / "gap.nc")
    with mock.patch.object(Skin, "reconstruct", side_effect=AssertionError("said before any frame is solved")):
        out = run("reconstruct", str(tmp_path / "gap.nc"), "--skin", "skin.toml", cwd=folder)
    assert out.returncode == 2
    assert "1 of 56 taxels" in out.stderr
    out = run(
        "reconstruct",
        str(tmp_path / "gap.nc"),
        "--skin",
        "skin.toml",
        "--drop-missing",
        "--parameter",
        "1e-8",
        cwd=folder,
    )
    assert out.returncode == 0
    assert "left out 1 of 56" in out.stderr


@pytest.mark.long
def test_two_planes_and_line(tmp_path: Path) -> None:
    plane = LINE_SKIN[LINE_SKIN.index("[[plane]]") :]
    (tmp_path / "skin.toml").write_text(LINE_SKIN + plane.replace("1.2 mm", "2.4 mm"))
    options = ["--force", "20 N/m", "--friction", "0.3", "--size", "3 mm"]
    out = run("simulate", "--skin", "skin.toml", "--out", "r.nc", *options, cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    out = run("reconstruct", "r.nc", "--skin", "skin.toml", "--friction", "0.5", "--plot", "p.svg", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    force = read_touch(tmp_path / "r-touch.nc")["force"].values[0]
    assert force[1] == pytest.approx(20.0, rel=0.05)
    assert 2.0 < force[0] < 7.0  # s_zz does not feel a uniform shear, at any depth, and the note says so
    assert "the net force of shear along x follows from the finite width" in out.stdout
    assert "slip margin" in out.stdout


@pytest.mark.long
def test_scattered(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    positions = rng.uniform(-7e-3, 7e-3, (150, 2))
    names = ("stress_xz", "stress_yz", "stress_zz")
    recording = Recording(readings=np.zeros((1, 3, 150)), channels=names, positions=positions)
    write_recording(recording, tmp_path / "where.nc")
    text = SKIN.replace('"area"', '"scattered"').replace("shape = [7, 8]\n", 'positions_file = "where.nc"\n')
    (tmp_path / "skin.toml").write_text(text.replace('pitch = "1.8 mm"\n', ""))
    out = run("simulate", "--skin", "skin.toml", "--out", "r.nc", "--force", "0.2 N", "--size", "2 mm", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    np.testing.assert_allclose(read_recording(tmp_path / "r.nc").positions, positions)
    out = run("reconstruct", "r.nc", "--skin", "skin.toml", "--out", "t.npz", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    with np.load(tmp_path / "t.npz") as data:
        assert data["force"][0, 2] == pytest.approx(0.2, rel=0.05)


@pytest.mark.long
def test_pad(tmp_path: Path) -> None:
    (tmp_path / "skin.toml").write_text(LAYERED_SKIN)
    out = run("pad", "skin.toml", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    assert "taken for a half-space" in out.stdout
    assert (tmp_path / "palpate-pad.png").read_bytes()[:4] == b"\x89PNG"
    # data of the layered pad through the same commands
    out = run("simulate", "--skin", "skin.toml", "--out", "r.nc", "--force", "0.2 N", "--size", "2 mm", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    out = run("reconstruct", "r.nc", "--skin", "skin.toml", "--out", "t.npz", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    with np.load(tmp_path / "t.npz") as data:
        assert data["force"][0, 2] == pytest.approx(0.2, rel=0.15)


@pytest.mark.long
def test_creep(tmp_path: Path) -> None:
    text = LINE_SKIN.replace("poissons_ratio = 0.48", 'poissons_ratio = 0.48\nprony = [[0.2, "0.5 s"], [0.1, "10 s"]]')
    (tmp_path / "skin.toml").write_text(text.replace("stress_zz", "displacement_z").replace('"5 Pa"', '"10 nm"'))
    options = ["--force", "20 N/m", "--size", "3 mm", "--frames", "8", "--rate", "2"]
    out = run("simulate", "--skin", "skin.toml", "--out", "r.nc", *options, cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    out = run("reconstruct", "r.nc", "--skin", "skin.toml", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    data = read_touch(tmp_path / "r-touch.nc")
    peak = data["traction"].values[:, 1].max(axis=1)
    np.testing.assert_allclose(peak / peak[-1], (np.arange(8) + 1) / 8, atol=0.05)
    np.testing.assert_allclose(data["time"].values, np.arange(8) / 2)


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.long)], ids=["8 x 8", "as it is"])
def test_demo(whole: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not whole:
        smaller_demo(monkeypatch)
    out = run("demo", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    for word in ("net force", "peak pressure", "slip margin"):
        assert word in out.stdout
    assert sorted(os.listdir(tmp_path / "palpate-demo")) == [
        ".palpate-demo.sha256",
        "recording.nc",
        "skin.toml",
        "touch.nc",
        "touch.png",
    ]
    again = run(
        "reconstruct",
        "palpate-demo/recording.nc",
        "--skin",
        "palpate-demo/skin.toml",
        "--parameter",
        "1e-8",
        "--force",
        cwd=tmp_path,
    )
    assert again.returncode == 0


@pytest.mark.long
def test_paper(tmp_path: Path) -> None:
    out = run("paper", "--out", "report", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    names = set(os.listdir(tmp_path / "report"))
    assert {f"figure-{n:02d}.png" for n in range(1, 23)} <= names
    assert {f"figure-{n:02d}.csv" for n in range(2, 23) if n != 8} <= names
    assert {f"ours-{n}.{e}" for n in "ABC" for e in ("png", "csv")} <= names
    tables = ("errors", "friction", "claims", "noise", "truncation", "speed", "profile-readings", "friction-readings")
    assert {"report.html", *(f"{n}.csv" for n in tables)} <= names
    text = (tmp_path / "report" / "report.html").read_text()
    assert "4.04e-05" in text
    assert "http://" not in text
    assert "https://" not in text


# -- bad input: one line, exit code 2, no traceback, nothing half-written ----------------------------------------------

R = ["reconstruct", "skin.nc", "--out", "OUT/t.nc", "--skin"]
S = ["simulate", "--out", "OUT/r.nc", "--skin", "skin.toml"]
C = ["convert"]


def edited(old: str, new: str) -> str:
    assert old in SKIN
    return SKIN.replace(old, new)


LAYERS = """\
[pad]
kind = "bonded_layers"

[[pad.layer]]
thickness = "1 mm"
youngs_modulus = "1 MPa"
poissons_ratio = 0.5

[[pad.layer]]
thickness = "2 mm"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

"""
LAYERED_SKIN = LAYERS + SKIN[SKIN.index("[[plane]]") :].replace('"1.2 mm"', '"base"')


def layered(old: str, new: str) -> str:
    assert old in LAYERED_SKIN
    return LAYERED_SKIN.replace(old, new)


BAD: dict[str, tuple[list[str], str | None, str]] = {
    # name: (arguments, text of bad.toml, what the message must say)
    "unknown command": (["press"], None, "press"),
    "live of nothing": (["live"], None, "--demo"),
    "live of two": (["live", "skin.nc", "--demo"], None, "either"),
    "live without a skin": (["live", "skin.nc"], None, "--skin"),
    "live from two ports": (["live", "--udp", "9000", "--tcp", "9001", "--skin", "skin.toml"], None, "either"),
    "live from a port without a skin": (["live", "--udp", "9000"], None, "--skin"),
    "live demo with a skin": (["live", "--demo", "--skin", "skin.toml"], None, "its own skin"),
    "live at no speed": (["live", "--demo", "--speed", "0"], None, "--speed"),
    "live to no folder": (["live", "--demo", "--record-to", "nowhere"], None, "no such folder"),
    "track with a force in kPa": (
        ["track", "skin.nc", "--skin", "skin.toml", "--max-force", "3 kPa"],
        None,
        "--max-force",
    ),
    "track into a folder": (["track", "skin.nc", "--skin", "skin.toml", "--out", "folder.nc"], None, "folder"),
    "track on no friction": (["track", "skin.nc", "--skin", "skin.toml", "--friction", "0"], None, "friction"),
    "topic of a table": (["convert", "skin.nc", "out.nc", "--topic", "/finger"], None, ".mcap"),
    "fields of no topic": (["convert", "none.mcap", "out.nc", "--fields", "x,y"], None, "give --topic too"),
    "shape of three": (["convert", "none.mcap", "out.nc", "--topic", "/a", "--shape", "4x4x4"], None, "--shape"),
    "scale in words": (["convert", "none.mcap", "out.nc", "--topic", "/a", "--scale", "big"], None, "--scale"),
    "mcap missing": (["convert", "none.mcap", "out.nc"], None, "no such file"),
    "unknown option": ([*R, "skin.toml", "--methd", "dft"], None, "methd"),
    "no skin given": (["reconstruct", "skin.nc"], None, "--skin"),
    "recording does not exist": (["reconstruct", "none.nc", "--skin", "skin.toml"], None, "no such file"),
    "recording is a folder": (["reconstruct", "folder.nc", "--skin", "skin.toml"], None, "folder"),
    "recording of unknown kind": (["reconstruct", "skin.toml", "--skin", "skin.toml"], None, "ending '.toml'"),
    "recording truncated": (["reconstruct", "cut.nc", "--skin", "skin.toml"], None, "truncated"),
    "recording empty": (["reconstruct", "empty.csv", "--skin", "skin.toml"], None, "empty"),
    "skin does not exist": ([*R, "none.toml"], None, "no such file"),
    "skin is not TOML": ([*R, "bad.toml"], "[pad\n", "line 1"),
    "skin is binary": ([*R, "cut.nc"], None, "text"),
    "skin lacks the pad": ([*R, "bad.toml"], SKIN[SKIN.index("[[plane]]") :], "no [pad]"),
    "skin lacks the modulus": (
        [*R, "bad.toml"],
        edited('youngs_modulus = "200 kPa"\n', ""),
        "line 1: [pad] has no youngs_modulus",
    ),
    "modulus without unit": ([*R, "bad.toml"], edited('"200 kPa"', "200"), "line 3: youngs_modulus = 200 has no unit"),
    "modulus in millimetres": ([*R, "bad.toml"], edited('"200 kPa"', '"200 mm"'), "line 3"),
    "negative modulus": ([*R, "bad.toml"], edited('"200 kPa"', '"-200 kPa"'), "line 3: youngs_modulus must be"),
    "Poisson's ratio of 0.6": ([*R, "bad.toml"], edited("0.48", "0.6"), "line 4: poissons_ratio"),
    "misspelt key": ([*R, "bad.toml"], edited("pitch", "pich"), "line 9: pich is not a key"),
    "pitch missing": ([*R, "bad.toml"], edited('pitch = "1.8 mm"\n', ""), "pitch is missing"),
    "pitch in kPa": ([*R, "bad.toml"], edited('"1.8 mm"', '"1 kPa"'), "line 9: pitch has the unit 'kPa'"),
    "negative depth": ([*R, "bad.toml"], edited('"1.2 mm"', '"-1.2 mm"'), "line 10: depth"),
    "unknown channel": ([*R, "bad.toml"], edited("stress_yz", "stress_yx"), "line 11: channel"),
    "unknown kind of plane": ([*R, "bad.toml"], edited('"area"', '"ring"'), "line 7: kind"),
    "key of another kind": (
        [*R, "bad.toml"],
        edited("shape = [7, 8]", "shape = [7, 8]\ncount = 4"),
        "line 9: count does not belong",
    ),
    "noise in the wrong unit": ([*R, "bad.toml"], edited('"100 Pa"', '"5 mm"'), "line 12: noise"),
    "layer without thickness": (
        [*R, "bad.toml"],
        layered('thickness = "2 mm"\n', ""),
        "line 9: [pad.layer] has no thickness",
    ),
    "layer in kPa": (
        [*R, "bad.toml"],
        layered('thickness = "2 mm"', 'thickness = "2 kPa"'),
        "line 10: thickness has the unit",
    ),
    "layer of no thickness": (
        [*R, "bad.toml"],
        layered('thickness = "2 mm"', 'thickness = "0 mm"'),
        "line 10: thickness must",
    ),
    "layer too compressible": ([*R, "bad.toml"], layered("0.48", "0.8"), "line 12: poissons_ratio"),
    "pad of no kind": ([*R, "bad.toml"], layered("bonded_layers", "sponge"), "line 2: "),
    "creep without a unit": ([*R, "bad.toml"], edited("= 0.48", "= 0.48\nprony = [[0.2, 0.5]]"), "line 5: "),
    "creep of the whole modulus": ([*R, "bad.toml"], edited("= 0.48", '= 0.48\nprony = [[1.2, "1 s"]]'), "less than 1"),
    "taxels below the base": ([*R, "bad.toml"], layered('"base"', '"5 mm"'), "below the rigid base"),
    "base of a half-space": ([*R, "bad.toml"], edited('"1.2 mm"', '"base"'), "has none"),
    "other array shape": ([*R, "bad.toml"], edited("[7, 8]", "[8, 8]"), "7x8 taxels"),
    "other channels": ([*R, "line.toml"], None, "the skin describes stress_zz"),
    "readings off by 1e9": (["reconstruct", "huge.nc", "--skin", "skin.toml"], None, "units"),
    "readings with NaN": (["reconstruct", "nan.nc", "--skin", "skin.toml"], None, "not finite"),
    "unknown method": ([*R, "skin.toml", "--method", "magic"], None, "method must be one of"),
    "option of another method": ([*R, "skin.toml", "--method", "dft", "--order", "1"], None, "does not take order"),
    "unknown rule": ([*R, "skin.toml", "--parameter", "best"], None, "evidence, gcv"),
    "negative parameter": ([*R, "skin.toml", "--parameter", "-1"], None, "positive"),
    "unknown component": ([*R, "skin.toml", "--components", "w"], None, "components"),
    "what cannot be seen": (
        ["reconstruct", "line.nc", "--skin", "line.toml", "--components", "x,z", "--method", "tikhonov"],
        None,
        "cannot be told apart",
    ),
    "order of 3": ([*R, "skin.toml", "--order", "3"], None, "order must be"),
    "order not a number": ([*R, "skin.toml", "--order", "two"], None, "order must be 0, 1 or 2; got 'two'"),
    "frame out of range": ([*R, "skin.toml", "--frame", "7"], None, "frame 7"),
    "result of unknown kind": (["reconstruct", "skin.nc", "--skin", "skin.toml", "--out", "OUT/t.xyz"], None, ".xyz"),
    "result in no folder": (
        ["reconstruct", "skin.nc", "--skin", "skin.toml", "--out", "OUT/none/t.nc"],
        None,
        "does not exist",
    ),
    "picture of unknown kind": ([*R, "skin.toml", "--plot", "OUT/a.xyz"], None, "pictures end in"),
    "friction of zero": ([*R, "skin.toml", "--friction", "0"], None, "friction"),
    "friction on an area": ([*R, "skin.toml", "--method", "constant_friction", "--friction", "0.3"], None, "LineArray"),
    "force without unit": ([*S, "--force", "2"], None, "unit"),
    "force of a line on an area": ([*S, "--force", "2 N/m"], None, "N/m"),
    "negative size": ([*S, "--size", "-1 mm"], None, "positive"),
    "no frames": ([*S, "--frames", "0"], None, "frames"),
    "drag above 1": ([*S, "--friction", "0.5", "--drag", "2"], None, "drag"),
    "contact of no kind": ([*S, "--contact", "cone"], None, "cone"),
    "partial slip of a punch": ([*S, "--contact", "punch", "--friction", "0.5", "--drag", "0.5"], None, "hertz"),
    "foreign table without units": ([*C, "table.csv", "OUT/t.nc", "--columns", "x,y,u,v"], None, "no units"),
    "foreign table, no such column": (
        [*C, "table.csv", "OUT/t.nc", "--columns", "x,y,u,w", "--pixel", "1 um"],
        None,
        "no column w",
    ),
    "foreign table, text in it": (
        [*C, "words.csv", "OUT/t.nc", "--columns", "x,y,u,v", "--pixel", "1 um"],
        None,
        "line 3",
    ),
    "grid of a gridded recording": ([*C, "skin.nc", "OUT/t.nc", "--grid", "1 mm"], None, "scattered"),
    "convert to no known kind": ([*C, "skin.nc", "OUT/t.mp4"], None, ".mp4"),
    "picture of a pad of unknown kind": (["pad", "skin.toml", "--plot", "OUT/a.doc"], None, "pictures end in"),
    "demo into a file": (["demo", "--out", "skin.nc"], None, "is a file"),
    "paper into a file": (["paper", "--out", "skin.nc"], None, "is a file"),
}


def contents(folder: Path) -> dict[Path, int]:
    """What lies in a folder, and when each file was written; a folder's own time also tells of locks that came and went."""
    return {p: p.stat().st_mtime_ns if p.is_file() else 0 for p in folder.rglob("*")}


@pytest.mark.parametrize("name", list(BAD))
@pytest.mark.long
def test_bad_input(name: str, folder: Path) -> None:
    arguments, text, message = BAD[name]
    if text is not None:
        (folder / "bad.toml").write_text(text)
    before = contents(folder)
    result = run(*(a.replace("OUT", str(folder / "out")) for a in arguments), cwd=folder)
    assert result.returncode == 2, result.stdout + result.stderr
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr
    assert message in result.stderr, result.stderr
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("palpate.recordings.formats.existing", "Cut the file"),
        ("palpate.sensing.operator.influence", "coarser surface"),
        ("palpate.archives.reconstruct_recording", "Close other programs"),
    ],
)
def test_memory_that_is_lacking_is_said_of_what_lacks_it(
    place: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A coarser surface helps where cells are many, not where a file is too large."""

    def full(*_: Any, **__: Any) -> None:
        raise MemoryError("Unable to allocate 7.45 GiB")

    (tmp_path / "skin.toml").write_text(skin_text(9))
    write_recording(Recording(readings=np.zeros((2, 1, 9)), channels=["stress_zz"]), tmp_path / "r.nc")
    monkeypatch.setattr(place, full)
    done = run("reconstruct", "r.nc", "--skin", "skin.toml", "--out", "t.nc", cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("error: not enough memory (Unable to allocate 7.45 GiB). ")
    assert words in done.stderr
