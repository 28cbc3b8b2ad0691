"""Refusals with the calls that their words lead to, on the very input that was refused. benchmarks/messages.py lists which messages are here."""

from __future__ import annotations

import importlib

import pytest

from palpate.errors import Unsupported
from remedies._remedy import Remedy

#: One module for each room that refuses.
ROOMS = (
    "skins",
    "arguments",
    "skinfiles",
    "tables",
    "fields",
    "stores",
    "camera",
    "streams",
    "commands",
    "rest",
    "left",
)


def _of(room: str) -> list[Remedy]:
    """None of a room whose packages are not installed."""
    try:
        return list(importlib.import_module(f"remedies.{room}").REMEDIES)
    except (pytest.skip.Exception, ImportError, Unsupported):
        return []


REMEDIES: list[Remedy] = [remedy for room in ROOMS for remedy in _of(room)]

__all__ = ["REMEDIES", "ROOMS", "Remedy"]
