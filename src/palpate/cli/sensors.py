"""palpate sensors: list known sensors, and write their skin files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def sensors(
    name: Annotated[str | None, typer.Argument(help="Sensor whose skin.toml is shown.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write its skin.toml to this file, for you to change.")] = None,
) -> None:
    """List sensors that are known; show or write the skin.toml of one, with the source of each number."""
    from palpate.errors import InvalidInput
    from palpate.sensors import preset, presets

    if name is None:
        if out is not None:
            raise InvalidInput("--out writes the skin.toml of one sensor: name it.")
        for one in presets().values():
            typer.echo(f"{one.name:16s}{one.summary}")
            if one.sources:
                typer.echo(f"{'':16s}sources: {one.sources}")
            if one.unknown:
                typer.echo(f"{'':16s}to be found: {', '.join(one.unknown)} (its file says how)")
        typer.echo("use one as it is (--skin NAME), or: palpate sensors NAME --out skin.toml")
        return
    found = preset(name)
    if out is None:
        typer.echo(found.text, nl=False)
    else:
        typer.echo(f"wrote           {found.write(out)}")
