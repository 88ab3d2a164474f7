"""What every camera has to do."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from rig.capture.rig import Rig
from rig.devices.protocols import Camera, gain_control_of
from rig.errors import CaptureTimeout, DeviceLost, SettingRefused

Show = Callable[[str], float]
AMPLIFYING = ("simulated", "genicam", "v4l2")
"""Drivers whose test cameras have a gain; the virtual still camera has no sensitivities."""
IGNORING = ("platform:vivid-000",)
"""Test cameras that have a control named gain which their pictures do not follow."""


class TestCamera:
    def test_it_has_the_whole_protocol(self, rig: Rig) -> None:
        assert isinstance(rig.camera, Camera)

    def test_frames_are_unsigned_integers_of_its_shape_and_range(self, rig: Rig, show: Show) -> None:
        frame = rig.camera.capture(after_s=show("white"), timeout_s=5.0)
        assert frame.pixels.dtype == np.uint16
        assert frame.pixels.shape == rig.camera.shape == rig.profile.camera.shape
        assert int(frame.pixels.max()) <= rig.camera.full_scale_dn == rig.profile.camera.full_scale_dn
        assert frame.pixels.std() > 0

    def test_a_frame_begins_when_it_was_asked_to(self, rig: Rig, show: Show) -> None:
        show("white")
        after_s = rig.clock.now_s() + 0.5
        assert rig.camera.capture(after_s=after_s, timeout_s=5.0).started_s >= after_s

    def test_capturing_returns_after_the_exposure_has_ended(self, rig: Rig, show: Show) -> None:
        frame = rig.camera.capture(after_s=show("white"), timeout_s=5.0)
        assert rig.clock.now_s() >= frame.started_s + frame.exposure_s

    def test_frames_do_not_overlap_and_are_counted_up(self, rig: Rig, show: Show) -> None:
        settled_s = show("white")
        frames = [rig.camera.capture(after_s=settled_s, timeout_s=5.0) for _ in range(4)]
        for earlier, later in pairwise(frames):
            assert later.sequence > earlier.sequence
            assert later.started_s >= earlier.started_s + earlier.exposure_s - 1e-9

    def test_a_frame_says_the_exposure_that_was_chosen(self, rig: Rig, show: Show) -> None:
        asked_s = 0.05 if rig.profile.camera.driver == "gphoto2" else 0.04  # one of the camera's own steps
        chosen_s = rig.camera.set_exposure(asked_s)
        assert chosen_s == pytest.approx(asked_s, rel=0.01)
        assert rig.camera.capture(after_s=show("white"), timeout_s=5.0).exposure_s == chosen_s

    def test_exposures_outside_its_range_are_refused(self, rig: Rig) -> None:
        shortest, longest = rig.camera.exposure_range_s
        for exposure_s in (shortest / 2, longest * 2, 0.0, -1.0, float("nan")):
            with pytest.raises(SettingRefused, match="outside"):
                rig.camera.set_exposure(exposure_s)

    def test_it_gives_up_when_no_frame_can_come_in_time(self, rig: Rig, show: Show) -> None:
        show("white")
        asked_s = rig.clock.now_s()
        with pytest.raises(CaptureTimeout, match=r"within 0\.5 s"):
            rig.camera.capture(after_s=asked_s + 1000.0, timeout_s=0.5)
        assert asked_s + 0.5 <= rig.clock.now_s() < asked_s + 500.0

    def test_it_is_closed_any_number_of_times_and_opened_again(self, rig: Rig, show: Show) -> None:
        for _ in range(3):
            rig.camera.close()
        with pytest.raises(DeviceLost, match="closed"):
            rig.camera.capture(after_s=0.0, timeout_s=5.0)
        with pytest.raises(DeviceLost, match="closed"):
            rig.camera.set_exposure(0.04)
        for _ in range(2):
            rig.camera.open()
        rig.camera.set_exposure(0.04)
        assert rig.camera.capture(after_s=show("white"), timeout_s=5.0).pixels.shape == rig.camera.shape

    def test_a_frame_keeps_its_pixels_when_others_follow(self, rig: Rig, show: Show) -> None:
        first = rig.camera.capture(after_s=show("white"), timeout_s=5.0)
        before = first.pixels.copy()
        for name in ("black", "level-128"):
            rig.camera.capture(after_s=show(name), timeout_s=5.0)
        np.testing.assert_array_equal(first.pixels, before)

    def test_opened_again_it_takes_the_same_exposure_and_counts_up(self, rig: Rig, show: Show) -> None:
        chosen_s = rig.camera.set_exposure(0.04)
        rig.camera.capture(after_s=show("white"), timeout_s=5.0)
        rig.camera.close()
        rig.camera.open()
        assert rig.camera.set_exposure(chosen_s) == chosen_s
        settled_s = show("white")
        frames = [rig.camera.capture(after_s=settled_s, timeout_s=5.0) for _ in range(2)]
        assert frames[0].exposure_s == frames[1].exposure_s == chosen_s
        assert frames[0].started_s >= settled_s
        assert frames[1].sequence > frames[0].sequence

    def test_a_gain_brightens_the_picture_is_told_as_it_is_and_gone_when_it_was_closed(
        self, rig: Rig, show: Show
    ) -> None:
        control = gain_control_of(rig.camera)
        assert (control is not None) == (rig.profile.camera.driver in AMPLIFYING)
        if control is None:
            with pytest.raises(SettingRefused, match="has no gain"):
                rig.set_gain(1.0)
            return
        before = control.now()
        assert before.least <= before.value < before.most
        usual_s = rig.camera.set_exposure(0.04)
        rig.camera.set_exposure(rig.camera.exposure_range_s[0])
        dim = rig.camera.capture(after_s=show("white"), timeout_s=5.0)
        after = rig.set_gain(before.value + 0.2 * (before.most - before.value))
        assert after == control.now()
        assert f"{after.value:g}" in control.profile_lines() or rig.profile.camera.driver == "simulated"
        bright = rig.camera.capture(after_s=rig.clock.now_s(), timeout_s=5.0)
        if rig.profile.camera.device_id not in IGNORING:
            assert bright.pixels.mean() > 1.02 * dim.pixels.mean()
        for value in (before.least - 1, before.most + 1, float("nan")):
            with pytest.raises(SettingRefused, match="outside"):
                rig.set_gain(value)
        rig.camera.close()
        assert gain_control_of(rig.camera) is None
        rig.camera.open()
        again = gain_control_of(rig.camera)
        assert again is not None
        assert again.now() == before
        assert rig.camera.set_exposure(usual_s) == usual_s

    def test_a_frame_says_how_many_were_lost_before_it(self, rig: Rig, show: Show) -> None:
        assert rig.camera.capture(after_s=show("white"), timeout_s=5.0).lost >= 0
