"""Outcomes of a frame: a fixed list, each with its meaning and a remedy."""

from __future__ import annotations

import enum

__all__ = ["Status"]


class Status(enum.IntEnum):
    """The outcome of one frame.

    A member is a small whole number, so that a batch keeps its statuses in an integer array and a file in a variable with CF flags.
    ``label`` is its name in files and packets, ``meaning`` explains it in a sentence, ``remedy`` says what to do (or is ""), and ``known`` is False if the frame has no
    numbers: traction and all that follows from it are then NaN.

    Examples
    --------
    >>> from palpate.status import Status
    >>> Status.MISSING.known, Status(1).label
    (False, 'no contact')
    >>> Status.of("solved") is Status.SOLVED
    True
    """

    label: str
    meaning: str
    remedy: str
    known: bool

    def __new__(cls, code: int, label: str, meaning: str, remedy: str = "", known: bool = True) -> Status:
        self = int.__new__(cls, code)
        self._value_ = code
        self.label, self.meaning, self.remedy, self.known = label, meaning, remedy, known
        return self

    SOLVED = 0, "solved", "the traction of this frame was found"
    NO_CONTACT = 1, "no contact", "noise alone explains the readings"
    CAPTURING_ZERO = (
        2,
        "capturing zero",
        "the zero is being captured: the frame is taken to be without contact",
        "touch nothing until the first frames are over, or pass baseline=0 if the readings have their zero removed already",
    )
    NOT_CONVERGED = (
        3,
        "not converged",
        "the iteration stopped before it reached its tolerance",
        "another note of the frame says what helps",
    )
    NOT_PUSHING = (
        4,
        "not pushing",
        "a contact that only pushes does not explain the readings: adhesion, cells that pull, a wrong pad or unit",
        'Skin.reconstruct(method="tikhonov") or palpate reconstruct --method tikhonov lets traction pull; otherwise check pad, units and the sign of the readings',
    )
    FROZEN = (
        5,
        "frozen",
        "the whole sensor has repeated itself bit by bit for many frames: the readings may be old",
        "check that the sensor still runs",
    )
    MISSING = (
        6,
        "missing",
        "too few readings are finite and in range",
        "check the sensor's cable, supply and range; the next good frame is solved again",
        False,
    )
    FAILED = (
        7,
        "failed",
        "the arithmetic broke down on this frame",
        "a coarser surface or a larger parameter helps; please report the frame",
        False,
    )
    UNEXPLAINED = (
        8,
        "unexplained",
        "the pad's model does not explain these readings",
        "check pad, depth, units, axes and signs of the channels, and broken taxels; press with a known force to check the unit",
    )
    UNDECIDED = (
        9,
        "undecided",
        "noise or an offset explains these readings, and so would a contact",
        "give frames at rest (--baseline 30, zero=), or the noise of the array (noise=)",
    )
    OVERLOAD = (
        10,
        "overload",
        "readings lie at the end of their range: the load is at least this, without a known upper limit",
        "press less, or use a sensor or a setting with a larger range",
    )

    @classmethod
    def of(cls, label: str) -> Status:
        """The member with this label.

        Examples
        --------
        >>> from palpate import Status
        >>> Status.of("no contact").meaning
        'noise alone explains the readings'
        """
        return next(s for s in cls if s.label == label)

    @classmethod
    def coded(cls, code: int) -> Status:
        """The member with this code, as arrays and files store it.

        Examples
        --------
        >>> from palpate import Status
        >>> Status.coded(6).label
        'missing'
        """
        return next(s for s in cls if s == code)

    def __str__(self) -> str:
        return self.label
