"""palpate tfm: compute the forces of a cell on its gel, from pictures of beads or a displacement field."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.files import (
    Force,
    check_outputs,
    command_line,
    provenance,
    save_figure,
    skin_files,
    skin_text,
    whole_result,
)
from palpate.cli.options import numbers, value_and_std
from palpate.cli.progress import busy
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from palpate.elastic.pad import Pad
    from palpate.microscopy import Field
    from palpate.microscopy.pixelsize import PixelSize
    from palpate.sensing.uncertainty import Uncertainty


def tfm(
    source: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...",
            help="Pictures of beads: two files (at rest, then pulled) or a stack; or a displacement field: .npy, .npz, .mat, .h5, a PIV table, "
            "a pair of matrices (along x, then along y), .tif.",
        ),
    ],
    pixel: Annotated[
        str | None, typer.Option(help='Size of a pixel, e.g. "0.1 um"; default: that stated in the pictures.')
    ] = None,
    youngs_modulus: Annotated[
        str | None,
        typer.Option(
            help='Modulus of the gel, e.g. "8 kPa", or "8 kPa +- 10 %" with its error, which enters all errors.'
        ),
    ] = None,
    poissons_ratio: Annotated[float | None, typer.Option(help="Poisson's ratio of the gel, e.g. 0.48.")] = None,
    thickness: Annotated[
        str | None, typer.Option(help='Thickness of a gel on glass, e.g. "40 um"; default: infinite.')
    ] = None,
    skin_file: Annotated[
        Path | None, typer.Option("--skin", help="skin.toml that describes the gel, in place of the options above.")
    ] = None,
    depth: Annotated[str, typer.Option(help="Depth of the beads below the surface.")] = "0 um",
    mask: Annotated[
        Path | None,
        typer.Option(
            help="Where the cell is: a picture that is zero outside, _seg.npy or masks of Cellpose, or an outline (.csv of x,y in pixels, .json)."
        ),
    ] = None,
    cell: Annotated[
        int | None, typer.Option(help="Cell to take from a mask of several: its value, or the number of its outline.")
    ] = None,
    image: Annotated[Path | None, typer.Option(help="Picture of the cell, to be drawn beneath.")] = None,
    frames: Annotated[
        str | None, typer.Option(help="Numbers of the pictures at rest and pulled in a stack, e.g. -1,0.")
    ] = None,
    window: Annotated[
        int | None,
        typer.Option(
            help="Side of the windows that are compared, or that a field was made with [pixels]; default: 32 for pictures; 0 (points) for a field."
        ),
    ] = None,
    step: Annotated[
        float | None, typer.Option(help="Pixels between vectors; default for pictures: half a window.")
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(help="Pixel (column,row) of the first vector of a matrix, e.g. 16,16; default: half a step."),
    ] = None,
    channel: Annotated[
        int | None, typer.Option(min=1, help="Channel that shows the beads, in pictures of several; counted from 1.")
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the displacements of a field: px, um, m and so on.")] = None,
    position_unit: Annotated[
        str | None, typer.Option(help="Unit of the positions of a table, if it is not that of the displacements.")
    ] = None,
    up: Annotated[
        bool, typer.Option("--up", help="The coordinate y and the displacement v of a field point upwards.")
    ] = False,
    v_up: Annotated[bool, typer.Option("--v-up", help="v of a field grows upwards, and y downwards.")] = False,
    follow: Annotated[
        bool, typer.Option("--follow", help="The table states the positions of the vectors after the displacement.")
    ] = False,
    name: Annotated[
        str | None, typer.Option(help="Field to read from a file that contains several, or frame of a table.")
    ] = None,
    normal: Annotated[
        str | None,
        typer.Option(
            help="Direction of a positive w, the displacement of a field out of the plane: up (default, out of the gel), down, or ignore."
        ),
    ] = None,
    drop_outliers: Annotated[
        bool, typer.Option("--drop-outliers", help="Leave out vectors that differ from all their neighbours.")
    ] = False,
    still: Annotated[bool, typer.Option("--still", help="Do not remove a shift of the whole picture.")] = False,
    noise: Annotated[
        str | None,
        typer.Option(
            help="Standard deviation of the displacements, e.g. 5 nm; default: estimated from the field or the pictures."
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="adhesions (default): traction in patches, whose number, places and sizes are sampled; tikhonov: one even penalty, for traction everywhere."
        ),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(
            help="Outlines of adhesions: a label picture (.tif, .png, .npy, _seg.npy), or ImageJ's .roi and RoiSet.zip. The force of each is written to NAME-labels.csv."
        ),
    ] = None,
    monolayer: Annotated[
        bool,
        typer.Option(
            "--monolayer",
            help="The mask is a sheet of cells: its tension goes to NAME-sheet.png and NAME-sheet.csv, with a row for each cell and border of --labels. Traction is that of tikhonov unless --method says otherwise.",
        ),
    ] = False,
    sheet_ratio: Annotated[
        float | None,
        typer.Option(
            "--sheet-poissons-ratio",
            help="Poisson's ratio of the sheet of --monolayer, e.g. 0.5; default: unknown, from 0 to 1.",
        ),
    ] = None,
    order: Annotated[
        int | None,
        typer.Option(help="For tikhonov: derivative of the traction that is kept small: 0, 1 (default) or 2."),
    ] = None,
    rule: Annotated[
        str | None,
        typer.Option(help="For tikhonov: rule that chooses the regularisation: evidence (default), gcv or lcurve."),
    ] = None,
    draws: Annotated[
        int, typer.Option(min=8, help="Samples of the posterior, from which the errors are computed.")
    ] = 120,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Name of the results without ending: .html, .png, .csv and .nc are written; default: SOURCE-tfm."
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Another file for the figure of the traction: .png, .svg or .pdf.")
    ] = None,
    vectors: Annotated[
        Path | None, typer.Option(help="Table (.csv) of every vector: position, displacement, traction and its error.")
    ] = None,
    tiff: Annotated[
        Path | None, typer.Option(help="Traction and its error as a TIFF stack of floats, for ImageJ and others.")
    ] = None,
    force: Force = False,
) -> None:
    """Traction force microscopy: strain energy, contractility and forces of a cell, with their errors, in one report."""
    from palpate.microscopy import (
        bead_displacements,
        cell_forces,
        forces_of_labels,
        is_field,
        read_field,
        read_mask,
        read_pair,
        read_picture,
        sheet_tension,
    )
    from palpate.microscopy.labels import rows_of, write_labels_table
    from palpate.microscopy.readers import TURNED
    from palpate.units import parse_quantity

    stem = out if out is not None else source[0].with_name(source[0].stem + "-tfm")
    targets = {e: stem.with_name(stem.name + e) for e in (".html", ".png", ".csv", ".nc")}
    if labels is not None:
        targets["-labels.csv"] = stem.with_name(stem.name + "-labels.csv")
    method = method or ("tikhonov" if monolayer else "adhesions")
    if sheet_ratio is not None and not monolayer:
        raise InvalidInput("--sheet-poissons-ratio belongs to --monolayer: add it, or leave the ratio out.")
    if monolayer:
        targets |= {e: stem.with_name(stem.name + e) for e in ("-sheet.png", "-sheet.csv")}
    tikhonov_options = [o for o, v in (("--order", order), ("--rule", rule)) if v is not None]
    if tikhonov_options and method != "tikhonov":
        raise InvalidInput(f"{' and '.join(tikhonov_options)} belong to --method tikhonov; --method is {method}.")
    inputs = [*source, mask, image, labels, *skin_files(skin_file)]
    extra_outputs = {"--plot": plot, "--vectors": vectors, "--tiff": tiff}
    check_outputs({"--out": None, **{str(t): t for t in targets.values()}, **extra_outputs}, inputs=inputs, force=force)
    for option, path, accepted in (("--plot", plot, (".png", ".svg", ".pdf")), ("--vectors", vectors, (".csv",)), ("--tiff", tiff, (".tif", ".tiff"))):  # fmt: skip
        if path is not None and path.suffix.lower() not in accepted:
            raise InvalidInput(f"{option} {path}: such a file ends in {' or '.join(accepted)}. Give such a name.")
    fields = is_field(source) if all(file.exists() for file in source) else False
    pictures = [*([] if fields else source), *([] if image is None else [image])]
    size_in_pictures = _complete(source, image, pixel, unit, step, skin_file, youngs_modulus, poissons_ratio, pictures)
    notes, size_of_pixel = _pixel(pixel, size_in_pictures, pictures)
    if cell is not None and mask is None:
        raise InvalidInput("--cell picks a cell of a mask: give --mask.")
    corners = None if mask is None else read_mask(mask, cell=cell, pixel=size_of_pixel)
    picture = None if image is None else read_picture(image)
    size = None if picture is None else (int(picture.shape[1]), int(picture.shape[0]))
    if up and size is None and corners is not None and corners.dtype == bool:
        size = (int(corners.shape[1]), int(corners.shape[0]))
    if fields:
        wrong = [o for o, v in (("--frames", frames), ("--channel", channel)) if v is not None]
        if wrong:
            raise InvalidInput(
                f"{' and '.join(wrong)} belongs to pictures of beads; {source[0]} holds displacements: leave it out."
            )
        first = None if start is None else numbers(start, "--start")
        if first is not None and len(first) != 2:
            raise InvalidInput(f"--start takes column,row of the first vector in pixels, such as 16,16; got {start!r}.")
        field = read_field(
            source, pixel=size_of_pixel, unit=unit, step=step, start=None if first is None else (first[0], first[1]), size=size, up=up, v_up=v_up, name=name, follow=follow, window=window, position_unit=position_unit, normal=normal or "up",
        )  # fmt: skip
        if TURNED in field.notes and corners is not None:
            raise InvalidInput(
                f"{mask} is an outline in pixels from the picture's top, and --up counts from its bottom: give the picture too (--image)."
            )
        if not still:
            field = field.without_drift()
    else:
        of_fields = (("--unit", unit), ("--up", up), ("--v-up", v_up), ("--name", name), ("--follow", follow), ("--position-unit", position_unit), ("--start", start), ("--normal", normal))  # fmt: skip
        if any(v for _, v in of_fields):
            raise InvalidInput(
                f"{', '.join(o for o, v in of_fields if v)} belong to displacement fields; {source[0]} is taken as pictures of beads: leave them out."
            )
        picks = None if frames is None else [int(n) for n in numbers(frames, "--frames")]
        if picks is not None and len(picks) != 2:
            raise InvalidInput(
                f"--frames takes two numbers, at rest and pulled, such as --frames=-1,0; got {frames!r}."
            )
        at_rest, pulled = read_pair(source, frames=None if picks is None else (picks[0], picks[1]), channel=channel)
        if step is not None and step != int(step):
            raise InvalidInput(f"--step of pictures is a whole number of pixels; got {step:g}.")
        size = size or (int(at_rest.shape[1]), int(at_rest.shape[0]))
        if size != (at_rest.shape[1], at_rest.shape[0]):
            raise InvalidInput(
                f"{image} has {size[0]} x {size[1]} pixels and the beads {at_rest.shape[1]} x {at_rest.shape[0]}: give the picture of the same field of view."
            )
        with busy("following the beads"):
            field = bead_displacements(
                at_rest,
                pulled,
                pixel=size_of_pixel,
                window=window or 32,
                step=None if step is None else int(step),
                drift=not still,
            )
    field = replace(field, notes=(*notes, *field.notes))
    if drop_outliers:
        field = field.without_outliers()
    pad, below, uncertainty = _gel(field, skin_file, youngs_modulus, poissons_ratio, thickness, depth)
    with busy("solving"):
        forces = cell_forces(
            field, pad, mask=corners, size=size, picture=picture, depth=below, noise=None if noise is None else parse_quantity(noise, 'length', '--noise'), method=method, order=1 if order is None else order, rule=rule or "evidence", drift=not still, uncertainty=uncertainty, draws=draws,
        )  # fmt: skip
    labelled = None if labels is None else forces_of_labels(forces, labels, size=size)
    sheet = None
    if monolayer:
        with busy("solving the sheet"):
            sheet = sheet_tension(forces, labels=labels, size=size, poissons_ratio=sheet_ratio)
    source_names = ", ".join(p.name for p in source)
    outputs = [p for p in (*targets.values(), *extra_outputs.values()) if p is not None]
    with whole_result(outputs) as new_files:
        forces.write_report(
            new_files[targets[".html"]], title=source[0].stem, source=source_names, command=command_line()
        )
        save_figure(forces.plot(), new_files[targets[".png"]])
        forces.write_table(new_files[targets[".csv"]])
        forces.write_netcdf(new_files[targets[".nc"]], provenance=provenance(skin_text(skin_file), source_names))
        if plot is not None:
            save_figure(forces.plot(), new_files[plot])
        if vectors is not None:
            forces.write_vectors(new_files[vectors])
        if tiff is not None:
            forces.write_tiff(new_files[tiff])
        if labelled is not None:
            write_labels_table(rows_of(labelled, file=source_names, frame=0), new_files[targets["-labels.csv"]])
        if sheet is not None:
            save_figure(sheet.plot(), new_files[targets["-sheet.png"]])
            sheet.write_table(new_files[targets["-sheet.csv"]])
    rows, columns = field.shape
    typer.echo(f"{columns} x {rows} vectors, one every {field.step:.3g} px = {1e6 * field.pitch:.3g} um")
    if field.drift is not None:
        typer.echo(
            f"drift of {field.drift[0] / field.pixel:.3g} px along x and {field.drift[1] / field.pixel:.3g} px along y taken out"
        )
    typer.echo(forces.summary())
    if sheet is not None:
        typer.echo(sheet.summary())
    for note in (*forces.notes, *(() if sheet is None else sheet.notes)):
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"wrote {', '.join(map(str, outputs))}")


def _complete(
    source: list[Path],
    image: Path | None,
    pixel: str | None,
    unit: str | None,
    step: float | None,
    skin: Path | None,
    modulus: str | None,
    ratio: float | None,
    pictures: list[Path],
) -> PixelSize | None:
    """Refuse missing numbers that no file states. Return the size of a pixel, the user's or that of the pictures."""
    from palpate.microscopy import is_field
    from palpate.microscopy.pixelsize import pixel_size_of_all

    for file in source:
        if not file.exists():
            raise InvalidInput(f"{file}: no such file.")
    size_in_pictures = None if pixel is not None else pixel_size_of_all(pictures)
    # a matrix states neither its unit nor its step
    matrix = is_field(source) and all(f.suffix.lower() == ".npy" for f in source)
    needed = [
        ('--pixel "0.1 um" (the size of a pixel)', pixel is None and size_in_pictures is None),
        ("--unit px (of the displacements; or um, m)", matrix and unit is None),
        ("--step 8 (pixels from vector to vector)", matrix and step is None and image is None),
        ('--youngs-modulus "8 kPa"', skin is None and modulus is None),
        ("--poissons-ratio 0.48", skin is None and ratio is None),
    ]
    lacking = [option for option, lacks in needed if lacks]
    if lacking:
        gel = (
            " A --skin gel.toml may describe the gel instead."
            if skin is None and (modulus is None or ratio is None)
            else ""
        )
        raise InvalidInput(f"give what no file states, such as {', '.join(lacking)}.{gel}")
    return size_in_pictures


