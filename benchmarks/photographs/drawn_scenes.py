"""Things and devices drawn by chance, and the photographs of a Gray code that the camera takes of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry.pinhole import PinholeModel, project, world_rays
from calibration.structured_light.gray import gray_code_patterns

FloatArray = NDArray[np.float64]


# ---- the thing ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Thing:
    """A wall z = f(x, y) in the camera's axes with plates and balls before it."""

    slope: FloatArray
    wave_m: float
    fold: FloatArray
    """(3,) a corner: place, direction and slope of the line from which the wall comes nearer on both sides."""
    plates: FloatArray
    """(P, 5) left, right, top, bottom, depth. [m]"""
    balls: FloatArray
    """(B, 4) middle and radius. [m]"""

    def wall_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Depth of the wall."""
        wave = self.wave_m * np.sin(9 * x + 1) * np.cos(7 * y)
        along = x * np.cos(self.fold[1]) + y * np.sin(self.fold[1]) - self.fold[0]
        return np.asarray(1.0 + self.slope[0] * x + self.slope[1] * y + wave - self.fold[2] * np.abs(along))

    def along(self, origin: FloatArray, rays: FloatArray) -> FloatArray:
        """(N,) how far along each ray the thing is met first; inf where it is not."""
        far = np.full(len(rays), 1.0) / rays[:, 2]
        for _ in range(40):
            at = origin + far[:, None] * rays
            step = 0.8 * (self.wall_m(at[:, 0], at[:, 1]) - at[:, 2]) / rays[:, 2]
            far = far + step
            if np.abs(step).max() < 1e-7:
                break
        at = origin + far[:, None] * rays
        met = np.abs(self.wall_m(at[:, 0], at[:, 1]) - at[:, 2]) < 1e-6
        far = np.where(met & (far > 0), far, np.inf)
        for left, right, top, bottom, depth in self.plates:
            step = (depth - origin[2]) / rays[:, 2]
            x, y = (origin[:2] + step[:, None] * rays[:, :2]).T
            inside = (x > left) & (x < right) & (y > top) & (y < bottom) & (step > 0)
            far = np.where(inside, np.minimum(far, step), far)
        for *middle, radius in self.balls:
            a, b = (rays**2).sum(axis=1), (rays * (origin - middle)).sum(axis=1)
            under = b**2 - a * (((origin - middle) ** 2).sum() - radius**2)
            step = (-b - np.sqrt(np.maximum(under, 0))) / a
            far = np.where((under > 0) & (step > 0), np.minimum(far, step), far)
        return np.asarray(far)


def _thing(random: np.random.Generator) -> Thing:
    plates = [
        [x - w, x + w, y - h, y + h, z]
        for x, y, w, h, z in random.uniform(
            (-0.3, -0.25, 0.04, 0.04, 0.7), (0.3, 0.25, 0.2, 0.2, 0.85), (random.integers(0, 4), 5)
        )
    ]
    balls = random.uniform((-0.25, -0.2, 0.7, 0.05), (0.25, 0.2, 0.85, 0.15), (random.integers(0, 3), 4))
    return Thing(
        slope=random.uniform(-0.3, 0.3, 2),
        wave_m=float(random.choice([0.0, 0.01, 0.04])),
        fold=np.array([random.uniform(-0.1, 0.1), random.uniform(0, np.pi), random.choice([0.0, 0.0, 0.3])]),
        plates=np.array(plates).reshape(-1, 5),
        balls=balls,
    )


# ---- the devices ----------------------------------------------------------------------------------------------------


def _turned(random: np.random.Generator) -> float:
    """Roll of a device: usual, or on its side, or on its head. [rad]"""
    quarter = float(random.choice([0, 0, 0, 1, 2, 3]))
    return quarter * np.pi / 2 + float(random.normal(0, 0.05))


def _looking(position_m: FloatArray, at_m: FloatArray, roll: float) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation of a device that looks at a point."""
    forward = (at_m - position_m) / np.linalg.norm(at_m - position_m)
    down = np.array([0.0, 1.0, 0.0])
    right = np.cross(down, forward)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    turned = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    rotation = turned @ np.stack([right, down, forward])
    return rotation, -rotation @ position_m


