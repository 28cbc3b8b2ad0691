"""Designs: presses, sweeps, goals, placements, design files; what a refusal says that they must be."""

from __future__ import annotations

from typing import Any

import numpy as np

import palpate as pp
from palpate.design import place, read_design, sweep
from remedies._remedy import Remedy, command, laid, value
from skin_files import skin_text

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])


def area(**changed: Any) -> pp.AreaArray:
    given: dict[str, Any] = {"shape": (6, 6), "pitch": 2e-3, "depth": 2e-3, "channels": ["stress_zz"], "noise": 100.0}
    return pp.AreaArray(**(given | changed))


SKIN = pp.Skin(PAD, area())
LINE = pp.Skin(PAD, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=100.0))
SPREAD = pp.Skin(
    PAD, pp.ScatteredArray(positions=area().points[:, ::-1], depth=2e-3, channels=["stress_zz"], noise=100.0)
)
TWO = pp.Skin(GEL, [area(), area(depth=3e-3)])
EACH = pp.Skin(PAD, area(channels=["stress_xz", "stress_zz"], noise=[100.0, 50.0]))
MIXED = pp.Skin(PAD, area(channels=["stress_zz", "displacement_z"], noise=[100.0, 1e-6]))
LIMITS = pp.Skin(PAD, area(channels=["stress_xz", "stress_zz"], limits=[(-1e4, 1e4), (0.0, 3e4)]))
FILE = skin_text(6, 6, pitch="2 mm", depth="2 mm", noise="100 Pa") + "\n"


def file(end: str) -> Any:
    laid(design_toml=FILE + end)
    return read_design("design.toml")


def two_files() -> None:
    """A design, one that is pressed otherwise, and one that is pressed alike."""
    laid(design_toml=FILE, other_toml=FILE + '[press]\nforce = "2 N"\n', alike_toml=FILE.replace("[6, 6]", "[5, 5]"))


