"""The best possible resolution of a skin, before it is built.

In: a skin (or design.toml) and a press.
Out: bounds of force, place and radius, the closest pair told apart, the smallest contact noticed; sweeps and placements.
Open first: `result.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from palpate.design.bounds import Bound
from palpate.design.detection import Noticed
from palpate.design.placement import Placement, place
from palpate.design.press import Press
from palpate.design.result import Design, evaluate
from palpate.design.sweep import Sweep, sweep

if TYPE_CHECKING:
    from palpate.design.files import DesignFile, read_design

__all__ = [
    "Bound",
    "Design",
    "DesignFile",
    "Noticed",
    "Placement",
    "Press",
    "Sweep",
    "evaluate",
    "place",
    "read_design",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name in ("DesignFile", "read_design"):  # skin files need pydantic
        from palpate.design import files

        return getattr(files, name)
    raise AttributeError(f"module 'palpate.design' has no attribute {name!r}")
