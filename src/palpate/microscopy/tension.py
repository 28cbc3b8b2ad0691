"""Estimate the tension in a monolayer from the traction of its cells: maps, and one number for each cell and border,
each with its error.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import scipy.ndimage
import scipy.sparse
import scipy.spatial

from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.cell import CellForces, Quantity
from palpate.microscopy.labels import read_labels
from palpate.microscopy.masks import inside_outline
from palpate.microscopy.sheet import Loads, Sheet, sheet_of
from palpate.microscopy.sheetmesh import Shape
from palpate.recordings.files import atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BorderTension", "RegionTension", "SheetTension", "sheet_tension"]

Flags = npt.NDArray[np.bool_]

#: Range of Poisson's ratio of the plane sheet (1: its area does not change), and the three Gauss points in that range,
#: with weights 5, 8 and 5.
RATIOS, GAUSS = (0.0, 1.0), (0.5 - 0.5 * math.sqrt(0.6), 0.5, 0.5 + 0.5 * math.sqrt(0.6))
CYCLE = (0, 1, 2, 1, 0, 1, 2, 1, 2)
#: Root mean square of the tension that cells generate themselves, relative to that of the sheet. Fitted to sheets 0 to
#: 9 of benchmarks/cells_sheet.py.
RELATIVE_TENSION = 1.0
#: Triangles are as wide as the distance of vectors, unless the sheet would then have more than MOST or fewer than
#: FEWEST squares.
MOST, FEWEST = 5000, 150
#: Traction up to OUTSIDE windows (or vectors) outside the mask is attributed to the sheet, because the window blurs it.
#: Squares with less than PART of their area in the sheet pass their traction to the nearest points of the sheet.
OUTSIDE, PART = 1.0, 0.3
#: Standard error of the outline of a sheet, as a fraction of the distance of vectors.
OUTLINE = 0.1
#: Parts of the sheet smaller than this fraction of the largest part are left out.
SMALL = 0.02
#: A note is given if the net force or torque exceeds UNBALANCED of the sum of its parts, and if a mask has fewer than
#: FEW vectors.
UNBALANCED, FEW = 0.05, 30


@dataclass(frozen=True, eq=False)
class RegionTension:
    """Mean tension over the area of one cell of a sheet.

    Attributes
    ----------
    label : str
    area : float
        [m^2].
    average, largest : Quantity
        Mean of both principal tensions, and the larger one [N/m].
    angle : float
        Angle of the larger principal tension, degrees from x towards y (down), 0 to 180.
    """

    label: str
    area: float
    average: Quantity
    largest: Quantity
    angle: float


@dataclass(frozen=True, eq=False)
class BorderTension:
    """The force between two neighbouring cells.

    Attributes
    ----------
    labels : (str, str)
    length : float
        From end to end of the border [m].
    force : (float, float)
        On the first by the second [N], along x and y.
    normal, shear : Quantity
        Tension across the border and along it [N/m]: the force over the length.
    """

    labels: tuple[str, str]
    length: float
    force: tuple[float, float]
    normal: Quantity
    shear: Quantity


@dataclass(frozen=True, eq=False)
class SheetTension:
    """Tension of a sheet of cells.

    Attributes
    ----------
    forces : CellForces
        The traction that it follows from.
    tension, std : array (3, row, column)
        xx, yy and xy [N/m], means over the squares of the field's vectors, and their standard deviations; NaN outside the sheet.
    draws : array (draw, 3, row, column)
        Samples.
    inside : array (row, column) of bool
    quantities : dict of str to Quantity
        average_tension and largest_tension of the sheet, area, and net_force_x, net_force_y, net_torque of its traction.
    cells : tuple of RegionTension
    borders : tuple of BorderTension
    notes : tuple of str

    Examples
    --------
    >>> sheet = sheet_tension(forces)  # doctest: +SKIP
    >>> sheet["average_tension"].interval  # doctest: +SKIP
    """

    forces: CellForces
    tension: Floats
    std: Floats
    draws: Floats
    inside: Flags
    quantities: dict[str, Quantity]
    cells: tuple[RegionTension, ...]
    borders: tuple[BorderTension, ...]
    notes: tuple[str, ...]
    labels: dict[str, Flags] | None = None

    def __getitem__(self, name: str) -> Quantity:
        if name not in self.quantities:
            raise InvalidInput(f"a sheet has no {name!r}; there are {', '.join(self.quantities)}.")
        return self.quantities[name]

    @property
    def average(self) -> Floats:
        """Mean of the two principal tensions (row, column) [N/m]."""
        return np.asarray(0.5 * (self.tension[0] + self.tension[1]))

    @property
    def largest(self) -> Floats:
        """The larger principal tension (row, column) [N/m]."""
        return _principal(self.tension)[0]

    def summary(self) -> str:
        """Return the numbers as text, one to a line."""
        return "\n".join(
            str(q) if q.std > 0 else f"{q.label}: {q.scaled()[0]} {q.scaled()[2]}" for q in self.quantities.values()
        )

    def plot(self, *, title: str | None = None) -> Figure:
        """Plot the average tension with the directions of the larger principal tension, and its standard deviation."""
        from palpate.microscopy.sheetfigure import plot_tension

        return plot_tension(self, title=title)

    def write_table(self, path: str | Path) -> None:
        """Write the numbers of the sheet, of each cell and of each border as CSV."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["of", "quantity", "value", "std", "low_95", "high_95", "unit"])

        def put(of: str, name: str, q: Quantity) -> None:
            low, high = q.interval
            writer.writerow([of, name, f"{q.value:.8g}", f"{q.std:.4g}", f"{low:.8g}", f"{high:.8g}", q.unit])

        for key, q in self.quantities.items():
            put("sheet", key, q)
        for cell in self.cells:
            put(cell.label, "area", Quantity("area", "m^2", cell.area, 0.0))
            put(cell.label, "average_tension", cell.average)
            put(cell.label, "largest_tension", cell.largest)
        for border in self.borders:
            of = "/".join(border.labels)
            put(of, "border_length", Quantity("length", "m", border.length, 0.0))
            put(of, "border_normal_tension", border.normal)
            put(of, "border_shear", border.shear)
        atomically(path, lambda at: _write(at, text.getvalue()))


