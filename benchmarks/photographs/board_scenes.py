"""Boards, a camera and a projector drawn by chance, and the photographs that such a camera takes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.geometry.pinhole import rotation_of
from calibration.lenses.boards import Board
from calibration.lenses.bundle import projector_points
from calibration.lenses.lens import project_points
from calibration.lenses.records import RigState
from calibration.structured_light.code import CODES

FloatArray = NDArray[np.float64]
Frame = NDArray[np.uint8]
_FINE = 2
"""Samples of a camera pixel, each way."""
_TEXTURE = 64
"""Pixels of a board's square."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Look:
    """How a camera takes photographs."""

    camera_size: tuple[int, int]
    light_dn: float
    room_dn: float
    black_share: float
    """Of white that the projector sends where it is black."""
    noise_dn: float
    blur_px: float


def _flat(xy_m: FloatArray) -> FloatArray:
    return np.zeros(len(xy_m))


def _as_it_lies(xy_m: FloatArray) -> FloatArray:
    return xy_m


@dataclass(frozen=True, eq=False)
class Made:
    """How a board is made, and what stands behind it."""

    height_m: Callable[[FloatArray], FloatArray] = _flat
    """Of its surface over its plane, away from the camera, at (N, 2) places on it."""
    print_at: Callable[[FloatArray], FloatArray] = _as_it_lies
    """(N, 2) what of the print lies at places on its plane: a sheet that bends keeps its lengths."""
    stretch: tuple[float, float] = (1.0, 1.0)
    """Of the printed squares, across and down."""
    behind_m: float = 0.0
    """How far off what lies beside the board is from it; 0: in its plane."""


@dataclass(eq=False, kw_only=True)
class BoardSet:
    """Photographs of boards, what is true of them, and what the manifest says."""

    state: RigState
    look: Look
    frames: list[dict[str, Frame]]
    told_board: Board
    told_projector_size: tuple[int, int]
    told_step_px: int
    suffix: str
    jpeg: int
    stands: list[Stand]
    shown: dict[str, Frame]
    told_full_scale_dn: int = 255
    fault: str = "none"
    drawn: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stand:
    """What each sample of the camera's picture meets at one pose."""

    light: NDArray[np.float32]
    """(h, w) reflectance of the board, what lies beside it 0.4."""
    pixel: NDArray[np.float32]
    """(h, w, 2) projector pixel."""


def drawn_board(random: np.random.Generator) -> Board:
    """A board of a usual kind and size."""
    kind = ("chessboard", "charuco", "circles")[int(random.integers(3))]
    square_m = float(random.choice([0.02, 0.03, 0.05]))
    if kind == "chessboard":
        columns, rows = ((9, 6), (8, 6), (11, 8), (7, 6))[int(random.integers(4))]
        return Board(kind="chessboard", columns=columns, rows=rows, square_m=square_m)
    if kind == "charuco":
        columns, rows = ((8, 6), (10, 7), (7, 5))[int(random.integers(3))]
        return Board(kind="charuco", columns=columns, rows=rows, square_m=square_m, marker_m=0.75 * square_m)
    columns, rows = ((4, 11), (4, 9))[int(random.integers(2))]
    return Board(kind="circles", columns=columns, rows=rows, square_m=square_m)


def drawn_state(random: np.random.Generator, board: Board, sizes: tuple[tuple[int, int], ...], views: int) -> RigState:
    """Lenses, the pose between them, and poses of the board that both see."""
    camera_size, projector_size = sizes
    focal = camera_size[0] * random.uniform(0.9, 1.6)
    camera = _lens(random, camera_size, focal, (0.5, 0.5), 0.12)
    across_m = np.ptp(board.points_m, axis=0)
    width_m = float(max(across_m[0], across_m[1] * camera_size[0] / camera_size[1]))
    away_m = width_m * focal / camera_size[0] / random.uniform(0.45, 0.65)
    turn = rotation_of(random.uniform(-0.25, 0.25, 3))
    projector = _lens(
        random,
        projector_size,
        projector_size[0] * random.uniform(0.9, 1.5),
        (0.5, 0.5 + random.uniform(0, 0.6)),
        0.04,
    )
    middle = (np.array(projector_size) / 2 - projector[2:4]) / projector[:2]
    # So far off that what it lights is about twice as wide as the board.
    far_m = random.uniform(1.5, 2.2) * width_m * projector[0] / projector_size[0]
    place = far_m * np.array([*middle, 1.0]) - turn @ np.array([0.0, 0.0, away_m])
    rig = RigState(
        camera=camera,
        projector=projector,
        projector_rotation=turn,
        projector_translation_m=place,
        flex_m=np.zeros(3),
        rotations=np.zeros((0, 3, 3)),
        translations_m=np.zeros((0, 3)),
    )
    rotations, translations = _poses(random, board, rig, sizes, away_m=away_m, count=views)
    return replace(rig, rotations=rotations, translations_m=translations)


