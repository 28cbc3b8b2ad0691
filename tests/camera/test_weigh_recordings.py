"""The modulus of a gel from known forces, in recordings and tables of its markers, and from forces over time."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp

pytest.importorskip("pydantic")

from palpate.camera import ForceTrace, read_force_trace, weigh
from palpate.camera.weighing import _without_modulus
from palpate.recordings import Recording

#: Stiffer than the skins below say by a third.
TRUE, SAID = 4e5, 3e5
CHANNELS = ("displacement_x", "displacement_y")
SHAPE, PITCH = (7, 8), 2e-3
SKIN = f"""[pad]
kind = "bonded_layers"
[[pad.layer]]
thickness = "4 mm"
youngs_modulus = "{SAID / 1e3:g} kPa +- 30 %"
poissons_ratio = 0.48
[[plane]]
kind = "scattered"
depth = "0.5 mm"
channels = ["displacement_x", "displacement_y"]
[surface]
shape = [14, 16]
spacing = "1.2 mm"
"""


def gel(modulus: float) -> pp.BondedLayers:
    return pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=modulus, poissons_ratio=0.48)])


def skin(modulus: float) -> pp.Skin:
    array = pp.AreaArray(shape=SHAPE, pitch=PITCH, depth=0.5e-3, channels=list(CHANNELS))
    return pp.Skin(gel(modulus), array, surface=pp.AreaGrid(shape=(14, 16), spacing=1.2e-3))


@functools.cache
def unit_press() -> np.ndarray:
    """Displacements of a gel of the true modulus under 1 N (channel, row, column)."""
    made = skin(TRUE)
    ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.0)
    return np.asarray(made.sense(made.sample(ball)))


def recording(loads: Any, *, noise: float = 0.3e-6, seed: int = 0) -> Recording:
    """A press with these normal forces [N], at 10 frames a second."""
    values = np.asarray(loads, dtype=np.float64)[:, None, None, None] * unit_press()
    values = values + noise * np.random.default_rng(seed).standard_normal(values.shape)
    return Recording(readings=values, channels=CHANNELS, time=0.1 * np.arange(len(values)))


STEP = [0.0] * 6 + [1.5] * 4
RAMP = [0.0] * 6 + list(np.linspace(0.1, 2.0, 14))


def marker_table(path: Path, held: Recording) -> Path:
    """One line for each marker and frame, as trackers write it, in pixels of 0.05 mm."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] * PITCH
    rows = ["frame,id,x,y,dx,dy"]
    for frame, (u, v) in enumerate(held.readings):
        at = zip(x.ravel(), y.ravel(), u.ravel(), v.ravel())
        rows += [f"{frame},{k}," + ",".join(f"{n / 0.05e-3:.6g}" for n in one) for k, one in enumerate(at)]
    path.write_text("\n".join(rows) + "\n")
    return path


MAP = "frame=frame,marker=id,x=x,y=y,displacement_x=dx,displacement_y=dy,pixel=0.05mm,rate=10"


@pytest.mark.long
def test_a_weight_on_markers_sets_the_modulus() -> None:
    found = weigh(recording(STEP), skin(SAID), 1.5)
    assert abs(found.youngs_modulus - TRUE) < 2 * found.std
    assert found.youngs_modulus == pytest.approx(TRUE, rel=0.15)
    assert found.std < 0.4 * TRUE
    # positions that were not zero at rest, and markers that were lost
    held = recording(STEP)
    values = held.readings + 1e-3
    values[:, :, 1, 2] = np.nan
    lost = weigh(Recording(readings=values, channels=CHANNELS, time=held.time), skin(SAID), 1.5)
    assert lost.youngs_modulus == pytest.approx(found.youngs_modulus, rel=0.1)


@pytest.mark.long
def test_forces_over_time_set_the_modulus() -> None:
    """A load cell below the gel: of the other sign, with a bias, faster than the frames."""
    time = np.linspace(-1.0, 3.0, 900)
    true = np.interp(time, 0.1 * np.arange(len(RAMP)), RAMP)
    held = recording(RAMP)
    plain = weigh(held, skin(SAID), ForceTrace(time, true, "a"))
    other = weigh(held, skin(SAID), ForceTrace(time, 7.0 - true, "b"))
    assert abs(plain.youngs_modulus - TRUE) < 2 * plain.std
    assert plain.youngs_modulus == pytest.approx(TRUE, rel=0.15)
    assert other.youngs_modulus == pytest.approx(plain.youngs_modulus, rel=1e-6)


