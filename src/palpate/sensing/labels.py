"""Labelled arrays (xarray.DataArray): reorder them by their labels to the order of the skin, or raise an error.

Dimensions are transposed by name, channels and components selected by name, coordinates compared with the positions of
the taxels (or surface cells) and sorted if they run in the opposite direction, and the attribute "units" converted to
SI. No label is ignored; axes without a label keep their positional meaning.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import as_real
from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array, LineArray, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.times import as_seconds
from palpate.units import convert_factor

__all__ = ["is_labelled", "labelled_readings", "labelled_time", "labelled_traction"]

#: Largest distance of a taxel's coordinate from its position, as a fraction of the pitch.
TOLERANCE = 0.02


def is_labelled(x: Any) -> bool:
    """Whether ``x`` is an xarray DataArray (or Variable)."""
    return hasattr(x, "dims") and hasattr(x, "transpose") and not hasattr(x, "data_vars")


def labelled_readings(x: Any, planes: Sequence[Array]) -> npt.NDArray[Any]:
    """Readings (*batch, channel, *array) in SI units and in the order of the arrays' own channels and taxels."""
    first = planes[0]
    line = isinstance(first, LineArray)
    names = (
        ("taxel",)
        if isinstance(first, ScatteredArray) or (line and "taxel" in x.dims)
        else ("x",)
        if line
        else ("y", "x")
    )
    x = _transposed(x, "channel", names, "readings")
    channels = tuple(c for p in planes for c in p.channels)
    x = _by_name(x, "channel", channels, "readings")
    factors = _factors(x, [channel_unit(c) for c in channels])
    axes = x.ndim - len(names)
    if isinstance(first, ScatteredArray) or names == ("taxel",):
        order = _scattered_order(x, first)
        values = as_real(_bare(x), "readings")
        values = values if order is None else values[..., order]
    else:
        values = _sorted(x, names, first.grid.axes, first.grid.spacings, axes, "readings", "the array's taxels")
    if factors is not None:
        values = values * factors.reshape(-1, *(1,) * len(names)).astype(values.dtype)
    return values


def labelled_traction(x: Any, surface: Grid) -> npt.NDArray[Any]:
    """Traction (*batch, component, *surface) [Pa] in the order of the surface's own components and cells."""
    names = ("x",) if surface.dimensions == 1 else ("y", "x")
    x = _transposed(x, "component", names, "traction")
    x = _by_name(x, "component", surface.components, "traction")
    factors = _factors(x, ["Pa"] * len(surface.components))
    values = _sorted(x, names, surface.axes, surface.spacings, x.ndim - len(names), "traction", "the surface's cells")
    return values if factors is None else values * values.dtype.type(factors[0])


def labelled_time(x: Any) -> Floats | None:
    """Time of each frame [s], if the readings have it as a coordinate."""
    if not is_labelled(x) or "time" not in x.dims or "time" not in getattr(x, "coords", {}):
        return None
    if set(x.dims) - {"time", "channel", "component", "taxel", "y", "x"}:
        return None  # more batch axes than time
    coordinate = x.coords["time"]
    if coordinate.attrs.get("units") == "frame":
        return None
    return as_seconds(coordinate, "the coordinate time")


def _bare(x: Any) -> Any:
    """Values without labels; values with units are kept, to be refused later."""
    data = x.data
    return data if hasattr(data, "magnitude") else x.values


def _transposed(x: Any, first: str, names: tuple[str, ...], what: str) -> Any:
    wanted = (first, *names)
    missing = [n for n in wanted if n not in x.dims]
    if missing:
        raise InvalidInput(
            f"labelled {what} must have the dimensions (..., {', '.join(wanted)}), in any order; got "
            f"({', '.join(map(str, x.dims))}). Name them so, x.rename(old='{missing[0]}') "
            f"(a missing axis: x.expand_dims({first}=[...])), or pass x.values where the axes already stand in that order."
        )
    batch = [d for d in x.dims if d not in wanted]
    strange = [d for d in batch if d in ("x", "y", "taxel", "channel", "component")]
    if strange:
        raise InvalidInput(
            f"labelled {what} must have the dimensions (..., {', '.join(wanted)}); got the dimension {strange[0]!r} besides: "
            f"({', '.join(map(str, x.dims))})."
        )
    return x.transpose(*batch, *wanted)


def _by_name(x: Any, dim: str, names: tuple[str, ...], what: str) -> Any:
    """Channels or components in the order of ``names``."""
    if dim not in getattr(x, "coords", {}):
        return x
    got = x.coords[dim].values
    found = tuple(got.tolist())
    if not all(isinstance(n, str) for n in found):
        raise InvalidInput(
            f"the coordinate {dim} of {what} must hold names ({', '.join(names)}); got {found[:4]}. Drop it where the order "
            f"is already this one: x.drop_vars({dim!r})."
        )
    if found == names:
        return x
    if len(set(names)) != len(names) or len(set(found)) != len(found):
        raise InvalidInput(
            f"the {dim}s of {what} are {', '.join(found)}; the planes need them in this order, as some names occur twice: "
            f"{', '.join(names)}."
        )
    if set(found) != set(names):
        raise InvalidInput(
            f"the {dim}s of {what} must be {', '.join(names)}, in any order; got {', '.join(found)}. Take what is needed, "
            f"x.sel({dim}={list(names)}), or describe a skin that has these."
        )
    return x.isel({dim: [found.index(n) for n in names]})


