"""Dots and particles of real pictures, against what their authors' programs said of them, with judges that use neither.

Dots (FOTS, two pictures of a gel with markers): how far each dot that is found is from the authors' table, whose decimals are cut off, and how far both are from the circle
through the dot's own rim. Particles (the public PIV uncertainty test set): differences from another program's displacements in units of both standard
deviations; and each program's own repeatability, from fourth differences of vectors next to each other, whose windows do not overlap.

    python benchmarks/real_pictures.py FOLDER                # holds fots/ and pivuq/
    python benchmarks/real_pictures.py FOLDER --markdown docs/_generated/real_pictures.md
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import scipy.ndimage

from palpate.camera import find_dots, open_pictures
from palpate.microscopy import bead_displacements, read_field, read_picture

#: A dot is whole where so much of its rim is to be seen.
WHOLE = 0.85


def rim(flat: np.ndarray, at: np.ndarray, reach: int = 13) -> np.ndarray:
    """Pixels (k, 2) of the edge of the dark blob at a place, where light is halfway between ink and gel."""
    column, row = np.rint(at).astype(int)
    top, left = max(row - reach, 0), max(column - reach, 0)
    part = flat[top : row + reach + 1, left : column + reach + 1]
    dark = (part < 0.5 * (np.median(part) + np.percentile(part, 3))).astype(np.uint8)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(dark)
    large = [i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] > 20]
    blob = min(large, key=lambda i: float(np.hypot(*(middles[i] + [left, top] - at))))
    edges, _ = cv2.findContours((labels == blob).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = max(edges, key=len)[:, 0, :] + np.array([left, top], dtype=float)
    inside = (found > 0).all(axis=1) & (found < np.array(flat.shape[::-1]) - 1).all(axis=1)
    return found[inside]


def circle(points: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
    """Middle of the circle of this radius that most of the rim lies on, and that part of the rim: what is bitten out of a dot does not pull it."""
    best, most = points.mean(axis=0), -1
    for a, b in itertools.combinations(points, 2):
        apart = b - a
        length = float(np.hypot(*apart))
        if not 0.7 * radius < length < 2 * radius:
            continue
        up = np.sqrt(radius**2 - length**2 / 4) * np.array([-apart[1], apart[0]]) / length
        for middle in (0.5 * (a + b) + up, 0.5 * (a + b) - up):
            count = int((np.abs(np.hypot(*(points - middle).T) - radius) < 0.7).sum())
            if count > most:
                best, most = middle, count
    for _ in range(10):
        arm = points - best
        far = np.hypot(*arm.T)
        on = np.abs(far - radius) < 0.8
        best = best - np.linalg.lstsq(-arm[on] / far[on, None], (far - radius)[on], rcond=None)[0]
    return best, float(on.mean())


def dots(folder: Path) -> Iterator[str]:
    yield (
        "| picture | dots of the table, found, invented | within 1.5 px of the table | the same, allowing for truncated decimals | whole dots: from their rim, median, largest | "
        "the table from the rim, median | all dots within 1.5 px of their rim's middle: found, table |"
    )
    yield "|---" * 7 + "|"
    apart = []
    for number in (0, 1):
        (picture,) = open_pictures(folder / f"{number}.png")
        assert picture.image is not None
        table = np.loadtxt(folder / f"{number}.csv", delimiter=",", skiprows=1)
        now = table[:, :2] + table[:, 2:]
        inside = now[:, 0] < 310  # the last column of dots is cut by the picture's edge
        table, now = table[inside], now[inside]
        found = find_dots(picture.image).positions
        which = np.hypot(*(now[:, None] - found[None]).transpose(2, 0, 1)).argmin(axis=1)
        known = len(np.unique(which))
        found, invented = found[which], len(found) - known
        raw = np.hypot(*(found - now).T)
        # Mx, My lost up to a pixel downwards, dx, dy up to one towards zero
        least = table[:, :2] + np.where(table[:, 2:] > 0, table[:, 2:], table[:, 2:] - 1)
        largest = table[:, :2] + 1 + np.where(table[:, 2:] < 0, table[:, 2:], table[:, 2:] + 1)
        cut = np.hypot(*(found - np.clip(found, least, largest)).T)
        flat = cv2.cvtColor(picture.image, cv2.COLOR_RGB2GRAY)
        rims = [rim(flat, at) for at in found]
        radius = float(np.median([np.hypot(*(points - points.mean(axis=0)).T).mean() for points in rims]))
        fitted = [circle(points, radius) for points in rims]
        middles, seen = np.array([m for m, _ in fitted]), np.array([s for _, s in fitted])
        mine = np.hypot(*(found - middles).T)
        theirs = np.hypot(*(now + np.median(middles - now, axis=0) - middles).T)  # its common offset is taken out
        whole = seen > WHOLE
        yield (
            f"| {number}.png | {len(now)}, {known}, {invented} | {(raw < 1.5).sum()} | {(cut < 1.5).sum()} | {whole.sum()}: {np.median(mine[whole]):.2f}, "
            f"{mine[whole].max():.2f} px | {np.median(theirs[whole]):.2f} px | {(mine < 1.5).sum()}, {(theirs < 1.5).sum()} |"
        )
        for i in np.flatnonzero((cut > 1.5) | (mine > 1.5)):
            apart.append(
                f"| {number}.png | {table[i, 0]:.0f}, {table[i, 1]:.0f} | {100 * seen[i]:.0f} % | {cut[i]:.1f} | {mine[i]:.1f} | {theirs[i]:.1f} |"
            )
    yield from (
        "",
        "Dots farther than 1.5 px from the table, allowing for truncated decimals, or from the middle of their rim:",
        "",
    )
    yield "| picture | Mx, My | visible part of the rim | found from the table [px] | found from the rim's middle [px] | table from the rim's middle [px] |"
    yield "|---" * 6 + "|"
    yield from apart


def particles(folder: Path) -> Iterator[str]:
    theirs = read_field(folder / "B00010_UQ.dat", pixel=1.0)
    pair = [read_picture(folder / name) for name in ("B00010.tif", "B00011.tif")]
    assert theirs.std is not None
    yield "| windows [px] | | places | difference, median | stated std of palpate, median | stated std of the other program, median | within 1 std of both | within 1.96 | within 3 |"
    yield "|---" * 9 + "|"
    for window in (16, 24, 32):
        mine = bead_displacements(*pair, pixel=1.0, window=window, step=8, drift=False)
        assert mine.std is not None
        # its vectors stand for 4 x 4 pixels, the first for 0 to 3: what it calls 1 is 1.5
        at = np.meshgrid(
            *(
                (start + mine.step * np.arange(n) - first - 0.5) / theirs.step
                for start, n, first in zip(mine.start[::-1], mine.shape, theirs.start[::-1])
            ),
            indexing="ij",
        )
        for i, name in enumerate("uv"):
            there, std = (
                scipy.ndimage.map_coordinates(c[i], at, order=1, cval=np.nan) for c in (theirs.displacement, theirs.std)
            )
            difference = mine.displacement[i] - (1, -1)[i] * there  # its v grows upwards, its y downwards
            both = np.hypot(mine.std[i], std)
            good = np.isfinite(difference) & np.isfinite(both)
            z = np.abs(difference[good] / both[good])
            yield (
                f"| {window} | {name} | {good.sum()} | {np.median(np.abs(difference[good])):.3f} | {np.median(mine.std[i][good]):.3f} | {np.median(std[good]):.3f} | "
                + " | ".join(f"{100 * np.mean(z < k):.1f} %" for k in (1.0, 1.96, 3.0))
                + " |"
            )
    yield from (
        "",
        "Fourth differences of adjacent vectors, in units of their stated standard deviation (68, 95 and 99.7 % would be right):",
        "",
    )
    yield "| vectors | | along | differences | within 1 std | within 1.96 | within 3 |"
    yield "|---" * 7 + "|"
    own = bead_displacements(*pair, pixel=1.0, window=16, step=16, drift=False)
    for label, field, every in (
        ("here, windows of 16 px every 16 px", own, 1),
        ("the other program's, every 16 px", theirs, 4),
    ):
        assert field.std is not None
        for i, name in enumerate("uv"):
            for axis in (1, 0):
                u, s = (np.moveaxis(c[i][::every, ::every], axis, 0) for c in (field.displacement, field.std))
                weights = (1.0, -4.0, 6.0, -4.0, 1.0)
                count = len(u) - 4
                bend = sum(w * u[k : k + count] for k, w in enumerate(weights))
                std = np.sqrt(sum((w * s[k : k + count]) ** 2 for k, w in enumerate(weights)))
                good = np.isfinite(bend) & (std > 0)
                z = np.abs(bend[good] / std[good])
                yield (
                    f"| {label} | {name} | {'yx'[axis]} | {good.sum()} | "
                    + " | ".join(f"{100 * np.mean(z < k):.0f} %" for k in (1.0, 1.96, 3.0))
                    + " |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds fots/ and pivuq/")
    parser.add_argument("--markdown", type=Path)
    args = parser.parse_args()
    lines = ["# Real pictures", "", "Made by `python benchmarks/real_pictures.py FOLDER`."]
    for title, made in (
        ("Dots", dots(args.folder / "fots")),
        ("Particles", particles(args.folder / "pivuq")),
    ):
        lines += ["", f"## {title}", ""]
        for line in made:
            print(line, flush=True)
            lines.append(line)
    if args.markdown is not None:
        args.markdown.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
