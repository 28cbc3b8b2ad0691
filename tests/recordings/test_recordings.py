from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray

import palpate as pp
from palpate.errors import InvalidInput
from palpate.recordings import Recording, read_recording, read_table, read_touch, recorder, write_recording, write_touch
from palpate.units import parse_quantity

GRIDDED = pp.Recording(
    readings=np.random.default_rng(0).standard_normal((3, 2, 4, 5)),
    channels=("stress_xz", "strain_zz"),
    time=[0.0, 0.01, 0.05],
    meta={"sensor": "left finger", "µ": "ü"},
)
SCATTERED = pp.Recording(
    readings=np.where(np.random.default_rng(1).uniform(size=(2, 2, 7)) < 0.1, np.nan, 1e-6),
    channels=("displacement_x", "displacement_y"),
    positions=np.random.default_rng(2).uniform(size=(7, 2)) * 1e-3,
)
LINE = pp.Recording(readings=np.ones((1, 1, 4), dtype=np.float32), channels=("stress_zz",), positions=np.arange(4.0))


@pytest.mark.parametrize("ending", [".nc", ".h5", ".npz", ".csv"])
@pytest.mark.parametrize("recording", [GRIDDED, SCATTERED, LINE])
def test_round_trip(recording: pp.Recording, ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"recording{ending}"
    write_recording(recording, path)
    back = read_recording(path)
    np.testing.assert_array_equal(back.readings, recording.readings)
    if ending != ".csv":
        assert back.readings.dtype == recording.readings.dtype
    assert back.channels == recording.channels
    np.testing.assert_array_equal(back.time, recording.time)
    assert back.meta == recording.meta
    if recording.positions is None:
        assert back.positions is None
    else:
        np.testing.assert_array_equal(back.positions, recording.positions)
    assert os.listdir(tmp_path) == [path.name]


def test_netcdf_opens_in_xarray(tmp_path: Path) -> None:
    write_recording(GRIDDED, tmp_path / "a.nc")
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf", decode_times=False) as data:
        assert data["readings"].dims == ("time", "channel", "y", "x")
        assert list(data["channel"].values) == ["stress_xz", "strain_zz"]
        assert data["time"].attrs["units"] == "s"


@pytest.fixture(scope="module")
def touches() -> list[pp.Touch]:
    """Two frames on an area and on a line."""
    rng = np.random.default_rng(0)
    contacts = (
        pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.1),
        pp.solutions.hertz_line(half_width=2e-3, force=30.0),
    )
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.4)
    arrays = (
        pp.AreaArray(shape=(5, 6), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=500.0),
        pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=500.0),
    )
    skins = [pp.Skin(pad, array) for array in arrays]
    return [s.reconstruct(s.sense(np.stack([s.sample(c)] * 2), rng=rng)) for s, c in zip(skins, contacts)]


@pytest.mark.parametrize("ending", [".nc", ".npz", ".csv"])
@pytest.mark.long
def test_results(ending: str, touches: list[pp.Touch], tmp_path: Path) -> None:
    for touch in touches:
        path = tmp_path / f"touch{ending}"
        write_touch(touch, path, provenance={"command": "palpate reconstruct x"})
        if ending == ".nc":
            data = read_touch(path)
            np.testing.assert_array_equal(data["traction"].values, touch.values)
            np.testing.assert_allclose(data["force"].values, touch.force)
            assert data.attrs["command"] == "palpate reconstruct x"
            assert data["traction"].attrs["units"] == "Pa"
        elif ending == ".npz":
            with np.load(path) as data:
                np.testing.assert_array_equal(data["traction"], touch.values)
        else:
            import pandas

            rows = pandas.read_csv(path)
            normal = next(t for t in rows if t.startswith("force_z ("))
            np.testing.assert_allclose(rows[normal], np.atleast_2d(touch.force)[:, -1], rtol=1e-5)
    with pytest.raises(pp.InvalidInput, match=r"read back as \.nc, \.h5, \.hdf5, \.zarr; got '\.csv'"):
        read_touch(tmp_path / "touch.csv")


