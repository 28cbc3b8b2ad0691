"""Write the results of a cell for other programs: tables of vectors, TIFF for ImageJ, netCDF, and layers of napari."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.recordings.files import atomically

__all__ = ["write_netcdf", "write_tiff", "write_vectors"]

#: Slices of the TIFF file: traction and its standard deviation, along x (right) and y (down).
SLICES = ("traction x [Pa]", "traction y [Pa]", "std of traction x [Pa]", "std of traction y [Pa]")


def _suffix(path: str | Path, accepted: tuple[str, ...], what: str) -> None:
    if Path(path).suffix.lower() not in accepted:
        raise InvalidInput(f"{path}: {what} end in {' or '.join(accepted)}. Give such a name.")


def write_vectors(forces: Any, path: str | Path) -> None:
    """See `CellForces.write_vectors`."""
    _suffix(path, (".csv",), "tables of vectors")
    field = forces.field
    rows, columns = field.shape
    x, y = np.meshgrid(field.start[0] + field.step * np.arange(columns), field.start[1] + field.step * np.arange(rows))
    u = field.displacement / field.pixel
    parts = {"x [px]": x, "y [px]": y, "u [px]": u[0], "v [px]": u[1]}
    if field.std is not None:
        parts |= {"std_u [px]": field.std[0] / field.pixel, "std_v [px]": field.std[1] / field.pixel}
    parts |= {
        "traction_x [Pa]": forces.traction[0],
        "traction_y [Pa]": forces.traction[1],
        "std_traction_x [Pa]": forces.std[0],
        "std_traction_y [Pa]": forces.std[1],
        "inside": forces.inside.astype(int),
    }
    if forces.normal is not None:
        up = dict(zip(("traction_normal [Pa]", "std_traction_normal [Pa]"), forces.normal))
        parts |= {"w [px]": field.normal / field.pixel} | up
    lines = [",".join(parts)]
    for row in zip(*(np.ravel(p) for p in parts.values())):
        lines.append(",".join("" if np.isnan(value) else f"{value:.7g}" for value in row))
    text = "\n".join(lines) + "\n"
    atomically(path, lambda at: _filled(at, text))


def _filled(at: str, text: str) -> None:
    Path(at).write_text(text, encoding="utf-8")


def write_tiff(forces: Any, path: str | Path) -> None:
    """See `CellForces.write_tiff`."""
    _suffix(path, (".tif", ".tiff"), "TIFF files")
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF files", error) from error
    stack = np.concatenate([forces.traction, forces.std]).astype(np.float32)
    density = 1.0 / (forces.field.pitch * 1e6)
    largest = float(np.abs(stack[:2]).max())

    def write(at: str) -> None:
        tifffile.imwrite(
            at,
            stack,
            imagej=True,
            resolution=(density, density),
            metadata={
                "axes": "ZYX",
                "unit": "um",
                "Labels": list(SLICES),
                "min": -largest,
                "max": largest,
                "Info": "traction on the gel by palpate; one pixel is one vector; x to the right, y down",
            },
        )

    atomically(path, write)


def write_netcdf(forces: Any, path: str | Path, *, provenance: Mapping[str, str] | None = None) -> None:
    """See `CellForces.write_netcdf`."""
    import xarray

    from palpate.recordings.formats import into_place
    from palpate.recordings.labelled import touch_dataset
    from palpate.recordings.netcdf import write_dataset
    from palpate.recordings.redaction import without_secrets_in_meta

    _suffix(path, (".nc", ".h5"), "netCDF files")
    field = forces.field
    rows, columns = field.shape
    where = ("row", "column")
    metres = {"units": "m"}
    coordinates: dict[str, Any] = {
        "row_y": ("row", field.pixel * (field.start[1] + field.step * np.arange(rows)), {**metres, "long_name": "y of the vectors, down"}),
        "column_x": ("column", field.pixel * (field.start[0] + field.step * np.arange(columns)), {**metres, "long_name": "x of the vectors, to the right"}),
    }  # fmt: skip
    both = ("direction", *where)
    held: dict[str, Any] = {
        "displacement": (both, field.displacement, {**metres, "long_name": "displacement along x and y"}),
        "field_traction": (both, forces.traction, {"units": "Pa", "long_name": "traction on the gel, at the vectors"}),
        "field_std": (both, forces.std, {"units": "Pa", "long_name": "standard deviation of field_traction"}),
        "inside": (where, forces.inside.astype(np.int8), {"long_name": "1 where the cell is"}),
    }
    if forces.normal is not None:
        traction, std = forces.normal
        held |= {
            "displacement_normal": (where, field.normal, {**metres, "long_name": "displacement out of the gel"}),
            "field_traction_normal": (where, traction, {"units": "Pa", "long_name": "normal traction at the vectors, positive out of the gel"}),
            "field_std_normal": (where, std, {"units": "Pa", "long_name": "standard deviation of field_traction_normal"}),
        }  # fmt: skip
    if field.std is not None:
        held["displacement_std"] = (both, field.std, {**metres, "long_name": "standard deviation of the displacement"})
    beside = xarray.Dataset(
        held, coords={**coordinates, "direction": ["x", "y"]}, attrs={"pixel": field.pixel, "step": field.step}
    )
    touch = forces.touch
    record = without_secrets_in_meta(
        {"method": touch.method, "notes": "\n".join(touch.notes), **touch.meta, **(provenance or {})}
    )

    def write(_: Any, name: Path) -> None:
        whole = touch_dataset(touch, record)
        write_dataset(whole.merge(beside).assign_attrs({**whole.attrs, **beside.attrs}), name)

    into_place(path, write, task="write_touch")
