"""No command writes over what it reads, nor over a result unasked; what is replaced is replaced whole or not at all."""

from __future__ import annotations

import importlib
import os
import stat
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import palpate as pp
from command_line import tree
from palpate.cli import app
from palpate.recordings import read_recording, write_recording, write_touch
from palpate.recordings.files import atomically, in_place
from palpate.recordings.recording import Recording
from skin_files import skin_text

SKIN = skin_text(16, noise="5 Pa")


def palpate(*arguments: str) -> None:
    tree(app)(list(arguments), standalone_mode=False)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a skin and a recording."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["palpate"])
    (tmp_path / "skin.toml").write_text(SKIN)
    skin = pp.Skin.from_file("skin.toml")
    touch = pp.solutions.hertz_line(half_width=3e-3, force=20.0)
    readings = skin.sense(touch, rng=np.random.default_rng(0))
    recording = Recording(readings=np.stack([readings] * 3), channels=("stress_zz",), time=np.arange(3) / 100)
    for name in ("r.nc", "r.npz", "r.csv"):
        write_recording(recording, name)
    (tmp_path / "sub").mkdir()
    return tmp_path


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


READ = ("reconstruct", "r.nc", "--skin", "skin.toml", "--force", "--out")
INPUTS: dict[str, tuple[Callable[[], object] | None, tuple[str, ...]]] = {
    "reconstruct onto the recording": (None, (*READ, "r.nc")),
    "reconstruct by another path": (None, (*READ, "sub/../r.nc")),
    "reconstruct by the whole path": (None, (*READ, "$PWD/r.nc")),
    "reconstruct by a symbolic link": (lambda: os.symlink("r.nc", "link.nc"), (*READ, "link.nc")),
    "reconstruct by a hard link": (lambda: os.link("r.nc", "hard.nc"), (*READ, "hard.nc")),
    "reconstruct by a linked folder": (lambda: os.symlink(".", "here"), (*READ, "here/r.nc")),
    "reconstruct from a link": (
        lambda: os.symlink("r.nc", "link.nc"),
        ("reconstruct", "link.nc", "--skin", "skin.toml", "--force", "--out", "r.nc"),
    ),
    "reconstruct into a store that is read": (
        lambda: palpate("convert", "r.nc", "r.zarr"),
        ("reconstruct", "r.zarr", "--skin", "skin.toml", "--force", "--out", "r.zarr/t.nc"),
    ),
    "reconstruct onto a store that is read": (
        lambda: palpate("convert", "r.nc", "r.zarr"),
        ("reconstruct", "r.zarr", "--skin", "skin.toml", "--force", "--out", "r.zarr"),
    ),
    "track onto the recording": (None, ("track", "r.nc", "--skin", "skin.toml", "--force", "--out", "r.nc")),
    "track onto a table": (None, ("track", "r.csv", "--skin", "skin.toml", "--force", "--out", "r.csv")),
    "convert onto itself": (None, ("convert", "r.npz", "r.npz", "--force")),
    "convert onto itself by a link": (
        lambda: os.symlink("r.npz", "link.npz"),
        ("convert", "r.npz", "link.npz", "--force"),
    ),
    "live record onto the recording": (None, ("live", "r.nc", "--skin", "skin.toml", "--record", "r.nc")),
    "simulate onto the skin": (
        lambda: os.link("skin.toml", "skin.nc"),
        ("simulate", "--skin", "skin.toml", "--overwrite", "--out", "skin.nc"),
    ),
    "picture of a pad onto its skin": (
        lambda: os.symlink("skin.toml", "p.png"),
        ("pad", "skin.toml", "--plot", "p.png", "--force"),
    ),
    "picture onto the recording": (
        lambda: os.link("r.nc", "p.png"),
        ("reconstruct", "r.nc", "--skin", "skin.toml", "--plot", "p.png", "--force"),
    ),
}


@pytest.mark.parametrize("name", list(INPUTS))
def test_what_is_read_is_never_written(name: str, folder: Path) -> None:
    make, arguments = INPUTS[name]
    if any("r.zarr" in a for a in arguments):
        pytest.importorskip("zarr")
    if make is not None:
        make()
    before = snapshot(folder)
    with pytest.raises(pp.InvalidInput, match=r"would be overwritten|never overwritten"):
        palpate(*(a.replace("$PWD", str(folder)) for a in arguments))
    assert snapshot(folder) == before


