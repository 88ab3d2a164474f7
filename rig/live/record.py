"""A folder of what was shown, and photographed: pictures that are there completely or not at all, and a journal.

A thread of its own writes; it takes the newest frame when it is free, so recording never holds up what is shown.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rig.devices.protocols import Camera, Clock
from rig.errors import CaptureTimeout, DeviceError, RigError, SessionError, UsageError
from rig.files.exr import write_exr
from rig.files.journal import JOURNAL_NAME, Journal
from rig.files.pictures import write_png
from rig.live.show.loop import ShownFrame
from rig.live.show.priority import normal_priority
from rig.records import JsonObject

RECORD_RATE_HZ = 5.0
"""Pictures a second that are kept, at most."""
_PHOTOGRAPH_RATE_HZ = 1.0
"""Enough to see what the room did; an exposure keeps the camera, not the show."""
_PNG_COMPRESSION = 1
"""Quick rather than small: the writing thread shares the machine with the show."""
_IDLE_S = 0.5
"""Between two looks whether it is time for a photograph."""
_CHANNELS = {1: ("Y",), 3: ("R", "G", "B")}


class Recorder:
    """Writes frames to a new folder; use it in a ``with`` statement.

    Parameters
    ----------
    folder
        New or empty.
    shape
        (height, width) of the frames.
    clock
        That of the frames' times.
    camera
        Open; photographs what is shown, if there is one.
    """

    def __init__(self, folder: Path, shape: tuple[int, int], clock: Clock, camera: Camera | None = None):
        self.notes: list[str] = []
        self.frames = 0
        self.photographs = 0
        self._folder = new_folder(folder)
        self._clock = clock
        self._camera = camera
        self._journal = Journal(folder / JOURNAL_NAME)
        self._codes = np.zeros((*shape, 3), np.uint8)
        self._details: JsonObject | None = None
        self._changed = threading.Condition()
        self._stopped = False
        self._last_frame_s = self._last_photograph_s = -1e9
        self._thread = threading.Thread(target=self._run, name="live record", daemon=True)
        self._thread.start()

    def begin(self, *, profile: str, session: str, sources: Sequence[str]) -> None:
        """Note what is shown: names of profile, session and sources."""
        header = {"profile": profile, "session": session, "sources": list(sources)}
        self._journal.append({"event": "begin", **header})

    def offer(self, frame: ShownFrame) -> None:
        """Keep a frame if it is time for one and the last one has been written; quick."""
        if self._details is not None or frame.on_screen_s - self._last_frame_s < 1 / RECORD_RATE_HZ:
            return
        self._last_frame_s = frame.on_screen_s
        np.copyto(self._codes, frame.codes)
        details: JsonObject = {
            "number": frame.number,
            "on_screen_s": frame.on_screen_s,
            "gain": frame.gain,
            "strategy": frame.controls.shown_strategy or "none",
            "black": frame.controls.black,
        }
        with self._changed:
            self._details = details
            self._changed.notify()

    def close(self, *, frames: int, ended_by: str) -> None:
        """Write what waits, and how the show ended, after how many frames."""
        with self._changed:
            if self._stopped:
                return
            self._stopped = True
            self._changed.notify()
        self._thread.join()
        try:
            self._journal.append({"event": "end", "frames": frames, "ended_by": ended_by})
        except SessionError as error:
            self.notes.append(str(error))
        self._journal.close()

    def _run(self) -> None:
        normal_priority()
        try:
            while self._wait():
                self._write_frame()
                self._photograph()
        except RigError as error:  # a full disk ends the recording, not the show
            self.notes.append(f"recording stopped: {error}")

    def _wait(self) -> bool:
        """Until there is a frame, or time for a photograph; False at the end."""
        with self._changed:
            if self._details is None and not self._stopped:
                self._changed.wait(_IDLE_S)
            return self._details is not None or not self._stopped

    def _write_frame(self) -> None:
        if self._details is None:
            return
        name = f"shown-{self.frames:06d}.png"
        write_png(self._folder / name, self._codes, _PNG_COMPRESSION)
        self._journal.append({"event": "shown", "file": name, **self._details})
        self.frames += 1
        self._details = None

    def _photograph(self) -> None:
        """Once a second; the journal's times tell which pictures were on screen meanwhile."""
        now_s = self._clock.now_s()
        if self._camera is None or now_s - self._last_photograph_s < 1 / _PHOTOGRAPH_RATE_HZ or self._stopped:
            return
        self._last_photograph_s = now_s
        try:
            frame = self._camera.capture(after_s=now_s, timeout_s=1 / _PHOTOGRAPH_RATE_HZ)
        except CaptureTimeout:
            return
        except DeviceError as error:
            self.notes.append(f"no more photographs: {error}")
            self._camera = None
            return
        name = f"photograph-{self.photographs:06d}.exr"
        names = _CHANNELS[frame.pixels.shape[2]]
        write_exr(self._folder / name, {channel: frame.pixels[..., k] for k, channel in enumerate(names)})
        times = {"started_s": frame.started_s, "exposure_s": frame.exposure_s}
        self._journal.append({"event": "photograph", "file": name, **times})
        self.photographs += 1


def new_folder(folder: Path) -> Path:
    """Make a folder for a recording. Raises UsageError when it has files, SessionError when it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise UsageError(f"{folder}: has files already; give a new folder for the recording")
    except OSError as error:
        raise SessionError(f"{folder}: cannot be made: {error.strerror}; give another folder") from error
    return folder
