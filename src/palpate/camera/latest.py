"""Process pictures in real time: the iteration returns the newest picture and counts the skipped ones."""

from __future__ import annotations

import threading
import time as clock
from collections.abc import Iterator
from typing import Any

from palpate.camera.pictures import Picture, Pictures

__all__ = ["Latest"]

#: Longest time [s] for a source to end.
PATIENCE = 5.0


class Latest:
    """The newest picture of a live source.

    Until `start` is called, `pictures` returns every picture in turn, so that no picture of the gel at rest (the
    reference) is skipped. Afterwards it returns only the newest: a thread reads pictures as they arrive or, with
    ``pace`` (for a file), at their recorded times.

    Attributes
    ----------
    pictures : Pictures
        Pictures to iterate over.
    skipped : int
        Pictures skipped so far, because another was being processed.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera import open_pictures
    >>> from palpate.camera.latest import Latest
    >>> latest = Latest(open_pictures(np.zeros((3, 20, 30), dtype=np.uint8), rate=100.0), pace=True)
    >>> latest.start()
    >>> len(list(latest.pictures)) + latest.skipped
    3
    """

    def __init__(self, pictures: Pictures, *, pace: bool) -> None:
        self.skipped = 0
        self._source, self._pace = pictures, pace
        self._taken = iter(pictures)
        self._thread: threading.Thread | None = None
        self._change = threading.Condition()
        self._newest: Picture | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._stop = threading.Event()
        self.pictures = Pictures(
            self._handed(), name=pictures.name, timed=pictures.timed, close=self.close, notes=pictures.notes
        )

    def start(self) -> None:
        """Return only the newest picture from now on."""
        if self._thread is None and not self._stop.is_set():
            self._thread = threading.Thread(target=self._take, name="palpate-pictures", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """End the thread and close the source; a pending iteration ends."""
        self._stop.set()
        with self._change:
            self._change.notify_all()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout=PATIENCE)
        self._source.close()

    def _handed(self) -> Iterator[tuple[float, Any, str]]:
        while self._thread is None:
            picture = next(self._taken, None)
            if picture is None:
                return
            yield picture.time, picture.image, picture.fault
        while True:
            with self._change:
                self._change.wait_for(lambda: self._newest is not None or self._ended or self._stop.is_set())
                picture, self._newest = self._newest, None
            if picture is None or self._stop.is_set():
                if self._error is not None:
                    raise self._error
                return
            yield picture.time, picture.image, picture.fault

    def _take(self) -> None:
        begun = first = None
        try:
            for picture in self._taken:
                if self._pace:
                    begun, first = (
                        (clock.monotonic(), picture.time) if begun is None or first is None else (begun, first)
                    )
                    self._stop.wait(max(0.0, picture.time - first - (clock.monotonic() - begun)))
                if self._stop.is_set():
                    return
                with self._change:
                    self.skipped += self._newest is not None
                    self._newest = picture
                    self._change.notify_all()
        except Exception as error:  # raised when pictures are read
            self._error = error
        finally:
            with self._change:
                self._ended = True
                self._change.notify_all()
