"""The glossy lobe: reciprocal, never more than arrives, its directions its own, its closed forms at both ends."""

import numpy as np
import pytest

from sim.light.gloss.lobe import LEAST_ROUGHNESS, albedo, frames_of, lobe, lobe_directions, lobe_of_cosines, mean_albedo


def hemisphere(n_height=600, n_turn=800):
    """Directions and solid angles of a fine grid over the hemisphere."""
    nodes, weights = np.polynomial.legendre.leggauss(n_height)
    theta, weights = np.pi / 4 * (nodes + 1), np.pi / 4 * weights
    phi = 2 * np.pi * (np.arange(n_turn) + 0.5) / n_turn
    t, p = (grid.ravel() for grid in np.meshgrid(theta, phi, indexing="ij"))
    directions = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    return directions, np.repeat(weights * np.sin(theta), n_turn) * 2 * np.pi / n_turn


DIRECTIONS, SOLID_ANGLES = hemisphere()


def at(cosine):
    return np.array([np.sqrt(1 - cosine**2), 0.0, cosine])


def along(cosine, roughness):
    """The lobe's values over the grid, for light from one direction."""
    n = len(DIRECTIONS)
    return lobe(np.tile(at(cosine), (n, 1)), DIRECTIONS, np.full(n, roughness))


def test_the_lobe_is_the_same_both_ways():
    random = np.random.default_rng(0)
    one, other = (DIRECTIONS[random.integers(len(DIRECTIONS), size=1000)] for _ in range(2))
    roughness = random.uniform(LEAST_ROUGHNESS, 1, 1000)
    assert np.allclose(lobe(one, other, roughness), lobe(other, one, roughness), rtol=1e-9)


def test_three_cosines_tell_a_lobe_as_well_as_directions_do():
    random = np.random.default_rng(1)
    one, other = (DIRECTIONS[random.integers(len(DIRECTIONS), size=1000)] for _ in range(2))
    other[:200] = one[:200] * (-1, -1, 1)  # mirrored: in the middle of the lobe
    roughness = random.uniform(0.01, 1, 1000)
    between = (one * other).sum(axis=1)
    by_cosines = lobe_of_cosines(one[:, 2], other[:, 2], between, roughness)
    assert np.allclose(by_cosines, lobe(one, other, roughness), rtol=1e-6)
    assert lobe_of_cosines(-one[:, 2], other[:, 2], between, roughness).max() == 0


@pytest.mark.parametrize("roughness", [0.15, 0.3, 0.6, 1.0])
def test_no_direction_sends_back_more_than_arrives_and_the_table_knows_how_much(roughness):
    for cosine in (0.05, 0.2, 0.5, 0.8, 1.0):
        sent = float((along(cosine, roughness) * DIRECTIONS[:, 2] * SOLID_ANGLES).sum())
        assert sent <= 1.0
        assert float(albedo(np.array([cosine]), np.array([roughness]))[0]) == pytest.approx(sent, abs=2.5e-3)


def test_the_roughest_lobe_has_its_closed_form():
    # alpha = 1: microfacets of all directions alike, f = 1 / (pi (1 + mu) (1 + mu')).
    for cosine in (0.1, 0.6, 1.0):
        assert np.allclose(along(cosine, 1.0), 1 / (np.pi * (1 + cosine) * (1 + DIRECTIONS[:, 2])), rtol=1e-12)
        closed = 2 * (1 - np.log(2)) / (1 + cosine)
        assert float(albedo(np.array([cosine]), np.ones(1))[0]) == pytest.approx(closed, abs=2e-3)
    assert float(mean_albedo(np.ones(1))[0]) == pytest.approx(4 * (1 - np.log(2)) ** 2, abs=1e-3)


def test_the_narrowest_lobe_is_a_mirror_that_keeps_all_light():
    outgoing, chances = at(0.6)[None].repeat(256, axis=0), np.random.default_rng(1).uniform(0, 0.99, (256, 2))
    directions, weight = lobe_directions(outgoing, np.full(256, LEAST_ROUGHNESS), chances)
    assert np.allclose(directions, outgoing * (-1, -1, 1), atol=0.04)
    assert np.median(np.linalg.norm(directions - outgoing * (-1, -1, 1), axis=1)) < 0.004
    assert np.allclose(weight, 1, atol=1e-4)
    assert lobe(at(1.0)[None], at(1.0)[None], np.array([0.01]))[0] == pytest.approx(1 / (4 * np.pi * 0.01**2))


@pytest.mark.parametrize(("cosine", "roughness"), [(0.9, 0.3), (0.3, 0.3), (0.5, 0.8)])
def test_chosen_directions_are_those_of_the_lobe(cosine, roughness):
    n = 1 << 16
    chances = np.stack([(np.arange(n) + 0.5) / n, np.arange(n) * (np.sqrt(5) - 1) / 2 % 1], axis=1)
    directions, weight = lobe_directions(np.tile(at(cosine), (n, 1)), np.full(n, roughness), chances)
    assert (weight >= 0).all()
    assert (weight <= 1).all()
    value = along(cosine, roughness) * DIRECTIONS[:, 2] * SOLID_ANGLES
    for field in (lambda d: d[:, 0], lambda d: d[:, 2] ** 2, lambda d: d[:, 1] ** 2, lambda d: d[:, 0] > 0.5):
        assert float((weight * field(directions)).mean()) == pytest.approx(float(value @ field(DIRECTIONS)), abs=2e-3)


def test_nothing_is_seen_from_below():
    below = np.array([[0.6, 0.0, -0.8]])
    assert lobe(below, at(0.5)[None], np.array([0.3]))[0] == 0
    assert lobe(at(0.5)[None], below, np.array([0.3]))[0] == 0


def test_frames_are_right_handed_about_their_normals():
    normals = np.concatenate([np.eye(3), -np.eye(3), DIRECTIONS[::50000]])
    axes = frames_of(normals)
    assert np.allclose(axes @ axes.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(axes), 1)
    assert np.allclose(axes[:, 2], normals)
