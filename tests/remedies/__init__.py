"""Refusals with the calls that their words lead to, on the very input that was refused. benchmarks/messages.py lists which messages are here."""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

import pytest

from palpate.errors import Unsupported
from remedies._remedy import Remedy

#: One module for each room that refuses.
ROOMS = (
    "skins",
    "arguments",
    "skinfiles",
    "tables",
    "tablefiles",
    "fields",
    "stores",
    "camera",
    "cells",
    "streams",
    "commands",
    "rest",
    "left",
    "copies",
    "more",
    "solids",
    "measureds",
    "designs",
    "calibrations",
    "robotfiles",
    "outlines",
    "sheets",
    "simulators",
    "differentiation",
    "networks",
    "objects",
    "colours",
)


def _of(room: str, name: str = "REMEDIES") -> list[Any]:
    """None of a room whose packages are not installed."""
    try:
        return list(getattr(importlib.import_module(f"remedies.{room}"), name))
    except (pytest.skip.Exception, ImportError, Unsupported):
        return []


#: Rooms whose advised calls take long, one by one: each solves or calibrates something.
SLOW = ("calibrations", "cells", "colours", "designs", "measureds", "outlines", "sheets", "solids")

REMEDIES: list[Remedy] = [
    dataclasses.replace(remedy, slow=remedy.slow or room in SLOW) for room in ROOMS for remedy in _of(room)
]
#: Notes with the calls that their words lead to.
NOTES: list[Any] = _of("notes", "NOTES")

__all__ = ["NOTES", "REMEDIES", "ROOMS", "Remedy"]
