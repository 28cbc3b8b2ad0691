"""Sphinx configuration. Nothing is downloaded, unless PALPATE_DOCS_NETWORK=1 asks for the inventories of other projects."""

from __future__ import annotations

import importlib
import inspect
import os
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.pycode import ModuleAnalyzer
from sphinx.util import logging

import palpate

_LOG = logging.getLogger(__name__)
sys.path.insert(0, str(Path(__file__).parent))  # _pictures

project = "palpate"
author = "the palpate developers"
copyright = "2026, the palpate developers"
release = version = palpate.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.intersphinx",
    "sphinx_gallery.gen_gallery",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "examples", "gallery/*.py", "gallery/*.ipynb"]
html_theme = "furo"
html_title = "palpate"
html_static_path = ["_static"]
html_show_sourcelink = html_copy_source = False

myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath", "amsmath"]
math_number_all = False
html_math_renderer = "mathml"

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = dict.fromkeys(("Floats", "Complexes", "npt.NDArray"), "numpy.ndarray") | dict.fromkeys(
    ("ArrayLike", "npt.ArrayLike"), "numpy.typing.ArrayLike"
)
autodoc_member_order = "bysource"
autosummary_generate = False  # the pages of names are written below
napoleon_google_docstring = False
napoleon_use_rtype = napoleon_use_param = False  # types in docstrings are words
napoleon_custom_sections = [("Attributes", "params_style")]
toc_object_entries = False
default_role = "code"
python_maximum_signature_line_length = 100

# The names of other projects that appear in signatures, as short inventories of our own; the full ones with the network.
_PLACES = {
    "python": "https://docs.python.org/3/",
    "numpy": "https://numpy.org/doc/stable/",
    "xarray": "https://docs.xarray.dev/en/stable/",
    "pandas": "https://pandas.pydata.org/docs/",
    "matplotlib": "https://matplotlib.org/stable/",
}
_NETWORK = os.environ.get("PALPATE_DOCS_NETWORK") == "1"
intersphinx_mapping = {k: (url, None if _NETWORK else f"_inventories/{k}.txt") for k, url in _PLACES.items()}
intersphinx_timeout = 10

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "backreferences_dir": "gallery/backreferences",
    "doc_module": ("palpate",),
    "reference_url": {"palpate": None},
    "image_scrapers": ("_pictures.figures",),
    "matplotlib_animations": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,  # times differ from build to build
    "write_computation_times": False,
    "download_all_examples": False,
    "notebook_extensions": set(),
    "remove_config_comments": True,
    "capture_repr": (),
    "only_warn_on_example_error": False,
    "abort_on_example_error": False,
}

nitpicky = True
# Types that have no page of their own: type variables, aliases, words of numpy docstrings, and rooms that are not public.
nitpick_ignore_regex = [
    (
        "py:class",
        r"palpate\..*|(np|numpy)\..*|TypeAliasForwardRef|collections\.abc\..*|types\..*|(enum|abc)\..*|[a-z_]\w*|.*\[.*",
    ),
    ("py:class", r"TouchStream|Panel|OpenRecording|Bools|Table|Titles|Solid|Sample|Response|jax\.jaxlib\._jax\.Array"),
    # what the docstrings of collections.abc.Mapping return
    ("py:class", r"an? .*object providing a view on D's \w+"),
]
#: Types as the source writes them.
_WRITTEN = {
    "Path": "pathlib.Path",
    "Figure": "matplotlib.figure.Figure",
    "Axes": "matplotlib.axes.Axes",
    "Floats": "numpy.ndarray",
    "Complexes": "numpy.ndarray",
    "ArrayLike": "numpy.typing.ArrayLike",
    "npt.ArrayLike": "numpy.typing.ArrayLike",
    "npt.NDArray": "numpy.typing.NDArray",
    "numpy.random._generator.Generator": "numpy.random.Generator",
    "np.random.Generator": "numpy.random.Generator",
    "Any": "typing.Any",
    "Callable": "collections.abc.Callable",
    "Iterator": "collections.abc.Iterator",
    "Mapping": "collections.abc.Mapping",
    "Sequence": "collections.abc.Sequence",
}


#: Rooms whose `__all__` is public: each name has a page of its own (tests/contracts/test_docs.py compares).
ROOMS = (
    *("palpate", "palpate.solutions", "palpate.elastic", "palpate.sensing", "palpate.inverse", "palpate.recordings"),
    *(
        "palpate.archives",
        "palpate.touch",
        "palpate.tracking",
        "palpate.grasp",
        "palpate.simulation",
        "palpate.network",
    ),
    *("palpate.camera", "palpate.microscopy", "palpate.live", "palpate.ros", "palpate.pads", "palpate.sensors"),
    *("palpate.measured", "palpate.edges"),
    *("palpate.pressing", "palpate.mujoco", "palpate.jax", "palpate.lerobot"),
    *("palpate.design", "palpate.identify"),
    *("palpate.calibrate", "palpate.uncertainty", "palpate.bench", "palpate.paper", "palpate.units", "palpate.errors"),
)


def public() -> dict[str, str]:
    """Where each public name has its page: palpate.skin.Skin -> palpate.Skin. Constants go by the first room that has them."""
    found: dict[str, str] = {}
    for room in ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.ismodule(value) or name == "__version__":
                continue
            defined = inspect.isclass(value) or inspect.isroutine(value)
            found.setdefault(
                f"{value.__module__}.{value.__qualname__}" if defined else f"{name} = {value!r}", f"{room}.{name}"
            )
    return found


