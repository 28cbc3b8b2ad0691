"""File formats: one class each, found by the ending of the file name or else by the contents.

A new format is one file with a class derived from `Format` and one line: in `BUILT_IN`, or as an entry point
``palpate.formats`` of another package. Errors, the command line, results and recordings all use this list.
"""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from palpate._extras import require
from palpate._files import ordinary
from palpate.errors import InvalidInput
from palpate.recordings.checked import SALVAGED
from palpate.recordings.columns import TableMapping
from palpate.recordings.files import atomically, in_place
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.opened import OpenRecording
from palpate.recordings.recording import Recording
from palpate.recordings.redaction import without_secrets_in_meta

if TYPE_CHECKING:
    from palpate.recordings.sinks import Recorder
    from palpate.recordings.tabletext import Table, Titles
    from palpate.recordings.touchstream import TouchStream
    from palpate.touch import Touch

__all__ = [
    "BUILT_IN",
    "ENTRY_POINTS",
    "Format",
    "endings",
    "existing",
    "file_format",
    "find_format",
    "formats",
    "open_recording",
    "read_recording",
    "write_recording",
]

#: palpate's own formats: "module:class". Contents of files are tested in this order.
BUILT_IN = (
    "palpate.recordings.netcdf:NetCDF",
    "palpate.recordings.npz:Npz",
    "palpate.recordings.robots:Mcap",
    "palpate.recordings.robots:Bag",
    "palpate.recordings.zarrstore:Zarr",
    "palpate.recordings.csvfile:Csv",
    "palpate.recordings.tablefile:Table",
    "palpate.recordings.arraytables:Parquet",
    "palpate.recordings.arraytables:Npy",
)
#: Entry points of other packages, one per format.
ENTRY_POINTS = "palpate.formats"


class Format:
    """One file format. A subclass sets the class variables and overrides what the format can do; everything else
    raises an error that names the format.

    | override | to |
    |---|---|
    | `recognises` | find such a file by its first bytes, if its ending is unknown |
    | `read`, `write` | read and write recordings of palpate: channels, times and units are in the file |
    | `columns`, `read_mapped` | read tables of other programs with ``--map``; `own` then distinguishes a recording of palpate from such a table |
    | `opened` | read a long recording piece by piece |
    | `read_touch`, `write_touch`, `touch_stream`, `recorder` | read and write results, whole or frame by frame |

    ``read`` and ``read_touch`` get a path that exists and looks like this format. They raise `palpate.InvalidInput`
    for anything that cannot be read, and never return numbers that may be wrong. The writing methods get a temporary
    name in the right folder; a complete file is then moved into place.

    Examples
    --------
    >>> class Words(Format):
    ...     name, extensions = "words", (".words",)
    >>> words = Words()
    >>> words.can("read"), words.recognises(Path("notes.words"))
    (False, False)

    >>> words.usable() is words  # it needs no library
    True
    """

    #: name in messages
    name: ClassVar[str]
    #: endings of file names, in lower case, the usual one first
    extensions: ClassVar[tuple[str, ...]]
    #: libraries needed besides palpate's core
    libraries: ClassVar[tuple[str, ...]] = ()
    #: whether a recording is a folder
    folder: ClassVar[bool] = False
    #: whether it is text: contents cannot distinguish it from other text, so only its ending counts
    text: ClassVar[bool] = False

    def recognises(self, path: Path) -> bool:
        """Whether the first bytes look like this format; the file need not be complete."""
        return False

    def own(self, path: Path) -> bool:
        """Whether this file is a recording of palpate, not a table of another program; for formats that hold either."""
        return False

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        """Read the recording in a file; ``salvage``: the intact part of a damaged one."""
        raise self._cannot("read", path)

    def read_mapped(self, path: Path, mapping: TableMapping) -> Recording:
        """Read the recording in a table of another program."""
        raise self._cannot("read_mapped", path)

    def columns(self, path: Path, wanted: Callable[[Titles], Sequence[int]]) -> Table:
        """Read the columns of a table that ``wanted`` picks."""
        raise self._cannot("columns", path)

    @contextmanager
    def opened(self, path: Path, *, mapping: TopicMapping | None = None) -> Iterator[OpenRecording]:
        """Open the recording in a file, to be read piece by piece; formats that cannot do that read it whole."""
        yield OpenRecording.of(self.read(path, mapping=mapping), str(path))

    def write(self, recording: Recording, path: Path) -> None:
        """Write a whole recording."""
        raise self._cannot("write", path)

    def read_touch(self, path: Path) -> Any:
        """Read the xarray.Dataset of a result."""
        raise self._cannot("read_touch", path)

    def write_touch(self, touch: Touch, path: Path, record: Mapping[str, str]) -> None:
        """Write a result; ``record`` is its provenance."""
        raise self._cannot("write_touch", path)

    @contextmanager
    def touch_stream(
        self,
        path: Path,
        count: int,
        record: Mapping[str, str],
        *,
        run: Mapping[str, Any] | None = None,
        resume: bool = False,
        replace: bool = False,
    ) -> Iterator[TouchStream]:
        """A writer for the touches of ``count`` frames piece by piece; the result is at ``path`` when the ``with``
        block succeeds.

        ``run`` describes the run, for formats that can continue an interrupted run (``resume``); ``replace``: an
        existing file may be replaced.
        """
        if resume:
            raise InvalidInput(f"{path}: a run into {self.name} cannot be continued after an interruption.")
        if not self.can("write_touch"):
            raise self._cannot("write_touch", path)
        with in_place(path) as temporary:
            stream = self._touches(temporary, count, record)
            try:
                yield stream
                stream.finish()
            except BaseException:
                stream.abandon()
                raise

    def _touches(self, path: Path, count: int, record: Mapping[str, str]) -> TouchStream:
        """A stream of touches into a temporary file; by default everything is written at the end."""
        from palpate.recordings.touchstream import Collected

        return Collected(path, count, record, self.write_touch)

    def recorder(
        self, path: Path, channels: Sequence[str], *, positions: Any, meta: Mapping[str, Any] | None
    ) -> Recorder:
        """A writer for a stream."""
        raise self._cannot("recorder", path)

    def can(self, task: str) -> bool:
        """Whether the subclass overrides ``task``, the name of a method."""
        return getattr(type(self), task) is not getattr(Format, task)

    def usable(self) -> Format:
        """The format itself if its libraries are installed; otherwise `Unsupported` names the extra."""
        require(f"{self.name} files", *self.libraries)
        return self

    def _cannot(self, task: str, path: Path) -> InvalidInput:
        return InvalidInput(f"{path}: {_TASKS[task]} as {', '.join(endings(task))}; got {path.suffix.lower()!r}.")


