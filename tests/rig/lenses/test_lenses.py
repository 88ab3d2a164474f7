"""`rig lenses`: from lists of corners and from photographs to a lens file, and what it says of bad input."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.lenses.records import BoardSightings
from calibration.structured_light.code import CODES
from rig.cli.app import run_command
from rig.errors import CalibrationFailed, ProfileError
from rig.files.lens_file import read_lens_file, scan_tables
from rig.files.pictures import write_png
from rig.lenses.run import run_lenses
from rig.profile.lenses import lens_settings, nominal_lenses
from rig.profile.schema import load_profile
from tests.calibration.lenses.board_world import (
    BOARD,
    CAMERA,
    CAMERA_SIZE,
    PROJECTOR,
    PROJECTOR_SIZE,
    photograph,
    printed,
    sightings,
    stand,
    truth,
)

HEAD = f"""
schema = 1
[camera]
name = "left"
width_px = {CAMERA_SIZE[0]}
height_px = {CAMERA_SIZE[1]}
model = "k1k2p1p2"
[projector]
width_px = {PROJECTOR_SIZE[0]}
height_px = {PROJECTOR_SIZE[1]}
model = "k1k2p1p2"
code_step_px = 4
[board]
kind = "chessboard"
columns = 9
rows = 6
square_m = 0.03
flex = false
"""
LISTS = '[corners]\ncamera = "corners.vnl"\nprojector = "projector.vnl"\n'


def write_lists(folder: Path, seen: BoardSightings, text: str = HEAD + LISTS) -> Path:
    """Corners of both devices as text, one picture without a board, one corner that was not seen."""
    for name, xy in (("corners", seen.camera_xy_px), ("projector", seen.projector_xy_px)):
        lines = [f"{view}.png {x:.5f} {y:.5f} 0" for view, (x, y) in zip(seen.view, xy, strict=True)]
        lines[7] = "0.png - - -"
        empty = ["99.png - - -"] if name == "corners" else []
        (folder / f"{name}.vnl").write_text("\n".join(["# filename x y level", *lines, *empty]))
    (folder / "lenses.toml").write_text(text)
    return folder / "lenses.toml"


@pytest.fixture(scope="module")
def six_views() -> BoardSightings:
    seen = sightings(truth(6, seed=7))
    return replace(seen, projector_by_camera=np.zeros_like(seen.projector_by_camera))


def test_lists_of_corners_give_a_lens_file_and_a_page(
    tmp_path: Path, six_views: BoardSightings, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = write_lists(tmp_path, six_views)
    status = run_command(["lenses", str(manifest), "-o", str(tmp_path / "out.toml"), "--json"])
    shown = json.loads(capsys.readouterr().out)
    assert status == 1  # one picture has no board
    assert any("99.png: has no board" in line for line in shown["warnings"])
    assert [device["name"] for device in shown["devices"]] == ["left", "projector"]
    assert shown["devices"][1]["principal_point_px"][1] > PROJECTOR_SIZE[1]
    assert "<svg" in (tmp_path / "out.html").read_text() or "data:image/png" in (tmp_path / "out.html").read_text()
    lenses = read_lens_file(tmp_path / "out.toml")
    camera = lenses.pinhole("camera")
    assert camera is not None
    assert abs(camera.focal_px[0] - CAMERA[0]) < 4 * lenses.lens[0].sigma[0]
    covariance = lenses.covariance_of("projector")
    assert np.sqrt(covariance[3, 3]) == pytest.approx(lenses.lens[1].sigma[3], rel=1e-9)
    assert "[projector_from_camera]" in scan_tables(lenses)


def test_a_profile_takes_a_lens_file_with_all_its_covariance(tmp_path: Path, six_views: BoardSightings) -> None:
    run_lenses(write_lists(tmp_path, six_views), tmp_path / "out.toml")
    text = load_profile("ci-tiny").path.read_text(encoding="utf-8")
    written = tmp_path / "profile.toml"
    written.write_text(text.replace("[[camera]]", '[[camera]]\nlens = "out.toml"', 1))
    profile = load_profile(written)
    with pytest.raises(ProfileError, match=r"was made at 640 × 480 px"):
        nominal_lenses(profile)
    width, height = CAMERA_SIZE
    written.write_text(
        written.read_text()
        .replace(f"width_px = {profile.camera.width_px}", f"width_px = {width}", 1)
        .replace(f"height_px = {profile.camera.height_px}", f"height_px = {height}", 1)
    )
    profile = load_profile(written)
    nominal, file = nominal_lenses(profile), read_lens_file(tmp_path / "out.toml")
    assert nominal.camera_focal_px == pytest.approx(CAMERA[0], rel=0.01)
    assert nominal.known.projector is None
    assert nominal.known.camera is not None
    assert (nominal.known.camera.covariance == file.covariance_of("camera")).all()
    assert np.count_nonzero(nominal.known.covariance()[:8, :8]) > 8, "correlations count, too"
    assert lens_settings(profile), "a session whose lens file changes fits its geometry again"


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four poses, lit by Gray code of steps of four projector pixels; the last photograph of each is cut out."""
    folder = tmp_path_factory.mktemp("poses")
    state, board = truth(4, seed=11), printed(BOARD)
    shape = (PROJECTOR_SIZE[1] // 4, PROJECTOR_SIZE[0] // 4)
    shown = {pattern.name: pattern.codes for pattern in CODES["gray"].patterns(shape)}
    shown |= {"white": np.full(shape, 255, np.uint8), "black": np.zeros(shape, np.uint8)}
    views = []
    for view in range(4):
        place = stand(state, view, board)
        crop = (4, 2) if view == 3 else (0, 0)
        for k, (name, codes) in enumerate(shown.items()):
            whole = photograph(place, np.kron(codes, np.ones((4, 4), np.uint8)), seed=50 * view + k)
            write_png(folder / f"{view}-{name}.png", np.ascontiguousarray(whole[crop[1] :, crop[0] :]))
        cut = f"crop = {{ left_px = {crop[0]}, top_px = {crop[1]} }}\n" if view == 3 else ""
        views.append(f'[[view]]\nname = "pose-{view}"\nfiles = "{view}-{{pattern}}.png"\n{cut}')
    (folder / "lenses.toml").write_text(HEAD + "".join(views))
    return folder


def test_photographs_of_a_lit_board_give_both_lenses(photographs: Path) -> None:
    result = run_lenses(photographs / "lenses.toml", photographs / "out.toml")
    camera, projector = result.devices
    assert all(view.used for view in result.views)
    for device, true in ((camera, CAMERA), (projector, PROJECTOR)):
        found = np.array([*device.focal_px, *device.principal_point_px])
        sigma = np.array([*device.focal_sigma_px, *device.principal_point_sigma_px])
        assert (np.abs(found - true[:4]) < 5 * sigma).all()
    assert camera.rms_px < 0.2
    assert projector.rms_px < 0.3
    assert result.starts_agree_px < 1e-3


def test_changed_light_and_another_resolution_are_named_with_the_photograph(photographs: Path, tmp_path: Path) -> None:
    for path in photographs.glob("*.png"):
        (tmp_path / path.name).symlink_to(path)
    brighter = tmp_path / "1-gray-column-05.png"
    brighter.unlink()
    write_png(brighter, photograph(stand(truth(4, seed=11), 1, printed(BOARD)), light=240.0))
    text = (photographs / "lenses.toml").read_text()
    (tmp_path / "lenses.toml").write_text(text.replace("crop = { left_px = 4, top_px = 2 }\n", ""))
    with pytest.raises(CalibrationFailed) as refused:
        run_lenses(tmp_path / "lenses.toml", tmp_path / "out.toml")
    lines = str(refused.value).splitlines()
    (changed,) = (line for line in lines if line.lstrip().startswith("pose-1:"))
    assert "the light of gray-column-05 and its inverse" in changed
    assert "automatics" in changed
    assert any("pose-3: has 636 × 478 px, the camera 640 × 480 px" in line for line in lines)


def test_a_view_that_fits_none_is_named(tmp_path: Path, six_views: BoardSightings) -> None:
    xy = six_views.camera_xy_px.copy()
    odd = six_views.view == 2
    xy[odd] = (xy[odd] - 300) * [1.06, 0.97] + 300
    result = run_lenses(write_lists(tmp_path, replace(six_views, camera_xy_px=xy)), tmp_path / "out.toml")
    assert any(line.startswith("2.png: fits none of the lenses") and "zoom" in line for line in result.warnings)
    assert not result.within_limits


def test_stretched_pictures_are_told_by_pixels_that_are_not_square(tmp_path: Path, six_views: BoardSightings) -> None:
    stretched = replace(six_views, camera_xy_px=six_views.camera_xy_px * [0.9, 1.0])
    result = run_lenses(write_lists(tmp_path, stretched), tmp_path / "out.toml")
    assert any("the camera's pixels come out 1.11" in line and "stretched" in line for line in result.warnings)
    assert not any("the projector's pixels" in line for line in result.warnings)


def test_a_print_that_is_longer_than_wide_is_told(tmp_path: Path) -> None:
    seen = sightings(replace(truth(6, seed=7), stretch=-0.006))
    alone = replace(seen, projector_by_camera=np.zeros_like(seen.projector_by_camera))
    result = run_lenses(write_lists(tmp_path, alone), tmp_path / "out.toml")
    assert result.stretch == pytest.approx(-0.006, abs=4 * result.stretch_sigma)
    assert any(
        "the board's squares come out 0.6" in line and "shorter down than across" in line for line in result.warnings
    )
    assert any(name == "board.stretch" for name in read_lens_file(tmp_path / "out.toml").joint.parameters)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("square_m = 0.03", "square_m = 30.0", "mistaken by 1000"),
        ("columns = 9", "columns = 8", "lists 54 corners a picture"),
        ("[corners]", '[corners]\nlast_colum = "level"', "did you mean last_column"),
        ('camera = "corners.vnl"', 'camera = "missing.vnl"', "cannot be read"),
        (f"width_px = {CAMERA_SIZE[0]}\n", "", "camera.width_px and camera.height_px: missing"),
    ],
)
def test_a_wrong_manifest_is_refused_with_the_remedy(
    tmp_path: Path, six_views: BoardSightings, old: str, new: str, words: str
) -> None:
    manifest = write_lists(tmp_path, six_views, (HEAD + LISTS).replace(old, new, 1))
    with pytest.raises(ProfileError, match=words):
        run_lenses(manifest, tmp_path / "out.toml")


def test_too_few_boards_are_refused_with_each_pictures_fault(tmp_path: Path) -> None:
    state = truth(2)
    seen = sightings(state)
    with pytest.raises(CalibrationFailed, match=r"2 of 3 views can be used(.|\n)*99.png: has no board"):
        run_lenses(write_lists(tmp_path, seen), tmp_path / "out.toml")


def test_a_list_that_runs_the_other_way_round_is_named(tmp_path: Path, six_views: BoardSightings) -> None:
    xy = six_views.camera_xy_px.copy()
    mirrored = six_views.view == 4
    xy[mirrored, 0] = CAMERA_SIZE[0] - 1 - xy[mirrored, 0]
    result = run_lenses(write_lists(tmp_path, replace(six_views, camera_xy_px=xy)), tmp_path / "out.toml")
    assert any(line.startswith("4.png: is mirrored") for line in result.warnings)
