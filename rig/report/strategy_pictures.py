"""What each strategy shows in a compared session: target, sent, predicted, measured, error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rig.files.channels import codes_of, image_of
from rig.report import pictures
from rig.report.pictures import EmbeddedPicture
from rig.session import Session
from rig.stages.model import FittedScene

COLUMNS = ("target", "projected", "predicted", "measured", "error")


@dataclass(frozen=True)
class PictureRow:
    """Pictures of one strategy."""

    name: str
    images: Sequence[EmbeddedPicture]


def picture_rows(session: Session, model: FittedScene, names: Sequence[str]) -> list[PictureRow]:
    """Return the pictures of strategies that were shown and photographed."""
    compensated, compared = session.finished("compensate"), session.finished("compare")
    judged = compared.load_image("judged")
    mask, target = judged["mask"] > 0, image_of(judged, "target")
    scale = 255 / model.level
    rows = []
    for name in names:
        codes = codes_of(compensated.load_image(f"projector-{name}"))
        predicted = image_of(compensated.load_image(f"predicted-{name}"), "light") * scale
        measured = image_of(compared.load_image(f"measured-{name}"), "light") * scale
        images = [
            pictures.picture(pictures.photograph(target, mask), "Target as the camera should see it"),
            pictures.picture(codes, f"Codes sent to the projector, {name}"),
            pictures.picture(pictures.photograph(predicted, mask), f"Predicted camera image, {name}"),
            pictures.picture(pictures.photograph(measured, mask), f"Measured camera image, {name}"),
            pictures.picture(pictures.signed_error(measured - target, mask), f"Measured minus target, {name}"),
        ]
        rows.append(PictureRow(name, images))
    return rows
