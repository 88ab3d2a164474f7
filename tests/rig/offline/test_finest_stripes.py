"""A camera that sees two stripes in one pixel: the code is read without them, and it is said."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.structured_light.gray import gray_code_patterns
from calibration.structured_light.patterns import flat
from rig.devices.replay.photographs import load_manifest, load_photographs
from rig.offline.finest_stripes import ResolvedCode, read_resolved

SHAPE = (96, 160)
"""Of the projector."""
LIMIT_DN = 4.5


def photographed(folder: Path, pixels_across: float, axes: tuple[str, ...] = ("column", "row")) -> ResolvedCode:
    """A wall straight before both devices, each camera pixel as wide as so many of the projector's."""
    size = tuple(round(side / pixels_across) for side in SHAPE[::-1])
    random = np.random.default_rng(5)
    patterns = [flat(SHAPE, 255, "white"), flat(SHAPE, 0, "black"), *gray_code_patterns(SHAPE)]
    for pattern in patterns:
        seen = cv2.resize(pattern.codes.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        levels = 20 + 0.7 * cv2.GaussianBlur(seen, (0, 0), 0.5) + random.normal(0, 0.5, seen.shape)
        cv2.imwrite(str(folder / f"{pattern.name}.png"), np.clip(np.rint(levels), 0, 255).astype(np.uint8))
    names = sorted((pattern.name for pattern in patterns if pattern.name.startswith("gray-")), reverse=True)
    lines = ["schema = 1", "[camera]", f"width_px = {size[0]}", f"height_px = {size[1]}", "full_scale_dn = 255"]
    lines += ["[projector]", f"width_px = {SHAPE[1]}", f"height_px = {SHAPE[0]}", "[gray_code]"]
    for axis in axes:
        of_axis = [f"{name}.png" for name in names if f"-{axis}-" in name]
        lines += [f"{axis}s = {[name for name in of_axis if 'inverse' not in name]}"]
        lines += [f"{axis}s_inverse = {[name for name in of_axis if 'inverse' in name]}"]
    lines += ["[frames]", 'white = "white.png"', 'black = "black.png"']
    (folder / "replay.toml").write_text("\n".join(lines), encoding="utf-8")
    manifest = load_manifest(folder / "replay.toml")
    return read_resolved(manifest, load_photographs(manifest), LIMIT_DN)


def worst_px(read: ResolvedCode, pixels_across: float) -> float:
    """By which any code that is given is off, in the projector's pixels."""
    found = read.correspondence
    row, column = np.nonzero(found.valid)
    true = (np.column_stack([column, row]) + 0.5) * pixels_across - 0.5
    return float(np.nanmax(np.abs(found.projector_xy_px[row, column] - true)))


@pytest.mark.parametrize("pixels_across", [0.25, 0.5, 1.0])
def test_stripes_that_a_camera_resolves_are_all_read(tmp_path: Path, pixels_across: float) -> None:
    read = photographed(tmp_path, pixels_across)
    assert read.manifest.finest_bit == 0
    assert read.mended == ()
    assert read.correspondence.valid.mean() > 0.7


def test_stripes_finer_than_a_camera_pixel_are_left_out_and_named(tmp_path: Path) -> None:
    read = photographed(tmp_path, 2.0)
    assert read.manifest.finest_bit == 1
    assert read.correspondence.valid.mean() > 0.7
    assert worst_px(read, 2.0) <= 1
    (told,) = read.mended
    assert "gray-column-00.png (gray-column-00)" in told
    assert "gray-row-00-inverse" in told
    assert "cells of 2 projector pixels" in told


def test_a_code_of_columns_alone_is_read_so_too(tmp_path: Path) -> None:
    read = photographed(tmp_path, 2.0, axes=("column",))
    assert read.manifest.finest_bit == 1
    assert read.correspondence.valid.mean() > 0.7
