"""Pads that are known by a table of presses, against the closed forms that the tables are made of."""

from __future__ import annotations

import csv
import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import run
from long_runs import long_runs
from palpate.measured import Table
from palpate.measured.response import fitted, spread
from palpate.recordings import write_recording
from palpate.sensing import Operator

GEL = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
HALF, RADIUS = 8e-3, 1e-3


def grid_of(count: int, half: float = HALF) -> np.ndarray:
    """Places (x, y) of a square grid of presses."""
    line = np.linspace(-half, half, count)
    return np.array([(x, y) for y in line for x in line])


def pressed(array: Any, places: np.ndarray, shear: float = 0.0, radius: float = RADIUS) -> np.ndarray:
    """Readings of a ball that presses with 1 N on each place (Boussinesq's solution, summed over Hertz's pressure), or drags with it along x."""
    skin = pp.Skin(GEL, array)
    ball = pp.solutions.hertz_point(contact_radius=radius, force=1.0)
    out = np.stack([skin.sense(ball.shifted(*p)) for p in places])
    if not shear:
        return out
    return np.stack([skin.sense(ball.shifted(*p).sliding(shear)) for p in places])


def taxels(depth: float = 3e-3, channels: Any = ("stress_zz",)) -> pp.AreaArray:
    return pp.AreaArray(shape=(7, 7), pitch=2.5e-3, depth=depth, channels=list(channels))


@functools.cache
def noisy(count: int) -> np.ndarray:
    readings = pressed(taxels(), grid_of(count))
    return readings + 0.02 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)


@functools.cache
def pad(count: int = 7) -> pp.Measured:
    """A table with 2 % of the largest reading as noise."""
    places = grid_of(count)
    return pp.Measured.of(taxels(), places=places, force=np.ones(len(places)), readings=noisy(count), radius=RADIUS)


@pytest.mark.parametrize("shape", ["hertz", "disc", "punch"])
def test_an_indenter_spreads_its_force_as_its_pressure_does(shape: str) -> None:
    """The transform of a unit force, against the sum over its pressure."""
    from scipy.special import j0

    a, k = 2e-3, np.array([1.0, 500.0, 1500.0, 4000.0])
    angle = (np.arange(20000) + 0.5) / 20000 * np.pi / 2  # r = a sin(angle) takes the punch's edge out
    r, dr = a * np.sin(angle), a * np.cos(angle)
    pressure = {"hertz": np.cos(angle), "disc": np.ones_like(angle), "punch": 1.0 / np.cos(angle)}[shape]
    weight = pressure * r * dr
    expected = (j0(np.multiply.outer(k, r)) * weight).sum(axis=1) / weight.sum()
    np.testing.assert_allclose(spread(k, a, shape), expected, atol=1e-6)
    assert spread(np.array([0.0]), 0.0, shape)[0] == pytest.approx(1.0)


@pytest.mark.long
def test_without_noise_the_map_is_that_of_a_point_load() -> None:
    """Nine by nine presses of a ball: the map of cells much smaller than the ball."""
    places = grid_of(9)
    readings = pressed(taxels(), places)
    found = pp.Measured.of(taxels(), places=places, force=np.ones(81), readings=readings, radius=RADIUS)
    grid = pp.AreaGrid(shape=(20, 20), spacing=0.6e-3)
    got = found.response(taxels(), grid).dense()[0, :, :, 2]
    true = Operator(GEL, [taxels()], grid).planes[0].dense()[0, :, :, 2]
    assert np.sqrt(((got - true) ** 2).mean() / (true**2).mean()) < 0.01
    # taken for a point that ball would make every response wider
    point = pp.Measured.of(taxels(), places=places, force=np.ones(81), readings=readings, radius=0.0)
    wide = point.response(taxels(), grid).dense()[0, :, :, 2]
    assert np.sqrt(((wide - true) ** 2).mean() / (true**2).mean()) > 0.03


@pytest.mark.parametrize(("count", "most"), [(7, 0.07), *long_runs((9, 0.04))])
@pytest.mark.long
def test_what_the_map_is_off_by_is_what_it_says(count: int, most: float) -> None:
    grid = pp.AreaGrid(shape=(24, 24), spacing=0.6e-3)
    found = pad(count)
    got = found.response(taxels(), grid).dense()[0, :, :, 2]
    true = Operator(GEL, [taxels()], grid).planes[0].dense()[0, :, :, 2]
    error = np.sqrt(((got - true) ** 2).mean() / (true**2).mean())
    assert error < most
    assert 0.6 < error / float(found.fit.error[0]) < 1.5
    assert float(found.fit.noise[0]) == pytest.approx(0.02 * np.abs(noisy(count)).max(), rel=0.15)


