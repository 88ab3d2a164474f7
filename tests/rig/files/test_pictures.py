"""Images survive the disk exactly, and unusable ones are named."""

import errno
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from rig.errors import SessionError, UsageError
from rig.files import atomic
from rig.files.exr import read_exr, write_exr
from rig.files.pictures import cover, read_codes, read_picture, write_png


def random_generator() -> np.random.Generator:
    return np.random.default_rng(11)


def test_channels_come_back_by_name_not_by_order(tmp_path: Path) -> None:
    channels = {name: np.full((3, 4), value, np.float32) for name, value in [("row", 1), ("col", 2), ("mask", 3)]}
    write_exr(tmp_path / "map.exr", channels)
    back = read_exr(tmp_path / "map.exr")
    assert {name: float(back[name][0, 0]) for name in back} == {"row": 1, "col": 2, "mask": 3}


def test_sixteen_bit_frames_are_exact(tmp_path: Path) -> None:
    frame = random_generator().integers(0, 65536, (37, 53), dtype=np.uint16)
    write_exr(tmp_path / "frame.exr", {"Y": frame})
    np.testing.assert_array_equal(read_exr(tmp_path / "frame.exr")["Y"].astype(np.uint16), frame)


def test_float32_with_nan_is_exact(tmp_path: Path) -> None:
    values = random_generator().normal(size=(20, 30)).astype(np.float32)
    values[3, 4] = np.nan
    write_exr(tmp_path / "map.exr", {"x": values})
    np.testing.assert_array_equal(read_exr(tmp_path / "map.exr")["x"], values)


def test_integers_that_float32_cannot_hold_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="16777217"):
        write_exr(tmp_path / "a.exr", {"Y": np.full((2, 2), 2**24 + 1, np.uint32)})
    assert not list(tmp_path.iterdir())


def test_the_time_of_writing_is_not_in_the_bytes(tmp_path: Path) -> None:
    frame = random_generator().integers(0, 4096, (16, 16), dtype=np.uint16)
    write_exr(tmp_path / "a.exr", {"Y": frame}, {"rig:step": "gray"})
    assert b"DateTime" not in (tmp_path / "a.exr").read_bytes()
    assert b"rig:step" in (tmp_path / "a.exr").read_bytes()


def test_png_round_trips_through_another_reader(tmp_path: Path) -> None:
    picture = random_generator().integers(0, 256, (12, 9, 3), dtype=np.uint8)
    write_png(tmp_path / "p.png", picture)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "p.png"))[..., ::-1], picture)
    np.testing.assert_array_equal(read_picture(tmp_path / "p.png", is_linear=True).levels, picture)


def test_sixteen_bit_pictures_are_scaled_to_255(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.array([[0, 257 * 100, 65535]], dtype=np.uint16))
    np.testing.assert_allclose(
        read_picture(tmp_path / "p.png", is_linear=True).levels, [[[0], [100], [255]]], rtol=1e-6
    )


def test_codes_are_srgb_unless_they_are_said_to_be_linear(tmp_path: Path) -> None:
    """Of sRGB 188 is half of the light (IEC 61966-2-1), of 16 bits too."""
    cv2.imwrite(str(tmp_path / "p.png"), np.array([[0, 10, 188, 255]], dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "q.png"), np.array([[0, 10, 188, 255]], dtype=np.uint16) * 257)
    for name in ("p.png", "q.png"):
        levels = read_picture(tmp_path / name).levels[0, :, 0]
        np.testing.assert_allclose(levels, [0, 10 / 12.92, 127.5, 255], atol=0.8)
        assert levels[2] == pytest.approx(127.5, abs=0.8)
        np.testing.assert_allclose(
            read_picture(tmp_path / name, is_linear=True).levels[0, :, 0], [0, 10, 188, 255], rtol=1e-6
        )


def test_exr_pictures_go_from_one_to_255(tmp_path: Path) -> None:
    third = np.full((2, 2), 0.25, np.float32)
    write_exr(tmp_path / "p.exr", {"R": third, "G": 2 * third, "B": 4 * third})
    np.testing.assert_allclose(read_picture(tmp_path / "p.exr").levels[0, 0], [63.75, 127.5, 255.0])


def test_a_jpeg_is_turned_as_its_camera_noted(tmp_path: Path) -> None:
    left_dark = np.zeros((16, 32, 3), np.uint8)
    left_dark[:, 16:] = 255
    spec = oiio.ImageSpec(32, 16, 3, "uint8")
    spec.attribute("Orientation", 6)  # the right way up after a quarter turn clockwise
    output = oiio.ImageOutput.create("jpeg")
    assert output.open(str(tmp_path / "p.jpg"), spec)
    assert output.write_image(left_dark)
    output.close()
    upright = read_picture(tmp_path / "p.jpg").levels
    assert upright.shape == (32, 16, 3)
    assert upright[:12].max() < 60
    assert upright[20:].min() > 200


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_no_numbers_are_counted(tmp_path: Path, value: float) -> None:
    picture = np.ones((4, 4), np.float32)
    picture[0, :3] = value
    write_exr(tmp_path / "target.exr", {"Y": picture})
    with pytest.raises(UsageError, match=r"target\.exr: 3 of 16 values are NaN or infinite"):
        read_picture(tmp_path / "target.exr")


