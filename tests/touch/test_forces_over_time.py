"""The answer first: numbers of every frame with their intervals, in tables and pictures; raw counts, single frames, zeros."""

from __future__ import annotations

import math
import mmap
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas
import pytest

import palpate as pp
from command_line import run
from palpate._plot import arrow_cells, nice, plot_forces
from palpate.archives.numbers import Numbers
from palpate.grasp import Event
from palpate.live.session import Session
from palpate.recordings import read_touch, write_recording, write_touch
from palpate.sensing.zero import FRAMES, STANDS, Levels, Rest, zero_of
from palpate.touch import Forces
from palpate.touch.rounding import decimals, format_interval
from palpate.touch.table import table_words, write_table
from skin_files import skin_text

SKIN = skin_text(15, channels=("stress_xz", "stress_zz"), depth="1 mm")
NOISE, OFFSETS = 5.0, 4e4


@pytest.fixture(scope="module")
def press() -> tuple[pp.Skin, Any]:
    """Ten frames at rest, two of a press that slides, four at rest; with the offsets of raw counts."""
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
    ball = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0).sliding(0.3))
    loads = np.array([0.0] * 10 + [0.5, 1.0] + [0.0] * 4)
    rng = np.random.default_rng(0)
    return skin, loads[:, None, None] * ball + NOISE * rng.standard_normal((16, 2, 15))


