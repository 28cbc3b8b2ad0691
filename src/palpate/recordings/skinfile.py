"""skin.toml: a pad and its arrays, with units in the values; errors name the line.

[pad]
kind = "half_space"              # "bonded_layers", or a kind that another package brings (entry point palpate.pads)
youngs_modulus = "200 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"                    # "line", "area" or "scattered"
shape = [32, 32]
pitch = "1 mm"
depth = "2 mm"                   # of the taxels below the surface
channels = ["stress_xz", "stress_yz", "stress_zz"]
aperture = "0.8 mm"              # optional
noise = "50 Pa"                  # optional; or one per channel
noise_correlation = "1 mm"       # optional; correlation length of the noise
# positions = [["0 mm", "0 mm"], ...] of a scattered plane; or positions_file = "taxels.csv" with columns x and y; with positions_unit = "mm" for bare numbers
limits = ["0 Pa", "30 kPa"]      # optional; ends of the range of a reading; "30 kPa" for -30 to 30; or one [low, high] per channel

[surface]                        # optional
shape = [48, 48]
spacing = "0.5 mm"

[stream]                         # optional: how a robot's messages become readings
topic = "/xServTopic"
path = "sensors[0].taxels"       # where the taxels are in a message; "" for an image or a Grid
fields = ["x", "y", "z"]         # fields of each
unit = "25 Pa"                   # what 1 in a message means; or one per channel; negative turns the sign

[camera]                         # optional: how pictures become displacements (`palpate.recordings.camerasection`)
scale = "0.06 mm"                # per pixel; or pitch = "2 mm" of the dots; or points = [[12, 9], ...] and places = [["-8 mm", "6 mm"], ...]

[calibration]                    # optional: written by palpate calibrate
file = "finger.calibration.npz"

[colour]                         # optional: written by palpate calibrate --ball-diameter, of gels without dots
file = "gel.colour.npz"

[columns]                        # optional: what the columns of a table of another program are (`palpate.recordings.columns`)
frame = "frame"                  # or time = "t"; marker = "id"; x and y; one key per channel, with the title of its column
pixel = "0.06 mm"                # what a 1 means; or unit (of readings) and position_unit, or units in the titles
"""

from __future__ import annotations

import functools
import inspect
import re
import tomllib
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from palpate._extras import missing
from palpate._files import small_text
from palpate.elastic.channels import channel_unit, check_channels
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.layers import BondedLayers, Layer
from palpate.elastic.pad import Pad, check_pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, PalpateError
from palpate.measured import Measured
from palpate.recordings.columns import per_count
from palpate.recordings.described import check_described, metres_of
from palpate.recordings.padsection import (
    Depth,
    Length,
    Lengths,
    MeasuredTable,
    Part,
    Pressure,
    SolidBend,
    SolidBox,
    SolidDome,
    SolidMesh,
    Strict,
    Time,
    percent,
    solid_pad,
)
from palpate.recordings.recording import Recording
from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.operator import Boundary
from palpate.sensing.uncertainty import SCALE
from palpate.units import KIND_OF_SI, parse_quantity

try:
    from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError
except ImportError as error:
    raise missing("skin files", error) from error

__all__ = [
    "PADS",
    "SkinFile",
    "StreamSection",
    "key_of",
    "line_of",
    "read_skin",
    "skin_from_text",
    "skin_text",
    "validated",
]

#: Group of entry points with pads of other packages, by the ``kind`` in a skin.toml. The entry point is called with the
#: keys of [pad] as written (`palpate.units.parse_quantity` parses quantities), without ``kind``, and without ``prony``,
#: which all pads support.
PADS = "palpate.pads"
#: Kinds of pad that palpate provides.
BUILT_IN = ("half_space", "bonded_layers", "solid_box", "solid_dome", "solid_bend", "solid_mesh", "measured")


Count = Annotated[int, Field(ge=1, le=1_000_000)]


class _HalfSpace(Strict):
    kind: Literal["half_space"]
    prony: list[tuple[float, Time]] | None = None
    youngs_modulus: Pressure
    poissons_ratio: float


class _Layer(Strict):
    thickness: Length
    youngs_modulus: Pressure
    poissons_ratio: float


class _Base(Strict):
    youngs_modulus: Pressure
    poissons_ratio: float


