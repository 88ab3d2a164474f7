"""What a camera with a sensor of its own sees of the simulated world, lit by what a display shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.mosaic import Mosaic
from rig.devices.protocols import Clock
from rig.devices.simulated.devices import sensor_response
from rig.devices.simulated.pair import SeenLight, SimulatedPair
from rig.emulated.watch import DisplayWatch, ReadableDisplay, ignore

Float32Array = NDArray[np.float32]
_KEPT_PICTURES = 6
"""Whose light is kept; chosen: an exposure sees one or two, and black and white come back often."""


class WorldView:
    """Photographs of a simulated world.

    Parameters
    ----------
    bands
        The world in each band of the camera.
    display
        What the projector shows; open.
    clock
        The machine's.
    mosaic
        Colour filters; None: all bands at each pixel.
    seed
        Of the sensor's noise.
    note
        Called with what is worth telling of the display.
    """

    def __init__(
        self,
        bands: Sequence[SimulatedPair],
        display: ReadableDisplay,
        clock: Clock,
        *,
        mosaic: Mosaic | None = None,
        seed: int = 0,
        note: Callable[[str], None] = ignore,
    ):
        self._world, self._clock, self._mosaic = bands[0], clock, mosaic
        self._seen = [SeenLight(world, _KEPT_PICTURES) for world in bands]
        self._display = DisplayWatch(display, self._world.projector.shape, clock, note)
        self._random = np.random.default_rng(seed)

    def photograph(
        self, exposure_s: float, full_scale_dn: int, *, gain: float = 1.0, black_dn: float = 0.0, gamma: float = 1.0
    ) -> NDArray[np.uint16]:
        """Expose from now on, and return (H, W, numbers a pixel) when it is over.

        Parameters
        ----------
        exposure_s
            How long.
        full_scale_dn
            The largest digital number.
        gain
            Factor of what the sensor counted.
        black_dn
            On top of the sensor's own black level.
        gamma
            Of the camera's curve y^(1 / gamma), where it is not that of the profile.
        """
        started_s = self._clock.now_s()
        light = np.zeros((*self._world.camera.shape, len(self._seen)), np.float32)
        for codes, share in self._display.during(started_s, started_s + exposure_s):
            light += np.float32(share) * np.stack([seen.of(codes) for seen in self._seen], axis=-1)
        if self._mosaic is not None:
            light = np.asarray(self._mosaic.seen(light), np.float32)
        settings = self._world.settings.camera
        update: dict[str, object] = {"black_level_dn": settings.black_level_dn + black_dn}
        if gamma != 1.0:
            update["tone"] = gamma
        noise = self._random.standard_normal(light.shape, dtype=np.float32)
        changed = settings.model_copy(update=update)
        return sensor_response(changed, light, exposure_s, full_scale_dn, noise=noise, gain=gain)
