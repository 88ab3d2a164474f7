"""A whole session before one flat wall of an open scene: geometry by data sheets, a compensated picture, a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from calibration.errors import CalibrationError
from rig.devices.simulated.rigs import box_world_of
from rig.profile.schema import load_profile
from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.self_check import run_check
from rig.session import Session
from rig.stages.correspondence import load_correspondence
from rig.stages.geometry import geometry_of
from rig.stages.model import load_model
from rig.stages.results import SessionResult
from rig.terminal import silent

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
ONE_WALL = {
    'name = "ci-tiny"': 'name = "ci-wall"',
    "closed = true": "closed = false",
    "\nsize_m = [4.80, 4.80, 2.40]": "\n#",
    "\nhfov_deg = 100.0": "\nhfov_deg = 55.0",
    "\nhfov_deg = 98.0": "\nhfov_deg = 49.0",
    "distance_m = 4.876": "distance_m = 1.7793",
    "position_m = [0.60, 1.42, 1.38]": "position_m = [1.9, 3.25, 1.40]",
    "look_at_m = [4.60, 4.55, 1.12]": "look_at_m = [4.8, 2.42, 1.24]",
    "focal_px = 132.925": "focal_px = 315.0",
    "position_m = [1.00, 1.00, 1.20]": "position_m = [2.0, 2.3, 1.25]",
    "look_at_m = [4.80, 4.72, 1.20]": "look_at_m = [4.8, 2.4, 1.2]",
    "focal_px = 107.8": "focal_px = 283.0",
}


def profile_file(folder: Path, **changes: str) -> Path:
    """The tiny rig, aimed at one wall of its room."""
    text = (ROOT / "hw_profiles" / "ci-tiny.toml").read_text("utf-8")
    for old, new in {**ONE_WALL, **changes}.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "ci-wall.toml"
    path.write_text(text, "utf-8")
    return path


@dataclass(frozen=True)
class OneWall:
    """A finished session; tests only read it."""

    folder: Path
    result: SessionResult


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> OneWall:
    folder = tmp_path_factory.mktemp("wall")
    request = SessionRequest(folder=folder / "session", profile=profile_file(folder))
    return OneWall(folder / "session", run_session(request, silent))


def test_it_ends_with_a_report(wall: OneWall) -> None:
    page = (wall.folder / "report.html").read_text("utf-8")
    assert "One flat wall: the lenses rest on hfov_deg" in page
    assert wall.result.geometry.faces_seen == ("x0",)


def test_direct_compensation_evens_out_what_no_compensation_leaves(wall: OneWall) -> None:
    """Direct compensation knows nothing of the light that comes back, so its mean is off, its evenness is not."""
    errors = {name: strategy.measured for name, strategy in wall.result.strategies.items()}
    assert errors["direct"].sd < 0.5 * errors["none"].sd
    assert errors["direct"].rms < errors["none"].rms


def test_light_that_comes_back_from_the_unseen_room_is_compensated(wall: OneWall) -> None:
    errors = {name: strategy.measured for name, strategy in wall.result.strategies.items()}
    assert errors["bounded"].mean < 0.3 * errors["none"].mean
    assert abs(errors["bounded"].bias) < 2


def test_the_verdict_names_how_badly_lengths_are_known(wall: OneWall) -> None:
    lengths = next(verdict for verdict in wall.result.limits if "uncertainty of the room's lengths" in verdict.what)
    assert not lengths.met
    assert lengths.value == pytest.approx(
        100 * wall.result.geometry.sigmas["baseline_m"] / wall.result.geometry.baseline_m
    )


def test_the_pose_lies_within_three_sigmas_of_the_simulated_worlds(wall: OneWall) -> None:
    sigmas, truth = wall.result.geometry.sigmas, wall.result.truth
    assert truth is not None
    of_position_mm = 1000 * np.linalg.norm([sigmas[f"relative_{axis}_m"] for axis in "xyz"])
    of_rotation_deg = np.linalg.norm([sigmas[f"relative_rotation_{axis}_deg"] for axis in "xyz"])
    assert truth.camera_position_mm < 3 * of_position_mm
    assert truth.camera_rotation_deg < 3 * of_rotation_deg


@pytest.mark.parametrize("half", ["left", "top"])
def test_the_light_of_half_a_picture_comes_back_as_the_model_says_to_a_fifth(wall: OneWall, half: str) -> None:
    with Session.open(wall.folder) as session:
        model, world = load_model(session), box_world_of(session.profile)
    height, width = world.projector.shape
    codes = {name: np.zeros((height, width), np.uint8) for name in ("black", "white", "left", "top")}
    codes["white"][:], codes["left"][:, : width // 2], codes["top"][: height // 2] = 255, 255, 255
    light = {name: (world.light(code).global_ * world.vignetting)[model.lit] for name, code in codes.items()}
    transport = model.room.camera_transport.bands[0].global_
    modelled = {name: (transport @ (codes[name].ravel() / 255.0))[model.lit.ravel()] for name in ("white", half)}
    true = {name: light[name] - light["black"] for name in ("white", half)}
    unit = true["white"].mean() / modelled["white"].mean()
    error = unit * modelled[half] / true[half] - 1
    assert np.sqrt(np.mean(error**2)) < 0.2


def test_a_closed_room_is_not_modelled_from_one_wall(wall: OneWall, tmp_path: Path) -> None:
    closed = load_profile(profile_file(tmp_path, **{"closed = false": "closed = true"}))
    with Session.open(wall.folder) as session:
        correspondence = load_correspondence(session)
    with pytest.raises(CalibrationError, match=r"aim at a corner.* set closed = false in \[surface\]"):
        geometry_of(correspondence, closed, silent)


@pytest.mark.parametrize("is_closed", [True, False])
def test_rig_check_wants_two_walls_of_a_closed_room_only(tmp_path: Path, is_closed: bool) -> None:
    changes = {"closed = false": "closed = true"} if is_closed else {}
    result = run_check(str(profile_file(tmp_path, **changes)), silent, only=["view"])
    rows = {row.what: row for _, row in result.rows}
    walls, distance = rows["walls that are told apart"], rows["distance of camera and projector"]
    assert walls.met is not is_closed
    assert ("closed = false" in walls.advice) is is_closed
    assert ("One flat wall: the lenses rest on hfov_deg" in distance.advice) is not is_closed
