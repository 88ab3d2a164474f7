"""Characters that a terminal without UTF-8 does not know, in those that it knows."""

from __future__ import annotations

import codecs
import io
import sys
from collections.abc import Mapping

_PLAIN = "rig-plain"
"""Name of the error handler of codecs."""
_INSTEAD: Mapping[str, str] = {
    "…": "...",
    "×": "x",
    "−": "-",
    "–": "-",
    "—": "-",
    "±": "+-",
    "·": ".",
    "°": " deg",
    "²": "^2",
    "σ": "sigma",
    "π": "pi",
    "ρ": "rho",
    "µ": "u",
    "μ": "u",
    "≤": "<=",
    "≥": ">=",
    "→": "->",
    "█": "#",
    "─": "-",
    "━": "-",
    "’": "'",
    "“": '"',
    "”": '"',
}


def write_plainly() -> None:
    """Let this process's output write signs that the terminal does not know in those that it knows, else as escapes."""
    codecs.register_error(_PLAIN, _plain)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_PLAIN)


def _plain(error: UnicodeError) -> tuple[str | bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    end = error.start + 1
    known = _INSTEAD.get(error.object[error.start : end])
    if known is not None:
        return known, end
    error.end = end
    return codecs.backslashreplace_errors(error)
