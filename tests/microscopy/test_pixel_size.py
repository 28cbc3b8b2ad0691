"""Sizes of pixels that pictures state: read, used where none is given, and compared with what is given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.errors import InvalidInput
from palpate.microscopy import pixel_size
from palpate.microscopy.pixelsize import differing, pixel_size_of_all

tifffile = pytest.importorskip("tifffile")

PICTURE = np.arange(32 * 40, dtype=np.uint16).reshape(32, 40)
CM = 1e5  # pixels of 0.1 um


@pytest.mark.parametrize(
    ("options", "size"),
    [
        ({"imagej": True, "resolution": (10.0, 10.0), "metadata": {"unit": "um"}}, 0.1e-6),
        ({"imagej": True, "resolution": (10.0, 10.0), "metadata": {"unit": "micron"}}, 0.1e-6),
        ({"imagej": True, "resolution": (10.0, 10.0), "metadata": {"unit": "\\u00B5m"}}, 0.1e-6),
        ({"imagej": True, "resolution": (0.01, 0.01), "metadata": {"unit": "nm"}}, 0.1e-6),
        ({"imagej": True, "resolution": (1.0, 1.0), "metadata": {"unit": "pixel"}}, None),
        ({"imagej": True, "resolution": (10.0, 10.0)}, None),
        ({"ome": True, "metadata": {"PhysicalSizeX": 0.1, "PhysicalSizeY": 0.1}}, 0.1e-6),
        ({"ome": True, "metadata": {"PhysicalSizeX": 100.0, "PhysicalSizeXUnit": "nm"}}, 0.1e-6),
        ({"ome": True}, None),
        ({"resolution": (CM, CM), "resolutionunit": "CENTIMETER"}, 0.1e-6),
        ({"resolution": (254000.0, 254000.0), "resolutionunit": "INCH"}, 0.1e-6),
        ({"resolution": (72, 72), "resolutionunit": "INCH"}, None),
        ({"resolution": (300, 300), "resolutionunit": "INCH"}, None),
        ({}, None),
    ],
)
def test_what_a_file_states(tmp_path: Path, options: dict[str, Any], size: float | None) -> None:
    path = tmp_path / ("a.ome.tif" if "ome" in options else "a.tif")
    tifffile.imwrite(path, PICTURE, **options)
    found = pixel_size(path)
    if size is None:
        assert found is None
    else:
        assert found is not None
        assert (found.x, found.y) == pytest.approx((size, size))
        assert differing(path, size) == ""
        assert "0.1 um, and 0.2 um was given" in differing(path, 2 * size)
        assert "(8 times" in differing(path, 2 * size)


def test_pictures_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    for name, resolution in (("a", (10.0, 10.0)), ("b", (5.0, 5.0)), ("c", (10.0, 5.0))):
        tifffile.imwrite(tmp_path / f"{name}.tif", PICTURE, imagej=True, resolution=resolution, metadata={"unit": "um"})
    (tmp_path / "d.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:100])
    one = pixel_size_of_all([tmp_path / "a.tif", tmp_path / "d.tif", tmp_path / "a.png"])
    assert one is not None
    assert one.x == pytest.approx(0.1e-6)
    with pytest.raises(InvalidInput, match="one field of view"):
        pixel_size_of_all([tmp_path / "a.tif", tmp_path / "b.tif"])
    with pytest.raises(InvalidInput, match="not square"):
        pixel_size_of_all([tmp_path / "c.tif"])


@pytest.mark.long
def test_the_command_takes_or_questions_it(tmp_path: Path) -> None:
    pytest.importorskip("typer")
    pytest.importorskip("matplotlib")
    import scipy.ndimage

    from command_line import run

    rng = np.random.default_rng(0)
    rest = scipy.ndimage.gaussian_filter(rng.poisson(0.03, (128, 128)) * 6000.0, 1.3)
    y, x = np.mgrid[:128, :128] - 63.5
    bump = 1.5 * np.exp(-(x**2 + y**2) / (2 * 20.0**2))
    pulled = scipy.ndimage.map_coordinates(rest, [y + 63.5, x + 63.5 + bump * x / 20.0], order=3, mode="nearest")
    stack = np.clip(np.stack([rest, pulled]) + 100, 0, 60000).astype(np.uint16)
    tifffile.imwrite(
        tmp_path / "pair.tif", stack, imagej=True, resolution=(10.0, 10.0), metadata={"unit": "um", "axes": "TYX"}
    )
    gel = ["--youngs-modulus", "8 kPa +- 10 %", "--poissons-ratio", "0.48", "--draws", "8"]
    stated = run("tfm", "pair.tif", *gel, "--out", "a", cwd=tmp_path)
    assert "a pixel is 0.1 um: pair.tif (ImageJ) says so" in stated.stderr
    given = run("tfm", "pair.tif", "--pixel", "0.1 um", *gel, "--out", "b", cwd=tmp_path)
    assert "says that a pixel" not in given.stderr
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()
    other = run("tfm", "pair.tif", "--pixel", "0.2 um", *gel, "--out", "c", cwd=tmp_path)
    assert "pair.tif (ImageJ) says that a pixel is 0.1 um, and 0.2 um was given" in other.stderr
    assert other.returncode == 0
