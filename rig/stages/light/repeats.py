"""How often pictures that are compared are photographed, for the noise of single photographs not to hide the model."""

from __future__ import annotations

from rig.session import Session
from rig.stages.photograph import ExposureBracket
from rig.stages.radiometry import RadiometricRecord, measuring_bracket

_MOST_NOISE = 0.6
"""Of the limit of measured minus simulated light: beside so much noise a model's error of 0.8 of it reaches it."""
_MOST_REPEATS = 8
"""A picture then takes as long as a few patterns of the code; a rig that is noisier than that lacks light."""
WHITES = 4
"""Frames of white that the model is made from, at least: their noise stays in it."""
_OF_PICTURE, _OF_WHITE = 0.5, 0.25
"""Variance at half the light of white, by that of white: of a photograph, whose noise is of electrons, and of what
white itself, by which the model knows the pixel, brings."""


def quiet_repeats(session: Session) -> int:
    """Return how many photographs of a compared picture bring its noise to three fifths of the limit, at most eight.

    Of the noise of white that step `response` measured; 1 where that is low, or nobody measured it.
    """
    record = session.finished("response").load_record("radiometric", RadiometricRecord)
    share, profile = record.cameras[session.profile.camera.name].white_noise_share, session.profile
    if not share:
        return 1
    noise = 255 * share / profile.brightness.target_white_share
    most = (_MOST_NOISE * profile.limits.comparison_rmse / noise) ** 2
    enough = (n for n in range(1, _MOST_REPEATS) if _OF_PICTURE / n + _OF_WHITE / max(n, WHITES) <= most)
    return next(enough, _MOST_REPEATS)


def comparing_bracket(session: Session) -> ExposureBracket:
    """Return how pictures are photographed that the model is held against."""
    return measuring_bracket(session, max(quiet_repeats(session), session.profile.patterns.frames_averaged))


def white_bracket(session: Session) -> ExposureBracket:
    """Return how the white is photographed that the model is made from."""
    return measuring_bracket(session, max(quiet_repeats(session), WHITES))
