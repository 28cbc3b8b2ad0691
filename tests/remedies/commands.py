"""The command line: what its refusals say of options and files, with the command that they lead to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.recordings import read_recording, write_recording
from remedies import fields
from remedies._remedy import Remedy, command, laid
from skin_files import SHEAR, skin_text

LINE, AREA, SHEARED = skin_text(9), skin_text(2, 3, channels=SHEAR), skin_text(9, channels=("stress_xz",))
COLUMNS = '[columns]\ntime = "t"\nstress_zz = "S{}"\nunit = "25 Pa"\n'
TWO = LINE + LINE[LINE.index("[[plane]]") :].replace("1.2 mm", "2 mm")
COUNTS = "t," + ",".join(f"S{i}" for i in range(1, 10)) + "\n" + "0,0,0,0,1,2,1,0,0,0\n1,0,0,0,2,4,2,0,0,0\n"
FAST = "--method tikhonov --parameter 1e-4"


def press(readings: Any = None, **how: Any) -> pp.Recording:
    """Two frames of nine taxels on a line."""
    values = np.zeros((2, 1, 9))
    values[1, 0, 3:6] = 1e3, 2e3, 1e3
    return pp.Recording(readings=values if readings is None else readings, **{"channels": ["stress_zz"], **how})


def lay(**more: str) -> None:
    """Skins of a line, of an area and of two planes; a recording of nine taxels, and a table of them."""
    laid(
        skin_toml=LINE,
        area_toml=AREA,
        shear_toml=SHEARED,
        two_toml=TWO,
        mapped_toml=LINE + COLUMNS,
        t_csv=COUNTS,
        **more,
    )
    write_recording(press(), "r.nc")
    Path("there").mkdir()
    laid(there_nc="something")


def frames(count: int, name: str = "out.nc") -> Any:
    return lambda _: len(read_recording(name).readings) == count


def row(
    words: str, wrong: str, mended: str, *, room: str = "", right: Any = None, given: Any = lay, slow: bool = False
) -> Remedy:
    """A command that is refused, and the one that it is told to be."""
    return Remedy(words, command(wrong), command(mended), room=room, given=given, right=right, slow=slow)


CONVERT = "convert t.csv out.nc --map time=t,stress_zz=S{},unit=25Pa"
BEADS = "convert b.csv out.nc --columns x,y,u,v"


def table_of_beads() -> None:
    laid(b_csv="x,y,u,v\n0,0,1,0\n10,0,2,0\n0,10,1,3\n")


def bead(words: str, wrong: str, mended: str, last: float = 3e-3) -> Remedy:
    """A foreign table of displacements; its last number."""
    right = lambda _: bool(np.isclose(read_recording("out.nc").readings.ravel()[-1], last))  # noqa: E731
    return row(words, f"{BEADS} {wrong}", f"{BEADS} {mended}", given=table_of_beads, right=right, room="cli.convert")


def robot() -> None:
    """What a robot recorded: two lists of four numbers on a topic."""
    lay(
        stream_toml=skin_text(4) + '[stream]\ntopic = "/skin"\nunit = "1 kPa"\npath = "data"\n', plain_toml=skin_text(4)
    )
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag2 import Writer

    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float32MultiArray"
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(Path("bag"), version=9) as writer:
        skin = writer.add_connection("/skin", kind, typestore=store)
        for k in range(2):
            message = store.types[kind](layout=layout, data=np.array([1, 2, 3, 4.0 + k], dtype=np.float32))
            writer.write(skin, 10**9 + k * 10**7, store.serialize_cdr(message, kind))


TOPIC = "convert bag out.nc --topic /skin --channels stress_zz --path data --scale 1000"
STREAM = "convert bag out.nc --skin stream.toml"


def bag(words: str, wrong: str, mended: str, *, room: str = "cli.convert", last: float = 5000.0) -> Remedy:
    right = lambda _: bool(np.isclose(read_recording("out.nc").readings.ravel()[-1], last))  # noqa: E731
    return row(words, wrong, mended, given=robot, right=right, room=room, slow=True)


def field() -> None:
    """Two matrices of a displacement field, and pictures of beads."""
    rough = np.random.default_rng(0).standard_normal((2, 10, 12))
    np.save("u.npy", fields.U + 0.02 * rough[0])
    np.save("v.npy", fields.V + 0.02 * rough[1])
    laid(gel_toml=GEL, stiff_toml=AREA)


GEL = """[pad]
kind = "half_space"
youngs_modulus = "8 kPa"
poissons_ratio = 0.48
[[plane]]
kind = "area"
depth = "0 mm"
channels = ["displacement_x", "displacement_y"]
"""
TFM = "tfm u.npy v.npy --draws 8 --out o"
KNOWN = "--pixel 0.1um --unit px --step 8"
STIFF = "--youngs-modulus 8kPa --poissons-ratio 0.48"


def tfm(
    words: str, wrong: str, mended: str = f"{TFM} {KNOWN} {STIFF}", *, given: Any = field, slow: bool = True
) -> Remedy:
    """A run of `palpate tfm` takes a second, the most of it for the report."""
    return row(words, wrong, mended, given=given, room="cli.tfm", right=lambda told: "force" in told, slow=slow)


def filmed() -> None:
    field()
    fields.pictures(rest=fields.beads(0.0), pulled=fields.beads(2.0), part=fields.beads(0.0)[:64])


FILM = f"tfm rest.png pulled.png --pixel 0.1um --window 16 {STIFF} --draws 8 --out o"


def free_port() -> str:
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return str(one.getsockname()[1])


def served(line: str) -> Any:
    """`palpate live` up to the page, which is not served."""

    def call() -> Any:
        from unittest import mock

        import palpate.live

        with mock.patch.object(palpate.live, "serve") as serve:
            told = command(line.replace("PORT", free_port()))()
        assert serve.called, told
        return told

    return call


def live(words: str, wrong: str, mended: str, room: str = "cli.live", given: Any = lay, slow: bool = False) -> Remedy:
    def ready() -> None:
        pytest.importorskip("starlette")
        given()

    return Remedy(
        words, served(wrong), served(mended), room=room, given=ready, right=lambda told: "open http" in told, slow=slow
    )


SIMULATE = "simulate --skin skin.toml --out out.nc --force 200N/m --size 2mm"
RECONSTRUCT = f"reconstruct r.nc --skin skin.toml {FAST} --out out.nc"
TRACK = "track r.nc --skin skin.toml"


def simulated(words: str, wrong: str, mended: str = "") -> Remedy:
    return row(words, f"{SIMULATE} {wrong}", f"{SIMULATE} {mended}", right=frames(1), room="cli.simulate")


def gaps(*at: int) -> Any:
    def made() -> None:
        lay()
        values = np.array(press().readings)
        values[0, 0, list(at)] = np.nan
        write_recording(press(values), "r.nc")

    return made


REMEDIES = [
    # palpate convert
    row(
        "give one of these options too",
        "convert r.nc out.npz --channels stress_zz",
        "convert r.nc out.npz",
        right=frames(2, "out.npz"),
        room="cli.convert",
    ),
    row("only --grid and --force can be given", f"{CONVERT} --pixel 1mm", CONVERT, right=frames(2)),
    row(
        "that says what the columns of {} are: give --map",
        "convert t.csv out.nc --skin skin.toml",
        CONVERT,
        right=frames(2),
    ),
    bag("--columns describes a table; --topic", f"{TOPIC} --columns x,y", TOPIC),
    bag("use --scale for the numbers of a --topic", f"{TOPIC} --reading-unit kPa", TOPIC),
    bag(
        "describe the messages of a topic: give --topic too",
        TOPIC.replace("--topic /skin --channels stress_zz", ""),
        TOPIC,
    ),
    bag("give either --topic or a --skin", f"{TOPIC} --skin stream.toml", TOPIC),
    bag(
        "has no section [stream] that says where the readings are", STREAM.replace("stream.toml", "plain.toml"), STREAM
    ),
    bag("the section [stream] of a --skin describes an .mcap file or a bag", STREAM.replace("bag", "r.nc"), STREAM),
    bag("--topic describes an .mcap file or a bag", TOPIC.replace("bag", "r.nc"), TOPIC),
    row(
        "describe a foreign table: name its --columns too",
        "convert b.csv out.nc --pixel 1mm",
        f"{BEADS} --pixel 1mm",
        given=table_of_beads,
        right=frames(1),
    ),
    bead(
        "--follow moves markers by their displacement",
        "--channels stress_xz,stress_zz --follow --position-unit mm --reading-unit kPa",
        "--pixel 1mm --follow",
    ),
    bead("--pixel already gives the unit", "--pixel 1mm --reading-unit mm", "--pixel 1mm"),
    bead(
        "Use --position-unit and --reading-unit",
        "--channels stress_xz,stress_zz --pixel 1mm",
        "--channels stress_xz,stress_zz --position-unit mm --reading-unit kPa",
        3e3,
    ),
    bead("a foreign table has no units: give --pixel", "", "--pixel 1mm"),
    bead(
        "the channels of one table must share a unit",
        "--channels displacement_x,stress_zz --position-unit mm --reading-unit mm",
        "--position-unit mm --reading-unit mm",
    ),
    # files
    row(
        "does not exist; make it first",
        "convert r.nc new/out.nc",
        "convert r.nc out.nc",
        right=frames(2),
        room="cli.files",
    ),
    row(
        "is a folder; give a file name",
        "convert r.nc folder.nc",
        "convert r.nc out.nc",
        right=frames(2),
        room="cli.files",
        given=lambda: (lay(), Path("folder.nc").mkdir()),
    ),
    row(
        "exists. Give another name, or {} to replace it",
        "convert r.nc there.nc",
        "convert r.nc there.nc --force",
        right=frames(2, "there.nc"),
        room="cli.files",
    ),
    row(
        "and would be overwritten. Give another name",
        "convert r.nc r.nc --force",
        "convert r.nc out.nc",
        right=frames(2),
        room="cli.files",
    ),
    row(
        "{}: cannot write there ({}).",
        f"convert r.nc {'n' * 300}.nc",
        "convert r.nc out.nc",
        right=frames(2),
        room="cli.files",
    ),
    row(
        "{} is a file; give a folder.",
        "demo --out r.nc",
        "demo --out new",
        room="cli.files",
        right=lambda _: Path("new").is_dir(),
        slow=True,
    ),
    # palpate tfm
    tfm("--pixel must be positive", f"{TFM} --pixel 0um --unit px --step 8 {STIFF}"),
    tfm("give what no file states", TFM),
    row(
        "write a quantity and one uncertainty",
        f"{TFM} {KNOWN} --youngs-modulus '8 kPa +- 1 kPa +- 10 %' --poissons-ratio 0.48",
        f"{TFM} {KNOWN} --youngs-modulus '8 kPa +- 10 %' --poissons-ratio 0.48",
        given=field,
        room="cli.options",
        right=lambda told: "force" in told,
        slow=True,
    ),
    tfm("belongs to pictures of beads", f"{TFM} {KNOWN} {STIFF} --frames=-1,0"),
    tfm("belong to displacement fields", f"{FILM} --unit px", FILM, given=filmed),
    tfm(
        "--frames takes two numbers",
        f"{FILM} --frames=1".replace("rest.png pulled.png", "s.tif"),
        f"{FILM} --frames=0,2".replace("rest.png pulled.png", "s.tif"),
        given=lambda: (filmed(), fields.tiff("s.tif", *fields.STACK)),
    ),
    tfm("--step of pictures is a whole number", f"{FILM} --step 8.5", f"{FILM} --step 8", given=filmed),
    tfm(
        "give the picture of the same field of view",
        f"{FILM} --image part.png",
        f"{FILM} --image rest.png",
        given=filmed,
    ),
    tfm("{}: no such file.", TFM.replace("v.npy", "w.npy")),
    tfm(
        "describes the gel; give either",
        f"{TFM} {KNOWN} --skin gel.toml --youngs-modulus 8kPa",
        f"{TFM} {KNOWN} --skin gel.toml",
    ),
    # palpate simulate
    simulated("frames must be at least 1 and rate positive", "--frames 0", "--frames 1"),
    simulated("drag must lie between 0 and 1", "--friction 0.5 --drag 2", "--friction 0.5 --drag 1"),
    simulated("is a part of friction * force: give --friction too", "--drag 0.5", "--drag 0.5 --friction 0.4"),
    row(
        "is the direction of a drag: give --friction",
        "simulate --skin area.toml --out out.nc --direction 30",
        "simulate --skin area.toml --out out.nc --direction 30 --friction 0.4",
        right=frames(1),
    ),
    row(
        "force and size must be positive",
        "simulate --skin skin.toml --out out.nc --force 200N/m --size 0mm",
        SIMULATE,
    ),
    simulated(
        "is known in closed form for --contact hertz only",
        "--contact punch --friction 0.4 --drag 0.5",
        "--contact hertz --friction 0.4 --drag 0.5",
    ),
    simulated("y and direction have no meaning on a line", "--y 1mm"),
    row(
        "simulate writes one recording: the skin's planes must have one shape",
        "simulate --skin odd.toml --out out.nc --force 200N/m",
        "simulate --skin two.toml --out out.nc --force 200N/m",
        given=lambda: lay(odd_toml=TWO.replace("count = 9", "count = 7", 1)),
        right=frames(1),
    ),
    row(
        "name it for all, or for none",
        "simulate --skin odd.toml --out out.nc --force 200N/m",
        "simulate --skin two.toml --out out.nc --force 200N/m",
        given=lambda: lay(odd_toml=TWO + 'noise = "9 Pa"\n'),
        right=frames(1),
    ),
    # palpate reconstruct
    row(
        "is one frame: leave out either",
        f"{RECONSTRUCT} --plot-forces f.png --frame 1",
        f"{RECONSTRUCT} --frame 1",
        right=lambda told: "frame 1 of 2" in told,
        slow=True,
    ),
    row(
        "because each lacks a reading in some frame",
        f"{RECONSTRUCT} --drop-missing",
        TRACK,
        given=gaps(0, 1, 2, 6, 7, 8),
        right=lambda told: "a frame took" in told,
    ),
    row(
        "list the same channels in the same order",
        RECONSTRUCT.replace("skin.toml", "shear.toml"),
        RECONSTRUCT,
        right=lambda told: "of 2" in told,
        slow=True,
    ),
    row(
        "taxels but the skin describes",
        RECONSTRUCT.replace("skin.toml", "eight.toml"),
        RECONSTRUCT,
        given=lambda: lay(eight_toml=skin_text(8)),
        slow=True,
    ),
    # options
    row(
        "a tracker keeps pressure from pulling",
        "track s.nc --skin shear.toml --max-force 2N/m",
        f"reconstruct s.nc --skin shear.toml {FAST} --out out.nc",
        given=lambda: (lay(), write_recording(press(channels=["stress_xz"]), "s.nc")),
        right=lambda told: "of 2" in told,
    ),
    row(
        "a tracker needs boundary=",
        "track r.nc --skin periodic.toml",
        f"reconstruct r.nc --skin periodic.toml {FAST} --out out.nc",
        given=lambda: lay(periodic_toml='boundary = "periodic"\n' + LINE),
        right=lambda told: "of 2" in told,
        slow=True,
    ),
    row(
        "is none: leave it out",
        f"{RECONSTRUCT} --map time=t,stress_zz=S{{}}",
        RECONSTRUCT,
        room="cli.options",
        slow=True,
    ),
    row(
        "names its columns itself: leave it out",
        f"{RECONSTRUCT} --map time=t,stress_zz=S{{}}".replace("r.nc", "own.csv"),
        RECONSTRUCT.replace("r.nc", "own.csv"),
        given=lambda: (lay(), write_recording(press(), "own.csv")),
        slow=True,
    ),
    row(
        "pictures end in .png, .pdf or .svg",
        f"{RECONSTRUCT} --plot p.bmp",
        f"{RECONSTRUCT} --plot p.png",
        right=lambda _: Path("p.png").is_file(),
        slow=True,
    ),
    bag("must be one number or several with commas", TOPIC.replace("1000", "1kPa"), TOPIC, room="cli.options"),
    bag("--shape must be rows x columns", f"{TOPIC} --shape 2", f"{TOPIC} --shape 2x2", room="cli.options"),
    row(
        "Leave out positions_file to use the recording's own positions",
        f"reconstruct m.nc --skin placed.toml {FAST} --out out.nc",
        f"reconstruct m.nc --skin free.toml {FAST} --out out.nc",
        given=lambda: marked(),
        right=lambda told: "frame 0 of 1" in told,
        slow=True,
    ),
    # palpate track
    row(
        "--force replaces a result: give --out too",
        f"{TRACK} --force",
        f"{TRACK} --force --out out.nc",
        right=frames(2),
    ),
    row(": no such file.", "track lost.nc --skin skin.toml", TRACK, room="cli.track"),
    row("are for pictures (a video, a folder, a .tif stack)", f"{TRACK} --every 2", TRACK),
    row("leaves no frame of the", f"{TRACK} --baseline 2", f"{TRACK} --baseline 1", room="cli.track"),
    row("is not in the recording, which goes from", f"{TRACK} --zero-at 9", f"{TRACK} --zero-at 1"),
    # palpate live
    live("give either a RECORDING, --camera", "live --skin skin.toml", "live r.nc --skin skin.toml"),
    live(
        "--speed must be a positive number",
        "live r.nc --skin skin.toml --speed 0",
        "live r.nc --skin skin.toml --speed 2",
    ),
    live("a live sensor has its own pace: leave out --speed", "live --demo --speed 2", "live --demo", slow=True),
    live("--map describes a RECORDING that is a table", "live --demo --map time=t", "live --demo", slow=True),
    live(
        "not frames from the network or a camera: leave out --loop",
        "live --udp PORT --skin skin.toml --loop",
        "live --udp PORT --skin skin.toml",
    ),
    live("no such folder", "live --demo --record-to new", "live --demo --record-to there", slow=True),
    live("Give --record another name", "live --demo --record there.nc", "live --demo --record out.nc", slow=True),
    live(
        "leave --token out to get a random one",
        "live --demo --host 0.0.0.0 --token ''",
        "live --demo --host 0.0.0.0",
        slow=True,
    ),
    live(
        "frames from the network hold planes of one shape",
        "live --udp PORT --skin odd.toml",
        "live --udp PORT --skin two.toml",
        given=lambda: lay(odd_toml=TWO.replace("count = 9", "count = 7", 1)),
    ),
    # others
    row(
        "is a folder; give another one with --out",
        "demo --out there",
        "demo --out fresh",
        room="cli.demo",
        given=lambda: (lay(), Path("there/skin.toml").mkdir()),
        slow=True,
    ),
    row(
        "give another folder with --out, or --force to replace it",
        "demo --out there",
        "demo --out there --force",
        room="cli.demo",
        given=lambda: (lay(), Path("there/skin.toml").write_text("mine")),
        slow=True,
    ),
    row(
        "{} and {} both write {}: give one of them another name",
        "reconstruct r.nc --skin skin.toml --plot a.png --plot-forces a.png",
        "reconstruct r.nc --skin skin.toml --plot a.png --plot-forces b.png",
        room="cli.files",
        right=lambda _: Path("a.png").is_file() and Path("b.png").is_file(),
    ),
    row(
        "{} is given more than once, and has one value: give it once",
        "reconstruct r.nc --skin skin.toml --method dft --method tikhonov",
        "reconstruct r.nc --skin skin.toml --method tikhonov",
        room="cli.command",
    ),
    row(
        "--out writes the skin.toml of one sensor: name it",
        "sensors --out s.toml",
        "sensors gelsight_mini --out s.toml",
        right=lambda _: Path("s.toml").is_file(),
    ),
]


def marked() -> None:
    """Markers that lie elsewhere than the file of positions says."""
    lay()
    places = np.array([(x, y) for y in range(3) for x in range(4)]) * 1e-3
    held = pp.Recording(readings=np.ones((1, 1, 12)), channels=["stress_zz"], positions=places)
    write_recording(held, "m.nc")
    write_recording(pp.Recording(readings=np.ones((1, 1, 12)), channels=["stress_zz"], positions=2 * places), "p.nc")
    free = (
        GEL.replace('"area"', '"scattered"')
        .replace('"displacement_x", "displacement_y"', '"stress_zz"')
        .replace('"0 mm"', '"1 mm"')
    )
    laid(free_toml=free, placed_toml=free + 'positions_file = "p.nc"\n')
