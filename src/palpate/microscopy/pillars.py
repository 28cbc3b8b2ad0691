"""Forces on micropillars: the deflection of the head of an elastic post, times its stiffness.

A force F at the head of a post of length L and diameter D on an elastic base of the same material moves it by

    d = (4 F/(pi E D)) [16/3 (L/D)^3 + (7 + 6 nu)/3 (L/D) + 8 T (L/D)^2],
    T = 1.3 (1 + nu)/(2 pi) [2 (1 - nu) + 1 - 1/(4 (1 - nu))]:

bending, shear (Timoshenko's) and tilt of the base (I. Schoen, W. Hu, E. Klotzsch, V. Vogel, Nano Lett. 10, 2010, 1823-1830). Bending alone overestimates forces on short posts by tens of per cent.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.cell import SIDE, Quantity
from palpate.microscopy.pivtext import read_piv_text
from palpate.recordings.files import atomically
from palpate.units import UNITS, is_number

__all__ = ["Pillar", "PillarForces", "pillar_forces", "read_pillars"]

#: Schoen's constant from finite elements: a base under a bending moment tilts by this factor more than under the mean
#: stress of the beam.
TILT = 1.3
#: A beam is linear within 1 % for deflections up to BENT of its length. Its formula holds for ratios of length to
#: diameter of at least STOUT.
BENT, STOUT = 0.2, 1.0
#: A deflection of more than this fraction of the length means a wrong unit.
WRONG = 1.0


@dataclass(frozen=True, kw_only=True)
class Pillar:
    """An elastic post with its uncertainty.

    Parameters
    ----------
    diameter, height : float
        [m].
    youngs_modulus : float
        [Pa].
    poissons_ratio : float
        Default: 0.5, rubber.
    diameter_error, height_error, modulus_error : float
        Relative standard deviations. The stiffness goes with D^4/L^3 where posts are slender.
    rigid_base : bool
        Posts on a stiff base, such as silicon: nothing tilts.

    Raises
    ------
    InvalidInput
        Sizes that are not positive, a Poisson's ratio outside 0 to 0.5, errors outside 0 to 1.

    Examples
    --------
    >>> from palpate.microscopy import Pillar
    >>> post = Pillar(diameter=2e-6, height=6e-6, youngs_modulus=2e6, height_error=0.03)
    >>> str(post.stiffness), round(post.bending_alone / post.stiffness.value, 2)
    ('stiffness: 16.8 +- 1.4 mN/m', 1.3)

    >>> {name: round(value, 2) for name, value in Pillar(diameter=1, height=2, youngs_modulus=1).compliances.items()}
    {'bending': 54.32, 'shear': 8.49, 'tilt': 18.97}
    """

    diameter: float
    height: float
    youngs_modulus: float
    poissons_ratio: float = 0.5
    diameter_error: float = 0.0
    height_error: float = 0.0
    modulus_error: float = 0.0
    rigid_base: bool = False

    def __post_init__(self) -> None:
        for name in ("diameter", "height", "youngs_modulus"):
            value = getattr(self, name)
            if not (is_number(value) and 0 < value < math.inf):
                raise InvalidInput(f"{name} of a pillar must be a positive number; got {value!r}.")
        if not (is_number(self.poissons_ratio) and 0 <= self.poissons_ratio <= 0.5):
            raise InvalidInput(f"poissons_ratio of a pillar is from 0 to 0.5; got {self.poissons_ratio!r}.")
        for name in ("diameter_error", "height_error", "modulus_error"):
            value = getattr(self, name)
            if not (is_number(value) and 0 <= value < 1):
                raise InvalidInput(f"{name} is a part of the value, from 0 to 1: 0.05 is 5 %; got {value!r}.")

    @property
    def compliances(self) -> dict[str, float]:
        """Return the deflection per force [m/N] due to bending, shear and tilt."""
        slender, nu = self.height / self.diameter, self.poissons_ratio
        unit = 4.0 / (math.pi * self.youngs_modulus * self.diameter)
        tilt = TILT * (1 + nu) / (2 * math.pi) * (2 * (1 - nu) + 1 - 1 / (4 * (1 - nu)))
        return {
            "bending": unit * 16 / 3 * slender**3,
            "shear": unit * (7 + 6 * nu) / 3 * slender,
            "tilt": 0.0 if self.rigid_base else unit * 8 * tilt * slender**2,
        }

    @property
    def bending_alone(self) -> float:
        """Stiffness [N/m] due to bending alone, 3 pi E D^4/(64 L^3), which many papers use."""
        return 1.0 / self.compliances["bending"]

    @property
    def stiffness(self) -> Quantity:
        """Force per deflection [N/m], with the error due to those of modulus, diameter and height."""
        value = 1.0 / sum(self.compliances.values())
        shares = [self.modulus_error]  # stiffness is proportional to the modulus
        for name, error in (("diameter", self.diameter_error), ("height", self.height_error)):
            step = 1e-4
            ends = [
                1.0 / sum(replace(self, **{name: getattr(self, name) * factor}).compliances.values())
                for factor in (1 - step, 1 + step)
            ]
            shares.append(error * math.log(ends[1] / ends[0]) / (2 * step))
        return Quantity("stiffness", "N/m", value, value * math.hypot(*shares))


@dataclass(frozen=True, eq=False)
class PillarForces:
    """Forces on all posts.

    Attributes
    ----------
    pillar : Pillar
    positions, deflections : array (n, 2)
        [m]; NaN where a post has none.
    forces, std : array (n, 2)
        By the cell on the post [N], along x and y; and standard deviations, of deflection and stiffness together.
    noise : array (n, 2)
        Standard deviation of each deflection [m]; 0: not known.
    quantities : dict of str to Quantity
        stiffness, mean_force, largest_force, sum_of_forces, net_force_x, net_force_y, strain_energy.
    notes : tuple of str
    """

    pillar: Pillar
    positions: Floats
    deflections: Floats
    forces: Floats
    std: Floats
    noise: Floats
    quantities: dict[str, Quantity]
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> Quantity:
        if name not in self.quantities:
            raise InvalidInput(f"pillars have no {name!r}; there are {', '.join(self.quantities)}.")
        return self.quantities[name]

    def summary(self) -> str:
        """Return the numbers as text, one to a line."""
        return "\n".join(str(q) for q in self.quantities.values())

    def write_table(self, path: str | Path) -> None:
        """Write one row for each post: position, deflection, force and its errors, and the magnitude of the force with
        its 95 % interval.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        titles = "pillar x_m y_m dx_m dy_m force_x_N force_y_N std_x_N std_y_N force_N low_95_N high_95_N"
        writer.writerow(titles.split())
        for k, (at, deflection, force, std) in enumerate(
            zip(self.positions, self.deflections, self.forces, self.std), start=1
        ):
            size = float(np.hypot(*force))
            along = float(np.hypot(*(std * force))) / size if size > 0 else float(std.max())
            ends = max(size - SIDE * along, 0.0), size + SIDE * along
            row = [*at, *deflection, *force, *std, size, *ends]
            writer.writerow([k, *("" if not math.isfinite(v) else f"{v:.6g}" for v in row)])
        atomically(path, lambda where: _write(where, text.getvalue()))


