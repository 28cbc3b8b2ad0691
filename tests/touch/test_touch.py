from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate._batches import per_frame_fields
from palpate.inverse.estimate import Errors, Stated
from palpate.status import Status
from palpate.touch import joined
from palpate.touch.fields import CalibratedForce, ErrorParts
from palpate.touch.intervals import uncalibrated
from palpate.touch.outcome import Outcome
from palpate.touch.table import table_words
from palpate.uncertainty import Case, constants


def pressed(*, batch: int | None = None) -> pp.Touch:
    grid = pp.AreaGrid(shape=(41, 51), spacing=(0.1, 0.08), center=(0.4, -0.2))
    ball = solutions.hertz_point(contact_radius=1.0, force=2.0).shifted(0.5, -0.1).sliding(0.3, direction=np.pi / 3)
    values = ball.averages(grid.x, grid.y)
    if batch:
        values = np.stack([values * (i + 1) for i in range(batch)])
    return pp.Touch(values, grid, ("x", "y", "z"), "known", time=None if batch is None else np.arange(batch) * 0.1)


def test_numbers() -> None:
    touch = pressed()
    np.testing.assert_allclose(touch.force, [0.3, 0.3 * np.sqrt(3), 2.0], rtol=2e-3)
    np.testing.assert_allclose(touch.center_of_pressure, [0.5, -0.1], atol=2e-3)
    fx, fy, fz = touch.force
    np.testing.assert_allclose(touch.moment, [-0.1 * fz, -0.5 * fz, 0.5 * fy + 0.1 * fx], rtol=5e-3)
    assert touch.peak_pressure == pytest.approx(3 / np.pi, rel=5e-3)
    assert touch.contact_area(threshold=0.1) == pytest.approx(np.pi, rel=0.05)
    # sliding at 0.3: the margin at friction 0.5 is 0.2 p at the least loaded point of the contact
    smallest = touch.values[2][touch.contact()].min()
    assert touch.slip_margin(0.5) == pytest.approx(0.2 * smallest, rel=1e-9)
    assert touch.slip_margin(0.2) < 0


def test_orientation() -> None:
    """Push on the right: the right lights up. Push at the top: y is positive there."""
    grid = pp.AreaGrid(shape=(10, 12), spacing=0.5)
    p = np.zeros((3, 10, 12))
    p[2, 8, 1] = 1.0
    touch = pp.Touch(p, grid, ("x", "y", "z"), "known")
    x, y = touch.center_of_pressure
    assert x < 0 < y
    assert float(touch.pressure.sel(x=x, y=y, method="nearest")) == 1.0
    figure = touch.plot()
    image = figure.axes[0].images[0]
    assert image.origin == "lower"


def test_labels() -> None:
    touch = pressed(batch=3)
    assert touch.traction.dims == ("time", "component", "y", "x")
    assert touch.traction.attrs["units"] == "Pa"
    assert touch.traction["x"].attrs["units"] == "m"
    np.testing.assert_allclose(touch.traction["time"], [0, 0.1, 0.2])
    assert touch.pressure.dims == ("time", "y", "x")
    assert list(touch.shear["component"].values) == ["x", "y"]
    assert touch.force.shape == (3, 3)
    np.testing.assert_allclose(touch.frame(1).force, touch.force[1])
    with pytest.raises(pp.InvalidInput, match="frame"):
        touch.frame(3)


def test_line() -> None:
    grid = pp.LineGrid(count=201, spacing=0.05, center=1.0)
    contact = solutions.hertz_line(half_width=2.0, force=3.0).shifted(1.5).sliding(-0.2)
    touch = pp.Touch(contact.averages(grid.edges), grid, ("x", "z"), "known")
    np.testing.assert_allclose(touch.force, [-0.6, 3.0], rtol=1e-9)
    np.testing.assert_allclose(touch.moment, [-4.5], rtol=1e-4)
    np.testing.assert_allclose(touch.center_of_pressure, [1.5], atol=1e-4)
    assert "slip margin" in touch.summary(friction=0.5)
    touch.plot(truth=touch.values)


def test_nothing_touches() -> None:
    grid = pp.AreaGrid(shape=(5, 5), spacing=1.0)
    touch = pp.Touch(np.zeros((3, 5, 5)), grid, ("x", "y", "z"), "known")
    assert not touch.contact().any()
    assert np.isnan(touch.slip_margin(0.5))
    assert np.isnan(touch.center_of_pressure).all()
    assert touch.contact_area() == 0
    touch.plot()


