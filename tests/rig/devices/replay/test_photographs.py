"""Manifests of photograph folders: every mistake is named, and no damaged photograph passes."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.devices.replay.photographs import check_photographs, grey, load_manifest, load_photographs, read_photograph
from rig.errors import DeviceLost, ProfileError
from rig.files.exr import write_exr

SHAPE = (24, 32)
TEXT = """
schema = 1

[camera]
width_px = 32
height_px = 24
full_scale_dn = 255

[camera.lens]
focal_px = [40.0, 41.0]
principal_point_px = [20.0, 15.0]
distortion = [0.01, 0.0, 0.0, 0.0, 0.0]

[camera.crop]
left_px = 4
top_px = 3

[projector]
width_px = 8
height_px = 4

[projector.lens]
focal_px = [10.0, 10.0]
principal_point_px = [4.0, 6.0]

[projector_from_camera]
rotation = [1, 0, 0, 0, 1, 0, 0, 0, 1]
translation = [-200.0, 0.0, 50.0]
unit = "mm"

[gray_code]
columns = ["c2.png", "c1.png", "c0.png"]
columns_inverse = ["c2i.png", "c1i.png", "c0i.png"]
rows = ["r1.png", "r0.png"]

[frames]
white = "w.png"
"""
FILES = ("c2", "c1", "c0", "c2i", "c1i", "c0i", "r1", "r0", "w")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)
    for name in FILES:
        cv2.imwrite(str(tmp_path / f"{name}.png"), rng.integers(0, 255, SHAPE, dtype=np.uint8))
    (tmp_path / "replay.toml").write_text(TEXT)
    return tmp_path


def problems(folder: Path, *edits: tuple[str, str]) -> list[str]:
    text = TEXT
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / "edited.toml"
    path.write_text(text)
    with pytest.raises(ProfileError) as caught:
        load_manifest(path)
    return [line.removeprefix(f"{path}: ") for line in str(caught.value).splitlines()]


def test_photographs_are_found_by_the_pattern_they_show(folder: Path) -> None:
    manifest = load_manifest(folder / "replay.toml")
    assert manifest.frames["gray-column-02"] == folder / "c2.png"
    assert manifest.frames["gray-column-00-inverse"] == folder / "c0i.png"
    assert manifest.frames["gray-row-01"] == folder / "r1.png"
    assert manifest.frames["white"] == folder / "w.png"
    assert len(manifest.frames) == len(FILES)
    assert manifest.camera_shape == (24, 32)
    assert manifest.projector_shape == (4, 8)


def test_a_crop_moves_the_principal_point_only(folder: Path) -> None:
    camera = load_manifest(folder / "replay.toml").camera
    assert camera is not None
    assert camera.principal_point_px == (16.0, 12.0)
    assert camera.focal_px == (40.0, 41.0)
    assert (camera.width_px, camera.height_px) == (32, 24)


def test_lengths_become_metres(folder: Path) -> None:
    manifest = load_manifest(folder / "replay.toml")
    assert manifest.unit == "mm"
    assert manifest.projector is not None
    assert manifest.projector.translation_m.tolist() == [-0.2, 0.0, 0.05]
    assert manifest.projector.position_m.tolist() == [0.2, 0.0, -0.05]


def test_lenses_may_be_left_out(folder: Path) -> None:
    text = TEXT[: TEXT.index("[camera.lens]")] + "[projector]\nwidth_px = 8\nheight_px = 4\n"
    (folder / "bare.toml").write_text(text + '[frames]\nwhite = "w.png"\n')
    manifest = load_manifest(folder / "bare.toml")
    assert manifest.camera is None
    assert manifest.projector is None
    assert list(load_photographs(manifest)) == ["white"]


def test_every_mistake_is_reported_at_once(folder: Path) -> None:
    found = problems(
        folder,
        ("width_px = 32", "widht_px = 32"),
        ("full_scale_dn = 255", "full_scale_dn = 255.5"),
        ('unit = "mm"', 'unit = "inch"'),
        ("rotation = [1, 0, 0, ", "rotation = [2, 0, 0, "),
        ('"c2.png", ', ""),
    )
    assert any(line.startswith("camera.widht_px: unknown key; did you mean width_px") for line in found)
    assert any(line.startswith("camera.width_px: missing") for line in found)
    assert any(line.startswith("camera.full_scale_dn") for line in found)
    assert any(line.startswith("projector_from_camera.unit") for line in found)
    assert any("names 2 photographs, projector.width_px = 8 needs 3" in line for line in found)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("rotation = [1, 0, 0, ", "rotation = [2, 0, 0, ", "rotation is none: R·Rᵀ is off the identity by 3"),
        ("rotation = [1, 0, 0, ", "rotation = [-1, 0, 0, ", "determinant -1.000"),
        ('"c2i.png", ', "", "columns_inverse names 2 photographs, columns 3"),
        ('white = "w.png"', 'gray-row-00 = "w.png"', "frames.gray-row-00: belongs into"),
        ('white = "w.png"', '"../white" = "w.png"', "frames"),
        ("schema = 1", "schema = 2", "schema"),
        ("left_px = 4", "left_px = -4", "camera.crop.left_px"),
        ("focal_px = [40.0, 41.0]", "focal_px = 40.0", "camera.lens.focal_px"),
    ],
)
def test_a_mistake_is_named(folder: Path, old: str, new: str, expected: str) -> None:
    assert any(expected in line for line in problems(folder, (old, new)))


def test_a_manifest_without_photographs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "replay.toml"
    path.write_text(TEXT[: TEXT.index("[gray_code]")])
    with pytest.raises(ProfileError, match="name at least one photograph"):
        load_manifest(path)


def test_a_missing_manifest_is_a_profile_error(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="No such file"):
        load_manifest(tmp_path / "nothing.toml")


def test_good_photographs_pass(folder: Path) -> None:
    manifest = load_manifest(folder / "replay.toml")
    check_photographs(manifest)
    frames = load_photographs(manifest)
    assert list(frames) == list(manifest.frames)
    assert all(frame.shape == SHAPE for frame in frames.values())


def test_every_unusable_photograph_is_listed(folder: Path) -> None:
    (folder / "c2.png").unlink()
    whole = (folder / "c1.png").read_bytes()
    (folder / "c1.png").write_bytes(whole[: len(whole) // 2])
    cv2.imwrite(str(folder / "c0.png"), np.zeros((24, 31), dtype=np.uint8))
    (folder / "r0.png").write_text("this is no picture")
    text = TEXT.replace('white = "w.png"', 'white = "c0i.png"')
    (folder / "replay.toml").write_text(text)
    with pytest.raises(DeviceLost) as caught:
        check_photographs(load_manifest(folder / "replay.toml"))
    message = str(caught.value)
    assert "5 of 9 photographs cannot be used" in message
    assert "c2.png: no such file" in message
    assert "c1.png: is damaged" in message
    assert "c0.png: is 31 × 24 px, the manifest's camera 32 × 24 px" in message
    assert "r0.png: cannot be read" in message
    assert "c0i.png: is named for white and for gray-column-00-inverse" in message


def test_values_above_full_scale_are_refused(folder: Path) -> None:
    text = TEXT.replace("full_scale_dn = 255", "full_scale_dn = 100")
    (folder / "replay.toml").write_text(text)
    with pytest.raises(DeviceLost, match=r"above camera\.full_scale_dn = 100"):
        check_photographs(load_manifest(folder / "replay.toml"))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_a_truncated_photograph_is_an_error_and_not_half_a_picture(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"photograph{suffix}"
    pixels = np.random.default_rng(3).integers(0, 255, (200, 300, 3), dtype=np.uint8)
    cv2.imwrite(str(path), pixels)
    whole = path.read_bytes()
    assert read_photograph(path).shape == (200, 300, 3)
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DeviceLost, match="photograph"):
        read_photograph(path)


@pytest.mark.parametrize(("suffix", "dtype"), [(".png", np.uint8), (".png", np.uint16), (".tif", np.uint16)])
@pytest.mark.parametrize("channels", [1, 3])
def test_digital_numbers_are_read_as_they_are(tmp_path: Path, suffix: str, dtype: type, channels: int) -> None:
    rng = np.random.default_rng(4)
    pixels = rng.integers(0, np.iinfo(dtype).max, (*SHAPE, channels), dtype=dtype)  # type: ignore[type-var]
    path = tmp_path / f"frame{suffix}"
    cv2.imwrite(str(path), pixels[..., ::-1])
    read = read_photograph(path)
    assert read.dtype == dtype
    assert np.array_equal(read, pixels)


def test_an_exr_of_digital_numbers_is_read_and_one_of_shares_is_refused(tmp_path: Path) -> None:
    numbers = np.random.default_rng(4).integers(0, 4095, SHAPE, dtype=np.uint16)
    write_exr(tmp_path / "dn.exr", {"Y": numbers})
    assert np.array_equal(read_photograph(tmp_path / "dn.exr")[..., 0], numbers)
    write_exr(tmp_path / "share.exr", {"Y": (numbers / 4095).astype(np.float32)})
    with pytest.raises(DeviceLost, match="no digital numbers"):
        read_photograph(tmp_path / "share.exr")


def test_colours_turn_grey_by_their_luminance() -> None:
    colours = np.zeros((1, 4, 3), dtype=np.uint8)
    colours[0, :3] = 255 * np.eye(3, dtype=np.uint8)
    colours[0, 3] = 255
    assert grey(colours)[0].tolist() == [76, 150, 29, 255]
