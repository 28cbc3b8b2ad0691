"""The differentiable layers on a GPU beside the processor of the same machine; `bridges.py --device` starts it, each library in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bridges
import numpy as np

import palpate as pp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import differentiable as cases

BATCHES = (1, 64, 4096)
#: Seconds of wall clock that a process may take: two of them stay below 150 s.
LIMIT = 70.0
PARAMETERS = ("readings", "noise", "modulus", "depth", "gains")


class Torch:
    """PyTorch on the device of a name."""

    def __init__(self, device: str) -> None:
        import torch

        self.torch, self.device = torch, torch.device(device)
        self.name = (
            torch.cuda.get_device_name() if device == "cuda" else f"processor, {torch.get_num_threads()} threads"
        )

    def array(self, x: Any, dtype: str) -> Any:
        return self.torch.tensor(np.asarray(x), dtype=getattr(self.torch, dtype), device=self.device)

    def wait(self, x: Any) -> None:
        if self.device.type == "cuda":
            self.torch.cuda.synchronize()

    def copy(self, count: int) -> Callable[[], Any]:
        a = self.torch.ones(count, device=self.device)
        b = self.torch.empty_like(a)
        return lambda: b.copy_(a)

    def sense(self, skin: pp.Skin) -> Callable[[Any], Any]:
        from palpate.torch import Sense

        return self._quiet(Sense(skin).to(self.device))

    def inverse(self, skin: pp.Skin, **options: Any) -> Callable[[Any], Any]:
        from palpate.torch import Reconstruct

        return self._quiet(Reconstruct(skin, **options).to(self.device))

    def _quiet(self, layer: Any) -> Callable[[Any], Any]:
        def run(x: Any) -> Any:
            with self.torch.no_grad():
                return layer(x)

        return run

    def gradients(self, skin: pp.Skin, given: dict[str, Any], weight: Any, **options: Any) -> dict[str, Any]:
        from palpate.torch import Reconstruct

        layer = Reconstruct(skin, **options).to(self.device)
        tensors = {k: self.array(v, "float64").requires_grad_() for k, v in given.items()}
        use = dict(tensors)
        (layer(use.pop("readings"), **use) * self.array(weight, "float64")).sum().backward()
        return {k: v.grad.cpu().numpy() for k, v in tensors.items()}

    def compilations(self, skin: pp.Skin, readings: Any) -> tuple[int, int]:
        from torch._dynamo.testing import CompileCounter

        from palpate.torch import Reconstruct

        counter = CompileCounter()
        layer = Reconstruct(skin, parameter=cases.PARAMETER, friction=0.5).to(self.device)
        compiled = self.torch.compile(layer, backend=counter)
        y = self.array(readings, "float64")
        compiled(y)
        first = counter.frame_count
        compiled(1.1 * y)
        return first, counter.frame_count


class Jax:
    """JAX on the device of a name."""

    def __init__(self, device: str) -> None:
        import jax

        jax.config.update("jax_enable_x64", True)
        self.jax, self.device = jax, jax.devices(device)[0]
        self.name = self.device.device_kind if device == "cuda" else f"processor, {os.cpu_count()} cores"

    def array(self, x: Any, dtype: str) -> Any:
        return self.jax.device_put(np.asarray(x, dtype=dtype), self.device)

    def wait(self, x: Any) -> None:
        self.jax.block_until_ready(x)

    def copy(self, count: int) -> Callable[[], Any]:
        if self.device.platform == "cpu":  # JAX takes fresh pages for each result there, five times as slow
            here, to = np.ones(count, dtype=np.float32), np.zeros(count, dtype=np.float32)
            return lambda: np.copyto(to, here)
        a = self.array(np.ones(count), "float32")
        flipped = self.jax.jit(lambda x: -x)
        return lambda: flipped(a)

    def _model(self, skin: pp.Skin, **options: Any) -> Any:
        from palpate.jax import prepare

        return self.jax.device_put(prepare(skin, **options), self.device)

    def sense(self, skin: pp.Skin) -> Callable[[Any], Any]:
        from palpate.jax import sense

        model, run = self._model(skin), self.jax.jit(sense)
        return lambda x: run(model, x)

    def inverse(self, skin: pp.Skin, **options: Any) -> Callable[[Any], Any]:
        from palpate.jax import reconstruct

        model, run = self._model(skin, **options), self.jax.jit(reconstruct)
        return lambda x: run(model, x)

    def gradients(self, skin: pp.Skin, given: dict[str, Any], weight: Any, **options: Any) -> dict[str, Any]:
        from palpate.jax import reconstruct

        model, scale = self._model(skin, **options), self.array(weight, "float64")

        def loss(use: dict[str, Any]) -> Any:
            rest = {k: v for k, v in use.items() if k != "readings"}
            return (reconstruct(model, use["readings"], rest) * scale).sum()

        found = self.jax.jit(self.jax.grad(loss))({k: self.array(v, "float64") for k, v in given.items()})
        return {k: np.asarray(v) for k, v in found.items()}

    def compilations(self, skin: pp.Skin, readings: Any) -> tuple[int, int]:
        from palpate.jax import reconstruct

        model, run = self._model(skin, parameter=cases.PARAMETER, friction=0.5), self.jax.jit(reconstruct)
        y = self.array(readings, "float64")
        self.wait(run(model, y))
        first = run._cache_size()
        self.wait(run(model, 1.1 * y))
        return first, run._cache_size()


def wall(on: Any, run: Callable[[], Any], longest: float) -> float:
    """Seconds of wall clock of a run: the median of many, after one that prepares, within half a second; of one run where it takes as long."""
    on.wait(run())
    found: list[float] = []
    while not found or (sum(found) < min(0.5, longest) and len(found) < 200):
        start = time.perf_counter()
        on.wait(run())
        found.append(time.perf_counter() - start)
    return float(np.median(found))


def rows(library: str, device: str, batches: tuple[int, ...]) -> Iterator[dict[str, Any]]:
    """What one library does on the device and on the processor: gradients first, then compilation, then rates."""
    start = time.perf_counter()
    kind = {"torch": Torch, "jax": Jax}[library]
    there = {name: kind(name) for name in dict.fromkeys((device, "cpu"))}
    small = cases.skin("mixed")  # stress alone does not follow the modulus
    given = {"readings": np.nan_to_num(cases.frames(small, 2)), **cases.parameters(small)}
    weight = cases.weights((2, 3, *small.surface.shape)) * 1e-4
    for case, (constrained, friction) in cases.CASES.items():
        options = {"parameter": cases.PARAMETER, "constrained": constrained, "friction": friction, "depth_range": 0.2}
        found = [on.gradients(small, given, weight, **options) for on in (there[device], there["cpu"])]
        for name in PARAMETERS:
            a, b = found[0][name], found[1][name]
            yield {
                "what": "gradient",
                "case": case,
                "parameter": name,
                "error": float(np.abs(a - b).max() / np.abs(b).max()),
            }
    copied: dict[str, float] = {}
    for name, on in there.items():
        first, second = on.compilations(small, given["readings"])
        yield {"what": "compiled", "device": name, "name": on.name, "first": first, "second": second}
        count = 2**27 if name == "cuda" else 2**25  # half a gigabyte, more than any cache
        copied[name] = 8.0 * count / wall(on, on.copy(count), 0.2)
        yield {"what": "copy", "device": name, "bytes_per_second": copied[name]}
    for task in ("sense", "linear", "within friction"):
        for skin_name, skin in bridges.skins().items():
            for dtype in ("float64",) if "friction" in task else ("float32", "float64"):
                for name, on in there.items():
                    options = {"constrained": False} if task == "linear" else {"friction": 0.6}
                    run = (
                        on.sense(skin) if task == "sense" else on.inverse(skin, parameter=bridges.PARAMETER, **options)
                    )
                    size, taken = np.dtype(dtype).itemsize, 0.0
                    unknowns, read = 3 * int(np.prod(skin.surface.shape)), int(np.prod(bridges.frames(skin, 1).shape))
                    for batch in batches:
                        row = {
                            "what": "rate",
                            "task": task,
                            "skin": skin_name,
                            "dtype": dtype,
                            "device": name,
                            "batch": batch,
                        }
                        # a constrained frame costs as much in a large batch as in one of 64
                        expected = 2.0 * batch / 64 * taken if "friction" in task and batch > 64 else 0.0
                        if time.perf_counter() - start + expected > LIMIT - 5:
                            yield {**row, "left_out": f"it would take {expected:.0f} s"}
                            continue
                        x = np.ones((batch, 3, *skin.surface.shape)) if task == "sense" else bridges.frames(skin, batch)
                        x = on.array(x, dtype)
                        taken = wall(on, lambda run=run, x=x: run(x), 0.5)
                        moved = size * (unknowns * read + batch * (unknowns + read))
                        yield {**row, "frames_per_second": batch / taken, "bound": batch * copied[name] / moved}


def measure(device: str, out: Path, batches: tuple[int, ...]) -> None:
    """Both libraries, each in a process of its own, so that one that fails or hangs takes no rows of the other; JSON and a page of tables."""
    found: dict[str, Any] = {}
    for library in ("torch", "jax"):
        command = [sys.executable, __file__, library, device, *map(str, batches)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            try:
                text, errors = process.communicate(timeout=LIMIT)
                failed = None if process.returncode == 0 else errors[-1500:]
            except subprocess.TimeoutExpired:
                process.kill()
                text, errors = process.communicate()
                failed = f"stopped after {LIMIT:.0f} s"
        kept = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
        found[library] = {"rows": kept, "failed": failed}
        out.with_suffix(".json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    out.with_suffix(".md").write_text("\n".join(page(found)), encoding="utf-8")


def page(found: dict[str, Any]) -> list[str]:
    """Tables of what was measured, in Markdown."""
    text = []
    for library, kept in found.items():
        of = {what: [r for r in kept["rows"] if r["what"] == what] for what in ("gradient", "compiled", "copy", "rate")}
        text += [f"### {library}", ""]
        if kept["failed"]:
            text += ["It did not end:", "", "```", kept["failed"], "```", ""]
        for row in of["compiled"]:
            text.append(
                f"- {row['device']} ({row['name']}): compiled {row['first']} after the first call, {row['second']} after the second."
            )
        text += [
            f"- {row['device']}: copies {row['bytes_per_second'] / 1e9:.0f} GB/s, read and written."
            for row in of["copy"]
        ]
        text += ["", "| gradient, device against processor | " + " | ".join(PARAMETERS) + " |", "|---" * 6 + "|"]
        for case in cases.CASES:
            errors = {r["parameter"]: f"{r['error']:.1e}" for r in of["gradient"] if r["case"] == case}
            text.append(f"| {case} | " + " | ".join(errors.get(p, "none") for p in PARAMETERS) + " |")
        text += ["", "| what | skin | device | batch | frames a second | of the bound by copying |", "|---" * 6 + "|"]
        for r in of["rate"]:
            rate, part = r.get("left_out", "none"), "none"
            if "frames_per_second" in r:
                rate = f"{r['frames_per_second']:.0f}"
                part = f"{100 * r['frames_per_second'] / r['bound']:.2g} %"
            text.append(f"| {r['task']}, {r['dtype']} | {r['skin']} | {r['device']} | {r['batch']} | {rate} | {part} |")
        text.append("")
    return text


if __name__ == "__main__":
    for found_row in rows(sys.argv[1], sys.argv[2], tuple(map(int, sys.argv[3:]))):
        print(json.dumps(found_row), flush=True)
