"""What is to be shown, and by which strategies: a picture of the user's, or one that ships with scikit-image."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig import plug_ins
from rig.errors import SessionCorrupt, SessionError, UsageError
from rig.files.channels import image_of
from rig.files.pictures import PictureLevels, fitted, in_channels, read_picture_in_channels, read_picture_of_shape
from rig.profile.schema import Profile
from rig.profile.target_table import TargetTable
from rig.records import Record
from rig.session import Session
from rig.stages.showing.cube import cube_layout

Float32Array = NDArray[np.float32]
_OFF_SHAPE = 0.01
"""By which a picture's width over height may be off: sizes are whole pixels."""
DEFAULT = "default"
"""In place of a target's file: the test picture, though the session has shown another one."""
_TEST_PICTURE = "photograph 'astronaut' of scikit-image, mean 123, sd 46"


@dataclass(frozen=True, kw_only=True)
class ShownTarget(Record):
    """What was to be seen."""

    name: str
    light: str
    """How its file was read: sRGB, linear light, or the colour space that it told."""
    lost_colours: bool
    """Its colours became grey, for the rig is grey."""
    placed: str = ""
    """Where it was wanted; empty: pixel by pixel of the projector."""

    @property
    def sentence(self) -> str:
        """The same in words."""
        where = f", {self.placed}" if self.placed else ""
        grey = "; it becomes grey: the camera is grey" * self.lost_colours
        return f"{self.name}, taken as {self.light}{where}{grey}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """A picture in grey levels, 0 … 255, linear light: of the projector's shape, or of any with where it is wanted."""

    name: str
    levels: Float32Array
    """(H, W, C); C = 1, or 3 in colour."""
    light: str = "linear light"
    """How the numbers of its file were read."""
    lost_colours: bool = False
    """Its file has colours, which a grey rig cannot show."""
    place: TargetTable | None = None
    """Where it is wanted; None: pixel by pixel of the projector (:func:`rig.stages.showing.place.placed`)."""
    words: str = ""
    """Where it was wanted, of one that was placed."""
    before_sha256: str = ""
    """Of the picture that was placed; empty: it was not."""

    @property
    def grey(self) -> Float32Array:
        """(H, W) luminance."""
        return in_channels(self.levels, 1)[..., 0]

    @property
    def shown(self) -> ShownTarget:
        """What records and pages say of it."""
        return ShownTarget(name=self.name, light=self.light, lost_colours=self.lost_colours, placed=self.words)

    @property
    def sha256(self) -> str:
        """Of the grey levels, and of where they are wanted."""
        where = b"" if self.place is None else json.dumps([self.place.placement, self.levels.shape]).encode()
        return hashlib.sha256(np.ascontiguousarray(self.levels).tobytes() + where).hexdigest()

    @property
    def asked_sha256(self) -> str:
        """The same of what was asked for, wherever it came to lie."""
        return self.before_sha256 or self.sha256


@dataclass(frozen=True, eq=False)
class CompensationRequest:
    """What is to be shown, and by which strategies."""

    target: Target
    strategies: tuple[str, ...]
    """Known names, `none` first (:func:`check_strategies`)."""


def requested_compensation(
    target: str | Path | None,
    strategies: tuple[str, ...],
    profile: Profile,
    *,
    fit: bool,
    is_linear: bool = False,
    place: TargetTable | None = None,
) -> CompensationRequest:
    """Read the picture that is to be shown, and check the names of the strategies.

    Parameters
    ----------
    target, fit, is_linear
        As for :func:`load_target`.
    strategies
        Names.
    profile
        Of the rig.
    place
        Where the picture is wanted; None: where the profile says.

    Raises what :func:`load_target` and :func:`check_strategies` raise.
    """
    names = check_strategies(strategies)
    place = profile.target if place is None else place
    shape, channels = profile.projector.shape, profile.camera.channels
    if place.placement is None:
        return CompensationRequest(load_target(target, shape, fit, channels=channels, is_linear=is_linear), names)
    picture = load_any_target(target, shape, channels=channels, is_linear=is_linear)
    check_shape(picture, place, profile.camera.shape[:2])
    return CompensationRequest(replace(picture, place=place, words=place.words), names)


def check_shape(picture: Target, place: TargetTable, camera_shape: tuple[int, int]) -> None:
    """Raise UsageError for a picture whose shape is not that of what it is said to be."""
    height, width = picture.levels.shape[:2]
    it = f"{picture.name}: {width} x {height} px"
    if place.placed == "panorama" and abs(width / height / 2 - 1) > _OFF_SHAPE:
        raise UsageError(f"{it}; an equirectangular panorama is twice as wide as it is high")
    if place.placed == "cube" and cube_layout((height, width)) is None:
        raise UsageError(
            f"{it}; a cube map is a cross of 4 x 3 squares, or a strip of six: right, left, up, down, front, back"
        )
    if place.placed == "camera" and abs(width / height / (camera_shape[1] / camera_shape[0]) - 1) > _OFF_SHAPE:
        raise UsageError(f"{it}; the camera sees {camera_shape[1]} x {camera_shape[0]} px: crop it to that shape")


