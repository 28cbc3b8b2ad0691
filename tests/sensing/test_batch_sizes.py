"""The number of frames in a batch, counted before it is refused for its size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.sensing import readings as module


def test_frames_of_joined_planes_are_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    planes = [pp.LineArray(count=9, pitch=1e-3, depth=d, channels=["stress_zz"]) for d in (1e-3, 2e-3)]
    surface = pp.LineGrid(count=9, spacing=1e-3)
    said: list[str] = []

    def note(size: float, what: str, remedy: str) -> None:
        said.append(what)

    monkeypatch.setattr(module, "SMALL", 0.0)
    monkeypatch.setattr(module, "require", note)
    joined: Any = np.zeros((100, 2, 9))
    for given in (joined, [joined[:, :1], joined[:, 1:]]):
        module.check_frames(given, planes, surface)
    assert said == ["100 frames of 18 readings"] * 2
