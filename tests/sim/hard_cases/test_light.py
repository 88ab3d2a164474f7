"""Projectors in awkward places, black targets, and codes in other light."""

import numpy as np
import pytest

from calibration.structured_light.correspondence import PixelReason
from calibration.structured_light.decode import decode_gray
from calibration.structured_light.gray import gray_code_patterns
from sim.compensation import STRATEGIES, compensate
from sim.geometry.optics import Lens, Pose
from sim.geometry.scene import intersect
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.gridded import paper_room

LENS = Lens.from_horizontal_field_of_view(48, 36, 90.0)
POSE = Pose.look_at((1.2, 1.2, 1.2), (4.8, 4.8, 1.0))


def landed(transport, scene):
    """Flux of a white picture on all patches."""
    E, _ = transport.radiosity_of(np.ones(LENS.n_pixels))
    return (scene.areas * E / scene.reflectance).sum()


SENT = LENS.n_pixels / (LENS.focal_px[0] * LENS.focal_px[1])


def test_half_lit_patches_get_the_light_that_lands_on_them(closed_room, measured):
    scene = paper_room()
    by_area = coaxial_transport(scene, closed_room, LENS, POSE, convention="physical", emission_rule="area")
    measured("flux landed over flux sent, off 1", abs(landed(by_area, scene) / SENT - 1), 1e-12)
    by_mean = coaxial_transport(scene, closed_room, LENS, POSE, convention="physical", emission_rule="pixel_mean")
    # Equation 5 takes half-lit patches for lit ones: light is created.
    created = landed(by_mean, scene) / SENT - 1
    measured("light created by equation 5", created, 0.3)
    assert created > 0.02


@pytest.mark.parametrize("height_m", [1e-3, 1e-6])
def test_grazing_light_arrives_complete(closed_room, measured, height_m):
    scene = paper_room()
    pose = Pose.look_at((1.2, 1.3, height_m), (4.8, 3.9, height_m))
    transport = coaxial_transport(scene, closed_room, LENS, pose, convention="physical", emission_rule="area")
    assert np.isfinite(transport.direct_matrix.data).all()
    assert (transport.direct_matrix.data >= 0).all()
    measured("flux landed over flux sent, off 1", abs(landed(transport, scene) / SENT - 1), 1e-12)


def test_a_projector_on_the_floor_lights_what_lies_above_it():
    pose = Pose.look_at((1.2, 1.3, 0.0), (4.8, 3.9, 0.0))
    up = np.random.default_rng(5).normal(size=(1000, 3))
    up[:, 2] = np.abs(up[:, 2])
    above = intersect(paper_room(), pose.position_m, up / np.linalg.norm(up, axis=1, keepdims=True))
    below = intersect(paper_room(), pose.position_m, -up / np.linalg.norm(up, axis=1, keepdims=True))
    assert (above.patch >= 0).all()
    assert (above.face > 0).all()
    assert (below.patch == -1).all()


def test_black_wanted_everywhere_is_black_shown(closed_room):
    transport = coaxial_transport(paper_room(), closed_room, LENS, POSE)
    for name in STRATEGIES:
        result = compensate(name, transport, np.zeros(LENS.n_pixels))
        assert not result.projector_image.any(), name
        assert result.residual_rms == 0, name


def test_black_wanted_in_half_of_the_picture_divides_by_nothing(closed_room):
    # Equation 16 has L'_c / B', nought over nought where black is wanted.
    transport = coaxial_transport(paper_room(), closed_room, LENS, POSE)
    target = np.where(np.arange(LENS.n_pixels) < LENS.n_pixels / 2, 0.0, 0.5)
    for name in STRATEGIES:
        image = compensate(name, transport, target).projector_image
        assert np.isfinite(image).all(), name
        assert ((image >= 0) & (image <= 1)).all(), name


def test_unlit_and_unseen_patches_are_accounted_for(closed_room, measured):
    # A uniform grey that nothing clips: exact with unlit patches solved for, 18 levels of 255 off in the paper.
    transport = coaxial_transport(paper_room(), closed_room, LENS, POSE, emission_rule="area")
    lit = np.asarray(transport.emission.sum(axis=1)).ravel() > 0
    assert 0.1 < lit.mean() < 0.9
    E, B = transport.radiosity_of(np.ones(LENS.n_pixels))
    assert not E[~lit].any()
    assert (B[~lit] > 0).all()
    target = np.full(LENS.n_pixels, 0.5)
    exact = compensate("exact", transport, target, lower=-np.inf, upper=np.inf)
    measured("exact: rms from the target", exact.residual_rms / 0.5, 1e-9)
    paper = compensate("paper", transport, target, lower=-np.inf, upper=np.inf)
    measured("paper: rms from the target", paper.residual_rms / 0.5, 0.5)
    assert paper.residual_rms > 0.02


def gray_code_pictures(ambient):
    """What a camera sees that looks at the projector's pixels one to one, with other light in each picture."""
    patterns = list(gray_code_patterns((48, 64)))
    return {
        pattern.name: 10 + pattern.codes * (100 / 255) + level
        for pattern, level in zip(patterns, ambient(len(patterns)), strict=True)
    }


@pytest.mark.parametrize(
    "ambient",
    [
        lambda n: np.zeros(n),
        lambda n: np.full(n, 140.0),
        lambda n: 30 * np.random.default_rng(8).random(n),
        lambda n: 80.0 * (np.arange(n) % 4 < 2),
    ],
    ids=["dark", "steady", "flickering", "blinking"],
)
def test_gray_code_is_read_in_ambient_light_weaker_than_the_projector(ambient):
    found = decode_gray(gray_code_pictures(ambient), (48, 64), contrast_limit=20, bit_limit=10)
    assert found.valid.mean() > 0.99
    columns = np.tile(np.arange(64.0), (48, 1))
    assert np.array_equal(found.projector_xy_px[..., 0][found.valid], columns[found.valid])


def test_saturated_pixels_get_no_code():
    found = decode_gray(
        gray_code_pictures(lambda n: np.full(n, 160.0)), (48, 64), contrast_limit=20, bit_limit=10, saturation=255
    )
    assert (found.reason == PixelReason.SATURATED).all()
