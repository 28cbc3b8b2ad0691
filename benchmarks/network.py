"""What a listener does with malformed, restarted, slow and dead senders: frames sent, taken, refused by name, and whether it lives on.

python benchmarks/network.py [--frames 500] [--seed 0] [--only WORD]

Every case has its own listener on 127.0.0.1 and nothing leaves this machine. "good" are frames that a user would want, sent by the sender
that should be served; "alive" says whether a fresh sender with sequence 0 and time 0 is served afterwards. Prints a table; the last line
is the same as JSON.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import socket
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from palpate.network import FrameListener

SHAPE = (3, 6, 4)
#: Values of a frame that must not be taken.
FOREIGN = -1.0
#: Between frames [s].
STEP = 0.002


def frame(sequence: int, stamp: float, value: float = 0.0, shape: tuple[int, ...] = SHAPE) -> bytes:
    """As `palpate.network.frame_bytes`, which refuses some of what is sent here."""
    head = struct.pack("<4sIdHHH", b"PLPF", sequence % 2**32, stamp, *shape)
    return head + np.full(shape, value, dtype="<f4").tobytes()


class Case:
    """One listener, and what is sent to it."""

    def __init__(self, kind: str, frames: int, seed: int) -> None:
        self.listener = FrameListener(SHAPE, kind=kind)
        self.kind, self.frames, self.rng = kind, frames, np.random.default_rng(seed)
        self.sent = self.good = 0
        self.stack = contextlib.ExitStack()

    def sender(self) -> Callable[[bytes], None]:
        """Sends messages from an address, or by a connection, of its own."""
        if self.kind == "ws":
            from websockets.sync.client import connect

            line = self.stack.enter_context(connect(f"ws://127.0.0.1:{self.listener.port}", compression=None))
            send: Callable[[bytes], Any] = line.send
        else:
            form = socket.SOCK_DGRAM if self.kind == "udp" else socket.SOCK_STREAM
            plain = self.stack.enter_context(socket.socket(socket.AF_INET, form))
            plain.connect(("127.0.0.1", self.listener.port))
            tcp = self.kind == "tcp"

            def send(data: bytes) -> None:
                plain.sendall(struct.pack("<I", len(data)) + data if tcp else data)

        def counted(data: bytes) -> None:
            self.sent += 1
            with contextlib.suppress(Exception):  # the listener may have closed it, which is the point
                send(data)
            time.sleep(STEP)

        return counted

    def raw(self) -> socket.socket:
        return self.stack.enter_context(socket.create_connection(("127.0.0.1", self.listener.port)))

    def stream(self, send: Callable[[bytes], None], count: int, *, sequence: int = 0, start: float = 0.0) -> None:
        """Frames that should be taken."""
        for i in range(count):
            send(frame(sequence + i, start + 0.01 * i))
        self.good += count


def malformed(case: Case) -> None:
    """Noise, cut frames, frames without a time, of another shape, big-endian: each from a sender of its own, between good ones."""
    send = case.sender()
    for i in range(case.frames):
        good = frame(i, 0.01 * i, FOREIGN)
        junk = [
            case.rng.bytes(int(case.rng.integers(1, 400))),
            good[: int(case.rng.integers(1, len(good)))],
            frame(i, float("nan"), FOREIGN),
            frame(i, 0.01 * i, FOREIGN, (3, 4, 6)),
            struct.pack(">4sIdHHH", b"PLPF", i, 0.01 * i, *SHAPE) + good[22:],
            good + bytes(99),
        ][i % 6]
        with contextlib.ExitStack() as case_stack:
            outer, case.stack = case.stack, case_stack
            with contextlib.suppress(Exception):
                case.sender()(junk)
            case.stack = outer
        case.stream(send, 1, sequence=i, start=0.01 * i)


def flipped(case: Case) -> None:
    """Good frames with one bit of the header's sequence or time flipped now and then: damage in the sender itself."""
    send = case.sender()
    for i in range(case.frames):
        if i % 10 == 9:
            data = bytearray(frame(i, 0.01 * i, FOREIGN))
            data[int(case.rng.integers(4, 16))] ^= 1 << int(case.rng.integers(8))
            send(bytes(data))
        case.stream(send, 1, sequence=i, start=0.01 * i)


