"""What a refusal advises works, on the very input that was refused; and the table of messages is that of the source."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import palpate as pp
from remedies import REMEDIES, Remedy, files

ROOT = Path(__file__).parents[1]


def check(remedy: Remedy) -> None:
    pattern = ".*".join(re.escape(part) for part in remedy.words.strip().split("{}"))
    with pytest.raises(pp.PalpateError, match=pattern) as caught:
        remedy.refused()
    assert str(caught.traceback[-1].path).endswith(remedy.room.replace(".", "/") + ".py" if remedy.room else ".py")
    remedy.advised()


@pytest.mark.parametrize("remedy", REMEDIES, ids=lambda r: re.sub(r"\W+", "-", r.words).strip("-"))
def test_what_is_advised_works(remedy: Remedy) -> None:
    check(remedy)


def test_what_is_advised_for_files_works(tmp_path: Path) -> None:
    for remedy in files(tmp_path):
        check(remedy)


def test_the_table_of_messages_is_that_of_the_source(tmp_path: Path) -> None:
    """Written by `python benchmarks/messages.py --write`: each message of the source, and each that is no longer there."""
    made = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "messages.py")],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    ).stdout
    kept = (ROOT / "docs" / "_generated" / "messages.md").read_text(encoding="utf-8")

    def rows(text: str) -> set[tuple[str, str]]:
        cells = [re.split(r"(?<!\\) ?\| ?", line) for line in text.splitlines() if line.startswith("| ")]
        return {(row[1], row[2]) for row in cells[1:]}

    new, old = rows(made), rows(kept)
    assert len(new) > 500
    assert (sorted(new - old), sorted(old - new)) == ([], []), "run python benchmarks/messages.py --write"
    tried = [row for row in made.splitlines() if row.endswith("| yes | yes |")]
    assert len(tried) == len(REMEDIES) + len(files(tmp_path))  # each stands for one message
