"""Compute a calibration from labelled presses."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate.calibrate.applied import reading_gains, with_constants
from palpate.calibrate.calibration import FORCES, PLACES, SkinCalibration
from palpate.calibrate.constants import labelled_constants
from palpate.calibrate.elastic import elastic_check, small_unit
from palpate.calibrate.findings import (
    ageing,
    best_press,
    hysteresis,
    silent_readings,
    table_of,
)
from palpate.calibrate.forcemap import MAX_LABELS, RUN, ForceMap, usual_scale
from palpate.calibrate.labels import (
    BALL,
    SCALE_STD,
    Labelled,
    Weight,
    find_delay,
    plateaus,
    press_numbers,
    spread_over,
    stuck_labels,
    weights_of,
)
from palpate.calibrate.prior import SHEAR_SHARE, likely_maps
from palpate.calibrate.process import Process
from palpate.calibrate.thisrun import quantity, run_calibration
from palpate.calibrate.wiring import wrong_wiring
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings import Recording
from palpate.sensing.readings import checked_planes
from palpate.sensing.times import as_seconds, interpolated
from palpate.sensing.zero import FRAMES_FOR_NOISE, moved

__all__ = ["calibrate", "flat_readings", "unflat"]

#: Fraction of the time of a weight that is dropped at each end, while the weight is put down and taken off.
ENDS = 0.15
#: Fraction of the frames before the first weight, at their end, in which a hand may put it down.
BEFORE = 0.3
#: Frames with less than this fraction of the largest force are at rest.
REST_FRACTION = 0.005
#: Frames below this force are at rest if there are at least FEWEST_AT_REST of them and their readings scatter by less than
#: ALIKE_AT_REST times the root mean square of all readings.
FEWEST_AT_REST, ALIKE_AT_REST = 3, 0.1
#: Default number of labels in a calibration: more take longer and add little (docs/_generated/calibrate.md).
USUAL_LABELS = 300
SEED = 41
#: Note if all labels come from one recording.
ONE_RECORDING_NOTE = f"all labels are of one recording: that its gains differ from the next one's by {100 * RUN:.0f} % is assumed. Calibrate with a second recording, made on another day, to learn it, or label one press on each day (--this-run)"
#: Sentences of a calibration without a frame at rest.
NO_REST = "no frame is labelled as at rest: the readings are assumed to be zero without contact. If they are not, give baseline=, or a frame with the force 0"
STORED_ZERO = "no frame is labelled as at rest: the zero of the calibration is used. Give baseline=, or a frame with the force 0, if the zero has drifted"
#: Squares of numbers above this, and inverses of numbers below its inverse, would leave double precision (at 1e154).
LARGEST = 1e100
#: Largest number of rest frames that are stored, and the noise that is assumed without rest frames, as a fraction of
#: the root mean square of the readings (a convention).
REST_KEPT, ASSUMED_NOISE = 20, 0.01


@dataclass(frozen=True, eq=False)
class Run:
    """One recording: readings (frame, channel, *array), the same flat (frame, reading), time (frame,) [s] or None, and
    frames at rest that are not labels.
    """

    readings: Floats
    flat: Floats
    time: Floats | None
    rest: Floats | None = None


def flat_readings(planes: Sequence[Any], readings: Any) -> Floats:
    """Return readings (*batch, reading) in the order of the operator's rows; missing ones are NaN."""
    parts = [np.asarray(to_numpy(p), dtype=np.float64) for p in checked_planes(readings, planes)]
    lead = parts[0].ndim - 1 - len(planes[0].shape)
    rows = [part[..., plane.valid].reshape(*part.shape[:lead], -1) for part, plane in zip(parts, planes)]
    return np.concatenate(rows, axis=-1)


