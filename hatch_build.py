"""Build hook: compile the core of `palpate.inverse.constrained` if there is a compiler; without it palpate is pure Python.

PALPATE_PURE=1 builds a wheel for every platform, without the core. PALPATE_CORE=1 makes a missing compiler an error.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOM = Path("src", "palpate", "inverse", "constrained")
#: The libraries of `palpate.inverse.constrained.compiled`, and what the second one adds.
PLAIN, SECOND = ROOM / "core.compiled", ROOM / "core_avx2.compiled"
SECOND_FLAGS = {"cl": ["/arch:AVX2"], "other": ["-mavx2", "-mfma"]}


class Core(BuildHookInterface[Any]):
    """Compile the core into the source tree, from where both wheels and editable installs take it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say in ``build_data`` what belongs into the wheel."""
        for library in (PLAIN, SECOND):
            Path(self.root, library).unlink(missing_ok=True)
        if os.environ.get("PALPATE_PURE"):
            return
        compiler = next((c for c in self._compilers() if self._compile(c, PLAIN)), None)
        if compiler is None:
            if os.environ.get("PALPATE_CORE"):
                raise RuntimeError("no C++17 compiler could build the core of palpate: set CXX, or unset PALPATE_CORE")
            self.app.display_warning(
                "No C++17 compiler: palpate is installed without its compiled core, and is slower."
            )
            return
        made = [PLAIN]
        if platform.machine().lower() in ("x86_64", "amd64") and self._compile(compiler, SECOND, second=True):
            made.append(SECOND)
        build_data["artifacts"] += [library.as_posix() for library in made]
        build_data["pure_python"] = False
        where = sysconfig.get_platform().replace("universal2", platform.machine())  # this compiles for one processor
        build_data["tag"] = f"py3-none-{where.replace('-', '_').replace('.', '_')}"

    def _compilers(self) -> list[list[str]]:
        named = [
            os.environ.get("CXX", ""),
            "c++",
            "g++",
            "clang++",
            *(["clang-cl", "cl"] if sys.platform == "win32" else []),
        ]
        commands = [shlex.split(name, posix=sys.platform != "win32") for name in named]
        return [c for c in commands if c and shutil.which(c[0])]

    def _compile(self, compiler: list[str], library: Path, *, second: bool = False) -> bool:
        """Whether the compiler makes a library."""
        source, out = Path(self.root, ROOM, "core", "core.cpp"), Path(self.root, library)
        made = out.with_suffix(f".{os.getpid()}")
        if Path(compiler[0]).stem in ("cl", "clang-cl"):
            flags = ["/nologo", "/O2", "/std:c++17", "/EHsc", "/LD", *(SECOND_FLAGS["cl"] if second else [])]
            command = [*compiler, *flags, str(source), f"/Fe:{made}", f"/Fo:{made}.obj"]
        else:
            flags = ["-O3", "-std=c++17", "-shared", "-fPIC", "-fvisibility=hidden", "-Wno-psabi"]
            command = [*compiler, *flags, *(SECOND_FLAGS["other"] if second else []), str(source), "-o", str(made)]
        try:
            if subprocess.run(command, capture_output=True).returncode or not made.is_file():
                return False
            os.replace(made, out)  # a process may run the library before
            return True
        except OSError:
            return False
        finally:
            for left in made.parent.glob(f"{made.name}*"):
                left.unlink()
