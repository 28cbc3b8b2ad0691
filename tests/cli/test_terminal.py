"""Text of files reaches the screen without the characters that command a terminal."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InvalidInput, printable

RED = "\x1b[31m\x1b]0;title\x07\x9b5A\u202e"
COMMANDS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def test_commands_are_written_as_their_escapes() -> None:
    assert printable(RED + "µ\tü\n") == r"\x1b[31m\x1b]0;title\x07\x9b5A\u202eµ" + "\tü\n"
    assert printable("\udcff\r") == r"\udcff\r"
    assert not COMMANDS.search(str(InvalidInput(f"{RED}: no such file.")))


@pytest.mark.long
def test_headers_of_files_command_no_terminal(tmp_path: Path) -> None:
    """Refusals, warnings and notes of every command that reads tables."""
    pytest.importorskip("typer")
    pytest.importorskip("matplotlib")
    from command_line import run

    rows = "".join(f"{8 * j},{8 * i},{0.1 * (j > 4)},0,0\n" for i in range(10) for j in range(10))
    (tmp_path / "field.csv").write_text(f"x,y,u,v,mask ({RED})\n{rows.replace(',0,0', ',0,1', 1)}")
    (tmp_path / "bad.csv").write_text(f"x,y,{RED},q\n{rows}")
    (tmp_path / "mask.csv").write_text(f"{RED},q\n1,2\n3,4\n3,8\n")
    skin = 'name = "a"\n[pad]\nkind = "half_space"\nyoungs_modulus = "1 kPa"\npoissons_ratio = 0.5\n[[plane]]\nkind = "line"\ncount = 3\npitch = "1 mm"\ndepth = "1 mm"\nchannels = ["stress_zz"]\n'
    (tmp_path / "skin.toml").write_text(skin)
    (tmp_path / "odd.toml").write_text(skin.replace("stress_zz", "\\u001b[31m\\u0007"))
    gel = ["--pixel", "1 um", "--youngs-modulus", "1 kPa", "--poissons-ratio", "0.4", "--draws", "8"]
    said = ""
    for arguments in (
        ("tfm", "field.csv", *gel, "--out", "a"),
        ("tfm", "bad.csv", *gel, "--out", "b"),
        ("tfm", "field.csv", *gel, "--mask", "mask.csv", "--out", "c"),
        ("reconstruct", "bad.csv", "--skin", "skin.toml", "--out", "d.csv"),
        ("reconstruct", "bad.csv", "--skin", "odd.toml", "--out", "d.csv"),
        ("track", "bad.csv", "--skin", "skin.toml", "--out", "e.csv"),
        ("convert", "bad.csv", "f.npz"),
    ):
        done = run(*arguments, cwd=tmp_path)
        assert not COMMANDS.search(done.stdout + done.stderr), arguments
        said += done.stdout + done.stderr
    assert said.count(r"\x1b[31m") >= 2  # the text is there, harmless


def test_what_a_recording_says_of_itself_commands_no_terminal(tmp_path: Path) -> None:
    pytest.importorskip("typer")
    from command_line import run
    from palpate.recordings import write_recording
    from palpate.recordings.recording import Recording

    held = Recording(readings=np.zeros((3, 1, 4)), channels=("stress_zz",), meta={"salvaged": RED, "pitch": RED})
    write_recording(held, tmp_path / "a.npz")
    done = run("convert", "a.npz", "b.csv", cwd=tmp_path)
    assert not COMMANDS.search(done.stdout + done.stderr)
