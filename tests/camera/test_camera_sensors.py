"""Sensors that are known, their files, and a modulus that is weighed."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from camera_scenes import small_scene
from command_line import run
from palpate import sensors

pytest.importorskip("cv2")
pytest.importorskip("av")
for _name in ("typer", "pydantic", "h5netcdf"):
    pytest.importorskip(_name)

from palpate.camera import Displacements, Weighed, dot_grid, weigh, write_video  # noqa: E402
from palpate.recordings import read_camera, read_uncertainty  # noqa: E402

#: Stiffer than the skin below says.
GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=4e5, poissons_ratio=0.48)])
SCENE = small_scene(GEL)


@functools.cache
def press(force: float, radius: float = 2.5e-3) -> list[np.ndarray]:
    ball = pp.solutions.hertz_point(contact_radius=radius, force=force)
    return list(SCENE.pictures([None] * 3 + [SCENE.skin.sample(ball)] * 2))


def guess(folder: Path) -> Path:
    text = sensors.own_gel(reference=3, youngs_modulus="300 kPa +- 30 %", thickness="3.5 mm", depth="0.5 mm").text
    (folder / "gel.toml").write_text(text + '\n[surface]\nshape = [13, 16]\nspacing = "1 mm"\n')
    return folder / "gel.toml"


@pytest.mark.parametrize("name", [name for name, one in sensors.presets().items() if not one.unknown])
def test_each_preset_is_a_skin_with_a_camera(name: str, tmp_path: Path) -> None:
    path = sensors.preset(name).write(tmp_path / "skin.toml")
    camera = read_camera(path)
    assert camera is not None
    assert read_uncertainty(path).youngs_modulus == 0.3
    recording = pp.Recording(
        readings=np.zeros((1, 2, 12)), channels=["displacement_x", "displacement_y"], positions=dot_grid((3, 4), 2e-3)
    )
    assert pp.Skin.from_file(path, recording=recording).planes[0].shape == (12,)
    with pytest.raises(pp.InvalidInput, match="exists"):
        sensors.preset(name).write(path)


@pytest.mark.parametrize("name", [name for name, one in sensors.presets().items() if one.unknown])
def test_each_unknown_number_says_how_it_is_found(name: str, tmp_path: Path) -> None:
    """Nothing is made up: what nobody published is refused by its line, and the comment beside it says what to do."""
    found = sensors.preset(name)
    assert found.sources
    assert found.text.count('= "unknown"') == len(found.unknown)
    assert all(len(how) > 10 for how in found.unknown.values())
    with pytest.raises(pp.InvalidInput, match=r"line \d+: .*unknown"):
        pp.Skin.from_file(found.write(tmp_path / "skin.toml"))


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("nine_dtact", {"thickness": "4 mm", "youngs_modulus": "200 kPa"}),
        ("gelslim", {"thickness": "4 mm", "youngs_modulus": "200 kPa", "depth": "0.5 mm", "pitch": "2 mm"}),
        ("uskin", {"thickness": "4 mm", "youngs_modulus": "200 kPa", "depth": "2 mm"}),
    ],
)
def test_with_its_unknown_numbers_a_preset_is_a_skin(name: str, given: dict[str, str], tmp_path: Path) -> None:
    path = sensors.preset(name).changed(**given).write(tmp_path / "skin.toml")
    channels = ["displacement_z"] if name == "nine_dtact" else ["displacement_x", "displacement_y"]
    dots = pp.Recording(readings=np.zeros((1, len(channels), 12)), channels=channels, positions=dot_grid((3, 4), 2e-3))
    skin = pp.Skin.from_file(path, recording=None if name == "uskin" else dots)
    assert skin.planes[0].shape == ((4, 4) if name == "uskin" else (12,))


def test_what_is_not_published_is_refused_until_it_is_measured(tmp_path: Path) -> None:
    """No number is made up for a sensor whose maker gives none."""
    measured = {"thickness": "2.5 mm +- 5 %", "depth": "0.5 mm +- 10 %", "pitch": "2 mm"}
    recording = pp.Recording(
        readings=np.zeros((1, 2, 12)), channels=["displacement_x", "displacement_y"], positions=dot_grid((3, 4), 2e-3)
    )
    for index, key in enumerate(measured):
        path = sensors.digit(**{k: v for k, v in measured.items() if k != key}, youngs_modulus="200 kPa").write(
            tmp_path / f"{index}.toml"
        )
        with pytest.raises(pp.InvalidInput, match=rf"line \d+: {key} is unknown: measure it"):
            pp.Skin.from_file(path, recording=recording)
    path = sensors.digit(**measured).write(tmp_path / "soft.toml")
    with pytest.raises(
        pp.InvalidInput, match=r"line 11: youngs_modulus is unknown.*palpate weigh PICTURES --skin FILE"
    ):
        pp.Skin.from_file(path, recording=recording)
    path = sensors.digit(**measured, youngs_modulus="200 kPa +- 6 %").write(tmp_path / "known.toml")
    skin = pp.Skin.from_file(path, recording=recording)
    assert (skin.pad.layers[0].thickness, skin.uncertainty.youngs_modulus) == (2.5e-3, 0.06)  # type: ignore[attr-defined]
    assert 'youngs_modulus = "unknown"' in sensors.digit().text


@pytest.mark.long
def test_an_unknown_modulus_is_weighed(tmp_path: Path) -> None:
    """With no guess at all: the same answer as with one."""
    (tmp_path / "unknown.toml").write_text(guess(tmp_path).read_text().replace('"300 kPa +- 30 %"', '"unknown"'))
    found = weigh([press(1.0), press(1.5, 2e-3)], tmp_path / "unknown.toml", [1.0, 1.5])
    guessed = weigh([press(1.0), press(1.5, 2e-3)], guess(tmp_path), [1.0, 1.5])
    assert found.youngs_modulus == pytest.approx(guessed.youngs_modulus, rel=0.01)
    assert found.std == pytest.approx(guessed.std, rel=0.1)
    assert np.isnan(found.factor)
    assert found.ratios == pytest.approx(guessed.ratios / guessed.factor, rel=0.01)
    assert "times what the skin says" not in str(found)
    layer = '[[pad.layer]]\nthickness = "1 mm"\nyoungs_modulus = "1 MPa"\npoissons_ratio = 0.48\n\n[[plane]]'
    text = (tmp_path / "unknown.toml").read_text().replace("[[plane]]", layer)
    (tmp_path / "two.toml").write_text(text)
    with pytest.raises(pp.InvalidInput, match="Give a guess of the unknown one"):
        weigh(press(1.0), tmp_path / "two.toml", 1.0)


def test_numbers_are_overridden_and_others_refused(tmp_path: Path) -> None:
    path = sensors.own_gel(youngs_modulus="250 kPa +- 4 %", distance="20 mm", stage=True).write(tmp_path / "gel.toml")
    assert read_uncertainty(path).youngs_modulus == 0.04
    camera = read_camera(path)
    assert camera is not None
    assert camera.distance == 0.02
    assert camera.stage
    with pytest.raises(pp.InvalidInput, match="youngs_modulus"):
        sensors.own_gel(modulus="250 kPa")
    with pytest.raises(pp.InvalidInput, match="gelsight_mini"):
        sensors.preset("gelsight")


@pytest.mark.long
def test_a_scale_is_that_of_its_picture_size(tmp_path: Path) -> None:
    text = sensors.gelsight_mini(scale="0.05 mm").text
    (tmp_path / "a.toml").write_text(text)
    settings = read_camera(tmp_path / "a.toml")
    assert settings is not None
    pictures = press(1.0)[:3]
    with Displacements(pictures, settings, reference=3) as readings:  # 160 x 120: each pixel is two of 320 x 240
        np.testing.assert_allclose(np.diag(readings.view.homography)[:2], [0.1e-3, -0.1e-3])
    cut = [picture[:100] for picture in pictures]
    with pytest.raises(pp.InvalidInput, match="another shape"):
        Displacements(cut, settings, reference=3)


@pytest.mark.long
def test_a_known_force_sets_the_modulus(tmp_path: Path) -> None:
    found = weigh([press(1.0), press(1.5, 2e-3)], guess(tmp_path), [1.0, 1.5])
    assert abs(found.youngs_modulus - 4e5) < 2.0 * found.std
    assert found.std < 0.2 * found.youngs_modulus
    assert found.factor == pytest.approx(4 / 3, rel=0.1)
    assert found.agreement > 0.01
    assert "they agree" in str(found)
    assert "NOT explain" not in str(found)


def test_a_view_leaves_the_rest_of_the_camera_section(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures at rest and motion of the stage are those of the skin.toml, as in `follow`."""
    path = guess(tmp_path)
    text = path.read_text().replace("reference = 3", "reference = 7")
    path.write_text(text.replace("stage = false", "stage = true "))
    settings = read_camera(path)
    assert settings is not None
    assert (settings.reference, settings.stage) == (7, True)
    taken: list[tuple[int, bool]] = []

    def stopped(reading: Displacements, *_: object) -> None:
        taken.append((reading.reference, reading.stage))
        raise KeyboardInterrupt

    monkeypatch.setattr("palpate.camera.weighing._filmed", stopped)
    for view in (None, SCENE.view):
        with pytest.raises(KeyboardInterrupt):
            weigh([SCENE.picture()] * 8, path, 1.0, view=view)
    assert taken == [(7, True)] * 2


