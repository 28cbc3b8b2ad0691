"""Read tables of other programs as recordings (frames x markers), by a `TableMapping`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, UncheckedInput
from palpate.recordings.clock import Clock, read_clock, unit_of_name
from palpate.recordings.columns import NUMBER, TableMapping, suggested
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Table, Titles, first_titles, read_table_text
from palpate.units import KIND_OF_SI, UNITS

__all__ = ["check_distinct", "check_one_frame", "explained", "is_frame", "plain_name", "read_mapped"]

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
#: If there are more cells of frames x markers than this per line of the table, the markers change from frame to frame.
MAX_CELLS_PER_LINE = 4
#: Positions for displacements may differ between frames by this fraction of the largest displacement, because they are
#: rounded.
ROUNDED = 0.1
#: If at least this fraction of markers pass their neighbours in one frame, the numbers are reassigned from frame to
#: frame.
RENUMBERED = 0.2
#: Column titles that identify recordings.
_EPISODES = ("episode_index", "episode", "episode_id")
#: Column titles that identify frames or times.
_FRAMES = ("frame", "frames", "frame_number", "frame_id", "frame_no", "frameid", "image", "time", "t", "timestamp")


def read_mapped(
    path: Path, mapping: TableMapping, *, read: Callable[[Path, Callable[[Titles], list[int]]], Table] = read_table_text
) -> Recording:
    """The recording in a table; ``read`` reads the columns, also of binary files.

    Raises
    ------
    InvalidInput
        Columns that are not there, no unit, lines that cannot be numbers, a marker that is twice in a frame or in the place of another, markers that
        move without numbers or have no rest, or are numbered again from frame to frame.
    """
    roles: dict[str, list[int]] = {}
    labels: list[list[str]] = []

    def wanted(titles: Titles) -> list[int]:
        for role, columns in _named(mapping).items():
            names, roles[role] = _places(titles, columns, mapping.wide)
            if names and role != "time":
                labels.append(names)
        if not mapping.wide and mapping.frame is None and mapping.time is None:
            roles["unnamed frame"] = [i for i, n in enumerate(titles.names) if is_frame(n)][:1]
        if mapping.only is not None:
            roles["only"] = [titles.find(mapping.chosen[0])]
        else:
            roles["episode"] = [i for i, n in enumerate(titles.names) if plain_name(n) in _EPISODES][:1]
        return [i for places in roles.values() for i in places]

    table = _chosen(path, mapping, read(path, wanted), roles)
    for role, places in roles.items():
        if role not in ("time", "unnamed frame") and table.dated & set(places):
            title = table.titles.names[min(table.dated & set(places))]
            raise InvalidInput(
                f"{path}: the column {title!r} holds dates or times of day, but {role} must be a number; name another column for it."
            )
    parts: dict[str, Floats] = {}
    start = 0
    for role, places in roles.items():
        parts[role] = table.values[:, start : start + len(places)]
        start += len(places)
    factors = _factors(mapping, table.titles, roles)
    unit = _time_unit(mapping, table, roles)
    parts = {role: values * factors.get(role, 1.0) for role, values in parts.items()}
    if "time" in parts:  # a date and the time of the day
        parts["time"] = parts["time"].sum(axis=1, keepdims=True)
    frames = _wide(path, table, mapping, parts, labels) if mapping.wide else _long(path, table, mapping, parts)
    rate = mapping.rate or 1.0
    if frames.stamps is None:
        return _recording(path, mapping, frames, Clock(np.arange(len(frames.number)) / rate))
    by_frame_number = mapping.time is None
    clock = read_clock(
        frames.stamps / rate if by_frame_number else frames.stamps,
        source=str(path),
        unit=1.0 if by_frame_number else unit,
        count=1.0 / rate if by_frame_number else None,
        sort=mapping.sort,
        remedy="add sort=true to --map, or sort = true to [columns] in the skin.toml",
        untimed="leave out time and give rate, such as rate=50 in --map",
    )
    clock.tell()
    return _recording(path, mapping, frames.ordered(clock.order), clock)


def _chosen(path: Path, mapping: TableMapping, table: Table, roles: dict[str, list[int]]) -> Table:
    """The lines to use, by the filter ``only``; several episodes in one table are several recordings."""
    first_column, start = {}, 0
    for role, places in roles.items():
        first_column[role], start = start, start + len(places)
    if mapping.only is not None:
        value = table.values[:, first_column["only"]]
        selected = value == mapping.chosen[1]
        if not selected.any():
            values = ", ".join(f"{v:g}" for v in np.unique(value[np.isfinite(value)])[:12])
            raise InvalidInput(
                f"{path}: no line has {mapping.only}; {mapping.chosen[0]} is {values or 'never a number'}."
            )
        return replace(table, values=table.values[selected], lines=table.lines[selected])
    if roles["episode"]:
        episodes = np.unique(table.values[:, first_column["episode"]])
        if len(episodes) > 1:
            title = next(n for n in table.titles.names if plain_name(n) in _EPISODES)
            raise InvalidInput(
                f"{path}: the column {title} holds {len(episodes)} values, {episodes[0]:g} to {episodes[-1]:g}: each episode is a recording of its own. Name one with "
                f'only={title}={episodes[0]:g} in --map (only = "{title}={episodes[0]:g}" in the section [columns]).'
            )
    return table


@dataclass(eq=False)
class _Frames:
    """All data by frame and marker."""

    number: Floats  # number of each frame, as in the table
    stamps: Floats | None  # time of each frame, as in the table; None: use the numbers
    marker: Floats  # number of each marker
    numbered: bool  # whether the table has these numbers
    places: Floats | None  # (frame, marker, axis) [m]
    readings: Floats | None  # (frame, channel, marker)

    def ordered(self, order: Ints | None) -> _Frames:
        """A copy with the frames in another order."""
        if order is None:
            return self
        parts = (None if a is None else a[order] for a in (self.number, self.stamps, self.places, self.readings))
        number, stamps, places, readings = parts
        return _Frames(self.number if number is None else number, stamps, self.marker, self.numbered, places, readings)


def _named(mapping: TableMapping) -> dict[str, Any]:
    named = {"frame": mapping.frame, "time": mapping.time, "marker": mapping.marker, "x": mapping.x, "y": mapping.y}
    return {k: v for k, v in (*named.items(), *mapping.channels.items()) if v is not None}


def _places(titles: Titles, columns: str | Sequence[str], wide: bool) -> tuple[list[str], list[int]]:
    """Names of the columns (in a wide table those of all taxels), and their indices."""
    if isinstance(columns, str):
        places = titles.sliced(columns)
        if places is not None:
            return [str(i) for i in range(len(places))], places
        if NUMBER not in columns:
            return [], [titles.find(columns)]
        matches = titles.matching(columns)
        return list(matches), list(matches.values())
    if not wide:  # columns that together name a marker
        return [], [titles.find(c) for c in columns]
    return [str(i) for i in range(len(columns))], [titles.find(c) for c in columns]


def is_frame(title: str) -> bool:
    """Whether the title of a column identifies frames or times."""
    return plain_name(title) in _FRAMES


def plain_name(title: str) -> str:
    """A title without its unit, in lower case."""
    return title.split("(")[0].split("[")[0].strip().lower().replace(" ", "_")


def _factors(mapping: TableMapping, titles: Titles, roles: dict[str, list[int]]) -> dict[str, float]:
    """Factors of each role to SI units, from the mapping or the title."""
    channels = list(mapping.channels)
    scales = np.broadcast_to(np.nan if mapping.scale is None else np.asarray(mapping.scale, float), (len(channels),))
    place = np.broadcast_to(np.nan if mapping.position_scale is None else np.asarray(mapping.position_scale), (2,))
    stated_factors = {
        **{c: (float(s), channel_unit(c)) for c, s in zip(channels, scales)},
        "x": (float(place[0]), "m"),
        "y": (float(place[1]), "m"),
    }
    factors = {}
    for role, (factor, si) in stated_factors.items():
        if role not in roles:
            continue
        units = UNITS[KIND_OF_SI[si]]
        title = titles.names[roles[role][0]]
        title_units = {titles.unit(i) for i in roles[role]}
        if len(title_units) > 1 and any(unit in units for unit in title_units):
            raise InvalidInput(
                f"{titles.source}: the columns of {role} have several units in their titles; save them in one."
            )
        unit = title_units.pop()
        if unit in units and unit is not None:
            if np.isfinite(factor) and not np.isclose(factor, units[unit], rtol=1e-9):
                _refuse_two_units(titles, title, unit, factor, si)
            factor = units[unit]
        elif not np.isfinite(factor):
            key = "position_unit" if role in ("x", "y") else "unit"
            raise InvalidInput(
                f"{titles.source}: no unit says what a 1 in the column {title!r} means: give {key} (such as {_example(si)}), or pixel = the size of a pixel where positions "
                "and displacements are in pixels."
            )
        factors[role] = factor
    return factors


def _time_unit(mapping: TableMapping, table: Table, roles: dict[str, list[int]]) -> float | None:
    """Length of the time unit in seconds, from the mapping or the title; None if neither states it. Dates are in seconds already."""
    places = roles.get("time", [])
    titles = table.titles
    if table.dated & set(places):
        if mapping.time_scale is not None:
            raise InvalidInput(f"{titles.source}: its times are dates or times of day: leave out time_unit.")
        return 1.0
    title = titles.names[places[0]] if places else ""
    named = unit_of_name(title) if titles.titled else None
    if (
        mapping.time_scale is not None
        and titles.unit(places[0]) is not None
        and named not in (None, mapping.time_scale)
    ):
        _refuse_two_units(titles, title, f"{named:g} s", mapping.time_scale, "s")
    return mapping.time_scale if mapping.time_scale is not None else named


def _refuse_two_units(titles: Titles, title: str, unit: str, factor: float, si: str) -> None:
    raise InvalidInput(
        f"{titles.source}: the title {title!r} says {unit}, but a 1 is said to be {factor:g} {si}; leave out the one that is wrong."
    )


def _example(si: str) -> str:
    return {"m": '"0.06 mm"', "Pa": '"25 Pa"', "1": '"1e-6 1"', "rad": '"1 mrad"'}.get(si, f'"1 {si}"')


def _whole(path: Path, table: Table, values: Floats, column: str) -> None:
    bad = ~(np.isfinite(values) & (values == np.round(values)))
    if bad.any():
        first = int(np.argmax(bad))
        raise InvalidInput(
            f"{path}, line {int(table.lines[first])}: {column} must be a whole number; got {values[first]:g}."
            + (" A column of seconds is named time." if column == "frame" else "")
        )


# -- one line per frame and marker -------------------------------------------------------------------------------------


def _long(path: Path, table: Table, mapping: TableMapping, parts: dict[str, Floats]) -> _Frames:
    table, parts = _with_markers(path, table, mapping, parts)
    rows = len(table.values)
    flat = {role: values[:, 0] for role, values in parts.items() if values.shape[1]}
    if "unnamed frame" in flat:
        title = next(n for n in table.titles.names if is_frame(n))
        check_one_frame(path, title, flat["unnamed frame"])
    if mapping.frame is not None:
        _whole(path, table, flat["frame"], "frame")
    elif mapping.time is not None and not np.isfinite(flat["time"]).all():
        raise InvalidInput(f"{path}: {int(np.isnan(flat['time']).sum())} lines have no time; take them out.")
    key = flat["frame"] if mapping.frame is not None else flat["time"] if mapping.time is not None else np.zeros(rows)
    count = len(np.unique(key))
    positions = np.stack([flat[a] for a in "xy" if a in flat], axis=-1) if "x" in flat else None
    if mapping.marker is not None:
        for values in parts["marker"].T:
            _whole(path, table, values, "marker")
        markers, marker = np.unique(parts["marker"], axis=0, return_inverse=True)
        marker = np.ravel(marker)
        if markers.shape[1] > 1:  # rows and columns: in their order
            markers = _counted(path, mapping, markers, positions is None)
        else:
            markers = markers[:, 0]
    elif positions is not None:
        markers, marker = _by_place(path, table, positions, count)
    else:
        raise InvalidInput(
            f"{path}: nothing says which marker a line belongs to: name marker (its number), or x and y."
        )
    numbers, frame = _frames_of(key, marker, len(markers), mapping.sort)
    size = len(numbers) * len(markers)
    largest_frame = int(np.bincount(frame).max())
    if size > MAX_CELLS_PER_LINE * rows and len(markers) > MAX_CELLS_PER_LINE * largest_frame:
        raise InvalidInput(
            f"{path}: {len(markers)} markers in {len(numbers)} frames of at most {largest_frame}: they are renumbered from frame to frame. "
            + (
                f"If {mapping.time} differs a little within a frame, name the frame column instead. "
                if mapping.frame is None
                else ""
            )
            + "Let the program that found them follow them, so that a marker keeps its number, and save the table again."
        )
    cell = frame * len(markers) + marker
    order = np.argsort(cell, kind="stable")
    double = np.flatnonzero(np.diff(cell[order]) == 0)
    if len(double):
        a, b = sorted(int(table.lines[i]) for i in order[double[0] : double[0] + 2])
        who = f"marker {markers[marker[order[double[0]]]]:g}" if mapping.marker is not None else "one place"
        if mapping.frame is None and mapping.time is None:
            raise InvalidInput(
                f"{path}, lines {a} and {b}: {who} is there twice. A table of several frames needs the name of its frame column (frame or time; the table has "
                f"{table.titles.listed()}); in a table of one frame, take one of the lines out."
            )
        raise InvalidInput(f"{path}, lines {a} and {b}: {who} is twice in frame {numbers[frame[order[double[0]]]]:g}.")

    def by_frame(values: Floats) -> Floats:
        out = np.full(size, np.nan)
        out[cell] = values
        return out.reshape(len(numbers), len(markers))

    readings = [by_frame(flat[c]) for c in mapping.channels]
    return _Frames(
        numbers,
        _stamps(path, mapping, numbers, None if "time" not in flat else by_frame(flat["time"])),
        markers,
        mapping.marker is not None,
        None if positions is None else np.stack([by_frame(w) for w in positions.T], axis=-1),
        np.stack(readings, axis=1) if readings else None,
    )


def _frames_of(key: Floats, marker: Ints, markers: int, sort: bool) -> tuple[Floats, Ints]:
    """The number of each frame, and the index of the frame of each line.

    If the lines of each frame are consecutive, frames keep the order of the table, and a repeated number is a new
    frame: the counter restarted. Otherwise lines are grouped by the number of their frame.
    """
    first = np.diff(key, prepend=np.nan) != 0
    piece = np.cumsum(first) - 1
    lines = np.bincount(piece)
    numbers, frame = np.unique(key, return_inverse=True)
    repeated = len(np.unique(frame * markers + marker)) < len(key)
    consecutive = len(np.unique(piece * markers + marker)) == len(key) and 2 * lines.min() > markers
    if not sort and (len(lines) == len(numbers) or (repeated and consecutive)):
        return key[first], piece
    return numbers, np.ravel(frame)


def _with_markers(
    path: Path, table: Table, mapping: TableMapping, parts: dict[str, Floats]
) -> tuple[Table, dict[str, Floats]]:
    """Drop lines without a marker, such as spots that a tracker could not link."""
    if mapping.marker is None:
        return table, parts
    numbers = parts["marker"]
    unlinked: Bools = np.asarray(np.isnan(numbers).any(axis=1))
    if numbers.shape[1] == 1:  # -1 of several spots of a frame is no number of one
        loose: Bools = np.asarray(numbers[:, 0] == -1)
        key = next((parts[r][:, 0] for r in ("frame", "time") if r in parts), np.zeros(len(numbers)))
        if np.unique(key[loose]).size < loose.sum():
            unlinked |= loose
    if not unlinked.any():
        return table, parts
    if unlinked.all():
        raise InvalidInput(f"{path}: no line has a number in the column of markers; name another column as marker.")
    _warn(
        f"{path}: {int(unlinked.sum())} of {len(unlinked)} lines belong to no marker (no number of one) and are left out."
    )
    return (
        replace(table, values=table.values[~unlinked], lines=table.lines[~unlinked]),
        {role: values[~unlinked] for role, values in parts.items()},
    )


def _counted(path: Path, mapping: TableMapping, markers: Floats, placeless: bool) -> Floats:
    """Single numbers for markers that several columns identify; without positions they must fill a grid."""
    each = [np.unique(axis) for axis in markers.T]
    grid_size = math.prod(len(axis) for axis in each)
    if placeless and (grid_size != len(markers) or any(np.any(np.diff(axis) != 1) for axis in each)):
        names = " and ".join(mapping.marker or ())
        raise InvalidInput(
            f"{path}: {len(markers)} markers do not fill the {' x '.join(str(len(axis)) for axis in each)} places of {names}: name x and y, or add lines with empty "
            "readings for those that are missing."
        )
    return np.arange(len(markers), dtype=np.float64)


def _by_place(path: Path, table: Table, positions: Floats, frames: int) -> tuple[Floats, Ints]:
    """Number markers by their positions: in rows along x."""
    missing = ~np.isfinite(positions).all(axis=1)
    if missing.any():
        raise InvalidInput(f"{path}, line {int(table.lines[int(np.argmax(missing))])}: no position; take the line out.")
    places, marker = np.unique(positions[:, ::-1], axis=0, return_inverse=True)
    if frames > 1 and len(places) * frames > 2 * len(positions):
        raise InvalidInput(
            f"{path}: {len(places)} places in {frames} frames of {len(positions) // frames} or so: markers move, and no column numbers them. Name the column of "
            f"their numbers as marker; the table has {table.titles.listed()}."
        )
    return np.arange(len(places), dtype=np.float64), np.ravel(marker)


def check_one_frame(path: Path, title: str, values: Floats) -> None:
    """Raise an error for a table with several frames that is read as a single one."""
    count = len(np.unique(values[np.isfinite(values)]))
    if count > 1:
        raise InvalidInput(
            f"{path}: the column {title!r} holds {count} different values: these are several frames. Name it: frame={title} (or time={title}) in --map or in the section [columns] of "
            "the skin.toml; if all lines are one frame, take this column out of the file."
        )


def _stamps(path: Path, mapping: TableMapping, numbers: Floats, time: Floats | None) -> Floats | None:
    """The time of each frame in the table, or NaN."""
    if time is None or mapping.frame is None:
        return numbers if mapping.frame is not None or mapping.time is not None else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a frame without a time
        low, high = np.nanmin(time, axis=1), np.nanmax(time, axis=1)
    step = float(np.nanmedian(np.abs(np.diff(low)))) if np.isfinite(low).sum() > 1 else np.inf
    if (high - low > 0.5 * step).any():
        at = int(np.nanargmax(high - low))
        raise InvalidInput(
            f"{path}: the times of frame {numbers[at]:g} go from {low[at]:g} to {high[at]:g}; a frame has one time. Leave out time and give rate."
        )
    return np.asarray(low)


# -- one line per frame ------------------------------------------------------------------------------------------------


def _wide(
    path: Path, table: Table, mapping: TableMapping, parts: dict[str, Floats], labels: Sequence[Sequence[str]]
) -> _Frames:
    rows, names = len(table.values), labels[0]
    for columns in labels:
        if columns != names:
            odd = sorted(set(columns) ^ set(names))[:8] or [f"{len(names)} and {len(columns)}"]
            raise InvalidInput(
                f"{path}: the columns of x, y and the channels do not belong to the same taxels: {', '.join(odd)}. Name as many for each."
            )
    if "frame" in parts:
        _whole(path, table, parts["frame"][:, 0], "frame")
    stamps = next((parts[role][:, 0] for role in ("time", "frame") if role in parts), None)
    numbers = parts["frame"][:, 0] if "frame" in parts else np.arange(rows, dtype=np.float64)
    positions = np.stack([parts[a] for a in "xy" if a in parts], axis=-1) if "x" in parts else None
    readings = np.stack([parts[c] for c in mapping.channels], axis=1) if mapping.channels else None
    numbered = all(n.isdecimal() for n in names)
    markers = np.array(names, dtype=np.float64) if numbered else np.arange(len(names), dtype=np.float64)
    return _Frames(numbers, stamps, markers, numbered, positions, readings)


# -- common part ---------------------------------------------------------------------------------------------------------


def _recording(path: Path, mapping: TableMapping, frames: _Frames, clock: Clock) -> Recording:
    positions = None
    channels = tuple(mapping.channels)
    if frames.places is not None:
        positions, readings = _rest_positions(path, mapping, frames)
        channels = channels or ("displacement_x", "displacement_y")
        check_distinct(path, positions, [f"{m:g}" for m in frames.marker] if frames.numbered else None)
        if set(channels) >= {"displacement_x", "displacement_y"}:
            _check_order(path, frames, positions, readings[:, [channels.index(f"displacement_{a}") for a in "xy"]])
    else:
        readings = frames.readings
        _check_counted(path, frames)
    missing = int(np.isnan(readings).any(axis=1).sum())
    meta = {
        "source": path.name,
        "table": f"{len(readings)} frames of {readings.shape[2]} markers, {missing} of {len(readings) * readings.shape[2]} missing",
        **clock.meta(),
    }
    if mapping.shape is not None:
        readings, positions = _as_area(path, mapping.shape, readings, positions), None
    elif positions is not None and positions.shape[1] == 1:
        positions = positions[:, 0]
    return Recording(readings=readings, channels=channels, time=clock.time, positions=positions, meta=meta)


def _rest_positions(path: Path, mapping: TableMapping, frames: _Frames) -> tuple[Floats, Any]:
    """Rest positions of the markers (marker, axis), and readings (frame, channel, marker)."""
    places = frames.places
    if places is None:
        raise InvalidInput(f"{path}: there are no positions.")
    complete: Any = np.isfinite(places).all(axis=2)
    if frames.readings is None:
        complete, requirement = (
            complete[: mapping.reference],
            f"position in the first {mapping.reference} frames (reference)",
        )
    else:
        complete, requirement = complete & np.isfinite(frames.readings).all(axis=1), "whole reading in any frame"
    usable: Bools = complete.any(axis=0)
    if not usable.any():
        raise InvalidInput(f"{path}: no marker has a {requirement}.")
    if not usable.all():
        dropped = [f"{m:g}" for m in frames.marker[~usable]]
        _warn(
            f"{path}: {len(dropped)} of {len(usable)} markers have no {requirement} and are left out: {', '.join(dropped[:8])}{' ...' if len(dropped) > 8 else ''}."
        )
        frames.marker = frames.marker[usable]
        places = places[:, usable]
        frames.readings = None if frames.readings is None else frames.readings[..., usable]
    if frames.readings is None:
        rest = np.nanmean(places[: mapping.reference], axis=0)
        return rest, np.moveaxis(places - rest, 2, 1)
    spread_as_given, size = _spread(places), _extent(places)
    shift = np.zeros_like(places)
    for axis, name in enumerate(f"displacement_{a}" for a in "xy"[: places.shape[2]]):
        if name in mapping.channels:
            shift[..., axis] = frames.readings[:, list(mapping.channels).index(name)]
    moves = _spread(shift)
    allowed = max(1e-6 * size, ROUNDED * float(np.nanmax(moves, initial=0.0)))
    if np.nanmax(spread_as_given, initial=0.0) <= allowed:
        return np.nanmedian(places, axis=0), frames.readings
    rest_places = places - shift
    spread_at_rest = _spread(rest_places)
    if np.nanmax(spread_at_rest, initial=0.0) <= allowed:
        return np.nanmedian(rest_places, axis=0), frames.readings
    worst = int(np.nanargmax(np.minimum(spread_as_given, spread_at_rest)))
    raise InvalidInput(
        f"{path}: the position of marker {frames.marker[worst]:g} moves by {spread_as_given[worst]:.3g} m while its readings say {moves[worst]:.3g} m: x and y are neither places at rest nor "
        "these moved by the displacements. Either the markers are renumbered from some frame on, or displacements are counted from frame to frame: then name x and y alone, without "
        "the displacements, which follow from the first frame."
    )


def _spread(values: Floats) -> Floats:
    """Range of values over the frames, for the axis that moves most, by marker."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a marker that is never there: its spread is NaN
        return np.asarray((np.nanmax(values, axis=0) - np.nanmin(values, axis=0)).max(axis=1))


