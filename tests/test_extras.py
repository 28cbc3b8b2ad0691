"""The core works without the extras, and what needs one says which."""

from __future__ import annotations

import subprocess
import sys

import pytest

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


def bare(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BARE + code], capture_output=True, text=True, check=False)


def test_the_core_needs_no_extra() -> None:
    out = bare("print(round(float(touch.force[1]), 1)); print(touch.summary())")
    assert out.returncode == 0, out.stderr
    assert out.stdout.startswith("1.0\n")


@pytest.mark.parametrize("extra", list(NEEDS))
def test_what_needs_an_extra_says_which(extra: str) -> None:
    out = bare(NEEDS[extra])
    assert "Unsupported" in out.stderr
    assert f'pip install "palpate[{extra.strip()}]"' in out.stderr


def test_the_command_line_without_its_libraries_says_so() -> None:
    out = bare("from palpate.cli import main; main()")
    assert out.returncode == 1
    assert out.stderr == 'error: the command line needs more packages: pip install "palpate[cli]"\n'
