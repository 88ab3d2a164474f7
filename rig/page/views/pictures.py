"""Pictures of a session for the page: maps and photographs to look at, and pictures as numbers to put side by side."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rig.errors import SessionError
from rig.files.channels import codes_of, image_of
from rig.files.exr import read_exr
from rig.files.pictures import png_of
from rig.records import Record
from rig.report import pictures
from rig.report.export import layer_picture
from rig.session import Session
from rig.stages.compensation import load_compensation
from rig.stages.correspondence import map_name
from rig.stages.model import load_model

_SCALE = 16
"""Numbers of pictures are sent in sixteenths of a grey level: finer than any difference that matters."""
_WIDEST_PX = 1920
_BRIGHTEST = 0.999
_MOST, _OUTSIDE = 32767, -32768
"""The largest number; and where a picture has none."""
_PLACES = ("column", "row")
"""Maps that can be asked for as numbers, too: projector pixels."""

Levels = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class NamedPicture(Record):
    """A picture that can be asked for."""

    name: str
    title: str


_MAPS: tuple[tuple[str, str, str, str], ...] = (
    ("column", "correspondence", "column", "Projector column that each camera pixel sees"),
    ("row", "correspondence", "row", "Projector row that each camera pixel sees"),
    ("reason", "correspondence", "reason", "Why a pixel is or is not used"),
    ("white", "separation", "white", "Light of projector white"),
    ("direct", "separation", "direct", "Reflected once"),
    ("global", "separation", "global", "Reflected more than once"),
)
"""Name, step, layer and title, in the order in which they come."""


def maps_of(folder: Path) -> tuple[NamedPicture, ...]:
    """Return the maps that a session has so far."""
    session = Session.read(folder)
    return tuple(NamedPicture(name=name, title=title) for name, step, _, title in _MAPS if session.is_finished(step))


def map_png(folder: Path, name: str) -> bytes:
    """Return a map as PNG. Raises SessionError when it is not there (yet)."""
    session = Session.read(folder)
    known = {entry[0]: entry for entry in _MAPS}
    if name not in known:
        raise SessionError(f"{name[:40]!r} is no map; there are {', '.join(known)}")
    _, step, layer, _ = known[name]
    image = map_name(session.profile) if step == "correspondence" else "separation"
    channels = session.finished(step).load_image(image)
    codes, _ = layer_picture(layer, image_of(channels, layer), channels)
    return png_of(codes, 3)


def last_frame_jpeg(folder: Path, file: str) -> bytes:
    """Return a photograph of a session as JPEG, its brightest as white."""
    level = np.mean(list(read_exr(folder / file).values()), axis=0)
    brightest = max(1.0, float(np.quantile(level, _BRIGHTEST)))
    shown = pictures.photograph(255 * level / brightest)
    return cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


@dataclass(frozen=True, eq=False)
class _ComparableSource:
    """A picture that can be compared, and how to read it."""

    picture: NamedPicture
    read: Callable[[], Levels]
    """(H, W, B) grey levels of 255."""


def comparable(folder: Path) -> tuple[NamedPicture, ...]:
    """Return the pictures of a session that lie on the camera's pixels in one scale: target, predicted, measured."""
    return tuple(source.picture for source in _sources(Session.read(folder)))


def levels_of(folder: Path, name: str) -> bytes:
    """Return a picture as numbers: width, height, bands, scale (4 × uint32), then int16, all little end first.

    A number over the scale is a grey level of 255 in linear light, of ``column`` and ``row`` a projector pixel;
    -32768 is none. Pixels outside the judged ones keep
    their numbers; the picture ``mask`` says which are judged.

    Raises
    ------
    SessionError
        There is no such picture.
    """
    journal = folder / "journal.jsonl"
    return _levels_of(folder, name, journal.stat().st_mtime_ns if journal.is_file() else 0)


@lru_cache(maxsize=24)
def _levels_of(folder: Path, name: str, _changed: int) -> bytes:
    session = Session.read(folder)
    if name in _PLACES:
        image = session.finished("correspondence").load_image(map_name(session.profile))
        return packed_levels(np.where(image["reason"] == 0, image[name], np.nan)[..., None])
    for source in _sources(session):
        if source.picture.name == name:
            return packed_levels(source.read())
    raise SessionError(f"{name[:40]!r} is no picture of {folder.name}; ask for its list first")


def packed_levels(levels: Levels) -> bytes:
    """Return (H, W, B) grey levels as :func:`levels_of` says."""
    _, width, bands = levels.shape
    step, finite = -(-width // _WIDEST_PX), levels[np.isfinite(levels)]
    most = float(np.abs(finite).max()) if finite.size else 1.0
    scale = max(1, min(_SCALE, int(_MOST / max(most, 1.0))))
    scaled = np.clip(np.rint(levels[::step, ::step] * scale), -_MOST, _MOST)
    numbers = np.where(np.isfinite(scaled), scaled, _OUTSIDE).astype("<i2")
    return struct.pack("<IIII", numbers.shape[1], numbers.shape[0], bands, scale) + numbers.tobytes()


def _sources(session: Session) -> list[_ComparableSource]:
    if not session.is_finished("compare"):
        return []
    judged = session.finished("compare").load_image("judged")
    scale = np.float32(255 / load_model(session).level)
    found = [
        _ComparableSource(NamedPicture(name="target", title="target"), lambda: image_of(judged, "target")),
        _ComparableSource(NamedPicture(name="mask", title="judged pixels"), lambda: image_of(judged, "mask") * 255),
    ]
    for name in load_compensation(session).strategies:
        found += _of_strategy(session, name, scale)
    return found


def _of_strategy(session: Session, name: str, scale: np.float32) -> Sequence[_ComparableSource]:
    def predicted() -> Levels:
        return image_of(session.finished("compensate").load_image(f"predicted-{name}"), "light") * scale

    def measured() -> Levels:
        return image_of(session.finished("compare").load_image(f"measured-{name}"), "light") * scale

    return (
        _ComparableSource(NamedPicture(name=f"measured-{name}", title=f"{name}, measured"), measured),
        _ComparableSource(NamedPicture(name=f"predicted-{name}", title=f"{name}, predicted"), predicted),
    )


def projector_png(folder: Path, strategy: str) -> bytes:
    """Return the codes that a strategy sends to the projector, as PNG. Raises SessionError."""
    session = Session.read(folder)
    return png_of(codes_of(session.finished("compensate").load_image(f"projector-{strategy}")), 3)
