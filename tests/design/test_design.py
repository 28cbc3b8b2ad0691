"""What a design promises: bounds against closed forms and against estimates of simulated presses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import palpate as pp
from palpate.design import Press, place, read_design, sweep
from palpate.design.bounds import covariance
from palpate.design.detection import threshold
from palpate.design.responses import Responses
from palpate.design.variations import varied
from skin_files import skin_text

SOFT = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
EXACT = pp.Uncertainty(youngs_modulus=0.0, thickness=0.0, depth=0.0, gain=0.0, scale=0.0)


def taxels(**changed: object) -> pp.AreaArray:
    given: dict = {"shape": (8, 8), "pitch": 2e-3, "depth": 2e-3, "channels": ["stress_zz"], "noise": 100.0}
    return pp.AreaArray(**(given | changed))


@pytest.mark.parametrize(("pitch", "depth"), [(0.25e-3, 1e-3), (0.5e-3, 2e-3), (1e-3, 4e-3)])
def test_a_line_load_is_located_to_0_853_sqrt_pitch_depth_over_snr(pitch: float, depth: float) -> None:
    """Taxels that feel s_zz = 2 P z^3/(pi (x^2 + z^2)^2) with noise s: 1/var(x) = (1/(pitch s^2)) int (ds_zz/dx)^2 dx.

    The integral is (64 P^2/(pi^2 z^3)) int u^2/(1 + u^2)^6 du = 7 P^2/(4 pi z^3), so that with SNR = 2 P/(pi z s), the peak over the noise,
    std(x) = (2/pi) sqrt(4 pi/7) sqrt(pitch z)/SNR. The sum over taxels is the integral for pitches up to a quarter of the depth.
    """
    integral, factor = 7.0 * math.pi / 256.0, 2.0 / math.pi * math.sqrt(4.0 * math.pi / 7.0)
    u = np.linspace(-40.0, 40.0, 400_001)
    assert np.trapezoid(u**2 / (1 + u**2) ** 6, u) == pytest.approx(integral, rel=1e-9)
    assert factor == pytest.approx(0.853, abs=5e-4)
    noise, force = 100.0, 50.0
    array = pp.LineArray(count=401, pitch=pitch, depth=depth, channels=["stress_zz"], noise=noise)
    found = pp.Skin(SOFT, array).design(force=force, contact_radius=0.03 * depth)
    ratio = 2.0 * force / (math.pi * depth) / noise
    assert found.known.center[0] == pytest.approx(factor * math.sqrt(pitch * depth) / ratio, rel=0.01)


@pytest.mark.parametrize("channels", [["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"]])
def test_derivatives_are_those_of_exact_readings(channels: list[str]) -> None:
    """Readings of the design's own cells against `Skin.sense`, which is exact whatever the cells."""
    from palpate.design.bounds import PressModel

    skin = pp.Skin(SOFT, taxels(channels=channels))
    press = Press(force=1.0, contact_radius=2e-3, shear=0.3)
    names = skin.components
    model = PressModel(Responses(SOFT, skin.planes, np.zeros(2), 4e-3, 1e-3), press, names)
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)
    ball = ball.sliding(0.3) if "x" in names else ball
    largest = np.abs(skin.sense(ball)).max()
    assert np.abs(model.readings - skin.sense(ball).ravel()).max() < 0.01 * largest
    step = 0.1e-3
    moved = (skin.sense(ball.shifted(step, 0.0)) - skin.sense(ball.shifted(-step, 0.0))).ravel() / (2 * step)
    by_x = model.jacobian[:, len(names)]
    assert np.abs(by_x - moved).max() < 0.01 * np.abs(moved).max()