def _factors(x: Any, units: Sequence[str]) -> Floats | None:
    """Factors to SI from the attribute "units"."""
    unit = getattr(x, "attrs", {}).get("units")
    if unit is None or unit == "":
        return None
    if not isinstance(unit, str):
        raise InvalidInput(f'the attribute "units" must be one name such as "Pa"; got {unit!r}.')
    factors = np.array([convert_factor(unit, si, "the labelled array") for si in units])
    return None if (factors == 1.0).all() else factors


def _metres(x: Any, name: str) -> Floats | None:
    """A coordinate in metres, or None if it is missing."""
    if name not in getattr(x, "coords", {}):
        return None
    found = x.coords[name]
    if found.dtype.kind not in "iuf" or found.ndim != 1:
        raise InvalidInput(f"the coordinate {name} must hold one position [m] for each entry; got dtype {found.dtype}.")
    unit = found.attrs.get("units", "m")
    return np.asarray(found.values, dtype=np.float64) * convert_factor(str(unit), "m", f"the coordinate {name}")


def _sorted(
    x: Any, names: Sequence[str], axes: Sequence[Floats], pitches: Sequence[float], lead: int, what: str, of: str
) -> npt.NDArray[Any]:
    """Values with each axis in the order of its positions."""
    values = as_real(_bare(x), what)
    for i, (name, own, pitch) in enumerate(zip(names, axes, pitches)):
        found = _metres(x, name)
        if found is None:
            continue
        if found.shape != own.shape:
            continue  # the shape is refused by name further on
        order = np.argsort(found)
        off = float(np.abs(found[order] - own).max()) if np.isfinite(found).all() else np.inf
        if off > TOLERANCE * pitch:
            raise InvalidInput(
                f"the coordinate {name} of {what} does not agree with the positions of {of}: it runs from "
                f"{found.min():g} to {found.max():g} m, these from {own[0]:g} to {own[-1]:g} m, {off:.3g} m apart at most. "
                f'Say its unit (x[{name!r}].attrs["units"] = "mm"), give the array its pitch and center=..., or drop '
                f"the coordinate where the order is right: x.drop_vars({name!r})."
            )
        values = np.take(values, order, axis=lead + i)
    return values


def _scattered_order(x: Any, array: Array) -> npt.NDArray[np.intp] | None:
    """Indices that order "taxel" entries as the array does; None if they are in order or have no labels."""
    n = len(array.points)
    if x.sizes["taxel"] != n:
        return None  # the shape is refused by name further on
    places = [_metres(x, name) for name in ("x", "y")[: array.dimensions]]
    given = [p for p in places if p is not None and p.shape == (n,)]
    if given:
        if len(given) != array.dimensions:
            raise InvalidInput("the coordinates x and y of the taxels must be given both, along the dimension taxel.")
        found = np.stack(given[::-1], axis=1)
        return _matched(found, array.points)
    if "taxel" not in getattr(x, "coords", {}):
        return None
    ids = x.coords["taxel"].values
    if ids.dtype.kind in "iu" and np.array_equal(np.sort(ids), np.arange(n)):
        return np.argsort(ids)
    raise InvalidInput(
        f"the coordinate taxel must number the taxels from 0 to {n - 1}, in any order; got {ids[:4].tolist()}, .... Give "
        'positions instead (coordinates x and y along taxel), or drop it: x.drop_vars("taxel").'
    )


def _matched(found: Floats, own: Floats) -> npt.NDArray[np.intp] | None:
    from scipy.spatial import cKDTree

    if not np.isfinite(found).all():
        raise InvalidInput("the coordinates x and y of the taxels hold values that are not finite.")
    spacing = float(np.median(cKDTree(own).query(own, k=2)[0][:, 1]))
    distance, order = cKDTree(found).query(own)
    if distance.max() > TOLERANCE * spacing or len(np.unique(order)) != len(own):
        worst = int(np.argmax(distance))
        raise InvalidInput(
            f"the coordinates x and y of the taxels do not agree with the array's positions: taxel {worst} of the array lies "
            f"{distance[worst]:.3g} m from the nearest of them. Use the same positions in metres (attribute units where they are "
            'not), or drop them where the order is right: x.drop_vars(["x", "y"]).'
        )
    return None if np.array_equal(order, np.arange(len(own))) else np.asarray(order, dtype=np.intp)
