"""Which projector pixel each camera pixel sees: steps `gray` and `correspondence`.

Results say by name which camera and which projector they belong to, and allow any number. The steps of this version
serve one of each; :func:`only` is where they say so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import chain
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration.arrays import BoolArray
from calibration.errors import CalibrationError
from calibration.radiometry.response import Response
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.fewer_lights import filled_in, lights_for, with_lights
from calibration.structured_light.frames import NOISE_SIGMAS
from calibration.structured_light.gray import BOTH_AXES
from calibration.structured_light.patterns import Pattern, flat
from calibration.structured_light.stripe_width import blur_patterns
from rig.capture.rig import Rig
from rig.errors import SessionError
from rig.files.channels import one_or_all
from rig.plug_ins import code_version, find_code
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.light.exposure import reference_exposure_s
from rig.stages.light.places import finer_places
from rig.stages.linear_light import Codes, RadiometricCalibration, channel_codes
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.stripes.reading import INVERSE, has_inverses, in_dn, read_code
from rig.stages.stripes.width import ShownCode, as_named, shown_code, spoilt, stripe_blur, times_wanted
from rig.terminal import OnStep

Key = TypeVar("Key")
Value = TypeVar("Value")

_LEAST_VALID_SHARE = 0.01
"""Of the camera's pixels; with fewer there is nothing to fit lenses to."""
_PARTS, _MORE_PARTS = 2, 4
"""In which the rest of the projector's picture is lit then; more where less than half of the lit pixels was read."""
_DIRECT = 2.0
"""Noise limits by which a pattern and its inverse differ at the median where the projector's own light is seen."""
_EXTREMES = (0, 255)
"""Codes that are shown as they are: black and white."""


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
    averaged_px2: float = 0.0
    """Variance of the camera's window over which coordinates are means."""
    valid_share_at_first: float | None = None
    """Before patterns were shown again with fewer lights; None where they were not."""
    stripes_times: int = 1
    """How many times as wide as the code's own stripes were, because the lenses blur these away."""


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
    """Step `gray`: white, black, and the patterns of the structured-light code.

    Where blur has washed much out, the code is shown again with wider stripes; where light from other walls has spoilt
    much, on the pixels that are still open alone.
    """
    if not photograph_code_once(rig, session, step, on_step):
        return
    shape, shown = rig.projector.shape, shown_code(session, step)
    white, take = flat(shape, 255, "white"), _photographed(rig, session, step, on_step)
    for part, lights in enumerate(_lights_again(session, step, shown)):
        again = with_lights(chain((white,), _as_light(shown.code.patterns(shape), session)), lights)
        take(Pattern(shown.taken_as(pattern.name, part), pattern.codes) for pattern in again)