@pytest.mark.long
def test_an_estimator_that_knows_the_shape_reaches_the_bound() -> None:
    """Least squares for force, place and radius over 60 frames: unbiased to first order, so its scatter is the bound."""
    skin = pp.Skin(SOFT, taxels(noise=300.0), uncertainty=EXACT, nuisance=())
    bound = skin.design(force=1.0, contact_radius=3e-3).known
    responses = Responses(SOFT, skin.planes, np.zeros(2), 5e-3, 1.5e-3)

    def readings(p: np.ndarray) -> np.ndarray:
        shape = responses.contact(np.array([p[2], p[1]]) * 1e-3, p[3] * 1e-3)
        return responses.read(shape[None], np.array([[0.0, 0.0, p[0]]]))[0]

    truth = np.array([1.0, 0.0, 0.0, 3.0])
    exact, rng = readings(truth), np.random.default_rng(0)
    found = []
    for _ in range(60):
        frame = exact + 300.0 * rng.standard_normal(exact.size)
        found.append(least_squares(lambda p, frame=frame: (readings(p) - frame) / 300.0, truth, diff_step=1e-3).x)
    scatter = np.std(found, axis=0)
    expected = np.array([bound.force[0], *(1e3 * bound.center), 1e3 * bound.radius])
    # a standard deviation of 60 draws is itself known to 9 %
    assert (np.abs(scatter / expected - 1.0) < 0.3).all(), scatter / expected


@pytest.mark.long
def test_nothing_that_is_unknown_makes_a_bound_smaller() -> None:
    array = taxels(channels=["stress_xz", "stress_yz", "stress_zz"])
    how = {"force": 1.0, "contact_radius": 2e-3, "shear": 0.3}
    without = pp.Skin(SOFT, array, nuisance=()).design(**how)
    offsets = pp.Skin(SOFT, array).design(**how)
    assert (offsets.known.force >= without.known.force * (1 - 1e-9)).all()
    assert (offsets.bound.force > offsets.known.force).all()
    sure = pp.Skin(SOFT, array, uncertainty=EXACT).design(**how)
    assert sure.bound.force == pytest.approx(sure.known.force)
    assert offsets.bound.force[2] > 0.02  # the scale is known to 2 %


@pytest.mark.long
def test_the_modulus_matters_for_displacement_and_not_for_stress() -> None:
    how = {"force": 1.0, "contact_radius": 2e-3}
    uncertain = pp.Uncertainty(youngs_modulus=0.15, depth=0.0, thickness=0.0, gain=0.0, scale=0.0)
    moved = pp.Skin(
        SOFT, taxels(channels=["displacement_x", "displacement_y", "displacement_z"], noise=1e-6), uncertainty=uncertain
    )
    pressed = pp.Skin(SOFT, taxels(), uncertainty=uncertain)
    assert moved.design(**how).bound.force[2] == pytest.approx(0.15, rel=0.05)
    assert pressed.design(**how).bound.force[0] == pytest.approx(pressed.design(**how).known.force[0])


