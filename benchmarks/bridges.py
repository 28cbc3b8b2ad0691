"""Bridges to learners and simulators: worlds a second of taxels in MuJoCo and how far their force lies from the contacts', throughput of the
differentiable inverse in PyTorch (and JAX) by batch size. Writes docs/_generated/bridges.md.

    python benchmarks/bridges.py
    python benchmarks/bridges.py --part gradients examples  (renews these parts of the page alone)
    python benchmarks/bridges.py --device cuda --out FILE   (the layers alone, beside the processor of the same machine)
    python benchmarks/bridges.py --gpu-result FILE.json     (keeps that measurement in benchmarks/data and renews the page's part on it)
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp

OUT = Path(__file__).parents[1] / "docs" / "_generated" / "bridges.md"
#: The last measurement on a GPU, which few machines can repeat.
GPU = Path(__file__).parent / "data" / "bridges_gpu.json"
DOCS = OUT.parents[1]
#: One for learners, one for simulators, one for robots.
EXAMPLES = ("15_mujoco_gripper.py", "16_small_network.py", "17_lerobot_episode.py")
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
CHANNELS = ["stress_xz", "stress_yz", "stress_zz"]
#: Weight of the penalty, near to that of evidence.
PARAMETER = 1e-4
#: Processor time that a measurement takes [s], at least half of it: single runs of 2 ms were told as 0.5 ms.
WINDOW = 0.1


def seconds(run: Callable[[], Any]) -> float:
    """Processor time of a run, after one that prepares: the least of three means over `WINDOW`. Other work on the machine does not stretch it much."""
    run()
    found: list[float] = []
    count = 1
    while len(found) < 3:
        start = time.process_time()
        for _ in range(count):
            run()
        taken = time.process_time() - start
        if taken < 0.5 * WINDOW and count < 4096:  # the clock is too coarse for one short run
            count *= 2
            continue
        found.append(taken / count)
    return min(found)


def mujoco_rows() -> list[str]:
    from palpate.mujoco import Taxels

    sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "interop"))
    import test_mujoco as scenes

    skin = pp.Skin(PAD, pp.AreaArray(shape=(16, 16), pitch=1.5e-3, depth=2e-3, channels=CHANNELS, noise=50.0))
    rows = [
        "| tool | frames | largest error of the force | largest error of the moment / (force x 10 mm) |",
        "|---|---|---|---|",
    ]
    for tool in scenes.TOOLS:
        model, data = scenes.scene(tool, condim=6)
        taxels = Taxels(model, skin, geom="pad", site="skin")
        force = moment = 0.0
        frames = 0
        rng = np.random.default_rng(0)
        for _ in range(20):  # presses, drags and rolls
            push = (*rng.uniform(-0.3, 0.3, 2), -rng.uniform(0.3, 1.5))
            scenes.pushed(model, data, push, 10, (*rng.uniform(-1e-3, 1e-3, 2), rng.uniform(-5e-4, 5e-4)))
            own, felt = scenes.simulators_own(model, data), taxels.press(data).felt[0]
            if own[2] > 0.05:
                frames += 1
                size = float(np.linalg.norm(own[:3]))
                force = max(force, float(np.abs(felt[:3] - own[:3]).max()) / size)
                moment = max(moment, float(np.abs(felt[3:] - own[3:]).max()) / (size * 0.01))
        rows.append(f"| {tool} | {frames} | {force:.1e} | {moment:.1e} |")
    rows += ["", "| taxels | worlds | contacts to readings | worlds a second |", "|---|---|---|---|"]
    for count in (8, 16):
        pad = pp.Skin(PAD, pp.AreaArray(shape=(count, count), pitch=1.5e-3, depth=2e-3, channels=CHANNELS))
        model, data = scenes.scene("ball")
        scenes.pushed(model, data, (0.2, 0.0, -1.0), 60)
        taxels = Taxels(model, pad, geom="pad", site="skin")
        for worlds in (1, 64, 1024):
            many = [data] * worlds
            taken = seconds(lambda many=many, taxels=taxels: taxels.read(many))
            rows.append(f"| {count} x {count} x 3 | {worlds} | {1e3 * taken:.1f} ms | {worlds / taken:.0f} |")
    return rows


def skins() -> dict[str, pp.Skin]:
    """Taxels 2 mm apart; the surface reaches two cells past them."""
    return {
        f"{n} x {n} x 3": pp.Skin(
            PAD,
            pp.AreaArray(shape=(n, n), pitch=2e-3, depth=2e-3, channels=CHANNELS, noise=60.0),
            surface=pp.AreaGrid(shape=(n + 4, n + 4), spacing=(2e-3, 2e-3)),
            nuisance=(),
        )
        for n in (4, 8)
    }


def frames(skin: pp.Skin, count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    kinds = []
    for _ in range(min(count, 16)):
        ball = pp.solutions.hertz_point(
            contact_radius=float(rng.uniform(1e-3, 3e-3)), force=float(rng.uniform(0.3, 1.5))
        )
        kinds.append(skin.sense(ball.partial_slip(0.6, 0.4 * ball.force[2], direction=float(rng.uniform(0, 6)))))
    noise = rng.standard_normal((count, *kinds[0].shape)) * 60.0
    return np.stack([kinds[i % len(kinds)] for i in range(count)]) + noise


def learner_rows(batches: tuple[int, ...]) -> list[str]:
    rows = [
        "| skin | library | what | " + " | ".join(f"batch {b}" for b in batches) + " |",
        "|---|---|---|" + "---|" * len(batches),
    ]
    for name, skin in skins().items():
        tasks: dict[tuple[str, str], Callable[[np.ndarray], Callable[[], Any]]] = {}
        try:
            tasks |= torch_tasks(skin)
        except pp.Unsupported as error:
            print(f"left out: {error}")
        tasks |= jax_tasks(skin)
        for (library, what), task in tasks.items():
            cells = []
            for batch in batches:
                if batch > 64 and "friction and gradient" in what:  # backwards frame by frame: the rate is that of 64
                    cells.append("as 64")
                    continue
                taken = seconds(task(frames(skin, batch)))
                cells.append(f"{batch / taken:.0f} frames/s")
            rows.append(f"| {name} | {library} | {what} | {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    return rows


def bound_rows() -> list[str]:
    """What bounds the rates: a bare matrix product for the linear inverse, factors of the faces for the constrained one."""
    from palpate.inverse import differentiable
    from palpate.inverse.constrained.cone import minimise
    from palpate.inverse.constrained.quadratic import Formed

    rows = [
        "| skin | matrix product alone, float32, batch 4096 | within friction, one by one: steps a frame | unknowns that are free | Cholesky factors of as many alone |",
        "|---|---|---|---|---|",
    ]
    for name, skin in skins().items():
        m = differentiable.matrices(
            skin.problem(components=skin.components),
            skin.pad,
            parameter=PARAMETER,
            friction=0.6,
            constrained=True,
            depth_range=0.0,
        )
        readings = frames(skin, 64).reshape(64, -1)
        matrix = np.ones((readings.shape[1], m.unknowns), dtype=np.float32)
        many = np.ones((4096, readings.shape[1]), dtype=np.float32)
        product = 4096 / seconds(lambda many=many, matrix=matrix: many @ matrix)
        weight = m.valid / np.asarray(m.noise)
        linear = (readings * weight) @ (m.here * weight[:, None])
        quadratic, steps, free = Formed(np.asarray(m.hessian)), [], []
        for h in linear:
            found = minimise(quadratic, h.reshape(len(m.cone.components), -1), m.cone, keep_face=True)
            steps.append(found.steps)
            free.append(len(found.face.index))
        size = int(np.mean(free))
        spd = np.eye(size) * size + 1.0
        factor = seconds(lambda spd=spd: np.linalg.cholesky(spd))
        rows.append(
            f"| {name} | {product:.0f} frames/s | {np.mean(steps):.1f} | {size} of {m.unknowns} | {1.0 / (factor * np.mean(steps)):.0f} frames/s |"
        )
        print(rows[-1], flush=True)
    return rows


def torch_tasks(skin: pp.Skin) -> dict[tuple[str, str], Any]:
    import torch

    from palpate.torch import Reconstruct, Sense

    linear = Reconstruct(skin, parameter=PARAMETER, constrained=False)
    cone = Reconstruct(skin, parameter=PARAMETER, friction=0.6)
    sense = Sense(skin)
    shape = (3, *skin.surface.shape)

    def with_gradient(layer: Any) -> Any:
        def task(readings: np.ndarray) -> Callable[[], Any]:
            given = torch.tensor(readings, requires_grad=True)
            return lambda: layer(given).square().sum().backward()

        return task

    def plainly(layer: Any, dtype: Any, *, traction: bool = False) -> Any:
        def task(readings: np.ndarray) -> Callable[[], Any]:
            given = torch.ones((len(readings), *shape)) if traction else torch.tensor(readings, dtype=dtype)
            return lambda: layer(given)

        return task

    return {
        ("PyTorch", "sense, float32"): plainly(sense, torch.float32, traction=True),
        ("PyTorch", "linear, float32"): plainly(linear, torch.float32),
        ("PyTorch", "linear and gradient, float64"): with_gradient(linear),
        ("PyTorch", "within friction, float64"): plainly(cone, torch.float64),
        ("PyTorch", "within friction and gradient, float64"): with_gradient(cone),
    }


def jax_tasks(skin: pp.Skin) -> dict[tuple[str, str], Any]:
    import jax
    import jax.numpy as jnp

    from palpate.jax import prepare, reconstruct

    jax.config.update("jax_enable_x64", True)

    def task_of(function: Any, model: Any, *, first: bool) -> Any:
        def task(readings: np.ndarray) -> Callable[[], Any]:
            y = jnp.asarray(readings)
            arguments = (model, y) if first else (y, model)
            return lambda: function(*arguments).block_until_ready()

        return task

    plain = jax.jit(reconstruct)
    slope = jax.jit(jax.grad(lambda y, m: (reconstruct(m, y) ** 2).sum()))
    out = {}
    for what, model in (
        ("linear", prepare(skin, parameter=PARAMETER, constrained=False)),
        ("within friction", prepare(skin, parameter=PARAMETER, friction=0.6)),
    ):
        out["JAX", f"{what}, float64"] = task_of(plain, model, first=True)
        out["JAX", f"{what} and gradient, float64"] = task_of(slope, model, first=False)
    return out


def layer_rows() -> list[str]:
    return [
        f"The differentiable layers, penalty {PARAMETER:g}, surfaces of 8 x 8 and 12 x 12 cells (192 and 432 unknowns):",
        "",
        *learner_rows((1, 64, 4096)),
        "",
        "Limits of these rates, on the same thread:",
        "",
        *bound_rows(),
    ]


def gradient_rows() -> list[str]:
    import bridges_device

    return [
        "Gradients on the processor, float64, against differences of fourth order (relative error along a direction in all values of the parameter; required: 1e-6):",
        "",
        *bridges_device.checked_gradients(),
    ]


def example_rows() -> list[str]:
    rows = [
        "The examples, each in a separate process:",
        "",
        "| example | processor time | wall clock |",
        "|---|---|---|",
    ]
    for name in EXAMPLES:
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            # without a screen, and compiled or fitted anew
            subprocess.run(
                [sys.executable, str(DOCS / "examples" / name)],
                cwd=folder,
                check=True,
                env={**os.environ, "MPLBACKEND": "agg"},
            )
        taken, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        rows.append(f"| `docs/examples/{name}` | {used:.0f} s | {taken:.0f} s |")
        print(rows[-1], flush=True)
    return rows


def gpu_rows() -> list[str]:
    import bridges_device

    return bridges_device.page(bridges_device.restored(GPU.read_text(encoding="utf-8")))


#: Parts of the page after the first, by the mark that they begin with.
PARTS = {"layers": layer_rows, "gradients": gradient_rows, "examples": example_rows, "GPU": gpu_rows}


def write_page(first: list[str] | None, parts: Sequence[str]) -> None:
    """The page with its first part, or that of the page as it is, and these parts renewed."""
    head, *old = re.split(r"<!-- (\w+) -->\n", OUT.read_text(encoding="utf-8"))
    kept = dict(zip(old[::2], old[1::2]))
    for name in parts:
        kept[name] = "\n".join(["", *PARTS[name](), ""]).rstrip() + "\n\n"
    head = head if first is None else "\n".join(first) + "\n\n"
    OUT.write_text(
        head + "".join(f"<!-- {n} -->\n{kept[n]}" for n in PARTS if n in kept).rstrip() + "\n", encoding="utf-8"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", choices=["cuda", "cpu"], help="measure the layers there alone")
    parser.add_argument("--out", type=Path, default=Path("bridges-device"), help="where --device writes .json and .md")
    parser.add_argument(
        "--gpu-result", type=Path, help="a .json of --device: keep it, renew that part of the page alone"
    )
    parser.add_argument("--part", choices=list(PARTS), nargs="+", help="renew these parts of the page alone")
    given = parser.parse_args()
    if given.gpu_result:
        import bridges_device

        GPU.parent.mkdir(exist_ok=True)
        GPU.write_text(
            bridges_device.stored(json.loads(given.gpu_result.read_text(encoding="utf-8"))), encoding="utf-8"
        )
    if given.gpu_result or given.part:
        write_page(None, given.part or ["GPU"])
        return
    if given.device:
        import bridges_device

        bridges_device.measure(given.device, given.out, bridges_device.BATCHES)
        return
    head = f"Written by `benchmarks/bridges.py`: one thread of {platform.machine()}, {os.cpu_count()} cores, while other programs ran; times are processor times."
    said = "The traction's force and moment against the simulator's, in presses, drags and rolls:"
    write_page([head, "", said, "", *mujoco_rows()], list(PARTS))


if __name__ == "__main__":
    main()
