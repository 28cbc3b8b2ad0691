"""palpate pad: show the effect of a pad on a touch."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from palpate.cli.files import Force, check_output, save_figure, skin_files
from palpate.cli.options import check_picture
from palpate.cli.progress import busy
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from palpate.edges import EdgeError
    from palpate.elastic.pad import Pad
    from palpate.sensing.arrays import Array
    from palpate.solid import SolidPad

#: Largest number of sensing elements of a plane for which two meshes are compared: more take long and say the same.
COMPARED = 16


def pad(
    skin_file: Annotated[
        Path, typer.Argument(metavar="SKIN", help="skin.toml with the pad and its array, or the name of a sensor.")
    ],
    plot: Annotated[
        Path, typer.Option(help="Picture of the response per wavelength to write (.png, .pdf or .svg).")
    ] = Path("palpate-pad.png"),
    size: Annotated[
        str | None, typer.Option(help='Length and width of a gel with sides: "25.25 mm x 20.75 mm".')
    ] = None,
    force: Force = False,
) -> None:
    """Show the effect of a pad on a touch at each wavelength, the error of a half-space, the effect of its sides, and the expected error of a force."""
    from palpate.cli.pictures import assumed_skin, skin_path
    from palpate.edges import edge_error
    from palpate.measured import Measured
    from palpate.pads import expected_force, half_space_error, plot_response, plot_table, table_lines
    from palpate.solid import SolidPad

    skin_file = skin_path(skin_file)
    check_picture(plot)
    check_output(plot, inputs=skin_files(skin_file), force=force)
    ends = None if size is None else _ends(size)
    skin, assumed = assumed_skin(skin_file)
    elastic = skin.without_creep().pad
    if isinstance(elastic, Measured):
        if ends is not None:
            raise InvalidInput(
                "--size is for a computed layer; the table of a measured pad already includes its sides. Leave --size out."
            )
        with busy("the table"):
            lines, figure = table_lines(elastic), plot_table(elastic)
        save_figure(figure, plot)
        typer.echo("\n".join([*lines, f"picture                    {plot}"]))
        return
    edges = edge_error(skin.pad, skin.planes)
    if ends is not None and edges is None:
        raise InvalidInput(
            '--size is for one layer on a rigid base (kind = "bonded_layers" with one layer, area contact), and this pad is another. Leave --size out.'
        )
    figure = plot_response(skin.pad, skin.planes, edges=edges)
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
    if edges is not None:
        _print_edges(edges, skin.pad, ends)
    if isinstance(elastic, SolidPad):
        with busy("another mesh"):
            said = _mesh_words(elastic, skin_file, skin.planes)
        typer.echo(f"error by the mesh          {said}")
    typer.echo(f"picture                    {plot}")


def _mesh_words(pad: SolidPad, skin_file: Path, planes: Sequence[Array]) -> str:
    """Describe the error of the readings due to the mesh: stated, or from another mesh where one can be made."""
    from palpate.recordings.padsection import SolidBend, SolidBox, SolidDome, other_mesh
    from palpate.recordings.skinfile import skin_text, validated
    from palpate.sensing.arrays import ScatteredArray

    if pad.accuracy is not None:
        return f"{100 * pad.accuracy:.2g} %"
    section = validated(skin_text(skin_file), str(skin_file)).pad
    if not isinstance(section, SolidBox | SolidDome | SolidBend):
        return "; ".join(
            [*pad.notes, "SolidPad.compared_with(a finer mesh) works it out, and [pad] takes it as accuracy"]
        )
    other, errors = other_mesh(section, pad), []
    for plane in planes:
        some = plane.points[:: math.ceil(len(plane.points) / COMPARED), ::-1]
        few = ScatteredArray(
            positions=some,
            depth=plane.depth,
            channels=plane.channels,
            aperture=(plane.apertures[0], plane.apertures[-1]),
        )
        errors.append(pad.mesh_error(other, few))
    error = f"{100 * max(errors):.2g} %"
    return f'about {error} (beside another mesh); [pad] takes it as accuracy = "{error}"'


def _ends(size: str) -> tuple[float, float]:
    """Parse length and width [m] from "25.25 mm x 20.75 mm"."""
    from palpate.units import parse_quantity

    parts = re.split(r"\s*[x×]\s*", size.strip())
    if len(parts) != 2:
        raise InvalidInput(f'--size must be length and width such as "25.25 mm x 20.75 mm"; got {size!r}.')
    length, width = (parse_quantity(p, "length", "--size") for p in parts)
    if min(length, width) <= 0.0:
        raise InvalidInput(f"--size must be two lengths above 0; got {size!r}.")
    return length, width


def _print_edges(found: EdgeError, pad: Pad, size: tuple[float, float] | None) -> None:
    """Print the error of the infinite layer near a side, and the pad with sides to use instead."""
    from palpate.edges import solid_lines

    h = found.thickness
    said = []
    for d in (0.5, 1.0, 2.0):
        at = [float(np.interp(d * h, found.distance, v)) for v in (found.press, found.drag)]
        more = "" if found.force is None else f", net force x {np.interp(d * h, found.distance, found.force):.2f}"
        said.append(f"{1e3 * d * h:.3g} mm from a side: press {100 * at[0]:.0f} % off, drag {100 * at[1]:.0f} %{more}")
    typer.echo(
        "near the side of the gel   assumed infinite, readings ("
        + ("markers on the surface" if found.kind == "displacement" else "sensors at the base")
        + "):"
    )
    typer.echo("\n".join(f"  {line}" for line in said))
    if size is not None and math.isinf(found.reach):
        typer.echo(
            f"  a press is off by more than 15 % up to {1e3 * found.distance[-1]:.3g} mm from a side, where the table ends"
        )
    elif size is not None:
        typer.echo(
            f"  {100 * found.inner(size):.0f} % of {1e3 * size[0]:.4g} x {1e3 * size[1]:.4g} mm lie farther than {1e3 * found.reach:.2g} mm from all sides, where a press "
            "is off by less than 15 %"
        )
    typer.echo("a pad with sides (palpate[solid]); in the skin.toml, instead of its [pad]:")
    typer.echo("\n".join(f"  {line}" for line in solid_lines(pad, size).splitlines()))
