"""Sections of a skin.toml other than pad and arrays: messages, tables, pictures, and uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from palpate.elastic.channels import channel_unit, check_channels
from palpate.errors import InvalidInput, PalpateError
from palpate.recordings.camerasection import CameraSettings
from palpate.recordings.columns import TableMapping, columns_of, per_count
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.skinfile import SkinFile, StreamSection, key_of, line_of, skin_text, validated
from palpate.sensing.uncertainty import Uncertainty
from palpate.units import KIND_OF_SI

__all__ = ["read_camera", "read_columns", "read_stream", "read_uncertainty"]

T = TypeVar("T")


def read_uncertainty(path: str | Path) -> Uncertainty:
    """Uncertainty of modulus, thickness, depth, gains and scale in a skin.toml: "200 kPa +- 10 %", or a section [uncertainty].

    Raises
    ------
    InvalidInput
        As for `read_skin`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import read_uncertainty
    >>> text = '''
    ... [pad]
    ... kind = "half_space"
    ... youngs_modulus = "200 kPa +- 20 kPa"
    ... poissons_ratio = 0.48
    ...
    ... [[plane]]
    ... kind = "line"
    ... count = 21
    ... pitch = "1 mm"
    ... depth = "2 mm +- 5 %"
    ... channels = ["strain_zz"]
    ...
    ... [uncertainty]
    ... gain = "3 %"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/skin.toml").write_text(text)
    ...     print(read_uncertainty(f"{folder}/skin.toml"))
    Uncertainty(youngs_modulus=0.1, thickness=None, depth=0.05, gain=0.03, scale=0.02)
    """
    found = Path(path)
    skin = validated(skin_text(found), str(found))
    return Uncertainty(**skin.uncertainty.model_dump())


def read_stream(path: str | Path) -> TopicMapping | None:
    """Read the section [stream] of a skin.toml: how messages of a robot become readings.

    Channels are those of the planes, and the shape is that of an area plane, unless the section names others.

    Raises
    ------
    InvalidInput
        As for `read_skin`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import read_stream
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
    ...
    ... [stream]
    ... topic = "/skin"
    ... path = "taxels"
    ... unit = "kPa"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/skin.toml").write_text(text)
    ...     mapping = read_stream(f"{folder}/skin.toml")
    >>> mapping.topic, mapping.channels, mapping.scale
    ('/skin', ('stress_zz',), (1000.0,))
    """
    return _section(path, "stream", _mapping)


def _mapping(skin: SkinFile, stream: StreamSection, folder: Path) -> TopicMapping:
    channels = stream.channels if stream.channels is not None else _channels(skin)
    check_channels(list(dict.fromkeys(channels)), 2)
    units = stream.unit if isinstance(stream.unit, list) else [stream.unit] * len(channels)
    if len(units) != len(channels):
        raise InvalidInput(f"unit must be one quantity or one per channel ({len(channels)}); got {len(units)}.")
    return TopicMapping(
        topic=stream.topic,
        channels=tuple(channels),
        path=stream.path,
        fields=tuple(stream.fields),
        scale=tuple(per_count(u, KIND_OF_SI[channel_unit(c)]) for u, c in zip(units, channels)),
        shape=stream.shape if stream.shape is not None else _shape(skin),
        markers=stream.markers,
        stamp=stream.stamp,
        stamp_scale=None if stream.stamp_unit is None else per_count(stream.stamp_unit, "time", "stamp_unit"),
        sort=stream.sort,
        definitions=str(folder / stream.definitions) if stream.definitions else "",
    )


def _channels(skin: SkinFile) -> list[str]:
    return [c for p in skin.plane for c in p.channels]


def _shape(skin: SkinFile) -> tuple[int, int] | None:
    """Rows and columns of the planes, if they are areas of one shape."""
    shapes = {p.shape for p in skin.plane}
    return shapes.pop() if len(shapes) == 1 else None


def read_columns(path: str | Path, given: Mapping[str, Any] | None = None) -> TableMapping | None:
    """Read the section [columns] of a skin.toml: the columns of another program's table.

    ``given`` replaces that section. Channels are put into the order of the planes, and the shape is that of an area
    plane, unless the section names another.

    Raises
    ------
    InvalidInput
        As for `read_skin`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import read_columns
    >>> text = '''
    ... [pad]
    ... kind = "half_space"
    ... youngs_modulus = "200 kPa"
    ... poissons_ratio = 0.48
    ...
    ... [[plane]]
    ... kind = "scattered"
    ... depth = "0.5 mm"
    ... channels = ["displacement_x", "displacement_y"]
    ...
    ... [columns]
    ... frame = "frame"
    ... marker = "id"
    ... x = "x"
    ... y = "y"
    ... displacement_x = "dx"
    ... displacement_y = "dy"
    ... pixel = "0.06 mm"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/gel.toml").write_text(text)
    ...     mapping = read_columns(f"{folder}/gel.toml")
    >>> mapping.marker, mapping.scale
    ('id', (6e-05, 6e-05))
    """

    def made(skin: SkinFile, section: Mapping[str, Any], _: Path) -> TableMapping:
        return columns_of(section, order=_channels(skin), shape=_shape(skin))

    if given is None:
        return _section(path, "columns", made)
    found = Path(path)
    return made(validated(skin_text(found), str(found)), given, found.parent)


def read_camera(path: str | Path) -> CameraSettings | None:
    """Read the section [camera] of a skin.toml: how pictures become displacements.

    Raises
    ------
    InvalidInput
        As for `read_skin`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import read_camera
    >>> text = '''
    ... [pad]
    ... kind = "half_space"
    ... youngs_modulus = "200 kPa"
    ... poissons_ratio = 0.48
    ...
    ... [[plane]]
    ... kind = "scattered"
    ... depth = "0.5 mm"
    ... channels = ["displacement_x", "displacement_y"]
    ...
    ... [camera]
    ... pitch = "2 mm"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/gel.toml").write_text(text)
    ...     print(read_camera(f"{folder}/gel.toml").pitch)
    0.002
    """
    return _section(path, "camera", lambda skin, camera, _: CameraSettings(**camera.model_dump()))


def _section(path: str | Path, name: str, make: Callable[[SkinFile, Any, Path], T]) -> T | None:
    """``make`` for an optional section; None if it is missing. Errors name the line of the key they begin with."""
    found = Path(path)
    text = skin_text(found)
    skin = validated(text, str(found))
    part = getattr(skin, name)
    if part is None:
        return None
    try:
        return make(skin, part, found.parent)
    except PalpateError as error:
        raise InvalidInput(f"{found}, line {line_of(text, (name, key_of(error)))}: {error}") from error
