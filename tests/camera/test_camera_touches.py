"""The whole way: from rendered pictures, whose truth is known, to newtons."""

from __future__ import annotations

import dataclasses
import functools
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from camera_scenes import GEL, gel_file, small_scene
from command_line import run

cv2 = pytest.importorskip("cv2")
pytest.importorskip("av")
for _name in ("typer", "pydantic", "h5netcdf", "matplotlib"):
    pytest.importorskip(_name)

from palpate.camera import Displacements, Dots, Scene, View, dot_grid, follow, gel_skin, overlay  # noqa: E402
from palpate.recordings import read_recording, read_touch  # noqa: E402

BALL = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.5).shifted(1e-3, 0.5e-3).sliding(0.3, direction=0.5)
TRUE = np.array([0.45 * np.cos(0.5), 0.45 * np.sin(0.5), 1.5])
SKIN = gel_file('pitch = "2 mm"\nreference = 3', surface='shape = [13, 16]\nspacing = "1 mm"')
SCENE = small_scene()


@functools.cache
def pressed(part: float = 1.0) -> Any:
    return part * SCENE.skin.sample(BALL)


@functools.cache
def filmed(seed: int, hold: int, **stage: Any) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    parts = [0.0] * 4 + [0.3, 0.7] + [1.0] * hold
    moved = [stage if i > 3 else {} for i in range(len(parts))]
    return tuple(SCENE.picture(pressed(p) if p else None, rng=rng, **now) for p, now in zip(parts, moved))


def film(seed: int = 0, hold: int = 3, **stage: Any) -> list[np.ndarray]:
    return list(filmed(seed, hold, **stage))


def plain() -> pp.Skin:
    array = pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"])
    return pp.Skin(GEL, array, surface=pp.AreaGrid(shape=(13, 16), spacing=1e-3))


# -- displacements ---------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_displacements_are_those_of_the_pad_in_metres() -> None:
    with Displacements(film(), SCENE.view, reference=3, rate=30.0) as readings:
        recording = readings.recording()
    truth = SCENE.truth(pressed())
    which = np.hypot(*(readings.positions[:, None] - truth.positions[None]).transpose(2, 0, 1)).argmin(axis=1)
    u = truth.displacement[which, :2].T
    assert float(np.abs(u[1]).max()) > 2e-5  # y up, as in the pad's own frame
    np.testing.assert_allclose(recording.readings[-1], u, atol=0.02e-3)
    assert float(np.median(np.abs(recording.readings[-1] - u))) < 0.003e-3
    np.testing.assert_allclose(recording.time, np.arange(9) / 30.0)
    np.testing.assert_allclose(recording.positions, truth.positions[which], atol=0.02e-3)


@pytest.mark.long
def test_motion_of_the_stage_is_taken_out_and_reported() -> None:
    """To a fiftieth of the distance of the dots, where a good part of them is far from the contact."""
    wide = Scene(pad=GEL, depth=0.5e-3, print=Dots(dot_grid((7, 9), 2e-3), 0.8e-3), size=(320, 240), scale=0.06e-3)
    rng = np.random.default_rng(0)
    stage: dict[str, Any] = {"shift": (0.5e-3, -0.3e-3), "rotation": 0.03}
    rest, ball = [wide.picture(rng=rng) for _ in range(3)], wide.skin.sample(BALL)
    pictures = [*rest, wide.picture(ball, rng=rng, **stage), wide.picture(ball, rng=rng)]
    with Displacements(pictures, wide.view, reference=3, stage=True) as readings:
        found = list(readings)
    moved = found[3].stage
    assert moved is not None
    np.testing.assert_allclose(moved.shift, [0.5e-3, -0.3e-3], atol=0.02e-3)
    assert moved.rotation == pytest.approx(0.03, abs=2e-3)
    with Displacements(pictures, wide.view, reference=3) as readings:
        still = list(readings)[4]
    np.testing.assert_allclose(found[3].values, still.values, atol=0.04e-3)


def test_a_gel_that_moves_in_the_reference_is_refused() -> None:
    pictures = film()
    with pytest.raises(pp.InvalidInput, match="Nothing may touch the gel"):
        Displacements(pictures[3:7], SCENE.view, reference=4)
    with pytest.raises(pp.InvalidInput, match="smaller reference"):
        Displacements(pictures[:3], SCENE.view, reference=5)
    with pytest.raises(pp.InvalidInput, match="none of the first 4"):
        Displacements([np.zeros((120, 160), np.uint8)] * 4, SCENE.view)