class _BondedLayers(Strict):
    kind: Literal["bonded_layers"]
    prony: list[tuple[float, Time]] | None = None
    layer: list[_Layer] = Field(min_length=1)
    base: _Base | None = None


class _Other(BaseModel):
    """A pad of another package: the arguments of its entry point, as in the file."""

    model_config = ConfigDict(extra="allow", frozen=True)
    kind: str
    prony: list[tuple[float, Time]] | None = None


def _other_pads() -> dict[str, EntryPoint]:
    return {e.name: e for e in entry_points(group=PADS)}


def _pad_kind(table: Any) -> Any:
    kind = table.get("kind") if isinstance(table, dict) else getattr(table, "kind", None)
    return "other" if isinstance(kind, str) and kind not in BUILT_IN and kind in _other_pads() else kind


class _Plane(Strict):
    kind: Literal["line", "area", "scattered"]
    channels: list[str]
    depth: Depth
    aperture: Lengths = 0.0
    noise: str | list[str] | None = None
    noise_correlation: Length = 0.0
    limits: str | list[str] | list[str | list[str]] | None = None
    count: Count | None = None
    shape: tuple[Count, Count] | None = None
    pitch: Lengths | None = None
    center: Any = None
    positions_file: str | None = None
    positions_unit: str | None = None
    positions: list[Any] | None = None


class _Surface(Strict):
    spacing: Lengths
    count: Count | None = None
    shape: tuple[Count, Count] | None = None
    center: Any = None


class StreamSection(Strict):
    topic: str
    unit: str | list[str]
    path: str = ""
    fields: list[str] = Field(default_factory=list)
    channels: list[str] | None = None
    shape: tuple[Count, Count] | None = None
    markers: bool = False
    stamp: str = ""
    stamp_unit: str | None = None
    sort: bool = False
    definitions: str = ""


class _Camera(Strict):
    scale: Lengths | None = None
    size: tuple[Count, Count] | None = None
    pitch: Lengths | None = None
    points: list[tuple[float, float]] | None = None
    places: list[tuple[Length, Length]] | None = None
    matrix: list[list[float]] | None = None
    distortion: list[float] | None = None
    texture: Length | None = None
    roi: list[tuple[float, float]] | None = None
    distance: Length | None = None
    reference: Count = 5
    stage: bool = False


class _Uncertainty(Strict):
    youngs_modulus: Part | None = None
    thickness: Part | None = None
    depth: Part | None = None
    gain: Part | None = None
    scale: Part = SCALE


class _Calibration(Strict):
    file: str


class _Colour(Strict):
    file: str


class SkinFile(Strict):
    pad: Annotated[
        Annotated[_HalfSpace, Tag("half_space")]
        | Annotated[_BondedLayers, Tag("bonded_layers")]
        | Annotated[SolidBox, Tag("solid_box")]
        | Annotated[SolidDome, Tag("solid_dome")]
        | Annotated[SolidBend, Tag("solid_bend")]
        | Annotated[SolidMesh, Tag("solid_mesh")]
        | Annotated[MeasuredTable, Tag("measured")]
        | Annotated[_Other, Tag("other")],
        Discriminator(_pad_kind),
    ]
    plane: list[_Plane] = Field(default_factory=list)
    surface: _Surface | None = None
    boundary: Literal["free", "periodic"] = "free"
    stream: StreamSection | None = None
    camera: _Camera | None = None
    columns: dict[str, Any] | None = None
    uncertainty: _Uncertainty = _Uncertainty()
    calibration: _Calibration | None = None
    colour: _Colour | None = None


def read_skin(path: str | Path, recording: Recording | None = None) -> tuple[Pad, list[Array], Grid | None, Boundary]:
    """Read a skin.toml; returns pad, planes, surface (or None) and boundary.

    A scattered plane without ``positions`` and ``positions_file`` uses the positions of ``recording``, and an area
    plane without shape and pitch those of a gridded recording.

    Raises
    ------
    InvalidInput
        The file is not there, or an entry is missing, unknown or out of range; the message names it.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import read_skin
    >>> text = '''
    ... [pad]
    ... kind = "half_space"
    ... youngs_modulus = "200 kPa"
    ... poissons_ratio = 0.48
    ...
    ... [[plane]]
    ... kind = "line"
    ... count = 21
    ... pitch = "1 mm"
    ... depth = "2 mm"
    ... channels = ["stress_zz"]
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/skin.toml").write_text(text)
    ...     pad, planes, surface, boundary = read_skin(f"{folder}/skin.toml")
    >>> pad.youngs_modulus, planes[0].count, surface, boundary
    (200000.0, 21, None, 'free')
    """
    file = Path(path)
    return skin_from_text(skin_text(file), str(file), file.parent, recording)


