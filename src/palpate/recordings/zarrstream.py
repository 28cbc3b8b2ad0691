"""Write the touches of a long recording as a Zarr store, piece by piece, with a journal, so that an interrupted run
can continue.
"""

from __future__ import annotations

import json
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.checked import CHECKSUM, block_crc, checksum
from palpate.recordings.crc import combined
from palpate.recordings.damage import DAMAGE
from palpate.recordings.files import moved_into_place
from palpate.recordings.labelled import touch_of
from palpate.recordings.locks import sole_writer
from palpate.recordings.stores import zarr_library
from palpate.recordings.touchstream import Arrays, Piece, Written
from palpate.recordings.zarrpieces import MARKER, Place
from palpate.touch import Touch
from palpate.touch.outcome import Outcome

if TYPE_CHECKING:
    import xarray

__all__ = ["ZarrStream", "growing", "interrupted_run", "unfinished_path"]

#: Journal of finished pieces, one line each, beside a growing store.
_JOURNAL = "pieces.jsonl"


def unfinished_path(path: str | Path) -> Path:
    """The folder beside a store for unfinished data."""
    target = Path(os.path.realpath(path))
    return target.with_name(f"{target.name}.partial")


@contextmanager
def growing(
    path: Path, count: int, record: Mapping[str, str], run: Mapping[str, Any], *, resume: bool, replace: bool
) -> Iterator[ZarrStream]:
    """Context with a store that grows in its folder and is moved to ``path`` when the block succeeds; otherwise the
    folder stays.

    Raises
    ------
    InvalidInput
        A run that was interrupted is there, and ``resume`` and ``replace`` are not requested; it was another run; or it is not interrupted, but runs.
    """
    with (
        sole_writer(path),
        sole_writer(unfinished_path(path), alone=True),
    ):  # other processes, and other threads of this one
        yield from _growing(path, count, record, run, resume=resume, replace=replace)


def _growing(
    path: Path, count: int, record: Mapping[str, str], run: Mapping[str, Any], *, resume: bool, replace: bool
) -> Iterator[ZarrStream]:
    folder = unfinished_path(path)
    if folder.exists() and not (folder / _JOURNAL).exists() and any(folder.iterdir()):
        raise InvalidInput(f"{folder} holds something else; move it away or give another name.")
    if folder.exists() and not (resume or replace):
        raise InvalidInput(
            f"{folder} holds an interrupted run. Continue it with --resume (resume=True), or start again with --force (overwrite=True)."
        )
    stream = ZarrStream(folder / folder.name.removesuffix(".partial"), count, record, run, resume=resume)
    try:
        yield stream
        stream.finish()
    except BaseException:
        stream.abandon()
        raise
    moved_into_place(stream.path, path)
    shutil.rmtree(folder, ignore_errors=True)


def interrupted_run(path: Path) -> dict[str, Any]:
    """The arguments of the interrupted run that was writing to ``path``; empty without one."""
    try:
        with (unfinished_path(path) / _JOURNAL).open(encoding="utf-8") as lines:
            return dict(json.loads(lines.readline()))
    except (OSError, ValueError, TypeError):
        return {}


