"""Patches of bent surfaces: what is not known of their slant to light shows in how their neighbours slant."""

import numpy as np

from calibration.surfaces.bends import slant_errors

FROM_M = np.array([3.0, 0.5, 1.0])
RADIUS_M = 0.3


def column(sides, radius_m=RADIUS_M, rows=4):
    """Corners' numbers, unit normals and middles of a round column's quads that face outwards."""
    angle, height = 2 * np.pi * np.arange(sides) / sides, np.linspace(0, 2, rows + 1)
    points = np.array([(radius_m * np.cos(a), radius_m * np.sin(a), z) for z in height for a in angle])
    first = (sides * np.arange(rows)[:, None] + np.arange(sides)).ravel()
    after = (sides * np.arange(rows)[:, None] + (np.arange(sides) + 1) % sides).ravel()
    corner = np.stack([first, after, after + sides, first + sides], axis=1)
    middle = points[corner].mean(axis=1)
    normals = middle * (1, 1, 0)
    return corner, normals / np.linalg.norm(normals, axis=1, keepdims=True), middle


def errors_of(corner, normals, middle, surface=None):
    surface = np.zeros(len(corner), dtype=int) if surface is None else surface
    return slant_errors(corner, normals, FROM_M - middle, surface)


def cosines(normals, middle):
    light = FROM_M - middle
    return (normals * light).sum(axis=1) / np.linalg.norm(light, axis=1)


def test_patches_of_one_plane_are_as_slanted_as_they_look():
    corner = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
    normals = np.tile([1.0, 0.0, 0.0], (4, 1))
    assert errors_of(corner, normals, np.zeros((4, 3))).max() == 0


def test_an_edge_between_two_planes_is_no_bend():
    corner, normals = np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), np.array([[1.0, 0, 0], [0, 1.0, 0]])
    assert errors_of(corner, normals, np.zeros((2, 3))).max() == 0


def test_what_another_surface_does_beside_a_patch_says_nothing_of_it():
    tilt = np.radians(30)
    corner, normals = np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), np.array([[1.0, 0, 0], [np.cos(tilt), np.sin(tilt), 0]])
    assert errors_of(corner, normals, np.zeros((2, 3))).min() > 0
    assert errors_of(corner, normals, np.zeros((2, 3)), np.array([0, 1])).max() == 0


def test_light_that_grazes_a_bend_is_known_worse():
    corner, normals, middle = column(24)
    errors, cosine = errors_of(corner, normals, middle), cosines(normals, middle)
    assert errors[(cosine > 0.05) & (cosine < 0.4)].min() > 3 * errors[cosine > 0.8].max()
    assert (errors[cosine <= 0] == 0).all()


def test_finer_patches_know_their_slant_better_by_the_square():
    coarse, fine = (errors_of(*column(sides)) for sides in (16, 32))
    lit_coarse, lit_fine = (cosines(*column(sides)[1:]) > 0.5 for sides in (16, 32))
    assert np.median(coarse[lit_coarse]) / np.median(fine[lit_fine]) > 3


def test_the_mean_light_on_what_a_patch_stands_for_lies_within_what_is_said():
    sides, parts = 20, 51
    corner, normals, middle = column(sides)
    errors, cosine = errors_of(corner, normals, middle), cosines(normals, middle)
    within = np.pi / sides * np.linspace(-1, 1, parts)
    turned = [
        np.stack([c * normals[:, 0] - s * normals[:, 1], s * normals[:, 0] + c * normals[:, 1], normals[:, 2]], axis=1)
        for c, s in zip(np.cos(within), np.sin(within), strict=True)
    ]
    on_arc = np.mean([np.maximum(cosines(one, middle + (RADIUS_M * (one - normals))), 0) for one in turned], axis=0)
    lit = cosine > 0
    off = np.abs(on_arc[lit] / cosine[lit] - 1)
    assert (off < 3 * errors[lit] + 0.01).all()
