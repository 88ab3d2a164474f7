"""What comes over the wire of a GigE camera: every pixel format byte for byte, and settings that are read back."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.devices.clock import SystemClock
from rig.devices.genicam.camera import GenicamCamera
from rig.devices.genicam.formats import PIXEL_FORMATS
from rig.devices.genicam.settings import GenicamOptions
from rig.emulated.gige.camera import ADDRESS, EmulatedGigeCamera, GigeRequest, encoded
from rig.emulated.gige.description import AUTO_ENTRIES, AUTOMATICS, GAIN, GAMMA, GAMMA_STEPS, EmulatedSensor
from rig.errors import SettingRefused
from tests.gige import gige_rig, needs_aravis, plugged

pytestmark = needs_aravis

WIDTH_PX, HEIGHT_PX, EXPOSURE_S = 36, 10, 1e-3
CLOCK = SystemClock()


@dataclass
class Numbers:
    """Shows other random numbers in each frame, and remembers them."""

    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(19))
    begun: list[tuple[float, NDArray[np.uint16]]] = field(default_factory=list)
    """When the exposure of each frame began."""
    shown: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))

    def expose(self, request: GigeRequest) -> bytes:
        begun_s = CLOCK.now_s()
        CLOCK.wait_until_s(begun_s + request.exposure_s)
        kind = PIXEL_FORMATS[request.pixel_format]
        size = (*request.shape, kind.numbers)
        self.shown = self.random.integers(0, 2**kind.depth, size).astype(np.uint16)
        self.begun = [*self.begun[-99:], (begun_s, self.shown)]
        sent = self.shown[..., ::-1] if request.pixel_format == "BGR8" else self.shown
        return encoded(sent, request.pixel_format)


@pytest.fixture(scope="module")
def view() -> Numbers:
    return Numbers()


@pytest.fixture(scope="module")
def served(view: Numbers) -> Iterator[EmulatedGigeCamera]:
    sensor = EmulatedSensor(
        width_px=WIDTH_PX, height_px=HEIGHT_PX, formats=tuple(PIXEL_FORMATS), exposure_range_s=(1e-4, 1.0)
    )
    rig = gige_rig()
    rig.camera = EmulatedGigeCamera(view, sensor, wait=lambda _: None)
    with plugged(rig):
        yield rig.camera


def camera_of(name: str, **options: object) -> GenicamCamera:
    kind = PIXEL_FORMATS[name]
    return GenicamCamera(
        ADDRESS,
        shape=(HEIGHT_PX, WIDTH_PX, kind.numbers),
        pixel_format=name,
        bit_depth=kind.depth,
        frame_rate_hz=30.0,
        exposure_range_s=(1e-4, 1.0),
        options=GenicamOptions.model_validate(options),
        clock=CLOCK,
    )


@pytest.mark.parametrize("name", PIXEL_FORMATS)
def test_every_format_arrives_as_the_sensor_counted(served: EmulatedGigeCamera, view: Numbers, name: str) -> None:
    camera = camera_of(name)
    camera.open()
    try:
        camera.set_exposure(EXPOSURE_S)
        for _ in range(2):
            frame = camera.capture(after_s=CLOCK.now_s(), timeout_s=5.0)
            np.testing.assert_array_equal(frame.pixels, view.shown)
    finally:
        camera.close()


def test_nothing_is_automatic_and_what_another_program_changes_is_named(served: EmulatedGigeCamera) -> None:
    for address in AUTOMATICS.values():
        served.write_register(address, AUTO_ENTRIES["Continuous"])
    served.write_register(GAIN, 900)
    served.write_register(GAMMA, 2 * GAMMA_STEPS)
    camera = camera_of("Mono12")
    camera.open()
    try:
        assert [served.read_register(address) for address in AUTOMATICS.values()] == [AUTO_ENTRIES["Off"]] * 3
        assert (served.read_register(GAIN), served.read_register(GAMMA)) == (0, GAMMA_STEPS)
        assert camera.set_exposure(EXPOSURE_S) == pytest.approx(EXPOSURE_S)
        served.write_register(AUTOMATICS["ExposureAuto"], AUTO_ENTRIES["Continuous"])
        with pytest.raises(SettingRefused, match="ExposureAuto is not as it was set; close other programs"):
            camera.set_exposure(EXPOSURE_S)
    finally:
        camera.close()


def test_a_triggered_camera_has_no_rate_that_would_make_it_wait(served: EmulatedGigeCamera) -> None:
    for trigger, rate_hz in (("free", 30.0), ("software", 200.0)):
        camera = camera_of("Mono12", trigger=trigger)
        camera.open()
        assert served.frame_rate_hz == pytest.approx(rate_hz, rel=1e-4)
        camera.close()


def test_a_frame_that_runs_freely_never_claims_to_have_begun_later_than_it_did(
    served: EmulatedGigeCamera, view: Numbers
) -> None:
    """Both clocks are this machine's, though they begin elsewhere: the map has to find by how much."""
    camera = camera_of("Mono12", trigger="free")
    camera.open()
    try:
        camera.set_exposure(EXPOSURE_S)
        for _ in range(5):
            frame = camera.capture(after_s=CLOCK.now_s(), timeout_s=5.0)
            begun_s = next(begun_s for begun_s, shown in reversed(view.begun) if np.array_equal(shown, frame.pixels))
            assert begun_s - 0.5 < frame.started_s <= begun_s
    finally:
        camera.close()
