"""Tension of sheets of cells: closed forms, convergence, balance, and coverage on tensions that no finite elements made."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import palpate as pp
from palpate.errors import InvalidInput
from palpate.microscopy import Field, cell_forces, sheet_tension
from palpate.microscopy.sheet import Loads, Sheet, sheet_of
from palpate.microscopy.sheetmesh import Shape, elements_of, triangles
from palpate.microscopy.tension import _cells

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

RADIUS, RATIO = 50e-6, 0.3
GEL = pp.HalfSpace(youngs_modulus=5e3, poissons_ratio=0.48)


def disc(count: int) -> Shape:
    side = 2.4 * RADIUS / count
    first = -0.5 * (count - 1) * side
    y, x = first + np.mgrid[:count, :count] * side
    return Shape(np.hypot(x, y) < RADIUS, (first, first), side)


def square(count: int, side: float = 1.0, *, long: float = 1.0) -> Sheet:
    """A rectangle of regular triangles, exactly: ``long`` times as long as high; it goes on at all its sides."""
    across = round(count * long)
    x, y = np.meshgrid(np.linspace(0, long * side, across + 1), np.linspace(0, side, count + 1))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    k = (np.arange(count)[:, None] * (across + 1) + np.arange(across)).ravel()
    corners = np.concatenate(
        [np.stack([k, k + 1, k + across + 2], 1), np.stack([k, k + across + 2, k + across + 1], 1)]
    )
    e = elements_of(points, corners)
    return Sheet(e, e.border(lambda m: np.ones(m.shape[1], dtype=bool)))


def test_a_disc_that_pulls_to_its_middle_is_a_disc_that_turns():
    """N_r = (3 + nu)/8 k (R^2 - r^2), N_t = (3 + nu)/8 k R^2 - (1 + 3 nu)/8 k r^2 for T = -k r (S. Timoshenko, Theory of Elasticity, article 32)."""
    sheet = sheet_of(disc(100), 0.08 * RADIUS)
    e = sheet.elements
    k = 100.0 / RADIUS
    found = sheet.tension(sheet.body(sheet.balance(-k * e.points.T)[0]), RATIO)
    x, y = e.corners.T
    r = np.hypot(x, y)
    inner = r < 0.9 * RADIUS  # the outline is that of squares
    radial, hoop = (
        (3 + RATIO) / 8 * k * (RADIUS**2 - r**2),
        (3 + RATIO) / 8 * k * RADIUS**2 - (1 + 3 * RATIO) / 8 * k * r**2,
    )
    c, s = x / np.maximum(r, 1e-12), y / np.maximum(r, 1e-12)
    true = np.stack([radial * c**2 + hoop * s**2, radial * s**2 + hoop * c**2, (radial - hoop) * c * s])
    assert np.abs(found - true)[:, inner].max() < 0.03 * true.max()
    # the mean needs no elasticity: -(1/2A) int T . x
    mean = 0.5 * (e.straight @ (found[0] + found[1])) @ e.area / sheet.surface
    assert mean == pytest.approx(k * RADIUS**2 / 4, rel=5e-3)


def test_a_strip_under_an_even_traction_holds_what_lies_beyond():
    """Pulled along x by T and held at its right end: N_xx = T x; of Poisson's ratio 0 that is exact."""
    sheet = square(6, 1.0, long=5.0)
    e = sheet.elements
    where, _, _, normals = sheet.edge
    end = where[:, 0] > 5.0 - 1e-9
    line = np.zeros((2, len(where)))
    line[0, end] = 5.0  # T times the length
    body = sheet.body(np.stack([np.ones(len(e.points)), np.zeros(len(e.points))]))
    found = sheet.tension(body + sheet.pulled(line), 0.0)
    assert normals[end, 0] == pytest.approx(1.0)
    assert found[0] == pytest.approx(e.corners[:, 0], abs=1e-9)
    assert np.abs(found[1:]).max() < 1e-9


def test_an_even_traction_on_a_rectangle_is_not_balanced_and_taken_out():
    sheet = square(6, 2.0)
    e = sheet.elements
    even = np.stack([3.0 + 0.0 * e.area, -1.0 + 0.0 * e.area])
    left, extra = sheet.balance(even)
    assert np.abs(left).max() < 1e-12
    assert extra == pytest.approx(even)
    turned = np.stack([-e.points[:, 1], e.points[:, 0]])
    assert np.abs(sheet.resultant(sheet.body(sheet.balance(turned)[0]))).max() < 1e-12


