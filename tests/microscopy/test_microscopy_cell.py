"""Numbers of a cell: they are the truth's within their errors, and what is wrong with the input is said or refused."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.errors import InvalidInput
from palpate.microscopy import CellForces, Field, Quantity, cell_forces, forces_of_labels, on_grid, read_mask
from palpate.sensing.uncertainty import EXACT

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
PITCH, COUNT, PIXEL = 1.5e-6, 20, 0.1e-6


def skin() -> pp.Skin:
    return pp.Skin(
        GEL, pp.AreaArray(shape=(COUNT, COUNT), pitch=PITCH, depth=0.0, channels=["displacement_x", "displacement_y"])
    )


def cell() -> tuple[np.ndarray, np.ndarray]:
    """Traction on the surface of three adhesions in balance, and the displacements of the array."""
    made = skin()
    traction = np.zeros((3, *made.surface.shape))
    x, y = np.meshgrid(made.surface.x, made.surface.y)
    for angle, pull in ((0.0, 400.0), (2.0943951, 400.0), (4.1887902, 400.0)):
        on = np.hypot(x - 8e-6 * np.cos(angle), y - 8e-6 * np.sin(angle)) < 2.2e-6
        for i, part in enumerate((np.cos(angle), np.sin(angle))):
            traction[i][on] = -pull * part * 6 / on.sum()
    return traction, np.asarray(made.sense(traction))


def field_of(u: np.ndarray, noise: float = 2e-9, **more: Any) -> Field:
    rng = np.random.default_rng(5)
    return Field(
        displacement=u + noise * rng.standard_normal(u.shape), start=(7.0, 7.0), step=15.0, pixel=PIXEL, **more
    )


def disc(radius: float = 120.0) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    return 149.5 + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.fixture(scope="module")
def found() -> CellForces:
    _, u = cell()
    return cell_forces(field_of(u + np.array([30e-9, -20e-9])[:, None, None]), GEL, mask=disc(), draws=32)


@pytest.mark.long
def test_numbers_are_the_truths_within_their_errors(found: CellForces) -> None:
    traction, u = cell()
    made = skin()
    x, y = np.meshgrid(made.surface.x, made.surface.y)
    area = PITCH**2
    trim = (made.surface.shape[0] - COUNT) // 2
    inner = traction[:2, trim : trim + COUNT, trim : trim + COUNT]
    true = {
        "strain_energy": 0.5 * (inner * (u - u.mean(axis=(1, 2), keepdims=True))).sum() * area,
        "contractile_moment": -((traction[0] * x + traction[1] * y).sum()) * area,
        "contractility": np.hypot(*traction[:2]).sum() * area,
        "net_force_x": 0.0,
        "net_force_y": 0.0,
        "torque": 0.0,
    }
    for name, value in true.items():
        q = found[name]
        assert abs(q.value - value) < 3 * q.std + 0.02 * abs(value), (name, q, value)
        assert q.std < 0.25 * max(abs(value), found["force_inside"].value), name
    assert found["force_above_background"].value < found["force_inside"].value
    assert found["area"].value == pytest.approx(np.pi * 12e-6**2, rel=0.05)


@pytest.mark.long
def test_energy_follows_its_scaling() -> None:
    """Twice the modulus: twice the traction, and twice the energy for the same displacements."""
    _, u = cell()
    soft = cell_forces(field_of(u), GEL, draws=8, drift=False)
    stiff = cell_forces(field_of(u), pp.HalfSpace(youngs_modulus=16e3, poissons_ratio=0.48), draws=8, drift=False)
    for name in ("strain_energy", "contractile_moment", "contractility"):
        assert stiff[name].value == pytest.approx(2 * soft[name].value, rel=0.01, abs=0.0)
    exact = cell_forces(field_of(u), GEL, draws=8, drift=False, uncertainty=EXACT)
    known = cell_forces(field_of(u), GEL, draws=8, drift=False, uncertainty=replace(EXACT, youngs_modulus=0.2))
    assert known["contractility"].std == pytest.approx(
        np.hypot(exact["contractility"].std, 0.2 * exact["contractility"].value), rel=1e-6
    )


@pytest.mark.long
def test_a_cell_turned_by_a_quarter_has_the_same_numbers(found: CellForces) -> None:
    """x to the right and y down: u turned to (-v, u), the picture with it."""
    u = found.field.displacement
    turned = np.stack([-np.rot90(u[1], -1), np.rot90(u[0], -1)])
    places = {"start": (7.0, 7.0), "step": 15.0, "pixel": PIXEL}
    names = ("strain_energy", "contractile_moment", "contractility", "force_inside")
    straight, other = (
        cell_forces(Field(displacement=d, **places), GEL, mask=disc(), draws=8, drift=False, method="tikhonov")
        for d in (u, turned)
    )
    for name in names:
        assert other[name].value == pytest.approx(straight[name].value, rel=0.02, abs=0.0)
    # adhesions are sampled: the same within what either leaves open
    sampled = cell_forces(Field(displacement=turned, **places), GEL, mask=disc(), draws=8, drift=False)
    for name in names:
        assert sampled[name].value == pytest.approx(found[name].value, abs=sampled[name].std + found[name].std)


@pytest.mark.long
def test_wrong_signs_and_transposed_components_are_said(found: CellForces) -> None:
    _, u = cell()

    def notes(values: np.ndarray) -> str:
        return " ".join(cell_forces(field_of(values), GEL, draws=8, drift=False, noise=2e-9).notes)

    assert not any("no cell does" in n or "hardly any" in n for n in found.notes)
    assert "as no cell does" in notes(u * np.array([1.0, -1.0])[:, None, None])
    assert "as no cell does" in notes(np.swapaxes(u, 1, 2))
    assert "as no cell does" in notes(np.swapaxes(u, 1, 2)[:, ::-1])
    assert "as hardly any does" in notes(-u)
    assert "strain energy may be zero" in notes(np.zeros_like(u))


@pytest.mark.long
def test_a_sign_does_not_hang_on_how_well_the_modulus_is_known() -> None:
    """A modulus known to 40 % makes every number that uncertain, and changes the sign of none."""
    _, u = cell()
    vague = pp.Uncertainty(youngs_modulus=0.4)
    notes = cell_forces(field_of(-u), GEL, draws=8, drift=False, noise=2e-9, uncertainty=vague).notes
    assert any("as hardly any does" in n for n in notes)
    assert not any("strain energy may be zero" in n for n in notes)


def test_pixels_called_micrometres_are_refused() -> None:
    _, u = cell()
    with pytest.raises(InvalidInput, match=r"check the size of a pixel"):
        field_of(1e3 * u / PIXEL * 1e-6)


@pytest.mark.long
def test_units_that_cannot_be_meant_are_said() -> None:
    """What is not refused outright: ten times too large, and a thousand times too small."""
    _, u = cell()
    for factor, words in ((12.0, "beyond linear elasticity"), (1e-3, "less than pictures can resolve")):
        notes = cell_forces(field_of(factor * u, 1e-12), GEL, draws=8, drift=False, noise=1e-9 * factor).notes
        assert any(words in n for n in notes), factor


@pytest.mark.long
def test_outliers_are_said_and_can_be_left_out() -> None:
    _, u = cell()
    u = u.copy()
    u[0, 3, 16] += 12 * PIXEL
    field = field_of(u)
    kept = cell_forces(field, GEL, draws=8, drift=False, method="tikhonov")
    assert any("1 of 400 vectors differ from all about them" in n for n in kept.notes)
    left_out = cell_forces(field.without_outliers(), GEL, draws=8, drift=False, method="tikhonov")
    assert not any("differ from all about them, and" in n for n in left_out.notes)
    assert np.hypot(*kept.traction)[3, 16] > 5 * np.hypot(*left_out.traction)[3, 16]


@pytest.mark.long
def test_holes_and_edges_are_said() -> None:
    _, u = cell()
    u = u.copy()
    u[:, 3:5, 3:5] = np.nan
    holed = cell_forces(field_of(u), GEL, mask=disc(150), draws=8, drift=False)
    assert any("4 of 400 vectors are missing" in n for n in holed.notes)
    assert any("reaches the edge" in n for n in holed.notes)
    assert np.isfinite(holed.traction).all()


@pytest.mark.long
def test_a_gel_on_glass_is_stiffer_than_it_is_deep() -> None:
    _, u = cell()
    thin = pp.BondedLayers([pp.Layer(thickness=8e-6, youngs_modulus=8e3, poissons_ratio=0.48)])
    on_glass = cell_forces(field_of(u), thin, draws=8, drift=False)
    deep = cell_forces(field_of(u), GEL, draws=8, drift=False)
    assert on_glass["contractile_moment"].value > 1.1 * deep["contractile_moment"].value


def test_masks(tmp_path: Path) -> None:
    field = field_of(np.zeros((2, COUNT, COUNT)))
    corners = disc()
    y, x = np.mgrid[:300, :300]
    picture = np.hypot(x - 149.5, y - 149.5) < 120
    np.savetxt(tmp_path / "a.csv", corners, delimiter=",")
    (tmp_path / "a.json").write_text(json.dumps(corners.tolist()))
    shape = {"type": "Polygon", "coordinates": [[*corners.tolist(), corners[0].tolist()]]}
    (tmp_path / "a.geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": shape}]})
    )
    np.save(tmp_path / "a.npy", picture)
    expected = on_grid(corners, field)
    for name in ("a.csv", "a.json", "a.geojson"):
        assert np.array_equal(on_grid(read_mask(tmp_path / name), field), expected)
    assert np.mean(on_grid(read_mask(tmp_path / "a.npy"), field, size=(300, 300)) == expected) > 0.97
    assert np.array_equal(on_grid(expected, field), expected)
    for mask, words in (
        (np.zeros((300, 300), dtype=np.uint8), "is empty"),
        (np.arange(90000, dtype=np.uint16).reshape(300, 300), "photograph"),
        (np.repeat([0, 1, 2], 30000).reshape(300, 300).astype(np.uint8), "several cells"),
        (picture[:150], "150 pixels"),
        (corners + 1e4, "holds no vector"),
        (np.array([[0.0, 0.0], [1.0, 1.0]]), "three corners"),
        (np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), "no area"),
    ):
        with pytest.raises(InvalidInput, match=words):
            on_grid(read_mask(mask), field)
    (tmp_path / "a.roi").write_bytes(b"Iout")
    with pytest.raises(InvalidInput, match="XY Coordinates"):
        read_mask(tmp_path / "a.roi")


def test_a_field_that_does_not_move_and_noise_that_is_none_are_refused() -> None:
    u = np.zeros((2, 12, 12))
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=0.1e-6)
    with pytest.raises(InvalidInput, match="all vectors of the field are equal"):
        cell_forces(field, GEL)
    u[0, 3, 3] = 1e-8
    for noise in (math.nan, 0.0, -1e-9):
        with pytest.raises(InvalidInput, match="noise must be a positive"):
            cell_forces(replace(field, displacement=u), GEL, noise=noise)


def test_an_error_of_zero_is_not_known() -> None:
    u = np.zeros((2, 12, 12))
    std = np.full_like(u, 2e-9)
    std[0, :2] = 0.0
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=0.1e-6, std=std)
    assert field.noise == pytest.approx(2e-9, abs=0.0)
    assert "24 of 144 vectors state an error of zero" in " ".join(field.notes)
    assert replace(field, displacement=u + 1e-9).notes == field.notes
    assert Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=0.1e-6, std=0.0 * u).noise is None


@pytest.mark.parametrize("method", [pytest.param("adhesions", marks=pytest.mark.long), "tikhonov"])
def test_intervals_of_sizes_do_not_go_below_zero(method: str) -> None:
    u = np.zeros((2, 12, 12))
    u[0, 5:7, 3:5], u[0, 5:7, 7:9] = 40e-9, -40e-9
    u += 2e-9 * np.random.default_rng(3).standard_normal(u.shape)
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=0.1e-6)
    forces = cell_forces(field, GEL, mask=[[30, 60], [160, 60], [160, 130], [30, 130]], method=method, draws=8)
    for key in ("force_inside", "force_outside", "background", "traction_rms", "traction_peak"):
        assert 0 <= forces[key].interval[0] <= forces[key].value <= forces[key].interval[1]


def test_quantities_are_written_as_they_are_known() -> None:
    for value, std, text in (
        (1.234e-13, 2e-15, "123.4 +- 2.0 fJ"),
        (5.0, 0.0, "5 +- 0 J"),
        (0.0, 3e-9, "0 +- 3 nJ"),
        (1.26e-9, 1.4e-10, "1.26 +- 0.14 nJ"),
    ):
        assert str(Quantity("energy", "J", value, std)).partition(": ")[2] == text


@pytest.mark.long
def test_the_command_writes_report_figure_table_and_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("typer")
    from command_line import CliRunner
    from palpate.cli import app
    from palpate.recordings import read_touch

    monkeypatch.chdir(tmp_path)
    _, u = cell()
    for name, one in zip("uv", field_of(u).displacement / PIXEL):
        np.save(f"{name}.npy", one)
    np.savetxt("cell.csv", disc(), delimiter=",")
    gel = [
        "--pixel",
        "0.1 um",
        "--youngs-modulus",
        "8 kPa +- 10 %",
        "--poissons-ratio",
        "0.48",
        "--draws",
        "8",
        "--still",
    ]
    run = ["tfm", "u.npy", "v.npy", *gel, "--unit", "px", "--step", "15", "--mask", "cell.csv"]
    done = CliRunner().invoke(app, [*run, "--out", "res"], catch_exceptions=False)
    assert "contractility" in done.output
    page = Path("res.html").read_text()
    assert page.count("data:image/png;base64") == 3
    assert "http" not in page.replace("http-equiv", "")
    rows = [line.split(",") for line in Path("res.csv").read_text().splitlines()]
    assert rows[0][:3] == ["quantity", "value", "std"]
    assert {"strain_energy", "contractility", "torque"} <= {r[0] for r in rows}
    assert Path("res.png").stat().st_size > 10_000
    assert read_touch("res.nc").traction.dims == ("component", "y", "x")
    Path("gel.toml").write_text(TOML)
    for extra, words in (
        (["--out", "res"], "exists"),
        (["--frames", "0,1", "--out", "b"], "leave it out"),
        (["--thickness", "40", "--out", "b"], "has no unit|must be"),
        (["--skin", "gel.toml", "--out", "b"], "give either"),
        (["--cell", "2", "--out", "b"], "from 1 to 1"),
        (["--up", "--v-up", "--out", "b"], "one of them"),
    ):
        with pytest.raises(InvalidInput, match=words):
            CliRunner().invoke(app, [*run, *extra], catch_exceptions=False)
    with pytest.raises(InvalidInput, match="give --mask"):
        CliRunner().invoke(app, [*run[:-2], "--cell", "1", "--out", "b"], catch_exceptions=False)
    with pytest.raises(InvalidInput, match="give what no file states, such as --pixel"):
        CliRunner().invoke(app, ["tfm", "u.npy", "v.npy"], catch_exceptions=False)
    assert not Path("b.html").exists()


@pytest.mark.long
def test_the_size_of_a_mask_says_where_the_top_is(tmp_path: Path) -> None:
    """A table that counts y from the picture's bottom, with a mask of the picture: the same numbers as from the top."""
    pytest.importorskip("typer")
    pytest.importorskip("matplotlib")
    cv2 = pytest.importorskip("cv2")
    from command_line import run

    size = (330, 320)  # (columns, rows): the vectors do not lie in its middle
    u = field_of(cell()[1]).displacement / PIXEL
    rows, columns = np.mgrid[:COUNT, :COUNT] * 15 + 7
    for name, y, v in (("down", rows, u[1]), ("up", size[1] - 1 - rows, -u[1]), ("mixed", rows, -u[1])):
        parts = (columns, y, u[0], v)
        np.savetxt(tmp_path / f"{name}.txt", np.stack([p.ravel() for p in parts], axis=1), header="x y u v")
    y, x = np.mgrid[: size[1], : size[0]]
    cv2.imwrite(str(tmp_path / "mask.png"), np.where(np.hypot(x - 149.5, y - 149.5) < 120, 255, 0).astype(np.uint8))
    np.savetxt(tmp_path / "outline.csv", disc(), delimiter=",")
    gel = ["--pixel", "0.1 um", "--youngs-modulus", "8 kPa +- 10 %", "--poissons-ratio", "0.48", "--draws", "8"]
    for name, option in (("down", ()), ("up", ("--up",)), ("mixed", ("--v-up",))):
        done = run("tfm", f"{name}.txt", *gel, *option, "--mask", "mask.png", "--out", name, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "no cell" not in done.stderr
    tables = [(tmp_path / f"{name}.csv").read_text() for name in ("down", "up", "mixed")]
    assert tables[0] == tables[1] == tables[2]
    refused = run("tfm", "up.txt", *gel, "--up", "--mask", "outline.csv", "--out", "o", cwd=tmp_path)
    assert "give the picture too (--image)" in refused.stderr


TOML = """[pad]
kind = "half_space"
youngs_modulus = "8 kPa +- 10 %"
poissons_ratio = 0.48

[[plane]]
kind = "area"
depth = "0 mm"
channels = ["displacement_x", "displacement_y"]
"""


@pytest.mark.long
def test_a_skin_file_describes_the_gel_as_options_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("typer")
    from command_line import CliRunner
    from palpate.cli import app

    monkeypatch.chdir(tmp_path)
    _, u = cell()
    np.save("both.npy", field_of(u).displacement / PIXEL)
    Path("gel.toml").write_text(TOML)
    run = ["tfm", "both.npy", "--pixel", "0.1 um", "--draws", "8", "--unit", "px", "--step", "15"]
    for out, gel in (
        ("a", ["--skin", "gel.toml"]),
        ("b", ["--youngs-modulus", "8 kPa +- 0.8 kPa", "--poissons-ratio", "0.48"]),
    ):
        CliRunner().invoke(app, [*run, *gel, "--out", out], catch_exceptions=False)
    assert Path("a.csv").read_text() == Path("b.csv").read_text()


def test_remedies_that_are_said_in_other_words_are_those_of_the_notes() -> None:
    """A note that is worded anew elsewhere must not pass with the remedy of another call."""
    from palpate.microscopy.doubts import REMEDIES

    inverse = Path(pp.__file__).parent / "inverse"
    source = "".join(path.read_text(encoding="utf-8") for path in inverse.rglob("*.py"))
    source = re.sub(r'"\s*\n\s*f?"', "", source)  # a sentence of several strings
    source = source.replace("{', '.join(problem.surface.components)}", "x, y, z")
    assert [theirs for theirs in REMEDIES if theirs not in source] == []


@pytest.mark.long
def test_what_is_known_of_the_gel_enters_the_map_or_is_said_not_to() -> None:
    u = np.zeros((2, 16, 16))
    u[0, 6:10, 3:6], u[0, 6:10, 10:13] = 0.2e-6, -0.2e-6
    u += 2e-9 * np.random.default_rng(0).standard_normal(u.shape)
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=0.1e-6)
    gel = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
    exact = cell_forces(field, gel, draws=8, uncertainty=EXACT)
    stated = cell_forces(field, gel, draws=8, uncertainty=replace(EXACT, youngs_modulus=0.2, depth=0.1))
    assert np.allclose(
        stated.std**2 - exact.std**2, (0.2 * exact.traction) ** 2, atol=1e-6 * float(exact.std.max()) ** 2
    )
    assert any("depth" in note and "does not enter" in note for note in stated.notes)
    assert not any("does not enter" in note for note in exact.notes)


