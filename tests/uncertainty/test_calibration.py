"""The constants of the error bars: a file that a command writes, with where each number comes from."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate import bench
from palpate.uncertainty import Case, constants

FILE = resources.files("palpate.uncertainty").joinpath("constants.json")


def test_every_entry_says_where_it_comes_from() -> None:
    for entry in json.loads(FILE.read_text(encoding="utf-8"))["entries"]:
        assert {"frames", "seed", "version", "description"} <= set(entry["population"])
        known = constants(entry["method"], Case(entry["contact"], entry["sensing"], entry["body"]))
        assert known.case == Case(entry["contact"], entry["sensing"], entry["body"])
        for c in known.quantities.values():
            assert 0.1 < c.scale < 10
            assert c.freedom > 0.61  # 0.6 is where the fit ends


def test_new_constants_are_put_beside_the_others(tmp_path: Path) -> None:
    file = tmp_path / "constants.json"
    file.write_text(FILE.read_text(encoding="utf-8"))
    before = json.loads(file.read_text())["entries"]
    case = Case("line", "mixed", "layers")
    found = {case: {"traction": (0.0, 1.5, 3.0), "force": (0.1, 2.0, 4.0)}}
    for _ in range(2):  # the second time in the place of the first
        bench.write_constants(file, found, method="adaptive", frames=30, seed=1, version="test")
    after = json.loads(file.read_text())["entries"]
    assert after[:-1] == before
    assert after[-1]["quantities"]["force"] == [0.1, 2.0, 4.0]
    assert "moment" in after[-1]["population"]["borrowed"]
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(pp.InvalidInput, match="not a file of constants"):
        bench.write_constants(tmp_path / "other.json", found, method="adaptive", frames=30, seed=1, version="test")


@pytest.mark.parametrize("sensing", ["stress", "strain", "displacement"])
@pytest.mark.parametrize("body", ["half-space", "layers"])
def test_population_is_of_the_case_asked_for(sensing: str, body: str) -> None:
    for contact in ("line", "area", "area with shear"):
        layout, traction, noise = bench.population(
            np.random.default_rng(0), contact=contact, sensing=sensing, body=body
        )
        assert layout.case == Case(contact, sensing, body)
        assert 5e-4 <= noise <= 7e-2
        assert traction(layout.skin.surface).any()


def test_a_line_of_displacements_on_a_layer_has_constants_of_its_own() -> None:
    pad = pp.BondedLayers([pp.Layer(thickness=2.0, youngs_modulus=1.0, poissons_ratio=0.45)])
    skin = pp.Skin(pad, pp.LineArray(count=40, pitch=0.5, depth=1.0, channels=["displacement_z"]))
    assert constants("adaptive", skin.case()).case == skin.case()
