"""Parsers of options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate._numbers import plain_number
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from palpate.grasp import GraspMonitor
    from palpate.skin import Skin


Columns = Annotated[
    str | None,
    typer.Option(
        "--map",
        help="For a table of another program: the meaning of its columns, with the keys of [columns] in a skin.toml, "
        'e.g. "frame=frame,marker=id,x=x,y=y,displacement_x=dx,displacement_y=dy,pixel=0.06mm,rate=30".',
    ),
]


def grasp_monitor(
    skin: Skin, friction: float | None, pressure: str | None, force: str | None, callback: Any = None
) -> GraspMonitor:
    from palpate.grasp import GraspMonitor
    from palpate.units import parse_quantity

    kind = "force per length" if skin.surface.dimensions == 1 else "force"
    return GraspMonitor(
        friction=friction,
        max_pressure=None if pressure is None else parse_quantity(pressure, "pressure", "--max-pressure"),
        max_force=None if force is None else parse_quantity(force, kind, "--max-force"),
        callback=callback,
    )


def check_watched(skin: Skin, pressure: str | None, force: str | None) -> None:
    """Refuse limits that these channels cannot watch, because a limit that is never reached would look like safety."""
    if "z" not in skin.components and not (pressure is None and force is None):
        raise InvalidInput(
            f"--max-pressure and --max-force watch the pressure, but these channels measure only {', '.join(skin.components)}: leave them out."
        )


def numbers(text: str, option: str) -> list[float]:
    try:
        return [float(v) for v in text.split(",")]
    except ValueError as error:
        raise InvalidInput(f"{option} must be one number or several with commas; got {text!r}.") from error


def value_and_std(text: str, kind: str, option: str) -> tuple[float, float]:
    """Parse a quantity and its relative standard deviation (0 if not stated): "8 kPa +- 10 %", "8 kPa +- 0.5 kPa"."""
    import re

    from palpate.units import parse_quantity

    example = {"pressure": "8 kPa +- 10 %", "length": "2 um +- 3 %"}[kind]
    parts = re.split(r"\+-|\+/-|±", text)
    if len(parts) > 2:
        raise InvalidInput(f'{option} {text!r}: write a quantity and one uncertainty, such as "{example}".')
    value = parse_quantity(parts[0].strip(), kind, option)
    if len(parts) == 1:
        return value, 0.0
    if "%" in parts[1]:
        share = numbers(parts[1].replace("%", "").strip(), option)[0] / 100.0
    elif value == 0:
        raise InvalidInput(f"{option} must not be zero; got {text!r}.")
    else:
        share = parse_quantity(parts[1].strip(), kind, option) / value
    return value, share


def rows_and_columns(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        rows, columns = (int(v) for v in text.lower().split("x"))
    except ValueError as error:
        raise InvalidInput(f"--shape must be rows x columns such as 4x6; got {text!r}.") from error
    return rows, columns


def mapping_for(recording: Path, skin_file: Path | None, columns: str | None, *, shape: Any = None) -> Any:
    """Return how to read a recording made by other programs: columns of a table by --map or [columns], messages of a
    robot by [stream]; None for palpate's own formats.
    """
    from palpate.recordings import read_columns, read_stream
    from palpate.recordings.columns import columns_of, columns_of_text
    from palpate.recordings.formats import endings, existing

    table = recording.suffix.lower() in endings("read_mapped")
    if columns is None:
        if skin_file is None:
            return None
        return read_columns(skin_file) if table else read_stream(skin_file)
    found, known = existing(recording)
    if not table:
        raise InvalidInput(
            f"--map names the columns of a table ({', '.join(endings('read_mapped'))}); {recording} is none: leave it out."
        )
    if known.own(found):
        raise InvalidInput(
            f"--map is for tables of other programs; {recording} names its columns itself: leave it out."
        )
    given = columns_of_text(columns)
    try:
        return columns_of(given, shape=shape) if skin_file is None else read_columns(skin_file, given)
    except InvalidInput as error:
        if skin_file is not None and str(error).startswith(str(skin_file)):
            raise  # the message should name the skin's file
        raise InvalidInput(f"--map: {error}") from error


def check_picture(path: Path) -> None:
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InvalidInput(f"{path}: pictures end in .png, .pdf or .svg.")


def check_channels(names: list[str]) -> list[str]:
    from palpate.elastic.channels import check_channels

    return list(check_channels(names, 2))


def zero_of_skin(skin: Skin, baseline: int) -> Any:
    """Return the zero of the skin's calibration if it has one and no ``baseline`` replaces it."""
    found = skin.calibration
    if baseline or found is None or found.zero is None:
        return None
    typer.echo(
        "zero            that of the calibration; all intervals include its scatter. If nothing touches in the first frames, --baseline 10 takes a new one"
    )
    return found.zero


