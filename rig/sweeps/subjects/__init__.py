"""What a study can ask: the subjects, each a name, a version, a check of its inputs and one pure function of them."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from rig.errors import UsageError
from rig.records import JsonObject
from rig.sweeps.records import Evaluated


class Subject(Protocol):
    """Something that answers figures when it is asked at a point."""

    @property
    def version(self) -> str:
        """Changes when the same inputs give other figures; part of each point's name."""
        ...

    def base_of(self, name: str | None, near: Path) -> str | None:
        """Return the text of the file that the parameters are settings of; None where the subject needs none.

        Parameters
        ----------
        name
            What the study calls it.
        near
            The study's folder.

        Raises
        ------
        UsageError, ProfileError
            It is missing, cannot be used, or is not needed.
        """
        ...

    def complete(self, settings: Mapping[str, object], base: str | None) -> JsonObject:
        """Return all inputs of a point, defaults filled in.

        Raises
        ------
        ProfileError
            A parameter is unknown or out of range; a line each.
        """
        ...

    def evaluate(self, inputs: JsonObject, base: str | None) -> Evaluated:
        """Answer at a point; a pure function, so that every machine answers the same.

        Raises
        ------
        RigError, SimulationError, CalibrationError
            The point has no answer.
        """
        ...


SUBJECTS: Mapping[str, str] = {
    "paper": "rig.sweeps.subjects.paper:PaperSubject",
    "plan": "rig.sweeps.subjects.plan:PlanSubject",
    "session": "rig.sweeps.subjects.session:SessionSubject",
}
"""Where each subject is; none is loaded before a study asks for it."""


def subject_of(name: str) -> Subject:
    """Return the subject of a name.

    Raises
    ------
    UsageError
        There is none.
    """
    if name not in SUBJECTS:
        near = difflib.get_close_matches(name, SUBJECTS, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(SUBJECTS)}"
        raise UsageError(f"subject: {name!r} is none; {hint}")
    module, _, kind = SUBJECTS[name].partition(":")
    return cast("Subject", getattr(import_module(module), kind)())
