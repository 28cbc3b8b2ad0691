"""palpate weigh: the modulus of a gel from known forces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.progress import busy
from palpate.errors import InvalidInput


def weigh(
    videos: Annotated[
        list[Path], typer.Argument(metavar="PICTURES...", help="Videos, folders or stacks, one for each press.")
    ],
    skin_file: Annotated[
        Path, typer.Option("--skin", help="skin.toml with a guess of the modulus, or the name of a sensor.")
    ],
    force: Annotated[list[str], typer.Option(help='Known normal force of each press, e.g. "1.96 N"; or one for all.')],
    friction: Annotated[float | None, typer.Option(help="Coefficient of friction, where it is known.")] = None,
) -> None:
    """Set the modulus of a gel by presses with known forces: every force is proportional to it."""
    from palpate.camera import is_pictures
    from palpate.camera import weigh as weighed
    from palpate.cli.pictures import known_skin
    from palpate.units import parse_quantity

    if len(force) not in (1, len(videos)):
        raise InvalidInput(
            f"--force is given {len(force)} times for {len(videos)} presses: once for each, or one for all."
        )
    for video in videos:
        if not video.exists():
            raise InvalidInput(f"{video}: no such file.")
        if not is_pictures(video):
            raise InvalidInput(
                f"{video}: weights are read from pictures of the gel (a video, a folder of pictures, a .tif stack), and this is none."
            )
    forces = [parse_quantity(f, "force", "force") for f in force] * (len(videos) if len(force) == 1 else 1)
    options: dict[str, Any] = {} if friction is None else {"friction": friction}
    with busy("solving"):
        found = weighed(list(videos), known_skin(skin_file), forces, **options)
    typer.echo(str(found))
    if not found.better:
        return
    percent = 100.0 * found.std / found.youngs_modulus
    typer.echo(f'write           youngs_modulus = "{1e-3 * found.youngs_modulus:.4g} kPa +- {percent:.2g} %"')
