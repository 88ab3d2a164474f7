"""A recording in the place of the devices: a session's frames, or photographs that a manifest names.

Showing a pattern selects its frames by name, capturing returns them; nothing is made up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import Clock, Codes, ExposureRange, RawFrame, Shown, signature_of
from rig.devices.refusals import check_codes, check_exposure
from rig.devices.replay.photographs import Manifest, grey, read_photograph
from rig.errors import CaptureTimeout, DeviceLost, NotRecorded, SessionCorrupt, SettingRefused
from rig.files.atomic import sha256_of
from rig.files.exr import read_exr
from rig.files.journal import JOURNAL_NAME, corrupt_line, read_events
from rig.terminal.line import first_of

Pixels = NDArray[np.uint16]

_NEAR_EXPOSURE = 0.05
"""Relative; cameras round what they are asked for."""
_SHOWN_NAMES = 8
_SAME_PICTURE = 4
"""Codes by which block means of a picture may differ from the recorded one: rounding, dither."""


@dataclass(frozen=True, slots=True)
class RecordedFrame:
    """A frame that is read when it is asked for."""

    exposure_s: float | None
    """None when the recording does not say (photographs)."""
    read: Callable[[], Pixels]
    """(H, W, C) digital numbers."""
    signature: str = ""
    """Of the codes that were shown; empty when not known."""


RecordedFrames = Mapping[str, tuple[RecordedFrame, ...]]
"""By the pattern's name, in the order in which they were taken."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """What a camera saw of each pattern."""

    source: Path
    camera_shape: tuple[int, int, int]
    projector_shape: tuple[int, int]
    full_scale_dn: int
    exposure_range_s: ExposureRange
    frames: RecordedFrames


