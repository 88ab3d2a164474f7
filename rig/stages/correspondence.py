"""Which projector pixel each camera pixel sees: steps `gray` and `correspondence`.

Results say by name which camera and which projector they belong to, and allow any number. The steps of this version
serve one of each; :func:`only` is where they say so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.patterns import flat
from calibration.structured_light.subpixel import refine_subpixel
from rig.capture.rig import Rig
from rig.errors import SessionError
from rig.plug_ins import code_version, find_code
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.stages.radiometry import load_radiometric_calibration, reference_exposure_s
from rig.terminal import OnStep

Key = TypeVar("Key")
Value = TypeVar("Value")

_SIGMAS = 2.0
"""A bit counts when pattern and inverse differ by more than so many standard deviations of their noise.

An unlit pixel passes by chance in all of some twenty bits with a probability below 1e-20."""
_LEAST_VALID_SHARE = 0.01
"""Of the camera's pixels; with fewer there is nothing to fit lenses to."""


class DevicePair(NamedTuple):
    """A camera and a projector, by name."""

    camera: str
    projector: str


def pair_of(profile: Profile) -> DevicePair:
    """Return the only camera and the only projector of a profile."""
    return DevicePair(profile.camera.name, profile.projector.name)


def only(by_name: Mapping[Key, Value]) -> Value:
    """Return the single value of a mapping by device or by pair of devices. Raises SessionError for more."""
    values = list(by_name.values())
    if len(values) != 1:
        names = ", ".join(map(str, by_name)) or "none"
        raise SessionError(f"this version works with one camera and one projector; there are {names}")
    return values[0]


@dataclass(frozen=True, kw_only=True)
class PairCorrespondence(Record):
    """How much of one camera's picture has a pixel of one projector; the map itself is an image."""

    camera: str
    projector: str
    valid_share_of_image: float
    reasons: Mapping[str, float]
    """Share of the camera's pixels by reason, in the order of
    :class:`calibration.structured_light.correspondence.PixelReason`."""


@dataclass(frozen=True, kw_only=True)
class CorrespondenceRecord(Record):
    """What step `correspondence` found."""

    pairs: tuple[PairCorrespondence, ...]


def map_name(profile: Profile) -> str:
    """Return the name of the image that is the map of the only camera and the only projector."""
    return "-".join(("correspondence", *pair_of(profile)))


def gray_settings(session: Session) -> JsonObject:
    """Return what step `gray` depends on."""
    name = session.profile.patterns.code
    return {"code": name, "version": code_version(name), "exposures_s": json_of(_gray_bracket(session).exposures_s)}


def gray_frames(profile: Profile) -> int:
    """Return how many frames step `gray` takes."""
    return 2 + len(find_code(profile.patterns.code).pattern_names(profile.projector.shape))


def photograph_gray_code(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `gray`: white, black, and the patterns of the structured-light code."""
    shape = rig.projector.shape
    flats = (flat(shape, 255, "white"), flat(shape, 0, "black"))
    photograph(
        rig,
        session,
        step,
        chain(flats, find_code(rig.profile.patterns.code).patterns(shape)),
        bracket=_gray_bracket(session),
        n_patterns=gray_frames(rig.profile),
        on_step=on_step,
    )


def _gray_bracket(session: Session) -> ExposureBracket:
    return ExposureBracket((reference_exposure_s(session),))


def correspondence_settings(_: Session) -> JsonObject:
    """Return what step `correspondence` depends on."""
    return {"sigmas": _SIGMAS}


def decode_gray_code(session: Session, step: Step, on_step: OnStep) -> None:
    """Step `correspondence`: which projector pixel each camera pixel sees, and why some see none."""
    on_step("decode", 0, 2)
    profile = session.profile
    correspondence = _decode(session.finished("gray"), session, profile.projector.shape)
    valid_share = float(correspondence.valid.mean())
    if valid_share < _LEAST_VALID_SHARE:
        raise CalibrationError(
            f"only {100 * valid_share:.2f} % of the camera's pixels have a projector pixel, the limit is "
            f"{100 * _LEAST_VALID_SHARE:g} %: aim the camera at the projected picture, darken the room, check the focus"
        )
    on_step("decode", 1, 2)
    refined = refine_subpixel(correspondence)
    xy = refined.projector_xy_px
    channels = {"column": xy[..., 0], "row": xy[..., 1], "reason": refined.reason.astype(np.float32)}
    step.save_image(map_name(profile), channels, folder="maps")
    pair = PairCorrespondence(
        camera=profile.camera.name,
        projector=profile.projector.name,
        valid_share_of_image=valid_share,
        reasons={code.name.lower(): float((refined.reason == code).mean()) for code in PixelReason},
    )
    step.save_record("correspondence", CorrespondenceRecord(pairs=(pair,)))
    on_step("decode", 2, 2)


def _decode(gray: Step, session: Session, projector_shape: tuple[int, int]) -> Correspondence:
    radiometric = load_radiometric_calibration(session)
    code = find_code(session.profile.patterns.code)
    names = code.pattern_names(projector_shape)
    frames = {name: _grey(gray.load_frame(frame_name(name)).pixels, radiometric) for name in names}
    white, black = (gray.load_frame(frame_name(name)).pixels for name in ("white", "black"))
    limit = _SIGMAS * np.sqrt(2) * radiometric.sum_noise_dn(white, black)
    return code.decode(
        frames,
        projector_shape,
        white=_grey(white, radiometric),
        black=_grey(black, radiometric),
        noise_limit=limit,
        saturation=radiometric.saturation_dn * white.shape[2],
    )


def _grey(pixels: NDArray[np.uint16], radiometric: RadiometricCalibration) -> NDArray[np.unsignedinteger]:
    """(H, W) sum of the bands (H, W, B): the code is in each."""
    most = np.min_scalar_type(radiometric.full_scale_dn * pixels.shape[2])
    return np.asarray(pixels.sum(axis=2, dtype=np.promote_types(np.uint16, most)))


def load_correspondence(session: Session) -> Correspondence:
    """Return the finished step's map from the only camera to the only projector."""
    image = session.finished("correspondence").load_image(map_name(session.profile))
    xy = np.stack([image["column"], image["row"]], axis=-1)
    return Correspondence(xy, image["reason"].astype(np.uint8), session.profile.projector.shape)


def load_correspondence_figures(session: Session) -> PairCorrespondence:
    """Return how much of the only camera's picture has a pixel of the only projector."""
    return session.finished("correspondence").load_record("correspondence", CorrespondenceRecord).pairs[0]
