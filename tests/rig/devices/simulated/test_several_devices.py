"""Several cameras and projectors, by name, in one simulated world."""

from __future__ import annotations

import numpy as np
import pytest

from rig.devices.clock import VirtualClock
from rig.devices.driver_settings import Devices
from rig.devices.simulated.rigs import from_profile
from rig.profile.schema import Profile

NAMES = {"camera": ("left", "right"), "projector": ("front", "side")}


def doubled(profile: Profile, **changes: object) -> Profile:
    """The tiny rig twice over; the second camera and projector stand elsewhere."""
    assert profile.simulation is not None
    simulation = profile.simulation
    places = {"left": (0.60, 1.42, 1.38), "right": (1.3, 0.7, 1.5), "front": (1.0, 1.0, 1.2), "side": (0.7, 1.8, 1.0)}

    def twice(kind: str, device: object) -> tuple[object, ...]:
        return tuple(
            device.model_copy(update={"name": name, "position_m": places[name]} if seen else {"name": name})  # type: ignore[attr-defined]
            for name, seen in ((name, hasattr(device, "position_m")) for name in NAMES[kind])
        )

    return profile.model_copy(
        update={
            "cameras": twice("camera", profile.camera),
            "projectors": twice("projector", profile.projector),
            "simulation": simulation.model_copy(
                update={
                    "cameras": twice("camera", simulation.camera.model_copy(update={"stale_frame_rate": 0.0})),
                    "projectors": twice("projector", simulation.projector),
                    **changes,
                }
            ),
        }
    )


def photograph(devices: Devices, camera: str, codes: dict[str, int]) -> np.ndarray:
    for name, projector in devices.projectors.items():
        projector.open()
        projector.show(np.full(projector.shape, codes.get(name, 0), np.uint8), name=f"{codes.get(name, 0)}")
    eye = devices.cameras[camera]
    eye.open()
    eye.set_exposure(0.02)
    frame = eye.capture(after_s=devices.clock.now_s() + 0.2, timeout_s=5.0)
    return frame.pixels[..., 0].astype(float) - 64


@pytest.fixture(scope="module", params=["box", "dome"])
def devices(request: pytest.FixtureRequest, tiny_profile: Profile) -> Devices:
    changes: dict[str, object] = {"cell_size_m": 0.4, "pixel_samples": 1, "ambient": 0.01}
    if request.param != "box":
        pytest.importorskip("embreex")
        changes |= {"scene": request.param, "posters": (), "rays": 32}
    return from_profile(doubled(tiny_profile, **changes), VirtualClock())


def test_every_device_of_the_profile_is_there_by_name(devices: Devices) -> None:
    assert tuple(devices.cameras) == NAMES["camera"]
    assert tuple(devices.projectors) == NAMES["projector"]


@pytest.mark.parametrize("camera", NAMES["camera"])
def test_light_of_two_projectors_adds_up_and_room_light_counts_once(devices: Devices, camera: str) -> None:
    dark = photograph(devices, camera, {})
    apart = [photograph(devices, camera, {name: 120}) for name in NAMES["projector"]]
    together = photograph(devices, camera, dict.fromkeys(NAMES["projector"], 120))
    assert dark.mean() > 5  # the room's own light
    gain = together.mean() - apart[1].mean()
    assert gain == pytest.approx(apart[0].mean() - dark.mean(), rel=0.15)  # the response is not quite linear


def test_cameras_see_different_views_with_noise_of_their_own(devices: Devices) -> None:
    left, right = (photograph(devices, name, {"front": 200}) for name in NAMES["camera"])
    assert np.corrcoef(left.ravel(), right.ravel())[0, 1] < 0.98
    noise = [frame - np.median(frame) for frame in (photograph(devices, name, {}) for name in NAMES["camera"])]
    fine = [one[1:, 1:] - one[:-1, :-1] for one in noise]
    assert abs(np.corrcoef(fine[0].ravel(), fine[1].ravel())[0, 1]) < 0.1


def test_each_projector_lights_what_it_looks_at(devices: Devices) -> None:
    one, other = (photograph(devices, "left", {name: 255}) for name in NAMES["projector"])
    assert np.abs(one - other).mean() > 0.02 * one.mean()
