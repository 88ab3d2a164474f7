"""Numbers against their limits, and what a user has to be told."""

from __future__ import annotations

import numpy as np

from calibration.lenses.bundle import CAMERA, PROJECTOR, STRETCH
from calibration.lenses.calibrate import LensFit
from calibration.lenses.records import LensCalibration
from calibration.lenses.refusals.undetermined import tilt_spread_deg
from rig.lenses.records import DeviceLens, ViewSummary
from rig.lenses.views import SeenView
from rig.records import Verdict

_STARTS_PX = 1e-3
_HALVES_RATIO = 2.0
"""Over the ratio of 1 that true uncertainties give; chance alone exceeds it in fewer than one set of fifty."""
_SIGMA_PX = 1.0
"""Worst uncertainty of projection within the corners' outline: beyond, a map is off by a whole pixel there."""
_COVERED = 0.4
"""Of a picture; where no corner was seen, a lens is a guess."""
_SCATTER = 2.0
"""Between views over corner noise: beyond, the lens model or the board is not what it is taken for."""
_BRIGHTNESS = 4.0
"""Brightest over darkest view: tilt and distance of a board explain less."""
_UNEVEN = 0.0005
"""Share by which squares are longer than wide: less is no matter, half a millimetre on a metre."""
_STRETCHED, _SURE = 0.02, 5.0
"""Share by which pixels are wider than high, or higher than wide, and standard deviations: sensors and displays have
square ones to a thousandth, but for those that are named."""


def judged(devices: tuple[DeviceLens, ...], fit: LensFit) -> tuple[Verdict, ...]:
    """Return every limit of a calibration with its number."""
    rows = [
        Verdict(
            what="lenses from all starts agree",
            value=fit.starts_agree_px,
            limit=_STARTS_PX,
            unit="px",
            advice="the views hardly determine the lenses: add tilted views that reach into the corners",
        ),
        Verdict(
            what="scatter of views over corner noise",
            value=float(np.sqrt(max(fit.calibration.excess, 0.0))),
            limit=_SCATTER,
            advice="a richer distortion model, a flatter board, or a camera that does not move while it is exposed",
        ),
    ]
    for device in devices:
        rows += _of_device(device)
    return tuple(rows)


def _of_device(device: DeviceLens) -> list[Verdict]:
    name = device.name
    rows = [
        Verdict(
            what=f"{name}: worst uncertainty of projection",
            value=device.projection_sigma_px[2],
            limit=_SIGMA_PX,
            unit="px",
            advice="add views; the page shows where in the picture, and which pose helps most",
        ),
        Verdict(
            what=f"{name}: share of the picture with corners",
            value=device.covered_share,
            limit=_COVERED,
            at_least=True,
            advice="hold the board into the parts of the picture that the page shows empty",
        ),
    ]
    ratio = None if device.halves is None else device.halves.ratio
    advice = (
        "too few views to divide them: six are needed, and in each half three that this device lights or sees"
        if ratio is None
        else "the uncertainties are too small by this factor: the lens model, the board or a few views are wrong"
    )
    rows.append(
        Verdict(
            what=f"{name}: halves differ, over their uncertainties", value=ratio, limit=_HALVES_RATIO, advice=advice
        )
    )
    return rows


def warnings_of(
    views: tuple[SeenView, ...], summaries: tuple[ViewSummary, ...], calibration: LensCalibration
) -> tuple[str, ...]:
    """Return what was left out or looks wrong, a line each."""
    lines = [f"{view.name}: {view.note}" for view in summaries if view.note]
    lines += [*_uneven_print(calibration), *_stretched(calibration)]
    bright = {view.name: view.bright_dn for view in views if not view.problem and np.isfinite(view.bright_dn)}
    if len(bright) > 1:
        darkest, brightest = min(bright, key=bright.__getitem__), max(bright, key=bright.__getitem__)
        if bright[brightest] > _BRIGHTNESS * bright[darkest]:
            lines.append(
                f"the board's bright squares have {bright[brightest]:.0f} dn in {brightest} and {bright[darkest]:.0f} "
                f"dn in {darkest}, more than {_BRIGHTNESS:g} times apart: were the camera's automatics on? Exposure "
                "may change, but focus and zoom must not"
            )
    if tilt_spread_deg(calibration.state) < 20:
        lines.append(
            f"the boards' tilts differ by {tilt_spread_deg(calibration.state):.0f} degrees at most; with 30 or more "
            "the focal length is known better"
        )
    return tuple(lines)


def _uneven_print(calibration: LensCalibration) -> list[str]:
    """Return a line for a board whose squares are longer than wide."""
    stretch, sigma = calibration.state.stretch, float(calibration.sigmas()[STRETCH][0])
    if abs(stretch) <= max(_UNEVEN, _SURE * sigma):
        return []
    return [
        f"the board's squares come out {100 * abs(stretch):.2f} ± {100 * sigma:.3f} % "
        f"{'longer' if stretch > 0 else 'shorter'} down than across, as printers feed paper; "
        "square_m is taken as their width: measure a row of squares, lengths are off by what it is off"
    ]


def _stretched(calibration: LensCalibration) -> list[str]:
    """Return a line for each device whose pixels are not square."""
    sigmas, lines = calibration.sigmas(), []
    for name, lens, part in (("camera", calibration.camera, CAMERA), ("projector", calibration.projector, PROJECTOR)):
        if lens is None:
            continue
        across, down = lens.focal_px
        sigma = float(np.hypot(*(sigmas[part][:2] / (across, down))))
        if abs(down / across - 1) > max(_STRETCHED, _SURE * sigma):
            lines.append(
                f"the {name}'s pixels come out {down / across:.3f} times as wide as high: were its pictures stretched, "
                "or are width_px, height_px or code_step_px those of another mode? If its pixels are so, all is well"
            )
    return lines
