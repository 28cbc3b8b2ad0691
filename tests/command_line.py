"""The command line called as a user calls it: inside this process, which saves the imports, or in one of its own."""

from __future__ import annotations

import contextlib
import functools
import importlib
import io
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

pytest.importorskip("typer")  # tests of the command line are left out without it

import typer.main
import typer.testing

from palpate.cli import main

#: A mistake in a command line, as Typer tells it.
UsageError: Any = typer.BadParameter.__base__
#: The tree of commands: made once in a process, as it is where a user starts one.
tree = functools.cache(typer.main.get_command)


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """`palpate ARGUMENTS` in this process: what it prints, and the code that it would leave with.

    An exception other than `SystemExit`, which would be a traceback, is raised; warnings are errors as everywhere in the tests.
    """
    out, err = io.StringIO(), io.StringIO()
    before = signal.getsignal(signal.SIGTERM)
    code: object = None
    try:
        with (
            contextlib.chdir(cwd),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            mock.patch.object(sys, "argv", ["palpate", *arguments]),
            mock.patch.object(typer.main, "get_command", tree),
        ):
            main()
    except SystemExit as left:
        code = left.code
    finally:
        signal.signal(signal.SIGTERM, before)
    if not isinstance(code, int):
        raise AssertionError(f"palpate {' '.join(arguments)} left with {code!r} instead of a number")
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


class CliRunner(typer.testing.CliRunner):
    """Typer's own, with the tree of commands made once."""

    def invoke(self, *arguments: Any, **options: Any) -> Any:
        with mock.patch.object(typer.testing, "_get_command", tree):
            return super().invoke(*arguments, **options)


def smaller_demo(monkeypatch: pytest.MonkeyPatch) -> None:
    """palpate demo on 8 x 8 taxels of the same array instead of 32 x 32."""
    demo = importlib.import_module("palpate.cli.demo")
    text = demo._DEMO_SKIN
    for old, new in (("[32, 32]", "[8, 8]"), ('"1 mm"', '"3 mm"'), ('"50 Pa"', '"200 Pa"')):
        assert old in text
        text = text.replace(old, new)
    monkeypatch.setattr(demo, "_DEMO_SKIN", text)


def process(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The same in a process of its own, where warnings are errors too."""
    return subprocess.run(
        [sys.executable, "-W", "error", "-m", "palpate", *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )
