"""Recordings and skins in and out of files."""

from palpate.recordings.formats import read_recording, read_table, write_recording
from palpate.recordings.recording import Recording
from palpate.recordings.skinfile import read_skin
from palpate.recordings.touchfile import read_touch, write_touch

__all__ = [
    "Recording",
    "read_recording",
    "read_skin",
    "read_table",
    "read_touch",
    "write_recording",
    "write_touch",
]
