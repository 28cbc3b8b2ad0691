"""palpate beside what people would use instead: the same input, the same answer checked first, then time, error and memory.

    python benchmarks/peers.py [--sizes 128 256] [--only NAME ...] [--write]

Each program runs in a process of its own, on one thread (set OMP_NUM_THREADS=1). Times are processor seconds: what is prepared once with the first frame
("first"), and a frame after that ("then"); memory is what the process needs beyond the input. What is not installed is left out and said:

    pip install scikit-image pyproximal ContactMechanics
    pip install --no-deps pyTFM

``--write`` writes docs/_generated/peers.md.
"""

from __future__ import annotations

import argparse
import importlib
import json
import resource
import subprocess
import sys
import tempfile
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft
import scipy.optimize
import scipy.signal

import palpate as pp
from palpate.sensing.grids import block_means, refined

TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "peers.md"
#: Cells across, each a thirtieth of an adhesion's length apart; noise as a part of the largest reading.
PITCH, FINER, NOISE = 0.6e-6, 3, 0.02
GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
PLANE = ["displacement_x", "displacement_y"]
DEPTH = 2.0  # of the pressure's sensors, in pitches
REPEATS = 3
#: Seconds by the clock that a program may take in all.
LONGEST = 150
Solve = Callable[[], Any]


# -- the problems ------------------------------------------------------------------------------------------------------


def patches(grid: pp.AreaGrid, rng: np.random.Generator, *, push: bool) -> np.ndarray:
    """Traction (component, y, x) [Pa]: adhesions that pull towards the middle, or a dozen that press."""
    y, x = np.meshgrid(*grid.axes, indexing="ij")
    reach = np.ptp(grid.x)
    out = np.zeros((3, *grid.shape))
    for angle in 2 * np.pi * (np.arange(10) + 0.6 * rng.random(10)) / 10:
        radius = rng.uniform(0.15, 0.3) * reach
        u, v = x - radius * np.cos(angle), y - radius * np.sin(angle)
        along, across = u * np.cos(angle) + v * np.sin(angle), -u * np.sin(angle) + v * np.cos(angle)
        on = (along / (rng.uniform(0.02, 0.04) * reach)) ** 2 + (across / (rng.uniform(0.02, 0.03) * reach)) ** 2 < 1
        size = rng.uniform(200.0, 1000.0)
        if push:
            out[2] += size * on
        else:
            out[0] -= size * np.cos(angle) * on
            out[1] -= size * np.sin(angle) * on
    if not push:
        for c in (0, 1):
            held = out[c] != 0
            out[c][held] -= out[c].sum() / held.sum()
    return out


def grid_of(size: int) -> pp.AreaGrid:
    return pp.AreaGrid(shape=(size, size), spacing=PITCH)


def array_of(size: int, channels: list[str], depth: float) -> pp.AreaArray:
    return pp.AreaArray(shape=(size, size), pitch=PITCH, depth=depth, channels=channels)


def made(size: int, kind: str) -> dict[str, np.ndarray]:
    """Truth and readings; the readings are made on cells three times finer, on a surface that does not repeat."""
    rng = np.random.default_rng(size)
    grid = grid_of(size)
    fine = refined(grid, FINER)
    if kind == "displacement":
        truth, array = patches(fine, rng, push=False), array_of(size, PLANE, 0.0)
    else:
        truth, array = patches(fine, rng, push=True), array_of(size, ["stress_zz"], DEPTH * PITCH)
    readings = np.asarray(pp.Skin(GEL, array, surface=fine).sense(truth))
    readings = readings + NOISE * np.abs(readings).max() * rng.standard_normal(readings.shape)
    return {"truth": block_means(truth, FINER, 2), "readings": readings}


# -- the programs: each gives a function that solves once --------------------------------------------------------------


def palpate_skin(size: int, kind: str, *, boundary: str = "free") -> pp.Skin:
    array = array_of(size, PLANE, 0.0) if kind == "displacement" else array_of(size, ["stress_zz"], DEPTH * PITCH)
    return pp.Skin(GEL, array, surface=grid_of(size), boundary=boundary, nuisance=())  # type: ignore[arg-type]


