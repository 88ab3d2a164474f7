"""Boards seen and lit by devices that are not the model: rendered pictures, and corners with known noise."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.lenses.boards import Board
from calibration.lenses.bundle import camera_points, projector_points
from calibration.lenses.calibrate import LensRequest
from calibration.lenses.lens import project_points
from calibration.lenses.records import BoardSightings, RigState

CAMERA_SIZE, PROJECTOR_SIZE = (640, 480), (512, 384)
CAMERA = np.array([700.0, 702.0, 325.0, 236.0, -0.12, 0.08, 0.0005, -0.0004, 0, 0, 0, 0])
PROJECTOR = np.array([560.0, 561.0, 250.0, 427.0, -0.04, 0.02, 0.0003, -0.0006, 0, 0, 0, 0])
"""Its principal point lies below its picture: lens shift."""
PAIR = LensRequest(
    camera_size_px=CAMERA_SIZE,
    projector_size_px=PROJECTOR_SIZE,
    camera_model="k1k2p1p2",
    projector_model="k1k2p1p2",
    flex=False,
)
"""Both devices, with the terms that they have, and a flat board."""
BOARD = Board(kind="chessboard", columns=9, rows=6, square_m=0.03)


def rotation(*vector: float) -> np.ndarray:
    return cv2.Rodrigues(np.array(vector, dtype=np.float64).reshape(3, 1))[0]


TURN = rotation(0.15, 0.22, 0.02)
"""Of the projector, which stands so that it lights what the camera sees 0.6 m away."""


def poses(count: int, board: Board, seed: int, tilt: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a board that lies within the camera's picture."""
    rng = np.random.default_rng(seed)
    half = np.array([*board.half_size_m, 0.0])
    rotations, translations = [], []
    while len(rotations) < count:
        turn = rotation(rng.uniform(-tilt, tilt), rng.uniform(-tilt, tilt), rng.uniform(-0.3, 0.3))
        middle = np.array([rng.uniform(-0.1, 0.1), rng.uniform(-0.08, 0.08), rng.uniform(0.5, 0.7)])
        place = middle - turn @ half
        xy = project_points(CAMERA, board.points_m @ turn[:, :2].T + place)
        if ((xy > 25) & (xy < np.array(CAMERA_SIZE) - 26)).all():
            rotations.append(turn)
            translations.append(place)
    return np.stack(rotations), np.stack(translations)


def truth(count: int, seed: int = 0, board: Board = BOARD, tilt: float = 0.6) -> RigState:
    rotations, translations = poses(count, board, seed, tilt)
    return RigState(
        camera=CAMERA,
        projector=PROJECTOR,
        projector_rotation=TURN,
        projector_translation_m=np.array([0.007, -0.28, 0.66]) - TURN @ np.array([0.0, 0.0, 0.62]),
        flex_m=np.zeros(3),
        rotations=rotations,
        translations_m=translations,
    )


def sightings(
    state: RigState, *, seed: int = 0, camera_px: float = 0.1, projector_px: float = 0.1, board: Board = BOARD
) -> BoardSightings:
    """Corners with noise; what the camera's is off by moves the projector's, as when both are read in one picture."""
    rng = np.random.default_rng(1000 + seed)
    count, n = len(state.rotations), len(board.points_m)
    blank = BoardSightings.of_camera(
        np.repeat(np.arange(count), n), np.tile(board.points_m, (count, 1)), np.zeros((count * n, 2))
    )
    seen, lit, slope = _true_pixels(blank, state)
    off = camera_px * rng.normal(size=seen.shape)
    read = lit + np.einsum("nij,nj->ni", slope, off) + projector_px * rng.normal(size=lit.shape)
    return replace(
        blank,
        camera_xy_px=seen + off,
        projector_xy_px=read,
        projector_by_camera=slope,
        projector_weight=np.ones(len(seen)),
    )


