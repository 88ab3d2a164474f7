"""`rig lenses` as people run it, with photographs that cannot be used: each is named with its fault and the remedy."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration import CODES
from calibration.lenses.boards import Board
from rig.cli.app import run_command
from rig.files.pictures import write_png
from tests.calibration.lenses.board_world import PROJECTOR_SIZE, Stand, photograph, printed, stand, truth

BOARDS = {
    "charuco": Board(kind="charuco", columns=9, rows=7, square_m=0.03, marker_m=0.022),
    "chessboard": Board(kind="chessboard", columns=9, rows=6, square_m=0.03),
    "asymmetric-circles": Board(kind="asymmetric-circles", columns=5, rows=8, square_m=0.018),
}


def head(board: Board) -> str:
    """A manifest's, up to its views."""
    marker = f"marker_m = {board.marker_m}\n" if board.kind == "charuco" else ""
    size = f"columns = {board.columns}\nrows = {board.rows}\nsquare_m = {board.square_m}\n{marker}"
    return f'\nschema = 1\n[camera]\n[board]\nkind = "{board.kind}"\n{size}'


HEAD = head(BOARDS["charuco"])


@cache
def placed(kind: str) -> Stand:
    return stand(truth(1, board=BOARDS[kind]), 0, printed(BOARDS[kind]))


@pytest.fixture
def place() -> Stand:
    return placed("charuco")


def blocks(place: Stand) -> np.ndarray:
    height, width = place.light[::2, ::2].shape
    levels = np.random.default_rng(0).integers(60, 180, (height // 80, width // 80)).astype(np.uint8)
    return np.kron(levels, np.ones((80, 80), np.uint8))


BLUR_PX = {"asymmetric-circles": 9.0}
"""Elsewhere 4: centres of circles bear more than corners."""
BAD: dict[str, tuple[Callable[[Stand], np.ndarray], str, str]] = {
    "empty": (blocks, " found: ", ""),
    "saturated": (lambda place: photograph(place, light=450), "is saturated", "expose shorter"),
    "blurred": (lambda place: photograph(place, blur_px=4.0), "blurred", "focus on the board"),
    "mirrored": (lambda place: photograph(place)[:, ::-1], "is mirrored", "as the camera took it"),
    "dark": (lambda place: photograph(place, light=3), " differ by ", "expose longer"),
    "smaller": (
        lambda place: cv2.resize(photograph(place), (320, 240)),
        "has 320 × 240 px, the camera 640 × 480",
        "crop",
    ),
}


@pytest.mark.parametrize("kind", BOARDS)
def test_each_photograph_that_cannot_be_used_is_named(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    place = placed(kind)
    # A chessboard's mirror image is a chessboard: only code photographs, or the other views, contradict it.
    bad = {name: each for name, each in BAD.items() if kind != "chessboard" or name != "mirrored"}
    pictures = {"good": photograph(place)} | {name: make(place) for name, (make, _, _) in bad.items()}
    if kind in BLUR_PX:
        pictures["blurred"] = photograph(place, blur_px=BLUR_PX[kind])
    for name, picture in pictures.items():
        write_png(tmp_path / f"{name}.png", np.ascontiguousarray(picture))
    views = "".join(f'[[view]]\nname = "{name}"\nphotograph = "{name}.png"\n' for name in pictures)
    (tmp_path / "lenses.toml").write_text(head(BOARDS[kind]) + views)
    status = run_command(["lenses", str(tmp_path / "lenses.toml"), "-o", str(tmp_path / "out.toml")])
    said = capsys.readouterr().err
    assert status != 0
    assert "Traceback" not in said
    for name, (_, fault, remedy) in bad.items():
        line = next((line for line in said.splitlines() if line.strip().startswith(f"{name}:")), "")
        assert fault in line, (name, said)
        assert remedy in line, (name, line)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("square_m = 0.03", "square_m = 30.0", "mistaken by 1000"),
        ("square_m = 0.03", "square_m = 0.00003", "mistaken by 1000"),
        ("columns = 9\nrows = 7", "columns = 5\nrows = 4", "correct [board] columns and rows"),
        ("[camera]\n", "[camera]\nwidth_px = 1280\nheight_px = 960\n", "the camera 1280 × 960 px"),
    ],
)
def test_a_manifest_that_says_another_board_or_camera_is_named(
    tmp_path: Path, place: Stand, capsys: pytest.CaptureFixture[str], old: str, new: str, words: str
) -> None:
    write_png(tmp_path / "a.png", photograph(place))
    views = "".join(f'[[view]]\nname = "{k}"\nphotograph = "a.png"\n' for k in range(3))
    (tmp_path / "lenses.toml").write_text((HEAD + views).replace(old, new))
    assert run_command(["lenses", str(tmp_path / "lenses.toml"), "-o", str(tmp_path / "out.toml")]) != 0
    assert words in capsys.readouterr().err.replace("\n", " ")


def lit_pose(folder: Path, place: Stand, spoil: Callable[[int, np.ndarray], np.ndarray]) -> Path:
    """A pose lit by Gray code of steps of eight projector pixels, each photograph as something spoils it."""
    shape = (PROJECTOR_SIZE[1] // 8, PROJECTOR_SIZE[0] // 8)
    shown = {pattern.name: pattern.codes for pattern in CODES["gray"].patterns(shape)}
    shown |= {"white": np.full(shape, 255, np.uint8), "black": np.zeros(shape, np.uint8)}
    for k, (name, codes) in enumerate(shown.items()):
        picture = photograph(place, np.kron(codes, np.ones((8, 8), np.uint8)), seed=k)
        write_png(folder / f"{name}.png", np.ascontiguousarray(spoil(k, picture)))
    projector = f"[projector]\nwidth_px = {PROJECTOR_SIZE[0]}\nheight_px = {PROJECTOR_SIZE[1]}\ncode_step_px = 8\n"
    (folder / "lenses.toml").write_text(HEAD + projector + '[[view]]\nname = "pose"\nfiles = "{pattern}.png"\n')
    return folder / "lenses.toml"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            lambda k, picture: np.roll(picture, 9, axis=1) if 7 < k < 99 else picture,
            "the picture moves by 9 px between",
        ),
        (lambda k, picture: (picture * (0.7 if k in (4, 5) else 1.0)).astype(np.uint8), "automatics off"),
    ],
)
def test_a_camera_that_moved_and_automatics_left_on_are_named(
    tmp_path: Path,
    place: Stand,
    capsys: pytest.CaptureFixture[str],
    spoil: Callable[[int, np.ndarray], np.ndarray],
    words: str,
) -> None:
    manifest = lit_pose(tmp_path, place, spoil)
    assert run_command(["lenses", str(manifest), "-o", str(tmp_path / "out.toml")]) != 0
    assert words in capsys.readouterr().err.replace("\n", " ")


