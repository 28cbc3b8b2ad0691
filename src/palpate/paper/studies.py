"""Ours: what the paper's errors are made of, which readings of its text give them, and the studies that it only mentions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse import (
    ConstantFrictionEstimator,
    DifferencePrior,
    DivisionEstimator,
    LinearSystemEstimator,
    Regularised,
    decompose,
    hilgers_prior,
)
from palpate.inverse.linear.parameter import tikhonov
from palpate.paper.algorithm import (
    constant_shear,
    divide,
    divide_slowly,
    net_pressure,
    sliding,
    solve_linear,
    without_shear,
)
from palpate.paper.cases import (
    DEPTH,
    FRICTION,
    HALF_WIDTH,
    PAD,
    PAPER_ERRORS,
    PITCH,
    SENSORS,
    array,
    cylinder,
    data,
    mean_error,
    punch,
    sense,
)
from palpate.sensing.grids import LineGrid
from palpate.sensing.operator import sampled_kernel
from palpate.skin import Skin

__all__ = [
    "FRICTIONLESS",
    "error_table",
    "friction_readings",
    "friction_table",
    "noise_study",
    "profile_readings",
    "speed_study",
    "truncation_study",
]

CHANNELS = ("stress_zz", "strain_zz")
#: Cases and channels without friction.
FRICTIONLESS = tuple((case, channel) for case in ("cylinder", "punch") for channel in CHANNELS)
#: Samples between the middle and the edge of the designed contact.
TRUE_M = round(HALF_WIDTH / PITCH)

Row = dict[str, Any]


# -- the printed errors ------------------------------------------------------------------------------------------------


def error_table() -> list[Row]:
    """Mean absolute errors without friction: printed, by division in four arithmetics, and by the linear system."""
    rows = []
    for case, channel in FRICTIONLESS:
        true, readings = data(case, channel)
        single = DivisionEstimator(PAD, [array([channel])], [1]).solve([readings.astype(np.float32)]).traction[1]
        found: dict[str, Floats] = {
            "division": divide(readings[0], channel),
            "single precision": single,
            "slow transform, single": divide_slowly(readings[0], channel),
            "7 decimals": divide(np.round(readings[0], 7), channel),
            "linear system": solve_linear(readings[0], channel),
        }
        row: Row = {"case": case, "channel": channel, "printed": PAPER_ERRORS[case, "vertical", channel]}
        rows.append(row | {name: mean_error(values, true[1]) for name, values in found.items()})
    return rows


def friction_table() -> list[Row]:
    """Mean absolute errors with friction: printed, by readings of the paper's algorithm, and ours.

    The paper's algorithm with M as the even part gives it; with M one sample too wide; with M as found and the readings kept to
    seven decimals; ours: the same algorithm on the linear system, and method="constant_friction", whose half-width is continuous
    and whose middle is not given.
    """
    found: dict[str, dict[str, Floats]] = {}
    for channel in CHANNELS:
        true, readings = data("punch with friction", channel)
        own = ConstantFrictionEstimator(
            PAD, [array([channel])], LinearSystemEstimator(PAD, [array([channel])], [1]), FRICTION
        )
        tractions: dict[str, Floats] = {
            "M found": sliding(readings[0], channel, FRICTION).traction,
            "M one too wide": sliding(readings[0], channel, FRICTION, half_samples=TRUE_M + 1).traction,
            "M found, 7 decimals": sliding(np.round(readings[0], 7), channel, FRICTION).traction,
            "linear system": sliding(readings[0], channel, FRICTION, solve=solve_linear).traction,
            "constant_friction": np.asarray(own.solve([readings]).traction),
        }
        found[channel] = {name: np.abs(t - true).mean(axis=1) for name, t in tractions.items()}
    rows = []
    for channel in CHANNELS:
        for index, component in ((1, "vertical"), (0, "tangential")):
            row: Row = {"component": component, "channel": channel}
            row["printed"] = PAPER_ERRORS["punch with friction", component, channel]
            rows.append(row | {name: float(errors[index]) for name, errors in found[channel].items()})
    return rows


def friction_readings() -> list[Row]:
    """Compare each interpretation of the friction algorithm with the printed strain errors, 1.15e-3 and 1.45e-3.

    An interpretation states by how many samples M is wrong in the strain case, and whether the contact counts as 2M
    periods (as in equation 22) or as its 2M + 1 samples. The friction coefficient is the one that gives the printed
    tangential error.
    """
    target = float(PAPER_ERRORS["punch with friction", "tangential", "strain_zz"])
    pressure = punch(array(["strain_zz"]).grid.x)
    rows = []
    for label, extra in (("2M", 0.0), ("2M + 1", 0.5)):
        for wrong in (-2, -1, 0, 1, 2):

            def errors(friction: float, channel: str, m: int, extra: float = extra) -> tuple[float, float]:
                true = pressure.copy()
                loaded = np.abs(np.arange(SENSORS) - SENSORS // 2) <= TRUE_M
                true[0, loaded] = constant_shear(float(true[1].sum()), friction, TRUE_M + extra)
                readings = sense(true, channel)[0]
                shear = constant_shear(net_pressure(readings, channel), friction, m + extra)
                found = divide(without_shear(readings, channel, shear, m), channel)
                loaded_too = np.abs(np.arange(SENSORS) - SENSORS // 2) <= m
                return mean_error(found, true[1]), mean_error(np.where(loaded_too, shear, 0.0), true[0])

            friction = target / errors(1.0, "strain_zz", TRUE_M + wrong)[1]
            vertical, tangential = errors(friction, "strain_zz", TRUE_M + wrong)
            stress = errors(friction, "stress_zz", TRUE_M)
            rows.append(
                {
                    "contact counted as": label,
                    "M too wide by": wrong,
                    "friction": friction,
                    "strain, vertical": vertical,
                    "strain, tangential": tangential,
                    "stress with M right, vertical": stress[0],
                    "stress with M right, tangential": stress[1],
                }
            )
    return rows


def profile_readings() -> list[Row]:
    """P and eps that give both printed strain errors without friction, for each half-width and each reading of eps.

    The paper says that a becomes a + eps; both profiles may be meant, or only the rectangle's, which needs it. The axes of its
    figures leave the cylinder's peak between 0.10 (or the step would be 0.02) and 0.13 (figure 11), and the rectangle's between
    0.3 and 0.4.
    """
    from scipy.optimize import brentq

    channel = "strain_zz"
    x = array([channel]).grid.x
    targets = [float(PAPER_ERRORS[case, "vertical", channel]) for case in ("cylinder", "punch")]

    def error(traction: Floats) -> float:
        return mean_error(divide(sense(traction, channel)[0], channel), traction[1])

    rows = []
    for half_width in (3.0, 3.5, 4.0):
        for both in (True, False):

            def load(eps: float, both: bool = both, half_width: float = half_width) -> float:
                return targets[0] / error(cylinder(x, half_width=half_width, load=1.0, eps=eps if both else 0.0))

            def excess(eps: float, half_width: float = half_width, load: Callable[[float], float] = load) -> float:
                return error(punch(x, half_width=half_width, load=load(eps), eps=eps)) - targets[1]

            # the error falls with eps for a sharp edge
            eps = float(brentq(excess, 0.02, 0.4, xtol=1e-6))
            found = load(eps)
            peak = cylinder(x, half_width=half_width, load=found, eps=eps if both else 0.0)[1].max()
            edge = punch(x, half_width=half_width, load=found, eps=eps)[1].max()
            rows.append(
                {
                    "half-width": half_width,
                    "eps in": "both profiles" if both else "the rectangle",
                    "eps": eps,
                    "load": found,
                    "cylinder's peak": float(peak),
                    "rectangle's edge": float(edge),
                    "keeps to the axes": "yes" if 0.10 < peak <= 0.13 and 0.3 < edge <= 0.4 else "no",
                }
            )
    return rows


# -- cases that the paper mentions -------------------------------------------------------------------------------------


def noise_study(
    levels: Sequence[float] = (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1), draws: int = 20, seed: int = 0
) -> list[Row]:
    """Relative error of the pressure (L2, median of ``draws``) against noise (standard deviation over peak reading).

    All three methods invert the very model that made the data (concentrated loads on the sensors' grid), so that they differ
    in nothing but regularisation; the regularised ones choose their parameter by evidence, the noise level unknown.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for case, channel in FRICTIONLESS:
        true, readings = data(case, channel)
        plane = array([channel])
        model = sampled_kernel(PAD, plane)
        solvers: dict[str, Any] = {
            "division": DivisionEstimator(PAD, [plane], [1]),
            "Hilgers": Regularised(decompose(model, [hilgers_prior(plane.grid, DEPTH)], [1]), tikhonov, "evidence"),
            "Tikhonov": Regularised(decompose(model, [DifferencePrior(plane.grid, 1)], [1]), tikhonov, "evidence"),
        }
        for level in levels:
            count = draws if level else 1
            noise = level * np.abs(readings).max() * rng.standard_normal((count, *readings.shape))
            row: Row = {"case": case, "channel": channel, "noise": level}
            for name, solver in solvers.items():
                found = np.asarray(solver.solve([readings + noise]).traction)[:, 1]
                row[name] = float(np.median(np.linalg.norm(found - true[1], axis=1) / np.linalg.norm(true[1])))
            rows.append(row)
    return rows


def truncation_study(counts: Sequence[int] = (121, 81, 41, 21)) -> list[Row]:
    """Mean absolute error against the number of sensors; the data of the whole contact, without noise."""
    rows = []
    for case, channel in FRICTIONLESS:
        for count in counts:
            true, readings = data(case, channel, count)
            row: Row = {"case": case, "channel": channel, "sensors": count}
            row["division"] = mean_error(divide(readings[0], channel), true[1])
            row["linear system"] = mean_error(solve_linear(readings[0], channel), true[1])
            rows.append(row)
    return rows


def speed_study(counts: Sequence[int] = (121, 241, 481), repeats: int = 15) -> list[Row]:
    """Time per frame [s] (best of ``repeats``) by division and by Hilgers' method, its parameter chosen on every frame."""
    rows = []
    for count in counts:
        _, readings = data("cylinder", "stress_zz", count)
        row: Row = {"sensors": count}
        skin = Skin(PAD, array(["stress_zz"], count), surface=LineGrid(count=count, spacing=PITCH))
        ways: dict[str, Callable[[], object]] = {
            "division": lambda s=skin, r=readings: s.reconstruct(r, method="dft", components=["z"]),  # type: ignore[misc]
            "Hilgers": lambda s=skin, r=readings: s.reconstruct(r, method="hilgers", components=["z"]),  # type: ignore[misc]
        }
        for name, once in ways.items():
            start = time.perf_counter()
            once()
            row[f"{name}, first frame"] = time.perf_counter() - start
            best = math.inf
            for _ in range(repeats):
                start = time.perf_counter()
                once()
                best = min(best, time.perf_counter() - start)
            row[f"{name}, each"] = best
        row["Hilgers over division"] = row["Hilgers, each"] / row["division, each"]
        rows.append(row)
    return rows
