"""Exceptions. Every message states what is wrong, what was received, what is accepted and what to do."""

from __future__ import annotations

import re

__all__ = ["InvalidInput", "NotObservable", "PalpateError", "UncheckedInput", "Unsupported", "printable"]

#: Control characters but newline and tab, marks that turn the direction of writing, and halves of surrogate pairs.
_COMMANDS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    r"""Text of a file without the characters that command a terminal: each is replaced by its escape, as Python writes it.

    Examples
    --------
    >>> from palpate.errors import printable
    >>> print(printable("red: \x1b[31m"))
    red: \x1b[31m
    """
    return _COMMANDS.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


class PalpateError(ValueError):
    """Base of every error that palpate raises on purpose."""

    def __str__(self) -> str:
        return printable(super().__str__())


class InvalidInput(PalpateError):
    """An invalid value, file or array: wrong shape, wrong unit, NaN, or out of range."""


class NotObservable(PalpateError):
    """The requested quantity has no effect on the measured channels, so no method can recover it."""


class Unsupported(PalpateError):
    """A combination of options that this method does not support; the message names one that does."""


class UncheckedInput(UserWarning):
    """A file that may have been cut or changed undetectably: it is read, and the warning says what to compare."""
