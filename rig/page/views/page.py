"""The page's own text, and what the reports in it may do."""

from __future__ import annotations

import base64
import hashlib
import re
from functools import cache
from importlib.resources import files
from pathlib import Path

from rig.report.render import rendered
from rig.version import __version__

STATIC = Path(__file__).parents[1] / "static"
"""Scripts, styles and pictures of the page."""
SCENE_SCRIPTS = Path(__file__).parents[2] / "report" / "scene" / "scripts"
"""Those of the 3-D view, which reports hold, too."""
_SCRIPT = re.compile(r"<script>(.*?)</script>", re.DOTALL)
_INCLUDE = re.compile(r'\{% include "([^"]+)" %\}')
_REPORT_TEMPLATES = ("report/base.html", "report/session.html", "lenses/lenses.html")


def page_html() -> str:
    """Return the page."""
    return rendered("page/templates/page.html", {"version": __version__})


@cache
def report_policy() -> str:
    """Return what a report may do inside the page: show itself, with its own script and no other.

    Reports hold their pictures and styles within them; names and texts in them come from profiles and pictures, so no
    script runs but the one that this program writes, known by its hash.
    """
    scripts = [script for name in _REPORT_TEMPLATES for script in _SCRIPT.findall(_text(name))]
    hashes = " ".join(_hash_of(one) for one in scripts) or "'none'"
    return (
        f"default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src {hashes}; "
        "sandbox allow-scripts allow-popups allow-downloads; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
    )


def _hash_of(script: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def _text(name: str) -> str:
    """A template, what it includes put in its place as jinja2 does."""
    text = files("rig").joinpath(name).read_text(encoding="utf-8")
    return _INCLUDE.sub(lambda found: _text(found[1]).removesuffix("\n"), text)
