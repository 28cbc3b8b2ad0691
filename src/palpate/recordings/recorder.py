"""Recording of a stream: one interface for every format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.errors import InvalidInput
from palpate.recordings.formats import find_format
from palpate.recordings.sinks import Recorder

__all__ = ["recorder"]


def recorder(
    path: str | Path, channels: Sequence[str], *, positions: Any = None, meta: Mapping[str, Any] | None = None
) -> Recorder:
    """A recorder for a file name (.mcap, .nc / .h5 / .hdf5, or .zarr) that writes while the stream runs.

    Parameters
    ----------
    path : str or Path
        Must not exist yet: a recording is never overwritten.
    channels : sequence of str
        Channels of the readings.
    positions : array (taxel, 2) or (taxel,), optional
        Positions of scattered taxels [m].
    meta : mapping
        Anything worth keeping, by names: text, numbers, truth values, None, and lists and mappings of them.

    Raises
    ------
    InvalidInput
        A name that exists, a format that cannot take a stream, or a channel that is not known; while it records, a reading of another shape,
        planes that differ in shape, or a disk that is full (what was written before stays readable).

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
    from palpate.recordings.redaction import without_secrets_in_meta

    if isinstance(channels, str) or not channels:
        raise InvalidInput(f"channels must be a list of names, one for each channel of the readings; got {channels!r}.")
    for channel in channels:
        find_channel(channel)  # before anything is written: a stream of an unknown channel could never be read
    kept = without_secrets_in_meta(meta) if isinstance(meta, Mapping) else meta
    return find_format(path).recorder(Path(path), channels, positions=positions, meta=kept)
