"""A picture lands where it is wanted, and nothing lands where it must stay dark."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.cli.options import PlaceOptions
from rig.errors import ProfileError, UsageError
from rig.profile.schema import load_profile
from rig.profile.target_table import TargetTable
from rig.session import Session
from rig.stages.model import FittedScene, load_model
from rig.stages.prediction import whole_picture
from rig.stages.showing.cube import cube_places
from rig.stages.showing.dark import dark_settings
from rig.stages.showing.place import placed
from rig.stages.showing.surfaces import surface_frame
from rig.stages.target import Target, check_shape
from sim.compensation import compensate
from tests.rig.conftest import Finished


@pytest.fixture(scope="module")
def model(finished: Finished) -> FittedScene:
    return load_model(Session.read(finished.folder))


def picture(levels, **where) -> Target:
    return Target(name="picture", levels=np.asarray(levels, np.float32)[..., None], place=TargetTable(**where))


def seen_at(model: FittedScene, target: Target) -> tuple[np.ndarray, np.ndarray]:
    """Levels that the projector's steered pixels have to show, and where their light lands."""
    active = model.room.active
    levels = placed(model, target).levels.reshape(-1)[active]
    return levels, model.scene_model.projector_hits.points_m[active]


def test_a_panorama_shows_each_direction_its_colour(model: FittedScene) -> None:
    viewer = np.array([1.0, 1.0, 1.1])
    height = np.repeat(np.linspace(250, 5, 180)[:, None], 360, axis=1)
    levels, points = seen_at(model, picture(height, placed="panorama", viewer_m=tuple(viewer)))
    away = points - viewer
    elevation = np.arcsin(away[:, 2] / np.linalg.norm(away, axis=1))
    expected = 127.5 + 245 / 180 * (180 / 179) * np.degrees(elevation)
    assert levels == pytest.approx(expected, abs=1.5)


def test_the_middle_of_a_panorama_lies_ahead_and_turns_to_the_right(model: FittedScene) -> None:
    viewer = model.scene_model.projector.pose.position_m
    ahead = model.scene_model.projector.pose.rotation[2]
    stripe = np.zeros((180, 360))
    stripe[:, 178:182] = 255
    for turn in (0.0, 20.0):
        levels, points = seen_at(
            model, picture(stripe, placed="panorama", viewer_m=tuple(viewer.tolist()), turn_deg=turn)
        )
        away = points[levels > 200] - viewer
        azimuth = np.degrees(np.arctan2(away[:, 1], away[:, 0]) - np.arctan2(ahead[1], ahead[0]))
        assert (azimuth + 180) % 360 - 180 == pytest.approx(-turn, abs=3)


def test_the_squares_of_a_cube_lie_about_the_viewer_and_join() -> None:
    ahead, right, up = np.eye(3)
    cross, side = (300, 400), 100
    middles = cube_places(np.array([ahead, right, -right, up, -up, -ahead]), cross)
    squares = np.floor(middles / side).astype(int).tolist()
    assert squares == [[1, 1], [2, 1], [0, 1], [1, 0], [1, 2], [3, 1]]
    # Beside the edge between two squares both sides are next to each other in a cross.
    for edge in (right, -right, up, -up):
        before, after = cube_places(np.array([ahead + 0.97 * edge, ahead + 1.03 * edge]), cross)
        assert np.linalg.norm(after - before) < 5
    strip = cube_places(np.array([right, -right, up, -up, ahead, -ahead]), (100, 600))
    assert np.floor(strip[:, 0] / 100).astype(int).tolist() == [0, 1, 2, 3, 4, 5]


def test_a_picture_on_a_wall_stays_on_it_and_has_its_corners_where_they_are_wanted(model: FittedScene) -> None:
    name = next(wall for wall in model.scene_model.walls if wall in ("x1", "y1"))
    frame = surface_frame(model.scene_model, name)
    ramp = np.repeat(np.linspace(50, 250, 101)[None], 60, axis=0)
    low, high = 0.2 * np.array(frame.size_m), 0.8 * np.array(frame.size_m)
    corners = ((low[0], high[1]), (high[0], high[1]), (high[0], low[1]), (low[0], low[1]))
    levels, points = seen_at(model, picture(ramp, placed="surface", surface=name, corners_m=corners))
    across, up = (points - frame.origin_m) @ frame.right, (points - frame.origin_m) @ frame.up
    off_wall = np.abs((points - frame.origin_m) @ np.cross(frame.right, frame.up)) > 0.05
    inside = (across > low[0] + 0.1) & (across < high[0] - 0.1) & (up > low[1] + 0.1) & (up < high[1] - 0.1)
    inside &= ~off_wall
    assert inside.sum() > 100
    share = (across[inside] - low[0]) / (high[0] - low[0])
    assert levels[inside] == pytest.approx(50 + 200 * share, abs=4)
    assert levels[off_wall].max() == 0


