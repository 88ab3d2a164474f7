"""Live frames on random meshes, and on pictures made to hurt: the kernel against its definition, step by step."""

import dataclasses

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from sim.form_factors import form_factors
from sim.frame.compensator import FIRST_STEPS, STEPS, FrameCompensator, frame_model
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, Pose, rays_at
from sim.geometry.rays import trace
from sim.light.colour import ColourTransport
from sim.light.mesh_view import mesh_view, node_view
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, irradiance_at
from sim.reference.frame import patch_sums, reference_bounded, reference_frame
from sim.scenes.gridded import room
from sim.scenes.meshes import icosphere
from tests.sim.frame.transports import GAMMA, POSE, S_CURVE, check_same_bytes, difference, in_colour, level, picture

SEEDS = (1, 2, 31, 41)
SIZE_M = (4.8, 4.8, 2.4)


def random_mesh(generator):
    """A room with one to three dented balls, each triangle of a paint of its own; some triangles are black."""
    walls = room(SIZE_M, generator.uniform(0.5, 1.3), 0.6)
    parts, regions = [walls.vertices], [walls.region]
    for number in range(generator.integers(1, 4)):
        ball = icosphere(int(generator.integers(0, 3)))
        dents = 1 + 0.3 * np.sin(ball @ generator.uniform(-3, 3, 3))[..., None]
        middle = generator.uniform((2.4, 2.4, 0.6), (4.0, 4.0, 1.8))
        parts.append((middle + generator.uniform(0.2, 0.5) * dents * ball)[:, [0, 1, 2, 2]])
        regions.append(np.full(len(ball), len(walls.faces) + number))
    vertices = np.concatenate(parts)
    paint = generator.uniform(0.2, 0.85, len(vertices)) * (generator.uniform(size=len(vertices)) > 0.03)
    return Mesh(name="random", vertices=vertices, reflectance=paint, region=np.concatenate(regions))


def random_model(seed):
    """A frame model of a random mesh: shape, lens and place by chance, too."""
    generator = np.random.default_rng(seed)
    mesh, shape = random_mesh(generator), tuple(int(side) for side in generator.integers((9, 33), (60, 300)))
    pose = Pose.look_at(generator.uniform(0.9, 1.5, 3), generator.uniform((2.8, 2.8, 0.6), (4.2, 4.2, 1.6)))
    return model_of(mesh, shape, pose, generator, response=GAMMA if seed % 2 else S_CURVE)


def model_of(mesh, shape, pose, generator, response=GAMMA):
    """A frame model of a mesh in three bands that mix, with black and dither, and pixels left out by chance."""
    lens = Lens.from_horizontal_field_of_view(shape[1], shape[0], generator.uniform(60, 100))
    rays = rays_at(lens, pose, lens.pixel_grid())
    hits = trace(mesh, pose.position_m, rays)
    points = pose.position_m + hits.distance[:, None] * rays
    light = irradiance_at(mesh, lens, pose, points_m=points, patch=hits.patch)
    emission = area_emission(mesh.with_reflectance(1.0), lens, pose, subsamples=1, convention="physical")
    active = (mesh.reflectance[hits.patch] * light > 0) & (generator.uniform(size=lens.n_pixels) > 0.02)
    chosen, factors, bands = np.flatnonzero(active), form_factors(mesh, "rays", rays=64), []
    for share in generator.uniform(0.6, 1.0, 3):
        painted = mesh.with_reflectance(share * mesh.reflectance)
        seen = painted.reflectance[hits.patch]
        bands.append(
            LightTransport(
                csr_array(diags_array((seen * light)[chosen])),
                csr_array(diags_array(painted.reflectance) @ emission[:, chosen]),
                Radiosity(factors, painted.reflectance),
                csr_array(mesh_view(painted, hits, seen)[chosen]),
                pixel_patch=hits.patch[chosen],
            )
        )
    colour = ColourTransport(bands, np.eye(3) + generator.uniform(0, 0.12, (3, 3)))
    view = node_view(mesh, hits)
    return frame_model(
        colour,
        shape,
        active,
        target_scale=level(colour),
        black=0.02 * generator.uniform(size=(len(chosen), 1)) * level(colour),
        eotf=GAMMA,
        response=response,
        dither_seed=1,
        node_view=dataclasses.replace(view, weights=csr_array(view.weights[chosen])),
    )


@pytest.fixture(scope="module", params=SEEDS)
def model(request):
    return random_model(request.param)