def _lens(
    random: np.random.Generator, size: tuple[int, int], focal: float, middle: tuple[float, float], strength: float
) -> FloatArray:
    terms = strength * np.array([random.normal(), random.normal(), 0.005 * random.normal(), 0.005 * random.normal()])
    place = np.array(middle) * size + 0.006 * size[0] * random.normal(size=2)
    return np.array([focal, focal * (1 + 0.002 * random.normal()), *place, *terms, 0, 0, 0, 0])


def _poses(
    random: np.random.Generator,
    board: Board,
    rig: RigState,
    sizes: tuple[tuple[int, int], ...],
    *,
    away_m: float,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Poses that the camera sees whole, and the projector lights: circles all of them, others seven of ten corners."""
    middle = (board.points_m.max(axis=0) + board.points_m.min(axis=0)) / 2
    spread = 0.25 * away_m * sizes[0][0] / rig.camera[0]
    least = 1.0 if board.kind == "circles" else 0.7
    rotations: list[FloatArray] = []
    translations: list[FloatArray] = []
    while len(rotations) < count:
        spread *= 0.98
        turn = rotation_of([*random.uniform(-0.6, 0.6, 2), random.uniform(-0.3, 0.3)])
        there = np.array([*random.uniform(-spread, spread, 2), away_m * random.uniform(0.95, 1.3)])
        shift = there - turn @ np.array([*middle, 0.0])
        points = board.points_m @ turn[:, :2].T + shift
        lit = _inside(project_points(rig.projector, projector_points(points, rig)), sizes[1], margin_px=4)
        if _inside(project_points(rig.camera, points), sizes[0], margin_px=30).all() and lit.mean() >= least:
            rotations.append(turn)
            translations.append(shift)
    return np.stack(rotations), np.stack(translations)


def _inside(xy_px: FloatArray, size: tuple[int, int], margin_px: int) -> NDArray[np.bool_]:
    return np.asarray(((xy_px > margin_px) & (xy_px < np.array(size) - 1 - margin_px)).all(axis=1))


def printed(board: Board) -> tuple[Frame, tuple[float, float]]:
    """The board as it is printed, with a white rim, and the pixel of its first corner."""
    if board.kind == "charuco":
        picture = board.charuco().generateImage((board.columns * _TEXTURE, board.rows * _TEXTURE))
        rim = np.full((picture.shape[0] + 2 * _TEXTURE, picture.shape[1] + 2 * _TEXTURE), 255, np.uint8)
        rim[_TEXTURE:-_TEXTURE, _TEXTURE:-_TEXTURE] = picture
        return rim, (2 * _TEXTURE - 0.5, 2 * _TEXTURE - 0.5)
    if board.kind == "chessboard":
        columns, rows = board.columns + 1, board.rows + 1
        y, x = np.mgrid[: (rows + 2) * _TEXTURE, : (columns + 2) * _TEXTURE] // _TEXTURE
        inside = (x > 0) & (x <= columns) & (y > 0) & (y <= rows)
        return np.where(inside & ((x + y) % 2 == 0), 0, 255).astype(np.uint8), (2 * _TEXTURE - 0.5, 2 * _TEXTURE - 0.5)
    blank = np.full((int((board.rows + 3) * _TEXTURE), int((2 * board.columns + 4) * _TEXTURE)), 255, np.uint8)
    for x, y in np.rint((board.points_m / board.square_m + 2) * _TEXTURE * 16).astype(int).tolist():
        cv2.circle(blank, (x, y), int(0.35 * _TEXTURE * 16), 0, -1, cv2.LINE_AA, 4)
    return blank, (2.0 * _TEXTURE, 2.0 * _TEXTURE)


def stand(state: RigState, view: int, board: Board, look: Look, made: Made = Made()) -> Stand:
    """Cast the camera's samples onto the board and on to the projector."""
    width, height = look.camera_size
    x, y = np.meshgrid(*((np.arange(n * _FINE) + 0.5) / _FINE - 0.5 for n in (width, height)))
    plane = _undistorted(state.camera, np.column_stack([x.ravel(), y.ravel()]))
    rays = np.column_stack([plane, np.ones(len(plane))])
    points, xy_m = _met(rays, state, view, made)
    texture, corner = printed(board)
    texel = made.print_at(xy_m) * _TEXTURE / board.square_m / np.array(made.stretch) + corner
    light = _remapped(0.25 + 0.6 * texture / 255.0, texel.reshape(*x.shape, 2), cv2.INTER_LINEAR, beside=0.4)
    if made.behind_m:
        beside = ((texel < 0) | (texel > np.array(texture.shape[::-1]) - 1)).any(axis=1)
        points[beside] *= 1 + made.behind_m / points[beside, 2:]
    pixel = project_points(state.projector, projector_points(points, state))
    return Stand(light=light, pixel=pixel.astype(np.float32).reshape(*x.shape, 2))


def _met(rays: FloatArray, state: RigState, view: int, made: Made) -> tuple[FloatArray, FloatArray]:
    """Where rays meet the board: (N, 3) before the camera, and (N, 2) on the board. [m]"""
    turn, place = state.rotations[view], state.translations_m[view]
    height_m = np.zeros(len(rays))
    # Boards are nearly flat: each step leaves the slope's share, some per cent, of what the one before left.
    for _ in range(5):
        points = rays * ((turn[:, 2] @ place + height_m) / (rays @ turn[:, 2]))[:, None]
        xy_m = ((points - place) @ turn)[:, :2]
        height_m = made.height_m(xy_m)
    return points, xy_m


def _remapped(picture: FloatArray, places: NDArray[np.floating], how: int, beside: float) -> NDArray[np.float32]:
    x, y = (np.ascontiguousarray(places[..., k], np.float32) for k in (0, 1))
    there = cv2.remap(picture.astype(np.float32), x, y, how, borderMode=cv2.BORDER_CONSTANT, borderValue=beside)
    return there.astype(np.float32)


def _undistorted(lens: FloatArray, xy_px: FloatArray) -> FloatArray:
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1.0]])
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
    plane = cv2.undistortPoints(xy_px.reshape(-1, 1, 2), matrix, lens[4:9], criteria=stop)
    return np.asarray(plane, dtype=np.float64).reshape(-1, 2)


