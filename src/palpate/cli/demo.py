"""palpate demo: write and run a complete example that needs no other file."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.files import Force, make_folder, provenance, save_figure, write_text
from palpate.errors import InvalidInput

#: File of checksums of the demo's files. The next run may replace files that still have these checksums.
SUMS = ".palpate-demo.sha256"

_DEMO_SKIN = """\
# A soft pad with a 32 x 32 array of three-axis stress taxels, as written by palpate demo.
[pad]
kind = "half_space"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [32, 32]
pitch = "1 mm"
depth = "2 mm"
channels = ["stress_xz", "stress_yz", "stress_zz"]
aperture = "0.8 mm"
noise = "50 Pa"

[uncertainty]                    # this sensor is simulated, and so known exactly; by default 2 %, 15 %, 10 %
scale = "0 %"
youngs_modulus = "0 %"
depth = "0 %"
"""


class Story(StrEnum):
    """The examples that the demo can show."""

    sensor = "sensor"
    camera = "camera"
    taxels = "taxels"
    markers = "markers"
    field = "field"
    cells = "cells"


def demo(
    story: Annotated[
        Story,
        typer.Argument(
            help="sensor: stress taxels in a pad. camera: a video of a gel with dots (needs palpate[camera]). taxels, markers, field: "
            'the files of the page "The first hour" (raw counts, a table of markers, u.npy and v.npy). cells: pictures of beads below two cells, a film, labels and a PIVlab series '
            "(needs palpate[cells])."
        ),
    ] = Story.sensor,
    out: Annotated[Path, typer.Option(help="Folder for the picture, the skin, the recording and the result.")] = Path(
        "palpate-demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    force: Force = False,
) -> None:
    """Press and drag a ball on a simulated sensor, or film it, and recover what touched it; or write files to begin with. Needs no other file."""
    import numpy as np

    from palpate import solutions
    from palpate.recordings import Recording, write_recording, write_touch
    from palpate.skin import Skin
    from palpate.touch import Touch

    folder = make_folder(out)
    if story is Story.camera:
        from palpate.cli.democamera import FILES, demo_camera

        _check_unedited(folder, force, FILES)
        demo_camera(folder, seed, lambda name: _store_checksums(folder, name))
        return
    if story is Story.cells:
        from palpate.cli import democells

        _check_unedited(folder, force, democells.FILES)
        democells.demo_cells(folder, seed, lambda name: _store_checksums(folder, name))
        return
    if story is not Story.sensor:
        from palpate.cli import demofiles

        _check_unedited(folder, force, demofiles.FILES[story])
        getattr(demofiles, f"demo_{story}")(folder, seed, lambda name: _store_checksums(folder, name))
        return
    skin_path = folder / "skin.toml"
    _check_unedited(folder, force, ("skin.toml", "recording.nc", "touch.nc", "touch.png"))
    write_text(skin_path, _DEMO_SKIN)
    _store_checksums(folder, "skin.toml")
    skin = Skin.from_file(skin_path)
    friction = 0.6
    ball = solutions.hertz_point(contact_radius=5e-3, force=1.0).shifted(2e-3, -1e-3)
    contact = ball.sliding(0.35, direction=0.5)
    truth = skin.sample(contact)
    readings = skin.sense(truth, rng=np.random.default_rng(seed))
    names = skin.planes[0].channels
    recording = Recording(
        readings=readings[None], channels=tuple(names), meta={"made by": f"palpate demo --seed {seed}"}
    )
    write_recording(recording, folder / "recording.nc")
    _store_checksums(folder, "recording.nc")
    touch = skin.reconstruct(readings, friction=friction)
    write_touch(touch, folder / "touch.nc", provenance=provenance(_DEMO_SKIN))
    _store_checksums(folder, "touch.nc")
    figure = touch.plot(
        truth=truth, title="A ball pressed and dragged: recovered from noisy stress 2 mm below the surface"
    )
    save_figure(figure, folder / "touch.png")
    _store_checksums(folder, "touch.png")
    known = Touch(truth, skin.surface, skin.surface.components, "known")
    typer.echo("A ball presses with 1 N and drags with 0.35 N; 3 x 1024 readings, 2 mm below the surface, noise 50 Pa.")
    for name, one in (("recovered", touch), ("true", known)):
        typer.echo(f"{name}:")
        typer.echo("\n".join(f"  {line}" for line in one.summary(friction=friction).splitlines()))
    typer.echo(f"picture         {folder / 'touch.png'}")
    typer.echo(f"try next        palpate reconstruct {folder / 'recording.nc'} --skin {skin_path}")


def _check_unedited(folder: Path, force: bool, names: tuple[str, ...]) -> None:
    """Raise an error if files exist that no earlier run wrote, or that were edited since."""
    sums = _sums(folder)
    for name in names:
        path = folder / name
        if path.is_dir():
            raise InvalidInput(f"{path} is a folder; give another one with --out.")
        if os.path.lexists(path) and _sum(path) != sums.get(name) and not force:
            raise InvalidInput(
                f"{path} was changed since palpate demo wrote it, or was not written by it. It is kept: give another folder with --out, or --force "
                "to replace it."
            )


def _store_checksums(folder: Path, name: str) -> None:
    """Store checksums of the files, in the format of sha256sum -c."""
    sums = {**_sums(folder), name: _sum(folder / name)}
    write_text(folder / SUMS, "".join(f"{value}  {key}\n" for key, value in sums.items()))


def _sums(folder: Path) -> dict[str, str]:
    try:
        lines = (folder / SUMS).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return {}
    return {name: value for value, _, name in (line.partition("  ") for line in lines)}


def _sum(path: Path) -> str:
    import hashlib

    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:  # a link to nowhere
        return ""