@pytest.fixture(scope="module")
def folder(press: tuple[pp.Skin, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("press")
    _, readings = press
    raw = readings + OFFSETS * (1.0 + np.random.default_rng(1).random((2, 15)))
    write_recording(
        pp.Recording(readings=raw, channels=("stress_xz", "stress_zz"), time=np.arange(16) / 50), path / "raw.csv"
    )
    (path / "skin.toml").write_text(SKIN)
    return path


@pytest.fixture(scope="module")
def touch(press: tuple[pp.Skin, Any]) -> pp.Touch:
    skin, readings = press
    return skin.reconstruct(readings[8:12], time=np.arange(4) / 50, friction=0.5)


def test_numbers_and_their_intervals_are_rounded_alike() -> None:
    assert format_interval(1.00234, 0.986, 1.0191, unit="N") == "1.002 N (0.986 to 1.019)"
    assert format_interval(-1e-9, -0.02, 0.02, unit="N") == "0.000 N (-0.020 to 0.020)"  # no minus before a zero
    assert format_interval(math.nan, 0.0, 1.0) == "not known"
    assert [decimals(w) for w in (0.013, 0.5, 70.0, math.inf, 0.0)] == [3, 2, 0, 0, 0]
    assert [nice(v) for v in (3.7e4, 1e3, 0.0)] == [2e4, 1e3, 1.0]


def test_a_table_holds_what_the_touch_says(touch: pp.Touch) -> None:
    table = touch.table()
    assert len(table) == 4
    np.testing.assert_allclose(table["time (s)"], np.arange(4) / 50)
    np.testing.assert_array_equal(table["force_z (N/m)"], touch.force[:, 1])
    low, high = touch.interval(0.95, "force")
    np.testing.assert_array_equal(table["force_x_low (N/m)"], low[:, 0])
    np.testing.assert_array_equal(table["force_x_high (N/m)"], high[:, 0])
    np.testing.assert_array_equal(
        table["slip_margin (Pa)"], touch.slip_margin(0.5)
    )  # with the friction it was found with
    np.testing.assert_array_equal(table["contact_width (m)"], touch.contact_area())
    assert table["status"].tolist() == ["undecided", "undecided", "solved", "solved"]
    assert touch.table(level=0.5)["force_z_high (N/m)"][3] < table["force_z_high (N/m)"][3]


def test_a_table_leaves_out_what_was_not_sought(press: tuple[pp.Skin, Any]) -> None:
    skin, readings = press
    table = skin.reconstruct(readings[11], components=["z"], method="tikhonov").table(friction=0.5)
    assert "force_z (N/m)" in table
    assert not [t for t in table if t.startswith(("force_x", "slip_margin", "moment"))]
    assert "frame" in table  # no time
    words = table_words(table)
    assert "force x" not in words


def test_a_missing_frame_among_others(touch: pp.Touch) -> None:
    """No number, no word "nan", and the others stay."""
    lost = pp.Touch(
        np.full((2, *touch.surface.shape), np.nan),
        touch.surface,
        ("x", "z"),
        "automatic",
        time=np.array(0.08),
        status=np.array(6, dtype=np.int8),
    )
    forces = Forces()
    forces.add(lost)
    forces.add(touch)
    table = forces.table()
    assert np.isnan(table["force_z (N/m)"][0])
    assert np.isfinite(table["slip_margin (Pa)"][3:]).all()
    words = table_words(table)
    assert "nan" not in words
    assert "missing" in words
    other = pp.Touch(np.zeros((3, 4, 4)), pp.AreaGrid(shape=(4, 4), spacing=1e-3), ("x", "y", "z"), "dft")
    with pytest.raises(pp.InvalidInput, match="begin a new one"):
        forces.add(other)
    with pytest.raises(pp.InvalidInput, match="no frames yet"):
        Forces().table()


@pytest.mark.long
def test_a_csv_opens_in_any_program(touch: pp.Touch, tmp_path: Path) -> None:
    """A line of titles, a line a frame, nothing else; seconds since 1970 keep their digits."""
    late = pp.Touch(touch.values, touch.surface, touch.components, "dft", time=1.7e9 + np.arange(4) / 1024)
    write_touch(late, tmp_path / "forces.csv")
    rows = pandas.read_csv(tmp_path / "forces.csv")
    assert rows.shape[0] == 4
    np.testing.assert_allclose(rows["time (s)"], late.time, rtol=0, atol=1e-6)
    some = late.table()
    some.loc[1, "time (s)"] = np.nan
    write_table(some, tmp_path / "some.csv")
    assert (tmp_path / "some.csv").read_text().splitlines()[2].startswith(",")  # unknown is empty
    write_touch(touch, tmp_path / "touch.nc")
    assert read_touch(tmp_path / "touch.nc").attrs["friction"] == 0.5


@pytest.mark.long
def test_raw_counts_are_noticed_and_zeroed(folder: Path, press: tuple[pp.Skin, Any], tmp_path: Path) -> None:
    skin, _ = press
    raw = pp.reconstruct_recording(skin, folder / "raw.csv", tmp_path / "a.csv", method="tikhonov")
    assert "--baseline 10" in raw.remarks[0]
    done = pp.reconstruct_recording(skin, folder / "raw.csv", tmp_path / "t.nc", baseline=10)
    assert done.remarks == ()
    force = done.table["force_z (N/m)"]
    assert force[:10].tolist() == [0.0] * 10
    low, high = done.table["force_z_low (N/m)"], done.table["force_z_high (N/m)"]
    true = np.array([5.0, 10.0])
    np.testing.assert_allclose(force[10:12], true, atol=0.4)
    assert (low[10:12] < true).all()
    assert (high[10:12] > true).all()
    assert done.frame == 11
    np.testing.assert_array_equal(done.touch.values, read_touch(done.path).traction.values[done.frame])
    one = pp.reconstruct_recording(skin, folder / "raw.csv", tmp_path / "one.nc", baseline=10, frame=11)
    assert (one.frames, one.frame, len(one.table)) == (1, 11, 1)
    np.testing.assert_allclose(one.touch.force, done.table.loc[11, ["force_x (N/m)", "force_z (N/m)"]].astype(float))
    assert float(read_touch(one.path).time[0]) == pytest.approx(11 / 50)


@pytest.mark.long
def test_offsets_that_noise_explains_are_noticed_because_they_stay(tmp_path: Path) -> None:
    """Offsets of either sign, twice as large as the press: "no contact" by themselves in every frame, but noise would change."""
    (tmp_path / "skin.toml").write_text(SKIN)
    skin = pp.Skin.from_file(tmp_path / "skin.toml")
    rng = np.random.default_rng(3)
    press = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0).sliding(0.3))
    loads = np.r_[np.zeros(16), np.linspace(0.1, 1.0, 4), np.zeros(4)]
    noise = NOISE * rng.standard_normal((24, 2, 15))
    raw = loads[:, None, None] * press + noise + 2.0 * abs(press).max() * rng.standard_normal((2, 15))
    levels = Levels()
    levels.look(raw)
    assert not levels.standing()

    with skin.track() as tracker:
        notes = [tracker.step(frame, i / 50).notes for i, frame in enumerate(raw)]
    assert not any(STANDS in n for n in notes[:FRAMES])
    assert all(STANDS in n for n in notes[FRAMES + 1 :])
    assert "--baseline 10" in STANDS
    for readings, given in (
        (raw, {"baseline": 10}),
        (raw, {"zero": raw[0]}),
        (raw - raw[0], {}),
        (noise, {}),
    ):  # what it says to do, and a sensor without offsets
        with skin.track(**given) as tracker:
            touches = [tracker.step(frame, i / 50) for i, frame in enumerate(readings)]
        assert not any(STANDS in touch.notes for touch in touches)
        if readings is not noise:
            np.testing.assert_allclose(touches[19].force[1], 10.0, atol=0.5)

    recording = pp.Recording(readings=raw, channels=("stress_xz", "stress_zz"), time=np.arange(24) / 50)
    write_recording(recording, tmp_path / "raw.csv")
    done = pp.reconstruct_recording(skin, recording, tmp_path / "raw.nc")
    assert done.remarks == (STANDS,)
    zeroed = pp.reconstruct_recording(skin, recording, tmp_path / "zeroed.nc", baseline=10)
    assert zeroed.remarks == ()
    told = run("track", "raw.csv", "--skin", "skin.toml", cwd=tmp_path)
    assert told.returncode == 0
    assert f"note: {STANDS}" in told.stdout
    session = Session(skin, lambda: zip(recording.time, raw), skin.track(), pp.GraspMonitor(), pace=False, pages=False)
    session.run()
    session.stop()
    assert [text for text in session.past if STANDS in text] == [f"{FRAMES / 50:.3f} s  {STANDS}"]


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"baseline": 16}, "from 0 to 15 of the 16"),
        ({"baseline": -1}, "number of frames >= 0"),
        ({"frame": 16}, "give 0 to 15, or -1"),
        ({"frame": 1, "resume": True}, "leave out resume"),
    ],
)
def test_what_cannot_be_zeroed_or_picked(
    options: dict[str, Any], match: str, folder: Path, press: tuple[pp.Skin, Any], tmp_path: Path
) -> None:
    with pytest.raises(pp.InvalidInput, match=match):
        pp.reconstruct_recording(press[0], folder / "raw.csv", tmp_path / "t.zarr", method="dft", **options)
    assert not (tmp_path / "t.zarr").exists()


