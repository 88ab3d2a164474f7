"""Which pixels tell the projector's curve."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from rig.stages.linear_light import LightImage
from rig.stages.radiometry import witnesses


def white_of(light: np.ndarray, clips_from: float) -> LightImage:
    """Return a grey photograph of white whose sensor clips at some light."""
    seen = np.minimum(light, clips_from)[..., None].astype(np.float32)
    return LightImage(seen, np.full_like(seen, 1e-6), seen >= np.float32(clips_from))


def test_a_glare_that_clips_does_not_bend_the_projectors_curve() -> None:
    lit = np.full((40, 40), 0.2)
    lit[:4] = 3.0  # a wall beside the projector: a tenth of the pixels has five eighths of the light
    white = white_of(lit, clips_from=0.95)
    chosen = witnesses(white)
    half = white_of(lit / 2, clips_from=0.95)
    assert chosen.any()
    assert half.value[chosen].sum() / white.value[chosen].sum() == pytest.approx(0.5)


def test_pixels_that_see_little_of_the_projector_are_no_witnesses() -> None:
    lit = np.full((40, 40), 0.6)
    lit[20:] = 0.01
    assert np.array_equal(witnesses(white_of(lit, clips_from=0.95)), lit > 0.5)


def test_white_that_clips_everywhere_is_what_is_said() -> None:
    with pytest.raises(CalibrationError, match="none of the 1600 lit pixels is below the camera's full scale"):
        witnesses(white_of(np.full((40, 40), 2.0), clips_from=0.95))
