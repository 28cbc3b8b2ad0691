"""palpate pad: what a pad does to a touch."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.files import Force, check_output, save_figure, skin_files
from palpate.cli.options import check_picture
from palpate.cli.progress import busy


def pad(
    skin_file: Annotated[
        Path, typer.Argument(metavar="SKIN", help="skin.toml with the pad and its array, or the name of a sensor.")
    ],
    plot: Annotated[
        Path, typer.Option(help="Picture of the response per wavelength to write (.png, .pdf or .svg).")
    ] = Path("palpate-pad.png"),
    force: Force = False,
) -> None:
    """Show what a pad does to a touch at each wavelength, how far a half-space would be off, and how well a force can be known."""
    from palpate.cli.pictures import assumed_skin, known_skin
    from palpate.pads import expected_force, half_space_error, plot_response

    skin_file = known_skin(skin_file)
    check_picture(plot)
    check_output(plot, inputs=skin_files(skin_file), force=force)
    skin, assumed = assumed_skin(skin_file)
    figure = plot_response(skin.pad, skin.planes)
    with busy("a typical contact"):
        found = half_space_error(skin)
        known = expected_force(skin)
    save_figure(figure, plot)
    if assumed:
        typer.echo(assumed)
    typer.echo(
        f"a Hertz contact of radius {1e3 * found.radius:.3g} mm in the middle, 1 % noise, components {', '.join(skin.components)}"
    )
    typer.echo(
        f"error of the traction      this pad {100 * found.layered:.0f} %   taken for a half-space "
        + (f"{100 * found.relative:.0f} %" if math.isfinite(found.relative) else "no answer")
    )
    if "z" in skin.components and math.isfinite(found.peak):
        typer.echo(f"taken for a half-space     peak pressure x {found.peak:.2f}   net force x {found.force:.2f}")
    if known is not None:
        typer.echo(f"such a press is known to   {known}")
    typer.echo(f"picture                    {plot}")