def last_target(session: Session) -> Target | None:
    """Return the target that a session showed last, as it was; None where it showed none, or the test picture.

    Raises
    ------
    SessionCorrupt
        It is lost.
    """
    step = session.begun("compensate")
    if step is None or (settings := step.settings)["target"] == _TEST_PICTURE:
        return None
    try:
        levels = image_of(step.load_image("target-source" if settings.get("placement") else "target"), "grey")
    except SessionError as error:
        raise SessionCorrupt(
            f"{session.path}: its last target, {settings['target']}, is lost or was not written yet; name the picture "
            "again: --target FILE, or --target default for the test picture"
        ) from error
    shown = shown_target(settings)
    place = TargetTable.model_validate(settings["placement"]) if settings.get("placement") else None
    return Target(
        name=shown.name,
        levels=levels,
        light=shown.light,
        lost_colours=shown.lost_colours,
        place=place,
        words=shown.placed,
    )


def shown_target(settings: Mapping[str, Any]) -> ShownTarget:
    """Return what the settings of a step say of its target; older versions took all codes as linear light."""
    placement = settings.get("placement")
    return ShownTarget(
        name=str(settings["target"]),
        light=str(settings.get("light", "linear light")),
        lost_colours=bool(settings.get("lost_colours")),
        placed=TargetTable.model_validate(placement).words if placement else "",
    )


def check_strategies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return known strategies, `none` first, for it is what the others are measured against; `all` is every one.

    Raises UsageError for a name that is not known.
    """
    known = plug_ins.names("strategy", plug_ins.own_strategies())
    names = known if "all" in names else names
    unknown = [name for name in names if name not in known]
    if unknown:
        raise UsageError(f"unknown strategy {', '.join(unknown)}; there are {', '.join(known)}, or all")
    return ("none", *(name for name in dict.fromkeys(names) if name != "none"))


def load_target(
    path: str | Path | None,
    shape: tuple[int, int],
    fit: bool = False,
    *,
    channels: int = 1,
    is_linear: bool = False,
) -> Target:
    """Read a target. For a grey rig colour is turned to grey by Rec. 709 luminance; in colour, grey is a colour, too.

    Parameters
    ----------
    path
        Of the picture; None: a photograph that ships with scikit-image, with mean 123 and sd 46.
    shape
        (height, width) of the projector.
    fit
        Scale and crop a picture of another size.
    channels
        C of the target.
    is_linear
        As for :func:`rig.files.pictures.read_picture`.

    Raises
    ------
    UsageError
        The file is missing, unreadable, of another size (unless `fit`), too bright, or not finite.
    """
    if path is None or _is_test_picture(path):
        return Target(name=_TEST_PICTURE, levels=_astronaut(shape, channels))
    return _target(path, read_picture_of_shape(path, shape, channels=channels, fit=fit, is_linear=is_linear))


def load_any_target(
    path: str | Path | None, shape: tuple[int, int], *, channels: int, is_linear: bool = False
) -> Target:
    """Read a target of any size, as :func:`load_target` reads one of the projector's.

    Raises
    ------
    UsageError
        The file is missing, unreadable, too bright, or not finite.
    """
    if path is None or _is_test_picture(path):
        return Target(name=_TEST_PICTURE, levels=_astronaut(shape, channels))
    return _target(path, read_picture_in_channels(path, channels=channels, is_linear=is_linear))


def _is_test_picture(path: str | Path) -> bool:
    return str(path) == DEFAULT and not Path(path).exists()


def _target(path: str | Path, read: PictureLevels) -> Target:
    light = read.profile or ("linear light" if read.is_linear else "sRGB")
    return Target(name=Path(path).name, levels=read.levels, light=light, lost_colours=read.lost_colours)


@lru_cache(maxsize=4)
def _astronaut(shape: tuple[int, int], channels: int = 1) -> Float32Array:
    """Return a photograph (H, W, C) in the public domain that covers a shape, mean 123 and sd 46; read only.

    Iterates, since the range clips; mean and deviation count all channels together.
    """
    import skimage.data  # here, for it takes its time

    picture = np.asarray(skimage.data.astronaut(), dtype=np.float32)  # type: ignore[no-untyped-call]
    levels = fitted(in_channels(picture, channels), shape)
    for _ in range(30):
        levels = np.clip((levels - levels.mean()) / max(float(levels.std()), 1e-6) * 46.0 + 123.0, 0.0, 255.0)
    result: Float32Array = levels.astype(np.float32)
    result.flags.writeable = False
    return result
