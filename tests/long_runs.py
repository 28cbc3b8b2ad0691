"""Cases of a parametrised test that the gate makes (`-m long`) and a newcomer need not."""

from __future__ import annotations

from typing import Any

import pytest


def long_runs(*cases: Any, ids: tuple[str, ...] = ()) -> list[Any]:
    """Each of `cases` (a value, or a tuple of the arguments) marked `long`."""
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.long, id=ids[i] if ids else None
        )
        for i, case in enumerate(cases)
    ]