def test_one_channel_on_two_planes(tmp_path: Path) -> None:
    recording = pp.Recording(readings=np.ones((1, 2, 3, 3)), channels=("stress_zz", "stress_zz"))
    write_recording(recording, tmp_path / "a.nc")
    assert read_recording(tmp_path / "a.nc").channels == ("stress_zz", "stress_zz")
    with pytest.raises(pp.InvalidInput, match="several planes"):
        write_recording(recording, tmp_path / "a.csv")
    assert os.listdir(tmp_path) == ["a.nc"]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"readings": np.zeros((3, 2))}, "axes"),
        ({"readings": np.zeros((0, 2, 4, 5))}, "empty"),
        ({"readings": np.full((3, 2, 4, 5), np.inf)}, "infinite"),
        ({"readings": np.zeros((3, 2, 4, 5), dtype=complex)}, "real"),
        ({"channels": ("stress_xz", "pressure")}, "not known"),
        ({"channels": ("stress_xz",)}, "1 channels"),
        ({"time": [0.0, 0.0, 1.0]}, "increase"),
        ({"time": [0.0, 1.0]}, "3 finite"),
        ({"positions": np.zeros((20, 2))}, "positions"),
    ],
)
def test_bad_recordings(changes: dict[str, Any], word: str) -> None:
    options = {"readings": GRIDDED.readings, "channels": GRIDDED.channels, "time": GRIDDED.time} | changes
    with pytest.raises(pp.InvalidInput, match=word):
        pp.Recording(**options)