def sheet_tension(
    forces: CellForces,
    *,
    labels: Any = None,
    size: tuple[int, int] | None = None,
    poissons_ratio: float | None = None,
    own: float = RELATIVE_TENSION,
    draws: int = 60,
    seed: int = 0,
) -> SheetTension:
    """Tension in a sheet of cells by monolayer stress microscopy.

    The sheet is where the mask of ``forces`` is (all of the field of view without one). Its ends are free. At the edge of the field of view it
    continues: the forces there are unknown except for the balance of forces, and enter the errors.

        div N = T,    N n = 0 at free edges,    N = C : strain (plane stress)

    with the tension N (stress times thickness) and the traction T on the gel (D. T. Tambe et al., Nat. Mater. 10, 2011, 469-475), by quadratic finite elements.

    Parameters
    ----------
    forces : CellForces
        With a traction that lies everywhere, ``method="tikhonov"`` suits sheets.
    labels : dict of masks, array or path, optional
        The cells (`read_labels`), for a mean of each, and the forces between neighbours.
    size : (int, int), optional
        Columns and rows of the picture of labels; default: the area of the field.
    poissons_ratio : float, optional
        Poisson's ratio of the sheet; default: random from 0 to 1, at which a sheet keeps its area.
    own : float
        Balanced tensions of the cells, which leave no traction, as a part of the sheet's; a uniform elastic sheet has none (0).
    draws : int
        Samples.
    seed : int

    Returns
    -------
    SheetTension

    Raises
    ------
    InvalidInput
        A sheet too small for its vectors, labels of another picture, a Poisson's ratio beyond 0 to 0.99.
    Unsupported
        scikit-fem is not installed.

    Examples
    --------
    A disc of radius R that pulls to its middle by k r has the mean tension k R^2/4, here 300 uN/m.

    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.microscopy import Field, cell_forces, sheet_tension
    >>> gel = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
    >>> beads = pp.AreaArray(shape=(20, 20), pitch=2e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    >>> skin = pp.Skin(gel, beads)
    >>> y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    >>> pull = np.stack([-x, -y, 0.0 * x]) * 100.0 / 12e-6 * (np.hypot(x, y) < 12e-6)  # [Pa]
    >>> u = np.asarray(skin.sense(pull))[:, ::-1] * np.array([1.0, -1.0])[:, None, None]  # rows count down, and so does y
    >>> u = u + 1e-9 * np.random.default_rng(0).standard_normal(u.shape)
    >>> field = Field(displacement=u, start=(10, 10), step=20.0, pixel=0.1e-6)
    >>> turn = np.linspace(0.0, 2.0 * np.pi, 40)
    >>> disc = np.stack([200.0 + 120.0 * np.cos(turn), 200.0 + 120.0 * np.sin(turn)], axis=1)  # pixels
    >>> sheet = sheet_tension(cell_forces(field, gel, mask=disc, method="tikhonov", draws=16), draws=16)
    >>> low, high = sheet["average_tension"].interval
    >>> bool(low < 300e-6 < high), sheet.average.shape
    (True, (20, 20))
    """
    if poissons_ratio is not None and not 0.0 <= poissons_ratio <= 0.99:
        raise InvalidInput(f"poissons_ratio of a sheet is from 0 to 0.99; got {poissons_ratio!r}.")
    if not 0.0 <= own <= 5.0:
        raise InvalidInput(f"own is a part of the sheet's tension, from 0 to 5; got {own!r}.")
    if draws < 8:
        raise InvalidInput(f"a sheet takes at least 8 draws; got {draws!r}.")
    field = forces.field
    rng = np.random.default_rng(seed)
    picks = np.linspace(0, len(forces.draws) - 1, draws).round().astype(int)
    tractions = np.concatenate([forces.traction[None], forces.draws[picks]])
    shapes, view = _shapes(forces), _view(forces)
    area = sum(float(s.mask.sum()) for s in shapes) * shapes[0].side ** 2
    spacing = float(np.clip(field.pitch, math.sqrt(area / MOST), math.sqrt(area / FEWEST)))
    masks = {} if labels is None else _labels(forces, labels, size)
    parts = [_part(forces, sheet_of(s, spacing, view), tractions, poissons_ratio, own, rng) for s in shapes]
    points = np.concatenate([p.sheet.elements.points for p in parts])
    weight = np.concatenate([p.sheet.elements.area for p in parts])
    # (1 + draw, 3, q): large, so one part is not copied
    tension = parts[0].tension if len(parts) == 1 else np.concatenate([p.tension for p in parts], axis=2)
    rows, columns = field.shape
    number = _square(field, points)
    area_in_square = np.bincount(number[number >= 0], weight[number >= 0], rows * columns)
    good = number >= 0
    # if triangles are wider than the squares, some squares contain no point: use the nearest
    empty = np.flatnonzero((area_in_square == 0) & forces.inside.ravel())
    places = np.stack(np.unravel_index(empty, field.shape)[::-1], axis=1) * field.pitch
    distance, nearest = scipy.spatial.cKDTree(points).query(places + field.pixel * np.array(field.start))
    reachable = distance < 2.0 * spacing
    mean = scipy.sparse.csr_array(
        (
            np.concatenate([weight[good] / area_in_square[number[good]], np.ones(int(reachable.sum()))]),
            (
                np.concatenate([number[good], empty[reachable]]),
                np.concatenate([np.flatnonzero(good), nearest[reachable]]),
            ),
        ),
        shape=(rows * columns, len(points)),
    )
    area_in_square[empty[reachable]] = 1.0
    inside = (area_in_square > 0).reshape(rows, columns)
    maps = np.stack([(mean @ t.T).T for t in tension]).reshape(len(tension), 3, rows, columns)
    maps[:, :, ~inside] = np.nan
    # add the error of the outline: forces at the edge of the sheet have the longest lever
    border = sum(float(p.sheet.elements.border(_everywhere)[2].sum()) for p in parts)
    common = math.hypot(forces.touch._scale_std, OUTLINE * field.pitch * border / float(weight.sum()))
    average = 0.5 * (tension[:, 0] + tension[:, 1]) @ weight / weight.sum()
    numbers = {
        "average_tension": _quantity("average tension of the sheet", average, common, "mean of both principal tensions over the sheet"),
        "largest_tension": _quantity("largest tension", np.nanmax(_principal(maps)[0], axis=(1, 2)), common, "largest principal tension, of means over the vectors' squares", extreme=True),
    }  # fmt: skip
    missing = np.sum([p.missing for p in parts], axis=0)
    for name, unit, values in (("net_force_x", "N", missing[:, 0]), ("net_force_y", "N", missing[:, 1]), ("net_torque", "N m", missing[:, 2])):  # fmt: skip
        std = math.hypot(float(values[1:].std(ddof=1)), common * float(values[0]))
        numbers[name] = Quantity(name.replace("_", " ") + " of the traction", unit, float(values[0]), std)
    numbers["area"] = Quantity("area of the sheet", "m^2", float(weight.sum()), 0.0)
    std = np.hypot(maps[1:].std(axis=0, ddof=1), common * maps[0])
    cells, borders = _cells(masks, field, points, weight, tension, common)
    notes = _notes(parts, forces, own, poissons_ratio)
    if numbers["average_tension"].interval[1] < 0:
        pressed = "the sheet is pressed as a whole, as hardly any is: are the pictures in order (at rest first, pulled second), or do the displacements have the opposite sign?"
        notes = (pressed, *notes)
    return SheetTension(forces, maps[0], std, maps[1:], inside, numbers, cells, borders, notes, masks or None)