def read_pillars(
    path: str | Path, *, unit: str | None = None, position_unit: str | None = None, pixel: float | None = None
) -> tuple[Floats, Floats, Floats | None]:
    """Positions and deflections (n, 2) [m] of a table with the columns x, y, dx, dy, and standard deviations where it has them (ex, ey).

    Parameters
    ----------
    path : path
    unit, position_unit : str, optional
        Of deflections and positions ("px", "um", "nm"), where the header does not say it (``dx [um]``); ``unit`` holds for positions too, unless the header or
        ``position_unit`` says another.
    pixel : float, optional
        Metres in a pixel, where something is in pixels.

    Raises
    ------
    InvalidInput
        No table, missing columns, a unit that neither the file nor the caller states, or one that contradicts the file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.microscopy import read_pillars
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/posts.csv").write_text("x [um],y [um],dx [nm],dy [nm]\\n0,0,100,0\\n4,0,-250,30\\n")
    ...     read_pillars(f"{folder}/posts.csv")[1].round(12).tolist()
    [[1e-07, 0.0], [-2.5e-07, 3e-08]]
    """
    path = Path(path)
    table = read_piv_text(path)
    factors = []
    for quantity, unit_in_file, own_unit in (
        ("deflections", table.unit, unit),
        ("positions", table.place, position_unit or (None if table.place else unit)),
        ("standard deviations", table.std_unit, None if table.std_unit else table.unit or unit),
    ):
        if unit_in_file is not None and own_unit is not None and unit_in_file != own_unit:
            raise InvalidInput(
                f"{path}: the header says the {quantity} are in {unit_in_file}, not in {own_unit}: leave the unit out."
            )
        name = unit_in_file or own_unit
        option = "unit" if quantity == "deflections" else "position_unit"
        if name is None:
            raise InvalidInput(
                f'{path}: does not say the unit of the {quantity}: write it in the header, such as dx [um], or say {option}="um" (--{option.replace("_", "-")} um).'
            )
        if name == "px":
            if pixel is None:
                raise InvalidInput(
                    f'{path}: the {quantity} are in pixels: say the size of one with pixel=1e-7 (--pixel "0.1 um").'
                )
            factors.append(pixel)
        elif name in UNITS["length"]:
            factors.append(UNITS["length"][name])
        else:
            raise InvalidInput(
                f"{path}: {name!r} is no unit of the {quantity}; accepted are px, {', '.join(UNITS['length'])}."
            )
    good = np.ones(len(table.u), dtype=bool) if table.bad is None else ~np.asarray(table.bad)
    deflections = np.where(good[:, None], factors[0] * np.stack([table.u, table.v], axis=1), np.nan)
    std = None if table.std is None else factors[2] * np.stack(table.std, axis=1)
    return factors[1] * np.stack([table.x, table.y], axis=1), deflections, std


