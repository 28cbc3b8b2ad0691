"""Map robot messages to readings: topic, path of the numbers, unit."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.elastic.channels import CHANNELS, is_channel
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.clock import unit_of_name
from palpate.recordings.dates import TimeCells
from palpate.sensing.times import LATEST, epoch_unit

__all__ = ["TopicMapping"]

#: foxglove.PackedElementField: number of the type -> NumPy's
_PACKED = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<f4", 8: "<f8"}
#: Names of a time that a mapping may use.
_SECONDS = ("sec", "seconds", "secs")
_NANOS = ("nanosec", "nanos", "nsecs", "nsec")


@dataclass(frozen=True, kw_only=True)
class TopicMapping:
    """How the messages of one topic become readings.

    Parameters
    ----------
    topic : str
    channels : sequence of str
        Channels of the numbers, from `palpate.AREA_CHANNELS`, in the order of ``fields``.
    path : str
        Path of the taxels in the message, e.g. "sensors[0].taxels"; "" for an image or a foxglove Grid.
    fields : sequence of str
        Fields of each taxel, e.g. ("x", "y", "z"), or of each cell of a Grid; empty if the taxels are numbers.
    scale : float or sequence of float
        Multiplies the numbers (of each channel) to SI units; negative turns the sign.
    shape : (int, int), optional
        Rows and columns of the taxels; without it they are one row. An image or Grid of several rows states its own, which must agree.
    markers : bool
        The numbers are positions of markers: readings are their displacements from the first message, which gives the positions of the taxels.
    stamp : str
        Path of the stamp in the message, e.g. "header.stamp" or "sensors[0].time"; default: the time of recording.
    stamp_scale : float, optional
        Unit of a numeric stamp in seconds. Without it the unit follows from the name (``time_us``), from the size of a date since 1970, or from the
        rate of whole numbers; else it is seconds.
    sort : bool
        Sort the frames by stamp. Default: the order of recording; a restarted clock continues.
    definitions : str
        Folder of message definitions (package/msg/Name.msg), for bags without definitions.

    Raises
    ------
    InvalidInput
        Channels that are not known, other than one field or scale for each channel, markers that are no displacements; and, from ``readings``
        and ``time``, messages that do not hold what is described.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from palpate.recordings import TopicMapping
    >>> mapping = TopicMapping(topic="/skin", channels=["stress_zz"], path="taxels", scale=1e3, stamp="at")
    >>> message = SimpleNamespace(taxels=[0.0, 1.5, 0.0], at=2.5)  # kilopascals
    >>> mapping.readings(message).tolist(), mapping.time(message, 3.0)
    ([[0.0, 1500.0, 0.0]], 2.5)
    """

    topic: str
    channels: Sequence[str]
    path: str = ""
    fields: Sequence[str] = ()
    scale: float | Sequence[float] = 1.0
    shape: tuple[int, int] | None = None
    markers: bool = False
    stamp: str = ""
    stamp_scale: float | None = None
    sort: bool = False
    definitions: str = ""

    def __post_init__(self) -> None:
        unknown = [c for c in self.channels if not is_channel(c)]
        if unknown or not self.channels:
            raise InvalidInput(
                f"channels must be names among {', '.join(CHANNELS)}; got {', '.join(unknown) or 'none'}."
            )
        if self.fields and len(self.fields) != len(self.channels):
            raise InvalidInput(f"{len(self.fields)} fields for {len(self.channels)} channels; name one field for each.")
        scale = np.atleast_1d(np.asarray(self.scale, dtype=np.float64))
        if scale.shape not in ((1,), (len(self.channels),)) or not (np.isfinite(scale).all() and (scale != 0).all()):
            raise InvalidInput(f"scale must be one number or one per channel, finite and not 0; got {self.scale!r}.")
        if self.stamp_scale is not None and not (math.isfinite(self.stamp_scale) and self.stamp_scale > 0):
            raise InvalidInput(f"stamp_scale must be a positive number of seconds; got {self.stamp_scale!r}.")
        if (self.stamp_scale is not None or self.sort) and not self.stamp:
            raise InvalidInput("stamp_scale and sort are about the stamps of messages: name stamp too.")
        if self.markers and tuple(self.channels[:2]) != ("displacement_x", "displacement_y"):
            raise InvalidInput(
                f"markers are read as displacement_x, displacement_y (and displacement_z); got {', '.join(self.channels)}."
            )

    def readings(self, message: Any) -> Floats:
        """The readings (channel, *array) in a message, in SI units; with ``markers`` their positions."""
        found = at(message, self.path)
        if hasattr(found, "encoding") and hasattr(found, "step"):
            values = _image(found)
        elif hasattr(found, "cell_stride") and hasattr(found, "row_stride"):
            values = _grid(found, self.fields)
        elif self.fields:
            values = np.array([[float(at(t, f)) for f in self.fields] for t in found], dtype=np.float64).T
        else:
            try:
                values = np.asarray(found, dtype=np.float64)
            except (TypeError, ValueError) as error:
                raise InvalidInput(
                    f"{self.topic}: {self.path or 'the message'} is not a list of numbers, an image or a Grid; name the path of the "
                    f"taxels and their fields. {_field_list(found[0] if _list(found) else found)}"
                ) from error
            # points in a list of [x, y, z] have one row each
            values = values.reshape(1, -1) if values.ndim == 1 else values.T
        if values.ndim < 2 or len(values) != len(self.channels):
            raise InvalidInput(
                f"{self.topic}: messages hold {len(values) if values.ndim > 1 else 0} channels, but {len(self.channels)} are named "
                f"({', '.join(self.channels)})."
            )
        if self.shape is not None:
            if values[0].size != math.prod(self.shape):
                raise InvalidInput(
                    f"{self.topic}: {values[0].size} taxels do not make a shape of {self.shape[0]} x {self.shape[1]}."
                )
            # a single row states no shape; more rows do
            if values.ndim == 3 and values.shape[1] > 1 and values.shape[1:] != tuple(self.shape):
                raise InvalidInput(
                    f"{self.topic}: messages state {values.shape[1]} rows of {values.shape[2]} taxels, but shape says {self.shape[0]} x "
                    f"{self.shape[1]} (rows x columns); give the shape that they state, or leave it out."
                )
            values = values.reshape(len(values), *self.shape)
        scale = np.broadcast_to(np.asarray(self.scale, dtype=np.float64), (len(values),))
        return np.asarray(values * scale.reshape(-1, *(1,) * (values.ndim - 1)))

    def time(self, message: Any, recorded: float) -> float:
        """Time of a message [s]; a stamp without a unit is a date since 1970 if its size suggests so, else seconds."""
        found, unit = self.stamped(message, recorded)
        if unit is None:
            date = epoch_unit(found)
            unit = 1.0 if date is None else date[1]
        return found * unit

    def stamped(self, message: Any, recorded: float) -> tuple[float, float | None]:
        """The stamp of a message, and its unit in seconds, or None if unknown.

        Examples
        --------
        >>> from types import SimpleNamespace
        >>> from palpate.recordings import TopicMapping
        >>> mapping = TopicMapping(topic="/skin", channels=["stress_zz"], stamp="time_us")
        >>> mapping.stamped(SimpleNamespace(time_us=2_500_000), 3.0)
        (2500000.0, 1e-06)
        """
        if not self.stamp:
            return recorded, 1.0
        found = at(message, self.stamp)
        if isinstance(found, int | float) and not isinstance(found, bool):
            named = unit_of_name(self.stamp) if self.stamp_scale is None else self.stamp_scale
            return float(found), 1.0 if named is None and isinstance(found, float) and abs(found) <= LATEST else named
        for whole in _SECONDS:
            for part in _NANOS:
                if hasattr(found, whole) and hasattr(found, part):
                    return (int(getattr(found, whole)) * 10**9 + int(getattr(found, part))) / 10**9, 1.0
        date = TimeCells(self.topic).value(found, f"{self.topic}: {self.stamp}") if isinstance(found, str) else None
        if date is not None:
            return date, 1.0
        raise InvalidInput(
            f"{self.topic}: {self.stamp} is not a time: neither seconds nor a stamp of seconds and nanoseconds."
        )


def _list(value: Any) -> bool:
    return hasattr(value, "__len__") and hasattr(value, "__getitem__") and len(value) > 0 and not isinstance(value, str)


def _field_list(message: Any) -> str:
    """The fields of a message in words."""
    names = [n for n in getattr(message, "__dataclass_fields__", {}) if n != "__msgtype__"]
    if not names and hasattr(message, "DESCRIPTOR"):
        names = [f.name for f in message.DESCRIPTOR.fields]
    return f"There is {', '.join(names)}." if names else ""


@functools.cache
def _steps(path: str) -> list[tuple[str, str]]:
    return re.findall(r"([A-Za-z_]\w*)|\[(\d+)\]", path)


def at(message: Any, path: str) -> Any:
    """Follow a path like "sensors[0].taxels"."""
    found = message
    for name, index in _steps(path):
        try:
            found = getattr(found, name) if name else found[int(index)]
        except (AttributeError, IndexError, TypeError) as error:
            raise InvalidInput(
                f"the message has no {name or f'[{index}]'} on the way to {path!r}. {_field_list(found)}".rstrip()
            ) from error
    return found


def _image(message: Any) -> Floats:
    """The pixels (channel, y, x) of an image of floats."""
    matched = re.fullmatch(r"(32|64)FC(\d+)", message.encoding)
    if matched is None:
        raise InvalidInput(f"images must be 32FC1, 32FC3, 64FC1, ... (floats); got {message.encoding!r}.")
    size, count, rows, columns = int(matched[1]) // 8, int(matched[2]), int(message.height), int(message.width)
    data = _bytes(message.data)
    need = int(message.step) * rows
    if message.step < size * count * columns or data.size < need:
        raise InvalidInput(f"an image of {columns} x {rows} x {count} floats has {data.size} bytes; it is truncated.")
    kind = f"{'>' if getattr(message, 'is_bigendian', False) else '<'}f{size}"
    lines = data[:need].reshape(rows, int(message.step))[:, : size * count * columns]
    values = np.ascontiguousarray(lines).view(kind).reshape(rows, columns, count)
    return np.asarray(np.moveaxis(values, -1, 0), dtype=np.float64)


def _grid(message: Any, fields: Sequence[str]) -> Floats:
    """The fields (field, y, x) of a foxglove.Grid."""
    known = {f.name: f for f in message.fields}
    missing = [f for f in fields if f not in known]
    if missing:
        raise InvalidInput(f"the Grid has no field {', '.join(missing)}; it has {', '.join(known) or 'none'}.")
    data, columns = _bytes(message.data), int(message.column_count)
    row, cell = int(message.row_stride), int(message.cell_stride)
    if columns < 1 or cell < 1 or row < cell * columns or data.size < row or data.size % row:
        raise InvalidInput(
            f"a Grid of {columns} columns, {cell} bytes a cell and {row} a row has {data.size} bytes; it is truncated."
        )
    lines = data.reshape(-1, row)[:, : cell * columns].reshape(-1, columns, cell)
    layers = []
    for name in fields or known:
        kind, offset = _PACKED.get(int(known[name].type)), int(known[name].offset)
        if kind is None or offset + np.dtype(kind).itemsize > cell:
            raise InvalidInput(f"the Grid's field {name} does not lie in its cells of {cell} bytes.")
        part = np.ascontiguousarray(lines[..., offset : offset + np.dtype(kind).itemsize])
        layers.append(part.view(kind)[..., 0].astype(np.float64))
    return np.stack(layers)


def _bytes(data: Any) -> Any:
    return (
        np.frombuffer(data, dtype=np.uint8)
        if isinstance(data, bytes | bytearray | memoryview)
        else np.asarray(data, dtype=np.uint8)
    )
