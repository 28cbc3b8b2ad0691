"""How accurate the inversion is, and whether its error bars are honest: contacts x noise x methods.

The yardstick is the clairvoyant Wiener filter: the linear shift-invariant filter with the least expected error for one contact,
given that contact's true power spectrum and the noise, on the array's own field repeated for ever. With fine wavevectors k + K
that alias to the k of the taxels, response H, cell average C = sinc, power P per component,

    E |error|^2 = sum_k  S - A (B + sigma^2 N)^{-1} A*,   S = sum_K C^2 P,  A = sum_K C P H*,  B = sum_K H P H*

which is the mean over the contact's position within a cell. No linear filter that does not know where the contact is does
better. Data are made on a surface ten (line) or six (area) times finer than the one sought, and wider.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from palpate._arrays import fftn
from palpate.elastic import BondedLayers, HalfSpace, Layer
from palpate.elastic.half_space import Floats, Pad
from palpate.elastic.quantities import transfer
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing import AreaArray, LineArray, LineGrid, ScatteredArray
from palpate.sensing.arrays import Array
from palpate.sensing.grids import Grid, block_means, refined
from palpate.skin import Skin
from palpate.touch import Touch, calibrated, calibration_case

__all__ = [
    "LAYOUTS",
    "NOISES",
    "Layout",
    "Patch",
    "Record",
    "accuracy",
    "area_contact",
    "calibration",
    "coverage",
    "crossing",
    "line_contact",
    "population",
]

#: Noise levels, as parts of the largest reading.
NOISES = (1e-3, 1e-2, 5e-2)
#: Cells of the surface the data are made on, per cell sought, and how many cells it is wider on each side.
FINER, WIDER = {1: 10, 2: 6}, {1: 24, 2: 3}
#: Quantities whose error has a sign: pressure only adds up, edges are rounded, weak shear is drawn to zero.
SHIFTED = ("force", "peak_pressure", "shear_force", "slip_margin")

Traction = Callable[[Grid], Floats]


# -- contacts ----------------------------------------------------------------------------------------------------------


def line_contact(*parts: tuple[str, float, float, float]) -> Traction:
    """Sum of (kind, centre, half-width, size) on a line, as exact cell means."""

    def cells(grid: Grid) -> Floats:
        if not isinstance(grid, LineGrid):
            raise InvalidInput(f"a line contact needs a LineGrid; got {type(grid).__name__}.")
        out = np.zeros((2, grid.count))
        for kind, center, half_width, size in parts:
            u = np.clip((grid.edges - center) / half_width, -1, 1)
            integral = {
                "cylinder": 0.5 * (u * np.sqrt(1 - u**2) + np.arcsin(u)),
                "punch": np.arcsin(u),
                "strip": u,
                "wedge": np.where(u < 0, u + u**2 / 2, u - u**2 / 2),
                "tilted": u + u**2 / 2,
                "bump": u - u**3 / 3,
            }[kind]
            out[1] += size * half_width * np.diff(integral) / grid.spacing
        return out

    return cells


@dataclass(frozen=True)
class Patch:
    """One contact patch on an area."""

    kind: str
    center: tuple[float, float]
    size: tuple[float, float]
    peak: float = 1.0
    angle: float = 0.0

    def __call__(self, x: Floats, y: Floats) -> Floats:
        c, s = math.cos(self.angle), math.sin(self.angle)
        u = ((x - self.center[0]) * c + (y - self.center[1]) * s) / self.size[0]
        v = (-(x - self.center[0]) * s + (y - self.center[1]) * c) / self.size[1]
        r2 = u**2 + v**2
        shapes: dict[str, Callable[[], Floats]] = {
            "ball": lambda: np.sqrt(np.clip(1 - r2, 0, None)),
            "punch": lambda: np.where(r2 < 1, 0.5 / np.sqrt(np.clip(1 - r2, 0.02, None)), 0.0),
            "block": lambda: np.where((np.abs(u) < 1) & (np.abs(v) < 1), 1.0, 0.0),
            "ring": lambda: np.where((r2 < 1) & (r2 > 0.44), 1.0, 0.0),
            "cone": lambda: np.clip(1 - np.sqrt(r2), 0, None),
            "tilted": lambda: np.where((np.abs(u) < 1) & (np.abs(v) < 1), 0.5 + 0.5 * u, 0.0),
        }
        return self.peak * shapes[self.kind]()


def area_contact(*patches: Patch, shear: str = "", friction: float = 0.0) -> Traction:
    """Patches on an area, with shear inside the friction cone: "slide", "stick" (growing outwards) or "twist"."""

    def cells(grid: Grid) -> Floats:
        y, x = np.meshgrid(*grid.axes, indexing="ij")
        p = sum((patch(x, y) for patch in patches), np.zeros(grid.shape))
        out = np.zeros((3, *grid.shape))
        out[2] = p
        if shear == "slide":
            out[0], out[1] = 0.8 * friction * p, 0.6 * friction * p
        elif shear == "stick":
            r2 = ((x - patches[0].center[0]) / patches[0].size[0]) ** 2 + (
                (y - patches[0].center[1]) / patches[0].size[1]
            ) ** 2
            out[0] = friction * p * np.clip(r2, 0.15, 1.0)
        elif shear == "twist":
            dx, dy = x - patches[0].center[0], y - patches[0].center[1]
            reach = max(patches[0].size)
            out[0], out[1] = -friction * p * dy / reach, friction * p * dx / reach
            excess = np.maximum(np.hypot(dx, dy) / reach, 1.0)
            out[:2] /= excess
        return out

    return cells


LINE_CONTACTS: dict[str, Traction] = {
    "cylinder": line_contact(("cylinder", 0, 3.5, 1)),
    "punch": line_contact(("punch", 0, 3.5, 1)),
    "small cylinder": line_contact(("cylinder", 4.3, 1.2, 1)),
    "large cylinder": line_contact(("cylinder", -3.1, 9, 1)),
    "strip": line_contact(("strip", 1.17, 2, 1)),
    "wide punch": line_contact(("punch", 2.2, 8.1, 1)),
    "two cylinders": line_contact(("cylinder", -6, 3, 1), ("cylinder", 5, 4, 0.6)),
    "two punches": line_contact(("punch", -4, 1.5, 1), ("punch", 4.2, 1.5, 1)),
    "wedge": line_contact(("wedge", 0.4, 5, 1)),
    "tilted": line_contact(("tilted", 0, 4, 1)),
    "three": line_contact(("strip", -8, 1, 1), ("strip", 0, 1, 0.5), ("cylinder", 8, 2, 1)),
    "narrow": line_contact(("strip", 0.3, 0.6, 1)),
    "bump on cylinder": line_contact(("cylinder", -2, 6, 1), ("strip", 1.5, 1, 1)),
}

AREA_PATCHES: dict[str, tuple[Patch, ...]] = {
    "ball": (Patch("ball", (0.3, -0.2), (5, 5)),),
    "small ball": (Patch("ball", (-3.1, 2.3), (2.5, 2.5)),),
    "large ball": (Patch("ball", (0, 0.5), (7.5, 7.5)),),
    "punch": (Patch("punch", (0.2, 0.4), (4, 4)),),
    "block": (Patch("block", (1, -2), (3, 5), angle=0.4),),
    "ellipse": (Patch("ball", (0, 0), (7, 3), angle=0.6),),
    "ring": (Patch("ring", (0, 0), (6, 6)),),
    "two balls": (Patch("ball", (-4, -2), (3, 3)), Patch("ball", (4, 3), (4, 4), 0.6)),
    "cone": (Patch("cone", (0.5, 0), (6, 6)),),
    "dots": (
        Patch("block", (-5, -5), (1, 1)),
        Patch("block", (4, -4), (1.5, 1.5)),
        Patch("ball", (0, 5), (2.5, 2.5), 0.5),
    ),
    "bar": (Patch("block", (0, 0), (7.5, 1.2), angle=0.3),),
}
#: Contacts whose middle lies two units inside the edge of the line array (at 30), and the same in its middle.
CROSSING: dict[str, tuple[str, float, float]] = {
    "cylinder": ("cylinder", 28, 3.5),
    "strip": ("strip", 28, 3.5),
    "punch": ("punch", 28, 3.5),
    "wedge": ("wedge", 28, 4.5),
}
FRICTION = 0.5
SHEARED: dict[str, tuple[str, str]] = {
    "sliding ball": ("ball", "slide"),
    "sticking ball": ("ball", "stick"),
    "twisted ball": ("ball", "twist"),
    "sliding block": ("block", "slide"),
    "sticking ellipse": ("ellipse", "stick"),
    "sliding punch": ("punch", "slide"),
    "pressed cone": ("cone", ""),
    "sliding small ball": ("small ball", "slide"),
}


# -- layouts -----------------------------------------------------------------------------------------------------------


@dataclass
class Layout:
    """An array on a pad, the contacts it meets, and what is asked of it.

    ``middle`` holds the same contacts in the middle of the array, for the yardstick, where they cross its edge.
    """

    name: str
    pad: Pad
    array: Array
    contacts: dict[str, Traction]
    components: tuple[str, ...] = ("z",)
    friction: float | None = None
    methods: tuple[str, ...] = ("tikhonov",)
    middle: dict[str, Traction] = field(default_factory=dict)
    yardsticks: dict[tuple[str, float], float] = field(default_factory=dict)

    @cached_property
    def skin(self) -> Skin:
        """What a user would make; the noise is not given."""
        return Skin(self.pad, self.array)

    @cached_property
    def maker(self) -> Skin:
        """The finer and wider skin that makes the data."""
        grid = self.skin.surface
        return Skin(self.pad, self.array, surface=refined(grid, FINER[grid.dimensions], WIDER[grid.dimensions]))

    def make(self, traction: Traction) -> tuple[Floats, Floats]:
        """Noise-free readings, and the mean traction (component, *surface) of each cell sought."""
        fine = traction(self.maker.surface)
        d = self.skin.surface.dimensions
        middle: tuple[Any, ...] = (..., *(slice(WIDER[d], -WIDER[d]),) * d)
        mean = block_means(fine, FINER[d], d)[middle]
        return np.nan_to_num(np.asarray(self.maker.sense(fine))), mean

    def clairvoyant(self, traction: Traction, noise: float) -> float:
        """Least expected relative error of a linear shift-invariant filter told the truth (see the module)."""
        array = self.array
        if isinstance(array, ScatteredArray):
            raise Unsupported("the clairvoyant filter needs a regular array; got a ScatteredArray.")
        grid = array.grid
        ratio, d = FINER[grid.dimensions], grid.dimensions
        fine = refined(grid, ratio)
        columns = [grid.components.index(c) for c in self.components]
        values = traction(fine)[columns]
        power = np.abs(fftn(values, d) / ratio**d) ** 2
        waves = [2 * np.pi * np.fft.fftfreq(n, dx) for n, dx in zip(fine.shape, fine.spacings)]
        ky, kx = (np.zeros(1), waves[0]) if d == 1 else (waves[0][:, None], waves[1][None, :])
        response = transfer(self.pad, kx, ky, array.depth, array.channels, line=d == 1)
        response = np.nan_to_num(response)
        columns3 = [{"x": 0, "y": 1, "z": 2}[c] for c in self.components]
        h = np.moveaxis(response[..., columns3], (-2, -1), (0, 1)).reshape(
            len(array.channels), len(columns), *fine.shape
        )
        average = np.ones(fine.shape)
        for axis, (k, dx) in enumerate(zip(waves, grid.spacings)):
            average = average * np.sinc(k * dx / (2 * np.pi)).reshape([-1 if a == axis else 1 for a in range(d)])

        def fold(x: Any) -> Any:
            lead = x.shape[: x.ndim - d]
            split: list[int] = []
            for n in grid.shape:
                split += [ratio, n]
            return x.reshape(*lead, *split).sum(axis=tuple(len(lead) + 2 * a for a in range(d)))

        cross = fold((average * power)[None] * np.conj(h))  # (channel, component, *k)
        data = fold(np.einsum("cj...,dj...,j...->cd...", h, np.conj(h), power))
        signal = fold(average**2 * power)
        count = math.prod(grid.shape)
        data = np.moveaxis(data, (0, 1), (-2, -1)) + noise**2 * count * np.eye(len(array.channels))
        rows = np.moveaxis(cross, (0, 1), (-2, -1))
        gain = np.real((rows * np.linalg.solve(data, np.conj(rows))).sum(axis=-2))
        left = np.moveaxis(signal, 0, -1) - gain
        return float(np.sqrt(left.sum() / signal.sum()))


def _layouts() -> dict[str, Layout]:
    soft = HalfSpace(youngs_modulus=1.0, poissons_ratio=0.49)
    line = LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"])
    area = AreaArray(shape=(32, 32), pitch=1.0, depth=2.0, channels=["stress_zz"])
    three = AreaArray(shape=(32, 32), pitch=1.0, depth=2.0, channels=["stress_xz", "stress_yz", "stress_zz"])
    gel = BondedLayers([Layer(thickness=3.0, youngs_modulus=1.0, poissons_ratio=0.48)])
    markers = AreaArray(
        shape=(20, 20), pitch=1.0, depth=1.5, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    pressed = {name: area_contact(*patches) for name, patches in AREA_PATCHES.items()}
    sheared = {name: area_contact(*AREA_PATCHES[p], shear=s, friction=FRICTION) for name, (p, s) in SHEARED.items()}
    few = {k: sheared[k] for k in ("sliding ball", "sticking ball", "sliding block", "pressed cone")}
    family = ("tikhonov", "nnls", "elastic_net", "tv", "maxent", "network")
    rubber = HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    dead = line.masked(np.random.default_rng(0).random(line.shape) > 0.1)
    crossing = {name: line_contact((kind, x, w, 1.0)) for name, (kind, x, w) in CROSSING.items()}
    middle = {name: line_contact((kind, 0.0, w, 1.0)) for name, (kind, x, w) in CROSSING.items()}
    return {
        "line": Layout("line", rubber, line, LINE_CONTACTS, methods=family),
        "dead taxels": Layout("dead taxels", rubber, dead, LINE_CONTACTS),
        "across the edge": Layout("across the edge", rubber, line, crossing, middle=middle),
        "area": Layout("area", soft, area, pressed),
        "three channels": Layout("three channels", soft, three, sheared, ("x", "y", "z"), FRICTION),
        "bonded displacement": Layout("bonded displacement", gel, markers, few, ("x", "y", "z"), FRICTION),
    }


LAYOUTS = _layouts()


# -- records -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Record:
    """One reconstruction against the truth."""

    layout: str
    contact: str
    noise: float
    method: str
    error: float
    clairvoyant: float
    z: dict[str, Floats]

    @property
    def ratio(self) -> float:
        """Error over that of the clairvoyant filter."""
        return self.error / self.clairvoyant


def _standardised(touch: Touch, truth: Floats, friction: float | None) -> dict[str, Floats]:
    """(true - found)/std of the model for every quantity; cells are those in contact, in truth or as found."""
    grid = touch.surface
    columns = [grid.components.index(c) for c in touch.components]
    true = Touch(truth, grid, touch.components, "truth")

    case = calibration_case(grid.dimensions, touch.components)

    def z(of: str, value: Any, mu: float | None = None) -> Floats:
        found, std, outer, _ = touch.uncalibrated(of, mu)
        return calibrated(touch.method, case, of).standardised(np.asarray(value), found, std, outer)

    out = {
        "traction": z("traction", truth)[columns][:, (truth[-1] > 0) | (np.asarray(touch.values)[-1] > 0)],
        "force": z("force", true.force)[-1:],
        "moment": z("moment", true.moment),
        "center_of_pressure": z("center_of_pressure", true.center_of_pressure),
        "peak_pressure": z("peak_pressure", true.peak_pressure),
    }
    if len(columns) > 1:
        found, std, outer, _ = touch.uncalibrated("force")
        away = np.sign(found)
        known = calibrated(touch.method, case, "shear_force")
        out["shear_force"] = known.standardised(away * true.force, away * found, std, outer)[columns[:-1]]
    if friction is not None:
        out["slip_margin"] = z("slip_margin", true.slip_margin(friction), friction)
    return {
        k: np.nan_to_num(np.ravel(v).astype(np.float64), nan=0.0, posinf=99.0, neginf=-99.0)
        for k, v in out.items()
        if np.size(v)
    }


def run(
    layout: Layout, name: str, traction: Traction, noise: float, rng: np.random.Generator, methods: Iterable[str]
) -> list[Record]:
    """One noise draw of one contact, by the methods asked for."""
    readings, truth = layout.make(traction)
    std = noise * float(np.abs(readings).max())
    noisy = readings + std * rng.standard_normal(readings.shape)
    key = (name, noise)
    if key not in layout.yardsticks or name == "random":
        layout.yardsticks[key] = layout.clairvoyant(layout.middle.get(name, traction), std)
    yardstick = layout.yardsticks[key]
    columns = [layout.skin.surface.components.index(c) for c in layout.components]
    size = float(np.linalg.norm(truth[columns]))
    records = []
    for method in methods:
        options: dict[str, Any] = {"friction": layout.friction} if method in ("adaptive", "constrained") else {}
        if method != "adaptive":
            options["method"] = method
        touch = layout.skin.reconstruct(noisy, components=list(layout.components), **options)
        error = float(np.linalg.norm((np.asarray(touch.values) - truth)[columns])) / size
        z = _standardised(touch, truth, layout.friction) if touch.errors is not None else {}
        records.append(Record(layout.name, name, noise, method, error, yardstick, z))
    return records


def accuracy(
    layouts: Sequence[str] = tuple(LAYOUTS),
    noises: Sequence[float] = NOISES,
    *,
    draws: int = 2,
    seed: int = 0,
    family: bool = True,
    jobs: int = 1,
    report: Callable[[Record], None] | None = None,
) -> list[Record]:
    """Every contact of the layouts at every noise level, ``draws`` times."""
    tasks = [
        (name, noise, contact, draws, seed, family)
        for name in layouts
        for noise in noises
        for contact in LAYOUTS[name].contacts
    ]
    records = []
    for some in _spread_over(_one_contact, tasks, jobs):
        for record in some:
            records.append(record)
            if report is not None:
                report(record)
    return records


def _one_contact(task: tuple[str, float, str, int, int, bool]) -> list[Record]:
    name, noise, contact, draws, seed, family = task
    layout = LAYOUTS[name]
    out = []
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw, zlib.crc32(f"{name} {contact} {noise}".encode())])
        out += run(
            layout, contact, layout.contacts[contact], noise, rng, ("adaptive", *(layout.methods if family else ()))
        )
    return out


def ratios(records: Sequence[Record], method: str = "adaptive") -> dict[tuple[str, str, float], float]:
    """Mean error over draws, over the clairvoyant filter's, of each layout, contact and noise."""
    groups: dict[tuple[str, str, float], list[float]] = {}
    for r in records:
        if r.method == method:
            groups.setdefault((r.layout, r.contact, r.noise), []).append(r.ratio)
    return {k: float(np.mean(v)) for k, v in groups.items()}


