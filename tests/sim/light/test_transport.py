"""Light transport: adjoints, energy, the two conventions."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose, rays_at
from sim.light.criteria import difference, indirect_radiosity, overall_once_reflected_share, spread
from sim.light.radiosity import Radiosity
from sim.light.transport_of_scene import LightTransport, coaxial_transport, physical_transport
from sim.scenes.gridded import corner, paper_room, room, room_with_box

LENS = Lens.from_horizontal_field_of_view(48, 36, 100.0)
POSE = Pose.look_at((1.2, 1.2, 1.2), (2.2, 2.2, 1.2))
BESIDE = Pose.look_at((1.5, 1.0, 1.3), (2.4, 2.2, 1.1))


@pytest.fixture(scope="module")
def paper_transport():
    scene = paper_room()
    return coaxial_transport(scene, form_factors(scene), LENS, POSE)


def _all_transports():
    scene, boxed, open_scene = paper_room(), room_with_box(0.8), corner()
    factors = form_factors(scene)
    for convention in ("paper", "physical"):
        for rule in ("pixel_mean", "area"):
            yield coaxial_transport(scene, factors, LENS, POSE, convention=convention, emission_rule=rule)
    yield physical_transport(scene, factors, LENS, POSE, camera_lens=LENS, camera_pose=BESIDE)
    yield physical_transport(boxed, form_factors(boxed), LENS, POSE, camera_lens=LENS, camera_pose=BESIDE)
    away = Pose.look_at((1.8, 1.8, 1.8), (0.5, 0.5, 0.5))
    yield coaxial_transport(
        open_scene, form_factors(open_scene), LENS, away, convention="physical", emission_rule="area"
    )


def test_every_operator_and_its_adjoint_agree():
    rng = np.random.default_rng(0)
    for transport in _all_transports():
        for operator in (transport, transport.direct, transport.global_):
            x, y = rng.random(operator.shape[1]), rng.random(operator.shape[0])
            assert (operator @ x) @ y == pytest.approx(x @ (operator.T @ y), rel=1e-12)


def test_direct_and_global_add_up(paper_transport):
    p = np.random.default_rng(1).random(LENS.n_pixels)
    whole = paper_transport @ p
    assert np.allclose(whole, paper_transport.direct @ p + paper_transport.global_ @ p)
    stack = paper_transport @ np.stack([p, 2 * p], axis=1)
    assert np.allclose(stack, np.stack([whole, 2 * whole], axis=1))


def test_the_coupling_is_the_global_part(paper_transport):
    rng = np.random.default_rng(2)
    p, c = rng.random(LENS.n_pixels), rng.random(LENS.n_pixels)
    assert np.allclose(paper_transport.interreflection.apply(p), paper_transport.global_ @ p)
    assert np.allclose(paper_transport.interreflection.adjoint(c), paper_transport.global_.T @ c)


def test_each_pixels_flux_reaches_the_room_times_reflectance():
    scene = room((4.8, 4.8, 2.4), 0.4, {"floor": 0.2, "ceiling": 0.9, "x0": 0.5, "x1": 0.6, "y0": 0.5, "y1": 0.6})
    lens = Lens(
        width_px=48,
        height_px=36,
        focal_px=(40.0, 41.0),
        principal_point_px=(23.0, 18.0),
        distortion=(-0.05, 0.01, 0.001, 0.0, 0.0),
    )
    transport = coaxial_transport(
        scene, form_factors(scene), lens, POSE, convention="physical", emission_rule="area", subsamples=1
    )
    received = scene.areas @ transport.emission
    assert np.allclose(received, scene.reflectance[transport.pixel_patch] / (40.0 * 41.0), rtol=1e-12)


def test_a_white_physical_image_gives_unit_irradiance_across_the_axis():
    # The projector looks straight at the wall x1, 2.4 m away: cos / (r² cos³ gamma) is 1 / 2.4² everywhere.
    scene = room((4.8, 4.8, 2.4), 0.2, 0.5)
    lens = Lens.from_horizontal_field_of_view(400, 200, 60.0)
    pose = Pose.look_at((2.4, 2.4, 1.2), (4.8, 2.4, 1.2))
    transport = coaxial_transport(scene, form_factors(scene), lens, pose, convention="physical", emission_rule="area")
    white = np.ones(lens.n_pixels)
    wall = transport.pixel_patch >= 0
    assert np.allclose((transport.direct @ white)[wall], 0.5 / 2.4**2)
    emission = transport.emission @ white
    inner = np.bincount(transport.pixel_patch, minlength=scene.n_patches)
    full = inner > 0.999 * inner.max()
    assert np.allclose(emission[full], 0.5 / 2.4**2, rtol=0.05)


def test_the_papers_direct_light_is_rho_cosine(paper_transport):
    scene = paper_room()
    rays = rays_at(LENS, POSE, LENS.pixel_grid())
    cosine = -(rays * scene.normals[paper_transport.pixel_patch]).sum(axis=1)
    assert np.allclose(paper_transport.direct @ np.ones(LENS.n_pixels), 0.7 * cosine)


def test_half_lit_patches_count_as_lit_in_the_paper_and_by_area_in_ours():
    scene = paper_room()
    factors = form_factors(scene)
    lens = Lens.from_horizontal_field_of_view(320, 240, 100.0)
    white = np.ones(lens.n_pixels)
    mean = (
        coaxial_transport(scene, factors, lens, POSE, convention="paper", emission_rule="pixel_mean").emission @ white
    )
    area = coaxial_transport(scene, factors, lens, POSE, convention="paper", emission_rule="area").emission @ white
    assert (scene.areas @ mean) > 1.05 * (scene.areas @ area)
    middle = int(np.argmin(np.linalg.norm(scene.centres - (4.8, 2.6, 1.4), axis=1)))
    assert area[middle] == pytest.approx(mean[middle], rel=0.05)


def test_a_camera_in_the_projectors_place_sees_what_the_coaxial_model_says():
    scene = paper_room()
    factors = form_factors(scene)
    apart = physical_transport(scene, factors, LENS, POSE, camera_lens=LENS, camera_pose=POSE)
    coaxial = coaxial_transport(scene, factors, LENS, POSE, convention="physical", emission_rule="area")
    p = np.random.default_rng(3).random(LENS.n_pixels)
    assert np.allclose(apart.direct @ p, coaxial.direct @ p, rtol=1e-9)
    assert (apart @ p).mean() == pytest.approx((coaxial @ p).mean(), rel=0.01)


def test_the_box_throws_a_shadow_that_the_camera_sees():
    scene = room_with_box(0.8)
    low = Pose.look_at((0.5, 2.4, 0.5), (4.8, 2.4, 0.5))
    above = Pose.look_at((2.4, 0.3, 2.2), (3.6, 2.4, 0.0))
    transport = physical_transport(scene, form_factors(scene), LENS, low, camera_lens=LENS, camera_pose=above)
    light = (transport.direct @ np.ones(LENS.n_pixels)).reshape(LENS.shape)
    rays = rays_at(LENS, above, LENS.pixel_grid())
    at = np.where(rays[:, 2] < 0, -2.2 / np.minimum(rays[:, 2], -1e-9), np.inf)
    floor = above.position_m + np.where(np.isfinite(at), at, 0)[:, None] * rays
    shadow = (rays[:, 2] < 0) & (abs(floor[:, 0] - 3.4) < 0.3) & (abs(floor[:, 1] - 2.4) < 0.2)
    assert shadow.any()
    assert (light.ravel()[shadow] == 0).all()
    assert light.max() > 0


def test_smooth_indirect_light_keeps_a_constant_and_each_pixels_reflectance():
    scene = room((2.0, 2.0, 2.0), 0.5, {"floor": 0.2, "ceiling": 0.9, "x0": 0.5, "x1": 0.6, "y0": 0.5, "y1": 0.6})
    pose = Pose.look_at((0.4, 0.4, 1.0), (2.0, 2.0, 1.0))
    transport = physical_transport(scene, form_factors(scene), LENS, pose, camera_lens=LENS, camera_pose=pose)
    assert np.allclose(transport.view @ scene.reflectance, scene.reflectance[transport.pixel_patch])


def test_criteria_of_a_black_image_are_zero_and_white_is_mostly_once_reflected_in_a_dark_room():
    scene = paper_room(reflectance=0.1)
    transport = coaxial_transport(scene, form_factors(scene), LENS, POSE)
    black, white = np.zeros(LENS.n_pixels), np.full(LENS.n_pixels, 255.0)
    assert spread(indirect_radiosity(transport, black)).max == 0
    assert overall_once_reflected_share(transport, black) == 0
    assert overall_once_reflected_share(transport, white) > 0.93


def test_difference_reports_absolute_errors():
    result = difference(np.array([1.0, -1.0, 3.0]), np.zeros(3))
    assert (result.mean, result.max) == (pytest.approx(5 / 3), 3.0)
    assert result.rms == pytest.approx(np.sqrt(11 / 3))


def test_parts_that_do_not_fit_together_are_refused(paper_transport):
    radiosity: Radiosity = paper_transport.radiosity
    with pytest.raises(SimulationError, match="do not fit together"):
        LightTransport(
            csr_array((4, 4)), csr_array((3, 4)), radiosity, csr_array((4, 3)), pixel_patch=np.zeros(4, dtype=int)
        )


def test_unknown_conventions_are_refused():
    scene = paper_room()
    factors = form_factors(scene)
    with pytest.raises(SimulationError, match="paper, physical"):
        coaxial_transport(scene, factors, LENS, POSE, convention="metric")
    with pytest.raises(SimulationError, match="pixel_mean, area"):
        coaxial_transport(scene, factors, LENS, POSE, convention="paper", emission_rule="mode")
