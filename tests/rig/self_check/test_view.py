"""Part `view` of `rig check`: figures of what a session's geometry rests on."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.geometry.pinhole import PinholeModel, project
from calibration.structured_light.correspondence import Correspondence
from rig.self_check.parts.view import _parallax_deg
from rig.stages.geometry import BoxSurface, DeviceGeometry, GeometryRecord

SHAPE = (60, 80)
CAMERA = PinholeModel(
    width_px=80,
    height_px=60,
    focal_px=(200.0, 200.0),
    principal_point_px=(39.5, 29.5),
    distortion=(0.0,) * 5,
    rotation=np.eye(3),
    translation_m=np.zeros(3),
)


@pytest.mark.parametrize("baseline_m", [0.2, 0.02])
def test_parallax_is_the_angle_at_which_both_look_at_a_wall(baseline_m: float) -> None:
    projector = replace(CAMERA, translation_m=np.array([-baseline_m, 0, 0]))
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    wall = np.stack([(column - 39.5) / 100, (row - 29.5) / 100, np.full(SHAPE, 2.0)], axis=-1)
    lit = project(projector, wall.reshape(-1, 3)).reshape(*SHAPE, 2).astype(np.float32)
    geometry = GeometryRecord(
        cameras={"camera": DeviceGeometry.of(CAMERA, 0.1)},
        projectors={"projector": DeviceGeometry.of(projector, 0.1)},
        surface=BoxSurface(size_m=(1.0, 1.0, 1.0), seen=("x1",), faces=("x1",), angle_error_deg=0.0, notes=""),
        baseline_m=baseline_m,
        rms_px=0.1,
        inlier_share=1.0,
        sigmas={},
    )
    found = _parallax_deg(geometry, Correspondence(lit, np.zeros(SHAPE, np.uint8), SHAPE))
    assert found == pytest.approx(np.degrees(np.arctan(baseline_m / 2.0)), rel=0.05)