#: Endings of pickle, which executes its contents and is never read.
PICKLES = (".pkl", ".pickle")
#: Remedies for files that palpate does not read.
_ELSEWHERE = {
    ".mat": "; a displacement field is for palpate tfm",
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "; save the sheet as CSV"),
    **dict.fromkeys((".feather", ".arrow"), "; pandas.read_feather(...).to_parquet(...) saves it as Parquet"),
}
_TASKS = {
    "read": "a recording is read",
    "columns": "positions are read",
    "read_mapped": "columns are named of a table that another program wrote, which is read",
    "write": "a recording is written",
    "read_touch": "a result is read back",
    "write_touch": "a result is written",
    "recorder": "a stream is recorded",
}


# -- the registry ------------------------------------------------------------------------------------------------------


@functools.cache
def _built_in() -> tuple[Format, ...]:
    return tuple(getattr(importlib.import_module(m), n)() for m, n in (entry.split(":") for entry in BUILT_IN))


def _plugged_in() -> tuple[Format, ...]:
    loaded: list[Format] = []
    for entry in importlib.metadata.entry_points(group=ENTRY_POINTS):
        try:
            plugin = entry.load()()
        except (ImportError, AttributeError, TypeError) as error:
            raise InvalidInput(
                f"the file format {entry.name} ({entry.value}) of another package cannot be loaded ({error}); update or uninstall it."
            ) from error
        if not isinstance(plugin, Format):
            raise InvalidInput(
                f"the file format {entry.name} ({entry.value}) does not derive from Format; uninstall it."
            )
        for known_format in (*_built_in(), *loaded):
            endings_of_both = set(plugin.extensions) & set(known_format.extensions)
            if endings_of_both:
                raise InvalidInput(
                    f"the file formats {plugin.name} ({entry.value}) and {known_format.name} both claim {', '.join(sorted(endings_of_both))}; uninstall one."
                )
        loaded.append(plugin)
    return tuple(loaded)