def test_a_made_solution_converges_at_the_order_of_its_elements():
    """Displacement sin and cos on a square, with the loads it takes: tension at the corners gains a factor of four from halved triangles at least."""

    def strain(x, y):
        return np.stack(
            [
                2 * np.cos(2 * x) * np.cos(y),
                2 * np.cos(x) * np.cos(2 * y),
                -np.sin(2 * x) * np.sin(y) - np.sin(x) * np.sin(2 * y),
            ]
        )

    nu = 0.4
    stiff = np.array([[1, nu, 0], [nu, 1, 0], [0, 0, 0.5 * (1 - nu)]]) / (1 - nu**2)

    def tension(x, y):
        return np.tensordot(stiff, strain(x, y), 1)

    def traction(x, y, h=1e-5):
        dx, dy = (
            (tension(*a) - tension(*b)) / (2 * h) for a, b in (((x + h, y), (x - h, y)), ((x, y + h), (x, y - h)))
        )
        return np.stack([dx[0] + dy[2], dx[2] + dy[1]])

    errors = []
    for count in (4, 8, 16):
        sheet = square(count)
        e = sheet.elements
        where, _, _, n = sheet.edge
        xx, yy, xy = tension(*where.T)
        line = np.stack([xx * n[:, 0] + xy * n[:, 1], xy * n[:, 0] + yy * n[:, 1]])
        found = sheet.tension(sheet.body(traction(*e.points.T)) + sheet.pulled(line), nu)
        off = np.stack([e.straight @ f for f in found]) - tension(*e.points.T)
        errors.append(float(np.sqrt((off**2 @ e.area).sum())))
    assert errors[0] / errors[1] > 3.7
    assert errors[1] / errors[2] > 3.7
    assert errors[-1] < 5e-3


def test_what_cells_add_of_their_own_leaves_no_force():
    sheet = square(10)
    own = Loads(sheet, 1.0, np.random.default_rng(0)).own(0.1, 0.3)
    assert own.std() == pytest.approx(1.0, rel=0.35)
    e = sheet.elements
    assert np.abs(sheet.resultant(sheet.own(own))).max() < 1e-9
    found = sheet.tension(sheet.own(own), 0.3, own)
    # with free edges and no traction the mean of the tension is zero, whatever cells do
    means = np.array([(e.straight @ f) @ e.area for f in found])
    assert np.abs(means).max() < 1e-9


def test_forces_at_the_edge_of_the_view_carry_what_is_missing():
    sheet = square(8)
    loads = Loads(sheet, 1.0, np.random.default_rng(1))
    missing = np.array([0.3, -0.2, 0.05])
    for mean in (True, False):
        assert sheet.resultant(loads.edge(missing, mean=mean)) == pytest.approx(missing, abs=1e-6)


def test_a_mask_with_a_hole_is_filled_but_for_the_hole():
    whole = disc(60)
    y, x = whole.start[1] + np.mgrid[:60, :60] * whole.side
    shape = Shape(whole.mask & (np.hypot(x, y - 10e-6) > 12e-6), whole.start, whole.side)
    points, corners = triangles(shape, 5e-6)
    edges = points[corners[:, 1:]] - points[corners[:, :1]]
    area = 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]).sum()
    assert area == pytest.approx(shape.mask.sum() * shape.side**2, rel=0.02)
    assert (np.hypot(*(points[corners].mean(axis=1) - [0.0, 10e-6]).T) > 11e-6).all()


@pytest.fixture(scope="module")
def scene():
    from cells_sheet import MODULUS
    from cells_sheet import sheet_of as made

    found = made(2001)
    gel = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=0.48)
    size = found["mask"].shape[::-1]
    forces = cell_forces(found["field"], gel, mask=found["mask"], size=size, method="tikhonov", draws=24)
    return found, forces


