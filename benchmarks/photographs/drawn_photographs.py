"""Strangers' photographs drawn by chance: scans of things, devices and files that nobody had in mind.

    python benchmarks/photographs/drawn_photographs.py --sets 200 --seed 1
    python benchmarks/photographs/drawn_photographs.py --sets 1 --seed 17 --keep FOLDER   # files for `rig scan`

Walls that slant and wave, corners, plates and balls before them; cameras and projectors on their sides or their heads,
with distortion and shifted lenses, 240 to 480 px high and 60 to 300; a baseline in any direction; 8, 12 or 16 bits,
JPEG, PNG, TIFF or BMP; with inverses or without, columns or rows alone, finest stripes left out; blur, noise, tone
curves, light that goes round. Half of the sets have one fault: of the photographs, or of what the manifest says. Points
are compared with the thing itself, cast along their own ray: within 1 % of the depth of what is near, 0.7 of a
projector's pixel, or three of the cloud's own standard deviations, whichever is most. A right
set has to end; a set of any kind has to be right, refused in words, or end with a warning.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from drawn_faults import NUMBERS, coded_of, drawn
from drawn_scenes import DrawnSet, FloatArray, rays_of
from set_runs import tried, try_all

from calibration.geometry.pinhole import PinholeModel, project
from rig.offline.scan import run_scan

OFF = 0.01
"""Of the depth, and of the points: beyond, a cloud is wrong."""


def write(set_: DrawnSet, folder: Path) -> Path:
    """Write photographs and manifest; return the manifest."""
    for name, frame in set_.frames.items():
        quality = [cv2.IMWRITE_JPEG_QUALITY, set_.jpeg] if set_.suffix == ".jpg" else []
        cv2.imwrite(str(folder / f"{name}{set_.suffix}"), frame, quality)
    camera, projector = set_.told
    height, width = next(iter(set_.frames.values())).shape
    lines = ["schema = 1", "[camera]", f"width_px = {width}", f"height_px = {height}"]
    lines += [f"full_scale_dn = {set_.full_scale_dn}", *_lens_lines("camera", camera), "[projector]"]
    lines += [f"width_px = {projector.width_px}", f"height_px = {projector.height_px}"]
    lines += [*_lens_lines("projector", projector), "[projector_from_camera]"]
    lines += [f"rotation = {[float(r) for r in projector.rotation.ravel()]}"]
    lines += [f"translation = {[float(t) for t in projector.translation_m]}", 'unit = "m"', "[gray_code]"]
    lines += [f"finest_bit = {set_.finest_bit}", f"first_code = {list(set_.first_code)}"]
    for axis in ("column", "row"):
        names = sorted((name for name in coded_of(set_) if name.split("-")[1] == axis), reverse=True)
        plain = [f"{name}{set_.suffix}" for name in names if not name.endswith("-inverse")]
        inverse = [f"{name}{set_.suffix}" for name in names if name.endswith("-inverse")]
        lines += [f"{axis}s = {plain}"] if plain else []
        lines += [f"{axis}s_inverse = {inverse}"] if inverse else []
    if "white" in set_.frames:
        lines += ["[frames]", f'white = "white{set_.suffix}"', f'black = "black{set_.suffix}"']
    path = folder / "replay.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def _lens_lines(device: str, lens: PinholeModel) -> list[str]:
    return [
        f"[{device}.lens]",
        f"focal_px = {[float(f) for f in lens.focal_px]}",
        f"principal_point_px = {[float(c) for c in lens.principal_point_px]}",
        f"distortion = {[float(d) for d in lens.distortion]}",
    ]


def _points(path: Path) -> FloatArray:
    head, _, data = path.read_bytes().partition(b"end_header\n")
    text = head.decode()
    kind = np.dtype([("xyz", "<f4" if "property float x" in text else "<f8", 3), ("rgb", "u1", 3)])
    return np.frombuffer(data, kind)["xyz"].astype(np.float64)


def off_share(set_: DrawnSet, points_m: FloatArray, sigma: float) -> float:
    """Share of points whose depth is that of nothing around them, by more than the module says."""
    camera = set_.devices[0]
    if np.any(points_m[:, 2] <= 0):
        return 1.0
    xy = project(set_.told[0], points_m)
    if set_.fault == "camera-halved":
        xy = xy * 2 + 0.5
    if set_.fault == "mirrored":
        xy[:, 0] = camera.width_px - 1 - xy[:, 0]
    low, high = np.full(len(xy), np.inf), np.zeros(len(xy))
    cell_px = 2.0**set_.finest_bit
    reach = max(1.0, 0.6 * cell_px * camera.focal_px[0] / set_.devices[1].focal_px[0])
    for right in np.linspace(-reach, reach, 5):
        for down in np.linspace(-reach, reach, 5):
            rays = rays_of(camera, set_.turned, xy + np.array([right, down]))
            depth = set_.thing.along(np.zeros(3), rays) * (rays @ set_.turned.T)[:, 2]
            low, high = np.minimum(low, depth), np.maximum(high, depth)
    here, there = project(set_.devices[1], points_m), project(set_.devices[1], (1 + OFF) * points_m)
    # No code tells a place within a projector's pixel for sure.
    allowed = np.maximum(OFF * np.maximum(1.0, 0.7 / np.linalg.norm(there - here, axis=1)), 3 * sigma)
    return float(((points_m[:, 2] < low * (1 - allowed)) | (points_m[:, 2] > high * (1 + allowed))).mean())


def judged(seed: int, keep: Path | None) -> tuple[str, str]:
    """(how it ended, in words) of one set."""
    set_ = drawn(seed)
    how, said = tried(seed, keep, lambda folder: scanned(set_, folder))
    lone = len({name.split("-")[1] for name in set_.frames if name.startswith("gray-")}) < 2
    if how == "wrong":
        how = "wrong as nothing can tell" if lone and set_.fault in NUMBERS else "WRONG IN SILENCE"
    if set_.fault == "none" and how != "right":
        how = f"{how} WITHOUT A FAULT"
    return how, f"{seed}: {set_.fault}: {said} [{set_.drawn}]"


def scanned(set_: DrawnSet, folder: Path) -> tuple[str, str]:
    found = run_scan(write(set_, folder), folder / "cloud.ply")
    off = off_share(set_, _points(folder / "cloud.ply"), found.distance_sigma_percent / 100)
    how = "wrong" if off > OFF else "right"
    said = f"{found.points} points to {found.distance_sigma_percent:.2g} %, {100 * off:.1f} % off; "
    return f"{how}, warned" if found.warnings else how, said + "; ".join((*found.mended, *found.warnings))


def main() -> int:
    """Scan drawn sets, and print what is not as it should be."""
    try_all(__doc__, judged)
    return 0


if __name__ == "__main__":
    sys.exit(main())