def formats() -> tuple[Format, ...]:
    """All formats: palpate's own, then those of other packages."""
    return (*_built_in(), *_plugged_in())


def endings(task: str | None = None) -> tuple[str, ...]:
    """Accepted endings of file names; with ``task``, a method of `Format`, only those of formats that support it."""
    return tuple(e for f in formats() if task is None or f.can(task) for e in f.extensions)


def find_format(path: str | Path, *, task: str | None = None) -> Format:
    """The format of a file name that supports ``task``, a method of `Format`; `InvalidInput` if there is none."""
    suffix = Path(path).suffix.lower()
    for some in (_built_in, _plugged_in):  # those of others are looked for only where these do not serve
        for candidate in some():
            if suffix in candidate.extensions:
                if task is not None and not candidate.can(task):
                    raise candidate._cannot(task, Path(path))
                return candidate.usable()
    raise InvalidInput(
        f"{path}: the ending {suffix!r} is not known; accepted: {', '.join(endings(task))}{_ELSEWHERE.get(suffix, '')}."
    )


def file_format(path: str | Path, *, task: str | None = None) -> str:
    """The name of the format of a file name that supports ``task``; `InvalidInput` if there is none."""
    return find_format(path, task=task).name


# -- reading and writing -----------------------------------------------------------------------------------------------


def existing(path: str | Path, *, task: str = "read") -> tuple[Path, Format]:
    """An existing file and its format by name, confirmed by its contents; otherwise `InvalidInput` says why."""
    file = Path(path)
    if not file.exists():
        find_format(file)  # report an impossible name first
        raise InvalidInput(f"{file}: no such file.")
    if file.is_dir():
        inside = next((f for f in _built_in() if f.folder and f.recognises(file)), None)
        if inside is not None:
            return file, inside.usable()
        try:
            file_type = find_format(file)
        except InvalidInput as error:
            raise InvalidInput(f"{file} is a folder; give a file, a ROS 2 bag or a Zarr store.") from error
        if not file_type.folder:
            raise InvalidInput(f"{file} is a folder; give a file.")
        raise InvalidInput(f"{file}: cannot be read as {file_type.name}; it is damaged or something else.")
    if ordinary(file).stat().st_size == 0:
        raise InvalidInput(f"{file} is empty.")
    if file.suffix.lower() in PICKLES:
        _refuse_pickle(file)
    try:
        file_type = find_format(file)
    except InvalidInput as error:
        inside = _inside(file, task)
        if inside is None:
            raise
        raise InvalidInput(
            f"{str(error).rstrip('.')}. What is inside looks like {inside.name}: rename it to {file.with_suffix(inside.extensions[0]).name}."
        ) from error
    if file_type.folder and file_type.name != "bag":
        raise InvalidInput(f"{file}: a {file_type.name} store is a folder; got a file.")
    if file_type.can("recognises") and not file_type.recognises(file):
        inside = _inside(file, task)
        hint = "it is truncated, damaged or of another format"
        if inside is not None:
            hint = (
                f"what is inside looks like {inside.name}: rename it to {file.with_suffix(inside.extensions[0]).name}"
            )
        raise InvalidInput(f"{file}: cannot be read as {file_type.name}; {hint}.")
    return file, file_type


def _refuse_pickle(path: Path) -> None:
    """Raise an error for a pickle, with an alternative."""
    ending, call = (".parquet", "to_parquet") if importlib.util.find_spec("pyarrow") else (".csv", "to_csv")
    table = f"pandas.DataFrame(pandas.read_pickle({str(path)!r})).rename(columns=str)"
    raise InvalidInput(
        f"{path} is a pickle, which can run any program when it is read, and is not read. If you trust who made it, save its table in another format: "
        f"{shell_line('pandas', f'{table}.{call}({str(path.with_suffix(ending))!r})')}"
    )


def shell_line(module: str, code: str) -> str:
    """A shell command that runs some Python code.

    Examples
    --------
    >>> from palpate.recordings.formats import shell_line
    >>> print(shell_line("numpy", "numpy.save('a.npy', [1.0])"))
    python -c "import numpy; numpy.save('a.npy', [1.0])"
    """
    return f'python -c "import {module}; {code}"'


def _inside(path: Path, task: str) -> Format | None:
    """The format that the contents of a file look like; None for text, because any text would look like CSV."""
    return next((f for f in formats() if not f.text and not f.folder and f.can(task) and f.recognises(path)), None)


