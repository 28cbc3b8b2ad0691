"""Evaluate many designs: every combination of the variables, ranked."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.design.columns import NUMBERS, value_text
from palpate.design.press import Press
from palpate.design.result import Design, evaluate
from palpate.design.variations import varied
from palpate.elastic.pad import Pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, PalpateError
from palpate.inverse.observability import observable_components
from palpate.sensing.arrays import Array
from palpate.sensing.uncertainty import Uncertainty

if TYPE_CHECKING:
    import xarray


__all__ = ["Sweep", "combinations", "sweep", "swept"]

#: Quantities of the score, with equal weights. A larger range is better; of all others, a smaller number is.
SCORED = ("force", "shear", "center", "pair", "noticed", "range")
#: Largest number of designs: more take an hour or longer.
MAX_DESIGNS = 20_000
#: Words for a larger and for a smaller value of each variable.
_DIRECTIONS = {
    "depth": ("Deeper than {}", "Less deep than {}"),
    "thickness": ("With a pad thicker than {}", "With a pad thinner than {}"),
    "pitch": ("With taxels farther apart than {}", "With taxels closer than {}"),
    "aperture": ("With taxels larger than {}", "With taxels smaller than {}"),
    "noise": ("With more noise than {}", "With less noise than {}"),
    "youngs_modulus": ("With a pad stiffer than {}", "With a pad softer than {}"),
}
_GOALS = {
    "force": "no design determines the normal force to +-{}",
    "shear": "no design determines the shear force to +-{}",
    "center": "no design determines the centre to +-{}",
    "radius": "no design determines the contact radius to +-{}",
    "friction_reserve": "no design determines the friction reserve to +-{}",
    "pair": "a pair {} apart cannot be resolved at this noise",
    "width": "a point looks wider than {}",
    "wavelength": "a wave {} long cannot be recovered at this noise",
    "noticed": "a force of {} is not detected",
    "blind": "more than {} of the array is blind",
    "range": "the range ends below {}",
}


@dataclass(frozen=True)
class Sweep:
    """Designs and their variables.

    Attributes
    ----------
    points : tuple of dict
        Values of the variables for each design.
    designs : tuple of Design
    skipped : tuple of (dict, str)
        Combinations that cannot be built, and why.
    goals : dict
        Numbers (`Design.numbers`) that a design must not exceed; of "range" must reach.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.design import sweep
    >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=2e3)
    >>> found = sweep(pp.Skin(pad, array), depth=[1e-3, 2e-3, 6e-3], goals={"pair": 3.5e-3})
    >>> found.ranked("noticed").points[0], found.meets().tolist()
    ({'depth': 0.001}, [True, True, False])

    >>> bool(found.numbers("noticed")[0] < found.numbers("noticed")[1])  # taxels near the surface notice more
    True

    >>> print(found.notes()[0])
    Deeper than 2 mm a pair 3.5 mm apart cannot be resolved at this noise.

    >>> print(found.text(columns=["force"]).splitlines()[0].split())
    ['depth', 'force', '[mN]', 'score', 'goals']

    >>> found.csv().splitlines()[0][:30], found.dataset().sizes["design"]
    ('depth,force,shear,center,radiu', 3)
    """

    points: tuple[dict[str, Any], ...]
    designs: tuple[Design, ...]
    skipped: tuple[tuple[dict[str, Any], str], ...] = ()
    goals: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.designs)

    def numbers(self, name: str) -> Any:
        """One number of each design, in SI units (`Design.numbers`), or "score".

        Raises
        ------
        InvalidInput
            The name of an unknown number.
        """
        if name == "score":
            return self._scores()
        if name not in NUMBERS:
            raise InvalidInput(f"{name!r} is not a number of a design; accepted: score, {', '.join(NUMBERS)}.")
        return np.array([d.numbers()[name] for d in self.designs])

    def unit(self, name: str) -> str:
        """Unit of a column of the table: of forces "mN" or "N", in line contact "mN/m" or "N/m".

        Examples
        --------
        >>> import palpate as pp
        >>> from palpate.design import sweep
        >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=9, pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
        >>> found = sweep(pp.Skin(pad, array), depth=[1e-3, 2e-3])
        >>> found.unit("force"), found.unit("pair")
        ('mN/m', 'mm')
        """
        unit = NUMBERS[name][2]
        return f"{unit}/m" if unit in ("mN", "N") and self.designs[0].dimensions == 1 else unit

    def _scores(self) -> Any:
        """Geometric mean of the ratios of each number to that of the best design: 1 means best in all."""
        logs = []
        for name in SCORED:
            values = self.numbers(name)
            values = 1.0 / values if name == "range" else values
            # ignore components that only some designs estimate; a design with an undetermined quantity comes last
            if np.isnan(values).any() or not np.isfinite(values).any() or not values.min() > 0:
                continue
            logs.append(np.log(values / values.min()))
        return np.exp(np.mean(logs, axis=0)) if logs else np.ones(len(self))

    def meets(self) -> Any:
        """Whether each design meets all goals."""
        out = np.ones(len(self), dtype=bool)
        for name, goal in self.goals.items():
            out &= self._reaches(name, goal)
        return out

    def _reaches(self, name: str, goal: float) -> Any:
        values = self.numbers(name)
        return values >= goal if name == "range" else values <= goal

    def ranked(self, by: str = "score") -> Sweep:
        """Return the designs sorted: those that meet the goals first, then by a number, smallest first (largest first
        for "range").

        Raises
        ------
        InvalidInput
            The name of an unknown number.
        """
        values = self.numbers(by)
        values = np.nan_to_num(-values if by == "range" else values, nan=math.inf, posinf=math.inf)
        order = np.lexsort((values, ~self.meets()))
        return Sweep(
            tuple(self.points[i] for i in order), tuple(self.designs[i] for i in order), self.skipped, self.goals
        )

    def notes(self) -> list[str]:
        """The values at which a goal is no longer met, in plain words; and designs that could not be built."""
        out = []
        for goal, most in self.goals.items():
            reached = self._reaches(goal, most)
            said = _GOALS[goal].format(f"{NUMBERS[goal][1] * most:.3g} {self.unit(goal)}")
            if not reached.any():
                out.append(f"Of these {len(self)} designs none meets a goal: {said}.")
                continue
            for axis, (larger, smaller) in _DIRECTIONS.items():
                values = [p.get(axis) for p in self.points]
                if not values or not all(isinstance(v, float | int) for v in values):
                    continue
                v = np.asarray(values, dtype=np.float64)
                low, high = v[reached].min(), v[reached].max()
                unit = self.designs[0].noise_unit if axis == "noise" else ""
                if (v > high).any():
                    out.append(f"{larger.format(value_text(axis, high, unit))} {said}.")
                if (v < low).any():
                    out.append(f"{smaller.format(value_text(axis, low, unit))} {said}.")
        why: dict[str, int] = {}
        for _, reason in self.skipped:
            why[reason] = why.get(reason, 0) + 1
        out += [f"Left out {n} design{'s' if n > 1 else ''}: {reason}" for reason, n in why.items()]
        return out

    def dataset(self) -> xarray.Dataset:
        """A dataset with the axis "design": the variables, and the numbers in SI units."""
        import xarray

        columns: dict[str, Any] = {name: ("design", self.numbers(name)) for name in (*NUMBERS, "score")}
        for name in dict.fromkeys(key for p in self.points for key in p):
            columns[f"varied_{name}"] = ("design", [_plain(p.get(name)) for p in self.points])
        return xarray.Dataset(columns)

    def text(
        self,
        *,
        most: int | None = None,
        columns: Sequence[str] = ("force", "shear", "center", "pair", "width", "noticed", "range"),
    ) -> str:
        """A table, one design a line, in order; columns without any number are left out."""
        axes = list(dict.fromkeys(key for p in self.points for key in p))
        shown = [c for c in columns if not np.isnan(self.numbers(c)).all()]
        head = [*axes, *(f"{c} [{self.unit(c)}]" for c in shown), "score", *(["goals"] if self.goals else [])]
        scores, meets = self._scores(), self.meets()
        rows = [head]
        for i, point in enumerate(self.points[:most]):
            values = self.designs[i].numbers()
            row = [value_text(a, point.get(a), self.designs[i].noise_unit if a == "noise" else "") for a in axes]
            row += [_cell(values[c] * NUMBERS[c][1]) for c in shown]
            row.append(_cell(float(scores[i])))
            rows.append([*row, *([("met" if meets[i] else "-")] if self.goals else [])])
        widths = [max(len(r[j]) for r in rows) for j in range(len(head))]
        lines = ["  ".join(cell.rjust(w) for cell, w in zip(row, widths)) for row in rows]
        left = len(self) - (len(rows) - 1)
        return "\n".join([*lines, *([f"... and {left} more"] if left else [])])

    def csv(self) -> str:
        """All designs as comma-separated text: the variables, the numbers in SI units, the score."""
        axes = list(dict.fromkeys(key for p in self.points for key in p))
        lines = [",".join([*axes, *NUMBERS, "score"])]
        for point, made, score in zip(self.points, self.designs, self._scores()):
            values = made.numbers()
            row = [str(_plain(point.get(a, ""))).replace(",", " ") for a in axes]
            lines.append(",".join([*row, *(f"{values[c]:.6g}" for c in NUMBERS), f"{score:.6g}"]))
        return "\n".join(lines) + "\n"

    def plot(self, x: str | None = None, *, columns: Sequence[str] = ("force", "center", "pair", "noticed")) -> Any:
        """Trade-offs: each number against one axis of the sweep (a matplotlib Figure, as wide as a journal's page).

        Raises
        ------
        InvalidInput
            An axis that was not varied, or an unknown number.

        Examples
        --------
        >>> import palpate as pp
        >>> from palpate.design import sweep
        >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
        >>> array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=500.0)
        >>> figure = sweep(pp.Skin(pad, array), depth=[1e-3, 2e-3], pitch=[1e-3, 2e-3]).plot("depth")
        """
        from palpate.design.figures import plot_sweep

        return plot_sweep(self, x, columns)


def _plain(value: Any) -> Any:
    return (
        " ".join(value)
        if isinstance(value, list | tuple) and value and isinstance(value[0], str)
        else str(value)
        if isinstance(value, list | tuple)
        else value
    )


def _cell(value: float) -> str:
    return "-" if math.isnan(value) else "none" if math.isinf(value) else f"{value:.3g}"


def combinations(values: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Return every combination of the values; the last varies fastest.

    Raises
    ------
    InvalidInput
        Nothing to vary, an axis without values, or too many combinations.
    """
    for name, given in values.items():
        if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) or len(given) == 0:
            raise InvalidInput(f"{name} must be a list of values to try; got {given!r}. Write [{given!r}].")
    count = math.prod(len(v) for v in values.values())
    if count > MAX_DESIGNS:
        raise InvalidInput(
            f"the sweep has {count:,} combinations (at most {MAX_DESIGNS:,}). Give fewer values for each axis."
        )
    return [dict(zip(values, chosen)) for chosen in itertools.product(*values.values())]


