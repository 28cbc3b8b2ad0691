"""Measure the accuracy for combinations of contacts, noise and methods, relative to the clairvoyant filter."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.bench.contacts import Traction
from palpate.bench.layouts import LAYOUTS, Layout
from palpate.elastic.pad import Floats
from palpate.inverse.contact.methods import Automatic
from palpate.inverse.method import Method
from palpate.inverse.registry import method_named, methods
from palpate.touch import Touch, intervals
from palpate.uncertainty import calibrated, constants

__all__ = [
    "DEFAULT",
    "NOISES",
    "Record",
    "accuracy",
    "accuracy_markdown",
    "coverage",
    "measured",
    "ratios",
    "run",
    "spread_over",
    "standardised",
    "table",
]

#: Noise levels, as fractions of the largest reading.
NOISES = (1e-3, 1e-2, 5e-2)

#: Name in records and tables of the automatic method, which on these contacts is the adaptive one.
DEFAULT = "adaptive"


@dataclass(frozen=True)
class Record:
    """One reconstruction compared with the truth.

    ``method`` is the requested method, ``found_by`` the one whose constants scale its error bars ``z``.
    """

    layout: str
    contact: str
    noise: float
    method: str
    error: float
    clairvoyant: float
    z: dict[str, Floats]
    found_by: str

    @property
    def ratio(self) -> float:
        """Error relative to that of the clairvoyant filter."""
        return self.error / self.clairvoyant


def standardised(touch: Touch, truth: Floats, friction: float | None, *, inside: bool = False) -> dict[str, Floats]:
    """Return (true - estimated)/std of the model for every quantity. Cells are those in contact, truly or as
    estimated.

    With ``inside`` the error of load outside the array is left out.
    """
    grid = touch.surface
    columns = [grid.components.index(c) for c in touch.components]
    true = Touch(truth, grid, touch.components, "truth")
    known = constants(touch.method, touch.calibration_case)
    if inside:
        known = replace(known, outside=0.0)

    def z(of: str, value: Any, mu: float | None = None) -> Floats:
        found, std, outside, _ = intervals.uncalibrated(touch, known, of, mu)
        return known.quantities[of].standardised(np.asarray(value), found, std, outside)

    # if traction may have either sign, use every cell
    found_contact = np.asarray(touch.contact() if known.signed else touch.values[-1] > 0)
    out = {
        "traction": z("traction", truth)[columns][:, (truth[-1] > 0) | found_contact],
        "force": z("force", true.force)[-1:],
        "moment": z("moment", true.moment),
        "center_of_pressure": z("center_of_pressure", true.center_of_pressure),
        "peak_pressure": z("peak_pressure", true.peak_pressure),
    }
    if len(columns) > 1:
        found, std, outside, _ = intervals.uncalibrated(touch, known, "force")
        away = np.sign(found)
        shear = known.quantities.get("shear_force", known.quantities["force"])
        out["shear_force"] = shear.standardised(away * true.force, away * found, std, outside)[columns[:-1]]
    if friction is not None:
        out["slip_margin"] = z("slip_margin", true.slip_margin(friction), friction)
    return {
        k: np.nan_to_num(np.ravel(v).astype(np.float64), nan=0.0, posinf=99.0, neginf=-99.0)
        for k, v in out.items()
        if np.size(v)
    }


def run(
    layout: Layout,
    name: str,
    traction: Traction,
    noise: float,
    rng: np.random.Generator,
    asked: Iterable[str | Method],
    *,
    yardstick: bool = True,
    inside: bool = False,
) -> list[Record]:
    """Evaluate one noise draw of one contact by the requested methods. Without ``yardstick`` the error of the
    clairvoyant filter is NaN.

    Methods with an option for friction get the layout's, unless they have one. ``inside``: see `standardised`.
    """
    readings, truth = layout.make(traction)
    std = noise * float(np.abs(readings).max())
    noisy = readings + std * rng.standard_normal(readings.shape)
    key = (name, noise)
    if not yardstick:
        clairvoyant = math.nan
    elif key in layout.yardsticks:
        clairvoyant = layout.yardsticks[key]
    else:
        clairvoyant = layout.yardsticks[key] = layout.clairvoyant(layout.middle.get(name, traction), std)
    columns = [layout.skin.surface.components.index(c) for c in layout.components]
    size = float(np.linalg.norm(truth[columns]))
    records = []
    for method in asked:
        touch = layout.skin.reconstruct(
            noisy, method=_with_friction(method, layout), components=list(layout.components)
        )
        error = float(np.linalg.norm((np.asarray(touch.values) - truth)[columns])) / size
        z = standardised(touch, truth, layout.friction, inside=inside) if touch.has_intervals else {}
        records.append(Record(layout.name, name, noise, str(method), error, clairvoyant, z, touch.method))
    return records


def _with_friction(method: str | Method, layout: Layout) -> Method:
    """Return the method, with the layout's friction if it has that option."""
    if isinstance(method, Method):
        unset = getattr(method, "friction", 0) is None  # 0: it has no such option
        return replace(method, friction=layout.friction) if unset else method  # type: ignore[call-arg]
    name = Automatic.name if method == DEFAULT else method
    return method_named(name, {"friction": layout.friction} if "friction" in methods()[name].options() else {})


def measured(layout: Layout, method: Method | None = None, *, comparisons: bool = True) -> tuple[str | Method, ...]:
    """Return the methods that `accuracy` measures on a layout: ``method`` or the default, and those for comparison."""
    first = DEFAULT if method is None else method
    return (first, *(m for m in layout.methods if m != str(first))) if comparisons else (first,)


