"""Live frames on meshes: the kernel against its definition, and both against the light transport itself."""

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.frame.compensator import FrameCompensator, frame_model
from sim.geometry.mesh import Mesh
from sim.geometry.optics import Lens, rays_at
from sim.geometry.rays import trace
from sim.light.colour import ColourTransport
from sim.light.mesh_view import NodeView, mesh_view, node_view
from sim.light.radiosity import Radiosity
from sim.light.transport import LightTransport
from sim.light.transport_of_scene import area_emission, irradiance_at
from sim.reference.frame import reference_frame
from sim.scenes.gridded import room
from sim.scenes.meshes import icosphere
from tests.sim.frame.transports import GAMMA, MIXING, POSE, difference, level, picture

SHAPE = (29, 45)


@pytest.fixture(scope="module")
def in_mesh():
    """A transport in three bands of a room with a ball in it, and what its pixels see in two steps."""
    walls = room((4.8, 4.8, 2.4), 0.6, 0.6)
    ball = (np.array([3.0, 3.0, 1.0]) + 0.6 * icosphere(1))[:, [0, 1, 2, 2]]
    region = np.concatenate([walls.region, np.full(len(ball), 6)])
    vertices = np.concatenate([walls.vertices, ball])
    mesh = Mesh(name="room with a ball", vertices=vertices, reflectance=np.full(len(vertices), 0.6), region=region)
    lens = Lens.from_horizontal_field_of_view(SHAPE[1], SHAPE[0], 100.0)
    rays = rays_at(lens, POSE, lens.pixel_grid())
    hits = trace(mesh, POSE.position_m, rays)
    points = POSE.position_m + hits.distance[:, None] * rays
    light = irradiance_at(mesh, lens, POSE, points_m=points, patch=hits.patch)
    factors = form_factors(mesh, "rays", rays=64)
    white = area_emission(mesh.with_reflectance(1.0), lens, POSE, subsamples=2, convention="physical")
    bands = [
        LightTransport(
            csr_array(diags_array(rho * light)),
            csr_array(rho * white),
            Radiosity(factors, np.full(mesh.n_patches, rho)),
            mesh_view(mesh.with_reflectance(rho), hits, np.full(lens.n_pixels, rho)),
            pixel_patch=hits.patch,
        )
        for rho in (0.7, 0.6, 0.5)
    ]
    return ColourTransport(bands, MIXING), node_view(mesh, hits)


@pytest.fixture(scope="module")
def model(in_mesh):
    colour, nodes = in_mesh
    return frame_model(colour, SHAPE, target_scale=level(colour), eotf=GAMMA, response=GAMMA, node_view=nodes)


def test_the_two_steps_are_the_view_that_photographs_are_compared_with(in_mesh):
    colour, nodes = in_mesh
    seen = diags_array(np.full(nodes.weights.shape[0], 0.7)) @ nodes.weights @ nodes.nodes / 0.7
    assert abs(seen - colour.bands[0].view).max() < 1e-12
    assert np.diff(nodes.weights.indptr).max() <= 3


def test_without_the_two_steps_a_mesh_is_refused(in_mesh):
    with pytest.raises(SimulationError, match="a pixel sees"):
        frame_model(in_mesh[0], SHAPE)


def test_a_view_of_other_pixels_is_refused(in_mesh):
    colour, nodes = in_mesh
    with pytest.raises(SimulationError, match="transport's own pixels"):
        frame_model(colour, SHAPE, node_view=NodeView(csr_array(nodes.weights[:7]), nodes.nodes))


def test_the_kernel_is_within_one_code_of_its_definition(model):
    codes = picture(SHAPE)
    shown = FrameCompensator(model).frame(codes)
    assert difference(shown, reference_frame(model, codes)).max() <= 1
    assert shown.std() > 10


def test_exact_frames_show_the_target_where_the_projector_can(in_mesh, model):
    colour, _ = in_mesh
    codes = np.full((*SHAPE, 3), 150, np.uint8)
    shown = FrameCompensator(model).frame(codes).reshape(-1, 3)
    seen = colour.forward(GAMMA[shown]) / level(colour)
    free = ((shown > 2) & (shown < 254)).all(axis=1)
    assert free.mean() > 0.3
    assert np.median(np.abs(seen[free] / GAMMA[150] - 1)) < 0.02


def test_bounded_frames_come_nearer_than_clamped_ones(in_mesh, model):
    colour, _ = in_mesh
    codes = picture(SHAPE, 3)
    errors = []
    for strategy in ("exact", "bounded"):
        compensator = FrameCompensator(model, strategy)
        for _ in range(6):
            shown = compensator.frame(codes).reshape(-1, 3)
        errors.append(np.mean((colour.forward(GAMMA[shown]) / level(colour) - GAMMA[codes.reshape(-1, 3)]) ** 2))
    assert errors[1] < errors[0]