@pytest.mark.parametrize(("count", "most"), [(7, 0.06), *long_runs((9, 0.04))])
@pytest.mark.long
def test_presses_elsewhere(count: int, most: float) -> None:
    """Fifty presses between the places, of other sizes: force, centre, and how often the intervals hold them."""
    rng = np.random.default_rng(3)
    real, skin = pp.Skin(GEL, taxels()), pp.Skin(pad(count), pad(count).array)
    assert skin.components == ("z",)
    force, center, held, around = [], [], [], []
    for _ in range(50):
        x, y = rng.uniform(-5e-3, 5e-3, 2)
        load = rng.uniform(0.3, 3.0)
        readings = real.sense(
            pp.solutions.hertz_point(contact_radius=rng.uniform(1e-3, 2.5e-3), force=load).shifted(x, y)
        )
        readings = readings + 0.01 * np.abs(readings).max() * rng.standard_normal(readings.shape)
        touch = skin.reconstruct(readings)
        low, high = touch.interval(0.95, "force")
        force.append(float(touch.force[2]) / load - 1.0)
        held.append(bool(low[2] <= load <= high[2]))
        center.append(np.hypot(*(np.asarray(touch.center_of_pressure) - [x, y])))
        low, high = touch.interval(0.95, "center_of_pressure")
        around.append(bool(low[0] <= x <= high[0] and low[1] <= y <= high[1]))
    assert np.sqrt(np.mean(np.square(force))) < most
    assert np.sqrt(np.mean(np.square(center))) < 0.15e-3
    assert np.mean(held) >= 0.9
    assert np.mean(around) >= 0.9


@pytest.mark.long
def test_shear_that_was_measured_is_found_and_shear_that_was_not_is_refused() -> None:
    names = ("stress_xz", "stress_yz", "stress_zz")
    array, places = taxels(channels=names), grid_of(7)
    ball = pp.solutions.hertz_point(contact_radius=RADIUS, force=1.0)
    real = pp.Skin(GEL, array)
    press = np.stack([real.sense(ball.shifted(*p)) for p in places])
    along_x = np.stack([real.sense(ball.shifted(*p).sliding(0.5)) for p in places])
    along_y = np.stack([real.sense(ball.shifted(*p).sliding(0.5, direction=np.pi / 2)) for p in places])
    force = np.zeros((3, 49, 3))
    force[:, :, 2], force[1, :, 0], force[2, :, 1] = 1.0, 0.5, 0.5
    full = pp.Measured.of(
        array,
        places=np.tile(places, (3, 1)),
        force=force.reshape(-1, 3),
        readings=np.concatenate([press, along_x, along_y]),
        radius=RADIUS,
    )
    skin = pp.Skin(full, full.array)
    assert skin.components == ("x", "y", "z")
    contact = pp.solutions.hertz_point(contact_radius=1.5e-3, force=2.0).shifted(1e-3, -2e-3).sliding(0.3)
    found = skin.reconstruct(real.sense(contact)).force
    np.testing.assert_allclose(found, [0.6, 0.0, 2.0], atol=0.06)

    normal = pp.Skin(pad(), pad().array)
    with pytest.raises(pp.NotObservable, match=r"never for x.*press sideways"):
        normal.reconstruct(noisy(7)[0], components=["x", "z"])
    with pytest.raises(pp.Unsupported, match="no press along x"):
        normal.sense(contact)
    assert any("no press of the table acts that way" in n for n in normal.reconstruct(noisy(7)[24]).assumed)


@pytest.mark.long
def test_forces_of_any_size_order_and_number() -> None:
    """Unsorted presses of different forces, some of them twice, and frames at rest that are the zero."""
    rng = np.random.default_rng(4)
    places = np.concatenate([grid_of(7), grid_of(7)[:5], [(0.0, 0.0)] * 2])
    force = np.concatenate([rng.uniform(0.5, 2.0, 54), [0.0, 0.0]])
    readings = np.concatenate([pressed(taxels(), places[:54]), np.zeros((2, 1, 7, 7))]) * force[:, None, None, None]
    order = rng.permutation(56)
    found = pp.Measured.of(
        taxels(), places=places[order], force=force[order], readings=(readings + 123.0)[order], radius=RADIUS
    )
    assert len(found.table.places) == 54
    touch = pp.Skin(found, found.array).reconstruct(pressed(taxels(), np.array([[1e-3, 2e-3]]))[0] * 1.5)
    assert float(touch.force[2]) == pytest.approx(1.5, rel=0.03)


