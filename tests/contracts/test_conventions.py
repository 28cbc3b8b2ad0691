"""What a stranger looks for in a repository is there, and says the same as the code."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import palpate as pp

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def citation() -> dict[str, str]:
    """Its lines of one word and one value."""
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    return {
        k: v.strip('"') for k, v in (m.groups() for m in (re.fullmatch(r"([\w-]+): (\S.*)", n) for n in lines) if m)
    }


def test_the_version_is_the_same_everywhere() -> None:
    assert pp.__version__ == PROJECT["version"] == citation()["version"]


def test_the_citation_names_the_licence() -> None:
    assert citation()["license"] == PROJECT["license"]
    assert citation()["cff-version"] == "1.2.0"


@pytest.mark.parametrize("name", [p.name for p in sorted(ROOT.glob("*.md"))])
def test_links_between_files_lead_somewhere(name: str) -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", (ROOT / name).read_text())
    assert [t for t in targets if not (ROOT / t).exists()] == []


def test_the_map_names_rooms_that_exist() -> None:
    section = (ROOT / "CONTRIBUTING.md").read_text().split("## Where things are")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ")][1:]
    rooms = {name for row in rows for name in re.findall(r"`(?:src/palpate/)?([\w/]+)`", row)}
    source = ROOT / "src" / "palpate"
    assert len(rooms) > 12
    assert [r for r in rooms if not ((source / r).is_dir() or (source / f"{r}.py").is_file())] == []


@pytest.mark.parametrize("form", sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")), ids=lambda p: p.stem)
def test_issue_forms_are_forms(form: Path) -> None:
    """The keys that a form must have; ids are unique."""
    text = form.read_text()
    assert "\t" not in text
    if form.stem == "config":
        return
    assert re.match(r"name: .+\ndescription: .+\n(labels: .+\n)?body:\n", text)
    ids = re.findall(r"^    id: (\w+)$", text, re.M)
    assert len(ids) == len(set(ids)) == text.count("  - type: ")
    assert set(re.findall(r"- type: (\w+)", text)) <= {"textarea", "input", "dropdown", "checkboxes", "markdown"}


def test_what_others_made_comes_with_its_licence() -> None:
    uplot = ROOT / "src" / "palpate" / "live" / "static" / "uplot"
    assert "The MIT License" in (uplot / "LICENSE").read_text()
    assert "uPlot (v1." in (uplot / "uplot.js").read_text(encoding="utf-8")[:100]
    assert "src/palpate/live/static/uplot/LICENSE" in PROJECT["license-files"]
