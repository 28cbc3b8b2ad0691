"""Masks as programs write them: labels of several cells, Cellpose, outlines whose header names columns and units."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.errors import InvalidInput
from palpate.microscopy import read_mask

CORNERS = np.array([[10.0, 20.0], [60.0, 22.0], [40.0, 50.0]])


def labels() -> np.ndarray:
    values = np.zeros((60, 80), dtype=np.uint16)
    values[10:30, 20:50], values[40:55, 5:25] = 1, 2
    return values


def cellpose(path: Path, **more: Any) -> Path:
    """What Cellpose saves: a dictionary in a .npy file."""
    held = {"masks": labels(), "outlines": labels(), "filename": Path("x.tif"), "est_diam": np.float64(30.0), **more}
    np.save(path, held)  # type: ignore[arg-type]
    return path


def test_one_cell_of_several_is_picked_by_its_label(tmp_path: Path) -> None:
    np.save(tmp_path / "labels.npy", labels())
    for path in (tmp_path / "labels.npy", cellpose(tmp_path / "x_seg.npy")):
        assert np.array_equal(read_mask(path, cell=2), labels() == 2)
        with pytest.raises(InvalidInput, match=r"several cells.*cell=1 \(--cell 1\)"):
            read_mask(path)
        with pytest.raises(InvalidInput, match="no pixel has the value 3"):
            read_mask(path, cell=3)
    alone = np.where(labels() == 2, 2, 0)
    assert np.array_equal(read_mask(alone), labels() == 2)
    # more labels than a photograph has grey levels, in flat patches
    many = np.kron(np.arange(48, dtype=np.uint16).reshape(6, 8), np.ones((20, 20), dtype=np.uint16))
    with pytest.raises(InvalidInput, match="47 values beside zero"):
        read_mask(many)
    assert read_mask(many, cell=47).sum() == 400


def test_a_mask_without_an_outside_is_refused() -> None:
    for values in (np.full((40, 50), 7, dtype=np.uint8), 1 + (np.arange(2000).reshape(40, 50) > 900).astype(np.uint8)):
        with pytest.raises(InvalidInput, match=r"must be zero|several cells"):
            read_mask(values)


def test_a_pickle_never_runs_what_it_names(tmp_path: Path) -> None:
    class Runs:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(tmp_path / "made"),)

    for more in ({"x": Runs()}, {"x": [Runs()]}):
        with pytest.raises(InvalidInput, match="never run"):
            read_mask(cellpose(tmp_path / "y_seg.npy", **more))
    assert not (tmp_path / "made").exists()
    whole = (tmp_path / "y_seg.npy").read_bytes()
    (tmp_path / "cut_seg.npy").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidInput, match="damaged"):
        read_mask(tmp_path / "cut_seg.npy")
    np.save(tmp_path / "z_seg.npy", {"flows": 1})  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match='holds no "masks"'):
        read_mask(tmp_path / "z_seg.npy")


def test_the_names_of_older_numpy_are_known(tmp_path: Path) -> None:
    path = cellpose(tmp_path / "x_seg.npy", filename="x.tif")
    with path.open("rb") as file:
        np.lib.format.read_magic(file)
        np.lib.format.read_array_header_1_0(file)
        head, body = path.read_bytes()[: file.tell()], file.read()
    old = pickle.dumps(pickle.loads(body), protocol=0).replace(b"numpy._core", b"numpy.core")
    path.write_bytes(head + old)
    assert np.array_equal(read_mask(path, cell=1), labels() == 1)


@pytest.mark.parametrize(
    ("header", "order", "factor"),
    [
        ("", (0, 1), 1.0),
        ("x,y", (0, 1), 1.0),
        ("row,col", (1, 0), 1.0),
        ("Y,X", (1, 0), 1.0),
        ("x (um),y (um)", (0, 1), 0.1),
        ("X [micron],Y [micron]", (0, 1), 0.1),
        ("x_um,y_um", (0, 1), 0.1),
        ("x (µm),y (µm)", (0, 1), 0.1),
        ("y (nm),x (nm)", (1, 0), 100.0),
        ("# column (px),row (px)", (0, 1), 1.0),
        ("index,shape-type,vertex-index,axis-0,axis-1", (1, 0), 1.0),
    ],
)
def test_the_header_of_an_outline_holds(tmp_path: Path, header: str, order: tuple[int, int], factor: float) -> None:
    rows = [[f"{v:.6g}" for v in CORNERS[k, list(order)] * factor] for k in range(len(CORNERS))]
    if "index" in header:
        rows = [["0", "polygon", str(k), *row] for k, row in enumerate(rows)]
    path = tmp_path / "cell.csv"
    for mark in (",", ";", "\t"):
        text = [header.replace(",", mark)] if header else []
        path.write_text("\n".join([*text, *(mark.join(row) for row in rows)]) + "\n", encoding="utf-8-sig")
        np.testing.assert_allclose(read_mask(path, pixel=0.1e-6), CORNERS)
    if factor != 1.0:
        with pytest.raises(InvalidInput, match="give pixel="):
            read_mask(path)


def test_what_a_header_does_not_tell_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cell.csv"
    for header, words in (("a,b", "which column is x"), ("x,b", "which is x"), ("x (V),y (V)", "accepted units")):
        path.write_text(header + "\n10,20\n60,22\n40,50\n")
        with pytest.raises(InvalidInput, match=words):
            read_mask(path, pixel=0.1e-6)
    path.write_text("x (um),y (px)\n1,20\n6,22\n4,50\n")  # each column in its own
    np.testing.assert_allclose(read_mask(path, pixel=0.1e-6), CORNERS)
    path.write_text("x;y\n10,0;20,0\n60,0;22,0\n40,0;50,0\n")
    np.testing.assert_allclose(read_mask(path), CORNERS)


def test_outlines_of_cellpose_hold_one_cell_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "x_cp_outlines.txt"
    square = [5, 5, 30, 5, 30, 30, 5, 30]
    path.write_text(",".join(f"{v:.0f}" for v in CORNERS.ravel()) + "\n")
    np.testing.assert_allclose(read_mask(path), CORNERS)
    path.write_text(path.read_text() + ",".join(map(str, square)) + "\n")
    np.testing.assert_allclose(read_mask(path, cell=2), np.reshape(square, (4, 2)))
    with pytest.raises(InvalidInput, match=r"outlines of 2 cells.*--cell 1"):
        read_mask(path)
    with pytest.raises(InvalidInput, match="from 1 to 2"):
        read_mask(path, cell=3)
