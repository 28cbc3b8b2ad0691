"""Functions shared by the commands that take pictures."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from palpate._numbers import plain_number
from palpate.cli.files import (
    check_outputs,
    finish_stream,
    provenance,
    rows_in_part_file,
    save_figure,
    skin_files,
    skin_text,
    write_frame,
)
from palpate.cli.options import check_picture, check_watched, grasp_monitor
from palpate.errors import InvalidInput
from palpate.units import UNKNOWN

if TYPE_CHECKING:
    from palpate.skin import Skin

#: Assumed pitch of dots [m], number of dots used for an estimate of the errors, and relative half-width from which an
#: interval counts as wide.
DOTS, THINNED, ROUGH = 2e-3, 120, 0.5

__all__ = ["assumed_skin", "roughly", "skin_path", "track_pictures"]


def skin_path(skin_file: Path) -> Path:
    """Return the path of a skin.toml: the given file, or that of a known sensor with this name."""
    from palpate.sensors import presets

    if skin_file.exists() or skin_file.suffix or skin_file.name not in presets():
        return skin_file
    if f'= "{UNKNOWN}"' in presets()[skin_file.name].text:
        raise InvalidInput(
            f'too little of {skin_file.name} is published to use it as it is: palpate sensors {skin_file.name} --out gel.toml, replace what says "{UNKNOWN}" there, and give --skin gel.toml.'
        )
    return Path(str(resources.files("palpate.sensors").joinpath(f"{skin_file.name}.toml")))


def assumed_skin(skin_file: Path) -> tuple[Skin, str]:
    """The skin of a file, and what was assumed: a typical pattern where a camera's dots are not described."""
    from palpate.camera import dot_grid, gel_skin
    from palpate.recordings import read_camera
    from palpate.skin import Skin

    settings = read_camera(skin_file)
    if settings is None:
        return Skin.from_file(skin_file), ""
    pitch = settings.pitch if settings.pitch is not None else DOTS
    pitch = float(np.mean(settings.texture if settings.texture is not None else pitch))
    shape = (7, 10)
    if settings.size is not None and settings.scale is not None:
        across, up = np.broadcast_to(np.asarray(settings.scale, dtype=np.float64), 2) * np.asarray(settings.size)
        shape = (max(3, min(12, int(up / pitch))), max(3, min(12, int(across / pitch))))
    said = f"{shape[0]} x {shape[1]} dots {1e3 * pitch:.3g} mm apart are assumed: the pictures show where yours are"
    return gel_skin(skin_file, dot_grid(shape, pitch)), said


