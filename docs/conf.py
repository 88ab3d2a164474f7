"""Sphinx: the site of docs/ and of the front doors' docstrings (``make docs``; why so: decision 32)."""

import sys
from importlib import metadata
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs" / "site"))

from contents import FRONT_DOORS, INDEXES, OUTSIDE, START, with_toctrees  # noqa: E402
from front_doors import array_aliases, plain_arrays, with_reference, words_of_constant  # noqa: E402

project = "procam-rig"
author = "The procam-rig authors"
release = metadata.version("procam-rig")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]

# The root of the sources is that of the repository, so that pages' links to files outside docs/ hold on the site too.
include_patterns = ["docs/**.md", *OUTSIDE]
exclude_patterns = [".*", "build", "runs"]
root_doc = START.removesuffix(".md")
myst_heading_anchors = 4
smartquotes = False

# Names in single backticks are links where the site knows them.
default_role = "py:obj"
autosummary_generate = False
autodoc_default_options = {"member-order": "bysource"}
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
autodoc_type_aliases = array_aliases()
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
numpydoc_show_class_members = False
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = f"procam-rig {release}"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_extra_path = ["site/root"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}


def complete(app: Any, docname: str, source: list[str]) -> None:
    """Give an index page its contents, and a front door's page its reference."""
    if f"{docname}.md" in INDEXES:
        source[0] = with_toctrees(source[0])
    if docname in FRONT_DOORS:
        source[0] = with_reference(source[0], FRONT_DOORS[docname])


def short_arrays(
    app: Any, what: str, name: str, value: object, options: object, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Write arrays in a signature as the sources do."""
    return plain_arrays(signature), plain_arrays(returns)


def fetch_words(app: Any, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Give a constant that a front door shows the words of the module that defines it."""
    if what == "data" and name.rpartition(".")[0] in FRONT_DOORS.values():
        lines[:] = words_of_constant(name)


def setup(app: Any) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("source-read", complete)
    app.connect("autodoc-process-signature", short_arrays)
    app.connect("autodoc-process-docstring", fetch_words, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
