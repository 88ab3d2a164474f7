"""Two sets of Gray-code photographs with known points: a published scan, and a relief with a vertical baseline."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration.geometry.pinhole import PinholeModel, project, world_rays
from calibration.structured_light.gray import gray_code_patterns
from rig.devices.replay.photographs import Manifest, Photograph
from rig.offline.scan import Scan, scan_photographs

FloatArray = NDArray[np.float64]
Frames = Mapping[str, Photograph]

LIMIT_DN = 4.5
EPIPOLAR_LIMIT_PX = 4.0
OFF = 0.01
"""Of the depth, and of the points: beyond, a cloud is wrong."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PhotographSet:
    """Photographs with their lenses, and the true depth behind each camera pixel."""

    name: str
    manifest: Manifest
    frames: Frames
    devices: tuple[PinholeModel, PinholeModel]
    known_xy_px: FloatArray
    """(N, 2) camera pixels whose depth is known. [px]"""
    known_depth_m: FloatArray
    """(N,) [m]"""

    @cached_property
    def scan(self) -> Scan:
        """Of the photographs as they are."""
        return scan_photographs(
            self.manifest, self.frames, self.devices, limit_dn=LIMIT_DN, epipolar_limit_px=EPIPOLAR_LIMIT_PX
        )

    @cached_property
    def scan_off_share(self) -> float:
        """As :meth:`off_share`, of the photographs as they are."""
        return self.off_share(self.scan)

    def off_share(self, scan: Scan) -> float:
        """Share of a scan's points whose depth is off by more than 1 %."""
        errors = self.depth_errors(scan)
        return float((np.abs(errors) > OFF).mean()) if len(errors) else float("nan")

    def depth_errors(self, scan: Scan) -> FloatArray:
        """Relative errors of depth of those of a scan's points of which the depth is known."""
        distance, nearest = cKDTree(self.known_xy_px).query(scan.camera_xy_px)
        errors = scan.points_m[:, 2] / self.known_depth_m[nearest] - 1
        return np.asarray(errors[distance < 3])


def cropped(photographs: PhotographSet, share: tuple[float, float, float, float]) -> PhotographSet:
    """The set with photographs that are a part (left, right, top, bottom) of the picture, and say so."""
    height, width = photographs.manifest.camera_shape
    left, right = int(share[0] * width), int(share[1] * width)
    top, bottom = int(share[2] * height), int(share[3] * height)
    camera, projector = photographs.devices
    centre = camera.principal_point_px[0] - left, camera.principal_point_px[1] - top
    shape = (bottom - top, right - left)
    lens = replace(camera, principal_point_px=centre, width_px=shape[1], height_px=shape[0])
    return replace(
        photographs,
        manifest=replace(photographs.manifest, camera_shape=shape, camera=lens, camera_is_cropped=True),
        devices=(lens, projector),
        frames={name: frame[top:bottom, left:right].copy() for name, frame in photographs.frames.items()},
        known_xy_px=photographs.known_xy_px - (left, top),
    )