def test_what_readings_do_not_tell_is_infinite() -> None:
    rows = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    assert np.isinf(np.diag(covariance(rows, np.ones(3), 2))).all()
    assert math.isinf(covariance(rows, np.ones(3), 3)[2, 2])
    assert covariance(rows, np.ones(3), 1, np.array([0.0, 1.0, 1.0]))[0, 0] == pytest.approx(1.0 + 1.0 / 5.0)
    few = pp.AreaArray(shape=(2, 2), pitch=4e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
    found = pp.Skin(SOFT, few).design()
    assert np.isinf(found.bound.force[0])
    assert any("do not determine" in note for note in found.notes())


@pytest.mark.long
def test_finer_waves_need_less_depth_until_the_pitch_ends_them() -> None:
    waves = [pp.Skin(SOFT, taxels(depth=d, noise=500.0)).design().wavenumber["z"] for d in (0.5e-3, 2e-3, 6e-3)]
    assert waves[0] == (pytest.approx(math.pi / 2e-3), "pitch")
    assert waves[2][1] == "noise"
    assert waves[0][0] > waves[2][0]
    # at the limit (1 + k z) exp(-k z) times the mean pressure is 1.96 deviations of a wave's amplitude over 64 taxels
    k = waves[2][0]
    signal = (1 + k * 6e-3) * math.exp(-k * 6e-3) / (math.pi * 4e-6)
    assert signal == pytest.approx(1.96 * 500.0 * math.sqrt(2 / 64), rel=0.05)


def test_two_in_plane_displacements_tell_no_wave_of_pressure_by_itself() -> None:
    gel = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    found = pp.Skin(gel, taxels(depth=1e-3, channels=["displacement_x", "displacement_y"], noise=2e-6)).design()
    assert found.components == ("x", "y", "z")
    assert found.wavenumber["z"][0] == 0.0
    assert math.isfinite(found.bound.force[2])  # a compact press is told
    assert any("only from the assumption that contact is compact" in note for note in found.notes())


def test_the_point_spread_is_that_of_wieners_filter_on_the_operator() -> None:
    """On a line with many taxels the resolution matrix of the same prior has the same width."""
    array = pp.LineArray(count=81, pitch=0.5e-3, depth=2e-3, channels=["stress_zz"], noise=500.0)
    skin = pp.Skin(SOFT, array)
    press = {"force": 100.0, "contact_radius": 2e-3}
    found = skin.design(**press)
    h = skin.surface.cell
    matrix = skin.operator.dense()[:, len(skin.surface.axes[0]) :]
    power = (
        (100.0 / 4e-3) ** 2 * 4e-3 / h
    )  # of a cell: the square of the mean traction times the contact's length over the cell's
    gain = power * matrix.T @ np.linalg.inv(power * matrix @ matrix.T + 500.0**2 * np.eye(81)) @ matrix
    row = gain[:, len(gain) // 2]
    x = skin.surface.axes[0]
    half = x[np.flatnonzero(row > 0.5 * row.max())]
    assert found.width("z") == pytest.approx(half[-1] - half[0] + h, abs=1.1 * h)


@pytest.mark.long
def test_the_smallest_noticed_force_is_noticed_and_rest_is_not() -> None:
    """The matched filter over all places, offsets taken out: 1 % of frames at rest and 95 % of contacts at that force pass its threshold."""
    array = taxels(shape=(6, 6))
    skin = pp.Skin(SOFT, array)
    found = skin.design()
    center = int(np.abs(found.noticed.places).sum(axis=1).argmin())
    place_, force = found.noticed.places[center], found.noticed.force[center]
    responses = np.stack(
        [
            skin.sense(pp.solutions.patch(half_widths=(0.5e-3, 0.5e-3), traction=1e6).shifted(p[1], p[0])).ravel()
            for p in found.noticed.places
        ]
    )
    responses -= responses.mean(axis=1, keepdims=True)
    rng = np.random.default_rng(3)
    filters = responses / np.linalg.norm(responses, axis=1, keepdims=True)
    rest = rng.standard_normal((4000, 36)) @ filters.T
    level = threshold(36) - 1.6449
    assert (np.abs(rest).max(axis=1) > level).mean() < 0.02
    contact = pp.solutions.patch(half_widths=(0.5e-3, 0.5e-3), traction=force / 1e-6).shifted(place_[1], place_[0])
    pressed = (skin.sense(contact).ravel() / 100.0 + rng.standard_normal((4000, 36))) @ filters.T
    assert (np.abs(pressed).max(axis=1) > level).mean() == pytest.approx(0.95, abs=0.03)


def test_shallow_taxels_far_apart_are_blind_between() -> None:
    far = pp.Skin(SOFT, taxels(pitch=6e-3, depth=1e-3)).design()
    near = pp.Skin(SOFT, taxels(pitch=1e-3, depth=1e-3)).design()
    assert far.noticed.blind > 0.2
    assert near.noticed.blind == 0.0
    assert any("Blind spots" in note for note in far.notes())


def test_the_range_is_where_a_reading_reaches_its_end() -> None:
    skin = pp.Skin(SOFT, taxels(limits=(0.0, 3e4), shape=(7, 7)))
    found = skin.design(force=1.0, contact_radius=2e-3)
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=found.saturation)
    free = pp.Skin(SOFT, taxels(shape=(7, 7)))
    assert free.sense(ball).max() == pytest.approx(3e4, rel=0.02)
    # Hertz: the peak, 1.5 F/(pi a^2), is 0.3 E
    assert found.linear == pytest.approx(0.3 * 2e5 * math.pi * 4e-6 / 1.5)
    assert math.isinf(free.design().saturation)


@pytest.mark.long
def test_a_pair_is_told_apart_from_farther_where_taxels_are_deeper() -> None:
    pairs = [
        pp.Skin(SOFT, taxels(shape=(14, 14), pitch=1e-3, depth=d, noise=500.0)).design(contact_radius=1e-3).pair
        for d in (1.5e-3, 3e-3, 6e-3)
    ]
    assert pairs[0] < pairs[1] < pairs[2]
    assert math.isinf(pp.Skin(SOFT, taxels(depth=8e-3, noise=5e3)).design(contact_radius=1e-3).pair)


def test_noise_scales_every_bound() -> None:
    one, ten = (pp.Skin(SOFT, taxels(noise=n)).design() for n in (10.0, 100.0))
    assert ten.known.force / one.known.force == pytest.approx(10.0)
    assert ten.known.center / one.known.center == pytest.approx([10.0, 10.0])
    assert ten.noticed.median / one.noticed.median == pytest.approx(10.0)


def test_a_scattered_array_and_a_regular_one_agree() -> None:
    regular = taxels()
    scattered = pp.ScatteredArray(positions=regular.points[:, ::-1], depth=2e-3, channels=["stress_zz"], noise=100.0)
    a, b = (pp.Skin(SOFT, array).design(contact_radius=2e-3).known for array in (regular, scattered))
    assert a.force == pytest.approx(b.force, rel=0.03)
    assert a.center == pytest.approx(b.center, rel=0.03)


# -- sweeps ----------------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_sweep_ranks_and_says_where_a_goal_ends() -> None:
    found = sweep(pp.Skin(SOFT, taxels(noise=2e3)), depth=[1e-3, 2e-3, 6e-3], goals={"pair": 3.5e-3})
    assert found.notes() == ["Deeper than 2 mm a pair 3.5 mm apart cannot be resolved at this noise."]
    assert found.meets().tolist() == [True, True, False]
    assert found.ranked("noticed").points[0] == {"depth": 1e-3}
    assert found.dataset().sizes == {"design": 3}
    assert found.csv().count("\n") == 4
    assert "goals" in found.text().splitlines()[0]


@pytest.mark.long
def test_a_sweep_keeps_the_area_or_the_taxels() -> None:
    skin = pp.Skin(SOFT, taxels())
    for keep, counts in (("taxels", [64, 64]), ("area", [64, 256])):
        assert [d.taxels for d in sweep(skin, keep=keep, pitch=[2e-3, 1e-3]).designs] == counts


@pytest.mark.long
def test_a_sweep_of_shapes_cannot_keep_the_area() -> None:
    """64 taxels were listed as a shape of 4 x 4."""
    skin = pp.Skin(SOFT, taxels())
    with pytest.raises(pp.InvalidInput, match="varies the shape too"):
        sweep(skin, keep="area", pitch=[2e-3, 1e-3], shape=[(4, 4)])
    assert [d.taxels for d in sweep(skin, pitch=[2e-3, 1e-3], shape=[(4, 4)]).designs] == [16, 16]


def test_forces_of_a_line_have_the_unit_of_a_line() -> None:
    """Its table said mN and N."""
    array = pp.LineArray(count=9, pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
    press = Press(force=100.0, contact_radius=2e-3)
    found = sweep(pp.Skin(SOFT, array), press=press, depth=[1e-3, 2e-3], goals={"noticed": 1e-9})
    head = found.text().splitlines()[0]
    assert "force [mN/m]" in head
    assert "range [N/m]" in head
    assert "mN/m is not detected" in found.notes()[0]
    assert [a.get_ylabel() for a in found.plot("depth", columns=["force", "pair"]).axes] == ["[mN/m]", "[mm]"]


@pytest.mark.long
def test_combinations_that_cannot_be_built_are_left_out_with_a_reason() -> None:
    gel = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    found = sweep(pp.Skin(gel, taxels()), depth=[1e-3, 4e-3])
    assert len(found) == 1
    assert any("Left out 1 design" in note and "below the rigid base" in note for note in found.notes())


@pytest.mark.long
def test_processes_give_the_same_numbers() -> None:
    skin = pp.Skin(SOFT, taxels())
    one, two = (sweep(skin, depth=[1e-3, 2e-3], jobs=n).numbers("force") for n in (1, 2))
    assert one == pytest.approx(two)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"depths": [1e-3]}, "cannot vary depths"),
        ({"depth": 1e-3}, "must be a list"),
        ({"depth": [1e-3], "keep": "all"}, "keep must be"),
        ({"depth": [1e-3], "goals": {"beauty": 1.0}}, "goal cannot be"),
        ({"depth": [1e-3], "goals": {"pair": -1.0}}, "must be a positive number"),
        ({"depth": [1e-3], "jobs": 0}, "jobs must be"),
        ({"thickness": [1e-3]}, "thickness belongs to bonded layers"),
        ({"channels": [["displacement_x"]]}, "other units"),
        ({"depth": [float("nan")]}, "no combination"),
    ],
)
def test_a_sweep_refuses_in_words(how: dict, words: str) -> None:
    with pytest.raises(pp.PalpateError, match=words):
        sweep(pp.Skin(SOFT, taxels()), **how)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"force": -1.0}, "force must be a positive number"),
        ({"force": float("nan")}, "force must be a positive number"),
        ({"contact_radius": 0.0}, "contact_radius must be"),
        ({"shear": 0.7}, "below friction"),
        ({"center": (1.0, 0.0)}, "far beside the array"),
        ({"center": (1.0,)}, "center must be"),
        ({"components": ["q"]}, "components must be"),
    ],
)
def test_a_press_refuses_in_words(how: dict, words: str) -> None:
    with pytest.raises(pp.InvalidInput, match=words):
        pp.Skin(SOFT, taxels()).design(**how)


