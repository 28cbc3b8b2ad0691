"""palpate film: how sure the modulus is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import run
from palpate.errors import InvalidInput
from palpate.sensing.uncertainty import Uncertainty


@pytest.mark.parametrize(
    ("modulus", "expected"),
    [("8 kPa", None), ("8 kPa +- 0 %", Uncertainty(youngs_modulus=0.0)), ("8 kPa +- 5 %", Uncertainty(youngs_modulus=0.05))],
)  # fmt: skip
def test_the_stated_spread_of_the_modulus(
    modulus: str, expected: Uncertainty | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.save(tmp_path / "film.npy", np.zeros((2, 8, 8, 2)))
    seen: list[Any] = []

    def keep(**options: Any) -> Any:
        seen.append(options["uncertainty"])
        raise InvalidInput("seen")

    monkeypatch.setattr("palpate.microscopy.Film", keep)
    options = ("--poissons-ratio", "0.48", "--pixel", "0.1 um", "--unit", "px", "--step", "8")
    out = run("film", "film.npy", "--youngs-modulus", modulus, *options, cwd=tmp_path)
    assert out.returncode == 2, out.stderr
    assert seen == [expected]