@pytest.mark.parametrize("ending", [".nc", ".npz", ".csv"])
def test_truncated_files_are_named(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"cut{ending}"
    write_recording(GRIDDED, path)
    whole = path.read_bytes()
    for part in (0.3, 0.7, 0.97):
        path.write_bytes(whole[: int(len(whole) * part)])
        with pytest.raises(pp.InvalidInput, match="cut"):
            read_recording(path)
    path.write_bytes(b"")
    with pytest.raises(pp.InvalidInput, match="empty"):
        read_recording(path)


def test_foreign_containers_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", other=np.zeros(3))
    with pytest.raises(pp.InvalidInput, match=r"lacks readings, channel, time.*other"):
        read_recording(tmp_path / "a.npz")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(pp.InvalidInput, match="lacks"):
        read_recording(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("time (s),stress_zz[0] (Pa)\n", "no frames"),
        ("t (s),stress_zz[0] (Pa)\n0,1\n", "first column"),
        ("time (s),stress_zz[0]\n0,1\n", "no unit"),
        ("time (s),stress_zz[0] (mm)\n0,1\n", "mm"),
        ("time (s),stress_zz (Pa)\n0,1\n", "not like"),
        ("time (s),stress_zz[0] (Pa),stress_zz[2] (Pa)\n0,1,2\n", "fill"),
        ("time (s),stress_zz[0] (Pa),stress_zz[1;1] (Pa)\n0,1,2\n", "one and two"),
        ("time (s),stress_zz[0] (Pa)\n0,1\n1,2,3\n", "line 3"),
        ("time (s),stress_zz[0] (Pa)\n0,abc\n", "'abc' is not a number"),
        ("# positions (m): [[0,\ntime (s),stress_zz[0] (Pa)\n0,1\n", "positions"),
    ],
)
def test_bad_csv(text: str, word: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(pp.InvalidInput, match=word):
        read_recording(path)


def test_csv_units_are_converted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time (ms),stress_zz[0] (kPa),stress_zz[1] (Pa)\n0,1.5,2\n10,,4\n")
    back = read_recording(path)
    np.testing.assert_allclose(back.time, [0, 0.01])
    np.testing.assert_allclose(back.readings[0, 0], [1500, 2])
    assert back.missing.tolist() == [True, False]


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    write_recording(GRIDDED, path)
    before = path.read_bytes()

    def full(*args: Any, **kwargs: Any) -> None:
        args[0].write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(pp.InvalidInput, match=r"No space left.*nothing was written"):
        write_recording(SCATTERED, path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.npz"]


def test_gridding_reproduces_smooth_fields() -> None:
    positions = np.random.default_rng(0).uniform(-1e-3, 1e-3, (900, 2))
    field = 1e-6 * np.sin(2e3 * positions[:, 0]) * np.cos(1e3 * positions[:, 1])
    recording = pp.Recording(
        readings=np.stack([field, 2 * field])[None], channels=("displacement_x", "displacement_y"), positions=positions
    )
    grid = recording.gridded(5e-5)
    pitch, x0, y0 = (float(grid.meta[k]) for k in ("pitch", "x0", "y0"))
    n = grid.readings.shape[2:]
    x, y = x0 + pitch * np.arange(n[1]), y0 + pitch * np.arange(n[0])
    expected = 1e-6 * np.sin(2e3 * x) * np.cos(1e3 * y[:, None])
    inside = (slice(3, -3), slice(3, -3))
    np.testing.assert_allclose(grid.readings[0, 0][inside], expected[inside], atol=2e-8)
    np.testing.assert_allclose(grid.readings[0, 1], 2 * grid.readings[0, 0], rtol=1e-9)
    with pytest.raises(pp.InvalidInput, match="scattered"):
        GRIDDED.gridded(1.0)
    with pytest.raises(pp.InvalidInput, match="wider"):
        recording.gridded(1e-9)


def test_gridding_leaves_a_missing_reading_out_of_its_own_frame_only() -> None:
    """A taxel with a missing reading was left out of all frames; a frame without readings was a ValueError."""
    beads = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * 1e-3
    whole = np.zeros((3, 2, 25))
    whole[0, :, 12] = 1.0
    gaps = whole.copy()
    gaps[1, 0, 12] = np.nan
    gaps[2] = np.nan
    wanted, found = (
        pp.Recording(readings=r, channels=("displacement_x", "displacement_y"), positions=beads).gridded(1e-3).readings
        for r in (whole, gaps)
    )
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-12)
    assert np.abs(found[0]).max() > 0.1
    np.testing.assert_allclose(found[1], 0.0, atol=1e-12)
    assert np.isnan(found[2]).all()


@pytest.mark.parametrize("fault", ["missing", "line"])
def test_gridding_needs_an_area_of_readings(fault: str) -> None:
    positions = np.outer(np.arange(5.0), [1e-3, 1e-3]) if fault == "line" else np.random.default_rng(0).random((5, 2))
    readings = np.full((1, 1, 5), np.nan if fault == "missing" else 1.0)
    with pytest.raises(pp.InvalidInput, match="span an area"):
        pp.Recording(readings=readings, channels=["displacement_x"], positions=positions).gridded(1e-3)


def test_tables_of_others(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a,x,y,u,v\n9,1,2,0.5,0.25\n9,3,4,-0.5,0\n")
    options = {
        "columns": ["x", "y", "u", "v"],
        "channels": ["displacement_x", "displacement_y"],
        "position_factor": 1e-6,
        "reading_factor": 1e-6,
    }
    table = read_table(tmp_path / "t.csv", **options, follow=True)
    np.testing.assert_allclose(table.positions, [[1.5e-6, 2.25e-6], [2.5e-6, 4e-6]])
    np.testing.assert_allclose(table.readings[0], [[0.5e-6, -0.5e-6], [0.25e-6, 0]])
    with pytest.raises(pp.InvalidInput, match="no column w"):
        read_table(tmp_path / "t.csv", **(options | {"columns": ["x", "y", "u", "w"]}))
    (tmp_path / "t.csv").write_text("x,y,u,v\n1,2,3\n")
    with pytest.raises(pp.InvalidInput, match="line 2"):
        read_table(tmp_path / "t.csv", **options)


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("2 mm", "length", 2e-3),
        ("1.5e-1 µm", "length", 1.5e-7),
        ("200kPa", "pressure", 2e5),
        ("2 \N{MICRO SIGN}m", "length", 2e-6),
        ("2 \N{GREEK SMALL LETTER MU}m", "length", 2e-6),
        ("2\N{NO-BREAK SPACE}\N{GREEK SMALL LETTER MU}m", "length", 2e-6),
        ("2 \N{SQUARE MU M}", "length", 2e-6),
        ("3 \N{MICRO SIGN}strain", "strain", 3e-6),
        ("3 \N{GREEK SMALL LETTER MU}strain", "strain", 3e-6),
        ("7 \N{GREEK SMALL LETTER MU}s", "time", 7e-6),
        ("1 N/mm\N{SUPERSCRIPT TWO}", "pressure", 1e6),
        (".5 %", "strain", 0.005),
        ("3 1", "strain", 3.0),
    ],
)
def test_quantities(text: str, kind: str, value: float) -> None:
    assert parse_quantity(text, kind, "pitch") == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (2.0, "no unit"),
        ("2", "a number and a unit"),
        ("2 kPa", "accepted for a length"),
        ("mm", "number"),
        ("1e999 mm", "finite"),
        (None, "quantity"),
    ],
)
def test_bad_quantities(text: Any, word: str) -> None:
    with pytest.raises(pp.InvalidInput, match=word):
        parse_quantity(text, "length", "pitch")


