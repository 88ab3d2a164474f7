"""What a good figure is on this rig: the range that its own noise and geometry let one expect of each number."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from calibration.structured_light.consistency.map_noise import NOISE_PART_PX, SHARED_PX, map_noise_px, most_left_px
from rig.session import Session
from rig.stages.correspondence import load_correspondence
from rig.stages.results import ExpectedFigure, GeometryResult, ModelComparison, StrategyResult
from rig.stages.stripes.showing import out_of_focus

_GAUSSIAN = 0.997
"""Share of a normal distribution within three standard deviations."""
_LEAST_WITHIN = 0.93
"""The same when the stated deviations are 0.6 of the true ones: then they say too little."""
_LEAST_NOISE, _LEAST_PROCESSED = 0.9, 0.6
"""Of measured minus simulated light over its noise, at least; the second of frames that the camera processes, as smooth
pictures have less of that."""
_MODEL_SPREAD = 1.25
"""Of measured minus simulated light over its noise: what is left beside noise is then 0.75 of it."""
_MEASURED_SPREAD = 0.1
"""Of a strategy's measured over its predicted error, beside the model's own error."""


def expected_figures(
    session: Session,
    geometry: GeometryResult,
    comparison: ModelComparison,
    best: StrategyResult,
) -> tuple[ExpectedFigure, ...]:
    """Return what to expect of the numbers of a compared session, each beside the number itself.

    Parameters
    ----------
    session
        With a finished correspondence.
    geometry, comparison
        What was measured.
    best
        Of the strategy that stands for 'compensated'.
    """
    return (
        *_reprojection(geometry, load_correspondence(session).projector_xy_px),
        _model_error(comparison),
        _within(comparison),
        _compensated(best, comparison),
    )


def _reprojection(geometry: GeometryResult, projector_xy_px: NDArray[np.floating]) -> Iterator[ExpectedFigure]:
    """One figure; none of a map so full of holes that nothing tells its noise."""
    noise_px = map_noise_px(projector_xy_px)
    if not np.isfinite(noise_px):
        return
    yield ExpectedFigure(
        what="reprojection error of the projector, rms",
        value=geometry.projector_rms_px,
        low=0.0,
        high=most_left_px(noise_px),
        unit="px",
        because=f"the correspondence map is rough by {noise_px:.3f} px within parts of {NOISE_PART_PX} px, and may be "
        f"off by {SHARED_PX:g} px over more of a wall",
        raised_by="surfaces that are not flat, things that moved, a lens with more distortion than the model has",
        remedy=out_of_focus(geometry.stripes_times)
        or "look at the residuals on the page: speckle is noise, structure is a wrong model; recalibrate the lens",
    )


def _model_error(comparison: ModelComparison) -> ExpectedFigure:
    n = comparison.photographs
    averaged = f", with {n} photographs of each picture averaged" if n > 1 else ""
    processed_dn = comparison.processing_noise_dn
    processed = f", frames are compressed or processed by {processed_dn:.1f} dn," if processed_dn else ""
    return ExpectedFigure(
        what="measured - simulated, rms",
        value=comparison.rmse,
        low=(_LEAST_PROCESSED if processed_dn else _LEAST_NOISE) * comparison.noise_rms,
        high=_MODEL_SPREAD * comparison.noise_rms,
        unit="grey levels",
        because=f"noise of the camera{processed} and of what was measured of the scene is "
        f"{comparison.noise_rms:.2f} grey levels{averaged}",
        raised_by="things in the room that the model lacks, gloss, a lamp that drifts, blur that changed",
        remedy="look at the error pictures: spots are things, a slope is vignetting or drift, edges are focus",
    )


def _within(comparison: ModelComparison) -> ExpectedFigure:
    return ExpectedFigure(
        what="share of pixels within 3 standard deviations",
        value=comparison.within_3_sigma,
        low=_LEAST_WITHIN,
        high=1.0,
        unit="",
        because=f"noise alone leaves {_GAUSSIAN:g}",
        raised_by="more noise than the sensor should have hides errors: near 1 is good only with a small rms",
        remedy="compare the frames of the table: one bad frame is drift, all of them are the model",
    )


def _compensated(best: StrategyResult, comparison: ModelComparison) -> ExpectedFigure:
    predicted, model = best.predicted.rms, comparison.rmse
    return ExpectedFigure(
        what="error of the compensated picture, rms",
        value=best.measured.rms,
        low=max(predicted * (1 - _MEASURED_SPREAD) - model, 0.0),
        high=float(np.hypot(predicted * (1 + _MEASURED_SPREAD), model)),
        unit="grey levels",
        because=f"the projector's range leaves {predicted:.2f}, the model's error is {model:.2f}",
        raised_by="dark walls, a bright target, and a projector that does not reach black",
        remedy="lower brightness.target_white_share, darken the room, or choose a target with less contrast",
    )
