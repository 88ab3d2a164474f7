"""A synthetic box room, seen by a camera and a projector with known lenses; independent of calibration."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from calibration.geometry.known.nominal import NominalIntrinsics
from calibration.geometry.pinhole import vector_of


@dataclass(frozen=True, kw_only=True)
class Device:
    """A lens in the room; pose by position, a point in the middle of its view, and roll."""

    shape: tuple[int, int]
    focal_px: float
    principal_point_px: tuple[float, float]
    distortion: tuple[float, ...]
    position_m: tuple[float, float, float]
    look_at_m: tuple[float, float, float]
    roll_deg: float = 0.0

    @property
    def rotation(self):
        """(3, 3) device_from_room."""
        ahead = np.subtract(self.look_at_m, self.position_m)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, [0, 0, 1])
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(ahead, right), ahead])
        c, s = np.cos(np.radians(self.roll_deg)), np.sin(np.radians(self.roll_deg))
        return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ axes

    @property
    def matrix(self):
        """(3, 3) of the pinhole."""
        x, y = self.principal_point_px
        return np.array([[self.focal_px, 0, x], [0, self.focal_px, y], [0, 0, 1]])

    def rays(self, xy_px):
        """(N, 3) directions in the room."""
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-12)
        undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
        points = np.ascontiguousarray(xy_px, dtype=np.float64).reshape(-1, 1, 2)
        plane = undistort(points, self.matrix, np.array(self.distortion), R=np.eye(3), P=np.eye(3), criteria=stop)
        plane = np.asarray(plane).reshape(-1, 2)
        return np.column_stack([plane, np.ones(len(plane))]) @ self.rotation

    def image_of(self, points_m):
        """(N, 2) pixels, and whether each lies in front and inside the picture."""
        local = (points_m - np.array(self.position_m)) @ self.rotation.T
        vector = cv2.Rodrigues(self.rotation)[0]
        shift = -self.rotation @ np.array(self.position_m)
        xy, _ = cv2.projectPoints(
            points_m.reshape(-1, 1, 3), vector, shift, self.matrix, distCoeffs=np.array(self.distortion)
        )
        xy = np.asarray(xy).reshape(-1, 2)
        size = np.array(self.shape[::-1])
        seen = (xy > -0.5).all(1) & (xy < size - 0.5).all(1) & (local[:, 2] > 0.1)
        # Far outside the picture the distortion polynomial may fold back into it.
        slope = np.linalg.norm(local[:, :2], axis=1) / np.maximum(local[:, 2], 1e-9)
        return xy, seen & (slope < 1.3 * np.hypot(*size) / self.focal_px)


CAMERA = Device(
    shape=(960, 1280),
    focal_px=531.7,
    principal_point_px=(644.3, 472.8),
    distortion=(-0.021, 0.0025, 0.0004, -0.0003, 0.0),
    position_m=(0.60, 1.42, 1.38),
    look_at_m=(4.60, 4.55, 1.12),
    roll_deg=1.3,
)
PROJECTOR = Device(
    shape=(768, 1024),
    focal_px=431.2,
    principal_point_px=(508.6, 402.4),
    distortion=(0.008, -0.001, 0.0, 0.0003, 0.0),
    position_m=(1.0, 1.0, 1.2),
    look_at_m=(4.80, 4.72, 1.20),
    roll_deg=-0.6,
)

FACES = (("x0", "x1"), ("y0", "y1"), ("floor", "ceiling"))


@dataclass(frozen=True, kw_only=True)
class SyntheticRoom:
    """Truth of one set-up, and the data sheets that the fit is given."""

    camera: Device = CAMERA
    projector: Device = PROJECTOR
    size_m: tuple[float, float, float] = (4.8, 4.8, 2.4)
    faces: tuple[str, ...] = ("x0", "x1", "y0", "y1", "floor", "ceiling")
    camera_hfov_deg: float = 100.0
    projector_hfov_deg: float = 98.0
    noise_px: float = 0.1
    outlier_share: float = 0.005
    edge_bias_px: float = 0.3
    seed: int = 7

    def hits(self, device, xy_px):
        """(N, 3) first surface points along pixels, NaN where there is none; (N,) distance to an edge."""
        origin, rays = np.array(device.position_m), device.rays(xy_px)
        wall = np.where(rays > 0, np.array(self.size_m), 0.0)
        with np.errstate(divide="ignore"):
            along = (wall - origin) / rays
        axis = along.argmin(1)
        points = origin + along.min(1)[:, None] * rays
        high = np.take_along_axis(rays, axis[:, None], 1)[:, 0] > 0
        names = np.array(FACES)[axis, high.astype(int)]
        points[~np.isin(names, self.faces)] = np.nan
        standing = np.array([[name in self.faces for name in pair] for pair in FACES]).T
        to_faces = np.where(standing[:, None], np.abs(np.stack([points, np.array(self.size_m) - points])), np.inf)
        return points, np.sort(to_faces.min(axis=0), axis=1)[:, 1]

    def correspondences(self, step_px=4):
        """(N, 2) camera and projector pixels: noise, some outliers, a bias near edges as of defocus."""
        height, width = self.camera.shape
        rows, columns = np.mgrid[0:height:step_px, 0:width:step_px]
        xy = np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64)
        points, edge_m = self.hits(self.camera, xy)
        known = np.isfinite(points).all(1)
        xy, points, edge_m = xy[known], points[known], edge_m[known]
        image, seen = self.projector.image_of(points)
        xy, image, edge_m = xy[seen], image[seen], edge_m[seen]
        random = np.random.default_rng(self.seed)
        image = image + random.normal(0, self.noise_px, image.shape)
        image += self.edge_bias_px * np.exp(-edge_m / 0.02)[:, None]
        wild = random.random(len(image)) < self.outlier_share
        image[wild] += random.uniform(-40, 40, (wild.sum(), 2))
        return xy, image

    @property
    def nominal(self):
        """What the data sheets say of both lenses."""
        return NominalIntrinsics.of(
            camera_shape=self.camera.shape,
            projector_shape=self.projector.shape,
            camera_hfov_deg=self.camera_hfov_deg,
            projector_hfov_deg=self.projector_hfov_deg,
        )

    def changed(self, **values):
        """Another room; values of `camera` and `projector` are changes to them."""
        for name in ("camera", "projector"):
            if name in values:
                values[name] = replace(getattr(self, name), **values[name])
        return replace(self, **values)


def errors_by_sigma(room, pair):
    """Of both focal lengths, and of the devices' turn against each other; each by its own sigma."""

    def figures(one):
        turn = vector_of(one.projector.rotation @ room.camera.rotation @ room.projector.rotation.T)
        return np.array([one.camera.focal_px[0], one.projector.focal_px[0], *turn])

    true = np.array([room.camera.focal_px, room.projector.focal_px, 0.0, 0.0, 0.0])
    return (figures(pair) - true) / pair.sigmas_of(figures)


@pytest.fixture(scope="session")
def room():
    """The paper's room with the simulated world's devices."""
    return SyntheticRoom()
