"""One finished session and one folder of photographs, shared by all pages."""

import shutil
from contextlib import chdir
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.structured_light.gray import gray_code_patterns
from rig.files.pictures import write_png
from rig.profile.schema import load_profile
from tests.made_once import made_once

ROOT = Path(__file__).parents[2]

CAMERA_SHAPE, PROJECTOR_SHAPE, BITS = (150, 200), (96, 128), 7
MANIFEST = """
schema = 1
[camera]
width_px = 200
height_px = 150
full_scale_dn = 255
[camera.lens]
focal_px = [220.0, 220.0]
principal_point_px = [100.0, 75.0]
[projector]
width_px = 128
height_px = 96
[projector.lens]
focal_px = [150.0, 150.0]
principal_point_px = [64.0, 48.0]
[projector_from_camera]
rotation = [1.0, 0.0, 0.0,  0.0, 1.0, 0.0,  0.0, 0.0, 1.0]
translation = [-150.0, 0.0, 0.0]
unit = "mm"
[gray_code]
"""


HALL = """v 0 0 0
v 5 0 0
v 5 4 0
v 0 4 0
v 0 0 3
v 5 0 3
v 5 4 3
v 0 4 3
f 1 2 3 4
f 8 7 6 5
f 1 5 6 2
f 2 6 7 3
f 3 7 8 4
f 4 8 5 1
"""
"""A hall of 5 x 4 x 3 m, seen from inside."""


def photograph_a_wall(folder: Path) -> None:
    """A wall 0.8 m away, lit with Gray code from 150 mm beside the camera; `replay.toml` names the pictures."""
    row, column = np.mgrid[: CAMERA_SHAPE[0], : CAMERA_SHAPE[1]].astype(np.float32)
    shown_column = 64 + (column - 100) / 220 * 150 - np.float32(150 * 150 / 800)
    shown_row = 48 + (row - 75) / 220 * 150
    for pattern in gray_code_patterns(PROJECTOR_SHAPE):
        lit = cv2.remap(pattern.codes, shown_column, shown_row, cv2.INTER_NEAREST)
        write_png(folder / f"{pattern.name}.png", (20 + 0.6 * lit.astype(np.float64)).astype(np.uint8))
    lists = [
        f"{axis}s{tail.replace('-', '_')} = "
        + str([f"gray-{axis}-{bit:02d}{tail}.png" for bit in reversed(range(BITS))])
        for axis in ("column", "row")
        for tail in ("", "-inverse")
    ]
    (folder / "replay.toml").write_text(MANIFEST + "\n".join(lists), encoding="utf-8")


@pytest.fixture(scope="session")
def compared_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The session that the tutorial's first script makes; copy it before you change it."""
    return made_once(tmp_path_factory, "tutorial", _first_session) / "first"


def _first_session(folder: Path) -> None:
    page = (ROOT / "docs" / "tutorials" / "first-session.md").read_text(encoding="utf-8")
    script = page.split("```python\n")[1].split("```")[0]
    with chdir(folder):
        exec(compile(script, "first-session.md", "exec"), {})


@pytest.fixture
def reader(tmp_path: Path, compared_session: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which somebody who follows the pages sits, with the sessions and photographs they speak of."""
    photograph_a_wall(tmp_path)
    (tmp_path / "hall.obj").write_text(HALL, encoding="utf-8")
    for name in ("first", "runs/first", "runs/room"):
        shutil.copytree(compared_session, tmp_path / name)
    height, width = load_profile("ci-tiny").projector.shape
    ramp = np.tile(np.linspace(20, 180, width), (height, 1)).astype(np.uint8)
    write_png(tmp_path / "picture.png", ramp)
    monkeypatch.chdir(tmp_path)
    return tmp_path
