"""A whole session on the paper's room, everything calibrated from its own captures: the promises in figures.

The simulated world is finer than, integrated otherwise than, and has lens terms beyond the model that is fitted to it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.run.request import SessionRequest
from rig.run.session import run_session
from rig.session import Session
from rig.stages.model import load_model_record
from rig.stages.results import SessionResult
from rig.terminal import silent

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("acceptance") / "room"


@pytest.fixture(scope="module")
def metrics(folder: Path) -> SessionResult:
    return run_session(SessionRequest(folder=folder, profile="sim-room"), silent)


def test_nearly_every_lit_pixel_is_decoded_and_fits_the_geometry(metrics: SessionResult) -> None:
    assert metrics.geometry.valid_share >= 0.90
    assert metrics.geometry.rms_px <= 0.35


def test_pose_lenses_and_walls_are_found(metrics: SessionResult) -> None:
    truth = metrics.truth
    assert truth.camera_position_mm <= 15
    assert truth.camera_rotation_deg <= 0.2
    assert truth.focal_percent <= 0.5
    assert truth.surface_median_mm <= 5


def test_reflectance_is_found_on_seen_and_unseen_patches(metrics: SessionResult) -> None:
    assert metrics.truth.reflectance_rmse <= 0.04
    assert metrics.truth.reflectance_rmse_lit_and_seen <= 0.03


def test_direct_and_global_light_are_separated_without_bias(metrics: SessionResult) -> None:
    assert abs(metrics.truth.direct_bias_percent) <= 1
    assert abs(metrics.truth.global_bias_percent) <= 1


def test_the_model_predicts_frames_that_it_was_not_fitted_to(metrics: SessionResult) -> None:
    assert metrics.comparison.rmse <= 3
    assert abs(metrics.comparison.bias) <= 1


def test_the_bounded_optimum_as_measured_halves_the_error_and_more(metrics: SessionResult) -> None:
    measured = metrics.measured
    assert measured.compensated.mean <= 0.45 * measured.uncompensated.mean
    assert metrics.strategies["direct"].measured.mean > measured.uncompensated.mean
    rms = {name: entry.predicted.rms for name, entry in metrics.strategies.items()}
    assert rms["bounded"] <= min(rms.values()) * 1.01


def test_every_strategy_is_judged_on_the_scale_that_the_session_decided(metrics: SessionResult, folder: Path) -> None:
    with Session.open(folder) as session:
        record = load_model_record(session)
    assert record.level == pytest.approx(0.7 * record.bands[0].white_median)
    assert metrics.model.level == record.level


def test_stale_frames_came_and_none_was_accepted(metrics: SessionResult, folder: Path) -> None:
    with Session.open(folder) as session:
        log = session.frame_log()
        latency_s = session.profile.projector.latency_s
    kinds = {event["note"]["event"] for event in log if event["event"] == "note"}
    assert "stale" in kinds
    started = [event["frame"]["started_s"] for event in log if event["event"] == "frame"]
    # Every accepted frame began at least the display's latency after the one before it had ended.
    ended = [event["frame"]["started_s"] + event["frame"]["exposure_s"] for event in log if event["event"] == "frame"]
    assert all(later - earlier >= latency_s for earlier, later in zip(ended, started[1:], strict=False))


def test_the_report_is_one_file_without_links(metrics: SessionResult, folder: Path) -> None:
    page = (folder / "report.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    for heading in ("What each strategy shows", "Direct and global light", "Room and devices", "Response curves"):
        assert heading in page
    assert f"{metrics.measured.compensated.mean:.2f}" in page
