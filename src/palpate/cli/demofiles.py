"""palpate demo taxels, markers, field: write files of known contacts in the formats of other programs, for the documentation's page "The first hour"."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import typer

from palpate.cli.files import write_text
from palpate.elastic.pad import Floats

__all__ = ["FILES", "demo_field", "demo_markers", "demo_taxels"]

#: The files of each story.
FILES = {
    "taxels": ("skin.toml", "taxels.csv"),
    "markers": ("gel.toml", "markers.csv"),
    "field": ("u.npy", "v.npy"),
}
#: Size of a pixel [m] of markers.csv, and of u.npy and v.npy.
PIXEL, FIELD_PIXEL = 6e-5, 1e-7

_SKIN = """\
[pad]
kind = "bonded_layers"           # a soft pad glued to something stiff

[[pad.layer]]
thickness = "4 mm"
youngs_modulus = "300 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [4, 4]
pitch = "4.5 mm"
depth = "base"                   # taxels under the pad
aperture = "3 mm"
channels = ["stress_xz", "stress_yz", "stress_zz"]

[columns]
time = "timestamp_ms"
time_unit = "ms"
stress_xz = "x{}"                # {} is the number of the taxel
stress_yz = "y{}"
stress_zz = "z{}"
unit = "8 Pa"                    # what one count means: from a known weight, or the data sheet
"""

_GEL = """\
[pad]
kind = "bonded_layers"

[[pad.layer]]
thickness = "3.5 mm +- 3 %"
youngs_modulus = "300 kPa +- 5 %"
poissons_ratio = 0.48

