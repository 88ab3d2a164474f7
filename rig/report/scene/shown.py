"""Pictures of what was wanted and known: a placed target, a known mesh's misfit, what photographs taught."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from rig.files.channels import codes_of, image_of
from rig.report import pictures
from rig.report.pictures import EmbeddedPicture
from rig.session import Session
from rig.stages.model import FittedScene, load_prior_model
from rig.stages.prediction import predict
from rig.stages.radiometry import load_radiometric_calibration

FloatArray = NDArray[np.float64]

_MOST_MISFIT_M = 0.01
"""At the ends of the colours of a misfit."""


def placed_pictures(session: Session) -> list[EmbeddedPicture]:
    """Return a target as it was given and as the projector has to show it; none where it was given pixel by pixel."""
    step = session.finished("compensate")
    if "placement" not in step.settings:
        return []
    given, placed = (image_of(step.load_image(name), "grey") for name in ("target-source", "target"))
    return [
        pictures.picture(pictures.photograph(given), "As it was given"),
        pictures.picture(pictures.photograph(placed), "As it is wanted at the projector's pixels"),
    ]


def misfit_picture(session: Session) -> EmbeddedPicture | None:
    """Return how far what the camera sees lies before or behind a known mesh; None without one."""
    if session.profile.surface.kind != "file":
        return None
    misfit = session.finished("model").load_image("misfit")["misfit_m"]
    known = np.isfinite(misfit)
    share = np.clip(np.nan_to_num(misfit) / _MOST_MISFIT_M, -1, 1) / 2 + 0.5
    colours = np.asarray(255 * colormaps["RdBu_r"](share)[..., :3], dtype=np.float64).astype(np.uint8)
    colours[~known] = (96, 96, 100)
    limit_mm = 1000 * _MOST_MISFIT_M
    return pictures.picture(colours, f"Points before the mesh (red, {limit_mm:g} mm) or behind it (blue)")


@dataclass(frozen=True, eq=False)
class LearnedErrors:
    """Measured minus predicted light of a picture, grey levels: by the model alone, and with what it learned."""

    strategy: str
    alone: FloatArray
    learned: FloatArray
    mask: NDArray[np.bool_]


def learned_errors(session: Session, model: FittedScene, strategy: str) -> LearnedErrors | None:
    """Return both errors of a strategy's picture, which nothing was fitted to; None of a model that learned nothing."""
    if model.learned is None:
        return None
    compared = session.finished("compare")
    mask = compared.load_image("judged")["mask"] > 0
    measured = image_of(compared.load_image(f"measured-{strategy}"), "light")
    codes = codes_of(session.finished("compensate").load_image(f"projector-{strategy}"))
    radiometric, scale = load_radiometric_calibration(session), 255 / model.level
    codes = codes.reshape(*codes.shape[:2], -1)
    alone, learned = (
        np.asarray(scale * (measured - predict(one, radiometric, codes).light), dtype=np.float64)
        for one in (load_prior_model(session), model)
    )
    return LearnedErrors(strategy, alone, learned, mask)


def learned_pictures(errors: LearnedErrors | None) -> list[EmbeddedPicture]:
    """Return both errors as pictures."""
    if errors is None:
        return []
    named = ((errors.alone, "the model alone"), (errors.learned, "the model and its photographs"))
    return [
        pictures.picture(pictures.signed_error(error, errors.mask), f"Measured minus predicted by {words}")
        for error, words in named
    ]


def learned_text(errors: LearnedErrors | None) -> str:
    """Return both errors in words."""
    if errors is None:
        return ""
    alone, learned = (float(np.sqrt(np.mean(one[errors.mask] ** 2))) for one in (errors.alone, errors.learned))
    return (
        f"On the picture of '{errors.strategy}', which nothing was fitted to, measured minus predicted light is "
        f"{alone:.2f} grey levels rms by the model alone, {learned:.2f} with what photographs taught it."
    )
