"""The code in the README and the documentation runs as it stands."""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path

import pytest

from palpate.recordings.skinfile import skin_from_text

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return ["\n".join(line[len(indent) :] for line in body.splitlines()) for indent, body in found]


#: Pages whose examples take a second or more.
SLOW = (
    *("archives.md", "calibrate.md", "camera.md", "cells.md", "design.md", "first-hour.md", "glued.md", "gradients.md"),
    *("identify.md", "live.md", "measured.md", "shear.md", "sinks.md", "solid.md", "tutorial.md"),
)
OUTPUTS = runpy.run_path(str(ROOT / "docs" / "_outputs.py"))
WITH_CODE = [p for p in PAGES if blocks(p, "python")]


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, id=p.name, marks=[pytest.mark.long] if p.name in SLOW else []) for p in WITH_CODE],
)
def test_code_runs_and_prints_what_the_page_shows(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = page.read_text()
    printed = OUTPUTS["printed"](text, str(page))
    if page.name != "README.md":
        assert OUTPUTS["differences"](text, printed) == [], "python docs/_outputs.py --write"


def test_what_a_page_shows_is_compared_up_to_the_last_digit() -> None:
    same = OUTPUTS["same"]
    assert same("force 1.002 N (0.99 to 1.01)\n", "force  1.003 N (0.99 to 1.01)")
    assert same("[ 0.45 -0.    1.18]", "[0.45 0.   1.18]")
    assert same("took ... s, 3 frames", "took 0.3 s, 3 frames")
    assert not same("force 1.002 N", "force 1.05 N")
    assert not same("force 1.002 N", "moment 1.002 N")
    assert not same("3 frames", "4 frames")
    assert not same("1.5e+03", "1.5e+04")
    assert not same("3 frames", "3 frames, 1 late")


def test_a_page_that_shows_nothing_or_something_else_is_told_and_mended() -> None:
    page = "Before.\n\n```python\nx = 2\n```\n\n1. In a list:\n\n   ```python\n   print(x)\n   ```\n\nAfter.\n"
    printed = OUTPUTS["printed"](page, "page.md")
    assert printed == ["", "2"]
    assert len(OUTPUTS["differences"](page, printed)) == 1
    mended = OUTPUTS["written"](page, printed)
    assert "   ```\n\n   ```output\n   2\n   ```\n\nAfter." in mended
    assert OUTPUTS["differences"](mended, printed) == []
    stale = mended.replace("output\n   2", "output\n   3")
    assert len(OUTPUTS["differences"](stale, printed)) == 1
    assert OUTPUTS["written"](stale, printed) == mended


def test_blocks_of_any_language_end_where_they_end() -> None:
    page = "Before.\n\n```{include} table.md\n:start-line: 2\n```\n\nBetween.\n\n```sh\nmake\n```\n\nAfter.\n"
    assert [(b.language, b.text) for b in OUTPUTS["blocks"](page)] == [
        ("{include}", ":start-line: 2\n"),
        ("sh", "make\n"),
    ]


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


def cells_of(page: str) -> dict[str, list[str]]:
    """Rows of the tables of a generated page by their first cell."""
    rows = re.findall(r"^\| (.+?) \|$", (ROOT / "docs" / "_generated" / page).read_text(), flags=re.MULTILINE)
    return {cells[0]: cells for cells in (row.split(" | ") for row in rows)}


def test_the_readme_quotes_the_validation_that_is_printed() -> None:
    readme = (ROOT / "README.md").read_text()
    shown = ROOT / "docs" / "_generated" / "validation"
    texts = {name: (shown / f"{name}.txt").read_text() for name in ("paper", "line", "area", "alvalayers", "layers3d")}
    for strain in re.findall(r"strain_zz +\S+ +division (\S+)", texts["paper"])[:2]:
        assert f"{float(strain):.2e}".replace("e-0", "e-") in readme
    worst = max(float(re.findall(r"at 32 cells: (\S+)", texts[name])[0]) for name in ("line", "area"))
    assert f"within {worst:.1e}".replace("e-0", "e-") in readme
    disc = next(line for line in texts["alvalayers"].splitlines() if "singledepth" in line)
    largest = max(float(v) for v in re.findall(r"_MPa (\S+)", disc))
    assert f"within {largest:.1e}".replace("e-0", "e-") in readme
    assert max(float(v) for v in re.findall(r" (\d\.\de-\d+) \(", texts["layers3d"])) < 4e-3


def test_the_readme_quotes_the_accuracy_that_is_measured() -> None:
    measured, readme = cells_of("accuracy.md"), (ROOT / "README.md").read_text()
    names = {"line": "line", "area": "area", "three channels": "three channels", "bonded displacement": "glued gel"}
    names["across the edge"] = "contacts across the array's edge"
    for layout, name in names.items():
        assert f"{name} {measured[layout][-1]}" in readme
    for quantity, name in {"normal force": "", "shear force": "", "peak pressure": "peak", "traction": "cells"}.items():
        held = float(measured[quantity][-1].split(", ")[1])
        assert f"{name or quantity} {100 * held:.0f} %" in readme
