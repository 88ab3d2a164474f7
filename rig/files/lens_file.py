"""Lens files: what `rig lenses` measured of a camera and a projector, as TOML that profiles and scans take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from calibration.geometry.known.lenses import MeasuredLens
from calibration.geometry.known.pair import KnownPair
from calibration.geometry.pinhole import PinholeModel
from calibration.lenses.lens import PARAMETERS
from rig.errors import ProfileError
from rig.files.atomic import write_bytes
from rig.files.toml import Table, read_model

SCHEMA = 1
POSE_PARAMETERS = tuple(f"pose.{name}" for name in ("turn_x", "turn_y", "turn_z", "x_m", "y_m", "z_m"))
"""Of the pose in the joint covariance."""
_Count = Annotated[int, Field(ge=1)]
_Positive = Annotated[float, Field(gt=0)]
_Terms = Annotated[tuple[float, ...], Field(min_length=5, max_length=8)]
_Nine = Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]
_HEAD = "# Lenses from boards, by rig lenses. Pixel centres at integers; OpenCV's model and order of terms; metres."


class LensEntry(Table):
    """One lens."""

    name: str
    """Of the device."""
    role: Literal["camera", "projector"]
    width_px: _Count
    height_px: _Count
    model: str
    """Distortion model that was fitted: none, k1, k1k2p1p2, k1k2p1p2k3 or rational."""
    focal_px: tuple[_Positive, _Positive]
    principal_point_px: tuple[float, float]
    """May lie outside the picture (lens shift)."""
    distortion: _Terms
    """k1, k2, p1, p2, k3; of the rational model also k4, k5, k6."""
    sigma: tuple[float, ...]
    """Standard deviations of fx, fy, cx, cy and the terms of distortion; 0: not fitted."""
    rms_px: float
    """RMS distance of a corner from its modelled place."""
    noise_px: float
    """Standard deviation of one coordinate of a corner."""
    projection_sigma_px: float
    """Median over the picture: standard deviation of the pixel at which a point far away is seen."""

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) of the picture."""
        return self.height_px, self.width_px


class PoseEntry(Table):
    """The projector's pose: x_projector = rotation · x_camera + translation_m."""

    rotation: _Nine
    """Row after row."""
    translation_m: tuple[float, float, float]
    sigma: Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
    """Of a turn (3) [rad] and of the translation (3) [m]."""


class JointEntry(Table):
    """Covariance of all that was fitted together."""

    parameters: tuple[str, ...]
    """``camera.fx`` … ``projector.k1`` … ``pose.turn_x`` … ``board.flex_x``."""
    covariance: tuple[tuple[float, ...], ...]

    @model_validator(mode="after")
    def _is_square(self) -> JointEntry:
        n = len(self.parameters)
        if [len(row) for row in self.covariance] != [n] * n:
            raise ValueError(f"covariance has to be {n} × {n} numbers, one row for each of the parameters")
        return self


