"""Every source into every sink and back; sinks that are killed, full or misused."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from test_network import sending

import palpate as pp
from command_line import CliRunner
from long_runs import long_runs
from palpate import solutions
from palpate.cli import app
from palpate.grasp import Event
from palpate.live import FoxgloveServer, Session
from palpate.network import FrameListener, frame_bytes
from palpate.recordings import Sink, read_recording, read_touch, recorder, write_recording, write_touch
from palpate.recordings.mcapfile import CHUNK
from palpate.recordings.stores import BLOCK

for library in ("mcap", "rosbags", "foxglove", "zarr", "websockets"):
    pytest.importorskip(library)

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
ARRAY = pp.AreaArray(shape=(7, 8), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
SKIN = pp.Skin(PAD, ARRAY)
FILES = (".mcap", ".nc", ".zarr")


def stream(count: int = 24) -> pp.Recording:
    """A ball that presses and lifts, in single precision, with uneven times that are whole nanoseconds."""
    rng = np.random.default_rng(0)
    one = np.asarray(SKIN.sense(SKIN.sample(solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.3))))
    load = np.maximum(0.0, np.sin(np.linspace(-0.5, 3.5, count)))
    noisy = load[:, None, None, None] * one + 0.01 * np.abs(one).max() * rng.standard_normal((count, *one.shape))
    return pp.Recording(
        readings=noisy.astype(np.float32),
        channels=tuple(ARRAY.channels),
        time=np.round(np.cumsum(rng.uniform(0.004, 0.006, count)), 9),
        meta={"sensor": "finger 3"},
    )


@pytest.mark.parametrize("suffix", FILES)
def test_a_recorder_keeps_each_frame_as_it_was(tmp_path: Path, suffix: str) -> None:
    """Every frame of a block was the last one, if the array was reused; the number under a mask was recorded."""
    frame = np.ma.masked_array(np.zeros((1, 4)), mask=[[True, False, False, False]])
    with recorder(tmp_path / f"a{suffix}", ["stress_zz"]) as out:
        for i in range(5):
            frame.data[:] = i
            out.readings(0.1 * i, frame)
    found = np.asarray(read_recording(tmp_path / f"a{suffix}").readings)[:, 0]
    assert np.isnan(found[:, 0]).all()
    np.testing.assert_array_equal(found[:, 1:], np.arange(5.0)[:, None].repeat(3, 1))


# -- sources -----------------------------------------------------------------------------------------------------------


def _file(suffix: str) -> Callable[[pp.Recording, Path], Iterator[tuple[float, Any]]]:
    def frames(data: pp.Recording, folder: Path) -> Iterator[tuple[float, Any]]:
        write_recording(data, folder / f"source{suffix}")
        found = read_recording(folder / f"source{suffix}")
        yield from zip(found.time.tolist(), found.readings)

    return frames


def _bag(data: pp.Recording, folder: Path) -> Iterator[tuple[float, Any]]:
    """A ROS 2 bag of images, as a camera-based sensor's node records it."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind, head, stamp = (store.types[n] for n in ("sensor_msgs/msg/Image", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))  # fmt: skip
    with Writer(folder / "bag", version=9) as writer:
        connection = writer.add_connection("/finger/image", "sensor_msgs/msg/Image", typestore=store)
        for t, values in zip(data.time, data.readings):
            packed = np.ascontiguousarray(np.moveaxis(values, 0, -1)).view(np.uint8).reshape(-1)
            message = kind(
                header=head(stamp=stamp(sec=0, nanosec=0), frame_id=""), height=7, width=8, encoding="32FC3",
                is_bigendian=0, step=96, data=packed,
            )  # fmt: skip
            writer.write(connection, round(1e9 * t), store.serialize_cdr(message, "sensor_msgs/msg/Image"))
    mapping = pp.recordings.TopicMapping(topic="/finger/image", channels=ARRAY.channels)
    found = read_recording(folder / "bag", mapping=mapping)
    yield from zip(found.time.tolist(), found.readings)


def _wire(kind: str) -> Callable[[pp.Recording, Path], Iterator[tuple[float, Any]]]:
    def frames(data: pp.Recording, folder: Path) -> Iterator[tuple[float, Any]]:
        with (
            FrameListener(data.readings.shape[1:], kind=kind) as listener,
            sending(kind, listener.port) as send,
        ):
            taken = iter(listener)
            for i, (t, values) in enumerate(zip(data.time, data.readings)):
                send(frame_bytes(i, float(t), values))
                yield next(taken)

    return frames


