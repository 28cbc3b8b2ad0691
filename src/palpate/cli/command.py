"""The base class of all commands. It refuses an option that is given twice, instead of ignoring one value."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

from palpate.errors import InvalidInput

__all__ = ["Command"]


class Command(TyperCommand):
    """A command that raises an error if an option that takes one value is given several times."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of the command line. The library alone would silently use the last value."""
        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        option: Any
        for option in given:
            single = option.param_type_name == "option" and not (option.multiple or option.is_flag or option.count)
            if single and sum(other is option for other in given) > 1:
                raise InvalidInput(f"{option.opts[0]} is given more than once, and has one value: give it once.")
        return super().parse_args(ctx, args)