def _true_pixels(blank: BoardSightings, state: RigState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points = camera_points(blank, state)

    def pixels(where: np.ndarray) -> np.ndarray:
        both = project_points(state.camera, where), project_points(state.projector, projector_points(where, state))
        return np.hstack(both)

    here = pixels(points)
    steps = [pixels(points + 1e-5 * state.rotations[blank.view][:, :, k]) - here for k in (0, 1)]
    along = np.stack(steps, axis=2)
    return here[:, :2], here[:, 2:], along[:, 2:] @ np.linalg.inv(along[:, :2])


@dataclass(frozen=True)
class Rendered:
    """A flat picture on a board, photographed."""

    texture: np.ndarray
    """(h, w) reflectance of the board."""
    per_m: float
    """Texture pixels a metre."""
    corner: tuple[float, float]
    """Texture pixel of the board's first corner."""


def printed(board: Board, pixels: int = 60) -> Rendered:
    """The board as it is printed, with a white rim."""
    columns, rows = board.columns + 1, board.rows + 1
    if board.kind == "charuco":
        picture = board.charuco().generateImage((board.columns * pixels, board.rows * pixels))
        rim = np.full((picture.shape[0] + 2 * pixels, picture.shape[1] + 2 * pixels), 255, np.uint8)
        rim[pixels:-pixels, pixels:-pixels] = picture
        return Rendered(0.15 + 0.75 * rim / 255.0, pixels / board.square_m, (2 * pixels - 0.5, 2 * pixels - 0.5))
    if board.kind == "chessboard":
        y, x = np.mgrid[: (rows + 2) * pixels, : (columns + 2) * pixels] // pixels
        inside = (x > 0) & (x <= columns) & (y > 0) & (y <= rows)
        picture = np.where(inside & ((x + y) % 2 == 0), 0.25, 0.9)
        return Rendered(picture, pixels / board.square_m, (2 * pixels - 0.5, 2 * pixels - 0.5))
    picture = np.full((int((board.rows + 3) * pixels), int((2 * board.columns + 4) * pixels)), 0.9)
    for place in board.points_m / board.square_m:
        centre = np.rint((place + 2) * pixels * 16).astype(int)
        cv2.circle(picture, (int(centre[0]), int(centre[1])), int(0.35 * pixels * 16), 0.1, -1, cv2.LINE_AA, 4)
    return Rendered(picture, pixels / board.square_m, (2.0 * pixels, 2.0 * pixels))


@dataclass(frozen=True)
class Stand:
    """What each sample of the camera's picture meets on a board at one pose: made once for all that is shown on it."""

    light: np.ndarray
    """(h, w) reflectance of the board, what lies beside it 0.4; finer than the picture."""
    pixel: np.ndarray
    """(h, w, 2) projector pixel."""


def stand(state: RigState, view: int, rendered: Rendered, fine: int = 2) -> Stand:
    width, height = CAMERA_SIZE
    x, y = np.meshgrid((np.arange(width * fine) + 0.5) / fine - 0.5, (np.arange(height * fine) + 0.5) / fine - 0.5)
    points, on_board = _on_board(state, view, np.column_stack([x.ravel(), y.ravel()]))
    texel = (on_board * rendered.per_m + rendered.corner).astype(np.float32).reshape(*x.shape, 2)
    light = cv2.remap(rendered.texture.astype(np.float32), texel, None, cv2.INTER_LINEAR, borderValue=0.4)
    pixel = project_points(state.projector, projector_points(points, state))
    return Stand(light, pixel.astype(np.float32).reshape(*x.shape, 2))


def photograph(
    place: Stand, shown: np.ndarray | None = None, *, seed: int = 0, light: float = 200.0, blur_px: float = 0.7
) -> np.ndarray:
    """The camera's picture of a board, lit by the projector's picture if there is one, by the room otherwise."""
    there = place.light
    if shown is not None:
        there = there * cv2.remap(shown.astype(np.float32) / 255, place.pixel, None, cv2.INTER_NEAREST, borderValue=0)
    soft = cv2.GaussianBlur(cv2.resize(there, CAMERA_SIZE, interpolation=cv2.INTER_AREA), (0, 0), blur_px)
    noise = np.random.default_rng(seed).normal(0, 1.0, soft.shape)
    return np.clip(np.rint(8 + light * soft + noise), 0, 255).astype(np.uint8)


def _on_board(state: RigState, view: int, xy_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the camera's frame that pixels see on the board's plane, and their places on the board."""
    matrix = np.array([[CAMERA[0], 0, CAMERA[2]], [0, CAMERA[1], CAMERA[3]], [0, 0, 1.0]])
    plane = cv2.undistortPoints(xy_px.reshape(-1, 1, 2), matrix, CAMERA[4:9]).reshape(-1, 2)
    rays = np.column_stack([plane, np.ones(len(plane))])
    turn, place = state.rotations[view], state.translations_m[view]
    points = rays * ((turn[:, 2] @ place) / (rays @ turn[:, 2]))[:, None]
    return points, ((points - place) @ turn)[:, :2]
