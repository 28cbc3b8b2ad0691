"""Correct a calibration for the run that the frames to come belong to, by a few of its presses."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from palpate._numbers import plain_number
from palpate.calibrate.calibration import FORCES, PLACES, SkinCalibration
from palpate.calibrate.elastic import run_gain
from palpate.calibrate.labels import Labelled
from palpate.calibrate.run import RunLabels
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["quantity", "run_calibration"]

#: First words of the sentence about this run.
ABOUT = "this run: "


def quantity(data: Labelled, name: str) -> Floats:
    """Return the labels of a map (label,): a force [N], or the moment of the normal force about a place [N m].

    Raises
    ------
    InvalidInput
        A place without the normal force.
    """
    value = data.known[name]
    if name not in PLACES:
        return value
    if "fz" not in data.known:
        raise InvalidInput("places are known but no normal force: the centre needs both. Give fz too.")
    return np.where(data.known["fz"] == 0.0, 0.0, value * data.known["fz"])


def run_calibration(
    skin: Any, before: SkinCalibration, data: Labelled, true: Labelled, said: list[str]
) -> SkinCalibration:
    """Return the calibration for frames of the run that was labelled.

    ``true`` are the labels for the elastic model: readings divided by their fitted gains, and ``skin`` has the fitted
    constants. The elastic model has a gain of its own: an error of the map at places that the calibration has not seen is not one
    of the elastic model.

    Raises
    ------
    InvalidInput
        Labels of other readings, or of no quantity that the calibration has.
    """
    before.check_readings(data.flat.shape[1])
    maps, words = dict(before.maps), []
    unit, unit_std = before.unit, before.unit_std
    for name, one in before.maps.items():
        value = quantity(data, name) if name in data.known else np.full(len(data.flat), math.nan)
        at = np.isfinite(value)
        if not at.any() or not np.abs(value[at]).max() > 0.0:
            if name in FORCES:
                words.append(f"{name} has no label in this run, so its calibration is unchanged")
            continue
        std = data.std[at] if name == "fz" else np.zeros(int(at.sum()))
        new = RunLabels(data.flat[at], value[at], std, data.press[at])
        maps[name] = replace(one, this_run=new)
        if name == "fz":
            gain, gain_std = new.gain(new.known(one.errors(new.readings)))
            if before.elastic:
                own = run_gain(skin, true, before.unit, before.elastic_error, one.run_share) or (gain, gain_std)
                unit, unit_std = unit * own[0], math.hypot(unit_std, own[1])
            words.insert(
                0,
                f"{ABOUT}forces are {plain_number(gain, 3)} +- {plain_number(gain_std, 2)} times those of the calibration, from {len(new.values)} labelled frames. This correction holds for this run only; for another run, start from the calibration without it",
            )
    if all(one.this_run is None or one is before.maps[n] for n, one in maps.items()):
        raise InvalidInput(
            f"the calibration has maps of {', '.join(before.maps)}, and the presses have labels of {', '.join(data.known)}: label one of the former."
        )
    kept = [s for s in before.said if not s.startswith(ABOUT)]
    return replace(before, maps=maps, unit=unit, unit_std=unit_std, said=(*words, *said, *kept))
