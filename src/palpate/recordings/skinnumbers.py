"""Results of a calibration: a section of a skin.toml that names a file of plain numbers beside it (.npz). No content
of it is executed.
"""

from __future__ import annotations

import re
import tomllib
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.files import atomically, write_arrays
from palpate.recordings.skinfile import skin_text

__all__ = ["read_numbers", "text_with_section", "write_numbers"]

#: Version of the file of numbers.
VERSION = 1
Found = TypeVar("Found")


def text_with_section(text: str, section: str, said: object, numbers: str) -> str:
    """The text of a skin.toml with a section that names the file of ``numbers``; it replaces an old one, and comments give the findings (``said``).

    Examples
    --------
    >>> print(text_with_section("[pad]\\n", "colour", "3 presses", "gel.colour.npz"))
    [pad]
    <BLANKLINE>
    [colour]
    # 3 presses
    file = "gel.colour.npz"
    <BLANKLINE>
    """
    kept = re.sub(rf"(?ms)^\[{section}\]\s*$.*?(?=^\[|\Z)", "", text).rstrip()
    comments = "".join(f"# {line}\n" for line in str(said).splitlines())
    return f'{kept}\n\n[{section}]\n{comments}file = "{numbers}"\n'


def write_numbers(
    path: str | Path, skin_file: str | Path, section: str, said: object, held: Mapping[str, Any]
) -> tuple[Path, Path]:
    """Write a skin.toml with the section and, beside it, NAME.SECTION.npz with arrays by name; returns both paths.

    Raises
    ------
    InvalidInput
        A name that does not end in .toml, or another folder than that of a skin.toml that names a positions_file.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     skin = Path(folder, "skin.toml")
    ...     _ = skin.write_text("[pad]")
    ...     made = write_numbers(Path(folder, "new.toml"), skin, "colour", "3 presses", {"gain": np.ones(2)})
    ...     [p.name for p in made], read_numbers(made[0], "colour", lambda held: held["gain"].tolist(), remedy="Calibrate again")
    (['new.toml', 'new.colour.npz'], [1.0, 1.0])
    """
    target, source = Path(path), Path(skin_file)
    if target.suffix.lower() != ".toml":
        raise InvalidInput(f"{target}: a calibrated skin file ends in .toml. Write {target.with_suffix('.toml').name}.")
    text = skin_text(source)
    if re.search(r"(?m)^\s*positions_file\s*=", text) and target.resolve().parent != source.resolve().parent:
        raise InvalidInput(
            f"{source} names a positions_file beside it: write {target.name} into {source.resolve().parent}."
        )
    numbers = target.with_name(f"{target.stem}.{section}.npz")

    def fill_text(name: str) -> None:
        Path(name).write_text(text_with_section(text, section, said, numbers.name), encoding="utf-8")

    write_arrays(numbers, {"version": np.asarray(VERSION), **held})
    atomically(target, fill_text)
    return target, numbers


def read_numbers(
    skin_file: str | Path, section: str, made: Callable[[dict[str, Any]], Found], *, remedy: str
) -> Found | None:
    """The result of ``made`` for the arrays that the section of a skin.toml names; None without such a section.

    Raises
    ------
    InvalidInput
        The file of numbers is not there, is damaged, or of a newer palpate; ``remedy`` says what makes a new one.

    Examples
    --------
    See `write_numbers`.
    """
    source = Path(skin_file)
    try:
        named = tomllib.loads(skin_text(source)).get(section)
    except ValueError:
        return None  # what reads the pad says what is wrong with the file
    if named is None:
        return None
    path = source.parent / str(named.get("file", ""))
    if not path.is_file():
        raise InvalidInput(
            f"{source}: its [{section}] names {path.name}, which is not beside it. Copy it there, or {remedy[:1].lower()}{remedy[1:]}."
        )
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            held = {k: file[k] for k in file.files}
        if int(held["version"]) != VERSION:
            raise ValueError(f"form {int(held['version'])}, and this palpate reads {VERSION}")
        return made(held)
    except (KeyError, ValueError, TypeError, OSError, zipfile.BadZipFile, np.linalg.LinAlgError) as error:
        raise InvalidInput(f"{path}: no file of palpate for [{section}], or damaged ({error}). {remedy}.") from error
