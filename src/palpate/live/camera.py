"""A camera, or a video played at its rate, as the source of a live session."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from palpate.camera import Pictures, Touches, follow, open_pictures
from palpate.camera.latest import Latest
from palpate.camera.pictures import VIDEOS
from palpate.errors import InvalidInput
from palpate.touch import Touch

__all__ = ["CameraSource"]

#: Report a camera without pictures after this many seconds.
LATE = 1.0


class CameraSource:
    """Yields the displacements of the dots in a camera's pictures as they arrive: a source of `palpate.live.Session`.

    Parameters
    ----------
    source : str, int or Pictures
        The number of a camera ("0"), /dev/video0, or a video, which is played at its rate; or pictures that are open already.
    skin : str or Path
        A skin.toml with a section [camera].
    reference : int, optional
        Pictures at the start in which nothing touches; default: what [camera] says.
    options : mapping
        Options of `Skin.track`.

    Attributes
    ----------
    touches : Touches
        Its skin has the dots where they were found.
    report : callable
        Called with a sentence for each event of the pictures; a session's ``note``.
    skip : callable
        Called for each picture that came before the previous one was processed.

    Raises
    ------
    InvalidInput
        No camera, no video, or pictures that cannot be a reference.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.camera import Dots, Scene, dot_grid, open_pictures
    >>> from palpate.live.camera import CameraSource
    >>> import tempfile
    >>> from pathlib import Path
    >>> text = '''
    ... [pad]
    ... kind = "bonded_layers"
    ...
    ... [[pad.layer]]
    ... thickness = "4 mm"
    ... youngs_modulus = "300 kPa"
    ... poissons_ratio = 0.45
    ...
    ... [[plane]]
    ... kind = "scattered"
    ... depth = "1 mm"
    ... channels = ["displacement_x", "displacement_y"]
    ...
    ... [camera]
    ... scale = "0.1 mm"
    ... reference = 2
    ... '''
    >>> pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.45)])
    >>> scene = Scene(pad=pad, depth=1e-3, print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3), size=(160, 120), scale=0.1e-3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/gel.toml").write_text(text)
    ...     source = CameraSource(open_pictures(list(scene.pictures([None] * 3)), rate=30.0), f"{folder}/gel.toml")
    ...     frames = [values.shape for _, values in source()]
    ...     source.close()
    >>> len(frames) + source.latest.skipped, frames[0]
    (3, (2, 35))
    """

    def __init__(
        self,
        source: str | int | Pictures,
        skin: str | Path,
        *,
        reference: int | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        opened, pace = _opened(source)
        self.report: Callable[[str], None] = lambda _: None
        self.skip: Callable[[], None] = lambda: None
        try:
            self.latest = Latest(opened, pace=pace)
            self.touches: Touches = follow(
                self.latest.pictures, skin, reference=reference, track=True, **dict(options or {})
            )
        except BaseException:
            opened.close()
            raise
        self.name = opened.name
        self._std: Any = None

    def __call__(self) -> Iterator[tuple[float, Any]]:
        """Yield (time [s], displacements (2, n) [m]) of the newest picture; all NaN for an unusable picture.

        If the camera stops, raise `InvalidInput`, so that the page reports it.
        """
        skipped, said, before = 0, "", None
        for count, reading in enumerate(self.touches.readings, 1):
            early = self.latest.skipped - skipped
            for _ in range(early):
                self.skip()
            skipped += early
            if before is not None and not early and reading.time - before > LATE:
                self.report(f"{reading.time:.3f} s  the camera was late: no picture for {reading.time - before:.1f} s")
            before = reading.time
            if reading.fault != said:  # report a fault once, however long it lasts
                self.report(f"{reading.time:.3f} s  " + (reading.fault or "the pictures are good again"))
                said = reading.fault
            self.touches.readings.faults.clear()  # do not keep faults: a camera may run for days
            self._std = reading.std
            yield reading.time, reading.values
            if count == self.touches.readings.reference:
                self.latest.start()  # from now on skip old pictures: the zero and the preparation in the first frames are done
        if self.touches.readings.pictures.notes:
            raise InvalidInput(" ".join(self.touches.readings.pictures.notes))

    def step(self, values: Any, time: float) -> Touch:
        """Return the touch of the displacements that were yielded last, with their standard deviations."""
        return self.touches.step(values, time, std=self._std)

    def close(self) -> None:
        """Stop the pictures; a reader that waits for one gets none."""
        self.latest.close()


def _opened(source: str | int | Pictures) -> tuple[Pictures, bool]:
    """Return the pictures, and whether they have to be played at their own rate."""
    if isinstance(source, Pictures):
        return source, True
    text = str(source)
    if text.isdecimal():
        return open_pictures(int(text)), False
    if text.startswith("/dev/video"):
        return open_pictures(text), False
    if Path(text).suffix.lower() not in VIDEOS:
        raise InvalidInput(
            f"--camera takes the number of a camera (0), /dev/video0, or a video ({', '.join(VIDEOS)}); got {text}. Other pictures: palpate track."
        )
    return open_pictures(text), True
