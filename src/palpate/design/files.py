"""design.toml: a skin.toml with the press, the variables, and the goals.

[press]                          # optional: the purpose of the sensor
force = "2 N"                    # "200 N/m" on a line
contact_radius = "2 mm"          # of the contact, not of the ball
shear = 0.3                      # tangential over normal force
friction = 0.6
center = ["0 mm", "0 mm"]        # x, y; by default the middle of the array

[sweep]                          # optional: lists of values, tried in every combination
depth = ["1 mm", "2 mm", "4 mm"]
thickness = ["3 mm", "6 mm"]     # of a pad of bonded layers
pitch = ["2 mm", "3 mm"]
aperture = ["0.5 mm", "1 mm"]
channels = [["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"]]
noise = ["50 Pa", "200 Pa"]
shape = [[8, 8], [12, 12]]
youngs_modulus = ["100 kPa", "300 kPa"]
keep = "area"                    # constant when the pitch changes: "taxels" (default) or "area"

[goal]                           # optional: goals
pair = "3 mm"                    # also force, shear, center, radius, friction_reserve, width, wavelength, noticed, blind = "5 %", range
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.design.columns import NUMBERS
from palpate.design.press import Press
from palpate.design.variations import VARIED
from palpate.elastic.channels import channel_unit
from palpate.elastic.pad import Pad
from palpate.errors import InvalidInput, PalpateError
from palpate.recordings.skinfile import line_of, skin_from_text, skin_text, validated
from palpate.sensing.arrays import Array
from palpate.sensing.uncertainty import Uncertainty
from palpate.units import KIND_OF_SI, parse_quantity

__all__ = ["DesignFile", "read_design"]

#: Sections that a plain skin.toml does not have, with their keys.
SECTIONS = {
    "press": ("force", "contact_radius", "shear", "friction", "center"),
    "sweep": (*VARIED, "keep"),
    "goal": tuple(NUMBERS),
}
_LENGTHS = ("depth", "thickness", "pitch", "aperture")


@dataclass(frozen=True)
class DesignFile:
    """The contents of a design.toml.

    Attributes
    ----------
    pad, planes, uncertainty
        Pad, arrays and uncertainty of the skin, as in a skin.toml.
    press : Press
    values : dict of lists
        Values of the variables, in SI units.
    keep : "taxels" or "area"
    goals : dict of float
        In SI units.
    """

    pad: Pad
    planes: tuple[Array, ...]
    uncertainty: Uncertainty
    press: Press
    values: dict[str, list[Any]]
    keep: str
    goals: dict[str, float]


def read_design(path: str | Path) -> DesignFile:
    """Read a design.toml. A skin.toml whose planes state their noise is a design file too.

    Raises
    ------
    InvalidInput
        The file is not there, or an entry is missing, unknown or out of range; the message names the line.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.design import read_design
    >>> text = '''
    ... [pad]
    ... kind = "half_space"
    ... youngs_modulus = "200 kPa"
    ... poissons_ratio = 0.48
    ...
    ... [[plane]]
    ... kind = "area"
    ... shape = [8, 8]
    ... pitch = "2 mm"
    ... depth = "2 mm"
    ... channels = ["stress_zz"]
    ... noise = "100 Pa"
    ...
    ... [press]
    ... force = "2 N"
    ... contact_radius = "3 mm"
    ...
    ... [sweep]
    ... depth = ["1 mm", "2 mm"]
    ...
    ... [goal]
    ... pair = "3 mm"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/design.toml").write_text(text)
    ...     found = read_design(f"{folder}/design.toml")
    >>> found.press.force, found.values, found.goals
    (2.0, {'depth': [0.001, 0.002]}, {'pair': 0.003})
    """
    found = Path(path)
    text = skin_text(found)
    name = str(found)
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError):
        tables = {}  # `validated` reports the error in words
    skin = _without(text, tuple(SECTIONS))
    pad, planes, _, _ = skin_from_text(skin, name, found.parent)
    planes = [p.at_base(pad.thickness) for p in planes]
    uncertainty = Uncertainty(**validated(skin, name).uncertainty.model_dump())
    line = planes[0].dimensions == 1

    def section(title: str) -> dict[str, Any]:
        table = tables.get(title, {})
        if not isinstance(table, Mapping):
            raise InvalidInput(f"{name}: {title} must be a section [{title}]; got {table!r}.")
        for key in table:
            if key not in SECTIONS[title]:
                where = line_of(text, (title, key))
                raise InvalidInput(
                    f"{name}, line {where}: {key} is not a key of [{title}]; accepted: {', '.join(SECTIONS[title])}."
                )
        return dict(table)

    at: tuple[str, str] = ("press", "")
    try:
        given: dict[str, Any] = {"force": 100.0 if line else 1.0, "contact_radius": 2e-3}
        for key, value in section("press").items():
            at = ("press", key)
            given[key] = _press_value(key, value, line)
        press = Press(**given)
        values: dict[str, list[Any]] = {}
        keep = "taxels"
        for key, value in section("sweep").items():
            at = ("sweep", key)
            if key == "keep":
                keep = value
            else:
                values[key] = _swept_values(key, value, planes[0])
        goals = {}
        for key, value in section("goal").items():
            at = ("goal", key)
            goals[key] = _goal(key, value, line)
    except PalpateError as error:
        if str(error).startswith(name):
            raise
        raise InvalidInput(f"{name}, line {line_of(text, at)}: {error}") from error
    return DesignFile(pad, tuple(planes), uncertainty, press, values, keep, goals)


def _without(text: str, sections: tuple[str, ...]) -> str:
    """Return the text with some sections replaced by blank lines, so that line numbers stay the same."""
    out, skip = [], False
    ours = re.compile(rf"^\s*\[\s*({'|'.join(sections)})\s*\]")
    for line in text.split("\n"):
        if re.match(r"^\s*\[{1,2}\s*[A-Za-z_.]+\s*\]{1,2}\s*(#.*)?$", line):
            skip = ours.match(line) is not None
        out.append("" if skip else line)
    return "\n".join(out)


def _press_value(key: str, value: Any, line: bool) -> Any:
    if key == "force":
        return parse_quantity(value, "force per length" if line else "force", key)
    if key == "contact_radius":
        return parse_quantity(value, "length", key)
    if key == "center":
        if not isinstance(value, list) or len(value) != 2:
            raise InvalidInput(f'center must be [x, y] such as ["0 mm", "3 mm"]; got {value!r}.')
        return tuple(parse_quantity(v, "length", key) for v in value)
    return value


def _swept_values(key: str, value: Any, array: Array) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise InvalidInput(f"{key} must be a list of the values to try; got {value!r}.")
    if key == "depth":
        return [v if v == "base" else parse_quantity(v, "length", key) for v in value]
    if key in _LENGTHS:
        return [
            tuple(parse_quantity(w, "length", key) for w in v)
            if isinstance(v, list)
            else parse_quantity(v, "length", key)
            for v in value
        ]
    if key == "youngs_modulus":
        return [parse_quantity(v, "pressure", key) for v in value]
    if key == "noise":
        return [parse_quantity(v, KIND_OF_SI[channel_unit(array.channels[0])], key) for v in value]
    if key == "shape":
        return [tuple(v) if isinstance(v, list) else v for v in value]
    if not all(isinstance(v, list) for v in value):
        raise InvalidInput(
            f'channels must be a list of lists such as [["stress_zz"], ["stress_xz", "stress_zz"]]; got {value!r}.'
        )
    return value


def _goal(key: str, value: Any, line: bool) -> float:
    unit = NUMBERS[key][2]
    if unit in ("mN", "N"):
        return parse_quantity(value, "force per length" if line else "force", key)
    return parse_quantity(value, "strain" if unit == "%" else "length", key)
