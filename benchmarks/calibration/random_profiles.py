"""Profiles of random simulated rigs, drawn over the ranges that :mod:`random_rigs` names."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.devices.simulated.optics import SimulatedOptics, directions, make_optics
from rig.devices.simulated.settings import SimulatedLensSettings
from rig.stages.geometry import TAPE_SIGMA

FloatArray = NDArray[np.float64]

KINDS = ("random", "small", "tiny")
TINY = Path(__file__).parents[2] / "hw_profiles" / "ci-tiny.toml"
EFFECTS = ("corner-blur", "lamp", "tone", "8-bit", "mjpeg", "s-curve", "halo")
_LATENCY_S = 0.046
_CORNER_MARGIN = 0.12
"""Of the room's length and width: nearer to a wall no device stands."""


@dataclass(frozen=True)
class Shapes:
    """(height, width) of the pictures, in pixels."""

    camera: tuple[int, int] = (480, 640)
    projector: tuple[int, int] = (384, 512)


SMALL = Shapes((240, 320), (192, 256))


@dataclass(frozen=True)
class Room:
    """Its size, and the vertical edge that the rig looks at."""

    size_m: FloatArray
    corner: NDArray[np.int64]
    """(2,) 0 or 1: which side of x and of y."""

    @property
    def edge_m(self) -> FloatArray:
        """(2,) where it stands."""
        return np.asarray(self.corner * self.size_m[:2])


def rig_of(seed: int, effects: Sequence[str] = (), shapes: Shapes = Shapes(), *, in_line: bool = False) -> str:
    """Return the profile of a random rig, as TOML; one device may stand nearly in line behind the other."""
    random = np.random.default_rng([seed, 4096])
    room = Room(np.append(random.uniform(2.5, 7.0, 2), random.uniform(2.3, 3.6)), random.integers(0, 2, 2))
    projector = _lens(random, "projector", shapes.projector, shift=random.uniform(0, 0.6))
    camera = _lens(random, "camera", shapes.camera, shift=random.normal(0, 0.01))
    target = np.append(room.edge_m, room.size_m[2] * random.uniform(0.35, 0.65))
    projector["position_m"], camera["position_m"] = _places(random, room, in_line=in_line)
    for lens, shape in ((projector, shapes.projector), (camera, shapes.camera)):
        lens["look_at_m"] = _aim(lens, shape, target + random.normal(0, 0.04, 3) * room.size_m)
        lens["position_m"] = [float(x) for x in lens["position_m"]]
    if "corner-blur" in effects:
        for lens in (projector, camera):
            lens["corner_blur_px"] = float(lens["blur_px"] * random.uniform(0.6, 2.0))
    if "lamp" in effects:
        projector["lamp_drift"], projector["lamp_warm_up_s"] = random.uniform(0.002, 0.03), random.uniform(30, 300)
    if "tone" in effects:
        camera["tone"] = ["srgb", float(random.uniform(1.8, 2.4))][random.integers(2)]
    bits = 8 if {"8-bit", "mjpeg"} & set(effects) else int(random.choice([8, 10, 12]))
    camera["black_level_dn"] = float(random.uniform(0.01, 0.03) * 2**bits)
    profile = _profile(random, seed, room, (camera, projector), bits, shapes)
    # Drawn last, so that the rig is the one without them in all else.
    quality, s_shape = int(random.integers(75, 96)), float(random.uniform(0.05, 0.4))
    if "mjpeg" in effects:
        profile = _with_line(profile, "camera", f"jpeg_quality = {quality}")
    if "s-curve" in effects:
        profile = _with_line(profile, "camera", f"s_shape = {s_shape}")
    for name, shape in (("camera", shapes.camera), ("projector", shapes.projector)) if "halo" in effects else ():
        share, radius = np.exp(random.uniform(np.log((0.002, 0.01)), np.log((0.02, 0.06))))
        profile = _with_line(profile, name, f"halo = {share:.4f}\nhalo_px = {radius * shape[1]:.2f}")
    return profile


def _with_line(profile: str, device: str, line: str) -> str:
    """The same rig, its camera or projector with another line."""
    head = f"[[simulation.{device}]]"
    return profile.replace(head, f"{head}\n{line}")


def _lens(random: np.random.Generator, name: str, shape: tuple[int, int], shift: float) -> dict[str, Any]:
    height, width = shape
    focal_px = width / 2 / np.tan(np.radians(random.uniform(45, 100)) / 2)
    wide = (0.5 * np.hypot(*shape) / focal_px) ** 2
    """Of the corners: distortion is drawn as a share of the picture's size there, -4 ... 2 %."""
    return {
        "name": name,
        "roll_deg": float(random.normal(0, 1.5)),
        "focal_px": float(focal_px),
        "principal_point_px": [
            float((width - 1) / 2 + random.normal(0, 0.004) * width),
            float((height - 1) / 2 + shift * height + random.normal(0, 0.003) * height),
        ],
        "distortion": [
            float(random.uniform(-0.04, 0.02) / wide),
            float(random.normal(0, 0.004) / wide**2),
            *(float(k) for k in random.normal(0, 3e-4, 2)),
            0.0,
        ],
        "vignetting": [float(random.uniform(-0.3, 0.0)), float(random.uniform(0, 0.04))],
        "blur_px": float(random.uniform(0.2, 1.2)),
    }


