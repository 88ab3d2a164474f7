"""A new profile holds what the devices say, cites what is public, and marks every guess."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from rig.devices.genicam.describe import GenicamAbilities
from rig.devices.genicam.find import FoundGenicam
from rig.devices.gphoto2.find import FoundStill, StillAbilities
from rig.devices.protocols import ExposureRange
from rig.errors import DeviceError, DeviceForbidden, DeviceLost, ProfileError, SettingRefused, UsageError
from rig.inventory.new_profile import ProfileRequest, write_profile
from rig.inventory.tables import print_new_profile
from rig.profile.schema import load_profile
from tests.rig.inventory.found_devices import (
    EXPOSURE,
    GAIN,
    MONO,
    Abilities,
    Camera,
    Format,
    Mode,
    Monitor,
    Output,
    finders,
)

WEBCAM = Camera("usb-046d:082d-AB12", Path("/dev/video2"), "HD Pro Webcam C920", vendor_id=0x046D, product_id=0x082D)


def test_the_profile_is_complete_and_valid(tmp_path: Path) -> None:
    result = write_profile(ProfileRequest(path=tmp_path / "my lab.toml"), finders())
    profile = load_profile(tmp_path / "my lab.toml")
    camera, projector = profile.camera, profile.projector
    assert profile.name == "my-lab"
    assert (camera.driver, camera.device_id, camera.pixel_format) == ("v4l2", "usb-2bb8:0001-0007", "GREY")
    assert (camera.shape, camera.bit_depth, camera.frame_rate_hz) == ((960, 1280, 1), 8, 45.0)
    assert camera.exposure_range_s == (1e-4, 0.2)
    assert camera.exposure_s == pytest.approx(1 / 60, rel=1e-5)
    assert camera.controls == {"gain": 4, "brightness": 0, "focus_absolute": 35}
    assert (projector.driver, projector.output, projector.shape) == ("kms", "HDMI-A-1", (1080, 1920))
    assert result.camera == "usb-2bb8:0001-0007"


def test_every_number_says_where_it_comes_from(tmp_path: Path) -> None:
    write_profile(ProfileRequest(path=tmp_path / "lab.toml", projector_model="pw800"), finders())
    text = (tmp_path / "lab.toml").read_text(encoding="utf-8")
    written = [line for line in text.splitlines() if not line.startswith("#")]
    numbers = [line for line in written if " = " in line and line.partition(" = ")[2][0] in "[0123456789tf"]
    words = ("device", "cited", "chosen", "MEASURE")
    assert len(numbers) > 12
    assert [line for line in numbers[1:] if not any(f"# {word}" in line for word in words)] == []


def test_what_may_be_measured_of_the_room_has_its_line_and_is_no_guess_until_somebody_takes_it(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    write_profile(ProfileRequest(path=path), finders())
    room = load_profile(path).room
    assert (room.size_m, room.lens_height_m) == (None, None)
    assert room.askew_deg == 0.3, "a real room; a simulated one is square"
    path.write_text(path.read_text("utf-8").replace("# size_m", "size_m").replace("# lens_height_m", "lens_height_m"))
    room = load_profile(path).room
    assert room.size_m == (4.0, 5.0, 2.5)
    assert room.lens_height_m == 1.2


def test_what_is_only_guessed_is_named(tmp_path: Path) -> None:
    result = write_profile(ProfileRequest(path=tmp_path / "lab.toml"), finders())
    assert result.to_measure == (
        "camera.hfov_deg",
        "projector.latency_s",
        "projector.hfov_deg",
        "scale.baseline_m",
        "surface.closed",
    )
    text = (tmp_path / "lab.toml").read_text(encoding="utf-8")
    assert text.count("# MEASURE") == len(result.to_measure)


def test_facts_of_the_models_are_merged_and_quoted(tmp_path: Path) -> None:
    able = Abilities((Format("YUYV", 1920, 1080, (30.0,)),), (EXPOSURE,))
    parts = finders(cameras=lambda: (WEBCAM,), describe=lambda node: able)
    result = write_profile(ProfileRequest(path=tmp_path / "lab.toml", projector_model="LG PW800"), parts)
    profile, text = load_profile(tmp_path / "lab.toml"), (tmp_path / "lab.toml").read_text(encoding="utf-8")
    assert result.facts == ("Logitech C920", "LG PW800")
    assert profile.description == "Logitech C920 with LG PW800"
    assert profile.camera.hfov_deg == pytest.approx(70.4)
    assert "Diagonal FOV of 78°" in text
    assert (profile.projector.width_px, profile.projector.refresh_rate_hz) == (1280, 59.81)
    assert profile.projector.hfov_deg == pytest.approx(26.8)


def test_a_camera_model_by_name_goes_before_usb_ids(tmp_path: Path) -> None:
    result = write_profile(
        ProfileRequest(path=tmp_path / "lab.toml", camera_model="ocam 1mgn"), finders(cameras=lambda: (WEBCAM,))
    )
    assert result.facts == ("Withrobot oCam-1MGN-U",)


def test_a_native_size_that_the_output_does_not_offer_is_to_be_measured(tmp_path: Path) -> None:
    output = Output(modes=(Mode(1024, 768, 60.0, True),))
    parts = finders(outputs=lambda: (output,))
    result = write_profile(ProfileRequest(path=tmp_path / "lab.toml", projector_model="pw800"), parts)
    assert {"projector.width_px", "projector.height_px"} <= set(result.to_measure)
    assert load_profile(tmp_path / "lab.toml").projector.shape == (768, 1024)


def test_what_nobody_can_be_asked_is_guessed_and_said(tmp_path: Path) -> None:
    able = Abilities((Format("Y16 ", 640, 480, ()),), (GAIN,))
    output = Output(modes=(Mode(800, 600, None, False),))
    parts = finders(describe=lambda node: able, outputs=lambda: (output,))
    result = write_profile(ProfileRequest(path=tmp_path / "lab.toml"), parts)
    guessed = {"camera.bit_depth", "camera.frame_rate_hz", "camera.exposure_range_s", "projector.refresh_rate_hz"}
    assert guessed <= set(result.to_measure)
    assert load_profile(tmp_path / "lab.toml").camera.bit_depth == 16


def test_on_a_desktop_the_projector_is_a_window(tmp_path: Path) -> None:
    result = write_profile(ProfileRequest(path=tmp_path / "lab.toml"), finders(monitors=lambda: (Monitor(),)))
    projector = load_profile(tmp_path / "lab.toml").projector
    assert (result.driver, projector.driver, projector.output) == ("window", "window", "HDMI-1")
    assert (projector.shape, projector.refresh_rate_hz) == ((800, 1280), 60.0)


def test_a_desktop_that_does_not_answer_counts_only_where_no_card_is_free(tmp_path: Path) -> None:
    def fail() -> None:
        raise DeviceError("no desktop answers; install procam-rig[window]")

    assert write_profile(ProfileRequest(path=tmp_path / "free.toml"), finders(monitors=fail)).driver == "kms"
    with pytest.raises(DeviceError, match="no desktop answers"):
        write_profile(
            ProfileRequest(path=tmp_path / "held.toml"), finders(monitors=fail, master_is_free=lambda card: False)
        )


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text("precious", encoding="utf-8")
    with pytest.raises(UsageError, match=r"lab\.toml is there already; give another name, or --force"):
        write_profile(ProfileRequest(path=path), finders())
    assert path.read_text(encoding="utf-8") == "precious"
    write_profile(ProfileRequest(path=path, force=True), finders())
    assert tomllib.loads(path.read_text(encoding="utf-8"))["schema"] == 2


def test_two_cameras_are_refused_with_their_ids_and_one_can_be_chosen(tmp_path: Path) -> None:
    parts = finders(cameras=lambda: (Camera(), WEBCAM))
    with pytest.raises(UsageError, match=r"choose with --camera: usb-2bb8:0001-0007 = .*usb-046d:082d-AB12"):
        write_profile(ProfileRequest(path=tmp_path / "lab.toml"), parts)
    assert list(tmp_path.iterdir()) == []
    result = write_profile(ProfileRequest(path=tmp_path / "lab.toml", camera="usb-046d:082d-AB12"), parts)
    assert result.camera == "usb-046d:082d-AB12"


@pytest.mark.parametrize("name", ["DP-1", "card0:DP-1", "edid:BNQ-TH671-2"])
def test_two_projectors_are_refused_and_one_can_be_chosen(tmp_path: Path, name: str) -> None:
    parts = finders(outputs=lambda: (Output(), Output("DP-1", edid_id="BNQ-TH671-2"), Output("DP-2", status="unknown")))
    with pytest.raises(UsageError, match=r"2 of them could be the output.*HDMI-A-1.*DP-1"):
        write_profile(ProfileRequest(path=tmp_path / "lab.toml"), parts)
    assert write_profile(ProfileRequest(path=tmp_path / "lab.toml", output=name), parts).output == "DP-1"


def test_a_name_of_nothing_is_refused_with_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"--camera webcam is none of them; there are: usb-2bb8:0001-0007"):
        write_profile(ProfileRequest(path=tmp_path / "lab.toml", camera="webcam"), finders())
    with pytest.raises(ProfileError, match=r"'beamer 9': no facts are known"):
        write_profile(ProfileRequest(path=tmp_path / "lab.toml", projector_model="beamer 9"), finders())


def test_no_camera_no_display_and_no_usable_format_are_device_errors(tmp_path: Path) -> None:
    request = ProfileRequest(path=tmp_path / "lab.toml")
    with pytest.raises(DeviceLost, match="there is no camera"):
        write_profile(request, finders(cameras=lambda: ()))
    with pytest.raises(DeviceLost, match="no display output is connected"):
        write_profile(request, finders(outputs=lambda: (Output(status="disconnected"),)))
    with pytest.raises(DeviceLost, match="HDMI-A-1 offers no mode"):
        write_profile(request, finders(outputs=lambda: (Output(modes=()),)))
    h264 = Abilities((Format("H264", 640, 480, (30.0,)),), ())
    with pytest.raises(SettingRefused, match=r"none of its pixel formats can be used \(H264\)"):
        write_profile(request, finders(describe=lambda node: h264))
    assert list(tmp_path.iterdir()) == []


def test_a_camera_that_may_not_be_opened_says_so(tmp_path: Path) -> None:
    def refuse(node: Path) -> Abilities:
        raise DeviceForbidden(f"{node}: you may not open it")

    with pytest.raises(DeviceForbidden, match="you may not open it"):
        write_profile(ProfileRequest(path=tmp_path / "lab.toml"), finders(describe=refuse))


def test_odd_names_of_devices_are_written_safely(tmp_path: Path) -> None:
    odd = Camera('usb-1:"2"\\3', name='Cam "X"\n# [room]')
    write_profile(
        ProfileRequest(path=tmp_path / "lab.toml", name="x"),
        finders(cameras=lambda: (odd,), describe=lambda node: MONO),
    )
    profile = load_profile(tmp_path / "lab.toml")
    assert profile.camera.device_id == 'usb-1:"2"\\3'
    assert profile.description.startswith('Cam "X"')


def test_people_are_told_what_to_do_next(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    print_new_profile(write_profile(ProfileRequest(path=tmp_path / "lab.toml"), finders()))
    said = capsys.readouterr().out
    assert "only guessed, to be measured:" in said
    assert "  scale.baseline_m" in said
    assert f"then: rig check -p {tmp_path / 'lab.toml'}" in said


@pytest.mark.parametrize(
    ("formats", "channels", "mosaic"), [(("Mono12", "Mono8"), 1, None), (("BayerRG12", "RGB8"), 3, "RGGB")]
)
def test_a_gige_camera_gets_a_profile(
    tmp_path: Path, formats: tuple[str, ...], channels: int, mosaic: str | None
) -> None:
    found = FoundGenicam(
        device_id="gige-77", vendor="V", model="M", serial="77", address="10.0.0.7", aravis_id="V-M-77"
    )
    able = GenicamAbilities(
        pixel_formats=formats,
        width_px=1280,
        height_px=960,
        frame_rate_hz=120.0,
        exposure_range_s=ExposureRange(2e-5, 10.0),
    )
    there = finders(cameras=lambda: (), genicam=lambda: (found,), describe_genicam=lambda one: able)
    path = tmp_path / "lab.toml"
    assert write_profile(ProfileRequest(path=path), there).camera == "gige-77"
    camera = load_profile(path).camera
    assert (camera.driver, camera.pixel_format, camera.bit_depth) == ("genicam", formats[0], 12)
    assert (camera.channels, camera.mosaic, camera.frame_rate_hz) == (channels, mosaic, 60.0)


@pytest.mark.parametrize(("has_raw", "form", "mosaic", "depth"), [(True, "RAW", "RGGB", 14), (False, "JPEG", None, 8)])
def test_a_still_camera_gets_a_profile_by_its_serial_number(
    tmp_path: Path, has_raw: bool, form: str, mosaic: str | None, depth: int
) -> None:
    able = StillAbilities(serial="6012345", has_raw=has_raw, exposure_range_s=ExposureRange(2.5e-4, 30.0))
    there = finders(
        cameras=lambda: (),
        stills=lambda: (FoundStill("Nikon DSC D750", "usb:001,004"),),
        describe_still=lambda one: able,
    )
    path = tmp_path / "lab.toml"
    written = write_profile(ProfileRequest(path=path), there)
    assert (written.camera, written.facts) == ("6012345", ("Nikon D750",))
    assert {"camera.width_px", "camera.height_px"} <= set(written.to_measure)
    camera = load_profile(path).camera
    assert (camera.driver, camera.pixel_format, camera.mosaic, camera.bit_depth) == ("gphoto2", form, mosaic, depth)
    assert camera.exposure_range_s == (2.5e-4, 30.0)


def test_a_still_camera_that_says_nothing_is_guessed_by_its_port(tmp_path: Path) -> None:
    there = finders(
        cameras=lambda: (),
        stills=lambda: (FoundStill("PTP Camera", "usb:001,009"),),
        describe_still=lambda one: StillAbilities(serial=None, has_raw=True, exposure_range_s=None),
    )
    written = write_profile(ProfileRequest(path=tmp_path / "lab.toml"), there)
    assert (written.camera, written.facts) == ("usb:001,009", ())
    assert "camera.exposure_range_s" in written.to_measure
