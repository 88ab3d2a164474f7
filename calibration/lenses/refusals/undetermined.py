"""What the views do not determine, found from the normal matrix and named with its cause."""

from __future__ import annotations

import numpy as np

from calibration.arrays import FloatArray
from calibration.errors import CalibrationError
from calibration.lenses.bundle import CAMERA, PROJECTOR
from calibration.lenses.fit import Settled
from calibration.lenses.records import RigState
from calibration.lenses.uncertainty import Confidence

_FOCAL_LIMIT = 0.05
"""Of a focal length: one whose sigma is larger is no measurement; data sheets are as good."""
_ONE_TILT_DEG = 8.0
"""Between the two most unlike normals of the boards: below, they are one tilt, and distance stands for focal length."""
_CONTRADICTING = 2.0
"""Scatter between views over what their corners' noise explains: beyond, no one lens and pose is behind them."""


def refuse_undetermined(settled: Settled, confidence: Confidence, names: tuple[str, ...]) -> None:
    """Refuse a fit whose views leave a focal length open.

    Parameters
    ----------
    settled : Settled
    confidence : Confidence
        Of the same fit.
    names : tuple of str
        Of the views.

    Raises
    ------
    CalibrationError
        With the sigma, the limit and the cause.
    """
    sigma = np.sqrt(np.maximum(np.diag(confidence.covariance), 0))
    for device, part, lens in (
        ("camera", CAMERA, settled.state.camera),
        ("projector", PROJECTOR, settled.state.projector),
    ):
        if not settled.free[part].any():
            continue
        share = float((sigma[part][:2] / np.abs(lens[:2])).max())
        if not share <= _FOCAL_LIMIT:
            raise CalibrationError(
                f"the {device}'s focal length is not determined: {abs(lens[0]):.0f} px with a standard deviation of "
                f"{100 * min(share, 99):.3g} %, the limit is {100 * _FOCAL_LIMIT:g} %; "
                f"{_cause(settled, confidence, names)}"
            )


def _cause(settled: Settled, confidence: Confidence, names: tuple[str, ...]) -> str:
    scatter = float(np.sqrt(max(confidence.excess, 0.0)))
    spread = tilt_spread_deg(settled.state)
    views = len(settled.state.rotations)
    if spread < _ONE_TILT_DEG:
        return (
            f"all {views} boards have one tilt (within {spread:.1f} degrees, at least {_ONE_TILT_DEG:g} are needed): "
            "a longer lens farther away would show the same. Tilt the board by 20 to 40 degrees, in turn to the left, "
            "right, up and down"
        )
    if scatter > _CONTRADICTING:
        return (
            f"the views contradict each other, {scatter:.1f} times as much as their corners' noise explains: camera "
            "and projector were moved against each other between poses, zoom or focus was touched, or the board is not "
            "as said; photograph all poses again with both standing firm"
        )
    frontal = int((tilts_deg(settled.state) < _ONE_TILT_DEG).sum())
    of_names = f" ({', '.join(names[:6])})" if names and len(names) == views else ""
    return (
        f"{views} views{of_names}, {frontal} of them facing the camera, with {int(settled.used.sum())} corners are too "
        "few or too much alike for this lens model: add views that are tilted and reach into the picture's corners"
    )


def normals(state: RigState) -> FloatArray:
    """(V, 3) normals of the boards in the camera's frame, towards the camera."""
    normal = state.rotations[:, :, 2]
    return np.asarray(np.where(normal[:, 2:] > 0, -normal, normal))


def tilt_spread_deg(state: RigState) -> float:
    """Largest angle between the normals of any two boards."""
    normal = normals(state)
    return float(np.degrees(np.arccos(np.clip(normal @ normal.T, -1, 1).min())))


def tilts_deg(state: RigState) -> FloatArray:
    """(V,) angle between each board's normal and the line of sight to it."""
    middle = state.translations_m / np.linalg.norm(state.translations_m, axis=1, keepdims=True)
    return np.asarray(np.degrees(np.arccos(np.clip(-(normals(state) * middle).sum(axis=1), -1, 1))))
