"""Options for methods and their parameters, generated from the registry of methods."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.command import Command

if TYPE_CHECKING:
    from palpate.inverse.method import Method, Option

_KEY = "palpate.methods"


class MethodCommand(Command):
    """A command with the option --method and all options of all methods."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The command's own parameters and those of the methods; if both have the same name, the command's own is used."""
        own = super().get_params(ctx)
        known = ctx.meta.setdefault(f"{_KEY}.params", [])
        if not known:
            names = {p.name for p in own}
            known.extend(_click_options([p for p in self.parameters() if p.name not in names]))
        last = [p for p in own if p.name == "help"]
        return [*(p for p in own if p.name != "help"), *known, *last]

    def parameters(self) -> list[inspect.Parameter]:
        """Return the parameters of the methods, each with its help."""
        return _every_option()


class TrackerCommand(MethodCommand):
    """A command with the options of a tracker's method."""

    def parameters(self) -> list[inspect.Parameter]:
        """Return the options of the method that `Skin.track` accepts."""
        from palpate.inverse.contact.methods import Constrained
        from palpate.skin import Skin

        taken = inspect.signature(Skin.track).parameters
        return [
            _parameter(name, f"{_sentence(option, Constrained.rules if name == 'parameter' else ())}.", "VALUE")
            for name, option in Constrained.options().items()
            if name in taken and option.read is not None
        ]


def chosen_method(ctx: typer.Context) -> Method | None:
    """Return the method chosen on the command line, or None.

    Raises
    ------
    InvalidInput, Unsupported
        No such method, a value that it does not accept, or an option that it does not take.
    """
    from palpate.inverse.registry import method_from_text

    given = dict(ctx.meta.get(_KEY, {}))
    name = given.pop("method", None)
    return method_from_text(name, given) if given or name is not None else None


def tracker_options(ctx: typer.Context) -> dict[str, Any]:
    """Return the checked options that the command line gives for the method of a tracker, for `Skin.track`.

    Raises
    ------
    InvalidInput
        A value that the method does not accept.
    """
    from palpate.inverse.contact.methods import Constrained
    from palpate.inverse.registry import method_from_text

    given = ctx.meta.get(_KEY, {})
    method = method_from_text(Constrained.name, given)
    return {name: getattr(method, name) for name in given}


def _sentence(option: Option, rules: Sequence[str]) -> str:
    return option.help + (f"; or {', '.join(rules)}" if rules else "")


def _every_option() -> list[inspect.Parameter]:
    """Return --method, and one option for each name that any method accepts as text."""
    from palpate.inverse.registry import methods, options

    known = {n: m for n, m in methods().items() if all(m.options()[o].read is not None for o in m.required())}
    parameters = [_parameter("method", f"How: {'; '.join(f'{n} ({m.summary})' for n, m in known.items())}.", "NAME")]
    for name, takers in options(command_line=True).items():
        # list methods with the same help text together
        said: dict[str, list[str]] = {}
        for method, option in takers.items():
            rules = known[method].rules if name == "parameter" and method in known else ()
            said.setdefault(_sentence(option, rules), []).append(method)
        parameters.append(_parameter(name, "; ".join(f"{', '.join(m)}: {h}" for h, m in said.items()) + ".", "VALUE"))
    return parameters


def _click_options(parameters: Sequence[inspect.Parameter]) -> list[Any]:
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