def test_an_array_without_noise_is_refused() -> None:
    with pytest.raises(pp.Unsupported, match="needs the noise"):
        pp.Skin(SOFT, taxels(noise=None)).design()


# -- placement -------------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_placed_taxels_know_a_force_better_than_a_grid_of_as_many() -> None:
    extent, press = 16e-3, Press(force=1.0, contact_radius=2e-3)
    skin = pp.Skin(SOFT, taxels(shape=(4, 4), pitch=4e-3, depth=3e-3))
    placed = place(skin, count=16, extent=(extent, extent), press=press)
    assert placed.array.shape == (16,)
    assert np.abs(placed.array.positions).max() <= 0.5 * extent + 1e-12
    grid = {}
    for name, array in (("grid", skin.planes[0]), ("placed", placed.array)):
        body = pp.Skin(SOFT, array)
        found = [
            body.design(force=1.0, contact_radius=2e-3, center=(x, y)).known.force[0]
            for x in (-6e-3, 0.0, 6e-3)
            for y in (-6e-3, 0.0, 6e-3)
        ]
        grid[name] = float(np.sqrt(np.mean(np.square(found))))
    assert grid["placed"] < grid["grid"]


def test_placed_taxels_and_presses_lie_on_the_rectangle() -> None:
    """The candidate places of a strip were three times as far apart as it is wide."""
    extent = (16e-3, 2e-4)
    placed = place(pp.Skin(SOFT, taxels(depth=3e-3)), count=6, extent=extent)
    assert (np.abs(placed.array.positions) <= 0.5 * np.array(extent) + 1e-12).all()
    np.testing.assert_allclose(np.ptp(placed.places, axis=0)[1], extent[0])
    assert np.ptp(placed.places, axis=0)[0] <= extent[1] + 1e-12


