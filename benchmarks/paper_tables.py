"""Writes the tables of docs/paper.md: every number there is made here.

python benchmarks/paper_tables.py [docs/paper.md]
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from palpate import paper
from palpate.paper import tables


def main(page: Path) -> None:
    found = tables.results()
    rows = {"figures": tables.figure_rows(paper.figures())}

    def table(match: re.Match[str]) -> str:
        name = match[1]
        content = rows[name] if name in rows else found.text(name)
        return f"<!-- table {name} -->\n{tables.to_markdown(content)}<!-- end -->"

    text, count = re.subn(r"<!-- table (\w+) -->\n(?:.*?)<!-- end -->", table, page.read_text(), flags=re.DOTALL)
    page.write_text(text)
    print(f"{count} tables written into {page}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "paper.md")
