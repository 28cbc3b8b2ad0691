"""Calibrations: what is known of presses, weights, clocks, calibrated skin files, and `palpate calibrate`."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.calibrate import Weight, calibrate, find_delay, read_calibration, write_calibrated
from palpate.recordings import write_recording
from remedies._remedy import Remedy, command, laid, value
from skin_files import skin_text

__all__ = ["REMEDIES"]

PAD = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.48)])


def area(count: int = 2) -> pp.AreaArray:
    return pp.AreaArray(shape=(count, count), pitch=12e-3, depth="base", channels=["stress_zz"])


SKIN = pp.Skin(PAD, area())
TWO = pp.Skin(PAD, [area(), area(3)])
FORCES = np.array([0.0, 1.0, 2.0, 4.0])


@lru_cache
def pressed() -> Any:
    """Readings (4, 1, 2, 2) of balls, the first of which weighs nothing."""
    balls = [np.zeros_like(np.asarray(SKIN.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=1.0))))]
    balls += [np.asarray(SKIN.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=float(f)))) for f in FORCES[1:]]
    return np.stack(balls) / 37.0


@lru_cache
def filmed(start: float = 0.0) -> pp.Recording:
    """Ten seconds: nothing, then 2 N and 4 N, and again."""
    index = np.repeat([0, 2, 3, 0, 1], 20)
    noise = 1e-3 * pressed().max() * np.random.default_rng(0).standard_normal((100, 1, 2, 2))
    return pp.Recording(readings=pressed()[index] + noise, channels=("stress_zz",), time=start + np.arange(100) / 10.0)


FILMED_FORCE = FORCES[np.repeat([0, 2, 3, 0, 1], 20)]


def flat() -> Any:
    return np.asarray(filmed().readings).reshape(100, -1)


def given(**options: Any) -> Any:
    """The calibration by the presses, with their forces where nothing else is given."""
    if "reference" not in options and "weights" not in options:
        options["reference"] = FORCES
    return calibrate(SKIN, options.pop("presses", pressed()), **options)


def weighed(weight: Any) -> Any:
    return given(presses=filmed(), weights=["0 g, 0 s to 2 s", weight])


LAYER = PAD.layers[0]
THREE = pp.Skin(pp.BondedLayers([LAYER, LAYER, LAYER]), area())
STRAINED = pp.Skin(PAD, pp.AreaArray(shape=(2, 2), pitch=12e-3, depth=4e-3, channels=["strain_zz"]))
SURFACE = pp.Skin(
    pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48),
    pp.AreaArray(shape=(2, 2), pitch=12e-3, depth=0.0, channels=["displacement_z"]),
)


def balls(**options: Any) -> Any:
    """The calibration by the presses, with a constant of the pad."""
    return given(**{"constants": ["unit"], **options})


@lru_cache
def calibrated() -> pp.Skin:
    return SKIN.calibrate(pressed(), reference=FORCES)


@lru_cache
def rejected() -> pp.Skin:
    """Readings that no pad gives, so that the elastic model is rejected."""
    rng = np.random.default_rng(0)
    readings = rng.standard_normal((60, 1, 2, 2))
    return SKIN.calibrate(readings, reference=readings.reshape(60, -1) @ [1.0, -2.0, 3.0, -4.0])


SKIN_FILE = skin_text(2, 2, pitch="12 mm", depth="8 mm")
PLACES = SKIN_FILE.replace(
    'kind = "area"\nshape = [2, 2]\npitch = "12 mm"', 'kind = "scattered"\npositions_file = "p.csv"'
)


def files() -> None:
    """A skin, presses with their times, and a table of forces on the same clock."""
    laid(skin_toml=SKIN_FILE, p_csv="x,y\n0,0\n0.012,0\n0,0.012\n0.012,0.012\n")
    recording = filmed()
    write_recording(recording, "presses.nc")
    write_recording(recording, "more.nc")
    rows = "".join(f"{t},{f},{2 * f}\n" for t, f in zip(recording.time, FILMED_FORCE))
    laid(forces_csv="t,Fz,other\n" + rows)


def calibrated_files() -> None:
    laid(skin_toml=SKIN_FILE, places_toml=PLACES)
    Path("deep").mkdir()
    write_calibrated("calibrated.toml", "skin.toml", calibrated().calibration)


def copied(where: str) -> Any:
    """The calibrated skin file in another folder."""
    Path(where).mkdir(exist_ok=True)
    Path(where, "calibrated.toml").write_text(Path("calibrated.toml").read_text(encoding="utf-8"), encoding="utf-8")
    return read_calibration(Path(where, "calibrated.toml"))


def copied_with_numbers() -> Any:
    Path("deep", "calibrated.calibration.npz").write_bytes(Path("calibrated.calibration.npz").read_bytes())
    return copied("deep")


def damaged() -> Any:
    Path("calibrated.calibration.npz").write_bytes(b"PK nothing")
    return read_calibration("calibrated.toml")


def calibrated_again() -> Any:
    write_calibrated("calibrated.toml", "skin.toml", calibrated().calibration)
    return read_calibration("calibrated.toml")


def run(wrong: str, mended: str, words: str, **options: Any) -> Remedy:
    """`palpate calibrate` with other arguments."""
    return Remedy(
        words,
        command(f"calibrate {wrong} --skin skin.toml"),
        command(f"calibrate {mended} --skin skin.toml"),
        room="cli.calibrate",
        given=files,
        **options,
    )


KNOWN = '--reference-file forces.csv --reference "time=t,fz=Fz"'

REMEDIES = [
    value("labels must be a whole number from 1 to", lambda v: given(labels=v), 0, 10),
    value(
        "reference must be a list with one entry for each of {} runs",
        lambda v: given(presses=[pressed(), pressed()], reference=v),
        [FORCES],
        [FORCES, FORCES],
    ),
    Remedy(
        "calibrate takes skins whose planes have one shape",
        lambda: calibrate(TWO, pressed(), reference=FORCES),
        lambda: calibrate(pp.Skin(TWO.pad, TWO.planes[0]), pressed(), reference=FORCES),
    ),
    value("presses must have the axes", lambda v: given(presses=v), pressed()[:, 0], pressed()),
    value(
        "time must be a list with the times of each of {} runs",
        lambda v: given(presses=[pressed(), pressed()], reference=[FORCES, FORCES], time=v),
        np.arange(4.0),
        [np.arange(4.0), np.arange(4.0)],
    ),
    value("time must hold one second for each of", lambda v: given(time=v), [0.0, 1.0], [0.0, 1.0, 2.0, 3.0]),
    value(
        "no force is known of any frame",
        lambda v: given(reference=v),
        {"x": np.zeros(4), "y": np.zeros(4)},
        FORCES,
    ),
    Remedy(
        "weights have times, but the presses have none",
        lambda: given(presses=np.asarray(filmed().readings), weights=["200 g, 2.5 s to 3.5 s"]),
        lambda: given(
            presses=np.asarray(filmed().readings), weights=["200 g, 2.5 s to 3.5 s"], time=np.asarray(filmed().time)
        ),
    ),
    Remedy(
        "give weights= or reference= for a run, not both",
        lambda: given(presses=filmed(), weights=["200 g, 2.5 s to 3.5 s"], reference=FILMED_FORCE),
        lambda: SKIN.calibrate(filmed(), reference=FILMED_FORCE).calibrate(
            filmed(), weights=["200 g, 2.5 s to 3.5 s"], again=True
        ),
    ),
    Remedy(
        "all known forces are zero",
        lambda: given(presses=filmed(), weights=["0 g, 0 s to 2 s"]),
        lambda: weighed("200 g, 2.5 s to 3.5 s"),
    ),
    value("all labelled readings are zero", lambda v: given(presses=v), np.zeros((4, 1, 2, 2)), pressed()),
    value("reference names {}; accepted", lambda v: given(reference={v: FORCES}), "force", "fz"),
    value(
        "each entry of reference must have shape (frame,)",
        lambda v: given(reference={"fz": FORCES, "fx": v}),
        0.1 * FORCES[:2],
        0.1 * FORCES,
    ),
    value(
        "reference must have shape (frame,) or (frame, 3)",
        lambda v: given(reference=v),
        np.ones((4, 2)),
        FORCES[:, None] * [0.1, 0.0, 1.0],
    ),
    value("no frame lies from", weighed, "200 g, 20 s to 30 s", "200 g, 2.5 s to 3.5 s"),
    value("baseline must be a number of frames from 0 to", lambda v: given(baseline=v), 4, 1),
    value(
        "has no frame with a known force and complete readings",
        lambda v: given(presses=[pressed(), v], reference=[FORCES, FORCES]),
        np.full((4, 1, 2, 2), np.nan),
        2.0 * pressed(),
    ),
    value(
        "reference_time needs times of the frames",
        lambda v: given(presses=v, reference=FILMED_FORCE, reference_time=np.asarray(filmed().time)),
        np.asarray(filmed().readings),
        filmed(),
    ),
    value(
        "reference_time must rise and hold one time for each of",
        lambda v: given(presses=filmed(), reference=FILMED_FORCE, reference_time=v),
        np.asarray(filmed().time)[::-1],
        np.asarray(filmed().time),
    ),
    value("give one for each frame, NaN where", lambda v: given(reference=v), [1.0, 2.0], [np.nan, 1.0, 2.0, np.nan]),
    value(
        "places are known but no normal force",
        lambda v: given(reference={"fx": 0.1 * FORCES, "x": 1e-3 * FORCES, **v}),
        {},
        {"fz": FORCES},
    ),
    value(
        "this calibration is for {} readings a frame",
        lambda s: calibrated().calibration.force(np.ones((1, s))),
        3,
        4,
        room="calibrate.calibration",
    ),
    value(
        "is an option of the elastic model, which does not fit the calibration presses",
        lambda v: rejected().reconstruct(pressed(), **v),
        {"friction": 0.5},
        {},
    ),
    value(
        "a calibrated skin file ends in .toml",
        lambda v: write_calibrated(v, "skin.toml", calibrated().calibration),
        "calibrated.json",
        "calibrated.toml",
        given=calibrated_files,
        room="recordings.skinnumbers",
    ),
    value(
        "names a positions_file beside it",
        lambda v: write_calibrated(v, "places.toml", calibrated().calibration),
        "deep/new.toml",
        "new.toml",
        given=calibrated_files,
    ),
    Remedy(
        "its [{}] names {}, which is not beside it",
        lambda: copied("deep"),
        copied_with_numbers,
        given=calibrated_files,
    ),
    Remedy("no file of palpate for [{}], or damaged", damaged, calibrated_again, given=calibrated_files),
    Remedy(
        "so no delay can be found",
        lambda: find_delay(np.ones(100), flat(), np.asarray(filmed().time), FILMED_FORCE),
        lambda: find_delay(np.asarray(filmed().time), flat(), np.asarray(filmed().time), FILMED_FORCE),
    ),
    value(
        "overlap too little",
        lambda start: given(presses=filmed(), reference=FILMED_FORCE, reference_time=start + np.asarray(filmed().time)),
        1e6,
        0.0,
    ),
    value("a weight needs its mass or force, and the times", weighed, "200 g", "200 g, 2.5 s to 3.5 s"),
    value("ends at {} s, not after", weighed, "200 g, 3.5 s to 2.5 s", "200 g, 2.5 s to 3.5 s"),
    value(
        "must not be negative; write 0 g",
        lambda v: given(presses=filmed(), weights=[v, "200 g, 2.5 s to 3.5 s"]),
        "-5 g, 0 s to 2 s",
        "0 g, 0 s to 2 s",
    ),
    value("needs a number and one of", weighed, "200 stone, 2.5 s to 3.5 s", "200 g, 2.5 s to 3.5 s"),
    value("is no number; write {}.", Weight.parse, "2.0.0 g, 1 s to 2 s", "200 g, 12 s to 20 s"),
    value("{} is not fitted:", lambda v: balls(constants=v), ["poissons_ratio", "unit"], ["unit"]),
    value("constants names {}; accepted", lambda v: balls(constants=v), ["stiffness"], ["unit"]),
    value("models names {}; accepted", lambda v: balls(pad_models=v), ["foam"], ["half-space", "bonded"]),
    value(
        "pad_models= ranks models by constants", lambda v: balls(constants=v, pad_models=["bonded"]), [], ["thickness"]
    ),
    value(
        "the constants of a pad need three presses", lambda v: balls(reference={"fz": v}), FORCES[[0, 0, 1, 2]], FORCES
    ),
    value("constants= needs the normal force fz", lambda v: balls(reference={v: FORCES}), "fx", "fz"),
    value("constants= needs presses with fz > 0", lambda v: balls(reference=v * FORCES), -1.0, 1.0),
    value(
        "ball_radius must be positive",
        lambda v: balls(reference={"fz": FORCES, "ball_radius": np.full(4, v)}),
        -1e-3,
        np.nan,
    ),
    Remedy(
        "constants= takes one plane over an area with channels",
        lambda: STRAINED.calibrate(pressed(), reference=FORCES, constants=["unit"]),
        lambda: STRAINED.calibrate(pressed(), reference=FORCES),
    ),
    Remedy(
        "constants= needs the thickness of the pad",
        lambda: SURFACE.calibrate(pressed(), reference=FORCES, constants=["youngs_modulus"]),
        lambda: balls(),
    ),
    Remedy(
        "constants= takes a half-space, one or two bonded layers",
        lambda: THREE.calibrate(pressed(), reference=FORCES, constants=["unit"]),
        lambda: THREE.calibrate(pressed(), reference=FORCES),
    ),
    value("the largest of the {} is {}; accepted", lambda v: given(presses=v * pressed()), 1e200, 1.0),
    run("presses.nc", 'presses.nc --weight "200 g, 2.5 s to 3.5 s"', "say what is known"),
    run(
        "presses.nc --reference-file forces.csv --weight '200 g, 2.5 s to 3.5 s'",
        f"presses.nc {KNOWN}",
        "--reference-file needs --reference",
    ),
    run(
        'presses.nc more.nc --weight "200 g, 2.5 s to 3.5 s"',
        'presses.nc --weight "200 g, 2.5 s to 3.5 s"',
        "the times in --weight belong to the clock of one recording",
    ),
    value(
        "this_run=True (--this-run) corrects a calibration by one recording of today",
        lambda skin: skin.calibrate(pressed(), reference=FORCES, this_run=True),
        SKIN,
        SKIN.calibrate(pressed(), reference=FORCES),
    ),
    value(
        "the calibration has maps of {}, and the presses have labels of {}",
        lambda name: SKIN.calibrate(pressed(), reference=FORCES).calibrate(
            pressed(), reference={name: FORCES}, this_run=True
        ),
        "fx",
        "fz",
    ),
    run(f"presses.nc {KNOWN} --again", f"presses.nc {KNOWN}", "{} starts from a calibration, and"),
    run('presses.nc --reference "fz=Fz"', f"presses.nc {KNOWN}", "--reference takes the columns of a table"),
    run(f"gone.nc {KNOWN}", f"presses.nc {KNOWN}", "no such file. Give the path of a recording"),
    run(
        f"presses.nc {KNOWN.replace('fz=', 'force=')}",
        f"presses.nc {KNOWN}",
        "--reference must name columns such as",
    ),
    run(f"presses.nc more.nc {KNOWN}", f"presses.nc {KNOWN}", "--reference-file is on the clock of one recording"),
    run(
        "presses.nc --reference-file forces.csv --reference fz=Fz",
        f"presses.nc {KNOWN}",
        "--reference must name the times of",
    ),
    run(f"presses.nc {KNOWN.replace('=Fz', '=F')}", f"presses.nc {KNOWN}", "no column {}. There are"),
    run(
        f"presses.nc {KNOWN.replace('=Fz', '=half*other')}",
        f"presses.nc {KNOWN.replace('=Fz', '=0.5*other')}",
        'is not a number; write it as in "fz=',
    ),
]
