"""Save and load the maps that a `palpate.SolidPad` has computed for sensors; pad.py imports this file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate._recall import digest, read, write
from palpate.errors import InvalidInput
from palpate.solid.adjoint import DIGITS

__all__ = ["known_to", "load", "save"]

#: Cached attributes of a pad that do not depend on its accuracy.
WORKED_OUT = ("solid", "_top", "_kept")


def known_to(pad: Any, accuracy: float) -> Any:
    """Return the pad with another accuracy, and with the maps that it has computed."""
    out = replace(pad, accuracy=accuracy)
    out.__dict__.update({name: pad.__dict__[name] for name in WORKED_OUT if name in pad.__dict__})
    return out


def _digest(pad: Any) -> str:
    return digest(replace(pad, accuracy=None)) or ""


def save(pad: Any, path: str | Path) -> None:
    """See `SolidPad.save`."""
    keys = list(pad._kept)
    places = np.array([k[:3] for k in keys]).reshape(-1, 3)
    widths = np.array([k[4:] for k in keys]).reshape(-1, 2)
    names = np.array([k[3].encode() for k in keys], dtype="S64")
    fields = np.array(list(pad._kept.values())).reshape(len(keys), 3, len(pad._top))
    about = {"pad": _digest(pad)} | ({} if pad.accuracy is None else {"accuracy": repr(float(pad.accuracy))})
    write(str(path), {"fields": (places, names, widths, fields)}, about)


def load(pad: Any, path: str | Path) -> Any:
    """See `SolidPad.load`."""
    said: dict[str, str] = {}

    def check(about: Any) -> None:
        if about.get("pad") != _digest(pad):
            raise InvalidInput(
                f"{path} was worked out for another solid pad: its shape, mesh or material differs. Work it out again (SolidPad.save)."
            )
        said.update(about)

    places, names, widths, fields = read(path, check).entries["fields"]
    for place, name, width, field in zip(places, names, widths, fields):
        x, y, depth = place.tolist()
        where = (round(x, DIGITS), round(y, DIGITS), depth)
        pad._kept[(*where, bytes(name).decode(), *map(float, width))] = np.asarray(field)
    return pad if pad.accuracy is not None or "accuracy" not in said else known_to(pad, float(said["accuracy"]))