def test_levels_tell_offsets_from_a_press() -> None:
    rng = np.random.default_rng(0)
    field = rng.standard_normal((1, 30))
    held = Levels()
    held.look(
        np.linspace(0.9, 1.0, 10)[:, None, None] * field
    )  # a press from the first frame on: some readings are near 0
    assert not held.standing()
    few = Levels()
    few.look(np.full((2, 1, 5), 1e4))
    assert not few.standing()  # two frames tell nothing
    bare = Levels()
    bare.look(np.full((5, 1, 5), np.nan))
    assert not bare.standing()


def test_rest_tells_noise_and_drift() -> None:
    rng = np.random.default_rng(2)
    frames = 300.0 + rng.standard_normal((20, 2, 4, 4))
    rest = Rest.of(frames)
    assert rest.noise is not None
    np.testing.assert_allclose(rest.noise, 1.0, atol=0.15)
    assert Rest.of(frames + np.linspace(0, 20, 20)[:, None, None, None]).wanders
    assert Rest.of(frames[:2]).noise is None
    assert Rest.of(np.full((9, 1, 3), 7.0)).noise is None  # no noise to be seen
    glitch = frames.copy()
    glitch[3] += 500.0
    np.testing.assert_allclose(zero_of(glitch), 300.0, atol=1.5)