def _evaluate(job: tuple[Pad, tuple[Array, ...], dict[str, Any], str, Press, Any, Uncertainty]) -> Design | str:
    pad, planes, changes, keep, press, nuisance, uncertainty = job
    try:
        body, arrays = varied(pad, planes, changes, keep=keep)
        names = observable_components(body, arrays)
        return evaluate(body, arrays, press, names, nuisance=nuisance, uncertainty=uncertainty)
    except PalpateError as error:
        return str(error)


def swept(
    pad: Pad,
    planes: Sequence[Array],
    press: Press,
    values: Mapping[str, Sequence[Any]],
    *,
    keep: str = "taxels",
    goals: Mapping[str, float] | None = None,
    nuisance: Sequence[str] | None = None,
    uncertainty: Uncertainty | None = None,
    jobs: int = 1,
    progress: Callable[[Any], Any] = iter,
) -> Sweep:
    """Return the `sweep` of a pad and planes; ``progress`` wraps the iteration over designs.

    Raises
    ------
    InvalidInput
        An unknown goal, axis or value, or a sweep of which no combination can be built; the message says why.
    """
    if keep not in ("taxels", "area"):
        raise InvalidInput(f'keep must be "taxels" or "area": what a new pitch keeps fixed; got {keep!r}.')
    if keep == "area" and {"pitch", "shape"} <= set(values):
        raise InvalidInput(
            'keep="area" changes the shape with the pitch, and the sweep varies the shape too. Vary one of them, or take keep="taxels".'
        )
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
        raise InvalidInput(f"jobs must be a whole number of processes, at least 1; got {jobs!r}.")
    for name, goal in (goals or {}).items():
        if name not in NUMBERS:
            raise InvalidInput(f"a goal cannot be {name!r}; accepted: {', '.join(NUMBERS)}.")
        if isinstance(goal, bool) or not isinstance(goal, float | int) or not goal > 0 or math.isinf(goal):
            raise InvalidInput(f"the goal {name} must be a positive number in SI units; got {goal!r}.")
    elastic = pad.elastic if isinstance(pad, Viscoelastic) else pad
    points = combinations(values)
    work = [(elastic, tuple(planes), p, keep, press, nuisance, uncertainty or Uncertainty()) for p in points]
    if jobs == 1 or len(work) == 1:
        found = list(progress(map(_evaluate, work)))
    else:
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        with ProcessPoolExecutor(min(jobs, len(work)), mp_context=multiprocessing.get_context("spawn")) as pool:
            found = list(progress(pool.map(_evaluate, work, chunksize=max(1, len(work) // (8 * jobs)))))
    good = [(p, d) for p, d in zip(points, found) if isinstance(d, Design)]
    bad = [(p, d) for p, d in zip(points, found) if isinstance(d, str)]
    if not good:
        raise InvalidInput(f"no combination of the sweep can be built: {bad[0][1]}")
    return Sweep(tuple(p for p, _ in good), tuple(d for _, d in good), tuple(bad), dict(goals or {}))


def sweep(
    skin: Any,
    *,
    press: Press | None = None,
    keep: str = "taxels",
    goals: Mapping[str, float] | None = None,
    jobs: int = 1,
    **values: Sequence[Any],
) -> Sweep:
    """The designs of every combination of ``values`` (depth, thickness, youngs_modulus, pitch, shape, aperture, channels, noise).

    Parameters
    ----------
    skin : Skin
        The skin to vary; its array needs noise.
    press : Press, optional
        The press; default: 1 N over a radius of 2 mm.
    keep : "taxels" or "area"
        Property that stays constant when the pitch changes. "area" cannot be combined with values of shape.
    goals : dict, optional
        Numbers that a design must not exceed, in SI units; of "range" must reach.
    jobs : int
        Processes. A script with more than one needs ``if __name__ == "__main__":``.

    Raises
    ------
    InvalidInput
        An unknown goal, axis or value, or a sweep of which no combination can be built.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.design import sweep
    >>> pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=500.0)
    >>> found = sweep(pp.Skin(pad, array), depth=[1e-3, 3e-3], channels=[["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"]])
    >>> len(found), found.ranked().points[0]["depth"]
    (4, 0.001)
    """
    nuisance = skin.problem().nuisance
    pressed = press or Press(force=1.0, contact_radius=2e-3)
    return swept(
        skin.pad,
        skin.planes,
        pressed,
        values,
        keep=keep,
        goals=goals,
        nuisance=nuisance,
        uncertainty=skin.uncertainty,
        jobs=jobs,
    )