@pytest.mark.long
def test_presses_that_do_not_fit_say_so(tmp_path: Path) -> None:
    found = weigh([press(1.0), press(1.5, 2e-3)], guess(tmp_path), [1.0, 6.0])
    assert found.agreement < 0.01
    assert "NOT agree" in str(found)
    with pytest.raises(pp.InvalidInput, match="nothing presses"):
        weigh(press(1.0)[:3], guess(tmp_path), 1.0)
    with pytest.raises(pp.InvalidInput, match="positive"):
        weigh(press(1.0), guess(tmp_path), -1.0)
    with pytest.raises(pp.InvalidInput, match="one for each"):
        weigh([press(1.0)], guess(tmp_path), [1.0, 2.0])


def test_a_modulus_from_dots_that_no_press_moves_so_says_so() -> None:
    ones = np.ones(2)
    good = Weighed(3e5, 1e4, 1.0, ones, 0.1 * ones, 0.5, np.array([0.4, 0.02]))
    assert "NOT explain" not in str(good)
    poor = Weighed(9e4, 1e4, 0.45, ones, 0.1 * ones, 0.5, np.array([0.4, 4e-4]))
    assert "does NOT explain how the dots of press 1 move" in str(poor)


@pytest.mark.long
def test_the_commands(tmp_path: Path) -> None:
    write_video(tmp_path / "press.mp4", press(1.0), rate=30.0)
    skin = guess(tmp_path)
    done = run("weigh", "press.mp4", "--skin", skin.name, "--force", "1 N", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert 'youngs_modulus = "' in done.stdout
    assert run("weigh", "press.mp4", "--skin", skin.name, "--force", "1", cwd=tmp_path).returncode == 2
    listed = run("sensors", cwd=tmp_path)
    assert "gelsight_mini" in listed.stdout
    assert run("sensors", "own_gel", "--out", "mine.toml", cwd=tmp_path).returncode == 0
    assert (tmp_path / "mine.toml").read_text() == sensors.own_gel().text
    assert "there are" in run("sensors", "digits", cwd=tmp_path).stderr
    # a sensor by its name
    write_video(tmp_path / "still.mp4", press(1.0)[:3], rate=30.0)
    by_name = run("track", "still.mp4", "--skin", "gelsight_mini", "--baseline", "3", "--every", "3", cwd=tmp_path)
    assert "35 dots" in by_name.stdout, by_name.stderr
    unknown = run("track", "still.mp4", "--skin", "digit", cwd=tmp_path)
    assert "palpate sensors digit --out gel.toml" in unknown.stderr


def told(std: float) -> Weighed:
    return Weighed(
        youngs_modulus=3e5,
        std=std,
        factor=1.0,
        ratios=np.array([1.0]),
        ratio_std=np.array([std / 3e5]),
        agreement=float("nan"),
        fit=np.array([0.5]),
    )


@pytest.mark.parametrize(
    ("std", "said", "written"),
    [
        (2.28e4, "300 kPa +- 7.6 %", 'youngs_modulus = "300 kPa +- 7.6 %"'),
        (2.28e5, "300 kPa +- 76 %", 'youngs_modulus = "300 kPa +- 76 %"'),
        (2.99e5, "300 kPa +- 100 %", 'youngs_modulus = "300 kPa +- 99 %"'),
        (1.27e6, "300 kPa +- 4.2 times as much", "nothing: these presses do not determine the modulus."),
        (float("inf"), "300 kPa (uncertainty not known)", "nothing: these presses do not determine the modulus."),
    ],
)
def test_a_modulus_that_presses_do_not_tell_is_not_written(
    std: float, said: str, written: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No exponent, no per cent above 100, and a line for the skin.toml only where a skin.toml takes it."""
    pytest.importorskip("typer")
    from command_line import run

    monkeypatch.setattr("palpate.camera.weigh", lambda *_, **__: told(std))
    (tmp_path / "v.mp4").write_bytes(b"not looked at")
    (tmp_path / "gel.toml").write_text(sensors.own_gel(youngs_modulus="300 kPa", distance="20 mm").text)
    done = run("weigh", "v.mp4", "--skin", "gel.toml", "--force", "1 N", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"modulus         {said}" in done.stdout
    assert f"write           {written}" in done.stdout


@pytest.mark.long
def test_how_well_a_force_is_known_is_said_before_it_is_solved(tmp_path: Path) -> None:
    """Dots on the surface that move sideways tell a normal force to about its own size, with an exact modulus too; half a millimetre deeper they tell it."""
    found = {}
    for name, depth in (("gelsight_mini", None), ("deep", "0.5 mm")):
        if depth is not None:
            sensors.gelsight_mini(depth=depth).write(tmp_path / "deep.toml")
        skin = name if depth is None else "deep.toml"
        done = run("pad", skin, "--plot", f"{name}.png", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "7 x 10 dots 2 mm apart are assumed" in done.stdout
        assert "nan" not in done.stdout
        (line,) = [one for one in done.stdout.splitlines() if one.startswith("such a press is known to")]
        found[name] = [int(n) for n in re.findall(r"\+-(\d+) %", line)]
    mini, deep = found["gelsight_mini"], found["deep"]
    assert mini[0] > 90
    assert mini[1] < 70  # across; the frame fits narrowly, so that the model of the pad is doubted
    assert max(deep[2], deep[3]) < 40  # were pad and modulus exact
    assert "the normal force only to about its own size" in run("sensors", cwd=tmp_path).stdout


def test_presses_that_tell_the_modulus_worse_than_is_known_say_so() -> None:
    one = np.ones(1)
    poor = Weighed(3e5, 2.3e5, 0.76, one, one, float("nan"), 0.5 * one, before=0.3)
    assert not poor.better
    assert "what the skin says, +-30 %, is better" in str(poor)
    assert Weighed(3e5, 2e4, 0.76, one, one, float("nan"), 0.5 * one, before=0.3).better
