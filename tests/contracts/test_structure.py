from __future__ import annotations

import ast
import functools
import gc
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import lil_array
from scipy.sparse.csgraph import connected_components

import palpate as pp

SOURCE = Path(pp.__file__).parent

#: Rooms from the ground up: each may import only from those above it in this list (and from itself).
ROOMS = [
    "errors",
    "_memory",
    "_files",
    "_threads",
    "status",
    "units",
    "_numbers",
    "_transforms",
    "_arrays",
    "_batches",
    "_extras",
    "_recall",
    "elastic",
    "solutions",
    "sensing",
    "solid",
    "measured",
    "inverse",
    "comparison",
    "uncertainty",
    "_plot",
    "touch",
    "grasp",
    "tracking",
    "recordings",
    "network",
    "design",
    "calibrate",
    "identify",
    "_skin_properties",
    "skin",
    "archives",
    "simulation",
    "pressing",
    "camera",
    "microscopy",
    "sensors",
    "edges",
    "pads",
    "paper",
    "bench",
    "live",
    "ros",
    "mujoco",
    "torch",
    "jax",
    "lerobot",
    "cli",
    "__main__",
]


def room(module: str) -> str:
    return module.split(".")[1] if "." in module else "palpate"


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file. The garbage collector would search all trees that are kept, again and again: three quarters of the time."""
    gc.disable()
    try:
        return ast.parse(path.read_text())
    finally:
        gc.enable()


def modules() -> dict[str, Path]:
    """Every module of palpate by its name."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(("palpate", *(parts[:-1] if parts[-1] == "__init__" else parts)))] = path
    return found


MODULES = modules()


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Every statement inside a node, without its expressions: a tenth of the nodes."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for child in getattr(node, part, ()):
            yield child
            yield from statements(child)


@functools.cache
def imports(path: Path) -> set[str]:
    """Modules of palpate that a file imports: at its top, inside functions, and for type checking alone."""
    found = set()
    for node in statements(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "palpate":
            names = {f"{node.module}.{a.name}" for a in node.names}
            found |= {n if n in MODULES or node.module == "palpate" else node.module for n in names}
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names if a.name.startswith("palpate.")}
    return found


def circles() -> list[set[str]]:
    """Groups of files that import each other in a circle (strongly connected components of more than one file)."""
    names = [name for name in MODULES if name != "palpate"]
    place = {name: i for i, name in enumerate(names)}
    graph = lil_array((len(names), len(names)), dtype=bool)
    for name, i in place.items():
        for other in imports(MODULES[name]) & place.keys():
            graph[i, place[other]] = True
    count, label = connected_components(graph.tocsr(), connection="strong")
    groups = [{names[i] for i in np.flatnonzero(label == k)} for k in range(count)]
    return [group for group in groups if len(group) > 1]


def test_no_circles() -> None:
    """No file imports, by whatever way, one that imports it, between rooms or inside of one."""
    found = [", ".join(sorted(group)) for group in circles()]
    assert not found, f"these files import each other in a circle: {'; '.join(found)}"


def test_rooms() -> None:
    wrong = []
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        if parts == ("__init__",):
            continue
        own = parts[0]
        assert own in ROOMS, f"the new room {own} needs a place in ROOMS and in docs/architecture.md"
        for module in imports(path):
            other = room(module)
            if other != own and ROOMS.index(other) >= ROOMS.index(own):
                wrong.append(f"{'/'.join(parts)} imports {module}")
    assert wrong == []


def test_the_page_and_the_picture_of_the_rooms_name_them_all() -> None:
    docs = Path(__file__).parents[2] / "docs"
    table = (docs / "architecture.md").read_text().split("## Rooms")[1].split("\n## ")[0]
    told = [
        name
        for row in table.splitlines()
        if row.startswith("| `")
        for name in re.findall(r"`(\w+)`", row.split("|")[1])
    ]
    floors = ast.parse((docs / "_rooms.py").read_text())
    names = {node.value for node in ast.walk(floors) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert sorted(told) == sorted(ROOMS)
    assert set(ROOMS) <= names


def test_numerics_know_no_frames() -> None:
    """`inverse/constrained` minimises; what a frame is, and which explanation of it is the better one, is decided above it."""
    deciding = (
        "palpate.inverse.contact",
        "palpate.inverse.fit",
        "palpate.inverse.registry",
        "palpate.status",
        "palpate.errors",
    )
    found = {
        (path.name, module) for path in (SOURCE / "inverse" / "constrained").glob("*.py") for module in imports(path)
    }
    assert not {f"{name} imports {module}" for name, module in found if module.startswith(deciding)}


def test_numbers_of_the_contact_method_are_in_its_policy() -> None:
    """No other file of `inverse/contact` decides by a number of its own; `local` and `places` are another method."""
    facts = {
        "methods.LARGEST_FRICTION",
        "noise.MEDIAN",
        "no_contact.WIDE",
    }  # a limit of an option; two quantiles of a Gaussian
    found = set()
    for path in (SOURCE / "inverse" / "contact").rglob("*.py"):
        if path.stem in ("policy", "local", "places"):
            continue
        for node in tree_of(path).body:
            value = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
            if value is not None and any(
                isinstance(n, ast.Constant) and type(n.value) in (int, float) for n in ast.walk(value)
            ):
                found |= {f"{path.stem}.{name}" for name in top_level([node])}
    assert found == facts


def test_the_contact_method_has_no_circles() -> None:
    """What is prepared knows nothing of those that decide with it: no module needs an import for type checking alone."""
    for path in (SOURCE / "inverse" / "contact").rglob("*.py"):
        assert "TYPE_CHECKING" not in path.read_text(), path.name


def test_a_file_of_700_lines_is_two_rooms() -> None:
    long = {str(p.relative_to(SOURCE)): len(p.read_text().splitlines()) for p in SOURCE.rglob("*.py")}
    assert not {name: count for name, count in long.items() if count >= 700}


def top_level(body: list[ast.stmt]) -> set[str]:
    """Names that statements of a module define, without those that they import."""
    found: set[str] = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)}
        elif isinstance(node, ast.If):
            found |= top_level([*node.body, *node.orelse])
    return found


