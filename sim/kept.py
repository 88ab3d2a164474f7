"""What was found for an object is kept with it, and goes when it goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar, cast

Of = TypeVar("Of")
Found = TypeVar("Found")


@dataclass(frozen=True)
class Kept(Generic[Of, Found]):
    """One thing that is found for objects that do not change, kept in each object's own dictionary.

    No ``WeakKeyDictionary``: it forgets an object in a function of Python's that runs while the object is freed, and
    an interrupt (Ctrl-C) that is seen there is thrown away, for an exception cannot leave such a function.
    """

    name: str
    """Of the entry; no field of those objects."""

    def get(self, owner: Of) -> Found | None:
        """Return what was found for it; None where nothing was yet."""
        return cast("Found | None", vars(owner).get(self.name))

    def once(self, owner: Of, find: Callable[[], Found]) -> Found:
        """Return what was found for it; found now where nothing was yet."""
        found = self.get(owner)
        return self.keep(owner, find()) if found is None else found

    def keep(self, owner: Of, found: Found) -> Found:
        """Keep it, in place of what was there, and return it."""
        vars(owner)[self.name] = found
        return found