def _devices(random: np.random.Generator) -> tuple[PinholeModel, PinholeModel]:
    height = int(random.integers(240, 481))
    width = int(height * random.choice([1.0, 4 / 3, 16 / 9]))
    turned, _ = _looking(np.zeros(3), np.array([0, 0, 1.0]), _turned(random))
    wide = 2 * np.tan(np.radians(random.uniform(35, 60)) / 2)
    camera = _lens(random, (height, width), width / wide, turned, np.zeros(3), shift=0.02, bends=0.15)
    rows = int(random.integers(60, 300))
    columns = int(rows * random.choice([1.0, 4 / 3, 16 / 9]))
    away = random.uniform(0.06, 0.35)
    angle = random.uniform(0, 2 * np.pi)
    place = np.array([away * np.cos(angle), away * np.sin(angle), random.normal(0, 0.03)])
    rotation, translation = _looking(place, np.append(random.normal(0, 0.03, 2), 0.9), _turned(random))
    wide = 2 * np.tan(np.radians(random.uniform(30, 55)) / 2)
    projector = _lens(random, (rows, columns), columns / wide, rotation, translation, shift=0.2, bends=0.03)
    # Manifests give the pose from the camera's axes: those are the world.
    return replace(camera, rotation=np.eye(3)), replace(
        projector, rotation=rotation @ camera.rotation.T, translation_m=translation
    )


def _lens(
    random: np.random.Generator,
    shape: tuple[int, int],
    focal_px: float,
    rotation: FloatArray,
    translation: FloatArray,
    *,
    shift: float,
    bends: float,
) -> PinholeModel:
    height, width = shape
    corner = 0.25 * (width**2 + height**2) / focal_px**2
    return PinholeModel(
        width_px=width,
        height_px=height,
        focal_px=(focal_px, focal_px * float(random.uniform(0.99, 1.01))),
        principal_point_px=(
            (width - 1) / 2 + random.normal(0, 0.3 * shift) * width,
            (height - 1) / 2 + random.uniform(-shift, shift) * height,
        ),
        distortion=(random.uniform(-bends, bends / 3) / max(1, 4 * corner), 0.0, 1e-3 * random.normal(), 0.0, 0.0),
        rotation=rotation,
        translation_m=translation,
    )


# ---- the photographs ------------------------------------------------------------------------------------------------


@dataclass(eq=False, kw_only=True)
class DrawnSet:
    """Photographs in dn, with what their manifest says of them."""

    thing: Thing
    devices: tuple[PinholeModel, PinholeModel]
    """True ones."""
    told: tuple[PinholeModel, PinholeModel]
    turned: FloatArray
    """(3, 3) from the thing's axes to the camera's."""
    frames: dict[str, NDArray[Any]]
    full_scale_dn: int
    suffix: str
    jpeg: int
    finest_bit: int = 0
    first_code: tuple[int, int] = (0, 0)
    drawn: str = ""
    fault: str = "none"


def rays_of(camera: PinholeModel, turn: FloatArray, xy_px: FloatArray) -> FloatArray:
    """(N, 3) rays of pixels in the thing's axes."""
    return np.asarray(world_rays(camera, xy_px) @ turn)


def _grid(shape: tuple[int, int], right: float, down: float) -> FloatArray:
    row, column = np.mgrid[: shape[0], : shape[1]]
    return np.column_stack([column.ravel() + right, row.ravel() + down]).astype(np.float64)


@dataclass(frozen=True, eq=False)
class _Sample:
    xy_px: FloatArray
    """(N, 2) projector's pixel, unbounded."""
    lit: NDArray[np.bool_]
    light: FloatArray
    dark: FloatArray


def _sample(set_: DrawnSet, offset_px: tuple[float, float]) -> _Sample:
    camera, projector = set_.devices
    turn = set_.turned
    rays = rays_of(camera, turn, _grid((camera.height_px, camera.width_px), *offset_px))
    along = set_.thing.along(np.zeros(3), rays)
    seen = np.isfinite(along)
    points = np.where(seen[:, None], np.where(seen, along, 1.0)[:, None] * rays, 1.0)
    xy = project(projector, points @ turn.T)
    place = turn.T @ projector.position_m
    towards = points - place
    reached = set_.thing.along(place, towards) > 1 - 1e-3
    inside = (
        (xy > -0.5).all(axis=1) & (xy[:, 0] < projector.width_px - 0.5) & (xy[:, 1] < projector.height_px - 0.5) & seen
    )
    texture = 0.7 + 0.3 * np.sin(60 * points[:, 0]) * np.sin(47 * points[:, 1] + 3 * points[:, 0])
    return _Sample(
        xy, inside & reached, np.where(seen, texture / (towards**2).sum(axis=1), 0), np.where(seen, texture, 0)
    )


@dataclass(frozen=True, kw_only=True)
class _Bench:
    bits: int
    blur_px: float
    projector_blur_px: float
    room_light: float
    around: float
    gamma: float
    noise: float


