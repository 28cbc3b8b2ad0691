"""Recordings and touches as labelled arrays, as NetCDF and as Zarr: they come back equal."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from palpate import solutions
from palpate.inverse.estimate import Errors, Stated
from palpate.recordings.labelled import recording_dataset, recording_of, touch_dataset, touch_of
from palpate.sensing.grids import AreaGrid, LineGrid
from palpate.touch.fields import CalibratedForce, ErrorParts

#: Of every plane and length in UTF-8, with what JSON, TOML and HDF5 might trip over. All of Unicode takes seconds to list.
LETTERS = "aZ0 _-/\\\"'{}[],:=#%&<>;\t\x01\x7f\xa0\xad\xb5\xdf\xe9\u0301\u03c3\u05d0\u0628\u200d\u202e\u2212\u4e2d\ue000\ufeff\ufffd\U00010348\U0001f600\U000e0001\U0010ffff"  # fmt: skip
WORDS = st.text(st.sampled_from(LETTERS), max_size=8)
CHANNELS = st.sampled_from(("stress_xz", "stress_zz", "displacement_x", "strain_xz"))


@st.composite
def recordings(draw: Any) -> pp.Recording:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    frames, channels = draw(st.integers(1, 4)), draw(st.lists(CHANNELS, min_size=1, max_size=3))
    shape = draw(st.sampled_from(((1,), (4,), (2, 3), (1, 2))))
    readings = rng.standard_normal((frames, len(channels), *shape)).astype(draw(st.sampled_from(("f4", "f8"))))
    if draw(st.booleans()):
        readings.flat[0] = np.nan
    positions = draw(st.sampled_from((None, (), (2,)))) if len(shape) == 1 else None
    return pp.Recording(
        readings=readings,
        channels=tuple(channels),
        time=np.cumsum(rng.uniform(1e-3, 1.0, frames)) - draw(st.sampled_from((0.0, 5.0))),
        positions=None if positions is None else rng.standard_normal((*shape, *positions)),
        meta=draw(st.dictionaries(WORDS, WORDS, max_size=3)),
    )


@st.composite
def touches(draw: Any) -> pp.Touch:
    """Any touch that the type allows, most of which no method would find."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spacing = draw(st.sampled_from((1e-3, 1 / 3)))
    grid: Any = draw(
        st.sampled_from(
            (
                LineGrid(count=5, spacing=spacing, center=0.1),
                AreaGrid(shape=(2, 3), spacing=spacing, center=(0.1, -0.2)),
                AreaGrid(shape=(3, 2), spacing=(spacing, 2 * spacing)),
            )
        )
    )
    batch = draw(st.sampled_from(((), (1,), (3,), (2, 2))))
    n = len(grid.components)

    def some(*tail: int) -> Any:
        return rng.standard_normal((*batch, *tail))

    def maybe(value: Any) -> Any:
        return value if draw(st.booleans()) else None

    full = (n, *grid.shape)
    about = 1 if grid.dimensions == 1 else 3
    errors = Errors(
        **{
            f.name: np.abs(some(*{"traction": full, "variance_reduction": full, "force": (n,), "moment": (about,), "center": (grid.dimensions,), "peak": ()}[f.name.removeprefix("outside_").removeprefix("beyond_")]))
            for f in fields(Errors)
        }
    )  # fmt: skip
    stated = Stated(**{f.name: getattr(errors, f.name) for f in fields(Stated)})
    return pp.Touch(
        values=some(*full).astype(draw(st.sampled_from(("f4", "f8")))),
        surface=grid,
        components=draw(st.sampled_from((grid.components, ("z",)))),
        method="adaptive",
        assumptions=tuple(draw(st.lists(WORDS.filter(bool), max_size=2))),
        parameter=maybe(some()),
        noise_std=maybe(some(3)),
        residual=maybe(some()),
        unobservable_force=draw(st.sampled_from(((), ("x",)))),
        time=maybe(some()),
        meta=draw(st.dictionaries(WORDS, WORDS, max_size=2)),
        _errors=maybe(ErrorParts(errors, maybe(stated), 0.1)),
        converged=maybe(some() > 0),
        touching=maybe(some() > 0),
        outliers=maybe(some(6) > 0),
        draws=maybe(some(2, *full)),
        resolution=maybe(some()),
        sliding=maybe(some()),
        found_by=maybe(np.full(batch, "tikhonov")),
        status=maybe(np.full(batch, 3, dtype=np.int8)),
        pushing=maybe(some() > 0),
        reading_names=draw(st.dictionaries(st.integers(0, 5), WORDS, max_size=2)),
    )


def same_recording(a: pp.Recording, b: pp.Recording) -> None:
    assert a.readings.dtype == b.readings.dtype
    np.testing.assert_array_equal(a.readings, b.readings)
    np.testing.assert_array_equal(a.time, b.time)
    assert (a.channels, a.units, a.meta) == (b.channels, b.units, b.meta)
    assert (a.positions is None) == (b.positions is None)
    if a.positions is not None:
        np.testing.assert_array_equal(a.positions, b.positions)


def same_touch(a: pp.Touch, b: pp.Touch) -> None:
    same_fields(a, b)