@pytest.mark.long
def test_the_shell_says_the_answer_first(folder: Path, tmp_path: Path) -> None:
    out = run(
        *("reconstruct", "raw.csv", "--skin", "skin.toml", "--baseline", "10", "--friction", "0.5"),
        *(
            "--out",
            str(tmp_path / "f.csv"),
            "--plot",
            str(tmp_path / "a.png"),
            "--plot-forces",
            str(tmp_path / "f.png"),
        ),
        cwd=folder,
    )
    assert out.returncode == 0, out.stderr
    lines = out.stdout.splitlines()
    assert lines[0].split("  ")[0] == "time [s]"
    assert len([line for line in lines if line.endswith(("solved", "no contact"))]) == 16
    assert "largest traction: frame 1" in out.stdout
    assert len(pandas.read_csv(tmp_path / "f.csv")) == 16
    assert (tmp_path / "a.png").stat().st_size > 5000
    assert (tmp_path / "f.png").stat().st_size > 5000
    refused = run(
        *("reconstruct", "raw.csv", "--skin", "skin.toml", "--frame", "3", "--plot-forces", "x.png"), cwd=folder
    )
    assert refused.returncode == 2
    assert "leave out either" in refused.stderr


def test_arrows_miss_no_small_adhesion() -> None:
    """Wherever a single strong cell lies, it gets an arrow."""
    for i, j in ((0, 0), (7, 13), (39, 39), (20, 3)):
        size = np.full((40, 40), 0.01)
        size[i, j] = 1.0
        rows, columns = arrow_cells(size, (4.0, 4.0), 0.1)
        assert (rows.tolist(), columns.tolist()) == ([i], [j])
    rows, columns = arrow_cells(np.ones((30, 30)), (3.0, 3.0), 0.1)
    far = np.hypot(rows[:, None] - rows, columns[:, None] - columns)
    assert far[far > 0].min() >= 3.0


@pytest.mark.long
def test_figures(touch: pp.Touch) -> None:
    figure = touch.plot_forces(title="a press")
    assert [a.get_ylabel() for a in figure.axes] == ["net force [N/m]", "peak pressure\n[kPa]", "slip margin\n[Pa]"]
    event = Event("contact", True, 0.02, 1.0, 1.0, 0.0)
    marked = plot_forces(touch.table(), events=[event])
    assert "contact" in [t.get_text() for t in marked.axes[0].texts]
    for level, said in ((0.95, "95 %"), (0.5, "50 %")):
        half = touch.table(level=level)
        assert plot_forces(half).axes[0].get_title(loc="right") == f"bands hold {said}"
        assert table_words(half).endswith(f"(brackets hold {said})")
    from matplotlib.figure import Figure

    mine = Figure().subplots()
    assert touch.plot_forces(ax=mine) is mine.figure
    assert touch.plot(frame=2, ax=mine) is mine.figure
    area = np.zeros((3, 12, 10))
    area[2, 3, 4], area[2, 6, 6], area[0, 3, 4] = 5e3, -2e3, 1e3
    grid = pp.AreaGrid(shape=(12, 10), spacing=1e-3)
    pulled = pp.Touch(area, grid, ("x", "y", "z"), "tikhonov")
    drawn = pulled.plot()
    image = drawn.axes[0].images[0]
    assert image.get_clim() == (-5.0, 5.0)  # kPa, zero in the middle
    assert "seen from inside" in drawn.get_suptitle()
    outside = pulled.plot(seen_from="outside")
    assert outside.axes[0].yaxis_inverted()
    with pytest.raises(pp.InvalidInput, match="inside or outside"):
        pulled.plot(seen_from="above")
    with pytest.raises(pp.InvalidInput, match="leave out either"):
        pulled.plot(ax=mine, truth=area)
    assert pulled.plot(truth=area).axes[0].get_title(loc="left") == "recovered: pressure"


