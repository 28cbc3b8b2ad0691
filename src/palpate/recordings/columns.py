"""Map the columns of another program's table to readings: role and unit of each column."""

from __future__ import annotations

import numbers
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from palpate.elastic.channels import CHANNELS, channel_unit, is_channel
from palpate.errors import InvalidInput
from palpate.recordings.tabletext import SLICE
from palpate.units import KIND_OF_SI, UNITS, is_number, parse_quantity

__all__ = ["TableMapping", "columns_of", "columns_of_text", "per_count"]

#: Placeholder of a taxel's number in the name of a column.
NUMBER = "{}"
_ROLES = ("frame", "time", "marker", "x", "y", "only")
_VALUES = ("unit", "position_unit", "pixel", "time_unit", "rate", "reference", "shape", "sort")
#: Usual column names in tables of other programs, for the mapping that an error suggests.
_USUAL = {
    "frame": ("frame", "frames", "frame_number", "frame_id", "frame_no", "frameid", "image", "img", "picture", "slice"),
    "time": ("time", "t", "timestamp", "seconds", "sec", "time_s"),
    "marker": ("marker", "track_id", "track", "particle", "marker_id", "dot_id", "dot", "taxel", "bead", "point", "id"),
    "x": ("x", "mx", "ox", "x0", "px", "pos_x", "position_x", "x_px", "cx"),
    "y": ("y", "my", "oy", "y0", "py", "pos_y", "position_y", "y_px", "cy"),
    "displacement_x": ("dx", "u", "ux", "u_x", "disp_x", "x_disp", "displacement_x"),
    "displacement_y": ("dy", "v", "uy", "u_y", "disp_y", "y_disp", "displacement_y"),
    "displacement_z": ("dz", "uz", "u_z", "disp_z", "displacement_z"),
}


