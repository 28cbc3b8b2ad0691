"""Print text on the terminal in such a way that control characters in file contents have no effect."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

from palpate.errors import printable

__all__ = ["guarded", "unguarded"]


class _Guarded:
    """A text stream that writes control characters as their escapes."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        self.stream.write(printable(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """Escape control characters on standard output and error, where headers, names and notes of files appear."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Guarded(before[0]), _Guarded(before[1])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def unguarded(stream: Any) -> Any:
    """Return the underlying stream, for a progress bar, which must move the cursor."""
    return stream.stream if isinstance(stream, _Guarded) else stream