class LensFile(Table):
    """A lens file."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    made_by: str
    date: str
    """Day of the calibration, YYYY-MM-DD (UTC)."""
    views: _Count
    """That the lenses rest on."""
    lens: tuple[LensEntry, ...]
    projector_from_camera: PoseEntry | None = None
    joint: JointEntry

    def entry(self, role: str, name: str | None = None) -> LensEntry | None:
        """Return the lens of a role, or of a name in that role; None when there is none."""
        return next((one for one in self.lens if one.role == role and name in (None, one.name)), None)

    def pinhole(self, role: Literal["camera", "projector"]) -> PinholeModel | None:
        """Return a lens at its pose, the camera's frame being the world; None when the file lacks lens or pose."""
        entry, pose = self.entry(role), self.projector_from_camera
        if entry is None or (role == "projector" and pose is None):
            return None
        stands = np.eye(3) if role == "camera" or pose is None else np.reshape(pose.rotation, (3, 3))
        place = np.zeros(3) if role == "camera" or pose is None else np.array(pose.translation_m)
        return PinholeModel(
            width_px=entry.width_px,
            height_px=entry.height_px,
            focal_px=entry.focal_px,
            principal_point_px=entry.principal_point_px,
            distortion=cast("tuple[float, float, float, float, float]", entry.distortion),  # or eight: scans take both
            rotation=stands,
            translation_m=place,
        )

    def measured(self, entry: LensEntry) -> MeasuredLens:
        """Return one of the lenses with all that the boards said of it, as the geometry takes it."""
        vector = np.zeros(len(PARAMETERS))
        values = (*entry.focal_px, *entry.principal_point_px, *entry.distortion)
        vector[: len(values)] = values
        return MeasuredLens(
            shape=entry.shape, vector=vector, covariance=self.covariance_of(entry.role), noise_px=entry.noise_px
        )

    def pair(self) -> KnownPair | None:
        """Return both lenses and their pose with all covariances; None when the file lacks one of them."""
        camera, projector, pose = self.entry("camera"), self.entry("projector"), self.projector_from_camera
        if camera is None or projector is None or pose is None:
            return None
        names = [f"{role}.{term}" for role in ("camera", "projector") for term in PARAMETERS]
        return KnownPair(
            shapes=(camera.shape, projector.shape),
            lenses=(self.measured(camera).vector, self.measured(projector).vector),
            rotation=np.reshape(pose.rotation, (3, 3)),
            translation_m=np.array(pose.translation_m),
            covariance=self._covariance([*names, *POSE_PARAMETERS], [*names, *POSE_PARAMETERS]),
        )

    def covariance_of(self, role: str) -> NDArray[np.float64]:
        """(12, 12) covariance of a lens, in the order of ``calibration.lenses.lens.PARAMETERS``."""
        return self.covariance_between(role, role)

    def covariance_between(self, first: str, second: str) -> NDArray[np.float64]:
        """(12, 12) covariance of the parameters of one role (rows) and another (columns)."""
        rows, columns = ([f"{role}.{term}" for term in PARAMETERS] for role in (first, second))
        return self._covariance(rows, columns)

    def _covariance(self, rows: Sequence[str], columns: Sequence[str]) -> NDArray[np.float64]:
        """Return the covariance of parameters by name; zero where one was not fitted."""
        known, joint = {name: k for k, name in enumerate(self.joint.parameters)}, np.array(self.joint.covariance)
        there = [[known.get(name, -1) for name in names] for names in (rows, columns)]
        whole = joint[np.ix_(*there)]
        return np.asarray(np.where((np.array(there[0]) < 0)[:, None] | (np.array(there[1]) < 0)[None], 0.0, whole))

    def as_toml(self) -> str:
        """Return the text of the file; numbers with all their digits."""
        head = [f"schema = {SCHEMA}", f'made_by = "{self.made_by}"', f'date = "{self.date}"', f"views = {self.views}"]
        blocks = [[_HEAD, *head]]
        blocks += [["[[lens]]", *_lines(lens)] for lens in self.lens]
        if self.projector_from_camera is not None:
            blocks.append(["[projector_from_camera]", *_lines(self.projector_from_camera)])
        blocks.append(["[joint]", *_lines(self.joint)])
        return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _lines(table: Table) -> list[str]:
    return [f"{name} = {_value(getattr(table, name))}" for name in type(table).model_fields]


def _value(value: object) -> str:
    if isinstance(value, tuple):
        inner = [_value(one) for one in value]
        deep = bool(value) and isinstance(value[0], tuple)
        return "[\n  " + ",\n  ".join(inner) + ",\n]" if deep else "[" + ", ".join(inner) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def read_lens_file(path: Path) -> LensFile:
    """Read a lens file.

    Raises
    ------
    ProfileError
        It cannot be read, or is none; a line for each problem.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror}; `rig lenses MANIFEST` writes lens files"
        ) from error
    return read_model(LensFile, raw, path, lambda _data: [])


def write_lens_file(path: Path, lenses: LensFile) -> None:
    """Write a lens file.

    Raises
    ------
    SessionError
        The disk is full or refuses.
    """
    write_bytes(path, lenses.as_toml().encode())


def scan_tables(lenses: LensFile) -> str:
    """Return what a manifest of `rig scan` says of lenses and pose, as TOML.

    Raises
    ------
    ProfileError
        The file has no projector.
    """
    projector, pose = lenses.entry("projector"), lenses.projector_from_camera
    if projector is None or pose is None:
        raise ProfileError(
            "the lens file has no projector; a scan needs both lenses and their pose: "
            "photograph boards that the projector lights, too (docs/how-to/lenses.md)"
        )
    blocks = []
    for lens in lenses.lens:
        keys = ("focal_px", "principal_point_px", "distortion")
        blocks.append([f"[{lens.role}.lens]", *(f"{key} = {_value(getattr(lens, key))}" for key in keys)])
    pose_lines = [f"rotation = {_value(pose.rotation)}", f"translation = {_value(pose.translation_m)}", 'unit = "m"']
    blocks.append(["[projector_from_camera]", *pose_lines])
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"
