"""Every compensation strategy on one configuration of the paper, scored, and the optimum's certificate checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from rig.paper.records import Certificate, PictureScores, StrategyScores
from rig.stages.picture_errors import grey_difference
from sim.compensation import STRATEGIES, Compensation, compensate
from sim.light.criteria import difference
from sim.light.transport import LightTransport

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WHITE = 255.0
SLACK = 1e-6
"""By how much of its RMS a strategy may be below the optimum: what the certificate leaves open."""


def compensated(transport: LightTransport, desired: FloatArray) -> dict[str, Compensation]:
    """Run all strategies for a target (n,) in grey levels of 255."""
    return {name: compensate(name, transport, desired, lower=0.0, upper=WHITE) for name in STRATEGIES}


def strategy_scores(
    solutions: Mapping[str, Compensation], desired: FloatArray, seen: BoolArray, shape: tuple[int, int]
) -> dict[str, StrategyScores]:
    """Return error figures, clipping, effort and notes of each strategy, by name."""
    scored = Scored(desired, seen, shape)
    return {
        name: StrategyScores(
            **asdict(scored.scores(solution.predicted)),
            clipped_share=float(solution.clipped[seen].mean()),
            iterations=solution.iterations,
            seconds=solution.seconds,
            notes=dict(solution.notes),
        )
        for name, solution in solutions.items()
    }


class Scored:
    """What pictures are compared with: a desired image (n,) over the pixels that see a surface."""

    def __init__(self, desired: FloatArray, seen: BoolArray, shape: tuple[int, int]) -> None:
        self.desired, self.seen, self.shape = desired, seen, shape
        self._wanted = self._relative(desired)

    def scores(self, visible: FloatArray) -> PictureScores:
        """Return error figures, and how it looks: structural similarity and CIEDE2000 of the clipped grey images."""
        shown = self._relative(visible)
        similarity = structural_similarity(shown, self._wanted, data_range=1.0, full=True)[1]  # type: ignore[no-untyped-call]
        distance = grey_difference(WHITE * shown, WHITE * self._wanted)
        on_surface = self.seen.reshape(self.shape)
        return PictureScores(
            **asdict(difference(visible[self.seen], self.desired[self.seen])),
            ssim=float(similarity[on_surface].mean()),
            delta_e_2000=float(distance[on_surface].mean()),
        )

    def _relative(self, image: FloatArray) -> FloatArray:
        return np.clip(image, 0, WHITE).reshape(self.shape) / WHITE


def certificate(scores: Mapping[str, StrategyScores]) -> Certificate:
    """Tell how far the bounded optimum can be from the best, and whether any strategy undercuts its RMS error."""
    rms = {name: score.rms for name, score in scores.items()}
    optimum = rms["bounded"]
    # An optimum of roundoff is met, not beaten, by another of roundoff.
    least = optimum * (1 - SLACK) - SLACK
    return Certificate(
        gap=float(scores["bounded"].notes["gap"]), beaten_by=tuple(name for name in rms if rms[name] < least)
    )
