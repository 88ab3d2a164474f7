"""What other installed packages add: camera drivers, projector drivers, strategies, structured-light codes.

A package names what it offers as an entry point of the group of its kind (docs/how-to/plug-ins.md). What this program
brings along is described in the same way, so that one function finds, and one loads, either.
"""

from __future__ import annotations

import difflib
import os
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Literal, TypeVar

from rig.errors import RigError, UsageError
from rig.records import Record
from rig.version import __version__

if TYPE_CHECKING:
    from calibration import StructuredLightCode
    from sim import Compensation, Strategy
    from sim.arrays import FloatArray
    from sim.compensation import Transport

Kind = Literal["camera driver", "projector driver", "strategy", "code"]
GROUPS: Mapping[Kind, str] = {
    "camera driver": "procam_rig.camera_drivers",
    "projector driver": "procam_rig.projector_drivers",
    "strategy": "procam_rig.strategies",
    "code": "procam_rig.codes",
}
"""The group of entry points of each kind."""
OWN_PACKAGE = "procam-rig"
Made = TypeVar("Made")


@dataclass(frozen=True, kw_only=True)
class PlugIn(Record):
    """Something that an installed package offers."""

    kind: Kind
    name: str
    """What a profile or the command line calls it."""
    package: str
    version: str
    """Of the package; part of the hash of a step that uses it."""
    value: str
    """Where it is: ``module:attribute``."""

    @property
    def source(self) -> str:
        """Package and version, for people."""
        return f"{self.package} {self.version}".strip()

    @property
    def is_own(self) -> bool:
        """Whether this program brings it along."""
        return self.package == OWN_PACKAGE


def own(kind: Kind, values: Mapping[str, str]) -> tuple[PlugIn, ...]:
    """Describe what this program brings along, given as ``module:attribute`` by name."""
    return tuple(
        PlugIn(kind=kind, name=name, package=OWN_PACKAGE, version=__version__, value=value)
        for name, value in values.items()
    )


def others(kind: Kind) -> tuple[PlugIn, ...]:
    """Return what other installed packages offer, sorted by name; nothing of it is imported."""
    return _others(kind, _state_of_path())


@lru_cache(maxsize=4 * len(GROUPS))
def _others(kind: Kind, _: tuple[tuple[str, int], ...]) -> tuple[PlugIn, ...]:
    """Read the lists of all installed packages, some hundred files; again when a package came or went."""
    found = [_plug_in(kind, entry) for entry in entry_points(group=GROUPS[kind])]
    return tuple(sorted(found, key=lambda one: (one.name, one.package)))


def _state_of_path() -> tuple[tuple[str, int], ...]:
    """Return where packages are installed, and when one was added there or removed."""
    state = []
    for folder in sys.path:
        with suppress(OSError):
            state.append((folder, os.stat(folder or ".").st_mtime_ns))
    return tuple(state)


def _plug_in(kind: Kind, entry: EntryPoint) -> PlugIn:
    package = entry.dist
    return PlugIn(
        kind=kind,
        name=entry.name,
        package=package.name if package else "unknown",
        version=package.version if package else "",
        value=entry.value,
    )


def clashes(offered: Iterable[PlugIn]) -> tuple[str, ...]:
    """Return a sentence for each name that is offered more than once."""
    by_name: dict[tuple[str, str], list[PlugIn]] = {}
    for one in offered:
        by_name.setdefault((one.kind, one.name), []).append(one)
    return tuple(_clash(same) for same in by_name.values() if len(same) > 1)


def _clash(same: list[PlugIn]) -> str:
    who = " and by ".join(one.source for one in same)
    return f"{same[0].kind} {same[0].name!r} is offered by {who}; uninstall all but one of them"


def choose(kind: Kind, name: str, brought: Iterable[PlugIn] = ()) -> PlugIn:
    """Return the one that has a name, among what this program brings along and what is installed.

    Raises
    ------
    UsageError
        There is none, with the names that there are; or more than one.
    """
    offered = (*brought, *others(kind))
    named = [one for one in offered if one.name == name]
    if len(named) == 1:
        return named[0]
    if named:
        raise UsageError(_clash(named))
    known = [one.name for one in offered]
    near = difflib.get_close_matches(name, known, n=1)
    meant = f"; did you mean {near[0]}?" if near else ""
    raise UsageError(f"no {kind} is named {name!r}{meant}; there are {', '.join(known) or 'none'}")


def names(kind: Kind, brought: Iterable[PlugIn] = ()) -> tuple[str, ...]:
    """Return the names that there are, this program's first."""
    return tuple(dict.fromkeys(one.name for one in (*brought, *others(kind))))


def load(plug_in: PlugIn) -> object:
    """Import what a plug-in names.

    Raises
    ------
    UsageError
        It cannot be imported, for whatever reason; the message names the package.
    """
    try:
        loaded: object = EntryPoint(plug_in.name, plug_in.value, GROUPS[plug_in.kind]).load()
    except Exception as error:
        raise UsageError(
            f"{plug_in.kind} {plug_in.name!r} of {plug_in.source} cannot be loaded ({plug_in.value}): "
            f"{type(error).__name__}: {error}; reinstall that package, or a version that fits procam-rig "
            f"{__version__}"
        ) from error
    return loaded


