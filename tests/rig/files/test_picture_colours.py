"""What a picture's file says of its colours is followed, said or refused; transparency is never guessed."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image, ImageCms

from rig.errors import UsageError
from rig.files.pictures import read_codes, read_picture

CODES = (200, 100, 50)
# XYZ under D50 of the primaries, as the profiles that vendors publish carry them.
P3_D50 = ((0.51512, 0.24120, -0.00105), (0.29198, 0.69225, 0.04189), (0.15710, 0.06657, 0.78407))
SRGB_D50 = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.71410))


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(path: Path, *extra: tuple[bytes, bytes], pixel: tuple[int, ...] = CODES) -> Path:
    """A PNG of two by two equal pixels with chunks before them."""
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[len(pixel)]
    head = struct.pack(">IIBBBBB", 2, 2, 8, kind, 0, 0, 0)
    rows = (b"\0" + bytes(pixel) * 2) * 2
    chunks = [(b"IHDR", head), *extra, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*one) for one in chunks))
    return path


def fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))


def gamma_trc(gamma: float) -> bytes:
    return b"curv\0\0\0\0" + struct.pack(">IH", 1, round(gamma * 256)) + b"\0\0"


SRGB_TRC = b"para\0\0\0\0" + struct.pack(">HH", 3, 0) + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)


def profile(
    primaries: tuple[tuple[float, float, float], ...] = P3_D50,
    trc: bytes = SRGB_TRC,
    name: str = "Display P3",
    space: bytes = b"RGB ",
) -> bytes:
    """An ICC profile of a display, version 2, by the layout of ICC.1."""
    text = b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name.encode() + b"\0" + b"\0" * 78
    white = b"XYZ \0\0\0\0" + fixed(0.9642, 1.0, 0.8249)
    tags = {b"desc": text, b"wtpt": white, b"cprt": b"text\0\0\0\0none\0"}
    if space == b"GRAY":
        tags[b"kTRC"] = trc
    else:
        for letter, xyz in zip(b"rgb", primaries, strict=True):
            tags[bytes([letter]) + b"XYZ"] = b"XYZ \0\0\0\0" + fixed(*xyz)
            tags[bytes([letter]) + b"TRC"] = trc
    table, body = b"", b""
    start = 128 + 4 + 12 * len(tags)
    for tag, data in tags.items():
        whole = data.ljust(-(-len(data) // 4) * 4, b"\0")
        table += tag + struct.pack(">II", start + len(body), len(data))
        body += whole
    rest = struct.pack(">I", len(tags)) + table + body
    head = struct.pack(">I4sI4s4s4s", 128 + len(rest), b"lcms", 0x02400000, b"mntr", space, b"XYZ ")
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp"
    return head.ljust(68, b"\0") + fixed(0.9642, 1.0, 0.8249) + b"\0" * 48 + rest


def iccp(data: bytes) -> tuple[bytes, bytes]:
    return b"iCCP", b"x\0\0" + zlib.compress(data)


def by_littlecms(data: bytes, codes: tuple[int, int, int]) -> np.ndarray:
    """The same colour by another implementation."""
    own = ImageCms.ImageCmsProfile(io.BytesIO(data))
    picture = Image.new("RGB", (1, 1), codes)
    intent = ImageCms.Intent.RELATIVE_COLORIMETRIC
    done = ImageCms.profileToProfile(picture, own, ImageCms.createProfile("sRGB"), renderingIntent=intent)
    assert done is not None
    return np.asarray(done)[0, 0]


@pytest.mark.parametrize("codes", [CODES, (10, 128, 250), (255, 255, 255), (0, 255, 0), (3, 3, 3)])
@pytest.mark.parametrize("kind", ["P3", "Adobe"])
def test_a_profile_is_followed_as_another_implementation_follows_it(
    tmp_path: Path, codes: tuple[int, int, int], kind: str
) -> None:
    adobe = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
    data = profile() if kind == "P3" else profile(adobe, gamma_trc(2.19921875), "Adobe RGB (1998)")
    expected = by_littlecms(data, codes)
    for name in ("a.jpg", "a.png", "a.tif"):
        path = tmp_path / name
        if name == "a.png":
            png(path, iccp(data), pixel=codes)
        else:
            Image.new("RGB", (16, 16), codes).save(path, icc_profile=data, quality=100, subsampling=0)
        np.testing.assert_allclose(read_codes(path)[0, 0], expected, atol=3 if name == "a.jpg" else 1, err_msg=name)
    read = read_picture(tmp_path / "a.png")
    linear = np.where(expected / 255 <= 0.04045, expected / 255 / 12.92, ((expected / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(read.levels[0, 0] / 255, linear, atol=0.01)
    assert read.profile.startswith({"P3": "Display P3", "Adobe": "Adobe RGB (1998)"}[kind])
    assert ("sRGB lacks" in read.profile) == (codes in [(0, 255, 0), (10, 128, 250)])


def test_a_profile_of_srgb_changes_nothing_whatever_it_is_called(tmp_path: Path) -> None:
    shipped = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for data in (shipped, profile(SRGB_D50, name="my monitor")):
        path = png(tmp_path / "a.png", iccp(data))
        np.testing.assert_array_equal(read_codes(path)[0, 0], CODES)
        assert read_picture(path).profile == ""
        assert read_picture(path, is_linear=True).levels[0, 0].tolist() == list(CODES)


def chrm(*values: float) -> tuple[bytes, bytes]:
    return b"cHRM", struct.pack(">8I", *(round(value * 100000) for value in values))


GAMMA_22 = (b"gAMA", struct.pack(">I", 45455))
P3_CHRM = chrm(0.3127, 0.3290, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)


@pytest.mark.parametrize(
    "chunks",
    [[(b"cICP", bytes([12, 13, 0, 1]))], [GAMMA_22, P3_CHRM], [(b"cICP", bytes([12, 13, 0, 1])), (b"sRGB", b"\0")]],
)
def test_chunks_of_a_png_are_followed(tmp_path: Path, chunks: list[tuple[bytes, bytes]]) -> None:
    path = png(tmp_path / "a.png", *chunks)
    np.testing.assert_allclose(read_codes(path)[0, 0], by_littlecms(profile(), CODES), atol=1)


@pytest.mark.parametrize(
    "chunks",
    [
        [],
        [(b"sRGB", b"\0")],
        [GAMMA_22],
        [GAMMA_22, chrm(0.3127, 0.3290, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06)],
        [(b"sRGB", b"\0"), P3_CHRM],
        [(b"cICP", bytes([1, 13, 0, 1]))],
    ],
)
def test_chunks_that_say_srgb_change_nothing(tmp_path: Path, chunks: list[tuple[bytes, bytes]]) -> None:
    path = png(tmp_path / "a.png", *chunks)
    np.testing.assert_array_equal(read_codes(path)[0, 0], CODES)
    assert read_picture(path).profile == ""


def test_a_png_of_linear_codes_is_linear_light(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", (b"gAMA", struct.pack(">I", 100000)))
    np.testing.assert_allclose(read_picture(path).levels[0, 0], CODES, atol=0.1)
    np.testing.assert_allclose(read_picture(path, is_linear=True).levels[0, 0], CODES, atol=0.1)


def float_tiff(path: Path, data: bytes | None, values: tuple[float, ...]) -> Path:
    """Numbers with a point, as darkroom programs export them."""
    spec = oiio.ImageSpec(2, 2, len(values), "float")
    if data is not None:
        spec.attribute("ICCProfile", f"uint8[{len(data)}]", np.frombuffer(data, np.uint8))
    output = oiio.ImageOutput.create("tif")
    assert output.open(str(path), spec)
    assert output.write_image(np.broadcast_to(np.float32(values), (2, 2, len(values))).copy())
    output.close()
    return path


@pytest.mark.parametrize(("primaries", "words"), [(SRGB_D50, ""), (P3_D50, "Display P3")])
def test_numbers_with_a_point_follow_the_profile_of_their_file(
    tmp_path: Path, primaries: tuple[tuple[float, float, float], ...], words: str
) -> None:
    data = profile(primaries)
    read = read_picture(float_tiff(tmp_path / "a.tif", data, tuple(code / 255 for code in CODES)))
    share = by_littlecms(data, CODES) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(read.levels[0, 0] / 255, linear, atol=0.01)
    assert (read.is_linear, read.profile) == (False, words)


@pytest.mark.parametrize("data", [None, profile(SRGB_D50, trc=b"curv" + bytes(8), name="linear")])
def test_numbers_with_a_point_are_linear_light_where_no_profile_says_otherwise(
    tmp_path: Path, data: bytes | None
) -> None:
    read = read_picture(float_tiff(tmp_path / "a.tif", data, (0.5, 0.25, 0.125)))
    np.testing.assert_allclose(read.levels[0, 0] / 255, (0.5, 0.25, 0.125), atol=2e-3)
    assert read.is_linear


def test_numbers_above_the_white_of_their_profile_are_refused(tmp_path: Path) -> None:
    path = float_tiff(tmp_path / "a.tif", profile(SRGB_D50, name="sRGB IEC"), (1.5, 0.2, 0.1))
    with pytest.raises(UsageError, match=r"numbers up to 1\.5, but 1 is white in its colour profile sRGB IEC; scale"):
        read_picture(path)


def test_numbers_with_a_point_said_to_be_linear_against_their_profile_are_a_contradiction(tmp_path: Path) -> None:
    path = float_tiff(tmp_path / "a.tif", profile(), (0.5, 0.2, 0.1))
    with pytest.raises(UsageError, match="Display P3 says that its numbers are no linear light; leave --linear out"):
        read_picture(path, is_linear=True)


def test_a_grey_profile_gives_grey_light(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", iccp(profile(trc=gamma_trc(1.75), name="Gray 1.75", space=b"GRAY")), pixel=(128,))
    assert read_picture(path).levels[0, 0, 0] == pytest.approx(255 * (128 / 255) ** 1.75, abs=0.1)


def test_chromaticities_of_an_exr_are_followed(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(1, 1, 3, "float")
    spec.attribute("chromaticities", "float[8]", (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329))
    output = oiio.ImageOutput.create("exr")
    assert output.open(str(tmp_path / "a.exr"), spec)
    assert output.write_image(np.array([[[0.4, 0.3, 0.2]]], np.float32))
    output.close()
    # P3 to sRGB by SMPTE RP 177 of both sets of primaries: red 1.2249, -0.2249, 0 in its first row, and so on
    expected = np.array([[1.2249, -0.2249, 0], [-0.0421, 1.0421, 0], [-0.0196, -0.0786, 1.0983]]) @ [0.4, 0.3, 0.2]
    np.testing.assert_allclose(read_picture(tmp_path / "a.exr").levels[0, 0] / 255, expected, atol=2e-4)


@pytest.mark.parametrize("noted", [1, 2, 0xFFFF])
def test_what_a_camera_notes_of_its_colours_is_believed(tmp_path: Path, noted: int) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = noted
    Image.new("RGB", (16, 16), CODES).save(tmp_path / "a.jpg", exif=exif, quality=100, subsampling=0)
    if noted == 0xFFFF:
        with pytest.raises(UsageError, match=r"notes that its colours are not sRGB .*; convert the picture to sRGB"):
            read_picture(tmp_path / "a.jpg")
    else:
        assert read_picture(tmp_path / "a.jpg").profile.startswith("Adobe RGB" if noted == 2 else "")


@pytest.mark.parametrize(
    ("chunks", "words"),
    [
        ([iccp(profile(space=b"CMYK"))], "is for CMYK colours; convert the picture to sRGB"),
        ([iccp(profile()[:300])], "is damaged"),
        ([iccp(profile(((0, 0, 0),) * 3))], "is damaged: its white is not white"),
        ([iccp(profile(trc=b"curf" + bytes(8)))], "a curve of an unknown kind"),
        ([(b"cICP", bytes([9, 16, 0, 1]))], r"makes no sense here \(cICP 9, 16, 0, 1\)"),
        ([(b"gAMA", struct.pack(">I", 1))], "gAMA 1e-05"),
        ([GAMMA_22, chrm(0.3, 0.3, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3)], "on one line"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_the_remedy(
    tmp_path: Path, chunks: list[tuple[bytes, bytes]], words: str
) -> None:
    path = png(tmp_path / "a.png", *chunks)
    for read in (read_picture, read_codes):
        with pytest.raises(UsageError, match=words) as caught:
            read(path)
        assert "convert the picture to sRGB in an image editor" in str(caught.value)


def test_a_profile_against_linear_is_a_contradiction(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", iccp(profile()))
    with pytest.raises(UsageError, match="Display P3 says that its numbers are no linear light; leave --linear out"):
        read_picture(path, is_linear=True)


@pytest.mark.parametrize("pixel", [(10, 20, 200, 128), (10, 20, 200, 0), (90, 254)])
def test_a_picture_with_a_transparent_pixel_is_refused(tmp_path: Path, pixel: tuple[int, ...]) -> None:
    path = png(tmp_path / "a.png", pixel=pixel)
    for read in (read_picture, read_codes):
        with pytest.raises(UsageError, match=r"100\.00% of its pixels are transparent.*flatten the picture"):
            read(path)


def test_a_colour_of_a_palette_that_is_transparent_is_refused(tmp_path: Path) -> None:
    Image.new("P", (4, 4), 0).save(tmp_path / "a.png", transparency=0)
    with pytest.raises(UsageError, match="transparent"):
        read_codes(tmp_path / "a.png")


def test_opaque_pictures_are_taken(tmp_path: Path) -> None:
    assert read_codes(png(tmp_path / "a.png", pixel=(10, 20, 200, 255)))[0, 0].tolist() == [10, 20, 200]
