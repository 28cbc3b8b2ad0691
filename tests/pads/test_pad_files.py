"""A pad of another package in a skin.toml: one maker and one entry point."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from skin_files import skin_text
from transversely_isotropic import TransverselyIsotropic

PLANE = skin_text(8)[skin_text(8).index("[[plane]]") :]
FIBRES = '[pad]\nkind = "fibres"\nalong = "300 kPa"\nacross = "200 kPa"\nshear = "60 kPa"\n'


def fibres(*, along: str, across: str, shear: str) -> TransverselyIsotropic:
    """What the entry point names."""
    from palpate.units import parse_quantity

    c33, c11, c44 = (
        parse_quantity(v, "pressure", k) for k, v in (("along", along), ("across", across), ("shear", shear))
    )
    return TransverselyIsotropic(c11=c11, c12=0.4 * c11, c13=0.3 * c11, c33=c33, c44=c44)


def nothing() -> str:
    return "no pad"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What pip leaves of a package with entry points."""
    info = tmp_path / "fibres-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: fibres\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[palpate.pads]\nfibres = test_pad_files:fibres\nnothing = test_pad_files:nothing\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def skin(folder: Path, text: str) -> pp.Skin:
    path = folder / "skin.toml"
    path.write_text(text)
    return pp.Skin.from_file(path)


def test_a_pad_of_another_package(installed: Path) -> None:
    made = skin(installed, FIBRES + "\n" + PLANE)
    assert made.pad == fibres(along="300 kPa", across="200 kPa", shear="60 kPa")
    readings = made.sense(pp.solutions.strip(half_width=1.5e-3, traction=1e3))
    assert np.isfinite(readings).all()
    creeping = skin(installed, FIBRES + 'prony = [[0.3, "2 s"]]\n\n' + PLANE)
    assert isinstance(creeping.pad, pp.Viscoelastic)
    assert creeping.pad.elastic == made.pad


WRONG: dict[str, tuple[str, str]] = {
    "a key too many": (FIBRES + "stiff = 3\n", r"skin\.toml, line .*\"fibres\" does not take these keys: .*'stiff'"),
    "a key too few": (FIBRES.replace('shear = "60 kPa"\n', ""), "missing a required .*argument: 'shear'"),
    "a unit": (FIBRES.replace("300 kPa", "300 mm"), r"skin\.toml, line 3: along"),
    "no pad": ('[pad]\nkind = "nothing"\n', "pad must"),
    "no such kind": (
        '[pad]\nkind = "foam"\n',
        'kind must be "half_space" or "bonded_layers" or "solid_box" or "solid_dome" or "solid_bend" or "solid_mesh" or "measured" or "fibres" or "nothing"',
    ),
    "no kind": ("[pad]\n", "kind must be"),
    "a kind of many": ("[pad]\nkind = [1]\n", "kind must be"),
    "a key too many of a half-space": (
        skin_text(8)[: skin_text(8).index("[[plane]]")] + "stiff = 3\n",
        "stiff is not a key",
    ),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_mistakes(case: str, installed: Path) -> None:
    text, message = WRONG[case]
    with pytest.raises(pp.InvalidInput, match=message):
        skin(installed, text + "\n" + PLANE)


def test_without_the_package(tmp_path: Path) -> None:
    with pytest.raises(pp.InvalidInput, match='kind must be "half_space" or "bonded_layers"'):
        skin(tmp_path, FIBRES + "\n" + PLANE)
