"""Show the progress of a long command on a terminal."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any

from palpate.cli.terminal import unguarded

if TYPE_CHECKING:
    from collections.abc import Iterable


def progress(items: Iterable[Any], label: str) -> Iterable[Any]:
    """Return the items, and show a bar on a terminal if the work takes long."""
    from rich.console import Console
    from rich.progress import track

    listed = list(items)
    console = Console(file=unguarded(sys.stderr))
    if len(listed) < 3 or not console.is_terminal:
        return listed
    return track(listed, description=label, console=console, transient=True)


def busy(label: str) -> Any:
    """Show a spinner on a terminal."""
    from rich.console import Console

    return Console(file=unguarded(sys.stderr)).status(label)


#: Seconds between two lines about long work if no terminal shows a bar.
EVERY = 30.0
#: Time after which a hint is shown [s].
LONG = 120.0


class Bar:
    """A progress bar that a callback updates, with remaining time; a line every half minute without a terminal."""

    def __init__(self, label: str, total: int, *, hint: str = "") -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(file=unguarded(sys.stderr))
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._label, self._total, self._hint = label, total, hint
        self._silent = not console.is_terminal
        self._done = self._begun = self._told = 0.0

    def __enter__(self) -> Any:
        self._begin()
        return lambda what="": self._show(self._done + 1, f"{self._label} {what}".strip())

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def _begin(self) -> None:
        self._progress.start()
        self._task = self._progress.add_task(self._label, total=self._total)
        self._begun = self._told = time.monotonic()

    def _show(self, done: float, what: str) -> None:
        self._done = done
        self._progress.update(self._task, completed=done, description=what)
        now = time.monotonic()
        if self._silent and now - self._told > EVERY and 0 < done < self._total:
            left = (now - self._begun) / done * (self._total - done)
            sys.stderr.write(
                f"{self._label}: {done:.0f} of {self._total}, about {in_words(left)} left{self._hint if left > LONG else ''}\n"
            )
            sys.stderr.flush()
            self._told = now


class Frames(Bar):
    """A progress bar that also shows the number of finished frames."""

    def __enter__(self) -> Any:
        self._begin()
        return lambda done: self._show(done, self._label)


def in_words(seconds: float) -> str:
    """Return a duration as text: "40 s", "12 min", "3.5 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
