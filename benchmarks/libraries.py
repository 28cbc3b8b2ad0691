"""What a library would do in the place of code of our own, on our cases.

    python benchmarks/libraries.py [--write]

Needs clarabel, pandas, polars, imagecodecs, pymatreader and joblib, one thread (OMP_NUM_THREADS=1). ``--write`` writes docs/_generated/libraries.md,
which `docs/decisions/030-dependencies.md` quotes. Each table says how many cases each reads right, and the time of the same work.
"""

from __future__ import annotations

import argparse
import io
import os
import signal
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

TABLE = Path(__file__).resolve().parents[1] / "docs" / "_generated" / "libraries.md"
SEED = 30_112
HEAD = "# Libraries and our own code\n\nMade by `python benchmarks/libraries.py --write`, one thread.\n\n"
FRICTION = 0.5


def best(work: Callable[[], Any], times: int = 5) -> float:
    """Shortest time of several [s]."""
    out = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        out.append(time.perf_counter() - start)
    return min(out)


# -- quadratic programs ----------------------------------------------------------------------------------------------------


def conic(hessian: Any, linear: Any, friction: float) -> Any:
    """minimise 1/2 x'Hx - h'x with |q| <= friction p in every cell, by Clarabel."""
    import clarabel
    from scipy import sparse

    components, n = linear.shape
    order = np.arange(components * n).reshape(components, n)[[components - 1, *range(components - 1)]].T.ravel()
    rows = -sparse.diags(np.tile([friction, *[1.0] * (components - 1)], n)).tocsc()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        sparse.triu(sparse.csc_matrix(hessian[np.ix_(order, order)])).tocsc(),
        -linear.ravel()[order],
        rows,
        np.zeros(rows.shape[0]),
        [clarabel.SecondOrderConeT(components)] * n,
        settings,
    )
    found = np.empty(components * n)
    found[order] = np.array(solver.solve().x)
    return found.reshape(components, n)


def programs() -> list[str]:
    """Times of the constrained problem of one frame, three ways."""
    import palpate as pp
    from palpate.inverse import Cone, minimise
    from palpate.inverse.constrained.interior import interior
    from palpate.inverse.constrained.quadratic import Formed

    rows = [
        "| taxels | cells | Newton's method | interior points | Clarabel | largest difference |",
        "|---|---|---|---|---|---|",
    ]
    for side in (4, 6, 8, 10):
        array = pp.AreaArray(
            shape=(side, side), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=20.0
        )
        skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
        n = int(np.prod(skin.surface.shape))
        matrix = skin.operator.columns([0, 1, 2], np.arange(n)).reshape(-1, 3 * n)
        ball = pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0).sliding(0.3)
        data = skin.sense(ball, rng=np.random.default_rng(SEED)).ravel()
        noise = 20.0
        weight = 1e-5 * np.eye(3 * n)  # of a prior with 300 Pa in each cell
        hessian = matrix.T @ matrix / noise**2 + weight
        linear = (matrix.T @ data / noise**2).reshape(3, n)
        cone = Cone(("x", "y", "z"), FRICTION)
        answer = minimise(hessian, linear, cone).traction
        scales = cone.scales
        scaled = Formed(hessian).scaled(scales)

        def inner(scaled: Any = scaled, linear: Any = linear, scales: Any = scales, cone: Any = cone) -> Any:
            return interior(scaled, linear * scales[:, None], cone, np.zeros_like(linear))[0] * scales[:, None]

        other = conic(hessian, linear, FRICTION)
        scale = float(np.abs(answer).max())
        apart = max(float(np.abs(answer - one).max()) for one in (other, inner())) / scale
        times = [
            best(lambda h=hessian, b=linear, c=cone: minimise(h, b, c)),
            best(inner),
            best(lambda h=hessian, b=linear: conic(h, b, FRICTION), 2),
        ]
        rows.append(
            f"| {side} x {side} x 3 | {n} | " + " | ".join(f"{1e3 * t:.1f} ms" for t in times) + f" | {apart:.0e} |"
        )
    return rows


# -- tables ----------------------------------------------------------------------------------------------------------------

