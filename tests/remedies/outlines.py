"""Labels, regions of ImageJ, films of cells and pixel sizes of pictures; what a refusal says that they must be."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.ndimage

import palpate as pp
from palpate.microscopy import Field, Film, cell_forces, forces_of_labels, read_field, read_labels
from remedies._remedy import Remedy, command, value

__all__ = ["REMEDIES"]

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
Y, X = np.meshgrid(np.arange(16.0), np.arange(20.0), indexing="ij")
MOVED = np.stack([2.0 * np.exp(-((X - 6) ** 2 + (Y - 8) ** 2) / 8), 0.0 * X])
MOVED = MOVED - MOVED[:, :, ::-1] + 0.02 * np.random.default_rng(0).standard_normal(MOVED.shape)
SIZE = (160, 128)
NONE = np.zeros(SIZE[::-1], dtype=np.uint8)


def outlined(row: int = 64, column: int = 48, half: int = 16, kind: Any = np.uint8) -> Any:
    """A label picture of one square."""
    picture = NONE.astype(kind)
    picture[row - half : row + half, column - half : column + half] = 1
    return picture


@lru_cache
def forces() -> Any:
    field = Field(displacement=0.1e-6 * MOVED, start=(4, 4), step=8.0, pixel=0.1e-6, aperture=0.8e-6)
    return cell_forces(field, GEL, method="tikhonov", draws=8)


def solved(method: str, noise: float | None = None) -> Any:
    field = Field(displacement=0.1e-6 * MOVED, start=(4, 4), step=8.0, pixel=0.1e-6, aperture=0.8e-6)
    return cell_forces(field, GEL, method=method, draws=8, noise=noise)


def still_and_moved() -> None:
    """A file of two fields, of which one is zero."""
    np.savez("two.npz", u_filtered=0.0 * MOVED[0], v_filtered=0.0 * MOVED[1], u=MOVED[0], v=MOVED[1])


def named(name: str) -> Any:
    field = read_field("two.npz", name=name, pixel=0.1e-6, unit="px", step=8.0)
    return cell_forces(field, GEL, method="tikhonov", draws=8)


def regions() -> None:
    """A square, a line, and a file of another kind, as ImageJ's regions."""
    import roifile

    square = roifile.ImagejRoi.frompoints([[10, 10], [30, 10], [30, 20], [10, 20]])
    square.name = "first"
    square.tofile("first.roi")
    line = roifile.ImagejRoi.frompoints([[10, 10], [30, 10]])
    line.name = "second"
    line.tofile("line.roi")
    Path("cut.roi").write_bytes(Path("first.roi").read_bytes()[:20])


def region(name: str) -> Any:
    return read_labels(name, size=(60, 40))


def moved() -> None:
    """Two frames of displacements, label pictures, and beads at rest and pulled of two sizes."""
    from PIL import Image

    np.save("0.npy", MOVED)
    np.save("1.npy", 0.5 * MOVED)
    np.save("labels.npy", outlined())
    rng = np.random.default_rng(0)
    beads = (255 * scipy.ndimage.gaussian_filter((rng.random((98, 130)) > 0.9).astype(float), 1.0)).astype(np.uint8)
    for name, picture in (("rest", beads[1:97, 1:97]), ("pulled", beads[:96, 1:97]), ("wide", beads[1:97, 1:129])):
        Image.fromarray(picture).save(f"{name}.png")


def film(frames: Any = ("0.npy", "1.npy"), **changed: Any) -> Film:
    given: dict[str, Any] = {"pad": GEL, "pixel": 0.1e-6, "unit": "px", "step": 8.0, "method": "tikhonov", **changed}
    return Film(frames=list(frames), **given)


def pictured(name: str) -> Any:
    """The first frame of a film of pictures."""
    made = film([name], rest="rest.png", unit=None, window=16, step=8)
    return made.solved(made.jobs()[0])


def resumed(restart: bool) -> Any:
    film().run("film.partial.jsonl", processes=1)
    if restart:
        Path("film.partial.jsonl").unlink()
    return film(pixel=0.2e-6).run("film.partial.jsonl", processes=1)