def test_a_picture_as_the_camera_sees_it_is_sampled_where_the_camera_looks(model: FittedScene) -> None:
    height, width = model.scene_model.camera.lens.shape
    columns = np.repeat(np.linspace(0, 255, width)[None], height, axis=0)
    levels, _ = seen_at(model, picture(columns, placed="camera"))
    there = model.scene_model.camera_xy_px[model.room.active]
    assert levels == pytest.approx(255 * there[:, 0] / (width - 1), abs=1.5)


def test_places_that_are_none_are_refused_in_words(model: FittedScene) -> None:
    grey = np.full((100, 200), 128.0)
    with pytest.raises(UsageError, match="outside of the room"):
        placed(model, picture(grey, placed="panorama", viewer_m=(-3.0, 1.0, 1.0)))
    with pytest.raises(UsageError, match="no surface 'x7'; it has"):
        placed(model, picture(grey, placed="surface", surface="x7"))
    backwards = picture(
        grey, placed="surface", surface=model.scene_model.walls[0], corners_m=((0, 0), (1, 0), (1, 1), (0, 1))
    )
    with pytest.raises(UsageError, match="go round no quadrilateral"):
        placed(model, backwards)
    with pytest.raises(UsageError, match="twice as wide"):
        check_shape(
            picture(np.zeros((100, 150)), placed="panorama", viewer_m=(1, 1, 1)),
            TargetTable(placed="panorama", viewer_m=(1, 1, 1)),
            (10, 10),
        )
    with pytest.raises(UsageError, match="needs viewer_m"):
        PlaceOptions(placed="cube").table()
    with pytest.raises(UsageError, match="give 3 numbers"):
        PlaceOptions(viewer="1,2").table()
    assert PlaceOptions().table() is None
    assert PlaceOptions(on="x1").table() == TargetTable(placed="surface", surface="x1")


def masked(finished: Finished, folder: Path, mask: np.ndarray, *, seen_by: str) -> Session:
    cv2.imwrite(str(folder / "mask.png"), mask)
    text = (finished.folder / "profile.toml").read_text("utf-8")
    (folder / "dark.toml").write_text(f'{text}\n[target]\ndark = "mask.png"\ndark_seen_by = "{seen_by}"\n', "utf-8")
    return Session.read(finished.folder, load_profile(folder / "dark.toml"))


@pytest.mark.parametrize("seen_by", ["camera", "projector"])
def test_no_light_goes_to_what_must_stay_dark(
    finished: Finished, model: FittedScene, tmp_path: Path, seen_by: str
) -> None:
    device = model.scene_model.camera if seen_by == "camera" else model.scene_model.projector
    height, width = device.lens.shape
    mask = np.full((height, width), 255, np.uint8)
    mask[height // 3 : height // 2, width // 3 : width // 2] = 0
    session = masked(finished, tmp_path, mask, seen_by=seen_by)
    dark = load_model(session)
    xy = model.scene_model.camera_xy_px if seen_by == "camera" else model.scene_model.projector.lens.pixel_grid()
    column, row = xy.T
    within = (row > height / 3) & (row < height / 2 - 1) & (column > width / 3) & (column < width / 2 - 1)
    assert (within & model.room.active).sum() > 100
    assert not dark.room.active[within].any()
    assert dark.room.active.sum() > 0.8 * model.room.active.sum()
    transport = dark.room.projector_transport
    wanted = np.full((transport.bands[0].shape[1], 1), 0.5 * dark.level)
    for strategy in ("none", "exact", "bounded"):
        shown = whole_picture(dark, compensate(strategy, transport, wanted).projector_image)
        assert shown.reshape(-1)[within].max() == 0
        assert shown.max() > 0
    assert dark_settings(session.profile)["dark_sha256"]


def test_a_mask_of_another_size_or_without_anything_free_is_refused(
    finished: Finished, model: FittedScene, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match="paint it over a picture"):
        load_model(masked(finished, tmp_path, np.full((7, 9), 255, np.uint8), seen_by="camera"))
    shape = model.scene_model.camera.lens.shape
    with pytest.raises(UsageError, match="all of the mask is black"):
        load_model(masked(finished, tmp_path, np.zeros(shape, np.uint8), seen_by="camera"))
    (tmp_path / "mask.png").unlink()
    with pytest.raises(UsageError, match="no such file, which"):
        dark_settings(load_profile(tmp_path / "dark.toml"))


def test_a_profile_says_all_that_a_place_needs(finished: Finished, tmp_path: Path) -> None:
    text = (finished.folder / "profile.toml").read_text("utf-8")
    (tmp_path / "bad.toml").write_text(f'{text}\n[target]\nplaced = "surface"\n', "utf-8")
    with pytest.raises(ProfileError, match="needs surface"):
        load_profile(tmp_path / "bad.toml")
