"""Labels, masks, units and number formats of readings: honoured or refused, never scrambled.

Every case is the same physics: a ball of 1 N pressed beside the centre reads 1 N at its place, or there is an error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray

import palpate as pp
from palpate import solutions

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
#: The ball is at the origin, beside the middle of the array.
PLACE, MIDDLE = (0.0, 0.0), (-1.5e-3, 1e-3)
CHANNELS = ("stress_xz", "stress_yz", "stress_zz")
ARRAY = pp.AreaArray(shape=(8, 10), pitch=1e-3, depth=1.5e-3, channels=CHANNELS, center=MIDDLE)
BALL = solutions.hertz_point(contact_radius=2.5e-3, force=1.0)


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, ARRAY)


@pytest.fixture(scope="module")
def plain(skin: pp.Skin) -> Any:
    # traction that is even in cells: nothing but labels may be at fault
    return np.asarray(skin.sense(skin.sample(BALL)))


@pytest.fixture(scope="module")
def labelled(plain: Any) -> xarray.DataArray:
    y, x = ARRAY.grid.axes
    return xarray.DataArray(
        plain[None],
        dims=("time", "channel", "y", "x"),
        coords={"time": [2.0], "channel": list(CHANNELS), "y": y, "x": x},
    )


def judge(skin: pp.Skin, readings: Any) -> None:
    """1 N at the ball's place, by `reconstruct` and by the tracker."""
    touch = skin.reconstruct(readings, method="tikhonov", parameter=1e-9)
    force, place = np.atleast_2d(touch.force)[0], np.atleast_2d(touch.center_of_pressure)[0]
    np.testing.assert_allclose(force, [0.0, 0.0, 1.0], atol=0.05)
    np.testing.assert_allclose(place, PLACE, atol=1e-4)


def in_millimetres(a: xarray.DataArray) -> xarray.DataArray:
    out = a.assign_coords(x=a.x * 1e3, y=a.y * 1e3)
    for name in "xy":
        out[name].attrs["units"] = "mm"
    return out


def in_kilopascals(a: xarray.DataArray) -> xarray.DataArray:
    return (a / 1e3).assign_attrs(units="kPa")


HONOURED: dict[str, Callable[[xarray.DataArray], xarray.DataArray]] = {
    "as it is": lambda a: a,
    "transposed": lambda a: a.transpose("x", "channel", "y", "time"),
    "y descends": lambda a: a.isel(y=slice(None, None, -1)),
    "x descends": lambda a: a.isel(x=slice(None, None, -1)),
    "columns shuffled": lambda a: a.isel(x=[3, 0, 9, 1, 2, 8, 7, 4, 6, 5]),
    "channels reordered": lambda a: a.isel(channel=[2, 0, 1]),
    "all at once": lambda a: a.isel(channel=[1, 2, 0], y=slice(None, None, -1)).transpose("y", "x", "time", "channel"),
    "coordinates in mm": in_millimetres,
    "readings in kPa": in_kilopascals,
    "no coordinates": lambda a: a.drop_vars(["x", "y", "channel", "time"]),
    "no batch": lambda a: a.isel(time=0),
    "single precision": lambda a: a.astype(np.float32),
    "big-endian": lambda a: a.astype(">f8"),
}


@pytest.mark.parametrize("how", HONOURED)
def test_labels_are_honoured(skin: pp.Skin, labelled: xarray.DataArray, how: str) -> None:
    judge(skin, HONOURED[how](labelled))


@pytest.fixture(scope="module")
def same(skin: pp.Skin, plain: Any) -> pp.Touch:
    """The touch of a tracker that is given numbers without labels."""
    return skin.track().step(plain)


@pytest.mark.parametrize("how", ["transposed", "y descends", "channels reordered", "readings in kPa", "as it is"])
@pytest.mark.long
def test_the_tracker_honours_the_same_labels(
    skin: pp.Skin, same: pp.Touch, labelled: xarray.DataArray, how: str
) -> None:
    touch = skin.track().step(HONOURED[how](labelled).isel(time=0))
    np.testing.assert_allclose(touch.values, same.values, atol=1e-5 * float(same.values.max()))


def test_time_labels_reach_the_result(skin: pp.Skin, labelled: xarray.DataArray) -> None:
    touch = skin.reconstruct(labelled, method="tikhonov", parameter=1e-9)
    np.testing.assert_array_equal(touch.time, [2.0])
    milli = labelled.assign_coords(time=[2000.0])
    milli.time.attrs["units"] = "ms"
    np.testing.assert_allclose(skin.reconstruct(milli, method="tikhonov", parameter=1e-9).time, [2.0])


