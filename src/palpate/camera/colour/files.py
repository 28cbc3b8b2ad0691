"""calibrated.toml with a section [colour], and the learnt coefficients beside it as numbers only (.npz), without executable content."""

from __future__ import annotations

import json
import re
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from palpate.camera.colour.model import SlopeModel
from palpate.camera.colour.response import Response
from palpate.errors import InvalidInput
from palpate.recordings.files import atomically, write_arrays
from palpate.recordings.skinfile import skin_text
from palpate.sensing.view import View

__all__ = ["read_slopes", "write_slopes"]

#: Form of the file of numbers.
VERSION = 1


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
    target = Path(path)
    if target.suffix.lower() != ".toml":
        raise InvalidInput(f"{target}: a calibrated skin file ends in .toml. Write {target.with_suffix('.toml').name}.")
    text = re.sub(r"(?ms)^\[colour\]\s*$.*?(?=^\[|\Z)", "", skin_text(Path(skin_file))).rstrip()
    numbers = target.with_name(f"{target.stem}.colour.npz")
    held: dict[str, Any] = {
        "version": np.asarray(VERSION),
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

    comments = "".join(f"# {line}\n" for line in str(model).splitlines())

    def fill_text(name: str) -> None:
        Path(name).write_text(f'{text}\n\n[colour]\n{comments}file = "{numbers.name}"\n', encoding="utf-8")

    write_arrays(numbers, held)
    atomically(target, fill_text)
    return target, numbers


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
    source = Path(skin_file)
    try:
        section = tomllib.loads(skin_text(source)).get("colour")
    except ValueError:
        return None  # the reader of the pad reports its errors
    if section is None:
        return None
    path = source.parent / str(section.get("file", ""))
    if not path.is_file():
        raise InvalidInput(
            f"{source}: its [colour] names {path.name}, which is not beside it. Copy it there, or calibrate again with --ball-diameter."
        )
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            held = {k: file[k] for k in file.files}
        if int(held["version"]) != VERSION:
            raise ValueError(f"form {int(held['version'])}, and this palpate reads {VERSION}")
        gain, slope, depth = (float(v) for v in held["errors"])
        response = Response(held["coefficients"], int(held["degree"]), float(held["steepest"]))
        columns, rows = (int(v) for v in held["size"])
        table = tuple(
            (str(n), float(a), float(b), float(c), float(d)) for n, a, b, c, d in json.loads(str(held["table"]))
        )
        return SlopeModel(
            response, held["left_out"], held["covariance"], held["rest"].astype(np.float64), (columns, rows),
            View.restored(json.loads(str(held["view"]))), float(held["ball_diameter"]), gain, slope, depth, table,
            tuple(json.loads(str(held["said"]))),
        )  # fmt: skip
    except (KeyError, ValueError, TypeError, OSError, zipfile.BadZipFile) as error:
        raise InvalidInput(
            f"{path}: no file of colours of palpate, or damaged ({error}). Calibrate again with --ball-diameter."
        ) from error
