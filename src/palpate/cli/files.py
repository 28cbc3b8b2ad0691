"""What commands write, and what they say about how it was made."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import palpate
from palpate.errors import InvalidInput


def skin_text(skin_file: Path | None) -> str:
    return "" if skin_file is None else skin_file.read_text(encoding="utf-8")


def provenance(skin: str, recording: str = "") -> dict[str, str]:
    import platform

    import numpy
    import scipy

    record = {
        "palpate": palpate.__version__,
        "command": command_line(),
        "skin": skin,
        "versions": f"python {platform.python_version()}, numpy {numpy.__version__}, scipy {scipy.__version__}",
    }
    if recording:
        record["recording"] = recording
    return record


def command_line() -> str:
    import shlex

    return shlex.join(["palpate", *sys.argv[1:]])


def make_folder(path: Path) -> Path:
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path} is a file; give a folder.")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot make the folder ({error.strerror}).") from error
    return path


def write_text(path: Path, text: str) -> None:
    from palpate.recordings.formats import atomically

    atomically(path, lambda name: _fill(name, text))


def _fill(name: str, text: str) -> None:
    Path(name).write_text(text, encoding="utf-8")


def save_figure(figure: Any, path: Path) -> None:
    from palpate.recordings.formats import atomically

    atomically(path, lambda name: figure.savefig(name, dpi=130))
