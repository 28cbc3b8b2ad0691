"""The command line: one module per command that reads, calls the library and writes. It computes nothing.

In: arguments, files and skin.toml.
Out: text, files and pictures; an error as one message and exit code.
Open first: `commands.py`.
"""

from __future__ import annotations

import sys
from typing import Any

__all__ = ["app", "main"]


def main() -> None:
    """Entry point. Ctrl-C also works while the commands are still being imported."""
    try:
        from palpate.cli import commands
    except ModuleNotFoundError as error:
        if error.name not in ("typer", "rich"):
            raise
        sys.stderr.write('error: the command line needs more packages: pip install "palpate[cli]"\n')
        sys.exit(1)
    except KeyboardInterrupt:
        sys.stderr.write("error: stopped\n")
        sys.exit(130)
    commands.main()


def __getattr__(name: str) -> Any:
    if name == "app":
        from palpate.cli.commands import app

        return app
    raise AttributeError(name)
