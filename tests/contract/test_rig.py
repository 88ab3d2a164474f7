"""What a rig promises over every back end."""

from collections.abc import Callable
from itertools import cycle, islice

import numpy as np
import pytest

from rig.capture.rig import Rig, open_rig
from rig.devices.protocols import Codes
from rig.errors import DeviceLost, SettingRefused
from rig.profile.schema import Profile

Open = Callable[[], Rig]
Flat = Callable[[Rig, str], Codes]
LEVELS = ("white", "black", "level-128")


class TestPair:
    def test_a_frame_begins_after_the_image_settled(self, open_back_end: Open, flat: Flat) -> None:
        with open_back_end() as rig:
            for name in islice(cycle(["white", "black", "level-128"]), 9):
                asked_s = rig.clock.now_s()
                frame = rig.shoot(flat(rig, name), name=name)
                assert frame.started_s >= asked_s + rig.profile.projector.latency_s

    def test_every_frame_shows_its_own_picture(self, open_back_end: Open, flat: Flat) -> None:
        with open_back_end() as rig:
            levels = {name: rig.shoot(flat(rig, name), name=name).pixels.mean() for name in LEVELS}
            assert levels["black"] < 0.5 * levels["level-128"] < 0.3 * levels["white"]
            for name in islice(cycle(LEVELS), 9):
                frame = rig.shoot(flat(rig, name), name=name)
                assert frame.pixels.mean() == pytest.approx(levels[name], rel=0.02)

    def test_what_the_devices_cannot_do_is_refused_and_changes_nothing(self, open_back_end: Open, flat: Flat) -> None:
        with open_back_end() as rig:
            expected = rig.shoot(flat(rig, "white"), name="white")
            with pytest.raises(SettingRefused, match="shape"):
                rig.shoot(np.zeros((2, 2), np.uint8), name="black")
            with pytest.raises(SettingRefused, match="outside"):
                rig.shoot(flat(rig, "black"), name="black", exposure_s=1e6)
            with pytest.raises(SettingRefused, match="outside"):
                rig.set_exposure(0.0)
            assert rig.shoot(flat(rig, "white"), name="white").exposure_s == expected.exposure_s

    def test_it_is_closed_from_any_state(self, open_back_end: Open, flat: Flat) -> None:
        rig = open_back_end()
        rig.projector.close()
        rig.close()
        rig.close()
        with pytest.raises(DeviceLost, match="closed"):
            rig.shoot(flat(rig, "white"), name="white")
        with rig:
            rig.set_exposure(rig.profile.camera.exposure_s)
            assert rig.shoot(flat(rig, "white"), name="white").pixels.any()

    @pytest.mark.parametrize("device", ["camera", "projector"])
    def test_a_device_that_was_lost_is_opened_again_and_set_as_it_was(
        self, open_back_end: Open, flat: Flat, device: str
    ) -> None:
        """A recording cannot be unplugged: what it does not have stays away."""
        with open_back_end() as rig:
            expected = rig.shoot(flat(rig, "white"), name="white", exposure_s=rig.profile.camera.exposure_s)
            getattr(rig, device).close()
            if rig.profile.camera.driver == "replay":
                with pytest.raises(DeviceLost, match="closed"):
                    rig.shoot(flat(rig, "white"), name="white")
                return
            frame = rig.shoot(flat(rig, "white"), name="white")
            assert frame.exposure_s == expected.exposure_s
            assert frame.pixels.mean() == pytest.approx(expected.pixels.mean(), rel=0.02)
            assert [event.kind for event in rig.events] == ["unplugged", "replugged"]


def test_a_stale_frame_is_never_accepted(simulated: Profile, flat: Flat) -> None:
    text = simulated.raw.decode().replace("stale_frame_rate = 0.0", "stale_frame_rate = 0.4")
    with open_rig(Profile.parse(text.encode(), simulated.path)) as rig:
        means: dict[str, list[float]] = {"white": [], "black": []}
        for name in islice(cycle(means), 40):
            means[name].append(float(rig.shoot(flat(rig, name), name=name).pixels.mean()))
        assert sum(event.kind == "stale" for event in rig.events) > 10
    assert max(means["black"]) < 0.2 * min(means["white"])


def test_a_frame_that_is_not_waited_for_would_show_the_old_picture(simulated: Profile, flat: Flat) -> None:
    """The twin has the fault that the rig protects from: without the latency, black is still white."""
    projector = simulated.projector.model_copy(update={"latency_s": 0.0})
    with open_rig(simulated.with_device(projector)) as rig:
        white = rig.shoot(flat(rig, "white"), name="white")
        for _ in range(4):
            white = rig.shoot(flat(rig, "white"), name="white")
        black = rig.shoot(flat(rig, "black"), name="black")
    assert black.pixels.mean() > 0.5 * white.pixels.mean()
