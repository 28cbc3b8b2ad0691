"""skin.toml: what a refusal says of its sections, keys and values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.recordings import read_camera, read_stream, write_recording
from palpate.recordings.camerasection import CameraSettings
from palpate.sensors import preset
from remedies._remedy import Remedy, laid
from skin_files import SHEAR, skin_text

LINE, AREA = skin_text(9, noise="50 Pa"), skin_text(2, 3, channels=SHEAR)
SCATTERED = AREA.replace('"area"', '"scattered"').replace("shape = [2, 3]\n", "").replace('pitch = "1 mm"\n', "")
PLACES = 'positions_file = "p.nc"\n'
LAYERS = """[pad]
kind = "bonded_layers"
[[pad.layer]]
thickness = "2 mm"
youngs_modulus = "200 kPa"
poissons_ratio = 0.48
""" + LINE[LINE.index("[[plane]]") :]
STREAM = '[stream]\ntopic = "/skin"\nunit = "1 kPa"\n'
CAMERA = "[camera]\n"
SCALE = 'scale = "0.06 mm"\n'
#: A press that each of these skins feels.
PRESS = pp.solutions.hertz_line(half_width=2e-3, force=50.0)


def positions(places: Any = True) -> None:
    grid = [(x * 1e-3, y * 1e-3) for y in range(2) for x in range(3)]
    held = pp.Recording(readings=np.zeros((1, 3, 6)), channels=SHEAR, positions=grid if places else None)
    write_recording(held, "p.nc")


def read(text: str) -> Any:
    laid(skin_toml=text)
    return pp.Skin.from_file("skin.toml")


def feels(skin: Any) -> bool:
    """The skin that is read is whole: it feels a press."""
    ball = pp.solutions.hertz_point(contact_radius=1e-3, force=0.1)
    return bool(np.abs(skin.sense(PRESS if skin.surface.dimensions == 1 else ball)).max() > 0)


def skin(words: str, wrong: str, mended: str, *, given: Any = None, room: str = "", right: Any = feels) -> Remedy:
    return Remedy(words, lambda: read(wrong), lambda: read(mended), given=given, room=room, right=right)


def section(
    words: str, reader: Any, wrong: str, mended: str, *, base: str = LINE, room: str = "", right: Any = None
) -> Remedy:
    """A section besides pad and planes, by its own reader."""

    def made(text: str) -> Any:
        laid(skin_toml=base + text)
        return reader("skin.toml")

    return Remedy(words, lambda: made(wrong), lambda: made(mended), room=room, right=right)


def camera(words: str, wrong: str, mended: str, right: Any = None) -> Remedy:
    return section(words, read_camera, CAMERA + wrong, CAMERA + mended, room="recordings.camerasection", right=right)


def pad(words: str, key: str, wrong: str, mended: str, *, text: str = LINE, room: str = "") -> Remedy:
    """The value of one key."""
    lines = [line for line in text.splitlines() if line.startswith(f"{key} =")]
    old = lines[0]
    return skin(words, text.replace(old, f"{key} = {wrong}", 1), text.replace(old, f"{key} = {mended}", 1), room=room)


REMEDIES = [
    skin(
        'an uncertainty must be a part such as "10 %"',
        LINE + '[uncertainty]\ndepth = "0.1 mm"\n',
        LINE + '[uncertainty]\ndepth = "10 %"\n',
    ),
    skin(
        "has an uncertainty in two places; say it once",
        LINE.replace('"1.2 mm"', '"1.2 mm +- 5 %"') + '[uncertainty]\ndepth = "5 %"\n',
        LINE.replace('"1.2 mm"', '"1.2 mm +- 5 %"'),
    ),
    Remedy(
        ": no such file. A skin file describes pad and array; palpate demo writes one",
        lambda: pp.Skin.from_file("lost.toml"),
        lambda: read(LINE),
        right=feels,
    ),
    Remedy("is a folder; give a skin.toml", lambda: pp.Skin.from_file("."), lambda: read(LINE), right=feels),
    skin("is missing; a plane of kind =", LINE.replace("count = 9\n", ""), LINE),
    *(
        skin(
            words,
            LINE.replace("count = 9\n", f"count = 9\nlimits = {wrong}\n"),
            LINE.replace("count = 9\n", f"count = 9\nlimits = {right}\n"),
        )
        for words, wrong, right in (
            (
                "limits must be one quantity, [low, high], or one [low, high] per channel",
                '["1 Pa", "2 Pa", "3 Pa"]',
                '["1 Pa", "2 kPa"]',
            ),
            ("must be one quantity or [low, high]; got", '[["1 Pa", "2 Pa", "3 Pa"]]', '[["1 Pa", "2 kPa"]]'),
        )
    ),
    pad("noise must be one quantity or one per channel", "noise", '["50 Pa", "50 Pa"]', '["50 Pa"]'),
    skin(
        'center must be two lengths [x, y] such as ["1 mm", "0 mm"]',
        AREA + 'center = "1 mm"\n',
        AREA + 'center = ["1 mm", "0 mm"]\n',
    ),
    skin(
        "is a recording without positions",
        SCATTERED + PLACES.replace("p.nc", "q.nc"),
        SCATTERED + PLACES,
        given=lambda: (positions(False), Path("p.nc").rename("q.nc"), positions()),
    ),
    skin(
        "surface of an area array needs shape = [rows, columns] and spacing",
        AREA + '[surface]\ncount = 9\nspacing = "1 mm"\n',
        AREA + '[surface]\nshape = [6, 7]\nspacing = "1 mm"\n',
    ),
    skin(
        "surface of a line array needs count and one spacing",
        LINE + '[surface]\nshape = [6, 7]\nspacing = "1 mm"\n',
        LINE + '[surface]\ncount = 15\nspacing = "1 mm"\n',
    ),
    pad(
        "write a quantity and one uncertainty, such as",
        "depth",
        '"1.2 mm +- 5 % +- 1 %"',
        '"1.2 mm +- 5 %"',
        room="recordings.skinfile",
    ),
    Remedy(
        "{}: cannot be read as text in UTF-8 ({}); save it in UTF-8.",
        lambda: (laid(skin_toml=LINE.replace("200 kPa", "200 µPa").encode("latin-1")), pp.Skin.from_file("skin.toml")),
        lambda: read(LINE),
        room="_files",
        right=feels,
    ),
    skin(": not valid TOML", LINE.replace("[[plane]]", "[[plane]"), LINE),
    skin('does not belong to a plane of kind = "{}"', LINE.replace("count = 9", "count = 9\nshape = [2, 3]"), LINE),
    pad("pitch and aperture must be one length on a line", "pitch", '["1 mm", "1 mm"]', '"1 mm"'),
    section(
        "unit must be one quantity or one per channel",
        read_stream,
        STREAM.replace('"1 kPa"', '["1 kPa", "1 kPa"]'),
        STREAM,
        right=lambda m: tuple(m.scale) == (1e3,),
    ),
    # said beneath, told with the line
    pad("must be a quantity such as", "depth", "[1.2]", '"1.2 mm"'),
    # [camera]
    camera(
        "must say how pixels become metres: one of them", "reference = 5\n", SCALE, lambda c: np.isclose(c.scale, 6e-5)
    ),
    camera(
        "texture must be a positive distance between readings, such as",
        SCALE + 'texture = "-1 mm"\n',
        SCALE + 'texture = "1 mm"\n',
    ),
    camera(
        "give scale or points in place of pitch", 'pitch = "2 mm"\ntexture = "1 mm"\n', SCALE + 'texture = "1 mm"\n'
    ),
    camera(
        "points and places belong together",
        "points = [[1, 1], [9, 1], [9, 9], [1, 9]]\n",
        'points = [[1, 1], [9, 1], [9, 9], [1, 9]]\nplaces = [["0 mm", "0 mm"], ["8 mm", "0 mm"], ["8 mm", "8 mm"], ["0 mm", "8 mm"]]\n',
    ),
    camera(
        "matrix and distortion belong together",
        SCALE + "matrix = [[100, 0, 50], [0, 100, 50], [0, 0, 1]]\n",
        SCALE + "matrix = [[100, 0, 50], [0, 100, 50], [0, 0, 1]]\ndistortion = [0, 0, 0, 0, 0]\n",
    ),
    camera("distance must be positive", SCALE + 'distance = "-20 mm"\n', SCALE + 'distance = "20 mm"\n'),
    Remedy(
        "reference must be at least one picture in which nothing touches",
        lambda: CameraSettings(scale=6e-5, reference=0),
        lambda: CameraSettings(scale=6e-5, reference=1),
    ),
    # what must be measured first
    skin(
        "is unknown: measure it and write it here, such as",
        LAYERS.replace('"2 mm"', '"unknown"', 1),
        LAYERS.replace('"2 mm"', '"1.5 mm"', 1),
    ),
    # a sensor that is known
    Remedy("no sensor {}; there are", lambda: preset("gelsight"), lambda: preset("gelsight_mini")),
]
