"""Photographs in the place of a camera: which file shows which pattern, and its digital numbers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rig.devices.replay import Pixels, RecordedFrame
from rig.errors import DeviceLost, ProfileError
from rig.images import read_codes
from rig.profile_problems import parse_toml

_AXES = {"columns": "gray-column-{:02d}", "rows": "gray-row-{:02d}"}


def photographed_frames(manifest: Path, channels: int) -> dict[str, tuple[RecordedFrame, ...]]:
    """Frames that a manifest names, by pattern; nobody knows their exposure.

    Raises ProfileError when the manifest cannot be used or a photograph is missing, a line for each.
    """
    try:
        raw = manifest.read_bytes()
    except OSError as error:
        raise ProfileError(f"{manifest}: cannot be read: {error.strerror}; check replay.manifest") from error
    files = _files(parse_toml(raw, manifest), manifest)
    missing = [f"{manifest}: {name}: no file {path}" for name, path in files.items() if not path.is_file()]
    if missing:
        raise ProfileError("\n".join(missing))
    return {name: (RecordedFrame(None, partial(_read, path, channels)),) for name, path in files.items()}


def _files(data: Mapping[str, Any], manifest: Path) -> dict[str, Path]:
    """File of each pattern: `[frames]` by name, `[gray_code]` lists with the most significant bit first."""
    gray_code, frames = data.get("gray_code", {}), data.get("frames", {})
    if not isinstance(gray_code, dict) or not isinstance(frames, dict):
        raise ProfileError(f"{manifest}: gray_code and frames have to be tables: [gray_code], [frames]")
    named: dict[str, Any] = dict(frames)
    for axis, pattern in _AXES.items():
        for suffix, key in (("", axis), ("-inverse", f"{axis}_inverse")):
            listed = gray_code.get(key, [])
            for bit, file in zip(reversed(range(len(listed))), listed, strict=True):
                named[pattern.format(bit) + suffix] = file
    wrong = [name for name, file in named.items() if not isinstance(file, str)]
    if wrong or not named:
        what = (
            f"{wrong[0]}: is no file name" if wrong else "names no photographs; add [gray_code] or [frames]"
        )
        raise ProfileError(f"{manifest}: {what}")
    return {name: manifest.parent / file for name, file in named.items()}


def _read(path: Path, channels: int) -> Pixels:
    """Digital numbers as in the file; a colour photograph becomes grey by the mean of its channels."""
    codes = read_codes(path)
    if codes.shape[2] != channels == 1:
        return np.asarray(np.rint(codes.mean(axis=2, keepdims=True)), dtype=np.uint16)
    if codes.shape[2] != channels:
        raise DeviceLost(f"{path}: has {codes.shape[2]} channel, the profile's camera has {channels}")
    return codes.astype(np.uint16)
