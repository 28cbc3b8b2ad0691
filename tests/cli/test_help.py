"""What the command line says before any work: help without an argument, an example for each command that its own options accept."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from command_line import run, tree
from palpate.cli.commands import app
from palpate.cli.examples import EXAMPLES, SHORT


def test_a_bare_command_shows_help(tmp_path: Path) -> None:
    for arguments in ((), ("bench",)):
        out = run(*arguments, cwd=tmp_path)
        assert out.returncode == 0
        assert not out.stderr
        assert out.stdout.startswith("Usage: palpate")
    listed = run(cwd=tmp_path).stdout.split("Commands:")[1]
    assert "..." not in listed  # every line is whole
    assert "palpate reconstruct palpate-demo/recording.nc" in listed


@pytest.mark.parametrize("command", list(EXAMPLES))
def test_every_help_ends_with_examples_that_the_command_takes(command: str, tmp_path: Path) -> None:
    out = run(*command.split(), "--help", cwd=tmp_path)
    assert out.returncode == 0
    taken = tree(app)
    for name in command.split():
        taken = taken.commands[name]  # type: ignore[attr-defined]
    known = {o for p in taken.params for o in (*p.opts, *p.secondary_opts)}
    with taken.make_context(command, [], resilient_parsing=True) as ctx:
        known |= {o for p in taken.get_params(ctx) for o in (*p.opts, *p.secondary_opts)}
    for line in EXAMPLES[command]:
        assert f"  {line}\n" in f"{out.stdout}\n"  # not broken by the width of a terminal
        words = shlex.split(line)
        assert words[: 1 + len(command.split())] == ["palpate", *command.split()]
        used = {w for w in words if w.startswith("--")}
        assert used <= known, used - known


def test_every_command_is_listed_in_a_line() -> None:
    listed = list(tree(app).commands)  # type: ignore[attr-defined]
    assert listed == list(SHORT)
    assert max(map(len, SHORT.values())) <= 64
    assert all(text.endswith(".") for text in SHORT.values())
    assert {c.split()[0] for c in EXAMPLES} == set(listed)


def test_a_mistake_says_whose_help_to_read(tmp_path: Path) -> None:
    lost = run("reconstruct", cwd=tmp_path)
    assert lost.returncode == 2
    assert "palpate reconstruct --help has examples" in lost.stderr
    wrong = run("trak", cwd=tmp_path)
    assert "Did you mean 'track'?" in wrong.stderr
    assert "(palpate --help)" in wrong.stderr
