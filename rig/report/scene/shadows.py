"""What becomes of each projector pixel: steered, in the shadow of something, on two surfaces at once, or wasted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.stages.model import FittedScene
from rig.stages.scene_model import SceneModel
from sim.geometry.optics import rays_at
from sim.geometry.rays import trace

FloatArray = NDArray[np.float64]

_STEEPEST = 5.7
"""Tangent of 80 degrees, as where surfaces are cut into pieces: what turns further away is a step in depth."""
FATES = ("steered", "on two surfaces", "out of the camera's sight", "not seen well enough", "on nothing")
COLOURS = ("#dfe6ee", "#f2c14e", "#b3312c", "#5a6b85", "#20242e")


@dataclass(frozen=True, eq=False, kw_only=True)
class ShadowMap:
    """What the light of each projector pixel does."""

    fate: NDArray[np.uint8]
    """(H, W) number in ``FATES``."""

    @property
    def shares(self) -> tuple[float, ...]:
        """Of all pixels, by ``FATES``."""
        count = np.bincount(self.fate.ravel(), minlength=len(FATES))
        return tuple(float(share) for share in count / self.fate.size)

    @property
    def picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) in ``COLOURS``."""
        table = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in COLOURS], dtype=np.uint8)
        return np.asarray(table[self.fate])


def shadow_map(model: FittedScene) -> ShadowMap:
    """Return what the light of each projector pixel does, in the measured room.

    A steered pixel at an edge lights two surfaces: what is right for one is wrong on the other. What lands out of the
    camera's sight stays black: it would light nothing of the picture, and everything else a second time.
    """
    scene_model = model.scene_model
    meets = scene_model.projector_hits.hits.patch >= 0
    fate = np.full(len(meets), FATES.index("not seen well enough"), dtype=np.uint8)
    fate[scene_model.hidden] = FATES.index("out of the camera's sight")
    fate[model.room.active] = FATES.index("steered")
    fate[model.room.active & _on_two(scene_model)] = FATES.index("on two surfaces")
    fate[~meets] = FATES.index("on nothing")
    return ShadowMap(fate=fate.reshape(scene_model.projector.lens.shape))


def _on_two(scene_model: SceneModel) -> NDArray[np.bool_]:
    """(n pixels,) pixels between whose corners the surface steps in depth."""
    device = scene_model.projector
    height, width = device.lens.shape
    rows, columns = np.mgrid[: height + 1, : width + 1] - 0.5
    rays = rays_at(device.lens, device.pose, np.stack([columns.ravel(), rows.ravel()], axis=-1))
    hits = trace(scene_model.scene, device.pose.position_m, rays)
    distance = np.where(hits.patch >= 0, hits.distance, np.inf).reshape(height + 1, width + 1)
    corners = np.stack([distance[:-1, :-1], distance[1:, :-1], distance[:-1, 1:], distance[1:, 1:]])
    nearest = corners.min(axis=0)
    with np.errstate(invalid="ignore"):
        step = corners.max(axis=0) - nearest
    across = np.sqrt(2) * nearest / min(device.lens.focal_px)
    return np.asarray((np.isfinite(nearest) & ~(step <= _STEEPEST * across)).ravel())
