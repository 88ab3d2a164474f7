"""The one place where the errors of `calibration` and `sim`, which do not know the rig's, become part of its tree."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from calibration.errors import CalibrationError
from rig.errors import CalibrationFailed
from sim.errors import SimulationError


@contextmanager
def one_error_tree() -> Iterator[None]:
    """Turn CalibrationError and SimulationError into CalibrationFailed; usable as a decorator, too."""
    try:
        yield
    except (CalibrationError, SimulationError) as error:
        failed = CalibrationFailed(str(error))
        for note in getattr(error, "__notes__", ()):
            failed.add_note(note)
        raise failed from error
