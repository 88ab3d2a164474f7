"""A projector's lamp over months: hours that it was lit, and its power by PJLink while the show is off."""

from __future__ import annotations

import json
import logging
import math
import os
from dataclasses import dataclass
from pathlib import Path

from rig.devices.driver_settings import PjlinkSettings
from rig.devices.network.pjlink import Pjlink, Power
from rig.errors import DeviceError, SessionError
from rig.files.atomic import write_bytes
from rig.records import Record, read_record

log = logging.getLogger("rig.shows")


@dataclass(frozen=True, slots=True, kw_only=True)
class LampHours(Record):
    """What is kept of a lamp."""

    lit_s: float


def lamp_file(show: Path) -> Path:
    """Return the file in which the lamp's hours of a show are kept."""
    return show.with_suffix(".lamp.json")


def lamp_hours(show: Path) -> float:
    """Return how many hours a saved show, by its file, has lit the lamp."""
    return _read(lamp_file(show)) / 3600


class KeptLamp:
    """Counts in a file, and switches off by PJLink where the show wants that.

    Parameters
    ----------
    path
        Of the file; made when it is not there.
    control
        The projector's network control; None: the lamp stays as it is.
    limit_h
        After so many hours the log asks for a new lamp; None: never.
    """

    def __init__(self, path: Path, control: Pjlink | None, limit_h: float | None):
        self._path = path
        self._control = control
        self._limit_h = limit_h
        self._lit_s = _read(path)
        self._is_off = False

    @property
    def hours(self) -> float:
        """Hours that the lamp was lit by shows."""
        return self._lit_s / 3600

    def lit(self, seconds: float) -> None:
        """Count so many seconds of light. A disk that refuses is told, and ends no show."""
        self._is_off = False
        before, self._lit_s = self.hours, self._lit_s + seconds
        try:
            write_bytes(self._path, json.dumps(LampHours(lit_s=self._lit_s).as_json()).encode() + b"\n")
        except SessionError as error:
            log.warning("lamp hours are not kept: %s", error)
        if self._limit_h is not None and before < self._limit_h <= self.hours:
            log.warning("the lamp was lit for %.0f h, the limit is %g h: change it", self.hours, self._limit_h)

    def off(self) -> None:
        """Switch the lamp off, once; a projector that does not listen is told, and tried again the next time."""
        if self._control is None or self._is_off:
            return
        try:
            if self._control.power() in (Power.ON, Power.WARMING_UP):
                self._control.switch_off()
        except DeviceError as error:
            log.warning("the lamp stays lit: %s", error)
            return
        self._is_off = True
        log.info("lamp off")


def control_of(settings: PjlinkSettings | None) -> Pjlink | None:
    """Return the network control that a profile describes; None where it describes none.

    Parameters
    ----------
    settings
        Of ``[projector.pjlink]``.

    Returns
    -------
    Pjlink or None
    """
    if settings is None:
        return None
    name = settings.password_variable
    return Pjlink(settings.host, settings.port, os.environ.get(name) if name else None)


def _read(path: Path) -> float:
    """Seconds in a file; 0 where there is none, or it is damaged, which is told."""
    if not path.is_file():
        return 0.0
    try:
        lit_s = read_record(LampHours, json.loads(path.read_bytes())).lit_s
        if not 0 <= lit_s < math.inf:
            raise ValueError(f"lit_s is {lit_s}")
    except (OSError, ValueError, RecursionError) as error:
        log.warning("%s: is damaged (%s); lamp hours begin at 0", path, error)
        return 0.0
    return lit_s
