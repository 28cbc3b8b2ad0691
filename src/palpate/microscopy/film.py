"""Evaluate films: the same cells in every frame. The result has one row for each frame and cell; all cores are used,
and an interrupted film is resumed.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from palpate.elastic.pad import Pad
from palpate.errors import InvalidInput, PalpateError
from palpate.microscopy.beads import bead_displacements
from palpate.microscopy.cell import CellForces, Quantity, cell_forces
from palpate.microscopy.labels import forces_of_labels, read_labels, rows_of
from palpate.microscopy.normal import Normal
from palpate.microscopy.pictures import read_all
from palpate.microscopy.readers import is_field, read_field
from palpate.microscopy.series import frames_of_field
from palpate.microscopy.tension import sheet_tension
from palpate.recordings.files import atomically
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["Film", "Job"]

#: Quantities in a row, each with its interval.
NUMBERS = (
    "strain_energy",
    "contractile_moment",
    "contractility",
    "traction_peak",
    "net_force_x",
    "net_force_y",
    "torque",
    "force_inside",
)

#: Further quantities of normal traction, and of a sheet and its cells.
NORMAL = Normal.NUMBERS
TENSIONS = ("average_tension", "largest_tension")


@dataclass(frozen=True)
class Job:
    """One frame: its file, index in the file, number in the film, and name of its field if there are several."""

    file: str
    frame: int
    number: int
    name: str | None = None


@dataclass(frozen=True, kw_only=True)
class Film:
    """Settings that all frames share.

    Parameters
    ----------
    frames : sequence of paths
        Pictures of beads while the cell pulls (stacks, folders or single pictures), or displacement fields: files of one or of several frames (`frames_of_field`).
    rest : path, optional
        Picture of the beads at rest; needed for pictures.
    pad, pixel, window, step, depth, noise, method, uncertainty, drift
        As for `bead_displacements`, `read_field` and `cell_forces`.
    unit, up, v_up, start, name : optional
        Options for displacement fields, as for `read_field`; ``name`` selects one of several films in a file.
    channel : int, optional
        Which channel shows the beads, from 1, of pictures of several.
    cells, labels : path, optional
        Label pictures (or ImageJ's regions): each value of ``cells`` is a cell, each of ``labels`` an adhesion. A TIFF file of as many pages as the film has frames holds the labels of
        each frame: a cell is followed by its number.
    normal : str
        As for `read_field`; numbers of the normal traction are added where the fields tell it.
    monolayer : bool
        The cells are one sheet: rows hold tensions too (`sheet_tension`), and one more row is that of the sheet. Traction is by ``method="tikhonov"`` unless ``method`` says otherwise.

    Raises
    ------
    InvalidInput
        No frame, pictures without one at rest, pictures and fields together.

    Examples
    --------
    >>> from palpate.microscopy import Film
    >>> film = Film(frames=["pulled.tif"], rest="rest.tif", pad=gel, pixel=0.1e-6, cells="cells.tif")  # doctest: +SKIP
    >>> rows, adhesions = film.run("film.partial.jsonl")  # doctest: +SKIP
    """

    frames: Sequence[str | Path]
    pad: Pad
    pixel: float
    rest: str | Path | None = None
    window: int | None = None
    step: float | None = None
    unit: str | None = None
    depth: float = 0.0
    noise: float | None = None
    method: str | None = None
    uncertainty: Uncertainty | None = None
    drift: bool = True
    cells: str | Path | None = None
    labels: str | Path | None = None
    up: bool = False
    v_up: bool = False
    start: tuple[float, float] | None = None
    name: str | None = None
    channel: int | None = None
    normal: str = "up"
    monolayer: bool = False
    fields: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        if not self.frames:
            raise InvalidInput("a film has frames: give pictures, stacks, folders or displacement fields.")
        kinds = {is_field([Path(f)]) for f in self.frames if Path(f).is_file()}
        if len(kinds) > 1:
            raise InvalidInput(
                "a film is of pictures or of displacement fields, and these files are both. Give one kind."
            )
        object.__setattr__(self, "fields", kinds == {True})
        if not self.fields and self.rest is None:
            raise InvalidInput("pictures of a film need one of the beads at rest: give it first (rest=).")

    def jobs(self) -> list[Job]:
        """Return the frames in order."""
        if self.fields:
            named = [(str(f), k, n) for f in self.frames for k, n in enumerate(frames_of_field(f, self.name))]
            return [Job(file, k, i, name) for i, (file, k, name) in enumerate(named)]
        found: list[Job] = []
        for file in self.frames:
            count = len(_pictures(*_stamp(file), self.channel))
            found += [Job(str(file), page, len(found) + page) for page in range(count)]
        return found

    def key(self) -> str:
        """Return a hash of everything that results depend on, so that a film is not resumed with other settings."""
        stamps = [_stamps(f) for f in (*self.frames, self.rest, self.cells, self.labels)]
        said = (stamps, repr(self.pad), self.pixel, self.window, self.step, self.unit, self.depth, self.noise, self.method, repr(self.uncertainty), self.drift, self.up, self.v_up, self.start, self.name, self.channel, self.normal, self.monolayer)  # fmt: skip
        return hashlib.sha256(repr(said).encode()).hexdigest()

    def solved(self, job: Job) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Evaluate a frame; return the rows of its cells and the rows of its labels."""
        size = None
        if self.fields:
            vectors = read_field(
                [Path(job.file)], pixel=self.pixel, unit=self.unit, step=self.step, window=self.window, up=self.up, v_up=self.v_up, start=self.start, name=job.name, normal=self.normal,
            )  # fmt: skip
            vectors = vectors.without_drift() if self.drift else vectors
        else:
            rest = _pictures(*_stamp(str(self.rest)), self.channel)[0]
            pulled = _pictures(*_stamp(job.file), self.channel)[job.frame]
            if rest.shape != pulled.shape:
                raise InvalidInput(
                    f"{job.file}: frame {job.frame} has {pulled.shape[1]} x {pulled.shape[0]} pixels, and the picture at rest {rest.shape[1]} x {rest.shape[0]}. Give pictures of one size."
                )
            size = (int(rest.shape[1]), int(rest.shape[0]))
            vectors = bead_displacements(
                rest, pulled, pixel=self.pixel, window=self.window or 32, step=None if self.step is None else int(self.step), drift=self.drift,
            )  # fmt: skip
        picture = size or vectors.size
        cells = None if self.cells is None else self._labels(self.cells, job, picture)
        mask = None if cells is None else np.logical_or.reduce(list(cells.values()))
        forces = cell_forces(
            vectors, self.pad, mask=mask, size=size, depth=self.depth, noise=self.noise, method=self.method or ("tikhonov" if self.monolayer else "adhesions"), drift=self.drift, uncertainty=self.uncertainty,
        )  # fmt: skip
        sheet = sheet_tension(forces, labels=cells, size=size) if self.monolayer else None
        rows = []

        def put(name: str, part: CellForces, tensions: dict[str, Quantity], notes: Sequence[str] = ()) -> None:
            row: dict[str, Any] = {"file": job.file, "frame": job.number, "page": job.frame, "cell": name}
            for key in (*NUMBERS, *(NORMAL if part.normal is not None else ())):
                row |= _columns(key, part.quantities[key])
            for key, q in tensions.items():
                row |= _columns(key, q)
            rows.append(row | {"notes": "; ".join((*part.notes, *notes))})

        if sheet is not None:
            of_sheet = {key: sheet[key] for key in TENSIONS}
            put("" if cells is None else "sheet", forces, of_sheet, sheet.notes)
        elif cells is None:
            put("", forces, {})
        regions = {} if sheet is None else {r.label: r for r in sheet.cells}
        for name, one in (cells or {}).items():
            region = regions.get(name)
            tensions = {} if region is None else dict(zip(TENSIONS, (region.average, region.largest)))
            try:
                part = forces if len(cells or {}) == 1 else forces.within(one, size=size)
            except InvalidInput as error:  # a label with too few pixels is skipped; the frame is kept
                rows.append(_unsolved(job, name, f"cell {name}: {error}"))
            else:
                put(name, part, tensions)
        labelled = []
        if self.labels is not None:
            labelled = rows_of(
                forces_of_labels(forces, self._labels(self.labels, job, picture), size=size),
                file=job.file,
                frame=job.number,
            )
        return rows, labelled

    def _labels(self, path: str | Path, job: Job, size: tuple[int, int]) -> dict[str, Any]:
        """Labels of a frame: its own page's if the file has a page for each frame, otherwise those of all frames."""
        if Path(path).suffix.lower() not in (".tif", ".tiff"):
            return read_labels(path, size=size, pixel=self.pixel)
        pages = _pictures(*_stamp(path), None)
        if len(pages) == 1:
            return read_labels(pages[0])
        count = len(self.jobs())
        if len(pages) != count:
            raise InvalidInput(
                f"{path}: holds labels of {len(pages)} frames, and the film has {count}: give one picture of labels, or one for each frame."
            )
        return read_labels(pages[job.number])

    def run(
        self,
        partial: str | Path,
        *,
        processes: int | None = None,
        shown: Callable[[float], None] | None = None,
    ) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Evaluate all frames and return the rows of cells and of labels in order. Each frame is written to
        ``partial`` when it is done, and read from there when the film is run again.

        A frame that cannot be evaluated has a row that says why.
        """
        jobs, path = self.jobs(), Path(partial)
        done = self._kept(path)
        left = [j for j in jobs if j.number not in done]
        if shown is not None:
            shown(len(done))
        # write the file anew, so that a line that was cut off does not spoil the next one
        lines = [{"key": self.key()}, *({"number": n, "found": found} for n, found in done.items())]
        text = "".join(json.dumps(line) + "\n" for line in lines)
        atomically(path, lambda at: _write(at, text))
        count = min(processes or os.cpu_count() or 1, max(len(left), 1))
        with path.open("a", encoding="utf-8") as file:

            def keep(job: Job, found: Any) -> None:
                done[job.number] = found
                file.write(json.dumps({"number": job.number, "found": found}) + "\n")
                file.flush()
                if shown is not None:
                    shown(len(done))

            if count == 1:
                for job in left:
                    keep(job, _tried(self, job))
            else:
                with ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_limit_threads) as pool:
                    running = {pool.submit(_tried, self, job): job for job in left}
                    try:
                        while running:
                            for future in wait(running, return_when=FIRST_COMPLETED).done:
                                keep(running.pop(future), future.result())
                    except BaseException:
                        pool.shutdown(wait=False, cancel_futures=True)
                        raise
        ordered = [done[j.number] for j in jobs]
        return [r for cells, _ in ordered for r in cells], [r for _, labels in ordered for r in labels]

    def _kept(self, path: Path) -> dict[int, Any]:
        """Return the frames that an earlier run evaluated with the same settings."""
        out: dict[int, Any] = {}
        with contextlib.suppress(OSError):
            lines = path.read_text(encoding="utf-8").splitlines()
            for number, line in enumerate(lines):
                try:
                    held = json.loads(line)
                except ValueError:  # the line was cut off while it was written
                    break
                if number == 0:
                    if held.get("key") != self.key():
                        raise InvalidInput(
                            f"{path} is of a film with other settings or files: delete it to start again."
                        )
                elif isinstance(held, dict):
                    out[int(held["number"])] = held["found"]
        return out


def _columns(key: str, q: Quantity) -> dict[str, str]:
    """Return a quantity and the ends of its interval as columns of a row."""
    low, high = q.interval
    return {
        f"{key}_{q.unit.replace(' ', '')}": f"{q.value:.6g}",
        f"{key}_low": f"{low:.6g}",
        f"{key}_high": f"{high:.6g}",
    }


def _stamp(file: str | Path) -> tuple[str, float]:
    """Return the name of a file or folder, and the time of the last change in it."""
    return str(file), max((when for _, _, when in _stamps(file)), default=0.0)


def _stamps(path: str | Path | None) -> list[tuple[str, int, float]]:
    """Return name, size and time of the last change of a file, or of each file of a folder."""
    if path is None:
        return []
    found = Path(path)
    files = sorted(f for f in found.iterdir() if f.is_file()) if found.is_dir() else [found]
    return [(str(f), os.path.getsize(f), os.path.getmtime(f)) for f in files]


@functools.lru_cache(maxsize=3)
def _pictures(file: str, changed: float, channel: int | None) -> list[Any]:
    """Return the pictures of a file. Each process reads them once for all of its frames."""
    return read_all(Path(file), channel=channel)


def _write(at: str, text: str) -> None:
    Path(at).write_text(text, encoding="utf-8")


def _limit_threads() -> None:
    """Limit a worker process to one core."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


def _tried(film: Film, job: Job) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    try:
        return film.solved(job)
    except PalpateError as error:
        return [_unsolved(job, "", str(error))], []


def _unsolved(job: Job, cell: str, why: str) -> dict[str, Any]:
    return {"file": job.file, "frame": job.number, "page": job.frame, "cell": cell, "notes": f"not solved: {why}"}
