"""Displacement fields and results in the formats of other programs, in and out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.cli.files import whole_result
from palpate.errors import InvalidInput
from palpate.microscopy import (
    CellForces,
    Field,
    Film,
    cell_forces,
    frames_of_field,
    read_field,
    read_labels,
    read_pair,
    read_picture,
)
from palpate.microscopy.layers import cell_layers, layer_reader
from palpate.recordings import read_touch

PIXEL = 0.1e-6
GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
SAID = ["--pixel", "0.1 um", "--youngs-modulus", "8 kPa", "--poissons-ratio", "0.48"]


def pulled() -> np.ndarray:
    """Two patches that pull at each other, in pixels, with noise."""
    u = np.zeros((2, 20, 24))
    u[0, 8:12, 5:8], u[0, 8:12, 16:19] = 2.0, -2.0
    return u + 0.02 * np.random.default_rng(0).standard_normal(u.shape)


@pytest.fixture(scope="module")
def forces() -> CellForces:
    u = pulled() * PIXEL
    u[:, 2, 3] = np.nan
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=PIXEL, std=np.full(u.shape, 2e-9))
    mask = np.array([[60.0, 60.0], [330.0, 60.0], [330.0, 260.0], [60.0, 260.0]])
    return cell_forces(field, GEL, mask=mask, draws=8, method="tikhonov")


def test_a_table_of_vectors_is_read_again_as_it_was(forces: CellForces, tmp_path: Path):
    forces.write_vectors(tmp_path / "v.csv")
    again = read_field(tmp_path / "v.csv", pixel=PIXEL)
    assert again.start == (7.5, 7.5)
    assert again.step == pytest.approx(16.0)
    np.testing.assert_allclose(again.displacement, forces.field.displacement, rtol=1e-6, atol=1e-15)
    assert again.noise == pytest.approx(2e-9)
    with pytest.raises(InvalidInput, match="\\.csv"):
        forces.write_vectors(tmp_path / "v.xlsx")


def test_imagej_finds_slices_unit_and_size_of_a_vector_in_the_tiff(forces: CellForces, tmp_path: Path):
    tifffile = pytest.importorskip("tifffile")
    forces.write_tiff(tmp_path / "t.tif")
    with tifffile.TiffFile(tmp_path / "t.tif") as file:
        assert file.is_imagej
        held = file.imagej_metadata
        assert held["unit"] == "um"
        assert held["Labels"][:2] == ["traction x [Pa]", "traction y [Pa]"]
        dots, per = file.pages[0].tags["XResolution"].value
        assert per / dots == pytest.approx(1.6)
        stack = file.asarray()
    assert stack.dtype == np.float32
    np.testing.assert_allclose(stack[:2], forces.traction, rtol=1e-6)
    np.testing.assert_allclose(stack[2:], forces.std, rtol=1e-6)
    # never taken for a displacement field
    with pytest.raises(InvalidInput, match="two pages"):
        read_field(tmp_path / "t.tif", pixel=PIXEL, unit="px", step=16)


@pytest.mark.long
def test_netcdf_holds_displacement_and_mask_and_napari_opens_it(forces: CellForces, tmp_path: Path):
    forces.write_netcdf(tmp_path / "c.nc", provenance={"skin": "none"})
    held = read_touch(tmp_path / "c.nc")
    np.testing.assert_array_equal(held["displacement"].values, forces.field.displacement)
    np.testing.assert_array_equal(held["inside"].values, forces.inside)
    assert held["displacement"].attrs["units"] == "m"
    assert held.attrs["pixel"] == PIXEL
    assert held.attrs["skin"] == "none"
    layers = cell_layers(tmp_path / "c.nc")
    assert [kind for _, _, kind in layers] == ["image", "image", "labels", "vectors", "vectors"]
    np.testing.assert_allclose(layers[0][0], np.hypot(*forces.traction))
    assert layers[0][1]["scale"] == pytest.approx((1.6, 1.6))
    # arrows begin at vectors, and point down where y grows
    arrows = layers[4][0]
    strongest = arrows[np.argmax(np.hypot(*arrows[:, 1].T))]
    assert abs(strongest[1, 1]) > abs(strongest[1, 0])
    assert layer_reader(str(tmp_path / "c.nc")) is cell_layers
    assert layer_reader(str(tmp_path / "none.nc")) is None
    assert layer_reader(["a.nc", "b.nc"]) is None


def test_the_manifest_of_napari_names_a_function_that_is_there():
    manifest = (Path(pp.__file__).parent / "napari.yaml").read_text()
    assert f"python_name: {layer_reader.__module__}:{layer_reader.__name__}" in manifest


def test_matlab_vectors_of_columns_and_rows_are_positions(tmp_path: Path):
    import scipy.io

    u = pulled()
    xvec, yvec = 20.0 + 16.0 * np.arange(24), 30.0 + 16.0 * np.arange(20)
    scipy.io.savemat(
        tmp_path / "f.mat", {"xVec": xvec, "yVec": yvec, "U": u[0], "V": u[1], "UStd": 0 * u[0] + 0.03, "VStd": 0 * u[0] + 0.04}
    )  # fmt: skip
    found = read_field(tmp_path / "f.mat", pixel=PIXEL, unit="px")
    assert found.start == (20.0, 30.0)
    assert found.step == pytest.approx(16.0)
    np.testing.assert_allclose(found.std[:, 0, 0], [3e-9, 4e-9])
    # the other way round, which only other lengths of rows and columns tell
    np.savez(tmp_path / "f.npz", xvec=xvec, yvec=yvec, u=u[0].T, v=u[1].T)
    turned = read_field(tmp_path / "f.npz", pixel=PIXEL, unit="px")
    np.testing.assert_allclose(turned.displacement, found.displacement)
    assert any("along the rows" in note for note in turned.notes)


@pytest.mark.parametrize("struct", [True, False])
def test_filtered_vectors_of_a_bootstrap_are_one_of_two_fields(struct: bool, tmp_path: Path):
    """TFM-UQ writes U, V as correlated, UPost, VPost without bad windows, and UStd, VStd of both."""
    import scipy.io

    u = pulled()
    u[:, 3, 4] = np.nan
    held = {"xvec": 20.0 + 16.0 * np.arange(24), "yvec": 30.0 + 16.0 * np.arange(20), "U": 2 * u[0], "V": 2 * u[1], "UPost": u[0], "VPost": u[1]}  # fmt: skip
    held |= {"UStd": 0 * u[0] + 0.03, "VStd": 0 * u[0] + 0.04, "delInds": u[0] > 1}
    scipy.io.savemat(tmp_path / "f.mat", {"output": held} if struct else held)
    with pytest.raises(InvalidInput, match=r"2 fields.*UPost.*Say which with name"):
        read_field(tmp_path / "f.mat", pixel=PIXEL, unit="px")
    name = "output.UPost, output.VPost" if struct else "UPost, VPost"
    found = read_field(tmp_path / "f.mat", pixel=PIXEL, unit="px", name=name)
    np.testing.assert_allclose(found.displacement, u * PIXEL)
    np.testing.assert_allclose(found.std[:, 0, 0], [3e-9, 4e-9])


def test_one_array_called_upost_is_not_taken_as_errors(tmp_path: Path):
    u = pulled()
    places = {"xvec": 20.0 + 16.0 * np.arange(24), "yvec": 30.0 + 16.0 * np.arange(20)}
    np.savez(tmp_path / "f.npz", u=u[0], v=u[1], UPost=0 * u[0] + 0.03, **places)
    assert read_field(tmp_path / "f.npz", pixel=PIXEL, unit="px").std is None
    np.savez(tmp_path / "g.npz", u=u[0], v=u[1], UStd=0 * u[0] + 0.03, **places)
    found = read_field(tmp_path / "g.npz", pixel=PIXEL, unit="px")
    np.testing.assert_allclose(found.std[:, 0, 0], 3e-9)
    assert any("standard deviation of both" in note for note in found.notes)


@pytest.mark.parametrize("mark", [";", " ", "\t"])
def test_decimal_commas_are_read(mark: str, tmp_path: Path):
    lines = [mark.join(["x", "y", "u", "v"])]
    for y in range(8):
        lines += [
            mark.join(f"{value:.3f}".replace(".", ",") for value in (7.5 + 16 * x, 7.5 + 16 * y, 0.25, -0.5))
            for x in range(9)
        ]
    (tmp_path / "t.txt").write_text("\n".join(lines) + "\n")
    found = read_field(tmp_path / "t.txt", pixel=PIXEL)
    assert found.shape == (8, 9)
    assert found.start == (7.5, 7.5)
    np.testing.assert_allclose(found.displacement[:, 3, 3], [0.25e-7, -0.5e-7])


def test_a_column_w_is_said_to_be_taken_out_of_the_plane(tmp_path: Path):
    lines = ["x,y,u,v,w"] + [f"{16 * x},{16 * y},0.1,0.2,{0.3 * x}" for y in range(6) for x in range(6)]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    assert any("out of the plane" in note for note in read_field(tmp_path / "t.csv", pixel=PIXEL).notes)


def series(folder: Path) -> Path:
    """As PIVlab saves three frames."""
    import scipy.io

    held: dict[str, np.ndarray] = {}
    y, x = np.meshgrid(8.0 + 16.0 * np.arange(20), 8.0 + 16.0 * np.arange(24), indexing="ij")
    for name in ("x", "y", "u_original", "v_original", "u_filtered", "v_filtered"):
        held[name] = np.empty((3, 1), dtype=object)
    for k in range(3):
        u = (k + 1) / 3 * pulled()
        for name, value in (("x", x), ("y", y), ("u_original", 9 * u[0]), ("v_original", 9 * u[1]), ("u_filtered", u[0]), ("v_filtered", u[1])):  # fmt: skip
            held[name][k, 0] = value
    scipy.io.savemat(folder / "PIVlab.mat", {**held, "units": "[px] respectively [px/frame]"})
    return folder / "PIVlab.mat"


def test_a_frame_of_pivlab_is_picked_by_its_number_and_names(tmp_path: Path):
    path = series(tmp_path)
    assert frames_of_field(path) == [f"u_filtered, v_filtered({k})" for k in (1, 2, 3)]
    assert frames_of_field(path, "u_original, v_original") == [f"u_original, v_original({k})" for k in (1, 2, 3)]
    second = read_field(path, pixel=PIXEL, name="2")
    np.testing.assert_allclose(second.displacement[0], 2 / 3 * pulled()[0] * PIXEL)
    assert any("u_filtered, v_filtered(2)" in note for note in second.notes)
    with pytest.raises(InvalidInput, match="3 frames") as error:
        read_field(path, pixel=PIXEL, name="u_filtered, v_filtered")
    assert "u_filtered, v_filtered(1)" in str(error.value)
    with pytest.raises(InvalidInput, match="no field '4'"):
        read_field(path, pixel=PIXEL, name="4")


def test_a_film_of_files_of_several_frames_has_a_row_for_each(tmp_path: Path):
    np.save(tmp_path / "film.npy", np.stack([pulled(), 0.5 * pulled()]))
    film = Film(
        frames=[series(tmp_path), tmp_path / "film.npy"], pad=GEL, pixel=PIXEL, unit="px", method="tikhonov", step=16.0
    )
    assert [(Path(j.file).name, j.frame, j.number) for j in film.jobs()] == [
        ("PIVlab.mat", 0, 0),
        ("PIVlab.mat", 1, 1),
        ("PIVlab.mat", 2, 2),
        ("film.npy", 0, 3),
        ("film.npy", 1, 4),
    ]


@pytest.mark.long
def test_labels_of_each_frame_follow_a_cell(tmp_path: Path):
    tifffile = pytest.importorskip("tifffile")
    labels = np.zeros((2, 320, 384), dtype=np.uint8)
    labels[0, 100:220, 60:140] = labels[1, 100:220, 220:330] = 5
    tifffile.imwrite(tmp_path / "cells.tif", labels)
    np.save(tmp_path / "film.npy", np.stack([pulled(), pulled()]))
    film = Film(
        frames=[tmp_path / "film.npy"], pad=GEL, pixel=PIXEL, unit="px", step=16.0, method="tikhonov", cells=tmp_path / "cells.tif"
    )  # fmt: skip
    rows, _ = film.run(tmp_path / "part.jsonl", processes=1)
    assert [(r["frame"], r["cell"]) for r in rows] == [(0, "5"), (1, "5")]
    # the cell is at the left adhesion, which pulls to the right, then at the right one
    assert float(rows[0]["net_force_x_N"]) > 0 > float(rows[1]["net_force_x_N"])
    tifffile.imwrite(tmp_path / "cells.tif", np.concatenate([labels, labels]), photometric="minisblack")
    with pytest.raises(InvalidInput, match="4 frames"):
        film.solved(film.jobs()[0])


def test_channels_are_asked_for_and_picked(tmp_path: Path):
    tifffile = pytest.importorskip("tifffile")
    beads = np.random.default_rng(0).integers(0, 4000, (2, 40, 50)).astype(np.uint16)
    other = np.full_like(beads, 7)
    tifffile.imwrite(tmp_path / "two.ome.tif", np.stack([other, beads], axis=1), metadata={"axes": "TCYX"})
    with pytest.raises(InvalidInput, match="2 channels"):
        read_pair([tmp_path / "two.ome.tif"])
    rest, moved = read_pair([tmp_path / "two.ome.tif"], channel=2)
    np.testing.assert_array_equal(rest, beads[0])
    np.testing.assert_array_equal(moved, beads[1])
    with pytest.raises(InvalidInput, match="from 1 to 2"):
        read_pair([tmp_path / "two.ome.tif"], channel=3)
    tifffile.imwrite(tmp_path / "one.tif", beads[0])
    with pytest.raises(InvalidInput, match="says nothing of channels"):
        read_picture(tmp_path / "one.tif", channel=1)


@pytest.mark.long
def test_a_mask_that_would_hold_the_traction_elsewhere_is_questioned():
    u = pulled() * PIXEL
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=PIXEL)
    mask = np.zeros((320, 384), dtype=bool)
    mask[110:210, 70:320] = True
    right = cell_forces(field, GEL, mask=mask, draws=8)
    wrong = cell_forces(field, GEL, mask=np.roll(mask, 130, axis=0), draws=8)
    assert not any("if the mask lay" in note for note in right.notes)
    assert any("if the mask lay" in note and "up" in note for note in wrong.notes)


@pytest.mark.long
def test_a_vector_is_left_out_or_missing_not_both():
    u = pulled() * PIXEL
    u[:, 2, 12] = 9 * PIXEL
    field = Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=PIXEL).without_outliers()
    assert field.left_out >= 1
    notes = cell_forces(field, GEL, draws=8, method="tikhonov").notes
    assert field.left_out == int((~field.valid).sum())
    assert sum("left out" in note for note in notes) == 1
    assert not any("missing: traction" in note for note in notes)


@pytest.mark.long
def test_the_command_writes_what_other_programs_open(tmp_path: Path):
    u = pulled()
    np.save(tmp_path / "u.npy", u[0])
    np.save(tmp_path / "v.npy", u[1])
    beside = {"--plot": "f.svg", "--vectors": "v.csv", "--tiff": "t.tif"}
    words = [part for option, name in beside.items() for part in (option, str(tmp_path / name))]
    fields = [str(tmp_path / "u.npy"), str(tmp_path / "v.npy"), "--unit", "px", "--step", "16", "--start", "20,30"]
    done = run("tfm", *fields, *SAID, "--method", "tikhonov", "--draws", "8", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "f.svg").read_text().startswith("<?xml")
    assert (tmp_path / "v.csv").read_text().splitlines()[1].startswith("20,30,")
    assert (tmp_path / "t.tif").exists()
    assert "skin.toml" not in done.stdout + done.stderr
    for option, name in (("--plot", "f.jpg"), ("--tiff", "t.png"), ("--vectors", "v.txt")):
        refused = run("tfm", *fields, *SAID, "--force", option, str(tmp_path / name), cwd=tmp_path)
        assert refused.returncode == 2
        assert "such a file ends in" in refused.stderr


def test_outlines_are_labels_by_their_place(tmp_path):
    path = tmp_path / "cell.csv"
    path.write_text("x,y\n10,5\n30,5\n30,15\n10,15\n")
    found = read_labels(path, size=(60, 40))
    assert list(found) == ["1"]
    assert found["1"].shape == (40, 60)
    assert found["1"][10, 20]
    assert 180 <= found["1"].sum() <= 231  # 20 x 10 pixels, with or without those on its sides
    with pytest.raises(InvalidInput, match="size of their picture"):
        read_labels(path)


def test_a_result_that_is_stopped_changes_no_file(tmp_path):
    old, new = tmp_path / "a.csv", tmp_path / "b.csv"
    old.write_text("before")

    def stopped():
        with whole_result([old, new]) as at:
            at[old].write_text("after")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert old.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
    with whole_result([old, new]) as at:
        at[old].write_text("after")
        at[new].write_text("too")
    assert (old.read_text(), new.read_text()) == ("after", "too")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "b.csv"]
