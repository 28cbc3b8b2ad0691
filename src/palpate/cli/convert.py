"""palpate convert: write a recording in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.files import Force, check_output, skin_files, written
from palpate.cli.options import Columns, check_channels, mapping_for, numbers, rows_and_columns
from palpate.errors import InvalidInput


def convert(
    source: Annotated[
        Path,
        typer.Argument(
            help="Recording, or a table of another program: a CSV with a header, or HDF5 with positions and vectors."
        ),
    ],
    target: Annotated[Path, typer.Argument(help="Recording to write (.nc, .h5, .npz, .csv, .zarr or .mcap).")],
    mapped: Columns = None,
    columns: Annotated[
        str | None,
        typer.Option(help="Columns x, y and channels of a foreign CSV (x,y,u,v), or data sets pos,vec of HDF5."),
    ] = None,
    channels: Annotated[
        str | None,
        typer.Option(help="Channels that the columns or messages contain (default displacement_x,displacement_y)."),
    ] = None,
    pixel: Annotated[
        str | None,
        typer.Option(help='Size of a pixel, e.g. "0.77 um", if positions and displacements are in pixels.'),
    ] = None,
    position_unit: Annotated[str | None, typer.Option(help="Unit of the positions (mm, um, ...).")] = None,
    reading_unit: Annotated[str | None, typer.Option(help="Unit of the readings (um, kPa, ...).")] = None,
    follow: Annotated[bool, typer.Option("--follow", help="Move each marker by its own displacement first.")] = False,
    grid: Annotated[
        str | None, typer.Option(help='Interpolate scattered readings to a grid of this pitch, e.g. "8 um".')
    ] = None,
    skin_file: Annotated[
        Path | None,
        typer.Option(
            "--skin",
            help="skin.toml whose section [stream] describes the messages of a robot, or [columns] the columns of a table.",
        ),
    ] = None,
    topic: Annotated[str | None, typer.Option(help="Topic of the readings in a robot's MCAP file or bag.")] = None,
    path: Annotated[str, typer.Option(help="Path of the taxels in its messages, e.g. sensors[0].taxels.")] = "",
    fields: Annotated[str | None, typer.Option(help="Fields to read of each taxel, e.g. x,y,z.")] = None,
    scale: Annotated[
        str, typer.Option(help="Factor from the numbers to SI units: one number, or one per channel with commas.")
    ] = "1",
    shape: Annotated[str | None, typer.Option(help="Rows and columns of the taxels, e.g. 4x6.")] = None,
    markers: Annotated[
        bool, typer.Option("--markers", help="The numbers are positions of markers: read their displacement.")
    ] = False,
    salvage: Annotated[
        bool,
        typer.Option(
            "--salvage",
            help="Read the undamaged part of a recording that was cut off or damaged (.mcap, .nc, .h5, .csv).",
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Change the format of a recording, or read a table, an MCAP file or a ROS bag made elsewhere into one."""
    from palpate.elastic.channels import channel_unit
    from palpate.recordings import TopicMapping, read_recording, read_stream, read_table, write_recording
    from palpate.recordings.checked import SALVAGED
    from palpate.recordings.formats import endings, file_format
    from palpate.recordings.robots import is_bag
    from palpate.units import convert_factor, parse_quantity

    file_format(target, task="write")
    check_output(target, inputs=[source, *skin_files(skin_file)], force=force)
    described = bool(path or fields or scale != "1" or shape or markers)
    if channels is not None and columns is None and topic is None:
        raise InvalidInput(
            "--channels says what --columns or the messages of a --topic measure: give one of these options too."
        )
    names = (channels or "displacement_x,displacement_y").split(",")
    table = source.suffix.lower() in endings("read_mapped")
    if mapped is not None or (table and skin_file is not None):
        others = columns, channels, pixel, position_unit, reading_unit, topic, described or None
        if any(o is not None for o in others) or follow or salvage:
            raise InvalidInput(
                "--map, or [columns] in the skin.toml, describes a table completely: with it, only --grid and --force can be given."
            )
        mapping: Any = mapping_for(source, skin_file, mapped)
        if mapping is None:
            raise InvalidInput(
                f"{skin_file} has no section [columns] that says what the columns of {source} are: give --map."
            )
        recording = read_recording(source, mapping=mapping)
    elif topic is not None or described or salvage or skin_file is not None:
        if columns is not None:
            raise InvalidInput(
                "--columns describes a table; --topic, --skin and --salvage describe a robot's recording: give one or the other."
            )
        if pixel or position_unit or reading_unit or follow:
            raise InvalidInput(
                "--pixel, --position-unit, --reading-unit and --follow describe a table; use --scale for the numbers of a --topic."
            )
        if described and topic is None:
            raise InvalidInput(
                "--path, --fields, --scale, --shape and --markers describe the messages of a topic: give --topic too."
            )
        if topic is not None and skin_file is not None:
            raise InvalidInput("give either --topic or a --skin with a section [stream].")
        mapping = None if skin_file is None else read_stream(skin_file)
        if skin_file is not None and mapping is None:
            raise InvalidInput(f"{skin_file} has no section [stream] that says where the readings are.")
        if topic is not None:
            mapping = TopicMapping(
                topic=topic,
                channels=names,
                path=path,
                fields=fields.split(",") if fields else (),
                scale=numbers(scale, "--scale"),
                shape=rows_and_columns(shape),
                markers=markers,
            )
            if not (is_bag(source) or source.suffix.lower() == ".mcap"):
                raise InvalidInput(f"--topic describes an .mcap file or a bag; got {source}.")
        if skin_file is not None and not (is_bag(source) or source.suffix.lower() == ".mcap"):
            raise InvalidInput(f"the section [stream] of a --skin describes an .mcap file or a bag; got {source}.")
        recording = read_recording(source, mapping=mapping, salvage=salvage)
    elif columns is None:
        if pixel or position_unit or reading_unit or follow:
            raise InvalidInput(
                "--pixel, --position-unit, --reading-unit and --follow describe a foreign table: name its --columns too."
            )
        recording = read_recording(source)
    else:
        units = {channel_unit(c) for c in check_channels(names)}
        if follow and not any(c.startswith("displacement") for c in names):
            raise InvalidInput("--follow moves markers by their displacement; these channels hold none.")
        if pixel is not None:
            if position_unit or reading_unit:
                raise InvalidInput(
                    "--pixel already gives the unit of positions and displacements; leave out --position-unit and --reading-unit."
                )
            if units != {"m"}:
                raise InvalidInput(
                    "--pixel gives displacements their unit; these channels are not displacements. Use --position-unit and --reading-unit."
                )
            place = reading = parse_quantity(pixel, "length", "pixel")
        else:
            if position_unit is None or reading_unit is None:
                raise InvalidInput("a foreign table has no units: give --pixel, or --position-unit and --reading-unit.")
            if len(units) != 1:
                raise InvalidInput("the channels of one table must share a unit.")
            place = convert_factor(position_unit, "m", "--position-unit")
            reading = convert_factor(reading_unit, units.pop(), "--reading-unit")
        recording = read_table(
            source,
            columns=columns.split(","),
            channels=names,
            position_factor=place,
            reading_factor=reading,
            follow=follow,
        )
    if grid is not None:
        recording = recording.gridded(parse_quantity(grid, "length", "grid"))
    written(target, lambda name: write_recording(recording, name))
    shape = "x".join(map(str, recording.readings.shape[2:]))
    typer.echo(f"wrote {target}: {len(recording.readings)} frames of {', '.join(recording.channels)}, {shape} taxels")
    if salvage:
        typer.echo(f"salvaged        {recording.meta[SALVAGED]}")