@pytest.mark.parametrize(
    ("how", "words"), [({"count": 2}, "count must be"), ({"extent": (0.0, 1.0)}, "extent must be")]
)
def test_placement_refuses_in_words(how: dict, words: str) -> None:
    given: dict = {"count": 9, "extent": (16e-3, 16e-3)} | how
    with pytest.raises(pp.InvalidInput, match=words):
        place(pp.Skin(SOFT, taxels()), **given)


# -- files and the command -------------------------------------------------------------------------------------------------

FILE = (
    skin_text(8, 8, pitch="2 mm", depth="2 mm", noise="2 kPa")
    + """
[press]
force = "1 N"
contact_radius = "2 mm"

[sweep]
depth = ["1 mm", "2 mm", "6 mm"]

[goal]
pair = "3.5 mm"
"""
)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('force = "1 N"', "force = 1", "line 15.*no unit"),
        ("contact_radius", "radius", "radius is not a key of"),
        ('["1 mm", "2 mm", "6 mm"]', '"1 mm"', "line 19.*must be a list"),
        ('pair = "3.5 mm"', 'pairs = "3.5 mm"', "pairs is not a key"),
        ('depth = "2 mm"\n', 'depth = "2"\n', "line 10"),
    ],
)
def test_errors_of_a_file_name_the_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = tmp_path / "design.toml"
    path.write_text(FILE.replace(old, new, 1))
    with pytest.raises(pp.InvalidInput, match=words):
        read_design(path)


