"""Where taxels are: a single row, scattered on a line, listed in a skin.toml or in a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.recordings.tables import read_positions
from palpate.sensing import default_surface
from skin_files import skin_text

PAD = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.48)
HOW: dict[str, Any] = {"depth": 2e-3, "channels": ["stress_zz"], "noise": 30.0}
LINE = np.array([[0.0, 3e-3 * i] for i in range(-2, 3)])
ROWS = {
    "a column": pp.AreaArray(shape=(5, 1), pitch=3e-3, **HOW),
    "a row": pp.AreaArray(shape=(1, 5), pitch=3e-3, **HOW),
    "scattered along y": pp.ScatteredArray(positions=LINE, **HOW),
    "scattered along x": pp.ScatteredArray(positions=LINE[:, ::-1], **HOW),
    "scattered along a diagonal": pp.ScatteredArray(positions=LINE + 0.4 * LINE[:, ::-1], **HOW),
}


@pytest.mark.parametrize("case", ROWS)
@pytest.mark.long
def test_a_press_on_a_single_row_of_taxels_is_read(case: str) -> None:
    skin = pp.Skin(PAD, ROWS[case])
    along = ROWS[case].points[3][::-1] - ROWS[case].points[2][::-1]
    ball = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0).shifted(*(0.2 * along))
    readings = skin.sense(ball, rng=np.random.default_rng(1))
    for touch in (skin.reconstruct(readings), skin.track().step(readings)):
        low, high = touch.interval(0.95, "force")
        assert low[2] <= 2.0 <= high[2]
        assert high[2] < 6.0
        assert np.hypot(*(touch.center_of_pressure - 0.2 * along)) < 1e-3


def test_a_single_row_reads_what_the_same_taxels_of_a_whole_array_read() -> None:
    ball = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0).shifted(1e-3, 0.0)
    row = pp.Skin(PAD, ROWS["a row"]).sense(ball)
    whole = pp.Skin(PAD, pp.AreaArray(shape=(3, 5), pitch=3e-3, **HOW)).sense(ball)
    np.testing.assert_allclose(row[:, 0], whole[:, 1], rtol=1e-3)


def test_one_taxel_is_no_array_and_one_row_of_cells_no_surface() -> None:
    with pytest.raises(pp.InvalidInput, match="at least 2 taxels"):
        pp.AreaArray(shape=(1, 1), pitch=3e-3, **HOW)
    with pytest.raises(pp.InvalidInput, match="surface has 1 x 9 cells"):
        pp.Skin(PAD, ROWS["a row"], surface=pp.AreaGrid(shape=(1, 9), spacing=1e-3))


# -- skin.toml ---------------------------------------------------------------------------------------------------------

SKIN = """
[pad]
kind = "half_space"
youngs_modulus = "300 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"
depth = "2 mm"
channels = ["stress_zz"]
"""
HERE = [[0.0, 0.0], [2e-3, 0.0], [0.0, 3e-3]]
TABLES = {
    "titles with units": ("taxel,x (mm),y (mm)\n0,0,0\n1,2,0\n2,0,3\n", None),
    "a unit for all": ("x\ty\n0\t0\n2\t0\n0\t3\n", "mm"),
    "in another order": ("sensor;y [m];x [m]\n3;0,003;0\n1;0;0\n2;0;0,002\n", None),
    "no titles": ("0 0\n2000 0\n0 3000\n", "um"),
    "a height that is the same": ("id,x (mm),y (mm),z (mm)\n7,0,0,5\n8,2,0,5\n9,0,3,5\n", None),
    "the index of a data frame": (",x (m),y (m)\n0,0,0\n1,0.002,0\n2,0,0.003\n", None),
}


def taxels(folder: Path, more: str) -> Any:
    (folder / "skin.toml").write_text(SKIN + more)
    return pp.Skin.from_file(folder / "skin.toml").planes[0].positions


@pytest.mark.parametrize("case", TABLES)
def test_a_table_tells_where_taxels_are(tmp_path: Path, case: str) -> None:
    text, unit = TABLES[case]
    (tmp_path / "taxels.txt").write_text(text)
    more = f'positions_unit = "{unit}"\n' if unit else ""
    np.testing.assert_allclose(taxels(tmp_path, 'positions_file = "taxels.txt"\n' + more), HERE, atol=1e-12)


@pytest.mark.parametrize(
    "more",
    [
        'positions = [["0 mm", "0 mm"], ["2 mm", "0 mm"], ["0 mm", "3 mm"]]',
        'positions = [[0, 0], [2, 0], [0, 3]]\npositions_unit = "mm"',
        'positions = [\n  ["0 um", "0 mm"], ["0.002 m", "0 mm"],\n  ["0 mm", "3000 um"],\n]',
    ],
)
def test_a_skin_file_lists_where_taxels_are(tmp_path: Path, more: str) -> None:
    np.testing.assert_allclose(taxels(tmp_path, more), HERE, atol=1e-12)


def test_taxels_on_a_line_are_those_of_line_contact(tmp_path: Path) -> None:
    np.testing.assert_allclose(taxels(tmp_path, 'positions = ["0 mm", "2 mm", "5 mm"]'), [[0], [2e-3], [5e-3]])


@pytest.mark.parametrize(
    ("more", "table", "words"),
    [
        ("", "", "positions is missing"),
        ("positions = [[0, 0], [2, 0]]", "", "has no unit"),
        ('positions = [["0 mm"], ["2 mm", "1 mm"]]', "", r"list of \[x, y\]"),
        ('positions = [["0 mm", "0 mm"], ["2 mm", "0 mm"]]\npositions_file = "t.csv"', "", "leave one out"),
        ('positions_file = "t.csv"', "x,y\n0,0\n1,1\n", "positions_unit"),
        (
            'positions_file = "t.csv"\npositions_unit = "m"',
            "x (mm),y (mm)\n0,0\n1,1\n",
            "leave out the wrong one",
        ),
        ('positions_file = "t.csv"', "a,b\n0,0\n1,1\n", "no columns of positions; it has a, b"),
        ('positions_file = "t.csv"', "x (mm),y (mm)\n0,0\n0,0\n1,1\n", "2 taxels are at the same place"),
        ('positions_file = "t.csv"', "n,x (mm),y (mm)\n0,0,0\n0,1,0\n1,1,1\n", "two lines are of taxel 0"),
        ('positions_file = "t.csv"', "x (mm),y (mm),z (mm)\n0,0,0\n0,1,4\n1,1,1\n", "heights z from 0 to 4"),
        ('positions_file = "t.csv"', "x (mm),y (mm)\n0,0\n,1\n1,1\n", "line 3: no number"),
    ],
)
def test_positions_that_cannot_be_meant(tmp_path: Path, more: str, table: str, words: str) -> None:
    if table:
        (tmp_path / "t.csv").write_text(table)
    with pytest.raises(pp.InvalidInput, match=words):
        taxels(tmp_path, more)


def test_positions_come_in_metres(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("x (mm)\n1\n2\n")
    np.testing.assert_allclose(read_positions(tmp_path / "t.csv"), [[1e-3], [2e-3]])


# -- positions that do not fit -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrong", [0.0, 1e-3, None, "0"])
def test_a_middle_is_a_pair(wrong: Any) -> None:
    for make in (
        lambda c: pp.AreaArray(shape=(5, 5), pitch=1e-3, center=c, **HOW),
        lambda c: pp.AreaGrid(shape=(5, 5), spacing=1e-3, center=c),
    ):
        with pytest.raises(pp.InvalidInput, match="center must be a place"):
            make(wrong)


@pytest.mark.parametrize("far", [0.3, 1.0, 1e3])
@pytest.mark.parametrize("count", [1, 3])
def test_a_few_taxels_far_from_all_others_are_refused(far: float, count: int) -> None:
    rng = np.random.default_rng(0)
    fine = np.stack(np.meshgrid(np.arange(6) * 2e-3, np.arange(6) * 2e-3), axis=-1).reshape(-1, 2)
    fine = fine + rng.normal(0.0, 1e-4, fine.shape)
    pp.ScatteredArray(positions=fine, **HOW)
    pp.ScatteredArray(positions=np.vstack([fine, fine + 0.1]), **HOW)  # two fingers
    stray = np.array([[far + 1e-3 * i, 5e-3] for i in range(count)])
    with pytest.raises(pp.InvalidInput, match=r"taxel 3\d at .* lies .* m from the others, which lie 0\.00"):
        pp.ScatteredArray(positions=np.vstack([fine, stray]), **HOW)


PITCHED = skin_text(6, 6, depth="1 mm")


@pytest.mark.parametrize(
    ("meta", "agrees"),
    [
        ({"pitch": "0.002"}, False),
        ({"pitch": "2 mm"}, False),
        ({"pitch": "(0.001, 0.002)"}, False),
        ({"depth": "2 mm"}, False),
        ({"pitch": "1 mm", "depth": "0.001"}, True),
        ({"pitch": "narrow", "note": "2 mm"}, True),
        ({}, True),
    ],
)
def test_a_recording_that_says_another_pitch_or_depth_is_not_read_with_this_skin(
    tmp_path: Path, meta: dict[str, str], agrees: bool
) -> None:
    (tmp_path / "skin.toml").write_text(PITCHED)
    recording = pp.Recording(readings=np.ones((2, 1, 6, 6)), channels=["stress_zz"], meta=meta)
    skin = pp.Skin.from_file(tmp_path / "skin.toml")
    if agrees:
        pp.Skin.from_file(tmp_path / "skin.toml", recording=recording)
        return
    with pytest.raises(pp.InvalidInput, match=r"is 1 mm in the skin, and the recording says .*2 mm"):
        pp.Skin.from_file(tmp_path / "skin.toml", recording=recording)
    with pytest.raises(pp.InvalidInput, match=r"is 1 mm in the skin, and the recording says .*2 mm"):
        pp.reconstruct_recording(skin, recording, tmp_path / "touch.nc")


@pytest.mark.long
def test_a_single_row_of_surface_taxels_and_its_pad_are_served(tmp_path: Path) -> None:
    from palpate.pads import half_space_error

    layer = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    array = pp.AreaArray(
        shape=(6, 1), pitch=2e-3, depth=0.0, channels=["stress_xz", "stress_yz", "stress_zz"], noise=30.0
    )
    skin = pp.Skin(layer, array)
    patch = pp.solutions.patch(half_widths=(3e-3, 4e-3), traction=2e4)
    touch = skin.reconstruct(skin.sense(patch, rng=np.random.default_rng(2)))
    assert np.isfinite(touch.force).all()
    assert half_space_error(pp.Skin(layer, ROWS["a column"])).radius == pytest.approx(12e-3 / 5)


@pytest.mark.parametrize(
    "far", [(5, 1e-3, 0.0), (5, 1.3e-3, 0.0), (4, 1e-3, 0.37e-3), (9, 0.25e-3, -2e-3), (3, 1e-3, 0.0)]
)
def test_cells_are_centred_on_the_first_of_several_planes(far: tuple[int, float, float]) -> None:
    """A second plane that reached half a pitch further moved the cells' edges above the taxels of the first."""
    count, pitch, center = far
    for depth in (0.0, 0.4e-3):
        first = pp.AreaArray(shape=(4, 6), pitch=(1e-3, 2e-3), depth=depth, channels=["stress_zz"])
        second = pp.AreaArray(
            shape=(count, 6), pitch=pitch, depth=2e-3, channels=["stress_zz"], center=(0.3e-3, center)
        )
        grid = default_surface([first, second])
        for axis, (own, cells, width) in enumerate(zip(first.grid.axes, grid.axes, grid.spacings)):
            assert np.abs(own[:, None] - cells).min(axis=1).max() < 1e-9
            others = second.grid.axes[axis]
            assert cells[0] <= others[0] - 4e-3 + 1e-9
            assert cells[-1] >= others[-1] + 4e-3 - 1e-9
            reach = max(own[-1], others[-1]) - min(own[0], others[0]) + 8e-3
            assert len(cells) <= reach / width + 4


def test_a_plane_on_the_surface_above_another() -> None:
    """-267 N were read for 1 N: each taxel of the surface felt four cells, whose checkerboard it could not see."""
    planes = [
        pp.AreaArray(shape=(n, n), pitch=1e-3, depth=depth, channels=["stress_zz"], noise=10.0)
        for n, depth in ((4, 0.0), (5, 1e-3))
    ]
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), planes)
    readings = skin.sense(pp.solutions.hertz_point(contact_radius=1.2e-3, force=1.0), rng=np.random.default_rng(0))
    assert skin.reconstruct(readings).force[2] == pytest.approx(1.0, abs=0.02)
