"""The manifest of a folder of photographs: which file shows which pattern, and what the lenses are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from calibration.geometry.known.pair import KnownPair
from calibration.geometry.pinhole import PinholeModel
from calibration.structured_light.gray import bits_for
from rig.errors import DeviceLost, ProfileError, UsageError
from rig.files.lens_file import read_lens_file
from rig.files.pictures import read_pixels
from rig.files.toml import Table, read_model
from rig.terminal.line import first_of

Photograph = NDArray[Any]
"""uint8 or uint16."""

_Count = Annotated[int, Field(ge=1)]
_Positive = Annotated[float, Field(gt=0)]
_FileName = Annotated[str, Field(min_length=1)]
_PatternName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]*$")]
_ROTATION_TOLERANCE = 1e-3
_METRES = {"m": 1.0, "mm": 1e-3}
_GREY_WEIGHTS = (0.299, 0.587, 0.114)
_COARSEST_FINEST_BIT = 8
_LISTED = 12
"""Problems that a message lists."""


class _Lens(Table):
    focal_px: tuple[_Positive, _Positive]
    principal_point_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


class _Crop(Table):
    left_px: Annotated[int, Field(ge=0)] = 0
    top_px: Annotated[int, Field(ge=0)] = 0


class _Device(Table):
    width_px: _Count
    height_px: _Count
    lens: _Lens | None = None
    crop: _Crop = _Crop()


class _Camera(_Device):
    full_scale_dn: Annotated[int, Field(ge=1, le=65535)]
    black_level_dn: Annotated[float, Field(ge=0)] = 0.0


class _Pose(Table):
    rotation: Annotated[tuple[float, ...], Field(min_length=9, max_length=9)]
    translation: tuple[float, float, float]
    unit: Literal["m", "mm"]

    @model_validator(mode="after")
    def _rotates(self) -> _Pose:
        rotation = np.clip(self.rotation, -2.0, 2.0).reshape(3, 3)  # no rotation has more than 1, and none overflows
        error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if error > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
            raise ValueError(
                f"rotation is none: R·Rᵀ is off the identity by {error:.2g} (limit {_ROTATION_TOLERANCE:g}), "
                f"determinant {np.linalg.det(rotation):+.3f}; give 9 numbers, row after row"
            )
        return self


class _GrayCode(Table):
    columns: tuple[_FileName, ...] = ()
    columns_inverse: tuple[_FileName, ...] = ()
    rows: tuple[_FileName, ...] = ()
    rows_inverse: tuple[_FileName, ...] = ()
    finest_bit: Annotated[int, Field(ge=0, le=_COARSEST_FINEST_BIT)] = 0
    first_code: tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]] = (0, 0)

    @model_validator(mode="after")
    def _has_all_inverses_or_none(self) -> _GrayCode:
        if not self.columns and not self.rows:
            raise ValueError("names neither columns nor rows; name the photographs of one of them at least")
        for axis, plain, inverse in self.axes:
            if len(inverse) not in (0, len(plain)):
                raise ValueError(
                    f"{axis}s_inverse names {len(inverse)} photographs, {axis}s {len(plain)}; "
                    "name the inverse of every bit, or of none"
                )
        return self

    @property
    def axes(self) -> tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...]:
        return ("column", self.columns, self.columns_inverse), ("row", self.rows, self.rows_inverse)

    def files(self) -> Iterator[tuple[str, str]]:
        """(pattern's name, file) of each photograph."""
        for axis, plain, inverse in self.axes:
            for names, suffix in ((plain, ""), (inverse, "-inverse")):
                for bit, file in zip(reversed(range(len(names))), names, strict=True):
                    yield f"gray-{axis}-{bit + self.finest_bit:02d}{suffix}", file


class _Document(Table):
    schema_: Annotated[Literal[1], Field(alias="schema")]
    lens_file: _FileName | None = None
    """Of `rig lenses`: both lenses and their pose, in the place of the tables."""
    camera: _Camera
    projector: _Device
    projector_from_camera: _Pose | None = None
    gray_code: _GrayCode | None = None
    frames: dict[_PatternName, _FileName] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """A folder of photographs; lenses and lengths refer to the photographs' own pixels, in metres."""

    path: Path
    camera_shape: tuple[int, int]
    """(height, width) of every photograph. [px]"""
    full_scale_dn: int
    black_level_dn: float
    projector_shape: tuple[int, int]
    """(height, width) of the area that the patterns were shown in. [px]"""
    camera: PinholeModel | None
    """In its own frame, which is the world; None when the manifest has no lens."""
    camera_is_cropped: bool
    """Whether the manifest says that the photographs are a part of the picture that the lens numbers refer to."""
    projector: PinholeModel | None
    unit: Literal["m", "mm"]
    """Unit of the pose in the file; a point cloud is written in it."""
    known: KnownPair | None
    """Lenses and pose with their covariances, of a lens file; None where tables say what they are."""
    first_code: tuple[int, int]
    """(column, row) code shown at the projector's first pixel."""
    finest_bit: int
    """Bit of the finest stripes that were shown; 0 when none is missing."""
    frames: Mapping[str, Path]
    """Photograph of each pattern, by the pattern's name; Gray code and all others."""


def load_manifest(path: Path) -> Manifest:
    """Read and validate a manifest; no photograph is opened.

    Raises ProfileError with a line for each problem.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ProfileError(f"{path}: cannot be read: {error.strerror}; give the manifest's name") from error
    document = read_model(_Document, raw, path, _cross_checks)
    pose, code = document.projector_from_camera, document.gray_code
    known = None if document.lens_file is None else _known(document, path)
    camera, projector = (None, None) if known is None else known.devices(np.zeros(known.spread.shape[1]))
    return Manifest(
        path=path,
        camera_shape=(document.camera.height_px, document.camera.width_px),
        full_scale_dn=document.camera.full_scale_dn,
        black_level_dn=document.camera.black_level_dn,
        projector_shape=(document.projector.height_px, document.projector.width_px),
        camera=camera or _pinhole(document.camera, None),
        camera_is_cropped=document.camera.crop != _Crop(),
        projector=projector or (None if pose is None else _pinhole(document.projector, pose)),
        unit="m" if pose is None else pose.unit,
        known=known,
        first_code=(0, 0) if code is None else code.first_code,
        finest_bit=0 if code is None else code.finest_bit,
        frames={name: path.parent / file for name, file in _named(document).items()},
    )


def _known(document: _Document, path: Path) -> KnownPair:
    """Lenses and pose of a lens file, in the pixels of the photographs and of the area that was shown."""
    file = path.parent / (document.lens_file or "")
    pair = read_lens_file(file).pair()
    if pair is None:
        raise ProfileError(
            f"{path}: lens_file: {file} has no projector; a scan needs both lenses and their pose: "
            "photograph boards that the projector lights, too (docs/how-to/lenses.md)"
        )
    lenses = []
    for name, device, (height, width), vector in zip(
        ("camera", "projector"), (document.camera, document.projector), pair.shapes, pair.lenses, strict=True
    ):
        crop = device.crop
        fits = crop.left_px + device.width_px <= width and crop.top_px + device.height_px <= height
        whole = (device.width_px, device.height_px) == (width, height)
        if not (whole if crop == _Crop() else fits):
            raise ProfileError(
                f"{path}: lens_file: {file} was made with a {name} of {width} × {height} px, the manifest's has "
                f"{device.width_px} × {device.height_px} px: calibrate at this size, or say in [{name}.crop] where in "
                "the whole picture these pixels lie"
            )
        moved = vector.copy()
        moved[2:4] -= (crop.left_px, crop.top_px)
        lenses.append(moved)
    shapes = tuple((device.height_px, device.width_px) for device in (document.camera, document.projector))
    return replace(pair, lenses=(lenses[0], lenses[1]), shapes=(shapes[0], shapes[1]))


def _named(document: _Document) -> dict[str, str]:
    code = document.gray_code
    return {**document.frames, **(dict(code.files()) if code else {})}


def _pinhole(device: _Device, pose: _Pose | None) -> PinholeModel | None:
    """Lens in the pixels of the crop: only the principal point moves."""
    if device.lens is None:
        return None
    centre_x, centre_y = device.lens.principal_point_px
    return PinholeModel(
        width_px=device.width_px,
        height_px=device.height_px,
        focal_px=device.lens.focal_px,
        principal_point_px=(centre_x - device.crop.left_px, centre_y - device.crop.top_px),
        distortion=device.lens.distortion,
        rotation=np.eye(3) if pose is None else np.array(pose.rotation, dtype=np.float64).reshape(3, 3),
        translation_m=np.zeros(3) if pose is None else np.array(pose.translation) * _METRES[pose.unit],
    )


def _cross_checks(data: dict[str, Any]) -> list[str]:
    """Problems between tables; what single tables get wrong is found elsewhere."""
    code, projector, frames = (_table(data, key) for key in ("gray_code", "projector", "frames"))
    said = [
        name
        for name, there in (
            ("camera.lens", "lens" in _table(data, "camera")),
            ("projector.lens", "lens" in projector),
            ("projector_from_camera", "projector_from_camera" in data),
        )
        if there and "lens_file" in data
    ]
    if said:
        return [f"{said[0]}: lens_file says it too; leave one of the two out"]
    if not code and not frames:
        return ["gray_code: missing; name at least one photograph in [gray_code] or [frames]"]
    coded = ("gray-column-", "gray-row-")
    problems = [f"frames.{n}: belongs into [gray_code]" for n in frames if code and n.startswith(coded)]
    first = code.get("first_code", (0, 0))
    finest = code.get("finest_bit", 0)
    missing = finest if isinstance(finest, int) else 0
    offsets = first if isinstance(first, (list, tuple)) and len(first) == 2 else (0, 0)
    for axis, size, offset in (("columns", "width_px", offsets[0]), ("rows", "height_px", offsets[1])):
        files, size_px = code.get(axis), projector.get(size)
        if isinstance(files, list) and isinstance(size_px, int) and isinstance(offset, int) and size_px > 0:
            needed = max(1, bits_for(size_px + max(offset, 0)) - missing)
            if 0 < len(files) < needed:
                problems.append(
                    f"gray_code.{axis}: names {len(files)} photographs, projector.{size} = {size_px} needs "
                    f"{needed}; name one for each bit, most significant first, or say in gray_code.finest_bit how many "
                    "of the finest are missing"
                )
    return problems


def _table(data: dict[str, Any], key: str) -> dict[str, Any]:
    found = data.get(key)
    return found if isinstance(found, dict) else {}


def read_photograph(path: Path) -> Photograph:
    """Read one photograph as the file has it: (H, W, 1) or (H, W, 3) unsigned integers.

    JPEG, PNG, TIFF of 8 or 16 bits, or EXR of whole digital numbers; the orientation that the camera noted is
    applied, transparency is left out. A file that ends early is an error, not half a picture.

    Raises
    ------
    DeviceLost
        The file is missing, damaged, or holds no unsigned integers.
    """
    try:
        pixels = read_pixels(path).pixels
    except UsageError as error:
        raise DeviceLost(str(error)) from error
    colours = pixels[..., :3] if pixels.shape[2] >= 3 else pixels[..., :1]
    return _whole_numbers(np.ascontiguousarray(colours), path)


def _whole_numbers(pixels: NDArray[Any], path: Path) -> Photograph:
    if pixels.dtype in (np.uint8, np.uint16):
        return pixels
    if pixels.dtype.kind == "f" and np.isfinite(pixels).all():
        digital = np.clip(np.rint(pixels), 0, 65535).astype(np.uint16)
        if np.array_equal(digital, pixels) and digital.max() > 1:
            return np.asarray(digital)
    raise DeviceLost(f"{path}: has {pixels.dtype} values that are no digital numbers 0 … 65535; use 8 or 16 bits")


def grey(photograph: Photograph) -> Photograph:
    """(H, W) of (H, W, 1) as it is, of (H, W, 3) 0.299 red + 0.587 green + 0.114 blue (BT.601), rounded."""
    if photograph.shape[2] == 1:
        return np.ascontiguousarray(photograph[..., 0])
    return np.asarray(cv2.transform(photograph, np.array([_GREY_WEIGHTS])).reshape(photograph.shape[:2]))


def check_photographs(manifest: Manifest) -> None:
    """Read every photograph once and keep none; raises as :func:`load_photographs`."""
    problems = [problem for _, _, problem in _photographs(manifest) if problem]
    _refuse(manifest, problems)


def load_photographs(
    manifest: Manifest, on_photograph: Callable[[int, int], None] | None = None
) -> dict[str, Photograph]:
    """Read every photograph as grey (H, W), by the pattern's name.

    ``on_photograph`` is told how many of how many are read.

    Raises
    ------
    DeviceLost
        One message that lists every photograph that is missing, damaged, of the wrong size, brighter than
        full scale, or named for two patterns.
    """
    frames, problems = {}, []
    for count, (name, pixels, problem) in enumerate(_photographs(manifest), start=1):
        if pixels is not None:
            frames[name] = grey(pixels)
        if problem:
            problems.append(problem)
        if on_photograph:
            on_photograph(count, len(manifest.frames))
    _refuse(manifest, problems)
    return frames


def _photographs(manifest: Manifest) -> Iterator[tuple[str, Photograph | None, str]]:
    """(pattern's name, pixels, problem) of each."""
    first_use: dict[Path, str] = {}
    for name, path in manifest.frames.items():
        earlier = first_use.setdefault(path.resolve(), name)
        if earlier != name:
            yield name, None, f"{path.name}: is named for {earlier} and for {name}"
            continue
        try:
            pixels = read_photograph(path)
        except DeviceLost as error:
            yield name, None, str(error).removeprefix(f"{path.parent}/")
            continue
        problem = _unfit(pixels, manifest)
        yield name, None if problem else pixels, problem and f"{path.name}: {problem}"


def _unfit(pixels: Photograph, manifest: Manifest) -> str:
    height, width = manifest.camera_shape
    if pixels.shape[:2] != (height, width):
        return f"is {pixels.shape[1]} × {pixels.shape[0]} px, the manifest's camera {width} × {height} px"
    brightest = int(pixels.max())
    if brightest > manifest.full_scale_dn:
        return f"has {brightest} dn, above camera.full_scale_dn = {manifest.full_scale_dn}"
    return ""


def _refuse(manifest: Manifest, problems: list[str]) -> None:
    if not problems:
        return
    lines = "\n".join(f"  {line}" for line in first_of(problems, _LISTED))
    raise DeviceLost(
        f"{manifest.path}: {len(problems)} of {len(manifest.frames)} photographs cannot be used:\n{lines}\n"
        "copy them again or correct the manifest"
    )