def vertical_set(camera_shape: tuple[int, int] = (288, 384), seed: int = 3) -> PhotographSet:
    """A wavy wall with a plate before it, by ray casting with nine samples a pixel, noise of 1 dn, texture."""
    width = camera_shape[1]
    projector_shape = (144, 192)
    camera = _pinhole(camera_shape, 1.1 * width, np.zeros(3), 0.0)
    projector = _pinhole(projector_shape, 1.25 * projector_shape[1], np.array([0.02, -0.22, 0.0]), 0.21)
    depth, plate = _cast(camera, _grid(camera_shape, 0.0, 0.0))
    rng = np.random.default_rng(seed)
    samples = [_sample(camera, projector, (a / 3, b / 3)) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    frames = {
        pattern.name: _photographed(pattern.codes, samples, camera_shape, rng)
        for pattern in gray_code_patterns(projector_shape)
    }
    manifest = _manifest("vertical", camera, projector, frames)
    xy = _grid(camera_shape, 0.0, 0.0)
    edge = cv2.dilate(plate.reshape(camera_shape).astype(np.uint8), np.ones((7, 7))) != cv2.erode(
        plate.reshape(camera_shape).astype(np.uint8), np.ones((7, 7))
    )
    known = ~edge.ravel()
    return PhotographSet(
        name="vertical",
        manifest=manifest,
        frames=frames,
        devices=(camera, projector),
        known_xy_px=xy[known],
        known_depth_m=depth[known],
    )


def _pinhole(shape: tuple[int, int], focal_px: float, position_m: FloatArray, tilt_rad: float) -> PinholeModel:
    rotation = np.asarray(cv2.Rodrigues(np.array([tilt_rad, 0.0, 0.0]))[0]).T
    return PinholeModel(
        width_px=shape[1],
        height_px=shape[0],
        focal_px=(focal_px, focal_px),
        principal_point_px=((shape[1] - 1) / 2, (shape[0] - 1) / 2),
        distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
        rotation=rotation,
        translation_m=-rotation @ position_m,
    )


def _grid(shape: tuple[int, int], right: float, down: float) -> FloatArray:
    row, column = np.mgrid[: shape[0], : shape[1]]
    return np.column_stack([column.ravel() + right, row.ravel() + down]).astype(np.float64)


def _wall_m(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(1.0 + 0.04 * np.sin(9 * x + 1) * np.cos(7 * y) + 0.1 * x)


_PLATE_M = (-0.16, 0.1, -0.12, 0.14, 0.82)
"""left, right, top, bottom, depth."""


def _cast(camera: PinholeModel, xy_px: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Depth along each ray, and whether it meets the plate."""
    rays = world_rays(camera, xy_px)
    slope = rays[:, :2] / rays[:, 2:]
    depth = np.ones(len(rays))
    for _ in range(15):
        depth = _wall_m(slope[:, 0] * depth, slope[:, 1] * depth)
    on_plate = _inside_plate(slope * _PLATE_M[4])
    return np.where(on_plate, _PLATE_M[4], depth), on_plate


def _inside_plate(xy_m: FloatArray) -> NDArray[np.bool_]:
    left, right, top, bottom, _ = _PLATE_M
    x, y = xy_m.T
    return np.asarray((x > left) & (x < right) & (y > top) & (y < bottom))


@dataclass(frozen=True, eq=False)
class _Sample:
    """One sample in each camera pixel."""

    code: NDArray[np.int64]
    """(N,) projector pixel, row by row; -1 where none shines."""
    light: FloatArray
    """(N,) by which a lit projector pixel brightens it."""
    dark: FloatArray
    """(N,) what is seen without."""


def _sample(camera: PinholeModel, projector: PinholeModel, offset_px: tuple[float, float]) -> _Sample:
    xy = _grid((camera.height_px, camera.width_px), *offset_px)
    depth, on_plate = _cast(camera, xy)
    rays = world_rays(camera, xy)
    points = rays / rays[:, 2:] * depth[:, None]
    column, row = np.rint(project(projector, points)).astype(np.int64).T
    inside = (column >= 0) & (column < projector.width_px) & (row >= 0) & (row < projector.height_px)
    towards = projector.position_m - points
    at_plate = points + towards * ((_PLATE_M[4] - points[:, 2:]) / towards[:, 2:])
    shadow = ~on_plate & _inside_plate(at_plate[:, :2])
    texture = 0.7 + 0.3 * np.sin(60 * points[:, 0]) * np.sin(47 * points[:, 1] + 3 * points[:, 0])
    texture = np.where(on_plate, 0.6 * texture + 0.35, texture)
    code = np.where(inside & ~shadow, row * projector.width_px + column, -1)
    return _Sample(code, 150 * texture / (points**2).sum(axis=1), 14 * texture)


def _photographed(
    codes: NDArray[np.uint8], samples: list[_Sample], shape: tuple[int, int], rng: np.random.Generator
) -> Photograph:
    on = codes.ravel() / 255.0
    light = np.mean([s.dark + s.light * np.where(s.code >= 0, on[s.code], 0.0) for s in samples], axis=0)
    light += 6 * on.mean()  # from other surfaces
    noisy = light + rng.normal(size=light.shape) * np.sqrt(0.5 + 0.01 * light)
    return np.asarray(np.clip(np.rint(noisy), 0, 255).astype(np.uint8).reshape(shape))


def _manifest(name: str, camera: PinholeModel, projector: PinholeModel, frames: Frames) -> Manifest:
    return Manifest(
        path=Path(f"{name}.toml"),
        camera_shape=(camera.height_px, camera.width_px),
        full_scale_dn=255,
        black_level_dn=0.0,
        projector_shape=(projector.height_px, projector.width_px),
        camera=camera,
        camera_is_cropped=False,
        projector=projector,
        unit="m",
        known=None,
        first_code=(0, 0),
        finest_bit=0,
        frames={pattern: Path(f"{pattern}.png") for pattern in frames},
    )


# ---- a published scan -----------------------------------------------------------------------------------------------


def published_folder() -> Path:
    """Where the published scan may be."""
    data = os.environ.get("PROCAM_RIG_DATA", str(Path(__file__).parents[3] / "shared" / "data"))
    return Path(data) / "graycode_scan_published_cloud"


def real_set() -> PhotographSet | None:
    """The published scan, cut to its object; its depths are those of the photographs as named."""
    folder = published_folder()
    if not (folder / "scan_0020").is_dir():
        return None
    calibration = cv2.FileStorage(str(folder / "procam_2016_12_09.yaml"), cv2.FILE_STORAGE_READ)
    frames = {
        f"gray-{axis}-{bit:02d}{'-inverse' * inverse}": _read(folder / "scan_0020", (a, bit, inverse))
        for a, axis in enumerate(("column", "row"))
        for bit in reversed(range(11))
        for inverse in (0, 1)
    }
    matrices = {key: calibration.getNode(key).mat() for key in ("cam_K", "pro_K", "cam_kc", "pro_kc", "R", "T")}
    shape = next(iter(frames.values())).shape
    camera = _lens(matrices, "cam", shape)
    projector = replace(
        _lens(matrices, "pro", (720, 1280)), rotation=matrices["R"], translation_m=matrices["T"].ravel() / 1000
    )
    whole = PhotographSet(
        name="real",
        manifest=_manifest("real", camera, projector, frames),
        frames=frames,
        devices=(camera, projector),
        known_xy_px=np.zeros((0, 2)),
        known_depth_m=np.zeros(0),
    )
    cut = cropped(whole, (0.07, 0.83, 0.24, 0.84))
    return replace(cut, known_xy_px=cut.scan.camera_xy_px, known_depth_m=cut.scan.points_m[:, 2])


def _read(folder: Path, key: tuple[int, int, int]) -> Photograph:
    path = next(folder.glob(f"*[[]{key[0]:02d}-{key[1]:02d}-{key[2]:02d}_*"))
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))


def _lens(matrices: Mapping[str, FloatArray], device: str, shape: tuple[int, int]) -> PinholeModel:
    k = matrices[f"{device}_K"]
    k1, k2, p1, p2, k3 = matrices[f"{device}_kc"].ravel().tolist()
    return PinholeModel(
        width_px=shape[1],
        height_px=shape[0],
        focal_px=(float(k[0, 0]), float(k[1, 1])),
        principal_point_px=(float(k[0, 2]), float(k[1, 2])),
        distortion=(k1, k2, p1, p2, k3),
        rotation=np.eye(3),
        translation_m=np.zeros(3),
    )


# ---- table ----------------------------------------------------------------------------------------------------------
