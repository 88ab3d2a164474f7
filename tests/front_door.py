"""What a package's front door shows, and how much of it is documented: numpydoc sections, counted."""

from __future__ import annotations

import doctest
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[1]


def documentation_gaps(package: ModuleType) -> tuple[dict[str, list[str]], int]:
    """Return what each public function lacks in its docstring, and how many functions there are.

    Counted are the functions among the package's public names, constructors that are written out, public methods of
    the classes among them and of the classes that these return, and functions in the records of a public mapping.

    A complete docstring has a first sentence that starts in upper case and ends with a full stop, ``Parameters`` with
    every parameter, ``Returns`` where something is returned, ``Raises`` where the function itself raises.
    """
    found = dict(public_functions(package))
    gaps = {name: gaps_of(function) for name, function in sorted(found.items())}
    return {name: lacks for name, lacks in gaps.items() if lacks}, len(found)


def documented_share(package: ModuleType) -> float:
    """Return the share of the public functions whose docstring is complete."""
    gaps, count = documentation_gaps(package)
    return 1 - len(gaps) / count


def public_functions(package: ModuleType) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield names and functions as :func:`documentation_gaps` counts them."""
    waiting = [(name, getattr(package, name)) for name in package.__all__]
    seen: set[int] = set()
    while waiting:
        name, thing = waiting.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        members = _members(name, thing, package.__name__)
        yield from members
        for _, function in members:
            waiting += [(each.__name__, each) for each in _returned(function, package.__name__)]


def _members(name: str, thing: object, package: str) -> list[tuple[str, Callable[..., Any]]]:
    if isinstance(thing, Mapping):
        records = [(key, record) for key, record in thing.items() if is_dataclass(record)]
        values = [(key, getattr(record, field.name)) for key, record in records for field in fields(record)]
        return [(f"{name}[{key!r}]", value) for key, value in values if inspect.isfunction(value)]
    if inspect.isfunction(thing):
        return [(name, thing)]
    if not inspect.isclass(thing) or not _belongs(thing, package):
        return []
    own = [(f"{name}.{key}", _function(value)) for key, value in vars(thing).items() if not key.startswith("_")]
    written = [] if is_dataclass(thing) or "__init__" not in vars(thing) else [(name, thing)]
    return written + [(key, function) for key, function in own if function is not None]


def _function(member: object) -> Callable[..., Any] | None:
    """The function of a method of any kind; None for a property or a value."""
    function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
    return function if inspect.isfunction(function) else None


def _returned(function: Callable[..., Any], package: str) -> list[type]:
    """Classes of the package in a function's annotation of what it returns."""
    if inspect.isclass(function):
        return []
    words = re.findall(r"\w+", str(function.__annotations__.get("return", "")))
    named = [function.__globals__.get(word) for word in words]
    return [each for each in named if inspect.isclass(each) and _belongs(each, package)]


def _belongs(thing: type, package: str) -> bool:
    return thing.__module__ == package or thing.__module__.startswith(package + ".")


def gaps_of(function: Callable[..., Any]) -> list[str]:
    """Return what the docstring of a function, or of a class with a constructor, lacks."""
    text = inspect.getdoc(function) or ""
    sections = _sections(text)
    lacks = [] if re.match(r"(?s)[A-Z].*?\.(\s|$)", text.split("\n\n")[0]) else ["a first sentence"]
    told = _names(sections.get("Parameters", ""))
    lacks += [f"parameter {name}" for name in _parameters(function) if name not in told]
    if inspect.isclass(function):
        return lacks
    returned = str(function.__annotations__.get("return", "None"))
    if returned not in ("None", "NoReturn") and not {"Returns", "Yields"} & set(sections):
        lacks.append("Returns")
    body = textwrap.dedent(inspect.getsource(function))
    if re.search(r"^\s+raise\b", body, re.MULTILINE) and "Raises" not in sections:
        lacks.append("Raises")
    return lacks


def _parameters(function: Callable[..., Any]) -> list[str]:
    return [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]


def _sections(text: str) -> dict[str, str]:
    """Sections of a numpydoc docstring by title."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def _names(section: str) -> set[str]:
    """Names of the parameters that a section describes, without the stars of ``*args`` and ``**options``."""
    heads = [line.split(" :")[0] for line in section.splitlines() if line and not line[0].isspace()]
    return {name.strip().lstrip("*") for head in heads for name in head.split(",")}


def stub_names(package: ModuleType) -> set[str]:
    """Return the names that the package's ``__init__.pyi`` offers to type checkers and editors."""
    stub = Path(str(package.__file__)).with_suffix(".pyi").read_text(encoding="utf-8")
    return set(re.findall(r"^from \S+ import (?:\w+) as (\w+)$", stub, re.MULTILINE))


def distribution_version() -> str:
    """Return the version that was installed: that of the last tag and what came after it."""
    return version("procam-rig")


def run_examples(package: ModuleType) -> int:
    """Run the examples of the package's docstring; return how many lines there were.

    Raises
    ------
    AssertionError
        If one of them gives something else than it says.
    """
    example = doctest.DocTestParser().get_doctest(
        package.__doc__ or "", {}, name=package.__name__, filename=None, lineno=None
    )
    result = doctest.DocTestRunner().run(example)
    assert result.failed == 0
    return result.attempted
