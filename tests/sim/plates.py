"""Two plates of which the factor is known: opposed, or as a wedge."""

import numpy as np

from sim.geometry.mesh import Mesh
from sim.scenes.gridded import room


def parallel_plates(size_m=(1.0, 1.0), gap_m=1.0, patch_size_m=0.25, reflectance=0.5):
    """Two directly opposed rectangles: the textbook's first view factor."""
    return room((*size_m, gap_m), patch_size_m, reflectance, faces=("floor", "ceiling"), name="parallel-plates")


def wedge(angle_degrees, length_m=1.0, widths_m=(1.0, 1.0)):
    """Two rectangles that share the edge of the given length along x and open by an angle."""
    angle = np.radians(angle_degrees)
    start, end = np.zeros(3), np.array([length_m, 0.0, 0.0])
    out = [widths_m[0] * np.array([0.0, 1.0, 0.0]), widths_m[1] * np.array([0.0, np.cos(angle), np.sin(angle)])]
    vertices = np.stack([[start, end, end + out[0], start + out[0]], [end, start, start + out[1], end + out[1]]])
    return Mesh(name="wedge", vertices=vertices, reflectance=np.full(2, 0.5), convex=True, region=np.arange(2))
