"""Keep secrets of a command line out of files."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

__all__ = ["PLACEHOLDER", "without_secrets", "without_secrets_in_meta"]

#: Options whose values are secrets.
SECRET = ("--token",)
#: What replaces them in a file.
PLACEHOLDER = "HIDDEN"


def without_secrets(arguments: Sequence[str]) -> list[str]:
    """Arguments of a command line with `PLACEHOLDER` in place of each secret.

    Examples
    --------
    >>> without_secrets(["palpate", "live", "--token", "S3CRET", "--demo"])
    ['palpate', 'live', '--token', 'HIDDEN', '--demo']

    >>> without_secrets(["palpate", "live", "--token=S3CRET"])
    ['palpate', 'live', '--token=HIDDEN']
    """
    found: list[str] = []
    hide_next = False
    for argument in arguments:
        option, equals, _ = argument.partition("=")
        if hide_next:
            found.append(PLACEHOLDER)
        elif option in SECRET and equals:
            found.append(f"{option}={PLACEHOLDER}")
        else:
            found.append(argument)
        hide_next = not hide_next and argument in SECRET
    return found


def without_secrets_in_meta(meta: Mapping[str, str]) -> dict[str, str]:
    """Hide secrets in the command lines in ``meta``, as older versions of palpate wrote them; other entries stay
    unchanged.

    Examples
    --------
    >>> without_secrets_in_meta({"command": "palpate live --demo --token S3CRET", "operator": "A. B."})
    {'command': 'palpate live --demo --token HIDDEN', 'operator': 'A. B.'}
    """
    return {key: _redacted(value) if isinstance(value, str) else value for key, value in meta.items()}


def _redacted(text: str) -> str:
    if not any(option in text for option in SECRET):
        return text
    try:
        arguments = shlex.split(text)
    except ValueError:  # an unclosed quote: the rest after the option may all be secret
        first = min(text.index(option) + len(option) for option in SECRET if option in text)
        return f"{text[:first]} {PLACEHOLDER}"
    hidden = without_secrets(arguments)
    return text if hidden == arguments else shlex.join(hidden)