REFUSED: dict[str, tuple[Callable[[xarray.DataArray], Any], str]] = {
    "other names": (lambda a: a.rename(y="row", x="col"), "rename"),
    "no channel axis": (lambda a: a.isel(channel=2), "expand_dims"),
    "a channel too many": (
        lambda a: xarray.concat([a, a.isel(channel=[0]).assign_coords(channel=["strain_zz"])], "channel"),
        "sel",
    ),
    "unknown channels": (lambda a: a.assign_coords(channel=["a", "b", "c"]), "stress_xz"),
    "numbered channels": (lambda a: a.assign_coords(channel=[2, 1, 0]), "drop_vars"),
    "shifted by half a millimetre": (lambda a: a.assign_coords(x=a.x + 5e-4), "center"),
    "another pitch": (lambda a: a.assign_coords(x=a.x * 1.1), "pitch"),
    "millimetres without a unit": (lambda a: a.assign_coords(x=a.x * 1e3), "units"),
    "an unknown unit": (lambda a: a.assign_attrs(units="bar"), "bar"),
    "a unit of another kind": (lambda a: a.assign_attrs(units="mm"), "mm"),
    "NaN among coordinates": (lambda a: a.assign_coords(x=np.where(np.arange(10) == 3, np.nan, a.x)), "agree"),
    "a dataset": (lambda a: a.to_dataset(name="s"), "Dataset"),
    "text for coordinates": (lambda a: a.assign_coords(x=list("abcdefghij")), "position"),
    "axes exchanged by name": (lambda a: a.rename(y="x", x="y").drop_vars(["x", "y"]), "shape"),
    "a list of them": (lambda a: [a, a], "concat"),
    "times that go back": (lambda a: xarray.concat([a, a.assign_coords(time=[1.0])], "time"), "increase"),
}


@pytest.mark.parametrize("how", REFUSED)
def test_labels_that_cannot_be_honoured_are_refused(skin: pp.Skin, labelled: xarray.DataArray, how: str) -> None:
    change, word = REFUSED[how]
    with pytest.raises(pp.InvalidInput, match=word):
        skin.reconstruct(change(labelled), method="tikhonov")


def test_markers_are_matched_by_their_positions() -> None:
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(np.arange(9), np.arange(9)), -1).reshape(-1, 2) * 1e-3 - 4e-3
    places = places + MIDDLE + 1e-4 * rng.standard_normal(places.shape)
    skin = pp.Skin(PAD, pp.ScatteredArray(positions=places, depth=1.5e-3, channels=CHANNELS))
    data = xarray.DataArray(
        np.asarray(skin.sense(skin.sample(BALL))),
        dims=("channel", "taxel"),
        coords={"channel": list(CHANNELS), "x": ("taxel", places[:, 0]), "y": ("taxel", places[:, 1])},
    )
    expected = skin.reconstruct(data.values, method="tikhonov", parameter=1e-9)
    order = rng.permutation(len(places))
    for mixed in (
        data.isel(taxel=order),
        data.drop_vars(["x", "y"]).assign_coords(taxel=np.arange(81)).isel(taxel=order),
    ):
        np.testing.assert_array_equal(
            skin.reconstruct(mixed, method="tikhonov", parameter=1e-9).values, expected.values
        )
    assert expected.force[2] == pytest.approx(1.0, abs=0.06)
    with pytest.raises(pp.InvalidInput, match="agree"):
        skin.reconstruct(data.assign_coords(x=data.x + 1e-4), method="tikhonov")
    with pytest.raises(pp.InvalidInput, match="drop_vars"):
        skin.reconstruct(data.drop_vars(["x", "y"]).assign_coords(taxel=np.arange(81) + 7), method="tikhonov")


def test_planes_with_the_same_channel_need_the_order_of_the_planes() -> None:
    planes = [
        pp.AreaArray(shape=(8, 10), pitch=1e-3, depth=d, channels=["stress_zz"], center=MIDDLE) for d in (1e-3, 2e-3)
    ]
    skin = pp.Skin(PAD, planes)
    y, x = planes[0].grid.axes
    both = xarray.DataArray(
        np.asarray(skin.sense(skin.sample(BALL))),
        dims=("channel", "y", "x"),
        coords={"channel": ["stress_zz"] * 2, "y": y, "x": x},
    )
    one = [both.isel(channel=[i]) for i in range(2)]
    for readings in (both, both.isel(x=slice(None, None, -1)), one, [one[0].transpose("x", "y", "channel"), one[1]]):
        touch = skin.reconstruct(readings, method="tikhonov", components=["z"], parameter=1e-9)
        assert touch.force[2] == pytest.approx(1.0, abs=0.03)
        np.testing.assert_allclose(touch.center_of_pressure, PLACE, atol=1e-4)


def test_traction_is_put_right_by_its_labels(skin: pp.Skin, plain: Any) -> None:
    touch = skin.reconstruct(plain, method="tikhonov", parameter=1e-9)
    traction = touch.traction
    expected = np.asarray(skin.sense(touch.values))
    close = {"rtol": 1e-9, "atol": 1e-9 * float(np.abs(expected).max())}
    for change in (
        lambda t: t,
        lambda t: t.transpose("x", "y", "component"),
        lambda t: t.isel(y=slice(None, None, -1), component=[2, 1, 0]),
        lambda t: (t / 1e3).assign_attrs(units="kPa"),
    ):
        np.testing.assert_allclose(skin.sense(change(traction)), expected, **close)
    with pytest.raises(pp.InvalidInput, match="cells"):
        skin.sense(traction.assign_coords(x=traction.x + 1e-3))
    with pytest.raises(pp.InvalidInput, match="component"):
        skin.sense(traction.sel(component=["z"]))