def _generator(data: pp.Recording, folder: Path) -> Iterator[tuple[float, Any]]:
    yield from zip(data.time.tolist(), data.readings)


SOURCES: dict[str, Callable[[pp.Recording, Path], Iterator[tuple[float, Any]]]] = {
    **{suffix: _file(suffix) for suffix in (".nc", ".npz", ".csv", ".zarr", ".mcap")},
    "bag": _bag,
    **{kind: _wire(kind) for kind in ("udp", "tcp", "ws")},
    "generator": _generator,
}


class Kept:
    """A sink that keeps what it is given."""

    def __init__(self) -> None:
        self.frames: list[tuple[float, Any]] = []
        self.touches: list[pp.Touch] = []
        self.events: list[Event] = []

    def readings(self, time: float, values: Any) -> None:
        self.frames.append((time, np.array(values)))

    def touch(self, touch: pp.Touch, time: float | None = None) -> None:
        self.touches.append(touch)

    def event(self, event: Event) -> None:
        self.events.append(event)

    def close(self) -> None:
        pass


def run(frames: Iterator[tuple[float, Any]], *sinks: Sink) -> Kept:
    kept = Kept()
    tracker = SKIN.track(friction=0.6)
    session = Session(SKIN, lambda: frames, tracker, pp.GraspMonitor(friction=0.6), pace=False, sinks=(kept, *sinks))
    session.run()
    session.stop()
    assert session.failure is None
    return kept


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_gives_the_frames_that_were_made(tmp_path: Path, source: str) -> None:
    """Bit by bit in single precision; times exactly, or to the nanosecond."""
    data = stream(12)
    found = list(SOURCES[source](data, tmp_path))
    np.testing.assert_array_equal([values for _, values in found], data.readings)
    np.testing.assert_allclose([t for t, _ in found], data.time, rtol=0, atol=1e-9)


#: What comes out of a source is what went in (above), so that one file, one wire and none stand for all by default.
EVERY = [source if source == "generator" else pytest.param(source, marks=pytest.mark.long) for source in SOURCES]


@pytest.mark.parametrize("source", EVERY)
@pytest.mark.long
def test_round_trip_of_every_source_through_every_sink(tmp_path: Path, source: str) -> None:
    """Readings come back bit by bit in single precision; times to the nanosecond (MCAP) or exactly; touches as they were."""
    data = stream()
    sinks = {suffix: recorder(tmp_path / f"out{suffix}", data.channels, meta=data.meta) for suffix in FILES}
    listener, received = viewer()
    kept = run(SOURCES[source](data, tmp_path), *sinks.values(), listener)
    np.testing.assert_array_equal([v for _, v in kept.frames], data.readings)
    stamps = np.array([t for t, _ in kept.frames])
    np.testing.assert_allclose(stamps, data.time - data.time[0], rtol=0, atol=1e-9)
    for suffix in FILES:
        found = read_recording(tmp_path / f"out{suffix}")
        np.testing.assert_array_equal(found.readings, data.readings)
        np.testing.assert_allclose(found.time, stamps, rtol=0, atol=0.51e-9 if suffix == ".mcap" else 0)
        assert found.channels == data.channels
        assert found.meta == data.meta
        # and on into the formats of whole recordings
        for whole in (".npz", ".csv"):
            write_recording(found, tmp_path / f"whole{suffix}{whole}")
            again = read_recording(tmp_path / f"whole{suffix}{whole}")
            np.testing.assert_array_equal(again.readings, found.readings)
            np.testing.assert_array_equal(again.time, found.time)
    for suffix in (".nc", ".zarr"):
        touches = read_touch(tmp_path / f"out{suffix}")
        np.testing.assert_array_equal(
            touches["traction"].values, np.stack([np.asarray(t.values, dtype=np.float32) for t in kept.touches])
        )
        np.testing.assert_array_equal(touches["force"].values, np.stack([t.force for t in kept.touches]))
        np.testing.assert_array_equal(touches["touching"].values, [bool(t.touching) for t in kept.touches])
        np.testing.assert_array_equal(touches["status"].values, [int(t.status) for t in kept.touches])
        assert list(touches["component"].values) == ["x", "y", "z"]
    assert kept.events
    # a viewer that is slow may miss some, but not the last
    seen = received(round(1e9 * stamps[-1]))
    by_time = {round(1e9 * t): v for t, v in kept.frames}
    for when, values in seen.items():
        np.testing.assert_array_equal(values, by_time[when])