@pytest.mark.long
def test_a_dead_taxel_is_masked() -> None:
    readings = noisy(7).copy()
    readings[:, 0, 3, 2] = np.nan
    readings[:, 0, 0, 0] = 7.0
    found = pp.Measured.of(taxels(), places=grid_of(7), force=np.ones(49), readings=readings, radius=RADIUS)
    assert found.array.valid.sum() == 47
    assert not found.array.valid[3, 2]
    assert not found.array.valid[0, 0]
    skin = pp.Skin(found, found.array)
    touch = skin.reconstruct(pressed(taxels(), np.array([[1e-3, 2e-3]]))[0])
    assert float(touch.force[2]) == pytest.approx(1.0, rel=0.1)
    with pytest.raises(pp.InvalidInput, match="dead in the table"):
        pp.Skin(found, taxels()).prepare()


def table(**changed: Any) -> Table:
    given = {
        "places": grid_of(7),
        "force": np.ones(49),
        "readings": noisy(7).reshape(49, 1, 49),
        "positions": taxels().points[:, ::-1],
        "channels": ["stress_zz"],
        "radius": RADIUS,
    }
    return Table(**(given | changed))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"places": 1e3 * grid_of(7)}, "metres: multiply millimetres by 1e-3"),
        ({"positions": 1e3 * taxels().points}, "metres"),
        ({"places": grid_of(7) + 0.5}, "in the same coordinates"),
        ({"places": grid_of(7) * 0.004}, "in the same coordinates"),
        ({"radius": 1.0}, "more than half"),
        ({"radius": -1e-3}, "0 or larger"),
        ({"radius": np.nan}, "0 or larger"),
        ({"force": -np.ones(49)}, "turn their sign"),
        ({"force": np.zeros(49)}, "no press has a force"),
        ({"force": np.tile([1.0, 0.0, 0.0], (49, 1))}, "no press has a normal force"),
        ({"force": np.where(np.arange(49) == 3, np.nan, 1.0)}, "not finite"),
        ({"force": np.ones(48)}, "49 places"),
        ({"force": "hard"}, "must be numbers"),
        ({"indenter": "cone"}, "hertz, disc, punch"),
        ({"channels": ["pressure"]}, "pressure"),
        ({"readings": np.where(np.arange(49) == 5, np.nan, noisy(7).reshape(49, 1, 49))[:, :, :]}, ""),
        ({"readings": np.zeros((49, 1, 49))}, "no reading changes"),
        ({"places": np.stack([np.linspace(-HALF, HALF, 49), np.zeros(49)], axis=1)}, "spread over an area"),
    ],
)
def test_tables_that_cannot_be_meant(changed: dict[str, Any], said: str) -> None:
    if not said:  # one taxel, NaN in all presses, is dead
        assert table(**changed).working.sum() == 48
        return
    with pytest.raises(pp.InvalidInput, match=said):
        table(**changed)


def test_a_single_missing_reading_is_named() -> None:
    readings = noisy(7).reshape(49, 1, 49).copy()
    readings[3, 0, 17] = np.nan
    with pytest.raises(pp.InvalidInput, match="press 3, taxel 17"):
        table(readings=readings)


@pytest.mark.long
def test_too_few_places_and_readings_of_other_presses_are_refused() -> None:
    with pytest.raises(pp.InvalidInput, match="9 places, and at least 16"):
        table(places=grid_of(3), force=np.ones(9), readings=noisy(7).reshape(49, 1, 49)[:9])
    shuffled = np.random.default_rng(0).permutation(noisy(7).reshape(49, 1, 49))
    with pytest.raises(pp.InvalidInput, match="does not determine its response"):
        _ = pp.Measured(table(readings=shuffled)).fit


@pytest.mark.long
def test_uncertainties_that_do_not_enter_are_refused() -> None:
    found = pad()
    known = pp.Skin(found, found.array, uncertainty=pp.Uncertainty(scale=0.1)).uncertainty
    assert known.scale == 0.1
    assert known.modulus == 0.0
    assert known.stated_gain == pytest.approx(float(found.fit.error[0]))
    with pytest.raises(pp.Unsupported, match="youngs_modulus does not enter a Measured"):
        pp.Skin(found, found.array, uncertainty=pp.Uncertainty(youngs_modulus=0.1))


