"""A plan's pictures from files: read once however often they are shown, and anew where the file has changed."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rig.files.pictures import PictureLevels, read_picture_in_channels
from rig.plan import shown
from rig.plan.shown import colours_told, picture_levels

SHAPE = (12, 16)


def written(folder: Path, code: int, shape: tuple[int, int] = SHAPE) -> str:
    path = folder / "picture.png"
    assert cv2.imwrite(str(path), np.full((*shape, 3), code, np.uint8))
    return str(path)


def test_a_file_that_is_shown_again_and_again_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = written(tmp_path, 128)
    times: list[Path] = []

    def counted(path: Path, *, channels: int) -> PictureLevels:
        times.append(path)
        return read_picture_in_channels(path, channels=channels)

    monkeypatch.setattr(shown, "read_picture_in_channels", counted)
    first = picture_levels(name, SHAPE)
    smaller = picture_levels(name, (6, 8))
    assert colours_told((name, "white", "grey:0.5")) == []
    assert len(times) == 1
    assert first.shape == SHAPE
    np.testing.assert_allclose(smaller, 255 * ((128 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-5)


def test_a_file_that_was_changed_is_read_anew(tmp_path: Path) -> None:
    before = picture_levels(written(tmp_path, 128), SHAPE)
    after = picture_levels(written(tmp_path, 200, (13, 16)), SHAPE)
    assert after.min() > 2 * before.max()
