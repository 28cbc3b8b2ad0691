"""The mechanical effect of a cell on its gel: the numbers that papers report, each with its error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._numbers import plain_number
from palpate.elastic.pad import Floats, Pad
from palpate.errors import InvalidInput
from palpate.microscopy.adhesions import Sample
from palpate.microscopy.blobs import Response
from palpate.microscopy.doubts import doubts, reworded
from palpate.microscopy.fields import Field
from palpate.microscopy.inversion import Inverted, inverted, of_adhesions
from palpate.microscopy.masks import on_grid, read_mask
from palpate.microscopy.normal import normal_of, without_sideways
from palpate.microscopy.spread import read
from palpate.sensing.uncertainty import Uncertainty
from palpate.touch import Touch
from palpate.units import is_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CellForces", "Quantity", "cell_forces"]

#: Ways from displacements to traction.
METHODS = ("adhesions", "tikhonov")
#: Half-width of a 95 % interval in standard deviations.
SIDE = 1.96
#: Energies, which are proportional to the squared displacement.
ENERGIES = {"strain_energy", "energy_outside", "strain_energy_normal"}
#: Sizes, whose intervals end at zero.
NOT_NEGATIVE = {"force_inside", "force_outside", "background", "traction_rms", "traction_peak"}


@dataclass(frozen=True)
class Quantity:
    """A number with its standard deviation.

    Attributes
    ----------
    label, unit : str
    value, std : float
    expected : float or None
        Its value by physics, if any.
    why : str
        Its meaning, in a sentence.
    ends : (float, float) or None
        Ends of the 95 % interval, if they differ from 1.96 standard deviations.

    Examples
    --------
    >>> from palpate.microscopy import Quantity
    >>> energy = Quantity("strain energy", "J", 2.0e-13, 0.1e-13)
    >>> [round(end, 15) for end in energy.interval], energy.scaled(), str(energy)
    ([1.8e-13, 2.2e-13], ('200', '10', 'fJ'), 'strain energy: 200 +- 10 fJ')
    """

    label: str
    unit: str
    value: float
    std: float
    expected: float | None = None
    why: str = ""
    ends: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """Return the lower and upper end of the 95 % interval."""
        return self.ends or (self.value - SIDE * self.std, self.value + SIDE * self.std)

    def scaled(self) -> tuple[str, str, str]:
        """Return value, standard deviation and unit as text, with a suitable prefix of the unit."""
        size = max(abs(self.value), self.std)
        if not math.isfinite(size) or size == 0:
            return f"{self.value:g}", f"{self.std:g}", self.unit
        power = 2 if self.unit == "m^2" else 1
        for prefix, factor in (
            ("", 1.0),
            ("m", 1e-3),
            ("µ", 1e-6),
            ("n", 1e-9),
            ("p", 1e-12),
            ("f", 1e-15),
            ("a", 1e-18),
        ):
            if size >= factor**power or prefix == "a":
                break
        factor = factor**power
        if self.std > 0:
            digits = max(
                0,
                1
                - math.floor(math.log10(self.std / factor))
                - (1 if self.std / factor / 10 ** math.floor(math.log10(self.std / factor)) >= 3 else 0),
            )
            return f"{self.value / factor:.{digits}f}", f"{self.std / factor:.{digits}f}", prefix + self.unit
        return f"{plain_number(self.value / factor, 4)}", "0", prefix + self.unit

    def __str__(self) -> str:
        value, std, unit = self.scaled()
        return f"{self.label}: {value} +- {std} {unit}"


@dataclass(frozen=True, eq=False)
class CellForces:
    """Traction of a cell and the quantities derived from it.

    Attributes
    ----------
    field : Field
        The displacements that were inverted.
    traction, std : array (2, row, column)
        Traction on the gel [Pa] along x (right) and y (down), on the field's grid, and its standard deviation.
    draws : array (draw, 2, row, column)
        Samples of its posterior.
    samples : tuple of Sample or None
        The adhesions of each, if sampled.
    inside : array (row, column) of bool
        True inside the cell.
    quantities : dict of str to Quantity
        strain_energy, contractile_moment, contractility, force_inside, force_outside, net_force_x, net_force_y, torque, background and so on.
    touch : Touch
        The whole result, beyond the field of view too.
    notes : tuple of str
        Assumptions, and reasons for doubt.

    Examples
    --------
    >>> forces = cell_forces(field, gel, mask="cell.png")  # doctest: +SKIP
    >>> print(forces.summary())  # doctest: +SKIP
    >>> forces.plot().savefig("traction.pdf")  # doctest: +SKIP
    >>> forces.write_report("cell.html")  # doctest: +SKIP
    >>> forces.within("second-cell.png").write_table("second.csv")  # doctest: +SKIP
    """

    field: Field
    pad: Pad
    traction: Floats
    std: Floats
    draws: Floats
    inside: npt.NDArray[np.bool_]
    masked: bool
    quantities: dict[str, Quantity]
    principal: tuple[float, float, float]
    touch: Touch
    notes: tuple[str, ...]
    mask: Any = None
    picture: Any = None
    samples: tuple[Sample, ...] | None = None
    response: Response | None = None
    done: Any = None
    known: Any = None
    #: notes that hold for every cell in the field of view
    common_notes: tuple[str, ...] = ()

    @property
    def normal(self) -> tuple[Floats, Floats] | None:
        """Normal traction (row, column) [Pa], positive where it pulls the gel up, and its standard deviation; None where the field has no displacement out of the plane."""
        normal = self.done.normal
        if normal is None:
            return None
        common = self.touch._scale_std
        return normal.traction, np.hypot(np.std(normal.draws, axis=0, ddof=1), common * normal.traction)

    def within(self, mask: Any, *, size: tuple[int, int] | None = None) -> CellForces:
        """Return the same traction with the numbers of another cell in the field of view.

        ``size``: columns and rows of the picture that the mask belongs to; default: those of `picture`, if any. With
        "adhesions", traction outside the mask of `cell_forces` was taken as unlikely.
        """
        corners = read_mask(mask, pixel=self.field.pixel)
        if size is None and self.picture is not None:
            size = (int(np.shape(self.picture)[1]), int(np.shape(self.picture)[0]))
        inside = on_grid(corners, self.field, size=size)
        numbers, principal = _numbers(self.done, self.field, inside, True, self.known)
        notes = (*self.common_notes, *doubts(numbers, principal, self.field, inside, True, self.done))
        return replace(
            self,
            inside=inside,
            masked=True,
            mask=corners,
            quantities=numbers,
            principal=principal,
            notes=tuple(dict.fromkeys(notes)),
        )

    def __getitem__(self, name: str) -> Quantity:
        if name not in self.quantities:
            raise InvalidInput(f"no quantity {name!r}; there are {', '.join(self.quantities)}.")
        return self.quantities[name]

    def summary(self) -> str:
        """Return the numbers as text, one to a line."""
        width = max(len(q.label) for q in self.quantities.values())
        lines = []
        for q in self.quantities.values():
            value, std, unit = q.scaled()
            should = "" if q.expected is None else f"   (should be {q.expected:g})"
            error = f" +- {std}" if q.std > 0 else ""
            lines.append(f"{q.label:<{width}}  {value}{error} {unit}{should}")
        return "\n".join(lines)

    def plot(self, *, title: str | None = None) -> Figure:
        """Plot the traction over the picture of the cell, with a scale arrow and a scale bar."""
        from palpate.microscopy.figures import plot_traction

        return plot_traction(self, title=title)

    def write_report(self, path: str | Path, *, title: str = "", source: str = "", command: str = "") -> None:
        """Write one HTML file with numbers, pictures and assumptions."""
        from palpate.microscopy.report import write_report

        write_report(self, path, title=title, source=source, command=command)

    def write_table(self, path: str | Path) -> None:
        """Write the numbers as CSV: name, value, standard deviation, ends of the 95 % interval, unit."""
        from palpate.microscopy.report import write_table

        write_table(self, path)

    def write_vectors(self, path: str | Path) -> None:
        """Write every vector as CSV: position and displacement in pixels (`read_field` reads these again), traction
        with its standard deviation [Pa], and whether the vector lies in the cell.
        """
        from palpate.microscopy.written import write_vectors

        write_vectors(self, path)

    def write_tiff(self, path: str | Path) -> None:
        """Write the traction as a TIFF stack of 32-bit floats, which ImageJ opens with units: traction along x and
        along y, then the standard deviation of both. One pixel is one vector.
        """
        from palpate.microscopy.written import write_tiff

        write_tiff(self, path)

    def write_netcdf(self, path: str | Path, *, provenance: Mapping[str, str] | None = None) -> None:
        """Write the whole result as netCDF, as `palpate.recordings.write_touch` does, and add the displacement, the
        traction at the vectors and the mask.

        ``provenance`` says how to reproduce the file; each entry becomes an attribute.
        """
        from palpate.microscopy.written import write_netcdf

        write_netcdf(self, path, provenance=provenance)


def cell_forces(
    field: Field,
    pad: Pad,
    *,
    mask: Any = None,
    size: tuple[int, int] | None = None,
    picture: Any = None,
    depth: float = 0.0,
    noise: float | None = None,
    method: str = "adhesions",
    order: int = 1,
    rule: str = "evidence",
    drift: bool = True,
    uncertainty: Uncertainty | None = None,
    draws: int = 120,
    seed: int = 0,
) -> CellForces:
    """Traction of a cell on its gel, and strain energy, contractility and forces with their errors.

    Parameters
    ----------
    field : Field
        Displacements (`read_field`, `bead_displacements`).
    pad : Pad
        The gel: `HalfSpace`, or `BondedLayers` of a thickness on glass.
    mask : array, path or None
        The cell (`read_mask`, which selects one of several); None: all of the field of view.
    size : (int, int), optional
        Columns and rows of the picture that the mask belongs to.
    picture : array (row, column), optional
        The cell, to be drawn beneath.
    depth : float
        Depth of the beads below the surface [m].
    noise : float, optional
        Standard deviation of the displacements [m]; by default that of the field (`Field.noise`), or else an estimate.
    method : str
        "adhesions" (default): traction is in patches of any number, place and size, which are sampled; unexplained vectors are excluded, with a note.
        "tikhonov": one even penalty, for traction that is everywhere.
    order, rule
        As for `Tikhonov`, and for it alone.
    drift : bool
        Also fit a shift of the whole picture (default); False if it cannot move.
    uncertainty : Uncertainty, optional
        Uncertainty of modulus and scale: they enter every number and the map's standard deviation (default: 15 % and 2 %). Thickness, depth and gains
        do not, and a note says so.
    draws : int
        Samples of the posterior for the errors.
    seed : int

    Returns
    -------
    CellForces

    Notes
    -----
    With t the traction on the gel, u the displacement of the surface that it makes, dA the square of a vector, and sums over the cell:

    - strain energy 1/2 sum (t . u) dA, u less its mean over the field of view;
    - net contractile moment -sum (t . x) dA, the trace of the matrix of first moments, positive where the cell pulls inwards (J. P. Butler et al., Am. J.
      Physiol. Cell Physiol. 282, 2002, C595-C605);
    - contractility: sum of the parts of t dA that point to the force centre, the point nearest to all lines of force (X. Trepat's and pyTFM's);
    - torque about the cell's middle and net force, which a cell that is wholly in view keeps at zero.

    With "adhesions", value and error of each number come from the samples, widened by what cells of known truth have shown to be missing from them
    (`palpate.microscopy.spread`); energy and largest traction have intervals on a log scale. With "tikhonov", errors are standard deviations over the
    samples. For the energy and sums of sizes |t| the difference between the mean of the samples and the estimate is added in quadrature, which is what the
    readings do not resolve; the energy is the mean of both, because regularisation makes that of the estimate too small.

    Raises
    ------
    InvalidInput
        An empty mask, one of another size, or one that holds no vector; vectors that are all equal; noise that is no positive number.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.microscopy import Field, cell_forces
    >>> gel = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
    >>> array = pp.AreaArray(shape=(24, 24), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    >>> skin = pp.Skin(gel, array)
    >>> traction = np.zeros((3, *skin.surface.shape))
    >>> middle = skin.surface.shape[1] // 2
    >>> traction[0, middle - 1 : middle + 1, middle - 6 : middle - 4] = 500.0  # two adhesions that pull at each other
    >>> traction[0, middle - 1 : middle + 1, middle + 4 : middle + 6] = -500.0
    >>> u = skin.sense(traction) + 1e-9 * np.random.default_rng(0).standard_normal((2, 24, 24))
    >>> field = Field(displacement=u, start=(4.5, 4.5), step=10.0, pixel=0.1e-6)
    >>> forces = cell_forces(field, gel, draws=16)
    >>> low, high = forces["contractile_moment"].interval
    >>> bool(low < 2 * 500.0 * 4e-12 * 5e-6 < high)  # force times distance
    True
    """
    if draws < 8:
        raise InvalidInput(f"draws must be at least 8; got {draws!r}.")
    if method not in METHODS:
        raise InvalidInput(f"method must be {' or '.join(map(repr, METHODS))}; got {method!r}.")
    if noise is not None and not (is_number(noise) and noise > 0):
        raise InvalidInput(
            f"noise must be a positive standard deviation [m]; got {noise!r}. Leave it out if it is unknown."
        )
    if field.normal is None and not np.ptp(field.displacement[:, field.valid], axis=1).any():
        raise InvalidInput(
            "all vectors of the field are equal: nothing moved, or these are no displacements. Check which fields are u and v (name=, --name)."
        )
    corners = None if mask is None else read_mask(mask, pixel=field.pixel)
    if size is None and picture is not None:
        size = (int(np.shape(picture)[1]), int(np.shape(picture)[0]))
    name = str(mask) if isinstance(mask, str | Path) else "the mask"
    inside = np.ones(field.shape, dtype=bool) if corners is None else on_grid(corners, field, size=size, name=name)
    normal, whole_field = None, field
    if field.normal is not None:
        normal = normal_of(
            field, pad, depth=depth, noise=noise, drift=drift, uncertainty=uncertainty, draws=draws, seed=seed
        )
        field = without_sideways(field, normal)
    if method == "adhesions":
        likely = None if corners is None else inside
        estimate = of_adhesions(
            field,
            pad,
            depth=depth,
            noise=noise,
            likely=likely,
            drift=drift,
            uncertainty=uncertainty,
            draws=draws,
            seed=seed,
        )
    else:
        noise = field.noise if noise is None else noise
        estimate = inverted(
            field, pad, depth=depth, noise=noise, order=order, rule=rule, nuisance="auto" if drift else (), uncertainty=uncertainty, draws=draws, seed=seed,
        )  # fmt: skip
    pad_uncertainty = uncertainty or Uncertainty()
    beside = [n for n in ("thickness", "depth", "gain") if getattr(pad_uncertainty, n)]
    estimate = replace(estimate, normal=normal)
    numbers, principal = _numbers(estimate, field, inside, corners is not None, pad_uncertainty)
    notes = [
        *field.notes,
        *map(reworded, estimate.touch.notes),
        *(f"assumed: {reworded(assumption)}" for assumption in estimate.touch.assumed),
        *estimate.notes,
        *(
            [f"how well {', '.join(beside)} is known does not enter these errors, only how well modulus and scale are"]
            if beside
            else []
        ),
    ]
    common_notes = tuple(notes)
    notes += doubts(numbers, principal, field, inside, corners is not None, estimate)
    return CellForces(
        whole_field, pad, estimate.traction, np.hypot(np.std(estimate.draws, axis=0, ddof=1), estimate.touch._scale_std * estimate.traction), estimate.draws, inside, corners is not None, numbers, principal,
        estimate.touch, tuple(dict.fromkeys(notes)), corners, picture, estimate.samples, estimate.response, estimate, pad_uncertainty, common_notes,
    )  # fmt: skip


def _numbers(
    estimate: Inverted, field: Field, inside: npt.NDArray[np.bool_], masked: bool, pad_uncertainty: Uncertainty
) -> tuple[dict[str, Quantity], tuple[float, float, float]]:
    """Compute every quantity from the estimate and from each sample."""
    sampled = estimate.samples is not None
    cell, rows, columns = field.pitch**2, *field.shape
    x, y = np.meshgrid(
        field.pitch * (np.arange(columns) - 0.5 * (columns - 1)), field.pitch * (np.arange(rows) - 0.5 * (rows - 1))
    )
    middle = x[inside].mean(), y[inside].mean()
    x, y = x - middle[0], y - middle[1]
    out = ~inside
    beside = masked and bool(out.any())
    # evaluate one map at a time: all of them together would fill the memory
    maps = [*(() if sampled else [estimate.traction]), *estimate.draws]
    # each draw has its own force centre
    center = None if sampled else _force_center(estimate.traction, x[inside], y[inside], inside)
    each = [_sums(t, x, y, inside, out, center) for t in maps]
    sums = {key: np.array([sums_of_map[key] for sums_of_map in each]) for key in each[0]}
    moments = cell * np.moveaxis(sums["moments"], 0, -1)  # (position, force, draw)
    of_cell, in_cell = (", cell", " in the cell") if masked else ("", "")
    peak = sums["peak"] if sampled else _at_peak(np.stack(maps), inside)
    where = (
        "of the mean over a vector's square; too large where traction is even over many squares"
        if sampled
        else "at the vector where the estimate is largest"
    )
    # label, unit, values, expected value, whether it is a size, explanation
    entries: dict[str, tuple[str, str, Floats, float | None, bool, str]] = {
        "strain_energy": (f"strain energy{in_cell}", "J", _work(estimate, field, inside), None, True, "half the work of the traction on the displacement that it makes"),
        "contractile_moment": ("net contractile moment", "N m", -(moments[0, 0] + moments[1, 1]), None, False, "trace of the first moments, positive where the cell pulls inwards (Butler et al. 2002)"),
        "contractility": ("contractility", "N", cell * sums["inward"], None, False, "sum of the forces' parts that point to the force centre"),
        "force_inside": (f"sum of sizes of force{in_cell}", "N", cell * sums["sizes_inside"], None, True, "of every vector, noise included: it grows with noise and never cancels"),
    }  # fmt: skip
    if beside:
        above = sums["sizes_inside"] - sums["sizes_outside"] * (inside.sum() / out.sum())
        entries |= {
            "force_above_background": ("the same less background", "N", cell * above, None, True, "less what as many vectors outside the cell hold"),
            "force_outside": ("sum of sizes of force outside", "N", cell * sums["sizes_outside"], None, True, "should be what noise makes"),
            "energy_outside": ("strain energy outside", "J", _work(estimate, field, out), None, True, "should be small beside that in the cell"),
            "background": ("background traction (rms)", "Pa", sums["rms_outside"], None, True, "outside the cell: what is not the cell's"),
        }  # fmt: skip
    entries |= {
        "traction_rms": (f"traction{in_cell} (rms)", "Pa", sums["rms_inside"], None, True, ""),
        "traction_peak": ("largest traction", "Pa", peak, None, False, where),
        "net_force_x": (f"net force along x{of_cell}", "N", cell * sums["net"][:, 0], 0.0, False, "a cell that is wholly in view pulls itself along nothing"),
        "net_force_y": (f"net force along y{of_cell}", "N", cell * sums["net"][:, 1], 0.0, False, "a cell that is wholly in view pulls itself along nothing"),
        "torque": (f"torque{of_cell}", "N m", moments[0, 1] - moments[1, 0], 0.0, False, "about the middle of the cell"),
    }  # fmt: skip
    if beside:
        for i, axis in enumerate("xy"):
            net = cell * sums["net_view"][:, i]
            entries[f"net_force_{axis}_view"] = (f"net force along {axis}, field of view", "N", net, 0.0, False, "")
    scores = np.array([s.score for s in estimate.samples]) if estimate.samples is not None else None
    unsampled = set()
    if estimate.normal is not None:
        entries |= estimate.normal.quantities(inside, cell)
        unsampled = set(estimate.normal.NUMBERS)
    quantities = {}
    for key, (label, unit, values, expected, sized, why) in entries.items():
        # traction is proportional to modulus and displacement, the energy to modulus and squared displacement
        common = math.hypot(pad_uncertainty.modulus, (2.0 if key in ENERGIES else 1.0) * pad_uncertainty.scale)
        if sampled and key not in unsampled:
            value, std, ends = read(key, values, common, scores)
            quantities[key] = Quantity(label, unit, value, std, expected, why, ends)
            continue
        value, samples = float(values[0]), values[1:]
        variance = float(np.var(samples, ddof=1)) + (common * value) ** 2
        if sized:
            variance += (float(samples.mean()) - value) ** 2
        if key.startswith("strain_energy"):
            value = 0.5 * (value + float(samples.mean()))
        quantities[key] = Quantity(label, unit, value, math.sqrt(variance), expected, why)
    for key in NOT_NEGATIVE & quantities.keys():
        low, high = quantities[key].interval
        quantities[key] = replace(quantities[key], ends=(max(low, 0.0), high))
    if masked:
        quantities["area"] = Quantity("area of the cell", "m^2", float(inside.sum() * cell), 0.0)
    first_moments = moments.mean(axis=-1) if sampled else moments[..., 0]
    symmetric = -0.5 * (first_moments + first_moments.T)
    sizes, vectors = np.linalg.eigh(symmetric)
    return quantities, (float(sizes[1]), float(sizes[0]), float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))))


def _sums(
    t: Floats,
    x: Floats,
    y: Floats,
    inside: npt.NDArray[np.bool_],
    out: npt.NDArray[np.bool_],
    center: tuple[float, float] | None,
) -> dict[str, Any]:
    """Sum one traction (2, row, column) over the vectors inside and outside the cell. Contractility is measured
    towards ``center``, or towards the traction's own force centre.
    """
    size = np.hypot(*t)
    tx, ty = t[0][inside], t[1][inside]
    x, y = x[inside], y[inside]
    ox, oy = _force_center(t, x, y, inside) if center is None else center
    distance = np.hypot(x - ox, y - oy)
    inward = -(tx * (x - ox) + ty * (y - oy)) / np.where(distance > 0, distance, 1.0)
    count_outside = int(out.sum())
    return {
        "moments": [[(a * f).sum() for f in (tx, ty)] for a in (x, y)],
        "inward": inward.sum(),
        "sizes_inside": size[inside].sum(),
        "sizes_outside": size[out].sum(),
        "rms_inside": math.sqrt(float((size[inside] ** 2).mean())),
        "rms_outside": math.sqrt(float((size[out] ** 2).mean())) if count_outside else 0.0,
        "peak": size[inside].max(),
        "net": [tx.sum(), ty.sum()],
        "net_view": t.sum(axis=(1, 2)),
    }


def _work(estimate: Inverted, field: Field, region: npt.NDArray[np.bool_]) -> Floats:
    """Return half the work (draw,) [J] of the traction in the part ``region`` of the field of view. The work of the
    estimate comes first unless the estimate is the mean of the samples.
    """
    if estimate.samples is not None and estimate.work is not None:
        # only the work of the blobs includes adhesions that are finer than the spacing of vectors
        y, x = (field.pitch * np.arange(n) for n in field.shape)
        shares = [s.share(x, y, field.pitch, region) for s in estimate.samples]
        return np.array([float(share @ w) for share, w in zip(shares, estimate.work)])
    pairs = zip([estimate.traction, *estimate.draws], [estimate.moved, *estimate.moved_by_draws])
    return (
        np.array([0.5 * float((t * (u - u.mean(axis=(1, 2), keepdims=True)))[:, region].sum()) for t, u in pairs])
        * field.pitch**2
    )


def _force_center(t: Floats, x: Floats, y: Floats, inside: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """Return the point with the least sum of squared distances to the lines of force, weighted by the squared forces."""
    tx, ty = t[0][inside], t[1][inside]
    lever = tx * y - ty * x  # t x position; distance of a line from a point c: |t_x (y - c_y) - t_y (x - c_x)|/|t|
    matrix = np.array([[(ty**2).sum(), -(tx * ty).sum()], [-(tx * ty).sum(), (tx**2).sum()]])
    right = np.array([-(ty * lever).sum(), (tx * lever).sum()])
    if not np.linalg.cond(matrix) < 1e8:
        return 0.0, 0.0
    center = np.linalg.solve(matrix, right)
    if not (x.min() <= center[0] <= x.max() and y.min() <= center[1] <= y.max()):
        return 0.0, 0.0  # nearly parallel lines define no point
    return float(center[0]), float(center[1])


def _at_peak(t: Floats, inside: npt.NDArray[np.bool_]) -> Floats:
    """Return the traction of the estimate and of each draw at the vector where the estimate is largest, along the
    direction that the estimate has there.
    """
    size = np.where(inside, np.hypot(*t[0]), -1.0)
    at = np.unravel_index(int(size.argmax()), size.shape)
    direction = t[0][:, at[0], at[1]] / max(float(size[at]), 1e-300)
    return np.asarray(t[:, :, at[0], at[1]] @ direction)
