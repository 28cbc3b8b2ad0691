"""Convert Recording and Touch to labelled arrays (xarray) and back: the only place for names, units and dimensions in
files.

A Dataset created here converts back to an equal object. NetCDF, HDF5 and Zarr store these data sets unchanged.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.quantities import COMPONENTS
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.estimate import Errors, Stated
from palpate.recordings.clock import read_clock
from palpate.recordings.meta import plain_meta
from palpate.recordings.recording import Recording
from palpate.sensing.curved import CurvedGrid, CylinderChart, SphereChart
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.times import as_seconds
from palpate.sensing.view import View
from palpate.solid.charts import MeshChart
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.fields import CalibratedForce, ErrorParts
from palpate.uncertainty import Case

if TYPE_CHECKING:
    import xarray

__all__ = [
    "CONVENTIONS",
    "RESULT_ATTRIBUTES",
    "STATUS_FLAGS",
    "missing_value",
    "recording_dataset",
    "recording_of",
    "touch_dataset",
    "touch_of",
    "view_of",
]

CONVENTIONS = "palpate recording 1"
#: Meanings of the codes of `Status`, as the CF conventions require.
STATUS_FLAGS = {
    "flag_values": [int(s) for s in Status],
    "flag_meanings": " ".join(s.label.replace(" ", "_") for s in Status),
}
#: Attributes that describe a result; the others are its provenance.
RESULT_ATTRIBUTES = (
    *(
        "Conventions",
        "method",
        "notes",
        "assumptions",
        "sought",
        "unobservable_force",
        "surface",
        "meta",
        "case",
        "found_by",
        "methods",
    ),
    "reading_names",
    "nuisance_names",
    "friction",
    "common_std",
)
#: Fields with one text per frame. They are stored as integers, the places in a list of texts in an attribute, because
#: Zarr 3 has no stable string type.
_TEXT = ("found_by",)


def _declared(record: type, *, without: tuple[str, ...] = ()) -> dict[str, tuple[str, ...]]:
    """Dimensions after those of the batch, for each field with batch axes."""
    return {f.name: f.metadata["dims"] for f in fields(record) if f.metadata.get("per_frame") and f.name not in without}


def missing_value(name: str) -> Any:
    """Fill value of a variable of `touch_dataset` for frames that lack it."""
    found = {f.name: f.metadata["missing"] for f in fields(Touch) if f.metadata.get("per_frame")}
    return 0 if name in _TEXT else found.get(name, np.nan)


# -- recordings --------------------------------------------------------------------------------------------------------


def recording_dataset(recording: Recording) -> xarray.Dataset:
    """Readings (time, channel, taxel) or (time, channel, y, x) with time, channels, units and positions.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    xarray.Dataset
        ``readings`` in SI units, ``unit`` and (scattered taxels) ``positions`` [m]; coordinates ``time`` [s] and ``channel``. The
        attribute ``meta`` is JSON.
    """
    import xarray

    array = ("taxel",) if recording.readings.ndim == 3 else ("y", "x")
    dataset = xarray.Dataset(
        {
            "readings": (
                ("time", "channel", *array),
                recording.readings,
                {"long_name": "sensor readings in SI units, compression positive"},
            ),
            "unit": (("channel",), np.array(recording.units, dtype=object)),
        },
        coords={
            "time": ("time", recording.time, {"units": "s"}),
            "channel": ("channel", np.array(recording.channels, dtype=object)),
        },
        attrs={"meta": json.dumps(recording.meta), "Conventions": CONVENTIONS},
    )
    if recording.positions is not None:
        dims = ("taxel", "axis")[: recording.positions.ndim]
        dataset["positions"] = (dims, recording.positions, {"units": "m"})
    return dataset


def recording_of(dataset: xarray.Dataset) -> Recording:
    """The recording in a Dataset; `InvalidInput` if there is none."""
    name = "the data set"
    missing = [n for n in ("readings", "channel", "time") if n not in dataset.variables]
    if missing:
        held = ", ".join(map(str, dataset.variables)) or "nothing"
        raise InvalidInput(f"{name}: not a palpate recording: it lacks {', '.join(missing)} (it holds {held}).")
    readings = dataset["readings"]
    array = [str(d) for d in readings.dims if d not in ("time", "channel")]
    if sorted(array) not in (["taxel"], ["x", "y"]) or not {"time", "channel"} <= set(readings.dims):
        raise InvalidInput(
            f"{name}: readings must have the dimensions (time, channel, taxel) or (time, channel, y, x); got {readings.dims}."
        )
    order = ("taxel",) if len(array) == 1 else ("y", "x")
    positions = None
    if "positions" in dataset.variables:
        found = dataset["positions"]
        positions = found.transpose("taxel", ...).values if "taxel" in found.dims else found.values
    clock = read_clock(as_seconds(dataset["time"], f"{name}: time"), source=name)
    clock.tell()
    return Recording(
        readings=readings.transpose("time", "channel", *order).values,
        channels=tuple(text(c) for c in dataset["channel"].values),
        time=clock.time,
        positions=positions,
        meta={**_json(dataset.attrs.get("meta", "{}"), name), **clock.meta()},
    )


def text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _json(text: Any, name: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"{name}: meta cannot be read; the file may be truncated.") from error
    if not isinstance(found, dict):
        raise InvalidInput(f"{name}: meta must be a JSON object.")
    return found


# -- touches -----------------------------------------------------------------------------------------------------------


def touch_dataset(touch: Touch, provenance: Mapping[str, str] | None = None) -> xarray.Dataset:
    """A result with everything in it: traction with coordinates and units, net force, error bars, status.

    Parameters
    ----------
    touch : Touch
    provenance : mapping of str to str, optional
        Provenance of the result; each entry becomes an attribute.

    Returns
    -------
    xarray.Dataset
        ``traction`` [Pa] and ``force`` [N or N/m]; with error bars ``std``, ``force_low``, ``force_high`` (95 %) as they are to be
        used, and ``errors_*`` as the model gives them before calibration (``stated_*``: what linear methods owe to the pad); the further fields of `Touch` by their names.
    """
    import xarray

    traction = touch.traction
    surface = ("x",) if touch.surface.dimensions == 1 else ("y", "x")
    batch = tuple(str(d) for d in traction.dims[: traction.ndim - 1 - len(surface)])
    unit = "N/m" if touch.surface.dimensions == 1 else "N"
    # Collect variables first: a Dataset aligns all existing variables for each one added later.
    found: dict[str, Any] = {"traction": traction}
    found["force"] = ((*batch, "component"), to_numpy(touch.force), {"units": unit, "long_name": "net force"})
    if touch._errors is not None:
        posterior, pad = touch._errors.posterior, touch._errors.pad
        posterior.work_out()
        found["std"] = touch._map(touch.std(), "std")
        for name, side in zip(("force_low", "force_high"), touch.interval(0.95, "force")):
            attrs = {"units": unit, "long_name": "net force, 95 % interval"}
            found[name] = ((*batch, "component"), side, attrs)
        for key, tail in _declared(Errors).items():
            found[f"errors_{key}"] = ((*batch, *_expanded(tail, surface)), to_numpy(getattr(posterior, key)))
        for key, tail in _declared(Stated).items() if pad is not None else ():
            found[f"stated_{key}"] = ((*batch, *_expanded(tail, surface)), to_numpy(getattr(pad, key)))
    for key, tail in _declared(Touch, without=("values", "time", "_errors", "calibrated", *_TEXT)).items():
        value = getattr(touch, key)
        if value is not None:
            found[key] = ((*batch, *_expanded(tail, surface)), to_numpy(value))
    for key, tail in _declared(CalibratedForce).items() if touch.calibrated is not None else ():
        value = getattr(touch.calibrated, key)
        if value is not None:
            found[f"calibrated_{key}"] = ((*batch, *_expanded(tail, surface)), to_numpy(value))
    if touch.found_by is not None:
        names = list(dict.fromkeys(np.ravel(touch.found_by).tolist()))
        codes = np.array([names.index(n) for n in np.ravel(touch.found_by)], dtype=np.int8)
        found["found_by"] = (batch, codes.reshape(touch.batch), {"long_name": "place among the attribute methods"})
    dataset = xarray.Dataset(found)
    if touch.status is not None:
        dataset["status"].attrs = dict(STATUS_FLAGS)
    if touch.time is not None and "time" not in dataset.coords:
        dataset["time"] = (batch, np.asarray(touch.time), {"units": "s"})
    dataset.attrs.update({k: str(v) for k, v in (provenance or {}).items() if k not in RESULT_ATTRIBUTES})
    dataset.attrs.update(
        {
            "method": touch.method,
            "notes": "\n".join(touch.notes),
            "assumptions": json.dumps(touch.assumptions),
            "reading_names": json.dumps({str(row): name for row, name in touch.reading_names.items()}),
            "nuisance_names": json.dumps(touch.nuisance_names),
            "sought": ",".join(touch.components),
            "unobservable_force": ",".join(touch.unobservable_force),
            "surface": json.dumps(_described(touch.surface)),
            "meta": json.dumps(plain_meta(touch.meta)),
        }
    )
    if touch.found_by is not None:
        dataset.attrs["methods"] = json.dumps(names)
    if touch.friction is not None:
        dataset.attrs["friction"] = float(touch.friction)
    if touch._errors is not None:
        dataset.attrs["common_std"] = touch._errors.scale
    if touch.case is not None:
        dataset.attrs["case"] = json.dumps(asdict(touch.case))
    return dataset


def touch_of(dataset: xarray.Dataset, name: str = "the data set") -> Touch:
    """The result in a Dataset of `touch_dataset`; `InvalidInput` if there is none."""
    attrs = dataset.attrs
    missing = [n for n in ("traction", "component") if n not in dataset.variables]
    missing += [n for n in ("surface", "sought", "method") if n not in attrs]
    if missing:
        raise InvalidInput(f"{name}: not a whole palpate result: it lacks {', '.join(missing)}.")
    grid = _grid(attrs["surface"], name)
    traction = dataset["traction"]
    order = [
        *(d for d in traction.dims if d not in ("component", "y", "x")),
        "component",
        *("y", "x")[-grid.dimensions :],
    ]
    values = traction.transpose(*order).values
    if values.shape[len(order) - 1 - grid.dimensions :] != (len(COMPONENTS[grid.dimensions]), *grid.shape):
        raise InvalidInput(f"{name}: traction of shape {values.shape} does not lie on a surface of {grid.shape} cells.")
    errors = None
    if "errors_traction" in dataset:
        if "errors_beyond_force" not in dataset:
            # The file was written before the error of contact beyond the outermost taxels existed.
            dataset = dataset.assign(errors_beyond_force=0.0 * dataset["errors_force"])
        errors = Errors(**{f.name: dataset[f"errors_{f.name}"].values for f in fields(Errors)})
    stated = None
    if "stated_traction" in dataset:
        stated = Stated(**{f.name: dataset[f"stated_{f.name}"].values for f in fields(Stated)})
    time = dataset["time"] if "time" in dataset.variables else None
    if time is not None and time.attrs.get("units") == "frame":
        time = None
    fields_of: dict[str, Any] = {
        key: dataset[key].values
        for key in _declared(Touch, without=("values", "time", "_errors", "calibrated", *_TEXT))
        if key in dataset
    }
    return Touch(
        values=values,
        surface=grid,
        components=_listed(attrs["sought"]),
        method=attrs["method"],
        assumptions=tuple(_loaded(attrs.get("assumptions", "[]"), name)),
        reading_names={int(r): str(n) for r, n in _json(attrs.get("reading_names", "{}"), name).items()},
        unobservable_force=_listed(attrs.get("unobservable_force", "")),
        time=None if time is None else time.values,
        meta=_json(attrs.get("meta", "{}"), name),
        _errors=ErrorParts.of(errors, stated, float(attrs.get("common_std", 0.0))),
        found_by=_found_by(dataset, name),
        case=_case(attrs["case"], name) if "case" in attrs else None,
        friction=float(attrs["friction"]) if "friction" in attrs else None,
        nuisance_names=tuple((str(a), str(b)) for a, b in _loaded(attrs.get("nuisance_names", "[]"), name)),
        view=view_of(dataset, name),
        calibrated=_calibrated(dataset),
        **fields_of,
    )


def _calibrated(dataset: xarray.Dataset) -> CalibratedForce | None:
    """The force by a calibration; in files before `CalibratedForce` the variable is called ``calibrated``."""
    dataset = dataset.rename({"calibrated": "calibrated_force"}) if "calibrated" in dataset else dataset
    found = {
        key: dataset[f"calibrated_{key}"].values for key in _declared(CalibratedForce) if f"calibrated_{key}" in dataset
    }
    return CalibratedForce(**found) if "force" in found else None


def view_of(dataset: xarray.Dataset, name: str = "the data set") -> View | None:
    """The position of the picture of a camera's result, or None for other sensors."""
    held = dataset["traction"].attrs.get("view")
    if held is None:
        return None
    try:
        return View.restored(_loaded(text(held), name))
    except InvalidInput as error:
        raise InvalidInput(f"{name}: where its picture lies cannot be read; the file may be damaged.") from error


