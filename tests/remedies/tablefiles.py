"""Tables that are no text, titles of several lines, where taxels are: what a refusal says of them."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet

import palpate as pp
from palpate.recordings import TableMapping, read_recording
from remedies._remedy import Remedy, laid
from remedies.tables import table

COUNTS = np.arange(12.0).reshape(3, 4)
HOW: dict[str, Any] = {"depth": 1e-3, "channels": ["stress_zz"]}
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


def read(name: str, stress: str, **more: Any) -> Any:
    return read_recording(name, mapping=TableMapping(channels={"stress_zz": stress}, scale=1.0, **more))


def parquet(columns: dict[str, Any], stress: str, **more: Any) -> Any:
    pyarrow.parquet.write_table(pyarrow.table(columns), "t.parquet")
    return read("t.parquet", stress, **more)


def npy(values: Any, stress: str = "{}") -> Any:
    np.save("t.npy", values, allow_pickle=True)
    return read("t.npy", stress)


def npz(arrays: dict[str, Any], stress: str = "s[:]") -> Any:
    np.savez("t.npz", **arrays)
    return read("t.npz", stress)


def as_said(error: Any) -> Any:
    """Run the command that a refusal ends with."""
    said = str(error).split(": python ")[-1]
    subprocess.run([sys.executable, *shlex.split(said)], check=True)


def converted(refused: Any, made: str, stress: str = "{}") -> Any:
    try:
        refused()
    except pp.InvalidInput as error:
        as_said(error)
    return read(made, stress)


def skin(lines: str, **files: str) -> Any:
    head = '[pad]\nkind = "half_space"\nyoungs_modulus = "300 kPa"\npoissons_ratio = 0.48\n[[plane]]\n'
    laid(**files)
    Path("skin.toml").write_text(f'{head}kind = "scattered"\ndepth = "1 mm"\nchannels = ["stress_zz"]\n{lines}\n')
    return pp.Skin.from_file("skin.toml").planes[0].positions


def places(words: str, wrong: str, mended: str, *, text: str = "", new: str = "") -> Remedy:
    """Lines of a skin.toml, and a table t.csv, that are mended."""
    return Remedy(
        words,
        lambda: skin(wrong, t_csv=text),
        lambda: skin(mended, t_csv=new or text),
        right=lambda got: np.allclose(got, [[0, 0], [2e-3, 0], [0, 3e-3]]),
    )


XY = "x (mm),y (mm)\n0,0\n2,0\n0,3\n"
LIST = 'positions = [["0 mm", "0 mm"], ["2 mm", "0 mm"], ["0 mm", "3 mm"]]'
FILE = 'positions_file = "t.csv"'
GRID = [[2e-3 * (i % 3), 2e-3 * (i // 3)] for i in range(9)]
EPISODES = {"episode_index": [0, 0, 1], "s": COUNTS.tolist()}


def described(pitch: str) -> Any:
    recording = pp.Recording(readings=np.ones((1, 1, 3, 3)), channels=["stress_zz"], meta={"pitch": "2 mm"})
    array = pp.AreaArray(shape=(3, 3), pitch=float(pitch), **HOW)
    return pp.reconstruct_recording(pp.Skin(PAD, array), recording, f"{pitch}.nc", method="tikhonov")


def pickled() -> Any:
    pandas.DataFrame(COUNTS).to_pickle("t.pkl")
    return read("t.pkl", "{}")


def objects() -> Any:
    return npy(COUNTS.astype(object))


BALL = pp.solutions.hertz_point
SKIN = pp.Skin(
    PAD, pp.AreaArray(shape=(3, 3), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
)
READINGS = SKIN.sense(BALL(contact_radius=1e-3, force=1.0)) + np.random.default_rng(0).normal(0.0, 50.0, (3, 3, 3))

REMEDIES: list[Remedy] = [
    Remedy("is a pickle, which can run any program", pickled, lambda: converted(pickled, "t.parquet")),
    Remedy("save its numbers", objects, lambda: converted(objects, "t-numbers.npy")),
    Remedy(
        "Save arrays of numbers, numpy.asarray(values, dtype=float)",
        lambda: npz({"s": COUNTS.astype(object)}),
        lambda: npz({"s": np.asarray(COUNTS.astype(object), dtype=float)}),
    ),
    Remedy("no array has a line per frame", lambda: npz({"k": 3}), lambda: npz({"s": COUNTS})),
    Remedy("a table has a line per frame", lambda: npy(np.float64(3.0)), lambda: npy(COUNTS)),
    Remedy(
        "Save readings that are missing as NaN",
        lambda: npy(np.array([[1.0, np.inf]])),
        lambda: npy(np.array([[1.0, np.nan]])),
    ),
    Remedy(
        "each episode is a recording of its own. Name one with",
        lambda: parquet(EPISODES, "s[:]"),
        lambda: parquet(EPISODES, "s[:]", only="episode_index=0"),
        right=lambda got: got.readings.shape == (2, 1, 4),
    ),
    Remedy(
        "no line has {}; {} is {}",
        lambda: parquet(EPISODES, "s[:]", only="episode_index=7"),
        lambda: parquet(EPISODES, "s[:]", only="episode_index=1"),
    ),
    Remedy(
        "only must be a column and a number",
        lambda: parquet(EPISODES, "s[:]", only="episode_index"),
        lambda: parquet(EPISODES, "s[:]", only="episode_index=1"),
    ),
    Remedy(
        "numbers a line: name all of them as",
        lambda: parquet({"s": COUNTS.tolist()}, "s"),
        lambda: parquet({"s": COUNTS.tolist()}, "s[:]"),
    ),
    Remedy(
        "no column is among",
        lambda: parquet({"s": COUNTS.tolist()}, "q[:]"),
        lambda: parquet({"s": COUNTS.tolist()}, "s[:]"),
    ),
    Remedy(
        "the step of a slice must be 1 or more",
        lambda: parquet({"s": COUNTS.tolist()}, "s[::0]"),
        lambda: parquet({"s": COUNTS.tolist()}, "s[::1]"),
    ),
    Remedy(
        "to {} numbers; save a table with as many in each",
        lambda: parquet({"s": [[1.0], [1.0, 2.0]]}, "s[:]"),
        lambda: parquet({"s": [[1.0, np.nan], [1.0, 2.0]]}, "s[:]"),
    ),
    table(
        "no line has a number in the column of markers; name another column as marker",
        "frame,id,track,x,y\n0,1,,0,0\n0,2,,1,0\n1,1,,0,0\n1,2,,1,0\n",
        "frame=frame,marker=track,x=x,y=y,pixel=1mm",
        say="frame=frame,marker=id,x=x,y=y,pixel=1mm",
    ),
    table(
        "markers do not fill the {} places of {}: name x and y, or add lines with empty",
        "frame,row,col,s\n0,1,1,1\n0,1,2,1\n0,2,1,1\n",
        "frame=frame,marker=row,col,stress_zz=s,unit=1Pa",
        new="frame,row,col,s\n0,1,1,1\n0,1,2,1\n0,2,1,1\n0,2,2,\n",
    ),
    places("positions is missing, and the recording has none", "", LIST),
    places("or name a table with the columns x and y in positions_file", "", FILE, text=XY),
    places("positions must be a list of [x, y]", 'positions = [["0 mm"], ["2 mm", "0 mm"]]', LIST),
    places(
        "positions must be numbers or lengths",
        'positions = [[true, 0], [2, 0], [0, 3]]\npositions_unit = "mm"',
        'positions = [[0, 0], [2, 0], [0, 3]]\npositions_unit = "mm"',
    ),
    places(
        "positions_file and positions both say where the taxels are; leave one out", f"{LIST}\n{FILE}", LIST, text=XY
    ),
    places("positions_unit belongs to positions or positions_file; leave it out", 'positions_unit = "mm"', LIST),
    places(
        "no columns of positions; it has {}. Write titles into its first line",
        FILE,
        FILE,
        text=XY.replace("x (mm),y (mm)", "a,b"),
        new=XY,
    ),
    places(
        "no unit of the column {}: write positions_unit",
        FILE,
        f'{FILE}\npositions_unit = "mm"',
        text=XY.replace(" (mm)", ""),
    ),
    places("but positions_unit {}: leave out the wrong one", f'{FILE}\npositions_unit = "m"', FILE, text=XY),
    places("no number in the column", FILE, FILE, text=XY.replace("2,0", "2,"), new=XY),
    places(
        "two lines are of taxel",
        FILE,
        FILE,
        text="taxel,x (mm),y (mm)\n0,0,0\n0,2,0\n2,0,3\n",
        new="taxel,x (mm),y (mm)\n0,0,0\n1,2,0\n2,0,3\n",
    ),
    places("Take out the lines of taxels that measure nothing", FILE, FILE, text=XY + "0,0\n", new=XY),
    places(
        "lay the surface out flat and leave z out",
        FILE,
        FILE,
        text="x (mm),y (mm),z (mm)\n0,0,0\n2,0,1\n0,3,2\n",
        new=XY,
    ),
    Remedy(
        "taxel {} at ({}) m lies {} m from the others",
        lambda: pp.ScatteredArray(positions=[*GRID, [1.0, 0.0]], **HOW),
        lambda: pp.ScatteredArray(positions=GRID, **HOW),
    ),
    Remedy(
        "Leave surface out, or give more rows",
        lambda: pp.Skin(
            PAD, pp.AreaArray(shape=(1, 3), pitch=1e-3, **HOW), surface=pp.AreaGrid(shape=(1, 9), spacing=1e-3)
        ),
        lambda: pp.Skin(PAD, pp.AreaArray(shape=(1, 3), pitch=1e-3, **HOW)),
    ),
    Remedy(
        "shape must have at least 2 cells",
        lambda: pp.AreaGrid(shape=(1, 1), spacing=1e-3),
        lambda: pp.AreaGrid(shape=(1, 2), spacing=1e-3),
    ),
    Remedy(
        "shape must have at least 2 taxels",
        lambda: pp.AreaArray(shape=(1, 1), pitch=1e-3, **HOW),
        lambda: pp.AreaArray(shape=(1, 2), pitch=1e-3, **HOW),
    ),
    Remedy("in the skin, and the recording says that its own is", lambda: described("1e-3"), lambda: described("2e-3")),
    Remedy(
        "Where a contact cannot slip, leave friction out",
        lambda: SKIN.reconstruct(READINGS, friction=1e4),
        lambda: SKIN.reconstruct(READINGS),
    ),
    Remedy("contact_radius is missing", lambda: BALL(force=1.0), lambda: BALL(contact_radius=1e-3, force=1.0)),
    Remedy(
        "radius is its former name: leave it out",
        lambda: BALL(contact_radius=1e-3, radius=1e-3, force=1.0),
        lambda: BALL(contact_radius=1e-3, force=1.0),
    ),
]
