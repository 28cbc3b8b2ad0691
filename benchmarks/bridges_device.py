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

    def value(self, skin: pp.Skin, weight: Any, **options: Any) -> Callable[[dict[str, Any]], float]:
        """What `gradients` is the gradient of."""
        from palpate.torch import Reconstruct

        layer, scale = Reconstruct(skin, **options).to(self.device), self.array(weight, "float64")

        def run(given: dict[str, Any]) -> float:
            use = {k: self.array(v, "float64") for k, v in given.items()}
            with self.torch.no_grad():
                return float((layer(use.pop("readings"), **use) * scale).sum())

        return run

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

    def _loss(self, skin: pp.Skin, weight: Any, **options: Any) -> Callable[[dict[str, Any]], Any]:
        from palpate.jax import reconstruct

        model, scale = self._model(skin, **options), self.array(weight, "float64")

        def loss(use: dict[str, Any]) -> Any:
            rest = {k: v for k, v in use.items() if k != "readings"}
            return (reconstruct(model, use["readings"], rest) * scale).sum()

        return loss

    def value(self, skin: pp.Skin, weight: Any, **options: Any) -> Callable[[dict[str, Any]], float]:
        """What `gradients` is the gradient of."""
        run = self.jax.jit(self._loss(skin, weight, **options))
        return lambda given: float(run({k: self.array(v, "float64") for k, v in given.items()}))

    def gradients(self, skin: pp.Skin, given: dict[str, Any], weight: Any, **options: Any) -> dict[str, Any]:
        run = self.jax.jit(self.jax.grad(self._loss(skin, weight, **options)))
        found = run({k: self.array(v, "float64") for k, v in given.items()})
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


def checked_gradients() -> list[str]:
    """Gradients on the processor, float64, against differences of fourth order along a direction in all values of a parameter: a table."""
    small = cases.skin("mixed")  # stress alone does not follow the modulus
    given = {"readings": np.nan_to_num(cases.frames(small, 2)), **cases.parameters(small)}
    weight = cases.weights((2, 3, *small.surface.shape)) * 1e-4
    out = ["| library | inverse | " + " | ".join(PARAMETERS) + " |", "|---" * 7 + "|"]
    for kind in (Torch, Jax):
        on = kind("cpu")
        for case, (constrained, friction) in cases.CASES.items():
            options = {
                "parameter": cases.PARAMETER,
                "constrained": constrained,
                "friction": friction,
                "depth_range": 0.2,
            }
            found, value = on.gradients(small, given, weight, **options), on.value(small, weight, **options)
            cells = []
            for name in PARAMETERS:
                direction = np.random.default_rng(1).standard_normal(given[name].shape) * np.abs(given[name])
                slope = cases.quotient(
                    lambda v, name=name, value=value: value({**given, name: v}), given[name], direction, 1e-5
                )
                cells.append(f"{abs(float((found[name] * direction).sum()) / slope - 1.0):.1e}")
            out.append(f"| {kind.__name__} | {case} | {' | '.join(cells)} |")
            print(out[-1], flush=True)
    return out


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
    """What was measured, in Markdown: the ends of each finding in words, then tables."""
    of = {
        library: {w: [r for r in kept["rows"] if r["what"] == w] for w in ("gradient", "compiled", "copy", "rate")}
        for library, kept in found.items()
    }
    there = next(row for row in of["torch"]["compiled"])
    device = there["device"]
    every = [row for kinds in of.values() for row in kinds["rate"] if "frames_per_second" in row]
    text = [
        f"On a GPU, {there['name']}, compared with the processor of its machine ({_cores(of['torch'])}); wall-clock times.",
        "",
    ]
    errors = [row["error"] for kinds in of.values() for row in kinds["gradient"]]
    text.append(f"- Gradients, GPU against processor, float64: at most {max(errors):.1e} of the largest.")
    for task in ("sense", "linear"):
        shares = [r["frames_per_second"] / r["bound"] for r in every if r["task"] == task and r["device"] == device]
        text.append(
            f"- Share of the bound by copying that {task} reaches: {_percent(min(shares))} (batch 1) to {_percent(max(shares))}."
        )
    for task in ("sense", "linear", "within friction"):
        batches = sorted({r["batch"] for r in of["torch"]["rate"]})
        parts = [(b, [x / y for x, y in _pairs(of, device, task, b)]) for b in batches]
        words = "; ".join(f"batch {b}, {min(times):.2g} to {max(times):.2g}" for b, times in parts if times)
        text.append(f"- Speed relative to the processor, {task}: {words}.")
    for library, kinds in of.items():
        added = [row["second"] - row["first"] for row in kinds["compiled"]]
        copies = ", ".join(f"{row['device']} {row['bytes_per_second'] / 1e9:.0f} GB/s" for row in kinds["copy"])
        text.append(
            f"- {library}: graphs that a second call compiles: {max(added)}; copies {copies}, read and written."
        )
    text += [f"- {library} did not end: {kept['failed']}" for library, kept in found.items() if kept["failed"]]
    text += ["", "| library | gradient, GPU against processor | " + " | ".join(PARAMETERS) + " |", "|---" * 7 + "|"]
    for library, kinds in of.items():
        for case in cases.CASES:
            row = {r["parameter"]: f"{r['error']:.1e}" for r in kinds["gradient"] if r["case"] == case}
            text.append(f"| {library} | {case} | " + " | ".join(row.get(p, "none") for p in PARAMETERS) + " |")
    batches = sorted({r["batch"] for r in of["torch"]["rate"]})
    head = " | ".join(f"batch {b}" for b in batches)
    text += [
        "",
        f"Frames a second; in brackets, the share of the bound by copying that the GPU reaches:\n\n| library | what | skin | on | {head} |",
    ]
    text.append("|---" * (4 + len(batches)) + "|")
    for library, kinds in of.items():
        lines: dict[tuple[str, ...], list[str]] = {}
        for r in kinds["rate"]:
            lines.setdefault((library, f"{r['task']}, {r['dtype']}", r["skin"], r["device"]), []).append(
                _rate(r, device)
            )
        text += ["| " + " | ".join((*key, *cells)) + " |" for key, cells in lines.items()]
    return [*text, ""]