def pillar_forces(
    positions: Any, deflections: Any, pillar: Pillar, *, noise: float | Any | None = None
) -> PillarForces:
    """Return the force on each post from its deflection: F = k d.

    Parameters
    ----------
    positions, deflections : array (n, 2)
        [m] along x and y; a deflection of NaN is a post that was not seen.
    pillar : Pillar
    noise : float or array (n, 2), optional
        Standard deviation of a deflection [m], such as that of posts that no cell touches; None: not known, and errors hold the stiffness alone.

    Raises
    ------
    InvalidInput
        Other shapes, no deflection, deflections longer than the post.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.microscopy import Pillar, pillar_forces
    >>> post = Pillar(diameter=2e-6, height=6e-6, youngs_modulus=2e6, modulus_error=0.1)
    >>> found = pillar_forces(np.array([[0, 0], [4e-6, 0]]), np.array([[2e-7, 0], [-2e-7, 1e-8]]), post, noise=2e-8)
    >>> (1e9 * found.forces).round(2).tolist(), str(found["mean_force"])
    ([[3.35, 0.0], [-3.35, 0.17]], 'mean force: 3.3 +- 0.4 nN')
    """
    at, deflection = np.asarray(positions, dtype=np.float64), np.asarray(deflections, dtype=np.float64)
    if at.ndim != 2 or at.shape[1:] != (2,) or deflection.shape != at.shape:
        raise InvalidInput(f"positions and deflections have the shape (n, 2); got {at.shape} and {deflection.shape}.")
    if np.isinf(deflection).any() or not np.isfinite(at).all():
        raise InvalidInput("positions must be finite, and deflections finite or NaN where a post was not seen.")
    deflection = np.where(np.isnan(deflection).any(axis=1, keepdims=True), np.nan, deflection)
    measured: Any = np.isfinite(deflection[:, 0])
    if not measured.any():
        raise InvalidInput("no post has a deflection: the table holds NaN alone, or marks every row as bad.")
    size = np.hypot(*deflection.T)
    longest = float(np.nanmax(size)) / pillar.height
    if longest > WRONG:
        raise InvalidInput(
            f"a deflection of {plain_number(1e6 * longest * pillar.height, 3)} µm is longer than the post ({plain_number(1e6 * pillar.height, 3)} µm): check the unit of deflections, the size of a pixel and the height."
        )
    error = (
        np.zeros_like(deflection)
        if noise is None
        else np.broadcast_to(np.asarray(noise, dtype=np.float64), deflection.shape)
    )
    if not np.isfinite(error[measured]).all() or float(error[measured].min()) < 0:
        raise InvalidInput("noise must be a standard deviation [m], finite and not negative.")
    k = pillar.stiffness
    common = k.std / k.value
    forces = k.value * deflection
    error_of_force = k.value * error
    std = np.hypot(error_of_force, common * np.abs(forces))
    f, s, e = forces[measured], np.hypot(*forces[measured].T), error_of_force[measured]
    count = len(f)
    # correct the magnitude for noise, which adds its square
    true = np.sqrt(np.maximum(s**2 - (e**2).sum(axis=1), 0.0))
    along = np.sqrt(((e * f) ** 2).sum(axis=1)) / np.maximum(s, 1e-300)
    top = int(s.argmax())

    def put(label: str, unit: str, value: float, noise_: float, power: float = 1.0) -> Quantity:
        return Quantity(label, unit, value, math.hypot(noise_, power * common * value))

    energy = 0.5 * (f**2 - e**2).sum() / k.value
    quantities = {
        "stiffness": k,
        "mean_force": put("mean force", "N", float(true.mean()), float(np.sqrt((along**2).sum())) / count),
        "largest_force": put("largest force", "N", float(s[top]), float(along[top])),
        "sum_of_forces": put("sum of sizes of force", "N", float(true.sum()), float(np.sqrt((along**2).sum()))),
        "net_force_x": put("net force along x", "N", float(f[:, 0].sum()), float(np.sqrt((e[:, 0] ** 2).sum()))),
        "net_force_y": put("net force along y", "N", float(f[:, 1].sum()), float(np.sqrt((e[:, 1] ** 2).sum()))),
        "strain_energy": put("strain energy", "J", float(energy), float(np.sqrt(((f * e) ** 2).sum()) / k.value)),
    }
    slender = pillar.height / pillar.diameter
    parts = pillar.compliances
    total = sum(parts.values())
    notes = [
        "of the deflection "
        + ", ".join(f"{100 * v / total:.0f} % is {name}" for name, v in parts.items() if v > 0)
        + f": bending alone would give forces {100 * (pillar.bending_alone / k.value - 1):.0f} % larger"
    ]
    if noise is None:
        notes.append(
            "the error of a deflection is not known, and in no error here: say noise= (--noise), such as the spread of posts that no cell touches"
        )
    if not (pillar.diameter_error and pillar.height_error and pillar.modulus_error):
        lacking = [n for n in ("diameter", "height", "modulus") if not getattr(pillar, f"{n}_error")]
        notes.append(
            f'{" and ".join(lacking)} {"is" if len(lacking) == 1 else "are"} taken as exact: say how well known, such as --{lacking[0]} "... +- 5 %"'
        )
    bent = int((size[measured] > BENT * pillar.height).sum())
    if bent:
        notes.append(
            f"{bent} of {count} posts bend by more than {BENT:g} of their height: beyond the linear beam, their forces are too small"
        )
    if slender < STOUT:
        notes.append(
            f"posts of a height of {slender:.2g} diameters are no beams: the formula was checked for more than {STOUT:g}"
        )
    if not measured.all():
        notes.append(f"{int((~measured).sum())} of {len(measured)} posts have no deflection")
    return PillarForces(pillar, at, deflection, forces, std, np.asarray(error), quantities, tuple(notes))


def _write(at: str, text: str) -> None:
    Path(at).write_text(text, encoding="utf-8")
