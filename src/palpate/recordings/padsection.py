"""Common parts of the sections of a skin.toml, and the sections of pads with edges."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.solid import SolidPad
from palpate.solid.accuracy import through
from palpate.units import UNKNOWN, parse_quantity

try:
    from pydantic import BaseModel, BeforeValidator, ConfigDict
except ImportError as error:
    raise missing("skin files", error) from error

__all__ = [
    "Depth",
    "Length",
    "Lengths",
    "MeasuredTable",
    "Part",
    "Pressure",
    "SolidBend",
    "SolidBox",
    "SolidDome",
    "SolidMesh",
    "Strict",
    "Time",
    "other_mesh",
    "percent",
    "solid_pad",
]


def _length(value: Any) -> float:
    return parse_quantity(value, "length", "length")


def _lengths(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_length(v) for v in value)
    return _length(value)


Length = Annotated[float, BeforeValidator(_length)]
Lengths = Annotated[float | tuple[float, float], BeforeValidator(_lengths)]
Depth = Annotated[Any, BeforeValidator(lambda v: v if v == "base" else _length(v))]
Time = Annotated[float, BeforeValidator(lambda v: parse_quantity(v, "time", "time"))]


def _modulus(value: Any) -> float:
    if isinstance(value, str) and value.strip().lower() == UNKNOWN:
        raise InvalidInput(
            "pressure is unknown, and forces are proportional to it. One known weight determines it: film the gel at rest and then under the weight, "
            'run palpate weigh PICTURES --skin FILE --force "1.96 N", and write here what it says'
        )
    return parse_quantity(value, "pressure", "pressure")


Pressure = Annotated[float, BeforeValidator(_modulus)]


def percent(value: Any) -> float:
    """Parse a percentage: "10 %" -> 0.1."""
    match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*%\s*", value) if isinstance(value, str) else None
    if match is None:
        raise InvalidInput(f'an uncertainty must be a part such as "10 %"; got {value!r}.')
    return float(match[1]) / 100.0


Part = Annotated[float, BeforeValidator(percent)]


def _named(value: Any) -> Any:
    if isinstance(value, str) and value.strip().lower() == UNKNOWN:
        raise InvalidInput("this name is unknown: the comment beside it says what to make, and its name goes here")
    return value


Named = Annotated[str, BeforeValidator(_named)]


class Strict(BaseModel):
    """A section that does not accept unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class Solid(Strict):
    """What all pads by finite elements have; ``responses`` is a file of `palpate.SolidPad.save` beside the skin.toml."""

    prony: list[tuple[float, Time]] | None = None
    youngs_modulus: Pressure
    poissons_ratio: float
    accuracy: Part | None = None
    responses: Named | None = None


class Shaped(Solid):
    """A pad whose mesh is made here."""

    thickness: Length
    sides: Literal["free", "bonded"] = "free"
    element: Length | None = None


class SolidBox(Shaped):
    """`palpate.SolidPad.box`."""

    kind: Literal["solid_box"]
    length: Length
    width: Length


class SolidDome(Shaped):
    """`palpate.SolidPad.dome`."""

    kind: Literal["solid_dome"]
    radius: Length
    height: Length | None = None
    readings_along: Literal["surface", "pad"] = "surface"


class SolidBend(Shaped):
    """`palpate.SolidPad.bend`; ``radius`` is negative inside a bend."""

    kind: Literal["solid_bend"]
    radius: Length
    length: Length
    width: Length
    readings_along: Literal["surface", "pad"] = "surface"


class SolidMesh(Solid):
    """`palpate.SolidPad.from_mesh`; ``file`` is beside the skin.toml."""

    kind: Literal["solid_mesh"]
    file: Named
    base: Named
    contact: Named
    scale: float = 1.0
    turned: bool = False
    readings_along: Literal["surface", "pad"] = "surface"


class MeasuredTable(Strict):
    """`palpate.Measured`; ``file`` is beside the skin.toml."""

    kind: Literal["measured"]
    prony: list[tuple[float, Time]] | None = None
    file: Named
    contact_radius: Length | None = None
    indenter: Literal["hertz", "disc", "punch"] | None = None


def solid_pad(section: SolidBox | SolidDome | SolidBend | SolidMesh, folder: Path) -> SolidPad:
    """The pad that a section describes; files lie in ``folder``."""
    given = section.model_dump(exclude={"kind", "prony", "file", "accuracy", "responses"})
    make: dict[str, Callable[..., SolidPad]] = {
        "solid_box": SolidPad.box,
        "solid_dome": SolidPad.dome,
        "solid_bend": SolidPad.bend,
    }
    if isinstance(section, SolidMesh):
        pad = SolidPad.from_mesh(folder / section.file, **given)
    else:
        pad = make[section.kind](**given)
    pad = replace(pad, accuracy=section.accuracy)
    return pad if section.responses is None else pad.load(folder / section.responses)


def other_mesh(section: SolidBox | SolidDome | SolidBend, pad: SolidPad) -> SolidPad:
    """The pad of a section with another mesh, for `SolidPad.mesh_error`: with one element fewer through the thickness;
    with more if there are at most three, because coarser meshes are too far off to say much.
    """
    count = round(through(pad))
    count = count - 1 if count > 3 else count + 1 if count == 3 else count + 2
    changed = {"element": section.thickness / count, "accuracy": None, "responses": None}
    return solid_pad(section.model_copy(update=changed), Path())
