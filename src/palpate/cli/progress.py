"""What a long command shows on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable


def progress(items: Iterable[Any], label: str) -> Iterable[Any]:
    """The items, with a bar on a terminal while the work is long."""
    from rich.console import Console
    from rich.progress import track

    listed = list(items)
    console = Console(stderr=True)
    if len(listed) < 3 or not console.is_terminal:
        return listed
    return track(listed, description=label, console=console, transient=True)


def busy(label: str) -> Any:
    """A spinner on a terminal."""
    from rich.console import Console

    return Console(stderr=True).status(label)


class Bar:
    """A progress bar that is fed by a callback."""

    def __init__(self, label: str, total: int) -> None:
        from rich.console import Console
        from rich.progress import Progress

        console = Console(stderr=True)
        self._progress = Progress(console=console, transient=True, disable=not console.is_terminal)
        self._label, self._total = label, total

    def __enter__(self) -> Any:
        self._progress.start()
        task = self._progress.add_task(self._label, total=self._total)
        return lambda what: self._progress.update(task, advance=1, description=what)

    def __exit__(self, *_: object) -> None:
        self._progress.stop()


class Frames(Bar):
    """The same, told how many are done."""

    def __enter__(self) -> Any:
        self._progress.start()
        task = self._progress.add_task(self._label, total=self._total)
        return lambda done: self._progress.update(task, completed=done)
