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

from calibration import StructuredLightCode
from calibration.arrays import BoolArray, Frame
from calibration.errors import CalibrationError
from calibration.radiometry.response import Response
from calibration.structured_light.consistency.complements import refuse_stale_frames
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.fewer_lights import filled_in, lights_for, with_lights
from calibration.structured_light.frames import NOISE_SIGMAS
from calibration.structured_light.gray import BOTH_AXES
from calibration.structured_light.patterns import Pattern, flat
from rig.capture.rig import Rig
from rig.errors import SessionError
from rig.files.channels import one_or_all
from rig.plug_ins import code_version, find_code
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.light.exposure import reference_exposure_s
from rig.stages.light.places import finer_places
from rig.stages.linear_light import Codes, Float32Array, RadiometricCalibration, channel_codes
from rig.stages.photograph import ExposureBracket, frame_name, photograph
from rig.stages.radiometry import load_radiometric_calibration
from rig.terminal import OnStep

Key = TypeVar("Key")
Value = TypeVar("Value")

_LEAST_VALID_SHARE = 0.01
"""Of the camera's pixels; with fewer there is nothing to fit lenses to."""
_INVERSE = "-inverse"
_ROWS_HELD = 120
"""About so many rows, and columns as far apart, are held against stale frames."""
_MOST_SPOILT = 0.05
"""Of the pixels with direct light that have no projector pixel: from here on they are photographed again."""
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

    Where light from other walls has spoilt much, the patterns are shown again on the pixels that are still open.
    """
    photograph_code_once(rig, session, step, on_step)
    shape, code = rig.projector.shape, find_code(rig.profile.patterns.code)
    white, shown = flat(shape, 255, "white"), _photographed(rig, session, step, on_step)
    for part, lights in enumerate(_lights_again(session, step, code)):
        again = with_lights(chain((white,), _as_light(code.patterns(shape), session)), lights)
        shown(Pattern(_again_name(part, pattern.name), pattern.codes) for pattern in again)


def photograph_flats(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Photograph white and black, the first two pictures of step `gray`: they tell whether the others are worth it."""
    _photographed(rig, session, step, on_step)(_flats(rig.projector.shape))


def photograph_code_once(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Photograph white, black, and the patterns of the structured-light code, each once."""
    shape, code = rig.projector.shape, find_code(rig.profile.patterns.code)
    _photographed(rig, session, step, on_step)(chain(_flats(shape), _as_light(code.patterns(shape), session)))


def read_code_once(session: Session, step: Step) -> Correspondence:
    """Return the map of what :func:`photograph_code_once` took, between whole pixels where it can be."""
    code, radiometric = find_code(session.profile.patterns.code), load_radiometric_calibration(session)
    found = read_code(code, _frames_of(step), session.profile.projector.shape, radiometric)
    return finer_places(found, code, _frames_of(step), session).correspondence


def _flats(shape: tuple[int, int]) -> tuple[Pattern, Pattern]:
    return flat(shape, 255, "white"), flat(shape, 0, "black")


def _photographed(rig: Rig, session: Session, step: Step, on_step: OnStep) -> Callable[[Iterable[Pattern]], None]:
    """Return what takes the photographs of patterns that the step does not have yet."""
    bracket, n_patterns = _gray_bracket(session), gray_frames(rig.profile)
    return partial(photograph, rig, session, step, bracket=bracket, n_patterns=n_patterns, on_step=on_step)


def _again_name(part: int, pattern: str) -> str:
    return f"{pattern}-again-{part}"


def _lights_again(session: Session, step: Step, code: StructuredLightCode) -> list[BoolArray]:
    """Projector pixels to light when the patterns are shown again, part by part; none where little is spoilt."""
    shape, radiometric = session.profile.projector.shape, load_radiometric_calibration(session)
    names = code.pattern_names(shape)
    if not _has_inverses(names):
        return []
    frame = cache(_frames_of(step))
    try:
        first = read_code(code, frame, shape, radiometric)
    except CalibrationError:
        return []  # the step that decodes says what is wrong
    direct = _direct_light(frame, names, radiometric)
    spoilt = direct & ~first.valid & ~np.isin(first.reason, (PixelReason.DARK, PixelReason.SATURATED))
    if spoilt.sum() <= _MOST_SPOILT * direct.sum():
        return []
    return lights_for(first, _parts(first))


def _parts(first: Correspondence) -> int:
    lit = first.reason != PixelReason.DARK
    return _PARTS if 2 * first.valid.sum() >= lit.sum() else _MORE_PARTS


def _direct_light(
    frame: Callable[[str], NDArray[np.uint16]], names: Sequence[str], radiometric: RadiometricCalibration
) -> BoolArray:
    """(H, W) pixels that the projector lights itself: there patterns differ from their inverses by more than noise.

    What comes from other walls is much the same for a pattern of stripes and for its inverse.
    """
    reading = _Reading.of((frame("white"), frame("black")), partial(_grey, radiometric=radiometric), radiometric)
    pairs = [name for name in names if f"{name}{_INVERSE}" in names]
    change = [
        np.abs(np.subtract(reading.read(frame(name)), reading.read(frame(f"{name}{_INVERSE}")), dtype=np.float32))
        for name in pairs
    ]
    return np.asarray(np.median(change, axis=0) > _DIRECT * np.asarray(reading.noise_limit))


def _frames_of(step: Step, part: int | None = None) -> Callable[[str], NDArray[np.uint16]]:
    """Return what gives a pattern's frame: of the first time, or of a part with fewer lights (black stays black)."""

    def frame(name: str) -> NDArray[np.uint16]:
        taken = name if part is None or name == "black" else _again_name(part, name)
        return step.load_frame(frame_name(taken)).pixels

    return frame


def _read_again(first: Correspondence, gray: Step, session: Session, code: StructuredLightCode) -> Correspondence:
    """Fill in what the patterns with fewer lights say, where they were shown."""
    if not gray.has_frame(frame_name(_again_name(0, "white"))):
        return first
    shape, radiometric = session.profile.projector.shape, load_radiometric_calibration(session)
    found = first
    for part, lights in enumerate(lights_for(first, _parts(first))):
        found = filled_in(found, read_code(code, _frames_of(gray, part), shape, radiometric), lights)
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
    gray, code = session.finished("gray"), find_code(profile.patterns.code)
    first = read_code(code, _frames_of(gray), profile.projector.shape, load_radiometric_calibration(session))
    correspondence = _read_again(first, gray, session, code)
    valid_share = float(correspondence.valid.mean())
    if valid_share < _LEAST_VALID_SHARE:
        raise CalibrationError(
            f"only {100 * valid_share:.2f} % of the camera's pixels have a projector pixel, the limit is "
            f"{100 * _LEAST_VALID_SHARE:g} %: aim the camera at the projected picture, darken the room, check the focus"
        )
    on_step("decode", 1, 2)
    finer = finer_places(correspondence, code, _frames_of(gray), session)
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
    )
    step.save_record("correspondence", CorrespondenceRecord(pairs=(pair,)))
    on_step("decode", 2, 2)


