"""What the emulated camera sees: a display of this machine, read back, in the simulated room of a profile's world."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.devices.protocols import Clock
from rig.devices.simulated.devices import sensor_response
from rig.devices.simulated.pair import SeenLight, SimulatedPair
from rig.emulated.uvc.camera import FrameRequest
from rig.emulated.uvc.formats import encoded, full_scale_dn
from rig.emulated.watch import DisplayWatch, ReadableDisplay, ignore

Float32Array = NDArray[np.float32]

_KEPT_PICTURES = 6
"""Whose light is kept; chosen: an exposure sees one or two, and black and white come back often."""
_NOISE_FRAMES = 8


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
        self._display = DisplayWatch(display, world.projector.shape, clock, note)
        self._clock = clock
        self._prompt_s = prompt_s
        self._random = np.random.default_rng(seed)
        self._noise = self._random.standard_normal(_NOISE_FRAMES * self._n_pixels, dtype=np.float32)
        self._seen = SeenLight(world, _KEPT_PICTURES)
        self.late_frames = 0
        """Frames that were lost because the light took too long to compute."""

    def expose(self, request: FrameRequest) -> bytes | None:
        """Watch the display for the exposure, and return the frame's bytes; None when they come too late."""
        pictures = self._display.during(request.started_s, request.started_s + request.exposure_s)
        light = np.zeros(self._world.camera.shape, np.float32)
        for codes, share in pictures:
            light += np.float32(share) * self._seen.of(codes)
        frame = self._frame(light, request)
        late_s = self._clock.now_s() - request.started_s - request.exposure_s
        if late_s > self._prompt_s:
            self.late_frames += 1
            return None
        return frame

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
        full_scale = full_scale_dn(request.fourcc)
        noise = self._fresh_noise()
        pixels = sensor_response(settings, light, request.exposure_s, full_scale, noise=noise, gain=request.gain)
        return encoded(_sized(pixels, request), request.fourcc)


def _sized(pixels: NDArray[np.uint16], request: FrameRequest) -> NDArray[np.uint16]:
    """The sensor binned or enlarged to the size that the host asked for."""
    size = (request.width_px, request.height_px)
    if pixels.shape[::-1] == size:
        return pixels
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint16)
