"""The emulated GigE camera of a profile: what its sensor is, and that it looks at the profile's simulated world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from calibration.radiometry.mosaic import Mosaic
from rig.devices.clock import SystemClock
from rig.devices.genicam.find import is_address
from rig.devices.genicam.formats import PIXEL_FORMATS
from rig.devices.protocols import Clock
from rig.devices.simulated.rigs import simulated_worlds_of
from rig.emulated.gige.camera import ADDRESS, EmulatedGigeCamera, GigeRequest, encoded
from rig.emulated.gige.description import EmulatedSensor
from rig.emulated.gige.wire import PulseWire
from rig.emulated.view import WorldView
from rig.emulated.watch import ReadableDisplay, ignore
from rig.errors import ProfileError
from rig.profile.schema import Profile

_KINDS = ("8", "10", "12", "16", "10Packed", "12Packed", "10p", "12p")
_FILTERS = {"RGGB": "BayerRG", "GRBG": "BayerGR", "GBRG": "BayerGB", "BGGR": "BayerBG"}
_BLACK_STEPS = 255
"""Of the feature BlackLevel over the full scale."""


@dataclass(frozen=True, slots=True)
class _WorldOverGige:
    """The world, in the formats of a GigE camera."""

    view: WorldView

    def expose(self, request: GigeRequest) -> bytes:
        """Photograph, and return the bytes of the format."""
        full_scale = 2 ** PIXEL_FORMATS[request.pixel_format].depth - 1
        pixels = self.view.photograph(
            request.exposure_s,
            full_scale,
            gain=request.gain,
            black_dn=request.black_level_dn * full_scale / _BLACK_STEPS,
            gamma=request.gamma,
        )
        height, width = request.shape
        return encoded(pixels[:height, :width], request.pixel_format)


def sensor_of(profile: Profile) -> EmulatedSensor:
    """Return what the emulated camera of a profile is. Raises ProfileError for a format that it cannot have."""
    camera = profile.camera
    first = camera.pixel_format or "Mono12"
    known = PIXEL_FORMATS.get(first)
    if known is None or known.mosaic != camera.mosaic:
        fitting = ", ".join(name for name, one in PIXEL_FORMATS.items() if one.mosaic == camera.mosaic)
        raise ProfileError(
            f"{profile.path}: camera.pixel_format: {first!r} is no format of the emulated camera; with this mosaic it "
            f"has {fitting}"
        )
    if known.numbers == 1:
        begin = "Mono" if camera.mosaic is None else _FILTERS[camera.mosaic]
        formats = dict.fromkeys([first, *(begin + kind for kind in _KINDS)])
    else:
        formats = dict.fromkeys([first, "RGB8", "BGR8"])
    return EmulatedSensor(
        width_px=camera.width_px,
        height_px=camera.height_px,
        formats=tuple(formats),
        exposure_range_s=camera.exposure_range_s,
    )


def gige_camera_of(
    profile: Profile, display: ReadableDisplay, clock: Clock | None = None, note: Callable[[str], None] = ignore
) -> EmulatedGigeCamera:
    """Return the emulated camera of a profile, not plugged in yet.

    Parameters
    ----------
    profile
        With a [simulation]; ``camera.device_id`` is its address on loopback, or ``gige-SERIAL``.
    display
        What the projector shows.
    clock
        The machine's.
    note
        Called with what is worth telling.

    Raises
    ------
    ProfileError
        It has no simulation, or a format that cannot be emulated.
    """
    camera, clock = profile.camera, clock or SystemClock()
    mosaic = None if camera.mosaic is None else Mosaic(camera.mosaic)
    view = WorldView(simulated_worlds_of(profile), display, clock, mosaic=mosaic, note=note)
    given = camera.device_id or ADDRESS
    return EmulatedGigeCamera(
        _WorldOverGige(view),
        sensor_of(profile),
        serial="EMULATED1" if is_address(given) else given.removeprefix("gige-"),
        address=given if is_address(given) else ADDRESS,
        wait=lambda seconds: clock.wait_until_s(clock.now_s() + seconds),
        wire=PulseWire(profile.projector.refresh_rate_hz, clock),
        note=note,
    )