# -- touches ---------------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_pictures_become_newtons_with_error_bars() -> None:
    with follow(film(), plain(), view=SCENE.view, reference=3, rate=30.0, track=True) as touches:
        found = list(touches)
        assert touches.tracker is not None
    assert len(found) == 9
    assert [float(t.force[2]) for t in found[:4]] == [0.0] * 4
    low, high = found[-1].interval(0.95, "force")
    np.testing.assert_allclose(found[-1].force[:2], TRUE[:2], atol=0.03)
    assert (low[:2] < TRUE[:2]).all()
    assert (high[:2] > TRUE[:2]).all()
    assert 0.5 < float(found[-1].force[2]) < 2.0
    assert any("misreads the normal force" in note for note in found[-1].notes)
    assert found[-1].time == pytest.approx(8 / 30)


@pytest.mark.long
def test_each_picture_by_itself_knows_pressure_better() -> None:
    pictures = film()
    with follow(pictures[:3] + pictures[-1:], plain(), view=SCENE.view, reference=3, track=False, every=3) as touches:
        found = list(touches)
        assert touches.tracker is None
    assert len(found) == 2  # pictures 0 and 3
    low, high = found[-1].interval(0.95, "force")
    np.testing.assert_allclose(found[-1].force, TRUE, rtol=0.1, atol=0.03)
    assert (low < TRUE).all()
    assert (high > TRUE).all()


@pytest.mark.long
def test_a_near_camera_does_not_lose_force() -> None:
    near = SCENE.changed(distance=25e-3)
    rng = np.random.default_rng(0)
    pictures = [near.picture(pressed(p) if p else None, rng=rng) for p in [0.0] * 4 + [0.5, 1.0, 1.0, 1.0, 0.0]]
    forces = {}
    # each picture by itself: a tracker has no more time than the camera gives, and what it finds goes by the machine
    for distance, track in ((None, False), (25e-3, False), (25e-3, True)):
        with follow(
            pictures, plain(), view=near.view, reference=3, rate=30.0, distance=distance, track=track
        ) as touches:
            forces[distance, track] = np.array([t.force for t in touches])
    assert abs(forces[25e-3, False][7, 2] - 1.5) < 0.6 * abs(forces[None, False][7, 2] - 1.5)
    for track in (False, True):
        assert forces[25e-3, track][8, 2] < 0.1  # let go: no ghost of the contact before


@pytest.mark.long
def test_bad_pictures_pass_and_say_why() -> None:
    pictures = film()
    pictures.insert(6, np.zeros_like(pictures[0]))
    with follow(pictures, plain(), view=SCENE.view, reference=3, rate=30.0, track=True) as touches:
        found = list(touches)
    assert len(found) == 10
    assert pp.Status(int(found[6].status)) is pp.Status.MISSING
    assert any("no touch in a picture: the picture is black" in note for note in found[6].notes)
    np.testing.assert_allclose(found[-1].force[:2], TRUE[:2], atol=0.03)
    with follow(pictures[:7], plain(), view=SCENE.view, reference=3, track=False, every=6) as touches:
        alone = list(touches)
    assert pp.Status(int(alone[-1].status)) is pp.Status.MISSING
    assert np.isnan(alone[-1].force).all()


def test_what_cannot_be_meant_is_refused() -> None:
    with pytest.raises(pp.InvalidInput, match="how pixels become metres"):
        follow(film(), plain())
    stress = pp.Skin(GEL, pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["stress_zz"]))
    with pytest.raises(pp.InvalidInput, match="displacement_x and displacement_y"):
        follow(film(), stress, view=SCENE.view, reference=3)
    with pytest.raises(pp.Unsupported, match="leave out every"):
        follow(film(), plain(), view=SCENE.view, reference=3, track=True, every=2)
    with pytest.raises(pp.InvalidInput, match="every must be"):
        follow(film(), plain(), view=SCENE.view, every=0)


@pytest.mark.long
def test_frames_are_solved_by_themselves_unless_a_tracker_is_asked_for() -> None:
    pictures = film()[:3]
    with follow(pictures, plain(), view=SCENE.view, reference=3) as touches:
        assert touches.tracker is None
    with follow(pictures, plain(), view=SCENE.view, reference=3, track=True) as touches:
        assert touches.tracker is not None


