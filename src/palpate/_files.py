"""Check type and size of a path before reading it."""

from __future__ import annotations

import math
import stat
from pathlib import Path

from palpate._memory import gigabytes
from palpate.errors import InvalidInput

__all__ = ["TEXT", "ordinary", "small_text"]

#: Largest size [bytes] of a file that describes something (a skin, an outline).
TEXT = 1 << 26


def ordinary(path: str | Path, *, most: float = math.inf, what: str = "") -> Path:
    """Return the path if it is an existing ordinary file of at most ``most`` bytes; ``what`` names the expected kind of file for error messages.

    Raises
    ------
    InvalidInput
        No such file; a folder, a pipe or a device, which would not end or can be read only once; or a file that is too large.

    Examples
    --------
    >>> import tempfile
    >>> from palpate._files import ordinary
    >>> with tempfile.NamedTemporaryFile() as file:
    ...     ordinary(file.name).name == Path(file.name).name
    True
    """
    found = Path(path)
    try:
        known = found.stat()
    except FileNotFoundError as error:
        raise InvalidInput(f"{found}: no such file.") from error
    except OSError as error:
        raise InvalidInput(f"{found}: cannot be read ({error.strerror}).") from error
    if stat.S_ISDIR(known.st_mode):
        raise InvalidInput(f"{found} is a folder; give a file.")
    if not stat.S_ISREG(known.st_mode):
        raise InvalidInput(f"{found} is a pipe or a device, not a file. Write what it gives to a file, and give that.")
    if known.st_size > most:
        raise InvalidInput(
            f"{found} has {gigabytes(known.st_size)}, but {what} has at most {gigabytes(most)}: this must be another file."
        )
    return found


def small_text(path: str | Path, what: str) -> str:
    """Return the text of a small file; raise `InvalidInput` if it is not text. ``what`` names the expected kind of file for error messages."""
    found = ordinary(path, most=TEXT, what=what)
    try:
        return found.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else error.reason
        raise InvalidInput(f"{found}: cannot be read as text in UTF-8 ({why}); save it in UTF-8.") from error