def palpate_of(kind: str, boundary: str = "free", **options: Any) -> Callable[[int, np.ndarray, np.ndarray], Solve]:
    sought = ["x", "y"] if kind == "displacement" else ["z"]

    def begin(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
        skin = palpate_skin(size, kind, boundary=boundary)
        return lambda: skin.reconstruct(readings, components=sought, **options).values

    return begin


def fttc_matrix(size: int) -> np.ndarray:
    """Boussinesq's and Cerruti's half-space in the plane for each wavevector of a real transform (Butler et al., Am. J. Physiol. 282, 2002)."""
    kx = 2 * np.pi * scipy.fft.rfftfreq(size, PITCH)[None, :]
    ky = 2 * np.pi * scipy.fft.fftfreq(size, PITCH)[:, None]
    k = np.hypot(kx, ky)
    k[0, 0] = 1.0
    nu, young = GEL.poissons_ratio, GEL.youngs_modulus
    front = 2 * (1 + nu) / young / k**3
    # a row at Nyquist is its own mirror image: the odd product has no sign there
    odd = kx * ky
    odd[size // 2, :] = odd[:, size // 2] = 0.0
    xx, yy, xy = (1 - nu) * k**2 + nu * ky**2, (1 - nu) * k**2 + nu * kx**2, -nu * odd
    matrix = front * np.array([[xx, xy], [xy, yy]])
    matrix[..., 0, 0] = 0.0
    return matrix


def own_fttc(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    """Everything anew for each frame, as such a function does."""
    return lambda: fttc(size, readings)[0]


def fttc(size: int, readings: np.ndarray, log: float | None = None) -> tuple[np.ndarray, float]:
    """FTTC with Tikhonov of order 0, lambda by generalised cross-validation (Golub, Heath and Wahba 1979): forty lines that anybody would write."""

    matrix = fttc_matrix(size)
    mean, half = 0.5 * (matrix[0, 0] + matrix[1, 1]), 0.5 * (matrix[0, 0] - matrix[1, 1])
    spread = np.hypot(half, matrix[0, 1])
    values = np.stack([mean + spread, mean - spread])  # eigenvalues of the symmetric 2 x 2
    angle = 0.5 * np.arctan2(matrix[0, 1], half)
    c, s = np.cos(angle), np.sin(angle)
    y = scipy.fft.rfft2(readings)
    turned = np.stack([c * y[0] + s * y[1], -s * y[0] + c * y[1]])
    twice = np.full(turned.shape[1:], 2.0)
    twice[:, 0] = 1.0
    if size % 2 == 0:
        twice[:, -1] = 1.0
    power, squares = twice * np.abs(turned) ** 2, values**2

    def gcv(log: float) -> float:
        kept = np.exp(log) / (squares + np.exp(log))
        return float(np.log((kept**2 * power).sum()) - 2 * np.log((kept * twice).sum()))

    top = np.log(squares.max())
    grid = np.linspace(top - 30, top, 31)
    best = grid[np.argmin([gcv(g) for g in grid])]
    chosen = (
        scipy.optimize.minimize_scalar(gcv, bounds=(best - 1, best + 1), method="bounded").x if log is None else log
    )
    filtered = values / (squares + np.exp(chosen)) * turned
    x = np.stack([c * filtered[0] - s * filtered[1], s * filtered[0] + c * filtered[1]])
    out = np.zeros((3, size, size))
    out[:2] = scipy.fft.irfft2(x, s=(size, size))
    return out, float(chosen)


def pytfm(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    """pyTFM's FTTC and its smoothing by a Gaussian. What it would import besides (image tracking, sorting of names) is not needed here."""
    import scipy.ndimage

    stand_ins = {
        "openpiv": {},
        "openpiv.filters": {},
        "openpiv.pyprocess": {"extended_search_area_piv": None},
        "openpiv.scaling": {},
        "openpiv.tools": {},
        "openpiv.validation": {},
        "natsort": {},
        "scipy.ndimage.filters": vars(scipy.ndimage),
    }
    for name, held in stand_ins.items():
        module = types.ModuleType(name)
        module.__dict__.update(held)
        sys.modules.setdefault(name, module)
    functions = importlib.import_module("pyTFM.TFM_functions")

    def solve() -> np.ndarray:
        out = np.zeros((3, size, size))
        # displacements in pixels, here of one pitch
        u, v = readings / PITCH
        out[0], out[1] = functions.ffttc_traction(u, v, PITCH, PITCH, GEL.youngs_modulus, GEL.poissons_ratio)
        return out

    return solve


def blur(size: int) -> np.ndarray:
    """What one cell of unit pressure does to the sensors around it: odd, so that it has a middle."""
    odd = size // 2 * 2 - 1
    skin = palpate_skin(odd, "stress")
    unit = np.zeros((3, odd, odd))
    unit[2, odd // 2, odd // 2] = 1.0
    return np.asarray(skin.sense(unit))[0]


def skimage_told(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    """`skimage.restoration.wiener` with the balance that the truth likes best (none is offered to be learned); that search is not timed."""
    restoration = importlib.import_module("skimage.restoration")
    psf = blur(size)

    def at(balance: float) -> np.ndarray:
        out = np.zeros((3, size, size))
        out[2] = restoration.wiener(readings[0], psf, balance, clip=False)
        return out

    balances = np.geomspace(1e-5, 10.0, 19)
    best = balances[np.argmin([np.linalg.norm(at(b) - truth) for b in balances])]
    return lambda: at(float(best))


def skimage_unsupervised(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    """`skimage.restoration.unsupervised_wiener`: both variances sampled (Orieux, Giovannelli and Rodet 2010)."""
    restoration = importlib.import_module("skimage.restoration")
    psf = blur(size)
    scale = np.abs(readings).max()  # its sampler begins at variances of 1

    def solve() -> np.ndarray:
        out = np.zeros((3, size, size))
        found, _ = restoration.unsupervised_wiener(readings[0] / scale, psf, clip=False, rng=0)
        out[2] = scale * found
        return out

    return solve


def pyproximal_push(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    """Pressure >= 0 and a first-derivative penalty by pyproximal's FISTA on FFT products, 200 steps; the penalty's weight that the truth likes best."""
    proximal, pylops = importlib.import_module("pyproximal"), importlib.import_module("pylops")
    operator = palpate_skin(size, "stress").operator

    def forward(p: np.ndarray) -> np.ndarray:
        return np.asarray(operator.forward(p.reshape(1, size, size), (2,))[0]).ravel()

    def adjoint(y: np.ndarray) -> np.ndarray:
        return np.asarray(operator.adjoint([y.reshape(1, size, size)], (2,))).ravel()

    blurred = pylops.FunctionOperator(forward, adjoint, size**2, size**2)
    gradient = pylops.Gradient((size, size), kind="forward", edge=False)
    target = np.concatenate([readings.ravel(), np.zeros(2 * size**2)])

    def at(weight: float) -> np.ndarray:
        term = proximal.L2(Op=pylops.VStack([blurred, np.sqrt(weight) * gradient]), b=target)
        # the pad only damps (its gain is 1 at the most), and differences have a norm of 8
        found = proximal.optimization.primal.AcceleratedProximalGradient(
            term, proximal.Box(lower=0.0), x0=np.zeros(size**2), tau=1.0 / (1.0 + 8.0 * weight), niter=200
        )
        out = np.zeros((3, size, size))
        out[2] = np.asarray(found[0] if isinstance(found, tuple) else found).reshape(size, size)
        return out

    weights = np.geomspace(1e-3, 1e-1, 5)
    best = weights[np.argmin([np.linalg.norm(at(w) - truth) for w in weights])]
    return lambda: at(float(best))


def palpate_forward(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    skin = pp.Skin(GEL, array_of(size, ["displacement_z"], 0.0), surface=grid_of(size))
    pressure = truth[2:]
    operator = skin.operator
    return lambda: np.asarray(operator.forward(pressure, (2,))[0])[0]


def contact_mechanics(size: int, readings: np.ndarray, truth: np.ndarray) -> Solve:
    """Its free half-space: the same influence of a uniformly loaded cell (Love 1929), zero-padded."""
    library = importlib.import_module("ContactMechanics")
    modulus = GEL.youngs_modulus / (1 - GEL.poissons_ratio**2)
    substrate = library.FreeFFTElasticHalfSpace((size, size), modulus, (size * PITCH, size * PITCH))
    # its displacements are those of the counterpart
    force = truth[2] * PITCH**2
    return lambda: -np.asarray(substrate.evaluate_disp(force))[:size, :size]


# name: (problem, begin, what it needs, said beside it)
PROGRAMS: dict[str, tuple[str, Callable[[int, np.ndarray, np.ndarray], Solve], str, str]] = {
    "palpate, tikhonov": ("displacement", palpate_of("displacement", method="tikhonov"), "", "free edge, evidence"),
    "palpate, tikhonov, gcv": (
        "displacement",
        palpate_of("displacement", method="tikhonov", rule="gcv"),
        "",
        "free edge",
    ),
    "palpate, periodic, order 0, gcv": (
        "displacement",
        palpate_of("displacement", "periodic", method="tikhonov", order=0, rule="gcv"),
        "",
        "what FTTC does",
    ),
    "own FTTC with GCV": ("displacement", own_fttc, "", "periodic"),
    "pyTFM, FTTC": ("displacement", pytfm, "pyTFM", "periodic; fixed Gaussian"),
    "palpate, tikhonov, pressure": ("stress", palpate_of("stress", method="tikhonov"), "", "free edge, evidence"),
    "palpate, automatic, pressure": ("stress", palpate_of("stress"), "", "free edge, error bars, noise learned"),
    "scikit-image, wiener": ("stress", skimage_told, "skimage", "balance from the truth"),
    "scikit-image, unsupervised_wiener": ("stress", skimage_unsupervised, "skimage", "periodic"),
    "pyproximal, FISTA": ("stress", pyproximal_push, "pyproximal", "pressure >= 0; weight from the truth"),
    "palpate, forward": ("forward", palpate_forward, "", "displacement_z, depth 0"),
    "ContactMechanics, forward": ("forward", contact_mechanics, "ContactMechanics", "displacement, depth 0"),
}


# -- the same answer ---------------------------------------------------------------------------------------------------


def agreement(size: int) -> dict[str, float]:
    """Largest differences between programs that compute the same, as a part of the largest value."""
    found: dict[str, float] = {}

    def differ(name: str, one: np.ndarray, other: np.ndarray) -> None:
        found[name] = float(np.abs(one - other).max() / np.abs(other).max())

    data, press = made(size, "displacement")["readings"], made(size, "stress")["truth"]
    own, log = fttc(size, data)
    ours = PROGRAMS["palpate, periodic, order 0, gcv"][1](size, data, press)()

    def away(at: float) -> float:
        return float(np.abs(fttc(size, data, at)[0] - ours).max() / np.abs(ours).max())

    nearest = scipy.optimize.minimize_scalar(
        away, bounds=(log - 0.2, log + 0.2), method="bounded", options={"xatol": 1e-9}
    )
    found["own FTTC | palpate, periodic, order 0, for the same lambda"] = float(nearest.fun)
    found["lambda by GCV, own | palpate (as a part of it)"] = abs(float(np.expm1(nearest.x - log)))
    differ("own FTTC with GCV | palpate, periodic, order 0, gcv", ours, own)
    if installed("pyTFM"):
        # without noise and smoothing FTTC is one division; a field that repeats and whose spectrum ends below Nyquist
        x = np.arange(size) * 2 * np.pi / size
        smooth = 1e-7 * np.stack(
            [np.sin(x)[None, :] * np.cos(2 * x)[:, None], np.cos(3 * x)[None, :] * np.sin(x)[:, None]]
        )
        pytfm(size, smooth, press)
        functions = importlib.import_module("pyTFM.TFM_functions")
        theirs = functions.ffttc_traction(
            *(smooth / PITCH), PITCH, PITCH, GEL.youngs_modulus, GEL.poissons_ratio, spatial_filter=None
        )
        back = fttc_matrix(size)
        spectrum = scipy.fft.rfft2(np.stack(theirs))
        again = scipy.fft.irfft2(np.einsum("ij...,j...->i...", back, spectrum), s=(size, size))
        differ("pyTFM, FTTC | our matrix of the half-space", again, smooth)
    if installed("skimage"):
        # a load in the middle: the circular convolution of scikit-image is then the free one
        truth = np.zeros((3, size, size))
        truth[2, size // 2 - 3 : size // 2 + 4, size // 2 - 2 : size // 2 + 2] = 500.0
        skin = palpate_skin(size, "stress")
        convolved = scipy.signal.fftconvolve(truth[2], blur(size), mode="same")
        differ("scikit-image's convolution | palpate, forward", convolved, np.asarray(skin.sense(truth))[0])
    if installed("ContactMechanics"):
        one = PROGRAMS["ContactMechanics, forward"][1](size, data, press)()
        differ(
            "ContactMechanics, forward | palpate, forward", one, PROGRAMS["palpate, forward"][1](size, data, press)()
        )
    return found


def installed(name: str) -> bool:
    import importlib.util

    return not name or importlib.util.find_spec(name) is not None


# -- measuring ---------------------------------------------------------------------------------------------------------


def peak() -> float:
    """The most memory that this process has had [MB] (on Linux not that of the process that started it)."""
    status = Path("/proc/self/status")
    if status.exists():
        return next(int(line.split()[1]) / 1024 for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(name: str, size: int, file: str) -> dict[str, float]:
    """One program on one problem, in this process."""
    kind, begin, needs, _ = PROGRAMS[name]
    with np.load(file) as held:
        truth, readings = held["truth"], held["readings"]
    if needs and needs != "pyTFM":
        importlib.import_module(needs)
    before = peak()
    start = time.process_time()
    solve = begin(size, readings, truth)
    if "from the truth" in PROGRAMS[name][3]:
        start = time.process_time()  # the time to find a parameter from the truth does not count
    found = solve()
    first = time.process_time() - start
    times = []
    for _ in range(REPEATS if first < 5 else 1):
        start = time.process_time()
        found = solve()
        times.append(time.process_time() - start)
    error = float("nan") if kind == "forward" else float(np.linalg.norm(found - truth) / np.linalg.norm(truth))
    memory = peak() - before
    return {"first": first, "then": min(times), "error": error, "memory": memory}


def row(name: str, size: int, folder: Path) -> dict[str, Any]:
    """The same in a process of its own; what fails says so."""
    kind, _, needs, _ = PROGRAMS[name]
    if not installed(needs):
        return {"failed": "not installed"}
    file = folder / f"{kind}-{size}.npz"
    if not file.exists():
        np.savez(file, **made(size, "displacement" if kind == "displacement" else "stress"))
    command = [sys.executable, __file__, "--measure", name, str(size), str(file)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return {"failed": f"more than {LONGEST} s"}
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["no word"])[-1].removeprefix("palpate.errors.Unsupported: ")
        return {"failed": said.split(" (")[0]}
    return dict(json.loads(done.stdout.splitlines()[-1]))


def table(rows: dict[tuple[str, int], dict[str, Any]], sizes: list[int]) -> str:
    titles = {
        "displacement": "Shear from displacements in the plane of the surface (traction force microscopy)",
        "stress": f"Pressure from normal stress {DEPTH:g} pitches deep",
        "forward": "Displacement of the surface under pressure (no inversion)",
    }
    out = []
    for kind, title in titles.items():
        out += [
            f"{title}:\n",
            "| size | | first, s | then, s | error | memory, MB | |",
            "|---|---|---|---|---|---|---|",
        ]
        for size in sizes:
            for name, (of, _, _, said) in PROGRAMS.items():
                found = rows.get((name, size))
                if of != kind or found is None:
                    continue
                if "failed" in found:
                    out.append(f"| {size} x {size} | {name} | - | - | - | - | {found['failed']} |")
                    continue
                error = "" if np.isnan(found["error"]) else f"{found['error']:.3f}"
                out.append(
                    f"| {size} x {size} | {name} | {found['first']:.3g} | {found['then']:.3g} | {error} | {found['memory']:.0f} | {said} |"
                )
        out.append("")
    return "\n".join(out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[128, 256])
    parser.add_argument("--only", nargs="+", default=None, help="programs whose names hold one of these")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--measure", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.measure:
        name, size, file = given.measure
        print(json.dumps(measure(name, int(size), file)))
        return
    text = [
        "Difference of programs that compute the same quantity, relative to the largest value:\n",
        "| | difference |",
        "|---|---|",
    ]
    for name, difference in agreement(128).items():
        text.append(f"| {name.replace(' | ', ' and ')} | {difference:.1g} |")
        print(text[-1], flush=True)
    text.append("")
    rows = {}
    with tempfile.TemporaryDirectory() as folder:
        for size in given.sizes:
            for name in PROGRAMS:
                if given.only is None or any(o in name for o in given.only):
                    rows[name, size] = row(name, size, Path(folder))
                    print(f"{size} {name}: {rows[name, size]}", flush=True)
    text.append(table(rows, given.sizes))
    print("\n".join(text))
    if given.write:
        TABLE.write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
