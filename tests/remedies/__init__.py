"""Refusals with the calls that their words lead to, on the very input that was refused. benchmarks/messages.py lists which messages are here."""

from __future__ import annotations

import importlib

from remedies._remedy import Remedy

#: One module for each room that refuses.
ROOMS = ("skins", "arguments", "skinfiles", "tables", "fields", "stores", "commands")
REMEDIES: list[Remedy] = [r for room in ROOMS for r in importlib.import_module(f"remedies.{room}").REMEDIES]

__all__ = ["REMEDIES", "ROOMS", "Remedy"]
