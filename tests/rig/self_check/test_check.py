"""Every number of `rig check` on a good rig against the simulated world's truth; latency; the command."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from rig.cli.app import run_command
from rig.errors import CalibrationFailed, UsageError
from rig.profile.schema import Profile
from rig.self_check import PARTS, run_check
from rig.self_check.parts.exposure import mismatch
from rig.self_check.parts.flicker import aliased_hz, named, spectrum_of
from rig.terminal import silent
from tests.rig.self_check.rig_with_faults import (
    REFRESH_S,
    ROOT,
    TINY,
    Capture,
    Checked,
)

# A good rig


@pytest.fixture(scope="module")
def good() -> Checked:
    return Checked()


def test_a_good_rig_passes_every_row(good: Checked) -> None:
    assert good.failed == set()
    assert good.result.within_limits
    assert {part for part, _ in good.result.rows} == {*PARTS, "frames"}


def test_the_whole_check_takes_less_than_ninety_seconds_of_a_camera_of_30_hz(good: Checked) -> None:
    assert 10 < good.result.device_s < 90


def test_every_row_with_a_limit_says_what_to_do_when_it_fails(good: Checked) -> None:
    assert [row.what for _, row in good.result.rows if row.limit is not None and not row.advice] == []


def test_latency_is_that_of_the_simulated_world(good: Checked) -> None:
    truth, latency = good.projector.delays_s, good.numbers("latency")
    assert len(truth) == latency["trials"] == 40
    used = [truth[trial] for trial in latency["used"]]
    for name, value in (("min", min(truth)), ("median", np.median(truth)), ("max", max(truth))):
        assert latency[name] == pytest.approx(value, abs=REFRESH_S / 20), name
    assert np.abs(np.array(latency["values_s"]) - used).max() < REFRESH_S / 10
    assert latency["sd"] == pytest.approx(np.std(truth, ddof=1), rel=0.1)


def test_the_sensor_is_that_of_the_simulated_world(good: Checked) -> None:
    noise = good.numbers("noise")
    assert noise["gain_e_per_dn"] == pytest.approx(32000 / (4095 - 64), rel=0.03)
    assert noise["read_noise_e"] == pytest.approx(6.0, rel=0.05)
    assert noise["full_well_e"] == pytest.approx(32000, rel=0.05)
    assert abs(noise["gain_e_per_dn"] - 32000 / (4095 - 64)) < 3 * noise["gain_95_percent"]
    assert abs(noise["read_noise_e"] - 6.0) < 2 * noise["read_noise_95_percent_e"]


def test_the_suggested_values_are_those_of_the_simulated_world_and_make_a_valid_profile(good: Checked) -> None:
    suggested = good.result.suggested
    assert max(good.projector.delays_s) < suggested["projector.latency_s"] < max(good.projector.delays_s) + REFRESH_S
    assert suggested["camera.full_well_e"] == pytest.approx(32000, rel=0.05)
    refreshes = suggested["camera.exposure_s"] * 60
    assert refreshes == pytest.approx(round(refreshes), abs=0.01)
    text = TINY.replace("latency_s = 0.06 ", f"latency_s = {suggested['projector.latency_s']} ")
    assert Profile.parse(text.encode(), ROOT / "hw_profiles" / "pasted.toml").projector.latency_s < 0.06


def test_dark_level_clip_level_and_noise_are_those_of_the_simulated_world(good: Checked) -> None:
    assert good.numbers("linearity")["dark_level_dn"] == pytest.approx(64, abs=0.1)
    assert good.numbers("saturation") == {"clip_dn": 4095, "step_dn": 1}
    assert good.numbers("pixels")["hot"] == 0
    assert good.numbers("pixels")["dead"] == 0


def test_a_still_picture_stands_still(good: Checked) -> None:
    assert good.row("vibration").value < 0.005
    assert good.row("shift of the picture").value < 0.005
    assert good.row("drift of white").value < 0.02
    assert good.row("flicker of white from frame to frame").value < 0.02


# Latency


@pytest.mark.parametrize("promised_s", [0.0, 0.4])
def test_the_profiles_own_latency_does_not_matter(promised_s: float) -> None:
    checked = Checked(("latency_s = 0.06 ", f"latency_s = {promised_s} "), only=["latency"])
    assert checked.numbers("latency")["max"] == pytest.approx(max(checked.projector.delays_s), abs=1e-3)
    assert checked.failed == ({"latency"} if promised_s == 0 else set())


@pytest.mark.parametrize("frame_rate_hz", [8.0, 25.0, 59.0, 60.0, 144.0])
def test_latency_with_a_camera_slower_or_faster_than_the_display(frame_rate_hz: float) -> None:
    checked = Checked(("frame_rate_hz = 30.0", f"frame_rate_hz = {frame_rate_hz}"), only=["latency"])
    latency, truth = checked.numbers("latency"), checked.projector.delays_s
    for name, value in (("min", min(truth)), ("median", np.median(truth)), ("max", max(truth))):
        assert latency[name] == pytest.approx(value, abs=REFRESH_S / 4), name


@pytest.mark.parametrize("latency_s", [0.001, 0.2])
def test_a_very_short_and_a_very_long_latency(latency_s: float) -> None:
    checked = Checked(("latency_s = 0.046\n", f"latency_s = {latency_s}\n"), only=["latency"])
    latency, truth = checked.numbers("latency"), checked.projector.delays_s
    assert latency["median"] == pytest.approx(np.median(truth), abs=REFRESH_S / 4)
    assert latency["max"] == pytest.approx(max(truth), abs=REFRESH_S / 4)


def test_a_strongly_curved_camera_measures_the_same_latency() -> None:
    checked = Checked(("compression = 0.08", "compression = 1.0"), only=["latency"])
    latency = checked.numbers("latency")
    found, truth = np.array(latency["values_s"]), np.array(checked.projector.delays_s)[latency["used"]]
    assert len(found) > 30
    assert np.abs(found - truth).max() < REFRESH_S / 8


def test_a_webcams_curve_and_light_on_black_do_not_hide_the_latency() -> None:
    """Their black is bright in its numbers: a third of a white that fills the exposure."""
    checked = Checked(
        ("compression = 0.08", 'compression = 0.0\ntone = "srgb"'),
        ("ambient = 0.0004", "ambient = 0.03"),
        only=["latency"],
    )
    latency = checked.numbers("latency")
    found, truth = np.array(latency["values_s"]), np.array(checked.projector.delays_s)[latency["used"]]
    assert len(found) > 30
    assert np.abs(found - truth).max() < REFRESH_S / 50


def test_room_light_that_flickers_a_little_leaves_the_latency() -> None:
    flicker = "ambient = 0.05\nambient_flicker_hz = 100.0\nambient_flicker = 0.3"
    checked = Checked(("ambient = 0.0004", flicker), only=["latency"])
    latency = checked.numbers("latency")
    found, truth = np.array(latency["values_s"]), np.array(checked.projector.delays_s)[latency["used"]]
    assert np.abs(found - truth).max() < REFRESH_S / 5


@pytest.mark.parametrize("readout_s", [0.01, 0.03])
def test_a_readout_is_as_long_as_it_is(readout_s: float) -> None:
    checked = Checked(("stale_frame_rate = 0.02", f"stale_frame_rate = 0.0\nreadout_s = {readout_s}"), only=["latency"])
    assert checked.numbers("latency")["readout_s"] == pytest.approx(readout_s, rel=0.02)


def test_a_rolling_shutter_is_found_and_taken_out_of_the_latency() -> None:
    checked = Checked(("stale_frame_rate = 0.02", "stale_frame_rate = 0.0\nreadout_s = 0.02"), only=["latency"])
    latency, truth = checked.numbers("latency"), checked.projector.delays_s
    assert latency["readout_s"] == pytest.approx(0.02, rel=0.02)
    assert latency["median"] == pytest.approx(np.median(truth), abs=REFRESH_S / 4)
    assert latency["max"] == pytest.approx(max(truth), abs=REFRESH_S / 4)


def test_jitter_of_time_stamps_widens_the_distribution_but_does_not_move_it() -> None:
    checked = Checked(
        ("stale_frame_rate = 0.02", "stale_frame_rate = 0.0\ntime_stamp_jitter_s = 0.004"), only=["latency"]
    )
    latency, truth = checked.numbers("latency"), checked.projector.delays_s
    assert latency["median"] == pytest.approx(np.median(truth), abs=REFRESH_S / 8)
    assert latency["sd"] > 1.05 * np.std(truth, ddof=1)


def test_a_display_that_jitters_by_two_refreshes_fails() -> None:
    checked = Checked(("jitter_s = 0.008", "jitter_s = 0.034"), only=["latency"])
    truth = checked.projector.delays_s
    jitter = checked.row("jitter")
    assert jitter.value == pytest.approx((max(truth) - min(truth)) / REFRESH_S, abs=0.2)
    assert not jitter.met


# Small parts


def test_an_exposure_of_whole_refreshes_has_no_ripple() -> None:
    assert mismatch(2 / 60, 60) == pytest.approx(0)
    assert mismatch(0.025, 60) == pytest.approx(1 / 3)
    assert mismatch(0.0167, 60) == pytest.approx(0.002, abs=1e-4)


@pytest.mark.parametrize(
    ("light_hz", "rate_hz", "word"), [(100, 30, "50 Hz mains"), (120, 25, "60 Hz mains"), (60, 25, "refresh")]
)
def test_a_source_is_named_by_where_it_shows(light_hz: float, rate_hz: float, word: str) -> None:
    times_s = np.arange(64) / rate_hz
    spectrum = spectrum_of(times_s, np.sin(2 * np.pi * light_hz * times_s + 0.4))
    assert spectrum.peak_hz == pytest.approx(aliased_hz(light_hz, rate_hz), abs=rate_hz / 64)
    assert word in named(spectrum.peak_hz, rate_hz, 60.0, times_s[-1])[0]


def test_noise_has_no_peak() -> None:
    values = np.random.default_rng(1).normal(size=(200, 64))
    peaks = [spectrum_of(np.arange(64) / 30, row).peak_hz for row in values]
    assert sum(peak is not None for peak in peaks) <= 2


# The command


def test_parts_can_be_chosen(capsys: Capture) -> None:
    assert run_command(["check", "-p", "ci-tiny", "--only", "darkness,exposure", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [row["part"] for row in result["checks"]] == ["exposure"] * 4 + ["darkness"] * 2 + ["frames"]
    assert set(result["numbers"]) == {"exposure", "darkness", "frames"}
    assert list(result["checks"][0]) == [
        "part",
        "what",
        "value",
        "limit",
        "unit",
        "at_least",
        "met",
        "status",
        "advice",
    ]


def test_an_unknown_part_is_named_with_those_that_exist(capsys: Capture) -> None:
    assert run_command(["check", "-p", "ci-tiny", "--only", "latency,colour"]) == 2
    said = capsys.readouterr().err
    assert "no part 'colour'" in said
    assert all(part in said for part in PARTS)


def test_a_replay_cannot_be_checked_and_hears_why(tmp_path: Path) -> None:
    text = TINY[: TINY.index("[simulation]")].replace('driver = "simulated"', 'driver = "replay"')
    path = tmp_path / "replay.toml"
    path.write_text(text + '[replay]\nsession = "nowhere"\n')
    with pytest.raises(UsageError, match=r"no clock, so no latency.*cannot show the pictures"):
        run_check(str(path), silent)


def test_a_failing_check_says_what_to_do_and_gives_lines_to_paste(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "slow.toml"
    path.write_text(TINY.replace("latency_s = 0.046\n", "latency_s = 0.15\n"))
    assert run_command(["check", "-p", str(path), "--only", "latency"]) == 1
    out = capsys.readouterr().out
    assert "OUTSIDE" in out
    assert "give projector.latency_s the value suggested below" in out
    assert re.search(r"\[projector\]\nlatency_s = 0\.16\d*\n", out)


def test_the_page_needs_no_other_file_and_shows_each_chart(good: Checked, tmp_path: Path) -> None:
    from rig.self_check.page import print_check, write_check_page

    page = write_check_page(good.result, tmp_path / "check.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == 6
    assert re.findall(r"(?:src|href)=\"(?!data:)", page) == []
    assert "Photon transfer" in page
    assert "full_well_e" in page
    print_check(good.result)


def test_a_page_that_cannot_be_written_is_an_error_with_its_name(capsys: Capture, tmp_path: Path) -> None:
    target = tmp_path / "none" / "check.html"
    assert run_command(["check", "-p", "ci-tiny", "--only", "darkness", "--report", str(target)]) == 2
    assert str(target) in capsys.readouterr().err


def test_no_light_is_an_error() -> None:
    with pytest.raises(CalibrationFailed, match="no light of the projector reaches the camera"):
        Checked(("flux = 10.0", "flux = 1e-6"), only=["darkness"])
