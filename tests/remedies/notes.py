"""Notes that tell what to do, brought about through the public surface; what they advise, done on the same readings, and the note is gone or the answer right.

benchmarks/notes.py lists which notes are here, and tests/test_remedies.py tries them.
"""

from __future__ import annotations

import numpy as np

import palpate as pp
from palpate.status import Status
from remedies.noted import (
    BARE,
    BLIND,
    DRIFT,
    HELD,
    MISSING,
    PRESSED,
    REST,
    UPSIDE,
    Note,
    U,
    archived,
    both,
    cell,
    commanded,
    dots_by_frame,
    field,
    followed_dots,
    frozen,
    height,
    holds,
    iterated,
    last,
    markers,
    near,
    of_cell,
    offsets,
    one_frame,
    outlying,
    pressed_at,
    pulled,
    pulled_much,
    raw_file,
    readings,
    rezeroed,
    same_field,
    saved,
    session,
    smooth,
    standing,
    status_is,
    stopped,
    stuck,
    texts,
    three_lines,
    touch_of_file,
    touch_of_zarr,
    tracked,
    wandering,
    warned,
    weaker,
)

__all__ = ["NOTES", "texts"]

NOTES = [
    # what a method assumed
    Note(
        'say how well it is known ("200 kPa +- 10 %" in skin.toml, uncertainty=Uncertainty(youngs_modulus=0.1) in Python)',
        lambda: weaker(nuisance=[]),
        lambda: weaker(nuisance=[], uncertainty=pp.Uncertainty(youngs_modulus=0.1)),
        holds(0.0, 0.0, 1.0),  # the gel is 7 % stiffer than it is said to be
        room="inverse.words",
    ),
    Note(
        "pressure would move these readings too, and is then part of the shear: where something presses, seek it as well",
        lambda: dots_by_frame(False),
        lambda: dots_by_frame(False, components=["x", "y", "z"]),
        holds(0.0, 0.0, 2.0),
    ),
    Note(DRIFT, pulled, lambda: pulled(nuisance=[]), HELD, room="inverse.linear.patterns"),
    Note(
        BLIND,
        lambda: pulled(nuisance=[]),
        lambda: pulled(nuisance=[], noise=True),
        HELD,
        room="inverse.linear.regularised",
    ),
    Note(
        "and noise_correlation=... where it is shared",
        lambda: pulled(nuisance=[]),
        lambda: pulled(nuisance=[], noise=True, correlation=1.5e-6),
        HELD,
        room="inverse.linear.regularised",
    ),
    Note(BLIND, pulled_much, lambda: pulled_much(noise=True), HELD, room="inverse.linear.matrix_free.solver"),
    Note(
        "the iteration did not reach its tolerance{}: it left {} of the readings unsolved after {} steps. Give the array its noise=..., or a larger parameter",
        lambda: iterated(1e-12),
        lambda: iterated(1e-6),
        lambda touch: holds(*smooth()[2])(touch),
    ),
    Note(
        "the iteration did not reach its tolerance{}: it left {} of the readings unsolved after {} steps. Give the array its noise=...",
        lambda: iterated(1e-12),
        lambda: iterated(None, noise=True),
        lambda touch: holds(*smooth()[2])(touch),
    ),
    Note(
        'rule="{}" did not settle on a parameter{}: the last one tried is used. Give parameter=...',
        lambda: iterated(None, rounds=1),
        lambda: iterated(1e-3, rounds=1),
        lambda touch: near(*smooth()[2], within=0.1)(touch),
    ),
    Note(
        "drift{}: a shift or a tilt of the displacements that the readings do not tell from contact may be part of the force{}Where nothing drifts, say Skin(..., nuisance=[])",
        height,
        lambda: height(nuisance=[]),
        holds(0.0, 0.0, 1.0),
    ),
    # what became of a frame
    Note(
        "the readings pull as a whole{}: adhesion, or a wrong sign of the readings?",
        lambda: one_frame(-readings(1.0)[0]),
        lambda: one_frame(readings(1.0)[0]),
        holds(*PRESSED),
    ),
    Note(
        "contact that only pushes does not explain the readings{} (adhesion, cells that pull, a wrong pad or unit?){}",
        lambda: tracked(-readings(0.0, 0.0, 1.0))[-1],
        lambda: one_frame(-readings(0.0, 0.0, 1.0)[-1], method="tikhonov"),
        holds(-3.0, -10.0),
    ),
    Note(
        'contact that only pushes does not explain the readings: adhesion, cells that pull, a wrong pad or unit; Skin.reconstruct(method="tikhonov")',
        lambda: tracked(-readings(0.0, 0.0, 1.0))[-1],
        lambda: one_frame(-readings(0.0, 0.0, 1.0)[-1], method="tikhonov"),
        both(holds(-3.0, -10.0), status_is(Status.SOLVED)),
        room="status",
    ),
    Note(
        "contact that only pushes does not explain the readings: adhesion, cells that pull, a wrong pad or unit; {} otherwise check pad, units and the sign of the readings",
        lambda: tracked(-readings(0.0, 0.0, 1.0))[-1],
        lambda: tracked(readings(0.0, 0.0, 1.0))[-1],
        both(holds(*PRESSED), status_is(Status.SOLVED)),
        room="status",
    ),
    Note(
        "the model does not explain the readings{}{}: pad, depth, units, axes and signs of the channels may be wrong",
        lambda: one_frame(readings(1.0)[0] * np.array([[1.0], [-8.0]]) + 300.0),
        lambda: one_frame(readings(1.0)[0]),
        holds(*PRESSED),
    ),
    Note(
        "left out as unexplained by any contact (dead, stuck or saturated?): {}{}",
        lambda: stuck(mended=False),
        lambda: stuck(mended=True),
        holds(*PRESSED),
    ),
    Note(
        "the zero is being captured: the frame is taken to be without contact; touch nothing until the first frames are over",
        lambda: tracked(readings(0.0, 0.0), baseline=5),
        lambda: tracked(readings(*REST, 1.0), baseline=5)[-1],
        holds(*PRESSED),
        room="status",
    ),
    Note(
        "or give baseline=0 where the readings are zero already",
        lambda: tracked(readings(0.0, 1.0), baseline=5),
        lambda: tracked(readings(0.0, 1.0), baseline=0)[-1],
        holds(*PRESSED),
        room="status",
    ),
    Note(
        "the iteration stopped before it reached its tolerance; allow more time (a larger budget)",
        lambda: tracked(readings(0.0, 0.0, 1.0), budget=1e-7)[-1],
        lambda: tracked(readings(0.0, 0.0, 1.0), budget=60.0)[-1],
        both(holds(*PRESSED), status_is(Status.SOLVED)),
        room="status",
    ),
    Note(
        "the whole sensor has repeated itself bit by bit for many frames: the readings may be old; check that the sensor still runs",
        lambda: frozen(runs=False),
        lambda: frozen(runs=True),
        both(holds(*PRESSED), status_is(Status.SOLVED)),
        room="status",
    ),
    Note(
        "too few readings are finite and in range; check the sensor's cable, supply and range; the next good frame is answered again",
        lambda: tracked(np.concatenate([readings(0.0, 0.0), MISSING]))[-1],
        lambda: tracked(np.concatenate([readings(0.0, 0.0), MISSING, readings(1.0, seed=4)]))[-1],
        both(holds(*PRESSED), status_is(Status.SOLVED)),
        room="status",
    ),
    # trackers and sessions
    Note(
        "steady for {} s: contact or drift? rezero() where nothing touches",
        lambda: rezeroed(True),
        lambda: rezeroed(False),
        near(1.5, 5.0, within=0.03),
    ),
    Note(
        "a tracker misreads the normal force from markers that only move sideways{}shear is as good as that of frames by themselves (Skin.reconstruct",
        followed_dots,
        lambda: dots_by_frame(True),
        both(holds(0.0, 0.0, 2.0), near(0.0, 0.0, 2.0, within=0.1)),
    ),
    Note(
        "where nothing is found, readings stand far from 0{}Where nothing touches in the first frames, make these the zero",
        lambda: tracked(standing(), skin=BARE),
        lambda: tracked(standing(), skin=BARE, baseline=10)[19],
        near(*PRESSED, within=0.05),
    ),
    Note(
        "or take it anew while nothing touches (Z on the page, Tracker.rezero)",
        lambda: session(rezero=False)[0],
        lambda: last(session(rezero=True)[1][:20]),
        near(*PRESSED, within=0.05),
        room="sensing.zero",
    ),
    Note(
        "{} s the zero is taken anew from {} frames: nothing must touch",
        lambda: session(rezero=True)[0],
        lambda: last(session(rezero=True)[1][:20]),
        near(*PRESSED, within=0.05),
    ),
    # recordings
    Note(
        "{} keeps what is done: --resume goes on with it.",
        lambda: stopped(resume=False),
        lambda: stopped(resume=True),
        touch_of_zarr,
        given=raw_file,
    ),
    Note(
        "where nothing is found, readings stand far from 0{}such as the first ten with --baseline 10 (baseline=10)",
        lambda: archived(standing()),
        lambda: archived(standing(), baseline=10),
        pressed_at(19),
    ),
    Note(
        "most readings stand far from 0 and move little{}such as the first ten with --baseline 10 (baseline=10)",
        lambda: archived(offsets(), method="tikhonov"),
        lambda: archived(offsets(), baseline=10),
        pressed_at(11),
    ),
    Note(
        "most readings stand far from 0{}make these the zero, such as the first ten with --baseline 10",
        commanded("reconstruct raw.nc"),
        commanded("reconstruct raw.nc --baseline 10"),
        touch_of_file(11),
        room="sensing.zero",
        given=raw_file,
    ),
    Note(
        "the readings drift in the {} frames of the zero, or something touches: give fewer (--baseline, baseline=)",
        lambda: archived(wandering(), baseline=12),
        lambda: archived(wandering(), baseline=6),
        pressed_at(13),
    ),
    Note(
        "{}: the last line has no line break{}Compare it with the source, then end the line with a line break.",
        warned(lambda: three_lines("")),
        warned(lambda: three_lines("67\n")),
        lambda got: bool(got[1].readings.ravel()[-1] == 4567.0),
    ),
    Note(
        "readings are of markers that have passed their neighbours{}Take them out of the table, and they count as missing.",
        warned(lambda: markers(mistaken=True)),
        warned(lambda: markers(mistaken=False)),
        lambda got: bool(np.isnan(got[1].readings[2, 0, 14]) and np.isclose(np.nanmax(got[1].readings), 2e-4)),
        room="recordings.mapped",
    ),
    # cells
    of_cell(
        "say window= (--window)",
        lambda: cell(U()),
        lambda: cell(U(), field={"aperture": 1.5e-6}),
        lambda forces: forces["strain_energy"].value > cell(U())["strain_energy"].value,
    ),
    of_cell(
        "if they are bad ones, leave them out with without_outliers() (--drop-outliers)",
        lambda: cell(outlying()),
        lambda: cell(outlying(), clean=True),
    ),
    of_cell(
        "as no cell does: is v's sign right (up)",
        lambda: cell(U() * UPSIDE),
        lambda: cell(U() * UPSIDE * UPSIDE),
    ),
    of_cell(
        "are u and v the right way round, are rows and columns",
        lambda: cell(U()[::-1]),
        lambda: cell(U()[::-1][::-1]),
    ),
    of_cell(
        "the field turns more than it contracts, as no cell does",
        lambda: cell(np.swapaxes(U(), 1, 2)[:, ::-1]),
        lambda: cell(np.swapaxes(np.swapaxes(U(), 1, 2)[:, ::-1][:, ::-1], 1, 2)),
    ),
    of_cell(
        "or do the displacements have the opposite sign?",
        lambda: cell(-U()),
        lambda: cell(U()),
    ),
    of_cell(
        "less than pictures tell: is the unit right, and the pixel that of the picture?",
        lambda: cell(1e-3 * U(), noise=1e-12, field={"noise": 1e-12}),
        lambda: cell(U()),
    ),
    of_cell(
        "Where the picture cannot have moved, say drift=False (--still)",
        lambda: cell(U(), noise=None, drift=True),
        lambda: cell(U(), noise=None, drift=False),
    ),
    of_cell(
        "Give noise=... (--noise)",
        lambda: cell(U(), noise=None),
        lambda: cell(U()),
    ),
    of_cell(
        'uncertainty=Uncertainty(youngs_modulus=0.1) in Python, --youngs-modulus "8 kPa +- 10 %")',
        lambda: cell(U(), pp.HalfSpace(youngs_modulus=8.8e3, poissons_ratio=0.48)),
        lambda: cell(
            U(),
            pp.HalfSpace(youngs_modulus=8.8e3, poissons_ratio=0.48),
            uncertainty=pp.Uncertainty(youngs_modulus=0.1),
        ),
    ),
    # fields
    Note(
        "y and v are taken to grow downwards, as rows do (up=True, --up, where they do not)",
        lambda: field("vup"),
        lambda: field("vup", up=True),
        same_field(),
        given=saved,
    ),
    Note(
        "the vectors are taken to cover the picture: one every {} px (give the step where they do not)",
        lambda: field(step=None, size=(120, 100)),
        lambda: field(size=(120, 100)),
        same_field(step=8),
        given=saved,
    ),
    Note(
        "the vectors are taken to lie in the middle of the picture (give start where they do not)",
        lambda: field(size=(120, 100)),
        lambda: field(size=(120, 100), start=(3.5, 3.5)),
        same_field(start=(3.5, 3.5)),
        given=saved,
    ),
]
