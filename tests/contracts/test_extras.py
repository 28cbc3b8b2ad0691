"""The core works without the extras, and what needs one says which."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from conftest import NEEDS as NEEDED
from palpate._extras import EXTRAS

#: Run where none of the optional libraries can be imported.
BARE = f"""
import sys

for name in {sorted(EXTRAS)!r}:
    sys.modules[name] = None
import numpy as np
import palpate as pp

pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
skin = pp.Skin(pad, pp.LineArray(count=31, pitch=0.5, depth=1.5, channels=["stress_zz"]))
touch = skin.reconstruct(skin.sense(pp.solutions.hertz_line(half_width=2.0, force=1.0), rng=None), method="tikhonov")
"""

NEEDS = {
    "files": "pp.Skin.from_file('skin.toml')",
    "files ": "from palpate.recordings import read_recording; read_recording('x.nc')",
    "plots": "touch.plot()",
    "bags": "from palpate.recordings import read_recording; read_recording('x.mcap')",
    "zarr": "from palpate.recordings import read_recording; read_recording('x.zarr')",
}
#: Each of them in turn, and what it says.
ASKED = f"""
import json

said = {{"core": [round(float(touch.force[1]), 1), touch.summary()]}}
for extra, code in {NEEDS!r}.items():
    try:
        exec(code)
    except pp.Unsupported as error:
        said[extra] = str(error)
print(json.dumps(said))
"""


def bare(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BARE + code], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def said() -> dict[str, Any]:
    out = bare(ASKED)
    assert out.returncode == 0, out.stderr
    return dict(json.loads(out.stdout))


def test_the_core_needs_no_extra(said: dict[str, Any]) -> None:
    force, summary = said["core"]
    assert force == 1.0
    assert "net force" in summary


@pytest.mark.parametrize("extra", list(NEEDS))
def test_what_needs_an_extra_says_which(extra: str, said: dict[str, Any]) -> None:
    assert f'pip install "palpate[{extra.strip()}]"' in said[extra]


@pytest.mark.long
def test_the_command_line_without_its_libraries_says_so() -> None:
    out = bare("from palpate.cli import main; main()")
    assert out.returncode == 1
    assert out.stderr == 'error: the command line needs more packages: pip install "palpate[cli]"\n'


TESTS = sorted(Path(__file__).parents[1].rglob("test_*.py"))


@pytest.mark.parametrize("file", TESTS, ids=lambda p: p.name)
def test_what_a_file_of_tests_needs_is_known(file: Path) -> None:
    """Without the extras a file is left out (`NEEDS` in conftest) or skips itself, and is no error of the run."""
    if file.name in NEEDED:
        return
    text = file.read_text(encoding="utf-8")
    nodes = [n for n in ast.parse(text).body if isinstance(n, ast.Import | ast.ImportFrom)]
    names = {a.name for n in nodes if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module for n in nodes if isinstance(n, ast.ImportFrom) and n.module}
    optional = {"clarabel", "httpx", *EXTRAS} & {name.split(".")[0] for name in names}
    assert not {name for name in optional if f'importorskip("{name}' not in text}