META = {
    "trial": 3,
    "rate": 100.0,
    "glued": True,
    "who": None,
    "skin": "left finger, µ",
    "weights": [100, 200.5],
    "at": {"x": 1, "clean": False},
    "big": 2**70,
    "gap": float("nan"),
}


@pytest.mark.parametrize("suffix", [".nc", ".h5", ".npz", ".csv", ".zarr", ".mcap"])
def test_meta_keeps_its_types(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("zarr" if suffix == ".zarr" else "mcap" if suffix == ".mcap" else "h5py")
    numpy = {
        "trial": np.int64(3),
        "glued": np.bool_(True),
        "weights": (100, np.float64(200.5)),
        "rate": np.float32(100),
    }
    recording = Recording(readings=np.ones((2, 1, 2, 2)), channels=["stress_zz"], meta={**META, **numpy})
    assert repr(recording.meta) == repr(META)  # types and the NaN too
    write_recording(recording, tmp_path / f"r{suffix}")
    assert repr(read_recording(tmp_path / f"r{suffix}").meta) == repr(META)
    if suffix in (".nc", ".h5", ".zarr", ".mcap"):
        with recorder(tmp_path / f"s{suffix}", ["stress_zz"], meta={**META, **numpy}) as out:
            out.readings(0.0, np.ones((1, 2, 2)))
        assert repr(read_recording(tmp_path / f"s{suffix}").meta) == repr(META)


@pytest.mark.parametrize(
    ("meta", "words"),
    [
        ({3: "x"}, "names in meta must be text; got '3' (int)"),
        ({"at": {1: "x"}}, "names in meta must be text; got '1' (int)"),
        ({"who": b"me"}, "got \"b'me'\" (bytes)"),
        ({"when": np.datetime64("2026-01-01")}, "got '2026-01-01' (date)"),
        ({"z": 1j}, "got '1j' (complex)"),
        ({"n": 10**5000}, "meta cannot be written"),
        ("text", "must be a mapping"),
    ],
    ids=["number as name", "number as name within", "bytes", "date", "complex", "too long", "no mapping"],
)
def test_meta_of_other_kinds_is_refused_before_anything_is_written(tmp_path: Path, meta: Any, words: str) -> None:
    with pytest.raises(InvalidInput, match=re.escape(words)):
        Recording(readings=np.ones((2, 1, 2, 2)), channels=["stress_zz"], meta=meta)
    with pytest.raises(InvalidInput, match=re.escape(words)):
        recorder(tmp_path / "r.nc", ["stress_zz"], meta=meta)
    assert not list(tmp_path.iterdir())


def test_meta_that_holds_itself_is_refused() -> None:
    meta: dict[str, Any] = {}
    meta["again"] = meta
    with pytest.raises(InvalidInput, match="meta cannot be written"):
        Recording(readings=np.ones((2, 1, 2, 2)), channels=["stress_zz"], meta=meta)
