"""How large the inside of the contact method is: lines, files, numbers, branches, calls between modules.

    python benchmarks/structure.py             the table of this code
    python benchmarks/structure.py --beside ../before/src     with that of another checkout's `src` beside it
    python benchmarks/structure.py --write     into docs/_generated/structure.md

Branches are decisions in one function: if, elif, for, while, conditional expressions, `and` / `or`, conditions of comprehensions, handlers of exceptions.
Numbers are constants of modules in capitals, and the numbers and switches of `inverse/contact/policy.py`. Calls between modules are those of one frame that is prepared, in
which a function of one module of palpate calls one of another; circles are groups of modules that import each other, inside functions and for type checking too.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "_generated" / "structure.md"
#: Folders that are counted by themselves.
FOLDERS = ("inverse", "inverse/contact", "inverse/constrained", "inverse/linear", "tracking")
#: What is a decision, and how many it is.
DECIDES = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler)


def branches(function: ast.AST) -> int:
    """Decisions in a function."""
    count = 0
    for node in ast.walk(function):
        count += isinstance(node, DECIDES)
        if isinstance(node, ast.BoolOp):
            count += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            count += len(node.ifs)
    return count


def functions(folder: Path) -> Iterator[tuple[str, int, int]]:
    """Each function: its name, decisions, lines."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                name = f"{path.relative_to(folder).with_suffix('')}.{node.name}"
                yield name, branches(node), (node.end_lineno or 0) - node.lineno + 1


def constants(folder: Path) -> int:
    """Constants of modules that are written in capitals."""
    count = 0
    for path in folder.rglob("*.py"):
        for node in ast.parse(path.read_text()).body:
            targets = (
                node.targets
                if isinstance(node, ast.Assign)
                else [node.target]
                if isinstance(node, ast.AnnAssign)
                else []
            )
            names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            count += sum(n.lstrip("_").isupper() and not n.startswith("__") for n in names)
    return count


def numbers_of_dataclasses(path: Path, classes: set[str]) -> int:
    """Fields of dataclasses with a value."""
    if not path.exists():
        return 0
    found = [
        c
        for c in ast.parse(path.read_text()).body
        if isinstance(c, ast.ClassDef) and (not classes or c.name in classes)
    ]
    fields = [n for c in found for n in c.body if isinstance(n, ast.AnnAssign) and n.value is not None]
    return sum("default_factory" not in ast.unparse(n) for n in fields)


def circles(source: Path) -> int:
    """Modules that are in a circle of imports: at the top of a file, inside functions, and for type checking alone."""
    modules = {}
    for path in source.rglob("*.py"):
        parts = path.relative_to(source.parent).with_suffix("").parts
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    modules.pop("palpate", None)
    edges: dict[str, set[str]] = {}
    for name, path in modules.items():
        found: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                each = (f"{node.module}.{alias.name}" for alias in node.names)
                found |= {one if one in modules else node.module for one in each}
        found = (found & modules.keys()) - {name}
        edges[name] = found
    order: list[str] = []
    seen: set[str] = set()

    def visit(start: str, along: dict[str, set[str]], out: list[str]) -> None:
        stack = [(start, iter(along.get(start, ())))]
        seen.add(start)
        while stack:
            node, rest = stack[-1]
            step = next((n for n in rest if n not in seen), None)
            if step is None:
                out.append(node)
                stack.pop()
            else:
                seen.add(step)
                stack.append((step, iter(along.get(step, ()))))

    for name in edges:
        if name not in seen:
            visit(name, edges, order)
    back: dict[str, set[str]] = {}
    for name, targets in edges.items():
        for target in targets:
            back.setdefault(target, set()).add(name)
    seen.clear()
    count = 0
    for name in reversed(order):
        if name not in seen:
            group: list[str] = []
            visit(name, back, group)
            count += len(group) if len(group) > 1 else 0
    return count


CALLS = """
import json, sys
from pathlib import Path
import numpy as np
import palpate as pp
home = str(Path(pp.__file__).parent)
pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
skin = pp.Skin(pad, array)
clean = np.asarray(skin.sense(pp.solutions.hertz_point(force=2.0, contact_radius=2.5e-3)))
top = float(np.abs(clean).max())
noisy = clean + 0.01 * top * np.random.default_rng(3).standard_normal(clean.shape)
off = noisy + 0.15 * top
out = {}
for name, readings in (("clean", noisy), ("offset", off)):
    skin.reconstruct(readings)
    calls = 0
    def seen(frame, event, arg):
        global calls
        if event == "call" and frame.f_back is not None:
            a, b = frame.f_code.co_filename, frame.f_back.f_code.co_filename
            calls += a != b and a.startswith(home) and b.startswith(home)
    sys.setprofile(seen)
    skin.reconstruct(readings)
    sys.setprofile(None)
    out[name] = calls
print(json.dumps(out))
"""


def counted(source: Path) -> dict[str, str]:
    """The table's rows for one `src`."""
    out = {}
    for folder in FOLDERS:
        files = list((source / "palpate" / folder).rglob("*.py"))
        out[f"`{folder}/`: lines, files"] = f"{sum(len(p.read_text().splitlines()) for p in files)}, {len(files)}"
    contact = source / "palpate" / "inverse" / "contact"
    policy = numbers_of_dataclasses(contact / "policy.py", set()) + numbers_of_dataclasses(contact / "parts.py", set())
    policy -= numbers_of_dataclasses(contact / "policy.py", {"Number"})
    out["`inverse/contact/`: constants of modules"] = str(constants(contact))
    out["numbers and switches in dataclasses"] = str(policy)
    worst = sorted(functions(contact), key=lambda f: -f[1])[:3]
    out["most branches of a function"] = ", ".join(f"{n} {b} in {k} lines" for n, b, k in worst)
    out["functions with 15 branches or more"] = str(sum(b >= 15 for _, b, _ in functions(contact)))
    out["modules of palpate in circles of imports"] = str(circles(source / "palpate"))
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", CALLS], capture_output=True, text=True, check=True, env=environment)
    calls: dict[str, Any] = json.loads(done.stdout)
    out["calls between modules, a clean frame of 10 x 10 x 3"] = str(calls["clean"])
    out["the same with an offset of 15 %"] = str(calls["offset"])
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--beside", type=Path, help="the src of another checkout")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    now = counted(ROOT / "src")
    before = counted(given.beside.resolve()) if given.beside else None
    lines = [
        "# Structure",
        "",
        "Made by `python benchmarks/structure.py`" + (", compared with the earlier code." if before else "."),
        "",
        "| | before | now |" if before else "| | now |",
        "|---|---|---|" if before else "|---|---|",
    ]
    lines += [f"| {k} | {before[k]} | {v} |" if before else f"| {k} | {v} |" for k, v in now.items()]
    text = "\n".join(lines) + "\n"
    print(text)
    if given.write:
        TABLE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
