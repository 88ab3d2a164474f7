"""The measured reflectance of a surface as one picture: a small square of it for each patch."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.light.faces import away_from_edges
from rig.files.colour.srgb import srgb_of_linear
from rig.files.pictures import png_of
from rig.stages.maps.sampling import sample
from rig.stages.model import FittedScene
from rig.stages.scene_model import SceneModel, face_of_pixels, white_irradiance
from sim.geometry.optics import project
from sim.geometry.rays import trace
from sim.geometry.surface import Surface

FloatArray = NDArray[np.float64]

_SAME_PLACE = 5e-3
"""Of the distance, by which a camera's ray may end before a point that it is said to see."""
_RIM = np.ones((9, 9), np.uint8)
"""Beside the border of the picture lenses mix lit and dark."""
_LEAST_WHITE = 0.05
"""Of the median light of white: with less, small errors of the surface are large ones of reflectance."""
MOST_TEXELS = 1 << 22
"""Of the whole picture: 2048 × 2048."""
_LARGEST_TILE, _SMALLEST_TILE = 24, 4


@dataclass(frozen=True, eq=False, kw_only=True)
class PatchTexture:
    """Tiles of patches, row by row in one picture."""

    image: NDArray[np.uint8]
    """(H, W, 3) reflectance as sRGB codes."""
    tile_px: int
    """Side of a tile."""
    columns: int
    """Tiles in a row."""
    seen: NDArray[np.float64]
    """(P,) share of each patch that the camera has measured in the projector's light."""

    @property
    def png(self) -> bytes:
        """The picture as a file."""
        return png_of(self.image)

    def corners_uv(self, patch: NDArray[np.intp]) -> FloatArray:
        """Return (N, 4, 2) where the corners of patches lie in the picture, 0 … 1 from its upper left.

        They lie at the middles of a tile's outer pixels, so that no neighbour's colour gets in.
        """
        rows, columns = np.divmod(patch, self.columns)
        inner = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (self.tile_px - 1) + 0.5
        place = np.stack([columns, rows], axis=-1)[:, None] * self.tile_px + inner
        return np.asarray(place / np.array(self.image.shape[1::-1]))


def reflectance_texture(model: FittedScene, most_texels: int = MOST_TEXELS) -> PatchTexture:
    """Return the reflectance at each point of a surface: from camera pixels that see it lit, else that of its patch.

    Parameters
    ----------
    model
        Of one band, or of three.
    most_texels
        Of the whole picture, about.
    """
    scene = model.scene_model.scene
    side = int(np.clip(np.sqrt(most_texels / scene.n_patches), _SMALLEST_TILE, _LARGEST_TILE))
    points, patch = _tile_points(scene, side)
    visible = _visible(model.scene_model, points)
    camera = model.scene_model.camera
    xy_px = np.where(visible[:, None], project(camera.lens, camera.pose, points), -10.0)
    bands, known = [], visible
    for band in model.room.bands:
        seen = sample(_pixel_reflectance(band), xy_px)
        known = known & np.isfinite(seen)
        bands.append(np.where(known, seen, band.scene.reflectance[patch]))
    colours = np.stack(bands if len(bands) == 3 else bands * 3, axis=-1)
    columns = int(np.ceil(np.sqrt(scene.n_patches)))
    rows = -(-scene.n_patches // columns)
    tiles = np.zeros((rows * columns, side, side, 3))
    tiles[: scene.n_patches] = colours.reshape(-1, side, side, 3)
    image = tiles.reshape((rows, columns, side, side, 3)).swapaxes(1, 2).reshape(rows * side, columns * side, 3)
    share = known.reshape(scene.n_patches, -1).mean(axis=1)
    return PatchTexture(
        image=np.rint(255 * srgb_of_linear(np.clip(image, 0.0, 1.0))).astype(np.uint8),
        tile_px=side,
        columns=columns,
        seen=share,
    )


def _tile_points(scene: Surface, side: int) -> tuple[FloatArray, NDArray[np.intp]]:
    """Points (P · side², 3) under the middles of each tile's pixels, and the patch of each.

    A triangle fills the lower left half of its tile; the other half is as bright as the nearest point of its edge.
    """
    share = np.linspace(0, 1, side)
    v, u = (each.ravel()[None, :, None] for each in np.meshgrid(share, share, indexing="ij"))
    a, b, c, d = (scene.vertices[:, k, None] for k in range(4))
    quad = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    over = np.maximum(u + v - 1, 0.0) / 2
    triangle = a + (u - over) * (b - a) + (v - over) * (c - a)
    points = np.where(is_triangle(scene)[:, None, None], triangle, quad)
    return points.reshape(-1, 3), np.repeat(np.arange(scene.n_patches), side * side)


def is_triangle(scene: Surface) -> NDArray[np.bool_]:
    """Return (P,) patches that repeat their last corner."""
    return np.asarray((scene.vertices[:, 2] == scene.vertices[:, 3]).all(axis=1))


def _visible(scene_model: SceneModel, points: FloatArray) -> NDArray[np.bool_]:
    """(N,) points that the camera sees: inside its picture, and nothing before them."""
    camera = scene_model.camera
    origin = camera.pose.position_m
    away = points - origin
    distance = np.linalg.norm(away, axis=1)
    xy = project(camera.lens, camera.pose, points)
    height, width = camera.lens.shape
    with np.errstate(invalid="ignore"):
        inside = ((xy > 0) & (xy < (width - 1, height - 1))).all(axis=1)
    first = np.full(len(points), np.inf)
    hits = trace(scene_model.scene, origin, away[inside] / distance[inside, None])
    first[inside] = np.where(hits.patch >= 0, hits.distance, np.inf)
    return np.asarray(inside & (first > distance * (1 - _SAME_PLACE)))


def _pixel_reflectance(band: SceneModel) -> FloatArray:
    """(H, W) reflectance of what each camera pixel sees lit; 0 where it cannot be told."""
    camera, hits = band.camera, band.camera_hits
    projector = next(iter(band.projectors.values()))
    e = white_irradiance(band.scene, projector.device, hits.points_m, hits.hits.patch)
    white = projector.flux * e * camera.illumination(camera.lens.pixel_grid())
    gain = band.light.direct_gain.ravel()
    face = face_of_pixels(hits, camera.lens.shape)
    inner = away_from_edges(face) & (cv2.erode((band.light.direct_gain > 0).astype(np.uint8), _RIM) > 0)
    usable = inner.ravel() & (white > _LEAST_WHITE * np.median(white[white > 0]))
    reflectance = np.where(usable, gain / np.where(usable, white, 1.0), 0.0)
    # More than all comes back where light falls at a slant and the surface is off by a little.
    return np.asarray(np.where(reflectance <= 1, reflectance, 0.0).reshape(camera.lens.shape))