def photograph(place: Stand, shown: Frame, look: Look, random: np.random.Generator) -> Frame:
    """The camera's picture of a board that a projector lights."""
    sent = _remapped(shown / 255.0, place.pixel, cv2.INTER_NEAREST, beside=-1)
    lit = np.where(sent < 0, 0.0, look.black_share + (1 - look.black_share) * np.maximum(sent, 0))
    there = place.light * (look.room_dn + look.light_dn * lit)
    small = cv2.resize(there.astype(np.float32), look.camera_size, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), look.blur_px)
    noise = look.noise_dn * random.normal(size=soft.shape) * np.sqrt(0.3 + soft / 255)
    return np.asarray(np.clip(np.rint(4 + soft + noise), 0, 255).astype(np.uint8))


def codes(projector_size: tuple[int, int], step_px: int) -> dict[str, Frame]:
    """All pictures that the projector shows, by name."""
    shape = (projector_size[1] // step_px, projector_size[0] // step_px)
    shown = {pattern.name: np.asarray(pattern.codes) for pattern in CODES["gray"].patterns(shape)}
    shown |= {"white": np.full(shape, 255, np.uint8), "black": np.zeros(shape, np.uint8)}
    return {name: np.kron(picture, np.ones((step_px, step_px), np.uint8)) for name, picture in shown.items()}


def photographed(set_: BoardSet, view: int, random: np.random.Generator) -> dict[str, Frame]:
    """All photographs of one pose."""
    return {name: photograph(set_.stands[view], shown, set_.look, random) for name, shown in set_.shown.items()}


def clean_set(random: np.random.Generator) -> BoardSet:
    """A set without a fault."""
    camera_size = ((640, 480), (720, 540), (800, 600))[int(random.integers(3))]
    step_px = int(random.choice([2, 4]))
    projector_size = ((512, 384), (480, 360), (400, 300), (640, 360))[int(random.integers(4))]
    board, views = drawn_board(random), int(random.integers(4, 9))
    state = drawn_state(random, board, (camera_size, projector_size), views)
    look = Look(
        camera_size=camera_size,
        light_dn=float(random.uniform(120, 230)),
        room_dn=float(random.choice([0.0, random.uniform(0, 40)])),
        black_share=float(random.uniform(0.002, 0.02)),
        noise_dn=float(random.uniform(0.3, 2.5)),
        blur_px=float(random.uniform(0.3, 1.0)),
    )
    set_ = BoardSet(
        state=state,
        look=look,
        frames=[],
        told_board=board,
        told_projector_size=projector_size,
        told_step_px=step_px,
        suffix=str(random.choice([".png", ".png", ".jpg"])),
        jpeg=int(random.choice([80, 90, 95])),
        stands=[stand(state, view, board, look) for view in range(views)],
        shown=codes(projector_size, step_px),
    )
    set_.frames = [photographed(set_, view, random) for view in range(views)]
    words = f"{board.kind} {board.columns} x {board.rows}, {views} views, camera {camera_size[0]} x {camera_size[1]}"
    set_.drawn = (
        f"{words}, projector {projector_size[0]} x {projector_size[1]} by {step_px}, noise {look.noise_dn:.1f}, "
        f"blur {look.blur_px:.1f}, light {look.light_dn:.0f}, room {look.room_dn:.0f}, "
        f"{set_.suffix[1:]}{set_.jpeg if set_.suffix == '.jpg' else ''}"
    )
    return set_