def _extent(places: Floats) -> float:
    return float(np.nanmax(places, axis=(0, 1)).max() - np.nanmin(places, axis=(0, 1)).min())


def check_distinct(path: Path, positions: Floats, names: Sequence[str] | None = None, *, unit: str = " m") -> None:
    """Raise an error for two markers at the same place."""
    from scipy.spatial import cKDTree

    if len(positions) < 2:
        return
    distances, neighbours = cKDTree(positions).query(positions, k=2)
    closest = int(np.argmin(distances[:, 1]))
    if distances[closest, 1] <= 1e-9 * float(np.ptp(positions, axis=0).max()):
        first, second = sorted(map(int, neighbours[closest]))
        who = f"markers {names[first]} and {names[second]}" if names is not None else "two lines"
        place = ", ".join(f"{v:g}" for v in positions[closest])
        raise InvalidInput(
            f"{path}: {who} are at the same place ({place}){unit}. A table of several frames needs the name of its frame column; in one frame, take one of them out."
        )


def _check_order(path: Path, frames: _Frames, rest: Floats, moved: Floats) -> None:
    """Refuse markers that pass their neighbours: a pad that does not fold keeps |u_i - u_j| < |X_i - X_j|."""
    from scipy.spatial import cKDTree

    count = min(4, len(rest) - 1)
    if count < 1 or rest.shape[1] != 2:
        return
    rest_distances, neighbours = (v[:, 1:] for v in cKDTree(rest).query(rest, k=count + 1))
    wrong = np.zeros((len(moved), len(rest)), dtype=bool)
    for i, frame in enumerate(moved):
        distances = np.hypot(*(frame[:, :, None] - frame[:, neighbours]))
        crossed, measured = distances >= rest_distances, np.isfinite(distances)
        wrong[i] = (crossed.sum(axis=1) * 2 > measured.sum(axis=1)) & measured.any(axis=1)
    if not wrong.any():
        return
    share = wrong.mean(axis=1)
    worst = int(np.argmax(share))
    first = int(np.argmax(wrong.any(axis=1)))
    if wrong[worst].sum() > max(2, RENUMBERED * wrong.shape[1]):
        raise InvalidInput(
            f"{path}: in frame {frames.number[worst]:g} {int(wrong[worst].sum())} of {wrong.shape[1]} markers have passed their neighbours, which no pad does: they are renumbered. Let the program "
            "that found them follow them, so that a marker keeps its number; or, where x, y or the displacements have another unit than is said, mend it."
        )
    who = ", ".join(f"{m:g}" for m in frames.marker[wrong[first]][:8])
    _warn(
        f"{path}: {int(wrong.sum())} readings are of markers that have passed their neighbours, which no pad does (first: marker {who} in frame {frames.number[first]:g}); they "
        "are mistaken. Take them out of the table, and they count as missing."
    )


