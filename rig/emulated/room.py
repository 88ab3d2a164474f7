"""What the emulated camera sees: a display of this machine, read back, in the simulated room of a profile's world."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import Clock, Codes
from rig.devices.simulated.devices import sensor_response
from rig.devices.simulated.pair import SeenLight, SimulatedPair
from rig.emulated.uvc.camera import FrameRequest
from rig.emulated.uvc.formats import encoded, full_scale_dn
from rig.errors import CaptureTimeout, DeviceLost, SettingRefused

Float32Array = NDArray[np.float32]

_SAMPLE_S = 0.02
"""How often the display is looked at during an exposure."""
_KEPT_PICTURES = 6
"""Whose light is kept; chosen: an exposure sees one or two, and black and white come back often."""
_NOISE_FRAMES = 8


def ignore(_: str) -> None:
    """Stand for a listener where there is none."""


class ReadableDisplay(Protocol):
    """Something that shows a picture; :class:`rig.devices.kms.readback.Readback` is one."""

    def shape(self) -> tuple[int, int]:
        """(height, width) of what it shows now. Raises DeviceLost when it is dark."""
        ...

    def picture(self) -> Codes:
        """(H, W, 3) uint8 codes that are on screen now. Raises DeviceLost when it is dark."""
        ...


class RoomSource:
    """A camera's view of the simulated world's room, lit by what the display shows.

    Every frame that it gives shows what was on screen during its exposure, and is given promptly. The room's light
    for a picture that was not seen before takes a while to compute; frames are lost meanwhile, as by a camera that
    is busy. The display's latency is that of the real display, so that of the simulated world has to be 0.

    Parameters
    ----------
    world
        Room, lenses and response. Its shapes are those of camera and display.
    display
        Open.
    prompt_s
        A frame that is not ready so long after its exposure is not sent: it would look younger than it is.
    seed
        Of the sensor's noise.
    note
        Called with what is worth telling: a dark display, a picture of another size.
    """

    def __init__(
        self,
        world: SimulatedPair,
        display: ReadableDisplay,
        clock: Clock,
        *,
        prompt_s: float = 0.1,
        seed: int = 0,
        note: Callable[[str], None] = ignore,
    ):
        self._world = world
        self._display = display
        self._clock = clock
        self._prompt_s = prompt_s
        self._random = np.random.default_rng(seed)
        self._noise = self._random.standard_normal(_NOISE_FRAMES * self._n_pixels, dtype=np.float32)
        self._note = note
        self._noted = ""
        self._seen = SeenLight(world, _KEPT_PICTURES)
        self.late_frames = 0
        """Frames that were lost because the light took too long to compute."""

    def expose(self, request: FrameRequest) -> bytes | None:
        """Watch the display for the exposure, and return the frame's bytes; None when they come too late."""
        pictures = self._watch(request.started_s, request.started_s + request.exposure_s)
        light = np.zeros(self._world.camera.shape, np.float32)
        for codes, share in pictures:
            light += np.float32(share) * self._seen.of(codes)
        frame = self._frame(light, request)
        late_s = self._clock.now_s() - request.started_s - request.exposure_s
        if late_s > self._prompt_s:
            self.late_frames += 1
            return None
        return frame

    def _watch(self, started_s: float, ended_s: float) -> list[tuple[Codes, float]]:
        """Pictures on screen during an exposure, each with its share; a change is taken for halfway between looks."""
        looks: list[tuple[float, Codes]] = []
        until_s = started_s
        while True:
            self._clock.wait_until_s(until_s)
            looks.append((min(self._clock.now_s(), ended_s), self._look()))
            if until_s >= ended_s:
                break
            until_s = min(until_s + _SAMPLE_S, ended_s)
        times_s = [time_s for time_s, _ in looks]
        edges_s = [started_s, *((a + b) / 2 for a, b in pairwise(times_s)), ended_s]
        spans_s = [late - early for early, late in pairwise(edges_s)]
        return _merged([codes for _, codes in looks], [span_s / (ended_s - started_s) for span_s in spans_s])

    def _look(self) -> Codes:
        expected = self._world.projector.shape
        try:
            shape = self._display.shape()
            if shape == expected:
                codes = self._display.picture()
                self._tell("")
                return codes
            self._tell(f"the display shows {_size(shape)}, the room expects {_size(expected)}")
        except (DeviceLost, CaptureTimeout, SettingRefused) as error:
            self._tell(str(error))
        return np.zeros(expected, np.uint8)

    def _tell(self, text: str) -> None:
        """Once for each change."""
        if text != self._noted:
            self._noted = text
            if text:
                self._note(text)

    @property
    def _n_pixels(self) -> int:
        height, width = self._world.camera.shape
        return height * width

    def _fresh_noise(self) -> Float32Array:
        """Another piece of a long row of noise: quicker than to draw it anew, and no two pieces begin alike."""
        first = int(self._random.integers(len(self._noise) - self._n_pixels))
        return self._noise[first : first + self._n_pixels].reshape(self._world.camera.shape)

    def _frame(self, light: Float32Array, request: FrameRequest) -> bytes:
        settings = self._world.settings.camera
        gained = light * np.float32(request.gain)
        full_scale = full_scale_dn(request.fourcc)
        pixels = sensor_response(settings, gained, request.exposure_s, full_scale, noise=self._fresh_noise())
        return encoded(_sized(pixels, request), request.fourcc)


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[1]} x {shape[0]} px"


def _merged(pictures: list[Codes], shares: list[float]) -> list[tuple[Codes, float]]:
    """Equal neighbours as one."""
    merged: list[tuple[Codes, float]] = []
    for codes, share in zip(pictures, shares, strict=True):
        if merged and np.array_equal(merged[-1][0], codes):
            merged[-1] = (codes, merged[-1][1] + share)
        else:
            merged.append((codes, share))
    return [(codes, share) for codes, share in merged if share > 0]


def _sized(pixels: NDArray[np.uint16], request: FrameRequest) -> NDArray[np.uint16]:
    """The sensor binned or enlarged to the size that the host asked for."""
    size = (request.width_px, request.height_px)
    if pixels.shape[::-1] == size:
        return pixels
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint16)
