"""How far one photograph is displaced from another, by what the check of stability measures it with."""

import cv2
import numpy as np
import pytest

from calibration.structured_light.consistency.displacement import clear_shift_px, shift_px
from tests.rig.self_check.rig_with_faults import displaced


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.013, -0.31), (0.5, 0.5), (2.4, -1.7), (-7.25, 4.0)])
@pytest.mark.parametrize(("shape", "grain_px"), [((240, 320), 2.0), ((240, 320), 1.0), ((700, 900), 4.0)])
def test_shifts_are_found_to_a_fiftieth_of_a_pixel(
    shift: tuple[float, float], shape: tuple[int, int], grain_px: float
) -> None:
    random = np.random.default_rng(2)
    scene = 1000 + 1000 * grain_px * cv2.GaussianBlur(random.normal(0, 1, shape), (0, 0), grain_px)
    kept = scene.copy()
    found = shift_px(1.1 * displaced(scene, *shift) + random.normal(0, 5, shape) + 30, scene)
    assert found == pytest.approx(shift, abs=0.02)
    assert np.array_equal(scene, kept)


@pytest.mark.parametrize("seed", range(5))
def test_a_bare_wall_has_no_displacement(seed: int) -> None:
    """Its photographs are alike but for noise, whose correlation peaks anywhere."""
    random = np.random.default_rng(seed)
    smooth = 1000 + np.linspace(0, 200, 320)[None, :] * np.ones((240, 1))
    photographs = [smooth + random.normal(0, 5, smooth.shape) for _ in range(2)]
    assert np.hypot(*clear_shift_px(*photographs)) < 0.1
    assert clear_shift_px(np.full((240, 320), 7.0), np.full((240, 320), 7.0)) == (0.0, 0.0)


@pytest.mark.parametrize("shift", [(0.5, 0.3), (2.4, -1.7)])
def test_what_is_displaced_is_so_beside_noise_and_a_brighter_lamp(shift: tuple[float, float]) -> None:
    random = np.random.default_rng(4)
    scene = 1000 + 300 * cv2.GaussianBlur(random.normal(0, 1, (240, 320)), (0, 0), 3.0) * 5
    found = clear_shift_px(1.1 * displaced(scene, *shift) + random.normal(0, 20, scene.shape), scene)
    assert found == pytest.approx(shift, abs=0.05)