@pytest.mark.long
def test_the_command_ranks_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from palpate.cli.commands import app

    path = tmp_path / "design.toml"
    path.write_text(FILE)
    table, picture = tmp_path / "designs.csv", tmp_path / "designs.png"
    app(["design", str(path), "--out", str(table), "--plot", str(picture)], standalone_mode=False)
    said = capsys.readouterr().out
    assert "Deeper than 2 mm a pair 3.5 mm apart cannot be resolved at this noise." in said
    assert table.read_text().startswith("depth,force,")
    assert picture.stat().st_size > 5000
    with pytest.raises(pp.InvalidInput, match="exists"):
        app(["design", str(path), "--out", str(table)], standalone_mode=False)


def test_a_line_is_not_ranked_with_an_area(tmp_path: Path) -> None:
    """100 N/m and 100 N passed for one press, and mN/m were ranked with mN."""
    from palpate.cli.commands import app

    line, area = tmp_path / "line.toml", tmp_path / "area.toml"
    for path, taxel, force in ((line, (8,), "100 N/m"), (area, (6, 6), "100 N")):
        text = skin_text(*taxel, pitch="2 mm", depth="2 mm", noise="2 kPa")
        path.write_text(f'{text}\n[press]\nforce = "{force}"\ncontact_radius = "2 mm"\n\n[sweep]\ndepth = ["1 mm"]\n')
    with pytest.raises(pp.InvalidInput, match="a line and others an area"):
        app(["design", str(line), str(area)], standalone_mode=False)


def test_one_noise_is_not_that_of_two_units() -> None:
    array = taxels(channels=["stress_zz", "displacement_x"], noise=[100.0, 1e-6])
    with pytest.raises(pp.Unsupported, match="one noise cannot be that of stress_zz, displacement_x"):
        varied(SOFT, [array], {"noise": 50.0}, keep="taxels")
    _, (found,) = varied(SOFT, [array], {"noise": [50.0, 2e-6]}, keep="taxels")
    assert found.noise_std == (50.0, 2e-6)


@pytest.mark.long
def test_placed_taxels_keep_limits_and_noise() -> None:
    known = {"noise": 100.0, "noise_correlation": 1e-3, "limits": (0.0, 3e4), "aperture": 1e-3}
    array = place(pp.Skin(SOFT, taxels(**known)), count=6, extent=(8e-3, 8e-3)).array
    assert (array.noise_correlation, array.aperture) == (1e-3, 1e-3)
    assert array.limits is not None
    assert array.limits.tolist() == [[0.0, 3e4]]
    uneven = np.stack([np.zeros((1, *taxels().shape)), np.full((1, *taxels().shape), 3e4)], axis=1)
    uneven[0, 1, 0, 0] = 2e4
    with pytest.raises(pp.Unsupported, match="limits differ between taxels"):
        place(pp.Skin(SOFT, taxels(limits=uneven)), count=6, extent=(8e-3, 8e-3))
