"""The interface of methods: options, requirements on a skin, preparation.

A method is a frozen dataclass with keyword-only fields, one for each option, declared by the functions below. Its
class has a short name and its requirements. ``prepare`` computes everything that depends on skin and method and
returns an object that solves frames. To add a method, write one file with such a class, and call
`palpate.inverse.registry.register` (or declare an entry point of the group "palpate.methods").
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, fields
from numbers import Integral
from typing import Any, ClassVar, Protocol

import numpy as np

from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.estimate import Estimate
from palpate.inverse.linear.parameter import RULES
from palpate.inverse.problem import Problem
from palpate.sensing.grids import Grid
from palpate.units import is_number

__all__ = ["Method", "Needs", "Option", "Prepared", "choice", "count", "function", "number", "rule"]


@dataclass(frozen=True)
class Option:
    """The accepted values of an option and its text form.

    ``check`` returns the value in its stored form, or raises. ``read`` parses the text of a command line (or raises ValueError); None if an option
    has no text form.
    """

    help: str
    accepts: str
    check: Callable[[str, Any], Any]
    read: Callable[[str], Any] | None


@dataclass(frozen=True)
class Needs:
    """What a method requires of a skin."""

    free_boundary: bool = False
    pressure: bool = False
    noise: bool = False


class Prepared(Protocol):
    """A method prepared for a skin."""

    #: Grid of the resulting surface.
    grid: Grid

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        ...


@dataclass(frozen=True, kw_only=True)
class Method(abc.ABC):
    """A method to compute traction from readings; see the module.

    Examples
    --------
    >>> import palpate as pp
    >>> method = pp.Tikhonov(order=2, rule="gcv")
    >>> isinstance(method, pp.Method), str(method), method.chosen
    (True, "tikhonov(order=2, rule='gcv')", 'gcv')

    >>> sorted(method.options()), pp.paper.ConstantFriction.required()
    (['order', 'parameter', 'rule'], ('friction',))

    >>> method.returns(("z",)), method.assumptions()  # nothing is assumed
    (('z',), ())

    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> problem = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])).problem()
    >>> method.check(problem)  # nothing is missing
    >>> method.resolved(problem) is method
    True

    >>> method.prepare(problem).grid.count  # solves frames on these cells
    15
    """

    #: Short name, in Python, on the command line and in files.
    name: ClassVar[str]
    #: One line for help texts.
    summary: ClassVar[str]
    needs: ClassVar[Needs] = Needs()
    #: Components sought by default; None: all that the channels can separate.
    seeks: ClassVar[tuple[str, ...] | None] = None
    #: Whether its results have error bars.
    error_bars: ClassVar[bool] = False
    #: Whether it is one of the comparison methods.
    comparison: ClassVar[bool] = False
    #: Whether components that the channels cannot separate may be sought, because the constraints (pressure pushes, contact is compact) separate them.
    narrows: ClassVar[bool] = False
    #: Whether it solves frames one after another, each in a hundredth of a second or more.
    by_frame: ClassVar[bool] = False
    #: Rules that choose ``parameter`` if it is not given; the first one by default.
    rules: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for f in fields(self):
            known = f.metadata.get("option")
            value = getattr(self, f.name)
            if known is not None and not (value is None and f.default is None):
                object.__setattr__(self, f.name, known.check(f.name, value))
        if getattr(self, "rule", None) is not None and getattr(self, "parameter", None) is not None:
            raise InvalidInput("give the parameter or the rule that chooses it, not both.")

    @property
    def chosen(self) -> float | str:
        """The parameter, or the rule that chooses it."""
        parameter, named = getattr(self, "parameter", None), getattr(self, "rule", None)
        return parameter if parameter is not None else named or self.rules[0]

    @property
    def friction_given(self) -> float | None:
        """The given coefficient of friction without its sign, or None.

        Examples
        --------
        >>> import palpate as pp
        >>> pp.Adaptive(friction=0.6).friction_given, pp.Adaptive().friction_given
        (0.6, None)
        """
        given = getattr(self, "friction", None)
        return None if given is None else abs(float(given))

    @abc.abstractmethod
    def prepare(self, problem: Problem) -> Prepared:
        """Compute everything that depends on skin and method but not on the frame; implementations call `check` first."""

    def resolved(self, problem: Problem) -> Method:
        """The method that actually runs on this skin: this one, or the one it delegates to."""
        return self

    def returns(self, components: tuple[str, ...]) -> tuple[str, ...]:
        """The components of the result if ``components`` are sought."""
        return components

    def assumptions(self) -> tuple[str, ...]:
        """Notes for every result."""
        return ()

    @classmethod
    def options(cls) -> dict[str, Option]:
        """Every option, by name."""
        return {f.name: f.metadata["option"] for f in fields(cls) if "option" in f.metadata}

    @classmethod
    def required(cls) -> tuple[str, ...]:
        """Names of the options without a default."""
        return tuple(f.name for f in fields(cls) if f.default is MISSING and f.default_factory is MISSING)

    def check(self, problem: Problem) -> None:
        """Raise an error if the skin does not meet the method's requirements."""
        if self.needs.free_boundary and problem.boundary == "periodic":
            raise Unsupported(
                f'method="{self.name}" needs boundary="free"; use method="tikhonov" on a periodic surface.'
            )
        if self.needs.pressure and "z" not in problem.components:
            raise Unsupported(
                f'method="{self.name}" keeps pressure from pulling, so it needs the pressure: seek component z as well, or use method="tikhonov".'
            )
        if self.needs.noise and any(a.noise_std is None for a in problem.planes):
            raise Unsupported(
                f'method="{self.name}" needs the noise: give the array noise=..., or use method="tikhonov".'
            )

    def __str__(self) -> str:
        said = [f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if getattr(self, f.name) != f.default]
        return f"{self.name}({', '.join(said)})" if said else self.name


