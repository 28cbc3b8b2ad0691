"""Every message that a user may be refused with: where it is raised, whether it says what it got, and whether a test tried its remedy.

    python benchmarks/messages.py           the table, and that of notes (benchmarks/notes.py)
    python benchmarks/messages.py --write   into docs/_generated/messages.md

Messages are read off the source. A test holds a message where it quotes twelve letters or more of it; a remedy was tried where tests/remedies has the
message with a call that is refused and the call that its words lead to.
"""

from __future__ import annotations

import argparse
import ast
import functools
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TESTS, TABLE = ROOT / "src" / "palpate", ROOT / "tests", ROOT / "docs" / "_generated" / "messages.md"
#: The exceptions that carry a message to the user.
KINDS = ("InvalidInput", "Unsupported", "TooLarge", "NotObservable", "UncheckedInput", "PalpateError")
#: Letters, with a blank among them, that a test must quote of a message to count as holding it.
ENOUGH = 12
#: What a message offers who meets it.
CLASSES = {
    "advises": "says what to do",
    "accepts": "says what is accepted; giving that is the remedy",
    "states": "says only what is wrong",
    "damage": "says that a file is damaged or of another kind, or that a disk failed: another copy or another disk helps",
    "inner": "said by a layer beneath; on every way that is public another message comes first",
    "elsewhere": "what it asks for is not to be had in a test; the last column says why",
}
#: Words with which an advice begins, behind a stop or a conjunction.
_VERBS = (
    "add|ask|average|begin|beginning|build|call|check|choose|close|correct|count|define|describe|draw|drop|enter|expose|export|film|find|focus|follow|"
    "give|grid|hold|import|install|join|keep|leave|let|light|list|look|make|mark|measure|mend|move|name|open|pass|pick|prepare|press|put|read|record|"
    "rename|repair|run|save|say|see|seek|send|set|shift|show|solve|source|start|state|take|tell|track|try|turn|uninstall|unpack|update|use|wait|write"
)
ADVICE = rf"(?:^|[.:;,(]\s|\bor |\band |\bthen |\bplease )(?:{_VERBS})\b(?! of\b)|\bare? (?:you|they) |is \w+ meant|Is it |looks? |--\w+ takes? what|palpate \w+ writes one"
#: Words with which a message says what is accepted.
ACCEPTS = r"\bmust\b|accepted|there (?:are|is)|\bit has\b|\bneed|\btakes?\b|\bat least\b|\bbelongs?\b|\bsuch as\b|\blike\b|sought are|\bfrom 0 to\b"
#: Words of a file that is damaged, or of a disk that failed.
DAMAGE = r"damaged|truncated|checksum|cannot be read as|cannot write there|writing failed|cannot make the folder|cannot be opened as|not a palpate (?:recording|packet)|whole palpate result|NUL characters"
_CLUSTER, _PACKAGE, _MACHINE = (
    "needs a Dask cluster",
    "needs another package that is broken",
    "needs a machine without memory",
)
_ROS, _PORT, _BENCH = (
    "needs ROS 2 running",
    "needs what listens there to leave",
    "runs for minutes; the check alone is quick, and what follows is the long tests'",
)
#: Messages whose remedy a test cannot carry out: room, words, and why.
ELSEWHERE: tuple[tuple[str, str, str], ...] = (
    ("_memory", "of memory, and", _MACHINE),
    ("archives.pools", "knows its own workers", _CLUSTER),
    ("archives.pools", "has no workers: start some", _CLUSTER),
    ("archives.pools", "no Dask scheduler answers", _CLUSTER),
    ("archives.pools", "were stopped by the system", _MACHINE),
    ("archives.pools", "lost one worker after another", _CLUSTER),
    ("archives.pools", "is gone", _CLUSTER),
    ("archives.work", "install the same version on both", _CLUSTER),
    ("camera.pictures", "camera {}: cannot be opened", "needs a camera"),
    ("camera.pictures", "no codec for this video is installed", "needs a build of FFmpeg without the codec"),
    (
        "camera.weighing",
        "no pressing force is found",
        "contact is taken to push: no pictures are known that come to it",
    ),
    ("cli.bench", "", _BENCH),
    ("cli.paper", "", _BENCH),
    ("cli.ros", "", _ROS),
    ("lerobot", "convert it by LeRobot's own", "needs LeRobot's own converter"),
    ("live.foxglove", "cannot listen on", _PORT),
    ("live.foxglove", "sending {} failed", "needs a viewer that goes away"),
    ("live.rerun", "", "needs the package rerun-sdk and its viewer"),
    ("live.server", "cannot listen on", _PORT),
    ("microscopy.blobs", "not the same in all directions", "needs an anisotropic pad of another package"),
    ("network.listener", "cannot listen on", _PORT),
    ("network.frames", "big-endian", "needs a driver on a big-endian machine"),
    ("recordings.files", "it is read-only", "needs a user who may not write: tests may run as one who may write all"),
    ("cli.files", "Permission denied", "needs a user who may not write: tests may run as one who may write all"),
    ("recordings.formats", "does not derive from Format", _PACKAGE),
    ("recordings.formats", "of another package cannot be loaded", _PACKAGE),
    ("recordings.formats", "both claim", _PACKAGE),
    ("recordings.skinfile", "does not take these keys", _PACKAGE),
    ("recordings.prepared", "was written by palpate", "needs another version of palpate"),
    ("_recall", "its form is", "needs another version of palpate"),
    ("ros.client", "Source the workspace it was built in", _ROS),
    ("ros.node", "", _ROS),
    ("sensing.quadrature", "", "needs a pad of another package that breaks its own promises"),
)
#: Messages before which another comes on every way that is public: room and words.
INNER = (
    ("elastic.viscoelastic", "time must increase from frame to frame"),
    ("inverse.linear.parameter", "parameter must be a positive number or one of"),
    ("inverse.linear.parameter", "is not defined for truncation"),
    ("inverse.linear.posterior", "samples of the posterior are drawn"),
    ("inverse.paper.constant_friction", "friction must be a finite number other than 0"),
    ("inverse.paper.grid", "ask for fewer with components"),
    ("recordings.mapped", "there are no positions"),
    ("archives.run", "there are no frames"),
    ("calibrate.process", "that no map can be fitted to"),
    ("calibrate.report", "has no map of a force to draw"),
    ("cli.calibrate", "nothing was calibrated"),
    ("design.files", "must be a section ["),
    ("microscopy.adhesions", "one frame was sampled"),
    ("camera.render", "a scene has an area for its surface"),
    ("cli.options", "watch the pressure, but these channels measure only"),
    ("microscopy.pictures", "holds no picture"),
    ("recordings.formats", "cannot be continued after an interruption"),
    ("recordings.touchstream", "are not there"),
    ("recordings.touchstream", "results of different skins cannot be written"),
    ("recordings.touchstream", "results of different kinds cannot be written"),
    ("sensing.operator", 'methods "dft" and "linear" need a regular array'),
    ("sensing.operator", "not commensurate with the surface grid"),
)


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
    def key(self) -> tuple[str, str]:
        """Room and words: one message, from however many lines it is raised."""
        return self.where, self.text

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