@pytest.mark.long
def test_what_asks_for_a_model_refuses() -> None:
    found = pad()
    skin = pp.Skin(found, found.array)
    for call in (skin.design, lambda: skin.observability([1e-3])):
        with pytest.raises(pp.Unsupported, match="only its table is known"):
            call()
    with pytest.raises(pp.Unsupported, match="differs from place to place"):
        skin.reconstruct(noisy(7)[0], method="dft")
    with pytest.raises(pp.Unsupported, match="line of taxels"):
        pp.Skin(found, pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    with pytest.raises(pp.InvalidInput, match="not in the table"):
        pp.Skin(found, pp.AreaArray(shape=(7, 7), pitch=2e-3, depth=1e-3, channels=["stress_zz"])).prepare()
    with pytest.raises(pp.InvalidInput, match="stress_xz was not measured"):
        pp.Skin(found, taxels(channels=("stress_xz",))).prepare()


@pytest.mark.long
def test_a_tracker_follows_on_it() -> None:
    found = pad(9)
    skin = pp.Skin(found, found.array)
    rng = np.random.default_rng(0)
    ball = pressed(taxels(), np.array([[1e-3, -2e-3]]), radius=1.5e-3)[0]
    load = np.concatenate([np.zeros(20), np.linspace(0.1, 2.0, 20)])
    frames = load[:, None, None, None] * ball
    frames = frames + 0.005 * np.abs(ball).max() * rng.standard_normal(frames.shape)
    tracker = skin.track(baseline=20)
    touch = [tracker.step(f) for f in frames][-1]
    low, high = touch.interval(0.95, "force")
    assert low[2] <= 2.0 <= high[2]
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.1)


@pytest.mark.long
def test_it_is_calibrated_by_a_weight() -> None:
    """A table in counts, and a skin whose counts have aged by a fifth."""
    found = pad(9)
    ball = pressed(taxels(), np.array([[0.0, 0.0]]), radius=1.5e-3)[0]
    weights = [0.0, 1.0, 2.0, 4.0]
    skin = pp.Skin(found, found.array).calibrate(np.stack([0.8 * w * ball for w in weights]), reference=weights)
    assert float(skin.reconstruct(0.8 * 3.0 * ball).force[2]) == pytest.approx(3.0, rel=0.03)


# -- files ---------------------------------------------------------------------------------------------------------------


def written(path: Path, rows: list[list[Any]], titles: list[str] | None = None) -> Path:
    titles = titles or [
        "press_x [mm]",
        "press_y [mm]",
        "force_z [mN]",
        "taxel_x [mm]",
        "taxel_y [mm]",
        "stress_zz [kPa]",
    ]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([titles, *rows])
    return path


def rows_of(readings: np.ndarray) -> list[list[float]]:
    """One line for each press and taxel, in millimetres, millinewtons and kilopascals."""
    points = taxels().points
    return [
        [1e3 * x, 1e3 * y, 1e3, 1e3 * tx, 1e3 * ty, 1e-3 * value]
        for (x, y), frame in zip(grid_of(7), readings.reshape(49, 49))
        for (ty, tx), value in zip(points, frame)
    ]


