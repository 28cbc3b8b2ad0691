"""The files of the first hour: palpate demo taxels, markers and field write what the page describes, and its commands read them."""

from __future__ import annotations

import csv
import re
import shlex
import textwrap
from pathlib import Path

import numpy as np
import pytest

from command_line import run
from palpate.cli import demofiles
from palpate.recordings import read_columns, read_recording

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "first-hour.md"


def commands(part: str) -> list[str]:
    """The commands of the page on one line each."""
    text = PAGE.read_text(encoding="utf-8").replace("\\\n", " ")
    found = re.findall(r"^\s*(?:\d\. )?`?(palpate [^`\n]*)", text, re.MULTILINE)
    return [" ".join(c.split()) for line in found for c in line.split(" && ") if part in c]


def test_the_page_shows_the_skin_that_is_written() -> None:
    text = PAGE.read_text(encoding="utf-8")
    shown = re.search(r"^( *)```toml\n(.*?)^\1```", text, re.DOTALL | re.MULTILINE)
    assert shown is not None
    assert textwrap.dedent(shown[2]) == demofiles._SKIN


@pytest.mark.long
def test_the_counts_of_the_page_tell_the_force_that_it_names(tmp_path: Path) -> None:
    (demo,) = commands("demo taxels")
    assert run(*shlex.split(demo)[1:], cwd=tmp_path).returncode == 0
    folder = tmp_path / "first-hour"
    counts = read_recording(folder / "taxels.csv", mapping=read_columns(folder / "skin.toml"))
    assert counts.readings.shape == (300, 3, 4, 4)
    np.testing.assert_allclose(counts.time, np.arange(300) / 50)
    (one,) = commands("--frame 150")
    done = run(*shlex.split(one)[1:], cwd=folder)
    assert done.returncode == 0, done.stderr
    low, high = map(float, re.findall(r"force z .*\((?:95 %: )?([\d.]+) to ([\d.]+)\)", done.stdout)[0])
    assert low < 2.0 < high < 2.5


@pytest.mark.long
def test_markers_and_vectors_of_the_page_are_read(tmp_path: Path) -> None:
    for demo in (*commands("demo markers"), *commands("demo field")):
        assert run(*shlex.split(demo)[1:], cwd=tmp_path).returncode == 0
    track = next(c for c in commands("markers.csv") if " track " in c)
    mapping = shlex.split(track)[-1]
    assert run("convert", "markers.csv", "m.nc", "--map", mapping, cwd=tmp_path).returncode == 0
    markers = read_recording(tmp_path / "m.nc")
    assert markers.readings.shape == (100, 2, 80)
    assert markers.positions.shape == (80, 2)
    assert [np.load(tmp_path / name).shape for name in ("u.npy", "v.npy")] == [(128, 128)] * 2


@pytest.mark.parametrize("story", ["taxels", "field"])
def test_a_demo_keeps_what_was_edited(tmp_path: Path, story: str) -> None:
    name = demofiles.FILES[story][0]
    (tmp_path / name).write_text("mine")
    done = run("demo", story, "--out", ".", cwd=tmp_path)
    assert done.returncode == 2
    assert "is kept" in done.stderr
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.long
def test_commands_of_the_first_cells_give_what_the_page_shows(tmp_path: Path) -> None:
    pytest.importorskip("tifffile")
    text = (PAGE.parent / "cells-first.md").read_text(encoding="utf-8")
    lines = re.findall(r"^(palpate [^`\n]*)", text, re.MULTILINE)
    parts = [part.strip() for line in lines for part in line.split("&&")]
    folder = tmp_path
    for part in parts:
        if part.startswith("cd "):
            folder = folder / part[3:]
            continue
        done = run(*shlex.split(part)[1:], cwd=folder)
        assert done.returncode == 0, done.stderr
    tables = re.findall(r"((?:^\| \d \| \d \|.*\n)+)", text, re.MULTILINE)
    assert len(tables) == 2
    for table, name in zip(tables, ("film.csv", "piv.csv")):
        found = list(csv.DictReader((folder / name).read_text().splitlines()))
        shown = [[float(n) for n in re.findall(r"[\d.]+", line)] for line in table.splitlines()]
        assert len(found) == len(shown) == 6
        for row, (frame, cell, _, energy, low, high) in zip(found, shown):
            assert (int(row["frame"]), int(row["cell"])) == (frame, cell)
            # Markov chains part where rounding differs, so another processor draws as another seed does. Of eight seeds
            # the energies have standard deviations of 3 to 16 %, the ends of their intervals of 2 to 34 %.
            for key, value, within in (("J", energy, 0.35), ("low", low, 0.35), ("high", high, 0.7)):
                assert 1e15 * float(row[f"strain_energy_{key}"]) == pytest.approx(value, rel=within, abs=0.006)
    assert "0.29 and 0.35 fJ" in text
    assert len((folder / "film-labels.csv").read_text().splitlines()) == 1 + 3 * 12
    assert {p.suffix for p in folder.glob("pair.*")} == {".html", ".png", ".csv", ".nc"}