def calibrate(
    skin: Any,
    presses: Any,
    *,
    reference: Any = None,
    reference_time: Any = None,
    weights: Sequence[Weight | str] = (),
    time: Any = None,
    baseline: int | None = None,
    labels: int = USUAL_LABELS,
    before: SkinCalibration | None = None,
    this_run: bool = False,
    constants: Sequence[str] = (),
    pad_models: Sequence[str] | None = None,
) -> SkinCalibration:
    """Calibrate a skin by labelled presses; `Skin.calibrate` does the same and returns the skin.

    Parameters
    ----------
    skin : Skin
        With pad and array, which may be guesses: they only give the prior of the maps.
    presses : Recording, array (frame, channel, *array), or a list of them
        Readings in the sensor's own unit, of which each recording is a run.
    reference : array (frame,) or (frame, 3), or mapping of str to array
        Normal force Fz, or Fx, Fy, Fz [N]; or some of "fx", "fy", "fz" [N], "x", "y" [m] for the place of the press, and "ball_radius" [m] for a
        ball. NaN if unknown. For a list of presses, give a list. If it has a different clock, give ``reference_time`` too.
    reference_time : array (sample,), optional
        Times of the reference [s]; the delay between the clocks is found (`find_delay`).
    weights : sequence of str or Weight
        Weights on the pad with their times, such as "200 g, 12 s to 20 s"; "0 g, ..." for rest.
    time : array (frame,), optional
        Times of an array of presses [s]; without them each frame is a separate press. For a list of presses, give a list, with None for a Recording.
    baseline : int, optional
        Frames at the start of each run without contact, whose mean is the zero. Default: the frames with zero force, if there are any.
    labels : int
        Largest number of frames to use.
    before : SkinCalibration, optional
        An earlier calibration of the same skin to start from: its labels are kept, and a note says whether the sensor
        has aged.
    this_run : bool
        The frames to come are of the same run as these presses. The calibration ``before`` stays as it is, and the
        presses determine how this run differs from it (`palpate.calibrate.run`): one press determines most of the
        gain. For another run, start again from ``before``.
    constants : sequence of str
        Constants of the pad to find from balls pressed straight into it, some of "youngs_modulus", "thickness", "depth", "gain", "pixel_scale", "unit"; see `PadConstants`.
    pad_models : sequence of str, optional
        Pad models to compare: any of "half-space", "bonded", "stack", "soft base". Default: the model of the skin.

    Raises
    ------
    InvalidInput
        No labelled frame, labels whose number differs from that of the frames, clocks that do not match, or labels
        without any force; ``this_run`` without a calibration.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.calibrate import calibrate
    >>> pad = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    >>> skin = pp.Skin(pad, pp.AreaArray(shape=(2, 2), pitch=12e-3, depth="base", channels=["stress_zz"]))
    >>> balls = [pp.solutions.hertz_point(contact_radius=3e-3, force=f) for f in (1.0, 2.0, 4.0)]
    >>> counts = np.stack([np.asarray(skin.sense(ball)) for ball in balls]) / 37.0  # the unit is not known
    >>> found = calibrate(skin, counts, reference=[1.0, 2.0, 4.0])
    >>> force, std = found.force(2.5 / 4.0 * counts[2].reshape(1, -1))
    >>> round(float(force[0, 2]), 1)
    2.5
    """
    if this_run and (before is None or constants or pad_models is not None or isinstance(presses, list | tuple)):
        raise InvalidInput(
            "this_run=True (--this-run) corrects a calibration by one recording of today, and fits no constants of the pad. Give a calibrated skin and one recording, or leave it out."
        )
    given = list(presses) if isinstance(presses, list | tuple) else [presses]
    runs = [_run(one, skin, seconds) for one, seconds in zip(given, _times_of(time, len(given)))]
    if not isinstance(labels, int) or isinstance(labels, bool) or not 1 <= labels <= MAX_LABELS:
        raise InvalidInput(f"labels must be a whole number from 1 to {MAX_LABELS}; got {labels!r}.")
    references = list(reference) if len(runs) > 1 and isinstance(reference, list | tuple) else [reference]
    if len(references) != len(runs) and reference is not None:
        raise InvalidInput(
            f"reference must be a list with one entry for each of {len(runs)} runs; got {len(references)}."
        )
    said: list[str] = []
    known = []
    whole = list(runs)  # baseline counts frames, and a run with weights keeps one for each weight
    for number, run in enumerate(runs):
        own = None if reference is None else references[number]
        if weights and number == 0:
            runs[number], one = _weighed(skin.planes, run, own, weights_of(weights), baseline)
        else:
            one = _labels(run, own, reference_time, said)
        known.append(one)
        _check_size("known forces", np.concatenate([one[f] for f in FORCES if f in one]))
    zeros = [
        _zero(run, one, said) if baseline is None else _mean_of_first(every, baseline)
        for run, every, one in zip(runs, whole, known)
    ]
    measured = [zero for zero in zeros if zero is not None]
    stored = None
    if before is not None and baseline is None and before.readings == runs[0].flat.shape[1]:
        stored = before.zero if len(measured) < len(runs) else None
    if stored is not None:
        zeros = [flat_readings(skin.planes, stored) if zero is None else zero for zero in zeros]
        said[:] = [s for s in said if s != NO_REST] + [STORED_ZERO]
    flats = [run.flat - (0.0 if zero is None else zero) for run, zero in zip(runs, zeros)]
    runs = [r if z is None else replace(r, readings=r.readings - unflat(skin.planes, z)) for r, z in zip(runs, zeros)]
    data = _join_runs(runs, flats, known, labels, baseline or 0)
    drifts = [zero_drift(r.flat, k) for r, k in zip(runs, known)]
    if stored is not None and before is not None and not measured:
        zero, zero_std = before.zero, before.zero_std
    else:
        zero, zero_std = _kept_zero(skin.planes, measured, data.rest, drifts)
    if this_run and before is not None:
        true = data if before.gains is None else data.over(unflat(skin.planes, before.gains))
        found = run_calibration(with_constants(skin, before.constants), before, data, true, said)
        return found if stored is not None else replace(found, rest=data.rest, zero=zero, zero_std=zero_std)
    told = labelled_constants(skin, data, constants, pad_models, None if before is None else before.constants)
    skin, gains = with_constants(skin, told), reading_gains(skin, told)
    if before is not None:
        said += ageing(before, data)
    maps = _maps(skin, data, before, zero_known=len(measured) == len(runs))
    found = SkinCalibration(maps, runs[0].flat.shape[1])
    main = maps.get("fz") or next(iter(maps.values()))
    table = table_of(main)
    true = data if gains is None else data.over(unflat(skin.planes, gains))
    checked = elastic_check(skin, true, main)
    said += checked.said
    said += silent_readings(skin, data) + wrong_wiring(skin, data)
    said += hysteresis(main)
    if len(runs) == 1 and before is None:
        said.append(ONE_RECORDING_NOTE)
    said += best_press(skin, main)
    return replace(
        found,
        constants=told,
        gains=gains,
        rest=data.rest,
        zero=zero,
        zero_std=zero_std,
        scale=small_unit(skin, data),
        unit=checked.unit,
        unit_std=checked.unit_std,
        elastic_error=checked.error,
        elastic_weight=checked.weight,
        elastic_inflation=checked.inflation,
        said=tuple(said),
        table=table,
    )


