"""The paper's quadrature (Dehos et al. 2014): 3x3 midpoint samples on both patches, kept for replication."""

from __future__ import annotations

import numpy as np

from sim.scene import Face, FloatArray, Scene

SAMPLES = 3


def exchange_areas(scene: Scene) -> FloatArray:
    """(P, P) A_i F_ij = A_i A_j / 81 sum of cos cos' / (pi r²) over the 81 sample pairs [m²]."""
    exchange = np.zeros((scene.n_patches, scene.n_patches))
    points = [_sample_points(face) for face in scene.faces]
    for a, face_a in enumerate(scene.faces):
        for b in range(a + 1, len(scene.faces)):
            face_b = scene.faces[b]
            block = _block(face_a, points[a], face_b, points[b])
            exchange[face_a.patches, face_b.patches] = block
            exchange[face_b.patches, face_a.patches] = block.T
    return exchange


def _sample_points(face: Face) -> FloatArray:
    """(9, n_patches, 3) midpoints of a 3x3 division of each patch [m]."""
    u, v = np.meshgrid(np.arange(face.columns), np.arange(face.rows))
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES
    return np.stack(
        [face.points((u.ravel() + du) / face.columns, (v.ravel() + dv) / face.rows) for dv in offsets for du in offsets]
    )


def _block(face_a: Face, points_a: FloatArray, face_b: Face, points_b: FloatArray) -> FloatArray:
    # Both faces are flat, so r cos is the height of one sample over the other face's plane.
    height_b = np.maximum((points_b - face_a.origin_m) @ face_a.normal, 0.0)
    height_a = np.maximum((points_a - face_b.origin_m) @ face_b.normal, 0.0)
    total = np.zeros((face_a.n_patches, face_b.n_patches))
    if height_a.max() == 0 or height_b.max() == 0:
        return total
    for sample_a, over_a in zip(points_a, height_a, strict=True):
        for sample_b, over_b in zip(points_b, height_b, strict=True):
            squared = np.zeros_like(total)
            for axis in range(3):
                squared += np.subtract.outer(sample_a[:, axis], sample_b[:, axis]) ** 2
            total += np.multiply.outer(over_a, over_b) / squared**2
    area_a, area_b = (np.prod(face.size_m) / face.n_patches for face in (face_a, face_b))
    return np.asarray(total * (area_a * area_b / (np.pi * SAMPLES**4)))