def _loaded(text: Any, name: str) -> Any:
    try:
        return json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"{name}: its attributes cannot be read; the file may be damaged.") from error


def _found_by(dataset: xarray.Dataset, name: str) -> Any:
    """The method of each frame, from its index in the list of methods."""
    if "found_by" not in dataset:
        return None
    names, codes = np.array(_loaded(dataset.attrs.get("methods", "[]"), name)), dataset["found_by"].values
    if not (codes.min(initial=0) >= 0 and codes.max(initial=0) < len(names)):
        raise InvalidInput(f"{name}: the methods that found its frames are not all listed; the file may be damaged.")
    return names[codes]


def _case(text: Any, name: str) -> Case:
    held = _loaded(text, name)
    try:
        return Case(**held)
    except TypeError as error:
        raise InvalidInput(f"{name}: the case of its error bars cannot be read; the file may be damaged.") from error


def _expanded(dims: tuple[str, ...], surface: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(d for dim in dims for d in (surface if dim == "*" else (dim,)))


def _listed(text: str) -> tuple[str, ...]:
    return tuple(text.split(",")) if text else ()


#: Charts of curved surfaces that can be stored.
CHARTS: dict[str, Any] = {chart.__name__: chart for chart in (SphereChart, CylinderChart, MeshChart)}


def _described(grid: Grid) -> dict[str, Any]:
    """The arguments that recreate exactly the same grid, which coordinates alone would not."""
    if isinstance(grid, LineGrid):
        return {"count": grid.count, "spacing": grid.spacing, "center": grid.center}
    out: dict[str, Any] = {"shape": grid.shape, "spacing": grid.spacing, "center": grid.center}
    chart = getattr(grid, "chart", None)
    if chart is None:
        return out
    if type(chart).__name__ not in CHARTS:
        raise Unsupported(
            f"a surface with a chart of its own ({type(chart).__name__}) cannot be written into a stream. Write a result to NetCDF: its coordinates hold positions and normals."
        )
    held = {f.name: getattr(chart, f.name) for f in fields(chart)}
    held = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in held.items()}
    return {**out, "chart": {"kind": type(chart).__name__, **held}}


def _grid(text: str, name: str) -> Grid:
    try:
        found = json.loads(text)
        if "count" in found:
            return LineGrid(**found)
        chart = found.pop("chart", None)
        given = {k: tuple(v) if isinstance(v, list) else v for k, v in found.items()}
        if chart is None:
            return AreaGrid(**given)
        kind = CHARTS[chart.pop("kind")]
        arrays = {"vertices": np.float64, "facets": np.intp}
        chart = {k: np.array(v, dtype=arrays[k]) if k in arrays else v for k, v in chart.items()}
        chart = {k: tuple(v) if isinstance(v, list) else v for k, v in chart.items()}
        return CurvedGrid(**given, chart=kind(**chart))
    except (TypeError, ValueError, KeyError, RecursionError) as error:
        raise InvalidInput(f"{name}: its surface cannot be read; the file may be damaged.") from error
