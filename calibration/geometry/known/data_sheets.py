"""Fields of view by data sheets, held against the focal lengths that points tell."""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.geometry.bundle_unknowns import CAMERA, FOCAL_SIGMA, PROJECTOR
from calibration.geometry.noise import SIGMAS
from calibration.geometry.plane_bundle import BundleSolution


def check_data_sheets(solution: BundleSolution, sigma: FloatArray) -> None:
    """Refuse focal lengths that the fields of view of the data sheets contradict.

    Parameters
    ----------
    solution : BundleSolution
        A fit.
    sigma : (n,)
        Standard deviations of its unknowns.

    Raises
    ------
    CalibrationError
        With the device, both focal lengths, and their sigmas.
    """
    found = solution.fit.z[[CAMERA.start, PROJECTOR.start]]
    own = sigma[[CAMERA.start, PROJECTOR.start]]
    off = (found - 1) / np.hypot(FOCAL_SIGMA, own)
    together = abs(float(found.mean()) - 1) / np.hypot(FOCAL_SIGMA / np.sqrt(2), float(own.mean()))
    if max(*np.abs(off), together) <= SIGMAS:
        return
    worst = int(np.argmax(np.abs(off)))
    name = ("camera", "projector")[worst]
    raise CalibrationError(
        f"the {name}'s focal length comes out {found[worst]:.2f} +- {own[worst]:.2f} times, that of the other device "
        f"{found[1 - worst]:.2f} +- {own[1 - worst]:.2f} times what hfov_deg says, which is taken to be true to "
        f"{100 * FOCAL_SIGMA:g} %: {max(*np.abs(off), together):.0f} sigma, the limit is {SIGMAS:g}. Check hfov_deg "
        "(zoom, crop, horizontal or diagonal); if it is right, the walls are not at right angles (askew_deg says how "
        "far off, right_angles = false by anything)"
    )
