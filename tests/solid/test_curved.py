"""Pads whose contact surface bends: charts, sums over cells, closed forms, flat limits, files and pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from skfem import MeshHex, MeshHex2, MeshTet

import palpate as pp
from palpate.recordings import read_touch, write_touch
from palpate.recordings.labelled import _described, _grid
from palpate.sensing import CurvedGrid, CylinderChart, SphereChart
from palpate.solid.charts import MeshChart
from palpate.solid.elasticity import Solid

MATERIAL = {"youngs_modulus": 2e5, "poissons_ratio": 0.48}
STRESS = ["stress_xz", "stress_yz", "stress_zz"]


@pytest.fixture(scope="module")
def dome() -> pp.SolidPad:
    return pp.SolidPad.dome(10e-3, 4e-3, element=2.5e-3, **MATERIAL)


@pytest.fixture(scope="module")
def skin(dome: pp.SolidPad) -> pp.Skin:
    array = pp.AreaArray(shape=(6, 6), pitch=3e-3, depth="base", channels=STRESS, noise=60.0)
    return pp.Skin(dome, array)


@pytest.fixture(scope="module")
def touch(skin: pp.Skin) -> pp.Touch:
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.2).shifted(5e-3, 0.0)
    return skin.reconstruct(skin.sense(ball, rng=np.random.default_rng(0)))


# -- charts and grids --------------------------------------------------------------------------------------------------


CHARTS = [
    SphereChart(radius=10e-3, reach=np.pi / 2),
    CylinderChart(radius=12e-3, length=20e-3, width=10e-3),
    CylinderChart(radius=-12e-3, length=20e-3, width=10e-3),
]


@pytest.mark.parametrize("chart", CHARTS)
def test_areas_and_axes_follow_from_positions(chart: SphereChart | CylinderChart) -> None:
    """Derivatives of the positions span the tangent plane, their cross product is the normal, and its length the stretch."""
    x, y = np.array([2e-3, -4e-3, 0.0, 3e-3]), np.array([1e-3, -2e-3, 0.0, 4e-3])
    h = 1e-7
    along_x = (chart.frames(x + h, y).positions - chart.frames(x - h, y).positions) / (2 * h)
    along_y = (chart.frames(x, y + h).positions - chart.frames(x, y - h).positions) / (2 * h)
    frames = chart.frames(x, y)
    np.testing.assert_allclose(np.cross(along_x, along_y), frames.stretch[:, None] * frames.axes[:, 2], atol=1e-6)
    np.testing.assert_allclose(np.einsum("nca,nda->ncd", frames.axes, frames.axes), [np.eye(3)] * 4, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames.axes), 1.0)


@pytest.mark.parametrize("chart", CHARTS)
def test_uniform_pressure_on_a_surface(chart: SphereChart | CylinderChart) -> None:
    """Divergence theorem: along z it is the pressure on what the surface covers of the plane."""
    (x0, x1), (y0, y1) = chart.outline
    shape = (100, 100)
    grid = CurvedGrid(shape=shape, spacing=((y1 - y0) / 100, (x1 - x0) / 100), chart=chart)
    traction = np.zeros((3, *shape))
    traction[2] = 1000.0
    if isinstance(chart, SphereChart):
        covered = np.pi * chart.radius**2
    else:
        covered = 2 * abs(chart.radius) * np.sin(0.5 * chart.length / abs(chart.radius)) * chart.width
    np.testing.assert_allclose(grid.total_force(traction), [0.0, 0.0, 1000.0 * covered], atol=2e-3 * 1000.0 * covered)
    force = grid.cell_forces(traction).reshape(3, -1).T
    np.testing.assert_allclose(
        grid.total_moment(traction), np.cross(grid.positions.reshape(-1, 3), force).sum(axis=0), atol=1e-8
    )


def test_sums_by_rows_are_sums() -> None:
    grid = CurvedGrid(shape=(7, 9), spacing=2e-3, chart=CHARTS[0])
    rng = np.random.default_rng(0)
    traction = rng.standard_normal((3, 7, 9))
    every = (0, 1, 2)
    np.testing.assert_allclose(np.tensordot(grid.force_rows(every), traction, 3), grid.total_force(traction))
    np.testing.assert_allclose(np.tensordot(grid.moment_rows(every), traction, 3), grid.total_moment(traction))
    flat = pp.AreaGrid(shape=(7, 9), spacing=2e-3)
    np.testing.assert_allclose(np.tensordot(flat.force_rows(every), traction, 3), flat.total_force(traction))
    np.testing.assert_allclose(np.tensordot(flat.moment_rows(every), traction, 3), flat.total_moment(traction))


@pytest.mark.long
def test_a_flat_pad_in_a_mesh_chart_is_flat() -> None:
    """A round plate: its chart is seen from above, areas end at the rim."""
    from palpate.solid.shapes import disc

    flat = disc(5e-3, 1e-3, 1e-3, 1)
    facets = flat.facets[:, flat.facets_satisfying(lambda x: x[2] < 1e-9, boundaries_only=True)].T
    chart = MeshChart(vertices=flat.p.T, facets=facets)
    grid = CurvedGrid(shape=(40, 40), spacing=0.25e-3, chart=chart)
    assert grid.areas.sum() == pytest.approx(chart.area, rel=1e-2)
    assert chart.area == pytest.approx(np.pi * 5e-3**2, rel=0.02)
    np.testing.assert_allclose(grid.frames.axes, np.broadcast_to(np.eye(3), (40, 40, 3, 3)), atol=1e-12)


def leaning(bowl: float) -> dict[str, object]:
    """A pad 2 mm thick of tetrahedra whose base has no vertex below one of its surface, flat or like a bowl."""
    side = np.linspace(-6e-3, 6e-3, 9)
    mesh = MeshTet.init_tensor(side, side, np.linspace(0.0, 2e-3, 3))
    outside = mesh.boundary_facets()
    depth = mesh.p[2][mesh.facets[:, outside]]
    upper, lower = (mesh.facets[:, outside[(abs(depth - z) < 1e-9).all(axis=0)]].T for z in (0.0, 2e-3))
    places = mesh.p.T.copy()
    inner = (np.abs(places[:, :2]) < 5.9e-3).all(axis=1)
    places[inner, :2] += 0.37 * places[inner, 2:]
    places[:, 2] += bowl * (places[:, :2] ** 2).sum(axis=1)
    return {"vertices": places, "elements": mesh.t.T, "base": lower, "contact": upper}


@pytest.mark.parametrize("bowl", [0.0, 3.0])
def test_the_thickness_is_that_below_the_surface_not_below_its_vertices(bowl: float) -> None:
    """It was 2.23 mm of 2, and sensors on the base were refused as below the pad."""
    parts = leaning(bowl)
    chart = MeshChart(vertices=parts["vertices"], facets=parts["contact"])  # type: ignore[arg-type]
    pad = pp.SolidPad(chart=chart, **parts, **MATERIAL)  # type: ignore[arg-type]
    assert pad.thickness == pytest.approx(2e-3, rel=1e-9 if bowl == 0.0 else 5e-3)
    assert pad._flush == (bowl == 0.0)
    assert pp.Skin(pad, pp.AreaArray(shape=(3, 3), pitch=2e-3, depth="base", channels=STRESS)).planes[0].depth < 2.01e-3


def test_distances_from_triangles() -> None:
    chart = MeshChart(vertices=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), facets=np.array([[0, 1, 2]]))
    points = np.array([[0.2, 0.3, 2.0], [-1, 0.5, 0], [-3, -4, 12], [1, 1, 0], [0.5, -1, 1], [2, 0, -1]])
    np.testing.assert_allclose(chart.distances(points), [2, 1, 13, np.sqrt(0.5), np.sqrt(2), np.sqrt(2)])


# -- closed forms and limits -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.3, 0.49, 0.499])
@pytest.mark.long
def test_a_sphere_of_curved_elements_is_lames(ratio: float) -> None:
    """u_r = A r + B / r^2 on a rigid core under pressure: curved elements leave a tenth of what flat facets do."""
    angle = np.tan(np.linspace(-np.pi / 4, np.pi / 4, 5))
    blocks = None
    for axis in range(3):
        for sign in (1.0, -1.0):
            block = MeshHex.init_tensor(angle, angle, np.linspace(0.5, 1.0, 3))
            u, v, r = block.p
            way = np.roll(np.stack([u, v, np.ones_like(u)]) / np.sqrt(1.0 + u**2 + v**2), axis, axis=0)
            block = MeshHex(sign * way * r, block.t)
            blocks = block if blocks is None else blocks + block
    flat = MeshHex2.from_mesh(blocks)
    nodes = np.array(flat.doflocs)
    # nodes between corners are put on the spheres that these lie on
    size = np.linalg.norm(nodes, axis=0)
    layer = np.round((size - 0.5) / 0.125) * 0.125 + 0.5
    mesh = MeshHex2(nodes / size * layer, flat.t)
    facets = mesh.boundary_facets()
    away = np.linalg.norm(mesh.doflocs[:, mesh.facets[:, facets]].mean(axis=1), axis=0)
    solid = Solid(mesh, 1.0, ratio, facets[away < 0.7])
    u = solid.solve(solid.surface_load(facets[away > 0.7], 1.0)[:, None])[:, 0].reshape(-1, 3)
    bulk, shear = 1.0 / 3.0 / (1.0 - 2.0 * ratio), 0.5 / (1.0 + ratio)
    slope, core = np.linalg.solve([[0.5, 4.0], [3.0 * bulk, -4.0 * shear]], [0.0, -1.0])
    places = np.asarray(solid.basis.doflocs)
    r = np.linalg.norm(places, axis=0)
    outside = np.abs(r - 1.0) < 1e-6
    moved = ((u.T * places).sum(axis=0)[outside] / r[outside]).mean()
    assert moved == pytest.approx(slope + core, rel=2e-3, abs=2e-5)
    way = 0.75 * np.array([0.75, 0.02, 0.03]) / np.linalg.norm([0.75, 0.02, 0.03])
    nodes_there, fields = solid.at(way[:, None])
    stress = (fields.stress("xx")[0] * u[nodes_there[:, 0]]).sum()
    assert stress == pytest.approx(-(3.0 * bulk * slope - 4.0 * shear * core / 0.75**3), rel=1e-2)


@pytest.mark.long
def test_reactions_read_the_stress_that_makes_them() -> None:
    """On the core of a dome, whose facets differ in size and shape: a wave three thicknesses long, at places anywhere on it."""
    tip = pp.SolidPad.dome(6e-3, 3e-3, element=1e-3, **MATERIAL)
    reactions = tip.solid.reactions
    waves = 2.0 * np.pi / (3.0 * 3e-3) * np.array([1.0, 0.7, 0.5])

    def stress(points: np.ndarray) -> np.ndarray:
        return np.sin(points @ waves) + 2.0

    values = np.einsum("fnq,fq->fn", reactions.values, reactions.weights * stress(reactions.points))
    forces = np.zeros(reactions.count)
    np.add.at(forces, reactions.nodes, values)
    angle = np.random.default_rng(0).uniform(0.0, [1.2, 2.0 * np.pi], (200, 2)).T
    way = np.stack([np.sin(angle[0]) * np.cos(angle[1]), np.sin(angle[0]) * np.sin(angle[1]), 1.0 - np.cos(angle[0])])
    points = (3e-3 * way + np.array([[0.0], [0.0], [3e-3]])).T
    point, node, weight = reactions.at(points)
    found = np.bincount(point, weight * forces[node])
    np.testing.assert_allclose(found, stress(points), atol=0.02)


@pytest.mark.long
def test_a_bend_of_a_large_radius_is_a_box() -> None:
    box = pp.SolidPad.box(8e-3, 6e-3, 2e-3, element=1e-3, **MATERIAL)
    array = pp.AreaArray(shape=(3, 4), pitch=1.5e-3, depth="base", channels=STRESS)
    flat = pp.Skin(box, array).operator.dense()
    for radius in (10.0, -10.0):
        bend = pp.SolidPad.bend(radius, 8e-3, 6e-3, 2e-3, element=1e-3, **MATERIAL)
        np.testing.assert_allclose(pp.Skin(bend, array).operator.dense(), flat, atol=2e-3 * np.abs(flat).max())


@pytest.mark.long
def test_the_core_bears_what_presses(dome: pp.SolidPad) -> None:
    """Patch equilibrium: the sum of the nodal reactions at the core is the net force of the cells, as a vector, and turns as it does."""
    solid = dome.solid
    grid = dome.grid(shape=(14, 14), spacing=1.4e-3)  # none on the rim
    rng = np.random.default_rng(0)
    traction = rng.standard_normal((3, 14, 14))
    loads = np.zeros((solid.basis.N, 3))
    for component, axis, matrix in dome._cell_loads(grid):
        loads[dome._top, axis] += matrix.T @ traction[component].ravel()
    u = solid.solve(loads.reshape(-1, 1))
    reaction = (solid.stiffness @ u - loads.reshape(-1, 1)).reshape(-1, 3)
    force = grid.total_force(traction)
    np.testing.assert_allclose(-reaction.sum(axis=0), force, atol=1e-3 * np.abs(force).max())
    moment = np.cross(np.asarray(solid.basis.doflocs).T, -reaction).sum(axis=0)
    np.testing.assert_allclose(moment, grid.total_moment(traction), atol=5e-3 * np.abs(force).max() * 10e-3)


@pytest.mark.long
def test_reciprocity_and_adjoint_of_a_dome() -> None:
    dome = pp.SolidPad.dome(10e-3, 4e-3, element=4e-3, **MATERIAL)
    names = ["displacement_x", "displacement_y", "displacement_z"]
    h, shape = 0.4e-3, (34, 34)
    surface = dome.grid(shape=shape, spacing=h)
    centres = np.array([[2.6e-3, 5.4e-3], [-5.4e-3, -3.4e-3]])
    array = pp.ScatteredArray(positions=centres[:, ::-1], depth=0.0, channels=names, aperture=h)
    operator = pp.Skin(dome, array, surface=surface).operator
    rng = np.random.default_rng(1)
    t, r = rng.standard_normal((3, *shape)), rng.standard_normal((3, 2))
    assert (operator.forward(t)[0] * r).sum() == pytest.approx((operator.adjoint([r]) * t).sum(), rel=1e-9)
    dense = operator.dense().reshape(3, 2, 3, *shape)
    cells = [(int(np.abs(surface.y - a).argmin()), int(np.abs(surface.x - b).argmin())) for a, b in centres]
    for i in range(3):
        for j in range(3):
            there, back = dense[i, 1, j][cells[0]], dense[j, 0, i][cells[1]]
            assert there == pytest.approx(back, rel=1e-2, abs=1e-2 * np.abs(dense).max())


@pytest.mark.long
def test_a_dome_is_alike_all_round(dome: pp.SolidPad) -> None:
    """Turned by a right angle about z, readings turn with the press."""
    array = pp.AreaArray(shape=(5, 5), pitch=2.5e-3, depth="base", channels=STRESS)
    skin = pp.Skin(dome, array)
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)
    one = skin.sense(ball.shifted(5e-3, 0.0))
    other = skin.sense(ball.shifted(0.0, 5e-3))
    largest = np.abs(one).max()
    np.testing.assert_allclose(other[2], one[2].T, atol=1e-2 * largest)
    np.testing.assert_allclose(other[1], one[0].T, atol=1e-2 * largest)


# -- a ball on the side ------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_ball_on_the_side_of_a_dome(skin: pp.Skin, touch: pp.Touch) -> None:
    grid = skin.pad.grid(shape=(80, 80), spacing=0.1e-3, center=(5e-3, 0.0))  # type: ignore[attr-defined]
    fine = pp.Skin(skin.pad, skin.planes, surface=grid).sample(
        pp.solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.2).shifted(5e-3, 0.0)
    )
    true = grid.total_force(fine)
    low, high = touch.interval(0.95, "force")
    np.testing.assert_allclose(touch.force, true, atol=0.05)
    assert true[0] < -0.25  # along the normal, which leans by 29 degrees, less the shear
    assert (np.asarray(low) < true).all()
    assert (true < np.asarray(high)).all()
    assert touch.center_of_pressure[0] == pytest.approx(5e-3, abs=0.3e-3)
    np.testing.assert_allclose(touch.moment, grid.total_moment(fine), atol=0.5e-3)
    assert touch.slip_margin(0.5) > 0.0 > touch.slip_margin(0.05)
    for method in ("tikhonov", "local"):
        other = skin.reconstruct(skin.sense(touch.values), method=method)
        assert np.linalg.norm(np.asarray(other.force) - true) < 0.35 * np.linalg.norm(true)


@pytest.mark.long
def test_a_tracker_on_a_dome(skin: pp.Skin) -> None:
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.2).shifted(5e-3, 0.0)
    readings, rng = skin.sense(ball), np.random.default_rng(0)
    tracker = skin.track()
    for part in (0.0, 0.0, 0.0, 0.5, 1.0, 1.0):
        found = tracker.step(part * readings + 60.0 * rng.standard_normal(readings.shape))
    np.testing.assert_allclose(found.force, [-0.31, 0.0, 0.966], atol=0.12)


@pytest.mark.long
def test_readings_along_the_pad() -> None:
    """A camera sees displacement in its own axes: it is the same vector."""
    make = {"element": 3e-3, **MATERIAL}
    names = ["displacement_x", "displacement_y", "displacement_z"]
    array = pp.ScatteredArray(positions=np.array([[5e-3, 2e-3], [-3e-3, 4e-3]]), depth=1e-3, channels=names)
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)
    own, seen = (
        pp.Skin(pp.SolidPad.dome(10e-3, 4e-3, readings_along=along, **make), array).sense(ball)
        for along in ("surface", "pad")
    )
    np.testing.assert_allclose(np.linalg.norm(own, axis=0), np.linalg.norm(seen, axis=0), rtol=1e-9)
    assert np.abs(own - seen).max() > 0.05 * np.abs(own).max()


# -- meshes, files, pictures -------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_dome_from_a_file(tmp_path: Path, skin: pp.Skin, touch: pp.Touch) -> None:
    """Flat hexahedra in millimetres: the cap of a sphere is recognised, and reads as the dome of curved elements does."""
    from palpate.solid.shapes import disc, laid_on

    chart = SphereChart(radius=10.0, reach=np.pi / 2)
    rim = chart.outline[0][1]
    flat = disc(rim, 4.0, 2.0, 2)
    curved, places = laid_on(flat, chart, rim=rim)
    corners = curved.doflocs[:, : flat.nvertices]
    mesh = MeshHex(corners, flat.t).with_boundaries({})
    outside = mesh.boundary_facets()
    depth = places[: flat.nvertices, 2][mesh.facets[:, outside]]
    mesh = MeshHex(
        corners,
        flat.t,
        _boundaries={"skin": outside[(depth < 1e-9).all(axis=0)], "core": outside[(depth > 4.0 - 1e-9).all(axis=0)]},
    )
    mesh.save(str(tmp_path / "tip.msh"))
    pad = pp.SolidPad.from_mesh(tmp_path / "tip.msh", base="core", contact="skin", scale=1e-3, **MATERIAL)
    assert isinstance(pad.chart, SphereChart)
    assert pad.chart.radius == pytest.approx(10e-3)
    assert pad.thickness == pytest.approx(4e-3, rel=1e-3)
    mine = pp.Skin(pad, skin.planes).sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0))
    theirs = skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0))
    assert np.abs(mine - theirs).max() < 0.13 * np.abs(theirs).max()  # two facets through 4 mm
    with pytest.raises(pp.InvalidInput, match="turned=True"):
        pp.SolidPad.from_mesh(tmp_path / "tip.msh", base="core", contact="skin", scale=1e-3, turned=True, **MATERIAL)


def test_a_bent_mesh_is_seen_from_above(tmp_path: Path) -> None:
    """A mesh that is no sphere: the chart is x and y, and its forces are those of the bend's own chart."""
    from palpate.solid.shapes import laid_on, rectangle

    chart = CylinderChart(radius=-15e-3, length=16e-3, width=10e-3)
    flat = rectangle(16e-3, 10e-3, 2e-3, 2e-3, 1)
    curved, places = laid_on(flat, chart)
    corners = curved.doflocs[:, : flat.nvertices]
    mesh = MeshHex(corners, flat.t)
    outside = mesh.boundary_facets()
    depth = places[: flat.nvertices, 2][mesh.facets[:, outside]]
    upper = mesh.facets[:, outside[(depth < 1e-9).all(axis=0)]].T
    own = MeshChart(vertices=corners.T, facets=upper)
    (x0, x1), (y0, y1) = own.outline
    grid = CurvedGrid(shape=(30, 40), spacing=((y1 - y0) / 30, (x1 - x0) / 40), center=(0.0, 0.0), chart=own)
    assert grid.areas.sum() == pytest.approx(16e-3 * 10e-3, rel=5e-3)
    traction = np.zeros((3, 30, 40))
    traction[2] = 1000.0
    covered = 2 * 15e-3 * np.sin(8 / 15) * 10e-3
    np.testing.assert_allclose(grid.total_force(traction), [0.0, 0.0, 1000.0 * covered], atol=5e-3 * 1000.0 * covered)


