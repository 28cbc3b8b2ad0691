"""The figures that are ours: errors on a logarithmic scale, noise, truncation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats
from palpate.paper.algorithm import divide, solve_linear
from palpate.paper.cases import SENSORS, array, data
from palpate.paper.pictures import Panel, PaperFigure
from palpate.paper.studies import CHANNELS, FRICTIONLESS, Row

__all__ = ["our_figures"]

_NAMES = {"cylinder": "cylinder", "punch": "rectangle"}


def our_figures(noise: Sequence[Row], truncation: Sequence[Row]) -> list[PaperFigure]:
    """Figures A to C, from the tables of `studies.noise_study` and `studies.truncation_study`."""
    return [
        PaperFigure(
            "A",
            "Error of the reconstructed pressure, sample by sample. Division wraps around: the readings are a linear convolution, the "
            "division undoes a circular one. The linear system that made the readings leaves only rounding",
            tuple(_errors(case) for case in _NAMES),
        ),
        PaperFigure(
            "B",
            "Noise: relative error (L2, median of 20 draws) against noise over peak reading. Division, Hilgers' method and Tikhonov's, "
            "both with the parameter chosen by evidence from the readings alone",
            tuple(_study(noise, case, channel, "noise") for case, channel in FRICTIONLESS),
        ),
        PaperFigure(
            "C",
            "Truncation: mean absolute error with 21, 41, 81 and 121 sensors. The contact lies inside all of them, so the linear system "
            "stays exact",
            tuple(_study(truncation, case, channel, "sensors") for case, channel in FRICTIONLESS),
        ),
    ]


def _errors(case: str) -> Panel:
    curves: dict[str, Floats] = {}
    for name, solve in (("division", divide), ("linear system", solve_linear)):
        for channel in CHANNELS:
            true, readings = data(case, channel)
            # errors of exactly zero lie below the axis
            curves[f"{name}, {channel.split('_')[0]}"] = np.maximum(
                np.abs(solve(readings[0], channel) - true[1]), 1e-20
            )
    x = array(["stress_zz"]).grid.x
    end = float(x[SENSORS - 1])
    return Panel(x, curves, "y", (-end, end), (1e-18, 1.0), title=_NAMES[case], log=True, x_step=30.0)


def _study(rows: Sequence[Row], case: str, channel: str, key: str) -> Panel:
    part = [r for r in rows if r["case"] == case and r["channel"] == channel and r[key] > 0]
    x: Floats = np.array([float(r[key]) for r in part])
    names = [n for n in part[0] if n not in ("case", "channel", key)]
    curves = {n: np.array([float(r[n]) for r in part]) for n in names}
    title = f"{_NAMES[case]}, {channel.split('_')[0]}"
    if key == "noise":
        return Panel(x, curves, "noise / peak reading", (5e-6, 0.2), (1e-3, 1e3), title=title, log=True, log_x=True)
    return Panel(x, curves, "sensors", (1.0, 141.0), (1e-17, 100.0), title=title, log=True, x_step=40.0)
