"""palpate pillars: compute forces on micropillars from their deflections."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.files import Force, check_output
from palpate.errors import InvalidInput


def pillars(
    table: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE", help="Posts with columns x, y, dx, dy, and their units in the header: dx [um]."
        ),
    ],
    diameter: Annotated[str, typer.Option(help='Diameter of a post, e.g. "2 um +- 3 %".')],
    height: Annotated[str, typer.Option(help='Length of a post, e.g. "6 um +- 2 %".')],
    modulus: Annotated[str, typer.Option(help='Modulus of its material, e.g. "2 MPa +- 10 %".')],
    poissons_ratio: Annotated[float, typer.Option(help="Poisson's ratio of its material.")] = 0.5,
    rigid_base: Annotated[
        bool, typer.Option("--rigid-base", help="The posts stand on a stiff base, which does not tilt.")
    ] = False,
    noise: Annotated[
        str | None,
        typer.Option(
            help="Standard deviation of a deflection, e.g. 20 nm; default: columns ex, ey of the table; otherwise unknown."
        ),
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of deflections that the header does not state: px, um, nm.")
    ] = None,
    position_unit: Annotated[str | None, typer.Option(help="Unit of positions; default: that of deflections.")] = None,
    pixel: Annotated[str | None, typer.Option(help='Size of a pixel, e.g. "0.1 um", if lengths are in pixels.')] = None,
    out: Annotated[Path | None, typer.Option(help="Table of forces to write; default: TABLE-forces.csv.")] = None,
    force: Force = False,
) -> None:
    """Force on each micropillar, with its error: bending, shear and the tilt of the base."""
    from palpate.cli.options import value_and_std
    from palpate.microscopy import Pillar, pillar_forces, read_pillars
    from palpate.units import parse_quantity

    target = out or table.with_name(f"{table.stem}-forces.csv")
    check_output(target, inputs=[table], force=force)
    if not table.exists():
        raise InvalidInput(f"{table}: no such file.")
    (d, d_error), (h, h_error), (e, e_error) = (
        value_and_std(text, kind, option)
        for text, kind, option in (
            (diameter, "length", "--diameter"),
            (height, "length", "--height"),
            (modulus, "pressure", "--modulus"),
        )
    )
    post = Pillar(
        diameter=d, height=h, youngs_modulus=e, poissons_ratio=poissons_ratio, diameter_error=d_error, height_error=h_error, modulus_error=e_error, rigid_base=rigid_base,
    )  # fmt: skip
    size = None if pixel is None else parse_quantity(pixel, "length", "--pixel")
    at, moved, std = read_pillars(table, unit=unit, position_unit=position_unit, pixel=size)
    found = pillar_forces(at, moved, post, noise=std if noise is None else parse_quantity(noise, "length", "--noise"))
    found.write_table(target)
    typer.echo(f"{len(at)} posts")
    typer.echo(found.summary())
    for note in found.notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"wrote {target}")