def test_a_trace_of_another_clock_is_refused() -> None:
    held, time = recording(RAMP), np.linspace(0.0, 2.0, 200)
    true = np.interp(time, 0.1 * np.arange(len(RAMP)), RAMP)
    with pytest.raises(pp.InvalidInput, match="on one clock"):
        weigh(held, skin(SAID), ForceTrace(time + 1.7e9, true, "epoch.csv"))
    with pytest.raises(pp.InvalidInput, match="do not rise together"):
        weigh(held, skin(SAID), ForceTrace(time, np.cos(20.0 * time), "odd.csv"))
    with pytest.raises(pp.InvalidInput, match="must rise"):
        ForceTrace(np.array([0.0, 1.0, 0.5]), np.zeros(3), "back.csv")


def test_what_tells_no_modulus_is_refused() -> None:
    with pytest.raises(pp.InvalidInput, match=r"moves in the first 8 frames.*--baseline"):
        weigh(recording(STEP), skin(SAID), 1.5, reference=8)
    with pytest.raises(pp.InvalidInput, match="give fewer"):
        weigh(recording(STEP[:4]), skin(SAID), 1.5)
    with pytest.raises(pp.InvalidInput, match="nothing presses"):
        weigh(recording([0.0] * 10), skin(SAID), 1.5)
    with pytest.raises(pp.InvalidInput, match="positive"):
        weigh(recording(STEP), skin(SAID), float("nan"))
    with pytest.raises(pp.InvalidInput, match="one for each"):
        weigh([recording(STEP)] * 2, skin(SAID), [1.0])
    array = pp.AreaArray(shape=SHAPE, pitch=PITCH, depth=0.5e-3, channels=["stress_zz"])
    pressed = Recording(readings=np.ones((9, 1, *SHAPE)), channels=("stress_zz",))
    with pytest.raises(pp.Unsupported, match="without the modulus"):
        weigh(pressed, pp.Skin(gel(SAID), array), 1.5)


@pytest.mark.parametrize(
    ("text", "time", "force"),
    [
        ("time (s),fz (N)\n0,0\n1,2\n", [0, 1], [0, 2]),
        ("t_ms;Force [mN];other\n0;0;a\n500;1200;b\n", [0, 0.5], [0, 1.2]),
        ("time_s\tfz_N\tfx_N\n0,0\t0,5\t9\n0,5\t1,5\t9\n", [0, 0.5], [0.5, 1.5]),
        ("Timestamp (ms),load (kN),Fz (N)\n0,1,3\n10,1,4\n", [0, 0.01], [3, 4]),
    ],
)
def test_tables_of_forces(tmp_path: Path, text: str, time: list[float], force: list[float]) -> None:
    path = tmp_path / "force.csv"
    path.write_text(text)
    trace = read_force_trace(path)
    np.testing.assert_allclose(trace.time, time)
    np.testing.assert_allclose(trace.force, force)


def test_tables_of_forces_that_lack_something(tmp_path: Path) -> None:
    path = tmp_path / "force.csv"
    for text, words in (
        ("time (s),fz\n0,0\n1,2\n", r"fz does not say its unit.*fz \(N\)"),
        ("time (s),fz (g)\n0,0\n1,2\n", "accepted: N, mN, kN"),
        ("time (s),x\n0,0\n1,2\n", "no column of forces"),
        ("0,0\n1,2\n", "no column of times"),
        ("time (s),fz (N)\n1,0\n0,2\n", "must rise"),
    ):
        path.write_text(text)
        with pytest.raises(pp.InvalidInput, match=words):
            read_force_trace(path)
    with pytest.raises(pp.InvalidInput, match="no such file"):
        read_force_trace(tmp_path / "none.csv")