def _value_with_std(data: Any, name: str) -> dict[str, Any]:
    """The file with its "+-" values as fractions in the section [uncertainty], the largest of a property."""
    fractions: dict[str, float] = {}

    def cleaned(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: plain(key, value) for key, value in part.items()}
        return [cleaned(v) for v in part] if isinstance(part, list) else part

    def plain(key: str, value: Any) -> Any:
        if key not in ("youngs_modulus", "thickness", "depth") or not isinstance(value, str):
            return cleaned(value)
        parts = re.split(r"\+-|\+/-|\u00b1", value)
        if len(parts) == 1:
            return value
        kind = "pressure" if key == "youngs_modulus" else "length"
        if len(parts) > 2 or parts[0].strip() == "base":
            raise InvalidInput(
                f'{name}: {key} = {value!r}: write a quantity and one uncertainty, such as "2 mm +- 5 %".'
            )
        size = abs(parse_quantity(parts[0].strip(), kind, key))
        if "%" in parts[1]:
            share = percent(parts[1])
        else:
            share = parse_quantity(parts[1].strip(), kind, key) / size if size else 0.0
        fractions[key] = max(fractions.get(key, 0.0), share)
        return parts[0].strip()

    out = cleaned(data)
    if not fractions:
        return dict(out)
    section = out.get("uncertainty", {})
    if not isinstance(section, dict) or set(section) & set(fractions):
        raise InvalidInput(f"{name}: {', '.join(fractions)} has an uncertainty in two places; say it once.")
    return {**out, "uncertainty": {**{k: f"{100.0 * v:.12g} %" for k, v in fractions.items()}, **section}}


def key_of(error: PalpateError) -> str:
    """The key that a message is about: its first word ("channel" refers to an entry of channels)."""
    word = str(error).partition(" ")[0]
    return {"channel": "channels", "scale": "unit"}.get(word, word)


def skin_text(found: Path) -> str:
    """The text of a skin.toml, without the byte-order mark that editors on Windows add."""
    if not found.exists():
        raise InvalidInput(
            f"{found}: no such file. A skin file describes pad and array; palpate demo writes one to start from."
        )
    if found.is_dir():
        raise InvalidInput(f"{found} is a folder; give a skin.toml.")
    return small_text(found, "a skin file")


def validated(text: str, name: str) -> SkinFile:
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also numbers of thousands of digits, and brackets in brackets
        raise InvalidInput(
            f"{name}: not valid TOML: {str(error)[:200].rstrip('.')}. A skin file describes pad and array; palpate demo writes one to start from."
        ) from error
    try:
        skin = SkinFile.model_validate(_value_with_std(data, name))
    except ValidationError as error:
        raise InvalidInput(_explain(error.errors()[0], text, name)) from error
    if not skin.plane and not isinstance(skin.pad, MeasuredTable):
        raise InvalidInput(f"{name}, line 1: there is no [plane] section.")
    return skin


def skin_from_text(
    text: str, name: str, folder: Path, recording: Recording | None = None
) -> tuple[Pad, list[Array], Grid | None, Boundary]:
    """Parse the text of a skin.toml; ``name`` is used in errors, ``folder`` is where the files that it names are."""
    skin = validated(text, name)
    keys: tuple[str | int, ...] = ("pad",)
    try:
        if isinstance(skin.pad, _BondedLayers):
            layers = []
            for i, part in enumerate(skin.pad.layer):
                keys = ("pad", "layer", i)
                layers.append(Layer(**part.model_dump()))
            keys = ("pad", "base")
            base = None if skin.pad.base is None else HalfSpace(**skin.pad.base.model_dump())
            pad: Pad = BondedLayers(layers, base)
        elif isinstance(skin.pad, _HalfSpace):
            pad = HalfSpace(youngs_modulus=skin.pad.youngs_modulus, poissons_ratio=skin.pad.poissons_ratio)
        elif isinstance(skin.pad, SolidBox | SolidDome | SolidBend | SolidMesh):
            pad = solid_pad(skin.pad, folder)
        elif isinstance(skin.pad, MeasuredTable):
            pad = Measured(folder / skin.pad.file, radius=skin.pad.contact_radius, indenter=skin.pad.indenter)
        else:
            pad = _pad_of_maker(_other_pads()[skin.pad.kind].load(), skin.pad)
        keys = ("pad",)
        planes: list[Array] = [pad.array] if isinstance(pad, Measured) and not skin.plane else []
        if skin.pad.prony is not None:
            pad = Viscoelastic(pad, skin.pad.prony)
        for i, plane in enumerate(skin.plane):
            keys = ("plane", i)
            planes.append(_plane(plane, folder, recording))
        keys = ("plane", 0) if skin.plane else ("pad",)
        if recording is not None:
            check_described(recording, planes)
        keys = ("surface",)
        surface = _surface(skin.surface, planes[0].dimensions)
    except PalpateError as error:
        raise InvalidInput(f"{name}, line {line_of(text, (*keys, key_of(error)))}: {error}") from error
    return pad, planes, surface, skin.boundary