def make(driver: PlugIn, settings: object, clock: object) -> object:
    """Return what a driver's function makes of its settings and the rig's clock.

    Raises
    ------
    UsageError
        It cannot be loaded, is no function, or fails by a mistake of its own; the message names the package.
    RigError
        As it says.
    """
    function = load(driver)
    if not callable(function):
        raise wrong_type(driver, function, "a function of settings and clock")
    with blaming(driver):
        made: object = function(settings, clock)
    return made


@contextmanager
def blaming(plug_in: PlugIn) -> Iterator[None]:
    """Within, another package's code is at work: a mistake of its own is told with its name and the line.

    Raises
    ------
    UsageError
        It fails by a mistake of its own.
    RigError, SimulationError
        As it says.
    """
    from sim.errors import SimulationError

    try:
        yield
    except (RigError, SimulationError, MemoryError):
        raise
    except Exception as error:
        if plug_in.is_own:
            raise
        last = traceback.extract_tb(error.__traceback__)[-1]
        raise UsageError(
            f"{plug_in.kind} {plug_in.name!r} of {plug_in.source} fails ({plug_in.value}): {type(error).__name__}: "
            f"{error} (line {last.lineno} of {last.filename}); tell its author"
        ) from error


def made_by(
    kind: Kind, name: str, arguments: tuple[object, object], *, brought: Iterable[PlugIn], wanted: type[Made]
) -> Made:
    """Return what the driver of a name makes of its settings and the rig's clock.

    Raises
    ------
    UsageError
        There is no such driver, or two; it cannot be loaded, fails by a mistake of its own, or makes something else.
    RigError
        As it says.
    """
    driver = choose(kind, name, brought)
    made = make(driver, *arguments)
    if not isinstance(made, wanted):
        raise wrong_type(driver, made, f"{wanted.__name__} ({wanted.__module__})")
    return made


def wrong_type(plug_in: PlugIn, found: object, wanted: str) -> UsageError:
    """Return the error for a plug-in that gives something else than its kind has to."""
    return UsageError(
        f"{plug_in.kind} {plug_in.name!r} of {plug_in.source} gives {type(found).__name__}, not {wanted}; "
        "tell its author (docs/how-to/plug-ins.md says what is expected)"
    )


def own_strategies() -> tuple[PlugIn, ...]:
    """Return the compensation strategies that this program brings along."""
    from sim.compensation import STRATEGIES

    values = {name: f"{one.solve.__module__}:{one.solve.__qualname__}" for name, one in STRATEGIES.items()}
    return own("strategy", values)


def find_strategy(name: str) -> Strategy:
    """Return a compensation strategy: this program's, or one that another package offers.

    Raises
    ------
    UsageError
        There is none of that name, or two; or it cannot be loaded, or is no ``sim.Strategy`` of that name.
    """
    from sim.compensation import STRATEGIES
    from sim.compensation.strategy import Strategy

    plug_in = choose("strategy", name, own_strategies())
    if plug_in.is_own:
        return STRATEGIES[name]
    found = load(plug_in)
    if not isinstance(found, Strategy) or found.name != name:
        raise wrong_type(plug_in, found, f"a sim.Strategy of the name {name!r}")
    return found


def compensate(name: str, transport: Transport, wanted: FloatArray, **options: float) -> Compensation:
    """Return what a strategy computes, of this program or of another package.

    Raises
    ------
    UsageError
        There is none of that name, or two; or another package's fails by a mistake of its own.
    SimulationError
        As of :func:`sim.compensate`.
    """
    strategy = find_strategy(name)
    with blaming(choose("strategy", name, own_strategies())):
        return strategy.compensate(transport, wanted, **options)


def strategy_version(name: str) -> str:
    """Return what the hash of a step has to hold of a strategy: its version, and its package's if that is another."""
    found = find_strategy(name)
    return _version_of(choose("strategy", name, own_strategies()), found.version)


def own_codes() -> tuple[PlugIn, ...]:
    """Return the structured-light codes that this program brings along."""
    from calibration.structured_light.code import CODES

    return own("code", {name: f"{type(one).__module__}:{type(one).__qualname__}" for name, one in CODES.items()})


def find_code(name: str) -> StructuredLightCode:
    """Return a structured-light code: this program's, or one that another package offers.

    Raises
    ------
    UsageError
        There is none of that name, or two; or it cannot be loaded, or is no ``calibration.StructuredLightCode`` of
        that name.
    """
    from calibration.structured_light.code import CODES, StructuredLightCode

    plug_in = choose("code", name, own_codes())
    if plug_in.is_own:
        return CODES[name]
    found = load(plug_in)
    if not isinstance(found, StructuredLightCode) or found.name != name:
        raise wrong_type(plug_in, found, f"a calibration.StructuredLightCode of the name {name!r}")
    return found


def code_version(name: str) -> str:
    """Return what the hash of a step has to hold of a code: its version, and its package's if that is another."""
    found = find_code(name)
    return _version_of(choose("code", name, own_codes()), found.version)


def _version_of(plug_in: PlugIn, own_version: str) -> str:
    return own_version if plug_in.is_own else f"{own_version} of {plug_in.source}"
