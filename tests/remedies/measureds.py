"""Pads that are known by a table of presses, and what the sides of a gel do."""

from __future__ import annotations

import csv
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.edges import solid_lines
from palpate.measured import Table
from remedies._remedy import Remedy, laid, palpate, value

__all__ = ["REMEDIES"]

ARRAY: dict[str, Any] = {"shape": (3, 3), "pitch": 2e-3, "depth": 2e-3, "channels": ["stress_zz"]}
LINE = np.linspace(-2e-3, 2e-3, 4)
PLACES = np.array([(x, y) for y in LINE for x in LINE])


@lru_cache
def readings() -> Any:
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), pp.AreaArray(**ARRAY))
    ball = pp.solutions.hertz_point(contact_radius=1e-3, force=1.0)
    return np.stack([skin.sense(ball.shifted(*p)) for p in PLACES])


def pad(**changed: Any) -> pp.Measured:
    given = {"places": PLACES, "force": np.ones(16), "readings": readings(), "radius": 1e-3}
    return pp.Measured.of(changed.pop("array", pp.AreaArray(**ARRAY)), **(given | changed))


@lru_cache
def whole() -> pp.Measured:
    return pad()


def table(**changed: Any) -> pp.Measured:
    given = {
        "places": PLACES, "force": np.ones(16), "readings": readings().reshape(16, 1, 9), "radius": 1e-3,
        "positions": pp.AreaArray(**ARRAY).points[:, ::-1], "channels": ["stress_zz"],
    }  # fmt: skip
    return pp.Measured(Table(**(given | changed)))


def skin(**changed: Any) -> pp.Skin:
    array = changed.pop("array", None) or whole().array
    found = pp.Skin(whole(), array, **changed)
    found.prepare()
    return found


def other(**changed: Any) -> pp.AreaArray:
    return pp.AreaArray(**(ARRAY | changed))


def spoilt(where: Any) -> Any:
    out = readings().copy()
    out[where] = np.nan
    return out


def dead(masked: bool) -> Any:
    found = pad(readings=spoilt((slice(None), 0, 1, 1)))
    made = pp.Skin(found, found.array if masked else pp.AreaArray(**ARRAY))
    made.prepare()
    return made


def written(
    name: str = "r.csv", *, x: str = "press_x [m]", drop: int = 0, channel: str = "stress_zz [Pa]", lines: bool = True
) -> None:
    points = pp.AreaArray(**ARRAY).points
    rows = [
        [*p, 1.0, tx, ty, v] for p, frame in zip(PLACES, readings().reshape(16, 9)) for (ty, tx), v in zip(points, frame)
    ]  # fmt: skip
    with Path(name).open("w", newline="") as file:
        titles = [x, "press_y [m]", "force_z [N]", "taxel_x [m]", "taxel_y [m]", channel]
        csv.writer(file).writerows([titles, *(rows[: len(rows) - drop] if lines else [])])


def spoilt_cell(cell: str) -> None:
    written()
    held = Path("r.csv").read_text().splitlines()
    held[1] = ",".join([cell, *held[1].split(",")[1:]])
    Path("r.csv").write_text("\n".join(held))


def file(given: Any, **changed: Any) -> Any:
    given()
    found = pp.Measured("r.csv", **({"radius": 1e-3} | changed))
    return found.table


LAYER = """[pad]
kind = "bonded_layers"
[[pad.layer]]
thickness = "2 mm"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48
[[plane]]
kind = "area"
shape = [3, 3]
pitch = "2 mm"
depth = "base"
channels = ["stress_zz"]
"""
HALF_SPACE = LAYER.replace('"bonded_layers"\n[[pad.layer]]\nthickness = "2 mm"', '"half_space"').replace(
    '"base"', '"1 mm"'
)


def told(text: str, *options: str) -> Any:
    laid(skin_toml=text)
    if not Path("r.nc").exists():
        whole().save("r.nc")
    return palpate("pad", "skin.toml", "--force", *options)


MEASURED = '[pad]\nkind = "measured"\nfile = "r.nc"\n'
SIZE = ("--size", "20 mm x 20 mm")

