"""The registry of all methods, by short name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.comparison.elastic_net import ElasticNet
from palpate.inverse.comparison.maximum_entropy import MaximumEntropy
from palpate.inverse.comparison.network import AnalogNetwork
from palpate.inverse.comparison.non_negative import NonNegative
from palpate.inverse.comparison.total_variation import TotalVariation
from palpate.inverse.contact.methods import Adaptive, Automatic, Constrained, Local
from palpate.inverse.linear.methods import Hilgers, Tikhonov, Truncated, Wiener
from palpate.inverse.linear.parameter import RULES
from palpate.inverse.method import Method, Option
from palpate.inverse.paper.constant_friction import ConstantFriction
from palpate.inverse.paper.division import Division
from palpate.inverse.paper.linear_system import LinearSystem

__all__ = ["GROUP", "method_from_text", "method_named", "methods", "options", "register", "requested_method", "unnamed"]

AnyMethod = TypeVar("AnyMethod", bound=type[Method])

#: Group of entry points for methods of other packages.
GROUP = "palpate.methods"

_BUILT_IN: tuple[type[Method], ...] = (
    Automatic,
    Adaptive,
    Constrained,
    Local,
    Tikhonov,
    Hilgers,
    Truncated,
    Wiener,
    Division,
    LinearSystem,
    ConstantFriction,
    NonNegative,
    ElasticNet,
    TotalVariation,
    MaximumEntropy,
    AnalogNetwork,
)
_registered: dict[str, type[Method]] = {m.name: m for m in _BUILT_IN}


def register(method: AnyMethod) -> AnyMethod:
    """Register a method under its short name, for Python and the command line; also a class decorator.

    Raises
    ------
    InvalidInput
        It is no `Method`, or another one has its name.

    Examples
    --------
    >>> import palpate as pp
    >>> pp.register(pp.Tikhonov) is pp.methods()["tikhonov"]  # what is there already stays
    True
    """
    if not (isinstance(method, type) and issubclass(method, Method)):
        raise InvalidInput(f"a method must be a subclass of palpate.inverse.Method; got {method!r}.")
    if _registered.setdefault(method.name, method) is not method:
        raise InvalidInput(f"the name {method.name!r} is that of {_registered[method.name].__name__}; choose another.")
    return method


def unregister(name: str) -> None:
    """Remove a registered method."""
    if name in {m.name for m in _BUILT_IN}:
        raise InvalidInput(f"{name} is part of palpate and cannot be removed.")
    _registered.pop(name, None)


def methods() -> dict[str, type[Method]]:
    """All methods by short name, including those of other packages.

    Examples
    --------
    >>> import palpate as pp
    >>> pp.methods()["tikhonov"].__name__
    'Tikhonov'
    """
    from importlib.metadata import entry_points

    for entry in entry_points(group=GROUP):
        if entry.name not in _registered:
            register(entry.load())
    return dict(_registered)


def options(*, command_line: bool = False) -> dict[str, dict[str, Option]]:
    """All options by name: the methods that accept each, and their definitions."""
    out: dict[str, dict[str, Option]] = {}
    for name, method in methods().items():
        for option, known in method.options().items():
            if known.read is not None or not command_line:
                out.setdefault(option, {})[name] = known
    return out


def method_named(name: str, given: Mapping[str, Any]) -> Method:
    """The method with this short name and these options (None: the option's default).

    Raises
    ------
    InvalidInput
        No such method, or a value that it does not accept.
    Unsupported
        An option that it does not take.
    """
    method = _registered.get(name)
    if method is None:
        known = methods()
        if name not in known:
            raise InvalidInput(f"method must be one of {', '.join(known)}; got {name!r}.")
        method = known[name]
    said = {k: v for k, v in given.items() if v is not None}
    accepted = method.options()
    for option in said:
        if option not in accepted:
            takers = ", ".join(options().get(option, {}))
            other = f"it belongs to {takers}" if takers else f"it takes {', '.join(accepted) or 'no options'}"
            raise Unsupported(f'method="{name}" does not take {option}; {other}.')
    parameter = said.get("parameter")
    if isinstance(parameter, str):
        if parameter not in method.rules:
            kind = Unsupported if parameter in RULES else InvalidInput
            raise kind(
                f'method="{name}": parameter must be a positive number or one of {", ".join(method.rules)}; got {parameter!r}.'
            )
        if "rule" in said:
            raise InvalidInput(f"parameter={parameter!r} names the rule already: leave out rule={said['rule']!r}.")
        del said["parameter"]
        if "rule" in accepted:
            said["rule"] = parameter
    for option in method.required():
        if option not in said:
            raise InvalidInput(f'method="{name}" needs {option}=..., {accepted[option].help}')
    return method(**said)


def unnamed(given: Iterable[str]) -> str:
    """Name of the default method for these options: the automatic one, or the linear one if an option belongs to it."""
    return Tikhonov.name if {"order", "parameter", "rule"} & set(given) else Automatic.name


def requested_method(method: str | Method | None, given: Mapping[str, Any]) -> Method:
    """The method that a Python call requests: by name, as an object, or by its options alone.

    Raises
    ------
    InvalidInput, Unsupported
        As for `method_named`; options beside an object, which has its own; a class in place of an object.
    """
    said = {name: value for name, value in given.items() if value is not None}
    unknown = [name for name in given if name not in said and name not in options()]
    if unknown:
        raise Unsupported(f"{unknown[0]} is an option of no method; there are {', '.join(options())}.")
    if isinstance(method, Method):
        if said:
            first = next(iter(said))
            raise InvalidInput(
                f"{', '.join(said)} given beside a method with its own options: say {type(method).__name__}({first}=...)."
            )
        return method
    if isinstance(method, type):
        raise InvalidInput(f"method must be a {method.__name__} with its options: {method.__name__}(...).")
    return method_named(unnamed(said) if method is None else method, said)


def method_from_text(name: str | None, given: Mapping[str, str]) -> Method:
    """The method with options given as text on a command line.

    Raises
    ------
    InvalidInput, Unsupported
        As for `method_named`; options without a text form are refused.
    """
    chosen = unnamed(given) if name is None else name
    known = methods()
    accepted = known[chosen].options() if chosen in known else {}
    python_only = [o for o in (known[chosen].required() if chosen in known else ()) if accepted[o].read is None]
    if python_only:
        raise Unsupported(
            f'method="{chosen}" needs {", ".join(python_only)}, which only Python can say (Skin.reconstruct).'
        )
    said: dict[str, Any] = {}
    for option, text in given.items():
        read = accepted[option].read if option in accepted else None
        try:
            said[option] = text if read is None else read(text)
        except ValueError:
            said[option] = text  # the option's own check says what is accepted
    return method_named(chosen, said)
