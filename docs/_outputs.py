"""What the Python of a page prints is shown under it, in a block ```output.

    python docs/_outputs.py docs/tutorial.md ...      runs the pages (all without names) and says what differs
    python docs/_outputs.py --write ...               writes what was printed into the pages

tests/contracts/test_docs.py does the first. Numbers may differ in what another build of a linear algebra gives; `...` in a page stands for anything.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parent
_FENCE = re.compile(r"^(?P<indent> *)```(?P<language>[^\s`]*)[^\n`]*\n(?P<body>.*?)^ *```\n", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?")
#: Of a number, from one build of a library to another.
_RELATIVE = 0.01


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: where it begins and ends (characters of the page), its language, and its text without the indent."""

    start: int
    end: int
    indent: str
    language: str
    text: str


def blocks(page: str) -> list[Block]:
    """All fenced blocks of a page, in order."""
    found = []
    for m in _FENCE.finditer(page):
        text = "".join(line[len(m["indent"]) :] or "\n" for line in m["body"].splitlines(keepends=True))
        found.append(Block(m.start(), m.end(), m["indent"], m["language"], text))
    return found


def outputs(page: str) -> list[tuple[Block, Block | None]]:
    """The Python blocks of a page, each with the block of output that follows it at once."""
    all_blocks = blocks(page)
    found = []
    for block, after in zip(all_blocks, [*all_blocks[1:], None]):
        if block.language == "python":
            shows = after is not None and after.language == "output" and not page[block.end : after.start].strip()
            found.append((block, after if shows else None))
    return found


def printed(page: str, name: str) -> list[str]:
    """What each Python block of a page prints, run in order in one namespace and in the working folder."""
    names: dict[str, object] = {"__name__": "page"}
    said = []
    for block, _ in outputs(page):
        line = page.count("\n", 0, block.start) + 1
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile("\n" * line + block.text, name, "exec"), names)
        said.append("\n".join(line.rstrip() for line in out.getvalue().splitlines()))
    return said


def same(shown: str, said: str) -> bool:
    """Whether the words are the same, and the numbers within a hundredth or one of the last digit (which 0 to 9 have to be exactly)."""
    words = [
        r"\s*".join(re.escape(word).replace(re.escape("..."), ".*?") for word in re.split(r"\s+", part))
        for part in _NUMBER.split(shown.strip())
    ]
    match = re.fullmatch(f"({_NUMBER.pattern})".join(words), said.strip(), re.DOTALL)
    if match is None:
        return False
    for a, b in zip(_NUMBER.findall(shown), match.groups()):
        mantissa, _, exponent = a.partition("e")
        last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        if len(mantissa.lstrip("+-")) == 1 and not exponent:
            last = 0.0  # a count
        if abs(float(a) - float(b)) > max(1.001 * last, _RELATIVE * abs(float(a))):
            return False
    return True


def differences(page: str, said: list[str]) -> list[str]:
    """Each block whose output the page does not show, or shows where nothing is printed, or shows otherwise."""
    found = []
    for (block, shown), text in zip(outputs(page), said):
        where = f"line {page.count(chr(10), 0, block.start) + 1}"
        if text and shown is None:
            found.append(f"{where}: prints, and no ```output follows:\n{text}")
        elif shown is not None and not same(shown.text, text):
            found.append(f"{where}: shows\n{shown.text}and prints\n{text}")
    return found


def written(page: str, said: list[str]) -> str:
    """The page with what was printed under each block; what is shown and still right stays as it is."""
    for (block, shown), text in reversed(list(zip(outputs(page), said))):
        if shown is not None and text and same(shown.text, text):
            continue
        fence = "\n" + "".join(
            block.indent + line if line else "" for line in f"```output\n{text}\n```\n".splitlines(True)
        )
        end = block.end if shown is None else shown.end
        page = page[: block.end] + (fence if text else "") + page[end:]
    return page


def main(arguments: list[str]) -> int:
    """How many pages differ."""
    os.environ.setdefault("MPLBACKEND", "agg")
    write = "--write" in arguments
    named = [Path(a).resolve() for a in arguments if a != "--write"]
    wrong = 0
    for path in named or sorted(DOCS.rglob("*.md")):
        page = path.read_text(encoding="utf-8")
        if not any(block.language == "python" for block in blocks(page)):
            continue
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            said = printed(page, str(path))
        found = differences(page, said)
        if found and write:
            path.write_text(written(page, said), encoding="utf-8")
        wrong += bool(found)
        sys.stdout.write("".join(f"{path.name}: {text}\n" for text in found))
    return 0 if write else wrong


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
