from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate import solutions


def pressed(*, batch: int | None = None) -> pp.Touch:
    grid = pp.AreaGrid(shape=(41, 51), spacing=(0.1, 0.08), center=(0.4, -0.2))
    ball = solutions.hertz_point(radius=1.0, force=2.0).shifted(0.5, -0.1).sliding(0.3, direction=np.pi / 3)
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


def test_what_was_not_sought_is_not_reported() -> None:
    grid = pp.LineGrid(count=5, spacing=1.0)
    touch = pp.Touch(np.ones((2, 5)), grid, ("z",), "known", unseen_force=("z",))
    with pytest.raises(pp.NotObservable, match="x"):
        _ = touch.shear
    assert np.isnan(touch.force[1])
    with pytest.raises(pp.InvalidInput, match="threshold"):
        touch.contact(threshold=2.0)
    with pytest.raises(pp.InvalidInput, match="truth"):
        touch.plot(truth=np.zeros((2, 4)))
