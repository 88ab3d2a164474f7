"""What another user may do: read this program, but not open its devices."""

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

NOBODY = 65534
ROOT = Path(__file__).parents[3]


@contextmanager
def as_nobody() -> Iterator[None]:
    """Another user's rights, for opening files."""
    let_everybody_read_the_program()
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def become_nobody() -> None:
    """Another user's rights for good, for a child process."""
    let_everybody_read_the_program()
    os.setuid(NOBODY)


@cache
def let_everybody_read_the_program() -> None:
    """Open what a home folder keeps closed: the way to the checkout, the interpreter and their packages.

    What is imported late, or read from a package, is read with the other user's rights. The machine's files are a
    scratch layer above the host's, so nothing of this is changed on the host.
    """
    for place in {ROOT, Path(sys.prefix), Path(sys.base_prefix), *map(Path, sys.path)}:
        for folder in (place.resolve(), *place.resolve().parents):
            _let_everybody_read(folder)
    for package in ("rig", "sim", "calibration", "hw_profiles", "tests"):
        for path in (ROOT / package, *(ROOT / package).rglob("*")):
            _let_everybody_read(path)


def _let_everybody_read(path: Path) -> None:
    if not path.exists():
        return
    mode = path.stat().st_mode
    wanted = mode | (0o555 if stat.S_ISDIR(mode) else 0o444)
    if mode != wanted:
        path.chmod(wanted)