REMEDIES = [
    value(
        "{} must be a positive number{}; got {}. Write press {}= such as {}", lambda v: SKIN.design(force=v), -1.0, 1.0
    ),
    value("shear must be at least 0 and below friction", lambda v: SKIN.design(shear=v), 0.9, 0.3),
    value(
        "center must be (x, y) in metres; got",
        lambda v: SKIN.design(center=v),
        (1.0,),
        (1e-3, 0.0),
        room="design.press",
    ),
    value("lies far beside the array, whose middle is at", lambda v: SKIN.design(center=v), (2.0, 0.0), (2e-3, 0.0)),
    value("a design needs the noise of", lambda v: pp.Skin(PAD, area(noise=v)).design(), None, 50.0),
    value("are too many for a design (at most", lambda n: pp.Skin(PAD, area(shape=(n, n))).design(), 150, 10),
    value("component must be one of", lambda v: SKIN.design().width(v), "x", "z"),
    value("a sweep cannot vary", lambda v: sweep(SKIN, **{v: [1e-3]}), "depths", "depth"),
    value("must be a list of values to try", lambda v: sweep(SKIN, depth=v), 1e-3, [1e-3]),
    value("combinations (at most", lambda n: sweep(SKIN, depth=[1e-3] * n), 30_000, 1),
    value("keep must be", lambda v: sweep(SKIN, keep=v, pitch=[1e-3]), "all", "area", room="design.sweep"),
    value(
        "changes the shape with the pitch, and the sweep varies the shape too",
        lambda v: sweep(SKIN, keep=v, pitch=[1e-3], shape=[SKIN.planes[0].shape]),
        "area",
        "taxels",
    ),
    value("jobs must be a whole number of processes", lambda v: sweep(SKIN, jobs=v, depth=[1e-3]), 0, 1),
    value("a goal cannot be", lambda v: sweep(SKIN, goals={v: 1e-3}, depth=[1e-3]), "beauty", "pair"),
    value("must be a positive number in SI units", lambda v: sweep(SKIN, goals={"pair": v}, depth=[1e-3]), -1.0, 1e-3),
    value("no combination of the sweep can be built", lambda v: sweep(pp.Skin(GEL, area()), depth=[v]), 5e-3, 3e-3),
    value(
        "is not a number of a design; accepted: score", lambda v: sweep(SKIN, depth=[1e-3]).numbers(v), "beauty", "pair"
    ),
    value("is not an axis of numbers of this sweep", lambda v: sweep(SKIN, depth=[1e-3]).plot(v), "pitch", "depth"),
    value(
        "is not a number of a design; accepted: {}.",
        lambda v: sweep(SKIN, depth=[1e-3]).plot(columns=[v]),
        "x",
        "pair",
        room="design.figures",
    ),
    value(
        "planes, and a sweep varies the array of one",
        lambda v: sweep(TWO, **v),
        {"depth": [1e-3]},
        {"youngs_modulus": [1e5]},
    ),
    value(
        "thickness belongs to bonded layers, and this pad is",
        lambda p: sweep(pp.Skin(p, area()), thickness=[3e-3]),
        PAD,
        GEL,
    ),
    value("shape belongs to a line or area array", lambda s: sweep(s, shape=[(5, 5)]), SPREAD, SKIN),
    value("pitch belongs to a line or area array", lambda s: sweep(s, pitch=[1e-3]), SPREAD, SKIN),
    value(
        "they have other units. Write one file for each",
        lambda v: sweep(SKIN, channels=[v]),
        ["displacement_z"],
        ["stress_xz", "stress_zz"],
    ),
    value(
        "is not given: the array says one for each of",
        lambda v: sweep(EACH, channels=[v]),
        ["stress_yz"],
        ["stress_zz"],
    ),
    value("one noise cannot be that of", lambda v: sweep(MIXED, noise=[v]), 50.0, [50.0, 2e-6]),
    value(
        "limits differ between taxels",
        lambda v: place(pp.Skin(PAD, area(limits=v)), count=9, extent=(9e-3, 9e-3)),
        np.stack([np.zeros((1, 6, 6)), np.linspace(1e4, 3e4, 36).reshape(1, 6, 6)], axis=1),
        (0.0, 1e4),
    ),
    value("limits differ between channels", lambda s: sweep(s, channels=[["stress_zz"]]), LIMITS, SKIN),
    Remedy(
        "the table of designs is a .csv",
        command("design design.toml --out designs.json"),
        command("design design.toml --out designs.csv"),
        given=two_files,
    ),
    Remedy(
        "the files have different presses or goals",
        command("design design.toml other.toml --out designs.csv"),
        command("design design.toml alike.toml --out designs.csv"),
        given=two_files,
    ),
    Remedy(
        "some files describe a line and others an area",
        command("design design.toml other.toml --out designs.csv"),
        command("design design.toml alike.toml --out designs.csv"),
        given=lambda: (
            two_files(),
            laid(other_toml=FILE.replace('kind = "area"', 'kind = "line"').replace("shape = [6, 6]", "count = 6")),
        ),
    ),
    value("placement is for area contact", lambda s: place(s, count=9, extent=(9e-3, 9e-3)), LINE, SKIN),
    value("extent must be (width, height)", lambda v: place(SKIN, count=9, extent=v), (0.0, 1.0), (9e-3, 9e-3)),
    value("count must be a whole number from {} (a press", lambda v: place(SKIN, count=v, extent=(9e-3, 9e-3)), 1, 9),
    value("is not a key of [", file, '[press]\nradius = "2 mm"\n', '[press]\ncontact_radius = "2 mm"\n'),
    value("must be a list of the values to try", file, '[sweep]\ndepth = "1 mm"\n', '[sweep]\ndepth = ["1 mm"]\n'),
    value(
        "channels must be a list of lists such as",
        file,
        '[sweep]\nchannels = ["stress_zz"]\n',
        '[sweep]\nchannels = [["stress_zz"]]\n',
    ),
    value(
        'center must be [x, y] such as ["0 mm", "3 mm"]',
        file,
        '[press]\ncenter = "0 mm"\n',
        '[press]\ncenter = ["0 mm", "3 mm"]\n',
    ),
]