def coverage(records: Sequence[Record], level: float, method: str = "adaptive") -> dict[str, float]:
    """Part of true values inside the interval of that level, for each quantity; every contact and noise counts alike."""
    inside: dict[str, dict[tuple[str, str, float], list[float]]] = {}
    zero, one, none = np.asarray(0.0), np.asarray(1.0), np.asarray(-math.inf)
    for record in records:
        if record.method != method:
            continue
        for quantity, z in record.z.items():
            layout = LAYOUTS[record.layout]
            known = calibrated(method, calibration_case(layout.array.dimensions, layout.components), quantity)
            low, high = (float(v) for v in known.bounds(level, zero, one, zero, none))
            # every frame counts once, however many cells it has
            group = inside.setdefault(quantity, {}).setdefault((record.layout, record.contact, record.noise), [])
            group.append(float(np.mean((z >= low) & (z <= high))))
    return {quantity: float(np.mean([np.mean(v) for v in groups.values()])) for quantity, groups in inside.items()}


# -- calibration -------------------------------------------------------------------------------------------------------


def population(rng: np.random.Generator) -> tuple[Layout, Traction, float]:
    """A random layout, contact (inside the array) and noise, none of them those of `LAYOUTS`."""
    noise = float(np.exp(rng.uniform(math.log(5e-4), math.log(7e-2))))
    modulus = HalfSpace(youngs_modulus=1.0, poissons_ratio=float(rng.uniform(0.3, 0.5)))
    if rng.random() < 0.5:
        count = int(rng.integers(60, 140))
        array = LineArray(count=count, pitch=0.5, depth=float(rng.uniform(0.5, 2.5)), channels=["stress_zz"])
        reach = 0.25 * count - 2.0 * array.depth  # contacts end inside the array
        parts = []
        for _ in range(int(rng.choice([1, 1, 2, 3]))):
            kind = str(rng.choice(["cylinder", "punch", "strip", "wedge", "tilted", "bump"]))
            width = float(np.exp(rng.uniform(math.log(0.6), math.log(min(9.0, 0.8 * reach)))))
            parts.append((kind, float(rng.uniform(-1, 1) * (reach - width)), width, float(rng.uniform(0.4, 1.0))))
        return Layout("line", modulus, array, {}), line_contact(*parts), noise
    shear = rng.random() < 0.3
    channels = ["stress_xz", "stress_yz", "stress_zz"] if shear else ["stress_zz"]
    size = int(rng.integers(14, 25 if shear else 33))
    area = AreaArray(shape=(size, size), pitch=1.0, depth=float(rng.uniform(1.0, 3.0)), channels=channels)
    patches = []
    for _ in range(1 if shear else int(rng.choice([1, 1, 2]))):
        a, b = np.exp(rng.uniform(math.log(1.2), math.log(0.28 * size), size=2))
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
    return Layout("area", modulus, area, {}, components, mu if shear else None), traction, noise


