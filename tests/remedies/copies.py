"""Files that are damaged or of another kind, and disks that fail: another copy, another name, another disk."""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from palpate.archives import reconstruct_recording
from palpate.cli.files import make_folder
from palpate.live.session import unpacked
from palpate.microscopy import read_field, read_picture
from palpate.paper.page import report
from palpate.recordings import read_recording, read_table, read_touch, recorder, write_recording, write_touch
from palpate.recordings.labelled import recording_dataset, recording_of, touch_dataset, touch_of
from palpate.recordings.robots import frames
from remedies._remedy import Remedy, value
from remedies.left import meta
from remedies.skins import BATCH, FAST, PRESS, SKIN
from remedies.stores import MESSAGES, TWO, TopicMapping, record, right, robot

# -- labelled data sets ------------------------------------------------------------------------------------------------------


def of_touch(words: str, spoil: Callable[[Any], Any]) -> Remedy:
    """A result in a file that another program changed, and one that nobody did."""

    def made() -> Any:
        held = touch_dataset(BATCH, {})
        both = json.dumps(["tikhonov", "adaptive"])
        return held.assign(found_by=("time", np.array([0, 1], dtype=np.int8))).assign_attrs(methods=both)

    return Remedy(
        words,
        lambda: touch_of(spoil(made())),
        lambda: touch_of(made()),
        room="recordings.labelled",
        right=lambda touch: bool(np.allclose(touch.force, BATCH.force)),
    )


def of_recording(words: str, spoil: Callable[[Any], Any]) -> Remedy:
    return Remedy(
        words,
        lambda: recording_of(spoil(recording_dataset(TWO))),
        lambda: recording_of(recording_dataset(TWO)),
        room="recordings.labelled",
        right=right,
    )


def seen(held: Any, text: str) -> Any:
    held["traction"].attrs["view"] = text
    return held


def longer(held: Any) -> Any:
    """A surface with one more cell than the traction has."""
    found = json.loads(held.attrs["surface"])
    return held.assign_attrs(surface=json.dumps({**found, "count": found["count"] + 1}))


# -- files -------------------------------------------------------------------------------------------------------------------


def copies(
    words: str,
    spoilt: Callable[[], Any],
    room: str,
    *,
    whole: Callable[[], Any] | None = None,
    read: Callable[[str], Any] = read_recording,
    name: str = "bad.nc",
    good: str = "good.nc",
    needs: str = "",
) -> Remedy:
    """A file that is spoilt and a whole copy of it."""

    def given() -> None:
        if needs:
            pytest.importorskip(needs)
        spoilt()
        (whole or (lambda: write_recording(TWO, good)))()

    return Remedy(words, lambda: read(name), lambda: read(good), given=given, room=room)


def claimed() -> None:
    """A header that claims a terabyte, of which nothing is stored."""
    h5py = pytest.importorskip("h5py")
    with h5py.File("bad.nc", "w") as file:
        file.create_dataset("readings", shape=(10**9, 2, 9), dtype="f8", chunks=(10**5, 2, 9))
        file["time"], file["channel"] = np.zeros(2), ["stress_xz", "stress_zz"]


def bomb() -> None:
    write_recording(TWO, "good.npz")
    with zipfile.ZipFile("good.npz") as archive:
        held = {n: archive.read(n) for n in archive.namelist()}
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 1, 1), }"
    held["readings.npy"] = b"\x93NUMPY\x01\x00" + (128 - 10).to_bytes(2, "little") + header.ljust(117) + b"\n"
    with zipfile.ZipFile("bad.npz", "w") as archive:
        for name, data in held.items():
            archive.writestr(name, data)


def hdf(**held: Any) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File("bad.nc", "w") as file:
        for name, values in held.items():
            file[name] = values


def zarr_store(name: str, write: Callable[[str], Any] = lambda name: write_recording(TWO, name)) -> Path:
    pytest.importorskip("zarr")
    write(name)
    return Path(name)


def without_time() -> None:
    import shutil

    shutil.rmtree(zarr_store("bad.zarr") / "time")


def without_blocks() -> None:
    import shutil

    shutil.rmtree(zarr_store("bad.zarr") / "readings" / "c")


def other_text(name: str = "zarr.json", write: Callable[[str], Any] | None = None) -> None:
    store = zarr_store("bad.zarr") if write is None else zarr_store("bad.zarr", write)
    (store / "time" / name).write_text("{")


def touches(name: str) -> None:
    write_touch(BATCH, name)


def vectors(name: str) -> Any:
    return read_table(
        name,
        columns=["pos", "vec"],
        channels=["displacement_x", "displacement_y"],
        position_factor=1.0,
        reading_factor=1.0,
    )