@pytest.mark.long
def test_mean_cells_and_borders_of_a_known_sheet(scene):
    known, forces = scene
    cells = known["cells"]
    labels = {str(k): cells == k for k in np.unique(cells) if k and (cells == k).sum() > 60}
    sheet = sheet_tension(forces, labels=labels, size=cells.shape[::-1], draws=24)
    n = known["tension"]
    low, high = sheet["average_tension"].interval
    mean = 0.5 * float((n[0] + n[1])[known["mask"]].mean())
    assert low < mean < high
    assert sheet["average_tension"].value == pytest.approx(mean, rel=0.1)
    held = []
    for cell in sheet.cells:
        low, high = cell.average.interval
        held.append(low < 0.5 * float((n[0] + n[1])[labels[cell.label]].mean()) < high)
    assert np.mean(held) > 0.8
    # a border passes the same force both ways: the sum round a cell in the middle is its traction
    assert sheet.borders
    inner = max(sheet.cells, key=lambda c: c.average.value).label
    total = np.zeros(2)
    for border in sheet.borders:
        if inner in border.labels:
            total += np.array(border.force) * (1 if border.labels[0] == inner else -1)
    own = known["traction"][:, labels[inner]].sum(axis=1) * 1e-12
    assert total == pytest.approx(own, abs=0.25 * max(abs(b.force[0]) + abs(b.force[1]) for b in sheet.borders))
    assert any("Poisson's ratio from 0 to 1" in note for note in sheet.notes)


@pytest.mark.long
def test_tables_and_figures_are_written(scene, tmp_path):
    _, forces = scene
    sheet = sheet_tension(forces, draws=8)
    sheet.write_table(tmp_path / "sheet.csv")
    assert "sheet,average_tension," in (tmp_path / "sheet.csv").read_text()
    sheet.plot(title="a sheet").savefig(tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 5000


@pytest.mark.long
def test_an_unbalanced_traction_is_said(scene):
    _, forces = scene
    pushed = forces.traction + np.array([40.0, 0.0])[:, None, None]
    found = sheet_tension(replace(forces, traction=pushed), draws=8)
    assert any("is not balanced" in note for note in found.notes)
    assert abs(found["net_force_x"].value) > 1e-7


@pytest.mark.long
def test_a_sheet_that_is_pressed_is_questioned(scene):
    _, forces = scene
    found = sheet_tension(replace(forces, traction=-forces.traction, draws=-forces.draws), draws=8)
    assert found["average_tension"].value < 0
    assert "are the pictures in order" in found.notes[0]


@pytest.mark.long
def test_a_sheet_that_goes_on_beyond_the_view_is_less_sure(scene):
    known, _ = scene
    field = known["field"]
    half = replace(field, displacement=field.displacement[:, :, 20:])
    mask = known["mask"][:, 100:]
    forces = cell_forces(half, GEL, mask=mask, size=mask.shape[::-1], method="tikhonov", draws=24)
    sheet = sheet_tension(forces, draws=24)
    assert any("goes on beyond the field of view" in note for note in sheet.notes)
    low, high = sheet["average_tension"].interval
    n = known["tension"][:, :, 100:]
    assert low < 0.5 * float((n[0] + n[1])[mask].mean()) < high
    assert high - low > 0.4 * abs(sheet["average_tension"].value)


@pytest.mark.parametrize(
    ("options", "said"),
    [({"poissons_ratio": 1.2}, "from 0 to 0.99"), ({"own": -1}, "own is a part"), ({"draws": 2}, "at least 8 draws")],
)
def test_wrong_options_are_refused(scene, options, said):
    with pytest.raises(InvalidInput, match=said):
        sheet_tension(scene[1], **options)


@pytest.mark.long
def test_a_sheet_of_few_vectors_is_refused():
    u = 1e-8 * np.random.default_rng(0).standard_normal((2, 12, 12))
    field = Field(displacement=u, start=(2.0, 2.0), step=5.0, pixel=1e-6)
    mask = np.zeros((60, 60), dtype=bool)
    mask[20:30, 20:30] = True
    forces = cell_forces(field, GEL, mask=mask, method="tikhonov", draws=8)
    with pytest.raises(InvalidInput, match="covers 4 vectors"):
        sheet_tension(forces)


def test_labels_that_overlap_have_their_whole_area() -> None:
    points = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0)), axis=-1).reshape(-1, 2)
    whole, part = np.zeros((2, 20, 20), dtype=bool)
    whole[2:18, 2:18], part[5:9, 5:9] = True, True
    tension = np.random.default_rng(0).standard_normal((9, 3, 400))
    for masks in ({"whole": whole, "part": part}, {"part": part, "whole": whole}):
        cells, _ = _cells(masks, SimpleNamespace(pixel=1.0), points, np.ones(400), tension, 0.0)
        assert {cell.label: cell.area for cell in cells} == {"whole": 256.0, "part": 16.0}
