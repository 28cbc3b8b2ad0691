"""The tables of the report and of the documentation, as rows of text: made once, written as HTML, Markdown or CSV."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from palpate.paper import studies
from palpate.paper.findings import Claim, claims
from palpate.paper.formulas import EQUATIONS
from palpate.paper.pictures import PaperFigure
from palpate.paper.studies import Row

__all__ = ["Results", "formula_rows", "results", "to_csv", "to_html", "to_markdown"]

_CASES = {"cylinder": "cylinder", "punch": "rectangle"}


@dataclass(frozen=True)
class Results:
    """Every table of the reproduction, as numbers."""

    errors: list[Row]
    friction: list[Row]
    friction_readings: list[Row]
    profile_readings: list[Row]
    noise: list[Row]
    truncation: list[Row]
    speed: list[Row]
    claims: list[Claim] = field(default_factory=list)

    def text(self, name: str, *, code: tuple[str, str] = ("`", "`")) -> list[dict[str, str]]:
        """One table as text, its columns named for a reader; ``code`` goes round names of functions."""
        if name == "formulas":
            return formula_rows(code)
        if name == "claims":
            return [
                {"section": c.where, "the paper says": c.says, "we find": c.finds, "holds": c.holds}
                for c in self.claims
            ]
        return [{k: _cell(k, v) for k, v in row.items()} for row in getattr(self, name)]

    def tables(self) -> dict[str, list[Row]]:
        """The tables of numbers, by the name of their file."""
        return {
            "errors": self.errors,
            "friction": self.friction,
            "friction-readings": self.friction_readings,
            "profile-readings": self.profile_readings,
            "noise": self.noise,
            "truncation": self.truncation,
            "speed": self.speed,
            "claims": [vars(c) for c in self.claims],
        }


def results() -> Results:
    """Compute everything."""
    errors, friction = studies.error_table(), studies.friction_table()
    noise, truncation, speed = studies.noise_study(), studies.truncation_study(), studies.speed_study()
    return Results(
        errors=errors,
        friction=friction,
        friction_readings=studies.friction_readings(),
        profile_readings=studies.profile_readings(),
        noise=noise,
        truncation=truncation,
        speed=speed,
        claims=claims(errors=errors, friction=friction, noise=noise, truncation=truncation, speed=speed),
    )


def formula_rows(code: tuple[str, str] = ("`", "`")) -> list[dict[str, str]]:
    """Every equation with the function that computes it."""
    return [
        {
            "equation": e.number,
            "content": e.content,
            "computed by": ", ".join(code[0] + f + code[1] for f in e.functions),
        }
        for e in EQUATIONS
    ]


def figure_rows(drawn: Sequence[PaperFigure]) -> list[dict[str, str]]:
    """The figures' numbers and captions."""
    return [{"figure": str(f.number), "content": f.caption} for f in drawn]


def _cell(column: str, value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        text = str(value)
        return {"stress_zz": "stress", "strain_zz": "strain"}.get(text, _CASES.get(text, text))
    if isinstance(value, int):
        return f"{value:+d}" if column == "M too wide by" and value else str(value)
    if column == "linear system" and value < 1e-13:
        return "< 1e-13"
    if value == 0.0:
        return "0"
    return f"{value:.2e}" if abs(value) < 1e-2 else f"{value:.3g}"


def to_markdown(rows: Sequence[dict[str, str]]) -> str:
    """A table in Markdown."""
    head = list(rows[0])
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(v.replace("|", "\\|") for v in row.values()) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def to_html(rows: Sequence[dict[str, str]], *, raw: Sequence[str] = ()) -> str:
    """A table in HTML; columns in ``raw`` are HTML already."""
    head = "".join(f"<th>{html.escape(k)}</th>" for k in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{v if k in raw else html.escape(v)}</td>" for k, v in row.items()) + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def to_csv(rows: Sequence[dict[str, Any]]) -> str:
    """A table as CSV text."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()
