"""A small seeded part of the table that benchmarks/network.py makes: nothing foreign is taken, nothing good is lost, all live on."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from palpate.network.waiting import WAITING

TABLE = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "network.py"))
CASES = [(name, kind) for name, (_, kinds) in TABLE["CASES"].items() for kind in kinds]
#: These wait for silence or connect hundreds of times.
QUICK = ("malformed", "far ahead", "clock set", "copies, replays", "two senders")


@pytest.mark.parametrize(
    ("name", "kind"),
    [pytest.param(*c, marks=() if c[0] in QUICK and c[1] != "ws" else pytest.mark.long) for c in CASES],
)
def test_senders_of_every_sort(name: str, kind: str) -> None:
    if kind == "ws":
        pytest.importorskip("websockets")
    row = TABLE["run"](name, kind, 90, 1)
    assert row["alive"], row
    # a flipped bit may make another good frame; a sensor that restarts at once loses up to 19 frames, said
    damaged = name in ("flipped bits", "restarted")
    assert row["foreign"] == 0 or name == "flipped bits", row
    # where the machine pauses and a burst comes in at once, the listener lets the oldest waiting frames go, and counts them
    assert row["taken"] + row["refused"].get("dropped", 0) == row["good"] or damaged, row
    assert row["taken"] >= (1 if damaged else min(WAITING, row["good"])), row
