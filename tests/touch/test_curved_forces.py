"""Pressure on a curved surface has a sideways force, which is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import palpate as pp
from palpate.sensing import CurvedGrid, SphereChart
from palpate.touch import CalibratedForce


def test_sideways_force_of_pressure_on_a_sphere() -> None:
    chart = SphereChart(radius=10e-3, reach=np.pi / 2)
    grid = CurvedGrid(shape=(20, 20), spacing=2 * chart.outline[0][1] / 20, chart=chart)
    values = np.zeros((3, 20, 20))
    values[2, 9:11, 15:18] = 2e4
    touch = pp.Touch(values, grid, ("z",), "known")
    assert abs(touch.force[0]) > 0.1 * abs(touch.force[2])
    assert touch.table()["force_x (N)"].item() == touch.force[0]
    assert "not measured" not in touch.summary()
    known = CalibratedForce(np.array([0.0, 0.0, 2.5]), np.full(3, 0.1), np.array(10.0))
    figure = replace(touch, calibrated=known).plot(truth=values)
    size = float(np.linalg.norm(touch.force))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [t for t in titles if "net force" in t] == ["net force 2.5 N, in space", f"net force {size:.3g} N, in space"]
