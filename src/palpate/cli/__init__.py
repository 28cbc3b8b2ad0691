"""The command line: thin shells, one module per command, that read, call the library, and write."""

from palpate.cli.commands import app, main

__all__ = ["app", "main"]
