"""Pictures of a lit scene: eq. 9, the light transport's matrices, and a path tracer."""

import numpy as np
import pytest

from rig.benchmark.checkout import data_file
from sim import _kernel
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose, pixel_rays
from sim.geometry.rays import trace
from sim.geometry.scene import intersect
from sim.light.transport_of_scene import coaxial_transport, physical_transport
from sim.picture import image as image_module
from sim.picture.gather import irradiance
from sim.picture.image import simulate_image
from sim.picture.reconstruction import fans, quadratics
from sim.reference.gather import irradiance as irradiance_reference
from sim.reference.reconstruction import fan_values, quadratic_values
from sim.scenes.gridded import paper_room, room, room_with_box
from tests.sim.meshes_of_scenes import as_mesh, as_triangles
from tests.sim.plates import parallel_plates

LENS = Lens.from_horizontal_field_of_view(64, 48, 100.0)
BENT = Lens(
    width_px=64,
    height_px=48,
    focal_px=(28.0, 27.0),
    principal_point_px=(30.0, 25.0),
    distortion=(-0.1, 0.02, 1e-3, -2e-3, 0.0),
)
POSE = Pose.look_at((1.2, 1.2, 1.2), (2.2, 2.3, 1.1))
TRACED = data_file("path_tracer_blocks.npz")


def _picture(lens=LENS, seed=0):
    return np.random.default_rng(seed).random(lens.shape)


# Light


@pytest.mark.parametrize("convention", ["paper", "physical"])
def test_direct_light_on_a_wall_ahead_is_eq_9(convention):
    pose, distance = Pose.look_at((2.4, 1.2, 1.2), (2.4, 4.8, 1.2)), 3.6
    scene, picture = room(patch_size_m=0.8, reflectance=0.6), _picture()
    image = simulate_image(scene, form_factors(scene), LENS, pose, projector_image=picture, convention=convention)
    cos_gamma = pixel_rays(LENS, pose)[..., 1]
    ahead = scene.region[image.pixel_patch] == 5
    wanted = 0.6 * picture * (cos_gamma if convention == "paper" else 1 / distance**2)
    assert 0.05 < ahead.mean() < 0.95
    assert np.allclose(image.direct[ahead], wanted[ahead], rtol=1e-12)
    assert np.allclose(image.camera_image, image.direct + image.indirect, rtol=1e-15)


@pytest.mark.parametrize("emission", ["area", "pixel_mean"])
@pytest.mark.parametrize("convention", ["paper", "physical"])
@pytest.mark.parametrize("lens", [LENS, BENT], ids=["straight", "distorted"])
def test_a_constant_image_is_the_light_transport_times_the_picture(convention, emission, lens):
    for scene in (paper_room(patch_size_m=0.6), room_with_box(0.8)):
        factors, picture = form_factors(scene), _picture(lens)
        image = simulate_image(
            scene,
            factors,
            lens,
            POSE,
            projector_image=picture,
            convention=convention,
            emission=emission,
            reconstruction="patch",
            subsamples=2,
        )
        T = coaxial_transport(scene, factors, lens, POSE, convention=convention, emission_rule=emission)
        E, B = T.radiosity_of(picture.ravel())
        assert np.allclose(image.emission, E, rtol=1e-8, atol=1e-12)
        assert np.allclose(image.radiosity, B, rtol=1e-8, atol=1e-12)
        assert np.allclose(image.camera_image.ravel(), T @ picture.ravel(), rtol=1e-8)


def test_all_light_of_the_projector_lands_on_the_patches():
    scene, picture = paper_room(patch_size_m=0.3), _picture()
    image = simulate_image(scene, form_factors(scene), LENS, POSE, projector_image=picture, convention="physical")
    landed = (image.emission / scene.reflectance * scene.areas).sum()
    assert landed == pytest.approx(picture.sum() / (LENS.focal_px[0] * LENS.focal_px[1]), rel=1e-12)


def test_a_mesh_gives_the_picture_of_the_scene_it_came_from():
    scene, picture = room_with_box(0.6), _picture()
    factors = form_factors(scene)
    a, b = (
        simulate_image(s, factors, LENS, POSE, projector_image=picture, reconstruction="patch")
        for s in (scene, as_mesh(scene))
    )
    assert np.array_equal(a.pixel_patch, b.pixel_patch)
    assert np.allclose(a.camera_image, b.camera_image, rtol=1e-9)
    empty = paper_room()
    factors = form_factors(empty)
    a, b = (simulate_image(s, factors, LENS, POSE, projector_image=picture) for s in (empty, as_mesh(empty)))
    assert np.abs(b.indirect / a.indirect - 1).max() < 0.1
    assert np.abs(b.indirect / a.indirect - 1).mean() < 0.005


