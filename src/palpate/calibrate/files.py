"""Read and write calibrated.toml: the skin file with a section [calibration], and a file of numbers beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from palpate.calibrate.calibration import SkinCalibration
from palpate.calibrate.constants import PadConstants
from palpate.calibrate.forcemap import ForceMap
from palpate.recordings.skinnumbers import read_numbers, text_with_section, write_numbers

__all__ = ["calibrated_text", "read_calibration", "write_calibrated"]

SECTION = "calibration"
#: Advice in errors about damaged files.
REMEDY = "Calibrate again with palpate calibrate, or leave the section out to use the skin without its calibration"
#: Fields that are numbers, and fields that are arrays; arrays may be None.
NUMBERS = ("readings", "unit", "unit_std", "elastic_error", "elastic_weight", "elastic_inflation", "scale")
ARRAYS = ("rest", "zero", "zero_std", "gains")


def calibrated_text(text: str, found: SkinCalibration, numbers: str) -> str:
    """The text of a skin.toml with the section [calibration] (replacing an old one); comments give the result.

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
    return text_with_section(text, SECTION, found, numbers)


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
    held: dict[str, Any] = {name: np.asarray(getattr(found, name)) for name in NUMBERS}
    held["said"], held["table"] = np.asarray(json.dumps(found.said)), np.asarray(json.dumps(found.table))
    if found.constants is not None:
        held["constants"] = np.asarray(found.constants.json())
    held.update({name: getattr(found, name) for name in ARRAYS if getattr(found, name) is not None})
    for name, one in found.maps.items():
        held.update({f"{name}.{key}": value for key, value in one.arrays().items()})
    return write_numbers(path, skin_file, SECTION, found, held)


def read_calibration(skin_file: str | Path) -> SkinCalibration | None:
    """Read the calibration that a skin.toml names; None if it has no section [calibration].

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
    return read_numbers(skin_file, SECTION, _made, remedy=REMEDY)


def _made(held: dict[str, Any]) -> SkinCalibration:
    names = dict.fromkeys(k.partition(".")[0] for k in held if "." in k)
    maps = {
        n: ForceMap.from_arrays({k.partition(".")[2]: v for k, v in held.items() if k.startswith(f"{n}.")})
        for n in names
    }
    if not maps:
        raise ValueError("holds no map")
    numbers: dict[str, Any] = {n: held[n].item() for n in NUMBERS if n in held}
    arrays: dict[str, Any] = {n: held.get(n) for n in ARRAYS}
    return SkinCalibration(
        maps,
        **numbers,
        **arrays,
        said=tuple(json.loads(str(held["said"]))),
        table=tuple((str(a), float(b), float(c), float(d)) for a, b, c, d in json.loads(str(held["table"]))),
        constants=PadConstants.from_json(str(held["constants"])) if "constants" in held else None,
    )
