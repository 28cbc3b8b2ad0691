"""What a design is made for: a `palpate.Skin`, which stands above this room and calls it."""

from __future__ import annotations

from typing import Any, TypeAlias

__all__ = ["Skin"]

#: A `palpate.Skin`.
Skin: TypeAlias = Any