def _times_of(time: Any, count: int) -> list[Any]:
    """Return the times of each of ``count`` runs; None for a run without times."""
    if time is None:
        return [None] * count
    listed = isinstance(time, list | tuple)
    if count == 1:
        return [time[0] if listed and len(time) == 1 and np.ndim(time[0]) == 1 else time]
    if not listed or len(time) != count or any(one is not None and np.ndim(one) != 1 for one in time):
        raise InvalidInput(
            f"time must be a list with the times of each of {count} runs, such as time=[first, second], None for a Recording; got {type(time).__name__}."
        )
    return list(time)


def _run(one: Any, skin: Any, time: Any) -> Run:
    seconds: Floats | None
    if isinstance(one, Recording):
        values, seconds = one.readings, np.asarray(one.time, dtype=np.float64)
    else:
        values = np.asarray(to_numpy(one), dtype=np.float64)
        seconds = None if time is None else np.asarray(as_seconds(time), dtype=np.float64)
    if len({p.shape for p in skin.planes}) != 1:
        raise InvalidInput(
            f"calibrate takes skins whose planes have one shape; got {', '.join(str(p.shape) for p in skin.planes)}. Calibrate a skin of one plane with the readings of that plane."
        )
    if values.ndim != 2 + len(skin.planes[0].shape):
        raise InvalidInput(
            f"presses must have the axes (frame, channel, *array), {2 + len(skin.planes[0].shape)} of them; got shape {values.shape}."
        )
    flat = flat_readings(skin.planes, values)
    _check_size("readings", flat)
    if seconds is not None and seconds.shape != (len(flat),):
        raise InvalidInput(f"time must hold one second for each of {len(flat)} frames; got shape {seconds.shape}.")
    return Run(np.asarray(values, dtype=np.float64), flat, seconds)


