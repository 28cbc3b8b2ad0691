"""Store the learned coefficients of a gel: a section [colour] in calibrated.toml and a file of plain numbers beside it
(.npz).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from palpate.camera.colour.model import SlopeModel
from palpate.camera.colour.response import Response
from palpate.recordings.skinnumbers import read_numbers, write_numbers
from palpate.sensing.view import View

__all__ = ["read_slopes", "write_slopes"]

SECTION = "colour"
#: The remedy for an unreadable file.
REMEDY = "Calibrate again with palpate calibrate --ball-diameter"


def write_slopes(path: str | Path, skin_file: str | Path, model: SlopeModel) -> tuple[Path, Path]:
    """Write a skin.toml with the section [colour] and, beside it, NAME.colour.npz; returns both paths.

    Raises
    ------
    InvalidInput
        A name that does not end in .toml.

    Examples
    --------
    >>> from palpate.camera import write_slopes
    >>> # write_slopes("calibrated.toml", "gel.toml", model)
    """
    held: dict[str, Any] = {
        "coefficients": model.response.coefficients,
        "degree": np.asarray(model.response.degree),
        "steepest": np.asarray(model.response.steepest),
        "left_out": model.left_out,
        "covariance": model.covariance,
        "rest": model.rest.astype(np.float32),
        "size": np.asarray(model.size),
        "view": np.asarray(json.dumps(model.view.described())),
        "ball_diameter": np.asarray(model.ball_diameter),
        "errors": np.array([model.gain_std, model.slope_error, model.depth_error]),
        "table": np.asarray(json.dumps(model.table)),
        "said": np.asarray(json.dumps(model.said)),
    }
    return write_numbers(path, skin_file, SECTION, model, held)


def read_slopes(skin_file: str | Path) -> SlopeModel | None:
    """The learnt slopes of a gel, from the file that a skin.toml names; None without a section [colour].

    Raises
    ------
    InvalidInput
        The file of numbers is not there, or is damaged.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.camera import read_slopes
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/skin.toml").write_text("[pad]")
    ...     print(read_slopes(f"{folder}/skin.toml"))
    None
    """
    return read_numbers(skin_file, SECTION, _made, remedy=REMEDY)


def _made(held: dict[str, Any]) -> SlopeModel:
    gain, slope, depth = (float(v) for v in held["errors"])
    response = Response(held["coefficients"], int(held["degree"]), float(held["steepest"]))
    columns, rows = (int(v) for v in held["size"])
    table = tuple((str(n), float(a), float(b), float(c), float(d)) for n, a, b, c, d in json.loads(str(held["table"])))
    return SlopeModel(
        response, held["left_out"], held["covariance"], held["rest"].astype(np.float64), (columns, rows),
        View.restored(json.loads(str(held["view"]))), float(held["ball_diameter"]), gain, slope, depth, table,
        tuple(json.loads(str(held["said"]))),
    )  # fmt: skip
