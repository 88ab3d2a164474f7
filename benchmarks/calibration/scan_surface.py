"""The free surface of a real scan against its author's own cloud, where both cover the object.

python benchmarks/calibration/scan_surface.py [--patch-mm 1.5]; PROCAM_RIG_DATA names the folder of the published scan.

The cloud's points are noisy: how far each one stands from the plane through its neighbours, itself left out, is what a
surface without any error would be off, too. So two distances are told: of the points as they are published, and of
the points laid on their neighbours' planes, which is what surface and cloud disagree by.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from photograph_sets import published_folder, real_set
from scipy.spatial import cKDTree

from calibration.structured_light.subpixel import refine_subpixel
from calibration.surfaces.flat_parts import parts_of
from calibration.surfaces.known.nearest import SampledMesh
from calibration.surfaces.pieces import pieces_of
from calibration.surfaces.point_map import point_map
from calibration.surfaces.triangulated import triangulated
from rig.offline.photograph_order import decode

LEAST_PIXELS = 400
BIT_LIMIT_DN = 5.0
NEIGHBOURS = 48
"""Around a published point, within some 2 mm: their mean has a seventh of one point's noise."""
COVERED_MM = 1.0
"""A published point that is further from every one of ours along the surface is not covered."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--patch-mm", type=float, default=1.5)
    patch_m = parser.parse_args().patch_mm / 1000
    found = real_set()
    if found is None:
        raise SystemExit(f"no published scan at {published_folder()}; PROCAM_RIG_DATA names the folder that has it")
    camera, projector = found.devices
    started = time.process_time()
    correspondence = refine_subpixel(decode(found.manifest, found.frames, BIT_LIMIT_DN))
    points = point_map(correspondence, camera, projector)
    pieces = pieces_of(points, points.known, LEAST_PIXELS)
    parts = parts_of(points, pieces, LEAST_PIXELS)
    surface = triangulated(points, parts, camera, patch_m)
    seconds = time.process_time() - started
    corners = surface.vertices_m[surface.triangles]
    authors = authors_cloud_m()
    print(f"{len(corners)} triangles in {surface.n_parts} parts, {seconds:.0f} s of processor time")
    off, covered = distances(corners, authors)
    inner = np.abs(off[covered]) * 1000
    print(f"covered: {covered.sum()} of {len(authors)} published points ({100 * covered.mean():.1f} %)")
    print(f"distance to the surface: {told(inner)}")
    beside = (authors - laid_on_neighbours(authors)) * 1000
    print(f"published points from the plane of their {NEIGHBOURS} neighbours: {told(np.linalg.norm(beside, axis=1))}")
    off, covered = distances(corners, laid_on_neighbours(authors))
    print(f"those planes to the surface: {told(np.abs(off[covered]) * 1000)}")


def told(off_mm: np.ndarray) -> str:
    return f"median {np.median(off_mm):.4f} mm, p95 {np.quantile(off_mm, 0.95):.3f} mm"


def laid_on_neighbours(points: np.ndarray) -> np.ndarray:
    """(N, 3) each point's foot on the plane that fits its neighbours best, without itself."""
    near = points[cKDTree(points).query(points, k=NEIGHBOURS + 1)[1][:, 1:]]
    middle = near.mean(axis=1)
    spread = near - middle[:, None]
    normal = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
    return points - np.einsum("ni,ni->n", points - middle, normal)[:, None] * normal


def authors_cloud_m() -> np.ndarray:
    """(N, 3) published points in the camera's axes. [m]"""
    import trimesh

    cloud = trimesh.load(published_folder() / "scan_0020_cloud.ply")
    if not isinstance(cloud, trimesh.PointCloud | trimesh.Trimesh):
        raise SystemExit(f"{published_folder() / 'scan_0020_cloud.ply'} is no cloud of points")
    return np.asarray(cloud.vertices, dtype=np.float64) * (1, -1, -1) / 1000


def distances(corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distance of points to triangles, and which have the surface within a millimetre: holes have none."""
    mesh = SampledMesh(corners)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    parts = [mesh.nearest(points[k : k + 20000], rays[k : k + 20000]).place_m for k in range(0, len(points), 20000)]
    off = np.linalg.norm(np.concatenate(parts) - points, axis=1)
    near = cKDTree(corners.mean(axis=1)).query(points)[0] < 3 * COVERED_MM / 1000
    return off, near & (off < COVERED_MM / 1000)


if __name__ == "__main__":
    main()