def _check_size(name: str, values: Floats) -> None:
    """Raise an error for numbers whose squares overflow."""
    largest = float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
    if largest and not 1.0 / LARGEST <= largest <= LARGEST:
        raise InvalidInput(
            f"the largest of the {name} is {largest:g}; accepted: {1.0 / LARGEST:g} to {LARGEST:g}. Check their units."
        )


def _columns(reference: Any) -> dict[str, Floats]:
    """Return the labelled quantities by name."""
    if isinstance(reference, Mapping):
        out: dict[str, Floats] = {str(k).lower(): np.asarray(v, dtype=np.float64) for k, v in reference.items()}
        unknown = set(out) - {*FORCES, *PLACES, BALL}
        if unknown or not out:
            raise InvalidInput(
                f"reference names {', '.join(sorted(unknown)) or 'nothing'}; accepted: {', '.join((*FORCES, *PLACES, BALL))}."
            )
        if any(v.ndim != 1 for v in out.values()) or len({len(v) for v in out.values()}) != 1:
            shapes = ", ".join(f"{k} {v.shape}" for k, v in out.items())
            raise InvalidInput(f"each entry of reference must have shape (frame,), all of one length; got {shapes}.")
        return out
    values = np.asarray(to_numpy(reference), dtype=np.float64)
    if values.ndim == 1:
        return {"fz": values}
    if values.ndim == 2 and values.shape[1] == 3:
        return dict(zip(FORCES, values.T))
    raise InvalidInput(f"reference must have shape (frame,) or (frame, 3), or be a mapping; got {values.shape}.")


def _labels(run: Run, reference: Any, reference_time: Any, said: list[str]) -> dict[str, Floats]:
    """Return the labels of each frame of a run. Frames without a label have NaN; "std" is the standard deviation of the label, if stated."""
    count = len(run.flat)
    out: dict[str, Floats] = {}
    if reference is not None:
        out = _columns(reference)
        length = len(next(iter(out.values())))
        if reference_time is not None:
            clock = np.asarray(as_seconds(reference_time), dtype=np.float64)
            if run.time is None:
                raise InvalidInput("reference_time needs times of the frames: give a Recording, or time=.")
            if clock.shape != (length,) or (np.diff(clock) <= 0).any():
                raise InvalidInput(
                    f"reference_time must rise and hold one time for each of {length} samples; got shape {clock.shape}. Sort the samples by time, without times that occur twice."
                )
            then = np.stack([np.interp(clock, run.time, column) for column in np.nan_to_num(run.flat).T], axis=1)
            out = _without_stuck(out, then, said)
            main = out.get("fz", next(iter(out.values())))
            delay = find_delay(run.time, np.nan_to_num(run.flat), clock, main)
            said.append(
                f"the clock of the forces is {plain_number(abs(delay), 3)} s {'behind' if delay >= 0 else 'ahead of'} that of the frames: taken out"
            )
            out = {k: interpolated(run.time, clock + delay, v) for k, v in out.items() if np.isfinite(v).any()}
        elif length != count:
            raise InvalidInput(
                f"reference holds {length} values for {count} frames: give one for each frame, NaN where nothing is known, or its own clock with reference_time=."
            )
        else:
            out = _without_stuck(out, run.flat, said)
    if not out or not any(np.isfinite(v).any() for k, v in out.items() if k in FORCES):
        raise InvalidInput(
            'no force is known of any frame: give reference= (a force sensor), or weights=["200 g, 12 s to 20 s"]. Shapes and places alone do not give newtons.'
        )
    return out


def _without_stuck(known: dict[str, Floats], flat: Floats, said: list[str]) -> dict[str, Floats]:
    """Return the labels of each frame, with NaN where the force sensor had no valid value."""
    out = dict(known)
    for name in (n for n in FORCES if n in known):
        stuck, value = stuck_labels(known[name], flat)
        if stuck.any():
            out[name] = np.where(stuck, math.nan, known[name])
            said.append(
                f"{name} is exactly {plain_number(value, 4)} N in {int(stuck.sum())} samples while the readings differ: left out, because a force sensor reads so if it has no measurement or is at the end of its range"
            )
    return out


