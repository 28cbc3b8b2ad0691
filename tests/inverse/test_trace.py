"""Whoever asks why a frame was taken for what it is gets the decisions and their numbers."""

from __future__ import annotations

import logging
import math

import numpy as np
import pytest

import palpate as pp
from palpate.inverse import traced


@pytest.mark.long
def test_the_log_tells_what_was_tried_and_by_which_numbers(caplog: pytest.LogCaptureFixture) -> None:
    array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=20.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    readings = np.asarray(
        skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.3), rng=np.random.default_rng(0))
    )
    with caplog.at_level(logging.DEBUG, "palpate.contact"):
        skin.reconstruct(readings + 1000.0)
    log = caplog.text
    for words in (
        "contact over noise alone",
        "push: push: worth",
        "offsets: push, offset of stress_zz",
        "best of these",
        "misfit",
    ):
        assert words in log, log
    with caplog.at_level(logging.DEBUG, "palpate.contact"), traced() as trace:
        caplog.clear()
        skin.reconstruct(readings + 1000.0)
    assert trace.lines == [record.getMessage() for record in caplog.records]
    caplog.clear()
    skin.reconstruct(readings)
    assert not caplog.records  # nobody asked


def test_a_trace_tells_why_an_explanation_won() -> None:
    array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=20.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    rng = np.random.default_rng(0)
    readings = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.3), rng=rng))
    with traced() as trace:
        skin.reconstruct(readings + 1000.0)
        with traced() as empty:
            skin.reconstruct(20.0 * rng.standard_normal(readings.shape))
    alone, *others = trace.tried
    best = max(others, key=lambda tried: tried.worth)
    assert (alone.explanation, best.proposal, best.price) == ("push", "offsets", 3.0)
    for one in trace.tried:
        assert one.worth == pytest.approx(one.free * math.log(one.total / one.left) - one.price)
    lead = best.worth - alone.worth
    assert f"({lead:.1f}" in str(trace).replace("worth ", "")
    assert empty.tried == []
    assert "solved: no contact" in empty.lines
    assert trace.lines[-len(empty.lines) :] == empty.lines  # of both frames