def restarted(case: Case) -> None:
    """The same address begins again from sequence 0 and time 0, five times (a microcontroller with a fixed port)."""
    send = case.sender()
    for _ in range(5):
        case.stream(send, case.frames // 5)


def far_ahead(case: Case) -> None:
    """One datagram with time 1e300, one with time 1e9, one with a sequence far ahead; the stream goes on."""
    send = case.sender()
    case.stream(send, case.frames // 2)
    n = case.frames // 2
    send(frame(n, 1e300, FOREIGN))
    send(frame(n, 1e9, FOREIGN))
    send(frame(2**31 - 5, 0.01 * n, FOREIGN))
    case.stream(send, case.frames - n, sequence=n, start=0.01 * n)


def clock_set(case: Case) -> None:
    """The sender's clock is set back by an hour, and later forward by a year."""
    send = case.sender()
    third = case.frames // 3
    for i, start in enumerate((4000.0, 400.0, 3.2e7)):
        case.stream(send, third, sequence=i * third, start=start)


def replayed(case: Case) -> None:
    """Every frame comes twice, and an old one with it."""
    send = case.sender()
    for i in range(case.frames // 3):
        case.stream(send, 1, sequence=i, start=0.01 * i)
        send(frame(i, 0.01 * i, FOREIGN))
        send(frame(i // 2, 0.01 * (i // 2), FOREIGN))


def wrapped(case: Case) -> None:
    """The sequence passes 2**32."""
    case.stream(case.sender(), case.frames, sequence=2**32 - case.frames // 2)


def two_senders(case: Case) -> None:
    """A second sender sends all the time, with sequences and times in step with the first."""
    send = case.sender()
    case.stream(send, 5)
    other = case.sender()
    for i in range(5, case.frames // 2):
        case.stream(send, 1, sequence=i, start=0.01 * i)
        other(frame(i, 0.01 * i + 0.005, FOREIGN))


def dead(case: Case) -> None:
    """A sender stops without a word, its socket open; its successor begins two seconds later."""
    send = case.sender()
    case.stream(send, case.frames // 2, start=100.0)
    time.sleep(2.0)
    case.stream(case.sender(), case.frames // 2)


def slow(case: Case) -> None:
    """Twenty connections send two bytes and wait; then a sensor comes."""
    for _ in range(20):
        with contextlib.suppress(OSError):
            case.raw().sendall(b"\x01\x00")
    time.sleep(0.5)
    case.stream(case.sender(), case.frames // 2)


def crowd(case: Case) -> None:
    """Two hundred connections that say nothing, while a sensor sends."""
    send = case.sender()
    case.stream(send, 5)
    for i in range(200):
        with contextlib.suppress(OSError):
            case.raw()
        case.stream(send, 1, sequence=5 + i, start=0.05 + 0.01 * i)


CASES: dict[str, tuple[Callable[[Case], None], tuple[str, ...]]] = {
    "malformed": (malformed, ("udp", "tcp", "ws")),
    "flipped bits": (flipped, ("udp", "tcp", "ws")),
    "restarted": (restarted, ("udp", "tcp", "ws")),
    "far ahead": (far_ahead, ("udp", "tcp", "ws")),
    "clock set": (clock_set, ("udp", "tcp", "ws")),
    "copies, replays": (replayed, ("udp", "tcp", "ws")),
    "sequence wraps": (wrapped, ("udp", "tcp", "ws")),
    "two senders": (two_senders, ("udp", "tcp", "ws")),
    "dead, socket open": (dead, ("udp", "tcp", "ws")),
    "slow (two bytes)": (slow, ("tcp", "ws")),
    "crowd": (crowd, ("tcp", "ws")),
}


def run(name: str, kind: str, frames: int, seed: int) -> dict[str, Any]:
    """One row of the table."""
    case = Case(kind, frames, seed)
    taken: list[float] = []

    def drain() -> None:
        for _, values in case.listener:
            taken.append(float(values.flat[0]))

    import threading

    reader = threading.Thread(target=drain, daemon=True)
    reader.start()
    try:
        with case.stack:
            with contextlib.suppress(Exception):  # a sender that cannot even connect has sent nothing
                CASES[name][0](case)
            found = None
            while found is None or len(found) < len(taken):  # a busy machine needs longer to hand over what has come
                found = list(taken)
                time.sleep(0.2)
            refused = {k: v for k, v in case.listener.counts.items() if v and k not in ("frames", "sessions")}
            alive = lives(case, taken)
    finally:
        case.listener.close()
        reader.join(timeout=5)
    good = sum(v != FOREIGN for v in found)
    return {
        "case": name, "kind": kind, "sent": case.sent, "good": case.good, "taken": good, "foreign": len(found) - good,
        "refused": refused, "alive": alive,
    }  # fmt: skip


def lives(case: Case, taken: list[float]) -> bool:
    """Whether a fresh sender is served within three seconds."""
    with contextlib.suppress(Exception):
        send = case.sender()
        for i in range(60):
            send(frame(i, 0.01 * i, 7.0))
            if 7.0 in taken:
                return True
            time.sleep(0.05)
    return False


def rows(frames: int, seed: int, only: str = "") -> Iterator[dict[str, Any]]:
    """All rows whose case or kind holds the word ``only``."""
    for name, (_, kinds) in CASES.items():
        for kind in kinds:
            if only in f"{name} {kind}":
                yield run(name, kind, frames, seed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    found = []
    print(
        "| case | by | sent | good | taken | not meant, taken | refused by name | alive after |\n|---|---|---|---|---|---|---|---|"
    )
    for row in rows(args.frames, args.seed, args.only):
        found.append(row)
        refused = ", ".join(f"{v} {k}" for k, v in row["refused"].items()) or "-"
        print(
            f"| {row['case']} | {row['kind']} | {row['sent']} | {row['good']} | {row['taken']} | {row['foreign']} | {refused} | "
            f"{'yes' if row['alive'] else 'NO'} |",
            flush=True,
        )
    print(json.dumps(found))


if __name__ == "__main__":
    main()
