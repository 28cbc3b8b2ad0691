"""What a remedy is, and the helpers that its rooms share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Remedy:
    """A message by words of it ({} is what is filled in), a call that is refused with it, and the call that it advises.

    ``room`` is the module that refuses, where others have the same words; ``given`` lays what both calls need into the folder that they are made
    in, which is empty before; ``right`` is what must be true of what the advised call returns; a ``slow`` one is refused with the long tests alone.
    """

    words: str
    refused: Callable[[], Any]
    advised: Callable[[], Any]
    room: str = ""
    given: Callable[[], Any] | None = None
    right: Callable[[Any], Any] | None = None
    slow: bool = False


def value(
    words: str,
    make: Any,
    wrong: Any,
    mended: Any,
    *,
    room: str = "",
    right: Any = None,
    given: Any = None,
    slow: bool = False,
) -> Remedy:
    """The same call with another value."""
    return Remedy(words, lambda: make(wrong), lambda: make(mended), room=room, right=right, given=given, slow=slow)


def laid(**files: str | bytes) -> None:
    """Files by their names, with "_" before the ending in place of a point."""
    for name, held in files.items():
        path = Path(".".join(name.rsplit("_", 1)))
        path.write_bytes(held.encode("utf-8") if isinstance(held, str) else held)


def palpate(*arguments: str) -> Any:
    """`palpate ARGUMENTS` as a user calls it, its refusal raised."""
    import contextlib
    import io
    import sys
    from unittest import mock

    import command_line

    out = io.StringIO()
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(out),
        mock.patch.object(sys, "argv", ["palpate", *arguments]),
        mock.patch.object(command_line.typer.main, "get_command", command_line.tree),
    ):
        from palpate.cli import app

        code = app(standalone_mode=False, prog_name="palpate")
    assert code in (0, None), out.getvalue()
    return out.getvalue()


def command(line: str) -> Callable[[], Any]:
    """A call of the command line, as it is written in a shell."""
    import shlex

    return lambda: palpate(*shlex.split(line))
