"""A recording that is read piece by piece; only its header is in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.recordings.checked import agree, checksum
from palpate.recordings.labelled import recording_dataset
from palpate.recordings.recording import Recording

__all__ = ["OpenRecording"]

#: Bytes of readings that are read together.
BLOCK = 1 << 22


@dataclass(frozen=True, eq=False)
class OpenRecording:
    """A recording whose readings are read on demand.

    Attributes
    ----------
    head : Recording
        The first frame, with channels, positions and meta of all.
    time : array (frame,)
        Seconds.
    readings : array-like (frame, channel, *array)
        Anything that gives an array for a slice of frames.
    expected : int or None
        The checksum that the file holds.
    name : str
        Name of the recording in messages.
    remedy : str
        What to do if the checksum does not match.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.recordings.opened import OpenRecording
    >>> recording = pp.Recording(readings=[[[0.0, 1.0]], [[2.0, 3.0]], [[4.0, 5.0]]], channels=["stress_zz"])
    >>> opened = OpenRecording.of(recording)
    >>> len(opened), opened.frames(1, 3).readings.shape, opened.frames(1, 3).time.tolist()
    (3, (2, 1, 2), [1.0, 2.0])

    >>> list(opened.pieces(2))
    [(0, 2), (2, 3)]
    """

    head: Recording
    time: Floats
    readings: Any
    expected: Any = None
    name: str = "the recording"
    remedy: str = ""

    @classmethod
    def of(cls, recording: Recording, name: str = "the recording") -> OpenRecording:
        """Wrap a recording that is already in memory."""
        return cls(
            replace(recording, readings=recording.readings[:1], time=recording.time[:1]),
            recording.time,
            recording.readings,
            name=name,
        )

    def __len__(self) -> int:
        return len(self.time)

    def frames(self, start: int, stop: int) -> Recording:
        """Frames ``start`` to ``stop``, checked like any recording."""
        return replace(self.head, readings=np.asarray(self.readings[start:stop]), time=self.time[start:stop])

    def pieces(self, count: int) -> Iterator[tuple[int, int]]:
        """(start, stop) of pieces of ``count`` frames; the last may be shorter."""
        return ((i, min(i + count, len(self))) for i in range(0, len(self), count))

    def survey(self, look: Callable[[Recording], object] = lambda _: None) -> int:
        """Call ``look`` with all frames, in blocks of a few megabytes, and return the checksum of the whole.

        Raises
        ------
        InvalidInput
            The recording does not match its checksum; or an exception of ``look``.
        """

        def blocks() -> Iterator[Any]:
            for start, stop in self.pieces(max(1, BLOCK // max(1, self.head.readings.nbytes))):
                part = self.frames(start, stop)
                look(part)
                yield part.readings

        whole = {"readings": (len(self), blocks()), "time": (len(self), iter([self.time]))}
        found = checksum(recording_dataset(self.head), long=whole)
        if self.expected is not None:
            agree(found, self.expected, self.name, self.remedy)
        return found
