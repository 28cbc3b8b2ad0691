"""Adhesions sampled: blobs against closed forms, numbers inside their intervals, outliers, labels, films."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage

import palpate as pp
from palpate.errors import InvalidInput
from palpate.microscopy import Field, Film, cell_forces, forces_of_labels, read_labels
from palpate.microscopy.adhesions import sampled
from palpate.microscopy.blobs import Response, painted, work_of
from palpate.microscopy.sampler import COUNT, Chain, Places
from palpate.microscopy.spread import read
from palpate.microscopy.vectors import Vectors, find_doubtful, noise_of, outliers
from palpate.sensing.uncertainty import EXACT

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from cells_population import SQUARE, cell_of, displacement_of

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.4)


def field_of(cell) -> Field:
    return Field(
        displacement=cell.displacement,
        start=cell.start,
        step=float(cell.step),
        pixel=SQUARE,
        aperture=cell.window * SQUARE,
    )


def test_a_blob_moves_a_half_space_as_squares_of_its_density_do():
    n, size = 81, 0.5e-6
    axis = SQUARE * (np.arange(n) - n // 2)
    x, y = np.meshgrid(axis, axis)
    density = np.exp(-(x**2 + y**2) / (2 * size**2)) / (2 * np.pi * size**2)
    expected = displacement_of(np.stack([2e-9 * density, -1e-9 * density]), 8e3, 0.4)
    xx, xy, yy = Response.of(GEL, 0.0, 0.1e-6, 2e-5).tensor(x, y, size**2)
    found = np.stack([2e-9 * xx - 1e-9 * xy, 2e-9 * xy - 1e-9 * yy])
    # the mean over a square is not its middle's value, by (side/size)^2/24 of it
    assert abs(found - expected).max() < 3e-3 * abs(expected).max()


@pytest.mark.parametrize("depth", [0.0, 0.6e-6])
@pytest.mark.long
def test_blobs_move_a_layer_on_glass_as_cells_of_its_surface_do(depth):
    pad = pp.BondedLayers([pp.Layer(thickness=12e-6, youngs_modulus=8e3, poissons_ratio=0.45)])
    array = pp.AreaArray(shape=(25, 25), pitch=1e-6, depth=depth, channels=["displacement_x", "displacement_y"])
    skin = pp.Skin(pad, array)
    surface = skin.surface
    traction = np.zeros((3, *surface.shape))
    row, column = (s // 2 for s in surface.shape)
    traction[0, row, column] = 1.0 / surface.cell
    seen = np.asarray(skin.sense(traction))
    x, y = np.meshgrid(array.grid.axes[1] - surface.axes[1][column], array.grid.axes[0] - surface.axes[0][row])
    xx, xy, _ = Response.of(pad, depth, 0.1e-6, 4e-5).tensor(x, y, surface.cell / 12)
    far = np.hypot(x, y) > 2.5e-6
    assert abs(seen[0] - xx)[far].max() < 3e-3 * abs(seen[0])[far].max()
    assert abs(seen[1] - xy)[far].max() < 3e-3 * abs(seen[1])[far].max()


def test_the_work_of_blobs_is_that_of_their_squares():
    places = np.array([[-1.5e-6, 0.0], [1.5e-6, 0.4e-6]])
    variance, forces = np.array([0.5e-6, 0.7e-6]) ** 2, np.array([[2e-9, 0.3e-9], [-2e-9, 0.1e-9]])
    axis = SQUARE * (np.arange(101) - 50)
    columns, rows = painted(places, variance, axis, axis, SQUARE)
    traction = np.stack([(rows * f[:, None]).T @ columns for f in forces.T]) / SQUARE**2
    work = 0.5 * (traction * displacement_of(traction, 8e3, 0.4)).sum() * SQUARE**2
    found = work_of(places, variance, forces, Response.of(GEL, 0.0, 0.1e-6, 2e-5)).sum()
    assert found == pytest.approx(work, rel=5e-3, abs=0.0)


def test_noise_and_outliers_of_a_field_without_traction():
    rng = np.random.default_rng(3)
    u = 5e-9 * rng.standard_normal((2, 64, 64))
    assert noise_of(u) == pytest.approx(5e-9, rel=0.05)
    # good vectors at high noise are not flagged, bad ones are
    assert outliers(u, noise_of(u)).sum() <= 8
    u[:, 10, 20] += 60e-9
    assert outliers(u, noise_of(u))[10, 20]


def test_an_outlier_beside_an_adhesion_is_doubtful_though_its_neighbours_differ_too():
    # off by 32 times the noise; taken for a vector it made the energy 1.7 times too large
    cell = cell_of(21001, noise=0.05, outliers=True, edge=False)
    u = cell.displacement - np.nanmedian(cell.displacement, axis=(1, 2), keepdims=True)
    there = np.isfinite(u[0])
    bad = outliers(u, cell.truth["noise"]) & there
    assert cell.outliers[9, 11]
    assert not bad[9, 11]
    doubtful = find_doubtful(u, bad, there, cell.truth["noise"])
    assert doubtful[9, 11]
    assert (doubtful & ~cell.outliers).sum() <= 6


@pytest.mark.long
def test_without_information_a_chain_samples_its_prior():
    """Births, deaths and switches of doubtful vectors, alone and with a blob, are in balance."""
    pitch, n = 1e-6, 12
    axis = pitch * np.arange(n)
    places = np.stack([a.ravel() for a in np.meshgrid(axis, axis)], axis=1)
    vectors = Vectors(
        places, np.full((2, n * n), 1e-9), np.zeros(n * n), np.ones(n * n), 0.0, doubtful=(5 * n + 5, 5 * n + 6)
    )
    even = np.full((n, n), 1.0 / (n * pitch) ** 2)
    chain = Chain(
        vectors, Response.of(GEL, 0.0, 0.1e-6, 2e-5), Places(even, even, (0, 0), pitch), (1e-8, 0.35e-6, 1e-5), 1.0, known=True, drift=False, odds=0.0, rng=np.random.default_rng(1),
    )  # fmt: skip
    counts, wrong = [], []
    for _ in range(1500):
        chain.walk(8)
        counts.append(len(chain.blobs))
        wrong.append(chain.wrong.copy())
    # standard errors: 0.4 blobs, 0.03
    assert np.mean(counts[300:]) == pytest.approx(COUNT, abs=1.6)
    assert np.mean(wrong, axis=0) == pytest.approx([0.5, 0.5], abs=0.1)


def test_the_interval_holds_what_a_common_size_of_adhesions_would_change():
    rng = np.random.default_rng(0)
    x = rng.standard_normal(4000)
    energies, common = np.exp(0.1 * rng.standard_normal(4000) - 0.1 * x), 0.05
    widths = [np.ptp(np.log(read("strain_energy", energies, common, s)[2])) / 3.92 for s in (None, 10 * x, -10 * x)]
    # energies change by -1 with the logarithm of the size, which is uncertain by 0.25
    assert widths[1] ** 2 - widths[0] ** 2 == pytest.approx(0.25**2, rel=0.1, abs=0.0)
    assert widths[2] == widths[0]


@pytest.fixture(scope="module")
def clean():
    cell = cell_of(3, noise=0.03, outliers=True, edge=False)
    pad = pp.HalfSpace(youngs_modulus=cell.modulus, poissons_ratio=cell.ratio)
    return cell, cell_forces(field_of(cell), pad, mask=cell.mask, size=cell.mask.shape[::-1], uncertainty=EXACT)


@pytest.mark.long
def test_energy_moment_and_contractility_are_inside_with_outliers(clean):
    cell, forces = clean
    for key in ("strain_energy", "contractile_moment", "contractility", "traction_peak"):
        low, high = forces[key].interval
        assert low < cell.truth[key] < high, key
    assert forces["strain_energy"].std < 0.4 * forces["strain_energy"].value
    said = next(n for n in forces.notes if "left out as outliers" in n)
    assert abs(int(said.split()[0]) - cell.outliers[np.isfinite(cell.displacement[0])].sum()) <= 8


@pytest.mark.long
def test_forces_of_labels(clean):
    cell, forces = clean
    masks = {str(i): cell.labels == i for i in cell.forces}
    found = forces_of_labels(forces, masks, size=cell.mask.shape[::-1])
    assert [f.label for f in found] == list(masks)
    large = [f for f in found if np.hypot(*cell.forces[int(f.label)]) > 0.5e-9]
    assert large
    held = [abs(f.force[c] - cell.forces[int(f.label)][c]) < 2.6 * f.std[c] for f in large for c in (0, 1)]
    assert np.mean(held) > 0.8
    with pytest.raises(InvalidInput, match="labels of this picture"):
        forces_of_labels(forces, np.ones((30, 30), dtype=int), size=cell.mask.shape[::-1])


@pytest.mark.long
def test_nothing_is_found_in_noise():
    u = 5e-9 * np.random.default_rng(5).standard_normal((2, 24, 24))
    found = sampled(Field(displacement=u, start=(7.5, 7.5), step=16.0, pixel=0.1e-6), GEL, draws=12)
    x = 1.6e-6 * np.arange(24)
    tractions = np.stack([s.on(x, x, 1.6e-6) for s in found.samples])
    assert abs(tractions.mean(axis=0)).max() < 3 * tractions.std(axis=0).max()
    assert found.noise == pytest.approx(5e-9, rel=0.1)


def test_labels_are_read_and_photographs_refused(tmp_path):
    picture = np.zeros((40, 60), dtype=np.uint16)
    picture[5:10, 5:20], picture[20:30, 40:50] = 1, 7
    np.save(tmp_path / "labels.npy", picture)
    assert list(read_labels(tmp_path / "labels.npy")) == ["1", "7"]
    for wrong, said in (
        (np.zeros((4, 4)), "holds no label"),
        (np.full((4, 4), 0.5), "not whole"),
        (np.random.default_rng(0).integers(0, 200, (40, 40)), "photograph"),
    ):
        with pytest.raises(InvalidInput, match=said):
            read_labels(wrong)


def test_regions_of_imagej(tmp_path):
    roifile = pytest.importorskip("roifile")
    square = roifile.ImagejRoi.frompoints([[10, 10], [30, 10], [30, 20], [10, 20]])
    square.name = "first"
    square.tofile(tmp_path / "first.roi")
    found = read_labels(tmp_path / "first.roi", size=(60, 40))
    assert list(found) == ["first"]
    assert found["first"].sum() == 200
    with pytest.raises(InvalidInput, match="size of their picture"):
        read_labels(tmp_path / "first.roi")


@pytest.mark.long
def test_a_film_goes_on_where_it_was_stopped(tmp_path):
    cell = cell_of(9, noise=0.05, outliers=False, edge=False)
    for i, factor in enumerate((1.0, 0.5)):
        np.save(tmp_path / f"{i}.npy", np.nan_to_num(factor * cell.displacement / SQUARE))
    cells = np.zeros(cell.mask.shape, dtype=np.uint8)
    cells[cell.mask] = 4
    np.save(tmp_path / "cells.npy", cells)
    pad = pp.HalfSpace(youngs_modulus=cell.modulus, poissons_ratio=cell.ratio)
    film = Film(
        frames=[tmp_path / "0.npy", tmp_path / "1.npy"], pad=pad, pixel=SQUARE, unit="px", step=float(cell.step), cells=tmp_path / "cells.npy",
    )  # fmt: skip
    partial = tmp_path / "film.partial.jsonl"
    rows, _ = film.run(partial, processes=1)
    assert [(r["frame"], r["cell"]) for r in rows] == [(0, "4"), (1, "4")]
    energies = [float(r["strain_energy_J"]) for r in rows]
    assert energies[1] == pytest.approx(0.25 * energies[0], rel=0.4, abs=0.0)
    # the last line cut off: the first frame is not done again
    lines = partial.read_text().splitlines()
    partial.write_text("\n".join([*lines[:2], lines[2][:40]]))
    shown = []
    again, _ = film.run(partial, processes=1, shown=shown.append)
    assert shown[0] == 1
    assert again == rows
    other = Film(frames=film.frames, pad=pad, pixel=SQUARE, unit="px", step=2.0 * cell.step)
    with pytest.raises(InvalidInput, match="other settings"):
        other.run(partial)
    with pytest.raises(InvalidInput, match="need one of the beads at rest"):
        Film(frames=["a.tif"], pad=pad, pixel=SQUARE)


@pytest.mark.long
def test_noise_of_a_wide_field_is_that_of_its_vectors(monkeypatch: pytest.MonkeyPatch) -> None:
    """A field that is averaged over tiles states the noise of single vectors, whose windows overlap."""
    monkeypatch.setattr("palpate.microscopy.adhesions.WIDEST", 24)
    count, std = 48, 2e-9
    rng = np.random.default_rng(0)
    noise = scipy.ndimage.uniform_filter(rng.standard_normal((2, count, count)), (0, 4, 4), mode="wrap") * 4
    field = Field(
        displacement=std * noise, std=np.full(noise.shape, std), start=(4.5, 4.5), step=10.0, pixel=1e-7, aperture=4e-6
    )
    found = sampled(field, pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48), draws=3)
    assert found.noise == pytest.approx(std, rel=0.15, abs=0.0)
