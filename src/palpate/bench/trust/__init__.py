"""How often is it wrong without a word? Violations x sensors x contacts, and what the library says of each frame."""

from palpate.bench.trust.judge import Verdict, judge, verdict
from palpate.bench.trust.rows import ROWS, Frame, make_frame
from palpate.bench.trust.table import HEADER, Line, by_sensor, cases, cells, lines, markdown, sentence, trust

__all__ = [
    "HEADER",
    "ROWS",
    "Frame",
    "Line",
    "Verdict",
    "by_sensor",
    "cases",
    "cells",
    "judge",
    "lines",
    "make_frame",
    "markdown",
    "sentence",
    "trust",
    "verdict",
]
