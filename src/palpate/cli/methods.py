"""Methods and their options on the command line, as the registry knows them."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

if TYPE_CHECKING:
    from palpate.inverse.method import Method

_KEY = "palpate.methods"


class MethodCommand(TyperCommand):
    """A command that takes --method and every option of every method."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Its own parameters and those of the methods."""
        known = ctx.meta.setdefault(f"{_KEY}.params", [])
        if not known:
            known.extend(_options())
        return [*super().get_params(ctx), *known]


def chosen_method(ctx: typer.Context) -> Method | None:
    """The method that the command line asks for; None where it asks for nothing.

    Raises
    ------
    InvalidInput, Unsupported
        No such method, a value that it does not accept, or an option that it does not take.
    """
    from palpate.inverse.registry import method_from_text

    given = dict(ctx.meta.get(_KEY, {}))
    name = given.pop("method", None)
    return method_from_text(name, given) if given or name is not None else None


def _options() -> list[Any]:
    """--method, and one option for each name that any method takes in text."""
    from palpate.inverse.registry import methods, options

    known = {n: m for n, m in methods().items() if all(m.options()[o].read is not None for o in m.required())}
    parameters = [_parameter("method", f"How: {'; '.join(f'{n} ({m.summary})' for n, m in known.items())}.", "NAME")]
    for name, takers in options(command_line=True).items():
        # methods that say the same are named together
        said: dict[str, list[str]] = {}
        for method, option in takers.items():
            rules = known[method].rules if name == "parameter" and method in known else ()
            said.setdefault(option.help + (f"; or {', '.join(rules)}" if rules else ""), []).append(method)
        parameters.append(_parameter(name, "; ".join(f"{', '.join(m)}: {h}" for h, m in said.items()) + ".", "VALUE"))

    def nothing(**_: Any) -> None:
        pass

    # typer makes options from a signature; its classes for them change from version to version
    nothing.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    nothing.__annotations__ = {p.name: p.annotation for p in parameters}
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(add_help_option=False)(nothing)
    return list(typer.main.get_command(app).params)


def _parameter(name: str, help: str, metavar: str) -> inspect.Parameter:
    def keep(ctx: typer.Context, value: str | None) -> str | None:
        if value is not None:
            ctx.meta.setdefault(_KEY, {})[name] = value
        return value

    option = typer.Option(help=help, metavar=metavar, callback=keep, expose_value=False, show_default=False)
    annotation = Annotated[str | None, option]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