NUMBERS: dict[str, Callable[[Any], Any]] = {
    "big-endian": lambda r: r.astype(">f8"),
    "big-endian single": lambda r: r.astype(">f4"),
    "integers": lambda r: np.round(r).astype(np.int32),
    "big-endian integers": lambda r: np.round(r).astype(">i4"),
    "half precision": lambda r: r.astype(np.float16),
    "extended precision": lambda r: r.astype(np.longdouble),
    "read-only": lambda r: _read_only(r),
    "not contiguous": lambda r: np.repeat(r, 2, axis=-1)[..., ::2],
    "column by column": np.asfortranarray,
    "turned views": lambda r: r[:, ::-1, ::-1].copy()[:, ::-1, ::-1],
    "mask without entries": lambda r: np.ma.masked_array(r, mask=False),
    "a nested list": lambda r: r.tolist(),
}


def _read_only(r: Any) -> Any:
    out = r.copy()
    out.setflags(write=False)
    return out


@pytest.mark.parametrize("how", NUMBERS)
def test_numbers_of_every_format_mean_the_same(skin: pp.Skin, plain: Any, how: str) -> None:
    judge(skin, NUMBERS[how](plain))


def _structured(r: Any) -> Any:
    out = np.zeros(r.shape, dtype=[("value", "f8"), ("age", "i4")])
    out["value"] = r
    return out


class _Quantity(np.ndarray):
    """Like an array of astropy: numbers with a unit of their own."""

    unit = "kPa"

    def to_value(self, _: str) -> Any:
        return np.asarray(self) * 1e3


class _Pint:
    magnitude, units, ndim = np.zeros(3), "kPa", 3


class _Lazy:
    dask, ndim = {}, 3  # type: ignore[var-annotated]


class _Table:
    iloc, ndim = None, 2


NOT_NUMBERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "bool": (lambda r: r > 0, "bool"),
    "object": (lambda r: r.astype(object), "astype"),
    "complex": (lambda r: r + 0j, "real"),
    "text": (lambda r: r.astype(str), "astype"),
    "structured": (_structured, "field"),
    "dates": (lambda r: np.zeros(r.shape, dtype="M8[s]"), "real numbers"),
    "no axes": (lambda r: np.asarray(1.0), "shape"),
    "a number": (lambda r: 1.0, "shape"),
    "nothing": (lambda r: None, "array"),
    "masked where nothing is left out": (lambda r: np.ma.masked_greater(r, 0.5 * r.max()), "missing"),
    "a list of masked frames": (lambda r: [np.ma.masked_greater(r, 0.5 * r.max())], "missing"),
    "axes exchanged": (lambda r: np.swapaxes(r, 1, 2), "shape"),
    "a frame of another shape and size alike": (lambda r: r.reshape(3, 10, 8), "shape"),
    "flattened": (lambda r: r.reshape(3, -1), "shape"),
    "an astropy quantity": (lambda r: r.view(_Quantity), "to_value"),
    "a pint quantity": (lambda r: _Pint(), "magnitude"),
    "a dask array": (lambda r: _Lazy(), "compute"),
    "a table": (lambda r: _Table(), "to_numpy"),
}


@pytest.mark.parametrize("how", NOT_NUMBERS)
def test_what_is_no_number_is_refused(skin: pp.Skin, plain: Any, how: str) -> None:
    change, word = NOT_NUMBERS[how]
    with pytest.raises(pp.InvalidInput, match=word):
        skin.reconstruct(change(plain), method="tikhonov")
    if how not in ("masked where nothing is left out", "a list of masked frames"):
        with pytest.raises(pp.InvalidInput, match=word):
            skin.track().step(change(plain))


def test_masked_entries_are_missing_taxels(skin: pp.Skin, plain: Any) -> None:
    """Where the skin leaves the same taxels out they change nothing, whatever stands under the mask."""
    working = np.ones(ARRAY.shape, dtype=bool)
    working[2, 3] = False
    fewer = skin.masked(working)
    filled = plain.copy()
    filled[:, 2, 3] = 999999.0
    judge(fewer, np.ma.masked_array(filled, mask=filled == 999999.0))
    touch = skin.track().step(np.ma.masked_array(filled, mask=filled == 999999.0))
    assert touch.force[2] == pytest.approx(1.0, abs=0.05)


def test_a_recording_keeps_no_labels_and_no_fill_values(plain: Any, labelled: xarray.DataArray) -> None:
    with pytest.raises(pp.InvalidInput, match="transpose"):
        pp.Recording(readings=labelled, channels=CHANNELS)
    hidden = np.ma.masked_array(plain[None].astype(">f8"), mask=np.zeros((1, *plain.shape), dtype=bool))
    hidden[0, 1, 2, 3] = np.ma.masked
    kept = pp.Recording(readings=hidden, channels=CHANNELS)
    assert np.isnan(kept.readings[0, 1, 2, 3])
    assert kept.readings.dtype.isnative
    assert kept.missing.sum() == 1