@dataclass(frozen=True, kw_only=True)
class TableMapping:
    """Roles of the columns of a table: one line per frame and marker (long), or one line per frame (wide).

    A column is named by its title, with or without a unit in brackets at its end ("dx (mm)"), or by its number from 1 where it has no
    title. In a wide table the columns of x, y and each channel are listed, or written with ``{}`` for the number of the taxel ("S{}"), or as a
    slice: "tactile[0::3]" is every third of the numbers tactile[0], tactile[1], ... (or of columns tactile0, tactile1, ...) from the first on, and
    "[:]" all columns.

    Parameters
    ----------
    channels : mapping of str to str or sequence of str, optional
        Channel -> its column, or its columns. Without channels the table holds positions in every frame: ``x`` and ``y`` are needed, and
        displacement_x and displacement_y start from the position of each marker in the first ``reference`` frames.
    x, y : str or sequence of str, optional
        Positions at rest, or, beside displacements, current positions: the numbers decide, and are refused if they are neither.
    frame, time : str, optional
        Number of the frame, and its time: numbers, dates (ISO 8601, or as spreadsheets write them) or times of day; or (date, time of day), two
        columns. Without either a long table is one frame.
    marker : str or sequence of str, optional
        Number of the marker or taxel, or columns that together name it (its row and its column). Lines without it are left out, with a warning.
        Without a column of markers a place is a marker, which must not move.
    only : str, optional
        Restrict to lines with a number in a column, such as "episode_index=3".
    scale : float or sequence of float, optional
        Multiplies readings (of each channel) to SI units; negative turns the sign. Without it the titles must name units.
    position_scale : float or (float, float), optional
        Multiplies x and y to metres. Without it the titles must name units.
    time_scale : float, optional
        Multiplies times to seconds. Without it the title may name the unit (``t (ms)``, ``time_us``), else they are seconds.
    rate : float, optional
        Frames a second, without a column of time. Default: 1.
    reference : int
        Frames at the start for the rest positions of markers, without channels.
    shape : (int, int), optional
        Rows and columns of an area of taxels. With x and y, these must be its grid.
    sort : bool
        Sort the frames by time. Default: the order of the table; a restarted clock continues.

    Raises
    ------
    InvalidInput
        Channels that are not known, neither channels nor both x and y, a mixture of long and wide, or numbers out of range.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import TableMapping, read_recording
    >>> table = '''frame,id,x,y,dx,dy
    ... 0,1,10,10,0,0
    ... 0,2,50,10,0,0
    ... 1,1,10,10,2,0
    ... 1,2,50,10,1,0
    ... '''
    >>> mapping = TableMapping(
    ...     frame="frame",
    ...     marker="id",
    ...     x="x",
    ...     y="y",
    ...     channels={"displacement_x": "dx", "displacement_y": "dy"},
    ...     scale=0.06e-3,  # metres a pixel
    ...     position_scale=0.06e-3,
    ...     rate=30.0,
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/dots.csv").write_text(table)
    ...     recording = read_recording(f"{folder}/dots.csv", mapping=mapping)
    >>> recording.readings.shape, recording.readings[1, 0].round(9).tolist()  # (frame, channel, marker)
    ((2, 2, 2), [0.00012, 6e-05])
    """

    channels: Mapping[str, str | Sequence[str]] = field(default_factory=dict)
    x: str | Sequence[str] | None = None
    y: str | Sequence[str] | None = None
    frame: str | None = None
    time: str | Sequence[str] | None = None
    marker: str | Sequence[str] | None = None
    only: str | None = None
    scale: float | Sequence[float] | None = None
    position_scale: float | tuple[float, float] | None = None
    time_scale: float | None = None
    rate: float | None = None
    reference: int = 1
    shape: tuple[int, int] | None = None
    sort: bool = False

    def __post_init__(self) -> None:
        unknown = [c for c in self.channels if not is_channel(c)]
        if unknown:
            raise InvalidInput(f"{', '.join(unknown)}: no such channel; channels are {', '.join(CHANNELS)}.")
        if self.y is not None and self.x is None:
            raise InvalidInput("y is named without x; name both, or x alone on a line.")
        if not self.channels and (self.x is None or self.y is None):
            raise InvalidInput(
                "no column of readings is named: name channels such as displacement_x and displacement_y, or x and y alone where they are positions in every frame."
            )
        if not self.channels and self.shape is not None:
            raise InvalidInput("shape belongs to taxels that stay; markers known by their positions are scattered.")
        if self.wide and self.marker is not None:
            raise InvalidInput(
                "marker belongs to tables with one line per marker; these columns are listed, one line per frame."
            )
        for name, many in (("scale", len(self.channels) or 2), ("position_scale", 2)):
            self._check_scale(name, many)
        if self.only is not None:
            self.chosen  # noqa: B018 - refuses what is no COLUMN=NUMBER
        for name in ("time_scale", "rate"):
            value = getattr(self, name)
            if value is not None and not (is_number(value) and value > 0):
                raise InvalidInput(f"{name} must be a positive number; got {value!r}.")
        if not isinstance(self.sort, bool):
            raise InvalidInput(f"sort must be true or false; got {self.sort!r}.")
        if self.sort and self.time is None and self.frame is None:
            raise InvalidInput("sort puts frames in the order of their times: name the column time or frame too.")
        if self.rate is not None and self.time is not None:
            raise InvalidInput("rate and time both say when frames were; give one of them.")
        if isinstance(self.reference, bool) or not (isinstance(self.reference, int) and self.reference >= 1):
            raise InvalidInput(f"reference must be a number of frames of at least 1; got {self.reference!r}.")
        if self.channels and self.reference != 1:
            raise InvalidInput("reference is for tables of positions; here columns hold the readings: leave it out.")

    def _check_scale(self, name: str, many: int) -> None:
        given = getattr(self, name)
        if given is None:
            return
        values = [given] if isinstance(given, numbers.Real) else list(given)
        if len(values) not in (1, many) or not all(is_number(v) and v != 0 for v in values):
            raise InvalidInput(f"{name} must be one number or {many}, finite and not 0; got {given!r}.")

    @property
    def chosen(self) -> tuple[str, float]:
        """Column and value of the filter ``only``.

        Examples
        --------
        >>> from palpate.recordings import TableMapping
        >>> TableMapping(channels={"stress_zz": "S{}"}, only="episode_index=3").chosen
        ('episode_index', 3.0)
        """
        column, _, value = (self.only or "").rpartition("=")
        try:
            return column.strip(), float(value)
        except ValueError as error:
            raise InvalidInput(
                f"only must be a column and a number, such as episode_index=3; got {self.only!r}."
            ) from error

    @property
    def wide(self) -> bool:
        """Whether each line contains a complete frame.

        Examples
        --------
        >>> from palpate.recordings import TableMapping
        >>> TableMapping(channels={"stress_zz": "taxel{}"}).wide, TableMapping(frame="f", channels={"stress_zz": "counts"}).wide
        (True, False)
        """
        named = [self.x, self.y, *self.channels.values()]
        kinds = {_wide(v) for v in named if v is not None}
        if len(kinds) > 1:
            raise InvalidInput(
                f"some of x, y and the channels name one column and some several: a table has either one line per frame (all listed, or with {NUMBER}) "
                "or one line per frame and marker."
            )
        return kinds == {True}


