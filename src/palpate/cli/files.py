"""Output files of commands: names, overwriting, provenance."""

from __future__ import annotations

import contextlib
import contextvars
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

import palpate
from palpate.errors import InvalidInput

#: While a table is still growing, its rows are written after this many seconds, and writing may take this fraction of
#: the time.
KEPT_EVERY, KEPT_PART = 5.0, 0.02
_HELP = "Replace an existing result. Input files are never replaced."
Force = Annotated[bool, typer.Option("--force", "--overwrite", help=_HELP)]
#: Option of commands whose --force is the force of a contact.
Overwrite = Annotated[bool, typer.Option("--overwrite", help=_HELP)]


def check_output(path: Path, *, inputs: Iterable[Path | None] = (), force: bool, option: str = "--force") -> None:
    """Raise `InvalidInput`, before any work, if the output ``path`` cannot or must not be written: if it is one of
    ``inputs``, if it exists and ``force`` is false, or if its folder does not exist.

    An input is recognised under any name (through a link, another path, or in other case), and so is a file inside an
    input folder. ``option`` is the option that the message names for replacing a file. Inside ``with sole_writers()``
    this function also locks ``path`` until the ``with`` ends: it raises an error if another process is writing the
    file, and other processes cannot write it meanwhile.
    """
    from palpate.recordings.files import is_store
    from palpate.recordings.locks import sole_writer

    try:
        for source in inputs:
            if source is not None and _overlap(path, source):
                raise InvalidInput(
                    f"{path} is an input ({source}), or part of one, and would be overwritten. Give another name."
                )
        if not Path(os.path.realpath(path)).parent.is_dir():
            raise InvalidInput(f"{path}: the folder {path.parent} does not exist; make it first.")
        with contextlib.suppress(FileNotFoundError):
            os.lstat(path)  # lstat raises an error if a name is too long; is_dir() and lexists() may not
        locks = _locks.get()
        if locks is not None:
            locks.enter_context(sole_writer(path))
        if path.is_dir() and not (path.suffix.lower() == ".zarr" and is_store(path)):
            raise InvalidInput(f"{path} is a folder; give a file name.")
        if os.path.lexists(path) and not force:
            raise InvalidInput(f"{path} exists. Give another name, or {option} to replace it.")
        if not os.access(Path(os.path.realpath(path)).parent, os.W_OK):
            raise InvalidInput(f"{path}: cannot write there (Permission denied).")
    except OSError as error:  # a name that is too long, a loop of links
        raise InvalidInput(f"{path}: cannot write there ({error.strerror}).") from error


def check_outputs(
    named: Mapping[str, Path | None], *, inputs: Iterable[Path | None] = (), force: bool, option: str = "--force"
) -> None:
    """Check all outputs of a command, by option: no two may be the same file, or one lie inside the other."""
    sources, before = list(inputs), dict[str, Path]()
    for name, path in named.items():
        if path is None:
            continue
        check_output(path, inputs=sources, force=force, option=option)
        real = Path(os.path.realpath(path))
        for other, taken in before.items():
            if real == taken or real in taken.parents or taken in real.parents:
                raise InvalidInput(f"{other} and {name} both write {path}: give one of them another name.")
        before[name] = real


#: Locks on the output files of the running command.
_locks: contextvars.ContextVar[contextlib.ExitStack | None] = contextvars.ContextVar("locks", default=None)


@contextlib.contextmanager
def sole_writers() -> Iterator[None]:
    """Within the ``with``, keep other processes from writing the files that `check_output` has passed."""
    with contextlib.ExitStack() as stack:
        token = _locks.set(stack)
        try:
            yield
        finally:
            _locks.reset(token)


def _overlap(target: Path, source: Path) -> bool:
    """Return whether writing ``target`` would change ``source``."""
    real, other = Path(os.path.realpath(target)), Path(os.path.realpath(source))
    if not source.exists():  # intermediate, like the preparation
        return real == other
    if real.exists() and real.samefile(other):
        return True
    inside = other.is_dir() and any(p.exists() and p.samefile(other) for p in real.parents)
    around = real.is_dir() and any(p.samefile(real) for p in other.parents)
    return inside or around


def written(path: Path, write: Callable[[Path], None]) -> None:
    """Write a result. An existing store is replaced once the new one is complete (files always are)."""
    from palpate.recordings.files import in_place

    if path.is_dir():
        with in_place(path) as fresh:
            write(fresh)
    else:
        write(path)


def skin_files(skin_file: Path | None) -> list[Path]:
    """Return a skin.toml and the files that it names, which are read with it."""
    import tomllib

    if skin_file is None:
        return []
    try:
        tables: Any = tomllib.loads(skin_text(skin_file))
    except (InvalidInput, ValueError, RecursionError):
        return [skin_file]  # the reader reports the error
    planes = tables.get("plane", [])
    named = [p.get("positions_file") for p in planes if isinstance(p, dict)] if isinstance(planes, list) else []
    return [skin_file, *(skin_file.parent / n for n in named if isinstance(n, str))]