#: Seconds that a machine with other things to do may take; nobody waits as long where it goes well.
PATIENCE = 120.0
#: Time of frames that are sent until one comes through [ns]; no frame of a stream has it.
PROBE = 7


def viewer() -> tuple[FoxgloveServer, Callable[[int], dict[int, Any]]]:
    """A Foxglove server, a client that has subscribed to its readings, and what came, by its nanosecond."""
    from rosbags.typesys import Stores, get_typestore
    from websockets.sync.client import connect

    class Lasting(FoxgloveServer):
        """Goes on after the stream has ended."""

        def close(self) -> None:
            pass

    server = Lasting(ARRAY.channels, port=0)
    store = get_typestore(Stores.ROS2_HUMBLE)
    seen: dict[int, Any] = {}
    subscribed = threading.Event()
    # a topic is there once something was sent
    server.readings(0.0, np.zeros((3, 7, 8)))

    def listen() -> None:
        with connect(f"ws://127.0.0.1:{server.port}", subprotocols=["foxglove.sdk.v1"]) as socket:
            for message in socket:
                if isinstance(message, str):
                    for channel in json.loads(message).get("channels", []):
                        if channel["topic"] == "/palpate/readings":
                            assert channel["schemaName"] == "sensor_msgs/msg/Image"
                            wish = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel["id"]}]}
                            socket.send(json.dumps(wish))
                            subscribed.set()
                elif message[0] == 1:
                    image = store.deserialize_cdr(message[13:], "sensor_msgs/msg/Image")
                    values = np.asarray(image.data).view("<f4").reshape(7, 8, 3)
                    seen[struct.unpack("<Q", message[5:13])[0]] = np.moveaxis(values, -1, 0)

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    assert subscribed.wait(PATIENCE)
    # the server has heard of the subscription when the first frame comes through
    deadline = time.monotonic() + PATIENCE
    while PROBE not in seen:
        assert time.monotonic() < deadline
        server.readings(1e-9 * PROBE, np.zeros((3, 7, 8)))
        time.sleep(0.02)

    def received(last: int) -> dict[int, Any]:
        deadline = time.monotonic() + PATIENCE
        while last not in seen and time.monotonic() < deadline:
            time.sleep(0.01)
        FoxgloveServer.close(server)
        thread.join(timeout=PATIENCE)
        assert last in seen
        seen.pop(PROBE)
        return seen

    return server, received


@pytest.mark.long
def test_reference_readers(tmp_path: Path) -> None:
    """h5py, xarray and zarr find what was written, with units, and events as CF flags."""
    import h5py
    import zarr

    data = stream()
    for suffix in (".h5", ".zarr"):
        kept = run(_generator(data, tmp_path), recorder(tmp_path / f"a{suffix}", data.channels))
    names = [e.kind for e in kept.events]
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["readings"][()], data.readings)
        assert file["touch/traction"].attrs["units"] == "Pa"
        meanings = file["events/kind"].attrs["flag_meanings"].split()
        assert [meanings[k].replace("_", " ") for k in file["events/kind"][()]] == names
    root = zarr.open_group(str(tmp_path / "a.zarr"), mode="r")
    np.testing.assert_array_equal(root["readings"][...], data.readings)
    np.testing.assert_array_equal(root["events/began"][...], [e.began for e in kept.events])
    for opened in (
        xarray.open_dataset(tmp_path / "a.h5", engine="h5netcdf", group="touch"),
        xarray.open_zarr(tmp_path / "a.zarr", group="touch", consolidated=False),
    ):
        with opened as touch:
            assert touch["force"].attrs["units"] == "N"
            assert touch.sizes["time"] == len(data.readings)
            low, high = touch["force_low"].values[:, 2], touch["force_high"].values[:, 2]
            assert np.isfinite(low).any()
            assert (low[np.isfinite(low)] < high[np.isfinite(low)]).all()


