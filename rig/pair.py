"""One camera and one projector: the policy that stands above every back end.

A frame belongs to a pattern if its exposure began after the pattern was on screen plus the projector's
latency. Whatever is stale, repeated or malformed is rejected, noted and asked for again; nothing waits for a
fixed time.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np

from rig.back_ends import make_devices
from rig.devices.protocols import Camera, Clock, Codes, Projector, RawFrame
from rig.errors import CaptureTimeout, SettingRefused
from rig.profile import Profile, load_profile

_EXPOSURE_TOLERANCE = 0.01
"""Relative; a frame whose exposure differs by more is from before the camera took the setting over."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something that went wrong and was put right, or what the rig gave up on."""

    time_s: float
    """On the rig's clock."""
    kind: str
    """stale, repeated, malformed, exposure or timeout (it asked again); lost (only noted)."""
    detail: str


class NamedCodes(Protocol):
    """A pattern: codes and their name."""

    @property
    def name(self) -> str:
        """File-safe name."""
        ...

    @property
    def codes(self) -> Codes:
        """(H, W) or (H, W, 3) uint8."""
        ...


class Rig:
    """A pair of devices on one clock; use it in a ``with`` statement, which leaves the projector black.

    One thread at a time shoots; others wait.
    """

    def __init__(self, profile: Profile, camera: Camera, projector: Projector, clock: Clock):
        self.profile = profile
        self.camera = camera
        self.projector = projector
        self.clock = clock
        self.events: list[Event] = []
        self._lock = threading.RLock()
        self._exposure_s: float | None = None
        self._last_sequence: int | None = None

    def open(self) -> None:
        """Open both devices, or neither. Raises DeviceLost."""
        with self._lock, ExitStack() as undo:
            undo.callback(self.camera.close)
            self.camera.open()
            undo.callback(self.projector.close)
            self.projector.open()
            self._last_sequence = None
            undo.pop_all()

    def close(self) -> None:
        """Close both devices, each even if the other fails; any number of times."""
        with self._lock, ExitStack() as both:
            both.callback(self.camera.close)
            both.callback(self.projector.close)
            self._exposure_s = None

    def __enter__(self) -> Rig:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def set_exposure(self, exposure_s: float) -> float:
        """Ask for an exposure, and return the one the camera chose.

        Raises SettingRefused outside the camera's range.
        """
        with self._lock:
            shortest, longest = self.camera.exposure_range_s
            if not shortest <= exposure_s <= longest:
                raise SettingRefused(
                    f"exposure {exposure_s:.6g} s is outside the camera's {shortest:g} … {longest:g} s"
                )
            chosen_s = self.camera.set_exposure(exposure_s)
            self._exposure_s = chosen_s
            return chosen_s

    def shoot(self, codes: Codes, *, name: str, exposure_s: float | None = None) -> RawFrame:
        """Show codes and return the first good frame that was exposed to them.

        Parameters
        ----------
        codes
            uint8 of exactly the projector's shape, (H, W) or (H, W, 3).
        name
            The pattern's name; a replay finds its frames by it.
        exposure_s
            Default: as last set.

        Raises
        ------
        SettingRefused
            Codes or exposure are not possible.
        CaptureTimeout
            No good frame in ``1 + timing.retries`` attempts.
        DeviceLost
            A device is closed or gone.
        """
        with self._lock:
            self._check_codes(codes)
            if exposure_s is not None and exposure_s != self._exposure_s:
                self.set_exposure(exposure_s)
            shown = self.projector.show(codes, name=name)
            return self._first_good_frame(name, shown.on_screen_s + self.profile.projector.latency_s)

    def shoot_all(self, patterns: Iterable[NamedCodes]) -> Iterator[RawFrame]:
        """Shoot patterns one after the other, each when the iterator asks for it."""
        for pattern in patterns:
            yield self.shoot(pattern.codes, name=pattern.name)

    def _check_codes(self, codes: Codes) -> None:
        shape = self.projector.shape
        if codes.dtype != np.uint8 or codes.shape not in (shape, (*shape, 3)):
            raise SettingRefused(
                f"the projector shows uint8 codes of shape {shape}, not {codes.dtype} of {codes.shape}; "
                "make the picture in exactly its size"
            )

    def _first_good_frame(self, name: str, settled_s: float) -> RawFrame:
        timing = self.profile.timing
        first_event = len(self.events)
        for _ in range(1 + timing.retries):
            try:
                frame = self.camera.capture(after_s=settled_s, timeout_s=timing.timeout_s)
            except CaptureTimeout as error:
                self._note("timeout", f"{name}: {error}")
                continue
            if self._is_good(name, frame, settled_s):
                return frame
        kinds = sorted({event.kind for event in self.events[first_event:]} - {"lost"})
        raise CaptureTimeout(
            f"no good frame of {name!r} in {1 + timing.retries} attempts of {timing.timeout_s:g} s "
            f"({', '.join(kinds)}); last: {self.events[-1].detail}; check cable and timing.timeout_s"
        )

    def _is_good(self, name: str, frame: RawFrame, settled_s: float) -> bool:
        problem = self._repeated(frame) or self._malformed(frame) or self._wrong_time(frame, settled_s)
        self._last_sequence = max(frame.sequence, self._last_sequence or 0)
        if problem is not None:
            self._note(problem[0], f"{name}: {problem[1]}")
        return problem is None

    def _repeated(self, frame: RawFrame) -> tuple[str, str] | None:
        last = self._last_sequence
        if last is None or frame.sequence == last + 1:
            return None
        if frame.sequence <= last:
            return "repeated", f"frame {frame.sequence} came after frame {last}"
        self._note("lost", f"{frame.sequence - last - 1} frames before frame {frame.sequence}")
        return None

    def _malformed(self, frame: RawFrame) -> tuple[str, str] | None:
        pixels, shape = frame.pixels, self.camera.shape
        if pixels.dtype != np.uint16 or pixels.shape != shape:
            return "malformed", f"frame of {pixels.dtype} {pixels.shape}, expected uint16 {shape}"
        brightest = int(pixels.max())
        if brightest > self.camera.full_scale_dn:
            return "malformed", f"pixel of {brightest} dn, full scale is {self.camera.full_scale_dn} dn"
        return None

    def _wrong_time(self, frame: RawFrame, settled_s: float) -> tuple[str, str] | None:
        if not frame.started_s >= settled_s:
            return (
                "stale",
                f"exposure began {(settled_s - frame.started_s) * 1e3:.1f} ms before the picture settled",
            )
        set_s = self._exposure_s
        if set_s is not None and not abs(frame.exposure_s - set_s) <= _EXPOSURE_TOLERANCE * set_s:
            return "exposure", f"exposed {frame.exposure_s:.6g} s, set {set_s:.6g} s"
        return None

    def _note(self, kind: str, detail: str) -> None:
        self.events.append(Event(self.clock.now_s(), kind, detail))


def open_rig(profile: Profile | str | Path, *, resume_at_s: float = 0.0) -> Rig:
    """Open the devices that a profile describes.

    Parameters
    ----------
    profile
        A profile, its file, or the bare name of one in ``hw_profiles``.
    resume_at_s
        Where virtual clocks start: ``session.last_clock_s`` when a session goes on.

    Returns
    -------
    The rig, open, its exposure at ``camera.exposure_s``; use it in a ``with`` statement, or close it.

    Raises
    ------
    ProfileError
        The profile cannot be used.
    DeviceError
        A device does not open.
    """
    if not isinstance(profile, Profile):
        profile = load_profile(profile)
    rig = Rig(profile, *make_devices(profile, resume_at_s))
    with ExitStack() as undo:
        undo.callback(rig.close)
        rig.open()
        rig.set_exposure(profile.camera.exposure_s)
        undo.pop_all()
    return rig
