"""What is there beside the picture: the sensor's own level, the projector's black, and the room's light, apart."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.radiometry.projector_black import projector_black
from rig.files.channels import image_of
from rig.records import Record
from rig.session import Session
from rig.stages.correspondence import load_correspondence
from rig.stages.radiometry import load_radiometric_calibration

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

_ALL_OF_WHITE, _HARDLY_LIT = 0.9995, 0.1
"""Share of white of pixels inside of the picture; of their median direct light, what pixels outside stay below."""
_DARKER = 0.7
"""Of the median white inside: brighter pixels are lit, whatever the checkers say."""
_BORDER_PX = 9
"""Beside what is lit: there lenses mix light of both sides."""


@dataclass(frozen=True, kw_only=True)
class DarknessRecord(Record):
    """Light while the projector shows black; shares are of projector white at the lit pixels, by median."""

    sensor_share_of_full_scale: float
    """Level of the camera without any light."""
    black_share_of_white: float
    """All light while the projector shows black."""
    projector_black_share: float | None = None
    """Of that the projector's: one over its contrast. None where the border of its picture is not seen."""
    projector_black_sigma: float | None = None
    """Its standard error."""
    room_light_share: float | None = None
    """The rest."""


def darkness_of(session: Session) -> DarknessRecord:
    """Return what black consists of, from the steps `response` and `separation`, which are finished."""
    radiometric, separated = load_radiometric_calibration(session), session.finished("separation")
    light = separated.load_image("separation")
    white, direct = (image_of(light, name).mean(axis=-1).astype(np.float64) for name in ("white", "direct"))
    exposures = np.array(list(radiometric.black)) / radiometric.reference_exposure_s
    balanced = [(black * radiometric.balance).mean(axis=-1) for black in radiometric.black.values()]
    black = np.tensordot(exposures, np.array(balanced, dtype=np.float64), axes=1) / (exposures**2).sum()
    inside = load_correspondence(session).valid & (separated.load_image("blur")["white_share"] > _ALL_OF_WHITE)
    share = float(np.median(black[inside] / white[inside])) if inside.any() else 0.0
    found = projector_black(black, white, inside, _outside(white, direct, inside))
    return DarknessRecord(
        sensor_share_of_full_scale=radiometric.offset_dn / radiometric.full_scale_dn,
        black_share_of_white=share,
        projector_black_share=None if found is None else found.share_of_white,
        projector_black_sigma=None if found is None else found.sigma,
        room_light_share=None if found is None else max(share - found.share_of_white, 0.0),
    )


def _outside(white: FloatArray, direct: FloatArray, inside: BoolArray) -> BoolArray:
    """(H, W) pixels that see none of the projector's own light, well away from those that do."""
    if not inside.any():
        return np.zeros_like(inside)
    lit = direct > _HARDLY_LIT * np.median(direct[inside])
    near = cv2.dilate((lit | inside).astype(np.uint8), np.ones((_BORDER_PX, _BORDER_PX), np.uint8)) > 0
    return np.asarray(~near & (white > 0) & (white < _DARKER * np.median(white[inside])))