def photograph_flats(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Photograph white and black, the first two pictures of step `gray`: they tell whether the others are worth it."""
    _photographed(rig, session, step, on_step)(_flats(rig.projector.shape))


def photograph_code_once(rig: Rig, session: Session, step: Step, on_step: OnStep) -> bool:
    """Photograph white, black, and the patterns of the code; these with wider stripes, too, where they are too fine.

    Returns whether much was open after the first time.
    """
    shape, code = rig.projector.shape, as_named(session).code
    take = _photographed(rig, session, step, on_step)
    take(chain(_flats(shape), _as_light(code.patterns(shape), session)))
    found = _spoilt_reading(session, step)
    if found is None:
        return False
    take(_as_light(blur_patterns(shape), session))
    blur = stripe_blur(_frames_of(step, as_named(session)), session, load_radiometric_calibration(session))
    times = times_wanted(code, found, blur)
    if times > 1:
        on_step(f"stripes {times} times as wide, for the picture is blurred by {blur.sigma_px:.1f} px", 1, 1)
        wider = as_named(session, times)
        take(wider.renamed(_as_light(wider.code.patterns(shape), session)))
    return True


def _spoilt_reading(session: Session, step: Step) -> Correspondence | None:
    """What the code reads where many of the pixels that have to be lit stay open; else None."""
    shown = as_named(session)
    try:
        found = _read(session, step, shown)
    except CalibrationError:
        return None  # the step that decodes says what is wrong
    names = shown.code.pattern_names(session.profile.projector.shape)
    direct = _direct_light(_frames_of(step, shown), names, load_radiometric_calibration(session))
    return found if spoilt(found, found.reason != PixelReason.DARK if direct is None else direct) else None


def read_code_once(session: Session, step: Step) -> Correspondence:
    """Return the map of what :func:`photograph_code_once` took, between whole pixels where it can be."""
    shown = shown_code(session, step)
    return finer_places(_read(session, step, shown), shown.code, _frames_of(step, shown), session).correspondence


def _read(session: Session, step: Step, shown: ShownCode) -> Correspondence:
    shape, radiometric = session.profile.projector.shape, load_radiometric_calibration(session)
    return read_code(shown.code, _frames_of(step, shown), shape, radiometric)


def _flats(shape: tuple[int, int]) -> tuple[Pattern, Pattern]:
    return flat(shape, 255, "white"), flat(shape, 0, "black")


def _photographed(rig: Rig, session: Session, step: Step, on_step: OnStep) -> Callable[[Iterable[Pattern]], None]:
    """Return what takes the photographs of patterns that the step does not have yet."""
    bracket, n_patterns = _gray_bracket(session), gray_frames(rig.profile)
    return partial(photograph, rig, session, step, bracket=bracket, n_patterns=n_patterns, on_step=on_step)


def _lights_again(session: Session, step: Step, shown: ShownCode) -> list[BoolArray]:
    """Projector pixels to light when the patterns are shown again, part by part; none where little is spoilt."""
    shape, radiometric = session.profile.projector.shape, load_radiometric_calibration(session)
    frame = cache(_frames_of(step, shown))
    direct = _direct_light(frame, shown.code.pattern_names(shape), radiometric)
    if direct is None:
        return []
    try:
        first = read_code(shown.code, frame, shape, radiometric)
    except CalibrationError:
        return []  # the step that decodes says what is wrong
    return lights_for(first, _parts(first)) if spoilt(first, direct) else []


def _parts(first: Correspondence) -> int:
    lit = first.reason != PixelReason.DARK
    return _PARTS if 2 * first.valid.sum() >= lit.sum() else _MORE_PARTS


def _direct_light(
    frame: Callable[[str], NDArray[np.uint16]], names: Sequence[str], radiometric: RadiometricCalibration
) -> BoolArray | None:
    """(H, W) pixels that the projector lights itself: there patterns differ from their inverses by more than noise.

    What comes from other walls is much the same for a pattern of stripes and for its inverse. None for codes without
    inverses.
    """
    if not has_inverses(names):
        return None
    reading = in_dn((frame("white"), frame("black")), radiometric)
    pairs = [name for name in names if f"{name}{INVERSE}" in names]
    change = [
        np.abs(np.subtract(reading.read(frame(name)), reading.read(frame(f"{name}{INVERSE}")), dtype=np.float32))
        for name in pairs
    ]
    return np.asarray(np.median(change, axis=0) > _DIRECT * np.asarray(reading.noise_limit))


def _frames_of(step: Step, shown: ShownCode, part: int | None = None) -> Callable[[str], NDArray[np.uint16]]:
    """Return what gives a pattern's frame: with all lights on, or of a part with fewer."""
    return lambda name: step.load_frame(frame_name(shown.taken_as(name, part))).pixels


def _read_again(first: Correspondence, gray: Step, session: Session, shown: ShownCode) -> Correspondence:
    """Fill in what the patterns with fewer lights say, where they were shown."""
    if not gray.has_frame(frame_name(shown.taken_as("white", 0))):
        return first
    shape, radiometric = session.profile.projector.shape, load_radiometric_calibration(session)
    found = first
    for part, lights in enumerate(lights_for(first, _parts(first))):
        again = read_code(shown.code, _frames_of(gray, shown, part), shape, radiometric)
        found = filled_in(found, again, lights)
    return found


def _as_light(patterns: Iterable[Pattern], session: Session) -> Iterator[Pattern]:
    """Yield patterns in the codes that make their light on this projector: a code's grey levels are linear light."""
    table: Codes | None = None
    for pattern in patterns:
        if np.isin(pattern.codes, _EXTREMES).all():
            yield pattern
            continue
        if table is None:
            table = _code_of_light(load_radiometric_calibration(session).projector)
        yield Pattern(pattern.name, one_or_all(table[np.atleast_3d(pattern.codes), np.arange(table.shape[1])]))


def _code_of_light(projector: Sequence[Response]) -> Codes:
    """(256, channels) codes that make 0 … 255 parts of white's light."""
    levels = np.broadcast_to(np.arange(256)[:, None, None] / 255, (256, 1, len(projector)))
    return channel_codes(projector, levels, seed=None).reshape(256, -1)


def _gray_bracket(session: Session) -> ExposureBracket:
    return ExposureBracket((reference_exposure_s(session),))


def correspondence_settings(_: Session) -> JsonObject:
    """Return what step `correspondence` depends on."""
    return {"sigmas": NOISE_SIGMAS, "places": "by light"}


def decode_gray_code(session: Session, step: Step, on_step: OnStep) -> None:
    """Step `correspondence`: which projector pixel each camera pixel sees, and why some see none."""
    on_step("decode", 0, 2)
    profile = session.profile
    gray = session.finished("gray")
    shown = shown_code(session, gray)
    first = _read(session, gray, shown)
    correspondence = _read_again(first, gray, session, shown)
    valid_share = float(correspondence.valid.mean())
    if valid_share < _LEAST_VALID_SHARE:
        raise CalibrationError(
            f"only {100 * valid_share:.2f} % of the camera's pixels have a projector pixel, the limit is "
            f"{100 * _LEAST_VALID_SHARE:g} %: aim the camera at the projected picture, darken the room, check the focus"
        )
    on_step("decode", 1, 2)
    finer = finer_places(correspondence, shown.code, _frames_of(gray, shown), session)
    refined = finer.correspondence
    xy = refined.projector_xy_px
    channels = {"column": xy[..., 0], "row": xy[..., 1], "reason": refined.reason.astype(np.float32)}
    if refined.sigma_px is not None:
        channels |= {f"sigma_{axis}": refined.sigma_px[..., k] for k, axis in enumerate(BOTH_AXES)}
    step.save_image(map_name(profile), channels, folder="maps")
    pair = PairCorrespondence(
        camera=profile.camera.name,
        projector=profile.projector.name,
        valid_share_of_image=valid_share,
        reasons={code.name.lower(): float((refined.reason == code).mean()) for code in PixelReason},
        averaged_px2=finer.averaged_px2,
        valid_share_at_first=None if correspondence is first else float(first.valid.mean()),
        stripes_times=shown.times,
    )
    step.save_record("correspondence", CorrespondenceRecord(pairs=(pair,)))
    on_step("decode", 2, 2)


def load_correspondence(session: Session) -> Correspondence:
    """Return the finished step's map from the only camera to the only projector."""
    image = session.finished("correspondence").load_image(map_name(session.profile))
    xy = np.stack([image["column"], image["row"]], axis=-1)
    names = [f"sigma_{axis}" for axis in BOTH_AXES]
    sigma = np.stack([image[name] for name in names], axis=-1) if image.keys() >= set(names) else None
    return Correspondence(xy, image["reason"].astype(np.uint8), session.profile.projector.shape, sigma)


def load_correspondence_figures(session: Session) -> PairCorrespondence:
    """Return how much of the only camera's picture has a pixel of the only projector."""
    return session.finished("correspondence").load_record("correspondence", CorrespondenceRecord).pairs[0]