def furthest(model, shown, defined):
    """Largest difference in codes, but for codes that give nearly the same light: those at a response's flat top.

    The table of a response has an entry each 128th of white's light, in which the S-shaped one passes 30 codes.
    """
    channel = np.arange(3)
    light = model.response / model.response[:, -1:]
    apart = np.abs(light[channel, shown] - light[channel, defined])
    return np.where(apart < 0.002, np.minimum(difference(shown, defined), 1), difference(shown, defined)).max()


def hurtful(shape, seed=0):
    """Pictures that no film has: even ones, stripes of one pixel both ways, noise, one lit pixel."""
    generator = np.random.default_rng(seed)
    rows, columns = np.indices(shape)
    for even in (0, 1, 255):
        yield np.full((*shape, 3), even, dtype=np.uint8)
    for stripes in (rows % 2, columns % 2, (rows + columns) % 2):
        yield np.repeat(255 * stripes[..., None], 3, axis=2).astype(np.uint8)
    yield generator.integers(0, 256, (*shape, 3), dtype=np.uint8)
    one = np.zeros((*shape, 3), dtype=np.uint8)
    one[shape[0] // 2, shape[1] // 2] = 255
    yield one


def test_exact_frames_are_within_one_code_of_their_definition(model):
    compensator = FrameCompensator(model)
    for codes in (picture(model.shape), *hurtful(model.shape)):
        assert furthest(model, compensator.frame(codes), reference_frame(model, codes)) <= 1
    assert compensator.frame(picture(model.shape)).std() > 10


def test_bounded_frames_are_within_one_code_of_their_definition_step_by_step(model):
    compensator, state, steps = FrameCompensator(model, "bounded"), None, FIRST_STEPS
    for shift in range(4):
        codes = np.roll(picture(model.shape), shift, axis=1)
        shown = compensator.frame(codes)
        defined, state = reference_bounded(model, codes, steps, state)
        assert furthest(model, shown, defined) <= 1
        assert (difference(shown, defined) > 0).mean() < 0.02
        steps = STEPS


def test_bounded_frames_of_hurtful_pictures_are_within_one_code_of_their_definition(model):
    compensator = FrameCompensator(model, "bounded")
    for codes in hurtful(model.shape):
        compensator.reset()
        defined, _ = reference_bounded(model, codes, FIRST_STEPS)
        assert furthest(model, compensator.frame(codes), defined) <= 1


@pytest.mark.parametrize("gain", [0.0, 1e-30, 4.0])
@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_dark_and_bright_gains_lead_where_the_definition_does(model, strategy, gain):
    codes = picture(model.shape)
    shown = FrameCompensator(model, strategy).frame(codes, gain=gain)
    if strategy == "exact":
        defined = reference_frame(model, codes, gain)
    else:
        defined, _ = reference_bounded(model, codes, FIRST_STEPS, gain=gain)
    assert furthest(model, shown, defined) <= 1


@pytest.mark.parametrize("strategy", ["exact", "bounded"])
def test_threads_and_instruction_sets_change_no_byte_on_meshes(model, strategy):
    check_same_bytes(model, strategy, picture(model.shape), threads=(2, 5))


def test_gridded_walls_take_the_same_bounded_steps():
    shape = (29, 45)
    colour, codes = in_colour(shape[1], shape[0]), picture((29, 45), 3)
    model = frame_model(colour, shape, target_scale=level(colour), response=GAMMA)
    compensator = FrameCompensator(model, "bounded")
    defined, state = reference_bounded(model, codes, FIRST_STEPS)
    assert difference(compensator.frame(codes), defined).max() <= 1
    defined, _ = reference_bounded(model, codes, STEPS, state)
    assert difference(compensator.frame(codes), defined).max() <= 1


def test_no_patch_is_so_small_that_its_light_is_left_out_of_the_sums():
    walls, ball = room(SIZE_M, 1.2, 0.6), (np.array([2.6, 2.6, 1.2]) + 0.06 * icosphere(1))[:, [0, 1, 2, 2]]
    mesh = Mesh(
        name="a small ball",
        vertices=np.concatenate([walls.vertices, ball]),
        reflectance=np.full(walls.n_patches + len(ball), 0.6),
        region=np.concatenate([walls.region, np.full(len(ball), len(walls.faces))]),
    )
    model = model_of(mesh, (270, 480), POSE, np.random.default_rng(1))
    assert len(model.sum_rows) < 0.6 * model.shape[0]
    patch = model.patch_runs.value[model.patch_runs.of_pixels(model.shape), 0].ravel()
    whole = np.bincount(patch, model.emission.values[0].ravel(), model.n_lit)
    assert whole.min() > 0
    assert patch_sums(model, np.ones((3, *model.shape)))[0] == pytest.approx(whole, rel=1e-3)
