"""What the docstrings of public objects say is raised, tried: one mistake for each sentence, named by what it is a mistake in."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.elastic import CreepFilter, transfer
from palpate.recordings import TopicMapping, read_table, recorder
from palpate.sensing import Operator

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
GEL = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=1e5, poissons_ratio=0.45)])
ON_HALF_SPACE = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=1e5, poissons_ratio=0.45)], base=PAD)
LINE = pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
AREA = pp.AreaArray(shape=(3, 4), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
SKIN = pp.Skin(PAD, LINE)
CREEPING = pp.Skin(pp.Viscoelastic(PAD, [(0.3, 1.0)]), LINE)
FLAT = np.zeros((2, len(SKIN.surface.x)))
BALL = pp.solutions.hertz_point(contact_radius=1e-3, force=1.0)
BEADS = [(x * 1e-3, y * 1e-3) for y in range(3) for x in range(4)]
TAXELS = pp.Recording(readings=np.zeros((2, 1, 12)), channels=["displacement_x"], positions=BEADS)
K = np.array([100.0]), np.array([0.0])


def recording(**changed: Any) -> pp.Recording:
    return pp.Recording(**{"readings": np.zeros((2, 1, 3)), "channels": ["stress_zz"], **changed})


def mapping(**changed: Any) -> TopicMapping:
    return TopicMapping(**{"topic": "/finger", "channels": ["stress_zz"], **changed})


def creep(*times: float) -> None:
    one = CreepFilter([(0.3, 1.0)])
    for time in times:
        one.add(np.zeros(1), time)


WRONG: list[tuple[Any, type[Exception], Callable[[], Any]]] = [
    (pp.Viscoelastic, pp.InvalidInput, lambda: pp.Viscoelastic(3.0, [(0.3, 1.0)])),  # type: ignore[arg-type]
    (pp.Viscoelastic, pp.InvalidInput, lambda: pp.Viscoelastic(pp.Viscoelastic(PAD, [(0.3, 1.0)]), [(0.3, 1.0)])),
    (pp.Viscoelastic, pp.InvalidInput, lambda: pp.Viscoelastic(PAD, [0.3])),  # type: ignore[list-item]
    (pp.Viscoelastic, pp.InvalidInput, lambda: pp.Viscoelastic(PAD, [(0.6, 1.0), (0.4, 2.0)])),
    (pp.Viscoelastic, pp.Unsupported, lambda: pp.Viscoelastic(ON_HALF_SPACE, [(0.3, 1.0)])),
    (CreepFilter, pp.InvalidInput, lambda: creep(1.0, 1.0)),
    (pp.BondedLayers, pp.InvalidInput, lambda: pp.BondedLayers([])),
    (pp.BondedLayers, pp.InvalidInput, lambda: pp.BondedLayers(GEL.layers, base=3.0)),  # type: ignore[arg-type]
    (pp.BondedLayers, pp.InvalidInput, lambda: GEL.compliance(3e-3)),
    (transfer, pp.InvalidInput, lambda: transfer(PAD, *K, 1e-3, ["stress_ww"])),
    (transfer, pp.InvalidInput, lambda: transfer(GEL, *K, 3e-3, ["stress_zz"])),
    (Operator, pp.InvalidInput, lambda: Operator(PAD, [AREA], LINE.grid)),
    (Operator, pp.Unsupported, lambda: Operator(PAD, [LINE], pp.LineGrid(count=7, spacing=1e-3), "periodic")),
    (TopicMapping, pp.InvalidInput, lambda: mapping(channels=["stress_ww"])),
    (TopicMapping, pp.InvalidInput, lambda: mapping(fields=["a", "b"])),
    (TopicMapping, pp.InvalidInput, lambda: mapping(scale=(1.0, 2.0))),
    (TopicMapping, pp.InvalidInput, lambda: mapping(markers="points")),
    (pp.Recording, pp.InvalidInput, lambda: recording(channels=["stress_zz", "stress_xz"])),
    (pp.Recording, pp.InvalidInput, lambda: recording(readings=np.full((2, 1, 3), np.inf))),
    (pp.Recording, pp.InvalidInput, lambda: recording(time=[1.0, 1.0])),
    (pp.Recording, pp.InvalidInput, lambda: recording(positions=[(0.0, 0.0)])),
    (pp.Recording.gridded, pp.InvalidInput, lambda: recording().gridded(1e-3)),
    (pp.Recording.gridded, pp.InvalidInput, lambda: TAXELS.gridded(0.0)),
    (pp.Recording.gridded, pp.InvalidInput, lambda: TAXELS.gridded(1.0)),
    (pp.Skin, pp.InvalidInput, lambda: pp.Skin(3.0, LINE)),  # type: ignore[arg-type]
    (pp.Skin, pp.InvalidInput, lambda: pp.Skin(PAD, [])),
    (pp.Skin, pp.InvalidInput, lambda: pp.Skin(PAD, [LINE, AREA])),
    (
        pp.Skin,
        pp.InvalidInput,
        lambda: pp.Skin(GEL, pp.LineArray(count=5, pitch=1e-3, depth=3e-3, channels=["stress_zz"])),
    ),
    (pp.Skin.masked, pp.InvalidInput, lambda: pp.Skin(PAD, [LINE, LINE]).masked([[True] * 5])),
    (pp.Skin.masked, pp.InvalidInput, lambda: SKIN.masked([True] * 4)),
    (pp.Skin.masked, pp.InvalidInput, lambda: SKIN.masked([False] * 5)),
    (pp.Skin.sample, pp.InvalidInput, lambda: SKIN.sample(BALL)),
    (pp.Skin.sense, pp.InvalidInput, lambda: SKIN.sense(FLAT[:1])),
    (pp.Skin.sense, pp.InvalidInput, lambda: SKIN.sense(np.full_like(FLAT, np.nan))),
    (pp.Skin.sense, pp.InvalidInput, lambda: CREEPING.sense(FLAT[None])),
    (pp.Skin.sense, pp.InvalidInput, lambda: SKIN.sense(FLAT, rng=np.random.default_rng(0))),
    (pp.Skin.sense, pp.Unsupported, lambda: SKIN.sense(FLAT[None], time=[0.0])),
    (pp.Tikhonov, pp.InvalidInput, lambda: pp.Tikhonov(order=3)),
    (pp.Tikhonov, pp.InvalidInput, lambda: pp.Tikhonov(parameter=-1.0)),
    (pp.Tikhonov, pp.InvalidInput, lambda: pp.Tikhonov(rule="best")),
    (pp.Tikhonov, pp.InvalidInput, lambda: pp.Tikhonov(rule="gcv", parameter=1.0)),
    (pp.Hilgers, pp.InvalidInput, lambda: pp.Hilgers(length=0.0)),
    (pp.Truncated, pp.Unsupported, lambda: pp.Truncated(rule="evidence")),
    (pp.Wiener, pp.InvalidInput, lambda: pp.Wiener(spectrum=3.0)),  # type: ignore[arg-type]
]


@pytest.mark.parametrize("case", range(len(WRONG)), ids=lambda i: f"{WRONG[i][0].__qualname__}-{i}")
def test_what_is_said_is_raised(case: int) -> None:
    named, error, make = WRONG[case]
    with pytest.raises(error):
        make()
    said = inspect.getdoc(named) or ""
    assert error.__name__ in said[said.index("Raises\n------") :]


def test_files(tmp_path: Path) -> None:
    given = {"columns": ["x", "y", "u", "v"], "channels": ["displacement_x", "displacement_y"]}
    table = tmp_path / "t.csv"
    for text in (
        None,
        "",
        "x,y,u\n1,2,3\n",
        "x,x,y,u,v\n1,1,2,3,4\n",
        "x,y,u,v\n1,2\n",
        "x,y,u,v\n1,2,3,four\n2,3,4,5\n",
    ):
        if text is not None:
            table.write_text(text)
        with pytest.raises(pp.InvalidInput):
            read_table(table, position_factor=1e-3, reading_factor=1e-3, **given)  # type: ignore[arg-type]
    (tmp_path / "there.nc").write_text("")
    for name, channels in (
        ("there.nc", ["stress_zz"]),
        ("r.csv", ["stress_zz"]),
        ("r.mcap", ["stress_ww"]),
        ("r.nc", []),
    ):
        with pytest.raises(pp.InvalidInput):
            recorder(tmp_path / name, channels)
    with recorder(tmp_path / "r.h5", ["stress_zz"]) as out:
        out.readings(0.0, np.zeros((1, 3)))
        with pytest.raises(pp.InvalidInput):
            out.readings(0.1, np.zeros((1, 4)))
    for named in (read_table, recorder):
        assert "Raises\n------\nInvalidInput" in (inspect.getdoc(named) or "")
