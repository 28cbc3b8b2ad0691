"""What options mean, for the commands that share them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from palpate.grasp import GraspMonitor
    from palpate.skin import Skin


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
    """Refuse what these channels cannot tell: a limit that is never reached would look like safety."""
    if "z" not in skin.components and not (pressure is None and force is None):
        raise InvalidInput(
            f"--max-pressure and --max-force watch the pressure, but these channels measure only {', '.join(skin.components)}: leave them out."
        )


def numbers(text: str, option: str) -> list[float]:
    try:
        return [float(v) for v in text.split(",")]
    except ValueError as error:
        raise InvalidInput(f"{option} must be one number or several with commas; got {text!r}.") from error


def rows_and_columns(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        rows, columns = (int(v) for v in text.lower().split("x"))
    except ValueError as error:
        raise InvalidInput(f"--shape must be rows x columns such as 4x6; got {text!r}.") from error
    return rows, columns


def check_picture(path: Path) -> None:
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise InvalidInput(f"{path}: pictures end in .png, .pdf or .svg.")


def known_channels(names: list[str]) -> list[str]:
    from palpate.elastic.channels import check_channels

    return list(check_channels(names, 2))


def check_matching(recording: Any, skin: Skin) -> None:
    channels = tuple(c for p in skin.planes for c in p.channels)
    if recording.channels != channels:
        raise InvalidInput(
            f"the recording holds {', '.join(recording.channels)} but the skin describes {', '.join(channels)}: list the same channels in the same order."
        )
    shapes = {p.shape for p in skin.planes}
    if shapes != {recording.readings.shape[2:]}:
        raise InvalidInput(
            f"the recording has {'x'.join(map(str, recording.readings.shape[2:]))} taxels but the skin describes {' and '.join('x'.join(map(str, s)) for s in shapes)}."
        )
