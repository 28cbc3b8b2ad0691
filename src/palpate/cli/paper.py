"""palpate paper: reproduce the founding paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.files import Force, make_folder
from palpate.cli.progress import Bar
from palpate.errors import InvalidInput


def paper(
    out: Annotated[Path, typer.Option(help="Folder for the report, the figures and the tables.")] = Path(
        "palpate-paper"
    ),
    force: Force = False,
) -> None:
    """Reproduce the paper that founded the field: its figures 1 to 22, its errors, its formulas, and our extensions."""
    import csv

    from palpate import paper as module

    if any(make_folder(out).iterdir()) and not force:
        raise InvalidInput(
            f"{out} is not empty. Give another folder with --out, or --force to replace what the report writes."
        )

    with Bar("the founding paper", 26) as step:
        path = module.report(out, progress=step)
    for name in ("errors", "friction"):
        with open(out / f"{name}.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        for row in ({k: k for k in rows[0]}, *rows):
            cells = (_short(v) for v in row.values())
            typer.echo("  ".join(f"{c:<12}" if i < 2 else f"{c:>22}" for i, c in enumerate(cells)).rstrip())
    typer.echo(f"report          {path}")


def _short(text: str) -> str:
    """Return a number with three digits, and anything else unchanged."""
    try:
        return text if len(text) < 9 else f"{float(text):.2e}"
    except ValueError:
        return text
