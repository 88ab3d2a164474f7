"""From photographs of projected patterns to lenses, poses, light and reflectance: arrays in, frozen records out.

Nothing here opens a device, reads a file or prints. A camera sees a projector's picture on walls:

>>> import numpy as np
>>> from calibration import CODES, flat, refine_subpixel
>>> projector_shape = (48, 64)
>>> code = CODES["long-run"]
>>> shown = {pattern.name: pattern.codes for pattern in code.patterns(projector_shape)}
>>> len(shown)
24

A camera that sees every projector pixel as two of its own, one level of light on black:

>>> def photograph(codes):
...     return 10.0 + 0.7 * np.kron(codes, np.ones((2, 2)))
>>> frames = {name: photograph(codes) for name, codes in shown.items()}
>>> white, black = (photograph(flat(projector_shape, level).codes) for level in (255, 0))
>>> found = code.decode(frames, projector_shape, white=white, black=black, noise_limit=5.0)
>>> found.projector_xy_px[20, 31].tolist()
[15.0, 10.0]
>>> bool(np.abs(refine_subpixel(found).projector_xy_px[20, 31] - [15.25, 9.75]).max() < 0.05)
True

From such correspondences, :func:`calibrate_stereo` finds both lenses, the relative pose and the walls; a tape measure
(:func:`scale_from_baseline`) gives metres, :func:`room_from_stereo` a room. :func:`fit_camera_response`,
:func:`fit_projector_response` and :func:`fit_photon_transfer` turn digital numbers into light with its noise,
:func:`separate` splits light into direct and global, and :func:`estimate_reflectance` finds what the walls reflect.
:func:`calibrate_lenses` finds the lenses from boards instead.

What cannot be determined raises :class:`CalibrationError`, whose message says what to try.
"""

from importlib import import_module as _import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.errors import CalibrationError
    from calibration.geometry.known.nominal import NominalIntrinsics
    from calibration.geometry.known.scale import scale_from_baseline
    from calibration.geometry.pinhole import PinholeModel
    from calibration.geometry.room import RoomBox, room_from_stereo
    from calibration.geometry.stereo import StereoCalibration, calibrate_stereo
    from calibration.geometry.triangulation import triangulate
    from calibration.lenses.calibrate import LensRequest, calibrate_lenses
    from calibration.lenses.records import BoardSightings
    from calibration.light.reflectance import estimate_reflectance
    from calibration.light.separation import separate
    from calibration.light.vignetting import fit_vignetting
    from calibration.radiometry.camera_response import fit_camera_response
    from calibration.radiometry.photon_transfer import fit_photon_transfer, transfer_points
    from calibration.radiometry.response import Response, fit_projector_response
    from calibration.structured_light.code import CODES, StructuredLightCode
    from calibration.structured_light.correspondence import Correspondence, PixelReason
    from calibration.structured_light.patterns import Pattern, checker_patterns, flat
    from calibration.structured_light.subpixel import refine_subpixel

__version__ = _version("procam-rig")

_HOMES = {
    "BoardSightings": "lenses.records",
    "CODES": "structured_light.code",
    "CalibrationError": "errors",
    "Correspondence": "structured_light.correspondence",
    "LensRequest": "lenses.calibrate",
    "NominalIntrinsics": "geometry.known.nominal",
    "Pattern": "structured_light.patterns",
    "PinholeModel": "geometry.pinhole",
    "PixelReason": "structured_light.correspondence",
    "Response": "radiometry.response",
    "RoomBox": "geometry.room",
    "StereoCalibration": "geometry.stereo",
    "StructuredLightCode": "structured_light.code",
    "calibrate_lenses": "lenses.calibrate",
    "calibrate_stereo": "geometry.stereo",
    "checker_patterns": "structured_light.patterns",
    "estimate_reflectance": "light.reflectance",
    "fit_camera_response": "radiometry.camera_response",
    "fit_photon_transfer": "radiometry.photon_transfer",
    "fit_projector_response": "radiometry.response",
    "fit_vignetting": "light.vignetting",
    "flat": "structured_light.patterns",
    "refine_subpixel": "structured_light.subpixel",
    "room_from_stereo": "geometry.room",
    "scale_from_baseline": "geometry.known.scale",
    "separate": "light.separation",
    "transfer_points": "radiometry.photon_transfer",
    "triangulate": "geometry.triangulation",
}
"""Where each public name lives."""

__all__ = [
    "CODES",
    "BoardSightings",
    "CalibrationError",
    "Correspondence",
    "LensRequest",
    "NominalIntrinsics",
    "Pattern",
    "PinholeModel",
    "PixelReason",
    "Response",
    "RoomBox",
    "StereoCalibration",
    "StructuredLightCode",
    "__version__",
    "calibrate_lenses",
    "calibrate_stereo",
    "checker_patterns",
    "estimate_reflectance",
    "fit_camera_response",
    "fit_photon_transfer",
    "fit_projector_response",
    "fit_vignetting",
    "flat",
    "refine_subpixel",
    "room_from_stereo",
    "scale_from_baseline",
    "separate",
    "transfer_points",
    "triangulate",
]


def __dir__() -> list[str]:
    return __all__


if not TYPE_CHECKING:
    # Each name is imported when it is first used: whoever needs one room of the package does not wait for all of scipy.
    def __getattr__(name):
        if name not in _HOMES:
            raise AttributeError(f"module 'calibration' has no attribute {name!r}")
        return getattr(_import_module(f"calibration.{_HOMES[name]}"), name)
