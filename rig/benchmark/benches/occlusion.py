"""The room with a box: partly occluded pairs and partly covered patches, ours and peers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.benchmark import peers
from rig.benchmark.records import Criterion, Outcome, Point, Size
from rig.benchmark.references.box import VisibleShares, partly_occluded, uncovered_share
from rig.benchmark.timing import median_seconds, peak_mb
from sim.arrays import FloatArray, IntArray
from sim.form_factors import form_factors
from sim.form_factors.factors import Visibility
from sim.geometry.scene import Scene
from sim.scenes.gridded import room_with_box

SEGMENTS = {"quick": 1 << 9, "default": 1 << 15, "full": 1 << 18}
"""Of the reference, a pair."""
MODES: tuple[Visibility, ...] = ("quick", "fair", "exact", "rays")
PEER_SEGMENTS = 64
PROBLEM = "box occluder"


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of the scene."""

    scene: Scene
    free: FloatArray
    """(P, P) form factors without the box in the way."""
    parted: VisibleShares

    @property
    def factors(self) -> FloatArray:
        """(pairs,) exact form factors of the partly occluded pairs."""
        return np.asarray(self.free[self.parted.first, self.parted.second] * self.parted.share)

    def pair_error(self, matrix: FloatArray) -> float:
        """Error of the partly occluded pairs, rms over rms."""
        found = matrix[self.parted.first, self.parted.second]
        return float(np.linalg.norm(found - self.factors) / np.linalg.norm(self.factors))

    def row_sum_error(self, matrix: FloatArray) -> float:
        """Largest error of a row sum of a floor patch that the box covers in part."""
        truth = uncovered_share(self.scene)
        partly = (truth > 0) & (truth < 1)
        return float(np.abs(matrix.sum(axis=1) - truth)[partly].max())


def box(size: Size) -> Outcome:
    """Measure every visibility and every peer that is there."""
    scene = room_with_box(patch_size_m=0.8 if size == "quick" else 0.4)
    free = form_factors(scene, "closed_form", visibility="none").matrix
    truth = Truth(scene, free, partly_occluded(scene, free, SEGMENTS[size]))
    works: dict[str, Callable[[], FloatArray]] = {mode: _ours(scene, mode) for mode in MODES}
    seconds = median_seconds(works, budget_s=0.1 if size == "quick" else 4.0)
    points = [_point(truth, mode, seconds[mode], works[mode]) for mode in MODES]
    # The criteria are of the scene of 701 patches, and finer than a quick reference.
    criteria = _bars({point.method: point for point in points}) if size != "quick" else []
    if size != "quick":
        points += _peers(truth)
    note = (
        f"box occluder: {len(truth.parted.share)} partly occluded pairs; reference of {SEGMENTS[size]} segments "
        f"a pair, which its last doubling moved by {truth.parted.change_rms:.1e} rms"
    )
    return Outcome(points=tuple(points), criteria=tuple(criteria), notes=(note,))


def _ours(scene: Scene, mode: Visibility) -> Callable[[], FloatArray]:
    return lambda: form_factors(scene, "closed_form", visibility=mode).matrix


def _point(truth: Truth, method: str, seconds: float, work: Callable[[], FloatArray]) -> Point:
    memory, matrix = peak_mb(work), work()
    detail = {"row_sum_error": truth.row_sum_error(matrix)}
    error = truth.pair_error(matrix)
    return Point(
        problem=PROBLEM,
        method=method,
        n=truth.scene.n_patches,
        seconds=seconds,
        error=error,
        peak_mb=memory,
        error_of="partly occluded pairs, rms",
        detail=detail,
    )


def _bars(points: dict[str, Point]) -> list[Criterion]:
    criteria = []
    for mode, error, seconds in (("exact", 0.0015, 0.4), ("quick", 0.03, 0.04)):
        point = points[mode]
        name = f"box, {mode}"
        criteria.append(Criterion(what=f"{name}: partly occluded pairs, rms", value=point.error or 0.0, limit=error))
        criteria.append(
            Criterion(what=f"{name}: time", value=point.seconds or 0.0, limit=seconds, unit="s", kind="time")
        )
    exact = points["exact"].detail["row_sum_error"]
    return [*criteria, Criterion(what="box, exact: row sums of partly covered patches", value=exact, limit=1e-3)]


def _peers(truth: Truth) -> list[Point]:
    points = []
    if peers.present("pyviewfactor"):
        mesh = peers.pyviewfactor_mesh(truth.scene)
        work = lambda: peers.pyviewfactor_factors(mesh, occluded=True)  # noqa: E731
        points.append(_point(truth, "pyviewfactor", median_seconds({"": work}, repeats=2)[""], work))
    if peers.present("embreex"):
        work = lambda: _by_embree(truth)  # noqa: E731
        points.append(_point(truth, f"embreex {PEER_SEGMENTS}", median_seconds({"": work}, repeats=2)[""], work))
    return points


def _by_embree(truth: Truth) -> FloatArray:
    """Closed form times the share of segments that Embree lets through, all facing pairs."""
    scene = truth.scene
    occluders = peers.EmbreeOccluders(scene.occluders)
    samples = np.random.default_rng(1).random((PEER_SEGMENTS, 4))
    first, second = np.nonzero(np.triu(truth.free, 1) > 0)
    matrix = truth.free.copy()
    step = (1 << 20) // PEER_SEGMENTS
    for start in range(0, len(first), step):
        i, j = first[start : start + step], second[start : start + step]
        begin = _points(scene, i, samples[:, :2])
        cut = occluders.cut(begin.reshape(-1, 3), (_points(scene, j, samples[:, 2:]) - begin).reshape(-1, 3))
        share = 1 - cut.reshape(len(i), -1).mean(axis=1)
        matrix[i, j] *= share
        matrix[j, i] *= share
    return matrix


def _points(scene: Scene, patches: IntArray, uv: FloatArray) -> FloatArray:
    corners = scene.vertices[patches]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    return np.asarray(corners[:, None, 0] + uv[:, :1] * u[:, None] + uv[:, 1:] * v[:, None])
