"""Walls that would face each other and have no end are a corner's: they are not taken for a corridor in silence."""

import numpy as np
import pytest

from calibration.errors import CalibrationError
from calibration.geometry import plane_search
from calibration.geometry.contradictions import hold_against_all
from calibration.geometry.flat.endless import MOST_REACH, check_walls_end, reach
from calibration.geometry.plane_search import candidates
from calibration.geometry.stereo import calibrate_stereo


def corner_seen_from_afar(room):
    """Two walls and a floor by a short baseline: lenses a few percent off make the walls face each other."""
    camera = {
        "shape": (240, 320),
        "focal_px": 185.3,
        "principal_point_px": (158.8, 122.2),
        "distortion": (-0.011, 0.001, 0.0, 0.0, 0.0),
        "position_m": (2.373, 3.239, 1.050),
        "look_at_m": (4.055, 2.157, 1.031),
    }
    projector = {
        "shape": (192, 256),
        "focal_px": 188.3,
        "principal_point_px": (127.7, 207.7),
        "distortion": (-0.040, -0.007, 0.0, 0.0, 0.0),
        "position_m": (2.616, 2.962, 1.027),
        "look_at_m": (4.062, 1.950, 0.087),
    }
    how = {"camera_hfov_deg": 82.2, "projector_hfov_deg": 66.4, "noise_px": 0.03, "outlier_share": 0.0, "seed": 0}
    size_m = (6.607, 5.342, 2.961)
    return room.changed(camera=camera, projector=projector, size_m=size_m, edge_bias_px=0.0, **how)


def shuffled(room, step_px=2):
    x1, x2 = room.correspondences(step_px)
    order = np.random.default_rng(0).permutation(len(x1))[:6000]
    return x1[order], x2[order]


def with_line_errors(x1, x2, line_px=0.06):
    """Codes err by lines: a column or row of the projector is off all along, and its neighbours with it."""
    random = np.random.default_rng([0, 1])
    smooth = np.hanning(7)[1:-1] / np.linalg.norm(np.hanning(7)[1:-1])
    off = [line_px * np.convolve(random.normal(size=270), smooth, "valid") for _ in range(2)]
    lines = np.clip(np.rint(x2).astype(int), 0, 260)
    return x1, x2 + np.column_stack([off[k][lines[:, k]] for k in range(2)])


@pytest.fixture(scope="module")
def seen(room):
    """Points whose errors make a corridor of the corner: it explains them better than the corner does."""
    corner = corner_seen_from_afar(room)
    return corner, *with_line_errors(*shuffled(corner))


@pytest.fixture(scope="module")
def corridor(seen):
    """What the search ends in where nobody asks how far its walls reach, and the points."""
    corner, x1, x2 = seen
    order = np.random.default_rng(0).permutation(len(x1))
    x1, x2 = x1[order], x2[order]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plane_search, "MOST_REACH", np.inf)
        found = next(candidates(x1, x2, corner.nominal, right_angles=True))
    assert sorted(np.bincount(found.axes.of_plane)) == [1, 2], "two walls on one axis, and a floor"
    assert found.share > 0.99, "they explain all that is seen"
    return found, x1, x2


def test_a_corner_is_found_whose_walls_would_rather_face_each_other(seen):
    corner, x1, x2 = seen
    pair = calibrate_stereo(x1, x2, corner.nominal)
    assert sorted(pair.axes) == [0, 1, 2]
    assert pair.camera.focal_px[0] == pytest.approx(corner.camera.focal_px, abs=3 * pair.sigmas["camera_f"])


def test_walls_without_an_end_are_refused_with_how_far_they_reach(seen, corridor):
    (corner, _, _), (found, x1, x2) = seen, corridor
    assert reach(found, x1[: len(found.label)]) > 3 * MOST_REACH
    with pytest.raises(CalibrationError, match=r"lit out to \d+ times the distance between them, the limit is 10"):
        hold_against_all(x1, x2, found, corner.nominal, weight=np.ones_like(x2))


@pytest.mark.parametrize("length_m", [8.0, 14.0])
def test_a_long_corridor_has_an_end(room, length_m):
    long = room.changed(
        faces=("x0", "x1", "floor"),
        size_m=(2.4, length_m, 2.5),
        camera={"position_m": (1.1, 0.6, 1.4), "look_at_m": (1.25, 4.0, 0.9), "focal_px": 400.0},
        projector={"position_m": (0.8, 0.9, 1.2), "look_at_m": (1.1, 4.0, 0.7), "focal_px": 330.0},
        camera_hfov_deg=116.0,
        projector_hfov_deg=114.0,
        outlier_share=0.0,
        edge_bias_px=0.0,
    )
    x1, x2 = shuffled(long, step_px=5)
    found = next(candidates(x1, x2, long.nominal, right_angles=True))
    assert sorted(np.bincount(found.axes.of_plane)) == [1, 2]
    far = reach(found, x1[: len(found.label)])
    assert 0.5 * (length_m - 0.6) / 2.4 < far < 1.1 * length_m / 2.4
    check_walls_end(found, x1[: len(found.label)])


def test_walls_of_a_corner_do_not_face_each_other(room):
    x1, x2 = shuffled(room, step_px=8)
    found = next(candidates(x1, x2, room.nominal, right_angles=True))
    assert reach(found, x1[: len(found.label)]) < 2.0, "floor and ceiling do, and end at the walls"
