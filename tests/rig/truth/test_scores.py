"""What a session is scored against."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from rig.capture.rig import Rig, open_rig
from rig.devices.simulated import stage
from rig.errors import ProfileError
from rig.profile.schema import Profile
from rig.truth.scores import ground_truth_worlds


def behind_drivers(profile: Profile) -> Rig:
    """A virtual rig, whose devices nobody may need for scoring."""
    camera = profile.camera.model_copy(update={"driver": "v4l2"})
    return cast("Rig", SimpleNamespace(profile=profile.with_device(camera)))


def test_the_truth_of_a_emulated_rig_is_that_of_the_simulated_pair(tiny_profile: Profile) -> None:
    codes = np.random.default_rng(1).integers(0, 256, tiny_profile.projector.shape, dtype=np.uint8)
    with open_rig(tiny_profile) as rig:
        (simulated,) = ground_truth_worlds(rig)
        stage._kept.clear()  # as in a process of its own
        (virtual,) = ground_truth_worlds(behind_drivers(tiny_profile))
    assert virtual is not simulated
    np.testing.assert_array_equal(virtual.light(codes).total, simulated.light(codes).total)
    np.testing.assert_array_equal(virtual.camera.position_m, simulated.camera.position_m)


def test_a_rig_that_is_real_has_no_truth(tiny_profile: Profile) -> None:
    with pytest.raises(ProfileError, match="simulation: missing"):
        ground_truth_worlds(behind_drivers(tiny_profile.model_copy(update={"simulation": None})))