class ReplayProjector:
    """Takes the name of what is shown; accepts codes only of the recorded shape."""

    def __init__(self, recording: Recording, clock: Clock):
        self._recording = recording
        self._clock = clock
        self._open = False
        self.shown_name: str | None = None
        """What the camera sees."""

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width). [px]."""
        return self._recording.projector_shape

    def open(self) -> None:
        """Make ready; nothing is shown yet."""
        self._open = True

    def close(self) -> None:
        """Show nothing more."""
        self._open = False
        self.shown_name = None

    def show(self, codes: Codes, *, name: str) -> Shown:
        """Select the frames of pattern ``name``. Raises NotRecorded when the recording has none."""
        if not self._open:
            raise DeviceLost("the replayed projector is closed: open the rig before showing a picture")
        check_codes(codes, self.shape, "the recording was made with")
        if name not in self._recording.frames:
            raise NotRecorded(
                f"{self._recording.source}: the recording has no frame {name!r}; it has {self._known()}; record again, "
                "or give the settings, and the version of this program, that it was made with"
            )
        self._check_picture(codes, name)
        self.shown_name = name
        return Shown(self._clock.now_s(), name)

    def _check_picture(self, codes: Codes, name: str) -> None:
        known = {frame.signature for frame in self._recording.frames[name]} - {""}
        asked = np.frombuffer(bytes.fromhex(signature_of(codes)), np.uint8).astype(int)
        off = [int(np.abs(np.frombuffer(bytes.fromhex(s), np.uint8).astype(int) - asked).max()) for s in known]
        if off and min(off) > _SAME_PICTURE:
            raise DeviceLost(
                f"{self._recording.source}: {name!r} was recorded with another picture (block means differ by "
                f"{min(off)} codes, the limit is {_SAME_PICTURE}); use the target and settings of the recording"
            )

    def _known(self) -> str:
        return ", ".join(first_of(sorted(self._recording.frames), _SHOWN_NAMES))


class ReplayCamera:
    """Returns the recorded frames of what is shown, in their order; then the last one again."""

    def __init__(self, recording: Recording, projector: ReplayProjector, clock: Clock):
        self._recording = recording
        self._projector = projector
        self._clock = clock
        self._exposure_s = recording.exposure_range_s.shortest_s
        self._open = False
        self._sequence = 0
        self._used: dict[tuple[str, float], int] = {}

    @property
    def shape(self) -> tuple[int, int, int]:
        """(height, width, channels). [px]."""
        return self._recording.camera_shape

    @property
    def full_scale_dn(self) -> int:
        """The largest digital number."""
        return self._recording.full_scale_dn

    @property
    def exposure_range_s(self) -> ExposureRange:
        """Shortest and longest exposure."""
        return self._recording.exposure_range_s

    def open(self) -> None:
        """Make ready."""
        self._open = True

    def close(self) -> None:
        """Let go."""
        self._open = False

    def set_exposure(self, exposure_s: float) -> float:
        """Choose the recorded exposure next to it; photographs, which do not say theirs, count as of any.

        Raises SettingRefused outside the recorded camera's range, and when no recorded one is within 5 %.
        """
        self._check_open()
        check_exposure(exposure_s, self.exposure_range_s, "the recorded camera's")
        self._exposure_s = self._nearest(exposure_s)
        return self._exposure_s

    def _nearest(self, exposure_s: float) -> float:
        recorded_s = {f.exposure_s for frames in self._recording.frames.values() for f in frames}
        known_s = [exposure_s if recorded is None else recorded for recorded in recorded_s]
        nearest_s = min(known_s, key=lambda known: abs(known - exposure_s), default=exposure_s)
        if abs(nearest_s - exposure_s) > _NEAR_EXPOSURE * exposure_s:
            raise SettingRefused(
                f"{self._recording.source}: nothing was recorded at {exposure_s:.6g} s; the nearest is "
                f"{nearest_s:.6g} s"
            )
        return nearest_s

    def capture(self, *, after_s: float, timeout_s: float) -> RawFrame:
        """Return the next recorded frame of what is shown.

        Raises DeviceLost when there is none, CaptureTimeout when it would have ended later than allowed.
        """
        self._check_open()
        name = self._projector.shown_name
        if name is None:
            raise DeviceLost(
                f"{self._recording.source}: nothing is shown, so there is no frame; "
                "show a picture of the recording first"
            )
        started_s = max(after_s, self._clock.now_s())
        if started_s + self._exposure_s - self._clock.now_s() > timeout_s:
            self._clock.wait_until_s(self._clock.now_s() + timeout_s)
            raise CaptureTimeout(f"no frame within {timeout_s:g} s: the exposure would end later; allow more time")
        pixels = self._next(name).read()
        if pixels.shape != self.shape:
            raise DeviceLost(
                f"{self._recording.source}: frame {name!r} has shape {pixels.shape}, the profile's camera "
                f"{self.shape}; correct camera.width_px, height_px or channels"
            )
        self._clock.wait_until_s(started_s + self._exposure_s)
        self._sequence += 1
        return RawFrame(pixels=pixels, exposure_s=self._exposure_s, started_s=started_s, sequence=self._sequence)

    def _next(self, name: str) -> RecordedFrame:
        every = self._recording.frames[name]
        frames = [f for f in every if f.exposure_s in (None, self._exposure_s)]
        if not frames:
            known = ", ".join(f"{e:.6g}" for e in sorted({f.exposure_s or 0.0 for f in every}))
            raise DeviceLost(
                f"{self._recording.source}: the recording has {name!r} exposed {known} s, not {self._exposure_s:.6g} "
                "s; replay it with the settings that it was made with"
            )
        key = (name, self._exposure_s)
        index = self._used.get(key, 0)
        self._used[key] = index + 1
        return frames[min(index, len(frames) - 1)]

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceLost("the replayed camera is closed: open the rig before using it")


def recorded_frames(session: Path) -> dict[str, tuple[RecordedFrame, ...]]:
    """Frames of a recorded session by pattern, in the order of its journal; of each step the last run's.

    Raises SessionError when the folder is no session, SessionCorrupt when its journal is damaged.
    """
    journal = session / JOURNAL_NAME
    by_file: dict[str, tuple[str, str, RecordedFrame]] = {}
    for number, event in enumerate(read_events(journal), start=1):
        try:
            if event["event"] == "begin":
                by_file = {file: entry for file, entry in by_file.items() if entry[0] != event["step"]}
            elif event["event"] == "frame":
                frame, file = event["frame"], event["file"]
                read = partial(_read_frame, session / file, event["sha256"])
                recorded = RecordedFrame(frame["exposure_s"], read, frame.get("signature", ""))
                by_file[file] = (event["step"], frame["pattern"], recorded)
        except (KeyError, TypeError) as error:
            raise corrupt_line(journal, number) from error
    frames: dict[str, tuple[RecordedFrame, ...]] = {}
    for _, pattern, recorded in by_file.values():
        frames[pattern] = (*frames.get(pattern, ()), recorded)
    return frames


def _read_frame(path: Path, sha256: str) -> Pixels:
    """Return the frame's digital numbers. Raises SessionCorrupt when the file is not as it was recorded."""
    if path.is_file() and sha256_of(path) != sha256:
        raise SessionCorrupt(f"{path}: is not as it was recorded; restore it from a copy, or record it again")
    channels = read_exr(path)
    order = ("R", "G", "B") if "R" in channels else ("Y",)
    return np.dstack([channels[c] for c in order]).astype(np.uint16)


def photographed_frames(manifest: Manifest, channels: int) -> dict[str, tuple[RecordedFrame, ...]]:
    """Photographs by the pattern that they show; a grey camera sees their luma."""
    return {
        name: (RecordedFrame(None, partial(_read_photograph, path, channels)),)
        for name, path in manifest.frames.items()
    }


def _read_photograph(path: Path, channels: int) -> Pixels:
    photograph = read_photograph(path)
    pixels = grey(photograph)[..., None] if channels == 1 else photograph
    return pixels.astype(np.uint16)