def test_a_camera_apart_sees_direct_light_and_shadow_as_the_light_transport_has_them():
    beside = Pose.look_at((1.5, 1.0, 1.3), (2.4, 2.2, 1.1))
    scene, picture = room_with_box(0.8), _picture()
    factors = form_factors(scene)
    T = physical_transport(scene, factors, LENS, POSE, camera_lens=BENT, camera_pose=beside)
    image = simulate_image(
        scene, factors, LENS, POSE, projector_image=picture, convention="physical", camera_lens=BENT, camera_pose=beside
    )
    wanted = (T.direct @ picture.ravel()).reshape(BENT.shape)
    assert (wanted == 0).any()
    assert (wanted > 0).any()
    assert np.isclose(image.direct, wanted, rtol=1e-8).mean() > 0.998  # rays along the edge of a shadow
    assert np.abs(image.indirect.ravel() / (T.global_ @ picture.ravel()) - 1).mean() < 0.03


# Reconstruction


def _linear(points):
    return 3.0 + points @ (0.2, -0.3, 0.5)


@pytest.mark.parametrize("patch_size_m", [2.4, 0.8, 0.3])
def test_quadratics_give_the_means_back_and_linear_light_exactly(patch_size_m):
    scene = room(patch_size_m=patch_size_m)
    means = np.random.default_rng(3).random(scene.n_patches)
    assert np.allclose(quadratics(scene, means).mean(axis=(1, 2)), means, rtol=1e-12)
    if patch_size_m < 2:
        coefficients = quadratics(scene, _linear(scene.centres))
        corners = coefficients[:, [0, 0, 2, 2], [0, 2, 2, 0]]
        assert np.allclose(corners, _linear(scene.vertices), rtol=1e-12)
        assert np.allclose(coefficients[:, 1, 1], _linear(scene.centres), rtol=1e-12)


@pytest.mark.parametrize("build", [as_mesh, as_triangles])
def test_fans_give_the_means_back_and_linear_light_exactly(build):
    mesh = build(room(patch_size_m=0.6))
    means = np.random.default_rng(4).random(mesh.n_patches)
    corners, values = fans(mesh, means)
    following = np.roll(corners, -1, axis=1)
    sectors = (corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]) / 2
    of_sectors = (values[:, :4] + np.roll(values[:, :4], -1, axis=1) + values[:, 4:]) / 3
    assert np.allclose(sectors.sum(axis=1), mesh.areas, rtol=1e-12)
    assert np.allclose((sectors * of_sectors).sum(axis=1) / mesh.areas, means, rtol=1e-12)
    values = fans(mesh, _linear(mesh.centres))[1]
    assert np.allclose(values[:, :4], _linear(mesh.vertices), rtol=1e-9)
    assert np.allclose(values[:, 4], _linear(mesh.centres), rtol=1e-9)


@pytest.mark.parametrize("build", [lambda scene: scene, as_mesh, as_triangles], ids=["scene", "quads", "triangles"])
def test_smooth_light_has_no_step_between_patches_of_a_wall(build):
    surface = build(paper_room(patch_size_m=0.8))
    ahead = Pose.look_at((2.4, 1.0, 1.2), (2.4, 4.8, 1.2))
    narrow = Lens.from_horizontal_field_of_view(1001, 3, 60.0)
    factors = form_factors(paper_room(patch_size_m=0.8))
    if surface.n_patches == factors.matrix.shape[0]:
        picture = np.ones(narrow.shape)
        image = simulate_image(surface, factors, narrow, ahead, projector_image=picture)
        steps = np.abs(np.diff(image.indirect[1])) / image.indirect[1].mean()
        flat = simulate_image(
            surface, factors, narrow, ahead, projector_image=picture, reconstruction="patch"
        ).indirect[1]
        assert np.abs(np.diff(flat)).max() / flat.mean() > 0.02
        assert steps.max() < 0.003


@pytest.mark.parametrize("build", [lambda scene: scene, as_mesh, as_triangles], ids=["scene", "quads", "triangles"])
def test_linear_light_arrives_at_the_pixels_as_it_is(build):
    surface, rays = build(room_with_box(0.5)), pixel_rays(BENT, POSE).reshape(-1, 3)
    hits = trace(surface, POSE.position_m, rays)
    points = POSE.position_m + hits.distance[:, None] * rays
    _, seen = image_module._lit(surface, BENT, POSE, picture=np.ones(BENT.shape), physical=True, subsamples=0)
    assert np.array_equal(seen.patch.ravel(), hits.patch)
    found = image_module._indirect(surface, _linear(surface.centres), seen, "smooth")
    assert np.allclose(found.ravel(), surface.reflectance[hits.patch] * _linear(points), rtol=1e-9)