@pytest.mark.long
def test_the_command_takes_tables_and_traces(tmp_path: Path) -> None:
    pytest.importorskip("typer")
    from command_line import run

    (tmp_path / "gel.toml").write_text(SKIN)
    marker_table(tmp_path / "markers.csv", recording(STEP))
    rows = [f"{0.02 * k:.3f},{np.interp(0.02 * k, 0.1 * np.arange(len(STEP)), STEP):.4f}" for k in range(46)]
    (tmp_path / "force.csv").write_text("time (s),fz (N)\n" + "\n".join(rows) + "\n")
    for force in ("1.5 N", "force.csv"):
        done = run("weigh", "markers.csv", "--skin", "gel.toml", "--force", force, "--map", MAP, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        modulus = float(done.stdout.split('youngs_modulus = "')[1].split()[0])
        assert modulus == pytest.approx(TRUE / 1e3, rel=0.15)
    assert "no such file" in run("weigh", "markers.csv", "--skin", "gel.toml", "--force", "f.csv", cwd=tmp_path).stderr
    (tmp_path / "bad.toml").write_bytes(SKIN.encode() + b"# \xe9\n")
    (tmp_path / "pictures").mkdir()
    pytest.importorskip("cv2").imwrite(str(tmp_path / "pictures" / "0.png"), np.zeros((20, 20), dtype=np.uint8))
    filmed = run("track", "pictures", "--skin", "bad.toml", cwd=tmp_path)
    assert (filmed.returncode, filmed.stderr) == (
        2,
        "error: bad.toml: cannot be read as text in UTF-8 (invalid continuation byte); save it in UTF-8.\n",
    )
    for command in ("weigh", "track", "reconstruct"):
        more = ["--force", "1 N"] if command == "weigh" else []
        done = run(command, "markers.csv", "--skin", "bad.toml", "--map", MAP, *more, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (
            2,
            "error: bad.toml: cannot be read as text in UTF-8 (invalid continuation byte); save it in UTF-8.\n",
        ), command


def test_a_trace_without_forces_for_a_while_gives_none(tmp_path: Path) -> None:
    path = tmp_path / "force.csv"
    rows = [f"{0.1 * k:.1f},{'nan' if 30 <= k < 72 else 0.0}" for k in range(100)]
    path.write_text("time (s),fz (N)\n" + "\n".join(rows) + "\n")
    found = read_force_trace(path).at(np.array([2.0, 5.0, 8.0]))
    np.testing.assert_array_equal(found, [0.0, np.nan, 0.0])


@pytest.mark.parametrize(("boundary", "nuisance"), [("periodic", "auto"), ("free", ()), ("free", "auto")])
def test_the_skin_that_is_weighed_keeps_boundary_and_drift(boundary: str, nuisance: Any) -> None:
    given = pp.Skin(gel(SAID), skin(SAID).planes[0], boundary=boundary, nuisance=nuisance)
    found = _without_modulus(given)
    assert found.problem().boundary == given.problem().boundary == boundary
    assert (found.problem().nuisance is None) == (nuisance == "auto")
    assert found.uncertainty.youngs_modulus == 0.0


@pytest.mark.long
def test_a_periodic_gel_is_weighed_as_such() -> None:
    array = pp.AreaArray(
        shape=(8, 8),
        pitch=2e-3,
        depth=1e-3,
        channels=["displacement_x", "displacement_y", "displacement_z"],
        noise=1e-7,
    )
    made = pp.Skin(gel(SAID), array, boundary="periodic")
    ball = pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0).shifted(6e-3, 0.0)
    press = np.asarray(made.sense(ball))
    frames = np.stack([0.0 * press] * 5 + [press] * 4)
    frames = frames + 1e-7 * np.random.default_rng(0).standard_normal(frames.shape)
    held = Recording(readings=frames, channels=array.channels, time=np.arange(9.0))
    assert weigh(held, made, 2.0).factor == pytest.approx(1.0, rel=0.05)


@pytest.mark.long
def test_an_exact_modulus_is_known_better_than_presses_tell() -> None:
    exact = pp.Skin(
        gel(SAID), skin(SAID).planes[0], surface=skin(SAID).surface, uncertainty=pp.Uncertainty(youngs_modulus=0.0)
    )
    found = weigh(recording(STEP), exact, 1.5)
    assert found.before == 0.0
    assert not found.better
    assert weigh(recording(STEP), skin(SAID), 1.5).before == np.inf
