"""The search for an exposure: what to try next, from what was seen; and whether the projector's light is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.arrays import Frame
from calibration.errors import CalibrationError

_BRIGHTEST = 0.999
"""Quantile that counts as the brightest: glints may clip."""
_CLIPPED_SHARE, _CLIPPED_FACTOR = 0.98, 0.25
"""From this share of full scale on a level says only that it is too bright: go down in steps of two stops."""
_LEAST_SHARE = 0.01
"""A darker level is noise: never go up by more than a hundredfold at once."""
_MOST_FACTOR = 100.0
"""By which an exposure grows at once."""
_BRIGHT, _MOST_GLARE = 0.99, 1.3
"""The brightest hundredth, and how much brighter the brightest permille may be: 1.01 to 1.25 in thirty-nine of forty
random rooms, 2.1 in one whose camera saw the wall beside the projector."""
_POWERS, _TELLING = (0.3, 4.0), 0.02
"""Of tone curves; levels that differ by less than 2 % tell nothing."""
_MOST_LEFT = 0.05
"""Of the picture before: a display's afterglow and room light that swells leave less; a frame too early leaves half."""
_LEAST_SIGNAL = 0.01
"""White has to be brighter than black by this share of full scale, or there is nothing to measure."""


@dataclass(frozen=True, slots=True)
class ExposureAim:
    """Where the brightest pixels of projector white should lie, as shares of full scale."""

    share: float
    accepted: tuple[float, float]
    """Least and most that need no other try."""

    def met_by(self, brightest: float) -> bool:
        """Whether a level needs no other try.

        Parameters
        ----------
        brightest : float
            As of :func:`brightest_share`.

        Returns
        -------
        bool
            True within `accepted`, its ends included.
        """
        return self.accepted[0] <= brightest <= self.accepted[1]


def brightest_share(pixels: Frame, full_scale_dn: float) -> float:
    """Return the level of the brightest permille of a frame's brightest channel, a small glare aside.

    Where less than a hundredth is much brighter than the rest (a wall beside the projector, seen in a corner of the
    picture), that may be clipped: exposed for it, all else would be too dark to be decoded.

    Parameters
    ----------
    pixels : (H, W, C)
        Digital numbers.
    full_scale_dn : float
        Largest digital number.

    Returns
    -------
    float
        Share of full scale. [1]
    """
    brightest, bright = np.quantile(pixels, (_BRIGHTEST, _BRIGHT), axis=(0, 1))
    return float(np.minimum(brightest, _MOST_GLARE * bright).max()) / full_scale_dn


def next_exposure(
    exposure_s: float,
    brightest: float,
    aim: ExposureAim,
    range_s: tuple[float, float],
    *,
    earlier: tuple[float, float] | None = None,
) -> float | None:
    """Say which exposure to try next, from what the last one gave, and the one before.

    A camera with a tone curve gets brighter faster or slower than its exposure; two tries tell by how much.

    Parameters
    ----------
    exposure_s : float
        Exposure of the last frame. [s]
    brightest : float
        Its level, as of :func:`brightest_share`.
    aim : ExposureAim
        What is wanted.
    range_s : (shortest, longest)
        What the camera can do. [s]
    earlier : (exposure, level), optional
        Of the try before. [s], share of full scale

    Returns
    -------
    float or None
        Exposure within the range; None when the aim is met, or the range ends here. [s]
    """
    if aim.met_by(brightest):
        return None
    power = _exposure_power((exposure_s, brightest), earlier)
    wanted = (aim.share / max(brightest, _LEAST_SHARE)) ** power
    factor = _CLIPPED_FACTOR if brightest > _CLIPPED_SHARE else min(wanted, _MOST_FACTOR)
    chosen_s = float(np.clip(exposure_s * factor, *range_s))
    return None if chosen_s == exposure_s else chosen_s


def _exposure_power(last: tuple[float, float], earlier: tuple[float, float] | None) -> float:
    """By which power of the level's factor the exposure has to grow; 1 for a straight camera."""
    if earlier is None or not (_LEAST_SHARE < min(last[1], earlier[1]) and max(last[1], earlier[1]) < _CLIPPED_SHARE):
        return 1.0
    by_level, by_exposure = np.log(last[1] / earlier[1]), np.log(last[0] / earlier[0])
    return float(np.clip(by_exposure / by_level, *_POWERS)) if abs(by_level) > _TELLING else 1.0


def refuse_darkness(white: Frame, black: Frame, *, full_scale_dn: float, exposure_s: float) -> None:
    """Refuse frames in which projector white is no brighter than black.

    Parameters
    ----------
    white, black : (H, W, C)
        Digital numbers of frames of projector white and black at one exposure.
    full_scale_dn : float
        Largest digital number.
    exposure_s : float
        Of both frames, for the message. [s]

    Raises
    ------
    CalibrationError
        If the brightest hundredth differs by less than 1 % of full scale in some channel.
    """
    change = white.astype(np.float64) - black.astype(np.float64)
    difference = float(np.quantile(change, 0.99, axis=(0, 1)).min())
    limit = _LEAST_SIGNAL * full_scale_dn
    if difference < limit:
        raise CalibrationError(
            f"projector white is only {difference:.1f} dn brighter than black at {exposure_s:.4g} s, the limit is "
            f"{limit:.0f} dn: no light of the projector reaches the camera. Look at lens caps, aim and room light."
        )


def late_share(photographs: Sequence[Frame], before: Frame) -> float:
    """Return what share of the picture before is still in the first photograph of a picture.

    Parameters
    ----------
    photographs : (N of) (H, W, C)
        Digital numbers of frames of one picture, in the order in which they were taken, the first after another one.
    before : (H, W, C)
        A frame of the picture before, at the same exposure.

    Returns
    -------
    float
        By how much the first is more like the one before than any of the others; 0 where pictures do not differ.
    """
    first, *others = (float(frame.mean(dtype=np.float64)) for frame in photographs)
    settled = float(np.median(others))
    change = float(before.mean(dtype=np.float64)) - settled
    return (first - settled) / change - max((other - settled) / change for other in others) if change else 0.0


def refuse_lateness(late: float, shown: str, before: str) -> None:
    """Refuse photographs that show the picture before the one that was on.

    Parameters
    ----------
    late : float
        What :func:`late_share` says.
    shown, before : str
        The picture, and the one before it, for the message.

    Raises
    ------
    CalibrationError
        If it is more than 5 %.
    """
    if late > _MOST_LEFT:
        raise CalibrationError(
            f"the first photograph of {shown} after {before} is still {100 * late:.0f} % that of {before}, those after "
            f"it are not; the limit is {100 * _MOST_LEFT:g} %: photographs show the picture before the one that was "
            "on. Raise projector.latency_s (`rig check` measures it, and --apply writes it into the profile); switch "
            "off what lays frames over each other, the camera's noise reduction and the projector's smooth motion"
        )
