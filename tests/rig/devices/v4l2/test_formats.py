"""What the bytes of each pixel format mean, on buffers written here by other means."""

import cv2
import numpy as np
import pytest

from rig.devices.v4l2 import abi
from rig.devices.v4l2.formats import PIXEL_FORMATS, Layout, Undecodable, layout_of, pixel_format
from rig.errors import SettingRefused

HEIGHT, WIDTH, PADDING = 6, 10, 7
RANDOM = np.random.default_rng(11)


def decode(name: str, lines: np.ndarray, channels: int = 1, height: int = HEIGHT, **layout: object) -> np.ndarray:
    """Decode (lines, bytes) with padding behind each line, as (H, W, C)."""
    padded = np.pad(lines, ((0, 0), (0, PADDING)), constant_values=0xA5)
    described = Layout(width_px=WIDTH, height_px=height, bytes_per_line=padded.shape[1], **layout)
    known = PIXEL_FORMATS[name]
    assert padded.size - PADDING == known.least_bytes(described)
    pixels = known.decode(padded.reshape(-1), described, channels)
    assert pixels.dtype == np.uint16
    assert pixels.flags.c_contiguous
    assert pixels.shape == (height, WIDTH, channels)
    return pixels


def bits_of(values: np.ndarray, depth: int) -> str:
    """A row as one string of bits, highest first."""
    return "".join(f"{value:0{depth}b}" for value in values)


def bytes_of(bits: str) -> list[int]:
    return [int(bits[at : at + 8].ljust(8, "0"), 2) for at in range(0, len(bits), 8)]


def mipi(values: np.ndarray, depth: int) -> list[int]:
    """A row as MIPI packs it: upper bytes of a group, then its lower bits, the first pixel's in the lowest place."""
    extra, packed = depth - 8, []
    group = 8 // extra
    for at in range(0, len(values), group):
        some = [*map(int, values[at : at + group]), 0, 0, 0][:group]
        packed += [value >> extra for value in some]
        packed.append(sum((value & (1 << extra) - 1) << extra * place for place, value in enumerate(some)))
    return packed


