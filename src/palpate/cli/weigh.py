"""palpate weigh: compute the modulus of a gel from known forces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.options import Columns, mapping_for
from palpate.cli.progress import busy
from palpate.errors import InvalidInput


def weigh(
    presses: Annotated[
        list[Path],
        typer.Argument(
            metavar="PRESS...",
            help="One file for each press, beginning at rest: videos, folders or stacks of a gel, or recordings of its displacements (.nc, .npz, .csv, tables of markers).",
        ),
    ],
    skin_file: Annotated[
        Path, typer.Option("--skin", help="skin.toml with a guess of the modulus, or the name of a sensor.")
    ],
    force: Annotated[
        list[str],
        typer.Option(
            help='Known normal force of each press, e.g. "1.96 N", or one for all; or a table of force over time on the clock of the press, with titles such as time (s),fz (N).'
        ),
    ],
    columns: Columns = None,
    baseline: Annotated[
        int | None,
        typer.Option(
            min=0, help="Frames at the start that show the gel at rest; default: that of the skin.toml, otherwise 5."
        ),
    ] = None,
    friction: Annotated[float | None, typer.Option(help="Coefficient of friction, if known.")] = None,
) -> None:
    """Set the modulus of a gel by presses with known forces: every force is proportional to it."""
    from palpate._numbers import plain_number
    from palpate.camera import is_pictures
    from palpate.camera import weigh as weighed
    from palpate.cli.pictures import skin_path
    from palpate.recordings import read_recording

    if len(force) not in (1, len(presses)):
        raise InvalidInput(
            f"--force is given {len(force)} times for {len(presses)} presses: once for each, or one for all."
        )
    skin = skin_path(skin_file)
    for press in presses:
        if not press.exists():
            raise InvalidInput(f"{press}: no such file.")
    filmed = [is_pictures(press) for press in presses]
    if columns is not None and any(filmed):
        raise InvalidInput("--map names the columns of a table: leave it out for pictures.")
    forces = [_force(f) for f in force] * (len(presses) if len(force) == 1 else 1)
    sources: list[Any] = [
        press if pictures else read_recording(press, mapping=mapping_for(press, skin, columns))
        for press, pictures in zip(presses, filmed)
    ]
    options: dict[str, Any] = {} if friction is None else {"friction": friction}
    with busy("solving"):
        found = weighed(sources, skin, forces, reference=baseline, **options)
    typer.echo(str(found))
    share = found.std / found.youngs_modulus
    if not share < 1.0:
        typer.echo(
            "write           nothing: these presses do not determine the modulus. Press several times, with about the forces that the gel will measure."
        )
    elif found.better:
        # per cent with two digits; a skin.toml needs less than 100
        modulus, percent = plain_number(1e-3 * found.youngs_modulus, 4), plain_number(min(100.0 * share, 99.0), 2)
        typer.echo(f'write           youngs_modulus = "{modulus} kPa +- {percent} %"')


def _force(text: str) -> Any:
    """Parse a force in newtons, or read the table of a force over time."""
    from palpate.camera import read_force_trace
    from palpate.units import parse_quantity

    path = Path(text)
    if path.is_file() or path.suffix.lower() in (".csv", ".txt", ".tsv", ".dat"):
        return read_force_trace(path)
    return parse_quantity(text, "force", "force")
