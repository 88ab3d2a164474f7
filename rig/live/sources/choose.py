"""Which source a word of the command line means."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rig.devices.protocols import Clock
from rig.errors import UsageError
from rig.live.sources.files import PICTURE_SUFFIXES, FolderSource, PatternSource, StillSource, VideoSource
from rig.live.sources.raw import SHARED_FOLDER, SharedMemorySource, StreamSource, check_size
from rig.live.sources.source import Source

_FOLDER_RATE_HZ = 1.0
"""Of a slide show; --rate says another."""
_PATTERN_RATE_HZ = 60.0
_LIGHT_SUFFIXES = {".exr", ".hdr", ".pfm"}
"""Pictures of light, which have no codes to show: they are refused as pictures, and not tried as films."""
_MOST_DIGITS = 9
"""Of a width or height: more is no number of pixels."""


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """What sources need to know beside their name."""

    shape: tuple[int, int]
    """(height, width) of the projector."""
    size: tuple[int, int] | None = None
    """(height, width) of raw pictures without header."""
    rate_hz: float | None = None
    """Pace of a folder or of the test pattern; default: 1 picture a second, and 60."""
    is_only: bool = True
    """No other source follows: a still is held."""


def make_source(word: str, settings: SourceSettings, clock: Clock) -> Source:
    """Make a source, closed.

    ``pattern`` · ``-`` (standard input) · ``camera:ID`` · ``shm:NAME`` · ``pipe:PATH`` · a named pipe · a folder · a
    picture · a video file. Raises UsageError for what is none of these.
    """
    kind, _, rest = word.partition(":")
    path = Path(word)
    if word == "pattern":
        return PatternSource(settings.shape, settings.rate_hz or _PATTERN_RATE_HZ)
    if word == "-":
        return StreamSource(None, settings.size, clock)
    if kind == "camera" and rest:
        from rig.live.sources.camera import CameraSource  # opens kernel interfaces that only Linux has

        return CameraSource(rest, settings.shape, clock)
    if kind == "shm" and (rest in (".", "..") or "/" in rest):
        raise UsageError(f"{word}: {rest!r} is no shared memory; give a file in {SHARED_FOLDER}, e.g. shm:frames")
    if kind == "shm" and rest:
        return SharedMemorySource(rest, clock)
    if kind == "pipe" and rest:
        return StreamSource(Path(rest), settings.size, clock)
    if path.is_fifo():
        return StreamSource(path, settings.size, clock)
    if path.is_dir():
        return FolderSource(path, settings.rate_hz or _FOLDER_RATE_HZ)
    if path.is_file() and path.suffix.lower() in PICTURE_SUFFIXES | _LIGHT_SUFFIXES:
        return StillSource(path, None if settings.is_only else 1 / (settings.rate_hz or _FOLDER_RATE_HZ), clock)
    if path.is_file():
        return VideoSource(path)
    raise UsageError(
        f"{word}: no such source; give a video file, a picture, a folder of pictures, a named pipe, pipe:PATH, -, "
        "shm:NAME, camera:ID (rig devices lists them) or pattern"
    )


def parse_size(text: str) -> tuple[int, int] | None:
    """(height, width) of ``WIDTHxHEIGHT``; None for an empty text. Raises UsageError."""
    if not text:
        return None
    width, _, height = text.lower().partition("x")
    is_size = width.isascii() and height.isascii() and width.isdigit() and height.isdigit()
    if not is_size or not (width.strip("0") and height.strip("0")):
        raise UsageError(f"--size {text}: not a size; give WIDTHxHEIGHT, e.g. 1920x1080")
    if len(width) > _MOST_DIGITS or len(height) > _MOST_DIGITS:
        raise UsageError(f"--size {text[:40]}: no picture is as large; give WIDTHxHEIGHT, e.g. 1920x1080")
    check_size("--size", (int(height), int(width)))
    return int(height), int(width)
