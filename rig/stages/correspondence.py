"""Which projector pixel each camera pixel sees: steps `gray` and `correspondence`.

Results say by name which camera and which projector they belong to, and allow any number. The steps of this version
serve one of each; :func:`only` is where they say so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from calibration.errors import CalibrationError
from calibration.structured_light.correspondence import Correspondence, PixelReason
from calibration.structured_light.frames import NOISE_SIGMAS
from calibration.structured_light.gray import BOTH_AXES
from calibration.structured_light.orientation import without_mirrored
from calibration.structured_light.patterns import Pattern, flat
from rig.capture.rig import Rig
from rig.errors import SessionError
from rig.plug_ins import code_version, find_code
from rig.profile.schema import Profile
from rig.records import JsonObject, Record, json_of
from rig.session import Session, Step
from rig.stages.light.exposure import reference_exposure_s
from rig.stages.light.places import finer_places
from rig.stages.photograph import ExposureBracket, OneCount, frame_name, photograph
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.stripes.showing import CodePhotographs, as_light, photograph_code, photograph_in_parts, read_in_parts
from rig.stages.stripes.stillness import photograph_white_after, read_standing, whites_after
from rig.stages.stripes.superposition import superposition_percent
from rig.stages.stripes.width import shown_code
from rig.terminal import OnStep

Key = TypeVar("Key")
Value = TypeVar("Value")

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
        raise SessionError(
            f"this version works with one camera and one projector, there are {names}; take the others from the profile"
        )
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
    superposition_percent: float | None = None
    """Of white: by how much more light patterns have with their inverses than white has; None where nobody could tell.
    """


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
    patterns = find_code(profile.patterns.code).pattern_names(profile.projector.shape)
    return 2 + len(patterns) + whites_after(patterns)


def photograph_gray_code(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Step `gray`: white, black, and the patterns of the structured-light code; white again if none is an inverse.

    Where blur has washed much out, the code is shown again with wider stripes; where light from other walls has spoilt
    much, on the pixels that are still open alone.
    """
    by = _photographs(session, step, _photographed(rig, session, step, on_step))
    shown = photograph_code(by, on_step)
    photograph_white_after(by)
    if shown is not None:
        photograph_in_parts(by, shown)


def photograph_flats(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Photograph white and black, the first two pictures of step `gray`: they tell whether the others are worth it."""
    _photographed(rig, session, step, on_step)(_flats(rig.projector.shape))


def photograph_code_once(rig: Rig, session: Session, step: Step, on_step: OnStep) -> None:
    """Photograph white, black, and the patterns of the code; these with wider stripes, too, where they are too fine."""
    by = _photographs(session, step, _photographed(rig, session, step, on_step))
    photograph_code(by, on_step)
    photograph_white_after(by)


def _photographs(session: Session, step: Step, take: Callable[[Iterable[Pattern]], None]) -> CodePhotographs:
    return CodePhotographs(
        profile=session.profile,
        radiometric=load_radiometric_calibration(session),
        take=lambda patterns: take(_as_light(patterns, session)),
        frame=lambda name: step.load_frame(frame_name(name)).pixels,
    )


def read_code_once(session: Session, step: Step) -> Correspondence:
    """Return the map of what :func:`photograph_code_once` took, between whole pixels where it can be."""
    shown, by = shown_code(session, step), _photographs(session, step, _none_more)
    return finer_places(read_standing(by, shown), shown.code, by.of(shown), session).correspondence


def _none_more(_: Iterable[Pattern]) -> None:
    """Take no photographs: they were taken before."""


def _flats(shape: tuple[int, int]) -> tuple[Pattern, Pattern]:
    return flat(shape, 255, "white"), flat(shape, 0, "black")


def _photographed(rig: Rig, session: Session, step: Step, on_step: OnStep) -> Callable[[Iterable[Pattern]], None]:
    """Return what takes the photographs of patterns that the step does not have yet."""
    bracket, n_patterns, count = _gray_bracket(session), gray_frames(rig.profile), OneCount(on_step)
    some = partial(photograph, rig, session, step, bracket=bracket, n_patterns=n_patterns)
    return lambda patterns: count.take(lambda told: some(patterns, on_step=told))


def _as_light(patterns: Iterable[Pattern], session: Session) -> Iterator[Pattern]:
    """Yield patterns in the codes that make their light on this session's projector."""
    return as_light(patterns, lambda: load_radiometric_calibration(session).projector)


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
    by = _photographs(session, gray, _none_more)
    first = read_standing(by, shown)
    again = gray.has_frame(frame_name(shown.taken_as("white", 0)))
    correspondence = read_in_parts(by, first, shown) if again else first
    valid_share = float(correspondence.valid.mean())
    if valid_share < _LEAST_VALID_SHARE:
        raise CalibrationError(
            f"only {100 * valid_share:.2f} % of the camera's pixels have a projector pixel, the limit is "
            f"{100 * _LEAST_VALID_SHARE:g} %: aim the camera at the projected picture, darken the room, check the focus"
        )
    on_step("decode", 1, 2)
    finer = finer_places(correspondence, shown.code, by.of(shown), session)
    refined = without_mirrored(finer.correspondence)
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
        superposition_percent=superposition_percent(by, shown),
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
