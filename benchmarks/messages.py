"""Every message that a user may be refused with: where it is raised, whether it says what it got, and whether a test tried its remedy.

    python benchmarks/messages.py           the table
    python benchmarks/messages.py --write   into docs/_generated/messages.md

Messages are read off the source. A test holds a message where it quotes twelve letters or more of it; a remedy was tried where tests/remedies.py has the
message with a call that is refused and the call that its words lead to.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TESTS, TABLE = ROOT / "src" / "palpate", ROOT / "tests", ROOT / "docs" / "_generated" / "messages.md"
#: The exceptions that carry a message to the user.
KINDS = ("InvalidInput", "Unsupported", "NotObservable", "UncheckedInput", "PalpateError")
#: Letters, with a blank among them, that a test must quote of a message to count as holding it.
ENOUGH = 12


@dataclass(frozen=True)
class Message:
    """One sentence of the source: its constant parts, with {} for what is filled in."""

    where: str
    kind: str
    text: str

    @property
    def parts(self) -> list[str]:
        """What is constant in it."""
        return self.text.split("{}")

    @property
    def says_what_it_got(self) -> bool:
        return "{}" in self.text


def _text(node: ast.expr) -> str | None:
    """The words of an expression, {} for what it fills in; None where it is made elsewhere."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(v.value if isinstance(v, ast.Constant) else "{}" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        both = _text(node.left), _text(node.right)
        return None if both == (None, None) else "".join(part if part is not None else "{}" for part in both)
    return None


def messages() -> Iterator[Message]:
    """Those of all modules, in their order."""
    for path in sorted(SOURCE.rglob("*.py")):
        if path.parent.name in ("bench", "trust"):  # measurements of ours, no front door
            continue
        room = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        for outer in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(outer, ast.Raise) or not isinstance(outer.exc, ast.Call):
                continue
            kind = getattr(outer.exc.func, "id", getattr(outer.exc.func, "attr", ""))
            if kind in KINDS and outer.exc.args:
                text = _text(outer.exc.args[0])
                if text is not None and len(text.replace("{}", "").strip()) >= ENOUGH:
                    yield Message(room, kind, " ".join(text.split()))


def quoted() -> list[str]:
    """The pieces of strings of all tests that are long enough, between what a pattern leaves open."""
    found = set()
    for path in sorted(TESTS.glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) >= ENOUGH:
                pieces = re.split(r"\.[*+]\??|\n", node.value.replace("\\", ""))
                found |= {piece.strip() for piece in pieces if len(piece.strip()) >= ENOUGH and " " in piece.strip()}
    return sorted(found)


def tried() -> list[tuple[str, str]]:
    """Words and room of the messages whose remedy tests/remedies.py tries."""
    tree = ast.parse((TESTS / "remedies.py").read_text(encoding="utf-8"))
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and getattr(n.func, "id", "") == "Remedy"]
    found = []
    for call in calls:
        room = [k.value.value for k in call.keywords if k.arg == "room" and isinstance(k.value, ast.Constant)]
        if isinstance(call.args[0], ast.Constant):
            found.append((str(call.args[0].value), str(room[0]) if room else ""))
    return found


def held(message: Message, tests: list[str]) -> bool:
    """Whether a test quotes a piece of the message."""
    return any(piece in part for part in message.parts for piece in tests)


def table() -> str:
    """The page."""
    tests, known = quoted(), tried()
    rows = []
    for m in messages():
        remedy = any(words in m.text and room in ("", m.where) for words, room in known)
        rows.append((m, held(m, tests) or remedy, remedy))
    lines = [
        f"{len(rows)} messages; {sum(m.says_what_it_got for m, _, _ in rows)} say what was received; a test quotes {sum(h for _, h, _ in rows)}; "
        f"the remedy of {sum(r for _, _, r in rows)} was tried on the very input that was refused. {{}} is what is filled in.",
        "",
        "| message | where | says what it got | quoted by a test | remedy tried |",
        "|---|---|---|---|---|",
    ]
    for m, h, r in rows:
        text = re.sub(r"([|<>*_`\[\]$])", r"\\\1", m.text)
        lines.append(
            f"| {text} | {m.where} | {'yes' if m.says_what_it_got else 'no'} | {'yes' if h else 'no'} | {'yes' if r else 'no'} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        TABLE.write_text(table(), encoding="utf-8")
    else:
        sys.stdout.write(table())
