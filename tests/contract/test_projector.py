"""What every projector has to do."""

from collections.abc import Callable

import numpy as np
import pytest

from rig.capture.rig import Rig
from rig.devices.protocols import Codes, Projector, Watched
from rig.errors import DeviceLost, SettingRefused

Flat = Callable[[Rig, str], Codes]


class TestProjector:
    def test_it_has_the_whole_protocol(self, rig: Rig) -> None:
        assert isinstance(rig.projector, Projector)
        assert rig.projector.shape == rig.profile.projector.shape

    def test_it_says_what_was_shown_and_when(self, rig: Rig, flat: Flat) -> None:
        before_s = rig.clock.now_s()
        shown = rig.projector.show(flat(rig, "white"), name="white")
        assert shown.name == "white"
        assert before_s <= shown.on_screen_s <= rig.clock.now_s()

    @pytest.mark.parametrize("dtype", [np.float32, np.uint16, np.bool_])
    def test_only_bytes_are_shown(self, rig: Rig, dtype: type) -> None:
        with pytest.raises(SettingRefused, match="uint8"):
            rig.projector.show(np.zeros(rig.projector.shape, dtype), name="white")  # type: ignore[arg-type]

    def test_only_its_own_shape_is_shown(self, rig: Rig) -> None:
        height, width = rig.projector.shape
        for shape in [
            (width, height),
            (height, width - 1),
            (height, width, 4),
            (height,),
            (1, height, width),
        ]:
            with pytest.raises(SettingRefused, match="shape"):
                rig.projector.show(np.zeros(shape, np.uint8), name="white")

    def test_colour_codes_are_shown(self, rig: Rig) -> None:
        assert rig.projector.show(np.zeros((*rig.projector.shape, 3), np.uint8), name="black").name == "black"

    def test_codes_may_be_changed_after_they_were_shown(self, rig: Rig, flat: Flat) -> None:
        codes = flat(rig, "white")
        settled_s = rig.projector.show(codes, name="white").on_screen_s + rig.profile.projector.latency_s
        before = rig.camera.capture(after_s=settled_s, timeout_s=5.0).pixels.mean()
        codes[:] = 0
        after = rig.camera.capture(after_s=settled_s, timeout_s=5.0).pixels.mean()
        assert after == pytest.approx(before, rel=0.02)

    def test_it_is_closed_any_number_of_times_and_opened_again(self, rig: Rig, flat: Flat) -> None:
        for _ in range(3):
            rig.projector.close()
        with pytest.raises(DeviceLost, match="closed"):
            rig.projector.show(flat(rig, "white"), name="white")
        for _ in range(2):
            rig.projector.open()
        assert rig.projector.show(flat(rig, "white"), name="white").name == "white"

    def test_one_that_notices_that_its_picture_is_gone_says_so_only_then(self, rig: Rig, flat: Flat) -> None:
        if not isinstance(rig.projector, Watched):
            return
        rig.projector.show(flat(rig, "white"), name="white")
        rig.projector.check_on_screen()
        rig.projector.close()
        with pytest.raises(DeviceLost):
            rig.projector.check_on_screen()
