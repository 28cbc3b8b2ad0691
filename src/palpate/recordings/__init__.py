"""Read and write recordings, skins and touches.

In: files of any format, tables of other programs, skin.toml.
Out: `Recording`, `Skin` parts and touches; files written at once or frame by frame.
Open first: `formats.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from palpate.recordings.clock import Clock, read_clock
from palpate.recordings.columns import TableMapping
from palpate.recordings.formats import Format, open_recording, read_recording, write_recording
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.recorder import recorder
from palpate.recordings.recording import Recording
from palpate.recordings.sinks import Recorder, Sink
from palpate.recordings.tables import read_table
from palpate.recordings.touchfile import read_touch, write_touch

if TYPE_CHECKING:
    from palpate.recordings.sections import read_camera, read_columns, read_stream, read_uncertainty
    from palpate.recordings.skinfile import read_skin

__all__ = [
    "Clock",
    "Format",
    "Recorder",
    "Recording",
    "Sink",
    "TableMapping",
    "TopicMapping",
    "open_recording",
    "read_camera",
    "read_clock",
    "read_columns",
    "read_recording",
    "read_skin",
    "read_stream",
    "read_table",
    "read_touch",
    "read_uncertainty",
    "recorder",
    "write_recording",
    "write_touch",
]


def __getattr__(name: str) -> Any:
    """Load skin files on first request: they need pydantic, recordings do not."""
    if name == "read_skin":
        from palpate.recordings import skinfile

        return skinfile.read_skin
    if name in ("read_camera", "read_columns", "read_stream", "read_uncertainty"):
        from palpate.recordings import sections

        return getattr(sections, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
