"""Light transport with gloss: linear with its adjoint, highlights and mirror images where geometry puts them."""

import numpy as np
import pytest

from sim import GlossyTransport, glossy_transport
from sim.compensation import compensate
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.frame.model import frame_model
from sim.geometry.optics import Lens, Pose, project, rays_at
from sim.geometry.rays import trace
from sim.light.colour import ColourTransport
from sim.light.gloss.material import Gloss
from sim.light.gloss.transport_of_scene import GlossSampling
from sim.light.transport_of_scene import coaxial_transport, physical_transport
from sim.scenes.gridded import room, room_with_box
from tests.sim.meshes_of_scenes import as_mesh

LENS = Lens.from_horizontal_field_of_view(32, 24, 90.0)
POSE = Pose.look_at((0.6, 0.6, 1.0), (2.4, 2.4, 0.7))
CAMERA = Lens.from_horizontal_field_of_view(40, 30, 90.0)
BESIDE = Pose.look_at((1.0, 0.5, 1.2), (2.3, 2.4, 0.5))
ROOM = room((3.0, 3.0, 2.0), 0.5, 0.4)
FEW = GlossSampling(patch_rays=16, projector_rays=2, camera_rays=4)


def floor_gloss(scene, share=0.5, roughness=0.2):
    return Gloss.of(scene, np.where(scene.region == 0, share, 0.0), roughness)


def made(scene=ROOM, gloss=None, *, apart=True, sampling=FEW, **more):
    if apart:
        more |= {"camera_lens": CAMERA, "camera_pose": BESIDE}
    gloss = floor_gloss(scene) if gloss is None else gloss
    return glossy_transport(scene, form_factors(scene), LENS, POSE, gloss=gloss, sampling=sampling, **more)


@pytest.fixture(scope="module")
def coaxial():
    return made(apart=False, mirrored="patch")


@pytest.mark.parametrize("mirrored", ["pixel", "patch"])
@pytest.mark.parametrize("apart", [True, False])
def test_the_operator_is_linear_and_agrees_with_its_adjoint(apart, mirrored):
    transport = made(room_with_box(1.2, 0.4), apart=apart, mirrored=mirrored)
    random = np.random.default_rng(0)
    for operator in (transport, transport.direct, transport.global_):
        p, q, c = (
            random.random(transport.shape[1]),
            random.random(transport.shape[1]),
            random.random(transport.shape[0]),
        )
        assert (operator @ p) @ c == pytest.approx(p @ (operator.T @ c), rel=1e-11)
        assert np.allclose(operator @ (2 * p - q), 2 * (operator @ p) - operator @ q)
    assert np.allclose(transport @ p, transport.direct @ p + transport.global_ @ p)
    assert np.allclose(transport @ np.stack([p, q], axis=1), np.stack([transport @ p, transport @ q], axis=1))


def test_without_gloss_it_is_the_matte_transport():
    matte = physical_transport(ROOM, form_factors(ROOM), LENS, POSE, camera_lens=CAMERA, camera_pose=BESIDE)
    without = made(gloss=Gloss.of(ROOM, 0.0))
    p = np.random.default_rng(1).random(LENS.n_pixels)
    assert np.allclose(without @ p, matte @ p, rtol=1e-9)
    alike = coaxial_transport(ROOM, form_factors(ROOM), LENS, POSE, convention="physical", emission_rule="area")
    coaxial_without = made(gloss=Gloss.of(ROOM, 0.0), apart=False)
    assert np.allclose(coaxial_without.direct @ p, alike.direct @ p, rtol=1e-9)
    assert np.allclose(coaxial_without.radiosity_of(p)[1], alike.radiosity_of(p)[1], rtol=1e-9)


def test_gloss_adds_light_and_never_takes_any():
    matte, glossy = made(gloss=Gloss.of(ROOM, 0.0)), made()
    p = np.ones(LENS.n_pixels)
    assert ((glossy.direct @ p) - (matte.direct @ p)).min() >= -1e-12
    assert ((glossy.radiosity_of(p)[1]) - (matte.radiosity_of(p)[1])).min() > 0


def test_a_mirror_shows_a_lit_spot_where_its_image_stands():
    # One pixel lights a wall; in the floor it is seen under the floor, at the same depth.
    transport = made(gloss=floor_gloss(ROOM, 0.6, 0.001), sampling=GlossSampling(patch_rays=16, camera_rays=4))
    rays = rays_at(LENS, POSE, LENS.pixel_grid())
    hits = trace(ROOM, POSE.position_m, rays)
    spots = POSE.position_m + hits.distance[:, None] * rays
    seen = trace(ROOM, BESIDE.position_m, rays_at(CAMERA, BESIDE, CAMERA.pixel_grid())).face
    on_wall = np.flatnonzero((hits.face > 1) & (spots[:, 2] < 0.6) & (spots[:, 2] > 0.2))
    tried = 0
    for pixel in on_wall[::7]:
        image = project(CAMERA, BESIDE, spots[pixel][None] * (1, 1, -1))[0]
        if (
            not ((image > 1) & (image < np.array([38, 28]))).all()
            or seen[int(image[1].round()) * 40 + int(image[0].round())]
        ):
            continue
        p = np.zeros(LENS.n_pixels)
        p[pixel] = 1.0
        glossy = np.asarray(transport.mirrored @ p).reshape(CAMERA.shape)
        y, x = np.unravel_index(glossy.argmax(), glossy.shape)
        assert np.hypot(*(np.array([x, y]) - image)) < 1.6
        tried += 1
    assert tried >= 3