def _wide(column: str | Sequence[str]) -> bool:
    return NUMBER in column or SLICE.fullmatch(column) is not None if isinstance(column, str) else True


def per_count(text: str, kind: str, what: str = "unit") -> float:
    """The quantity that a 1 in a file means, from text: "25 Pa", "-1 kPa", or a unit alone."""
    return parse_quantity(f"1 {text}" if text in UNITS[kind] and text != "1" else text, kind, what)


def columns_of(given: Mapping[str, Any], *, order: Sequence[str] = (), shape: Any = None) -> TableMapping:
    """The mapping described by a section [columns] or by --map.

    ``order``: channels of the skin, whose order the recording takes; ``shape``: rows and columns of its area array.
    """
    channels = {k: v for k, v in given.items() if k not in _ROLES and k not in _VALUES}
    unknown = [k for k in channels if not is_channel(k)]
    if unknown:
        raise InvalidInput(
            f"{', '.join(unknown)} is neither a channel nor a key of columns; keys are {', '.join((*_ROLES, *_VALUES))}, channels {', '.join(CHANNELS)}."
        )
    for key, value in given.items():
        if key in ("frame", "time", "marker", "only", "pixel", "position_unit", "time_unit"):
            _check_text(key, value, several=key in ("marker", "pixel", "position_unit", "time"))
        elif key in channels or key in ("x", "y", "unit"):
            _check_text(key, value, several=True)
    if set(order) == set(channels):
        channels = {c: channels[c] for c in order}
    units = [channel_unit(c) for c in channels]
    scale: Any = None
    if "pixel" in given:
        if "unit" in given or "position_unit" in given:
            raise InvalidInput("pixel already says what a 1 means; leave out unit and position_unit.")
        place = _factors(given["pixel"], ["m", "m"], "pixel")
        sideways = {"displacement_x": place[0], "displacement_y": place[1]}
        if not set(channels) <= set(sideways):
            raise InvalidInput(
                "pixel is for displacement_x and displacement_y; give position_unit, and unit with one quantity per channel."
            )
        scale = tuple(sideways[c] for c in channels)
    else:
        place = _factors(given["position_unit"], ["m", "m"], "position_unit") if "position_unit" in given else None
        if "unit" in given and not channels:
            raise InvalidInput("unit is for readings; this table holds positions: give position_unit.")
        scale = _factors(given["unit"], units, "unit") if "unit" in given else None
    own_shape = given.get("shape")
    return TableMapping(
        channels=channels,
        **{k: given[k] for k in _ROLES if k in given},
        scale=scale or None,
        position_scale=place,
        time_scale=per_count(given["time_unit"], "time", "time_unit") if "time_unit" in given else None,
        rate=_plain(given, "rate"),
        reference=_plain(given, "reference") or 1,
        shape=tuple(own_shape) if own_shape is not None else shape if channels else None,
        sort=given.get("sort", False),
    )


def _check_text(key: str, value: Any, *, several: bool) -> None:
    if isinstance(value, str) and value.strip():
        return
    if several and isinstance(value, list | tuple) and value and all(isinstance(v, str) and v.strip() for v in value):
        return
    raise InvalidInput(f"{key} must be text{' or a list of texts' if several else ''}; got {value!r}.")


def _plain(given: Mapping[str, Any], key: str) -> Any:
    value = given.get(key)
    if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise InvalidInput(f"{key} must be a number; got {value!r}.")
    return value


def _factors(text: Any, units: Sequence[str], what: str) -> Any:
    """Factors to SI units, one for each of ``units``; ``text`` is one string for all, or one for each."""
    texts = [text] * len(units) if isinstance(text, str) else list(text)
    if len(texts) != len(units):
        raise InvalidInput(f"{what} must be one quantity or {len(units)}; got {len(texts)}.")
    found = [per_count(t, KIND_OF_SI[u], what) for t, u in zip(texts, units)]
    if any(f == 0 for f in found):
        raise InvalidInput(f"{what} must not be 0; got {text!r}.")
    return tuple(found)


