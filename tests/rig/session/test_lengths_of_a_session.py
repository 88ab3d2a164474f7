"""Lengths by tape of what is seen: a second one makes a session surer, one that contradicts is refused."""

from __future__ import annotations

import pytest

from calibration.errors import CalibrationError
from calibration.geometry.stereo import calibrate_stereo
from rig.profile.schema import Profile
from rig.session import Session
from rig.stages import geometry
from rig.stages.correspondence import load_correspondence, load_correspondence_figures
from rig.stages.geometry import GeometryRecord, geometry_of
from rig.terminal import silent
from tests.rig.conftest import Finished

LENS_M = 1.2
"""The simulated projector's above the floor of ci-tiny, which both devices see."""


@pytest.fixture(scope="module", autouse=True)
def _fitted_once() -> object:
    """The points are fitted without any tape: once is enough for all of these."""
    fitted = []

    def once(*given: object, **options: object) -> object:
        if not fitted:
            fitted.append(calibrate_stereo(*given, **options))  # type: ignore[arg-type]
        return fitted[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(geometry, "calibrate_stereo", once)
        yield


def found(finished: Finished, profile: Profile, **room: object) -> GeometryRecord:
    session = Session.read(finished.folder)
    other = profile.model_copy(update={"surface": profile.room.model_copy(update=room)})
    averaged_px2 = load_correspondence_figures(session).averaged_px2
    return geometry_of(load_correspondence(session), other, silent, averaged_px2=averaged_px2)


def test_the_height_of_a_room_by_tape_makes_places_surer(finished: Finished, tiny_profile: Profile) -> None:
    one, two = found(finished, tiny_profile, size_m=None), found(finished, tiny_profile)
    assert two.sigmas["baseline_m"] < 0.85 * one.sigmas["baseline_m"]
    assert two.surface.size_m[2] == pytest.approx(2.4, abs=3 * two.sigmas["room_z_m"])


def test_the_lens_above_a_floor_that_is_seen_is_a_length_too(finished: Finished, tiny_profile: Profile) -> None:
    without = found(finished, tiny_profile)
    told = found(finished, tiny_profile, lens_height_m=LENS_M)
    assert told.sigmas["baseline_m"] < 0.95 * without.sigmas["baseline_m"]
    assert told.sigmas["projector_z_m"] < 0.8 * without.sigmas["projector_z_m"]


def test_a_scale_that_is_off_is_drawn_towards_what_the_other_tapes_say(
    finished: Finished, tiny_profile: Profile
) -> None:
    scale = tiny_profile.scale.model_copy(update={"distance_m": 1.006 * (tiny_profile.scale.distance_m or 0)})
    off = tiny_profile.model_copy(update={"scales": (scale,)})
    alone, held = found(finished, off, size_m=None), found(finished, off, lens_height_m=LENS_M)
    assert abs(held.surface.size_m[2] - 2.4) < 0.5 * abs(alone.surface.size_m[2] - 2.4)
    assert abs(held.surface.size_m[2] - 2.4) < 3 * held.sigmas["room_z_m"]


def test_walls_that_may_stand_askew_are_no_two_lengths_apart(finished: Finished, tiny_profile: Profile) -> None:
    """A tape was laid at one place, points were measured at others."""
    with pytest.raises(CalibrationError, match=r"2\.330 \+- 0\.007 m by \[surface\] size_m: 7 sigma"):
        found(finished, tiny_profile, size_m=(4.8, 4.8, 2.33))
    held = found(finished, tiny_profile, size_m=(4.8, 4.8, 2.33), askew_deg=0.3)
    assert 2.33 < held.surface.size_m[2] < 2.4
    assert held.askew_sigmas is None, "it is part of the sigmas"
    assert held.sigmas["room_z_m"] > 1.2 * found(finished, tiny_profile).sigmas["room_z_m"]


def test_a_lens_that_the_tape_puts_elsewhere_is_refused_with_both_heights(
    finished: Finished, tiny_profile: Profile
) -> None:
    with pytest.raises(CalibrationError, match=r"lens is 1\.(19|20)\d \+- .* m above the floor that is seen, 1\.300"):
        found(finished, tiny_profile, lens_height_m=LENS_M + 0.1)
