"""Every note: what results, commands, sessions and warnings say without refusing, whether it tells to do something, and whether that was tried.

    python benchmarks/messages.py           the tables of messages and of notes

Notes are read off the source: what is put into a list, tuple or return that carries notes, what is warned of, what a session, listener or command says
while it runs, and the entries of `palpate.Status`. tests/remedies/notes.py brings them about through the public surface, follows what they advise on the
same readings, and looks that the note is gone or the answer right.
"""

from __future__ import annotations

import ast
import functools
import re
import sys
from collections.abc import Iterator
from typing import Any

import messages

#: Lists that carry notes to the user.
LISTS = frozenset({"notes", "said", "_said", "remarks", "remark", "_assumptions", "doubts"})
#: Functions that return notes.
RETURNS = frozenset(
    {
        "notes",
        "unfinished",
        "at_their_end",
        "restarted",
        "remarks",
        "assumptions",
        "notes_of",
        "_said",
        "_doubts",
        "doubts",
        "_misplaced",
        "_note",
        "calibration_note",
        "saturation_notes",
        "_notes",
        "_notes_of",
        "look",
        "one_taxel",
    }
)
#: Calls that say something at once: methods of sessions and listeners, warnings, and the shell's way to say things beside its answer.
CALLS = frozenset({"note", "report", "_report", "_report_text", "_say", "warn", "_warn"})
#: Modules whose notes lie in a list of another name; and names that are used there for what a message says.
ALSO = {"inverse.words": "found"}
#: Rooms of which `words` and such return something else.
NOT = (("bench.", ""), ("trust.", ""), ("cli.methods", ""), ("inverse.registry", ""), ("sensors.", ""))
#: Rooms in which a text that is named like a list is a note.
SINGLE = ("microscopy.fields",)
#: What a note offers who reads it.
CLASSES = {
    "advises": "tells the user to do something",
    "doubts": "asks whether something is wrong, and leaves what to do to the user",
    "tells": "says what was assumed, found or done",
    "elsewhere": "what it tells of is not to be had in a test; the last column says why",
}
#: Notes that are held in a constant.
NAMED = {
    "sensing.zero": ("MOVED", "OFFSETS", "STANDS"),
    "tracking.settings": ("MISREAD",),
    "microscopy.readers": ("_SCATTERED",),
    "camera.pictures": ("DAMAGED",),
}
#: Notes that are said in place of others, from a dictionary.
MAPS = {"microscopy.doubts": ("REMEDIES",)}
#: Words of an advice that notes have besides those of messages.
ADVICE = (
    messages.ADVICE
    + r"|\b(?:give|say) \w+=|make them the zero|\((?:give|up=)|rezero\(\)|resume goes on|\) helps?;|seek it as well|must touch|palpate reconstruct|allow more|helps; |Compare it|then end the"
    + r"|uncertainty=Uncertainty"
)
DOUBT = r"\?|may be wrong|cannot be separated|do not separate|is uncertain|misreads|or a broken"
_CAMERA, _ROS = "needs a camera that is unplugged", "needs ROS 2 running"
#: Notes that no test can bring about: room, words, and why.
ELSEWHERE: tuple[tuple[str, str, str], ...] = (
    ("camera.pictures", "gives no pictures any more", _CAMERA),
    ("cli.ros", "", _ROS),
    ("inverse.words", "these channels alone do not separate pressure", "needs channels that were not measured"),
    ("status", "the arithmetic broke down", "no frame is known that brings it about"),
    (
        "touch.outcome",
        "the net force is uncertain",
        "the readings hold no more: needs more taxels, or less noise",
    ),
    ("ros.node", "", _ROS),
)
#: What the walk does not find, in words for the page.
NOT_FOUND = (
    "sentences of hardly any words of their own, such as `{}: {} {} (+- {})` for an offset that was found (`palpate.touch.outcome`)",
    "what is filled into a note, such as `; the linear method was used`: the note stands in the table with {} in its place",
    "events of a grasp (contact, incipient slip, pull, ...): made of their kind and numbers by `palpate.grasp.Event`",
    "why a taxel is left out (`Tracker.health.reasons`) and what is wrong with a picture (`Displacements.faults`): words that are kept beside numbers, without a list of notes",
    "errors of the library that a command passes on as a warning (a sink that failed, a file that ends early): they are messages, of the first table",
    "notes of methods and formats of other packages",
    "what the page and the plots draw: labels, legends and the texts of the page's own script",
)


def _strings(node: ast.expr | None) -> Iterator[str]:
    """The texts that an expression can put into a list: of its elements, both ways of a condition, the parts of a sum of lists."""
    if node is None:
        return
    text = messages._text(node)
    if text is not None:
        yield text
        return
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        yield from _strings(node.left)
        yield from _strings(node.right)
    elif isinstance(node, ast.List | ast.Tuple | ast.Set):
        for one in node.elts:
            yield from _strings(one)
    elif isinstance(node, ast.Starred | ast.NamedExpr):
        yield from _strings(node.value)
    elif isinstance(node, ast.IfExp):
        yield from _strings(node.body)
        yield from _strings(node.orelse)
    elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("tuple", "list") and node.args:
        yield from _strings(node.args[0])


def _name(node: ast.expr) -> str:
    return getattr(node, "id", getattr(node, "attr", ""))


def _constants(tree: ast.Module) -> dict[str, str]:
    """Texts that a module holds in capitals."""
    found = {}
    for node in tree.body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            text = messages._text(node.value)
            if text is not None and node.targets[0].id.strip("_").isupper():
                found[node.targets[0].id] = text
    return found