def test_a_pose_that_stood_still_is_not_called_moved(
    tmp_path: Path, place: Stand, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = lit_pose(tmp_path, place, lambda _, picture: picture)
    assert run_command(["lenses", str(manifest), "-o", str(tmp_path / "out.toml")]) != 0  # one pose is too few
    said = capsys.readouterr().err
    assert "1 of 1 views can be used" in said
    assert "moves" not in said


def test_exchanged_photographs_of_a_pose_are_named(
    tmp_path: Path, place: Stand, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = lit_pose(tmp_path, place, lambda _, picture: picture)
    one, other = tmp_path / "gray-column-03.png", tmp_path / "gray-row-02-inverse.png"
    spare = one.rename(tmp_path / "spare.png")
    other.rename(one)
    spare.rename(other)
    assert run_command(["lenses", str(manifest), "-o", str(tmp_path / "out.toml")]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "not what they are called" in said
    assert "gray-row-02-inverse shows gray-column-03" in said


def test_photographs_of_more_stripes_than_the_projector_has_are_named(
    tmp_path: Path, place: Stand, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = lit_pose(tmp_path, place, lambda _, picture: picture)
    manifest.write_text(manifest.read_text().replace("code_step_px = 8", "code_step_px = 16"))
    assert run_command(["lenses", str(manifest), "-o", str(tmp_path / "out.toml")]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "gray-column-05.png is there, and a projector of 32 × 24 steps shows no gray-column-05" in said
    assert "code_step_px" in said
