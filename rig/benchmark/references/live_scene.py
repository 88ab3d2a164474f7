"""What ``rig bench live`` runs on: a coloured room, a projector that distorts and vignettes, a photograph that pans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import skimage.data
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from skimage.transform import resize

from sim.arrays import FloatArray
from sim.form_factors import FormFactors, form_factors
from sim.frame.compensator import FrameModel, frame_model
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose, rays_at
from sim.geometry.rays import trace
from sim.geometry.scene import Hits, Scene
from sim.light.colour import ColourTransport
from sim.light.mesh_view import node_view
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, irradiance_at, smooth_view
from sim.scenes.gridded import paper_room
from sim.scenes.meshes import icosphere

GAMMA = 2.2
TARGET_SHARE = 0.7
"""Full scale of a target, of the median camera value of white."""
BLACK_SHARE = 0.01
"""Camera value at the projector's black, of the same."""
PAINT = {
    "floor": (0.45, 0.40, 0.35),
    "ceiling": (0.80, 0.80, 0.80),
    "x0": (0.70, 0.68, 0.62),
    "x1": (0.70, 0.70, 0.70),
    "y0": (0.65, 0.70, 0.72),
    "y1": (0.70, 0.70, 0.70),
}
"""Reflectance of each face in the three bands."""
MIXING = np.array([[1.0, 0.08, 0.01], [0.06, 1.0, 0.07], [0.01, 0.05, 1.0]])
POSITION_M, AIM_M = (1.2, 1.2, 1.2), (2.2, 2.2, 1.2)
PAN_PX = 8
PATCH_OF_MESH_M, COARSE_M = 0.33, 0.8
BALL_M, BALL_RADIUS_M, BALL_SUBDIVISIONS = (3.2, 3.2, 1.0), 0.7, 3
"""Of a ball of 1280 triangles, which makes the mesh 2150 patches."""
BALL_REFLECTANCE = 0.6
SHEET_TRIANGLES = (38, 24)
"""Pairs along and up of a bent sheet, which makes its mesh 1968 patches, four in five of them lit."""
SHEET_REFLECTANCE = (0.6, 0.5, 0.4)
SHEET_TURN_DEG, SHEET_AWAY_M, SHEET_WAVES_M = (-13.0, 103.0), 2.0, 0.25
MESH_RAYS = 256
"""Of each patch: what is timed does not depend on their noise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveScene:
    """One room seen by one projector."""

    scene: Scene | Mesh
    lens: Lens
    hits: Hits
    transport: ColourTransport
    target_scale: FloatArray
    """(3,) camera value of a target's full scale."""
    black: FloatArray
    """(n, 3)."""
    curve: FloatArray
    """(256,) linear light of codes, of target and projector."""

    def model(self) -> FrameModel:
        """Prepare it for frames."""
        return frame_model(
            self.transport,
            self.lens.shape,
            target_scale=self.target_scale,
            black=self.black,
            eotf=self.curve,
            response=self.curve,
            node_view=node_view(self.scene, self.hits) if isinstance(self.scene, Mesh) else None,
        )

    def error(self, target: NDArray[np.uint8], shown: NDArray[np.uint8]) -> float:
        """Root mean square of predicted minus wanted camera image, in grey levels, by the transport itself."""
        light, wanted = (self.curve[codes.reshape(-1, 3)] for codes in (shown, target))
        predicted = (self.transport.forward(light) + self.black) / self.target_scale
        return 255 * float(np.sqrt(np.mean((predicted - wanted) ** 2)))


def live_scene(width_px: int, height_px: int, patch_size_m: float) -> LiveScene:
    """Build the paper's room in colour, a painted pattern on its walls, and a projector of 100 degrees."""
    room = paper_room(patch_size_m=patch_size_m)
    paint = [
        np.concatenate([np.full(face.n_patches, PAINT[face.name][band]) for face in room.faces]) for band in range(3)
    ]
    return _lit(room, form_factors(room), paint, (width_px, height_px))


def live_mesh(width_px: int, height_px: int, patch_size_m: float = PATCH_OF_MESH_M) -> LiveScene:
    """Build the same room with a ball in its corner, all of it a mesh as a session measures it."""
    ball = (np.array(BALL_M) + BALL_RADIUS_M * icosphere(BALL_SUBDIVISIONS))[:, [0, 1, 2, 2]]
    paint = (BALL_REFLECTANCE,) * 3
    return _mesh_in_room(
        "room with a ball", ball, patch_size_m=patch_size_m, paint=paint, size_px=(width_px, height_px)
    )


def live_relief(width_px: int, height_px: int) -> LiveScene:
    """Build a mesh nearly all of which is lit: a wavy sheet around the projector, closed by a coarse room."""
    return _mesh_in_room(
        "relief", _sheet(), patch_size_m=COARSE_M, paint=SHEET_REFLECTANCE, size_px=(width_px, height_px)
    )


