"""palpate recovers what touches an elastic pad from what is measured inside or under it.

Pressure and shear on the surface, net force and slip margin, from stress, strain or displacement at depth.
SI units throughout; compression positive; z grows into the pad.

`__init__.pyi` lists the public names, for type checkers and for this file. Open `skin.py` first.
"""

from __future__ import annotations

import ast
import importlib
import pkgutil
from typing import Any

__version__ = "0.2.0.dev0"


def _public() -> dict[str, str]:
    """Return the room of each public name, as the stub beside this file imports it."""
    stub = ast.parse(pkgutil.get_data(__name__, "__init__.pyi") or b"")
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {name.name: node.module or "" for node in imports for name in node.names}


_PUBLIC = _public()
__all__ = ["__version__", *_PUBLIC]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    room = _PUBLIC[name]
    if room:
        value = getattr(importlib.import_module(f"palpate.{room}"), name)
    else:
        value = importlib.import_module(f"palpate.{name}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