def _places(random: np.random.Generator, room: Room, *, in_line: bool) -> tuple[FloatArray, FloatArray]:
    """Projector and camera, 0.3 to 1.2 m apart, in the half of the room away from the edge they look at.

    In line, the camera is up to a quarter of the way off the line from the projector to the edge.
    """
    while True:
        away = np.abs(1 - room.corner - random.uniform(_CORNER_MARGIN, 0.45, 2))
        projector = np.append(away * room.size_m[:2], room.size_m[2] * random.uniform(0.3, 0.7))
        step = random.normal(size=3) * (1.0, 1.0, 0.4)
        if in_line:
            ahead = np.append(room.edge_m - projector[:2], 0.0)
            step = random.choice([-1, 1]) * ahead / np.linalg.norm(ahead) + 0.25 * random.uniform(-1, 1, 3)
        camera = projector + step / np.linalg.norm(step) * random.uniform(0.3, 1.2)
        share = camera / room.size_m
        if (share > _CORNER_MARGIN).all() and (share < 1 - _CORNER_MARGIN).all():
            return projector, camera


def _aim(lens: Mapping[str, Any], shape: tuple[int, int], target_m: FloatArray) -> list[float]:
    """Where the axis has to point for the picture's middle to fall on the target, lens shift or not."""
    forward = target_m - lens["position_m"]
    above = np.arctan((lens["principal_point_px"][1] - (shape[0] - 1) / 2) / lens["focal_px"])
    level = np.linalg.norm(forward[:2])
    down = np.arctan2(forward[2], level) - above
    direction = np.append(forward[:2] / level * np.cos(down), np.sin(down))
    return [float(x) for x in lens["position_m"] + 2 * direction]


def _meets(room: Room, optics: SimulatedOptics, xy_px: FloatArray) -> FloatArray:
    """(N, 3) where pixels meet the walls of the box."""
    rays, origin = directions(optics, xy_px), optics.position_m
    with np.errstate(divide="ignore"):
        along = np.where(rays > 0, (room.size_m - origin) / rays, -origin / rays)
    return np.asarray(origin + along.min(axis=1)[:, None] * rays)


def _profile(
    random: np.random.Generator,
    seed: int,
    room: Room,
    lenses: tuple[dict[str, Any], dict[str, Any]],
    bits: int,
    shapes: Shapes,
) -> str:
    camera, projector = lenses
    (camera_height_px, camera_width_px), (height_px, width_px) = shapes.camera, shapes.projector
    optics = make_optics(SimulatedLensSettings(**_tuples(projector, SimulatedLensSettings)), shapes.projector)
    spots = [
        [round(width_px * 0.2), round(height_px * 0.5)],
        [round(width_px * 0.8), round(height_px * 0.5)],
    ]
    ends = _meets(room, optics, np.array(spots, dtype=np.float64))
    tape_m = float(np.linalg.norm(ends[1] - ends[0]) * (1 + TAPE_SIGMA * random.normal()))
    hfov = {
        lens["name"]: float(2 * np.degrees(np.arctan(shape[1] / 2 / lens["focal_px"])) * random.uniform(0.97, 1.03))
        for lens, shape in ((camera, shapes.camera), (projector, shapes.projector))
    }
    ambient = float(random.uniform(0, 0.05) * random.integers(0, 2))
    camera |= {
        "sensitivity_e_per_s": 1.1e6,
        "full_well_e": float(random.uniform(8000, 32000)),
        "read_noise_e": float(random.uniform(3, 12)),
        "compression": float(random.uniform(0, 0.1)),
        "stale_frame_rate": 0.02,
    }
    projector |= {
        "flux": 10.0,
        "contrast": float(np.exp(random.uniform(np.log(200), np.log(5000)))),
        "gamma": float(random.uniform(1.8, 2.4)),
        "s_shape": float(random.uniform(0, 0.4)),
        "latency_s": _LATENCY_S,
        "jitter_s": 0.008,
    }
    size_m = room.size_m * (1 + 0.003 * random.normal(size=3))
    if room.corner[0] != room.corner[1]:
        # A profile's x ends at the wall on the right of the view: before these corners that is the simulated room's y.
        size_m[:2] = size_m[1::-1]
    device = {"driver": "simulated", "width_px": camera_width_px, "height_px": camera_height_px, "bit_depth": bits}
    device |= {"channels": 1, "frame_rate_hz": 30.0, "exposure_range_s": [1e-4, 2.0], "exposure_s": 0.0166667}
    display = {"driver": "simulated", "width_px": width_px, "height_px": height_px, "bit_depth": 8}
    display |= {"refresh_rate_hz": 60.0, "latency_s": 0.06}
    wall = random.uniform(0.3, 0.85)
    reflectance = {
        face: float(np.clip(wall + random.normal(0, 0.04), 0.25, 0.88))
        for face in ("floor", "ceiling", "x0", "x1", "y0", "y1")
    }
    tables: list[tuple[str, Mapping[str, Any]]] = [
        ("", {"schema": 2, "name": f"random-{seed}", "description": "Random simulated rig"}),
        ("[camera]", {"name": "camera", **device, "hfov_deg": hfov["camera"]}),
        ("[projector]", {"name": "projector", **display, "hfov_deg": hfov["projector"]}),
        ("timing", {"timeout_s": 5.0, "retries": 8}),
        ("[scale]", {"projector": "projector", "spots_px": spots, "distance_m": tape_m}),
        ("surface", _surface(size_m)),
        ("patterns", {"checker_size_px": 8, "checker_shifts": 25, "response_levels": 9, "frames_averaged": 1}),
        ("brightness", {"target_white_share": 0.7}),
        ("simulation", _simulation(random, seed, room, ambient)),
        ("simulation.reflectance", reflectance),
        *(("[simulation.posters]", _poster(random, room)) for _ in range(random.integers(0, 4))),
        ("[simulation.camera]", camera),
        ("[simulation.projector]", projector),
    ]
    return "\n".join(_table(name, values) for name, values in tables)


