"""Pads, arrays, skins and methods in Python: what a refusal of them advises."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import palpate as pp
from palpate import simulation
from palpate.recordings import read_recording, write_recording
from palpate.touch import Forces
from palpate.units import parse_quantity
from remedies._remedy import Remedy

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
RUBBER = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
GEL = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
BOTH = ["stress_xz", "stress_zz"]


def line(**given: Any) -> pp.LineArray:
    return pp.LineArray(**{"count": 9, "pitch": 1e-3, "depth": 1e-3, "channels": BOTH, **given})


def area(**given: Any) -> pp.AreaArray:
    return pp.AreaArray(**{"shape": (4, 5), "pitch": 1e-3, "depth": 1e-3, "channels": ["stress_zz"], **given})


SKIN, NORMAL, AREA = pp.Skin(PAD, line()), pp.Skin(PAD, line(channels=["stress_zz"])), pp.Skin(PAD, area())
NOISY = pp.Skin(PAD, line(noise=10.0))
CREEPING = pp.Skin(pp.Viscoelastic(PAD, [(0.3, 1.0)]), line())
PUNCH = pp.solutions.hertz_line(half_width=3e-3, force=50.0)
PRESS = SKIN.sense(PUNCH)
ONE = PRESS[1:]
TRACTION = SKIN.sample(PUNCH)
FAST = {"method": "tikhonov", "parameter": 1e-4}
DEAD = np.where(np.arange(9) == 4, np.nan, PRESS)
WORKING = np.arange(9) != 4
TOUCH = SKIN.reconstruct(PRESS, **FAST)
BATCH = SKIN.reconstruct(np.stack([PRESS, PRESS]), **FAST)
GRID = SKIN.surface
ROWS = np.linspace(-4e-3, 4e-3, 9)
SCATTERED = [(x * 1e-3, y * 1e-3) for y in range(3) for x in range(4)]


def labelled(*names: str, **coordinates: Any) -> xr.DataArray:
    return xr.DataArray(PRESS, dims=names, coords=coordinates)


def monitored(touch: pp.Touch) -> object:
    return pp.GraspMonitor(friction=0.5).update(touch)


def method(
    words: str,
    wrong: dict[str, Any],
    mended: dict[str, Any],
    *,
    skin: Any = SKIN,
    readings: Any = PRESS,
    room: str = "",
    slow: bool = False,
) -> Remedy:
    """Options of `Skin.reconstruct`."""
    return Remedy(
        words,
        lambda: skin.reconstruct(readings, **wrong),
        lambda: skin.reconstruct(readings, **mended),
        room=room,
        slow=slow,
    )


REMEDIES = [
    Remedy(
        "whose labels a list would drop: join them first",
        lambda: SKIN.reconstruct([labelled("channel", "x")] * 2, **FAST),
        lambda: SKIN.reconstruct(xr.concat([labelled("channel", "x")] * 2, dim="time"), **FAST),
    ),
    Remedy(
        "pass one of its variables",
        lambda: SKIN.reconstruct(xr.Dataset({"stress": labelled("channel", "x")}), **FAST),
        lambda: SKIN.reconstruct(xr.Dataset({"stress": labelled("channel", "x")})["stress"], **FAST),
    ),
    Remedy(
        "channels must be a list of names; got the string",
        lambda: line(channels="stress_zz"),
        lambda: line(channels=["stress_zz"]),
    ),
    Remedy(
        "channels names one channel twice",
        lambda: line(channels=["stress_zz"] * 2),
        lambda: line(channels=["stress_zz"]),
    ),
    Remedy(
        "channel {} {}; accepted: ",
        lambda: line(channels=["stress_yz"]),
        lambda: line(channels=["stress_xz"]),
        room="elastic.channels",
    ),
    Remedy("A soft silicone is about", lambda: pp.HalfSpace(youngs_modulus=-1.0, poissons_ratio=0.5), lambda: RUBBER),
    Remedy(
        "must lie between 0 and 0.5",
        lambda: pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=50),
        lambda: pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.50),
    ),
    Remedy(
        "Measure a stress, or reconstruct the traction from the strains",
        lambda: pp.stress_from_strains(1e-3, -1e-3, youngs_modulus=2e5, poissons_ratio=0.5),
        lambda: pp.Skin(RUBBER, line(channels=["strain_xx", "strain_zz"])).reconstruct(PRESS / 1e6, **FAST),
    ),
    Remedy(
        'Use depth="base" for taxels at the base',
        lambda: pp.Skin(GEL, line(depth=2.5e-3)),
        lambda: pp.Skin(GEL, line(depth="base")),
    ),
    Remedy(
        '"base" needs a pad with a base',
        lambda: pp.Skin(PAD, line(depth="base")),
        lambda: pp.Skin(GEL, line(depth="base")),
    ),
    Remedy(
        "layers that creep on a half-space that creeps differently",
        lambda: pp.Viscoelastic(pp.BondedLayers(GEL.layers, base=PAD), [(0.3, 1.0)]),
        lambda: pp.Viscoelastic(pp.BondedLayers(GEL.layers), [(0.3, 1.0)]),
    ),
    Remedy(
        "must sum to less than 1",
        lambda: pp.Viscoelastic(PAD, [(0.6, 1.0), (0.6, 2.0)]),
        lambda: pp.Viscoelastic(PAD, [(0.3, 1.0), (0.3, 2.0)]),
    ),
    Remedy("takes one touch at a time: Touch.frame(i)", lambda: monitored(BATCH), lambda: monitored(BATCH.frame(0))),
    Remedy(
        "needs the pressure: seek component z.",
        lambda: monitored(SKIN.reconstruct(PRESS, components=["x"], **FAST)),
        lambda: monitored(SKIN.reconstruct(PRESS, components=["x", "z"], **FAST)),
    ),
    Remedy(
        "only pressure is sought here. Leave friction out",
        lambda: NORMAL.reconstruct(ONE, friction=0.5),
        lambda: NORMAL.reconstruct(ONE),
    ),
    Remedy(
        "which does not take ",
        lambda: SKIN.reconstruct(PRESS, components=["x"], friction=0.5),
        lambda: SKIN.reconstruct(PRESS, components=["x"]),
    ),
    Remedy(
        "give the parameter or the rule that chooses it, not both",
        lambda: pp.Tikhonov(parameter=1e-4, rule="gcv"),
        lambda: pp.Tikhonov(rule="gcv"),
    ),
    Remedy(
        'so it needs the pressure: seek component z as well, or use method="tikhonov"',
        lambda: SKIN.reconstruct(PRESS, components=["x"], method="adaptive"),
        lambda: SKIN.reconstruct(PRESS, components=["x"], method="tikhonov"),
    ),
    Remedy(
        "or seek fewer components",
        lambda: NORMAL.reconstruct(ONE, components=["x", "z"], **FAST),
        lambda: NORMAL.reconstruct(ONE, components=["z"], **FAST),
    ),
    Remedy(
        "method must be one of ",
        lambda: SKIN.reconstruct(PRESS, method="tikonov"),
        lambda: SKIN.reconstruct(PRESS, method="tikhonov"),
        room="inverse.registry",
    ),
    Remedy(
        "given beside a method with its own options: say ",
        lambda: SKIN.reconstruct(PRESS, method=pp.Tikhonov(), parameter=1e-4),
        lambda: SKIN.reconstruct(PRESS, method=pp.Tikhonov(parameter=1e-4)),
    ),
    Remedy(
        "names the rule already: leave out rule=",
        lambda: SKIN.reconstruct(PRESS, method="tikhonov", parameter="gcv", rule="gcv"),
        lambda: SKIN.reconstruct(PRESS, method="tikhonov", parameter="gcv"),
    ),
    Remedy(
        "mark missing readings as NaN",
        lambda: pp.Recording(readings=np.where(np.isnan(DEAD), np.inf, DEAD)[None], channels=BOTH),
        lambda: pp.Recording(readings=DEAD[None], channels=BOTH),
    ),
    Remedy(
        "a Recording takes its readings without labels",
        lambda: pp.Recording(readings=labelled("channel", "taxel").expand_dims("time"), channels=BOTH),
        lambda: pp.Recording(
            readings=labelled("channel", "taxel").expand_dims("time").transpose("time", "channel", "taxel").values,
            channels=BOTH,
        ),
    ),
    Remedy(
        "channels are named but readings have ",
        lambda: pp.Recording(readings=PRESS[None], channels=["stress_zz"]),
        lambda: pp.Recording(readings=PRESS[None], channels=BOTH),
    ),
    Remedy(
        "no cell of a pitch of ",
        lambda: pp.Recording(readings=np.zeros((1, 1, 12)), channels=["stress_zz"], positions=SCATTERED).gridded(1.0),
        lambda: pp.Recording(readings=np.zeros((1, 1, 12)), channels=["stress_zz"], positions=SCATTERED).gridded(1e-3),
    ),
    Remedy("Leave it out where it is not known", lambda: line(noise=-1.0), line),
    Remedy(
        "rng was given but the array has no noise",
        lambda: SKIN.sense(PUNCH, rng=np.random.default_rng(0)),
        lambda: NOISY.sense(PUNCH, rng=np.random.default_rng(0)),
    ),
    Remedy(
        "average such markers before you pass them",
        lambda: pp.ScatteredArray(positions=[*SCATTERED, SCATTERED[0]], depth=1e-3, channels=["stress_zz"]),
        lambda: pp.ScatteredArray(positions=SCATTERED, depth=1e-3, channels=["stress_zz"]),
    ),
    Remedy("shape must be (rows, columns)", lambda: area(shape=12), lambda: area(shape=(3, 4))),
    Remedy(
        "Name them so, x.rename(",
        lambda: SKIN.reconstruct(labelled("channel", "position"), **FAST),
        lambda: SKIN.reconstruct(labelled("channel", "position").rename(position="x"), **FAST),
    ),
    Remedy(
        "Drop it where the order is already this one",
        lambda: SKIN.reconstruct(labelled("channel", "x", channel=[0, 1]), **FAST),
        lambda: SKIN.reconstruct(labelled("channel", "x", channel=[0, 1]).drop_vars("channel"), **FAST),
    ),
    Remedy(
        "or drop the coordinate where the order is right",
        lambda: SKIN.reconstruct(labelled("channel", "x", x=1e3 * ROWS), **FAST),
        lambda: SKIN.reconstruct(labelled("channel", "x", x=("x", 1e3 * ROWS, {"units": "mm"})), **FAST),
    ),
    Remedy(
        "Take what is needed, x.sel(",
        lambda: NORMAL.reconstruct(labelled("channel", "x", channel=BOTH), **FAST),
        lambda: NORMAL.reconstruct(labelled("channel", "x", channel=BOTH).sel(channel=["stress_zz"]), **FAST),
    ),
    Remedy(
        "and the surface to be the array's own grid. Leave surface out",
        lambda: pp.Skin(PAD, line(), surface=pp.LineGrid(count=7, spacing=1e-3), boundary="periodic").reconstruct(
            PRESS
        ),
        lambda: pp.Skin(PAD, line(), boundary="periodic").reconstruct(PRESS, **FAST),
    ),
    Remedy(
        "Leave dead taxels out: array.masked(working)",
        lambda: SKIN.reconstruct(DEAD, **FAST),
        lambda: pp.Skin(PAD, line().masked(WORKING)).reconstruct(DEAD, **FAST),
    ),
    Remedy(
        "give time=..., the time of each frame in seconds",
        lambda: CREEPING.sense(TRACTION[None]),
        lambda: CREEPING.sense(TRACTION[None], time=[0.0]),
    ),
    Remedy(
        "A Tracker takes one frame at a time",
        lambda: SKIN.track().step(np.stack([PRESS, PRESS])),
        lambda: SKIN.track().step(np.stack([PRESS, PRESS])[0]),
    ),
    Remedy(
        "readings must have shape (*batch, channel, *array) = (..., ",
        lambda: SKIN.reconstruct(PRESS.T, **FAST),
        lambda: SKIN.reconstruct(PRESS.T.T, **FAST),
    ),
    Remedy(
        "use sample()",
        lambda: SKIN.sense(np.where(TRACTION > 0, np.inf, 0.0)),
        lambda: SKIN.sense(SKIN.sample(pp.solutions.flat_punch_line(half_width=2e-3, force=10.0))),
    ),
    Remedy(
        "thickness belongs to BondedLayers",
        lambda: pp.Skin(PAD, line(), uncertainty=pp.Uncertainty(thickness=0.1)),
        lambda: pp.Skin(GEL, line(), uncertainty=pp.Uncertainty(thickness=0.1)),
    ),
    Remedy("(0.1 for ten per cent)", lambda: pp.Uncertainty(depth=10), lambda: pp.Uncertainty(depth=0.1)),
    Remedy(
        "drag within 0 and 1",
        lambda: simulation.Stage("drag", 1.0, 1.0, drag=2.0),
        lambda: simulation.Stage("drag", 1.0, 1.0, drag=1.0),
    ),
    Remedy(
        "the planes mix line and area contact; use one kind",
        lambda: pp.Skin(PAD, [line(), area()]),
        lambda: pp.Skin(PAD, [line(), line(depth=2e-3)]),
    ),
    Remedy(
        "Use a small contact, such as strip() or patch()",
        lambda: pp.Skin(GEL, line(depth=0.0)).sense(pp.solutions.line_load(force=1.0)),
        lambda: pp.Skin(GEL, line(depth=0.0)).sense(pp.solutions.strip(half_width=1e-5, traction=1e5)),
    ),
    Remedy("a line contact needs a skin in line contact", lambda: AREA.sense(PUNCH), lambda: SKIN.sense(PUNCH)),
    Remedy(
        "does not take rng: it draws no samples",
        lambda: SKIN.reconstruct(PRESS, rng=np.random.default_rng(0), **FAST),
        lambda: SKIN.reconstruct(PRESS, **FAST),
    ),
    Remedy(
        "components names one twice",
        lambda: SKIN.reconstruct(PRESS, components=["z", "z"], **FAST),
        lambda: SKIN.reconstruct(PRESS, components=["z"], **FAST),
    ),
    Remedy(
        "in sense() only where the pad creeps",
        lambda: SKIN.sense(TRACTION[None], time=[0.0]),
        lambda: SKIN.sense(TRACTION[None]),
    ),
    Remedy(
        "Use sliding(friction), or a smaller tangential force",
        lambda: PUNCH.partial_slip(0.5, 30.0),
        lambda: PUNCH.sliding(0.5),
    ),
    Remedy(
        "Use Skin(pad, array).sense(contact)",
        lambda: PUNCH.fields(GEL, ["stress_zz"], ROWS, 1e-3),
        lambda: pp.Skin(GEL, line()).sense(PUNCH),
    ),
    Remedy(
        "use averages(edges) or fields()",
        lambda: pp.solutions.line_load(force=1.0).traction(ROWS),
        lambda: pp.solutions.line_load(force=1.0).averages(ROWS),
    ),
    Remedy(
        "or leave the method out",
        lambda: SKIN.reconstruct(PRESS, method="linear").interval(0.95, "force"),
        lambda: SKIN.reconstruct(PRESS).interval(0.95, "force"),
    ),
    Remedy("level must lie between 0 and 1", lambda: TOUCH.interval(95), lambda: TOUCH.interval(0.95)),
    Remedy(
        "was not sought: only ",
        lambda: SKIN.reconstruct(PRESS, components=["x"], **FAST).pressure,
        lambda: SKIN.reconstruct(PRESS, components=["x", "z"], **FAST).pressure,
    ),
    Remedy("is not among the ", lambda: BATCH.frame(2), lambda: BATCH.frame(1), room="touch.result"),
    Remedy("there are no frames yet: add one first", lambda: Forces().table(), lambda: add(Forces(), TOUCH).table()),
    Remedy(
        "must be a number and a unit such as ",
        lambda: parse_quantity("2", "length", "depth"),
        lambda: parse_quantity("2 mm", "length", "depth"),
    ),
]


def add(forces: Forces, touch: pp.Touch) -> Forces:
    forces.add(touch)
    return forces


def lay() -> None:
    """A whole recording, one under a wrong name, and a folder with the name of a file."""
    write_recording(WHOLE, "there.nc")
    Path("folder.nc").mkdir()
    Path("wrong.csv").write_bytes(Path("there.nc").read_bytes())


WHOLE = pp.Recording(readings=PRESS[None], channels=BOTH)
REMEDIES += [
    Remedy(
        "does not exist; make it first",
        lambda: write_recording(WHOLE, "new/r.nc"),
        lambda: (Path("new").mkdir(), write_recording(WHOLE, "new/r.nc")),
        room="recordings.files",
    ),
    Remedy(
        "is a folder; give a file name",
        lambda: write_recording(WHOLE, "folder.nc"),
        lambda: write_recording(WHOLE, "named.nc"),
        room="recordings.files",
        given=lay,
    ),
    Remedy(
        ": the ending ",
        lambda: write_recording(WHOLE, "r.xls"),
        lambda: write_recording(WHOLE, "r.csv"),
        room="recordings.formats",
    ),
    Remedy(
        ": cannot be read as {}; {}.",
        lambda: read_recording("wrong.csv"),
        lambda: read_recording(Path("wrong.csv").rename("right.nc")),
        given=lay,
        right=lambda read: bool(np.array_equal(read.readings, WHOLE.readings)),
    ),
]
