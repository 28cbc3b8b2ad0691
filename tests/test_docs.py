"""The code in the README and the documentation runs as it stands."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from palpate.recordings.skinfile import skin_from_text

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return ["\n".join(line[len(indent) :] for line in body.splitlines()) for indent, body in found]


#: Pages whose examples take a second or more.
SLOW = ("archives.md", "cells.md", "glued.md", "live.md", "shear.md", "sinks.md")
WITH_CODE = [p for p in PAGES if blocks(p, "python")]


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, id=p.name, marks=[pytest.mark.long] if p.name in SLOW else []) for p in WITH_CODE],
)
def test_code_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile("\n".join(blocks(page, "python")), str(page), "exec"), {})


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "toml")], ids=lambda p: p.name)
def test_skin_files_are_valid(page: Path) -> None:
    for text in blocks(page, "toml"):
        tomllib.loads(text)
        if '"scattered"' not in text:
            skin_from_text(text, page.name, ROOT)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target
