"""What a note advises works, on the very readings of which it was said."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

import palpate as pp
from remedies.notes import NOTES, Note, texts

ROOT = Path(__file__).parents[1]


def pattern(note: Note) -> str:
    return ".*".join(re.escape(part) for part in note.words.split("{}"))


@pytest.mark.long
@pytest.mark.parametrize(
    "note", [pytest.param(n, id=f"{i}-" + re.sub(r"\W+", "-", n.words)[:60].strip("-")) for i, n in enumerate(NOTES)]
)
def test_what_a_note_advises_works(note: Note, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if note.given is not None:
        note.given()
    try:
        said = texts(note.said())
        got = note.advised()
    except pp.Unsupported as error:
        if "pip install" in str(error):
            pytest.skip(str(error))
        raise
    assert re.search(pattern(note), " ".join(said.split())), said
    assert note.right is None or note.right(got)
    after = re.search(pattern(note), " ".join(texts(got).split()))
    assert note.right is not None or not note.stays
    assert note.stays or not after, texts(got)


@pytest.mark.long
def test_each_case_is_of_one_note_of_the_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    for name in ("messages", "notes"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    import notes

    assert len(notes.notes()) > 100
    kept = (ROOT / "docs" / "_generated" / "messages.md").read_text(encoding="utf-8")
    assert kept.endswith(notes.table()), "run python benchmarks/messages.py --write"
    assert [(n.words, notes.meant(n)) for n in NOTES if len(notes.meant(n)) != 1] == []
