"""Photographs and lists to what was seen of the board, view by view, each with what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.errors import CalibrationError
from calibration.lenses.boards import Board
from calibration.lenses.detection import Detection, detect_board
from calibration.lenses.projector_corners import projector_corners
from calibration.lenses.records import BoardSightings
from calibration.lenses.refusals.lit_views import handedness
from calibration.structured_light.code import CODES
from calibration.structured_light.correspondence import Correspondence
from calibration.structured_light.decode import decode_gray
from rig.devices.replay.photographs import Photograph, grey, read_photograph
from rig.errors import DeviceLost, ProfileError
from rig.lenses.corner_lists import CornerList, read_corner_lists
from rig.lenses.manifest import LensManifest, ProjectorTable, ViewTable, frames_of, pattern_shape
from rig.lenses.view_faults import fault_of_photographs
from rig.terminal import OnStep

FloatArray = NDArray[np.float64]
_BIT_LIMIT = 4.5 / 255
"""Share of full scale by which a pattern and its inverse have to differ: above the noise of a good JPEG."""
_LEAST_PROJECTOR = 6
"""Corners of a view whose projector pixel was read."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenView:
    """What one pose of the board gave."""

    name: str
    board_m: FloatArray
    """(N, 2)"""
    camera_xy_px: FloatArray
    """(N, 2)"""
    camera_weight: FloatArray
    """(N,)"""
    projector_xy_px: FloatArray
    """(N, 2); NaN: none."""
    projector_by_camera: FloatArray
    """(N, 2, 2)"""
    problem: str = ""
    """Why it is not used, and what to do."""
    bright_dn: float = float("nan")
    """Of the board's bright squares."""


def seen_views(
    manifest: LensManifest, folder: Path, on_step: OnStep
) -> tuple[tuple[SeenView, ...], tuple[int, int] | None]:
    """Return all views, and the camera's picture (width, height) if anything tells it.

    Parameters
    ----------
    manifest
        What is to be read.
    folder
        That its paths are relative to.
    on_step
        Told how far it is.

    Raises
    ------
    ProfileError
        A list or a name is wrong.
    """
    if manifest.corners is not None:
        size = manifest.camera.width_px, manifest.camera.height_px
        return _of_lists(manifest, folder), (size[0] or 0, size[1] or 0)
    views, size_px = [], _given_size(manifest)
    for number, view in enumerate(manifest.view):
        on_step("find boards", number, len(manifest.view))
        seen, size_px = _of_view(view, manifest, folder, size_px=size_px)
        views.append(seen)
    on_step("find boards", len(manifest.view), len(manifest.view))
    return tuple(views), size_px


def _given_size(manifest: LensManifest) -> tuple[int, int] | None:
    camera = manifest.camera
    return None if camera.width_px is None or camera.height_px is None else (camera.width_px, camera.height_px)


def _nothing(name: str, problem: str) -> SeenView:
    none = np.zeros((0, 2))
    return SeenView(
        name=name,
        board_m=none,
        camera_xy_px=none,
        camera_weight=np.zeros(0),
        projector_xy_px=none,
        projector_by_camera=np.zeros((0, 2, 2)),
        problem=problem,
    )


def _of_lists(manifest: LensManifest, folder: Path) -> tuple[SeenView, ...]:
    lists = manifest.corners
    if lists is None:
        raise ProfileError("corners: missing")
    board = manifest.board.board()
    points = board.points_m
    camera = read_corner_lists(folder / lists.camera, len(points), lists.last_column)
    lit: dict[str, CornerList | None] = {}
    if lists.projector is not None:
        lit = read_corner_lists(folder / lists.projector, len(points), lists.last_column)
        unknown = sorted(set(lit) - set(camera))
        if unknown:
            raise ProfileError(
                f"{folder / lists.projector}: {unknown[0]} is not named in {lists.camera}; both lists name a view by "
                "the camera's photograph"
            )
    views = tuple(_of_list(name, found, lit.get(name), points) for name, found in camera.items())
    return _against_the_others(views)


