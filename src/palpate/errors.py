"""Exceptions. Every message says what was wrong, what was received, what is accepted and what to do."""

from __future__ import annotations

__all__ = ["InvalidInput", "NotObservable", "PalpateError", "UncheckedInput", "Unsupported"]


class PalpateError(ValueError):
    """Base of every error that palpate raises on purpose."""


class InvalidInput(PalpateError):
    """A value, a file or an array that cannot be meant: wrong shape, wrong unit, NaN, out of range."""


class NotObservable(PalpateError):
    """What was asked for leaves no trace in what was measured, so no method can recover it."""


class Unsupported(PalpateError):
    """A combination of options that this method cannot serve; the message names one that can."""


class UncheckedInput(UserWarning):
    """A file that may have been cut or changed without a trace: it is read, and the warning says what to compare."""