def vectors_of(name: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(name, "w") as file:
        file["pos"], file["vec"] = np.arange(6.0).reshape(3, 2), np.ones((3, 2))


def cut(name: str, of: str, part: float = 0.5) -> None:
    whole = Path(of).read_bytes()
    Path(name).write_bytes(whole[: int(part * len(whole))])


# -- pictures and fields of a microscope -------------------------------------------------------------------------------------


def tiff(name: str = "good.tif", **how: Any) -> None:
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(name, np.arange(400, dtype=np.uint8).reshape(20, 20), **how)


def pair_of_fields() -> None:
    tifffile = pytest.importorskip("tifffile")
    y, x = np.indices((12, 12)) - 5.5
    tifffile.imwrite("good.tif", np.stack([0.1 * x, 0.1 * y]).astype(np.float32))


def field(name: str) -> Any:
    return read_field(name, pixel=1e-6, step=1, unit="px")


# -- disks -------------------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def room(limit: int) -> Iterator[None]:
    from test_full_disk import room as limited

    with limited(limit):
        yield


def full(words: str, write: Callable[[], Any], where: str, *, limit: int = 64, needs: str = "h5py") -> Remedy:
    """A disk that takes no more, and the same when it does again."""

    def refused() -> Any:
        with room(limit):
            return write()

    return Remedy(words, refused, write, given=lambda: pytest.importorskip(needs), room=where, slow=True)


def fills(name: str) -> None:
    """A recorder whose disk fills up while it records."""
    Path(name).unlink(missing_ok=True)
    with recorder(name, ["stress_xz", "stress_zz"]) as out:
        for k in range(3):
            out.readings(0.01 * k, PRESS)


def full_at_the_end(name: str, limit: int | None) -> Any:
    import shutil

    for path in (Path(name),):
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    out = recorder(name, ["stress_xz", "stress_zz"])
    for k in range(3):
        out.readings(0.01 * k, PRESS)
    with room(2**30 if limit is None else limit):
        out.close()
    return read_recording(name)


def at_the_end(words: str, name: str, where: str, limit: int) -> Remedy:
    return Remedy(
        words,
        lambda: full_at_the_end(name, limit),
        lambda: full_at_the_end(name, None),
        given=lambda: pytest.importorskip("mcap" if name.endswith("mcap") else "zarr"),
        room=where,
        right=right,
    )


def closed(name: str) -> Remedy:
    def wrong() -> None:
        with recorder(name, ["stress_xz", "stress_zz"]) as out:
            out.readings(0.0, PRESS)
        out.readings(0.01, PRESS)

    def mended() -> Any:
        with recorder("again-" + name, ["stress_xz", "stress_zz"]) as out:
            out.readings(0.0, PRESS)
            out.readings(0.01, PRESS)
        return read_recording("again-" + name)

    ending = name.rsplit(".", 1)[1]
    where = "recordings.mcapfile" if ending == "mcap" else "recordings.stores"
    library = {"mcap": "mcap", "nc": "h5py"}[ending]
    return Remedy(
        "this recording is closed",
        wrong,
        mended,
        given=lambda: pytest.importorskip(library),
        room=where,
        right=right,
    )


def solved(name: str) -> Any:
    return reconstruct_recording(SKIN, TWO, name, overwrite=True, **FAST)


def moved_out(fails: bool) -> Any:
    """A store that is complete and cannot be moved to its name."""
    import errno
    import os

    target, rename = Path("t.zarr").resolve(), os.replace

    def replace(a: Any, b: Any, *rest: Any) -> Any:
        if fails and Path(b).resolve() == target:
            raise OSError(errno.ENOSPC, "No space left on device")
        return rename(a, b, *rest)

    with mock.patch.object(os, "replace", replace):
        return solved("t.zarr")


def packet(begin: bytes = b"PLP1", cut_off: int = 0, body: bytes = b"{}") -> bytes:
    import struct

    held = begin + struct.pack("<I", len(body)) + body + np.zeros(4, dtype="<f4").tobytes()
    return held[: len(held) - cut_off]


def mcap_of(name: str, encoding: str = "json", data: bytes = b"{}", schema: str = "jsonschema") -> None:
    """A message as a program writes it that has nothing to do with ROS."""
    pytest.importorskip("mcap")
    from mcap.writer import Writer

    with Path(name).open("wb") as file:
        writer = Writer(file)
        writer.start()
        words = "float32[] data" if schema == "ros2msg" else "{}"
        kind = writer.register_schema(name="pkg/msg/Skin", encoding=schema, data=words.encode())
        channel = writer.register_channel(topic="/skin", message_encoding=encoding, schema_id=kind)
        writer.add_message(channel, log_time=0, data=data, publish_time=0)
        writer.finish()


def of_topic(name: str) -> Any:
    return read_recording(name, mapping=TopicMapping(topic="/skin", channels=["stress_zz"], path="data"))


def numbers(*values: float) -> bytes:
    """A list of single precision in CDR."""
    import struct

    return b"\0\1\0\0" + struct.pack("<I", len(values)) + struct.pack(f"<{len(values)}f", *values)


def bag(name: str) -> Any:
    return read_recording(name, mapping=TopicMapping(**MESSAGES))


def torn_bag(message: bool) -> None:
    import contextlib as c
    import sqlite3

    robot("good")
    robot("bad")
    path = next(Path("bad").glob("*.db3"))
    if not message:
        path.write_bytes(b"no database" * 50)
        return
    with c.closing(sqlite3.connect(path)) as base, base:
        base.execute("update messages set data = x'000100'")


def five(got: Any) -> bool:
    return float(np.ravel(got.readings)[-1]) == 5000.0


REMEDIES = [
    of_recording("not a palpate recording: it lacks {} (it holds {})", lambda held: held.drop_vars("time")),
    of_recording("meta cannot be read; the file may be truncated", lambda held: held.assign_attrs(meta="[")),
    of_touch("not a whole palpate result: it lacks", lambda held: held.drop_vars("component")),
    of_touch("does not lie on a surface of", longer),
    of_touch(
        "the methods that found its frames are not all listed", lambda held: held.assign_attrs(methods='["tikhonov"]')
    ),
    of_touch("where its picture lies cannot be read", lambda held: seen(held, '{"a": 1}')),
    of_touch("its attributes cannot be read", lambda held: held.assign_attrs(methods="[")),
    of_touch("the case of its error bars cannot be read", lambda held: held.assign_attrs(case='{"a": 1}')),
    of_touch("its surface cannot be read", lambda held: held.assign_attrs(surface="[")),
    value(
        "{} cannot be read; the file may be truncated.",
        meta,
        '{"a": "b',
        '{"a": "b"}',
        room="recordings.checked",
        right=lambda got: got.meta["a"] == "b",
    ),
    # files
    copies("its header claims {} bytes of numbers", claimed, "recordings.checked", needs="h5py"),
    copies(
        "claims {} numbers, but {} bytes are there",
        bomb,
        "recordings.npz",
        name="bad.npz",
        good="good.npz",
        whole=lambda: None,
    ),
    copies(
        "not a palpate recording: it lacks",
        lambda: hdf(readings=np.zeros((2, 2, 9)), time=np.zeros(2)),
        "recordings.netcdf",
        needs="h5py",
    ),
    copies(
        "cannot be read as {}; it is damaged or something else",
        lambda: Path("bad.zarr").mkdir(),
        "recordings.formats",
        name="bad.zarr",
        good="good.zarr",
        needs="zarr",
    ),
    copies("it lacks", without_time, "recordings.zarrstore", name="bad.zarr", good="good.zarr"),
    copies(
        "blocks are claimed, but {} are there",
        without_blocks,
        "recordings.zarrstore",
        name="bad.zarr",
        good="good.zarr",
    ),
    copies("cannot be read as a Zarr store", other_text, "recordings.zarrstore", name="bad.zarr", good="good.zarr"),
    copies(
        "holds no touches that can be read",
        lambda: other_text(write=touches),
        "recordings.zarrstore",
        whole=lambda: touches("good.zarr"),
        read=read_touch,
        name="bad.zarr",
        good="good.zarr",
    ),
    copies(
        "cannot be read as HDF5",
        lambda: (vectors_of("good.h5"), cut("bad.h5", "good.h5")),
        "recordings.tables",
        whole=lambda: None,
        read=vectors,
        name="bad.h5",
        good="good.h5",
    ),
    copies(
        "messages are {} in {}; readings are taken from ROS 2 messages (cdr) and Protobuf",
        lambda: mcap_of("bad.mcap"),
        "recordings.mcapfile",
        whole=lambda: mcap_of("good.mcap", "cdr", numbers(1.0, 2.0), "ros2msg"),
        read=of_topic,
        name="bad.mcap",
        good="good.mcap",
        needs="rosbags",
    ),
    copies(
        "a message of {} cannot be read ({}); it is damaged",
        lambda: mcap_of("bad.mcap", "cdr", numbers(1.0, 2.0)[:-5], "ros2msg"),
        "recordings.mcapfile",
        whole=lambda: mcap_of("good.mcap", "cdr", numbers(1.0, 2.0), "ros2msg"),
        read=of_topic,
        name="bad.mcap",
        good="good.mcap",
        needs="rosbags",
    ),
    copies(
        "cannot be read as a bag",
        lambda: torn_bag(False),
        "recordings.robots",
        whole=lambda: None,
        read=bag,
        name="bad",
        good="good",
        needs="rosbags",
    ),
    copies(
        "a message of {} cannot be read",
        lambda: torn_bag(True),
        "recordings.robots",
        whole=lambda: None,
        read=bag,
        name="bad",
        good="good",
        needs="rosbags",
    ),
    copies(
        ": no such file.",
        lambda: robot("good"),
        "recordings.robots",
        whole=lambda: None,
        read=lambda name: list(frames(name, TopicMapping(**MESSAGES))),
        name="bad",
        good="good",
        needs="rosbags",
    ),
    # pictures and fields
    copies(
        "cannot be read as TIFF",
        lambda: (tiff(), Path("bad.tif").write_bytes(b"no picture")),
        "microscopy.pictures",
        whole=lambda: None,
        read=read_picture,
        name="bad.tif",
        good="good.tif",
        needs="cv2",
    ),
    copies(
        "cannot be read as TIFF",
        lambda: (pair_of_fields(), Path("bad.tif").write_bytes(b"no field")),
        "microscopy.readers",
        whole=lambda: None,
        read=field,
        name="bad.tif",
        good="good.tif",
    ),
    copies(
        "cannot be read as .npz",
        lambda: (np.savez("good.npz", u=np.ones((8, 8)), v=np.ones((8, 8))), cut("bad.npz", "good.npz")),
        "microscopy.readers",
        whole=lambda: None,
        read=field,
        name="bad.npz",
        good="good.npz",
    ),
    # packets of the live page
    value("not a palpate packet: it does not begin with PLP1", unpacked, packet(b"PLP0"), packet()),
    value("an incomplete palpate packet of {} bytes", unpacked, packet(cut_off=3), packet()),
    value("a palpate packet whose numbers are not JSON", unpacked, packet(body=b"{]"), packet()),
    # disks and folders
    closed("s.nc"),
    closed("s.mcap"),
    value(
        "messages keep times from 0 on",
        lambda time: timed(time),
        -1.0,
        0.0,
        given=lambda: pytest.importorskip("mcap"),
        right=right,
    ),
    Remedy(
        "cannot write there ({}).",
        lambda: write_recording(TWO, 300 * "r" + ".nc"),
        lambda: (write_recording(TWO, "r.nc"), read_recording("r.nc"))[1],
        room="recordings.files",
        right=right,
    ),
    Remedy(
        "cannot write there ({}).",
        lambda: record(300 * "r" + ".mcap"),
        lambda: record("r.mcap"),
        given=lambda: pytest.importorskip("mcap"),
        room="recordings.mcapfile",
        right=right,
    ),
    value(
        "cannot make the folder ({}).",
        make_folder,
        Path("taken/new"),
        Path("new"),
        given=lambda: Path("taken").write_text("x"),
        room="cli.files",
        right=lambda folder: folder.is_dir(),
    ),
    Remedy(
        "is a file; give a folder",
        lambda: reported("taken"),
        lambda: reported("new"),
        given=lambda: Path("taken").write_text("x"),
        room="paper.page",
    ),
    Remedy(
        "cannot make the folder ({}).",
        lambda: reported("taken/new"),
        lambda: reported("new"),
        given=lambda: Path("taken").write_text("x"),
        room="paper.page",
    ),
    full(
        "writing failed ({}); nothing was written",
        lambda: (write_recording(TWO, "r.npz"), read_recording("r.npz")),
        "recordings.files",
    ),
    value(
        "writing failed ({}); what was written is in {}",
        moved_out,
        True,
        False,
        given=lambda: pytest.importorskip("zarr"),
        room="recordings.files",
        slow=True,
    ),
    full("writing failed ({})", lambda: solved("t.zarr"), "recordings.touchstream", limit=0, needs="zarr"),
    at_the_end("writing failed ({}); {}.", "s.zarr", "recordings.stores", 0),
    at_the_end("writing failed ({}); {}.", "s.mcap", "recordings.mcapfile", 64),
]


def timed(time: float) -> Any:
    name = f"{abs(time)}.mcap"
    with recorder(name, ["stress_xz", "stress_zz"]) as out:
        out.readings(time, PRESS)
    return read_recording(name)


def reported(folder: str) -> Any:
    """The page of the founding paper, whose figures take minutes: here it is stopped when its folder is there."""

    class Enough(Exception):
        pass

    def enough(_: str) -> None:
        raise Enough

    with contextlib.suppress(Enough):
        report(folder, progress=enough)
    return Path(folder).is_dir() or pytest.fail("no folder")
