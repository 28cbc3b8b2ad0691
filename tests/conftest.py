from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

# slow or loaded machines must not fail a property, and a run must be repeatable
settings.register_profile("palpate", deadline=None, derandomize=True)
settings.load_profile("palpate")

SHARED = Path(__file__).resolve().parents[2] / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Other people's published data and reference solutions; they are not part of the project."""
    if not SHARED.is_dir():
        pytest.skip("the folder ../shared with published data and oracles is not here")
    return SHARED


@pytest.fixture(scope="session")
def oracle(shared: Path) -> Any:
    """`load(name)` of the oracle folder."""
    spec = importlib.util.spec_from_file_location("oracle_load", shared / "oracles" / "load.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.load


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
