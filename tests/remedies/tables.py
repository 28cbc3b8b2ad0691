"""Tables of other programs: what a refusal says of their columns, their lines and their numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from palpate.recordings import TableMapping, read_columns, read_recording
from palpate.recordings.columns import columns_of, columns_of_text
from remedies._remedy import Remedy

#: Three markers in two frames, of which one moves by 2 pixels at the end; taxels listed, one line per frame.
LONG = """frame,id,x,y,dx,dy
0,1,0,0,0,0
0,2,10,0,0,0
0,3,0,10,0,0
1,1,0,0,1,0
1,2,10,0,0,0
1,3,0,10,0,2
"""
NAMED = "frame=frame,marker=id,x=x,y=y,displacement_x=dx,displacement_y=dy"
MAP = NAMED + ",pixel=1mm"
WIDE = "t,S1,S2\n0,1,2\n1,3,4\n"
TAXELS = "time=t,stress_zz=S{},unit=25Pa"
DATED = "t,S1\n2017-07-30 12:06:34,1\n2017-07-30 12:06:35,4\n"


def read(text: str | bytes, said: str, shape: Any = None) -> Any:
    Path("t.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    return read_recording("t.csv", mapping=columns_of(columns_of_text(said), shape=shape))


def table(
    words: str,
    text: str | bytes,
    said: str,
    *,
    new: str | bytes | None = None,
    say: str | None = None,
    last: float | None = None,
    shapes: tuple[Any, Any] = (None, None),
    room: str = "",
) -> Remedy:
    """A table that is refused as it is ``said``: what is advised is another table (``new``), or another mapping (``say``); its last reading is ``last``."""
    return Remedy(
        words,
        lambda: read(text, said, shapes[0]),
        lambda: read(text if new is None else new, said if say is None else say, shapes[1]),
        room=room,
        right=None if last is None else lambda got: bool(np.isclose(got.readings.ravel()[-1], last, rtol=1e-9)),
    )


def section(words: str, wrong: str, mended: str, *, text: str = LONG, last: float = 2e-3, room: str = "") -> Remedy:
    """The same of a section [columns], in which ``wrong`` is mended."""

    def made(lines: str) -> Any:
        pad = '[pad]\nkind = "half_space"\nyoungs_modulus = "1 kPa"\npoissons_ratio = 0.5\n[[plane]]\nkind = "scattered"\ndepth = "1 mm"\n'
        Path("skin.toml").write_text(f'{pad}channels = ["displacement_x", "displacement_y"]\n[columns]\n{lines}')
        Path("t.csv").write_text(text)
        return read_recording("t.csv", mapping=read_columns("skin.toml"))

    return Remedy(
        words,
        lambda: made(wrong),
        lambda: made(mended),
        room=room,
        right=lambda got: bool(np.isclose(got.readings.ravel()[-1], last)),
    )


KEYS = 'frame = "frame"\nmarker = "id"\nx = "x"\ny = "y"\ndisplacement_x = "dx"\ndisplacement_y = "dy"\n'
ANEW = "frame,id,x,y\n" + "".join(f"{k},{3 * k + m},{10 * m},{k}\n" for k in range(12) for m in range(3))
KEPT = "frame,id,x,y\n" + "".join(f"{k},{m},{10 * m},{k}\n" for k in range(12) for m in range(3))
MOVING = "frame,id,x,y\n" + "".join(f"{k},{m},{10 * m + k},{0.5 * m}\n" for k in range(4) for m in range(3))
STEPS = "frame,id,x,y,dx,dy\n" + "".join(
    f"{k},{m},{10 * m + k},{m},{int(k > 0)},0\n" for k in range(4) for m in range(3)
)
AT = "frame,x,y,p\n0,0,0,1\n0,1,0,2\n0,0,1,3\n0,1.3,1,4\n"
EVEN = AT.replace("1.3", "1")
CROSSED = "frame,id,x,y\n" + "".join(
    f"{k},{m},{[10 * m, 90 - 10 * m][k]},{m % 2}\n" for k in range(2) for m in range(10)
)
STRAIGHT = "frame,id,x,y\n" + "".join(f"{k},{m},{10 * m + k},{m % 2}\n" for k in range(2) for m in range(10))
PLACES = "frame=frame,marker=id,x=x,y=y,position_unit=1mm"

REMEDIES = [
    section("{} must be text{}; got", KEYS.replace('"id"', "2") + 'pixel = "1 mm"', KEYS + 'pixel = "1 mm"'),
    table("is neither a channel nor a key of columns", LONG, MAP.replace("marker=", "number="), say=MAP, last=2e-3),
    section(
        "{} must be a number; got {}.",
        KEYS + 'pixel = "1 mm"\nrate = "30"',
        KEYS + 'pixel = "1 mm"\nrate = 30',
        room="recordings.columns",
    ),
    section(
        "must be one quantity or {}; got",
        KEYS + 'unit = ["1 mm", "1 mm", "1 mm"]\nposition_unit = "1 mm"',
        KEYS + 'unit = "1 mm"\nposition_unit = "1 mm"',
    ),
    table("must not be 0; got", LONG, NAMED + ",pixel=0mm", say=MAP, last=2e-3),
    Remedy(
        ": no such channel; channels are",
        lambda: TableMapping(channels={"stress": "S{}"}),
        lambda: TableMapping(channels={"stress_zz": "S{}"}),
    ),
    table("name both, or x alone on a line", LONG, MAP.replace("x=x,", ""), say=MAP, last=2e-3),
    table("no column of readings is named", LONG, "frame=frame,marker=id,pixel=1mm", say=MAP, last=2e-3),
    Remedy(
        "shape belongs to taxels that stay",
        lambda: TableMapping(x="x", y="y", frame="frame", marker="id", shape=(1, 3)),
        lambda: TableMapping(x="x", y="y", frame="frame", marker="id"),
    ),
    table("these columns are listed, one line per frame", WIDE, f"marker=t,{TAXELS}", say=TAXELS, last=100.0),
    table(
        "{} must be a positive number; got", LONG, MAP + ",rate=-30", say=MAP + ",rate=30", room="recordings.columns"
    ),
    table("rate and time both say when frames were", WIDE, f"{TAXELS},rate=30", say=TAXELS, last=100.0),
    table(
        "reference must be a number of frames of at least 1; got",
        KEPT,
        f"{PLACES},reference=-1",
        say=f"{PLACES},reference=1",
        last=0.011,
        room="recordings.columns",
    ),
    table("here columns hold the readings: leave it out", LONG, MAP + ",reference=2", say=MAP, last=2e-3),
    Remedy(
        "{} must be one number or {}, finite and not 0",
        lambda: TableMapping(channels={"stress_zz": "S{}"}, scale=(1.0, 2.0)),
        lambda: TableMapping(channels={"stress_zz": "S{}"}, scale=1.0),
    ),
    table(
        "name one column and some several",
        WIDE.replace("\n", ",q\n", 1).replace(",2\n", ",2,0\n").replace(",4\n", ",4,0\n"),
        "time=t,stress_zz=S{},stress_xz=q,unit=25Pa",
        say=TAXELS,
        last=100.0,
    ),
    table("leave out unit and position_unit", LONG, MAP + ",unit=1mm", say=MAP, last=2e-3),
    table(
        "pixel is for displacement_x and displacement_y",
        EVEN,
        "frame=frame,x=x,y=y,stress_zz=p,pixel=1mm",
        say="frame=frame,x=x,y=y,stress_zz=p,position_unit=1mm,unit=25Pa",
        last=100.0,
    ),
    table("unit is for readings; this table holds positions", KEPT, PLACES + ",unit=1mm", say=PLACES, last=0.011),
    table("--map must be like", LONG, "frame,id,x,y,dx,dy", say=MAP, last=2e-3),
    table("--map: shape must be rows x columns", WIDE, f"{TAXELS},shape=2", say=f"{TAXELS},shape=1x2", last=100.0),
    table("--map names {} twice", LONG, f"{MAP},x=x", say=MAP, last=2e-3),
    table("--map: {} must be a number", LONG, f"{MAP},rate=fast", say=f"{MAP},rate=30", last=2e-3),
    # lines and numbers
    table("no lines of numbers; a table has", "# markers\n", MAP, new=LONG, last=2e-3),
    table("no lines of numbers follow the titles", "frame,id,x,y,dx,dy\n", MAP, new=LONG, last=2e-3),
    table(": no column {}; it has", LONG, MAP.replace("=id", "=nr"), say=MAP, last=2e-3),
    table(
        "is there {} times; name each column once in its first line",
        "t,S1,S1\n0,1,2\n1,3,4\n",
        "time=t,stress_zz=S1,unit=25Pa",
        new=WIDE,
        say=TAXELS,
        last=100.0,
        room="recordings.tabletext",
    ),
    table("no column is like", WIDE, TAXELS.replace("S{}", "taxel{}"), say=TAXELS, last=100.0),
    table("{} cells for {} columns", "t,S1\n0,5,2,5\n", TAXELS, new="t,S1\n0.5,2.5\n", last=62.5),
    table("where {} separate them", "t,S1,S2\n0,1\n", TAXELS, new=WIDE, last=100.0),
    table("Take the line out if it is no reading", WIDE + "the end\n", TAXELS, new=WIDE, last=100.0),
    table("has a comma and {} in line", "t;S1\n0;1,5\n1;2.5\n", TAXELS, new="t;S1\n0;1.5\n1;2.5\n", last=62.5),
    table("has a comma and a point", "t;S1\n0;2.500,5\n", TAXELS, new="t;S1\n0;2500.5\n", last=62512.5),
    table("may be a decimal or a thousand and more", "t;S1\n0;1,234\n", TAXELS, new="t;S1\n0;1.234\n", last=30.85),
    table(
        "the column {} is there twice",
        "t,S1,S1\n0,1,2\n1,3,4\n",
        TAXELS,
        new=WIDE,
        last=100.0,
        room="recordings.tabletext",
    ),
    table("holds NUL characters", WIDE.encode() + 2000 * b"2,0,3\n" + b"\0", TAXELS, new=WIDE, last=100.0),
    table("{}: {} is not a number.", WIDE + "2,high,3\n", TAXELS, new=WIDE + "2,5,3\n", last=75.0),
    table("is larger than numbers can be", WIDE + "2,1e999,3\n", TAXELS, new=WIDE + "2,1,3\n", last=75.0),
    table(
        "save it as CSV in UTF-8",
        "t,Sé1\n0,4\n".encode("latin-1"),
        "time=t,stress_zz=Sé{},unit=25Pa",
        new="t,Sé1\n0,4\n",
        last=100.0,
    ),
    # markers and frames
    table("then name x and y alone", STEPS, MAP, say=PLACES, last=0.0),
    table(
        "{}, line {}: {} must be a whole number; got {}.{}",
        LONG.replace("\n1,", "\n0.5,"),
        MAP,
        say=MAP.replace("frame=", "time="),
        last=2e-3,
    ),
    table("so that a marker keeps its number, and save the table again", ANEW, PLACES, new=KEPT, last=0.011),
    table("is twice in frame", LONG + "1,3,0,10,0,2\n", MAP, new=LONG, last=2e-3),
    table("no position; take the line out", LONG + "1,4,,10,0,2\n", MAP.replace("marker=id,", ""), new=LONG, last=2e-3),
    table("Name the column of their numbers as marker", MOVING, PLACES.replace("marker=id,", ""), say=PLACES, last=0.0),
    table("these are several frames. Name it: frame=", LONG, MAP.replace("frame=frame,", ""), say=MAP, last=2e-3),
    table(
        "Leave out time and give rate",
        "frame,t,id,p\n0,0,1,1\n0,9,2,1\n1,10,1,4\n1,19,2,4\n",
        "frame=frame,time=t,marker=id,stress_zz=p,unit=25Pa",
        say="frame=frame,marker=id,stress_zz=p,unit=25Pa,rate=1",
        last=100.0,
    ),
    # times
    table(
        "so that the times of its frames are unknown",
        "t,S1\n0,1\n0,4\n",
        TAXELS,
        say="stress_zz=S{},unit=25Pa,rate=50",
        last=100.0,
    ),
    table(
        "so that its frames are not in the order of time",
        "t,S1\n3,4\n2,3\n1,2\n0,1\n",
        TAXELS,
        say=TAXELS + ",sort=true",
        last=100.0,
    ),
    table("sort must be true or false", WIDE, f"{TAXELS},sort=yes", say=f"{TAXELS},sort=true", last=100.0),
    table(
        "name the column time or frame too",
        WIDE,
        "stress_zz=S{},unit=25Pa,sort=true",
        say=f"{TAXELS},sort=true",
        last=100.0,
    ),
    table("are dates or times of day: leave out time_unit", DATED, TAXELS + ",time_unit=ms", say=TAXELS, last=100.0),
    table("and some are numbers; write all in one way", DATED + "5,4\n", TAXELS, new=DATED, last=100.0),
    table("stands among", DATED + "12:06:36,4\n", TAXELS, new=DATED + "2017-07-30 12:06:36,4\n", last=100.0),
    table("is no date or time", DATED + "2017-07-32,4\n", TAXELS, new=DATED, last=100.0),
    table("the month or the day first", "t,S1\n1/2/2017,1\n2/2/2017,4\n", TAXELS, new=DATED, last=100.0),
    table(
        "save the column with hours, minutes and seconds",
        "t,S1\n12:06,1\n12:07,4\n",
        TAXELS,
        new="t,S1\n12:06:00,1\n12:07:00,4\n",
        last=100.0,
    ),
    table(
        "no marker has a",
        LONG.replace("0,2\n", ",\n").replace(",0,0\n", ",,\n").replace(",1,0\n", ",,\n"),
        MAP,
        new=LONG,
        last=2e-3,
    ),
    table(
        "in one frame, take one of them out",
        LONG.replace("1,3,0,10", "1,3,0,0").replace("0,3,0,10", "0,3,0,0"),
        MAP,
        new=LONG,
        last=2e-3,
    ),
    table("have passed their neighbours", CROSSED, PLACES, new=STRAIGHT, last=0.0),
    table(
        "is missing between {} and",
        "frame,id,p\n0,1,1\n0,3,4\n",
        "frame=frame,marker=id,stress_zz=p,unit=25Pa",
        new="frame,id,p\n0,1,1\n0,2,\n0,3,4\n",
        last=100.0,
    ),
    table(": correct shape in the skin.toml", WIDE, TAXELS, last=100.0, shapes=((2, 2), (1, 2))),
    table(
        "taxels of an area need x and y",
        EVEN,
        "x=x,stress_zz=p,unit=25Pa,position_unit=1mm".replace("x=x", "frame=frame,x=p"),
        say="frame=frame,x=x,y=y,stress_zz=p,unit=25Pa,position_unit=1mm",
        last=100.0,
        shapes=((2, 2), (2, 2)),
    ),
    table(
        "the places of the taxels are no grid",
        AT,
        "frame=frame,x=x,y=y,stress_zz=p,unit=25Pa,position_unit=1mm",
        last=100.0,
        shapes=((2, 2), None),
    ),
    table(
        "have several units in their titles",
        "t,S1 (Pa),S2 (kPa)\n0,1,4\n",
        "time=t,stress_zz=S{}",
        new="t,S1 (Pa),S2 (Pa)\n0,1,4000\n",
        last=4000.0,
    ),
    table(
        "lines have no time; take them out",
        "t,id,p\n0,1,4\n,1,5\n",
        "time=t,marker=id,stress_zz=p,unit=25Pa",
        new="t,id,p\n0,1,4\n",
        last=100.0,
    ),
    table(
        "name marker (its number), or x and y",
        LONG,
        "frame=frame,displacement_x=dx,displacement_y=dy,unit=1mm",
        say=MAP,
        last=2e-3,
    ),
    table(
        "A table of several frames needs the name of its frame column (frame or time",
        "nr,id,p\n0,1,1\n1,1,4\n",
        "marker=id,stress_zz=p,unit=25Pa",
        say="frame=nr,marker=id,stress_zz=p,unit=25Pa",
        last=100.0,
    ),
    table(
        "do not belong to the same taxels",
        "t,S1,S2,Q1\n0,1,2,4\n",
        "time=t,stress_zz=S{},stress_xz=Q{},unit=25Pa",
        say=TAXELS,
        last=50.0,
    ),
    table("leave out the one that is wrong", "t,S1 (kPa)\n0,4\n", TAXELS, say="time=t,stress_zz=S{}", last=4000.0),
    table("no unit says what a 1 in the column", WIDE, "time=t,stress_zz=S{}", say=TAXELS, last=100.0),
]