def roughly(skin: Skin | str | Path, positions: Any) -> str:
    """Return a warning if dots measure the normal force only roughly, else ""."""
    from palpate.camera import gel_skin
    from palpate.pads import expected_force

    thinned = np.asarray(positions)[:: max(1, len(positions) // THINNED)]
    found = expected_force(gel_skin(skin, thinned))
    if found is None or found.normal < ROUGH:
        return ""
    return (
        f"expected error of a typical press on these dots: {found}. Sideways motion of dots on the surface hardly depends on pressure, so that no camera helps; dots 0.5 to 1 mm deep "
        "(or a map of depth, in Python) show pressure two to three times better"
    )


#: From this number of zero pictures on, their spread shows whether the gel was still.
CHECKS_ITSELF = 3


def track_pictures(
    source: Path,
    skin_file: Path,
    *,
    out: Path | None,
    baseline: int,
    every: int | None,
    fast: bool,
    rate: float | None,
    picture: Path | None,
    plot_forces: Path | None,
    options: Mapping[str, Any],
    limits: tuple[str | None, str | None],
    force: bool,
) -> None:
    """Track a gel in pictures: `palpate track VIDEO`."""
    import contextlib

    from palpate.camera import follow, overlay
    from palpate.recordings import recorder
    from palpate.recordings.files import in_place
    from palpate.recordings.formats import file_format
    from palpate.touch import Forces

    skin_file = skin_path(skin_file)
    kind = None if out is None else file_format(out, task="write_touch")
    inputs = [source, *skin_files(skin_file)]
    check_outputs({"--out": out, "--picture": picture, "--plot-forces": plot_forces}, inputs=inputs, force=force)
    for path in (picture, plot_forces):
        if path is not None:
            check_picture(path)
    if fast and every is not None:
        raise InvalidInput("--fast follows all pictures with a tracker: leave out --every.")
    record = provenance(skin_text(skin_file), str(source))
    touches, lost, taken, marks, strongest = [], [], [], [], None
    forces = Forces()
    with contextlib.ExitStack() as stack:
        stream = stack.enter_context(
            follow(
                source,
                skin_file,
                reference=baseline or None,
                rate=rate,
                track=True if fast else None,
                every=every or 1,
                **options,
            )
        )
        skin, readings = stream.skin, stream.readings
        check_watched(skin, *limits)
        monitor = grasp_monitor(skin, options.get("friction"), *limits, lambda event: typer.echo(str(event)))
        typer.echo(
            f"{len(readings.positions)} {'dots' if readings.texture is None else 'places of a texture'}, {1e3 * float(np.ptp(readings.positions[:, 0])):.1f} x {1e3 * float(np.ptp(readings.positions[:, 1])):.1f} mm; "
            + ("" if readings.region is None else f"the gel is {100 * readings.region.share:.0f} % of the picture; ")
            + (
                "followed by a tracker"
                if stream.tracker is not None
                else "each picture is solved by itself, seconds each (--every 10 takes fewer, --fast follows all)"
            )
        )
        if 0 < baseline < CHECKS_ITSELF:
            typer.echo(
                f"warning: the zero is {baseline} picture{'s' if baseline > 1 else ''}, and nothing shows whether something touched in "
                f"{'them' if baseline > 1 else 'it'}; every force would be off by it. Give more untouched pictures: --baseline 5.",
                err=True,
            )
        if limit := roughly(skin_file, readings.positions):
            typer.echo(limit)
        sink = None
        if out is not None and kind in ("mcap", "netcdf", "zarr"):
            name = stack.enter_context(in_place(out)) if out.exists() else out
            channels = tuple(skin.planes[0].channels)
            sink = stack.enter_context(recorder(name, channels, positions=readings.positions, meta=record))
        keep = stack.enter_context(rows_in_part_file(forces, out if kind == "csv" else None))
        for touch in stream:
            reading = stream.last
            if reading is None:
                continue
            lost.append(float(np.isnan(reading.values[0]).mean()))
            events = monitor.update(touch) if "z" in touch.components else []
            marks += events
            forces.add(touch, events)
            load = float(np.linalg.norm(np.asarray(touch.force, dtype=np.float64)))
            if (
                picture is not None
                and reading.image is not None
                and load >= 0.0
                and (strongest is None or load > strongest[0])
            ):
                strongest = (load, reading.image, touch)
            if sink is not None:
                write_frame(sink, reading.time, reading.values, touch, events)
            elif kind not in (None, "csv"):
                touches.append(touch)
            taken.append((reading.time, np.asarray(touch.force, dtype=np.float64)))
            keep()
        health = None if stream.tracker is None else stream.tracker.health
        notes, faults = list(readings.pictures.notes), dict(readings.faults)
        view = readings.view
    finish_stream(touches, forces, marks, out=out, plot_forces=plot_forces, record=record)
    if strongest is not None and picture is not None:
        save_figure(overlay(strongest[1], strongest[2], view, show="all"), picture)
    _print_outcome(taken, lost, faults, notes, "dots" if readings.texture is None else "places")
    if health is not None:
        typer.echo(str(health))
    for path in (out, picture, plot_forces):
        if path is not None:
            typer.echo(f"wrote           {path}")


def _print_outcome(
    taken: list[tuple[float, Any]], lost: list[float], faults: dict[int, str], notes: list[str], what: str
) -> None:
    """Print how many pictures were used and what happened to the others."""
    loads = np.array([force for _, force in taken])
    times = [time for time, _ in taken]
    if np.isfinite(loads[:, -1]).any():
        at = int(np.nanargmax(loads[:, -1]))
        across = float(np.hypot(*loads[at, :2]))
        typer.echo(
            f"largest force   {plain_number(loads[at, -1], 3)} N, across {plain_number(across, 3)} N, at {times[at]:.3f} s"
        )
    typer.echo(
        f"pictures        {len(taken)}, {what} lost {100 * float(np.mean(lost)):.1f} % (most in one: {100 * max(lost):.0f} %)"
    )
    said: dict[str, list[int]] = {}
    for index, fault in faults.items():
        said.setdefault(fault, []).append(index)
    for fault, which in said.items():
        typer.echo(f"warning: picture{'s' if len(which) > 1 else ''} {_list_indices(which)}: {fault}.", err=True)
    for note in notes:
        typer.echo(f"warning: {note}", err=True)


def _list_indices(which: list[int]) -> str:
    return ", ".join(map(str, which[:6])) + (f" and {len(which) - 6} more" if len(which) > 6 else "")
