"""`rig scan`: on a rendered scene whose points are known, and on a published scan of a real object."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from calibration.structured_light.gray import gray_code_patterns
from rig.errors import CalibrationFailed, DeviceLost, ProfileError
from rig.files.ply import write_ply
from rig.offline.scan import run_scan
from tests.point_clouds import read_ply

ROOT = Path(__file__).parents[3]
DATA = Path(os.environ.get("PROCAM_RIG_DATA", ROOT.parent / "shared" / "data"))
PUBLISHED = DATA / "graycode_scan_published_cloud"

CAMERA_SHAPE, PROJECTOR_SHAPE = (150, 200), (96, 128)
CAMERA_FOCAL, PROJECTOR_FOCAL = 220.0, 150.0
BASELINE_MM = 150.0
WALL_MM, BOX_MM = 800.0, 650.0


def depth_mm() -> np.ndarray:
    """(H, W) depth of the wall, and of a plate before it, along the camera's pixels."""
    depth = np.full(CAMERA_SHAPE, WALL_MM)
    depth[50:100, 60:120] = BOX_MM
    return depth


def points_mm() -> np.ndarray:
    """(H, W, 3) what the camera's pixels see."""
    row, column = np.mgrid[: CAMERA_SHAPE[0], : CAMERA_SHAPE[1]]
    depth = depth_mm()
    x, y = (column - 100) / CAMERA_FOCAL * depth, (row - 75) / CAMERA_FOCAL * depth
    return np.stack([x, y, depth], axis=-1)


def write_photographs(folder: Path, suffix: str = ".png", light: float = 160) -> None:
    """Photographs of the wall and the plate, lit from BASELINE_MM to the right of the camera."""
    points = points_mm() - (BASELINE_MM, 0, 0)
    column = np.rint(PROJECTOR_FOCAL * points[..., 0] / points[..., 2] + 64).astype(int)
    row = np.rint(PROJECTOR_FOCAL * points[..., 1] / points[..., 2] + 48).astype(int)
    inside = (column >= 0) & (column < PROJECTOR_SHAPE[1]) & (row >= 0) & (row < PROJECTOR_SHAPE[0])
    for pattern in gray_code_patterns(PROJECTOR_SHAPE):
        lit = pattern.codes[np.where(inside, row, 0), np.where(inside, column, 0)] * inside / 255.0
        cv2.imwrite(str(folder / f"{pattern.name}{suffix}"), np.rint(20 + light * lit).astype(np.uint8))


def files(axis: str, bits: int, inverse: bool, suffix: str) -> str:
    tail = "-inverse" if inverse else ""
    names = (f'"gray-{axis}-{bit:02d}{tail}{suffix}"' for bit in reversed(range(bits)))
    return f"[{', '.join(names)}]"


def write_manifest(folder: Path, suffix: str = ".png", unit: str = "mm", baseline: float = BASELINE_MM) -> Path:
    path = folder / "replay.toml"
    path.write_text(f"""
schema = 1
[camera]
width_px = {CAMERA_SHAPE[1]}
height_px = {CAMERA_SHAPE[0]}
full_scale_dn = 255
[camera.lens]
focal_px = [{CAMERA_FOCAL}, {CAMERA_FOCAL}]
principal_point_px = [100.0, 75.0]
[projector]
width_px = {PROJECTOR_SHAPE[1]}
height_px = {PROJECTOR_SHAPE[0]}
[projector.lens]
focal_px = [{PROJECTOR_FOCAL}, {PROJECTOR_FOCAL}]
principal_point_px = [64.0, 48.0]
[projector_from_camera]
rotation = [1, 0, 0, 0, 1, 0, 0, 0, 1]
translation = [{-baseline}, 0, 0]
unit = "{unit}"
[gray_code]
columns = {files("column", 7, False, suffix)}
columns_inverse = {files("column", 7, True, suffix)}
rows = {files("row", 7, False, suffix)}
rows_inverse = {files("row", 7, True, suffix)}
""")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_photographs(tmp_path)
    return tmp_path


def test_a_scan_finds_the_wall_and_the_plate(folder: Path) -> None:
    result = run_scan(write_manifest(folder), folder / "cloud.ply")
    points, colours = read_ply(folder / "cloud.ply")
    assert result.points == len(points) > 5000
    assert result.unit == "mm"
    assert result.epipolar_median_px < 0.5
    assert (colours == 180).all()
    true = points_mm()[np.isfinite(depth_mm())].reshape(-1, 3)
    distance = cKDTree(true).query(points)[0]
    # A projector pixel is 5 mm on the wall and b/z of that in depth: whole codes can do no better.
    assert np.median(np.abs(points[:, 2] - np.where(points[:, 2] < 725, BOX_MM, WALL_MM))) < 12
    assert np.quantile(distance, 0.95) < 25


