"""A furnished room from two positions of the camera: what one does not see the other measures, or it is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from calibration.errors import CalibrationError
from rig.errors import UsageError
from rig.profile.schema import load_profile
from rig.run.request import SessionRequest
from rig.run.session import run_part
from rig.session import Session
from rig.stages.geometry import geometry_settings, load_geometry
from rig.stages.model import model_settings
from rig.stages.surface.standing import StandingRecord, standing_of
from rig.terminal import silent
from tests.rig.run.test_free_surface_session import SMALL

pytest.importorskip("embreex", reason="the furnished world is traced by Embree: pip install 'procam-rig[world]'")
pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
CAMERA = "position_m = [0.60, 1.42, 1.38]\nlook_at_m = [4.60, 4.55, 1.12]"
PROJECTOR_M = (1.0, 1.0, 1.2)
LEFT, RIGHT = ((0.45, 2.7, 1.4), (4.4, 3.3, 1.0)), ((1.5, 0.55, 1.75), (4.4, 4.7, 1.0))
BOX_SIDE_M, BOX_TURN_DEG = (2.73, 3.18), 28.0
"""Middle of the box's side that the left position does not see, and how it is turned about the vertical."""


def text_of(position_m, look_at_m, projector_m=PROJECTOR_M):
    text = (ROOT / "hw_profiles" / "sim-furnished.toml").read_text("utf-8")
    for old, new in SMALL.items():
        text = text.replace(old, new)
    assert CAMERA in text
    text = text.replace(CAMERA, f"position_m = {list(position_m)}\nlook_at_m = {list(look_at_m)}")
    text = text.replace("position_m = [1.00, 1.00, 1.20]", f"position_m = {list(projector_m)}")
    return text.replace("baseline_m = 0.607", f"baseline_m = {math.dist(position_m, projector_m):.3f}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Calibrated sessions: left, right, and right after the projector was moved by 6 cm."""
    made = tmp_path_factory.mktemp("positions")
    texts = {"left": text_of(*LEFT), "right": text_of(*RIGHT), "moved": text_of(*RIGHT, (1.05, 0.97, 1.2))}
    for name, text in texts.items():
        (made / f"{name}.toml").write_text(text, "utf-8")
        run_part(SessionRequest(folder=made / "runs" / name, profile=made / f"{name}.toml"), "calibrate")
    return made


def left_with(folder: Path, *also: str) -> Session:
    """The left session, whose profile names others."""
    text = (folder / "left.toml").read_text("utf-8").replace('kind = "free"', f'kind = "free"\nalso = {list(also)}')
    path = folder / f"left-{len(also)}.toml"
    path.write_text(text.replace("'", '"'), "utf-8")
    session = Session.read(folder / "runs" / "left")
    session.profile = load_profile(path)
    return session


def standing(session: Session) -> StandingRecord:
    found = standing_of(session, load_geometry(session), (0.0, 0.0, 0.0))
    assert found is not None
    return found.record


def share_of_box_side(record: StandingRecord) -> float:
    """Of a grid over the middle of the box's hidden side, what lies on a triangle that is within 2 cm of the side."""
    turn = math.radians(BOX_TURN_DEG)
    frame = np.array([[math.cos(turn), math.sin(turn), 0], [0, 0, 1], [math.sin(turn), -math.cos(turn), 0]])
    corners = (np.array(record.vertices_m) - (*BOX_SIDE_M, 0.0)) @ frame.T
    triangles = corners[np.array(record.triangles)]
    flat = triangles[(np.abs(triangles[:, :, 2]) < 0.02).all(axis=1)]
    grid = np.stack(np.meshgrid(np.linspace(-0.1, 0.15, 11), np.linspace(0.1, 0.45, 11), 0.0), axis=-1)
    places = grid.reshape(-1, 1, 3)
    sides = [np.cross(flat[:, (i + 1) % 3] - flat[:, i], places - flat[:, i])[..., 2] for i in range(3)]
    inside = np.all([side >= 0 for side in sides], axis=0) | np.all([side <= 0 for side in sides], axis=0)
    return float(inside.any(axis=1).mean())


def test_a_side_that_the_camera_does_not_see_is_measured_from_elsewhere(folder):
    alone, both = standing(left_with(folder)), standing(left_with(folder, "runs/right"))
    (position,) = both.positions
    assert share_of_box_side(alone) == 0
    assert share_of_box_side(both) > 0.9
    assert 0.15 < position.area_m2 < 0.35, "the lit part of a side of 0.5 m x 0.55 m, and of legs"
    corners_m = np.array(both.vertices_m)[np.array(both.triangles)]
    on_top = (np.abs(corners_m[..., 2] - 0.74) < 0.01).all(axis=1)
    assert corners_m[on_top][..., 0].max() > 3.9, "the table's top, 0.74 m high, is measured to its far end"
    assert np.linalg.norm(np.array(position.camera_m) - RIGHT[0]) < 0.01
    assert position.share_of_seen > 0.7
    assert position.median_apart < 1e-3
    assert 0.7 < position.apart_sigmas < 1.5
    assert both.share_of_image == pytest.approx(alone.share_of_image, rel=0.02), "what this camera sees is its own"


def test_the_model_rests_on_the_other_session_and_the_geometry_does_not(folder):
    alone, both = left_with(folder), left_with(folder, "runs/right")
    assert "also" not in model_settings(alone)
    sessions = model_settings(both)["also"]
    other = Session.read(folder / "runs" / "right")
    assert sessions == [[other.finished(step).outputs_sha256 for step in ("correspondence", "geometry")]]
    assert geometry_settings(both) == geometry_settings(alone)


def test_a_projector_that_moved_in_between_is_named(folder):
    with pytest.raises(
        CalibrationError, match=r"The projector moved between the two: by [56]\.\d cm and \d\.\d+ degrees"
    ):
        standing(left_with(folder, "runs/moved"))


def test_sessions_that_cannot_be_used_are_refused_by_name(folder):
    with pytest.raises(UsageError, match=r"nowhere: there is no session here, which \[surface\] also names"):
        model_settings(left_with(folder, "runs/nowhere"))
    with pytest.raises(UsageError, match=r"names a session twice, or .*left itself"):
        model_settings(left_with(folder, "runs/left"))
    with pytest.raises(UsageError, match="names a session twice"):
        model_settings(left_with(folder, "runs/right", "runs/../runs/right"))
    text = (
        text_of(*RIGHT)
        .replace('name = "projector"', 'name = "beamer"')
        .replace('"camera", "projector"', '"camera", "beamer"')
    )
    (folder / "beamer.toml").write_text(text, "utf-8")
    with Session.open(folder / "runs" / "beamer", load_profile(folder / "beamer.toml")):
        pass
    with pytest.raises(UsageError, match="has projector 'beamer' of 320 x 240 px"):
        model_settings(left_with(folder, "runs/beamer"))


def test_a_model_is_built_with_it(folder):
    profile = left_with(folder, "runs/right").profile
    result = run_part(SessionRequest(folder=folder / "runs" / "left", profile=profile.path), "model", silent)
    assert result.model is not None
    assert result.model.standing is not None
    assert [one.session for one in result.model.standing.positions] == ["runs/right"]
