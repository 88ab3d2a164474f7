"""Paints by name: cited ones of ``hw_profiles/paints``, one's own of the room file, Munsell greys, plain numbers."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from rig.errors import ProfileError, UsageError
from rig.files.toml import Table, read_model
from rig.plan.request import NamedPaint, Paint
from rig.profile.hardware_facts import FOLDER, Fact, FactSource
from rig.records import Record

LOWEST, HIGHEST = 0.001, 0.99
"""Reflectances of a plan: nothing on a wall is blacker, and above 0.99 light would hardly fade."""
MUNSELL = "munsell-n"
_PAINT_FILE = FOLDER / "paints" / "paints.toml"
_POLYNOMIAL = (1.1914, -0.22533, 0.23352, -0.020484, 0.00081939)
"""Of a Munsell value V: Y in percent (ASTM D1535-08)."""


class PaintFile(Table):
    """Cited paints by name, and the documents that say so."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    sources: dict[str, FactSource]
    paints: dict[str, Fact[float]]


@dataclass(frozen=True, kw_only=True)
class ChosenPaint(Record):
    """A paint as a plan takes it."""

    name: str
    reflectance: float
    cost: float
    """A square metre, in the room file's currency."""
    source: str


def chosen_paint(paint: Paint, own: tuple[NamedPaint, ...], where: str) -> ChosenPaint:
    """Return the paint of a name or a number.

    Parameters
    ----------
    paint
        A reflectance, a name of the room file, of ``hw_profiles/paints``, or ``munsell-n5.5``.
    own
        The room file's named paints; they go first.
    where
        What it is for, in messages.

    Raises
    ------
    UsageError
        For an unknown name, or a reflectance that no paint has.
    """
    if not isinstance(paint, str):
        return ChosenPaint(name=f"{paint:g}", reflectance=_checked(paint, where), cost=0.0, source="the room file")
    for one in own:
        if one.name == paint:
            source = one.source or "the room file"
            return ChosenPaint(name=one.name, reflectance=one.reflectance, cost=one.cost, source=source)
    if paint.startswith(MUNSELL):
        return ChosenPaint(name=paint, reflectance=_munsell(paint, where), cost=0.0, source="ASTM D1535-08")
    file = known_paints()
    if paint not in file.paints:
        raise UsageError(f"{where}: no paint is called {paint!r}{_near(paint, own)}")
    fact = file.paints[paint]
    return ChosenPaint(name=paint, reflectance=fact.value, cost=0.0, source=file.sources[fact.source].title)


@cache
def known_paints() -> PaintFile:
    """Return the cited paints."""
    return read_paints(_PAINT_FILE)


def read_paints(path: Path) -> PaintFile:
    """Read a file of cited paints.

    Raises
    ------
    ProfileError
        It cannot be read, is no such file, names a source that is not there, or has a reflectance that no paint has or
        that its source's words do not say.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; install procam-rig again") from error
    return read_model(PaintFile, raw, path, _problems)


def _problems(data: Mapping[str, Any]) -> list[str]:
    """What no single table shows: sources that are missing, and numbers that stand in no quotation."""
    paints, sources = data.get("paints"), data.get("sources")
    if not isinstance(paints, dict) or not isinstance(sources, dict):
        return []
    problems = []
    for name, fact in paints.items():
        if not isinstance(fact, dict):
            continue
        value, quote = fact.get("value"), fact.get("quote")
        if fact.get("source") not in sources:
            problems.append(
                f"paints.{name}.source: no source is called {fact.get('source')!r}; there are {_listed(sources)}"
            )
        if not isinstance(value, float) or not isinstance(quote, str):
            continue
        if not LOWEST <= value <= HIGHEST:
            problems.append(f"paints.{name}.value: is {value:g}; paints lie in {LOWEST:g} ... {HIGHEST:g}")
        elif not any(math.isclose(value, said * unit) for said in _numbers(quote) for unit in (1, 0.01)):
            problems.append(f"paints.{name}.value: is {value:g}, which its quotation does not say; correct either")
    return problems


def _numbers(quote: str) -> list[float]:
    """The numbers of a quotation but for lengths: the 5 of 5mm is no reflectance."""
    return [float(number) for number in re.findall(r"(?<![\d.])(?:\d+(?:\.\d+)?|\.\d+)(?![\d]|\.\d|\s*mm)", quote)]


def _listed(names: Iterable[object]) -> str:
    return ", ".join(map(str, names))


def _checked(value: float, where: str) -> float:
    if not LOWEST <= value <= HIGHEST:
        hint = f"; {value:g} % is {value / 100:g}" if 1 < value <= 100 * HIGHEST else ""
        raise UsageError(f"{where}: a reflectance of {value:g}; paints lie in {LOWEST:g} ... {HIGHEST:g}{hint}")
    return float(value)


def _munsell(name: str, where: str) -> float:
    """Reflectance of a Munsell neutral, 0.5 ... 9.75."""
    try:
        value = float(name.removeprefix(MUNSELL))
    except ValueError as error:
        raise UsageError(f"{where}: {name!r}: write munsell-n5 or munsell-n5.5") from error
    if not 0.5 <= value <= 9.75:
        raise UsageError(
            f"{where}: {name!r}: Munsell neutrals are made from N0.5 to N9.75; "
            "choose one of them, or give the reflectance as a number"
        )
    return sum(c * value ** (k + 1) for k, c in enumerate(_POLYNOMIAL)) / 100


def _near(name: str, own: tuple[NamedPaint, ...]) -> str:
    names = [one.name for one in own] + list(known_paints().paints)
    near = difflib.get_close_matches(name, names, n=1)
    meant = f"; did you mean {near[0]}?" if near else ""
    return f"{meant}; there are {', '.join(names)}, munsell-n0.5 ... munsell-n9.75, a number, or [[named_paint]]"