def crossing(rng: np.random.Generator) -> tuple[Layout, Traction, float]:
    """The same with a contact across the array's edge: from almost all of it inside to more than half beyond."""
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


def calibration(
    frames: int = 400,
    *,
    method: str = "adaptive",
    seed: int = 12345,
    jobs: int = 1,
    report: Callable[[int], None] | None = None,
) -> dict[tuple[str, str], tuple[float, float, float]]:
    """(what is sought, quantity): shift, scale and degrees of freedom that make the intervals of 50 and 95 % hold.

    From a random population of contacts.
    """
    z: dict[tuple[str, str], list[Floats]] = {}
    tasks = [(seed, i, method) for i in range(frames)]
    for i, (case, found) in enumerate(_spread_over(_one_frame, tasks, jobs)):
        for quantity, values in found.items():
            z.setdefault((case, quantity), []).append(values)
        if report is not None:
            report(i + 1)
    return {key: _fit(values, shifted=key[1] in SHIFTED) for key, values in sorted(z.items())}


def _one_frame(task: tuple[int, int, str]) -> tuple[str, dict[str, Floats]]:
    seed, index, method = task
    rng = np.random.default_rng((seed, index))
    layout, traction, noise = population(rng)
    case = calibration_case(layout.array.dimensions, layout.components)
    return case, run(layout, "random", traction, noise, rng, (method,))[0].z


def _spread_over(function: Callable[[Any], Any], tasks: Sequence[Any], jobs: int) -> Iterable[Any]:
    """Results in order, from ``jobs`` processes."""
    if jobs == 1:
        yield from map(function, tasks)
        return
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # a fresh interpreter each: a forked one would share the state of threaded linear algebra
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(function, tasks, chunksize=1)


def _fit(frames: Sequence[Floats], *, shifted: bool) -> tuple[float, float, float]:
    """(shift, scale, freedom) of b + s t_nu with the right share of errors within its 50 and 95 % intervals."""
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
    # between the two levels where no Student distribution fits both
    scale = float(np.sqrt(half / scipy.special.stdtrit(freedom, 0.75) * most / scipy.special.stdtrit(freedom, 0.975)))
    return round(shift, 3), round(scale, 3), round(freedom, 2)


def table(records: Sequence[Record]) -> list[tuple[str, str, float, float, float, int]]:
    """(layout, method, noise, geometric mean of the ratios, largest ratio, contacts), largest noise last."""
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
