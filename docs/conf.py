"""Sphinx configuration."""

import palpate

project = "palpate"
author = "the palpate developers"
copyright = "2026, the palpate developers"
release = version = palpate.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "_generated"]
html_theme = "furo"
html_title = "palpate"
html_static_path = ["_static"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing", "ref.python"]

autodoc_typehints = "description"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = False
napoleon_use_rtype = False
default_role = "code"
nitpicky = False


def _escape(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text: shapes such as (*batch, x) and |k| are not markup. Examples are left as they are."""
    example = False
    for i, line in enumerate(lines):
        example = line.lstrip().startswith(">>>") or (example and bool(line.strip()))
        if example:
            continue
        parts = line.split("`")
        parts[::2] = [p.replace("*", r"\*").replace("|", r"\|") for p in parts[::2]]
        lines[i] = "`".join(parts)


def setup(app: object) -> None:
    """Escape docstrings before napoleon reads them."""
    app.connect("autodoc-process-docstring", _escape, priority=400)  # type: ignore[attr-defined]
