"""Series of fields, channels of pictures, and files for other programs; what a refusal says that they must be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from palpate.microscopy import Field, Film, frames_of_field, read_field, read_picture
from palpate.microscopy.layers import cell_layers
from remedies._remedy import Remedy, command, value
from remedies.outlines import GEL, MOVED, forces, outlined

__all__ = ["REMEDIES"]


def films() -> None:
    """One film as PIVlab keeps it, and two under one roof."""
    import scipy.io

    def frames(values: Any) -> Any:
        held = np.empty((2, 1), dtype=object)
        held[0, 0], held[1, 0] = values, 0.5 * values
        return held

    both = {"u_filtered": frames(MOVED[0]), "v_filtered": frames(MOVED[1])}
    scipy.io.savemat("film.mat", both)
    scipy.io.savemat("two.mat", {"left": both, "right": both})


def channels() -> None:
    """Two pictures in two channels, and one alone."""
    import tifffile

    picture = np.arange(64 * 80, dtype=np.uint16).reshape(64, 80)
    tifffile.imwrite("two.tif", np.stack([picture, picture + 1]), metadata={"axes": "CYX"}, photometric="minisblack")
    tifffile.imwrite("one.tif", picture)


def pages() -> None:
    """A film of two frames, and labels of two and of three."""
    import tifffile

    np.save("film.npy", np.stack([MOVED, MOVED]))
    for count in (2, 3):
        tifffile.imwrite(f"{count}.tif", np.stack([outlined()] * count), photometric="minisblack")


def labelled(name: str) -> Any:
    film = Film(frames=["film.npy"], pad=GEL, pixel=0.1e-6, unit="px", step=8.0, method="tikhonov", cells=name)
    return film.solved(film.jobs()[0])


def results() -> None:
    forces().write_netcdf("cell.nc")
    from palpate.recordings import write_touch

    write_touch(forces().touch, "touch.nc")


def three() -> None:
    np.savez("three.npz", u=MOVED[0], v=MOVED[1], w=MOVED[0])


def field() -> None:
    np.save("0.npy", MOVED)


RUN = "tfm 0.npy --pixel 0.1um --unit px --step 8 --youngs-modulus 8kPa --poissons-ratio 0.48 --method tikhonov --draws 8 --out o"
ALL = "film 0.npy --unit px --step 8 --youngs-modulus 8kPa --poissons-ratio 0.48 --method tikhonov --processes 1"

REMEDIES = [
    value(
        "or take them all with palpate film",
        lambda n: read_field("film.mat", pixel=0.1e-6, unit="px", step=8, name=n),
        "u_filtered, v_filtered",
        "u_filtered, v_filtered(1)",
        given=films,
    ),
    value(
        "holds several films",
        lambda n: frames_of_field("two.mat", n),
        None,
        "left.u_filtered, left.v_filtered",
        given=films,
        right=lambda found: len(found) == 2,
    ),
    value(
        "no field {}; it holds",
        lambda n: frames_of_field("two.mat", n),
        "middle",
        "left.u_filtered, left.v_filtered",
        given=films,
        room="microscopy.series",
    ),
    value("say which shows the beads with channel", lambda c: read_picture("two.tif", channel=c), None, 1, given=channels),
    value("channels: channel (--channel) is from 1", lambda c: read_picture("two.tif", channel=c), 3, 2, given=channels),
    value("says nothing of channels", lambda c: read_picture("one.tif", channel=c), 1, None, given=channels),
    value("give one picture of labels, or one for each frame", labelled, "3.tif", "2.tif", given=pages),
    value("Give such a name.", lambda n: forces().write_vectors(n), "v.xlsx", "v.csv", room="microscopy.written"),
    value(
        "normal must be",
        lambda n: read_field("three.npz", pixel=0.1e-6, unit="px", step=8, normal=n),
        "z",
        "down",
        given=three,
        right=lambda found: found.normal is not None,
    ),
    value(
        "normal must have a number for each vector",
        lambda shape: Field(displacement=MOVED * 1e-7, normal=np.zeros(shape), start=(3.5, 3.5), step=8.0, pixel=0.1e-6),
        (3, 3),
        MOVED.shape[1:],
    ),
    value("holds no vectors of a cell", cell_layers, "touch.nc", "cell.nc", given=results),
    Remedy(
        "such a file ends in",
        command(f"{RUN} --tiff t.png --force"),
        command(f"{RUN} --tiff t.tif --force"),
        given=field,
        room="cli.tfm",
        right=lambda _: Path("t.tif").exists(),
    ),
    Remedy(
        "--start takes column,row",
        command(f"{RUN} --start 16 --force"),
        command(f"{RUN} --start 16,16 --force"),
        given=field,
        room="cli.tfm",
        right=lambda told: "strain energy" in told,
    ),
    Remedy(
        "no file states the size of a pixel",
        command(f"{ALL} --force"),
        command(f"{ALL} --pixel 0.1um --force"),
        given=field,
        room="cli.film",
        right=lambda told: "1 frames" in told,
    ),
    Remedy(
        "--start takes column,row",
        command(f"{ALL} --pixel 0.1um --start 16 --force"),
        command(f"{ALL} --pixel 0.1um --start 16,16 --force"),
        given=field,
        room="cli.film",
        right=lambda told: "1 frames" in told,
    ),
]  # fmt: skip
