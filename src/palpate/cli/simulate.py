"""palpate simulate: make a recording of a known contact."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.files import Overwrite, check_output, command_line, skin_files, skin_text, written
from palpate.cli.progress import busy
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from palpate.skin import Skin


class Contact(StrEnum):
    """Contacts that palpate simulate can make."""

    hertz = "hertz"
    punch = "punch"
    patch = "patch"


def simulate(
    skin_file: Annotated[Path, typer.Option("--skin", help="skin.toml with the pad and its array.")],
    out: Annotated[Path, typer.Option(help="Recording to write (.nc, .h5, .npz or .csv).")],
    contact: Annotated[Contact, typer.Option(help="Kind of contact.")] = Contact.hertz,
    force: Annotated[str, typer.Option(help='Normal force, e.g. "1 N" (area) or "200 N/m" (line).')] = "1 N",
    size: Annotated[str, typer.Option(help="Contact radius or half-width.")] = "4 mm",
    x: Annotated[str, typer.Option(help="Middle of the contact along x.")] = "0 mm",
    y: Annotated[str, typer.Option(help="Middle of the contact along y (area only).")] = "0 mm",
    friction: Annotated[float, typer.Option(help="Coefficient of friction; 0 is frictionless.")] = 0.0,
    drag: Annotated[float, typer.Option(help="Tangential force as a fraction of friction * force; 1 slides.")] = 1.0,
    direction: Annotated[float, typer.Option(help="Direction of the drag [degrees from +x] (area only).")] = 0.0,
    frames: Annotated[int, typer.Option(help="Frames; the force grows evenly over them.")] = 1,
    rate: Annotated[float, typer.Option(help="Frames per second.")] = 100.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise; without noise in the skin none is added.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Make a recording of a known contact on a skin."""
    import numpy as np

    from palpate._memory import require
    from palpate.elastic import Viscoelastic
    from palpate.recordings import Recording, write_recording
    from palpate.recordings.formats import file_format
    from palpate.sensing.contacts import contact_readings
    from palpate.sensing.readings import as_sensed, with_creep
    from palpate.skin import Skin

    file_format(out, task="write")
    check_output(out, inputs=skin_files(skin_file), force=overwrite, option="--overwrite")
    skin = Skin.from_file(skin_file)
    if len({p.shape for p in skin.planes}) != 1:
        raise InvalidInput("simulate writes one recording: the skin's planes must have one shape.")
    if frames < 1 or not 0 < rate < 1e9:
        raise InvalidInput(f"frames must be at least 1 and rate positive; got {frames} and {rate:g}.")
    values = sum(len(p.channels) * p.points.shape[0] for p in skin.planes)
    # the frames one by one, stacked, and as they are written
    require(
        32.0 * frames * values,
        f"{frames:,} frames of {values:,} readings",
        "Give fewer --frames, or make several recordings.",
    )
    body = _contact(skin, contact, force, size, x, y, friction, drag, direction)
    noisy = all(p.noise_std is not None for p in skin.planes)
    if not noisy and any(p.noise_std is not None for p in skin.planes):
        raise InvalidInput(
            f"{skin_file}: some planes name their noise and others do not; name it for all, or for none."
        )
    rng = np.random.default_rng(seed) if noisy else None
    scale = (np.arange(frames) + 1.0) / frames
    times = np.arange(frames) / rate
    with busy("simulating"):
        # readings are proportional to the force
        parts = [np.multiply.outer(scale, part) for part in contact_readings(skin.operator, body)]
    if isinstance(skin.pad, Viscoelastic):
        parts = with_creep(parts, skin.planes, skin.pad.prony, times, "add")
    readings = np.asarray(as_sensed(parts, skin.planes, rng))
    if readings.ndim == 3 and skin.surface.dimensions == 2:
        positions: Any = skin.planes[0].points[:, ::-1]
    else:
        positions = skin.planes[0].points[:, 0] if skin.surface.dimensions == 1 else None
    meta = {
        "made by": command_line(),
        "skin": skin_text(skin_file),
        "force": ", ".join(repr(float(f)) for f in body.force),
    }
    channels = tuple(c for p in skin.planes for c in p.channels)
    recording = Recording(readings=readings, channels=channels, time=times, positions=positions, meta=meta)
    written(out, lambda name: write_recording(recording, name))
    typer.echo(
        f"wrote {out}: {frames} frame{'s' if frames > 1 else ''} of {', '.join(channels)}, {'x'.join(map(str, readings.shape[2:]))} taxels"
    )


def _contact(
    skin: Skin, kind: Contact, force: str, size: str, x: str, y: str, friction: float, drag: float, direction: float
) -> Any:
    import math

    from palpate import solutions
    from palpate.units import parse_quantity

    line = skin.surface.dimensions == 1
    load = parse_quantity(force, "force per length" if line else "force", "force")
    a = parse_quantity(size, "length", "size")
    place = parse_quantity(x, "length", "x")
    if not (math.isfinite(drag) and 0 <= drag <= 1 and math.isfinite(friction) and friction >= 0):
        raise InvalidInput(
            f"friction must not be negative and drag must lie between 0 and 1; got {friction:g} and {drag:g}."
        )
    if friction == 0 and drag != 1:
        raise InvalidInput(f"--drag {drag:g} is a part of friction * force: give --friction too.")
    if friction * drag == 0 and direction:
        raise InvalidInput(
            f"--direction {direction:g} is the direction of a drag: give --friction, and a --drag above 0."
        )
    if load <= 0 or a <= 0:
        raise InvalidInput(f"force and size must be positive; got {force} and {size}.")
    if line:
        if parse_quantity(y, "length", "y") != 0 or direction:
            raise InvalidInput("y and direction have no meaning on a line.")
        body: Any = {
            "hertz": lambda: solutions.hertz_line(half_width=a, force=load),
            "punch": lambda: solutions.flat_punch_line(half_width=a, force=load),
            "patch": lambda: solutions.strip(half_width=a, traction=load / (2 * a)),
        }[kind.value]()
        body = body.shifted(place)
        turn: dict[str, float] = {}
    else:
        body = {
            "hertz": lambda: solutions.hertz_point(contact_radius=a, force=load),
            "punch": lambda: solutions.flat_punch(radius=a, force=load),
            "patch": lambda: solutions.patch(half_widths=(a, a), traction=load / (4 * a * a)),
        }[kind.value]()
        body = body.shifted(place, parse_quantity(y, "length", "y"))
        turn = {"direction": math.radians(direction)}
    if friction == 0 or drag == 0:
        return body
    if drag == 1:
        return body.sliding(friction, **turn)
    if kind is not Contact.hertz:
        raise InvalidInput("a drag below 1 (partial slip) is known in closed form for --contact hertz only.")
    return body.partial_slip(friction, drag * friction * load, **turn)