def _mesh_in_room(
    name: str, thing: FloatArray, *, patch_size_m: float, paint: tuple[float, ...], size_px: tuple[int, int]
) -> LiveScene:
    """The room and a thing in it as one mesh."""
    room = paper_room(patch_size_m=patch_size_m)
    mesh = Mesh(
        name=name,
        vertices=np.concatenate([room.vertices, thing]),
        reflectance=np.full(room.n_patches + len(thing), 0.5),
        region=np.concatenate([room.region, np.full(len(thing), len(room.faces))]),
    )
    walls = [[np.full(face.n_patches, PAINT[face.name][band]) for face in room.faces] for band in range(3)]
    bands = [np.concatenate([*walls[band], np.full(len(thing), paint[band])]) for band in range(3)]
    return _lit(mesh, form_factors(mesh, "rays", rays=MESH_RAYS), bands, size_px)


def _sheet() -> FloatArray:
    """(1824, 4, 3) triangles that face the projector."""
    along, up = (np.linspace(0, 1, count + 1) for count in SHEET_TRIANGLES)
    u, v = np.meshgrid(along, up, indexing="ij")
    angle = np.deg2rad(SHEET_TURN_DEG[0] + (SHEET_TURN_DEG[1] - SHEET_TURN_DEG[0]) * u)
    away_m = SHEET_AWAY_M + SHEET_WAVES_M * np.sin(9 * u + 1) * np.cos(5 * v)
    x, y = POSITION_M[0] + away_m * np.cos(angle), POSITION_M[1] + away_m * np.sin(angle)
    points = np.stack([x, y, 0.06 + 2.28 * v], axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack(corners, axis=2).reshape(-1, 4, 3) for corners in ((a, c, b, b), (a, d, c, c))])


def _lit(surface: Scene | Mesh, factors: FormFactors, paint: list[FloatArray], size_px: tuple[int, int]) -> LiveScene:
    """A projector in a room whose patches have a reflectance a band."""
    width_px, height_px = size_px
    ideal = Lens.from_horizontal_field_of_view(width_px, height_px, 100.0)
    lens = Lens(
        width_px=width_px,
        height_px=height_px,
        focal_px=ideal.focal_px,
        principal_point_px=ideal.principal_point_px,
        distortion=(-0.02, 0.003, 2e-4, -1e-4, 0.0),
    )
    pose = Pose.look_at(POSITION_M, AIM_M)
    rays = rays_at(lens, pose, lens.pixel_grid())
    hits = trace(surface, pose.position_m, rays)
    points = pose.position_m + hits.distance[:, None] * rays
    vignetting = _vignetting(lens)
    light = irradiance_at(surface, lens, pose, points_m=points, patch=hits.patch) * vignetting
    del rays
    white = surface.with_reflectance(1.0)
    emission = area_emission(white, lens, pose, subsamples=2, convention="physical") @ diags_array(vignetting)
    view = smooth_view(white, hits, np.ones(lens.n_pixels))
    pattern = 1 + 0.08 * np.sin(9 * points[:, 0] + 5 * points[:, 2]) * np.sin(7 * points[:, 1])
    bands = []
    for rho in paint:
        seen = rho[hits.patch] * pattern
        bands.append(
            LightTransport(
                csr_array(diags_array(seen * light)),
                csr_array(diags_array(rho) @ emission),
                Radiosity(factors, rho, solver="repeated"),
                csr_array(diags_array(seen) @ view @ diags_array(1 / rho)),
                pixel_patch=hits.patch,
            )
        )
    transport = ColourTransport(bands, MIXING)
    level = np.median(transport.forward(np.ones((lens.n_pixels, 3))), axis=0)
    black = np.tile(BLACK_SHARE * level, (lens.n_pixels, 1)) * (seen / np.median(seen))[:, None]
    return LiveScene(
        scene=surface,
        lens=lens,
        hits=hits,
        transport=transport,
        target_scale=TARGET_SHARE * level,
        black=black,
        curve=(np.arange(256) / 255) ** GAMMA,
    )


def _vignetting(lens: Lens) -> FloatArray:
    radius = np.linalg.norm(lens.pixel_grid() - np.array(lens.principal_point_px), axis=1)
    return np.asarray(1 - 0.3 * (radius / np.hypot(*lens.shape) * 2) ** 2)


def panning_frames(shape: tuple[int, int], count: int) -> list[NDArray[np.uint8]]:
    """``count`` frames (H, W, 3) of a photograph that moves to the left by 8 pixels of 1920 a frame."""
    height, width = shape
    step = max(1, round(PAN_PX * width / 1920))
    whole = (height, width + step * (count - 1), 3)
    picture = np.asarray(skimage.data.coffee())  # type: ignore[no-untyped-call]
    large = resize(picture, whole, order=1, anti_aliasing=True)  # type: ignore[no-untyped-call]
    codes = np.rint(255 * np.clip(large, 0, 1)).astype(np.uint8)
    return [np.ascontiguousarray(codes[:, step * k : step * k + width]) for k in range(count)]
