"""A refusal leads on: what it suggests works on the very input that was refused."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.recordings import read_recording
from palpate.recordings.columns import columns_of, columns_of_text, suggested
from skin_files import SHEAR, skin_text

SKIN = skin_text(2, 3, channels=SHEAR, pitch="4 mm", depth="2 mm")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Raw counts of 2 x 3 taxels with three axes, as a driver writes them."""
    (tmp_path / "skin.toml").write_text(SKIN)
    titles = ["timestamp_ms", *(f"{c}{i}" for i in range(1, 7) for c in "xyz")]
    rng = np.random.default_rng(0)
    lines = [f"{10 * k}," + ",".join(map(str, rng.integers(-3, 3, 18))) for k in range(5)]
    (tmp_path / "taxels.csv").write_text("\n".join([",".join(titles), *lines]) + "\n")
    return tmp_path


def test_the_mapping_that_is_suggested_is_taken(folder: Path) -> None:
    refused = run("reconstruct", "taxels.csv", "--skin", "skin.toml", cwd=folder)
    assert refused.returncode == 2
    advised = re.search(r'--map ("[^"]+")', refused.stderr)
    assert advised is not None
    mapping = shlex.split(advised[1])[0]
    assert "stress_xz=x{}" in mapping
    done = run(
        *("reconstruct", "taxels.csv", "--skin", "skin.toml", "--map", mapping, "--method", "tikhonov"),
        *("--parameter", "1e-4", "--out", "t.csv"),
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    read = read_recording(folder / "taxels.csv", mapping=columns_of(columns_of_text(mapping), shape=(2, 3)))
    assert read.channels == ("stress_xz", "stress_yz", "stress_zz")
    assert read.readings.shape == (5, 3, 2, 3)
    assert read.time[1] == pytest.approx(0.01)
    first = np.loadtxt(folder / "taxels.csv", delimiter=",", skiprows=1)[0]
    np.testing.assert_allclose(read.readings[0, 2].ravel(), 25.0 * first[3::3])


@pytest.mark.parametrize(
    ("titles", "holds"),
    [
        (["t", "S1", "S2", "S3", "S4"], "time=t,stress_zz=S{}"),
        (
            ["time (s)", *(f"T{i}_{c}" for i in range(4) for c in "XYZ")],
            "stress_xz=T{}_X,stress_yz=T{}_Y,stress_zz=T{}_Z",
        ),
        (["a", "b"], "stress_zz=S{}"),
        (
            ["t", "u1", "u2", "u3", "u4", "v1", "v2", "v3", "v4"],
            "stress_zz=S{}",
        ),  # two of a kind: nothing tells which is which
    ],
)
def test_suggestions_for_numbered_columns(titles: list[str], holds: str) -> None:
    assert holds in suggested(titles)


def test_what_a_field_lacks_is_said_at_once(tmp_path: Path) -> None:
    for name in ("u.npy", "v.npy"):
        np.save(tmp_path / name, np.zeros((8, 8)))
    refused = run("tfm", "u.npy", "v.npy", cwd=tmp_path)
    assert refused.returncode == 2
    for option in ("--pixel", "--unit", "--step", "--youngs-modulus", "--poissons-ratio"):
        assert option in refused.stderr
    some = run("tfm", "u.npy", "v.npy", "--pixel", "0.1 um", "--step", "8", "--youngs-modulus", "8 kPa", cwd=tmp_path)
    assert "--unit" in some.stderr
    assert "--pixel" not in some.stderr
    assert run("tfm", "lost.npy", cwd=tmp_path).stderr == "error: lost.npy: no such file.\n"


MISTAKES = {
    "a video that is not there": (("track", "lost.mp4", "--skin", "skin.toml"), "lost.mp4: no such file"),
    "readings of stress for a modulus": (
        (
            "weigh",
            "taxels.csv",
            "--skin",
            "skin.toml",
            "--force",
            "2 N",
            "--map",
            "time=timestamp_ms,stress_zz=z{},unit=8Pa",
        ),
        "stress_zz",
    ),
    "a table as a skin": (("pad", "taxels.csv"), "palpate demo writes one"),
    "a field as a recording": (("convert", "taxels.npy", "t.nc"), "palpate tfm"),
    "a skin's mistake is not that of --map": (
        ("track", "taxels.csv", "--skin", "odd.toml", "--map", "time=timestamp_ms,stress_zz=z{},unit=8Pa"),
        "error: odd.toml, line 9: picth is not a key here: is pitch meant?",
    ),
    "a key of a camera": (
        ("reconstruct", "r.npz", "--skin", "camera.toml"),
        "distorsion is not a key here: is distortion meant?",
    ),
    "too many taxels": (
        ("track", "taxels.csv", "--skin", "wide.toml", "--map", "time=timestamp_ms,stress_zz=z{},unit=8Pa"),
        "2 x 4 = 8: correct shape",
    ),
    "friction without pressure": (
        ("reconstruct", "r.npz", "--skin", "skin.toml", "--components", "x", "--friction", "0.5"),
        "leave it out, or seek z too",
    ),
}


@pytest.mark.parametrize("name", list(MISTAKES))
def test_mistakes_say_what_to_do(name: str, folder: Path) -> None:
    arguments, words = MISTAKES[name]
    (folder / "odd.toml").write_text(SKIN.replace("pitch", "picth"))
    (folder / "camera.toml").write_text(f"{SKIN}\n[camera]\ndistorsion = [0.1]\n")
    (folder / "wide.toml").write_text(SKIN.replace("[2, 3]", "[2, 4]"))
    np.save(folder / "taxels.npy", np.zeros((3, 3)))
    from palpate.recordings import write_recording

    write_recording(
        pp.Recording(readings=np.ones((1, 3, 2, 3)), channels=("stress_xz", "stress_yz", "stress_zz")), folder / "r.npz"
    )
    refused = run(*arguments, cwd=folder)
    assert refused.returncode == 2
    assert words in refused.stderr