@pytest.mark.long
def test_written_and_read(tmp_path: Path, touch: pp.Touch) -> None:
    write_touch(touch, tmp_path / "touch.nc")
    data = read_touch(tmp_path / "touch.nc")
    np.testing.assert_allclose(data.force, touch.force)
    np.testing.assert_allclose(data.position_z, touch.surface.positions[..., 2])
    np.testing.assert_allclose(data.area, touch.surface.areas)
    import json

    for chart in (*CHARTS, MeshChart(vertices=np.eye(4, 3), facets=np.array([[0, 1, 3]]))):
        grid = CurvedGrid(shape=(3, 4), spacing=1e-3, chart=chart)
        again = _grid(json.dumps(_described(grid)), "touch.nc")
        np.testing.assert_array_equal(again.areas, grid.areas)
        np.testing.assert_array_equal(again.positions, grid.positions)


@pytest.mark.long
def test_a_picture_is_unrolled_and_in_space(skin: pp.Skin, touch: pp.Touch) -> None:
    figure = touch.plot(taxels=skin.planes)
    panels = [a for a in figure.axes if a.get_title(loc="left")]
    assert [a.name for a in panels] == ["rectilinear"] * 3 + ["3d"]
    assert panels[0].get_xlabel() == "x along the surface [mm]"
    assert any(len(line.get_xdata()) == 36 for line in panels[0].lines)  # a dot for each taxel
    assert np.isnan(np.asarray(panels[0].images[0].get_array().filled(np.nan))).any()  # nothing beside the surface


