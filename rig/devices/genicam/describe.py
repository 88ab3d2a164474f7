"""What a GigE or USB3 camera can do, asked of the camera."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass

from rig.devices.genicam.aravis import aravis
from rig.devices.genicam.features import EXPOSURES, Features
from rig.devices.genicam.find import FoundGenicam
from rig.devices.genicam.formats import PIXEL_FORMATS
from rig.devices.genicam.setup import MICROSECONDS, connected
from rig.devices.protocols import ExposureRange

_ENDS = ("12", "12p", "12Packed", "16", "10", "10p", "10Packed", "8")
"""Of formats' names, best first: twelve bits as they are before sixteen, which many cameras fill with twelve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GenicamAbilities:
    """What a rig wants to know of a camera."""

    pixel_formats: tuple[str, ...]
    """Those that are understood, best first."""
    width_px: int
    height_px: int
    frame_rate_hz: float | None
    """At most; None where it does not say."""
    exposure_range_s: ExposureRange | None
    """None where the exposure cannot be set."""


def describe_genicam(found: FoundGenicam) -> GenicamAbilities:
    """Ask a camera what it can do, and let it go. Raises DeviceLost, DeviceBusy, DeviceError."""
    with ExitStack() as undo:
        camera = connected(found.address if found.is_gige else found.device_id, f"camera {found.device_id}")
        undo.callback(aravis().call, "g_object_unref", camera)
        features = Features(aravis().call("arv_camera_get_device", camera), f"camera {found.device_id}")
        exposure = features.first_of(EXPOSURES)
        rate = features.first_of(("AcquisitionFrameRate", "AcquisitionFrameRateAbs"))
        return GenicamAbilities(
            pixel_formats=tuple(sorted(filter(PIXEL_FORMATS.get, features.entries("PixelFormat")), key=_rank)),
            width_px=_largest(features, "Width"),
            height_px=_largest(features, "Height"),
            frame_rate_hz=None if rate is None else features.bounds(rate)[1],
            exposure_range_s=None if exposure is None else _seconds(features.bounds(exposure)),
        )


def _rank(name: str) -> tuple[bool, bool, int]:
    """Grey first, then a mosaic, then colours that the camera has computed."""
    known = PIXEL_FORMATS[name]
    end = next((k for k, text in enumerate(_ENDS) if name.removeprefix("Mono") == text or name[7:] == text), len(_ENDS))
    return known.numbers != 1, known.mosaic is not None, end


def _largest(features: Features, name: str) -> int:
    sensor = features.first_of((f"{name}Max", f"Sensor{name}", name))
    return round(features.number(sensor or name))


def _seconds(bounds: tuple[float, float]) -> ExposureRange:
    return ExposureRange(*(one / MICROSECONDS for one in bounds))
