"""Which pixels the geometry rests on: away from edges, and yet some of every wall that was decoded."""

from __future__ import annotations

import numpy as np

from calibration.structured_light.correspondence import Correspondence, PixelReason
from rig.stages.maps.edges import inside_and_beside

HEIGHT, WIDTH = 200, 400
PROJECTOR = (300, 500)
EDGE_PX = 2
"""Of a picture 400 px wide: half a percent."""


def decoded(lost: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> Correspondence:
    """Refined coordinates over a picture, but for the pixels that were lost."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    xy = np.stack([20.123 + 1.01 * x, 30.217 + 0.97 * y], axis=-1).astype(np.float32)
    reason = np.where(lost, PixelReason.UNCERTAIN_BIT, PixelReason.VALID).astype(np.uint8)
    return Correspondence(np.where(lost[..., None], np.nan, xy).astype(np.float32), reason, PROJECTOR)


def test_a_wall_full_of_holes_has_points_inside_where_a_clean_one_has_none_beside_its_holes() -> None:
    lost = np.zeros((HEIGHT, WIDTH), dtype=bool)
    lost[:, 200:] = np.random.default_rng(3).random((HEIGHT, 200)) < 0.2
    lost[100, 50] = True
    inside, beside = inside_and_beside(decoded(lost))
    noisy = inside[20:-20, 270:-20]
    assert noisy.sum() > 0.7 * noisy.size
    # Around the clean half's only hole there is no need to come near.
    assert not inside[100 - EDGE_PX : 101 + EDGE_PX, 50 - EDGE_PX : 51 + EDGE_PX].any()
    assert not (inside & beside).any()
    assert ((inside | beside) == ~lost).all()


def test_the_rim_of_a_wall_full_of_holes_is_an_edge_all_the_same() -> None:
    lost = np.random.default_rng(4).random((HEIGHT, WIDTH)) < 0.2
    lost[:, 300:] = True
    lost[:5] = True
    inside, _ = inside_and_beside(decoded(lost))
    assert inside[50:150, 100:250].mean() > 0.7
    assert not inside[:, 300 - EDGE_PX :].any()
    assert not inside[: 5 + EDGE_PX].any()


def test_where_walls_meet_codes_that_stayed_whole_are_an_edge() -> None:
    found = decoded(np.zeros((HEIGHT, WIDTH), dtype=bool))
    xy = found.projector_xy_px.copy()
    xy[:, 150:152] = np.rint(xy[:, 150:152])
    inside, _ = inside_and_beside(Correspondence(xy, found.reason, PROJECTOR))
    assert not inside[:, 150 - EDGE_PX : 152 + EDGE_PX].any()
    assert inside[10:-10, 10:140].all()
