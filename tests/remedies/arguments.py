"""Arguments in Python: numbers, arrays, surfaces, methods and what is read off a touch; what a refusal says that they must be."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import palpate as pp
from palpate.elastic import find_channel
from palpate.recordings import Recording
from palpate.sensing.grids import AreaGrid, LineGrid
from palpate.touch import Forces, joined
from palpate.uncertainty import Case
from palpate.units import convert_factor, parse_quantity
from remedies._remedy import Remedy, value
from remedies.skins import (
    AREA,
    BATCH,
    BOTH,
    CREEPING,
    FAST,
    GEL,
    GRID,
    NOISY,
    NORMAL,
    ONE,
    PAD,
    PRESS,
    PUNCH,
    ROWS,
    SCATTERED,
    SKIN,
    TOUCH,
    TRACTION,
    WORKING,
    area,
    labelled,
    line,
    method,
)

FORCE = float(TOUCH.force[-1])
BALL = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)
PERIODIC = pp.Skin(PAD, line(), boundary="periodic")
SPREAD = pp.Skin(PAD, pp.ScatteredArray(positions=SCATTERED, depth=1e-3, channels=["stress_zz"]))
THREE = pp.Skin(PAD, area(channels=["stress_xz", "stress_yz", "stress_zz"]))


def same(touch: Any) -> bool:
    """The answer is that of the readings as they were meant."""
    return bool(np.isclose(float(np.ravel(touch.force)[-1]), FORCE, rtol=1e-6))


def solve(words: str, wrong: Any, mended: Any, *, room: str = "", right: Any = same, **given: Any) -> Remedy:
    """Readings that are refused, and what is to be given in their place."""

    def call(values: Any) -> Any:
        return SKIN.reconstruct(values() if callable(values) else values, **{**FAST, **given})

    return Remedy(words, lambda: call(wrong), lambda: call(mended), room=room, right=right)


class Quantity:
    """Readings with a unit, as pint has them."""

    def __init__(self, values: Any) -> None:
        self.values, self.units = values, "pascal"

    def to(self, unit: str) -> Any:
        return self

    @property
    def magnitude(self) -> Any:
        return self.values


def lazy() -> Any:
    return pytest.importorskip("dask.array").from_array(PRESS)


def frame() -> Any:
    return pytest.importorskip("pandas").DataFrame(PRESS)


def placed(**coordinates: Any) -> Any:
    return xr.DataArray(np.ones((1, 12)), dims=("channel", "taxel"), coords=coordinates)


def spread(values: Any) -> Any:
    return SPREAD.reconstruct(values, **FAST)


XY = {"x": ("taxel", [p[0] for p in SCATTERED]), "y": ("taxel", [p[1] for p in SCATTERED])}
FAR = {"x": ("taxel", [1e3 * p[0] for p in SCATTERED]), "y": XY["y"]}
TWO = pp.Skin(PAD, [line(), line(depth=2e-3)])
MIXED = pp.Skin(PAD, [line(), line(count=7, depth=2e-3)])
STACKED = TWO.sense(PUNCH)
PARTS = MIXED.sense(PUNCH)
ROBUST = pp.Skin(PAD, line().masked(WORKING))

REMEDIES = [
    # arrays as they come
    solve("{} must be real numbers; got dtype {}.", PRESS + 0j, PRESS, room="_arrays"),
    solve("must be numbers in a rectangular array", [[1.0, 2.0], [1.0]], PRESS.tolist()),
    solve("pass x.to_numpy(), reshaped to the expected shape", frame, lambda: frame().to_numpy()),
    solve("pass x.compute()", lazy, lambda: lazy().compute()),
    solve("must be an array (NumPy, PyTorch or any array-API kind)", {"stress": PRESS}, PRESS),
    solve("readings are empty", PRESS[None][:0], PRESS[None], room="sensing.readings"),
    solve("Check the units: readings are in", 1e9 * PRESS, PRESS),
    value(
        "the {} planes differ in shape: pass a list",
        lambda r: MIXED.reconstruct(r, **FAST),
        np.concatenate([p.ravel() for p in PARTS]).reshape(1, -1),
        PARTS,
    ),
    value(
        "or be a list with one array per plane; got",
        lambda r: TWO.reconstruct(r, **FAST),
        STACKED[0] if isinstance(STACKED, list) else STACKED[:2],
        STACKED,
    ),
    value("traction must have shape", SKIN.sense, TRACTION.T, TRACTION, room="sensing.readings"),
    value(
        "time must have one entry for each frame", lambda t: CREEPING.sense(TRACTION[None], time=t), [0.0, 1.0], [0.0]
    ),
    value(
        "time must be finite and increase from frame to frame",
        lambda t: CREEPING.sense(np.stack([TRACTION] * 2), time=t),
        [1.0, 0.0],
        [0.0, 1.0],
    ),
    # labels
    value(
        "or drop it: x.drop_vars(", spread, placed(taxel=range(5, 17)), placed(taxel=range(5, 17)).drop_vars("taxel")
    ),
    value(
        "got the dimension {} besides",
        lambda x: SKIN.reconstruct(x, **FAST),
        labelled("channel", "x").expand_dims("y"),
        labelled("channel", "x").expand_dims("y").squeeze("y"),
        right=same,
    ),
    value(
        'the attribute "units" must be one name',
        lambda x: SKIN.reconstruct(x, **FAST),
        labelled("channel", "x").assign_attrs(units=["Pa", "Pa"]),
        labelled("channel", "x").assign_attrs(units="Pa"),
        right=same,
    ),
    value(
        "must hold one position [m] for each entry",
        lambda x: SKIN.reconstruct(x, **FAST),
        labelled("channel", "x", x=list("abcdefghi")),
        labelled("channel", "x", x=ROWS),
        right=same,
    ),
    value(
        "the coordinates x and y of the taxels hold values that are not finite",
        spread,
        placed(**{**XY, "x": ("taxel", [np.nan] * 12)}),
        placed(**XY),
    ),
    value("or drop them where the order is right", spread, placed(**FAR), placed(**FAR).drop_vars(["x", "y"])),
    value("must be given both, along the dimension taxel", spread, placed(x=XY["x"]), placed(**XY)),
    # pads and arrays
    value("channel {} is not known; accepted", find_channel, "stress_z", "stress_zz"),
    value("channels is empty: name at least one", lambda c: line(channels=c), [], ["stress_zz"]),
    value(
        "thickness must be a positive, finite number of metres",
        lambda t: pp.Layer(thickness=t, youngs_modulus=2e5, poissons_ratio=0.48),
        0.0,
        2e-3,
    ),
    value("layers must be a list of at least one Layer", pp.BondedLayers, [], GEL.layers),
    value("base must be a HalfSpace, or None", lambda b: pp.BondedLayers(GEL.layers, base=b), "rigid", None),
    value("pad must be an elastic body", lambda p: pp.Skin(p, line()), 2e5, PAD),
    value("elastic must be a HalfSpace, BondedLayers", lambda e: pp.Viscoelastic(e, [(0.3, 1.0)]), 2e5, PAD),
    value("prony needs at least one pair", lambda p: pp.Viscoelastic(PAD, p), [], [(0.3, 1.0)]),
    value("prony must be a list of pairs", lambda p: pp.Viscoelastic(PAD, p), [0.3], [(0.3, 1.0)]),
    value(
        "noise must be one standard deviation or one per channel", lambda n: line(noise=n), (1.0, 2.0, 3.0), (1.0, 2.0)
    ),
    value("limits must be the largest reading s, for -s to s", lambda e: line(limits=e), (5e4, -5e4), (-5e4, 5e4)),
    value(
        "cannot be kept where the pad creeps",
        lambda e: pp.Skin(pp.Viscoelastic(PAD, [(0.3, 1.0)]), line(channels=["strain_zz"], limits=e)),
        (0.0, 0.1),
        (-np.inf, np.inf),
    ),
    value("mask must be a boolean array of shape", line().masked, WORKING[:5], WORKING),
    value("mask leaves no working taxel", line().masked, WORKING & False, WORKING),
    value(
        "positions must have shape (n, 2) for area contact",
        lambda p: pp.ScatteredArray(positions=p, depth=1e-3, channels=["stress_zz"]),
        np.zeros((4, 3)),
        SCATTERED,
        room="sensing.arrays",
    ),
    value(
        "positions contain {} values that are not finite",
        lambda p: pp.ScatteredArray(positions=p, depth=1e-3, channels=["stress_zz"]),
        [*SCATTERED, (np.nan, 0.0)],
        SCATTERED,
    ),
    value("array must be a LineArray, AreaArray or ScatteredArray", lambda a: pp.Skin(PAD, a), [1, 2], line()),
    value('boundary must be "free" or "periodic"', lambda b: pp.Skin(PAD, line(), boundary=b), "open", "free"),
    value("working must hold one mask for each", TWO.masked, [WORKING], [WORKING, WORKING]),
    value("must be a whole number, at least", lambda n: LineGrid(count=n, spacing=1e-3), 0, 9, room="sensing.grids"),
    value("{} must be one number of metres; got", lambda c: LineGrid(count=9, spacing=1e-3, center=c), (0.0, 0.0), 0.0),
    value(
        "center must be a place (x, y) in metres",
        lambda c: AreaGrid(shape=(4, 5), spacing=1e-3, center=c),
        0.0,
        (0.0, 0.0),
    ),
    value("{} must be {} [m]; got", lambda s: LineGrid(count=9, spacing=s), 0.0, 1e-3),
    value(
        "must be one length or a pair", lambda s: AreaGrid(shape=(4, 5), spacing=s), (1e-3, 1e-3, 1e-3), (1e-3, 1e-3)
    ),
    value("shape must be (ny, nx)", lambda s: AreaGrid(shape=s, spacing=1e-3), (4, 5, 6), (4, 5)),
    value("the surface is a {} but the array is a", lambda s: pp.Skin(PAD, line(), surface=s), AREA.surface, GRID),
    value(
        'nuisance must be "auto"', lambda n: pp.Skin(PAD, line(), nuisance=n).reconstruct(PRESS, **FAST), ["slope"], []
    ),
    # methods and their options
    method(
        'is for pressure alone, which is positive: components=["z"]',
        {"method": "maxent"},
        {"method": "maxent", "components": ["z"]},
        skin=NOISY,
    ),
    value(
        "components must be a list of names among",
        lambda c: SKIN.reconstruct(PRESS, components=c, **FAST),
        "xz",
        ["x", "z"],
        right=same,
    ),
    value(
        'boundary="periodic" takes noise as independent',
        lambda b: pp.Skin(PAD, line(noise=10.0, noise_correlation=1e-3), boundary=b).reconstruct(PRESS, **FAST),
        "periodic",
        "free",
    ),
    method(
        "the discrepancy principle needs the noise", {**FAST, "parameter": "discrepancy"}, {**FAST, "parameter": "gcv"}
    ),
    method("order must be 0, 1 or 2", {**FAST, "order": 3}, {**FAST, "order": 2}),
    value(
        "leave nuisance out",
        lambda given: pp.Skin(PAD, line(), boundary="periodic", **given).reconstruct(PRESS, **FAST),
        {"nuisance": ["offset", "ramp"]},
        {},
    ),
    method('use method="tikhonov" on a periodic surface', {"method": "adaptive"}, FAST, skin=PERIODIC),
    method(
        'needs the noise: give the array noise=..., or use method="tikhonov"',
        {"method": "wiener", "spectrum": lambda k: 1e6 / (1 + (1e-3 * k) ** 2)},
        FAST,
    ),
    method(
        "needs a regular array (LineArray or AreaArray); use method=",
        {"method": "dft"},
        FAST,
        skin=SPREAD,
        readings=np.ones((1, 12)),
        room="inverse.paper.grid",
    ),
    method("needs every taxel; use method=", {"method": "dft"}, FAST, skin=ROBUST),
    method("is an option of no method; there are", {**FAST, "smoothness": None}, {**FAST, "order": None}),
    method("does not take {}; {}.", {**FAST, "friction": 0.5}, {"method": "constrained", "friction": 0.5}),
    method(
        'method="constant_friction" needs one complete LineArray',
        {"method": "constant_friction", "friction": 0.5},
        {"method": "tikhonov", "parameter": 1e-4, "components": ["x", "z"]},
    ),
    value(
        'method="constant_friction" needs a normal stress or strain',
        lambda c: pp.Skin(PAD, line(channels=[c])).reconstruct(ONE, method="constant_friction", friction=0.5),
        "stress_xz",
        "stress_zz",
    ),
    value(
        "at k = 0 too",
        lambda f: NOISY.reconstruct(PRESS, method="wiener", spectrum=f),
        lambda k: -1e6 + 0 * k,
        lambda k: 1e6 + 0 * k,
    ),
    value(
        "this one fails",
        lambda f: NOISY.reconstruct(PRESS, method="wiener", spectrum=f),
        lambda k: {"z": k},
        lambda k: 1e6 + 0 * k,
    ),
    value(
        "spectrum lacks the component",
        lambda f: NOISY.reconstruct(PRESS, method="wiener", spectrum=f),
        {"z": lambda k: 1e6 + 0 * k},
        {"x": lambda k: 1e6 + 0 * k, "z": lambda k: 1e6 + 0 * k},
    ),
    # what is read off a touch
    value('of must be "peak_pressure" or "force"', lambda of: TOUCH.exceeds(1.0, of), "pressure", "force"),
    value("of must be one of", lambda of: TOUCH.interval(0.95, of), "torque", "force"),
    Remedy(
        'belongs to interval(of="slip_margin")',
        lambda: TOUCH.interval(0.95, "slip_margin"),
        lambda: TOUCH.interval(0.95, "slip_margin", friction=0.5),
    ),
    value("threshold must lie between 0 and 1", lambda t: TOUCH.contact(threshold=t), 2.0, 0.5),
    value("friction must be a positive number", TOUCH.slip_margin, -1.0, 0.5, room="touch.numbers"),
    value("there is nothing to join: give at least one touch", joined, [], [TOUCH]),
    value(
        "results of different surfaces or components cannot be joined",
        joined,
        [TOUCH, NORMAL.reconstruct(ONE, **FAST)],
        [TOUCH, TOUCH],
    ),
    value(
        "results of different skins cannot be joined",
        joined,
        [TOUCH, replace(TOUCH, case=Case("area"))],
        [TOUCH, TOUCH],
    ),
    value("single frames join with single frames", joined, [TOUCH, BATCH], [TOUCH, BATCH.frame(0)]),
    value("no frames {} in a result", lambda i: BATCH[i], 5, 1),
    value(
        "pick along the first, touch[0]",
        lambda t: t.table(),
        SKIN.reconstruct(np.stack([[PRESS, PRESS]] * 2), **FAST),
        SKIN.reconstruct(np.stack([[PRESS, PRESS]] * 2), **FAST)[0],
    ),
    Remedy(
        "cannot go on one of others; begin a new one",
        lambda: gathered(TOUCH, AREA.reconstruct(AREA.sense(BALL), **FAST)),
        lambda: gathered(TOUCH, TOUCH),
    ),
    # trackers and monitors
    value("incipient must lie between 0 and", lambda i: pp.GraspMonitor(friction=0.5, incipient=i), 2.0, 0.3),
    value("{} must be a positive number; got", lambda f: pp.GraspMonitor(friction=f), -0.5, 0.5, room="grasp"),
    value("{} must be a positive number; got", lambda r: SKIN.track(rate=r), 0.0, 100.0, room="tracking.settings"),
    value("baseline must be a number of frames >= 0; got", lambda b: SKIN.track(baseline=b), PRESS, 5),
    value(
        "Readings at rest go into zero=",
        lambda given: SKIN.track(**given),
        {"baseline": PRESS},
        {"zero": PRESS},
    ),
    value(
        "both state the zero: leave one out",
        lambda given: SKIN.track(**given),
        {"baseline": 5, "zero": PRESS},
        {"zero": PRESS},
    ),
    value(
        "or leave these taxels out (Skin.masked)",
        lambda s: s.track(zero=np.where(WORKING, PRESS, np.nan)),
        SKIN,
        SKIN.masked(WORKING),
    ),
    value(
        "frames must be a whole number of at least 1",
        lambda n: SKIN.track().rezero(frames=n),
        0,
        10,
        room="tracking.tracker",
    ),
    value(
        "must be a finite number of seconds; got",
        lambda t: SKIN.track().step(PRESS, t),
        True,
        np.timedelta64(20, "ms"),
        room="sensing.times",
        right=lambda touch: float(touch.time) == 0.02,
    ),
    value(
        "seconds within 2**33 of 0; got",
        lambda t: SKIN.track().step(PRESS, t),
        1.7e12,
        1.7e12 / 1000,
        room="sensing.times",
    ),
    value(
        "which has no length: give it a unit",
        lambda t: SKIN.track().step(PRESS, t),
        np.timedelta64(20),
        np.timedelta64(20).astype("timedelta64[ms]"),
        right=lambda touch: float(touch.time) == 0.02,
    ),
    value(
        "std must not be negative",
        lambda s: SKIN.track().step(PRESS, 0.0, std=s),
        -np.ones(PRESS.shape),
        np.ones(PRESS.shape),
    ),
    # closed forms
    value(
        "{} must be a positive, finite number of {}; got",
        lambda r: pp.solutions.hertz_point(contact_radius=r, force=1.0),
        0.0,
        2e-3,
        room="solutions._common",
    ),
    value(
        "a point load has no finite traction; use fields()",
        lambda f: f(),
        lambda: pp.solutions.point_load(force=1.0).traction(ROWS, ROWS),
        lambda: pp.solutions.point_load(force=1.0).fields(PAD, ["stress_zz"], ROWS, ROWS, 1e-3),
    ),
    value(
        'component must be "x", "y" (shear) or "z" (pressure); got',
        lambda c: pp.solutions.point_load(force=1.0, component=c),
        "w",
        "z",
    ),
    value("force must be a finite number of newtons", lambda f: pp.solutions.point_load(force=f), np.nan, 1.0),
    value(
        "On the surface use traction()",
        lambda f: f(),
        lambda: BALL.fields(PAD, ["stress_zz"], ROWS, ROWS, 1e-6),
        lambda: BALL.traction(ROWS, ROWS),
    ),
    value(
        "{} must be a finite number of {}; got {}.",
        lambda d: BALL.sliding(0.5, direction=d),
        np.nan,
        0.0,
        room="solutions._common",
    ),
    value(
        "make one with hertz_point",
        lambda c: c.partial_slip(0.5, 0.1),
        pp.solutions.flat_punch(radius=2e-3, force=1.0),
        BALL,
    ),
    value(
        'component must be "x" (shear) or "z" (pressure) in line contact',
        lambda c: pp.solutions.line_load(force=1.0, component=c),
        "y",
        "x",
    ),
    value("force must be a finite number of N/m", lambda f: pp.solutions.line_load(force=f), np.nan, 1.0),
    value(
        "names in {} must be text",
        lambda m: Recording(readings=PRESS[None], channels=BOTH, meta=m),
        {3: "trial"},
        {"3": "trial"},
        room="recordings.meta",
    ),
    value(
        "{} takes text, numbers, truth values, and lists and mappings of them",
        lambda m: Recording(readings=PRESS[None], channels=BOTH, meta=m),
        {"when": np.datetime64("2026-01-01")},
        {"when": str(np.datetime64("2026-01-01"))},
    ),
    value("{} must be a finite number of {}; got {}.", PUNCH.sliding, np.nan, 0.5, room="solutions._common"),
    value(
        "make one with hertz_line",
        lambda c: c.partial_slip(0.5, 1.0),
        pp.solutions.flat_punch_line(half_width=2e-3, force=10.0),
        PUNCH,
    ),
    value("wavelength must be positive and finite", lambda w: SKIN.observability(w), -1.0, 1e-3),
    # recordings
    value(
        "time must be {} finite seconds; got shape",
        lambda t: Recording(readings=PRESS[None], channels=BOTH, time=t),
        [0.0, 1.0],
        [0.0],
    ),
    value(
        "time must increase; frame",
        lambda t: Recording(readings=np.stack([PRESS] * 2), channels=BOTH, time=t),
        [1.0, 0.0],
        [0.0, 1.0],
    ),
    value(
        "readings must have axes (time, channel, taxel)",
        lambda r: Recording(readings=r, channels=BOTH),
        PRESS,
        PRESS[None],
    ),
    value("the recording is empty", lambda r: Recording(readings=r, channels=BOTH), PRESS[None][:0], PRESS[None]),
    value(
        "gridded needs a recording with scattered positions",
        lambda p: Recording(readings=np.zeros((1, 1, 12)), channels=["stress_zz"], positions=p).gridded(1e-3),
        None,
        SCATTERED,
    ),
    value(
        "gridded needs readings at positions that span an area",
        lambda p: Recording(readings=np.zeros((1, 1, 12)), channels=["stress_zz"], positions=p).gridded(1e-3),
        np.outer(np.arange(12.0), [1e-3, 1e-3]),
        SCATTERED,
    ),
    value(
        "pitch must be a positive number of metres; got",
        lambda p: Recording(readings=np.zeros((1, 1, 12)), channels=["stress_zz"], positions=SCATTERED).gridded(p),
        0.0,
        1e-3,
        room="recordings.recording",
    ),
    value(
        "take a wider one",
        lambda p: Recording(readings=np.zeros((1, 1, 12)), channels=["stress_zz"], positions=SCATTERED).gridded(p),
        1e-9,
        1e-3,
    ),
    value(
        "positions must have shape ({}, 2) or ({},), one per taxel",
        lambda p: Recording(readings=PRESS[None], channels=BOTH, positions=p),
        SCATTERED,
        ROWS,
    ),
    value(
        "positions hold values that are not finite",
        lambda p: Recording(readings=PRESS[None], channels=BOTH, positions=p),
        np.where(WORKING, ROWS, np.nan),
        ROWS,
        room="recordings.recording",
    ),
    # quantities
    value(
        "has no unit: write",
        lambda q: parse_quantity(q, "length", "depth"),
        2,
        "2 m",
        right=lambda v: v == 2.0,
        room="units",
    ),
    value(
        "{} must be a quantity such as",
        lambda q: parse_quantity(q, "length", "depth"),
        None,
        "1.5 mm",
        right=lambda v: v == 1.5e-3,
    ),
    value(
        "has the unit {}; accepted for a",
        lambda q: parse_quantity(q, "pressure", "modulus"),
        "200 bar",
        "20 MPa",
        right=lambda v: v == 2e7,
        room="units",
    ),
    value(
        "{} = {} is not finite",
        lambda q: parse_quantity(q, "length", "depth"),
        "1e999 mm",
        "1 mm",
        right=lambda v: v == 1e-3,
    ),
    value(
        "is far below the size of an atom",
        lambda q: parse_quantity(q, "length", "depth"),
        "1e-12 nm",
        "1 mm",
        right=lambda v: v == 1e-3,
    ),
    value(
        "{} has the unit {}; accepted: {}.",
        lambda u: convert_factor(u, "Pa", "unit"),
        "bar",
        "kPa",
        right=lambda v: v == 1e3,
    ),
]


def gathered(*touches: Any) -> Any:
    forces = Forces()
    for touch in touches:
        forces.add(touch)
    return forces.table()
