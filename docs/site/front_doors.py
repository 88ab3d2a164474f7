"""The reference of what ``import rig``, ``import sim`` and ``import calibration`` show, from each one's ``__all__``."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType
from typing import get_origin

from contents import FRONT_DOORS, ROOT, public_names
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.typing import stringify_annotation

KINDS = {
    "function": "Functions",
    "class": "Classes",
    "exception": "Errors",
    "data": "Constants",
    "type": "Names of types",
    "module": "Modules",
}
"""What autodoc calls a public name, and the heading over its like, in the order of the page."""
OPTIONS = {"class": [":members:"], "exception": [":members:", ":show-inheritance:"], "module": [":members:"]}
LONGEST_VALUE = 80
"""Characters of a constant's value that fit in a line; longer ones are not shown."""
ARRAY_ALIAS = re.compile(r"^(\w+)(?:: TypeAlias)? = NDArray\[", re.MULTILINE)
"""A name for arrays of one kind, as a module gives it."""
SHORT = re.compile(r"~(?:\w+\.)*")
"""What Sphinx prints before a name whose module need not be shown."""
FORWARD = re.compile(r"TypeAliasForwardRef\('(\w+)'\)")
NUMPY_ARRAY = re.compile(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(\w+)\]\]")
"""What Sphinx prints of such a name within another type, and numpy of ``NDArray[uint8]``."""


def array_aliases() -> dict[str, str]:
    """Return the names for arrays that pages show instead of what they stand for: the packages' own, and numpy's."""
    files = (file for package in FRONT_DOORS.values() for file in (ROOT / package).rglob("*.py"))
    own = {name for file in files for name in ARRAY_ALIAS.findall(file.read_text(encoding="utf-8"))}
    return {name: name for name in sorted(own | {"ArrayLike"})}


def plain_arrays(annotation: str | None) -> str | None:
    """Return a signature with what Sphinx and numpy print of an array's type in the form in which it was written."""
    return annotation and NUMPY_ARRAY.sub(r"NDArray[\1]", FORWARD.sub(r"\1", annotation))


def with_reference(text: str, package: str) -> str:
    """Return a page's text with a table and the entries of a package's public names, by kind."""
    return "\n".join([text, f"```{{eval-rst}}\n.. py:currentmodule:: {package}\n```", *_chapters(package)])


def _chapters(package: str) -> Iterator[str]:
    module = import_module(package)
    by_kind: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for name in public_names(package):
        by_kind[_kind(getattr(module, name))].append(name)
    for kind, names in by_kind.items():
        if names:
            yield f"## {KINDS[kind]}\n\n```{{eval-rst}}\n{_table(names) if kind != 'type' else ''}\n```\n"
            yield from (f"```{{eval-rst}}\n{_entry(kind, module, name)}\n```\n" for name in names)


def _kind(value: object) -> str:
    if inspect.ismodule(value):
        return "module"
    if isinstance(value, type):
        return "exception" if issubclass(value, BaseException) else "class"
    if get_origin(value) is not None:
        return "type"
    return "function" if callable(value) and hasattr(value, "__name__") else "data"


def _table(names: list[str]) -> str:
    return "\n".join([".. autosummary::", "   :nosignatures:", "", *(f"   {name}" for name in names)])


def _entry(kind: str, module: ModuleType, name: str) -> str:
    if kind == "type":  # which autodoc does not know
        stands_for = plain_arrays(SHORT.sub("", stringify_annotation(getattr(module, name), "smart")))
        words = words_of_constant(f"{module.__name__}.{name}")
        return "\n   ".join([f".. py:type:: {name}", f":canonical: {stands_for}", "", *words])
    options = list(OPTIONS.get(kind, []))
    if kind == "data" and len(repr(getattr(module, name))) > LONGEST_VALUE:
        options.append(":no-value:")
    return "\n".join([f".. auto{kind}:: {module.__name__}.{name}", *(f"   {option}" for option in options)])


def words_of_constant(name: str) -> list[str]:
    """Return the docstring below a public constant in the module that defines it; not that of the constant's type."""
    package, _, constant = name.rpartition(".")
    value = getattr(import_module(package), constant)
    shows_it = [name for name, module in _sources(package) if vars(module).get(constant) is value]
    found = (ModuleAnalyzer.for_module(name).find_attr_docs().get(("", constant)) for name in shows_it)
    return next(filter(None, found), [])


def _sources(package: str) -> list[tuple[str, ModuleType]]:
    """Return a package's modules that have been imported from Python sources, by name."""
    inside = ((name, module) for name, module in sys.modules.items() if f"{name}.".startswith(f"{package}."))
    return sorted((name, module) for name, module in inside if (module.__file__ or "").endswith(".py"))