#: Name, text, and the columns it holds; None: numbers that may be meant in two ways or are cut off, which a reader must say.
TABLES: dict[str, tuple[str, dict[str, list[float]] | None]] = {
    "commas": ("t,a,b\n0,1.5,2\n1,2.5,3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "semicolons, decimal commas": ("t;a;b\n0;1,5;2\n1;2,5;3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "tabs, decimal commas": ("t\ta\tb\n0\t1,5\t2\n1\t2,5\t3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "blanks": ("t a b\n0 1.5 2\n1 2.5 3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "several blanks": ("  t    a   b\n  0  1.5   2\n  1  2.5   3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "titles in a comment": ("# made today\n# t,a,b\n0,1.5,2\n1,2.5,3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "text above the titles": ("Sensor 7\nRate, 100 Hz\n\nt,a,b\n0,1.5,2\n1,2.5,3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "units below the titles": ("t,a,b\ns,V,V\n0,1.5,2\n1,2.5,3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "an index without a title": (",a,b\n0,1.5,2\n1,2.5,3\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "a separator at the end": ("t,a,b,\n0,1.5,2,\n1,2.5,3,\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "Windows' ends, UTF-16": ("t,a,b\r\n0,1.5,2\r\n1,2.5,3\r\n", {"a": [1.5, 2.5], "b": [2, 3]}),
    "missing values": ("t,a,b\n0,nan,2\n1,,3\n", {"a": [np.nan, np.nan], "b": [2, 3]}),
    "1,234: in two ways": ("t;a;b\n0;1,234;2\n1;2,500;3\n", None),
    "a word among numbers": ("t,a,b\n0,1.5,2\n1,bad,3\n2,2,4\n", None),
    "a row too short": ("t,a,b\n0,1.5,2\n1,2.5\n2,2,4\n", None),
    "the last line cut off": ("t,a,b\n0,1.5,2\n1,2.5,30\n2,3.5,4", {"a": [1.5, 2.5], "b": [2, 30]}),
}


def readers() -> dict[str, Callable[[Path], dict[str, Any]]]:
    """Ways to read a table whose layout nobody tells: columns by name."""
    import pandas
    import polars

    from palpate.recordings.tabletext import read_table_text

    def own(path: Path) -> dict[str, Any]:
        table = read_table_text(path, lambda titles: [titles.names.index("a"), titles.names.index("b")])
        return {"a": table.values[:, 0], "b": table.values[:, 1]}

    def by_pandas(path: Path) -> dict[str, Any]:
        frame = pandas.read_csv(path, sep=None, engine="python", comment="#", skipinitialspace=True)
        return {name: np.asarray(frame[name], dtype=float) for name in ("a", "b")}

    def by_polars(path: Path) -> dict[str, Any]:
        frame = polars.read_csv(path, comment_prefix="#")
        return {name: np.asarray(frame[name], dtype=float) for name in ("a", "b")}

    return {"palpate": own, "pandas": by_pandas, "polars": by_polars}


def mark(read: Callable[[Path], dict[str, Any]], path: Path, truth: dict[str, list[float]] | None) -> str:
    """ "right": the columns that were written, or without a truth, a word about it; "refused": an error; "wrong": other numbers without a word."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            found = read(path)
        except Exception:
            return "right" if truth is None else "refused"
    good = (
        bool(said)
        if truth is None
        else all(np.array_equal(np.asarray(found[n])[: len(v)], v, equal_nan=True) for n, v in truth.items())
    )
    return "right" if good else "wrong"


def tables(folder: Path) -> list[str]:
    """Tables read right, and the time of a long one."""
    each = readers()
    rows = ["| table | " + " | ".join(each) + " |", "|---|" + "---|" * len(each)]
    count = dict.fromkeys(each, 0)
    for i, (name, (text, truth)) in enumerate(TABLES.items()):
        path = folder / f"table{i}.csv"
        path.write_bytes(text.encode("utf-16" if "UTF-16" in name else "utf-8"))
        marks = {reader: mark(read, path, truth) for reader, read in each.items()}
        for reader, good in marks.items():
            count[reader] += good == "right"
        rows.append(f"| {name} | " + " | ".join(marks.values()) + " |")
    rows.append("| **right** | " + " | ".join(f"**{n} of {len(TABLES)}**" for n in count.values()) + " |")
    long = folder / "long.csv"
    values = np.random.default_rng(SEED).standard_normal((20_000, 50))
    np.savetxt(long, values, delimiter=",", header=",".join(["a", "b", *map(str, range(48))]), comments="", fmt="%.7g")
    import pandas

    each["pandas"] = lambda path: dict(pandas.read_csv(path))
    rows.append(
        "| 20,000 lines of 50 numbers | "
        + " | ".join(f"{best(lambda r=r: r(long), 3):.2f} s" for r in each.values())
        + " |"
    )
    return rows


# -- packed pictures -------------------------------------------------------------------------------------------------------


def pictures(folder: Path) -> list[str]:
    """Packed TIFF: ways of packing that are read, and damage that is noticed."""
    import tifffile

    from palpate.microscopy.pictures import read_all

    def library(path: Path) -> list[Any]:
        with tifffile.TiffFile(path) as file:
            return [page.asarray() for page in file.pages]

    rng = np.random.default_rng(SEED)
    image = (rng.poisson(40, (96, 128)) * 50).astype(np.uint16)
    image[30:50] = 7
    rows = [
        "| compression | palpate reads it | tifffile with imagecodecs | damaged files detected: palpate | imagecodecs |",
        "|---|---|---|---|---|",
    ]
    for kind in ("lzw", "zlib", "packbits", "zstd", "lzma"):
        path = folder / f"{kind}.tif"
        tifffile.imwrite(path, image, compression=kind)
        whole = path.read_bytes()
        with tifffile.TiffFile(path) as file:
            page = file.pages[0]
            start, end = page.dataoffsets[0], page.dataoffsets[-1] + page.databytecounts[-1]
        cells = []
        for read in (read_all, library):
            try:
                cells.append("yes" if np.array_equal(read(path)[0], image) else "wrong")
            except Exception:
                cells.append("no")
        noticed, tried = [0, 0], 0
        for _ in range(30):
            at = int(rng.integers(start, end))
            spoiled = bytearray(whole)
            length = int(rng.integers(20, 400))
            spoiled[at : min(at + length, end)] = bytes(min(at + length, end) - at)
            bad = folder / "bad.tif"
            bad.write_bytes(spoiled)
            tried += 1
            for i, read in enumerate((read_all, library)):
                try:
                    read(bad)
                except Exception:
                    noticed[i] += 1
        cells += [f"{n} of {tried}" for n in noticed]
        if cells[0] == "no":
            cells[2] = ""
        rows.append(f"| {kind} | " + " | ".join(cells) + " |")
    return rows


# -- files of Matlab, pools ------------------------------------------------------------------------------------------------


def matlab(folder: Path) -> list[str]:
    """A displacement field of a Matlab program: what each hands over."""
    import pymatreader
    from scipy.io import savemat

    from palpate.microscopy.matfile import fields_of

    path = folder / "field.mat"
    place, vector = np.arange(40.0).reshape(20, 2), np.ones((20, 2))
    savemat(path, {"displacement": np.array([({"pos": place, "vec": vector}), ({"pos": place, "vec": 2 * vector})])})
    own, other = fields_of(path), pymatreader.read_mat(path)
    return [
        "| | palpate | pymatreader |",
        "|---|---|---|",
        f"| what a struct array of two frames becomes | {', '.join(own)} | {type(other['displacement']).__name__} of {len(other['displacement'])} |",
        f"| time | {1e3 * best(lambda: fields_of(path)):.1f} ms | {1e3 * best(lambda: pymatreader.read_mat(path)):.1f} ms |",
        "| positions and vectors found by what they hold, units, sizes checked before memory is taken | yes | no: only the tree |",
    ]


def _killed(number: int, flag: str) -> int:
    if number == 3 and not os.path.exists(flag):
        Path(flag).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def pools(folder: Path) -> list[str]:
    """One of eight pieces loses its worker once."""
    import joblib

    flag = str(folder / "flag")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            done = joblib.Parallel(n_jobs=2)(joblib.delayed(_killed)(i, flag) for i in range(8))
            said = f"{len(done)} of 8 pieces"
        except Exception as error:
            said = f"ends with {type(error).__name__}"
    return [
        "| a worker killed once | |",
        "|---|---|",
        f"| joblib | {said} |",
        "| palpate | all pieces: the piece is given to another worker, three times at most (tests of archives) |",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    write = parser.parse_args().write
    out = io.StringIO()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, lines in (
            ("Quadratic programs", programs()),
            ("Tables", tables(folder)),
            ("Packed pictures", pictures(folder)),
            ("Files of Matlab", matlab(folder)),
            ("Pools", pools(folder)),
        ):
            print(f"## {title}\n", *lines, "", sep="\n", file=out)
    text = HEAD + out.getvalue().rstrip() + "\n"
    print(text)
    if write:
        TABLE.write_text(text)


if __name__ == "__main__":
    main()
