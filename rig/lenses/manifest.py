"""The manifest of `rig lenses`: which board, which devices, which photographs or lists of corners."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from calibration.errors import CalibrationError
from calibration.lenses.boards import Board, BoardKind
from calibration.structured_light.code import CODES
from calibration.structured_light.gray import bits_for
from rig.errors import ProfileError
from rig.files.toml import Table, read_model
from rig.terminal.line import counted

_Count = Annotated[int, Field(ge=1)]
_NotNegative = Annotated[int, Field(ge=0)]
_FileName = Annotated[str, Field(min_length=1)]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
_Model = Literal["none", "k1", "k1k2p1p2", "k1k2p1p2k3", "rational"]


class CameraTable(Table):
    """The camera; its size may be left out when photographs tell it."""

    name: _Name = "camera"
    width_px: _Count | None = None
    height_px: _Count | None = None
    full_scale_dn: Annotated[int, Field(ge=1, le=65535)] = 255
    model: _Model | None = None
    """Distortion; left out: chosen by left-out views."""


class ProjectorTable(Table):
    """The projector that lights the board."""

    name: _Name = "projector"
    width_px: _Count
    height_px: _Count
    model: _Model | None = None
    code_step_px: _Count = 1
    """Projector pixels that one step of the code covers."""


class BoardTable(Table):
    """The board, as it was measured with a ruler."""

    kind: BoardKind
    columns: _Count
    rows: _Count
    square_m: Annotated[float, Field(gt=0)]
    marker_m: Annotated[float, Field(ge=0)] = 0.0
    dictionary: str = "DICT_4X4_50"
    legacy: bool = False
    flex: bool | None = None
    """Whether the board may be bent; left out: decided by left-out views."""

    def board(self) -> Board:
        """Return the board."""
        names = ("kind", "columns", "rows", "square_m", "marker_m", "dictionary", "legacy")
        return Board(**{name: getattr(self, name) for name in names})


class CornersTable(Table):
    """Corners that another program found: text, ``filename x y level`` a line."""

    camera: _FileName
    projector: _FileName | None = None
    """The projector's pixels of the same corners, named by the camera's photographs."""
    last_column: Literal["level", "weight"] | None = None
    """What the fourth column is; left out: what the file's comment says, else a level."""


class CropTable(Table):
    """Where a photograph's first pixel lies in the camera's picture."""

    left_px: _NotNegative = 0
    top_px: _NotNegative = 0


class ViewTable(Table):
    """One pose of the board."""

    name: _Name
    photograph: _FileName | None = None
    """The board in even light; left out: the frame ``white``."""
    crop: CropTable = CropTable()
    code: str = "gray"
    files: Annotated[str, Field(pattern=r"\{pattern\}")] | None = None
    """File names of the code's photographs, ``{pattern}`` for the pattern's name; ``white`` and ``black`` too."""
    sequence: tuple[_FileName, ...] = ()
    """Photographs in the order of OpenCV's GrayCodePattern: each bit and its inverse, columns, rows; white, black."""
    frames: dict[str, _FileName] = Field(default_factory=dict)
    """Photographs by the name of their pattern."""

    @model_validator(mode="after")
    def _says_one_thing(self) -> ViewTable:
        if self.code not in CODES:
            raise ValueError(f"code is {self.code!r}, should be one of {', '.join(CODES)}")
        if sum(map(bool, (self.files, self.sequence, self.frames))) > 1:
            raise ValueError("files, sequence and frames say the same thing; give one")
        if self.photograph is None and not (self.files or self.sequence or "white" in self.frames):
            raise ValueError("needs photograph, a picture of the board in even light, or a frame white")
        return self


class LensManifest(Table):
    """All that `rig lenses` is told."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    camera: CameraTable = CameraTable()
    projector: ProjectorTable | None = None
    board: BoardTable
    corners: CornersTable | None = None
    view: tuple[ViewTable, ...] = ()

    @model_validator(mode="after")
    def _has_views(self) -> LensManifest:
        if (self.corners is None) == (not self.view):
            raise ValueError("needs either [corners], lists that another program made, or [[view]] with photographs")
        if self.corners is not None and (self.camera.width_px is None or self.camera.height_px is None):
            raise ValueError("camera.width_px and camera.height_px: missing; lists of corners do not tell them")
        if self.corners is not None and self.corners.projector and self.projector is None:
            raise ValueError("projector: missing; corners.projector needs its size")
        names = [view.name for view in self.view]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"view: {', '.join(twice)} is named twice; each view has a name of its own")
        return self


def load_lens_manifest(path: Path) -> LensManifest:
    """Read and check a manifest; no photograph is opened.

    Raises
    ------
    ProfileError
        A line for each problem.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; give the manifest's name") from error
    manifest = read_model(LensManifest, raw, path, _none)
    try:
        manifest.board.board().check()
    except CalibrationError as error:
        raise ProfileError(f"{path}: board: {error}") from error
    return manifest


def _none(_data: dict[str, Any]) -> list[str]:
    return []


def pattern_shape(projector: ProjectorTable) -> tuple[int, int]:
    """(height, width) of the code's pictures, in steps."""
    step = projector.code_step_px
    return -(-projector.height_px // step), -(-projector.width_px // step)


def frames_of(view: ViewTable, projector: ProjectorTable | None, folder: Path) -> dict[str, Path]:
    """Return the photographs of a view's code by the name of their pattern; none without a projector.

    Raises
    ------
    ProfileError
        A sequence has another length than the code, or there are photographs of a larger projector's.
    """
    if projector is None:
        return {}
    shape = pattern_shape(projector)
    if view.sequence:
        return {name: folder / file for name, file in _in_sequence(view, shape).items()}
    if view.files is not None:
        names = (*CODES[view.code].pattern_names(shape), "white", "black")
        _refuse_others(view, shape, folder)
        return {name: folder / view.files.replace("{pattern}", name) for name in names}
    return {name: folder / file for name, file in view.frames.items()}


def _refuse_others(view: ViewTable, shape: tuple[int, int], folder: Path) -> None:
    """Refuse photographs of stripes that only a projector of up to twice as many steps shows."""
    needed = set(CODES[view.code].pattern_names(shape))
    for name in CODES[view.code].pattern_names((2 * shape[0], 2 * shape[1])):
        file = (view.files or "").replace("{pattern}", name)
        if name not in needed and (folder / file).is_file():
            raise ProfileError(
                f"view.{view.name}.files: {file} is there, and a projector of {shape[1]} × {shape[0]} steps shows no "
                f"{name}: correct projector.width_px, height_px or code_step_px, or take that photograph away"
            )


def _in_sequence(view: ViewTable, shape: tuple[int, int]) -> dict[str, str]:
    names = [
        f"gray-{axis}-{bit:02d}{end}"
        for axis, size in (("column", shape[1]), ("row", shape[0]))
        for bit in reversed(range(bits_for(size)))
        for end in ("", "-inverse")
    ]
    if len(view.sequence) not in (len(names), len(names) + 2):
        raise ProfileError(
            f"view.{view.name}.sequence: names {counted(len(view.sequence), 'photograph')}; a projector of "
            f"{shape[1]} × {shape[0]} steps needs {len(names)} (each bit and its inverse, columns before rows), or "
            f"{len(names) + 2} with white and black at the end"
        )
    return dict(zip((*names, "white", "black"), view.sequence, strict=False))
