"""Films of sheets of cells, and of fields with displacements out of the plane."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.microscopy import Film

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))


@pytest.mark.long
def test_a_film_of_a_sheet_has_its_tension_and_that_of_its_cells(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    pytest.importorskip("skfem")
    from cells_sheet import MODULUS, sheet_of

    known = sheet_of(2002)
    field = known["field"]
    np.save(tmp_path / "film.npy", np.stack([field.displacement, 0.5 * field.displacement]) / field.pixel)
    tifffile.imwrite(tmp_path / "cells.tif", known["cells"].astype(np.uint8))
    film = Film(
        frames=[tmp_path / "film.npy"], pad=pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=0.48), pixel=field.pixel, unit="px", step=field.step,
        start=field.start, window=int(field.step), cells=tmp_path / "cells.tif", monolayer=True,
    )  # fmt: skip
    rows, _ = film.run(tmp_path / "part.jsonl", processes=1)
    n, mask = known["tension"], known["mask"]
    truth = 0.5 * float((n[0] + n[1])[mask].mean())
    whole = [r for r in rows if r["cell"] == "sheet"]
    assert [r["frame"] for r in whole] == [0, 1]
    for row, part in zip(whole, (1.0, 0.5)):
        assert float(row["average_tension_low"]) < part * truth < float(row["average_tension_high"])
        assert "elastic" in row["notes"]
    small = [r for r in rows if r["frame"] == 0 and "not solved" in r["notes"]]
    assert "15" in {r["cell"] for r in small}  # of one pixel
    cells = [r for r in rows if r["frame"] == 0 and r["cell"] != "sheet" and r not in small]
    assert len(cells) > 10
    held = []
    for row in cells:
        one = known["cells"] == int(row["cell"])
        true = 0.5 * float((n[0] + n[1])[one].mean())
        held.append(float(row["average_tension_low"]) < true < float(row["average_tension_high"]))
    assert np.mean(held) > 0.75
    assert replace(film, monolayer=False).key() != film.key()


@pytest.mark.parametrize("normal", ["up", *long_runs("down", "ignore")])
@pytest.mark.long
def test_a_film_of_three_displacements_has_normal_forces(normal: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    u = 0.02 * rng.standard_normal((3, 20, 24))
    u[2, 8:12, 10:14] += 1.0
    np.savez(tmp_path / "field.npz", u=u[0], v=u[1], w=u[2])
    film = Film(
        frames=[tmp_path / "field.npz"], pad=pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48), pixel=1e-7, unit="px", step=16.0, method="tikhonov", normal=normal
    )  # fmt: skip
    (row,), _ = film.solved(film.jobs()[0])
    if normal == "ignore":
        assert "normal_peak_Pa" not in row
    elif normal == "up":
        assert float(row["normal_peak_low"]) > 0
    else:
        assert float(row["normal_peak_high"]) < 0


def test_a_film_is_not_resumed_with_other_inputs(tmp_path: Path) -> None:
    """Cells given as labels, and a picture of a folder that was written anew, are another film."""
    pad = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
    np.save(tmp_path / "one.npy", np.random.default_rng(0).standard_normal((2, 20, 30)))
    np.save(tmp_path / "areas.npy", np.ones((200, 300), dtype=np.uint8))
    fields = {"frames": [tmp_path / "one.npy"], "pad": pad, "pixel": 1e-7, "unit": "px", "step": 10}
    areas = tmp_path / "areas.npy"
    assert Film(**fields, cells=areas).key() != Film(**fields, labels=areas).key()
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("pictures/a.pgm", "pictures/b.pgm", "rest.pgm"):
        (tmp_path / name).write_bytes(b"P5 64 64 255\n" + np.random.default_rng(1).bytes(64 * 64))
    film = Film(frames=[folder], rest=tmp_path / "rest.pgm", pad=pad, pixel=1e-7)
    before, then = film.key(), folder.stat().st_mtime
    (folder / "b.pgm").write_bytes(b"P5 64 64 255\n" + np.random.default_rng(2).bytes(64 * 64))
    os.utime(folder / "b.pgm", (then + 10.0, then + 10.0))
    os.utime(folder, (then, then))  # a folder does not change when a file in it is written anew
    assert film.key() != before