@pytest.mark.long
def test_regions_that_overlap_have_their_whole_force(found: CellForces) -> None:
    """An adhesion outlined within a cell takes no force from the cell, in either order."""
    whole, adhesion = np.zeros((2, 300, 300), dtype=bool)
    whole[20:280, 20:280], adhesion[120:180, 200:260] = True, True
    alone = {one.label: one for one in forces_of_labels(found, {"cell": whole})}["cell"]
    for masks in ({"cell": whole, "adhesion": adhesion}, {"adhesion": adhesion, "cell": whole}):
        both = {one.label: one for one in forces_of_labels(found, masks)}
        assert both["cell"].force == pytest.approx(alone.force, rel=1e-6, abs=1e-15)
        assert both["cell"].area == pytest.approx(alone.area, abs=0.0)
        assert both["adhesion"].area == pytest.approx((60 * PIXEL) ** 2, rel=0.1, abs=0.0)


def test_principal_moments_add_up_to_the_contractile_moment(found: CellForces) -> None:
    large, small, _ = found.principal
    assert large + small == pytest.approx(found["contractile_moment"].value, rel=1e-9, abs=0.0)


@pytest.mark.long
def test_energy_outside_goes_with_the_square_of_the_scale(found: CellForces) -> None:
    _, u = cell()
    fields = {"mask": disc(60.0), "draws": 8, "method": "tikhonov"}
    exact = cell_forces(field_of(u), GEL, uncertainty=EXACT, **fields)["energy_outside"]
    known = cell_forces(field_of(u), GEL, uncertainty=replace(EXACT, scale=0.2), **fields)["energy_outside"]
    assert known.std == pytest.approx(math.hypot(exact.std, 0.4 * exact.value), rel=1e-6, abs=0.0)


@pytest.mark.long
def test_another_cell_keeps_the_picture_and_the_notes() -> None:
    """Vectors in the middle of a larger picture: the mask of another cell is of this picture too."""
    u = 1e-9 * np.random.default_rng(0).standard_normal((2, 20, 30))
    field = Field(displacement=u, start=(104.5, 104.5), step=10.0, pixel=PIXEL, notes=("of all of the field",))
    mask = np.zeros((500, 600), dtype=bool)
    mask[150:250, 150:300] = True
    cell = cell_forces(field, GEL, mask=mask, picture=np.zeros((500, 600)), method="tikhonov", draws=8)
    other = cell.within(np.roll(mask, 50, axis=1))
    assert other["area"].value == pytest.approx(cell["area"].value, rel=0.1, abs=0.0)
    assert "of all of the field" in other.notes
    assert any("modulus known to 15 %" in note for note in other.notes)
    assert set(cell.within(mask).notes) == set(cell.notes)
