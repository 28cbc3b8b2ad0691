"""Gels without dots: colours to slopes, slopes to depth, depth to force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from colour_scenes import Ball, Flat, Gel, Lamps, surface
from palpate.camera import SlopeModel, View, feel, learn_slopes, read_slopes, write_slopes
from palpate.camera.colour.integration import integrate
from palpate.camera.colour.response import Response, bases, ranks, solve_slopes
from palpate.errors import InvalidInput

E, NU = 3e5, 0.48
TOML = """[pad]
kind = "half_space"
youngs_modulus = "300 kPa +- 1 %"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"
depth = "0 mm"
channels = ["displacement_z"]

[camera]
scale = "0.12 mm"
size = [160, 120]
"""


@pytest.fixture(scope="module")
def gel() -> Gel:
    return Gel(Lamps(), size=(160, 120), scale=0.12e-3)


@pytest.fixture(scope="module")
def pictures(gel: Gel) -> list[Any]:
    rng = np.random.default_rng(4)
    places = ((-5e-3, 3e-3), (5e-3, 3e-3), (0.0, 0.0), (-5e-3, -3e-3), (5e-3, -3e-3), (0.0, 3.5e-3))
    return [gel.picture(rng=rng), *(gel.picture([Ball(4e-3, 1.6e-3, x, y)], rng=rng) for x, y in places)]


@pytest.fixture(scope="module")
def view(gel: Gel) -> View:
    return View.scaled(gel.scale, size=gel.size)


@pytest.fixture(scope="module")
def model(pictures: list[Any], view: View) -> SlopeModel:
    return learn_slopes(pictures, view, ball_diameter=8e-3)


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    pad = pp.HalfSpace(youngs_modulus=E, poissons_ratio=NU)
    array = pp.AreaArray(shape=(3, 3), pitch=1e-3, depth=0.0, channels=["displacement_z"])
    return pp.Skin(pad, array, uncertainty=pp.Uncertainty(youngs_modulus=0.01, scale=0.0))


def test_scenes_agree_with_hertz() -> None:
    """The closed form that judges: a shallow ball is Hertz's, and the punch's surface goes on as asin."""
    ball = Ball(50e-3, 1e-3)
    assert ball.force(1.0) == pytest.approx(4.0 / 3.0 * ball.contact**3 / ball.radius, rel=1e-3)
    r = np.array([1.0001e-3, 1.5e-3, 3e-3])
    punch = Flat(1e-3, 1e-4)
    assert surface([punch], r, 0.0 * r) == pytest.approx(2e-4 / np.pi * np.arcsin(1e-3 / r), rel=2e-3)
    hertz = 1e-3**2 / 50e-3 / np.pi * ((2 - (r / 1e-3) ** 2) * np.arcsin(1e-3 / r) + np.sqrt((r / 1e-3) ** 2 - 1))
    assert surface([ball], r, 0.0 * r) == pytest.approx(hertz, rel=4e-3)


def test_slopes_of_known_depth_integrate_to_it() -> None:
    y, x = np.mgrid[0:60, 0:80] * 1e-4
    depth = 1e-4 * np.exp(-((x - 4e-3) ** 2 + (y - 3e-3) ** 2) / (1e-3) ** 2)
    # exact slopes between neighbours, so that the discrete equation has this very solution
    gy, gx = -np.gradient(depth, 1e-4, axis=0), np.gradient(depth, 1e-4, axis=1)
    found = integrate(np.stack([gx, gy]), np.ones_like(depth), np.stack([x, -y]))
    assert np.abs(found - depth).max() < 0.03 * depth.max()


def test_masked_pixels_do_not_stop_the_integration() -> None:
    y, x = np.mgrid[0:60, 0:80] * 1e-4
    weight = np.where(np.hypot(x - 4e-3, y - 3e-3) < 1e-3, 0.05, 1.0)
    found = integrate(np.stack([0.1 * np.ones_like(x), 0.0 * x]), weight, np.stack([x, -y]))
    assert np.diff(found, axis=1) == pytest.approx(0.1e-4, rel=1e-3)


def test_response_is_inverted_with_its_standard_deviation() -> None:
    """Slopes of a known polynomial come back, scattered by what their covariance says."""
    rng = np.random.default_rng(0)
    above, place = ranks(2)
    coefficients = rng.standard_normal((3, *above.shape)) * 0.05 ** (above + place) * 0.3
    response = Response(coefficients, 2, 0.5)
    base = bases(np.zeros((2, 30, 40)), 0.4 + 0.1 * rng.random((30, 40, 3))).reshape(1200, -1)
    truth = rng.uniform(-0.3, 0.3, (1200, 2))
    noise = 0.01
    change = response.change(truth, base) + noise * rng.standard_normal((1200, 3))
    slopes, spread, misfit, _by = solve_slopes(response, change, base, noise**2 * np.eye(3))
    off = slopes - truth
    square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off)
    assert 1.7 < square.mean() < 2.3  # chi-squared of two
    assert 0.85 < misfit.mean() < 1.15  # and of one
    step = 1e-6
    moved = response.change(truth + np.array([step, 0.0]), base) - response.change(truth, base)
    _value, exact = response.derivative(truth, response.local(base))
    assert moved / step == pytest.approx(exact[..., 0], abs=1e-4)


@pytest.mark.long
def test_a_ball_of_another_size_has_its_depth_and_force(gel: Gel, model: SlopeModel, skin: pp.Skin) -> None:
    rng = np.random.default_rng(9)
    ball = Ball(3e-3, 1.2e-3, 2e-3, -1e-3)
    picture = gel.picture([ball], rng=rng)
    relief = model.relief(picture)
    truth = gel.depth([ball])
    assert relief.touching
    assert relief.near.any()
    off = (relief.depth - truth)[relief.near]
    assert np.std(off) < 0.1 * np.ptp(truth[relief.near])
    assert relief.std[truth > 0.5 * truth.max()].mean() > 0
    with feel([picture], skin, model=model) as touches:
        (touch,) = touches
    low, high = touch.interval(0.95, "force")
    force = ball.force(E / (1.0 - NU**2))
    assert low[2] < force < high[2]
    assert float(touch.force[2]) == pytest.approx(force, rel=0.3)
    assert touch.center_of_pressure == pytest.approx([2e-3, -1e-3], abs=0.3e-3)
    assert any("does not measure shear" in note for note in touch.notes)


@pytest.mark.long
def test_a_gel_at_rest_is_given_in_blocks(gel: Gel, model: SlopeModel) -> None:
    """The picture itself showed no contact; pixels that are saturated in it tell nothing."""
    rng = np.random.default_rng(9)
    rest, picture = gel.picture(rng=rng), gel.picture([Ball(3e-3, 1.2e-3, 2e-3, -1e-3)], rng=rng)
    for wrong in (rest, rest.astype(np.float64), rest[:60] / 255.0):
        with pytest.raises(InvalidInput, match=r"Give rest=model\.prepared"):
            model.relief(picture, rest=wrong)
    blocks = model.prepared(rest)[0]
    assert model.relief(picture, rest=blocks).touching
    blocks[40:80, 60:110] = 1.0
    assert not model.relief(picture, rest=blocks).known[40:80, 60:110].any()


@pytest.mark.long
def test_nothing_touches(gel: Gel, model: SlopeModel, skin: pp.Skin) -> None:
    rng = np.random.default_rng(10)
    quiet = [gel.picture(rng=rng) for _ in range(2)] + [gel.picture(rng=rng, dust=6)]
    quiet.append(gel.changed(exposure=0.55).picture(rng=rng))
    with feel(quiet, skin, model=model) as touches:
        for touch in touches:
            assert not bool(touch.touching)
            assert any("no contact" in note for note in touch.notes)


@pytest.mark.long
def test_another_gel_is_refused(model: SlopeModel, skin: pp.Skin) -> None:
    other = Gel(Lamps(angles=(0.0, 120.0, 240.0), exposure=0.4), size=(160, 120), scale=0.12e-3, seed=5)
    picture = other.picture([Ball(4e-3, 1.6e-3)], rng=np.random.default_rng(0))
    with pytest.raises(InvalidInput, match="another gel"):
        model.relief(picture)
    with feel([picture], skin, model=model) as touches:
        (touch,) = touches
    assert int(touch.status) == pp.Status.MISSING
    assert "another gel" in touches.faults[0]


def test_saturated_light_is_refused(gel: Gel, model: SlopeModel) -> None:
    white = np.full((120, 160, 3), 255, dtype=np.uint8)
    white[..., 0] = 254
    with pytest.raises(InvalidInput, match="saturated"):
        model.relief(white)


@pytest.mark.long
def test_a_steeper_ball_is_said(gel: Gel, model: SlopeModel) -> None:
    relief = model.relief(gel.picture([Ball(1.5e-3, 1.2e-3)], rng=np.random.default_rng(1)))
    assert any("steeper" in said or "does not show" in said for said in relief.said)


def test_the_calibration_states_its_errors(model: SlopeModel) -> None:
    assert len(model.table) == 6
    assert model.left_out.shape == (6, *model.response.coefficients.shape)
    assert 0 < model.gain_std < 0.3
    assert 0 < model.depth_error < 60e-6
    assert "6 presses of a ball of 8 mm" in str(model)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ball_diameter": 0.0}, "positive number of metres"),
        ({"ball_diameter": float("nan")}, "positive number of metres"),
        ({"ball_diameter": 8.0}, "positive number of metres"),
        ({"ball_diameter": 2e-3}, "more than a ball"),
        ({"baseline": 0}, "baseline"),
        ({"baseline": 7}, "leaves no press"),
    ],
)
def test_what_cannot_be_is_refused(pictures: list[Any], view: View, change: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        learn_slopes(pictures, view, **{"ball_diameter": 8e-3, **change})


def test_pictures_that_teach_nothing_are_refused(pictures: list[Any], view: View) -> None:
    with pytest.raises(InvalidInput, match="grey"):
        learn_slopes([np.repeat(p[..., :1], 3, axis=2) for p in pictures], view, ball_diameter=8e-3)
    with pytest.raises(InvalidInput, match="record \\(rows, columns, 3\\)"):
        learn_slopes([p[..., 0] for p in pictures], view, ball_diameter=8e-3)
    with pytest.raises(InvalidInput, match="a ball is found in 0 of 4"):
        learn_slopes([pictures[0]] * 5, view, ball_diameter=8e-3)
    with pytest.raises(InvalidInput, match="there are 3 pictures"):
        learn_slopes(pictures[:3], view, ball_diameter=8e-3)


def test_pictures_of_another_size_are_refused(model: SlopeModel, skin: pp.Skin) -> None:
    with pytest.raises(InvalidInput, match="80 x 60"):
        feel([np.zeros((60, 80, 3), dtype=np.uint8)], skin, model=model)


@pytest.mark.long
def test_the_file_holds_numbers_alone(model: SlopeModel, gel: Gel, tmp_path: Path) -> None:
    source = tmp_path / "gel.toml"
    source.write_text(TOML)
    target, numbers = write_slopes(tmp_path / "calibrated.toml", source, model)
    with np.load(numbers, allow_pickle=False) as held:
        assert all(held[name].dtype != object for name in held.files)
    again = read_slopes(target)
    assert again is not None
    picture = gel.picture([Ball(3e-3, 1.2e-3)], rng=np.random.default_rng(2))
    assert again.relief(picture).depth == pytest.approx(model.relief(picture).depth, abs=1e-8)
    with feel([picture], target) as touches:
        (touch,) = touches
    assert bool(touch.touching)
    numbers.write_bytes(b"nothing")
    with pytest.raises(InvalidInput, match="Calibrate again"):
        read_slopes(target)
    numbers.unlink()
    with pytest.raises(InvalidInput, match="not beside it"):
        read_slopes(target)


def test_a_skin_without_colours_is_refused(tmp_path: Path, skin: pp.Skin, gel: Gel) -> None:
    source = tmp_path / "gel.toml"
    source.write_text(TOML)
    picture = gel.picture(rng=np.random.default_rng(0))
    with pytest.raises(InvalidInput, match="--ball-diameter"):
        feel([picture], source)
    with pytest.raises(InvalidInput, match="model=learn_slopes"):
        feel([picture], skin)


@pytest.mark.long
def test_command_line(pictures: list[Any], gel: Gel, tmp_path: Path) -> None:
    import cv2
    from typer.testing import CliRunner

    from palpate.cli.commands import app

    folder = tmp_path / "presses"
    folder.mkdir()
    for i, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{i}.png"), picture[..., ::-1])
    new = gel.picture([Ball(3e-3, 1.2e-3)], rng=np.random.default_rng(2))
    cv2.imwrite(str(tmp_path / "new.png"), new[..., ::-1])
    (tmp_path / "gel.toml").write_text(TOML)
    run = CliRunner()
    out = str(tmp_path / "calibrated.toml")
    words = ["calibrate", str(folder), "--skin", str(tmp_path / "gel.toml"), "--ball-diameter", "8 mm", "--out", out]
    done = run.invoke(app, [*words, "--report", str(tmp_path / "colours.png")])
    assert done.exit_code == 0, done.output
    assert "6 presses" in done.output
    assert (tmp_path / "colours.png").stat().st_size > 1000
    done = run.invoke(app, ["reconstruct", str(tmp_path / "new.png"), "--skin", out, "--plot", str(tmp_path / "r.png")])
    assert done.exit_code == 0, done.output
    assert "net force z" in done.output
    assert (tmp_path / "new-touch.nc").exists()
    done = run.invoke(app, ["track", str(folder), "--skin", out, "--out", str(tmp_path / "f.csv"), "--every", "6"])
    assert done.exit_code == 0, done.output
    assert len((tmp_path / "f.csv").read_text().splitlines()) >= 2
    done = run.invoke(app, [*words, "--reference", "fz=Fz", "--force"])
    assert done.exit_code != 0