def test_positions_that_a_skin_names_are_read_too(folder: Path) -> None:
    positions = np.random.default_rng(0).uniform(-7e-3, 7e-3, (30, 2))
    write_recording(Recording(readings=np.zeros((1, 1, 30)), channels=("stress_zz",), positions=positions), "where.nc")
    text = SKIN.replace('"line"', '"scattered"').replace('count = 16\npitch = "1 mm"', 'positions_file = "where.nc"')
    (folder / "skin.toml").write_text(text)
    before = snapshot(folder)
    with pytest.raises(pp.InvalidInput, match="would be overwritten"):
        palpate("simulate", "--skin", "skin.toml", "--out", "where.nc", "--overwrite")
    assert snapshot(folder) == before


RESULTS: dict[str, tuple[str, ...]] = {
    "simulate": ("simulate", "--skin", "skin.toml", "--force", "20 N/m", "--out", "there.nc"),
    "reconstruct": ("reconstruct", "r.nc", "--skin", "skin.toml", "--out", "there.nc"),
    "reconstruct, picture": ("reconstruct", "r.nc", "--skin", "skin.toml", "--out", "t.nc", "--plot", "there.png"),
    "reconstruct, no name given": ("reconstruct", "r.nc", "--skin", "skin.toml"),
    "track": ("track", "r.nc", "--skin", "skin.toml", "--out", "there.nc"),
    "track, touches alone": ("track", "r.nc", "--skin", "skin.toml", "--out", "there.npz"),
    "convert": ("convert", "r.nc", "there.csv"),
    "pad": ("pad", "skin.toml", "--plot", "there.png"),
    "bench": ("bench", "accuracy", "--layouts", "nothing", "--out", "."),
    "paper": ("paper", "--out", "."),
    "demo": ("demo", "--out", "demo"),
}


@pytest.mark.parametrize("name", list(RESULTS))
def test_a_result_is_not_replaced_unasked(name: str, folder: Path) -> None:
    arguments = RESULTS[name]
    if name == "bench":
        from palpate import bench

        arguments = (*arguments[:3], next(iter(bench.LAYOUTS)), *arguments[4:])
    (folder / "demo").mkdir()
    for mine in ("there.nc", "there.npz", "there.csv", "there.png", "r-touch.nc", "accuracy.csv", "demo/skin.toml"):
        (folder / mine).write_text("mine")
    before = snapshot(folder)
    with pytest.raises(pp.InvalidInput, match=r"--force|--overwrite"):
        palpate(*arguments)
    assert snapshot(folder) == before


def test_force_replaces_it(folder: Path) -> None:
    (folder / "there.nc").write_text("old")
    palpate("simulate", "--skin", "skin.toml", "--force", "20 N/m", "--out", "there.nc", "--overwrite")
    assert read_recording("there.nc").channels == ("stress_zz",)
    for command in (("track", "r.nc", "--skin", "skin.toml", "--out"), ("convert", "r.nc")):
        (folder / "there.nc").write_text("old")
        palpate(*command, "there.nc", "--force")
        assert len(read_recording("there.nc").readings) == 3
    assert not list(folder.glob(".palpate-*"))


def test_force_replaces_a_store_and_no_other_folder(folder: Path) -> None:
    pytest.importorskip("zarr")
    palpate("convert", "r.nc", "a.zarr")
    with pytest.raises(pp.InvalidInput, match="exists"):
        palpate("convert", "r.nc", "a.zarr")
    (folder / "a.zarr" / "old").write_text("old")
    palpate("convert", "r.nc", "a.zarr", "--force")
    assert len(read_recording("a.zarr").readings) == 3
    assert not (folder / "a.zarr" / "old").exists()
    (folder / "photos.zarr").mkdir()
    (folder / "photos.zarr" / "one").write_text("mine")
    with pytest.raises(pp.InvalidInput, match="is a folder"):
        palpate("convert", "r.nc", "photos.zarr", "--force")
    assert (folder / "photos.zarr" / "one").read_text() == "mine"
    assert not list(folder.glob(".palpate-*"))


