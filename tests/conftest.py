from __future__ import annotations

import gc
import importlib.util
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

# before NumPy is imported, and for the processes that tests start: workers side by side do not fight for the cores
for _library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# Nothing that is imported and collected is garbage: searching it took a fifth of the time until the first test.
gc.disable()

# A run in the background (nohup, a script's &) inherits that Ctrl-C is ignored, and so would what it starts: tests send it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

from palpate._extras import EXTRAS  # noqa: E402
from palpate.errors import Unsupported  # noqa: E402

# slow or loaded machines must not fail a property, and a run must be repeatable
settings.register_profile("palpate", deadline=None, derandomize=True)
settings.load_profile("palpate")

DATA = Path(__file__).parent / "data"
# tests take from each other by name, whichever file is run: no name of a file is there twice
sys.path += [str(folder) for folder in sorted(DATA.parent.iterdir()) if any(folder.glob("test_*.py"))]

#: What whole files of tests are about, where that is an extra. A core without extras is tested by the others.
COMMANDS, FILES, BAGS = (
    ("typer", "rich", "h5netcdf", "pydantic", "matplotlib"),
    ("h5netcdf", "h5py", "pydantic"),
    ("mcap", "rosbags"),
)
NEEDS = {
    "test_ablation.py": COMMANDS,
    "test_adaptive.py": ("clarabel", *COMMANDS),
    "test_cli.py": COMMANDS,
    "test_damaged.py": FILES,
    "test_docs.py": COMMANDS,
    "test_examples.py": (*COMMANDS, *BAGS, "skfem"),
    "test_formats_plug_in.py": (*COMMANDS, "mcap", "zarr"),
    "test_labelled.py": FILES,
    "test_mcap.py": (*COMMANDS, *BAGS),
    "test_microscopy_beads.py": ("cv2", "tifffile"),
    "test_microscopy_cell.py": (*COMMANDS, "cv2", "tifffile"),
    "test_microscopy_noise.py": ("cv2", "tifffile"),
    "test_microscopy_sheet.py": ("contourpy", "matplotlib", "skfem"),
    "test_methods.py": COMMANDS,
    "test_options.py": COMMANDS,
    "test_overwriting.py": COMMANDS,
    "test_paper.py": ("matplotlib",),
    "test_prepared.py": COMMANDS,
    "test_published.py": COMMANDS,
    "test_recordings.py": FILES,
    "test_robots.py": (*COMMANDS, *BAGS),
    "test_sinks.py": (*COMMANDS, *BAGS, "websockets", "zarr"),
    "test_curved.py": (*COMMANDS, "skfem"),
    "test_solid.py": (*COMMANDS, "meshio", "skfem"),
    "test_stopped.py": COMMANDS,
    "test_streaming_recordings.py": (*COMMANDS, "mcap", "zarr"),
    "test_stopped_stream.py": (*COMMANDS, "mcap", "zarr"),
    "test_trust.py": COMMANDS,
    "test_zenoh.py": ("zenoh",),
}
LEFT_OUT = {
    name: missing
    for name, libraries in NEEDS.items()
    if (missing := [one for one in libraries if importlib.util.find_spec(one) is None])
}
collect_ignore_glob = [f"*/{name}" for name in LEFT_OUT]


#: Optional libraries that are not here; where all are, the tests are run as they stand.
MISSING = [name for name in EXTRAS if importlib.util.find_spec(name) is None]


def skipped_without(error: Exception) -> None:
    """Skip a test that failed for want of a library that is not installed, in the words of the error."""
    wanting = (error.name or "").split(".")[0] if isinstance(error, ImportError) else ""
    if any(name == wanting or f"need the package {name}:" in str(error) for name in MISSING):
        pytest.skip(str(error))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    try:
        yield
    except (ImportError, Unsupported) as error:
        skipped_without(error)
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    try:
        yield
    except (ImportError, Unsupported) as error:
        skipped_without(error)
        raise


def pytest_collection_finish() -> None:
    """Modules and tests stay until the end: garbage is not sought among them, a tenth of the run's time."""
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_report_header() -> list[str]:
    return [f"{name} is left out: it needs {', '.join(missing)} (palpate[test])" for name, missing in LEFT_OUT.items()]


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