def _status(tree: ast.Module) -> Iterator[str]:
    """Meaning and remedy of each status, as results say them behind its label."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and node.name == "Status":
            for entry in node.body:
                if isinstance(entry, ast.Assign) and isinstance(entry.value, ast.Tuple):
                    words = [
                        e.value for e in entry.value.elts if isinstance(e, ast.Constant) and isinstance(e.value, str)
                    ]
                    yield "; ".join(words[1:])


def _returned(function: ast.AST) -> Iterator[ast.expr | None]:
    """What a function returns; those within it are functions of their own."""
    for node in ast.iter_child_nodes(function):
        if isinstance(node, ast.Return):
            yield node.value
        elif not isinstance(node, ast.FunctionDef | ast.Lambda):
            yield from _returned(node)


def _of(node: ast.AST, lists: frozenset[str], room: str) -> Iterator[str]:
    """What one node of the source says."""
    given: list[ast.expr | None] = []
    if isinstance(node, ast.Call):
        name = _name(node.func)
        if (
            (name in ("append", "extend") and isinstance(node.func, ast.Attribute) and _name(node.func.value) in lists)
            or name in CALLS
            or (name == "echo" and any(k.arg == "err" for k in node.keywords))
        ):
            given += node.args[:1]
        given += [k.value for k in node.keywords if k.arg in ("notes", "said", "remarks")]
    elif isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        held = node.value
        # a text alone is a note only where another line puts it into the list
        if any(_name(t) in lists for t in targets) and (room in SINGLE or held is None or messages._text(held) is None):
            given.append(held)
    elif isinstance(node, ast.FunctionDef) and node.name in RETURNS:
        given += _returned(node)
    for one in given:
        yield from _strings(one)


def _values(tree: ast.Module, name: str) -> Iterator[str]:
    """The values of a dictionary of texts."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and _name(node.targets[0]) == name and isinstance(node.value, ast.Dict):
            yield from (t for v in node.value.values if (t := messages._text(v)) is not None)


@functools.cache
def notes() -> tuple[messages.Message, ...]:
    """Those of all modules, in their order."""
    seen, found = set(), []
    trees = {}
    for path in sorted(messages.SOURCE.rglob("*.py")):
        room = ".".join(path.relative_to(messages.SOURCE).with_suffix("").parts)
        if not any(room.startswith(r) for r, _ in NOT):
            trees[room] = ast.parse(path.read_text(encoding="utf-8"))
    for room, tree in trees.items():
        lists = LISTS | ({ALSO[room]} if room in ALSO else set())
        held = _constants(tree)
        texts: list[str] = list(_status(tree)) if room == "status" else []
        for node in ast.walk(tree):
            texts += _of(node, lists, room)
        texts += [t for name in MAPS.get(room, ()) for t in _values(tree, name)]
        texts += [held[name] for name in NAMED.get(room, ()) if name in held]
        for text in texts:
            text = " ".join(text.split()).strip()
            if text.startswith("("):  # a part of a message
                continue
            if len(text.replace("{}", "").strip()) >= messages.ENOUGH and (room, text) not in seen:
                seen.add((room, text))
                found.append(messages.Message(room, "note", text))
    return tuple(found)


def cases() -> list[Any]:
    """What the tests try, from tests/remedies/notes.py; empty where its packages are not installed."""
    if str(messages.TESTS) not in sys.path:
        sys.path.insert(0, str(messages.TESTS))
    from remedies.notes import NOTES

    return list(NOTES)


def meant(case: Any) -> list[tuple[str, str]]:
    """The notes (room, text) that a case of the tests stands for: one, where its words are enough."""
    pieces = ".*".join(re.escape(piece) for piece in case.words.split("{}"))
    return [n.key for n in notes() if case.room in ("", n.where) and re.search(pieces, n.text)]


def kind_of(note: messages.Message) -> str:
    """Which of `CLASSES` a note is of."""
    if reason(note):
        return "elsewhere"
    if re.search(ADVICE, note.text, re.IGNORECASE):
        return "advises"
    return "doubts" if re.search(DOUBT, note.text) else "tells"


def reason(note: messages.Message) -> str:
    """Why a note cannot be brought about in a test; "" where it can."""
    return next((why for room, words, why in ELSEWHERE if room == note.where and words in note.text), "")


def table() -> str:
    """The second part of the page."""
    tests, known = messages.quoted(), {key for case in cases() for key in meant(case)}
    rows = [(n, kind_of(n), n.key in known) for n in notes()]
    lines = [
        "",
        "**Every note**",
        "",
        "What palpate says without refusing: notes of results, remarks of long runs, warnings, the events of a live view, and what a status means. An advice counts as tried "
        "where a test brings the note about, does what it says with the same readings, and finds the note gone or the answer right (`tests/remedies/notes.py`).",
        "",
        f"{len(rows)} notes that results, commands, warnings and live views say without refusing; what {sum(r for *_, r in rows)} of them lead to was done in a "
        "test, on the very readings, and the note was gone or the answer right.",
        "",
        "|class | notes | advice tried | left |",
        "|---|---|---|---|",
    ]
    for name, words in CLASSES.items():
        mine = [r for _, k, r in rows if k == name]
        lines.append(f"|{name}: {words} | {len(mine)} | {sum(mine)} | {len(mine) - sum(mine)} |")
    lines += ["", "|note | where | class | quoted by a test | advice tried |", "|---|---|---|---|---|"]
    for n, k, r in rows:
        answer = "yes" if r else (reason(n) and f"no: {reason(n)}") or ("-" if k == "tells" else "no")
        quoted = "yes" if r or messages.held(n, tests) else "no"
        lines.append(f"|{messages.escaped(n.text)} | {n.where} | {k} | {quoted} | {answer} |")
    lines += ["", "What the walk over the source does not find:", "", *(f"- {one}" for one in NOT_FOUND)]
    return "\n".join(lines) + "\n"
