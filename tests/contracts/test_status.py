"""The closed list of what became of a frame."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.status import Status


@pytest.mark.parametrize("status", list(Status))
def test_each_status_says_what_it_means_and_what_to_do(status: Status) -> None:
    assert status.meaning
    assert status.remedy or status in (Status.SOLVED, Status.NO_CONTACT)
    assert Status.of(status.label) is status
    assert Status(np.int8(status)) is status
    assert str(status) == status.label


def test_codes_are_those_of_files_already_written() -> None:
    """A code never changes its meaning; new ones are added at the end."""
    assert [s.label for s in sorted(Status)] == [
        "solved",
        "no contact",
        "capturing zero",
        "not converged",
        "not pushing",
        "frozen",
        "missing",
        "failed",
        "unexplained",
        "undecided",
        "overload",
    ]
    assert [s for s in Status if not s.known] == [Status.MISSING, Status.FAILED]
