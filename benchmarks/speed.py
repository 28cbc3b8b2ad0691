"""Time and memory of palpate's main paths, as ratios within one run (machines are noisy; compare columns, not runs).

    python benchmarks/speed.py [--large | --transforms | --pads | --methods N | --frames N ... [--against SRC]]

For each skin: preparing the operator, one forward application against a bare FFT of the same padded size, preparing the
default reconstruction, one frame and one frame of a batch of 64. --large adds 64 x 64 x 3 (about a minute, 3 GB).

--transforms: forward and adjoint, all three components loaded or one, against the zero-padded FFTs that they cannot do without, of the
library that is in use (ducc0 where it is installed); with --write into docs/_generated/transforms.md.

--frames: processor time of one frame by the automatic method on N x N x 3, small contacts and large, with offsets, and with friction
given; with --against, in turn with another copy of the library (the folder that holds its "palpate"), each in a process of its own, and
--write into docs/_generated/speed_frames.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.fft

import palpate as pp

TRANSFORMS = Path(__file__).parent.parent / "docs" / "_generated" / "transforms.md"
FRAMES = TRANSFORMS.with_name("speed_frames.md")
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
THREE = ["stress_xz", "stress_yz", "stress_zz"]


def best(run: Callable[[], Any], repeats: int = 20, clock: Callable[[], float] = time.perf_counter) -> float:
    run()
    times = []
    for _ in range(repeats):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def area(n: int, channels: list[str], **options: Any) -> pp.Skin:
    array = pp.AreaArray(shape=(n, n), pitch=1e-3, depth=2e-3, channels=channels, noise=50.0)
    return pp.Skin(PAD, array, **options)


def scattered(n: int) -> pp.Skin:
    positions = np.random.default_rng(0).uniform(-0.01, 0.01, (n, 2))
    return pp.Skin(
        PAD, pp.ScatteredArray(positions=positions, depth=0.0, channels=["displacement_x", "displacement_y"])
    )


def report(name: str, skin: pp.Skin, dtype: Any) -> None:
    start = time.perf_counter()
    operator = skin.operator
    prepared = time.perf_counter() - start
    traction = np.random.default_rng(0).standard_normal((3, *skin.surface.shape)).astype(dtype)
    readings = np.nan_to_num(skin.sense(traction))
    forward = best(lambda: operator.forward(traction))
    size = getattr(operator.planes[0], "size", None)
    if size is None:
        bare = float("nan")
    else:
        padded = np.zeros((3, *size), dtype=dtype)
        bare = best(lambda: scipy.fft.irfftn(scipy.fft.rfftn(padded, axes=(1, 2)), s=size, axes=(1, 2)))
    start = time.perf_counter()
    skin.reconstruct(readings, method="tikhonov")
    first = time.perf_counter() - start
    frame = best(lambda: skin.reconstruct(readings, method="tikhonov"))
    batch = np.broadcast_to(readings, (64, *readings.shape))
    many = best(lambda: skin.reconstruct(batch, method="tikhonov"), 3) / 64
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"{name:<26}{np.dtype(dtype).name:<9}{prepared:>9.2f}{1e3 * forward:>11.2f}{forward / bare:>11.1f}{first:>11.2f}"
        f"{1e3 * frame:>11.2f}{1e3 * many:>11.2f}{memory:>9.1f}",
        flush=True,
    )


def transforms(write: bool) -> None:
    """Forward and adjoint against the least that FFTs ask for: what is loaded to the padded size, and what is read back."""
    from palpate._transforms import library  # older code has none, and --against runs this file on it

    table = [
        "| skin | components loaded | | padded to | FFT pair, ms | forward | adjoint |",
        "|---|---|---|---|---|---|---|",
    ]
    print("\n".join(table), flush=True)
    for n in (16, 32, 64, 128, 256):
        for channels, loaded in ((THREE, (0, 1, 2)), (THREE, (2,)), (THREE[2:], (2,))):
            skin = area(n, channels)
            operator, size = skin.operator, skin.operator.planes[0].size  # type: ignore[attr-defined]
            for dtype in (np.float64, np.float32):
                rng = np.random.default_rng(0)
                traction = rng.standard_normal((len(loaded), *skin.surface.shape)).astype(dtype)
                readings = rng.standard_normal((len(channels), n, n)).astype(dtype)
                repeats = max(5, 4_000_000 // n**2 // 40)

                spectra = scipy.fft.rfftn(rng.standard_normal((3, *size)).astype(dtype), axes=(1, 2))

                def pair(there: Any, back: int, spectra: Any = spectra, size: Any = size) -> None:
                    fast = library()
                    if fast is None:
                        scipy.fft.rfftn(there, s=size, axes=(1, 2))
                        scipy.fft.irfftn(spectra[:back], s=size, axes=(1, 2))
                        return
                    padded = np.zeros((len(there), *size), dtype=there.dtype)
                    padded[:, : there.shape[1], : there.shape[2]] = there
                    fast.r2c(padded, axes=(1, 2))
                    fast.c2r(spectra[:back], axes=(1, 2), lastsize=size[1], forward=False, inorm=2)

                rows, columns = len(channels), len(loaded)
                runs: list[Callable[[], Any]] = [
                    lambda t=traction, b=rows: pair(t, b),
                    lambda o=operator, t=traction, c=loaded: o.forward(t, c),
                    lambda r=readings, b=columns: pair(r, b),
                    lambda o=operator, r=readings, c=loaded: o.adjoint([r], c),
                ]
                floor, forward, back, adjoint = (best(run, repeats, time.process_time) for run in runs)
                table.append(
                    f"| {n} x {n} x {rows} | {columns} of 3 | {np.dtype(dtype).name} | {' x '.join(map(str, size))} | {1e3 * floor:.3f} | "
                    f"{forward / floor:.2f} | {adjoint / back:.2f} |"
                )
                print(table[-1], flush=True)
    if write:
        TRANSFORMS.write_text("\n".join(table) + "\n", encoding="utf-8")


def pads() -> None:
    """Preparation and forward application for layered pads, against the half-space in the same run."""

    def layer(thickness: float, modulus: float = 2e5, nu: float = 0.48) -> pp.Layer:
        return pp.Layer(thickness=thickness, youngs_modulus=modulus, poissons_ratio=nu)

    stacks = {
        "half-space": PAD,
        "1 layer": pp.BondedLayers([layer(2e-3)]),
        "3 layers": pp.BondedLayers([layer(5e-4, 1e6), layer(1e-3), layer(1e-3, 5e4, 0.5)]),
        "10 layers": pp.BondedLayers([layer(3e-4, 10 ** (5 + 0.2 * i)) for i in range(10)]),
    }
    print(f"{'pad':<12}{'surface':<22}{'prepare s':>10}{'forward ms':>12}{'/ half-space':>13}{'peak GB':>9}")
    for n, boundary in ((256, "periodic"), (64, "free"), (256, "free")):
        reference = None
        for name, pad in stacks.items():
            array = pp.AreaArray(shape=(n, n), pitch=1e-3, depth=1.5e-3, channels=THREE)
            skin = pp.Skin(pad, array, boundary=boundary)  # type: ignore[arg-type]
            start = time.perf_counter()
            operator = skin.operator
            prepared = time.perf_counter() - start
            traction = np.zeros((3, *skin.surface.shape))
            forward = best(lambda operator=operator, traction=traction: operator.forward(traction), 10)
            reference = reference or forward
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            print(
                f"{name:<12}{f'{n} x {n}, {boundary}':<22}{prepared:>10.2f}{1e3 * forward:>12.2f}{forward / reference:>13.2f}{memory:>9.2f}",
                flush=True,
            )


#: Every method with its options, by what a table calls it; those that keep the whole map seek pressure alone.
METHODS: dict[str, dict[str, Any]] = {
    "tikhonov": {"method": "tikhonov"},
    "hilgers": {"method": "hilgers"},
    "truncated": {"method": "truncated"},
    "wiener": {"method": "wiener", "spectrum": lambda k: 1e-3 * np.exp(-((2e-3 * k) ** 2))},
    "dft": {"method": "dft"},
    "linear": {"method": "linear"},
    "constrained": {"method": "constrained"},
    "constrained, friction": {"method": "constrained", "friction": 0.5},
    "adaptive": {"method": "adaptive"},
    "adaptive, friction": {"method": "adaptive", "friction": 0.5},
    "automatic": {"method": "automatic"},
    **{
        f"{m}, pressure": {"method": m, "components": ["z"]} for m in ("nnls", "elastic_net", "tv", "maxent", "network")
    },
}


def pressed(n: int, count: int, *, noise: bool = False) -> tuple[pp.Skin, Any]:
    """A skin of n x n x 3 and frames of a ball of 4 mm and 0.5 N that slides, with 1 % noise, which the skin may know."""
    array = pp.AreaArray(shape=(n, n), pitch=1e-3, depth=2e-3, channels=THREE)
    skin = pp.Skin(PAD, array)
    clean = skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=0.5).sliding(0.3))
    std = 0.01 * float(np.abs(clean).max())
    frames = clean + std * np.random.default_rng(0).standard_normal((count, *clean.shape))
    if noise:
        skin = pp.Skin(PAD, pp.AreaArray(shape=(n, n), pitch=1e-3, depth=2e-3, channels=THREE, noise=std))
    return skin, frames


def methods(n: int, only: str | None = None) -> None:
    """Seconds per frame of each method on n x n x 3, one frame and a batch of four (two where slow): see `pressed`."""
    print(f"{'method':<24}{'first s':>10}{'frame s':>10}{'batch s':>10}")
    for name, options in METHODS.items():
        if only is not None and only not in name:
            continue
        skin, frames = pressed(n, 4, noise=name == "wiener")
        try:
            start = time.perf_counter()
            skin.reconstruct(frames[0], **options)
            first = time.perf_counter() - start
            slow = first > 20.0
            single = best(
                lambda skin=skin, frames=frames, options=options: skin.reconstruct(frames[0], **options),
                1 if slow else 2,
            )
            count = 2 if slow else 4
            many = frames[:count]
            batch = best(lambda skin=skin, many=many, options=options: skin.reconstruct(many, **options), 1) / count
        except pp.Unsupported as error:
            print(f"{name:<24}  {str(error).split('.')[0]}")
            continue
        print(f"{name:<24}{first:>10.2f}{single:>10.4f}{batch:>10.4f}", flush=True)


#: Frames of a size: part of the array's width that the contact's radius is, friction, whether the pad is a bonded layer, and the offset of normal stress in
#: parts of the largest reading, with 0.3 and -0.5 of it of the shear stresses.
CASES: dict[str, tuple[float, float | None, bool, float]] = {
    "small": (0.12, None, False, 0.0),
    "small, offsets": (0.12, None, False, 0.1),
    "small, friction": (0.12, 0.5, False, 0.0),
    "large": (0.42, None, False, 0.0),
    "large, offsets": (0.42, None, False, 0.3),
    "large, friction": (0.42, 0.5, False, 0.0),
    "large, layer": (0.42, None, True, 0.0),
}


def frame_of(n: int, case: str) -> tuple[pp.Skin, Any, dict[str, Any]]:
    """A skin, a frame of a round contact under 1 % noise, and the options. 4 x 4 is a robot's skin: 4.7 mm between taxels 3 mm deep."""
    part, friction, layer, offset = CASES[case]
    pitch, depth = (4.7e-3, 3e-3) if n == 4 else (1e-3, 2e-3)
    pad = pp.BondedLayers([pp.Layer(thickness=2 * depth, youngs_modulus=2e5, poissons_ratio=0.48)]) if layer else PAD
    skin = pp.Skin(pad, pp.AreaArray(shape=(n, n), pitch=pitch, depth=depth, channels=THREE))
    radius = max(part * n * pitch, 1.2 * pitch if n > 4 else 0.65 * pitch)
    y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    off = 0.03 * n * pitch
    pressure = 2e4 * np.sqrt(np.maximum(1.0 - ((x - off) ** 2 + (y + off) ** 2) / radius**2, 0.0))
    clean = skin.sense(np.stack([0.3 * pressure, -0.1 * pressure, pressure]))
    noise = 0.01 * np.abs(clean).max() * np.random.default_rng(n).standard_normal(clean.shape)
    noise += offset * np.abs(clean).max() * np.array([0.3, -0.5, 1.0]).reshape(3, 1, 1)
    return skin, clean + noise, {} if friction is None else {"friction": friction}


