"""palpate paper: the founding paper, again."""

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
    """Reproduce the paper that founded the field: figures 2 to 22, its error table, and three studies."""
    from palpate import paper as module

    if any(make_folder(out).iterdir()) and not force:
        raise InvalidInput(
            f"{out} is not empty. Give another folder with --out, or --force to replace what the report writes."
        )

    with Bar("the founding paper", 26) as step:
        path = module.report(out, progress=step)
    typer.echo(f"{'case':<46}{'channel':<11}{'paper':>9}{'dft':>10}{'linear':>10}")
    import csv

    with open(out / "errors.csv", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            typer.echo(
                f"{row['case']:<46}{row['channel']:<11}{row['paper']:>9}{float(row['dft']):>10.2e}{float(row['linear']):>10.1e}"
            )
    typer.echo(f"report          {path}")