def test_the_cloud_says_its_unit_and_axes(folder: Path) -> None:
    run_scan(write_manifest(folder), folder / "cloud.ply")
    header = (folder / "cloud.ply").read_bytes().split(b"end_header")[0]
    assert b"comment unit mm\n" in header
    assert b"comment axes of the camera: x right, y down, z forward\n" in header


def test_metres_stay_metres(folder: Path) -> None:
    write_manifest(folder)
    run_scan(write_manifest(folder, unit="m", baseline=0.15), folder / "cloud.ply")
    points, _ = read_ply(folder / "cloud.ply")
    assert np.median(points[:, 2]) == pytest.approx(0.8, abs=0.05)


def test_photographs_saved_as_jpeg_give_nearly_the_same_cloud(tmp_path: Path) -> None:
    write_photographs(tmp_path)
    exact = run_scan(write_manifest(tmp_path), tmp_path / "exact.ply")
    write_photographs(tmp_path, ".jpg")
    result = run_scan(write_manifest(tmp_path, ".jpg"), tmp_path / "jpeg.ply")
    assert result.points > 0.9 * exact.points


def test_progress_is_reported_photograph_by_photograph(folder: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    run_scan(write_manifest(folder), folder / "cloud.ply", on_step=lambda *step: seen.append(step))
    assert ("read photographs", 28, 28) in seen
    assert seen[-1] == ("decode and triangulate", 1, 1)


def test_a_manifest_without_lenses_is_refused_with_all_that_is_missing(folder: Path) -> None:
    path = write_manifest(folder)
    text = path.read_text()
    start, end = text.index("[projector_from_camera]"), text.index("[gray_code]")
    path.write_text(text[:start] + text[end:].replace("[gray_code]", "[gray_code]"))
    with pytest.raises(ProfileError, match=r"projector\.lens and projector_from_camera: missing"):
        run_scan(path, folder / "cloud.ply")


def test_a_truncated_photograph_stops_the_scan_and_leaves_no_cloud(tmp_path: Path) -> None:
    write_photographs(tmp_path, ".jpg")
    damaged = tmp_path / "gray-row-03.jpg"
    damaged.write_bytes(damaged.read_bytes()[:-400])
    with pytest.raises(DeviceLost, match=r"1 of 28 photographs cannot be used"):
        run_scan(write_manifest(tmp_path, ".jpg"), tmp_path / "cloud.ply")
    assert not (tmp_path / "cloud.ply").exists()


def test_a_zero_baseline_is_named(folder: Path) -> None:
    with pytest.raises(CalibrationFailed, match="0 m apart"):
        run_scan(write_manifest(folder, baseline=0.0), folder / "cloud.ply")


def test_numbers_that_do_not_belong_to_the_photographs_are_refused(folder: Path) -> None:
    path = write_manifest(folder)
    path.write_text(path.read_text() + "[projector.crop]\ntop_px = 12\n")
    with pytest.raises(CalibrationFailed, match=r"lie 12\.\d px \(median\) from their epipolar lines"):
        run_scan(path, folder / "cloud.ply")


@pytest.mark.parametrize("axis", [0, 1])
def test_photographs_of_a_camera_that_mirrors_are_refused_as_such(folder: Path, axis: int) -> None:
    for path in folder.glob("*.png"):
        cv2.imwrite(str(path), np.flip(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), axis))
    with pytest.raises(CalibrationFailed, match="one of the pictures is mirrored"):
        run_scan(write_manifest(folder), folder / "cloud.ply")
    assert not (folder / "cloud.ply").exists()


def test_a_dark_recording_says_why_there_are_no_points(tmp_path: Path) -> None:
    write_photographs(tmp_path, light=2)
    with pytest.raises(CalibrationFailed, match=r"100\.0 % dark"):
        run_scan(write_manifest(tmp_path), tmp_path / "cloud.ply")


