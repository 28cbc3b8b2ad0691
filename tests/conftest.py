from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

# before NumPy is imported, and for the processes that tests start: workers side by side do not fight for the cores
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# slow or loaded machines must not fail a property, and a run must be repeatable
settings.register_profile("palpate", deadline=None, derandomize=True)
settings.load_profile("palpate")

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="session")
def tables() -> Path:
    """Small tables of other people's published numbers (sources and licences in the folder's README)."""
    return DATA


@pytest.fixture(scope="session")
def oracle() -> Callable[[str], dict[str, np.ndarray]]:
    """Reference solutions made without Fourier transforms, by name."""
    return lambda name: dict(np.load(DATA / f"{name}.npz"))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261121)


def relative(found: Any, true: Any) -> float:
    """Relative L2 error."""
    return float(np.linalg.norm(np.asarray(found) - np.asarray(true)) / np.linalg.norm(np.asarray(true)))


def channel_of(field: str) -> str:
    """Oracle field name -> channel."""
    kind, index = field.split("_")
    return {"S": "stress", "eps": "strain", "u": "displacement"}[kind] + "_" + index
