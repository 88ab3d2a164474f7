"""A session whose room sends so much light back that the code is shown again, with fewer lights on."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration import CODES
from rig.devices.simulated.optics import pixels_of
from rig.profile.schema import Profile, load_profile
from rig.run.script import open_rig
from rig.run.steps import STEPS, ShootingStep
from rig.session import Session
from rig.stages.correspondence import decode_gray_code, load_correspondence, load_correspondence_figures
from rig.stages.photograph import frame_name
from rig.stages.radiometry import load_radiometric_calibration
from rig.stages.stripes.reading import read_code
from rig.terminal import silent
from rig.truth.scores import ground_truth_worlds

if TYPE_CHECKING:
    from tests.rig.conftest import Finished


def profile_of(folder: Path, reflectance: float, code: str) -> Profile:
    """The tiny rig in a room that reflects evenly."""
    text = load_profile("ci-tiny").path.read_text(encoding="utf-8")
    head, tail = text.split("[simulation.reflectance]")
    walls = re.sub(r"(?m)^(floor|ceiling|[xy][01]) = .*$", rf"\1 = {reflectance}", tail)
    text = f"{head}[simulation.reflectance]{walls}".replace("[patterns]", f'[patterns]\ncode = "{code}"')
    text = text.replace("response_levels = 9", "response_levels = 5")
    (folder / "profile.toml").write_text(text)
    return load_profile(folder / "profile.toml")


def out_of_focus(folder: Path, profile: Profile, blur_px: float) -> Profile:
    """The same rig behind a projector that is out of focus."""
    text = profile.path.read_text(encoding="utf-8")
    (folder / "blurred.toml").write_text(re.sub(r"(?m)^blur_px = 0.5$", f"blur_px = {blur_px}", text))
    return load_profile(folder / "blurred.toml")


def correspond(folder: Path, profile: Profile) -> tuple[float, float | None, float]:
    """Valid share, that of the first time, and share of the valid pixels that are more than 2 px off."""
    with Session.open(folder / "session", profile) as session, open_rig(profile) as rig:
        for definition in STEPS[:4]:
            step = session.step(definition.name, settings=definition.settings(session), needs=definition.needs)
            if isinstance(definition, ShootingStep):
                definition.shoot(rig, session, step, silent)
            else:
                decode_gray_code(session, step, silent)
            step.finish()
        (world,) = ground_truth_worlds(rig)
        found, figures = load_correspondence(session), load_correspondence_figures(session)
        true = pixels_of(world.projector, world.surface.points_m)
        off = np.linalg.norm(found.projector_xy_px - true, axis=-1)[found.valid]
        return figures.valid_share_of_image, figures.valid_share_at_first, float(np.nanmean(off > 2))


def test_a_room_of_white_walls_is_read_in_parts(tmp_path: Path) -> None:
    valid, at_first, wrong = correspond(tmp_path, profile_of(tmp_path, 0.9, "gray"))
    assert at_first is not None
    assert valid > 4 * at_first
    assert wrong < 0.01


def test_where_nothing_is_spoilt_no_photograph_more_is_taken(finished: "Finished") -> None:
    session = Session.read(finished.folder)
    assert load_correspondence_figures(session).valid_share_at_first is None
    assert not [name for name in session.finished("gray").frame_names if "again" in name]


def test_stripes_that_the_lenses_blur_away_are_shown_again_wider(tmp_path: Path) -> None:
    profile = out_of_focus(tmp_path, profile_of(tmp_path, 0.5, "long-run"), 3.0)
    valid, _, wrong = correspond(tmp_path, profile)
    session = Session.read(tmp_path / "session")
    assert load_correspondence_figures(session).stripes_times > 1
    gray = session.finished("gray")
    as_fine = read_code(
        CODES["long-run"],
        lambda name: gray.load_frame(frame_name(name)).pixels,
        profile.projector.shape,
        load_radiometric_calibration(session),
    )
    assert valid > 1.2 * as_fine.valid.mean()
    assert wrong < 0.03