def _pad_of_maker(maker: Any, table: _Other) -> Pad:
    """Build a pad of another package."""
    parameters = dict(table.model_extra or {})
    try:
        inspect.signature(maker).bind(**parameters)
    except TypeError as error:
        raise InvalidInput(f'kind = "{table.kind}" does not take these keys: {error}.') from error
    pad: Pad = maker(**parameters)
    check_pad(pad)
    return pad


def _need(value: Any, key: str, kind: str) -> Any:
    if value is None:
        raise InvalidInput(f'{key} is missing; a plane of kind = "{kind}" needs it.')
    return value


def _refuse(plane: _Plane, keys: tuple[str, ...]) -> None:
    for key in keys:
        if getattr(plane, key) is not None:
            raise InvalidInput(f'{key} does not belong to a plane of kind = "{plane.kind}".')


def _noise(plane: _Plane, dimensions: int) -> tuple[float, ...] | None:
    channels = check_channels(plane.channels, dimensions)
    if plane.noise is None:
        return None
    values = plane.noise if isinstance(plane.noise, list) else [plane.noise] * len(channels)
    if len(values) != len(channels):
        raise InvalidInput(f"noise must be one quantity or one per channel ({len(channels)}); got {len(values)}.")
    return tuple(parse_quantity(v, KIND_OF_SI[channel_unit(c)], "noise") for v, c in zip(values, channels))


def _limits(plane: _Plane, dimensions: int) -> list[tuple[float, float]] | None:
    """Lower and upper limit of each channel."""
    channels = check_channels(plane.channels, dimensions)
    if plane.limits is None:
        return None
    entries = [plane.limits] if isinstance(plane.limits, str) else plane.limits
    # Two quantities are the limits of all channels; a list of [low, high] pairs, or of single values s for -s to s, has
    # one entry per channel.
    one_for_all = isinstance(plane.limits, str) or (len(entries) == 2 and all(isinstance(v, str) for v in entries))
    each: list[Any] = [entries] * len(channels) if one_for_all else entries
    if len(each) != len(channels):
        raise InvalidInput(
            f"limits must be one quantity, [low, high], or one [low, high] per channel ({len(channels)}); got {len(each)}."
        )
    out = []
    for channel, ends in zip(channels, each):
        texts = [ends] if isinstance(ends, str) else ends
        ends_si = [parse_quantity(v, KIND_OF_SI[channel_unit(channel)], "limits") for v in texts]
        if len(ends_si) not in (1, 2):
            raise InvalidInput(f"limits of {channel} must be one quantity or [low, high]; got {len(ends_si)}.")
        out.append((ends_si[0], ends_si[1]) if len(ends_si) == 2 else (-ends_si[0], ends_si[0]))
    return out


def _center(value: Any, dimensions: int) -> Any:
    if value is None:
        return 0.0 if dimensions == 1 else (0.0, 0.0)
    if dimensions == 1:
        return parse_quantity(value, "length", "center")
    if not isinstance(value, list) or len(value) != 2:
        raise InvalidInput(f'center must be two lengths [x, y] such as ["1 mm", "0 mm"]; got {value!r}.')
    return tuple(parse_quantity(v, "length", "center") for v in value)