def accuracy(
    layouts: Sequence[str] = tuple(LAYOUTS),
    noises: Sequence[float] = NOISES,
    *,
    draws: int = 2,
    seed: int = 0,
    method: Method | None = None,
    comparisons: bool = True,
    jobs: int = 1,
    report: Callable[[Record], None] | None = None,
) -> list[Record]:
    """Measure every contact of the layouts at every noise level, ``draws`` times; the default method is automatic."""
    tasks = [
        (name, noise, contact, draws, seed, method, comparisons)
        for name in layouts
        for noise in noises
        for contact in LAYOUTS[name].contacts
    ]
    records = []
    for some in spread_over(_one_contact, tasks, jobs):
        for record in some:
            records.append(record)
            if report is not None:
                report(record)
    return records


def _one_contact(task: tuple[str, float, str, int, int, Method | None, bool]) -> list[Record]:
    name, noise, contact, draws, seed, method, comparisons = task
    layout = LAYOUTS[name]
    out = []
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw, zlib.crc32(f"{name} {contact} {noise}".encode())])
        out += run(
            layout,
            contact,
            layout.contacts[contact],
            noise,
            rng,
            measured(layout, method, comparisons=comparisons),
        )
    return out


def ratios(records: Sequence[Record], method: str = DEFAULT) -> dict[tuple[str, str, float], float]:
    """Mean error over draws, relative to the clairvoyant filter's, for each layout, contact and noise level."""
    groups: dict[tuple[str, str, float], list[float]] = {}
    for r in records:
        if r.method == method:
            groups.setdefault((r.layout, r.contact, r.noise), []).append(r.ratio)
    return {k: float(np.mean(v)) for k, v in groups.items()}


def coverage(records: Sequence[Record], level: float, method: str = DEFAULT) -> dict[str, float]:
    """Fraction of true values inside the interval of this level, by quantity; contacts and noise weigh equally."""
    inside: dict[str, dict[tuple[str, str, float], list[float]]] = {}
    zero, one, none = np.asarray(0.0), np.asarray(1.0), np.asarray(-math.inf)
    for record in records:
        if record.method != method:
            continue
        for quantity, z in record.z.items():
            known = calibrated(record.found_by, LAYOUTS[record.layout].case, quantity)
            low, high = (float(v) for v in known.bounds(level, zero, one, zero, none))
            # every frame has the same weight, however many cells it has
            group = inside.setdefault(quantity, {}).setdefault((record.layout, record.contact, record.noise), [])
            group.append(float(np.mean((z >= low) & (z <= high))))
    return {quantity: float(np.mean([np.mean(v) for v in groups.values()])) for quantity, groups in inside.items()}


def accuracy_markdown(records: Sequence[Record], *, command: str) -> str:
    """Return both tables as Markdown: errors relative to the clairvoyant filter's, and the coverage of intervals.
    ``command`` is the command that made them.
    """
    noises = sorted({r.noise for r in records})
    lines = [
        f"Written by `{command}`. Error divided by that of the clairvoyant filter: geometric mean over the contacts (worst contact):",
        "",
        "| layout | method |" + "".join(f" noise {100 * n:g} % |" for n in noises) + " all |",
        "|---|---|" + "---|" * (len(noises) + 1),
    ]
    cells: dict[tuple[str, str], dict[float, str]] = {}
    for layout, method, noise, mean, worst, _ in table(records):
        cells.setdefault((layout, method), {})[math.inf if math.isnan(noise) else noise] = f"{mean:.2f} ({worst:.2f})"
    for (layout, method), row in cells.items():
        lines.append(f"| {layout} | {method} | " + " | ".join(row.get(n, "-") for n in (*noises, math.inf)) + " |")
    layouts = list(dict.fromkeys(r.layout for r in records))
    parts = {name: [r for r in records if r.layout == name] for name in layouts}
    parts["all contacts"] = list(records)
    for method in dict.fromkeys(r.method for r in records):
        held = {name: (coverage(some, 0.5, method), coverage(some, 0.95, method)) for name, some in parts.items()}
        if not held["all contacts"][0]:
            continue
        names = [name for name in parts if held[name][0]]
        lines += [
            "",
            f"Share of the true values inside the 50 % interval, then inside the 95 % interval ({method}):",
            "",
        ]
        lines += ["| quantity | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
        for quantity in held["all contacts"][0]:
            inside = (
                f"{held[n][0][quantity]:.2f}, {held[n][1][quantity]:.2f}" if quantity in held[n][0] else ""
                for n in names
            )
            title = "normal force" if quantity == "force" else quantity.replace("_", " ")
            lines.append(f"| {title} | " + " | ".join(inside) + " |")
    return "\n".join([*lines, ""])


def spread_over(function: Callable[[Any], Any], tasks: Sequence[Any], jobs: int) -> Iterable[Any]:
    """Yield results in order, computed by ``jobs`` processes."""
    if jobs == 1:
        yield from map(function, tasks)
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # start new interpreters: a forked one would inherit the state of threaded linear algebra
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(function, tasks, chunksize=1)


def table(records: Sequence[Record]) -> list[tuple[str, str, float, float, float, int]]:
    """Return (layout, method, noise, geometric mean of the ratios, largest ratio, contacts), largest noise last."""
    rows = []
    methods = list(dict.fromkeys(r.method for r in records))
    for method in methods:
        found: Mapping[tuple[str, str, float], float] = ratios(records, method)
        for layout in dict.fromkeys(k[0] for k in found):
            for noise in (*sorted({k[2] for k in found}), math.nan):
                some = [v for k, v in found.items() if k[0] == layout and (math.isnan(noise) or k[2] == noise)]
                if some:
                    rows.append((layout, method, noise, float(np.exp(np.mean(np.log(some)))), max(some), len(some)))
    return rows