def _of_list(name: str, found: CornerList | None, lit: CornerList | None, points: FloatArray) -> SeenView:
    if found is None:
        return _nothing(name, "has no board; leave it out, or photograph it again")
    there = found.weight > 0
    read = np.full((len(points), 2), np.nan) if lit is None else np.where(lit.weight[:, None] > 0, lit.xy_px, np.nan)
    return SeenView(
        name=name,
        board_m=points[there],
        camera_xy_px=found.xy_px[there],
        camera_weight=found.weight[there],
        projector_xy_px=read[there],
        projector_by_camera=np.zeros((int(there.sum()), 2, 2)),
    )


def _against_the_others(views: tuple[SeenView, ...]) -> tuple[SeenView, ...]:
    """Mark views whose corners run the other way round than the others'."""
    handed = np.array([handedness(view.board_m, view.camera_xy_px) for view in views])
    usual = 1.0 if (handed > 0).sum() >= (handed < 0).sum() else -1.0
    problem = "is mirrored: its corners run the other way round than the others'; list them as the board has them"
    return tuple(
        replace(view, problem=problem) if hand * usual < 0 and not view.problem else view
        for view, hand in zip(views, handed, strict=True)
    )


def _of_view(
    view: ViewTable, manifest: LensManifest, folder: Path, *, size_px: tuple[int, int] | None
) -> tuple[SeenView, tuple[int, int] | None]:
    """One view, and the picture's size as far as it is known then."""
    frames = frames_of(view, manifest.projector, folder)
    try:
        pictures = {name: grey(read_photograph(path)) for name, path in _there(frames, view).items()}
        frame = _board_picture(view, pictures, folder)
    except DeviceLost as error:
        return _nothing(view.name, f"cannot be used: {error}"), size_px
    problem, size_px = _size_problem(view, frame, pictures, size_px)
    if problem:
        return _nothing(view.name, problem), size_px
    found = detect_board(frame, manifest.board.board(), manifest.camera.full_scale_dn)
    if found.problem:
        return _nothing(view.name, found.problem), size_px
    seen = _seen(view, found, manifest.board.board())
    if manifest.projector is None or not frames:
        return seen, size_px
    return _with_projector(seen, view, pictures, found=found, manifest=manifest), size_px


def _there(frames: dict[str, Path], view: ViewTable) -> dict[str, Path]:
    """Photographs to read; white and black may be missing where a name was only made up from a template."""
    optional = ("white", "black") if view.files is not None else ()
    return {name: path for name, path in frames.items() if name not in optional or path.is_file()}


def _board_picture(view: ViewTable, pictures: dict[str, Photograph], folder: Path) -> Photograph:
    if view.photograph is not None:
        return grey(read_photograph(folder / view.photograph))
    if view.sequence and "white" in pictures and pictures["black"].mean() > pictures["white"].mean():
        pictures["white"], pictures["black"] = pictures["black"], pictures["white"]  # tools differ in their order
    if "white" not in pictures:
        raise DeviceLost("no photograph of the board in even light; name it as `photograph`, or a frame white")
    return pictures["white"]


def _size_problem(
    view: ViewTable, frame: Photograph, pictures: dict[str, Photograph], size_px: tuple[int, int] | None
) -> tuple[str, tuple[int, int] | None]:
    height, width = frame.shape
    odd = next((name for name, picture in pictures.items() if picture.shape != frame.shape), None)
    if odd is not None:
        other = pictures[odd].shape
        return (
            f"photograph {odd} has {other[1]} × {other[0]} px, the board's {width} × {height} px: use pictures of one "
            "size"
        ), size_px
    cropped = view.crop.left_px or view.crop.top_px
    if size_px is None:
        size_px = (width, height)
    right, bottom = view.crop.left_px + width, view.crop.top_px + height
    if (not cropped and (width, height) == size_px) or (
        "crop" in view.model_fields_set and _within(right, bottom, size_px)
    ):
        return "", size_px
    return (
        f"has {width} × {height} px, the camera {size_px[0]} × {size_px[1]} px: use pictures of one resolution; of a "
        "cut-out say crop = {left_px = …, top_px = …} and the camera's full width_px and height_px"
    ), size_px