@functools.cache
def messages() -> tuple[Message, ...]:
    """Those of all modules, in their order."""
    return tuple(_messages())


def _messages() -> Iterator[Message]:
    """What several lines of a module raise alike is one."""
    seen = set()
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
                    found = Message(room, kind, " ".join(text.split()))
                    if found.key not in seen:
                        seen.add(found.key)
                        yield found


def quoted() -> list[str]:
    """The pieces of strings of all tests that are long enough, between what a pattern leaves open."""
    found = set()
    for path in sorted(TESTS.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) >= ENOUGH:
                pieces = re.split(r"\.[*+]\??|\n", node.value.replace("\\", ""))
                found |= {piece.strip() for piece in pieces if len(piece.strip()) >= ENOUGH and " " in piece.strip()}
    return sorted(found)


def remedies() -> list[Any]:
    """Those that the tests try, from tests/remedies."""
    if str(TESTS) not in sys.path:
        sys.path.insert(0, str(TESTS))
    from remedies import REMEDIES

    return list(REMEDIES)


def meant(remedy: Any) -> list[tuple[str, str]]:
    """The messages (room, text) that a remedy of the tests stands for: one, where its words are enough."""
    here = [m for m in messages() if remedy.words in m.text and remedy.room in ("", m.where)]
    return [m.key for m in here if m.text == remedy.words] or [m.key for m in here]


def held(message: Message, tests: list[str]) -> bool:
    """Whether a test quotes a piece of the message."""
    return any(piece in part for part in message.parts for piece in tests)


def kind_of(message: Message) -> str:
    """Which of `CLASSES` a message is of."""
    if reason(message):
        return "elsewhere"
    if any(room == message.where and words in message.text for room, words in INNER):
        return "inner"
    if re.search(DAMAGE, message.text):
        return "damage"
    if re.search(ADVICE, message.text, re.IGNORECASE):
        return "advises"
    return "accepts" if re.search(ACCEPTS, message.text) else "states"


def reason(message: Message) -> str:
    """Why its remedy cannot be tried in a test; "" where it can."""
    return next((why for room, words, why in ELSEWHERE if room == message.where and words in message.text), "")


def escaped(text: str) -> str:
    """As Markdown shows it in a table."""
    return re.sub(r"([|<>*_`\[\]$])", r"\\\1", text)


def table() -> str:
    """The page."""
    tests, known = quoted(), {key for remedy in remedies() for key in meant(remedy)}
    rows = []
    for m in messages():
        remedy = m.key in known
        rows.append((m, kind_of(m), held(m, tests) or remedy, remedy))
    lines = [
        f"{len(rows)} messages; {sum(m.says_what_it_got for m, *_ in rows)} say what was received; a test quotes {sum(h for *_, h, _ in rows)}; "
        f"the remedy of {sum(r for *_, r in rows)} was tried on the very input that was refused. {{}} is what is filled in.",
        "",
        "| class | messages | remedy tried | left |",
        "|---|---|---|---|",
    ]
    for name, words in CLASSES.items():
        mine = [r for _, k, _, r in rows if k == name]
        lines.append(f"| {name}: {words} | {len(mine)} | {sum(mine)} | {len(mine) - sum(mine)} |")
    lines += [
        "",
        "| message | where | class | says what it got | quoted by a test | remedy tried |",
        "|---|---|---|---|---|---|",
    ]
    for m, k, h, r in rows:
        text = escaped(m.text)
        answer = "no: another message comes first" if k == "inner" else reason(m) and f"no: {reason(m)}"
        lines.append(
            f"| {text} | {m.where} | {k} | {'yes' if m.says_what_it_got else 'no'} | {'yes' if h else 'no'} | {'yes' if r else answer or 'no'} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.modules["messages"] = sys.modules[__name__]
    import notes

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the table into the documentation")
    if parser.parse_args().write:
        TABLE.write_text(table() + notes.table(), encoding="utf-8")
    else:
        sys.stdout.write(table() + notes.table())