def _rate(row: dict[str, Any], device: str) -> str:
    if "frames_per_second" not in row:
        return f"none, {row['left_out']}"
    share = f" ({_percent(row['frames_per_second'] / row['bound'])})" if row["device"] == device else ""
    rate = float(f"{row['frames_per_second']:.3g}")
    return f"{rate:.0f}{share}"


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"


def _cores(kinds: dict[str, list[dict[str, Any]]]) -> str:
    return str(kinds["compiled"][-1]["name"])


def _pairs(of: dict[str, Any], device: str, task: str, batch: int) -> list[tuple[float, float]]:
    """Rates on the device and on the processor, of each skin and type that was measured on both."""
    found = []
    for kinds in of.values():
        rates = {
            (r["skin"], r["dtype"], r["device"]): r["frames_per_second"]
            for r in kinds["rate"]
            if (r["task"], r["batch"]) == (task, batch) and "frames_per_second" in r
        }
        found += [(v, rates[s, t, "cpu"]) for (s, t, d), v in rates.items() if d == device and (s, t, "cpu") in rates]
    return found


def stored(found: dict[str, Any]) -> str:
    """The same as text, one measurement a line, in four digits."""
    four = [
        {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in row.items()} | {"library": library}
        for library, kept in found.items()
        for row in kept["rows"]
    ]
    failed = {library: kept["failed"] for library, kept in found.items()}
    return json.dumps({"failed": failed})[:-1] + ', "rows": [\n' + ",\n".join(map(json.dumps, four)) + "\n]}\n"


def restored(text: str) -> dict[str, Any]:
    """What `stored` made."""
    kept = json.loads(text)
    return {
        library: {"rows": [r for r in kept["rows"] if r["library"] == library], "failed": failed}
        for library, failed in kept["failed"].items()
    }


if __name__ == "__main__":
    for found_row in rows(sys.argv[1], sys.argv[2], tuple(map(int, sys.argv[3:]))):
        print(json.dumps(found_row), flush=True)
