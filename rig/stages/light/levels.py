"""The light of flat pictures of the projector's levels, and whether something else than the projector changed it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from calibration.arrays import BoolArray, Float32Array, FloatArray
from calibration.errors import CalibrationError
from calibration.light.evenness import disturbed, part_shares, unevenness
from calibration.radiometry.exposure import refuse_lateness
from rig.stages.linear_light import LightImage

_BRIGHT, _CLIPPED = 0.3, 0.97
"""Of the brightest level of a frame, and of full scale: pixels between tell whether two frames are alike."""
_LEAST_SHARE = 0.02
"""Of white: of less light rows tell nothing but noise, and no part can be off by what is allowed."""
_SOMEBODY = (
    "Somebody or something stood in the light or before the camera, or light in the room was switched or let in, while "
    "they were photographed: keep everything as it is, and begin a new session"
)
_LATE = (
    "Pictures before it have such shares, as where photographs begin before a picture is wholly on: raise "
    "projector.latency_s (`rig check` measures it)."
)
_OF_PULSES = 3.0
"""What a pulsing projector changes of the shortest exposure, over what it changes of longer ones: usually 2."""
_SURE = 4.0
"""Standard deviations of a mean."""
_ALIKE = 0.1
"""Of a share of white: by so much two pictures differ that may be one."""


def light_of_levels(
    pictures: Mapping[str, Callable[[], LightImage]], white: LightImage, lit: BoolArray
) -> dict[str, FloatArray]:
    """Return the light of all lit pixels together in each picture of a level, (B,).

    Parameters
    ----------
    pictures
        What loads each, by name.
    white
        Of the projector, (H, W, B).
    lit : (H, W)
        Pixels whose light tells the projector's curve.

    Raises
    ------
    CalibrationError
        Where parts of some pictures are brighter or darker than the rest makes of them.
    """
    sums, shares, grey = {}, {}, white.value.mean(axis=-1)
    for name, load in pictures.items():
        light = load().value
        sums[name] = light[lit].sum(axis=0, dtype=np.float64)
        shares[name] = part_shares(_without_bands(light.mean(axis=-1), grey, lit), grey, lit)
    _refuse_disturbed(tuple(shares), np.array(list(shares.values())))
    return sums


def refuse_disturbed_sweeps(levels: FloatArray, exposures_s: FloatArray, full_scale_dn: float) -> None:
    """Refuse two sweeps of exposures over projector white of which one has parts that the other has not.

    Parameters
    ----------
    levels : (F, H, W)
        Digital numbers above black, (H, W) places of the picture; frame 2k and 2k + 1 have the same exposure.
    exposures_s : (F,)
    full_scale_dn : float
        Above black.

    Raises
    ------
    CalibrationError
        With the exposure, by how much parts differ, and what to do.
    """
    above = np.maximum(levels, 0.0)
    for there, back, exposure_s in zip(above[::2], above[1::2], exposures_s[::2], strict=True):
        brighter = np.maximum(there, back)
        lit = (brighter > _BRIGHT * brighter.max()) & (brighter < _CLIPPED * full_scale_dn)
        if lit.any():
            both = there + back
            share = part_shares(_without_bands(back, both, lit), both.astype(np.float32), lit)
            _refuse_disturbed_pair(share, float(unevenness(share[None])[0]), float(exposure_s))


def refuse_late_white(levels: FloatArray, dark: FloatArray) -> None:
    """Refuse two sweeps of exposures over projector white of which the first begins with a photograph of black.

    A lamp that gets brighter, or pulses, changes other pairs as well; of few levels noise makes any share.

    Parameters
    ----------
    levels : (F, N)
        Mean digital numbers of places; frame 2k and 2k + 1 have the same exposure, frame 0 is the first of all.
    dark : (F / 2, N)
        The same of projector black.

    Raises
    ------
    CalibrationError
        With how much of black it is, and what to do.
    """
    there, back = levels[::2], levels[1::2]
    light = (back - dark).mean(axis=1)
    light = np.where(light > 0, light, np.inf)
    shares = (back - there).mean(axis=1) / light
    # Of an even drift the pair that lies furthest apart has most: as much more than the next as that has than its next.
    usual = np.append(np.abs(shares[1:]), 2 * shares[1] - shares[2] if len(shares) > 2 else 0.0).max()
    noise = (back - there)[0].std() / np.sqrt(there.shape[1]) / light[0]
    refuse_lateness(float(shares[0] - _OF_PULSES * usual - _SURE * noise), "white", "black")


def _without_bands(light: FloatArray | Float32Array, white: FloatArray | Float32Array, lit: BoolArray) -> Float32Array:
    """The light, had each row as large a share of white as most: a rolling shutter sees a projector pulse in bands."""
    level, usual = light.astype(np.float64), float(np.median(light[lit] / white[lit]))
    for row in np.flatnonzero(lit.any(axis=1)) if usual > _LEAST_SHARE else ():
        share = float(np.median(light[row, lit[row]] / white[row, lit[row]]))
        level[row] *= usual / max(share, _LEAST_SHARE)
    return level.astype(np.float32)


def _refuse_disturbed_pair(share: FloatArray, uneven: float, exposure_s: float) -> None:
    if abs(uneven) <= 1:
        return
    there = _furthest(share, uneven)
    raise CalibrationError(
        f"camera response: of two photographs of white, both exposed for {1000 * exposure_s:.2f} ms, the second has "
        f"{100 * there:.0f} % of the level of both in one part of the picture, and {100 * np.median(share):.0f} % in "
        f"most, {abs(uneven):.1f} times what is allowed. {_SOMEBODY}"
    )


def _refuse_disturbed(names: tuple[str, ...], shares: FloatArray) -> None:
    uneven = unevenness(shares)
    odd = disturbed(uneven)
    if not len(odd):
        return
    worst = odd[np.argmax(np.abs(uneven[odd]))]
    middle = float(np.median(shares[worst]))
    there = _furthest(shares[worst], uneven[worst])
    late = f"{_LATE} If it is long enough: " if _looks_late(shares[: worst + 1], there) else ""
    raise CalibrationError(
        f"projector response: {len(odd)} of {len(names)} pictures of one level are not as bright a share of white "
        f"everywhere ({', '.join(names[k] for k in odd)}): part of {names[worst]} has {100 * there:.1f} % of white's "
        f"light where the whole picture has {100 * middle:.1f} %, {abs(uneven[worst]):.1f} times what is allowed. "
        f"{late}{_SOMEBODY}"
    )


def _looks_late(shares: FloatArray, there: float) -> bool:
    """Whether the last of some pictures in their order is one of the two before it, or its odd part is on the way."""
    *before, middle = np.median(shares[-3:], axis=1).tolist()
    return any(
        abs(middle - share) < _ALIKE * share or min(middle, share) < there < max(middle, share) for share in before
    )


def _furthest(share: FloatArray, uneven: float) -> float:
    """The part that is off by most."""
    return float(share.min() if uneven < 0 else share.max())
