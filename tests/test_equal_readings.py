"""A sensor whose zero is lost, or a picture that moved: every reading is the same."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.trust.rows import make_frame


@pytest.mark.long
def test_readings_that_are_all_alike_are_answered_and_questioned_where_no_offset_takes_them_up() -> None:
    # three displacements of shallow markers explain nothing of it but wide pressure, which came to no rest in four minutes
    frame = make_frame("channel offsets", 7, seed=7741)
    readings = np.full_like(frame.readings, np.abs(frame.readings).max())
    touch = frame.skin.reconstruct(readings, friction=frame.friction)
    assert touch.fit < 0.01
    assert np.isfinite(touch.force).all()
    assert any("explain" in note for note in touch.notes)
