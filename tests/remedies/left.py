"""Messages of all rooms that were left: results that do not go together, methods of the founding paper, prints that fold, what is written wrongly in files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import simulation
from palpate.paper.algorithm import transform
from palpate.paper.formulas import hooke
from palpate.recordings import TopicMapping, read_recording, write_recording
from palpate.recordings.labelled import recording_of
from palpate.touch import joined
from remedies._remedy import Remedy
from remedies.skins import FAST, GEL, PAD, PRESS, RUBBER, SKIN, area, line
from skin_files import skin_text

HOW = {"slow": True}


def value(words: str, make: Any, wrong: Any, mended: Any, **how: Any) -> Remedy:
    return Remedy(words, lambda: make(wrong), lambda: make(mended), **{**HOW, **how})


def recording() -> pp.Recording:
    return pp.Recording(readings=np.stack([PRESS[1:]] * 3), channels=["stress_zz"])


def spectrum(draws: int) -> pp.Touch:
    return SKIN.reconstruct(PRESS, draws=draws)


def archived(workers: int) -> Any:
    def density(k: Any) -> Any:  # of no module: it cannot be sent
        return 1e3 * np.exp(-((1e-3 * k) ** 2))

    return pp.reconstruct_recording(
        pp.Skin(PAD, line(channels=["stress_zz"], noise=5.0)),
        recording(),
        "t.nc",
        method=pp.Wiener(spectrum=density),
        workers=workers,
        overwrite=True,
    )


def scene(kind: str = "dots") -> Any:
    from palpate.camera import Dots, Scene, Texture, dot_grid

    made = Dots(dot_grid((5, 7), 2e-3), 0.8e-3) if kind == "dots" else Texture(grain=0.15e-3)
    return Scene(pad=GEL, depth=0.5e-3, print=made, size=(160, 120), scale=1e-4, spacing=0.5e-3)


def ball(force: float) -> Any:
    return pp.solutions.hertz_point(contact_radius=2.5e-3, force=force)


def of_pictures(text: str) -> Any:
    from palpate.camera import gel_skin

    Path("gel.toml").write_text(text)
    return gel_skin("gel.toml", np.array([(x, y) for x in range(4) for y in range(3)]) * 1e-3)


def labelled(change: Any) -> Any:
    """A recording in a file that another program changed."""
    import xarray as xr

    write_recording(recording(), "r.nc")
    with xr.open_dataset("r.nc") as held:
        changed = change(held.load())
    return recording_of(changed)


def three(got: Any) -> bool:
    return bool(np.allclose(got.readings, recording().readings))


def meta(text: str) -> Any:
    """A recording as text whose line of meta is written by hand."""
    Path("r.csv").write_text(f"# meta: {text}\ntime (s),stress_zz[0] (Pa)\n0,1\n")
    return read_recording("r.csv")


def written(name: str) -> Any:
    if not Path("pipe.nc").exists():
        os.mkfifo("pipe.nc")
    write_recording(recording(), name)
    return read_recording(name)


def followed(lost: bool) -> Any:
    """Markers on a topic; one is lost in mid-stream, or is there."""
    pytest.importorskip("rosbags")
    import test_robots as robots

    types = robots.store()
    point, cloud = types.types["geometry_msgs/msg/Point32"], types.types["sensor_msgs/msg/PointCloud"]
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    head = header(stamp=stamp(sec=0, nanosec=0), frame_id="")
    made = []
    for i in range(3):
        points = [point(x=float(x), y=float(y) + 0.1 * i, z=0.0) for x in range(3) for y in range(3)]
        held = points[:8] if lost and i == 2 else points
        made.append(("/markers", "sensor_msgs/msg/PointCloud", 10**8 * i, cloud(header=head, points=held, channels=[])))
    mapping = TopicMapping(
        topic="/markers",
        path="points",
        fields=("x", "y"),
        scale=1e-3,
        markers=True,
        channels=("displacement_x", "displacement_y"),
    )
    return read_recording(robots.bag(Path(f"bag{lost}"), made, types), mapping=mapping)


def defined(definitions: str | None) -> Any:
    """A bag without its definitions, as an older ROS writes it."""
    import contextlib
    import sqlite3

    pytest.importorskip("rosbags")
    import test_robots as robots

    folder = Path("old")
    if not folder.exists():
        robots.bag(folder, robots.xela(robots.store()), robots.store(), version=8)
        with contextlib.closing(sqlite3.connect(next(folder.glob("*.db3")))) as base, base:
            if base.execute("select count(*) from sqlite_master where name='message_definitions'").fetchone()[0]:
                base.execute("delete from message_definitions")
        messages = Path("share/xela_server_ros2/msg")
        messages.mkdir(parents=True)
        for name, words in robots.XELA.items():
            (messages / f"{name.rsplit('/')[-1]}.msg").write_text(words)
    mapping = TopicMapping(
        topic="/xServTopic",
        channels=robots.SHEAR,
        path="sensors[0].taxels",
        fields=("x", "y", "z"),
        definitions=definitions,
    )
    return read_recording(folder, mapping=mapping)


def dots(kind: str) -> Any:
    """Dots in a picture, and the view that their pitch or four points give."""
    from palpate.camera import View

    grid = np.array([(20.0 + 20 * c, 20.0 + 20 * r) for r in range(5) for c in range(7)])
    if kind == "column":
        return View.from_pitch(np.array([(80.0, 5.0 + 10 * r) for r in range(11)]), 2e-3, size=(160, 120))
    if kind == "scale":
        return View.scaled(1e-4, size=(160, 120))
    turned = (grid - 80.0) @ np.array([[1.0, 1.0], [-1.0, 1.0]]) * 0.5**0.5 + 80.0
    if kind == "points":
        return View.from_points(turned[[0, 6, 28, 34]], 1e-4 * (grid[[0, 6, 28, 34]] - 80.0))
    if kind == "leaning":  # rows along the picture, columns that lean by more than half
        leaning = np.array([(20.0 + 20 * c + 11.0 * r, 20.0 + 20 * r) for r in range(5) for c in range(7)])
        return View.from_pitch(leaning, (2e-3, 1e-5), size=(220, 120))
    raise ValueError(kind)


def beads(window: int) -> Any:
    """Sparse beads that move by 2 pixels."""
    from palpate.microscopy import bead_displacements

    rng = np.random.default_rng(3)
    y, x = np.indices((256, 256), dtype=np.float64)
    places = rng.uniform(0, 256, (90, 2))

    def picture(shift: float) -> Any:
        image = 20.0 + 2.0 * rng.standard_normal(x.shape)
        for cx, cy in places:
            image += 200.0 * np.exp(-((x - cx - shift) ** 2 + (y - cy) ** 2) / 4.0)
        return image

    return bead_displacements(picture(0.0), picture(2.0), pixel=1e-7, window=window, drift=False)


def scattered(spacing: float | None) -> Any:
    rng = np.random.default_rng(0)
    array = pp.ScatteredArray(
        positions=rng.uniform(-0.1, 0.1, (2000, 2)), depth=1e-3, channels=["displacement_x", "displacement_y"]
    )
    cells = 400 if spacing is None else 20
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)  # whose influences are closed forms
    skin = pp.Skin(pad, array, surface=pp.AreaGrid(shape=(cells, cells), spacing=0.2 / cells))
    return skin.sense(np.zeros((3, cells, cells)))


def infinite(aperture: float) -> Any:
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3)
    array = pp.AreaArray(shape=(4, 4), pitch=1.0, depth=0.0, channels=["stress_xx"], aperture=aperture)
    return pp.Skin(pad, array, surface=pp.AreaGrid(shape=(5, 5), spacing=1.0)).sense(np.zeros((3, 5, 5)))


REMEDIES = [
    value(
        "be real numbers; got dtype {}: {}",
        lambda x: SKIN.reconstruct(x, **FAST),
        PRESS.astype(complex),
        PRESS.astype(complex).real,
    ),
    value("Join results of one skin and one number of draws", lambda n: joined([spectrum(4), spectrum(n)]), 6, 4),
    value("define its classes in a module, or use one worker", archived, 2, 1),
    Remedy(
        "ask displacement() for a texture",
        lambda: scene("texture").truth(ball(0.5)),
        lambda: scene("texture").displacement(ball(0.5), [[0.0, 0.0], [1e-3, 0.0]]),
        **HOW,
    ),
    value("no picture of it exists. Press less", lambda force: scene().picture(ball(force)), 4000.0, 0.5),
    value(
        'positions come from the pictures: the plane must have kind = "scattered" and no positions_file',
        of_pictures,
        skin_text(4, 4, channels=("displacement_x", "displacement_y")),
        '[pad]\nkind = "half_space"\nyoungs_modulus = "200 kPa"\npoissons_ratio = 0.48\n\n[[plane]]\nkind = "scattered"\ndepth = "1 mm"\n'
        'channels = ["displacement_x", "displacement_y"]\n',
    ),
    value("{} must be {}; got {}.", lambda n: pp.Tikhonov(order=n), 7, 1, room="inverse.method"),
    value(
        'at some wavevector these components have no effect on these channels. Use method="tikhonov"',
        lambda method: pp.Skin(RUBBER, line(channels=["stress_xz"])).reconstruct(
            PRESS[:1], method=method, components=["z"]
        ),
        "dft",
        "tikhonov",
    ),
    value(
        'use method="dft", or boundary="periodic"',
        lambda method: pp.Skin(PAD, area(shape=(66, 66))).reconstruct(np.zeros((1, 66, 66)), method=method),
        "linear",
        "dft",
    ),
    value("samples must be one row of odd length", transform, np.ones(8), np.ones(9)),
    value(
        "stress must hold three normal stresses first",
        lambda s: hooke(s, youngs_modulus=1.0, poissons_ratio=0.5),
        np.ones((5, 3)),
        np.ones((5, 3)).T,
    ),
    value("must be a JSON object", meta, '["a"]', '{"a": "b"}', room="recordings.checked"),
    value("{} {}; give a file name.", written, "pipe.nc", "r.nc", right=three),
    value(
        "readings must have the dimensions (time, channel, taxel) or (time, channel, y, x)",
        lambda name: labelled(lambda held: held.rename({"taxel": "sensor"}).rename({"sensor": name})),
        "sensor",
        "taxel",
        right=three,
    ),
    value(
        "markers follow {}; each message must hold all of them, in one order",
        followed,
        True,
        False,
        right=lambda got: got.readings.shape == (3, 2, 9),
    ),
    value(
        "meta must be a JSON object",
        lambda text: labelled(lambda held: held.assign_attrs(meta=text)),
        "3",
        "{}",
        room="recordings.labelled",
        right=three,
    ),
    value("give the folder of its package (package/msg/Name.msg) as definitions", defined, None, "share"),
    value("the dots form no grid with rows along the picture", dots, "column", "scale"),
    value("the dots form no rectangular grid of this pitch", dots, "leaning", "points"),
    value("take larger windows, or sharper pictures with more beads", beads, 8, 48),
    value("scattered positions and {} surface cells make a map", scattered, None, 1e-2),
    value("Give the taxels an aperture, a small depth, or a surface", infinite, 0.0, 0.5),
    value(
        "{} must be a positive number; got",
        lambda radius: list(
            simulation.stream(SKIN, simulation.handling(1.0, 1e-3)[:1], friction=0.5, radius=radius, rate=50.0)
        ),
        -5e-3,
        5e-3,
        room="simulation",
    ),
    value(
        "must have the batch axes {} of values first; it has the shape",
        lambda frames: pp.Touch(
            np.zeros((2, 2, SKIN.surface.count)), SKIN.surface, ("x", "z"), "tikhonov", fit=np.ones(frames)
        ),
        3,
        2,
    ),
]