def test_names_are_offered_where_they_live() -> None:
    """Only packages gather names of their modules; a module offers none that it takes from another."""
    for path in SOURCE.rglob("*.py"):
        if path.name == "__init__.py":
            continue
        body = tree_of(path).body
        offered = [n for n in body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "__all__"]
        names = set(ast.literal_eval(offered[0].value)) if offered else set()
        assert names <= top_level(body), f"{path.name} offers {', '.join(sorted(names - top_level(body)))}"


@pytest.mark.parametrize("path", sorted(SOURCE.glob("*/__init__.py")), ids=lambda p: p.parent.name)
def test_a_room_says_what_comes_in_what_goes_out_and_where_to_begin(path: Path) -> None:
    lines = (ast.get_docstring(tree_of(path)) or "").splitlines()
    starts = [line.partition(":")[0] for line in lines if line.startswith(("In: ", "Out: ", "Open first: "))]
    assert starts == ["In", "Out", "Open first"]
    first = next(line for line in lines if line.startswith("Open first: "))
    assert (path.parent / first.split("`")[1]).is_file()


def test_public_names() -> None:
    """Each name that the stub lists is loaded from the room that the stub names, and no other name is public."""
    stub = ast.parse((SOURCE / "__init__.pyi").read_text())
    listed = {a.name: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for a in node.names}
    assert sorted(pp.__all__) == sorted({*listed, "__version__"}) == dir(pp)
    for name, module in listed.items():
        home = importlib.import_module(f"palpate.{module or name}")
        assert getattr(pp, name) is (getattr(home, name) if module else home)
    with pytest.raises(AttributeError):
        _ = pp.nothing


@pytest.mark.long
def test_type_checkers_see_the_public_names(tmp_path: Path) -> None:
    """mypy knows the type of every public name: none is Any."""
    names = [name for name in pp.__all__ if not name.startswith("_")]
    shown = tmp_path / "shown.py"
    shown.write_text("import palpate as pp\n" + "".join(f"reveal_type(pp.{name})\n" for name in names))
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), str(shown)]
    # mypy finds an installed package by itself, and refuses its folder as a path
    path = {} if SOURCE.parent.name == "site-packages" else {"MYPYPATH": str(SOURCE.parent)}
    found = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **path})
    revealed = [line for line in found.stdout.splitlines() if "Revealed type" in line]
    assert len(revealed) == len(names), found.stdout + found.stderr
    assert [line for line in revealed if line.endswith('"Any"')] == []


@pytest.mark.parametrize("name", [n for n in pp.__all__ if n[0].isupper() and n.upper() != n])
def test_public_docstrings(name: str) -> None:
    assert (getattr(pp, name).__doc__ or "").strip()


def test_import_is_light() -> None:
    """Importing palpate, and describing a skin, loads nothing for plotting, files, tables or the command line."""
    code = (
        "import sys, palpate as pp; pp.Skin(pp.HalfSpace(youngs_modulus=1., poissons_ratio=.3),"
        " pp.LineArray(count=5, pitch=1., depth=1., channels=['stress_zz']));"
        "print([m for m in ('matplotlib', 'xarray', 'pandas', 'typer', 'h5py', 'pydantic', 'torch', 'scipy.interpolate', 'scipy.optimize')"
        " if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_no_numpy_fft_in_the_arithmetic() -> None:
    """numpy.fft is not this project's door to transforms; only the frequencies of a grid may come from it."""
    for path in SOURCE.rglob("*.py"):
        for line in path.read_text().splitlines():
            if "np.fft." in line:
                assert any(f in line for f in ("fftfreq", "rfftfreq")), f"{path.name}: {line.strip()}"
