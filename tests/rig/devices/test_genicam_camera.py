"""A GigE camera over loopback: what it is told it does, and each fault is named with its remedy."""

import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.capture.rig import open_rig
from rig.devices.clock import SystemClock
from rig.devices.genicam import aravis, find
from rig.devices.genicam.camera import GenicamCamera, from_profile
from rig.devices.genicam.describe import describe_genicam
from rig.devices.genicam.find import list_genicam, why_silent
from rig.devices.genicam.setup import transport_advice
from rig.devices.genicam.stream import StreamCounters
from rig.errors import CaptureTimeout, DeviceBusy, DeviceError, DeviceLost, ProfileError, SettingRefused
from rig.profile.schema import Profile
from tests.gige import GigeRig, gige_rig, needs_aravis, plugged

pytestmark = needs_aravis


@pytest.fixture(scope="module")
def built() -> GigeRig:
    return gige_rig()


@pytest.fixture
def gige(built: GigeRig) -> Iterator[GigeRig]:
    with plugged(built) as found:
        yield found
        found.camera.lose_packets(0.0)


def camera_of(profile: Profile, **changes: object) -> GenicamCamera:
    return from_profile(profile.camera.model_copy(update=changes), SystemClock())


def mean_of(camera: GenicamCamera) -> float:
    frame = camera.capture(after_s=SystemClock().now_s(), timeout_s=5.0)
    return float(frame.pixels.mean())


def test_it_is_listed_and_opened_by_serial_number(gige: GigeRig) -> None:
    assert ("gige-EMULATED1", "127.0.0.1") in [(one.device_id, one.address) for one in list_genicam()]
    camera = camera_of(gige.profile, device_id="gige-EMULATED1")
    camera.open()
    assert camera.set_exposure(0.002) == pytest.approx(0.002)
    camera.close()


def test_black_level_and_format_are_what_the_profile_says(gige: GigeRig) -> None:
    def level(**changes: object) -> float:
        camera = camera_of(gige.profile, **changes)
        camera.open()
        camera.set_exposure(0.001)
        found = mean_of(camera)
        camera.close()
        return found

    plain = level(options={"features": {"BlackLevel": 0.0}})
    raised = level(options={"features": {"BlackLevel": 20.0}})
    assert raised - plain == pytest.approx(20 * 4095 / 255, rel=0.05)
    plain = level(options={"features": {"BlackLevel": 0.0}})
    assert level(pixel_format="Mono12Packed") == pytest.approx(plain, rel=0.02)
    assert level(options={"trigger": "free"}) == pytest.approx(plain, rel=0.02)


def test_frames_that_run_freely_are_fresh(gige: GigeRig) -> None:
    camera, clock = camera_of(gige.profile, options={"trigger": "free"}), SystemClock()
    camera.open()
    camera.set_exposure(0.005)
    after_s = clock.now_s() + 0.2
    frames = [camera.capture(after_s=after_s, timeout_s=5.0) for _ in range(3)]
    assert all(frame.started_s >= after_s for frame in frames)
    assert frames[2].sequence > frames[1].sequence > frames[0].sequence
    camera.close()


def test_frames_come_with_the_pulses_of_a_wire_and_a_cut_wire_is_named(gige: GigeRig) -> None:
    camera, clock = camera_of(gige.profile, options={"trigger": "line"}), SystemClock()
    camera.open()
    camera.set_exposure(0.002)
    after_s = clock.now_s() + 0.1
    frames = [camera.capture(after_s=after_s, timeout_s=5.0) for _ in range(3)]
    assert all(frame.started_s >= after_s for frame in frames)
    gige.camera.faults.wire_is_cut = True
    try:
        camera.close()
        camera.open()
        with pytest.raises(CaptureTimeout, match="no pulse came on Line0"):
            camera.capture(after_s=0.0, timeout_s=0.2)
    finally:
        gige.camera.faults.wire_is_cut = False
        camera.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pixel_format": "Mono14"}, "not understood"),
        ({"pixel_format": "RGB8"}, "channels"),
        ({"width_px": 640}, "Width"),
        ({"options": {"features": {"Sharpness": 3}}}, "no feature 'Sharpness'"),
        ({"options": {"trigger": "line", "line": "Line7"}}, "it offers Line0, Software"),
        ({"exposure_range_s": (1e-4, 20.0)}, "outside what"),
    ],
)
def test_what_it_cannot_do_is_refused_with_what_it_can(gige: GigeRig, changes: dict[str, object], message: str) -> None:
    camera = camera_of(gige.profile, **changes)
    with pytest.raises(SettingRefused, match=message):
        camera.open()
    camera.close()


def test_options_and_filters_that_make_no_sense_are_refused_before_anything_is_opened(built: GigeRig) -> None:
    with pytest.raises(ProfileError, match=r"camera\.options\.trigger"):
        camera_of(built.profile, options={"trigger": "whistle"})
    with pytest.raises(ProfileError, match=r"camera\.mosaic"):
        camera_of(built.profile, mosaic="RGGB", channels=3)