@pytest.mark.parametrize("suffix", [".nc", *long_runs(".mcap", ".zarr")])
@pytest.mark.long
def test_killed_in_mid_recording(tmp_path: Path, suffix: str) -> None:
    """kill -9: less than a chunk (MCAP) or a block is lost; what is left opens (HDF5, Zarr) or is salvaged (MCAP)."""
    path = tmp_path / f"torn{suffix}"
    code = (
        "import sys, time, numpy as np\n"
        "from palpate.recordings import recorder\n"
        "out = recorder(sys.argv[1], ['stress_xz', 'stress_yz', 'stress_zz'])\n"
        "for i in range(100000):\n"
        "    out.readings(0.005 * i, np.full((3, 32, 32), float(i), dtype=np.float32))\n"
        "    print(i, flush=True)\n"
        "    time.sleep(0.002)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    written = -1
    while written < 100:
        written = int(process.stdout.readline())
    os.kill(process.pid, signal.SIGKILL)
    rest = process.stdout.read().split()
    written = max(written, *(int(v) for v in rest[:-1]), written)
    process.stdout.close()
    process.wait()
    if suffix != ".mcap":
        saved = read_recording(path)
    else:
        with pytest.raises(pp.InvalidInput, match="--salvage"):
            read_recording(path)
        saved = read_recording(path, salvage=True)
    limit = CHUNK // (3 * 32 * 32 * 4) + 2 if suffix == ".mcap" else BLOCK + 1
    assert written - len(saved.readings) <= limit
    np.testing.assert_array_equal(saved.readings[:, 0, 0, 0], np.arange(len(saved.readings)))
    result = CliRunner().invoke(app, ["convert", str(path), str(tmp_path / "saved.npz"), "--salvage"])
    assert result.exit_code == 0, result.output
    assert len(read_recording(tmp_path / "saved.npz").readings) == len(saved.readings)


@pytest.mark.parametrize("suffix", [".nc", *long_runs(".mcap", ".zarr")])
@pytest.mark.long
def test_full_disk(tmp_path: Path, suffix: str) -> None:
    """A write that fails is said in one sentence, and what was written before can be read."""
    path = tmp_path / f"full{suffix}"
    code = (
        "import resource, signal, sys, numpy as np\n"
        "from palpate import InvalidInput\n"
        "from palpate.recordings import recorder\n"
        "sys.dont_write_bytecode = True  # none torn\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "out = recorder(sys.argv[1], ['stress_zz'])\n"
        "rng = np.random.default_rng(0)\n"
        "limit = int(sys.argv[2])\n"
        "try:\n"
        "    for i in range(4000):\n"
        "        if i == 200:\n"
        "            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))\n"
        "        out.readings(0.005 * i, rng.standard_normal((1, 16, 16)).astype(np.float32))\n"
        "except InvalidInput as error:\n"
        "    print(i, error, flush=True)\n"
        "    import os\n"
        "    os._exit(3)\n"
    )
    limit = "500" if suffix == ".zarr" else "600000"
    done = subprocess.run([sys.executable, "-c", code, str(path), limit], capture_output=True, text=True, timeout=120)
    assert done.returncode == 3, done.stdout + done.stderr
    at = int(done.stdout.split()[0])
    assert "writing failed" in done.stdout
    saved = read_recording(path, salvage=True)
    assert at - 2 * max(BLOCK, CHUNK // 1024) <= len(saved.readings) <= at + 1


@pytest.mark.parametrize("suffix", FILES)
def test_misuse(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    out = recorder(path, ["stress_zz"])
    out.readings(0.0, np.zeros((1, 4)))
    with pytest.raises(pp.InvalidInput, match="channels"):
        out.readings(0.1, np.zeros((2, 4)))
    out.readings(0.1, np.ones((1, 4)))
    if suffix != ".mcap":  # whose messages may each have their own shape
        with pytest.raises(pp.InvalidInput, match="follows frames of"):
            out.readings(0.2, np.ones((1, 5)))
    out.readings(0.05, np.full((1, 4), 7.0))  # late
    out.close()
    out.close()
    with pytest.warns(pp.errors.UncheckedInput, match="1 outlier.*All 3 frames are kept"):
        kept = read_recording(path)
    np.testing.assert_allclose(kept.time, [0.0, 0.1, 0.2])
    assert kept.readings[:, 0, 0].tolist() == [0.0, 1.0, 7.0]
    with pytest.raises(pp.InvalidInput, match="not overwritten"):
        recorder(path, ["stress_zz"])
    with pytest.raises(pp.InvalidInput, match=r"cannot write|does not exist"):
        recorder(tmp_path / "no" / f"a{suffix}", ["stress_zz"])
    with pytest.raises(pp.InvalidInput, match="recorded as"):
        recorder(tmp_path / "a.csv", ["stress_zz"])


@pytest.mark.long
def test_a_sink_that_fails_is_left(tmp_path: Path) -> None:
    """The stream and the other sinks go on."""

    class Broken(Kept):
        def touch(self, touch: pp.Touch, time: float | None = None) -> None:
            raise pp.InvalidInput("the wire is cut")

    data, kept = stream(10), Kept()
    tracker = SKIN.track(friction=0.6)
    session = Session(SKIN, lambda: _generator(data, tmp_path), tracker, pp.GraspMonitor(), pace=False, sinks=(Broken(), kept))  # fmt: skip
    session.run()
    session.stop()
    assert session.failure == "the wire is cut"
    assert len(kept.touches) == 10


@pytest.mark.long
def test_whole_results_as_zarr(tmp_path: Path) -> None:
    touch = SKIN.reconstruct(stream(12).readings[5:8], friction=0.6)
    write_touch(touch, tmp_path / "touch.zarr", provenance={"skin": "s"})
    found = read_touch(tmp_path / "touch.zarr")
    np.testing.assert_array_equal(found["traction"].values, touch.values)
    assert found.attrs["skin"] == "s"
    with pytest.raises(pp.InvalidInput, match="not overwritten"):
        write_touch(touch, tmp_path / "touch.zarr")
    assert not list(tmp_path.glob(".palpate-*"))


def test_damaged_stores(tmp_path: Path) -> None:
    with pytest.raises(pp.InvalidInput, match="no such file"):
        read_recording(tmp_path / "none.zarr")
    (tmp_path / "empty.zarr").mkdir()
    with pytest.raises(pp.InvalidInput, match="cannot be read as zarr"):
        read_recording(tmp_path / "empty.zarr")
    write_recording(stream(), tmp_path / "a.zarr")
    (tmp_path / "a.zarr" / "time" / "zarr.json").write_text("{")
    with pytest.raises(pp.InvalidInput, match="Zarr"):
        read_recording(tmp_path / "a.zarr")
    write_recording(stream(), tmp_path / "b.zarr")
    with pytest.raises(pp.InvalidInput, match="no touches"):
        read_touch(tmp_path / "b.zarr")


def test_hostile_viewers() -> None:
    """A thousand malformed, oversized and out-of-order messages to the Foxglove server: it goes on serving, and nothing is taken in."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    rng = np.random.default_rng(0)
    server = FoxgloveServer(ARRAY.channels, port=0)
    where = f"ws://127.0.0.1:{server.port}"
    made: list[str | bytes] = []
    for i in range(1000):
        made.append(
            [
                rng.bytes(int(rng.integers(1, 300))),
                "{" * int(rng.integers(1, 300)),
                json.dumps({"op": "subscribe", "subscriptions": [{"id": i, "channelId": 10_000 + i}]}),
                json.dumps({"op": "unsubscribe", "subscriptionIds": [i]}),
                bytes([1]) + rng.bytes(3),
                json.dumps({"op": "advertise", "channels": [{"id": i, "topic": "x" * 10_000}]}),
                "x" * 200_000 if i % 100 == 6 else "",
            ][i % 7]
        )
    sent = 0
    while sent < len(made):
        with connect(where, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
            try:
                while sent < len(made):
                    socket.send(made[sent])
                    sent += 1
            except ConnectionClosed:
                sent += 1  # it may well hang up
    server.readings(0.5, np.ones((3, 7, 8)))
    with connect(where, subprotocols=["foxglove.sdk.v1"]) as socket:
        seen: set[str] = set()
        while "/palpate/readings" not in seen:
            seen |= {c["topic"] for c in json.loads(socket.recv(timeout=PATIENCE)).get("channels", [])}
    assert seen == {"/palpate/readings"}
    server.close()


def test_rerun_file(tmp_path: Path) -> None:
    """A stream as a file for Rerun's viewer (an extra of its own, `palpate[rerun]`)."""
    pytest.importorskip("rerun", reason="the extra palpate[rerun] is not installed")
    from palpate.live import RerunSink

    run(_generator(stream(), tmp_path), RerunSink(tmp_path / "run.rrd"))
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
    with pytest.raises(pp.InvalidInput, match="not overwritten"):
        RerunSink(tmp_path / "run.rrd")


def test_rerun_says_when_the_stream_is_not_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rerun writes in a thread of its own and fails when it is asked to finish."""
    from types import SimpleNamespace

    from palpate.live.rerun import RerunSink

    class Stream:
        ended = False

        def spawn(self) -> None: ...

        def flush(self) -> None:
            raise RuntimeError("File-writer thread shut down prematurely")

        def disconnect(self) -> None:
            self.ended = True

    stream = Stream()
    monkeypatch.setitem(sys.modules, "rerun", SimpleNamespace(RecordingStream=lambda _: stream))
    with pytest.raises(pp.InvalidInput, match="the viewer: Rerun did not receive the whole stream"):
        RerunSink().close()
    assert stream.ended