def _check_counted(path: Path, frames: _Frames) -> None:
    """Raise an error for gaps among markers that have only numbers."""
    if not frames.numbered:
        return
    expected = np.arange(frames.marker[0], frames.marker[0] + len(frames.marker))
    if not np.array_equal(expected, frames.marker):
        gap = int(expected[np.argmax(expected != frames.marker)])
        raise InvalidInput(
            f"{path}: marker {gap} is missing between {frames.marker[0]:g} and {frames.marker[-1]:g}, so that the others cannot be assigned to taxels: name x and y, or add "
            "a line for it with empty readings."
        )


def _as_area(path: Path, shape: tuple[int, int], readings: Any, positions: Floats | None) -> Any:
    """Readings (frame, channel, y, x) of taxels in rows."""
    count = readings.shape[2]
    if count != shape[0] * shape[1]:
        raise InvalidInput(
            f'{path}: {count} taxels do not make a shape of {shape[0]} x {shape[1]} = {shape[0] * shape[1]}: correct shape in the skin.toml, or the columns that are mapped; scattered markers are a plane of kind = "scattered".'
        )
    if positions is None:
        return readings.reshape(*readings.shape[:2], *shape)
    if positions.shape[1] != 2:
        raise InvalidInput(f"{path}: taxels of an area need x and y.")
    # rows from below, each from the left
    row = np.argsort(np.argsort(positions[:, 1], kind="stable"), kind="stable") // shape[1]
    order = np.lexsort((positions[:, 0], row))
    grid = positions[order].reshape(*shape, 2)
    x, y = grid[..., 0].mean(axis=0), grid[..., 1].mean(axis=1)
    steps = [float(np.diff(a).mean()) if len(a) > 1 else 0.0 for a in (x, y)]
    regular = [
        np.abs(grid[..., 0] - (x[0] + steps[0] * np.arange(shape[1]))).max() <= 0.05 * abs(steps[0]) + 1e-12,
        np.abs(grid[..., 1] - (y[0] + steps[1] * np.arange(shape[0]))[:, None]).max() <= 0.05 * abs(steps[1]) + 1e-12,
    ]
    if not all(regular):
        raise InvalidInput(
            f'{path}: the places of the taxels are no grid of {shape[0]} x {shape[1]}. Use a plane of kind = "scattered" without positions_file, or leave out x and y.'
        )
    return readings[..., order].reshape(*readings.shape[:2], *shape)


def explained(path: Path, read: Callable[[Path], Titles] = first_titles) -> str:
    """Instructions for reading a table of another program, for an error message; ``read`` finds its titles."""
    try:
        titles = read(path)
    except InvalidInput:
        return "A table of another program needs --map, or a section [columns] in the skin.toml, that says what its columns are."
    return (
        f"It has {titles.listed()}; say what these are with --map {suggested(titles.names)}, a section [columns] in the skin.toml, or a TableMapping. Without that, "
        'a CSV has a column "time (s)" and columns like "stress_zz[0;1] (Pa)".'
    )


def _warn(text: str) -> None:
    warnings.warn(text, UncheckedInput, stacklevel=5)