[[plane]]
kind = "scattered"               # the table states the positions of the markers
depth = "0.5 mm +- 10 %"         # below the surface that is touched
channels = ["displacement_x", "displacement_y"]
"""


def demo_taxels(folder: Path, seed: int, own: Callable[[str], None]) -> Floats:
    """Write 300 frames of 48 raw counts: a finger presses, slides, leaves. Return the normal force [N] by frame."""
    from palpate import solutions
    from palpate.skin import Skin

    write_text(folder / "skin.toml", _SKIN)
    own("skin.toml")
    skin = Skin.from_file(folder / "skin.toml")
    rng = np.random.default_rng(seed)
    times = np.arange(300) / 50
    load = np.interp(times, [0.8, 1.6, 4.6, 5.4], [0.0, 2.0, 2.0, 0.0])
    slide = np.interp(times, [1.6, 3.0], [0.0, 0.4])
    ball = solutions.hertz_point(contact_radius=4e-3, force=1.0)
    push = skin.sense(ball)
    drag = skin.sense(ball.sliding(1.0)) - push
    stress = load[:, None, None, None] * (push + slide[:, None, None, None] * drag)  # (frame, channel, y, x)
    raw = stress / 8.0 + 20_000 * rng.random(push.shape) + 10.0 * rng.standard_normal(stress.shape)
    counts = np.moveaxis(raw.reshape(300, 3, 16), 1, 2).reshape(300, 48)
    titles = ["timestamp_ms", *(f"{axis}{taxel}" for taxel in range(1, 17) for axis in "xyz")]
    _table(folder / "taxels.csv", titles, np.column_stack([1000 * times, counts]), "%.0f")
    own("taxels.csv")
    typer.echo(
        "A finger presses with 2 N, slides with 0.8 N along x and leaves; 300 frames of 4 x 4 x 3 raw counts, 50 a second."
    )
    typer.echo(f"skin            {folder / 'skin.toml'}")
    typer.echo(f"counts          {folder / 'taxels.csv'}")
    typer.echo(
        f"try next        palpate track {folder / 'taxels.csv'} --skin {folder / 'skin.toml'} --baseline 30 --friction 0.6 --out forces.csv"
    )
    return load


def demo_markers(folder: Path, seed: int, own: Callable[[str], None]) -> Floats:
    """Write 100 frames of 80 markers in pixels. Return the normal force of each frame [N]."""
    from palpate import solutions
    from palpate.elastic import BondedLayers, Layer
    from palpate.sensing import AreaGrid, ScatteredArray
    from palpate.skin import Skin

    write_text(folder / "gel.toml", _GEL)
    own("gel.toml")
    rng = np.random.default_rng(seed + 1)
    gel = BondedLayers([Layer(thickness=3.5e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    y, x = np.meshgrid(2e-3 * (np.arange(8) - 3.5), 2e-3 * (np.arange(10) - 4.5), indexing="ij")
    places = np.stack([x.ravel(), y.ravel()], axis=-1) + 1e-4 * rng.standard_normal((80, 2))
    skin = Skin(
        gel,
        ScatteredArray(positions=places, depth=0.5e-3, channels=["displacement_x", "displacement_y"]),
        surface=AreaGrid(shape=(20, 24), spacing=1e-3),
    )
    load = np.interp(np.arange(100), [20, 50, 70, 90], [0.0, 2.0, 2.0, 0.0])
    moved = np.reshape(skin.sense(solutions.hertz_point(contact_radius=3e-3, force=1.0).sliding(0.25)), (2, 80))
    pixels = load[:, None, None] * moved / PIXEL + 0.02 * rng.standard_normal((100, 2, 80))
    frame, marker = np.divmod(np.arange(8000), 80)
    rows = np.column_stack([frame, marker, places[marker] / PIXEL, pixels[frame, :, marker]])
    _table(folder / "markers.csv", ["frame", "id", "x", "y", "dx", "dy"], rows, ["%.0f", "%.0f", *["%.4f"] * 4])
    own("markers.csv")
    typer.echo("A ball presses with 2 N, drags with 0.5 N along x and leaves; 100 frames of 80 markers, 30 a second.")
    typer.echo(f"skin            {folder / 'gel.toml'}")
    typer.echo(f"markers         {folder / 'markers.csv'}")
    return load


def demo_field(folder: Path, seed: int, own: Callable[[str], None]) -> float:
    """Write 128 x 128 vectors, in pixels, of a cell that pulls at its ends. Return its strain energy [J]."""
    from palpate.elastic import HalfSpace
    from palpate.sensing import AreaArray, AreaGrid
    from palpate.skin import Skin

    spacing = 8 * FIELD_PIXEL
    vectors = AreaArray(shape=(128, 128), pitch=spacing, depth=0.0, channels=["displacement_x", "displacement_y"])
    skin = Skin(
        HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48),
        vectors,
        surface=AreaGrid(shape=(128, 128), spacing=spacing),
    )
    y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    traction = np.zeros((3, 128, 128))
    for angle in np.radians(np.arange(0, 360, 45)):
        place = 25e-6 * np.array([np.cos(angle), np.sin(angle)])
        near = np.hypot(x - place[0], y - place[1]) < 2.5e-6
        traction[0][near], traction[1][near] = -600.0 * place / 25e-6
    moved = skin.sense(traction)
    energy = 0.5 * float((traction[:2] * moved).sum()) * spacing**2
    seen = moved[:, ::-1] * np.array([1.0, -1.0])[:, None, None] / FIELD_PIXEL  # rows downwards
    seen = seen + 0.1 * np.random.default_rng(seed + 2).standard_normal(seen.shape)
    for name, part in zip(FILES["field"], seen):
        np.save(folder / name, part)
        own(name)
    typer.echo(
        f"A cell pulls at eight places; its strain energy is {1e15 * energy:.1f} fJ. 128 x 128 vectors in pixels, 8 pixels apart."
    )
    typer.echo(f"vectors         {folder / 'u.npy'} {folder / 'v.npy'}")
    return energy


def _table(path: Path, titles: list[str], values: Floats, form: str | list[str]) -> None:
    from palpate.recordings.files import atomically

    atomically(
        path,
        lambda name: np.savetxt(name, values, fmt=form, delimiter=",", header=",".join(titles), comments=""),
    )