def _escape(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text: shapes such as (*batch, x) and |k| are not markup. Examples are left as they are."""
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # a comment: or napoleon takes what is before a colon for a type
    example = False
    for i, line in enumerate(lines):
        example = line.lstrip().startswith(">>>") or (example and bool(line.strip()))
        if example:
            continue
        parts = line.split("`")
        parts[::2] = [p.replace("*", r"\*").replace("|", r"\|") for p in parts[::2]]
        lines[i] = "`".join(parts)


def _plain(app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, back: str | None) -> Any:
    """Aliases of types as the source writes them."""
    return tuple(t and re.sub(r"TypeAliasForwardRef\('([\w.]+)'\)", r"\1", t) for t in (signature, back))


def _where_its_page_is(app: Any, env: Any, node: Any, content: Any) -> Any:
    """A type is written by the module that defines it; its page goes by the public name."""
    if node.get("refdomain") != "py":
        return None
    target = _PAGES.get(node["reftarget"])
    if target is None:
        if node["reftarget"] in _WRITTEN:  # intersphinx is asked next
            node["reftarget"], node["reftype"] = _WRITTEN[node["reftarget"]], "obj"
        return None
    return env.get_domain("py").resolve_xref(
        env, node["refdoc"], app.builder, node["reftype"], target, node, nodes.literal("", target.rpartition(".")[2])
    )


def _mathml(self: Any, node: Any, block: bool) -> None:
    """MathML, which browsers draw by themselves: no script, no network."""
    self.body.append(latex2mathml.tex2mathml(node.astext(), as_block=block))
    raise nodes.SkipNode


class _Links(HTMLParser):
    """What a page links to, and the anchors that it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.links.add(value)
            elif value and name in ("id", "name"):
                self.anchors.add(value)


def _check_links(app: Any, error: Exception | None) -> None:
    """Every link of the site to itself leads to a file and an anchor that are there; each that does not is a warning."""
    if error or app.builder.name != "html":
        return
    root = Path(app.outdir)
    pages = {page.resolve(): _Links(page.read_text(encoding="utf-8")) for page in root.rglob("*.html")}
    checked = 0
    for page, found in pages.items():
        for link in found.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            checked += 1
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            there = target in pages if target.suffix == ".html" else target.exists()
            if not there:
                _LOG.warning("%s: nothing at %s", page.relative_to(root.resolve()), link)
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                _LOG.warning("%s: no anchor at %s", page.relative_to(root.resolve()), link)
    _LOG.info("%d local links checked", checked)


def setup(app: Any) -> None:
    """Docstrings are escaped before napoleon reads them; formulas are MathML; types lead to their pages."""
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(lambda self, node: _mathml(self, node, False), None),
        block_renderers=(lambda self, node: _mathml(self, node, True), None),
    )
    app.connect("autodoc-process-signature", _plain)
    app.connect("autodoc-process-docstring", _escape, priority=400)
    app.connect("build-finished", _check_links)
    app.connect("missing-reference", _where_its_page_is, priority=400)


#: What is inherited from elsewhere has its page there.
_FOREIGN = "object, BaseException, Exception, ValueError, NotImplementedError, Protocol, tuple, int, str, StrEnum, IntEnum, Enum"
_PAGE = """:orphan:

{title}
{line}

See also the other names of :doc:`{group}`.

.. currentmodule:: {module}

.. {kind}:: {name}
{options}
"""
_USED = """.. minigallery:: {module}.{name}
   :add-heading: Where it is used
"""


def _comment(full: str, name: str, value: object) -> str:
    """What the comment above a constant says, from the module of the room that has the constant."""
    for module in [
        m for key, m in sorted(sys.modules.items()) if key.startswith("palpate") and vars(m).get(name) is value
    ]:
        said = ModuleAnalyzer.for_module(module.__name__).find_attr_docs().get(("", name))
        if said:
            return "\n" + "\n".join(f"   {line}" for line in said)
    raise ValueError(f"{full} has no comment '#: ...' above it.")


def write_pages() -> None:
    """One page for each name that the pages of the reference list. They stay out of the sidebar, which would be long and slow."""
    folder = Path(__file__).parent / "api"
    folder.mkdir(exist_ok=True)
    written = set()
    for group in sorted((Path(__file__).parent / "reference").glob("*.md")):
        for full in re.findall(r"^   (palpate\.[\w.]+)$", group.read_text(), re.MULTILINE):
            module, _, name = full.rpartition(".")
            value = getattr(importlib.import_module(module), name)
            if inspect.isclass(value):
                kind = "autoexception" if issubclass(value, Exception) else "autoclass"
                options = f"   :members:\n   :inherited-members: {_FOREIGN}"
            elif inspect.isroutine(value):
                kind, options = "autofunction", ""
            else:
                kind, options = "py:data", _comment(full, name, value)
            text = _PAGE.format(
                title=name,
                line="=" * len(name),
                group=f"/reference/{group.stem}",
                module=module,
                kind=kind,
                name=name,
                options=options,
            )
            if kind in ("autoclass", "autofunction"):
                text += "\n" + _USED.format(module=module, name=name)
            page = folder / f"{page_name(full)}.rst"
            written.add(page)
            if not page.exists() or page.read_text() != text:
                page.write_text(text)
    for page in set(folder.glob("*.rst")) - written:
        page.unlink()


#: Functions that differ from a class by a capital alone: their pages get another file on any disk.
_FUNCTIONS = (
    *("palpate.inverse.observability", "palpate.recordings.recorder"),
    *("palpate.sensors.preset", "palpate.uncertainty.constants"),
    "palpate.design.sweep",
)


def page_name(full: str) -> str:
    """Of a name's page."""
    return f"{full}-function" if full in _FUNCTIONS else full


_PAGES = public()
write_pages()
