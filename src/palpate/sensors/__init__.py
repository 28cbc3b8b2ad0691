"""Sensors that can be bought, and a template for one's own.

In: the name of a sensor.
Out: its skin file, with the source of each number and how well it is known.
Open first: `__init__.py`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

from palpate.errors import InvalidInput

__all__ = ["Preset", "digit", "gelsight_mini", "own_gel", "preset", "presets"]

_NAMES = (
    "gelsight_mini",
    "digit",
    "digit360",
    "nine_dtact",
    "densetact",
    "gelslim",
    "uskin",
    "reskin",
    "anyskin",
    "own_gel",
)


@dataclass(frozen=True)
class Preset:
    """The description of a sensor.

    Attributes
    ----------
    name : str
    text : str
        Text of its skin.toml.

    Examples
    --------
    >>> from palpate import sensors
    >>> sensors.own_gel().summary
    'A gel with dots of your own in front of any camera: measure the lines that end in <- .'

    >>> sensors.preset("anyskin").sources
    'arXiv 2409.08276; raunaqbhirangi/anyskin on GitHub (five magnetometers: one in the middle, four around it)'

    >>> sensors.preset("gelslim").unknown["youngs_modulus"]
    'palpate weigh: one known weight tells it'

    >>> "410 kPa +- 4 %" in sensors.gelsight_mini().changed(youngs_modulus="410 kPa +- 4 %").text
    True
    """

    name: str
    text: str

    @property
    def summary(self) -> str:
        """What the sensor is, in one line."""
        return self.text.splitlines()[0].lstrip("# ").strip()

    @property
    def sources(self) -> str:
        """Where the numbers come from, in one line; "" if all of them are the user's."""
        found = re.search(r"^# Sources: (.*)$", self.text, re.MULTILINE)
        return "" if found is None else found[1]

    @property
    def unknown(self) -> dict[str, str]:
        """Unpublished values by their key in the file, each with how to measure it."""
        return dict(re.findall(r'^(\w+) = "unknown"\s*# <- (.*)$', self.text, re.MULTILINE))

    def write(self, path: str | Path) -> Path:
        """Write the skin.toml. Return its path, for `palpate.camera.follow` and `Skin.from_file`.

        Raises
        ------
        InvalidInput
            A file that exists: it may hold what was measured.

        Examples
        --------
        >>> import tempfile
        >>> from palpate import sensors
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = sensors.own_gel(thickness="3 mm").write(f"{folder}/gel.toml")
        ...     'thickness = "3 mm"' in path.read_text()
        True
        """
        from palpate.recordings.files import atomically

        target = Path(path)
        if target.exists():
            raise InvalidInput(f"{target} exists, and may hold what was measured; give another name.")
        atomically(target, lambda name: _fill(name, self.text))
        return target

    def changed(self, **numbers: str) -> Preset:
        """Return the preset with other numbers, by their keys in the file; lengths and moduli are text with a unit,
        and optionally an uncertainty.

        Raises
        ------
        InvalidInput
            A key that the file does not have.
        """
        text = self.text
        for key, value in numbers.items():
            found = re.compile(rf'^(# )?({re.escape(key)} = )("[^"]*"|[^\s#"]+)([^\n]*)$', re.MULTILINE)
            if len(found.findall(text)) != 1:
                keys = dict.fromkeys(re.findall(r"^(?:# )?(\w+) = ", text, re.MULTILINE))
                raise InvalidInput(f"{self.name} has no number {key!r}; it has {', '.join(keys)}.")
            said = (
                f'"{value}"'
                if isinstance(value, str)
                else str(value).lower()
                if isinstance(value, bool)
                else str(value)
            )
            line = found.search(text)
            if line is not None:
                text = f"{text[: line.start()]}{line[2]}{said}  # as given{text[line.end() :]}"
        return replace(self, text=text)


def _fill(name: str, text: str) -> None:
    Path(name).write_text(text, encoding="utf-8")


def preset(name: str) -> Preset:
    """Return a preset by its name.

    Raises
    ------
    InvalidInput
        No such preset.

    Examples
    --------
    >>> from palpate import sensors
    >>> sensors.preset("gelsight_mini").name
    'gelsight_mini'
    """
    if name not in _NAMES:
        raise InvalidInput(
            f"no sensor {name!r}; there are {', '.join(_NAMES)}. Another is described in a skin.toml of its own."
        )
    return Preset(name, resources.files(__package__).joinpath(f"{name}.toml").read_text(encoding="utf-8"))


def presets() -> dict[str, Preset]:
    """Return all presets by name.

    Examples
    --------
    >>> from palpate import sensors
    >>> list(sensors.presets())
    ['gelsight_mini', 'digit', 'digit360', 'nine_dtact', 'densetact', 'gelslim', 'uskin', 'reskin', 'anyskin', 'own_gel']
    """
    return {name: preset(name) for name in _NAMES}


def gelsight_mini(**numbers: str) -> Preset:
    """GelSight Mini with printed dots; ``numbers`` as for `Preset.changed`.

    Examples
    --------
    >>> from palpate import sensors
    >>> sensors.gelsight_mini(youngs_modulus="350 kPa +- 5 %").name
    'gelsight_mini'
    """
    return preset("gelsight_mini").changed(**numbers)


def digit(**numbers: str) -> Preset:
    """DIGIT with dots of one's own on its gel; ``numbers`` as for `Preset.changed`.

    Its gel's thickness and stiffness are not published, and it is sold without dots: these numbers say "unknown", and a reader refuses the file until they
    are given. `palpate.camera.weigh` takes an unknown modulus, and finds it.

    Examples
    --------
    >>> from palpate import sensors
    >>> gel = sensors.digit(thickness="2.4 mm +- 5 %", depth="0.5 mm", pitch="1.5 mm")
    >>> gel.text.count('= "unknown"')  # the modulus, for palpate weigh
    1
    """
    return preset("digit").changed(**numbers)


def own_gel(**numbers: str) -> Preset:
    """A template for a gel with dots of one's own; ``numbers`` as for `Preset.changed`.

    Examples
    --------
    >>> from palpate import sensors
    >>> sensors.own_gel(thickness="2.8 mm", pitch="1.5 mm").name
    'own_gel'
    """
    return preset("own_gel").changed(**numbers)