def test_what_is_said_of_frames_is_kept(touch: pp.Touch) -> None:
    """Notes of a stream are said once, with how many frames they are of: a tracker's caution is not lost with its maps."""
    from dataclasses import replace

    forces = Forces()
    forces.add(replace(touch[0], assumptions=("always", "once")))
    forces.add(replace(touch[1], assumptions=("always",)))
    assert forces.notes[:2] == ("always", "once (in 1 of 2 frames)")
    forces.add(replace(touch[2], assumptions=("always",), fit=np.array(1e-4)))
    assert any(n.startswith("undecided in 2 of 3 frames: noise or an offset explains") for n in forces.notes)
    assert any(n.startswith("the model does not explain the readings in 1 of 3 frames") for n in forces.notes)


def test_long_work_says_how_long_it_takes(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import rich.progress  # noqa: F401  takes the clock when it is first imported

    from palpate.cli import progress

    clock = iter([0.0, 10.0, 40.0, 50.0, 80.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    with progress.Frames("solving", 10, hint=" (hint)") as done:
        for k in range(1, 5):
            done(k)
    assert capsys.readouterr().err == (
        "solving: 2 of 10, about 3 min left (hint)\nsolving: 4 of 10, about 2 min left\n"
    )
    assert [progress.in_words(s) for s in (40, 600, 9000)] == ["40 s", "10 min", "2.5 h"]


def test_a_force_that_noise_makes_rough_says_how_rough() -> None:
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
    press = skin.sense(pp.solutions.hertz_line(half_width=2e-3, force=10.0))
    noise = np.random.default_rng(3).standard_normal(press.shape) * press.max()
    touch = skin.reconstruct(press + np.stack([0.01 * noise, 0.15 * noise]))
    assert not any("the net force is uncertain" in n for n in touch[:1].notes)
    (said_of_it,) = (n for n in touch.notes if "the net force is uncertain" in n)
    low, high = touch.interval(0.95, "force")
    load = np.linalg.norm(touch.values[1], axis=0).sum() * touch.surface.cell
    half = np.maximum(high - touch.force, touch.force - low)[1].max() / load  # to the longer side
    assert half > 0.3
    assert "in 1 of 2 frames: more than +- 30% of the load" in said_of_it
    (said_of_one,) = (n for n in touch[1].notes if "the net force is uncertain" in n)
    assert f"+- {half:.0%} of the load" in said_of_one


def test_the_unit_of_an_axis_suits_the_band_where_numbers_are_next_to_nothing() -> None:
    table = pandas.DataFrame({"time (s)": [0.0, 0.1]})
    for name, unit, value, half in (
        ("force_z", "N", 2.0, 0.1),
        ("peak_pressure", "Pa", 8e4, 1e3),
        ("slip_margin", "Pa", 3e-13, 6e3),
    ):
        table[f"{name} ({unit})"] = value
        table[f"{name}_low ({unit})"], table[f"{name}_high ({unit})"] = value - half, value + half
    table["status"], table["fit"] = "solved", 0.5
    labels = [ax.get_ylabel() for ax in plot_forces(table).axes]
    assert any("slip margin" in w and ("[Pa]" in w or "[kPa]" in w) for w in labels)
    assert "slip_margin [Pa]" in table_words(table) or "slip margin [Pa]" in table_words(table)


@pytest.mark.long
def test_a_run_says_of_all_its_frames_what_its_pieces_said_of_theirs(tmp_path: Path) -> None:
    """Counts of pieces add up; of the one frame that is shown, a note that holds for all says no count."""
    from palpate.recordings import read_touch

    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    skin = pp.Skin(pad, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=1e-3, channels=["stress_zz"], noise=20.0))
    rng = np.random.default_rng(0)
    frames = np.asarray(20.0 * rng.standard_normal((5, 1, 4, 4)))
    frames[:, 0, 1, 2] += 4000.0
    recording = pp.Recording(readings=frames, channels=["stress_zz"])
    done = pp.reconstruct_recording(skin, recording, tmp_path / "t.nc", chunk=2)
    small = [n for n in done.notes if n.startswith("small contact in")]
    assert all("in 5 of 5 frames" in n for n in small)
    assert small
    assert not [n for n in done.touch.notes if " of 2 frames" in n or " of 1 frames" in n]
    assert any(n.startswith("small contact:") for n in done.touch.notes)
    kept = str(read_touch(tmp_path / "t.nc").attrs["notes"])
    assert "in 5 of 5 frames" in kept
    assert "of 2 frames" not in kept


@pytest.mark.long
def test_numbers_of_many_frames_wait_in_a_file_and_are_the_same(
    folder: Path, press: tuple[pp.Skin, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    skin, _ = press
    few = pp.reconstruct_recording(skin, folder / "raw.csv", tmp_path / "few.nc", baseline=10, chunk=3)
    monkeypatch.setattr("palpate.archives.numbers.MAX_FRAMES_IN_MEMORY", 5)
    many = pp.reconstruct_recording(skin, folder / "raw.csv", tmp_path / "many.nc", baseline=10, chunk=3)
    one, other = few.table, many.table
    base = other["force_z (N/m)"].to_numpy()
    while isinstance(base, np.ndarray) and base.base is not None:
        base = base.base
    assert isinstance(base, mmap.mmap)  # nothing is read before it is looked at
    pandas.testing.assert_frame_equal(other.assign(status=other["status"].astype(one["status"].dtype)), one)
    assert (many.notes, many.remarks) == (few.notes, few.remarks)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["few.nc", "many.nc"]


def test_frames_that_lack_a_number_are_unknown_in_the_file_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A frame that is missing may lack the slip margin; the frames may come in any order."""
    monkeypatch.setattr("palpate.archives.numbers.MAX_FRAMES_IN_MEMORY", 1)
    numbers = Numbers(5, tmp_path)
    time = 0.5 * np.arange(5)
    margin = np.array([7.0, 8.0])
    numbers.add(3, {"time (s)": time[3:], "status": ["solved", "no contact"], "slip_margin (Pa)": margin})
    numbers.add(0, {"time (s)": time[:2], "status": ["solved", "solved"], "slip_margin (Pa)": margin + 2})
    numbers.add(2, {"time (s)": time[2:3], "status": ["missing"]})
    table = numbers.table()
    assert numbers.untouched().tolist() == [False] * 4 + [True]
    assert table["status"].tolist() == ["solved", "solved", "missing", "solved", "no contact"]
    np.testing.assert_array_equal(table["time (s)"], time)
    np.testing.assert_array_equal(table["slip_margin (Pa)"], [9.0, 10.0, np.nan, 7.0, 8.0])


def pressed_for(seconds: float, *, first: float = 0.0, spike: float = 1.0) -> pandas.DataFrame:
    """A table of a press of 2 N, and for three frames of hundred intervals that are ``spike`` times as wide."""
    count = 100
    table = pandas.DataFrame({"time (s)": first + np.linspace(0.0, seconds, count)})
    wide = np.ones(count)
    wide[40:43] = spike
    rise = np.clip(np.sin(np.linspace(0.0, 6.0, count)), 0.0, None)
    for name, unit, value, half in (
        ("force_x", "N", 0.3, 0.05),
        ("force_z", "N", 2.0, 0.1),
        ("peak_pressure", "Pa", 8e4, 3e3),
        ("slip_margin", "Pa", 1e4, 2e3),
    ):
        table[f"{name} ({unit})"] = value * rise
        table[f"{name}_low ({unit})"] = value * rise - half * wide
        table[f"{name}_high ({unit})"] = value * rise + half * wide
    table["status"], table["fit"] = "solved", 0.5
    return table


def overprinted(figure: Any) -> list[tuple[str, str]]:
    """Pairs of texts of a figure that lie on each other, of those that are drawn."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    drawn: dict[int, Text] = {}
    draw = Text.draw

    def kept(self: Text, *given: Any, **options: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            drawn[id(self)] = self
        draw(self, *given, **options)

    with mock.patch.object(Text, "draw", kept):
        FigureCanvasAgg(figure).draw()
    boxes = [(t.get_text(), t.get_window_extent()) for t in drawn.values()]
    return [(a, b) for i, (a, one) in enumerate(boxes) for b, other in boxes[:i] if one.overlaps(other)]


@pytest.mark.parametrize("many", [1, 3, 40])
@pytest.mark.parametrize("mine", [False, True])
@pytest.mark.long
def test_names_of_events_lie_on_no_other_text(many: int, mine: bool) -> None:
    """However many events there are, and however close."""
    from matplotlib.figure import Figure

    from palpate._plot import draw_forces
    from palpate._plot.forces import MARKED

    first = 1764091629.25
    table = pressed_for(12.0, first=first)
    events = [
        Event(kind, began, first + 1.0 + 0.01 * (7 * i + k) + 0.005 * (not began), 1.0, 1.0, 0.0)
        for i in range(many)
        for k, kind in enumerate(MARKED)
        for began in (True, False)
    ]
    events += [Event("contact", True, first, 1.0, 1.0, 0.0), Event("slip", True, first + 12.0, 1.0, 1.0, 0.0)]
    if mine:
        figure = Figure(figsize=(4.0, 3.0), layout="constrained")
        draw_forces(figure.subplots(), table, events=events)
        named = figure.axes[0].child_axes[0]
    else:
        figure = plot_forces(table, events=events, title="a press")
        named = figure.axes[0]
    assert overprinted(figure) == []
    assert sorted(t.get_text() for t in named.texts) == sorted(MARKED)  # each kind once


@pytest.mark.parametrize(
    ("first", "label", "begins"),
    [
        (0.0, "time [s]", 0.0),
        (0.05, "time [s]", 0.05),
        (50.0, "time [s]\nfrom 50 s", 0.0),
        (-3.0, "time [s]\nfrom -3 s", 0.0),
        (1764091629.25, "time [s]\nfrom 2025-11-25 17:27:09 UTC", 0.0),
    ],
)
def test_time_begins_at_zero_and_the_caption_says_when_that_was(first: float, label: str, begins: float) -> None:
    figure = plot_forces(pressed_for(12.0, first=first), events=[Event("contact", True, first + 3.0, 1.0, 1.0, 0.0)])
    panel = figure.axes[-1]
    assert panel.get_xlabel() == label
    assert panel.get_xlim() == pytest.approx((begins, begins + 12.0))
    assert figure.axes[0].lines[0].get_xdata() == pytest.approx([begins + 3.0])  # the event, on the same clock


def test_an_axis_shows_values_where_a_few_intervals_are_hundreds_of_times_as_wide() -> None:
    usual, spiked = (plot_forces(pressed_for(1.0, spike=spike)) for spike in (1.0, 400.0))
    for before, after in zip(usual.axes, spiked.axes):
        low, high = before.get_ylim()
        assert np.ptp(after.get_ylim()) < 1.6 * (high - low)
        assert after.get_ylabel() == before.get_ylabel()
        assert [t.get_text() for t in after.texts] == ["bands cut"]
        assert not before.texts
    # intervals that are wide throughout are shown
    wide = pressed_for(1.0)
    wide["force_z_low (N)"], wide["force_z_high (N)"] = wide["force_z (N)"] - 30.0, wide["force_z (N)"] + 30.0
    low, high = plot_forces(wide).axes[0].get_ylim()
    assert low < -29.9
    assert high > 31.9