def _weighed(
    planes: Sequence[Any], run: Run, reference: Any, weights: list[Weight], baseline: int | None
) -> tuple[Run, dict[str, Floats]]:
    """Return one frame for each weight, in order of time: the mean of the frames during which it stood. They are
    averaged because they share the error of the weight.
    """
    if run.time is None:
        raise InvalidInput("weights have times, but the presses have none: give a Recording, or time= with the frames.")
    if reference is not None:
        raise InvalidInput(
            "give weights= or reference= for a run, not both; add the others in a second calibration, with again=True."
        )
    frames, rest = [], []
    complete = np.asarray(np.isfinite(run.flat).all(axis=1))
    if baseline and complete[:baseline].any():
        first = run.readings[:baseline][complete[:baseline]]
        rest.append(first - first.mean(axis=0))
    weights = sorted(weights, key=lambda w: w.start)  # the zero may drift from the first frame at rest to the last
    if baseline is None and all(w.force for w in weights):
        weights = [*_still_before(planes, run, weights[0].start), *weights]
    for weight in weights:
        at = np.flatnonzero((run.time >= weight.start) & (run.time <= weight.end))
        if not len(at):
            raise InvalidInput(
                f"no frame lies from {weight.start:g} to {weight.end:g} s: the recording goes from {run.time[0]:g} to {run.time[-1]:g} s. Give times within it."
            )
        still = at[int(ENDS * len(at)) : max(len(at) - int(ENDS * len(at)), int(ENDS * len(at)) + 1)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a taxel may be missing in all frames
            frames.append(np.nanmean(run.readings[still], axis=0))
        if weight.force == 0.0:
            rest.append(run.readings[still[complete[still]]] - frames[-1])
    readings, force = np.stack(frames), np.array([w.force for w in weights])
    flat = flat_readings(planes, readings)
    return Run(readings, flat, None, np.concatenate(rest) if rest else None), {"fz": force, "std": SCALE_STD * force}


def _still_before(planes: Sequence[Any], run: Run, start: float) -> list[Weight]:
    """Return the frames before the first weight as a weight of 0 g, if they are enough, and do not move."""
    if run.time is None:
        return []
    index = np.repeat(
        np.arange(sum(len(p.channels) for p in planes)), [int(p.valid.sum()) for p in planes for _ in p.channels]
    )
    at = np.flatnonzero(run.time < start)
    at = at[: len(at) - int(BEFORE * len(at))]
    if len(at) < FRAMES_FOR_NOISE or moved(run.flat[at], index):
        return []
    return [Weight(0.0, float(run.time[at[0]]), float(run.time[at[-1]]))]


def _mean_of_first(run: Run, baseline: int) -> Floats | None:
    """Return the mean readings of the first frames of a run, or None for no frame."""
    if not 0 <= baseline < len(run.flat):
        raise InvalidInput(f"baseline must be a number of frames from 0 to {len(run.flat) - 1}; got {baseline!r}.")
    return np.asarray(np.nanmean(run.flat[:baseline], axis=0)) if baseline else None


def _zero(run: Run, known: Mapping[str, Floats], said: list[str]) -> Floats | None:
    """Return the readings at rest, or None if no frame at rest is known."""
    at_rest = find_rest(known, run.flat)
    if at_rest.any():
        return np.asarray(np.median(run.flat[at_rest], axis=0))
    if NO_REST not in said:
        said.append(NO_REST)
    return None


def _kept_zero(
    planes: Sequence[Any], known: Sequence[Floats], rest: Floats, drifts: Sequence[Floats]
) -> tuple[Floats | None, Floats | None]:
    """Return the last of the known zeros of runs, and its standard deviation: scatter at rest, scatter between runs,
    and the largest drift within a run.
    """
    if not known:
        return None, None
    scatter = flat_readings(planes, rest).std(axis=0)
    apart = np.std(known, axis=0, ddof=1) if len(known) > 1 else 0.0
    return unflat(planes, known[-1]), unflat(planes, np.hypot(np.hypot(scatter, apart), np.max(drifts, axis=0)))


def zero_drift(flat: Floats, known: Mapping[str, Floats]) -> Floats:
    """Return the change of each reading's zero (reading,) from before the first press to after the last, minus the
    change that noise alone makes; 0 where either is unknown.
    """
    forces = [known[f] for f in FORCES if f in known]
    largest = max(float(np.nanmax(np.abs(f), initial=0.0)) for f in forces)
    rest = find_rest(known, flat)
    pressed = np.flatnonzero(np.any([np.abs(f) > REST_FRACTION * largest for f in forces], axis=0) & ~rest)
    if not len(pressed):
        return np.zeros(flat.shape[1])
    parts = [flat[: pressed[0]][rest[: pressed[0]]], flat[pressed[-1] :][rest[pressed[-1] :]]]
    if not all(map(len, parts)):
        return np.zeros(flat.shape[1])
    moved = np.median(parts[1], axis=0) - np.median(parts[0], axis=0)
    # the median of n frames has the variance pi / (2 n) of one
    noise = sum(0.5 * math.pi * np.var(p, axis=0, ddof=1) / len(p) if len(p) > 1 else 0.0 for p in parts)
    return np.asarray(np.sqrt(np.maximum(moved**2 - noise, 0.0)))


def unflat(planes: Sequence[Any], flat: Floats) -> Floats:
    """Return readings (channel, *array) from their flat form; NaN where a taxel is missing."""
    out, start = [], 0
    for plane in planes:
        part = np.full((len(plane.channels), *plane.shape), math.nan)
        count = part[:, plane.valid].size
        part[:, plane.valid] = flat[start : start + count].reshape(len(plane.channels), -1)
        start += count
        out.append(part)
    return np.concatenate(out)


def find_rest(known: Mapping[str, Floats], flat: Floats) -> npt.NDArray[np.bool_]:
    """Return the frames without contact: those with zero force, or those with almost no force if at least three of them have similar readings.

    A frame with a small force along one axis is not at rest if the force along another is large. Without normal force
    there is no shear, whether it is known or not.
    """
    forces = [known[f] for f in FORCES if f in known]
    if "fz" in known:
        forces = [np.where(np.isnan(f) & (known["fz"] == 0.0), 0.0, f) for f in forces]
    seen = np.isfinite(flat).all(axis=1)
    exact = np.all([f == 0.0 for f in forces], axis=0) & seen
    largest = max(float(np.nanmax(np.abs(f), initial=0.0)) for f in forces)
    small = np.all([np.abs(f) <= REST_FRACTION * largest for f in forces], axis=0) & seen
    if small.sum() >= FEWEST_AT_REST:
        middle = np.median(flat[small], axis=0)
        near = np.sqrt(((flat[small] - middle) ** 2).mean())
        if near <= ALIKE_AT_REST * np.sqrt(np.nanmean((flat[seen] - middle) ** 2)):
            return np.asarray(small)
    return np.asarray(exact)


def _join_runs(
    runs: list[Run], flats: list[Floats], known: list[dict[str, Floats]], labels: int, baseline: int
) -> Labelled:
    names = [n for n in (*FORCES, *PLACES, BALL) if any(n in k for k in known)]
    timed = all(r.time is not None for r in runs)
    rows: dict[str, list[Any]] = {n: [] for n in ("flat", "planes", "std", "time", "run", *names)}
    per_run = max(1, labels // len(runs))
    for number, (run, flat, one) in enumerate(zip(runs, flats, known)):
        forces = np.stack([one[f] for f in FORCES if f in one], axis=1)
        at = np.flatnonzero(np.isfinite(forces).any(axis=1) & np.isfinite(flat).all(axis=1))
        if not len(at):
            raise InvalidInput(
                f"run {number} has no frame with a known force and complete readings. Give the force of a frame whose readings are all finite, or leave the run out."
            )
        # without times, each frame is a press of its own
        plateau = np.arange(len(at)) if run.time is None else plateaus({n: v[at] for n, v in one.items()}, flat[at], at)
        first = np.unique(plateau, return_index=True)[1]
        kept = spread_over(np.nan_to_num(forces[at][first]), per_run)
        rows["flat"].append(_means(flat[at], first)[kept])
        rows["planes"].append(_means(run.readings[at], first)[kept])
        at = at[first][kept]
        rows["std"].append(one["std"][at] if "std" in one else np.zeros(len(at)))
        rows["time"].append(np.full(len(at), math.nan) if run.time is None else run.time[at] + 1e6 * number)
        rows["run"].append(np.full(len(at), number))
        for n in names:
            rows[n].append(one[n][at] if n in one else np.full(len(at), math.nan))
    made = {k: np.concatenate(v) for k, v in rows.items()}
    everything = np.stack([np.nan_to_num(made[f]) for f in FORCES if f in names], axis=1)
    if not np.abs(everything).max() > 0.0:
        raise InvalidInput("all known forces are zero: label a press too, such as weights=['200 g, 12 s to 20 s'].")
    if not np.abs(made["flat"]).max() > 0.0:
        raise InvalidInput("all labelled readings are zero: check which columns hold them.")
    time = made["time"] if timed else None
    press = press_numbers(made["time"], everything, made["run"])
    return Labelled(
        made["flat"], made["planes"], {n: made[n] for n in names}, made["std"], time, made["run"],
        np.asarray(press, dtype=np.int64), _rest_readings(runs, flats, known, made["planes"], baseline),
    )  # fmt: skip


def _means(values: Floats, first: npt.NDArray[np.intp]) -> Floats:
    """Return the mean of each part of ``values`` (frame, ...); the parts begin at ``first``."""
    return np.asarray(np.add.reduceat(values, first) / np.add.reduceat(np.ones_like(values), first))


def _rest_readings(
    runs: list[Run], flats: list[Floats], known: list[dict[str, Floats]], pressed: Floats, baseline: int
) -> Floats:
    """Return the frames at rest, the first ``baseline`` of each run among them, minus their zero (frame, channel,
    *array); their scatter is the noise. With fewer than five such frames, return random numbers with an assumed standard deviation.
    """
    found = []
    for run, flat, one in zip(runs, flats, known):
        if run.rest is not None:
            found.append(run.rest[:REST_KEPT])
        at_rest = find_rest(one, flat)
        if run.rest is None:
            at_rest[:baseline] |= np.isfinite(flat[:baseline]).all(axis=1)
        found.append(run.readings[at_rest][:REST_KEPT])
    rest = np.concatenate(found)[:REST_KEPT]
    if len(rest) >= 5 and np.nanmax(rest.std(axis=0)) > 0.0:
        return np.asarray(rest)
    noise = ASSUMED_NOISE * float(np.sqrt(np.nanmean(pressed**2)))
    return noise * np.random.default_rng(SEED).standard_normal((REST_KEPT, *pressed.shape[1:]))


def _maps(skin: Any, data: Labelled, before: SkinCalibration | None, *, zero_known: bool) -> dict[str, ForceMap]:
    likely = likely_maps(skin.pad, skin.planes, skin.surface, np.random.default_rng(SEED))
    out = {}
    for i, name in enumerate((*FORCES, *PLACES)):
        if name not in data.known:
            continue
        value = quantity(data, name)
        at = np.isfinite(value)
        if not at.any() or not np.abs(value[at]).max() > 0.0:
            continue
        flat, std, time = data.flat[at], data.std[at] if name == "fz" else np.zeros(int(at.sum())), data.time
        press, seconds, run = data.press[at], None if time is None else time[at], data.run[at]
        values = value[at]
        old = None if before is None else before.maps.get(name)
        if old is not None and old.process.readings.shape[1] == flat.shape[1]:
            p = old.labels
            keep = slice(None, max(1, MAX_LABELS - len(values)))
            if seconds is not None and p.time is not None:
                seconds = np.concatenate([p.time[keep] - 1e9, seconds])
            else:
                seconds = None
            flat, values, std = (
                np.concatenate([a[keep], b]) for a, b in ((p.readings, flat), (p.values, values), (p.std, std))
            )
            press = np.concatenate([p.press[keep], press + p.press.max() + 1])
            earlier = np.zeros(len(p.values), dtype=np.int64) if p.run is None else p.run
            run = np.concatenate([earlier[keep], run + earlier.max() + 1])
        physics = None if likely is None else likely[i]
        normal = data.known.get("fz", np.zeros(1))
        expected = SHEAR_SHARE * math.sqrt(float(np.nanmean(normal**2))) if name in ("fx", "fy") else 0.0
        out[name] = ForceMap.fit(
            Process(
                flat,
                values,
                std,
                usual_scale(flat),
                physics,
                press,
                seconds,
                run,
                zero_known=zero_known,
                expected=expected,
            )
        )
    return out
