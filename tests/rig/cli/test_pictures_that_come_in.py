"""Wherever a picture comes in: its colour profile is followed or refused, its transparency never guessed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rig.cli.app import run_command
from rig.stages.target import load_target
from tests.rig.files.test_picture_colours import profile

Capture = pytest.CaptureFixture[str]

ROOM = """
[room]
size_m = [4.8, 4.8, 2.4]
patch_m = 0.8
[paint]
all = 0.7
[projector]
throw_ratio = 0.4
lumens = 3000
contrast = 1000
width_px = 1600
height_px = 1200
position_m = [1.2, 1.2, 1.2]
look_at_m = [2.2, 2.2, 1.1]
[show]
white_cdm2 = 20
pictures = ["picture.png"]
width_px = 64
"""
WAYS = (
    "run {folder}/new -p ci-tiny --target {picture} --fit --dry-run",
    "show {picture} -p ci-tiny --fit --seconds 0.1",
    "live -p ci-tiny --strategy none --source {picture} --seconds 3",
    "plan {folder}/room.toml --report {folder}/plan.html",
)


def said(capsys: Capture, way: str, folder: Path) -> tuple[int, str]:
    (folder / "room.toml").write_text(ROOM, encoding="utf-8")
    status = run_command(way.format(folder=folder, picture=folder / "picture.png").split())
    captured = capsys.readouterr()
    return status, " ".join((captured.err + captured.out).split())


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.split()[0])
def test_a_partly_transparent_picture_is_refused_with_the_remedy(capsys: Capture, tmp_path: Path, way: str) -> None:
    codes = np.full((48, 64, 4), 200, np.uint8)
    codes[:, :32, 3] = 255
    Image.fromarray(codes).save(tmp_path / "picture.png")
    status, words = said(capsys, way, tmp_path)
    assert status == (22 if way.startswith("live") else 2)
    assert "50.00% of its pixels are transparent" in words
    assert "flatten the picture" in words


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.split()[0])
def test_a_profile_that_cannot_be_followed_is_refused_with_the_remedy(
    capsys: Capture, tmp_path: Path, way: str
) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "picture.png", icc_profile=b"\0" * 200)
    status, words = said(capsys, way, tmp_path)
    assert status == (22 if way.startswith("live") else 2)
    assert "its colour profile is damaged; convert the picture to sRGB" in words


@pytest.mark.parametrize("way", [*WAYS[1:], "look -p ci-tiny --show {picture} --fit -o {folder}/look.png"])
def test_a_profile_that_is_followed_is_named(capsys: Capture, tmp_path: Path, way: str) -> None:
    Image.new("RGB", (64, 48), (0, 255, 0)).save(tmp_path / "picture.png", icc_profile=profile())
    status, words = said(capsys, way, tmp_path)
    assert status == 0
    assert "taken as Display P3 (100.0% of its pixels have colours that sRGB lacks" in words


def test_a_sessions_target_names_the_profile_that_was_followed(tmp_path: Path) -> None:
    Image.new("RGB", (64, 48), (0, 255, 0)).save(tmp_path / "picture.png", icc_profile=profile())
    sentence = load_target(tmp_path / "picture.png", (48, 64), channels=3).shown.sentence
    assert sentence.startswith("picture.png, taken as Display P3 (100.0% of its pixels")


def test_a_profile_of_srgb_is_not_worth_a_word(capsys: Capture, tmp_path: Path) -> None:
    Image.new("RGB", (64, 48), (0, 255, 0)).save(tmp_path / "picture.png")
    assert "taken as" not in said(capsys, WAYS[1], tmp_path)[1]