def skin_text(skin_file: Path | None) -> str:
    """Return the text of a skin.toml, to be stored in the files that are made with it."""
    from palpate.recordings.skinfile import skin_text as text_of_skin

    return "" if skin_file is None else text_of_skin(skin_file)


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
    """Return the command line, to be stored in the files that it made; secrets are hidden."""
    import shlex

    from palpate.recordings.redaction import without_secrets

    return shlex.join(["palpate", *without_secrets(sys.argv[1:])])


def make_folder(path: Path) -> Path:
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path} is a file; give a folder.")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot make the folder ({error.strerror}).") from error
    return path


def write_text(path: Path, text: str) -> None:
    from palpate.recordings.files import atomically

    atomically(path, lambda name: _fill(name, text))


def _fill(name: str, text: str) -> None:
    Path(name).write_text(text, encoding="utf-8")


def save_figure(figure: Any, path: Path) -> None:
    from palpate.recordings.files import atomically

    kind = path.suffix.lower().lstrip(".") or "png"
    atomically(path, lambda name: figure.savefig(name, dpi=200, format=kind))


def write_forces(forces: Any, path: Path) -> None:
    """Write the table of a `Forces`, completely or not at all."""
    from palpate.recordings.files import atomically

    atomically(path, forces.write)


@contextlib.contextmanager
def whole_result(paths: Iterable[Path]) -> Iterator[dict[Path, Path]]:
    """Give a temporary path for each file of a result, and move the files to ``paths`` together once all are complete.
    If the command is stopped before, it replaces none of them.
    """
    from tempfile import TemporaryDirectory

    from palpate.recordings.files import moved_into_place

    with contextlib.ExitStack() as stack:
        folders: dict[Path, Path] = {}
        fresh: dict[Path, Path] = {}
        for path in paths:
            parent = Path(os.path.realpath(path)).parent
            if parent not in folders:  # beside each target, because a file moves atomically only within one disk
                made = TemporaryDirectory(prefix=".palpate-", dir=parent, ignore_cleanup_errors=True)
                folders[parent] = Path(stack.enter_context(made))
            fresh[path] = folders[parent] / path.name
        try:
            yield fresh
        except KeyboardInterrupt:
            typer.echo("no result was written, and none that was there is changed", err=True)
            raise
        for path, at in fresh.items():
            moved_into_place(at, path)


@contextlib.contextmanager
def rows_in_part_file(forces: Any, path: Path | None) -> Iterator[Callable[[], None]]:
    """Write a table whose frames are still arriving. Call the function given after each frame; the rows so far are
    then written every few seconds, and when the command is stopped.

    Until the table is complete, an old result stays, and the rows are in NAME.part.csv beside it. If ``path`` is None,
    nothing is written.
    """
    if path is None:
        yield lambda: None
        return
    whole = not path.exists()
    so_far = path if whole else path.with_name(f"{path.stem}.part{path.suffix}")
    last, took, kept = time.monotonic(), 0.0, 0

    def keep() -> None:
        nonlocal last, took, kept
        began = time.monotonic()
        # a long table is written less often, to avoid delays
        if began - last >= max(KEPT_EVERY, took / KEPT_PART):
            write_forces(forces, so_far)
            last = time.monotonic()
            took, kept = last - began, len(forces)

    try:
        yield keep
    except BaseException:
        if len(forces) > kept:
            write_forces(forces, so_far)
        if len(forces):
            typer.echo(f"{so_far} holds the {len(forces)} frames before.", err=True)
        raise
    write_forces(forces, path)
    if not whole:
        so_far.unlink(missing_ok=True)


def write_frame(sink: Any, time: float, values: Any, touch: Any, events: Iterable[Any]) -> None:
    """Pass a frame of a stream, with its touch and events, to a sink."""
    sink.readings(time, values)
    sink.touch(touch)
    for event in events:
        sink.event(event)


def finish_stream(
    touches: list[Any], forces: Any, events: list[Any], *, out: Path | None, plot_forces: Path | None, record: Any
) -> None:
    """Write the touches and the plot of a stream, and print its table and notes."""
    from palpate._plot import plot_forces as drawn
    from palpate.recordings import write_touch
    from palpate.touch import joined
    from palpate.touch.table import table_words

    if touches and out is not None:
        write_touch(joined(touches), out, provenance=record)
    if plot_forces is not None:
        save_figure(drawn(forces.table(), events=events), plot_forces)
    typer.echo(table_words(forces.table()))
    for note in forces.notes:
        typer.echo(f"note: {note}")