def test_a_contact_that_pulls_has_the_centre_of_one_that_pushes() -> None:
    """It was NaN, in the result and in its table."""
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.49)
    skin = pp.Skin(pad, pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=20.0))
    ball = pp.solutions.hertz_point(contact_radius=3e-3, force=0.5).shifted(2e-3, -1e-3)
    touch = skin.reconstruct(-np.asarray(skin.sense(ball, rng=np.random.default_rng(0))))
    assert float(touch.force[2]) < 0.0
    np.testing.assert_allclose(touch.center_of_pressure, [2e-3, -1e-3], atol=5e-5)
    low, high = touch.interval(0.95, "center_of_pressure")
    assert (low < [2e-3, -1e-3]).all()
    assert (high > [2e-3, -1e-3]).all()


def test_what_was_not_sought_is_not_reported() -> None:
    grid = pp.LineGrid(count=5, spacing=1.0)
    touch = pp.Touch(np.ones((2, 5)), grid, ("z",), "known", unobservable_force=("z",))
    with pytest.raises(pp.NotObservable, match="x"):
        _ = touch.shear
    assert np.isnan(touch.force[1])
    with pytest.raises(pp.InvalidInput, match="threshold"):
        touch.contact(threshold=2.0)
    with pytest.raises(pp.InvalidInput, match="truth"):
        touch.plot(truth=np.zeros((2, 4)))


# -- no field is lost ------------------------------------------------------------------------------------------------------


