"""Where the picture lies goes with a camera's result: into files, out of them, and into figures over the picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.camera import Lens, View, overlay
from palpate.recordings import read_recording, read_touch, recorder, write_touch
from palpate.recordings.labelled import touch_of, view_of
from palpate.touch import joined

for _name in ("cv2", "h5netcdf"):
    pytest.importorskip(_name)

GRID = pp.AreaGrid(shape=(6, 8), spacing=(1e-3, 1.5e-3), center=(1e-3, -2e-3))
LENS = Lens([[300.0, 0.0, 80.0], [0.0, 300.0, 60.0], [0.0, 0.0, 1.0]], [-0.2, 0.03, 0.0, 0.0], 0.2)
VIEWS = {
    "scaled": View.scaled((0.1e-3, 0.12e-3), size=(160, 120)),
    # a camera on its side, tilted, behind a lens
    "tilted": View.from_points(
        [[22, 20], [20, 101], [140, 104], [136, 20]],
        [[-6e-3, -4e-3], [6e-3, -4e-3], [6e-3, 4e-3], [-6e-3, 4e-3]],
        lens=LENS,
    ),
}
PLACES = np.array([[1e-3, 2e-3], [-5e-3, 3e-3], [0.0, 0.0]])


def touch(view: View | None, frames: int | None = None) -> pp.Touch:
    values = np.zeros((*(() if frames is None else (frames,)), 3, 6, 8))
    values[..., 3, 5] = [2e3, 1e3, 9e3]
    return pp.Touch(values, GRID, ("x", "y", "z"), "automatic", view=view)


@pytest.mark.parametrize("ending", [".nc", ".h5", ".zarr"])
@pytest.mark.parametrize("kind", sorted(VIEWS))
def test_a_result_of_a_camera_knows_where_its_picture_lies_after_it_was_in_a_file(
    tmp_path: Path, ending: str, kind: str
) -> None:
    if ending == ".zarr":
        pytest.importorskip("zarr")
    view = VIEWS[kind]
    write_touch(touch(view, 3), tmp_path / f"t{ending}")
    found = touch_of(read_touch(tmp_path / f"t{ending}"))[1]
    assert found.view is not None
    assert np.array_equal(found.view.pixels(PLACES), view.pixels(PLACES))
    assert np.array_equal(found.view.places([[3.0, 100.0]]), view.places([[3.0, 100.0]]))
    assert (found.view.lens is None) == (view.lens is None)


@pytest.mark.parametrize("ending", [".zarr", *long_runs(".nc")])
@pytest.mark.long
def test_a_stream_records_where_its_pictures_lie_and_a_frame_of_it_is_drawn_over_one(
    tmp_path: Path, ending: str
) -> None:
    if ending == ".zarr":
        pytest.importorskip("zarr")
    one = touch(VIEWS["scaled"])
    with recorder(tmp_path / f"t{ending}", ["displacement_x", "displacement_y"]) as out:
        for frame in range(3):
            out.readings(0.1 * frame, np.zeros((2, 4)))
            out.touch(one, 0.1 * frame)
    data = read_touch(tmp_path / f"t{ending}")
    picture = np.full((120, 160), 90, dtype=np.uint8)
    drawn, same = (drawn_cells(overlay(picture, t)) for t in (data.isel(time=1), one))
    assert np.allclose(drawn[0], same[0], atol=1e-3)
    assert np.allclose(drawn[1].filled(0.0), same[1].filled(0.0), rtol=1e-6)
    with pytest.raises(pp.InvalidInput, match=r"pick one of a file of touches.*'time': 3"):
        overlay(picture, data)


@pytest.mark.parametrize("kind", sorted(VIEWS))
def test_archives_of_numpy_and_robots_hold_where_the_picture_lies(tmp_path: Path, kind: str) -> None:
    """They are for other programs: the view is there as JSON, once."""
    view = VIEWS[kind]
    write_touch(touch(view, 3), tmp_path / "t.npz")
    write_touch(touch(None, 3), tmp_path / "none.npz")
    with np.load(tmp_path / "t.npz") as file:
        held = [str(file["view"])]
    with np.load(tmp_path / "none.npz") as file:
        assert "view" not in file.files
    reader = pytest.importorskip("mcap.reader")
    pytest.importorskip("foxglove")
    write_touch(touch(view, 3), tmp_path / "t.mcap")
    with (tmp_path / "t.mcap").open("rb") as file:
        records = {r.name: r.metadata for r in reader.make_reader(file).iter_metadata()}
    held.append(records["palpate.view"]["view"])
    for text in held:
        found = View.restored(json.loads(text))
        assert np.array_equal(found.pixels(PLACES), view.pixels(PLACES))


def test_a_stream_for_robots_says_a_view_once_and_again_where_the_camera_moved(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    pytest.importorskip("foxglove")
    with recorder(tmp_path / "t.mcap", ["displacement_x", "displacement_y"]) as out:
        for frame, kind in enumerate(("scaled", "scaled", "tilted", "tilted")):
            out.readings(0.1 * frame, np.zeros((2, 4)))
            out.touch(touch(VIEWS[kind]), 0.1 * frame)
    with (tmp_path / "t.mcap").open("rb") as file:
        names = [r.name for r in reader.make_reader(file, validate_crcs=True).iter_metadata()]
    assert [n for n in names if n != "palpate.shape"] == ["palpate", "palpate.view", "palpate.view"]
    assert read_recording(tmp_path / "t.mcap").readings.shape == (4, 2, 4)


def drawn_cells(figure: Any) -> tuple[Any, Any]:
    """Edges of the field [pixels] and its colours."""
    field = figure.axes[0].images[1]
    return np.array(field.get_extent()), np.ma.asarray(field.get_array())


def test_standard_deviations_of_a_recorded_frame_are_drawn(tmp_path: Path) -> None:
    import xarray

    one = touch(VIEWS["scaled"])
    data = xarray.Dataset({"traction": one.traction, "std": one.traction * 0.0 + 50.0})
    picture = np.full((120, 160), 90, dtype=np.uint8)
    figure = overlay(picture, data, show="std")
    inside = drawn_cells(figure)[1]
    inside = inside[inside[..., 3] > 0.0]
    assert np.allclose(inside, inside[0], atol=0.02)  # one standard deviation all over
    assert len(overlay(picture, data, show="all").axes) > len(overlay(picture, one, show="all").axes)


def test_a_figure_over_the_picture_needs_the_picture_alone() -> None:
    picture = np.full((120, 160), 90, dtype=np.uint8)
    one = touch(VIEWS["tilted"])
    given = drawn_cells(one.plot(picture=(picture, VIEWS["tilted"])))
    known = drawn_cells(one.plot(picture=picture))
    assert np.array_equal(given[0], known[0])
    with pytest.raises(pp.InvalidInput, match="nothing says where the picture lies"):
        overlay(picture, touch(None))
    with pytest.raises(pp.InvalidInput, match="the image alone where the touch knows its view"):
        touch(None).plot(picture=picture)


def test_frames_of_one_view_keep_it_when_they_are_joined_and_picked() -> None:
    view, again = VIEWS["scaled"], View.restored(json.loads(json.dumps(VIEWS["scaled"].described())))
    both = joined([touch(view), touch(again)])
    assert both.view is view
    assert both[1].view is view
    # a camera that was moved: none holds for all
    assert joined([touch(view), touch(VIEWS["tilted"])]).view is None
    assert joined([touch(None), touch(view)]).view is None


def test_a_view_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    data = touch(VIEWS["tilted"]).traction.to_dataset()
    for wrong in ("{", "[]", '{"homography": [[1, 2]], "lens": null}', '{"homography": 3}'):
        data["traction"].attrs["view"] = wrong
        with pytest.raises(pp.InvalidInput, match=r"t\.nc: where its picture lies cannot be read"):
            view_of(data, "t.nc")
    with pytest.raises(pp.InvalidInput, match="described by its homography"):
        View.restored({"lens": None})


@pytest.mark.long
def test_an_archive_of_numpy_holds_what_a_netcdf_file_holds(tmp_path: Path) -> None:
    """Intervals, standard deviations and what became of each frame too; nothing in it needs pickle."""
    array = pp.AreaArray(shape=(5, 5), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=100.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    press = skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.3), rng=np.random.default_rng(0))
    touch = skin.reconstruct(np.stack([press, 0.0 * press]))
    low, high = touch.interval(0.95, "force")
    for name in ("t.npz", "t.nc"):
        write_touch(touch, tmp_path / name, provenance={"command": "palpate"})
    with np.load(tmp_path / "t.npz", allow_pickle=False) as held:
        assert held["status_label"].tolist() == ["solved", "no contact"]
        np.testing.assert_array_equal(held["force_low"], low)
        np.testing.assert_array_equal(held["force_high"], high)
        assert '"command": "palpate"' in str(held["record"])
        data = read_touch(tmp_path / "t.nc")
        for name, variable in data.variables.items():
            np.testing.assert_array_equal(held[str(name)], variable.values)
