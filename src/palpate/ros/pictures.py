"""Convert pictures of a gel with dots to frames: a topic of sensor_msgs/Image or CompressedImage, one publisher at a
time, newest picture first.

The first pictures show the gel at rest, as for a camera (`palpate.camera.follow`). An unusable picture gives a frame
without a result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.errors import InvalidInput
from palpate.network.waiting import FrameSource
from palpate.recordings import TopicMapping
from palpate.ros.intake import Header, Intake

if TYPE_CHECKING:
    from palpate.camera import Touches
    from palpate.skin import Skin

__all__ = ["PictureIntake", "are_pictures"]

#: Number of first messages that may hold no picture before an error is raised: about a second of a camera.
PATIENCE = 30


def are_pictures(kind: str) -> bool:
    """Return whether messages of a type may be pictures."""
    return kind.replace("/msg/", "/") in ("sensor_msgs/Image", "sensor_msgs/CompressedImage")


class PictureIntake(Intake):
    """Frames from the pictures of a topic: displacements of the dots.

    Parameters
    ----------
    topic : str
    now, publishers
        As for `Intake`.

    Attributes
    ----------
    touches : Touches
        After `begin`: skin, dots and tracker.
    std : array (2, n)
        Standard deviations of the frame that was given out last [m].
    """

    def __init__(
        self,
        topic: str,
        *,
        now: Callable[[], int],
        publishers: Callable[[], dict[str, str]] | None = None,
    ) -> None:
        from palpate.camera.touches import CHANNELS

        # the number of dots is known after the first pictures; only the newest picture waits
        super().__init__(
            TopicMapping(topic=topic, channels=CHANNELS),
            (len(CHANNELS), 1),
            now=now,
            publishers=publishers,
            waiting=1,
        )
        self.touches: Touches
        self._topic = topic
        self._came: dict[int, tuple[int, float, Header]] = {}
        self.std: Any = None

    def begin(self, skin: Skin | str | Path, *, reference: int | None = None, options: Mapping[str, Any]) -> Touches:
        """Wait for the pictures of the gel at rest, and find the dots in them.

        Parameters
        ----------
        skin : str, Path or Skin
            A skin.toml with a section [camera].
        reference : int, optional
            Pictures of the gel at rest; default: what [camera] says.
        options : mapping
            Options of `Skin.track`.

        Raises
        ------
        InvalidInput
            Messages that hold no pictures, pictures without dots, a gel that moves in the reference.
        """
        from palpate.camera import Pictures, follow

        pictures = Pictures(self._pictures(), name=self._topic)
        self.touches = follow(pictures, skin, reference=reference, track=True, **options)
        return self.touches

    def _pictures(self) -> Iterator[tuple[None, Any, str]]:
        """Yield (None, picture or None, reason if None) for the messages, which are decoded here, so that dropped ones
        cost nothing.
        """
        from palpate.camera.messages import decoded

        given = unread = 0
        for session, time, (message, header, _) in FrameSource.frames(self):
            fault, image = "", None
            try:
                image = decoded(message)
            except InvalidInput as error:
                fault = str(error).rstrip(".")
                self.counts["frames"] -= 1
                self.counts["malformed"] += 1
                unread += 1
                if not given and unread < PATIENCE:
                    continue
            self._came[given] = (session, time, header)
            given += 1
            yield None, image, fault

    def frames(self) -> Iterator[tuple[int, float, Any]]:
        """Yield (session, time [s], displacements (2, n) [m]), all NaN for an unusable picture; `header` is that of
        the frame.
        """
        said = ""
        for reading in self.touches.readings:
            session, time, self.header = self._came.pop(reading.index)
            if reading.fault != said:  # report a fault once, however long it lasts
                self._report_text(reading.fault or "the pictures are good again")
                said = reading.fault
            self.touches.readings.faults.clear()  # do not keep faults: a robot may run for days
            self.std = reading.std
            yield session, time, reading.values
