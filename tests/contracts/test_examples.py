"""Examples in docstrings: they run, and every public name has one."""

from __future__ import annotations

import doctest
import functools
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import palpate
from long_runs import long_runs

#: Rooms whose public names each have an example.
ROOMS = ("palpate", "palpate.solutions", "palpate.elastic", "palpate.sensing", "palpate.recordings", "palpate.network")
#: Classes of which each public method and property has an example of its own; of others the example of the class uses it.
FRONT = ("Skin", "Touch", "Tracker", "GraspMonitor")
#: Names without an example, and why.
EXCEPTIONS = {
    "InvalidInput": "an exception",
    "NotObservable": "an exception",
    "PalpateError": "an exception",
    "Unsupported": "an exception",
    "Recorder": "a protocol: Sink with a with statement; recorder() makes one",
}
#: Members that are no part of an example, and why.
MEMBERS = {
    ("Format", name): "what a new format overrides"
    for name in (
        "own",
        "read",
        "read_mapped",
        "columns",
        "opened",
        "write",
        "read_touch",
        "write_touch",
        "touch_stream",
        "recorder",
    )
}


def modules() -> list[str]:
    """Every module of the package that has an example; nothing is imported to find them."""
    root = Path(palpate.__file__).parent
    files = [path for path in sorted(root.rglob("*.py")) if ">>> " in path.read_text(encoding="utf-8")]
    return [".".join(("palpate", *path.relative_to(root).with_suffix("").parts)) for path in files]


#: Modules whose examples take seconds.
SLOW = ("palpate.design.placement", "palpate.design.sweep", "palpate.measured.pad", "palpate.pads")


@pytest.mark.parametrize("name", [*(name for name in modules() if name not in SLOW), *long_runs(*SLOW)])
@pytest.mark.long
def test_examples_run(name: str) -> None:
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried > 0
    assert failed == 0


def public() -> Iterator[tuple[str, Any]]:
    """Public classes and functions by name, each once."""
    seen = set()
    for room in ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            value = getattr(module, name)
            if (inspect.isclass(value) or inspect.isfunction(value)) and id(value) not in seen:
                seen.add(id(value))
                yield name, value


def own(value: type) -> dict[str, str]:
    """Docstrings of the public methods and properties that palpate defines, also in parent classes."""
    found: dict[str, str] = {}
    for parent in reversed([c for c in value.__mro__ if c.__module__.startswith("palpate")]):
        for name, member in vars(parent).items():
            if isinstance(member, property):
                function: Any = member.fget
            elif isinstance(member, functools.cached_property):
                function = member.func
            else:
                function = getattr(member, "__func__", member)
            field = name in getattr(value, "__dataclass_fields__", ())  # its default may be a function
            if not name.startswith("_") and not field and inspect.isfunction(function):
                found[name] = function.__doc__ or ""
    return found


def examples(text: str | None) -> str:
    """The lines of the examples of a docstring, results left out."""
    return "".join(e.source for e in doctest.DocTestParser().get_examples(text or ""))


def missing() -> Iterator[str]:
    for name, value in public():
        if name in EXCEPTIONS:
            continue
        if not examples(value.__doc__):
            yield name
        if not inspect.isclass(value):
            continue
        shown = "".join(examples(c.__doc__) for c in value.__mro__)
        for member, text in own(value).items():
            if examples(text) or (name, member) in MEMBERS:
                continue
            if name in FRONT or f".{member}" not in shown:
                yield f"{name}.{member}"


def test_every_public_name_has_an_example() -> None:
    assert list(missing()) == []


def test_exceptions_are_still_needed() -> None:
    named = dict(public())
    for name in EXCEPTIONS:
        assert not examples(named[name].__doc__), f"{name} has an example: take it off the list"
    for name, member in MEMBERS:
        assert not examples(own(named[name])[member]), f"{name}.{member} has an example: take it off the list"
