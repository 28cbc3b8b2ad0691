"""Cameras, markers and pictures: what a refusal says of views, sources, references and dots; and figures."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from camera_scenes import gel_file
from palpate.recordings.camerasection import CameraSettings
from remedies._remedy import Remedy, command, laid, value
from remedies.skins import AREA, FAST, TOUCH, TRACTION

pytest.importorskip("cv2")

from palpate.camera import (
    DepthMap,
    Displacements,
    Flow,
    ForceTrace,
    Lens,
    Markers,
    View,
    find_dots,
    follow,
    grey,
    open_pictures,
    read_force_trace,
    weigh,
    write_video,
)

PIXELS = np.array([[12.0, 9.0], [148.0, 10.0], [147.0, 110.0], [13.0, 111.0]])
PLACES = 1e-4 * (PIXELS - 80.0)
GRID = np.array([(20.0 + 20 * c, 20.0 + 20 * r) for r in range(5) for c in range(7)])
VIEW = View.scaled(1e-4, size=(160, 120))
SKIN_OF_DOTS = pp.Skin(
    pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)]),
    pp.AreaArray(shape=(5, 7), pitch=2e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y"]),
)
BALL = pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)
PRESSED = AREA.reconstruct(AREA.sense(BALL), **FAST)

#: Forces of eight frames [N], and a recording of the dots that they move.
LOADS = [0.0] * 4 + [1.0] * 4


@functools.cache
def picture(pull: float = 0.0, count: int = 35) -> Any:
    """Dark dots on a bright gel, 160 x 120 pixels; those in the middle are pulled apart by so many pixels."""
    y, x = np.indices((120, 160), dtype=np.float64)
    image = np.full(x.shape, 200.0)
    for cx, cy in GRID[:count]:
        away = np.array([cx - 80.0, cy - 60.0])
        cx, cy = np.array([cx, cy]) + pull * away / 20.0 * np.exp(-(away @ away) / 800.0)
        image -= 150.0 / (1.0 + np.exp((np.hypot(x - cx, y - cy) - 4.0) / 0.6))
    noise = np.random.default_rng(abs(int(10 * pull))).normal(0.0, 1.0, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@functools.cache
def texture() -> Any:
    from scipy.ndimage import gaussian_filter

    rough = gaussian_filter(np.random.default_rng(2).normal(size=(120, 160)), 1.5)
    return np.clip(128 + 60 * rough / rough.std(), 0, 255).astype(np.uint8)


REST = [picture()] * 5
PULLED = [*REST, picture(1.5), picture(1.5)]


def near(view: Any) -> bool:
    """The view that comes out is the one that was meant."""
    return bool(np.allclose(view.places([[80.0, 80.0]]), 0.0, atol=2e-4))


def read(source: Any, **how: Any) -> Any:
    with Displacements(source, how.pop("view", VIEW), **how) as readings:
        return list(readings)


def moved(readings: Any) -> bool:
    return bool(np.nanmax(np.abs(readings[-1].values)) > 5e-5)


def opened(source: Any, **how: Any) -> Any:
    with open_pictures(source, **how) as pictures:
        return [p.image for p in pictures]


def touches(source: Any = None, skin: Any = SKIN_OF_DOTS, **how: Any) -> Any:
    with follow(
        PULLED if source is None else source, skin, **{"view": VIEW, "track": True, "rate": 30.0, **how}
    ) as found:
        return next(iter(found))


def png(**images: Any) -> None:
    import cv2

    for name, image in images.items():
        assert cv2.imwrite(f"{name}.png", image)


def film(name: str, images: Any = PULLED) -> None:
    pytest.importorskip("av")
    write_video(name, images, rate=30.0)


def depths(**how: Any) -> Any:
    return DepthMap(**{"positions": 1e-4 * (GRID - 80.0), "depth": np.zeros((7, 35)), "std": 1e-5, **how})


GEL_TOML = gel_file('scale = "0.1 mm"', thickness="4 mm", modulus="200 kPa")


def files() -> None:
    laid(gel_toml=GEL_TOML, plain_toml=GEL_TOML[: GEL_TOML.index("[camera]")], r_csv="x")
    film("gel.mkv")


def told(words: str, wrong: str, mended: str, *, room: str = "", slow: bool = True) -> Remedy:
    """Pictures on the command line."""
    return Remedy(words, command(wrong), command(mended), room=room, given=files, slow=slow)


FILMED = "track gel.mkv --skin gel.toml --fast"

REMEDIES = [
    # views and lenses
    value("must be finite pairs of shape (..., 2)", VIEW.places, [1.0, 2.0, 3.0], [1.0, 2.0]),
    value(
        "a lens needs its camera matrix",
        lambda m: Lens(m, (0.0,) * 5),
        np.eye(3)[:2],
        [[100, 0, 80], [0, 100, 60], [0, 0, 1]],
    ),
    value(
        "distortion must be OpenCV's 4, 5, 8, 12 or 14 numbers",
        lambda d: Lens([[100, 0, 80], [0, 100, 60], [0, 0, 1]], d),
        (0.0,) * 3,
        (0.0,) * 4,
    ),
    value("homography must be a finite, invertible array", lambda h: View(h), np.zeros((3, 3)), np.eye(3)),
    value("a view needs four points or more", lambda n: View.from_points(PIXELS[:n], PLACES[:n]), 3, 4, right=near),
    value(
        "give four corners of a rectangle or the like",
        lambda p: View.from_points(PIXELS, p),
        PLACES[[0] * 4],
        PLACES,
        right=near,
    ),
    value(
        "no three of four may lie on a line",
        lambda p: View.from_points(*p),
        (np.array([[0.0, 0], [50, 0], [100, 0], [150, 0]]), 1e-4 * np.array([[0.0, 0], [50, 0], [100, 0], [150, 0]])),
        (PIXELS, PLACES),
        right=near,
    ),
    value(
        "Are they in the same order?",
        lambda p: View.from_points(GRID[[0, 6, 28, 34, 17]], p),
        1e-4 * (GRID[[6, 0, 28, 34, 17]] - 80),
        1e-4 * (GRID[[0, 6, 28, 34, 17]] - 80),
        right=near,
    ),
    value("scale must be metres per pixel", lambda s: View.scaled(s, size=(160, 120)), -1.0, 1e-4),
    value("pitch must be metres, one or (x, y)", lambda p: View.from_pitch(GRID, p, size=(160, 120)), 0.0, 2e-3),
    value(
        "a grid needs nine dots or more",
        lambda f: f(),
        lambda: View.from_pitch(GRID[:6], 2e-3, size=(160, 120)),
        lambda: View.scaled(1e-4, size=(160, 120)),
    ),
    value(
        "the dots form no regular grid: give a scale",
        lambda f: f(),
        lambda: View.from_pitch(np.random.default_rng(1).uniform(0, 120, (35, 2)), 2e-3, size=(160, 120)),
        lambda: View.scaled(1e-4, size=(160, 120)),
    ),
    value(
        "a view is described by its homography",
        View.restored,
        {"matrix": 1},
        VIEW.described(),
        right=lambda v: np.allclose(v.homography, VIEW.homography),
    ),
    value("a picture must hold uint8, uint16, float32 or float64", grey, picture() + 0j, picture()),
    value("a picture must have shape (rows, columns) or (rows, columns, 3)", grey, picture()[0], picture()),
    # sources
    value(
        "not an ending of pictures. Accepted",
        opened,
        "gel.doc",
        "gel.png",
        given=lambda: (png(gel=picture()), laid(gel_doc="x")),
    ),
    value("rate must be a positive number of pictures a second", lambda r: opened(np.stack(REST), rate=r), 0.0, 30.0),
    value("got a bool", opened, True, np.stack(REST)),
    value(
        "no such file or folder. For a camera give its number",
        opened,
        "lost.png",
        "gel.png",
        given=lambda: png(gel=picture()),
    ),
    value(
        "Record it again",
        opened,
        "gel.mkv",
        "again.mkv",
        given=lambda: (laid(gel_mkv=""), film("again.mkv", REST)),
        right=lambda images: len(images) == 5,
    ),
    value("an array of pictures has shape", opened, picture(), picture()[None], right=lambda images: len(images) == 1),
    value("or arrays; got {}.", opened, 3.5, [picture()]),
    value(
        "holds no pictures (",
        opened,
        "empty",
        "full",
        given=lambda: (
            Path("empty").mkdir(),
            Path("full").mkdir(),
            png(gel=picture()),
            Path("gel.png").rename("full/gel.png"),
        ),
    ),
    value(
        "a camera has times of its own: leave out rate",
        lambda how: Displacements(*how[0], **how[1]) if how else read(REST),
        ((0, VIEW), {"rate": 30.0}),
        None,
    ),
    value(
        "{}: a video is written as",
        lambda n: write_video(n, REST, rate=30.0),
        "gel.gif",
        "gel.mkv",
        given=lambda: pytest.importorskip("av"),
    ),
    Remedy(
        "{} has times of its own: leave out rate",
        lambda: opened("gel.mkv", rate=30.0),
        lambda: opened("gel.mkv"),
        given=lambda: film("gel.mkv"),
        right=lambda images: len(images) == 7,
    ),
    value(
        "cannot be read as TIFF",
        opened,
        "gel.tif",
        "gel.png",
        given=lambda: (laid(gel_tif="x"), png(gel=picture())),
        room="camera.pictures",
    ),
    value(
        "record .mkv, which needs none, or repair it",
        opened,
        "cut.mp4",
        "gel.mkv",
        given=lambda: (
            film("cut.mp4"),
            Path("cut.mp4").write_bytes(Path("cut.mp4").read_bytes()[:-900]),
            film("gel.mkv"),
        ),
    ),
    value(
        "there are no pictures to write",
        lambda i: write_video("gel.mkv", i, rate=30.0),
        [],
        REST,
        given=lambda: pytest.importorskip("av"),
    ),
    value(
        "a video takes 8-bit pictures",
        lambda i: write_video("gel.mkv", i, rate=30.0),
        [picture().astype(np.float32)],
        REST,
        given=lambda: pytest.importorskip("av"),
    ),
    value(
        "the pictures of a video have one size",
        lambda i: write_video("gel.mkv", i, rate=30.0),
        [picture(), picture()[:60]],
        REST,
        given=lambda: pytest.importorskip("av"),
    ),
    # dots and texture
    value(
        "Check light, exposure and lens cap",
        find_dots,
        np.zeros((120, 160), dtype=np.uint8),
        picture(),
        right=lambda found: len(found.positions) == 35,
    ),
    value(
        "no dots found: no spots of one size",
        find_dots,
        np.full((120, 160), 150, dtype=np.uint8) + np.random.default_rng(0).integers(0, 9, (120, 160)).astype(np.uint8),
        picture(),
    ),
    value("whole dots found; at least three are needed", lambda at: Markers(picture(), positions=at), GRID[:2], GRID),
    value("Read it less densely, or film nearer", lambda s: Flow(texture(), spacing=s), 1.0, 16.0),
    value("Read it more densely, film nearer, or focus", lambda s: Flow(texture(), spacing=s), 90.0, 16.0),
    value("the reference holds no picture", lambda r: Markers(r), [], REST),
    value("the reference pictures differ in size", lambda r: Markers(r), [picture(), picture()[:60]], REST),
    # readings
    value(
        "of another shape. Give the scale and size of these pictures",
        lambda size: read(PULLED, view=CameraSettings(scale=1e-4, size=size)),
        (160, 90),
        (160, 120),
        right=moved,
    ),
    value(
        "reference must be a number of pictures of at least 1",
        lambda n: read(PULLED, reference=n),
        0,
        5,
        room="camera.displacements",
        right=moved,
    ),
    value(
        "texture must be a positive distance between readings [m]",
        lambda t: read([texture()] * 6, texture=t),
        -1e-3,
        1.6e-3,
    ),
    value(
        "begin earlier, or give a smaller reference",
        lambda n: read([picture(), picture(), picture(4.0), picture(4.0), picture(4.0)], reference=n),
        3,
        2,
        right=moved,
    ),
    value("all pictures have been read; open the source again", lambda n: again(n), 2, 1),
    # depth maps
    value("positions of a depth map must be finite", lambda p: depths(positions=p), [[0.0, 0.0]], 1e-4 * (GRID - 80.0)),
    value("std of a depth map must be a positive number", lambda s: depths(std=s), 0.0, 1e-5),
    value("depth must be a function of a picture's number", lambda d: depths(depth=d), np.zeros(35), np.zeros((7, 35))),
    value("the depth map holds {} pictures", lambda i: depths().of(i), 9, 6),
    value("a depth for each of {} places is needed", lambda n: depths(depth=lambda i: np.zeros(n)).of(0), 5, 35),
    value("mark those that are not known as NaN", lambda d: depths(depth=np.full((7, 35), d)).of(0), np.inf, np.nan),
    # touches
    value("the skin needs one plane with these channels", lambda s: touches(skin=s), AREA, SKIN_OF_DOTS),
    value("nothing says how pixels become metres", lambda view: touches(view=view), None, VIEW, room="camera.touches"),
    value("every must be a whole number of at least 1", lambda n: touches(every=n), 0, 1, room="camera.touches"),
    value("give track=True to follow them", lambda t: stepped(t), False, True),
    value("leave out depth_map, or give track=False", lambda given: touches(**given), {"depth_map": depths()}, {}),
    value("leave out every, or give track=False", lambda n: touches(every=n), 2, 1),
    value("forces must be positive", lambda f: weighed(f), -1.0, 1.0, slow=True),
    value("forces must be one for each of", lambda f: weighed(f), [1.0, 1.0], [1.0], slow=True),
    value("frames at rest are taken of", lambda n: pressed(reference=n), 9, 4, slow=True),
    value("which are taken to show it at rest", lambda n: pressed(reference=n), 7, 4, slow=True),
    value("weigh with the skin of this recording", lambda s: pressed(skin=s), AREA, SKIN_OF_DOTS, slow=True),
    value(
        "palpate weigh is for displacements and strains",
        lambda s: pressed(skin=s, own=True),
        AREA,
        SKIN_OF_DOTS,
        slow=True,
    ),
    value("such as by taking the time of the first", lambda t: pressed(trace(start=t)), 9e8, 0.0, slow=True),
    value("do not rise together", lambda f: pressed(trace(force=f)), [3.0, 0.1] * 4, LOADS, slow=True),
    value("a trace has one force for each time", lambda f: trace(force=f), [1.0], LOADS),
    value("the times of a trace must rise", lambda t: trace(start=t), np.nan, 0.0),
    value("{}: no such file.", lambda name: traced(name=name), "lost.csv", "f.csv", room="camera.traces"),
    value("name it such as {}, its unit with it", lambda t: traced(t), "time (s),x (N)", "time (s),fz (N)"),
    value("does not say its unit: name the column", lambda t: traced(t), "time (s),fz", "time (s),fz (N)"),
    value(
        "Show the gel at rest first, then the press",
        lambda p: weighed(1.0, p),
        [*REST, picture(), picture()],
        PULLED,
        slow=True,
    ),
    value(
        "describe a half-space or bonded layers without creep",
        lambda pad: weighed(1.0, skin=pp.Skin(pad, SKIN_OF_DOTS.planes[0])),
        pp.Viscoelastic(SKIN_OF_DOTS.pad, [(0.3, 1.0)]),
        SKIN_OF_DOTS.pad,
        slow=True,
    ),
    # figures
    value("truth must have shape", lambda t: TOUCH.plot(truth=t), TRACTION[:1], np.asarray(TOUCH.values), slow=True),
    value("seen_from must be", lambda s: PRESSED.plot(seen_from=s), "above", "outside", slow=True),
    value(
        "pick one, touch[i]",
        lambda t: overlay(t),
        AREA.reconstruct(np.stack([AREA.sense(BALL)] * 2), **FAST),
        PRESSED,
        slow=True,
    ),
    value(
        "Of several, give the one of this frame", lambda i: overlay(PRESSED, i), np.stack(REST), picture(), slow=True
    ),
    value("show must be {} or all", lambda s: overlay(PRESSED, show=s), "force", "pressure", slow=True),
    value("{} cannot be drawn", lambda s: overlay(PRESSED, show=s), "shear", "pressure", slow=True),
    # the command line
    told("--fast follows all pictures with a tracker", f"{FILMED} --every 2", FILMED),
    told("--budget, --zero-at and --map are for recordings", f"{FILMED} --budget 5", FILMED),
    told(
        "once for each, or one for all",
        "weigh gel.mkv --skin gel.toml --force 1N --force 2N",
        "weigh gel.mkv --skin gel.toml --force 1N",
    ),
    told(
        "{}: no such file.",
        "weigh lost.mkv --skin gel.toml --force 1N",
        "weigh gel.mkv --skin gel.toml --force 1N",
        room="cli.weigh",
    ),
    told(
        "--map names the columns of a table: leave it out for pictures",
        "weigh gel.mkv --skin gel.toml --force 1N --map frame=frame",
        "weigh gel.mkv --skin gel.toml --force 1N",
    ),
    told(
        "nothing says how pixels become metres", "track gel.mkv --skin plain.toml --fast", FILMED, room="camera.touches"
    ),
]


def again(count: int) -> Any:
    with Displacements(PULLED, VIEW) as readings:
        for _ in range(count):
            found = readings.recording()
        return found


def stepped(track: bool) -> Any:
    with follow(PULLED, SKIN_OF_DOTS, view=VIEW, track=track, rate=30.0) as found:
        return found.step(np.zeros((2, 35)), 0.0)


def pressed(force: Any = 1.0, *, skin: Any = SKIN_OF_DOTS, own: bool = False, reference: int = 4) -> Any:
    """The modulus from a recording of the dots, or of the skin's ``own`` readings."""
    made = skin if own else SKIN_OF_DOTS
    moved = np.asarray(LOADS)[:, None, None, None] * np.asarray(made.sense(BALL))
    moved = moved + 2e-4 * np.abs(moved).max() * np.random.default_rng(0).standard_normal(moved.shape)
    held = pp.Recording(readings=moved, channels=made.planes[0].channels, time=0.1 * np.arange(8))
    return weigh(held, skin, force, reference=reference)


def trace(force: Any = LOADS, start: float = 0.0) -> Any:
    return ForceTrace(start + 0.1 * np.arange(8), np.asarray(force), "f.csv")


def traced(titles: str = "time (s),fz (N)", name: str = "f.csv") -> Any:
    laid(f_csv=f"{titles}\n0,0\n1,2\n")
    return read_force_trace(name)


def weighed(force: Any, pictures: Any = None, skin: Any = None) -> Any:
    return weigh(PULLED if pictures is None else pictures, skin or SKIN_OF_DOTS, force, view=VIEW)


def overlay(touch: Any, image: Any = None, **how: Any) -> Any:
    from palpate.camera import overlay as drawn

    return drawn(picture() if image is None else image, touch, view=VIEW, **how)