def check_matching(recording: Any, skin: Skin) -> None:
    channels = tuple(c for p in skin.planes for c in p.channels)
    if recording.channels != channels:
        raise InvalidInput(
            f"the recording holds {', '.join(recording.channels)} but the skin describes {', '.join(channels)}: list the same channels in the same order in the skin.toml, or map columns to all of them."
        )
    shapes = {p.shape for p in skin.planes}
    if shapes != {recording.readings.shape[2:]}:
        raise InvalidInput(
            f"the recording has {'x'.join(map(str, recording.readings.shape[2:]))} taxels but the skin describes {' and '.join('x'.join(map(str, s)) for s in shapes)}."
        )
    if recording.positions is not None:
        _check_places(recording.positions, skin)
    for doubt in suspicious_units(skin):
        typer.echo(f"warning: {doubt}", err=True)


#: No elastic pad is wider or stiffer [m, Pa]: a car tyre is 0.3 m across; the hardest rubber has less than 0.1 GPa,
#: epoxy 3 GPa.
WIDEST, STIFFEST = 2.0, 10e9


def suspicious_units(skin: Skin) -> list[str]:
    """Return warnings about sizes that no pad has, which a mistaken unit in a skin.toml causes (m for mm, GPa for
    kPa). The forces would be wrong by the same factor, and nothing else would show it.
    """
    import numpy as np

    from palpate.measured import Measured

    found = []
    width = max(float(np.ptp(plane.points, axis=0).max()) for plane in skin.planes)
    if width > WIDEST:
        found.append(
            f"the taxels of the skin.toml are spread over {plain_number(width, 3)} m: is the unit of pitch, spacing or positions right?"
        )
    # a pad measured by pressing point by point has no modulus
    softness = 0.0 if isinstance(skin.pad, Measured) else float(np.asarray(skin.pad.compliance(0.0))[2, 2])
    if 0.0 < softness < 1.0 / STIFFEST:
        found.append(
            f"the pad of the skin.toml has a modulus of {plain_number(1e-9 / softness, 3)} GPa, as metal has: is the unit of youngs_modulus right?"
        )
    return found


def _check_places(positions: Any, skin: Skin) -> None:
    """Raise an error if the taxels of the recording are not where a positions_file says."""
    import numpy as np

    at = np.asarray(positions).reshape(len(positions), -1)
    told = None if skin.calibration is None else skin.calibration.constants
    for plane in skin.planes:
        places: Any = getattr(plane, "positions", None)
        if places is None or np.ndim(places) != at.ndim or np.shape(places) != at.shape:
            continue
        # positions of a calibrated skin are scaled by the fitted pixel scale
        off = min(
            (np.linalg.norm(f * at - places, axis=1) for f in {1.0, 1.0 if told is None else told.pixel_scale}),
            key=np.max,
        )
        if off.max() > 1e-3 * np.ptp(at, axis=0).max():
            worst = int(np.argmax(off))
            raise InvalidInput(
                f"taxel {worst} of the recording lies {plain_number(1e3 * off[worst], 3)} mm from where the positions_file of the skin has it: check the order of the taxels and the unit. Leave out positions_file to use the recording's own positions."
            )
