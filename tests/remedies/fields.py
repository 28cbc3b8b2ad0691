"""Displacement fields, masks and pictures of beads: what a refusal says of their files, units and steps."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.microscopy import Field, bead_displacements, cell_forces, read_field, read_mask, read_pair, read_picture
from remedies._remedy import Remedy, laid

#: A dent of 1.5 pixels in 10 x 12 vectors, one every 8 pixels of 0.1 um.
U = np.zeros((10, 12))
U[3:6, 4:7] = 1.5
V = 0.5 * U
HOW: dict[str, Any] = {"pixel": 0.1e-6, "unit": "px", "step": 8}
ROWS, COLUMNS = np.indices(U.shape)


def text(values: Any, title: str = "") -> str:
    return title + "\n".join(" ".join(f"{v:g}" for v in row) for row in values) + "\n"


def listed(x: Any = 8 * COLUMNS, y: Any = 8 * ROWS, u: Any = U, v: Any = V) -> Any:
    """A table of vectors: one line each."""
    return np.stack([np.ravel(a) for a in (x, y, u, v)], axis=1)


def right(field: Any) -> bool:
    """The dent comes out in metres, 0.15 um along x."""
    return bool(np.isclose(np.nanmax(field.displacement[0]), 1.5 * 0.1e-6, rtol=1e-6))


def saved(**arrays: Any) -> None:
    for name, values in arrays.items():
        np.save(f"{name}.npy", values)


def both() -> None:
    saved(u=U, v=V)


def tiff(name: str, *pages: Any) -> None:
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffWriter(name) as file:
        for page in pages:
            file.write(page)


def mat(name: str, **held: Any) -> None:
    import scipy.io

    scipy.io.savemat(name, held)


def field(
    words: str, refused: Any, advised: Any, *, given: Any = both, room: str = "", right: Any = right, **more: Any
) -> Remedy:
    """Calls of `read_field`: files, and what is given besides `HOW` (None takes it away)."""

    def call(source: Any, **given: Any) -> Any:
        return read_field(source, **{k: v for k, v in {**HOW, **given}.items() if v is not None})

    def made(what: Any) -> Any:
        return (
            what if callable(what) else lambda: call(what) if not isinstance(what, tuple) else call(what[0], **what[1])
        )

    return Remedy(words, made(refused), made(advised), room=room, given=given, right=right)


PAIR = ["u.npy", "v.npy"]
TABLE = {"unit": None, "step": None}


def table(words: str, wrong: str, mended: str, *, name: str = "t.txt", room: str = "", **how: Any) -> Remedy:
    """A table of vectors as text."""

    def read(held: str) -> Any:
        Path(name).write_text(held)
        return read_field(name, pixel=0.1e-6, **how)

    return Remedy(words, lambda: read(wrong), lambda: read(mended), room=room, right=right)


def mask(words: str, wrong: Any, mended: Any, *, name: str = "", right: Any = None, room: str = "") -> Remedy:
    """A mask as an array, or as a file of this name."""

    def read(held: Any) -> Any:
        if not name:
            return read_mask(held)
        if isinstance(held, str):
            Path(name).write_text(held)
        else:
            np.save(name, held, allow_pickle=True)
        return read_mask(name)

    return Remedy(words, lambda: read(wrong), lambda: read(mended), room=room, right=right)


def cell(words: str, held: Any, wrong: int | None, mended: int | None, *, right: Any = None) -> Remedy:
    """Which cell of a mask of several."""

    def read(which: int | None) -> Any:
        if not isinstance(held, str):
            return read_mask(held, cell=which)
        laid(c_geojson=held)
        return read_mask("c.geojson", cell=which)

    return Remedy(words, lambda: read(wrong), lambda: read(mended), right=right)


def of(values: Any) -> Any:
    return Field(
        **{"displacement": 0.1e-6 * np.stack([U, V]), "start": (3.5, 3.5), "step": 8.0, "pixel": 0.1e-6, **values}
    )


@functools.cache
def beads(shift: float = 2.0) -> Any:
    """A picture of beads, moved along x."""
    rng = np.random.default_rng(3)
    y, x = np.indices((96, 112), dtype=np.float64)
    picture = np.zeros(x.shape)
    for cx, cy in rng.uniform(0, 112, (300, 2)):
        picture += 200.0 * np.exp(-((x - cx - shift) ** 2 + (y - cy) ** 2) / 4.0)
    return np.minimum(picture, 60000.0).astype(np.uint16)


def pictures(**held: Any) -> None:
    cv2 = pytest.importorskip("cv2")
    for name, image in held.items():
        assert cv2.imwrite(f"{name}.png", image)


def bead(words: str, wrong: Any, mended: Any, *, room: str = "") -> Remedy:
    """Arguments of `bead_displacements` besides a pair that is right."""

    def call(given: Any) -> Any:
        pytest.importorskip("cv2")
        return bead_displacements(
            given.pop("rest", beads(0.0)),
            given.pop("pulled", beads(2.0)),
            **{"pixel": 0.1e-6, "window": 16, "step": 16, "drift": False, **given},
        )

    return Remedy(
        words,
        lambda: call(dict(wrong)),
        lambda: call(dict(mended)),
        room=room,
        right=lambda got: abs(float(np.nanmedian(got.displacement[0])) / 0.1e-6 - 2.0) < 0.1,
    )


STACK = np.stack([beads(0.0), beads(1.0), beads(2.0)])
CORNERS = [[0, 0], [80, 0], [80, 70], [0, 70]]
INSIDE = np.zeros((10, 12), dtype=bool)
INSIDE[2:7, 3:8] = True
HEADED = "x [px],y [px],u [px],v [px]\n"
CELLS = INSIDE * 1 + (ROWS > 8) * 2
TRIANGLE = "10,10\n60,12\n40,50\n"
TWO = json.dumps({"features": [{"geometry": {"coordinates": [CORNERS]}}] * 2})
UM = listed(u=0.1 * U, v=0.1 * V)
ROUGH = np.where((ROWS + COLUMNS) % 2, 9.0, -9.0)


def lines(head: str = HEADED, values: Any = None) -> str:
    return head + "\n".join(",".join(f"{c:g}" for c in row) for row in (listed() if values is None else values)) + "\n"


def forces(**given: Any) -> Any:
    import palpate as pp

    gel = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
    rough = np.random.default_rng(0).standard_normal((2, 10, 12))
    return cell_forces(of({"displacement": 0.1e-6 * (np.stack([U, V]) + 0.02 * rough)}), gel, **{"draws": 8, **given})


REMEDIES = [
    field("pixel must be a positive number of metres; got", (PAIR, {"pixel": 0.0}), PAIR, room="microscopy.readers"),
    field("{} must be one of {}; got", (PAIR, {"unit": "pixels"}), PAIR, room="microscopy.readers"),
    field("is a folder; give a file.", ".", PAIR, room="_files"),
    field(": no such file.", ["u.npy", "w.npy"], PAIR, room="_files"),
    field(
        ": the ending {} is not known; accepted: {}.",
        "u.xlsx",
        PAIR,
        given=lambda: (both(), laid(u_xlsx="1")),
        room="microscopy.readers",
    ),
    field("a field is one file, or two with one component each", [*PAIR, "v.npy"], PAIR),
    field(
        "save plain numbers with np.save",
        lambda: (np.save("o.npy", np.array([{"u": 1}], dtype=object), allow_pickle=True), read_field("o.npy", **HOW)),
        lambda: (np.save("o.npy", np.stack([U, V])), read_field("o.npy", **HOW))[1],
    ),
    field(
        "Save it as np.savez(file, u=..., v=...)",
        lambda: (np.savez("f.npz", a=U, b=V), read_field("f.npz", **HOW)),
        lambda: (np.savez("f.npz", u=U, v=V), read_field("f.npz", **HOW))[1],
    ),
    field(
        "As pictures of beads it needs two",
        lambda: (tiff("b.tif", beads(0.0)), read_field("b.tif", **HOW)),
        lambda: read_pair(
            (tiff("rest.tif", beads(0.0)), tiff("pulled.tif", beads(2.0)), ["rest.tif", "pulled.tif"])[2]
        ),
        right=lambda pair: pair[0].shape == (96, 112),
    ),
    field(
        "a field has two pages or channels of one size",
        lambda: (tiff("f.tif", U.astype("f4")), read_field("f.tif", **HOW)),
        lambda: (tiff("f.tif", U.astype("f4"), V.astype("f4")), read_field("f.tif", **HOW))[1],
    ),
    field(
        "name= picks a field of one file that holds several",
        (PAIR, {"name": "u"}),
        PAIR,
    ),
    field(
        "one component is one page of floating-point numbers",
        lambda: (tiff("u.tif", U.astype("u1")), tiff("v.tif", V.astype("u1")), read_field(["u.tif", "v.tif"], **HOW)),
        lambda: (tiff("u.tif", U.astype("f4")), tiff("v.tif", V.astype("f4")), read_field(["u.tif", "v.tif"], **HOW))[
            2
        ],
    ),
    field(
        "file holds both components; give it alone",
        ["f.npz", "f.npz"],
        "f.npz",
        given=lambda: np.savez("f.npz", u=U, v=V),
    ),
    field(
        "one component is a matrix (row, column)",
        ["w.npy", "v.npy"],
        PAIR,
        given=lambda: (both(), saved(w=np.stack([U, V]))),
    ),
    field("both components must have one shape", ["u.npy", "w.npy"], PAIR, given=lambda: (both(), saved(w=V[:5]))),
    field("give the component along x, then that along y", ["u.npy", "u.npy"], PAIR),
    field("window must be a positive number of pixels", (PAIR, {"window": 0}), (PAIR, {"window": 16})),
    field(
        "{} in {}; accepted: px",
        lambda: (laid(t_csv=lines(HEADED.replace("[px]", "[furlong]"))), read_field("t.csv", pixel=0.1e-6)),
        lambda: (laid(t_csv=lines()), read_field("t.csv", pixel=0.1e-6))[1],
    ),
    field(
        "was given: leave out {} (--",
        ("t.csv", {"unit": "um", "step": None}),
        ("t.csv", TABLE),
        given=lambda: laid(t_csv=lines()),
    ),
    field(
        "give position_unit=",
        lambda: (laid(t_csv=lines("x,y,u [um],v [um]\n", UM)), read_field("t.csv", pixel=0.1e-6)),
        lambda: (
            laid(t_csv=lines("x,y,u [um],v [um]\n", UM)),
            read_field("t.csv", pixel=0.1e-6, position_unit="px"),
        )[1],
    ),
    field("has no positions: leave out position_unit", (PAIR, {"position_unit": "px"}), PAIR),
    field("v_up (--v-up) v alone: give one of them", (PAIR, {"up": True, "v_up": True}), (PAIR, {"v_up": True})),
    field(
        "holds one field: leave out name",
        ("t.csv", {**TABLE, "name": "2"}),
        ("t.csv", TABLE),
        given=lambda: laid(t_csv=lines()),
    ),
    field(
        "and no positions: a field without positions is a matrix",
        lambda: (mat("list.mat", u=U.reshape(-1, 1), v=V.reshape(-1, 1)), read_field("list.mat", **HOW)),
        lambda: (
            mat("list.mat", **dict(zip("xyuv", (column[:, None] for column in listed().T)))),
            read_field("list.mat", pixel=0.1e-6, unit="px"),
        )[1],
    ),
    field('give unit="px", or "m", "um"', (PAIR, {"unit": None}), PAIR),
    field(
        "holds infinite displacements; mark vectors that are missing as NaN",
        "w.npy",
        lambda: (saved(w=np.where(ROWS == 9, np.nan, np.stack([U, V]))), read_field("w.npy", **HOW))[1],
        given=lambda: saved(w=np.where(ROWS == 9, np.inf, np.stack([U, V]))),
    ),
    field("follow moves positions, and this file has none", (PAIR, {"follow": True}), PAIR),
    field("step must be a positive number of pixels; got", (PAIR, {"step": -8}), PAIR, room="microscopy.readers"),
    field("leave out step and start", ("t.csv", {"unit": None}), ("t.csv", TABLE), given=lambda: laid(t_csv=lines())),
    field(
        "check the unit of the positions, the step, and which picture it is",
        (PAIR, {"size": (60, 50)}),
        (PAIR, {"size": (96, 80)}),
    ),
    field("does not say how far apart they are: give step=", (PAIR, {"step": None}), PAIR),
    field("the pixels between vectors.", (PAIR, {"step": None, "size": (96, 160)}), (PAIR, {"size": (96, 160)})),
    field(
        "the positions hold values that are not finite",
        lambda: (
            laid(t_csv=lines(values=listed(x=np.where(COLUMNS == 2, np.nan, 8 * COLUMNS)))),
            read_field("t.csv", pixel=0.1e-6),
        ),
        lambda: (laid(t_csv=lines(values=[r for r in listed() if r[0] != 16])), read_field("t.csv", pixel=0.1e-6))[1],
    ),
    field(
        " vectors: at least 16 are needed.",
        lambda: (laid(t_csv=lines(values=listed()[40:50])), read_field("t.csv", pixel=0.1e-6)),
        lambda: (laid(t_csv=lines()), read_field("t.csv", pixel=0.1e-6))[1],
    ),
    field(
        "positions are there twice",
        lambda: (laid(t_csv=lines(values=np.concatenate([listed(), listed()]))), read_field("t.csv", pixel=0.1e-6)),
        lambda: (laid(t_csv=lines()), read_field("t.csv", pixel=0.1e-6))[1],
    ),
    field(
        "vectors that lie in a line or at one place",
        lambda: (
            laid(t_csv=lines(values=listed(y=0 * ROWS, x=8 * (COLUMNS + 12 * ROWS)))),
            read_field("t.csv", pixel=0.1e-6),
        ),
        lambda: (laid(t_csv=lines()), read_field("t.csv", pixel=0.1e-6))[1],
    ),
    # what files hold
    field(
        "no real numbers",
        "w.npy",
        lambda: (saved(w=np.stack([U, V])), read_field("w.npy", **HOW))[1],
        given=lambda: saved(w=np.stack([U, V]).astype(complex)),
    ),
    field("a field has two components. Give both files", "u.npy", PAIR),
    field("Save them as two files", "w.npy", PAIR, given=lambda: (both(), saved(w=np.stack([U, V, V])))),
    field(
        ": no field {}; it holds {}.",
        ("f.npz", {"name": "displacement"}),
        ("f.npz", {"name": "u"}),
        given=lambda: np.savez("f.npz", u=U, v=V, ux=U, uy=V),
        room="microscopy.found",
    ),
    field(
        "{} holds {} {}: {}. Say which with name=",
        "f.npz",
        ("f.npz", {"name": "u, v"}),
        given=lambda: np.savez("f.npz", u=U, v=V, ux=U, uy=V),
    ),
    field(
        "Rename them, or save them as two .csv files",
        lambda: (mat("f.mat", a=U, b=V), read_field("f.mat", **HOW)),
        lambda: (mat("f.mat", u=U, v=V), read_field("f.mat", **HOW))[1],
    ),
    # text
    table("holds no numbers, as a table", HEADED, lines(), name="t.csv"),
    field(
        "not a matrix of one component: give this file alone",
        (["t.csv", "t.csv"], TABLE),
        ("t.csv", TABLE),
        given=lambda: laid(t_csv=lines()),
    ),
    table("name them so in the header", lines("a,b,c,d\n"), lines(), name="t.csv"),
    table(
        "export it in pixels a frame",
        lines(HEADED.replace("u [px],v [px]", "u [px/s],v [px/s]")),
        lines(),
        name="t.csv",
    ),
    table("export both in one unit", lines(HEADED.replace("x [px],y [px]", "x [um],y [px]")), lines(), name="t.csv"),
    table("the lines before have", lines() + "1,2,3\n", lines(), name="t.csv"),
    table("a table of vectors has x, y, u, v", text(listed()[:, :3]), text(listed())),
    field(
        "Give both files, that along x first.",
        ("u.txt", {}),
        (["u.txt", "v.txt"], {}),
        given=lambda: laid(u_txt=text(np.tile(U, 2)), v_txt=text(np.tile(V, 2))),
        room="microscopy.pivtext",
    ),
    table("among the numbers; the file may hold several fields", lines() + lines(), lines(), name="t.csv"),
    # fields
    Remedy(
        "a displacement field has the shape (2, row, column)",
        lambda: of({"displacement": 1e-7 * U}),
        lambda: of({}),
        right=right,
    ),
    Remedy(
        "{} must be a positive number; got",
        lambda: of({"step": 0.0}),
        lambda: of({}),
        room="microscopy.fields",
        right=right,
    ),
    Remedy(
        "aperture must be a length [m], or 0",
        lambda: of({"aperture": -1.0}),
        lambda: of({"aperture": 0.0}),
        right=right,
    ),
    Remedy(
        "the displacements hold infinite values; mark vectors that are missing as NaN",
        lambda: of({"displacement": 1e-7 * np.where(ROWS == 9, np.inf, np.stack([U, V]))}),
        lambda: of({"displacement": 1e-7 * np.where(ROWS == 9, np.nan, np.stack([U, V]))}),
        right=right,
    ),
    Remedy(
        "Look at what marks its vectors as bad",
        lambda: of({"displacement": 1e-7 * np.where(U == 0, np.nan, np.stack([U, V]))}),
        lambda: of({}),
        right=right,
    ),
    Remedy(
        "std must have the shape of the displacements",
        lambda: of({"std": 1e-9 * np.ones(U.shape)}),
        lambda: of({"std": 1e-9 * np.ones((2, *U.shape))}),
        right=right,
    ),
    field('whether displacements are in pixels (unit="px")', (PAIR, {"unit": "mm"}), PAIR),
    Remedy(
        "whether displacements are in pixels or metres, and for outliers",
        lambda: of({"displacement": 1e-7 * np.stack([ROUGH, ROUGH])}),
        lambda: of({"displacement": 1e-9 * np.stack([ROUGH, ROUGH])}),
        room="microscopy.fields",
    ),
    # masks
    mask("a mask is a picture of one channel, or corners (n, 2)", np.zeros((4, 5, 6)), INSIDE),
    mask("Inside the cell it must be another value", np.zeros((10, 12)), INSIDE),
    mask(
        "an outline has at least three corners",
        "1,1\n2,2\n",
        "10,10\n60,12\n40,50\n",
        name="c.csv",
        right=lambda c: c[1, 0] == 60,
    ),
    mask("its corners lie in a line", "1,1\n2,2\n3,3\n", "10,10\n60,12\n40,50\n", name="c.csv"),
    mask("give one outline without holes", json.dumps([CORNERS, CORNERS]), json.dumps([CORNERS]), name="c.json"),
    mask("it looks like a photograph", np.arange(120.0).reshape(10, 12), INSIDE, room="microscopy.masks"),
    cell("several cells perhaps: say which with cell=", CELLS, None, 1, right=lambda m: m.sum() == INSIDE.sum()),
    cell("no pixel has the value {} of cell", CELLS, 7, 2, right=lambda m: m.sum() == 12),
    mask("every pixel is {}. Outside the cell it must be zero", np.full((10, 12), 3), INSIDE),
    mask('holds no "masks"', np.array({"flows": 1}, dtype=object), INSIDE, name="a_seg.npy", room="microscopy.masks"),
    mask(
        "a stack: save one plane with np.save",
        np.array({"masks": np.ones((2, 9, 9))}, dtype=object),
        INSIDE,
        name="a_seg.npy",
    ),
    mask("other than arrays, numbers and words", np.array({"masks": Remedy}, dtype=object), INSIDE, name="a_seg.npy"),
    mask("holds no numbers: an outline has", "cell\n", TRIANGLE, name="c.csv"),
    mask("does not say which column is x and which y", "a,b\n" + TRIANGLE, "x,y\n" + TRIANGLE, name="c.csv"),
    mask("do not say which is x and which y", "x,b\n" + TRIANGLE, "x,y\n" + TRIANGLE, name="c.csv"),
    mask("accepted units are px", "x (V),y (V)\n" + TRIANGLE, "x (px),y (px)\n" + TRIANGLE, name="c.csv"),
    mask("{}: holds no corners", "x,y\n", "x,y\n" + TRIANGLE, name="c.csv"),
    mask("is no corner with the columns", "x,y\n10,10\n60\n40,50\n", "x,y\n" + TRIANGLE, name="c.csv"),
    mask("among the corners; an outline has", "10,10\n60,a\n40,50\n", TRIANGLE, name="c.csv"),
    mask(
        "or names its columns in a header",
        "10,10,1\n60,12,1\n40,50,1\n",
        "x,y,n\n10,10,1\n60,12,1\n40,50,1\n",
        name="c.csv",
    ),
    Remedy(
        "give pixel=, the metres in a pixel",
        lambda: (laid(c_csv="x (um),y (um)\n1,1\n6,1.2\n4,5\n"), read_mask("c.csv")),
        lambda: (laid(c_csv="x (um),y (um)\n1,1\n6,1.2\n4,5\n"), read_mask("c.csv", pixel=0.1e-6))[1],
        right=lambda corners: np.allclose(corners[2], [40.0, 50.0]),
    ),
    mask(
        "an outline is a list of corners x, y in pixels.",
        '[["a", "b"], ["c", "d"], ["e", "f"]]',
        json.dumps(CORNERS),
        name="c.json",
    ),
    mask("cannot be read as JSON", "{[", json.dumps(CORNERS), name="c.json"),
    cell("cells: say which with cell=1 to cell=", TWO, None, 2, right=lambda c: len(c) == 4),
    cell("cell (--cell) is from 1 to", TWO, 3, 1, right=lambda c: len(c) == 4),
    Remedy(
        "writes the outline as text",
        lambda: (laid(c_roi="x"), read_mask("c.roi")),
        lambda: (laid(c_txt="10\t10\n60\t12\n40\t50\n"), read_mask("c.txt"))[1],
        right=lambda corners: corners[2].tolist() == [40.0, 50.0],
    ),
    Remedy(
        "larger than the step?",
        lambda: forces(mask=[[1000, 1000], [1001, 1000], [1000, 1001]]),
        lambda: forces(mask=[[20, 10], [70, 10], [70, 60], [20, 60]]),
        right=lambda got: got.inside.sum() > 10,
    ),
    Remedy(
        "give the mask of this picture",
        lambda: forces(mask=np.ones((30, 30), dtype=bool), size=(96, 80)),
        lambda: forces(mask=np.kron(INSIDE, np.ones((8, 8))).astype(bool), size=(96, 80)),
        right=lambda got: got.inside.sum() == INSIDE.sum(),
    ),
    Remedy("draws must be at least 8", lambda: forces(draws=2), lambda: forces(draws=8)),
    Remedy(
        "no quantity {}; there are",
        lambda: forces()["work"],
        lambda: forces()["strain_energy"].value,
        right=lambda e: e > 0,
    ),
    # pictures of beads
    bead(
        "both must show the same field of view",
        {"rest": beads(0.0)[:64]},
        {},
        room="microscopy.beads",
    ),
    bead("pixel must be a positive number of metres; got", {"pixel": 0.0}, {}, room="microscopy.beads"),
    bead("window must be from 8 pixels to a quarter", {"window": 64}, {"window": 24}),
    bead("step must be from 1 pixel to the window", {"step": 20}, {"step": 16}),
    bead("both pictures are the same", {"pulled": beads(0.0)}, {}),
    bead("the pictures do not show the same beads", {"pulled": beads(2.0)[::-1, ::-1]}, {}),
    bead("a picture holds grey levels", {"rest": beads(0.0) + 0j}, {}),
    bead("the picture holds values that are not finite", {"rest": np.full((96, 112), np.nan)}, {}),
    bead("the picture is even: it shows no beads", {"rest": np.full((96, 112), 7.0)}, {}),
    bead(
        "of the picture is saturated: expose it less",
        {"rest": np.minimum(beads(0.0).astype(float) * 40, 255).astype(np.uint8)},
        {},
    ),
    Remedy(
        ": no such file.",
        lambda: read_pair(["rest.png", "lost.png"]),
        lambda: read_pair(["rest.png", "pulled.png"]),
        given=lambda: pictures(rest=beads(0.0), pulled=beads(2.0)),
        room="_files",
    ),
    Remedy(
        "is no picture: .tif, .png and so on",
        lambda: read_picture("rest.txt"),
        lambda: read_picture("rest.png"),
        given=lambda: (pictures(rest=beads(0.0)), laid(rest_txt="1 2 3\n")),
    ),
    Remedy(
        "holds several pictures: give one",
        lambda: (tiff("s.tif", *STACK), read_picture("s.tif")),
        lambda: (tiff("one.tif", STACK[0]), read_picture("one.tif"))[1],
        right=lambda picture: picture.shape == (96, 112),
    ),
    Remedy(
        "both must show the same field of view",
        lambda: read_pair(["rest.png", "part.png"]),
        lambda: read_pair(["rest.png", "pulled.png"]),
        given=lambda: pictures(rest=beads(0.0), pulled=beads(2.0), part=beads(2.0)[:50]),
        room="microscopy.pictures",
    ),
    Remedy(
        "frames= picks two pictures of one stack",
        lambda: read_pair(["rest.png", "pulled.png"], frames=(0, 1)),
        lambda: read_pair(["rest.png", "pulled.png"]),
        given=lambda: pictures(rest=beads(0.0), pulled=beads(2.0)),
    ),
    Remedy(
        "a pair is one stack or two files",
        lambda: read_pair(["rest.png", "pulled.png", "pulled.png"]),
        lambda: read_pair(["rest.png", "pulled.png"]),
        given=lambda: pictures(rest=beads(0.0), pulled=beads(2.0)),
    ),
    Remedy(
        "and pulled; give both files",
        lambda: read_pair(["rest.png"]),
        lambda: read_pair(["rest.png", "pulled.png"]),
        given=lambda: pictures(rest=beads(0.0), pulled=beads(2.0)),
    ),
    Remedy(
        "say which shows the beads at rest and which pulled",
        lambda: (tiff("s.tif", *STACK), read_pair(["s.tif"])),
        lambda: read_pair(["s.tif"], frames=(-1, 0)),
        right=lambda pair: bool((pair[0] == STACK[2]).all() and (pair[1] == STACK[0]).all()),
    ),
    Remedy(
        "frames must be two different numbers from 0 to",
        lambda: (tiff("s.tif", *STACK), read_pair(["s.tif"], frames=(0, 3))),
        lambda: read_pair(["s.tif"], frames=(0, 2)),
        right=lambda pair: bool((pair[1] == STACK[2]).all()),
    ),
]
