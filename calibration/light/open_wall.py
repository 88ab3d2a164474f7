"""The reflectance of a wall that stands alone in the model, and the light that the rest of the room sends back to it.

No patch of one flat wall sees another one, so all global light comes from surfaces that nobody measured. Far and
diffuse, they send it back evenly: what arrives is a share of the wall's mean radiosity, g_i = ρ_i s mean(B). The share
s follows from white. The flux does not: ρ κ is all that direct light tells, and the reflectance rests on what painted
walls usually have.
"""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.light.reflectance import (
    COMMON_REFLECTANCE,
    COMMON_SPREAD,
    LEAST_REFLECTANCE,
    MOST_REFLECTANCE,
    ReflectanceFit,
    ReflectanceSource,
    lit_and_seen,
)

_MOST_RETURNED = 0.95
"""Beyond, the light would hardly fade."""
ANOTHER_PICTURE = 0.2
"""Relative standard deviation of the light that comes back of a picture whose light lies elsewhere than white's: of
halves of a picture whose room has side walls a metre beside it, even light is off by 0.12 to 0.19 rms."""


def estimate_open_wall(
    direct_over_irradiance: FloatArray, global_light: FloatArray, irradiance: FloatArray, areas: FloatArray
) -> ReflectanceFit:
    """Estimate the reflectance of patches that do not see each other, and the share of light that comes back.

    Parameters
    ----------
    direct_over_irradiance : (P,)
        ρ_i κ of patches that are lit and seen, NaN elsewhere. [camera unit]
    global_light : (P,)
        Mean global radiosity of patches that are seen, NaN elsewhere. [camera unit]
    irradiance : (P,)
        Mean e of each patch, its unlit part counted as 0.
    areas : (P,)
        Of the patches. [m²]

    Returns
    -------
    ReflectanceFit
        With `returned_share`; `global_rms` is what an even return leaves over in white. What another picture may change
        in it is not in white: :data:`ANOTHER_PICTURE`.

    Raises
    ------
    CalibrationError
        If no patch is both lit and seen.
    """
    lit, seen = lit_and_seen(direct_over_irradiance, global_light)
    flux = float(np.median(direct_over_irradiance[lit])) / COMMON_REFLECTANCE
    reflectance = np.where(lit, direct_over_irradiance / flux, COMMON_REFLECTANCE)
    reflectance = np.clip(reflectance, LEAST_REFLECTANCE, MOST_REFLECTANCE)
    known = lit & seen
    arriving = np.maximum(global_light[known], 0.0) / reflectance[known]
    even = float(np.median(arriving))
    if even > 0:
        # Beside the picture the wall shows the same even light: its share of it is the reflectance there.
        own = np.clip(np.nan_to_num(global_light) / even, LEAST_REFLECTANCE, MOST_REFLECTANCE)
        reflectance = np.where(seen & ~lit, own, reflectance)
    mean_radiosity = float(np.average(reflectance * (flux * irradiance + even), weights=areas))
    uneven = float(np.sqrt(np.mean((arriving / even - 1) ** 2))) if even > 0 else 0.0
    spread = COMMON_SPREAD / COMMON_REFLECTANCE
    unlit = np.where(seen, ReflectanceSource.GLOBAL, ReflectanceSource.UNSEEN)
    return ReflectanceFit(
        reflectance=reflectance,
        source=np.where(lit, ReflectanceSource.DIRECT, unlit).astype(np.uint8),
        sigma=spread * reflectance,
        flux=flux,
        flux_sigma=spread * flux,
        unseen_reflectance=COMMON_REFLECTANCE,
        unseen_sigma=COMMON_SPREAD,
        global_rms=uneven,
        returned_share=min(even / mean_radiosity, _MOST_RETURNED),
    )
