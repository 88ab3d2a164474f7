"""The first two steps of a session with a webcam's tone curve, held against the simulated world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.radiometry.response import light_of_levels
from rig.capture.rig import open_rig
from rig.devices.simulated.devices import toned
from rig.profile.schema import Profile
from rig.run.steps import ShootingStep, steps_of
from rig.session import Session
from rig.stages.linear_light import RadiometricCalibration
from rig.stages.radiometry import load_radiometric_calibration
from rig.terminal import silent

PROFILE = Path(__file__).parents[3] / "hw_profiles" / "ci-tiny.toml"


def changed(*changes: tuple[str, str]) -> Profile:
    text = PROFILE.read_text(encoding="utf-8").replace("cell_size_m = 0.2", "cell_size_m = 0.6")
    for old, new in (("bit_depth = 12", "bit_depth = 8"), ("black_level_dn = 64.0", "black_level_dn = 4.0"), *changes):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return Profile.parse(text.encode(), PROFILE)


def calibrated(profile: Profile, folder: Path) -> RadiometricCalibration:
    with open_rig(profile) as rig, Session.open(folder, profile) as session:
        for definition in steps_of("calibrate", profile)[:2]:
            assert isinstance(definition, ShootingStep)
            step = session.step(definition.name, settings=definition.settings(session), needs=definition.needs)
            definition.shoot(rig, session, step, silent)
            step.finish()
        return load_radiometric_calibration(session)


@pytest.mark.parametrize("tone", ["srgb", 2.2])
def test_light_of_a_webcam_is_that_of_the_simulated_world(tone: str | float, tmp_path: Path) -> None:
    written = f'"{tone}"' if isinstance(tone, str) else str(tone)
    found = calibrated(changed(("compression = 0.08", f"compression = 0.0\ntone = {written}")), tmp_path / "session")
    light = np.linspace(0.02, 0.8, 30)
    levels = 4 + 251 * toned(light.astype(np.float32), tone).astype(float) - found.offset_dn
    measured = light_of_levels(found.camera, levels)
    unit = (measured @ light) / (light @ light)
    assert unit == pytest.approx(1, abs=0.015)
    assert measured / unit == pytest.approx(light, abs=0.004)
    assert found.gain_e_per_dn == pytest.approx(32000 / 251, rel=0.06)
    x = np.arange(256) / 255
    shown = 0.75 * x**2.2 + 0.25 * x * x * (3 - 2 * x)
    assert np.interp(np.arange(256), found.projector[0].levels, found.projector[0].linear) == pytest.approx(
        shown, abs=0.006
    )


def test_the_variance_of_light_follows_the_slope_of_the_curve(tmp_path: Path) -> None:
    found = calibrated(changed(("compression = 0.08", "compression = 0.0\ntone = 2.2")), tmp_path / "session")
    light = np.array([0.05, 0.8])
    sensor = light / 32000 + (6 / 32000) ** 2
    rounding = (2.2 * light ** (1 - 1 / 2.2) / 251) ** 2 / 12
    assert found.noise(light) == pytest.approx(sensor + rounding, rel=0.15)


def test_a_sweep_stays_within_what_the_camera_can(tmp_path: Path) -> None:
    short = changed(("exposure_range_s = [1.0e-4, 2.0]", "exposure_range_s = [4.0e-3, 2.0]"))
    found = calibrated(short, tmp_path / "session")
    assert found.gain_e_per_dn == pytest.approx(32000 / 251, rel=0.1)


def ripple_light(found: RadiometricCalibration) -> float:
    """Largest change of the light on black from frame to frame, share of full scale."""
    return max(ripple * float(found.black[exposure_s].mean()) for exposure_s, ripple in found.black_ripple.items())


def test_room_light_that_flickers_is_in_the_variance(tmp_path: Path) -> None:
    """Of a lamp that is not on the mains: no exposure is blind to it."""
    still = calibrated(changed(), tmp_path / "still")
    lamps = ("ambient = 0.0004", "ambient = 0.05\nambient_flicker = 0.3\nambient_flicker_hz = 77.0")
    flickering = calibrated(changed(lamps), tmp_path / "flickering")
    assert ripple_light(still) < 1e-4
    assert ripple_light(flickering) > 3e-4


def test_the_exposure_holds_whole_periods_of_room_light_that_flickers(tmp_path: Path) -> None:
    """Of 100 Hz; what is left of the swell is then below that of the same rig with still room light."""
    lamps = ("ambient = 0.0004", "ambient = 0.05\nambient_flicker = 0.3\nambient_flicker_hz = 100.0")
    found = calibrated(changed(lamps), tmp_path / "flickering")
    periods = found.reference_exposure_s * 100
    assert periods == pytest.approx(round(periods), abs=1e-6)
    assert round(periods) >= 1
    assert ripple_light(found) < 1e-4
