"""Write results to files with their provenance, and read them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.recordings.formats import existing, find_format, into_place
from palpate.recordings.redaction import without_secrets_in_meta

if TYPE_CHECKING:
    from palpate.touch import Touch

__all__ = ["read_touch", "write_touch"]


def write_touch(touch: Touch, path: str | Path, *, provenance: Mapping[str, str] | None = None) -> None:
    """Write traction with coordinates and units, net force, and ``provenance`` (skin, command, version).

    NetCDF (.nc, .h5) opens in xarray. .npz has the same arrays under the same names (traction, std, force with
    force_low and force_high at 95 %, status, fit, ...; status_label is each status in words, record is ``provenance``
    as JSON). .csv has forces over time, one line a frame (`Touch.table`), without maps. .mcap has a foxglove.Grid and
    a WrenchStamped per frame, in single precision. .zarr is a store for xarray.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.recordings import write_touch
    >>> touch = pp.Touch(np.ones((2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_touch(touch, f"{folder}/touch.npz", provenance={"skin": "skin.toml"})
    ...     with np.load(f"{folder}/touch.npz") as file:
    ...         traction = file["traction"]
    >>> traction.shape
    (2, 4)
    """
    record = {"method": touch.method, "notes": "\n".join(touch.notes), **touch.meta, **(provenance or {})}
    record = without_secrets_in_meta(record)
    into_place(path, lambda known, name: known.write_touch(touch, name, record), task="write_touch")


def read_touch(path: str | Path) -> Any:
    """The xarray.Dataset of a result written as NetCDF or Zarr, or of the touches in a stream's recording.

    Parameters
    ----------
    path : str or Path
        NPZ and CSV results are for other programs; they are not read back.

    Raises
    ------
    InvalidInput
        The file is not there, damaged (a result carries a checksum), or does not hold touches.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.recordings import read_touch, write_touch
    >>> touch = pp.Touch(np.ones((2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_touch(touch, f"{folder}/touch.nc")
    ...     data = read_touch(f"{folder}/touch.nc")
    >>> float(data.traction.sel(component="z").max()), data.traction.attrs["units"]
    (1.0, 'Pa')
    """
    known = find_format(path)
    if not known.can("read_touch"):
        return known.read_touch(Path(path))  # refused, with the endings that can
    found, known = existing(path, task="read_touch")
    return known.read_touch(found)