@pytest.mark.long
def test_the_same_table_from_numbers_netcdf_and_csv(tmp_path: Path) -> None:
    pad().save(tmp_path / "responses.nc")
    from_netcdf = pp.Measured(tmp_path / "responses.nc")
    rows = rows_of(noisy(7))
    np.random.default_rng(0).shuffle(rows)
    from_csv = pp.Measured(written(tmp_path / "responses.csv", rows), radius=RADIUS)
    one, grid = taxels(), pp.AreaGrid(shape=(9, 9), spacing=1e-3)
    expected = pad().response(one, grid).dense()
    np.testing.assert_allclose(from_netcdf.response(one, grid).dense(), expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(from_csv.response(one, grid).dense(), expected, atol=1e-4 * np.abs(expected).max())
    assert from_netcdf.array.shape == (7, 7)
    with pytest.raises(pp.InvalidInput, match="exists"):
        pad().save(tmp_path / "responses.nc")


def test_a_press_that_comes_twice_is_two_presses(tmp_path: Path) -> None:
    rows = rows_of(noisy(7))
    found = pp.Measured(written(tmp_path / "a.csv", rows + rows[:49]), radius=RADIUS)
    assert len(found.table.places) == 50


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r, t: (r[:-1], t), "one line for each of 49 taxels"),
        (lambda r, t: (r, ["press_x", *t[1:]]), r"press_x has no unit. Name it press_x \[mm\]"),
        (lambda r, t: (r, ["press_x [inches]", *t[1:]]), "accepted for a length"),
        (lambda r, t: ([row[1:] for row in r], t[1:]), "no column press_x"),
        (lambda r, t: (r, [*t[:-1], "counts"]), "no column a channel"),
        (lambda r, t: ([["a", *row[1:]] for row in r], t), "no row of numbers"),
        (lambda r, t: ([], t), "no lines below"),
        (lambda r, t: ([["", *r[0][1:]], *r[1:]], t), "must be numbers in every line"),
    ],
)
def test_tables_that_cannot_be_read(change: Any, said: str, tmp_path: Path) -> None:
    titles = ["press_x [mm]", "press_y [mm]", "force_z [mN]", "taxel_x [mm]", "taxel_y [mm]", "stress_zz [kPa]"]
    rows, titles = change(rows_of(noisy(7)), titles)
    with pytest.raises(pp.InvalidInput, match=said):
        pp.Measured(written(tmp_path / "a.csv", rows, titles), radius=RADIUS)


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(pp.InvalidInput, match="no such file"):
        pp.Measured(tmp_path / "a.nc")
    (tmp_path / "a.nc").write_text("no netcdf")
    with pytest.raises(pp.InvalidInput, match="cannot be read as NetCDF"):
        pp.Measured(tmp_path / "a.nc")
    (tmp_path / "a.xlsx").write_text("")
    with pytest.raises(pp.InvalidInput, match="as CSV with the columns"):
        pp.Measured(tmp_path / "a.xlsx")
    with pytest.raises(pp.InvalidInput, match="contact_radius"):
        pp.Measured(written(tmp_path / "a.csv", rows_of(noisy(7))))
    with pytest.raises(pp.InvalidInput, match=r"Measured\.of"):
        pp.Measured(noisy(7))


@pytest.mark.long
def test_from_a_skin_file_and_the_commands(tmp_path: Path) -> None:
    pad().save(tmp_path / "responses.nc")
    (tmp_path / "skin.toml").write_text('[pad]\nkind = "measured"\nfile = "responses.nc"\n')
    skin = pp.Skin.from_file(tmp_path / "skin.toml")
    assert skin.planes[0].shape == (7, 7)
    skin.prepare()
    skin.save_prepared(tmp_path / "a.prepared")
    again = pp.Skin.from_file(tmp_path / "skin.toml")
    again.load_prepared(tmp_path / "a.prepared")
    frame = pressed(taxels(), np.array([[1e-3, 0.0]]))[0]
    assert float(again.reconstruct(frame).force[2]) == float(skin.reconstruct(frame).force[2])
    done = run("pad", "skin.toml", "--plot", "pad.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "49 presses 2.67 mm apart, forces along z" in done.stdout
    assert (tmp_path / "pad.png").stat().st_size > 10_000
    recording = pp.Recording(readings=np.stack([0.0 * frame, frame, 2.0 * frame]), channels=["stress_zz"])
    write_recording(recording, tmp_path / "finger.nc")
    done = run("reconstruct", "finger.nc", "--skin", "skin.toml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "2.0" in done.stdout
    (tmp_path / "skin.toml").write_text('[pad]\nkind = "measured"\nfile = "unknown"\n')
    with pytest.raises(pp.InvalidInput, match=r"line 3: .*unknown"):
        pp.Skin.from_file(tmp_path / "skin.toml")
    (tmp_path / "skin.toml").write_text('[pad]\nkind = "half_space"\nyoungs_modulus = "1 MPa"\npoissons_ratio = 0.5\n')
    with pytest.raises(pp.InvalidInput, match=r"no \[plane\] section"):
        pp.Skin.from_file(tmp_path / "skin.toml")


@pytest.mark.long
def test_more_rows_than_are_looked_at_are_drawn() -> None:
    """Four hundred markers and two hundred presses: the shared response is found from some of the readings."""
    rng = np.random.default_rng(0)
    markers, presses = rng.uniform(-9e-3, 9e-3, (400, 2)), grid_of(14)
    array = pp.ScatteredArray(positions=markers, depth=3e-3, channels=["stress_zz"])
    readings = pressed(array, presses).reshape(196, 1, 400)
    found = fitted(
        presses[:, ::-1],
        np.ones((196, 1)),
        np.full(196, RADIUS),
        "hertz",
        readings,
        markers[:, ::-1],
        ["stress_zz"],
        ["z"],
    )
    assert float(found.error[0]) < 0.02


def test_a_measured_pad_is_not_doubted_for_its_stiffness() -> None:
    from palpate.cli.options import suspicious_units

    assert suspicious_units(pp.Skin(pad(), taxels())) == []