def _surface(size_m: FloatArray) -> dict[str, Any]:
    patch = round(float(max(size_m)) / 14, 3)
    return {"kind": "box", "closed": True, "size_m": size_m.tolist(), "patch_size_m": patch, "right_angles": True}


def _simulation(random: np.random.Generator, seed: int, room: Room, ambient: float) -> dict[str, Any]:
    flickers = bool(random.integers(0, 2))
    return {
        "seed": seed,
        "size_m": room.size_m.tolist(),
        "cell_size_m": float(max(room.size_m) / 25),
        "texture": float(random.uniform(0, 0.04)),
        "ambient": ambient,
        "ambient_flicker_hz": float(random.choice([100.0, 120.0])),
        "ambient_flicker": float(random.uniform(0.05, 0.3)) if flickers else 0.0,
    }


def _poster(random: np.random.Generator, room: Room) -> dict[str, Any]:
    """On one of the walls that the rig looks at."""
    axis = int(random.integers(0, 2))
    lower = random.uniform(0.1, 0.6, 2)
    upper = lower + random.uniform(0.1, 0.35, 2)
    face = f"{'xy'[axis]}{room.corner[axis]}"
    return {
        "face": face,
        "lower": lower.tolist(),
        "upper": upper.tolist(),
        "reflectance": float(random.uniform(0.1, 0.85)),
    }


def _tuples(values: Mapping[str, Any], model: type[SimulatedLensSettings]) -> dict[str, Any]:
    kept = {key: value for key, value in values.items() if key in model.model_fields}
    return {key: tuple(value) if isinstance(value, list) else value for key, value in kept.items()}


def _table(name: str, values: Mapping[str, Any]) -> str:
    head = f"\n[{name}]" if name else ""
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    return "\n".join([head, *lines] if head else lines)


def tiny(seed: int) -> str:
    """Return ci-tiny with other noise and tapes, its camera of 12 bits where the seed is even and of 8 where it is odd.

    In the profile itself every length is the true one, so that no error of its sessions is as large as a tape's.
    """
    text = re.sub(r"(?m)^seed = \d+", f"seed = {seed}", TINY.read_text(encoding="utf-8"))
    x, y, z, spots = 1 + TAPE_SIGMA * np.random.default_rng([seed, 4876]).normal(size=4)
    for exact, taken in (
        ("size_m = [4.80, 4.80, 2.40]", f"size_m = [{4.8 * x:.4f}, {4.8 * y:.4f}, {2.4 * z:.4f}]"),
        ("distance_m = 4.876", f"distance_m = {4.876 * spots:.4f}"),
    ):
        if exact not in text:
            raise ValueError(f"{TINY} does not say {exact!r} any more")
        text = text.replace(exact, taken)
    if seed % 2 == 0:
        return text
    # Of the 12-bit camera's 64 of 4095 remain 4 of 255.
    return text.replace("bit_depth = 12", "bit_depth = 8").replace("black_level_dn = 64.0", "black_level_dn = 4.0")


def profile_of(kind: str, seed: int, effects: Sequence[str]) -> str:
    """Return the profile of one of :data:`KINDS`, as TOML."""
    if kind == "tiny":
        return tiny(seed)
    return rig_of(seed, effects, SMALL if kind == "small" else Shapes())
