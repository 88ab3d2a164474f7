"""A projector's black beside room light, in pictures of walls with texture, posters and light from a window."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.radiometry.projector_black import projector_black

SHAPE = (240, 320)
ROWS, COLUMNS = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]


def room(contrast, *, room_light=0.02, seed=3):
    """Black, white, and where the projector's picture is: a slanted border across the picture."""
    random = np.random.default_rng(seed)
    wall = 0.6 + 0.04 * np.sin(COLUMNS / 23) * np.cos(ROWS / 31)
    wall = np.where((COLUMNS > 60) & (COLUMNS < 110) & (ROWS > 90) & (ROWS < 150), 0.2, wall)
    inside = COLUMNS + 0.3 * ROWS < 230
    outside = COLUMNS + 0.3 * ROWS > 236
    direct, between = np.where(inside, 0.7, 0.0), 0.2 - 0.0003 * COLUMNS
    white = wall * (direct + between)
    window = room_light * (0.5 + COLUMNS / SHAPE[1] + 0.3 * ROWS / SHAPE[0])
    black = wall * window + white / contrast + random.normal(0, 1e-4, SHAPE)
    return black, white + random.normal(0, 1e-3, SHAPE), inside, outside


@pytest.mark.parametrize("contrast", [200, 1000, 5000])
@pytest.mark.parametrize("room_light", [0.0, 0.02, 0.05])
def test_the_contrast_is_found_within_three_sigmas_whatever_the_room_light(contrast, room_light):
    found = projector_black(*room(contrast, room_light=room_light))
    assert abs(found.share_of_white - 1 / contrast) < 3 * found.sigma
    assert found.sigma < 2e-5 + 0.04 * room_light


def test_a_picture_whose_border_is_not_seen_tells_nothing():
    black, white, inside, outside = room(1000)
    assert projector_black(black, white, np.ones_like(inside), np.zeros_like(outside)) is None
    hardly = outside & (ROWS < 40)
    assert projector_black(black, white, inside, hardly) is None
