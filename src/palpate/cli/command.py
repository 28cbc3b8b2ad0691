"""What all commands have in common: no option is ignored because it is given again."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

from palpate.errors import InvalidInput

__all__ = ["Command"]


class Command(TyperCommand):
    """A command that refuses an option with one value that is given several."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of the command line; the library alone would keep the last value in silence."""
        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        option: Any
        for option in given:
            single = option.param_type_name == "option" and not (option.multiple or option.is_flag or option.count)
            if single and sum(other is option for other in given) > 1:
                raise InvalidInput(f"{option.opts[0]} is given more than once, and has one value: give it once.")
        return super().parse_args(ctx, args)