def _everywhere(x: Floats) -> Flags:
    return np.ones(x.shape[1], dtype=bool)


@dataclass(eq=False)
class _Part:
    """One connected part of the sheet: tension (1 + draw, 3, q) of the estimate and of each draw, and the net forces
    and torque of its traction (1 + draw, 3).
    """

    sheet: Sheet
    tension: Floats
    missing: Floats
    gross: float


def _part(
    forces: CellForces, sheet: Sheet, tractions: Floats, ratio: float | None, own: float, rng: np.random.Generator
) -> _Part:
    spread = _spread(forces, sheet)
    e = sheet.elements
    open_ = len(sheet.edge[0]) > 0
    ratios = [RATIOS[0] + (RATIOS[1] - RATIOS[0]) * g for g in GAUSS] if ratio is None else [ratio]
    middle = ratios[len(ratios) // 2]

    def at_points(nodes: Floats) -> Floats:
        return np.stack([e.straight @ n for n in nodes])

    flat = tractions.reshape(len(tractions), 2, -1)
    tensions, missing = [], []
    loads = Loads(sheet, 1.0, rng)
    first = np.stack([spread @ c for c in flat[0]])
    closed = at_points(sheet.tension(sheet.body(sheet.balance(first)[0]), middle))
    scale = math.sqrt(float(((0.5 * (closed[0] + closed[1])) ** 2) @ e.area / e.area.sum()))
    gross = float(np.hypot(*first) @ e.area)
    if open_:
        loads = Loads(sheet, max(scale, 1e-300), rng)
    else:
        loads.scale = scale
    finest = 2.0 * forces.field.pitch
    for k, values in enumerate(flat):
        t = np.stack([spread @ c for c in values])
        body = sheet.body(t)
        net = sheet.resultant(body)
        missing.append(-net)  # of the traction on the gel
        if open_:
            body = body + loads.edge(-net, mean=k == 0)
        else:
            body = sheet.body(sheet.balance(t)[0])
        if k == 0:  # the mean over Poisson's ratio
            weights = (5 / 18, 8 / 18, 5 / 18) if len(ratios) == 3 else (1.0,)
            nodes = sum(w * sheet.tension(body, r) for w, r in zip(weights, ratios))
            tensions.append(at_points(np.asarray(nodes)))
            continue
        extra = own * loads.own(finest, 0.25 * loads.extent) if own > 0 else None
        if extra is not None:
            body = body + sheet.own(extra)
        poissons_ratio = ratios[CYCLE[k % len(CYCLE)]] if len(ratios) == 3 else ratios[0]
        tensions.append(at_points(sheet.tension(body, poissons_ratio, extra)))
    return _Part(sheet, np.stack(tensions), np.stack(missing), gross)


def _spread(forces: CellForces, sheet: Sheet) -> Any:
    """Return the matrix (q, vector) that maps traction on the squares of the field to integration points and keeps the
    force of each square. Squares outside pass theirs to the nearest point inside.
    """
    field, e = forces.field, sheet.elements
    rows, columns = field.shape
    x = (e.points[:, 0] / field.pixel - field.start[0]) / field.step
    y = (e.points[:, 1] / field.pixel - field.start[1]) / field.step
    x, y = np.clip(x, 0.0, columns - 1.0), np.clip(y, 0.0, rows - 1.0)
    j, i = np.minimum(x.astype(int), columns - 2), np.minimum(y.astype(int), rows - 2)
    fx, fy = x - j, y - i
    number = np.arange(len(x))
    picks = [(i, j, (1 - fy) * (1 - fx)), (i, j + 1, (1 - fy) * fx), (i + 1, j, fy * (1 - fx)), (i + 1, j + 1, fy * fx)]
    weights = scipy.sparse.csr_array(
        (np.concatenate([w for _, _, w in picks]), (np.tile(number, 4), np.concatenate([a * columns + b for a, b, _ in picks]))),
        shape=(len(x), rows * columns),
    )  # fmt: skip
    covered = np.asarray(weights.T @ e.area)
    enough = covered > PART * field.pitch**2
    places = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(float)
    distance, nearest = scipy.spatial.cKDTree(places[enough]).query(places)
    margin = OUTSIDE * max(field.aperture, field.pitch) / field.pitch + 1.0
    within_margin = distance <= margin
    transfer = scipy.sparse.csr_array(
        (
            np.ones(int(within_margin.sum())),
            (np.flatnonzero(enough)[nearest[within_margin]], np.flatnonzero(within_margin)),
        ),
        shape=(rows * columns, rows * columns),
    )
    each = np.where(enough, field.pitch**2 / np.where(enough, covered, 1.0), 0.0)
    return weights @ scipy.sparse.diags_array(each) @ transfer


def _shapes(forces: CellForces) -> list[Shape]:
    """Connected parts of the mask within the field of view, on squares that are finer than the spacing of vectors."""
    field = forces.field
    rows, columns = field.shape
    finer = max(1, min(4, round(400 / max(rows, columns))))
    side = field.pitch / finer
    at = [s + field.step * ((np.arange(n * finer) + 0.5) / finer - 0.5) for s, n in zip(field.start, (columns, rows))]
    mask = forces.mask
    if mask is None or not forces.masked:
        mask_on_squares = np.ones((rows * finer, columns * finer), dtype=bool)
    elif mask.dtype != np.bool_:
        mask_on_squares = inside_outline(mask, *at)
    elif mask.shape == forces.inside.shape:
        mask_on_squares = np.repeat(np.repeat(forces.inside, finer, axis=0), finer, axis=1)
    else:
        # fraction of each fine square that is inside
        blurred = scipy.ndimage.uniform_filter(mask.astype(np.float64), max(1, round(field.step / finer)))
        places = np.meshgrid(at[1], at[0], indexing="ij")
        mask_on_squares = scipy.ndimage.map_coordinates(blurred, places, order=1, mode="constant") >= 0.5
    number, count = scipy.ndimage.label(mask_on_squares)
    sizes = np.bincount(number.ravel(), minlength=count + 1)[1:]
    start = float(at[0][0] * field.pixel), float(at[1][0] * field.pixel)
    keep = [k for k in range(count) if sizes[k] > SMALL * sizes.max() and sizes[k] > FEW * finer**2 / 2]
    if not keep:
        raise InvalidInput(
            f"the sheet covers {sizes.max() / finer**2 if count else 0:.0f} vectors: give a larger mask, or vectors that lie closer."
        )
    return [Shape(number == k + 1, start, side) for k in keep]


def _view(forces: CellForces) -> tuple[float, float, float, float]:
    """Return left, right, top and bottom of the field of view [m]."""
    field = forces.field
    rows, columns = field.shape
    left, top = ((s - 0.5 * field.step) * field.pixel for s in field.start)
    return left, left + columns * field.pitch, top, top + rows * field.pitch


def _square(field: Any, points: Floats) -> npt.NDArray[np.intp]:
    """Return the flat index of the vector's square that contains each point; -1 outside."""
    rows, columns = field.shape
    j = np.rint((points[:, 0] / field.pixel - field.start[0]) / field.step).astype(int)
    i = np.rint((points[:, 1] / field.pixel - field.start[1]) / field.step).astype(int)
    good = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
    return np.where(good, i * columns + j, -1)


def _principal(tension: Floats) -> tuple[Floats, Floats]:
    """Larger principal tension and its angle [degrees, x towards y] for (..., 3, row, column) or (..., 3, n)."""
    axis = -3 if tension.ndim >= 3 and tension.shape[-3] == 3 else -2
    xx, yy, xy = np.moveaxis(tension, axis, 0)
    half = np.hypot(0.5 * (xx - yy), xy)
    return 0.5 * (xx + yy) + half, np.degrees(0.5 * np.arctan2(2 * xy, xx - yy)) % 180.0


def _quantity(label: str, values: Floats, common: float, why: str = "", *, extreme: bool = False) -> Quantity:
    """Return the quantity of values whose first is the estimate and the others are draws. An ``extreme`` of a map is
    taken from the draws, because the estimate is smoother than the truth.
    """
    value = float(values[1:].mean()) if extreme else float(values[0])
    std = math.hypot(float(values[1:].std(ddof=1)), common * value)
    return Quantity(label, "N/m", value, std, None, why)


def _labels(forces: CellForces, labels: Any, size: tuple[int, int] | None) -> dict[str, Flags]:
    size = size or forces.field.size
    masks = labels if isinstance(labels, dict) else read_labels(labels, size=size)
    first_mask = next(iter(masks.values()))
    if any(abs(a - b) > 2 * forces.field.step + 0.05 * b for a, b in zip(first_mask.shape[::-1], size)):
        raise InvalidInput(
            f"cells are outlined in {first_mask.shape[1]} x {first_mask.shape[0]} pixels, and the picture has {size[0]} x {size[1]}: give labels of the sheet's own picture."
        )
    return masks


def _cells(
    masks: dict[str, Flags], field: Any, points: Floats, weight: Floats, tension: Floats, common: float
) -> tuple[tuple[RegionTension, ...], tuple[BorderTension, ...]]:
    """Return the mean tension of each label, and the forces across borders."""
    if not masks:
        return (), ()
    names = list(masks)
    shape = masks[names[0]].shape
    number = np.zeros(shape, dtype=int)
    for k, mask in enumerate(masks.values(), start=1):
        number[mask] = k
    at = np.rint(points / field.pixel).astype(int)
    good = (at >= 0).all(axis=1) & (at[:, 0] < shape[1]) & (at[:, 1] < shape[0])
    cells = []
    for name, mask in masks.items():
        in_it = np.zeros(len(points), dtype=bool)  # labels may overlap
        in_it[good] = mask[at[good, 1], at[good, 0]]
        if not in_it.any():
            continue
        area = float(weight[in_it].sum())
        mean = tension[:, :, in_it] @ weight[in_it] / area
        top, angle = _principal(mean[..., None])
        cells.append(
            RegionTension(
                name, area, _quantity("average tension", 0.5 * (mean[:, 0] + mean[:, 1]), common), _quantity("largest tension", top[:, 0], common, extreme=True), float(angle[0, 0])
            )
        )  # fmt: skip
    return tuple(cells), _borders(names, number, field.pixel, points, tension, common)


def _borders(
    names: list[str], number: npt.NDArray[Any], pixel: float, points: Floats, tension: Floats, common: float
) -> tuple[BorderTension, ...]:
    """Return the forces across borders of two labels: the sum of N n over the edges between their pixels, which does
    not depend on the steps of the border.
    """
    tree = scipy.spatial.cKDTree(points)
    edges: dict[tuple[int, int], list[tuple[float, float, float, float]]] = {}
    for axis in (0, 1):
        first, second = (number[:-1], number[1:]) if axis == 0 else (number[:, :-1], number[:, 1:])
        for r, c in np.argwhere((first != second) & (first > 0) & (second > 0)):
            a, b = int(first[r, c]), int(second[r, c])
            sign = 1.0 if a < b else -1.0  # the normal points out of the label that comes first
            x, y, nx, ny = (c, r + 0.5, 0.0, sign) if axis == 0 else (c + 0.5, r, sign, 0.0)
            edges.setdefault((min(a, b), max(a, b)), []).append((x * pixel, y * pixel, nx * pixel, ny * pixel))
    out = []
    for (a, b), listed in sorted(edges.items()):
        each = np.array(listed)
        distance, nearest = tree.query(each[:, :2])
        span = each[:, 2:].sum(axis=0)
        length = float(np.hypot(*span))
        if length < 2 * pixel or distance.max() > 10 * max(length, pixel):
            continue
        xx, yy, xy = np.moveaxis(tension[:, :, nearest], 1, 0)
        f = np.stack([xx @ each[:, 2] + xy @ each[:, 3], xy @ each[:, 2] + yy @ each[:, 3]])
        n = span / length
        out.append(
            BorderTension(
                (names[a - 1], names[b - 1]), length, (float(f[0, 0]), float(f[1, 0])),
                _quantity("tension across the border", n @ f / length, common), _quantity("shear along the border", np.array([-n[1], n[0]]) @ f / length, common),
            )
        )  # fmt: skip
    return tuple(out)


def _notes(parts: list[_Part], forces: CellForces, own: float, ratio: float | None) -> tuple[str, ...]:
    notes = []
    open_ = any(len(p.sheet.edge[0]) for p in parts)
    for k, part in enumerate(parts):
        share = float(np.hypot(part.missing[0, 0], part.missing[0, 1])) / max(part.gross, 1e-300)
        if share > UNBALANCED and not len(part.sheet.edge[0]):
            part_name = f" of part {k + 1}" if len(parts) > 1 else ""
            notes.append(
                f"the traction{part_name} is not balanced: its net force is {100 * share:.0f} % of the sum of its sizes. An even traction was taken out; is all of the sheet in the mask and in view?"
            )
    if open_:
        notes.append(
            "the sheet goes on beyond the field of view: what pulls there is not known but for the balance of forces, and is in the errors"
        )
    if len(parts) > 1:
        notes.append(f"the mask has {len(parts)} parts, each a sheet by itself")
    if forces.samples is not None:
        notes.append(
            'the traction is that of single adhesions: below a sheet it is everywhere, which method="tikhonov" (--method tikhonov) suits'
        )
    covered = int(forces.inside.sum())
    if covered < 10 * FEW:
        notes.append(
            f"the sheet covers {covered} vectors: its tension is known no finer than {plain_number(1e6 * forces.field.pitch, 3)} µm"
        )
    notes.append(
        "the sheet is elastic and even in plane stress, with "
        + (f"a Poisson's ratio of {ratio:g}" if ratio is not None else "a Poisson's ratio from 0 to 1")
        + (
            f"; tensions of the cells' own, {100 * own:.0f} % of the sheet's, are in the errors"
            if own > 0
            else "; cells have no tensions of their own"
        )
    )
    return tuple(notes)


def _write(at: str, text: str) -> None:
    Path(at).write_text(text, encoding="utf-8")
