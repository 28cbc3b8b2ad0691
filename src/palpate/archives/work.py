"""Process one piece of a recording, in any process."""

from __future__ import annotations

import functools
import hashlib
import json
import pickle
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import palpate
from palpate.errors import Unsupported
from palpate.recordings.touchstream import Piece, Written, piece_of
from palpate.touch.outcome import Outcome
from palpate.touch.table import columns

if TYPE_CHECKING:
    from palpate.elastic.pad import Floats
    from palpate.recordings.zarrpieces import Place
    from palpate.skin import Skin
    from palpate.touch import Touch

__all__ = ["PieceResult", "Solved", "Task", "fingerprint", "packed", "solve", "solve_packed"]


@dataclass(frozen=True)
class Task:
    """Frames ``start`` to ``stop`` of a recording."""

    start: int
    stop: int
    readings: Any
    time: Floats
    #: the place in the file to which a worker may write itself
    place: Place | None = None


@dataclass(frozen=True)
class PieceResult:
    """Summary of a piece: the numbers of each frame, assumptions and outcomes, and the frame with the largest traction
    (sum of magnitudes, index, touch).
    """

    numbers: dict[str, Any]
    assumptions: tuple[str, ...]
    outcome: Outcome
    load: float
    at: int
    touch: Touch

    @classmethod
    def of(cls, touch: Touch) -> PieceResult:
        """Summarise a batch of frames."""
        loads = np.nansum(np.abs(touch.values), axis=tuple(range(1, np.ndim(touch.values))))
        at = int(np.argmax(loads))
        return cls(columns(touch), tuple(touch.assumptions), Outcome.of(touch), float(loads[at]), at, touch[at])


@dataclass(frozen=True)
class Solved:
    """A piece that is ready to be written or already written, and its summary."""

    piece: Piece | Written
    result: PieceResult


def solve(skin: Skin, options: dict[str, Any], task: Task) -> Solved:
    """Compute the touches of a task's frames, in the form in which they are written."""
    piece = piece_of(skin.reconstruct(task.readings, time=task.time, **options))
    result = PieceResult.of(piece.touch())
    written = None if task.place is None else task.place.write(task.start, piece)
    return Solved(piece if written is None else written, result)


def packed(skin: Skin, options: dict[str, Any]) -> bytes:
    """Serialise skin and options for another process.

    Raises
    ------
    Unsupported
        Something in them cannot be sent.
    """
    try:
        return pickle.dumps((palpate.__version__, skin, options))
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise Unsupported(
            f"this skin or method cannot be sent to another process ({error}): define its classes in a module, or use one worker."
        ) from error


def solve_packed(job: bytes, task: Task) -> Solved:
    """Do the same as `solve` in another process, which prepares the skin once."""
    return solve(*_unpacked(job), task)


@functools.lru_cache(maxsize=2)
def _unpacked(job: bytes) -> tuple[Skin, dict[str, Any]]:
    version, skin, options = pickle.loads(job)
    if version != palpate.__version__:
        raise Unsupported(
            f"a worker has palpate {palpate.__version__} and the command {version}: install the same version on both."
        )
    return skin, options


def fingerprint(thing: Any) -> str:
    """Return a text that is equal for equal pads, arrays or methods in every process, and differs otherwise."""
    text = json.dumps(_described(thing), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _described(thing: Any) -> Any:
    if thing is None or isinstance(thing, bool | int | float | str):
        return repr(thing)
    if isinstance(thing, np.ndarray):
        return [str(thing.dtype), list(thing.shape), hashlib.sha256(np.ascontiguousarray(thing).tobytes()).hexdigest()]
    if isinstance(thing, np.generic):
        return repr(thing.item())
    if isinstance(thing, list | tuple):
        return [_described(v) for v in thing]
    if isinstance(thing, dict):
        return {str(k): _described(v) for k, v in thing.items()}
    kind = f"{type(thing).__module__}.{type(thing).__qualname__}"
    if is_dataclass(thing):
        return [kind, {f.name: _described(getattr(thing, f.name)) for f in fields(thing)}]
    held = {k: v for k, v in getattr(thing, "__dict__", {}).items() if not k.startswith("_")}
    return [kind, _described(held) if held else repr(thing)]
