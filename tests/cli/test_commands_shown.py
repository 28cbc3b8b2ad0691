"""Command lines in the README and the documentation: each command and option that they name exists, and takes what it is given."""

from __future__ import annotations

import re
import runpy
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from command_line import UsageError, tree
from palpate.cli.commands import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "RELEASING.md", "SECURITY.md")),
    *(p for p in sorted((ROOT / "docs").rglob("*.md")) if p.name != "messages.md"),
]
BLOCKS = runpy.run_path(str(ROOT / "docs" / "_outputs.py"))["blocks"]
#: Options of other programs that pages name by themselves: of ROS, which `palpate ros` hands on, and of benchmarks/hyperelastic.py.
FOREIGN = {"--ros-args", "--solve"}


def shown(text: str) -> Iterator[str]:
    """Command lines in fenced blocks, whole: a backslash goes on in the next line; " # ", or three blanks and a word, begin a comment."""
    for block in BLOCKS(text):
        if block.language in ("sh", "text", "bash", "console", ""):
            for line in block.text.replace("\\\n", " ").splitlines():
                for part in line.split(" && "):
                    if part.startswith("palpate "):
                        yield re.split(r" #|(?<=\S)   +(?=[^\s-])", part)[0].strip()


def inline(text: str) -> Iterator[str]:
    """What single backticks hold, outside of fenced blocks."""
    for block in reversed(BLOCKS(text)):
        text = text[: block.start] + text[block.end :]
    for found in re.findall(r"(?<!`)`([^`]+)`(?!`)", text):
        yield " ".join(found.split())


def context_of(command: Any, name: str) -> Any:
    """One in which nothing is read or run yet."""
    context = command.make_context(name, [], resilient_parsing=True)
    context.resilient_parsing = False
    return context


def command_of(words: list[str]) -> tuple[Any, list[str]]:
    """The command that words after `palpate` name, and the words that are left."""
    command: Any = tree(app)
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        if words[0] not in command.commands:
            raise UsageError(f"no command {words[0]}")
        command, words = command.commands[words[0]], words[1:]
    return command, words


def check(line: str) -> None:
    """Parse a line as the command would, without values being read or anything being run."""
    command, words = command_of(shlex.split(line.partition("--ros-args")[0] if "palpate ros " in line else line)[1:])
    context = context_of(command, command.name)
    values, left, _ = command.make_parser(context).parse_args(words)
    if left and not context.allow_extra_args:
        raise UsageError(f"unexpected {left}")
    missing = [p.name for p in command.get_params(context) if p.required and values.get(p.name) in (None, ())]
    if missing:
        raise UsageError(f"needs {missing}")


def options_of(command: Any) -> set[str]:
    """All that it and its commands take."""
    known = {o for p in command.get_params(context_of(command, "")) for o in (*p.opts, *p.secondary_opts)}
    return known.union(*map(options_of, getattr(command, "commands", {}).values()))


@pytest.mark.parametrize("page", [p for p in PAGES if "palpate " in p.read_text()], ids=lambda p: p.stem)
@pytest.mark.long
def test_commands_and_options_that_pages_show_exist(page: Path) -> None:
    text, wrong = page.read_text(), []
    for line in shown(text):
        try:
            check(line)
        except UsageError as error:
            wrong.append(f"{line}: {error.format_message()}")
    everything = options_of(tree(app))
    for code in inline(text):
        named = set(re.findall(r"(?<!\S)--[a-z][\w-]*", code))
        if code.startswith("palpate "):
            try:
                command, _ = command_of(code.split()[1:])
            except UsageError as error:
                wrong.append(f"{code}: {error.format_message()}")
            else:
                wrong += [f"{code}: no {o}" for o in sorted(named - options_of(command))]
        elif code.startswith("--"):
            wrong += [f"{code}: no {o}" for o in sorted(named - everything - FOREIGN)]
    assert wrong == []


def test_what_does_not_exist_is_told() -> None:
    page = "```sh\nm install && palpate track a.nc --skin s.toml \\\n  --frictoin 0.6    # slides\npalpate demo    a picture\n```\n"
    lines = list(shown(page))
    assert [" ".join(line.split()) for line in lines] == [
        "palpate track a.nc --skin s.toml --frictoin 0.6",
        "palpate demo",
    ]
    check(lines[1])
    for line in (
        lines[0],
        "palpate trak a.nc",
        "palpate track --skin s.toml",
        "palpate track a.nc --skin",
        "palpate demo camera x",
    ):
        with pytest.raises(UsageError):
            check(line)
    assert list(inline(page + "See `palpate live` and `--skin`, ``not`this``.")) == ["palpate live", "--skin"]