def same_fields(a: Any, b: Any) -> None:
    for field in fields(a):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(one, ErrorParts | Errors | Stated):
            same_fields(one, other)
        elif isinstance(one, np.ndarray | np.generic):
            assert np.asarray(one).dtype == np.asarray(other).dtype, field.name
            np.testing.assert_array_equal(one, other, err_msg=field.name)
        else:
            assert one == other, field.name


@settings(max_examples=10, deadline=None)
@given(recordings())
@pytest.mark.long
def test_recordings_come_back_equal(recording: pp.Recording) -> None:
    same_recording(recording_of(recording_dataset(recording)), recording)


@settings(max_examples=10, deadline=None)
@given(touches())
def test_touches_come_back_equal(touch: pp.Touch) -> None:
    same_touch(touch_of(touch_dataset(touch)), touch)


def test_dimensions_in_another_order() -> None:
    """Labels are honoured: a data set that somebody transposed is the same recording and the same touch."""
    rng = np.random.default_rng(0)
    recording = pp.Recording(readings=rng.standard_normal((3, 2, 4, 4)), channels=("stress_xz", "stress_zz"))
    same_recording(recording_of(recording_dataset(recording).transpose("x", "channel", "y", "time")), recording)
    scattered = pp.Recording(
        readings=rng.standard_normal((3, 1, 2)), channels=("stress_zz",), positions=rng.standard_normal((2, 2))
    )
    same_recording(recording_of(recording_dataset(scattered).transpose("axis", "taxel", "channel", "time")), scattered)


@pytest.mark.long
def test_what_was_found_comes_back() -> None:
    """A real result, every field, line and area, one frame and many."""
    area = pp.Skin(
        pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
        pp.AreaArray(shape=(6, 7), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"]),
    )
    readings = np.asarray(area.sense(area.sample(solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.3))))
    for given_readings in (readings, np.stack([readings, 0 * readings, 2 * readings])):
        same_touch(touch_of(touch_dataset(found := area.reconstruct(given_readings, friction=0.6))), found)
        assert found._errors is not None


def test_what_is_no_recording_and_no_touch() -> None:
    recording = pp.Recording(readings=np.zeros((2, 1, 3)), channels=("stress_zz",))
    good = recording_dataset(recording)
    for bad, words in (
        (good.drop_vars("time"), "lacks time"),
        (xarray.Dataset(), "lacks readings, channel, time"),
        (good.rename(taxel="marker"), "must have the dimensions"),
        (good.assign_attrs(meta="{"), "meta cannot be read"),
        (good.assign_attrs(meta="[" * 100_000), "meta cannot be read"),
        (good.assign_attrs(meta="3"), "must be a JSON object"),
    ):
        with pytest.raises(pp.InvalidInput, match=words):
            recording_of(bad)
    touch = pp.Touch(np.zeros((2, 4)), LineGrid(count=4, spacing=1.0), ("x", "z"), "linear")
    whole = touch_dataset(touch)
    for bad, words in (
        (whole.drop_vars("traction"), "lacks traction"),
        (whole.assign_attrs(surface="{}"), "surface cannot be read"),
        (whole.assign_attrs(surface='{"count": 5, "spacing": 1.0}'), "does not lie on a surface"),
    ):
        with pytest.raises(pp.InvalidInput, match=words):
            touch_of(bad)


def test_files_before_calibrated_force_are_read() -> None:
    """They called its force ``calibrated``, and its other parts as now."""
    grid = AreaGrid(shape=(3, 4), spacing=1e-3)
    known = CalibratedForce(
        np.full((2, 3), 1.5), np.full((2, 3), 0.2), np.full(2, 7.0), np.zeros((2, 2)), np.ones((2, 2))
    )
    touch = pp.Touch(np.ones((2, 3, 3, 4)), grid, ("x", "y", "z"), "tikhonov", calibrated=known)
    held = touch_dataset(touch)
    for dataset in (held, held.rename({"calibrated_force": "calibrated"})):
        back = touch_of(dataset).calibrated
        assert back is not None
        for f in fields(CalibratedForce):
            np.testing.assert_array_equal(getattr(back, f.name), getattr(known, f.name))
        np.testing.assert_array_equal(touch_of(dataset).force, touch.force)
    assert touch_of(touch_dataset(pp.Touch(np.ones((3, 3, 4)), grid, ("z",), "tikhonov"))).calibrated is None


def test_files_keep_the_parts_of_the_errors_under_the_names_they_had() -> None:
    """`errors_*`, `stated_*` and `common_std` are what files before `palpate.touch.fields.ErrorParts` hold."""
    grid = LineGrid(count=4, spacing=1e-3)
    sizes = {"traction": (2, 4), "force": (2,), "moment": (1,), "center": (1,), "peak": ()}
    parts = {name: np.full(size, 0.1) for name, size in sizes.items()}
    posterior = Errors(**parts, variance_reduction=parts["traction"], **{f"outside_{n}": v for n, v in parts.items()}, beyond_force=parts["force"])  # fmt: skip
    touch = pp.Touch(np.ones((2, 4)), grid, ("x", "z"), "tikhonov", _errors=ErrorParts(posterior, Stated(**parts), 0.2))
    held = touch_dataset(touch)
    assert {f"errors_{f.name}" for f in fields(Errors)} | {f"stated_{f.name}" for f in fields(Stated)} <= set(held)
    assert held.attrs["common_std"] == 0.2
    back = touch_of(held)
    np.testing.assert_array_equal(back.interval(0.95, "force"), touch.interval(0.95, "force"))
