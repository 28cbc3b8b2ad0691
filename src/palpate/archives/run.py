"""Reconstruct a recording of any length, from one file into another."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

import palpate
from palpate._memory import require
from palpate._threads import SMALL, cached_property, cores
from palpate.archives.numbers import Numbers
from palpate.archives.pools import in_order, pool_of
from palpate.archives.work import PieceResult, Task, fingerprint
from palpate.calibrate.answer import at_calibrated_zero
from palpate.elastic import Viscoelastic
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse.method import Method
from palpate.inverse.registry import requested_method
from palpate.recordings.described import check_described
from palpate.recordings.files import atomically
from palpate.recordings.formats import find_format, open_recording
from palpate.recordings.locks import sole_writer
from palpate.recordings.opened import OpenRecording
from palpate.recordings.recording import Recording
from palpate.recordings.touchstream import Collected
from palpate.recordings.zarrstream import interrupted_run
from palpate.sensing.readings import Creep, Layout, joined_planes
from palpate.sensing.zero import OFFSETS, STANDS, Levels, Rest, given_rest, rest_frames
from palpate.touch import Touch
from palpate.touch.counted import Counted
from palpate.touch.outcome import Outcome, notes_with
from palpate.touch.table import write_table

if TYPE_CHECKING:
    import pandas

    from palpate.recordings.zarrpieces import Place
    from palpate.skin import Skin

__all__ = ["Reconstructed", "piece_length", "reconstruct_recording", "worker_count"]

#: Size of the traction in a piece [bytes]: large enough for efficient batches, small enough to hold many pieces in
#: memory.
PIECE_BYTES = 3_000_000
#: Largest number of frames in a piece, which is what an interrupted run has to repeat.
LONGEST = 256
#: The same for methods that solve frames one after another, which take from a hundredth of a second to some seconds
#: each.
SLOW = 8
#: Number of frames for each process that outweigh its start: 1.5 s for imports and sensor against at least 0.04 s for
#: each frame.
PAYS = 50
#: Largest number of processes that start by default: each uses 150 MB.
MAX_DEFAULT_PROCESSES = 8


@dataclass(frozen=True)
class Reconstructed:
    """The result of a run over a recording.

    Attributes
    ----------
    path : Path
        The file.
    frames, before : int
        Its frames, and how many of them an earlier run had finished.
    frame : int
        Number of the frame of ``touch``: the requested one, or that with the largest traction.
    touch : Touch
        The result of this frame.
    numbers : Numbers
        Numbers of all frames, as `table` holds them.
    remarks : tuple of str
        Remarks on the readings.
    notes : tuple of str
        Assumptions and outcomes of all frames; the notes of ``touch`` are those of a single frame.
    """

    path: Path
    frames: int
    before: int
    frame: int
    touch: Touch
    numbers: Numbers
    remarks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @cached_property
    def table(self) -> pandas.DataFrame:
        """Return the numbers of all frames (`Touch.table`). If there are 100,000 or more, they stay in a file, and a
        column is read when it is used.
        """
        return self.numbers.table()


def piece_length(skin: Skin, method: Method | None = None) -> int:
    """Return the default number of frames in a piece. It depends on skin and method only, so that a run can be
    repeated exactly.

    Slow methods get short pieces, so that finished frames are written and reported soon.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.archives import piece_length
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> small = pp.AreaArray(shape=(16, 16), pitch=1e-3, depth=2e-3, channels=["stress_zz"])
    >>> large = pp.AreaArray(shape=(128, 128), pitch=1e-3, depth=2e-3, channels=["stress_zz"])
    >>> piece_length(pp.Skin(pad, small)), piece_length(pp.Skin(pad, large))
    (217, 6)
    """
    frame = 8 * len(skin.surface.components) * math.prod(skin.surface.shape)
    return max(1, min(LONGEST if method is None or not method.by_frame else SLOW, PIECE_BYTES // frame))


def worker_count(skin: Skin, method: Method | None, frames: int) -> int:
    """Return the default number of processes: one for each core, for small sensors and for methods that take long for
    each frame.

    A process takes a second or two to start, which is too long for linear methods and few frames, and large sensors
    would have to be prepared again in each.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.archives import worker_count
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=4e-3, channels=["stress_zz"]))
    >>> worker_count(skin, None, 20), worker_count(skin, pp.Tikhonov(), 100_000)
    (1, 1)
    """
    unknowns = len(skin.surface.components) * math.prod(skin.surface.shape)
    chosen = requested_method(None, {}) if method is None else method
    if not chosen.by_frame or unknowns > SMALL:
        return 1
    return max(1, min(cores(), MAX_DEFAULT_PROCESSES, frames // PAYS))


def reconstruct_recording(
    skin: Skin,
    recording: str | Path | Recording | OpenRecording,
    out: str | Path,
    *,
    method: str | Method | None = None,
    components: Sequence[str] | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    chunk: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    frame: int | None = None,
    baseline: int = 0,
    zero: npt.ArrayLike | None = None,
    provenance: Mapping[str, str] | None = None,
    progress: Callable[[int, int], object] | None = None,
    **options: Any,
) -> Reconstructed:
    """`Skin.reconstruct` of a recording of any length, from file to file: memory does not grow with it.

    Parameters
    ----------
    skin : Skin
    recording : str, Path or Recording
        NetCDF, HDF5 and Zarr are read piece by piece, a long CSV once into a temporary file; other formats whole.
    out : str or Path
        NetCDF, HDF5, Zarr, CSV and MCAP are written piece by piece; the touches of other formats stay in memory until the end. A Zarr store grows
        in ``NAME.partial`` beside it, which stays if the run is interrupted; every other file appears when it is complete, and after an interruption
        ``NAME.part.csv`` keeps the forces of the frames so far.
    method, components, **options
        As for `Skin.reconstruct`.
    workers : int
        Processes (or threads, as ``scheduler`` says) that share the work; each takes one thread for linear algebra. The result is the same.
    scheduler : str, optional
        "processes" (default with several workers), "threads", or the address of a Dask scheduler (``tcp://...``, extra ``dask``).
    chunk : int, optional
        Frames in a piece. Default: `piece_length`.
    resume : bool
        Continue an interrupted run into the same Zarr store, or start it. It must be the same run: recording, skin, method, chunk.
    overwrite : bool
        Replace a result, or an interrupted run.
    frame : int, optional
        Solve and write only this frame; -1 is the last. Default: all frames.
    baseline : int
        Frames at the start that are the ``zero``. 0 (default): none of them, the readings are zero already or ``zero`` is given; ``remarks`` notes
        readings that evidently have no zero (raw counts).
    zero : array (frame, channel, *array), optional
        As for `Skin.reconstruct`. That of a calibration (``skin.calibration.zero``) has its error in the intervals.
    provenance : mapping of str to str
        Kept as attributes of the result.
    progress : callable (done, frames)
        Called after each piece.

    Returns
    -------
    Reconstructed

    Raises
    ------
    InvalidInput, NotObservable, Unsupported
        As `Skin.reconstruct`, before anything is written: every frame is looked at first. A result that exists, or a run that was interrupted;
        workers that the system stops again and again; a Dask scheduler that does not answer.

    Notes
    -----
    If a worker is killed, another takes its piece. With the same ``chunk`` the result is the same to the last bit for any number
    of workers if the linear algebra uses as many threads: up to 4096 unknowns it uses one; above, set OMP_NUM_THREADS=1 to compare. If workers are
    processes, a script must guard its start with ``if __name__ == "__main__":``.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.recordings import read_touch, write_recording
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    >>> press = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    >>> readings = np.linspace(0.1, 1.0, 50)[:, None, None] * press
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_recording(pp.Recording(readings=readings, channels=["stress_zz"]), f"{folder}/press.nc")
    ...     done = pp.reconstruct_recording(skin, f"{folder}/press.nc", f"{folder}/touch.nc", method="tikhonov", chunk=20)
    ...     force = read_touch(f"{folder}/touch.nc").force.sel(component="z").values
    >>> done.frames, force[[0, -1]].round().tolist()  # [N/m]
    (50, [1.0, 10.0])
    """
    target = Path(out)
    known = find_format(target)
    chosen = requested_method(method, options)
    # a resumed run keeps the pieces of its start
    length = chunk if chunk is not None else interrupted_run(target).get("chunk") if resume else None
    length = piece_length(skin, chosen) if length is None else length
    if isinstance(length, bool) or not isinstance(length, int) or length < 1:
        raise InvalidInput(f"chunk must be a whole number of frames from 1 on; got {chunk!r}.")
    if resume and frame is not None:
        raise InvalidInput(
            f"frame {frame} alone is solved at once: leave out resume (--resume), or frame (--frame) for all frames."
        )
    if resume and not known.can("touch_stream"):
        raise InvalidInput(f"{target}: only a run into a Zarr store (.zarr) can go on after it was broken off.")
    with ExitStack() as stack:
        stack.enter_context(sole_writer(target))
        if target.exists() and not overwrite:
            raise InvalidInput(f"{target} exists. Give another name, or overwrite=True (--force) to replace it.")
        source = stack.enter_context(_opened(recording))
        count = len(source)
        if (
            skin.calibration is None or skin.calibration.constants is None
        ):  # the calibration is more accurate than the positions that the recording states
            check_described(source.head, skin.planes)
        if frame is not None and not -count <= frame < count:
            raise InvalidInput(
                f"frame {frame} is not among the {count} frames of {source.name}: give 0 to {count - 1}, or -1 for the last."
            )
        rest = given_rest(zero, baseline, skin.planes)
        if not baseline < max(count, 1):
            raise InvalidInput(
                f"baseline must be a number of frames at the start, from 0 to {count - 1} of the {count} in {source.name}; got {baseline!r}."
            )
        wanted = range(count) if frame is None else range(frame % count, frame % count + 1)
        elastic = skin.without_creep() if isinstance(skin.pad, Viscoelastic) else skin
        settings: dict[str, Any] = {"method": chosen, "components": components}
        if baseline:
            rest = Rest.of(rest_frames(source.frames(0, baseline).readings, skin.planes))
        zero = None if rest is None else rest.zero
        if not baseline and skin.calibration is not None and skin.calibration.is_zero(zero):
            elastic = at_calibrated_zero(elastic)
        elif rest is not None:
            elastic = elastic.at_rest(rest)
        pool = pool_of(elastic, settings, workers=workers, scheduler=scheduler)
        stack.enter_context(pool)
        levels, layout = Levels(), Layout(elastic.planes, elastic.pad)

        def look(part: Recording) -> None:
            levels.look(part.readings)
            layout.checked(part.readings if zero is None else part.readings - zero)

        crc = source.survey(look)
        # refuse impossible requests before writing anything
        elastic.prepare(**settings)
        run = {
            "palpate": palpate.__version__,
            "recording": crc,
            "frames": count,
            "chunk": length,
            "method": str(chosen),
            "baseline": baseline if baseline or zero is None else fingerprint([zero]),
            "options": fingerprint([chosen, components]),
            "skin": fingerprint(
                [skin.pad, skin.planes, skin.surface, skin.boundary, skin.problem().nuisance, skin.uncertainty]
                + ([] if skin.calibration is None else [skin.calibration])
            ),
        }
        stream = stack.enter_context(
            known.touch_stream(target, len(wanted), dict(provenance or {}), run=run, resume=resume, replace=overwrite)
        )
        if isinstance(stream, Collected):
            cells = 8 * len(skin.surface.components) * math.prod(skin.surface.shape)
            require(
                (8 if chosen.error_bars else 4) * len(wanted) * cells,
                f"the touches of {len(wanted):,} frames",
                "Write .nc, .h5, .zarr, .csv or .mcap, which take them piece by piece.",
            )
        done = dict(getattr(stream, "done", {}))
        before = finished = sum(done.values())
        if progress is not None and before:
            progress(finished, count)
        with _numbers_of(target):
            numbers = Numbers(len(wanted), target.resolve().parent)
        gathered = _Gathered(numbers, target)
        for start, frames in done.items():  # frames that an earlier run finished
            gathered.add(start, PieceResult.of(stream.part(start, start + frames)))
        place = stream.place if pool.elsewhere and wanted.start == 0 else lambda: None
        with nullcontext() if known.can("touch_stream") else _save_numbers_on_interrupt(numbers, target, len(wanted)):
            for task, solved in in_order(pool, _tasks(source, skin, length, done, zero, wanted, place)):
                stream.add(task.start - wanted.start, solved.piece)
                gathered.add(task.start, solved.result, wanted.start)
                finished += task.stop - task.start
                if progress is not None:
                    progress(finished, len(wanted))
    remarks: tuple[str, ...] = ()
    if zero is None and levels.standing():
        remarks = (OFFSETS,)
    elif zero is None and frame is None and levels.still(gathered.numbers.untouched()):
        remarks = (STANDS,)
    if baseline and rest is not None and rest.wanders:
        remarks += (
            f"the readings drift in the {baseline} frames of the zero, or something touches: give fewer (--baseline, baseline=)",
        )
    standing = None if rest is None or skin.calibration is None else skin.calibration.standing(rest.zero)
    remarks += () if standing is None else (standing,)
    touch, at = gathered.largest
    return Reconstructed(target, len(wanted), before, at, touch, gathered.numbers, remarks, gathered.notes)


@contextmanager
def _numbers_of(target: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InvalidInput(
            f"{target}: writing the numbers of the frames beside it failed ({error.strerror or error}). Free space there, and run it again."
        ) from error


@contextmanager
def _save_numbers_on_interrupt(numbers: Numbers, target: Path, frames: int) -> Iterator[None]:
    """If a run is interrupted and its format cannot be resumed, write the numbers so far as NAME.part.csv, and add a
    note to the exception.
    """
    try:
        yield
    except BaseException as error:
        if solved := len(numbers):
            kept = target.with_name(f"{target.stem}.part.csv")
            with suppress(OSError, InvalidInput):  # a full disk may be why the run ended
                atomically(kept, lambda path: write_table(numbers.table().iloc[:solved], path))
                error.add_note(
                    f"{kept} holds the forces of the first {solved} of {frames} frames. To be able to go on after a stop, "
                    f"write a .zarr: --out {target.with_suffix('.zarr').name} --resume"
                )
        raise


class _Gathered:
    """Collects the numbers of all frames, and the frame with the largest traction, from pieces in any order."""

    def __init__(self, numbers: Numbers, beside: Path) -> None:
        self.numbers, self._beside = numbers, beside
        self._largest: tuple[int, PieceResult] | None = None
        self._said = Counted()
        self._outcome: Outcome | None = None

    def add(self, start: int, result: PieceResult, first: int = 0) -> None:
        with _numbers_of(self._beside):
            self.numbers.add(start - first, result.numbers)
        self._said.add(result.assumptions, result.outcome.frames)
        self._outcome = result.outcome if self._outcome is None else self._outcome + result.outcome
        if self._largest is None or result.load > self._largest[1].load:
            self._largest = start + result.at, result

    @property
    def largest(self) -> tuple[Touch, int]:
        if self._largest is None:
            raise InvalidInput("there are no frames.")
        at, result = self._largest
        return result.touch, at

    @property
    def notes(self) -> tuple[str, ...]:
        return notes_with(self._said.words(), self._outcome)


def _opened(recording: str | Path | Recording | OpenRecording) -> Any:
    if isinstance(recording, OpenRecording):
        return nullcontext(recording)
    if isinstance(recording, Recording):
        return nullcontext(OpenRecording.of(recording))
    return open_recording(recording)


def _tasks(
    source: OpenRecording,
    skin: Skin,
    length: int,
    done: Mapping[int, int],
    zero: Floats | None,
    wanted: range,
    place: Callable[[], Place | None],
) -> Iterator[Task]:
    """Yield the remaining pieces, with zero and creep subtracted. Creep depends on the past, so that all frames must
    pass through its filter in order.
    """
    creep = Creep(skin.planes, skin.pad.prony, "remove") if isinstance(skin.pad, Viscoelastic) else None
    layout = Layout(skin.planes, skin.pad.elastic if isinstance(skin.pad, Viscoelastic) else skin.pad)
    whole = len(wanted) == len(source)
    pieces = source.pieces(length) if whole or creep is not None else [(wanted.start, wanted.stop)]
    for start, stop in pieces:
        if start >= wanted.stop or (done.get(start) == stop - start and creep is None):
            continue
        part = source.frames(start, stop)
        readings = part.readings if zero is None else part.readings - zero
        if creep is not None:
            readings = joined_planes(creep(layout.checked(readings), part.time), skin.planes)
        first, last = max(start, wanted.start), min(stop, wanted.stop)
        if done.get(start) != stop - start and first < last:
            held = slice(first - start, last - start)
            yield Task(first, last, readings[held], part.time[held], place())
