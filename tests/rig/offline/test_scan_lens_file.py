"""`rig scan` with a lens file of `rig lenses`: a prior with its covariance, not numbers to be believed."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from calibration.lenses.lens import PARAMETERS
from rig.errors import ProfileError
from rig.files.lens_file import POSE_PARAMETERS, SCHEMA, JointEntry, LensEntry, LensFile, PoseEntry, write_lens_file
from rig.offline.scan import run_scan
from tests.point_clouds import read_ply
from tests.rig.offline.test_scan import (
    BASELINE_MM,
    BOX_MM,
    CAMERA_FOCAL,
    CAMERA_SHAPE,
    PROJECTOR_FOCAL,
    PROJECTOR_SHAPE,
    WALL_MM,
    write_manifest,
    write_photographs,
)

LENS_SIGMA = np.array([0.2, 0.2, 0.2, 0.2, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3, 0, 0, 0])
TURN_SIGMA = 0.01
POSE_SIGMA = np.array([TURN_SIGMA, 0.002, 0.002, 5e-4, 5e-4, 5e-4])


def lens(role: str, shape: tuple[int, int], focal_px: float) -> LensEntry:
    return LensEntry(
        name=role,
        role=role,
        width_px=shape[1],
        height_px=shape[0],
        model="k1k2p1p2k3",
        focal_px=(focal_px, focal_px),
        principal_point_px=(shape[1] / 2, shape[0] / 2),
        distortion=(0.0,) * 5,
        sigma=tuple(LENS_SIGMA[:9].tolist()),
        rms_px=0.1,
        noise_px=0.1,
        projection_sigma_px=0.1,
    )


def write_lenses(folder: Path, turn_rad: float, projector_shape: tuple[int, int] = PROJECTOR_SHAPE) -> None:
    """A lens file whose projector is turned about its x axis by something."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    names = [f"{role}.{term}" for role in ("camera", "projector") for term in PARAMETERS[:9]]
    sigmas = np.concatenate([LENS_SIGMA[:9], LENS_SIGMA[:9], POSE_SIGMA])
    file = LensFile(
        schema=SCHEMA,
        made_by="a test",
        date="2026-01-01",
        views=9,
        lens=(lens("camera", CAMERA_SHAPE, CAMERA_FOCAL), lens("projector", projector_shape, PROJECTOR_FOCAL)),
        projector_from_camera=PoseEntry(
            rotation=(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c),
            translation_m=(-BASELINE_MM / 1000, 0.0, 0.0),
            sigma=tuple(POSE_SIGMA.tolist()),
        ),
        joint=JointEntry(
            parameters=(*names, *POSE_PARAMETERS), covariance=tuple(tuple(row) for row in np.diag(sigmas**2).tolist())
        ),
    )
    write_lens_file(folder / "lenses.toml", file)


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    """Photographs, and a manifest that names a lens file in the place of its tables."""
    write_photographs(tmp_path)
    path = write_manifest(tmp_path)
    document = tomllib.loads(path.read_text())
    sizes = {name: (document[name]["width_px"], document[name]["height_px"]) for name in ("camera", "projector")}
    code = "\n".join(f"{axis} = {files!r}" for axis, files in document["gray_code"].items())
    path.write_text(f"""
schema = 1
lens_file = "lenses.toml"
[camera]
width_px = {sizes["camera"][0]}
height_px = {sizes["camera"][1]}
full_scale_dn = 255
[projector]
width_px = {sizes["projector"][0]}
height_px = {sizes["projector"][1]}
[gray_code]
{code}
""")
    return path


def test_a_pose_that_boards_left_open_is_pulled_to_what_the_photographs_show(manifest: Path) -> None:
    write_lenses(manifest.parent, 0.8 * TURN_SIGMA)
    result = run_scan(manifest, manifest.parent / "cloud.ply")
    assert result.unit == "m"
    assert result.warnings == ()
    assert result.epipolar_median_px is not None
    assert result.epipolar_median_px < 0.4, "the lens file's own epipolar lines are 1.2 px off"
    assert result.lens_sigma_percent is not None
    assert 0.1 < result.lens_sigma_percent < 2
    depth = read_ply(manifest.parent / "cloud.ply")[0][:, 2] * 1000
    off = np.abs(depth / np.where(depth < 725, BOX_MM, WALL_MM) - 1)
    assert 100 * np.median(off) < 4 * result.lens_sigma_percent


def test_a_lens_file_that_the_photographs_contradict_is_a_warning(manifest: Path) -> None:
    write_lenses(manifest.parent, 9 * TURN_SIGMA)
    result = run_scan(manifest, manifest.parent / "cloud.ply", epipolar_limit_px=30)
    assert any("contradict the lens file by" in line for line in result.warnings)


def test_lens_files_of_another_picture_size_and_lenses_said_twice_are_refused(manifest: Path) -> None:
    write_lenses(manifest.parent, 0.0, (PROJECTOR_SHAPE[0], PROJECTOR_SHAPE[1] + 8))
    with pytest.raises(ProfileError, match=r"made with a projector of 136 × 96 px, the manifest's has 128 × 96 px"):
        run_scan(manifest, manifest.parent / "cloud.ply")
    text = manifest.read_text().replace(
        "[projector]", "[camera.lens]\nfocal_px = [220.0, 220.0]\nprincipal_point_px = [100.0, 75.0]\n[projector]"
    )
    manifest.write_text(text)
    with pytest.raises(ProfileError, match=r"camera\.lens: lens_file says it too"):
        run_scan(manifest, manifest.parent / "cloud.ply")