def worker(n: int) -> None:
    """Time a frame of the case in each line of the input, and say its force."""
    made = {case: frame_of(n, case) for case in CASES}
    for line in sys.stdin:
        skin, readings, options = made[line.strip()]
        start = time.process_time()
        force = skin.reconstruct(readings, **options).force
        print(time.process_time() - start, *force.tolist(), flush=True)


def frames(sizes: list[int], against: str | None, write: bool, repeats: int = 3) -> None:
    """Least processor time of a frame in a few runs, of this copy and of another one in turn."""
    table = ["| array | contact | before [ms] | now [ms] | ratio | forces differ by |", "|---|---|---|---|---|---|"]
    sources = [*([against] if against else []), str(Path(pp.__file__).parents[1])]
    titles = ("before ms", "now ms", "ratio", "same to") if against else ("ms",)
    print(f"{'array':<14}{'contact':<18}" + "".join(f"{t:>12}" for t in titles))
    for n in sizes:
        copies = []
        for source in sources:
            environment = {**os.environ, "PYTHONPATH": source, "OMP_NUM_THREADS": "1"}
            command = [sys.executable, __file__, "--worker", str(n)]
            copies.append(
                subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            )
        for case in CASES:
            times = np.full((len(copies), repeats), np.inf)
            forces = []
            for k in range(-1, repeats):  # the first one prepares
                for i, copy in enumerate(copies):
                    if k > 0 and times[i, 0] > 5.0:
                        continue
                    if copy.stdin is None or copy.stdout is None:
                        raise RuntimeError("the other copy cannot be spoken to")
                    copy.stdin.write(f"{case}\n")
                    copy.stdin.flush()
                    spent, *force = map(float, copy.stdout.readline().split())
                    if k < 0:
                        forces.append(np.array(force))
                    else:
                        times[i, k] = spent
            spent_each = 1e3 * times.min(axis=1)
            line = f"{f'{n} x {n} x 3':<14}{case:<18}" + "".join(f"{t:>12.1f}" for t in spent_each)
            if against:
                off = np.abs(forces[0] - forces[1]).max() / np.abs(forces[0]).max()
                line += f"{spent_each[0] / spent_each[1]:>12.1f}{off:>12.0e}"
                table.append(
                    f"| {n} x {n} x 3 | {case} | {spent_each[0]:.0f} | {spent_each[1]:.0f} | {spent_each[0] / spent_each[1]:.1f} | {100 * off:.2g} % |"
                )
            print(line, flush=True)
        for copy in copies:
            copy.communicate()
    if write:
        FRAMES.write_text("\n".join(table) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--transforms", action="store_true", help="forward and adjoint against bare FFTs instead")
    parser.add_argument(
        "--write",
        action="store_true",
        help="these into docs/_generated/transforms.md, or frames into docs/_generated/speed_frames.md",
    )
    parser.add_argument("--pads", action="store_true", help="layered pads against the half-space instead")
    parser.add_argument("--methods", type=int, metavar="N", help="every method on N x N x 3 instead")
    parser.add_argument("--only", metavar="TEXT", help="of these, the ones whose name has this in it")
    parser.add_argument(
        "--frames", type=int, nargs="+", metavar="N", help="frames of N x N x 3 by the automatic method instead"
    )
    parser.add_argument("--against", metavar="SRC", help="compare them with the copy of the library in this folder")
    parser.add_argument("--worker", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        worker(arguments.worker)
        return
    if arguments.transforms:
        transforms(arguments.write)
        return
    if arguments.frames:
        frames(arguments.frames, arguments.against, arguments.write)
        return
    if arguments.methods:
        methods(arguments.methods, arguments.only)
        return
    large = arguments.large
    if arguments.pads:
        pads()
        return
    print(
        f"{'skin':<26}{'dtype':<9}{'oper. s':>9}{'forward ms':>11}{'/ bare FFT':>11}{'first s':>11}{'frame ms':>11}"
        f"{'batch ms':>11}{'peak GB':>9}"
    )
    for dtype in (np.float64, np.float32):
        report("16 x 16 x 3", area(16, THREE), dtype)
        report("32 x 32 x 1", area(32, ["stress_zz"]), dtype)
        report("32 x 32 x 3", area(32, THREE), dtype)
        report("32 x 32 x 3, periodic", area(32, THREE, boundary="periodic"), dtype)
        report("64 x 64 x 3, periodic", area(64, THREE, boundary="periodic"), dtype)
        report("256 x 256 x 3, periodic", area(256, THREE, boundary="periodic"), dtype)
        report("600 scattered x 2", scattered(600), dtype)
    if large:
        report("64 x 64 x 3", area(64, THREE), np.float64)


if __name__ == "__main__":
    main()