@pytest.mark.long
def test_a_result_lies_over_its_picture() -> None:
    """What presses on the right of the picture and above its middle is drawn there."""
    pictures = film()
    with follow(pictures, plain(), view=SCENE.view, reference=3, rate=30.0, track=True) as touches:
        touch = list(touches)[-1]
    x, y = touch.center_of_pressure
    column, row = SCENE.view.pixels([float(x), float(y)])
    assert column == pytest.approx(79.5 + 10.0, abs=3.0)
    assert row == pytest.approx(59.5 - 5.0, abs=3.0)
    assert touch.view is not None
    assert np.allclose(touch.view.pixels([1e-3, 2e-3]), SCENE.view.pixels([1e-3, 2e-3]))
    figure = overlay(pictures[-1], touch, title="one", truth=touch)
    assert len(figure.axes) == 3  # two pictures and a scale
    with pytest.raises(pp.InvalidInput, match="one frame"):
        overlay(
            pictures[-1],
            pp.Touch(np.zeros((2, 3, 4, 5)), pp.AreaGrid(shape=(4, 5), spacing=1e-3), ("z",), "x"),
            SCENE.view,
        )


#: As a GelSight Mini: dots on the surface.
MINI = Scene(
    pad=pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=4e5, poissons_ratio=0.48)]),
    depth=0.0,
    print=Dots(dot_grid((7, 10), 2e-3), 0.7e-3),
    size=(320, 240),
    scale=0.0634e-3,
)


@pytest.mark.parametrize("track", [False, True])
@pytest.mark.long
def test_intervals_allow_for_dots_that_are_hidden_where_something_presses(track: bool) -> None:
    """Thirty of seventy dots, those that move most, are hidden: shear of 1 N read 0.5 (0.24 to 0.82) without a word."""
    drag = pp.solutions.hertz_point(contact_radius=3e-3, force=5.0).shifted(-2e-3, 2e-3).sliding(0.2)
    truth = MINI.truth(drag)
    hidden = np.argsort(-np.hypot(*(truth.pixels - truth.rest).T))[:30]
    left = MINI.changed(print=Dots(np.delete(dot_grid((7, 10), 2e-3), hidden, axis=0), 0.7e-3))
    rng = np.random.default_rng(9)
    pictures = [*MINI.pictures([None] * 5), left.picture(drag, rng=rng)]
    array = pp.AreaArray(shape=(7, 10), pitch=2e-3, depth=0.0, channels=["displacement_x", "displacement_y"])
    with follow(pictures, pp.Skin(MINI.pad, array), view=MINI.view, rate=30.0, track=track) as touches:
        *_, touch = touches
    low, high = touch.interval(0.95, "force")
    assert low[0] < 1.0 < high[0]
    assert low[2] <= 5.0 < high[2]
    assert any("dots are lost where this presses" in note for note in touch.notes)


@pytest.mark.parametrize("track", [False, True])
@pytest.mark.long
def test_frames_without_an_answer_have_intervals_of_nan(track: bool) -> None:
    """While the zero is captured, and where a picture is black: a live loop must not end there."""
    pictures = film()
    pictures[5] = np.zeros_like(pictures[5])
    with follow(pictures, plain(), view=SCENE.view, reference=3, rate=30.0, track=track) as touches:
        for touch in touches:
            for of in ("traction", "force", "moment", "center_of_pressure", "peak_pressure"):
                low, high = touch.interval(0.95, of)
                assert np.shape(low) == np.shape(high)
                unknown = int(touch.status) in (int(pp.Status.MISSING), int(pp.Status.CAPTURING_ZERO))
                assert not unknown or np.isnan(np.asarray(low)).all()
            with pytest.raises(pp.InvalidInput, match="of must be one of"):
                touch.interval(0.95, "mass")
            assert np.isfinite(touch.exceeds(1.0, "force")) or unknown
            if touches.last.index == 5:
                assert np.isnan(touch.std()).all()
                assert int(touch.status) == int(pp.Status.MISSING)