def _photograph(
    set_: DrawnSet, samples: list[_Sample], codes: NDArray[np.uint8], bench: _Bench, random: np.random.Generator
) -> NDArray[Any]:
    camera, projector = set_.devices
    shown = codes.astype(np.float32) / 255
    if bench.projector_blur_px > 0:
        shown = cv2.GaussianBlur(
            cv2.resize(shown, None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST), (0, 0), 3 * bench.projector_blur_px
        )
    scale = shown.shape[1] / projector.width_px
    light = np.zeros(camera.height_px * camera.width_px)
    for one in samples:
        at = np.rint((one.xy_px + 0.5) * scale - 0.5).astype(np.int64)
        at = np.clip(at, 0, (shown.shape[1] - 1, shown.shape[0] - 1))
        light += np.where(one.lit, shown[at[:, 1], at[:, 0]], 0) * one.light
        light += bench.room_light * one.dark + bench.around * shown.mean() * one.dark
    picture = (light / len(samples)).reshape(camera.height_px, camera.width_px)
    if bench.blur_px > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), bench.blur_px)
    most = np.quantile([one.light for one in samples], 0.999) * 1.25 + bench.room_light + bench.around
    share = np.clip(picture / most, 0, 1) ** (1 / bench.gamma)
    share += bench.noise * random.normal(size=share.shape) * np.sqrt(0.02 + share)
    full = 2**bench.bits - 1
    return np.asarray(np.clip(np.rint(share * full), 0, full).astype(np.uint8 if bench.bits == 8 else np.uint16))


def photographed(random: np.random.Generator) -> DrawnSet:
    """Right photographs, and what their manifest says."""
    devices = _devices(random)
    bits = int(random.choice([8, 8, 12, 16]))
    suffix = str(random.choice([".png", ".tif"])) if bits > 8 else str(random.choice([".png", ".jpg", ".bmp"]))
    set_ = DrawnSet(
        thing=_thing(random),
        devices=devices,
        told=devices,
        frames={},
        full_scale_dn=2**bits - 1,
        suffix=suffix,
        jpeg=int(random.integers(60, 96)),
        turned=_looking(np.zeros(3), np.array([0, 0, 1.0]), _turned(random))[0],
    )
    bench = _bench(random, bits)
    _photograph_all(set_, bench, random)
    _choose(set_, random)
    set_.drawn = _told(set_, bench)
    return set_


def _bench(random: np.random.Generator, bits: int) -> _Bench:
    return _Bench(
        bits=bits,
        blur_px=float(random.uniform(0, 1.2)),
        projector_blur_px=float(random.uniform(0, 0.6)),
        room_light=float(random.uniform(0, 0.3)),
        around=float(random.uniform(0, 0.4)),
        gamma=float(random.choice([1.0, 1.0, 2.2])),
        noise=float(random.uniform(0.001, 0.012)),
    )


def _photograph_all(set_: DrawnSet, bench: _Bench, random: np.random.Generator) -> None:
    """A Gray code with all inverses, white and black."""
    third = (-1 / 3, 0, 1 / 3)
    samples = [_sample(set_, (a, b)) for a in third for b in third]
    shape = set_.devices[1].height_px, set_.devices[1].width_px
    patterns = gray_code_patterns(shape)
    set_.frames = {one.name: _photograph(set_, samples, one.codes, bench, random) for one in patterns}
    white = np.full(shape, 255, np.uint8)
    plain = {"white": white, "black": 0 * white}
    set_.frames |= {name: _photograph(set_, samples, codes, bench, random) for name, codes in plain.items()}


def _told(set_: DrawnSet, bench: _Bench) -> str:
    camera, projector = set_.devices
    ratio = projector.focal_px[0] / camera.focal_px[0]
    return (
        f"camera {camera.width_px}x{camera.height_px} projector {projector.width_px}x{projector.height_px} (px ratio "
        f"{ratio:.2f}) {bench.bits} bit {set_.suffix} q{set_.jpeg} blur "
        f"{bench.blur_px:.1f}/{bench.projector_blur_px:.1f} noise {bench.noise:.3f} "
        f"around {bench.around:.2f} base {np.linalg.norm(projector.position_m):.2f} "
        f"plates {len(set_.thing.plates)} balls {len(set_.thing.balls)} {len(set_.frames)} frames "
        f"from bit {set_.finest_bit}"
    )


def _choose(set_: DrawnSet, random: np.random.Generator) -> None:
    """Leave out some of the photographs, as people do."""
    if random.random() < 0.3:
        set_.frames = {name: frame for name, frame in set_.frames.items() if not name.endswith("-inverse")}
    elif random.random() < 0.5:
        del set_.frames["white"], set_.frames["black"]
    if random.random() < 0.25:
        # The axis along the baseline tells depth.
        here, there = project(set_.devices[1], np.array([[0, 0, 0.9], [0, 0, 1.1]]) @ set_.turned.T)
        useless = "row" if abs(there - here)[0] > abs(there - here)[1] else "column"
        set_.frames = {name: frame for name, frame in set_.frames.items() if f"-{useless}-" not in name}
    if random.random() < 0.2:
        set_.finest_bit = 1
        set_.frames = {name: frame for name, frame in set_.frames.items() if "-00" not in name}
