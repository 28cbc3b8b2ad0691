"""palpate identify: the zero of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import run
from palpate.errors import InvalidInput
from palpate.recordings import write_recording
from palpate.recordings.recording import Recording
from palpate.skin import Skin
from skin_files import skin_text


def test_a_touch_and_a_gap_at_rest_are_no_part_of_the_zero(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "skin.toml").write_text(skin_text(11))
    readings = np.full((9, 1, 11), 1000.0) + np.random.default_rng(0).standard_normal((9, 1, 11))
    readings[3, 0, 4:7] += 3000.0  # a touch
    readings[5, 0, 2] = np.nan
    readings[8, 0, 4:7] += 800.0
    write_recording(
        Recording(readings=readings, channels=("stress_zz",), time=np.arange(9) / 100.0), tmp_path / "r.npz"
    )
    seen: list[Any] = []

    def keep(skin: Skin, chosen: Any, **options: Any) -> Any:
        seen.append(np.asarray(chosen))
        raise InvalidInput("seen")

    monkeypatch.setattr(Skin, "reconstruct", keep)
    out = run("identify", "r.npz", "--skin", "skin.toml", "--baseline", "8", "--frame", "8", cwd=tmp_path)
    assert out.returncode == 2, out.stderr
    expected = np.zeros((1, 1, 11))
    expected[..., 4:7] = 800.0
    np.testing.assert_allclose(seen[0], expected, atol=5.0)