class ZarrStream(Arrays):
    """Each piece is a separate block in every array, so that rewriting it does not affect others.

    ``path`` is the store in its folder beside the target; ``run`` describes the run (recording, skin, method), and
    only the same run can continue. ``pieces.jsonl`` beside the store lists the finished pieces with their checksums,
    one per line.
    """

    def __init__(
        self, path: Path, count: int, record: Mapping[str, str], run: Mapping[str, Any], *, resume: bool
    ) -> None:
        super().__init__(path, count, record)
        self._list = path.parent / _JOURNAL
        self._arrays: dict[str, Any] = {}
        self._crcs: dict[int, Mapping[str, tuple[int, int]]] = {}
        self._by_others = False
        if resume and self._list.exists():
            self._written(lambda: self._go_on(run))
        else:
            self._written(lambda: self._fresh(run))
        self._written(self._announce)

    def _announce(self) -> None:
        """Write an identifier beside the store: processes that find it are on the same disk and belong to this run."""
        self._word = uuid.uuid4().hex
        (self.path.parent / MARKER).write_text(self._word, encoding="utf-8")

    def _fresh(self, run: Mapping[str, Any]) -> None:
        folder = self.path.parent
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        self._log(dict(run))
        self._root = zarr_library().create_group(store=str(self.path), zarr_format=3)

    def _go_on(self, run: Mapping[str, Any]) -> None:
        lines = []
        for line in self._list.read_text(encoding="utf-8").splitlines():
            try:
                lines.append(json.loads(line))
            except ValueError:
                break  # the line that was being written
        if not lines or not self.path.exists():
            self._fresh(run)
            return
        self._list.write_text("".join(f"{json.dumps(line)}\n" for line in lines), encoding="utf-8")
        interrupted_run = lines[0]
        wanted = json.loads(json.dumps(dict(run)))
        changed = [k for k in sorted({*interrupted_run, *wanted}) if interrupted_run.get(k) != wanted.get(k)]
        if changed:
            what = ", ".join(
                f"{k} (was {str(interrupted_run.get(k))[:60]}, is {str(wanted.get(k))[:60]})" for k in changed
            )
            raise InvalidInput(
                f"the interrupted run was another one: {what}. Give the arguments of that run, or start again with --force (overwrite=True)."
            )
        zarr = zarr_library()
        with zarr.config.set({"array.write_empty_chunks": True}):  # the store does not state it
            self._root = zarr.open_group(str(self.path), mode="r+", zarr_format=3)
            held = list(self._root.arrays())
        pieces = {line["start"]: line for line in lines[1:]}
        known = set(lines[-1].get("variables", ())) if pieces else set()
        for name, array in held:
            if name not in known:
                del self._root[name]
            elif array.shape[:1] == (self.count,) and array.metadata.dimension_names[0] == "time":
                self._arrays[name] = array
                self._long[name] = array.shape[1:], array.dtype
                self._frames = array.chunks[0]
        for start in sorted(pieces):
            line = pieces[start]
            if self._whole(start, line):
                self.whole.add(line["attrs"], Outcome.restored(line["outcome"]), line["calibration"])
                self.done[start] = line["frames"]
                self._crcs[start] = {n: (int(crc), int(size)) for n, (crc, size) in line["crcs"].items()}
                for name in set(self._long) - set(line["crcs"]):  # that came up later
                    self._put(name, start, self._nothing(name, line["frames"]))
        self._by_others = True  # an interrupted run may have left half a block under another name

    def _whole(self, start: int, line: Mapping[str, Any]) -> bool:
        """Whether a piece is in the store and intact."""
        here = slice(start, start + line["frames"])
        try:
            return all(list(block_crc(self._arrays[n][here])) == list(crc) for n, crc in line["crcs"].items())
        except (*DAMAGE, KeyError):
            return False

    def _log(self, entry: dict[str, Any]) -> None:
        with self._list.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def place(self) -> Place | None:
        long = {n: (shape, np.dtype(dtype).str) for n, (shape, dtype) in self._long.items()}
        return Place(str(self.path), self._word, long, tuple(self.whole.methods)) if long else None

    def _add(self, start: int, piece: Piece) -> None:
        self._fresh_crcs: dict[str, tuple[int, int]] = {}
        super()._add(start, piece)
        fixed = tuple(str(n) for n, v in piece.dataset.variables.items() if "time" not in v.dims)
        self._told(start, Written(piece.frames, piece.attrs, piece.outcome, piece.calibration, self._fresh_crcs, fixed))

    def _note(self, start: int, piece: Written) -> None:
        self._by_others = True
        self._fresh_crcs = dict(piece.crcs)
        for name in set(self._long) - set(piece.crcs):  # that came up since the piece was given away
            self._put(name, start, self._nothing(name, piece.frames))
        self.done[start] = piece.frames
        self._told(start, replace(piece, crcs=self._fresh_crcs))

    def _told(self, start: int, piece: Written) -> None:
        """Add a piece to the journal, after everything else is done."""
        self._crcs[start] = piece.crcs
        self._log(
            {
                "start": start,
                "frames": piece.frames,
                "variables": [*sorted(self._long), *piece.fixed],
                "crcs": piece.crcs,
                "attrs": dict(piece.attrs),
                "outcome": piece.outcome.plain(),
                "calibration": piece.calibration,
            }
        )

    def _begin(self, fixed: Mapping[str, xarray.Variable], frames: int) -> None:
        self._frames = frames
        for name, variable in fixed.items():
            if variable.dtype.kind in "OUT":
                # Zarr 3 has no stable form of text: store names as attributes of the arrays that they name.
                self._root.attrs[name] = [str(v) for v in variable.values]
                continue
            made = self._root.create_array(
                name,
                shape=variable.shape,
                chunks=variable.shape,
                dtype=variable.dtype,
                config={"write_empty_chunks": True},
                dimension_names=variable.dims,
                attributes=dict(variable.attrs),
            )
            made[...] = variable.values

    def _create(self, name: str, like: xarray.Variable) -> None:
        self._arrays[name] = self._root.create_array(
            name,
            shape=(self.count, *like.shape[1:]),
            chunks=(min(self._frames, self.count), *like.shape[1:]),
            dtype=like.dtype,
            fill_value=np.nan if like.dtype.kind == "f" else None,
            # A missing block means damage, so blocks of zeros are written too.
            config={"write_empty_chunks": True},
            dimension_names=like.dims,
            attributes={k: v for k, v in like.attrs.items() if k != "_FillValue"},
        )

    def _put(self, name: str, start: int, values: Any) -> None:
        values = np.asarray(values, dtype=self._long[name][1] if name in self._long else None)
        self._arrays[name][start : start + len(values)] = values
        if start in self.done:  # a variable that came up late: nothing of it is in the pieces before
            self._crcs[start] = {**self._crcs[start], name: block_crc(values)}
        else:
            self._fresh_crcs[name] = block_crc(values)

    def _finish(self) -> None:
        for array in self._arrays.values():
            if "notes" in array.attrs:
                array.attrs["notes"] = self.whole.notes
        text = {k: v for k, v in self._root.attrs.items() if k == "component"}
        self._root.attrs.put({**self.whole.attributes(self.record), **text})
        if self._by_others:
            for torn in self.path.rglob("*.partial"):
                torn.unlink()
        with self._opened() as found:
            named = found.assign_coords(component=list(map(str, found.attrs.pop("component"))))
            self._root.attrs[CHECKSUM] = checksum(named, known=self._known())

    def _known(self) -> dict[str, tuple[int, int]]:
        """CRC-32 and bytes of each variable over all frames, computed from those of the pieces without reading them."""
        out = dict.fromkeys(self._long, (0, 0))
        for start in sorted(self._crcs):
            for name, (crc, size) in out.items():
                last, more = self._crcs[start][name]
                out[name] = combined(crc, last, more), size + more
        return out

    def _opened(self) -> xarray.Dataset:
        """Open the store without loading it."""
        import xarray

        options = {"consolidated": False, "zarr_format": 3}
        return xarray.open_dataset(
            self.path, engine="zarr", chunks=None, cache=False, decode_times=False, backend_kwargs=options
        )

    def part(self, start: int, stop: int) -> Touch:
        with self._opened() as found:
            some = found.isel(time=slice(start, stop)).load()
            named = some.assign_coords(component=list(map(str, some.attrs["component"])))
            return touch_of(named.assign_attrs(self.whole.attributes(self.record)))