def columns_of_text(text: str) -> dict[str, Any]:
    """Parse the argument of --map, "frame=frame,x=x,y=y,pixel=0.06 mm": the keys of the section [columns]; a part
    without "=" is added to the list before it.
    """
    found: dict[str, list[str]] = {}
    key = ""
    for part in text.split(","):
        name, equals, value = part.partition("=")
        if equals:
            key, part = name.strip(), value
            if key in found:
                raise InvalidInput(f"--map names {key} twice.")
            found[key] = []
        if not key or not part.strip():
            raise InvalidInput(
                f"--map must be like frame=frame,marker=id,x=x,y=y,displacement_x=dx,displacement_y=dy,pixel=0.06mm; got {text!r}."
            )
        found[key].append(part.strip())
    given: dict[str, Any] = {k: v[0] if len(v) == 1 else v for k, v in found.items()}
    for name, make in (("rate", float), ("reference", int)):
        if name in given:
            try:
                given[name] = make(given[name])
            except (TypeError, ValueError) as error:
                raise InvalidInput(f"--map: {name} must be a number; got {given[name]!r}.") from error
    if "sort" in given:
        given["sort"] = {"true": True, "false": False}.get(str(given["sort"]).lower(), given["sort"])
    if "shape" in given:
        match = re.fullmatch(r"(\d{1,6})x(\d{1,6})", str(given["shape"]).lower())
        if match is None:
            raise InvalidInput(f"--map: shape must be rows x columns such as 4x6; got {given['shape']!r}.")
        given["shape"] = (int(match[1]), int(match[2]))
    return given


def _of_taxels(titles: Sequence[str]) -> str:
    """Suggest a --map for one line per frame with numbered columns: x1, y1, z1, x2 ... or S1, S2 ...; else ""."""
    families: dict[str, int] = {}
    for title in titles:
        if len(re.findall(r"\d+", title)) == 1 and not set(title) & set(",={}"):
            pattern = re.sub(r"\d+", "{}", title)
            families[pattern] = families.get(pattern, 0) + 1
    most = max(families.values(), default=0)
    if most < 4:
        return ""
    patterns = [p for p, count in families.items() if count == most]
    axes = {re.sub(r"[\W\d_]+", "", p)[-1:].lower(): p for p in patterns}
    if {"x", "y", "z"} <= set(axes):
        said = [f"stress_xz={axes['x']}", f"stress_yz={axes['y']}", f"stress_zz={axes['z']}"]
    elif len(patterns) == 1:
        said = [f"stress_zz={patterns[0]}"]
    else:
        return ""
    timed = next((t for t in titles if re.match(r"(t|time|timestamp|stamp)\b|time|stamp", t, re.IGNORECASE)), None)
    if timed is not None and not set(timed) & set(",="):
        unit = re.search(r"[_ (\[](ms|us|ns|s)\b", timed)
        said = [f"time={timed}", *([f"time_unit={unit[1]}"] if unit and "(" not in timed else []), *said]
    return f'"{",".join([*said, "unit=25Pa"])}" (where these are what the sensor feels along x, y and into the pad; with what a count means in place of 25 Pa)'


def suggested(titles: Sequence[str]) -> str:
    """Suggest a --map for these titles, using the usual names among them."""
    bare = {re.sub(r"\s*[(\[].*$", "", t).strip().lower().replace(" ", "_"): t for t in titles}
    found: dict[str, str] = {}
    for role, names in _USUAL.items():
        title = next((bare[n] for n in names if n in bare), None)
        if title is not None and "," not in title and "=" not in title:
            found[role] = title
    if "time" in found and "frame" in found:
        del found["time"]
    if not ("x" in found and "y" in found):
        if taxels := _of_taxels(titles):
            return taxels
        return 'time=TIME,stress_zz=S{},unit="25 Pa" (columns S1, S2, ... of one line per frame)'
    listed = ",".join(f"{k}={v}" for k, v in found.items())
    return f'"{listed},pixel=0.06mm" (with the size of your pixel; or unit=, position_unit=)'