def _within(right: int, bottom: int, size_px: tuple[int, int]) -> bool:
    return right <= size_px[0] and bottom <= size_px[1]


def _seen(view: ViewTable, found: Detection, board: Board) -> SeenView:
    n = len(found.ids)
    return SeenView(
        name=view.name,
        board_m=board.points_m[found.ids],
        camera_xy_px=found.xy_px + np.array([view.crop.left_px, view.crop.top_px]),
        camera_weight=np.ones(n),
        projector_xy_px=np.full((n, 2), np.nan),
        projector_by_camera=np.zeros((n, 2, 2)),
        bright_dn=found.bright_dn,
    )


def _with_projector(
    seen: SeenView,
    view: ViewTable,
    pictures: dict[str, Photograph],
    *,
    found: Detection,
    manifest: LensManifest,
) -> SeenView:
    if manifest.projector is None:
        return seen
    try:
        decoded = _decoded(view, pictures, manifest.projector, manifest.camera.full_scale_dn)
    except CalibrationError as error:
        return replace(seen, problem=str(error))
    limit_dn = _BIT_LIMIT * manifest.camera.full_scale_dn
    problem = fault_of_photographs(pictures, found, limit_dn=limit_dn, code=view.code)
    read = projector_corners(decoded, found.xy_px, found.square_px)
    if not problem and read.there.sum() < _LEAST_PROJECTOR:
        problem = (
            f"the projector's pixel was read at {int(read.there.sum())} of {len(found.ids)} corners only, "
            f"{_LEAST_PROJECTOR} are needed: light all of the board, use a grey board (not black), expose longer; "
            "check the order of the photographs"
        )
    step = manifest.projector.code_step_px
    return replace(
        seen,
        problem=problem,
        projector_xy_px=(read.xy_px + 0.5) * step - 0.5,
        projector_by_camera=read.by_camera * step,
    )


def _decoded(
    view: ViewTable, pictures: dict[str, Photograph], projector: ProjectorTable, full_scale_dn: int
) -> Correspondence:
    limit = _BIT_LIMIT * full_scale_dn
    shape = pattern_shape(projector)
    white, black = pictures.get("white"), pictures.get("black")
    coded = {name: picture for name, picture in pictures.items() if name not in ("white", "black")}
    if view.code == "gray" or white is None or black is None:
        gray = {name: picture for name, picture in coded.items() if name.startswith(f"{view.code}-")}
        name = "long-run" if view.code == "long-run" else "gray"
        return decode_gray(
            gray,
            shape,
            white=white,
            black=black,
            contrast_limit=limit,
            bit_limit=limit,
            code="gray" if name == "gray" else "long-run",
        )
    return CODES[view.code].decode(coded, shape, white=white, black=black, noise_limit=limit)


def joined(views: tuple[SeenView, ...], board: Board) -> BoardSightings:
    """Put the usable views together; their numbers count the usable ones only."""
    used = [view for view in views if not view.problem]
    read = np.concatenate([view.projector_xy_px for view in used])
    lit = np.isfinite(read).all(axis=1)
    return BoardSightings(
        view=np.repeat(np.arange(len(used)), [len(view.board_m) for view in used]),
        board_m=np.concatenate([view.board_m for view in used]),
        camera_xy_px=np.concatenate([view.camera_xy_px for view in used]),
        camera_weight=np.concatenate([view.camera_weight for view in used]),
        projector_xy_px=np.where(lit[:, None], read, 0.0),
        projector_by_camera=np.concatenate([view.projector_by_camera for view in used]),
        projector_weight=lit.astype(np.float64),
        half_size_m=board.half_size_m,
    )