def test_cropped_photographs_give_the_same_points(folder: Path) -> None:
    run_scan(write_manifest(folder), folder / "whole.ply")
    left, top = 30, 20
    for path in folder.glob("gray-*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[top:, left:])
    path = write_manifest(folder)
    text = path.read_text().replace("width_px = 200", "width_px = 170").replace("height_px = 150", "height_px = 130")
    path.write_text(text + f"\n[camera.crop]\nleft_px = {left}\ntop_px = {top}\n")
    run_scan(path, folder / "cropped.ply")
    whole, cropped = (read_ply(folder / f"{name}.ply")[0] for name in ("whole", "cropped"))
    assert 0.5 * len(whole) < len(cropped) < len(whole)
    assert np.quantile(cKDTree(whole).query(cropped)[0], 0.95) < 1e-3


def test_photographs_without_inverses_need_white_and_black_only(folder: Path) -> None:
    with_inverses = run_scan(write_manifest(folder), folder / "cloud.ply")
    for name, level in (("w", 180), ("b", 20)):
        cv2.imwrite(str(folder / f"{name}.png"), np.full(CAMERA_SHAPE, level, dtype=np.uint8))
    path = write_manifest(folder)
    lines = [line for line in path.read_text().splitlines() if "inverse" not in line.split("=")[0]]
    path.write_text("\n".join(lines) + '\n[frames]\nwhite = "w.png"\nblack = "b.png"\n')
    result = run_scan(path, folder / "plain.ply")
    assert result.points == pytest.approx(with_inverses.points, rel=0.05)


def test_a_code_that_begins_elsewhere_is_named_by_its_first_code(tmp_path: Path) -> None:
    """Photographs of columns 20 … 127 only, as if the projector were 108 wide and its code began at 20."""
    write_photographs(tmp_path)
    run_scan(write_manifest(tmp_path), tmp_path / "whole.ply")
    path = write_manifest(tmp_path)
    text = path.read_text().replace("width_px = 128", "width_px = 108")
    path.write_text(text + "first_code = [20, 0]\n[projector.crop]\nleft_px = 20\n")
    run_scan(path, tmp_path / "part.ply")
    whole, part = (read_ply(tmp_path / f"{name}.ply")[0] for name in ("whole", "part"))
    assert 0.5 * len(whole) < len(part) < len(whole)
    assert cKDTree(whole).query(part)[0].max() < 1e-3


def test_a_cloud_survives_writing_and_reading(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    colours = rng.integers(0, 255, (50, 3), dtype=np.uint8)
    write_ply(tmp_path / "a.ply", points, colours, ("unit m",))
    read_points, read_colours = read_ply(tmp_path / "a.ply")
    assert np.array_equal(read_points, points)
    assert np.array_equal(read_colours, colours)


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], np.ndarray]:
    if not (PUBLISHED / "scan_0020").is_dir():
        pytest.skip(f"no published scan at {PUBLISHED}; PROCAM_RIG_DATA names the folder that has it")
    folder = tmp_path_factory.mktemp("published")
    (folder / "replay.toml").write_text(published_manifest())
    result = run_scan(folder / "replay.toml", folder / "cloud.ply")
    return result, read_ply(folder / "cloud.ply")[0].astype(np.float64)


def published_manifest() -> str:
    """What the author's calibration file and the names of his photographs say, as a manifest."""
    calibration = cv2.FileStorage(str(PUBLISHED / "procam_2016_12_09.yaml"), cv2.FILE_STORAGE_READ)

    def lens(prefix: str) -> str:
        matrix = calibration.getNode(f"{prefix}_K").mat()
        distortion = calibration.getNode(f"{prefix}_kc").mat().ravel().tolist()
        focal, centre = [matrix[0, 0], matrix[1, 1]], [matrix[0, 2], matrix[1, 2]]
        numbers = (f"focal_px = {focal}", f"principal_point_px = {centre}", f"distortion = {distortion}")
        return "\n".join(numbers).replace("np.float64(", "").replace(")", "")

    def photographs(axis: int, inverse: int) -> list[str]:
        folder = PUBLISHED / "scan_0020"
        return [str(next(folder.glob(f"*[[]{axis:02d}-{b:02d}-{inverse:02d}_*"))) for b in range(10, -1, -1)]

    return f"""
schema = 1
[camera]
width_px = 2592
height_px = 1944
full_scale_dn = 255
[camera.lens]
{lens("cam")}
[projector]
width_px = 1280
height_px = 720
[projector.lens]
{lens("pro")}
[projector_from_camera]
rotation = {calibration.getNode("R").mat().ravel().tolist()}
translation = {calibration.getNode("T").mat().ravel().tolist()}
unit = "mm"
[gray_code]
columns = {photographs(0, 0)}
columns_inverse = {photographs(0, 1)}
rows = {photographs(1, 0)}
rows_inverse = {photographs(1, 1)}
"""


@pytest.fixture(scope="module")
def authors_mm() -> np.ndarray:
    points, _ = read_ply(PUBLISHED / "scan_0020_cloud.ply")
    return points.astype(np.float64) * (1, -1, -1)


def test_the_published_points_of_a_real_scan_are_found(
    published: tuple[dict[str, object], np.ndarray], authors_mm: np.ndarray
) -> None:
    distance = cKDTree(published[1]).query(authors_mm)[0]
    on_object = (authors_mm[:, 2] > 570) & (authors_mm[:, 2] < 730)
    assert on_object.mean() > 0.95
    assert np.mean(distance[on_object] < 0.5) >= 0.989
    assert np.mean(distance < 0.5) >= 0.987
    assert np.median(distance) <= 0.02


def test_what_a_real_scan_adds_to_the_published_points_lies_on_the_same_object(
    published: tuple[dict[str, object], np.ndarray], authors_mm: np.ndarray
) -> None:
    result, ours = published
    distance = cKDTree(authors_mm).query(ours)[0]
    assert result.points == len(ours) > len(authors_mm)
    assert np.mean(distance < 0.5) >= 0.92
    assert np.mean(distance < 2) >= 0.99
    assert distance.max() < 16