# -- options -----------------------------------------------------------------------------------------------------------


def _declared(default: Any, option: Option) -> Any:
    metadata = {"option": option}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def number(default: Any = None, *, help: str, unit: str = "", negative: bool = False, required: bool = False) -> Any:
    """A finite number, positive unless ``negative`` (then not 0)."""
    accepts = ("a number other than 0" if negative else "a positive number") + (f" of {unit}" if unit else "")

    def check(name: str, value: Any) -> float:
        if not is_number(value) or not (value != 0 if negative else value > 0):
            raise InvalidInput(f"{name} must be {accepts}; got {value!r}.")
        return float(value)

    return _declared(MISSING if required else default, Option(help, accepts, check, float))


def count(default: int = 0, *, help: str) -> Any:
    """A whole number that is not negative."""
    accepts = "a whole number >= 0"

    def check(name: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, Integral) or value < 0:
            raise InvalidInput(f"{name} must be {accepts}; got {value!r}.")
        return int(value)

    return _declared(default, Option(help, accepts, check, int))


def choice(default: int, values: Sequence[int], *, help: str) -> Any:
    """One of a few whole numbers."""
    accepts = f"{', '.join(map(str, values[:-1]))} or {values[-1]}"

    def check(name: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, Integral) or value not in values:
            raise InvalidInput(f"{name} must be {accepts}; got {value!r}.")
        return int(value)

    return _declared(default, Option(help, accepts, check, int))


def rule(rules: Sequence[str], *, help: str) -> Any:
    """The name of a rule that chooses the parameter."""
    accepts = f"one of {', '.join(rules)}"

    def check(name: str, value: Any) -> str:
        if value not in rules:
            known = isinstance(value, str) and value in RULES
            raise (Unsupported if known else InvalidInput)(f"{name} must be {accepts}; got {value!r}.")
        return str(value)

    return _declared(None, Option(help, accepts, check, str))


def function(*, help: str, accepts: str) -> Any:
    """A function, or a mapping from component to function; Python only."""

    def check(name: str, value: Any) -> Any:
        parts = list(value.values()) if hasattr(value, "values") else [value]
        if not parts or not all(callable(p) for p in parts):
            raise InvalidInput(f"{name} must be {accepts}; got {value!r}.")
        return value

    # A mapping has no hash; equal methods still compare equal.
    return field(metadata={"option": Option(help, accepts, check, None)}, hash=False)