def full(frames: int = 4) -> pp.Touch:
    """A batch with every field, each frame's numbers its own."""
    grid = pp.AreaGrid(shape=(3, 4), spacing=1e-3)
    rng = np.random.default_rng(0)

    def some(*shape: int) -> np.ndarray:
        return rng.random((frames, *shape))

    maps = {n: some(3, 3, 4) for n in ("traction", "variance_reduction", "outside_traction")}
    errors = Errors(
        **maps,
        force=some(3),
        moment=some(3),
        center=some(2),
        peak=some(),
        outside_force=some(3),
        beyond_force=some(3),
        outside_moment=some(3),
        outside_center=some(2),
        outside_peak=some(),
    )
    return pp.Touch(
        some(3, 3, 4),
        grid,
        ("x", "y", "z"),
        "adaptive",
        ("a note",),
        parameter=some(),
        noise_std=some(3),
        residual=some(),
        time=np.arange(frames) * 0.5,
        meta={"skin": "mine"},
        converged=np.arange(frames) % 2 == 0,
        touching=np.arange(frames) % 3 > 0,
        outliers=some(36) > 0.5,
        draws=some(5, 3, 3, 4),
        resolution=some(),
        sliding=some(),
        found_by=np.array(["adaptive", "constrained"] * (frames // 2)),
        status=np.arange(frames, dtype=np.int8) % 2,
        pushing=np.arange(frames) != 1,
        fit=some(),
        nuisance=some(2) - 0.5,
        nuisance_std=some(2),
        discrepancy=0.1 * some(),
        strain=0.1 * some(),
        calibrated=CalibratedForce(some(3), 0.1 * some(3), 5.0 + some(), some(2), 0.1 * some(2)),
        force_bounds=np.where(some(3, 2) > 0.5, np.nan, some(3, 2)),
        nuisance_names=(("offset of stress_zz", "Pa"), ("rotation about z", "rad")),
        at_limit=some(36) > 0.9,
        drag=some(2),
        drag_std=some(),
        sticking=some(4),
        _errors=ErrorParts(
            errors, Stated(traction=some(3, 3, 4), force=some(3), moment=some(3), center=some(2), peak=some()), 0.1
        ),
        reading_names={i: f"stress_zz at taxel ({i},)" for i in range(36)},
    )


def arrays(touch: pp.Touch) -> dict[str, np.ndarray]:
    return {name: np.asarray(value) for name, value in per_frame_fields(touch)}


def test_the_test_touch_has_every_field() -> None:
    declared = {f.name for f in fields(pp.Touch) if f.metadata.get("per_frame")}
    assert declared == {name.split(".")[0] for name in arrays(full())}


def test_a_frame_keeps_every_field() -> None:
    touch = full()
    one = touch.frame(2)
    for name, value in arrays(touch).items():
        np.testing.assert_array_equal(arrays(one)[name], value[2], err_msg=name)
    assert (one.assumptions, one.meta, one.method) == (touch.assumptions, touch.meta, touch.method)
    assert one.time == 1.0


def test_notes_are_those_of_the_frames() -> None:
    touch = full()
    notes = "\n".join(touch.notes)
    # noise explains one of the two frames without contact, and the other ill
    assert "no contact in 1 of 4 frames: noise alone explains the readings" in notes
    assert "no contact found in 1 of 4 frames, but noise rarely gives such readings" in notes
    assert "only pushes does not explain the readings in 1 of 4 frames" in notes
    assert not any("no contact" in n for n in touch.frame(0).notes)
    assert any(n.startswith("no contact: ") for n in touch.frame(1).notes)
    assert "a note" in touch.frame(0).notes


def test_frames_joined_again_are_the_batch() -> None:
    touch = full()
    for parts in ([touch.frame(i) for i in range(4)], [touch[:1], touch[1:]], list(touch)):
        whole = joined(parts)
        for name, value in arrays(touch).items():
            np.testing.assert_array_equal(arrays(whole)[name], value, err_msg=name)
        assert whole.meta == touch.meta


def test_what_only_some_frames_have_is_missing_in_the_rest() -> None:
    touch = full()
    bare = pp.Touch(touch.values[0], touch.surface, touch.components, "tikhonov")
    whole = joined([touch.frame(0), bare])
    assert list(whole.methods) == ["adaptive", "tikhonov"]
    assert np.isnan(whole.time[1])  # type: ignore[index]
    assert np.isnan(whole._errors.posterior.force[1]).all()  # type: ignore[union-attr]
    low, high = whole.interval(0.95, "force")
    assert np.isfinite(low[0]).all()
    assert np.isnan(low[1]).all()
    assert np.isnan(high[1]).all()
    np.testing.assert_array_equal(low[0], touch.frame(0).interval(0.95, "force")[0])


def test_each_frame_uses_the_error_bars_of_the_method_that_found_it() -> None:
    touch = full()
    low, high = touch.interval(0.9, "peak_pressure")
    for i, method in enumerate(touch.methods):
        alone = replace(touch.frame(i), method=str(method), found_by=None)
        np.testing.assert_array_equal([low[i], high[i]], alone.interval(0.9, "peak_pressure"))


def test_indices_pick_frames_as_numpy_does() -> None:
    touch = full()
    np.testing.assert_array_equal(touch[-1].values, touch.values[3])
    np.testing.assert_array_equal(touch[[2, 0]].time, [1.0, 0.0])
    np.testing.assert_array_equal(touch[touch.touching].sliding, touch.sliding[touch.touching])  # type: ignore[index]
    assert len(touch[1:3]) == 2
    with pytest.raises(pp.InvalidInput, match="no frames 7"):
        touch[7]
    with pytest.raises(TypeError, match="one frame"):
        len(touch[0])


def test_a_touch_does_not_change() -> None:
    values = np.ones((3, 5, 5))
    touch = pp.Touch(values, pp.AreaGrid(shape=(5, 5), spacing=1.0), ("x", "y", "z"), "known")
    with pytest.raises(ValueError, match="read-only"):
        touch.values[0, 0, 0] = 2.0
    values[0, 0, 0] = 2.0  # the caller's own array stays as it is
    with pytest.raises(ValueError, match="read-only"):
        full()._errors.posterior.force[0] = 0.0  # type: ignore[union-attr]


def test_fields_must_have_the_batch_axes() -> None:
    grid = pp.LineGrid(count=5, spacing=1.0)
    with pytest.raises(pp.InvalidInput, match=r"time must have the batch axes \(3,\)"):
        pp.Touch(np.ones((3, 2, 5)), grid, ("x", "z"), "known", time=np.zeros(2))
    with pytest.raises(pp.InvalidInput, match="values must have shape"):
        pp.Touch(np.ones((5, 2)), grid, ("x", "z"), "known")


def test_results_of_different_skins_are_not_joined() -> None:
    one = pp.Touch(np.ones((2, 5)), pp.LineGrid(count=5, spacing=1.0), ("x", "z"), "known")
    other = replace(one, surface=pp.LineGrid(count=5, spacing=2.0))
    with pytest.raises(pp.InvalidInput, match="different surfaces"):
        joined([one, other])
    with pytest.raises(pp.InvalidInput, match="nothing to join"):
        joined([])


def test_a_case_without_constants_of_its_own_says_so() -> None:
    touch = full()
    assert touch.calibration_note == ""
    other = replace(touch, case=Case("area with shear", "mixed", "layers"))
    assert "not calibrated for this case" in other.calibration_note
    assert "not calibrated" in other.summary()
    for case in (Case("line"), Case("area"), Case("area with shear")):
        assert constants("adaptive", case).case == case
        assert constants("adaptive", case).population["frames"] > 100


def test_a_frame_without_error_bars_says_so_in_words() -> None:
    """A frame whose method has none beside one that has: no "nan to nan" beside its force."""
    touch = full()
    bare = pp.Touch(touch.values[0], touch.surface, touch.components, "nnls")
    whole = joined([touch.frame(0), bare])
    assert " to " in whole.summary(frame=0)
    words = whole.summary(frame=1)
    assert "nan" not in words.split("centre")[0]
    assert "not known for this frame (method nnls)" in words


def test_numbers_of_a_frame_that_is_not_explained_are_not_told() -> None:
    """A tracker goes on through such frames with 162 N where a frame by itself has no number: neither the summary nor the table prints one."""
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
        pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=10.0),
    )
    touch = skin.reconstruct(skin.sense(pp.solutions.hertz_line(half_width=2e-3, force=10.0)), method="tikhonov")
    assert "net force z" in touch.summary()
    found = replace(touch, status=np.array(int(Status.UNEXPLAINED)))
    first = found.summary().splitlines()[0]
    assert first.startswith("net force       not known (at most 1")
    assert first.endswith(" N/m)")
    row = table_words(found.table()).splitlines()[1]
    assert row.split()[1:3] == ["-", "-"]
    assert row.endswith("unexplained")