def test_negative_light_is_refused(tmp_path: Path) -> None:
    write_exr(tmp_path / "target.exr", {"Y": np.array([[-0.5, 1.0]], np.float32)})
    with pytest.raises(UsageError, match=r"1 of 2 values are negative \(lowest -0\.5\)"):
        read_picture(tmp_path / "target.exr")


def test_unusable_files_are_named(tmp_path: Path) -> None:
    write_exr(tmp_path / "map.exr", {"col": np.ones((2, 2)), "row": np.ones((2, 2))})
    (tmp_path / "text.png").write_text("hello")
    (tmp_path / "empty.png").write_bytes(b"")
    expected = {
        "none.png": "no such file",
        "map.exr": "needs R, G, B or Y",
        "text.png": "cannot be read",
        "empty.png": "cannot be read",
    }
    for name, said in expected.items():
        with pytest.raises(UsageError, match=said) as caught:
            read_picture(tmp_path / name)
        assert name in str(caught.value)


@pytest.mark.parametrize("name", ["p.png", "p.jpg", "p.tif", "p.exr"])
def test_a_file_that_was_cut_short_is_refused(tmp_path: Path, name: str) -> None:
    noise = random_generator().integers(0, 256, (64, 64, 3), dtype=np.uint8)
    if name == "p.exr":
        write_exr(tmp_path / name, {"Y": noise[..., 0]})
    else:
        cv2.imwrite(str(tmp_path / name), noise)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) // 2])
    with pytest.raises(UsageError, match=name):
        read_picture(tmp_path / name)


def written(path: Path, pixels: np.ndarray, kind: str, **attributes: object) -> Path:
    """A picture file of a type of numbers that OpenCV does not write."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(pixels)
    output.close()
    return path


def test_numbers_with_a_point_are_linear_light_and_said_so_whatever_the_file_is_called(tmp_path: Path) -> None:
    half = np.full((2, 3, 3), 0.5, np.float32)
    for name in ("half.tif", "half.exr"):
        read = read_picture(written(tmp_path / name, half, "float"))
        assert read.is_linear
        np.testing.assert_allclose(read.levels, 127.5)
    assert not read_picture(written(tmp_path / "codes.tif", np.full((2, 3, 3), 9, np.uint8), "uint8")).is_linear


@pytest.mark.parametrize(("kind", "name"), [("uint32", "p.tif"), ("uint32", "p.exr"), ("int16", "p.tif")])
def test_numbers_of_a_type_that_no_picture_has_are_refused_before_memory_is_asked_for(
    tmp_path: Path, kind: str, name: str
) -> None:
    path = written(tmp_path / name, np.full((2, 3, 3), 9, kind), kind.removesuffix("32"))
    with pytest.raises(UsageError, match=f"numbers of the type {kind}; export it with 8 or 16 bits"):
        read_picture(path)


def test_codes_are_the_same_in_every_kind_of_file(tmp_path: Path) -> None:
    codes = random_generator().integers(0, 256, (12, 9, 3), dtype=np.uint8)
    opaque = np.concatenate([codes, np.full((12, 9, 1), 255, np.uint8)], axis=2)
    turned = np.ascontiguousarray(np.rot90(codes))
    files = (
        written(tmp_path / "alpha.png", opaque, "uint8"),
        written(tmp_path / "sixteen.png", codes.astype(np.uint16) * 257, "uint16"),
        written(tmp_path / "turned.tif", turned, "uint8", Orientation=6),
        written(tmp_path / "plain.bmp", codes, "uint8"),
    )
    expected = read_picture(written(tmp_path / "plain.png", codes, "uint8")).levels
    for path in files:
        np.testing.assert_allclose(read_picture(path).levels, expected, atol=1e-3, err_msg=path.name)
        np.testing.assert_array_equal(read_codes(path), codes, err_msg=path.name)


def test_a_full_disk_leaves_the_old_file_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"Y": np.ones((4, 4))})
    before = path.read_bytes()

    def full(_: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(atomic, "sync", full)
    with pytest.raises(SessionError, match=r"the disk is full: .*a\.exr needs .* nothing was lost"):
        write_exr(path, {"Y": np.zeros((4, 4))})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match=r"cannot write .*p\.png"):
        write_png(tmp_path / "file" / "p.png", np.zeros((2, 2), np.uint8))


def test_codes_for_a_display_are_the_upper_eight_bits_in_three_channels(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.array([[0, 257 * 100 + 3, 65535]], dtype=np.uint16))
    np.testing.assert_array_equal(read_codes(tmp_path / "p.png"), [[[0] * 3, [100] * 3, [255] * 3]])
    write_exr(tmp_path / "p.exr", {"Y": np.ones((2, 2), np.float32)})
    with pytest.raises(UsageError, match="8 or 16 bits"):
        read_codes(tmp_path / "p.exr")


@pytest.mark.parametrize("shape", [(30, 40), (8, 90), (90, 8), (5, 5)])
def test_a_picture_of_any_size_covers_a_shape_and_its_middle_stays_in_the_middle(shape: tuple[int, int]) -> None:
    picture = np.zeros((*shape, 3), np.uint8)
    picture[shape[0] // 2 - 1 : shape[0] // 2 + 2, shape[1] // 2 - 1 : shape[1] // 2 + 2] = 255
    fitted = cover(picture, (30, 40), cv2.INTER_LINEAR)
    assert fitted.shape == (30, 40, 3)
    y, x = np.nonzero(fitted[..., 0])
    assert abs(y.mean() - 15) < 3
    assert abs(x.mean() - 20) < 3
