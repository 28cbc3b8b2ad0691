"""Every option of a command reaches its target or is refused; none is dropped."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import palpate as pp
from command_line import tree
from palpate.cli import app
from palpate.recordings import write_recording
from palpate.recordings.recording import Recording
from skin_files import skin_text

SKIN = skin_text(16)
STREAM = SKIN + '\n[stream]\ntopic = "/finger"\nunit = "Pa"\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: a skin that measures pressure, one that measures shear alone, one with noise on one of two planes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["palpate"])
    (tmp_path / "skin.toml").write_text(SKIN)
    (tmp_path / "stream.toml").write_text(STREAM)
    plane = SKIN[SKIN.index("[[plane]]") :]
    (tmp_path / "two.toml").write_text(SKIN + plane.replace("1.2 mm", "2.4 mm") + 'noise = "5 Pa"\n')
    write_recording(Recording(readings=np.ones((3, 1, 16)), channels=("stress_zz",)), "r.nc")
    (tmp_path / "t.csv").write_text("x,y,u,v\n1,2,0.1,0.1\n3,5,0.1,0.1\n")
    return tmp_path


LIVE = ("live", "r.nc", "--skin", "skin.toml")
TRACK = ("track", "r.nc", "--skin", "skin.toml")
SIMULATE = ("simulate", "--skin", "skin.toml", "--force", "20 N/m", "--out", "new.nc")
TABLE = ("convert", "t.csv", "new.nc", "--columns", "x,y,u,v")
REFUSED: dict[str, tuple[tuple[str, ...], str]] = {
    "speed of a demo": (("live", "--demo", "--speed", "2"), "--speed"),
    "speed of the network": (("live", "--udp", "9000", "--skin", "skin.toml", "--speed", "2"), "--speed"),
    "loop of the network": (("live", "--tcp", "9000", "--skin", "skin.toml", "--loop"), "--loop"),
    "demo on no friction": (("live", "--demo", "--friction", "0"), "friction must be"),
    "live friction below 0": ((*LIVE, "--friction", "-0.4"), "friction must be"),
    "live friction without shear": ((*LIVE, "--friction", "0.4"), "friction ties shear to pressure"),
    "live friction in words": ((*LIVE, "--friction", "some"), "friction must be a positive number; got 'some'"),
    "live weight of nothing": ((*LIVE, "--parameter", "0"), "parameter must be a positive number"),
    "live by another rule": ((*LIVE, "--parameter", "gcv"), "one of evidence; got 'gcv'"),
    "track friction below 0": ((*TRACK, "--friction", "-0.4"), "friction must be"),
    "track friction without shear": ((*TRACK, "--friction", "0.4"), "friction ties shear to pressure"),
    "track by another rule": ((*TRACK, "--parameter", "gcv"), "one of evidence; got 'gcv'"),
    "accuracy of no method": (("bench", "accuracy", "--method", "best"), "method must be one of"),
    "accuracy of an option of others": (
        ("bench", "accuracy", "--method", "nnls", "--order", "2"),
        "does not take order",
    ),
    "accuracy of friction without shear": (
        ("bench", "accuracy", "--friction", "0.4", "--draws", "1"),
        "friction ties shear",
    ),
    "calibration of no error bars": (("bench", "calibration", "--method", "nnls"), "method must be one of adaptive, "),
    "drag without friction": ((*SIMULATE, "--drag", "0.5"), "--friction too"),
    "direction without friction": ((*SIMULATE[:2], "area.toml", *SIMULATE[3:], "--direction", "30"), "--direction"),
    "noise of one plane": ((*SIMULATE[:2], "two.toml", *SIMULATE[3:]), "noise"),
    "channels of nothing": (("convert", "r.nc", "new.nc", "--channels", "stress_zz"), "--channels"),
    "pixel of a topic": (("convert", "a.mcap", "new.nc", "--topic", "/a", "--pixel", "1 um"), "--pixel"),
    "follow of a topic": (("convert", "a.mcap", "new.nc", "--topic", "/a", "--follow"), "--follow"),
    "unit while salvaging": (("convert", "r.nc", "new.nc", "--salvage", "--reading-unit", "kPa"), "--reading-unit"),
    "stream of a table": (("convert", "r.nc", "new.nc", "--skin", "stream.toml"), "bag"),
    "follow without displacement": (
        (*TABLE, "--channels", "stress_xz,stress_yz", "--position-unit", "mm", "--reading-unit", "Pa", "--follow"),
        "--follow",
    ),
}


@pytest.mark.parametrize("name", list(REFUSED))
@pytest.mark.long
def test_what_has_no_meaning_is_refused(name: str, folder: Path) -> None:
    arguments, message = REFUSED[name]
    area = SKIN.replace('"line"', '"area"').replace("count = 16", "shape = [6, 6]")
    (folder / "area.toml").write_text(area)
    if "area.toml" in arguments:
        arguments = tuple(a.replace("20 N/m", "1 N") for a in arguments)
    with pytest.raises(pp.PalpateError, match=message):
        tree(app)(list(arguments), standalone_mode=False)
    assert not (folder / "new.nc").exists()


def test_limits_that_cannot_be_watched(folder: Path) -> None:
    (folder / "skin.toml").write_text(SKIN.replace("stress_zz", "stress_xz"))
    write_recording(Recording(readings=np.ones((3, 1, 16)), channels=("stress_xz",)), "x.nc")
    skin = pp.Skin.from_file("skin.toml")
    if "z" in skin.components:
        pytest.fail("this skin was meant to measure shear alone")
    for option, value in (("--max-pressure", "40 kPa"), ("--max-force", "2 N/m")):
        with pytest.raises(pp.Unsupported, match="it needs the pressure"):  # with or without a limit
            tree(app)(["track", "x.nc", "--skin", "skin.toml", option, value], standalone_mode=False)


@pytest.mark.parametrize(("given", "used"), [((), (20, 0.6)), (("--baseline", "0", "--friction", "0.3"), (0, 0.3))])
def test_the_demo_takes_baseline_and_friction(
    given: tuple[str, ...], used: tuple[int, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, Any] = {}

    class Enough(Exception):
        pass

    class Skin:
        components = ("x", "y", "z")
        surface = pp.AreaGrid(shape=(4, 4), spacing=1e-3)
        calibration = None

        def track(self, **options: Any) -> None:
            seen.update(options)
            raise Enough

    def frames() -> Iterator[Any]:
        yield from ()

    monkeypatch.setattr("palpate.simulation.demonstration", lambda: (Skin(), frames))
    with pytest.raises(Enough):
        tree(app)(["live", "--demo", *given], standalone_mode=False)
    assert (seen["baseline"], seen["friction"]) == used


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("reconstruct", "r.nc", "--skin", "skin.toml", "--components", ""), "components must be"),
        (
            (
                "reconstruct",
                "r.nc",
                "--skin",
                "skin.toml",
                "--method",
                "tikhonov",
                "--parameter",
                "evidence",
                "--rule",
                "gcv",
            ),
            "names the rule already",
        ),
        ((*TRACK, "--force"), "--force replaces a result"),
    ],
)
def test_what_was_taken_without_a_word(arguments: tuple[str, ...], message: str, folder: Path) -> None:
    with pytest.raises(pp.InvalidInput, match=message):
        tree(app)(list(arguments), standalone_mode=False)
    assert not (folder / "r-touch.nc").exists()


def test_a_seed_below_zero_is_refused(folder: Path) -> None:
    with pytest.raises(typer.TyperException, match="greater than or equal to 0"):
        tree(app)([*SIMULATE, "--seed", "-1"], standalone_mode=False)


def test_frames_that_do_not_fit_into_memory_are_refused_before_any_work(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate._memory.available", lambda: 2_000_000_000)
    with pytest.raises(pp.Unsupported, match=r"10,000,000 frames of 16 readings need about 5.1 GB of memory.*--frames"):
        tree(app)([*SIMULATE, "--frames", "10000000"], standalone_mode=False)

    def full(_: float, what: str, remedy: str) -> None:
        raise pp.Unsupported(f"{what}: {remedy}")

    monkeypatch.setattr("palpate.archives.run.require", full)
    with pytest.raises(pp.Unsupported, match=r"the touches of 3 frames: Write .nc, .h5, .zarr, .csv or .mcap"):
        app(
            ["reconstruct", "r.nc", "--skin", "skin.toml", "--method", "tikhonov", "--out", "t.npz"],
            standalone_mode=False,
        )


def test_a_component_named_twice_is_refused() -> None:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5),
        pp.LineArray(count=11, pitch=0.5, depth=1.5, channels=["stress_zz"]),
    )
    with pytest.raises(pp.InvalidInput, match="names one twice"):
        skin.reconstruct(np.zeros((1, 11)), components=["z", "z"])


@pytest.mark.parametrize(
    "setting", [{"budget": 0.0}, {"budget": -1.0}, {"rezero": math.nan}, {"rate": True}, {"tolerance": None}]
)
def test_settings_of_a_tracker_are_checked_before_anything_is_prepared(
    setting: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5),
        pp.LineArray(count=11, pitch=0.5, depth=1.5, channels=["stress_zz"]),
    )
    monkeypatch.setattr(skin, "_prepared", lambda *_: pytest.fail("prepared"))
    with pytest.raises(pp.InvalidInput, match="must be a positive number"):
        skin.track(**setting)


@pytest.mark.parametrize("command", ["track", "live"])
def test_a_tracker_offers_the_options_of_its_method(command: str) -> None:
    """Every option of the method that `Skin.track` takes, with the method's own words."""
    whole: Any = typer.main.get_command(app)
    found = whole.commands[command]
    offered = {p.name: p for p in found.get_params(typer.Context(found))}
    for name in ("friction", "parameter"):
        assert offered[name].help.startswith(pp.Constrained.options()[name].help)
    assert "draws" not in offered


def test_the_weight_of_the_penalty_reaches_the_tracker(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, Any] = {}
    original = pp.Skin.track

    @functools.wraps(original)
    def track(self: pp.Skin, **options: Any) -> Any:
        seen.update(options)
        return original(self, **options)

    monkeypatch.setattr(pp.Skin, "track", track)
    tree(app)(["track", "r.nc", "--skin", "skin.toml", "--parameter", "0.5"], standalone_mode=False)
    assert seen["parameter"] == 0.5
