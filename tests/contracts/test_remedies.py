"""What a refusal advises works, on the very input that was refused; and the table of messages is that of the source."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest

import palpate as pp
from remedies import NOTES, REMEDIES, Remedy

ROOT = Path(__file__).parents[2]


def raised_in(error: BaseException | None) -> set[str]:
    """The modules in which an error and those that it was made of were raised."""
    found = set()
    while error is not None:
        at = error.__traceback__
        while at is not None and at.tb_next is not None:
            at = at.tb_next
        if at is not None:
            found.add(Path(at.tb_frame.f_code.co_filename).with_suffix("").as_posix())
        error = error.__cause__ or error.__context__
    return found


CASES = [pytest.param(r, id=re.sub(r"\W+", "-", r.words).strip("-")) for r in REMEDIES]


@pytest.mark.parametrize("remedy", CASES)
@pytest.mark.long
def test_what_is_advised_works(remedy: Remedy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        tried(remedy)
    except pp.Unsupported as error:
        if "pip install" in str(error):
            pytest.skip(str(error))
        raise


REFUSED = [remedy for remedy in REMEDIES if not remedy.slow and remedy.given is None]


@pytest.mark.parametrize("remedy", [pytest.param(r, id=re.sub(r"\W+", "-", r.words).strip("-")) for r in REFUSED])
def test_what_is_refused_says_why(remedy: Remedy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The refusal alone, where it is quick and needs no file; `test_what_is_advised_works` causes every one, with the long tests."""
    monkeypatch.chdir(tmp_path)
    refused(remedy)


def tried(remedy: Remedy) -> None:
    refused(remedy)
    got = remedy.advised()
    assert remedy.right is None or remedy.right(got)


def refused(remedy: Remedy) -> None:
    if remedy.given is not None:
        remedy.given()
    with pytest.raises(pp.PalpateError) as caught:
        remedy.refused()
    if "pip install" in str(caught.value):
        raise caught.value
    pattern = ".*".join(re.escape(part) for part in remedy.words.strip().split("{}"))
    assert re.search(pattern, str(caught.value)), str(caught.value)
    if remedy.room:
        assert any(place.endswith("palpate/" + remedy.room.replace(".", "/")) for place in raised_in(caught.value))


@pytest.mark.long
def test_the_table_of_messages_is_that_of_the_source(monkeypatch: pytest.MonkeyPatch) -> None:
    """Written by `python benchmarks/messages.py --write`: each message of the source, and each that is no longer there."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import messages

    monkeypatch.delitem(sys.modules, "messages")
    made = messages.table()
    kept = (ROOT / "docs" / "_generated" / "messages.md").read_text(encoding="utf-8")

    def rows(text: str) -> set[tuple[str, ...]]:
        cells = [re.split(r"(?<!\\) ?\| ?", line) for line in text.splitlines() if line.startswith("| ")]
        # rows of messages; how many were tried goes by the extras that are here
        return {tuple(row[1:4]) for row in cells if len(row) > 6}

    new, old = rows(made), rows(kept)
    assert len(new) > 500
    assert (sorted(new - old), sorted(old - new)) == ([], []), "run python benchmarks/messages.py --write"
    assert [(r.words, messages.meant(r)) for r in REMEDIES if len(messages.meant(r)) != 1] == []


# -- notes -------------------------------------------------------------------------------------------------------------------


def pattern(note: Any) -> str:
    return ".*".join(re.escape(part) for part in note.words.split("{}"))


@pytest.mark.long
@pytest.mark.parametrize(
    "note", [pytest.param(n, id=f"{i}-" + re.sub(r"\W+", "-", n.words)[:60].strip("-")) for i, n in enumerate(NOTES)]
)
def test_what_a_note_advises_works(note: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from remedies.notes import texts

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