@pytest.mark.long
def test_the_demo_twice_and_an_edited_skin(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module("palpate.cli.demo")
    small = module._DEMO_SKIN.replace("[32, 32]", "[6, 6]").replace('"1 mm"', '"3 mm"')
    monkeypatch.setattr(module, "_DEMO_SKIN", small)
    solve = pp.Skin.reconstruct
    monkeypatch.setattr(pp.Skin, "reconstruct", lambda self, r, friction: solve(self, r, method="tikhonov"))
    monkeypatch.setattr(pp.Touch, "plot", lambda self, **words: Figure((1, 1)))
    palpate("demo")
    palpate("demo")
    skin = folder / "palpate-demo" / "skin.toml"
    text = skin.read_text().replace("200 kPa", "150 kPa")
    skin.write_text(text)
    before = snapshot(folder)
    with pytest.raises(pp.InvalidInput, match="changed since"):
        palpate("demo")
    assert snapshot(folder) == before
    palpate("demo", "--force")
    assert "200 kPa" in skin.read_text()


# -- the helper --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt(), ValueError("no")])
def test_failure_leaves_what_was_there(error: BaseException, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def write(name: str) -> None:
        Path(name).write_text("half")
        raise error

    with pytest.raises(pp.InvalidInput if isinstance(error, OSError) else type(error)):
        atomically(path, write)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_links_and_permissions_stay(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to("real.txt")
    atomically(link, lambda name: Path(name).write_text("new") and None)
    assert link.is_symlink()
    assert real.read_text() == "new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640


def test_a_folder_comes_back_where_the_new_one_cannot_move_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = tmp_path / "a.zarr"
    store.mkdir()
    (store / "zarr.json").write_text("old")
    rename = os.rename

    def fails(source: Path, target: Path) -> None:
        if source.name == "a.zarr" and source.parent.name.startswith(".palpate-"):
            raise KeyboardInterrupt
        rename(source, target)

    monkeypatch.setattr(os, "rename", fails)

    def replace() -> None:
        with in_place(store) as fresh:
            fresh.mkdir()
            (fresh / "zarr.json").write_text("new")

    with pytest.raises(KeyboardInterrupt):
        replace()
    assert (store / "zarr.json").read_text() == "old"
    assert os.listdir(tmp_path) == ["a.zarr"]


def test_savers_of_the_library_replace_whole_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording(readings=np.ones((2, 1, 4)), channels=("stress_zz",))
    array = pp.LineArray(count=8, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=1.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.4), array)
    touch = skin.reconstruct(np.zeros((1, 8)), method="tikhonov", parameter=1.0)

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    for suffix in (".nc", ".npz", ".csv"):
        for save in (lambda p: write_recording(recording, p), lambda p: write_touch(touch, p)):
            path = tmp_path / f"a{suffix}"
            save(path)
            before = path.read_bytes()
            with monkeypatch.context() as patch:
                patch.setattr(os, "replace", fails)
                with pytest.raises(pp.InvalidInput, match="what was there is kept"):
                    save(path)
            assert path.read_bytes() == before
            assert os.listdir(tmp_path) == [path.name]
            path.unlink()


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (
            (*READ[:-1], "--out", "t.nc", "--plot", "a.png", "--plot-forces", "a.png"),
            "--plot and --plot-forces both write a.png",
        ),
        (
            (*READ[:-1], "--out", "t.nc", "--plot", "sub/../a.png", "--plot-forces", "$PWD/a.png"),
            "--plot and --plot-forces both",
        ),
        ((*READ[:-1], "--out", "t.zarr", "--plot-forces", "t.zarr/a.png"), "--out and --plot-forces both write"),
        ((*READ[:-1], "--out", "t.npz", "--prepared", "t.npz"), "t.npz is an input"),
        (
            ("track", "pictures", "--skin", "skin.toml", "--picture", "a.png", "--plot-forces", "a.png"),
            "--picture and --plot-forces both write a.png",
        ),
        (
            ("bench", "trust", "--quick", "--figure", "a.png", "--cases", "a.png"),
            "--figure and --cases both write a.png",
        ),
        ((*READ[:-1], "--out", "t.nc", "--plot", "a.png", "--plot", "b.png"), "--plot is given more than once"),
        ((*READ[:-1], "--out", "t.nc", "--out", "u.nc"), "--out is given more than once"),
        ((*READ[:-1], "--method", "dft", "--method", "tikhonov"), "--method is given more than once"),
        (("convert", "r.nc", "r2.nc", "--grid", "1 mm", "--grid=2 mm"), "--grid is given more than once"),
        (("bench", "trust", "--quick", "--frames", "1", "--frames", "2"), "--frames is given more than once"),
    ],
)
def test_no_output_is_lost_to_another(command: tuple[str, ...], words: str, folder: Path) -> None:
    """Two results of one name, and an option of one value given again."""
    (folder / "pictures").mkdir()
    (folder / "pictures" / "0.png").write_bytes(b"not looked at")
    if "t.zarr" in command:
        palpate("convert", "r.nc", "t.zarr")
    before = snapshot(folder)
    with pytest.raises(pp.InvalidInput, match=words):
        palpate(*(word.replace("$PWD", str(folder)) for word in command))
    assert snapshot(folder) == before


def test_options_that_may_be_given_again_are_all_used(folder: Path) -> None:
    palpate(
        "track",
        "r.nc",
        "--skin",
        "skin.toml",
        "--zero-at",
        "0",
        "--zero-at",
        "0.01",
        "--force",
        "--overwrite",
        "--out",
        "t.nc",
    )
    assert (folder / "t.nc").exists()