class TestGrey:
    @pytest.mark.parametrize("name", ["GREY", "BA81", "GBRG", "GRBG", "RGGB"])
    def test_eight_bits_are_taken_as_they_are(self, name: str) -> None:
        levels = RANDOM.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
        np.testing.assert_array_equal(decode(name, levels)[:, :, 0], levels)

    @pytest.mark.parametrize(("name", "order"), [("Y10", "<u2"), ("RG12", "<u2"), ("Y16", "<u2"), ("Y16-BE", ">u2")])
    def test_words_are_taken_as_they_are(self, name: str, order: str) -> None:
        levels = RANDOM.integers(0, 1 << PIXEL_FORMATS[name].depths[1], (HEIGHT, WIDTH), np.uint16)
        np.testing.assert_array_equal(decode(name, levels.astype(order).view(np.uint8))[:, :, 0], levels)

    @pytest.mark.parametrize(("name", "depth"), [("Y10P", 10), ("pRAA", 10), ("Y12P", 12), ("pBCC", 12)])
    def test_mipi_packing(self, name: str, depth: int) -> None:
        levels = RANDOM.integers(0, 1 << depth, (HEIGHT, WIDTH), np.uint16)
        packed = np.array([mipi(row, depth) for row in levels], np.uint8)
        np.testing.assert_array_equal(decode(name, packed)[:, :, 0], levels)

    def test_y10b_is_one_stream_of_bits(self) -> None:
        levels = RANDOM.integers(0, 1024, (HEIGHT, WIDTH), np.uint16)
        whole = -(-WIDTH // 4) * 5
        packed = np.array([[*bytes_of(bits_of(row, 10)), 0, 0][:whole] for row in levels], np.uint8)
        np.testing.assert_array_equal(decode("Y10B", packed)[:, :, 0], levels)


class TestColour:
    @pytest.mark.parametrize(("name", "order"), [("RGB3", (0, 1, 2)), ("BGR3", (2, 1, 0))])
    def test_red_green_blue(self, name: str, order: tuple[int, ...]) -> None:
        rgb = RANDOM.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
        np.testing.assert_array_equal(decode(name, rgb[:, :, order].reshape(HEIGHT, -1), 3), rgb)

    @pytest.mark.parametrize(
        ("name", "code"),
        [("YUYV", cv2.COLOR_YUV2RGB_YUYV), ("UYVY", cv2.COLOR_YUV2RGB_UYVY), ("YVYU", cv2.COLOR_YUV2RGB_YVYU)],
    )
    def test_yuv_is_what_opencv_makes_of_it(self, name: str, code: int) -> None:
        data = RANDOM.integers(30, 220, (HEIGHT, WIDTH, 2), np.uint8)
        ours = decode(name, data.reshape(HEIGHT, -1), 3).astype(int)
        assert np.abs(ours - cv2.cvtColor(data, code)).max() <= 2
        luma = decode(name, data.reshape(HEIGHT, -1))
        np.testing.assert_array_equal(luma[:, :, 0], data[:, :, 1 if name == "UYVY" else 0])

    def test_nv12_is_what_opencv_makes_of_it(self) -> None:
        data = RANDOM.integers(30, 220, (HEIGHT * 3 // 2, WIDTH), np.uint8)
        ours = decode("NV12", data, 3).astype(int)
        assert np.abs(ours - cv2.cvtColor(data, cv2.COLOR_YUV2RGB_NV12)).max() <= 2
        np.testing.assert_array_equal(decode("NV12", data)[:, :, 0], data[:HEIGHT])

    @pytest.mark.parametrize(("kr", "kb"), [(0.299, 0.114), (0.2126, 0.0722)])
    @pytest.mark.parametrize("full_range", [True, False])
    def test_the_matrix_and_range_are_those_that_the_driver_reports(
        self, kr: float, kb: float, full_range: bool
    ) -> None:
        red = np.array([1.0, 0.0, 0.0])
        y = float(np.dot([kr, 1 - kr - kb, kb], red))
        chroma = np.array([-y / (2 * (1 - kb)), (1 - y) / (2 * (1 - kr))])
        scale = (0, 255, 255) if full_range else (16, 219, 224)
        u, v = np.round(128 + scale[2] * chroma).astype(int)
        quad = [round(scale[0] + scale[1] * y), min(u, 255), round(scale[0] + scale[1] * y), min(v, 255)]
        data = np.tile(np.array(quad, np.uint8), (HEIGHT, WIDTH // 2))
        pixels = decode("YUYV", data, 3, luma_weights=(kr, kb), full_range=full_range)
        assert np.abs(pixels[0, 0].astype(int) - [255, 0, 0]).max() <= 2

    def test_matrix_and_range_default_by_colour_space(self) -> None:
        assert layout_of(abi.PixFormat(width=4, height=2, bytesperline=8)) == Layout(
            width_px=4, height_px=2, bytes_per_line=8
        )
        hd = layout_of(abi.PixFormat(colorspace=abi.COLORSPACE_REC709))
        assert (hd.luma_weights, hd.full_range) == ((0.2126, 0.0722), False)
        assert layout_of(abi.PixFormat(colorspace=abi.COLORSPACE_JPEG)).full_range


class TestJpeg:
    @staticmethod
    def compressed(picture: np.ndarray) -> np.ndarray:
        return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].reshape(-1)

    def test_pictures_are_decoded_red_first(self) -> None:
        blue_first = np.full((HEIGHT, WIDTH, 3), (200, 100, 30), np.uint8)
        data = self.compressed(blue_first)
        colour = PIXEL_FORMATS["MJPG"].decode(data, Layout(width_px=WIDTH, height_px=HEIGHT, bytes_per_line=0), 3)
        assert np.abs(colour.astype(int) - [30, 100, 200]).max() <= 2
        grey = PIXEL_FORMATS["MJPG"].decode(data, Layout(width_px=WIDTH, height_px=HEIGHT, bytes_per_line=0), 1)
        assert grey.shape == (HEIGHT, WIDTH, 1)
        assert abs(int(grey[0, 0, 0]) - round(0.299 * 30 + 0.587 * 100 + 0.114 * 200)) <= 2

    @pytest.mark.parametrize(
        "layout",
        [
            Layout(width_px=WIDTH + 2, height_px=HEIGHT, bytes_per_line=0),
            Layout(width_px=WIDTH, height_px=HEIGHT // 2, bytes_per_line=0),
        ],
    )
    def test_a_picture_of_another_size_is_none(self, layout: Layout) -> None:
        with pytest.raises(Undecodable, match="10 x 6 px"):
            PIXEL_FORMATS["MJPG"].decode(self.compressed(np.zeros((HEIGHT, WIDTH), np.uint8)), layout, 1)

    def test_rubbish_is_no_picture(self) -> None:
        with pytest.raises(Undecodable, match="no JPEG"):
            PIXEL_FORMATS["JPEG"].decode(
                RANDOM.integers(0, 256, 500, np.uint8), Layout(width_px=WIDTH, height_px=HEIGHT, bytes_per_line=0), 1
            )


class TestEveryFormat:
    @pytest.mark.parametrize("name", [name for name, known in PIXEL_FORMATS.items() if not known.is_compressed])
    def test_a_buffer_that_is_a_byte_short_is_refused(self, name: str) -> None:
        known = PIXEL_FORMATS[name]
        layout = Layout(width_px=WIDTH, height_px=HEIGHT, bytes_per_line=64)
        enough = known.least_bytes(layout)
        assert known.decode(np.zeros(enough, np.uint8), layout, known.channels[-1]).shape[:2] == (HEIGHT, WIDTH)
        with pytest.raises(Undecodable):
            known.decode(np.zeros(enough - 1, np.uint8), layout, known.channels[-1])

    @pytest.mark.parametrize("name", [name for name, known in PIXEL_FORMATS.items() if not known.is_compressed])
    def test_pixels_outlive_the_buffer(self, name: str) -> None:
        known, layout = PIXEL_FORMATS[name], Layout(width_px=WIDTH, height_px=HEIGHT, bytes_per_line=64)
        buffer = np.zeros(known.least_bytes(layout), np.uint8)
        before = known.decode(buffer, layout, known.channels[0])
        kept = before.copy()
        buffer[:] = 77
        np.testing.assert_array_equal(before, kept)

    @pytest.mark.parametrize(
        ("name", "channels", "bit_depth", "message"),
        [
            ("H264", 1, 8, "'H264' is not understood; it is one of GREY"),
            ("GREY", 3, 8, "gives 1 channels, not 3"),
            ("RGB3", 1, 8, "gives 3 channels, not 1"),
            ("GREY", 1, 12, "bit depth of 8, not 12"),
            ("Y10", 1, 12, "bit depth of 10, not 12"),
            ("Y16", 1, 8, "bit depth of 9 … 16, not 8"),
        ],
    )
    def test_what_does_not_fit_the_profile_is_named(
        self, name: str, channels: int, bit_depth: int, message: str
    ) -> None:
        with pytest.raises(SettingRefused, match=message):
            pixel_format(name, channels=channels, bit_depth=bit_depth)