REMEDIES = [
    value("{} reach to {} m. Lengths are in metres", lambda p: pad(places=p, array=other(center=(4e-3, 4e-3))), 1e3 * (PLACES + 4e-3), PLACES + 4e-3),
    value("{} must be a finite array (n, 2) of (x, y) [m]; got shape", lambda p: pad(places=p), PLACES[0], PLACES),
    value("the presses reach over {} m about", lambda p: pad(places=p), PLACES + 0.1, PLACES),
    value("radius = {} m is more than half of the", lambda r: pad(radius=r), 1.0, 1e-3),
    value("radius must be one length or one for each of {} presses", lambda r: pad(radius=r), -1e-3, 1e-3),
    value("indenter must be {}; got", lambda i: pad(indenter=i), "cone", "punch"),
    value("{} places, {} channels and {} taxels need force", lambda f: pad(force=f), np.ones(15), np.ones(16)),
    value("{} must be numbers; got", lambda f: pad(force=f), ["one"] * 16, np.ones(16)),
    value("{} presses have a force that is not finite", lambda f: pad(force=f), np.r_[np.nan, np.ones(15)], np.ones(16)),
    value("no press has a force. Give what pressed", lambda f: pad(force=f), np.zeros(16), np.ones(16)),
    value("{} presses have a normal force below zero", lambda f: pad(force=f), -np.ones(16), np.ones(16)),
    value("no press has a normal force: a response", lambda z: pad(force=np.tile([1.0, 0.0, z], (16, 1))), 0.0, 1.0),
    value("{} readings are not finite, the first at press", lambda w: pad(readings=spoilt(w)), (3, 0, 1, 1), (slice(None), 0, 1, 1)),
    value("no reading changes with the presses", lambda r: pad(readings=r), np.zeros((16, 1, 3, 3)), readings()),
    Remedy(
        "the table has presses at {} places, and at least",
        lambda: pad(places=PLACES[:8], force=np.ones(8), readings=readings()[:8]),
        pad,
    ),
    Remedy(
        "the table has {} presses, and at most",
        lambda: pad(places=np.tile(PLACES, (200, 1)), force=np.ones(3200), readings=np.tile(readings(), (200, 1, 1, 1))),
        pad,
    ),
    value("readings must have the shape (press,", lambda r: pad(readings=r), readings()[:, :, 0], readings()),
    value("a measured pad is touched on an area; got", lambda a: pad(array=a), pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_zz"]), other()),
    value(
        "a measured pad needs taxels spread over an area, and a", lambda a: skin(array=a), pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_zz"]), None
    ),
    value("the surface of a measured pad is an AreaGrid", lambda g: whole().response(whole().array, g), pp.LineGrid(count=5, spacing=1e-3), pp.AreaGrid(shape=(4, 4), spacing=1e-3)),
    value("{} was not measured; the table has", lambda a: skin(array=a), other(channels=["stress_xz", "stress_zz"]), other()),
    value("{} of {} taxels are not in the table", lambda a: skin(array=a), other(pitch=2.5e-3), other()),
    value("{} taxels are dead in the table", dead, False, True),
    value("Measured takes a file or a palpate.measured.Table", lambda t: t(), lambda: pp.Measured(readings()), pad),
    Remedy("radius and indenter belong to the Table", lambda: pp.Measured(whole().table, radius=1e-3), lambda: pp.Measured(whole().table)),
    Remedy("the table does not determine its response", lambda: pad(readings=np.random.default_rng(0).standard_normal((16, 1, 3, 3))).fit, lambda: pad().fit),
    Remedy(
        "the traction has a component {}, and the table of this pad",
        lambda: skin().sense(pp.solutions.hertz_point(contact_radius=1e-3, force=1.0).sliding(0.3)),
        lambda: skin().sense(pp.solutions.hertz_point(contact_radius=1e-3, force=1.0)),
    ),
    Remedy(
        "the response of this pad was measured for {}, and never for",
        lambda: skin().reconstruct(readings()[5], components=["x"]),
        lambda: skin().reconstruct(readings()[5], components=["z"]),
    ),
    value("uncertainty: {} does not enter a", lambda u: skin(uncertainty=u), pp.Uncertainty(youngs_modulus=0.1), pp.Uncertainty(scale=0.1)),
    Remedy(
        "{} needs an elastic model of the pad, and a",
        lambda: skin().observability([2e-3]),
        lambda: pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), pp.AreaArray(**ARRAY)).observability([2e-3]),
    ),
    # files
    Remedy("there is no such file. Give a table of presses", lambda: pp.Measured("none.nc"), lambda: file(written)),
    Remedy("a table of presses is a .nc or a .csv", lambda: (written("r.xlsx"), pp.Measured("r.xlsx")), lambda: file(written)),
    value("has no contact_radius. Give the radius of the disc", lambda r: file(written, radius=r), None, 1e-3),
    value("has no unit. Name it {} [{}]", lambda x: file(lambda: written(x=x)), "press_x", "press_x [m]"),
    value("has the unit {}; accepted for a", lambda x: file(lambda: written(x=x)), "press_x [inch]", "press_x [m]", room="measured.files"),
    value("has no column {}; it has", lambda c: file(lambda: written(channel=c)), "counts", "stress_zz"),
    value("presses do not have one line for each of {} taxels", lambda n: file(lambda: written(drop=n)), 1, 0),
    value("after the title is no row of numbers", lambda c: file(lambda: spoilt_cell(c)), "a", "-0.002"),
    value("places and forces must be numbers in every line", lambda c: file(lambda: spoilt_cell(c)), "", "-0.002"),
    value("has no lines below its title", lambda n: file(lambda: written(lines=n)), False, True),
    Remedy("cannot be read as NetCDF ({})", lambda: (Path("r.nc").write_text("none"), pp.Measured("r.nc")), lambda: (Path("r.nc").unlink(missing_ok=True), whole().save("r.nc"), pp.Measured("r.nc"))),
    Remedy("exists, and may hold what was measured; give another name", lambda: (whole().save("a.nc"), whole().save("a.nc")), lambda: whole().save("b.nc"), room="measured.pad"),
    # sides
    value("a box is made of one layer on a rigid base", lambda p: solid_lines(p, None), pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=2e5, poissons_ratio=0.48)])),
    Remedy("--size is for a computed layer; the table of a measured pad", lambda: told(MEASURED, *SIZE), lambda: told(MEASURED)),
    Remedy("--size is for one layer on a rigid base", lambda: told(HALF_SPACE, *SIZE), lambda: told(LAYER, *SIZE)),
    value("--size must be length and width such as", lambda s: told(LAYER, "--size", s), "20 mm", "20 mm x 20 mm"),
    value("--size must be two lengths above 0", lambda s: told(LAYER, "--size", s), "0 mm x 2 mm", "2 mm x 2 mm"),
]  # fmt: skip