def read_code(
    code: StructuredLightCode,
    frame: Callable[[str], NDArray[np.uint16]],
    projector_shape: tuple[int, int],
    radiometric: RadiometricCalibration,
) -> Correspondence:
    """Find the projector pixel that each camera pixel sees, to whole pixels where the code is one of whole pixels.

    Parameters
    ----------
    code
        That was shown.
    frame
        Gives the (H, W, B) frame of a pattern, of `white` and of `black`. [dn]
    projector_shape
        (height, width) that the patterns were made for. [px]
    radiometric
        Noise, saturation and response of the camera.

    Raises
    ------
    CalibrationError
        If frames are missing or their shapes differ, or one is stale: it shows another picture than it should.
    """
    names = code.pattern_names(projector_shape)
    flats = frame("white"), frame("black")
    table = radiometric.table()
    in_light = _Reading.of(flats, partial(_light, table=table), radiometric, table)
    if not _has_inverses(names):
        return in_light.decode(code, {name: in_light.read(frame(name)) for name in names}, projector_shape)
    in_dn = _Reading.of(flats, partial(_grey, radiometric=radiometric), radiometric)
    some = (slice(None, None, max(1, flats[0].shape[0] // _ROWS_HELD)),) * 2
    frames, thinned = dict[str, Frame](), {"white": in_light.white[some], "black": in_light.black[some]}
    for name in names:
        pixels = frame(name)
        frames[name], thinned[name] = in_dn.read(pixels), in_light.read(pixels[some])
    refuse_stale_frames(thinned, in_light.noise_limit[some], in_light.saturation)
    return in_dn.decode(code, frames, projector_shape)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Reading:
    """Frames (H, W, B) as a decoder takes them, (H, W), in a unit."""

    read: Callable[[NDArray[np.uint16]], Frame]
    white: Frame
    black: Frame
    noise_limit: NDArray[np.float64]
    saturation: float

    @classmethod
    def of(
        cls,
        flats: tuple[NDArray[np.uint16], NDArray[np.uint16]],
        read: Callable[[NDArray[np.uint16]], Frame],
        radiometric: RadiometricCalibration,
        table: Float32Array | None = None,
    ) -> _Reading:
        """Return how frames are read: in digital numbers, or in the light that a table gives for each."""
        white, black = flats
        limit = NOISE_SIGMAS * np.sqrt(2) * radiometric.sum_noise_dn(white, black)
        saturation: float = radiometric.saturation_dn
        if table is not None:
            limit *= np.gradient(table)[((white.astype(np.uint32) + black) // 2).max(axis=2)]
            saturation = float(table[radiometric.saturation_dn])
        return cls(
            read=read,
            white=read(white),
            black=read(black),
            noise_limit=limit,
            saturation=saturation * white.shape[2],
        )

    def decode(
        self, code: StructuredLightCode, frames: Mapping[str, Frame], projector_shape: tuple[int, int]
    ) -> Correspondence:
        """Decode frames that were read so."""
        return code.decode(
            frames,
            projector_shape,
            white=self.white,
            black=self.black,
            noise_limit=self.noise_limit,
            saturation=self.saturation,
        )


def _has_inverses(names: Sequence[str]) -> bool:
    """Tell whether each picture is held against its inverse, so that any response of the camera will do."""
    return all(name.endswith(_INVERSE) or f"{name}{_INVERSE}" in names for name in names)


def _light(pixels: NDArray[np.uint16], table: Float32Array) -> Float32Array:
    """(H, W) sum of the bands (H, W, B) in linear light."""
    return np.asarray(table[pixels].sum(axis=2), dtype=np.float32)


def _grey(pixels: NDArray[np.uint16], radiometric: RadiometricCalibration) -> NDArray[np.unsignedinteger]:
    """(H, W) sum of the bands (H, W, B): the code is in each."""
    most = np.min_scalar_type(radiometric.full_scale_dn * pixels.shape[2])
    return np.asarray(pixels.sum(axis=2, dtype=np.promote_types(np.uint16, most)))


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
