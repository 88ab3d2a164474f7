"""What a slope a patch leaves of steps and bends, and what sixteenths show of it: where the constants come from."""

import numpy as np
import pytest

from sim.geometry.adaptive_patches import coarsest_patches
from sim.geometry.mesh import Mesh
from sim.planning import linear_light

LINES = 400
PATCHES = {
    "square": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    "triangle": [[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0], [0.4, 0.9, 0]],
}


def cut(corners, times):
    cells = coarsest_patches(Mesh(name="one", vertices=np.array([corners], dtype=float), reflectance=np.array([0.5])))
    for _ in range(times):
        cells = cells.quarters()
    return cells


def left_of(corners, field):
    """(LINES, 3) of fields over lines at random: what a slope leaves, truly and on sixteenths; the seen share."""
    cells, fine, rng = cut(corners, 0), cut(corners, 5), np.random.default_rng(1)
    offset, share = linear_light._pieces(cells, linear_light._sixteenths(cells))
    weight, place, piece = fine.areas / fine.areas.sum(), fine.centres[:, :2], np.arange(fine.n_patches) % 16
    basis = np.column_stack([np.ones(len(place)), place])
    fit = np.linalg.inv(basis.T @ (weight[:, None] * basis)) @ (basis.T * weight)
    found = []
    for _ in range(LINES):
        angle = rng.uniform(0, 2 * np.pi)
        along = place @ [np.cos(angle), np.sin(angle)]
        values = field(along - rng.uniform(along.min(), along.max()))
        values = values - weight @ values
        true = weight @ (values - basis @ (fit @ values)) ** 2
        means = (np.bincount(piece, weight * values) / np.bincount(piece, weight))[:, None]
        seen = float((share * linear_light._beside_linear(means, offset, share) ** 2).sum())
        found.append((true, seen, seen / max(float((share * means**2).sum()) / linear_light.SEEN_OF_LINEAR, 1e-30)))
    return np.array(found).T


@pytest.mark.parametrize("corners", PATCHES.values(), ids=PATCHES)
def test_sixteenths_show_of_steps_and_of_bends_what_the_constants_say(corners):
    step, _, _ = shown = left_of(corners, lambda height: (height > 0) * 1.0)
    bend = left_of(corners, lambda height: np.maximum(height, 0.0) ** 2)
    assert shown[1].sum() / step.sum() == pytest.approx(linear_light.SEEN_OF_STEP, abs=0.06)
    assert 0.95 * linear_light.SEEN_OF_BEND < bend[1].sum() / bend[0].sum() < 0.82


@pytest.mark.parametrize("corners", PATCHES.values(), ids=PATCHES)
def test_nearly_all_that_steps_leave_is_above_the_share_from_which_they_are_taken_for_steps(corners):
    true, _, share = left_of(corners, lambda height: (height > 0) * 1.0)
    above = [true[share > least].sum() / true.sum() for least in (linear_light.STEP_SHARE, 0.15)]
    assert above[0] > 0.97
    assert above[1] < 0.9