def test_pixels_get_what_the_numpy_references_say():
    scene, rng = room(patch_size_m=0.8), np.random.default_rng(7)
    means, patch = rng.random(scene.n_patches), rng.integers(scene.n_patches, size=(20, 30)).astype(np.int32)
    place, out = rng.random((20, 30, 2)), np.empty((20, 30))
    coefficients = quadratics(scene, means)
    _kernel.shade_quadratic(patch, place, coefficients, out)
    assert np.allclose(out.ravel(), quadratic_values(coefficients, patch.ravel(), place.reshape(-1, 2)), rtol=1e-12)
    for mesh in (as_mesh(scene), as_triangles(scene)):
        corners, values = fans(mesh, np.resize(means, mesh.n_patches))
        place = 0.2 * (rng.random((20, 30, 2)) - 0.5)
        _kernel.shade_fan(patch, place, corners=corners, values=values, indirect=out)
        assert np.allclose(out.ravel(), fan_values(corners, values, patch.ravel(), place.reshape(-1, 2)), rtol=1e-9)


def test_smooth_light_is_never_negative_beside_darkness():
    scene = room(patch_size_m=0.4)
    spikes = np.where(np.random.default_rng(5).random(scene.n_patches) < 0.1, 100.0, 0.0)
    assert quadratics(scene, spikes).min() >= 0
    assert np.allclose(quadratics(scene, spikes).mean(axis=(1, 2)), spikes, atol=1e-10)
    for mesh in (as_mesh(scene), as_triangles(scene)):
        assert fans(mesh, np.resize(spikes, mesh.n_patches))[1].min() >= 0


@pytest.mark.parametrize("reconstruction", ["patch", "smooth", "gather"])
def test_a_black_patch_is_black_and_leaves_its_neighbours_as_they_are(reconstruction):
    white, picture = paper_room(), _picture()
    rho = white.reflectance.copy()
    black = int(np.flatnonzero(white.region == 3)[30])
    rho[black] = 0.0
    factors, dark = form_factors(white), white.with_reflectance(rho)
    with_black, without = (
        simulate_image(scene, factors, LENS, POSE, projector_image=picture, reconstruction=reconstruction)
        for scene in (dark, white)
    )
    here = with_black.pixel_patch == black
    assert here.any()
    assert (with_black.camera_image[here] == 0).all()
    # One patch of 576 takes away little of the light of the rest, next to it too.
    ratio = with_black.indirect[~here] / without.indirect[~here]
    assert ratio.min() > 0.95
    assert ratio.max() < 1.01


# Gather


def test_gathered_light_is_what_lamberts_formula_says():
    scene, rng = paper_room(patch_size_m=0.8), np.random.default_rng(6)
    patch = rng.integers(scene.n_patches, size=40)
    weights = rng.dirichlet(np.ones(4), size=40)
    points = (weights[..., None] * scene.vertices[patch]).sum(axis=1)
    radiosity = rng.random(scene.n_patches)
    found = irradiance(scene, radiosity, points, scene.normals[patch])
    assert np.allclose(found, irradiance_reference(scene, radiosity, points, scene.normals[patch]), rtol=1e-12)