def corners() -> None:
    """An outline of corners in pixels."""
    Path("outline.csv").write_text("x,y\n10,5\n30,5\n30,15\n10,15\n")


def sized() -> None:
    """Pictures whose files state the size of a pixel, and one of square pixels that is resampled."""
    import tifffile

    picture = outlined()
    for name, resolution in (("a", (10.0, 10.0)), ("b", (5.0, 5.0)), ("c", (10.0, 5.0)), ("square", (5.0, 5.0))):
        tifffile.imwrite(f"{name}.tif", picture, imagej=True, resolution=resolution, metadata={"unit": "um"})


def stated(*names: str) -> Any:
    from palpate.microscopy.pixelsize import pixel_size_of_all

    return pixel_size_of_all(names)


RUN = "film 0.npy 1.npy --pixel 0.1um --youngs-modulus 8kPa --poissons-ratio 0.48 --unit px --method tikhonov"
BY_ONE = "--processes 1 --force"

REMEDIES = [
    value("a label picture has one channel", read_labels, np.stack([outlined()] * 3), outlined()),
    value("holds numbers that are not whole", read_labels, 0.5 * outlined(kind=float), outlined(kind=float)),
    value("so it holds no label", read_labels, NONE, outlined()),
    Remedy(
        "regions do not tell the size of their picture",
        lambda: read_labels("first.roi"),
        lambda: read_labels("first.roi", size=(60, 40)),
        given=regions,
        right=lambda found: found["first"].sum() == 200,
    ),
    Remedy(
        "outlines do not tell the size of their picture",
        lambda: read_labels("outline.csv"),
        lambda: read_labels("outline.csv", size=(60, 40)),
        given=corners,
        right=lambda found: found["1"].any(),
    ),
    value("cannot be read as ImageJ's regions", region, "cut.roi", "first.roi", given=regions),
    value("is a line or points, which hold no area", region, "line.roi", "first.roi", given=regions),
    value(
        "give labels of this picture.",
        lambda v: forces_of_labels(forces(), v),
        np.ones((40, 60), dtype=np.uint8),
        outlined(),
    ),
    value(
        "no label lies where there are vectors",
        lambda v: forces_of_labels(forces(), v),
        np.pad(np.ones((1, 1), dtype=np.uint8), [(0, 129), (0, 161)]),
        outlined(),
    ),
    value("method must be", solved, "fourier", "tikhonov", room="microscopy.cell"),
    value("noise must be a positive standard deviation [m]", lambda noise: solved("tikhonov", noise), -1e-9, None),
    value("all vectors of the field are equal", named, "u_filtered, v_filtered", "u, v", given=still_and_moved),
    value(
        "unit must be one of",
        lambda v: read_field("0.npy", pixel=0.1e-6, step=8, unit=v),
        "inch",
        "px",
        given=moved,
        room="microscopy.readers",
    ),
    value("a film has frames", film, [], ["0.npy"], given=moved),
    value("and these files are both", film, ["0.npy", "pulled.png"], ["0.npy", "1.npy"], given=moved),
    value(
        "pictures of a film need one of the beads at rest",
        lambda v: film(["pulled.png"], **v),
        {},
        {"rest": "rest.png"},
    ),
    value("Give pictures of one size", pictured, "wide.png", "pulled.png", given=moved),
    value("is of a film with other settings or files", resumed, False, True, given=moved),
    Remedy(
        "no such file. Give the path of a file that exists",
        command(f"{RUN} --step 8 --cells cells.npy {BY_ONE}"),
        command(f"{RUN} --step 8 --cells labels.npy {BY_ONE}"),
        given=moved,
        room="cli.film",
    ),
    Remedy(
        "no frame was solved",
        command(f"{RUN} {BY_ONE}"),
        command(f"{RUN} --step 8 {BY_ONE}"),
        given=moved,
        right=lambda told: "2 frames, 2 rows" in told,
    ),
    value("which are not square", lambda n: stated(*n), ["c.tif"], ["square.tif"], given=sized),
    value("are they pictures of one field of view", lambda n: stated(*n), ["a.tif", "b.tif"], ["a.tif"], given=sized),
]