def _plane(plane: _Plane, folder: Path, recording: Recording | None) -> Array:
    if plane.kind == "line":
        _refuse(plane, ("shape", "positions_file", "positions_unit", "positions"))
        if isinstance(plane.pitch, tuple) or isinstance(plane.aperture, tuple):
            raise InvalidInput("pitch and aperture must be one length on a line.")
        return LineArray(
            count=_need(plane.count, "count", "line"),
            pitch=_need(plane.pitch, "pitch", "line"),
            depth=plane.depth,
            channels=plane.channels,
            aperture=plane.aperture,
            noise=_noise(plane, 1),
            noise_correlation=plane.noise_correlation,
            limits=_limits(plane, 1),
            center=_center(plane.center, 1),
        )
    if plane.kind == "area":
        _refuse(plane, ("count", "positions_file", "positions_unit", "positions"))
        meta = recording.meta if recording is not None and recording.readings.ndim == 4 else {}
        shape, pitch = plane.shape, plane.pitch
        if shape is None and pitch is None and recording is not None and "pitch" in meta:
            shape, pitch = (recording.readings.shape[2], recording.readings.shape[3]), metres_of(meta["pitch"])
        return AreaArray(
            shape=_need(shape, "shape", "area"),
            pitch=_need(pitch, "pitch", "area"),
            depth=plane.depth,
            channels=plane.channels,
            aperture=plane.aperture,
            noise=_noise(plane, 2),
            noise_correlation=plane.noise_correlation,
            limits=_limits(plane, 2),
            center=_center(plane.center, 2),
        )
    _refuse(plane, ("count", "shape", "pitch", "center"))
    positions = _positions(plane, folder, recording)
    return ScatteredArray(
        positions=positions,
        depth=plane.depth,
        channels=plane.channels,
        aperture=plane.aperture,
        noise=_noise(plane, positions.shape[1]),
        noise_correlation=plane.noise_correlation,
        limits=_limits(plane, positions.shape[1]),
    )


def _positions(plane: _Plane, folder: Path, recording: Recording | None) -> Any:
    """Positions of scattered taxels (taxel, axis) [m]: listed in the plane, from its file, or from the recording."""
    if plane.positions is not None:
        if plane.positions_file is not None:
            raise InvalidInput("positions_file and positions both say where the taxels are; leave one out.")
        return _listed(plane.positions, plane.positions_unit)
    if plane.positions_file is not None:
        return _of_file(folder / plane.positions_file, plane.positions_unit)
    if plane.positions_unit is not None:
        raise InvalidInput("positions_unit belongs to positions or positions_file; leave it out.")
    if recording is None or recording.positions is None:
        raise InvalidInput(
            'positions is missing, and the recording has none: list them, positions = [["0 mm", "0 mm"], ["2 mm", "0 mm"], ...], or name a table with the columns x and y in positions_file.'
        )
    positions = np.asarray(recording.positions)
    return positions if positions.ndim == 2 else positions[:, None]


def _listed(places: list[Any], unit: str | None) -> Any:
    """Positions listed in a skin.toml: [x, y] or x, each a length, or a number in the unit ``unit``."""
    each = [place if isinstance(place, list) else [place] for place in places]
    if {len(place) for place in each} not in ({1}, {2}):
        raise InvalidInput(
            f'positions must be a list of [x, y] (or of x on a line) such as [["0 mm", "0 mm"], ["2 mm", "0 mm"]]; got {places[:2]!r}.'
        )

    def length(value: Any) -> float:
        if unit is None or isinstance(value, str):
            return parse_quantity(value, "length", "positions")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InvalidInput(f"positions must be numbers or lengths; got {value!r}.")
        return value * per_count(unit, "length", "positions_unit")

    return np.array([[length(value) for value in place] for place in each])


def _of_file(path: Path, unit: str | None) -> Any:
    """Positions from a recording that has them, or from a table with the columns x and y."""
    from palpate.recordings.formats import existing, read_recording
    from palpate.recordings.tables import read_positions

    file, file_format = existing(path)
    if file_format.can("columns") and not file_format.own(file):
        return read_positions(file, unit=unit)
    if unit is not None:
        raise InvalidInput(f"positions_unit is for tables; the positions of the recording {path} are in metres.")
    recording = read_recording(file)
    if recording.positions is None:
        raise InvalidInput(f"positions_file {path} is a recording without positions.")
    places = np.asarray(recording.positions)
    return places if places.ndim == 2 else places[:, None]