def _pixel(text: str | None, size_in_pictures: PixelSize | None, pictures: list[Path]) -> tuple[list[str], float]:
    """Return remarks on the size of a pixel, and the size [m], from the user or from the pictures."""
    from palpate.microscopy.pixelsize import differing
    from palpate.units import parse_quantity

    if size_in_pictures is not None:
        return [f"a pixel is {size_in_pictures}: {size_in_pictures.said} says so"], size_in_pictures.x
    size = parse_quantity(text, "length", "--pixel")
    if size <= 0:
        raise InvalidInput(f"--pixel must be positive; got {text!r}.")
    return [remark for path in pictures if (remark := differing(path, size))], size


def _gel(
    field: Field, skin_file: Path | None, modulus: str | None, ratio: float | None, thickness: str | None, depth: str
) -> tuple[Pad, float, Uncertainty | None]:
    """Return the gel, the depth of its beads [m], and the uncertainty of its properties."""
    from palpate.elastic import BondedLayers, HalfSpace, Layer
    from palpate.recordings import read_skin, read_uncertainty
    from palpate.units import parse_quantity

    options: list[tuple[str, Any]] = [
        ("--youngs-modulus", modulus),
        ("--poissons-ratio", ratio),
        ("--thickness", thickness),
    ]
    if skin_file is not None:
        contradicting = [o for o, v in options if v is not None] + (["--depth"] if depth != "0 um" else [])
        if contradicting:
            raise InvalidInput(f"{', '.join(contradicting)}: {skin_file} describes the gel; give either.")
        pad, planes, _, _ = read_skin(skin_file, field.recording())
        if len(planes) != 1 or set(planes[0].channels) != {"displacement_x", "displacement_y"}:
            raise InvalidInput(
                f'{skin_file}: one plane with channels = ["displacement_x", "displacement_y"] is what a picture of beads shows.'
            )
        return pad, float(planes[0].depth), read_uncertainty(skin_file)
    assert modulus is not None  # `_complete` has checked both
    assert ratio is not None
    value, uncertainty = _modulus_of("--youngs-modulus", modulus)
    below = parse_quantity(depth, "length", "--depth")
    if thickness is None:
        return HalfSpace(youngs_modulus=value, poissons_ratio=ratio), below, uncertainty
    thick = parse_quantity(thickness, "length", "--thickness")
    return BondedLayers([Layer(thickness=thick, youngs_modulus=value, poissons_ratio=ratio)]), below, uncertainty


def _modulus_of(option: str, text: str) -> tuple[float, Uncertainty | None]:
    """Parse the modulus [Pa] and its uncertainty, if stated, from "8 kPa +- 10 %"."""
    from palpate.sensing.uncertainty import Uncertainty

    value, share = value_and_std(text, "pressure", option)
    return value, Uncertainty(youngs_modulus=share) if re.search(r"\+-|\+/-|±", text) else None