@pytest.mark.long
def test_a_standard_deviation_is_half_the_interval_that_no_floor_cuts() -> None:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        pp.AreaArray(
            shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=20.0
        ),
    )
    readings = skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0), rng=np.random.default_rng(0))
    touch = skin.reconstruct(np.stack([readings, readings]), friction=0.5)
    for of in ("traction", "force", "moment", "center_of_pressure", "peak_pressure", "slip_margin"):
        given = {"friction": 0.5} if of == "slip_margin" else {}
        low, high = touch.interval(0.6826894921, of, **given)
        std = touch.std(of, **given)
        assert type(std) is type(low) is np.ndarray
        assert std.shape == low.shape == high.shape
        uncut = low > 0 if of in ("traction", "force", "peak_pressure") else np.full(low.shape, True)
        assert uncut.any()
        np.testing.assert_allclose(std[uncut], 0.5 * (high - low)[uncut], rtol=1e-6)
        assert (std >= 0.5 * (high - low) * (1 - 1e-9)).all()
    assert touch.std().shape == touch.values.shape
    assert touch.has_intervals
    assert not skin.reconstruct(readings, method="dft").has_intervals


def test_the_error_of_a_slip_margin_is_that_of_the_cell_nearest_to_slip() -> None:
    """var(mu p - |q|) = mu^2 var(p) + (qx^2 var(qx) + qy^2 var(qy)) / |q|^2, in the cell of the smallest margin."""
    touch, mu = full(), 0.5
    value, deviation, *_ = uncalibrated(touch, constants("adaptive", touch.calibration_case), "slip_margin", mu)
    for i, (qx, qy, p) in enumerate(np.asarray(touch.values)):
        q = np.hypot(qx, qy)
        margin = np.where(p > 0.1 * p.max(), mu * p - q, np.inf)
        at = np.unravel_index(np.argmin(margin), margin.shape)
        sx, sy, sp = (std[at] for std in touch._errors.posterior.traction[i])
        assert value[i] == pytest.approx(margin[at])
        assert deviation[i] == pytest.approx(
            np.sqrt((mu * sp) ** 2 + ((qx * sx) ** 2 + (qy * sy) ** 2)[at] / q[at] ** 2)
        )


def test_a_load_without_an_upper_end_has_an_infinite_deviation() -> None:
    touch = full()[0]
    bounds = np.array([[np.nan, np.nan], [np.nan, np.nan], [0.0, np.inf]])
    assert replace(touch, force_bounds=bounds, calibrated=None).std("force")[2] == np.inf


def test_joined_frames_keep_what_is_common_to_all() -> None:
    """Frames without a case, a friction or names of nuisances (missing ones, those of a linear method) take none from the others."""
    whole = replace(full(), case=Case("area with shear"), friction=0.3)
    bare = replace(whole, case=None, friction=None, nuisance=None, nuisance_std=None, nuisance_names=())
    for parts in ([whole, bare], [bare, whole]):
        both = joined(parts)
        assert (both.case, both.friction, both.nuisance_names) == (whole.case, 0.3, whole.nuisance_names)
        assert any(n.startswith("offset of stress_zz in 4 of 8 frames") for n in both.notes)
    assert joined([whole, replace(whole, friction=0.9)]).friction is None
    errors = whole._errors
    assert errors is not None
    for other in (
        replace(whole, case=Case("area")),
        replace(whole, _errors=replace(errors, scale=0.2)),
        replace(whole, nuisance_names=tuple(reversed(whole.nuisance_names))),
    ):
        with pytest.raises(pp.InvalidInput, match="join those of one skin"):
            joined([whole, other])


def test_nuisances_add_up_by_name() -> None:
    whole = full()
    turned = replace(whole, nuisance=whole.nuisance[:, ::-1], nuisance_std=whole.nuisance_std[:, ::-1])  # type: ignore[index]
    turned = replace(turned, nuisance_names=whole.nuisance_names[::-1])
    assert (Outcome.of(whole) + Outcome.of(turned)).nuisances == (Outcome.of(whole) + Outcome.of(whole)).nuisances
