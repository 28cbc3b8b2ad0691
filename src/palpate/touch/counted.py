"""Notes with a count of frames: summed over parts of a recording, and reduced to one frame."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

__all__ = ["Counted", "counted", "for_one_frame", "numberless"]

_NUMBER = re.compile(r"-?\d[\d.,]*(e[-+]?\d+)?")
_COUNT = re.compile(r" in (\d+) of (\d+) frames\b")


def numberless(note: str) -> str:
    """A note with its numbers replaced, to compare notes that differ only in numbers.

    Examples
    --------
    >>> from palpate.touch.counted import numberless
    >>> numberless("the zero has drifted by -39.5 Pa") == numberless("the zero has drifted by 8 Pa")
    True
    """
    return _NUMBER.sub("#", note)


class Counted:
    """The notes of all parts, each once (the first of those that differ only in a number), with counts of frames summed.

    Examples
    --------
    >>> from palpate.touch.counted import Counted
    >>> both = Counted()
    >>> both.add(["pad given", "small contact in 3 of 8 frames: few taxels feel it"], 8)
    >>> both.add(["pad given", "small contact in 5 of 6 frames: few taxels feel it"], 6)
    >>> both.words()
    ('pad given', 'small contact in 8 of 14 frames: few taxels feel it')
    """

    def __init__(self) -> None:
        self._found: dict[str, tuple[tuple[str, ...], int]] = {}
        self._frames = 0

    def add(self, notes: Iterable[str], frames: int) -> None:
        """Add the counts of another part."""
        self._frames += frames
        for note in notes:
            count = _COUNT.search(note)
            parts = (note,) if count is None else (note[: count.start()], note[count.end() :])
            key = numberless(note)
            first, found = self._found.get(key, (parts, 0))
            self._found[key] = first, found + (0 if count is None else int(count[1]))

    def words(self) -> tuple[str, ...]:
        """One sentence for each."""
        return tuple(
            f" in {n} of {self._frames} frames".join(parts) if len(parts) > 1 else parts[0]
            for parts, n in self._found.values()
        )


def counted(parts: Sequence[tuple[Iterable[str], int]]) -> tuple[str, ...]:
    """The notes of several parts (notes, frames), as `Counted` adds them up."""
    found = Counted()
    for notes, frames in parts:
        found.add(notes, frames)
    return found.words()


def for_one_frame(note: str) -> str:
    """The note of several frames for one of them: without a count if it holds for all.

    Examples
    --------
    >>> from palpate.touch.counted import for_one_frame
    >>> for_one_frame("small contact in 1 of 1 frames: few taxels feel it"), for_one_frame("drift in 2 of 8 frames")
    ('small contact: few taxels feel it', 'drift in 2 of 8 frames')
    """
    count = _COUNT.search(note)
    return note if count is None or count[1] != count[2] else note[: count.start()] + note[count.end() :]