def test_a_camera_that_another_program_has_is_busy(gige: GigeRig) -> None:
    first, second = camera_of(gige.profile), camera_of(gige.profile)
    first.open()
    with pytest.raises(DeviceBusy, match="another program"):
        second.open()
    first.close()


def test_lost_packets_cost_frames_but_no_frame_is_wrong(gige: GigeRig) -> None:
    camera = camera_of(gige.profile)
    camera.open()
    camera.set_exposure(0.002)
    whole = mean_of(camera)
    gige.camera.lose_packets(0.01)
    means = [mean_of(camera) for _ in range(4)]
    assert means == pytest.approx([whole] * 4, rel=0.01)
    assert any("frames came incomplete" in line for line in camera.advice())
    gige.camera.lose_packets(1.0)
    with pytest.raises(CaptureTimeout, match="a firewall has to let all UDP"):
        camera.capture(after_s=0.0, timeout_s=0.3)
    camera.close()


def test_a_frame_whose_first_packet_was_lost_spoils_neither_clock_nor_count(gige: GigeRig) -> None:
    """That packet carries time stamps and number; what the buffer held before stands in their place, or nothing."""
    camera, clock = camera_of(gige.profile, options={"trigger": "free"}), SystemClock()
    camera.open()
    camera.set_exposure(0.005)
    gige.camera.lose_packets(0.5)
    with pytest.raises(CaptureTimeout, match="with packets missing"):
        camera.capture(after_s=clock.now_s(), timeout_s=1.5)
    gige.camera.lose_packets(0.0)
    frames = [camera.capture(after_s=clock.now_s(), timeout_s=2.0) for _ in range(2)]
    assert frames[1].lost + frames[0].lost < 100
    assert frames[1].sequence < 200
    camera.close()


def test_a_camera_whose_heartbeats_were_lost_is_lost(gige: GigeRig) -> None:
    camera = camera_of(gige.profile)
    camera.open()
    gige.camera.forget_heartbeat()
    with pytest.raises(DeviceLost, match="not controlled"):
        camera.set_exposure(0.002)
    camera.open()
    assert camera.set_exposure(0.002) == pytest.approx(0.002)
    camera.close()


def test_a_rig_goes_on_after_the_camera_was_away(gige: GigeRig) -> None:
    with open_rig(gige.profile) as rig:
        white = np.full(rig.projector.shape, 255, np.uint8)
        before = rig.shoot(white, name="white", exposure_s=0.004).pixels.mean()
        gige.camera.unplug()
        gige.camera.plug()
        assert rig.shoot(white, name="white", exposure_s=0.006).pixels.mean() > 1.2 * before
        assert [event.kind for event in rig.events if event.kind in ("unplugged", "replugged")][:1] == ["unplugged"]


def test_why_a_camera_is_silent_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert "firewall" in why_silent("127.0.0.1")
    routes = tmp_path / "route"
    routes.write_text(
        "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\neth0\t0002A8C0\t0\t1\t0\t0\t0\t00FFFFFF\n"
    )
    monkeypatch.setattr(find, "_ROUTES", routes)
    assert "firewall" in why_silent("192.168.2.9")
    assert "no subnet" in why_silent("10.1.2.3")

    def unreachable(*_: object) -> None:
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(socket.socket, "connect", unreachable)
    assert "no route" in why_silent("192.168.2.9")


def test_a_camera_that_swallows_every_packet_is_told_with_the_firewall(gige: GigeRig) -> None:
    """A port that is open and says nothing is what a firewall looks like from here."""
    gige.camera.unplug()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", find.CONTROL_PORT))
        with pytest.raises(DeviceLost, match="a firewall has to let UDP port 3956 out"):
            camera_of(gige.profile).open()


def test_a_missing_library_is_named_with_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aravis, "_loaded", lambda: OSError("no such file"))
    with pytest.raises(DeviceError, match=r"apt install libaravis-0\.8-0"):
        aravis.aravis()


def test_small_packets_and_buffers_are_told_with_the_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.devices.genicam.setup.socket_buffer_limit", lambda: 212992)
    fine = StreamCounters(complete=100, failed=0, underruns=0, resent_packets=0, missing_packets=0)
    packets, buffer = transport_advice("192.168.7.9", 1400, fine)
    assert transport_advice("127.0.0.1", 1400, fine) == (buffer.replace("192.168.7.9", "127.0.0.1"),)
    assert "mtu 9000" in packets
    assert "sysctl -w net.core.rmem_max=8388608" in buffer
    assert "7 of 107 frames" in transport_advice("192.168.7.9", 9000, replace(fine, failed=7))[-1]


def test_what_it_can_do_is_asked_of_the_camera(gige: GigeRig) -> None:
    (found,) = list_genicam()
    able = describe_genicam(found)
    assert able.pixel_formats[:2] == ("Mono12", "Mono12p")
    assert (able.width_px, able.height_px) == (320, 240)
    assert able.exposure_range_s == pytest.approx((1e-4, 2.0))
    assert able.frame_rate_hz == pytest.approx(200.0)