def test_a_highlight_stands_where_the_floor_mirrors_the_projector():
    # Lens and camera look down on the floor from two sides.
    lamp, eye = Pose.look_at((0.6, 0.6, 1.0), (1.8, 1.8, 0.0)), Pose.look_at((2.3, 2.2, 1.5), (0.9, 0.9, 0.0))
    factors = form_factors(ROOM)
    bright, plain = (
        glossy_transport(ROOM, factors, LENS, lamp, gloss=gloss, camera_lens=CAMERA, camera_pose=eye, sampling=FEW)
        for gloss in (floor_gloss(ROOM, 0.4, 0.05), Gloss.of(ROOM, 0.0))
    )
    p = np.ones(LENS.n_pixels)
    more = (bright.direct @ p - plain.direct @ p).reshape(CAMERA.shape)
    y, x = np.unravel_index(more.argmax(), more.shape)
    image = project(CAMERA, eye, (lamp.position_m * (1, 1, -1))[None])[0]
    assert np.hypot(*(np.array([x, y]) - image)) < 1.5
    assert more.max() > 5 * np.median(plain.direct @ p)


def test_a_rough_floor_sends_back_the_closed_forms_share():
    # alpha = 1: f_s = 1 / (pi (1 + mu) (1 + mu')), seen along each camera ray.
    share = 0.4
    glossy, matte = made(gloss=floor_gloss(ROOM, share, 1.0)), made(gloss=Gloss.of(ROOM, 0.0))
    p = np.ones(LENS.n_pixels)
    rays = rays_at(CAMERA, BESIDE, CAMERA.pixel_grid())
    hits = trace(ROOM, BESIDE.position_m, rays)
    to_lamp = POSE.position_m - (BESIDE.position_m + hits.distance[:, None] * rays)
    mu = to_lamp[:, 2] / np.linalg.norm(to_lamp, axis=1)
    extra = share / (0.4 * (1 + mu) * (1 + hits.cos_incidence))
    floor = (hits.face == 0) & (matte.direct @ p > 0)
    assert floor.sum() > 50
    assert np.allclose((glossy.direct @ p)[floor], ((1 + extra) * (matte.direct @ p))[floor], rtol=1e-9)
    assert np.allclose((glossy.direct @ p)[~floor], (matte.direct @ p)[~floor])


def test_the_interreflection_matrix_is_the_global_part(coaxial):
    random = np.random.default_rng(2)
    p, c = random.random(LENS.n_pixels), random.random(LENS.n_pixels)
    assert np.allclose(coaxial.interreflection.apply(p), coaxial.global_ @ p)
    assert np.allclose(coaxial.interreflection.adjoint(c), coaxial.global_.T @ c)


@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_strategies_reach_targets_that_a_glossy_room_can_show(coaxial, strategy):
    shown = np.random.default_rng(3).uniform(0.2, 0.8, LENS.n_pixels)
    found = compensate(strategy, coaxial, coaxial @ shown)
    assert np.allclose(found.projector_image, shown, atol=2e-3)
    assert found.residual_rms < 1e-3 * np.sqrt(np.mean((coaxial @ shown) ** 2))


def test_bands_of_colour_may_be_glossy(coaxial):
    colour = ColourTransport((coaxial, coaxial, coaxial), np.eye(3))
    p = np.random.default_rng(4).random((LENS.n_pixels, 3))
    assert np.allclose(colour.forward(p)[:, 1], coaxial @ p[:, 1])


def test_a_mesh_is_as_good_as_its_scene_to_what_steps_between_patches_leave():
    mesh = as_mesh(ROOM)
    p = np.ones(LENS.n_pixels)
    sampling = GlossSampling(patch_rays=64, camera_rays=16)
    scene, flat = (made(one, floor_gloss(ROOM), sampling=sampling) for one in (ROOM, mesh))
    assert np.allclose(scene.direct @ p, flat.direct @ p, rtol=1e-6)
    assert (scene @ p).sum() == pytest.approx((flat @ p).sum(), rel=0.02)
    assert isinstance(flat, GlossyTransport)


def test_the_same_rays_make_the_same_transport():
    p = np.ones(LENS.n_pixels)
    assert np.array_equal(made() @ p, made() @ p)
    other = GlossSampling(patch_rays=16, projector_rays=2, camera_rays=4, seed=5)
    assert not np.array_equal(made() @ p, made(sampling=other) @ p)


def test_what_cannot_do_gloss_says_so(coaxial):
    by_pixel = made(apart=False)
    with pytest.raises(SimulationError, match="mirrored='patch'"):
        compensate("bounded", by_pixel, by_pixel @ np.full(LENS.n_pixels, 0.5))
    with pytest.raises(SimulationError, match="frames know matte patches only"):
        frame_model(coaxial, LENS.shape)


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ({"mirrored": "nicely"}, "unknown way to mirror"),
        ({"gloss": Gloss(np.full(3, 0.1), np.full(3, 0.3))}, "gloss of 3 patches"),
        ({"camera_pose": None}, "needs lens and pose"),
    ],
)
def test_parts_that_do_not_fit_are_refused(more, what):
    arguments = {"gloss": floor_gloss(ROOM), "camera_lens": CAMERA, "camera_pose": BESIDE} | more
    with pytest.raises(SimulationError, match=what):
        glossy_transport(ROOM, form_factors(ROOM), LENS, POSE, **arguments)


def test_no_rays_are_refused():
    with pytest.raises(SimulationError, match="0 rays"):
        GlossSampling(camera_rays=0)
