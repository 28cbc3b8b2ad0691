"""Where a stream goes while it happens: one way to write it, whatever the format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from palpate.errors import InvalidInput
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["Recorder", "Sink", "recorder"]


class Sink(Protocol):
    """What takes readings, touches and events of a stream: a recorder, or a server that shows them elsewhere.

    Examples
    --------
    >>> class Counter:
    ...     def __init__(self):
    ...         self.frames = 0
    ...
    ...     def readings(self, time, values):
    ...         self.frames += 1
    ...
    ...     def touch(self, touch, time=None): ...
    ...
    ...     def event(self, event): ...
    ...
    ...     def close(self): ...
    >>> counter = Counter()
    >>> counter.readings(0.0, [[1.0, 2.0]])
    >>> counter.touch(None), counter.event(None), counter.close(), counter.frames
    (None, None, None, 1)
    """

    def readings(self, time: float, values: Any) -> None:
        """One frame (channel, *array) at ``time`` [s]."""

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """What was found in one frame."""

    def event(self, event: Event) -> None:
        """Something that a `palpate.GraspMonitor` noticed."""

    def close(self) -> None:
        """Finish."""


class Recorder(Sink, Protocol):
    """A sink that is a file; ``with`` closes it."""

    def __enter__(self) -> Any: ...

    def __exit__(self, *_: object) -> None: ...


def recorder(
    path: str | Path, channels: Sequence[str], *, positions: Any = None, meta: Mapping[str, Any] | None = None
) -> Recorder:
    """The recorder of a file name: .mcap, .nc / .h5 / .hdf5, or .zarr; each writes while the stream runs.

    Parameters
    ----------
    path : str or Path
        Must not exist yet: a recording is never overwritten.
    channels : sequence of str
        Of the readings.
    positions : array (taxel, 2) or (taxel,), optional
        Of scattered taxels [m].
    meta : mapping
        Anything worth keeping, by names: text, numbers, truth values, None, and lists and mappings of them.

    Raises
    ------
    InvalidInput
        A name that exists, a format that cannot take a stream, or a channel that is not known; while it records, a reading of another shape or
        a disk that is full (what was written before stays readable).

    Examples
    --------
    >>> import tempfile
    >>> from palpate.recordings import read_recording, recorder
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with recorder(f"{folder}/press.h5", ["stress_zz"]) as out:
    ...         for frame in range(5):
    ...             out.readings(0.01 * frame, [[0.0, 1.0, 0.0]])
    ...     recording = read_recording(f"{folder}/press.h5")
    >>> recording.readings.shape, recording.time.tolist()[-1]
    ((5, 1, 3), 0.04)
    """
    from palpate.elastic.channels import find_channel
    from palpate.recordings.formats import find_format
    from palpate.recordings.redaction import without_secrets_in_meta

    if isinstance(channels, str) or not channels:
        raise InvalidInput(f"channels must be a list of names, one for each channel of the readings; got {channels!r}.")
    for channel in channels:
        find_channel(channel)  # before anything is written: a stream of an unknown channel could never be read
    kept = without_secrets_in_meta(meta) if isinstance(meta, Mapping) else meta
    return find_format(path).recorder(Path(path), channels, positions=positions, meta=kept)