def test_a_point_under_a_plate_receives_the_textbook_factor():
    plates = parallel_plates(size_m=(1.0, 1.0), gap_m=0.5, patch_size_m=0.25)
    radiosity = np.where(plates.region == 1, 2.0, 7.0)
    found = irradiance(plates, radiosity, np.array([[0.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]))
    x = 1.0 / 0.5  # a corner under a square, sides over distance (Howell, B-3)
    once = x / np.sqrt(1 + x * x)
    factor = 2 * once * np.arctan(once) / (2 * np.pi)
    assert found[0] == pytest.approx(2.0 * factor, rel=1e-12)


def test_every_pixel_of_a_furnace_gathers_the_same_light():
    scene = room_with_box(0.8)
    hits = intersect(scene, POSE.position_m, pixel_rays(LENS, POSE)[::4, ::4].reshape(-1, 3))
    points = POSE.position_m + hits.distance[:, None] * pixel_rays(LENS, POSE)[::4, ::4].reshape(-1, 3)
    empty = paper_room(patch_size_m=0.8)
    ones = irradiance(empty, np.ones(empty.n_patches), points[:40], empty.normals[hits.patch[:40] % empty.n_patches])
    assert ones.max() <= 1 + 1e-9
    shadowed = irradiance(scene, np.ones(scene.n_patches), points, scene.normals[hits.patch])
    assert np.abs(shadowed - 1).max() < 0.02
    assert np.abs(shadowed - 1).mean() < 0.002


def test_nothing_is_gathered_through_a_plate():
    plates = parallel_plates(patch_size_m=0.5)
    between = np.array([[-9, -9, 0.5], [9, -9, 0.5], [9, 9, 0.5], [-9, 9, 0.5]])[None]
    vertices = np.concatenate([plates.vertices, between])
    mesh = Mesh(
        name="plates",
        vertices=vertices,
        reflectance=np.full(9, 0.5),
        convex=False,
        closed=False,
        region=np.r_[plates.region, 2],
    )
    bright = np.where(mesh.region == 1, 1.0, 0.0)
    points, up = np.array([[0.3, 0.4, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    assert irradiance(plates, bright[:8], points, up)[0] > 0.2
    assert irradiance(mesh, bright, points, up)[0] == 0.0


def test_gathered_and_smooth_pictures_meet_as_patches_shrink():
    lens = Lens.from_horizontal_field_of_view(33, 22, 100.0)
    differences = []
    for size_m in (0.8, 0.4, 0.2):
        scene = paper_room(patch_size_m=size_m)
        factors = form_factors(scene)
        final_gather, smooth = (
            simulate_image(
                scene, factors, lens, POSE, projector_image=np.ones(lens.shape), reconstruction=kind
            ).indirect
            for kind in ("gather", "smooth")
        )
        differences.append(np.sqrt(((final_gather / smooth - 1) ** 2).mean()))
    assert differences[0] > 1.3 * differences[1] > 1.3**2 * differences[2]
    assert differences[2] < 0.005


# Against a path tracer


@pytest.fixture(scope="module")
def traced():
    with np.load(TRACED) as file:
        return dict(file)


def _blocks(image):
    return image.reshape(30, 16, 40, 16).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("patch_size_m", "bias_limit", "rms_limits"),
    [
        (0.4, 0.0025, {"smooth": 0.005}),
        (0.2, 0.001, {"patch": 0.005, "smooth": 0.0025}),
        (0.1, 0.001, {"patch": 0.0025, "smooth": 0.0015}),
    ],
)
def test_the_picture_is_the_path_tracers(traced, patch_size_m, bias_limit, rms_limits):
    means = traced["block_mean"]
    # The room, the pose and the white picture are symmetric, so that four blocks tell of one.
    means = (means + means[::-1] + means[:, ::-1] + means[::-1, ::-1]) / 4
    lens = Lens.from_horizontal_field_of_view(640, 480, float(traced["horizontal_field_of_view_deg"]))
    pose = Pose.look_at(traced["position_m"], traced["target_m"])
    scene = paper_room(reflectance=float(traced["reflectance"]), patch_size_m=patch_size_m)
    factors, picture = form_factors(scene), np.ones(lens.shape)
    for reconstruction, rms_limit in rms_limits.items():
        image = simulate_image(scene, factors, lens, pose, projector_image=picture, reconstruction=reconstruction)
        error = _blocks(image.camera_image) / means - 1
        assert abs(error.mean()) < bias_limit
        assert np.sqrt((error**2).mean()) < rms_limit


def test_the_path_tracers_blocks_are_quiet_enough_to_judge_by(traced):
    relative = traced["block_standard_error"] / traced["block_mean"]
    assert np.sqrt((relative**2).mean()) < 0.001
    assert traced["direct_deviation"] < 0.01


# Bad input


def test_wrong_choices_and_pictures_are_refused():
    scene = paper_room(patch_size_m=1.2)
    factors, white = form_factors(scene), np.ones(LENS.shape)
    for wrong in ({"convention": "x"}, {"emission": "x"}, {"reconstruction": "x"}, {"subsamples": 0}):
        with pytest.raises(SimulationError, match=r"unknown|at least 1"):
            simulate_image(scene, factors, LENS, POSE, projector_image=white, **wrong)
    for picture, message in ((white[1:], "shape"), (-white, "0 or more"), (white * np.nan, "0 or more")):
        with pytest.raises(SimulationError, match=message):
            simulate_image(scene, factors, LENS, POSE, projector_image=picture)
    with pytest.raises(SimulationError, match="same surface"):
        simulate_image(paper_room(), factors, LENS, POSE, projector_image=white)
    with pytest.raises(SimulationError, match="directions"):
        intersect(scene, (1, 1, 1), np.ones((3, 2)))
    folding = Lens(
        width_px=64,
        height_px=48,
        focal_px=(28.0, 28.0),
        principal_point_px=(31.5, 23.5),
        distortion=(-0.9, 0.0, 0.0, 0.0, 0.0),
    )
    with pytest.raises(SimulationError, match="fold the image over"):
        simulate_image(scene, factors, folding, POSE, projector_image=white)
