"""Luminance of the paper's room with a projector of 3,000 lm, beside Mitsuba 3: by surface, projector white.

python benchmarks/planning/light_against_mitsuba.py [--spp 64] [--width 160]

A plan's unit is the illuminance on the plane across the axis at 1 m: lumens over the area that the picture covers
there. What Mitsuba's ``projector`` makes of a picture of ones is read off a matte screen at 1 m, direct light alone;
the picture is scaled to the plan's illuminance, and Mitsuba's pixels are then luminances in cd/m². Compared are means
over each surface's part of the picture, by the area that each pixel covers. Needs ``pip install mitsuba``; says so
and ends with 0 where it is missing. Status 1 where a surface is off by more than 1 %.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from rig.plan.light import LitRoom, lit_room
from rig.plan.measures import weighted_mean
from rig.plan.request import load_room

ROOM = Path(__file__).parents[2] / "hw_profiles" / "rooms" / "paper-room.toml"
LIMIT_PERCENT = 1.0
DEPTH = 80
"""Bounces: 0.7 to the 80th is 4e-13."""


def main() -> int:
    """Print a table, return the status."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--spp", type=int, default=64)
    options.add_argument("--width", type=int, default=160)
    options.add_argument("--patch-m", type=float, default=0.4)
    given = options.parse_args()
    try:
        import mitsuba
    except ImportError:
        print("mitsuba is not installed (pip install mitsuba): nothing was compared")
        return 0
    mitsuba.set_variant("scalar_rgb")
    request = load_room(ROOM)
    request = request.model_copy(update={"room": request.room.model_copy(update={"patch_m": given.patch_m})})
    started = time.process_time()
    lit = lit_room(request, given.width)
    ours = lit.luminance(np.ones(lit.n_pixels))
    our_s, started = time.process_time() - started, time.process_time()
    theirs = rendered(mitsuba, lit, given.spp)
    print(f"plan {our_s:.2f} s, Mitsuba {mitsuba.__version__} {time.process_time() - started:.0f} s of processor time")
    worst = 0.0
    names = lit.room.shape.surface_of[lit.hits.patch]
    for k, name in enumerate((*lit.room.shape.names, "all")):
        inside = lit.lit & ((names == k) | (name == "all"))
        if not inside.any():
            continue
        area = lit.footprints_m2[inside]
        means = [weighted_mean(values[inside], area) for values in (ours, theirs)]
        off = 100 * (means[0] / means[1] - 1)
        worst = max(worst, abs(off))
        print(f"{name:8} plan {means[0]:7.3f} cd/m², Mitsuba {means[1]:7.3f} cd/m²: {off:+.2f} %")
    print(f"largest difference {worst:.2f} %, limit {LIMIT_PERCENT:g} %")
    return int(worst > LIMIT_PERCENT)


def rendered(mi, lit: LitRoom, spp: int) -> np.ndarray:
    """(n,) luminance of each pixel of the projector's view, by path tracing. [cd/m²]"""
    unit_lx = illuminance_at_1_m(mi, lit)
    content = scene_with_projector(mi, lit, lit.lux_per_unit / unit_lx, DEPTH)
    for face in lit.room.surface.faces:
        rho = float(lit.room.surface.reflectance[face.first_patch])
        columns = np.stack([face.edge_u_m / 2, face.edge_v_m / 2, face.normal, face.points(0.5, 0.5)], axis=1)
        content[f"face_{face.name}"] = matte(mi, columns, rho)
    return pixels_of(mi, content, spp)


def illuminance_at_1_m(mi, lit: LitRoom) -> float:
    """What a picture of ones makes of a matte screen at 1 m, seen at its middle. [lx]"""
    content = scene_with_projector(mi, lit, 1.0, 2)
    right, down, ahead = lit.views[0].pose.rotation
    columns = np.stack([9 * right, 9 * down, -ahead, lit.views[0].pose.position_m + ahead], axis=1)
    content["screen"] = matte(mi, columns, 0.5)
    seen = pixels_of(mi, content, 64).reshape(lit.views[0].lens.shape)
    rows, columns = (slice(n // 2 - 2, n // 2 + 2) for n in lit.views[0].lens.shape)
    return float(np.pi * seen[rows, columns].mean() / 0.5)


def matte(mi, columns: np.ndarray, rho: float) -> dict:
    """A rectangle of half edges, normal and middle, as columns of a matrix."""
    to_world = mi.ScalarTransform4f(np.vstack([columns, [0, 0, 0, 1]]))
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": rho}}
    return {"type": "rectangle", "to_world": to_world, "bsdf": {"type": "twosided", "inner": bsdf}}


def scene_with_projector(mi, lit: LitRoom, level: float, depth: int) -> dict:
    """Projector and sensor in one place, nothing else."""
    lens, pose = lit.views[0].lens, lit.views[0].pose
    ahead = pose.position_m + pose.rotation[2]
    transform = mi.ScalarTransform4f
    view = {
        "fov": lit.views[0].numbers.hfov_deg,
        "to_world": transform().look_at(origin=pose.position_m.tolist(), target=ahead.tolist(), up=[0, 0, 1]),
    }
    picture = np.full((*lens.shape, 3), level, dtype=np.float32)
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(picture), "raw": True, "wrap_mode": "clamp"}
    film = {"type": "hdrfilm", "width": lens.width_px, "height": lens.height_px, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth, "rr_depth": 20},
        "sensor": {"type": "perspective", "fov_axis": "x", "near_clip": 0.01, "film": film, **view},
        "projector": {"type": "projector", "irradiance": texture, **view},
    }


def pixels_of(mi, content: dict, spp: int) -> np.ndarray:
    """(n,) radiance of the sensor's pixels."""
    pixels = np.array(mi.render(mi.load_dict(content), spp=spp, seed=1), dtype=np.float64)
    return pixels[..., 0].ravel()


if __name__ == "__main__":
    raise SystemExit(main())
