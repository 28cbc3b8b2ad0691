"""calibrated.toml: the skin file with a section [calibration], and a file of numbers beside it."""

from __future__ import annotations

import json
import re
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from palpate.calibrate.calibration import SkinCalibration
from palpate.calibrate.constants import PadConstants
from palpate.calibrate.forcemap import ForceMap
from palpate.errors import InvalidInput
from palpate.recordings.files import atomically, write_arrays
from palpate.recordings.skinfile import skin_text

__all__ = ["calibrated_text", "read_calibration", "write_calibrated"]

#: Form of the file of numbers.
VERSION = 1


def calibrated_text(text: str, found: SkinCalibration, numbers: str) -> str:
    """The text of a skin.toml with the section [calibration] (an old one is replaced); what was found stands in comments.

    Examples
    --------
    >>> from palpate.calibrate import SkinCalibration, calibrated_text
    >>> print(calibrated_text('[pad]\\n', SkinCalibration({}, 4), "finger.calibration.npz"))
    [pad]
    <BLANKLINE>
    [calibration]
    file = "finger.calibration.npz"
    <BLANKLINE>
    """
    kept = re.sub(r"(?ms)^\[calibration\]\s*$.*?(?=^\[|\Z)", "", text).rstrip()
    comments = "".join(f"# {line}\n" for line in str(found).splitlines())
    return f'{kept}\n\n[calibration]\n{comments}file = "{numbers}"\n'


def write_calibrated(path: str | Path, skin_file: str | Path, found: SkinCalibration) -> tuple[Path, Path]:
    """Write a calibrated skin.toml and, beside it, NAME.calibration.npz; returns both paths.

    Raises
    ------
    InvalidInput
        A name that does not end in .toml, or another folder than that of a skin.toml that names a positions_file.

    Examples
    --------
    >>> from palpate.calibrate import write_calibrated
    >>> # write_calibrated("calibrated.toml", "skin.toml", skin.calibration)
    """
    target, source = Path(path), Path(skin_file)
    if target.suffix.lower() != ".toml":
        raise InvalidInput(f"{target}: a calibrated skin file ends in .toml. Write {target.with_suffix('.toml').name}.")
    text = skin_text(source)
    if re.search(r"(?m)^\s*positions_file\s*=", text) and target.resolve().parent != source.resolve().parent:
        raise InvalidInput(
            f"{source} names a positions_file beside it: write {target.name} into {source.resolve().parent}."
        )
    numbers = target.with_name(f"{target.stem}.calibration.npz")
    held: dict[str, Any] = {"version": np.asarray(VERSION), "readings": np.asarray(found.readings)}
    held["unit"], held["unit_std"], held["elastic_error"] = (
        np.asarray(v) for v in (found.unit, found.unit_std, found.elastic_error)
    )
    held["scale"] = np.asarray(found.scale)
    held["said"], held["table"] = np.asarray(json.dumps(found.said)), np.asarray(json.dumps(found.table))
    if found.constants is not None:
        held["constants"] = np.asarray(found.constants.json())
    for key in ("rest", "zero", "zero_std"):
        if getattr(found, key) is not None:
            held[key] = getattr(found, key)
    for name, one in found.maps.items():
        held.update({f"{name}.{key}": value for key, value in one.arrays().items()})

    def fill_text(name: str) -> None:
        Path(name).write_text(calibrated_text(text, found, numbers.name), encoding="utf-8")

    write_arrays(numbers, held)
    atomically(target, fill_text)
    return target, numbers


def read_calibration(skin_file: str | Path) -> SkinCalibration | None:
    """The calibration that a skin.toml names; None without a section [calibration].

    Raises
    ------
    InvalidInput
        The file of numbers is not there, or is damaged.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.calibrate import read_calibration
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/skin.toml").write_text("[pad]")
    ...     print(read_calibration(f"{folder}/skin.toml"))
    None
    """
    source = Path(skin_file)
    section = tomllib.loads(skin_text(source)).get("calibration")
    if section is None:
        return None
    path = source.parent / str(section.get("file", ""))
    if not path.is_file():
        raise InvalidInput(
            f"{source}: its [calibration] names {path.name}, which is not beside it. Copy it there, or leave the section out to use the skin without its calibration."
        )
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            held = {k: file[k] for k in file.files}
        names = dict.fromkeys(k.partition(".")[0] for k in held if "." in k)
        maps = {
            n: ForceMap.from_arrays({k.partition(".")[2]: v for k, v in held.items() if k.startswith(f"{n}.")})
            for n in names
        }
        if not maps:
            raise ValueError("holds no map")
        table = tuple((str(a), float(b), float(c), float(d)) for a, b, c, d in json.loads(str(held["table"])))
        return SkinCalibration(
            maps, int(held["readings"]), float(held["unit"]), float(held["unit_std"]), float(held["elastic_error"]),
            tuple(json.loads(str(held["said"]))), table, held.get("rest"),
            float(held["scale"]), held.get("zero"), held.get("zero_std"),
            constants=PadConstants.from_json(str(held["constants"])) if "constants" in held else None,
        )  # fmt: skip
    except (KeyError, ValueError, OSError, zipfile.BadZipFile, np.linalg.LinAlgError) as error:
        raise InvalidInput(f"{path}: no calibration of palpate, or damaged ({error}). Calibrate again.") from error
