"""A transport with what was learned of it: still one linear operator, for all that takes one."""

import numpy as np
import pytest

from sim.compensation import compensate
from sim.errors import SimulationError
from sim.form_factors import form_factors
from sim.geometry.optics import Lens, Pose
from sim.light.learned_transport import with_learned
from sim.light.transport_of_scene import coaxial_transport
from sim.scenes.gridded import paper_room

LENS = Lens.from_horizontal_field_of_view(32, 24, 100.0)
RANK = 3


@pytest.fixture(scope="module")
def model():
    scene = paper_room()
    return coaxial_transport(scene, form_factors(scene), LENS, Pose.look_at((1.2, 1.2, 1.2), (2.2, 2.2, 1.2)))


@pytest.fixture(scope="module")
def change(model):
    """U and V, small beside the light that there is."""
    random = np.random.default_rng(3)
    by_pixel = 0.01 * random.normal(size=(model.shape[0], RANK))
    by_patch = random.normal(size=(RANK, model.radiosity.n_patches)) / model.radiosity.n_patches
    return by_pixel, by_patch


@pytest.fixture(scope="module")
def learned(model, change):
    return with_learned(model, *change)


def test_what_was_learned_is_added_to_global_light_alone(model, learned, change):
    p = np.random.default_rng(4).random((LENS.n_pixels, 2))
    by_pixel, by_patch = change
    more = by_pixel @ (by_patch @ (model.emission @ p))
    assert np.allclose(learned.global_ @ p, model.global_ @ p + more)
    assert np.allclose(learned.direct @ p, model.direct @ p)


def test_it_and_its_adjoint_agree(learned):
    random = np.random.default_rng(5)
    x, y = random.random(learned.shape[1]), random.random(learned.shape[0])
    assert (learned @ x) @ y == pytest.approx(x @ (learned.T @ y), rel=1e-12)
    assert np.allclose(learned.interreflection.apply(x), learned.global_ @ x)
    assert np.allclose(learned.interreflection.adjoint(y), learned.global_.T @ y)


def test_gathering_what_was_solved_leaves_the_emission(learned):
    E = learned.emission @ np.random.default_rng(6).random(LENS.n_pixels)
    B = learned.radiosity.solve(E)
    assert np.allclose(B - learned.radiosity.gather(B), E)


@pytest.mark.parametrize("strategy", ["none", "direct", "paper", "exact", "bounded", "dual", "series"])
def test_every_strategy_takes_it(learned, strategy):
    wanted = 0.3 * np.asarray(learned @ np.ones(LENS.n_pixels))
    found = compensate(strategy, learned, wanted)
    assert np.isfinite(found.projector_image).all()


def test_the_optimum_knows_of_it(model, learned):
    wanted = 0.3 * np.asarray(learned @ np.ones(LENS.n_pixels))
    errors = [
        np.linalg.norm(learned @ compensate("bounded", each, wanted).projector_image - wanted)
        for each in (learned, model)
    ]
    assert errors[0] < errors[1]


def test_parts_that_do_not_fit_are_refused(model, change):
    with pytest.raises(SimulationError, match="do not fit"):
        with_learned(model, change[0], change[1][:, 1:])
