"""Light in bands: (H, W, B) in memory, a named channel a band on disk, numbers by band in records.

B is 1 for a grey camera and 3 for a colour one: red, green, blue.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.records import JsonObject

SUFFIXES: Mapping[int, tuple[str, ...]] = {1: ("",), 3: (".R", ".G", ".B")}
"""Of the channels of an image, by the number of bands."""
PRIMARIES: Mapping[int, tuple[str, ...]] = {1: (), 3: ("red", "green", "blue")}
"""Pictures of one projector channel each; light of a grey rig has no channels to tell apart."""


def layers(name: str, image: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Channels of an image (H, W, B): ``name``, or ``name.R name.G name.B``."""
    return {name + suffix: image[..., b] for b, suffix in enumerate(SUFFIXES[image.shape[2]])}


def image_of(channels: Mapping[str, NDArray[np.float32]], name: str) -> NDArray[np.float32]:
    """Image (H, W, B) from its channels; the inverse of :func:`layers`."""
    found = SUFFIXES[1 if name in channels else 3]
    return np.stack([channels[name + suffix] for suffix in found], axis=-1)


def bands_of(image: NDArray[Any]) -> list[NDArray[Any]]:
    """(H, W) of each band of an image (H, W, B), each in one piece of memory."""
    return [np.ascontiguousarray(image[..., b]) for b in range(image.shape[-1])]


def codes_of(channels: Mapping[str, NDArray[np.float32]], name: str = "codes") -> NDArray[np.uint8]:
    """Codes to show from the channels of an image: (H, W) of a grey rig, (H, W, 3) of a colour one."""
    return one_or_all(image_of(channels, name).astype(np.uint8))


def code_layers(codes: NDArray[np.uint8]) -> dict[str, NDArray[np.float32]]:
    """Channels of an image for codes that are shown; the inverse of :func:`codes_of`."""
    return layers("codes", codes.reshape(*codes.shape[:2], -1).astype(np.float32))


def one_or_all(image: NDArray[Any]) -> NDArray[Any]:
    """(H, W) where an image (H, W, B) has one band, else as it is."""
    return image[..., 0] if image.shape[-1] == 1 else image


def by_band(values: Sequence[Any]) -> Any:
    """Return, for a record, the value of a single band, or the list of all."""
    return values[0] if len(values) == 1 else list(values)


def merged(records: Sequence[Mapping[str, Any]]) -> JsonObject:
    """Records of the bands, which have the same keys, as one."""
    return {key: by_band([record[key] for record in records]) for key in records[0]}
