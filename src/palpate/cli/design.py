"""palpate design: predict what a sensor will resolve before it is built."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.files import Force, check_outputs, save_figure, skin_files, write_text
from palpate.cli.options import check_picture
from palpate.cli.progress import progress
from palpate.errors import InvalidInput


def design(
    design_files: Annotated[
        list[Path],
        typer.Argument(
            metavar="DESIGN...",
            help="design.toml: a skin.toml with [press], [sweep] and [goal]. Several are ranked together.",
        ),
    ],
    by: Annotated[
        str, typer.Option(help="Number to rank by: score, force, shear, center, pair, noticed, range, ...")
    ] = "score",
    top: Annotated[int, typer.Option(min=1, help="Designs to show.")] = 12,
    out: Annotated[Path | None, typer.Option(help="Table of all designs to write (.csv), in SI units.")] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="Picture to write (.png, .pdf or .svg): trade-offs of a sweep, or what one design sees."),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    force: Force = False,
) -> None:
    """Predict what a sensor resolves before it is built: bounds of force and place, pairs, blind spots, range; or rank a sweep of designs."""
    from palpate.design.files import read_design
    from palpate.design.sweep import Sweep, swept

    sources = [f for path in design_files for f in skin_files(path)]
    if plot is not None:
        check_picture(plot)
    if out is not None and out.suffix.lower() != ".csv":
        raise InvalidInput(f"{out}: the table of designs is a .csv. Write --out {out.stem or 'designs'}.csv.")
    check_outputs({"--out": out, "--plot": plot}, inputs=sources, force=force)
    found: list[Sweep] = []
    designs = [read_design(path) for path in design_files]
    if len({read.planes[0].dimensions for read in designs}) > 1:
        raise InvalidInput(
            "some files describe a line and others an area, whose forces are N/m and N. Give files of one kind at a time."
        )
    for path, read in zip(design_files, designs):
        one = swept(
            read.pad,
            read.planes,
            read.press,
            read.values,
            keep=read.keep,
            goals=read.goals,
            uncertainty=read.uncertainty,
            jobs=jobs,
            progress=lambda steps: progress(steps, "designs"),
        )
        named = tuple({"file": path.stem, **p} for p in one.points) if len(design_files) > 1 else one.points
        found.append(Sweep(named, one.designs, one.skipped, one.goals))
    if len({d.press for s in found for d in s.designs}) > 1 or len({tuple(s.goals.items()) for s in found}) > 1:
        raise InvalidInput(
            "the files have different presses or goals, so that they cannot be ranked together. Give all the same [press] and [goal]."
        )
    whole = Sweep(
        tuple(p for s in found for p in s.points),
        tuple(d for s in found for d in s.designs),
        tuple(k for s in found for k in s.skipped),
        found[0].goals,
    )
    ranked = whole.ranked(by)
    if len(whole) > 1:
        typer.echo(ranked.text(most=top))
        for note in whole.notes():
            typer.echo(note)
        typer.echo("\nthe first of them:")
    for line in ranked.designs[0].lines():
        typer.echo(line)
    if len(whole) == 1:
        for note in whole.notes():
            typer.echo(note)
    if out is not None:
        write_text(out, ranked.csv())
        typer.echo(f"table   {out}")
    if plot is not None:
        save_figure(ranked.plot() if len(whole) > 1 else whole.designs[0].plot(), plot)
        typer.echo(f"picture {plot}")