@pytest.mark.long
def test_a_skin_file_of_a_dome(tmp_path: Path) -> None:
    (tmp_path / "skin.toml").write_text(
        """
[pad]
kind = "solid_dome"
radius = "10 mm"
thickness = "4 mm"
element = "4 mm"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [4, 4]
pitch = "3 mm"
depth = "base"
channels = ["stress_zz"]
"""
    )
    skin = pp.Skin.from_file(tmp_path / "skin.toml")
    assert isinstance(skin.surface, CurvedGrid)
    (tmp_path / "skin.toml").write_text(
        (tmp_path / "skin.toml")
        .read_text()
        .replace('"solid_dome"', '"solid_bend"')
        .replace('radius = "10 mm"', 'radius = "-10 mm"\nlength = "16 mm"\nwidth = "16 mm"')
    )
    assert pp.Skin.from_file(tmp_path / "skin.toml").pad.chart.radius == -10e-3  # type: ignore[attr-defined]


# -- refusals ----------------------------------------------------------------------------------------------------------


def test_what_is_no_dome_is_refused(dome: pp.SolidPad) -> None:
    for make, wrong in (
        (lambda: pp.SolidPad.dome(5e-3, 5e-3, **MATERIAL), "thickness must be less than the radius"),
        (lambda: pp.SolidPad.dome(5e-3, 1e-3, height=1.0, **MATERIAL), "height less than"),
        (lambda: pp.SolidPad.dome(10.0, 1e-3, **MATERIAL), "larger element"),
        (lambda: pp.SolidPad.dome(float("nan"), 1e-3, **MATERIAL), "radius must be"),
        (lambda: pp.SolidPad.bend(0.0, 1e-2, 1e-2, 1e-3, **MATERIAL), "radius must be more"),
        (lambda: pp.SolidPad.bend(1e-3, 2e-2, 1e-2, 5e-4, **MATERIAL), "does not fit"),
        (lambda: pp.SolidPad.dome(1e-2, 4e-3, readings_along="camera", **MATERIAL), "readings_along"),  # type: ignore[arg-type]
    ):
        with pytest.raises((pp.InvalidInput, pp.Unsupported), match=wrong):
            make()
    array = pp.AreaArray(shape=(4, 4), pitch=3e-3, depth="base", channels=STRESS)
    with pytest.raises(pp.InvalidInput, match=r"pad\.grid"):
        pp.Skin(dome, array, surface=pp.AreaGrid(shape=(8, 8), spacing=2e-3)).operator.dense()
    with pytest.raises(pp.InvalidInput, match="beside the pad"):
        pp.Skin(dome, pp.AreaArray(shape=(12, 12), pitch=3e-3, depth="base", channels=STRESS))


@pytest.mark.long
def test_pressure_alone_is_found_on_a_dome(dome: pp.SolidPad) -> None:
    """One channel tells one component along the normal; its net force has three, and errors for each."""
    array = pp.AreaArray(shape=(5, 5), pitch=2.4e-3, depth="base", channels=["stress_zz"], noise=60.0)
    skin = pp.Skin(dome, array)
    ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0).shifted(3e-3, 0.0)
    touch = skin.reconstruct(skin.sense(ball, rng=np.random.default_rng(1)))
    low, high = touch.interval(0.95, "force")
    assert touch.force.shape == low.shape == high.shape == (3,)
    assert np.isfinite(low).all()
    assert 0.5 < touch.force[2] < 1.5
