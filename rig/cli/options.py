"""Options and arguments that several verbs share, once each, and how a result is printed for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Protocol

from cyclopts import Parameter

from rig.errors import UsageError
from rig.records import JsonObject, json_of
from rig.run import request

if TYPE_CHECKING:
    from rig.profile.target_table import TargetTable

ProfileOption = Annotated[
    str | None,
    Parameter(name=["--profile", "-p"], help="Profile file or name; needed once, then the session keeps its copy."),
]
SessionFolder = Annotated[Path, Parameter(help="Folder of the session; made if it does not exist.")]
Target = Annotated[
    Path | None,
    Parameter(
        help="Picture to show (PNG, JPEG, TIFF, EXR), or default: a test picture. Without it the session's last one."
    ),
]
Linear = Annotated[
    bool,
    Parameter(name="--linear", negative="", help="The target's codes are linear light; default: sRGB (EXR is linear)."),
]
Fit = Annotated[
    bool, Parameter(name="--fit", negative="", help="Scale and crop a target of another size to the projector's.")
]
Strategies = Annotated[
    str,
    Parameter(
        name=["--strategies", "--strategy"],
        help="Strategies to project, separated by commas, or all: none, direct, paper, exact, reverse_radiosity, "
        "block_fixed_point, tikhonov, series, dual, bounded, perceptual, remap, content_scale, smooth_attenuation; "
        "rig devices lists those of other packages, too.",
    ),
]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PlaceOptions:
    """Where a target is wanted; nothing of it given: where the profile says, else pixel by pixel."""

    placed: Annotated[
        Literal["projector", "camera", "panorama", "cube", "surface"] | None,
        Parameter(
            help="projector: pixel by pixel; camera: as it sees it; panorama or cube: seen from --viewer; surface."
        ),
    ] = None
    viewer: Annotated[str | None, Parameter(help="X,Y,Z of the viewer's eyes in the room, metres.")] = None
    turn: Annotated[
        float, Parameter(help="Degrees by which a panorama's middle lies to the right of where the projector looks.")
    ] = 0.0
    on: Annotated[
        str | None, Parameter(help="Surface: x0, x1, y0, y1, floor, ceiling, or 'thing N' of the report.")
    ] = None
    corners: Annotated[
        str | None,
        Parameter(
            help="Upper left, upper right, lower right, lower left of the picture on it, metres right and up: X,Y X,Y …"
        ),
    ] = None

    def table(self) -> TargetTable | None:
        """Return the same as the profile says it; None where nothing was given. Raises UsageError."""
        if self == PlaceOptions():
            return None
        from pydantic import ValidationError

        from rig.profile.target_table import TargetTable  # here, for most command lines need neither

        kind = self.placed or ("surface" if self.on else "panorama" if self.viewer else "projector")
        values = {
            "placed": kind,
            "viewer_m": _numbers("--viewer", self.viewer, 3),
            "turn_deg": self.turn,
            "surface": self.on,
            "corners_m": None
            if self.corners is None
            else [_numbers("--corners", one, 2) for one in self.corners.split()],
        }
        try:
            return TargetTable.model_validate(values)
        except ValidationError as error:
            raise UsageError(
                "; ".join(str(one["msg"]).removeprefix("Value error, ") for one in error.errors())
            ) from error


def _numbers(option: str, text: str | None, count: int) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise UsageError(f"{option} {text}: give {count} numbers with commas between, in metres")
    return values


NO_PLACE = PlaceOptions()
DEFAULT_STRATEGIES = ",".join(request.DEFAULT_STRATEGIES)
Json = Annotated[bool, Parameter(name="--json", negative="", help="Print the result as JSON.")]


class HasJson(Protocol):
    """A result that can be written as JSON."""

    def as_json(self) -> JsonObject:
        """The result as one JSON object."""
        ...


def print_json(result: HasJson | Mapping[str, object]) -> None:
    """Print a result on stdout, for programs."""
    value = json_of(result) if isinstance(result, Mapping) else result.as_json()
    print(json.dumps(value, indent=2, allow_nan=False))


def names_of(text: str) -> tuple[str, ...]:
    """Return the words of a list that is separated by commas."""
    return tuple(name.strip() for name in text.split(","))
