"""The documentation's reference has every public name, and its gallery every script."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"
CONF = (ROOT / "docs" / "conf.py").read_text()


def rooms() -> list[str]:
    """Those that docs/conf.py calls public."""
    return re.findall(r'"(palpate[\w.]*)"', CONF.split("\nROOMS = (")[1].split("\n)")[0])


def names(room: str) -> list[str]:
    """What `__all__` of a room says, or the stub of palpate itself; nothing is imported."""
    if room == "palpate":
        stub = ast.parse((SOURCE / "palpate" / "__init__.pyi").read_text())
        return [name.name for node in stub.body if isinstance(node, ast.ImportFrom) for name in node.names]
    file = SOURCE / Path(*room.split("."))
    file = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
    for line in ast.parse(file.read_text()).body:
        if isinstance(line, ast.Assign) and [getattr(t, "id", "") for t in line.targets] == ["__all__"]:
            return [str(name) for name in ast.literal_eval(line.value)]
    raise AssertionError(f"{room} has no __all__")


def listed() -> list[str]:
    pages = (ROOT / "docs" / "reference").glob("*.md")
    return [name for page in pages for name in re.findall(r"^   (palpate\.[\w.]+)$", page.read_text(), re.MULTILINE)]


@pytest.mark.parametrize("room", rooms())
def test_every_public_name_has_a_page(room: str) -> None:
    known = {name.rpartition(".")[2] for name in listed()} | {"__version__", "comparison", "paper", "solutions"}
    assert [name for name in names(room) if name not in known] == []


def test_no_name_has_two_pages() -> None:
    assert len(listed()) == len(set(listed())) > 200
    own_file = re.findall(r'"(palpate[\w.]*)"', CONF.split("\n_FUNCTIONS = (")[1].split("\n)")[0])
    folded = [name.lower() for name in listed() if name not in own_file]
    assert len(folded) == len(set(folded)), (
        "names that differ by a capital alone share a file: add one to _FUNCTIONS in docs/conf.py"
    )


@pytest.mark.parametrize("script", sorted((ROOT / "docs" / "examples").glob("*.py")), ids=lambda p: p.stem)
def test_examples_are_scripts_with_a_title_and_no_chance(script: Path) -> None:
    """The build of the documentation runs them."""
    text = script.read_text()
    said = ast.get_docstring(ast.parse(text)) or ""
    title, line, *_ = said.splitlines()
    assert len(line) == len(title)
    assert set(line) == {"="}
    assert "default_rng()" not in text
