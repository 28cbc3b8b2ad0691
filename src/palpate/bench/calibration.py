"""Calibrate the error bars: fit their constants to a random population of contacts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bench.accuracy import run, spread_over
from palpate.bench.contacts import Patch, Traction, area_contact, line_contact
from palpate.bench.layouts import Layout
from palpate.bench.patches import pulled
from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.pad import Floats, Pad
from palpate.errors import InvalidInput
from palpate.inverse.contact.methods import Local
from palpate.inverse.linear.posterior import moment_rows
from palpate.inverse.linear.solution import BLIND
from palpate.recordings.files import atomically
from palpate.sensing import AreaArray, LineArray, ScatteredArray
from palpate.uncertainty import AMBIGUOUS, FEW, GAUSSIAN, Calibration, Case, Constants, constants

__all__ = ["beyond", "calibration", "crossing", "population", "write_constants"]

#: Quantities whose errors have a preferred sign: errors of pressure add up, because it is positive; edges are rounded;
#: weak shear is shrunk to zero.
SHIFTED = ("force", "peak_pressure", "shear_force", "slip_margin")


#: Channels for each kind of sensing: pressure alone, and with shear.
CHANNELS = {
    "stress": (["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"]),
    "strain": (["strain_zz"], ["strain_xz", "strain_yz", "strain_zz"]),
    "displacement": (["displacement_z"], ["displacement_x", "displacement_y", "displacement_z"]),
}


def population(
    rng: np.random.Generator, *, contact: str | None = None, sensing: str = "stress", body: str = "half-space"
) -> tuple[Layout, Traction, float]:
    """Return a random layout, contact (inside the array) and noise, none of which is one of `LAYOUTS`.

    ``contact`` is "line", "area", "area with shear" (default: any of them), one of the last two with ", few taxels" (3 to 11 by 3 to 11, which
    may be shallow) or "area, ambiguous" (a bonded gel of which the displacements in
    the plane are read; friction is known every other time); ``sensing`` and ``body`` are those of a
    `palpate.uncertainty.Case`.
    """
    noise = float(np.exp(rng.uniform(math.log(5e-4), math.log(7e-2))))
    ratio = float(rng.uniform(0.3, 0.5))
    line = rng.random() < 0.5
    if line if contact is None else contact == "line":
        count = int(rng.integers(60, 140))
        depth = float(rng.uniform(0.5, 2.5))
        array = LineArray(count=count, pitch=0.5, depth=depth, channels=CHANNELS[sensing][0])
        reach = 0.25 * count - 2.0 * array.depth  # room for contacts that lie inside the array
        parts = []
        for _ in range(int(rng.choice([1, 1, 2, 3]))):
            kind = str(rng.choice(["cylinder", "punch", "strip", "wedge", "tilted", "bump"]))
            width = float(np.exp(rng.uniform(math.log(0.6), math.log(min(9.0, 0.8 * reach)))))
            parts.append((kind, float(rng.uniform(-1, 1) * (reach - width)), width, float(rng.uniform(0.4, 1.0))))
        return Layout("line", _body(body, ratio, depth, rng), array, {}), line_contact(*parts), noise
    ambiguous, few_taxels = contact == AMBIGUOUS, (contact or "").endswith(FEW)
    shear = rng.random() < 0.3
    shear = shear if contact is None else ambiguous or contact.startswith("area with shear")
    size = int(rng.integers(14, 25 if shear else 33)) if not ambiguous else int(rng.integers(6, 10))
    depth = float(rng.uniform(1.0, 3.0)) if not ambiguous else float(rng.uniform(0.0, 1.5))
    channels = CHANNELS[sensing][int(shear)] if not ambiguous else ["displacement_x", "displacement_y"]
    shape = (size, size)
    smallest, largest = 1.2, 0.28 * size
    if few_taxels:
        shape = (int(rng.integers(3, 12)), int(rng.integers(3, 12)))
        size, depth = min(shape), float(rng.uniform(0.45, 2.0))
        smallest, largest = 0.5, 0.4 * size
    area = AreaArray(shape=shape, pitch=1.0, depth=depth, channels=channels)
    patches = []
    for _ in range(1 if shear or size < 6 else int(rng.choice([1, 1, 2]))):
        a, b = np.exp(rng.uniform(math.log(smallest), math.log(largest), size=2))
        kind = str(rng.choice(["ball", "ball", "punch", "block", "ring", "cone", "tilted"]))
        center = (float(rng.uniform(-0.15, 0.15) * size), float(rng.uniform(-0.15, 0.15) * size))
        patches.append(
            Patch(kind, center, (float(a), float(b)), float(rng.uniform(0.4, 1.0)), float(rng.uniform(0, 3)))
        )
    mu = float(rng.uniform(0.2, 0.9))
    traction = area_contact(
        *patches, shear=str(rng.choice(["slide", "stick", "twist", ""])) if shear else "", friction=mu
    )
    components = ("x", "y", "z") if shear else ("z",)
    pad = _body(body, ratio, depth, rng)
    friction_known = shear
    if ambiguous:
        layer = Layer(
            thickness=depth + float(rng.uniform(0.8, 3.0)), youngs_modulus=1.0, poissons_ratio=min(ratio, 0.49)
        )
        pad, friction_known = BondedLayers([layer]), bool(rng.random() < 0.5)
    return Layout("area", pad, area, {}, components, mu if friction_known else None), traction, noise


def _body(body: str, ratio: float, depth: float, rng: np.random.Generator) -> Pad:
    """Return a half-space, or a layer on a rigid base 1.05 to 3 times as deep as the taxels."""
    if body == "half-space":
        return HalfSpace(youngs_modulus=1.0, poissons_ratio=ratio)
    thickness = depth * float(rng.uniform(1.05, 3.0))
    return BondedLayers([Layer(thickness=thickness, youngs_modulus=1.0, poissons_ratio=min(ratio, 0.495))])


def crossing(rng: np.random.Generator, *, contact: str | None = None) -> tuple[Layout, Traction, float]:
    """Return a random frame like `population` whose contact crosses the edge of the array: from almost all inside to
    more than half outside.

    ``contact`` is None (stress in half-spaces) or "area, ambiguous" (scattered markers in a bonded gel).
    """
    if contact == AMBIGUOUS:
        return _across_markers(rng)
    noise = float(np.exp(rng.uniform(math.log(5e-4), math.log(7e-2))))
    pad = HalfSpace(youngs_modulus=1.0, poissons_ratio=float(rng.uniform(0.3, 0.5)))
    part, side = float(rng.uniform(-0.95, 0.5)), float(rng.choice([-1, 1]))
    peak = float(rng.uniform(0.4, 1.0))
    if rng.random() < 0.5:
        count = int(rng.integers(60, 140))
        line = LineArray(count=count, pitch=0.5, depth=float(rng.uniform(0.5, 2.5)), channels=["stress_zz"])
        kind = str(rng.choice(["cylinder", "punch", "strip", "wedge", "tilted", "bump"]))
        width = float(np.exp(rng.uniform(0.0, math.log(9.0))))
        traction = line_contact((kind, side * (0.25 * count + part * width), width, peak))
        return Layout("line", pad, line, {}), traction, noise
    shear = rng.random() < 0.3
    channels = ["stress_xz", "stress_yz", "stress_zz"] if shear else ["stress_zz"]
    size = int(rng.integers(14, 20 if shear else 26))
    area = AreaArray(shape=(size, size), pitch=1.0, depth=float(rng.uniform(1.0, 3.0)), channels=channels)
    a, b = (float(v) for v in np.exp(rng.uniform(math.log(1.2), math.log(0.28 * size), size=2)))
    kind = str(rng.choice(["ball", "ball", "punch", "block", "ring", "cone", "tilted"]))
    center = (side * (0.5 * size + part * 0.5 * (a + b)), float(rng.uniform(-0.5, 0.5) * size))
    patch = Patch(kind, center if rng.random() < 0.5 else center[::-1], (a, b), peak, float(rng.uniform(0, 3)))
    mu = float(rng.uniform(0.2, 0.9))
    traction = area_contact(patch, shear=str(rng.choice(["slide", "stick", "twist", ""])) if shear else "", friction=mu)
    components = ("x", "y", "z") if shear else ("z",)
    return Layout("area", pad, area, {}, components, mu if shear else None), traction, noise


def _across_markers(rng: np.random.Generator) -> tuple[Layout, Traction, float]:
    """Return a contact across the edge or the corner of markers that are tracked in the plane of a bonded gel."""
    noise = float(np.exp(rng.uniform(math.log(3e-3), math.log(3e-2))))
    shape = (int(rng.integers(5, 9)), int(rng.integers(6, 10)))
    y, x = (np.arange(n) - 0.5 * (n - 1) for n in shape)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = places + rng.uniform(0.0, 0.1) * rng.standard_normal(places.shape)
    depth = float(rng.uniform(0.1, 0.8))
    array = ScatteredArray(positions=places, depth=depth, channels=["displacement_x", "displacement_y"])
    layer = Layer(
        thickness=depth + float(rng.uniform(1.0, 2.5)),
        youngs_modulus=1.0,
        poissons_ratio=float(rng.uniform(0.4, 0.49)),
    )
    a, b = np.exp(rng.uniform(math.log(0.7), math.log(1.6), size=2))
    edge = np.array([x[-1], y[-1]]) + rng.uniform(-0.95, 0.5) * np.array([a, b])
    if rng.random() < 0.5:  # an edge, not a corner
        edge[int(rng.integers(2))] *= float(rng.uniform(0.0, 0.6))
    center = edge * rng.choice([-1.0, 1.0], 2)
    kind = str(rng.choice(["ball", "ball", "punch", "block", "ring", "cone", "tilted"]))
    patch = Patch(kind, (float(center[0]), float(center[1])), (float(a), float(b)), 1.0, float(rng.uniform(0, 3)))
    mu = float(rng.uniform(0.2, 0.9))
    traction = area_contact(patch, shear=str(rng.choice(["slide", "stick", "twist", ""])), friction=mu)
    friction = mu if rng.random() < 0.5 else None
    return Layout("markers", BondedLayers([layer]), array, {}, ("x", "y", "z"), friction), traction, noise


def calibration(
    frames: int = 400,
    *,
    method: str = "adaptive",
    contact: str | None = None,
    sensing: str = "stress",
    body: str = "half-space",
    seed: int = 12345,
    jobs: int = 1,
    report: Callable[[int], None] | None = None,
) -> dict[Case, dict[str, tuple[float, float, float]]]:
    """Return for each case and quantity the shift, scale and degrees of freedom with which the intervals of 50 and 95
    % have their coverage.

    From a random `population` of contacts; of `method="local"` from `pulled` patches, whatever ``contact``, ``sensing`` and ``body``.
    """
    z: dict[Case, dict[str, list[Floats]]] = {}
    tasks = [(seed, i, method, contact, sensing, body) for i in range(frames)]
    for i, (case, errors) in enumerate(spread_over(_one_frame, tasks, jobs)):
        for quantity, values in errors.items():
            z.setdefault(case, {}).setdefault(quantity, []).append(values)
        if report is not None:
            report(i + 1)
    ordered = sorted(z.items(), key=lambda item: str(item[0]))
    return {
        case: {
            quantity: _fit(values, shifted=quantity in SHIFTED and method != Local.name)
            for quantity, values in sorted(errors.items())
        }
        for case, errors in ordered
    }


def _one_frame(task: tuple[int, int, str, str | None, str, str]) -> tuple[Case, dict[str, Floats]]:
    seed, index, method, contact, sensing, body = task
    rng = np.random.default_rng((seed, index))
    if method == Local.name:
        return _one_pulled(rng)
    layout, traction, noise = population(rng, contact=contact, sensing=sensing, body=body)
    # linear methods never estimate exactly zero outside the array; `beyond` gives the error there
    inside = method in GAUSSIAN
    return layout.case, run(layout, "random", traction, noise, rng, (method,), yardstick=False, inside=inside)[0].z


def _one_pulled(rng: np.random.Generator) -> tuple[Case, dict[str, Floats]]:
    """Return errors divided by standard deviations for a frame of `pulled` patches with random signs; none if its
    notes say that the noise is unknown.
    """
    frame = pulled(rng)
    touch = frame.skin.reconstruct(frame.readings, method=Local.name, components=["x", "y"])
    if touch._errors is None:
        raise InvalidInput(f'method="{Local.name}" has no error bars.')
    errors = touch._errors.posterior
    if str(touch.methods) != Local.name or any(note.startswith(BLIND) for note in touch.notes):
        return touch.calibration_case, {}
    strong = np.hypot(*frame.truth)
    on = strong > 0.05 * strong.max()
    traction = np.concatenate([frame.truth, np.zeros((1, *on.shape))])
    moment = (moment_rows(touch.surface)[2] * traction).sum()
    z = {
        "traction": ((frame.truth - np.asarray(touch.values)[:2]) / np.asarray(errors.traction)[:2])[:, on].ravel(),
        "force": (touch.surface.total_force(traction) - np.asarray(touch.force))[:2] / np.asarray(errors.force)[:2],
        "moment": (moment - np.asarray(touch.moment)[2:]) / np.asarray(errors.moment)[2:],
    }
    return touch.calibration_case, {name: np.concatenate([v, -v]) for name, v in z.items()}


def beyond(
    found: Mapping[Case, Mapping[str, tuple[float, float, float]]],
    frames: int = 200,
    *,
    method: str,
    seed: int = 54321,
    jobs: int = 1,
    report: Callable[[int], None] | None = None,
) -> dict[Case, float]:
    """Return, for each case, the relative error of load outside the array with which the 95 % interval of the force
    has its coverage.

    It uses contacts of the same kind that cross the edge (`crossing`: stress in half-spaces, markers in bonded gels).
    """
    kinds = {case.contact for case in found}
    rows: dict[str, list[tuple[float, float, float]]] = {kind: [] for kind in kinds}
    for i, (kind, row) in enumerate(spread_over(_one_beyond, [(seed, i, method, kinds) for i in range(frames)], jobs)):
        if row is not None:
            rows[kind].append(row)
        if report is not None:
            report(i + 1)
    out = {}
    for case, quantities in found.items():
        force = Calibration(*quantities["force"])
        half = force.quantile(0.95)
        needed = []
        for error, std, outside in rows[case.contact]:
            left = (abs(error - force.shift * std) / half) ** 2 - (force.scale * std) ** 2
            needed.append(0.0 if left <= 0 else math.sqrt(left) / max(outside, 1e-300))
        if len(needed) >= 20:
            out[case] = round(min(float(np.quantile(needed, 0.95)), 1.0), 3)
    return out


def _one_beyond(task: tuple[int, int, str, set[str]]) -> tuple[str, tuple[float, float, float] | None]:
    """Return (contact, (error, std, fraction outside) of the normal force) for a frame whose contact crosses the edge."""
    seed, index, method, kinds = task
    rng = np.random.default_rng((seed, index))
    layout, traction, noise = crossing(rng, contact=AMBIGUOUS if kinds == {AMBIGUOUS} else None)
    kind = layout.case.contact
    if kind not in kinds:
        return kind, None
    readings, truth = layout.make(traction)
    readings = readings + noise * float(np.abs(readings).max()) * rng.standard_normal(readings.shape)
    options: dict[str, Any] = {} if method in GAUSSIAN else {"friction": layout.friction}
    touch = layout.skin.reconstruct(readings, method=method, components=list(layout.components), **options)
    if touch._errors is None:
        raise InvalidInput(f'method="{method}" has no error bars.')
    true = float(touch.surface.integral(truth[-1]))
    return kind, (
        true - float(touch.force[-1]),
        float(touch._errors.posterior.force[-1]),
        float(touch._errors.posterior.outside_force[-1]),
    )


def write_constants(
    path: str | Path,
    found: Mapping[Case, Mapping[str, tuple[float, float, float]]],
    *,
    method: str,
    frames: int,
    seed: int,
    version: str,
    outside: Mapping[Case, float] | None = None,
) -> None:
    """Write new constants to the file of constants; entries of the same method and case are replaced, others kept.

    Cases without frames (shear if it is not estimated) take the nearest entry. The fraction outside the array does so
    too if ``outside`` lacks it.
    """
    file = Path(path)
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        place = {(e["method"], e["contact"], e["sensing"], e["body"]): i for i, e in enumerate(data["entries"])}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InvalidInput(
            f"{path} is not a file of constants; give a copy of palpate/uncertainty/constants.json to put them into."
        ) from error
    for case, quantities in found.items():
        near = _nearest(data["entries"], method, case)
        part = (outside or {}).get(case)
        borrowed = sorted(set(near.quantities) - set(quantities))
        entry = {
            "method": method,
            "contact": case.contact,
            "sensing": case.sensing,
            "body": case.body,
            "outside": near.outside if part is None else part,
            "population": {
                "description": f"random {'patches' if method == Local.name else 'contacts'} and noise, palpate.bench."
                + ("pulled" if method == Local.name else "population"),
                "frames": frames,
                "seed": seed,
                "version": version,
                "borrowed": f"{', '.join((['outside'] if part is None else []) + borrowed) or 'nothing'} from {near.case}",
            },
            "quantities": {
                **{q: [c.shift, c.scale, c.freedom] for q, c in near.quantities.items() if q in borrowed},
                **{q: list(numbers) for q, numbers in quantities.items()},
            },
        }
        here = place.get((method, case.contact, case.sensing, case.body))
        if here is None:
            place[method, case.contact, case.sensing, case.body] = len(data["entries"])
            data["entries"].append(entry)
        else:
            data["entries"][here] = entry

    def write(name: str) -> None:
        Path(name).write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")

    atomically(file, write)


def _nearest(entries: Sequence[Mapping[str, Any]], method: str, case: Case) -> Constants:
    """Constants that a case takes over: the nearest of its contact, or of areas with shear, which have all."""
    near = constants(method, case)
    if near.calibrated:
        return near
    for entry in entries:
        if entry["method"] == method and entry["contact"] == "area with shear":
            quantities = {name: Calibration(*numbers) for name, numbers in entry["quantities"].items()}
            donor = Case(entry["contact"], entry["sensing"], entry["body"])
            return Constants(method, donor, quantities, entry["outside"], entry["population"])
    return near


def _fit(frames: Sequence[Floats], *, shifted: bool) -> tuple[float, float, float]:
    """Return (shift, scale, freedom) of b + s t_nu with the right fraction of errors within its 50 and 95 % intervals."""
    import scipy.optimize
    import scipy.special

    values = np.concatenate(frames)
    weights = np.concatenate([np.full(len(v), 1.0 / len(v)) for v in frames])
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    quartiles = np.interp([0.25, 0.5, 0.75], share, values[order])
    shift = float(0.5 * (quartiles[0] + quartiles[2])) if shifted else 0.0
    size = np.abs(values - shift)
    order = np.argsort(size)
    share = np.cumsum(weights[order]) / weights.sum()
    half, most = np.interp([0.5, 0.95], share, size[order])

    def miss(log_freedom: float) -> float:
        nu = math.exp(log_freedom)
        return float(scipy.special.stdtrit(nu, 0.975) / scipy.special.stdtrit(nu, 0.75) - most / half)

    low, high = math.log(0.6), math.log(1e4)
    if miss(low) < 0:
        log_freedom = low
    elif miss(high) > 0:
        log_freedom = high
    else:
        log_freedom = float(scipy.optimize.brentq(miss, low, high))
    freedom = math.exp(log_freedom)
    # if no Student distribution fits both levels, use the geometric mean of the scales that fit each
    scale = float(np.sqrt(half / scipy.special.stdtrit(freedom, 0.75) * most / scipy.special.stdtrit(freedom, 0.975)))
    return round(shift, 3), round(scale, 3), round(freedom, 2)
