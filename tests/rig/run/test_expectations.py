"""Each number of a session stands beside the range that the rig's own noise and geometry let one expect."""

import json

import numpy as np
import pytest

from calibration.structured_light.consistency.map_noise import map_noise_px
from tests.rig.conftest import Finished


@pytest.mark.parametrize("noise_px", [0.02, 0.3])
def test_the_noise_of_a_map_is_found_beside_edges_and_holes(noise_px: float) -> None:
    random = np.random.default_rng(3)
    y, x = np.mgrid[0:200, 0:300].astype(float)
    xy = np.stack([0.8 * x + 0.1 * y + 1e-4 * x * x, 0.9 * y - 0.05 * x], axis=-1)
    xy[:, 150:] += (37.0, -8.0)
    xy += noise_px / np.sqrt(2) * random.standard_normal(xy.shape)
    xy[:, 40:60] = np.nan
    assert map_noise_px(xy) == pytest.approx(noise_px, rel=0.06)


def test_a_map_without_a_whole_part_has_no_figure() -> None:
    assert np.isnan(map_noise_px(np.full((4, 5, 2), np.nan)))


@pytest.mark.slow
def test_a_session_says_what_to_expect_of_each_number_why_and_what_to_do(finished: Finished) -> None:
    figures = json.loads(finished.out)["expected"]
    assert [figure["what"].split(",")[0] for figure in figures] == [
        "reprojection error of the projector",
        "measured - simulated",
        "share of pixels within 3 standard deviations",
        "error of the compensated picture",
    ]
    for figure in figures:
        assert 0 <= figure["low"] <= figure["high"] < np.inf
        assert figure["because"]
        assert figure["raised_by"]
        assert figure["remedy"]
