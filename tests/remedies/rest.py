"""What is left of all rooms: figures over pictures, quantities of other packages, large problems, torn files, notes that tell what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.inverse import registry
from palpate.network import frame_bytes, zero_bytes
from palpate.network.frames import zero_from_bytes
from palpate.recordings import read_recording, read_touch, recorder, write_recording, write_touch
from remedies import camera
from remedies._remedy import Remedy, command, laid, value
from remedies.commands import TWO as TWO_PLANES
from remedies.skins import AREA, BOTH, FAST, PAD, PRESS, SKIN, TOUCH, labelled, line

PICTURE, VIEW, PRESSED = camera.picture(), camera.VIEW, camera.PRESSED


def same(touch: Any) -> bool:
    return bool(np.isclose(float(np.ravel(touch.force)[-1]), float(TOUCH.force[-1]), rtol=1e-6))


class Metres:
    """Readings with a unit, as pint and astropy have them."""

    def __init__(self, kind: str) -> None:
        self.units = self.unit = "pascal"
        if kind == "pint":
            self.magnitude, self.to = PRESS, lambda unit: self
        else:
            self.to_value = lambda unit: PRESS


def axes() -> Any:
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    return Figure().subplots()


def plotted(**how: Any) -> Any:
    return PRESSED.plot(**how)


def torn() -> None:
    pytest.importorskip("mcap")
    with recorder("r.mcap", BOTH) as out:
        for k in range(400):
            out.readings(0.01 * k, PRESS)
    whole = Path("r.mcap").read_bytes()
    Path("cut.mcap").write_bytes(whole[: int(0.8 * len(whole))])


def board() -> Any:
    """A board of 4 x 3 inner corners that faces the camera."""
    square = np.kron(np.indices((4, 5)).sum(axis=0) % 2, np.ones((20, 20))) * 200 + 30
    return np.pad(square, 24, constant_values=230).astype(np.uint8)


def boards(tilt: float = 12.0) -> Any:
    """Three pictures of it, each tilted another way."""
    import cv2

    flat = board()
    height, width = flat.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
    moves = np.array(
        [[[0, 0], [0, 1], [0, -1], [0, 0]], [[1, 0], [-1, 0], [0, 0], [0, 0]], [[0, 1], [0, 0], [0, 0], [0, -1]]]
    )
    return [
        cv2.warpPerspective(
            flat,
            cv2.getPerspectiveTransform(corners, (corners + tilt * move).astype(np.float32)),
            (width, height),
            borderValue=230,
        )
        for move in moves
    ]


def lens(pictures: Any, corners: Any = (4, 3)) -> Any:
    return camera.Lens.from_chessboard(pictures, corners=corners)


def two_with_gaps() -> None:
    laid(two_toml=TWO_PLANES)
    values = np.ones((2, 2, 9))
    values[0, 0, 3] = np.nan
    write_recording(pp.Recording(readings=values, channels=["stress_zz"] * 2), "two.nc")


LARGE = pp.AreaArray(shape=(80, 80), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=1.0)
BALL = pp.solutions.hertz_point(contact_radius=4e-3, force=1.0)


def large(surface: Any) -> Any:
    skin = pp.Skin(PAD, LARGE, surface=surface)
    return skin.reconstruct(np.ones((1, 80, 80)), method="maxent", components=["z"])


REMEDIES = [
    value(
        "x.to('Pa').magnitude",
        lambda x: SKIN.reconstruct(x, **FAST),
        Metres("pint"),
        Metres("pint").to("Pa").magnitude,
        right=same,
    ),
    value(
        "x.to_value('Pa')",
        lambda x: SKIN.reconstruct(x, **FAST),
        Metres("astropy"),
        Metres("astropy").to_value("Pa"),
        right=same,
    ),
    # figures
    value(
        "truth is drawn in panels of its own",
        lambda how: plotted(**how()),
        lambda: {"truth": np.asarray(PRESSED.values), "ax": axes()},
        lambda: {"ax": axes()},
        slow=True,
    ),
    value(
        "over a picture there is neither truth, ax, seen_from nor taxels",
        lambda how: plotted(picture=(PICTURE, VIEW), **how),
        {"seen_from": "outside"},
        {},
        slow=True,
    ),
    value("picture must be (image, view)", lambda p: plotted(picture=p), PICTURE, (PICTURE, VIEW), slow=True),
    value("nothing says where the picture lies", lambda view: drawn(PICTURE, PRESSED, view), None, VIEW, slow=True),
    value(
        "pick one of a file of touches",
        lambda pick: drawn(PICTURE, pick(read_touch("t.nc")), VIEW),
        lambda d: d,
        lambda d: d.isel(time=0),
        given=lambda: write_touch(AREA.reconstruct(np.stack([AREA.sense(BALL)] * 2), **FAST), "t.nc"),
        slow=True,
    ),
    value(
        "the calibration pictures differ in size",
        lens,
        [boards()[0], boards()[0][:100], boards()[1]],
        boards(),
        slow=True,
    ),
    value("Count inner corners, not fields", lambda c: lens(boards(), c), (5, 4), (4, 3), slow=True),
    value(
        "tilt the board, another way in each picture",
        lens,
        boards(0.0),
        boards(),
        right=lambda found: found.matrix[0][0] > 0,
    ),
    value("{} is part of palpate and cannot be removed", registry.unregister, "tikhonov", "own"),
    # labels, trackers, simulation, files of touches
    value(
        "as some names occur twice",
        lambda x: stacked().reconstruct(x, **FAST),
        labelled("channel", "x", channel=["stress_zz", "stress_xz"]),
        labelled("channel", "x", channel=["stress_zz", "stress_zz"]),
    ),
    value(
        "not a wish for a new zero",
        zero_from_bytes,
        b"PLPX" + zero_bytes(10)[4:],
        zero_bytes(10),
        right=lambda n: n == 10,
    ),
    value(
        "keeps the whole map, and {} unknowns are too many",
        large,
        None,
        pp.AreaGrid(shape=(10, 10), spacing=8e-3),
        slow=True,
    ),
    # torn files
    Remedy(
        "palpate convert --salvage takes what is whole",
        lambda: read_recording("cut.mcap"),
        lambda: (command("convert cut.mcap out.nc --salvage")(), read_recording("out.nc"))[1],
        given=torn,
        right=lambda r: len(r.readings) > 200 and np.allclose(r.readings[-1], PRESS, rtol=1e-6),
    ),
    Remedy(
        "--drop-missing works only for skins with one plane",
        command("reconstruct two.nc --skin two.toml --drop-missing --out t.nc"),
        command("track two.nc --skin two.toml"),
        given=two_with_gaps,
        right=lambda told: "a frame took" in told,
    ),
]


def drawn(image: Any, touch: Any, view: Any) -> Any:
    from palpate.camera import overlay

    return overlay(image, touch, view=view)


def stacked() -> Any:
    return pp.Skin(PAD, [line(channels=["stress_zz"]), line(channels=["stress_zz"], depth=2e-3)])


def stamped(time: float) -> bytes:
    """A frame as a driver sends it that keeps its own time."""
    import struct

    held = frame_bytes(0, 0.0, PRESS)
    at = held.index(struct.pack("<d", 0.0), 4)
    return held[:at] + struct.pack("<d", time) + held[at + 8 :]
