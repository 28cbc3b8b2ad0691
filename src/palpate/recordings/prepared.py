"""Files with the preparation of a skin (`palpate._recall`): how they are identified, and when they are refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from palpate._recall import Recall, read, write
from palpate.errors import InvalidInput
from palpate.inverse.problem import Problem
from palpate.recordings.files import atomically

__all__ = ["read_prepared", "write_prepared"]


def write_prepared(problem: Problem, path: str | Path) -> None:
    """Write the current preparation of a problem."""
    import palpate

    about = {"palpate": palpate.__version__, **problem.about()}
    entries = problem.worked_out()
    if not entries:
        raise InvalidInput("nothing is prepared yet that takes long: call prepare() or reconstruct() first.")
    # The content does not depend on who writes it, so that runs that prepare the same skin at the same time do not
    # disturb each other.
    atomically(path, lambda fresh: write(fresh, entries, about), sole=False)


def read_prepared(problem: Problem, path: str | Path) -> Recall:
    """Read what an earlier run prepared for exactly this problem."""
    import palpate

    mine, version = problem.about(), palpate.__version__

    def check(about: Mapping[str, str]) -> None:
        if about.get("palpate") != version:
            raise InvalidInput(
                f"{path} was written by palpate {about.get('palpate')}, and this is {version}. Prepare the skin again and save it "
                "(Skin.prepare, Skin.save_prepared)."
            )
        other = [name for name, value in mine.items() if about.get(name) != value]
        if other:
            differ = "differs" if other in (["pad"], ["surface"], ["boundary"]) else "differ"
            raise InvalidInput(
                f"{path} was prepared for another skin: {' and '.join(other)} {differ}. Prepare this one and save it to a file of its own "
                "(Skin.prepare, Skin.save_prepared)."
            )

    return read(path, check)