def _surface(surface: _Surface | None, dimensions: int) -> Grid | None:
    if surface is None:
        return None
    if dimensions == 1:
        if surface.count is None or surface.shape is not None or isinstance(surface.spacing, tuple):
            raise InvalidInput("surface of a line array needs count and one spacing.")
        return LineGrid(count=surface.count, spacing=surface.spacing, center=_center(surface.center, 1))
    if surface.shape is None or surface.count is not None:
        raise InvalidInput("surface of an area array needs shape = [rows, columns] and spacing.")
    return AreaGrid(shape=surface.shape, spacing=surface.spacing, center=_center(surface.center, 2))


@functools.cache
def _keys() -> tuple[str, ...]:
    """Every key of a skin file, for suggestions if one is misspelt."""
    schema = SkinFile.model_json_schema()
    tables = (schema, *schema["$defs"].values())
    return tuple(dict.fromkeys(key for table in tables for key in table.get("properties", ())))


def _likely_keys(key: str) -> str:
    """Likely keys for a misspelt one."""
    import difflib

    matches = difflib.get_close_matches(key, _keys(), n=1, cutoff=0.7)
    return (
        f": is {matches[0]} meant?"
        if matches and matches[0] != key
        else "; the page on skin.toml lists those of each section"
    )


def _explain(error: Mapping[str, Any], text: str, name: str) -> str:
    location = tuple(p for p in error["loc"])
    # pydantic also names the branch of a union that it tried
    branches = ("float", "str", "other", *BUILT_IN)
    keys = tuple(p for p in location if not (isinstance(p, str) and ("[" in p or p in branches)))
    while keys and isinstance(keys[-1], int):  # an entry of a list: name the list
        keys = keys[:-1]
    key = next((str(p) for p in reversed(keys) if isinstance(p, str)), "file")
    line = line_of(text, keys)
    message = str(error["msg"]).removeprefix("Value error, ")
    kind = error["type"]
    if kind == "missing":
        section = ".".join(str(k) for k in keys[:-1] if isinstance(k, str))
        place = f"[{section}] has no {key}" if section else f"there is no [{key}] section"
        return f"{name}, line {line}: {place}."
    if kind == "extra_forbidden":
        return f"{name}, line {line}: {key} is not a key here{_likely_keys(str(key))}."
    if kind.startswith("union_tag"):
        kind_in_file = (error.get("ctx") or {}).get("tag")
        got = f"; got {str(kind_in_file)!r}" if kind_in_file else ""
        accepted = " or ".join(f'"{k}"' for k in (*BUILT_IN, *_other_pads()))
        return f"{name}, line {line_of(text, (*keys, 'kind'))}: kind must be {accepted}{got}."
    message = (
        re.sub(r"^(length|pressure|time)\b", key, message)
        .replace("length = ", f"{key} = ")
        .replace("pressure = ", f"{key} = ")
    )
    if kind != "value_error":
        message = f"{key}: {message[:1].lower()}{message[1:]}; got {error['input']!r}"
    return f"{name}, line {line}: {message.rstrip('.')}."


def line_of(text: str, keys: tuple[str | int, ...]) -> int:
    """Line number of a key such as ("plane", 1, "pitch"), or of its section if the key is missing."""
    lines = text.splitlines()
    key = keys[-1] if len(keys) > 1 and isinstance(keys[-1], str) else None
    place = keys[:-1] if key is not None else keys
    # for nested tables, search the innermost numbered one by its dotted name
    section = ".".join(k for k in place if isinstance(k, str))
    index = next((k for k in reversed(place) if isinstance(k, int)), 0)
    top = re.compile(rf"^\s*{re.escape(section)}\s*=")
    header = re.compile(rf"^\s*\[{{1,2}}\s*{re.escape(section)}\s*\]{{1,2}}")
    any_header = re.compile(r"^\s*\[[\[\w]")
    count, start = -1, 1
    for number, line in enumerate(lines, 1):
        if top.match(line) and key is None:
            return number
        if header.match(line):
            count += 1
            if count == index:
                start = number
                break
    else:
        return 1
    if key is not None:
        for number in range(start + 1, len(lines) + 1):
            if any_header.match(lines[number - 1]):
                break
            if re.match(rf"^\s*{re.escape(str(key))}\s*=", lines[number - 1]):
                return number
    return start
