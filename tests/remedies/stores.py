"""Recordings and results in files, prepared skins, and long runs: what a refusal says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.archives import reconstruct_recording
from palpate.recordings import (
    TopicMapping,
    read_recording,
    read_table,
    read_touch,
    recorder,
    write_recording,
    write_touch,
)
from remedies._remedy import Remedy, laid
from remedies.skins import BATCH, BOTH, FAST, NORMAL, PRESS, SKIN, line

TWO = pp.Recording(readings=np.stack([0 * PRESS, PRESS]), channels=BOTH, time=[0.0, 0.01])
LAST = float(PRESS[-1, 4])
OWN = "time (s),stress_zz[0] (Pa),stress_zz[1] (Pa)\n0,1,2\n1,3,4\n"
BEADS = "x,y,u,v\n0,0,1,0\n10,0,2,0\n0,10,1,3\n"


def lay() -> None:
    """Two frames in every format."""
    for ending in ("nc", "npz", "csv"):
        write_recording(TWO, f"r.{ending}")


def right(recording: Any) -> bool:
    """The last frame is the press."""
    return bool(np.allclose(recording.readings[-1, -1, 4], LAST, rtol=1e-6))


def own(words: str, wrong: str, mended: str = OWN, *, last: float = 4.0, room: str = "recordings.csvfile") -> Remedy:
    """A table whose columns are named as palpate names them."""

    def read(text: str) -> Any:
        laid(r_csv=text)
        return read_recording("r.csv")

    return Remedy(
        words, lambda: read(wrong), lambda: read(mended), room=room, right=lambda r: r.readings[-1, 0, -1] == last
    )


def beads(words: str, wrong: Any, mended: Any = None, *, text: str = BEADS, room: str = "recordings.tables") -> Remedy:
    """A foreign table by `read_table`."""
    plain = {"columns": ["x", "y", "u", "v"], "channels": ["displacement_x", "displacement_y"]}

    def read(text: str, given: Any) -> Any:
        laid(b_csv=text)
        return read_table("b.csv", **{"position_factor": 1e-3, "reading_factor": 1e-3, **plain, **(given or {})})

    return Remedy(
        words,
        lambda: read(text, wrong),
        lambda: read(BEADS, mended),
        room=room,
        right=lambda r: r.readings[0, -1, -1] == 3e-3,
    )


def vectors(words: str, wrong: Any, mended: Any, *, held: Any = None) -> Remedy:
    """Data sets of an HDF5 file by `read_table`."""

    def given() -> None:
        h5py = pytest.importorskip("h5py")
        with h5py.File("b.h5", "w") as file:
            file["pos"], file["vec"], file["flat"] = np.arange(6.0).reshape(3, 2), np.ones((3, 2)), np.ones(6)

    def read(names: Any) -> Any:
        return read_table(
            "b.h5",
            columns=names,
            channels=["displacement_x", "displacement_y"],
            position_factor=1.0,
            reading_factor=1.0,
        )

    return Remedy(
        words,
        lambda: read(wrong),
        lambda: read(mended),
        given=given,
        room="recordings.tables",
        right=lambda r: r.readings.shape == (1, 2, 3),
    )


def damaged(words: str, name: str, spoil: Any, room: str, read: Any = read_recording) -> Remedy:
    """A file that is spoilt, and another copy of it."""
    import shutil

    def given() -> None:
        lay()
        write_touch(BATCH, "t.nc")
        write_touch(BATCH, "t.npz")
        (Path("copy") / name).parent.mkdir()
        shutil.copy(name, Path("copy") / name)
        spoil(Path(name))

    return Remedy(words, lambda: read(name), lambda: read(Path("copy") / name), given=given, room=room, slow=True)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-300])


def swapped(path: Path) -> None:
    path.write_text(path.read_text().replace("0.01", "0.02"))


def lacking(path: Path) -> None:
    with np.load(path) as file:
        held = {k: file[k] for k in file.files if k != "time"}
    np.savez(path, **held)


def prepared() -> None:
    SKIN.prepare(method=pp.Tikhonov())
    SKIN.save_prepared("s.prepared")


def run(
    words: str,
    wrong: dict[str, Any],
    mended: dict[str, Any],
    *,
    given: Any = lay,
    room: str = "archives.run",
    skin: Any = None,
    slow: bool = True,
) -> Remedy:
    """A run over a recording."""

    def call(how: dict[str, Any]) -> Any:
        return reconstruct_recording(
            how.pop("skin", SKIN), how.pop("source", "r.nc"), how.pop("out", "t.zarr"), **{**FAST, **how}
        )

    return Remedy(
        words,
        lambda: call(dict(wrong)),
        lambda: call(dict(mended)),
        given=lambda: (pytest.importorskip("zarr"), given()),
        room=room,
        right=lambda done: done.frames in (1, 2),
        slow=slow,
    )


def broken_off() -> None:
    """A run that is stopped after its first piece."""
    lay()

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_recording(SKIN, "r.nc", "t.zarr", chunk=1, progress=stop, **FAST)


def robot(name: str = "bag", values: Any = ((1, 2, 3, 4.0), (1, 2, 3, 5.0))) -> None:
    """What a robot recorded: lists of numbers on a topic."""
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag2 import Writer

    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float32MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(Path(name), version=9) as writer:
        skin = writer.add_connection("/skin", kind, typestore=store)
        for k, one in enumerate(values):
            message = store.types[kind](layout=layout, data=np.array(one, dtype=np.float32))
            writer.write(skin, 10**9 + k * 10**7, store.serialize_cdr(message, kind))


MESSAGES: dict[str, Any] = {"topic": "/skin", "channels": ["stress_zz"], "path": "data", "scale": 1e3}


def topic(
    words: str,
    wrong: dict[str, Any],
    mended: dict[str, Any] | None = None,
    *,
    room: str = "recordings.mapping",
    given: Any = robot,
    source: str = "bag",
) -> Remedy:
    """How messages become readings."""

    def read(how: dict[str, Any], source: str) -> Any:
        return read_recording(source, mapping=TopicMapping(**{**MESSAGES, **how}))

    return Remedy(
        words,
        lambda: read(wrong, source),
        lambda: read(mended or {}, "bag"),
        given=given,
        room=room,
        right=lambda r: float(np.ravel(r.readings)[-1]) == 5000.0,
        slow=True,
    )


def record(name: str, frames: Any = (PRESS,), channels: Any = BOTH) -> Any:
    with recorder(name, channels) as out:
        for k, one in enumerate(frames):
            out.readings(0.01 * k, one)
    return read_recording(name)


REMEDIES = [
    # tables that name their columns as palpate does
    Remedy(
        "a CSV names each column once, but the recording has one channel on several planes",
        lambda: write_recording(pp.Recording(readings=np.zeros((1, 2, 3)), channels=["stress_zz"] * 2), "r.csv"),
        lambda: (
            write_recording(pp.Recording(readings=np.zeros((1, 2, 3)), channels=["stress_zz"] * 2), "r.npz"),
            read_recording("r.npz"),
        )[1],
        right=lambda r: r.channels == ("stress_zz", "stress_zz"),
    ),
    own('the first column must be "time (s)"', OWN.replace("time (s)", "stress_xz[0] (Pa)")),
    own("follows the time", "time (s)\n0\n1\n"),
    own("columns mix one and two indices", OWN.replace("[1]", "[1;0]")),
    own("do not fill {} channels of", OWN.replace("[1]", "[2]")),
    own("values for {} columns; the file may be truncated.", OWN + "2,5\n"),
    own('is not like "stress_zz[0;1] (Pa)"', OWN.replace("stress_zz[0] (Pa)", "S1")),
    own("has no unit: write", OWN.replace("stress_zz[1] (Pa)", "stress_zz[1]")),
    own("cannot be read as CSV", OWN + '2,"5"6,7\n', room="recordings.textlines"),
    # foreign tables
    beads("columns for x, y and {} channels", {"columns": ["x", "y", "u"]}),
    beads("is named twice; name one for each of x, y and the channels", {"columns": ["x", "y", "u", "u"]}),
    vectors("name two data sets, positions and vectors", ["pos"], ["pos", "vec"]),
    vectors("must have shape (2, n) or (n, 2) each", ["pos", "flat"], ["pos", "vec"]),
    # formats
    Remedy(
        ": no such file.",
        lambda: read_recording("lost.nc"),
        lambda: read_recording("r.nc"),
        given=lay,
        room="recordings.formats",
        right=right,
    ),
    Remedy(
        "is a folder; give a file.",
        lambda: read_recording("folder.nc"),
        lambda: read_recording("r.nc"),
        given=lambda: (lay(), Path("folder.nc").mkdir()),
        room="recordings.formats",
        right=right,
    ),
    Remedy(
        "give a file, a ROS 2 bag or a Zarr store",
        lambda: read_recording("."),
        lambda: read_recording("r.nc"),
        given=lay,
        right=right,
    ),
    Remedy(
        "store is a folder; got a file",
        lambda: read_recording("r.zarr"),
        lambda: (write_recording(TWO, "s.zarr"), read_recording("s.zarr"))[1],
        given=lambda: (pytest.importorskip("zarr"), laid(r_zarr="x")),
        right=right,
    ),
    Remedy(
        "What is inside looks like",
        lambda: read_recording("r.dat1"),
        lambda: read_recording(Path("r.dat1").rename("r2.nc")),
        given=lambda: (lay(), Path("r.nc").rename("r.dat1")),
        right=right,
    ),
    Remedy(
        "salvage is for what palpate wrote",
        lambda: table(salvage=True),
        lambda: table(),
        right=lambda r: r.readings[-1, 0, -1] == 100.0,
    ),
    Remedy(
        "exists; a store is not overwritten. Give another name",
        lambda: write_recording(TWO, "s.zarr"),
        lambda: (write_recording(TWO, "n.zarr"), read_recording("n.zarr"))[1],
        given=lambda: (pytest.importorskip("zarr"), write_recording(TWO, "s.zarr")),
        right=right,
    ),
    Remedy(
        "is a table of another program. {}",
        lambda: (laid(t_txt=WIDE), read_recording("t.txt")),
        lambda: table("t.txt"),
        right=lambda r: r.readings[-1, 0, -1] == 100.0,
    ),
    # recorders
    Remedy(
        "channels must be a list of names, one for each channel of the readings",
        lambda: record("s.nc", channels="stress_zz"),
        lambda: record("s.nc"),
        right=right,
    ),
    Remedy(
        "exists; a recording is not overwritten. Give another name",
        lambda: record("r.nc"),
        lambda: record("s.nc"),
        given=lay,
        room="recordings.stores",
        right=right,
    ),
    Remedy(
        "does not exist; make it first",
        lambda: record("new/s.nc"),
        lambda: (Path("new").mkdir(), record("new/s.nc"))[1],
        room="recordings.stores",
        right=right,
    ),
    Remedy(
        "a frame must have shape (channel, taxel)",
        lambda: record("s.nc", (PRESS[0],)),
        lambda: record("n.nc", (PRESS,)),
        room="recordings.frame",
        right=right,
    ),
    Remedy(
        "the planes of a frame differ in shape",
        lambda: record("s.nc", ([PRESS[:1], PRESS[1:, :5]],)),
        lambda: (record("n.nc", (PRESS[1:, :5],), channels=BOTH[1:]), record("m.nc", (PRESS[:1],), channels=BOTH[:1]))[
            1
        ],
    ),
    Remedy(
        "a frame of shape {} follows frames of",
        lambda: record("s.nc", (PRESS, PRESS[:, :5])),
        lambda: record("n.nc", (PRESS, PRESS)),
        room="recordings.stores",
        right=right,
    ),
    Remedy(
        "exists; a recording is not overwritten. Give another name",
        lambda: record("s.mcap"),
        lambda: record("n.mcap"),
        given=lambda: (pytest.importorskip("mcap"), record("s.mcap")),
        room="recordings.mcapfile",
        right=right,
    ),
    Remedy(
        "MCAP keeps times from 0 on",
        lambda: write_recording(pp.Recording(readings=PRESS[None], channels=BOTH, time=[-1.0]), "s.mcap"),
        lambda: (
            write_recording(pp.Recording(readings=PRESS[None], channels=BOTH, time=[0.0]), "s.mcap"),
            read_recording("s.mcap"),
        )[1],
        given=lambda: pytest.importorskip("mcap"),
        right=right,
    ),
    Remedy(
        "MCAP keeps whole nanoseconds, and frames",
        lambda: write_recording(
            pp.Recording(readings=np.stack([PRESS] * 2), channels=BOTH, time=[0.0, 1e-10]), "s.mcap"
        ),
        lambda: (
            write_recording(pp.Recording(readings=np.stack([PRESS] * 2), channels=BOTH, time=[0.0, 1e-10]), "s.nc"),
            read_recording("s.nc"),
        )[1],
        given=lambda: pytest.importorskip("mcap"),
        right=lambda got: got.time.tolist() == [0.0, 1e-10],
    ),
    # other copies of what is damaged
    damaged("does not agree with its checksum", "r.csv", swapped, "recordings.checked"),
    damaged("cannot be read as NPZ", "r.npz", cut, "recordings.npz"),
    damaged("not a palpate recording: it lacks", "r.npz", lacking, "recordings.npz"),
    damaged("holds no touches (it holds", "t.nc", lambda p: write_recording(TWO, p), "recordings.stored", read_touch),
    damaged("holds no touches that can be read", "t.nc", cut, "recordings.netcdf", read_touch),
    # prepared skins
    Remedy(
        "there is no such file; write one with Skin.save_prepared",
        lambda: SKIN.load_prepared("lost"),
        lambda: (prepared(), SKIN.load_prepared("s.prepared")),
    ),
    Remedy(
        "is damaged, or is not a file of a prepared skin",
        lambda: (laid(s_prepared="x"), SKIN.load_prepared("s.prepared")),
        lambda: (prepared(), SKIN.load_prepared("s.prepared")),
    ),
    Remedy(
        "was prepared for another skin",
        lambda: NORMAL.load_prepared("s.prepared"),
        lambda: (
            NORMAL.prepare(method=pp.Tikhonov()),
            NORMAL.save_prepared("n.prepared"),
            NORMAL.load_prepared("n.prepared"),
        ),
        given=prepared,
    ),
    Remedy(
        "call prepare() or reconstruct() first", lambda: pp.Skin(SKIN.pad, line()).save_prepared("s"), lambda: fresh()
    ),
    # runs
    run("chunk must be a whole number of frames", {"chunk": 0}, {"chunk": 1}),
    run(
        "or overwrite=True (--force) to replace it",
        {"out": "r.nc", "source": TWO},
        {"out": "r.nc", "source": TWO, "overwrite": True},
    ),
    run("alone is solved at once: leave out resume", {"resume": True, "frame": 1}, {"frame": 1}),
    run("only a run into a Zarr store (.zarr) can go on", {"resume": True, "out": "t.npz"}, {"resume": True}),
    run("is not among the {} frames of", {"frame": 2}, {"frame": -1}),
    run("baseline must be a number of frames at the start", {"baseline": 2}, {"baseline": 1}),
    run("workers must be a whole number", {"workers": 0}, {"workers": 1}, room="archives.pools"),
    run("scheduler must be", {"scheduler": "slurm"}, {"scheduler": "threads"}, room="archives.pools"),
    run(
        "holds an interrupted run",
        {},
        {"resume": True},
        given=broken_off,
        slow=False,
        room="recordings.zarrstream",
    ),
    run(
        "the interrupted run was another one",
        {"resume": True, "parameter": 1e-3},
        {"resume": True},
        given=broken_off,
        room="recordings.zarrstream",
    ),
    run(
        "holds something else; move it away",
        {},
        {"out": "n.zarr"},
        given=lambda: (lay(), Path("t.zarr.partial").mkdir(), Path("t.zarr.partial/mine").write_text("x")),
        room="recordings.zarrstream",
    ),
    # robots
    topic("channels must be names among", {"channels": ["stress"]}),
    topic("fields for {} channels; name one field for each", {"fields": ["x", "y"]}),
    topic("scale must be one number or one per channel", {"scale": [1.0, 2.0]}),
    topic("markers are read as displacement_x", {"markers": True}),
    topic("messages hold {} channels, but {} are named", {"channels": ["stress_xz", "stress_zz"]}),
    topic("taxels do not make a shape of", {"shape": (2, 3)}, {"shape": (2, 2)}),
    topic("is not a list of numbers, an image or a Grid", {"path": "layout"}),
    topic("has no topic {}; it has", {"topic": "/skins"}, room="recordings.robots"),
    topic("is not a time: neither seconds nor a stamp", {"stamp": "layout"}),
    topic(
        "a frame of shape {} follows frames of",
        {},
        given=lambda: (robot(), robot("odd", ((1, 2), (1, 2, 3)))),
        source="odd",
        room="recordings.robots",
    ),
    topic("definitions {}: no message definitions", {"definitions": "."}, room="recordings.robots"),
    Remedy(
        "was not written by palpate: name the topic and channels",
        lambda: read_recording("bag"),
        lambda: read_recording("bag", mapping=TopicMapping(**MESSAGES)),
        given=robot,
    ),
]

WIDE = "t,S1,S2\n0,1,2\n1,3,4\n"


def table(name: str = "t.csv", **how: Any) -> Any:
    from palpate.recordings.columns import columns_of, columns_of_text

    Path(name).write_text(WIDE)
    return read_recording(name, mapping=columns_of(columns_of_text("time=t,stress_zz=S{},unit=25Pa")), **how)


def fresh() -> Any:
    skin = pp.Skin(SKIN.pad, line())
    skin.prepare(method=pp.Tikhonov())
    skin.save_prepared("s")
    return skin
