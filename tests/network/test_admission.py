"""Which frames are taken: restarts, jumps, replays, two senders. The clock of the listener is given, so nothing waits."""

from __future__ import annotations

import struct

import numpy as np
import pytest

import palpate as pp
from palpate.network import Admission, Limits, frame_bytes, frame_from_bytes

SHAPE = (3, 6, 4)
HERE, THERE = "127.0.0.1:5000", "127.0.0.1:6000"


class Wire:
    """Offers frames and keeps what came out; 100 frames a second."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.admission = Admission(SHAPE, Limits(), self.said.append)
        self.now = 1000.0
        self.taken: list[tuple[int, float, float]] = []

    def send(self, sequence: int, time: float, value: float = 0.0, *, sender: str = HERE, after: float = 0.01) -> str:
        self.now += after
        result, found = self.admission.offer(sender, frame_bytes(sequence, time, np.full(SHAPE, value)), self.now)
        self.taken += [(session, stamp, float(values.flat[0])) for session, stamp, values in found]
        return result

    def stream(self, first: int, count: int, start: float, *, value: float = 0.0, sender: str = HERE) -> list[str]:
        return [self.send(first + i, start + 0.01 * i, value, sender=sender) for i in range(count)]

    @property
    def counts(self) -> dict[str, int]:
        return {k: v for k, v in self.admission.counts.items() if v}


def test_a_sensor_that_restarts_is_served_again_and_nothing_is_lost() -> None:
    wire = Wire()
    wire.stream(5000, 50, 80.0)
    assert wire.stream(0, 50, 0.0, value=1.0)[:4] == ["jump", "jump", "frames", "frames"]
    assert wire.counts == {"frames": 100, "sessions": 2}
    assert [(s, v) for s, _, v in wire.taken] == [(1, 0.0)] * 50 + [(2, 1.0)] * 50
    np.testing.assert_allclose([t for _, t, _ in wire.taken[50:]], 0.01 * np.arange(50))
    assert "began again: sequence 2 at 0.02 s after 5049 at 80.49 s" in wire.said[-1]


def test_a_sensor_that_restarts_after_few_frames_is_served_again() -> None:
    """Its sequence is then hardly behind: late, unless nothing came for a while."""
    wire = Wire()
    wire.stream(0, 5, 0.0)
    wire.now += 3.0
    wire.stream(0, 20, 0.0)
    assert wire.counts == {"frames": 25, "sessions": 2}


def test_a_sensor_that_restarts_at_once_is_served_after_a_moment() -> None:
    """A run of late frames with none of the old session between is a restart too; 17 are lost, said and counted."""
    wire = Wire()
    wire.stream(0, 60, 0.0)
    wire.stream(0, 60, 0.0, value=1.0)
    assert wire.counts == {"frames": 60 + 43, "sessions": 2, "late": 17}
    assert [v for _, _, v in wire.taken] == [0.0] * 60 + [1.0] * 43


@pytest.mark.parametrize(
    ("sequence", "time"), [(10, 1e9), (10, -1e9), (2**31 + 500, 0.1), (2**32 - 1, 0.1), (10, 8e9), (4_000_000, 5e8)]
)
def test_one_wild_datagram_does_not_end_the_stream(sequence: int, time: float) -> None:
    wire = Wire()
    wire.stream(0, 10, 0.0)
    assert wire.send(sequence, time) in ("jump", "late")
    assert wire.stream(10, 50, 0.1) == ["frames"] * 50
    assert wire.counts["sessions"] == 1


def test_a_wild_first_datagram_does_not_keep_the_sensor_out() -> None:
    wire = Wire()
    wire.send(4_000_000_000, 8e9)
    wire.stream(0, 50, 0.0)
    assert wire.counts == {"frames": 51, "sessions": 2}


@pytest.mark.parametrize("time", [1e300, -1e300, float(np.nextafter(2.0**33, np.inf)), 1.7e18, np.inf, np.nan])
def test_times_that_are_not_seconds_are_malformed(time: float) -> None:
    wire = Wire()
    wire.stream(0, 10, 0.0)
    data = bytearray(frame_bytes(10, 0.1, np.zeros(SHAPE)))
    data[8:16] = struct.pack("<d", time)
    assert wire.admission.offer(HERE, bytes(data), wire.now) == ("malformed", [])
    assert wire.stream(10, 5, 0.1) == ["frames"] * 5
    with pytest.raises(pp.InvalidInput, match="seconds"):
        frame_from_bytes(bytes(data))
    with pytest.raises(pp.InvalidInput, match="seconds"):
        frame_bytes(0, time, np.zeros(SHAPE))


def test_a_clock_that_is_set_begins_a_session_and_loses_nothing() -> None:
    """NTP, or a clock that starts with the process: sequence on, time back or far ahead."""
    for start in (-100.0, 1.7e9):
        wire = Wire()
        wire.stream(0, 10, 0.0)
        wire.stream(10, 10, start)
        assert wire.counts == {"frames": 20, "sessions": 2}
        assert [round(t - start, 6) for _, t, _ in wire.taken[10:]] == [round(0.01 * i, 6) for i in range(10)]


def test_the_sequence_wraps_around() -> None:
    wire = Wire()
    assert wire.stream(2**32 - 5, 20, 0.0) == ["frames"] * 20
    assert wire.counts["sessions"] == 1


def test_copies_replays_and_frames_out_of_order_are_late() -> None:
    wire = Wire()
    wire.stream(0, 100, 0.0)
    for sequence in (99, 98, 50, 0, 97, 98, 99):
        assert wire.send(sequence, 0.01 * sequence) == "late"
    # replayed between the frames of the running session
    for i in range(100, 130):
        assert wire.send(i, 0.01 * i) == "frames"
        assert wire.send(i - 100, 0.01 * (i - 100)) == "late"
    assert wire.counts == {"frames": 130, "sessions": 1, "late": 37}


def test_old_frames_far_back_between_those_of_the_session_change_nothing() -> None:
    wire = Wire()
    wire.stream(100_000, 10, 1000.0)
    for i in range(30):
        assert wire.send(100_010 + i, 1000.1 + 0.01 * i) == "frames"
        assert wire.send(i, 0.01 * i) == "jump"
    assert wire.counts == {"frames": 40, "sessions": 1, "jump": 30}


def test_frames_lost_and_pauses_are_no_restart() -> None:
    wire = Wire()
    wire.stream(0, 10, 0.0)
    assert wire.send(500, 5.0) == "frames"
    assert wire.send(501, 605.0, after=600.0) == "frames"
    assert wire.counts == {"frames": 12, "sessions": 1}


def test_a_slow_recording_sent_fast_is_taken() -> None:
    """A frame a minute, all at once: two are held until the pace is known, and then taken as well."""
    wire = Wire()
    for i in range(20):
        wire.send(i, 60.0 * i)
    assert wire.counts == {"frames": 20, "sessions": 2}


def test_two_senders_never_mix() -> None:
    wire = Wire()
    for i in range(200):
        wire.send(i, 0.01 * i, 1.0, after=0.005)
        assert wire.send(i, 0.01 * i, 2.0, sender=THERE, after=0.005) == "busy"
    assert {v for _, _, v in wire.taken} == {1.0}
    assert wire.counts == {"frames": 200, "sessions": 1, "busy": 200}
    # said, not two hundred times
    assert [t for t in wire.said if "busy" in t] == [
        f"sender {THERE} refused (busy): one sender is accepted at a time, now {HERE}; each sender must use a single socket"
    ]
    # the first ends; the other is served
    wire.now += 1.0
    assert wire.stream(200, 10, 2.0, value=2.0, sender=THERE) == ["frames"] * 10
    assert f"{HERE} was silent" in wire.said[-1]


def test_two_slow_senders_soon_stop_taking_turns() -> None:
    """Each is silent for longer than it takes to give way; the one served is waited for longer and longer."""
    wire = Wire()
    who = [wire.send(i // 2, 1.1 * i, sender=(HERE, THERE)[i % 2], after=1.1) for i in range(60)]
    assert "busy" in who
    assert wire.counts["sessions"] < 12
    last = wire.taken[-1][0]
    assert wire.taken[-20][0] == last


def test_a_connection_that_ends_makes_room_at_once() -> None:
    wire = Wire()
    wire.stream(0, 5, 0.0)
    wire.admission.gone(THERE)
    assert wire.admission.sender == HERE
    wire.admission.gone(HERE)
    assert wire.send(0, 0.0, sender=THERE) == "frames"


def test_another_shape_with_as_many_values_is_refused_by_name() -> None:
    wire = Wire()
    for shape in ((3, 4, 6), (6, 3, 4), (3, 24), (3, 1, 24), (3, 24, 1), (4, 6, 3), (0, 6, 4), (1, 72)):
        assert wire.admission.offer(HERE, frame_bytes(0, 0.0, np.zeros(shape)), 0.0) == ("shape", [])
    assert wire.said == [
        f"sender {HERE} refused (shape): a frame of 3 x 4 x 6 came, 3 x 6 x 4 (channel x row x column) is expected"
    ]
    row = Admission((3, 24))
    assert row.offer(HERE, frame_bytes(0, 0.0, np.zeros((3, 24))), 0.0)[0] == "frames"
    for shape in ((3, 6, 4), (3, 24, 1)):
        assert row.offer(HERE, frame_bytes(0, 0.0, np.zeros(shape)), 0.0)[0] == "shape"


def test_big_endian_numbers_are_refused_by_name() -> None:
    values = np.arange(72, dtype=">f4").reshape(SHAPE)
    data = struct.pack(">4sIdHHH", b"PLPF", 1, 0.5, *SHAPE) + values.tobytes()
    wire = Wire()
    assert wire.admission.offer(HERE, data, 0.0) == ("big-endian", [])
    with pytest.raises(pp.InvalidInput, match="little-endian"):
        frame_from_bytes(data)
    # arrays of this order are honoured when a frame is made of them
    np.testing.assert_array_equal(frame_from_bytes(frame_bytes(0, 0.0, values))[2], values.astype(float))


def test_masked_values_are_missing_on_the_wire() -> None:
    masked = np.ma.masked_array(np.ones((1, 3)), mask=[[False, True, False]])
    for readings in (masked, [masked[0]]):
        np.testing.assert_array_equal(frame_from_bytes(frame_bytes(0, 0.0, readings))[2], [[[1.0, np.nan, 1.0]]])


@pytest.mark.parametrize("readings", [[[1e300, 1.0]], [[1.0], [1.0, 2.0]], [[1j]]])
def test_what_is_no_frame_is_refused_before_it_is_sent(readings: list) -> None:
    """A number beyond single precision was sent as infinite; rows of different lengths were a ValueError."""
    with pytest.raises(pp.InvalidInput, match="frame"):
        frame_bytes(0, 0.0, readings)


@pytest.mark.parametrize("values", [np.zeros((1, 2), complex), np.array([["a"]]), np.zeros((1, 2), bool)])
def test_frames_are_of_real_numbers(values: np.ndarray) -> None:
    with pytest.raises(pp.InvalidInput, match="real numbers"):
        frame_bytes(0, 0.0, values)


def test_a_frame_too_long_for_its_header_is_refused() -> None:
    with pytest.raises(pp.InvalidInput, match="65535"):
        frame_bytes(0, 0.0, np.zeros((1, 2**16)))


def test_a_random_wire_never_stops() -> None:
    """Whatever comes, a sensor that goes on sending is served in the end, its frames in order and of no one else."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        wire = Wire()
        for _ in range(200):
            time = float(rng.choice([rng.normal(0, 1), rng.normal(0, 1e3), 8e9, -8e9]))
            sequence = int(rng.choice([rng.integers(100), rng.integers(2**32)]))
            wire.send(sequence, time, -1.0, sender=str(rng.choice([HERE, THERE])), after=float(rng.exponential(0.3)))
        before = dict(wire.admission.counts)
        assert sum(before.values()) - before["sessions"] == 200
        wire.now += 60.0  # the longest that another sender is waited for
        wire.taken.clear()
        wire.stream(0, 100, 0.0, value=1.0)
        found = [t for _, t, v in wire.taken if v == 1.0]
        assert len(found) >= 98
        assert found == sorted(found)


@pytest.mark.parametrize("given", [{"silence": 0.0}, {"idle": float("nan")}, {"connections": 1}, {"connections": 2.5}])
def test_limits_are_checked(given: dict[str, float]) -> None:
    with pytest.raises(pp.InvalidInput):
        Limits(**given)  # type: ignore[arg-type]


def test_the_shape_is_checked() -> None:
    with pytest.raises(pp.InvalidInput, match="shape"):
        Admission((3,))