@pytest.mark.long
def test_lost_dots_do_not_change_what_is_sought(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of many places pressure is not sought by default; with some of them lost it was, and a table ended in the middle of a recording."""
    from palpate.touch import Forces

    # Fewer dots than the real limit needs. The package exports a function of the module's name.
    monkeypatch.setattr(sys.modules["palpate.inverse.observability"], "NARROWED_READINGS", 1100)
    array = pp.ScatteredArray(
        positions=dot_grid((20, 29), 0.6e-3), depth=0.5e-3, channels=["displacement_x", "displacement_y"], noise=1e-6
    )
    skin = pp.Skin(GEL, array, surface=pp.AreaGrid(shape=(9, 12), spacing=1.6e-3))
    working = np.ones(580, dtype=bool)
    working[:200] = False
    assert skin.masked(working).components == skin.components == ("x", "y")
    forces = Forces()
    readings = skin.sense(BALL)
    for one in (skin, skin.masked(working)):
        forces.add(one.reconstruct(readings, method="tikhonov"))
    assert len(forces) == 2


# -- skin files and the command line ----------------------------------------------------------------------------------------


def palpate(*arguments: object, code: int = 0) -> str:
    """What the command prints, on either stream."""
    done = run(*map(str, arguments), cwd=Path.cwd())
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


def files(folder: Path, text: str = SKIN, pictures: list[np.ndarray] | None = None) -> tuple[Path, Path]:
    from palpate.camera import write_video

    (folder / "gel.toml").write_text(text)
    write_video(folder / "press.mp4", pictures or film(), rate=30.0)
    return folder / "press.mp4", folder / "gel.toml"


@pytest.mark.long
def test_track_takes_a_video(tmp_path: Path) -> None:
    video, skin = files(tmp_path)
    out = palpate("track", video, "--skin", skin, "--fast", "--out", tmp_path / "t.nc", "--picture", tmp_path / "t.png")
    assert "35 dots" in out
    assert "largest force" in out
    assert (tmp_path / "t.png").stat().st_size > 10_000
    touch = read_touch(tmp_path / "t.nc")
    assert touch.sizes["time"] == 9
    np.testing.assert_allclose(touch["force"][-1][:2], TRUE[:2], atol=0.04)
    assert read_recording(tmp_path / "t.nc").positions.shape == (35, 2)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ("", "[camera]"),
        ('[camera]\nscale = "0.1 mm"\npitch = "2 mm"\n', "one of them"),
        ("[camera]\nreference = 3\n", "got none"),
        ("[camera]\nscale = 0.1\n", "unit"),
        ('[camera]\nscale = "0.1 mm"\nlens = 3\n', "lens is not a key"),
        ("[camera]\npoints = [[1, 2], [3, 4], [5, 6], [7, 9]]\n", "places"),
    ],
)
def test_a_camera_that_is_described_badly(tmp_path: Path, camera: str, words: str) -> None:
    video, skin = files(tmp_path, SKIN.split("[camera]")[0] + camera)
    assert words in palpate("track", video, "--skin", skin, code=2)


def test_four_points_and_a_lens_from_the_file(tmp_path: Path) -> None:
    corners = [[10.0, 10.0], [150.0, 10.0], [150.0, 110.0], [10.0, 110.0]]
    places = [[f"{1e3 * x:.4f} mm", f"{1e3 * y:.4f} mm"] for x, y in SCENE.view.places(corners)]
    text = SKIN.split("[camera]")[0] + f"[camera]\npoints = {corners}\nplaces = {places}\nreference = 3\n".replace(
        "'", '"'
    )
    (tmp_path / "gel.toml").write_text(text)
    with follow(film()[:6], tmp_path / "gel.toml", rate=30.0) as touches:
        np.testing.assert_allclose(
            touches.readings.view.pixels(touches.readings.positions), touches.readings.markers.positions, atol=1e-6
        )
        np.testing.assert_allclose(touches.readings.view.places([79.5, 59.5]), [0.0, 0.0], atol=1e-6)


def test_options_that_do_not_belong_together(tmp_path: Path) -> None:
    video, skin = files(tmp_path)
    assert "--picture" in palpate("track", skin, "--skin", skin, "--picture", tmp_path / "a.png", code=2)
    assert "--budget" in palpate("track", video, "--skin", skin, "--budget", "3", code=2)
    assert "would be overwritten" in palpate("track", video, "--skin", skin, "--picture", video, code=2)
    assert "no such file" in palpate("track", tmp_path / "no.mp4", "--skin", skin, code=2)


def test_gel_skin_keeps_what_is_known() -> None:
    one = plain()
    known = pp.Skin(one.pad, one.planes, uncertainty=pp.Uncertainty(youngs_modulus=0.1))
    found = gel_skin(known, dot_grid((3, 4), 2e-3))
    assert found.uncertainty.youngs_modulus == 0.1
    assert found.planes[0].depth == 0.5e-3
    plane = dataclasses.replace(one.planes[0], aperture=0.4e-3, noise=1e-7, noise_correlation=1e-3)
    dots = gel_skin(pp.Skin(one.pad, plane), dot_grid((3, 4), 2e-3)).planes[0]
    assert (dots.aperture, dots.noise, dots.noise_correlation) == (0.4e-3, 1e-7, 1e-3)
    assert View.scaled(1e-4, size=(3, 3)).lens is None