def read_recording(
    path: str | Path, *, mapping: TopicMapping | TableMapping | None = None, salvage: bool = False
) -> Recording:
    """Read a recording; the format follows the file name (`endings`), a folder is a ROS 2 bag or a Zarr store.

    Files that palpate wrote carry checksums: one that was damaged is refused.

    Parameters
    ----------
    path : str or Path
    mapping : TopicMapping or TableMapping, optional
        The place of the readings in a robot's MCAP file or bag, or the columns of another program's table (palpate's own need none).
    salvage : bool
        Read the intact part of a torn file (MCAP, HDF5 that a `Recorder` did not close, the whole lines of a CSV). ``meta["salvaged"]`` states the
        losses.

    Returns
    -------
    Recording

    Raises
    ------
    InvalidInput
        The file is not there, damaged, or does not hold a recording.

    Examples
    --------
    >>> import tempfile
    >>> from palpate.recordings import Recording, read_recording, write_recording
    >>> press = Recording(readings=[[[0.0, 1.0, 0.0]]], channels=["stress_zz"], time=[0.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_recording(press, f"{folder}/press.npz")
    ...     again = read_recording(f"{folder}/press.npz")
    >>> again.readings.tolist(), again.channels
    ([[[0.0, 1.0, 0.0]]], ('stress_zz',))
    """
    file, file_type = existing(path)
    if isinstance(mapping, TableMapping):
        if salvage:
            raise InvalidInput(
                f"{path}: salvage is for what palpate wrote; leave it out for a table of another program."
            )
        return file_type.read_mapped(file, mapping)
    recording = file_type.read(file, mapping=mapping, salvage=salvage)
    if salvage and SALVAGED not in recording.meta:  # a format without partial reading
        return replace(recording, meta={**recording.meta, SALVAGED: "nothing is lost"})
    return recording


@contextmanager
def open_recording(path: str | Path, *, mapping: TopicMapping | TableMapping | None = None) -> Iterator[OpenRecording]:
    """Open a recording to be read piece by piece while the ``with`` block lasts: NetCDF, HDF5, Zarr and long CSV;
    other formats are read whole.

    The checksum covers all frames and is verified by `OpenRecording.survey`.

    Raises
    ------
    InvalidInput
        The file is not there, damaged, or does not hold a recording.

    Examples
    --------
    >>> import tempfile
    >>> from palpate.recordings import Recording, open_recording, write_recording
    >>> press = Recording(readings=[[[0.0, 1.0, 0.0]], [[0.0, 2.0, 0.0]]], channels=["stress_zz"])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_recording(press, f"{folder}/press.nc")
    ...     with open_recording(f"{folder}/press.nc") as opened:
    ...         count, last = len(opened), opened.frames(1, 2)
    >>> count, last.readings.tolist()
    (2, [[[0.0, 2.0, 0.0]]])
    """
    file, file_type = existing(path)
    if isinstance(mapping, TableMapping):
        yield OpenRecording.of(file_type.read_mapped(file, mapping), str(path))
        return
    with file_type.opened(file, mapping=mapping) as recording:
        yield recording


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording; the format follows the file name.

    NetCDF, NPZ and Zarr keep every bit, CSV writes 17 digits, MCAP nanoseconds. All carry a checksum.

    Raises
    ------
    InvalidInput
        An ending that is not known, or a store that exists.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import Recording, write_recording
    >>> press = Recording(readings=[[[0.0, 1.0, 0.0]]], channels=["stress_zz"], time=[0.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_recording(press, f"{folder}/press.csv")
    ...     text = Path(f"{folder}/press.csv").read_text()
    >>> "stress_zz" in text
    True
    """
    meta = without_secrets_in_meta(recording.meta)
    kept = recording if meta == recording.meta else replace(recording, meta=meta)
    into_place(path, lambda known, name: known.write(kept, name), task="write")


def into_place(path: str | Path, write: Callable[[Format, Path], None], *, task: str) -> None:
    """Write to a temporary file beside the target, and move the complete file there; remove it if that fails."""
    file_type = find_format(path, task=task)
    if file_type.folder:
        if Path(path).exists():
            raise InvalidInput(f"{path} exists; a store is not overwritten. Give another name.")
        with in_place(path) as temporary:
            write(file_type, temporary)
    else:
        atomically(path, lambda name: write(file_type, Path(name)))
